r"""Gear bodies with coarse teeth all around: ribs that stiffen the rim.

A thin rim bends and tilts as a ring with ribs, not as a smooth one: of the accessory wheel's rim,
three modules thick, teeth take a twelfth of the give. What a body gives beyond the plain ring that
teeth of finite elements stand on is the difference of two such grids, with the same elements under
the teeth. One element for each tooth and one or more for each gap go around; a tooth is two bricks
high.
"""

from itertools import pairwise

import numpy as np

from ._checks import require
from ._extrude import extruded_grid
from ._grid import Grid, merged, surface_of
from ._planar import annulus
from ._seats import RIM
from ._section import GearBody
from ._tooth_shape import ToothedGear
from ._web import MeshSizing, body_grid

# Growth of the plain ring's elements under the rim.
_GROWTH = 1.5
# Depth of the rim of a body without a web [elements along its arc].
_DEEP = 4.0
# Circles of nodes of a tooth: corners and middles of two bricks.
_CIRCLES = 5


def ribbed_grids(
    body: GearBody, fineness: MeshSizing, gear: ToothedGear, *, teeth: bool = True
) -> tuple[tuple[Grid, np.ndarray], tuple[Grid, np.ndarray]]:
    """A body and a plain ring, both with coarse teeth and with the same elements in their rims.

    **Arguments:**

    - `body`: its measures.
    - `fineness`: of its grid; at least two elements around for each tooth.
    - `gear`: its teeth, and the bore of the ring.
    - `teeth`: whether they stand on the rims; without them these are smooth, and the elements
        the same.

    **Returns:**

    The body's grid, with its sets, and the ring's, with `seat:bore`; each with the faces of the
    rim, teeth or not, `[face, 8]`.

    **Raises:**

    - `BodyError` if there are too few elements around.
    """
    require(
        fineness.sectors >= 2 * gear.teeth,
        "Under ribs {MeshSizing.sectors} must be at least two for each tooth, {want}, got {got}.",
        want=2 * gear.teeth,
        got=fineness.sectors,
    )
    grid = body_grid(body, fineness)
    depth = _depth(body, fineness)
    ring = _ring(grid, body, fineness.sectors, (depth, gear.bore))
    bore = np.flatnonzero(ring.radius < 0.5 * gear.bore + body.same)
    ring = Grid(ring.nodes, ring.bricks, {RIM: _on_rim(ring, body), "seat:bore": bore})
    own = _ribbed if teeth else _smooth
    first, second = (own(each, body, fineness.sectors, depth, gear) for each in (grid, ring))
    return first, second


def _depth(body: GearBody, fineness: MeshSizing) -> float:
    """Of the rim, in whose elements all is the same [m]."""
    if body.web is not None:
        return 0.5 * (body.rim_outer - body.web.rim_inner)
    return _DEEP * np.pi * body.rim_outer / fineness.sectors


def _on_rim(grid: Grid, body: GearBody) -> np.ndarray:
    return np.flatnonzero(grid.radius > 0.5 * body.rim_outer - body.same)


def _ring(grid: Grid, body: GearBody, sectors: int, sizes: tuple[float, float]) -> Grid:
    """A plain ring: under the rim's own elements others that grow towards the bore."""
    depth, bore = sizes
    outer = 0.5 * body.rim_outer
    faces = surface_of(grid, RIM)
    levels = _apart(grid.nodes[faces[:, :4], 2], body.same)
    corners = grid.nodes[grid.bricks[:, :8]].reshape(-1, 3)
    # On the toothed face's end the rim's own elements are seen alone.
    end = np.abs(corners[:, 2] - levels[0]) < body.same
    radii = _apart(np.hypot(*corners[end, :2].T), body.same)
    radii = radii[(radii > outer - depth - body.same) & (radii < outer + body.same)]
    step, left = float(np.diff(radii)[0]), float(radii[0]) - 0.5 * bore
    steps = [step]
    while sum(steps) < left:
        steps.append(_GROWTH * steps[-1])
    below = radii[0] - left * np.cumsum(steps) / sum(steps)
    quads = annulus([*below[::-1], *radii], sectors)
    places = np.concatenate([extruded_grid(quads, *ends) for ends in pairwise(levels)])
    numbers = np.arange(20 * len(places)).reshape(-1, 20)
    nodes, bricks = merged(places.reshape(-1, 3), numbers, body.same)
    return Grid(nodes, bricks)


def _apart(values: np.ndarray, same: float) -> np.ndarray:
    """Values in order, those that are the same once."""
    ordered = np.unique(values)
    return ordered[np.concatenate([[True], np.diff(ordered) > same])]


def _ribbed(
    grid: Grid, body: GearBody, sectors: int, depth: float, gear: ToothedGear
) -> tuple[Grid, np.ndarray]:
    """A grid whose elements of the rim are as wide as teeth and gaps in turn, with teeth on it."""
    smooth, faces = _smooth(grid, body, sectors, depth, gear)
    owner = _edges(gear, sectors)[1]
    before = grid.nodes[faces[:, :4], :2].mean(axis=1)
    element = np.rint(np.arctan2(before[:, 1], before[:, 0]) * sectors / (2.0 * np.pi))
    tooth = owner[element.astype(int) % sectors]
    nodes, bricks = _with_teeth(smooth.nodes, faces[tooth >= 0], tooth[tooth >= 0], gear)
    return Grid(nodes, np.concatenate([grid.bricks, bricks]), grid.sets), faces


def _smooth(
    grid: Grid, body: GearBody, sectors: int, depth: float, gear: ToothedGear
) -> tuple[Grid, np.ndarray]:
    """The same elements of the rim without the teeth."""
    radius, outer = grid.radius, 0.5 * body.rim_outer
    share = np.clip((radius - outer + depth) / depth, 0.0, 1.0)
    edges = _edges(gear, sectors)[0]
    angle = np.arctan2(grid.nodes[:, 1], grid.nodes[:, 0])
    # Edges of equal elements and their middles, from half an element before tooth 0 on.
    even = (np.arange(2 * sectors + 1) - 1.0) * np.pi / sectors
    around = even[0] + np.mod(angle - even[0], 2.0 * np.pi)
    turned = np.interp(around, even, _halved(edges)) - around
    angle = angle + share * (turned + gear.twist * grid.nodes[:, 2])
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle), grid.nodes[:, 2]], axis=1)
    on_rim = Grid(grid.nodes, grid.bricks, {RIM: _on_rim(grid, body)})
    return Grid(places, grid.bricks, grid.sets), surface_of(on_rim, RIM)


def _edges(gear: ToothedGear, sectors: int) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the elements around the rim, and the tooth on each of them, -1 for none."""
    half, pitch = _half_widths(gear)[1][0], gear.pitch_angle
    spare = sectors - 2 * gear.teeth
    edges, owner = [-half], []
    for tooth in range(gear.teeth):
        # What elements are more than two for each tooth are spread over the gaps.
        parts = 1 + (tooth + 1) * spare // gear.teeth - tooth * spare // gear.teeth
        middle = tooth * pitch
        edges += [middle + half]
        edges += list(np.linspace(middle + half, middle + pitch - half, parts + 1)[1:])
        owner += [tooth] + [-1] * parts
    return np.array(edges), np.array(owner)


def _halved(ends: np.ndarray) -> np.ndarray:
    """Ends with their middles between them."""
    return np.interp(np.arange(2 * len(ends) - 1) / 2, np.arange(len(ends)), ends)


def _half_widths(gear: ToothedGear) -> tuple[np.ndarray, np.ndarray]:
    """Radii of the circles of nodes of a tooth, and half its angle there."""
    # Below where the fillet has turned by 45 degrees there is as much rim as tooth.
    rack = np.linspace(max(0.25 * np.pi, gear.pressure_angle), gear.pressure_angle, 40)
    flank = gear.involute(np.linspace(gear.form_roll, gear.tip_roll, 40))
    radius, angle = (np.concatenate(both) for both in zip(gear.fillet(rack), flank, strict=True))
    circles = np.linspace(gear.root_radius, gear.tip_radius, _CIRCLES)
    return circles, np.interp(circles, radius, angle)


def _with_teeth(
    nodes: np.ndarray, faces: np.ndarray, tooth: np.ndarray, gear: ToothedGear
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes with those of the teeth, and their bricks, which stand on faces of the rim."""
    circles, widths = _half_widths(gear)
    base, first = np.unique(faces, return_index=True)
    owner = np.repeat(tooth, 8)[first]
    x, y, z = nodes[base].T
    middle = owner * gear.pitch_angle + gear.twist * z
    aside = np.mod(np.arctan2(y, x) - middle + np.pi, 2.0 * np.pi) - np.pi
    numbers, places = [base], [nodes]
    for circle, width in zip(circles[1:], widths[1:], strict=True):
        angle = middle + aside * width / widths[0]
        places.append(np.stack([circle * np.cos(angle), circle * np.sin(angle), z], axis=1))
        numbers.append(len(nodes) + (len(numbers) - 1) * len(base) + np.arange(len(base)))
    place = np.searchsorted(base, faces)
    bricks = []
    for low in (0, 2):
        bottom, middles, top = (numbers[low + step][place] for step in range(3))
        bricks.append(
            np.concatenate(
                [bottom[:, :4], top[:, :4], bottom[:, 4:], top[:, 4:], middles[:, :4]], axis=1
            )
        )
    every, bricks = np.concatenate(places), np.concatenate(bricks)
    # Middles of edges around have none above them between two circles of corners.
    used = np.union1d(np.arange(len(nodes)), bricks)
    return every[used], np.searchsorted(used, bricks)
