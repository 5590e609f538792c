import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import pytest

from jaxgear.scene import _rewriting, _scene, _schema
from jaxgear.scene._positions import positions
from jaxgear.scene._rewriting import rewrite_scene, write_scene
from jaxgear.scene._scene import SceneError, example_scene, read_scene

_ROOT = Path(_scene.__file__).parents[2]
_READY = Path(_scene.__file__).parent / "scenes"

# The smallest scene; a test adds lines below, or replaces a piece of it.
_LEAST = """\
schema = 1
[pair]
module_mm = 1.5
torque_pinion_Nm = 80
[pinion]
teeth = 45
face_width_mm = 11.5
[wheel]
teeth = 86
face_width_mm = 9.5
"""
_END = _LEAST.count("\n")

# Everything that the contract with users shows, the commented lines included.
_CONTRACT = """\
schema = 1
name = "accessory"
cite = "Guilbert 2017, Tab. III-1"
[material]
young_GPa = 206.0
poisson = 0.3
density_kg_m3 = 7850.0
[pair]
module_mm = 1.5
pressure_angle_deg = 25.0
helix_angle_deg = 0.0
torque_pinion_Nm = 80.0
centre_distance_mm = 99.45
misalignment_inclination_um = 1.0
misalignment_deviation_um = -1.0
[pinion]
teeth = 45
profile_shift = 0.341
addendum_coeff = 0.9447
dedendum_coeff = 1.1933
fillet_radius_coeff = 0.25
tip_shortening_coeff = 0.0
face_width_mm = 11.5
bore_mm = 30.0
foundation = "none"
[pinion.material]
young_GPa = 200.0
[pinion.body]
kind = "rigid"
mass_kg = 1.0
inertia_kg_m2 = 1e-3
transverse_inertia_kg_m2 = 1e-3
[wheel]
teeth = 86
face_width_mm = 9.5
[flank.pinion]
tip_relief = { depth_um = 15.0, extent = 0.25, shape = "linear" }
root_relief = { depth_um = 0.0, extent = 0.2 }
crowning_um = 0.0
end_relief = { side = "left", depth_um = 10.0, extent = 0.4, shape = "parabolic" }
helix_slope_um = -2.0
pitch_error_um = [0.0]
eccentricity_um = 0.0
[mesh]
periods = 1
stiffness = "constant"
stiffness_N_mm_um = 14
foundation = "weber"
slices = 20
phases = 64
contact = "smooth"
smoothing_um = 0.5
[model]
coordinates = 400
[damping]
kind = "rayleigh"
mesh = 0.07
structure = 0.02
a_R_1_s = 25.0
b_R_s = 2.5e-6
[sweep]
pinion_speed_rad_s = { from = 50.0, to = 3000.0, points = 300 }
direction = "both"
method = "auto"
centrifugal = true
[map]
depth_um = { from = 0, to = 40, points = 20 }
extent = { from = 0.05, to = 0.5, points = 10 }
torques_Nm = [40, 80]
[optimise]
vary = ["flank.pinion.tip_relief.depth_um", "flank.pinion.tip_relief.extent"]
symmetric = true
minimise = { te_rms = 1.0, max_pressure = 0.01 }
torques_Nm = [60.0, 80.0, 100.0]
over = "worst"
method = "adam"
max_evaluations = 10
bounds = { "flank.pinion.tip_relief.depth_um" = [0, 40] }
[wheel.support]
radial_N_m = 1e9
axial_N_m = 1e8
tilt_Nm_rad = 1e4
[pinion.support]
radial_S_N_m = 1e9
radial_T_N_m = 2e9
"""

# A shaft for each gear, errors, sizing: rows and entries that have paths of their own.
_SHAFTS = """\
[pinion.shaft]
gear_at_mm = 55.0
segments = [ { length_mm = 60.0, outer_mm = 30.0, inner_mm = 16.0 },   # the seat
             { length_mm = 20, outer_mm = 28 } ]
bearings = [ { at_mm = 0.0,  radial_N_m = 1.04e9, axial_N_m = 1.0e8, tilt_Nm_rad = 1.0e4 },
             { at_mm = 80.0, radial_S_N_m = 1.04e9, radial_T_N_m = 1e9, tilt_T_Nm_rad = 0 } ]
torque_at_mm = 0.0
shear_coeff = 0.9
loads = [ { at_mm = 1.0, force_N = [1.0, 0.0, 0.0] } ]   # a belt
[pinion.body]
kind = "beam"
[wheel.shaft]
gear_at_mm = 10
[[wheel.shaft.segments]]
length_mm = 20
outer_mm = 40   # thick
[[wheel.shaft.bearings]]
at_mm = 10
radial_N_m = 1e9
[housing]
stiffness_csv = "housing.csv"
[flank.pinion]
profile_slope_um = -1
profile_crowning_um = 2
elliptical_crowning_um = 1
bias_um = -3
profile_deviation_csv = "profile.csv"
topography_csv = "topography.csv"
accuracy_grade = 5
accuracy_waves = 4
accuracy_slopes = true
eccentricity_um = 2.0
eccentricity_angle_deg = 90
[flank.wheel]
pitch_error_um = [ PITCH
    0, 1 ]   # measured
[mesh]
periods = 45
line_load_updates = 1
tip_contact = true
[optimise]
vary = ["pinion.shaft.bearings[0].radial_N_m", "flank.wheel.pitch_error_um[85]"]
minimise = { face_load_factor = 1 }
[optimise.bounds]
"pinion.shaft.bearings[0].radial_N_m" = [1e8, 1e10]
"flank.wheel.pitch_error_um[85]" = [-5, 5]
"pinion.shaft.loads[0].force_N[1]" = [-1, 1]
[sizing]
torques_Nm = [40, 80]
symmetric = false
[sizing.amounts]
"flank.pinion.tip_relief.depth_um" = [0, 5, 10]
flank.wheel.crowning_um = [2]
""".replace("PITCH", "0, " * 84)

# The contract's own example, and what may be added to it.
_CONDENSED = """\
[wheel.body]
kind = "condensed"
web = { hub_outer_mm = 40, web_thickness_mm = 4, rim_inner_mm = 118, web_offset_mm = 0, web_angle_deg = 0, holes = 6, hole_diameter_mm = 18, hole_circle_mm = 80 }
interface = "herting"
modes = 50
young_GPa = 4e5
"""  # noqa: E501


def _mistakes(path: Path, overrides: Sequence[str] = ()) -> list[tuple[Any, str, str]]:
    """Return the mistakes as (line or argument, key, message)."""
    with pytest.raises(SceneError) as caught:
        read_scene(path, overrides)
    places = [mistake.where.removeprefix(f"{path}:") for mistake in caught.value.mistakes]
    return [
        (int(place) if place.isdecimal() else place, mistake.path, mistake.message)
        for place, mistake in zip(places, caught.value.mistakes, strict=True)
    ]


def test_the_smallest_scene_gets_every_default(write):
    scene = read_scene(write(_LEAST))
    assert scene.value("name") == "scene"
    assert scene.value("cite") == ""
    assert scene.value("pair.pressure_angle_deg") == 20.0
    assert scene.value("wheel.fillet_radius_coeff") == 0.38
    assert scene.value("flank.wheel.tip_relief.extent") == 0.25
    assert scene.value("flank.pinion.end_relief.side") == "both"
    assert (scene.value("mesh.slices"), scene.value("mesh.phases")) == (20, 64)
    assert (scene.value("map.extent.from"), scene.value("map.extent.to")) == (0.01, 0.5)
    assert scene.value("optimise.minimise") == "te_rms"
    assert type(scene.value("pair.torque_pinion_Nm")) is float
    assert type(scene.value("pinion.teeth")) is int


def test_optional_keys_stay_absent(write):
    scene = read_scene(write(_LEAST))
    for key in (
        "pinion.thickness_allowance_um",
        "pair.centre_distance_mm",
        "pinion.support.axial_N_m",
        "pinion.material.young_GPa",
        "mesh.stiffness_N_mm_um",
        "optimise.vary",
        "optimise.torques_Nm",
        "map.depth_um.to",
    ):
        assert key not in scene.values
    assert scene.value("pair.centre_distance_mm", 12.0) == 12.0
    assert scene.value("pair.centre_distance_mm") is None
    with pytest.raises(KeyError, match="center_distance_mm"):
        scene.value("pair.center_distance_mm")


def test_the_contract_is_read_as_written(write):
    scene = read_scene(write(_CONTRACT))
    assert scene.value("mesh.stiffness_N_mm_um") == 14.0
    assert scene.value("pinion.material.young_GPa") == 200.0
    assert scene.value("flank.pinion.end_relief.side") == "left"
    assert scene.value("sweep.pinion_speed_rad_s.points") == 300
    assert scene.value("optimise.minimise.max_pressure") == 0.01
    assert scene.value("optimise.torques_Nm") == [60.0, 80.0, 100.0]
    assert scene.value("optimise.bounds.flank.pinion.tip_relief.depth_um") == [0.0, 40.0]
    assert "optimise.minimise" not in scene.values
    assert scene.sweep.is_given
    assert scene.pinion.support.is_given
    assert not scene.wheel.material.is_given


def test_rows_and_entries_have_paths(write):
    path = write(_LEAST + _SHAFTS)
    scene = read_scene(path)
    assert scene.value("pinion.shaft.bearings[1].radial_T_N_m") == 1e9
    assert scene.value("pinion.shaft.segments[0].inner_mm") == 16.0
    assert scene.value("pinion.shaft.segments[1].inner_mm") == 0.0
    assert scene.value("pinion.shaft.loads[0].moment_Nm") == [0.0, 0.0, 0.0]
    assert scene.value("pinion.shaft.loads[0].force_N[0]") == 1.0
    assert scene.value("flank.wheel.pitch_error_um[85]") == 1.0
    assert scene.value("flank.wheel.pitch_error_um[86]", "none") == "none"
    assert (len(scene.pinion.shaft.bearings), scene.wheel.shaft.loads) == (2, ())
    assert scene.value("optimise.bounds.flank.wheel.pitch_error_um[85]") == [-5.0, 5.0]
    assert scene.value("sizing.amounts.flank.pinion.tip_relief.depth_um") == [0.0, 5.0, 10.0]
    assert scene.value("sizing.amounts.flank.wheel.crowning_um") == [2.0]
    lines = {
        "pinion.shaft.bearings[1].at_mm": 6,
        "wheel.shaft.segments[0].outer_mm": 16,
        "flank.wheel.pitch_error_um": 35,
        "flank.wheel.pitch_error_um[83]": 35,
        "flank.wheel.pitch_error_um[85]": 36,
        "optimise.bounds.flank.wheel.pitch_error_um[85]": 46,
    }
    assert {key: scene.where(key) for key in lines} == {
        key: f"{path}:{_END + line}" for key, line in lines.items()
    }
    assert scene.where("pinion.shaft.loads[0].moment_Nm[2]") == f"{path} (default)"


@pytest.mark.parametrize(
    ("added", "pinion", "wheel"),
    [
        ("", None, None),
        ("[pinion]\nbore_mm = 30\n[wheel]\nbore_mm = 0\n", None, "weber"),
        ('[mesh]\nstiffness = "iso6336"\n', "weber", "weber"),
        ('[pinion]\nfoundation = "none"\n[wheel]\nbore_mm = 9\n', "none", None),
        ('[pinion]\nbore_mm = 9\n[mesh]\nfoundation = "weber"\n', None, None),
    ],
)
def test_a_gear_that_is_to_have_no_bore_falls_back_on_weber(write, added, pinion, wheel):
    text = _LEAST
    for table in ("[pinion]\n", "[wheel]\n"):
        # The rows of the added table go into the one that is there.
        _, found, rest = added.partition(table)
        line = rest.partition("\n")[0]
        text = text.replace(table, f"{table}{line}\n") if found else text
        added = added.replace(f"{table}{line}\n", "") if found else added
    scene = read_scene(write(text + added))
    assert scene.value("mesh.foundation") == ("weber" if 'foundation = "weber' in added else "ring")
    assert scene.value("pinion.foundation") == pinion
    assert scene.value("wheel.foundation") == wheel
    assert "(default)" in scene.where("wheel.foundation")


def test_a_foundation_asked_for_needs_a_bore(write):
    text = _LEAST.replace("[wheel]", 'foundation = "none"\n[wheel]')
    text += '[mesh]\nfoundation = "sainsot"'
    ((line, path, message),) = _mistakes(write(text))
    assert (line - _END, path) == (3, "mesh.foundation")
    assert "give wheel.bore_mm a value > 0" in message
    read_scene(write(text.replace("[wheel]", "[wheel]\nbore_mm = 20")))


def test_a_beam_falls_back_on_weber_unless_told_otherwise(write):
    least = _LEAST.replace("[pinion]\n", "[pinion]\nbore_mm = 20\n")
    assert read_scene(write(least + _SHAFTS)).value("pinion.foundation") == "weber"
    asked = least.replace("[pinion]\n", '[pinion]\nfoundation = "sainsot"\n')
    assert read_scene(write(asked + _SHAFTS)).value("pinion.foundation") == "sainsot"


def test_a_condensed_body_gets_its_defaults_and_others_do_not(write):
    scene = read_scene(write(_LEAST + _CONDENSED))
    assert scene.value("wheel.body.young_GPa") == 4e5
    assert scene.value("wheel.body.seat_coupling") == "rigid"
    assert scene.value("wheel.body.modes") == 50
    assert not any(key.startswith("pinion.body.") for key in scene.values if "kind" not in key)
    rigid = read_scene(write(_LEAST + _CONDENSED), ["wheel.body.kind=rigid"])
    assert rigid.value("wheel.body.modes") == 50
    assert "wheel.body.seat_coupling" not in rigid.values


def test_leaning_teeth_tell_more_motions_of_a_body_apart(write):
    scene = read_scene(write(_LEAST + _CONDENSED), ["pair.helix_angle_deg=0.0"])
    assert scene.at_mesh == 8
    traced = jax.eval_shape(
        lambda helix: jnp.zeros(scene.replace({"pair.helix_angle_deg": helix}).at_mesh), 0.0
    )
    assert traced.shape == (8,), "it does not change while derivatives are taken"
    lean = read_scene(write(_LEAST + _CONDENSED), ["pair.helix_angle_deg=-8.0"])
    assert lean.at_mesh == 24
    assert lean.replace({"mesh.periods": 3}).at_mesh == 28
    assert scene.replace({"mesh.periods": 3}).at_mesh == 16
    assert lean.replace({"model.mesh_coordinates": 9}).at_mesh == 9
    assert (scene.at_mesh_of_reference, lean.at_mesh_of_reference) == (24, 40)
    assert scene.replace({"mesh.periods": 3}).at_mesh_of_reference == 40
    assert lean.replace({"mesh.periods": 3}).at_mesh_of_reference == 150
    assert lean.replace({"model.mesh_coordinates": 50}).at_mesh_of_reference == 50


def test_leaning_teeth_on_two_condensed_bodies_want_more_of_each():
    def kept(name: str, *settings: str) -> tuple[int, int]:
        scene = example_scene(name, settings)
        return scene.shape_count, scene.at_mesh

    assert kept("power-h2") == kept("power-webbed-pinion") == (350, 24)
    assert kept("power-h2", "pinion.body.kind=rigid") == kept("power-h1") == (250, 24)
    assert kept("accessory-h2") == kept("accessory-h1") == (200, 8)
    assert kept("power-h2", "model.coordinates=60", "model.mesh_coordinates=9") == (60, 9)
    assert kept("power-h2", "model.shapes=natural") == (100, 24)


def test_a_condensed_scene_reads_back_as_it_was_written(write, tmp_path):
    scene = read_scene(write(_LEAST + _CONDENSED))
    write_scene(scene, tmp_path / "again.toml")
    again = read_scene(tmp_path / "again.toml")
    assert {**again.values, "name": scene.value("name")} == dict(scene.values)


_BODY = '[wheel.body]\nkind = "condensed"\n'
_WEB = "web.hub_outer_mm = 40\nweb.web_thickness_mm = 4\nweb.rim_inner_mm = 118\n"


@pytest.mark.parametrize(
    ("added", "line", "key", "message"),
    [
        ("[wheel.body]\nweb.hub_outer_mm = 40\nweb.rim_inner_mm = 9", 2, "web.web_thickness_mm",
         "is missing: thickness of the web"),
        (_BODY + _WEB + "web.hole_circel_mm = 1", 6, "web.hole_circel_mm", "did you mean"),
        (_BODY + 'grid = "a.inp"\nrim_set = "R"\nseats = ["S"]\nsuperelement = "b"\n'
         'superelement_units = "mm-t-s"', 6, "superelement", "excludes wheel.body.grid"),
        (_BODY + 'interface = "hertin"', 3, "interface", 'one of "herting", "craig'),
        (_BODY + 'grid = "a.inp"\nseats = ["S"]', 3, "grid", "needs wheel.body.rim_set"),
        (_BODY + 'grid = "a.inp"\ninterface = "R"', 3, "grid", "needs wheel.body.seats"),
        (_BODY + 'grid = "a.inp"\ninterface = "R"\nrim_set = "R"\nseats = ["S"]', 4, "interface",
         "or the rim's node set of a body.grid where rim_set does not name it"),
        (_BODY + 'grid = "a.inp"\ninterface = "R"\nseats = ["S", "T"]', 5, "seats",
         "got 2 names, must be 1, that of the bore"),
        (_BODY + 'rim_set = "R"', 3, "rim_set", "is about a grid of your own, and there is none"),
        (_BODY + 'superelement = "a.mtx"', 3, "superelement", "needs wheel.body.super"),
        (_BODY + 'superelement_nodes = "a.csv"', 3, "superelement_nodes", "goes with wheel.body"),
        (_BODY + 'seat_coupling = "averaging"\ninterface = "craig-bampton"', 3, "seat_coupling",
         "the modes of craig-bampton are those of a body held at its seats"),
        (_BODY + "fineness.sectors = 86\nfineness.elements_per_tooth = 1", 3, "fineness.sectors",
         "excludes wheel.body.fineness.elements_per_tooth"),
        ("bore_mm = 40.0\n" + _BODY + _WEB, 4, "web.hub_outer_mm", "greater than bore_mm, 40"),
        (_BODY + _WEB.replace("118", "39"), 5, "web.rim_inner_mm", "greater than hub_outer_mm, 40"),
        (_BODY + _WEB.replace("118", "126"), 5, "web.rim_inner_mm", "the root circle, 125.25"),
        (_BODY + _WEB.replace("= 4\n", "= 9.6\n"), 4, "web.web_thickness_mm", "face_width_mm, 9.5"),
        (_BODY + _WEB + "web.holes = 6\nweb.hole_circle_mm = 80", 3, "web.hole_diameter_mm",
         "is missing, and 6 holes need it"),
        (_BODY + _WEB + "web.hole_circle_mm = 80", 3, "web.holes", "is missing: number of holes"),
        (_BODY + _WEB + "web.holes = 6\nweb.hole_diameter_mm = 45\nweb.hole_circle_mm = 80", 6,
         "web.holes", "run into each other"),
        (_BODY + _WEB + "web.holes = 6\nweb.hole_diameter_mm = 10\nweb.hole_circle_mm = 108", 8,
         "web.hole_circle_mm", "holes that reach from 98 to 118 mm cut rim_inner_mm, 118"),
    ],
)  # fmt: skip
def test_a_condensed_body_that_cannot_be_is_refused(write, added, line, key, message):
    found = {(at - _END, path): text for at, path, text in _mistakes(write(_LEAST + added))}
    places = [place for place in found if place[1] == f"wheel.body.{key}"]
    assert (line, f"wheel.body.{key}") in found, found
    assert message in found[places[0]]


_SHAFT = "[wheel.shaft]\ngear_at_mm = 5\n"
_SEGMENTS = "segments = [{ length_mm = 7, outer_mm = 9 },\n{ length_mm = 3, outer_mm = 9 }]\n"
_BEARINGS = "bearings = [{ at_mm = 10 }]\n"
_GOOD_SHAFT = _SHAFT + _SEGMENTS + _BEARINGS


def test_the_end_of_a_shaft_is_still_on_it(write):
    segments = ", ".join(["{ length_mm = 6.4, outer_mm = 9 }"] * 3)
    shaft = f"[wheel.shaft]\ngear_at_mm = {6.4 + 12.8}\nsegments = [{segments}]\n"
    assert 6.4 + 12.8 > 19.2
    read_scene(write(f"{_LEAST}{shaft}bearings = [{{ at_mm = 19.2 }}]\n"))


def test_all_mistakes_of_shafts_are_reported_at_once(write):
    text = _SHAFTS.replace("outer_mm = 28", "outer_mm = -28").replace("1 ]   #", "1, 0 ] #")
    text = text.replace("[housing]", "[wheel.support]").replace("stiffness_csv", "axial_N_mm")
    text = text.replace("_mm = 80.0, rad", "_mm = 81.0, rad")
    assert [path for _, path, _ in _mistakes(write(_LEAST + text))] == [
        "pinion.shaft.segments[1].outer_mm",
        "pinion.shaft.bearings[1].at_mm",
        "wheel.support",
        "wheel.support.axial_N_mm",
        "flank.wheel.pitch_error_um",
    ]


def _told(line, path, text, said):
    """Whether a mistake is the one that is told as `line path: part of its words`."""
    place, words = said.split(": ", 1)
    return f"{line} {path}" == place and words in text


@pytest.mark.parametrize(
    ("added", "said"),
    [
        (_SHAFT + _BEARINGS, "1 wheel.shaft.segments: is missing: a shaft needs at least one row"),
        (_SHAFT + _SEGMENTS, "1 wheel.shaft.bearings: is missing: a shaft needs at least one row"),
        (_SHAFT + _SEGMENTS + "bearings = []", "5 wheel.shaft.bearings: is missing: a shaft needs"),
        (
            "[wheel.shaft]\n" + _SEGMENTS + _BEARINGS,
            "1 wheel.shaft.gear_at_mm: is missing: position of",
        ),
        (_GOOD_SHAFT.replace("= 5", "= 10.1"), "2 wheel.shaft.gear_at_mm: add up to 10"),
        (
            _GOOD_SHAFT + "torque_at_mm = 11",
            "6 wheel.shaft.torque_at_mm: got 11.0, which is beyond the end",
        ),
        (
            _GOOD_SHAFT + "loads = [{ at_mm = 11 }]",
            "6 wheel.shaft.loads[0].at_mm: got 11.0, which is bey",
        ),
        (
            _GOOD_SHAFT + "unbalance = [{ at_mm = 11, moment_gmm = 1 }]",
            "6 wheel.shaft.unbalance[0].at_mm: got 11.0, which is beyond the end of the shaft",
        ),
        (
            _GOOD_SHAFT + "unbalance = [{ at_mm = -1, moment_gmm = 1 }]",
            "6 wheel.shaft.unbalance[0].at_mm: got -1, must be a number >= 0 [mm]",
        ),
        (
            _GOOD_SHAFT + "unbalance = [{ at_mm = 1, moment_gmm = -1 }]",
            "6 wheel.shaft.unbalance[0].moment_gmm: It is a size: its direction is angle_deg",
        ),
        (
            _GOOD_SHAFT + "unbalance = [{ at_mm = 1 }]",
            "6 wheel.shaft.unbalance[0].moment_gmm: is missing: mass of an unbalance times",
        ),
        (
            _GOOD_SHAFT + "unbalance = [{ at_mm = 1, moment_gmm = 1, moment_g = 1 }]",
            "6 wheel.shaft.unbalance[0].moment_g: did you mean wheel.shaft.unbalance[].moment_gmm?",
        ),
        (
            _GOOD_SHAFT + "unbalance = [{ at_mm = 5.1, moment_gmm = 1 }]\n[wheel.body]\n"
            'kind = "beam"',
            "6 wheel.shaft.unbalance[0].at_mm: Give its parts at both ends of the face",
        ),
        (_GOOD_SHAFT.replace("= 10 }", "= 12 }"), "5 wheel.shaft.bearings[0].at_mm: add up to 10"),
        (
            _GOOD_SHAFT.replace("outer_mm = 9 }]", "outer_mm = 9, inner_mm = 9 }]"),
            "4 wheel.shaft.segments[1].inner_mm: got 9.0, must be less than outer_mm, 9.0",
        ),
        (
            _GOOD_SHAFT.replace("= 10 }", "= 10, radial_N_m = 1, radial_S_N_m = 1 }"),
            "5 wheel.shaft.bearings[0].radial_N_m: excludes radial_S_N_m. Keep one way",
        ),
        (
            _GOOD_SHAFT.replace(
                "= 10 }", "= 10, tilt_S_Nm_rad = 1, tilt_T_Nm_rad = 1, tilt_Nm_rad = 1 }"
            ),
            (
                "5 wheel.shaft.bearings[0].tilt_Nm_rad: excludes tilt_S_Nm_rad and "
                "tilt_T_Nm_rad. Keep one way"
            ),
        ),
        (
            _GOOD_SHAFT.replace("at_mm = 10", ""),
            "5 wheel.shaft.bearings[0].at_mm: is missing: position",
        ),
        (
            _GOOD_SHAFT.replace("length_mm = 3, ", ""),
            "4 wheel.shaft.segments[1].length_mm: is missing",
        ),
        (
            _GOOD_SHAFT.replace("= 3,", "= 0,"),
            "4 wheel.shaft.segments[1].length_mm: must be a number > 0",
        ),
        (
            _GOOD_SHAFT.replace("{ at_mm", "\n{ at_mn = 1, at_mm"),
            "6 wheel.shaft.bearings[0].at_mn: did you mean wheel.shaft.bearings[].at_mm?",
        ),
        (
            _SHAFT + _SEGMENTS + "bearings = 3",
            "5 wheel.shaft.bearings: must be a list of tables with at_mm",
        ),
        (
            _GOOD_SHAFT + "loads = [{ at_mm = 0, moment_Nm = [1, 2] }]",
            "6 wheel.shaft.loads[0].moment_Nm: must be a list of 3 numbers [N m]",
        ),
        ("[mesh]\nslices = 0", "2 mesh.slices: got 0, must be an integer >= 1 and <= 2000"),
        ("[mesh]\nslices = 20.0", "2 mesh.slices: must be an integer >= 1 and <= 2000. Write 20"),
        ("[mesh]\nphases = 7", "2 mesh.phases: got 7, must be an integer >= 8 and <= 4096"),
        ("[mesh]\nphases = true", "2 mesh.phases: got true, must be an integer"),
        ("[mesh]\nsmoothing_um = nan", "2 mesh.smoothing_um: It must be finite"),
        ("[mesh]\nsmoothing_um = inf", "2 mesh.smoothing_um: It must be finite"),
        ('[mesh]\ncontact = "exakt"', '2 mesh.contact: did you mean "exact"?'),
        ('[mesh]\nstiffness = "constant"', "1 mesh.stiffness_N_mm_um: is missing"),
        ("[mesh]\nslice = 3", "2 mesh.slice: unknown key, got 3, did you mean mesh.slices?"),
        ("[mesch]\nslices = 3\nx = 4", "1 mesch: unknown table, did you mean [mesh]?"),
        ("[material]\npoisson = 0.5", "2 material.poisson: must be a number >= 0 and < 0.5"),
        ("[material]\nyoung_GPa = 206e9", "2 material.young_GPa: in gigapascals"),
        ("[[mesh]]\nslices = 3", "1 mesh: must be a table with"),
        ("[pair.module_um]\nx = 1", "1 pair.module_um: unknown table"),
        ("[flank.pinion]\ncrowning_um = -1", "2 flank.pinion.crowning_um: material removed"),
        ("[flank]\npinion.tip_relief = 15", "2 flank.pinion.tip_relief: must be a table with"),
        ("[flank.wheel.crowning_um]", "1 flank.wheel.crowning_um: got a table, must be a num"),
        (
            "[flank.pinion]\ntip_relief = { depth_um = -15.0 }",
            (
                "2 flank.pinion.tip_relief.depth_um: got -15.0, must be a number >= 0 [um]. A "
                "depth is material removed"
            ),
        ),
        (
            "[flank.pinion]\ntip_relief = { extent = 1.5 }",
            (
                "2 flank.pinion.tip_relief.extent: a fraction of the path of contact eps_alpha "
                "p_bt, from 0 to 1; a value above 1 looks as if millimetres were given"
            ),
        ),
        (
            "[flank.pinion]\nend_relief = { extent = 4.0 }",
            "2 flank.pinion.end_relief.extent: a fraction of the face width",
        ),
        ("[wheel.support]\nradial_N_m = 0", "2 wheel.support.radial_N_m: is rigid"),
        (
            "[wheel.support]\nradial_N_m = 1e9\nradial_S_N_m = 1e9",
            "2 wheel.support.radial_N_m: excludes radial_S_N_m",
        ),
        (
            _GOOD_SHAFT + "[wheel.support]\naxial_N_m = 1e9",
            "6 wheel.support: excludes wheel.shaft, whose bearings hold the gear",
        ),
        ('[wheel.body]\nkind = "beam"', "2 wheel.body.kind: there is no [wheel.shaft]"),
        (
            'foundation = "sainsot"',
            (
                "1 wheel.foundation: give wheel.bore_mm a value > 0, or write wheel.foundation "
                '= "weber"'
            ),
        ),
        (
            "[flank.wheel]\npitch_error_um = [1, 2]",
            (
                "2 flank.wheel.pitch_error_um: got 2 values, must be 1 or 86, one for each of "
                "wheel.teeth"
            ),
        ),
        ("[housing]\nstifness_csv = 1", "2 housing.stifness_csv: mean housing.stiffness_csv?"),
        (
            '[sizing.amounts]\n"flank.wheel.bias_mm" = [1]',
            (
                "2 sizing.amounts.flank.wheel.bias_mm: did you mean "
                "sizing.amounts.flank.wheel.bias_um?"
            ),
        ),
        (
            "[sizing.amounts]\nflank.wheel.tip_relief.extent = [0.2, 1.5]",
            ("2 sizing.amounts.flank.wheel.tip_relief.extent: a fraction of the path of contact"),
        ),
        ('[damping]\nkind = "rayleigh"\na_R_1_s = 1.0', "1 damping.b_R_s: is missing"),
        ("[sweep]", "1 sweep.pinion_speed_rad_s: is missing"),
        ("[sweep]\npinion_speed_rad_s = []", "2 sweep.pinion_speed_rad_s: got [], must be a"),
        (
            "[sweep]\npinion_speed_rad_s = { from = 1.0, points = 3 }",
            "2 sweep.pinion_speed_rad_s.to: is missing",
        ),
        ("[map]\nextent = { from = 0.6 }", "2 map.extent.from: less than `to`, 0.5"),
        ("[map]\ndepth_um.to = 0.0", "2 map.depth_um.to: must be a number > 0 [um]"),
        ("[map]\ntorques_Nm = [80.0, -1.0]", "2 map.torques_Nm: It is a size"),
        ("[optimise]", "1 optimise.vary: is missing"),
        ("[optimise]\nvary = []", "2 optimise.vary: got [], must be a list of texts"),
        (
            '[optimise]\nvary = [\n  "pair.module_mm", # a comment\n  "pinion.teeth",\n]',
            '4 optimise.vary[1]: got "pinion.teeth", must be the path of a real-valued key',
        ),
        (
            '[optimise]\nvary = ["flank.pinion.tip_relief.depht_um"]',
            '2 optimise.vary[0]: did you mean "flank.pinion.tip_relief.depth_um"?',
        ),
        (
            '[optimise]\nvary = ["pair.module_mm",\n"pair.module_mm"]',
            "3 optimise.vary[1]: is named twice",
        ),
        (
            '[optimise]\nvary = ["pair.centre_distance_mm"]',
            "2 optimise.vary[0]: has no value to start from",
        ),
        (
            _GOOD_SHAFT + '[optimise]\nvary = ["wheel.shaft.bearings[1].axial_N_m"]',
            (
                "7 optimise.vary[0]: names number 1 of wheel.shaft.bearings, which has 1, "
                "counted from 0"
            ),
        ),
        (
            _GOOD_SHAFT + '[optimise]\nvary = ["wheel.shaft.bearings[0].axial_N_m"]',
            "7 optimise.vary[0]: has no value to start from",
        ),
        (
            _GOOD_SHAFT + '[optimise]\nvary = ["wheel.shaft.bearings.at_mm"]',
            '7 optimise.vary[0]: did you mean "wheel.shaft.bearings[0].at_mm"?',
        ),
        (
            '[optimise]\nvary = ["flank.pinion.pitch_error_um[3]"]',
            "2 optimise.vary[0]: names number 3 of flank.pinion.pitch_error_um, which has 1",
        ),
        (
            '[optimise]\nvary = ["flank.pinion.pitch_error_um"]',
            '2 optimise.vary[0]: did you mean "flank.pinion.pitch_error_um[0]"?',
        ),
        (
            _GOOD_SHAFT + '[optimise]\nvary = ["wheel.shaft.bearings[0].at_mm"]\n'
            '[optimise.bounds]\n"wheel.shaft.bearings[0].at_mm" = [0, 9]',
            (
                "9 optimise.bounds.wheel.shaft.bearings[0].at_mm: must contain the starting "
                "value 10.0 of wheel.shaft.bearings[0].at_mm"
            ),
        ),
        (
            '[optimise]\nvary = ["pair.module_mm"]\n[optimise.bounds]\n'
            '"wheel.shaft.loads[0].at_mm" = [0, 1]',
            (
                "4 optimise.bounds.wheel.shaft.loads[0].at_mm: names number 0 of "
                "wheel.shaft.loads, which has 0"
            ),
        ),
        (
            '[optimise]\nvary = ["pair.module_mm"]\n[optimise.bounds]\n'
            '"wheel.shaft.loads[].at_mm" = [0, 1]',
            (
                "4 optimise.bounds.wheel.shaft.loads[].at_mm: did you mean "
                "optimise.bounds.wheel.shaft.loads[0].at_mm?"
            ),
        ),
        (
            '[optimise]\nvary = ["pair.module_mm"]\nminimise = {}',
            "3 optimise.minimise: must have at least one weight > 0",
        ),
        (
            '[optimise]\nvary = ["pair.module_mm"]\nminimise = { te_rms = -1 }',
            "3 optimise.minimise.te_rms: got -1, must be a number >= 0",
        ),
        (
            '[optimise]\nvary = ["pair.module_mm"]\n[optimise.bounds]\npair.module_mm = [3, 2]',
            "4 optimise.bounds.pair.module_mm: got [3.0, 2.0], must be [low, high]",
        ),
        (
            '[optimise]\nvary = ["pair.module_mm"]\nbounds = { "pair.module_mm" = [2, 3] }',
            (
                "3 optimise.bounds.pair.module_mm: must contain the starting value 1.5 of "
                "pair.module_mm"
            ),
        ),
        (
            '[optimise]\nvary = ["pair.module_mm"]\nbounds = { "pair.modul_mm" = [1, 3] }',
            "3 optimise.bounds.pair.modul_mm: did you mean optimise.bounds.pair.module_mm?",
        ),
        (
            '[optimise]\nvary = ["pair.module_mm"]\n'
            'bounds = { "pair.module_mm" = [1, 3], pair.module_mm = [1, 2] }',
            "3 optimise.bounds.pair.module_mm: is given twice",
        ),
    ],
)
def test_one_mistake_is_reported_alone_at_its_line(write, added, said):
    ((line, path, text),) = _mistakes(write(_LEAST + added + "\n"))
    assert _told(line - _END, path, text, said)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("schema = 1", "schema = 2", "1 schema: This version of jaxgear reads scene format 1"),
        ("schema = 1", 'schema = 1\nname = "a/b"', "2 name: It names a folder"),
        ("schema = 1", '"mesh.slices" = 1\nschema = 1', '1 "mesh.slices": did you mean mesh.sl'),
        ("= 80", '= "80"', "4 pair.torque_pinion_Nm: Write 80, without the quotes"),
        ("= 80", "= 80\nhelix_angle_deg = 46", "5 pair.helix_angle_deg: <= 45 [degrees]"),
        ("= 80", "= 80\npressure_angle_deg = 0.35", "5 pair.pressure_angle_deg: in degrees"),
        ("= 80", "= 1979-05-27", "4 pair.torque_pinion_Nm: got 1979-05-27, must be a number"),
        ("module_mm = 1.5", "module_mm = 0.0015", "3 pair.module_mm: The key is in millimetres"),
        ("teeth = 45\n", "", "5 pinion.teeth: is missing: number of teeth. It must be an integer"),
    ],
)
def test_one_bad_value_is_reported_alone(write, old, new, said):
    ((line, path, text),) = _mistakes(write(_LEAST.replace(old, new, 1)))
    assert _told(line, path, text, said)


def test_missing_tables_are_reported_at_the_file(write):
    path = write("schema = 1\n")
    mistakes = _mistakes(path)
    assert [key for _, key, _ in mistakes] == [
        "pair.module_mm",
        "pair.torque_pinion_Nm",
        "pinion.teeth",
        "pinion.face_width_mm",
        "wheel.teeth",
        "wheel.face_width_mm",
    ]
    assert {where for where, _, _ in mistakes} == {str(path)}


def test_all_mistakes_come_at_once_and_in_the_order_of_the_file(write):
    path = write(
        'naem = "x"\nschema = 1\n[wheel]\nteeth = "86"\n[pair]\ntorque_pinion_Nm = "0"\n[foo]\n'
    )
    with pytest.raises(SceneError) as caught:
        read_scene(path, ["mesh.slices=0"])
    block = str(caught.value).splitlines()
    assert [line.partition(": ")[0] for line in block[:-1]] == [
        str(path),
        str(path),
        f"{path}:1",
        f"{path}:3",
        f"{path}:4",
        f"{path}:5",
        f"{path}:6",
        f"{path}:7",
        "--set mesh.slices=0",
    ]
    assert block[2] == f'{path}:1: naem: unknown key, got "x", did you mean name?'
    assert block[-1] == "9 mistakes; nothing was computed."


def test_of_very_many_mistakes_the_first_are_listed(write, monkeypatch):
    compared = []
    usual = _schema.nearest
    monkeypatch.setattr(_schema, "nearest", lambda *given: compared.append(1) or usual(*given))
    unknown = "".join(f"naem{number} = 1\n" for number in range(150))
    with pytest.raises(SceneError) as caught:
        read_scene(write(unknown + _LEAST))
    block = str(caught.value).splitlines()
    assert len(block) == 102
    assert block[0].endswith("naem0: unknown key, got 1, did you mean name?")
    assert block[-2:] == ["... and 50 more", "150 mistakes; nothing was computed."]
    assert len(compared) == 100


def test_a_file_without_an_end_is_no_scene():
    with pytest.raises(SceneError, match="/dev/zero: the file is longer than 10,000,000 bytes"):
        read_scene("/dev/zero")


def test_one_mistake_is_counted_in_the_singular(write):
    with pytest.raises(SceneError, match=r"\n1 mistake; nothing was computed\.$"):
        read_scene(write(_LEAST.replace("= 80", "= true")))


@pytest.mark.parametrize(
    ("content", "line", "message"),
    [
        (b"schema = 1\n[pair\nx = 1\n", 2, "not valid TOML"),
        (b"schema = 1\nschema = 1\n", 2, "not valid TOML"),
        (b"a = " + b"[" * 5000, None, "not valid TOML"),
        (b"schema = 1\n# caf\xe9\n", 2, "not UTF-8"),
    ],
)
def test_an_unreadable_file_names_the_line(tmp_path, content, line, message):
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    ((where, key, text),) = _mistakes(path)
    assert where == (line or str(path))
    assert key == ""
    assert message in text


def test_a_missing_file_and_a_folder_are_mistakes(tmp_path):
    ((where, _, message),) = _mistakes(tmp_path / "none.toml")
    assert where == str(tmp_path / "none.toml")
    assert "no such file" in message
    ((_, _, message),) = _mistakes(tmp_path)
    assert "this is a folder" in message


def test_a_byte_order_mark_and_dos_line_ends_do_no_harm(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbf" + _LEAST.replace("\n", "\r\n").encode())
    assert read_scene(path).lines["wheel.teeth"] == f"{path}:9"


def test_positions_in_every_form_of_toml(write):
    path = write(
        """\
schema = 1
"name" = 'x'   # quoted
pair.module_mm = 1.5
pair . torque_pinion_Nm = 80
wheel = { teeth = 86, face_width_mm = 9.5 }

[pinion]
teeth = 45
'face_width_mm' = 11.5
support.axial_N_m = 1e8
[ flank . "pinion" ]
tip_relief = { depth_um = 3, extent = 0.3 }
root_relief.depth_um = 1
[flank.wheel.end_relief]

side = "left"
[optimise]
vary = [
    # the first
    "pair.module_mm",

    "flank.pinion.crowning_um",
]
[optimise.bounds]
"pair.module_mm" = [
    1.0,
    2.0 ]
"""
    )
    lines = {
        key: int(place.removeprefix(f"{path}:")) for key, place in read_scene(path).lines.items()
    }
    assert lines == {
        "schema": 1,
        "name": 2,
        "pair.module_mm": 3,
        "pair.torque_pinion_Nm": 4,
        "wheel.teeth": 5,
        "wheel.face_width_mm": 5,
        "pinion.teeth": 8,
        "pinion.face_width_mm": 9,
        "pinion.support.axial_N_m": 10,
        "flank.pinion.tip_relief.depth_um": 12,
        "flank.pinion.tip_relief.extent": 12,
        "flank.pinion.root_relief.depth_um": 13,
        "flank.wheel.end_relief.side": 16,
        "optimise.vary": 18,
        "optimise.bounds.pair.module_mm": 25,
    }


def test_positions_in_arrays_of_tables():
    text = "[[a.b]]\nx = 1\n[[a.b]]\nx = [\n1,\n{ y = 2 }] # c\n[a.b.c]\nz = 1\n"
    assert positions(text) == {
        "a": 1,
        "a.b": 1,
        "a.b[0]": 1,
        "a.b[0].x": 2,
        "a.b[1]": 3,
        "a.b[1].x": 4,
        "a.b[1].x[0]": 5,
        "a.b[1].x[1]": 6,
        "a.b[1].x[1].y": 6,
        "a.b[1].c": 7,
        "a.b[1].c.z": 8,
    }


def test_every_position_of_a_ready_scene_shows_its_key():
    path = _READY / "power.toml"
    text = path.read_text().splitlines()
    lines = read_scene(path).lines
    assert len(lines) > 40
    for key, place in lines.items():
        line = text[int(place.rpartition(":")[2]) - 1]
        assert key.rpartition(".")[2] in line


@pytest.mark.parametrize(
    ("override", "key", "value"),
    [
        ("pair.torque_pinion_Nm=120", "pair.torque_pinion_Nm", 120.0),
        (" pair.torque_pinion_Nm = 1.2e2 ", "pair.torque_pinion_Nm", 120.0),
        ("name=plain", "name", "plain"),
        ('name="quoted=text"', "name", "quoted=text"),
        ("name=a=b", "name", "a=b"),
        ("optimise.symmetric=true", "optimise.symmetric", True),
        ("map.depth_um.points=7", "map.depth_um.points", 7),
        ("map.torques_Nm=[1, 2]", "map.torques_Nm", [1.0, 2.0]),
        ("optimise.bounds.pair.module_mm=[1, 2]", "optimise.bounds.pair.module_mm", [1.0, 2.0]),
        ('optimise.bounds."pair.module_mm"=[1, 2]', "optimise.bounds.pair.module_mm", [1.0, 2.0]),
    ],
)
def test_set_changes_a_key_and_is_where_it_came_from(write, override, key, value):
    path = write(_LEAST + '[optimise]\nvary = ["pair.module_mm"]\n')
    scene = read_scene(path, [override])
    assert scene.value(key) == value
    assert scene.where(key) == f"--set {override}"
    assert scene.overridden() == {key: value}
    assert scene.where("wheel.teeth") == f"{path}:9"
    assert scene.where("cite") == f"{path} (default)"


_PITCH = [0.0] * 85 + [1.0]


@pytest.mark.parametrize(
    ("override", "changed"),
    [
        ("pinion.shaft.bearings[0].radial_N_m=2e9", {"pinion.shaft.bearings[0].radial_N_m": 2e9}),
        ("wheel.shaft.bearings[0].axial_N_m = 1", {"wheel.shaft.bearings[0].axial_N_m": 1.0}),
        ("wheel.shaft.segments[ 0 ].'outer_mm'=9", {"wheel.shaft.segments[0].outer_mm": 9.0}),
        ("flank.wheel.pitch_error_um[3]=-2", {"flank.wheel.pitch_error_um[3]": -2.0}),
        ("flank.pinion.pitch_error_um[0]=4", {"flank.pinion.pitch_error_um[0]": 4.0}),
        (
            "pinion.shaft.loads[0].moment_Nm[1]=7",
            {"pinion.shaft.loads[0].moment_Nm[1]": 7.0},
        ),
        (f"flank.wheel.pitch_error_um={_PITCH}", {"flank.wheel.pitch_error_um": _PITCH}),
        (
            "optimise.bounds.pinion.shaft.bearings[0].radial_N_m=[1, 2e9]",
            {"optimise.bounds.pinion.shaft.bearings[0].radial_N_m": [1.0, 2e9]},
        ),
        (
            'optimise.bounds."flank.wheel.pitch_error_um[85]"=[0, 2]',
            {"optimise.bounds.flank.wheel.pitch_error_um[85]": [0.0, 2.0]},
        ),
        (
            "sizing.amounts.flank.pinion.tip_relief.depth_um=[1]",
            {"sizing.amounts.flank.pinion.tip_relief.depth_um": [1.0]},
        ),
        (
            "pinion.shaft.segments[1]={ length_mm = 30, outer_mm = 20 }",
            {"pinion.shaft.segments[1]": {"length_mm": 30.0, "outer_mm": 20.0, "inner_mm": 0.0}},
        ),
        (
            "wheel.shaft.bearings=[{ at_mm = 0 }, { at_mm = 9, tilt_Nm_rad = 1 }]",
            {"wheel.shaft.bearings": [{"at_mm": 0.0}, {"at_mm": 9.0, "tilt_Nm_rad": 1.0}]},
        ),
        (
            "pinion.shaft.loads=[]",
            {"pinion.shaft.loads": []},
        ),
    ],
)
def test_set_of_rows_and_entries_is_kept_when_rewriting(write, tmp_path, override, changed):
    text = _LEAST + _SHAFTS.replace('"pinion.shaft.loads[0].force_N[1]" = [-1, 1]', "")
    path = write(text)
    scene = read_scene(path, [override])
    assert scene.overridden() == changed
    assert {scene.where(key) for key in changed} <= {f"--set {override}", f"{path} (default)"}
    rewrite_scene(path, scene.overridden(), tmp_path / "new.toml")
    after = read_scene(tmp_path / "new.toml")
    assert {**after.values, "name": "scene"} == dict(scene.values)
    assert (tmp_path / "new.toml").read_text().count("# ") == text.count("# ")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("pinion.shaft.bearings[2].at_mm=1", "cannot be set: bearings has 2 entries, counted from"),
        ("flank.wheel.pitch_error_um[86]=1", "cannot be set: pitch_error_um has 86 entries"),
        ("flank.pinion.pitch_error_um[1]=1", "cannot be set: there is no list pitch_error_um"),
        ("pinion[0].teeth=1", "cannot be set: there is no list pinion"),
        ("pinion.shaft.bearings[0]at_mm=1", "must be key=value"),
        ("[0]=1", "must be key=value"),
    ],
)
def test_a_bad_index_names_the_argument(write, override, message):
    ((where, _, text),) = _mistakes(write(_LEAST + _SHAFTS), [override])
    assert where == f"--set {override}"
    assert message in text


def test_the_later_set_wins(write):
    scene = read_scene(write(_LEAST), ["mesh.slices=3", "mesh.slices=4"])
    assert scene.value("mesh.slices") == 4
    assert scene.where("mesh.slices") == "--set mesh.slices=4"


def test_set_of_an_inline_table_replaces_the_table(write):
    path = write(_LEAST + '[flank.pinion]\ntip_relief = { depth_um = 3, shape = "parabolic" }\n')
    override = "flank.pinion.tip_relief={depth_um=10, extent=0.3}"
    scene = read_scene(path, [override])
    assert scene.overridden() == {
        "flank.pinion.tip_relief.depth_um": 10.0,
        "flank.pinion.tip_relief.extent": 0.3,
        "flank.pinion.tip_relief.shape": "linear",
    }


@pytest.mark.parametrize("spelling", ["pair.module_mm", '"pair.module_mm"'])
def test_set_of_a_bound_finds_the_spelling_of_the_file(write, spelling):
    bounds = f'[optimise]\nvary = ["pair.module_mm"]\n[optimise.bounds]\n{spelling} = [1, 2]\n'
    scene = read_scene(write(_LEAST + bounds), ["optimise.bounds.pair.module_mm=[1, 3]"])
    assert scene.value("optimise.bounds.pair.module_mm") == [1.0, 3.0]


def test_set_turns_a_text_into_weights_and_back(write):
    optimise = '[optimise]\nvary = ["pair.module_mm"]\nminimise = '
    scene = read_scene(write(_LEAST + optimise + '"te_rms"\n'), ["optimise.minimise.te_rms=2"])
    assert (scene.value("optimise.minimise"), scene.value("optimise.minimise.te_rms")) == (
        None,
        2.0,
    )
    scene = read_scene(
        write(_LEAST + optimise + "{ te_rms = 1 }\n"), ["optimise.minimise=max_pressure"]
    )
    assert scene.value("optimise.minimise") == "max_pressure"
    assert "optimise.minimise.te_rms" not in scene.values


@pytest.mark.parametrize(
    ("override", "path", "message"),
    [
        ("pair.tork=5", "pair.tork", "unknown key, got 5, did you mean pair.torque_pinion_Nm?"),
        ("pair.torque_pinion_Nm=high", "pair.torque_pinion_Nm", 'got "high", must be a number'),
        ("pair.torque_pinion_Nm=", "pair.torque_pinion_Nm", 'got "", must be a number'),
        ("pair.torque_pinion_Nm=1\nx=2", "pair.torque_pinion_Nm", "must be a number"),
        ("mesch.slices=3", "mesch", "unknown table, did you mean [mesh]?"),
        ("mesh=3", "mesh", "got 3, must be a table with"),
        ("mesh.slices", "", "must be key=value"),
        ("=3", "", "must be key=value"),
        ("mesh..slices=3", "", "must be key=value"),
        ("flank.wheel.tip_relief={extent=3}", "flank.wheel.tip_relief.extent", "a fraction of"),
    ],
)
def test_a_bad_set_names_the_argument(write, override, path, message):
    ((where, found, text),) = _mistakes(write(_LEAST), [override])
    assert (where, found) == (f"--set {override}", path)
    assert message in text


def test_set_repairs_a_mistake_of_the_file(write):
    path = write(_LEAST.replace("= 80", '= "0"'))
    assert read_scene(path, ["pair.torque_pinion_Nm=60"]).value("pair.torque_pinion_Nm") == 60.0


@pytest.mark.parametrize("name", sorted(path.stem for path in _READY.glob("*.toml")))
def test_ready_scenes_round_trip(tmp_path, name):
    scene = read_scene(_READY / f"{name}.toml")
    assert scene.value("name") == name
    write_scene(scene, tmp_path / "copy.toml")
    assert read_scene(tmp_path / "copy.toml").values == scene.values


@pytest.mark.parametrize(
    "text",
    [_LEAST, _CONTRACT, _LEAST + _SHAFTS, _LEAST + "[map]\n[sweep]\npinion_speed_rad_s=[1,2]"],
)
def test_round_trip_keeps_values_and_requests(write, tmp_path, text):
    scene = read_scene(write(text))
    write_scene(scene, tmp_path / "copy.toml")
    copy = read_scene(tmp_path / "copy.toml")
    assert copy.values == scene.values
    for table in ("sweep", "map", "optimise", "damping", "model", "sizing", "wheel.shaft"):
        assert (table in copy.given) == (table in scene.given)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy.toml", "scene.toml"]


def test_round_trip_of_awkward_text(write, tmp_path):
    cite = 'Müller, "Zähne" \\ 3\t\u007f\nnext'
    scene = read_scene(write(_LEAST)).replace({"cite": cite})
    write_scene(scene, tmp_path / "copy.toml")
    assert read_scene(tmp_path / "copy.toml").value("cite") == cite


def test_replace_checks_nothing_and_leaves_the_scene_alone(write):
    scene = read_scene(write(_LEAST))
    traced = object()
    changed = scene.replace({"pair.module_mm": traced, "pinion.support.axial_N_m": 1e8})
    assert changed.value("pair.module_mm") is traced
    assert changed.pinion.support.is_given
    assert scene.value("pair.module_mm") == 1.5
    assert "pinion.support.axial_N_m" not in scene.values
    with pytest.raises(TypeError):
        scene.values["pair.module_mm"] = 3.0  # ty: ignore[invalid-assignment]


def test_replace_of_an_entry_leaves_the_others_alone(write):
    scene = read_scene(write(_LEAST + _SHAFTS))
    changed = scene.replace(
        {"flank.wheel.pitch_error_um[3]": 2.0, "pinion.shaft.bearings[0].axial_N_m": 3.0}
    )
    pitch = changed.value("flank.wheel.pitch_error_um")
    assert (pitch[3], pitch[85], sum(map(bool, pitch))) == (2.0, 1.0, 2)
    assert scene.value("flank.wheel.pitch_error_um[3]") == 0.0
    assert changed.value("pinion.shaft.bearings[0].axial_N_m") == 3.0
    with pytest.raises(KeyError, match="86"):
        scene.replace({"flank.wheel.pitch_error_um[86]": 1.0})


def test_what_is_traced_is_known_as_it_was_before(write):
    import jax
    import jax.numpy as jnp

    at, force = "pinion.shaft.bearings[1].at_mm", "pinion.shaft.loads[0].force_N"
    scene = read_scene(write(_LEAST + _SHAFTS)).replace({at: 70.0})
    seen = {}

    def inside(value):
        traced = scene.replace({at: value}).replace({at: 2.0 * value, f"{force}[1]": value})
        later = traced.replace({f"{force}[2]": 5.0, "pair.centre_distance_mm": value})
        seen.update(
            at=later.fixed[at],
            force=later.fixed[force],
            entry=later.fixed[force][2],
            plain=later.plain.pinion.shaft.bearings[1].at_mm,
            forgotten={at, force} & {*later.replace({at: 60.0, force: [1.0, 2.0, 3.0]}).moved},
            same_keys={*later.real_keys()} - {*scene.real_keys()},
        )
        assert later.plain.pair.centre_distance_mm is None
        whole = scene.replace({force: jnp.stack([value, value, value])})
        seen["whole"] = whole.fixed[force][0]
        shaft = later.pinion.shaft
        return shaft.bearings[1].at_mm + shaft.loads[0].force_N[1] + whole.value(f"{force}[2]")

    assert jax.jit(jax.grad(inside))(1.5) == 4.0
    assert seen == {
        "at": 70.0,
        "force": [1.0, 0.0, 5.0],
        "entry": 5.0,
        "plain": 70.0,
        "forgotten": set(),
        "same_keys": {"pair.centre_distance_mm"},
        "whole": 1.0,
    }


def test_keys_are_attributes_of_tables_that_do_not_change(write):
    scene = read_scene(write(_LEAST + _SHAFTS))
    assert scene.pinion.shaft.bearings[0].at_mm == scene.value("pinion.shaft.bearings[0].at_mm")
    assert scene.map.extent.from_ == scene.value("map.extent.from")
    assert scene.gear("wheel").teeth == scene.wheel.teeth == scene.value("wheel.teeth")
    assert scene.pinion.support.axial_N_m is None
    assert scene.probes == ()
    with pytest.raises(AttributeError, match=r"scene\.replace makes another one"):
        scene.mesh.slices = 3  # ty: ignore[invalid-assignment]
    with pytest.raises(AttributeError, match="a scene has no mash"):
        scene.mash  # noqa: B018
    changed = scene.replace({"mesh.slices": 3, "optimise.bounds.pair.module_mm": [1.0, 2.0]})
    assert (changed.mesh.slices, scene.mesh.slices) == (3, 20)
    assert changed.optimise.bounds["pair.module_mm"] == [1.0, 2.0]


def test_real_keys_count_rows_and_entries(write):
    real = read_scene(write(_LEAST + _SHAFTS)).real_keys()
    assert len(real) == len(set(real))
    rows = [key for key in real if key.startswith("pinion.shaft.")]
    assert rows == [
        "pinion.shaft.gear_at_mm",
        *(
            f"pinion.shaft.segments[{i}].{n}_mm"
            for n in ("length", "outer", "inner")
            for i in (0, 1)
        ),
        "pinion.shaft.bearings[0].at_mm",
        "pinion.shaft.bearings[1].at_mm",
        "pinion.shaft.bearings[0].radial_N_m",
        "pinion.shaft.bearings[1].radial_S_N_m",
        "pinion.shaft.bearings[1].radial_T_N_m",
        "pinion.shaft.bearings[0].axial_N_m",
        "pinion.shaft.bearings[0].tilt_Nm_rad",
        "pinion.shaft.bearings[1].tilt_T_Nm_rad",
        "pinion.shaft.torque_at_mm",
        "pinion.shaft.shear_coeff",
        "pinion.shaft.loads[0].at_mm",
        *(f"pinion.shaft.loads[0].{n}[{i}]" for n in ("force_N", "moment_Nm") for i in range(3)),
    ]
    pitch = [key for key in real if "pitch_error_um" in key]
    assert pitch == [f"flank.wheel.pitch_error_um[{tooth}]" for tooth in range(86)]


def test_real_keys_are_those_present_that_count(write):
    least = read_scene(write(_LEAST)).real_keys()
    assert least[:3] == ("material.young_GPa", "material.poisson", "pair.module_mm")
    assert "mesh.smoothing_um" not in least
    assert "pair.centre_distance_mm" not in least
    full = read_scene(write(_CONTRACT)).real_keys()
    assert {"mesh.smoothing_um", "mesh.stiffness_N_mm_um", "pair.centre_distance_mm"} <= set(full)
    assert {"wheel.support.radial_N_m", "pinion.material.young_GPa"} <= set(full)
    assert not any(key.startswith(("optimise", "map", "sweep")) for key in full)


def test_rewriting_keeps_the_comments_and_the_order(tmp_path):
    source, target = _READY / "accessory.toml", tmp_path / "better.toml"
    updates = {
        "flank.pinion.tip_relief.depth_um": 14.25,
        "flank.wheel.tip_relief.depth_um": 14.25,
        "pair.torque_pinion_Nm": 90.0,
        "flank.wheel.crowning_um": 3.0,
        "wheel.material.young_GPa": 210.0,
    }
    rewrite_scene(source, updates, target)
    before, after = read_scene(source), read_scene(target)
    assert dict(after.values) == {**before.values, **updates}
    old, new = source.read_text().splitlines(), target.read_text().splitlines()
    lost = [line for line in old if line not in new]
    assert len(lost) == 3
    assert [line.partition("#")[2] for line in lost if "torque" in line] == [
        next(line for line in new if line.startswith("torque_pinion_Nm")).partition("#")[2]
    ]


@pytest.mark.parametrize(
    "text",
    [
        _LEAST,
        _LEAST + "[flank]\nwheel.crowning_um = 4.0 # c\n[pinion.material]\npoisson = 0.2\n",
        _LEAST + "[flank.wheel]\ntip_relief.depth_um = 3 # c\n[flank.pinion.tip_relief]\n",
        "flank = {pinion = {crowning_um = 1}}\n" + _LEAST,
        "flank.wheel.tip_relief.depth_um = 3 # c\n" + _LEAST,
        _LEAST
        + '[optimise]\nvary = ["pair.module_mm"]\n[optimise.bounds.pair]\nmodule_mm = [1, 3]\n',
    ],
)
def test_rewriting_adds_keys_to_any_layout(write, tmp_path, text):
    updates = {
        "flank.pinion.tip_relief.depth_um": 1.0,
        "flank.wheel.tip_relief.extent": 0.5,
        "flank.wheel.crowning_um": 2.0,
        "pair.helix_angle_deg": 3.0,
        "pinion.material.young_GPa": 100.0,
        "mesh.slices": 7,
        "optimise.vary": ["pair.module_mm"],
        "optimise.minimise.te_rms": 1.0,
        "optimise.bounds.pair.module_mm": [1.0, 2.0],
    }
    before = read_scene(write(text))
    rewrite_scene(write(text), updates, tmp_path / "new.toml")
    after = read_scene(tmp_path / "new.toml")
    # Bores that were left out are a share of the root circles, which the helix widens.
    bores = {key: after.value(key) for key in ("pinion.bore_mm", "wheel.bore_mm")}
    wanted = {**before.values, **updates, **bores, "name": "new"}
    del wanted["optimise.minimise"]
    assert dict(after.values) == wanted
    assert text.count("# c") == (tmp_path / "new.toml").read_text().count("# c")


def test_rewriting_changes_rows_and_entries(write, tmp_path):
    text = _LEAST.replace("[wheel]", "[wheel]\nbore_mm = 40") + _SHAFTS
    updates = {
        "pinion.shaft.bearings[0].radial_N_m": 2e9,
        "pinion.shaft.bearings[1].axial_N_m": 1e7,
        "pinion.shaft.segments[1].outer_mm": 29.0,
        "pinion.shaft.loads[0].force_N[1]": 3.0,
        "pinion.shaft.loads[0].moment_Nm[2]": 4.0,
        "pinion.shaft.loads[0].moment_Nm[0]": 5.0,
        "wheel.shaft.segments[0].outer_mm": 41.0,
        "flank.wheel.pitch_error_um[85]": 2.0,
        "optimise.bounds.flank.wheel.pitch_error_um[85]": [-9.0, 9.0],
        "sizing.amounts.flank.wheel.bias_um": [1.0],
    }
    before = read_scene(write(text))
    rewrite_scene(write(text), updates, tmp_path / "new.toml")
    after = read_scene(tmp_path / "new.toml")
    assert {**after.values, "name": "scene"} == dict(before.replace(updates).values)
    old, new = text.splitlines(), (tmp_path / "new.toml").read_text().splitlines()
    assert len(set(old) - set(new)) == 7
    comments = [[line.partition("#")[2] for line in text if "#" in line] for text in (old, new)]
    assert comments[0] == comments[1] == [" the seat", " a belt", " thick", " measured"]
    with pytest.raises(ValueError, match=r"has no .*bearings\[2\].*bearings has 2 entries"):
        rewrite_scene(write(text), {"pinion.shaft.bearings[2].at_mm": 1}, tmp_path / "new.toml")


def test_rewriting_refuses_rather_than_write_something_else(write, tmp_path, monkeypatch):
    monkeypatch.setattr(_rewriting, "_edited", lambda text, updates, headers: text)
    with pytest.raises(ValueError, match=r"by hand: pair\.module_mm = 2\.0"):
        rewrite_scene(write(_LEAST), {"pair.module_mm": 2}, tmp_path / "new.toml")
    assert not (tmp_path / "new.toml").exists()


def test_rewritten_numbers_may_be_arrays(write, tmp_path):
    import jax.numpy as jnp

    rewrite_scene(write(_LEAST), {"pair.module_mm": jnp.asarray(2.5)}, tmp_path / "new.toml")
    assert tomllib.loads((tmp_path / "new.toml").read_text())["pair"]["module_mm"] == 2.5


def test_reading_a_scene_imports_nothing_heavy():
    program = (
        "import sys, types\n"
        "for name in ('jaxgear', 'jaxgear.scene'):\n"
        "    package = types.ModuleType(name)\n"
        "    package.__path__ = [sys.argv[1] + '/' + name.replace('.', '/')]\n"
        "    sys.modules[name] = package\n"
        "from jaxgear.scene import _scene\n"
        "_scene.read_scene(sys.argv[2])\n"
        "print(sorted({'jax', 'numpy', 'tomlkit'} & set(sys.modules)))\n"
    )
    command = [sys.executable, "-c", program, str(_ROOT), str(_READY / "power.toml")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_table_knows_what_the_user_wrote_in_it():
    scene = example_scene("accessory", ["mesh.periods=2"])
    assert scene.mesh.is_given
    assert scene.mesh.written("periods", "line_load_updates") == ["periods"]
    assert not scene.robust.is_given
    assert scene.replace({"robust.seed": 3}).robust.given == {"seed"}
    assert scene.damping.values["kind"] == "modal"
    assert "given" not in scene.damping.values
