"""Grids in files: the user's own is read, and results are written for ParaView.

The only place that knows meshio. It speaks on the terminal and ends the process where a file is
not what it should be; here it is silenced, and its mistakes become a `BodyError`.
"""

import contextlib
import difflib
import io
import os
import re
import warnings
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from pathlib import Path

import meshio
import numpy as np
from scipy.spatial import KDTree

from ._checks import BodyError, require
from ._deck import Deck
from ._decks import read_abaqus
from ._grid import Grid
from ._nastran_deck import read_nastran
from ._symmetry import Rotation

# What lies on the surface of a solid or beside it, and says nothing about it.
_FLAT = re.compile(r"(vertex|line|triangle|quad|polygon|pixel)\d*$|empty$")

# Names of bricks with corner nodes only, in the formats that are read.
_LINEAR = "hexahedron$|C3D8|CHEXA"

# How far a turned node may be from its place in a body that repeats around the axis, over the
# body's size: eight characters, sign and point among them, are good to 7e-6; more is no rounding.
_NEARLY = 1e-5

# What is rounding in the last digits of a number, over the body's size.
_EXACTLY = 1e-12

_DIMENSIONS = ("point", "line", "surface", "volume")

_HOW = {
    ".inp": "In an Abaqus file they are *NSET, NSET=name.",
    ".bdf": "In a Nastran file they are SET n = ... (of grid points) in the case control, SET1 or "
    "SET3; their names are their numbers, as '7'.",
    ".msh": "In Gmsh they are physical groups: of the surfaces that carry the teeth and the "
    "bearings, and one of the volume, without which Gmsh does not write it.",
    ".vtu": "In a VTU file they are point data of whole numbers, 1 in the set and 0 outside.",
}


def read_grid(
    path: str | os.PathLike[str],
    *,
    rim: str,
    seats: Mapping[str, str] | None = None,
    probes: Mapping[str, str] | None = None,
    length_unit: float = 1e-3,
) -> Grid:
    """Read the user's own grid of 20-node bricks.

    Abaqus and CalculiX (.inp: C3D20, C3D20R; *NSET), Nastran (.bdf, .nas, .dat: CHEXA; SET,
    SET1, SET3), Gmsh (.msh, versions 2 and 4; physical groups) and VTU (quadratic hexahedra;
    point data). Of 27-node bricks the first 20 nodes are used. Elements of surfaces, lines and
    points are left out, as are nodes without a brick. The grid must be that of the body without
    teeth; it is moved along z until the middle of the rim is at z = 0. Nodes that repeat around
    the axis but for the digits of a text file are moved until they do so exactly, by 1e-5 of the
    size of the body at most. Whether it can be a gear body, `check_grid` says.

    **Arguments:**

    - `path`: the file.
    - `rim`: name of the set of nodes on the cylinder that carries the teeth.
    - `seats`: for the name of every bearing seat, the name of its set.
    - `probes`: for the name of every probe, the name of the set of its node.
    - `length_unit`: the file's unit of length [m].

    **Returns:**

    The grid, with the sets `rim`, `seat:NAME` and `probe:NAME`.

    **Raises:**

    - `BodyError` if the file cannot be read, has elements other than 20-node bricks, or no set
        of that name.
    """
    path = Path(path)
    require(
        np.isfinite(length_unit) and length_unit > 0,
        "{length_unit} must be a length in metres, as 1e-3 for a file in millimetres, got {value}.",
        value=length_unit,
    )
    deck = _read(path)
    _require_bricks(path, deck)
    wanted = {"rim": rim}
    wanted |= {f"seat:{name}": label for name, label in (seats or {}).items()}
    wanted |= {f"probe:{name}": label for name, label in (probes or {}).items()}
    used = np.unique(deck.bricks)
    place = np.full(len(deck.nodes), -1)
    place[used] = np.arange(len(used))
    sets = {}
    for name, label in wanted.items():
        nodes = place[_found(path, deck, label)]
        sets[name] = np.unique(nodes[nodes >= 0])
        require(
            len(sets[name]) > 0,
            "The set '{label}' of '{path}' has {count} nodes, none of which belongs to a brick.",
            label=label,
            path=path.name,
            count=len(nodes),
        )
    nodes = length_unit * deck.nodes[used]
    require(
        np.isfinite(nodes).all(),
        "'{path}' has nodes with coordinates that are not finite numbers. Write it again.",
        path=path.name,
    )
    along = nodes[sets["rim"], 2]
    nodes[:, 2] -= (along.min() + along.max()) / 2
    return Grid(_evened(nodes, sets["rim"]), place[deck.bricks], sets)


def _evened(nodes: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Nodes that repeat around the axis exactly, if they do so to the digits of a text file.

    Each becomes the mean of all its images, turned back. Solving wave by wave needs that: what
    one sector says for all strains rigid motions by the error of its places.
    """
    tree, all_nodes = KDTree(nodes), np.arange(len(nodes))
    size = float(np.ptp(nodes, axis=0).max())
    for sectors in range(len(rim), 1, -1):
        if len(rim) % sectors:
            continue
        turn = Rotation(sectors, all_nodes).matrix(1).T
        # A few nodes say mostly that it is another number.
        if tree.query(nodes[rim[:8]] @ turn)[0].max() > _NEARLY * size:
            continue
        distance, nearest = tree.query(nodes @ turn)
        if distance.max() > _NEARLY * size:
            continue
        if distance.max() <= _EXACTLY * size:
            return nodes
        total, at, image = np.zeros_like(nodes), all_nodes, np.asarray(nearest)
        for back in Rotation(sectors, all_nodes).matrices:
            total += nodes[at] @ back
            at = image[at]
        if np.array_equal(at, all_nodes):
            # Angles of nodes on the x axis must not jump by a turn.
            return np.where(abs(total) <= _EXACTLY * size, 0.0, total / sectors)
    return nodes


def write_vtu(
    path: str | os.PathLike[str], grid: Grid, fields: Mapping[str, np.ndarray] | None = None
) -> None:
    """Write a grid and fields on its nodes for ParaView.

    Sets are written too, as point data of 1 and 0 under their names, so that `read_grid` can
    read the file (with `length_unit=1.0`).

    **Arguments:**

    - `path`: the file, with the ending .vtu.
    - `grid`: the grid; the file is in metres.
    - `fields`: named values, shape `[node]`, or vectors, shape `[node, 3]`; of several mode
        shapes each is a field of its own.

    **Raises:**

    - `BodyError` if a field does not fit the grid, or the file cannot be written.
    """
    path = Path(path)
    require(path.suffix == ".vtu", "The file must end with .vtu, got '{path}'.", path=path)
    members = {name: np.zeros(len(grid.nodes), np.int8) for name in grid.sets}
    for name, nodes in grid.sets.items():
        members[name][nodes] = 1
    data = {name: _field(grid, name, values) for name, values in (fields or {}).items()}
    twice = sorted(members.keys() & data.keys())
    require(not twice, "A field and a set have the same name: {twice}.", twice=", ".join(twice))
    cells: list = [("hexahedron20", grid.bricks)]
    mesh = meshio.Mesh(grid.nodes, cells, point_data={**data, **members})
    unfinished = path.with_name(path.name + ".part")
    try:
        with _silenced():
            mesh.write(unfinished, file_format="vtu")
        unfinished.replace(path)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise BodyError(f"'{path}' cannot be written: {error.strerror}.") from error


def _field(grid: Grid, name: str, values: np.ndarray) -> np.ndarray:
    values = np.asarray(values)
    count = len(grid.nodes)
    require(
        values.shape in ((count,), (count, 3)) and values.dtype.kind in "biuf",
        "The field '{name}' must have the shape [{count}] or [{count}, 3] and be real, got "
        "{shape} of {dtype}.",
        name=name,
        count=count,
        shape=list(values.shape),
        dtype=values.dtype,
    )
    return values.astype({"b": np.int8, "f": float}.get(values.dtype.kind, values.dtype))


def _read(path: Path) -> Deck:
    """What is in a file, by its ending."""
    require(path.exists(), "There is no file '{path}'.", path=path)
    require(path.is_file(), "'{path}' is a folder, not a file.", path=path)
    require(path.stat().st_size > 0, "The file '{path}' is empty.", path=path)
    readers: dict[str, Callable[[Path], Deck]] = {
        ".inp": read_abaqus,
        **dict.fromkeys((".bdf", ".nas", ".dat"), read_nastran),
        ".msh": _read_gmsh,
        ".vtu": _read_vtu,
    }
    require(
        path.suffix.lower() in readers,
        "A grid is read from a file that ends with {endings}, got '{path}'.",
        endings=", ".join(readers),
        path=path,
    )
    return readers[path.suffix.lower()](path)


def _require_bricks(path: Path, deck: Deck) -> None:
    found = [f"{count} {name}" for name, count in deck.others.items()]
    linear = any(re.match(_LINEAR, name) for name in deck.others)
    require(
        not found,
        "'{path}' has elements that cannot be used, {found}, besides {count} quadratic bricks. "
        "A gear body is made of 20-node bricks only (C3D20, CHEXA with 20 nodes, hexahedron20).",
        path=path.name,
        found=" and ".join(found),
        count=len(deck.bricks),
        remedy="Linear bricks are far too stiff in bending: mesh again with quadratic ones, with "
        "mid nodes on the geometry."
        if linear
        else "Mesh the body by sweeping its section around the axis.",
    )
    require(
        len(deck.bricks) > 0,
        "'{path}' has no solid elements. A gear body is made of 20-node bricks (C3D20, CHEXA with "
        "20 nodes, hexahedron20).{hint}",
        path=path.name,
        hint=" Gmsh writes them only if the volume is a physical group." * (path.suffix == ".msh"),
    )


def _found(path: Path, deck: Deck, label: str) -> np.ndarray:
    """Nodes of a set by its name, in capitals or not."""
    if label in deck.sets:
        return deck.sets[label]
    alike = [name for name in deck.sets if name.casefold() == label.casefold()]
    if len(alike) == 1:
        return deck.sets[alike[0]]
    plain = {name.casefold(): name for name in deck.sets}
    near = difflib.get_close_matches(label.casefold(), plain, n=1)
    sizes = [f"'{name}' ({len(nodes)} nodes)" for name, nodes in deck.sets.items()]
    suffix = path.suffix.lower()
    raise BodyError(
        f"'{path.name}' has no set of nodes named '{label}'. "
        + (f"Did you mean '{plain[near[0]]}'? " if near else "")
        + (f"It has {', '.join(sizes[:30])}. " if sizes else "It has none. ")
        + (f"There are {len(sizes) - 30} more. " if len(sizes) > 30 else "")
        + _HOW.get(suffix, _HOW[".bdf"])
    )


def _read_gmsh(path: Path) -> Deck:
    mesh = _meshio(path, meshio.gmsh.read)
    names = {(int(kind), int(tag)): name for name, (tag, kind) in mesh.field_data.items()}
    members: dict[str, list[np.ndarray]] = {}
    for block, tags in zip(mesh.cells, mesh.cell_data.get("gmsh:physical", []), strict=False):
        tags = np.asarray(tags)
        for tag in np.unique(tags[tags > 0]):
            unnamed = f"{_DIMENSIONS[block.dim]} {tag}"
            name = names.get((block.dim, int(tag)), unnamed)
            members.setdefault(name, []).append(block.data[tags == tag].ravel())
    sets = {name: np.unique(np.concatenate(nodes)) for name, nodes in members.items()}
    return _sorted_out(path, mesh, sets)


def _read_vtu(path: Path) -> Deck:
    # meshio keeps the last piece of several and drops the others.
    pieces = len(re.findall(rb"<Piece\b", path.read_bytes()))
    require(
        pieces < 2,
        "'{path}' is written in {pieces} pieces. Write it as one (ParaView: filter Merge Blocks "
        "or Clean to Grid, then save).",
        path=path.name,
        pieces=pieces,
    )
    mesh = _meshio(path, meshio.vtu.read)
    sets = {}
    for name, values in mesh.point_data.items():
        flat = np.asarray(values).reshape(len(mesh.points), -1)
        if flat.shape[1] == 1 and np.isin(flat, (0, 1)).all():
            sets[name] = np.flatnonzero(flat)
    return _sorted_out(path, mesh, sets)


def _meshio(path: Path, reader: Callable[[str], meshio.Mesh]) -> meshio.Mesh:
    """A file as meshio reads it, or an error that tells what it told."""
    said = io.StringIO()
    try:
        with _silenced(said):
            return reader(str(path))
    # It raises whatever the wrong byte leads to: no list of exceptions is complete.
    except (Exception, SystemExit) as error:
        told = " ".join(f"{error} {said.getvalue()}".split()) or type(error).__name__
        raise BodyError(
            f"'{path.name}' cannot be read as a {path.suffix} file: {told[:300]}. It may be cut "
            "short, or of another kind or version; write it again (Gmsh: version 2.2; VTU: "
            "compressed with ZLib or not at all)."
        ) from error


@contextlib.contextmanager
def _silenced(said: io.StringIO | None = None) -> Generator[None]:
    """Nothing on the terminal, which is for results, and no warnings; `said` takes them."""
    said = said or io.StringIO()
    with (
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        yield


def _sorted_out(path: Path, mesh: meshio.Mesh, sets: Mapping[str, np.ndarray]) -> Deck:
    """Bricks of all blocks together, other solids counted, the rest left out."""
    bricks, others = [], Counter()
    for block in mesh.cells:
        if block.type in ("hexahedron20", "hexahedron27"):
            # The 20 nodes come first; those of faces and centre follow.
            bricks.append(np.asarray(block.data, dtype=int)[:, :20])
        elif not _FLAT.match(block.type):
            others[block.type] += len(block.data)
    together = np.concatenate(bricks) if bricks else np.empty((0, 20), dtype=int)
    nodes = np.asarray(mesh.points, dtype=float)
    require(
        nodes.ndim == 2
        and nodes.shape[1] == 3
        and (together.min(initial=0) >= 0)
        and (together.max(initial=0) < max(len(nodes), 1)),
        "'{path}' names nodes that it does not define, or gives them no three coordinates. It is "
        "cut short or damaged; write it again.",
        path=path.name,
    )
    return Deck(nodes, together, sets, dict(others))
