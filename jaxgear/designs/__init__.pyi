"""Public names of `jaxgear.designs`."""

from ._asked import Study as Study
from ._asked import read_study as read_study
from ._collect import collect as collect
from ._run import run as run
from ._work import Shard as Shard
from ._work import Status as Status
from ._work import status as status
