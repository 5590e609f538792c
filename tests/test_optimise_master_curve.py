"""The closed form of the Master Curve, and the valley of a map."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient

import optimise


def _depth(extent, ratio: float = 1.6, deflection: float = 1.0):
    return optimise.master_curve_depth(
        jnp.asarray(extent), jnp.asarray(ratio), jnp.asarray(deflection)
    )


@pytest.mark.parametrize(
    ("extent", "depth"),
    [
        # lambda / (2 lambda - 0.6), lambda = 1.6 Gamma: .36/.12, .4/.2, .48/.36, .56/.52, .6/.6
        (0.225, 3.0),
        (0.25, 2.0),
        (0.3, 4.0 / 3.0),
        (0.35, 0.56 / 0.52),
        (0.375, 1.0),
        # First harmonic: 0.1253332 * 0.9048271 / (0.64 pi * -0.9510565) = -0.0593058
        (0.4, 0.625 / 0.6593058),
        # 0.5877853^2 / (0.8 pi * -0.9510565) = -0.1445411
        (0.5, 0.625 / 0.6445411),
    ],
)
def test_depths_by_hand(extent, depth):
    assert_close(_depth(extent), depth, rtol=1e-6, atol=0.0)
    assert_close(_depth(extent, deflection=14e-6), 14e-6 * depth, rtol=1e-6, atol=0.0)


def test_depth_of_the_accessory_pair():
    """eps 1.42155, Gamma 0.25, deflection 11.6 um: 14.3 um; the thesis took 15."""
    assert_close(_depth(0.25, 1.421555, 11.6), 14.26, rtol=1e-3, atol=0.0)


def test_both_branches_meet():
    """At Gamma* relief starts at the end of single contact, and the depth is the deflection."""
    for ratio in (1.1, 1.42, 1.6, 1.9):
        longest = (ratio - 1.0) / ratio
        beside = _depth([longest - 1e-9, longest + 1e-9], ratio)
        assert_close(beside, jnp.ones(2), rtol=1e-6, atol=0.0)


def test_depth_grows_without_bound_towards_half_the_longest_extent():
    """E/delta = lambda / (2 lambda - (eps - 1)) with lambda = (eps - 1)/2 + h: (eps - 1)/(4 h)."""
    shortest = 0.3 / 1.6
    for beyond in (1e-4, 1e-6):
        assert_close(_depth(shortest + beyond / 1.6), 0.6 / (4 * beyond), rtol=1e-3, atol=0.0)


@pytest.mark.parametrize("share", [0.2, 0.49, 0.499999])
def test_no_depth_will_do_for_short_reliefs(share):
    extent = share * 0.6 / 1.6
    assert bool(jnp.isnan(_depth(extent)))


@pytest.mark.parametrize("ratio", [0.9, 1.0, 2.0, 2.3])
def test_no_depth_outside_one_to_two_pairs(ratio):
    assert bool(jnp.all(jnp.isnan(_depth([0.1, 0.25, 0.4], ratio))))


def test_finite_on_the_whole_range():
    for ratio in (1.05, 1.42, 1.9):
        longest = (ratio - 1.0) / ratio
        extents = jnp.linspace(0.501 * longest, 0.5, 50)
        depths = _depth(extents, ratio)
        assert bool(jnp.all(jnp.isfinite(depths) & (depths > 0.0)))


def test_shape_of_the_extents_is_kept():
    assert _depth(0.25).shape == ()
    assert _depth([[0.25, 0.3, 0.4]] * 2).shape == (2, 3)


@pytest.mark.parametrize("extent", [0.25, 0.45])
def test_depth_is_differentiable(extent):
    arguments = (jnp.asarray(extent), jnp.asarray(1.6), jnp.asarray(12.0))
    assert_gradient(lambda x: optimise.master_curve_depth(*x), arguments, rtol=1e-7)


def test_slope_by_hand():
    """d(lambda / (2 lambda - 0.6)) / dGamma = -1.6 * 0.6 / (2 lambda - 0.6)^2: -24 at 0.25."""
    slope = jax.grad(lambda g: optimise.master_curve_depth(g, jnp.asarray(1.6), jnp.asarray(1.0)))
    assert_close(slope(jnp.asarray(0.25)), -24.0, rtol=1e-12, atol=0.0)


# --- maps


def _valley(depth, extent):
    """Least along depth = 3 + 10 extent, with the value extent there."""
    return (depth - 3.0 - 10.0 * extent) ** 2 + extent


DEPTHS, EXTENTS = np.linspace(0.0, 10.0, 11), np.array([0.1, 0.23, 0.4])


def test_map_has_depth_in_rows_and_extent_in_columns():
    chart, _ = optimise.relief_map(_valley, DEPTHS, EXTENTS)
    assert chart.value.shape == (11, 3)
    expected = (DEPTHS[:, None] - 3.0 - 10.0 * EXTENTS) ** 2 + EXTENTS
    assert_close(chart.value, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("columns", [1, 3, 25])
def test_map_reports_its_progress(columns):
    """More columns than rows too: the valley is evaluated in several batches."""
    counts = []
    extents = np.linspace(0.1, 0.5, columns)
    chart, valley = optimise.relief_map(_valley, DEPTHS, extents, done=counts.append)
    assert counts == [11] * columns
    assert chart.value.shape == (11, columns)
    assert_close(valley.value, extents, rtol=1e-12, atol=0.0)


def test_valley_of_a_parabola_is_exact():
    _, valley = optimise.relief_map(_valley, DEPTHS, EXTENTS)
    assert_close(valley.depth, np.array([4.0, 5.3, 7.0]), rtol=1e-12, atol=0.0)
    assert_close(valley.value, EXTENTS, rtol=1e-12, atol=0.0)
    assert_close(valley.extent, EXTENTS, rtol=0.0, atol=1e-15)


def test_valley_with_a_sharp_bottom_is_close():
    """|x|: within half a step of the finer grid, (2 / 10) / 2."""

    def sharp(depth, extent):
        return jnp.abs(depth - 3.137 - 10.0 * extent)

    _, valley = optimise.relief_map(sharp, DEPTHS, EXTENTS)
    assert np.max(np.abs(valley.depth - (3.137 + 10.0 * EXTENTS))) <= 0.1


def test_valley_at_the_edge_of_the_map():
    _, rising = optimise.relief_map(lambda depth, extent: depth + extent, DEPTHS, EXTENTS)
    assert_close(rising.depth, np.zeros(3), rtol=0.0, atol=1e-15)
    _, falling = optimise.relief_map(lambda depth, extent: extent - depth, DEPTHS, EXTENTS)
    assert_close(falling.depth, np.full(3, 10.0), rtol=1e-15, atol=0.0)


def test_of_depths_that_serve_alike_the_least_is_taken_whatever_the_rounding():
    def response(depth, extent):
        return 2.0 + 0.0 * extent - 1e-13 * depth

    _, valley = optimise.relief_map(response, DEPTHS, EXTENTS)
    assert np.all(valley.depth <= DEPTHS[1])


def test_valley_of_the_closed_form():
    """A map whose valley is the Master Curve gives the Master Curve back."""

    def curve(extent):
        return optimise.master_curve_depth(extent, jnp.asarray(1.42), jnp.asarray(11.6))

    def response(depth, extent):
        return jnp.sqrt(1e-4 + (depth / curve(extent) - 1.0) ** 2)

    extents = np.linspace(0.2, 0.45, 6)
    _, valley = optimise.relief_map(response, np.linspace(0.0, 40.0, 41), extents)
    expected = np.array([float(curve(jnp.asarray(x))) for x in extents])
    assert_close(valley.depth, expected, rtol=1e-3, atol=0.0)


def test_extent_of_the_longest_relief():
    """Gamma* = (eps - 1)/eps: 0.375 at 1.6, beyond which the first harmonic rules."""
    assert math.isclose((1.6 - 1.0) / 1.6, 0.375)
    inside, outside = _depth([0.374, 0.376])
    assert_close(inside, 0.5984 / 0.5968, rtol=1e-9, atol=0.0)
    run = 0.6016
    sines = math.sin(math.pi * (1.6 - run)) * math.sin(math.pi * run)
    harmonic = 1 - 0.376 - sines / (math.pi * run * math.sin(1.6 * math.pi))
    assert_close(outside, 0.625 / harmonic, rtol=1e-12, atol=0.0)


def _kinked(depth, extent):
    """Of depth 2 over any extent the least square has a kink: slopes -3 below and +1 above it."""
    return jnp.stack([depth - 5.0, 4.0 * jnp.maximum(depth - 2.0, 0.0) + 1.0])


def _many_kinks(depth, extent):
    """Least at a depth that grows with the extent, each of 40 deviations with a kink of its own."""
    at = jnp.linspace(0.5, 4.5, 40)
    beyond = depth - at - extent
    return beyond + 0.3 * jnp.abs(beyond) - 0.2


@pytest.mark.parametrize("start", [0.1, 1.99, 2.0, 2.01, 40.0])
def test_a_kink_is_a_bottom(start):
    counted = []
    deviations = optimise.with_jacobian(lambda x: _kinked(x[0], x[1]))
    sloped = optimise.ValueAndGradient(lambda x: counted.append(1) or deviations(x))
    curve = optimise.traced_curve(sloped, np.array([0.4, 0.3, 0.2]), start)
    assert curve.settled.all()
    assert_close(curve.depth, np.full(3, 2.0), rtol=1e-7, atol=0.0)
    assert_close(curve.rms, np.full(3, np.sqrt(10.0)), rtol=1e-7, atol=0.0)
    assert len(counted) < 40


def test_many_kinks_are_followed_in_few_steps():
    """Against a fine grid; each place is evaluated a dozen times at the most."""
    counted = []
    deviations = optimise.with_jacobian(lambda x: _many_kinks(x[0], x[1]))
    sloped = optimise.ValueAndGradient(lambda x: counted.append(1) or deviations(x))
    extent = np.linspace(0.5, 0.1, 9)
    curve = optimise.traced_curve(sloped, extent, 1.0)
    assert curve.settled.all()
    fine = np.linspace(0.0, 5.0, 5001)
    squares = jax.vmap(lambda d: jnp.sum(_many_kinks(d, extent[0]) ** 2))(jnp.asarray(fine))
    assert_close(curve.depth[0], fine[int(np.argmin(squares))], rtol=0.0, atol=1e-3)
    assert_close(np.diff(curve.depth), np.diff(extent), rtol=0.0, atol=1e-6)
    assert len(counted) < 12 * 9


def test_a_depth_that_changes_nothing_is_no_bottom():
    """Nor is a depth of zero, beyond which the square would fall."""
    nothing = lambda depth, extent: jnp.stack([1.0 + 0.0 * depth, extent])
    curve = optimise.traced_curve(nothing, np.array([0.4, 0.3]), 1.0)
    assert not curve.settled.any()
    below = lambda depth, extent: jnp.stack([depth + 1.0, extent])
    curve = optimise.traced_curve(below, np.array([0.4, 0.3]), 1.0)
    assert not curve.settled.any()
    assert curve.depth[0] == 0.0
