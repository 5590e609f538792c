"""What the benchmarks share: times, memory, and a row to print."""

import resource
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any


def timed(function: Callable, *arguments, repeats: int = 15) -> tuple[float, float, Any]:
    """Seconds to compile, median seconds to run, and the result."""
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
    return compiling, statistics.median(seconds), result


def line(name: str, compiling: float, seconds: float, note: str = "") -> None:
    """Print one row."""
    print(f"{name:<58} {1e3 * seconds:8.2f} ms   compile {compiling:5.1f} s   {note}", flush=True)


def peak() -> float:
    """Largest memory of this process so far [MB]."""
    kilobytes = 1024.0 if sys.platform == "darwin" else 1.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / kilobytes / 1024.0
