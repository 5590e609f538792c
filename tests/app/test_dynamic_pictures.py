"""Pictures of dynamics and their tables, all made of datasets alone."""

import functools
import itertools
import re
from typing import Any

import numpy as np
import pytest
import xarray as xr
from helpers import quick
from matplotlib.figure import Figure
from table_checks import assert_table

from jaxgear import _units, plot
from jaxgear._response._sweep_features import WAYS
from jaxgear._whole_file import write_csv
from jaxgear.plot._labels import apart
from jaxgear.plot._palette import GREEN, RED
from jaxgear.plot._speed_axes import runs

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


def _sweep(count=300, directions=("up", "down"), *, curve=True, last=2200.0, first=1.0):
    """A softening resonance with two folds, and a region of period two above twice its speed.

    Orders and phases are those of an oscillator at speeds of the same number.
    """
    speed = np.linspace(100.0, last, count)
    up, down = _branches(speed)
    ratio = np.stack([{"up": up, "down": down, "cold": up}[name] for name in directions])
    double = (speed > 1850.0) & (speed < 2050.0)
    ratio = ratio + 1.2 * np.sqrt(np.maximum(1.0 - ((speed - 1950.0) / 100.0) ** 2, 0.0))
    settled = np.ones_like(ratio, bool)
    settled[:, (speed > 1000.0) & (speed < 1030.0)] = False
    wild = np.random.default_rng(0).uniform(0.6, 1.5, ratio.shape)
    ratio = np.where(settled, ratio, ratio * wild)
    dims = ("direction", "speed")
    _, phase, (force, x, _) = _marched(count)
    half = len(phase) // 2
    order, te = _amplitudes(8.0 * x, first)
    _, mesh = _amplitudes(3000.0 * force, first)
    bearing = np.linspace(0.2, 0.7, 4)[:, None, None] * mesh
    two = np.where(phase[:half] < 0.6, 2, 1)
    both = lambda values: np.stack([values] * len(directions))
    data = {
        "dynamic_ratio": (dims, ratio),
        "te_rms_um": (dims, 3.1 * (ratio - 1.0) + 0.2),
        "contact_loss": (dims, np.clip(0.35 * (ratio - 2.0) / ratio, 0.0, 1.0)),
        "settled": (dims, settled),
        "stable": (dims, np.ones_like(settled)),
        "periods": (dims, np.where(double, 2, 1) * np.ones_like(ratio, int)),
        "te_order_um": ((*dims, "order"), both(te)),
        "mesh_force_order_N": ((*dims, "order"), both(mesh)),
        "bearing_force_order_N": (("direction", "bearing", "speed", "order"), both(bearing)),
        "mesh_force_ratio": ((*dims, "phase"), both(force[:, :half])),
        "tooth_pairs": ((*dims, "phase"), both(np.where(force[:, :half] > 0.0, two, 0))),
        "excited_frequency_Hz": ("excited_mode", _EXCITED),
    }
    if curve:
        at, value, stable = _curve()
        names = ("curve_speed", "curve_dynamic_ratio", "curve_te_rms_um", "curve_stable")
        values = (at, value, 3.1 * (value - 1.0) + 0.2, stable)
        data |= {name: ("point", each) for name, each in zip(names, values, strict=True)}
        data["curve_piece"] = ("point", np.zeros(at.size, int))
    coords = {"direction": list(directions), "speed": speed, "order": order, "phase": phase[:half]}
    coords |= {"bearing": ["pinion 0", "pinion 1", "wheel 0", "wheel 1"], "excited_mode": [4, 7, 9]}
    attributes = {"teeth_pinion": _TEETH, "mesh_periods": 1, "peak_direction": directions[0]}
    return xr.Dataset(data, coords, {**attributes, "title": "by hand"})


# Of the first three harmonics some are critical beyond the last speed.
_EXCITED = np.asarray([1000.0, 1600.0, 6240.0]) * _TEETH / (2.0 * np.pi)


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
    variables["te_um"] = (*variables["te_um"], {"long_name": "dynamic TE", "units": "um"})
    static = 8.0 / (1.0 + 0.22 * np.tanh(6.0 * np.cos(2.0 * np.pi * phase)))
    variables["te_static_um"] = ("phase", static)
    variables["stable"] = ("branch", np.ones(len(places), bool))
    variables["settled"] = ("branch", np.ones(len(places), bool))
    return xr.Dataset(variables, {"branch": list(names), "phase": phase}, {"title": "by hand"})


def _modes(count=20, parts=("mesh", "pinion", "wheel", "bearings")):
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
        {"part": list(parts), "mode": np.arange(1, count + 1)},
        {"title": "by hand"},
    )


def _turning(speed, frequency, energy=None, harmonics=4):
    data = {"frequency_Hz": (("speed", "mode"), frequency)}
    if energy is not None:
        data["mesh_energy"] = (("speed", "mode"), energy)
    attributes = {"teeth_pinion": _TEETH, "harmonics": harmonics, "title": "by hand"}
    number = np.arange(1, frequency.shape[1] + 1)
    return xr.Dataset(data, {"speed": speed, "mode": number}, attributes)


def _campbell(count=80, modes=8, *, energy=True):
    speed = np.linspace(0.0, 2000.0, count) if count > 2 else np.asarray([100.0, 2000.0])
    base = np.linspace(500.0, 14000.0, modes)
    turn = np.asarray([(-1.0) ** n * 0.12 * n for n in range(modes)])
    share = np.random.default_rng(5).dirichlet(np.full(modes, 0.7))
    share = np.tile(share / share.max(), (count, 1)) if energy else None
    return _turning(speed, base + turn * speed[:, None], share)


# --- The pictures


def _all_unsettled():
    """Nothing settled, one response far beyond the others."""
    dataset = _sweep(40, ("cold",), curve=False)
    dataset["settled"][:] = False
    dataset["dynamic_ratio"][:, 3] = 100.0
    return dataset


def _unstable():
    dataset = _sweep(300, ("cold",), curve=False, first=0.5)
    dataset["stable"][:, 100:110] = False
    return dataset.drop_dims("bearing")


_BRANCHES = (130, 236), ("speed rising", "speed falling"), (1, 2)
_DATA = {
    "both ways": lambda: {"sweep": _sweep(), "orbit": _orbits()},
    "two speeds": lambda: {"sweep": _sweep(2, ("up",), curve=False), "orbit": _orbits(*_BRANCHES)},
    "unstable": lambda: {"sweep": _unstable()},
    "modes": lambda: {"modes": _modes(), "campbell": _campbell()},
    "few modes": lambda: {"modes": _modes(2, ("mesh",)), "campbell": _campbell(2, 2, energy=False)},
    "thirty speeds": lambda: {"sweep": _sweep(30)},
    "never settled": lambda: {"sweep": _all_unsettled()},
}


@functools.cache
def _drawn(case: str) -> dict[str, tuple[Any, Any]]:
    """Figure and picture of a case by name; warnings are errors here as in every test."""
    return {each.name: (each.draw(), each) for each in plot.pictures(_DATA[case]())}


each_case = pytest.mark.parametrize("case", quick(1, _DATA))


def test_every_kind_has_its_picture():
    names = {*_drawn("both ways"), *_drawn("modes")}
    kinds = ("sweep", "waterfall", "orders", "contact_loss", "orbit", "modes", "campbell")
    assert names == set(kinds)


@pytest.mark.slow
@pytest.mark.parametrize("case", _DATA)
def test_every_table_reads_back(case, tmp_path):
    for name, (_, each) in _drawn(case).items():
        for key, table in {"": each.table, **each.beside}.items():
            path = tmp_path / f"{name}{key}.csv"
            write_csv(table, path)
            if key != "folds":
                assert len(assert_table(path)), path


def _axes_and_seconds(figure: Figure):
    """All axes, those above or beside the others included."""
    for axes in figure.axes:
        yield axes
        yield from axes.child_axes


@each_case
def test_axes_say_quantity_and_unit(case):
    for name, (figure, _) in _drawn(case).items():
        what, _, title = figure.get_suptitle().partition(": ")
        assert what
        assert title.startswith("by hand")
        for axes in figure.axes:
            lowest = axes.get_subplotspec() is None or axes.get_subplotspec().is_last_row()
            labels = [axes.get_ylabel()]
            if axes.get_label() != "<colorbar>" and (
                lowest or (case, name) == ("two speeds", "orbit")
            ):
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
        yield from (axes.title, axes._left_title, axes._right_title)
    yield from itertools.chain.from_iterable(legend.get_texts() for legend in figure.legends)
    assert page.width > 0.0


@pytest.mark.slow
@pytest.mark.end_to_end
@each_case
def test_no_text_lies_on_another_or_leaves_the_page(case):
    for name, (figure, _) in _drawn(case).items():
        boxes = []
        for text in dict.fromkeys(_texts(figure)):
            if text.get_visible() and text.get_text().strip():
                boxes.append((text.get_text(), text.get_window_extent()))
        assert len(boxes) > 8, name
        for text, box in boxes:
            page = figure.bbox.padded(1.0)
            assert page.x0 <= box.x0 and box.x1 <= page.x1, f"{name}: {text!r}"  # noqa: PT018
            assert page.y0 <= box.y0 and box.y1 <= page.y1, f"{name}: {text!r}"  # noqa: PT018
        # Boxes hold a line's full height, also above small letters.
        first, second = np.triu_indices(len(boxes), 1)
        ends = np.asarray([box.extents for _, box in boxes])
        shared = np.minimum(ends[first, 2:], ends[second, 2:])
        shared -= np.maximum(ends[first, :2], ends[second, :2])
        over = np.nonzero((shared[:, 0] >= 1.0) & (shared[:, 1] >= 3.0))[0]
        assert not [(boxes[first[at]][0], boxes[second[at]][0]) for at in over], name


def test_speed_stands_in_all_its_units():
    """Below in rad/s, above in rpm and as the frequency with which teeth meet."""
    for name in (("both ways", "sweep"), ("modes", "campbell")):
        figure, _ = _drawn(name[0])[name[1]]
        axes = figure.axes[0]
        figure.draw_without_rendering()
        rpm, mesh = axes.child_axes
        low, high = axes.get_xlim()
        np.testing.assert_allclose(rpm.get_xlim(), np.asarray([low, high]) / _units.rpm)
        turns = np.asarray([low, high]) / (2.0 * np.pi)
        np.testing.assert_allclose(mesh.get_xlim(), _TEETH * turns / 1e3)


def test_frequencies_are_read_in_hertz_or_kilohertz():
    figure = _of_sweep(_sweep(3, last=500.0, curve=False))[0]
    figure.draw_without_rendering()
    mesh = figure.axes[0].child_axes[1]
    assert mesh.get_xlabel() == "mesh frequency [Hz]"
    assert np.isclose(mesh.get_xlim()[1], _TEETH * 504.0 / (2.0 * np.pi))


# --- What is drawn


def _of_sweep(dataset):
    """The picture of a sweep alone, drawn."""
    (found,) = (each for each in plot.pictures({"sweep": dataset}) if each.name == "sweep")
    return found.draw(), found


def _lines(axes, **wanted):
    """Lines of some look: colour, style or marker."""
    return [
        line
        for line in axes.lines
        if all(getattr(line, f"get_{name}")() == value for name, value in wanted.items())
    ]


def _legend(figure: Figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_unstable_parts_are_dashed_and_stable_ones_solid():
    figure, picture = _drawn("both ways")["sweep"]
    columns = picture.beside["curve"]
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


def test_unstable_responses_are_dashed_and_counted():
    figure, picture = _drawn("unstable")["sweep"]
    (dashed,) = _lines(figure.axes[0], color=GREEN, linestyle="--")
    shown = dashed.get_xdata()[:-1]
    np.testing.assert_array_equal(shown, picture.table["pinion_speed_rad_s"][99:111])
    assert "unstable (10 of 300)" in _legend(figure)


def test_unsettled_responses_are_marked_and_counted():
    figure, picture = _drawn("both ways")["sweep"]
    columns = picture.table
    lost = ~columns["settled"].reshape(2, -1)
    assert f"not converged ({np.count_nonzero(lost)} of 600)" in _legend(figure)
    for axes in figure.axes:
        marked = [line for line in axes.lines if line.get_markeredgecolor() == RED]
        assert sum(np.size(line.get_xdata()) for line in marked) == np.count_nonzero(lost)
        joined = [line for line in axes.lines if line.get_linestyle() == "-"]
        speeds = columns["pinion_speed_rad_s"][: lost.shape[1]][lost[0]]
        for line in joined:
            if line.get_color() != "black":
                assert not np.isin(speeds, line.get_xdata()).any()


def test_unsettled_responses_far_away_do_not_set_the_scale():
    dataset = _sweep(100, curve=False)
    dataset["settled"][0, 50] = False
    dataset["dynamic_ratio"][0, 50] = 1e6
    axes = _of_sweep(dataset)[0].axes[0]
    settled = dataset["dynamic_ratio"].values[dataset["settled"].values]
    assert axes.get_ylim()[1] < 2.0 * np.max(settled)
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
    figure = _of_sweep(dataset)[0]
    assert {"two mesh periods (3)", "more periods (1)"} < set(_legend(figure))
    (two,), (more,) = (_lines(figure.axes[0], marker=marker) for marker in "s^")
    np.testing.assert_array_equal(two.get_xdata(), dataset["speed"].values[10:13])
    np.testing.assert_array_equal(more.get_xdata(), dataset["speed"].values[40:41])


def test_folds_and_leaps_are_where_the_branches_part():
    """Upwards the response leaps at the higher fold, downwards at the lower one."""
    figure, picture = _drawn("both ways")["sweep"]
    columns, folds = picture.table, picture.beside["folds"]["pinion_speed_rad_s"]
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
    dataset["curve_piece"][400:] = 1
    figure, picture = _of_sweep(dataset)
    assert np.count_nonzero(picture.beside["curve"]["piece"] == 0) == 400
    assert len(picture.beside["folds"]["pinion_speed_rad_s"]) == 2
    ends = dataset["curve_speed"].values[399:401]
    for line in _lines(figure.axes[0], color="black"):
        x = np.asarray(line.get_xdata())
        assert not np.any((x[:-1] == ends[0]) & (x[1:] == ends[1]))


def test_lines_at_critical_speeds():
    figure, picture = _drawn("both ways")["sweep"]
    columns = picture.beside["critical"]
    assert list(columns["label"][:3]) == ["mode 4", "mode 4 / 2", "mode 4 / 3"]
    np.testing.assert_allclose(columns["pinion_speed_rad_s"][:3], [1000.0, 500.0, 1000.0 / 3.0])
    inside = columns["pinion_speed_rad_s"] < 2200.0
    shown = np.sort(columns["pinion_speed_rad_s"][inside])
    for axes in figure.axes:
        upright = [line.get_xdata()[0] for line in _lines(axes, linestyle=":")]
        np.testing.assert_array_equal(upright, shown)
    written = {text.get_text() for text in figure.axes[0].texts if text.get_text()}
    assert written == set(columns["label"][inside])


# --- Numbers


def test_tables_of_a_sweep_are_its_data():
    dataset = _sweep(30, ("down", "up"))
    found = {each.name: each for each in plot.pictures({"sweep": dataset})}
    columns = found["sweep"].table
    for direction in ("up", "down"):
        row = columns["direction"] == direction
        np.testing.assert_array_equal(columns["pinion_speed_rad_s"][row], dataset["speed"])
        for name in ("dynamic_ratio", "te_rms_um", "contact_loss", "settled", "stable", "periods"):
            own = dataset[name].sel(direction=direction).values
            np.testing.assert_array_equal(columns[name][row], own)
    curve = found["sweep"].beside["curve"]
    np.testing.assert_array_equal(curve["te_rms_um"], dataset["curve_te_rms_um"].values)
    columns, row = found["waterfall"].table, 7 * dataset.sizes["order"] + 1
    assert len(columns["order"]) == 30 * dataset.sizes["order"]
    speed, own = dataset["speed"].values[7], dataset.sel(direction="down")
    assert (columns["pinion_speed_rad_s"][row], columns["order"][row]) == (speed, 2.0)
    assert np.isclose(columns["frequency_Hz"][row], 2 * 20 * speed / (2 * np.pi))
    assert columns["te_order_um"][row] == own["te_order_um"].values[7, 1]
    columns = found["orders"].beside["bearings"]
    row = (columns["bearing"] == "pinion 1") & (columns["order"] == 2.0)
    force = own["bearing_force_order_N"].sel(bearing="pinion 1", order=2.0)
    np.testing.assert_array_equal(columns["bearing_force_order_N"][row], force.values)
    columns = found["orders"].table
    row, force = columns["order"] == 3.0, own["mesh_force_order_N"].sel(order=3.0)
    np.testing.assert_array_equal(columns["mesh_force_order_N"][row], force.values)
    columns = found["contact_loss"].table
    np.testing.assert_array_equal(
        columns["mesh_force_ratio"], own["mesh_force_ratio"].values.ravel()
    )


def test_share_of_the_time_without_contact():
    """A quarter of the period at one speed, in steps of two sizes, and none at the other."""
    phase = np.concatenate([np.arange(0.0125, 0.5, 0.025), np.arange(0.525, 1.0, 0.05)])
    dataset = _sweep(2, ("up",), curve=False).drop_dims("phase")
    force = np.ones((1, 2, len(phase)))
    force[0, 0, phase < 0.25] = 0.0
    dims = ("direction", "speed", "phase")
    dataset = dataset.assign(mesh_force_ratio=(dims, force), tooth_pairs=(dims, force.astype(int)))
    pictures = plot.pictures({"sweep": dataset.assign_coords(phase=phase)})
    (found,) = (each for each in pictures if each.name == "contact_loss")
    np.testing.assert_allclose(found.beside["shares"]["contact_loss"], [0.25, 0.0], atol=0.01)
    axes = found.draw().axes[0]
    assert axes.get_ylim() == (0.0, 1.0)
    np.testing.assert_allclose(axes.get_xlim(), (100.0, 2200.0))


def test_bars_of_energy_fill_each_row():
    figure, picture = _drawn("modes")["modes"]
    bars = np.asarray([[bar.get_width() for bar in part] for part in figure.axes[0].containers])
    np.testing.assert_allclose(np.sum(bars, axis=0)[1:], 1.0)
    np.testing.assert_array_equal(np.sum(bars, axis=0)[0], 0.0)
    np.testing.assert_allclose(bars[0, 1:], picture.table["energy_mesh"][1:], rtol=1e-9)
    assert list(picture.table["mode"]) == list(range(1, 21))


def _tables_of_campbell(dataset):
    (picture,) = plot.pictures({"campbell": dataset})
    return picture.table, picture.beside["critical"]


def test_crossings_of_straight_lines_are_exact():
    """f = 1000 Hz + a Omega meets h z Omega / 2 pi at 1000 Hz / (h z / 2 pi - a)."""
    speed, slopes = np.linspace(0.0, 700.0, 23), np.asarray([0.0, 0.3, -0.5])
    frequency = 1000.0 + slopes * speed[:, None]
    dataset = _turning(speed, frequency, np.tile(speed[:, None] / 700.0, 3), harmonics=3)
    curves, columns = _tables_of_campbell(dataset)
    mode = columns["mode"].astype(int)
    exact = 1000.0 / (columns["harmonic"] * _TEETH / (2 * np.pi) - slopes[mode - 1])
    assert len(mode) == 9
    np.testing.assert_allclose(columns["pinion_speed_rad_s"], exact, rtol=1e-12)
    expected = 1000.0 + slopes[mode - 1] * exact
    np.testing.assert_allclose(columns["frequency_Hz"], expected, rtol=1e-12)
    np.testing.assert_allclose(columns["mesh_energy"], exact / 700.0, rtol=1e-12)
    second = curves["mode"] == 2
    np.testing.assert_array_equal(curves["frequency_Hz"][second], frequency[:, 1])
    np.testing.assert_array_equal(curves["pinion_speed_rad_s"][second], speed)


def test_free_rotation_crosses_nothing():
    dataset = _campbell(5, 2, energy=False)
    dataset["frequency_Hz"][:, 0] = 0.0
    assert 1.0 not in _tables_of_campbell(dataset)[1]["mode"]


def test_an_orbit_lasts_as_long_as_its_numbers():
    figure, picture = _drawn("two speeds")["orbit"]
    rising = picture.table["branch"] == "speed rising"
    assert np.count_nonzero(rising) == 64
    assert np.count_nonzero(~rising) == 128
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles[2] == "repeats every mesh period, stable"
    assert titles[3] == "repeats every 2 mesh periods, stable"
    force = picture.table["mesh_force_ratio"][rising]
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
    np.testing.assert_allclose(apart(places, 3.0, -10.0, 30.0), [0.0, 3.0, 6.0, 20.0])
    np.testing.assert_allclose(apart(places, 50.0, 0.0, 30.0), [0.0, 10.0, 20.0, 30.0])
    np.testing.assert_allclose(apart(places, 3.0, 0.0, 18.0)[-1], 18.0)


def test_runs_of_equal_values():
    kinds = np.asarray([1, 1, 2, 0, 0])
    assert list(runs(kinds)) == [(1, 0, 1), (2, 2, 2), (0, 3, 4)]
    assert list(runs(kinds[:0])) == []


def test_labels_do_not_depend_on_when_they_are_drawn():
    (picture,) = plot.pictures({"campbell": _campbell(2, 3)})
    figures = [picture.draw(), picture.draw()]
    first, second = (
        [(text.get_text(), text.get_position()) for text in figure.axes[0].texts]
        for figure in figures
    )
    assert first == second


def test_flags_may_come_from_a_file():
    """Files hold flags as whole numbers, of which `~` makes others."""
    dataset = _sweep(30, ("up",), curve=False)
    dataset["settled"][0, 4] = False
    numbers = dataset.assign({name: dataset[name].astype("int8") for name in ("settled", "stable")})
    legends = [_legend(_of_sweep(each)[0]) for each in (dataset, numbers)]
    assert legends[0] == legends[1]
    assert legends[0][0] == WAYS["up"]
    assert "not converged (1 of 30)" in legends[0]
