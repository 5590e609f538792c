"""How bad a note is: notes are listed one below the other, the worst first."""

from collections.abc import Iterable


class Doubtful(str):
    """A note by which results may be wrong."""

    __slots__ = ()


class Idle(str):
    """A note on what does nothing."""

    __slots__ = ()


def worst_first(notes: Iterable[str]) -> list[str]:
    """Notes by which results may be wrong, then what else limits them, then what does nothing."""
    return sorted(dict.fromkeys(notes), key=_rank)


def _rank(note: str) -> int:
    return 0 if isinstance(note, Doubtful) else 2 if isinstance(note, Idle) else 1
