"""A gear pair set in motion: its structure, its mesh and, if condensed, its bodies' modes."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np

from jaxgear._checks import InputError, require, require_float64
from jaxgear._compiled import compiled
from jaxgear._dynamics._bodies import (
    matrices_with,
    outside_loads,
    size_with,
    turning_terms,
    vibrating_bodies,
    with_modes,
)
from jaxgear._dynamics._body_mesh import body_mesh
from jaxgear._dynamics._damping import AbstractDamping, ModalDamping, damping_matrix
from jaxgear._dynamics._moving_mesh import mesh_with_back_flanks, node_mesh
from jaxgear._dynamics._system import DynamicSystem, PairDynamics, modal_basis
from jaxgear._dynamics._types import (
    FreeMotions,
    Matrix,
    Vector,
)
from jaxgear._geometry._backlash import check_backlash, has_back_contact
from jaxgear._geometry._lines import MeshGrid
from jaxgear._solve._cycle import corrected_cycle, prepare_mesh
from jaxgear._system._flexible import condensed
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import PairSystem
from jaxgear._system._structure import check_torque
from jaxgear._types import Flag, Scalar


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
    r"""Set a gear pair in motion (theory 8.1, theory 8.7).

    **Arguments:**

    - `model`: gears, flanks, mounts, bodies and torque.
    - `grid`: time steps in one mesh period (`phases`), slices, mesh periods in the cycle.
    - `damping`: of the linear system with the mean mesh stiffness; by default `ModalDamping()`.
        Its mesh is the teeth: what condensed bodies give under them is structure.
    - `gyroscopic`: whether gears and shafts that tilt while they spin feel it; and condensed bodies
        the Coriolis forces, spin softening and stress stiffening that they then must have.
    - `active_mesh_damping`: whether the mesh damps only while it is in contact. Its part of
        `damping` then becomes forces of the closed cells in proportion to their rate, with
        the ratio that the mode of the largest mesh energy has.
    - `centrifugal`: whether condensed bodies grow with the speed of each response; `model.speed`
        is that of statics, and not used here. Heat is always there.
    - `mesh_coordinates`: combinations of the motions of condensed bodies that the mesh tells apart,
        beside approach and tilt; scenes take 8, for helical teeth 24.

    **Returns:**

    The pair, with its back flanks if a gear has a `thickness_allowance`; look at `cycle.converged`.

    **Raises:**

    - `ValueError` in single precision, if thinner teeth still have no backlash, or if a condensed
        body was made without modes or, with `gyroscopic`, without the terms of rotation, is not
        itself again where the cycle ends, or stands beside back flanks; if a beam stands beside
        active mesh damping.
    """
    require_float64()
    check_torque(model.pinion_support, model.torque)
    _check_together(model, active_mesh_damping)
    check_backlash(model.pair)
    dynamics, complete = _in_motion(
        model,
        grid,
        ModalDamping() if damping is None else damping,
        gyroscopic=gyroscopic,
        active_mesh_damping=active_mesh_damping,
        centrifugal=centrifugal,
        mesh_coordinates=mesh_coordinates,
    )
    require(
        complete,
        "Steps of {phases} to a mesh period are too long for the contact lines kept for the "
        "back flanks. Use more phases.",
        phases=grid.phases,
    )
    return dynamics


def _check_together(model: PairModel, active: bool) -> None:
    """Refuse what does not go together with beams or condensed bodies."""
    bends = any(body is not None and body.piece is not None for body in model.bodies)
    vibrates = bool(condensed(model.bodies))
    require(
        not (active and bends),
        "Mesh damping that acts only in contact goes by the rates of the gears' nodes, between "
        "which a beam body bows without inertia: leave it out, or make beam bodies rigid or "
        "condensed.",
    )
    require(
        not (vibrates and has_back_contact(model.pair)),
        "Back flanks are for rigid bodies and beams in motion: teeth on a condensed body press on "
        "its rim by their drive flanks alone. Leave `thickness_allowance` out, or make condensed "
        "bodies rigid.",
    )


@compiled
def _in_motion(
    model: PairModel,
    grid: MeshGrid,
    damping: AbstractDamping,
    *,
    gyroscopic: bool,
    active_mesh_damping: bool,
    centrifugal: bool,
    mesh_coordinates: int,
) -> tuple[PairDynamics, Flag]:
    """The pair, and whether the grid holds all lines of back flanks; see `pair_dynamics`."""
    # Rotation acts at the speed of each response, and not at one for all.
    model = dataclasses.replace(model, speed=jnp.zeros(()))
    prepared = prepare_mesh(model, grid)
    cycle, mounted = corrected_cycle(prepared, model), prepared.system
    structure, mapped = mounted.structure, mounted.structure.map
    bodies = vibrating_bodies(model, mounted, grid)
    size = size_with(mounted, bodies)
    dofs = np.r_[np.asarray(mapped.free), mapped.size : size]
    among = lambda matrix: matrix[dofs[:, None], dofs[None, :]]
    of = lambda vector: jnp.concatenate([vector, jnp.zeros(size - mapped.size)])[dofs]
    met = (
        body_mesh(model, mounted, cycle, grid, bodies, mesh_coordinates)
        if bodies
        else node_mesh(model, mounted, cycle, grid)
    )
    damping, active = _split(damping, active_mesh_damping)
    mass, stiffness = (among(matrix) for matrix in matrices_with(mounted, bodies, size))
    meshed, teeth = met.mean.among(dofs)
    held = _held(mass, stiffness + meshed, teeth, of(_rigid_rotation(mounted)), damping)
    turning = turning_terms(bodies, size, damping, whole=gyroscopic) if bodies else None
    whirl = None if turning is None else turning.gyroscopic
    if gyroscopic:
        ratio = model.pair.teeth[0] / model.pair.teeth[1]
        rigid = structure.pinion_gyroscopic - ratio * structure.wheel_gyroscopic
        rigid = with_modes(rigid, size)
        whirl = rigid if whirl is None else whirl + rigid
    if turning is not None and not centrifugal:
        turning = dataclasses.replace(turning, load=jnp.zeros_like(turning.load))
        met = met._replace(table=dataclasses.replace(met.table, growth=None))
    back, complete = has_back_contact(model.pair), jnp.asarray(True)
    if back:
        met, complete = mesh_with_back_flanks(met, model, mounted, cycle, grid)
    system = DynamicSystem(
        mass=mass,
        damping=held.damping,
        stiffness=stiffness + held.spring,
        gyroscopic=None if whirl is None else among(whirl),
        vectors=met.mean.vectors[dofs],
        load=outside_loads(mounted, bodies, size)[dofs],
        bow=met.bow,
        mean=met.mean.stiffness,
        teeth_part=met.mean.teeth,
        table=met.table,
        cell_damping=None,
        force=mounted.force,
        transmission=of(_transmission(mounted)),
        rest=met.rest,
        free=held.free,
        teeth=model.pair.pinion.teeth,
        back=back,
        turning=jax.tree.map(lambda x: among(x) if x.ndim == 2 else x[dofs], turning),
    )
    if active is not None:
        system = dataclasses.replace(system, cell_damping=active(system))
    dynamics = PairDynamics(
        system=system,
        cycle=cycle,
        dofs=tuple(int(i) for i in dofs),
        bodies=tuple(each.place for each in bodies),
        left_out=met.left_out,
    )
    return dynamics, complete


class _Held(NamedTuple):
    """How the free rotation of a structure is held by a spring and a damper of no meaning.

    **Fields:**

    - `spring`: stiffness of that spring among all motions.
    - `damping`: of all motions, with that damper.
    - `free`: the rotation, of unit modal mass, as a column.
    """

    spring: Matrix
    damping: Matrix
    free: FreeMotions


def _held(
    mass: Matrix, whole: Matrix, teeth: Matrix, rotation: Vector, damping: AbstractDamping
) -> _Held:
    """Hold the free rotation of a structure with its mean mesh, of which `teeth` is a part."""
    free = rotation / jnp.sqrt(rotation @ mass @ rotation)
    # The artificial spring is faster than any mode, so that it meets none: the trace is the sum of
    # all squared frequencies, of which there may be one.
    square = 4.0 * jnp.trace(jnp.linalg.solve(mass, whole))
    momentum = (mass @ free)[:, None]
    hold = momentum @ momentum.T
    # A damper beside it, so that what rounding excites dies out.
    matrix = damping_matrix(damping, mass, whole + square * hold, teeth, free[:, None])
    return _Held(square * hold, matrix + jnp.sqrt(square) * hold, free[:, None])


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
