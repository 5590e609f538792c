"""Derivatives and searches of scenes in motion: what is computed, refused, and left out."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

import optimise
from jaxgear._cli._main import main
from jaxgear._interface._laws import ExactContact
from jaxgear.scene._scene import SceneError, example_scene, read_scene
from jaxgear.study._built import BuiltScene
from jaxgear.study._gradients import steady_gradients
from jaxgear.study._optimising import left_out
from jaxgear.study._search_checks import not_over_speeds
from jaxgear.study._steady import SteadyPoint, steady_point
from jaxgear.study._sweep_notes import left_out_notes, steady_notes

# A spur pair that only turns, on teeth that compile fast.
_TURNING = """\
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
[flank.pinion.tip_relief]
depth_um = 8
[mesh]
phases = 16
slices = 1
stiffness = "constant"
stiffness_N_mm_um = 14
[optimise]
vary = ["flank.pinion.tip_relief.depth_um"]
minimise = "dynamic_ratio"
max_evaluations = 12
"""
_SWEEP = """\
[sweep]
pinion_speed_rad_s = [600, 800, 1300]
steps = 32
harmonics = 8
"""


def _require_swept(scene):
    asked = scene.optimise, scene.damping, scene.sweep
    scene.refuse(not_over_speeds(*asked, scene.gears))


@pytest.mark.slow
def test_a_steady_response_by_flank_torque_damping_and_speed(write):
    """At the middle speed, in both directions, to 1e-5 of differences of converged responses."""
    scene = read_scene(write(_TURNING + _SWEEP))
    keys = ("pair.torque_pinion_Nm", "flank.pinion.tip_relief.depth_um", "damping.mesh")
    rows, points = steady_gradients(BuiltScene(scene), {"exact": ExactContact()}, keys)
    assert rows is not None
    (point,) = points
    assert (point.speed_rad_s, point.verdict) == (800.0, "ok")
    assert point.residual is not None
    assert point.condition is not None
    assert point.residual <= 1e-12
    assert 0.01 < point.condition <= 1.5
    assert not steady_notes(points)
    found = rows.to_dataframe().set_index(["response", "key"])
    every, names = (
        (*keys, "sweep.pinion_speed_rad_s"),
        ("te_rms_dynamic_um", "smooth_dynamic_ratio"),
    )
    assert set(found.index) == {(name, key) for name in names for key in every}
    assert set(found["verdict"]) == {"ok to 1e-5"}, found
    np.testing.assert_allclose(found["forward"], found["reverse"], rtol=1e-9)
    # Below the mesh mode, near 1000 rad/s: the nearer to it, the more it shakes.
    assert (rows["forward"][rows["key"] == every[-1]] > 0.0).all()


def test_no_numbers_where_there_is_no_derivative():
    def judged(residual, settled, condition):
        seen = jnp.asarray(residual), jnp.asarray(settled), jnp.asarray(condition)
        return steady_point("exact", 900.0, seen)

    assert judged(1e-14, True, 0.5).verdict == "ok"
    points = [judged(1e-3, False, 0.5), judged(1e-14, True, 3e-3), judged(np.nan, False, np.nan)]
    assert [point.verdict for point in points] == ["not converged", "near a fold", "not converged"]
    assert points[2].residual is None
    notes = steady_notes([*points, SteadyPoint("smooth", 9.0, None, None, "too many unknowns")])
    assert "900 rad/s has not converged, imbalance 0.001: it has no derivatives" in notes[0]
    assert "at a fold, or close to one, condition 0.003" in notes[1]
    assert "imbalance not finite" in notes[2]
    assert "too many mesh periods" in notes[3]


def test_searches_without_speeds_are_refused_with_all_mistakes_at_once(write):
    path = write(_TURNING + "[damping]\nmesh = 0\nstructure = 0\n")
    line = next(n for n, x in enumerate(_TURNING.splitlines(), 1) if x.startswith("minimise"))
    with pytest.raises(SceneError) as caught:
        _require_swept(read_scene(path))
    lines = str(caught.value).splitlines()
    assert lines[0].startswith(f"{path}:{line}: optimise.minimise: names dynamic_ratio")
    assert any("damping.mesh: no damping" in line for line in lines)
    assert lines[-1].startswith("2 mistakes")
    # Weights ask for it too; another objective does not.
    weighted = example_scene("accessory", ("optimise.minimise={te_rms=1.0, dynamic_ratio=2.0}",))
    with pytest.raises(SceneError, match=r"optimise\.minimise\.dynamic_ratio: names"):
        _require_swept(weighted)
    _require_swept(example_scene("accessory"))
    # So does what is traded; bearings that are not there shake nothing.
    asked = "optimise.minimise=te_rms", "optimise.pareto.against=bearing_force"
    path = write(_TURNING + _SWEEP)
    with pytest.raises(SceneError, match=r"pareto\.against: names bearing_force, but neither"):
        _require_swept(read_scene(path, asked))


def test_speeds_that_are_left_out_are_told():
    kept = jnp.array([True, False, True])
    speed, number = jnp.array([500.0, 1100.0, 1500.0]), jnp.array([1.2, jnp.nan, 1.1])
    judged = optimise.SpeedResults(speed, number, kept, jnp.array([1.0, 500.0, 2.0]), kept)
    whole = optimise.SpeedResults(speed, number, kept, jnp.ones(3), jnp.ones(3, dtype=bool))
    notes = left_out_notes([(80.0, judged)], [(80.0, whole)])
    assert "1 of 3 speeds were left out of what is taken over speeds before" in notes[0]
    assert "at 80 N m" in notes[0]
    assert "(1100 rad/s)" in notes[0]
    assert len(notes) == 1
    summary = left_out([(80.0, judged)], [(80.0, whole)])
    assert summary["speeds_left_out_before"][0]["count"] == 1
    assert summary["speeds_left_out_after"][0]["speeds_rad_s"].size == 0
    assert not left_out_notes([], [])
    assert left_out([], []) == {}


@pytest.mark.slow
def test_a_response_that_is_not_found_is_not_differentiated(write):
    """At 900 rad/s, where the branch from the quasi-static states has ended."""
    scene = read_scene(write(_TURNING + _SWEEP), ("sweep.pinion_speed_rad_s=[900.0]",))
    rows, points = steady_gradients(BuiltScene(scene), {"exact": ExactContact()}, ("damping.mesh",))
    assert rows is None
    assert points[0].verdict == "not converged"
    assert points[0].residual is not None
    assert points[0].residual > 1e-3


@pytest.mark.slow
def test_optimise_the_dynamic_ratio(write, tmp_path, capsys):
    path = write(_TURNING + _SWEEP)
    assert main(["optimise", str(path), "--json", "--out", str(tmp_path / "out")]) == 0
    told = json.loads(capsys.readouterr().out)
    found = told["optimise"]
    assert found["after"]["objective"] < found["before"]["objective"]
    assert found["speeds_left_out_after"][0]["of"] == 3
    assert found["starts"] == 2
    assert [each["evaluations"] > 0 for each in found["searches"]] == [True, True]
    assert found["smooth_objective"] == min(x["smooth_objective"] for x in found["searches"])
