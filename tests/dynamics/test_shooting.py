"""Shooting and Floquet's multipliers."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import cases
from helpers import quick

from jaxgear._dynamics._floquet import floquet_multipliers, monodromy
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import TimeStepping, cycle, quasi_static_start
from jaxgear._dynamics._march_step import march_of
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steady_state import steady_state
from jaxgear._dynamics._step_product import product_of_steps, tangents_of
from jaxgear._dynamics._steppers import Exponential, Midpoint, Newmark
from jaxgear._dynamics._system import modal_basis
from jaxgear._interface._laws import ExactContact, SmoothContact
from jaxgear._response._dynamic import dynamic_ratio


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "stepper"),
    quick(
        1,
        [
            ("exact", Midpoint()),
            ("cell damping", Midpoint()),
            ("bow", Exponential()),
            ("gyroscopic", Exponential()),
        ],
    ),
)
def test_monodromy_is_the_derivative_of_a_cycle(name, stepper):
    system = cases.two_dof(steps=40, load=0.3)
    law = ExactContact()
    if name == "cell damping":
        # Where contact opens at once, a force in proportion to the rate jumps: no derivative.
        system = dataclasses.replace(system, cell_damping=jnp.asarray(0.2))
        system = dataclasses.replace(system, load=10.0 * system.load)
    if name == "gyroscopic":
        turning = jnp.asarray([[0.0, 0.3], [-0.3, 0.0]])
        system = dataclasses.replace(system, gyroscopic=turning)
    if name == "bow":
        system = dataclasses.replace(system, bow=jnp.asarray([[0.1, 0.0], [0.0, 0.5]]))
    modes = modal_basis(system)
    speed = jnp.asarray(0.9)
    ready = march_of(stepper, law, system, modes, speed)
    start = quasi_static_start(system)

    def over(state):
        begun = eqx.tree_at(lambda c: c.state, ready.begin(start), state)
        return cycle(ready, begun, system.table)[0].state

    orbit = jax.jit(
        lambda: steady_state(system, speed, Shooting(stepper=stepper, law=law, warm_up=5))
    )()
    onto = modes.shape.T @ system.mass
    state = orbit.start @ onto.T
    ours = jax.jit(lambda o: product_of_steps(ready, tangents_of(ready, o.place)))(orbit)
    expected = jax.jit(jax.jacfwd(over))(state).reshape(4, 4)
    np.testing.assert_allclose(ours, expected, rtol=1e-8, atol=1e-9)


@pytest.mark.slow
def test_multipliers_shrink_as_damping_says():
    """Liouville: their product is exp(- integral of the trace of M^-1 C), whatever the contact."""
    system = cases.two_dof(steps=40, load=0.3)
    modes = modal_basis(system)
    speed = jnp.asarray(0.9)
    method = HarmonicBalance(harmonics=12)
    orbit = jax.jit(lambda: steady_state(system, speed, method))()
    found = floquet_multipliers(monodromy(system, modes, orbit), modes)
    period = float(system.mesh_period(speed))
    np.testing.assert_allclose(
        np.prod(found).real, np.exp(-period * float(jnp.sum(modes.damping))), rtol=1e-3
    )
    assert np.all(np.diff(np.abs(found)) <= 1e-12)


@pytest.mark.slow
def test_multipliers_without_contact_are_those_of_the_modes():
    system = cases.sdof_driven(load=10.0, damping_ratio=0.05)
    modes = modal_basis(system)
    speed = jnp.asarray(0.37)
    orbit = jax.jit(lambda: steady_state(system, speed))()
    found = floquet_multipliers(monodromy(system, modes, orbit), modes)
    root = -0.05 + 1j * np.sqrt(1.0 - 0.05**2)
    expected = np.exp(np.array([root, np.conj(root)]) * 2.0 * np.pi / 0.37)
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), rtol=1e-9)


@pytest.mark.slow
def test_period_two_and_the_unstable_orbit_between():
    """Near twice the resonance the period-1 orbit looks harmless, and no machine stays on it."""
    system = cases.sdof_parametric(steps=200)
    modes = modal_basis(system)
    speed = jnp.asarray(2.0)
    start = jnp.asarray([[1.0], [0.5]])
    one, two = (
        jax.jit(
            lambda s, m=multiple: steady_state(
                system, speed, Shooting(multiple=m, warm_up=30 * (m - 1)), s
            )
        )(start)
        for multiple in (1, 2)
    )
    assert bool(one.settled)
    assert bool(two.settled)
    harmless = floquet_multipliers(monodromy(system, modes, one), modes)
    assert harmless[0].real < -1.05
    assert np.abs(floquet_multipliers(monodromy(system, modes, two), modes)[0]) < 1.0
    assert float(jnp.max(one.place)) < 1.4
    # Table B5 (a): displacement of the sub-harmonic response.
    np.testing.assert_allclose(float(jnp.std(two.place)), 0.99289, rtol=1e-3)
    np.testing.assert_allclose(float(jnp.max(two.place)), 2.42641, rtol=1e-3)


@pytest.mark.slow
def test_multipliers_converge_where_contact_is_lost():
    """The unstable orbit between the branches of B5 (a) at 0.75: largest multiplier 1.7445."""
    speed = jnp.asarray(0.75)
    errors = []
    for steps in (100, 400):
        system = cases.sdof_parametric(steps=steps)
        modes = modal_basis(system)
        start = jnp.asarray([[-1.29308155], [-0.80713277]])
        method = Shooting(warm_up=0)
        orbit = jax.jit(lambda s, m=method, y=system: steady_state(y, speed, m, s))(start)
        assert bool(orbit.settled)
        found = floquet_multipliers(monodromy(system, modes, orbit), modes)
        errors.append(abs(found[0].real - 1.7445))
    assert errors[1] < 2e-3
    assert errors[0] < 2e-2


def test_shooting_needs_its_load_in_mid_step():
    with pytest.raises(ValueError, match="`Midpoint` or `Exponential`"):
        Shooting(stepper=Newmark())


@pytest.mark.slow
def test_smooth_contact_shoots_as_well():
    system = cases.two_dof(steps=40, load=0.3)
    method = Shooting(law=SmoothContact(0.05), warm_up=10)
    orbit = jax.jit(lambda: steady_state(system, jnp.asarray(0.9), method))()
    assert bool(orbit.settled)
    assert float(orbit.residual) < 1e-9


@pytest.mark.parametrize("derivative", quick(1, [jax.jacfwd, jax.grad]))
@pytest.mark.parametrize(
    ("name", "method"), [("shooting", Shooting()), ("marching", TimeStepping(cycles=2))]
)
def test_derivatives_by_methods_that_march_are_refused_with_what_to_use(derivative, name, method):
    system = cases.sdof_rectangular(damping_ratio=0.08, steps=32)
    ratio = lambda speed: dynamic_ratio(system, steady_state(system, speed, method))
    with pytest.raises(ValueError, match=rf"{name} have no derivatives.*`HarmonicBalance`"):
        derivative(ratio)(jnp.asarray(0.8))
