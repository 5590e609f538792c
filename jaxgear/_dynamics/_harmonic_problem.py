r"""The equations of a harmonic balance, and Newton's search for their root.

A step of few unknowns is solved for directly, of more by GMRES (Saad and Schultz 1986), which needs
products alone: the matrix $1 + R(\partial g/\partial n - \bar k)$ is close to the unit matrix,
since the receptance $R$ falls with frequency.
"""

import functools
import operator

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxgear._dynamics._cell_forces import mean_load, mesh_load
from jaxgear._dynamics._gmres import gmres
from jaxgear._dynamics._harmonic_basis import HarmonicAnalysis, HarmonicValues, as_matrix
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._orbit import derivative_if
from jaxgear._dynamics._types import (
    HarmonicMatrices,
    StepMatrices,
    StepPlaces,
    Terms,
)
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._types import CoordinateMatrix, Coordinates, Flag, Reals, Scalar


class Problem(eqx.Module):
    """The balance at one speed.

    **Fields:**

    - `law`, `samples`: as of `Balance`.
    - `times`, `analysis`: as of `Balance` [-].
    - `scales`: of the mesh coordinates [m, rad].
    - `rates`: time derivatives of the harmonics at mid-steps [1/s].
    - `real`, `imaginary`: parts of the receptance at each harmonic [m/N, 1/N, 1/(N m)].
    - `beside`: motion of all degrees of freedom under all loads but those of the mesh, in rows its
        mean or, where these loads swing, all of its harmonics [m, rad].
    - `met`: mesh coordinates of it, `[coordinate, term]` [m, rad].
    - `mean`: mean mesh stiffness [N/m, N, N m].
    - `bow`: of the system, or `None` [m/N, 1/N, 1/(N m)].
    - `cell_damping`: of the system, or `None` [s].
    - `speed`: of the pinion [rad/s].
    - `base`: frequency of the response [rad/s].
    """

    law: AbstractContactLaw
    samples: tuple[Mesh, ...]
    times: tuple[HarmonicValues, ...]
    rates: HarmonicValues
    analysis: HarmonicAnalysis
    real: HarmonicMatrices
    imaginary: HarmonicMatrices
    beside: Reals
    met: Reals
    mean: CoordinateMatrix
    bow: CoordinateMatrix | None
    cell_damping: Scalar | None
    scales: Coordinates
    speed: Scalar
    base: Scalar


def loads_of(
    problem: Problem, terms: Terms
) -> tuple[StepPlaces, StepPlaces, list[tuple[StepMatrices, HarmonicValues]]]:
    """Elastic and total load at mid-steps, and the slopes of the latter.

    A slope is a matrix for each step, and the values of the harmonics that it multiplies.
    """
    mesh, *others = problem.samples
    if others:
        first, last = (values @ terms.T for values in problem.times)
        load, *slopes = jax.vmap(mean_load)(mesh, others[0], others[1], first, last)
        return load, load, list(zip(slopes, problem.times, strict=True))
    values = problem.times[0]
    place = values @ terms.T
    press = lambda mesh, place: mesh_load(mesh, place, problem.law)
    elastic, tangent = jax.vmap(press)(mesh, place)
    loss = problem.cell_damping
    if loss is None:
        return elastic, elastic, [(tangent, values)]

    def damping(mesh: Mesh, place: Coordinates, rate: Coordinates) -> Coordinates:
        return loss * jnp.sum(press(mesh, place)[1] * rate[None, :], axis=1)

    rate = problem.rates @ terms.T
    total = elastic + jax.vmap(damping)(mesh, place, rate)
    tangent = tangent + jax.vmap(jax.jacfwd(damping, argnums=1))(mesh, place, rate)
    by_rate = loss * jax.vmap(press)(mesh, place)[1]
    return elastic, total, [(tangent, values), (by_rate, problem.rates)]


# Up to so many mesh coordinates a sum of products of arrays is faster than many small matrices.
_FEW = 4


def _by_harmonic(matrices: Reals, columns: Reals) -> Reals:
    """A matrix for each harmonic, or one for all, times the columns of the harmonic."""
    if matrices.shape[2] > _FEW:
        return jnp.matmul(matrices, columns)
    return jnp.sum(matrices[:, :, :, None] * columns[:, None, :, :], axis=2)


def motion_of_nodes(problem: Problem, place: Reals, load: Reals) -> Reals:
    """Harmonics of the nodes' mesh coordinates, n = m + B g; terms leading, columns trailing."""
    if problem.bow is None:
        return place
    return place + _by_harmonic(problem.bow[None], load)


def excess_stiffness(problem: Problem, nodes: Reals, load: Reals) -> Reals:
    """Harmonics of the load beyond that of the mean stiffness, g - k n."""
    return load - _by_harmonic(problem.mean[None], nodes)


def _missing(problem: Problem, place: Reals, load: Reals) -> Reals:
    """n + R (g - k n) of each harmonic: what must equal the answer to other loads."""
    nodes = motion_of_nodes(problem, place, load)
    excess = excess_stiffness(problem, nodes, load)
    count = problem.real.shape[0] - 1
    cosines, sines = excess[: count + 1], excess[count + 1 :]
    real, imaginary = problem.real, problem.imaginary
    in_phase = _by_harmonic(real, cosines).at[1:].add(_by_harmonic(imaginary[1:], sines))
    square = _by_harmonic(real[1:], sines) - _by_harmonic(imaginary[1:], cosines[1:])
    return nodes + jnp.concatenate([in_phase, square])


def imbalance(problem: Problem, terms: Terms) -> Terms:
    """What the harmonics of each mesh coordinate lack, over the coordinate's scale.

    **Arguments:**

    - `problem`: the balance at one speed.
    - `terms`: harmonics of the mesh coordinates [m, rad].

    **Returns:**

    The imbalance, like `terms` [-].
    """
    return _imbalance(problem, terms, problem.analysis @ loads_of(problem, terms)[1])


def _imbalance(problem: Problem, terms: Terms, load: Reals) -> Terms:
    missing = _missing_of_one(problem, terms, load)
    known = problem.met.shape[1]
    return missing.at[:, :known].add(-problem.met) / problem.scales[:, None]


def _missing_of_one(problem: Problem, terms: Terms, load: Reals) -> Terms:
    """As `_missing`, of one response and its load."""
    return _missing(problem, terms.T[:, :, None], load[:, :, None])[:, :, 0].T


def linearised(problem: Problem, terms: Terms) -> tuple[Terms, Reals]:
    """The imbalance, and its derivative by the harmonics.

    **Arguments:**

    - `problem`: the balance at one speed.
    - `terms`: harmonics of the mesh coordinates [m, rad].

    **Returns:**

    The imbalance [-], and a square matrix on the flattened harmonics [1/m, 1/rad].
    """
    _, total, slopes = loads_of(problem, terms)
    missing = _imbalance(problem, terms, problem.analysis @ total)
    return missing, _slope(problem, terms, slopes)


def _slope(
    problem: Problem, terms: Terms, slopes: list[tuple[StepMatrices, HarmonicValues]]
) -> Reals:
    """Derivative of the imbalance, from the slopes of the load."""
    width, count = terms.shape
    spread = [tangent[:, :, :, None] * as_matrix(x)[:, None, None, :] for tangent, x in slopes]
    spread = functools.reduce(operator.add, spread)
    load = problem.analysis @ spread.reshape(spread.shape[0], -1)
    place = jnp.eye(width)[None, :, :, None] * jnp.eye(count)[:, None, None, :]
    columns = count, width, width * count
    matrix = _missing(problem, place.reshape(columns), load.reshape(columns))
    # Rows in the order of the imbalance: coordinates leading.
    matrix = jnp.moveaxis(matrix, 0, 1) / problem.scales[:, None, None]
    return matrix.reshape(width * count, width * count)


# A step of more unknowns is iterated for: of 902, the response of a wheel on 22 mesh coordinates,
# in a third of the time of a matrix, of 400 in the same.
MOST_DIRECT = 300

# Of more, a matrix takes a second and, as the cube of their number, soon a minute.
MOST_AT_ONCE = 1600


def is_long(unknowns: int) -> bool:
    """Whether a response has too many unknowns for matrices of all of them."""
    return unknowns > MOST_AT_ONCE


# What iteration leaves of the right-hand side: in a step, whose contact costs more than it, nearly
# nothing unless that is rounding; in a derivative nothing.
_LEAST_LEFT, _MOST_LEFT, _LEFT_OF_DERIVATIVES = 1e-9, 1e-3, 1e-12

# In a step of a long response as much as contact takes away again. In the last less than counts:
# to begin anew for the rest costs as much as all that.
_MOST_LEFT_OF_LONG, _LEFT_AT_LAST = 1e-2, 0.1

# Blocks of directions, and how often it begins anew.
_KEPT, _KEPT_OF_LONG = (8, 6), (25, 4)


def _change(
    problem: Problem, slopes: list[tuple[StepMatrices, HarmonicValues]], change: Terms
) -> Terms:
    """Derivative of the imbalance along a change of the harmonics, over its scales."""
    moved = change * problem.scales[:, None]
    pushed = [jnp.einsum("sij,sj->si", tangent, values @ moved.T) for tangent, values in slopes]
    load = problem.analysis @ functools.reduce(operator.add, pushed)
    return _missing_of_one(problem, moved, load) / problem.scales[:, None]


def _answer(
    problem: Problem,
    slopes: list[tuple[StepMatrices, HarmonicValues]],
    missing: Terms,
    left: Scalar | float,
) -> tuple[Terms, Terms]:
    """The change of the harmonics whose imbalance is the one given, if contact stays as it is.

    And what iteration leaves of that imbalance.
    """
    if missing.size <= MOST_DIRECT:
        matrix = _slope(problem, missing, slopes)
        found = jnp.linalg.solve(matrix, missing.reshape(-1)).reshape(missing.shape)
        return found, jnp.zeros_like(missing)
    # As one vector: sums over two axes of many directions take twice as long.
    product = lambda change: _change(problem, slopes, change.reshape(missing.shape)).reshape(-1)
    blocks, anew = _KEPT_OF_LONG if is_long(missing.size) else _KEPT
    solve = lambda product, right: gmres(product, right, left, blocks=blocks, anew=anew)
    # Iteration in JAX cannot be transposed, as its tolerance depends on the right-hand side.
    found, rest = jax.lax.custom_linear_solve(
        product, missing.reshape(-1), solve, transpose_solve=solve, has_aux=True
    )
    return found.reshape(missing.shape) * problem.scales[:, None], rest.reshape(missing.shape)


class _Forecast(eqx.Module):
    """What a step of Newton's method should lead to.

    **Fields:**

    - `missing`: the imbalance if contact stays as it is [-].
    - `before`: norm of that before the step, 0 if there is no forecast [-].
    """

    missing: Terms
    before: Scalar

    def failed_by(self, missing: Terms) -> Scalar:
        """Norm of the imbalance that was not foreseen, over that before [-]."""
        return jnp.linalg.norm(missing - self.missing) / self.before


class _Search(eqx.Module):
    """Where Newton's method stands.

    **Fields:**

    - `best`: harmonics of the least imbalance so far [m, rad].
    - `error`: its imbalance [-].
    - `trial`: harmonics to examine next [m, rad].
    - `steps`: taken [-].
    - `forecast`: of the imbalance of `trial`, of long responses.
    """

    best: Terms
    error: Scalar
    trial: Terms
    steps: Scalar
    forecast: _Forecast | None


# Contact opens and closes in Newton's first steps, and imbalance may rise on the way; later steps
# are halved until it falls.
_FREE_STEPS = 12

# Imbalance that is rounding, in static deflections [-].
_ROUNDING = 1e-13


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def root_of(
    settings: tuple[float, int], problem: Problem, first: Terms
) -> tuple[Terms, Scalar, Scalar]:
    """Harmonics in balance, the imbalance one Newton step before them, and the number of steps."""
    tolerance, most_steps = settings

    long = is_long(first.size)
    # A step in the contact that is found leaves nothing but rounding, and no step to take.
    enough = tolerance if long else _ROUNDING

    def left_of(forecast: _Forecast | None, missing: Terms, error: Scalar) -> Scalar:
        if forecast is None:
            return jnp.clip(_ROUNDING / error, _LEAST_LEFT, _MOST_LEFT)
        # Eisenstat and Walker 1996: no more exactly than the forecast before was.
        last = _LEFT_AT_LAST * tolerance / error
        return jnp.minimum(jnp.maximum(forecast.failed_by(missing), last), _MOST_LEFT_OF_LONG)

    def body(state: _Search) -> _Search:
        _, total, slopes = loads_of(problem, state.trial)
        missing = _imbalance(problem, state.trial, problem.analysis @ total)
        error = jnp.max(jnp.abs(missing))
        left = left_of(state.forecast, missing, error)
        step_of = lambda missing, slopes: _answer(problem, slopes, missing, left)
        stay = lambda missing, _: (jnp.zeros_like(missing), missing)
        step, rest = jax.lax.cond(error > enough, step_of, stay, missing, slopes)
        finite = jnp.isfinite(error) & jnp.all(jnp.isfinite(step))
        better = finite & (error < state.error)
        best = jnp.where(better, state.trial, state.best)
        on = better | (finite & (state.steps < _FREE_STEPS))
        before = jnp.where(on, jnp.linalg.norm(missing), 0.0) if long else None
        return _Search(
            best=best,
            error=jnp.where(better, error, state.error),
            trial=jnp.where(on, state.trial - step, 0.5 * (best + state.trial)),
            steps=state.steps + 1.0,
            forecast=None if before is None else _Forecast(rest, before),
        )

    def unfinished(state: _Search) -> Flag:
        # A NaN is not finished either: it is met by the number of steps.
        return ~(state.error <= tolerance) & (state.steps < most_steps)

    unknown = _Forecast(jnp.zeros_like(first), jnp.zeros(())) if long else None
    start = _Search(first, jnp.asarray(jnp.inf), first, jnp.zeros(()), unknown)
    last = jax.lax.while_loop(unfinished, body, start)
    # `trial` is one Newton step beyond the point that met the tolerance, if that was worth it.
    terms = jnp.where(last.error <= tolerance, last.trial, last.best)
    return terms, last.error, last.steps


@root_of.defjvp
def _root_tangent(settings, primals, tangents):
    problem, first = primals
    terms, error, steps = root_of(settings, problem, first)
    _, change = jax.jvp(lambda p: imbalance(p, terms), (problem,), (tangents[0],))
    # What is not a response has no derivative. Its matrix may be singular, that of the mean is not.
    found = error <= settings[0]
    (first_slope, values), *others = loads_of(problem, terms)[2]
    slopes = [(jnp.where(found, first_slope, problem.mean), values)]
    slopes += [(jnp.where(found, each, 0.0), own) for each, own in others]
    moved = -_answer(problem, slopes, change, _LEFT_OF_DERIVATIVES)[0]
    moved = derivative_if(found, moved)
    return (terms, error, steps), (moved, jnp.zeros_like(error), jnp.zeros_like(steps))
