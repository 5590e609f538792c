"""Pictures of the map of tip relief: Master Curves, and what smooth contact changes.

All are drawn from the groups `relief_...` and `smoothing_bias` of a result.
"""

from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, PINK, SURFACE
from jaxgear.plot._style import axis_label, digits, draw_line, legend_below, panels

# An error of depth whose cost is shown.
_MISSED_UM = 2.0
_EXTENT = "extent over the path of contact [-]"


def _chart_of(figure: Figure, axes: Axes, chart: xr.Dataset, levels: Any, **look: Any) -> None:
    """RMS of the TE over extent and depth of tip relief, filled between levels."""
    along, up, value = (chart[name] for name in ("extent", "depth_um", "te_rms_um"))
    area = axes.contourf(along.values, up.values, value.values, levels=levels, **look)
    area.set_edgecolor("face")
    axes.grid(False)
    ticks = None if np.isscalar(levels) else levels
    figure.colorbar(area, ax=axes, label=axis_label(value), format="%.3g", ticks=ticks)
    axes.set(xlabel=axis_label(along), ylabel=axis_label(up))
    axes.set(xlim=(float(along.min()), float(along.max())), ylim=(float(up.min()), float(up.max())))


def master_curve(chart: xr.Dataset, valley: xr.Dataset, search: xr.Dataset | None = None) -> Figure:
    """RMS of the TE over depth and extent of tip relief, with the curves of least TE."""
    figure, (axes,) = panels("Master Curve map", chart, (7.6, 5.8))
    extent, levels = chart["extent"].values, _levels(chart["te_rms_um"].values)
    norm = BoundaryNorm(levels, 256, extend="min")
    _chart_of(figure, axes, chart, levels, cmap=SURFACE, extend="min", norm=norm)
    outlined: dict[str, Any] = {
        "lw": 2.0,
        "path_effects": [withStroke(linewidth=3.4, foreground="black")],
    }
    closed = valley["closed_form_depth_um"].values
    inside = np.where(closed <= float(chart["depth_um"].max()), closed, np.nan)
    for curve, colour, style, label in (
        (_unbroken_valley(valley, chart), "white", "-", "valley, computed"),
        (inside, ORANGE, "--", "closed form"),
    ):
        if np.isfinite(curve).any():
            axes.plot(extent, curve, color=colour, ls=style, label=label, **outlined)
    if search is not None:
        path = search["extent"].values, search["depth_um"].values
        axes.plot(*path, ".-", color=PINK, lw=1.1, ms=5, label="search")
        for row, marker, size, label in ((0, "o", 7, "its start"), (-1, "*", 14, "its end")):
            place = [along[row] for along in path]
            axes.plot(*place, marker, color=PINK, mec="black", ms=size, label=label, ls="")
    legend_below(figure, ncols=5)
    return figure


def _levels(values: np.ndarray) -> np.ndarray:
    """Round, roughly geometric levels up to the largest value, over two decades at the most."""
    most = float(np.nanmax(values))
    least = max(float(np.nanmin(values)), most / 100.0)
    powers = 10.0 ** np.arange(np.floor(np.log10(least)), np.ceil(np.log10(most)) + 1.0)
    series = np.outer(powers, [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]).ravel()
    first = np.searchsorted(series, least, side="right")
    return series[first : np.searchsorted(series, most) + 1]


def _unbroken_valley(valley: xr.Dataset, chart: xr.Dataset) -> np.ndarray:
    """Depth of the valley where it means something, else NaN [um].

    That is where the best depth lies within the map and halves the response, and it ends where the
    best depth jumps from one valley to another.
    """
    depth, low, high = valley["depth_um"].values, *chart["depth_um"].values[[0, -1]]
    room = 1e-6 * (high - low)
    within = (depth > low + room) & (depth < high - room)
    within &= valley["te_rms_um"].values < 0.5 * chart["te_rms_um"].values[0]
    jump = np.abs(np.diff(depth, prepend=depth[0])) > 0.3 * (high - low)
    return np.where(within & ~jump, depth, np.nan)


def traced_curve(dataset: xr.Dataset) -> Figure:
    """The best depth over the extent, what is left there, and how much an error of depth costs."""
    figure, row = panels("Master Curve of tip relief", dataset, (11.4, 4.2), columns=3)
    left, middle, right = row
    found = dataset.isel(extent=np.flatnonzero(np.isfinite(dataset["depth_um"].values)))
    extent, depth, rms = (found[name].values for name in ("extent", "depth_um", "te_rms_um"))
    left.plot(extent, depth, color=BLUE, label="computed")
    closed = found["closed_form_depth_um"].values
    left.plot(extent, closed, "--", color=ORANGE, label="closed form")
    if depth.size:
        left.set_ylim(0.0, 1.4 * float(np.max(depth)))
    left.set(ylabel="best depth of the tip relief [µm]")
    left.set_title("the depth of least TE", loc="left")
    draw_line(middle, found, "extent", "te_rms_um", color=BLUE)
    middle.set_title("what is left at that depth", loc="left")
    draw_line(right, found, "extent", "te_rms_um", color=BLUE, label="best depth")
    # The mean square has its least value at the best depth, and is a parabola about it.
    off = np.hypot(rms, _MISSED_UM * found["te_rms_per_depth"].values)
    right.plot(extent, off, "--", color=GREEN, label=f"{_MISSED_UM:g} µm more or less")
    right.set_title("what an error of depth costs", loc="left")
    for axes in row:
        axes.set(xlabel=_EXTENT)
        axes.set_ylim(bottom=0.0)
    for axes in (left, right):
        axes.legend(loc="best")
    return figure


def family(chart: xr.Dataset, curves: xr.Dataset) -> Figure:
    """The curves of several torques on the map of one, and how much an error of depth costs."""
    what = "Master Curves of tip relief at several torques"
    figure, (left, right) = panels(what, chart, (10.6, 4.8), 2, width_ratios=(1.35, 1.0))
    # Light, so that the curves stand out.
    most = float(chart["te_rms_um"].max())
    _chart_of(figure, left, chart, 12, cmap="Greys", vmin=0.0, vmax=1.6 * most)
    torques = curves["torque_Nm"].values
    for place, shade in enumerate(np.linspace(0.0, 0.85, len(torques))):
        own = curves.isel(torque=place)
        own = own.isel(extent=np.flatnonzero(np.isfinite(own["depth_um"].values)))
        look: dict[str, Any] = {"color": matplotlib.colormaps[SURFACE](shade)}
        along, label = own["extent"].values, f"{torques[place]:g} N m"
        left.plot(along, own["depth_um"].values, lw=2.2, label=label, **look)
        left.plot(along, own["closed_form_depth_um"].values, "--", lw=1.2, **look)
        right.plot(along, own["te_rms_per_depth"].values, label=label, **look)
    left.plot([], [], "--", color=GREY, lw=1.2, label="closed form")
    right.set(ylabel="RMS that an error of depth adds, over it [µm/µm]", xlim=left.get_xlim())
    right.set_ylim(bottom=0.0)
    for axes in (left, right):
        axes.set(xlabel=_EXTENT)
        axes.locator_params(axis="x", nbins=5)
    legend_below(figure, *left.get_legend_handles_labels(), ncols=5)
    return figure


def smoothing_bias(dataset: xr.Dataset) -> Figure:
    """What smooth contact changes, as a function of its width.

    Where no cell is within the width of separation the bias is zero, apart from rounding: hollow
    triangles at the foot of the axes.
    """
    figure, both = panels("Bias of smooth contact", dataset, (9.6, 4.0), 2)
    exact = digits(float(dataset["te_rms_um"]), 3)
    for axes, name, label, words, title in zip(
        both,
        ("te_mean_bias_um", "te_rms_bias_relative"),
        ("mean TE", "RMS of the TE"),
        ("|bias of the mean TE| [µm]", "|bias| / exact value [-]"),
        ("absolute", f"relative; the exact RMS is {exact} µm"),
        strict=True,
    ):
        _draw_bias(axes, dataset["width_um"].values, np.abs(dataset[name].values), label)
        axes.set(xscale="log", yscale="log", ylabel=words)
        axes.set_title(title, loc="left")
        axes.set_xlabel(axis_label(dataset["width_um"]))
        axes.legend(loc="best")
    return figure


# Biases this far below the largest are differences of equal numbers.
_ROUNDING = 1e-11


def _draw_bias(axes: Axes, width: np.ndarray, size: np.ndarray, label: str) -> None:
    shown = size > _ROUNDING * np.max(size)
    axes.plot(width[shown], size[shown], marker="o", ms=4, color=BLUE, label=label)
    if not np.all(shown):
        foot: dict[str, Any] = {"mfc": "none", "transform": axes.get_xaxis_transform()}
        zeros = np.full(np.count_nonzero(~shown), 0.03)
        axes.plot(width[~shown], zeros, "v", ms=5, color=BLUE, label=f"{label}: zero", **foot)
