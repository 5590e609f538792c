"""A gear body by its measures: hub or shaft, web, rim; what cannot be; and its exact mass.

Lengths are in metres, and `outer`, `inner` and `bore` are diameters. The
axis is z with z = 0 in the middle of the toothed face, x points towards the middle of tooth 0.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ._checks import require
from ._plate import Web

SAME = 1e-6
"""Lengths that differ by less than this share of the root diameter are taken for the same."""


@dataclass(frozen=True)
class Segment:
    """A stretch of shaft of constant section.

    **Fields:**

    - `length`: along the axis [m].
    - `outer`: outer diameter [m].
    - `inner`: inner diameter, zero for a solid shaft [m].
    """

    length: float
    outer: float
    inner: float = 0.0

    def __post_init__(self) -> None:
        require(
            self.length > 0,
            "{Segment.length} must be positive, got {length:.4g/mm} mm.",
            length=self.length,
        )
        require(
            0 <= self.inner < self.outer,
            "{Segment.inner} must not be negative and be less than {Segment.outer}, got "
            "{inner:.4g/mm} mm and {outer:.4g/mm} mm.",
            inner=self.inner,
            outer=self.outer,
        )


@dataclass(frozen=True)
class SeatPlace:
    """Where a bearing or coupling holds the shaft from outside.

    **Fields:**

    - `name`: of the seat.
    - `at`: its middle, from the left end of the shaft [m].
    - `width`: along the axis, cut at the ends of its segment and at the hub [m].
    """

    name: str
    at: float
    width: float


@dataclass(frozen=True)
class GearBody:
    """A gear without its teeth.

    **Fields:**

    - `rim_outer`: root diameter [m].
    - `rim_width`: width of the toothed face [m].
    - `bore`: diameter of the bore of a gear without a shaft, zero for none [m].
    - `web`: None for a solid disc.
    - `segments`: shaft of one piece with the body, from left (small z) to right; then `bore`
        does not count.
    - `gear_at`: mid-face from the left end of the shaft [m].
    - `seats`: where the shaft is held.
    """

    rim_outer: float
    rim_width: float
    bore: float = 0.0
    web: Web | None = None
    segments: tuple[Segment, ...] = ()
    gear_at: float = 0.0
    seats: tuple[SeatPlace, ...] = ()

    def __post_init__(self) -> None:
        _check_sizes(self)
        if self.web is not None:
            _check_web(self, self.web)
        if self.segments:
            _check_shaft(self)
        _check_seats(self)

    @property
    def hub_outer(self) -> float:
        """Outer diameter of the hub; of a solid disc, its own [m]."""
        return self.rim_outer if self.web is None else self.web.hub_outer

    @property
    def hub_width(self) -> float:
        """Width of the hub [m]."""
        given = None if self.web is None else self.web.hub_width
        return self.rim_width if given is None else given

    @property
    def same(self) -> float:
        """Lengths that differ by less are the same [m]."""
        return SAME * self.rim_outer


@dataclass(frozen=True)
class Stretch:
    """A stretch of shaft in the body's own frame.

    **Fields:**

    - `start`: z of its left end [m].
    - `end`: z of its right end [m].
    - `inner`: inner radius [m].
    - `outer`: outer radius [m].
    """

    start: float
    end: float
    inner: float
    outer: float

    def overlap(self, start: float, end: float) -> float:
        """Length that it shares with a range of z; negative: how far apart they are [m]."""
        return min(self.end, end) - max(self.start, start)


def stretches(body: GearBody) -> list[Stretch]:
    """The shaft in the body's own frame.

    A body without a shaft sits on a tube without thickness: its bore.
    """
    if not body.segments:
        half, radius = body.hub_width / 2, body.bore / 2
        return [Stretch(-half, half, radius, radius)]
    ends = np.cumsum([0.0, *(segment.length for segment in body.segments)]) - body.gear_at
    return [
        Stretch(float(start), float(end), segment.inner / 2, segment.outer / 2)
        for (start, end), segment in zip(pairwise(ends), body.segments, strict=True)
    ]


def under_hub(body: GearBody) -> list[Stretch]:
    """Stretches of the shaft on which the hub sits."""
    half = body.hub_width / 2
    return [s for s in stretches(body) if s.overlap(-half, half) > body.same]


def seat_band(body: GearBody, seat: SeatPlace) -> tuple[float, float, float]:
    """Part of the shaft's outer surface that a seat holds.

    **Returns:**

    z of its two ends and its radius [m].
    """
    at, half = seat.at - body.gear_at, seat.width / 2
    # A seat that reaches over a step belongs to the segment that it covers more of.
    here = max(stretches(body), key=lambda s: s.overlap(at - half, at + half))
    start, end = max(here.start, at - half), min(here.end, at + half)
    low, high = _covered(body, here.outer)
    if at <= low:
        end = min(end, low)
    if at >= high:
        start = max(start, high)
    return start, end, here.outer


def _covered(body: GearBody, radius: float) -> tuple[float, float]:
    """Range of z in which hub or web hides the shaft's surface [m]."""
    half, web = body.hub_width / 2, body.web
    if radius < body.hub_outer / 2 - body.same or web is None:
        return -half, half
    return web.low(radius), web.high(radius)


def _check_sizes(body: GearBody) -> None:
    """Refuse millimetres given as metres and sizes that are not positive."""
    require(
        body.rim_outer > 0 and body.rim_width > 0,
        "{GearBody.rim_outer} and {GearBody.rim_width} must be positive, got {outer:.4g} m and "
        "{width:.4g} m.",
        outer=body.rim_outer,
        width=body.rim_width,
    )
    longest = max(body.rim_outer, body.rim_width, sum(s.length for s in body.segments))
    require(
        body.rim_outer >= 1e-3 and longest <= 10,
        "{GearBody} must be between 1 mm and 10 m large, got a root diameter of {outer:.4g} m and "
        "a largest size of {longest:.4g} m. Lengths are in metres: 118 mm is 0.118.",
        outer=body.rim_outer,
        longest=longest,
    )
    require(
        0 <= body.bore < body.hub_outer or body.segments,
        "{GearBody.bore} must be less than the {part}, got {bore:.4g/mm} mm and {hub:.4g/mm} mm.",
        part="root diameter" if body.web is None else "hub's outer diameter",
        bore=body.bore,
        hub=body.hub_outer,
    )


def _check_web(body: GearBody, web: Web) -> None:
    """Refuse a web that sticks out of hub or rim."""
    require(
        web.rim_inner < body.rim_outer,
        "{Web.rim_inner} must be less than the root diameter {GearBody.rim_outer}, got "
        "{inner:.4g/mm} mm and {outer:.4g/mm} mm.",
        inner=web.rim_inner,
        outer=body.rim_outer,
    )
    ends = {"hub": (web.hub_outer, body.hub_width), "rim": (web.rim_inner, body.rim_width)}
    for part, (diameter, width) in ends.items():
        out = max(web.high(diameter / 2), -web.low(diameter / 2)) - width / 2
        require(
            out <= body.same,
            "{Web} must end within the {part}, but with thickness {t:.4g/mm} mm, offset {o:.4g/mm} "
            "mm and angle {a:.4g/deg} degrees it sticks out of its width of {w:.4g/mm} mm by "
            "{out:.4g/mm} mm.",
            part=part,
            t=web.thickness,
            o=web.offset,
            a=web.angle,
            w=width,
            out=out,
        )


def _check_shaft(body: GearBody) -> None:
    """Refuse a shaft that falls apart, misses the gear, or runs into it."""
    for number, (one, other) in enumerate(pairwise(body.segments), start=1):
        require(
            max(one.inner, other.inner) < min(one.outer, other.outer),
            "{GearBody.segments} must touch, but segments {n} and {next} share no material: "
            "inner to outer diameters are {a:.4g/mm} to {b:.4g/mm} mm and {c:.4g/mm} to {d:.4g/mm} "
            "mm.",
            n=number,
            next=number + 1,
            a=one.inner,
            b=one.outer,
            c=other.inner,
            d=other.outer,
        )
    length, half = sum(s.length for s in body.segments), body.hub_width / 2
    require(
        half - body.same <= body.gear_at <= length - half + body.same,
        "{GearBody.gear_at} must put the whole hub on the shaft: with {width:.4g/mm} mm of hub on "
        "{length:.4g/mm} mm of shaft it lies between {low:.4g/mm} and {high:.4g/mm} mm, got "
        "{at:.4g/mm} mm. Move the gear or lengthen the shaft.",
        width=body.hub_width,
        length=length,
        low=half,
        high=length - half,
        at=body.gear_at,
    )
    for number, stretch in enumerate(stretches(body), start=1):
        _check_clear(body, stretch, number)


def _check_clear(body: GearBody, stretch: Stretch, number: int) -> None:
    """Refuse a stretch of shaft thicker than the hub that runs into hub, web or rim."""
    if stretch.outer <= body.hub_outer / 2 + body.same:
        return
    half = body.hub_width / 2
    require(
        stretch.overlap(-half, half) <= body.same,
        "{GearBody.segments} must not be thicker than the {part} they carry ({hub:.4g/mm} mm), but "
        "segment {n} has an outer diameter of {outer:.4g/mm} mm.",
        part="disc" if body.web is None else "hub",
        hub=body.hub_outer,
        n=number,
        outer=2 * stretch.outer,
    )
    if body.web is None:
        return
    radii = body.web.hub_outer / 2, min(stretch.outer, body.web.rim_inner / 2)
    low, high = min(map(body.web.low, radii)), max(map(body.web.high, radii))
    if stretch.outer >= body.web.rim_inner / 2 - body.same:
        low, high = min(low, -body.rim_width / 2), max(high, body.rim_width / 2)
    require(
        stretch.overlap(low, high) < -body.same,
        "{GearBody.segments} must stay clear of web and rim, but segment {n} (outer diameter "
        "{outer:.4g/mm} mm) touches them. Make it shorter, or as thin as the hub.",
        n=number,
        outer=2 * stretch.outer,
    )


def _check_seats(body: GearBody) -> None:
    """Refuse seats off the shaft, under the hub, without width, or of the same name."""
    names = [seat.name for seat in body.seats]
    require(
        len({*names, "gear", "bore"}) == len(names) + 2,
        "{GearBody.seats} must have different names, other than `gear` and `bore`, got {names}.",
        names=names,
    )
    require(
        body.segments or not names,
        "{GearBody.seats} are places on a shaft, but the body has no `segments`; it is held at "
        "its bore by the set `seat:bore`. Leave out {names}.",
        names=names,
    )
    length = sum(s.length for s in body.segments)
    for seat in body.seats:
        require(
            seat.width > 0 and 0 <= seat.at <= length,
            "{SeatPlace.at} must lie on the shaft, 0 to {length:.4g/mm} mm from its left end, and "
            "{SeatPlace.width} be positive; seat {name} is at {at:.4g/mm} mm and {width:.4g/mm} mm "
            "wide.",
            length=length,
            name=seat.name,
            at=seat.at,
            width=seat.width,
        )
        start, end, radius = seat_band(body, seat)
        low, high = _covered(body, radius)
        require(
            end - start > body.same and (end <= low + body.same or start >= high - body.same),
            "{SeatPlace} {name} at {at:.4g/mm} mm lies under the hub or the web, which hides the "
            "shaft from {low:.4g/mm} to {high:.4g/mm} mm. Move it, or hold the body by the set "
            "`seat:gear`, its inner surface under the hub.",
            name=seat.name,
            at=seat.at,
            low=low + body.gear_at,
            high=high + body.gear_at,
        )
    _check_seats_apart(body)


def _check_seats_apart(body: GearBody) -> None:
    """Refuse seats that share a part of the shaft's surface."""
    bands = sorted((*seat_band(body, seat)[:2], seat.name) for seat in body.seats)
    for (_, end, one), (start, _, other) in pairwise(bands):
        require(
            start - end > body.same,
            "{GearBody.seats} must leave a gap between them, but {one} ends at {end:.4g/mm} mm and "
            "{other} begins at {start:.4g/mm} mm. Make them narrower.",
            one=one,
            other=other,
            end=end + body.gear_at,
            start=start + body.gear_at,
        )
