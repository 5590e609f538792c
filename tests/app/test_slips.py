"""Slips of units: what cannot be is refused at its line, what is odd told, sane gears pass."""

import math
import random
import re

import pytest
from helpers import quick

from jaxgear.scene import _slips
from jaxgear.scene._scene import READY, SceneError, read_scene
from jaxgear.scene._slips import odd
from jaxgear.study._head import finished
from jaxgear.study._running import Clock

_PAIR = """\
schema = 1
[pair]
module_mm = 1.5
torque_pinion_Nm = 80
[pinion]
teeth = 45
face_width_mm = 11.5
bore_mm = 30
[wheel]
teeth = 86
face_width_mm = 9.5
bore_mm = 40
"""
_SHAFT = (
    "wheel.shaft={{ gear_at_mm = {0}, segments = [{{ length_mm = {1}, outer_mm = {2} }}], "
    "bearings = [{{ at_mm = 0.0, radial_N_m = {3} }}, {{ at_mm = {1}, radial_N_m = {3} }}] }}"
)


@pytest.fixture
def path(tmp_path):
    found = tmp_path / "pair.toml"
    found.write_text(_PAIR)
    return found


@pytest.mark.parametrize(
    ("setting", "key", "message"),
    [
        ("material.young_GPa=206000", "", "<= 2000 [GPa]. The key is in gigapascals"),
        ("material.density_kg_m3=7.85e6", "", "<= 30000 [kg/m^3]"),
        ("pair.module_mm=150", "", "at most 57.5 mm: 5 times pinion.face_width_mm, 11.5"),
        (
            "wheel.face_width_mm=0.2",
            "",
            "at least 0.3 mm: 0.2 times pair.module_mm, 1.5. If 0.2 is",
        ),
        ("pinion.bore_mm=0.03", "", "0.002 times the root diameter, 63.75. If 0.03 is in metres"),
        ("pinion.bore_mm=63.75001", "", "must be at most 63.75 mm: the root diameter"),
        ("pair.centre_distance_mm=3.868", "", "If 3.868 is in inches, write 98.2472"),
        ("pair.centre_distance_mm=0.0983", "", "If 0.0983 is in metres, write 98.3"),
        (
            "flank.pinion.tip_relief.depth_um=5000",
            "",
            "got 5000.0, must be at most 1500 um: pair.module_mm, 1.5",
        ),
        ("flank.wheel.pitch_error_um=[1e9]", "", "got 1000000000.0, must be at most 1500 um"),
        ("flank.wheel.helix_slope_um=-2000", "", "got -2000.0, must be at most 1500 um"),
        ("pair.misalignment_deviation_um=2e6", "", "must be at most 1500 um"),
        ("pinion.thickness_allowance_um=1e5", "", "must be at most 1500 um"),
        ("map.depth_um.to=15000", "", "must be at most 1500 um"),
        ('sizing.amounts={ "flank.wheel.crowning_um" = [5, 5e6] }', "*", "got 5000000.0, must be"),
        ("pair.torque_pinion_Nm=80000", "", "If 80000 is in N mm, write 80"),
        ("pair.torque_pinion_Nm=-80000", "", "got -80000.0, must be at most 9907 N m in size: "),
        ("map.torques_Nm=[40, 80e3]", "", "got 80000.0, must be at most 9907 N m"),
        ("mesh.pinion_speed_rad_s=60000", "", "0.2 times the speed at which pitch points"),
        ("sweep.pinion_speed_rad_s=[100, 60000]", "", "got 60000.0, must be at most 3.036e+04"),
        ("pinion.support.radial_N_m=1e5", "", "If 100000 is in N/mm, write 1e+08"),
        (_SHAFT.format(40, 80, 40, 2e5), "*bearings[0].radial_N_m", "in N/mm, write 2e+08"),
        (_SHAFT.format(0.04, 0.08, 40, 1e9), "*segments[0].length_mm", "in metres, write 80"),
        (_SHAFT.format(40, 80, 0.04, 1e9), "*segments[0].outer_mm", "in metres, write 40"),
    ],
)
def test_what_cannot_be_is_refused_where_it_was_given(path, setting, key, message):
    with pytest.raises(SceneError) as caught:
        read_scene(path, [setting])
    (mistake,) = caught.value.mistakes
    assert mistake.where == f"--set {setting}"
    assert mistake.path.endswith(key.removeprefix("*")) if key else setting.startswith(mistake.path)
    assert message in mistake.message


def test_a_slip_names_its_line_and_hides_no_other(path):
    path.write_text(_PAIR.replace("= 80", "= 8e4").replace("bore_mm = 30", "bore_mm = 70"))
    with pytest.raises(SceneError) as caught:
        read_scene(path)
    assert [mistake.where for mistake in caught.value.mistakes] == [f"{path}:4", f"{path}:8"]


def test_a_long_pinion_is_refused_by_its_diameter(path):
    with pytest.raises(SceneError, match="got 460"):
        read_scene(path, ["pinion.teeth=10", "pinion.bore_mm=0", "pinion.face_width_mm=460"])
    read_scene(path, ["pinion.teeth=10", "pinion.bore_mm=0", "pinion.face_width_mm=300"])


def test_a_module_that_is_off_is_the_only_mistake(path):
    """All other numbers are weighed against it."""
    with pytest.raises(SceneError) as caught:
        read_scene(path, ["pair.module_mm=150", "flank.pinion.crowning_um=1e6"])
    assert [mistake.path for mistake in caught.value.mistakes] == ["pair.module_mm"]


def test_a_constant_stiffness_in_pascals_is_refused(path):
    settings = ["mesh.stiffness=constant", "mesh.stiffness_N_mm_um=14e9"]
    with pytest.raises(SceneError, match=re.escape("If 1.4e+10 is in N/m^2, write 14")):
        read_scene(path, settings)
    assert not odd(read_scene(path, [settings[0], "mesh.stiffness_N_mm_um=14"]))


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("material.young_GPa=0.206", "If 0.206 is in TPa, write 206"),
        ("wheel.material.density_kg_m3=115", "a density of 115 kg/m^3 are odd together"),
        ("pair.module_mm=12", "at most 11.5 mm, pinion.face_width_mm, 11.5, is usual"),
        ("pinion.face_width_mm=0.45", "If 0.45 is in inches, write 11.43"),
        ("pinion.bore_mm=1.18", "If 1.18 is in inches, write 29.972"),
        ("pair.helix_angle_deg=-0.2094", "If -0.2094 is in radians, write -11.9977"),
        ("pair.pressure_angle_deg=9", "at least 14 degrees is usual"),
        ("pair.torque_pinion_Nm=0.08", "If 0.08 is in kN m, write 80"),
        ("mesh.pinion_speed_rad_s=10000", "If 10000 is in revolutions per minute, write 1047.2"),
        ("flank.pinion.tip_relief.depth_um=0.015", "If 0.015 is in millimetres, write 15"),
        ("flank.pinion.crowning_um=400", "at most 150 um, 0.1 times pair.module_mm"),
        ("pinion.support.radial_N_m=3e6", "at least 4.741e+06 N/m"),
        ("wheel.body.mass_kg=300", "If 300 is in grams, write 0.3"),
        ("wheel.body.inertia_kg_m2=2000", "If 2000 is in kg mm^2, write 0.002"),
    ],
)
def test_what_is_odd_is_told(path, setting, message):
    said = odd(read_scene(path, [setting]))
    assert any(message in words for words in said)
    assert any(setting.partition("=")[0] in words for words in said)


def test_backlash_of_a_centre_distance_is_told_with_the_one_that_leaves_none(path):
    """2 a (inv alpha_w - inv alpha) for 45 and 86 teeth of module 1.5 at a = 98.82 mm, x = 0."""
    base, centres, alpha = 98.25 * math.cos(math.radians(20)), 98.82, math.radians(20)
    working = math.acos(base / centres)
    backlash = 2 * centres * (math.tan(working) - working - math.tan(alpha) + alpha)
    (words,) = odd(read_scene(path, ["pair.centre_distance_mm=98.82"]))
    assert f"a backlash of {backlash:.3g} mm, which is odd: 0.28 times pair.module_mm" in words
    assert "The profile shifts ask for 98.25 mm" in words
    assert not odd(read_scene(path, ["pair.centre_distance_mm=98.4"]))


def test_the_centre_distance_without_backlash_follows_the_profile_shifts(path):
    shifts = ["pinion.profile_shift=0.341", "wheel.profile_shift=0.481"]
    shifts += ["pair.pressure_angle_deg=25", "pair.centre_distance_mm=100.5"]
    (words,) = odd(read_scene(path, shifts))
    assert "The profile shifts ask for 99.4503 mm" in words


def test_remarks_are_the_first_notes_of_a_summary(path):
    scene = read_scene(path, ["pair.centre_distance_mm=98.8", "pair.pressure_angle_deg=25"])
    summary = finished({"notes": ["what else there is"]}, odd(scene), Clock())
    first, *others = summary["notes"]
    assert first.startswith("pair.centre_distance_mm = 98.8 mm leaves a backlash")
    assert others[-1] == "what else there is"
    plain = finished({}, odd(read_scene(path)), Clock())
    assert "notes" not in plain


@pytest.mark.parametrize("name", sorted(path.stem for path in READY.glob("*.toml")))
def test_ready_scenes_are_not_odd(name):
    assert odd(read_scene(READY / f"{name}.toml")) == []


# Young's modulus [GPa], density [kg/m3].
_MATERIALS = [(206.0, 7850.0), (110.0, 4430.0), (70.0, 2700.0), (105.0, 8400.0), (2.8, 1410.0)]


def _sane_pair(draw: random.Random) -> list[str]:
    """Settings of a pair that might be built, from a watchmaker's to a mill's."""
    young, density = draw.choice(_MATERIALS)
    module = draw.choice([0.2, 0.3, 0.5, 1.0, 1.5, 2.5, 4.0, 6.0, 10.0, 16.0, 25.0])
    angle = draw.choice([14.5, 17.5, 20.0, 22.5, 25.0, 28.0])
    helix = draw.choice([0.0, 0.0, draw.uniform(5.0, 35.0) * draw.choice([-1, 1])])
    teeth = draw.randint(12, 60), draw.randint(15, 150)
    face = module * draw.uniform(4.0, 30.0)
    diameters = [module * each / math.cos(math.radians(helix)) for each in teeth]
    # Tooth force over face and module, as a share of Young's modulus.
    load = young * 1e3 * 10 ** draw.uniform(-5.0, -2.5)
    force = load * face * module
    centres = 0.5 * sum(diameters) + draw.uniform(0.0, 0.05) * module
    # Up to 150 m/s in steel.
    sound = math.sqrt(1e9 * young / density)
    speed = draw.uniform(2e-4, 0.02) * sound / (0.5e-3 * diameters[0])
    settings = {
        "material.young_GPa": young,
        "material.density_kg_m3": density,
        "pair.module_mm": module,
        "pair.pressure_angle_deg": angle,
        "pair.helix_angle_deg": helix,
        "pair.torque_pinion_Nm": 0.5e-3 * force * diameters[0],
        "pair.misalignment_inclination_um": draw.uniform(-0.02, 0.02) * 1e3 * module,
        "mesh.pinion_speed_rad_s": speed,
        "sweep.pinion_speed_rad_s": [0.1 * speed, 1.5 * speed],
        "map.depth_um": f"{{ to = {0.05e3 * module} }}",
    }
    if draw.random() < 0.5:
        settings["pair.centre_distance_mm"] = centres
    for gear, count, diameter in zip(("pinion", "wheel"), teeth, diameters, strict=True):
        width = face * draw.uniform(0.9, 1.2)
        root = diameter - 2.5 * module
        bore = root * draw.uniform(0.1, 0.7)
        mass = 0.25e-9 * math.pi * diameter**2 * width * density * draw.uniform(0.3, 3.0)
        length = draw.uniform(2.0, 5.0) * width + diameter * draw.uniform(0.2, 1.0)
        stiff = force / (module * 1e-3 * draw.uniform(1e-4, 0.02))
        settings |= {
            f"{gear}.teeth": count,
            f"{gear}.face_width_mm": width,
            f"{gear}.bore_mm": bore,
            f"{gear}.body.mass_kg": mass,
            f"{gear}.body.inertia_kg_m2": mass * (0.5e-3 * diameter) ** 2 * 0.6,
            f"flank.{gear}.tip_relief.depth_um": draw.choice([0.0, 20.0 * module]),
            f"flank.{gear}.crowning_um": draw.uniform(0.001, 0.01) * 1e3 * module,
            f"flank.{gear}.pitch_error_um": [draw.gauss(0.0, 5.0 * module)],
            f"flank.{gear}.eccentricity_um": draw.uniform(0.0, 20.0) * module,
            f"{gear}.shaft": f"{{ gear_at_mm = {0.4 * length}, segments = [ {{ length_mm = "
            f"{length}, outer_mm = {bore} }} ], bearings = [ {{ at_mm = 0.0, radial_N_m = {stiff}"
            f" }}, {{ at_mm = {length}, radial_N_m = {stiff} }} ] }}",
        }
    return [f"{key}={value}" for key, value in settings.items()]


@pytest.mark.parametrize("seed", quick(1, range(4)))
def test_no_sane_pair_is_refused_or_remarked_upon(tmp_path, seed):
    path = tmp_path / "sane.toml"
    path.write_text("schema = 1\n")
    draw = random.Random(seed)
    for _ in range(75):
        settings = _sane_pair(draw)
        scene = read_scene(path, settings)
        assert odd(scene) == [], settings


def test_spans_are_in_order():
    spans = {name: each for name, each in vars(_slips).items() if isinstance(each, _slips.Span)}
    assert len(spans) > 15
    assert all(list(each) == sorted(each) for each in spans.values())
