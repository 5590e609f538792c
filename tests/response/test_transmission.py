"""Statistics over phases of unequal weight, on signals made by hand."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, observed_order
from solve_cases import ACCESSORY, POWER, run_cycle, symmetric_relief

import jaxgear as jg
from jaxgear import um

_SYSTEM = eqx.filter_jit(jg.pair_system)(ACCESSORY.pair(), jnp.asarray(80.0))


def _cycle(phase, weight) -> jg.MeshCycle:
    """A cycle of one cell that only carries phases and weights."""
    count = len(phase)
    lines = jg.ContactLines(
        phase=jnp.asarray(phase),
        weight=jnp.asarray(weight),
        tooth=jnp.zeros((count, 1), int),
        roll=jnp.ones((count, 1, 1)),
        face_position=jnp.zeros(1),
        fraction=jnp.ones((count, 1, 1)),
        length=jnp.asarray(0.01),
        complete=jnp.asarray(True),
    )
    one = jnp.ones((count, 1))
    return jg.MeshCycle(
        system=_SYSTEM,
        cells=jg.MeshCells(lines, jnp.ones((count, 1, 1)), one, None, one),
        approach=jnp.linspace(1.0, 2.0, count),
        load=jnp.ones((count, 2)),
        overlap=one,
        force=one,
        converged=jnp.ones(count, bool),
        steps=jnp.ones(count, int),
    )


THREE = _cycle([0.1, 0.35, 0.75], [0.2, 0.3, 0.5])
VALUES = jnp.asarray([4.0, 1.0, 2.0])


def _uniform(count: int) -> jg.MeshCycle:
    return _cycle((np.arange(count) + 0.5) / count, np.full(count, 1.0 / count))


def test_mean_variance_and_rms_by_hand():
    """0.2 4 + 0.3 1 + 0.5 2 = 2.1; squares 3.61, 1.21, 0.01 weigh 0.722 + 0.363 + 0.005."""
    assert_close(jg.cycle_mean(THREE, VALUES), 2.1, rtol=1e-14, atol=0.0)
    assert_close(jg.cycle_variance(THREE, VALUES), 1.09, rtol=1e-14, atol=0.0)
    assert_close(jg.cycle_rms(THREE, VALUES), math.sqrt(1.09), rtol=1e-14, atol=0.0)


def test_variance_ignores_a_constant_and_squares_a_factor():
    variance = jg.cycle_variance(THREE, VALUES)
    assert_close(jg.cycle_variance(THREE, VALUES + 7.0), variance, rtol=1e-12, atol=0.0)
    assert_close(jg.cycle_variance(THREE, -3.0 * VALUES), 9.0 * variance, rtol=1e-13, atol=0.0)


def test_slope_of_the_variance_by_hand():
    """2 w_i (x_i - mean); finite where the variance vanishes."""
    slope = jax.grad(lambda x: jg.cycle_variance(THREE, x))
    expected = 2 * jnp.asarray([0.2, 0.3, 0.5]) * (VALUES - 2.1)
    assert_close(slope(VALUES), expected, rtol=1e-13, atol=0.0)
    assert_close(slope(jnp.full(3, 5.0)), jnp.zeros(3), rtol=0.0, atol=1e-15)


def test_peak_to_peak_by_hand():
    assert_close(jg.peak_to_peak(VALUES), 3.0, rtol=1e-15, atol=0.0)


@pytest.mark.parametrize("width", [1.0, 0.1, 1e-3])
def test_smooth_peak_to_peak_is_an_upper_bound(width):
    """By at most 2 w ln n; of equal values by just that."""
    width = jnp.asarray(width)
    excess = float(jg.smooth_peak_to_peak(VALUES, width) - 3.0)
    assert -1e-15 <= excess <= 2 * float(width) * math.log(3)
    level = jg.smooth_peak_to_peak(jnp.full(7, 0.3), width)
    assert_close(level, 2 * width * math.log(7), rtol=1e-9, atol=0.0)


def test_smooth_peak_to_peak_of_two_values_by_hand():
    """w [ln(e^(a/w) + e^(b/w)) + ln(e^(-a/w) + e^(-b/w))] = d + 2 w ln(1 + e^(-d/w))."""
    found = jg.smooth_peak_to_peak(jnp.asarray([0.2, 0.5]), jnp.asarray(0.1))
    assert_close(found, 0.3 + 0.2 * math.log1p(math.exp(-3.0)), rtol=1e-12, atol=0.0)


def test_smooth_peak_to_peak_tends_to_the_sharp_one():
    """With ties the excess is w ln 2 for each tied extreme: first order in the width."""
    values = jnp.asarray([3.0, 3.0, 1.0, 0.0])
    widths = np.array([4e-2, 2e-2, 1e-2])
    excess = [float(jg.smooth_peak_to_peak(values, jnp.asarray(w))) / 3.0 - 1.0 for w in widths]
    assert_close(observed_order(widths, excess), 1.0, rtol=1e-3, atol=0.0)
    assert_close(excess[-1], 0.01 * math.log(2) / 3.0, rtol=1e-6, atol=0.0)


def test_smooth_peak_to_peak_is_differentiable():
    assert_gradient(
        lambda x: jg.smooth_peak_to_peak(x[0], x[1]), (VALUES, jnp.asarray(0.4)), rtol=1e-8
    )


@pytest.mark.parametrize("shift", [0.0, 0.13])
def test_harmonics_of_a_known_signal(shift):
    cycle = _uniform(32)
    turn = 2 * jnp.pi * (cycle.cells.lines.phase + shift)
    signal = 5.0 + 3.0 * jnp.cos(turn) + 0.7 * jnp.sin(2 * turn) - 0.2 * jnp.cos(5 * turn)
    expected = jnp.asarray([3.0, 0.7, 0.0, 0.0, 0.2, 0.0])
    assert_close(jg.harmonic_amplitudes(cycle, signal, 6), expected, rtol=1e-12, atol=1e-13)


def test_harmonics_of_unequal_phases_by_hand():
    """4 - 2.1 at 0.1, 1 - 2.1 at 0.35, 2 - 2.1 at 0.75, weighing 0.2, 0.3, 0.5."""
    found = jg.harmonic_amplitudes(THREE, VALUES, 1)
    real, imaginary = 0.0, 0.0
    for weighed, phase in ((0.38, 0.1), (-0.33, 0.35), (-0.05, 0.75)):
        real += weighed * math.cos(2 * math.pi * phase)
        imaginary += weighed * math.sin(2 * math.pi * phase)
    assert_close(found, jnp.asarray([2 * math.hypot(real, imaginary)]), rtol=1e-13, atol=0.0)


def test_a_constant_has_no_harmonics_on_unequal_phases():
    found = jg.harmonic_amplitudes(THREE, jnp.full(3, 7.0), 4)
    assert_close(found, jnp.zeros(4), rtol=0.0, atol=1e-13)


def test_harmonics_carry_the_variance():
    """Parseval: the variance is half the sum of squared amplitudes."""
    cycle = _uniform(33)
    signal = jnp.asarray(np.random.default_rng(1).normal(size=33))
    amplitudes = jg.harmonic_amplitudes(cycle, signal, 16)
    variance = jg.cycle_variance(cycle, signal)
    assert_close(0.5 * jnp.sum(amplitudes**2), variance, rtol=1e-12, atol=0.0)


@functools.cache
def _unmodified() -> tuple[jg.MeshCycle, jax.Array]:
    """An unmodified spur pair, and its transmission error."""
    model = jg.PairModel(ACCESSORY.pair(), 80.0, compliance=jg.ConstantStiffness(14e9))
    cycle = run_cycle(model, jg.mesh_grid(model.pair, phases=256, slices=1))
    return cycle, jg.transmission_error(model.pair, cycle)


@pytest.mark.slow
def test_harmonics_of_a_square_wave_on_aligned_phases():
    """TE of an unmodified spur pair: amplitude (delta/2) 2 |sin(pi k (eps - 1))| / (pi k)."""
    cycle, error = _unmodified()
    order = np.arange(1, 5)
    delta = ACCESSORY.force(80.0) / (14e9 * 9.5e-3)
    sine = np.abs(np.sin(np.pi * order * (ACCESSORY.contact_ratio - 1)))
    expected = delta * sine / (np.pi * order)
    assert_close(jg.harmonic_amplitudes(cycle, error, 4), expected, rtol=1e-3, atol=0.0)


def test_transmission_error_is_transverse():
    """The approach is normal: TE is longer by 1 / cos(beta_b)."""
    pair = POWER.pair()
    found = jg.transmission_error(pair, THREE)
    expected = np.array([1.0, 1.5, 2.0]) / math.cos(POWER.base_helix)
    assert_close(found, expected, rtol=1e-13, atol=0.0)


@pytest.mark.slow
def test_transmission_error_is_the_pinions_lead():
    """Positive: r_b1 th1 under load, with the wheel held, 2615 N over 14 GPa and 9.5 mm."""
    assert_close(np.max(_unmodified()[1]), 2615.4 / (14e9 * 9.5e-3), rtol=1e-4, atol=0.0)


def test_unloaded_error_is_the_envelope_of_the_pairs_gaps():
    """Relief of depth C over a share x of the path, at its end s = 0 and s = eps base pitches.

    A pair alone would part by C (1 - s / (x eps)) near either end; of two pairs the lesser counts.
    And it is what remains of a loaded mesh whose torque vanishes.
    """
    base = jg.PairModel(ACCESSORY.pair(), 80.0, compliance=jg.ConstantStiffness(14e9))
    model = eqx.tree_at(lambda m: m.flanks, base, symmetric_relief(20.0 * um, 0.45))
    grid = jg.mesh_grid(model.pair, phases=16, slices=2)
    cycle = run_cycle(eqx.tree_at(lambda m: m.torque, model, jnp.asarray(80e-6)), grid)
    lines, ratio = cycle.cells.lines, ACCESSORY.contact_ratio
    gap = jg.mesh_gap(model.pair, lines, model.flanks, model.misalignment)
    found = jg.unloaded_transmission_error(model.pair, cycle.cells, gap)

    place = np.asarray(lines.phase)[:, None] + np.arange(2)
    end = np.minimum(place, ratio - place)
    parted = 20.0 * um * np.maximum(0.0, 1.0 - end / (0.45 * ratio))
    envelope = np.min(np.where(end > 0.0, parted, np.inf), axis=1)
    assert np.ptp(envelope) > 3.0 * um
    assert_close(found, envelope, rtol=1e-9, atol=1e-12)
    assert_close(jg.transmission_error(model.pair, cycle), found, rtol=0.0, atol=1e-10)


@pytest.mark.slow
def test_statistics_of_a_cycle_are_differentiable():
    """In its approach; that has derivatives in its turn, by tests of its own."""
    cycle, pair = _unmodified()[0], ACCESSORY.pair()

    def statistics(approach):
        found = eqx.tree_at(lambda c: c.approach, cycle, approach)
        error = jg.transmission_error(pair, found) / um
        return (
            jg.cycle_mean(found, error)
            + jg.cycle_rms(found, error)
            + jnp.sum(jnp.asarray([2.0, 3.0]) * jg.harmonic_amplitudes(found, error, 2))
            + jg.smooth_peak_to_peak(error, jnp.asarray(0.3))
        )

    assert_gradient(statistics, cycle.approach, rtol=1e-6)
