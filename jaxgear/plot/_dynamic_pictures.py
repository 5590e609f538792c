"""The pictures of dynamics: sweeps, orders, contact loss, modes and orbits.

As in `_pictures`, each is a function from plain arrays or a dataset to a figure; `_dynamic_tables`
gives its data. Speeds are those of the pinion.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import offset_copy
from numpy.typing import ArrayLike

import jaxgear as jg
from jaxgear.plot._dynamic_tables import (
    _FEW,
    _NO_FORCE,
    _ORDER_PANELS,
    _QUANTITIES,
    _bearing_names,
    _branch,
    _folds,
    _leaps,
    _orders_of,
    contact_shares_columns,
    crossing_columns,
)
from jaxgear.plot._labels import Label, text_size, write_labels
from jaxgear.plot._palette import _BLUE, _GREEN, _GREY, _ORANGE, _RED, _SKY, PURPLE, SERIES
from jaxgear.plot._pictures import _BOX, _SURFACE, _digits, _house_look, _panels, lay_out
from jaxgear.plot._tables import _cycle_periods, _shares

# --- What the pictures share


def _stack(
    size: tuple[float, float], title: str, ratios: Sequence[float]
) -> tuple[Figure, list[Axes]]:
    """A figure with a column of axes over the same speeds."""
    figure = Figure(figsize=size)
    figure.set_layout_engine("constrained", hspace=0.03)
    axes = figure.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)
    figure.suptitle(title)
    return figure, list(axes[:, 0])


# Height of an axis with its ticks and its label [points].
_AXIS_HEIGHT = 35.0


def _speed_axes(axes: Sequence[Axes], speed: np.ndarray, teeth: int) -> None:
    """Pinion speed in rad/s below the last axes; in rpm and as mesh frequency above the first."""
    top, bottom = axes[0], axes[-1]
    low, high = float(np.min(speed)), float(np.max(speed))
    room = 0.01 * (high - low) if high > low else 0.05 * high
    bottom.set(xlabel="pinion speed [rad/s]", xlim=(low - room, high + room))
    figure = top.get_figure(root=True)
    assert figure is not None
    frequency, unit = _frequency_unit(teeth * high / (2.0 * np.pi))
    scales = {
        "pinion speed [rpm]": 1.0 / jg.rpm,
        f"mesh frequency [{unit}]": teeth / (2.0 * np.pi * frequency),
    }
    for row, (label, scale) in enumerate(scales.items()):
        above = top.secondary_xaxis(
            1.0,
            functions=_scaled(scale),
            transform=offset_copy(top.transAxes, figure, 0.0, row * _AXIS_HEIGHT, "points"),
        )
        above.set_xlabel(label, labelpad=4.0)
        above.tick_params(pad=2.0)


def _scaled(scale: float) -> tuple[Callable[[ArrayLike], Any], Callable[[ArrayLike], Any]]:
    """To a second axis and back."""
    return lambda x: scale * np.asarray(x), lambda x: np.asarray(x) / scale


def _frequency_unit(highest_Hz: float) -> tuple[float, str]:
    """The unit in which frequencies up to this one are read, in Hz, and its name."""
    return (1e3, "kHz") if highest_Hz >= 2e3 else (1.0, "Hz")


def _runs(kind: np.ndarray) -> Iterator[tuple[Any, int, int]]:
    """Kind, first and last place of each run of equal values."""
    edges = np.nonzero(kind[1:] != kind[:-1])[0] + 1
    starts, ends = [0, *edges], [*edges, len(kind)]
    for start, end in zip(starts, ends, strict=True):
        if end > start:
            yield kind[start], int(start), int(end) - 1


def _edges(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Edges of the cells around rising values: half-way between them, and both ends."""
    return np.concatenate([[low], 0.5 * (values[:-1] + values[1:]), [high]])


def _speed_edges(speed: np.ndarray) -> np.ndarray:
    """Edges of cells around speeds, from the first to the last; around a single one 5%."""
    room = 0.05 * speed[0] if len(speed) == 1 else 0.0
    return _edges(speed, float(speed[0] - room), float(speed[-1] + room))


def _apart(places: np.ndarray, distance: float, low: float, high: float) -> np.ndarray:
    """Rising places moved as little as possible so that neighbours are a distance apart.

    Least squares under `moved[i + 1] - moved[i] >= distance`: pools of neighbours that push each
    other share their mean. They stay between `low` and `high`; where there is no room for all, the
    distance shrinks.
    """
    if not len(places):
        return places
    distance = min(distance, (high - low) / max(len(places) - 1, 1))
    shift = distance * np.arange(len(places))
    pools: list[list[float]] = []
    for value in places - shift:
        pools.append([value, 1.0])
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (a, m), (b, n) = pools[-2:]
            pools[-2:] = [[(a * m + b * n) / (m + n), m + n]]
    level = np.concatenate([np.full(int(count), mean) for mean, count in pools])
    return np.clip(level, low, high - shift[-1]) + shift


# --- The sweep

_DIRECTIONS = {"up": _BLUE, "down": _ORANGE, "cold": _GREEN}


@_house_look()
def sweep(dataset: xr.Dataset, title: str, critical: Sequence[tuple[float, str]] = ()) -> Figure:
    """Dynamic ratio, RMS of the TE and contact loss over pinion speed, for each direction.

    Lines join settled responses; unstable parts are dashed, also those of a continuation curve,
    whose turning points are marked as folds. Where a direction leaps, an arrow says which way.

    **Arguments:**

    - `dataset`: over direction ("up", "down" or "cold") and rising speed [rad/s]: `dynamic_ratio`
        and `te_rms_um`, and as far as they are known `contact_loss` (share of the time), the flags
        `settled` and `stable`, and `periods`, after which the response repeats. A continuation
        curve over point may be added: `curve_speed`, `curve_dynamic_ratio`, `curve_te_rms_um` and
        `curve_stable`; a point that is not finite ends a piece. `attrs["teeth_pinion"]`.
    - `title`: the case or the finding.
    - `critical`: pinion speeds [rad/s] to be marked, with what is critical there.

    **Returns:**

    The figure.
    """
    loss = dataset.get("contact_loss")
    loses = loss is not None and bool(np.any(loss.values > 0.0))
    ratios = (3.0, 1.8, 1.0) if loses else (3.0, 1.7)
    figure, panels = _stack((9.6, 7.0 if loses else 5.8), f"Speed sweep: {title}", ratios)
    for axes, name in zip(panels, _QUANTITIES, strict=False):
        _draw_directions(axes, dataset, name)
    panels[0].set_ylabel("largest mesh force / static [-]")
    panels[0].axhline(1.0, color=_GREY, lw=0.8, ls="--", zorder=1)
    panels[1].set_ylabel("RMS of the TE [µm]")
    if loses:
        panels[2].set_ylabel("no contact\n[% of time]")
    _speed_axes(panels, dataset["speed"].values, int(dataset.attrs["teeth_pinion"]))
    handles = _sweep_legend(dataset)
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    figure.align_ylabels(panels)
    low, high = panels[0].get_xlim()
    shown = sorted((speed, label) for speed, label in critical if low <= speed <= high)
    for axes in panels[1:]:
        for speed, _ in shown:
            axes.axvline(speed, **_CRITICAL)
    if shown:
        _write_critical(panels[0], shown)
    for axes, name in zip(panels, _QUANTITIES, strict=False):
        _draw_leaps(axes, dataset, name)
    return figure


def _draw_directions(axes: Axes, dataset: xr.Dataset, name: str) -> None:
    """One quantity over speed: directions, continuation curve, folds, and what is not settled."""
    speed = dataset["speed"].values
    scale = 100.0 if name == "contact_loss" else 1.0
    directions = [str(x) for x in dataset["direction"].values]
    top = _ceiling(dataset, name) * scale
    # The first direction lies on top; where both agree, the other is seen on either side of it.
    for row, direction in reversed(list(enumerate(directions))):
        own = dataset.sel(direction=direction)
        values, colour = scale * own[name].values, _DIRECTIONS.get(direction, SERIES[row])
        shown = _flag(own, "settled") & np.isfinite(values)
        style: dict[str, Any] = {"color": colour, "lw": 2.0 + 2.4 * row, "zorder": 2.5 - 0.1 * row}
        style["alpha"] = 1.0 if row == 0 else 0.75
        _draw_parts(axes, speed, values, shown, _flag(own, "stable"), style)
        if len(speed) <= _FEW:
            axes.plot(speed[shown], values[shown], "o", ms=3.5 + row, color=colour, zorder=2.6)
        for marker, several in _several_periods(own):
            marked = shown & several
            look = {"marker": marker, "ms": 4.5 + row, "color": colour, "zorder": 2.7}
            _mark(axes, speed[marked], values[marked], {**_HOLLOW, **look})
        lost, known = ~_flag(own, "settled"), np.isfinite(values)
        place = np.minimum(values, 0.97 * top)
        _mark(axes, speed[lost & known], place[lost & known], _UNSETTLED)
        nowhere = np.full(np.count_nonzero(~known), 0.03 * top)
        _mark(axes, speed[~known], nowhere, _UNKNOWN)
    if f"curve_{name}" in dataset:
        _draw_curve(axes, dataset, f"curve_{name}")
    axes.set_ylim(0.0, top)


def _mark(axes: Axes, x: np.ndarray, y: np.ndarray, style: Mapping[str, Any]) -> None:
    """Markers that the edge of the axes does not cut."""
    # Without any, what is not clipped has no extent, and the layout fails.
    if len(x):
        axes.plot(x, y, clip_on=False, **style)


_HOLLOW: dict[str, Any] = {"ls": "", "mfc": "white"}
_UNSETTLED: dict[str, Any] = {"marker": "o", "ls": "", "ms": 5, "mfc": "none", "mec": _RED}
_UNSETTLED |= {"mew": 1.2, "zorder": 3.0}
_UNKNOWN: dict[str, Any] = {**_UNSETTLED, "marker": "x"}
_MARKERS = {2: "s", 3: "^"}
_FOLD: dict[str, Any] = {"marker": "D", "ls": "", "ms": 4.5, "color": "black", "zorder": 3.2}


def _flag(dataset: xr.Dataset, name: str) -> np.ndarray:
    """A flag of each response, true where it is missing. Files hold flags as whole numbers."""
    if name in dataset:
        return dataset[name].values.astype(bool)
    like = "curve_speed" if name.startswith("curve") else "dynamic_ratio"
    return np.ones(dataset[like].shape if like in dataset else dataset["speed"].shape, bool)


def _several_periods(dataset: xr.Dataset) -> list[tuple[str, np.ndarray]]:
    """Marker and places of responses of period two, and of longer ones."""
    like = np.ones(dataset["dynamic_ratio"].shape, int)
    periods = dataset["periods"].values if "periods" in dataset else like
    return [(_MARKERS[2], periods == 2), (_MARKERS[3], periods >= 3)]


def _ceiling(dataset: xr.Dataset, name: str) -> float:
    """Upper limit of an axis, from unsettled responses only where nothing settled."""
    values = dataset[name].values
    finite = np.isfinite(values)
    chosen = values[finite & _flag(dataset, "settled")]
    if not len(chosen):
        chosen = values[finite]
    most = [float(np.max(chosen, initial=0.0))]
    if f"curve_{name}" in dataset:
        most.append(float(np.nanmax(dataset[f"curve_{name}"].values, initial=0.0)))
    return 1.08 * max(*most, 1e-9, 1.0 if name == "dynamic_ratio" else 0.0)


def _draw_parts(
    axes: Axes,
    x: np.ndarray,
    y: np.ndarray,
    shown: np.ndarray,
    stable: np.ndarray,
    style: Mapping[str, Any],
) -> None:
    """A line through the shown points: dashed where it is not stable at both ends."""
    kind = np.where(shown[1:] & shown[:-1], np.where(stable[1:] & stable[:-1], 1, 2), 0)
    paths: dict[int, list[np.ndarray]] = {1: [], 2: []}
    for which, first, last in _runs(kind):
        if which:
            part = np.stack([x[first : last + 2], y[first : last + 2]], axis=1)
            paths[int(which)] += [part, np.full((1, 2), np.nan)]
    for which, dashes in ((1, "-"), (2, (0, (4, 2)))):
        if paths[which]:
            axes.plot(*np.concatenate(paths[which]).T, ls=dashes, **style)
    held = np.concatenate([[0], kind]) + np.concatenate([kind, [0]])
    alone = shown & (held == 0)
    look = {"color": style["color"], "zorder": style["zorder"]}
    axes.plot(x[alone], y[alone], "o", ms=3.0, **look)


def _draw_curve(axes: Axes, dataset: xr.Dataset, name: str) -> None:
    """The continuation curve with its folds."""
    speed, values = dataset["curve_speed"].values, dataset[name].values
    shown = np.isfinite(speed) & np.isfinite(values)
    style = {"color": "black", "lw": 0.8, "zorder": 2.9}
    _draw_parts(axes, speed, values, shown, _flag(dataset, "curve_stable"), style)
    folds = _folds(dataset)
    axes.plot(speed[folds], values[folds], **_FOLD)


def _sweep_legend(dataset: xr.Dataset) -> list[Line2D]:
    """What the lines and markers mean, with the number of those that are not as they should be."""
    handles = []
    directions = [str(x) for x in dataset["direction"].values]
    names = {"up": "speed rising", "down": "speed falling", "cold": "each speed by itself"}
    for row, direction in enumerate(directions):
        colour = _DIRECTIONS.get(direction, SERIES[row])
        label = names.get(direction, direction)
        handles.append(Line2D([], [], color=colour, lw=2.0 + 2.4 * row, label=label))
    settled = _flag(dataset, "settled")
    unstable = settled & ~_flag(dataset, "stable")
    dashed = {"ls": (0, (4, 2)), "lw": 1.1}
    if np.any(unstable):
        label = f"unstable ({np.count_nonzero(unstable)} of {unstable.size})"
        handles.append(Line2D([], [], color=_GREY, label=label, **dashed))
    if "curve_speed" in dataset:
        handles.append(Line2D([], [], color="black", lw=0.8, label="continuation, stable"))
        if not np.all(_flag(dataset, "curve_stable")):
            label = "continuation, unstable"
            handles.append(Line2D([], [], color="black", label=label, **dashed))
        if len(_folds(dataset)):
            handles.append(Line2D([], [], label=f"fold ({len(_folds(dataset))})", **_FOLD))
    names = ("two mesh periods", "more periods")
    for name, (marker, several) in zip(names, _several_periods(dataset), strict=True):
        count = np.count_nonzero(several & settled)
        if count:
            style: dict[str, Any] = {"marker": marker, "ls": "", "ms": 4.5, "mfc": "white"}
            handles.append(Line2D([], [], mec=_GREY, label=f"{name} ({count})", **style))
    if not np.all(settled):
        label = f"not settled ({np.count_nonzero(~settled)} of {settled.size})"
        handles.append(Line2D([], [], label=label, **_UNSETTLED))
    unknown = ~np.isfinite(dataset["dynamic_ratio"].values)
    if np.any(unknown):
        label = f"no number ({np.count_nonzero(unknown)} of {unknown.size})"
        handles.append(Line2D([], [], label=label, **_UNKNOWN))
    return handles


def _draw_leaps(axes: Axes, dataset: xr.Dataset, name: str) -> None:
    """An arrow half-way along each leap, in the direction in which it is passed."""
    speed, scale = dataset["speed"].values, 100.0 if name == "contact_loss" else 1.0
    height = scale * _ceiling(dataset, name)
    if len(speed) <= _FEW:
        return
    for direction, ahead in (("up", 1), ("down", -1)):
        if direction not in dataset["direction"].values:
            continue
        own = dataset.sel(direction=direction)
        values = scale * own[name].values
        for place in _leaps(values, _flag(own, "settled"), height):
            ends = np.stack([speed[place : place + 2], values[place : place + 2]], axis=1)[::ahead]
            head: dict[str, Any] = {
                "arrowstyle": "-|>",
                "color": _DIRECTIONS[direction],
                "mutation_scale": 17,
            }
            axes.annotate(
                "",
                tuple(ends[0] + 0.7 * (ends[1] - ends[0])),
                xytext=tuple(ends[0]),
                arrowprops={**head, "lw": 0.0, "shrinkA": 0.0, "shrinkB": 0.0},
                zorder=3.3,
            )


_CRITICAL: dict[str, Any] = {"color": _GREY, "lw": 0.8, "ls": ":", "zorder": 0.5}


def _write_critical(axes: Axes, shown: Sequence[tuple[float, str]]) -> None:
    """Lines at critical speeds, their labels upright in a strip above the curves, side by side."""
    low, high = axes.get_xlim()
    look: dict[str, Any] = {"fontsize": 8.5, "rotation": 90.0, "color": _GREY, "zorder": 4}
    sizes = np.asarray([text_size(axes, label, look) for _, label in shown])
    figure = axes.get_figure(root=True)
    assert figure is not None
    lay_out(figure)
    box = axes.get_window_extent()
    width, height = (72.0 / figure.dpi * x for x in (box.width, box.height))
    # Lines lead from their speeds to their labels over this height [points].
    slope, tallest, thick = 9.0, float(np.max(sizes[:, 1])), float(np.max(sizes[:, 0]))
    strip = min((tallest + slope + 5.0) / height, 0.45)
    top = axes.get_ylim()[1]
    axes.set_yticks([tick for tick in axes.get_yticks() if tick <= top])
    axes.set_ylim(0.0, top / (1.0 - strip))
    scale = (high - low) / width
    speeds = np.asarray([speed for speed, _ in shown])
    room = 0.5 * scale * thick
    places = _apart(speeds, scale * (thick + 1.0), low + room, high - room)
    base = 1.0 - (tallest + 3.0) / height
    transform = axes.get_xaxis_transform()
    for (speed, label), place in zip(shown, places, strict=True):
        ends = [base - slope / height, base - 2.0 / height]
        axes.axvline(speed, 0.0, ends[0], **_CRITICAL)
        axes.plot([speed, place], ends, color=_GREY, lw=0.8, transform=transform, zorder=3.9)
        axes.text(place, base, label, ha="center", va="bottom", transform=transform, **look)


# --- Orders


@_house_look()
def waterfall(dataset: xr.Dataset, title: str, natural: Sequence[tuple[float, str]] = ()) -> Figure:
    """Amplitude of the dynamic TE over frequency and pinion speed: one ray for each order.

    **Arguments:**

    - `dataset`: `te_order_um` over rising speed [rad/s] and order of the mesh frequency, zero to
        peak; a `settled` flag over speed may be added. `attrs["teeth_pinion"]`.
    - `title`: the case or the finding.
    - `natural`: natural frequencies [Hz] to be marked, with their names.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((9.6, 6.2), f"Spectrum of the TE over speed: {title}")
    speed, order, amplitude = _orders_of(dataset, "te_order_um")
    mesh = float(dataset.attrs["teeth_pinion"]) * speed / (2.0 * np.pi)
    most = max(float(np.max(amplitude, initial=0.0)), 1e-12)
    norm = LogNorm(most * _FLOOR, most)
    colours = _dark_where_large()
    reach = _highest_frequency(mesh, order, amplitude / most)
    unit, name = _frequency_unit(reach)
    edges = _speed_edges(speed)
    bottom, top = float(edges[0]), float(edges[-1])
    # One stretch of ray for each speed, as wide as it is strong.
    for row in np.argsort(np.max(amplitude, axis=0)):
        size = np.clip(amplitude[:, row], most * _FLOOR, None)
        ends = order[row] * np.interp(edges, speed, mesh) / unit
        ends[[0, -1]] = order[row] * mesh[0] / speed[0] * edges[[0, -1]] / unit
        points = np.stack([ends, edges], axis=1)
        heard = amplitude[:, row] > most * _FLOOR
        # They overlap a little, or the page shines through between them.
        share = np.minimum(0.2, 0.002 * (top - bottom) / np.diff(edges))
        stretch = points[:-1] - share[:, None] * np.diff(points, axis=0), points[1:]
        axes.plot(ends, edges, color="#b5b5b5", lw=0.5, zorder=1.0)
        rays = LineCollection(
            list(np.stack(stretch, axis=1)[heard]),
            array=size[heard],
            norm=norm,
            cmap=colours,
            linewidths=1.0 + 6.0 * (1.0 - np.log(size[heard] / most) / np.log(_FLOOR)),
            capstyle="butt",
            zorder=2.0,
        )
        rays.set_rasterized(True)
        axes.add_collection(rays)
    axes.set(
        xlim=(0.0, reach / unit),
        ylim=(bottom, top),
        xlabel=f"frequency [{name}]",
        ylabel="pinion speed [rad/s]",
    )
    rpm = axes.secondary_yaxis("right", functions=_scaled(1.0 / jg.rpm))
    rpm.set_ylabel("pinion speed [rpm]")
    bar = figure.colorbar(
        ScalarMappable(norm, colours), ax=axes, label="amplitude of the TE [µm]", pad=0.02
    )
    bar.ax.grid(False)
    _write_orders(axes, order, mesh[-1] / speed[-1] / unit)
    _mark_natural(axes, natural, unit)
    unsettled = _mark_unsettled(axes, dataset, upright=True)
    if unsettled:
        figure.legend(handles=unsettled, loc="outside lower center", frameon=False)
    return figure


# Amplitudes below this share of the largest are left out.
_FLOOR = 1e-3


def _dark_where_large() -> Colormap:
    """Colours that end in black, and begin dark enough to be seen on white."""
    return ListedColormap(matplotlib.colormaps["magma_r"](np.linspace(0.12, 1.0, 256)))


def _highest_frequency(mesh: np.ndarray, order: np.ndarray, relative: np.ndarray) -> float:
    """Where the picture ends: beyond the last amplitude of 1% of the largest [Hz]."""
    frequency = mesh[:, None] * order
    heard = np.max(frequency[relative > 0.01], initial=0.0)
    every = float(np.max(frequency))
    return min(every, max(1.05 * heard, min(3.0 * float(mesh[-1]), every)))


def _write_orders(axes: Axes, order: np.ndarray, slope: float) -> None:
    """The number of each order at the end of its ray, above or at the right of the axes."""
    (_, right), (_, top) = axes.get_xlim(), axes.get_ylim()
    figure = axes.get_figure(root=True)
    assert figure is not None
    lay_out(figure)
    scale = 72.0 / figure.dpi
    last = np.full(2, np.inf)
    for value in order:
        end = min(slope * value * top, right), min(top, right / (slope * value))
        above = slope * value * top <= right
        place = scale * axes.transData.transform(end)
        text = f"{value:.3g}"
        if np.hypot(*(place - last)) < (8.0 + 5.0 * len(text) if above else 12.0):
            continue
        last = place
        axes.annotate(
            text,
            end,
            xytext=(0, 2) if above else (-3, 0),
            textcoords="offset points",
            ha="center" if above else "right",
            va="bottom" if above else "center",
            fontsize=8.5,
            color=_GREY,
            bbox=None if above else {**_BOX, "alpha": 1.0},
            zorder=4,
        )
    axes.set_title("orders of the mesh frequency", loc="left", fontsize=9, color=_GREY, pad=14)


def _mark_natural(axes: Axes, natural: Sequence[tuple[float, str]], unit: float) -> None:
    """Upright lines at natural frequencies, with their names at the head of the axes."""
    right = axes.get_xlim()[1]
    for frequency, name in natural:
        if not 0.0 < frequency / unit < right:
            continue
        axes.axvline(frequency / unit, color=_BLUE, lw=0.9, ls=(0, (4, 2)), zorder=3.0)
        axes.annotate(
            name,
            (frequency / unit, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, -4),
            textcoords="offset points",
            rotation=90,
            ha="center",
            va="top",
            fontsize=8.5,
            color=_BLUE,
            bbox={**_BOX, "alpha": 1.0},
            zorder=5,
        )


def _mark_unsettled(axes: Axes, dataset: xr.Dataset, *, upright: bool) -> list[Line2D]:
    """Red marks along the axis of speed where a response did not settle; none or one line."""
    lost = ~_flag(dataset, "settled")
    if not np.any(lost):
        return []
    speed = dataset["speed"].values[lost]
    style: dict[str, Any] = {"ls": "", "color": _RED, "ms": 8, "mew": 1.6, "clip_on": False}
    style["label"] = f"not settled ({len(speed)} of {len(lost)})"
    if upright:
        place, transform = (np.full(len(speed), 0.008), speed), axes.get_yaxis_transform()
    else:
        place, transform = (speed, np.full(len(speed), 0.985)), axes.get_xaxis_transform()
    return axes.plot(*place, "_" if upright else "|", transform=transform, zorder=6, **style)


_ORDERS_SHOWN = 5
# Of orders between those of the mesh as many as there are dotted lines to tell apart.
_BETWEEN = (":", (0, (5, 1, 1, 1)), (0, (5, 1, 1, 1, 1, 1)))


@_house_look()
def orders(dataset: xr.Dataset, title: str) -> Figure:
    """Amplitudes of the first orders over pinion speed: TE, mesh force and bearing forces.

    Orders between those of the mesh, which a response over several mesh periods has, are dotted.

    **Arguments:**

    - `dataset`: over rising speed [rad/s] and order of the mesh frequency, zero to peak:
        `te_order_um`, `mesh_force_order_N` and, over bearing too, `bearing_force_order_N`; what is
        missing is left out. A `settled` flag over speed may be added. `attrs["teeth_pinion"]`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    has_bearings = dataset.sizes.get("bearing", 0) > 0
    names = [
        name
        for name in _ORDER_PANELS
        if name in dataset and (has_bearings or name != "bearing_force_order_N")
    ]
    figure, panels = _stack(
        (9.6, 1.8 + 2.1 * len(names)), f"Orders over speed: {title}", [1.0] * len(names)
    )
    for axes, name in zip(panels, names, strict=True):
        if name == "bearing_force_order_N":
            most = _draw_bearing_orders(axes, dataset)
        else:
            most = _draw_orders(axes, dataset, name)
        axes.set_ylabel(_ORDER_PANELS[name])
        if most > 0.0:
            axes.set(yscale="log", ylim=(2e-4 * most, 1.8 * most))
        else:
            axes.set_ylim(0.0, 1.0)
        axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.0), borderaxespad=0, frameon=False)
    figure.align_ylabels(panels)
    _speed_axes(panels, dataset["speed"].values, int(dataset.attrs["teeth_pinion"]))
    unsettled = _mark_unsettled(panels[0], dataset, upright=False)
    if unsettled:
        figure.legend(handles=unsettled, loc="outside lower center", frameon=False)
    return figure


def _is_whole(order: float) -> bool:
    return bool(abs(order - round(order)) < 1e-9)


def _draw_orders(axes: Axes, dataset: xr.Dataset, name: str) -> float:
    """The first orders of one quantity, and the largest amplitude."""
    speed, order, amplitude = _orders_of(dataset, name)
    most = float(np.max(amplitude, initial=0.0))
    colours, dots = itertools.cycle(SERIES), itertools.cycle(_BETWEEN)
    between = [x for x in range(len(order)) if not _is_whole(order[x])]
    strongest = sorted(between, key=lambda x: -float(np.max(amplitude[:, x])))[: len(_BETWEEN)]
    for row, (value, column) in enumerate(zip(order, amplitude.T, strict=True)):
        whole = _is_whole(value)
        heard = row in strongest and np.max(column) > 0.01 * most
        if not (whole and value <= _ORDERS_SHOWN) and not heard:
            continue
        colour = next(colours) if whole else _GREY
        style: dict[str, Any] = {"lw": 1.4 if whole else 1.1, "marker": _dots(speed), "ms": 3}
        style["ls"] = "-" if whole else next(dots)
        label = f"order {value:.3g}"
        axes.plot(speed, _seen(column, most), color=colour, label=label, **style)
    return most


def _draw_bearing_orders(axes: Axes, dataset: xr.Dataset) -> float:
    """The first two whole orders of each bearing's force, and the largest amplitude."""
    most = 0.0
    for row, name in enumerate(_bearing_names(dataset)):
        own = dataset.isel(bearing=row)
        speed, order, amplitude = _orders_of(own, "bearing_force_order_N")
        colour = SERIES[row % len(SERIES)]
        most = max(most, float(np.max(amplitude, initial=0.0)))
        for value, style in ((1.0, "-"), (2.0, (0, (4, 2)))):
            for column in amplitude.T[np.isclose(order, value)]:
                label = f"{name}" if value == 1.0 else None
                axes.plot(
                    speed,
                    _seen(column, float(np.max(amplitude))),
                    color=colour,
                    ls=style,
                    lw=1.4 if value == 1.0 else 1.0,
                    label=label,
                    marker=_dots(speed),
                    ms=3,
                )
    for value, style in ((1, "-"), (2, (0, (4, 2)))):
        axes.plot([], [], color=_GREY, ls=style, label=f"order {value}")
    return most


def _dots(speed: np.ndarray) -> str:
    """Marker of a line over these speeds: none where they are many."""
    return "o" if len(speed) <= _FEW else ""


def _seen(values: np.ndarray, most: float) -> np.ndarray:
    """Amplitudes without those that a logarithmic axis cannot show."""
    return np.where(values > 1e-12 * most, values, np.nan)


# --- Loss of contact


@_house_look()
def contact_loss(dataset: xr.Dataset, title: str) -> Figure:
    """Mesh force over pinion speed and mesh phase, where the teeth part, and for how long.

    **Arguments:**

    - `dataset`: `mesh_force_ratio`, the mesh force over the static one, over rising speed [rad/s]
        and rising phase [mesh periods]; the number of `tooth_pairs` that carry and a `settled` flag
        over speed may be added. `attrs["teeth_pinion"]`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    has_pairs = "tooth_pairs" in dataset
    ratios = (3.0, 1.8, 1.0) if has_pairs else (3.0, 1.0)
    figure, panels = _stack(
        (9.6, 7.6 if has_pairs else 5.8), f"Contact over speed and phase: {title}", ratios
    )
    speed, phase = dataset["speed"].values, dataset["phase"].values
    force = dataset["mesh_force_ratio"].transpose("speed", "phase").values
    periods = _cycle_periods(phase) if len(phase) > 1 else 1
    edges = _speed_edges(speed), _edges(phase, 0.0, float(periods))
    apart = force <= _NO_FORCE
    colours = matplotlib.colormaps[_SURFACE].with_extremes(bad="#bdbdbd")
    norm = Normalize(0.0, max(1.0, float(np.nanmax(force, initial=0.0))))
    surface = panels[0].pcolormesh(
        *edges,
        np.ma.masked_invalid(np.where(apart, np.nan, force)).T,
        cmap=colours.with_extremes(bad="white"),
        norm=norm,
        rasterized=True,
    )
    figure.colorbar(surface, ax=panels[0], label="mesh force / static [-]", pad=0.01)
    _outline_loss(panels[0], speed, phase, apart)
    panels[0].set_ylabel("mesh phase [mesh periods]")
    if has_pairs:
        _draw_pairs(panels[1], dataset, edges)
    share = contact_shares_columns(dataset)["contact_loss"]
    panels[-1].fill_between(speed, 0.0, 100.0 * share, color=_RED, alpha=0.3, lw=0)
    panels[-1].plot(speed, 100.0 * share, color=_RED, lw=1.2, marker=_dots(speed), ms=3)
    most = 100.0 * float(np.max(share, initial=0.0))
    panels[-1].set(ylabel="no contact\n[% of time]", ylim=(0.0, max(1.1 * most, 1.0)))
    for axes in panels[:-1]:
        axes.grid(False)
        axes.set_ylim(0.0, periods)
    _speed_axes(panels, speed, int(dataset.attrs["teeth_pinion"]))
    panels[-1].set_xlim(edges[0][0], edges[0][-1])
    figure.align_ylabels(panels)
    handles: list[Any] = _mark_unsettled(panels[0], dataset, upright=False)
    if np.any(apart):
        handles.append(Patch(fc="white", ec=_RED, lw=1.4, label="teeth apart: no mesh force"))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _outline_loss(axes: Axes, speed: np.ndarray, phase: np.ndarray, apart: np.ndarray) -> None:
    """The line around the places where the teeth are apart."""
    if min(apart.shape) > 1 and np.any(apart) and not np.all(apart):
        axes.contour(
            speed, phase, apart.T.astype(float), levels=[0.5], colors=[_RED], linewidths=1.1
        )


def _draw_pairs(axes: Axes, dataset: xr.Dataset, edges: tuple[np.ndarray, np.ndarray]) -> None:
    """How many tooth pairs carry, over speed and phase."""
    pairs = dataset["tooth_pairs"].transpose("speed", "phase").values
    most = max(int(np.nanmax(pairs, initial=0.0)), 2)
    shades = matplotlib.colormaps["Blues"](np.linspace(0.25, 0.75, most))
    colours = ListedColormap([(1.0, 1.0, 1.0, 1.0), *map(tuple, shades)])
    surface = axes.pcolormesh(
        *edges,
        np.ma.masked_invalid(pairs).T,
        cmap=colours,
        vmin=-0.5,
        vmax=most + 0.5,
        rasterized=True,
    )
    figure = axes.get_figure(root=True)
    assert figure is not None
    bar = figure.colorbar(surface, ax=axes, label="tooth pairs [-]", pad=0.01)
    bar.set_ticks(list(range(most + 1)))
    bar.ax.minorticks_off()
    axes.set_ylabel("mesh phase\n[mesh periods]")


# --- Modes

_PARTS = {
    "mesh": (_BLUE, ""),
    "pinion": (_ORANGE, "///"),
    "wheel": (_GREEN, "\\\\\\"),
    "shafts": (_SKY, "..."),
    "bearings": (PURPLE, "xxx"),
}
_MODES_SHOWN = 40


@_house_look()
def modes(dataset: xr.Dataset, title: str) -> Figure:
    """Where each mode stores its strain energy, one bar per mode with its natural frequency.

    **Arguments:**

    - `dataset`: `frequency_Hz` over mode, `energy` over mode and part, the shares of the strain
        energy; `damping_ratio`, `gear` and `nodal_diameter` over mode may be added. Frequency zero
        is a motion that nothing holds, and has no energy.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    every = dataset.sizes["mode"]
    count = min(_MODES_SHOWN, every)
    figure, (axes,) = _panels(
        (8.4, max(3.4, 2.0 + 0.27 * count)), f"Natural modes and their energy: {title}"
    )
    frequency = dataset["frequency_Hz"].values[:count]
    energy = np.nan_to_num(dataset["energy"].transpose("mode", "part").values[:count])
    place, left = np.arange(1, count + 1), np.zeros(count)
    spare = itertools.cycle([("black", ""), (_RED, "ooo"), ("#b5b5b5", "---")])
    handles = []
    for part, share in zip(dataset["part"].values, energy.T, strict=True):
        colour, hatch = _PARTS.get(str(part)) or next(spare)
        # Hatching tells parts apart without colour.
        look = {"fc": colour, "hatch": hatch, "ec": "white", "lw": 0.0}
        axes.barh(place, share, left=left, height=0.74, **look)
        handles.append(Patch(label=str(part), **look))
        left = left + share
    free = frequency <= 1e-6 * np.max(frequency, initial=0.0)
    for row in np.nonzero(free)[0]:
        axes.text(0.01, place[row], "turns freely", va="center", color=_GREY, fontsize=8.5)
    names = [f"{n}:  {_frequency_text(f)}" for n, f in zip(place, frequency, strict=True)]
    waves = "nodal_diameter" in dataset
    if waves:
        leads = zip(dataset["gear"].values, dataset["nodal_diameter"].values, strict=True)
        names = [f"{gear} {n} ND   {name}" for name, (gear, n) in zip(names, leads, strict=False)]
    axes.set_yticks(place, names)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.set(
        xlim=(0.0, 1.0),
        ylim=(count + 0.6, 0.4),
        xlabel="share of the strain energy [-]",
        ylabel=f"{'leading wave, ' * waves}mode and natural frequency [Hz]",
    )
    if "damping_ratio" in dataset:
        _write_damping(axes, dataset["damping_ratio"].values[:count], ~free)
    if count < every:
        axes.set_title(f"the first {count} of {every} modes", loc="left")
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    return figure


def _frequency_text(frequency: float) -> str:
    """A frequency to four digits, at least whole hertz."""
    return f"{frequency:,.0f}" if frequency >= 1000.0 else f"{frequency:.4g}"


def _write_damping(axes: Axes, damping: np.ndarray, shown: np.ndarray) -> None:
    """The damping ratio of each mode at the end of its bar."""
    right = axes.get_yaxis_transform()
    for row in np.nonzero(shown & np.isfinite(damping))[0]:
        text = f"{100.0 * damping[row]:.2f}"
        axes.text(1.015, row + 1.0, text, transform=right, va="center", fontsize=8.5)
    axes.text(
        1.015, 0.35, "damping ratio [%]", transform=right, va="bottom", fontsize=8.5, color=_GREY
    )


@_house_look()
def campbell(dataset: xr.Dataset, title: str, *, harmonics: int = 4) -> Figure:
    """Natural frequencies over pinion speed, the mesh harmonics, and where they cross.

    **Arguments:**

    - `dataset`: `frequency_Hz` over rising speed [rad/s] and mode, each mode followed through the
        speeds; `mesh_energy` over both, its share of the strain energy, may be added: the larger,
        the larger the mark. `attrs["teeth_pinion"]`.
    - `title`: the case or the finding.
    - `harmonics`: number of mesh harmonics.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((9.6, 6.4), f"Campbell diagram: {title}")
    speed, teeth = dataset["speed"].values, int(dataset.attrs["teeth_pinion"])
    frequency = dataset["frequency_Hz"].transpose("speed", "mode").values
    highest = float(harmonics * teeth * speed[-1] / (2.0 * np.pi))
    inside = frequency[np.isfinite(frequency) & (frequency <= highest)]
    # Of modes above, up to which no harmonic reaches, one is as good as many.
    top = 1.12 * max(float(np.max(inside, initial=0.0)), 0.3 * highest)
    unit, name = _frequency_unit(top)
    rays = [
        np.stack([speed, h * teeth * speed / (2.0 * np.pi * unit)], axis=1)
        for h in range(1, harmonics + 1)
    ]
    for ray in rays:
        axes.plot(*ray.T, color=_ORANGE, lw=1.1, ls=(0, (6, 2)), zorder=2.0)
    curves = [np.stack([speed, column / unit], axis=1) for column in frequency.T]
    for curve in curves:
        axes.plot(*curve.T, color=_BLUE, lw=1.3, marker=_dots(speed), ms=3, zorder=2.1)
    axes.set_ylabel(f"natural frequency [{name}]")
    _speed_axes([axes], speed, teeth)
    axes.set_ylim(0.0, top / unit)
    crossings = crossing_columns(dataset, harmonics=harmonics)
    has_energy = "mesh_energy" in dataset
    energy = crossings["mesh_energy"] if has_energy else np.ones(len(crossings["mode"]))
    places = np.stack(
        [crossings["pinion_speed_rad_s"], crossings["frequency_Hz"] / unit],
        axis=1,
    )
    size = 12.0 + 110.0 * energy if has_energy else np.full(len(energy), 30.0)
    axes.scatter(*places.T, s=size, color=_RED, ec="white", lw=0.7, zorder=3.0, clip_on=True)
    _write_rays(axes, rays, places)
    _write_modes(axes, curves)
    important = np.argsort(-energy, kind="stable")
    chosen = [x for x in important if energy[x] >= 0.1 and places[x, 1] < 0.98 * top / unit]
    labels = [
        Label(f"{places[x, 0]:.0f} rad/s", (float(places[x, 0]), float(places[x, 1])), _RED)
        for x in chosen[:_CROSSINGS_SHOWN]
    ]
    if labels:
        write_labels(axes, labels, [*rays, *curves], points=places, drop=True)
    handles = [
        Line2D([], [], color=_BLUE, lw=1.3, label="natural frequency"),
        Line2D([], [], color=_ORANGE, lw=1.1, ls=(0, (6, 2)), label="mesh frequency and harmonics"),
    ]
    for share in (0.1, 0.5, 1.0) if has_energy else (0.0,):
        diameter = np.sqrt(12.0 + 110.0 * share if has_energy else 30.0)
        label = f"{100 * share:.0f} %"
        if share == 0.1:
            label = f"crossing, energy in the mesh {label}"
        label = label if has_energy else "crossing"
        style: dict[str, Any] = {"marker": "o", "ls": "", "ms": diameter, "mec": "white"}
        handles.append(Line2D([], [], color=_RED, label=label, **style))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)
    return figure


# Labels beyond these make a picture a table; the table is the CSV.
_CROSSINGS_SHOWN = 16


def _write_rays(axes: Axes, rays: Sequence[np.ndarray], points: np.ndarray) -> None:
    """The number of each harmonic on its line, near the end but clear of these points."""
    right, top = axes.get_xlim()[1], axes.get_ylim()[1]
    size = np.asarray([right, top])
    for harmonic, ray in enumerate(rays, start=1):
        slope = ray[-1, 1] / ray[-1, 0]
        end = min(ray[-1, 0], top / slope)
        shares = np.linspace(0.97, 0.6, 25)
        places = shares[:, None] * np.asarray([end, slope * end])
        # Half a label, over the size of the axes.
        half = np.asarray([0.03, 0.03])
        apart = np.abs(places[:, None] - points) / size / half
        clear = np.all(np.max(apart, axis=2) > 1.0, axis=1)
        clear &= places[:, 0] < (1.0 - half[0]) * right
        x, y = places[int(np.argmax(clear))]
        axes.annotate(
            f"{harmonic} x",
            (x, y),
            ha="center",
            va="center",
            fontsize=8.5,
            color="#a06c00",
            bbox={**_BOX, "alpha": 1.0},
            zorder=2.5,
        )


def _write_modes(axes: Axes, curves: Sequence[np.ndarray]) -> None:
    """The number of each mode at the right end of its curve, and a line that leads there.

    Modes that coincide have one label.
    """
    top = axes.get_ylim()[1]
    ends: dict[float, list[int]] = {}
    for end, mode in sorted(
        (float(curve[-1, 1]), mode)
        for mode, curve in enumerate(curves, start=1)
        if 0.0 <= curve[-1, 1] <= top
    ):
        last = max(ends, default=-top)
        ends.setdefault(last if end - last < _ONE_LINE * top else end, []).append(mode)
    if not ends:
        return
    figure = axes.get_figure(root=True)
    assert figure is not None
    lay_out(figure)
    height = 72.0 / figure.dpi * axes.get_window_extent().height
    places = _apart(np.asarray(list(ends)), top * 10.0 / height, 0.0, top)
    x = float(curves[0][-1, 0])
    for (end, modes), place in zip(ends.items(), places, strict=True):
        axes.annotate(
            ", ".join(map(str, modes)),
            (x, end),
            xytext=(24.0, (place - end) / top * height),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
            color=_BLUE,
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": _BLUE, "lw": 0.5, "shrinkA": 1, "shrinkB": 1},
        )
    axes.annotate(
        "mode",
        (1.0, 1.0),
        xycoords="axes fraction",
        xytext=(12, 6),
        textcoords="offset points",
        fontsize=8.5,
        color=_BLUE,
    )


# Of the axes' height: modes that are closer are drawn as one line.
_ONE_LINE = 0.003


# --- One operating point


@_house_look()
def orbit(dataset: xr.Dataset, title: str) -> Figure:
    """A settled response: mesh force and dynamic TE over time, and the phase portrait.

    Where two branches exist at the same speed they stand side by side, with the same scales.

    **Arguments:**

    - `dataset`: over branch and rising phase [mesh periods]: `mesh_force_ratio`, over the static
        force, `te_um`, and its rate of change `te_rate_mm_s`. A branch that repeats earlier than
        another ends with values that are not finite. `te_static_um` over phase may be added, and
        flags `settled` and `stable` over branch.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    branches = [str(x) for x in dataset["branch"].values]
    count = len(branches)
    if count == 1:
        figure, row = _panels((12.6, 4.4), f"Steady response: {title}", 3, (1.35, 1.35, 1.0))
        columns = [row]
    else:
        figure = Figure(figsize=(max(9.6, 4.6 * count), 9.6))
        figure.set_layout_engine("constrained", hspace=0.03)
        grid = figure.subplots(
            3, count, squeeze=False, sharex="row", sharey="row", height_ratios=(1, 1, 1.5)
        )
        figure.suptitle(f"Steady response: {title}")
        columns = [list(grid[:, column]) for column in range(count)]
    longest = max(2, *(_cycle_periods(_branch(dataset, branch)[0]) for branch in range(count)), 2)
    for branch, axes in enumerate(columns):
        _draw_orbit(axes, dataset, branch, longest)
    handles = [
        Line2D([], [], color=_BLUE, label="response"),
        Line2D([], [], color=_RED, lw=3.0, label="teeth apart"),
        Line2D([], [], color="black", marker="o", ls="", ms=5, label="once per mesh period"),
    ]
    if "te_static_um" in dataset:
        handles.insert(1, Line2D([], [], color=_GREY, ls="--", lw=1.1, label="quasi-static"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _draw_orbit(axes: Sequence[Axes], dataset: xr.Dataset, row: int, longest: int) -> None:
    """Force, TE and phase portrait of one branch."""
    phase, force, error, rate = _branch(dataset, row)
    periods, apart = _cycle_periods(phase), force <= _NO_FORCE
    share = 100.0 * float(apart @ _shares(phase))
    times = max(longest // periods, 1)
    along = np.concatenate([phase + periods * time for time in range(times)])
    over, portrait = axes[:2], axes[2]
    for panel, values in zip(over, (force, error), strict=True):
        repeated, lost = np.tile(values, times), np.tile(apart, times)
        panel.plot(along, repeated, color=_BLUE, lw=1.4)
        panel.plot(along, np.where(lost, repeated, np.nan), color=_RED, lw=3.0, zorder=3)
        panel.set(xlim=(0, longest), xlabel="mesh phase [mesh periods]")
    if "te_static_um" in dataset:
        static = dataset["te_static_um"].values
        shown = np.isfinite(static)
        cycle = _cycle_periods(dataset["phase"].values[shown])
        for time in range(max(longest // cycle, 1)):
            own = dataset["phase"].values[shown] + cycle * time
            over[1].plot(own, static[shown], color=_GREY, lw=1.1, ls="--")
    over[0].axhline(1.0, color=_GREY, lw=0.8, ls="--", zorder=1)
    closed = lambda x: np.append(x, x[:1])
    portrait.plot(closed(error), closed(rate), color=_BLUE, lw=1.4)
    lost = (closed(np.where(apart, x, np.nan)) for x in (error, rate))
    portrait.plot(*lost, color=_RED, lw=3.0)
    once = np.searchsorted(phase, phase[0] + np.arange(periods))
    portrait.plot(error[once], rate[once], "o", color="black", ms=5, zorder=4)
    portrait.set_xlabel("dynamic TE [µm]")
    labels = ("mesh force / static [-]", "dynamic TE [µm]", "rate of the TE [mm/s]")
    for panel, label in zip(axes, labels, strict=True):
        panel.set_ylabel(label)
        panel.tick_params(labelleft=True)
    alone = dataset.sizes["branch"] == 1
    texts = [f"largest {_digits(float(np.max(force)), 3)}", f"no contact {share:.3g} % of time"]
    name = str(dataset["branch"].values[row])
    over[0].set_title(("" if alone else f"{name}: ") + ", ".join(texts), loc="left")
    over[1].set_title(_orbit_state(dataset, row, periods), loc="left")
    portrait.set_title("phase portrait", loc="left")


def _orbit_state(dataset: xr.Dataset, row: int, periods: int) -> str:
    """After how many mesh periods a response repeats, and whether it is to be trusted."""
    words = ["repeats every " + ("mesh period" if periods == 1 else f"{periods} mesh periods")]
    own = dataset.isel(branch=row)
    if "settled" in own and not bool(own["settled"]):
        words.append("NOT SETTLED")
    if "stable" in own:
        words.append("stable" if bool(own["stable"]) else "UNSTABLE")
    return ", ".join(words)
