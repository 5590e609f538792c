"""Pictures of flanks at speed: pressure on one tooth's way, and what each tooth carries.

Their data are in `_flank_tables`.
"""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from jaxgear._units import MPa, deg, mm
from jaxgear.plot._flank_tables import (
    teeth_at_speed_columns,
)
from jaxgear.plot._hybrid_pictures import HOLE, SERIES, shade_holes
from jaxgear.plot._palette import _BLUE, _GREY, _RED
from jaxgear.plot._pictures import _SURFACE, _digits, _house_look, _panels
from jaxgear.study._flank_loads import FlankLoads
from jaxgear.study._hybrid_dataset import HolePlaces


@_house_look()
def flank_pressure(chosen: Sequence[FlankLoads], title: str) -> Figure:
    """Pressure on the most loaded tooth pair from its entry to its exit, at some speeds.

    **Arguments:**

    - `chosen`: one for each speed.
    - `title`: the case or the finding.

    **Returns:**

    The figure; all panels are of one scale.
    """
    words = f"Pressure on the flank: {title}"
    figure, panels = _panels((3.6 * len(chosen) + 1.6, 4.4), words, len(chosen))
    most = max(float(each.pressure.max()) for each in chosen) / MPa
    half = 0.5 * chosen[0].width / mm
    for axes, each in zip(panels, chosen, strict=True):
        passage, _, pressure = each.way()
        middle = 0.5 * (passage[1:] + passage[:-1])
        steps = np.concatenate([[1.5 * passage[0] - 0.5 * passage[1]], middle, passage[-1:]])
        face = np.linspace(-half, half, len(each.face) + 1)
        area = axes.pcolormesh(
            steps, face, pressure.T / MPa, cmap=_SURFACE, vmin=0.0, vmax=most, rasterized=True
        )
        axes.grid(False)
        largest = _digits(float(pressure.max()) / MPa, 4)
        axes.set_title(f"{each.speed:.5g} rad/s: largest {largest} MPa", loc="left")
        axes.set(xlabel="since entry at mid-face [mesh periods]")
    panels[0].set_ylabel("position from mid-face [mm]")
    figure.colorbar(area, ax=panels, label="pressure [MPa]")
    return figure


@_house_look()
def largest_loads(dataset: xr.Dataset, title: str) -> Figure:
    """Largest line load and pressure over speed, and where on the flank it is.

    **Arguments:**

    - `dataset`: of one direction of a sweep, with the entries of `loads_over_speeds`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (left, right) = _panels((10.6, 4.6), f"Largest loads on the flank: {title}", 2)
    speed = dataset["speed"].values
    mark = "o" if speed.size < 40 else ""
    left.plot(speed, dataset["max_line_load_N_mm"].values, marker=mark, ms=3, color=_BLUE)
    left.set_ylabel("largest line load [N/mm]", color=_BLUE)
    beside = left.twinx()
    beside.plot(speed, dataset["max_pressure_MPa"].values, marker=mark, ms=3, color=_RED, ls="--")
    beside.set_ylabel("largest pressure [MPa]", color=_RED)
    beside.grid(False)
    for axes, name in ((left, "max_line_load_N_mm"), (beside, "max_pressure_MPa")):
        axes.set_ylim(0.0, 1.1 * float(np.nanmax(dataset[name].values)))
    right.plot(speed, dataset["max_line_load_passage"].values, "o", ms=3, color=_BLUE)
    right.set_ylabel("mesh periods since entry at mid-face", color=_BLUE)
    across = right.twinx()
    across.plot(speed, dataset["max_line_load_face_mm"].values, "x", ms=4, color=_GREY)
    across.set_ylabel("position from mid-face [mm]", color=_GREY)
    reach = 1.2 * max(float(np.abs(dataset["max_line_load_face_mm"].values).max()), 0.1)
    across.set_ylim(-reach, reach)
    right.set_ylim(0.0, 1.2 * float(dataset["max_line_load_passage"].values.max()))
    across.grid(False)
    left.set_title("largest on the flank", loc="left")
    right.set_title("where the largest line load is", loc="left")
    for axes in (left, right):
        axes.set_xlabel("speed of the pinion [rad/s]")
    return figure


@_house_look()
def teeth_at_speed(
    chosen: Sequence[FlankLoads], gear: str, holes: HolePlaces | None, title: str
) -> Figure:
    """Largest line load of each tooth at some speeds, with the places of holes in the web.

    **Arguments:**

    - `chosen`: one for each speed, over several mesh periods.
    - `gear`: `pinion` or `wheel`: whose teeth.
    - `holes`: of its web.
    - `title`: the case or the finding.

    **Returns:**

    The figure; loads are over their mean at each speed.
    """
    figure, (axes,) = _panels((9.6, 4.4), f"What each tooth carries: {title}", 1)
    data = teeth_at_speed_columns(chosen, gear, holes)
    step = 360.0 / chosen[0].teeth[0 if gear == "pinion" else 1]
    angle = data["tooth_angle_deg"]
    low, high = angle.min() - 0.5 * step, angle.max() + 0.5 * step
    if holes is not None:
        shade_holes(axes, holes.middles / deg, holes.half / deg, low, high)
    for number, each in enumerate(chosen):
        own = data["pinion_speed_rad_s"] == each.speed
        mean = float(np.mean(data["line_load_max_N_mm"][own]))
        axes.plot(
            angle[own],
            data["line_load_max_N_mm"][own] / mean,
            "o-",
            ms=4,
            color=SERIES[number % len(SERIES)],
            label=f"{each.speed:.5g} rad/s, mean {_digits(mean, 4)} N/mm",
        )
    axes.set(
        xlim=(low, high),
        xlabel=f"place of the tooth on the {gear}, from tooth 0 [°]",
        ylabel="largest line load of a tooth,\nover the mean of all",
    )
    axes.xaxis.set_major_locator(MaxNLocator(steps=[1, 1.5, 3, 6, 10]))
    handles, labels = axes.get_legend_handles_labels()
    if holes is not None:
        handles, labels = [*handles, Patch(color=HOLE)], [*labels, "above a hole"]
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure
