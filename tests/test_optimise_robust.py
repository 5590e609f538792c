"""Scatter, quantiles with true gradients, and what each quantity changes."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special
import scipy.stats
from helpers import assert_close, assert_gradient, quick

import optimise

_QUANTITIES = (
    optimise.Quantity("torque", 80.0, 4.0),
    optimise.Quantity("pitch error", 0.0, 2.0, even=True),
)


def test_samples_have_the_moments_that_were_asked_for():
    drawn = optimise.sample(_QUANTITIES, 1024)
    assert drawn.shape == (1024, 2)
    assert_close(drawn.mean(axis=0), np.array([80.0, 0.0]), rtol=0.0, atol=0.01)
    assert_close(drawn.std(axis=0), np.array([4.0, 2.0]), rtol=5e-3, atol=0.0)
    # Even scatter ends at its bounds; normal scatter goes on.
    assert abs(drawn[:, 1]).max() <= 2.0 * math.sqrt(3.0)
    assert abs(drawn[:, 0] - 80.0).max() > 2.5 * 4.0
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 0.02
    assert not np.any(drawn == optimise.sample(_QUANTITIES, 1024, seed=1))
    with pytest.raises(ValueError, match="Take 64 or 128"):
        optimise.sample(_QUANTITIES, 100)


@pytest.mark.parametrize("share", [0.5, 0.95])
def test_quantile_tends_to_that_of_the_distribution(share):
    """Of a normal sample; the width adds a logistic scatter, of variance pi^2/3 w^2."""
    values = jnp.asarray(optimise.sample(_QUANTITIES, 4096)[:, 0])
    for width in (0.4, 0.1):
        found = eqx.filter_jit(optimise.Quantile(share, width))(values)
        wider = math.hypot(4.0, math.pi / math.sqrt(3.0) * width)
        expected = 80.0 + wider * scipy.stats.norm.ppf(share)
        assert_close(found, expected, rtol=0.0, atol=0.03)


@eqx.filter_jit
def _with_slopes(measure, values):
    return jax.value_and_grad(measure)(values)


@pytest.mark.parametrize("share", [0.01, 0.5, 0.95, 0.999])
def test_quantile_has_true_gradients_which_sum_to_one(share):
    """All values moved by as much move the quantile by as much."""
    values = jnp.asarray(np.random.default_rng(3).normal(size=32))
    measure = optimise.Quantile(share, 0.1)
    assert_gradient(measure, values, rtol=1e-6)
    found, slopes = (np.asarray(x) for x in _with_slopes(measure, values))
    assert_close(slopes.sum(), 1.0, rtol=1e-9, atol=0.0)
    moved, _ = _with_slopes(measure, jnp.asarray(np.asarray(values) + 3.0))
    assert_close(np.asarray(moved) - found, 3.0, rtol=1e-9, atol=0.0)
    below = scipy.special.expit((found - np.asarray(values)) / 0.1).mean()
    assert_close(below, share, rtol=1e-9, atol=0.0)


def _bent(x, sample):
    """Deep in the middle where it scatters much, flat aside."""
    return (x[0] - 1.0) ** 2 + sample[0] * jnp.exp(-((x[0] - 1.0) ** 2) / 0.1) + 0.0 * x[1]


def test_the_robust_optimum_has_the_lower_quantile_on_fresh_samples():
    box = optimise.Box([-1.0, 0.0], [3.0, 1.0])
    scatter = (optimise.Quantity("s", -0.2, 0.6),)
    at_mean = lambda x: _bent(x, jnp.asarray([-0.2]))
    nominal = optimise.lbfgs(at_mean, np.array([1.3, 0.5]), box)
    robust = optimise.over_samples(
        _bent, optimise.sample(scatter, 128), optimise.Quantile(0.95, 0.02)
    )
    found = optimise.lbfgs(robust, np.array([1.3, 0.5]), box)
    assert_close(nominal.point[0], 1.0, rtol=0.0, atol=1e-4)
    assert abs(found.point[0] - 1.0) > 0.2
    fresh = optimise.sample(scatter, 1024, seed=7)
    worst = [
        np.quantile([float(_bent(point, s)) for s in fresh], 0.95)
        for point in (nominal.point, found.point)
    ]
    assert worst[1] < 0.7 * worst[0]


@pytest.mark.parametrize("batch", [1, 8])
def test_a_measure_over_samples_by_hand(batch):
    samples = np.array([[1.0], [2.0], [6.0]])
    mean = optimise.over_samples(lambda x, s: x[0] * s[0], samples, optimise.Mean(), batch=batch)
    assert_close(mean(jnp.asarray([2.0])), 6.0, rtol=1e-14, atol=0.0)
    assert_close(jax.grad(mean)(jnp.asarray([2.0])), np.array([3.0]), rtol=1e-14, atol=0.0)


def test_influences_are_sorted_and_within_bounds():
    """f = torque + 3 error: 2 deviations of 4 are 8; even scatter of 2 ends at 3 sqrt(3) 2."""
    found = optimise.influences(lambda x, s: x[0] + s[0] + 3.0 * s[1], np.zeros(1), _QUANTITIES)
    assert found.names == ("pitch error", "torque")
    assert found.nominal == 80.0
    reach = np.array([6.0 * math.sqrt(3.0), 8.0])
    assert_close(found.high - 80.0, reach, rtol=1e-12, atol=0.0)
    assert_close(found.low - 80.0, -reach, rtol=1e-12, atol=0.0)


def test_a_population_keeps_once_what_all_have_in_common():
    drawn = np.array([[1.0, 5.0], [2.0, 6.0], [1.0, 7.0]])
    prepare = lambda d: {"same": jnp.arange(3.0), "own": d[0] * jnp.ones(2)}
    members = optimise.population(prepare, drawn)
    assert members.own["same"] is None
    assert members.shared["own"] is None
    own = np.array([[1.0, 1.0], [2.0, 2.0], [1.0, 1.0]])
    assert_close(members.own["own"], own, rtol=0.0, atol=0.0)
    judge = lambda x, d, kept: jnp.stack(
        [x[0] * jnp.sum(kept["own"]) + d[1], jnp.sum(kept["same"])]
    )
    found = optimise.responses_of(judge, jnp.array([10.0]), members)
    assert_close(found, np.array([[25.0, 3.0], [46.0, 3.0], [27.0, 3.0]]), rtol=1e-14, atol=0.0)


@pytest.mark.parametrize("count", quick(1, [1, 2]))
def test_measured_slopes_are_those_of_the_measures(count):
    """Of each member by itself, and then weighted, or of all at once."""
    samples = optimise.sample(_QUANTITIES, 8)
    members = optimise.Population(jnp.asarray(samples), None, None)

    def judge(x, drawn, kept):
        del kept
        each = [jnp.sin(x[0]) * drawn[0] + x[1] ** 2 * drawn[1], x[0] * x[1] * drawn[1] ** 2]
        return jnp.stack(each[:count])

    measures = [optimise.Quantile(0.9, 0.5), optimise.Mean()][:count]
    at = jnp.array([0.4, 1.3])
    values, slopes = jax.jit(optimise.population_statistics(judge, measures))(at, members)
    whole = lambda x: jnp.stack(
        [
            measure(optimise.responses_of(judge, x, members)[:, place])
            for place, measure in enumerate(measures)
        ]
    )
    assert_close(values, jax.jit(whole)(at), rtol=1e-13, atol=0.0)
    assert_close(slopes, jax.jit(jax.jacrev(whole))(at), rtol=1e-11, atol=0.0)


def test_a_sample_for_a_tornado_and_its_order():
    moved = optimise.one_at_a_time_sample(_QUANTITIES, deviations=1.0)
    assert_close(
        moved,
        np.array([[80.0, 0.0], [76.0, 0.0], [80.0, -2.0], [84.0, 0.0], [80.0, 2.0]]),
        rtol=1e-14,
        atol=0.0,
    )
    found = optimise.ranked(_QUANTITIES, moved[:, 0] + 10.0 * moved[:, 1])
    assert found.names == ("pitch error", "torque")
    assert_close(found.high - found.nominal, np.array([20.0, 4.0]), rtol=1e-12, atol=0.0)
