"""Quadrilaterals of a gear body seen along its axis.

All functions return places of nodes, shape `[quad, 8, 2]` [m]: four corners counter-clockwise,
then the middles of the edges that follow them. Nothing is numbered: quadrilaterals that share an
edge share the places of its nodes, which lie on circles where the edge is an arc.

With `sectors` elements around, their edges lie at the angles `(j - 1/2) 2 pi / sectors`: with one
element per tooth every tooth stands in the middle of its own.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import cos, pi, sin, sqrt

import numpy as np

from ._brick import REFERENCE_NODES, jacobians, shape_functions
from ._plate import Holes

# Least elements of a hole's patch along an edge: with 12 around it a hole is round to 2e-4 of
# its area.
_PATCH = 3

# Nodes of a brick's bottom, in the order of a quadrilateral's.
_BOTTOM = [0, 1, 2, 3, 8, 9, 10, 11]

# Around a hole, least sine of the angle between the lines of an element, and largest distance of
# the middle of an edge from its chord, over that: 12 and 168 degrees, and an arc of 75 degrees.
_LEAST_SINE = 0.2
_MOST_BENT = 0.17

# Least room between a hole and a patch of another ring, as a share of the hole's radius.
_PARTED = 0.05

# Room left between a hole and the edge of its patch, as a share of the hole's radius: the largest
# that fits.
_ROOMS = (0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02, 0.01)


def circle(radius: float, sectors: int) -> np.ndarray:
    """Corners and middles of the edges around a circle, in turn, shape `[2 sectors, 2]` [m]."""
    angle = 2 * pi * (np.arange(2 * sectors) - 1) / (2 * sectors)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def between(outer: np.ndarray, inner: np.ndarray, layers: int) -> np.ndarray:
    """Layers of quadrilaterals between two closed lines.

    **Arguments:**

    - `outer`: corners and middles in turn, counter-clockwise, shape `[2 n, 2]` [m].
    - `inner`: the same, opposite to them.
    - `layers`: number of layers, from outside to inside.

    **Returns:**

    Shape `[layers n, 8, 2]` [m].
    """
    share = np.linspace(0, 1, 2 * layers + 1)[:, None, None]
    lines = (1 - share) * outer + share * inner
    here, ahead = lines[:, ::2], np.roll(lines[:, ::2], -1, axis=1)
    middle = lines[:, 1::2]
    out, mid, into = slice(0, -2, 2), slice(1, None, 2), slice(2, None, 2)
    corners = [here[out], ahead[out], ahead[into], here[into]]
    middles = [middle[out], ahead[mid], middle[into], here[mid]]
    return np.stack(corners + middles, axis=2).reshape(-1, 8, 2)


def annulus(radii: Sequence[float], sectors: int) -> np.ndarray:
    """Quadrilaterals of an annulus, by growing radius, then around from tooth 0."""
    parts = [
        between(circle(outer, sectors), circle(inner, sectors), 1)
        for inner, outer in pairwise(radii)
    ]
    return np.concatenate(parts)


def core_reach(radius: float, layers: int, sectors: int) -> float:
    """Largest distance from the axis of the innermost quadrilaterals of a `core` [m]."""
    near, half = radius / layers, 2 * pi / sectors
    # Longer tips make the kites better and the elements between them worse. At the root of the
    # half-angle they are equally good; a kite longer than a rhomb would be worse too.
    return near * min(1 + sqrt(sin(half)), max(2 * cos(half), 1.0))


def core(radius: float, layers: int, sectors: int) -> np.ndarray:
    """Quadrilaterals of a full disc, none of them collapsed.

    Kites around the axis, each over two sectors, leave a jagged line that layers between it and
    the circle smooth. Their number is half that of the sectors, which has to be even: no disc of
    quadrilaterals has an odd number of edges around it. A block of squares in the middle would have
    better angles, but more elements by far and hardly a symmetry.

    **Arguments:**

    - `radius`: of the disc [m].
    - `layers`: elements along the radius, at least 2.
    - `sectors`: elements around, even.
    """
    reach = np.full(sectors, radius / layers)
    reach[::2] = core_reach(radius, layers, sectors)
    tips = reach[:, None] * circle(1.0, sectors)[::2]
    jagged = np.stack([tips, (tips + np.roll(tips, -1, axis=0)) / 2], axis=1).reshape(-1, 2)
    before, tip, after = np.roll(tips, 1, axis=0)[::2], tips[::2], tips[1::2]
    kites = [np.zeros_like(tip), before, tip, after]
    kites += [(a + b) / 2 for a, b in zip(kites, kites[1:] + kites[:1], strict=True)]
    smooth = between(circle(radius, sectors), jagged, layers - 1)
    return np.concatenate([np.stack(kites, axis=1), smooth])


def perforated(
    inner: float, outer: float, size: float, sectors: int, holes: Sequence[Holes]
) -> np.ndarray | None:
    """Quadrilaterals of an annulus with rings of holes.

    Around every hole a patch of the annulus gives way to layers between the patch's edge and the
    hole. A patch has the same place in every hole's share of the circle, and ends on edges of
    elements; the hole lies less than half an element off its middle, so the elements keep
    their places under the teeth wherever the holes are.

    **Arguments:**

    - `inner`, `outer`: radii of the annulus [m].
    - `size`: length of an element along the radius, about [m].
    - `sectors`: elements around, a multiple of the count of every ring.
    - `holes`: rings of holes.

    **Returns:**

    Shape `[quad, 8, 2]` [m], or None if there are too few elements around to part the holes.
    """
    fitting = (
        _perforated((inner, outer), size, sectors, holes, room, parted)
        for room in _ROOMS
        for parted in (False, True)
    )
    return next((quads for quads in fitting if quads is not None), None)


def _perforated(
    bounds: tuple[float, float],
    size: float,
    sectors: int,
    holes: Sequence[Holes],
    room: float,
    parted: bool,
) -> np.ndarray | None:
    """As `perforated`, with a given room around the holes; None if the patches do not fit.

    `parted` says that the patches of different rings do not reach beyond each other's edge.
    """
    around = [cells for ring in holes if (cells := _around(ring, sectors, room)) is not None]
    if len(around) < len(holes):
        return None
    others = holes if parted else ()
    across = [
        _across(ring, others, bounds, size, max((1 + room) * ring.diameter / 2, 2 * room * wide))
        for ring, (_, _, wide) in zip(holes, around, strict=True)
    ]
    height = min((high - low for low, high in across), default=np.inf)
    size = min(size, height / _PATCH)
    radii = _radii(bounds, size, across, room * height / 2)
    taken = np.zeros((len(radii) - 1, sectors), dtype=bool)
    patches = []
    for ring, (first, count, _), ends in zip(holes, around, across, strict=True):
        low, high = (int(np.abs(radii - end).argmin()) for end in ends)
        for number in range(ring.count):
            columns = first + number * sectors // ring.count + np.arange(count)
            block = np.ix_(np.arange(low, high), columns % sectors)
            if taken[block].any():
                return None
            taken[block] = True
        patches.append(_patches(ring, radii[low : high + 1], first, count, sectors, size))
    if not all(_sound(patch) for patch in patches):
        return None
    plain = annulus(list(radii), sectors)[~taken.ravel()]
    return np.concatenate([plain, *patches])


def _around(holes: Holes, sectors: int, room: float) -> tuple[int, int, float] | None:
    """First element, number of elements and half the width of the first patch of a ring [m]."""
    pitch = 2 * pi / sectors
    centre = holes.angle / pitch
    for count in range(_PATCH, sectors // holes.count + 1):
        first = round(centre + (1 - count) / 2)
        angle = pitch * min(centre - first + 0.5, first + count - 0.5 - centre)
        wide = holes.circle / 2 * sin(min(angle, pi / 2))
        if wide >= (1 + room) * holes.diameter / 2:
            return first, count, wide
    return None


def _across(
    holes: Holes, others: Sequence[Holes], bounds: tuple[float, float], size: float, reach: float
) -> tuple[float, float]:
    """Radii between which the patches of a ring lie, parted from those of other rings [m]."""
    centre, radius = holes.circle / 2, holes.diameter / 2
    low, high = centre - reach, centre + reach
    for other in others:
        ends = (other.circle - other.diameter) / 2, (other.circle + other.diameter) / 2
        if ends[0] - centre > (1 + 2 * _PARTED) * radius:
            high = min(high, (centre + radius + ends[0]) / 2)
        if centre - ends[1] > (1 + 2 * _PARTED) * radius:
            low = max(low, (centre - radius + ends[1]) / 2)
    # What would be left beside the patch must be worth an element of its own.
    low = bounds[0] if low - bounds[0] < size / 2 else low
    return low, bounds[1] if bounds[1] - high < size / 2 else high


def _radii(
    bounds: tuple[float, float], size: float, across: Sequence[tuple[float, float]], room: float
) -> np.ndarray:
    """Radii of the edges of elements, some at the ends of patches [m]."""
    ends = np.sort([*bounds, *(end for pair in across for end in pair)])
    # Ends of patches of different rings that nearly agree are made one, within the holes' room.
    groups = np.split(ends, np.flatnonzero(np.diff(ends) > min(size, room) / 2) + 1)
    ends = [float(group.mean()) for group in groups]
    parts = [
        np.linspace(low, high, max(1, round((high - low) / size)) + 1)[:-1]
        for low, high in pairwise(ends)
    ]
    return np.concatenate([*parts, ends[-1:]])


def _patches(
    holes: Holes, radii: np.ndarray, first: int, count: int, sectors: int, size: float
) -> np.ndarray:
    """Quadrilaterals around all the holes of a ring."""
    edge = _outline(radii, 2 * pi * (first - 0.5 + np.arange(count + 1)) / sectors)
    centre = holes.centres[0]
    spoke = edge - centre
    direction = np.unwrap(np.arctan2(spoke[::2, 1], spoke[::2, 0]))
    direction = _halved(np.append(direction, direction[0] + 2 * pi))[:-1]
    hole = centre + holes.diameter / 2 * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    gap = np.hypot(*spoke.T).mean() - holes.diameter / 2
    patch = between(edge, hole, max(2, round(gap / size)))
    turns = 2 * pi * np.arange(holes.count) / holes.count
    return np.concatenate([patch @ _rotation(turn).T for turn in turns])


def _sound(quads: np.ndarray) -> bool:
    """Whether quadrilaterals are far from collapsing, and none of their edges is bent much."""
    # On its bottom a brick has the shape functions of its eight nodes there.
    gradients = shape_functions(REFERENCE_NODES[_BOTTOM])[1][:, _BOTTOM, :2]
    sides = jacobians(quads, gradients)
    sine = np.linalg.det(sides) / np.prod(np.linalg.norm(sides, axis=-2), axis=-1)
    corners, middles = quads[:, :4], quads[:, 4:]
    chord = np.roll(corners, -1, axis=1) - corners
    away = middles - corners - chord / 2
    bent = np.linalg.norm(away, axis=-1) / np.linalg.norm(chord, axis=-1)
    return bool(sine.min() > _LEAST_SINE and bent.max() < _MOST_BENT)


def _outline(radii: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Corners and middles along the edge of a patch, counter-clockwise, shape `[2 n, 2]` [m]."""
    up, turn = _halved(radii), _halved(angles)
    radius = np.concatenate(
        [up[:-1], np.full(len(turn) - 1, up[-1]), up[:0:-1], np.full(len(turn) - 1, up[0])]
    )
    angle = np.concatenate(
        [np.full(len(up) - 1, turn[0]), turn[:-1], np.full(len(up) - 1, turn[-1]), turn[:0:-1]]
    )
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _halved(values: np.ndarray) -> np.ndarray:
    """Values with their means between them."""
    halved = np.empty(2 * len(values) - 1)
    halved[::2] = values
    halved[1::2] = (values[1:] + values[:-1]) / 2
    return halved


def _rotation(angle: float) -> np.ndarray:
    """Matrix of a turn by an angle [rad] about the axis, shape `[2, 2]`."""
    return np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])
