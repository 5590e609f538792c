"""Pictures of flanks at speed: pressure on one tooth's way, and what each tooth carries."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, RED, SKY
from jaxgear.plot._style import SURFACE, digits, house_look, panels

_SERIES = (BLUE, ORANGE, GREEN, RED, SKY, GREY)
_HOLE = "#e3e3e3"


@house_look()
def flank_pressure(dataset: xr.Dataset) -> Figure:
    """Pressure on the most loaded tooth pair from its entry to its exit, at some speeds.

    **Arguments:**

    - `dataset`: the group `flanks`.

    **Returns:**

    The figure; all row are of one scale.
    """
    words = f"Pressure on the flank: {dataset.attrs['title']}: the most loaded tooth pair"
    count = dataset.sizes["shown"]
    figure, axes_row = panels((3.6 * count + 1.6, 4.4), words, count)
    most, half = float(dataset["pressure_MPa"].max()), 0.5 * dataset.attrs["face_width_mm"]
    face = np.linspace(-half, half, dataset.sizes["slice"] + 1)
    for row, axes in enumerate(axes_row):
        own = dataset.isel(shown=row).dropna("step", subset=["passage"])
        passage, pressure = own["passage"].values, own["pressure_MPa"].values
        middle = 0.5 * (passage[1:] + passage[:-1])
        steps = np.concatenate([[1.5 * passage[0] - 0.5 * passage[1]], middle, passage[-1:]])
        area = axes.pcolormesh(
            steps, face, pressure.T, cmap=SURFACE, vmin=0.0, vmax=most, rasterized=True
        )
        axes.grid(False)
        speed, largest = own["pinion_speed_rad_s"].item(), digits(float(pressure.max()), 4)
        axes.set_title(f"{speed:.5g} rad/s: largest {largest} MPa", loc="left")
        axes.set(xlabel="since entry at mid-face [mesh periods]")
    axes_row[0].set_ylabel("position from mid-face [mm]")
    figure.colorbar(area, ax=axes_row, label="pressure [MPa]")
    return figure


@house_look()
def largest_loads(dataset: xr.Dataset) -> Figure:
    """Largest line load and pressure over speed, and where on the flank it is.

    **Arguments:**

    - `dataset`: one direction of the group `waves`.
    """
    title = f"Largest loads on the flank: {dataset.attrs['title']}"
    figure, (left, right) = panels((10.6, 4.6), title, 2)
    speed = dataset["speed"].values
    mark = "o" if speed.size < 40 else ""
    left.plot(speed, dataset["max_line_load_N_mm"].values, marker=mark, ms=3, color=BLUE)
    left.set_ylabel("largest line load [N/mm]", color=BLUE)
    beside = left.twinx()
    beside.plot(speed, dataset["max_pressure_MPa"].values, marker=mark, ms=3, color=RED, ls="--")
    beside.set_ylabel("largest pressure [MPa]", color=RED)
    beside.grid(False)
    for axes, name in ((left, "max_line_load_N_mm"), (beside, "max_pressure_MPa")):
        axes.set_ylim(0.0, 1.1 * float(np.nanmax(dataset[name].values)))
    right.plot(speed, dataset["max_line_load_passage"].values, "o", ms=3, color=BLUE)
    right.set_ylabel("mesh periods since entry at mid-face", color=BLUE)
    across = right.twinx()
    across.plot(speed, dataset["max_line_load_face_mm"].values, "x", ms=4, color=GREY)
    across.set_ylabel("position from mid-face [mm]", color=GREY)
    reach = 1.2 * max(float(np.abs(dataset["max_line_load_face_mm"].values).max()), 0.1)
    across.set_ylim(-reach, reach)
    right.set_ylim(0.0, 1.2 * float(dataset["max_line_load_passage"].values.max()))
    across.grid(False)
    left.set_title("largest on the flank", loc="left")
    right.set_title("where the largest line load is", loc="left")
    for axes in (left, right):
        axes.set_xlabel("speed of the pinion [rad/s]")
    return figure


@house_look()
def teeth_at_speed(dataset: xr.Dataset, gear: str) -> Figure:
    """Largest line load of each tooth at some speeds, with the places of holes in the web.

    **Arguments:**

    - `dataset`: the group `flanks`, of several mesh periods.
    - `gear`: `pinion` or `wheel`: whose teeth.

    **Returns:**

    The figure; loads are over their mean at each speed.
    """
    title = f"What each tooth carries: {dataset.attrs['title']}"
    figure, (axes,) = panels((9.6, 4.4), title, 1)
    own = dataset.sortby(f"{gear}_tooth_angle_deg")
    step, angle = 360.0 / dataset.attrs[f"teeth_{gear}"], own[f"{gear}_tooth_angle_deg"].values
    low, high = angle.min() - 0.5 * step, angle.max() + 0.5 * step
    has_holes = dataset.sizes[f"{gear}_hole"] > 0
    _shade_holes(axes, dataset, gear, (low, high))
    speeds, loads = own["pinion_speed_rad_s"].values, own["line_load_max_N_mm"].values
    for number, (speed, load) in enumerate(zip(speeds, loads, strict=True)):
        mean = float(np.mean(load))
        axes.plot(
            angle,
            load / mean,
            "o-",
            ms=4,
            color=_SERIES[number % len(_SERIES)],
            label=f"{speed:.5g} rad/s, mean {digits(mean, 4)} N/mm",
        )
    axes.set(
        xlim=(low, high),
        xlabel=f"place of the tooth on the {gear}, from tooth 0 [°]",
        ylabel="largest line load of a tooth,\nover the mean of all",
    )
    axes.xaxis.set_major_locator(MaxNLocator(steps=[1, 1.5, 3, 6, 10]))
    handles, labels = axes.get_legend_handles_labels()
    if has_holes:
        handles, labels = [*handles, Patch(color=_HOLE)], [*labels, "above a hole"]
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _shade_holes(axes: Axes, dataset: xr.Dataset, gear: str, ends: tuple[float, float]) -> None:
    """Shade where holes of the web are under the teeth."""
    names = (f"{gear}_hole_angle_deg", f"{gear}_hole_half_deg")
    for middle, half in zip(*(dataset[name].values for name in names), strict=True):
        for turn in (-360.0, 0.0, 360.0):
            left, right = middle - half + turn, middle + half + turn
            if right > ends[0] and left < ends[1]:
                axes.axvspan(left, right, color=_HOLE, lw=0, zorder=0)
