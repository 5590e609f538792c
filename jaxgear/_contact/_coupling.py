r"""Cells that are coupled through the gear bodies under their teeth.

Teeth in mesh share their bodies: a force on one cell lowers the others, by a symmetric compliance
$C$. Under a ring only the lines of one thin slice feel each other, `[line, line, slice]`; on a
condensed body all cells do, `[cell, cell]`. Cells are flattened `line` times `slice`, as
everywhere.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._types import CellColumns, Cells, Coupling, CouplingGrid, DenseCouplingGrid, Flag


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


class Sharing(eqx.Module):
    """How cells share with the bodies, ready for right-hand sides to come.

    **Fields:**

    - `stiffness`: of the cells, zero where one is open [N/m].
    - `factor`: Cholesky's of what couples all cells, or `None` where few lines are coupled, or
        cells do not feel each other alike [-].
    """

    stiffness: Cells
    factor: CellColumns | None


def sharing_with_body(
    coupling: Coupling, stiffness: Cells, *, symmetric: bool = True, needed: Flag | bool = True
) -> Sharing:
    """Prepare to share with the bodies: the part that does not depend on the forces.

    **Arguments:**

    - `coupling`: $C$ [m/N].
    - `stiffness`: diagonal of $K$, zero where a cell is open [N/m].
    - `symmetric`: whether $C$ is, as it is at rest.
    - `needed`: whether a factor is used at all; else it is the identity, which costs nothing.

    **Returns:**

    What `shared` needs.
    """
    if coupling.ndim > 2 or not symmetric:
        return Sharing(stiffness, None)
    # With S^2 = K: open cells have no part in the symmetric matrix, and no pivots are needed.
    # Derivatives are those of the linear system: roots and factors are no part of them.
    root = jnp.sqrt(jax.lax.stop_gradient(stiffness))
    held = jax.lax.stop_gradient(coupling)
    matrix = jnp.eye(root.size) + root[:, None] * held * root[None, :]
    return Sharing(stiffness, _one_by_one(_cholesky)(matrix, jnp.asarray(needed)))


def shared(coupling: Coupling, sharing: Sharing, columns: CellColumns) -> CellColumns:
    r"""Solve $(I + K C)\,y = r$, for several right-hand sides.

    With $r$ the forces that stiff bodies would leave on the cells, $y$ are those that remain when
    the bodies give way. The matrix is similar to a positive definite one: where slices are on their
    own, elimination needs no pivots, and is written out over the few lines for all slices at once.

    **Arguments:**

    - `coupling`: $C$ [m/N].
    - `sharing`: from `sharing_with_body`.
    - `columns`: right-hand sides.

    **Returns:**

    The solutions, in the unit of `columns`.
    """
    stiffness, factor = sharing.stiffness, sharing.factor
    if coupling.ndim > 2:
        return _share_in_slices(coupling, stiffness, columns)
    if factor is None:
        matrix = jnp.eye(stiffness.size) + stiffness[:, None] * coupling
        return _one_by_one(jnp.linalg.solve)(matrix, columns)
    # With S^2 = K it is (I + KC)^-1 = I - S (I + SCS)^-1 SC.
    root = jnp.sqrt(jax.lax.stop_gradient(stiffness))
    held = jax.lax.stop_gradient(coupling)
    within = lambda right: root[:, None] * _one_by_one(_substituted)(factor, root[:, None] * right)
    return jax.lax.custom_linear_solve(
        lambda x: x + stiffness[:, None] * (coupling @ x),
        columns,
        solve=lambda _, right: right - within(held @ right),
        transpose_solve=lambda _, right: right - held @ within(right),
    )


def share_with_body(
    coupling: Coupling, stiffness: Cells, columns: CellColumns, *, symmetric: bool = True
) -> CellColumns:
    r"""Solve $(I + K C)\,y = r$ once, see `shared`.

    **Arguments:**

    - `coupling`: $C$ of the lines in each slice, or of all cells [m/N].
    - `stiffness`: diagonal of $K$, zero where a cell is open [N/m].
    - `columns`: right-hand sides.
    - `symmetric`: whether $C$ is, as it is at rest.

    **Returns:**

    The solutions, in the unit of `columns`.
    """
    return shared(coupling, sharing_with_body(coupling, stiffness, symmetric=symmetric), columns)


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


def _cholesky(matrix: Array, needed: Flag) -> Array:
    factor = lambda matrix: jax.lax.linalg.cholesky(matrix, symmetrize_input=False)
    return jax.lax.cond(needed, factor, lambda matrix: jnp.eye(len(matrix)), matrix)


def _substituted(factor: Array, right: CellColumns) -> CellColumns:
    triangular = jax.lax.linalg.triangular_solve
    first = triangular(factor, right, left_side=True, lower=True)
    return triangular(factor, first, left_side=True, lower=True, transpose_a=True)


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
