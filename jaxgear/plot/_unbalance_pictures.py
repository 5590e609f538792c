"""The picture of unbalance: what bearings and mesh carry at the rotation of the shafts."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxgear.plot._palette import GREY, SERIES
from jaxgear.plot._speed_axes import dots, speed_axes, stack
from jaxgear.plot._style import legend_below

# Of the unbalance of each shaft.
_DASHES = {"pinion": "-", "wheel": (0, (4, 2))}


def unbalance(dataset: xr.Dataset) -> Figure:
    """Largest force on each bearing, and amplitude of the mesh force, by the unbalance of a shaft.

    Both over pinion speed, on logarithmic axes, with the speeds at which that shaft's rotation
    meets a mode, and with the static mesh force, at which teeth part.
    """
    figure, panels = stack("Unbalance", dataset, (9.6, 6.2), (2.0, 1.2))
    force, mesh = panels
    static, speed = float(dataset.attrs["static_mesh_force_N"]), dataset["speed"].values
    for gear in dataset["gear"].values:
        own, look = dataset.sel(gear=gear), {"ls": _DASHES[str(gear)], "lw": 1.5}
        by_bearing = own["unbalance_bearing_force_N"].transpose("bearing", "speed").values
        for row, values in enumerate(by_bearing):
            _draw(force, speed, values, color=SERIES[row % len(SERIES)], **look)
        _draw(mesh, speed, own["unbalance_mesh_force_N"].values, color=GREY, **look)
    mesh.axhline(static, color="black", lw=1.2, ls=":")
    speed_axes(panels, speed, int(dataset.attrs["teeth_pinion"]))
    low, high = force.get_xlim()
    met = zip(dataset["critical_gear"].values, dataset["critical_speed_rad_s"].values, strict=True)
    for gear, critical in met:
        for axes in panels if low <= critical <= high else ():
            axes.axvline(critical, color=GREY, lw=0.8, ls=_DASHES[str(gear)], zorder=0.5)
    force.set_ylabel("largest bearing force [N]")
    mesh.set_ylabel("mesh force [N]")
    figure.align_ylabels(panels)
    line = lambda label, **look: Line2D([], [], label=label, **look)
    names = enumerate(dataset["bearing"].values)
    legend = [line(f"bearing {x}", color=SERIES[i % len(SERIES)]) for i, x in names]
    legend += [
        line(f"unbalance of the {gear}; upright: its critical speeds", color=GREY, ls=_DASHES[gear])
        for gear in map(str, dataset["gear"].values)
    ]
    legend_below(figure, [*legend, line("static mesh force", color="black", ls=":")], ncols=3)
    return figure


def _draw(axes: Axes, speed: np.ndarray, values: np.ndarray, **look: Any) -> None:
    """Amplitudes on a logarithmic axis, which shows none that is zero."""
    axes.plot(speed, np.where(values > 0.0, values, np.nan), marker=dots(speed), ms=3, **look)
    if np.any(values > 0.0):
        axes.set_yscale("log")
