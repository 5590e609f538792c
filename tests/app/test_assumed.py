"""Defaults that follow other numbers, and what is said of them."""

import math

import pytest

from jaxgear._checks import InputError
from jaxgear.scene._assumed import assumed
from jaxgear.scene._build import pair_of
from jaxgear.scene._rewriting import write_scene
from jaxgear.scene._scene import read_scene

_KEYS = ("pinion.fillet_radius_coeff", "wheel.fillet_radius_coeff")


@pytest.fixture
def path(tmp_path):
    """Two plain gears on bores without a word on their rack."""
    found = tmp_path / "plain.toml"
    found.write_text(
        "schema = 1\n[pair]\nmodule_mm = 2.0\ntorque_pinion_Nm = 100.0\n"
        "[pinion]\nteeth = 25\nface_width_mm = 20.0\nbore_mm = 20.0\n"
        "[wheel]\nteeth = 51\nface_width_mm = 20.0\nbore_mm = 30.0\n"
    )
    return found


def test_a_plain_gear_of_25_degrees_is_accepted(path):
    """At most (pi/4 - 1.25 tan 25) cos 25 / (1 - sin 25) = 0.3179 fits its rack."""
    scene = read_scene(path, ["pair.pressure_angle_deg=25"])
    assert [scene.value(key) for key in _KEYS] == [0.317, 0.317]
    assert float(pair_of(scene).pinion.fillet_radius) == 0.317


@pytest.mark.parametrize("angle", [14.5, 20.0, 22.0])
def test_where_the_usual_radius_fits_nothing_is_assumed(path, angle):
    scene = read_scene(path, [f"pair.pressure_angle_deg={angle}"])
    assert [scene.value(key) for key in _KEYS] == [0.38, 0.38]
    assert assumed(scene) == []


@pytest.mark.parametrize("angle", [23.0, 24.5, 25.0, 27.5, 30.0, 32.0])
@pytest.mark.parametrize("dedendum", [1.0, 1.25, 1.4])
def test_the_largest_radius_leaves_a_land_at_the_tip_of_the_rack(path, angle, dedendum):
    settings = [f"pair.pressure_angle_deg={angle}", f"pinion.dedendum_coeff={dedendum}"]
    radius = read_scene(path, settings).value("pinion.fillet_radius_coeff")
    alpha = math.radians(angle)
    land = lambda r: math.pi / 4 - (dedendum - r) * math.tan(alpha) - r / math.cos(alpha)
    # Where not even a sharp corner fits the gear is refused, and the dedendum named.
    assert land(radius) >= 0.0 or (radius == 0.0 and land(0.0) < 0.0)
    assert radius == 0.38 or land(radius + 1e-3) < 0.0


def test_a_radius_that_was_given_is_kept_and_refused_as_ever(path):
    settings = ["pair.pressure_angle_deg=25", "pinion.fillet_radius_coeff=0.38"]
    scene = read_scene(path, settings)
    assert [scene.value(key) for key in _KEYS] == [0.38, 0.317]
    with pytest.raises(InputError, match="pinion's rack has a pointed tip"):
        pair_of(scene)


def test_what_was_assumed_is_told_and_written(path, tmp_path):
    scene = read_scene(path, ["pair.pressure_angle_deg=25", "wheel.fillet_radius_coeff=0.25"])
    (words,) = assumed(scene)
    assert words.startswith("pinion.fillet_radius_coeff was assumed to be 0.317, not 0.38: with")
    assert "pair.pressure_angle_deg = 25 and a dedendum of 1.25" in words
    write_scene(scene, tmp_path / "again.toml")
    again = read_scene(tmp_path / "again.toml")
    assert [again.value(key) for key in _KEYS] == [0.317, 0.25]
    assert assumed(again) == []


# --- bores, and what the ring foundation stands on

_SHAFT = """
[wheel.shaft]
gear_at_mm = 45.0
segments = [ {{ length_mm = 30.0, outer_mm = 25.0 }}, {{ length_mm = 60.0, outer_mm = {outer} }} ]
bearings = [
    {{ at_mm = 0.0, radial_N_m = 1e8, axial_N_m = 1e8 }},
    {{ at_mm = 90.0, radial_N_m = 1e8 }},
]
"""


@pytest.fixture
def unbored(path):
    path.write_text("\n".join(x for x in path.read_text().splitlines() if "bore_mm" not in x))
    return path


def test_a_missing_bore_is_assumed_and_told(unbored):
    """0.4 of the root diameters, 2 (25 - 2.5) = 45 and 2 (51 - 2.5) = 97 mm."""
    scene = read_scene(unbored)
    assert (scene.value("pinion.bore_mm"), scene.value("wheel.bore_mm")) == (18.0, 38.8)
    assert "pinion.foundation" not in scene.values
    assert scene.value("mesh.foundation") == "ring"
    first, second = assumed(scene)
    assert first.startswith("pinion.bore_mm was assumed to be 18 mm, 0.4 of the root diameter")
    assert second.startswith("wheel.bore_mm was assumed to be 38.8 mm")
    assert pair_of(scene).pinion.bore == pytest.approx(0.018)


@pytest.mark.parametrize(
    ("outer", "bore", "why"),
    [(40.0, 40.0, "the diameter of the shaft"), (90.0, 67.9, "0.7 of the root diameter, as the")],
)
def test_a_missing_bore_is_that_of_the_shaft(unbored, outer, bore, why):
    unbored.write_text(unbored.read_text() + _SHAFT.format(outer=outer))
    scene = read_scene(unbored, ["pinion.bore_mm=20"])
    assert scene.value("wheel.bore_mm") == bore
    (words,) = assumed(scene)
    assert words.startswith(f"wheel.bore_mm was assumed to be {bore:g} mm, {why}")


@pytest.mark.parametrize(
    "settings",
    [
        ["mesh.foundation=weber"],
        ["pinion.foundation=none", "wheel.foundation=weber"],
        ["mesh.stiffness=iso6336"],
    ],
)
def test_no_bore_is_assumed_where_nothing_asks_for_one(unbored, settings):
    scene = read_scene(unbored, settings)
    assert not {"pinion.bore_mm", "wheel.bore_mm"} & set(scene.values)
    assert assumed(scene) == []


def test_a_gear_without_a_bore_is_told_what_it_stands_on(path):
    scene = read_scene(path, ["wheel.bore_mm=0"])
    assert (scene.value("pinion.foundation"), scene.value("wheel.foundation")) == (None, "weber")
    (words,) = assumed(scene)
    assert words.startswith("The wheel has no bore")
    assert "foundation is weber" in words


def test_an_assumed_bore_is_written(unbored, tmp_path):
    scene = read_scene(unbored)
    write_scene(scene, tmp_path / "again.toml")
    again = read_scene(tmp_path / "again.toml")
    assert again.value("wheel.bore_mm") == 38.8
    assert assumed(again) == []
