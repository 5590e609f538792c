"""The sizing table: its numbers are those of a run, its order is the promised one."""

import numpy as np
import pytest

from jaxgear import plot
from jaxgear._checks import InputError
from jaxgear.scene._scene import example_scene
from jaxgear.study import sizing
from jaxgear.study._built import BuiltScene
from jaxgear.study._results import Entry
from jaxgear.study._sizing import RESPONSES, combinations_of, ranked
from jaxgear.study._statics import solve_statics

_COARSE = ("mesh.phases=8", "mesh.slices=4", "mesh.stiffness=iso6336")
_SCENE = (
    *_COARSE,
    "sizing.torques_Nm=[50.0, 90.0]",
    "sizing.amounts.flank.pinion.tip_relief.depth_um=[12.0, 0.0, 6.0, 12.0]",
    "sizing.amounts.flank.wheel.bias_um=[0.0, 8.0]",
)


@pytest.fixture(scope="module")
def solved():
    """The table of three depths, one of them given twice, and two biases."""
    result = sizing(example_scene("accessory", _SCENE))
    (picture,) = plot.pictures(result.datasets)
    assert picture.draw().axes
    names = list(picture.table)
    rows = [dict(zip(names, row, strict=True)) for row in zip(*picture.table.values(), strict=True)]
    return result.summary["sizing"], rows


@pytest.mark.slow
def test_numbers_are_those_of_a_run(solved):
    """One row against the cycle of a scene that has its amounts, on both gears."""
    depth, bias, torque = 6.0, 8.0, 90.0
    (row,) = [
        row
        for row in solved[1]
        if float(row["flank.pinion.tip_relief.depth_um"]) == depth
        and float(row["flank.wheel.bias_um"]) == bias
        and float(row["torque_pinion_Nm"]) == torque
    ]
    amounts = {
        f"flank.{gear}.{key}": value
        for gear in ("pinion", "wheel")
        for key, value in (("tip_relief.depth_um", depth), ("bias_um", bias))
    }
    scene = example_scene("accessory", _COARSE).replace(amounts | {"pair.torque_pinion_Nm": torque})
    numbers = solve_statics(BuiltScene(scene)).numbers
    for name in RESPONSES:
        assert float(row[name]) == pytest.approx(float(numbers[name]), rel=1e-8), name


@pytest.mark.slow
def test_every_combination_at_every_torque_in_order(solved):
    summary, rows = solved
    assert summary["combinations"] == 6
    assert summary["unsolved"] == 0
    assert len(rows) == 12
    assert [int(row["rank"]) for row in rows] == np.repeat(np.arange(1, 7), 2).tolist()
    worst = [float(row["worst_te_peak_to_peak_um"]) for row in rows]
    assert np.all(np.diff(worst) >= -1e-3)
    assert worst[0] == max(float(row["te_peak_to_peak_um"]) for row in rows[:2])
    assert sorted({int(row["rank_by_pressure"]) for row in rows}) == [1, 2, 3, 4, 5, 6]
    assert summary["best"] == summary["top"][0]
    assert summary["best"]["worst_te_peak_to_peak_um"] == pytest.approx(worst[0])
    assert len(summary["top"]) == 6


def test_pressure_decides_between_equals_and_unsolved_are_last():
    """Peak to peak 2, 1, 1 and unsolved at one torque; pressure 900, 1000, 800."""
    error = np.asarray([[1.0, 2.0], [1.0, 0.5], [0.3, 1.0 + 1e-5], [0.1, np.nan]])
    pressure = np.asarray([[900.0, 700.0], [1000.0, 900.0], [800.0, 800.0], [1.0, np.nan]])
    values = np.stack([error, error, error, pressure, error], axis=2)
    table = ranked(
        {"a": Entry(("combination",), np.arange(4.0), "1", "a")}, np.asarray([50.0, 90.0]), values
    )
    assert table["a"].values.tolist() == [2.0, 1.0, 0.0, 3.0]
    assert table["rank_by_pressure"].values.tolist() == [1, 3, 2, 4]
    assert table["worst_max_pressure_MPa"].values[:3].tolist() == [800.0, 1000.0, 900.0]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("sizing.symmetric=true",), r"names no amounts"),
        (
            [
                f"sizing.amounts.flank.pinion.{key}_um={list(range(50))}"
                for key in ("tip_relief.depth", "crowning", "bias")
            ],
            r"50 x 50 x 50 = 125000 combinations, more than 100000",
        ),
        (
            [f"sizing.amounts.flank.{gear}.bias_um=[0, 1]" for gear in ("pinion", "wheel")],
            r"set symmetric = false",
        ),
    ],
    ids=["nothing", "too many", "twins"],
)
def test_refusals(settings, words):
    with pytest.raises(InputError, match=words):
        combinations_of(example_scene("accessory", settings).sizing)
