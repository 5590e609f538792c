"""A condensed body for other programs: matrices as text, and a table of what their rows are.

What is written is what `import_superelement` reads: Nastran's OUTPUT4 and Abaqus's `*MATRIX INPUT`
in m, kg and s; a CSV table of nodes, places and roles; a CSV table of the rim's elements. Terms of
rotation have no place in these files.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TextIO

import numpy as np

from ._artefact import ReducedBody
from ._checks import require

# OUTPUT4: three numbers of 23 characters on a line, in double precision; a symmetric matrix.
_PER_LINE, _FORM, _KIND = 3, 6, 2
_NAMES = ("KAA", "MAA")
# One integer of eight characters counts rows.
_MOST_ROWS = 9_999_999


def export_body(body: ReducedBody, folder: Path, form: str) -> list[Path]:
    """Write a condensed body for another program.

    **Arguments:**

    - `body`: to be written; its matrices are in SI.
    - `folder`: where to, which must be there.
    - `form`: "op4" (Nastran's OUTPUT4, text: matrices KAA and MAA) or "mtx" (Abaqus's
        `*MATRIX INPUT`, one file for the stiffness, one for the mass).

    **Returns:**

    The files: matrices, then NAME_nodes.csv and, where the rim's elements are known, NAME_rim.csv.

    **Raises:**

    - `BodyError` if there is no such form.
    """
    require(
        form in _WRITERS,
        "The form must be one of {known}, got {form!r}.",
        known=", ".join(_WRITERS),
        form=form,
    )
    files = _WRITERS[form](body, folder)
    files.append(folder / f"{body.name}_nodes.csv")
    files[-1].write_text("\n".join(_nodes(body)) + "\n", encoding="utf-8")
    if len(body.rim_faces):
        files.append(folder / f"{body.name}_rim.csv")
        np.savetxt(files[-1], body.rim_faces + 1, fmt="%d", delimiter=",")
    return files


def _labels(body: ReducedBody) -> Iterator[tuple[int, int]]:
    """Node and component of every row; a mode's amplitude is component 1 of a node of its own."""
    rim, seats = len(body.rim_nodes), len(body.seats)
    for node in range(1, rim + seats + body.interior + 1):
        components = 3 if node <= rim else 6 if node <= rim + seats else 1
        yield from ((node, component) for component in range(1, components + 1))


def _nodes(body: ReducedBody) -> Iterator[str]:
    """Lines of the table of nodes."""
    yield f"# {body.name}: in metres; rows of the matrices follow the table, in m, kg and s"
    yield "node,x,y,z,role"
    roles = ["rim"] * len(body.rim_nodes) + [f"seat:{name}" for name in body.seats]
    places = np.concatenate([body.rim_nodes, body.seat_points.reshape(-1, 3)])
    for node, (place, role) in enumerate(zip(places.tolist(), roles, strict=True), start=1):
        yield f"{node},{','.join(map(repr, place))},{role}"
    for node in range(len(roles) + 1, len(roles) + body.interior + 1):
        yield f"{node},,,,mode"


def _write_op4(body: ReducedBody, folder: Path) -> list[Path]:
    """Whole columns, as Nastran writes symmetric matrices too: readers add no other triangle."""
    path = folder / f"{body.name}.op4"
    size = body.dofs
    require(size < _MOST_ROWS, "OUTPUT4 holds fewer rows than {size}.", size=size)
    with path.open("w", encoding="ascii") as file:
        for name, matrix in zip(_NAMES, (body.stiffness, body.mass), strict=True):
            file.write(f"{size:8d}{size:8d}{_FORM:8d}{_KIND:8d}{name:<8}1P,{_PER_LINE}E23.16\n")
            for column in range(size):
                _write_column(file, column, matrix[:, column])
            file.write(f"{size + 1:8d}{1:8d}{1:8d}\n{1.0:23.16E}\n")
    return [path]


def _write_column(file: TextIO, column: int, values: np.ndarray) -> None:
    file.write(f"{column + 1:8d}{1:8d}{len(values):8d}\n")
    whole = len(values) // _PER_LINE * _PER_LINE
    line = "%23.16E" * _PER_LINE + "\n"
    file.write(line * (whole // _PER_LINE) % tuple(values[:whole]))
    if whole < len(values):
        file.write("%23.16E" * (len(values) - whole) % tuple(values[whole:]) + "\n")


def _write_mtx(body: ReducedBody, folder: Path) -> list[Path]:
    """Lines `node, component, node, component, value` of the lower triangles."""
    labels = np.array(list(_labels(body)))
    paths = [folder / f"{body.name}_{kind}.mtx" for kind in ("stiffness", "mass")]
    for path, matrix in zip(paths, (body.stiffness, body.mass), strict=True):
        with path.open("w", encoding="ascii") as file:
            for row in range(body.dofs):
                node, component = labels[row]
                line = f"{node}, {component}, %d, %d, %.17e\n"
                cells = zip(*labels[: row + 1].T.tolist(), matrix[row, : row + 1], strict=True)
                file.write("".join(line % cell for cell in cells))
    return paths


_WRITERS: dict[str, Callable[[ReducedBody, Path], list[Path]]] = {
    "op4": _write_op4,
    "mtx": _write_mtx,
}
