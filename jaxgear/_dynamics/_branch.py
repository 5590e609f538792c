"""The equations of a branch of responses: harmonics and speed are unknown together."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxgear._compiled import lasting, lasting_rare
from jaxgear._dynamics._harmonic import Balance, HarmonicBalance
from jaxgear._dynamics._harmonic_problem import Problem, imbalance, linearised, root_of
from jaxgear._dynamics._orbit import Orbit, contact_force
from jaxgear._dynamics._receptance import AbstractAnswers
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._types import StepPlaces, Terms
from jaxgear._types import Flag, Reals, Scalar


def sizes_of(balance: Balance) -> Terms:
    """Of the harmonics: a change by these has a mean square over time of one."""
    rows = jnp.full(balance.middle.shape[1], jnp.sqrt(2.0)).at[0].set(1.0)
    return balance.scales[:, None] * rows[None, :]


def joined_vector(balance: Balance, terms: Terms, speed: Scalar) -> Reals:
    """Harmonics and speed as one vector without units."""
    return jnp.append((terms / sizes_of(balance)).reshape(-1), jnp.log(speed))


def parted_vector(balance: Balance, unknowns: Reals) -> tuple[Terms, Scalar]:
    """Harmonics and speed."""
    sizes = sizes_of(balance)
    return unknowns[:-1].reshape(sizes.shape) * sizes, jnp.exp(unknowns[-1])


def slopes_by_both(balance: Balance, unknowns: Reals) -> tuple[Reals, Reals]:
    """The residual, and its derivative by harmonics and speed: a column more than rows."""
    terms, _ = parted_vector(balance, unknowns)
    problem, by_speed, _ = _problem_by_speed(balance, unknowns[-1])
    residual, matrix = linearised(problem, terms)
    _, last = jax.jvp(lambda problem: imbalance(problem, terms), (problem,), (by_speed,))
    columns = matrix * sizes_of(balance).reshape(1, -1)
    return residual.reshape(-1), jnp.concatenate([columns, last.reshape(-1, 1)], axis=1)


def _problem_by_speed(
    balance: Balance, exponent: Scalar
) -> tuple[Problem, Problem, AbstractAnswers]:
    """The balance at a speed, its derivative by the speed's logarithm, and what bodies answer."""
    at = lambda exponent: balance.at_speed(jnp.exp(exponent))
    (problem, answers), (by_speed, _) = jax.jvp(at, (exponent,), (jnp.ones(()),))
    return problem, by_speed, answers


# A step along the branch that takes more of Newton's steps is too long.
MOST_NEWTON = 10


class CorrectedPoint(NamedTuple):
    """What Newton's method has made of a guess.

    **Fields:**

    - `unknowns`: the point, as of `joined_vector` [-].
    - `tangent`: of the branch there, of length 1 [-].
    - `error`: imbalance one step before [-].
    - `steps`: taken [-].
    """

    unknowns: Reals
    tangent: Reals
    error: Scalar
    steps: Scalar


class PointResponse(NamedTuple):
    """What is to be seen of the response at a point.

    **Fields:**

    - `ratio`: largest total contact force over the static one [-].
    - `te_rms`: of the transmission error about its mean [m].
    - `place`: mesh coordinates in mid-steps [m, rad].
    """

    ratio: Scalar
    te_rms: Scalar
    place: StepPlaces


@lasting_rare
def correction(
    balance: Balance, first: Reals, normal: Reals, value: Scalar, tolerance: Scalar
) -> CorrectedPoint:
    """The point of the branch in a plane, its tangent on the side of the plane's normal."""

    def body(state: CorrectedPoint) -> CorrectedPoint:
        residual, matrix = slopes_by_both(balance, state.unknowns)
        off = normal @ state.unknowns - value
        right = jnp.stack([jnp.append(residual, off), jnp.zeros_like(normal).at[-1].set(1.0)], 1)
        solved = jnp.linalg.solve(jnp.concatenate([matrix, normal[None, :]]), right)
        tangent = solved[:, 1] / jnp.sqrt(jnp.sum(solved[:, 1] ** 2))
        error = jnp.max(jnp.abs(residual))
        return CorrectedPoint(state.unknowns - solved[:, 0], tangent, error, state.steps + 1.0)

    def unfinished(state: CorrectedPoint) -> Flag:
        return ~(state.error <= tolerance) & (state.steps < MOST_NEWTON)

    start = CorrectedPoint(first, normal, jnp.asarray(jnp.inf), jnp.zeros(()))
    return jax.lax.while_loop(unfinished, body, start)


@lasting
def correction_at_speed(
    method: HarmonicBalance, balance: Balance, first: Reals
) -> tuple[CorrectedPoint, PointResponse]:
    """The point of the branch at the speed of a guess, its tangent towards higher speed.

    The structure is asked once, not in each of Newton's steps: what it answers depends on the speed
    alone.
    """
    near, _ = parted_vector(balance, first)
    problem, by_speed, answers = _problem_by_speed(balance, first[-1])
    found = lambda problem: root_of((method.tolerance, MOST_NEWTON), problem, near)
    (terms, error, steps), (moved, *_) = jax.jvp(found, (problem,), (by_speed,))
    tangent = jnp.append((moved / sizes_of(balance)).reshape(-1), 1.0)
    tangent = tangent / jnp.sqrt(jnp.sum(tangent**2))
    unknowns = joined_vector(balance, terms, jnp.ones(())).at[-1].set(first[-1])
    seen = _seen(balance, problem, answers, terms)
    return CorrectedPoint(unknowns, tangent, error, steps), seen


@lasting_rare
def seen_of(balance: Balance, unknowns: Reals) -> PointResponse:
    """What is to be seen of a point."""
    terms, speed = parted_vector(balance, unknowns)
    return _seen(balance, *balance.at_speed(speed), terms)


def _seen(
    balance: Balance, problem: Problem, answers: AbstractAnswers, terms: Terms
) -> PointResponse:
    system, none = balance.system, jnp.zeros(())
    orbit = balance.orbit(problem, answers, terms, none, none, 0.0)
    return PointResponse(*_measures(system, orbit), orbit.place)


def _measures(system: DynamicSystem, orbit: Orbit) -> tuple[Scalar, Scalar]:
    error = orbit.motion @ system.transmission
    share = system.table.lengths / system.table.periods
    error = error - jnp.sum(share * error)
    ratio = jnp.max(contact_force(system, orbit)) / system.force
    return ratio, jnp.sqrt(jnp.sum(share * error**2))
