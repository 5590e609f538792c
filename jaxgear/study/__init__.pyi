"""Public names of `jaxgear.study`."""

from ._fidelity._compare import compare as compare
from ._modes import modes as modes
from ._progress import Listener as Listener
from ._progress import listened_by as listened_by
from ._result import Result as Result
from ._running import stopwatch as stopwatch
