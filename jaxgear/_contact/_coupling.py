r"""Cells that are coupled through the gear bodies under their teeth.

Teeth in mesh share their bodies: a force on one cell lowers the others, by a symmetric compliance
$C$. Under a ring only the lines of one thin slice feel each other, `[line, line, slice]`; on a
condensed body all cells do, `[cell, cell]`. Cells are flattened `line` times `slice`, as
everywhere.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._types import CellColumns, Cells, Coupling, CouplingGrid, DenseCouplingGrid


def body_yield(coupling: Coupling, force: Cells) -> Cells:
    """How far the bodies lower each cell, $C f$ [m].

    **Arguments:**

    - `coupling`: $C$ of the lines in each slice, or of all cells [m/N].
    - `force`: on each cell [N].

    **Returns:**

    The yield of each cell [m].
    """
    if coupling.ndim == 2:
        return coupling @ force
    lines = coupling.shape[0]
    by_line = force.reshape(1, lines, -1)
    return jnp.sum(coupling * by_line, axis=1).reshape(-1)


def share_with_body(coupling: Coupling, stiffness: Cells, columns: CellColumns) -> CellColumns:
    r"""Solve $(I + K C)\,y = r$, for several right-hand sides.

    **Arguments:**

    - `coupling`: $C$ [m/N].
    - `stiffness`: diagonal of $K$, zero where a cell is open [N/m].
    - `columns`: right-hand sides.

    **Returns:**

    The solutions, in the unit of `columns`.
    """
    return sharing_with_body(coupling, stiffness)(columns)


def sharing_with_body(coupling: Coupling, stiffness: Cells) -> Callable[[CellColumns], CellColumns]:
    r"""What solves $(I + K C)\,y = r$, for the right-hand sides to come.

    With $r$ the forces that stiff bodies would leave on the cells, $y$ are those that remain when
    the bodies give way. The matrix is similar to a positive definite one: where slices are on their
    own, elimination needs no pivots, and is written out over the few lines for all slices at once.

    **Arguments:**

    - `coupling`: $C$ [m/N].
    - `stiffness`: diagonal of $K$, zero where a cell is open [N/m].

    **Returns:**

    What takes right-hand sides to solutions, in their unit.
    """
    if coupling.ndim == 2:
        return _dense_solver(jnp.eye(stiffness.size) + stiffness[:, None] * coupling)
    return lambda columns: _share_in_slices(coupling, stiffness, columns)


def _share_in_slices(coupling: Coupling, stiffness: Cells, columns: CellColumns) -> CellColumns:
    """Solve slice by slice, all at once."""
    lines = coupling.shape[0]
    own = stiffness.reshape(lines, 1, -1)
    matrix = jnp.eye(lines)[:, :, None] + own * coupling
    rows = [matrix[i] for i in range(lines)]
    right = columns.reshape(lines, -1, columns.shape[1])
    answers = [right[i] for i in range(lines)]
    for i in range(lines):
        pivot = rows[i][i]
        rows[i] = rows[i] / pivot[None, :]
        answers[i] = answers[i] / pivot[:, None]
        for j in range(lines):
            if j != i:
                factor = rows[j][i]
                rows[j] = rows[j] - factor[None, :] * rows[i]
                answers[j] = answers[j] - factor[:, None] * answers[i]
    return jnp.stack(answers).reshape(columns.shape)


def _dense_solver(matrix: Array) -> Callable[[CellColumns], CellColumns]:
    """Solve with one matrix, again and again, as `jnp.linalg.solve` does.

    Its derivatives are those of the linear system: the factors are no part of them.
    """
    factors, permutation = _factors(jax.lax.stop_gradient(matrix))

    def solve(right: CellColumns, transposed: bool) -> CellColumns:
        return _substituted(factors, permutation, right, transposed)

    def solutions(columns: CellColumns) -> CellColumns:
        return jax.lax.custom_linear_solve(
            lambda x: matrix @ x,
            columns,
            solve=lambda _, right: solve(right, False),
            transpose_solve=lambda _, right: solve(right, True),
        )

    return solutions


def _factors(matrix: Array) -> tuple[Array, Array]:
    """Triangular factors and the order of rows."""
    lu, _, permutation = _one_by_one(jax.lax.linalg.lu)(matrix)
    return lu, permutation


def _substituted(
    factors: Array, permutation: Array, right: CellColumns, transposed: bool
) -> CellColumns:
    def substitute(factors: Array, permutation: Array, right: CellColumns) -> CellColumns:
        triangular = jax.lax.linalg.triangular_solve
        if transposed:
            first = triangular(factors, right, left_side=True, transpose_a=True)
            first = triangular(
                factors, first, left_side=True, lower=True, transpose_a=True, unit_diagonal=True
            )
            return first[jnp.argsort(permutation)]
        first = right[permutation]
        first = triangular(factors, first, left_side=True, lower=True, unit_diagonal=True)
        return triangular(factors, first, left_side=True)

    return _one_by_one(substitute)(factors, permutation, right)


def _one_by_one(function: Callable) -> Callable:
    """On a CPU, a function of matrices that takes those of a batch in turn.

    Two large batches that XLA factorises at one time wait for each other's threads for ever
    (jaxlib 0.10.2 on two cores). In turn they cost the same.
    """
    in_turn = jax.custom_batching.sequential_vmap(function)
    return lambda *arguments: jax.lax.platform_dependent(*arguments, cpu=in_turn, default=function)


def between_all_cells(coupling: CouplingGrid) -> DenseCouplingGrid:
    """The same compliance of slices on their own, written out for all pairs of cells.

    **Arguments:**

    - `coupling`: of the lines in each slice, at each phase [m/N].

    **Returns:**

    Of all cells, at each phase [m/N].
    """
    phases, lines, _, slices = coupling.shape
    # Phase, line, slice, other line, other slice.
    apart = jnp.moveaxis(coupling, 3, 2)[..., None] * jnp.eye(slices)[None, None, :, None, :]
    return apart.reshape(phases, lines * slices, lines * slices)
