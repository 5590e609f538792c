r"""Two gears on their mounts, as the mesh sees them.

The drive turns the pinion, the wheel holds its rotation. Every other motion is linear elastic, so
what bodies, shafts and bearings contribute to the mesh is a flexibility of its few coordinates, and
what loads from outside do to it an offset of them.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array, Float

from jaxgear._compiled import compiled
from jaxgear._contact._cells import MeshCells
from jaxgear._contact._coupling import between_all_cells
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._wrench import beam_arms, cell_arms, structure_vectors
from jaxgear._system._flexible import condensed
from jaxgear._system._foot_tables import foot_tables
from jaxgear._system._gear_body import AbstractGearBody, gear_disc
from jaxgear._system._housing import Housing
from jaxgear._system._mesh_vectors import beam_vectors, within_bodies
from jaxgear._system._mount import AbstractMount
from jaxgear._system._structure import (
    StaticFlexibility,
    Structure,
    assemble_structure,
    check_torque,
    driving_torque,
    static_flexibility,
)
from jaxgear._system._support import Support
from jaxgear._types import (
    CellArmGrid,
    CoordinateGrid,
    CoordinateMatrix,
    Coordinates,
    DofCoordinates,
    DofGrid,
    Scalar,
    as_scalar,
)


class PairSystem(eqx.Module):
    r"""A pair on its mounts (theory 7.3).

    **Fields:**

    - `pair`: the gears.
    - `vectors`: $V$, mesh coordinates per motion of the gears' nodes [-, 1/m].
    - `middles`: motion of both gears at mid-face per motion of their nodes [-, m, 1/m].
    - `structure`: bodies, shafts, bearings.
    - `statics`: how the structure gives to mesh loads.
    - `direction`: mesh coordinates per approach by rotation [-].
    - `force`: normal mesh force that balances the torque, $C_1/(r_{b1}\cos\beta_b)$ [N].
    - `bends`: whether a gear body bends, and its sections have seven coordinates instead of two.

    The motions of the seats of condensed bodies are mesh coordinates too, after those of sections.
    """

    pair: GearPair
    vectors: DofCoordinates
    middles: Float[Array, "section_dof dof"]
    structure: Structure
    statics: StaticFlexibility
    direction: Coordinates
    force: Scalar
    bends: bool = eqx.field(static=True, default=False)

    @property
    def mesh_flexibility(self) -> CoordinateMatrix:
        """Mesh coordinates that the structure gives up per mesh load [m/N, 1/N, 1/(N m)]."""
        return self.statics.mesh_flexibility

    @property
    def mesh_offset(self) -> Coordinates:
        """Mesh coordinates under the loads from outside alone [m, rad]."""
        return self.statics.mesh_offset

    def arms(self, cells: MeshCells) -> CellArmGrid:
        """Approach of each cell per mesh coordinate [-, m].

        **Arguments:**

        - `cells`: in mesh.
        """
        own = beam_arms(self.pair, cells.lines) if self.bends else cell_arms(cells.arm)
        if cells.seat_arms is None:
            return own
        return jnp.concatenate([own, cells.seat_arms], axis=2)

    def displacement(self, load: CoordinateGrid) -> DofGrid:
        """Motion of the structure under mesh loads, apart from the driving rotation.

        **Arguments:**

        - `load`: resultants of the cell forces on the mesh coordinates at each phase.

        **Returns:**

        Motion of each degree of freedom of `structure` at each phase [m, rad].
        """
        return self.statics.offset[None, :] - load @ self.statics.response.T

    def gear_motion(self, load: CoordinateGrid) -> DofGrid:
        """Motion of both gears at mid-face under mesh loads, apart from the driving rotation.

        A condensed gear counts as its seat where the torque acts, carried on to mid-face.

        **Arguments:**

        - `load`: resultants of the cell forces on the mesh coordinates at each phase.

        **Returns:**

        Translations and rotations of the pinion, then of the wheel, at each phase [m, rad].
        """
        at_nodes = self.displacement(load)[:, np.asarray(self.structure.map.gear_dofs)]
        return at_nodes @ self.middles.T


def pair_system(
    pair: GearPair,
    torque: Scalar,
    pinion_support: AbstractMount = Support(),
    wheel_support: AbstractMount = Support(),
    *,
    pinion_body: AbstractGearBody | None = None,
    wheel_body: AbstractGearBody | None = None,
    housing: Housing | None = None,
    speed: Scalar | float = 0.0,
) -> PairSystem:
    """Assemble two gears under a torque (theory 7.7).

    **Arguments:**

    - `pair`: the gears.
    - `torque`: of the drive on the pinion's shaft, positive; reacted at the wheel's [N m].
    - `pinion_support`: its shaft on bearings, or springs at its centre; by default it only turns.
    - `wheel_support`: the same of the wheel.
    - `pinion_body`: rigid, a beam or condensed; by default a rigid disc from bore to root circle.
    - `wheel_body`: the same of the wheel.
    - `housing`: behind the bearings, or `None`: rigid.
    - `speed`: of the pinion, whose rotation loads condensed bodies [rad/s].

    **Returns:**

    The system.

    **Raises:**

    - `ValueError` unless the torque on the mesh is positive, or if a shaft is free to move.
    """
    torque = as_scalar(torque)
    check_torque(pinion_support, torque)
    mounts, bodies = (pinion_support, wheel_support), (pinion_body, wheel_body)
    return _assembled(pair, torque, mounts, bodies, housing, as_scalar(speed))


@compiled
def _assembled(
    pair: GearPair,
    torque: Scalar,
    mounts: tuple[AbstractMount, AbstractMount],
    given: tuple[AbstractGearBody | None, AbstractGearBody | None],
    housing: Housing | None,
    speed: Scalar,
) -> PairSystem:
    """See `pair_system`."""
    bodies = [
        gear_disc(pair, index, mount) if body is None else body
        for index, (mount, body) in enumerate(zip(mounts, given, strict=True))
    ]
    structure = assemble_structure(
        *mounts,
        *bodies,
        torque=torque,
        ratio=pair.teeth[1] / pair.teeth[0],
        housing=housing,
        speed=speed,
    )
    bends = any(body.piece is not None for body in bodies)
    vectors = beam_vectors(pair, mounts, bodies) if bends else _rigid_vectors(pair, bodies)
    vectors = _with_seats(vectors, bodies)
    statics = static_flexibility(structure, vectors)
    if bends:
        own = within_bodies(pair, mounts, bodies)
        whole = statics.mesh_flexibility.at[: len(own), : len(own)].add(own)
        statics = dataclasses.replace(statics, mesh_flexibility=whole)
    return PairSystem(
        pair=pair,
        vectors=vectors,
        middles=jax.scipy.linalg.block_diag(
            *(body.middle_motion(mount) for mount, body in zip(mounts, bodies, strict=True))
        ),
        structure=structure,
        statics=statics,
        direction=jnp.eye(vectors.shape[1])[0],
        force=driving_torque(mounts[0], torque)
        / (pair.base_radius[0] * jnp.cos(pair.base_helix_angle)),
        bends=bends,
    )


def on_condensed_bodies(
    pair: GearPair,
    cells: MeshCells,
    bodies: tuple[AbstractGearBody | None, AbstractGearBody | None],
    speed: Scalar | float = 0.0,
) -> MeshCells:
    """Cells as the condensed bodies of a pair let them give.

    **Arguments:**

    - `pair`: the gears.
    - `cells`: of teeth without the foundation of condensed bodies.
    - `bodies`: of pinion and wheel.
    - `speed`: of the pinion, whose rotation loads condensed bodies [rad/s].

    **Returns:**

    The cells; the same if no body is condensed.
    """
    ratio = pair.teeth[1] / pair.teeth[0]
    tables, growth = [], jnp.zeros_like(cells.stiffness)
    for index, body in condensed(bodies):
        table = foot_tables(pair, index, body, cells.lines)
        tables.append(table)
        growth += (speed, speed / ratio)[index] ** 2 * table.growth
        if table.heated is not None:
            growth += table.heated
    if not tables:
        return cells
    coupling = sum(table.compliance for table in tables)
    if cells.coupling is not None:
        dense = cells.coupling.ndim == 3
        coupling += cells.coupling if dense else between_all_cells(cells.coupling)
    arms = jnp.concatenate([table.arms for table in tables], axis=2)
    return dataclasses.replace(cells, coupling=coupling, seat_arms=arms, growth=growth)


def _rigid_vectors(pair: GearPair, bodies: Sequence[AbstractGearBody]) -> DofCoordinates:
    """Approach and tilt by the nodes of rigid bodies; not by the seats of condensed ones."""
    whole = structure_vectors(pair)
    rows = [
        jnp.zeros((6 * body.seat_count, 2)) if body.seat_count else part
        for body, part in zip(bodies, (whole[:6], whole[6:]), strict=True)
    ]
    return jnp.concatenate(rows)


def _with_seats(
    vectors: DofCoordinates, bodies: Sequence[AbstractGearBody]
) -> Float[Array, "dof mesh_coordinate"]:
    """Mesh coordinates of sections, and after them every motion of every seat."""
    first, last = (6 * body.seat_count for body in bodies)
    own = jnp.eye(len(vectors))
    return jnp.concatenate([vectors, own[:, :first], own[:, len(vectors) - last :]], axis=1)
