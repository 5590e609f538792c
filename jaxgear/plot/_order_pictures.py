"""Pictures of orders of the mesh over speed: as rays of a spectrum, and as lines."""

import itertools
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap, LogNorm
from matplotlib.figure import Figure

from jaxgear import _units
from jaxgear.plot._palette import BLUE, GREY
from jaxgear.plot._speed_axes import (
    SERIES,
    dots,
    frequency_unit,
    mark_unsettled,
    scaled,
    speed_axes,
    speed_edges,
    stack,
)
from jaxgear.plot._style import BOX, house_look, lay_out, panels

# Amplitudes below this share of the largest are left out.
_FLOOR = 1e-3
_PANELS = {
    "te_order_um": "amplitude of\nthe TE [µm]",
    "mesh_force_order_N": "amplitude of the\nmesh force [N]",
    "bearing_force_order_N": "amplitude of bearing\nforces [N]",
}


@house_look()
def waterfall(dataset: xr.Dataset) -> Figure:
    """Amplitude of the dynamic TE over frequency and pinion speed: one ray for each order.

    **Arguments:**

    - `dataset`: one direction of the group `sweep`.
    """
    figure, (axes,) = panels((9.6, 6.2), f"Spectrum of the TE over speed: {dataset.attrs['title']}")
    speed, order = dataset["speed"].values, dataset["order"].values
    amplitude = dataset["te_order_um"].values
    mesh = float(dataset.attrs["teeth_pinion"]) * speed / (2.0 * np.pi)
    most = max(float(np.max(amplitude, initial=0.0)), 1e-12)
    norm = LogNorm(most * _FLOOR, most)
    colours = _dark_where_large()
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
    rpm = axes.secondary_yaxis("right", functions=scaled(1.0 / _units.rpm))
    rpm.set_ylabel("pinion speed [rpm]")
    bar = figure.colorbar(
        ScalarMappable(norm, colours), ax=axes, label="amplitude of the TE [µm]", pad=0.02
    )
    bar.ax.grid(False)
    _write_orders(axes, order, mesh[-1] / speed[-1] / unit)
    _mark_natural(axes, dataset, unit)
    if unsettled := mark_unsettled(axes, dataset, upright=True):
        figure.legend(handles=unsettled, loc="outside lower center", frameon=False)
    return figure


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
            color=GREY,
            bbox=None if above else {**BOX, "alpha": 1.0},
            zorder=4,
        )
    axes.set_title("orders of the mesh frequency", loc="left", fontsize=9, color=GREY, pad=14)


def _mark_natural(axes: Axes, dataset: xr.Dataset, unit: float) -> None:
    """Upright lines at excited modes, with their numbers at the head of the axes."""
    right = axes.get_xlim()[1]
    modes = zip(dataset["excited_frequency_Hz"].values, dataset["excited_mode"].values, strict=True)
    for frequency, number in modes:
        if not 0.0 < frequency / unit < right:
            continue
        axes.axvline(frequency / unit, color=BLUE, lw=0.9, ls=(0, (4, 2)), zorder=3.0)
        axes.annotate(
            f"mode {number}",
            (frequency / unit, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, -4),
            textcoords="offset points",
            rotation=90,
            ha="center",
            va="top",
            fontsize=8.5,
            color=BLUE,
            bbox={**BOX, "alpha": 1.0},
            zorder=5,
        )


_ORDERS_SHOWN = 5
# Of orders between those of the mesh as many as there are dotted lines to tell apart.
_BETWEEN = (":", (0, (5, 1, 1, 1)), (0, (5, 1, 1, 1, 1, 1)))


@house_look()
def orders(dataset: xr.Dataset) -> Figure:
    """Amplitudes of the first orders over pinion speed: TE, mesh force and bearing forces.

    Orders between those of the mesh, which a response over several mesh periods has, are dotted.

    **Arguments:**

    - `dataset`: one direction of the group `sweep`.
    """
    names = [name for name in _PANELS if name in dataset]
    title, size = f"Orders over speed: {dataset.attrs['title']}", (9.6, 1.8 + 2.1 * len(names))
    figure, panels = stack(size, title, [1.0] * len(names))
    for axes, name in zip(panels, names, strict=True):
        if name == "bearing_force_order_N":
            most = _draw_bearing_orders(axes, dataset)
        else:
            most = _draw_orders(axes, dataset, name)
        axes.set_ylabel(_PANELS[name])
        if most > 0.0:
            axes.set(yscale="log", ylim=(2e-4 * most, 1.8 * most))
        else:
            axes.set_ylim(0.0, 1.0)
        axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.0), borderaxespad=0, frameon=False)
    figure.align_ylabels(panels)
    speed_axes(panels, dataset["speed"].values, int(dataset.attrs["teeth_pinion"]))
    if unsettled := mark_unsettled(panels[0], dataset, upright=False):
        figure.legend(handles=unsettled, loc="outside lower center", frameon=False)
    return figure


def _is_whole(order: float) -> bool:
    return bool(abs(order - round(order)) < 1e-9)


def _draw_orders(axes: Axes, dataset: xr.Dataset, name: str) -> float:
    """The first orders of one quantity, and the largest amplitude."""
    speed, order, amplitude = (dataset[each].values for each in ("speed", "order", name))
    most = float(np.max(amplitude, initial=0.0))
    colours, dashes = itertools.cycle(SERIES), itertools.cycle(_BETWEEN)
    between = [x for x in range(len(order)) if not _is_whole(order[x])]
    strongest = sorted(between, key=lambda x: -float(np.max(amplitude[:, x])))[: len(_BETWEEN)]
    for row, (value, column) in enumerate(zip(order, amplitude.T, strict=True)):
        whole = _is_whole(value)
        heard = row in strongest and np.max(column) > 0.01 * most
        if not (whole and value <= _ORDERS_SHOWN) and not heard:
            continue
        colour = next(colours) if whole else GREY
        style: dict[str, Any] = {"lw": 1.4 if whole else 1.1, "marker": dots(speed), "ms": 3}
        style["ls"] = "-" if whole else next(dashes)
        label = f"order {value:.3g}"
        axes.plot(speed, _seen(column, most), color=colour, label=label, **style)
    return most


def _draw_bearing_orders(axes: Axes, dataset: xr.Dataset) -> float:
    """The first two whole orders of each bearing's force, and the largest amplitude."""
    most = 0.0
    speed, order = dataset["speed"].values, dataset["order"].values
    force = dataset["bearing_force_order_N"].transpose("bearing", "speed", "order").values
    for row, (name, amplitude) in enumerate(zip(dataset["bearing"].values, force, strict=True)):
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
                    marker=dots(speed),
                    ms=3,
                )
    for value, style in ((1, "-"), (2, (0, (4, 2)))):
        axes.plot([], [], color=GREY, ls=style, label=f"order {value}")
    return most


def _seen(values: np.ndarray, most: float) -> np.ndarray:
    """Amplitudes without those that a logarithmic axis cannot show."""
    return np.where(values > 1e-12 * most, values, np.nan)
