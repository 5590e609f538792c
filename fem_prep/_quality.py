"""Whether a grid can be a gear body: the quality of its bricks, its frame, its rim and its seats.

A grid that cannot be is refused with what is wrong, where, and what to do. Places are told in
millimetres, as the user's mesher tells them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ._brick import REFERENCE_NODES, gauss_points, jacobians, shape_functions
from ._checks import BodyError, require
from ._grid import EDGES, Grid, parts, surface, surface_of

# A gear body outside of these sizes [m] is more likely one in the wrong unit.
_SMALLEST = 3e-3
_LARGEST = 5.0

# How far rim nodes may lie off their cylinder, over its radius. A file with eight characters per
# number is good to 1e-6; straight edges of 86 sectors are off by 7e-4.
_OFF_CYLINDER = 5e-5

# How far the rim's radius may be from the expected one, over that.
_OFF_RADIUS = 1e-3

# How far the middle of the rim may be from z = 0, over its width.
_OFF_MIDDLE = 1e-3

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
    _require_sets(grid, needs)
    _require_size(grid)
    _require_used(grid)
    _require_mid_nodes(grid)
    _require_upright(grid)
    _require_one_part(grid)
    if "rim" in grid.sets:
        check_rim(grid, radius)
    _require_seats(grid)


def check_rim(grid: Grid, radius: float | None = None) -> float:
    """Refuse a rim set that is not the whole of one cylinder about z.

    **Arguments:**

    - `grid`: a grid with the set `rim`.
    - `radius`: radius that the rim should have [m], if it is known.

    **Returns:**

    The radius that was found [m].

    **Raises:**

    - `BodyError` if the nodes are not those of whole outer faces; lie off their cylinder, or on
        straight edges; if the cylinder's axis is not z, or its radius not the expected one; if
        the faces are not one band around the axis; if its middle is not at z = 0.
    """
    _require_sets(grid, ["rim"])
    faces = _rim_faces(grid)
    found = float(np.median(grid.radius[grid.sets["rim"]]))
    _require_cylinder(grid, faces, found)
    if radius is not None:
        _require_radius(found, radius)
    _require_band(grid, faces)
    _require_middle(grid)
    return found


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


def _require_sets(grid: Grid, needs: Sequence[str]) -> None:
    for name in needs:
        require(
            name in grid.sets,
            "The grid must have the set of nodes '{name}'; it has {there}.",
            name=name,
            there=", ".join(f"'{there}'" for there in grid.sets) or "none",
        )
    for name, members in grid.sets.items():
        nodes = np.asarray(members)
        require(
            nodes.size > 0,
            "The set of nodes '{name}' is empty. Choose its nodes in the mesher, mid nodes too, "
            "and write the grid again.",
            name=name,
        )
        require(
            nodes.min() >= 0 and nodes.max() < len(grid.nodes),
            "The set '{name}' names nodes {first} to {last}, but there are {count}, from 0.",
            name=name,
            first=nodes.min(),
            last=nodes.max(),
            count=len(grid.nodes),
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
        place=_place(first),
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
        place=_place(_middles(grid)[bad.argmax()]),
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
        place=_place(shape.place),
    )


def _require_one_part(grid: Grid) -> None:
    pairs = _coincident(grid)
    part = parts(grid)
    sizes = np.bincount(part)
    middles = _middles(grid)
    told = [
        f"{sizes[number]} bricks around {_place(middles[part == number].mean(axis=0))}"
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
        place=_place(grid.nodes[pairs[0, 0]]) if len(pairs) else "",
    )


def _coincident(grid: Grid) -> np.ndarray:
    """Pairs of nodes at the same place, shape `[pair, 2]`."""
    tolerance = 1e-4 * _edge_lengths(grid).min()
    return KDTree(grid.nodes).query_pairs(tolerance, output_type="ndarray")


def _rim_faces(grid: Grid) -> np.ndarray:
    """Outer faces of the rim, of which the set must have no node besides, shape `[face, 8]`."""
    rim = np.unique(grid.sets["rim"])
    faces = surface_of(grid, "rim")
    stray = np.setdiff1d(rim, faces)
    if len(stray) == 0:
        return faces
    outer = surface(grid)
    corners = int(np.isin(outer[:, :4], rim).all(axis=1).sum())
    require(
        corners <= len(faces),
        "The rim set must hold the mid nodes too: of {corners} outer faces it has all corners, "
        "but of only {whole} all eight nodes. Choose the nodes of the surface, not the corners.",
        corners=corners,
        whole=len(faces),
    )
    outside = np.isin(stray, outer)
    require(
        outside.all(),
        "The rim set must lie on the outside of the body; {count} of its {all} nodes are inside, "
        "the first at {place}.",
        count=(~outside).sum(),
        all=len(rim),
        place=_place(grid.nodes[stray[outside.argmin()]]),
    )
    raise BodyError(
        f"The rim set must be made of whole outer faces; {len(stray)} of its {len(rim)} nodes "
        f"belong to none, the first at {_place(grid.nodes[stray[0]])}. Choose all nodes of the "
        "cylinder that carries the teeth, and no other."
    )


def _require_cylinder(grid: Grid, faces: np.ndarray, radius: float) -> None:
    rim = np.unique(grid.sets["rim"])
    radii = grid.radius[rim]
    off = np.abs(radii - radius)
    stray = int((off > _OFF_CYLINDER * radius).sum())
    if stray == 0:
        return
    _refuse_other_axis(grid, faces)
    require(
        stray <= len(rim) / 2,
        "The rim must be one cylinder about the z axis; the radii of its nodes are {low:.6g/mm} to "
        "{high:.6g/mm} mm. Choose only the cylinder that carries the teeth, and turn and move the "
        "body in the mesher until its axis of rotation is z.",
        low=radii.min(),
        high=radii.max(),
    )
    _refuse_straight(grid, faces, radius)
    worst = off.argmax()
    raise BodyError(
        f"The rim must be one cylinder about the z axis. Most of its nodes have radius "
        f"{1e3 * radius:.6g} mm, but {stray} of {len(rim)} do not: the worst, at "
        f"{_place(grid.nodes[rim[worst]])}, has {1e3 * radii[worst]:.6g} mm. Choose only nodes "
        "of the cylinder that carries the teeth: not its end faces, chamfers or fillets."
    )


def _refuse_straight(grid: Grid, faces: np.ndarray, radius: float) -> None:
    """Tell mid nodes that lie on the chord from nodes that are anywhere."""
    edges = np.stack([faces[:, :4], np.roll(faces[:, :4], -1, axis=1), faces[:, 4:]], axis=-1)
    first, last, middle = np.moveaxis(grid.nodes[edges], 2, 0)
    chord = (first + last) / 2
    sag = radius - np.hypot(chord[..., 0], chord[..., 1])
    round_corners = (np.abs(grid.radius[edges[..., :2]] - radius) <= _OFF_CYLINDER * radius).all(-1)
    bent = round_corners & (sag > _OFF_CYLINDER * radius)
    straight = bent & (np.linalg.norm(middle - chord, axis=-1) < 0.02 * sag)
    if straight.any():
        raise BodyError(
            f"The elements are linear: {straight.sum()} of {bent.sum()} edges around the rim are "
            f"straight, with mid nodes up to {1e6 * sag[straight].max():.3g} um inside the "
            f"cylinder of radius {1e3 * radius:.6g} mm. Have the mesher put the mid nodes on the "
            "geometry (Gmsh: Mesh.SecondOrderLinear = 0), or mesh the solid with quadratic "
            "elements from the start."
        )


def _refuse_other_axis(grid: Grid, faces: np.ndarray) -> None:
    """Tell a cylinder about another axis from what is no cylinder at all."""
    corners = grid.nodes[faces[:, :4]]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    # No normal of a cylinder has a part along its axis.
    directions = np.linalg.eigh(normals.T @ normals)[1]
    axis, across = directions[:, 0], directions[:, 1:]
    flat = grid.nodes[np.unique(faces)] @ across
    centre, radius = _circle(flat)
    off = np.abs(np.linalg.norm(flat - centre, axis=1) - radius)
    if off.max() > 4 * _OFF_CYLINDER * radius:
        return
    axis = axis * math.copysign(1, axis[np.abs(axis).argmax()])
    through = across @ centre
    told = ", ".join(f"{round(part, 4) + 0:.4g}" for part in axis)
    angle = math.degrees(math.acos(min(abs(axis[2]), 1)))
    raise BodyError(
        f"The rim must be a cylinder about the z axis. It is one, of radius {1e3 * radius:.6g} mm, "
        f"but its axis has the direction ({told}), "
        f"{angle:.3g} degrees from z, and passes through {_place(through)}. Move and turn the "
        "body in the mesher until its axis of rotation is z."
    )


def _circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the circle that fits points of a plane, by least squares (Kasa 1976)."""
    middle = points.mean(axis=0)
    local = points - middle
    system = np.column_stack([2 * local, np.ones(len(local))])
    solution = np.linalg.lstsq(system, (local**2).sum(axis=1), rcond=None)[0]
    centre = solution[:2]
    return centre + middle, math.sqrt(max(solution[2] + centre @ centre, 0.0))


def _require_radius(found: float, expected: float) -> None:
    ratio = found / expected
    why = ""
    for factor, reason in (
        (2.0, "A diameter was taken for a radius."),
        (1e3, "A factor of 1000 is a wrong {length_unit}."),
        (25.4, "A factor of 25.4 is a wrong {length_unit}: inches."),
    ):
        if min(abs(ratio / factor - 1), abs(ratio * factor - 1)) < 0.1:
            why = reason + " "
    require(
        abs(ratio - 1) <= _OFF_RADIUS,
        "The rim should have a radius of {expected:.6g/mm} mm; the grid's has {found:.6g/mm} mm. "
        + why
        + "Mesh the body up to the cylinder that carries the teeth, without them, or take the "
        "other set.",
        expected=expected,
        found=found,
    )


def _require_band(grid: Grid, faces: np.ndarray) -> None:
    """Refuse faces that are not one band around the axis, without gaps and openings.

    The edges that belong to one face only make loops. A whole band has two, and each goes once
    around the axis.
    """
    starts, ends = faces[:, :4].ravel(), np.roll(faces[:, :4], -1, axis=1).ravel()
    count = len(grid.nodes)
    single = ~np.isin(starts * count + ends, ends * count + starts)
    starts, ends = starts[single], ends[single]
    links = coo_array((np.ones(len(starts)), (starts, ends)), shape=(count, count))
    loop = np.unique(connected_components(links, directed=False)[1][starts], return_inverse=True)[1]
    angle = np.arctan2(grid.nodes[:, 1], grid.nodes[:, 0])
    step = (angle[ends] - angle[starts] + np.pi) % (2 * np.pi) - np.pi
    turns = np.abs(np.bincount(loop, weights=step) / (2 * np.pi))
    openings = np.flatnonzero(turns < 0.5)
    require(
        len(openings) == 0,
        "The rim set must go all the way round without gaps and holes; it is open in {count} "
        "places, the first near {place}. Choose all nodes of the cylinder that carries the teeth.",
        count=len(openings),
        place=_place(grid.nodes[starts[np.isin(loop, openings).argmax()]]),
    )
    edges = sorted(grid.nodes[starts[loop == number], 2].mean() for number in range(len(turns)))
    require(
        len(turns) == 2,
        "The rim set must be one band around the axis; it has {count} edges that go round, at "
        "z = {edges} mm. Choose the nodes of one cylinder.",
        count=len(turns),
        edges=", ".join(f"{1e3 * edge:.4g}" for edge in edges),
    )


def _require_middle(grid: Grid) -> None:
    along = grid.nodes[grid.sets["rim"], 2]
    middle = (along.min() + along.max()) / 2
    require(
        abs(middle) <= _OFF_MIDDLE * np.ptp(along),
        "The middle of the rim must be at z = 0; it is at z = {middle:.6g/mm} mm, between "
        "{low:.6g/mm} and {high:.6g/mm} mm. Move the body along z.",
        middle=middle,
        low=along.min(),
        high=along.max(),
    )


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
        first=_place(points[0]),
        last=_place(points[-1]),
    )


def _place(point: np.ndarray) -> str:
    """A place as the user's mesher shows it, to 0.1 um."""
    return "({}) mm".format(", ".join(f"{round(1e3 * part, 4) + 0:.7g}" for part in point))
