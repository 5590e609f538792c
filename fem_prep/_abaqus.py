"""Matrices of Abaqus and CalculiX, as text.

Three forms are known:

- a linear user element (`*SUBSTRUCTURE MATRIX OUTPUT, OUTPUT FILE=USER DEFINED`): nodes of the
  element as comments, components of the first node, then of each at which they change, and the
  lower triangles of the stiffness and the mass, row by row;
- lines `node, component, node, component, value` (`*MATRIX OUTPUT`, `FORMAT=MATRIX INPUT` or
  `LABELS`), one file for each matrix, a triangle or the whole of it;
- lines `row column value` (`FORMAT=COORDINATE`; CalculiX's `*FREQUENCY, SOLVER=MATRIXSTORAGE`,
  which writes the stiffness to `.sti`, the mass to `.mas` and `node.component` of every row to
  `.dof`).
"""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array, csr_array

from ._checks import BodyError, require

_NUMBERS = re.compile(r"\d+")


@dataclass(frozen=True)
class Superelement:
    """Matrices from elsewhere, in units of their own.

    **Fields:**

    - `stiffness`: shape `[row, row]` [in the file's units].
    - `mass`: the same, or None.
    - `labels`: node and component of every row, `[row, 2]`; None if the file does not say.
    """

    stiffness: np.ndarray | csr_array
    mass: np.ndarray | csr_array | None
    labels: np.ndarray | None

    def __post_init__(self):
        shapes = [each.shape for each in (self.stiffness, self.mass) if each is not None]
        require(
            all(shape == (self.rows, self.rows) for shape in shapes),
            "Stiffness and mass must be square and of one size, got {shapes}. Do they belong "
            "together?",
            shapes=" and ".join(map(str, shapes)),
        )

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.stiffness.diagonal().size


def read_mtx(paths: Sequence[Path]) -> Superelement:
    """Read `.mtx` files of Abaqus or CalculiX.

    **Arguments:**

    - `paths`: one file with a user element; or that of the stiffness, then that of the mass.

    **Returns:**

    The matrices.

    **Raises:**

    - `BodyError` if a file is something else, or truncated.
    """
    texts = [_content(path) for path in paths]
    if "*USER ELEMENT" in texts[0].upper():
        return _user_element(texts[0], paths[0])
    tables = [_table(text, path) for text, path in zip(texts, paths, strict=True)]
    widths = {table.shape[1] for table in tables}
    require(
        widths in ({3}, {5}),
        "Lines of {paths} must be either `node, component, node, component, value` or `row, "
        "column, value`, got {widths} numbers on a line. Write `FORMAT=MATRIX INPUT`.",
        paths=", ".join(map(str, paths)),
        widths=" and ".join(map(str, sorted(widths))),
    )
    if widths == {3}:
        matrices = _coordinates(tables)
        return Superelement(matrices[0], matrices[1] if len(paths) > 1 else None, None)
    places = np.concatenate([table[:, start : start + 2] for start in (0, 2) for table in tables])
    labels, numbers = np.unique(places.astype(int), axis=0, return_inverse=True)
    rows, columns = np.split(numbers.ravel() + 1, 2)
    ends = np.cumsum([len(table) for table in tables])[:-1]
    parts = zip(np.split(rows, ends), np.split(columns, ends), tables, strict=True)
    matrices = _coordinates([np.column_stack([i, j, each[:, 4]]) for i, j, each in parts])
    return Superelement(matrices[0], matrices[1] if len(paths) > 1 else None, labels)


def read_storage(path: Path) -> Superelement:
    """Read what CalculiX's `MATRIXSTORAGE` wrote: whole matrices, nothing condensed.

    **Arguments:**

    - `path`: of one of the three files; the others lie beside it.

    **Returns:**

    The matrices.

    **Raises:**

    - `BodyError` if one of the files is missing or truncated, or if they do not match.
    """
    tables = [_table(_content(each), each) for each in map(path.with_suffix, (".sti", ".mas"))]
    stiffness, mass = _coordinates(tables)
    pairs = _content(path.with_suffix(".dof")).split()
    try:
        labels = np.array([pair.split(".") for pair in pairs], dtype=int).reshape(-1, 2)
    except ValueError as error:
        raise BodyError(
            f"Lines of {path.with_suffix('.dof')} must be `node.component`: {error}. Run CalculiX "
            "again."
        ) from error
    require(
        len(labels) == stiffness.diagonal().size,
        "CalculiX's files must belong together: {path} has {labels} rows, and the matrices have "
        "{rows}. One is truncated or of another run: run CalculiX again.",
        path=path.with_suffix(".dof"),
        labels=len(labels),
        rows=stiffness.diagonal().size,
    )
    return Superelement(stiffness, mass, labels)


def _content(path: Path) -> str:
    require(
        path.is_file(),
        "There is no file {path}. CalculiX's `*FREQUENCY, SOLVER=MATRIXSTORAGE` writes .sti, .mas "
        "and .dof side by side; correct the path, or run it again.",
        path=path,
    )
    return path.read_text("utf-8", "replace")


def _table(text: str, path: Path) -> np.ndarray:
    """Numbers of all lines that are no comment and no keyword."""
    numbers = text.replace(",", " ").upper().replace("D", "E")
    try:
        require(re.search(r"^\s*\d", numbers, re.M), "there is no line of numbers")
        return np.loadtxt(io.StringIO(numbers), comments="*", ndmin=2)
    except ValueError as error:
        raise BodyError(
            f"The file {path} must hold a matrix, one entry on a line: {error}. If it is "
            "truncated, write it again."
        ) from error


def _coordinates(tables: Sequence[np.ndarray]) -> list[csr_array]:
    """Symmetric matrices of one size from rows, columns (from 1 on) and values of entries."""
    size = int(max(table[:, :2].max() for table in tables))
    matrices = []
    for table in tables:
        rows, columns = table[:, :2].astype(int).T - 1
        matrix = csr_array(coo_array((table[:, 2], (rows, columns)), shape=(size, size)))
        # Which of both triangles an entry stands in depends on the order of the writer's rows.
        there = matrix.copy()
        there.data[:] = 1.0
        other = csr_array(matrix.T)
        matrices.append(csr_array(matrix + other - other * there))
    return matrices


def _user_element(text: str, path: Path) -> Superelement:
    """The one linear user element of a file."""
    head, *blocks = re.split(r"^\*MATRIX", text, flags=re.M | re.I)
    matrices = {}
    labels = _element_labels(head)
    size = len(labels)
    for block in blocks:
        first, _, values = block.partition("\n")
        kind = "MASS" if "MASS" in first.upper() else "STIFFNESS"
        data = " ".join(line for line in values.splitlines() if not line.startswith("*"))
        words = data.replace(",", " ").upper().replace("D", "E").split()
        require(
            size and len(words) in (size * (size + 1) // 2, size**2),
            "The {kind} of the user element in {path} must have {triangle} values, half a matrix "
            "of {size} rows, got {words}. If the file is truncated, write it again; it may hold "
            "one element only.",
            kind=kind.lower(),
            path=path,
            triangle=size * (size + 1) // 2,
            size=size,
            words=len(words),
        )
        matrices[kind] = _full(np.array(words, dtype=float), size)
    require(
        "STIFFNESS" in matrices,
        "The user element in {path} must have a stiffness: write it with `STIFFNESS=YES`.",
        path=path,
    )
    return Superelement(matrices["STIFFNESS"], matrices.get("MASS"), labels)


def _element_labels(head: str) -> np.ndarray:
    """Node and component of every row, from what stands before the first matrix."""
    _, _, definition = head.upper().partition("*USER ELEMENT")
    _, _, listing = definition.partition("ELEMENT NODES")
    nodes: list[int] = []
    lines: list[list[int]] = []
    for line in listing.splitlines()[1:]:
        numbers = [int(word) for word in _NUMBERS.findall(line)]
        if line.startswith("**") and not lines:
            nodes += numbers
        elif numbers and not line.startswith("*"):
            lines.append(numbers)
    # Components of the first node, then place of a node and its components: until the next one.
    changes = {1: lines[0]} | {line[0]: line[1:] for line in lines[1:]} if lines else {1: []}
    labels, components = [], []
    for place, node in enumerate(nodes, start=1):
        components = changes.get(place, components)
        labels += [(node, component) for component in components]
    return np.array(labels, dtype=int).reshape(-1, 2)


def _full(values: np.ndarray, size: int) -> np.ndarray:
    """A matrix from its lower triangle by rows, or from all of it by columns."""
    if len(values) == size**2:
        return values.reshape(size, size).T
    matrix = np.zeros((size, size))
    matrix[np.tril_indices(size)] = values
    return matrix + np.tril(matrix, -1).T
