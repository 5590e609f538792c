"""Programs that are run for a study: compiled once, and timed by a stopwatch that all share.

What a whole study costs a clock tells, to which JAX says when it compiles.
"""

import functools
import time
from collections.abc import Callable, Generator
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


class Clock:
    """Seconds since it was made, and those of them in which JAX compiled, in whatever thread."""

    def __init__(self):
        self._start = time.perf_counter()
        self._spans: list[tuple[float, float]] = []

    def note(self, duration: float) -> None:
        """JAX has just traced, lowered or compiled, or read a compiled program, for so long [s]."""
        now = time.perf_counter()
        self._spans.append((now - duration, now))

    def hear(self, inner: "Clock") -> None:
        """What a clock within this one has noted."""
        self._spans += inner._spans

    def read(self) -> tuple[float, float]:
        """Seconds of compiling, and all others."""
        compiling, reached = 0.0, self._start
        # Functions are traced within others, and threads compile side by side.
        for begin, end in sorted(self._spans):
            compiling += max(0.0, end - max(begin, reached))
            reached = max(reached, end)
        return compiling, time.perf_counter() - self._start - compiling


_CLOCK: ContextVar[Clock | None] = ContextVar("_CLOCK", default=None)


def _noted(event: str, duration_secs: float, **_: str | int) -> None:
    spent = _CLOCK.get()
    if spent is not None and event.startswith("/jax/core/compile/"):
        spent.note(duration_secs)


@functools.cache
def _listen() -> None:
    """JAX keeps its listeners: one is enough."""
    jax.monitoring.register_event_duration_secs_listener(_noted)


@contextmanager
def clock() -> Generator[Clock]:
    """A clock of all that is done inside, also in threads that are given this context.

    The one around it, if there is one, hears of it at the end.
    """
    _listen()
    outer, made = _CLOCK.get(), Clock()
    token = _CLOCK.set(made)
    try:
        yield made
    finally:
        _CLOCK.reset(token)
        if outer is not None:
            outer.hear(made)


_WATCH: ContextVar[Stopwatch | None] = ContextVar("_WATCH", default=None)


@contextmanager
def stopwatch() -> Generator[Stopwatch]:
    """A stopwatch for all that is run inside, and not by a stopwatch within it.

    Programs of functions without a name of their own are kept as long as it lives.
    """
    made = Stopwatch()
    token = _WATCH.set(made)
    try:
        yield made
    finally:
        _WATCH.reset(token)


def timed(function: Callable[..., Any], *arguments: Any, options: Options = USUALLY) -> Any:
    """Run a function of arrays and modules as one compiled program, and wait for its result.

    Its time is kept where a stopwatch runs.
    """
    return (_WATCH.get() or Stopwatch())(function, *arguments, options=options)


def seconds() -> tuple[float, float]:
    """Seconds spent compiling and running since the stopwatch that runs was started."""
    watch = _WATCH.get() or Stopwatch()
    return watch.compile_s, watch.run_s
