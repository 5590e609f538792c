"""A study, from its file to its results: what is missing is computed, then all is collected."""

import os

from jaxgear.designs._collect import Collected, collected
from jaxgear.designs._engines import distributed
from jaxgear.designs._evaluate import Evaluator
from jaxgear.designs._work import WHOLE, Shard, begin, compute, job_of, own_chunks
from jaxgear.study._progress import progress


def run(
    path: str | os.PathLike[str],
    folder: str | os.PathLike[str] | None = None,
    *,
    shard: Shard = WHOLE,
    anew: bool = False,
) -> Collected:
    """Compute what is missing of a study, by the engine that it names, and collect what is there.

    Interrupted or killed, it goes on where it was when it is called again. In a script of your own
    that asks for several `work.workers` call it below `if __name__ == "__main__":`.

    **Arguments:**

    - `path`: the study file (TOML).
    - `folder`: of the results; `results/NAME` without it.
    - `shard`: part of it.
    - `anew`: whether what was computed before of the shard is removed first.

    **Returns:**

    All results that are there, those of other shards too.

    **Raises:**

    - `SceneError` with what is wrong in the study or its scene, or has changed since it began.
    - `InputError` if an engine or a file of designs is not there.
    - `WorkerLost` if workers die over and over.
    - `OSError` if results cannot be written.
    """
    job = job_of(path, folder, anew=anew)
    begin(job, shard, anew=anew)
    chunks = own_chunks(job, shard)
    count = sum(len(chunk.designs) for chunk in chunks)
    work = job.study.asked.work
    with progress(count, "designs") as done:
        if work.engine == "processes" and work.workers == 1:
            compute(job, Evaluator(job.study, job.table), chunks, done)
        else:
            distributed(job, shard, done)
    return collected(job)
