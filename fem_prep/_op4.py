"""Nastran's OUTPUT4 files of matrices, as text.

After the description of OUTPUT4 in the DMAP guides of MSC and NX Nastran: a header with numbers
of columns and rows, form, type, name and Fortran format; then, for each column that is not zero,
either one run of values from its first row on, or strings of values, each with a header of its
own. Strings of matrices with many rows have two integers ("bigmat", the number of rows is then
written negative), others pack both into one. A column past the last one ends the matrix.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ._checks import BodyError, require

_HEADER = re.compile(r"\s*(\d+)\s+(-?\d+)\s+(\d+)\s+([1-4])([A-Za-z].{0,7})(.*)")
_FORMAT = re.compile(r"(\d+)[ED](\d+)\.\d+")
_SYMMETRIC = 6

# Of Fortran, when a header names no format.
_PER_LINE, _WIDTH = 5, 16

# One integer of 32 bits holds row and length of a string below this number of rows.
_PACKED = 65536


def read_op4(paths: Sequence[Path], names: Sequence[str]) -> list[np.ndarray]:
    """Read some matrices by their names.

    **Arguments:**

    - `paths`: of text files; sparse and full forms may stand in them, and other matrices.
    - `names`: of the matrices.

    **Returns:**

    The matrices, full.

    **Raises:**

    - `BodyError` if a file is binary or truncated, or if a matrix is complex or not there.
    """
    found: dict[str, list[str]] = {}
    for path in paths:
        found |= _blocks(path)
    missing = [name for name in names if name not in found]
    require(
        found and not missing,
        "The files {paths} must hold matrices of Nastran's OUTPUT4 named {names}, got {found}. "
        "State the names that stand there.",
        paths=", ".join(map(str, paths)),
        names=", ".join(names),
        found=", ".join(found) or "none: they are no OUTPUT4 text files",
    )
    matrices = []
    for name in names:
        try:
            matrices.append(_matrix(name, found[name]))
        except BodyError:
            raise
        except (ValueError, IndexError) as error:
            raise BodyError(
                f"The matrix {name} of Nastran's OUTPUT4 is truncated or damaged ({error}). Write "
                "it again."
            ) from error
    return matrices


def _blocks(path: Path) -> dict[str, list[str]]:
    """Lines of every matrix of a file, headers included."""
    content = path.read_bytes()
    require(
        b"\0" not in content[:1000],
        "The file {path} is binary, but must be text: write it with the option FORMATTED of "
        "ASSIGN OUTPUT4.",
        path=path,
    )
    blocks: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in content.decode("ascii", "replace").splitlines():
        if header := _HEADER.match(line):
            lines = blocks[header[5].strip().upper()] = []
        lines.append(line)
    return blocks


def _matrix(name: str, lines: list[str]) -> np.ndarray:
    """One matrix from its lines."""
    header = _HEADER.match(lines[0])
    assert header is not None
    columns, rows, form, kind = (int(header[group]) for group in range(1, 5))
    require(
        kind < 3,
        "The matrix {name} is complex, and must be real. Write stiffness and mass without "
        "structural damping.",
        name=name,
    )
    layout = _FORMAT.search(header[6])
    per_line, width = (int(layout[1]), int(layout[2])) if layout else (_PER_LINE, _WIDTH)
    big = rows < 0 or rows >= _PACKED
    matrix = np.zeros((abs(rows), columns))
    at, column = 1, 0
    while column <= columns:
        column, row, words = (int(word) for word in lines[at].split())
        at += 1
        # The number of words is that of values where a column is full.
        strings = row == 0
        while words > 0:
            count = words
            if strings:
                row, length, at = _string(lines, at, big)
                count, words = (length - 1) // kind, words - length - (1 if big else 0)
            else:
                words = 0
            values, at = _values(lines, at, count, per_line, width)
            if column <= columns:
                matrix[row - 1 : row - 1 + count, column - 1] = values
    return _whole(matrix) if form == _SYMMETRIC else matrix


def _string(lines: list[str], at: int, big: bool) -> tuple[int, int, int]:
    """Header of a string: its row, its number of words plus one, and the line after it."""
    if big:
        length, row = (int(word) for word in lines[at].split())
        return row, length, at + 1
    length, row = divmod(int(lines[at]), _PACKED)
    return row, length, at + 1


def _values(
    lines: list[str], at: int, count: int, per_line: int, width: int
) -> tuple[np.ndarray, int]:
    """Values in fields of a fixed width: where they are negative no blank stands between them."""
    after = at + -(-count // per_line)
    text = "".join(lines[at:after])
    if len(text) != count * width:
        raise ValueError(f"{count} values of {width} characters wanted, got {len(text)}")
    fields = np.frombuffer(text.upper().replace("D", "E").encode(), dtype=f"S{width}")
    return fields.astype(float), after


def _whole(matrix: np.ndarray) -> np.ndarray:
    """A symmetric matrix of which perhaps one triangle was written."""
    lower, upper = np.tril(matrix, -1), np.triu(matrix, 1)
    if lower.any() and upper.any():
        return matrix
    return matrix + lower.T + upper.T
