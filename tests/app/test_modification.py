"""Traces of flanks: places and deviations by hand, and what was measured told apart."""

import numpy as np
import pytest
from helpers import assert_close

import jaxgear as jg
from jaxgear import deg, mm, um
from jaxgear.plot._modification_pictures import modification
from jaxgear.study._pair_dataset import modification_dataset, sliding_dataset


@pytest.fixture(scope="module")
def pair():
    return jg.GearPair(jg.Gear(20, 12 * mm, 0.2), jg.Gear(41, 10 * mm, 0.1), 2 * mm)


@pytest.fixture(scope="module")
def data(pair):
    """A pinion with tip relief, crowning and twist; a wheel with a measured hump."""
    design = (jg.TipRelief(12 * um, 0.25), jg.Crowning(3 * um), jg.Bias(8 * um))
    hump = jg.MeasuredProfile([0.0, 0.5, 1.0], [0.0, 2 * um, 0.0])
    flanks = jg.Flanks(jg.Superposed(design), jg.Superposed((jg.HelixSlope(4 * um), hump)))
    traces = modification_dataset({"given": (pair, flanks)})
    return traces.assign_attrs(title="case")


def _trace(data, gear, trace):
    own = data.sel(state="given", gear=gear, trace=trace)
    return {str(name): each.values for name, each in own.items()}


def test_profile_of_a_relieved_tip_by_hand(pair, data):
    found = _trace(data, "pinion", "profile")
    facts = jg.pair_facts(pair)
    tip, base = float(facts.tip_radius[0]), float(facts.base_radius[0])
    assert_close(found["diameter_mm"][-1], 2.0 * tip / mm, rtol=1e-12, atol=0.0)
    rolled = np.sqrt(tip**2 - base**2) / base / deg
    assert_close(found["roll_angle_deg"][-1], rolled, rtol=1e-12, atol=0.0)
    # Straight from nothing at three quarters of the profile, the 151st of 201 points.
    assert np.abs(found["designed_um"][:151]).max() < 1e-12
    assert_close(found["designed_um"][175], -6.0, rtol=1e-12, atol=0.0)
    assert_close(found["designed_um"][-1], -12.0, rtol=1e-12, atol=0.0)


def test_lead_runs_from_left_to_right_at_half_the_profile(data):
    lead = _trace(data, "pinion", "lead")
    assert_close(lead["face_position_mm"][[0, -1]], np.asarray([-6.0, 6.0]), rtol=1e-12, atol=0.0)
    assert_close(lead["designed_um"][[0, 50, -1]], np.asarray([-3.0, -0.75, -3.0]),
                 rtol=1e-12, atol=0.0)  # fmt: skip


def test_twist_is_in_the_profiles_of_the_ends(data):
    """A bias of 8 um: slopes of -4 and +4 um over the profiles, each 3 um below by crowning."""
    left, right = (_trace(data, "pinion", f"profile {end}")["made_um"] for end in ("left", "right"))
    assert_close(left[[0, 100]], np.asarray([-1.0, -3.0]), rtol=1e-12, atol=0.0)
    assert_close(right[[0, 100]], np.asarray([-5.0, -3.0]), rtol=1e-12, atol=0.0)


def test_what_was_measured_is_no_design(data):
    profile = _trace(data, "wheel", "profile")
    assert np.abs(profile["designed_um"]).max() < 1e-12
    assert_close(profile["made_um"][[50, 100]], np.asarray([1.0, 2.0]), rtol=1e-12, atol=0.0)


def test_picture_names_what_differs(data):
    """Ends of a twisted flank only, and the measured line of a measured one only."""
    words = [text.get_text() for text in modification(data).legends[0].get_texts()]
    assert words == ["as designed", "left end", "right end", "as made"]


def test_sliding_table_ends_at_the_tips(pair):
    data, facts = sliding_dataset(pair, 1.0, 0.0), jg.pair_facts(pair)
    found = {str(name): each.values for name, each in data.items()}
    tips = 2.0 * np.asarray(facts.tip_radius) / mm
    ends = np.asarray([found["diameter_pinion_mm"][-1], found["diameter_wheel_mm"][0]])
    assert_close(ends, tips, rtol=1e-12, atol=0.0)
    # At the tips a flank slides faster than the other one rolls.
    assert found["specific_sliding_pinion"][-1] > 0.0 > found["specific_sliding_wheel"][-1]
    speed = found["sliding_speed_per_pinion_speed_mm"] * mm
    pitch = float(facts.working_pitch_radius[0])
    assert_close(found["sliding_over_pitch_line_speed"], speed / pitch, rtol=1e-12, atol=0.0)
