"""The chart of methods: rungs, errors against a reference of another family, files."""

import csv
import dataclasses
import json
import math
from types import SimpleNamespace
from typing import Any

import dynamics.cases
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tiny_cases import tiny_scene

import jaxgear as jg
from fem_prep._artefact import rigid_motions
from jaxgear._cli._folder import Folder
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import Marching
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import Midpoint
from jaxgear._system._body_modes import BodyModes
from jaxgear._system._flexible import FlexibleBody
from jaxgear.scene._scene import read_scene, ready_scene
from jaxgear.scene._with_bodies import with_bodies
from jaxgear.study import _compare_bodies as bodies
from jaxgear.study._compare import (
    MODELS,
    SLICES,
    Adaptive,
    compare,
    compared,
    put_together,
    rungs_of,
)
from jaxgear.study._ladder import Choice, words_of
from jaxgear.study._rungs import Answers, Reference, Rung, errors_of, some_speeds


def _answers(ratio, rms=None) -> Answers:
    ratio = jnp.asarray(ratio)
    rms = ratio if rms is None else jnp.asarray(rms)
    return Answers(ratio, 1e-6 * rms, 1e-5 * rms, jnp.ones(ratio.shape, dtype=bool))


def _errors(found: Answers, reference: Reference, chosen, branch: float | None = 0.03):
    return errors_of(found, reference, chosen, ("dynamic_ratio", "te_rms"), branch)


@pytest.mark.slow
def test_methods_of_all_families_agree_on_a_pair_that_only_turns(tmp_path):
    """From one scene to the files: all settle within the error of their steps."""
    scene = ready_scene("accessory")
    shafts = jg.model_of(scene)
    model = jg.PairModel(shafts.pair, shafts.torque, shafts.flanks, shafts.compliance)
    scene = scene.replace(
        {
            "mesh.slices": 1,
            "sweep.pinion_speed_rad_s": [1500.0, 1900.0, 2300.0],
        }
    )
    midpoint = Midpoint()
    rungs = [
        Rung("H3", "harmonic balance", HarmonicBalance(harmonics=3), 64, 1),
        Rung("H20", "harmonic balance", HarmonicBalance(harmonics=20), 64, 1),
        Rung("shot", "shooting", Shooting(stepper=midpoint, warm_up=2), 64, 1, thinned=2),
        Rung("marched", "march", Marching(stepper=midpoint, cycles=60), 64, 1, thinned=2),
    ]
    summary = compared(scene, model, rungs, tmp_path, speeds=3, phases=160)
    assert summary == json.loads((tmp_path / "summary.json").read_text())
    found = summary["compare"]
    assert found["reference"]["speeds_rad_s"] == [1500.0, 1900.0, 2300.0]
    assert found["reference"]["good"] == [True, True, True]
    rows = {row["name"]: row for row in found["rungs"]}
    assert [*rows] == [rung.name for rung in rungs]
    for row in rows.values():
        assert row["dofs"] == 1
        assert row["same_branch_share"] == row["settled_share"] == 1.0
        assert row["error"]["dynamic_ratio"] <= row["error_95"]["dynamic_ratio"] < 0.01
        assert row["error"]["te_rms"] < 0.02
        assert row["time_s"] > 0.0
    assert [row["speeds"] for row in rows.values()] == [3, 3, 1, 1]
    # A march ends where shooting with the same rule goes at once.
    shot = rows["shot"]["error"]["te_rms"]
    assert rows["marched"]["error"]["te_rms"] == pytest.approx(shot, rel=1e-3)
    assert found["tolerance"] == 0.02
    best = rows[found["recommended"]]
    assert max(best["error_95"].values()) <= 0.02
    assert max(best["held_out"].values()) <= 0.02
    assert found["recommended_for"]["te_rms"] in rows
    for name in ("compare", "compare_te_rms", "compare_overview"):
        for ending in ("png", "svg", "csv"):
            assert (tmp_path / f"{name}.{ending}").stat().st_size > 0
    with (tmp_path / "compare.csv").open() as file:
        table = {row["name"]: row for row in csv.DictReader(file)}
    assert [*table] == [*rows]
    assert float(table["shot"]["error_te_rms"]) == pytest.approx(shot, rel=1e-9)


def test_another_branch_is_counted_and_is_no_error():
    """Of six speeds one has no reference, one is on another branch, one is not a number."""
    reference = Reference(
        _answers([2.0] * 6), np.asarray([True, True, True, True, True, False]), 1.0
    )
    found = _answers([2.002, 2.004, 2.006, 3.0, np.nan, 9.0])
    errors = _errors(found, reference, np.arange(6))
    assert errors["same_branch_share"] == 3 / 5
    assert errors["error"]["dynamic_ratio"] == pytest.approx(2e-3)
    assert errors["error_95"]["te_rms"] == pytest.approx(2.9e-3)
    # One number alone that is too far off is another branch too.
    apart = _answers([2.002, 2.004, 2.006, 2.0, 2.0, 2.0], [2.0, 2.0, 2.0, 2.0, 4.0, 2.0])
    assert _errors(apart, reference, np.arange(6))["same_branch_share"] == 4 / 5


def test_what_is_wrong_everywhere_is_an_error():
    """Where fewer than half of the speeds are on the branch, the model is wrong: all count."""
    reference = Reference(_answers([2.0] * 4), np.ones(4, dtype=bool), 1.0)
    errors = _errors(_answers([2.002, 2.4, 2.4, 2.4]), reference, np.arange(4))
    assert errors["same_branch_share"] == 0.25
    assert errors["error"]["dynamic_ratio"] == pytest.approx(0.2)
    none = _errors(_answers([np.nan] * 4), reference, np.arange(4))
    assert none["error"]["dynamic_ratio"] is None
    # Of models all speeds count anyway.
    model = _errors(_answers([2.002, 2.002, 2.002, 2.4]), reference, np.arange(4), None)
    assert model["same_branch_share"] == 1.0
    assert model["error_95"]["dynamic_ratio"] > 0.1


def test_the_cheapest_method_slices_and_bodies_are_put_together():
    balance = HarmonicBalance()
    rungs = [
        Rung("H20 N128", "harmonic balance", balance, 128, 20),
        Rung("H5 N64", "harmonic balance", HarmonicBalance(harmonics=5), 64, 20),
        Rung("1 slice", SLICES, balance, 128, 1),
        Rung("5 slices", SLICES, balance, 128, 5),
        Rung("torsional pair", MODELS, balance, 128, 20, changes={"wheel.shaft": None}),
    ]
    rows = [_row(rung.name, rung.family, 1.0 / (1 + i), 1e-3) for i, rung in enumerate(rungs)]
    rows[2]["error"]["te_rms"] = rows[4]["error"]["te_rms"] = 0.5
    scene, by_name = ready_scene("accessory"), {rung.name: rung for rung in rungs}
    whole = put_together(scene, by_name, rows, 0.02, ("te_rms",))
    assert whole is not None
    assert whole.name == "5 slices, H5 N64"
    assert (whole.slices, whole.phases, whole.method) == (5, 64, rungs[1].method)
    assert whole.changes == {}
    rows[3]["error"]["te_rms"] = 0.5
    assert put_together(scene, by_name, rows, 0.02, ("te_rms",)) is None


def test_rungs_are_possible_and_have_names_of_their_own():
    """No two rungs share a name, and harmonics fit the steps; mesh damping drops the averages."""
    scene = ready_scene("accessory")
    rungs = rungs_of(scene)
    assert len({rung.name for rung in rungs}) == len(rungs)
    balances = [(r, r.method) for r in rungs if isinstance(r.method, HarmonicBalance)]
    assert all(2 * method.harmonics < rung.phases for rung, method in balances)
    averaged = {rung.name for rung, method in balances if method.averaged}
    assert averaged
    active = rungs_of(scene.replace({"damping.active_mesh": True}))
    assert {rung.name for rung in rungs} - {rung.name for rung in active} == averaged


def test_speeds_are_some_of_the_sweep():
    """From the first to the last of the scene's own, none twice."""
    speeds = np.asarray([100.0, 200.0, 300.0, 900.0])
    assert list(some_speeds(speeds, 30)) == [100.0, 200.0, 300.0, 900.0]
    assert list(some_speeds(speeds, 2)) == [100.0, 900.0]


def test_long_cycles_are_refused(tmp_path):
    """A hunting cycle asks for systems that most methods would take hours for."""
    scene = ready_scene("accessory", ["sweep.pinion_speed_rad_s=[900.0]", "mesh.periods=45"])
    with pytest.raises(ValueError, match=r"up to 4 mesh periods, got mesh\.periods = 45"):
        compare(scene, Folder(tmp_path))


def test_adaptive_integration_settles_on_the_response_of_harmonic_balance():
    """An oscillator on a spring that comes and goes, by integrators of other authors."""
    system, speed = dynamics.cases.sdof_parametric(steps=32), jnp.asarray(0.6)
    method = Adaptive(rtol=1e-5, cycles=40)
    orbit = jax.jit(method.orbit)(system, speed)
    balance = jax.jit(HarmonicBalance(harmonics=15).orbit)(system, speed)
    assert bool(orbit.settled)
    assert not bool(jnp.any(orbit.load[:, 0] <= 0.0))
    assert np.asarray(orbit.place) == pytest.approx(np.asarray(balance.place), abs=4e-3)


# --- Condensed bodies

_TINY = (
    tiny_scene(modes=2, gear_at=25.0)
    + """[mesh]
stiffness = "constant"
stiffness_N_mm_um = 14.0
slices = 3
root_correction = false
[sweep]
pinion_speed_rad_s = [300.0, 900.0, 1500.0]
steps = 16
harmonics = 5
"""
)


def _tiny(folder, *overrides):
    path = folder / "tiny.toml"
    path.write_text(_TINY)
    return read_scene(path, overrides)


# Four masses on the rim, of which one could turn the other.
_RIM = np.array([[30.0, 0.0, 4.0], [0.0, 30.0, -4.0], [-30.0, 0.0, 4.0], [0.0, -30.0, -4.0]]) * 1e-3
_MASS = 0.1


@pytest.fixture
def built(tmp_path):
    """The scene with a body of a few masses, of which the mesh has seen nothing."""
    body = SimpleNamespace(
        mass=_MASS * np.eye(12), rigid_motions=rigid_motions(_RIM), dofs=150, seats=()
    )
    wheel = SimpleNamespace(built=SimpleNamespace(body=body))
    return dataclasses.replace(_tiny(tmp_path), bodies={"wheel": wheel})


def test_a_rigid_body_has_the_mass_of_the_condensed_one(built):
    """Less that of the shaft, which both models have: a tube, by hand."""
    changes = bodies.rigid_changes(built)
    assert [*changes] == ["rigid", "rigid, no foundation"]
    tube = 7850.0 * math.pi * (0.01**2 - 0.004**2) * 0.04
    polar = 0.5 * tube * (0.01**2 + 0.004**2)
    # The gear's middle is 5 mm off that of the shaft.
    across = 0.5 * polar + tube * (0.04**2 / 12.0 + 0.005**2)
    scene = built.replace(changes["rigid"])
    got = [
        scene[f"wheel.body.{key}"]
        for key in ("mass_kg", "inertia_kg_m2", "transverse_inertia_kg_m2")
    ]
    whole = 4.0 * _MASS, 4.0 * _MASS * 0.03**2, _MASS * (2.0 * 0.03**2 + 4.0 * 0.004**2)
    assert got == pytest.approx([whole[0] - tube, whole[1] - polar, whole[2] - across], rel=1e-9)
    assert not scene.condensed
    assert built.replace(changes["rigid, no foundation"])["wheel.foundation"] == "none"


def test_models_of_a_scene_differ_in_one_thing(built):
    rungs = bodies.model_rungs(built, 130)
    own = rungs[0]
    assert own.name == "100 modes"
    assert own.method == HarmonicBalance(harmonics=5)
    assert (own.phases, own.slices, own.changes) == (16, 3, {})
    assert len({rung.name for rung in rungs}) == len(rungs)
    names = {rung.name for rung in rungs}
    assert {"10 modes", "50 modes", "130 modes", "6 coordinates", "rigid"} <= names
    # There are not so many, or the reference has fewer.
    assert "200 modes" not in names
    assert "100 modes" not in {rung.name for rung in bodies.model_rungs(built, 90)[1:]}
    # Three slices are fewer than any that would be tried.
    assert not any("slices" in name for name in names)
    for rung in rungs[1:]:
        settings = rung.phases == own.phases and rung.method == own.method
        assert settings == bool(rung.changes), rung.name
    balances = [(r, r.method) for r in rungs if isinstance(r.method, HarmonicBalance)]
    assert all(2 * method.harmonics < rung.phases for rung, method in balances)


def _row(name, family, time, error=0.01, modes=99) -> dict[str, Any]:
    errors = {"dynamic_ratio": error, "te_rms": error}
    found = {"name": name, "family": family, "time_s": time, "error": errors, "modes": modes}
    return found | {"same_branch_share": 1.0, "settled_share": 1.0}


def test_what_is_cheaper_and_good_enough_is_put_together():
    balance = HarmonicBalance()
    rungs = [
        Rung("100 modes", "modes", balance, 128, 20),
        Rung("10 modes", "modes", balance, 128, 20, changes={"model.coordinates": 10}),
        Rung("5 slices", "slices", balance, 128, 5),
        Rung("10 slices", "slices", balance, 128, 10),
        Rung("rigid", "bodies", balance, 128, 20, changes={"wheel.body.kind": "rigid"}),
        Rung("H5 N64", "harmonics and steps", HarmonicBalance(harmonics=5), 64, 20),
    ]
    rows = [_row(rung.name, rung.family, 1.0 / (1 + i)) for i, rung in enumerate(rungs)]
    rows[2]["error"]["te_rms"] = 0.03
    rows[4]["error"]["te_rms"] = 0.5
    rows[4]["modes"] = 0
    whole = bodies.combined(rungs, rows, 0.02)
    assert whole is not None
    assert whole.name == "10 modes, 10 slices, H5 N64"
    assert (whole.slices, whole.phases, whole.method) == (10, 64, rungs[5].method)
    assert whole.changes == {"model.coordinates": 10}
    # Rigid bodies have no modes to be left out.
    rows[4]["error"]["te_rms"] = 0.01
    whole = bodies.combined(rungs, rows, 0.02)
    assert whole is not None
    assert whole.name == "rigid, 10 slices, H5 N64"
    assert bodies.combined(rungs[:2], rows[:2], 0.02) is None
    as_slow = [row | {"time_s": 1.0} for row in rows[::3]]
    assert bodies.combined(rungs[::3], as_slow, 0.02) is None


def test_a_sentence_says_what_suffices():
    own, found = _row("100 modes", "modes", 4.0), _row("10 modes", "modes", 0.5)
    names = "dynamic_ratio", "te_rms"
    said = lambda row, own: words_of(Choice(row, (), own), own, 0.02, names, judged="95 % errors")
    assert said(found, own) == (
        '"10 modes" suffices for 2 %: 95 % errors of 1 % in the largest mesh force, 1 % in the RMS '
        "of transmission error, in 0.5 s, where the scene itself takes 4 s."
    )
    off = _row("100 modes", "modes", 4.0, error=0.1)
    assert said(found, off).endswith("4 s and is not within the tolerance.")
    assert said(own, own).endswith("in 4 s.")
    assert said(None, own).startswith("No rung is within 2 %")


def test_fewer_modes_are_the_lowest_and_part_no_pair():
    """Six numbers of one seat and five modes, of which the last but one is the first of a pair."""
    matrix = jnp.arange(121.0).reshape(11, 11)
    modes = BodyModes(
        square=jnp.arange(1.0, 6.0),
        rows=jnp.arange(30.0).reshape(1, 3, 2, 5),
        load=jnp.arange(5.0),
        mass=matrix,
        turning=-matrix,
        coriolis=None,
        softening=2.0 * matrix,
        waves=(0, 2, -2, 3, -3),
        diameters=(0, 2, 2, 3, 3),
    )
    body = FlexibleBody(
        flexibility=jnp.zeros((1, 3, 3, 2, 2)),
        from_seats=jnp.zeros((1, 3, 2, 6)),
        growth=jnp.zeros((1, 3, 2)),
        centres=jnp.zeros((1, 2, 3)),
        seat_stiffness=jnp.zeros((6, 6)),
        seat_load=jnp.zeros(6),
        seat_heights=jnp.zeros(1),
        seats=("torque",),
        gear_seat=0,
        components=(0, 1, 5),
        first_line=0,
        slices=2,
        repeats=1,
        modes=modes,
    )
    assert bodies.fewer_modes(body, 5) is body
    assert bodies.fewer_modes(body, 0) is body
    for count, kept in ((4, 3), (3, 3), (2, 1), (1, 1)):
        found = bodies.fewer_modes(body, count).modes
        assert found is not None
        assert found.waves == modes.waves[:kept]
        assert found.diameters == modes.diameters[:kept]
        assert found.rows.shape == (1, 3, 2, kept)
        assert eqx.tree_equal(found.softening, 2.0 * matrix[: 6 + kept, : 6 + kept])
        assert found.mass.shape == found.turning.shape == (6 + kept, 6 + kept)
        assert found.coriolis is None
        assert found.square.size == found.load.size == kept


@pytest.mark.slow
def test_models_of_a_scene_with_a_condensed_body_are_compared(tmp_path, monkeypatch):
    """From one scene to the files: the richer the body, the smaller the error."""
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "cache"))
    scene = with_bodies(_tiny(tmp_path, "model.coordinates=210"), moving=True)
    scene = scene.replace({"model.coordinates": 16, "sweep.steps": 32})
    some = ("16 modes", "100 modes", "rigid", "H5 N64")
    rungs = [rung for rung in bodies.model_rungs(scene, 210) if rung.name in some]
    summary = bodies.compare_bodies(scene, tmp_path, rungs=rungs, modes=210)
    assert summary == json.loads((tmp_path / "summary.json").read_text())
    found = summary["compare"]
    assert found["tolerance"] == 0.02
    assert found["reference"]["speeds_rad_s"] == [300.0, 900.0, 1500.0]
    assert found["reference"]["name"].startswith("harmonic balance, H5 N64, 2")
    assert "bodies" not in found["reference"]
    rows = {row["name"]: row for row in found["rungs"]}
    assert [*rows][:4] == [rung.name for rung in rungs]
    assert rows["16 modes"]["modes"] == 16
    assert rows["16 modes"]["dofs"] == rows["rigid"]["dofs"] + 16
    assert rows["rigid"]["modes"] == rows["rigid"]["mesh_coordinates"] == 0
    error = {name: row["error"]["te_rms"] for name, row in rows.items()}
    assert error["100 modes"] < error["16 modes"] < error["rigid"]
    assert rows["100 modes"]["error"]["te_mean"] < 0.01
    assert rows["rigid"]["error"]["te_mean"] > 0.1
    assert (f'"{found["recommended"]}" suffices' in found["words"]) == bool(found["recommended"])
    for name in ("compare", "compare_te_rms", "compare_te_mean", "compare_overview"):
        for ending in ("png", "svg", "csv"):
            assert (tmp_path / f"{name}.{ending}").stat().st_size > 0
