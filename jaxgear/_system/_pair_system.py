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

from jaxgear._checks import require
from jaxgear._compiled import compiled, in_numpy
from jaxgear._contact._cells import MeshCells
from jaxgear._contact._coupling import between_all_cells
from jaxgear._geometry._pair import GearPair, root_radii
from jaxgear._interface._wrench import beam_arms, cell_arms, structure_vectors
from jaxgear._system._flexible import FlexibleBody, foot_tables
from jaxgear._system._mesh_vectors import (
    beam_vectors,
    carried,
    section_motion,
    within_bodies,
)
from jaxgear._system._shaft import BeamBody, Shaft
from jaxgear._system._structure import (
    BODIES,
    GearBody,
    Housing,
    RigidBody,
    StaticFlexibility,
    Structure,
    assemble_structure,
    check_torque,
    driving_torque,
    solid_disc,
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
from jaxgear._units import mm

# How far a seat may be from its bearing, of the shaft's length.
_SEAT_OFF = 1e-3


class PairSystem(eqx.Module):
    r"""A pair on its mounts.

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
    pinion_support: Support | Shaft = Support(),
    wheel_support: Support | Shaft = Support(),
    *,
    pinion_body: GearBody | None = None,
    wheel_body: GearBody | None = None,
    housing: Housing | None = None,
    speed: Scalar | float = 0.0,
) -> PairSystem:
    """Assemble two gears under a torque.

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
    mounts: tuple[Support | Shaft, Support | Shaft],
    given: tuple[GearBody | None, GearBody | None],
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
    bends = any(isinstance(body, BeamBody) for body in bodies)
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
            *(_middle(mount, body) for mount, body in zip(mounts, bodies, strict=True))
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
    bodies: tuple[GearBody | None, GearBody | None],
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
    for index, (body, own) in enumerate(zip(bodies, (speed, speed / ratio), strict=True)):
        if isinstance(body, FlexibleBody):
            table = foot_tables(pair, index, body, cells.lines)
            tables.append(table)
            growth += own**2 * table.growth
    if not tables:
        return cells
    coupling = sum(table.compliance for table in tables)
    if cells.coupling is not None:
        coupling += between_all_cells(cells.coupling)
    arms = jnp.concatenate([table.arms for table in tables], axis=2)
    return dataclasses.replace(cells, coupling=coupling, seat_arms=arms, growth=growth)


def _rigid_vectors(pair: GearPair, bodies: Sequence[GearBody]) -> DofCoordinates:
    """Approach and tilt by the nodes of rigid bodies; not by the seats of condensed ones."""
    whole = structure_vectors(pair)
    rows = [
        jnp.zeros((body.seat_load.size, 2)) if isinstance(body, FlexibleBody) else part
        for body, part in zip(bodies, (whole[:6], whole[6:]), strict=True)
    ]
    return jnp.concatenate(rows)


def _with_seats(
    vectors: DofCoordinates, bodies: Sequence[GearBody]
) -> Float[Array, "dof mesh_coordinate"]:
    """Mesh coordinates of sections, and after them every motion of every seat."""
    first, last = (body.seat_load.size if isinstance(body, FlexibleBody) else 0 for body in bodies)
    own = jnp.eye(len(vectors))
    return jnp.concatenate([vectors, own[:, :first], own[:, len(vectors) - last :]], axis=1)


def _middle(mount: Shaft | Support, body: GearBody) -> Float[Array, "6 node_dof"]:
    """Motion of a gear at mid-face per motion of its nodes: of a condensed one as its seat's."""
    if not isinstance(body, FlexibleBody):
        return section_motion(mount, body, jnp.zeros(()))
    moved = carried(-body.seat_heights[body.gear_seat])
    first = 6 * body.gear_seat
    return jnp.zeros((6, body.seat_load.size)).at[:, first : first + 6].set(moved)


def gear_disc(
    pair: GearPair, index: int, mount: Support | Shaft, **given: Scalar | float
) -> RigidBody:
    """A gear's body where nothing else is said of it: a disc out to the root circle.

    It begins at the bore or, without one, at its shaft, which has a mass of its own.

    **Arguments:**

    - `pair`: the gears.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `mount`: its shaft, or the springs at its centre.
    - `given`: `mass`, `polar_inertia`, `transverse_inertia` where they are known [kg, kg m2].

    **Returns:**

    The body.
    """
    gear = (pair.pinion, pair.wheel)[index]
    inner = gear.bore
    if inner is None:
        inner = mount.diameter_at_gear if isinstance(mount, Shaft) else jnp.zeros(())
    outer = 2.0 * in_numpy(root_radii(pair))[index]
    return solid_disc(outer, inner, gear.face_width, gear.material.density, **given)


def check_bodies(
    pair: GearPair,
    mounts: tuple[Support | Shaft, Support | Shaft],
    bodies: tuple[GearBody | None, GearBody | None],
) -> None:
    """Refuse bodies that do not fit their gears. Traced numbers are let through.

    **Arguments:**

    - `pair`: the gears.
    - `mounts`: their shafts, or the springs at their centres.
    - `bodies`: of the gears.

    **Raises:**

    - `InputError` if a beam body is narrower than its gear, if a shaft is as thick as the gear, or
        if a condensed body has no seat for a bearing, or loads on its shaft.
    """
    for index, (name, mount, body) in enumerate(zip(BODIES, mounts, bodies, strict=True)):
        width = (pair.pinion, pair.wheel)[index].face_width
        if isinstance(body, BeamBody):
            require(
                in_numpy(body.width) >= (1.0 - 1e-9) * in_numpy(width),
                "The {name}'s beam body must be at least as wide as its face, {width:.6g} m, got "
                "{got:.6g} m.",
                name=name,
                width=width,
                got=body.width,
            )
        elif isinstance(body, FlexibleBody):
            _check_seats(name, mount, body)
        elif isinstance(mount, Shaft):
            root = 2.0 * in_numpy(root_radii(pair))[index]
            require(
                in_numpy(mount.diameter_at_gear) < root,
                "The {name}'s shaft must be thinner than the gear on it, whose root circle has "
                "{root:.6g} mm, got {got:.6g} mm. Give the shaft's diameters in millimetres, or "
                "make the body a beam.",
                name=name,
                root=root / mm,
                got=in_numpy(mount.diameter_at_gear) / mm,
            )


def _check_seats(name: str, mount: Shaft | Support, body: FlexibleBody) -> None:
    """Refuse a condensed body that its mount cannot hold."""
    seats = ", ".join(body.seats)
    if isinstance(mount, Support):
        require(
            len(body.seats) == 1,
            "The {name}'s condensed body has the seats {seats}: give the bearings of its shaft. "
            "Springs at the centre hold a body of one seat only.",
            name=name,
            seats=seats,
        )
        return
    wanted = [f"bearing[{i}]" for i in range(len(mount.bearings))]
    require(
        set(wanted) <= set(body.seats),
        "The {name}'s condensed body must have a seat for each bearing, {wanted}, got {seats}.",
        name=name,
        wanted=", ".join(wanted),
        seats=seats,
    )
    spare = set(body.seats) - {*wanted, body.seats[body.gear_seat]}
    require(
        not spare,
        "The {name}'s condensed body has seats that nothing holds: {spare}. Give their bearings.",
        name=name,
        spare=", ".join(sorted(spare)),
    )
    length = sum((segment.length for segment in mount.segments), jnp.zeros(()))
    for seat, bearing in zip(wanted, mount.bearings, strict=True):
        at = bearing.at - mount.gear_at
        height = body.seat_heights[body.seats.index(seat)]
        require(
            jnp.abs(height - at) <= _SEAT_OFF * length,
            "The {name}'s condensed body must have its seat {seat} where that bearing is, {at:.6g} "
            "mm from mid-face, got {height:.6g} mm.",
            name=name,
            seat=seat,
            at=at / mm,
            height=height / mm,
        )
    require(
        not mount.loads,
        "The {name}'s condensed body contains its shaft, which has no node where the loads of the "
        "shaft act. Leave the loads out, or make the body rigid or a beam.",
        name=name,
    )
