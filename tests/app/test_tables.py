"""Tables: columns of a dataset, and what is told from one by its header."""

import numpy as np
import pytest
import xarray as xr
from fem_cases import ring
from table_checks import assert_table, is_told

from jaxgear import plot
from jaxgear._whole_file import write_csv
from jaxgear.plot._body_tables import (
    DrawnBody,
    DrawnModes,
    families_columns,
    grid_columns,
    mode_shapes_columns,
)
from jaxgear.plot._picture import joined
from jaxgear.study import _ladder
from jaxgear.study._sensitivities import Sensitivities

_DRAWN = DrawnModes(
    np.asarray([100.0, 100.01, 150.0]),
    np.asarray([2, 2, 0]),
    np.asarray([0, 0, 1]),
    np.ones(3),
    ("axial",) * 3,
)
_RUNGS = [
    {"name": "H5", "family": "a", "dofs": 1, "time_s": 0.1, "error": {"te_rms": None}},
    {"name": "H9", "family": "b", "dofs": 1, "time_s": 0.2, "held_out": {"te_rms": 0.1}},
]


def _sensitivities() -> Sensitivities:
    numbers = np.asarray([[1.0, np.nan], [2.0, 3.0]])
    names, keys, measures = ("te_mean_um", "te_rms_um"), ("pair.module_mm", "x"), ("%/%", "%/um")
    return Sensitivities(names, np.asarray([np.nan, 5.0]), np.ones(2), keys, measures, numbers)


# Tables that are no columns of one dataset.
_CASES = {
    "grid": lambda: grid_columns(DrawnBody(ring([1.0, 2.0], 12, [0.0, 1.0]), {})),
    "families": lambda: families_columns(_DRAWN),
    "mode_shapes": lambda: mode_shapes_columns(_DRAWN, np.zeros((2, 1, 3))),
    "compare": lambda: _ladder.columns_of(_RUNGS),
    "sensitivity": lambda: _sensitivities().columns(),
}


@pytest.mark.parametrize("name", _CASES)
def test_a_table_of_a_picture_is_one_table(name, tmp_path):
    write_csv(_CASES[name](), tmp_path / f"{name}.csv")
    assert len(assert_table(tmp_path / f"{name}.csv"))


def test_columns_are_spread_over_all_dimensions():
    """In the order in which dimensions come up; some under other names."""
    dataset = xr.Dataset(
        {"x_um": (("b", "a"), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), "y_N": ("b", [7.0, 8.0])},
        {"a": [10, 20, 30]},
    )
    table = plot.columns(dataset, "a", "x_um", force_N="y_N")
    assert {name: values.tolist() for name, values in table.items()} == {
        "a": [10, 10, 20, 20, 30, 30],
        "x_um": [1.0, 4.0, 2.0, 5.0, 3.0, 6.0],
        "force_N": [7.0, 8.0, 7.0, 8.0, 7.0, 8.0],
    }


def test_rows_of_several_tables_stay_together():
    one, two = {"a": np.asarray([1.0, 2.0])}, {"a": np.asarray([3.0])}
    assert joined([one, two])["a"].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("pinion_speed_rad_s", True),
        ("te_rms_per_depth", True),
        ("flank.pinion.tip_relief.extent", True),
        ("flank.pinion.tip_relief.depth_um", True),
        ("energy_mesh", True),
        ("depth", False),
        ("speed", False),
        ("um", False),
        ("te_amplitude_um_at_80_Nmm", False),
    ],
)
def test_a_header_is_told_by_its_end(name, told):
    assert is_told(name) is told


@pytest.mark.parametrize(
    "text",
    [
        "a_um,b_um\n1,2\n3,nan\n",
        "a_um,b_um\n1,2\n,\n",
        "a_um,b_um\n1,2\n3\n",
        "a_um,a_um\n1,2\n",
        "a_um,b\n1,2\n",
        "a_um,label\n1,2\n3,four\n",
    ],
)
def test_what_is_no_table_is_told_from_one(tmp_path, text):
    path = tmp_path / "x.csv"
    path.write_text(text)
    with pytest.raises(AssertionError):
        assert_table(path)
