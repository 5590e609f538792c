"""Defaults that follow other numbers, and what is said of them."""

import math

import pytest

from jaxgear._app._assumed import assumed
from jaxgear._app._model import pair_of
from jaxgear._app._scene import read_scene, write_scene
from jaxgear._checks import InputError

_KEYS = ("pinion.fillet_radius_coeff", "wheel.fillet_radius_coeff")


@pytest.fixture
def path(tmp_path):
    """Two plain gears without a word on their rack."""
    found = tmp_path / "plain.toml"
    found.write_text(
        "schema = 1\n[pair]\nmodule_mm = 2.0\ntorque_pinion_Nm = 100.0\n"
        "[pinion]\nteeth = 25\nface_width_mm = 20.0\n[wheel]\nteeth = 51\nface_width_mm = 20.0\n"
    )
    return found


def test_a_plain_gear_of_25_degrees_is_accepted(path):
    """At most (pi/4 - 1.25 tan 25) cos 25 / (1 - sin 25) = 0.3179 fits its rack."""
    scene = read_scene(path, ["pair.pressure_angle_deg=25"])
    assert [scene[key] for key in _KEYS] == [0.317, 0.317]
    assert float(pair_of(scene).pinion.fillet_radius) == 0.317


@pytest.mark.parametrize("angle", [14.5, 20.0, 22.0])
def test_where_the_usual_radius_fits_nothing_is_assumed(path, angle):
    scene = read_scene(path, [f"pair.pressure_angle_deg={angle}"])
    assert [scene[key] for key in _KEYS] == [0.38, 0.38]
    assert assumed(scene) == []


@pytest.mark.parametrize("angle", [23.0, 24.5, 25.0, 27.5, 30.0, 32.0])
@pytest.mark.parametrize("dedendum", [1.0, 1.25, 1.4])
def test_the_largest_radius_leaves_a_land_at_the_tip_of_the_rack(path, angle, dedendum):
    settings = [f"pair.pressure_angle_deg={angle}", f"pinion.dedendum_coeff={dedendum}"]
    radius = read_scene(path, settings)["pinion.fillet_radius_coeff"]
    alpha = math.radians(angle)
    land = lambda r: math.pi / 4 - (dedendum - r) * math.tan(alpha) - r / math.cos(alpha)
    # Where not even a sharp corner fits the gear is refused, and the dedendum named.
    assert land(radius) >= 0.0 or (radius == 0.0 and land(0.0) < 0.0)
    assert radius == 0.38 or land(radius + 1e-3) < 0.0


def test_a_radius_that_was_given_is_kept_and_refused_as_ever(path):
    settings = ["pair.pressure_angle_deg=25", "pinion.fillet_radius_coeff=0.38"]
    scene = read_scene(path, settings)
    assert [scene[key] for key in _KEYS] == [0.38, 0.317]
    with pytest.raises(InputError, match="pinion's rack has a pointed tip"):
        pair_of(scene)


def test_what_was_assumed_is_told_and_written(path, tmp_path):
    scene = read_scene(path, ["pair.pressure_angle_deg=25", "wheel.fillet_radius_coeff=0.25"])
    (words,) = assumed(scene)
    assert words.startswith("pinion.fillet_radius_coeff was assumed to be 0.317, not 0.38: with")
    assert "pair.pressure_angle_deg = 25 and a dedendum of 1.25" in words
    write_scene(scene, tmp_path / "again.toml")
    again = read_scene(tmp_path / "again.toml")
    assert [again[key] for key in _KEYS] == [0.317, 0.25]
    assert assumed(again) == []
