"""Searches within a box, by gradient and without. All start from, and count, whole evaluations."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import scipy.optimize
from jaxtyping import Array, Float

Objective = Callable[[Float[Array, " variable"]], Float[Array, ""]]
# Called with the point and the value after each evaluation of the gradient.
Watcher = Callable[[np.ndarray, float], None]


class Box(eqx.Module):
    """Bounds of the variables; they are also their scales.

    **Fields:**

    - `lower`: smallest value of each variable, in its own unit [-].
    - `upper`: largest value of each variable, in its own unit [-].

    **Raises:**

    - `ValueError` if a lower bound is not below its upper bound.
    """

    lower: np.ndarray = eqx.field(converter=np.asarray)
    upper: np.ndarray = eqx.field(converter=np.asarray)

    def __check_init__(self):
        if not np.all(self.lower < self.upper):
            raise ValueError(
                f"Every lower bound must be below its upper bound, got {self.lower.tolist()} and "
                f"{self.upper.tolist()}."
            )

    def to_unit(self, point: np.ndarray) -> np.ndarray:
        """Place a point in the unit cube, moved inside the box if it was not [-]."""
        return np.clip((point - self.lower) / (self.upper - self.lower), 0.0, 1.0)

    def from_unit(self, unit: np.ndarray) -> np.ndarray:
        """Undo `to_unit`, in the units of the variables."""
        return self.lower + unit * (self.upper - self.lower)


class SearchResult(eqx.Module):
    """Where a search ended, and how.

    **Fields:**

    - `point`: best point found, in the units of the variables [-].
    - `value`: objective there, in its own unit [-].
    - `evaluations`: of the objective, with or without gradient [-].
    - `gradient_evaluations`: of the objective with its gradient [-].
    - `converged`: whether the search stopped by itself.
    - `reason`: why it stopped.
    - `path`: every point evaluated, for gradient searches in order [-].
    - `values`: objective at each of them [-].
    """

    point: np.ndarray
    value: float
    evaluations: int
    gradient_evaluations: int
    converged: bool
    reason: str
    path: np.ndarray
    values: np.ndarray


class _Recorder:
    """Evaluates value and gradient in the unit cube and keeps the whole record."""

    def __init__(self, objective: Objective, box: Box, watch: Watcher | None):
        self._evaluate = jax.jit(jax.value_and_grad(objective))
        self._box, self._watch = box, watch
        self.points: list[np.ndarray] = []
        self.values: list[float] = []

    def __call__(self, unit: np.ndarray) -> tuple[float, np.ndarray]:
        point = self._box.from_unit(unit)
        value, gradient = self._evaluate(jnp.asarray(point))
        gradient = np.asarray(gradient) * (self._box.upper - self._box.lower)
        if not (np.isfinite(value) and np.all(np.isfinite(gradient))):
            raise FloatingPointError(
                f"The objective or its gradient is not finite at {point.tolist()}: value "
                f"{float(value)}. Narrow the bounds: some design within them is impossible."
            )
        self.points.append(point)
        self.values.append(float(value))
        if self._watch is not None:
            self._watch(point, float(value))
        return float(value), gradient

    def result(self, *, converged: bool, reason: str) -> SearchResult:
        best = int(np.argmin(self.values))
        return SearchResult(
            point=self.points[best],
            value=self.values[best],
            evaluations=len(self.values),
            gradient_evaluations=len(self.values),
            converged=converged,
            reason=reason,
            path=np.stack(self.points),
            values=np.asarray(self.values),
        )


# L-BFGS-B knows no scale before its first step, and makes it of length one: in these units.
_FIRST_STEP = 0.1


def lbfgs(
    objective: Objective,
    start: np.ndarray,
    box: Box,
    *,
    most_evaluations: int = 50,
    tolerance: float = 1e-6,
    watch: Watcher | None = None,
) -> SearchResult:
    """Minimise by SciPy's L-BFGS-B, with gradients from JAX.

    **Arguments:**

    - `objective`: traceable by JAX, of order one near its minimum.
    - `start`: first point; moved into the box.
    - `box`: bounds.
    - `most_evaluations`: of the gradient, about; a line search is finished.
    - `tolerance`: on the largest slope in the unit cube; a thousandth of it on relative progress.
    - `watch`: called after each evaluation.

    **Returns:**

    The best point and the record of the search.

    **Raises:**

    - `FloatingPointError` if the objective or its gradient is not finite.
    """
    record = _Recorder(objective, box, watch)

    def stretched(place: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = record(place * _FIRST_STEP)
        return value, slope * _FIRST_STEP

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
    return record.result(converged=bool(end.success), reason=str(end.message))


def adam(
    objective: Objective,
    start: np.ndarray,
    box: Box,
    *,
    most_evaluations: int = 50,
    learning_rate: float = 0.05,
    tolerance: float = 1e-4,
    watch: Watcher | None = None,
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

    **Returns:**

    The best point and the record of the search.

    **Raises:**

    - `FloatingPointError` if the objective or its gradient is not finite.
    """
    record = _Recorder(objective, box, watch)
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


def differential_evolution(
    objective: Objective,
    box: Box,
    *,
    seed: int = 0,
    population: int = 15,
    most_generations: int = 100,
    tolerance: float = 1e-3,
) -> SearchResult:
    """Minimise by SciPy's differential evolution: the baseline that uses no gradient.

    **Arguments:**

    - `objective`: traceable by JAX; a generation is one batched call.
    - `box`: bounds.
    - `seed`: of the random numbers.
    - `population`: members per variable.
    - `most_generations`: after which it stops.
    - `tolerance`: spread of the population's values over their mean, at which it has converged.

    **Returns:**

    The best point and the record of the search.
    """
    batched = jax.jit(lambda points: jax.lax.map(objective, points))
    points, values = [], []

    def evaluate(units: np.ndarray) -> np.ndarray:
        generation = box.from_unit(np.atleast_2d(units.T))
        found = np.asarray(batched(jnp.asarray(generation)))
        # A design that cannot be evaluated is the worst of all.
        result = np.where(np.isfinite(found), found, np.inf)
        points.append(generation)
        values.append(result)
        return result

    end = scipy.optimize.differential_evolution(
        evaluate,
        [(0.0, 1.0)] * len(box.lower),
        rng=seed,
        popsize=population,
        maxiter=most_generations,
        tol=tolerance,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    return SearchResult(
        point=box.from_unit(end.x),
        value=float(end.fun),
        evaluations=sum(len(v) for v in values),
        gradient_evaluations=0,
        converged=bool(end.success),
        reason=str(end.message),
        path=np.concatenate(points),
        values=np.concatenate(values),
    )
