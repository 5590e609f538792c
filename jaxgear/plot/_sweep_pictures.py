"""The picture of a sweep: dynamic ratio, transmission error and loss of contact over speed."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxgear._response._sweep_features import FEW, WAYS, fold_places, leaps
from jaxgear.plot._labels import apart, text_size
from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, RED
from jaxgear.plot._speed_axes import flag, runs, speed_axes, stack
from jaxgear.plot._style import laid_out, legend_below

_COLOURS = {"up": BLUE, "down": ORANGE, "cold": GREEN}
_HOLLOW: dict[str, Any] = {"ls": "", "mfc": "white"}
_UNSETTLED: dict[str, Any] = {"marker": "o", "ls": "", "ms": 5, "mfc": "none", "mec": RED}
_UNSETTLED |= {"mew": 1.2, "zorder": 3.0}
_FOLD: dict[str, Any] = {"marker": "D", "ls": "", "ms": 4.5, "color": "black", "zorder": 3.2}
_CRITICAL: dict[str, Any] = {"color": GREY, "lw": 0.8, "ls": ":", "zorder": 0.5}
_DASHED: dict[str, Any] = {"ls": (0, (4, 2)), "lw": 1.1}
_LABELS = {
    "dynamic_ratio": "largest mesh force / static [-]",
    "te_rms_um": "RMS of the TE [µm]",
    "contact_loss": "no contact\n[% of time]",
}


def sweep(dataset: xr.Dataset, critical: Sequence[tuple[float, str]]) -> Figure:
    """Dynamic ratio, RMS of the TE and contact loss over pinion speed, for each direction.

    Lines join settled responses; unstable parts are dashed, also those of a continuation curve,
    whose turning points are marked as folds. Where a direction leaps, an arrow says which way.
    Pinion speeds [rad/s] that are critical are marked, with what is critical there.
    """
    loses = bool(np.any(dataset["contact_loss"].values > 0.0))
    names = list(_LABELS)[: 3 if loses else 2]
    ratios, height = ((3.0, 1.8, 1.0), 7.0) if loses else ((3.0, 1.7), 5.8)
    figure, panels = stack("Speed sweep", dataset, (9.6, height), ratios)
    for axes, name in zip(panels, names, strict=True):
        _draw_directions(axes, dataset, name)
        axes.set_ylabel(_LABELS[name])
    panels[0].axhline(1.0, color=GREY, lw=0.8, ls="--", zorder=1)
    speed_axes(panels, dataset["speed"].values, int(dataset.attrs["teeth_pinion"]))
    legend_below(figure, list(_legend(dataset)), ncols=4)
    figure.align_ylabels(panels)
    low, high = panels[0].get_xlim()
    shown = sorted((speed, label) for speed, label in critical if low <= speed <= high)
    for axes in panels[1:]:
        for speed, _ in shown:
            axes.axvline(speed, **_CRITICAL)
    if shown:
        _write_critical(panels[0], shown)
    for axes, name in zip(panels, names, strict=True):
        _draw_leaps(axes, dataset, name)
    return figure


def _values(dataset: xr.Dataset, name: str) -> np.ndarray:
    """What an axis shows: shares of time in percent."""
    return (100.0 if name == "contact_loss" else 1.0) * dataset[name].values


def _draw_directions(axes: Axes, dataset: xr.Dataset, name: str) -> None:
    """One quantity over speed: directions, continuation curve, folds, and what is not settled."""
    speed, top = dataset["speed"].values, _ceiling(dataset, name)
    # The first direction lies on top; where both agree, the other is seen on either side of it.
    for row, direction in reversed(list(enumerate(dataset["direction"].values))):
        own = dataset.sel(direction=direction)
        values, colour = _values(own, name), _COLOURS[direction]
        shown = flag(own, "settled")
        style: dict[str, Any] = {"color": colour, "lw": 2.0 + 2.4 * row, "zorder": 2.5 - 0.1 * row}
        style["alpha"] = 1.0 if row == 0 else 0.75
        kinds = shown[1:] & shown[:-1], shown, flag(own, "stable")
        _draw_parts(axes, speed, values, kinds, style)
        if len(speed) <= FEW:
            axes.plot(speed[shown], values[shown], "o", ms=3.5 + row, color=colour, zorder=2.6)
        for marker, _, several in _several_periods(own):
            look = {"marker": marker, "ms": 4.5 + row, "color": colour, "zorder": 2.7}
            _mark(axes, speed[shown & several], values[shown & several], {**_HOLLOW, **look})
        _mark(axes, speed[~shown], np.minimum(values, 0.97 * top)[~shown], _UNSETTLED)
    if f"curve_{name}" in dataset:
        _draw_curve(axes, dataset, f"curve_{name}")
    axes.set_ylim(0.0, top)


def _mark(axes: Axes, x: np.ndarray, y: np.ndarray, style: Mapping[str, Any]) -> None:
    """Markers that the edge of the axes does not cut."""
    # Without any, what is not clipped has no extent, and the layout fails.
    if len(x):
        axes.plot(x, y, clip_on=False, **style)


def _several_periods(dataset: xr.Dataset) -> list[tuple[str, str, np.ndarray]]:
    """Marker, words and places of responses of period two, and of longer ones.

    Cycles of several mesh periods count as one, or each response would be marked as of many.
    """
    periods = dataset["periods"].values
    longer = periods != dataset.attrs["mesh_periods"]
    return [
        ("s", "two mesh periods", longer & (periods == 2)),
        ("^", "more periods", longer & (periods >= 3)),
    ]


def _ceiling(dataset: xr.Dataset, name: str) -> float:
    """Upper limit of an axis, from unsettled responses only where nothing settled."""
    values, settled = _values(dataset, name), flag(dataset, "settled")
    most = [float(np.max(values[settled] if settled.any() else values, initial=0.0))]
    if f"curve_{name}" in dataset:
        most.append(float(np.max(dataset[f"curve_{name}"].values, initial=0.0)))
    least = 1.0 if name == "dynamic_ratio" else 0.0
    return 1.08 * max(*most, 1e-7 if name == "contact_loss" else 1e-9, least)


def _draw_parts(
    axes: Axes, x: np.ndarray, y: np.ndarray, kinds: Sequence[np.ndarray], style: Mapping[str, Any]
) -> None:
    """A line through points, dashed where it is not stable at both ends.

    Of `kinds` the first says which neighbours are joined, then which points are shown, then which
    are stable.
    """
    joined, shown, stable = kinds
    kind = np.where(joined, np.where(stable[1:] & stable[:-1], 1, 2), 0)
    paths: dict[int, list[np.ndarray]] = {1: [], 2: []}
    for which, first, last in runs(kind):
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
    piece, every = dataset["curve_piece"].values, np.ones(len(speed), bool)
    kinds = np.diff(piece) == 0, every, flag(dataset, "curve_stable")
    _draw_parts(axes, speed, values, kinds, {"color": "black", "lw": 0.8, "zorder": 2.9})
    folds = fold_places(speed, piece)
    axes.plot(speed[folds], values[folds], **_FOLD)


def _legend(dataset: xr.Dataset) -> Iterator[Line2D]:
    """What the lines and markers mean, with the number of those that are not as they should be."""
    line = lambda label, **look: Line2D([], [], label=label, **look)
    for row, direction in enumerate(dataset["direction"].values):
        yield line(WAYS[direction], color=_COLOURS[direction], lw=2.0 + 2.4 * row)
    settled = flag(dataset, "settled")
    unstable = settled & ~flag(dataset, "stable")
    if np.any(unstable):
        words = f"unstable ({np.count_nonzero(unstable)} of {unstable.size})"
        yield line(words, color=GREY, **_DASHED)
    if "curve_speed" in dataset:
        yield line("continuation, stable", color="black", lw=0.8)
        if not np.all(flag(dataset, "curve_stable")):
            yield line("continuation, unstable", color="black", **_DASHED)
        folds = fold_places(dataset["curve_speed"].values, dataset["curve_piece"].values)
        if len(folds):
            yield line(f"fold ({len(folds)})", **_FOLD)
    for marker, words, several in _several_periods(dataset):
        if count := np.count_nonzero(several & settled):
            style: dict[str, Any] = {"marker": marker, "ls": "", "ms": 4.5, "mfc": "white"}
            yield line(f"{words} ({count})", mec=GREY, **style)
    if not np.all(settled):
        yield line(f"not converged ({np.count_nonzero(~settled)} of {settled.size})", **_UNSETTLED)


def _draw_leaps(axes: Axes, dataset: xr.Dataset, name: str) -> None:
    """An arrow half-way along each leap, in the direction in which it is passed."""
    speed = dataset["speed"].values
    if len(speed) <= FEW:
        return
    for direction in [way for way in dataset["direction"].values if way != "cold"]:
        own = dataset.sel(direction=direction)
        values = _values(own, name)
        for place in leaps(values, flag(own, "settled"), _ceiling(dataset, name)):
            ends = np.stack([speed[place : place + 2], values[place : place + 2]], axis=1)
            ends = ends[:: -1 if direction == "down" else 1]
            head: dict[str, Any] = {
                "arrowstyle": "-|>",
                "color": _COLOURS[direction],
                "mutation_scale": 17,
            }
            head |= {"lw": 0.0, "shrinkA": 0.0, "shrinkB": 0.0}
            tip = ends[0] + 0.7 * (ends[1] - ends[0])
            axes.annotate("", tuple(tip), xytext=tuple(ends[0]), arrowprops=head, zorder=3.3)


def _write_critical(axes: Axes, shown: Sequence[tuple[float, str]]) -> None:
    """Lines at critical speeds, their labels upright in a strip above the curves, side by side."""
    low, high = axes.get_xlim()
    look: dict[str, Any] = {"fontsize": 8.5, "rotation": 90.0, "color": GREY, "zorder": 4}
    sizes = np.asarray([text_size(axes, label, look) for _, label in shown])
    scale = laid_out(axes)
    box = axes.get_window_extent()
    width, height = scale * box.width, scale * box.height
    # Lines lead from their speeds to their labels over this height [points].
    slope, tallest, thick = 9.0, float(np.max(sizes[:, 1])), float(np.max(sizes[:, 0]))
    strip = min((tallest + slope + 5.0) / height, 0.45)
    top = axes.get_ylim()[1]
    axes.set_yticks([tick for tick in axes.get_yticks() if tick <= top])
    axes.set_ylim(0.0, top / (1.0 - strip))
    scale = (high - low) / width
    speeds = np.asarray([speed for speed, _ in shown])
    room = 0.5 * scale * thick
    places = apart(speeds, scale * (thick + 1.0), low + room, high - room)
    base = 1.0 - (tallest + 3.0) / height
    transform = axes.get_xaxis_transform()
    for (speed, label), place in zip(shown, places, strict=True):
        ends = [base - slope / height, base - 2.0 / height]
        axes.axvline(speed, 0.0, ends[0], **_CRITICAL)
        axes.plot([speed, place], ends, color=GREY, lw=0.8, transform=transform, zorder=3.9)
        axes.text(place, base, label, ha="center", va="bottom", transform=transform, **look)
