"""What a study costs beside its arithmetic, and what a second worker is worth.

    python benchmarks/bench_studies.py                 4,096 designs, gradients by 6 keys
    python benchmarks/bench_studies.py --workers 2     wall time of one and of two processes

Arithmetic is the vmapped kernel of a chunk, and the same one design after the other, which is what
a study calls: of the first `--alone` designs, as if all took as long. Processor seconds after
compiling; wall times need two free cores. Of workers the processor seconds of all processes are
told too: what two use beyond one is what starting one costs. One worker has all cores, of which XLA
uses what it can; hence one that is bound to a single core as well, which is what two of them are
to double.
A second run finds its programs compiled.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

import jaxgear as jg
from jaxgear._cli import _designs as command
from jaxgear._cli._folder import Folder
from jaxgear.designs._evaluate import Evaluator, moved_keys
from jaxgear.designs._together import programs_of
from jaxgear.designs._work import begin, compute, job_of
from jaxgear.study._built import BuiltScene

_STUDY = """schema = 1
scene = "accessory"
{changes}[design]
points = {points}
[design.between]
"flank.pinion.tip_relief.depth_um" = [5.0, 20.0]
"flank.wheel.tip_relief.depth_um" = [5.0, 20.0]
"flank.pinion.tip_relief.extent" = [0.2, 0.4]
"flank.pinion.crowning_um" = [0.0, 5.0]
"pair.misalignment_inclination_um" = [-10.0, 10.0]
"pair.torque_pinion_Nm" = [60.0, 100.0]
[keep]
numbers = ["static.te_rms_um", "static.max_pressure_MPa"]
gradients = true
[work]
chunk = {chunk}
workers = {workers}
"""


def _arithmetic(study: jg.designs.Study, rows: np.ndarray, batched: bool) -> float:
    """Processor seconds of the kernel alone a design, a chunk after the other, after compiling."""
    keys = moved_keys(study, tuple(_keys(study)))
    built = BuiltScene(study.scene)
    call = programs_of(study, built, keys, built.grid, batched=batched)[0]
    size, counts = study.chunk, np.ones(study.chunk, dtype=bool)
    parts = [rows[at : at + size] for at in range(0, len(rows), size)]
    jax.block_until_ready(call(parts[0], counts))
    start = time.process_time()
    for part in parts:
        jax.block_until_ready(call(part, counts))
    return (time.process_time() - start) / len(rows)


def _of_command(file: Path, cores: int | None) -> str:
    """Wall and processor time of `jaxgear study`, caches warm, on so many cores or all of them."""
    bound = None if cores is None else lambda: os.sched_setaffinity(0, range(cores))
    with tempfile.TemporaryDirectory() as folder:
        command_line = ["-m", "jaxgear", "study", str(file), "--out", folder]
        start, used = time.perf_counter(), _used()
        options = ["--no-pictures", "--quiet"]
        subprocess.run([sys.executable, *command_line, *options], check=True, preexec_fn=bound)
        wall, used = time.perf_counter() - start, _used() - used
    return f"{wall:.1f} s of the wall, {used:.1f} processor s"


def _used() -> float:
    """Processor seconds of this process, and of those that it has waited for."""
    return sum(os.times()[:4])


def _keys(study: jg.designs.Study) -> list[str]:
    return [key.removeprefix("design.between.") for key in study.values if ".between." in key]


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=4096)
    parser.add_argument("--chunk", type=int, default=256)
    parser.add_argument("--alone", type=int, default=512)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], dest="changes")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    jg.cache_compilations()
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "study.toml"

        def written(workers: int) -> Path:
            changes = f"set = {asked.changes}\n" if asked.changes else ""
            known = {"points": asked.points, "chunk": asked.chunk, "workers": workers}
            file.write_text(_STUDY.format(changes=changes, **known), encoding="utf-8")
            return file

        if asked.workers > 1:
            for workers, cores in ((1, 1), (1, None), (asked.workers, None)):
                on = "all cores" if cores is None else "one core"
                print(f"{workers} workers, {on}: {_of_command(written(workers), cores)}")
            return
        job = job_of(written(1), Path(name) / "results")
        evaluate = Evaluator(job.study, job.table)
        evaluate(job.chunks[0].designs)
        start = time.process_time()
        begin(job)
        compute(job, evaluate, job.chunks, lambda count: None)
        whole = time.process_time() - start
        command.write_results(jg.designs.collect(file, job.folder), Folder(job.folder, False))
        table = time.process_time() - start - whole
        rows = np.asarray(job.table.rows, dtype=float)
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        print(f"study {whole:.2f} s, its table {table:.2f} s, {len(rows)} designs, {most:.0f} MB")
        for label, batched in (("one after the other", False), ("vmapped", True)):
            alone = len(rows) * _arithmetic(job.study, rows[: asked.alone], batched)
            ratio = (whole + table) / alone
            print(f"arithmetic {label}: {alone:.2f} s; study with table {ratio:.2f} x")


if __name__ == "__main__":
    main()
