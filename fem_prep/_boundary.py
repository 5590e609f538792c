r"""A body ready to be condensed: its matrices, and what of it the outside will hold.

Unknowns are points with three components each: the nodes of the grid and, for every seat that
moves as a rigid ring, two points more, its translation and its rotation, in place of its nodes.
A seat that only averages its nodes is a set of constraints $u_s = B u$ instead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_array, coo_array, csr_array

from ._artefact import rigid_motions
from ._assembly import Material, assemble, centrifugal_load, order, surface_mass
from ._checks import Progress, require, silent
from ._grid import Grid, surface_of
from ._symmetry import Rotation, rotation_of

RIM = "rim"

# How far along z a seat's point may be from its nodes, over the size of the body, if they lie in a
# plane; and how far the middle of the nodes from the axis through it, over their mean distance.
_POINT_OFF, _AROUND = 0.02, 0.2


@dataclass(frozen=True)
class Seat:
    """Nodes that a bearing, or whatever holds the body, grips, and the one node that stands for it.

    **Fields:**

    - `name`: of the seat.
    - `nodes`: the nodes it grips.
    - `point`: place of its own node, shape `[3]` [m].
    - `averaging`: False: the nodes move as one rigid ring (RBE2), which stiffens the body; True:
        the seat's node moves as their weighted mean (RBE3), which does not.
    """

    name: str
    nodes: np.ndarray
    point: np.ndarray
    averaging: bool = False


@dataclass(frozen=True)
class Teeth:
    """Teeth that the grid leaves out, as a ring on the rim.

    The skin that stands for them keeps their polar inertia; its mass is therefore larger than
    theirs, by the square of their radius of gyration over the rim's.

    **Fields:**

    - `mass`: [kg].
    - `polar_inertia`: about the axis [kg m2].
    """

    mass: float
    polar_inertia: float


@dataclass(frozen=True)
class FullBody:
    """A gear body in all its unknowns, free in space.

    **Fields:**

    - `name`: of the body.
    - `grid`: its grid.
    - `material`: its material.
    - `teeth`: teeth lumped on the rim, or None.
    - `stiffness`: shape `[3 point, 3 point]` [SI].
    - `mass`: shape `[3 point, 3 point]` [SI].
    - `grid_mass`: mass on the nodes of the grid, `[3 node, 3 node]` [kg].
    - `spread`: displacements of the nodes from the unknowns, `[3 node, 3 point]` [SI].
    - `rim`: nodes of the rim, sorted by angle, then from left to right.
    - `rim_points`: unknown points of the same.
    - `rim_faces`: elements of the rim, in nodes of the rim, `[face, 8]`.
    - `seats`: the seats.
    - `probes`: nodes whose motion is wanted, by name.
    - `probe_points`: unknown points of the probes.
    - `averages`: rows B of the seats that average, `[6 averaging seat, 3 point]` [SI].
    """

    name: str
    grid: Grid
    material: Material
    teeth: Teeth | None
    stiffness: csr_array
    mass: csr_array
    grid_mass: csr_array
    spread: csr_array
    rim: np.ndarray
    rim_points: np.ndarray
    rim_faces: np.ndarray
    seats: tuple[Seat, ...]
    probes: Mapping[str, int]
    probe_points: np.ndarray
    averages: csr_array

    @property
    def points(self) -> int:
        """Number of unknown points."""
        return order(self.stiffness) // 3

    @property
    def held(self) -> np.ndarray:
        """Unknowns that are coordinates of the condensed body too, in its order."""
        first = self.points - 2 * sum(not seat.averaging for seat in self.seats)
        return np.concatenate([dofs_of(self.rim_points), np.arange(3 * first, 3 * self.points)])

    @property
    def rigid_motions(self) -> np.ndarray:
        """Unit translations and rotations about x, y, z, shape `[3 point, 6]` [SI]."""
        motions = np.zeros((3 * self.points, 6))
        used = self.points - 2 * sum(not seat.averaging for seat in self.seats)
        motions[: 3 * used] = rigid_motions(self.grid.nodes[free_nodes(self.grid, self.seats)])
        row = 3 * used
        for seat in self.seats:
            if not seat.averaging:
                motions[row : row + 6] = _ring_rows(seat)
                row += 6
        return motions

    @property
    def centrifugal_load(self) -> np.ndarray:
        """Load per square of the speed, shape `[3 point]` [SI]."""
        return self.spread.T @ centrifugal_load(self.grid_mass, self.grid.nodes)

    def on_nodes(self, motion: np.ndarray) -> np.ndarray:
        """Motion of the nodes of the grid, `[3 point, column]` to `[column, node, 3]`."""
        return (self.spread @ motion).T.reshape(motion.shape[1], *self.grid.nodes.shape)

    def across(self, matrix: csr_array) -> csr_array:
        """A matrix on the nodes of the grid, on the unknowns."""
        return csr_array(self.spread.T @ matrix @ self.spread)

    def rotation(self, sectors: int) -> Rotation | None:
        """The rotation by one of some sectors, if the body is the same after it."""
        free = free_nodes(self.grid, self.seats)
        found = rotation_of(self.grid.nodes, sectors)
        if found is None:
            return None
        # An opening as large as one element leaves all nodes where they are.
        bricks = self.grid.bricks
        if not np.array_equal(_as_sets(found.image[bricks]), _as_sets(bricks)):
            return None
        for seat in self.seats:
            if not np.array_equal(np.sort(found.image[seat.nodes]), np.sort(seat.nodes)):
                return None
            if np.hypot(*seat.point[:2]) > 1e-9 * self.grid.radius.max():
                return None
        place = np.full(len(self.grid.nodes), -1)
        place[free] = np.arange(len(free))
        axis = np.arange(len(free), self.points)
        return Rotation(sectors, np.concatenate([place[found.image[free]], axis]))


def _as_sets(bricks: np.ndarray) -> np.ndarray:
    """Elements in an order of their own, their nodes too."""
    return np.unique(np.sort(bricks, axis=1), axis=0)


def dofs_of(points: np.ndarray) -> np.ndarray:
    """Unknowns of points: three each."""
    return (3 * np.asarray(points)[:, None] + np.arange(3)).ravel()


def free_nodes(grid: Grid, seats: Sequence[Seat]) -> np.ndarray:
    """Nodes that move on their own: all but those of rigid rings."""
    free = np.ones(len(grid.nodes), dtype=bool)
    for seat in seats:
        if not seat.averaging:
            free[seat.nodes] = False
    return np.flatnonzero(free)


def full_body(
    name: str,
    grid: Grid,
    material: Material,
    seats: Sequence[Seat],
    *,
    teeth: Teeth | None = None,
    probes: Mapping[str, int] | None = None,
    progress: Progress = silent,
) -> FullBody:
    """Assemble a body and say what of it the outside will hold.

    **Arguments:**

    - `name`: of the body.
    - `grid`: its grid, with the set "rim".
    - `material`: its material.
    - `seats`: what holds it.
    - `teeth`: teeth that the grid leaves out.
    - `probes`: nodes whose motion is wanted, by name.
    - `progress`: told what begins.

    **Returns:**

    The body.

    **Raises:**

    - `BodyError` if the rim has no faces, if a seat has fewer than three nodes, nodes on one line,
        nodes of the rim or of another seat, or a point that is not amid its nodes, or if a probe
        is on the rim or on a rigid seat.
    """
    probes = {} if probes is None else probes
    require(
        RIM in grid.sets,
        "The grid must have the set of nodes `rim`, the toothed surface; it has {sets}.",
        sets=", ".join(grid.sets) or "none",
    )
    require(
        all(0 <= node < len(grid.nodes) for node in probes.values()),
        "Probes must be nodes of the grid, 0 to {last}, got {probes}.",
        last=len(grid.nodes) - 1,
        probes=dict(probes),
    )
    rim = rim_order(grid)
    faces = surface_of(grid, RIM)
    require(
        len(faces) > 0,
        "The set `rim` must hold all nodes of some faces of the grid, got {count} nodes and no "
        "face. Select the nodes of the whole toothed surface, middles of edges too.",
        count=len(rim),
    )
    _check_seats(grid, seats)
    with progress("assembling"):
        stiffness, mass = assemble(grid, material)
        if teeth is not None:
            mass = csr_array(mass + _skin(grid, faces, teeth))
        spread = _spread(grid, seats)
    free = free_nodes(grid, seats)
    place = np.full(len(grid.nodes), -1)
    place[free] = np.arange(len(free))
    probe_points = place[np.array(list(probes.values()), dtype=int)]
    for probe, point in zip(probes, probe_points, strict=True):
        require(
            point >= 0 and probes[probe] not in rim,
            "The probe {name!r} must be a node of its own, neither on the rim nor on a seat that "
            "is a rigid ring: these have coordinates already.",
            name=probe,
        )
    number = np.full(len(grid.nodes), -1)
    number[rim] = np.arange(len(rim))
    return FullBody(
        name=name,
        grid=grid,
        material=material,
        teeth=teeth,
        stiffness=csr_array(spread.T @ stiffness @ spread),
        mass=csr_array(spread.T @ mass @ spread),
        grid_mass=mass,
        spread=spread,
        rim=rim,
        rim_points=place[rim],
        rim_faces=number[faces],
        seats=tuple(seats),
        probes=dict(probes),
        probe_points=probe_points,
        averages=_averages(grid, seats, mass, spread),
    )


def rim_order(grid: Grid) -> np.ndarray:
    """Nodes of the rim, sorted by angle in steps that rounding cannot cross, then by z."""
    rim = np.unique(grid.sets[RIM])
    x, y, z = grid.nodes[rim].T
    size = np.ptp(grid.nodes, axis=0).max()
    # Angles count from just below -pi: the cut must not run through a line of nodes.
    angle = np.mod(np.arctan2(y, x) + np.pi + 1e-7, 2 * np.pi)
    return rim[np.lexsort((np.round(z / size, 9), np.round(angle, 6)))]


def _check_seats(grid: Grid, seats: Sequence[Seat]) -> None:
    taken = {int(node): RIM for node in grid.sets[RIM]}
    require(
        len({seat.name for seat in seats}) == len(seats),
        "Seats must have names of their own, got {names}.",
        names=", ".join(seat.name for seat in seats),
    )
    for seat in seats:
        spans = np.ptp(grid.nodes[seat.nodes], axis=0) if len(seat.nodes) else np.zeros(3)
        flat = (
            np.linalg.svd(grid.nodes[seat.nodes] - grid.nodes[seat.nodes].mean(axis=0))[1]
            if (len(seat.nodes) > 2)
            else np.zeros(2)
        )
        require(
            len(seat.nodes) > 2 and flat[1] > 1e-6 * max(spans.max(), 1e-12),
            "The seat {name!r} must have at least three nodes that are not on one line, got "
            "{count}. Is it where the body has a surface, and wide enough to hold nodes?",
            name=seat.name,
            count=len(seat.nodes),
        )
        for node in seat.nodes:
            other = taken.setdefault(int(node), seat.name)
            require(
                other == seat.name,
                "A node can belong to one set only: one at {place} mm belongs to {first!r} and to "
                "{second!r}. Make one of them narrower.",
                place=", ".join(f"{1e3 * each:.3f}" for each in grid.nodes[node]),
                first=other,
                second=seat.name,
            )
    for seat in seats:
        _check_point(grid, seat)


def _check_point(grid: Grid, seat: Seat) -> None:
    """Refuse a seat's point far from its nodes: a lever arm would join them without a word."""
    nodes = grid.nodes[seat.nodes]
    low, high = nodes[:, 2].min(), nodes[:, 2].max()
    margin = max((high - low) / 2, _POINT_OFF * np.ptp(grid.nodes, axis=0).max())
    require(
        low - margin <= seat.point[2] <= high + margin,
        "The point of the seat {name!r} must lie near its nodes, got z = {at:.6g/mm} mm and nodes "
        "from {low:.6g/mm} to {high:.6g/mm} mm. Is the shaft drawn the other way round, or the "
        "order of the seats another?",
        name=seat.name,
        at=seat.point[2],
        low=low,
        high=high,
    )
    # Of a sector alone all is on one side, the rim too.
    sector = _beside(grid.nodes[grid.sets[RIM]], np.zeros(3)) > _AROUND
    require(
        sector or _beside(nodes, seat.point) <= _AROUND,
        "The nodes of the seat {name!r} must lie around its point, got the point at ({point}) mm "
        "and the middle of the nodes at ({middle}) mm. Take the nodes of the whole seat, all the "
        "way around.",
        name=seat.name,
        point=", ".join(f"{1e3 * each:.3f}" for each in seat.point),
        middle=", ".join(f"{1e3 * each:.3f}" for each in nodes.mean(axis=0)),
    )


def _beside(nodes: np.ndarray, point: np.ndarray) -> float:
    """How far the middle of nodes is from the axis through a point, over their mean distance."""
    off = nodes[:, :2] - point[:2]
    return float(np.hypot(*off.mean(axis=0)) / np.hypot(*off.T).mean())


def _skin(grid: Grid, faces: np.ndarray, teeth: Teeth) -> csr_array:
    """Mass of the teeth, spread over the rim so that their polar inertia is kept."""
    area = surface_mass(grid.nodes, faces)
    turn = rigid_motions(grid.nodes)[:, 5]
    return csr_array(area * (teeth.polar_inertia / (turn @ (area @ turn))))


def _ring_rows(seat: Seat) -> np.ndarray:
    """Translation and rotation of a seat's own node in rigid motions of the body, `[6, 6]`."""
    rows = np.zeros((6, 6))
    rows[:3] = rigid_motions(seat.point[None])
    rows[3:, 3:] = np.eye(3)
    return rows


def _spread(grid: Grid, seats: Sequence[Seat]) -> csr_array:
    """Displacements of all nodes from the unknowns: rigid rings follow their own node."""
    rigid = [seat for seat in seats if not seat.averaging]
    free = free_nodes(grid, seats)
    count = 3 * len(grid.nodes)
    rows = dofs_of(free)
    parts = [coo_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), (count, len(rows)))]
    for seat in rigid:
        motion = rigid_motions(grid.nodes[seat.nodes] - seat.point)
        rows = np.repeat(dofs_of(seat.nodes), 6)
        columns = np.tile(np.arange(6), len(motion))
        parts.append(coo_array((motion.ravel(), (rows, columns)), (count, 6)))
    spread = csr_array(block_array([parts]))
    spread.eliminate_zeros()
    return spread


def _averages(grid: Grid, seats: Sequence[Seat], mass: csr_array, spread: csr_array) -> csr_array:
    r"""Rows that give the weighted mean translation and rotation of the nodes of a seat.

    The rigid motion nearest to that of the nodes, by least squares: $B = (R^T w R)^{-1} R^T w$.
    Weights are what a unit acceleration of the body puts on each node, always positive here as
    rows of a consistent mass need not be: the diagonal.
    """
    blocks = []
    for seat in seats:
        if not seat.averaging:
            continue
        dofs = dofs_of(seat.nodes)
        weights = mass.diagonal()[dofs]
        motion = rigid_motions(grid.nodes[seat.nodes] - seat.point)
        rows = np.linalg.solve(motion.T @ (weights[:, None] * motion), motion.T * weights)
        places = (np.repeat(np.arange(6), len(dofs)), np.tile(dofs, 6))
        blocks.append(coo_array((rows.ravel(), places), (6, 3 * len(grid.nodes))))
    if not blocks:
        return csr_array((0, int(spread.indices.max()) + 1))
    return csr_array(csr_array(block_array([[each] for each in blocks])) @ spread)
