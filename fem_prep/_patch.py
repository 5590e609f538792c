"""A piece of a grid around a place on its rim, and the same piece of smaller elements.

Loads on a small patch of the rim deflect it by more than elements larger than the patch can show.
How much more is a matter of the neighbourhood alone: both pieces, held where they are cut, give it.
"""

import itertools

import numpy as np

from ._assembly import Material, assemble
from ._brick import REFERENCE_NODES, jacobians, shape_functions
from ._grid import FACES, Grid, merged, surface
from ._solvers import compliance_at

RIM, CUT = "rim", "cut"
# Of the size of the piece: how close nodes are that are one.
_SAME = 1e-7


def piece_of(
    nodes: np.ndarray,
    bricks: np.ndarray,
    *,
    radius: float,
    angles: tuple[float, float],
    depth: float | np.ndarray,
) -> Grid:
    """The elements under a part of the rim.

    **Arguments:**

    - `nodes`: of the whole grid, shape `[node, 3]` [m].
    - `bricks`: of the whole grid, shape `[brick, 20]`.
    - `radius`: of the rim [m].
    - `angles`: between which the middles of the elements lie, the first the lower [rad].
    - `depth`: how far under the rim the middles of the elements lie at the most, of all or of each
        brick [m].

    **Returns:**

    A grid with the sets `rim`, nodes of the toothed surface, and `cut`, nodes where the rest of the
    body went on.
    """
    middles = nodes[bricks[:, :8]].mean(axis=1)
    width = angles[1] - angles[0]
    around = (np.arctan2(middles[:, 1], middles[:, 0]) - angles[0]) % (2.0 * np.pi) <= width
    inside = around & (np.hypot(*middles.T[:2]) >= radius - depth)
    rest = np.zeros(len(nodes), dtype=bool)
    rest[bricks[~inside]] = True
    used, own = np.unique(bricks[inside], return_inverse=True)
    grid = Grid(nodes[used], own.reshape(-1, 20))
    cut = np.flatnonzero(rest[used])
    outer = surface(grid)
    corners = grid.radius[outer[:, :4]]
    # Corners are on the circle; the surface of straight elements would be within it elsewhere.
    toothed = outer[(np.abs(corners - radius) < 1e-3 * radius).all(axis=1)]
    return Grid(grid.nodes, grid.bricks, {RIM: np.unique(toothed), CUT: cut})


def refined(grid: Grid, around: int, deep: int, across: int) -> Grid:
    """The same piece of smaller elements, within the old ones.

    **Arguments:**

    - `grid`: with the sets `rim` and `cut`.
    - `around`, `deep`, `across`: parts of each element around the axis, along the radius, along the
        axis.

    **Returns:**

    The finer grid, of the same shape to the last digit, with the same sets.
    """
    parts = _parts_along(grid, (around, deep, across))
    places, owners = [], []
    for division in np.unique(parts, axis=0):
        bricks = np.flatnonzero((parts == division).all(axis=1))
        steps = np.array(list(itertools.product(*(range(n) for n in division))))
        local = (REFERENCE_NODES[None] + steps[:, None]) / division
        values = shape_functions(local.reshape(-1, 3))[0]
        placed = np.einsum("pn,bni->bpi", values, grid.nodes[grid.bricks[bricks]])
        places.append(placed.reshape(-1, 3))
        owners.append(
            np.stack([_on_sets(grid, name, bricks, local.reshape(-1, 3)) for name in (RIM, CUT)])
        )
    nodes = np.concatenate(places)
    marks = np.concatenate([each.reshape(2, -1) for each in owners], axis=1)
    size = np.ptp(nodes, axis=0).max()
    kept, fine = merged(nodes, np.arange(len(nodes)).reshape(-1, 20), _SAME * size)
    sets = {
        name: np.unique(fine.ravel()[mark]) for name, mark in zip((RIM, CUT), marks, strict=True)
    }
    return Grid(kept, fine, sets)


def piece_compliance(grid: Grid, material: Material, nodes: np.ndarray) -> np.ndarray:
    """What nodes of a piece that is held at its cut give under loads on them.

    **Arguments:**

    - `grid`: with the set `cut`.
    - `material`: of the body.
    - `nodes`: numbers of some nodes, shape `[node]`.

    **Returns:**

    Compliance between their displacements, those of the cut none, shape `[3 node, 3 node]` [m/N].
    """
    stiffness, _ = assemble(grid, material)
    free = np.setdiff1d(np.arange(len(grid.nodes)), grid.sets[CUT])
    kept = (3 * free[:, None] + np.arange(3)).ravel()
    moves = np.isin(nodes, free)
    found = compliance_at(stiffness[kept][:, kept], np.searchsorted(free, nodes[moves]))
    given = np.zeros((3 * len(nodes),) * 2)
    given[np.ix_(*[np.repeat(moves, 3)] * 2)] = found
    return given


def _parts_along(grid: Grid, wanted: tuple[int, int, int]) -> np.ndarray:
    """Parts of every brick along its own three directions, shape `[brick, 3]`."""
    middle = np.full((1, 3), 0.5)
    corners = grid.nodes[grid.bricks]
    along = jacobians(corners, shape_functions(middle)[1])[:, 0]
    centre = corners[:, :8].mean(axis=1)
    angle = np.arctan2(centre[:, 1], centre[:, 0])
    cosine, sine, none = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    # Around, deep, across.
    axes = np.stack(
        [
            np.stack([-sine, cosine, none], axis=1),
            np.stack([cosine, sine, none], axis=1),
            np.stack([none, none, none + 1.0], axis=1),
        ],
        axis=1,
    )
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    match = np.abs(np.einsum("bai,bij->baj", axes, along))
    orders = list(itertools.permutations(range(3)))
    scores = np.stack([match[:, [0, 1, 2], order].sum(axis=1) for order in orders], axis=1)
    best = np.array(orders)[scores.argmax(axis=1)]
    parts = np.empty((len(grid.bricks), 3), dtype=int)
    np.put_along_axis(parts, best, np.broadcast_to(wanted, parts.shape), axis=1)
    return parts


def _on_sets(grid: Grid, name: str, bricks: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Which places in bricks lie on a face of theirs whose nodes are all in a set."""
    member = np.zeros(len(grid.nodes), dtype=bool)
    member[grid.sets[name]] = True
    whole = member[grid.bricks[bricks][:, FACES]].all(axis=2)
    on_face = np.zeros((len(FACES), len(local)), dtype=bool)
    for number, face in enumerate(FACES):
        corners = REFERENCE_NODES[face[:4]]
        axis = int(np.argmin(np.ptp(corners, axis=0)))
        on_face[number] = np.abs(local[:, axis] - corners[0, axis]) < 1e-9
    return (whole.astype(int) @ on_face.astype(int) > 0).ravel()
