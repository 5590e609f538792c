"""The picture of the sizing table."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from jaxgear.plot._cycle_pictures import torque_bar, torque_colours
from jaxgear.plot._palette import GREY, PINK
from jaxgear.plot._style import SURFACE, digits, house_look, titled

# Largest number of values that are written into a map, and of combinations in a chart.
_WRITTEN, _RANKS_SHOWN = 120, 20


@house_look()
def sizing(dataset: xr.Dataset) -> Figure:
    """What each combination of amounts does to transmission error and pressure.

    One amount at several torques is a map; otherwise the best combinations stand below each other.

    **Arguments:**

    - `dataset`: the group `sizing`.

    **Returns:**

    The figure.
    """
    if dataset.sizes["amount"] == 1 and min(dataset["te_peak_to_peak_um"].shape) > 1:
        return _map_of(dataset)
    return _ranks_of(dataset)


def _labels(dataset: xr.Dataset) -> list[str]:
    """Name and unit of each amount, as on an axis."""
    own = (dataset[key].attrs for key in dataset["amount"].values)
    unit = lambda about: {"1": "-", "um": "µm"}.get(about["units"], about["units"])
    return [f"{about['long_name']} [{unit(about)}]" for about in own]


def _map_of(dataset: xr.Dataset) -> Figure:
    """Peak to peak over amount and torque; a star marks what is best at its worst torque."""
    figure, (axes,) = titled(dataset, "Sizing", (7.6, 5.2))
    (label,) = _labels(dataset)
    amounts = dataset[str(dataset["amount"].values[0])].values
    torques_Nm, te_um = dataset["torque_pinion_Nm"].values, dataset["te_peak_to_peak_um"].values
    rising, upwards = np.argsort(amounts), np.argsort(torques_Nm)
    surface = axes.pcolormesh(
        _cell_edges(amounts[rising]),
        _cell_edges(torques_Nm[upwards]),
        te_um[rising][:, upwards].T,
        cmap=SURFACE,
        vmin=0.0,
        rasterized=True,
    )
    axes.grid(False)
    figure.colorbar(surface, ax=axes, label="peak to peak of the transmission error [µm]")
    worst = float(np.max(te_um[0]))
    axes.plot(
        np.full(len(torques_Nm), amounts[0]),
        torques_Nm,
        "*",
        color=PINK,
        mec="black",
        ms=12,
        label=f"best: {amounts[0]:g}, at most {digits(worst, 3)} µm",
    )
    if te_um.size <= _WRITTEN:
        halo = [withStroke(linewidth=2.2, foreground="black", alpha=0.5)]
        for amount, row in zip(amounts, te_um, strict=True):
            for torque, value in zip(torques_Nm, row, strict=True):
                axes.text(
                    amount,
                    torque,
                    f"\n\n{value:.2f}" if amount == amounts[0] else f"{value:.2f}",
                    ha="center",
                    va="center",
                    color="white",
                    fontsize=8.5,
                    path_effects=halo,
                )
    axes.set(xlabel=label, ylabel="torque on the pinion [N m]")
    figure.legend(loc="outside lower center", frameon=False)
    return figure


def _cell_edges(values: np.ndarray) -> np.ndarray:
    """Edges half-way between rising values, and as far beyond the first and the last."""
    middle = 0.5 * (values[:-1] + values[1:])
    return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


def _ranks_of(dataset: xr.Dataset) -> Figure:
    """The best combinations, one row each: amounts, transmission error and pressure."""
    labels, torques_Nm = _labels(dataset), dataset["torque_pinion_Nm"].values
    amounts = np.stack([dataset[key].values for key in dataset["amount"].values], axis=1)
    te_um, pressure_MPa = (
        dataset[name].values for name in ("te_peak_to_peak_um", "max_pressure_MPa")
    )
    count = min(_RANKS_SHOWN, len(amounts))
    size = (max(9.6, 7.6 + 0.9 * len(labels)), 2.9 + 0.26 * count)
    ratios = (0.25 + 0.3 * len(labels), 1.0, 1.0)
    figure, (table, error, pressure) = titled(dataset, "Sizing", size, 3, ratios)
    rank = np.arange(1, count + 1)
    low, high = np.min(amounts, axis=0), np.max(amounts, axis=0)
    shade = (amounts[:count] - low) / np.where(high > low, high - low, 1.0)
    edges = np.arange(len(labels) + 1) - 0.5, np.arange(count + 1) + 0.5
    table.pcolormesh(*edges, shade, cmap="Blues", vmin=-0.15, vmax=1.6)
    for row in range(count):
        for column in range(len(labels)):
            table.text(column, row + 1, f"{amounts[row, column]:g}", ha="center", va="center")
    table.grid(False)
    table.set_xticks(range(len(labels)), labels, rotation=25, ha="right", fontsize=8.5)
    table.set(ylabel="rank by the worst peak to peak [-]", xlabel="amount [unit as written above]")
    for axes, values in ((error, te_um), (pressure, pressure_MPa)):
        shown = values[:count]
        axes.hlines(rank, np.min(shown, axis=1), np.max(shown, axis=1), color=GREY, lw=1.0)
        colours, norm = torque_colours(torques_Nm)
        for torque, column in zip(torques_Nm, shown.T, strict=True):
            axes.plot(column, rank, "o", ms=5, color=colours(norm(torque)))
    error.set(xlabel="peak to peak of the TE [µm]", xlim=(0.0, None))
    pressure.set(xlabel="largest flank pressure [MPa]")
    for axes in (table, error, pressure):
        axes.set(ylim=(count + 0.5, 0.5), yticks=rank)
    for axes in (error, pressure):
        axes.set_ylabel("rank [-]")
    error.set_title(f"the best {count} of {len(amounts)} combinations", loc="left")
    _write_pressure_ranks(pressure, np.max(pressure_MPa, axis=1), count)
    torque_bar(figure, pressure, torques_Nm)
    return figure


def _write_pressure_ranks(axes: Axes, largest: np.ndarray, count: int) -> None:
    """The rank by pressure at the end of each of the first rows."""
    place = np.argsort(np.argsort(largest, kind="stable"), kind="stable") + 1
    for row in range(count):
        axes.annotate(
            str(place[row]),
            (float(largest[row]), row + 1.0),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
        )
    axes.margins(x=0.12)
    axes.set_title("with the rank by pressure", loc="left")
