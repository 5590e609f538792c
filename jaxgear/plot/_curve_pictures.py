"""Pictures of curves through many optima: the Master Curve as it was traced, and fronts."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from jaxgear._units import um
from jaxgear.plot._palette import _BLUE, _GREEN, _GREY, _ORANGE, _PINK, _RED, _SKY
from jaxgear.plot._pictures import _house_look, _panels

# An error of depth whose cost is shown.
_MISSED_UM = 2.0


@_house_look()
def traced_curve(traced: Mapping[str, np.ndarray], title: str) -> Figure:
    """The best depth over the extent, what is left there, and how much an error of depth costs.

    **Arguments:**

    - `traced`: part of the summary: extents, depths, RMS, and RMS per error of depth.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    words = f"Master Curve of tip relief: {title}"
    figure, (left, middle, right) = _panels((11.4, 4.2), words, columns=3)
    extent, depth = traced["extent"], traced["depth_um"]
    left.plot(extent, depth, color=_BLUE, label="computed")
    left.plot(extent, traced["closed_form_depth_um"], "--", color=_ORANGE, label="closed form")
    if depth.size:
        left.set_ylim(0.0, 1.4 * float(np.max(depth)))
    left.set(ylabel="best depth of the tip relief [µm]")
    left.set_title("the depth of least TE", loc="left")
    left.legend(loc="best")
    middle.plot(extent, traced["te_rms_um"], color=_BLUE)
    middle.set(ylabel="RMS of the transmission error [µm]")
    middle.set_ylim(bottom=0.0)
    middle.set_title("what is left at that depth", loc="left")
    right.plot(extent, traced["te_rms_um"], color=_BLUE, label="best depth")
    # The mean square has its least value at the best depth, and is a parabola about it.
    off = np.hypot(traced["te_rms_um"], _MISSED_UM * np.asarray(traced["te_rms_per_depth"]))
    right.plot(extent, off, "--", color=_GREEN, label=f"{_MISSED_UM:g} µm more or less")
    right.set(ylabel="RMS of the transmission error [µm]")
    right.set_ylim(bottom=0.0)
    right.set_title("what an error of depth costs", loc="left")
    right.legend(loc="best")
    for axes in (left, middle, right):
        axes.set(xlabel="extent over the path of contact [-]")
    return figure


@_house_look()
def family(chart: Any, curves: Sequence[Mapping[str, Any]], title: str) -> Figure:
    """The curves of several torques on the map of one, and how much an error of depth costs.

    **Arguments:**

    - `chart`: an `optimise.ReliefMap` of the RMS in um.
    - `curves`: parts of the summary, each with its torque.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    words = f"Master Curves of tip relief at several torques: {title}"
    figure, (left, right) = _panels((10.6, 4.8), words, columns=2, ratios=(1.35, 1.0))
    # Light, so that the curves stand out.
    pale = {"cmap": "Greys", "vmin": 0.0, "vmax": 1.6 * float(np.max(chart.value))}
    surface = left.contourf(chart.extent, chart.depth / um, chart.value, levels=12, **pale)
    surface.set_edgecolor("face")
    left.grid(False)
    figure.colorbar(surface, ax=left, label="RMS of the transmission error [µm]", format="%.3g")
    colours = _shades(len(curves))
    for colour, curve in zip(colours, curves, strict=True):
        label = f"{curve['torque_Nm']:g} N m"
        left.plot(curve["extent"], curve["depth_um"], color=colour, lw=2.2, label=label)
        left.plot(curve["extent"], curve["closed_form_depth_um"], "--", color=colour, lw=1.2)
        right.plot(curve["extent"], curve["te_rms_per_depth"], color=colour, label=label)
    left.plot([], [], "--", color=_GREY, lw=1.2, label="closed form")
    deepest = float(chart.depth[-1]) / um
    left.set(ylabel="depth of the tip relief [µm]", ylim=(float(chart.depth[0]) / um, deepest))
    right.set(ylabel="RMS that an error of depth adds, over it [µm/µm]")
    right.set_ylim(bottom=0.0)
    for axes in (left, right):
        axes.set(xlabel="extent over the path of contact [-]")
        axes.set_xlim(float(chart.extent[0]), float(chart.extent[-1]))
        axes.locator_params(axis="x", nbins=5)
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)
    return figure


@_house_look()
def several_curves(
    curves: Mapping[str, Mapping[str, np.ndarray]], title: str
) -> tuple[Figure, dict[str, np.ndarray]]:
    """Master Curves of several pairs: each over its extents, and over its own closed form.

    **Arguments:**

    - `curves`: by label; `extent` [-], `depth` and `closed` [um], `rms` [um], `steep` [-].
    - `title`: the case or the finding.

    **Returns:**

    The figure, and its data as columns.
    """
    figure, (left, middle, right) = _panels((12.0, 4.6), title, columns=3)
    colours = (_BLUE, _ORANGE, _GREEN, _RED, _SKY, _GREY, _PINK)
    for i, (label, curve) in enumerate(curves.items()):
        style: dict[str, Any] = {
            "color": colours[i % len(colours)],
            "marker": ".",
            "ls": ("-", "--")[i % 2],
        }
        left.plot(curve["extent"], curve["depth"], label=label, **style)
        middle.plot(curve["extent"], curve["depth"] / curve["closed"], **style)
        right.plot(curve["extent"], curve["steep"], **style)
    middle.axhline(1.0, color=_GREY, lw=1.0)
    left.set(ylabel="best depth of the tip relief [µm]")
    middle.set(ylabel="depth over the closed form's [-]")
    right.set(ylabel="RMS over error of depth [µm/µm]")
    left.set_ylim(bottom=0.0)
    for axes in (left, middle, right):
        axes.set(xlabel="extent over the path of contact [-]")
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    names = ("extent", "depth", "rms", "steep", "closed")
    every = list(curves.items())
    columns = {name: np.concatenate([curve[name] for _, curve in every]) for name in names}
    labels = np.concatenate([np.full(len(curve["extent"]), label) for label, curve in every])
    return figure, {"pair": labels} | columns


def _shades(count: int) -> list[Any]:
    """Colours from the least to the most of something."""
    return [matplotlib.colormaps["viridis"](x) for x in np.linspace(0.0, 0.85, count)]


@_house_look()
def pareto(front: Any, names: Sequence[tuple[str, str]], title: str) -> Figure:
    """One number of designs over another, the designs that count joined.

    **Arguments:**

    - `front`: an `optimise.ParetoFront`.
    - `names`: of both numbers, with their units.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((6.4, 4.8), f"Designs that trade one number for another: {title}")
    curve, beaten = front.front, front.dominated
    axes.plot(curve[:, 1], curve[:, 0], "o-", color=_BLUE, label="front")
    style: dict[str, Any]
    if (lost := beaten & front.kept).any():
        style = {"marker": "s", "ls": "", "mfc": "none", "color": _GREY}
        axes.plot(front.value[lost, 1], front.value[lost, 0], label="dominated", **style)
    if (~front.kept).any():
        lost, style = ~front.kept, {"marker": "x", "ls": "", "color": _RED}
        axes.plot(front.value[lost, 1], front.value[lost, 0], label="beyond a limit", **style)
    for each in (axes.xaxis, axes.yaxis):
        each.set_major_formatter(FuncFormatter(lambda x, _: f"{x:.6g}"))
    first, second = (_axis_of(name, unit) for name, unit in names)
    axes.set(xlabel=second, ylabel=first)
    axes.legend(loc="best")
    return figure


_SPOKEN = {
    "te_rms": "RMS of the transmission error",
    "te_peak_to_peak": "peak to peak of the transmission error",
    "te_harmonics": "mesh harmonics of the transmission error",
    "max_pressure": "largest flank pressure",
    "face_load_factor": "face load factor",
    "pressure_offset": "squared offset of the pressure",
    "dynamic_ratio": "dynamic ratio",
    "bearing_force": "RMS of the bearing forces",
    "weighted": "weighted objective",
}


def _axis_of(name: str, unit: str) -> str:
    return f"{_SPOKEN[name]} [{unit.replace('um', 'µm').replace('2', '²')}]"
