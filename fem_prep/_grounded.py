r"""A full body in all its unknowns, floating or on springs, by one factor.

Its stiffness is factorised on supports that carry nothing if loads balance each other: for every
number of waves around as many as there are rigid motions with it. Springs, and motions of the body
as a whole, are added to that by the flexibility method.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, vstack

from ._assembly import order
from ._boundary import FullBody
from ._checks import Progress, silent
from ._hold import factor_by_waves
from ._modes import largest_rotation
from ._seats import dofs_of
from ._solvers import Factor
from ._symmetry import Rotation, full_turn, waves_of

# Rigid motions of unit size move single unknowns by 1e-4 and more; rounding leaves 1e-17 of those
# that have another number of waves around, or that supports hold already.
_MOVES = 1e-9

# What equal sectors may leave of a random load, every unknown counted by its own stiffness:
# rounding leaves 1e-11.
_LEFT = 1e-6


@dataclass(frozen=True)
class Grounded:
    """A full body on supports that keep it from moving as a whole.

    **Fields:**

    - `full`: the body.
    - `boundary`: coordinates of the boundary from the unknowns, `[boundary, 3 point]` [SI].
    - `factor`: of the stiffness on the supports.
    - `rigid`: rigid motions, `[3 point, 6]` [SI].
    """

    full: FullBody
    boundary: csr_array
    factor: Factor
    rigid: np.ndarray

    def floating(self, load: np.ndarray) -> np.ndarray:
        """Motion of the boundary of the free body under balanced loads, but for rigid motions."""
        return self.boundary @ self.factor.solve(load)


def grounded(full: FullBody, progress: Progress = silent) -> Grounded:
    """Put a full body on supports on the rim.

    **Arguments:**

    - `full`: the body.
    - `progress`: told what begins.

    **Returns:**

    The body, ready to be loaded.

    **Raises:**

    - `BodyError` if a part of it is loose.
    """
    rotation = largest_rotation(full)
    with progress(f"factorising {order(full.stiffness)} unknowns"):
        factor = _factor(full, rotation)
        # Its sectors are those of the condensation: it is asked whether the matrix has them too.
        if rotation.sectors > 1 and _left(full, factor) > _LEFT:
            factor = _factor(full, full_turn(full.points))
    return Grounded(full, _boundary_rows(full), factor, full.rigid_motions)


def _factor(full: FullBody, rotation: Rotation) -> Factor:
    """Factor of the stiffness on supports."""
    waves = waves_of(rotation)
    rim = dofs_of(np.flatnonzero(np.isin(waves.ring[0], full.rim_points)))
    rigid = full.rigid_motions
    parts = waves.parts(rigid / np.linalg.norm(rigid, axis=0))
    pairs = zip(waves.matrices(full.stiffness), parts, strict=True)
    return factor_by_waves(waves, (each + _supports(each, rim, part) for each, part in pairs))


def _supports(stiffness: csr_array, rim: np.ndarray, rigid: np.ndarray) -> coo_array:
    """Springs to the ground at as many amplitudes of the rim as there are rigid motions.

    **Arguments:**

    - `stiffness`: with one number of waves around, `[amplitude, amplitude]` [SI].
    - `rim`: amplitudes of the rim.
    - `rigid`: parts of the rigid motions with that number, `[amplitude, 6]`.

    **Returns:**

    Their stiffness, `[amplitude, amplitude]` [SI].
    """
    free, chosen = rigid[rim], []
    # Each where what the others leave free moves most.
    while (moved := np.linalg.norm(free, axis=1)).max() > _MOVES:
        row = free[moved.argmax()] / moved.max()
        free = free - np.outer(free @ row.conj(), row)
        chosen.append(rim[moved.argmax()])
    chosen = np.array(chosen, dtype=int)
    return coo_array((stiffness.diagonal()[chosen], (chosen, chosen)), stiffness.shape)


def _left(full: FullBody, factor: Factor) -> float:
    """How much of a load that no two sectors share is left by its answer, over the load."""
    scale, rigid = np.sqrt(full.stiffness.diagonal()), full.rigid_motions
    load = scale * np.random.default_rng(0).standard_normal(len(scale))
    load -= rigid @ np.linalg.solve(rigid.T @ rigid, rigid.T @ load)
    left = load - full.stiffness @ factor.solve(load)
    return float(np.linalg.norm(left / scale) / np.linalg.norm(load / scale))


def _boundary_rows(full: FullBody) -> csr_array:
    """Rows that give rim and seats, averaging or not, from the unknowns."""
    size = 3 * full.points
    every = csr_array(diags_array(np.ones(size)))
    blocks = [every[dofs_of(full.rim_points)]]
    ring = size - 6 * sum(not seat.averaging for seat in full.seats)
    mean = 0
    for seat in full.seats:
        if seat.averaging:
            blocks.append(full.averages[mean : mean + 6])
            mean += 6
        else:
            blocks.append(every[ring : ring + 6])
            ring += 6
    return csr_array(vstack(blocks))


def on_springs(
    body: Grounded, rows: np.ndarray, stiffness: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    r"""A solver of a full body on springs between its boundary and the ground.

    Forces $y$ of the springs and rigid motions $q$ are such that loads balance,
    $R^T (f - P^T y) = 0$, and that $P u = S^{-1} y$, where $u = A^{-1} (f - P^T y) + R q$.

    **Arguments:**

    - `body`: the body on its supports.
    - `rows`: $P$, stretch of every spring, `[spring, boundary]`.
    - `stiffness`: $S$, of the springs, `[spring]`.

    **Returns:**

    Motion of all unknowns, `[3 point]`, of a load, `[3 point]`.
    """
    # Of unit stiffness all, lest units of length and angle mix.
    pull = body.boundary.T @ (np.sqrt(stiffness)[:, None] * rows).T
    flexible = body.factor.solve(pull)
    rigid = body.rigid / np.linalg.norm(pull.T @ body.rigid, axis=0)
    count = len(stiffness)
    joint = np.zeros((count + 6, count + 6))
    joint[:count, :count] = pull.T @ flexible + np.eye(count)
    joint[:count, count:] = -pull.T @ rigid
    joint[count:, :count] = joint[:count, count:].T
    inverse = np.linalg.inv(joint)

    def solve(load: np.ndarray) -> np.ndarray:
        answer = body.factor.solve(load)
        both = inverse @ np.concatenate([pull.T @ answer, -rigid.T @ load])
        return answer - flexible @ both[:count] + rigid @ both[count:]

    return solve
