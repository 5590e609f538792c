"""A rim that teeth can stand on: whole elements on one cylinder about the axis."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ._checks import BodyError, require
from ._grid import Grid, surface, surface_of

# How far rim nodes may lie off their cylinder, over its radius. A file with eight characters per
# number is good to 1e-6; straight edges of 86 sectors are off by 7e-4.
_OFF_CYLINDER = 5e-5

# How far the rim's radius may be from the expected one, over that.
_OFF_RADIUS = 1e-3

# How far the middle of the rim may be from z = 0, over its width.
_OFF_MIDDLE = 1e-3


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
    require_sets(grid, ["rim"])
    faces = _rim_faces(grid)
    found = float(np.median(grid.radius[grid.sets["rim"]]))
    _require_cylinder(grid, faces, found)
    if radius is not None:
        _require_radius(found, radius)
    _require_band(grid, faces)
    _require_middle(grid)
    return found


def require_sets(grid: Grid, needs: Sequence[str]) -> None:
    """Refuse a grid that lacks a set of nodes."""
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
        place=place_of(grid.nodes[stray[outside.argmin()]]),
    )
    raise BodyError(
        f"The rim set must be made of whole outer faces; {len(stray)} of its {len(rim)} nodes "
        f"belong to none, the first at {place_of(grid.nodes[stray[0]])}. Choose all nodes of the "
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
        f"{place_of(grid.nodes[rim[worst]])}, has {1e3 * radii[worst]:.6g} mm. Choose only nodes "
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
        f"{angle:.3g} degrees from z, and passes through {place_of(through)}. Move and turn the "
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
        place=place_of(grid.nodes[starts[np.isin(loop, openings).argmax()]]),
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


def place_of(point: np.ndarray) -> str:
    """A place as the user's mesher shows it, to 0.1 um."""
    return "({}) mm".format(", ".join(f"{round(1e3 * part, 4) + 0:.7g}" for part in point))
