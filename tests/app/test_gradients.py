"""The table of derivatives: true ones pass, false ones are found."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from table_checks import assert_table

from jaxgear._cli._printing import print_gradients
from jaxgear._interface._laws import ExactContact
from jaxgear.scene._build import model_of, smooth_law_of
from jaxgear.scene._scene import example_scene
from jaxgear.study import _gradients, check_gradients
from jaxgear.study._built import BuiltScene
from jaxgear.study._derivatives import AT_REST, IN_MOTION, Keys, central_differences, judged
from jaxgear.study._gradients import static_gradients
from jaxgear.study._steady import SteadyPoint

_COARSE = ("mesh.phases=16", "mesh.slices=4")
# Teeth of a given stiffness, which compile in a fraction of the time.
_PLAIN = (
    "mesh.stiffness=constant",
    "mesh.stiffness_N_mm_um=14.0",
    "mesh.phases=8",
    "mesh.slices=2",
)


@pytest.fixture(scope="module")
def table():
    """Shafts and bearings, corrections, a grade, tip contact, and two teeth out of place."""
    errors = [0.0] * 35
    errors[1:3] = [2.0, -3.0]
    scene = example_scene(
        "power",
        (
            *_COARSE,
            # Rings that couple the teeth over two mesh periods are another, much larger program.
            "mesh.foundation=weber",
            "mesh.periods=2",
            "mesh.tip_contact=true",
            "mesh.line_load_updates=1",
            "flank.pinion.tip_relief.depth_um=8.0",
            "flank.wheel.crowning_um=5.0",
            "flank.wheel.bias_um=3.0",
            "flank.wheel.accuracy_grade=5",
            f"flank.pinion.pitch_error_um={errors}",
            "flank.pinion.eccentricity_um=4.0",
            "pair.misalignment_deviation_um=5.0",
        ),
    )
    return scene, static_gradients(BuiltScene(scene), "exact", ExactContact())


def test_derivatives_by_many_keys_are_put_side_by_side():
    """As a sum of a vector for each key XLA worked out all of them for each key: half an hour."""
    scene = example_scene("accessory", _PLAIN)
    keys = Keys(scene, scene.real_keys())
    centre = jnp.asarray(keys.centre)

    def total(values):
        leaves = jax.tree.leaves(model_of(keys.moved(values)))
        return sum(jnp.sum(x) for x in leaves if eqx.is_inexact_array(x))

    reverse = jax.make_jaxpr(jax.grad(total))(centre)
    sums = [each for each in reverse.eqns if each.primitive.name in ("pad", "add_any")]
    made: list[Any] = [each.outvars[0].aval for each in sums]
    assert not [each for each in made if each.shape == centre.shape]


@pytest.mark.slow
def test_every_derivative_of_a_helical_pair_on_shafts_is_right(table):
    scene, found = table
    rows = found.to_dataframe()
    assert set(rows["key"]) == set(scene.real_keys())
    assert set(rows["response"]) == {*_gradients._NAMES, *_gradients._OF_BEARINGS}
    assert not (rows["verdict"] == "WRONG").any()
    good = rows[rows["verdict"] == "ok"]
    assert good["error"].max() <= 1e-6
    proven = set(good["key"])
    for key in (
        "pinion.shaft.bearings[0].at_mm",
        "wheel.shaft.segments[0].outer_mm",
        "flank.pinion.pitch_error_um[1]",
        "flank.pinion.eccentricity_um",
        "flank.wheel.accuracy_grade",
        "flank.wheel.bias_um",
    ):
        assert key in proven
    # The cycle of two periods does not see most teeth.
    without = set(rows["key"][rows["verdict"] == "no effect"])
    assert "flank.pinion.pitch_error_um[17]" in without
    # Equal face widths: the narrower gear changes within the difference.
    marked = set(rows["key"][rows["verdict"] == "set changes"])
    assert "pinion.face_width_mm" in marked


@pytest.mark.slow
def test_a_false_derivative_is_found(monkeypatch):
    """A response whose derivative lies by a thousandth."""

    @jax.custom_jvp
    def lying(x):
        return x

    @lying.defjvp
    def _jvp(primals, tangents):
        return primals[0], 1.001 * tangents[0]

    honest = _gradients.cycle_mean
    monkeypatch.setattr(_gradients, "cycle_mean", lambda *args: lying(honest(*args)))
    scene = example_scene("accessory", _PLAIN)
    found = static_gradients(BuiltScene(scene), "smooth", smooth_law_of(scene.mesh))
    wrong = found["response"][found["verdict"] == "WRONG"]
    assert set(wrong.values) == {"te_mean_um"}


def test_rounding_and_kinks_in_the_difference():
    """A smooth function to 1e-9; a kink is noticed on both sides."""

    def evaluate(values):
        x, y = values
        kink = jnp.maximum(y - 1.0, 0.0)
        pieces = jnp.stack([jnp.sign(y - 1.0)])
        return jnp.stack([jnp.sin(x) + kink]), (pieces, jnp.ones(1, dtype=bool))

    centre = np.asarray([0.7, 1.0])
    estimate, same = central_differences(evaluate, centre, np.ones(2), AT_REST)
    assert estimate[0, 0] == pytest.approx(np.cos(0.7), rel=1e-9)
    assert same[0, 0]
    assert not same[0, 1]


def test_estimates_that_agree_by_luck_do_not_count_in_motion():
    """A hundredth of a response depends on the key; its rounding, 6e-11, looks like a slope."""

    def evaluate(values):
        (x,) = values
        rounding = jnp.where(jnp.abs(x - 0.7) < 1.2e-4, 5e-7 * (x - 0.7), 0.0)
        return jnp.stack([1.0 + 0.01 * jnp.sin(5.0 * x) + rounding]), (
            jnp.zeros(1),
            jnp.ones(1, bool),
        )

    estimate, _ = central_differences(evaluate, np.asarray([0.7]), np.ones(1), IN_MOTION)
    assert estimate[0, 0] == pytest.approx(0.05 * np.cos(3.5), rel=1e-6)


def test_a_derivative_is_judged_by_its_difference():
    """Of four responses 2 x and of one that is always 0; a kink may excuse them."""

    def responses(values):
        (x,) = values
        slopes = jnp.array([2.0, 2.0, 2.0, 2.0, 0.0])
        return slopes * x, (jnp.zeros(1), jnp.ones(1, dtype=bool))

    forward = np.array([2.0, 2.0 + 2e-5, 2.0, np.nan, 0.0])[:, None]
    reverse = np.array([2.0, 2.0 + 2e-5, 2.0 + 2e-5, 2.0, 0.0])[:, None]
    names, contact = list("abcde"), ["exact"] * 5
    every = contact, names, ["x"], [1.0], responses, (np.ones(5), forward, reverse)
    verdict = judged(*every, AT_REST)["verdict"].values
    assert verdict.tolist() == ["ok", "WRONG", "WRONG", "WRONG", "no effect"]
    # In motion less is asked for, and said.
    verdict = judged(*every, IN_MOTION, shared=["x"])["verdict"].values
    close, wrong = IN_MOTION.words
    assert verdict.tolist() == [close, close, close, wrong, "shares a place"]
    kinked = lambda x: (responses(x)[0], (jnp.sign(x - 1.0), jnp.ones(1, dtype=bool)))
    verdict = judged(*every[:4], kinked, every[5], AT_REST)["verdict"].values
    assert verdict.tolist() == ["ok", "set changes", "set changes", "WRONG", "no effect"]


def _rows(*verdicts):
    columns: dict[str, Any] = {"contact": "exact", "response": "te_um", "key": "x"}
    columns |= dict.fromkeys(("forward", "reverse", "difference", "error"), 0.5)
    rows = {name: ("row", [each] * len(verdicts)) for name, each in columns.items()}
    return xr.Dataset(rows | {"verdict": ("row", list(verdicts))})


def test_the_study_counts_what_it_finds_of_both_kinds(monkeypatch, capsys, tmp_path):
    found = _rows("ok", "no effect", "WRONG"), _rows("ok to 1e-5", "WRONG at 1e-5")
    lost = [SteadyPoint("smooth", 900.0, 0.1, 0.5, "not converged")]
    monkeypatch.setattr(_gradients, "static_gradients", lambda *_: found[0])
    monkeypatch.setattr(_gradients, "steady_gradients", lambda *_: (found[1], lost))
    result = check_gradients(example_scene("accessory", ("sweep.pinion_speed_rad_s=[900.0]",)))
    told = result.summary["check_grad"]
    # Once for each contact law, and once in motion.
    assert told["verdicts"]["WRONG"] == 3
    assert told["verdicts"]["ok to 1e-5"] == 1
    assert told["dynamics"][0]["verdict"] == "not converged"
    said = "With smooth contact the response at 900 rad/s has not converged"
    assert any(said in note for note in result.notes)
    result.files["gradients.csv"](tmp_path / "gradients.csv")
    assert len(assert_table(tmp_path / "gradients.csv")) == len(told["rows"]) == 8
    print_gradients(told)
    # A header, a row for each derivative that is not zero, and the counts.
    assert len(capsys.readouterr().out.splitlines()) == 8 - 2 + 2
