"""Searches in a box: where they end, what they count, what they refuse."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close

import optimise

BOX = optimise.Box([-2.0, 0.0], [2.0, 10.0])
INSIDE = np.array([0.5, 7.0])


def _bowl(x):
    """Least at (0.5, 7): inside the box."""
    return 3.0 * (x[0] - 0.5) ** 2 + 0.1 * (x[1] - 7.0) ** 2 + 1.25


def _far_bowl(x):
    """Least at (5, -3), outside: the nearest corner (2, 0) wins, 9 + 9 + 1."""
    return (x[0] - 5.0) ** 2 + (x[1] + 3.0) ** 2 + 1.0


def _rosenbrock(x):
    return 100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2


GRADIENT = {"lbfgs": optimise.lbfgs, "adam": optimise.adam}
every_gradient = pytest.mark.parametrize("search", GRADIENT.values(), ids=GRADIENT.keys())


def _assert_consistent(result: optimise.SearchResult, box: optimise.Box) -> None:
    """Bounds, shapes, and that the best is the least of the record."""
    count = len(result.values)
    assert result.path.shape == (count, len(box.lower))
    assert result.values.shape == (count,)
    assert result.evaluations == count
    slack = 1e-12 * (box.upper - box.lower)
    assert np.all(result.path >= box.lower - slack)
    assert np.all(result.path <= box.upper + slack)
    assert result.value == np.min(result.values)
    assert np.any(np.all(np.isclose(result.path, result.point, rtol=1e-12, atol=1e-12), axis=1))
    assert result.reason


# --- the box


def test_unit_cube_by_hand():
    assert_close(BOX.to_unit(np.array([1.0, 2.5])), np.array([0.75, 0.25]), rtol=1e-15, atol=0.0)
    assert_close(BOX.from_unit(np.array([0.75, 0.25])), np.array([1.0, 2.5]), rtol=1e-15, atol=0.0)


def test_points_outside_move_to_the_nearest_face():
    assert_close(BOX.to_unit(np.array([-9.0, 25.0])), np.array([0.0, 1.0]), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("lower", "upper"),
    [([0.0, 1.0], [1.0, 1.0]), ([0.0, 3.0], [1.0, 2.0]), ([0.0, math.nan], [1.0, 2.0])],
)
def test_an_empty_box_is_refused(lower, upper):
    with pytest.raises(ValueError, match="Every lower bound must be below its upper bound"):
        optimise.Box(lower, upper)


# --- gradient searches


def test_a_search_that_may_not_go_on_says_so():
    result = optimise.lbfgs(_rosenbrock, np.array([-1.2, 1.0]), BOX, most_evaluations=3)
    assert not result.converged
    assert result.reason == "the evaluations allowed are spent"


@every_gradient
def test_bowl_inside_the_box(search):
    result = search(_bowl, np.array([-1.5, 1.0]), BOX, most_evaluations=300)
    _assert_consistent(result, BOX)
    assert result.gradient_evaluations == result.evaluations
    assert result.converged
    assert_close(result.point, INSIDE, rtol=1e-3, atol=0.0)
    assert_close(result.value, 1.25, rtol=1e-5, atol=0.0)


def test_lbfgs_finds_a_bowl_in_few_evaluations():
    result = optimise.lbfgs(_bowl, np.array([-1.5, 1.0]), BOX)
    assert result.evaluations < 15
    assert_close(result.point, INSIDE, rtol=1e-6, atol=0.0)


@every_gradient
def test_minimum_outside_ends_at_the_corner(search):
    result = search(_far_bowl, np.array([0.0, 5.0]), BOX, most_evaluations=200)
    _assert_consistent(result, BOX)
    assert_close(result.point, np.array([2.0, 0.0]), rtol=1e-9, atol=1e-9)
    assert_close(result.value, 19.0, rtol=1e-9, atol=0.0)


@every_gradient
def test_start_outside_is_moved_inside(search):
    result = search(_bowl, np.array([-30.0, 400.0]), BOX, most_evaluations=20)
    _assert_consistent(result, BOX)
    assert_close(result.path[0], np.array([-2.0, 10.0]), rtol=1e-14, atol=0.0)


def test_lbfgs_descends_the_rosenbrock_valley():
    box = optimise.Box([-2.0, -1.0], [2.0, 3.0])
    result = optimise.lbfgs(_rosenbrock, np.array([-1.2, 1.0]), box, most_evaluations=100)
    _assert_consistent(result, box)
    assert result.converged
    assert_close(result.point, np.ones(2), rtol=1e-4, atol=0.0)


def test_lbfgs_stops_at_a_wall_of_the_rosenbrock_valley():
    """With x <= 0.5 the least is at (0.5, 0.25): 0.25."""
    box = optimise.Box([-2.0, -1.0], [0.5, 3.0])
    result = optimise.lbfgs(_rosenbrock, np.array([-1.2, 1.0]), box, most_evaluations=100)
    _assert_consistent(result, box)
    assert_close(result.point, np.array([0.5, 0.25]), rtol=1e-5, atol=0.0)
    assert_close(result.value, 0.25, rtol=1e-8, atol=0.0)


@every_gradient
def test_budget_of_evaluations_is_kept(search):
    """A line search is finished, so a few more than asked for."""
    box = optimise.Box([-2.0, -1.0], [2.0, 3.0])
    result = search(_rosenbrock, np.array([-1.2, 1.0]), box, most_evaluations=8)
    assert 8 <= result.evaluations <= 8 + 20
    assert not result.converged


def test_adam_makes_exactly_its_budget():
    result = optimise.adam(_bowl, np.array([0.0, 0.0]), BOX, most_evaluations=37)
    assert result.evaluations == 37


@every_gradient
def test_watcher_sees_every_evaluation(search):
    seen = []
    result = search(
        _bowl,
        np.array([1.0, 1.0]),
        BOX,
        most_evaluations=12,
        watch=lambda point, value: seen.append((point, value)),
    )
    assert_close(np.stack([point for point, _ in seen]), result.path, rtol=1e-15, atol=1e-15)
    assert_close(np.array([value for _, value in seen]), result.values, rtol=1e-15, atol=0.0)


@every_gradient
def test_values_belong_to_their_points(search):
    result = search(_bowl, np.array([1.0, 1.0]), BOX, most_evaluations=12)
    expected = [float(_bowl(jnp.asarray(point))) for point in result.path]
    assert_close(result.values, np.array(expected), rtol=1e-13, atol=0.0)


@every_gradient
def test_an_impossible_design_stops_the_search_and_names_it(search):
    """sqrt of a negative number beyond x = 1: the point is in the message."""

    def impossible(x):
        return jnp.sqrt(1.0 - x[0]) + x[1]

    with pytest.raises(FloatingPointError, match=r"not finite at \[1\.5, 4\.0\]"):
        search(impossible, np.array([1.5, 4.0]), BOX)


@every_gradient
def test_a_gradient_that_is_not_finite_stops_the_search(search):
    with pytest.raises(FloatingPointError, match="objective or its gradient is not finite"):
        search(lambda x: jnp.sqrt(x[0] ** 2) + x[1], np.array([0.0, 4.0]), BOX)


# --- without gradients


def test_differential_evolution_agrees_with_the_gradient_search():
    by_gradient = optimise.lbfgs(_bowl, np.array([-1.5, 1.0]), BOX)
    result = optimise.differential_evolution(_bowl, BOX, seed=3)
    _assert_consistent(result, BOX)
    assert result.gradient_evaluations == 0
    assert result.evaluations > 3 * by_gradient.evaluations
    assert_close(result.point, by_gradient.point, rtol=3e-2, atol=0.0)


def test_differential_evolution_leaves_a_local_minimum():
    """Two dents; the deeper one is at x = 1.5."""

    def dents(x):
        shallow = 0.5 * jnp.exp(-8.0 * (x[0] + 1.0) ** 2)
        return 1.0 - jnp.exp(-8.0 * (x[0] - 1.5) ** 2) - shallow + 1e-3 * (x[1] - 5.0) ** 2

    caught = optimise.lbfgs(dents, np.array([-1.2, 5.0]), BOX)
    assert_close(caught.point[0], -1.0, rtol=1e-2, atol=0.0)
    free = optimise.differential_evolution(dents, BOX, seed=1)
    assert_close(free.point[0], 1.5, rtol=1e-2, atol=0.0)


def test_differential_evolution_repeats_itself():
    runs = [
        optimise.differential_evolution(_bowl, BOX, seed=5, most_generations=5) for _ in range(2)
    ]
    assert_close(runs[1].path, runs[0].path, rtol=0.0, atol=1e-15)
    other = optimise.differential_evolution(_bowl, BOX, seed=6, most_generations=5)
    assert float(np.max(np.abs(other.path - runs[0].path))) > 0.1


def test_differential_evolution_counts_its_generations():
    """15 members a variable, the first population and 4 generations: 30 * 5."""
    result = optimise.differential_evolution(_rosenbrock, BOX, most_generations=4, tolerance=0.0)
    assert result.evaluations == 150
    assert not result.converged
