r"""What a steady response means for gears: dynamic ratio, transmission error, forces, orders.

Means are weighted by the lengths of the time steps. Forces are elastic: damping forces do not
stress a tooth. Largest forces are looked for at the start, in the middle and at the end of each
step: where a tooth enters, the force jumps from the end of one step to the start of the next. All
functions can be traced, batched over responses and differentiated.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._compiled import compiled
from jaxgear._dynamics._cell_forces import cell_forces
from jaxgear._dynamics._orbit import Orbit, contact_force, total_force
from jaxgear._dynamics._pressing import load_at_nodes
from jaxgear._dynamics._system import DynamicSystem, PairDynamics
from jaxgear._dynamics._table import MIDDLE, PLACES, START, mesh_at, mesh_within, repeated
from jaxgear._dynamics._types import (
    BearingLoads,
    BearingOrders,
    BearingSeries,
    Orders,
    PairSeries,
    Series,
    StepCells,
    StepPlaces,
)
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._smooth import smooth_maximum
from jaxgear._system._structure import bearing_motion
from jaxgear._types import Flag, Reals, Scalar


class DynamicResponse(eqx.Module):
    """The numbers of one response.

    **Fields:**

    - `dynamic_ratio`: largest total contact force over the static one, at the limits of the steps
        too, as the next two [-].
    - `pair_ratio`: largest force on one tooth pair over the static mesh force [-].
    - `line_load_ratio`: largest line load over the largest at vanishing speed [-].
    - `te_mean`, `te_rms`, `te_peak_to_peak`: transmission error, its RMS about its mean, its range
        [m].
    - `contact_loss`: share of the time in which no tooth touches [-].
    - `te_orders`: amplitudes at the mesh frequency and its multiples [m].
    - `force_orders`: the same of the total contact force [N].
    - `bearing_orders`: the same of the loads that the shafts put on their bearings, along S, T, Z
        and about S, T [N, N m].
    - `bearing_mean`, `bearing_range`: of the same loads [N, N m].
    """

    dynamic_ratio: Scalar
    pair_ratio: Scalar
    line_load_ratio: Scalar
    te_mean: Scalar
    te_rms: Scalar
    te_peak_to_peak: Scalar
    contact_loss: Scalar
    te_orders: Orders
    force_orders: Orders
    bearing_orders: BearingOrders
    bearing_mean: BearingLoads
    bearing_range: BearingLoads


@compiled
def dynamic_response(
    dynamics: PairDynamics,
    orbit: Orbit,
    orders: int = 8,
    law: AbstractContactLaw = ExactContact(),
) -> DynamicResponse:
    """Work out what a response means.

    **Arguments:**

    - `dynamics`: the pair.
    - `orbit`: its response at one speed.
    - `orders`: number of mesh orders, at least 1.
    - `law`: with which the response was found.

    **Returns:**

    The numbers.
    """
    system = dynamics.system
    error = dynamic_transmission_error(system, orbit)
    force = contact_force(system, orbit)
    loads = bearing_loads(dynamics, orbit)
    static = jnp.max(line_loads(dynamics, dynamics.cycle.force))
    pressed = [pressed_cells(system, orbit, law, place) for place in PLACES]
    apart = jnp.max(pressed[PLACES.index(MIDDLE)].overlap, axis=1) <= 0.0
    largest = lambda read: jnp.max(jnp.stack([jnp.max(read(each.force)) for each in pressed]))
    return DynamicResponse(
        dynamic_ratio=jnp.max(jnp.stack([each.total for each in pressed])) / system.force,
        pair_ratio=largest(lambda force: _on_pairs(dynamics, force)) / system.force,
        line_load_ratio=largest(lambda force: line_loads(dynamics, force)) / static,
        te_mean=orbit_mean(system, error),
        te_rms=orbit_rms(system, error),
        te_peak_to_peak=jnp.max(error) - jnp.min(error),
        contact_loss=orbit_mean(system, jnp.where(apart, 1.0, 0.0)),
        te_orders=order_amplitudes(system, error, orders),
        force_orders=order_amplitudes(system, force, orders),
        bearing_orders=order_amplitudes(system, loads, orders),
        bearing_mean=orbit_mean(system, loads),
        bearing_range=jnp.max(loads, axis=0) - jnp.min(loads, axis=0),
    )


@compiled
def dynamic_ratio(
    system: DynamicSystem, orbit: Orbit, law: AbstractContactLaw = ExactContact()
) -> Scalar:
    """Largest total contact force over the static mesh force (theory 11.1).

    **Arguments:**

    - `system`: what moves.
    - `orbit`: its response.
    - `law`: with which it was found.

    **Returns:**

    The ratio [-].
    """
    return jnp.max(force_in_steps(system, orbit, law)) / system.force


@compiled
def smooth_dynamic_ratio(
    system: DynamicSystem,
    orbit: Orbit,
    width: Scalar,
    law: AbstractContactLaw = ExactContact(),
) -> Scalar:
    """Differentiable `dynamic_ratio`; too large by `width log(3 steps)` at the most.

    **Arguments:**

    - `system`: what moves.
    - `orbit`: its response.
    - `width`: of the smoothing, in static mesh forces [-].
    - `law`: with which the response was found.

    **Returns:**

    The ratio [-].
    """
    return smooth_maximum(force_in_steps(system, orbit, law).ravel() / system.force, width)


@compiled
def force_in_steps(
    system: DynamicSystem, orbit: Orbit, law: AbstractContactLaw = ExactContact()
) -> Reals:
    """Total elastic force of all cells at the start, in the middle and at the end of each step.

    **Arguments:**

    - `system`: what moves.
    - `orbit`: its response.
    - `law`: with which it was found.

    **Returns:**

    The force, drive and back flanks together, `[3, step]` [N].
    """
    return jnp.stack([pressed_cells(system, orbit, law, place).total for place in PLACES])


@compiled
def dynamic_transmission_error(system: DynamicSystem, orbit: Orbit) -> Series:
    r"""Transmission error $r_{b1}\theta_1 + r_{b2}\theta_2$ at each step [m]."""
    return orbit.motion @ system.transmission


@compiled
def bearing_loads(dynamics: PairDynamics, orbit: Orbit) -> BearingSeries:
    """Loads that the shafts put on their bearings at each step, the pinion's first [N, N m]."""
    structure = dynamics.cycle.system.structure
    # Behind the structure's come the modes of condensed bodies.
    motion = jnp.zeros((orbit.motion.shape[0], max(dynamics.dofs) + 1))
    motion = motion.at[:, np.asarray(dynamics.dofs)].set(orbit.motion)[:, : structure.map.size]
    return jax.vmap(lambda x: bearing_motion(structure, x).load)(motion)


@compiled
def pair_forces(
    dynamics: PairDynamics, orbit: Orbit, law: AbstractContactLaw = ExactContact()
) -> PairSeries:
    """Force on each tooth pair's contact line at each step, drive flanks [N]."""
    return _on_pairs(dynamics, pressed_cells(dynamics.system, orbit, law, MIDDLE).force)


def _on_pairs(dynamics: PairDynamics, force: StepCells) -> PairSeries:
    """Forces of cells summed over each tooth pair's contact line, drive flanks [N]."""
    lines, slices = dynamics.cycle.cells.lines.roll.shape[1:]
    return jnp.sum(force[:, : lines * slices].reshape(-1, lines, slices), axis=2)


@compiled
def orbit_mean(system: DynamicSystem, values: Reals) -> Reals:
    """Mean over a response of values at its steps, in their unit."""
    return jnp.tensordot(_weights(system, values.shape[0]), values, axes=1)


@compiled
def orbit_variance(system: DynamicSystem, values: Series) -> Scalar:
    """Mean square of the fluctuation of values about their mean, in their unit squared.

    Optimise this rather than the RMS, whose slope is 0/0 where it vanishes.
    """
    return orbit_mean(system, (values - orbit_mean(system, values)) ** 2)


@compiled
def orbit_rms(system: DynamicSystem, values: Series) -> Scalar:
    """RMS of the fluctuation of values about their mean, in their unit."""
    return jnp.sqrt(orbit_variance(system, values))


@compiled
def order_amplitudes(
    system: DynamicSystem, values: Reals, count: int, *, first: float = 1.0
) -> Reals:
    """Amplitudes at multiples of the mesh frequency.

    **Arguments:**

    - `system`: gives the time steps.
    - `values`: at each step of a response over whole cycles; further axes may follow.
    - `count`: number of orders.
    - `first`: the first of them and the distance between them, in mesh orders: 0.5 gives
        the sub-harmonics of a response over two mesh periods too [-].

    **Returns:**

    Peak amplitude of each order, leading, in the unit of `values`.
    """
    weights = _weights(system, values.shape[0])
    middles = jnp.cumsum(weights) - 0.5 * weights
    cycles = values.shape[0] // len(system.table.kinds) * system.table.periods
    order = first * jnp.arange(1, count + 1, dtype=float)
    angle = 2.0 * jnp.pi * cycles * order[:, None] * middles[None, :]
    swing = values - orbit_mean(system, values)[None]
    cosine = jnp.tensordot(weights[None, :] * jnp.cos(angle), swing, axes=1)
    sine = jnp.tensordot(weights[None, :] * jnp.sin(angle), swing, axes=1)
    size = cosine**2 + sine**2
    # An amplitude that vanishes has no slope: zero is given.
    return 2.0 * jnp.where(size > 0.0, jnp.sqrt(jnp.where(size > 0.0, size, 1.0)), 0.0)


def _weights(system: DynamicSystem, steps: int) -> Series:
    """Share of the response in each step [-]."""
    lengths = system.table.lengths / system.table.periods
    times = steps // lengths.size
    return jnp.tile(lengths, times) / times


class PressedCells(NamedTuple):
    """The cells of all steps at one place within each.

    **Fields:**

    - `force`: elastic force of each cell [N].
    - `overlap`: of each cell, negative where it is open, 0 where it cannot close [m].
    - `total`: force of all cells along the normal, drive and back flanks together [N].
    """

    force: StepCells
    overlap: StepCells
    total: Series


@compiled
def forces_in_motion(dynamics: PairDynamics, orbit: Orbit, law: AbstractContactLaw) -> StepCells:
    """Forces of the cells of the drive flanks in the middle of each step.

    **Arguments:**

    - `dynamics`: the pair.
    - `orbit`: its response.
    - `law`: with which it was found.

    **Returns:**

    The forces [N].
    """
    cells = dynamics.cycle.cells.lines.roll[0].size
    return pressed_cells(dynamics.system, orbit, law, MIDDLE).force[:, :cells]


def pressed_cells(
    system: DynamicSystem, orbit: Orbit, law: AbstractContactLaw, place: float
) -> PressedCells:
    """Forces and overlaps of the cells at a place within each step.

    In the middle they are the method's own. At the limits the nodes are interpolated by cubics
    through four mid-steps, which are exact to third order where the acceleration jumps too, and
    the stiffness of each cell is that of the instant.

    **Arguments:**

    - `system`: what moves.
    - `orbit`: its response.
    - `law`: with which it was found.
    - `place`: one of `PLACES`.

    **Returns:**

    The cells, `step` leading.
    """
    times = orbit.place.shape[0] // len(system.table.kinds)
    table = repeated(system.table, times)
    if place == MIDDLE:
        meshes, places, load = mesh_at(table, MIDDLE).at(orbit.speed), orbit.place, orbit.load
    else:
        meshes = mesh_within(table, place).at(orbit.speed)
        edges = _at_starts(table.lengths, orbit.motion @ system.vectors, orbit.settled)
        nodes = edges if place == START else jnp.roll(edges, -1, axis=0)
        load, places = None, nodes
        if system.bow is not None:
            load, places, _ = jax.vmap(
                lambda mesh, own, near: load_at_nodes(system, law, mesh, own, near)
            )(meshes, nodes, orbit.load)
    force, overlap = jax.vmap(lambda mesh, own: cell_forces(mesh, own, law))(meshes, places)
    if load is None:
        load = jnp.einsum("scm,sc->sm", meshes.arms, force)
    force, overlap = table.on_all_cells(force), table.on_all_cells(overlap)
    return PressedCells(force, overlap, total_force(system, load))


def _at_starts(lengths: Reals, middles: StepPlaces, settled: Flag) -> StepPlaces:
    """Values at the start of each step from those in mid-steps, of what has no jumps.

    What has not settled does not close: at its seam the value of the nearest mid-step stands.
    """
    around = lambda x, by: jnp.roll(x, -by, axis=0)
    near = [around(lengths, by) for by in (-2, -1, 0, 1)]
    # From the start of a step to the two mid-steps before and the two behind it.
    away = jnp.stack(
        [-near[1] - 0.5 * near[0], -0.5 * near[1], 0.5 * near[2], near[2] + 0.5 * near[3]]
    )
    own = jnp.eye(4, dtype=bool)[:, :, None]
    apart = jnp.where(own, 1.0, away[:, None] - away[None, :])
    shares = jnp.prod(jnp.where(own, 1.0, -away[None, :] / apart), axis=1)
    found = sum(shares[i][:, None] * around(middles, i - 2) for i in range(4))
    step = jnp.arange(lengths.size)
    seam = (step < 2) | (step == lengths.size - 1)
    return jnp.where((seam & ~settled)[:, None], middles, found)


def line_loads(dynamics: PairDynamics, force: StepCells) -> Reals:
    """Line load of the drive flanks' cells at each step, as `line_load` has it [N/m]."""
    lines = dynamics.cycle.cells.lines
    shape = lines.roll.shape[1:]
    each = force[:, : shape[0] * shape[1]].reshape(-1, *lines.roll.shape)
    length = jnp.where(lines.fraction >= 0.5, lines.fraction * lines.length, jnp.inf)
    return each / length[None, :, :, :]
