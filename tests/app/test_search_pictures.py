"""Pictures of searches and of the map of tip relief: what they draw of given datasets."""

import re

import numpy as np
import pytest
import xarray as xr

from jaxgear import plot
from jaxgear.plot import _relief_pictures as relief
from jaxgear.plot import _search_pictures as searches
from jaxgear.study._results import Entry, dataset_of

_UNIT = re.compile(r".+ \[[^\]]+\]$")
_WIDTH = np.asarray([0.01, 0.1, 1.0, 10.0])


def _data(variables: dict[str, tuple], **coordinates: tuple) -> xr.Dataset:
    entries = lambda told: {
        name: Entry(dims, values, units, name) for name, (dims, values, units) in told.items()
    }
    return dataset_of(entries(variables), **entries(coordinates)).assign_attrs(title="a pair")


def _relief(best: np.ndarray | None = None) -> dict[str, xr.Dataset]:
    """A map with a valley at depth 2/extent [um], and what goes with it."""
    extent, depth = np.linspace(0.05, 0.5, 19), np.linspace(0.0, 20.0, 21)
    value = 0.1 + np.abs(depth[:, None] - 2.0 / extent[None, :])
    # Short reliefs, for which every depth is bad: their best depth lies beyond the map.
    best = np.minimum(2.0 / extent, 20.0) if best is None else best
    along = {"extent": (("extent",), extent, "1")}
    curve = {
        "depth_um": (("extent",), best, "um"),
        "te_rms_um": (("extent",), 0.1 + np.abs(extent - 0.25), "um"),
        "closed_form_depth_um": (("extent",), np.where(extent > 0.1, 2.2 / extent, np.nan), "um"),
    }
    traced = _data(curve | {"te_rms_per_depth": (("extent",), extent, "um/um")}, **along)
    traced = traced.where(traced["extent"] > 0.2)
    torques = (("torque",), np.asarray([40.0, 80.0]), "N m")
    two = xr.concat([traced.where(traced["extent"] > 0.3), traced], "torque")
    biases = {
        "te_mean_bias_um": (("width",), np.asarray([0.0, 1e-5, 1e-3, 0.1]), "um"),
        "te_rms_bias_relative": (("width",), np.asarray([0.0, -1e-5, -1e-3, -0.1]), "1"),
        "te_rms_um": ((), 0.8, "um"),
    }
    path = {
        "depth_um": (("evaluation",), [3.0, 15.0, 8.0], "um"),
        "extent": (("evaluation",), [0.2, 0.3, 0.25], "1"),
    }
    rows = {"depth_um": (("depth",), depth, "um")}
    return {
        "relief_map": _data({"te_rms_um": (("depth", "extent"), value, "um")}, **rows, **along),
        "relief_valley": _data(curve, **along),
        "relief_search": _data(path),
        "relief_curve": traced,
        "relief_torques": two.assign_coords(torque_Nm=Entry(*torques, "torque").variable()),
        "smoothing_bias": _data(biases, width_um=(("width",), _WIDTH, "um")),
    }


def _cycle(height: float) -> xr.Dataset:
    phase = (np.arange(8) + 0.5) / 8
    error = height * np.sin(2.0 * np.pi * phase)
    pressure = 900.0 + height * np.arange(16.0).reshape(8, 2, 1)
    return _data(
        {
            "transmission_error_um": (("phase",), 10.0 + error, "um"),
            "pressure_MPa": (("phase", "line", "slice"), pressure, "MPa"),
            "te_mean_um": ((), 10.0, "um"),
            "te_rms_um": ((), height / np.sqrt(2.0), "um"),
        },
        phase=(("phase",), phase, "1"),
    )


def _search() -> dict[str, xr.Dataset]:
    """Groups of a search, its front of three designs, and its robust optimum."""
    values = np.asarray([4.0, 5.0, 0.1, 4.0, 3.0, 2.0, 1.0])
    trace = {
        "method": (("record",), ["lbfgs"] * 3 + ["evolution"] * 4, "1"),
        "evaluation": (("record",), [1, 2, 3, 1, 2, 3, 4], "1"),
        "objective_um2": (("record",), values, "um2"),
    }
    front = {
        "te_rms_um": (("design",), [0.2, 0.3, 0.4, 0.1], "um"),
        "max_pressure_MPa": (("design",), [1020.0, 1000.0, 1010.0, 990.0], "MPa"),
        "allowed": (("design",), [np.inf, 1010.0, 1015.0, 980.0], "1"),
        "kept": (("design",), [True, True, True, False], "1"),
        "settled": (("design",), [True] * 4, "1"),
        "dominated": (("design",), [False, False, True, True], "1"),
        "reason": (("design",), ["settled"] * 4, "1"),
    }
    designs = {"design": (("design",), ["nominal", "robust"], "1")}
    both = ("design", "quantity")
    names = [f"quantity {count}" for count in range(14)]
    size = np.linspace(0.3, 0.1, 14)
    bars = {
        "moved": (("quantity",), ["± 2 um"] * 14, "1"),
        "less_um": (both, np.stack([1.0 - size, 1.0 - 0.5 * size]), "um"),
        "without_deviations_um": (("design",), [1.0, 1.0], "um"),
        "more_um": (both, np.stack([1.0 + size, 1.0 + 0.5 * size]), "um"),
    }
    gears = {"response_um": (("design", "gear"), [[3.0, 1.0, 2.0], [1.5, 1.4, 1.6]], "um")}
    return {
        "search_before": _cycle(2.0),
        "search_after": _cycle(0.5),
        "search_robust": _cycle(0.7),
        "search_trace": _data(trace),
        "pareto": _data(front),
        "robust_gears": _data(gears, **designs).assign_attrs(share=0.9),
        "robust_influences": _data(bars, **designs, quantity=(("quantity",), names, "1")),
    }


@pytest.fixture(scope="module")
def pictures():
    return {each.name: each for each in plot.pictures(_search() | _relief())}


def test_all_are_drawn_with_quantity_and_unit_on_every_axis(pictures):
    assert set(pictures) == {
        *("before_after", "search", "pareto", "robust", "tornado"),
        *("master_curve", "master_curve_traced", "master_curve_torques", "smoothing_bias"),
    }
    for name, each in pictures.items():
        figure = each.draw()
        assert figure.get_suptitle().endswith("a pair"), name
        for axes in figure.axes:
            # Bars have their names for labels.
            labels = [axes.get_ylabel()] if name != "tornado" else []
            if axes.get_label() != "<colorbar>":
                labels.append(axes.get_xlabel())
            assert all(map(_UNIT.match, labels)), (name, labels)


def test_tables_have_a_row_for_each_record(pictures):
    count = {}
    for name, each in pictures.items():
        for key, table in {"": each.table, **each.beside}.items():
            (count[name, key],) = {len(values) for values in table.values()}
    assert count == {
        ("before_after", ""): 32,
        ("search", ""): 7,
        ("pareto", ""): 4,
        ("robust", ""): 6,
        ("robust", "transmission_error"): 32,
        ("tornado", ""): 14,
        ("master_curve", ""): 399,
        ("master_curve", "valley"): 19,
        ("master_curve_traced", ""): 12,
        ("master_curve_torques", ""): 20,
        ("smoothing_bias", ""): 4,
    }
    assert list(pictures["tornado"].table)[:3] == ["quantity", "moved", "nominal_less_um"]
    assert pictures["robust"].table["response_um"].tolist() == [1.0, 2.0, 3.0, 1.4, 1.5, 1.6]
    assert "reason" not in pictures["pareto"].table


def test_bias_that_is_zero_is_not_on_the_logarithmic_line():
    line, zeros = relief.smoothing_bias(_relief()["smoothing_bias"]).axes[0].lines
    np.testing.assert_array_equal(line.get_xdata(), _WIDTH[1:])
    np.testing.assert_array_equal(zeros.get_xdata(), _WIDTH[:1])


def _lines(groups: dict[str, xr.Dataset]) -> dict[str, np.ndarray]:
    (axes, _) = relief.master_curve(groups["relief_map"], groups["relief_valley"]).axes
    return {str(line.get_label()): np.asarray(line.get_xydata()) for line in axes.lines}


def test_valley_ends_where_it_leaves_the_map():
    drawn = _lines(_relief())
    assert set(drawn) == {"valley, computed", "closed form"}
    points = drawn["valley, computed"]
    x, y = points[np.isfinite(points[:, 1])].T
    np.testing.assert_allclose(y, 2.0 / x)
    assert np.min(x) == pytest.approx(0.125)
    assert np.nanmax(drawn["closed form"][:, 1]) <= 20.0


def test_a_valley_that_jumps_is_broken_and_no_closed_form_is_no_line():
    best = np.minimum(2.0 / np.linspace(0.05, 0.5, 19), 20.0)
    best[-1] = 18.0
    groups = _relief(best)
    groups["relief_valley"]["closed_form_depth_um"][:] = np.nan
    (curve,) = _lines(groups).values()
    assert np.isnan(curve[-1, 1])


def test_trace_is_the_best_so_far():
    axes = searches.search_trace(_search()["search_trace"]).axes[0]
    assert np.asarray(axes.lines[0].get_ydata()).tolist() == [4.0, 4.0, 0.1]
    assert axes.get_xscale() == "log"


def test_a_front_joins_the_designs_that_count():
    front, dominated, beyond = searches.pareto(_search()["pareto"]).axes[0].lines
    assert np.asarray(front.get_xydata()).tolist() == [[1020.0, 0.2], [1000.0, 0.3]]
    assert np.asarray(dominated.get_xydata()).tolist() == [[1010.0, 0.4]]
    assert np.asarray(beyond.get_xydata()).tolist() == [[990.0, 0.1]]


def test_a_tornado_says_what_it_leaves_out():
    figure = searches.tornado(_search()["robust_influences"])
    assert [text.get_text() for text in figure.texts][-1] == "2 more do less"
    assert all(len(axes.patches) == 24 for axes in figure.axes)
