r"""Bodies, shafts, bearings and a mesh in time: $M\ddot q + (C + \Omega_1 G)\dot q + Kq = F - Vg$.

The motion $q$ is a perturbation about rigid rotation at the speed $\Omega_1$ of the pinion. The
mesh presses with $g(t, m)$ on its few coordinates $m = V^Tq - Bg$. A gear pair turns freely as a
whole: that one rotation is held by a spring and a damper, which loads that balance never stretch.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np

from jaxgear._checks import InputError, require, require_float64
from jaxgear._compiled import compiled
from jaxgear._dynamics._back_flank import back_flank_table, back_vectors, with_back_flanks
from jaxgear._dynamics._bodies import (
    BodyPlace,
    TurningTerms,
    body_masses,
    body_table,
    mode_stiffness,
    size_with,
    turning_terms,
    vibrating_bodies,
    with_modes,
)
from jaxgear._dynamics._cell_forces import tangent_columns
from jaxgear._dynamics._damping import AbstractDamping, ModalDamping, damping_matrix, per_mass
from jaxgear._dynamics._table import MIDDLE, MeshTable, mesh_at, mesh_table, repeated
from jaxgear._dynamics._types import (
    FreeMotions,
    Matrix,
    ModeMatrix,
    ModeValues,
    ModeVectors,
    States,
    StepPlaces,
    Vector,
    Vectors,
)
from jaxgear._geometry._backlash import check_backlash, has_back_contact
from jaxgear._geometry._lines import MeshGrid
from jaxgear._solve._coordinates import on_coordinates_all
from jaxgear._solve._cycle import MeshCycle, corrected_cycle, prepare_mesh
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import PairSystem
from jaxgear._system._structure import check_torque
from jaxgear._types import CoordinateMatrix, DofCoordinates, Flag, Scalar, as_scalar


class DynamicSystem(eqx.Module):
    r"""A linear structure and a mesh in time.

    **Fields:**

    - `mass`: $M$ [kg, kg m, kg m2].
    - `damping`: $C$ [N s/m, N s, N m s].
    - `stiffness`: $K$ without the mesh; positive definite together with `mean` [N/m, N, N m].
    - `gyroscopic`: $G$, per speed of the pinion, or `None` [kg, kg m, kg m2].
    - `vectors`: $V$, mesh coordinates per motion [-, m].
    - `load`: $F$, constant [N, N m].
    - `bow`: $B$, what bodies give between their nodes per mesh load, or `None`: nothing
        [m/N, 1/N, 1/(N m)].
    - `mean`: mean mesh stiffness on the mesh coordinates [N/m, N, N m].
    - `table`: the cells over one cycle.
    - `cell_damping`: $\eta$ of closed cells, which press with $k(\Delta + \eta W\dot n)$, $n$ the
        nodes' mesh coordinates, or `None`; not together with `bow` [s].
    - `force`: static mesh force along the normal [N].
    - `transmission`: transmission error per motion [-, m].
    - `rest`: mesh coordinates at vanishing speed, in the middle of each step [m, rad].
    - `free`: motions that only the artificial spring holds, of unit modal mass
        [kg^-1/2, kg^-1/2 m^-1].
    - `teeth`: of the pinion.
    - `back`: whether the back flanks are in the mesh too; the second half of its coordinates is
        then theirs.
    - `turning`: what condensed bodies bring as they turn, or `None`: there are none.
    """

    mass: Matrix
    damping: Matrix
    stiffness: Matrix
    gyroscopic: Matrix | None
    vectors: Vectors
    load: Vector
    bow: CoordinateMatrix | None
    mean: CoordinateMatrix
    table: MeshTable
    cell_damping: Scalar | None
    force: Scalar
    transmission: Vector
    rest: StepPlaces
    free: FreeMotions
    teeth: int = eqx.field(static=True)
    back: bool = eqx.field(static=True, default=False)
    turning: TurningTerms | None = None

    @property
    def mesh_stiffness(self) -> Matrix:
        """Mean mesh stiffness on all degrees of freedom [N/m, N, N m]."""
        return self.vectors @ self.mean @ self.vectors.T

    @property
    def whole_stiffness(self) -> Matrix:
        """Stiffness of the structure with the mean mesh in it [N/m, N, N m]."""
        return self.stiffness + self.mesh_stiffness

    def stiffness_at(self, speed: Scalar) -> Matrix:
        """Stiffness with the mean mesh in it at a speed of the pinion [N/m, N, N m]."""
        if self.turning is None:
            return self.whole_stiffness
        return self.whole_stiffness + self.turning.stiffness_at(speed)

    def rates_at(self, speed: Scalar) -> Matrix:
        """Damping and gyroscopic forces at a speed of the pinion [N s/m, N s, N m s]."""
        matrix = self.damping
        if self.gyroscopic is not None:
            matrix = matrix + speed * self.gyroscopic
        return matrix

    def load_at(self, speed: Scalar) -> Vector:
        """Constant load at a speed of the pinion [N, N m]."""
        return self.load if self.turning is None else self.load + speed**2 * self.turning.load

    def over(self, cycles: int) -> "DynamicSystem":
        """The same system, its table gone through so many times."""
        return eqx.tree_at(lambda s: s.table, self, repeated(self.table, cycles))

    def mesh_period(self, speed: Scalar) -> Scalar:
        """Duration of one mesh period at a speed of the pinion [rad/s]; in [s]."""
        return 2.0 * jnp.pi / (self.teeth * speed)


class ModalBasis(eqx.Module):
    r"""Natural modes of a system with the mean mesh stiffness, $\Phi^TM\Phi = I$.

    **Fields:**

    - `square`: $\omega^2$ of each mode [rad2/s2].
    - `shape`: $\Phi$ [kg^-1/2, kg^-1/2 m^-1].
    - `damping`: $2\xi\omega$ of each mode [1/s].
    - `mesh`: $\Phi^TV$ [kg^-1/2].
    - `load`: $\Phi^TF$ [N kg^-1/2].
    """

    square: ModeValues
    shape: ModeMatrix
    damping: ModeValues
    mesh: ModeVectors
    load: ModeValues

    @property
    def swing(self) -> States:
        r"""Weights $(\omega, 1)$ that make displacement and velocity comparable [1/s, -]."""
        return jnp.stack([jnp.sqrt(self.square), jnp.ones_like(self.square)])


def modal_basis(system: DynamicSystem) -> ModalBasis:
    """Find all natural modes.

    **Arguments:**

    - `system`: with damping that its modes do not exchange, as of every `AbstractDamping`.

    **Returns:**

    The modes. Where two of one frequency and damping meet, their derivatives do not exist and are
    NaN. Responses by harmonic balance do not pass through them.

    **Raises:**

    - `ValueError` if modes exchange damping; while JAX traces, the damping is NaN instead.
    """
    modes, exchanged = _modal_basis(system)
    require(
        exchanged <= _LEAST_MIXED,
        "The damping matrix exchanges energy between modes: up to {got:.3g} of their own. Build it "
        "with `RayleighDamping` or `ModalDamping`.",
        got=exchanged,
    )
    return modes


@compiled
def _modal_basis(system: DynamicSystem) -> tuple[ModalBasis, Scalar]:
    """The modes, and the largest energy that damping exchanges between two, over their own [-]."""
    lower = jnp.linalg.cholesky(system.mass)
    stiffness = per_mass(lower, system.whole_stiffness)
    damping = per_mass(lower, system.damping)
    # Both have the same vectors, if the modes exchange no damping; where frequencies meet, the
    # damping tells their modes apart.
    total = jnp.trace(damping)
    share = 0.1 * jnp.trace(stiffness) / jnp.where(total > 0.0, total, 1.0)
    _, vectors = jnp.linalg.eigh(stiffness + share * damping)
    shape = jax.scipy.linalg.solve_triangular(lower, vectors, lower=True, trans=1)
    square = jnp.sum(vectors * (stiffness @ vectors), axis=0)
    modal = vectors.T @ damping @ vectors
    diagonal = jnp.diagonal(modal)
    exchanged = jnp.maximum(_mixed(modal), _mixed(vectors.T @ stiffness @ vectors))
    modes = ModalBasis(
        square=square,
        shape=shape,
        # While JAX traces, nobody is told: no number is then better than a wrong one.
        damping=jnp.where(exchanged <= _LEAST_MIXED, diagonal, jnp.nan),
        mesh=shape.T @ system.vectors,
        load=shape.T @ system.load,
    )
    return modes, exchanged


# So much between modes, relative to their own, does no harm. And so much of the largest is
# rounding: the hold of the free rotation may be a million times as fast as all others.
_LEAST_MIXED, _NOISE = 1e-5, 1e-13


def _mixed(matrix: Matrix) -> Scalar:
    """Largest entry off the diagonal, relative to the diagonal entries that it ties together."""
    own = jnp.abs(jnp.diagonal(matrix))
    noise = _NOISE * jnp.sum(own)
    size = jnp.sqrt(own[:, None] * own[None, :]) + noise
    off = jnp.abs(matrix - jnp.diag(jnp.diagonal(matrix))) - noise
    return jnp.max(jnp.maximum(off, 0.0) / jnp.where(size > 0.0, size, 1.0))


class PairDynamics(eqx.Module):
    """A gear pair in time, with the quasi-static cycle that it starts from.

    **Fields:**

    - `system`: what moves.
    - `cycle`: its states at vanishing speed.
    - `dofs`: which degrees of freedom of the structure move; beyond its size, modes of condensed
        bodies.
    - `bodies`: condensed ones, where their seats and modes are.
    - `left_out`: motion of the cells that mesh coordinates leave out of that of condensed bodies,
        relative; statics has all of it [-].
    """

    system: DynamicSystem
    cycle: MeshCycle
    dofs: tuple[int, ...] = eqx.field(static=True)
    bodies: tuple[BodyPlace, ...] = ()
    left_out: Scalar = eqx.field(converter=as_scalar, default=0.0)


def pair_dynamics(
    model: PairModel,
    grid: MeshGrid,
    damping: AbstractDamping | None = None,
    *,
    gyroscopic: bool = False,
    active_mesh_damping: bool = False,
    centrifugal: bool = True,
    mesh_coordinates: int = 12,
) -> PairDynamics:
    r"""Set a gear pair in motion.

    **Arguments:**

    - `model`: gears, flanks, mounts, bodies and torque.
    - `grid`: time steps in one mesh period (`phases`), slices, mesh periods in the cycle.
    - `damping`: of the linear system with the mean mesh stiffness; by default `ModalDamping()`.
    - `gyroscopic`: whether gears and shafts that tilt while they spin feel it; and condensed bodies
        the Coriolis forces, spin softening and stress stiffening that they then must have.
    - `active_mesh_damping`: whether the mesh damps only while it is in contact. Its part of
        `damping` then becomes forces of the closed cells in proportion to their rate, with
        the ratio that the mode of the largest mesh energy has.
    - `centrifugal`: whether condensed bodies grow with the speed of each response; `model.speed`
        is that of statics, and not used here.
    - `mesh_coordinates`: combinations of the motions of condensed bodies that the mesh tells apart,
        beside approach and tilt.

    **Returns:**

    The pair, with its back flanks if a gear has a `thickness_allowance`; look at `cycle.converged`.

    **Raises:**

    - `ValueError` in single precision, if thinner teeth still have no backlash, or if a condensed
        body was made without modes or, with `gyroscopic`, without the terms of rotation, is not
        itself again where the cycle ends, or stands beside a beam body, active mesh damping or back
        flanks.
    """
    require_float64()
    check_torque(model.pinion_support, model.torque)
    damping = ModalDamping() if damping is None else damping
    if any(isinstance(body, FlexibleBody) for body in model.bodies):
        return _with_condensed_bodies(
            model,
            grid,
            damping,
            gyroscopic=gyroscopic,
            active=active_mesh_damping,
            centrifugal=centrifugal,
            coordinates=mesh_coordinates,
        )
    check_backlash(model.pair)
    dynamics, complete = _with_rigid_bodies(
        model, grid, damping, gyroscopic=gyroscopic, active_mesh_damping=active_mesh_damping
    )
    require(
        complete,
        "Steps of {phases} to a mesh period are too long for the contact lines kept for the "
        "back flanks. Use more phases.",
        phases=grid.phases,
    )
    return dynamics


@compiled
def _with_rigid_bodies(
    model: PairModel,
    grid: MeshGrid,
    damping: AbstractDamping,
    *,
    gyroscopic: bool,
    active_mesh_damping: bool,
) -> tuple[PairDynamics, Flag]:
    """A pair of rigid bodies and beams, and whether the grid holds all lines of back flanks."""
    prepared = prepare_mesh(model, grid)
    cycle = corrected_cycle(prepared, model)
    mounted = prepared.system
    mapped, structure = mounted.structure.map, mounted.structure
    back = has_back_contact(model.pair)
    require(
        not (active_mesh_damping and mounted.bends),
        "Mesh damping that acts only in contact is for rigid bodies: leave it out, or make beam "
        "bodies rigid.",
    )
    dofs = np.asarray(mapped.free)
    among = lambda matrix: matrix[dofs[:, None], dofs[None, :]]
    spread = jnp.zeros((mapped.size, mounted.vectors.shape[1]))
    onto = lambda rows: spread.at[np.asarray(mapped.gear_dofs)].set(rows)[dofs]
    table = mesh_table(mounted, cycle.cells, grid, model.flanks, model.misalignment)
    vectors, mean = onto(mounted.vectors), _mean_stiffness(cycle, table)
    bow, rest = _bow(mounted), _rest(mounted, cycle)
    mass = among(structure.mass)
    damping, active = _split(damping, active_mesh_damping)
    meshed, rotation = vectors @ mean @ vectors.T, _rigid_rotation(mounted)[dofs]
    held = _held(mass, among(structure.stiffness), meshed, rotation, damping)
    whirl = None
    if gyroscopic:
        ratio = model.pair.teeth[0] / model.pair.teeth[1]
        whirl = among(structure.pinion_gyroscopic - ratio * structure.wheel_gyroscopic)
    complete = jnp.asarray(True)
    if back:
        nodes = tuple(len(gear) for gear in mapped.gears)
        turned = back_vectors(mounted.vectors, (nodes[0], nodes[1]))
        both = jax.scipy.linalg.block_diag
        vectors = jnp.concatenate([vectors, onto(turned)], axis=1)
        mean, bow = both(mean, jnp.zeros_like(mean)), None if bow is None else both(bow, bow)
        rest = jnp.concatenate([rest, _back_rest(mounted, cycle, turned)], axis=1)
        others, complete = back_flank_table(mounted, model, grid, table)
        table = with_back_flanks(table, others)
    system = DynamicSystem(
        mass=mass,
        damping=held.damping,
        stiffness=held.stiffness,
        gyroscopic=whirl,
        vectors=vectors,
        load=structure.load[dofs],
        bow=bow,
        mean=mean,
        table=table,
        cell_damping=None,
        force=mounted.force,
        transmission=_transmission(mounted)[dofs],
        rest=rest,
        free=held.free,
        teeth=model.pair.pinion.teeth,
        back=back,
    )
    if active is not None:
        system = dataclasses.replace(system, cell_damping=active(system))
    return PairDynamics(system=system, cycle=cycle, dofs=mapped.free), complete


@compiled
def _with_condensed_bodies(
    model: PairModel,
    grid: MeshGrid,
    damping: AbstractDamping,
    *,
    gyroscopic: bool,
    active: bool,
    centrifugal: bool,
    coordinates: int,
) -> PairDynamics:
    """A pair of which a body is condensed; see `pair_dynamics`."""
    # Rotation acts at the speed of each response, and not at one for all.
    model = dataclasses.replace(model, speed=jnp.zeros(()))
    prepared = prepare_mesh(model, grid)
    cycle = corrected_cycle(prepared, model)
    mounted = prepared.system
    structure, mapped = mounted.structure, mounted.structure.map
    require(
        not mounted.bends,
        "Beside a condensed body the other must be condensed or rigid in motion, not a beam.",
    )
    require(
        not active,
        "Mesh damping that acts only in contact is for rigid bodies: leave it out, or make "
        "condensed bodies rigid.",
    )
    require(
        not has_back_contact(model.pair),
        "Back flanks are for rigid bodies and beams in motion: leave `thickness_allowance` out, or "
        "make condensed bodies rigid.",
    )
    bodies = vibrating_bodies(model, mounted, grid)
    size = size_with(mounted, bodies)
    dofs = np.r_[np.asarray(mapped.free), mapped.size : size]
    among = lambda matrix: matrix[dofs[:, None], dofs[None, :]]
    met = body_table(model, mounted, cycle, grid, bodies, coordinates)
    vectors = met.vectors[dofs]
    mean = _mean_stiffness(cycle, met.table)
    mean = 0.5 * (mean + mean.T)
    mass = among(with_modes(structure.mass, size) + body_masses(bodies, size))
    own = among(with_modes(structure.stiffness, size))
    own = own + jnp.diag(mode_stiffness(bodies, size)[dofs])
    rest_of = lambda vector: jnp.concatenate([vector, jnp.zeros(size - mapped.size)])[dofs]
    meshed, rotation = vectors @ mean @ vectors.T, rest_of(_rigid_rotation(mounted))
    held = _held(mass, own, meshed, rotation, damping)
    turning = turning_terms(bodies, size, damping, whole=gyroscopic)
    whirl = turning.gyroscopic
    if gyroscopic:
        ratio = model.pair.teeth[0] / model.pair.teeth[1]
        rigid = structure.pinion_gyroscopic - ratio * structure.wheel_gyroscopic
        whirl = whirl + with_modes(rigid, size)
    table = met.table
    if not centrifugal:
        turning = dataclasses.replace(turning, load=jnp.zeros_like(turning.load))
        table = dataclasses.replace(table, growth=None)
    system = DynamicSystem(
        mass=mass,
        damping=held.damping,
        stiffness=held.stiffness,
        gyroscopic=among(whirl),
        vectors=vectors,
        load=rest_of(structure.load),
        bow=None,
        mean=mean,
        table=table,
        cell_damping=None,
        force=mounted.force,
        transmission=rest_of(_transmission(mounted)),
        rest=met.rest,
        free=held.free,
        teeth=model.pair.pinion.teeth,
        turning=jax.tree.map(lambda x: among(x) if x.ndim == 2 else x[dofs], turning),
    )
    return PairDynamics(
        system=system,
        cycle=cycle,
        dofs=tuple(int(i) for i in dofs),
        bodies=tuple(each.place for each in bodies),
        left_out=met.left_out,
    )


class _Held(NamedTuple):
    """A structure whose free rotation is held by a spring and a damper of no meaning.

    **Fields:**

    - `stiffness`, `damping`: of all motions.
    - `free`: the rotation, of unit modal mass, as a column.
    """

    stiffness: Matrix
    damping: Matrix
    free: FreeMotions


def _held(
    mass: Matrix, own: Matrix, meshed: Matrix, rotation: Vector, damping: AbstractDamping
) -> _Held:
    """Hold the free rotation of a structure, `meshed` being the stiffness of its mean mesh."""
    free = rotation / jnp.sqrt(rotation @ mass @ rotation)
    # The artificial spring is faster than any mode, so that it meets none: the trace is the sum of
    # all squared frequencies, of which there may be one.
    square = 4.0 * jnp.trace(jnp.linalg.solve(mass, own + meshed))
    momentum = (mass @ free)[:, None]
    hold = momentum @ momentum.T
    stiffness = own + square * hold
    # A damper beside it, so that what rounding excites dies out.
    matrix = damping_matrix(damping, mass, stiffness + meshed, meshed, free[:, None])
    return _Held(stiffness, matrix + jnp.sqrt(square) * hold, free[:, None])


def _split(damping: AbstractDamping, active: bool):
    """Damping of all but the cells, and what gives the damping of the cells, if they have one."""
    if not active:
        return damping, None
    if not isinstance(damping, ModalDamping):
        raise InputError(
            "Mesh damping that acts only in contact needs `ModalDamping`: no other has a ratio of "
            "its own for the mesh."
        )

    def of_cells(system: DynamicSystem) -> Scalar:
        basis = modal_basis(system)
        energy = jnp.sum((basis.mesh @ system.mean) * basis.mesh, axis=1) / basis.square
        return 2.0 * damping.mesh / jnp.sqrt(basis.square[jnp.argmax(energy)])

    return ModalDamping(mesh=0.0, structure=damping.structure), of_cells


def _mean_stiffness(cycle: MeshCycle, table: MeshTable) -> CoordinateMatrix:
    """Mean over the cycle of the stiffness of the cells in contact, on a table's coordinates."""
    closed = jnp.where(cycle.overlap > 0.0, table.stiffness, 0.0)

    def at_phase(stiffness, coupling, arms):
        return on_coordinates_all(arms, tangent_columns(stiffness, coupling, arms))

    each = jax.vmap(at_phase)(closed, table.coupling, mesh_at(table, MIDDLE).arms)
    return jnp.sum(cycle.cells.lines.weight[:, None, None] * each, axis=0)


def _rigid_rotation(mounted: PairSystem) -> Vector:
    """Both bodies turning together, so that no tooth moves against another [1/m]."""
    radius = mounted.pair.base_radius
    pinion, wheel = mounted.structure.map.sizes
    turned = np.zeros((2, pinion + wheel))
    turned[0, 5:pinion:6] = 1.0
    turned[1, pinion + 5 :: 6] = -1.0
    return jnp.asarray(turned[0]) / radius[0] + jnp.asarray(turned[1]) / radius[1]


def _transmission(mounted: PairSystem) -> Vector:
    r"""Transmission error per motion: $r_{b1}\theta_1 + r_{b2}\theta_2$ at mid-face [-, m]."""
    radius = mounted.pair.base_radius
    at_gears = radius[0] * mounted.middles[5] + radius[1] * mounted.middles[11]
    mapped = mounted.structure.map
    return jnp.zeros(mapped.size).at[np.asarray(mapped.gear_dofs)].set(at_gears)


def _bow(mounted: PairSystem) -> CoordinateMatrix | None:
    """Flexibility of beam bodies between their nodes; it has no mass."""
    if not mounted.bends:
        return None
    at_nodes = mounted.statics.response[np.asarray(mounted.structure.map.gear_dofs)]
    given = mounted.vectors.T @ at_nodes
    return mounted.mesh_flexibility - 0.5 * (given + given.T)


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
