"""Sums between cells and mesh coordinates, and systems of the few mesh coordinates."""

from collections.abc import Callable

import jax.numpy as jnp
import jax.scipy.linalg

from jaxgear._types import (
    CellArms,
    CellColumns,
    Cells,
    CoordinateColumns,
    CoordinateMatrix,
    Coordinates,
)

# A batch of tiny matrix products costs many times its arithmetic: up to so many mesh coordinates
# the sums are written out, and up to so many they are products and sums of arrays.
_FEW, _SOME = 2, 8


def at_cells(arms: CellArms, place: Coordinates) -> Cells:
    """Overlap of each cell by a motion of the mesh coordinates, W q.

    **Arguments:**

    - `arms`: $W$ [-, m].
    - `place`: the mesh coordinates, $q$ [m, rad].

    **Returns:**

    Overlap of each cell [m].
    """
    if place.size > _SOME:
        return arms @ place
    if place.size > _FEW:
        return jnp.sum(arms * place[None, :], axis=1)
    total = arms[:, 0] * place[0]
    for i in range(1, place.size):
        total += arms[:, i] * place[i]
    return total


def on_coordinates(arms: CellArms, force: Cells) -> Coordinates:
    """Resultants of cell forces on the mesh coordinates, W^T f.

    **Arguments:**

    - `arms`: $W$ [-, m].
    - `force`: of each cell [N].

    **Returns:**

    The resultants [N, N m].
    """
    if arms.shape[1] > _SOME:
        return arms.T @ force
    if arms.shape[1] > _FEW:
        return jnp.sum(arms * force[:, None], axis=0)
    return jnp.stack([jnp.sum(arms[:, i] * force) for i in range(arms.shape[1])])


def on_coordinates_all(arms: CellArms, columns: CellColumns) -> CoordinateColumns:
    """As `on_coordinates`, of several columns of cell forces."""
    if arms.shape[1] > _SOME:
        return arms.T @ columns
    if arms.shape[1] > _FEW:
        return jnp.sum(arms[:, :, None] * columns[:, None, :], axis=0)
    count = columns.shape[1]
    return jnp.stack([on_coordinates(arms, columns[:, i]) for i in range(count)], axis=1)


def small_solver(matrix: CoordinateMatrix) -> Callable[[Coordinates], Coordinates]:
    """Solve systems with one matrix, of order 1, 2 or more.

    **Arguments:**

    - `matrix`: square, regular.

    **Returns:**

    What takes a right-hand side to its solution.
    """
    if matrix.shape[0] == 1:
        return lambda right: right / matrix[0, 0]
    if matrix.shape[0] > 2:
        factors = jax.scipy.linalg.lu_factor(matrix)
        return lambda right: jax.scipy.linalg.lu_solve(factors, right)
    (a, b), (c, d) = matrix
    determinant = a * d - b * c
    return lambda r: jnp.stack([d * r[0] - b * r[1], a * r[1] - c * r[0]]) / determinant
