"""The transverse section of some teeth on a ring, in nine-node quadrilaterals.

Tooth 0 lies along x. Teeth on both sides of those that are looked at are coarser, the rest of the
ring has none: a ring bends with its teeth hardly otherwise than without. Each piece is the image of
a rectangle under a smooth map that all nine nodes of an element lie on, so that the true flank and
the true fillet are met by every node.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ._grid import merged
from ._tooth_shape import ToothedGear


@dataclass(frozen=True)
class ToothSizing:
    """How finely teeth are divided.

    **Fields:**

    - `flank`: rows from the form circle to the tip, each a place where loads act and two elements
        high: over one alone a load would find them too stiff [-].
    - `across`: elements across the thickness of a tooth, even [-].
    - `gap`: elements along a gap, from one tooth's fillet to the next one's [-].
    - `ring`: elements through the ring [-].
    - `margin`: coarse teeth on either side of those that are looked at [-].
    - `waves`: polynomials along the axis beyond one for each module of face width, even [-].
    """

    flank: int = 10
    across: int = 6
    gap: int = 8
    ring: int = 8
    margin: int = 2
    waves: int = 8


@dataclass(frozen=True)
class ToothSection:
    """A section of a gear in elements.

    **Fields:**

    - `nodes`: places in the plane, shape `[node, 2]` [m].
    - `quads`: nodes of each element, in rows of three, shape `[quad, 9]`.
    - `bore`: nodes that are held.
    - `flank`: nodes of the rows along the loaded flanks, from the form circle up,
        shape `[tooth, row, 5]`.
    - `roll`: roll lengths of the ends of the rows, shape `[row + 1]` [m].
    - `root_quads`: quads along the gaps beside each tooth that is looked at, first on the loaded
        side, from the tooth to mid-gap, shape `[tooth, 2, quad, 9]`.
    - `root_points`: two places on the edge of each that is the surface, in its reference square,
        shape `[tooth, 2, quad, 2, 2]`.
    - `root_edges`: along which reference coordinate that edge runs, `[tooth, 2, quad, 2]`.
    - `away`: distance of every node from the roots of the teeth that are looked at [m].
    """

    nodes: np.ndarray
    quads: np.ndarray
    bore: np.ndarray
    flank: np.ndarray
    roll: np.ndarray
    root_quads: np.ndarray
    root_points: np.ndarray
    root_edges: np.ndarray
    away: np.ndarray


# Where along the fillet the tooth ends and the ring begins: a part of the angle of the rack's
# normal from the involute on. The element's corners there are about 60 and 120 degrees.
_SPLIT = 0.3
# Size of the outermost elements under the flank, and of those under the gap [modules].
_SKIN = 0.14
# Depth under the root circle at which the ring's elements are those of a plain ring [modules].
_BLEND = 1.2
# Growth of the plain ring's elements along the circle.
_GROWTH = 1.5


def tooth_section(gear: ToothedGear, teeth: int, sizing: ToothSizing) -> ToothSection:
    """Divide the section of a gear.

    **Arguments:**

    - `gear`: the gear.
    - `teeth`: that are looked at: 0, 1, 2 and so on, against the clock.
    - `sizing`: how finely.

    **Returns:**

    The section.
    """
    pieces = _Pieces()
    whole = min(teeth + 2 * sizing.margin, gear.teeth)
    first = -min(sizing.margin, (whole - teeth) // 2)
    outline = _outline(gear)
    coarse = dataclasses.replace(
        sizing, flank=max(1, sizing.flank // 5), across=4, gap=max(2, 2 * (sizing.gap // 4))
    )
    for tooth in range(first, first + whole):
        fine = 0 <= tooth < teeth
        own = sizing if fine else coarse
        above = _add_tooth(pieces, gear, outline, tooth, own, fine)
        below = _add_ring_under(pieces, gear, outline, tooth, own)
        if fine:
            pieces.roots += _roots(above, below, sizing.gap // 2)
    if whole < gear.teeth:
        _add_plain_ring(pieces, gear, sizing, first, whole)
    nodes, quads, index = pieces.merged(1e-6 * gear.module)
    radius, angle = np.hypot(*nodes.T), np.arctan2(nodes[:, 1], nodes[:, 0])
    middle = 0.5 * (teeth - 1) * gear.pitch_angle
    beside = np.abs((angle - middle + np.pi) % (2.0 * np.pi) - np.pi)
    beside = np.maximum(beside - 0.5 * teeth * gear.pitch_angle, 0.0) * radius
    return ToothSection(
        nodes=nodes,
        quads=quads,
        bore=np.flatnonzero(radius < 0.5 * gear.bore + 1e-6 * gear.module),
        flank=np.stack([index[rows] for rows in pieces.flanks]),
        roll=_rolls(gear, sizing.flank),
        root_quads=index[_gathered([edge[0] for edge in pieces.roots], teeth)],
        root_points=_gathered([edge[1] for edge in pieces.roots], teeth),
        root_edges=_gathered([edge[2] for edge in pieces.roots], teeth),
        away=np.hypot(beside, np.maximum(gear.root_radius - radius, 0.0)),
    )


class _Pieces:
    """Rectangles of elements as they are added.

    **Fields:**

    - `places`: of the nodes of each, shape `[node, 2]` [m].
    - `quads`: of each.
    - `flanks`: nodes along the loaded flanks of the teeth that are looked at.
    - `roots`: elements along the gaps beside these, tooth by tooth and side by side: nodes, two
        places on the surface, and along which reference coordinate that runs.
    """

    def __init__(self):
        self.places: list[np.ndarray] = []
        self.quads: list[np.ndarray] = []
        self.flanks: list[np.ndarray] = []
        self.roots: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._count = 0

    def add(self, places: np.ndarray) -> np.ndarray:
        """Add a rectangle of nodes, shape `[odd, odd, 2]`; returns their numbers."""
        numbers = self._count + np.arange(places[..., 0].size).reshape(places.shape[:2])
        self._count += numbers.size
        parts = [numbers[i : i + 3, j : j + 3] for i, j in _corners(numbers.shape)]
        self.places.append(places.reshape(-1, 2))
        self.quads.append(np.stack([part.ravel() for part in parts]))
        return numbers

    def merged(self, tolerance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes, quads and the new number of each old node, with those at one place made one."""
        places = np.concatenate(self.places)
        kept, index = merged(places, np.arange(len(places))[:, None], tolerance)
        return kept, index.ravel()[np.concatenate(self.quads)], index.ravel()


def _corners(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    return [(i, j) for i in range(0, shape[0] - 1, 2) for j in range(0, shape[1] - 1, 2)]


def _polar(radius: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def _halved(ends: np.ndarray) -> np.ndarray:
    """Ends of elements, with the middles between them."""
    result = np.empty(2 * len(ends) - 1)
    result[::2], result[1::2] = ends, 0.5 * (ends[1:] + ends[:-1])
    return result


def _graded(count: int, first: float) -> np.ndarray:
    """Ends of elements from 0 to 1, the first of a given size, the others growing evenly."""
    if first * count >= 1.0:
        return np.linspace(0.0, 1.0, count + 1)
    ratios = np.linspace(1.0, 20.0, 20000)
    powers = np.arange(count)
    sums = np.array([np.sum(ratio**powers) for ratio in ratios[::50]])
    ratio = np.interp(1.0 / first, sums, ratios[::50])
    steps = ratio**powers
    return np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])


# --- The outline


@dataclass(frozen=True)
class _Outline:
    """The outline of a tooth on the side of greater angles.

    **Fields:**

    - `split_radius`, `split_angle`: where the tooth ends on its fillet [m, rad].
    - `fillet`: radius and angle from the split up to the involute by a parameter from 0 to 1.
    - `gap`: radius and angle from the split down to the middle of the gap, by length, 0 to 1.
    - `lengths`: of both [m].
    """

    split_radius: float
    split_angle: float
    fillet: Callable[[np.ndarray], np.ndarray]
    gap: Callable[[np.ndarray], np.ndarray]
    lengths: tuple[float, float]


def _outline(gear: ToothedGear) -> _Outline:
    top = gear.pressure_angle
    split = top + _SPLIT * (0.5 * math.pi - top)
    upper = np.stack(gear.fillet(np.linspace(split, top, 81)), axis=1)
    lower = np.stack(gear.fillet(np.linspace(split, 0.5 * math.pi, 81)), axis=1)
    land = 0.5 * gear.pitch_angle - lower[-1, 1]
    if land > 1e-9:
        steps = lower[-1, 1] + land * np.linspace(0.0, 1.0, 41)[1:]
        lower = np.vstack([lower, np.stack([np.full(40, gear.root_radius), steps], axis=1)])
    fillet, up = _by_length(upper)
    gap, down = _by_length(lower)
    return _Outline(upper[0, 0], upper[0, 1], fillet, gap, (up, down))


def _by_length(points: np.ndarray) -> tuple[Callable[[np.ndarray], np.ndarray], float]:
    """Radius and angle along a curve by the part of its length, and the length."""
    plane = _polar(points[:, 0], points[:, 1])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(plane, axis=0), axis=1))])
    # Through points far closer together than elements: their kinks are not seen.
    return CubicSpline(length / length[-1], points), float(length[-1])


def _rolls(gear: ToothedGear, count: int) -> np.ndarray:
    """Ends of the rows of the flank, closer towards both ends of it."""
    part = np.linspace(0.0, 1.0, count + 1)
    # Lengths along the flank are as the squares of roll lengths.
    part = 0.5 * (part + 0.5 - 0.5 * np.cos(np.pi * part))
    return np.sqrt(gear.form_roll**2 + part * (gear.tip_roll**2 - gear.form_roll**2))


# --- Pieces


def _add_tooth(
    pieces: _Pieces,
    gear: ToothedGear,
    outline: _Outline,
    tooth: int,
    sizing: ToothSizing,
    fine: bool,
) -> np.ndarray:
    """Returns the nodes between the ring and the involute, from below and from right to left."""
    rows = sizing.flank
    roll = _rolls(gear, rows)
    step = 0.25 * (roll[-1] ** 2 - roll[0] ** 2) / gear.base_radius / rows
    below = max(1, round(outline.lengths[0] / min(step, 0.25 * gear.module)))
    fillet = outline.fillet(np.linspace(0.0, 1.0, 2 * below + 1))
    flank = np.stack(gear.involute(np.sqrt(_halved(_halved(roll**2)))), axis=1)
    side = np.vstack([fillet[:-1], flank])
    across = _halved(_across(gear, outline, sizing))
    angle = tooth * gear.pitch_angle + across[None, :] * side[:, 1:]
    places = _polar(np.broadcast_to(side[:, :1], angle.shape), angle)
    numbers = pieces.add(places)
    if fine:
        edge = numbers[2 * below :, -1]
        pieces.flanks.append(np.stack([edge[4 * i : 4 * i + 5] for i in range(rows)]))
    return numbers[: 2 * below + 1]


# Where stresses are taken on an edge: at Gauss's points, where they are best.
_ON_EDGE = 0.5 + np.array([-0.5, 0.5]) / math.sqrt(3.0)


def _roots(
    above: np.ndarray, below: np.ndarray, half_gap: int
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Elements along the gap on the loaded side of a tooth, and on the other."""
    found = []
    for loaded in (True, False):
        quads, points, edges = [], [], []
        side = above[:, -3:] if loaded else above[:, :3]
        for i in range(above.shape[0] - 3, -1, -2):
            quads.append(side[i : i + 3].ravel())
            at = np.full(2, 1.0 if loaded else 0.0)
            points.append(np.stack([_ON_EDGE[::-1], at], axis=1))
            edges.append([1.0, 0.0])
        for k in range(half_gap):
            column = below.shape[1] - 2 * half_gap - 1 + 2 * k
            if not loaded:
                column = below.shape[1] - 3 - column
            quads.append(below[:, column : column + 3].ravel())
            on_edge = _ON_EDGE if loaded else _ON_EDGE[::-1]
            points.append(np.stack([np.ones(2), on_edge], axis=1))
            edges.append([0.0, 1.0])
        found.append((np.array(quads), np.array(points), np.array(edges)))
    return found


def _gathered(parts: list[np.ndarray], teeth: int) -> np.ndarray:
    return np.stack(parts).reshape(teeth, 2, *parts[0].shape)


def _across(gear: ToothedGear, outline: _Outline, sizing: ToothSizing) -> np.ndarray:
    """Ends of the elements across a tooth, from -1 to 1."""
    half = outline.split_radius * outline.split_angle
    graded = _graded(sizing.across // 2, 1.3 * _SKIN * gear.module / half)
    return np.concatenate([graded - 1.0, (1.0 - graded[::-1])[1:]])


def _add_ring_under(
    pieces: _Pieces, gear: ToothedGear, outline: _Outline, tooth: int, sizing: ToothSizing
) -> np.ndarray:
    """Returns the nodes of the uppermost elements, from below and from right to left."""
    half_gap = outline.gap(np.linspace(0.0, 1.0, sizing.gap + 1))
    across = _halved(_across(gear, outline, sizing))
    base = np.stack(
        [np.full(across.size, outline.split_radius), across * outline.split_angle], axis=1
    )
    mirrored = half_gap[::-1] * [1.0, -1.0]
    upper = np.vstack([mirrored[:-1], base, half_gap[1:]])
    upper[:, 1] += tooth * gear.pitch_angle
    counts = sizing.gap // 2, sizing.across, sizing.gap // 2
    even = _even_columns(gear, outline, counts) + tooth * gear.pitch_angle
    bore = 0.5 * gear.bore
    thick = gear.root_radius - bore
    blend = min(_BLEND * gear.module, 0.5 * thick)
    near = max(3, sizing.ring // 2)
    down = _halved(_graded(near, _SKIN * gear.module / blend))[:, None]
    top = _polar(upper[:, 0], upper[:, 1])[None]
    bottom = _polar(np.full(even.size, gear.root_radius - blend), even)[None]
    # From below upwards, so that elements turn the same way as those of the tooth.
    near_gap = ((1.0 - down[..., None]) * top + down[..., None] * bottom)[::-1]
    numbers = pieces.add(near_gap)
    _add_polar(pieces, _deep(gear, blend, near, sizing), even)
    return numbers[-3:]


def _even_columns(gear: ToothedGear, outline: _Outline, counts: tuple[int, int, int]) -> np.ndarray:
    """Angles of the nodes under a pitch where its outline is no longer felt."""
    parts = np.concatenate(
        [np.full(2 * counts[0], 0.5 / counts[0]), np.full(2 * counts[1], 0.5 / counts[1])]
    )
    gap = gear.pitch_angle - 2.0 * outline.split_angle
    sizes = np.concatenate(
        [
            parts[: 2 * counts[0]] * 0.5 * gap,
            parts[2 * counts[0] :] * 2.0 * outline.split_angle,
            parts[: 2 * counts[0]] * 0.5 * gap,
        ]
    )
    return -0.5 * gear.pitch_angle + np.concatenate([[0.0], np.cumsum(sizes)])


def _deep(gear: ToothedGear, blend: float, near: int, sizing: ToothSizing) -> np.ndarray:
    """Radii of the nodes of the plain part of the ring, from the bore up."""
    bore, count = 0.5 * gear.bore, max(2, sizing.ring - near)
    thick = gear.root_radius - blend - bore
    return gear.root_radius - blend - thick * _halved(_graded(count, 0.5 * blend / thick))[::-1]


def _add_polar(pieces: _Pieces, radii: np.ndarray, angles: np.ndarray) -> None:
    grid = np.broadcast_arrays(radii[:, None], angles[None, :])
    pieces.add(_polar(*grid))


def _add_plain_ring(
    pieces: _Pieces, gear: ToothedGear, sizing: ToothSizing, first: int, whole: int
) -> None:
    """The ring where it has no teeth."""
    start = (first + whole - 0.5) * gear.pitch_angle
    rest = 2.0 * math.pi - whole * gear.pitch_angle
    steps = [0.25 * gear.pitch_angle]
    while 2.0 * sum(steps) < rest:
        steps.append(min(steps[-1] * _GROWTH, math.pi / 9.0))
    sizes = np.array(steps + steps[::-1])
    angles = start + _halved(np.concatenate([[0.0], np.cumsum(sizes * rest / sizes.sum())]))
    bore = 0.5 * gear.bore
    blend = min(_BLEND * gear.module, 0.5 * (gear.root_radius - bore))
    near = max(3, sizing.ring // 2)
    down = _halved(_graded(near, _SKIN * gear.module / blend))
    upper = (gear.root_radius - blend * down)[::-1]
    _add_polar(pieces, upper, angles)
    _add_polar(pieces, _deep(gear, blend, near, sizing), angles)
