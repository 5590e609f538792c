"""The table of derivatives: true ones pass, false ones are found."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from table_checks import assert_tables

from jaxgear._cli import _commands
from jaxgear._cli._main import main
from jaxgear._cli._printing import print_gradients
from jaxgear._interface._laws import ExactContact
from jaxgear.scene._build import smooth_law_of
from jaxgear.scene._scene import ready_scene
from jaxgear.study import _gradients
from jaxgear.study._gradients import gradient_table

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
    scene = ready_scene(
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
    return scene, gradient_table(scene, ExactContact())


@pytest.mark.slow
def test_every_derivative_of_a_helical_pair_on_shafts_is_right(table):
    scene, rows = table
    assert {row.key for row in rows} == set(scene.real_keys())
    assert {row.response for row in rows} == {*_gradients.RESPONSES, *_gradients.ON_BEARINGS}
    wrong = [row for row in rows if row.verdict == "WRONG"]
    assert not wrong
    good = [row for row in rows if row.verdict == "ok"]
    assert max(row.error for row in good) <= 1e-6
    proven = {row.key for row in good}
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
    without = {row.key for row in rows if row.verdict == "no effect"}
    assert "flank.pinion.pitch_error_um[17]" in without
    # Equal face widths: the narrower gear changes within the difference.
    marked = {row.key for row in rows if row.verdict == "set changes"}
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
    scene = ready_scene("accessory", _PLAIN)
    rows = gradient_table(scene, smooth_law_of(scene))
    wrong = {row.response for row in rows if row.verdict == "WRONG"}
    assert wrong == {"te_mean_um"}


def test_rounding_and_kinks_in_the_difference():
    """A smooth function to 1e-9; a kink is noticed on both sides."""

    def evaluate(values):
        x, y = values
        kink = jnp.maximum(y - 1.0, 0.0)
        pieces = jnp.stack([jnp.sign(y - 1.0)])
        return jnp.stack([jnp.sin(x) + kink]), (pieces, jnp.ones(1, dtype=bool))

    centre = np.asarray([0.7, 1.0])
    estimate, same = _gradients._differences(evaluate, centre, np.ones(2), jnp.zeros(1))
    assert estimate[0, 0] == pytest.approx(np.cos(0.7), rel=1e-9)
    assert same[0, 0]
    assert not same[1, 0]


@pytest.mark.parametrize(
    ("forward", "reverse", "same", "verdict"),
    [
        (2.0, 2.0, True, "ok"),
        (2.002, 2.002, True, "WRONG"),
        (2.0, 2.002, True, "WRONG"),
        (2.002, 2.002, False, "set changes"),
        (np.nan, 2.0, False, "WRONG"),
    ],
)
def test_a_derivative_is_judged_by_its_difference(forward, reverse, same, verdict):
    found = _gradients._row("te_mean_um", "key", forward, reverse, 2.0, scale=1.0, same=same)
    assert found.verdict == verdict


@pytest.mark.slow
def test_the_command_prints_a_table(table, tmp_path, monkeypatch, capsys):
    """With the derivatives of the pair above, for both contact laws."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_commands, "gradient_table", lambda scene, law, watch: table[1])
    assert main(["init", "accessory"]) == 0
    capsys.readouterr()
    assert main(["check-grad", "accessory.toml", "--json"]) == 0
    captured = capsys.readouterr()
    summary = json.loads(captured.out)
    assert summary["check_grad"]["verdicts"]["WRONG"] == 0
    assert summary["check_grad"]["verdicts"]["ok"] > 60
    assert "flank.pinion.tip_relief.depth_um" not in captured.err
    print_gradients(summary["check_grad"])
    table = capsys.readouterr().out.splitlines()
    # A header, a row for each derivative that is not zero, and the counts.
    zero = summary["check_grad"]["verdicts"]["no effect"]
    assert len(table) == len(summary["check_grad"]["rows"]) - zero + 2
    assert any("flank.pinion.tip_relief.depth_um" in line for line in table)
    assert assert_tables(tmp_path / "results") == ["accessory/check-grad/gradients.csv"]
