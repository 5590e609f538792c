"""Nodes, bricks and sets of nodes of a Nastran deck."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from ._checks import require
from ._deck import Deck, deck_lines, deck_of, numbers_of, take_node, whole_number

# Nastran numbers the mid nodes of the uprights before those of the top.
_NASTRAN_TO_VTK = [*range(12), *range(16, 20), *range(12, 16)]
_NASTRAN_SOLIDS = ("CTETRA", "CPENTA", "CPYRAM", "CPYRA")


def read_nastran(path: Path) -> Deck:
    """Nodes, bricks and sets of a Nastran bulk data file.

    Bricks are CHEXA with 20 nodes. Sets are `SET n = ...` of the case control or anywhere else,
    SET1, SET3 of grid points, and OptiStruct's SET of grid points. Their names are their
    numbers, and the names that HyperMesh writes into comments ($HMSET).
    """
    lines = [(place, line.expandtabs(8)) for place, line in deck_lines(path, nastran_include)]
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
                take_node(nodes, place, fields[0], fields[2:5])
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
    return deck_of(nodes, bricks, sets, others)


def nastran_include(line: str) -> str | None:
    """The file that a line includes, or `None`."""
    if line.lstrip()[:7].upper() != "INCLUDE":
        return None
    found = re.match(r"\s*INCLUDE\s+['\"]?([^'\"]+)['\"]?\s*$", line, re.IGNORECASE)
    return found[1].strip() if found else None


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
    labels = numbers_of(place, words, whole_number)
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
