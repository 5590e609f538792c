"""Damping read from responses: curves by formula, a gear pair's, and curves that cannot be read."""

import math

import cases
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics.cases import sdof_driven

import jaxgear as jg
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._steady_state import steady_states
from jaxgear._response._half_power import Resonance, rayleigh_damping, resonances


def _receptance(frequency, natural, ratio):
    """Displacement of one degree of freedom per static one; several add up as complex numbers."""
    over = frequency / natural
    return 1.0 / (1.0 - over**2 + 2j * ratio * over)


@pytest.mark.parametrize("ratio", [1e-3, 0.02, 0.1, 0.2])
def test_one_degree_of_freedom_comes_back_up_to_the_square_of_its_ratio(ratio):
    """Ends of the bandwidth at r^2 = 1 - 2 xi^2 -+ 2 xi sqrt(1 - xi^2), wherever samples lie."""
    step = 0.31 * ratio
    frequency = 440.0 * np.arange(max(step, 1.0 - 4.1 * ratio), 1.0 + 5.0 * ratio, step)
    (found,) = resonances(frequency, 7.0 * np.abs(_receptance(frequency, 440.0, ratio)))
    middle, half = 1.0 - 2.0 * ratio**2, 2.0 * ratio * math.sqrt(1.0 - ratio**2)
    assert found.lower == pytest.approx(440.0 * math.sqrt(middle - half), rel=1e-9)
    assert found.upper == pytest.approx(440.0 * math.sqrt(middle + half), rel=1e-9)
    assert found.frequency == pytest.approx(440.0 * math.sqrt(middle), rel=1e-9)
    highest = 7.0 / (2.0 * ratio * math.sqrt(1.0 - ratio**2))
    assert found.amplitude == pytest.approx(highest, rel=1e-9)
    assert found.damping_ratio == pytest.approx(ratio * (1.0 + 2.0 * ratio**2), rel=10 * ratio**4)
    assert found.amplification == pytest.approx(0.5 / found.damping_ratio)


def test_an_oscillator_in_motion_shows_its_damping():
    """The first harmonic of its steady motion over speed, of five that excite it."""
    speeds = np.linspace(0.8, 1.25, 19)
    solved = eqx.filter_jit(steady_states)(
        sdof_driven(damping_ratio=0.05), jnp.asarray(speeds), HarmonicBalance(harmonics=6)
    )
    assert np.asarray(solved.settled).all()
    motion = np.asarray(solved.motion)[:, :, 0]
    turns = np.exp(-2j * np.pi * (np.arange(motion.shape[1]) + 0.5) / motion.shape[1])
    (found,) = resonances(speeds / (2.0 * np.pi), np.abs(motion @ turns))
    assert found.damping_ratio == pytest.approx(0.05 * (1.0 + 2.0 * 0.05**2), rel=1e-4)
    assert 2.0 * np.pi * found.frequency == pytest.approx(1.0 - 0.05**2, rel=1e-4)


MASS, STIFFNESS = 40.0, 4e-7


def _pair_resonances():
    """Peaks of the pinion's rotation under a torque that swings, mean mesh stiffness."""
    support, pair = jg.Support(3e8, 3e8, 3e8, 1e5), cases.accessory()
    model = cases.model(pair, 80.0, pinion_support=support, wheel_support=support)
    grid = jg.mesh_grid(pair, phases=8, slices=2)
    damping = jg.RayleighDamping(MASS, STIFFNESS)
    system = eqx.filter_jit(jg.pair_dynamics)(model, grid, damping).system
    mass, rates, stiffness = (
        np.asarray(x) for x in (system.mass, system.damping, system.whole_stiffness)
    )
    frequency = np.geomspace(1200.0, 14000.0, 2500)
    torque = np.eye(len(mass))[5]
    answer = [
        np.linalg.solve(stiffness + 1j * w * rates - w**2 * mass, torque)[5]
        for w in 2.0 * np.pi * frequency
    ]
    return resonances(frequency, np.abs(answer))


@pytest.mark.slow
def test_a_pair_gives_back_its_rayleigh_coefficients():
    found = _pair_resonances()
    assert len(found) == 3
    for each in found:
        omega = 2.0 * np.pi * each.frequency
        ratio = 0.5 * (MASS / omega + STIFFNESS * omega)
        assert each.damping_ratio == pytest.approx(ratio, rel=2e-3)
    damping = rayleigh_damping(found)
    assert float(damping.mass_factor) == pytest.approx(MASS, rel=1e-2)
    assert float(damping.stiffness_factor) == pytest.approx(STIFFNESS, rel=3e-3)


def _measured(frequency, ratio) -> Resonance:
    return Resonance(frequency, ratio, 1.0, frequency * (1 - ratio), frequency * (1 + ratio))


def test_coefficients_are_the_best_that_are_not_negative():
    exact = [
        _measured(f, 0.5 * (25.0 / (2 * np.pi * f) + 2.5e-6 * 2 * np.pi * f))
        for f in (200.0, 1e3, 5e3)
    ]
    damping = rayleigh_damping(exact)
    assert float(damping.mass_factor) == pytest.approx(25.0, rel=1e-9)
    assert float(damping.stiffness_factor) == pytest.approx(2.5e-6, rel=1e-9)
    # Rising faster than frequency: nothing is left for the mass.
    steep = rayleigh_damping([_measured(100.0, 0.001), _measured(200.0, 0.008)])
    assert float(steep.mass_factor) == 0.0
    wanted = 2.0 * (100.0 * 0.001 + 200.0 * 0.008) / (100.0**2 + 200.0**2) / (2.0 * np.pi)
    assert float(steep.stiffness_factor) == pytest.approx(wanted, rel=1e-9)
    # Guilbert's eq. 3.13.
    (one,) = exact[2:]
    alone = rayleigh_damping([one], with_mass=False)
    assert float(alone.stiffness_factor) == pytest.approx(one.damping_ratio / (np.pi * 5e3))
    with pytest.raises(ValueError, match="2 peaks of different frequencies are needed, got 1"):
        rayleigh_damping([one, one])


def test_what_cannot_be_read_is_refused_by_name():
    frequency = np.linspace(50.0, 200.0, 601)
    curve = np.abs(_receptance(frequency, 100.0, 0.02))
    cut = frequency > 98.6
    with pytest.raises(ValueError, match=r"half-power point below the peak at 100 Hz is outside"):
        resonances(frequency[cut], curve[cut])
    near = np.abs(_receptance(frequency, 100.0, 0.02) + _receptance(frequency, 104.0, 0.02))
    with pytest.raises(ValueError, match=r"peaks at 99\.75 and 104\.25 Hz overlap"):
        resonances(frequency, near)
    both = curve + np.abs(_receptance(frequency, 196.0, 0.04))
    with pytest.raises(ValueError, match=r"above the peak at 195\.\d+ Hz is outside"):
        resonances(frequency, both)
    assert len(resonances(frequency, both, throw=False)) == 1
    with pytest.raises(
        ValueError, match=r"samples above half the power of the peak at 100 Hz: 1, at least 3"
    ):
        resonances(frequency[2::9], curve[2::9])
    with pytest.raises(ValueError, match="has no peak between 50 and 99 Hz"):
        resonances(frequency[frequency <= 99.0], curve[frequency <= 99.0])
    with pytest.raises(ValueError, match="must be positive and rise"):
        resonances(frequency[::-1], curve)
    with pytest.raises(ValueError, match="two lists of one length"):
        resonances(frequency, curve[1:])
    with pytest.raises(ValueError, match="finite and not negative"):
        resonances(frequency, -curve)
