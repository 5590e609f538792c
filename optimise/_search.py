"""Searches within a box by gradient. All count whole evaluations, and keep them."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from optimise._record import (
    Box,
    Objective,
    Record,
    Residuals,
    SearchResult,
    ValueAndGradient,
    Watcher,
    with_gradient,
    with_jacobian,
)

# L-BFGS-B knows no scale before its first step, and makes it of length one: in these units.
_FIRST_STEP = 0.1

_SPENT = "the evaluations allowed are spent"


def lbfgs(
    objective: Objective | ValueAndGradient,
    start: np.ndarray,
    box: Box,
    *,
    most_evaluations: int = 50,
    tolerance: float = 1e-6,
    watch: Watcher | None = None,
    file: Path | None = None,
) -> SearchResult:
    """Minimise by SciPy's L-BFGS-B, with gradients from JAX.

    **Arguments:**

    - `objective`: traceable by JAX, of order one near its minimum.
    - `start`: first point; moved into the box.
    - `box`: bounds.
    - `most_evaluations`: of the gradient, about; a line search is finished.
    - `tolerance`: on the largest slope in the unit cube; a thousandth of it on relative progress.
    - `watch`: called after each evaluation.
    - `file`: keeps the evaluations, and has those of a search that was stopped: see `Record`.

    **Returns:**

    The best point and the record of the search.

    **Raises:**

    - `FloatingPointError` if the objective or its gradient is not finite.
    - `ValueError` if the file is of a search in another box.
    """
    record = Record(with_gradient(objective), box, watch, file)

    def stretched(place: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = record(place * _FIRST_STEP)
        return float(value), slope * _FIRST_STEP

    end = scipy.optimize.minimize(
        stretched,
        box.to_unit(np.asarray(start, float)) / _FIRST_STEP,
        jac=True,
        method="L-BFGS-B",
        bounds=[(0.0, 1.0 / _FIRST_STEP)] * len(start),
        options={
            "maxfun": most_evaluations,
            "gtol": tolerance * _FIRST_STEP,
            "ftol": 1e-3 * tolerance,
        },
    )
    # Of L-BFGS-B: 1 is a limit reached.
    reason = _SPENT if end.status == 1 else str(end.message)
    return record.result(converged=bool(end.success), reason=reason)


def adam(
    objective: Objective | ValueAndGradient,
    start: np.ndarray,
    box: Box,
    *,
    most_evaluations: int = 50,
    learning_rate: float = 0.05,
    tolerance: float = 1e-4,
    watch: Watcher | None = None,
    file: Path | None = None,
) -> SearchResult:
    """Minimise by optax's Adam, projected onto the box, with a cosine schedule.

    **Arguments:**

    - `objective`: traceable by JAX.
    - `start`: first point; moved into the box.
    - `box`: bounds.
    - `most_evaluations`: of the gradient; the schedule ends there.
    - `learning_rate`: first step, in unit cubes.
    - `tolerance`: the search has converged if its last tenth moved less than this [unit cubes].
    - `watch`: called after each evaluation.
    - `file`: keeps the evaluations, and has those of a search that was stopped: see `Record`.

    **Returns:**

    The best point and the record of the search.

    **Raises:**

    - `FloatingPointError` if the objective or its gradient is not finite.
    - `ValueError` if the file is of a search in another box.
    """
    # The other searches do without it.
    import optax

    record = Record(with_gradient(objective), box, watch, file)
    optimiser = optax.adam(optax.cosine_decay_schedule(learning_rate, most_evaluations))
    unit = jnp.asarray(box.to_unit(np.asarray(start, float)))
    state = optimiser.init(unit)
    units = [unit]
    for _ in range(most_evaluations):
        _, gradient = record(np.asarray(unit))
        # optax mixes its integer step count with reals.
        with jax.numpy_dtype_promotion("standard"):
            updates, state = optimiser.update(jnp.asarray(gradient), state)
        unit = optax.projections.projection_box(optax.apply_updates(unit, updates), 0.0, 1.0)
        units.append(unit)
    late = np.stack(units[-max(2, most_evaluations // 10) :])
    moved = float(np.max(np.ptp(late, axis=0)))
    converged = moved <= tolerance
    reason = f"end of the schedule; the last tenth moved {moved:.2g} of the box"
    return record.result(converged=converged, reason=reason)


def least_squares(
    residuals: Residuals | ValueAndGradient,
    start: np.ndarray,
    box: Box,
    *,
    most_evaluations: int = 50,
    tolerance: float = 1e-8,
    watch: Watcher | None = None,
    file: Path | None = None,
) -> SearchResult:
    """Minimise a sum of squares by SciPy's trust region for least squares, with JAX's Jacobian.

    Gauss and Newton's way, of Levenberg and Marquardt's kind: the curvature comes from first
    derivatives alone, so that few evaluations suffice where the residuals are nearly linear. That
    of optimistix knows no bounds.

    **Arguments:**

    - `residuals`: traceable by JAX; their squares sum to a number of order one.
    - `start`: first point; moved into the box, a hair off its faces.
    - `box`: bounds.
    - `most_evaluations`: of residuals and Jacobian.
    - `tolerance`: on progress, on steps, and on the largest slope in the unit cube [-].
    - `watch`: called after each evaluation, with the sum of squares.
    - `file`: keeps the evaluations: see `Record`.

    **Returns:**

    The best point and the record of the search; its values are sums of squares.

    **Raises:**

    - `FloatingPointError` if a residual or its gradient is not finite.
    - `ValueError` if the file is of a search in another box.
    """
    told = None if watch is None else lambda point, _: watch(point, squares(record.values[-1]))
    squares = lambda values: float(np.sum(values**2))
    record = Record(with_jacobian(residuals), box, told, file)
    count = len(start)
    # SciPy's own annotations know no function here.
    slopes: Any = lambda unit: record(unit)[1]
    end = scipy.optimize.least_squares(
        lambda unit: record(unit)[0],
        # Its method works inside, never on a face.
        np.clip(box.to_unit(np.asarray(start, float)), 1e-6, 1.0 - 1e-6),
        jac=slopes,
        bounds=(np.zeros(count), np.ones(count)),
        max_nfev=most_evaluations,
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
    )
    numbers = np.asarray([squares(values) for values in record.values])
    reason = str(end.message) if end.status else _SPENT
    return record.result(converged=end.status > 0, reason=reason, numbers=numbers)


class Limit(NamedTuple):
    """A response that must not be above a number.

    **Fields:**

    - `name`: for messages.
    - `most`: what is allowed, in the unit of the response [-].
    - `scale`: by how much counts as one, in that unit [-].
    """

    name: str
    most: float
    scale: float


# Excess of a limit over its scale that counts as none.
KEPT = 1e-4


def excess_of(values: np.ndarray, limits: Sequence[Limit]) -> np.ndarray:
    """By how much responses are above their limits, over the scales of these.

    **Arguments:**

    - `values`: of the responses that have limits, in the order of these along the last axis.
    - `limits`: of each.

    **Returns:**

    The excess, negative below a limit [-].
    """
    most, scale = (np.asarray([getattr(each, k) for each in limits]) for k in ("most", "scale"))
    return (values - most) / scale


def constrained(
    responses: Residuals | ValueAndGradient,
    limits: Sequence[Limit],
    start: np.ndarray,
    box: Box,
    *,
    most_evaluations: int = 100,
    tolerance: float = 1e-6,
    watch: Watcher | None = None,
    file: Path | None = None,
) -> SearchResult:
    """Minimise a response while others stay below limits, by SciPy's SLSQP.

    **Arguments:**

    - `responses`: the number to make small, of order one, and that of each limit; traceable by JAX.
    - `limits`: of all but the first.
    - `start`: first point; moved into the box. It may be beyond limits.
    - `box`: bounds.
    - `most_evaluations`: of responses and Jacobian, about; a line search is finished.
    - `tolerance`: on relative progress [-].
    - `watch`: called after each evaluation.
    - `file`: keeps the evaluations: see `Record`.

    **Returns:**

    The best point within all limits, or if there was none that which exceeds them least; it has
    then not converged, and the reason says which limit by how much.

    **Raises:**

    - `FloatingPointError` if a response or its gradient is not finite.
    - `ValueError` if the file is of a search in another box.
    """
    record = Record(with_jacobian(responses), box, watch, file)
    most, scale = (np.asarray([getattr(each, k) for each in limits]) for k in ("most", "scale"))
    below = lambda unit: (most - record(unit)[0][1:]) / scale

    def objective(unit: np.ndarray) -> float:
        if len(record.points) > most_evaluations:
            raise StopIteration
        return float(record(unit)[0][0])

    try:
        end = scipy.optimize.minimize(
            objective,
            box.to_unit(np.asarray(start, float)),
            jac=lambda unit: record(unit)[1][0],
            method="SLSQP",
            bounds=[(0.0, 1.0)] * len(start),
            constraints={
                "type": "ineq",
                "fun": below,
                "jac": lambda unit: -record(unit)[1][1:] / scale[:, None],
            },
            options={"maxiter": most_evaluations, "ftol": tolerance},
        )
        settled, reason = bool(end.success), str(end.message)
        record(end.x)
    except StopIteration:
        settled, reason = False, _SPENT
    values = np.asarray(record.values)
    excess = excess_of(values[:, 1:], limits)
    worst = np.maximum(excess.max(axis=1), 0.0)
    kept = worst <= KEPT
    # Beyond the limits the least excess is best; among those that keep them, the least value, but
    # for the end of a search that has settled: others would make use of what counts as kept.
    numbers = np.where(kept, values[:, 0], np.inf) if kept.any() else worst
    if settled and kept[-1]:
        numbers = np.where(np.arange(len(numbers)) == len(numbers) - 1, values[:, 0], np.inf)
    found = record.result(converged=settled and bool(kept.any()), reason=reason, numbers=numbers)
    best = int(np.argmin(numbers))
    if not kept.any():
        reason = _none_keeps(limits, excess[best])
    return dataclasses.replace(
        found, value=float(values[best, 0]), values=values[:, 0], reason=reason
    )


def _none_keeps(limits: Sequence[Limit], excess: np.ndarray) -> str:
    """The limit that the best of all points exceeds most."""
    limit = limits[int(np.argmax(excess))]
    return (
        f"no point keeps all limits: {limit.name} is above {limit.most:g} by "
        f"{excess.max() * limit.scale:.3g} at the best. Allow more, or widen the bounds"
    )
