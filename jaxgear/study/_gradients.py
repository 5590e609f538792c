"""Every derivative of a scene's responses, three ways: forward, reverse, central differences."""

import dataclasses
from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxgear._contact._cells import at_line_loads, flank_coordinates, nominal_line_load
from jaxgear._dynamics._cell_forces import cell_forces
from jaxgear._dynamics._folds import condition
from jaxgear._dynamics._harmonic import Balance, HarmonicBalance, balance_of
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._table import END, MIDDLE, START, mesh_at
from jaxgear._dynamics._types import Terms
from jaxgear._flank._deviations import (
    AbstractFlankDeviation,
    EndRelief,
    RootRelief,
    Superposed,
    TipRelief,
)
from jaxgear._flank._measured import MeasuredProfile, MeasuredTopography
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._response._dynamic import (
    bearing_loads,
    dynamic_transmission_error,
    orbit_rms,
    order_amplitudes,
    smooth_dynamic_ratio,
)
from jaxgear._response._factors import smooth_face_load_factor
from jaxgear._response._loads import hertz_pressure
from jaxgear._response._transmission import (
    cycle_mean,
    cycle_variance,
    smooth_peak_to_peak,
    transmission_error,
)
from jaxgear._smooth import smooth_maximum
from jaxgear._solve._cycle import MeshCycle, mesh_cycle
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft
from jaxgear._system._structure import bearing_motion
from jaxgear._types import Flag, Flags, LineGrid, Reals, Scalar
from jaxgear._units import MPa, um
from jaxgear.scene._build import grid_of, model_of, shared_places
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import split_entry
from jaxgear.study._dynamics import (
    MOST_UNKNOWNS,
    dynamic_grid_of,
    dynamics_of,
    size_of,
    speeds_of,
    unknowns_of,
)
from jaxgear.study._running import timed
from jaxgear.study._statics import require_solved

RESPONSES = (
    "te_mean_um",
    "te_variance_um2",
    "smooth_te_range_um",
    "smooth_max_pressure_MPa",
    "smooth_face_load_factor",
)
# Of a pair on shafts: sum of squares over bearings and directions, at the mean mesh load.
ON_BEARINGS = ("bearing_displacement_squared_um2", "bearing_load_squared_N2")

# Of a steady response: the force is the root of the sum of squares over bearings and directions
# of the amplitudes at the mesh frequency, for a pair on shafts.
IN_MOTION = ("te_rms_dynamic_um", "smooth_dynamic_ratio")
BEARINGS_IN_MOTION = ("bearing_force_order_1_N",)
SPEED = "sweep.pinion_speed_rad_s"

# Widths of the smooth maxima, as the optimiser's: of the pressure [Pa], of the range of the
# transmission error [um], of the load per face width over its mean [-], of the mesh force over
# the static one [-].
_PRESSURE_WIDTH = 5.0 * MPa
_RANGE_WIDTH = 0.02
_FACE_WIDTH = 0.01
_RATIO_WIDTH = 0.02

# Relative error that a derivative may have against central differences, and below which share
# of the response over the step's scale it counts as none.
_TOLERANCE = 1e-6
# Rounding in the difference is about 1e-10 of the response over the step's scale: derivatives below
# this share of it can't be told to the tolerance.
_FLOOR = 1e-3
_NO_EFFECT = 1e-12

# Of a steady response, which is as much more sensitive as it is close to a resonance. Below the
# condition it is at a fold, or so close that it has no useful derivative.
_DYNAMIC_TOLERANCE = 1e-5
# Modes of nearly the same frequency, as of equal bearings along S and T, round to about 1e-8.
_DYNAMIC_FLOOR = 1e-2
_LEAST_CONDITION = 1e-2
_SETTLED = 1e-12

# The backward pass through all of the geometry is thousands of scalar operations. Fusing them
# takes XLA ten times longer than all the rest, for a program that runs once.
_UNFUSED = (("xla_disable_hlo_passes", "fusion"),)


@dataclasses.dataclass(frozen=True)
class GradientRow:
    """One response differentiated by one key.

    **Fields:**

    - `response`: name, with its unit.
    - `key`: dotted path, with its unit.
    - `forward`, `reverse`, `difference`: the derivative in units of response per unit of key.
    - `error`: largest relative deviation of the first two from the third.
    - `verdict`: `ok`, `no effect`, `shares a place` (of a point on a shaft, which moves with
      another one), `set changes` (contact or relief is not the same on both
      sides of the difference, which then proves nothing) or `WRONG`; of a steady response
      `ok to 1e-5` and `WRONG at 1e-5`.
    """

    response: str
    key: str
    forward: float
    reverse: float
    difference: float
    error: float
    verdict: str


def gradient_table(scene: Scene, law: AbstractContactLaw) -> list[GradientRow]:
    """Compare the derivatives of a scene's responses by all of its real keys.

    **Arguments:**

    - `scene`: where the derivatives are taken.
    - `law`: contact law.

    **Returns:**

    One row per response and key.

    **Raises:**

    - `SolverFailure` if a phase was not solved at the scene itself.
    """
    keys = scene.real_keys()
    base = model_of(scene)
    grid = grid_of(scene, base)
    on_shafts = any(isinstance(x, Shaft) for x in (base.pinion_support, base.wheel_support))
    names = RESPONSES + ON_BEARINGS if on_shafts else RESPONSES
    centre = jnp.asarray([scene[key] for key in keys], dtype=float)
    sizes = np.asarray([_size(key, float(scene[key])) for key in keys])

    def evaluate(values: Reals) -> tuple[Reals, tuple[Reals, Flags]]:
        model = model_of(scene.replace(dict(zip(keys, values, strict=True))))
        cycle = mesh_cycle(model, grid, law=law, throw=False)
        responses = _responses(model, cycle, law)
        if on_shafts:
            responses += _bearing_responses(cycle)
        return jnp.stack(responses), (_pieces(model, cycle, law), cycle.converged)

    def derivatives(values: Reals) -> tuple[Reals, Reals, Reals, tuple[Reals, Flags]]:
        # One column, or one row, after the other: batched they take far longer to compile. Both
        # directions share one linearisation, and with it the solution of the contact.
        value, push, state = jax.linearize(evaluate, values, has_aux=True)
        pull = jax.linear_transpose(push, values)
        columns = jax.lax.map(push, jnp.eye(len(keys)))
        rows = jax.lax.map(lambda weights: pull(weights)[0], jnp.eye(len(names)))
        return columns.T, rows, value, state

    forward, reverse, value, (pieces, converged) = timed(derivatives, centre, options=_UNFUSED)
    require_solved(converged)
    forward, reverse = np.asarray(forward), np.asarray(reverse)
    difference, same = _differences(evaluate, np.asarray(centre), sizes, pieces)
    shared = shared_places(scene, base)
    table = [
        _row(
            response,
            key,
            forward[i, j],
            reverse[i, j],
            difference[j, i],
            scale=abs(float(value[i])) / sizes[j],
            same=bool(same[j, i]),
        )
        for i, response in enumerate(names)
        for j, key in enumerate(keys)
    ]
    return [
        dataclasses.replace(row, verdict="shares a place")
        if row.key in shared and row.verdict == "no effect"
        else row
        for row in table
    ]


@dataclasses.dataclass(frozen=True)
class SteadyPoint:
    """The steady response that is differentiated, or why none is.

    **Fields:**

    - `contact`: name of the contact law.
    - `speed_rad_s`: of the pinion, the middle one of [sweep].
    - `residual`: imbalance of the harmonics, in static deflections.
    - `condition`: 1 for a linear system, 0 at a fold.
    - `verdict`: `ok`, `not settled`, `near a fold`, or `too many unknowns` (a cycle of many mesh
      periods is too long for harmonic balance).
    """

    contact: str
    speed_rad_s: float
    residual: float | None
    condition: float | None
    verdict: str


def dynamic_table(
    scene: Scene,
    laws: Mapping[str, AbstractContactLaw],
    only: tuple[str, ...] | None = None,
) -> tuple[list[tuple[str, GradientRow]], list[SteadyPoint]]:
    """Compare the derivatives of a steady response by all real keys, damping and speed.

    Harmonic balance at the middle speed of the scene. What is built of the keys, and the response
    of what is built, are differentiated one after the other, and chained.

    **Arguments:**

    - `scene`: with a table [sweep].
    - `laws`: contact laws and their names.
    - `only`: keys beside the speed; without it all real ones, and those of the damping.

    **Returns:**

    For each law one row per response and key, unless its point says why there is none; and the
    points.

    **Raises:**

    - `SolverFailure` if a phase was not solved at the scene itself.
    """
    speeds = speeds_of(scene)
    speed = float(speeds[len(speeds) // 2])
    base = model_of(scene)
    grid = dynamic_grid_of(scene, base)
    keys = scene.real_keys() + _damping_keys(scene) if only is None else only
    centre = np.asarray([scene[key] for key in keys] + [speed], dtype=float)
    sizes = np.asarray([_size(key, float(scene[key])) for key in keys] + [speed])

    def build(values: Reals) -> tuple[PairModel, PairDynamics]:
        changed = scene.replace(dict(zip(keys, values, strict=True)))
        model = model_of(changed)
        return model, dynamics_of(changed, model, grid)

    def flat(values: Reals) -> tuple[Reals, PairDynamics]:
        dynamics = build(values)[1]
        return ravel_pytree(eqx.filter(_moving(dynamics), eqx.is_inexact_array))[0], dynamics

    def linearised(values: Reals, weights: Reals) -> tuple[Reals, PairDynamics, Reals, Reals]:
        # As in `gradient_table`: both directions share one linearisation.
        value, push, dynamics = jax.linearize(flat, values, has_aux=True)
        pull = jax.linear_transpose(push, values)
        columns = jax.lax.map(push, jnp.eye(len(keys)))
        return value, dynamics, columns, jax.lax.map(lambda row: pull(row)[0], weights)

    own = jnp.asarray(centre[:-1])
    shape, still = jax.eval_shape(flat, own)
    names = _dynamic_names(still)
    # The weights follow from the response, and that from what is built: the program runs twice.
    weights = jnp.zeros((len(laws) * len(names), *shape.shape))
    value, dynamics, columns, _ = timed(linearised, own, weights, options=_UNFUSED)
    require_solved(dynamics.cycle.converged)
    if unknowns_of(scene, size_of(dynamics)) > MOST_UNKNOWNS:
        return [], [SteadyPoint(name, speed, None, None, "too many unknowns") for name in laws]
    methods = {name: _method(scene, dynamics, law) for name, law in laws.items()}
    found = {
        name: timed(_steady_derivatives(method), value, jnp.asarray(speed), dynamics, columns)
        for name, method in methods.items()
    }
    points = [_steady_point(name, speed, each[-1]) for name, each in found.items()]
    good = [point.contact for point in points if point.verdict == "ok"]
    if not good:
        return [], points

    def evaluate(values: Reals) -> tuple[Reals, tuple[Reals, Flags]]:
        model, dynamics = build(values[:-1])
        numbers, pieces = [], [_pieces(model, dynamics.cycle, ExactContact())]
        for name in good:
            orbit, terms, balance = _solved(methods[name], dynamics, values[-1])
            numbers += _dynamic_responses(dynamics, orbit, methods[name].law)
            pieces.append(_closed(balance, orbit, terms))
        return jnp.stack(numbers), (jnp.concatenate(pieces), dynamics.cycle.converged)

    rows = jnp.concatenate([found[name][2] for name in good])
    weights = weights.at[: len(rows)].set(rows)
    reverse = np.asarray(timed(linearised, own, weights, options=_UNFUSED)[-1])
    difference, same = _differences(
        evaluate, centre, sizes, None, steps=_DYNAMIC_STEPS, most=_FEWER
    )
    shared = shared_places(scene, base)
    table = []
    for place, name in enumerate(good):
        numbers, forward, by_speed = (np.asarray(found[name][k]) for k in (0, 1, 3))
        for i, response in enumerate(names):
            row = place * len(names) + i
            for j, key in enumerate((*keys, SPEED)):
                last = j == len(keys)
                judged = _row(
                    response,
                    key,
                    forward[j, i],
                    by_speed[i] if last else reverse[row, j],
                    difference[j, row],
                    scale=abs(float(numbers[i])) / sizes[j],
                    same=bool(same[j, row]),
                    tolerance=_DYNAMIC_TOLERANCE,
                    floor=_DYNAMIC_FLOOR,
                )
                table.append((name, _worded(judged, shared)))
    return table, points


# Points of a difference in one call, each with a pair in motion; longer steps, because the rounding
# of modes and harmonics is larger than that of statics.
_FEWER = 60
_DYNAMIC_STEPS = (4e-4, 1e-4, 2e-5)


def _worded(row: GradientRow, shared: Mapping[str, str]) -> GradientRow:
    """The row of a steady response with a verdict that says how close is close enough."""
    words = {"ok": "ok to 1e-5", "WRONG": "WRONG at 1e-5"}
    if row.key in shared:
        words["no effect"] = "shares a place"
    return dataclasses.replace(row, verdict=words.get(row.verdict, row.verdict))


def _damping_keys(scene: Scene) -> tuple[str, ...]:
    """The damping that a scene has."""
    modal = scene["damping.kind"] == "modal"
    return tuple(
        f"damping.{key}" for key in (("mesh", "structure") if modal else ("a_R_1_s", "b_R_s"))
    )


def _moving(dynamics: PairDynamics) -> tuple:
    """The parts of a pair that steady responses are found from."""
    return dynamics.system, dynamics.cycle.system.structure


def _method(scene: Scene, dynamics: PairDynamics, law: AbstractContactLaw) -> HarmonicBalance:
    """Harmonic balance of a scene; exact contact averaged over time steps, as when optimising."""
    averaged = isinstance(law, ExactContact) and dynamics.system.cell_damping is None
    return HarmonicBalance(
        law=law, harmonics=scene["sweep.harmonics"], averaged=averaged, tolerance=_SETTLED
    )


def _solved(
    method: HarmonicBalance, dynamics: PairDynamics, speed: Scalar
) -> tuple[Orbit, Terms, Balance]:
    """A steady response, its harmonics, and the balance that they are in."""
    balance = balance_of(method, dynamics.system)
    return *method.solve(balance, speed), balance


def _dynamic_names(dynamics: PairDynamics) -> tuple[str, ...]:
    return IN_MOTION + (BEARINGS_IN_MOTION if _has_bearings(dynamics) else ())


def _has_bearings(dynamics: PairDynamics) -> bool:
    return bool(dynamics.cycle.system.structure.map.bearings)


def _dynamic_responses(
    dynamics: PairDynamics, orbit: Orbit, law: AbstractContactLaw
) -> list[Scalar]:
    """The responses of a steady response, in the units of their names."""
    system = dynamics.system
    error = dynamic_transmission_error(system, orbit)
    found = [
        orbit_rms(system, error) / um,
        smooth_dynamic_ratio(system, orbit, jnp.asarray(_RATIO_WIDTH), law),
    ]
    if _has_bearings(dynamics):
        order = order_amplitudes(system, bearing_loads(dynamics, orbit), 1)[0]
        found.append(jnp.sqrt(jnp.sum(order[:, :3] ** 2)))
    return found


def _steady_derivatives(method: HarmonicBalance) -> Callable:
    """A function of what was built, its speed and its tangents, for derivatives of the response.

    It returns the responses; their derivatives by each tangent and by the speed, one row each;
    their derivatives by what was built, and by the speed; and what to judge the response by.
    """

    def derivatives(flat: Reals, speed: Scalar, dynamics: PairDynamics, columns: Reals):
        real, other = eqx.partition(_moving(dynamics), eqx.is_inexact_array)
        unravel = ravel_pytree(real)[1]

        def respond(flat: Reals, speed: Scalar) -> tuple[Reals, tuple[Orbit, Terms]]:
            moved = eqx.tree_at(_moving, dynamics, eqx.combine(unravel(flat), other))
            orbit, terms, _ = _solved(method, moved, speed)
            return jnp.stack(_dynamic_responses(moved, orbit, method.law)), (orbit, terms)

        value, push, (orbit, terms) = jax.linearize(respond, flat, speed, has_aux=True)
        pull = jax.linear_transpose(push, flat, speed)
        still = jnp.zeros(())
        forward = jax.lax.map(lambda column: push(column, still), columns)
        by_speed = push(jnp.zeros_like(flat), jnp.ones(()))
        rows, speeds = jax.lax.map(pull, jnp.eye(value.size))
        apart = condition(balance_of(method, dynamics.system), terms, speed)
        forward = jnp.concatenate([forward, by_speed[None]])
        return value, forward, rows, speeds, (orbit.residual, orbit.settled, apart)

    return derivatives


def _steady_point(contact: str, speed: float, seen: tuple[Scalar, Flag, Scalar]) -> SteadyPoint:
    """Judge whether a response has useful derivatives."""
    residual, settled, apart = (float(x) for x in seen)
    verdict = "ok" if apart >= _LEAST_CONDITION else "near a fold"
    finite = lambda x: x if np.isfinite(x) else None
    return SteadyPoint(
        contact, speed, finite(residual), finite(apart), verdict if settled else "not settled"
    )


def _closed(balance: Balance, orbit: Orbit, terms: Terms) -> Reals:
    """Whether each cell is closed, wherever in time contact is evaluated [-]."""
    table = balance.system.table
    if len(balance.times) == 1:
        at = [(MIDDLE, orbit.place)]
    else:
        ends = zip((START, END), balance.times, strict=True)
        at = [(part, values @ terms.T) for part, values in ends]
    law = balance.law
    overlap = lambda mesh, place: cell_forces(mesh, place, law)[1]
    found = jnp.stack([jax.vmap(overlap)(mesh_at(table, part), place) for part, place in at])
    if isinstance(law, SmoothContact):
        return (jnp.sign(found + law.width) + jnp.sign(found - law.width)).ravel()
    return (found > 0.0).astype(float).ravel()


def _responses(model: PairModel, cycle: MeshCycle, law: AbstractContactLaw) -> list[Scalar]:
    """The responses of every pair, in the units of their names."""
    error = transmission_error(model.pair, cycle) / um
    pressure = hertz_pressure(model.pair, cycle, law)
    return [
        cycle_mean(cycle, error),
        cycle_variance(cycle, error),
        smooth_peak_to_peak(error, jnp.asarray(_RANGE_WIDTH)),
        smooth_maximum(pressure, jnp.asarray(_PRESSURE_WIDTH)) / MPa,
        smooth_face_load_factor(cycle, jnp.asarray(_FACE_WIDTH)),
    ]


def _bearing_responses(cycle: MeshCycle) -> list[Scalar]:
    """The responses of the bearings, in the units of their names; translations and forces only."""
    mean = cycle.cells.lines.weight @ cycle.load
    system = cycle.system
    motion = bearing_motion(system.structure, system.displacement(mean[None])[0])
    return [
        jnp.sum((motion.displacement[:, :3] / um) ** 2),
        jnp.sum(motion.load[:, :3] ** 2),
    ]


# What counts as a change of order one of a key whose value is 0, by its unit; the longest ending
# first, and 1 without any of these.
_USUAL = {"_N_m": 1e6, "_Nm_rad": 1e3, "_um": 10.0, "_N": 100.0}


def _size(key: str, value: float) -> float:
    """What counts as a change of order one of a key: its value, or what is usual where it is 0."""
    name = split_entry(key)[0]
    usual = next((size for ending, size in _USUAL.items() if name.endswith(ending)), 1.0)
    return abs(value) or usual


# Steps of the differences over the size of the key. A long step has little rounding, a short
# one is less likely to straddle the edge between two pieces of a formula.
_STEPS = (1e-4, 2e-5, 4e-6)

# Points in one call of the compiled program.
_CHUNK = 240


def _differences(
    evaluate: Callable[[Reals], tuple[Reals, tuple[Reals, Flags]]],
    centre: np.ndarray,
    sizes: np.ndarray,
    pieces: Reals | None,
    *,
    steps: tuple[float, ...] = _STEPS,
    most: int = _CHUNK,
) -> tuple[np.ndarray, np.ndarray]:
    """Extrapolated central differences, and whether both sides use the same pieces as the centre.

    Of three steps the one counts whose two estimates, with h and with h/2, agree best. Without the
    `pieces` of the centre they are found too; `most` points are in one call.
    """

    def compared(point: Reals, pieces: Reals) -> tuple[Reals, Flag]:
        responses, (own, _) = evaluate(point)
        return responses, jnp.all(own == pieces)

    def chunk(points: Reals, pieces: Reals | None) -> tuple[Reals, Flags]:
        if pieces is not None:
            return jax.lax.map(lambda point: compared(point, pieces), points)
        both = jnp.concatenate([jnp.asarray(centre)[None], points])
        responses, (own, _) = jax.lax.map(evaluate, both)
        return responses[1:], jnp.all(own[1:] == own[:1], axis=1)

    shifts = np.outer(steps, [1.0, -1.0, 0.5, -0.5]).ravel()
    points = (centre + shifts[:, None, None] * np.diag(sizes)).reshape(-1, len(centre))
    size = min(most, len(points))
    padded = np.pad(points, ((0, -len(points) % size), (0, 0)), mode="edge")
    parts = [
        timed(chunk, jnp.asarray(part), pieces) for part in padded.reshape(-1, size, len(centre))
    ]
    around, same = (np.concatenate(x)[: len(points)] for x in zip(*parts, strict=True))
    shape = (len(steps), 4, len(centre))
    around, same = around.reshape(*shape, -1), np.all(same.reshape(shape), axis=1)
    step = np.asarray(steps)[:, None, None] * sizes[:, None]
    coarse = (around[:, 0] - around[:, 1]) / (2.0 * step)
    fine = (around[:, 2] - around[:, 3]) / step
    best = np.argmin(np.abs(fine - coarse), axis=0)[None]
    estimate = np.take_along_axis((4.0 * fine - coarse) / 3.0, best, axis=0)[0]
    unchanged = np.take_along_axis(
        np.broadcast_to(np.expand_dims(same, 2), fine.shape), best, axis=0
    )[0]
    return estimate, unchanged


def _pieces(model: PairModel, cycle: MeshCycle, law: AbstractContactLaw) -> Reals:
    """Which piece of each piecewise formula is in use at each cell."""
    lines = cycle.cells.lines
    overlap = cycle.overlap.reshape(lines.roll.shape)
    if isinstance(law, SmoothContact):
        contact = jnp.sign(overlap + law.width) + jnp.sign(overlap - law.width)
    else:
        contact = (overlap > 0.0).astype(float)
    fraction = jnp.sign(lines.fraction - 1e-9) + jnp.sign(lines.fraction - 1.0 + 1e-9)
    in_mesh = fraction > -1.5
    # The ends of the path: where stiffness and pressure stay constant, and corners touch.
    end = jnp.sign(lines.roll - model.pair.path_start) + jnp.sign(lines.roll - model.pair.path_end)
    inside = [contact, end]
    for flank, place in zip(
        (model.flanks.pinion, model.flanks.wheel),
        flank_coordinates(model.pair, lines),
        strict=True,
    ):
        for part in flank.parts if isinstance(flank, Superposed) else (flank,):
            inside += _pieces_of_flank(part, *place)
    if model.compliance.load_updates:
        inside.append(_above_least_load(model, cycle))
    parts = [fraction + jnp.sign(lines.fraction - 0.5)]
    parts += [jnp.where(in_mesh, part, 0.0) for part in inside]
    if cycle.cells.coupling is not None:
        # Of two lines of a slice, the longer contact counts.
        parts += [jnp.sign(_unlike(lines.fraction, apart)) for apart in range(1, in_mesh.shape[1])]
    narrower = jnp.sign(model.pair.pinion.face_width - model.pair.wheel.face_width)
    return jnp.append(jnp.stack(parts).ravel(), narrower)


def _unlike(fraction: LineGrid, apart: int) -> LineGrid:
    """Difference of the fractions of two lines, as far as neither is full [-]."""
    other = jnp.roll(fraction, apart, axis=1)
    difference = fraction - other
    return jnp.where(jnp.abs(difference) > 1e-12, difference, 0.0)


def _pieces_of_flank(part: AbstractFlankDeviation, profile: Reals, face: Reals) -> list[Reals]:
    """Which piece of a flank deviation is in use at each cell; none of one that is smooth."""
    match part:
        case TipRelief() | RootRelief() | EndRelief():
            # Where it acts does not depend on how deep it is, not even at depth zero.
            one = eqx.tree_at(lambda p: p.depth, part, jnp.ones(()))
            return [(one(profile, face) != 0.0).astype(float)]
        case MeasuredProfile():
            return [_interval(part.place, profile)]
        case MeasuredTopography():
            return [_interval(part.place, profile), _interval(part.face, face)]
    return []


def _interval(points: Reals, place: Reals) -> Reals:
    """Number of points of a table before each place [-]."""
    return jnp.searchsorted(points, place, side="right").astype(float)


def _above_least_load(model: PairModel, cycle: MeshCycle) -> LineGrid:
    """Whether a cell's stiffness follows its line load [-]; below a least load it is constant."""
    nominal = nominal_line_load(model.pair, model.mesh_torque)
    softening = model.compliance.log_slope(model.pair)
    loaded, least = (
        at_line_loads(cycle.cells, force, nominal, softening).line_stiffness
        for force in (cycle.force, jnp.zeros_like(cycle.force))
    )
    return (loaded > least).astype(float)


def _row(
    response: str,
    key: str,
    forward: float,
    reverse: float,
    difference: float,
    *,
    scale: float,
    same: bool,
    tolerance: float = _TOLERANCE,
    floor: float = _FLOOR,
) -> GradientRow:
    """Judge one derivative against `scale`, the response over the size of the key."""
    largest = max(abs(forward), abs(reverse), abs(difference))
    error = max(abs(forward - difference), abs(reverse - difference)) / max(largest, floor * scale)
    if not np.isfinite([forward, reverse, difference]).all():
        verdict = "WRONG"
    elif largest <= _NO_EFFECT * scale:
        verdict = "no effect"
    elif error <= tolerance:
        verdict = "ok"
    else:
        verdict = "WRONG" if same else "set changes"
    return GradientRow(
        response=response,
        key=key,
        forward=float(forward),
        reverse=float(reverse),
        difference=float(difference),
        error=float(error),
        verdict=verdict,
    )
