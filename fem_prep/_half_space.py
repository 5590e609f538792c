r"""What an elastic half-space gives under strips along a flank: the part that elements cannot show.

A force on a half-space lowers its surface at a distance $r$ by $(1-\nu^2)/(\pi E r)$ (Boussinesq).
Loads on narrow patches of a body do the same near by, and something smooth besides. The former is
known, so elements need only give the latter. Mirror images of the strips at both faces stand for
the free ends: what is left of those is smooth too.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from ._assembly import Material
from ._prism import FaceWaves

# Cells over the face, and points across a pair of strips: means are met to 1e-4 and better.
_CELLS = 240
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(20)


@dataclass(frozen=True)
class Strips:
    r"""Strips that follow the flank of a gear from face to face.

    **Fields:**

    - `ends`: of the strips, by length along the profile, shape `[strip + 1]` [m].
    - `slant`: $\tau\rho$ at the middle of each: what twist moves it along the profile per length of
        the axis [-].
    - `stretch`: length along each per length of the axis [-].
    """

    ends: np.ndarray
    slant: np.ndarray
    stretch: np.ndarray


def strip_compliance(strips: Strips, waves: FaceWaves, material: Material) -> np.ndarray:
    """Compliance of a half-space between loads on strips, in waves along the axis.

    Loads are spread evenly across a strip, motions are the mean across it.

    **Arguments:**

    - `strips`: of the flank.
    - `waves`: along the axis.
    - `material`: of the body.

    **Returns:**

    Shape `[strip, wave, strip, wave]` [m2/N].
    """
    ends = np.linspace(-0.5, 0.5, _CELLS + 1) * waves.width
    cell = waves.width / _CELLS
    shapes = cell * waves.means(ends)
    number = np.arange(_CELLS)
    apart = number[:, None] - number[None, :] + _CELLS - 1
    # The middles of two cells, one of them mirrored, are as far apart as their sum says.
    left, right = (number[:, None] + number[None, :] + 1), 0
    right = 2 * _CELLS - left
    count = len(strips.slant)
    result = np.empty((count, waves.count, count, waves.count))
    for i in range(count):
        for j in range(i + 1):
            direct = _means(strips, i, j, cell * np.arange(1 - _CELLS, _CELLS), cell, True)
            image = _means(strips, i, j, cell * np.arange(2 * _CELLS + 1), cell, False)
            between = direct[apart] + image[left] + image[right]
            block = shapes.T @ between @ shapes
            result[i, :, j], result[j, :, i] = block, block.T
    return (1.0 - material.poisson**2) / (math.pi * material.young) * result


def _means(
    strips: Strips, i: int, j: int, along: np.ndarray, cell: float, slanted: bool
) -> np.ndarray:
    """Mean of 1/r between cells of two strips, at distances along the axis [1/m]."""
    middles = 0.5 * (strips.ends[1:] + strips.ends[:-1])
    stretch = 0.5 * (strips.stretch[i] + strips.stretch[j])
    slant = -0.5 * (strips.slant[i] + strips.slant[j]) / stretch if slanted else 0.0
    centre = middles[i] - middles[j]
    mean, outer = np.zeros(len(along)), np.diff(strips.ends)[[i, j]]
    # The distance across of two even strips is spread as a trapezium.
    inner, reach = 0.5 * abs(outer[0] - outer[1]), 0.5 * outer.sum()
    kinks = np.array([centre - reach, centre - inner, centre + inner, centre + reach, 0.0])
    kinks = np.unique(kinks[(kinks >= centre - reach) & (kinks <= centre + reach)])
    for low, high in itertools.pairwise(kinks):
        u = 0.5 * (_POINTS + 1.0)
        # Points close up towards both ends, where the integrand has a logarithm.
        across = low + (high - low) * u**2 * (3.0 - 2.0 * u)
        weights = 0.5 * _WEIGHTS * (high - low) * 6.0 * u * (1.0 - u)
        weights = weights * _trapezium(across - centre, inner, reach)
        mean += _cell_means(across, along, cell, slant, stretch) @ weights
    return mean


def _trapezium(x: np.ndarray, inner: float, reach: float) -> np.ndarray:
    height = 1.0 / (inner + reach)
    if reach - inner < 1e-12 * reach:
        return np.full_like(x, height)
    return height * np.clip((reach - np.abs(x)) / (reach - inner), 0.0, 1.0)


def _cell_means(
    across: np.ndarray, along: np.ndarray, cell: float, slant: float, stretch: float
) -> np.ndarray:
    """Mean of 1/r over two cells of lines, `across` apart, shape `[along, across]` [1/m]."""
    square = np.abs(across) * math.sqrt(1.0 - slant**2)
    place = stretch * along[:, None] + slant * across
    size = stretch * cell

    def twice(y: np.ndarray) -> np.ndarray:
        """The second integral of 1/r along a line."""
        return y * np.arcsinh(y / square) - np.hypot(square, y)

    return (twice(place + size) - 2.0 * twice(place) + twice(place - size)) / size**2
