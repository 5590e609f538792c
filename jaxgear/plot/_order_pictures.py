"""Pictures of orders of the mesh over speed: as rays of a spectrum, and as lines."""

import itertools
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure

from jaxgear import _units
from jaxgear.plot._palette import BLUE, GREY, SERIES
from jaxgear.plot._speed_axes import (
    dots,
    frequency_unit,
    mark_unsettled,
    scaled,
    speed_axes,
    speed_edges,
    stack,
)
from jaxgear.plot._style import BOX, laid_out, legend_below, panels, write_at

# Amplitudes below this share of the largest are left out.
_FLOOR = 1e-3
_PANELS = {
    "te_order_um": "amplitude of\nthe TE [µm]",
    "mesh_force_order_N": "amplitude of the\nmesh force [N]",
    "bearing_force_order_N": "amplitude of bearing\nforces [N]",
}


def waterfall(dataset: xr.Dataset) -> Figure:
    """Amplitude of the dynamic TE over frequency and pinion speed: one ray for each order."""
    figure, (axes,) = panels("Spectrum of the TE over speed", dataset, (9.6, 6.2))
    speed, order = dataset["speed"].values, dataset["order"].values
    amplitude = dataset["te_order_um"].values
    mesh = float(dataset.attrs["teeth_pinion"]) * speed / (2.0 * np.pi)
    most = max(float(np.max(amplitude, initial=0.0)), 1e-12)
    norm = LogNorm(most * _FLOOR, most)
    # They end in black, and begin dark enough to be seen on white.
    colours = ListedColormap(matplotlib.colormaps["magma_r"](np.linspace(0.12, 1.0, 256)))
    reach = _highest_frequency(mesh, order, amplitude / most)
    unit, name = frequency_unit(reach)
    edges = speed_edges(speed)
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
        look: dict[str, Any] = {"norm": norm, "cmap": colours, "capstyle": "butt", "zorder": 2.0}
        look["linewidths"] = 1.0 + 6.0 * (1.0 - np.log(size[heard] / most) / np.log(_FLOOR))
        rays = LineCollection(list(np.stack(stretch, axis=1)[heard]), array=size[heard], **look)
        rays.set_rasterized(True)
        axes.add_collection(rays)
    axes.set(xlim=(0.0, reach / unit), ylim=(bottom, top))
    axes.set(xlabel=f"frequency [{name}]", ylabel="pinion speed [rad/s]")
    rpm = axes.secondary_yaxis("right", functions=scaled(1.0 / _units.rpm))
    rpm.set_ylabel("pinion speed [rpm]")
    label = "amplitude of the TE [µm]"
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=axes, label=label, pad=0.02)
    bar.ax.grid(False)
    _write_orders(axes, order, mesh[-1] / speed[-1] / unit)
    _mark_natural(axes, dataset, unit)
    legend_below(figure, mark_unsettled(axes, dataset, upright=True))
    return figure


def _highest_frequency(mesh: np.ndarray, order: np.ndarray, relative: np.ndarray) -> float:
    """Where the picture ends: beyond the last amplitude of 1% of the largest [Hz]."""
    frequency = mesh[:, None] * order
    heard = np.max(frequency[relative > 0.01], initial=0.0)
    every = float(np.max(frequency))
    return min(every, max(1.05 * heard, min(3.0 * float(mesh[-1]), every)))


def _write_orders(axes: Axes, order: np.ndarray, slope: float) -> None:
    """The number of each order at the end of its ray, above or at the right of the axes."""
    (_, right), (_, top) = axes.get_xlim(), axes.get_ylim()
    scale = laid_out(axes)
    last = np.full(2, np.inf)
    look: dict[str, Any] = {"fontsize": 8.5, "color": GREY, "zorder": 4}
    for value in order:
        end = min(slope * value * top, right), min(top, right / (slope * value))
        above = slope * value * top <= right
        place = scale * axes.transData.transform(end)
        text = f"{value:.3g}"
        if np.hypot(*(place - last)) < (8.0 + 5.0 * len(text) if above else 12.0):
            continue
        last = place
        if above:
            write_at(axes, text, end, (0, 2), va="bottom", **look)
        else:
            inside = {"ha": "right", "va": "center", "bbox": {**BOX, "alpha": 1.0}}
            write_at(axes, text, end, (-3, 0), **inside, **look)
    axes.set_title("orders of the mesh frequency", loc="left", fontsize=9, color=GREY, pad=14)


def _mark_natural(axes: Axes, dataset: xr.Dataset, unit: float) -> None:
    """Upright lines at excited modes, with their numbers at the head of the axes."""
    right = axes.get_xlim()[1]
    look: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "rotation": 90, "va": "top"}
    look |= {"fontsize": 8.5, "color": BLUE, "bbox": {**BOX, "alpha": 1.0}, "zorder": 5}
    modes = zip(dataset["excited_frequency_Hz"].values, dataset["excited_mode"].values, strict=True)
    for frequency, number in modes:
        if 0.0 < frequency / unit < right:
            axes.axvline(frequency / unit, color=BLUE, lw=0.9, ls=(0, (4, 2)), zorder=3.0)
            write_at(axes, f"mode {number}", (frequency / unit, 1.0), (0, -4), **look)


_ORDERS_SHOWN = 5
# Of orders between those of the mesh as many as there are dotted lines to tell apart.
_BETWEEN = (":", (0, (5, 1, 1, 1)), (0, (5, 1, 1, 1, 1, 1)))


def orders(dataset: xr.Dataset) -> Figure:
    """Amplitudes of the first orders over pinion speed: TE, mesh force and bearing forces.

    Orders between those of the mesh, which a response over several mesh periods has, are dotted.
    """
    names = [name for name in _PANELS if name in dataset]
    size = (9.6, 1.8 + 2.1 * len(names))
    figure, column = stack("Orders over speed", dataset, size, [1.0] * len(names))
    for axes, name in zip(column, names, strict=True):
        draw = _draw_bearing_orders if name == "bearing_force_order_N" else _draw_orders
        draw(axes, dataset, name)
        axes.set_ylabel(_PANELS[name])
        most = float(dataset[name].max())
        if most > 0.0:
            axes.set(yscale="log", ylim=(2e-4 * most, 1.8 * most))
        else:
            axes.set_ylim(0.0, 1.0)
        axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.0), borderaxespad=0, frameon=False)
    figure.align_ylabels(column)
    speed_axes(column, dataset["speed"].values, int(dataset.attrs["teeth_pinion"]))
    legend_below(figure, mark_unsettled(column[0], dataset, upright=False))
    return figure


def _draw_orders(axes: Axes, dataset: xr.Dataset, name: str) -> None:
    """The first orders of one quantity."""
    order, amplitude = dataset["order"].values, dataset[name].values
    most = float(np.max(amplitude, initial=0.0))
    colours, dashes = itertools.cycle(SERIES), itertools.cycle(_BETWEEN)
    is_whole = np.abs(order - np.round(order)) < 1e-9
    between = np.flatnonzero(~is_whole)
    strongest = sorted(between, key=lambda x: -float(np.max(amplitude[:, x])))[: len(_BETWEEN)]
    for row, (value, column) in enumerate(zip(order, amplitude.T, strict=True)):
        whole = is_whole[row]
        heard = row in strongest and np.max(column) > 0.01 * most
        if (whole and value <= _ORDERS_SHOWN) or heard:
            look: dict[str, Any] = {"color": next(colours) if whole else GREY}
            look |= {"lw": 1.4 if whole else 1.1}
            look |= {"ls": "-" if whole else next(dashes), "label": f"order {value:.3g}"}
            _draw_order(axes, dataset, column, most, **look)


def _draw_bearing_orders(axes: Axes, dataset: xr.Dataset, name: str) -> None:
    """The first two whole orders of each bearing's force."""
    styles = {1: ("-", 1.4), 2: ((0, (4, 2)), 1.0)}
    force = dataset[name].transpose("bearing", "speed", "order").values
    for row, (bearing, amplitude) in enumerate(zip(dataset["bearing"].values, force, strict=True)):
        for value, (style, width) in styles.items():
            look = {"color": SERIES[row % len(SERIES)], "ls": style, "lw": width}
            look["label"] = str(bearing) if value == 1 else None
            for column in amplitude.T[np.isclose(dataset["order"].values, value)]:
                _draw_order(axes, dataset, column, float(np.max(amplitude)), **look)
    for value, (style, _) in styles.items():
        axes.plot([], [], color=GREY, ls=style, label=f"order {value}")


def _draw_order(
    axes: Axes, dataset: xr.Dataset, values: np.ndarray, most: float, **look: Any
) -> None:
    """Amplitudes over speed, without those that a logarithmic axis cannot show."""
    speed = dataset["speed"].values
    seen = np.where(values > 1e-12 * most, values, np.nan)
    axes.plot(speed, seen, marker=dots(speed), ms=3, **look)
