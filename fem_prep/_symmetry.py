"""Rotations about the axis that map a grid onto itself, and what they do to displacements.

A body of N equal sectors is N / 2 + 1 problems of the size of one sector, each for motions with
some number of waves around: matrices that do not change when the body turns do not mix them.
Source: Thomas, Dynamics of rotationally periodic structures, Int. J. Numer. Methods Eng. 14 (1979).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_array, bsr_array, coo_array, csr_array, eye_array, kron
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

    @property
    def matrices(self) -> np.ndarray:
        """Rotation matrices by none, one, two sectors and so on, shape `[sector, 3, 3]`."""
        return np.array([self.matrix(times) for times in range(self.sectors)])

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

    def among(self, points: np.ndarray) -> "Rotation":
        """The rotation of some of the points, which come to places of such points, alone."""
        place = np.full(len(self.image), -1)
        place[points] = np.arange(len(points))
        return Rotation(self.sectors, place[self.image[points]])

    def orbits(self) -> np.ndarray:
        """Points off the axis, each the image of the one before it, `[sector, each]`.

        The first of each has the smallest number. With one sector all points count.
        """
        images = [np.arange(len(self.image))]
        for _ in range(self.sectors - 1):
            images.append(self.image[images[-1]])
        first = np.min(images, axis=0) == images[0]
        moved = (self.image != images[0]) | (self.sectors == 1)
        return np.array(images)[:, first & moved]


def full_turn(points: int) -> Rotation:
    """The rotation that leaves every point where it is."""
    return Rotation(1, np.arange(points))


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


@dataclass(frozen=True)
class Waves:
    r"""Motions by the number n of their waves around.

    In the frame of sector s such a motion is $v e^{2\pi i n s / N} / \sqrt{N}$; its amplitudes are
    $v$ and, for points on the axis, which only few waves move, components along `_along`. Real
    motions have waves of number -n too, whose amplitudes are the conjugate ones.

    **Fields:**

    - `rotation`: by one sector.
    - `ring`: points off the axis, each the image of the one before it, `[sector, each]`.
    - `axis`: points on the axis.
    """

    rotation: Rotation
    ring: np.ndarray
    axis: np.ndarray

    @property
    def weights(self) -> list[int]:
        """For every number of waves: 2, or 1 if waves of number -n are the same."""
        sectors = self.rotation.sectors
        return [1 if 2 * number % sectors == 0 else 2 for number in range(sectors // 2 + 1)]

    def parts(self, motions: np.ndarray) -> list[np.ndarray]:
        """Amplitudes of motions by number of waves, `[3 point, column]` to `[amplitude, column]`.

        Two motions have the same product as their amplitudes, if waves of number -n count too.
        """
        if self.rotation.sectors == 1:
            return [motions]
        columns = motions.shape[1]
        each = motions.reshape(self.ring.size + self.axis.size, 3, columns)
        parts = []
        for number, around in enumerate(self._around(each)):
            along = np.einsum("ij,pic->pjc", self._along(number).conj(), each[self.axis])
            both = [x.reshape(x.shape[0] * x.shape[1], columns) for x in (around, along)]
            part = np.concatenate(both)
            parts.append(np.real(part) if self.weights[number] == 1 else part)
        return parts

    def _around(self, motions: np.ndarray) -> np.ndarray:
        """Amplitudes of the ring's points, `[point, 3, column]` to `[number, each, 3, column]`."""
        # Apart, so that this, as large as the motions, is gone when they are dealt out.
        local = np.einsum("sij,spic->spjc", self.rotation.matrices, motions[self.ring])
        return np.fft.rfft(local, axis=0, norm="ortho")

    def whole(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Real motions of given amplitudes, `[amplitude, column]` to `[3 point, column]`."""
        (sectors, each), columns = self.ring.shape, parts[0].shape[1]
        if sectors == 1:
            return parts[0]
        around = np.reshape([part[: 3 * each] for part in parts], (len(parts), each, 3, columns))
        local = np.fft.irfft(around, sectors, axis=0, norm="ortho")
        motions = np.zeros((self.ring.size + self.axis.size, 3, columns))
        motions[self.ring] = np.einsum("sij,spjc->spic", self.rotation.matrices, local)
        for number, part in enumerate(parts):
            basis = self._along(number)
            along = part[3 * each :].reshape(len(self.axis), basis.shape[1], columns)
            moved = np.einsum("ij,pjc->pic", basis, along)
            motions[self.axis] += self.weights[number] * moved.real
        return motions.reshape(3 * len(motions), columns)

    def matrices(self, matrix: csr_array) -> Iterator[csr_array]:
        """Matrices on the amplitudes, one for every number of waves.

        **Arguments:**

        - `matrix`: shape `[3 point, 3 point]`; it does not change when the body turns.
        """
        (sectors, each), root = self.ring.shape, math.sqrt(self.rotation.sectors)
        if sectors == 1:
            yield matrix
            return
        # All sectors say the same, so the first one is asked, and its answer counts as often.
        ring, axis = _dofs(self.ring[0]), _dofs(self.axis)
        first, last = matrix[ring], matrix[axis]
        turns = np.repeat(self.rotation.matrices, each, axis=0)
        frames = bsr_array((turns, np.arange(len(turns)), np.arange(len(turns) + 1)))
        entries = (first[:, _dofs(self.ring.ravel())] @ frames).tocoo()
        sector, column = np.divmod(entries.col, len(ring))
        to_ring, to_axis, alone = root * last[:, ring], root * first[:, axis], last[:, axis]
        for number, weight in enumerate(self.weights):
            phase = np.exp(2j * math.pi * number * sector / sectors)
            found = entries.data * (phase.real if weight == 1 else phase)
            around = coo_array((found, (entries.row, column)), shape=(len(ring), len(ring)))
            along = kron(eye_array(len(self.axis)), self._along(number))
            back = along.conj().T
            blocks = [[around, to_axis @ along], [back @ to_ring, back @ alone @ along]]
            yield csr_array(block_array(blocks))

    def _along(self, number: int) -> np.ndarray:
        """Motions of a point on the axis, `[3, amplitude]`: those that a turn gives that phase."""
        sectors = self.rotation.sectors
        if number == 0:
            return np.array([[0.0], [0.0], [1.0]])
        if number == 1 and sectors == 2:
            return np.eye(3)[:, :2]
        if number == 1:
            return np.array([[1], [1j], [0]]) / math.sqrt(2)
        return np.zeros((3, 0))


def waves_of(rotation: Rotation) -> Waves:
    """Motions of the points of a rotation, by the number of their waves around."""
    ring = rotation.orbits()
    return Waves(rotation, ring, np.setdiff1d(np.arange(len(rotation.image)), ring))


def _dofs(points: np.ndarray) -> np.ndarray:
    return (3 * points[:, None] + np.arange(3)).ravel()
