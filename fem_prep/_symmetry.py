"""Rotations about the axis that map a grid onto itself, and what they do to displacements."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

# How far from its place a turned node may be, as a part of the body's size.
_SAME = 1e-9


@dataclass(frozen=True)
class Rotation:
    """A rotation about z by one of several equal sectors, on points that it exchanges.

    **Fields:**

    - `sectors`: how many there are; 1: a full turn, which does nothing.
    - `image`: point that each point comes to, shape `[point]`.
    """

    sectors: int
    image: np.ndarray

    def matrix(self, times: int) -> np.ndarray:
        """Rotation matrix by some sectors, shape `[3, 3]`."""
        angle = 2 * math.pi * times / self.sectors
        turn = np.eye(3)
        turn[0, 0] = turn[1, 1] = math.cos(angle)
        turn[1, 0] = math.sin(angle)
        turn[0, 1] = -turn[1, 0]
        return turn

    def images(self, times: int) -> np.ndarray:
        """Points that the points come to after some sectors, shape `[point]`."""
        image = np.arange(len(self.image))
        for _ in range(times):
            image = self.image[image]
        return image

    def turned(self, motions: np.ndarray, times: int) -> np.ndarray:
        """Turn motions with the body.

        **Arguments:**

        - `motions`: three components at every point, shape `[3 point, column]`.
        - `times`: by how many sectors.

        **Returns:**

        The same motions, carried to the places that the points come to.
        """
        result = np.empty_like(motions).reshape(len(self.image), 3, -1)
        result[self.images(times)] = np.einsum(
            "ij,pjc->pic", self.matrix(times), motions.reshape(len(self.image), 3, -1)
        )
        return result.reshape(motions.shape)


def rotation_of(points: np.ndarray, sectors: int) -> Rotation | None:
    """The rotation by one sector, if it maps a set of points onto itself.

    **Arguments:**

    - `points`: shape `[point, 3]` [m].
    - `sectors`: in how many equal parts a turn is divided.

    **Returns:**

    The rotation, or None if a point would come to where there is none.
    """
    rotation = Rotation(sectors, np.arange(len(points)))
    turned = points @ rotation.matrix(1).T
    distance, nearest = KDTree(points).query(turned)
    image = np.asarray(nearest)
    same = np.all(distance <= _SAME * np.ptp(points, axis=0).max())
    return Rotation(sectors, image) if same and len(np.unique(image)) == len(points) else None
