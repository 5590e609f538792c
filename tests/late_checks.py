"""Beartype's checks of a function, made when it is first called.

The packages have some two thousand functions, each with two checks, of which one process calls a
part: to make all of them took a third of the time in which pytest finds the tests.
"""

from collections.abc import Callable
from typing import Any

import beartype


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that checks its arguments and what it returns as annotated."""
    made: list[Callable[..., Any]] = []

    def late(*args: Any, **kwargs: Any) -> Any:
        if not made:
            made.append(beartype.beartype(function))
        return made[0](*args, **kwargs)

    return late
