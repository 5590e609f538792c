"""The hierarchy of models: levels, errors, the choice with a margin, and fidelity by itself."""

import dataclasses
import json
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear.plot._compare_atlas import comparison_pictures
from jaxgear.plot._compare_pictures import error_over_time
from jaxgear.scene._rewriting import write_scene
from jaxgear.scene._scene import SceneError, example_scene, read_scene
from jaxgear.scene._schema import STATIC_RESPONSES
from jaxgear.study._fidelity import _auto as auto
from jaxgear.study._fidelity import _choice as choice
from jaxgear.study._fidelity import _engine as engine
from jaxgear.study._fidelity import _statics as statics
from jaxgear.study._fidelity._engine import AbstractProblem, Run, compared, counted
from jaxgear.study._fidelity._level import Answers, Level, Reference, errors_of
from jaxgear.study._fidelity._levels import Hierarchy
from jaxgear.study._fidelity._teeth import words_of_teeth
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
    """At a tolerance of 2 % a level must be within 1.5 % where it is chosen."""
    rows = [_row("own", 9.0, 1e-3), _row("just off", 1.0, 0.0151), _row("good", 2.0, 0.0149)]
    made = choice.choose(rows, 0.02, _TWO, _held_out)
    assert made.line is rows[2]
    assert made.failed == ()
    assert made.best is rows[0]
    assert choice.choose(rows, 0.03, _TWO, _held_out).line is rows[1]


def _combined(rows):
    """Of a scene and two axes."""
    axes = ("", "slices", "phases")
    levels = [Level(row["name"], "", axis) for row, axis in zip(rows, axes, strict=True)]
    lines = {row["name"]: row for row in rows}
    return choice.combined(levels, lines, levels[0], 0.015, _TWO)


def test_noise_of_times_does_not_choose():
    """Of levels within a quarter of the fastest's time the most exact one is as good as fastest."""
    for first, second in ((1.0, 1.2), (1.2, 1.0)):
        rows = [_row("own", 9.0, 1e-3), _row("a", first, 0.012), _row("b", second, 0.010)]
        assert choice.choose(rows, 0.02, _TWO, _held_out).line is rows[2]
    rows = [_row("own", 9.0, 1e-3), _row("a", 1.0, 0.012), _row("b", 1.3, 0.010)]
    assert choice.choose(rows, 0.02, _TWO, _held_out).line is rows[1]
    # Nor is what is a little faster than the scene worth another model.
    near = [_row("own", 1.2, 1e-3), _row("a", 1.0, 0.012), _row("b", 1.0, 0.012)]
    assert _combined(near) is None


def test_what_does_not_hold_elsewhere_is_passed_over():
    """The margin is for points not tried; those held out count in full."""
    rows = [_row("own", 9.0, 1e-3), _row("local", 1.0, 1e-3, 0.021), _row("wide", 2.0, 1e-3, 0.019)]
    made = choice.choose(rows, 0.02, _TWO, _held_out)
    assert made.line is rows[2]
    assert made.failed == ("local",)
    # So does a response by which nothing was chosen.
    rows[2]["held_out"]["face_load_factor"] = 0.5
    made = choice.choose(rows, 0.02, _TWO, _held_out, ("face_load_factor",))
    assert made.line is rows[0]
    assert made.failed == ("local", "wide")
    assert "Cheaper, but off" in choice.words_of(made, rows[0], 0.02, _TWO, "errors")


@pytest.mark.parametrize("error", [None, np.nan, np.inf, 0.5])
def test_nothing_within_the_tolerance_is_said_with_the_best_there_is(error):
    rows = [_row("own", 9.0, 0.3), _row("unsolved", 1.0, error)]
    made = choice.choose(rows, 0.02, _TWO, _held_out)
    assert made.line is None
    words = choice.words_of(made, rows[0], 0.02, _TWO, "errors")
    assert words.startswith("No level is within 2 %")
    assert 'The best there is, "own"' in words


def test_another_physical_model_is_never_recommended():
    rows = [_row("own", 9.0, 1e-3), _row("other", 1.0, 1e-4) | {"beyond": True}]
    assert choice.choose(rows, 0.02, _TWO, _held_out).line is rows[0]


def test_a_median_does_not_hide_a_resonance():
    """In motion the 95 % error counts, at nine of ten speeds on the branch."""
    row = _row("own", 1.0, 1e-3) | {"error_95": dict.fromkeys(_TWO, 0.3)}
    assert not choice.is_good(row, 0.02, _TWO)
    row["error_95"] = dict.fromkeys(_TWO, 0.01)
    assert choice.is_good(row, 0.02, _TWO)
    assert not choice.is_good(row | {"same_branch_share": 0.5}, 0.02, _TWO)
    assert not choice.is_good(row | {"settled_share": 0.5}, 0.02, _TWO)


def test_the_best_of_each_response_may_differ():
    rows = [_row("own", 9.0, 1e-3), _row("coarse", 1.0, 1e-3)]
    rows[1]["error"]["te_mean"] = 0.4
    for name, best in (("te_mean", "own"), ("te_rms", "coarse")):
        made = choice.choose(rows, 0.02, (name,), _held_out)
        assert made.line is not None
        assert made.line["name"] == best


def test_what_is_cheaper_along_each_axis_is_put_together():
    levels = [
        Level("as given", "as given"),
        Level("5 slices", "slices", "slices", {"mesh.slices": 5}),
        Level("16 phases", "phases", "phases", {"mesh.phases": 16}),
        Level("32 phases", "phases", "phases", {"mesh.phases": 32}),
    ]
    errors = 1e-3, 2e-3, 0.05, 4e-3
    lines = {
        level.name: _row(level.name, 4.0 - index, error)
        for index, (level, error) in enumerate(zip(levels, errors, strict=True))
    }
    together = lambda allowed: choice.combined(levels, lines, levels[0], allowed, _TWO)
    whole = together(0.015)
    assert whole is not None
    assert whole.name == "5 slices, 32 phases"
    assert whole.changes == {"mesh.slices": 5, "mesh.phases": 32}
    assert together(0.003) is None
    # Rigid bodies have no modes to be left out, and the method is the last.
    levels[1:3] = [
        Level("rigid", "bodies", "bodies", {"wheel.body.kind": "rigid"}),
        Level("10 modes", "modes", "modes", {"model.coordinates": 10}),
        Level("H5 N64", "harmonics and steps", "method", {"sweep.steps": 64}),
    ]
    lines |= {level.name: _row(level.name, 1.0, 1e-3) for level in levels[1:4]}
    lines["rigid"]["modes"] = 0
    whole = together(0.015)
    assert whole is not None
    assert whole.name == "rigid, 32 phases, H5 N64"
    lines["rigid"]["error"]["te_rms"] = 0.5
    whole = together(0.015)
    assert whole is not None
    assert whole.name == "10 modes, 32 phases, H5 N64"


def test_levels_follow_from_the_scene():
    scene = example_scene("accessory")
    names = [level.name for level in Hierarchy(scene).static()]
    assert names[0] == "as given"
    assert len(set(names)) == len(names)
    assert {"torsional pair", "1 slice", "5 slices", "40 slices", "16 phases"} <= set(names)
    few = {level.name for level in Hierarchy(scene).static(few=True)}
    assert few < set(names)
    assert "40 slices" not in few
    beams = example_scene("accessory", ['pinion.body.kind="beam"'])
    assert "rigid bodies" in {level.name for level in Hierarchy(beams).static()}
    flexible = example_scene("accessory-h1")
    assert {"rigid bodies", "rigid bodies, no foundation", "torsional pair"} <= {
        level.name for level in Hierarchy(flexible).static()
    }
    assert list(Hierarchy(scene).simpler_bodies()) == ["torsional pair"]


def _digest(scene, work):
    return auto.digest(scene.values, scene.given, scene.files, work)


def _names(levels) -> set[str]:
    return {level.name for level in levels}


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
def test_a_level_does_not_take_away_what_a_search_names(named):
    scene = example_scene("accessory", [named, "sweep.pinion_speed_rad_s=[100.0]"])
    assert "torsional pair" not in _names(Hierarchy(scene).static())
    moving = Hierarchy(scene).moving()
    assert "torsional pair" in _names(moving)
    assert "torsional pair" not in _names(Hierarchy(scene).able(moving))


def test_a_level_still_shows_what_a_search_looks_at():
    """Eight positions in the period of a harmonic; the last slices where their load is limited."""
    orders = ["optimise.minimise='te_harmonics'", "optimise.harmonics=[1, 4]"]
    few = _names(Hierarchy(example_scene("accessory", orders)).static(few=True))
    assert "32 phases" in few
    assert "16 phases" not in few
    edge = ["optimise.limits.edge_line_load_N_mm=100", "sweep.pinion_speed_rad_s=[100.0]"]
    scene = example_scene("accessory", edge)
    assert "5 slices" not in _names(Hierarchy(scene).static(few=True))
    assert "5 slices" in _names(Hierarchy(scene).static())
    assert not any("slice" in x for x in _names(Hierarchy(scene).able(Hierarchy(scene).moving())))


def test_a_probe_keeps_its_body():
    probe = "probes=[{gear='wheel'}]"
    scene = example_scene("accessory-h1", [probe, "sweep.pinion_speed_rad_s=[100.0]"])
    levels = [Level("own", ""), Level("rigid", "", "bodies", {"wheel.body.kind": "rigid"})]
    assert _names(Hierarchy(scene).able(levels)) == {"own"}


def test_a_torsional_pair_has_no_shafts(tmp_path):
    """Nor has the scene that is written of it."""
    scene = example_scene("accessory")
    changes = Hierarchy(scene).simpler_bodies()["torsional pair"]
    turned = scene.changed(changes)
    assert turned.value("pinion.shaft.gear_at_mm") is None
    assert not turned.wheel.shaft.bearings
    write_scene(turned, tmp_path / "turned.toml")
    again = read_scene(tmp_path / "turned.toml")
    assert not any(".shaft." in key for key in again.values)
    # The scene itself is left alone.
    assert scene.wheel.shaft.bearings


def test_both_gears_are_cut_back_whichever_is_varied():
    own = ["optimise.vary=['flank.wheel.tip_relief.depth_um']"]
    both = {f"flank.{gear}.tip_relief.depth_um" for gear in ("pinion", "wheel")}
    assert set(statics.visited(example_scene("accessory", own).optimise, "optimise")) == both
    alone = example_scene("accessory", [*own, "optimise.symmetric=false"])
    assert statics.visited(alone.optimise, "optimise") == ["flank.wheel.tip_relief.depth_um"]


def test_a_search_is_chosen_for_on_other_flanks_too():
    """The example scene varies tip relief, on both gears."""
    scene = example_scene("accessory")
    assert not any(point.flank for point in statics.points_of(scene, "run"))
    moved = [point for point in statics.points_of(scene, "optimise") if point.flank]
    assert {point.chosen for point in moved} == {True, False}
    for point in moved:
        assert point.flank["flank.wheel.tip_relief.extent"] == 0.3
        # About what 2400 N on 11.5 mm press a pair of teeth together.
        depth = point.flank["flank.pinion.tip_relief.depth_um"]
        assert 5.0 < depth / (1.0 if point.chosen else 0.5) < 30.0


# --- Measured


class _Numbers(AbstractProblem):
    """A level is a factor on the reference; at the second point the RMS is next to nothing."""

    names = ("te_mean", "te_rms")
    judged = ("largest errors", "largest error")

    def __init__(self, *factors):
        self.scene = example_scene("accessory")
        self.levels = [
            Level(f"x {factor:g}", "a" if factor < 1.1 else "b", "slices", {"factor": factor})
            for factor in factors
        ]

    def reference(self, level):
        values = jnp.asarray([[10.0, 10.0], [10.0, 0.0]])
        return Reference(np.asarray(values), np.ones(2, bool), np.full(2, 20.0), 1.0)

    def run(self, level):
        return Run(_scaled, (jnp.asarray(level.changes["factor"]),))

    def line(self, level, answers, at):
        errors = errors_of(self.names, answers, self.reference(level))
        return {"error": dict(zip(self.names, errors[:, 0].tolist(), strict=True))}

    def held_out(self, level):
        answers = _scaled(jnp.asarray(level.changes["factor"]))
        errors = errors_of(self.names, answers, self.reference(level))
        return dict(zip(self.names, errors[:, 1].tolist(), strict=True))

    def about(self):
        return {}


def _scaled(factor):
    """A bias of the RMS stays where there is nothing to be scaled."""
    values = jnp.asarray([[10.0, 10.0], [10.0, 0.0]]) * factor
    return Answers(values.at[1, 1].add(0.2 * (factor - 1.0)), jnp.ones(2))


@pytest.mark.slow
def test_levels_are_solved_measured_chosen_and_drawn(monkeypatch):
    """2 nm of next to no RMS are one per cent of a hundredth of the mesh's 20 um."""
    # How long a level takes is not asked here.
    monkeypatch.setattr(engine, "_ENOUGH", 1e-3)
    problem = _Numbers(1.0, 1.01, 1.5)
    found = compared(problem, "numbers")
    rows = {row["name"]: row for row in found.summary["rungs"]}
    assert [*rows] == ["x 1", "x 1.01", "x 1.5"]
    assert rows["x 1.01"]["error"] == pytest.approx({"te_mean": 0.01, "te_rms": 0.01})
    assert rows["x 1.5"]["error"]["te_mean"] == pytest.approx(0.5)
    elsewhere = problem.held_out(problem.levels[1])
    assert elsewhere == pytest.approx({"te_mean": 0.01, "te_rms": 0.01})
    assert "held_out" not in rows["x 1.5"]
    assert found.summary["recommended"] in ("x 1", "x 1.01")
    assert found.choice.line is rows[found.summary["recommended"]]
    dataset = found.dataset.assign_attrs(title="numbers")
    assert all(x.attrs["units"] and x.attrs["long_name"] for x in dataset.data_vars.values())
    assert np.isnan(dataset["held_out_te_rms"][2])
    drawn = list(comparison_pictures({"compare_statics": dataset}))
    names = ["compare_statics", "compare_statics_te_mean", "compare_statics_te_rms"]
    assert [each.name for each in drawn] == names
    for each in drawn:
        assert list(each.table["name"]) == [*rows]
    overview, chart = drawn[0].draw(), drawn[1].draw()
    texts = [text.get_text() for text in overview.axes[0].texts]
    assert texts == ["0 %", "0 %", "1 %", "1 %", "50 %", "50 %"]
    axes, legend = chart.axes[0], [x.get_text() for x in chart.legends[0].get_texts()]
    assert sorted(text.get_text() for text in axes.texts) == sorted(rows)
    # Of no error at all there is a place at the foot.
    assert "no difference (at the foot)" in legend
    assert f"recommended: {dataset['error_te_mean'].attrs['recommended']}" in legend
    assert axes.get_ylim()[0] > 1e-8


def test_what_was_not_solved_has_no_error():
    problem = statics.StaticProblem(example_scene("accessory"), levels=())
    count = len(problem.points)
    values = jnp.full((len(problem.measured), count), 10.0)
    vars(problem)["_reference"] = Reference(
        np.asarray(values), np.ones(count, bool), np.full(count, 20.0), 1.0
    )
    solved = jnp.asarray([point.torque != 0.5 for point in problem.points])
    line = problem.line(Level("x", "y"), Answers(1.02 * values, solved), slice(None))
    assert set(line["error"]) == set(STATIC_RESPONSES) - {"max_root_stress"}
    assert set(line["error"].values()) == {None}
    assert line["held_out"] == pytest.approx(dict.fromkeys(problem.measured, 0.02))


def test_responses_that_a_scene_has_not_are_named():
    """Of some that it has and some that it has not, the former count."""
    with pytest.raises(InputError, match=r"compare\.responses names dynamic_ratio: in motion only"):
        statics.StaticProblem(
            example_scene("accessory", ["compare.responses=['dynamic_ratio']"])
        ).require_responses()
    both = example_scene("accessory", ["compare.responses=['dynamic_ratio', 'te_rms']"])
    statics.StaticProblem(both).require_responses()
    assert counted(both.compare.responses, STATIC_RESPONSES) == ("te_rms",)
    teeth = "compare.responses=['mesh_stiffness_mean']"
    statics.StaticProblem(example_scene("accessory", [teeth])).require_responses()
    with pytest.raises(InputError, match="of teeth alone"):
        statics.StaticProblem(example_scene("accessory-h1", [teeth])).require_responses()


def test_a_table_that_is_taken_away_differs():
    scene = example_scene("accessory")
    found = scene.differing({"wheel.shaft": None, "mesh.phases": scene.mesh.phases})
    assert found == {"wheel.shaft": None}
    assert scene.wheel.shaft.is_given
    assert not scene.changed(found).wheel.shaft.is_given


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
        example_scene("accessory", [given])
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
    assert (
        auto.in_motion(
            example_scene("accessory", more).optimise,
            example_scene("accessory", more).sweep,
            command,
        )
        == moving
    )


def test_a_choice_is_kept_for_the_next_command(tmp_path, monkeypatch):
    """And made again when the scene or the work is another one."""
    asked = []

    def at_rest(scene, work):
        asked.append(work)
        return {"rung": "5 slices", "changes": {"mesh.slices": 5, "wheel.shaft": None}, "why": "?"}

    monkeypatch.setattr(auto, "_at_rest", at_rest)
    scene, kept = example_scene("accessory", ['model.fidelity="auto"']), tmp_path / "kept.json"
    first, about = auto.chosen(scene, "map", kept)
    assert first.value("mesh.slices") == 5
    assert first.value("model.fidelity") == "as given"
    assert not first.wheel.shaft.bearings
    assert not about["from_cache"]
    assert about["changes"] == {"mesh.slices": 5, "wheel.shaft": "left out"}
    again, about = auto.chosen(scene, "map", kept)
    assert about["from_cache"]
    assert again.values == first.values
    assert asked == ["map"]
    auto.chosen(scene.replace({"pair.torque_pinion_Nm": 81.0}), "map", kept)
    auto.chosen(scene, "optimise", kept)
    assert asked == ["map", "map", "optimise"]
    # What is spoilt is no use, and no harm.
    kept.write_text("{")
    assert not auto.chosen(scene, "map", kept)[1]["from_cache"]


def test_another_file_is_another_scene(tmp_path):
    """Of matrices condensed elsewhere each file counts."""
    names = {"superelement": "k.mtx", "superelement_mass": "m.mtx", "superelement_nodes": "n.csv"}
    for name in names.values():
        (tmp_path / name).write_text("1")
    scene = example_scene("accessory").replace(
        {f"wheel.body.{key}": name for key, name in names.items()}
    )
    scene = dataclasses.replace(scene, path=tmp_path / "scene.toml")
    seen = {_digest(scene, "run"), _digest(scene, "sweep")}
    for name in names.values():
        (tmp_path / name).write_text("2")
        seen.add(_digest(scene, "run"))
    assert len(seen) == 2 + len(names)


def test_a_search_that_is_refused_anyway_costs_no_wait(monkeypatch):
    monkeypatch.setattr(auto, "_at_rest", lambda *_: pytest.fail("compared"))
    given = ['model.fidelity="auto"', "optimise.minimise='te_harmonics'", "optimise.harmonics=[99]"]
    with pytest.raises(SceneError, match=r"less than half of mesh\.phases"):
        auto.chosen(example_scene("accessory", given), "optimise")


def test_a_scene_without_a_reference_is_taken_as_it_is(monkeypatch):
    def at_rest(scene, work):
        assert scene.value("mesh.periods") == 1
        raise SolverFailure("no luck")

    monkeypatch.setattr(auto, "_at_rest", at_rest)
    scene = example_scene("accessory", ['model.fidelity="auto"', "mesh.periods=45"])
    found, about = auto.chosen(scene, "run")
    assert about["rung"] == "as given"
    assert "no luck. So the scene was taken as it is given" in about["why"]
    assert found.value("mesh.periods") == 45


def test_a_level_in_motion_is_keys_of_the_scene():
    scene = example_scene("accessory", ["sweep.pinion_speed_rad_s=[100.0]"])
    levels = {level.name: level for level in Hierarchy(scene).moving()}
    assert next(iter(levels)) == "H20 N128"
    assert auto.changes_in_motion(scene.sweep, levels["H20 N128"]) == {}
    coarse = levels["H5 N64"]
    coarse = coarse._replace(changes={**coarse.changes, "mesh.slices": 5})
    assert auto.changes_in_motion(scene.sweep, coarse) == {
        "mesh.slices": 5,
        "sweep.steps": 64,
        "sweep.harmonics": 5,
    }
    # A method of the user's own stays.
    own = scene.replace({"sweep.method": "newmark"})
    assert "H5 N64" not in _names(Hierarchy(own).able(Hierarchy(own).moving()))
    assert auto.changes_in_motion(own.sweep, coarse) == {"mesh.slices": 5}


def test_the_results_say_which_level_was_taken():
    about = {"rung": "5 slices", "why": "Because."}
    summary = auto.told({"notes": ["one"]}, about)
    assert summary["fidelity"]["rung"] == "5 slices"
    assert summary["notes"][-1].endswith('took the level "5 slices". Because.')


# --- Real scenes

# Of slices on their own: where slices feel each other, what enters over a corner without relief
# bears the more the finer they are, and nothing suffices.
_APART = "mesh.face_coupling=none"


def _recommended(name: str, *changes: str) -> str:
    """The level of a scene, tried at torques that were neither chosen by nor held out."""
    scene = example_scene(name, changes)
    levels = Hierarchy(scene).static(few=True)
    found = compared(statics.StaticProblem(scene, levels=levels, quick=True), "statics")
    assert found.choice.line is not None, found.summary["words"]
    level = found.levels[found.choice.line["name"]]
    points = [statics.Point("", 0.85, {}, True), statics.Point("", 1.15, {}, False)]
    problem = statics.StaticProblem(scene, levels=(), points=points, quick=True)
    run = problem.run(level)
    line = problem.line(level, run.program(*run.arguments), run.at)
    for errors in (line["error"], line["held_out"]):
        assert choice.worst(errors, found.summary["responses"]) <= 0.02, (name, errors)
    return level.name


@pytest.mark.slow
def test_scenes_get_levels_of_their_own_that_hold_elsewhere():
    """A helical pair needs more phases than a spur pair, whose fluctuation is twenty times it."""
    assert _recommended("power", _APART) != _recommended("accessory", _APART)


@pytest.mark.slow
def test_the_rung_of_a_flexible_wheel_holds_elsewhere():
    assert _recommended("accessory-h1", _APART) != "as given"


@pytest.mark.slow
def test_a_command_runs_with_the_rung_that_was_chosen(tmp_path, capsys):
    argv = ["run", "accessory.toml", "--quiet", "--out", str(tmp_path / "out")]
    scene = example_scene("accessory", ['model.fidelity="auto"', _APART])
    write_scene(scene, tmp_path / "accessory.toml")
    text = (tmp_path / "accessory.toml").read_text().split("[optimise]")[0]
    (tmp_path / "accessory.toml").write_text(text)
    argv[1] = str(tmp_path / "accessory.toml")
    assert main(argv) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    chosen = summary["fidelity"]
    as_run = read_scene(tmp_path / "out" / "scene.toml")
    assert as_run.value("model.fidelity") == "as given"
    for key, value in chosen["changes"].items():
        assert value == "left out" or as_run.value(key) == value
    assert chosen["within_tolerance"]
    assert any("fidelity" in note for note in summary["notes"])
    assert main(argv) == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["fidelity"]["from_cache"]


def test_words_say_what_slices_apart_suffice_for():
    line = lambda mean, factor: {
        "error": {"te_mean": mean},
        "held_out": {"face_load_factor": factor},
    }
    rows = {"slices apart": line(0.01, 0.2), "slices coupled": line(0.005, 0.03)}
    said = (
        'Beside elements mesh.face_coupling = "none" suffices for {good}; not for {rest}.'
    ).format
    mean = "the mean transmission error (1, coupled 0.5 %)"
    factor = "the face load factor (20, coupled 3 %)"
    assert words_of_teeth(rows, 0.02) == said(good=mean, rest=factor)
    assert words_of_teeth(rows, 0.001) == said(good="nothing", rest=f"{mean}, {factor}")
    assert words_of_teeth(rows, 0.3).endswith(f"suffices for {mean}, {factor}.")


def test_lines_of_a_chart_lead_to_what_takes_longer_alone():
    """From 800 natural modes no line leads back to 100 excited shapes."""
    about = lambda name, unit: {"long_name": name, "units": unit}
    names, times = ["100", "800", "100 excited", "200 excited"], [1.0, 9.0, 0.5, 2.0]
    errors = ("level", [0.1, 1e-3, 0.05, 5e-3], {**about("error", "1"), "recommended": ""})
    levels = xr.Dataset(
        {"error_te_rms": errors, "time_s": ("level", times, about("time", "s"))},
        {"name": ("level", names), "family": ("level", ["modes"] * 4)},
        {"title": "levels", "tolerance": 0.02},
    )
    lines = error_over_time(levels, "te_rms").axes[0].lines
    drawn = [np.asarray(line.get_xdata()) for line in lines if line.get_linestyle() == "-"]
    assert [x.tolist() for x in drawn] == [[1.0, 9.0], [0.5, 2.0]]
