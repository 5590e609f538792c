"""CSV files of numbers, with every mistake told by file and line."""

import csv
import difflib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxgear._checks import InputError

# Mistakes of single lines that one message lists; the rest are counted.
_LISTED = 5

# No measured flank takes as much as this [byte]; devices have no end.
_LONGEST = 100_000_000

_DECIMAL = "Write numbers with a decimal point, and separate them by commas, as in 12.5,-3.2."


class Cells(NamedTuple):
    """The numbers of a file with a header.

    **Fields:**

    - `header`: line of the header.
    - `names`: of the columns.
    - `lines`: line of each row.
    - `numbers`: of each row and column.
    """

    header: int
    names: list[str]
    lines: list[int]
    numbers: np.ndarray

    def column(self, name: str) -> np.ndarray:
        """The numbers of a column."""
        return self.numbers[:, self.names.index(name)]


def read_cells(path: Path, known: Sequence[str], needed: Sequence[str]) -> Cells:
    """Read a file whose header names its columns.

    **Raises:**

    - `InputError` that lists what is wrong.
    """
    rows = _lines(path)
    example = ",".join([known[0], *needed])
    if not rows:
        raise InputError(
            f"{path}: the file has no lines. It must begin with a header, such as {example}."
        )
    names = _header(path, *rows[0], known, needed, example)
    numbers, mistakes = [], []
    for number, line in rows[1:]:
        cells = _cells(path, number, line)
        if wrong := _wrong_with(cells, names):
            mistakes.append(f"{path}:{number}: {wrong}")
        else:
            numbers.append([float(cell) for cell in cells])
    if mistakes:
        more = len(mistakes) - _LISTED
        mistakes[_LISTED:] = [f"and {more} more lines like these."] if more > 0 else []
        raise InputError("\n".join(mistakes))
    shape = (-1, len(names))
    lines = [number for number, _ in rows]
    return Cells(lines[0], names, lines[1:], np.reshape(np.asarray(numbers, dtype=float), shape))


def read_matrix(path: str, folder: Path) -> np.ndarray:
    """Read a square matrix: as many lines as there are numbers in each, separated by commas.

    **Raises:**

    - `InputError` if the file cannot be read, or is no square table of numbers.
    """
    file = folder / path
    rows: list[list[float]] = []
    for number, line in _lines(file):
        cells = _cells(file, number, line)
        if bad := next((cell for cell in cells if not _is_number(cell)), None):
            raise InputError(
                f"{file}:{number}: got {bad!r}, must be a number. A matrix has no header; begin a "
                "remark with #."
            )
        if rows and len(cells) != len(rows[0]):
            raise InputError(
                f"{file}:{number}: got {len(cells)} numbers, must be {len(rows[0])} as in the "
                "lines above."
            )
        rows.append([float(cell) for cell in cells])
    if not rows or len(rows) != len(rows[0]):
        count = len(rows[0]) if rows else 0
        raise InputError(f"{file}: a matrix must be square, got {len(rows)} lines of {count}.")
    return np.asarray(rows)


def _lines(path: Path) -> list[tuple[int, str]]:
    """Lines with something in them, each with its number."""
    rows = enumerate(_text_of(path).splitlines(), 1)
    return [(n, line) for n, line in rows if line.strip() and not line.lstrip().startswith("#")]


def _text_of(path: Path) -> str:
    try:
        with path.open("rb") as file:
            content = file.read(_LONGEST + 1)
        if len(content) <= _LONGEST:
            return content.decode("utf-8-sig")
        said = (
            f"the file is longer than {_LONGEST:,} bytes, so it is no table of a flank. Name "
            "the CSV file, or leave out points"
        )
    except FileNotFoundError:
        said = "there is no such file. A relative path is relative to the folder of the scene file"
    except IsADirectoryError:
        said = "this is a folder; name a CSV file in it"
    except UnicodeDecodeError:
        said = "this is not a text file. Export the table as CSV in UTF-8"
    except OSError as error:
        said = f"the file cannot be read: {error.strerror}"
    raise InputError(f"{path}: {said}.")


def _cells(path: Path, number: int, line: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        raise InputError(f"{path}:{number}: this is not a line of a CSV file: {error}.") from None


def _header(
    path: Path, number: int, line: str, known: Sequence[str], needed: Sequence[str], example: str
) -> list[str]:
    """The column names, every one of which is known, and there once."""
    where = f"{path}:{number}"
    names = _cells(path, number, line)
    for separator, called in ((";", "semicolons"), ("\t", "tabs")):
        if separator in line:
            raise InputError(
                f"{where}: the columns are separated by {called}. Separate them by commas and "
                "write numbers with a decimal point, as in 12.5,-3.2."
            )
    if not set(names) & set(known) and all(map(_is_number, names)):
        raise InputError(
            f"{where}: the header is missing. The first line must name the columns, such as "
            f"{example}."
        )
    for place, name in enumerate(names, 1):
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            # Otherwise it is not quoted: the file may be of another kind, and not for all eyes.
            told, hint = (
                (repr(name), f" Did you mean {near[0]}?") if near else (f"number {place}", "")
            )
            listed = ", ".join(known) if len(known) <= _LISTED else f"{len(known)} known ones"
            raise InputError(
                f"{where}: unknown column {told}; columns are {listed}, with the unit "
                f"in the name.{hint}"
            )
        if names.count(name) > 1:
            raise InputError(f"{where}: the column {name} is there {names.count(name)} times.")
    for name in needed:
        if name not in names:
            raise InputError(f"{where}: the column {name} is missing; got {', '.join(names)}.")
    return names


def _is_number(cell: str) -> bool:
    # Python also reads 1_000, which is a slip of the pen in a table.
    try:
        return "_" not in cell and math.isfinite(float(cell))
    except ValueError:
        return False


def _wrong_with(cells: Sequence[str], names: Sequence[str]) -> str | None:
    """What is wrong with a line of numbers, if anything."""
    if len(cells) != len(names):
        hint = ""
        if len(cells) > len(names):
            hint = f" If these are decimal commas: {_DECIMAL[0].lower()}{_DECIMAL[1:]}"
        elif len(cells) == 1 and ";" in cells[0]:
            hint = f" {_DECIMAL}"
        return f"{len(cells)} cells, where the header names {len(names)} columns.{hint}"
    for name, cell in zip(names, cells, strict=True):
        if _is_number(cell):
            continue
        if _is_number(cell.replace(",", ".", 1)):
            return f"{name}: {cell!r} has a decimal comma. {_DECIMAL}"
        if cell.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            return f"{name}: {cell!r} is not a finite number. Remove the point."
        return f"{name}: {cell!r} is not a number." if cell else f"{name}: the cell is empty."
    return None
