"""Largest forces at the limits of time steps, where a tooth's entry makes the force jump."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics.cases import sdof_rectangular
from helpers import observed_order, quick

import jaxgear as jg
from jaxgear._response._dynamic import _at_starts

STEPS = (64, 128, 256, 512)


def _ratio(steps: int, *, limits: bool) -> float:
    """Dynamic ratio of an oscillator whose stiffness jumps, at 0.3 of its natural frequency."""
    system = sdof_rectangular(damping_ratio=0.08, contact_ratio=1.4, steps=steps)
    orbit = jg.steady_state(system, jnp.asarray(0.3), jg.Shooting())
    assert bool(orbit.settled)
    if limits:
        return float(jg.dynamic_ratio(system, orbit))
    return float(jnp.max(jg.contact_force(system, orbit)) / system.force)


@pytest.mark.slow
def test_a_peak_at_tooth_entry_converges_with_order_two():
    true = _ratio(2048, limits=True)
    errors = [abs(_ratio(steps, limits=True) - true) for steps in STEPS]
    assert observed_order([1.0 / steps for steps in STEPS], errors) == pytest.approx(2.0, abs=0.15)
    assert errors[1] < 0.003 * true
    # In mid-steps alone the peak is missed by a part of the step.
    assert 1.0 - _ratio(128, limits=False) / true > 0.02


@pytest.mark.slow
@pytest.mark.parametrize("jump", quick(1, [0.0, 3.0]))
def test_values_at_the_starts_of_uneven_steps(jump):
    """Exact for parabolas on even steps also where the second derivative jumps."""
    lengths = np.asarray([0.02] * 20 + [0.01] * 40 + [0.02] * 10)
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    wave = lambda t: np.sin(2 * np.pi * t) + jump * np.maximum(t - starts[30], 0.0) ** 2
    middles = jnp.asarray(wave(starts + 0.5 * lengths))[:, None]
    found = _at_starts(jnp.asarray(lengths), middles, jnp.asarray(True))[:, 0]
    inside = slice(2, -1)
    np.testing.assert_allclose(found[inside], wave(starts)[inside], atol=3e-5)
    # What does not close is not interpolated across its seam.
    open_ended = _at_starts(jnp.asarray(lengths), middles, jnp.asarray(False))[:, 0]
    np.testing.assert_array_equal(open_ended[:2], middles[:2, 0])
    np.testing.assert_array_equal(open_ended[inside], found[inside])


@pytest.mark.slow
def test_derivatives_pass_through_the_limits():
    system = sdof_rectangular(damping_ratio=0.08, contact_ratio=1.4, steps=96)
    method = jg.HarmonicBalance(harmonics=12, averaged=True)
    ratio = jax.jit(
        lambda v: jg.smooth_dynamic_ratio(
            system, jg.steady_state(system, v, method), jnp.asarray(0.02)
        )
    )
    step = 1e-5
    central = (float(ratio(1.2 + step)) - float(ratio(1.2 - step))) / (2.0 * step)
    assert float(jax.grad(ratio)(1.2)) == pytest.approx(central, rel=1e-6)
