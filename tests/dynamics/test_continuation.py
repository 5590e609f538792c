"""Branches, folds and doublings: tables, marches, Hill's determinant, differences, scaling."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics.cases import sdof_driven, sdof_parametric
from helpers import assert_close, quick

from jaxgear._dynamics._branch import correction, correction_at_speed, seen_of
from jaxgear._dynamics._continuation import continuation
from jaxgear._dynamics._folds import (
    distance_to_fold,
    fold_gradient,
    period_doubled_branch,
    refine_fold,
)
from jaxgear._dynamics._harmonic import (
    HarmonicBalance,
    fourier_coefficients,
    harmonic_balance_problem,
)
from jaxgear._dynamics._march import time_history
from jaxgear._dynamics._steppers import Exponential

STEPS, RIPPLE, DAMPING = 200, 0.3, 0.05
LOW, HIGH = 0.4, 2.6
AVERAGED = HarmonicBalance(averaged=True)
TWICE = HarmonicBalance(averaged=True, multiple=2)

_balance = jax.jit(harmonic_balance_problem)


@jax.jit
def _solved(method, balance, speed, near):
    return method.solve(balance, speed, near)[0]


@functools.cache
def _system():
    return sdof_parametric(steps=STEPS)


@functools.cache
def _once():
    """The main branch of B5 (a)."""
    return continuation(_system(), LOW, HIGH, method=AVERAGED)


@functools.cache
def _twice():
    """Its sub-harmonic branch, from the upper of the two doublings."""
    terms, speed = period_doubled_branch(_system(), TWICE, _once().doublings[-1])
    return continuation(_system(), LOW, HIGH, method=TWICE, near=terms, at=speed)


def _crossings(curve, speed):
    """Indices of the points before which the branch passes a speed."""
    above = curve.speed > speed
    return np.flatnonzero(above[1:] != above[:-1])


def _at(curve, speed):
    """RMS of every response of a branch at a speed, and whether both its neighbours are stable."""
    found = []
    for i in _crossings(curve, speed):
        near = slice(i - 1, i + 3)
        between = np.polynomial.Polynomial.fit(curve.speed[near], curve.te_rms[near], 3)
        found.append((between(speed), bool(curve.stable[i] and curve.stable[i + 1])))
    return found


# --- one point of a branch


def test_point_at_a_speed_is_that_in_the_plane_of_this_speed():
    balance = _balance(AVERAGED, _system())
    curve = _once()
    here = len(curve.speed) // 2
    sizes = np.sqrt(np.r_[1.0, np.full(2 * balance.count, 2.0)])
    terms = curve.terms[here] / (np.asarray(balance.scales)[:, None] * sizes)
    guess = jnp.append(jnp.asarray(1.01 * terms.reshape(-1)), np.log(curve.speed[here]))
    upright = jnp.zeros_like(guess).at[-1].set(1.0)
    point, seen = correction_at_speed(AVERAGED, balance, guess)
    plane = correction(balance, guess, upright, guess[-1], jnp.asarray(1e-12))
    assert point.unknowns[-1] == guess[-1]
    assert_close(point.unknowns, plane.unknowns, atol=1e-11, rtol=0.0)
    assert_close(point.tangent, plane.tangent, atol=1e-9, rtol=0.0)
    assert_close(seen.te_rms, curve.te_rms[here], rtol=1e-8, atol=0.0)
    assert_close(seen.place, seen_of(balance, plane.unknowns).place, rtol=1e-9, atol=1e-12)


# --- the branch of B5 (a)


def test_branch_folds_where_the_sweeps_of_b5_jump():
    curve = _once()
    assert curve.ends == ("began", "left")
    assert_close(curve.speed[jnp.asarray([0, -1])], np.array([LOW, HIGH]), rtol=1e-12, atol=0.0)
    upper, lower = (fold.speed for fold in curve.folds)
    # Up, the response jumps between 0.75 and 0.85; down, it does not down to 0.75.
    assert 0.80 < upper < 0.85
    assert 0.70 < lower < 0.75
    # No response lies beyond the first fold but on the other side of it.
    first = curve.folds[0].after
    assert np.all(curve.speed[: first + 1] < upper)
    assert np.all(np.diff(curve.speed[: first + 1]) > 0.0)
    assert np.all(np.diff(curve.speed[first + 2 : curve.folds[1].after]) < 0.0)


@pytest.mark.slow
def test_responses_of_b5_lie_on_the_branches_and_between_them_is_an_unstable_one():
    (low, is_stable), (middle, between), (high, is_too) = _at(_once(), 0.75)
    assert (is_stable, between, is_too) == (True, False, True)
    # The averaged overlap is straight between the ends of a step: 3e-4 of the amplitude.
    assert abs(low - 0.51180) < 1e-3 * low
    assert abs(high - 2.06952) < 1e-3 * high
    assert low < middle < high
    assert [stable for _, stable in _at(_once(), 2.0)] == [False]
    ((rms, stable),) = _at(_twice(), 2.0)
    assert stable
    assert abs(rms - 0.99289) < 1e-3
    pair = sorted(_at(_twice(), 1.5))
    assert [stable for _, stable in pair] == [False, True]
    assert abs(pair[1][0] - 2.15875) < 2e-3


@jax.jit
def _marched(system, speed, start):
    return time_history(system, speed, start, cycles=300, keep=3, stepper=Exponential())


@pytest.mark.slow
@pytest.mark.parametrize(("fold", "way"), quick(1, [(0, 1.0), (1, -1.0)]), ids=["up", "down"])
def test_a_march_jumps_past_a_fold_and_not_before_it(fold, way):
    curve = _once()
    point = curve.folds[fold]
    # The stable neighbour of the fold.
    i = point.after if fold == 0 else point.after + 1
    balance = _balance(AVERAGED, _system())
    inside = jnp.asarray(point.speed * (1.0 - way * 5e-3))
    near = _solved(AVERAGED, balance, inside, jnp.asarray(curve.terms[i]))
    assert bool(near.settled)
    rms = float(jnp.std(near.place))
    held = _marched(_system(), inside, near.start)
    assert float(held.drift[-1]) < 1e-6
    assert abs(float(jnp.std(held.place)) / rms - 1.0) < 5e-3
    beyond = jnp.asarray(point.speed * (1.0 + way * 5e-3))
    gone = _marched(_system(), beyond, near.start)
    assert abs(float(jnp.std(gone.place)) / rms - 1.0) > 0.5


def test_a_resonance_that_is_small_beside_the_deflection_is_followed():
    ripple, damping = 1e-3, 0.02
    system = sdof_parametric(steps=STEPS, damping_ratio=damping, ripple=ripple)
    curve = continuation(system, 0.4, 1.7, method=AVERAGED, stability=False)
    # The ripple forces a linear oscillator, but for what it does to its own answer. Averaged
    # overlaps smooth it over a step.
    speeds = np.geomspace(0.4, 1.7, 2000)
    answer = ripple / np.abs(1.0 - speeds**2 + 2j * damping * speeds) / np.sqrt(2.0)
    found = np.interp(np.log(speeds), np.log(curve.speed), curve.te_rms)
    assert np.max(np.abs(found / answer - 1.0)) < 0.06
    assert abs(np.max(curve.te_rms) / np.max(answer) - 1.0) < 0.02


def test_stability_is_lost_through_plus_one_at_folds_and_minus_one_at_doublings():
    curve = _once()
    first, second = (fold.after for fold in curve.folds)
    assert np.all(curve.stable[:first])
    assert not np.any(curve.stable[first + 2 : second])
    between = curve.multiplier[first + 2 : second]
    assert np.all(np.imag(between) == 0.0)
    assert np.all(np.real(between) > 1.0)
    for point in curve.doublings:
        before, after = (curve.multiplier[point.after + i] for i in (0, 1))
        assert (before.real + 1.0) * (after.real + 1.0) < 0.0
    # A single mass with damping has multipliers of product exp(-4 pi zeta / speed): no torus.
    assert curve.tori == ()
    complex_ones = np.abs(np.imag(curve.multiplier)) > 0.0
    size = np.exp(-2.0 * np.pi * DAMPING / curve.speed[complex_ones])
    assert_close(np.abs(curve.multiplier[complex_ones]), size, rtol=1e-4, atol=0.0)


def _hill(speed):
    """Hill's determinant of x'' + 2 zeta x' + (1 + ripple cos) x for motions of twice the period.

    Odd harmonics of half the speed, in complex form: cos couples each with its second neighbours.
    """
    order = np.arange(-9, 10, 2)
    # The table holds the mean of the stiffness over each step; it acts in mid-step.
    half = 0.5 * RIPPLE * np.sinc(1.0 / STEPS)
    s = 0.5j * order * speed
    matrix = np.diag(s**2 + 2.0 * DAMPING * s + 1.0) + half * (
        np.eye(order.size, k=1) + np.eye(order.size, k=-1)
    )
    return np.linalg.det(matrix / np.abs(np.diag(matrix))[:, None]).real


def test_windows_narrower_than_a_step_are_found():
    """Mathieu's oscillator, barely excited: near twice its frequency its period doubles."""
    ripple, damping = 0.0105, 0.0025
    system = sdof_parametric(steps=STEPS, damping_ratio=damping, ripple=ripple)
    curve = continuation(system, 1.7, 2.4, method=AVERAGED)
    # By averaging: growth where half the ripple's share of the square exceeds the damping.
    half = 2.0 * np.sqrt((ripple / 4.0) ** 2 - damping**2)
    edges = [point.speed for point in curve.doublings]
    assert_close(np.asarray(edges), np.array([2.0 - half, 2.0 + half]), rtol=5e-5, atol=0.0)
    assert np.sum(~curve.stable) == 1
    assert np.sum(np.abs(curve.speed - 2.0) < 0.05) < 6
    # A little more damping, and there is none.
    calm = sdof_parametric(steps=STEPS, damping_ratio=0.0027, ripple=ripple)
    assert continuation(calm, 1.7, 2.4, method=AVERAGED).doublings == ()


@pytest.mark.slow
def test_periods_double_where_hills_determinant_vanishes():
    # No contact is lost there, so that the oscillator is linear in its disturbances.
    edges = [(1.80, 2.00), (2.00, 2.20)]
    for (low, high), doubling, joint in zip(
        edges, _once().doublings, sorted((_twice().speed[0], _twice().speed[-1])), strict=True
    ):
        assert _hill(low) * _hill(high) < 0.0
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _hill(low) * _hill(middle) > 0.0 else (low, middle)
        # Averaged contact smooths the stiffness once more over a step.
        assert abs(doubling.speed / low - 1.0) < 1e-4
        assert abs(joint / low - 1.0) < 1e-4


@pytest.mark.slow
def test_sub_harmonic_branch_joins_the_main_one_at_both_doublings():
    curve = _twice()
    assert curve.ends == ("joined", "joined")
    assert len(curve.folds) == 1
    for i in (0, -1):
        odd = np.r_[1 : TWICE.harmonics * 2 + 1 : 2]
        assert np.max(np.abs(curve.terms[i][0, odd])) < 2e-5
        assert np.max(np.abs(curve.terms[curve.speed.size // 2][0, odd])) > 0.5


# --- folds


def test_folds_do_not_depend_on_the_steps_taken():
    coarse = continuation(
        _system(), 0.6, 1.0, method=AVERAGED, first_step=0.02, largest_step=0.17, stability=False
    )
    for mine, other in zip(_once().folds, coarse.folds, strict=True):
        assert abs(mine.speed / other.speed - 1.0) < 1e-10
    assert not np.any(coarse.stable)
    # Backwards, the same responses.
    back = continuation(_system(), 1.0, 0.6, method=AVERAGED, stability=False)
    for mine, other in zip(_once().folds, back.folds[::-1], strict=True):
        assert abs(mine.speed / other.speed - 1.0) < 1e-10


def test_condition_vanishes_at_folds_as_the_root_of_the_distance():
    balance, curve = _balance(AVERAGED, _system()), _once()
    fold = curve.folds[0]
    at = lambda terms, speed: float(
        distance_to_fold(balance, jnp.asarray(terms), jnp.asarray(speed))
    )
    assert at(fold.terms, fold.speed) < 1e-7
    sizes = []
    for part in (1e-4, 1e-6):
        speed = jnp.asarray(fold.speed * (1.0 - part))
        orbit = _solved(AVERAGED, balance, speed, jnp.asarray(curve.terms[fold.after]))
        assert bool(orbit.settled)
        sizes.append(at(fourier_coefficients(balance, orbit.place), speed))
    assert abs(np.log10(sizes[0] / sizes[1]) - 1.0) < 0.1


def test_condition_of_a_linear_system_is_one():
    system, method = sdof_driven(), HarmonicBalance(harmonics=10)
    balance = _balance(method, system)
    assert_close(
        distance_to_fold(balance, balance.rest, jnp.asarray(0.7)), 1.0, rtol=1e-9, atol=0.0
    )


def _build(parameters):
    """The oscillator with other numbers."""
    base, p = _system(), parameters
    ripple = 1.0 + p["ripple"] / RIPPLE * (base.table.stiffness - 1.0)
    return eqx.tree_at(
        lambda s: (s.mass, s.damping, s.load, s.table.stiffness),
        base,
        (p["mass"].reshape(1, 1), p["damping"].reshape(1, 1), p["load"].reshape(1), ripple),
    )


PARAMETERS = {"mass": 1.0, "damping": 2.0 * DAMPING, "load": 1.0, "ripple": RIPPLE}


@pytest.mark.slow
@pytest.mark.parametrize("fold", [0, 1], ids=["up", "down"])
def test_gradient_of_a_fold_agrees_with_differences_and_scaling(fold):
    parameters = {name: jnp.asarray(value) for name, value in PARAMETERS.items()}
    begun = _once().folds[fold]
    slopes = fold_gradient(_build, parameters, AVERAGED, begun)

    def moved(name, step):
        changed = {**parameters, name: parameters[name] + step}
        found = refine_fold(_build(changed), AVERAGED, begun)
        assert found is not None
        return found.speed

    for name in ("damping", "ripple"):
        difference = (moved(name, 1e-5) - moved(name, -1e-5)) / 2e-5
        assert abs(slopes[name] / difference - 1.0) < 1e-5
    # Time scales with the root of the mass, and so does damping at the same damping ratio.
    scaled = slopes["mass"] + 0.5 * parameters["damping"] * slopes["damping"]
    assert_close(scaled, -0.5 * begun.speed, rtol=1e-7, atol=0.0)
    # Without a gap, contact is as much closed under any load.
    assert abs(slopes["load"]) < 1e-9 * abs(slopes["mass"])


@pytest.mark.slow
def test_corners_and_ordinary_points_are_refused_a_gradient():
    parameters = {name: jnp.asarray(value) for name, value in PARAMETERS.items()}
    exact, fold = HarmonicBalance(), _once().folds[0]
    corner = refine_fold(_system(), exact, fold)
    assert corner is not None
    # Contact at points in time instead of its mean over steps: the same fold within their error.
    assert abs(corner.speed / fold.speed - 1.0) < 1e-3
    with pytest.raises(ValueError, match="no smooth fold"):
        fold_gradient(_build, parameters, exact, corner)
    ordinary = _once().doublings[0]
    with pytest.raises(ValueError, match="no smooth fold"):
        fold_gradient(_build, parameters, AVERAGED, ordinary)
    other = {**parameters, "ripple": jnp.asarray(0.31)}
    with pytest.raises(ValueError, match="no response of the system"):
        fold_gradient(_build, other, AVERAGED, fold)


def test_a_fold_out_of_reach_is_not_found():
    assert refine_fold(_system(), AVERAGED, _once().doublings[0], reach=0.01) is None


# --- other branches, and how they end


@pytest.mark.slow
def test_a_branch_of_threefold_period_closes():
    # A start that random ones led to; no branch of one or two cycles meets this one.
    system = sdof_parametric(steps=STEPS, damping_ratio=0.03)
    method = HarmonicBalance(multiple=3, harmonics=8, averaged=True)
    start = jnp.asarray([[3.24047], [-0.84177]])
    last = _marched(system, jnp.asarray(2.4), start)
    near = fourier_coefficients(_balance(method, system), last.place)
    curve = continuation(
        system, 1.0, 3.5, method=method, near=near, at=2.4, largest_step=0.3, stability=False
    )
    assert curve.ends == ("returned", "returned")
    assert_close(curve.terms[-1], curve.terms[0], rtol=1e-12, atol=1e-12)
    # It spans from one fold to the other.
    speeds = sorted(fold.speed for fold in curve.folds)
    assert len(speeds) == 2
    assert speeds[0] <= np.min(curve.speed)
    assert np.max(curve.speed) <= speeds[1]


def test_terms_of_an_orbit_are_those_it_was_made_of():
    # On the averaged balance of twice the time, from an orbit of one cycle.
    curve, i = _once(), _once().speed.size // 2
    balance = _balance(AVERAGED, _system())
    orbit = _solved(AVERAGED, balance, jnp.asarray(curve.speed[i]), jnp.asarray(curve.terms[i]))
    assert_close(fourier_coefficients(balance, orbit.place), curve.terms[i], rtol=1e-9, atol=1e-9)
    twice = np.asarray(fourier_coefficients(_balance(TWICE, _system()), orbit.place))
    count = AVERAGED.harmonics
    kept = np.r_[0, 2 : 2 * count + 1 : 2, 2 * count + 2 : 4 * count + 1 : 2]
    assert_close(twice[:, kept], curve.terms[i], rtol=1e-9, atol=1e-9)


def test_a_branch_may_end_before_its_range():
    few = continuation(_system(), LOW, HIGH, method=AVERAGED, most_points=5)
    assert few.ends == ("began", "most points")
    assert few.speed.size == 5
    told = []
    none = continuation(
        _system(),
        LOW,
        HIGH,
        method=AVERAGED,
        near=jnp.full((1, 41), jnp.nan),
        done=told.append,
    )
    assert none.ends == ("not found", "not found")
    assert (none.speed.size, none.folds, told) == (0, (), [])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"start": 1.0, "stop": 1.0}, "two different positive speeds"),
        ({"start": -1.0, "stop": 1.0}, "two different positive speeds"),
        ({"start": 1.0, "stop": 2.0, "at": 3.0}, "between `start` and `stop`"),
        ({"start": 1.0, "stop": 2.0, "first_step": 0.2}, "not above `largest_step`"),
    ],
)
def test_nonsense_is_refused(given, says):
    with pytest.raises(ValueError, match=says):
        continuation(_system(), **given)


def test_a_doubled_period_needs_an_even_multiple():
    with pytest.raises(ValueError, match="even"):
        period_doubled_branch(_system(), AVERAGED, _once().doublings[0])
