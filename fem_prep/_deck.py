"""A deck as text: its lines, numbers and nodes, whoever wrote it."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ._checks import BodyError, require


@dataclass(frozen=True)
class Deck:
    """What a file holds, in its own unit of length.

    **Fields:**

    - `nodes`: coordinates, shape `[node, 3]`, in the file's unit.
    - `bricks`: nodes of every 20-node brick in VTK's order, shape `[brick, 20]`.
    - `sets`: named sets: indices of nodes.
    - `others`: how many solid elements there are that are no 20-node bricks, by the file's name.
    """

    nodes: np.ndarray
    bricks: np.ndarray
    sets: Mapping[str, np.ndarray]
    others: Mapping[str, int]


def deck_of(
    nodes: Mapping[int, Sequence[float]],
    bricks: Sequence[Sequence[int]],
    sets: Mapping[str, Sequence[int]],
    others: Mapping[str, int],
) -> Deck:
    """Labels of nodes to indices. Sets may name nodes that are not there, as ranges often do."""
    labels = {label: index for index, label in enumerate(nodes)}
    lost = next((label for brick in bricks for label in brick if label not in labels), None)
    require(
        lost is None,
        "A brick uses node {lost}, which the file does not define. The file is cut short, or "
        "the nodes are in another file: write all into one.",
        lost=lost,
    )
    return Deck(
        np.array(list(nodes.values()), dtype=float).reshape(-1, 3),
        np.array([[labels[label] for label in brick] for brick in bricks], int).reshape(-1, 20),
        {
            name: np.array([labels[label] for label in members if label in labels], dtype=int)
            for name, members in sets.items()
        },
        dict(others),
    )


def deck_lines(
    path: Path, included: Callable[[str], str | None], above: tuple[Path, ...] = ()
) -> Iterator[tuple[str, str]]:
    """Lines of a file and of those that it includes, each with where it is."""
    for number, line in enumerate(deck_text(path, above).splitlines(), start=1):
        other = included(line)
        if other is None:
            yield f"{path.name}, line {number}", line.rstrip()
        else:
            yield from deck_lines(path.parent / other, included, (*above, path))


def deck_text(path: Path, above: tuple[Path, ...]) -> str:
    """Content of a file that is included by those above it."""
    # One file may have many names: `ring.inp` and `../grids/ring.inp`.
    real = path.resolve()
    require(all(real != other.resolve() for other in above), "'{path}' includes itself.", path=path)
    require(
        not real.exists() or real.is_file(),
        "'{path}' is no file, but a folder or a device. Name the deck.",
        path=path,
    )
    try:
        # Comments may be in any encoding; what matters is ASCII.
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise BodyError(f"'{path}' cannot be read: {error.strerror}.") from error


def numbers_of(place: str, words: Sequence[str], kind: Callable) -> list:
    """Words as numbers, or an error that says where they are."""
    try:
        return [kind(word) for word in words]
    except ValueError as error:
        raise BodyError(f"{place}: a number is expected, got {error.args[0]!r}.") from error


def real_number(word: str) -> float:
    """A real number as FORTRAN writes it: `1.5`, `1.5D-3`, `1.5-3`; blank is zero."""
    if not word:
        return 0.0
    try:
        return float(word)
    except ValueError:
        plain = re.sub(r"(?<=[\d.])([+-])", r"e\1", re.sub("[dDeE]", "", word))
        try:
            return float(plain)
        except ValueError:
            raise ValueError(word) from None


def whole_number(word: str) -> int:
    """A word as an integer; the error names the word."""
    try:
        return int(word)
    except ValueError:
        raise ValueError(word) from None


def take_node(nodes: dict[int, list[float]], place: str, first: str, rest: Sequence[str]) -> int:
    """Note a node's place; its label is returned."""
    label = numbers_of(place, [first], whole_number)[0]
    point = numbers_of(place, [*rest, "", "", ""][:3], real_number)
    require(
        nodes.get(label, point) == point,
        "{place}: node {label} is defined twice, at different places. Write one body into one "
        "file.",
        place=place,
        label=label,
    )
    nodes[label] = point
    return label
