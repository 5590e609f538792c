"""A scene with a negative torque: its coast flanks carry, as drive flanks do in the mirror."""

import math

import numpy as np
import pytest

import jaxgear.study as studies
from jaxgear.scene import SceneError, read_scene
from jaxgear.scene._build import model_of

_SCENE = """\
schema = 1
[pair]
module_mm = 2.0
torque_pinion_Nm = 60
[pinion]
teeth = 25
face_width_mm = 12.0
[pinion.shaft]
gear_at_mm = 40.0
segments = [{length_mm = 100.0, outer_mm = 22.0}]
bearings = [{at_mm = 0.0, radial_N_m = 2e8, axial_N_m = 1e8}, {at_mm = 100.0, radial_N_m = 2e8}]
[wheel]
teeth = 31
face_width_mm = 10.0
[flank.pinion.tip_relief]
depth_um = 8.0
[flank.wheel]
helix_slope_um = 5.0
[mesh]
phases = 16
slices = 3
stiffness = "constant"
stiffness_N_mm_um = 14.0
"""
_BACK = "pair.torque_pinion_Nm=-60"
_HELIX = "pair.helix_angle_deg=12"


def _solved(write, *overrides):
    return studies.statics(read_scene(write(_SCENE), overrides))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("coast") / "scene.toml"
    return lambda text: path.write_text(text, encoding="utf-8") and path


@pytest.fixture(scope="module")
def helical(written):
    return _solved(written, _HELIX, _BACK)


@pytest.fixture(scope="module")
def mirrored(written):
    return _solved(written, "pair.helix_angle_deg=-12")


@pytest.mark.slow
def test_flanks_carry_as_those_of_the_mirrored_pair(helical, mirrored):
    for name in ("transmission_error_um", "pressure_MPa", "line_load_N_mm", "gap_um"):
        np.testing.assert_array_equal(helical.dataset[name], mirrored.dataset[name])
    assert helical.dataset.attrs["torque_pinion_Nm"] == -60.0
    np.testing.assert_array_equal(helical.dataset["torque_Nm"], -mirrored.dataset["torque_Nm"])
    assert float(helical.datasets["pair"]["helix_angle_deg"]) == pytest.approx(12.0, rel=1e-14)


@pytest.mark.slow
def test_what_points_along_t_and_turns_about_s_and_z_is_the_other_way_round(helical, mirrored):
    for name, signs in {
        "bearing_load_N": (1.0, -1.0, 1.0),
        "bearing_displacement_um": (1.0, -1.0, 1.0),
        "displacement_um": (1.0, -1.0, 1.0),
        "body_force_N": (1.0, -1.0, 1.0),
        "body_moment_Nm": (-1.0, 1.0, -1.0),
        "rotation_urad": (-1.0, 1.0, -1.0),
    }.items():
        own, other = helical.dataset[name], mirrored.dataset[name]
        np.testing.assert_array_equal(own.values, other.values * np.asarray(signs))
        assert own.attrs == other.attrs


@pytest.mark.slow
def test_bearings_carry_what_statics_by_hand_says(helical):
    facts = helical.summary["geometry"]
    tangential = 60.0 / (1e-3 * facts["working_pitch_radius_pinion_mm"])
    towards_pinion = tangential * math.tan(math.radians(facts["working_pressure_angle_deg"]))
    # Against a clockwise drive the wheel pushes a pinion, which is on its left, up: towards +T. A
    # right-hand pinion is pushed where its thumb points if fingers turn with it: towards -Z.
    ratio = facts["working_pitch_radius_pinion_mm"] / facts["reference_radius_pinion_mm"]
    axial = -tangential * math.tan(math.radians(12.0)) * ratio
    first, second = helical.summary["static"]["bearings"]
    load = lambda axis: first["load_N"][axis] + second["load_N"][axis]
    assert load("T") == pytest.approx(tangential, rel=1e-9)
    assert load("S") == pytest.approx(-towards_pinion, rel=1e-9)
    assert load("Z") == pytest.approx(axial, rel=1e-9)
    # Moments about the first bearing: the force acts near mid-face, 40 of 100 mm along the shaft.
    assert second["load_N"]["T"] == pytest.approx(0.4 * tangential, rel=0.02)


@pytest.mark.slow
def test_the_drawing_shows_the_gears_as_they_are(helical, written):
    driven = _solved(written, _HELIX)
    names = helical.datasets["axes"]["arrow"].values.tolist()
    for arrow, (s, t, z) in {
        "rotation of the pinion": (0.0, 0.0, -1.0),
        "torque on the wheel": (0.0, 0.0, -1.0),
    }.items():
        place = names.index(arrow)
        along = [float(helical.datasets["axes"][f"along_{axis}"][place]) for axis in "STZ"]
        assert along == [s, t, z]
    for gear in ("pinion", "wheel"):
        # Teeth lean as they do, whichever flank carries.
        place = names.index(f"tooth trace of the {gear}")
        for name in ("S_mm", "T_mm", "Z_mm", "along_S", "along_T", "along_Z"):
            own, other = (float(it.datasets["axes"][name][place]) for it in (helical, driven))
            assert own == pytest.approx(other, abs=1e-12)
    outline = helical.datasets["pair"]
    np.testing.assert_array_equal(outline["T_mm"], -driven.datasets["pair"]["T_mm"].values)


@pytest.mark.slow
def test_a_symmetrical_spur_pair_is_as_good_either_way(write):
    forth, back = _solved(write), _solved(write, _BACK)
    for name, value in forth.summary["static"].items():
        if isinstance(value, float):
            assert back.summary["static"][name] == value, name


@pytest.mark.slow
def test_coast_flanks_have_their_own_modifications(write):
    relief = "flank.pinion_coast.tip_relief.depth_um=20"
    drive = _solved(write, "flank.pinion.tip_relief.depth_um=20")
    # The table says all of the flank; the wheel's coast flank is as its drive flank.
    back = _solved(write, _BACK, relief)
    forth = _solved(write, relief)
    error = "transmission_error_um"
    np.testing.assert_array_equal(back.dataset[error], drive.dataset[error])
    np.testing.assert_array_equal(forth.dataset[error], _solved(write).dataset[error])
    assert "Without [flank.wheel_coast]" in " ".join(back.notes)


def test_loads_misalignment_and_housing_are_mirrored(write, tmp_path):
    block = np.diag([3e8, 2e8, 4e8, 3e8, 2e8, 4e8])
    block[0, 1] = block[1, 0] = 4e7
    rows = "\n".join(",".join(map(str, row)) for row in block)
    (tmp_path / "housing.csv").write_text(rows + "\n", encoding="utf-8")
    given = [
        "pinion.shaft.loads=[{at_mm=20.0, force_N=[1.0,2.0,3.0], moment_Nm=[4.0,5.0,6.0]}]",
        "pair.misalignment_inclination_um=7",
        "pair.misalignment_deviation_um=9",
        "housing.stiffness_csv=housing.csv",
    ]
    model = model_of(read_scene(write(_SCENE), [*given, _BACK]))
    (load,) = model.pinion_support.loads
    assert load.force.tolist() == [1.0, -2.0, 3.0]
    assert load.moment.tolist() == [-4.0, 5.0, -6.0]
    assert float(model.misalignment.inclination) == pytest.approx(7e-6)
    assert float(model.misalignment.deviation) == pytest.approx(-9e-6)
    assert model.housing is not None
    assert float(model.housing.stiffness[0, 1]) == -4e7
    assert float(model.torque) == 60.0


@pytest.mark.parametrize(
    ("overrides", "study", "said"),
    [
        (['pinion.body.kind="condensed"'], "statics", "no mirror image"),
        (["flank.pinion.eccentricity_um=5"], "statics", r"in \[flank\.pinion_coast\]"),
        (["flank.wheel.pitch_error_um=[1.0]"], "modes", r"in \[flank\.wheel_coast\]"),
        (["flank.pinion_coast.crowning_um=2"], "relief_map", "the map varies"),
        (
            ["flank.pinion_coast.crowning_um=2", 'optimise.vary=["flank.pinion.crowning_um"]'],
            "optimise",
            r"Vary flank\.pinion_coast\.crowning_um",
        ),
        ([], "live_scene", "a live scene moves the torque"),
    ],
)
def test_what_has_no_mirror_image_is_refused(write, overrides, study, said):
    with pytest.raises(SceneError, match=said):
        getattr(studies, study)(read_scene(write(_SCENE), [_BACK, *overrides]))


@pytest.mark.slow
def test_modes_sweep_and_search_are_those_of_the_mirrored_pair(write):
    coarse = ["mesh.slices=2", "mesh.phases=8", "sweep.steps=32", "sweep.harmonics=6"]
    more = [
        "sweep.pinion_speed_rad_s=[900.0, 1400.0]",
        'sweep.direction="cold"',
        'optimise.vary=["flank.pinion.tip_relief.depth_um"]',
        'optimise.minimise="te_rms"',
    ]
    found = {}
    for sense in (1, -1):
        given = [f"pair.helix_angle_deg={-12 * sense}", f"pair.torque_pinion_Nm={60 * sense}"]
        scene = read_scene(write(_SCENE), [*given, *coarse, *more])
        modes, sweep, search = (
            getattr(studies, name)(scene) for name in ("modes", "sweep", "optimise")
        )
        moved = sweep.datasets["sweep"]
        found[sense] = (
            modes.summary["modes"]["frequency_Hz"],
            moved["dynamic_ratio"].values,
            moved["bearing_load_order_N"].values,
            list(search.summary["optimise"]["after"].values()),
        )
        assert moved.attrs["torque_pinion_Nm"] == 60.0 * sense
    for own, other in zip(found[-1], found[1], strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-9)


@pytest.mark.slow
def test_derivatives_are_by_the_keys_of_the_real_pair(write):
    coarse = ["mesh.slices=2", "mesh.phases=8", "pair.helix_angle_deg=12", _BACK]
    text = _SCENE.partition("[pinion.shaft]")[0] + "[wheel]" + _SCENE.partition("[wheel]")[2]
    found = studies.check_gradients(read_scene(write(text), coarse)).summary["check_grad"]
    assert found["verdicts"]["WRONG"] == 0
    # More of a negative torque is less load.
    slopes = {(row["response"], row["key"]): row["forward"] for row in found["rows"]}
    by_torque = [value for (_, key), value in slopes.items() if key == "pair.torque_pinion_Nm"]
    assert by_torque[0] < 0.0
