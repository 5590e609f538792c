r"""Cells that are coupled through the gear bodies under their teeth.

Teeth in mesh share their bodies: a force on one cell lowers the others, by a symmetric compliance
$C$. Under a ring only the lines of one thin slice feel each other, `[line, line, slice]`; on a
condensed body all cells do, `[cell, cell]`. Cells are flattened `line` times `slice`, as
everywhere.
"""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._types import (
    CellArms,
    CellColumns,
    Cells,
    Coupling,
    CouplingGrid,
    DenseCouplingGrid,
    Flag,
)


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


def sharing_with_body(coupling: Coupling, stiffness: Cells, *, symmetric: bool = True) -> Sharing:
    """Prepare to share with the bodies: the part that does not depend on the forces.

    **Arguments:**

    - `coupling`: $C$ [m/N].
    - `stiffness`: diagonal of $K$, zero where a cell is open [N/m].
    - `symmetric`: whether $C$ is, as it is at rest.

    **Returns:**

    What `shared` needs.
    """
    if coupling.ndim > 2 or not symmetric:
        return Sharing(stiffness, None)
    # Derivatives are those of the linear system: roots and factors are no part of them.
    held, root = jax.lax.stop_gradient(coupling), jnp.sqrt(jax.lax.stop_gradient(stiffness))
    return Sharing(stiffness, _one_by_one(_cholesky)(_symmetric(held, root)))


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
    within = lambda right: root[:, None] * _substituted_once(factor, root[:, None] * right)
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


def shared_where_needed(
    coupling: Coupling, stiffness: Cells, arms: CellArms, force: Cells, needed: Flag
) -> CellColumns:
    r"""Solve $(I + K C)\,y = r$ once, and where it is needed: else nothing is factorised.

    **Arguments:**

    - `coupling`: symmetric $C$ [m/N].
    - `stiffness`: diagonal of $K$, zero where a cell is open [N/m].
    - `arms`: $W$, of which $K W$ are right-hand sides [-, m].
    - `force`: one more right-hand side [N].
    - `needed`: whether the solutions are of use.

    **Returns:**

    The solutions, in columns; the right-hand sides where they are of no use.
    """
    if coupling.ndim > 2:
        columns = jnp.column_stack([stiffness[:, None] * arms, force])
        return _share_in_slices(coupling, stiffness, columns)
    return jax.lax.platform_dependent(
        needed, coupling, stiffness, arms, force, cpu=_shared_in_turn, default=_shared_or_not
    )


def _shared_or_not(
    needed: Flag, coupling: Coupling, stiffness: Cells, arms: CellArms, force: Cells
) -> CellColumns:
    """See `shared_where_needed`."""
    root = jnp.sqrt(stiffness)[:, None]
    right = _similar(coupling, root, arms, force)
    within = jax.lax.cond(needed, lambda: _solved(coupling, root, right), lambda: right)
    return _as_forces(root, within, force)


def _similar(coupling: Array, root: Array, arms: Array, force: Array) -> Array:
    """Right-hand sides of the matrix that is similar: those of `arms` ask for no product with C."""
    return root * jnp.column_stack([arms, coupling @ force])


def _as_forces(root: Array, within: Array, force: Array) -> Array:
    """What (I + SCS)^-1 makes of them: of K W it is S (I + SCS)^-1 S W."""
    given = root * within
    return jnp.column_stack([given[:, :-1], force - given[:, -1]])


@jax.custom_batching.custom_vmap
def _shared_in_turn(
    needed: Flag, coupling: Coupling, stiffness: Cells, arms: CellArms, force: Cells
) -> CellColumns:
    """Of a batch, the phases of one flank say, only factors are found in turn.

    Each operation that is done in turn has its own start. In a batch of batches the inner ones
    follow each other: all matrices at once would not stay in the processor's memory.
    """
    return _shared_or_not(needed, coupling, stiffness, arms, force)


@_shared_in_turn.def_vmap
def _shared_in_a_batch(size: int, batched: Sequence[bool], *system: Array) -> tuple[Array, bool]:
    def at_once(needed: Array, coupling: Array, stiffness: Array, *right: Array) -> Array:
        root = jnp.sqrt(stiffness)[:, :, None]
        beyond = jnp.any(stiffness[:, _half(stiffness.shape[1]) :] > 0.0, axis=1)
        bearing = jnp.where(needed, jnp.where(beyond, 2, 1), 0)
        sides = jax.vmap(_similar)(coupling, root, *right)
        solved = lambda each: _solved_of_bearing(coupling, root, *each)
        within = jax.lax.map(solved, (jnp.arange(size), bearing, sides))
        return jax.vmap(_as_forces)(root, within, right[1])

    def nothing(_, __, stiffness: Array, arms: Array, force: Array) -> Array:
        return jnp.concatenate([stiffness[:, :, None] * arms, force[:, :, None]], axis=2)

    def if_any(needed: Array, *others: Array) -> Array:
        return jax.lax.cond(jnp.any(needed), at_once, nothing, needed, *others)

    whole = (
        x if own else jnp.broadcast_to(x, (size, *x.shape))
        for x, own in zip(system, batched, strict=True)
    )
    return jax.custom_batching.sequential_vmap(if_any)(*whole), True


def _solved_of_bearing(
    couplings: Array, roots: Array, number: Array, bearing: Array, right: Array
) -> Array:
    """Solve for no cell, for the first half of them, the only ones that bear, or for all.

    Of a spur pair with one line in contact, whose cells come first, the other line has no part.
    """
    size = len(right)

    def of_first(count: int) -> Callable[[], Array]:
        def solved() -> Array:
            coupling, root = couplings[number, :count, :count], roots[number, :count]
            return jnp.pad(_solved(coupling, root, right[:count]), ((0, size - count), (0, 0)))

        return solved

    return jax.lax.switch(bearing, [lambda: right, of_first(_half(size)), of_first(size)])


def _half(size: int) -> int:
    """So many cells are solved alone where no others bear."""
    return (size + 1) // 2


def _solved(coupling: Array, root: Array, right: Array) -> Array:
    """Solve with I + S C S: open cells have no part in it, and no pivots are needed."""
    return _substituted(_cholesky(_symmetric(coupling, root[:, 0])), right)


def _symmetric(coupling: Array, root: Array) -> Array:
    """I + S C S."""
    return jnp.eye(root.size) + root[:, None] * coupling * root[None, :]


def _cholesky(matrix: Array) -> Array:
    return jax.lax.linalg.cholesky(matrix, symmetrize_input=False)


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


@jax.custom_batching.custom_vmap
def _substituted_in_turn(factor: Array, right: CellColumns) -> CellColumns:
    """Substitution in the factors of a batch, in turn."""
    return _substituted(factor, right)


@_substituted_in_turn.def_vmap
def _substituted_in_batches(
    size: int, batched: Sequence[bool], factor: Array, right: Array
) -> tuple[Array, bool]:
    """One factor substitutes all right-hand sides at once: they are its columns."""
    if not batched[0]:
        columns = jnp.moveaxis(right, 0, -1)
        found = _substituted_in_turn(factor, columns.reshape(len(factor), -1))
        return jnp.moveaxis(found.reshape(columns.shape), -1, 0), True
    if not batched[1]:
        right = jnp.broadcast_to(right, (size, *right.shape))
    return jax.lax.map(lambda each: _substituted_in_turn(*each), (factor, right)), True


def _substituted_once(factor: Array, right: CellColumns) -> CellColumns:
    """See `_one_by_one`; right-hand sides that share a factor go together."""
    return jax.lax.platform_dependent(factor, right, cpu=_substituted_in_turn, default=_substituted)


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
