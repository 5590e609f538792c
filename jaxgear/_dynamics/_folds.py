"""Single points of curves: period doublings, folds and their gradients."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jaxgear._checks import InputError, require
from jaxgear._dynamics._branch import joined_vector, slopes_by_both
from jaxgear._dynamics._continuation import CurvePoint, joined_once, parted_once, special_point
from jaxgear._dynamics._guide import Guide, LostError
from jaxgear._dynamics._harmonic import Balance, HarmonicBalance, harmonic_balance_problem
from jaxgear._dynamics._harmonic_problem import imbalance
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._types import Terms
from jaxgear._types import Reals, Scalar


def period_doubled_branch(
    system: DynamicSystem, method: HarmonicBalance, doubling: CurvePoint, *, step: float = 0.02
) -> tuple[Terms, float]:
    """A response of twice the period, close to where the period doubles (theory 10.1).

    **Arguments:**

    - `system`: what moves.
    - `method`: with `multiple` twice that by which the doubling was found.
    - `doubling`: of a curve.
    - `step`: root mean square of the sub-harmonic part, in static deflections [-].

    **Returns:**

    Its harmonics [m, rad] and its speed [rad/s], for `near` and `at` of `continuation`.

    **Raises:**

    - `ValueError` if `multiple` is odd, or if no such response is found.
    """
    require(
        method.multiple % 2 == 0,
        "A doubled period needs an even `HarmonicBalance.multiple`, got {got}.",
        got=method.multiple,
    )
    balance = harmonic_balance_problem(method, system)
    guide = Guide(method, balance, stability=False)
    kept, count = doubling.terms.shape[1] // 2, balance.count
    order = np.arange(1, min(kept, count // 2) + 1)
    terms = np.zeros((doubling.terms.shape[0], 2 * count + 1))
    terms[:, 0] = doubling.terms[:, 0]
    terms[:, 2 * order] = doubling.terms[:, order]
    terms[:, count + 2 * order] = doubling.terms[:, kept + order]
    speed = jnp.asarray(doubling.speed)
    centre = np.asarray(joined_once(balance, jnp.asarray(terms), speed))
    matrix = np.asarray(_by_both_once(balance, centre)[1])[:, :-1]
    shape = np.append(np.linalg.svd(matrix)[2][-1], 0.0)
    shape = shape - guide.shifted(shape, method.multiple // 2)
    shape = shape / np.sqrt(shape @ shape)
    guess = centre + step * shape
    found = guide.correct(guess, shape, float(shape @ guess))
    if found is None:
        raise InputError(
            "No response of twice the period was found near "
            f"{doubling.speed:.6g} rad/s. Try another `step`."
        )
    terms, speed = parted_once(balance, found.unknowns)
    return terms, float(speed)


_by_both_once = jax.jit(slopes_by_both)


# --- Folds


@jax.jit
def distance_to_fold(balance: Balance, terms: Terms, speed: Scalar) -> Scalar:
    """How far a response is from a fold, or from where another branch crosses.

    **Arguments:**

    - `balance`: from `harmonic_balance_problem`.
    - `terms`: harmonics of the response [m, rad].
    - `speed`: of the pinion [rad/s].

    **Returns:**

    The smallest singular value of the derivative of the balance by the harmonics, both without
    units: 1 for a linear system, 0 at a fold. Derivatives of the response grow with its inverse
    [-].
    """
    matrix = slopes_by_both(balance, joined_vector(balance, terms, speed))[1][:, :-1]
    return jnp.linalg.svd(matrix, compute_uv=False)[-1]


def refine_fold(
    system: DynamicSystem, method: HarmonicBalance, fold: CurvePoint, *, reach: float = 0.5
) -> CurvePoint | None:
    """Find the fold again after the system has changed a little (theory 10.2).

    **Arguments:**

    - `system`: what moves now.
    - `method`: by which the fold was found.
    - `fold`: of the system before.
    - `reach`: how far along the branch to look for it [-].

    **Returns:**

    The fold, or `None` if there is none within reach.
    """
    balance = harmonic_balance_problem(method, system)
    guide = Guide(method, balance, stability=False)
    speed = jnp.asarray(fold.speed)
    near = np.asarray(joined_once(balance, jnp.asarray(fold.terms), speed))
    normal = np.linalg.svd(np.asarray(_by_both_once(balance, near)[1]))[2][-1]
    here = guide.correct(near, normal, float(normal @ near))
    if here is None:
        return None
    step = 1e-3
    while step <= reach:
        for way in (1.0, -1.0):
            begun = here._replace(tangent=way * here.tangent)
            guess = begun.unknowns + step * begun.tangent
            ahead = guide.correct(guess, begun.tangent, float(begun.tangent @ guess))
            if ahead is None or begun.tangent[-1] * ahead.tangent[-1] > 0.0:
                continue
            try:
                return special_point(guide, guide.see(guide.fold(begun, ahead)), -1)
            except LostError:
                continue
        step *= 2.0
    return None


# Smallest singular value at which a point counts as a fold, and its largest imbalance.
_SINGULAR, _BALANCED = 1e-4, 1e-6


def fold_gradient(
    build: Callable[[PyTree], DynamicSystem],
    parameters: PyTree,
    method: HarmonicBalance,
    fold: CurvePoint,
) -> PyTree:
    r"""Derivatives of the speed at which a branch folds (theory 10.2).

    With $l$ the left null vector of the balance's derivative by the harmonics,
    $\mathrm d\Omega/\mathrm d\theta = -(l\cdot r_\theta)/(l\cdot r_\Omega)$: no second derivatives
    are needed.

    **Arguments:**

    - `build`: makes the system of parameters. It is compiled anew when it is another function.
    - `parameters`: at which the fold was found.
    - `method`: by which it was found, with averaged or smooth contact. Exact contact at points in
        time changes its slope from one time step to the next: its folds are corners, and have no
        derivative, or one with an error in the order of a step.
    - `fold`: of the system of these parameters, as of `continuation` or `refine_fold`.

    **Returns:**

    Derivatives of the speed by each parameter, like `parameters` [rad/s per unit of each].

    **Raises:**

    - `ValueError` if the point is not a fold of that system, or is one at a corner.
    """

    balance = harmonic_balance_problem(method, _built(build, parameters))
    terms, speed = jnp.asarray(fold.terms), jnp.asarray(fold.speed)
    residual, matrix = _by_both_once(balance, joined_once(balance, terms, speed))
    left, sizes, _ = np.linalg.svd(np.asarray(matrix)[:, :-1])
    error = np.max(np.abs(residual))
    require(
        bool(error <= _BALANCED),
        "The point at {speed:.6g} rad/s is no response of the system of these parameters: its "
        "imbalance is {error:.3g}. Find the fold again with `refine_fold`.",
        speed=fold.speed,
        error=error,
    )
    require(
        bool(sizes[-1] <= _SINGULAR),
        "The point at {speed:.6g} rad/s is no smooth fold: the smallest singular value is "
        "{smallest:.3g}. Exact contact at points in time folds at corners; use `averaged=True` or "
        "`SmoothContact`.",
        speed=fold.speed,
        smallest=sizes[-1],
    )
    left = left[:, -1]
    by_speed = float(left @ np.asarray(matrix)[:, -1]) / fold.speed
    slopes = _weighted_slopes(build, parameters, method, left, terms, speed)
    return jax.tree.map(lambda slope: -slope / by_speed, slopes)


_built = jax.jit(lambda build, parameters: build(parameters), static_argnums=0)


@partial(jax.jit, static_argnums=0)
def _weighted_slopes(
    build: Callable[[PyTree], DynamicSystem],
    parameters: PyTree,
    method: HarmonicBalance,
    weights: Reals,
    terms: Terms,
    speed: Scalar,
) -> PyTree:
    """Derivatives by the parameters of a weighted sum of the residual."""

    def total(parameters: PyTree) -> Scalar:
        problem = harmonic_balance_problem(method, build(parameters)).at_speed(speed)[0]
        return weights @ imbalance(problem, terms).reshape(-1)

    return jax.grad(total)(parameters)
