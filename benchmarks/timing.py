"""What the benchmarks share: times, memory, and a row to print."""

import argparse
import json
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


def one_thread() -> None:
    """Keep BLAS to one thread: several wait for each other. Call it before NumPy is imported."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def begin(out: Path) -> None:
    """Make the folder of the results, and set JAX up."""
    one_thread()
    import jax

    jax.config.update("jax_enable_x64", True)
    out.mkdir(parents=True, exist_ok=True)


def in_parts(
    about: str, quickly: str, file: str, parts: Mapping[str, Callable[..., dict[str, Any]]]
) -> None:
    """Run those of some parts that the command line asks for, and keep what they report.

    **Arguments:**

    - `about`: what the benchmark is for.
    - `quickly`: what `--quick` leaves out.
    - `file`: of the reports, in the folder of the results.
    - `parts`: by name; each takes `quick`.
    """
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(parts)}; all without")
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    parser.add_argument("--quick", action="store_true", help=quickly)
    options = parser.parse_args()
    begin(options.out)
    path = options.out / file
    report: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    for name in options.parts or parts:
        print(f"\n{name}", flush=True)
        report[name] = parts[name](quick=options.quick) | {"peak_memory_MB": peak()}
        print(f"{'peak memory so far':<52} {peak():10.0f} MB", flush=True)
        path.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(f"\nwritten to {options.out}")


def timed(
    function: Callable, *arguments, repeats: int = 15, enough: float = float("inf")
) -> tuple[float, float, Any]:
    """Seconds to compile, median seconds to run, and the result; after `enough` s the last run."""
    import jax

    start = time.perf_counter()
    compiled = jax.jit(function).lower(*arguments).compile()
    compiling = time.perf_counter() - start
    result = jax.block_until_ready(compiled(*arguments))
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(compiled(*arguments))
        seconds.append(time.perf_counter() - start)
        if sum(seconds) > enough:
            break
    return compiling, statistics.median(seconds), result


def line(name: str, compiling: float, seconds: float, note: str = "") -> None:
    """Print one row."""
    print(f"{name:<58} {1e3 * seconds:8.2f} ms   compile {compiling:5.1f} s   {note}", flush=True)


def peak() -> float:
    """Largest memory of this process so far [MB]."""
    kilobytes = 1024.0 if sys.platform == "darwin" else 1.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / kilobytes / 1024.0
