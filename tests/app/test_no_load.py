"""A scene at torque 0: the transmission error of rigid gears, and what has no meaning then."""

import numpy as np
import pytest

import jaxgear.study as studies
from jaxgear import plot
from jaxgear._checks import InputError
from jaxgear.scene import SceneError, read_scene

_SCENE = """\
schema = 1
[pair]
module_mm = 2.0
torque_pinion_Nm = 0
[pinion]
teeth = 25
face_width_mm = 12.0
[wheel]
teeth = 31
face_width_mm = 10.0
[mesh]
phases = 32
slices = 3
"""
_SLOPE = "flank.pinion.profile_slope_um=6"


@pytest.mark.slow
def test_a_profile_slope_is_a_saw_tooth_of_the_base_pitch(write):
    result = studies.run(read_scene(write(_SCENE), [_SLOPE]))
    error, phase = (result.dataset[name].values for name in ("unloaded_te_um", "phase"))
    # In a base pitch the contact moves by 1/eps_alpha of the path, over which the flank rises.
    ratio = result.summary["geometry"]["profile_contact_ratio"]
    order = np.argsort(phase % 1.0)
    slope = np.diff(error[order]) / np.diff((phase % 1.0)[order])
    fall = slope < 0.0
    assert np.sum(~fall) == 1
    np.testing.assert_allclose(slope[fall], -6.0 / ratio, rtol=1e-10)
    assert result.summary["static"]["te_unloaded_peak_to_peak_um"] == pytest.approx(
        6.0 / ratio, rel=1.5 / 32
    )


@pytest.mark.slow
def test_one_thick_tooth_lets_the_pinion_stay_behind_for_its_passage(write):
    errors = "flank.pinion.pitch_error_um=[" + ", ".join(["0.0"] * 7 + ["5.0"] + ["0.0"] * 17) + "]"
    result = studies.statics(read_scene(write(_SCENE), [errors, "mesh.periods=25"]))
    error, weight = (result.dataset[name].values for name in ("unloaded_te_um", "weight"))
    assert set(np.round(error, 9)) == {0.0, -5.0}
    # It touches alone from the entry of the pair to its exit: eps_alpha of 25 periods.
    ratio = result.summary["geometry"]["profile_contact_ratio"]
    assert 25.0 * np.sum(weight[error < -2.5]) == pytest.approx(ratio, abs=2.0 / 32)


@pytest.mark.slow
def test_it_is_what_every_run_under_load_says(write):
    flanks = [_SLOPE, "pair.helix_angle_deg=12", "flank.wheel.crowning_um=4"]
    loaded = studies.statics(read_scene(write(_SCENE), [*flanks, "pair.torque_pinion_Nm=50"]))
    free = studies.statics(read_scene(write(_SCENE), flanks))
    given = loaded.dataset["unloaded_te_um"].values
    # Lines that are about to enter depend on the torque's grid; what touches does not.
    np.testing.assert_allclose(free.dataset["unloaded_te_um"].values, given, rtol=0, atol=1e-9)
    span = "te_unloaded_peak_to_peak_um"
    assert free.summary["static"][span] == pytest.approx(loaded.summary["static"][span], rel=1e-12)
    alone = free.dataset["pair_te_um"].min("line").values
    np.testing.assert_allclose(free.dataset["unloaded_te_um"].values, alone, rtol=0, atol=0)


@pytest.mark.slow
def test_every_variable_has_a_unit_and_the_picture_its_tables(write):
    result = studies.run(read_scene(write(_SCENE), [_SLOPE, "sweep.pinion_speed_rad_s=[100.0]"]))
    for dataset in result.datasets.values():
        for name, variable in dataset.variables.items():
            assert {"units", "long_name"} <= set(variable.attrs), name
    names = [each.name for each in plot.pictures(result.datasets)]
    assert names == ["gear_pair", "axes", "modification", "unloaded_transmission_error"]
    picture = list(plot.pictures(result.datasets))[-1]
    assert set(picture.beside) == {"harmonics", "tooth_pairs"}
    time, _ = picture.draw().axes
    assert time.get_ylabel() == "transmission error [µm]"
    assert any("[sweep] does nothing" in note for note in result.notes)


@pytest.mark.parametrize(
    "study", ["relief_map", "modes", "check_gradients", "sensitivity", "compare", "sizing"]
)
def test_what_needs_a_load_refuses_by_name(write, study):
    with pytest.raises(SceneError, match=f"{study.replace('_', ' ')} has no meaning without load"):
        getattr(studies, study)(read_scene(write(_SCENE)))


def test_a_live_scene_needs_a_load(write):
    with pytest.raises(SceneError, match="has no meaning without load"):
        studies.live_scene(read_scene(write(_SCENE)))


def test_couples_on_the_pinions_shaft_are_a_load(write):
    shaft = """\
[pinion.shaft]
gear_at_mm = 30.0
segments = [{length_mm = 60.0, outer_mm = 20.0}]
bearings = [{at_mm = 0.0, radial_N_m = 2e8, axial_N_m = 1e8}, {at_mm = 60.0, radial_N_m = 2e8}]
loads = [{at_mm = 10.0, moment_Nm = [0.0, 0.0, 5.0]}]
"""
    with pytest.raises(InputError, match=r"couples about Z on pinion\.shaft\.loads, 5 N m"):
        studies.run(read_scene(write(_SCENE + shaft)))
