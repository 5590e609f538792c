"""Which programs JAX makes, for tests that count them."""

import contextlib
from collections.abc import Generator

import jax.monitoring

_EVENT = "/jax/core/compile/backend_compile_duration"
_MADE: list[str] = []


def _note(event: str, duration_secs: float, **facts: str | int) -> None:
    del duration_secs
    if event == _EVENT:
        _MADE.append(str(facts.get("fun_name")))


jax.monitoring.register_event_duration_secs_listener(_note)


@contextlib.contextmanager
def made_programs() -> Generator[list[str]]:
    """Names of the programs that are made in the block, from the cache or anew."""
    before, found = len(_MADE), []
    yield found
    found.extend(_MADE[before:])
