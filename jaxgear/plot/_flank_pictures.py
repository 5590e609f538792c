"""Pictures of flanks at speed: pressure on one tooth's way, and what each tooth carries."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from jaxgear.plot._hybrid_pictures import HOLE, tooth_axis
from jaxgear.plot._palette import BLUE, GREY, RED, TEETH_SERIES
from jaxgear.plot._speed_axes import dots
from jaxgear.plot._style import (
    axis_label,
    digits,
    legend_below,
    over_face,
    over_steps,
    panels,
    surface,
)


def flank_pressure(dataset: xr.Dataset) -> Figure:
    """Pressure on the most loaded tooth pair from its entry to its exit, at some speeds.

    All are of one scale.
    """
    count = dataset.sizes["shown"]
    figure, row = panels("Pressure on the flank", dataset, (3.6 * count + 1.6, 4.4), count)
    figure.suptitle(f"Pressure on the flank: {dataset.attrs['title']}: the most loaded tooth pair")
    most = float(dataset["pressure_MPa"].max())
    for place, axes in enumerate(row):
        own = dataset.isel(shown=place).dropna("step", subset=["passage"])
        pressure, steps = own["pressure_MPa"].values, over_steps(own["passage"].values)
        area = surface(axes, steps, over_face(dataset), pressure, vmin=0.0, vmax=most)
        speed, largest = own["pinion_speed_rad_s"].item(), digits(float(pressure.max()), 4)
        axes.set_title(f"{speed:.5g} rad/s: largest {largest} MPa", loc="left")
        axes.set(xlabel="since entry at mid-face [mesh periods]")
    row[0].set_ylabel("position from mid-face [mm]")
    figure.colorbar(area, ax=row, label="pressure [MPa]")
    return figure


def largest_loads(dataset: xr.Dataset) -> Figure:
    """Largest line load and pressure over speed, and where on the flank it is."""
    figure, (left, right) = panels("Largest loads on the flank", dataset, (10.6, 4.6), 2)
    load, pressure, passage, face = (
        dataset[f"max_{name}"].values
        for name in ("line_load_N_mm", "pressure_MPa", "line_load_passage", "line_load_face_mm")
    )
    reach = 1.2 * max(float(np.abs(face).max()), 0.1)
    upwards = lambda values, room: (0.0, room * float(np.nanmax(values)))
    dot = dots(dataset["speed"].values)
    looks: list[dict[str, Any]] = [
        {"marker": dot, "ms": 3, "color": BLUE},
        {"marker": dot, "ms": 3, "color": RED, "ls": "--"},
        {"marker": "o", "ms": 3, "ls": "", "color": BLUE},
        {"marker": "x", "ms": 4, "ls": "", "color": GREY},
    ]
    shown = (
        (left, load, "largest line load [N/mm]", upwards(load, 1.1)),
        (left.twinx(), pressure, "largest pressure [MPa]", upwards(pressure, 1.1)),
        (right, passage, "mesh periods since entry at mid-face", upwards(passage, 1.2)),
        (right.twinx(), face, "position from mid-face [mm]", (-reach, reach)),
    )
    for (axes, values, label, limits), look in zip(shown, looks, strict=True):
        axes.plot(dataset["speed"].values, values, **look)
        axes.set_ylabel(label, color=look["color"])
        axes.set_ylim(limits)
        axes.grid(axes in (left, right))
    left.set_title("largest on the flank", loc="left")
    right.set_title("where the largest line load is", loc="left")
    for axes in (left, right):
        axes.set_xlabel(axis_label(dataset["speed"]))
    return figure


def teeth_at_speed(dataset: xr.Dataset, gear: str) -> Figure:
    """Largest line load of each tooth over their mean at some speeds, with holes in the web."""
    figure, (axes,) = panels("What each tooth carries", dataset, (9.6, 4.4))
    own = dataset.sortby(f"{gear}_tooth_angle_deg")
    angle = own[f"{gear}_tooth_angle_deg"].values
    tooth_axis(axes, dataset, gear, angle, f"{gear}_hole_angle_deg")
    speeds, loads = own["pinion_speed_rad_s"].values, own["line_load_max_N_mm"].values
    for number, (speed, load) in enumerate(zip(speeds, loads, strict=True)):
        mean = float(np.mean(load))
        colour = TEETH_SERIES[number % len(TEETH_SERIES)]
        label = f"{speed:.5g} rad/s, mean {digits(mean, 4)} N/mm"
        axes.plot(angle, load / mean, "o-", ms=4, color=colour, label=label)
    axes.set_ylabel("largest line load of a tooth,\nover the mean of all")
    handles, labels = axes.get_legend_handles_labels()
    if dataset.sizes[f"{gear}_hole"] > 0:
        handles, labels = [*handles, Patch(color=HOLE)], [*labels, "above a hole"]
    legend_below(figure, handles, labels, ncols=2)
    return figure
