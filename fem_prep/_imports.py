"""Matrices condensed elsewhere, made into the same body that condensing here makes."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from ._abaqus import Superelement, read_mtx, read_storage
from ._artefact import ReducedBody, rigid_motions
from ._body_checks import check_body
from ._checks import BodyError, Progress, require, silent
from ._companion import Companion, described, read_faces, read_table, rows_of
from ._import_checks import check_free, check_mass, check_motions, check_size, symmetric
from ._modes import lowest_modes
from ._op4 import read_op4
from ._solvers import factorise

# Length [m], mass [kg] and time [s] of systems in which force is mass times acceleration.
SYSTEMS = {
    "m-kg-s": (1.0, 1.0, 1.0),
    "mm-t-s": (1e-3, 1e3, 1.0),
    "mm-kg-ms": (1e-3, 1.0, 1e-3),
    "in-lbf-s": (0.0254, 4.4482216152605 / 0.0254, 1.0),
}

_KINDS = (".mtx", ".sti", ".mas", ".dof", ".op4", ".npz")


def import_superelement(
    paths: str | Path | Sequence[str | Path],
    table: str | Path | None = None,
    *,
    units: str,
    name: str | None = None,
    faces: str | Path | None = None,
    modes: int = 0,
    mid_face: float = 0.0,
    mass: float | None = None,
    static: bool = False,
    matrices: tuple[str, str] = ("KAA", "MAA"),
    progress: Progress = silent,
) -> ReducedBody:
    """A condensed body from matrices of another program.

    **Arguments:**

    - `paths`: of the file: `.mtx` (Abaqus, CalculiX), `.sti` with `.mas` and `.dof` beside it
        (CalculiX), `.op4` (Nastran, text), or `.npz` with arrays `stiffness`, `mass` and, without
        a table, `rim_nodes`, `seats`, `seat_points` and perhaps `rim_faces` and
        `centrifugal_load`, all as in `ReducedBody`. Of two files: stiffness, then mass.
    - `table`: CSV file that says what the nodes are, see `_companion`.
    - `units`: of all files: "m-kg-s", "mm-t-s" (N, MPa), "mm-kg-ms" (kN, GPa) or "in-lbf-s".
    - `name`: of the body; that of the first file without it.
    - `faces`: CSV file with the elements of the rim: eight node numbers on a line, in the order
        of `ReducedBody.rim_faces`.
    - `modes`: of the held body, that stand for `interior` nodes beside static condensation; no more
        than there can be are taken.
    - `mid_face`: z of the middle of the toothed face in the files [m, whatever their unit].
    - `mass`: of the body, to compare with [kg].
    - `static`: True: a file without mass will do; the body is then good for statics only.
    - `matrices`: names of stiffness and mass in OP4 files.
    - `progress`: told what begins.

    **Returns:**

    The body. Without one in the file its centrifugal load is that of the mass matrix and the
    places of the nodes in the file: exact if nothing was condensed before, else only about right.

    **Raises:**

    - `BodyError` if something is missing, does not fit, or cannot be a free gear body.
    """
    files = [Path(each) for each in ([paths] if isinstance(paths, str | Path) else paths)]
    require(
        units in SYSTEMS,
        "Units must be one of {known}, got {units!r}. Abaqus and CalculiX models in N, mm and MPa "
        "are in mm-t-s.",
        known=", ".join(SYSTEMS),
        units=units,
    )
    with progress("reading matrices"):
        read, companion, extra = _read(files, table, static, matrices)
    if faces is not None:
        extra["rim_faces"] = read_faces(Path(faces), companion)
    with progress("condensing what is left inside"):
        body = _body(read, companion, extra, SYSTEMS[units], modes, mid_face)
    facts = {
        "method": "imported",
        "source": [each.name for each in files],
        "source_sha256": [hashlib.sha256(each.read_bytes()).hexdigest() for each in files],
        "source_units": units,
        **body.facts,
    }
    body = replace(body, name=name or files[0].stem, facts=facts)
    with progress("checking the body"):
        check_body(body)
        check_size(body, units, mid_face)
        check_free(body)
        if read.mass is not None:
            check_mass(body, mass, units)
    return body


def _read(
    files: list[Path], table: str | Path | None, static: bool, names: tuple[str, str]
) -> tuple[Superelement, Companion, dict[str, np.ndarray]]:
    """Matrices, what their nodes are, and other fields of the body that are known."""
    kind = files[0].suffix.lower()
    require(
        kind in _KINDS,
        "Matrices must be in a file .mtx, .sti, .op4 or .npz, got {name}. Rename it if it is one.",
        name=files[0].name,
    )
    for each in files:
        require(each.is_file(), "There is no file {path}. Correct the path.", path=each)
    require(
        table is not None or kind == ".npz",
        "Matrices in a file {kind} must come with a table of their nodes: a CSV file with the "
        "columns `node,x,y,z,role`.",
        kind=kind,
    )
    extra: dict[str, np.ndarray] = {}
    if kind == ".npz":
        read, extra = _arrays(files[0])
    elif kind == ".mtx":
        read = read_mtx(files)
    elif kind == ".op4":
        found = read_op4(files, names[:1] if static else names)
        read = Superelement(found[0], None if static else found[1], None)
    else:
        read = read_storage(files[0])
    require(
        read.mass is not None or static,
        "{name} must hold a mass too, as motion needs one. CalculiX's substructures never do: use "
        "`*FREQUENCY, SOLVER=MATRIXSTORAGE` there. For statics alone say so: `static=True`.",
        name=files[0].name,
    )
    if table is not None:
        return read, read_table(Path(table)), extra
    return read, described(read.rows, extra), extra


def _arrays(path: Path) -> tuple[Superelement, dict[str, np.ndarray]]:
    """Plain arrays of an npz file: the matrices, and all others."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, AttributeError) as error:
        raise BodyError(
            f"The file {path} must be an npz archive of plain numbers: {error}. Write it with "
            "`numpy.savez`."
        ) from error
    require(
        "stiffness" in arrays,
        "The file {path} must hold an array `stiffness`, got {names}.",
        path=path,
        names=", ".join(arrays) or "none",
    )
    return Superelement(arrays.pop("stiffness"), arrays.pop("mass", None), None), arrays


def _body(
    read: Superelement,
    companion: Companion,
    extra: dict[str, np.ndarray],
    system: tuple[float, float, float],
    modes: int,
    mid_face: float,
) -> ReducedBody:
    """The body, in SI and in the order of `ReducedBody`, without a name."""
    length, weight, time = system
    size = read.rows
    place, component = rows_of(companion, read.labels, size).T
    points = length * companion.points - [0.0, 0.0, mid_face]
    # Coordinates in SI of one in the files' units; turns and amplitudes keep theirs.
    scale = np.where((component >= 1) & (component <= 3), length, 1.0)
    energy = weight * length**2
    stiffness = _scaled(symmetric("stiffness", read.stiffness), energy / time**2, scale)
    mass = csr_array((size, size)) if read.mass is None else symmetric("mass", read.mass)
    mass = _scaled(mass, energy, scale)
    residual = check_motions(stiffness, points[place], component, named=read.labels is not None)
    spread, seat_points = _spread(companion, points, place, component)
    basis = _basis(stiffness, mass, spread, np.isin(place, companion.those("interior")), modes)
    x, y, _ = points[place].T
    load = mass @ np.select([component == 1, component == 2], [x, y], 0.0)
    known = "centrifugal_load" in extra
    if known:
        given = extra["centrifugal_load"]
        require(
            given.shape == (size,),
            "`centrifugal_load` must have one number for each of {size} rows, got {shape}.",
            size=size,
            shape=list(given.shape),
        )
        load = energy * given / scale
    rim = companion.those("rim")
    boundary = 3 * len(rim) + 6 * len(companion.seats)
    stiffness, mass = _projected(stiffness, basis), _projected(mass, basis)
    return ReducedBody(
        name="",
        stiffness=stiffness,
        mass=mass,
        centrifugal_load=basis.T @ load,
        rim_nodes=points[rim],
        rim_faces=extra.get("rim_faces", np.zeros((0, 8))).astype(np.int64),
        seats=companion.seats,
        seat_points=seat_points,
        interior=len(stiffness) - boundary,
        facts={
            "rigid_motion_residual": residual,
            "modes_of_interior_nodes": len(stiffness) - boundary - int(np.sum(component == 0)),
            "centrifugal_load": "of the file" if known else "of the nodes in the file",
        },
    )


def _scaled(
    matrix: np.ndarray | csr_array, factor: float, scale: np.ndarray
) -> np.ndarray | csr_array:
    """A matrix for coordinates that are `scale` times as large."""
    if isinstance(matrix, np.ndarray):
        return factor * matrix / scale[:, None] / scale
    inverse = diags_array(1 / scale)
    return csr_array(factor * (inverse @ matrix @ inverse))


def _projected(matrix: np.ndarray | csr_array, basis: np.ndarray | csr_array) -> np.ndarray:
    """A matrix on fewer coordinates, symmetric to the last digit."""
    result = basis.T @ (matrix @ basis)
    result = result if isinstance(result, np.ndarray) else result.toarray()
    return (result + result.T) / 2


def _spread(
    companion: Companion, points: np.ndarray, place: np.ndarray, component: np.ndarray
) -> tuple[csr_array, np.ndarray]:
    """Rows of the matrices from the coordinates kept, interior nodes at rest.

    **Returns:**

    Shape `[row, kept]`, and the places of the seats, `[seat, 3]` [m].
    """
    rim = companion.those("rim")
    starts = {at: 3 * number for number, at in enumerate(rim)}
    next_start, seat_points, ties = 3 * len(rim), [], []
    for seat in companion.seats:
        nodes = companion.those(f"seat:{seat}")
        if len(nodes) == 1:
            starts[nodes[0]] = next_start
            seat_points.append(points[nodes[0]])
        else:
            seat_points.append(_middle(seat, points[nodes]))
            ties.append((nodes, next_start, seat_points[-1]))
        next_start += 6
    entries: list[tuple[Any, Any, Any]] = [
        (row, starts[at] + digit - 1, 1.0)
        for row, (at, digit) in enumerate(zip(place, component, strict=True))
        if at in starts
    ]
    for nodes, start, point in ties:
        for row in np.flatnonzero(np.isin(place, nodes)):
            motion = rigid_motions(points[place[row]][None] - point)[component[row] - 1]
            entries += [(row, start + column, motion[column]) for column in range(6)]
    amplitudes = np.flatnonzero(component == 0)
    entries += [(row, next_start + number, 1.0) for number, row in enumerate(amplitudes)]
    rows, columns, values = zip(*entries, strict=True)
    shape = (len(place), next_start + len(amplitudes))
    spread = csr_array(coo_array((values, (rows, columns)), shape=shape))
    return spread, np.array(seat_points).reshape(-1, 3)


def _middle(seat: str, points: np.ndarray) -> np.ndarray:
    """Point on the axis that stands for a ring of nodes."""
    spans = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    require(
        len(points) > 2 and spans[1] > 1e-6 * spans[0],
        "The seat {seat!r} must have one node with six components, or three or more that are not "
        "on one line, got {count}. Take all nodes around it.",
        seat=seat,
        count=len(points),
    )
    return np.array([0.0, 0.0, (points[:, 2].min() + points[:, 2].max()) / 2])


def _basis(
    stiffness: np.ndarray | csr_array,
    mass: np.ndarray | csr_array,
    spread: csr_array,
    inside: np.ndarray,
    modes: int,
) -> np.ndarray | csr_array:
    """All rows from the coordinates of the body: interior nodes follow statically, and in modes."""
    count = int(np.sum(inside))
    require(modes >= 0, "The number of modes must not be negative, got {modes}.", modes=modes)
    if not count:
        return spread
    inner = csr_array(stiffness)[inside][:, inside]
    static = spread.toarray()
    static[inside] = -factorise(inner).solve(csr_array(stiffness @ spread)[inside].toarray())
    # The iteration finds fewer than all; a body for statics has none.
    modes = min(modes, count - 2) if mass.diagonal().any() else 0
    if modes <= 0:
        return static
    weights = csr_array(mass)[inside][:, inside]
    # Far below the first mode: those of a body that is held start above zero.
    shift = 1e-3 * float(np.sqrt(inner.diagonal().sum() / weights.diagonal().sum()))
    moving = np.zeros((len(inside), modes))
    moving[inside] = lowest_modes(inner, weights, modes, shift)[1]
    return np.concatenate([static, moving], axis=1)
