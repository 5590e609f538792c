"""Grids in text decks: the nodes, bricks and sets of nodes of Abaqus and Nastran files.

meshio reads these formats too, but drops what it does not know without a word (a second *NODE
block, elements behind a comment, nested sets, CHEXA* in wide fields, continuation lines without
a mark, coordinate systems, every SET) and stops at what does not matter here (a spring, a
shell, a missing BEGIN BULK).
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ._checks import require
from ._deck import (
    Deck,
    deck_lines,
    deck_of,
    deck_text,
    numbers_of,
    real_number,
    take_node,
    whole_number,
)
from ._nastran_deck import nastran_include


def files_of(path: Path) -> list[Path]:
    """A grid's file and, if it is a deck, those that it includes.

    **Arguments:**

    - `path`: of a file of any kind.

    **Returns:**

    Paths in the order of reading; the first one is the file itself.

    **Raises:**

    - `BodyError` if one cannot be read, or includes itself.
    """
    included = _INCLUDED.get(path.suffix.lower())
    return [path] if included is None else list(_files(path, included))


def _files(
    path: Path, included: Callable[[str], str | None], above: tuple[Path, ...] = ()
) -> Iterator[Path]:
    """A file and those that it includes."""
    yield path
    for line in deck_text(path, above).splitlines():
        other = included(line)
        if other is not None:
            yield from _files(path.parent / other, included, (*above, path))


# The part of an Abaqus file in which a node or a set is; none for the assembly's own nodes.
_Scope = str | None

# Of a set: the label of a node, several of them, or the name of another set.
_Member = int | range | str


@dataclass(frozen=True)
class _Keyword:
    """A keyword of an Abaqus file with its parameters and the lines that follow it."""

    place: str
    name: str
    parameters: dict[str, str]
    rows: list[str] = field(default_factory=list)

    @property
    def words(self) -> list[str]:
        """Everything that stands between commas."""
        return [word.strip() for row in self.rows for word in row.split(",") if word.strip()]


@dataclass(frozen=True)
class _Abaqus:
    """What was read so far, by scope."""

    nodes: dict[_Scope, dict[int, list[float]]] = field(default_factory=dict)
    bricks: dict[_Scope, list[list[int]]] = field(default_factory=dict)
    others: Counter = field(default_factory=Counter)
    names: dict[str, str] = field(default_factory=dict)
    sets: dict[tuple[_Scope, str], list[_Member]] = field(default_factory=dict)
    parts: dict[str, str] = field(default_factory=dict)
    of_parts: set[tuple[_Scope, str]] = field(default_factory=set)


def read_abaqus(path: Path) -> Deck:
    """Nodes, bricks and sets of an Abaqus or CalculiX input file.

    Bricks are C3D20 and its variants, and the first 20 nodes of C3D27. Sets are those of *NSET,
    nested ones too, and of *NODE, NSET=. Nodes may be in one part or in none.
    """
    read = _Abaqus()
    scopes: list[tuple[str, _Scope]] = [("", "")]
    for keyword in _keywords(path):
        scope = scopes[-1][1]
        match keyword.name:
            case "PART" | "ASSEMBLY" | "INSTANCE":
                scopes.append((keyword.name, _opened(read, keyword)))
            case "END PART" | "END ASSEMBLY" | "END INSTANCE":
                del scopes[max(1, len(scopes) - 1) :]
            case "NODE":
                _take_nodes(read, scope, keyword)
            case "ELEMENT":
                _take_elements(read, scope, keyword)
            case "NSET":
                _take_set(read, scope, keyword)
            case "SYSTEM":
                require(
                    not keyword.words,
                    "{place}: *SYSTEM moves the nodes. Write them in the global system.",
                    place=keyword.place,
                )
    scope = _meshed(read)
    return deck_of(
        read.nodes.get(scope, {}),
        read.bricks.get(scope, []),
        {
            read.names[name]: _members(read, scope, name, ())
            for where, name in read.sets
            if where == scope
        },
        read.others,
    )


def _abaqus_include(line: str) -> str | None:
    if not line.startswith("*"):
        return None
    found = re.match(r"\*\s*INCLUDE\s*,\s*INPUT\s*=\s*(.+)", line, re.IGNORECASE)
    return found[1].strip().strip("\"'") if found else None


def _keywords(path: Path) -> Iterator[_Keyword]:
    current: _Keyword | None = None
    head = ""
    for place, line in deck_lines(path, _abaqus_include):
        if line.startswith("**") or not line.strip():
            continue
        # A line of parameters that ends with a comma goes on in the next one.
        if head or line.startswith("*"):
            head += line.strip()
            if head.endswith(","):
                continue
            if current:
                yield current
            name, *parameters = [part.strip() for part in head[1:].split(",")]
            pairs = [part.partition("=") for part in parameters]
            values = {key.strip().upper(): value.strip(" \"'") for key, _, value in pairs}
            current, head = _Keyword(place, " ".join(name.upper().split()), values), ""
            if current.name in ("NODE", "ELEMENT", "NSET"):
                require(
                    "INPUT" not in values,
                    "{place}: *{name} takes its data from another file, '{file}'. Write all "
                    "into one file.",
                    place=place,
                    name=current.name,
                    file=values.get("INPUT"),
                )
        elif current:
            current.rows.append(line)
    if current:
        yield current


def _opened(read: _Abaqus, keyword: _Keyword) -> _Scope:
    """Scope of a part, an instance or the assembly."""
    if keyword.name == "ASSEMBLY":
        read.of_parts.update(read.sets)
        return None
    name = keyword.parameters.get("NAME", "").upper()
    if keyword.name == "PART":
        return name
    part = keyword.parameters.get("PART", name).upper()
    require(
        not any(numbers_of(keyword.place, keyword.words, real_number)),
        "{place}: the instance '{name}' is moved or turned in the assembly. Write a file without "
        "parts and assemblies (Abaqus/CAE: Model, Edit Attributes, Do not use parts and "
        "assemblies in input files).",
        place=keyword.place,
        name=keyword.parameters.get("NAME"),
    )
    require(
        part not in read.parts.values(),
        "{place}: the part '{part}' is used twice in the assembly. A gear body is one part.",
        place=keyword.place,
        part=part,
    )
    read.parts[name] = part
    return part


def _take_nodes(read: _Abaqus, scope: _Scope, keyword: _Keyword) -> None:
    require(
        keyword.parameters.get("SYSTEM", "R").upper() == "R",
        "{place}: nodes in cylindrical or spherical coordinates (SYSTEM) cannot be used. Write "
        "them in x, y and z.",
        place=keyword.place,
    )
    nodes = read.nodes.setdefault(scope, {})
    labels = []
    for row in keyword.rows:
        first, *rest = [word.strip() for word in row.split(",")]
        labels.append(take_node(nodes, keyword.place, first, rest))
    if "NSET" in keyword.parameters:
        _members_of(read, scope, keyword.parameters["NSET"]).extend(labels)


def _take_elements(read: _Abaqus, scope: _Scope, keyword: _Keyword) -> None:
    kind = keyword.parameters.get("TYPE", "").upper()
    solid = re.match(r"C3D(\d+)", kind)
    if not solid:
        return
    count = int(solid[1])
    if count not in (20, 27):
        read.others[kind] += len(keyword.words) // (1 + count)
        return
    words = numbers_of(keyword.place, keyword.words, whole_number)
    require(
        len(words) % (1 + count) == 0,
        "{place}: an element of type {kind} has a number and {count} nodes; {words} numbers "
        "follow, and something is missing or too much.",
        place=keyword.place,
        kind=kind,
        count=count,
        words=len(words),
    )
    # Abaqus numbers the 20 nodes as VTK does, and puts the others of C3D27 behind them.
    rows = np.array(words, dtype=int).reshape(-1, 1 + count)
    read.bricks.setdefault(scope, []).extend(rows[:, 1:21].tolist())


def _take_set(read: _Abaqus, scope: _Scope, keyword: _Keyword) -> None:
    if "NSET" not in keyword.parameters:
        return
    name = keyword.parameters["NSET"]
    if "INSTANCE" in keyword.parameters:
        scope = read.parts.get(keyword.parameters["INSTANCE"].upper())
        # The assembly may have a set of its own of a name that the part has, too.
        if (scope, name.upper()) in read.of_parts:
            name = f"assembly.{name}"
    members = _members_of(read, scope, name)
    if "GENERATE" not in keyword.parameters:
        members.extend(int(word) if word.isdecimal() else word for word in keyword.words)
        return
    for row in keyword.rows:
        words = [word.strip() for word in row.split(",") if word.strip()]
        numbers = numbers_of(keyword.place, words, whole_number)
        require(
            len(numbers) in (2, 3),
            "{place}: GENERATE takes the first node, the last and the step, got '{row}'.",
            place=keyword.place,
            row=row.strip(),
        )
        members.append(range(numbers[0], numbers[1] + 1, max([*numbers, 1][2], 1)))


def _members_of(read: _Abaqus, scope: _Scope, name: str) -> list[_Member]:
    """The list of a set; names that differ in case only are one set."""
    read.names.setdefault(name.upper(), name)
    return read.sets.setdefault((scope, name.upper()), [])


def _members(read: _Abaqus, scope: _Scope, name: str, above: tuple[str, ...]) -> list[int]:
    """Labels of the nodes of a set and of the sets in it."""
    highest = max(read.nodes.get(scope, {}), default=0)
    labels = []
    for member in read.sets.get((scope, name), []):
        if isinstance(member, int):
            labels.append(member)
        elif isinstance(member, range):
            # A range may go to any number to mean all.
            labels += range(member.start, min(member.stop, highest + 1), member.step)
        elif member.upper() not in above:
            labels += _members(read, scope, member.strip("\"'").upper(), (*above, name))
    return labels


def _meshed(read: _Abaqus) -> _Scope:
    """The only scope with bricks."""
    scopes = list(read.bricks)
    require(
        len(scopes) < 2,
        "The file has several parts with bricks: {parts}. A gear body is one part: merge them, "
        "or write the gear body alone.",
        parts=", ".join(f"'{scope}'" for scope in scopes),
    )
    return scopes[0] if scopes else ""


# What a line includes, by the ending of a deck.
_INCLUDED: Mapping[str, Callable[[str], str | None]] = {
    ".inp": _abaqus_include,
    **dict.fromkeys((".bdf", ".nas", ".dat"), nastran_include),
}
