"""The shapes that a body is condensed on, of one sector where it repeats."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, csr_array

from ._boundary import FullBody
from ._hold import FixedInterface, column_blocks
from ._seats import dofs_of
from ._symmetry import Rotation, Waves, waves_of


@dataclass(frozen=True)
class Basis:
    """Shapes of the condensed coordinates, those of the rim for one sector only.

    What coordinates of the rim say to each other depends on how many sectors they are apart, if
    each is seen in the frame of its own sector.

    **Fields:**

    - `waves`: motions of the body by the number of their waves around.
    - `nodes`: rim nodes of every sector, each the image of the same before, `[sector, each]`.
    - `sector`: constraint modes of the rim nodes of the first sector, `[3 point, 3 each]`.
    - `others`: of seats, then interior shapes, `[3 point, other]`.
    """

    waves: Waves
    nodes: np.ndarray
    sector: np.ndarray
    others: np.ndarray

    @property
    def rim(self) -> int:
        """Number of coordinates of the rim."""
        return 3 * self.nodes.size

    @property
    def frames(self) -> csr_array:
        """Coordinates of the rim from the same, sector by sector, each in its own frame."""
        place = np.argsort(self.nodes.ravel())
        turns = self.waves.rotation.matrices[place // self.nodes.shape[1]]
        return bsr_array((turns, place, np.arange(len(place) + 1))).tocsr()

    def among_rim(self, apart: np.ndarray) -> np.ndarray:
        """The rim's block of a matrix.

        **Arguments:**

        - `apart`: of coordinates of a sector and of one that is so many ahead,
            `[sector, 3 each, 3 each]`.

        **Returns:**

        Shape `[rim, rim]`.
        """
        number, frames = np.arange(len(apart)), self.frames
        # One name for all steps, as each of them is as large as the block.
        block = apart[(number - number[:, None]) % len(apart)]
        block = np.swapaxes(block, 1, 2).reshape(self.rim, self.rim)
        block = frames @ block.T
        return frames @ block.T

    def with_rim(self, apart: np.ndarray) -> np.ndarray:
        """Rows of the matrix from those of each sector, `[sector, row, 3 each]` to `[row, rim]`."""
        return (self.frames @ np.swapaxes(apart, 1, 2).reshape(self.rim, -1)).T

    def projected(self, matrix: csr_array, sign: float = 1.0) -> np.ndarray:
        """A matrix that does not change when the body turns, on the condensed coordinates.

        **Arguments:**

        - `matrix`: shape `[3 point, 3 point]`.
        - `sign`: 1: the matrix is symmetric; -1: skew.

        **Returns:**

        Shape `[dof, dof]`.
        """
        rim = self.rim
        result = np.zeros((rim + self.others.shape[1],) * 2)
        among, between = [], []
        shapes = (self.waves.parts(each) for each in (self.sector, self.others))
        numbers = zip(self.waves.weights, self.waves.matrices(matrix), *shapes, strict=True)
        for weight, each, sector, others in numbers:
            result[rim:, rim:] += weight * (others.conj().T @ (each @ others)).real
            for products, found in zip(
                (among, between), _products(each, sector, others, sign), strict=True
            ):
                products.append(found)
        result[:rim, :rim] = self.among_rim(self._apart(among))
        result[rim:, :rim] = self.with_rim(self._apart(between))
        result[:rim, rim:] = sign * result[rim:, :rim].T
        # In place, as the matrix is large.
        result += sign * result.T
        result /= 2
        return result

    def _apart(self, products: Sequence[np.ndarray]) -> np.ndarray:
        """Products with the sector's shapes after turns by none, one, two sectors and so on.

        **Arguments:**

        - `products`: of amplitudes, one for every number of waves, `[row, column]`.

        **Returns:**

        Shape `[sector, row, column]`.
        """
        # Turning by one sector takes a wave back by its phase.
        sectors = self.waves.rotation.sectors
        return np.fft.irfft(np.conj(products), sectors, axis=0, norm="forward")

    def rows(self, points: np.ndarray) -> np.ndarray:
        """Motion of some points in every coordinate, `[3 point, dof]`."""
        rotation = self.waves.rotation
        source, before, apart = np.argsort(rotation.image), points, []
        for turn in rotation.matrices:
            apart.append(np.kron(np.eye(len(points)), turn) @ self.sector[dofs_of(before)])
            before = source[before]
        return np.concatenate(
            [self.with_rim(np.array(apart)), self.others[dofs_of(points)]], axis=1
        )

    def loaded(self, load: np.ndarray) -> np.ndarray:
        """A load that does not change when the body turns, on the condensed coordinates."""
        rim = self.frames @ np.tile(self.sector.T @ load, len(self.nodes))
        return np.concatenate([rim, self.others.T @ load])


def _products(
    matrix: csr_array, sector: np.ndarray, others: np.ndarray, sign: float
) -> tuple[np.ndarray, np.ndarray]:
    """Products of a sector's shapes with themselves, and of the others with them."""
    columns = sector.shape[1]
    among = np.zeros((columns, columns), dtype=sector.dtype)
    between = np.zeros((others.shape[1], columns), dtype=sector.dtype)
    # Without symmetry of rotation these are most of the work: half of the first will do.
    for some in column_blocks(columns):
        moved = matrix @ sector[:, some]
        among[some.start :, some] = sector[:, some.start :].conj().T @ moved
        between[:, some] = others.conj().T @ moved
    return np.tril(among) + sign * np.tril(among, -1).conj().T, between


def basis_of(
    full: FullBody, held: FixedInterface, rotation: Rotation, interior: np.ndarray
) -> Basis:
    """Constraint modes and interior shapes."""
    nodes = rotation.among(full.rim_points).orbits()
    boundary = 3 * len(full.rim) + 6 * len(full.seats)
    first = dofs_of(nodes[0])
    unit = np.zeros((boundary, len(first)))
    unit[first, np.arange(len(first))] = 1.0
    seats = np.eye(boundary)[:, 3 * len(full.rim) :]
    return Basis(
        waves=waves_of(rotation),
        nodes=nodes,
        sector=held.followed(unit),
        others=np.concatenate([held.followed(seats), interior], axis=1),
    )
