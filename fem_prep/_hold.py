"""A body whose boundary is held: its factorised stiffness, and what its nodes do."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, eye_array

from ._artefact import ReducedBody
from ._assembly import order
from ._boundary import FullBody
from ._checks import Progress, silent
from ._modes import largest_rotation
from ._seats import dofs_of
from ._solvers import Factor, factorise
from ._symmetry import Rotation, Waves, waves_of

# Columns treated at a time; three axes each.
_COLUMNS = 510


@dataclass(frozen=True)
class FixedInterface:
    """A body whose boundary is held, ready to be loaded.

    **Fields:**

    - `full`: the body.
    - `rotation`: that leaves the body as it is, of which the factor makes use.
    - `inside`: unknowns that no coordinate of the boundary is.
    - `factor`: of their stiffness.
    - `forces`: answers to the forces of the averaging seats, `[inside, constraint]`.
    - `meeting`: flexibility of those seats, $B K_{ii}^{-1} B^T$, `[constraint, constraint]`.
    """

    full: FullBody
    rotation: Rotation
    inside: np.ndarray
    factor: Factor
    forces: np.ndarray
    meeting: np.ndarray

    @property
    def averages(self) -> csr_array:
        """Rows of the averaging seats on the inside."""
        return self.full.averages[:, self.inside]

    def loaded(self, load: np.ndarray) -> np.ndarray:
        """Motion under loads, the rim and all seats held.

        **Arguments:**

        - `load`: loads on all unknowns, shape `[3 point, column]`.

        **Returns:**

        Motion of all unknowns, shape `[3 point, column]`.
        """
        motion = np.zeros(load.shape)
        motion[self.inside] = self._answer(load[self.inside], 0.0)
        return motion

    def _answer(self, load: np.ndarray, seats: np.ndarray | float) -> np.ndarray:
        """Motion inside under loads there, the averaging seats prescribed, `[inside, column]`."""
        answer = self.factor.solve(load)
        if len(self.meeting):
            answer += self.forces @ np.linalg.solve(self.meeting, seats - self.averages @ answer)
        return answer

    def reaction(self, motion: np.ndarray) -> np.ndarray:
        """Forces on the boundary that hold a motion with no other load, `[boundary, column]`."""
        full, rows = self.full, self.averages
        rim, rings, averaging = _places(full)
        result = np.empty((len(rim) + len(rings) + len(averaging), motion.shape[1]))
        result[np.concatenate([rim, rings])] = _product(full.stiffness[full.held], motion)
        if len(averaging):
            # What is left inside are the forces of these seats, spread by their rows.
            left = _product(csr_array(rows @ full.stiffness[self.inside]), motion)
            result[averaging] = np.linalg.solve((rows @ rows.T).toarray(), left)
        return result

    def followed(self, boundary: np.ndarray) -> np.ndarray:
        """Static motion of all unknowns with the boundary.

        **Arguments:**

        - `boundary`: motion of the boundary, `[boundary, column]`: rim, then seats.

        **Returns:**

        Motion of all unknowns, shape `[3 point, column]`.
        """
        full = self.full
        rim, rings, averaging = _places(full)
        outer = boundary[np.concatenate([rim, rings])]
        pull = full.stiffness[full.held][:, self.inside].T
        motion = np.zeros((3 * full.points, boundary.shape[1]), order="F")
        motion[full.held] = outer
        for some in column_blocks(boundary.shape[1]):
            seats = boundary[averaging, some]
            motion[self.inside, some] = self._answer(-(pull @ outer[:, some]), seats)
        return motion

    def measured(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r"""What measures of the motion of all unknowns show of the boundary, and of loads inside.

        A measure $r u$ is a load by Betti's theorem: its answers are solved for instead of those
        to all motions of the boundary.

        **Arguments:**

        - `rows`: of the measures, shape `[row, 3 point]`.

        **Returns:**

        Measures per motion of the boundary, shape `[row, boundary]`, and per load on all unknowns
        while the boundary is held, shape `[row, 3 point]`.
        """
        full = self.full
        rim, rings, averaging = _places(full)
        answer = self.loaded(rows.T)
        outer = np.empty((len(rows), len(rim) + len(rings) + len(averaging)))
        pulled = _product(full.stiffness[full.held], answer)
        outer[:, np.concatenate([rim, rings])] = rows[:, full.held] - pulled.T
        if len(averaging):
            shown = self.forces.T @ rows[:, self.inside].T
            outer[:, averaging] = np.linalg.solve(self.meeting, shown).T
        return outer, answer.T


def fixed_interface(
    full: FullBody, *, rotation: Rotation | None = None, progress: Progress = silent
) -> FixedInterface:
    """Hold a body at its rim and its seats.

    **Arguments:**

    - `full`: the body.
    - `rotation`: a rotation that leaves the body as it is; the smallest one is sought without it.
    - `progress`: told what begins.

    **Returns:**

    The body with its boundary held.

    **Raises:**

    - `BodyError` if a part of it is still loose.
    """
    rotation = largest_rotation(full) if rotation is None else rotation
    points = np.setdiff1d(np.arange(full.points), full.held // 3)
    inside = dofs_of(points)
    with progress(f"factorising {len(inside)} unknowns"):
        stiffness = full.stiffness[inside][:, inside]
        waves = waves_of(rotation.among(points))
        factor = factor_by_waves(waves, waves.matrices(stiffness))
    rows = full.averages[:, inside]
    forces = factor.solve(rows.T.toarray()) if rows.shape[0] else np.zeros((len(inside), 0))
    return FixedInterface(full, rotation, inside, factor, forces, rows @ forces)


def factor_by_waves(waves: Waves, matrices: Iterable[csr_array]) -> Factor:
    """Factor of a matrix that does not change when the body turns: one of each number of waves.

    **Arguments:**

    - `waves`: motions by the number of their waves around.
    - `matrices`: the matrix on their amplitudes, for every number of waves.

    **Returns:**

    The factor, for loads on all unknowns.

    **Raises:**

    - `BodyError` if one is singular or not definite.
    """
    factors = [factorise(each) for each in matrices]

    def solve(right: np.ndarray) -> np.ndarray:
        parts = waves.parts(right if right.ndim == 2 else right[:, None])
        answers = [factor.solve(part) for factor, part in zip(factors, parts, strict=True)]
        return waves.whole(answers).reshape(right.shape)

    return Factor(factors[0].solver, solve)


def column_blocks(columns: int) -> Iterator[slice]:
    """Columns, some at a time: what is made of them on the way stays small."""
    for start in range(0, columns, _COLUMNS):
        yield slice(start, min(start + _COLUMNS, columns))


def _product(matrix: csr_array, motion: np.ndarray) -> np.ndarray:
    """A sparse matrix times many columns."""
    result = np.empty((order(matrix), motion.shape[1]))
    for some in column_blocks(motion.shape[1]):
        result[:, some] = matrix @ motion[:, some]
    return result


def boundary_of(full: FullBody, motion: np.ndarray) -> np.ndarray:
    """Motion of the boundary in a motion of all unknowns, `[3 point, c]` to `[boundary, c]`."""
    rim, rings, averaging = _places(full)
    values = np.empty((len(rim) + len(rings) + len(averaging), motion.shape[1]))
    values[np.concatenate([rim, rings])] = motion[full.held]
    values[averaging] = full.averages @ motion
    return values


def _places(full: FullBody) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates of the rim, of rigid seats and of averaging seats."""
    rim = np.arange(3 * len(full.rim))
    starts = len(rim) + 6 * np.arange(len(full.seats))
    averaging = np.array([seat.averaging for seat in full.seats], dtype=bool)
    rings, means = (
        (starts[chosen][:, None] + np.arange(6)).ravel() for chosen in (~averaging, averaging)
    )
    return rim, rings, means


def recovered_displacements(
    held: FixedInterface, reduced: ReducedBody, motion: np.ndarray
) -> np.ndarray:
    """Motion of all nodes of the grid in motions of the condensed body.

    **Arguments:**

    - `held`: the full body with its boundary held.
    - `reduced`: the condensed body.
    - `motion`: coordinates, shape `[dof, column]` [SI].

    **Returns:**

    Shape `[column, node, 3]` [m].
    """
    outer = reduced.boundary_dofs
    shapes = np.tensordot(motion[outer:].T, reduced.interior_shapes, axes=1)
    return held.full.on_nodes(held.followed(motion[:outer])) + shapes


def displacement_rows(held: FixedInterface, reduced: ReducedBody, nodes: np.ndarray) -> np.ndarray:
    """Displacements of some nodes from the coordinates of a condensed body.

    Each is a load on the full body whose boundary is held, by Betti's theorem: three columns are
    solved for at each node, however many motions are asked of it.

    **Arguments:**

    - `held`: the full body with its boundary held.
    - `reduced`: the condensed body.
    - `nodes`: of the grid, shape `[point]`.

    **Returns:**

    Rows along x, y, z, shape `[point, 3, dof]` [-, m]: as `recovered_displacements` of all motions.
    """
    unknowns = (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()
    chosen = csr_array(eye_array(held.full.grid.nodes.size))[unknowns]
    rows, _ = measured_coordinates(held, reduced, chosen)
    return rows.reshape(-1, 3, reduced.dofs)


def measured_coordinates(
    held: FixedInterface, reduced: ReducedBody, matrix: csr_array | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What measures of the displacements of all nodes show of a condensed body's coordinates.

    **Arguments:**

    - `held`: the full body with its boundary held.
    - `reduced`: the condensed body.
    - `matrix`: the measures, shape `[row, 3 node]`.

    **Returns:**

    Measures per coordinate, shape `[row, dof]`, and per load on all unknowns while the boundary is
    held, as of `FixedInterface.measured`.
    """
    boundary, inside = held.measured(csr_array(matrix @ held.full.spread).toarray())
    shapes = reduced.interior_shapes.reshape(reduced.interior, held.full.grid.nodes.size)
    return np.concatenate([boundary, matrix @ shapes.T], axis=1), inside
