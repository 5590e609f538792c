"""Processor seconds of a test: a fast one that takes too many fails, whatever it asserts.

Not seconds on the clock, which a busy machine stretches; and on one that stretches those of the
processor too the limit is stretched as much. What JAX compiles does not count: the next
run has it from the cache. Nor does what a fixture makes for several tests. The same test takes
up to half as much again from run to run, by what else the machine's memory serves: a test fails
that is beyond the limit by more than that.
"""

import os
import time
from collections.abc import Generator

import jax.monitoring
import pytest

_LIMIT = "fast_test_processor_s"
_FREE = ("slow", "end_to_end")
_COMPILING = "/jax/core/compile/backend_compile_duration"
_compiled_s = [0.0]


def _note(event: str, duration_secs: float, **facts: str | int) -> None:
    del facts
    if event == _COMPILING:
        _compiled_s[0] += duration_secs


jax.monitoring.register_event_duration_secs_listener(_note)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addini(_LIMIT, "Processor seconds that a test may take that is not slow.", default="5")


# How much longer a test may take than the limit before it is surely too slow.
_SCATTER = 1.5

# Processor seconds of the loop below, alone on a core of a machine on which all tests are fast.
_ALONE = 0.095


def _slowness() -> float:
    """How much longer work takes just now than on a core of its own: two threads may share one."""
    start, total = time.process_time(), 0
    for i in range(2_000_000):
        total += i * i
    return max(1.0, (time.process_time() - start) / _ALONE)


def _spent() -> float:
    """Processor seconds of this process and of those that it has waited for [s]."""
    return sum(os.times()[:4])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Fail a test that takes too long, where it has not failed already."""
    spent, compiled = _spent(), _compiled_s[0]
    result = yield
    # Compiling is told in seconds on the clock, at least those of the processor: the error is to
    # the safe side.
    taken = _spent() - spent - (_compiled_s[0] - compiled)
    limit = float(item.config.getini(_LIMIT))
    free = any(item.get_closest_marker(mark) for mark in _FREE)
    if taken > _SCATTER * limit and not free and taken > _SCATTER * limit * _slowness():
        pytest.fail(
            f"A fast test must take at most {limit:g} s of the processor beside compiling, got "
            f"{taken:.1f} s. Make it cheaper, share what it makes in a fixture, or mark it `slow`.",
            pytrace=False,
        )
    return result
