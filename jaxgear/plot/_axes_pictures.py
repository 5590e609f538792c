"""One drawing of all conventions: axes, hand, senses of rotation, and signs on the flank."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

from jaxgear.plot._palette import BLUE, GEAR_COLOURS, GREEN, GREY, RED
from jaxgear.plot._picture import GEARS
from jaxgear.plot._style import BOX, write_at

_SIGNS = """\
depth > 0: material removed, along the normal
deviation > 0: material added
profile slope > 0: material added at the tip
helix slope > 0: material added at the right end
misalignment > 0: the wheel's right end is off
   towards +S (inclination) or +T (deviation)
transmission error > 0: the wheel lags
rotations are about +Z
left is the end at -Z, right that at +Z"""
# Left, bottom, width and height of the panels, over those of the figure.
_PLACES = ((0.01, 0.02, 0.39, 0.86), (0.42, 0.02, 0.28, 0.86), (0.72, 0.02, 0.27, 0.86))
# Tooth traces that are drawn on a gear, and points of each.
_TRACES, _POINTS = 14, 9


def axes(pair: xr.Dataset, axes: xr.Dataset) -> Figure:
    """The pair from +Z and from +T, and a tooth with what is removed from its flank.

    Gears are to scale, arrows and reliefs are not.
    """
    figure = Figure(figsize=(13.0, 5.4))
    figure.suptitle(f"Axes, hand and signs: {axes.attrs['title']}")
    # Without ticks and labels there is nothing to be laid out.
    front, side, tooth = (figure.add_axes(place) for place in _PLACES)
    arrows = _arrows(axes)
    for panel in (front, side, tooth):
        panel.set_aspect("equal")
        panel.set_anchor("N")
        panel.set_axis_off()
    _draw_front(front, pair, arrows)
    _draw_side(side, pair, arrows)
    _draw_tooth(tooth, pair)
    return figure


def _arrows(axes: xr.Dataset) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Place [mm] and direction of each arrow, by name."""
    places, directions = (
        np.stack([axes[name.format(axis)].values for axis in "STZ"], axis=1)
        for name in ("{}_mm", "along_{}")
    )
    names = axes["arrow"].values.tolist()
    return dict(zip(names, zip(places, directions, strict=True), strict=True))


def _arrow(
    panel: Axes, start: Any, by: Any, colour: str, words: str = "", **look: Any
) -> np.ndarray:
    """An arrow from a place by some way, with a text beyond its head; the place of its head."""
    end = np.asarray(start) + by
    style: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 13, "lw": 1.6, "zorder": 4}
    style |= {"color": colour, "shrinkA": 0.0, "shrinkB": 0.0} | look
    panel.add_patch(FancyArrowPatch(tuple(start), tuple(end), **style))
    if words:
        x, y = end + 0.22 * np.asarray(by)
        panel.text(x, y, words, color=colour, ha="center", va="center", zorder=5)
    return end


def _triad(panel: Axes, corner: Any, length: float, across: str, up: str) -> None:
    """Two axes in the plane of the picture."""
    _arrow(panel, corner, (length, 0.0), "black", across)
    _arrow(panel, corner, (0.0, length), "black", up)


def _draw_front(panel: Axes, pair: xr.Dataset, arrows: Mapping[str, Any]) -> None:
    """In the plane of S and T, Z towards the viewer."""
    tips, pitches = (pair[f"{name}_radius_mm"].values.tolist() for name in ("tip", "working_pitch"))
    distance, size = float(pair["working_centre_distance_mm"]), max(tips)
    for body, (name, colour) in enumerate(zip(pair["gear"].values, GEAR_COLOURS, strict=True)):
        centre = distance * body, 0.0
        panel.add_patch(Circle(centre, tips[body], fc=colour, ec=colour, alpha=0.16))
        panel.add_patch(Circle(centre, pitches[body], fill=False, ec=colour, lw=0.9, ls="-."))
        panel.plot(*centre, "+", color=colour, ms=8)
        turns = arrows[f"rotation of the {name}"][1][2]
        bow, away = 0.72 * tips[body], np.pi * body
        first, last = (
            np.asarray(centre) + bow * np.array([np.cos(x), np.sin(x)])
            for x in (away + 2.5 - 0.6 * turns, away + 2.5 + 0.6 * turns)
        )
        _arrow(panel, first, last - first, colour, connectionstyle=f"arc3,rad={0.32 * turns}")
        role = "drives" if body == 0 else "is driven"
        look: dict[str, Any] = {"color": colour, "ha": "center", "va": "center"}
        panel.text(centre[0], -0.45 * tips[body], f"{name}\n{role}", **look)
    _draw_action(panel, arrows, size)
    corner, long = np.array([-tips[0], -size]), 0.3 * size
    _triad(panel, corner, long, "S", "T")
    panel.plot(*corner, "o", ms=9, color="white", mec="black", zorder=5)
    panel.plot(*corner, "o", ms=3, color="black", zorder=6)
    x, y = corner - 0.1 * size
    panel.text(x, y, "Z", ha="center", va="center")
    panel.set_title(f"seen from +Z, centre distance {distance:.4g} mm", loc="left", y=1.0)
    panel.autoscale_view()


def _draw_action(panel: Axes, arrows: Mapping[str, Any], size: float) -> None:
    """The line of action through the pitch point, and the forces along it."""
    place, along = (each[:2] for each in arrows["path of contact"])
    line = np.stack([place - 0.75 * size * along, place + 0.75 * size * along])
    panel.plot(*line.T, color=GREEN, lw=1.0, ls=(0, (6, 2)), zorder=3)
    # Both at the right of their arrows, where there is room however small the pinion is.
    for name, colour, height in zip(GEARS, GEAR_COLOURS, ("top", "center"), strict=True):
        towards = arrows[f"force on the {name}"][1][:2]
        end = _arrow(panel, place, 0.55 * size * towards / np.hypot(*towards), colour, lw=2.2)
        look: dict[str, Any] = {"color": colour, "ha": "left", "va": height, "bbox": BOX}
        write_at(panel, f"force on the {name}", end, (6, 0), zorder=6, **look)
    panel.plot(*place, "o", ms=5, color="white", mec=GREEN, mew=1.4, zorder=5)


def _draw_side(panel: Axes, pair: xr.Dataset, arrows: Mapping[str, Any]) -> None:
    """In the plane of Z and S, T towards the viewer: tooth traces, torques and axial forces."""
    radii = pair["reference_radius_mm"].values
    distance = float(pair["working_centre_distance_mm"])
    # A narrow face is drawn wide enough to show its teeth.
    half = max(0.5 * float(pair["face_width_mm"]), 0.35 * float(radii.max()))
    for body, (name, colour) in enumerate(zip(pair["gear"].values, GEAR_COLOURS, strict=True)):
        level, radius = distance * body, radii[body]
        look: dict[str, Any] = {"fc": colour, "ec": colour, "alpha": 0.16}
        panel.add_patch(Rectangle((-half, level - radius), 2 * half, 2 * radius, **look))
        _, trace = arrows[f"tooth trace of the {name}"]
        z = np.linspace(-half, half, _POINTS)
        # Turns from S: half-way, at a quarter turn, a tooth is nearest to the viewer.
        turns = np.linspace(0.0, np.pi, _TRACES + 2)[1:-1, None]
        heights = level + radius * np.cos(turns - z * trace[0] / trace[2] / radius)
        lines = [np.stack([z, height], axis=1) for height in heights]
        panel.add_collection(LineCollection(lines, colors=colour, lw=1.0))
        panel.plot([-1.7 * half, 1.7 * half], [level, level], color="black", lw=0.7, ls="-.")
        start = 1.25 * half
        for head in (0.55, 0.4):
            along = arrows[f"torque on the {name}"][1][2]
            _arrow(panel, (start, level), (along * head * half, 0.0), colour)
        text = f"torque on\nthe {name}"
        panel.text(start + 0.65 * half, level, text, color=colour, va="center")
        _draw_thrust(panel, (0.0, level), arrows[f"force on the {name}"][1][2], half)
    low = -radii[0] - 0.12 * distance
    for words, z in (("left", -half), ("right", half)):
        panel.text(z, low, words, ha="center", va="top", color=GREY)
    corner, long = np.array([-2.4 * half, -radii[0]]), 0.3 * float(radii.max())
    _triad(panel, corner, long, "Z", "S")
    panel.plot(0.0, low - 0.08 * distance, alpha=0.0)
    panel.set_title(f"seen from +T: {_hand(pair)}", loc="left", y=1.0)
    panel.autoscale_view()


def _draw_thrust(panel: Axes, place: tuple[float, float], axial: float, half: float) -> None:
    """The axial part of the force on a helical gear."""
    if abs(axial) < 1e-9:
        return
    _arrow(panel, place, (np.sign(axial) * 0.8 * half, 0.0), RED, lw=2.4)
    look: dict[str, Any] = {"color": RED, "va": "bottom", "bbox": BOX, "zorder": 6}
    write_at(panel, "axial force", place, (0, 7), **look)


def _hand(pair: xr.Dataset) -> str:
    """The hand of the pinion in words; the wheel has the other one."""
    helix = float(pair["helix_angle_deg"])
    if abs(helix) < 1e-9:
        return "spur"
    return f"{'right' if helix > 0.0 else 'left'}-hand pinion, {helix:+.4g}°"


def _draw_tooth(panel: Axes, pair: xr.Dataset) -> None:
    """A tooth of the pinion in the transverse plane with a relieved tip, and all signs."""
    x, y = pair["tooth_x_mm"].values, pair["tooth_y_mm"].values
    panel.fill(np.concatenate([-x, x[::-1]]), np.concatenate([y, y[::-1]]), color=BLUE, alpha=0.16)
    panel.plot(-x, y, color=BLUE, lw=1.6)
    panel.plot(x, y, color=GREY, lw=1.0)
    height = float(np.ptp(y))
    share = np.clip((y - y[-1] + 0.35 * height) / (0.35 * height), 0.0, None)
    removed = 0.09 * height * share
    panel.fill_betweenx(y, -x, -x + removed, where=share > 0.0, color=RED, alpha=0.35, lw=0)
    panel.plot((-x + removed)[share > 0.0], y[share > 0.0], color=RED, lw=1.6, ls="--")
    near = int(np.argmin(np.abs(y - (y[-1] - 0.55 * height))))
    out = np.array([-(y[near + 1] - y[near - 1]), -(x[near + 1] - x[near - 1])])
    out *= 0.35 * height / np.hypot(*out)
    start = np.array([-x[near], y[near]])
    _arrow(panel, start, out, BLUE, "+")
    place = -x[-1] - 0.12 * height, y[-1] - 0.02 * height
    panel.text(*place, "removed", color=RED, va="center", ha="right")
    panel.text(-1.3 * height, y[0] - 0.12 * height, _SIGNS, va="top", fontsize=9.0)
    panel.set_xlim(-1.3 * height, 1.3 * height)
    panel.set_ylim(y[0] - 1.7 * height, y[-1] + 0.1 * height)
    panel.set_title("a pinion's tooth, and signs", loc="left", y=1.0)
