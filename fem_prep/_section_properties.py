"""Mass, inertia and volume of a drawn section, exactly."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from ._section import GearBody, stretches, under_hub

_Height = float | Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Properties:
    """Moments of a volume about the middle of the toothed face.

    **Fields:**

    - `volume`: [m^3].
    - `first`: integral of the place, shape `[3]` [m^4].
    - `second`: integral of the place times itself, shape `[3, 3]` [m^5].
    """

    volume: float
    first: np.ndarray
    second: np.ndarray

    @property
    def inertia(self) -> np.ndarray:
        """Tensor of inertia per density, shape `[3, 3]` [m^5]."""
        return np.trace(self.second) * np.eye(3) - self.second

    @property
    def polar(self) -> float:
        """Moment of inertia about the axis, per density [m^5]."""
        return float(self.inertia[2, 2])

    @property
    def transverse(self) -> float:
        """Mean moment of inertia about x and y, per density [m^5]."""
        return float(self.inertia[0, 0] + self.inertia[1, 1]) / 2

    def __add__(self, other: "Properties") -> "Properties":
        return Properties(
            self.volume + other.volume, self.first + other.first, self.second + other.second
        )

    def __sub__(self, other: "Properties") -> "Properties":
        return Properties(
            self.volume - other.volume, self.first - other.first, self.second - other.second
        )


def exact_properties(body: GearBody) -> Properties:
    """Volume, first and second moments of a body, to rounding.

    Every part is a ring, or a disc of which both faces are cones, on which the rule of `_column`
    is exact or converges geometrically.
    """
    half = body.hub_width / 2
    total = Properties(0.0, np.zeros(3), np.zeros((3, 3)))
    for piece in stretches(body):
        total += _column(piece.inner, piece.outer, piece.start, piece.end)
    for piece in under_hub(body):
        start, end = max(piece.start, -half), min(piece.end, half)
        total += _column(piece.outer, body.hub_outer / 2, start, end)
    web = body.web
    if web is None:
        return total
    total += _column(web.hub_outer / 2, web.rim_inner / 2, web.low, web.high)
    total += _column(web.rim_inner / 2, body.rim_outer / 2, -body.rim_width / 2, body.rim_width / 2)
    for holes in web.holes:
        for centre in holes.centres:
            total -= _column(0.0, holes.diameter / 2, web.low, web.high, centre)
    return total


def _column(
    inner: float, outer: float, low: _Height, high: _Height, centre: Sequence[float] = (0.0, 0.0)
) -> Properties:
    """Moments of what lies over an annulus between two heights.

    **Arguments:**

    - `inner`, `outer`: radii of the annulus [m].
    - `low`, `high`: heights, numbers or functions of the distance from the axis [m].
    - `centre`: of the annulus [m].
    """
    # Gauss points along the radius and equal steps around integrate polynomials of x, y, z exactly.
    point, weight = np.polynomial.legendre.leggauss(16)
    radius = (inner + outer) / 2 + (outer - inner) / 2 * point
    angle = 2 * pi * np.arange(48) / 48
    area = np.outer(weight * radius * (outer - inner) / 2, np.full(48, 2 * pi / 48)).ravel()
    x = (centre[0] + np.outer(radius, np.cos(angle))).ravel()
    y = (centre[1] + np.outer(radius, np.sin(angle))).ravel()
    radius = np.hypot(x, y)
    bottom, top = (
        np.asarray(height(radius) if callable(height) else np.full(radius.shape, height))
        for height in (low, high)
    )
    powers = [area * (top**n - bottom**n) / n for n in (1, 2, 3)]
    flat = np.stack([x, y])
    second = np.zeros((3, 3))
    second[:2, :2] = flat * powers[0] @ flat.T
    second[2, :2] = second[:2, 2] = flat @ powers[1]
    second[2, 2] = powers[2].sum()
    first = np.array([*(flat @ powers[0]), powers[1].sum()])
    return Properties(float(powers[0].sum()), first, second)
