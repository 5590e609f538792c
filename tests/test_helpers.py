"""Every helper must fail where it should: one that never fails proves nothing."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, observed_order


class _Spring(eqx.Module):
    stiffness: jax.Array
    travel: jax.Array
    coils: int = eqx.field(static=True)


def _spring() -> _Spring:
    return _Spring(stiffness=jnp.asarray(3e8), travel=jnp.asarray([2e-6, 5e-6]), coils=4)


def _energy(spring: _Spring) -> jax.Array:
    return 0.5 * spring.coils * spring.stiffness * jnp.sum(spring.travel**2)


# --- assert_close


def test_close_values_pass():
    assert_close(jnp.asarray([1.0, 2.0]), jnp.asarray([1.0, 2.0 + 1e-9]), rtol=1e-8, atol=0.0)
    assert_close({"a": jnp.asarray(1.0)}, {"a": 1.0}, rtol=0.0, atol=0.0)
    assert_close(jnp.asarray([1e-15]), np.zeros(1), rtol=0.0, atol=1e-14)


@pytest.mark.parametrize(
    ("actual", "desired"),
    [
        pytest.param([1.0], [1.0 + 1e-5], id="value"),
        pytest.param([np.nan], [1.0], id="nan"),
        pytest.param([1.0, 1.0], [1.0], id="shape"),
        pytest.param([[1.0]], [1.0], id="rank"),
        pytest.param([1], [1.0], id="integer"),
    ],
)
def test_different_arrays_fail(actual, desired):
    with pytest.raises(AssertionError, match="rtol"):
        assert_close(jnp.asarray(actual), jnp.asarray(desired), rtol=1e-6, atol=1e-12)


def test_different_trees_fail():
    one = jnp.asarray(1.0)
    with pytest.raises(AssertionError):
        assert_close({"a": one}, {"b": one}, rtol=1e-6, atol=0.0)
    with pytest.raises(AssertionError):
        assert_close((one, one), (one,), rtol=1e-6, atol=0.0)
    with pytest.raises(AssertionError):
        assert_close(one, one.astype(jnp.float32), rtol=1e-6, atol=0.0)


@pytest.mark.parametrize(
    ("rtol", "atol"),
    [(0.1, 0.0), (-1e-9, 0.0), (np.nan, 0.0), (1e-6, -1.0), (1e-6, 1.5e10), (1e-6, np.inf)],
)
def test_meaningless_tolerances_are_refused(rtol, atol):
    with pytest.raises(ValueError, match="must mean something"):
        assert_close(jnp.asarray([1.0]), jnp.asarray([1.0]), rtol=rtol, atol=atol)


def test_a_desired_value_that_is_not_a_number_is_refused():
    with pytest.raises(ValueError, match="nan"):
        assert_close(jnp.asarray([np.nan]), jnp.asarray([np.nan]), rtol=1e-6, atol=1e-12)


# --- assert_gradient


def test_a_true_gradient_passes():
    assert_gradient(_energy, _spring(), rtol=1e-8)


@jax.custom_jvp
def _wrong_both(x):
    return jnp.sum(x**2)


_wrong_both.defjvp(lambda x, dx: (_wrong_both(*x), 1.001 * jnp.vdot(2 * x[0], dx[0])))


def test_a_wrong_derivative_fails():
    with pytest.raises(AssertionError, match="central"):
        assert_gradient(_wrong_both, jnp.asarray([1.0, 2.0]), rtol=1e-4)


def test_a_hidden_stop_gradient_fails():
    def half_blind(x):
        return jnp.sum(x * jax.lax.stop_gradient(x))

    with pytest.raises(AssertionError, match="central"):
        assert_gradient(half_blind, jnp.asarray([1.0, 2.0]), rtol=1e-4)


def test_a_gradient_stopped_altogether_fails_and_is_not_called_flat():
    with pytest.raises(AssertionError, match="reverse 0"):
        assert_gradient(lambda x: jax.lax.stop_gradient(x), jnp.asarray(2.0), rtol=1e-4)


def test_reverse_that_differs_from_forward_fails():
    # Of the two rules of a `custom_jvp` reverse is the transpose, so they cannot be told apart
    # through JAX's own door; a linear solve with the wrong transpose is the way that they do.
    def solve(x):
        return jax.lax.custom_linear_solve(
            lambda v: 2.0 * v, x, lambda _, b: b / 2.0, lambda _, b: b / 2.5
        )

    with pytest.raises(AssertionError, match="reverse"):
        assert_gradient(solve, jnp.asarray(2.0), rtol=1e-4)


def test_a_gradient_that_is_not_finite_fails():
    def cone(x):
        return jnp.sqrt(jnp.sum((x - x) ** 2)) + jnp.sum(x)

    with pytest.raises(AssertionError, match="nan"):
        assert_gradient(cone, jnp.asarray([1.0, 2.0]), rtol=1e-4)


def test_a_wrong_small_leaf_fails():
    # One step common to both leaves would leave the travel, 1e-6 m, out of sight.
    def blind_to_travel(spring):
        return _energy(eqx.tree_at(lambda s: s.travel, spring, replace_fn=jax.lax.stop_gradient))

    with pytest.raises(AssertionError, match="central"):
        assert_gradient(blind_to_travel, _spring(), rtol=1e-6)


@pytest.mark.parametrize("argument", [{}, {"teeth": 20}, jnp.asarray([1, 2]), jnp.zeros((0,))])
def test_nothing_to_differentiate_is_refused(argument):
    with pytest.raises(ValueError, match="Nothing to differentiate"):
        assert_gradient(lambda _: jnp.asarray(1.0), argument, rtol=1e-6)


def test_a_number_that_gets_no_gradient_is_refused():
    argument = {"seen": jnp.asarray(1.0), "hidden": 2.0}
    with pytest.raises(ValueError, match="gets no gradient"):
        assert_gradient(lambda x: x["seen"] * x["hidden"], argument, rtol=1e-6)


def test_a_flat_direction_is_refused():
    with pytest.raises(ValueError, match="flat"):
        assert_gradient(lambda x: 0.0 * x + 1.0, jnp.asarray(2.0), rtol=1e-6)
    # Not flat, but drowned by a large constant: central differences would see only rounding.
    with pytest.raises(ValueError, match="flat"):
        assert_gradient(lambda x: x + 1e9, jnp.asarray(2.0), rtol=1e-6)


def test_a_leaf_of_zeros_needs_a_size():
    argument = (jnp.asarray(1.0), jnp.zeros(2))

    def quadratic(x):
        return x[0] ** 2 + jnp.sum(jnp.sin(x[1]))

    with pytest.raises(ValueError, match="has no size"):
        assert_gradient(quadratic, argument, rtol=1e-6)
    assert_gradient(quadratic, argument, scale=(1.0, 0.1), rtol=1e-6)


@pytest.mark.parametrize(("rtol", "step"), [(0.0, 1e-5), (0.5, 1e-5), (1e-6, 0.0), (1e-6, 1.0)])
def test_a_meaningless_gradient_tolerance_is_refused(rtol, step):
    with pytest.raises(ValueError, match="must mean something"):
        assert_gradient(_energy, _spring(), rtol=rtol, step=step)


# --- observed_order


def test_order_of_a_power():
    sizes = np.asarray([0.1, 0.05, 0.025])
    assert_close(observed_order(sizes, 3.0 * sizes**2), 2.0, rtol=1e-12, atol=0.0)


def test_errors_at_the_rounding_floor_fail():
    with pytest.raises(AssertionError, match="rounding floor"):
        observed_order([0.1, 0.05, 0.025], [1e-13, 2.5e-14, 6e-15])
    with pytest.raises(AssertionError, match="rounding floor"):
        observed_order([0.1, 0.05, 0.025], [1e-2, 0.0, 0.0])


def test_errors_off_a_line_fail():
    with pytest.raises(AssertionError, match="off a line"):
        observed_order([0.1, 0.05, 0.025], [1e-2, 2.5e-3, 2.4e-3])


def test_errors_that_are_not_finite_fail():
    with pytest.raises(AssertionError, match="not finite"):
        observed_order([0.1, 0.05, 0.025], [1e-2, np.nan, 1e-3])


@pytest.mark.parametrize(
    ("sizes", "errors"),
    [
        ([0.1, 0.05], [1e-2, 1e-3]),
        ([0.1, 0.1, 0.05], [1e-2, 1e-2, 1e-3]),
        ([0.1, 0.05, 0.02], [1e-2, 1e-3]),
        ([0.1, 0.0, -0.1], [1e-2, 1e-3, 1e-4]),
    ],
)
def test_sizes_without_a_line_are_refused(sizes, errors):
    with pytest.raises(ValueError, match=r"Give one error|must be positive"):
        observed_order(sizes, errors)
