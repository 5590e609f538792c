"""Programs that are run for a study: compiled once, and timed by a stopwatch that all share."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import jax

from jaxgear._kept_programs import (
    USUALLY,
    Options,
    Program,
    is_named,
    kinds_of,
    leaves_of,
    program_of,
)
from jaxgear.study._progress import say


class Stopwatch:
    """Seconds spent compiling and running, kept apart."""

    def __init__(self):
        self.compile_s = 0.0
        self.run_s = 0.0
        self._programs: dict[Any, Program] = {}
        self._seen: set[Any] = set()

    def __call__(
        self, function: Callable[..., Any], *arguments: Any, options: Options = USUALLY
    ) -> Any:
        """Compile `function` for these arguments, run it, and wait for the result."""
        start = time.perf_counter()
        leaves, structure = leaves_of(*arguments)
        key = function, structure, kinds_of(leaves), options
        if is_new := key not in self._seen:
            self._seen.add(key)
            say("tracing and compiling")
        if is_named(function):
            program = program_of(*key)
        elif key in self._programs:
            program = self._programs[key]
        else:
            program = self._programs[key] = program_of(*key)
        middle = time.perf_counter()
        if is_new:
            say("computing")
        result = jax.block_until_ready(program(*leaves))
        self.compile_s += middle - start
        self.run_s += time.perf_counter() - middle
        return result


_WATCH: ContextVar[Stopwatch | None] = ContextVar("_WATCH", default=None)


@contextmanager
def stopwatch() -> Iterator[Stopwatch]:
    """A stopwatch for all that is run inside; the one around it is told of the seconds at the end.

    Programs of functions without a name of their own are kept as long as it lives.
    """
    outer, inner = _WATCH.get(), Stopwatch()
    token = _WATCH.set(inner)
    try:
        yield inner
    finally:
        _WATCH.reset(token)
        if outer is not None:
            outer.compile_s += inner.compile_s
            outer.run_s += inner.run_s


def timed(function: Callable[..., Any], *arguments: Any, options: Options = USUALLY) -> Any:
    """Run a function of arrays and modules as one compiled program, and wait for its result.

    Its time is kept where a stopwatch runs.
    """
    return (_WATCH.get() or Stopwatch())(function, *arguments, options=options)


def seconds() -> tuple[float, float]:
    """Seconds spent compiling and running since the stopwatch that runs was started."""
    watch = _WATCH.get() or Stopwatch()
    return watch.compile_s, watch.run_s
