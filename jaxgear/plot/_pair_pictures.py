"""The picture of both gears in mesh, in the transverse plane."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxgear._units import deg
from jaxgear.plot._palette import GEAR_COLOURS, GREEN, GREY
from jaxgear.plot._style import BOX, legend_below, panels, write_at

_CIRCLES = {"tip": "-", "working pitch": "-.", "base": "--", "root": ":"}
_ACTION: dict[str, Any] = {"color": GREEN, "lw": 1.0, "ls": (0, (6, 2))}
_CONTACT: dict[str, Any] = {"color": GREEN, "lw": 3.0}


def gear_pair(pair: xr.Dataset) -> Figure:
    """Both gears in the transverse plane, touching at the pitch point, seen from +Z [mm]."""
    figure, (axes,) = panels("Gears in mesh", pair, (7.4, 7.6))
    axes.grid(False)
    pitch_radius = float(pair["working_pitch_radius_mm"][0])
    window = 2.1 * float(pair["transverse_base_pitch_mm"])
    for body, gear in enumerate(pair["gear"].values):
        _draw_gear(axes, pair.sel(gear=gear), body)
    _draw_path(axes, pair)
    axes.set(xlim=(pitch_radius - window, pitch_radius + window), ylim=(-window, window))
    axes.set(xlabel="S, from pinion to wheel [mm]", ylabel="T [mm]", aspect="equal")
    lines = [Line2D([], [], color=GREY, lw=0.9, ls=style) for style in _CIRCLES.values()]
    lines += [Line2D([], [], **look) for look in (_ACTION, _CONTACT)]
    names = [f"{name} circle" for name in _CIRCLES]
    legend_below(figure, lines, [*names, "line of action", "path of contact"], ncols=3)
    return figure


def _draw_gear(axes: Axes, gear: xr.Dataset, body: int) -> None:
    """Teeth and circles of one gear."""
    name, colour = str(gear["gear"].values), GEAR_COLOURS[body]
    centre = np.asarray([float(gear["working_centre_distance_mm"]) * body, 0.0])
    outline = np.stack([gear[f"{axis}_mm"].dropna("point").values for axis in "ST"])
    axes.fill(*np.concatenate([outline, centre[:, None]], axis=1), color=colour, alpha=0.22, lw=0)
    axes.plot(*outline, color=colour, lw=1.5, gid=name)
    towards = np.pi * body + np.linspace(-1.3, 1.3, 601)
    for circle, style in _CIRCLES.items():
        radius = float(gear[f"{circle.replace(' ', '_')}_radius_mm"])
        arc = radius * np.stack([np.cos(towards), np.sin(towards)])
        axes.plot(*(centre[:, None] + arc), color=colour, lw=0.9, ls=style)
    axes.annotate(
        f"{name}, {int(gear['teeth'])} teeth",
        ((0.02, 0.98)[body], 0.02),
        xycoords="axes fraction",
        ha=("left", "right")[body],
        color=colour,
        weight="bold",
        bbox=BOX,
    )


def _draw_path(axes: Axes, pair: xr.Dataset) -> None:
    """Line of action, path of contact, and A to E."""
    angle = float(pair["working_pressure_angle_deg"]) * deg
    along = np.asarray([np.sin(angle), np.cos(angle)])
    aside = np.asarray([along[1], -along[0]])
    foot = float(pair["base_radius_mm"][0]) * aside
    names = ("path_start", "path_end", "transverse_base_pitch", "pitch_point", "tangent_length")
    start, end, pitch, pitch_point, tangent = (float(pair[f"{name}_mm"]) for name in names)
    axes.plot(*(foot + np.outer([0.0, tangent], along)).T, **_ACTION)
    active = foot + np.outer([start, end], along)
    axes.plot(*active.T, solid_capstyle="butt", gid="path of contact", **_CONTACT)
    points = {"A": start, "C": pitch_point, "E": end}
    if 1.0 < (end - start) / pitch < 2.0:
        points |= {"B": end - pitch, "D": start + pitch}
    for name, roll in points.items():
        place = foot + roll * along
        axes.plot(*place, "o", ms=5, color="white", mec=GREEN, mew=1.5, zorder=4)
        look = {"va": "center", "weight": "bold", "bbox": BOX, "zorder": 5}
        # C may lie next to B or D, whose names stand on the other side.
        away = -14 if name == "C" else 14
        write_at(axes, name, place, away * aside, **look)
