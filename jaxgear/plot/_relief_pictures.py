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

from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, PINK
from jaxgear.plot._style import SURFACE, digits, house_look, panels

# An error of depth whose cost is shown.
_MISSED_UM = 2.0
_RMS = "RMS of the transmission error [µm]"
_EXTENT = "extent over the path of contact [-]"


@house_look()
def master_curve(chart: xr.Dataset, valley: xr.Dataset, search: xr.Dataset | None = None) -> Figure:
    """RMS of the TE over depth and extent of tip relief, with the curves of least TE.

    **Arguments:**

    - `chart`: `relief_map`.
    - `valley`: `relief_valley`.
    - `search`: `relief_search`.

    **Returns:**

    The figure.
    """
    figure, (axes,) = panels((7.6, 5.8), f"Master Curve map: {chart.attrs['title']}")
    depth, extent, value = (chart[name].values for name in ("depth_um", "extent", "te_rms_um"))
    levels = _levels(value)
    norm = BoundaryNorm(levels, 256, extend="min")
    surface = axes.contourf(
        extent, depth, value, levels=levels, cmap=SURFACE, extend="min", norm=norm
    )
    surface.set_edgecolor("face")
    axes.grid(False)
    figure.colorbar(surface, ax=axes, label=_RMS, ticks=levels, format="%.3g")
    outlined = {"lw": 2.0, "path_effects": [withStroke(linewidth=3.4, foreground="black")]}
    closed = valley["closed_form_depth_um"].values
    inside = np.where(closed <= np.max(depth), closed, np.nan)
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
    axes.set(
        xlabel="extent of the tip relief over the path of contact [-]",
        ylabel="depth of the tip relief [µm]",
        xlim=(float(np.min(extent)), float(np.max(extent))),
        ylim=(float(np.min(depth)), float(np.max(depth))),
    )
    figure.legend(loc="outside lower center", ncols=5, frameon=False)
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


@house_look()
def traced_curve(dataset: xr.Dataset) -> Figure:
    """The best depth over the extent, what is left there, and how much an error of depth costs.

    **Arguments:**

    - `dataset`: `relief_curve`.

    **Returns:**

    The figure.
    """
    title = f"Master Curve of tip relief: {dataset.attrs['title']}"
    figure, (left, middle, right) = panels((11.4, 4.2), title, columns=3)
    found = dataset.isel(extent=np.flatnonzero(np.isfinite(dataset["depth_um"].values)))
    extent, depth, rms = (found[name].values for name in ("extent", "depth_um", "te_rms_um"))
    left.plot(extent, depth, color=BLUE, label="computed")
    closed = found["closed_form_depth_um"].values
    left.plot(extent, closed, "--", color=ORANGE, label="closed form")
    if depth.size:
        left.set_ylim(0.0, 1.4 * float(np.max(depth)))
    left.set(ylabel="best depth of the tip relief [µm]")
    left.set_title("the depth of least TE", loc="left")
    left.legend(loc="best")
    middle.plot(extent, rms, color=BLUE)
    middle.set_title("what is left at that depth", loc="left")
    right.plot(extent, rms, color=BLUE, label="best depth")
    # The mean square has its least value at the best depth, and is a parabola about it.
    off = np.hypot(rms, _MISSED_UM * found["te_rms_per_depth"].values)
    right.plot(extent, off, "--", color=GREEN, label=f"{_MISSED_UM:g} µm more or less")
    right.set_title("what an error of depth costs", loc="left")
    for axes in (middle, right):
        axes.set(ylabel=_RMS)
        axes.set_ylim(bottom=0.0)
    right.legend(loc="best")
    for axes in (left, middle, right):
        axes.set(xlabel=_EXTENT)
    return figure


@house_look()
def family(chart: xr.Dataset, curves: xr.Dataset) -> Figure:
    """The curves of several torques on the map of one, and how much an error of depth costs.

    **Arguments:**

    - `chart`: `relief_map`.
    - `curves`: `relief_torques`.

    **Returns:**

    The figure.
    """
    title = f"Master Curves of tip relief at several torques: {chart.attrs['title']}"
    figure, (left, right) = panels((10.6, 4.8), title, columns=2, ratios=(1.35, 1.0))
    depth, extent, value = (chart[name].values for name in ("depth_um", "extent", "te_rms_um"))
    # Light, so that the curves stand out.
    pale = {"cmap": "Greys", "vmin": 0.0, "vmax": 1.6 * float(np.max(value))}
    surface = left.contourf(extent, depth, value, levels=12, **pale)
    surface.set_edgecolor("face")
    left.grid(False)
    figure.colorbar(surface, ax=left, label=_RMS, format="%.3g")
    torques = curves["torque_Nm"].values
    for place, shade in enumerate(np.linspace(0.0, 0.85, len(torques))):
        own = curves.isel(torque=place)
        own = own.isel(extent=np.flatnonzero(np.isfinite(own["depth_um"].values)))
        look: dict[str, Any] = {"color": matplotlib.colormaps["viridis"](shade)}
        along, label = own["extent"].values, f"{torques[place]:g} N m"
        left.plot(along, own["depth_um"].values, lw=2.2, label=label, **look)
        left.plot(along, own["closed_form_depth_um"].values, "--", lw=1.2, **look)
        right.plot(along, own["te_rms_per_depth"].values, label=label, **look)
    left.plot([], [], "--", color=GREY, lw=1.2, label="closed form")
    left.set(ylabel="depth of the tip relief [µm]", ylim=(float(depth[0]), float(depth[-1])))
    right.set(ylabel="RMS that an error of depth adds, over it [µm/µm]")
    right.set_ylim(bottom=0.0)
    for axes in (left, right):
        axes.set(xlabel=_EXTENT)
        axes.set_xlim(float(extent[0]), float(extent[-1]))
        axes.locator_params(axis="x", nbins=5)
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    return figure


@house_look()
def smoothing_bias(dataset: xr.Dataset) -> Figure:
    """What smooth contact changes, as a function of its width.

    Where no cell is within the width of separation the bias is zero, apart from rounding: hollow
    triangles at the foot of the axes.

    **Arguments:**

    - `dataset`: `smoothing_bias`.

    **Returns:**

    The figure.
    """
    title = f"Bias of smooth contact: {dataset.attrs['title']}"
    figure, (mean, relative) = panels((9.6, 4.0), title, 2)
    width, exact = dataset["width_um"].values, float(dataset["te_rms_um"])
    _draw_bias(mean, width, dataset["te_mean_bias_um"].values, "mean TE")
    _draw_bias(relative, width, dataset["te_rms_bias_relative"].values, "RMS of the TE")
    mean.set_ylabel("|bias of the mean TE| [µm]")
    mean.set_title("absolute", loc="left")
    relative.set_ylabel("|bias| / exact value [-]")
    relative.set_title(f"relative; the exact RMS is {digits(exact, 3)} µm", loc="left")
    for axes in (mean, relative):
        axes.set(xscale="log", yscale="log", xlabel="width of the smooth contact [µm]")
        axes.legend(loc="best")
    return figure


# Biases this far below the largest are differences of equal numbers.
_ROUNDING = 1e-11


def _draw_bias(axes: Axes, width: np.ndarray, bias: np.ndarray, label: str) -> None:
    size = np.abs(bias)
    shown = size > _ROUNDING * np.max(size)
    axes.plot(width[shown], size[shown], marker="o", ms=4, color=BLUE, label=label)
    if not np.all(shown):
        foot: dict[str, Any] = {"mfc": "none", "transform": axes.get_xaxis_transform()}
        zeros = np.full(np.count_nonzero(~shown), 0.03)
        axes.plot(width[~shown], zeros, "v", ms=5, color=BLUE, label=f"{label}: zero", **foot)
