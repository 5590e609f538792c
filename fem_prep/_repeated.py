r"""Matrices of a condensed body whose rim repeats from sector to sector, by waves around.

On the rim such a matrix $A$ is one small block $A_n$ for every number of waves $n$: with the rim's
part of the matrix $A_{rr} = F^* \mathrm{diag}(A_n) F$, border $B$ and corner $C$ of what is not of
the rim it is
$\begin{bmatrix} A_{rr} & B \\ B^T & C \end{bmatrix}$, and is solved by the blocks and by
$C - B^T A_{rr}^{-1} B$.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ._equal_sectors import EqualSectors

# How far forces may be off, over the largest: rounding leaves 1e-15.
_SAME = 1e-13


@dataclass(frozen=True)
class Repeated:
    """A symmetric matrix: by waves on the rim, as it is elsewhere.

    **Fields:**

    - `sectors`: of the rim.
    - `blocks`: of the rim, by number of waves, `[number, 3 each, 3 each]`.
    - `border`: between the rim and all others, `[3 rim, other]`.
    - `corner`: among the others, `[other, other]`.
    """

    sectors: EqualSectors
    blocks: np.ndarray
    border: np.ndarray
    corner: np.ndarray

    def plus(self, other: "Repeated", times: float) -> "Repeated":
        """The sum with some times another matrix of the same sectors."""
        return Repeated(
            self.sectors,
            self.blocks + times * other.blocks,
            self.border + times * other.border,
            self.corner + times * other.corner,
        )

    def times(self, motion: np.ndarray) -> np.ndarray:
        """Product with one or many columns, `[dof]` or `[dof, column]`."""
        rim, others = np.split(motion, [len(self.border)])
        moved = self._around(self.blocks, rim) + self.border @ others
        return np.concatenate([moved, self.border.T @ rim + self.corner @ others])

    def solver(self) -> Callable[[np.ndarray], np.ndarray]:
        """What solves for one or many columns, `[dof]` or `[dof, column]`."""
        blocks = np.linalg.inv(self.blocks)
        answers = self._around(blocks, self.border)
        corner = np.linalg.inv(self.corner - self.border.T @ answers)

        def solve(load: np.ndarray) -> np.ndarray:
            rim, others = np.split(load, [len(self.border)])
            moved = self._around(blocks, rim)
            others = corner @ (others - self.border.T @ moved)
            return np.concatenate([moved - answers @ others, others])

        return solve

    def _around(self, blocks: np.ndarray, motion: np.ndarray) -> np.ndarray:
        """Product of the rim's part."""
        columns = motion.reshape(len(motion), -1)
        return self.sectors.whole(blocks @ self.sectors.parts(columns)).reshape(motion.shape)


def repeated(sectors: EqualSectors, matrix: np.ndarray) -> Repeated | None:
    """A matrix taken apart, if its rim repeats but for rounding.

    **Arguments:**

    - `sectors`: of the rim.
    - `matrix`: symmetric, of a condensed body, `[dof, dof]`.

    **Returns:**

    The matrix, or `None`.
    """
    rim = 3 * sectors.nodes.size
    blocks = sectors.blocks(sectors.rows(matrix[:rim, :rim], 1))
    found = Repeated(sectors, blocks, matrix[:rim, rim:], matrix[rim:, rim:])
    # Asked for one motion that no two sectors share, as to compare all numbers takes longer.
    motion = np.random.default_rng(0).standard_normal(len(matrix))
    forces = matrix @ motion
    return found if abs(found.times(motion) - forces).max() <= _SAME * abs(forces).max() else None
