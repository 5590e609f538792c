r"""Cells of one transverse slice, coupled through the gear bodies under their teeth.

Teeth in mesh share their bodies: a force on one contact line lowers the others. Within each slice
the lines are coupled by a symmetric compliance $C$; slices are thin and do not feel each other.
Cells are flattened `line` times `slice`, as everywhere.
"""

import jax.numpy as jnp

from jaxgear._types import CellColumns, Cells, Coupling


def body_yield(coupling: Coupling, force: Cells) -> Cells:
    """How far the bodies lower each cell, $C f$ [m].

    **Arguments:**

    - `coupling`: $C$ of the lines in each slice [m/N].
    - `force`: on each cell [N].

    **Returns:**

    The yield of each cell [m].
    """
    lines = coupling.shape[0]
    by_line = force.reshape(1, lines, -1)
    return jnp.sum(coupling * by_line, axis=1).reshape(-1)


def share_with_body(coupling: Coupling, stiffness: Cells, columns: CellColumns) -> CellColumns:
    r"""Solve $(I + K C)\,y = r$ in each slice, for several right-hand sides.

    With $r$ the forces that stiff bodies would leave on the cells, $y$ are those that remain when
    the bodies give way. The matrix is similar to a positive definite one, so that elimination needs
    no pivots; it is written out over the few lines, for all slices at once.

    **Arguments:**

    - `coupling`: $C$ [m/N].
    - `stiffness`: diagonal of $K$, zero where a cell is open [N/m].
    - `columns`: right-hand sides.

    **Returns:**

    The solutions, in the unit of `columns`.
    """
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
