"""What rim nodes of equal sectors say to each other, from the rows of one sector.

In the frame of its own sector each says to the others what any other does, so that the rim's block
of a matrix is known from the rows of the first sector's nodes, up to half a turn ahead.
"""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ._artefact import ReducedBody

if TYPE_CHECKING:
    from ._symmetry import Rotation


class EqualSectors:
    """Rim nodes of a body by sectors.

    **Fields:**

    - `nodes`: each the image of that before, `[sector, each]`.
    - `turns`: of a vector by so many sectors, `[sector, 3, 3]`.
    """

    def __init__(self, rotation: "Rotation"):
        self.nodes, self.turns = rotation.orbits(), rotation.matrices

    @property
    def ahead(self) -> int:
        """How many sectors are told apart: from none to half a turn."""
        return len(self.nodes) // 2 + 1

    def rows(self, block: np.ndarray, sign: int) -> np.ndarray:
        """The rows of the first sector that the whole block follows from.

        **Arguments:**

        - `block`: of the rim, symmetric or, if `sign` is -1, skew, `[3 node, 3 node]`.
        - `sign`: 1 or -1.

        **Returns:**

        What the first sector's nodes say to those so many sectors ahead,
        `[sector ahead, 3 each, 3 each]`.
        """
        dofs = self._dofs
        found = np.stack([block[np.ix_(dofs[0], dofs[step])] for step in range(self.ahead)])
        found[0] = 0.5 * (found[0] + sign * found[0].T)
        return found

    def block(self, rows: np.ndarray, sign: int, more: int = 0) -> np.ndarray:
        """The rim's block from the rows of the first sector.

        **Arguments:**

        - `rows`, `sign`: as of `rows`.
        - `more`: rows and columns left open behind it.

        **Returns:**

        The block; of it `rows` are the same to the last digit, and what lies on the other side of
        the diagonal is the same number.
        """
        dofs, (count, each) = self._dofs, self.nodes.shape
        turns = np.einsum("ab,sij->saibj", np.eye(each), self.turns)
        turns = turns.reshape(count, 3 * each, 3 * each)
        result = np.empty((dofs.size + more, dofs.size + more))
        for step, values in enumerate(rows):
            turned = turns @ values @ np.swapaxes(turns, 1, 2)
            if step == 0:
                turned = 0.5 * (turned + sign * np.swapaxes(turned, 1, 2))
            # Half a turn ahead is half a turn behind: once is enough.
            here = np.arange(count if 2 * step < count else count // 2)
            first, second = dofs[here], dofs[(here + step) % count]
            result[first[:, :, None], second[:, None, :]] = turned[here]
            if step:
                back = sign * np.swapaxes(turned[here], 1, 2)
                result[second[:, :, None], first[:, None, :]] = back
        return result

    def blocks(self, rows: np.ndarray) -> np.ndarray:
        """A symmetric block of the rim by number of waves around: what multiplies `parts`.

        **Arguments:**

        - `rows`: as of `rows`.

        **Returns:**

        For every number from none to half as many as sectors, `[number, 3 each, 3 each]`.
        """
        count, each = self.nodes.shape
        local = np.empty((count, 3 * each, 3 * each))
        # Both in the frames of their own sectors; the other way round is the same, transposed.
        for step, values in enumerate(rows):
            local[step] = values @ np.kron(np.eye(each), self.turns[step])
            local[-step % count] = local[step] if step in (0, count / 2) else local[step].T
        return np.conj(np.fft.rfft(local, axis=0))

    def parts(self, motion: np.ndarray) -> np.ndarray:
        """Amplitudes of motions of the rim, `[3 rim, column]` to `[number, 3 each, column]`."""
        count, each = self.nodes.shape
        moved = motion.reshape(count * each, 3, -1)[self.nodes]
        local = np.einsum("sij,seic->sejc", self.turns, moved).reshape(count, 3 * each, -1)
        return np.fft.rfft(local, axis=0, norm="ortho")

    def whole(self, parts: np.ndarray) -> np.ndarray:
        """Motions of the rim of given amplitudes: the way back from `parts`."""
        count, each = self.nodes.shape
        local = np.fft.irfft(parts, count, axis=0, norm="ortho").reshape(count, each, 3, -1)
        motion = np.empty((count * each, 3, local.shape[-1]))
        motion[self.nodes] = np.einsum("sij,sejc->seic", self.turns, local)
        return motion.reshape(3 * count * each, -1)

    @property
    def _dofs(self) -> np.ndarray:
        """Coordinates of the nodes of each sector, `[sector, 3 each]`."""
        return (3 * self.nodes[:, :, None] + np.arange(3)).reshape(len(self.nodes), -1)


def equal_sectors(rim_nodes: np.ndarray, facts: Mapping[str, object]) -> EqualSectors | None:
    """The sectors of a body, if it says that it has three or more and its rim nodes are so.

    **Arguments:**

    - `rim_nodes`: places of the rim nodes [m].
    - `facts`: of the body.

    **Returns:**

    The sectors, or `None`.
    """
    sectors = facts.get("sectors", 1)
    if not isinstance(sectors, int) or sectors < 3 or not len(rim_nodes):
        return None
    # Not above: SciPy takes long to import, and who looks at kept files needs none of it.
    from ._symmetry import rotation_of

    rotation = rotation_of(rim_nodes, sectors)
    found = None if rotation is None else EqualSectors(rotation)
    return found if found is not None and found.nodes.size == len(rim_nodes) else None


def signs(name: str) -> int:
    """1 of a symmetric matrix of a body, -1 of that of its Coriolis forces."""
    return -1 if name == "coriolis" else 1


# The matrices of a body that repeat from sector to sector.
MATRICES = ("stiffness", "mass", "coriolis", "spin_softening", "stress_stiffening")


def evened(body: ReducedBody) -> ReducedBody:
    """A body of equal sectors whose rim is so to the last digit, and not but for rounding.

    **Arguments:**

    - `body`: condensed, its sectors equal but for rounding.

    **Returns:**

    The body; the same if it is not of equal sectors.
    """
    sectors, rim = equal_sectors(body.rim_nodes, body.facts), 3 * len(body.rim_nodes)
    if sectors is None:
        return body
    found = {}
    for name in MATRICES:
        matrix, sign = getattr(body, name), signs(name)
        if matrix is not None:
            rows = sectors.rows(matrix[:rim, :rim], sign)
            found[name] = sectors.block(rows, sign, more=len(matrix) - rim)
            found[name][rim:], found[name][:rim, rim:] = matrix[rim:], matrix[:rim, rim:]
    return dataclasses.replace(body, **found)
