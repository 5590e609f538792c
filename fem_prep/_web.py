"""The finite element grid of a gear body given by its measures.

The body is cut into blocks that are extruded along the axis: the shaft with the hub, the web, the
rim. Seen along the axis all have the same elements around, so that they meet node on node. Nodes
of edges that are arcs lie on their circle, those of a leaning web on its faces; all other edges are
straight.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, pi

import numpy as np

from ._checks import BodyError, require
from ._extrude import extruded_grid
from ._grid import Grid, merged
from ._planar import annulus, core, core_reach, perforated
from ._plate import Holes, Web
from ._section import GearBody, SeatPlace, Segment, Stretch, seat_band, stretches, under_hub
from ._section_properties import Properties, exact_properties

__all__ = [
    "GearBody",
    "Holes",
    "MeshSizing",
    "Properties",
    "SeatPlace",
    "Segment",
    "Web",
    "body_grid",
    "exact_properties",
    "symmetry",
]


@dataclass(frozen=True)
class MeshSizing:
    """How finely a body is cut into elements.

    Counts hold about: edges, seats and the web's faces are always edges of elements too.

    **Fields:**

    - `sectors`: elements around; the number of teeth, or a multiple of it, to give every tooth the
        same.
    - `rim_axial`: elements across the toothed face, and as long ones under it in hub and web;
        None: 0.7 times as long as the rim's arcs, at least 3.
    - `rim_radial`: elements through the rim; None: two, or about as thick as its arcs are long.
    - `web_radial`: elements from hub to rim, or through a solid disc; None: about as long as the
        outermost arcs, at least 4.
    - `web_layers`: elements through the web, at least.
    - `hub_radial`: elements from the shaft or the bore to the hub's outside.
    - `shaft`: largest length of an element of the shaft, along and across [m]; None: a quarter of
        the segment's outer diameter.
    """

    sectors: int
    rim_axial: int | None = None
    rim_radial: int | None = None
    web_radial: int | None = None
    web_layers: int = 1
    hub_radial: int = 3
    shaft: float | None = None

    def __post_init__(self) -> None:
        least = {"sectors": 8, "rim_axial": 1, "rim_radial": 1, "web_radial": 1}
        least |= {"web_layers": 1, "hub_radial": 1}
        for name, low in least.items():
            value = getattr(self, name)
            require(
                value is None or value >= low,
                f"{{MeshSizing.{name}}} must be at least {{low}}, got {{value}}.",
                low=low,
                value=value,
            )
        require(
            self.shaft is None or self.shaft > 0,
            "{MeshSizing.shaft} must be positive, got {value} m.",
            value=self.shaft,
        )


def body_grid(body: GearBody, fineness: MeshSizing) -> Grid:
    """The grid of a body.

    Edges of elements lie at the angles `(j - 1/2) 2 pi / sectors`, whether there are holes or not.
    `symmetry` says by which turns the grid goes over into itself.

    **Arguments:**

    - `body`: its measures.
    - `fineness`: numbers of elements.

    **Returns:**

    Its sets are `rim`, the nodes on the outer cylinder of the toothed face; without a shaft
    `seat:bore`, those on the bore; with one `seat:NAME`, those on its outside within each seat, and
    `seat:gear`, those on its inside under the hub. In what is solid that is the innermost elements
    instead, also without a shaft.

    **Raises:**

    - `BodyError` if the elements around do not suit the holes or a solid shaft.
    """
    _check_sectors(body, fineness.sectors)
    sizes = _sizes(body, fineness)
    columns, floors = _columns(body, sizes), _floors(body, sizes)
    blocks = _shaft(body, columns, floors, sizes.sectors)
    if body.web is not None:
        shares = _shares(body.web, floors)
        blocks += [
            *_disc(body, body.web, fineness, shares),
            *_rim(body, body.web, sizes, shares),
        ]
    places = np.concatenate(blocks)
    numbers = np.arange(20 * len(places)).reshape(-1, 20)
    nodes, bricks = merged(places.reshape(-1, 3), numbers, body.same)
    return Grid(nodes, bricks, _sets(body, nodes, columns[0], sizes.sectors))


def symmetry(body: GearBody, fineness: MeshSizing) -> int:
    """By how many equal turns about the axis a body's grid goes over into itself."""
    if body.web is not None and body.web.holes:
        return int(np.gcd.reduce([ring.count for ring in body.web.holes]))
    return fineness.sectors // 2 if _solid(body) else fineness.sectors


def _solid(body: GearBody) -> bool:
    """Whether there is material on the axis."""
    return any(stretch.inner == 0 for stretch in stretches(body))


def _step(body: GearBody) -> int:
    """What the number of elements around must be a multiple of."""
    rings = body.web.holes if body.web else ()
    return int(np.lcm.reduce([1, *(ring.count for ring in rings)])) * (1 + _solid(body))


def _check_sectors(body: GearBody, sectors: int) -> None:
    """Refuse a number of elements around that does not repeat with holes or a solid shaft."""
    rings, step = body.web.holes if body.web else (), _step(body)
    below = sectors // step * step
    reason = " and ".join(
        [f"{ring.count} holes repeat around the axis" for ring in rings]
        + ["elements around a solid axis are laid in pairs"] * _solid(body)
    )
    require(
        sectors == below,
        "{MeshSizing.sectors} must be a multiple of {step}, because {reason}; got {sectors}. "
        "Take {nearest}.",
        step=step,
        reason=reason,
        sectors=sectors,
        nearest=f"{below} or {below + step}" if below >= 8 else below + step,
    )


@dataclass(frozen=True)
class _Sizes:
    """What a fineness means for a body.

    Counts around, through the rim and through the web; lengths [m] along the axis under the rim,
    along the radius in web and hub, and in the shaft (None: by its diameter).
    """

    sectors: int
    rim: int
    layers: int
    axial: float
    web: float
    hub: float
    shaft: float | None

    def along(self, stretch: Stretch) -> float:
        """Length of an element of the shaft [m]."""
        return self.shaft or stretch.outer / 2


def _sizes(body: GearBody, fineness: MeshSizing) -> _Sizes:
    """Counts and lengths that are not given follow from the lengths of arcs."""
    arc = pi * body.rim_outer / fineness.sectors
    axial = body.rim_width / (fineness.rim_axial or max(3, round(body.rim_width / (0.7 * arc))))
    foot = max(stretch.outer for stretch in under_hub(body))
    rim, layers, collar = 0, 0, body.hub_outer / 2 - foot
    span, inner = collar, body.rim_outer / 2
    if body.web is not None:
        inner = body.web.rim_inner / 2
        span = inner - body.web.hub_outer / 2
        # One alone would leave TE's RMS in mesh 1.4 % too low.
        rim = fineness.rim_radial or max(2, round((body.rim_outer / 2 - inner) / arc))
        layers = max(fineness.web_layers, _count(body.web.axial_thickness, axial))
    web = span / (fineness.web_radial or max(4, round(span * fineness.sectors / (2 * pi * inner))))
    hub = web if body.web is None else collar / fineness.hub_radial
    return _Sizes(fineness.sectors, rim, layers, axial, web, hub, fineness.shaft)


def _count(length: float, size: float) -> int:
    """Number of elements of a size, or a tenth larger, along a length."""
    return max(1, ceil(length / size - 0.1))


def _distinct(values: list[float], same: float) -> list[float]:
    """Values in order, without those that are the same as the one before."""
    ordered = sorted(values)
    return ordered[:1] + [b for a, b in pairwise(ordered) if b - a > same]


@dataclass(frozen=True)
class _Interval:
    """A range of radius or of z in which the section does not change, cut into elements."""

    low: float
    high: float
    count: int

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2

    @property
    def ends(self) -> np.ndarray:
        """Ends of the elements, shape `[count + 1]` [m]."""
        return np.linspace(self.low, self.high, self.count + 1)


def _columns(body: GearBody, sizes: _Sizes) -> list[_Interval]:
    """Ranges of radius in shaft and hub."""
    shaft, hub = stretches(body), body.hub_outer / 2
    foot = max(stretch.outer for stretch in under_hub(body))
    edges = [hub, *(s.inner for s in shaft), *(s.outer for s in shaft)]

    columns = []
    for low, high in pairwise(_distinct(edges, body.same)):
        middle = (low + high) / 2
        size = sizes.hub
        if not foot < middle < hub:
            size = min(sizes.along(s) for s in shaft if s.inner < middle < s.outer)
        least = 2 if low == 0 else 1
        columns.append(_Interval(low, high, max(least, _count(high - low, size))))
    return columns


def _floors(body: GearBody, sizes: _Sizes) -> list[_Interval]:
    """Ranges of z in shaft and hub."""
    shaft, half, web = stretches(body), body.hub_width / 2, body.web
    edges = [-half, half, *(s.start for s in shaft), *(s.end for s in shaft)]
    edges += [end for seat in body.seats for end in seat_band(body, seat)[:2]]
    low = high = 0.0
    if web is not None:
        low, high = web.low(web.hub_outer / 2), web.high(web.hub_outer / 2)
        edges += [low, high]

    floors = []
    for start, end in pairwise(_distinct(edges, body.same)):
        middle = (start + end) / 2
        size = sizes.axial
        if low < middle < high:
            size = (high - low) / sizes.layers
        elif abs(middle) > half:
            size = next(sizes.along(s) for s in shaft if s.start < middle < s.end)
        floors.append(_Interval(start, end, _count(end - start, size)))
    return floors


def _inside(body: GearBody, radius: float, z: float) -> bool:
    """Whether a place lies in shaft or hub."""
    stretch = next(s for s in stretches(body) if s.start < z < s.end)
    outer = body.hub_outer / 2 if abs(z) < body.hub_width / 2 else stretch.outer
    return stretch.inner < radius < outer


def _shaft(
    body: GearBody, columns: list[_Interval], floors: list[_Interval], sectors: int
) -> list[np.ndarray]:
    """Bricks of shaft and hub."""
    bricks = []
    for column in columns:
        if column.low == 0:
            quads = core(column.high, column.count, sectors)
        else:
            quads = annulus(list(column.ends), sectors)
        for floor in floors:
            if _inside(body, column.middle, floor.middle):
                bricks += [extruded_grid(quads, *ends) for ends in pairwise(floor.ends)]
    return bricks


def _shares(web: Web, floors: list[_Interval]) -> np.ndarray:
    """Heights of the web's layers above its lower face, as shares of its thickness."""
    low, high = web.low(web.hub_outer / 2), web.high(web.hub_outer / 2)
    floors = [floor for floor in floors if low < floor.middle < high]
    levels = np.concatenate([floors[0].ends[:1], *(floor.ends[1:] for floor in floors)])
    return (levels - low) / web.axial_thickness


def _disc(body: GearBody, web: Web, fineness: MeshSizing, shares: np.ndarray) -> list[np.ndarray]:
    """Bricks of the web."""
    quads = _plane(body, web, fineness)
    if quads is None:
        raise _too_few(body, web, fineness)
    low = web.low(np.hypot(quads[..., 0], quads[..., 1]))
    levels = [low + share * web.axial_thickness for share in shares]
    return [extruded_grid(quads, *ends) for ends in pairwise(levels)]


def _plane(body: GearBody, web: Web, fineness: MeshSizing) -> np.ndarray | None:
    """The web seen along the axis; None if there are too few elements around for its holes."""
    size, ends = _sizes(body, fineness).web, (web.hub_outer / 2, web.rim_inner / 2)
    return perforated(*ends, size, fineness.sectors, web.holes)


def _too_few(body: GearBody, web: Web, fineness: MeshSizing) -> BodyError:
    """What to say of too few elements around for the holes."""
    step, given = _step(body), fineness.sectors
    more = (replace(fineness, sectors=count) for count in range(given + step, 4 * given, step))
    enough = next((finer for finer in more if _plane(body, web, finer) is not None), None)
    if enough is None:
        return BodyError(
            "{Web.holes} must leave room for elements around every hole: between them, straight "
            "along radii or circles, there is too little. Make them smaller, move their circles "
            "apart, or mesh the body elsewhere and read that grid.",
            {},
        )
    return BodyError(
        "{MeshSizing.sectors} must be large enough for elements to go around every hole, got "
        "{given}. Take {enough}, or leave more material between holes, hub and rim.",
        {"given": given, "enough": enough.sectors},
    )


def _rim(body: GearBody, web: Web, sizes: _Sizes, shares: np.ndarray) -> list[np.ndarray]:
    """Bricks of the rim."""
    inner, outer, half = web.rim_inner / 2, body.rim_outer / 2, body.rim_width / 2
    low, high = web.low(inner), web.high(inner)
    parts = [
        _Interval(start, end, _count(end - start, sizes.axial)).ends
        for start, end in ((-half, low), (high, half))
        if end - start > body.same
    ]
    parts.append(low + shares * web.axial_thickness)
    quads = annulus(list(_Interval(inner, outer, sizes.rim).ends), sizes.sectors)
    return [extruded_grid(quads, *ends) for part in parts for ends in pairwise(part)]


def _sets(
    body: GearBody, nodes: np.ndarray, first: _Interval, sectors: int
) -> dict[str, np.ndarray]:
    """Nodes of the rim and of the seats."""
    half = body.hub_width / 2
    near = core_reach(first.high, first.count, sectors) if first.low == 0 else 0.0
    gear = [
        _band(body, nodes, max(s.start, -half), min(s.end, half), s.inner, s.inner or near)
        for s in under_hub(body)
    ]
    name = "seat:gear" if body.segments or body.bore == 0 else "seat:bore"
    sets = {
        "rim": _band(body, nodes, -body.rim_width / 2, body.rim_width / 2, body.rim_outer / 2),
        name: np.unique(np.concatenate(gear)),
    }
    for seat in body.seats:
        start, end, radius = seat_band(body, seat)
        sets[f"seat:{seat.name}"] = _band(body, nodes, start, end, radius)
    return sets


def _band(
    body: GearBody,
    nodes: np.ndarray,
    start: float,
    end: float,
    inner: float,
    outer: float | None = None,
) -> np.ndarray:
    """Nodes in a range of z and of distance from the axis, or on a cylinder."""
    radius, z = np.hypot(nodes[:, 0], nodes[:, 1]), nodes[:, 2]
    across = (inner - body.same < radius) & (radius < (outer or inner) + body.same)
    return np.flatnonzero(across & (start - body.same < z) & (z < end + body.same))
