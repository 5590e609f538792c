"""Public names of `jaxgear.study`."""

from ._condense import condense as condense
from ._fidelity._compare import compare as compare
from ._gradients import check_gradients as check_gradients
from ._live import LiveScene as LiveScene
from ._live import live_scene as live_scene
from ._modes import modes as modes
from ._optimising import optimise as optimise
from ._progress import Listener as Listener
from ._progress import listened_by as listened_by
from ._relief_map import relief_map as relief_map
from ._result import Result as Result
from ._run import run as run
from ._run import sizing as sizing
from ._run import statics as statics
from ._running import stopwatch as stopwatch
from ._sensitivities import sensitivity as sensitivity
from ._sweep import sweep as sweep
