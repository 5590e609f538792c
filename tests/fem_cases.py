"""Grids whose answers are known in closed form, and small wheels to condense.

The bricks are laid here by a plain lattice of its own, so that a fault in one of the grids of
`fem_prep` cannot hide another in its elements.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csc_array, csr_array, eye_array, vstack

from fem_prep._artefact import ReducedBody
from fem_prep._assembly import Material, assemble, order
from fem_prep._boundary import FullBody, full_body
from fem_prep._grid import EDGES, Grid
from fem_prep._modes import lowest_modes, reduced_modes
from fem_prep._seats import Seat
from fem_prep._solvers import factorise
from fem_prep._web import GearBody, Holes, MeshSizing, Web, body_grid

STEEL = Material(2.1e11, 0.3, 7850.0)
# Without Poisson's effect, bars and discs of any thickness follow the theory of thin ones.
CORK = Material(2.1e11, 0.0, 7850.0)

# Places of the nodes of VTK's quadratic hexahedron, each coordinate -1, 0 or 1.
CORNERS = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
MIDDLES = [(0, -1), (1, 0), (0, 1), (-1, 0)]
SIGNS = np.array(
    [(*at, z) for z in (-1, 1) for at in CORNERS]
    + [(*at, z) for z in (-1, 1) for at in MIDDLES]
    + [(*at, 0) for at in CORNERS]
)


def lattice(
    x: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    *,
    place: Callable[[np.ndarray], np.ndarray] = lambda at: at,
    keep: Callable[[np.ndarray], np.ndarray] = lambda at: np.ones(len(at), dtype=bool),
    closed: bool = False,
) -> Grid:
    """Bricks between planes of constant x, y and z, moved to where `place` puts their nodes.

    **Arguments:**

    - `x`, `y`, `z`: the planes.
    - `place`: nodes from lattice coordinates, shape `[node, 3]` both.
    - `keep`: whether a brick is there, by its middle in lattice coordinates.
    - `closed`: the last plane of constant y is the first.
    """
    planes = [np.asarray(each, dtype=float) for each in (x, y, z)]
    axes = [np.interp(np.arange(2 * len(a) - 1) / 2, np.arange(len(a)), a) for a in planes]
    middles = np.stack(np.meshgrid(*(np.arange(1, len(a), 2) for a in axes), indexing="ij"), -1)
    middles = middles.reshape(-1, 3)
    at = np.stack([axis[n] for axis, n in zip(axes, middles.T, strict=True)], axis=1)
    numbers = middles[keep(at)][:, None] + SIGNS
    if closed:
        numbers[..., 1] %= len(axes[1]) - 1
    shape = [len(axis) for axis in axes]
    used, bricks = np.unique(np.ravel_multi_index(tuple(numbers.T), shape), return_inverse=True)
    found = np.unravel_index(used, shape)
    nodes = place(np.stack([axis[n] for axis, n in zip(axes, found, strict=True)], axis=1))
    return Grid(nodes, bricks.reshape(20, -1).T)


def block(x: float, y: float, z: float, counts: tuple[int, int, int]) -> Grid:
    """A box from the origin, of the given edges and numbers of bricks along them."""
    edges = (np.linspace(0, a, n + 1) for a, n in zip((x, y, z), counts, strict=True))
    return lattice(*edges)


def ring(radii: ArrayLike, around: int, heights: ArrayLike, *, keep=None, place=None) -> Grid:
    """A body swept about z: sets "rim" and "bore" are its outermost and innermost nodes.

    **Arguments:**

    - `radii`: edges of the bricks along the radius [m].
    - `around`: bricks around; edges lie at `(j - 1/2) 2 pi / around`.
    - `heights`: edges along the axis [m].
    - `keep`: whether a brick is there, by the radius, angle and height of its middle.
    - `place`: radius, angle and height of nodes from those of the lattice.
    """
    angles = (np.arange(around + 1) - 0.5) * 2 * np.pi / around

    def turned(at: np.ndarray) -> np.ndarray:
        r, angle, z = (at if place is None else place(at)).T
        return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)

    extra = {} if keep is None else {"keep": keep}
    grid = lattice(radii, angles, heights, place=turned, closed=True, **extra)
    r = grid.radius
    near = 1e-9 * r.max()
    sets = {
        "rim": np.flatnonzero(r > r.max() - near),
        "bore": np.flatnonzero(r < r.min() + near),
    }
    return replace(grid, sets=sets)


def straightened(grid: Grid) -> Grid:
    """The grid with every node between two corners half way between them."""
    nodes = grid.nodes.copy()
    first, last, middle = grid.bricks[:, EDGES].reshape(-1, 3).T
    nodes[middle] = (nodes[first] + nodes[last]) / 2
    return replace(grid, nodes=nodes)


def shaken(grid: Grid, by: float, *, curved: bool = False) -> Grid:
    """The grid with every node moved at random by up to `by` [m] along each axis."""
    moved = grid.nodes + np.random.default_rng(1).uniform(-by, by, grid.nodes.shape)
    return replace(grid, nodes=moved) if curved else straightened(replace(grid, nodes=moved))


def assert_near(found: np.ndarray, wanted: np.ndarray, share: float) -> None:
    """Compare arrays; a difference is measured against the largest number wanted."""
    found, wanted = np.asarray(found), np.asarray(wanted)
    off, size = abs(found - wanted).max(), abs(wanted).max()
    assert off <= share * size, f"off by {off / size:.3g} of {size:.6g}, wanted {share}"


def linear_field(grid: Grid, slopes: np.ndarray) -> np.ndarray:
    """Displacements u = A x of all nodes, shape `[3 node]`."""
    return (grid.nodes @ np.transpose(slopes)).ravel()


def dofs(nodes: ArrayLike, *axes: int) -> np.ndarray:
    """Unknowns of nodes along some axes, all three by default."""
    return (3 * np.asarray(nodes)[:, None] + np.array(axes or (0, 1, 2))).ravel()


def modes_without(
    grid: Grid, material: Material, fixed: np.ndarray, count: int, shift: float
) -> np.ndarray:
    """Lowest angular frequencies [rad/s] of a grid with some unknowns held at zero."""
    stiffness, mass = assemble(grid, material)
    return frequencies(stiffness, mass, fixed, count, shift)


def frequencies(
    stiffness: csr_array, mass: csr_array, fixed: np.ndarray, count: int, shift: float
) -> np.ndarray:
    """Lowest angular frequencies [rad/s] with some unknowns held at zero."""
    free = np.setdiff1d(np.arange(order(stiffness)), fixed)
    square, _ = lowest_modes(stiffness[free][:, free], mass[free][:, free], count, shift)
    return np.sqrt(np.abs(square))


def small_wheel(around: int = 12, radial: int = 3) -> Grid:
    """A hub, a thin web and a rim, cut coarsely; radii 20, 25, 59 and 63.4 mm."""
    radii = 1e-3 * np.array([20, *np.linspace(25, 59, radial + 1), 63.43155])
    heights = 1e-3 * np.array([-4.75, -1.5, 1.5, 4.75])

    def keep(at: np.ndarray) -> np.ndarray:
        in_web = (at[:, 0] > 25e-3) & (at[:, 0] < 59e-3)
        return ~in_web | (abs(at[:, 2]) < 1.5e-3)

    return ring(radii, around, heights, keep=keep)


ACCESSORY_WEB = Web(hub_outer=50e-3, thickness=3e-3, rim_inner=118e-3)
ACCESSORY = GearBody(rim_outer=126.8631e-3, rim_width=9.5e-3, bore=40e-3, web=ACCESSORY_WEB)
ACCESSORY_FINENESS = MeshSizing(sectors=86, rim_axial=3, rim_radial=1, web_radial=12, hub_radial=2)


def accessory_wheel(
    holes: tuple[Holes, ...] = (), fineness: MeshSizing = ACCESSORY_FINENESS
) -> Grid:
    """The wheel of an accessory gearbox, 37,000 degrees of freedom by default."""
    web = replace(ACCESSORY_WEB, holes=holes)
    return body_grid(replace(ACCESSORY, web=web), fineness)


def bore_seat(grid: Grid, averaging: bool = False) -> Seat:
    """A seat on the whole bore."""
    name = "bore" if "bore" in grid.sets else "seat:bore"
    return Seat("bore", grid.sets[name], np.zeros(3), averaging)


def two_seats(grid: Grid) -> list[Seat]:
    """One that averages at the left end of the bore, a rigid ring at its right end."""
    bore = grid.sets["bore"]
    z = grid.nodes[bore, 2]
    left, right = bore[z < -4e-3], bore[z > 3e-3]
    points = np.array([[0, 0, -4.5e-3], [1e-3, 0, 4e-3]])
    return [Seat("left", left, points[0], True), Seat("right", right, points[1])]


def wheel_body(
    grid: Grid, seats: str = "ring", *, material: Material = STEEL, **others
) -> FullBody:
    """A wheel ready to be condensed, its seats "ring", "mean", "both" or "none"."""
    held = {
        "ring": lambda: [bore_seat(grid)],
        "mean": lambda: [bore_seat(grid, averaging=True)],
        "both": lambda: two_seats(grid),
        "none": list,
    }
    return full_body("wheel", grid, material, held[seats](), **others)


def web_probe(grid: Grid) -> int:
    """A node of the web at about mid-radius."""
    r, z = grid.radius, grid.nodes[:, 2]
    return int(np.argmin(abs(r - (r.min() + r.max()) / 2) + abs(z)))


def boundary_rows(full: FullBody) -> csr_array:
    """Coordinates of the boundary from the unknowns, `[boundary, 3 point]`: rim, then seats."""
    unit = csr_array(eye_array(3 * full.points))
    rows = [unit[dofs(full.rim_points)]]
    ring, mean = 3 * (full.points - 2 * sum(not seat.averaging for seat in full.seats)), 0
    for seat in full.seats:
        if seat.averaging:
            rows.append(full.averages[mean : mean + 6])
            mean += 6
        else:
            rows.append(unit[ring : ring + 6])
            ring += 6
    return csr_array(vstack(rows))


BEARING = np.diag([1e8, 1.3e8, 5e7, 4e4, 5e4, 2e4])


def pulls_on(full: FullBody, mesh: float = 3e8, bearing: np.ndarray = BEARING) -> np.ndarray:
    """Springs of unit stiffness on the boundary: bearings at all seats, one through a tooth's root.

    A row gives the stretch of one of them.
    """
    seats = np.kron(np.eye(len(full.seats)), np.linalg.cholesky(bearing).T)
    seats = np.pad(seats, [(0, 0), (3 * len(full.rim), 0)])
    return np.vstack([seats, np.sqrt(mesh) * tooth_load(full)])


def springs_on(full: FullBody, mesh: float = 3e8) -> np.ndarray:
    """Stiffness of the same springs on the boundary."""
    pulls = pulls_on(full, mesh)
    return pulls.T @ pulls


def tooth_load(full: FullBody) -> np.ndarray:
    """A unit force on the boundary along a line of action, on the line of the rim nearest to x."""
    place = full.grid.nodes[full.rim]
    angle = np.arctan2(place[:, 1], place[:, 0])
    line = np.flatnonzero(abs(angle - angle[np.argmin(abs(angle))]) < 1e-6)
    load = np.zeros(3 * len(full.rim) + 6 * len(full.seats))
    load[dofs(line)] = np.tile([-0.35, 0.9, 0.25], len(line)) / len(line)
    return load


def on_springs(full: FullBody, springs: np.ndarray) -> csr_array:
    """Stiffness of a full body whose boundary is on springs."""
    rows = boundary_rows(full)
    return csr_array(full.stiffness + rows.T @ csr_array(springs) @ rows)


def padded(body: ReducedBody, of: np.ndarray) -> np.ndarray:
    """Loads or springs on the boundary of a condensed body, on all its coordinates."""
    return np.pad(of, [(0, body.interior)] * of.ndim)


def sprung_modes(body: ReducedBody, count: int, pulls: np.ndarray) -> np.ndarray:
    """Squares of the lowest angular frequencies of a condensed body on springs."""
    square, _ = reduced_modes(body, count, np.pad(pulls, [(0, 0), (0, body.interior)]))
    return square


def answer(stiffness: csr_array, load: np.ndarray) -> np.ndarray:
    """Static motion under a load."""
    return factorise(csc_array(stiffness)).solve(load)


def rotating_terms(body: ReducedBody) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coriolis matrix, spin softening and stress stiffening of a body condensed with them."""
    assert body.coriolis is not None
    assert body.spin_softening is not None
    assert body.stress_stiffening is not None
    return body.coriolis, body.spin_softening, body.stress_stiffening
