r"""The mesh of gears in motion: its cells over a cycle, and how degrees of freedom move them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array

from jaxgear._dynamics._back_flank import back_flank_table, back_vectors, with_back_flanks
from jaxgear._dynamics._cell_forces import tangent_columns
from jaxgear._dynamics._table import MeshTable, mesh_table
from jaxgear._dynamics._types import (
    StepPlaces,
)
from jaxgear._geometry._lines import MeshGrid
from jaxgear._solve._coordinates import on_coordinates_all
from jaxgear._solve._cycle import MeshCycle
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import PairSystem
from jaxgear._types import (
    CellArmGrid,
    CoordinateMatrix,
    DenseCouplingGrid,
    DofCoordinates,
    Flag,
    Scalar,
)


class MovingMesh(NamedTuple):
    """The mesh of a pair in motion.

    **Fields:**

    - `table`: of the cells.
    - `vectors`: mesh coordinates per degree of freedom, `[dof, coordinate]`.
    - `mean`: mean stiffness on the mesh coordinates.
    - `rest`: mesh coordinates of the quasi-static states, `[phase, coordinate]`.
    - `teeth`: part of `mean` whose strain is in the teeth, or `None`: all.
    - `bow`: what bodies give between their nodes, or `None`: nothing.
    - `left_out`: part of the motion under loads on the flanks that the mesh coordinates leave out,
        root of its kinetic energy in the mean over these [-].
    """

    table: MeshTable
    vectors: Array
    mean: CoordinateMatrix
    rest: StepPlaces
    teeth: CoordinateMatrix | None = None
    bow: CoordinateMatrix | None = None
    left_out: Scalar | float = 0.0


def node_mesh(
    model: PairModel, mounted: PairSystem, cycle: MeshCycle, grid: MeshGrid
) -> MovingMesh:
    """The mesh of rigid bodies and beams, which moves with their nodes.

    **Arguments:**

    - `model`: the pair.
    - `mounted`: its structure.
    - `cycle`: its quasi-static states.
    - `grid`: of the cycle.

    **Returns:**

    The mesh of the drive flanks.
    """
    table = mesh_table(mounted, cycle.cells, grid, model.flanks, model.misalignment)
    return MovingMesh(
        table=table,
        vectors=_onto(mounted, mounted.vectors),
        mean=mean_stiffness(cycle, table),
        rest=_rest(mounted, cycle),
        bow=beam_bow(mounted),
    )


def mesh_with_back_flanks(
    met: MovingMesh, model: PairModel, mounted: PairSystem, cycle: MeshCycle, grid: MeshGrid
) -> tuple[MovingMesh, Flag]:
    """A mesh with the back flanks in it, in coordinates of their own after the others.

    **Arguments:**

    - `met`: the drive flanks.
    - `model`, `mounted`, `cycle`, `grid`: as of `node_mesh`.

    **Returns:**

    The mesh, and whether the grid holds all lines of the back flanks.
    """
    first, last = (len(gear) for gear in mounted.structure.map.gears)
    turned = back_vectors(mounted.vectors, (first, last))
    both = jax.scipy.linalg.block_diag
    others, complete = back_flank_table(mounted, model, grid, met.table)
    whole = MovingMesh(
        table=with_back_flanks(met.table, others),
        vectors=jnp.concatenate([met.vectors, _onto(mounted, turned)], axis=1),
        mean=both(met.mean, jnp.zeros_like(met.mean)),
        rest=jnp.concatenate([met.rest, _back_rest(mounted, cycle, turned)], axis=1),
        bow=None if met.bow is None else both(met.bow, met.bow),
    )
    return whole, complete


def mean_stiffness(cycle: MeshCycle, table: MeshTable) -> CoordinateMatrix:
    """Mean over the cycle of the stiffness of the cells in contact, on a table's coordinates."""
    return _mean(cycle, jax.vmap(on_coordinates_all)(table.middle_arms, _pushed(cycle, table)))


def mean_share(
    cycle: MeshCycle, table: MeshTable, compliance: DenseCouplingGrid
) -> CoordinateMatrix:
    """The part of the mean stiffness whose strain is in a part of the coupling between cells.

    **Arguments:**

    - `cycle`: quasi-static states.
    - `table`: of the cells.
    - `compliance`: this part of the table's coupling.

    **Returns:**

    The part, on the table's coordinates.
    """
    pushed = _pushed(cycle, table)
    return _mean(cycle, jnp.swapaxes(pushed, 1, 2) @ compliance @ pushed)


def _pushed(cycle: MeshCycle, table: MeshTable) -> CellArmGrid:
    """Forces of the cells in contact per coordinate of a table, at each phase."""
    closed = jnp.where(cycle.overlap > 0.0, table.stiffness, 0.0)
    return jax.vmap(tangent_columns)(closed, table.coupling, table.middle_arms)


def _mean(cycle: MeshCycle, each: Array) -> CoordinateMatrix:
    """Mean over the cycle of a matrix of each phase."""
    return jnp.sum(cycle.cells.lines.weight[:, None, None] * each, axis=0)


def beam_bow(mounted: PairSystem) -> CoordinateMatrix | None:
    """Flexibility of beam bodies between their nodes; it has no mass.

    **Arguments:**

    - `mounted`: the structure.

    **Returns:**

    Of the mesh coordinates, or `None` if no body bends [m/N, 1/N, 1/(N m)].
    """
    if not mounted.bends:
        return None
    at_nodes = mounted.statics.response[np.asarray(mounted.structure.map.gear_dofs)]
    given = mounted.vectors.T @ at_nodes
    return mounted.mesh_flexibility - 0.5 * (given + given.T)


def _onto(mounted: PairSystem, rows: DofCoordinates) -> Array:
    """Rows of the gears' nodes among those of all degrees of freedom."""
    mapped = mounted.structure.map
    return jnp.zeros((mapped.size, rows.shape[1])).at[np.asarray(mapped.gear_dofs)].set(rows)


def _rest(mounted: PairSystem, cycle: MeshCycle) -> StepPlaces:
    """Mesh coordinates of the quasi-static states [m, rad]."""
    given = cycle.load @ mounted.mesh_flexibility.T
    driven = cycle.approach[:, None] * mounted.direction[None, :]
    return driven - given + mounted.mesh_offset[None, :]


def _back_rest(mounted: PairSystem, cycle: MeshCycle, turned: DofCoordinates) -> StepPlaces:
    """Mesh coordinates of the back flanks in the quasi-static states [m, rad]."""
    at_nodes = mounted.displacement(cycle.load)[:, np.asarray(mounted.structure.map.gear_dofs)]
    # What drives the drive flanks together drives these apart.
    driven = cycle.approach[:, None] * mounted.direction[None, :]
    return at_nodes @ turned - driven
