r"""Shapes of a body of equal sectors: each is one wave around, known from its first two sectors.

Seen from their own sectors, which turn with them, motions of a wave of number $d$ obey
$U_{s+1} = 2\cos(d\alpha)\,U_s - U_{s-1}$, with $\alpha$ the angle of a sector: of
$U_s = A\cos(sd\alpha) + B\sin(sd\alpha)$ the sum of angles.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from ._artefact import ReducedBody
from ._equal_sectors import EqualSectors, equal_sectors


class SectorShapes(NamedTuple):
    """Shapes on the first two of equal sectors.

    **Fields:**

    - `waves`: number around of each, from none to half as many as sectors, `[shape]` [-].
    - `two`: displacements of the nodes of the first two sectors, `[shape, 2, each, 3]`.
    """

    waves: np.ndarray
    two: np.ndarray

    def whole(self, sectors: EqualSectors) -> np.ndarray:
        """The shapes on all nodes, `[shape, node, 3]`; on two sectors the same to the last digit.

        **Arguments:**

        - `sectors`: of the nodes.
        """
        count = len(sectors.nodes)
        angle = 2.0 * np.pi / count * self.waves[:, None]
        # What is the same or the opposite in every sector follows from the first one.
        plain = (2 * self.waves % count == 0)[:, None]
        step, sine = np.arange(count), np.where(plain, 1.0, np.sin(angle))
        first = np.where(plain, np.cos(step * angle), -np.sin((step - 1) * angle) / sine)
        second = np.where(plain, 0.0, np.sin(step * angle) / sine)
        own = np.einsum("sij,msei->msej", sectors.turns[:2], self.two)
        local = first[:, :, None, None] * own[:, :1] + second[:, :, None, None] * own[:, 1:]
        moved = np.einsum("sij,msej->msei", sectors.turns, local)
        moved[:, 0] = self.two[:, 0]
        moved[:, 1] = np.where(plain[..., None], moved[:, 1], self.two[:, 1])
        shapes = np.empty((len(self.waves), sectors.nodes.size, 3))
        shapes[:, sectors.nodes] = moved
        return shapes


def sector_shapes(shapes: np.ndarray, sectors: EqualSectors) -> SectorShapes:
    """The first two sectors of shapes, and of which wave each is most.

    **Arguments:**

    - `shapes`: displacements, `[shape, node, 3]`.
    - `sectors`: of the nodes.

    **Returns:**

    Them; what they make whole again are the shapes if each is of one wave.
    """
    moved = shapes[:, sectors.nodes]
    local = np.einsum("sij,msei->msej", sectors.turns, moved)
    size = np.sum(np.abs(np.fft.rfft(local, axis=1)) ** 2, axis=(2, 3))
    return SectorShapes(np.argmax(size, axis=1), np.ascontiguousarray(moved[:, :2]))


def of_one_wave_each(body: ReducedBody) -> ReducedBody:
    """A body of equal sectors whose interior shapes are waves to the last digit.

    **Arguments:**

    - `body`: condensed, its shapes waves but for rounding.

    **Returns:**

    The body; the same if it is not of equal sectors, or its shapes are no waves.
    """
    shapes = body.interior_shapes
    sectors = equal_sectors(body.nodes, body.facts) if shapes.size else None
    if sectors is None:
        return body
    found = sector_shapes(shapes, sectors).whole(sectors)
    if np.max(np.abs(found - shapes)) > _ROUNDING * np.max(np.abs(shapes)):
        return body
    return dataclasses.replace(body, interior_shapes=found)


# A wave is found to this of its largest: two sectors of many lie close to each other.
_ROUNDING = 1e-9
