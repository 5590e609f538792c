"""Spectra of turning bodies: waves made by hand, seen from the body and from space."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from helpers import assert_close

from jaxgear._response._body_motion import BodyMotion, rotating_spectrum
from jaxgear._response._spectrum import (
    Spectrum,
    fitted_harmonics,
    joined_spectra,
    spectrum_of_steps,
)
from jaxgear._response._waves import (
    circle_of,
    fixed_spectrum,
    joined_circles,
    joined_waves,
    order_sums,
    seen_passing,
    waves_on_body,
)

TEETH, NODES = 12, 36
ANGLES = 2.0 * np.pi * np.arange(NODES) / NODES
# A ring that moves along its axis: as one, tilted, and in two and three waves.
WAVES = (0, 1, 2, 3)
NUMBERS = np.array([0, 1, -1, 2, -2, 3, -3])
senses = pytest.mark.parametrize("sense", [1, -1], ids=["about +Z", "about -Z"])


def _turning() -> np.ndarray:
    size = 2 * len(WAVES) - 1
    turning = np.zeros((size, size))
    for wave in WAVES[1:]:
        first = 2 * wave - 1
        turning[first, first + 1], turning[first + 1, first] = -wave, wave
    return turning


def _rows(angles: np.ndarray = ANGLES) -> np.ndarray:
    """Axial motion per coordinate: 1, then cosine and sine of each wave."""
    shapes = [np.ones_like(angles)]
    for wave in WAVES[1:]:
        shapes += [np.cos(wave * angles), np.sin(wave * angles)]
    rows = np.zeros((len(angles), 3, 2 * len(WAVES) - 1))
    rows[:, 2] = np.stack(shapes, axis=1)
    return rows


def _travelling(number: int, forward: bool, sense: int, size: float = 3e-6) -> BodyMotion:
    """A wave that travels around the body and is seen once per tooth from space.

    On the body it is `cos(o psi - n theta)`, theta in the sense of rotation and o = Z - n forward,
    Z + n backward; seen from space `cos(Z psi - n theta)`.
    """
    lobes = number if forward else -number
    amplitudes = np.zeros((3, 2 * len(WAVES) - 1), dtype=complex)
    first = 2 * number - 1
    # cos(Z psi - lobes sense phi) = Re[e^{i Z psi} (cos - i sense lobes/n sin)].
    amplitudes[1, first] = size
    amplitudes[1, first + 1] = -1j * size * sense * math.copysign(1.0, lobes)
    return BodyMotion(amplitudes, NUMBERS, TEETH, 1, sense * 50.0, 0.7)


def _angles(samples: int, revolutions: int = 1) -> np.ndarray:
    return 2.0 * np.pi * revolutions * np.arange(samples) / samples


def _noisy(sense: int, periods: int = 1, harmonics: int = 4) -> BodyMotion:
    random = np.random.default_rng(3)
    parts = random.standard_normal((2, harmonics * periods + 1, 2 * len(WAVES) - 1))
    amplitudes = parts[0] + 1j * parts[1]
    amplitudes[0] = amplitudes[0].real
    return BodyMotion(amplitudes, NUMBERS, TEETH, periods, sense * 50.0, 0.7)


@senses
@pytest.mark.parametrize("forward", [True, False], ids=["forward", "backward"])
def test_a_wave_is_at_one_order_of_the_body_and_at_the_teeth_in_space(sense, forward):
    motion = _travelling(3, forward, sense)
    order = TEETH - 3 if forward else TEETH + 3
    gauge = rotating_spectrum(motion, _rows()[:, 2])
    assert_close(np.abs(gauge.near(order)), np.full(NODES, 3e-6), rtol=1e-12, atol=0.0)
    assert_close(gauge.mean_square, np.full(NODES, 0.5 * 9e-12), rtol=1e-12, atol=0.0)
    circle = circle_of(ANGLES, _rows())
    probe = fixed_spectrum(motion, circle, 0.4)
    assert_close(np.abs(probe.near(TEETH)), np.array([0.0, 0.0, 3e-6]), rtol=1e-12, atol=1e-18)
    assert_close(probe.mean_square[2], np.float64(0.5 * 9e-12), rtol=1e-12, atol=0.0)
    assert probe.strongest() == TEETH
    waves = waves_on_body(motion, circle)
    found, share = waves.strongest(order)
    assert found == (3 if forward else -3)
    assert share > 1.0 - 1e-12
    at = np.flatnonzero((waves.order == order) & (waves.diameters == found))
    assert_close(waves.size[at, 2], np.array([3e-6]), rtol=1e-12, atol=0.0)
    assert_close(waves.travel[at], np.array([50.0 * order / found]), rtol=1e-12, atol=0.0)
    only = waves.by_diameter(3)[:, 2]
    assert_close(only[found + 3], np.float64(3e-6 / math.sqrt(2.0)), rtol=1e-12, atol=0.0)
    assert_close(np.delete(only, found + 3), np.zeros(6), rtol=0.0, atol=1e-18)


@senses
def test_a_forward_wave_overtakes_the_body(sense):
    """Its crest is further on, in the sense of rotation, a moment later."""
    motion = _travelling(2, True, sense)
    fine = 2.0 * np.pi * np.arange(720) / 720
    gauges = rotating_spectrum(motion, _rows(fine)[:, 2])
    step = 0.01
    before, after = gauges.at(np.array([0.0, step]))
    crest = lambda values: np.angle(np.sum(values * np.exp(1j * 2.0 * fine))) / 2.0
    moved = sense * (crest(after) - crest(before))
    assert moved == pytest.approx((TEETH - 2) / 2 * step, rel=1e-9)


@senses
@pytest.mark.parametrize("periods", [1, 5])
def test_whole_revolutions_are_those_of_the_turned_coordinates(sense, periods):
    motion, rows = _noisy(sense, periods), _rows()
    angle = _angles(50 * periods, periods)
    series = rotating_spectrum(motion, rows).at(angle)
    standing = motion.standing.at(angle)
    for now in range(0, len(angle), 7):
        turn = scipy.linalg.expm(-(motion.angle + sense * angle[now]) * _turning())
        assert_close(series[now], rows @ (turn @ standing[now]), rtol=1e-10, atol=1e-11)
    if periods == 5:
        # Twelve teeth pass in no whole number of five mesh periods.
        assert np.abs(series[0] - series[50]).max() > 0.1


@senses
def test_a_fixed_probe_reads_what_passes_it(sense):
    motion = _noisy(sense)
    angle = _angles(90)
    series = fixed_spectrum(motion, circle_of(ANGLES, _rows()), 1.1).at(angle)
    on_body = rotating_spectrum(motion, np.eye(motion.amplitudes.shape[1])).at(angle)
    for now in range(0, len(angle), 11):
        passing = 1.1 - motion.angle - sense * angle[now]
        expected = _rows(np.array([passing]))[0] @ on_body[now]
        assert_close(series[now], expected, rtol=1e-10, atol=1e-11)


@senses
@pytest.mark.parametrize("periods", [1, 5])
def test_one_order_of_the_body_is_that_of_its_spectrum(sense, periods):
    motion = _noisy(sense, periods)
    whole = rotating_spectrum(motion, np.eye(motion.amplitudes.shape[1]))
    for order in (*whole.order, 0.5, 0.1):
        assert_close(motion.on_body(order), whole.near(order), rtol=1e-12, atol=1e-14)


def test_a_fixed_probe_shows_multiples_of_the_teeth_only():
    probe = fixed_spectrum(_noisy(1), circle_of(ANGLES, _rows()), 0.0)
    np.testing.assert_array_equal(probe.order, TEETH * np.arange(5))


def test_an_uneven_body_shows_its_own_order_to_a_fixed_probe():
    """Where one sector in three moves more, three times a turn is added to the teeth."""
    rows = _rows() * (1.0 + 0.2 * np.cos(3.0 * ANGLES))[:, None, None]
    probe = fixed_spectrum(_travelling(2, True, 1), circle_of(ANGLES, rows), 0.0)
    size = [float(np.abs(probe.near(o)[2])) for o in (TEETH - 3, TEETH, TEETH + 3)]
    assert size == pytest.approx([0.3e-6, 3e-6, 0.3e-6], rel=1e-9)


@senses
def test_power_is_the_same_in_all_pictures(sense):
    """Parseval: over time, over orders, over waves; and by bands of orders."""
    motion = _noisy(sense)
    gauges = rotating_spectrum(motion, _rows()[:, 2])
    series = gauges.at(_angles(256))
    assert_close(series.var(axis=0), gauges.mean_square, rtol=1e-10, atol=0.0)
    waves = waves_on_body(motion, circle_of(ANGLES, _rows()))
    summed = np.sum(waves.by_diameter(3)[:, 2] ** 2)
    assert_close(summed, gauges.mean_square.mean(), rtol=1e-10, atol=0.0)
    bands = order_sums(gauges, [0.0, 5.0, 20.0, 1000.0])
    assert_close(np.sum(bands**2, axis=0), gauges.mean_square, rtol=1e-12, atol=0.0)
    circle = circle_of(ANGLES, _rows())
    still = replace(circle, rows=0.0 * circle.rows)
    both = joined_waves(waves_on_body(motion, joined_circles([circle, still], 3)))
    assert_close(both.by_diameter(3), waves.by_diameter(3) / math.sqrt(2.0), rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("periods", [1, 2, 5])
def test_harmonics_are_found_in_steps_of_two_lengths(periods):
    lengths = np.r_[np.full(9, 0.4 / 9), np.full(15, 0.6 / 15)]
    middles = np.cumsum(lengths) - 0.5 * lengths
    time = (np.arange(periods)[:, None] + middles).ravel()
    random = np.random.default_rng(1)
    count = 5 * periods + (periods - 1) // 2
    wanted = random.standard_normal((count + 1, 2)) + 1j * random.standard_normal((count + 1, 2))
    wanted[0] = wanted[0].real
    phase = np.exp(2j * np.pi * np.outer(time / periods, np.arange(count + 1)))
    found = fitted_harmonics(np.real(phase @ wanted), lengths, 5)
    assert found.shape == wanted.shape
    assert_close(found, wanted, rtol=1e-9, atol=1e-10)
    with pytest.raises(ValueError, match=r"fewer than 11\.25 harmonics"):
        fitted_harmonics(np.real(phase @ wanted), lengths, 12)


def test_the_spectrum_of_steps_has_the_orders_of_the_gear():
    """A gear of 12 teeth over 3 mesh periods: 5 cosines of order 8, of which 4 make a period."""
    lengths = np.full(16, 1.0 / 16)
    turn = (np.arange(3 * 16) + 0.5) / 16 / 12 * 2.0 * np.pi
    values = np.stack([2.0 + 5.0 * np.cos(8.0 * turn), np.sin(12.0 * turn)], axis=1)
    found = spectrum_of_steps(values, lengths, 12)
    assert_close(found.near(8), np.array([5.0 + 0j, 0.0]), rtol=1e-12, atol=1e-12)
    assert_close(found.near(12), np.array([0.0, -1j]), rtol=1e-12, atol=1e-12)
    assert_close(found.near(0), np.array([2.0 + 0j, 0.0]), rtol=1e-12, atol=1e-12)
    # Beside another one, that tells other orders too.
    other = Spectrum(np.array([0.0, 1.0, 8.0 + 1e-13]), np.array([[1.0, 0], [3.0, 0], [1j, 0]]))
    both = joined_spectra(other, found)
    assert both.order.tolist() == sorted(set(both.order.tolist()))
    assert len(both.order) == len(found.order) + 1
    assert_close(both.near(8), np.array([5.0 + 1j, 0.0]), rtol=1e-12, atol=1e-12)
    assert_close(both.near(1), np.array([3.0 + 0j, 0.0]), rtol=1e-12, atol=1e-12)


def test_a_fixed_eye_sees_a_wave_pass():
    """Nodes read cos(2 phi) while the body turns: from its place the eye sees it turn by."""
    turn = np.linspace(0.0, 1.3, 9)
    readings = np.tile(np.cos(2.0 * ANGLES), (9, 1))
    assert_close(
        seen_passing(ANGLES, 0.4, readings, turn),
        np.cos(2.0 * (0.4 - turn)),
        rtol=1e-12,
        atol=1e-12,
    )


def test_uneven_circles_tell_the_same_waves():
    """Nodes of quadratic elements need not be equally far apart."""
    uneven = ANGLES + 0.03 * np.tile([0.0, 1.0], NODES // 2)
    even, other = circle_of(ANGLES, _rows()), circle_of(uneven, _rows(uneven))
    for number in (-3, 0, 2):
        rows = [each.rows[each.number == number][0] for each in (even, other)]
        assert_close(rows[1], rows[0], rtol=1e-9, atol=1e-12)
    with pytest.raises(ValueError, match="three or more nodes"):
        circle_of(ANGLES[:2], _rows(ANGLES[:2]))
