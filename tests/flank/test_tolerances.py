import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import accessory, helical_25_31, iso_tr_6336_30, power, sizes
from helpers import assert_close, assert_gradient

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._flank._tolerances import (
    GradeWaveform,
    deviation_of_grade,
    flank_tolerances,
    pitch_error_of_grade,
)

# Each by the standard's formula with its own numbers, in micrometres.
_ACCESSORY_PINION_5 = {
    "single_pitch": 0.0675 + 0.6 + 5.0,
    "cumulative_pitch": 0.135 + 0.55 * np.sqrt(67.5) + 1.05 + 12.0,
    "profile_slope": 0.6 + 0.0675 + 4.0,
    "profile_form": 0.825 + 5.0,
    "profile": np.hypot(4.6675, 5.825),
    "helix_slope": 0.05 * np.sqrt(67.5) + 0.35 * np.sqrt(11.5) + 4.0,
    "helix_form": 0.07 * np.sqrt(67.5) + 0.45 * np.sqrt(11.5) + 4.0,
}


@functools.cache
def _flat_law(grade: float, gear: int, **shape: float) -> jg.Superposed:
    return deviation_of_grade(power(), gear, grade, GradeWaveform(**shape))


@jax.jit
def _along_profile(law, profile):
    return law(profile, jnp.zeros_like(profile))


def _profile_of(law: jg.Superposed) -> np.ndarray:
    """The deviation at the middles of 600 equal pieces of the path [um]."""
    return np.asarray(_along_profile(law, jnp.asarray((np.arange(600) + 0.5) / 600))) / um


# --- the standard's numbers


def test_accessory_pinion_by_hand():
    found = flank_tolerances(accessory(), 0, 5)
    for name, microns in _ACCESSORY_PINION_5.items():
        assert float(getattr(found, name)) / um == pytest.approx(microns, rel=1e-12), name
    assert float(found.helix) == pytest.approx(np.hypot(found.helix_slope, found.helix_form))


def test_diameter_is_that_of_the_reference_cylinder():
    """z m_n / cos(beta), not z m_n: 103 teeth of 8 mm at 15.8 degrees are 856.35 mm."""
    d = 103 * 8.0 / np.cos(np.deg2rad(15.8))
    found = flank_tolerances(iso_tr_6336_30(), 1, 6)
    root = np.sqrt(2.0)
    assert float(found.single_pitch) / um == pytest.approx(
        root * (0.001 * d + 3.2 + 5.0), rel=1e-12
    )
    expected = root * (0.05 * np.sqrt(d) + 3.5 + 4.0)
    assert float(found.helix_slope) / um == pytest.approx(expected, rel=1e-12)


def test_each_class_is_root_two_times_the_last():
    tolerances = [flank_tolerances(power(), 1, grade) for grade in (1, 2, 3, 7, 11)]
    for one, power_of in zip(tolerances, (0, 1, 2, 6, 10), strict=True):
        scaled = jax.tree.map(lambda x, n=power_of: np.sqrt(2.0) ** n * x, tolerances[0])
        assert_close(one, scaled, rtol=1e-12, atol=0.0)


def test_gears_of_the_thesis():
    """Guilbert 2017 gives the power pair 8 and 13 um peak to peak for ISO 5 and 7, no edition.

    Rounded as the standard rounds, to 0.5 and to 1 um, 8 is the total of class 5 and 13 the form
    of class 7, whose total is 16. The accessory pair is allowed 7.5 and 15 in total.
    """
    for gear in (0, 1):
        five, seven = (flank_tolerances(power(), gear, grade) for grade in (5, 7))
        assert round(2.0 * float(five.profile) / um) / 2.0 == 8.0
        assert round(float(seven.profile_form) / um) == 13
        assert round(float(seven.profile) / um) == 16
        smaller = float(flank_tolerances(accessory(), gear, 5).profile) / um
        assert round(2.0 * smaller) / 2.0 == 7.5


# --- the shapes


def test_form_spans_its_tolerance_and_is_pure_form():
    """Peak to peak of the tolerance, no mean, and a fitted line of no slope."""
    law = _profile_of(_flat_law(5.0, 0))
    expected = (0.55 * 2.5 + 5.0) * np.cos(np.deg2rad(10.861291))
    assert np.ptp(law) == pytest.approx(expected, rel=2e-4)
    assert abs(law.mean()) < 1e-12
    place = (np.arange(600) + 0.5) / 600
    assert abs(np.polyfit(place, law, 1)[0]) < 1e-10
    assert law[0] > 0.999 * law.max()
    assert np.count_nonzero(np.diff(np.sign(law))) == 6


def test_equal_gears_do_not_hide_their_form():
    """The wheel's profile runs the other way: cosines add up there, sines would cancel."""
    cosine, sine = (_profile_of(_flat_law(6.0, 0, phase=phase)) for phase in (np.pi / 2, 0.0))
    assert_close(cosine + cosine[::-1], 2.0 * cosine, rtol=1e-9, atol=1e-9)
    assert np.abs(sine + sine[::-1]).max() < 1e-9


def test_slopes_are_the_signed_share_of_their_tolerance():
    normal = np.cos(np.deg2rad(10.861291))
    d = 35 * 2.5 / np.cos(np.deg2rad(12.0))
    law = _flat_law(7.0, 0, profile_slope=0.5, helix_slope=-1.0, waves=0.0, phase=0.0)
    corners = jnp.asarray([0.0, 1.0, 0.0, 1.0]), jnp.asarray([-1.0, -1.0, 1.0, 1.0])
    values = np.asarray(law(*corners)) / um
    along = 0.5 * 2.0 * normal * (0.4 * 2.5 + 0.001 * d + 4.0)
    across = -2.0 * normal * (0.05 * np.sqrt(d) + 0.35 * np.sqrt(40.0) + 4.0)
    assert values[1] - values[0] == pytest.approx(along, rel=1e-7)
    assert values[2] - values[0] == pytest.approx(across, rel=1e-7)
    assert values[0] + values[3] == pytest.approx(0.0, abs=1e-12)


def test_pitch_errors_are_one_sine():
    """45 teeth sample it, none at the trough: the spread is a hair below the tolerance."""
    errors = np.asarray(pitch_error_of_grade(accessory(), 0, 5)) / um
    allowed = _ACCESSORY_PINION_5["cumulative_pitch"] * np.cos(np.deg2rad(25.0))
    expected = 0.5 * allowed * np.sin(2.0 * np.pi * np.arange(45) / 45)
    np.testing.assert_allclose(errors, expected, rtol=0.0, atol=1e-12)
    assert abs(errors.sum()) < 1e-12
    assert 0.995 * allowed < np.ptp(errors) <= allowed
    steps = np.abs(np.diff(errors, append=errors[0])).max()
    assert steps == pytest.approx(allowed * np.sin(np.pi / 45), rel=1e-2)
    assert steps < 0.25 * _ACCESSORY_PINION_5["single_pitch"]


def test_pitch_errors_are_along_the_normal():
    """An arc of the reference circle, times cos(alpha_t) cos(beta_b) = cos(alpha_n) cos(beta)."""
    pair = power()
    errors = pitch_error_of_grade(pair, 1, 5, GradeWaveform(pitch_phase=0.5 * np.pi))
    to_normal = np.cos(float(pair.transverse_pressure_angle)) * np.cos(float(pair.base_helix_angle))
    expected = 0.5 * float(flank_tolerances(pair, 1, 5).cumulative_pitch) * to_normal
    assert errors.shape == (68,)
    assert float(errors[0]) == pytest.approx(expected, rel=1e-12)
    assert float(errors[34]) == pytest.approx(-expected, rel=1e-12)


# --- gradients


@pytest.mark.slow
def test_gradients():
    """By class, shapes and gears, of profile, lead and pitch together."""
    profile, face = jnp.asarray([0.12, 0.55, 0.9]), jnp.asarray([-0.8, 0.2, 0.9])
    shape = GradeWaveform(2.6, 0.3, 0.4, -0.7, 0.2)

    def mixed(argument):
        grade, pair, waveform = argument
        law = deviation_of_grade(pair, 1, grade, waveform)
        pitch = pitch_error_of_grade(pair, 1, grade, waveform)
        return (jnp.sum(jnp.asarray([1.0, 0.7, 1.9]) * law(profile, face)) + pitch[3]) / um

    argument = (jnp.asarray(6.3), helical_25_31(), shape)
    assert_gradient(mixed, argument, rtol=1e-6, scale=sizes(argument))


def test_derivative_by_the_class():
    """d/dA of 2^((A - 5)/2) is ln(2)/2 of it."""
    value, slope = jax.value_and_grad(lambda a: flank_tolerances(power(), 0, a).helix)(
        jnp.asarray(6.5)
    )
    assert_close(slope, 0.5 * np.log(2.0) * value, rtol=1e-12, atol=0.0)


# --- refusals


@pytest.mark.parametrize("grade", [0.99, 12, -3.0, float("nan")])
@pytest.mark.parametrize("of", [flank_tolerances, deviation_of_grade, pitch_error_of_grade])
def test_classes_that_are_not_in_the_standard_are_refused(of, grade):
    with pytest.raises(ValueError, match=r"class of ISO 1328-1:2013 lies between 1 and 11, got"):
        of(power(), 0, grade)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (
            lambda p: (p.wheel.face_width, 3.9 * mm),
            r"face width \[mm\] must .* 4 and 1200, got 3.9",
        ),
        (
            lambda p: (p.normal_module, 0.4 * mm),
            r"normal module \[mm\] must lie between 0.5 and 70",
        ),
        (lambda p: (p.helix_angle, np.deg2rad(46.0)), r"helix angle \[deg\] .* 45, got 46"),
    ],
)
def test_gears_that_are_not_in_the_standard_are_refused(change, what):
    pair = power()
    changed = eqx.tree_at(lambda p: change(p)[0], pair, jnp.asarray(change(pair)[1]))
    with pytest.raises(ValueError, match=rf"no tolerances for this wheel: its {what}"):
        flank_tolerances(changed, 1, 5)


def test_limits_of_the_standard_are_within():
    pair = eqx.tree_at(lambda p: p.wheel.face_width, power(), jnp.asarray(4.0 * mm))
    assert float(flank_tolerances(pair, 1, 11).helix) > 0.0


def test_a_third_gear_is_refused():
    with pytest.raises(ValueError, match="A gear is 0, the pinion, or 1, the wheel, got 2"):
        flank_tolerances(power(), 2, 5)
