"""Pictures of searches and of the map of tip relief; their data are in `_search_tables`."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, NullFormatter

from jaxgear._units import um
from jaxgear.plot._palette import _BLUE, _GREEN, _ORANGE, _PINK, _RED, _SKY
from jaxgear.plot._pictures import _SURFACE, _digits, _house_look, _panels, _phase_axis, _thin
from jaxgear.plot._search_tables import _largest_pressure
from jaxgear.plot._tables import _unrolled
from jaxgear.study._results import cycle_statistics


@_house_look()
def smoothing_bias(
    width_um: np.ndarray,
    mean_bias_um: np.ndarray,
    rms_bias_relative: np.ndarray,
    rms_exact_um: float,
    title: str,
    *,
    gradient_bias_relative: np.ndarray | None = None,
) -> Figure:
    """What smooth contact changes, as a function of its width.

    Where no cell is within the width of separation the bias is zero, apart from rounding: hollow
    triangles at the foot of the axes.

    **Arguments:**

    - `width_um`: of the smooth contact [um].
    - `mean_bias_um`: of the mean TE [um].
    - `rms_bias_relative`: of the RMS of the TE, over the exact one [-].
    - `rms_exact_um`: RMS of the TE with exact contact [um].
    - `title`: the case or the finding.
    - `gradient_bias_relative`: of the gradient, over the exact one [-].

    **Returns:**

    The figure.
    """
    figure, (mean, relative) = _panels((9.6, 4.0), f"Bias of smooth contact: {title}", 2)
    _draw_bias(mean, width_um, mean_bias_um, _BLUE, "mean TE")
    _draw_bias(relative, width_um, rms_bias_relative, _BLUE, "RMS of the TE")
    if gradient_bias_relative is not None:
        _draw_bias(relative, width_um, gradient_bias_relative, _ORANGE, "gradient", row=1)
    mean.set_ylabel("|bias of the mean TE| [µm]")
    mean.set_title("absolute", loc="left")
    relative.set_ylabel("|bias| / exact value [-]")
    relative.set_title(f"relative; the exact RMS is {_digits(rms_exact_um, 3)} µm", loc="left")
    for axes in (mean, relative):
        axes.set(xscale="log", yscale="log", xlabel="width of the smooth contact [µm]")
        axes.legend(loc="best")
    return figure


def _draw_bias(
    axes: Axes, width: np.ndarray, bias: np.ndarray, colour: str, label: str, *, row: int = 0
) -> None:
    size = np.abs(bias)
    shown = size > _ROUNDING * np.max(size)
    axes.plot(width[shown], size[shown], marker="os"[row], ms=4, color=colour, label=label)
    if not np.all(shown):
        axes.plot(
            width[~shown],
            np.full(np.count_nonzero(~shown), 0.03 + 0.05 * row),
            "v",
            ms=5,
            color=colour,
            mfc="none",
            label=f"{label}: zero",
            transform=axes.get_xaxis_transform(),
        )


# Biases this far below the largest are differences of equal numbers.
_ROUNDING = 1e-11


@_house_look()
def master_curve(
    chart: Any, valley: Any, closed_form_um: np.ndarray, path: np.ndarray, title: str
) -> Figure:
    """RMS of the TE over depth and extent of tip relief, with the curves of least TE.

    **Arguments:**

    - `chart`: an `optimise.ReliefMap` of the RMS in um.
    - `valley`: its `optimise.Valley`.
    - `closed_form_um`: depth of the closed form at each extent of the chart, or NaN [um].
    - `path`: points of a search, rows of depth [um] and extent [-]; may have no rows.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((7.6, 5.8), f"Master Curve map: {title}")
    depth = chart.depth / um
    levels = _levels(chart.value)
    surface = axes.contourf(
        chart.extent,
        depth,
        chart.value,
        levels=levels,
        cmap=_SURFACE,
        extend="min",
        norm=BoundaryNorm(levels, 256, extend="min"),
    )
    surface.set_edgecolor("face")
    axes.grid(False)
    figure.colorbar(
        surface, ax=axes, label="RMS of the transmission error [µm]", ticks=levels, format="%.3g"
    )
    outlined = {"lw": 2.0, "path_effects": [withStroke(linewidth=3.4, foreground="black")]}
    inside = np.where(closed_form_um <= np.max(depth), closed_form_um, np.nan)
    for curve, colour, style, label in (
        (_unbroken_valley(valley, chart) / um, "white", "-", "valley, computed"),
        (inside, _ORANGE, "--", "closed form"),
    ):
        if np.isfinite(curve).any():
            axes.plot(chart.extent, curve, color=colour, ls=style, label=label, **outlined)
    if len(path):
        axes.plot(path[:, 1], path[:, 0], ".-", color=_PINK, lw=1.1, ms=5, label="search")
        for row, marker, size, label in ((0, "o", 7, "its start"), (-1, "*", 14, "its end")):
            place = path[row, ::-1]
            axes.plot(*place, marker, color=_PINK, mec="black", ms=size, label=label, ls="")
    axes.set(
        xlabel="extent of the tip relief over the path of contact [-]",
        ylabel="depth of the tip relief [µm]",
        xlim=(float(np.min(chart.extent)), float(np.max(chart.extent))),
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


def _unbroken_valley(valley: Any, chart: Any) -> np.ndarray:
    """Depth of the valley where it means something, else NaN [m].

    That is where the best depth lies within the map and halves the response, and it ends where the
    best depth jumps from one valley to another.
    """
    low, high = np.min(chart.depth), np.max(chart.depth)
    room = 1e-6 * (high - low)
    within = (valley.depth > low + room) & (valley.depth < high - room)
    within &= valley.value < 0.5 * chart.value[0]
    jump = np.abs(np.diff(valley.depth, prepend=valley.depth[0])) > 0.3 * (high - low)
    return np.where(within & ~jump, valley.depth, np.nan)


@_house_look()
def search_trace(values_by_method: Mapping[str, np.ndarray], unit: str, title: str) -> Figure:
    """Best value so far over the number of evaluations, for several searches.

    **Arguments:**

    - `values_by_method`: objective at each evaluation, in order, under the search's name.
    - `unit`: of the objective.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((7.2, 4.4), f"Searches: {title}")
    colours = (_BLUE, _ORANGE, _GREEN, _RED, _SKY)
    best_values = [np.minimum.accumulate(values) for values in values_by_method.values()]
    for index, (name, best) in enumerate(zip(values_by_method, best_values, strict=True)):
        colour = colours[index % len(colours)]
        count = np.arange(1, len(best) + 1)
        axes.step(
            count,
            best,
            where="post",
            color=colour,
            label=f"{name}: {best[-1]:.4g} {unit} after {len(best)}",
        )
        axes.plot(count[-1], best[-1], "o", ms=5, color=colour)
    every = np.concatenate(best_values)
    if np.min(every) > 0.0 and np.max(every) > 20.0 * np.min(every):
        axes.set_yscale("log")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(left=0.9)
    axes.set(xlabel="evaluations of the objective [-]", ylabel=f"best objective so far [{unit}]")
    axes.legend(loc="upper right")
    return figure


@_house_look()
def before_after(dataset_before: xr.Dataset, dataset_after: xr.Dataset, title: str) -> Figure:
    """What an optimisation changed: transmission error and largest flank pressure.

    **Arguments:**

    - `dataset_before`: from `static_dataset`.
    - `dataset_after`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (error, pressure) = _panels((9.6, 4.2), f"Before and after: {title}", 2)
    cases = (("before", dataset_before, _ORANGE, "--"), ("after", dataset_after, _BLUE, "-"))
    for name, dataset, colour, style in cases:
        own = dataset["phase"].values
        phase, values = _unrolled(own, dataset["transmission_error_um"].values)
        mean, rms, _ = cycle_statistics(dataset["transmission_error_um"])
        error.plot(
            phase,
            values - mean,
            color=colour,
            ls=style,
            lw=_thin(own),
            label=f"{name}: mean {_digits(mean, 4)} µm, RMS {_digits(rms, 3)} µm",
        )
        most = _largest_pressure(dataset)
        pressure.plot(
            *_unrolled(own, most),
            color=colour,
            ls=style,
            lw=_thin(own),
            label=f"{name}: at most {_digits(np.max(most), 4)} MPa",
        )
    _phase_axis(error, "transmission error less its mean [µm]", dataset_after["phase"].values)
    _phase_axis(pressure, "largest flank pressure [MPa]", dataset_after["phase"].values)
    for axes in (error, pressure):
        # Room for the legend above the curves.
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.3 * (high - low))
        axes.legend(loc="upper center")
    return figure
