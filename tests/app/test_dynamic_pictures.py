import csv
import functools
import itertools
import re
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import jaxgear as jg
from jaxgear._whole_file import write_csv
from jaxgear.plot import _dynamic_pictures as pictures
from jaxgear.plot import _dynamic_tables as tables

_UNIT = re.compile(r".+ ?\n?.*\[[^\]]+\]$", re.DOTALL)
_TEETH = 20
# Pinion speed at which the mesh frequency is the natural frequency [rad/s].
_RESONANCE = 1000.0


# --- Data: an oscillator with clearance


def _response(amplitude, damping=0.03, force=0.14):
    """Both speeds over the resonance at which an oscillator with clearance has an amplitude."""
    softer = np.where(amplitude > 1.0, np.arccos(1.0 / np.maximum(amplitude, 1.0)) / np.pi, 0.0)
    stiffness = 1.0 - 0.75 * softer - 0.06 * np.log1p(np.maximum(amplitude - 1.0, 0.0))
    drive = force / amplitude
    middle = stiffness - 2.0 * damping**2
    root = np.sqrt(np.maximum(middle**2 - stiffness**2 + drive**2, 0.0))
    return np.sqrt(np.maximum(middle - root, 0.0)), np.sqrt(middle + root)


def _curve():
    """Speed [rad/s], dynamic ratio and stability along the whole resonance curve."""
    amplitude = np.linspace(0.05, 6.0, 6000)
    low, high = _response(amplitude)
    last = np.nonzero(high - low > 1e-6)[0][-1]
    rise = slice(np.argmax(low > 0.05), last + 1)
    ratio = amplitude[: last + 1]
    speed = np.concatenate([low[rise], high[last::-1]])
    grown = np.concatenate([amplitude[rise], ratio[::-1]])
    shown = speed < 2.4
    speed, grown = speed[shown], grown[shown]
    # A second, small resonance at half the speed.
    bump = 0.35 / np.hypot(1.0 - (speed / 0.5) ** 2, 0.08) * 0.16
    keep = np.unique(np.linspace(0, len(speed) - 1, 900).astype(int))
    ahead = np.gradient(speed) > 0.0
    return _RESONANCE * speed[keep], (1.0 + grown + bump)[keep], ahead[keep]


def _branches(speed):
    """Dynamic ratio over speed, upwards and downwards: the lowest and the highest of the curve."""
    curve, ratio, stable = _curve()
    folds = np.nonzero(stable[1:] != stable[:-1])[0]
    upper = np.arange(len(curve)) > folds[1]
    up = (np.arange(len(curve)) <= folds[0]) | (upper & (curve > curve[folds[0]]))
    down = upper | ((np.arange(len(curve)) <= folds[0]) & (curve < curve[folds[1]]))
    up, down = (np.interp(speed, curve[own], ratio[own]) for own in (up, down))
    return up, down


def _sweep(count=300, directions=("up", "down"), *, curve=True, last=2200.0):
    """A softening resonance with two folds, and a region of period two above twice its speed."""
    speed = np.linspace(100.0, last, count)
    up, down = _branches(speed)
    chosen = {"up": up, "down": down, "cold": up}
    ratio = np.stack([chosen[name] for name in directions])
    double = (speed > 1850.0) & (speed < 2050.0)
    bulge = np.sqrt(np.maximum(1.0 - ((speed - 1950.0) / 100.0) ** 2, 0.0))
    ratio = ratio + 1.2 * bulge
    periods = np.where(double, 2, 1) * np.ones_like(ratio, int)
    settled = np.ones_like(ratio, bool)
    settled[:, (speed > 1000.0) & (speed < 1030.0)] = False
    wild = np.random.default_rng(0).uniform(0.6, 1.5, ratio.shape)
    ratio = np.where(settled, ratio, ratio * wild)
    loss = np.clip(0.35 * (ratio - 2.0) / ratio, 0.0, 1.0)
    dims = ("direction", "speed")
    data = {
        "dynamic_ratio": (dims, ratio),
        "te_rms_um": (dims, 3.1 * (ratio - 1.0) + 0.2),
        "contact_loss": (dims, loss),
        "settled": (dims, settled),
        "stable": (dims, np.ones_like(settled)),
        "periods": (dims, periods),
    }
    if curve:
        at, value, stable = _curve()
        data["curve_speed"] = ("point", at)
        data["curve_dynamic_ratio"] = ("point", value)
        data["curve_te_rms_um"] = ("point", 3.1 * (value - 1.0) + 0.2)
        data["curve_stable"] = ("point", stable)
    coords = {"direction": list(directions), "speed": speed}
    return xr.Dataset(data, coords, {"teeth_pinion": _TEETH})


_CRITICAL = [
    (330.0, "mode 7 / 3"),
    (500.0, "mode 7 / 2"),
    (505.0, "mode 4"),
    (520.0, "mode 5"),
    (1000.0, "mode 7"),
    (1960.0, "mode 9"),
    (5000.0, "mode 12"),
]


@functools.cache
def _marched(count=300, periods=40, steps=64, last=2.4, start=1.0, damping=0.04):
    """Force and deflection of the oscillator over time in the last two mesh periods.

    Semi-implicit steps of x'' + 2 zeta x' + k(t) max(x, 0) = 1 at all speeds together.
    """
    ratio = np.linspace(0.1, last, count)
    step = 2.0 * np.pi / ratio / steps
    fine = max(1, int(np.ceil(np.max(step) / 0.25)))
    x, v = np.full(count, start), np.zeros(count)
    kept = []
    for number in range(periods * steps):
        stiffness = 1.0 + 0.22 * np.tanh(6.0 * np.cos(2.0 * np.pi * (number + 0.5) / steps))
        for _ in range(fine):
            force = stiffness * np.maximum(x, 0.0)
            v = (v + step / fine * (1.0 - force)) / (1.0 + 2.0 * damping * step / fine)
            x = x + step / fine * v
        kept.append((stiffness * np.maximum(x, 0.0), x.copy(), v.copy()))
    last_two = np.asarray(kept[-2 * steps :])
    phase = (np.arange(2 * steps) + 0.5) / steps
    return _RESONANCE * ratio, phase, last_two.transpose(1, 2, 0)


def _amplitudes(values, first=1.0):
    """Amplitudes at orders in steps of one half, rows speeds."""
    spectrum = 2.0 * np.abs(np.fft.rfft(values, axis=1)) / values.shape[1]
    order = 0.5 * np.arange(spectrum.shape[1])
    chosen = (order > 0.0) & (order <= 12.0)
    whole = chosen & (order % 1.0 == 0.0) if first == 1.0 else chosen
    return order[whole], spectrum[:, whole]


def _orders(count=300, bearings=4, first=1.0):
    speed, _, (force, x, _) = _marched(count)
    order, te = _amplitudes(8.0 * x, first)
    _, mesh = _amplitudes(3000.0 * force, first)
    data = {
        "te_order_um": (("speed", "order"), te),
        "mesh_force_order_N": (("speed", "order"), mesh),
        "settled": ("speed", np.abs(speed - 1850.0) > 60.0),
    }
    coords = {"speed": speed, "order": order}
    if bearings:
        share = np.linspace(0.2, 0.7, bearings)
        shift = np.linspace(0.0, 0.3, bearings)
        peak = 1.0 / np.hypot(1.0 - (speed / 700.0) ** 2, 0.1)
        scale = share * (1.0 + shift * peak[:, None])
        data["bearing_force_order_N"] = (
            ("speed", "bearing", "order"),
            scale[:, :, None] * mesh[:, None],
        )
        names = [f"{gear} {index}" for gear in ("pinion", "wheel") for index in range(bearings)]
        coords["bearing"] = names[:bearings]
    return xr.Dataset(data, coords, {"teeth_pinion": _TEETH})


def _loss(count=300, pairs=True):
    speed, phase, (force, _, _) = _marched(count)
    half = len(phase) // 2
    data = {
        "mesh_force_ratio": (("speed", "phase"), force[:, :half]),
        "settled": ("speed", np.abs(speed - 1850.0) > 60.0),
    }
    if pairs:
        two = np.where(phase[:half] < 0.6, 2, 1)
        data["tooth_pairs"] = (("speed", "phase"), np.where(force[:, :half] > 0.0, two, 0))
    return xr.Dataset(data, {"speed": speed, "phase": phase[:half]}, {"teeth_pinion": _TEETH})


def _orbits(places=(130,), names=("settled",), periods=(2,)):
    _, phase, (force, x, v) = _marched(300)
    data = {name: [] for name in ("mesh_force_ratio", "te_um", "te_rate_mm_s")}
    for place, last in zip(places, periods, strict=True):
        scales = (1.0, 8.0, 8.0e-3 * _RESONANCE * _TEETH)
        for name, scale, values in zip(data, scales, (force, x, v), strict=True):
            data[name].append(np.where(phase < last, scale * values[place], np.nan))
    variables: dict[str, Any] = {
        name: (("branch", "phase"), np.stack(rows)) for name, rows in data.items()
    }
    static = 8.0 / (1.0 + 0.22 * np.tanh(6.0 * np.cos(2.0 * np.pi * phase)))
    variables["te_static_um"] = ("phase", static)
    variables["stable"] = ("branch", np.ones(len(places), bool))
    variables["settled"] = ("branch", np.ones(len(places), bool))
    return xr.Dataset(variables, {"branch": list(names), "phase": phase})


def _modes(count=20, parts=("mesh", "pinion", "wheel", "shafts", "bearings")):
    chance = np.random.default_rng(3)
    energy = chance.dirichlet(np.full(len(parts), 0.5), count)
    frequency = np.sort(chance.uniform(200.0, 14000.0, count))
    frequency[0] = 0.0
    energy[0] = np.nan
    return xr.Dataset(
        {
            "frequency_Hz": ("mode", frequency),
            "energy": (("mode", "part"), energy),
            "damping_ratio": ("mode", 0.02 + 0.05 * np.nan_to_num(energy[:, 0])),
        },
        {"part": list(parts)},
    )


def _campbell(count=80, modes=8, *, energy=True):
    speed = np.linspace(0.0, 2000.0, count) if count > 2 else np.asarray([100.0, 2000.0])
    base = np.linspace(500.0, 14000.0, modes) ** 1.0
    turn = np.asarray([(-1.0) ** n * 0.12 * n for n in range(modes)])
    frequency = base + turn * speed[:, None]
    data = {"frequency_Hz": (("speed", "mode"), frequency)}
    if energy:
        share = np.random.default_rng(5).dirichlet(np.full(modes, 0.7))
        data["mesh_energy"] = (("speed", "mode"), np.tile(share / share.max(), (count, 1)))
    return xr.Dataset(data, {"speed": speed}, {"teeth_pinion": _TEETH})


# --- The pictures


def _all_unsettled():
    """Nothing settled, one response without a number, and one far beyond the others."""
    dataset = _sweep(40, ("cold",), curve=False)
    dataset["settled"][:] = False
    dataset["dynamic_ratio"][:, 3] = np.nan
    return dataset


def _unstable():
    dataset = _sweep(300, ("cold",), curve=False).drop_vars("contact_loss")
    dataset["stable"][:, 100:110] = False
    return dataset


_BRANCHES = (130, 236), ("speed rising", "speed falling"), (1, 2)
# Every picture of a dataset: its name, its data, and what else it takes.
_CASES = {
    "sweep": ("sweep", _sweep, {"critical": _CRITICAL}),
    "sweep of two speeds": ("sweep", lambda: _sweep(2, ("up",), curve=False), {}),
    "sweep of thirty": ("sweep", lambda: _sweep(30), {}),
    "sweep that never settles": ("sweep", _all_unsettled, {"critical": _CRITICAL[:1]}),
    "sweep with unstable responses": ("sweep", _unstable, {}),
    "waterfall": ("waterfall", _orders, {"natural": [(900.0, "mode 4"), (3183.0, "mode 7")]}),
    "waterfall of half orders": ("waterfall", lambda: _orders(first=0.5), {}),
    "waterfall of two speeds": ("waterfall", lambda: _orders(2), {}),
    "orders": ("orders", _orders, {}),
    "orders without bearings": ("orders", lambda: _orders(2, bearings=0, first=0.5), {}),
    "contact loss": ("contact_loss", _loss, {}),
    "contact loss of two speeds": ("contact_loss", lambda: _loss(2, pairs=False), {}),
    "modes": ("modes", _modes, {}),
    "one kind of energy": ("modes", lambda: _modes(2, ("mesh",)), {}),
    "campbell": ("campbell", _campbell, {}),
    "campbell of two speeds": ("campbell", lambda: _campbell(2, 2, energy=False), {}),
    "orbit": ("orbit", _orbits, {}),
    "two branches": ("orbit", lambda: _orbits(*_BRANCHES), {}),
}


def _columns(kind, data):
    return getattr(tables, f"{kind}_columns")(data)


@pytest.fixture(scope="module")
def everything():
    """Figure and columns of each case; warnings are errors here as in every test."""
    found = {}
    for name, (kind, make, extra) in _CASES.items():
        data = make()
        figure = getattr(pictures, kind)(data, name, **extra)
        found[name] = figure, _columns(kind, data)
    return found


def _axes_and_seconds(figure: Figure):
    """All axes, those above or beside the others included."""
    for axes in figure.axes:
        yield axes
        yield from axes.child_axes


def test_axes_say_quantity_and_unit(everything):
    for name, (figure, _) in everything.items():
        what, _, case = figure.get_suptitle().partition(": ")
        assert what
        assert case == name
        for axes in figure.axes:
            lowest = axes.get_subplotspec() is None or axes.get_subplotspec().is_last_row()
            labels = [axes.get_ylabel()]
            if axes.get_label() != "<colorbar>" and (lowest or name == "two branches"):
                labels.append(axes.get_xlabel())
            for second in axes.child_axes:
                labels.append(second.get_xlabel() or second.get_ylabel())
            for label in labels:
                assert _UNIT.match(label), f"{name}: {label!r}"


def _texts(figure: Figure):
    """Every text that is seen, with its box on the page."""
    figure.draw_without_rendering()
    page = figure.bbox
    for axes in _axes_and_seconds(figure):
        for axis in (axes.xaxis, axes.yaxis):
            if not axis.get_visible():
                continue
            yield axis.label
            low, high = sorted(axis.get_view_interval())
            room = 1e-9 * (high - low)
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                if low - room <= tick.get_loc() <= high + room:
                    yield from (tick.label1, tick.label2)
        yield from axes.texts
        yield from (axes.title, axes._left_title, axes._right_title)  # pyright: ignore
    yield from itertools.chain.from_iterable(legend.get_texts() for legend in figure.legends)
    assert page.width > 0.0


@pytest.mark.end_to_end
def test_no_text_lies_on_another_or_leaves_the_page(everything):
    for name, (figure, _) in everything.items():
        boxes = []
        for text in dict.fromkeys(_texts(figure)):
            if text.get_visible() and text.get_text().strip():
                boxes.append((text.get_text(), text.get_window_extent()))
        assert len(boxes) > 8, name
        for text, box in boxes:
            inside = (
                figure.bbox.x0 - 1,
                figure.bbox.y0 - 1,
                figure.bbox.x1 + 1,
                figure.bbox.y1 + 1,
            )
            assert box.x0 >= inside[0], f"{name}: {text!r}"
            assert box.y0 >= inside[1], f"{name}: {text!r}"
            assert box.x1 <= inside[2], f"{name}: {text!r}"
            assert box.y1 <= inside[3], f"{name}: {text!r}"
        for (one, a), (other, b) in itertools.combinations(boxes, 2):
            width = min(a.x1, b.x1) - max(a.x0, b.x0)
            height = min(a.y1, b.y1) - max(a.y0, b.y0)
            # Boxes hold a line's full height, also above small letters.
            assert width < 1.0 or height < 3.0, f"{name}: {one!r} and {other!r}"


def test_speed_stands_in_all_its_units(everything):
    """Below in rad/s, above in rpm and as the frequency with which teeth meet."""
    for name in ("sweep", "campbell"):
        axes = everything[name][0].axes[0]
        everything[name][0].draw_without_rendering()
        rpm, mesh = axes.child_axes
        low, high = axes.get_xlim()
        np.testing.assert_allclose(rpm.get_xlim(), np.asarray([low, high]) / jg.rpm)
        turns = np.asarray([low, high]) / (2.0 * np.pi)
        np.testing.assert_allclose(mesh.get_xlim(), _TEETH * turns / 1e3)


def test_frequencies_are_read_in_hertz_or_kilohertz():
    dataset = _sweep(3, last=500.0, curve=False)
    figure = pictures.sweep(dataset, "slow")
    figure.draw_without_rendering()
    mesh = figure.axes[0].child_axes[1]
    assert mesh.get_xlabel() == "mesh frequency [Hz]"
    assert np.isclose(mesh.get_xlim()[1], _TEETH * 504.0 / (2.0 * np.pi))


# --- What is drawn


def _lines(axes, **wanted):
    """Lines of some look: colour, style or marker."""
    return [
        line
        for line in axes.lines
        if all(getattr(line, f"get_{name}")() == value for name, value in wanted.items())
    ]


def _legend(figure: Figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_unstable_parts_are_dashed_and_stable_ones_solid(everything):
    figure, columns = everything["sweep"][0], tables.curve_columns(_sweep())
    curve = np.stack([columns["pinion_speed_rad_s"], columns["dynamic_ratio"]], axis=1)
    stable = columns["stable"]
    (solid,) = _lines(figure.axes[0], color="black", linestyle="-")
    (dashed,) = _lines(figure.axes[0], color="black", linestyle="--")
    solid, dashed = solid.get_xydata(), dashed.get_xydata()
    for drawn, own in ((solid, stable), (dashed, ~stable)):
        drawn = drawn[np.isfinite(drawn[:, 0])]
        missing = [point for point in curve[own] if not np.any(np.all(drawn == point, axis=1))]
        assert not missing
    # A dashed part reaches to the stable points on either side of it, and no further.
    assert np.count_nonzero(np.isfinite(dashed[:, 0])) == np.count_nonzero(~stable) + 2


def test_unstable_responses_are_dashed_and_counted(everything):
    figure, columns = everything["sweep with unstable responses"]
    (dashed,) = _lines(figure.axes[0], color=pictures._GREEN, linestyle="--")
    shown = dashed.get_xdata()[:-1]
    np.testing.assert_array_equal(shown, columns["pinion_speed_rad_s"][99:111])
    assert "unstable (10 of 300)" in _legend(figure)


def test_unsettled_responses_are_marked_and_counted(everything):
    figure, columns = everything["sweep"]
    lost = ~columns["settled"].reshape(2, -1)
    assert f"not settled ({np.count_nonzero(lost)} of 600)" in _legend(figure)
    for axes in figure.axes:
        marked = [line for line in axes.lines if line.get_markeredgecolor() == pictures._RED]
        assert sum(np.size(line.get_xdata()) for line in marked) == np.count_nonzero(lost)
        joined = [line for line in axes.lines if line.get_linestyle() == "-"]
        speeds = columns["pinion_speed_rad_s"][: lost.shape[1]][lost[0]]
        for line in joined:
            if line.get_color() != "black":
                assert not np.isin(speeds, line.get_xdata()).any()


def test_a_response_without_a_number_is_seen_and_leaves_an_empty_cell(everything, tmp_path):
    figure, columns = everything["sweep that never settles"]
    assert _legend(figure)[1:] == ["not settled (40 of 40)", "no number (1 of 40)"]
    (mark,) = _lines(figure.axes[0], marker="x")
    np.testing.assert_array_equal(mark.get_xdata(), columns["pinion_speed_rad_s"][3:4])
    table = tmp_path / "sweep.csv"
    write_csv(columns, table)
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    cells = [row[rows[0].index("dynamic_ratio")] for row in rows[1:]]
    assert [index for index, cell in enumerate(cells) if not cell] == [3]
    assert "nan" not in table.read_text(encoding="utf-8").lower()


def test_unsettled_responses_far_away_do_not_set_the_scale():
    dataset = _sweep(100, curve=False)
    dataset["settled"][0, 50] = False
    dataset["dynamic_ratio"][0, 50] = 1e6
    axes = pictures.sweep(dataset, "far").axes[0]
    settled = dataset["dynamic_ratio"].values[dataset["settled"].values]
    assert axes.get_ylim()[1] < 1.2 * np.max(settled)
    (marks,) = [
        line
        for line in axes.lines
        if np.size(line.get_xdata()) and line.get_markerfacecolor() == "none"
    ][:1]
    assert np.max(marks.get_ydata()) < axes.get_ylim()[1]


def test_periods_have_their_own_markers():
    dataset = _sweep(100, ("up",), curve=False)
    dataset["settled"][:] = True
    dataset["periods"][:] = 1
    dataset["periods"][0, 10:13] = 2
    dataset["periods"][0, 40] = 3
    figure = pictures.sweep(dataset, "periods")
    assert {"two mesh periods (3)", "more periods (1)"} < set(_legend(figure))
    (two,), (more,) = (_lines(figure.axes[0], marker=marker) for marker in "s^")
    np.testing.assert_array_equal(two.get_xdata(), dataset["speed"].values[10:13])
    np.testing.assert_array_equal(more.get_xdata(), dataset["speed"].values[40:41])


def test_folds_and_leaps_are_where_the_branches_part(everything):
    """Upwards the response leaps at the higher fold, downwards at the lower one."""
    figure, columns = everything["sweep"]
    folds = tables.fold_columns(_sweep())["pinion_speed_rad_s"]
    assert len(folds) == 2
    assert "fold (2)" in _legend(figure)
    arrows = [text for text in figure.axes[0].texts if getattr(text, "arrow_patch", None)]
    step = np.ptp(columns["pinion_speed_rad_s"]) / 299
    assert len(arrows) == 2
    for arrow, fold in zip(arrows, (np.max(folds), np.min(folds)), strict=True):
        assert abs(arrow.xy[0] - fold) <= step
    # The first goes on to higher speeds, the second back to lower ones.
    ahead = [arrow.xy[0] - arrow.xyann[0] for arrow in arrows]
    assert ahead[0] > 0.0 > ahead[1]


def test_pieces_of_a_continuation_curve_stay_apart():
    dataset = _sweep(3)
    dataset["curve_speed"][400] = np.nan
    piece = tables.curve_columns(dataset)["piece"]
    assert len(piece) == dataset.sizes["point"] - 1
    assert np.count_nonzero(piece == 0) == 400
    assert set(piece) == {0, 1}
    assert len(tables.fold_columns(dataset)["pinion_speed_rad_s"]) == 2
    axes = pictures.sweep(dataset, "two pieces").axes[0]
    whole = [line.get_xdata() for line in _lines(axes, color="black")]
    assert not any(np.isclose(x, dataset["curve_speed"].values[400]).any() for x in whole)


def test_lines_at_critical_speeds(everything):
    figure, _ = everything["sweep"]
    shown = [speed for speed, _ in _CRITICAL if speed < 2200.0]
    for axes in figure.axes:
        upright = [line.get_xdata()[0] for line in _lines(axes, linestyle=":")]
        np.testing.assert_array_equal(upright, shown)
    columns = tables.critical_columns(_CRITICAL)
    assert list(columns["label"]) == [label for _, label in _CRITICAL]
    written = [text.get_text() for text in figure.axes[0].texts if text.get_text()]
    assert written == [label for _, label in _CRITICAL[:-1]]


# --- Numbers


@pytest.mark.parametrize("directions", [("up", "down"), ("cold",)])
def test_columns_of_a_sweep_are_its_data(directions):
    dataset = _sweep(50, directions)
    columns, curve = tables.sweep_columns(dataset), tables.curve_columns(dataset)
    for direction in directions:
        row = columns["direction"] == direction
        np.testing.assert_array_equal(columns["pinion_speed_rad_s"][row], dataset["speed"])
        for name in ("dynamic_ratio", "te_rms_um", "contact_loss", "settled", "stable", "periods"):
            own = dataset[name].sel(direction=direction).values
            np.testing.assert_array_equal(columns[name][row], own)
    np.testing.assert_array_equal(curve["te_rms_um"], dataset["curve_te_rms_um"].values)


def test_columns_of_orders_are_their_data():
    dataset = _orders(30)
    columns = tables.waterfall_columns(dataset)
    assert len(columns["order"]) == 30 * dataset.sizes["order"]
    row = 7 * dataset.sizes["order"] + 1
    speed = dataset["speed"].values[7]
    assert columns["pinion_speed_rad_s"][row] == speed
    assert columns["order"][row] == 2.0
    assert np.isclose(columns["frequency_Hz"][row], 2 * 20 * speed / (2 * np.pi))
    assert columns["te_order_um"][row] == dataset["te_order_um"].values[7, 1]
    columns = tables.bearing_orders_columns(dataset)
    own = dataset["bearing_force_order_N"].sel(bearing="pinion 1", order=2.0)
    row = (columns["bearing"] == "pinion 1") & (columns["order"] == 2.0)
    np.testing.assert_array_equal(columns["bearing_force_order_N"][row], own.values)
    columns = tables.orders_columns(dataset)
    row, force = columns["order"] == 3.0, dataset["mesh_force_order_N"].sel(order=3.0)
    np.testing.assert_array_equal(columns["mesh_force_order_N"][row], force.values)
    np.testing.assert_array_equal(columns["pinion_speed_rad_s"][row], dataset["speed"].values)


def test_the_mean_is_no_order():
    dataset = _orders(10)
    with_mean = dataset.pad(order=(1, 0), constant_values=99.0).assign_coords(
        order=np.concatenate([[0.0], dataset["order"].values])
    )
    for columns in (
        tables.waterfall_columns,
        tables.orders_columns,
        tables.bearing_orders_columns,
    ):
        for name, values in columns(dataset).items():
            np.testing.assert_array_equal(columns(with_mean)[name], values)


def test_share_of_the_time_without_contact():
    """A quarter of the period at one speed, in steps of two sizes, and none at the other."""
    phase = np.concatenate([np.arange(0.0125, 0.5, 0.025), np.arange(0.525, 1.0, 0.05)])
    force = np.ones((2, len(phase)))
    force[0, phase < 0.25] = 0.0
    dataset = xr.Dataset(
        {"mesh_force_ratio": (("speed", "phase"), force)},
        {"speed": [100.0, 200.0], "phase": phase},
        {"teeth_pinion": _TEETH},
    )
    shares, columns = (
        tables.contact_shares_columns(dataset),
        tables.contact_loss_columns(dataset),
    )
    np.testing.assert_allclose(shares["contact_loss"], [0.25, 0.0], atol=0.01)
    assert list(shares["pinion_speed_rad_s"]) == [100.0, 200.0]
    np.testing.assert_array_equal(columns["mesh_force_ratio"], force.ravel())
    assert list(columns["pinion_speed_rad_s"][:: len(phase)]) == [100.0, 200.0]


def test_map_of_contact_loss_spans_its_speeds_and_the_period(everything):
    for name in ("contact loss", "contact loss of two speeds"):
        axes = everything[name][0].axes[0]
        assert axes.get_ylim() == (0.0, 1.0)
        np.testing.assert_allclose(axes.get_xlim(), (100.0, 2400.0))


def test_bars_of_energy_fill_each_row(everything):
    figure, columns = everything["modes"]
    bars = np.asarray([[bar.get_width() for bar in part] for part in figure.axes[0].containers])
    np.testing.assert_allclose(np.sum(bars, axis=0)[1:], 1.0)
    np.testing.assert_array_equal(np.sum(bars, axis=0)[0], 0.0)
    np.testing.assert_allclose(bars[0, 1:], columns["energy_mesh"][1:].astype(float), rtol=1e-9)
    assert list(columns["mode"]) == list(range(1, 21))


def test_crossings_of_straight_lines_are_exact():
    """f = 1000 Hz + a Omega meets h z Omega / 2 pi at 1000 Hz / (h z / 2 pi - a)."""
    speed, slopes = np.linspace(0.0, 700.0, 23), np.asarray([0.0, 0.3, -0.5])
    frequency = 1000.0 + slopes * speed[:, None]
    dataset = xr.Dataset(
        {
            "frequency_Hz": (("speed", "mode"), frequency),
            "mesh_energy": (("speed", "mode"), np.tile(speed[:, None] / 700.0, 3)),
        },
        {"speed": speed},
        {"teeth_pinion": _TEETH},
    )
    columns = tables.crossing_columns(dataset, harmonics=3)
    mode = columns["mode"].astype(int)
    exact = 1000.0 / (columns["harmonic"] * _TEETH / (2 * np.pi) - slopes[mode - 1])
    assert len(mode) == 9
    np.testing.assert_allclose(columns["pinion_speed_rad_s"], exact, rtol=1e-12)
    expected = 1000.0 + slopes[mode - 1] * exact
    np.testing.assert_allclose(columns["frequency_Hz"], expected, rtol=1e-12)
    np.testing.assert_allclose(columns["mesh_energy"], exact / 700.0, rtol=1e-12)
    columns = tables.campbell_columns(dataset)
    second = columns["mode"] == 2
    np.testing.assert_array_equal(columns["frequency_Hz"][second], frequency[:, 1])
    np.testing.assert_array_equal(columns["pinion_speed_rad_s"][second], speed)


def test_free_rotation_crosses_nothing():
    dataset = _campbell(5, 2, energy=False)
    dataset["frequency_Hz"][:, 0] = 0.0
    assert 1.0 not in tables.crossing_columns(dataset)["mode"]


def test_an_orbit_lasts_as_long_as_its_numbers(everything):
    figure, columns = everything["two branches"]
    rising = columns["branch"] == "speed rising"
    assert np.count_nonzero(rising) == 64
    assert np.count_nonzero(~rising) == 128
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles[2] == "repeats every mesh period, stable"
    assert titles[3] == "repeats every 2 mesh periods, stable"
    force = columns["mesh_force_ratio"][rising]
    assert f"largest {np.max(force):.2f}, no contact" in titles[0]
    share = 100.0 * np.mean(force == 0.0)
    assert titles[0].endswith(f"no contact {share:.3g} % of time")
    # The portrait is closed, and has a point for each mesh period.
    for axes, count in zip(figure.axes[-2:], (1, 2), strict=True):
        closed = axes.lines[0].get_xydata()
        np.testing.assert_array_equal(closed[0], closed[-1])
        assert len(axes.lines[-1].get_xdata()) == count


# --- Small parts


def test_labels_are_pushed_apart_no_more_than_needed():
    places = np.asarray([0.0, 4.0, 5.0, 20.0])
    moved = pictures._apart(places, 3.0, -10.0, 30.0)
    np.testing.assert_allclose(moved, [0.0, 3.0, 6.0, 20.0])
    squeezed = pictures._apart(places, 50.0, 0.0, 30.0)
    np.testing.assert_allclose(squeezed, [0.0, 10.0, 20.0, 30.0])
    np.testing.assert_allclose(pictures._apart(places, 3.0, 0.0, 18.0)[-1], 18.0)


def test_runs_of_equal_values():
    kinds = np.asarray([1, 1, 2, 0, 0])
    assert list(pictures._runs(kinds)) == [(1, 0, 1), (2, 2, 2), (0, 3, 4)]
    assert list(pictures._runs(kinds[:0])) == []


def test_labels_do_not_depend_on_when_they_are_drawn():
    places = []
    for _ in range(2):
        figure = pictures.campbell(_campbell(2, 3), "again")
        places.append([(text.get_text(), text.get_position()) for text in figure.axes[0].texts])
    assert places[0] == places[1]


def test_flags_may_come_from_a_file_or_not_at_all():
    """Files hold flags as whole numbers, of which `~` makes others."""
    dataset = _sweep(30, ("up",), curve=False)
    dataset["settled"][0, 4] = False
    numbers = dataset.assign({name: dataset[name].astype("int8") for name in ("settled", "stable")})
    legends = [_legend(pictures.sweep(each, "flags")) for each in (dataset, numbers)]
    assert legends[0] == legends[1]
    assert "not settled (1 of 30)" in legends[0]
    bare = dataset[["dynamic_ratio", "te_rms_um"]]
    assert _legend(pictures.sweep(bare, "bare")) == ["speed rising"]
    names = {"direction", "pinion_speed_rad_s", "dynamic_ratio", "te_rms_um"}
    assert set(tables.sweep_columns(bare)) == names
