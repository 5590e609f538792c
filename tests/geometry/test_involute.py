import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient

import jaxgear as jg
from jaxgear import deg

_ANGLES = np.linspace(5.0, 55.0, 41) * deg


# From tan(a) - a to more digits than any table prints; 20 degrees is 0.014904 in every handbook.
@pytest.mark.parametrize(
    ("degrees", "value"),
    [
        (14.5, 0.005544842817),
        (20.0, 0.014904383867),
        (25.0, 0.029975345156),
        (30.0, 0.053751493591),
        (45.0, 0.214601836603),
    ],
)
def test_involute_by_hand(degrees, value):
    assert_close(jg.involute(jnp.asarray(degrees * deg)), value, rtol=1e-9, atol=0.0)


def test_involute_is_the_unwound_string():
    """Unwinding a string from the base circle by a roll angle turns the point by its involute."""
    roll = 0.7
    turn = np.linspace(0.0, roll, 2_000_001)
    # The end of the string moves along itself turned by 90 degrees, at a speed of its length.
    x = np.trapezoid(turn * np.cos(turn), turn) + 1.0
    y = np.trapezoid(turn * np.sin(turn), turn)
    assert_close(jg.involute(jnp.arctan(jnp.asarray(roll))), np.arctan2(y, x), rtol=1e-10, atol=0.0)


def test_inverse_undoes_the_involute():
    there_and_back = jg.inverse_involute(jg.involute(jnp.asarray(_ANGLES)))
    assert_close(there_and_back, _ANGLES, rtol=1e-13, atol=0.0)


def test_inverse_for_the_thinnest_angles():
    """To leading orders inv(a) = a^3/3 + 2 a^5/15."""
    angle = 0.03
    value = angle**3 / 3.0 + 2.0 * angle**5 / 15.0 + 17.0 * angle**7 / 315.0
    assert_close(jg.inverse_involute(jnp.asarray(value)), angle, rtol=1e-9, atol=0.0)


def test_inverse_keeps_shapes():
    assert jg.inverse_involute(jnp.full((2, 3), 0.015)).shape == (2, 3)


@pytest.mark.parametrize("degrees", [8.0, 20.0, 35.0])
def test_derivatives_of_the_inverse(degrees):
    """First and second derivative of the inverse function, from those of the involute."""
    tan = np.tan(degrees * deg)
    value = jnp.asarray(tan - degrees * deg)
    slope = jax.grad(jg.inverse_involute)
    assert_close(slope(value), 1.0 / tan**2, rtol=1e-12, atol=0.0)
    bend = -2.0 * (1.0 + tan**2) / tan**5
    assert_close(jax.grad(slope)(value), bend, rtol=1e-10, atol=0.0)


def test_gradients():
    # One relative step has to suit all of them.
    angles = jnp.asarray(np.linspace(18.0, 30.0, 7) * deg)
    assert_gradient(lambda a: jnp.sum(jg.involute(a) ** 2), angles, rtol=1e-7)
    assert_gradient(lambda q: jnp.sum(jg.inverse_involute(q) ** 2), jg.involute(angles), rtol=1e-7)


def test_one_trace():
    inverse = eqx.filter_jit(eqx.debug.assert_max_traces(jg.inverse_involute, max_traces=1))
    for value in (0.01, 0.02, 0.03):
        inverse(jnp.asarray(value))
