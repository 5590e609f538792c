r"""Both bodies of a pair, their shafts, bearings and housing, as one linear structure.

Degrees of freedom: the pinion's nodes from left to right, then the wheel's; six per node. The
teeth are not in it: they load the gears' nodes through the mesh coordinates. Each body spins
freely about Z, held by the mesh alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._compiled import compiled, in_numpy
from jaxgear._system._body_loads import seat_loads
from jaxgear._system._gear_body import BODIES, AbstractGearBody, carried
from jaxgear._system._housing import Housing, bearing_stiffness_on
from jaxgear._system._mount import AbstractMount
from jaxgear._types import (
    CoordinateMatrix,
    Coordinates,
    DofCoordinates,
    Scalar,
    as_scalar,
)

if TYPE_CHECKING:
    Load = Array
    StructureMatrix = Array
    Responses = Array
    BearingMatrix = Array
    BearingTilts = Array
    BearingLoads = Array
else:
    Load = Float[Array, "structure_dof"]
    StructureMatrix = Float[Array, "structure_dof structure_dof"]
    Responses = Float[Array, "structure_dof coordinate"]
    BearingMatrix = Float[Array, "bearing_direction bearing_direction"]
    BearingTilts = Float[Array, "bearing 2"]
    BearingLoads = Float[Array, "bearing 5"]


@dataclass(frozen=True)
class StructureMap:
    """Which degree of freedom is whose.

    `starts` lists every named node with its first degree of freedom, `sizes` the number of
    degrees of freedom of either body. `gears` has the first degree of freedom of each node of
    either gear, whose rotation is the gear's; `loaded` of each node that its teeth load, all seats
    of a condensed body; `torques` of each node where its torque acts, in equal parts; `bearings` of
    each bearing's node. `free` are all that can move.
    """

    starts: tuple[tuple[str, int], ...]
    sizes: tuple[int, int]
    gears: tuple[tuple[int, ...], tuple[int, ...]]
    loaded: tuple[tuple[int, ...], tuple[int, ...]]
    torques: tuple[tuple[int, ...], tuple[int, ...]]
    bearings: tuple[int, ...]
    free: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of degrees of freedom."""
        return sum(self.sizes)

    @property
    def dofs(self) -> Mapping[str, int]:
        """First of the six of each named node: "pinion gear", "wheel bearing 1" and so on."""
        return dict(self.starts)

    @property
    def gear_dofs(self) -> tuple[int, ...]:
        """Degrees of freedom of the nodes that teeth load, pinion then wheel, left to right."""
        return tuple(first + k for gear in self.loaded for first in gear for k in range(6))


class Structure(eqx.Module):
    r"""$M\ddot q + (\Omega_1 G_1 + \Omega_2 G_2)\dot q + Kq = f$, without the mesh.

    **Fields:**

    - `stiffness`: $K$, singular: each body turns freely about Z [N/m, N/rad, N m/rad].
    - `mass`: $M$ [kg, kg m, kg m2].
    - `pinion_gyroscopic`: $G_1$, per speed of the pinion about +Z [kg, kg m, kg m2].
    - `wheel_gyroscopic`: $G_2$, per speed of the wheel about +Z: the wheel of a pair turns
        at a negative one [kg, kg m, kg m2].
    - `load`: constant loads from outside: of the shafts, the driving torque, its reaction [N, N m].
    - `bearing_stiffness`: along S, T, Z of each bearing, the housing in series [N/m].
    - `bearing_tilt`: about S and T of each bearing [N m/rad].
    - `map`: of names to degrees of freedom.
    """

    stiffness: StructureMatrix
    mass: StructureMatrix
    pinion_gyroscopic: StructureMatrix
    wheel_gyroscopic: StructureMatrix
    load: Load
    bearing_stiffness: BearingMatrix
    bearing_tilt: BearingTilts
    map: StructureMap = eqx.field(static=True)


class StaticFlexibility(eqx.Module):
    r"""What a structure gives to mesh loads $g$: $x = x_0 - Xg$, hence $V^Tx = q_0 - Hg$.

    **Fields:**

    - `response`: $X$, motion of every degree of freedom per mesh load [m/N, rad/N, rad/(N m)].
    - `offset`: $x_0$, motion under the loads from outside alone [m, rad].
    - `mesh_flexibility`: $H$, mesh coordinates per mesh load [m/N, 1/N, 1/(N m)].
    - `mesh_offset`: $q_0$, mesh coordinates under the loads from outside alone [m, rad].
    """

    response: Responses
    offset: Load
    mesh_flexibility: CoordinateMatrix
    mesh_offset: Coordinates


class BearingMotion(eqx.Module):
    """What the bearings do, the pinion's first.

    **Fields:**

    - `displacement`: of the shaft there, along S, T, Z and about S, T [m, rad].
    - `load`: that the shaft puts on the bearing, in the same order [N, N m].
    """

    displacement: BearingLoads
    load: BearingLoads


def assemble_structure(
    pinion: AbstractMount,
    wheel: AbstractMount,
    pinion_body: AbstractGearBody,
    wheel_body: AbstractGearBody,
    torque: Scalar,
    ratio: Scalar,
    housing: Housing | None = None,
    speed: Scalar | float = 0.0,
) -> Structure:
    """Put both bodies on their shafts, and the shafts on their bearings.

    Bearings stand on the ground or, in translation, on the housing; a bearing's tilt springs always
    stand on the ground. The housing has no mass, so it is in the bearings' stiffness once
    and for all.

    **Arguments:**

    - `pinion`: its shaft, or the springs at its centre.
    - `wheel`: its shaft, or the springs at its centre.
    - `pinion_body`: of the pinion.
    - `wheel_body`: of the wheel.
    - `torque`: of the drive, on the pinion's shaft [N m].
    - `ratio`: of the wheel's base radius to the pinion's [-].
    - `housing`: between the bearings and the ground, or `None`: rigid.
    - `speed`: of the pinion, whose rotation loads condensed bodies [rad/s].

    **Returns:**

    The structure. Condensed bodies are in it without their mass.

    **Raises:**

    - `ValueError` if a shaft is free to move apart from its spin, if a body that is a beam has
        no shaft, or if the housing is one for another number of bearings.
    """
    mounts, bodies = (pinion, wheel), (pinion_body, wheel_body)
    for name, mount in zip(BODIES, mounts, strict=True):
        mount.check_held(name)
    mapped = _structure_map(mounts, bodies)
    bearings = [bearing for mount in mounts for bearing in mount.bearings]
    seats = bearing_stiffness_on(bearings, housing)
    parts = [
        body.matrices(name, mount) for name, mount, body in zip(BODIES, mounts, bodies, strict=True)
    ]
    tilts = jnp.stack([b.tilt for b in bearings]) if bearings else jnp.zeros((0, 2))
    stiffness = _on_diagonal(parts[0].stiffness, parts[1].stiffness)
    if bearings:
        first = np.asarray(mapped.bearings)[:, None]
        along = (first + np.arange(3)).ravel()
        about = (first + np.arange(3, 5)).ravel()
        stiffness = stiffness.at[along[:, None], along[None, :]].add(seats)
        stiffness = stiffness.at[about, about].add(tilts.ravel())
    none = [jnp.zeros((size, size)) for size in mapped.sizes]
    return Structure(
        stiffness=stiffness,
        mass=_on_diagonal(parts[0].mass, parts[1].mass),
        pinion_gyroscopic=_on_diagonal(parts[0].gyroscopic, none[1]),
        wheel_gyroscopic=_on_diagonal(none[0], parts[1].gyroscopic),
        load=_outside_load(mounts, bodies, mapped, as_scalar(torque), as_scalar(ratio))
        + seat_loads(bodies, mapped.loaded, mapped.size, as_scalar(speed), as_scalar(ratio)),
        bearing_stiffness=seats,
        bearing_tilt=tilts,
        map=mapped,
    )


def driving_torque(pinion: AbstractMount, torque: Scalar) -> Scalar:
    """Torque that the mesh must balance.

    Couples about Z on the pinion's shaft help the drive; on the wheel's they change its reaction.

    **Arguments:**

    - `pinion`: its shaft, or the springs at its centre.
    - `torque`: of the drive [N m].

    **Returns:**

    Torque about +Z [N m].
    """
    return torque + pinion.couple


def check_torque(pinion: AbstractMount, torque: Scalar) -> None:
    """Refuse a drive that does not load the mesh. Traced numbers are let through.

    **Arguments:**

    - `pinion`: its shaft, or the springs at its centre.
    - `torque`: of the drive [N m].

    **Raises:**

    - `InputError` unless the torque is positive, and what the mesh must balance too.
    """
    # As `driving_torque`, but each operation of JAX's would be a program.
    drive, couple = in_numpy(torque), in_numpy(pinion.couple)
    require(
        drive > 0.0,
        "The pinion's torque must be positive, got {got:.6g} N m: it drives. Without "
        "load flanks touch at one point: see `unloaded_transmission_error`. To load the coast "
        "flanks mirror the pair: change the sign of the helix angle, of misalignment and loads "
        "along T; scenes do so where pair.torque_pinion_Nm is negative.",
        got=torque,
    )
    require(
        drive + couple > 0.0,
        "Couples about Z on the pinion's shaft of {couple:.6g} N m leave the mesh nothing of its "
        "torque of {torque:.6g} N m: the pinion must drive. Change the sign of a couple, or the "
        "torque.",
        couple=pinion.couple,
        torque=torque,
    )


def static_flexibility(structure: Structure, vectors: DofCoordinates) -> StaticFlexibility:
    r"""Response of a structure to loads on the teeth, and to its constant loads.

    A body turns freely about Z, so statics knows its rotation only up to a constant. Here the
    rotation of each gear about Z, the mean of both ends of a beam body, is zero: rotation is a
    coordinate of the mesh, which balances the torques. Every load is therefore balanced by a couple
    about Z on the gear itself. These couples sum to zero once the mesh carries the driving torque,
    and a spring that holds that rotation alone carries nothing, whatever its stiffness.

    **Arguments:**

    - `structure`: the bodies on their bearings.
    - `vectors`: loads on the gears' nodes per mesh load, rows as `structure.map.gear_dofs`; and so
        the mesh coordinates per motion of these nodes [-, 1/m].

    **Returns:**

    The response. Where bodies bend, it is differentiable by everything that they are made of.
    """
    mapped = structure.map
    gear = np.asarray(mapped.gear_dofs)
    loads = jnp.zeros((mapped.size, vectors.shape[1])).at[gear].set(vectors)
    loads = jnp.concatenate([loads, structure.load[:, None]], axis=1)
    turn, mean = _spin_modes(mapped)
    loads = loads - mean @ (turn.T @ loads)
    # Any stiffness will do; this one is of the size of what it stands beside.
    turning = np.flatnonzero(turn.sum(axis=1))
    own = jnp.sum(jnp.diagonal(structure.stiffness)[turning])
    hold = jnp.where(own > 0.0, own, 1.0)
    held = structure.stiffness + hold * (mean @ mean.T)
    free = np.asarray(mapped.free)
    held = held[free[:, None], free[None, :]]
    scale = 1.0 / jnp.sqrt(jnp.diagonal(held))
    scaled = scale[:, None] * held * scale[None, :]
    solved = jax.scipy.linalg.solve(scaled, scale[:, None] * loads[free], assume_a="pos")
    motion = jnp.zeros_like(loads).at[free].set(scale[:, None] * solved)
    response, offset = motion[:, :-1], motion[:, -1]
    given = vectors.T @ response[gear]
    return StaticFlexibility(
        response=response,
        offset=offset,
        mesh_flexibility=0.5 * (given + given.T),
        mesh_offset=vectors.T @ offset[gear],
    )


@compiled
def bearing_motion(structure: Structure, motion: Load) -> BearingMotion:
    """Displacement of the shafts at their bearings, and what they put on them.

    **Arguments:**

    - `structure`: the bodies on their bearings.
    - `motion`: of every degree of freedom [m, rad].

    **Returns:**

    A row for each bearing, the pinion's first. With a housing the displacement is that of the shaft
    against the ground, and the load follows from that against the seat.
    """
    count = len(structure.map.bearings)
    rows = np.asarray(structure.map.bearings, dtype=int)[:, None] + np.arange(5)
    displacement = motion[rows]
    along = structure.bearing_stiffness @ displacement[:, :3].reshape(3 * count)
    about = structure.bearing_tilt * displacement[:, 3:]
    load = jnp.concatenate([along.reshape(count, 3), about], axis=1)
    return BearingMotion(displacement=displacement, load=load)


def _structure_map(
    mounts: tuple[AbstractMount, AbstractMount], bodies: tuple[AbstractGearBody, AbstractGearBody]
) -> StructureMap:
    starts: list[tuple[str, int]] = []
    sizes, gears, loaded, torques, bearings, free = [], [], [], [], [], []
    for name, mount, body in zip(BODIES, mounts, bodies, strict=True):
        begin, nodes = sum(sizes), body.nodes(mount)
        starts += [(f"{name} {place}", begin + 6 * node) for place, node in nodes.places]
        kinds = (nodes.gear, nodes.loaded, nodes.torque)
        for dofs, chosen in zip((gears, loaded, torques), kinds, strict=True):
            dofs.append(tuple(begin + 6 * node for node in chosen))
        bearings += [begin + 6 * node for node in nodes.bearings]
        sizes.append(6 * nodes.count)
        free += [begin + k for k in range(sizes[-1]) if k not in nodes.rigid]
    return StructureMap(
        tuple(starts),
        (sizes[0], sizes[1]),
        (gears[0], gears[1]),
        (loaded[0], loaded[1]),
        (torques[0], torques[1]),
        tuple(bearings),
        tuple(free),
    )


def _outside_load(
    mounts: tuple[AbstractMount, AbstractMount],
    bodies: tuple[AbstractGearBody, AbstractGearBody],
    mapped: StructureMap,
    torque: Scalar,
    ratio: Scalar,
) -> Load:
    """Loads of the shafts, the driving torque and the reaction that balances the mesh."""
    reaction = ratio * driving_torque(mounts[0], torque) - mounts[1].couple
    load = jnp.zeros(mapped.size)
    for name, mount, body, couple, nodes in zip(
        BODIES, mounts, bodies, (torque, reaction), mapped.torques, strict=True
    ):
        load = load.at[np.asarray(nodes) + 5].add(couple / len(nodes))
        offsets = body.nodes(mount).offsets
        for i, extra in enumerate(mount.loads):
            first = mapped.dofs[f"{name} load {i}"]
            whole = jnp.concatenate([extra.force, extra.moment])
            if offsets:
                whole = carried(offsets[i]).T @ whole
            load = load.at[first + np.arange(6)].add(whole)
    return load


def _spin_modes(mapped: StructureMap) -> tuple[np.ndarray, np.ndarray]:
    """Columns: turning each body as a whole about Z; the mean over its gear's nodes alone."""
    turn, mean = np.zeros((mapped.size, 2)), np.zeros((mapped.size, 2))
    begin = 0
    for body, (size, gear) in enumerate(zip(mapped.sizes, mapped.gears, strict=True)):
        turn[begin + 5 : begin + size : 6, body] = 1.0
        mean[np.asarray(gear) + 5, body] = 1.0 / len(gear)
        begin += size
    return turn, mean


def _on_diagonal(first: StructureMatrix, second: Array) -> Array:
    """Both matrices on the diagonal of a larger one."""
    none = jnp.zeros((first.shape[0], second.shape[0]))
    return jnp.block([[first, none], [none.T, second]])
