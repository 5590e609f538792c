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
from jaxgear._dynamics._types import Matrix, StepCoupling, StepPlaces
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


class MeanMesh(NamedTuple):
    """A spring on coordinates of the mesh: the mean over a cycle of the cells in contact.

    **Fields:**

    - `vectors`: the coordinates per degree of freedom, `[dof, coordinate]`.
    - `stiffness`: mean stiffness on them.
    - `teeth`: part of it whose strain is in the teeth, or `None`: all.
    """

    vectors: Array
    stiffness: CoordinateMatrix
    teeth: CoordinateMatrix | None = None

    def among(self, dofs: np.ndarray) -> tuple[Matrix, Matrix]:
        """Its stiffness between some degrees of freedom, and that of the teeth."""
        rows, teeth = self.vectors[dofs], self.stiffness if self.teeth is None else self.teeth
        return rows @ self.stiffness @ rows.T, rows @ teeth @ rows.T


class BodyGive(NamedTuple):
    """What condensed bodies give to loads on the flanks.

    **Fields:**

    - `cells`: between cells, all of the bodies but what is in the coordinates [m/N].
    - `coordinates`: of the coordinates per load on them, by modes of the bodies, the seats held.
    """

    cells: DenseCouplingGrid
    coordinates: CoordinateMatrix


class MovingMesh(NamedTuple):
    """The mesh of a pair in motion.

    **Fields:**

    - `table`: of the cells.
    - `mean`: the spring on the mesh coordinates about which it is linear.
    - `rest`: mesh coordinates of the quasi-static states, `[phase, coordinate]`.
    - `bow`: what bodies give between their nodes, or `None`: nothing.
    - `left_out`: part of the motion under loads on the flanks that the mesh coordinates leave out,
        root of its kinetic energy in the mean over these [-].
    """

    table: MeshTable
    mean: MeanMesh
    rest: StepPlaces
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
    vectors = _onto(mounted, mounted.vectors)
    return MovingMesh(
        table=table,
        mean=mean_mesh(cycle, table.coupling, table.middle_arms, vectors),
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
    stiffness = met.mean.stiffness
    # Back flanks touch for moments, and have no part in the mean.
    mean = MeanMesh(
        vectors=jnp.concatenate([met.mean.vectors, _onto(mounted, turned)], axis=1),
        stiffness=both(stiffness, jnp.zeros_like(stiffness)),
    )
    whole = MovingMesh(
        table=with_back_flanks(met.table, others),
        mean=mean,
        rest=jnp.concatenate([met.rest, _back_rest(mounted, cycle, turned)], axis=1),
        bow=None if met.bow is None else both(met.bow, met.bow),
    )
    return whole, complete


def mean_mesh(
    cycle: MeshCycle,
    coupling: StepCoupling | None,
    arms: CellArmGrid,
    vectors: Array,
    bodies: BodyGive | None = None,
) -> MeanMesh:
    r"""The mean over a cycle of the stiffness of the cells in contact.

    Beside condensed bodies it is the spring with which the modes answer a load that stays as they
    do, on the mean over the cycle, with the cells (theory 8.5). The mean of the stiffness itself
    would rise with the number of modes, and hold a wheel that turns on all of its rim at once.

    **Arguments:**

    - `cycle`: quasi-static states.
    - `coupling`: between its cells, as of `MeshTable` [m/N].
    - `arms`: of the cells, on some coordinates.
    - `vectors`: these coordinates per degree of freedom, `[dof, coordinate]`.
    - `bodies`: what condensed bodies give, or `None`: there are none.

    **Returns:**

    The spring, and the share that the strain of the teeth has in it.
    """
    closed = jnp.where(cycle.overlap > 0.0, cycle.cells.stiffness, 0.0)
    pushed = jax.vmap(tangent_columns)(closed, coupling, arms)
    each = jax.vmap(on_coordinates_all)(arms, pushed)
    if bodies is None:
        return MeanMesh(vectors, _mean(cycle, each))
    teeth = each - jnp.swapaxes(pushed, 1, 2) @ bodies.cells @ pushed
    one, give = jnp.eye(each.shape[1]), bodies.coordinates
    # Where the coordinates are when their modes have given way, per place from which they do.
    left = jnp.linalg.inv(one[None] + give @ each)
    stays = _mean(cycle, each @ left)
    in_teeth = _mean(cycle, jnp.swapaxes(left, 1, 2) @ teeth @ left)
    back = jnp.linalg.inv(one - give @ stays)
    mean, teeth = stays @ back, back.T @ in_teeth @ back
    return MeanMesh(vectors, 0.5 * (mean + mean.T), 0.5 * (teeth + teeth.T))


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
