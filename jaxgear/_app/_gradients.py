"""Every derivative of a scene's responses, three ways: forward, reverse, central differences."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._app._model import grid_of, model_of, shared_places
from jaxgear._app._scene import Scene
from jaxgear._app._schema import split_entry
from jaxgear._app._statics import Stopwatch, require_solved
from jaxgear._contact._cells import at_line_loads, flank_coordinates, nominal_line_load
from jaxgear._flank._deviations import (
    AbstractFlankDeviation,
    EndRelief,
    RootRelief,
    Superposed,
    TipRelief,
)
from jaxgear._flank._measured import MeasuredProfile, MeasuredTopography
from jaxgear._interface._laws import AbstractContactLaw, SmoothContact
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

RESPONSES = (
    "te_mean_um",
    "te_variance_um2",
    "smooth_te_range_um",
    "smooth_max_pressure_MPa",
    "smooth_face_load_factor",
)
# Of a pair on shafts: sum of squares over bearings and directions, at the mean mesh load.
ON_BEARINGS = ("bearing_displacement_squared_um2", "bearing_load_squared_N2")

# Widths of the smooth maxima, as the optimiser's: of the pressure [Pa], of the range of the
# transmission error [um], of the load per face width over its mean [-].
_PRESSURE_WIDTH = 5.0 * MPa
_RANGE_WIDTH = 0.02
_FACE_WIDTH = 0.01

# Relative error that a derivative may have against central differences, and below which share
# of the response over the step's scale it counts as none.
_TOLERANCE = 1e-6
_NO_EFFECT = 1e-12


# The backward pass through all of the geometry is thousands of scalar operations. Fusing them
# takes XLA ten times longer than all the rest, for a program that runs once.
_UNFUSED = {"xla_disable_hlo_passes": "fusion"}


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
      sides of the difference, which then proves nothing) or `WRONG`.
    """

    response: str
    key: str
    forward: float
    reverse: float
    difference: float
    error: float
    verdict: str


def gradient_table(scene: Scene, law: AbstractContactLaw, watch: Stopwatch) -> list[GradientRow]:
    """Compare the derivatives of a scene's responses by all of its real keys.

    **Arguments:**

    - `scene`: where the derivatives are taken.
    - `law`: contact law.
    - `watch`: keeps the time.

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

    forward, reverse, value, (pieces, converged) = watch(derivatives, centre, options=_UNFUSED)
    require_solved(converged)
    forward, reverse = np.asarray(forward), np.asarray(reverse)
    difference, same = _differences(evaluate, np.asarray(centre), sizes, pieces, watch)
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
    pieces: Reals,
    watch: Stopwatch,
) -> tuple[np.ndarray, np.ndarray]:
    """Extrapolated central differences, and whether both sides use the same pieces as the centre.

    Of three steps the one counts whose two estimates, with h and with h/2, agree best.
    """

    def compared(point: Reals, pieces: Reals) -> tuple[Reals, Flag]:
        responses, (own, _) = evaluate(point)
        return responses, jnp.all(own == pieces)

    def chunk(points: Reals, pieces: Reals) -> tuple[Reals, Flags]:
        return jax.lax.map(lambda point: compared(point, pieces), points)

    shifts = np.outer(_STEPS, [1.0, -1.0, 0.5, -0.5]).ravel()
    points = (centre + shifts[:, None, None] * np.diag(sizes)).reshape(-1, len(centre))
    size = min(_CHUNK, len(points))
    padded = np.pad(points, ((0, -len(points) % size), (0, 0)), mode="edge")
    parts = [
        watch(chunk, jnp.asarray(part), pieces) for part in padded.reshape(-1, size, len(centre))
    ]
    around, same = (np.concatenate(x)[: len(points)] for x in zip(*parts, strict=True))
    shape = (len(_STEPS), 4, len(centre))
    around, same = around.reshape(*shape, -1), np.all(same.reshape(shape), axis=1)
    step = np.asarray(_STEPS)[:, None, None] * sizes[:, None]
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
) -> GradientRow:
    """Judge one derivative against `scale`, the response over the size of the key."""
    largest = max(abs(forward), abs(reverse), abs(difference))
    # Rounding in the difference is about 1e-10 of `scale`: smaller derivatives can't be told.
    error = max(abs(forward - difference), abs(reverse - difference)) / max(largest, 1e-3 * scale)
    if not np.isfinite([forward, reverse, difference]).all():
        verdict = "WRONG"
    elif largest <= _NO_EFFECT * scale:
        verdict = "no effect"
    elif error <= _TOLERANCE:
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
