"""Tables: columns of a dataset, and what is told from one by its header."""

import numpy as np
import pytest
import xarray as xr
from table_checks import assert_table, is_told

from jaxgear import plot
from jaxgear._columns import Table


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
    one, two = Table({"a": [1.0, 2.0], "b": ["x", "y"]}), Table({"a": [np.nan], "b": ["z"]})
    both = Table.joined([one, two])
    assert both["b"].tolist() == ["x", "y", "z"]
    assert both.known("a")["b"].tolist() == ["x", "y"]
    assert list(both | {"c": [1, 2, 3]}) == ["a", "b", "c"]


@pytest.mark.parametrize("other", [[1.0], [[1.0, 2.0]]])
def test_columns_of_a_table_are_of_one_length(other):
    with pytest.raises(ValueError, match="must have one length"):
        Table({"a": [1.0, 2.0], "b": other})


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
