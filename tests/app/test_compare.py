"""Steady responses compared: levels of methods and bodies, errors against a reference, results."""

import dataclasses
import math
from types import SimpleNamespace

import dynamics.cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tiny_cases import tiny_scene

from fem_prep._artefact import rigid_motions
from jaxgear import study
from jaxgear._dynamics._adaptive import Adaptive
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import TimeStepping
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import Midpoint
from jaxgear._system._body_modes import BodyBasis
from jaxgear._system._mode_combinations import lowest_modes
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import example_scene, read_scene
from jaxgear.scene._with_bodies import with_bodies
from jaxgear.study._fidelity._engine import compared
from jaxgear.study._fidelity._level import Answers, Level, Reference, own_of
from jaxgear.study._fidelity._levels import (
    Hierarchy,
)
from jaxgear.study._fidelity._motion import other_speeds, over_speeds, some_speeds, thinned
from jaxgear.study._fidelity._moving import BodiesProblem, MethodsProblem
from jaxgear.study._fidelity._rigid import rigid_changes


def _answers(ratio, rms=None) -> Answers:
    ratio = jnp.asarray(ratio)
    rms = ratio if rms is None else jnp.asarray(rms)
    return Answers(jnp.stack([ratio, rms, 10.0 * rms]), jnp.ones(ratio.shape, dtype=bool))


def _reference(good) -> Reference:
    return Reference(
        np.asarray(_answers([2.0] * len(good)).values), np.asarray(good), np.asarray(1.0), 1.0
    )


def _errors(found: Answers, good, branch: float = 0.03):
    names = ("dynamic_ratio", "te_rms")
    return over_speeds(names, found, _reference(good), np.arange(len(good)), branch)


@pytest.mark.slow
def test_methods_of_all_families_agree_on_a_pair_that_only_turns():
    """All converge within the error of their steps."""
    scene = example_scene("accessory")
    scene = scene.changed(
        {
            **Hierarchy(scene).simpler_bodies()["torsional pair"],
            "mesh.slices": 1,
            "sweep.pinion_speed_rad_s": [1500.0, 1900.0, 2300.0],
            "sweep.steps": 64,
        },
    )
    midpoint = Midpoint()
    levels = [
        Level("H3", "harmonic balance", "method", method=HarmonicBalance(harmonics=3)),
        Level("H20", "harmonic balance", "method", method=HarmonicBalance(harmonics=20)),
        Level(
            "shot", "shooting", "method", method=Shooting(stepper=midpoint, warm_up=2), thinned=2
        ),
        Level(
            "marched",
            "march",
            "method",
            method=TimeStepping(stepper=midpoint, cycles=120),
            thinned=2,
        ),
    ]
    found = compared(MethodsProblem(scene, levels, speeds=3, steps=160), "methods")
    assert list(found.summary["reference"]["speeds_rad_s"]) == [1500.0, 1900.0, 2300.0]
    assert found.summary["reference"]["good"].all()
    rows = {row["name"]: row for row in found.summary["rungs"]}
    assert [*rows] == [level.name for level in levels]
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
    best = rows[found.summary["recommended"]]
    assert max(best["error_95"].values()) <= 0.02
    assert max(best["held_out"].values()) <= 0.02
    assert found.summary["recommended_for"]["te_rms"] in rows
    assert float(found.dataset["error_te_rms"][2]) == shot
    assert list(found.dataset["name"].values) == [*rows]


def test_another_branch_is_counted_and_is_no_error():
    """Of six speeds one has no reference, one is on another branch, one is not a number."""
    good = [True, True, True, True, True, False]
    errors = _errors(_answers([2.002, 2.004, 2.006, 3.0, np.nan, 9.0]), good)
    assert errors["same_branch_share"] == 3 / 5
    assert errors["error"]["dynamic_ratio"] == pytest.approx(2e-3)
    assert errors["error_95"]["te_rms"] == pytest.approx(2.9e-3)
    # One number alone that is too far off is another branch too.
    apart = _answers([2.002, 2.004, 2.006, 2.0, 2.0, 2.0], [2.0, 2.0, 2.0, 2.0, 4.0, 2.0])
    assert _errors(apart, good)["same_branch_share"] == 4 / 5


def test_what_is_wrong_everywhere_is_an_error():
    """Where fewer than half of the speeds are on the branch, the model is wrong: all count."""
    good = [True] * 4
    errors = _errors(_answers([2.002, 2.4, 2.4, 2.4]), good)
    assert errors["same_branch_share"] == 0.25
    assert errors["error"]["dynamic_ratio"] == pytest.approx(0.2)
    assert _errors(_answers([np.nan] * 4), good)["error"]["dynamic_ratio"] is None
    # Of models all speeds count anyway.
    model = _errors(_answers([2.002, 2.002, 2.002, 2.4]), good, np.inf)
    assert model["same_branch_share"] == 1.0
    assert model["error_95"]["dynamic_ratio"] > 0.1


def test_levels_are_possible_and_have_names_of_their_own():
    """No two share a name, and harmonics fit the steps; mesh damping drops the averages."""
    scene = example_scene("accessory", ["sweep.pinion_speed_rad_s=[900.0]"])
    levels = Hierarchy(scene).methods()
    assert len({level.name for level in levels}) == len(levels)
    for level in levels:
        here = scene.changed(level.changes)
        method = level.method or HarmonicBalance(harmonics=here.value("sweep.harmonics"))
        if isinstance(method, HarmonicBalance):
            assert 2 * method.harmonics < here.value("sweep.steps")
    own = own_of(levels)
    assert (own.name, own.changes) == ("H20 N128", {})
    active = {x.name for x in Hierarchy(scene.replace({"damping.active_mesh": True})).methods()}
    dropped = [level for level in levels if level.name not in active]
    assert [level.name for level in dropped] == ["H10 N64 mean", "H20 N128 mean", "H40 N256 mean"]


def test_speeds_are_some_of_the_sweep_and_others_between_them():
    """From the first to the last of the scene's own, none twice."""
    speeds = np.asarray([100.0, 200.0, 300.0, 900.0])
    assert list(some_speeds(speeds, 30)) == list(speeds)
    assert list(some_speeds(speeds, 2)) == [100.0, 900.0]
    others = np.asarray(other_speeds(jnp.asarray(speeds)))
    assert others.size == 4
    assert not set(others) & set(speeds)
    assert np.all((others > 100.0) & (others < 900.0))
    assert np.asarray(other_speeds(jnp.asarray(speeds[:1]))).size == 1
    for count in (1, 2, 3, 5, 9, 30):
        for every in (1, 4, 10):
            places = thinned(count, every)
            assert places.size >= 1
            assert np.all((places >= 0) & (places < count))
    assert list(thinned(30, 10)) == [5, 15, 25]


def test_long_cycles_are_refused():
    """A hunting cycle asks for systems that most methods would take hours for."""
    scene = example_scene("accessory", ["sweep.pinion_speed_rad_s=[900.0]", "mesh.periods=45"])
    with pytest.raises(ValueError, match=r"up to 4 mesh periods, got mesh\.periods = 45"):
        study.compare(scene)


@pytest.mark.slow
def test_adaptive_integration_converges_on_the_response_of_harmonic_balance():
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
    changes = rigid_changes(built.bodies, model_of(built, {"wheel.body.kind": "rigid"}))
    assert [*changes] == ["rigid", "rigid, no foundation"]
    tube = 7850.0 * math.pi * (0.01**2 - 0.004**2) * 0.04
    polar = 0.5 * tube * (0.01**2 + 0.004**2)
    # The gear's middle is 5 mm off that of the shaft.
    across = 0.5 * polar + tube * (0.04**2 / 12.0 + 0.005**2)
    scene = built.replace(changes["rigid"])
    got = [
        scene.value(f"wheel.body.{key}")
        for key in ("mass_kg", "inertia_kg_m2", "transverse_inertia_kg_m2")
    ]
    whole = 4.0 * _MASS, 4.0 * _MASS * 0.03**2, _MASS * (2.0 * 0.03**2 + 4.0 * 0.004**2)
    assert got == pytest.approx([whole[0] - tube, whole[1] - polar, whole[2] - across], rel=1e-9)
    assert not scene.condensed
    assert built.replace(changes["rigid, no foundation"]).wheel.foundation == "none"


def test_models_of_a_scene_differ_in_one_thing(built):
    levels = Hierarchy(built).bodies(130)
    own = own_of(levels)
    assert own.name == "200 excited shapes"
    names = [level.name for level in levels]
    assert len(set(names)) == len(names)
    # There are not 200, and three slices are fewer than any that would be tried.
    natural = ["10 modes", "50 modes", "100 modes", "130 modes"]
    assert names[:6] == [*natural, "100 excited shapes", "200 excited shapes"]
    assert {"6 coordinates", "rigid"} <= set(names)
    assert not any("slices" in name for name in names)
    balance = {"sweep.steps", "sweep.harmonics"}
    for level in levels:
        assert not (level.changes.keys() & balance and level.changes.keys() - balance), level.name
        here = built.changed({k: v for k, v in level.changes.items() if k in balance})
        assert 2 * here.sweep.harmonics < here.sweep.steps
    few = Hierarchy(built).few()
    assert [level.name for level in few] == [
        "200 excited shapes",
        "50 modes",
        "100 modes",
        "100 excited shapes",
        "rigid",
        "H10 N64",
    ]


def test_fewer_modes_are_the_lowest_and_part_no_pair():
    """Of five modes the last but one is the first of a pair."""
    shapes = np.ones((9, 5)) * np.arange(5.0)
    waves, diameters = np.array([0, 2, -2, 3, -3]), np.array([0, 2, 2, 3, 3])
    basis = BodyBasis(np.arange(1.0, 6.0), shapes, np.zeros((9, 6)), waves, diameters)
    assert lowest_modes(basis, 5) is basis
    assert lowest_modes(basis, 0) is basis
    for count, kept in ((4, 3), (3, 3), (2, 1), (1, 1)):
        lowest = lowest_modes(basis, count)
        assert np.array_equal(lowest.shapes, shapes[:, :kept])
        assert np.array_equal(lowest.square, basis.square[:kept])
        assert np.array_equal(lowest.waves, waves[:kept])
        assert np.array_equal(lowest.diameters, diameters[:kept])


@pytest.mark.slow
def test_models_of_a_scene_with_a_condensed_body_are_compared(tmp_path, monkeypatch):
    """The richer the body, the smaller the error."""
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "cache"))
    changes = "model.coordinates=16", "model.shapes=natural", "sweep.steps=32"
    scene = with_bodies(_tiny(tmp_path, *changes), moving=True)
    some = ("16 modes", "100 modes", "100 excited shapes", "rigid", "H5 N64")
    levels = [level for level in Hierarchy(scene).bodies(210) if level.name in some]
    found = compared(BodiesProblem(scene, levels, modes=210), "bodies").summary
    assert list(found["reference"]["speeds_rad_s"]) == [300.0, 900.0, 1500.0]
    assert found["reference"]["name"].startswith("harmonic balance, H5 N64, 2")
    rows = {row["name"]: row for row in found["rungs"]}
    assert [*rows][: len(levels)] == [level.name for level in levels]
    assert rows["16 modes"]["modes"] == 16
    assert rows["16 modes"]["dofs"] == rows["rigid"]["dofs"] + 16
    assert rows["rigid"]["modes"] == rows["rigid"]["mesh_coordinates"] == 0
    error = {name: row["error"]["te_rms"] for name, row in rows.items()}
    assert error["100 modes"] < error["16 modes"] < error["rigid"]
    assert rows["100 excited shapes"]["modes"] in (99, 100)
    assert error["100 excited shapes"] < error["16 modes"]
    assert rows["100 modes"]["error"]["te_mean"] < 0.01
    assert rows["rigid"]["error"]["te_mean"] > 0.1
    assert (f'"{found["recommended"]}" suffices' in found["words"]) == bool(found["recommended"])
