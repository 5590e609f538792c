"""Records that outlive a kill, least squares, limits, many starts, falling widths."""

import json
import math
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import scipy
from helpers import assert_close

import optimise
from optimise._strategies import halton, sobol

BOX = optimise.Box([-2.0, 0.0], [2.0, 10.0])
START = np.array([-1.2, 1.0])


def _valley(x):
    """Rosenbrock's, as residuals: least at (1, 1)."""
    return jnp.stack([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def _rosenbrock(x):
    return jnp.sum(_valley(x) ** 2)


# --- records


class _Killed(Exception):
    pass


@pytest.mark.parametrize("cut", [0, 7])
def test_a_killed_search_goes_on_where_it_stopped(tmp_path, cut):
    """The same path as without the kill, and nothing that was known is evaluated again."""
    whole = optimise.lbfgs(_rosenbrock, START, BOX, most_evaluations=25)
    file, seen = tmp_path / "search.jsonl", []

    def kill(point, value):
        seen.append(value)
        if len(seen) == 9:
            raise _Killed

    with pytest.raises(_Killed):
        optimise.lbfgs(_rosenbrock, START, BOX, most_evaluations=25, watch=kill, file=file)
    text = file.read_text()
    assert len(text.splitlines()) == 10
    # A kill may cut a line off.
    file.write_text(text[: len(text) - cut])
    found = optimise.lbfgs(_rosenbrock, START, BOX, most_evaluations=25, file=file)
    assert_close(found.path, whole.path, rtol=0.0, atol=0.0)
    assert len(file.read_text().splitlines()) == 1 + len(whole.path)
    assert all(json.loads(line) for line in file.read_text().splitlines())
    poisoned = lambda x: _rosenbrock(x) * jnp.nan
    again = optimise.lbfgs(poisoned, START, BOX, most_evaluations=25, file=file)
    assert_close(again.path, whole.path, rtol=0.0, atol=0.0)


def test_a_record_of_another_box_is_refused(tmp_path):
    file = tmp_path / "search.jsonl"
    optimise.lbfgs(_rosenbrock, START, BOX, most_evaluations=3, file=file)
    other = optimise.Box([-2.0, 0.0], [2.0, 11.0])
    with pytest.raises(ValueError, match="another box"):
        optimise.lbfgs(_rosenbrock, START, other, most_evaluations=3, file=file)


# --- least squares


def test_least_squares_descend_the_rosenbrock_valley():
    found = optimise.least_squares(_valley, START, BOX)
    assert found.converged
    assert_close(found.point, np.ones(2), rtol=0.0, atol=1e-8)
    assert found.evaluations < 30
    assert found.evaluations < optimise.lbfgs(_rosenbrock, START, BOX).evaluations
    for point, value in zip(found.path, found.values, strict=True):
        assert_close(1.0 + value, 1.0 + _rosenbrock(jnp.asarray(point)), rtol=1e-12, atol=0.0)


def test_least_squares_stop_at_the_wall():
    """With x at most 0.5: y = 0.25, of value 0.25."""
    box = optimise.Box([-2.0, 0.0], [0.5, 10.0])
    found = optimise.least_squares(_valley, START, box, most_evaluations=200, tolerance=1e-12)
    assert_close(found.point, np.array([0.5, 0.25]), rtol=1e-3, atol=0.0)
    assert_close(found.value, 0.25, rtol=1e-3, atol=0.0)


def test_least_squares_name_an_impossible_design():
    with pytest.raises(FloatingPointError, match="Narrow the bounds"):
        optimise.least_squares(lambda x: jnp.log(x), np.array([-1.0, 1.0]), BOX)


# --- limits

_DISC = [optimise.Limit("square of the radius", 1.0, 1.0)]


def _in_disc(x):
    """Least of x + y in the unit disc: (-1, -1) / sqrt 2, by hand."""
    return jnp.stack([x[0] + x[1], x @ x])


def test_limits_are_kept_and_active():
    box = optimise.Box([-2.0, -2.0], [2.0, 2.0])
    found = optimise.constrained(_in_disc, _DISC, np.array([1.5, 1.0]), box)
    assert found.converged
    assert_close(found.point, np.full(2, -math.sqrt(0.5)), rtol=1e-4, atol=0.0)
    assert found.point @ found.point <= 1.0 + 1e-4


def test_limits_that_cannot_be_kept_are_named():
    box = optimise.Box([1.0, 1.0], [2.0, 2.0])
    found = optimise.constrained(_in_disc, _DISC, np.array([1.5, 1.5]), box)
    assert not found.converged
    assert "square of the radius is above 1 by 1 " in found.reason
    assert_close(found.point, np.ones(2), rtol=0.0, atol=1e-6)


def test_evaluations_within_limits_are_counted():
    box = optimise.Box([-2.0, -2.0], [2.0, 2.0])
    found = optimise.constrained(_in_disc, _DISC, np.array([1.5, 1.0]), box, most_evaluations=4)
    assert found.evaluations <= 6
    assert not found.converged


# --- many starts, falling widths


def _two_holes(x):
    """Least near (1, 8), of -2; a local one near (-1, 2), of -1."""
    hole = lambda a, b, depth: depth * jnp.exp(-4.0 * (x[0] - a) ** 2 - 0.5 * (x[1] - b) ** 2)
    return -hole(1.0, 8.0, 2.0) - hole(-1.0, 2.0, 1.0)


def test_many_starts_find_both_holes_the_deeper_first():
    found = optimise.multi_start(_two_holes, BOX, candidates=64, starts=8)
    assert_close(found[0].point, np.array([1.0, 8.0]), rtol=1e-4, atol=0.0)
    assert_close(found[0].value, -2.0, rtol=1e-6, atol=0.0)
    assert any(np.allclose(each.point, [-1.0, 2.0], atol=1e-3) for each in found)
    assert [each.value for each in found] == sorted(each.value for each in found)
    # The local search alone is caught.
    assert optimise.lbfgs(_two_holes, np.array([-1.0, 2.5]), BOX).value > -1.1


def test_many_starts_leave_out_what_cannot_be_evaluated():
    found = optimise.multi_start(
        lambda x: jnp.where(x[0] < 1.5, _two_holes(x), jnp.nan), BOX, starts=2
    )
    assert_close(found[0].value, -2.0, rtol=1e-6, atol=0.0)
    with pytest.raises(FloatingPointError, match="not finite at any of 64 points"):
        optimise.multi_start(lambda x: jnp.nan * x[0], BOX)
    with pytest.raises(FloatingPointError, match="not finite at any of 48 points"):
        optimise.multi_start(lambda x: jnp.nan * x[0], BOX, candidates=48)


_RANDOM = np.random.default_rng(1).random((128, 3))


def test_haltons_sequence_fills_a_cube_evenly():
    # 0, 1, 2, 3 to base 2 and to base 3, mirrored, but for the shift.
    by_hand = np.array([[0.0, 0.0], [1 / 2, 1 / 3], [1 / 4, 2 / 3], [3 / 4, 1 / 9]])
    found = halton(2, 4, 3)
    assert_close((found - found[:1]) % 1.0, by_hand, rtol=1e-14, atol=1e-15)
    even = halton(3, 128, 0)
    assert even.min() >= 0.0
    assert even.max() < 1.0
    uneven = scipy.stats.qmc.discrepancy
    assert uneven(even) < 0.2 * uneven(_RANDOM)
    with pytest.raises(ValueError, match="Take 32 or 64"):
        sobol(3, 48, 0)


def _wrinkled(x, width):
    """A bowl with wrinkles of one, which smoothing of a width of one takes away."""
    wrinkle = jnp.cos(6.0 * jnp.pi * x[0]) * jnp.exp(-8.0 * width**2)
    return (x[0] - 1.0) ** 2 + 0.01 * (x[1] - 3.0) ** 2 - wrinkle


def test_a_width_that_falls_is_not_caught():
    start = np.array([-1.6, 1.0])
    found = optimise.annealed(_wrinkled, (1.0, 0.7, 0.0), start, BOX)
    assert_close(found.value, -1.0, rtol=0.0, atol=1e-6)
    assert found.evaluations == len(found.path)
    at_once = optimise.lbfgs(lambda x: _wrinkled(x, 0.0), start, BOX)
    assert at_once.value > -0.5
    with pytest.raises(ValueError, match="one width"):
        optimise.annealed(_wrinkled, (), start, BOX)


def test_an_evolution_strategy_agrees():
    pytest.importorskip("cma")
    found = optimise.cma_es(_two_holes, BOX, start=np.array([0.5, 7.0]), most_evaluations=600)
    assert_close(found.point, np.array([1.0, 8.0]), rtol=2e-2, atol=0.0)
    assert found.evaluations == len(found.path)
    assert found.gradient_evaluations == 0


def test_each_width_has_its_own_record(tmp_path):
    """The same point with another width has another value; a second search evaluates nothing."""
    objective = lambda x, width: _rosenbrock(x) + width * x[0]
    settings: Any = dict(most_evaluations=12, file=tmp_path / "search.jsonl")
    found = optimise.annealed(objective, [1.0, 0.1], START, BOX, **settings)
    assert len(list(tmp_path.glob("search.*.jsonl"))) == 2
    poisoned = lambda x, width: objective(x, width) * jnp.nan
    again = optimise.annealed(poisoned, [1.0, 0.1], START, BOX, **settings)
    assert_close(again.values, found.values, rtol=0.0, atol=0.0)


# --- before a search


def test_variables_that_change_nothing_are_found():
    """The second acts beyond a place only, the third nowhere."""
    box = optimise.Box([-1.0, 0.0, 2.0], [1.0, 10.0, 3.0])
    start = np.array([0.5, 1.0, 2.5])
    objective = lambda x: x[0] ** 2 + jnp.maximum(x[1] - 5.0, 0.0) + 0.0 * x[2]
    assert optimise.inactive(optimise.with_gradient(objective), start, box) == (2,)
    several = lambda x: jnp.stack([x[0], x[1] * x[0]])
    assert optimise.inactive(optimise.with_jacobian(several), start, box) == (2,)
    all_act = lambda x: jnp.sum(x)
    calls = []
    counted = optimise.with_gradient(all_act)
    watched = optimise.ValueAndGradient(lambda x: (calls.append(x), counted(x))[1])
    assert optimise.inactive(watched, start, box) == ()
    assert len(calls) == 1


def test_a_start_that_is_not_finite_is_said():
    objective = optimise.with_gradient(lambda x: jnp.log(x[0]) + x[1])
    with pytest.raises(FloatingPointError, match=r"where the search starts, at \[-1.2, 1.0\]"):
        optimise.inactive(objective, START, BOX)
