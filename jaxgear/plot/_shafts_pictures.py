"""The picture of both shafts from the side."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from jaxgear._units import mm, um
from jaxgear.plot._bearing_labels import Labels, write_labels
from jaxgear.plot._palette import GEAR_COLOURS, GREEN, GREY, ORANGE, RED
from jaxgear.plot._style import BOX, legend_below, panels, round_down, write_at

_PALE = ("#c4dcec", "#f9e6bf")  # of pinion and wheel
_AXIAL = "#c9d6e2"  # a bearing that holds its shaft along Z
_DEFLECTION = {"S": (GREEN, "-"), "T": (RED, "--")}
_SEAT_MARKS = ({"ls": "", "marker": "s", "ms": 5}, {"ls": "", "marker": "D", "ms": 5})
# Of the centre distance: how far the largest deflection is drawn.
_SHOWN_DEFLECTION = 0.15


def shafts(pair: xr.Dataset, shafts: xr.Dataset) -> Figure:
    """Both shafts from the side, to scale, with their deflection and what the bearings carry.

    Of a shaft in a condensed body the displacements of its seats are shown, as marks. Condensed
    bodies are cut along the axis, other gears drawn from it to the tip circle, bearings as crossed
    boxes, filled where they hold the shaft along Z. Torques are arrows with two heads along the
    axis of rotation. The figure is in the plane of the two axes.
    """
    figure, (axes,) = panels("Shafts and bearings", shafts, _side_view_size(pair, shafts))
    axes.grid(False)
    axes.set_aspect("equal")
    distance = float(pair["working_centre_distance_mm"])
    largest = max(
        float(np.max(np.abs(shafts[f"deflection_{axis}_um"]))) * um / mm for axis in _DEFLECTION
    )
    scale = round_down(_SHOWN_DEFLECTION * distance / max(largest, 1e-12))
    labels = []
    for body, gear in enumerate(pair["gear"].values):
        level = distance * body
        _draw_gear_side(axes, pair.sel(gear=gear), shafts, body)
        if gear not in shafts["mount"]:
            continue
        own = _of_gear(shafts, str(gear))
        _draw_shaft(axes, own, level)
        _draw_torque(axes, own, level, body)
        _draw_loads(axes, own, level)
        _draw_deflection(axes, own, level, scale)
        labels += _labels_of(own, level, 2 * body - 1)
    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    axes.set(xlabel="Z from mid-face [mm]", ylabel="S, from the pinion's axis to the wheel's [mm]")
    axes.margins(x=0.12)
    _add_legend(figure, scale, seated=bool(shafts["seats_only"].any()))
    write_labels(axes, labels)
    return figure


def _of_gear(shafts: xr.Dataset, gear: str) -> xr.Dataset:
    """What belongs to one shaft."""
    own = shafts.sel(mount=gear)
    for dim, prefix in (
        ("point", ""),
        ("segment", "segment_"),
        ("bearing", "bearing_"),
        ("load", "load_"),
    ):
        own = own.isel({dim: np.flatnonzero(own[f"{prefix}gear"].values == gear)})
    return own


def _side_view_size(pair: xr.Dataset, shafts: xr.Dataset) -> tuple[float, float]:
    """Size of a figure that both shafts fill, one above the other [inches]."""
    length = max(
        float(np.sum(shafts["segment_length_mm"].values[shafts["segment_gear"].values == gear]))
        for gear in shafts["mount"].values
    )
    height = float(pair["working_centre_distance_mm"]) + float(pair["tip_radius_mm"].sum())
    width = float(np.clip(7.0 * length / height + 2.4, 6.0, 12.0))
    return width, float(np.clip((width - 2.4) * height / length + 1.6, 5.0, 8.6))


def _add_legend(figure: Figure, scale: float, *, seated: bool) -> None:
    marks: list[dict[str, Any]] = [
        {"marker": each["marker"]} if seated else {} for each in _SEAT_MARKS
    ]
    kinds = [
        Line2D([], [], color=colour, ls=style, lw=2.0, **mark)
        for (colour, style), mark in zip(_DEFLECTION.values(), marks, strict=True)
    ]
    torque = Line2D([], [], color=ORANGE, lw=1.8, marker=">", ms=6)
    fixed = Line2D([], [], color="black", ls="", marker="s", ms=8, mfc=_AXIAL)
    names = [f"deflection along {name}, {scale:g} times as large" for name in _DEFLECTION]
    names += ["torque about Z", "bearing that holds Z too"]
    legend_below(figure, [*kinds, torque, fixed], names, ncols=2)


def _draw_deflection(axes: Axes, shaft: xr.Dataset, level: float, scale: float) -> None:
    # Between the seats of a condensed body nothing is known of its shaft.
    marks = _SEAT_MARKS if shaft["seats_only"] else ({}, {})
    for (axis, (colour, style)), mark in zip(_DEFLECTION.items(), marks, strict=True):
        look: dict[str, Any] = {"color": colour, "ls": style, "lw": 2.0, "zorder": 5} | mark
        moved = shaft[f"deflection_{axis}_um"].values * um / mm
        axes.plot(shaft["Z_mm"].values, level + scale * moved, **look)


def _draw_gear_side(axes: Axes, gear: xr.Dataset, shafts: xr.Dataset, body: int) -> None:
    """A gear from the side: body to the root circle or in section, teeth to the tip circle."""
    name, colour = str(gear["gear"].values), GEAR_COLOURS[body]
    level = body * float(gear["working_centre_distance_mm"])
    width, root, tip = (float(gear[f"{x}_mm"]) for x in ("gear_width", "root_radius", "tip_radius"))
    look: dict[str, Any] = {"fc": colour, "ec": colour}
    own = shafts["section_gear"].values == name if "section_gear" in shafts else np.zeros(1, bool)
    if not own.any():
        for radius, shade in ((tip, 0.12), (root, 0.18)):
            place = -0.5 * width, level - radius
            axes.add_patch(Rectangle(place, width, 2.0 * radius, alpha=shade, **look))
    else:
        section = np.stack([shafts[f"section_{x}_mm"].values[own] for x in "Zr"], axis=-1)
        for side in (-1.0, 1.0):
            corner = -0.5 * width, level + min(side * root, side * tip)
            axes.add_patch(Rectangle(corner, width, tip - root, alpha=0.12, **look))
            # Above the shaft, which is a part of it.
            pale: dict[str, Any] = {"fc": _PALE[body], "ec": _PALE[body], "lw": 0.4, "zorder": 2.5}
            axes.add_collection(PolyCollection(list(section * [1.0, side] + [0.0, level]), **pale))
    look = {"va": "bottom" if body else "top", "color": colour, "weight": "bold"}
    write_at(axes, name, (0.0, level + (tip if body else -tip)), (0, 3 if body else -3), **look)


def _segments(shaft: xr.Dataset) -> list[tuple[float, ...]]:
    """Start, length, outer diameter and bore of each segment [mm]."""
    names = ("start_Z", "length", "outer", "inner")
    values = (shaft[f"segment_{name}_mm"].values.tolist() for name in names)
    return list(zip(*values, strict=True))


def _draw_shaft(axes: Axes, shaft: xr.Dataset, level: float) -> None:
    """Segments with their bores, the axis, and the bearings."""
    segments = _segments(shaft)
    look: dict[str, Any] = {"fc": "#e8e8e8", "ec": GREY, "zorder": 2}
    for start, length, outer, inner in segments:
        axes.add_patch(Rectangle((start, level - 0.5 * outer), length, outer, **look))
        for side in (-0.5, 0.5) if inner > 0.0 else ():
            ends = [start, start + length]
            axes.plot(ends, [level + side * inner] * 2, color=GREY, lw=0.8, ls="--", zorder=3)
    first, last = segments[0][0], segments[-1][0] + segments[-1][1]
    over = 0.06 * (last - first)
    ends = [first - over, last + over]
    axes.plot(ends, [level, level], color="black", lw=0.8, ls="-.", zorder=3)
    places, stiffness = shaft["bearing_Z_mm"].values, shaft["bearing_axial_N_m"].values
    for at, axial in zip(places.tolist(), stiffness.tolist(), strict=True):
        _draw_bearing(axes, _radius_at(shaft, at), at, level, holds=axial > 0.0)


def _radius_at(shaft: xr.Dataset, at: float) -> float:
    """Outer radius of the shaft at a place along Z [mm]."""
    segments = _segments(shaft)
    ends = np.asarray([start + length for start, length, *_ in segments])
    index = np.searchsorted(ends, at - 1e-6)
    return 0.5 * segments[min(int(index), len(ends) - 1)][2]


def _draw_bearing(axes: Axes, radius: float, at: float, level: float, *, holds: bool) -> None:
    """A crossed box on either side of the shaft, half as large as its radius."""
    size = 0.5 * radius
    left, right = at - 0.5 * size, at + 0.5 * size
    face = _AXIAL if holds else "white"
    for inside, outside in ((radius, radius + size), (-radius, -radius - size)):
        low, high = level + min(inside, outside), level + max(inside, outside)
        axes.add_patch(Rectangle((left, low), size, size, fc=face, ec="black", lw=1.0, zorder=3))
        for ends in ([low, high], [high, low]):
            axes.plot([left, right], ends, color="black", lw=0.8, zorder=3)


def _labels_of(shaft: xr.Dataset, level: float, outwards: int) -> list[Labels]:
    """Texts and places for the bearings of a shaft; none without any."""
    own = shaft.sortby("bearing_Z_mm")
    at = own["bearing_Z_mm"].values
    if not len(at):
        return []
    edges = np.asarray([level + outwards * 1.5 * _radius_at(shaft, z) for z in at])
    loads = np.stack([own[f"bearing_load_{axis}_N"].values for axis in "STZ"], axis=1)
    texts = [
        "\n".join(f"{axis} {load:.0f} N" for axis, load in zip("STZ", row, strict=True))
        for row in loads
    ]
    return [Labels(texts, at, edges, outwards)]


_LOADED: dict[str, Any] = {"fontsize": 8.5, "bbox": BOX, "zorder": 7}


def _draw_torque(axes: Axes, shaft: xr.Dataset, level: float, body: int) -> None:
    """The torque about Z."""
    at, torque = float(shaft["torque_Z_mm"]), float(shaft["torque_Nm"])
    reach = 0.5 * _radius_at(shaft, at) + 0.05 * float(shaft["segment_length_mm"].sum())
    ahead = np.sign(torque)
    arrow = {"arrowstyle": "-|>", "color": ORANGE, "lw": 1.8, "mutation_scale": 15}
    for head in (1.0, 0.7):
        tip, tail = (at + ahead * head * reach, level), (at - ahead * reach, level)
        axes.annotate("", tip, xytext=tail, arrowprops=arrow, zorder=7)
    look = {**_LOADED, "va": "top" if body else "bottom"}
    write_at(axes, f"{abs(torque):.4g} N m", (at, level), (0, 8 * (1 - 2 * body)), **look)


def _draw_loads(axes: Axes, shaft: xr.Dataset, level: float) -> None:
    """What else loads a shaft from outside."""
    names = ("load_Z_mm", "load_force_N", "load_moment_Nm")
    for z, force, moment in zip(*(shaft[name].values for name in names), strict=True):
        words = ", ".join(
            f"{kind}_{axis} {value:.4g} {unit}"
            for values, kind, unit in ((force, "F", "N"), (moment, "M", "N m"))
            for axis, value in zip("STZ", values, strict=True)
            if value
        )
        # The arrow has the direction of the part in the plane of the picture, not its size.
        in_plane = np.asarray([force[2], force[0]])
        size = float(np.hypot(force[2], force[0]))
        aside = 36.0 * in_plane / size if size > 0.0 else np.asarray([0.0, -36.0])
        axes.plot(z, level, "o", ms=4, color=RED, zorder=7)
        arrow = {"arrowstyle": "-|>" if size > 0.0 else "-", "color": RED, "lw": 1.5}
        look = {**_LOADED, "va": "center", "arrowprops": arrow}
        write_at(axes, words, (float(z), level), tuple(-aside), **look)
