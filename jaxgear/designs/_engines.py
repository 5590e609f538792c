"""Who computes the shards of a study: this process, others, a Dask scheduler, a SLURM cluster.

All are executors as of `concurrent.futures`, given a path and a shard number. Workers share the
caches of compiled programs and of condensed bodies, as far as they share `$JAXGEAR_CACHE`.
"""

import contextlib
import multiprocessing
from collections.abc import Callable, Generator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from jaxgear._checks import InputError
from jaxgear.designs._asked import Study
from jaxgear.designs._keys import SlurmKeys, WorkKeys
from jaxgear.designs._work import Job, Shard, own_chunks, remote_shard


class WorkerLost(RuntimeError):
    """Workers died, and again after others had been started; finished chunks are kept."""


def distributed(job: Job, shard: Shard, done: Callable[[int], None]) -> None:
    """Let an engine compute what is missing of a shard.

    A worker that dies takes its chunk with it, which others then compute.

    **Arguments:**

    - `job`: the study.
    - `shard`: of it.
    - `done`: told how many more designs are done.

    **Raises:**

    - `WorkerLost` if workers die and nothing is finished any more.
    - `InputError` if the engine is not installed, or does not answer.
    """
    work = job.study.asked.work
    while chunks := own_chunks(job, shard):
        # A shard for each chunk; of jobs that wait in a queue fewer, of many chunks each.
        if work.engine == "slurm":
            shards = [Shard(i, work.slurm.jobs) for i in range(work.slurm.jobs)]
        else:
            shards = [Shard(job.chunks.index(chunk), len(job.chunks)) for chunk in chunks]
        lost = _round(job, shards, done)
        left = own_chunks(job, shard)
        if lost and len(left) == len(chunks):
            raise WorkerLost(
                f"workers died ({lost}) and no chunk was finished: {len(left)} are missing, "
                f"{left[0].name} with design {left[0].designs[0]} first. Out of memory they are "
                "killed without a word: take fewer work.workers, or a smaller work.chunk. What is "
                "finished is kept: the same command goes on."
            )


def _round(job: Job, shards: list[Shard], done: Callable[[int], None]) -> str:
    """Give all shards to an engine once; why a worker was lost, or nothing."""
    lost = ""
    path, folder = str(job.study.path.resolve()), str(job.folder.resolve())
    with _executor(job.study, folder) as executor:
        before = [own_chunks(job, shard) for shard in shards]
        futures = [executor.submit(remote_shard, path, folder, *shard) for shard in shards]
        for shard, chunks, future in zip(shards, before, futures, strict=True):
            try:
                future.result()
            except Exception as error:
                if not _is_loss(error):
                    for each in futures:
                        with contextlib.suppress(Exception):
                            each.cancel()
                    raise
                lost = " ".join(str(error).split())[:200] or type(error).__name__
            left = own_chunks(job, shard)
            done(sum(len(chunk.designs) for chunk in chunks if chunk not in left))
    return lost


def _is_loss(error: Exception) -> bool:
    """Whether a worker was lost, whatever it did: by the names that engines have for it."""
    names = {each.__name__ for each in type(error).__mro__}
    return isinstance(error, BrokenProcessPool) or bool(
        names & {"KilledWorker", "UncompletedJobError"}
    )


def _executor(study: Study, folder: str) -> contextlib.AbstractContextManager[Any]:
    work = study.asked.work
    match work.engine:
        case "dask":
            return _dask(work, study.where("work.scheduler"))
        case "slurm":
            return _slurm(work.slurm, folder)
        case _:
            # A process that JAX runs in must not be forked: its threads would be gone.
            context = multiprocessing.get_context("spawn")
            return ProcessPoolExecutor(work.workers, mp_context=context)


@contextlib.contextmanager
def _dask(work: WorkKeys, where: str) -> Generator[Executor]:
    """The workers of a Dask scheduler that somebody has started."""
    try:
        from distributed import Client
    except ImportError:
        raise _not_installed("dask", "distributed") from None
    try:
        client = Client(work.scheduler, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{where}: work.scheduler: no Dask scheduler answers at {work.scheduler}: {error}. "
            "Start one: dask scheduler; and workers: dask worker ADDRESS."
        ) from None
    with client, client.get_executor(pure=False, retries=2) as executor:
        yield executor


@contextlib.contextmanager
def _slurm(work: SlurmKeys, folder: str) -> Generator[Any]:
    """Jobs of a SLURM cluster, or processes of this machine that submitit starts alike."""
    try:
        import submitit
    except ImportError:
        raise _not_installed("slurm", "submitit") from None
    executor = submitit.AutoExecutor(folder=f"{folder}/jobs", cluster=work.cluster)
    executor.update_parameters(
        name="jaxgear",
        timeout_min=work.time_min,
        mem_gb=work.memory_GB,
        cpus_per_task=work.cpus,
        **({} if work.partition is None else {"slurm_partition": work.partition}),
    )
    yield executor


def _not_installed(engine: str, package: str) -> InputError:
    return InputError(
        f'work.engine = "{engine}" needs {package}, which is not installed. Run '
        f"pip install 'jaxgear[{engine}]', or write engine = \"processes\"."
    )
