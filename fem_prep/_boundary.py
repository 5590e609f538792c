r"""A body ready to be condensed: its matrices, and what of it the outside will hold.

Unknowns are points with three components each: the nodes of the grid and, for every seat that
moves as a rigid ring, two points more, its translation and its rotation, in place of its nodes.
A seat that only averages its nodes is a set of constraints $u_s = B u$ instead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from ._artefact import rigid_motions
from ._assembly import Material, assemble, centrifugal_load, order, surface_mass
from ._checks import Progress, require, silent
from ._grid import Grid, surface_of
from ._seats import (
    RIM,
    Seat,
    averages_of,
    check_seats,
    dofs_of,
    free_nodes,
    ring_rows,
    spread_of,
)
from ._symmetry import Rotation, rotation_of


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
    - `grid_stiffness`: on the nodes of the grid, `[3 node, 3 node]` [N/m].
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
    grid_stiffness: csr_array
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
                motions[row : row + 6] = ring_rows(seat)
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
    check_seats(grid, seats)
    with progress("assembling"):
        stiffness, mass = assemble(grid, material)
        if teeth is not None:
            mass = csr_array(mass + _skin(grid, faces, teeth))
        spread = spread_of(grid, seats)
    place = _numbering(len(grid.nodes), free_nodes(grid, seats))
    probe_points = _probe_points(probes, rim, place)
    number = _numbering(len(grid.nodes), rim)
    return FullBody(
        name=name,
        grid=grid,
        material=material,
        teeth=teeth,
        stiffness=csr_array(spread.T @ stiffness @ spread),
        mass=csr_array(spread.T @ mass @ spread),
        grid_stiffness=stiffness,
        grid_mass=mass,
        spread=spread,
        rim=rim,
        rim_points=place[rim],
        rim_faces=number[faces],
        seats=tuple(seats),
        probes=dict(probes),
        probe_points=probe_points,
        averages=averages_of(grid, seats, mass, spread),
    )


def recoupled(full: FullBody) -> FullBody:
    """The same body with rigid seats (RBE2) made averaging ones (RBE3), and the other way round.

    **Arguments:**

    - `full`: the body.

    **Returns:**

    The body, without probes: they may be on seats that become rigid.
    """
    grid, mass = full.grid, full.grid_mass
    seats = tuple(replace(seat, averaging=not seat.averaging) for seat in full.seats)
    spread = spread_of(grid, seats)
    return replace(
        full,
        stiffness=csr_array(spread.T @ full.grid_stiffness @ spread),
        mass=csr_array(spread.T @ mass @ spread),
        spread=spread,
        rim_points=_numbering(len(grid.nodes), free_nodes(grid, seats))[full.rim],
        seats=seats,
        probes={},
        probe_points=np.zeros(0, dtype=int),
        averages=averages_of(grid, seats, mass, spread),
    )


def _numbering(count: int, chosen: np.ndarray) -> np.ndarray:
    """Place of each node among the chosen, -1 for all others."""
    place = np.full(count, -1)
    place[chosen] = np.arange(len(chosen))
    return place


def _probe_points(probes: Mapping[str, int], rim: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Where the probes are among the free nodes."""
    points = place[np.array(list(probes.values()), dtype=int)]
    for probe, point in zip(probes, points, strict=True):
        require(
            point >= 0 and probes[probe] not in rim,
            "The probe {name!r} must be a node of its own, neither on the rim nor on a seat that "
            "is a rigid ring: these have coordinates already.",
            name=probe,
        )
    return points


def rim_order(grid: Grid) -> np.ndarray:
    """Nodes of the rim, sorted by angle in steps that rounding cannot cross, then by z."""
    rim = np.unique(grid.sets[RIM])
    x, y, z = grid.nodes[rim].T
    size = np.ptp(grid.nodes, axis=0).max()
    # Angles count from just below -pi: the cut must not run through a line of nodes.
    angle = np.mod(np.arctan2(y, x) + np.pi + 1e-7, 2 * np.pi)
    return rim[np.lexsort((np.round(z / size, 9), np.round(angle, 6)))]


def _skin(grid: Grid, faces: np.ndarray, teeth: Teeth) -> csr_array:
    """Mass of the teeth, spread over the rim so that their polar inertia is kept."""
    area = surface_mass(grid.nodes, faces)
    turn = rigid_motions(grid.nodes)[:, 5]
    return csr_array(area * (teeth.polar_inertia / (turn @ (area @ turn))))
