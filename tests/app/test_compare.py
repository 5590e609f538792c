"""The chart of methods: rungs, errors against a reference of another family, files."""

import csv
import json

import dynamics.cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxgear as jg
from jaxgear._app._compare import (
    TOLERANCE,
    Adaptive,
    Answers,
    Rung,
    _errors,
    _recommended,
    _Reference,
    _some,
    compare,
    compared,
    rungs_of,
)
from jaxgear._app._scene import ready_scene
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import Marching
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import Midpoint


def _answers(ratio, rms=None) -> Answers:
    ratio = jnp.asarray(ratio)
    rms = ratio if rms is None else jnp.asarray(rms)
    return Answers(ratio, 1e-6 * rms, jnp.ones(ratio.shape, dtype=bool))


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
    summary = compared(scene, model, rungs, tmp_path, quiet=True, speeds=3, phases=160)
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
    assert found["recommended"] in {
        row["name"] for row in rows.values() if max(row["error"].values()) <= TOLERANCE
    }
    for name in ("compare", "compare_te_rms"):
        for ending in ("png", "svg", "csv"):
            assert (tmp_path / f"{name}.{ending}").stat().st_size > 0
    with (tmp_path / "compare.csv").open() as file:
        table = {row["name"]: row for row in csv.DictReader(file)}
    assert [*table] == [*rows]
    assert float(table["shot"]["error_te_rms"]) == pytest.approx(shot, rel=1e-9)


def test_another_branch_is_counted_and_is_no_error():
    """Of six speeds one has no reference, one is on another branch, one is not a number."""
    reference = _Reference(
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
    reference = _Reference(_answers([2.0] * 4), np.ones(4, dtype=bool), 1.0)
    errors = _errors(_answers([2.002, 2.4, 2.4, 2.4]), reference, np.arange(4))
    assert errors["same_branch_share"] == 0.25
    assert errors["error"]["dynamic_ratio"] == pytest.approx(0.2)
    none = _errors(_answers([np.nan] * 4), reference, np.arange(4))
    assert none["error"]["dynamic_ratio"] is None


def test_the_fastest_that_is_good_enough_is_recommended():
    """Error, branch, settled share and slices all count."""
    good = {
        "name": "good",
        "family": "",
        "slices": 20,
        "time_s": 1.0,
        "error": {"dynamic_ratio": 9e-4, "te_rms": 1e-5},
        "same_branch_share": 1.0,
        "settled_share": 1.0,
    }
    faster = good | {"name": "faster", "time_s": 0.1}
    spoilt = [
        {"error": {"dynamic_ratio": 1e-5, "te_rms": 2e-3}},
        {"error": {"dynamic_ratio": None, "te_rms": None}},
        {"same_branch_share": 0.5},
        {"settled_share": 0.37},
        {"slices": 5},
    ]
    rows = [good, good | {"name": "slow", "time_s": 2.0}]
    assert _recommended([*rows, *(faster | each for each in spoilt)], 20) == "good"
    assert _recommended([faster | each for each in spoilt], 20) is None


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
    assert list(_some(speeds, 30)) == [100.0, 200.0, 300.0, 900.0]
    assert list(_some(speeds, 2)) == [100.0, 900.0]


def test_long_cycles_are_refused(tmp_path):
    """A hunting cycle asks for systems that most methods would take hours for."""
    with pytest.raises(ValueError, match=r"up to 4 mesh periods, got mesh\.periods = 45"):
        compare(ready_scene("accessory").replace({"mesh.periods": 45}), tmp_path, quiet=True)


def test_adaptive_integration_settles_on_the_response_of_harmonic_balance():
    """An oscillator on a spring that comes and goes, by integrators of other authors."""
    system, speed = dynamics.cases.sdof_parametric(steps=32), jnp.asarray(0.6)
    method = Adaptive(rtol=1e-5, cycles=40)
    orbit = jax.jit(method.orbit)(system, speed)
    balance = jax.jit(HarmonicBalance(harmonics=15).orbit)(system, speed)
    assert bool(orbit.settled)
    assert not bool(jnp.any(orbit.load[:, 0] <= 0.0))
    assert np.asarray(orbit.place) == pytest.approx(np.asarray(balance.place), abs=4e-3)
