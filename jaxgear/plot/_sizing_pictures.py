"""The picture of the sizing table."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from jaxgear.plot._cycle_pictures import torque_bar, torque_colours
from jaxgear.plot._palette import GREY, PINK
from jaxgear.plot._style import axis_label, digits, legend_below, panels, surface, write_at

# Largest number of values that are written into a map, and of combinations in a chart.
_WRITTEN, _RANKS_SHOWN = 120, 20


def sizing(dataset: xr.Dataset) -> Figure:
    """What each combination of amounts does to transmission error and pressure.

    One amount at several torques is a map; otherwise the best combinations stand below each other.
    """
    if dataset.sizes["amount"] == 1 and min(dataset["te_peak_to_peak_um"].shape) > 1:
        return _map_of(dataset)
    return _ranks_of(dataset)


def _map_of(dataset: xr.Dataset) -> Figure:
    """Peak to peak over amount and torque; a star marks what is best at its worst torque."""
    figure, (axes,) = panels("Sizing", dataset, (7.6, 5.2))
    amount = dataset[str(dataset["amount"].values[0])]
    torque, error = dataset["torque_pinion_Nm"], dataset["te_peak_to_peak_um"]
    amounts, torques_Nm, te_um = amount.values, torque.values, error.values
    rising, upwards = np.argsort(amounts), np.argsort(torques_Nm)
    cells = _cell_edges(amounts[rising]), _cell_edges(torques_Nm[upwards])
    area = surface(axes, *cells, te_um[rising][:, upwards], vmin=0.0)
    figure.colorbar(area, ax=axes, label=axis_label(error))
    worst = f"best: {amounts[0]:g}, at most {digits(float(np.max(te_um[0])), 3)} µm"
    best = np.full(len(torques_Nm), amounts[0])
    axes.plot(best, torques_Nm, "*", color=PINK, mec="black", ms=12, label=worst)
    if te_um.size <= _WRITTEN:
        halo = [withStroke(linewidth=2.2, foreground="black", alpha=0.5)]
        look: dict[str, Any] = {"ha": "center", "va": "center", "color": "white", "fontsize": 8.5}
        for (row, column), value in np.ndenumerate(te_um):
            text = f"\n\n{value:.2f}" if amounts[row] == amounts[0] else f"{value:.2f}"
            axes.text(
                float(amounts[row]), float(torques_Nm[column]), text, path_effects=halo, **look
            )
    axes.set(xlabel=axis_label(amount), ylabel=axis_label(torque))
    legend_below(figure)
    return figure


def _cell_edges(values: np.ndarray) -> np.ndarray:
    """Edges half-way between rising values, and as far beyond the first and the last."""
    middle = 0.5 * (values[:-1] + values[1:])
    return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


def _ranks_of(dataset: xr.Dataset) -> Figure:
    """The best combinations, one row each: amounts, transmission error and pressure."""
    varied, torques_Nm = dataset["amount"].values, dataset["torque_pinion_Nm"].values
    labels = [axis_label(dataset[key]) for key in varied]
    amounts = np.stack([dataset[key].values for key in varied], axis=1)
    count = min(_RANKS_SHOWN, len(amounts))
    size = (max(9.6, 7.6 + 0.9 * len(labels)), 2.9 + 0.26 * count)
    ratios = (0.25 + 0.3 * len(labels), 1.0, 1.0)
    figure, (table, *both) = panels("Sizing", dataset, size, 3, width_ratios=ratios)
    rank = np.arange(1, count + 1)
    low, high = np.min(amounts, axis=0), np.max(amounts, axis=0)
    shade = (amounts[:count] - low) / np.where(high > low, high - low, 1.0)
    edges = np.arange(len(labels) + 1) - 0.5, np.arange(count + 1) + 0.5
    table.pcolormesh(*edges, shade, cmap="Blues", vmin=-0.15, vmax=1.6)
    for (row, column), amount in np.ndenumerate(amounts[:count]):
        table.text(column, row + 1, f"{amount:g}", ha="center", va="center")
    table.grid(False)
    table.set_xticks(range(len(labels)), labels, rotation=25, ha="right", fontsize=8.5)
    table.set(ylabel="rank by the worst peak to peak [-]", xlabel="amount [unit as written above]")
    colours, norm = torque_colours(torques_Nm)
    for axes, name in zip(both, ("te_peak_to_peak_um", "max_pressure_MPa"), strict=True):
        shown = dataset[name].values[:count]
        axes.hlines(rank, np.min(shown, axis=1), np.max(shown, axis=1), color=GREY, lw=1.0)
        for torque, column in zip(torques_Nm, shown.T, strict=True):
            axes.plot(column, rank, "o", ms=5, color=colours(norm(torque)))
        axes.set_ylabel("rank [-]")
    error, pressure = both
    error.set(xlabel="peak to peak of the TE [µm]", xlim=(0.0, None))
    pressure.set(xlabel="largest flank pressure [MPa]")
    for axes in (table, error, pressure):
        axes.set(ylim=(count + 0.5, 0.5), yticks=rank)
    error.set_title(f"the best {count} of {len(amounts)} combinations", loc="left")
    _write_pressure_ranks(pressure, np.max(dataset["max_pressure_MPa"].values, axis=1), count)
    torque_bar(figure, pressure, torques_Nm)
    return figure


def _write_pressure_ranks(axes: Axes, largest: np.ndarray, count: int) -> None:
    """The rank by pressure at the end of each of the first rows."""
    place = np.argsort(np.argsort(largest, kind="stable"), kind="stable") + 1
    look = {"ha": "left", "va": "center", "fontsize": 8.5}
    for row in range(count):
        write_at(axes, str(place[row]), (float(largest[row]), row + 1.0), (6, 0), **look)
    axes.margins(x=0.12)
    axes.set_title("with the rank by pressure", loc="left")
