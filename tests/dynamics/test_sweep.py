"""Sweeps: both directions of B5 (a), with its jumps and its sub-harmonic branch."""

import dataclasses
import functools

import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import cases
from helpers import quick

from jaxgear._dynamics import _harmonic_problem, _sweep
from jaxgear._dynamics._harmonic import (
    HarmonicBalance,
    fourier_coefficients,
    harmonic_balance_problem,
)
from jaxgear._dynamics._march import TimeStepping
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import Exponential
from jaxgear._dynamics._sweep import Finder, sweep
from jaxgear._dynamics._sweep_types import Direction, SweepSettings
from jaxgear._dynamics._windows import monodromy_of
from jaxgear._response._dynamic import dynamic_ratio

SPEEDS = [0.5, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.5, 1.8, 1.9, 2.0, 2.1, 2.3]

# The softening oscillator of `reference`: RMS, largest and least displacement.
UP = {
    0.5: (0.52226, 1.98539, 0.14628),
    0.7: (0.43500, 1.61480, 0.38629),
    0.75: (0.51180, 1.74754, 0.30105),
    0.85: (1.55067, 2.82339, -1.55553),
    1.2: (0.42880, 1.53736, 0.32461),
    1.5: (0.16310, 1.20061, 0.73931),
    2.0: (0.99289, 2.42641, -0.39836),
    2.3: (0.04888, 1.05928, 0.92104),
}
DOWN = UP | {0.75: (2.06952, 3.40656, -2.45721), 1.5: (2.15875, 3.46206, -2.71696)}

METHODS = {
    "harmonic": SweepSettings(method=HarmonicBalance(harmonics=24)),
    "shooting": SweepSettings(method=Shooting(warm_up=0)),
    "march": SweepSettings(method=TimeStepping(stepper=Exponential(), cycles=200)),
}


@functools.cache
def _swept(name: str, direction: Direction):
    return sweep(cases.sdof_parametric(steps=200), SPEEDS, direction, METHODS[name])


@pytest.mark.parametrize("name", quick(1, METHODS))
@pytest.mark.parametrize(("direction", "table"), quick(1, [("up", UP), ("down", DOWN)]))
def test_both_branches_of_the_table(name, direction, table):
    points = dict(zip(SPEEDS, _swept(name, direction), strict=True))
    for speed, expected in table.items():
        point = points[speed]
        place = np.asarray(point.orbit.place[:, 0])
        assert point.settled, speed
        assert point.stable, speed
        found = place.std(), place.max(), place.min()
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-3 * expected[1])
    assert points[2.0].multiple == 2
    assert points[1.5].multiple == (1 if direction == "up" else 2)
    assert points[2.3].multiple == 1


def test_cold_sweep_takes_each_speed_alone():
    alone = sweep(cases.sdof_parametric(steps=200), [1.5], "cold", METHODS["harmonic"])
    assert alone[0].multiple == 1
    np.testing.assert_allclose(np.std(alone[0].orbit.place), 0.16310, rtol=1e-3)


def test_points_come_back_in_the_order_of_the_speeds():
    told = []
    points = sweep(
        cases.sdof_parametric(steps=200),
        [2.3, 0.5],
        "down",
        METHODS["harmonic"],
        done=told.append,
    )
    assert [float(p.orbit.speed) for p in points] == [2.3, 0.5]
    assert sum(told) == 2


def test_what_cannot_be_swept_is_refused():
    system = cases.sdof_parametric(steps=200)
    with pytest.raises(ValueError, match="at least one speed"):
        sweep(system, [])
    with pytest.raises(ValueError, match="must be positive, got -1"):
        sweep(system, [1.0, -1.0])


# --- Steps of speed


def test_a_step_is_judged_by_the_vibration():
    """Growth with speed moves the mean; a hundredth of the static deflection is no jump."""
    finder = Finder(cases.sdof_parametric(steps=200), METHODS["harmonic"])
    last = finder.next(jnp.asarray(2.3), None)

    def near(stretched: float, moved: float, swing: float = 1.0) -> bool:
        """Whether a vibration of so many static deflections is followed by such a one."""
        shape = np.asarray(last.orbit.place) - np.asarray(last.orbit.place).mean(axis=0)
        shape = shape * swing / np.ptp(shape)
        orbit = dataclasses.replace(last.orbit, place=jnp.asarray(stretched * shape + moved))
        return finder._near(dataclasses.replace(last, orbit=orbit), jnp.asarray(shape))

    assert finder.deflection == pytest.approx(1.0)
    assert near(1.2, 0.0)
    assert near(1.2, 10.0)
    assert not near(2.0, 0.0)
    assert near(2.0, 0.0, swing=0.01)
    assert not near(4.0, 0.0, swing=0.01)


def test_the_way_to_a_speed_is_halved_less_often_over_a_long_cycle(monkeypatch):
    finder = Finder(cases.sdof_parametric(steps=200), METHODS["harmonic"])
    last, often = finder.next(jnp.asarray(2.3), None), []
    monkeypatch.setattr(finder, "_followed", lambda _, last, most: often.append(most) or last)
    finder.next(jnp.asarray(2.2), last)
    monkeypatch.setattr(_harmonic_problem, "MOST_AT_ONCE", 0)
    finder.next(jnp.asarray(2.2), last)
    assert often == [5, 2]


def test_the_way_down_has_what_the_way_up_has_found(monkeypatch):
    """Newton's method takes no step, and multipliers are not found anew; nor at halves of a way."""
    speeds, judged = (2.2, 2.25, 2.6), []
    found = monodromy_of
    monkeypatch.setattr(_sweep, "monodromy_of", lambda *own: judged.append(own) or found(*own))

    def way(finder, speeds):
        points, last = [], None
        for speed in speeds:
            last = finder.next(jnp.asarray(speed), last)
            points.append(last)
        return points

    finder = Finder(cases.sdof_parametric(steps=200), METHODS["harmonic"])
    up = way(finder, speeds)
    first = len(judged)
    assert len(up) <= first <= sum(len(each) for each in finder.found.all.values())
    down = way(finder, speeds[::-1])
    assert len(judged) == first
    alone = way(Finder(finder.system, METHODS["harmonic"]), speeds[::-1])
    # The way down begins at rest, as a machine does.
    assert all(
        int(each.orbit.steps) == 1 or any(each.orbit is x.orbit for x in up) for each in down[1:]
    )
    for one, other, third in zip(up, down[::-1], alone[::-1], strict=True):
        np.testing.assert_allclose(other.orbit.place, third.orbit.place, rtol=0.0, atol=1e-7)
        np.testing.assert_array_equal(other.multipliers, one.multipliers)
    # All are known by their harmonics, few whole.
    whole = [each for found in finder.found.all.values() for each in found if each.point]
    assert len(whole) <= 4


def test_the_way_down_is_another_where_it_jumps():
    """Though all that the way up has found is at hand, its multipliers too."""
    system, speeds = cases.sdof_parametric(steps=200), (0.7, 0.75, 0.85)
    finder, found = Finder(system, METHODS["harmonic"]), {}
    for direction in ("up", "down"):
        last = None
        for speed in speeds if direction == "up" else speeds[::-1]:
            last = finder.next(jnp.asarray(speed), last)
            found[direction, speed] = last
    for direction, table in (("up", UP), ("down", DOWN)):
        for speed in speeds[:2] if direction == "up" else speeds[1:]:
            point, expected = found[direction, speed], table[speed][0]
            assert np.std(np.asarray(point.orbit.place)) == pytest.approx(expected, rel=1e-3)
    low, high = (np.abs(found[way, 0.75].multipliers).max() for way in ("up", "down"))
    assert max(low, high) < 1.0
    assert found["up", 0.75].multipliers != pytest.approx(found["down", 0.75].multipliers, rel=0.1)


def test_a_response_is_found_beside_one_that_is_guessed():
    """Close to its own harmonics the same is found; far away none, nor where it is unstable."""
    finder = Finder(cases.sdof_parametric(steps=200), METHODS["harmonic"])
    speed = jnp.asarray(2.3)
    alone = finder.next(speed, None)
    method = HarmonicBalance(harmonics=24)
    balance = harmonic_balance_problem(method, finder.system)
    terms = fourier_coefficients(balance, alone.orbit.place)
    found = finder.beside(speed, 1.02 * terms)
    assert found is not None
    assert found.stable
    assert found.multipliers.size
    np.testing.assert_allclose(found.orbit.place, alone.orbit.place, rtol=1e-9)
    assert finder.is_beside(alone, terms)
    # Three times the vibration, with the same mean.
    far = terms.at[:, 1:].multiply(3.0)
    assert not finder.is_beside(alone, far)
    assert finder.beside(speed, far) is None
    # At 2.0 a machine leaves the response over one cycle for one over two.
    speed = jnp.asarray(2.0)
    orbit, left = method.solve(balance, speed, balance.rest)
    assert bool(orbit.settled)
    assert finder.beside(speed, left) is None


def _ratios(system, speeds, direction) -> list[float]:
    points = sweep(system, speeds, direction)
    assert all(point.stable for point in points)
    return [float(dynamic_ratio(system, point.orbit)) for point in points]


@pytest.mark.slow
def test_a_falling_sweep_in_large_steps_stays_on_its_branch():
    """Newton's method falls off to another stable response, 0.7 of the swing away."""
    system = cases.sdof_rectangular(damping_ratio=0.05, contact_ratio=1.4, steps=128)
    coarse = _ratios(system, [0.85, 0.775, 0.7, 0.625, 0.55], "down")
    fine = _ratios(system, np.linspace(0.85, 0.55, 13), "down")
    np.testing.assert_allclose(coarse, fine[::3], rtol=1e-6)
    assert coarse[-1] > 6.5


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_a_sweep_in_large_steps_goes_where_one_in_small_steps_goes(seed: int):
    """Random oscillators between folds: contact ratio, damping, direction and range by chance."""
    random = np.random.default_rng(seed)
    system = cases.sdof_rectangular(
        damping_ratio=random.uniform(0.03, 0.12),
        contact_ratio=random.uniform(1.25, 1.75),
        steps=96,
    )
    first, last = np.sort(random.uniform(0.4, 1.4, 2))
    speeds = np.linspace(first, max(last, first + 0.2), 5)
    direction = ("up", "down")[seed % 2]
    many = np.linspace(speeds[0], speeds[-1], 65)
    large, small = (sweep(system, own, direction) for own in (speeds, many))
    for coarse, fine in zip(large, small[::16], strict=True):
        assert coarse.settled == fine.settled
        if coarse.settled:
            ratios = [float(dynamic_ratio(system, each.orbit)) for each in (coarse, fine)]
            assert ratios[0] == pytest.approx(ratios[1], rel=1e-5)
