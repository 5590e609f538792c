"""The disc between hub and rim by its measures, with rings of holes; and what cannot be.

Lengths are in metres, `hub_outer`, `rim_inner`, `circle` and `diameter` are diameters. The axis is
z with z = 0 in the middle of the toothed face, x points towards the middle of tooth 0.
"""

from dataclasses import dataclass
from itertools import combinations
from math import cos, pi, tan

import numpy as np

from ._checks import require


@dataclass(frozen=True)
class Holes:
    """A ring of equal round holes through a web, drilled parallel to the axis.

    **Fields:**

    - `count`: number of holes.
    - `diameter`: of a hole, in the plane normal to the axis [m].
    - `circle`: diameter of the circle on which the centres lie [m].
    - `angle`: of the first centre, from the middle of tooth 0 [rad].
    """

    count: int
    diameter: float
    circle: float
    angle: float = 0.0

    def __post_init__(self) -> None:
        require(self.count >= 1, "{Holes.count} must be at least 1, got {n}.", n=self.count)
        require(
            0 < self.diameter < self.circle,
            "{Holes.diameter} must be positive and less than {Holes.circle}, got {d:.4g/mm} mm and "
            "{c:.4g/mm} mm: the axis must not lie in a hole.",
            d=self.diameter,
            c=self.circle,
        )

    @property
    def centres(self) -> np.ndarray:
        """Centres of the holes, shape `[hole, 2]` [m]."""
        angle = self.angle + 2 * pi * np.arange(self.count) / self.count
        return self.circle / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@dataclass(frozen=True)
class Web:
    """The disc between hub and rim.

    **Fields:**

    - `hub_outer`: where the web begins: outer diameter of the hub [m].
    - `thickness`: of the web, normal to its faces [m].
    - `rim_inner`: where the web ends: inner diameter of the rim [m].
    - `offset`: of the web's middle from mid-face, at the mean of its two diameters [m].
    - `angle`: by which the web leans, positive if z grows with the radius [rad].
    - `hub_width`: width of the hub, centred on mid-face; None: as wide as the rim [m].
    - `holes`: rings of holes.
    """

    hub_outer: float
    thickness: float
    rim_inner: float
    offset: float = 0.0
    angle: float = 0.0
    hub_width: float | None = None
    holes: tuple[Holes, ...] = ()

    def __post_init__(self) -> None:
        require(
            0 < self.hub_outer < self.rim_inner,
            "{Web.hub_outer} must be positive and less than {Web.rim_inner}, got {hub:.4g/mm} mm "
            "and {rim:.4g/mm} mm. Leave the web out for a solid disc.",
            hub=self.hub_outer,
            rim=self.rim_inner,
        )
        require(
            self.thickness > 0,
            "{Web.thickness} must be positive, got {t:.4g/mm} mm.",
            t=self.thickness,
        )
        require(
            abs(self.angle) <= pi / 3,
            "{Web.angle} must lie between -60 and 60 degrees, got {a:.4g} rad. Is it in radians?",
            a=self.angle,
        )
        for ring in self.holes:
            self._check_room(ring)
        _check_apart(self.holes)

    def _check_room(self, ring: Holes) -> None:
        """Refuse holes that cut the hub or the rim."""
        inside = (ring.circle - ring.diameter - self.hub_outer) / 2
        outside = (self.rim_inner - ring.circle - ring.diameter) / 2
        require(
            inside > 0 and outside > 0,
            "{Web.holes} must leave the {part} whole, but holes of {d:.4g/mm} mm on a circle of "
            "{c:.4g/mm} mm cut it by {cut:.4g/mm} mm. Between hub ({hub:.4g/mm} mm) and rim "
            "({rim:.4g/mm} mm) there is room for less than {room:.4g/mm} mm on that circle.",
            part="hub" if inside <= 0 else "rim",
            cut=-min(inside, outside),
            d=ring.diameter,
            c=ring.circle,
            hub=self.hub_outer,
            rim=self.rim_inner,
            room=min(ring.circle - self.hub_outer, self.rim_inner - ring.circle),
        )

    @property
    def axial_thickness(self) -> float:
        """Thickness of the web along the axis [m]."""
        return self.thickness / cos(self.angle)

    def low(self, radius):
        """Height of the web's lower face over a distance from the axis [m]."""
        mean = (self.hub_outer + self.rim_inner) / 4
        return self.offset + tan(self.angle) * (radius - mean) - self.axial_thickness / 2

    def high(self, radius):
        """Height of the web's upper face over a distance from the axis [m]."""
        return self.low(radius) + self.axial_thickness


def _check_apart(holes: tuple[Holes, ...]) -> None:
    """Refuse holes that overlap each other."""
    for number, ring in enumerate(holes):
        gap = np.inf
        if ring.count > 1:
            gap = ring.circle * np.sin(pi / ring.count) - ring.diameter
        require(
            gap > 0,
            "{Web.holes} must not overlap, but {n} holes of {d:.4g/mm} mm on a circle of "
            "{c:.4g/mm} mm do, by {cut:.4g/mm} mm. Make them fewer or smaller (ring {ring}).",
            n=ring.count,
            d=ring.diameter,
            c=ring.circle,
            cut=-gap,
            ring=number + 1,
        )
    for one, other in combinations(holes, 2):
        apart = np.linalg.norm(one.centres[:, None] - other.centres, axis=-1).min()
        gap = apart - (one.diameter + other.diameter) / 2
        require(
            gap > 0,
            "{Web.holes} must not overlap, but the rings on circles of {one:.4g/mm} mm and "
            "{other:.4g/mm} mm do, by {cut:.4g/mm} mm. Make the holes smaller or turn one ring.",
            one=one.circle,
            other=other.circle,
            cut=-gap,
        )
