"""Whether a grid can be a gear body: the quality of its bricks, its frame, its rim and its seats.

A grid that cannot be is refused with what is wrong, where, and what to do. Places are told in
millimetres, as the user's mesher tells them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ._brick import REFERENCE_NODES, gauss_points, jacobians, shape_functions
from ._checks import require
from ._grid import EDGES, Grid, parts
from ._rim_quality import check_rim, place_of, require_sets

# A gear body outside of these sizes [m] is more likely one in the wrong unit.
_SMALLEST = 3e-3
_LARGEST = 5.0

# How far a mid node may lie from the middle of its edge's chord, over the chord. An arc of 120
# degrees, coarser than anyone meshes, has 0.29.
_OFF_EDGE = 0.4

# Jacobian over the brick's largest one, below which a brick counts as collapsed.
_COLLAPSED = 1e-6


@dataclass(frozen=True)
class Quality:
    """How well shaped the bricks of a grid are.

    **Fields:**

    - `jacobian_ratio`: smallest Jacobian determinant over the largest in size, at the nodes and
        integration points of every brick, shape `[brick]` [-]; 1 is a parallelepiped, zero or
        less is a collapsed or inverted brick.
    - `aspect_ratio`: longest edge over the shortest, shape `[brick]` [-].
    - `worst`: index of the brick with the smallest Jacobian ratio.
    - `place`: middle of that brick, shape `[3]` [m].
    """

    jacobian_ratio: np.ndarray
    aspect_ratio: np.ndarray
    worst: int
    place: np.ndarray

    @property
    def smallest_jacobian_ratio(self) -> float:
        """Jacobian ratio of the worst brick [-]."""
        return float(self.jacobian_ratio[self.worst])

    @property
    def largest_aspect_ratio(self) -> float:
        """Aspect ratio of the most slender brick [-]."""
        return float(self.aspect_ratio.max())


def quality(grid: Grid) -> Quality:
    """Shape of every brick of a grid."""
    ratio = _jacobian_ratio(grid)
    lengths = _edge_lengths(grid)
    with np.errstate(divide="ignore", invalid="ignore"):
        aspect = lengths.max(axis=1) / lengths.min(axis=1)
    worst = int(ratio.argmin())
    return Quality(ratio, aspect, worst, _middles(grid)[worst])


def check_grid(grid: Grid, *, needs: Sequence[str] = ("rim",), radius: float | None = None) -> None:
    """Refuse a grid that cannot be a gear body.

    **Arguments:**

    - `grid`: the grid.
    - `needs`: names of sets that must be there. Every set named `seat:...` is checked anyway.
    - `radius`: radius that the rim should have [m], if it is known.

    **Raises:**

    - `BodyError` if coordinates are not numbers; a set is missing or empty; the size says that
        the unit is wrong; there are nodes without a brick, bricks that are inverted or collapsed,
        loose parts, nodes that should be one; the rim is not a cylinder about z, see `check_rim`;
        a seat has too few nodes, or shares them.
    """
    _require_numbers(grid)
    require_sets(grid, needs)
    _require_size(grid)
    _require_used(grid)
    _require_mid_nodes(grid)
    _require_upright(grid)
    _require_one_part(grid)
    if "rim" in grid.sets:
        check_rim(grid, radius)
    _require_seats(grid)


def _jacobian_ratio(grid: Grid) -> np.ndarray:
    """Smallest Jacobian determinant over the largest in size, shape `[brick]` [-]."""
    points = np.concatenate([REFERENCE_NODES, gauss_points(4)[0]])
    corners = grid.nodes[grid.bricks]
    smallest = np.full(len(corners), np.inf)
    largest = np.zeros(len(corners))
    # Point by point: all at once would take half a gigabyte in a fine grid.
    for gradients in shape_functions(points)[1]:
        determinant = np.linalg.det(jacobians(corners, gradients[None])[:, 0])
        smallest = np.minimum(smallest, determinant)
        largest = np.maximum(largest, np.abs(determinant))
    return np.divide(smallest, largest, out=np.zeros_like(smallest), where=largest > 0)


def _edge_lengths(grid: Grid) -> np.ndarray:
    """Length of every edge over its mid node, shape `[brick, 12]` [m]."""
    first, last, middle = np.moveaxis(grid.nodes[grid.bricks[:, EDGES]], 2, 0)
    return np.linalg.norm(middle - first, axis=2) + np.linalg.norm(last - middle, axis=2)


def _middles(grid: Grid) -> np.ndarray:
    """Middle of every brick, shape `[brick, 3]` [m]."""
    return grid.nodes[grid.bricks[:, :8]].mean(axis=1)


def _require_numbers(grid: Grid) -> None:
    require(
        grid.nodes.ndim == 2 and grid.nodes.shape[1] == 3,
        "`Grid.nodes` must have the shape [node, 3], got {shape}.",
        shape=list(grid.nodes.shape),
    )
    require(
        grid.bricks.ndim == 2 and grid.bricks.shape[1] == 20 and len(grid.bricks) > 0,
        "`Grid.bricks` must have the shape [brick, 20], got {shape}: a gear body is made of "
        "20-node bricks.",
        shape=list(grid.bricks.shape),
    )
    require(
        grid.bricks.min() >= 0 and grid.bricks.max() < len(grid.nodes),
        "`Grid.bricks` names nodes {first} to {last}, but there are {count} nodes, from 0.",
        first=grid.bricks.min(),
        last=grid.bricks.max(),
        count=len(grid.nodes),
    )
    bad = ~np.isfinite(grid.nodes).all(axis=1)
    require(
        not np.any(bad),
        "{count} of {all} nodes have coordinates that are not finite numbers, the first of them "
        "node {node} (from 0). Write the grid out of the mesher again.",
        count=np.sum(bad),
        all=len(grid.nodes),
        node=np.argmax(bad),
    )


def _require_size(grid: Grid) -> None:
    size = float(np.ptp(grid.nodes, axis=0).max())
    require(
        _SMALLEST <= size <= _LARGEST,
        "A gear body measures {smallest:g/mm} mm to {largest:g} m; this one measures {size:.4g} m. "
        "The {length_unit} of the file is wrong,",
        remedy="1e-3 m for one in millimetres, 1 m for one in metres, 0.0254 m for one in inches.",
        smallest=_SMALLEST,
        largest=_LARGEST,
        size=size,
    )


def _require_used(grid: Grid) -> None:
    used = np.zeros(len(grid.nodes), dtype=bool)
    used[grid.bricks] = True
    first = grid.nodes[(~used).argmax()]
    require(
        used.all(),
        "{count} of {all} nodes belong to no brick, the first at {place}. They would move "
        "freely: leave them out.",
        count=(~used).sum(),
        all=len(used),
        place=place_of(first),
    )


def _require_mid_nodes(grid: Grid) -> None:
    first, last, middle = np.moveaxis(grid.nodes[grid.bricks[:, EDGES]], 2, 0)
    away = np.linalg.norm(middle - (first + last) / 2, axis=2)
    bad = (away > _OFF_EDGE * np.linalg.norm(last - first, axis=2)).any(axis=1)
    require(
        not bad.any(),
        "{count} of {all} bricks have mid nodes that are not between their corners, the first "
        "near {place}. The nodes of an element are in the wrong order: they must be those of "
        "the format's own documentation.",
        count=bad.sum(),
        all=len(bad),
        place=place_of(_middles(grid)[bad.argmax()]),
    )


def _require_upright(grid: Grid) -> None:
    shape = quality(grid)
    bad = shape.jacobian_ratio <= _COLLAPSED
    require(
        not bad.all(),
        "Every brick is inverted: the grid is a mirror image, or the nodes of its elements turn "
        "the wrong way. Mirror it in the mesher, which then turns the elements too.",
    )
    require(
        not bad.any(),
        "{count} of {all} bricks are inverted or collapsed: their Jacobian is zero or negative "
        "somewhere. The worst, brick {worst} (from 0), is near {place}. Mesh that place again; "
        "wedges written as bricks with repeated nodes cannot be used.",
        count=bad.sum(),
        all=len(bad),
        worst=shape.worst,
        place=place_of(shape.place),
    )


def _require_one_part(grid: Grid) -> None:
    pairs = _coincident(grid)
    part = parts(grid)
    sizes = np.bincount(part)
    middles = _middles(grid)
    told = [
        f"{sizes[number]} bricks around {place_of(middles[part == number].mean(axis=0))}"
        for number in np.argsort(-sizes, kind="stable")[:4]
    ]
    join = (
        f"{len(pairs)} pairs of nodes lie at the same place: make them one (merge or equivalence "
        "nodes in the mesher)"
        if len(pairs)
        else "Join them, or leave out what is not the gear body"
    )
    require(
        len(sizes) == 1,
        "A gear body must be of one piece; this grid has {count} loose parts: {told}. {join}.",
        count=len(sizes),
        told="; ".join(told) + f"; and {len(sizes) - len(told)} more" * (len(sizes) > len(told)),
        join=join,
    )
    require(
        not len(pairs),
        "{join}. The first is at {place}. The body has a slit there.",
        join=join,
        place=place_of(grid.nodes[pairs[0, 0]]) if len(pairs) else "",
    )


def _coincident(grid: Grid) -> np.ndarray:
    """Pairs of nodes at the same place, shape `[pair, 2]`."""
    tolerance = 1e-4 * _edge_lengths(grid).min()
    return KDTree(grid.nodes).query_pairs(tolerance, output_type="ndarray")


def _require_seats(grid: Grid) -> None:
    taken = {"rim": grid.sets["rim"]} if "rim" in grid.sets else {}
    for name, nodes in grid.sets.items():
        if not name.startswith("seat:"):
            continue
        _require_spread(name, grid.nodes[np.unique(nodes)])
        for other, used in taken.items():
            shared = np.intersect1d(nodes, used)
            require(
                len(shared) == 0,
                "'{name}' and '{other}' share {count} nodes. A node follows one of them only: "
                "leave it out of the other set.",
                name=name,
                other=other,
                count=len(shared),
            )
        taken[name] = nodes


def _require_spread(name: str, points: np.ndarray) -> None:
    """Refuse a seat that cannot hold a moment about every axis."""
    require(
        len(points) >= 3,
        "'{name}' must have three nodes or more, got {count}: fewer cannot hold the body against "
        "tilting. Choose the nodes of the whole surface on which the bearing sits.",
        name=name,
        count=len(points),
    )
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    require(
        extents[1] > 1e-6 * extents[0],
        "All {count} nodes of '{name}' lie on one straight line, from {first} to {last}: they "
        "cannot hold the body against turning about it. Choose the nodes of the whole surface "
        "on which the bearing sits.",
        name=name,
        count=len(points),
        first=place_of(points[0]),
        last=place_of(points[-1]),
    )
