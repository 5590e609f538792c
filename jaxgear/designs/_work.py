"""The folder of a study: where its chunks are, which are missing, and one shard of them computed.

A chunk is one file, written whole: that it is there is all that is known of its being done.
"""

import functools
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from jaxgear._checks import InputError, require, require_float64
from jaxgear._program_cache import set_up
from jaxgear._whole_file import as_json, write_dataset, write_json
from jaxgear.designs._asked import Study, read_study
from jaxgear.designs._chunks import Chunk, chunks_of, origin_of
from jaxgear.designs._datasets import chunk_dataset
from jaxgear.designs._evaluate import Evaluator
from jaxgear.designs._table import DesignTable, design_table
from jaxgear.scene._key import show
from jaxgear.scene._mistakes import Mistake, SceneError

# What a study began with, and where its chunks are.
_ORIGIN, _CHUNKS = "study.json", "chunks"


class Shard(NamedTuple):
    """Part of a study: every so many chunks.

    **Fields:**

    - `index`: from 0.
    - `count`: of all shards.
    """

    index: int = 0
    count: int = 1


WHOLE = Shard()


class Status(NamedTuple):
    """How far a study is.

    **Fields:**

    - `chunks`, `designs`: of the study.
    - `done_chunks`, `done_designs`: of these, whose results are there.
    """

    chunks: int
    designs: int
    done_chunks: int
    done_designs: int


class Job(NamedTuple):
    """A study and where its results are.

    **Fields:**

    - `study`: what is asked for.
    - `table`: its designs.
    - `chunks`: of these.
    - `folder`: of the results.
    """

    study: Study
    table: DesignTable
    chunks: tuple[Chunk, ...]
    folder: Path

    def file(self, chunk: Chunk) -> Path:
        """Where the results of a chunk are, or will be."""
        return self.folder / _CHUNKS / f"{chunk.name}.nc"

    @property
    def missing(self) -> tuple[Chunk, ...]:
        """The chunks without results."""
        return tuple(chunk for chunk in self.chunks if not self.file(chunk).exists())


def job_of(
    path: str | os.PathLike[str],
    folder: str | os.PathLike[str] | None = None,
    *,
    anew: bool = False,
) -> Job:
    """A study, its designs and chunks.

    **Arguments:**

    - `path`: the study file.
    - `folder`: of its results; `results/NAME` without it.
    - `anew`: whether results that are there are of no interest.

    **Raises:**

    - `SceneError` with what is wrong in the study or its scene, or what has changed in them since
        results were computed.
    """
    study = read_study(path)
    table = design_table(study)
    own = Path("results") / study.name if folder is None else Path(folder)
    job = Job(study, table, chunks_of(study, table), own)
    if not anew:
        _refuse_changed(job)
    return job


def _refuse_changed(job: Job) -> None:
    """Refuse a study that is no longer the one whose results are in its folder."""
    file = job.folder / _ORIGIN
    try:
        before = json.loads(file.read_text(encoding="utf-8"))["made_from"]
    except FileNotFoundError:
        return
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(
            f"{file}: this is no record of a study. Name another folder: --out DIR."
        ) from None
    done = len(list((job.folder / _CHUNKS).glob("*.nc")))
    now: Any = as_json(origin_of(job.study))
    if not done or before == now:
        return
    remedy = f"for {done} finished chunks. Put it back, name another folder (--out), or begin anew "
    remedy += "(--no-resume)"
    mistakes = [
        Mistake(
            _where(job.study, key),
            key.partition(".")[2] or key,
            f"is {_told(now, key)}, and was {_told(before, key)} {remedy}",
        )
        for key in sorted({*before, *now})
        if before.get(key) != now.get(key)
    ]
    raise SceneError(mistakes)


def _told(values: Mapping[str, Any], key: str) -> str:
    return show(values[key]) if key in values else "left out"


def _where(study: Study, key: str) -> str:
    of, _, name = key.removesuffix(" (its content)").partition(".")
    if of == "scene":
        return study.scene.where(name)
    return study.where(name) if of == "study" else str(study.path)


def begin(job: Job, shard: Shard = WHOLE, *, anew: bool = False) -> None:
    """Make the folder of a study, and note what its results are made from.

    **Arguments:**

    - `job`: the study.
    - `shard`: part of it that is computed.
    - `anew`: whether what was computed before is removed: chunks of this shard, and those that
        belong to the study no more. Other shards may be at work beside it.

    **Raises:**

    - `OSError` if the folder cannot be written to.
    """
    chunks = job.folder / _CHUNKS
    chunks.mkdir(parents=True, exist_ok=True)
    if anew:
        others = {job.file(chunk) for chunk in job.chunks} - {
            job.file(chunk) for chunk in _chunks_of_shard(job, shard)
        }
        for path in set(chunks.glob("*.nc")) - others:
            path.unlink(missing_ok=True)
    file = job.folder / _ORIGIN
    origin = {"made_from": as_json(origin_of(job.study)), "designs": len(job.table.rows)}
    if anew or not file.exists() or not list(chunks.glob("*.nc")):
        write_json(origin, file)


def status(path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None) -> Status:
    """How far a study is.

    **Arguments:**

    - `path`, `folder`: as of `run`.

    **Raises:**

    - `SceneError` as of `run`.
    """
    return status_of(job_of(path, folder))


def status_of(job: Job) -> Status:
    """How far a study is."""
    missing = job.missing
    every, lacking = (sum(len(chunk.designs) for chunk in x) for x in (job.chunks, missing))
    return Status(len(job.chunks), every, len(job.chunks) - len(missing), every - lacking)


def own_chunks(job: Job, shard: Shard) -> tuple[Chunk, ...]:
    """The chunks of a shard that have no results yet."""
    return tuple(chunk for chunk in _chunks_of_shard(job, shard) if not job.file(chunk).exists())


def _chunks_of_shard(job: Job, shard: Shard) -> tuple[Chunk, ...]:
    require(
        0 <= shard.index < shard.count,
        "a shard i/n is one of n, counted from 0, got {index}/{count}. The last is {last}/{count}.",
        index=shard.index,
        count=shard.count,
        last=shard.count - 1,
    )
    return job.chunks[shard.index :: shard.count]


def compute(
    job: Job, evaluate: Evaluator, chunks: tuple[Chunk, ...], done: Callable[[int], None]
) -> int:
    """Compute chunks one after the other, and write each as soon as it is known.

    **Arguments:**

    - `job`: the study.
    - `evaluate`: for its designs.
    - `chunks`: of it.
    - `done`: told how many more designs are done.

    **Returns:**

    How many chunks were computed: not those that somebody else has written meanwhile.

    **Raises:**

    - `OSError` if a chunk cannot be written.
    """
    require_float64()
    computed = 0
    for chunk in chunks:
        file = job.file(chunk)
        if not file.exists():
            write_dataset(chunk_dataset(job.study, chunk, evaluate(chunk.designs)), file)
            computed += 1
        done(len(chunk.designs))
    return computed


def remote_shard(path: str, folder: str, index: int, count: int) -> int:
    """Compute a shard in a process of its own: nothing but these texts and numbers is sent to it.

    **Arguments:**

    - `path`: of the study file, as this process sees it.
    - `folder`: of its results.
    - `index`, `count`: of the shard.

    **Returns:**

    How many chunks were computed.
    """
    import threadpoolctl

    set_up()
    with threadpoolctl.threadpool_limits(1):
        origin = (Path(folder) / _ORIGIN).read_bytes()
        job, evaluate = _known(path, folder, origin)
        return compute(job, evaluate, own_chunks(job, Shard(index, count)), lambda count: None)


@functools.lru_cache(maxsize=1)
def _known(path: str, folder: str, origin: bytes) -> tuple[Job, Evaluator]:
    """What a process keeps for the shards of one study that it is given one after the other."""
    del origin
    job = job_of(path, folder)
    return job, Evaluator(job.study, job.table)
