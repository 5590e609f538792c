"""The keys of a study file, as tables."""

from collections.abc import Mapping
from typing import Any, Literal

from jaxgear.scene._table import AbstractKeys, key, keys_of

# Tables below which names are keys of the scene.
BY_PATH = ("design.between", "design.values", "design.scatter", "design.even")


class DesignKeys(AbstractKeys):
    """Which designs: `[design]`."""

    kind: Literal["sobol", "lhs", "random", "grid", "one-at-a-time"] = key(
        "how designs are spread over what varies", default="sobol"
    )
    points: int | None = key(
        "number of designs; of a grid and one-at-a-time, values of each key between its bounds",
        "[1, 10000000]",
    )
    seed: int = key("of scrambling and chance", "[0, 4294967295]", 0)
    csv: str | None = key("a file of designs: a column for each key, a line for each design")
    between: Mapping[str, list[float]]
    values: Mapping[str, list[Any]]
    scatter: Mapping[str, float]
    even: Mapping[str, float]


class KeepKeys(AbstractKeys):
    """What is kept of each design: `[keep]`."""

    numbers: list[str] = key("numbers, by their names in summary.json, such as static.te_rms_um")
    arrays: list[str] = key("variables of result.nc, such as transmission_error_um", default=[])
    gradients: bool = key("whether derivatives by every varied key are kept", default=False)
    minimise: list[str] = key("numbers of which little is good; the first if left out", default=[])
    best: int = key("scenes written of the best designs", "[0, 100]", 3)


class SlurmKeys(AbstractKeys):
    """Jobs of a SLURM cluster, by submitit: `[work.slurm]`."""

    cluster: Literal["slurm", "local"] = key("local: without SLURM, to try", default="slurm")
    jobs: int = key("number of jobs, a shard each", "[1, 10000]", 4)
    partition: str | None = key("partition to submit to")
    time_min: int = key("time limit of a job", "[1, inf)", 60)
    memory_GB: float = key("memory of a job", "(0, inf)", 4.0)
    cpus: int = key("processors of a job", "[1, 1024]", 1)


class WorkKeys(AbstractKeys):
    """How to work: `[work]`."""

    chunk: int | None = key(
        "designs in one file and one compiled call; 256, or 1 of dear commands", "[1, 100000]"
    )
    engine: Literal["processes", "dask", "slurm"] = key("who computes", default="processes")
    workers: int = key("processes; 1 is this one", "[1, 1024]", 1)
    scheduler: str | None = key("address of a Dask scheduler, such as tcp://node:8786")
    slurm: SlurmKeys


class StudyKeys(AbstractKeys):
    """A study file."""

    schema: int = key("version of this format", "[1, 1]")
    name: str | None = key("names the folder of results; that of the file if left out")
    scene: str = key("a scene file, or the name of an example scene")
    set: list[str] = key("changes of the scene, key=value as of --set", default=[])
    command: Literal["run", "sweep", "modes", "optimise"] = key(
        "what is computed of each design; run: its mesh cycle", default="run"
    )
    design: DesignKeys
    keep: KeepKeys
    work: WorkKeys


KEYS = {each.path: each for each in keys_of(StudyKeys)}
TABLES = {"design", "keep", "work", "work.slurm", *BY_PATH}
