import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient
from scipy.integrate import quad

import jaxgear as jg
from jaxgear._smooth import smooth_ramp_integral

_WIDTH = 0.3
# No point lies on an edge of the corner, where rounding decides between the two sides.
_X = np.linspace(-1.0, 1.0, 399)


# One program each, not one for each of their operations.
_smooth_ramp, _integral, _smooth_maximum = (
    jax.jit(each) for each in (jg.smooth_ramp, smooth_ramp_integral, jg.smooth_maximum)
)


def _ramp(x: float, width: float = _WIDTH) -> float:
    return float(_smooth_ramp(jnp.asarray(x), jnp.asarray(width)))


def _energy(x: float, width: float = _WIDTH) -> float:
    return float(_integral(jnp.asarray(x), jnp.asarray(width)))


# --- smooth_ramp


@pytest.mark.parametrize(
    ("x", "value"),
    [
        # w (1 + x/w)^3 (3 - x/w)/16 with w = 0.3.
        (-0.3, 0.0),
        (-0.15, 0.3 * 0.125 * 3.5 / 16.0),
        (0.0, 0.3 * 3.0 / 16.0),
        (0.15, 0.3 * 3.375 * 2.5 / 16.0),
        (0.3, 0.3),
    ],
)
def test_ramp_by_hand(x, value):
    assert abs(_ramp(x) - value) < 1e-15


def test_no_bias_beyond_the_corner():
    """Outside the width it is the sharp ramp, to the last digit or two."""
    outside = jnp.asarray(_X[np.abs(_X) >= _WIDTH])
    got = _smooth_ramp(outside, jnp.asarray(_WIDTH))
    assert_close(got, np.maximum(outside, 0.0), rtol=2e-16, atol=1e-16)
    assert not np.asarray(got)[np.asarray(outside) < 0.0].any()


def test_ramp_is_convex_monotone_and_above_the_sharp_one():
    x, width = jnp.asarray(_X), jnp.asarray(_WIDTH)
    value = np.asarray(_smooth_ramp(x, width))
    assert (np.diff(value) >= 0.0).all()
    assert (np.diff(value, 2) >= -1e-15).all()
    inside = np.abs(_X) < 0.99 * _WIDTH
    bias = value - np.maximum(_X, 0.0)
    assert (bias[inside] > 0.0).all()
    # Largest at the corner itself.
    assert abs(bias.max() - 3.0 * _WIDTH / 16.0) < 1e-15
    assert abs(_X[np.argmax(bias)]) < 1e-12


@pytest.mark.parametrize("edge", [-1.0, 1.0])
def test_ramp_is_twice_differentiable(edge):
    """Value, slope and bend agree on both sides of either edge; the third derivative may jump."""
    width = jnp.asarray(_WIDTH)
    first = jax.jit(jax.grad(jg.smooth_ramp))
    second = jax.jit(jax.grad(first))
    for derivative, limit in ((first, max(edge, 0.0)), (second, 0.0)):
        for side in (-1e-7, 1e-7):
            value = derivative(jnp.asarray(edge * _WIDTH + side), width)
            assert abs(float(value) - limit) < 1e-5
    # And the bend is not zero all over: at the corner it is 3/(4 w).
    assert_close(second(jnp.zeros(()), width), 0.75 / _WIDTH, rtol=1e-12, atol=0.0)


def test_slope_grows_from_none_to_one():
    x, width = jnp.asarray(_X), jnp.asarray(_WIDTH)
    slope = np.asarray(jax.jit(jax.vmap(jax.grad(jg.smooth_ramp), (0, None)))(x, width))
    assert slope.min() >= 0.0
    assert slope.max() <= 1.0 + 1e-15
    assert (np.diff(slope) >= -1e-15).all()


def test_ramp_tends_to_the_sharp_one():
    """At the corner in proportion to the width; elsewhere at once."""
    for width in (0.1, 0.01, 0.001):
        assert abs(_ramp(0.0, width) - 3.0 * width / 16.0) < 1e-18
        assert abs(_ramp(0.2, width) - 0.2) < 1e-16
        assert _ramp(-0.2, width) == 0.0


def test_ramp_scales():
    """Width and argument are lengths."""
    assert abs(_ramp(37.0 * 0.1, 37.0 * _WIDTH) - 37.0 * _ramp(0.1)) < 1e-13


# --- its integral


@pytest.mark.parametrize("x", [-0.5, -0.3, -0.1, 0.0, 0.2, 0.3, 0.31, 0.9])
def test_energy_is_the_integral(x):
    integral = quad(_ramp, -1.0, x, points=[-_WIDTH, min(x, _WIDTH)], epsabs=1e-14)[0]
    assert abs(_energy(x) - integral) < 1e-13


def test_energy_by_hand():
    """w^2/16 (v^4 - v^5/5) with v = 1 + x/w; beyond the corner x^2/2 + w^2/10."""
    assert abs(_energy(0.0) - 0.09 / 16.0 * 0.8) < 1e-16
    assert abs(_energy(0.7) - (0.245 + 0.009)) < 1e-15
    assert _energy(-0.4) == 0.0


def test_ramp_is_the_slope_of_the_energy():
    x, width = jnp.asarray(_X), jnp.asarray(_WIDTH)
    slope = jax.jit(jax.vmap(jax.grad(smooth_ramp_integral), (0, None)))(x, width)
    assert_close(slope, _smooth_ramp(x, width), rtol=1e-13, atol=1e-15)


# --- smooth_maximum


def test_maximum_by_hand():
    """log(exp 1 + exp 2 + exp 3) = 3.40760596."""
    got = _smooth_maximum(jnp.asarray([1.0, 3.0, 2.0]), jnp.asarray(1.0))
    assert_close(got, 3.4076059644, rtol=1e-10, atol=0.0)


@pytest.mark.parametrize("width", [1e-3, 0.1, 1.0])
def test_maximum_is_an_upper_bound(width):
    x = np.random.default_rng(1).normal(size=(4, 5))
    over = float(_smooth_maximum(jnp.asarray(x), jnp.asarray(width))) - x.max()
    assert 0.0 <= over <= width * np.log(20.0)
    # Attained where all are equal.
    equal = float(_smooth_maximum(jnp.asarray(np.full((4, 5), 2.0)), jnp.asarray(width))) - 2.0
    assert abs(equal - width * np.log(20.0)) < 1e-12


def test_maximum_survives_large_numbers():
    """A pressure over a small width would overflow the exponential."""
    got = _smooth_maximum(jnp.asarray([1.5e9, 1.2e9]), jnp.asarray(1e5))
    assert_close(got, 1.5e9, rtol=1e-12, atol=0.0)


def test_maximum_scales_and_shifts():
    x = np.asarray([0.2, 0.9, 0.7])
    one = np.asarray(_smooth_maximum(jnp.asarray(x), jnp.asarray(0.1)))
    scaled = _smooth_maximum(jnp.asarray(37.0 * x), jnp.asarray(3.7))
    assert_close(scaled, 37.0 * one, rtol=1e-13, atol=0.0)
    assert_close(
        _smooth_maximum(jnp.asarray(x + 5.0), jnp.asarray(0.1)), one + 5.0, rtol=1e-14, atol=0.0
    )


def test_slopes_of_the_maximum_are_shares():
    slope = jax.jit(jax.grad(jg.smooth_maximum))(jnp.asarray([0.2, 0.9, 0.9]), jnp.asarray(0.05))
    assert_close(np.sum(slope), 1.0, rtol=1e-14, atol=0.0)
    assert_close(slope[1:], np.asarray([0.5, 0.5]), rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("function", [jg.smooth_ramp, smooth_ramp_integral, jg.smooth_maximum])
def test_gradients(function):
    """By the argument and by the width."""
    x, width = jnp.asarray([-0.5, -0.2, 0.05, 0.25, 0.8]), jnp.asarray(_WIDTH)
    factors = jnp.asarray([1.0, 0.8, 1.3, 0.6, 1.1])

    def mixed(argument):
        value = function(*argument)
        return value if value.ndim == 0 else jnp.sum(factors * value)

    assert_gradient(mixed, (x, width), rtol=1e-7)


def test_one_trace():
    ramp = eqx.filter_jit(eqx.debug.assert_max_traces(jg.smooth_ramp, max_traces=1))
    for width in (0.1, 0.2):
        ramp(jnp.asarray(_X), jnp.asarray(width))
