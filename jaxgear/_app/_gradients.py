"""Every derivative of a scene's responses, three ways: forward, reverse, central differences."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._app._model import grid_of, model_of
from jaxgear._app._scene import Scene
from jaxgear._app._statics import Stopwatch, require_solved
from jaxgear._contact._cells import flank_coordinates
from jaxgear._flank._deviations import Superposed
from jaxgear._interface._laws import AbstractContactLaw, SmoothContact
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
from jaxgear._types import Flags, Reals
from jaxgear._units import MPa, um

RESPONSES = ("te_mean_um", "te_variance_um2", "smooth_te_range_um", "smooth_max_pressure_MPa")

# Width of the smooth maximum of the pressure [Pa], as the optimiser's.
_PRESSURE_WIDTH = 5.0 * MPa
# And of the range of the transmission error [um].
_RANGE_WIDTH = 0.02

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
    - `verdict`: `ok`, `no effect`, `set changes` (contact or relief is not the same on both
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
    grid = grid_of(scene, model_of(scene))
    centre = jnp.asarray([scene[key] for key in keys], dtype=float)
    sizes = np.asarray([_size(key, float(scene[key])) for key in keys])

    def evaluate(values: Reals) -> tuple[Reals, tuple[Reals, Flags]]:
        model = model_of(scene.replace(dict(zip(keys, values, strict=True))))
        cycle = mesh_cycle(model, grid, law=law, throw=False)
        error = transmission_error(model.pair, cycle) / um
        pressure = hertz_pressure(model.pair, cycle, law)
        responses = jnp.stack(
            [
                cycle_mean(cycle, error),
                cycle_variance(cycle, error),
                smooth_peak_to_peak(error, jnp.asarray(_RANGE_WIDTH)),
                smooth_maximum(pressure, jnp.asarray(_PRESSURE_WIDTH)) / MPa,
            ]
        )
        pieces = _pieces(model, cycle, law)
        return responses, (pieces, cycle.converged)

    def responses_at(values: Reals) -> Reals:
        return evaluate(values)[0]

    def derivatives(values: Reals) -> tuple[Reals, Reals]:
        # One column, or one row, after the other: batched they take far longer to compile.
        _, pull = jax.vjp(responses_at, values)
        columns = jax.lax.map(
            lambda along: jax.jvp(responses_at, (values,), (along,))[1], jnp.eye(len(keys))
        )
        rows = jax.lax.map(lambda weights: pull(weights)[0], jnp.eye(len(RESPONSES)))
        return columns.T, rows

    value, (pieces, converged) = watch(evaluate, centre)
    require_solved(converged)
    forward, reverse = map(np.asarray, watch(derivatives, centre, options=_UNFUSED))
    difference, same = _differences(evaluate, np.asarray(centre), sizes, np.asarray(pieces), watch)
    return [
        _row(
            response,
            key,
            forward[i, j],
            reverse[i, j],
            difference[j, i],
            scale=abs(float(value[i])) / sizes[j],
            same=bool(same[j, i]),
        )
        for i, response in enumerate(RESPONSES)
        for j, key in enumerate(keys)
    ]


def _size(key: str, value: float) -> float:
    """What counts as a change of order one of a key: its value, or what is usual where it is 0."""
    return abs(value) or (10.0 if key.endswith("_um") else 1.0)


# Steps of the differences over the size of the key. A long step has little rounding, a short
# one is less likely to straddle the edge between two pieces of a formula.
_STEPS = (1e-4, 2e-5, 4e-6)


def _differences(
    evaluate: Callable[[Reals], tuple[Reals, tuple[Reals, Flags]]],
    centre: np.ndarray,
    sizes: np.ndarray,
    pieces: np.ndarray,
    watch: Stopwatch,
) -> tuple[np.ndarray, np.ndarray]:
    """Extrapolated central differences, and whether both sides use the same pieces as the centre.

    Of three steps the one counts whose two estimates, with h and with h/2, agree best.
    """
    shifts = np.outer(_STEPS, [1.0, -1.0, 0.5, -0.5]).ravel()
    points = centre + shifts[:, None, None] * np.diag(sizes)
    shape = (len(_STEPS), 4, len(centre))
    around, (sides, _) = watch(
        lambda batch: jax.lax.map(evaluate, batch), jnp.asarray(points.reshape(-1, len(centre)))
    )
    around = np.asarray(around).reshape(*shape, -1)
    same = np.all(np.asarray(sides) == pieces, axis=1).reshape(shape).all(axis=1)
    step = np.asarray(_STEPS)[:, None, None] * sizes[:, None]
    coarse = (around[:, 0] - around[:, 1]) / (2.0 * step)
    fine = (around[:, 2] - around[:, 3]) / step
    best = np.argmin(np.abs(fine - coarse), axis=0)[None]
    estimate = np.take_along_axis((4.0 * fine - coarse) / 3.0, best, axis=0)[0]
    unchanged = np.take_along_axis(np.broadcast_to(same[:, :, None], fine.shape), best, axis=0)[0]
    return estimate, unchanged


def _pieces(model: PairModel, cycle: MeshCycle, law: AbstractContactLaw) -> Reals:
    """Which piece of each piecewise formula is in use at each cell."""
    overlap = cycle.overlap
    if isinstance(law, SmoothContact):
        contact = jnp.sign(overlap + law.width) + jnp.sign(overlap - law.width)
    else:
        contact = (overlap > 0.0).astype(float)
    lines = cycle.cells.lines
    fraction = jnp.sign(lines.fraction - 1e-9) + jnp.sign(lines.fraction - 1.0 + 1e-9)
    in_mesh = (fraction > -1.5).reshape(contact.shape)
    fraction += jnp.sign(lines.fraction - 0.5)
    parts = [jnp.where(in_mesh, contact, 0.0), fraction.reshape(contact.shape)]
    for flank, place in zip(
        (model.flanks.pinion, model.flanks.wheel),
        flank_coordinates(model.pair, lines),
        strict=True,
    ):
        for part in flank.parts if isinstance(flank, Superposed) else (flank,):
            # Where it acts does not depend on how deep it is, not even at depth zero.
            if hasattr(part, "depth"):
                one = eqx.tree_at(lambda p: p.depth, part, jnp.ones(()))
            else:
                one = part
            relieved = (one(*place) != 0.0).astype(float).reshape(contact.shape)
            parts.append(jnp.where(in_mesh, relieved, 0.0))
    narrower = jnp.sign(model.pair.pinion.face_width - model.pair.wheel.face_width)
    return jnp.append(jnp.stack(parts).ravel(), narrower)


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
