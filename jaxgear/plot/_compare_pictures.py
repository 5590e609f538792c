"""Fidelity levels compared: their errors beside their time, and each error over time."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from jaxgear.plot._labels import Label, write_labels
from jaxgear.plot._palette import BLUE, GREEN, GREY, SERIES
from jaxgear.plot._style import axis_label, legend_below, panels

# Colours of cells: well within the tolerance, within it, up to so many times it, beyond.
_SHADES, _FAR = ("#b7e3d3", "#e3f1d4", "#fbe6bd", "#f3bfa6"), 5.0
# Width of a panel of bars [inches].
_BARS = 2.3


def judged(levels: xr.Dataset, response: str) -> xr.DataArray:
    """The errors of a response by which levels are chosen [-]."""
    name = f"error_95_{response}"
    return levels[name if name in levels else f"error_{response}"]


def overview(levels: xr.Dataset) -> Figure:
    """Errors of every level as a table with shades, its time and that of compiling it as bars."""
    about, names = levels.attrs, [str(name) for name in levels["name"].values]
    errors = [judged(levels, response) for response in about["responses"].split()]
    count, width = len(names), 1.45 * len(errors)
    size, ratios = (3.9 + width + 2 * _BARS, 1.9 + 0.3 * count), (width, _BARS, _BARS)
    what, space = "Models and methods compared", (0.02, 0.02)
    figure, row = panels(what, levels, size, 3, space=space, width_ratios=ratios)
    table, running, compiling = row
    bold = ["bold" if name == about["recommended"] else "normal" for name in names]
    _draw_table(table, errors, about, bold)
    table.set_yticks(range(count), names, fontsize=9)
    for label, weight in zip(table.get_yticklabels(), bold, strict=True):
        label.set_fontweight(weight)
    beyond = levels["beyond"].values if "beyond" in levels else np.zeros(count, dtype=bool)
    colours = np.where(beyond, GREY, BLUE)
    colours = np.where(np.asarray(names) == about["recommended"], GREEN, colours)
    _draw_times(running, levels["time_s"].values, colours, "each run [s]")
    # Less where the program came from the cache.
    _draw_times(compiling, levels["compile_s"].values, colours, "compiling [s]")
    return figure


def _draw_table(
    axes: Axes, errors: Sequence[xr.DataArray], about: Mapping[str, Any], bold: Sequence[str]
) -> None:
    """Errors as numbers on shades: a row for each level, a column for each response."""
    values, tolerance = np.stack(errors, axis=1), about["tolerance"]
    steps = (about["margin"], 1.0, _FAR)
    shades = np.where(np.isfinite(values), np.digitize(values / tolerance, steps), 3.0)
    axes.imshow(shades, cmap=ListedColormap(_SHADES), vmin=-0.5, vmax=3.5, aspect="auto")
    for (row, column), error in np.ndenumerate(values):
        look: dict[str, Any] = {"fontsize": 9, "fontweight": bold[row]}
        axes.text(column, row, _percent(error), ha="center", va="center", **look)
    heads = [x.attrs["of"].replace(" of ", "\nof ").replace("mean ", "mean\n") for x in errors]
    axes.set_xticks(range(len(heads)), heads, fontsize=9)
    axes.tick_params(top=True, labeltop=True, bottom=False, labelbottom=False, length=0)
    axes.set_xticks(np.arange(len(heads) - 1) + 0.5, minor=True)
    axes.set_yticks(np.arange(len(values) - 1) + 0.5, minor=True)
    axes.grid(which="minor", color="white", lw=1.5)
    axes.grid(which="major", visible=False)
    axes.tick_params(which="minor", length=0)
    axes.spines[:].set_visible(False)
    edges = ", ".join(_percent(step * tolerance) for step in steps)
    axes.set_xlabel(f"{about['words']};\nshades: up to {edges}, and beyond", fontsize=9)


def _draw_times(axes: Axes, seconds: np.ndarray, colours: np.ndarray, label: str) -> None:
    """Bars with their numbers."""
    times, count = np.maximum(seconds, 1e-9), len(seconds)
    axes.barh(range(count), times, color=colours.tolist(), height=0.6)
    axes.set(xscale="log", ylim=(count - 0.5, -0.5), xlabel=label)
    axes.set_xlim(0.5 * times.min(), 6.0 * times.max())
    axes.set_yticks([])
    axes.xaxis.set_minor_formatter(NullFormatter())
    for row, time in enumerate(times):
        axes.text(1.15 * time, row, f"{time:.2g}", va="center", fontsize=8.5)


def _percent(error: float) -> str:
    if not np.isfinite(error):
        return "none"
    return f"{100.0 * error:.2g} %" if error < 0.995 else f"{error:.2g} x"


def error_over_time(levels: xr.Dataset, response: str) -> Figure:
    """Error over time: what lies further down and left is better.

    Levels of one family are joined in the order given while they take longer. An error that is not
    finite failed, and stands at the top; one of zero stands at the foot.
    """
    figure, (axes,) = panels("Error over time", levels, (9.6, 6.2))
    error, tolerance = judged(levels, response), float(levels.attrs["tolerance"])
    recommended = error.attrs["recommended"]
    names, family = (levels[x].values.astype(str) for x in ("name", "family"))
    families = list(dict.fromkeys(family))
    looks = zip(itertools.cycle(SERIES), itertools.cycle("os^vDP*X"), strict=False)
    looks = dict(zip(families, looks, strict=False))
    place, seen = _places(levels["time_s"].values, error.values, tolerance)
    handles = []
    for own in families:
        colour, marker = looks[own]
        good, bad = place[(family == own) & seen], place[(family == own) & ~seen]
        for piece in _pieces(good):
            axes.plot(*piece.T, color=colour, lw=1.1, alpha=0.7, zorder=2.0)
        axes.plot(*good.T, marker, ls="", color=colour, ms=6.5, zorder=3.0)
        axes.plot(*bad.T, marker, color=colour, mfc="none", ms=6.5, zorder=3.0)
        handles.append(Line2D([], [], color=colour, marker=marker, ms=6.5, lw=1.1, label=own))
    axes.set(xscale="log", yscale="log")
    axes.set(xlabel=axis_label(levels["time_s"]), ylabel=axis_label(error))
    _room_around(axes, np.concatenate([place, [[place[0, 0], tolerance]]]))
    axes.axhline(tolerance, color=GREEN, lw=1.2, ls="--", zorder=1.5)
    label = f"tolerance {tolerance:.2g}"
    handles.append(Line2D([], [], color=GREEN, lw=1.2, ls="--", label=label))
    if recommended:
        ring: dict[str, Any] = {"marker": "o", "ls": "", "mfc": "none", "mec": "black"}
        ring |= {"ms": 14, "mew": 1.6, "zorder": 3.5}
        axes.plot(*place[names == recommended].T, **ring)
        label = f"recommended: {recommended}"
        ring["ms"] = 9
        handles.append(Line2D([], [], label=label, **ring))
    hollow: dict[str, Any] = {"marker": "o", "ls": "", "mfc": "none", "color": GREY, "ms": 6.5}
    failed, exact = not np.isfinite(error).all(), bool(np.any(error == 0.0))
    words = {"no result (at the top)": failed, "no difference (at the foot)": exact}
    handles += [Line2D([], [], label=text, **hollow) for text, any_of in words.items() if any_of]
    legend_below(figure, handles, ncols=4)
    labels = [
        Label(name, (float(x), float(y)), looks[own][0], name == recommended)
        for name, (x, y), own in zip(names, place, family, strict=True)
    ]
    lines = [piece for own in families for piece in _pieces(place[(family == own) & seen])]
    lines.append(np.stack([axes.get_xlim(), np.full(2, tolerance)], axis=1))
    # The recommended one has the first choice of a place.
    write_labels(axes, sorted(labels, key=lambda label: not label.bold), lines)
    return figure


def _pieces(places: np.ndarray) -> list[np.ndarray]:
    """Places in a chart over time, apart where the next one takes less."""
    return np.split(places, np.flatnonzero(np.diff(places[:, 0]) < 0.0) + 1)


def _places(time: np.ndarray, error: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows time [s] and error of each level, and whether an error is finite and not zero.

    Failures stand above all others, errors of zero below.
    """
    seen = np.isfinite(error) & (error > 0.0)
    others = [tolerance, *error[seen]]
    beyond = np.where(error == 0.0, min(others) / 3.0, 3.0 * max(others))
    return np.stack([np.maximum(time, 1e-9), np.where(seen, error, beyond)], axis=1), seen


def _room_around(axes: Axes, place: np.ndarray) -> None:
    """Limits with room for labels, and a decade at least."""
    for low, high, set_limits in zip(
        np.min(place, axis=0), np.max(place, axis=0), (axes.set_xlim, axes.set_ylim), strict=True
    ):
        room = 4.0 if high < 10.0 * low else 1.35 * (high / low) ** 0.06
        set_limits(low / room, high * room)
