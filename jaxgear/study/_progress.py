"""What a study says while it works: to whom it may concern, or to nobody.

A study draws no bars and prints nothing. Whoever shows progress, such as the command line, installs
a `Listener` for a while.
"""

from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Protocol, runtime_checkable


@runtime_checkable
class Listener(Protocol):
    """Shows progress: as bars where the amount of work is known, else as lines."""

    def bar(
        self, total: int, what: str
    ) -> AbstractContextManager[tuple[Callable[[int], None], Callable[[str], None]]]:
        """A bar: functions that are told how many more are done, and what is being done."""
        ...

    def line(self, what: str) -> AbstractContextManager[Callable[[str], None]]:
        """A line: a function that is told what is being done."""
        ...


_LISTENER: ContextVar[Listener | None] = ContextVar("_LISTENER", default=None)
# What shows the step that is under way: the innermost bar or line.
_SHOWN: ContextVar[Callable[[str], None] | None] = ContextVar("_SHOWN", default=None)


@contextmanager
def listened_by(listener: Listener) -> Generator[None]:
    """Show there what is said inside."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


@contextmanager
def progress(total: int, what: str) -> Generator[Callable[[int], None]]:
    """Work of a known amount; the value is told how many more are done."""
    listener = _LISTENER.get()
    if listener is None:
        yield lambda count: None
        return
    with listener.bar(total, what) as (done, tell), _spoken_by(tell):
        yield done


@contextmanager
def narration(what: str) -> Generator[Callable[[str], None]]:
    """Work of an unknown amount; the value is told what is being done."""
    listener = _LISTENER.get()
    if listener is None:
        yield lambda step: None
        return
    with listener.line(what) as tell, _spoken_by(tell):
        yield tell


@contextmanager
def _spoken_by(show: Callable[[str], None]) -> Generator[None]:
    """Let `say` show steps there for a while."""
    token = _SHOWN.set(show)
    try:
        yield
    finally:
        _SHOWN.reset(token)


def say(step: str) -> None:
    """Say what is being done in a word or two, beside the bar or in the line that is shown."""
    show = _SHOWN.get()
    if show is not None:
        show(step)
