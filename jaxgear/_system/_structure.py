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
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxgear._checks import InputError, require
from jaxgear._compiled import compiled, in_numpy
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._shaft import BeamBody, Bearing, Shaft, ShaftMatrices, shaft_matrices
from jaxgear._system._support import Support
from jaxgear._types import (
    CoordinateMatrix,
    Coordinates,
    DofCoordinates,
    Scalar,
    as_reals,
    as_scalar,
)

if TYPE_CHECKING:
    NodeDofs = Array
    NodeMatrix = Array
    Load = Array
    StructureMatrix = Array
    Responses = Array
    BearingMatrix = Array
    BearingTilts = Array
    BearingLoads = Array
else:
    NodeDofs = Float[Array, "6"]
    NodeMatrix = Float[Array, "6 6"]
    Load = Float[Array, "structure_dof"]
    StructureMatrix = Float[Array, "structure_dof structure_dof"]
    Responses = Float[Array, "structure_dof coordinate"]
    BearingMatrix = Float[Array, "bearing_direction bearing_direction"]
    BearingTilts = Float[Array, "bearing 2"]
    BearingLoads = Float[Array, "bearing 5"]

BODIES = ("pinion", "wheel")

# A rigid motion counts as free when it is held by less than this, relative to the best held one.
_FREE = 1e-9


class RigidBody(eqx.Module):
    """A gear body that does not deform, lumped at its mid-face.

    **Fields:**

    - `mass`: [kg].
    - `polar_inertia`: about the axis [kg m2].
    - `transverse_inertia`: about a diameter at mid-face [kg m2].

    **Raises:**

    - `ValueError` if no body can have these numbers.
    """

    mass: Scalar = eqx.field(converter=as_scalar)
    polar_inertia: Scalar = eqx.field(converter=as_scalar)
    transverse_inertia: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        for name in ("mass", "polar_inertia", "transverse_inertia"):
            require(
                in_numpy(getattr(self, name)) > 0.0,
                "`RigidBody." + name + "` must be positive, got {got:.6g}.",
                got=getattr(self, name),
            )
        # Equality is a flat disc, and must survive rounding.
        require(
            2.0 * in_numpy(self.transverse_inertia) >= (1.0 - 1e-9) * in_numpy(self.polar_inertia),
            "`RigidBody.transverse_inertia` must be at least half the polar inertia, as of every "
            "body, got {transverse:.6g} against {polar:.6g} kg m2. Are the two exchanged?",
            transverse=self.transverse_inertia,
            polar=self.polar_inertia,
        )


def solid_disc(
    outer: Scalar | float,
    inner: Scalar | float,
    width: Scalar | float,
    density: Scalar | float,
    *,
    mass: Scalar | float | None = None,
    polar_inertia: Scalar | float | None = None,
    transverse_inertia: Scalar | float | None = None,
) -> RigidBody:
    r"""A disc with a bore, apart from what is known better.

    Without one of its own the transverse inertia follows from what is known of the others: of a
    body that is even along its width $b$ it is $I_p / 2 + m b^2 / 12$, whatever its shape in the
    plane.

    **Arguments:**

    - `outer`: diameter, that of a gear's root circle [m].
    - `inner`: bore diameter, zero for none [m]. A shaft within brings its own mass.
    - `width`: face width [m].
    - `density`: [kg/m3].
    - `mass`, `polar_inertia`, `transverse_inertia`: in place of the disc's [kg, kg m2].

    **Returns:**

    The body.

    **Raises:**

    - `ValueError` unless the outer diameter exceeds the inner.
    """
    outer, inner, width, density = (in_numpy(as_scalar(x)) for x in (outer, inner, width, density))
    require(
        (outer > inner) & (inner >= 0.0),
        "A gear body must be larger than its bore, got {outer:.6g} m outside and {inner:.6g} m "
        "inside. Both are diameters in metres.",
        outer=outer,
        inner=inner,
    )
    whole = density * 0.25 * np.pi * (outer**2 - inner**2) * width
    if polar_inertia is None:
        polar_inertia = whole * (outer**2 + inner**2) / 8.0
    mass = whole if mass is None else mass
    if transverse_inertia is None:
        transverse_inertia = 0.5 * polar_inertia + mass * width**2 / 12.0
    return RigidBody(mass, polar_inertia, transverse_inertia)


GearBody = RigidBody | BeamBody | FlexibleBody


class Housing(eqx.Module):
    """An elastic housing, as the bearings see it. It has no mass.

    **Fields:**

    - `stiffness`: loads on its bearing seats per motion of the seats along S, T, Z; the
        pinion's bearings first, in their order, then the wheel's [N/m].

    **Raises:**

    - `ValueError` unless the matrix is square, three rows for each bearing, symmetric and positive
        definite.
    """

    stiffness: BearingMatrix = eqx.field(converter=as_reals)

    def __check_init__(self):
        shape = self.stiffness.shape
        require(
            len(shape) == 2 and shape[0] == shape[1] and shape[0] > 0 and shape[0] % 3 == 0,
            "`Housing.stiffness` must be a square matrix with the rows S, T, Z of each bearing, "
            "got the shape {got}.",
            got=shape,
        )
        if isinstance(self.stiffness, Tracer):
            return
        matrix = np.asarray(self.stiffness)
        uneven = float(np.abs(matrix - matrix.T).max() / np.abs(matrix).max())
        require(
            uneven < 1e-6,
            "`Housing.stiffness` must be symmetric, got entries that differ from their mirror "
            "image by {got:.3g} of the largest. Mind the order of rows and columns.",
            got=uneven,
        )
        lowest = float(np.linalg.eigvalsh(matrix)[0])
        require(
            lowest > 0.0,
            "`Housing.stiffness` must be positive definite, got a lowest eigenvalue of {got:.3g} "
            "N/m. A housing that is not held itself cannot hold a bearing.",
            got=lowest,
        )


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
    pinion: Shaft | Support,
    wheel: Shaft | Support,
    pinion_body: GearBody,
    wheel_body: GearBody,
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
        if isinstance(mount, Shaft):
            check_supported(mount, name)
    mapped = _structure_map(mounts, (pinion_body, wheel_body))
    bearings = [b for mount in mounts if isinstance(mount, Shaft) for b in mount.bearings]
    seats = _seat_stiffness(bearings, housing)
    parts = [_mounted_body(*each) for each in zip(BODIES, mounts, bodies, strict=True)]
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
        load=_outside_load(mounts, mapped, as_scalar(torque), as_scalar(ratio))
        + _rotation_load(bodies, mapped, as_scalar(speed), as_scalar(ratio)),
        bearing_stiffness=seats,
        bearing_tilt=tilts,
        map=mapped,
    )


def driving_torque(pinion: Shaft | Support, torque: Scalar) -> Scalar:
    """Torque that the mesh must balance.

    Couples about Z on the pinion's shaft help the drive; on the wheel's they change its reaction.

    **Arguments:**

    - `pinion`: its shaft, or the springs at its centre.
    - `torque`: of the drive [N m].

    **Returns:**

    Torque about +Z [N m].
    """
    return torque + _couple(pinion)


def check_torque(pinion: Shaft | Support, torque: Scalar) -> None:
    """Refuse a drive that does not load the mesh. Traced numbers are let through.

    **Arguments:**

    - `pinion`: its shaft, or the springs at its centre.
    - `torque`: of the drive [N m].

    **Raises:**

    - `InputError` unless the torque is positive, and what the mesh must balance too.
    """
    require(
        torque > 0.0,
        "The pinion's torque must be positive, got {got:.6g} N m: it drives, and without load no "
        "contact state exists. To load the other flanks, change the sign of the helix angle.",
        got=torque,
    )
    require(
        driving_torque(pinion, torque) > 0.0,
        "Couples about Z on the pinion's shaft of {couple:.6g} N m leave the mesh nothing of its "
        "torque of {torque:.6g} N m: the pinion must drive. Change the sign of a couple, or the "
        "torque.",
        couple=_couple(pinion),
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


def check_supported(shaft: Shaft, name: str) -> None:
    """Refuse a shaft that its bearings leave free to move, apart from its spin.

    A shaft of numbers that JAX traces is let through.

    **Arguments:**

    - `shaft`: the shaft.
    - `name`: whose it is, "pinion" or "wheel", for the message.

    **Raises:**

    - `InputError` if it can move as a rigid body.
    """
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(shaft)):
        return
    values = [
        [float(x) for x in (b.at, b.radial_s, b.radial_t, b.axial, b.tilt_s, b.tilt_t)]
        for b in shaft.bearings
    ]
    at, radial_s, radial_t, axial, tilt_s, tilt_t = np.asarray(values).T
    length = sum(float(segment.length) for segment in shaft.segments)
    # Heights from mid-shaft over its length, so that moving and tilting are of one size.
    arm = at / length - 0.5
    planes = [
        _plane_on_bearings(radial_s, arm, tilt_t / length**2),
        _plane_on_bearings(radial_t, -arm, tilt_s / length**2),
    ]
    limit = _FREE * max(axial.sum(), *(np.linalg.eigvalsh(plane)[-1] for plane in planes))
    whose = f"The {name}'s shaft is free to "
    require(
        bool(axial.sum() > limit),
        whose + "slide along Z. Give one of its bearings an axial stiffness, `axial_N_m`.",
    )
    for plane, along, about in zip(planes, "ST", "TS", strict=True):
        values, modes = np.linalg.eigh(plane)
        free = modes[:, values <= limit]
        require(
            not _moves(free),
            whose + f"move along {along}. Give its bearings a radial stiffness along {along}, "
            f"`radial_{along}_N_m`.",
        )
        require(
            free.size == 0,
            whose + f"tilt about {about}: only one place holds it along {along}. Add a second "
            "bearing elsewhere, or give one a tilt stiffness, `tilt_Nm_rad`.",
        )


def _plane_on_bearings(radial: np.ndarray, arm: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Stiffness against moving along an axis and tilting in its plane."""
    mixed = (radial * arm).sum()
    return np.array([[radial.sum(), mixed], [mixed, (radial * arm**2 + tilt).sum()]])


def _moves(free: np.ndarray) -> bool:
    """Whether the free motions of a plane include one without tilt."""
    return free.shape[1] == 2 or bool(np.any(np.abs(free[1]) < 1e-6))


def _mounted_body(name: str, mount: Shaft | Support, body: GearBody) -> ShaftMatrices:
    """Matrices of one body on its shaft, or at the one node of its support."""
    if isinstance(body, FlexibleBody):
        none = jnp.zeros_like(body.seat_stiffness)
        held = none
        if isinstance(mount, Support):
            held = jnp.diag(_springs(mount))
        return ShaftMatrices(body.seat_stiffness + held, none, none)
    if isinstance(mount, Shaft):
        if isinstance(body, BeamBody):
            return shaft_matrices(mount, body)
        matrices, first = shaft_matrices(mount), 6 * mount.layout.gear_nodes[0]
        rows = first + np.arange(6)
        inertia, spin = _lumped(body)
        return ShaftMatrices(
            stiffness=matrices.stiffness,
            mass=matrices.mass.at[rows, rows].add(inertia),
            gyroscopic=matrices.gyroscopic.at[rows[:, None], rows[None, :]].add(spin),
        )
    if isinstance(body, BeamBody):
        raise InputError(
            f"The {name}'s body is a beam, which must be part of a shaft. Give its shaft and "
            "bearings, or make the body rigid."
        )
    inertia, spin = _lumped(body)
    return ShaftMatrices(jnp.diag(_springs(mount)), jnp.diag(inertia), spin)


def _springs(mount: Support) -> NodeDofs:
    """Stiffness of a support along and about S, T, Z."""
    springs = [mount.radial_s, mount.radial_t, mount.axial, mount.tilt, mount.tilt, None]
    # A rigid direction has no spring: it is not among the free degrees of freedom.
    return jnp.stack([jnp.zeros(()) if spring is None else spring for spring in springs])


def _lumped(body: RigidBody) -> tuple[NodeDofs, NodeMatrix]:
    """Inertia along and about S, T, Z, and the gyroscopic matrix, of a rigid body at its node."""
    across, polar = body.transverse_inertia, body.polar_inertia
    inertia = jnp.stack([body.mass, body.mass, body.mass, across, across, polar])
    turn = np.zeros((6, 6))
    turn[3, 4], turn[4, 3] = 1.0, -1.0
    return inertia, polar * turn


def _structure_map(
    mounts: tuple[Shaft | Support, Shaft | Support], bodies: tuple[GearBody, GearBody]
) -> StructureMap:
    starts: list[tuple[str, int]] = []
    sizes, gears, loaded, torques, bearings, free = [], [], [], [], [], []
    for name, mount, body in zip(BODIES, mounts, bodies, strict=True):
        begin = sum(sizes)
        if isinstance(body, FlexibleBody) and isinstance(mount, Shaft):
            nodes = seat_nodes(body)
            starts += [(f"{name} {place}", begin + 6 * node) for place, node in nodes.items()]
            gears.append((begin + 6 * body.gear_seat,))
            torques.append(gears[-1])
            loaded.append(tuple(begin + 6 * node for node in range(len(body.seats))))
            bearings += [begin + 6 * nodes[f"bearing {i}"] for i in range(len(mount.bearings))]
            sizes.append(6 * len(body.seats))
            free += range(begin, begin + sizes[-1])
        elif isinstance(mount, Shaft):
            layout = mount.layout
            starts += [(f"{name} {place}", begin + 6 * node) for place, node in layout.places]
            gears.append(tuple(begin + 6 * node for node in layout.gear_nodes))
            loaded.append(gears[-1])
            torques.append(tuple(begin + 6 * node for node in layout.torque_nodes))
            nodes = layout.nodes
            count = len(mount.bearings)
            bearings += [begin + 6 * nodes[f"bearing {i}"] for i in range(count)]
            sizes.append(6 * layout.count)
            free += range(begin, begin + sizes[-1])
        else:
            starts += [(f"{name} {place}", begin) for place in ("gear", "torque")]
            gears.append((begin,))
            loaded.append(gears[-1])
            torques.append(gears[-1])
            sizes.append(6)
            springs = (mount.radial_s, mount.radial_t, mount.axial, mount.tilt, mount.tilt)
            free += [begin + k for k, spring in enumerate(springs) if spring is not None]
            free.append(begin + 5)
    return StructureMap(
        tuple(starts),
        (sizes[0], sizes[1]),
        (gears[0], gears[1]),
        (loaded[0], loaded[1]),
        (torques[0], torques[1]),
        tuple(bearings),
        tuple(free),
    )


def seat_nodes(body: FlexibleBody) -> dict[str, int]:
    """Numbers of the seats of a condensed body, named as the nodes of a shaft.

    **Arguments:**

    - `body`: its seats are `bearing[0]` and so on, and `torque` where that is a place of its own.

    **Returns:**

    The numbers, with "gear" and "torque" for the seat whose rotation is the gear's.
    """
    named = {seat.replace("[", " ").rstrip("]"): i for i, seat in enumerate(body.seats)}
    return named | {"gear": body.gear_seat, "torque": body.gear_seat}


def _seat_stiffness(bearings: list[Bearing], housing: Housing | None) -> BearingMatrix:
    """Stiffness along S, T, Z of all bearings, in series with that of the housing."""
    if not bearings:
        require(
            housing is None,
            "A housing must have bearings to hold. Give a shaft with bearings to the pinion or the "
            "wheel, or leave the housing out.",
        )
        return jnp.zeros((0, 0))
    springs = jnp.diag(jnp.concatenate([bearing.translation for bearing in bearings]))
    if housing is None:
        return springs
    require(
        housing.stiffness.shape == springs.shape,
        "`Housing.stiffness` must have three rows for each of the {count} bearings, the pinion's "
        "first, got the shape {got}.",
        count=len(bearings),
        got=housing.stiffness.shape,
    )
    behind = 0.5 * (housing.stiffness + housing.stiffness.T)
    series = springs @ jax.scipy.linalg.solve(springs + behind, behind, assume_a="pos")
    return 0.5 * (series + series.T)


def _couple(mount: Shaft | Support) -> Scalar:
    """Sum of the couples about Z that come from outside."""
    if isinstance(mount, Support) or not mount.loads:
        return jnp.zeros(())
    return jnp.sum(jnp.stack([load.moment[2] for load in mount.loads]))


def _outside_load(
    mounts: tuple[Shaft | Support, Shaft | Support],
    mapped: StructureMap,
    torque: Scalar,
    ratio: Scalar,
) -> Load:
    """Loads of the shafts, the driving torque and the reaction that balances the mesh."""
    reaction = ratio * driving_torque(mounts[0], torque) - _couple(mounts[1])
    load = jnp.zeros(mapped.size)
    for name, mount, couple, nodes in zip(
        BODIES, mounts, (torque, reaction), mapped.torques, strict=True
    ):
        load = load.at[np.asarray(nodes) + 5].add(couple / len(nodes))
        if isinstance(mount, Shaft):
            for i, extra in enumerate(mount.loads):
                first = mapped.dofs[f"{name} load {i}"]
                whole = jnp.concatenate([extra.force, extra.moment])
                load = load.at[first + np.arange(6)].add(whole)
    return load


def _rotation_load(
    bodies: tuple[GearBody, GearBody], mapped: StructureMap, speed: Scalar, ratio: Scalar
) -> Load:
    """Loads of rotation on the seats of condensed bodies."""
    load = jnp.zeros(mapped.size)
    for body, nodes, own in zip(bodies, mapped.loaded, (speed, speed / ratio), strict=True):
        if isinstance(body, FlexibleBody):
            load = load.at[nodes[0] : nodes[0] + body.seat_load.size].add(own**2 * body.seat_load)
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
