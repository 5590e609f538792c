"""[robust] of a scene: its mistakes, what scatters, and the robust optimum end to end."""

import json
import tomllib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close
from table_checks import assert_tables

import jaxgear as jg
import optimise
from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear.scene._build import grid_of, smooth_law_of
from jaxgear.scene._scene import Scene, SceneError, example_scene
from jaxgear.study import _robust as robust
from jaxgear.study._built import BuiltScene
from jaxgear.study._design import design_space
from jaxgear.study._objectives import limits_of, prepared_mesh
from jaxgear.study._scatter import Scatter, scatter_of

_DEPTH = "flank.pinion.tip_relief.depth_um"
_OTHER = "flank.wheel.tip_relief.depth_um"
_MISALIGNED = '"pair.misalignment_inclination_um"'


def _scene(*overrides: str) -> Scene:
    return example_scene("accessory", ["mesh.phases=16", "mesh.slices=3", *overrides])


@pytest.mark.parametrize(
    ("settings", "path", "words"),
    [
        (["robust.samples=100"], "robust.samples", "power of two.* Write 64 or 128"),
        (["robust.share=95.0"], "robust.share", "not a percentage"),
        (["robust.share=0.999"], "robust.samples", "Write 1024 or more"),
        (["robust.share=0.94", "robust.samples=16"], "robust.samples", "Write 32 or more"),
        ([f"robust.scatter.{_MISALIGNED}=-1.0"], "robust.scatter", "must be a number > 0"),
        (
            ["robust.scatter.pair.misalignment_um=1.0"],
            "robust.scatter",
            "did you mean robust.scatter.pair.misal",
        ),
        (["robust.scatter.pinion.shaft.bearings[7].at_mm=1.0"], "robust.scatter", "has 2, counted"),
        (["robust.scatter.pair.centre_distance_mm=0.1"], "robust.scatter", "no value to start"),
        (["robust.seed=0"], "robust", "nothing scatters"),
        (
            [f"robust.{table}.{_MISALIGNED}=5.0" for table in ("scatter", "even")],
            "robust.even",
            r"in \[robust.scatter\] too",
        ),
        (
            ["robust.accuracy_grade=6", "optimise.minimise=dynamic_ratio"],
            "robust",
            "repeated for every gear",
        ),
    ],
)
def test_mistakes_are_named(settings, path, words):
    with pytest.raises(SceneError, match=words) as found:
        _scene(*settings)
    assert any(mistake.path.startswith(path) for mistake in found.value.mistakes)


def test_a_robust_scene_needs_something_to_optimise(tmp_path):
    text = jg.example_scene("accessory").path.read_text(encoding="utf-8")
    path = tmp_path / "plain.toml"
    path.write_text(text.split("[optimise]")[0] + "[robust]\naccuracy_grade = 6\n")
    with pytest.raises(SceneError, match=r"there is no table \[optimise\]"):
        jg.read_scene(path)


def test_what_a_condensed_body_is_made_from_cannot_scatter():
    settings = "robust.scatter.pair.module_mm=0.01", f'optimise.vary=["{_DEPTH}"]'
    with pytest.raises(SceneError, match=r"condensed body is made from pair\.module_mm"):
        example_scene("accessory-h1", settings)


def _scatter(*overrides: str, teeth: int = 3) -> Scatter:
    scene = _scene(*overrides)
    keys = tuple(scene.value("optimise.vary"))
    space = design_space(BuiltScene(scene), keys, symmetric=True, deflection=10.0)
    return scatter_of(space, space.base.pair, np.arange(-1, teeth))


def test_a_variable_scatters_about_its_value_and_its_twin_by_itself():
    scatter = _scatter(f'robust.scatter."{_DEPTH}"=2.0', 'robust.even."pair.torque_pinion_Nm"=9.0')
    assert scatter.keys == (_DEPTH, "pair.torque_pinion_Nm")
    assert not scatter.same_mesh
    assert scatter.same_lines
    depth, band = scatter.quantities
    assert band.even
    assert_close(band.deviation, 9.0 / 3.0**0.5, rtol=1e-14, atol=0.0)
    assert not depth.even
    model = scatter.model(jnp.array([12.0, 0.25]), jnp.array([1.5, -3.0]), jnp.asarray(80.0))
    gears: tuple[Any, Any] = model.flanks.pinion, model.flanks.wheel
    depths = [flank.parts[0].depth / jg.um for flank in gears]
    assert_close(jnp.stack(depths), jnp.array([13.5, 12.0]), rtol=1e-14, atol=0.0)
    assert_close(model.torque, 77.0, rtol=1e-14, atol=0.0)


def test_a_class_scatters_both_gears_by_its_tolerances():
    """With three standard deviations in a tolerance; a wave's amplitude is half its height."""
    scatter = _scatter("robust.accuracy_grade=5", "mesh.periods=2")
    found = {each.name: each.deviation for each in scatter.quantities}
    pair = scatter.space.base.pair
    allowed = jg.flank_tolerances(pair, 0, 5.0)
    slope, form = (float(x) / jg.um for x in (allowed.profile_slope, allowed.profile_form))
    assert_close(found["pinion profile slope"], slope / 3.0, rtol=1e-12, atol=0.0)
    assert_close(found["pinion profile form"], form / 6.0, rtol=1e-12, atol=0.0)
    # Teeth -1 to 2: four on each gear; neighbours differ by a single pitch.
    assert len(found) == 2 * (3 + 4)
    along = np.cos(25.0 * jg.deg) / 3.0
    single = np.hypot(found["pinion pitch of tooth 44"], found["pinion pitch of tooth 0"])
    assert_close(single, along * float(allowed.single_pitch) / jg.um, rtol=1e-12, atol=0.0)
    drawn = jnp.arange(1.0, 15.0)
    model = scatter.model(jnp.array([12.0, 0.25]), drawn, jnp.asarray(80.0))
    assert model.flanks.wheel_indexing is not None
    error = model.flanks.wheel_indexing.pitch_error / jg.um
    place = [each.tooth for each in scatter.tolerated if each.gear == 1 and each.kind == "pitch"]
    assert place == [0, 1, 2, 85]
    assert_close(error[jnp.asarray(place)], drawn[-4:], rtol=1e-12, atol=0.0)
    assert_close(jnp.sum(error), jnp.sum(drawn[-4:]), rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ('robust.scatter."pair.torque_pinion_Nm"=40.0', "80 at the least.* use .robust.even"),
        ('robust.scatter."flank.pinion.tip_relief.extent"=0.02', "narrow .optimise.bounds"),
        ('robust.scatter."mesh.smoothing_um"=0.1', "on which no objective depends"),
    ],
)
def test_a_scatter_out_of_range_is_refused(setting, words):
    with pytest.raises(InputError, match=words):
        _scatter(setting)


def test_a_quantile_has_a_width_where_a_limited_response_is_nothing_in_all_gears():
    scene = _scene("optimise.limits.edge_line_load_N_mm=50.0", "robust.accuracy_grade=6")
    seen = np.array([[1.0, 0.0], [3.0, 0.0]])
    widths = robust._widths(limits_of(scene.optimise), seen)
    assert_close(widths, np.array([0.2, 0.05]), rtol=1e-12, atol=0.0)
    _, limited = robust._measures(scene.robust, widths)
    slopes = jax.grad(limited)(jnp.zeros(4))
    assert_close(slopes, jnp.full(4, 0.25), rtol=1e-9, atol=0.0)


@pytest.mark.slow
def test_the_quantile_of_real_gears_has_true_slopes():
    scatter = _scatter(
        f'robust.scatter."{_DEPTH}"=2.0',
        'robust.scatter."pair.torque_pinion_Nm"=4.0',
        f"robust.scatter.{_MISALIGNED}=5.0",
        "robust.accuracy_grade=5",
    )
    space = scatter.space
    grid = grid_of(space.scene, space.base)
    samples = optimise.sample(scatter.quantities, 32)
    members = robust.members_of(scatter, samples, grid, prepared_mesh(space, grid))
    # Only what depends on the torque is kept for each gear: the half-widths of contact and cells.
    kept = jax.tree.leaves(members.own)
    assert kept
    assert all(np.ptp(np.asarray(each), axis=0).max() > 0.0 for each in kept)
    law = smooth_law_of(space.scene.mesh)
    judge = robust.judge_of(scatter, grid, law)
    value = jax.jit(optimise.population_statistics(judge, [optimise.Quantile(0.9, 0.05)]))
    at = jnp.array([13.0, 0.24])
    found, slopes = value(at, members)
    for place, step in ((0, 1e-3), (1, 1e-5)):
        move = jnp.zeros(2).at[place].set(step)
        central = (value(at + move, members)[0] - value(at - move, members)[0]) / (2.0 * step)
        assert_close(slopes[:, place], central, rtol=1e-5, atol=0.0)
    # The population is that of the models themselves, prepared or not.
    own = robust.members_of(scatter, samples[:2], grid, None)
    whole = optimise.Population(own.deviations, None, None)
    one = jax.jit(lambda who: optimise.responses_of(judge, at, who))
    few = optimise.Population(
        members.deviations[:2], members.shared, jax.tree.map(lambda x: x[:2], members.own)
    )
    assert_close(one(few), one(whole), rtol=1e-9, atol=0.0)
    assert float(found[0]) > 0.0


def _optimised(capsys, settings):
    """Summary of a search on the example scene, in the current folder."""
    assert main(["init", "accessory"]) == 0
    capsys.readouterr()
    arguments = [word for each in settings for word in ("--set", each)]
    assert main(["optimise", "accessory.toml", *arguments, "--json", "--quiet"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_the_robust_optimum_is_better_on_fresh_gears(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    settings = [
        "mesh.phases=32",
        "mesh.slices=5",
        f'robust.scatter."{_DEPTH}"=1.5',
        f'robust.scatter."{_OTHER}"=1.5',
        'robust.scatter."pair.torque_pinion_Nm"=8.0',
        f"robust.scatter.{_MISALIGNED}=5.0",
        # Without a face that is loaded unevenly this one does nothing to a spur pair's RMS.
        'robust.scatter."wheel.shaft.bearings[0].axial_N_m"=1e6',
    ]
    summary = _optimised(capsys, settings)
    found = summary["optimise"]["robust"]
    assert found["better"]
    assert found["converged"]
    nominal, made = found["nominal"], found["robust"]
    assert made["quantile"] < 0.9 * nominal["quantile"]
    # What it costs: the gear without deviations is worse.
    assert made["without_deviations"] > nominal["without_deviations"]
    assert found["without_effect"] == ["wheel.shaft.bearings[0].axial_N_m"]
    assert any("without any effect" in note for note in summary["notes"])
    folder = tmp_path / "results" / "accessory" / "optimise"
    kept = tomllib.loads((folder / "accessory.robust.toml").read_text(encoding="utf-8"))
    depth = kept["flank"]["wheel"]["tip_relief"]["depth_um"]
    assert depth == pytest.approx(found["variables"][_OTHER], rel=1e-12)
    assert depth != summary["optimise"]["variables"][_OTHER]
    for name in ("robust", "tornado"):
        for ending in ("png", "svg", "csv"):
            assert (folder / f"{name}.{ending}").stat().st_size > 0
    assert not list((tmp_path / "results").rglob("*.jsonl"))
    assert {"robust.csv", "tornado.csv"} < set(assert_tables(folder))


@pytest.mark.slow
def test_limits_hold_for_the_share_of_gears(tmp_path, monkeypatch, capsys):
    """Not for the gear without deviations alone; a search that knows limits is taken."""
    monkeypatch.chdir(tmp_path)
    settings = [
        "mesh.phases=16",
        "mesh.slices=3",
        # Slices that feel each other keep no such limit.
        "mesh.face_coupling=none",
        "robust.samples=32",
        "robust.fresh_samples=64",
        "robust.share=0.9",
        'robust.even."pair.torque_pinion_Nm"=10.0',
        f'robust.scatter."{_DEPTH}"=2.0',
        "optimise.limits.te_peak_to_peak_um=1.8",
    ]
    summary = _optimised(capsys, settings)
    found = summary["optimise"]["robust"]
    assert found["method"] == "slsqp"
    nominal, made = found["nominal"], found["robust"]
    assert made["quantile"] < 0.95 * nominal["quantile"]
    kept = made["limits"]["te_peak_to_peak_um"]
    assert kept["measure"] <= kept["most"] == 1.8
    assert kept["share_above"] <= 0.1
