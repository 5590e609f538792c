"""Grids in text decks: the nodes, bricks and sets of nodes of Abaqus and Nastran files.

meshio reads these formats too, but drops what it does not know without a word (a second *NODE
block, elements behind a comment, nested sets, CHEXA* in wide fields, continuation lines without
a mark, coordinate systems, every SET) and stops at what does not matter here (a spring, a
shell, a missing BEGIN BULK).
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
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


def _deck(
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


def _lines(
    path: Path, included: Callable[[str], str | None], above: tuple[Path, ...] = ()
) -> Iterator[tuple[str, str]]:
    """Lines of a file and of those that it includes, each with where it is."""
    for number, line in enumerate(_text(path, above).splitlines(), start=1):
        other = included(line)
        if other is None:
            yield f"{path.name}, line {number}", line.rstrip()
        else:
            yield from _lines(path.parent / other, included, (*above, path))


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
    for line in _text(path, above).splitlines():
        other = included(line)
        if other is not None:
            yield from _files(path.parent / other, included, (*above, path))


def _text(path: Path, above: tuple[Path, ...]) -> str:
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


def _numbers(place: str, words: Sequence[str], kind: Callable) -> list:
    """Words as numbers, or an error that says where they are."""
    try:
        return [kind(word) for word in words]
    except ValueError as error:
        raise BodyError(f"{place}: a number is expected, got {error.args[0]!r}.") from error


def _real(word: str) -> float:
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


def _whole(word: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise ValueError(word) from None


def _take_node(nodes: dict[int, list[float]], place: str, first: str, rest: Sequence[str]) -> int:
    """Note a node's place; its label is returned."""
    label = _numbers(place, [first], _whole)[0]
    point = _numbers(place, [*rest, "", "", ""][:3], _real)
    require(
        nodes.get(label, point) == point,
        "{place}: node {label} is defined twice, at different places. Write one body into one "
        "file.",
        place=place,
        label=label,
    )
    nodes[label] = point
    return label


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
    return _deck(
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
    for place, line in _lines(path, _abaqus_include):
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
        not any(_numbers(keyword.place, keyword.words, _real)),
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
        labels.append(_take_node(nodes, keyword.place, first, rest))
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
    words = _numbers(keyword.place, keyword.words, _whole)
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
        numbers = _numbers(keyword.place, words, _whole)
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


# Nastran numbers the mid nodes of the uprights before those of the top.
_NASTRAN_TO_VTK = [*range(12), *range(16, 20), *range(12, 16)]

_NASTRAN_SOLIDS = ("CTETRA", "CPENTA", "CPYRAM", "CPYRA")


def read_nastran(path: Path) -> Deck:
    """Nodes, bricks and sets of a Nastran bulk data file.

    Bricks are CHEXA with 20 nodes. Sets are `SET n = ...` of the case control or anywhere else,
    SET1, SET3 of grid points, and OptiStruct's SET of grid points. Their names are their
    numbers, and the names that HyperMesh writes into comments ($HMSET).
    """
    lines = [(place, line.expandtabs(8)) for place, line in _lines(path, _nastran_include)]
    begin = next(
        (i for i, (_, line) in enumerate(lines) if re.match(r"\s*BEGIN\b", line, re.I)), -1
    )
    lists: dict[str, list[list[str]]] = {}
    bulk = _without_sets(lines, begin, lists)
    nodes: dict[int, list[float]] = {}
    bricks: list[list[int]] = []
    others: Counter = Counter()
    for place, name, fields in _cards(bulk):
        match name:
            case "GRID":
                _require_basic(place, name, fields[1])
                _take_node(nodes, place, fields[0], fields[2:5])
            case "GRDSET":
                _require_basic(place, name, fields[1])
            case "CHEXA" if any(fields[10:22]):
                bricks.append(_chexa(place, fields))
            case "CHEXA":
                others["CHEXA with 8 nodes"] += 1
            case "SET1" | "SET3" | "SET":
                _take_card(lists, name, fields)
            case _ if name in _NASTRAN_SOLIDS:
                others[name] += 1
    highest = max(nodes, default=0)
    sets = {
        name: [label for words in several for label in _listed(words, highest)]
        for name, several in lists.items()
    }
    _rename(sets, lines)
    return _deck(nodes, bricks, sets, others)


def _nastran_include(line: str) -> str | None:
    if line.lstrip()[:7].upper() != "INCLUDE":
        return None
    found = re.match(r"\s*INCLUDE\s+['\"]?([^'\"]+)['\"]?\s*$", line, re.IGNORECASE)
    return found[1].strip() if found else None


# What a line includes, by the ending of a deck.
_INCLUDED: Mapping[str, Callable[[str], str | None]] = {
    ".inp": _abaqus_include,
    **dict.fromkeys((".bdf", ".nas", ".dat"), _nastran_include),
}


def _without_sets(
    lines: list[tuple[str, str]], begin: int, lists: dict[str, list[list[str]]]
) -> list[tuple[str, str]]:
    """Take every `SET n = ...` out; what is left of the bulk data is returned."""
    bulk = []
    label, text = "", ""
    for number, (place, line) in enumerate(lines):
        plain = line.split("$")[0].rstrip()
        start = plain.lstrip()[:7].upper()
        if start == "ENDDATA":
            break
        found = start.startswith("SET") and re.match(r"\s*SET\s+(\d+)\s*=\s*(.*)", plain, re.I)
        if found:
            label, text = found[1], found[2]
        elif text.endswith(","):
            text += " " + plain
        elif plain and number > begin:
            bulk.append((place, plain))
        if text and not text.endswith(","):
            lists.setdefault(label, []).append(re.split(r"[\s,]+", text.strip()))
            text = ""
    return bulk


def _cards(lines: list[tuple[str, str]]) -> Iterator[tuple[str, str, list[str]]]:
    """Cards with their name and fields; lines that continue one are added to it.

    A line continues the one before it if its first field is blank or begins with + or *.
    """
    card: tuple[str, str, list[str]] | None = None
    for place, line in lines:
        name, fields = _fields(line)
        if name and name[0] not in "+*":
            if card:
                yield card
            card = (place, name.rstrip("*").upper(), fields)
        elif card:
            card[2].extend(fields)
    if card:
        yield card


def _fields(line: str) -> tuple[str, list[str]]:
    """First field of a line, and the fields of data: eight, or four in wide format."""
    if "," in line:
        name, *fields = [word.strip() for word in line.split(",")]
        count = 4 if "*" in name else 8
        # Behind the fields may stand the mark of a continuation; a longer list has none.
        fields = fields[:count] if len(fields) <= count + 1 else fields
    else:
        name = line[:8].strip()
        count, width = (4, 16) if "*" in name else (8, 8)
        fields = [line[8 + k * width : 8 + (k + 1) * width].strip() for k in range(count)]
    return name, fields + [""] * (count - len(fields))


def _require_basic(place: str, name: str, system: str) -> None:
    require(
        system in ("", "0"),
        "{place}: {name} is given in the coordinate system {system}. Write all grid points in "
        "the basic system (field CP blank or 0).",
        place=place,
        name=name,
        system=system,
    )


def _chexa(place: str, fields: list[str]) -> list[int]:
    """Labels of the nodes of a brick in VTK's order."""
    words = [word for word in fields[2:22] if word]
    require(
        len(words) == 20,
        "{place}: CHEXA {label} has {count} nodes; it must have all 20. Mesh with complete "
        "second-order elements.",
        place=place,
        label=fields[0],
        count=len(words),
    )
    labels = _numbers(place, words, _whole)
    return [labels[index] for index in _NASTRAN_TO_VTK]


def _take_card(lists: dict[str, list[list[str]]], name: str, fields: list[str]) -> None:
    """A set of the bulk data, unless it is one of elements or properties."""
    if name == "SET1":
        members = fields[1:]
    elif fields[1].upper() == "GRID":
        members = fields[2:] if name == "SET3" else fields[8:]
    else:
        return
    lists.setdefault(fields[0], []).append(members)


def _listed(words: Sequence[str], highest: int) -> list[int]:
    """Numbers of a list such as `1, 5 THRU 9 EXCEPT 7, 20 THRU 30 BY 2`; others give none.

    Ranges end at the highest number that there is: they may go to any to mean all.
    """
    labels: list[int] = []
    # The range that ends the list so far: its first and last number, and what is left of it.
    first, last, inside = 0, 0, []
    mode = ""
    for word in (word.upper() for word in words if word):
        if word in ("THRU", "BY", "EXCEPT", "ENDTHRU"):
            mode = word
            continue
        if not word.isdecimal():
            return []
        number = int(word)
        if mode == "THRU" and labels:
            first, last = labels.pop(), min(number, highest)
            inside = list(range(first, last + 1))
        elif mode == "BY":
            inside = list(range(first, last + 1, max(number, 1)))
        # Exceptions lie within the range; the first number beyond it ends them.
        elif mode == "EXCEPT" and number <= last:
            inside = [label for label in inside if label != number]
            continue
        else:
            labels += [*inside, number]
            inside = []
        mode = ""
    return labels + inside


def _rename(sets: dict[str, list[int]], lines: list[tuple[str, str]]) -> None:
    """Give sets the names that HyperMesh keeps in comments; type 1 is a set of nodes."""
    for _, line in lines:
        found = line.startswith("$") and re.match(r"\$HMSET\s+(\d+)\s+(\d+)\s+\"([^\"]+)\"", line)
        if found and found[2] == "1" and found[1] in sets:
            sets[found[3]] = sets[found[1]]
