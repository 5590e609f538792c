"""Public names of `jaxgear.study`."""

from ._condense import condense as condense
from ._gradients import check_gradients as check_gradients
from ._modes import modes as modes
from ._progress import Listener as Listener
from ._progress import listened_by as listened_by
from ._result import Result as Result
from ._running import stopwatch as stopwatch
from ._sensitivities import sensitivity as sensitivity
