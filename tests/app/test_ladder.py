"""The ladder of models: rungs, errors, the choice with a margin, and fidelity by itself."""

import csv
import dataclasses
import json
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from table_checks import assert_tables

from jaxgear._checks import InputError
from jaxgear._cli._folder import Folder
from jaxgear._cli._main import main
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear.scene._rewriting import write_scene
from jaxgear.scene._scene import SceneError, read_scene, ready_scene
from jaxgear.scene._schema import STATIC_RESPONSES
from jaxgear.study import _compare_statics as statics
from jaxgear.study import _fidelity as fidelity
from jaxgear.study import _ladder as ladder
from jaxgear.study._compare import model_rungs_of
from jaxgear.study._rungs import Rung, other_speeds, thinned
from jaxgear.study._statics import SolverFailure

_TWO = ("te_mean", "te_rms")


def _row(name, time, error, elsewhere=None, family="slices") -> dict[str, Any]:
    elsewhere = error if elsewhere is None else elsewhere
    return {
        "name": name,
        "family": family,
        "time_s": time,
        "error": dict.fromkeys(_TWO, error),
        "held_out": {**dict.fromkeys(_TWO, elsewhere), "face_load_factor": elsewhere},
    }


def _held_out(row):
    return row["held_out"]


def test_the_cheapest_within_the_margin_is_chosen():
    """At a tolerance of 2 % a rung must be within 1.5 % where it is chosen."""
    rows = [_row("own", 9.0, 1e-3), _row("just off", 1.0, 0.0151), _row("good", 2.0, 0.0149)]
    choice = ladder.choose(rows, 0.02, _TWO, _held_out)
    assert choice.row is rows[2]
    assert choice.failed == ()
    assert choice.best is rows[0]
    assert ladder.choose(rows, 0.03, _TWO, _held_out).row is rows[1]


def test_noise_of_times_does_not_choose():
    """Of rungs within a quarter of the fastest's time the most exact one is as good as fastest."""
    for first, second in ((1.0, 1.2), (1.2, 1.0)):
        rows = [_row("own", 9.0, 1e-3), _row("a", first, 0.012), _row("b", second, 0.010)]
        assert ladder.choose(rows, 0.02, _TWO, _held_out).row is rows[2]
    rows = [_row("own", 9.0, 1e-3), _row("a", 1.0, 0.012), _row("b", 1.3, 0.010)]
    assert ladder.choose(rows, 0.02, _TWO, _held_out).row is rows[1]
    # Nor is what is a little faster than the scene worth another model.
    near = [_row("own", 1.2, 1e-3), _row("a", 1.0, 0.012)]
    assert ladder.cheapest_of_families(near, 0.015, _TWO) == []


def test_what_does_not_hold_elsewhere_is_passed_over():
    """The margin is for points not tried; those held out count in full."""
    rows = [_row("own", 9.0, 1e-3), _row("local", 1.0, 1e-3, 0.021), _row("wide", 2.0, 1e-3, 0.019)]
    choice = ladder.choose(rows, 0.02, _TWO, _held_out)
    assert choice.row is rows[2]
    assert choice.failed == ("local",)
    # So does a response by which nothing was chosen.
    rows[2]["held_out"]["face_load_factor"] = 0.5
    choice = ladder.choose(rows, 0.02, _TWO, _held_out, ("face_load_factor",))
    assert choice.row is rows[0]
    assert choice.failed == ("local", "wide")
    assert "Cheaper, but off" in ladder.words_of(choice, rows[0], 0.02, _TWO, judged="errors")


@pytest.mark.parametrize("error", [None, np.nan, np.inf, 0.5])
def test_nothing_within_the_tolerance_is_said_with_the_best_there_is(error):
    rows = [_row("own", 9.0, 0.3), _row("unsolved", 1.0, error)]
    choice = ladder.choose(rows, 0.02, _TWO, _held_out)
    assert choice.row is None
    words = ladder.words_of(choice, rows[0], 0.02, _TWO, judged="errors")
    assert words.startswith("No rung is within 2 %")
    assert 'The best there is, "own"' in words
    assert ladder.for_each(rows, 0.02, _TWO, _held_out) == dict.fromkeys(_TWO)


def test_another_physical_model_is_never_recommended():
    rows = [_row("own", 9.0, 1e-3), _row("other", 1.0, 1e-4) | {"beyond": True}]
    assert ladder.choose(rows, 0.02, _TWO, _held_out).row is rows[0]
    assert ladder.cheapest_of_families(rows, 0.02, _TWO) == []


def test_a_median_does_not_hide_a_resonance():
    """In motion the 95 % error counts, at nine of ten speeds on the branch."""
    row = _row("own", 1.0, 1e-3) | {"error_95": dict.fromkeys(_TWO, 0.3)}
    assert not ladder.is_good(row, 0.02)
    row["error_95"] = dict.fromkeys(_TWO, 0.01)
    assert ladder.is_good(row, 0.02)
    assert not ladder.is_good(row | {"same_branch_share": 0.5}, 0.02)
    assert not ladder.is_good(row | {"settled_share": 0.5}, 0.02)


def test_the_best_of_each_response_may_differ():
    rows = [_row("own", 9.0, 1e-3), _row("coarse", 1.0, 1e-3)]
    rows[1]["error"]["te_mean"] = 0.4
    assert ladder.for_each(rows, 0.02, _TWO, _held_out) == {"te_mean": "own", "te_rms": "coarse"}


def test_what_is_cheaper_in_each_family_is_put_together():
    rungs = [
        statics.StaticRung("as given", "as given", {}),
        statics.StaticRung("5 slices", "slices", {"mesh.slices": 5}),
        statics.StaticRung("16 phases", "phases", {"mesh.phases": 16}),
        statics.StaticRung("32 phases", "phases", {"mesh.phases": 32}),
    ]
    errors = 1e-3, 2e-3, 0.05, 4e-3
    rows = [
        _row(rung.name, 4.0 - index, error, family=rung.family)
        for index, (rung, error) in enumerate(zip(rungs, errors, strict=True))
    ]
    by_name = {rung.name: rung for rung in rungs}
    whole = statics.combined_statics(by_name, rows, 0.015, _TWO)
    assert whole is not None
    assert whole.name == "5 slices, 32 phases"
    assert whole.changes == {"mesh.slices": 5, "mesh.phases": 32}
    assert statics.combined_statics(by_name, rows, 0.003, _TWO) is None


def test_rungs_follow_from_the_scene():
    scene = ready_scene("accessory")
    names = [rung.name for rung in statics.static_rungs(scene)]
    assert names[0] == "as given"
    assert len(set(names)) == len(names)
    assert {"torsional pair", "1 slice", "5 slices", "40 slices", "16 phases"} <= set(names)
    few = {rung.name for rung in statics.static_rungs(scene, few=True)}
    assert few < set(names)
    assert "40 slices" not in few
    beams = ready_scene("accessory", ['pinion.body.kind="beam"'])
    assert "rigid bodies" in {rung.name for rung in statics.static_rungs(beams)}
    flexible = ready_scene("accessory-h1")
    assert {"rigid bodies", "rigid bodies, no foundation", "torsional pair"} <= {
        rung.name for rung in statics.static_rungs(flexible)
    }
    assert {rung.name for rung in model_rungs_of(scene)} == {"torsional pair"}


def _names(rungs) -> set[str]:
    return {rung.name for rung in rungs}


@pytest.mark.parametrize(
    "named",
    [
        "optimise.vary=['wheel.shaft.bearings[0].radial_N_m']",
        "robust.scatter.'wheel.shaft.bearings[0].radial_N_m'=1e6",
        "robust.even.'pinion.shaft.gear_at_mm'=0.1",
        "optimise.minimise='bearing_force'",
        "optimise.pareto.against='bearing_force'",
    ],
)
def test_a_rung_does_not_take_away_what_a_search_names(named):
    scene = ready_scene("accessory", [named, "sweep.pinion_speed_rad_s=[100.0]"])
    assert "torsional pair" not in _names(statics.static_rungs(scene))
    moving = fidelity.moving_rungs(scene)
    assert "torsional pair" in _names(moving)
    assert "torsional pair" not in _names(fidelity._asked_for(scene, moving))


def test_a_rung_still_shows_what_a_search_looks_at():
    """Eight positions in the period of a harmonic; the last slices where their load is limited."""
    orders = ["optimise.minimise='te_harmonics'", "optimise.harmonics=[1, 4]"]
    few = _names(statics.static_rungs(ready_scene("accessory", orders), few=True))
    assert "32 phases" in few
    assert "16 phases" not in few
    edge = ["optimise.limits.edge_line_load_N_mm=100", "sweep.pinion_speed_rad_s=[100.0]"]
    scene = ready_scene("accessory", edge)
    assert "5 slices" not in _names(statics.static_rungs(scene, few=True))
    assert "5 slices" in _names(statics.static_rungs(scene))
    assert not any(
        "slice" in x for x in _names(fidelity._asked_for(scene, fidelity.moving_rungs(scene)))
    )


def test_a_probe_keeps_its_body():
    probe = "probes=[{gear='wheel'}]"
    scene = ready_scene("accessory-h1", [probe, "sweep.pinion_speed_rad_s=[100.0]"])
    rungs = [
        Rung(name, "bodies", HarmonicBalance(), 128, scene["mesh.slices"], changes=changes)
        for name, changes in (("own", {}), ("rigid", {"wheel.body.kind": "rigid"}))
    ]
    assert _names(fidelity._asked_for(scene, rungs)) == {"own"}


def test_a_torsional_pair_has_no_shafts(tmp_path):
    """Nor has the scene that is written of it."""
    scene = ready_scene("accessory")
    changes = statics.simpler_bodies(scene)["torsional pair"]
    turned = statics.changed(scene, changes)
    assert turned.get("pinion.shaft.gear_at_mm") is None
    assert not turned.rows("wheel.shaft.bearings")
    write_scene(turned, tmp_path / "turned.toml")
    again = read_scene(tmp_path / "turned.toml")
    assert not any(".shaft." in key for key in again.values)
    # The scene itself is left alone.
    assert scene.rows("wheel.shaft.bearings")


def test_both_gears_are_cut_back_whichever_is_varied():
    own = ["optimise.vary=['flank.wheel.tip_relief.depth_um']"]
    both = {f"flank.{gear}.tip_relief.depth_um" for gear in ("pinion", "wheel")}
    assert set(statics._visited(ready_scene("accessory", own), "optimise")) == both
    alone = ready_scene("accessory", [*own, "optimise.symmetric=false"])
    assert statics._visited(alone, "optimise") == ["flank.wheel.tip_relief.depth_um"]


def test_a_search_is_chosen_for_on_other_flanks_too():
    """The ready scene varies tip relief, on both gears."""
    scene = ready_scene("accessory")
    assert not any(point.flank for point in statics.points_of(scene, "run"))
    moved = [point for point in statics.points_of(scene, "optimise") if point.flank]
    assert {point.chosen for point in moved} == {True, False}
    for point in moved:
        assert point.flank["flank.wheel.tip_relief.extent"] == 0.3
        # About what 2400 N on 11.5 mm press a pair of teeth together.
        depth = point.flank["flank.pinion.tip_relief.depth_um"]
        assert 5.0 < depth / (1.0 if point.chosen else 0.5) < 30.0


def _reference(**changes) -> dict[str, np.ndarray]:
    one = {key: np.full(2, 10.0) for key in statics._KEYS.values()}
    return one | {"give_um": np.full(2, 20.0), "solved": np.full(2, True)} | changes


def _line(values):
    points = [statics.Point("", 1.0, {}, True), statics.Point("", 0.7, {}, False)]
    found = SimpleNamespace(values=values, time_s=1.0, compile_s=1.0, dofs=3)
    return statics.static_row(statics.StaticRung("x", "y", {"a": None}), found, REFERENCE, points)


REFERENCE = _reference(te_rms_um=np.array([0.0, 10.0]))


def test_an_error_of_next_to_nothing_is_relative_to_the_mesh():
    """RMS vanishes at the optimum: 4 nm are then 2 % of a hundredth of the mesh's 20 um."""
    row = _line(_reference(te_rms_um=np.array([4e-3, 10.5]), te_mean_um=np.array([10.2, 10.0])))
    assert row["error"]["te_rms"] == pytest.approx(0.02)
    assert row["held_out"]["te_rms"] == pytest.approx(0.05)
    assert row["error"]["te_mean"] == pytest.approx(0.02)
    assert row["held_out"]["te_mean"] == 0.0
    assert set(row["error"]) == set(STATIC_RESPONSES)
    assert set(row["held_out"]) == {*STATIC_RESPONSES, *statics.EXTRAS}
    assert row["changes"] == {"a": "left out"}


def test_what_was_not_solved_has_no_error():
    row = _line(REFERENCE | {"solved": np.array([False, True])})
    assert set(row["error"].values()) == {None}
    assert row["held_out"]["te_rms"] == 0.0


def test_the_pictures_of_a_comparison_and_their_data(tmp_path):
    rungs = {name: statics.StaticRung(name, name, {}) for name in ("as given", "5 slices")}
    rows = [
        _line(_reference(te_rms_um=np.array([x, 10.0])))
        | {"name": name, "family": name, "time_s": time}
        for (name, x, time) in (("as given", 1e-5, 2.0), ("5 slices", 2e-4, 1.0))
    ]
    rows[1]["error"]["max_pressure"] = None
    summary = {
        "rungs": rows,
        "responses": ["te_rms"],
        "tolerance": 0.02,
        "recommended": "5 slices",
        "recommended_for": {"te_rms": "5 slices"},
    }
    chart = statics.StaticChart(rungs, ladder.Choice(rows[1], (), rows[0]), summary)
    statics.draw_statics(chart, "tiny", Folder(tmp_path))
    for name in ("compare", "compare_te_rms"):
        for ending in ("png", "svg", "csv"):
            assert (tmp_path / f"{name}.{ending}").stat().st_size > 0
    with (tmp_path / "compare.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [line["name"] for line in table] == ["as given", "5 slices"]
    assert float(table[1]["error_te_rms"]) == pytest.approx(1e-3)
    assert table[1]["error_max_pressure"] == ""
    assert assert_tables(tmp_path) == ["compare.csv", "compare_te_rms.csv"]


def test_other_speeds_are_none_of_those_given():
    speeds = jnp.asarray([100.0, 200.0, 400.0])
    others = np.asarray(other_speeds(speeds))
    assert others.size == 3
    assert not set(others) & set(np.asarray(speeds))
    assert np.all((others > 100.0) & (others < 400.0))
    assert np.asarray(other_speeds(speeds[:1])).size == 1


@pytest.mark.parametrize("count", [1, 2, 3, 5, 9, 30])
def test_of_few_speeds_one_at_least_is_computed(count):
    for every in (1, 4, 10):
        places = thinned(count, every)
        assert places.size >= 1
        assert np.all((places >= 0) & (places < count))
    assert list(thinned(30, 10)) == [5, 15, 25]


def test_responses_that_a_scene_has_not_are_named():
    """Of some that it has and some that it has not, the former count."""
    with pytest.raises(InputError, match=r"compare\.responses names dynamic_ratio: in motion only"):
        statics.require_at_rest(ready_scene("accessory", ["compare.responses=['dynamic_ratio']"]))
    both = ready_scene("accessory", ["compare.responses=['dynamic_ratio', 'te_rms']"])
    statics.require_at_rest(both)
    assert statics.static_responses(both) == ("te_rms",)
    teeth = "compare.responses=['mesh_stiffness_mean']"
    statics.require_at_rest(ready_scene("accessory", [teeth]))
    with pytest.raises(InputError, match="of teeth alone"):
        statics.require_at_rest(ready_scene("accessory-h1", [teeth]))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("compare.tolerance=0", "0.02 is 2 %"),
        ("compare.tolerance=2.0", "must be a number > 0 and < 1"),
        ('compare.responses=["te_rsm"]', 'did you mean "te_rms"'),
        ('model.fidelity="automatic"', 'one of "as given", "auto"'),
        ("compare.toleranse=0.1", "compare.tolerance"),
    ],
)
def test_mistakes_are_told(given, words):
    with pytest.raises(SceneError, match="nothing was computed") as caught:
        ready_scene("accessory", [given])
    assert words in str(caught.value)


# --- fidelity = "auto"


@pytest.mark.parametrize(
    ("command", "more", "moving"),
    [
        ("run", [], False),
        ("map", ["sweep.pinion_speed_rad_s=[100.0]"], False),
        ("optimise", ["sweep.pinion_speed_rad_s=[100.0]"], False),
        (
            "optimise",
            ["sweep.pinion_speed_rad_s=[100.0]", 'optimise.minimise="dynamic_ratio"'],
            True,
        ),
        (
            "optimise",
            ["sweep.pinion_speed_rad_s=[100.0]", 'optimise.pareto.against="dynamic_ratio"'],
            True,
        ),
        ("run", ["sweep.pinion_speed_rad_s=[100.0]"], True),
        ("sweep", ["sweep.pinion_speed_rad_s=[100.0]"], True),
    ],
)
def test_the_work_decides_what_is_compared(command, more, moving):
    assert fidelity.in_motion(ready_scene("accessory", more), command) == moving


def test_a_choice_is_kept_for_the_next_command(tmp_path, monkeypatch):
    """And made again when the scene or the work is another one."""
    asked = []

    def at_rest(scene, work):
        asked.append(work)
        return {"rung": "5 slices", "changes": {"mesh.slices": 5, "wheel.shaft": None}, "why": "?"}

    monkeypatch.setattr(fidelity, "_at_rest", at_rest)
    scene = ready_scene("accessory", ['model.fidelity="auto"'])
    first, about = fidelity.chosen(scene, "map", Folder(tmp_path))
    assert first["mesh.slices"] == 5
    assert first["model.fidelity"] == "as given"
    assert not first.rows("wheel.shaft.bearings")
    assert not about["from_cache"]
    assert about["changes"] == {"mesh.slices": 5, "wheel.shaft": "left out"}
    again, about = fidelity.chosen(scene, "map", Folder(tmp_path))
    assert about["from_cache"]
    assert again.values == first.values
    assert asked == ["map"]
    fidelity.chosen(scene.replace({"pair.torque_pinion_Nm": 81.0}), "map", Folder(tmp_path))
    fidelity.chosen(scene, "optimise", Folder(tmp_path))
    assert asked == ["map", "map", "optimise"]
    # What is spoilt is no use, and no harm.
    (tmp_path / fidelity.FILE).write_text("{")
    assert not fidelity.chosen(scene, "map", Folder(tmp_path))[1]["from_cache"]


def test_another_file_is_another_scene(tmp_path):
    """Of matrices condensed elsewhere each file counts."""
    names = {"superelement": "k.mtx", "superelement_mass": "m.mtx", "superelement_nodes": "n.csv"}
    for name in names.values():
        (tmp_path / name).write_text("1")
    scene = ready_scene("accessory").replace(
        {f"wheel.body.{key}": name for key, name in names.items()}
    )
    scene = dataclasses.replace(scene, path=tmp_path / "scene.toml")
    seen = {fidelity.digest(scene, "run"), fidelity.digest(scene, "sweep")}
    for name in names.values():
        (tmp_path / name).write_text("2")
        seen.add(fidelity.digest(scene, "run"))
    assert len(seen) == 2 + len(names)


def test_a_search_that_is_refused_anyway_costs_no_wait(tmp_path, monkeypatch):
    monkeypatch.setattr(fidelity, "_at_rest", lambda *_: pytest.fail("compared"))
    given = ['model.fidelity="auto"', "optimise.minimise='te_harmonics'", "optimise.harmonics=[99]"]
    with pytest.raises(SceneError, match=r"less than half of mesh\.phases"):
        fidelity.chosen(ready_scene("accessory", given), "optimise", Folder(tmp_path))


def test_a_scene_without_a_reference_is_taken_as_it_is(tmp_path, monkeypatch):
    def at_rest(scene, work):
        assert scene["mesh.periods"] == 1
        raise SolverFailure("no luck")

    monkeypatch.setattr(fidelity, "_at_rest", at_rest)
    scene = ready_scene("accessory", ['model.fidelity="auto"', "mesh.periods=45"])
    found, about = fidelity.chosen(scene, "run", Folder(tmp_path))
    assert about["rung"] == "as given"
    assert "no luck. So the scene was taken as it is given" in about["why"]
    assert found["mesh.periods"] == 45


def test_a_rung_in_motion_is_keys_of_the_scene():
    scene = ready_scene("accessory", ["sweep.pinion_speed_rad_s=[100.0]"])
    rungs = {rung.name: rung for rung in fidelity.moving_rungs(scene)}
    assert next(iter(rungs)) == "H20 N128"
    assert fidelity.changes_in_motion(scene, rungs["H20 N128"]) == {}
    coarse = dataclasses.replace(rungs["H5 N64"], slices=5)
    assert fidelity.changes_in_motion(scene, coarse) == {
        "mesh.slices": 5,
        "sweep.steps": 64,
        "sweep.harmonics": 5,
    }
    # A method of the user's own stays.
    own = scene.replace({"sweep.method": "newmark"})
    assert "H5 N64" not in _names(fidelity._asked_for(own, fidelity.moving_rungs(own)))
    assert fidelity.changes_in_motion(own, coarse) == {"mesh.slices": 5}


def test_the_results_say_which_rung_was_taken(tmp_path):
    about = {"rung": "5 slices", "why": "Because."}
    summary = fidelity.told({"notes": ["one"]}, about, Folder(tmp_path))
    assert summary == json.loads((tmp_path / "summary.json").read_text())
    assert summary["fidelity"]["rung"] == "5 slices"
    assert summary["notes"][-1].endswith('took the rung "5 slices". Because.')


# --- Real scenes


def _compared(name, *more):
    scene = ready_scene(name, more)
    rungs = statics.static_rungs(scene, few=True)
    return scene, statics.compared_statics(scene, rungs=rungs, quick=True)


def _recommended(name: str) -> str:
    """The rung of a scene, tried at torques that were neither chosen by nor held out."""
    scene, chart = _compared(name)
    found = chart.summary["recommended"]
    assert chart.choice.row is not None, chart.summary["words"]
    points = [statics.Point("", 0.85, {}, True), statics.Point("", 1.15, {}, False)]
    solver = statics._Solver(scene, points, lambda step: None, quick=True)
    best, rung = solver(statics.finest_of(scene)), solver(chart.rungs[found].changes)
    row = statics.static_row(chart.rungs[found], rung, best.values, points)
    for errors in (row["error"], row["held_out"]):
        assert ladder.worst(errors, chart.summary["responses"]) <= 0.02, (name, errors)
    return found


@pytest.mark.slow
def test_scenes_get_rungs_of_their_own_that_hold_elsewhere():
    """A helical pair needs more phases than a spur pair, whose fluctuation is twenty times it."""
    assert _recommended("power") != _recommended("accessory")


@pytest.mark.slow
def test_the_rung_of_a_flexible_wheel_holds_elsewhere():
    assert _recommended("accessory-h1") != "as given"


@pytest.mark.slow
def test_a_command_runs_with_the_rung_that_was_chosen(tmp_path, capsys):
    argv = ["run", "accessory.toml", "--quiet", "--out", str(tmp_path / "out")]
    scene = ready_scene("accessory", ['model.fidelity="auto"'])
    write_scene(scene, tmp_path / "accessory.toml")
    text = (tmp_path / "accessory.toml").read_text().split("[optimise]")[0]
    (tmp_path / "accessory.toml").write_text(text)
    argv[1] = str(tmp_path / "accessory.toml")
    assert main(argv) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    chosen = summary["fidelity"]
    as_run = read_scene(tmp_path / "out" / "scene.toml")
    assert as_run["model.fidelity"] == "as given"
    for key, value in chosen["changes"].items():
        assert value == "left out" or as_run[key] == value
    assert chosen["within_tolerance"]
    assert any("fidelity" in note for note in summary["notes"])
    assert main(argv) == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["fidelity"]["from_cache"]
