"""The canonical pictures. Each is a function from plain arrays or the dataset to a figure.

Their data are in `_tables`, which needs no matplotlib: `x_columns` gives those of `x`. Figures are
made without pyplot, so nothing is kept, shown or configured behind the caller's back.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import equinox as eqx

# Names of files that are still to be converted.
import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation
from matplotlib.ticker import FuncFormatter, NullFormatter
from matplotlib.transforms import offset_copy

import jaxgear as jg
from jaxgear._system._flexible import FlexibleBody
from jaxgear.plot._cycle import cycle_statistics, flank_grid
from jaxgear.plot._palette import _BLUE, _GREEN, _GREY, _ORANGE, _PINK, _RED, _SKY
from jaxgear.plot._style import BOX as _BOX
from jaxgear.plot._style import SURFACE as _SURFACE
from jaxgear.plot._style import digits as _digits
from jaxgear.plot._style import house_look as _house_look
from jaxgear.plot._style import lay_out
from jaxgear.plot._style import line_width as _thin
from jaxgear.plot._style import mark_points as _mark_points
from jaxgear.plot._style import panels as _panels
from jaxgear.plot._style import phase_axis as _phase_axis
from jaxgear.plot._style import roll_axis as _roll_axis
from jaxgear.plot._style import round_down as _round_down
from jaxgear.plot._tables import (
    _FLANK_MAPS,
    _along_flank,
    _centre,
    _cycle_periods,
    _deflected_lines,
    _facts,
    _height,
    _largest_pressure,
    _loads_across,
    _mesh_orders,
    _mounts,
    _outline,
    _phase_of_largest,
    _spectra,
    _unrolled,
    face_load_columns,
    harris_map_columns,
    load_sharing_columns,
    mesh_stiffness_columns,
    te_harmonics_columns,
    transmission_error_columns,
)
from jaxgear.study._results import BODIES

# A tenth more bytes than the default, for half the time.
_DPI, _COMPRESSION = 150, 1


# --- The pair in mesh


@_house_look()
def gear_pair(model: jg.PairModel, title: str = "") -> Figure:
    """Both gears in the transverse plane, touching at the pitch point, seen from +Z.

    **Arguments:**

    - `model`: gives the pair.
    - `title`: by default the numbers of teeth and the contact ratio.

    **Returns:**

    The figure, in millimetres from the pinion's centre.
    """
    pair = model.pair
    if not title:
        ratio = float(jg.pair_facts(pair)["profile_contact_ratio"])
        title = (
            f"Gear pair {pair.pinion.teeth}/{pair.wheel.teeth} in the transverse plane, "
            rf"$\varepsilon_\alpha$ = {ratio:.3f}"
        )
    else:
        title = f"Gears in mesh: {title}"
    figure, (axes,) = _panels((7.4, 7.6), title)
    axes.grid(False)
    facts = _facts(pair)
    pitch_radius = float(facts["working_pitch_radius"][0]) / jg.mm
    window = 2.1 * float(facts["transverse_base_pitch"]) / jg.mm
    for body, colour in enumerate((_BLUE, _ORANGE)):
        _draw_gear(axes, pair, body, colour)
    _draw_path(axes, pair)
    axes.set(
        xlim=(pitch_radius - window, pitch_radius + window),
        ylim=(-window, window),
        xlabel="S, from pinion to wheel [mm]",
        ylabel="T [mm]",
    )
    axes.set_aspect("equal")
    kinds = [Line2D([], [], color=_GREY, lw=0.9, ls=style) for style in _CIRCLES.values()]
    action = Line2D([], [], color=_GREEN, lw=1.0, ls=(0, (6, 2)))
    active = Line2D([], [], color=_GREEN, lw=3.0)
    figure.legend(
        [*kinds, action, active],
        [f"{name} circle" for name in _CIRCLES] + ["line of action", "path of contact"],
        loc="outside lower center",
        ncols=3,
        frameon=False,
    )
    return figure


_CIRCLES = {"tip": "-", "working pitch": "-.", "base": "--", "root": ":"}


def _draw_gear(axes: Axes, pair: jg.GearPair, body: int, colour: str) -> None:
    """Teeth and circles of one gear."""
    centre = _centre(pair, body) / jg.mm
    outline = _outline(pair, body) / jg.mm
    axes.fill(*np.concatenate([outline, centre[:, None]], axis=1), color=colour, alpha=0.22, lw=0)
    axes.plot(*outline, color=colour, lw=1.5, gid=BODIES[body])
    facts = _facts(pair)
    names = ("tip_radius", "working_pitch_radius", "base_radius", "root_radius")
    radii = [facts[name] for name in names]
    towards = np.pi * body + np.linspace(-1.3, 1.3, 601)
    for radius, style in zip(radii, _CIRCLES.values(), strict=True):
        arc = float(radius[body]) / jg.mm * np.stack([np.cos(towards), np.sin(towards)])
        axes.plot(*(centre[:, None] + arc), color=colour, lw=0.9, ls=style)
    inwards = (-1.0, 1.0)[body]
    axes.annotate(
        f"{BODIES[body]}, {(pair.pinion, pair.wheel)[body].teeth} teeth",
        (0.5 + 0.48 * inwards, 0.02),
        xycoords="axes fraction",
        ha=("left", "right")[body],
        color=colour,
        weight="bold",
        bbox=_BOX,
    )


def _draw_path(axes: Axes, pair: jg.GearPair) -> None:
    """Line of action, path of contact, and A to E."""
    facts = _facts(pair)
    angle = float(facts["working_pressure_angle"])
    along = np.asarray([np.sin(angle), np.cos(angle)])
    aside = np.asarray([along[1], -along[0]])
    foot = float(facts["base_radius"][0]) / jg.mm * aside
    start, end = float(facts["path_start"]) / jg.mm, float(facts["path_end"]) / jg.mm
    whole = foot + np.outer([0.0, float(facts["tangent_length"]) / jg.mm], along)
    axes.plot(*whole.T, color=_GREEN, lw=1.0, ls=(0, (6, 2)))
    active = foot + np.outer([start, end], along)
    axes.plot(*active.T, color=_GREEN, lw=3.0, solid_capstyle="butt", gid="path of contact")
    pitch = float(facts["transverse_base_pitch"]) / jg.mm
    points = {"A": start, "C": float(facts["pitch_point"]) / jg.mm, "E": end}
    if 1.0 < (end - start) / pitch < 2.0:
        points |= {"B": end - pitch, "D": start + pitch}
    for name, roll in points.items():
        place = foot + roll * along
        axes.plot(*place, "o", ms=5, color="white", mec=_GREEN, mew=1.5, zorder=4)
        axes.annotate(
            name,
            (place[0], place[1]),
            xytext=(14 * aside[0], 14 * aside[1]),
            textcoords="offset points",
            ha="center",
            va="center",
            weight="bold",
            bbox=_BOX,
            zorder=5,
        )


# --- The shafts


@_house_look()
def shafts(
    model: jg.PairModel,
    cycle: jg.MeshCycle,
    bearings: Sequence[Mapping[str, Any]],
    title: str,
    sections: Mapping[str, np.ndarray] = MappingProxyType({}),
) -> Figure:
    """Both shafts from the side, to scale, with their deflection and what the bearings carry.

    Of a shaft in a condensed body the displacements of its seats are shown, as marks. Condensed
    bodies are cut along the axis, other gears drawn from it to the tip circle, bearings as crossed
    boxes, filled where they hold the shaft along Z. Torques are arrows with two heads along the
    axis of rotation.

    **Arguments:**

    - `model`: with at least one shaft.
    - `cycle`: its settled states, of which the mean is drawn.
    - `bearings`: `static.bearings` of the summary: `gear`, `index` and `load_N` of each.
    - `title`: the case or the finding.
    - `sections`: of condensed bodies, by gear: radius and Z around each element in the cut, shape
        `[element, point, 2]` [m].

    **Returns:**

    The figure, in the plane of the two axes: Z from mid-face, S from the pinion's axis.
    """
    figure, (axes,) = _panels(_side_view_size(model), f"Shafts and bearings: {title}")
    axes.grid(False)
    axes.set_aspect("equal")
    lines = _deflected_lines(model, cycle)
    distance = float(_facts(model.pair)["working_centre_distance"]) / jg.mm
    largest = max(float(np.max(np.abs(line[1:]))) for line in lines.values()) / jg.mm
    scale = _round_down(_SHOWN_DEFLECTION * distance / max(largest, 1e-12))
    for body, name in enumerate(BODIES):
        level = distance * body
        _draw_gear_side(axes, model.pair, body, level, sections.get(name))
        mount = _mounts(model)[body]
        if not isinstance(mount, jg.Shaft):
            continue
        _draw_shaft(axes, mount, level)
        _draw_loads(axes, model, body, level)
        z, *moved = lines[name] / jg.mm
        # Between the seats of a condensed body nothing is known of its shaft.
        marks = _SEAT_MARKS if isinstance(model.bodies[body], FlexibleBody) else ({}, {})
        for deflection, (colour, style), mark in zip(
            moved, _DEFLECTION.values(), marks, strict=True
        ):
            look = {"color": colour, "ls": style, "lw": 2.0, "zorder": 5} | mark
            axes.plot(z, level + scale * deflection, **look)
    low, high = axes.get_ylim()
    axes.set(
        xlabel="Z from mid-face [mm]",
        ylabel="S, from the pinion's axis to the wheel's [mm]",
        ylim=(low - 0.05 * (high - low), high + 0.05 * (high - low)),
    )
    axes.margins(x=0.12)
    seated = any(isinstance(body, FlexibleBody) for body in model.bodies)
    kinds = [
        Line2D(
            [], [], color=colour, ls=style, lw=2.0, **({"marker": mark["marker"]} if seated else {})
        )
        for (colour, style), mark in zip(_DEFLECTION.values(), _SEAT_MARKS, strict=True)
    ]
    torque = Line2D([], [], color=_ORANGE, lw=1.8, marker=">", ms=6)
    fixed = Line2D([], [], color="black", ls="", marker="s", ms=8, mfc=_AXIAL)
    figure.legend(
        [*kinds, torque, fixed],
        [f"deflection along {name}, {scale:g} times as large" for name in _DEFLECTION]
        + ["torque about Z", "bearing that holds Z too"],
        loc="outside lower center",
        ncols=2,
        frameon=False,
    )
    _write_bearing_loads(axes, model, bearings)
    return figure


def _side_view_size(model: jg.PairModel) -> tuple[float, float]:
    """Size of a figure that both shafts fill, one above the other [inches]."""
    shafts = [mount for mount in _mounts(model) if isinstance(mount, jg.Shaft)]
    length = max(sum(float(each.length) for each in shaft.segments) for shaft in shafts)
    facts = _facts(model.pair)
    height = float(facts["working_centre_distance"] + facts["tip_radius"].sum())
    width = float(np.clip(7.0 * length / height + 2.4, 6.0, 12.0))
    return width, float(np.clip((width - 2.4) * height / length + 1.6, 5.0, 8.6))


_PALE = ("#c4dcec", "#f9e6bf")  # of pinion and wheel
_AXIAL = "#c9d6e2"  # a bearing that holds its shaft along Z
_DEFLECTION = {"S": (_GREEN, "-"), "T": (_RED, "--")}
_SEAT_MARKS = ({"ls": "", "marker": "s", "ms": 5}, {"ls": "", "marker": "D", "ms": 5})
# Of the centre distance: how far the largest deflection is drawn.
_SHOWN_DEFLECTION = 0.15


def _draw_gear_side(
    axes: Axes, pair: jg.GearPair, body: int, level: float, section: np.ndarray | None
) -> None:
    """A gear from the side: body to the root circle or in section, teeth to the tip circle."""
    gear, colour = (pair.pinion, pair.wheel)[body], (_BLUE, _ORANGE)[body]
    width = float(gear.face_width) / jg.mm
    facts = _facts(pair)
    root, tip = (float(facts[name][body]) / jg.mm for name in ("root_radius", "tip_radius"))
    look: dict[str, Any] = {"fc": colour, "ec": colour}
    if section is None:
        for radius, shade in ((tip, 0.12), (root, 0.18)):
            place = -0.5 * width, level - radius
            axes.add_patch(Rectangle(place, width, 2.0 * radius, alpha=shade, **look))
    else:
        for side in (-1.0, 1.0):
            corner = -0.5 * width, level + min(side * root, side * tip)
            axes.add_patch(Rectangle(corner, width, tip - root, alpha=0.12, **look))
            cut = section[..., ::-1] / jg.mm * [1.0, side] + [0.0, level]
            # Above the shaft, which is a part of it.
            pale = {"fc": _PALE[body], "ec": _PALE[body], "lw": 0.4, "zorder": 2.5}
            axes.add_collection(PolyCollection(list(cut), **pale))
    axes.annotate(
        BODIES[body],
        (0.0, level + (tip if body else -tip)),
        xytext=(0, 3 if body else -3),
        textcoords="offset points",
        ha="center",
        va="bottom" if body else "top",
        color=colour,
        weight="bold",
    )


def _draw_shaft(axes: Axes, shaft: jg.Shaft, level: float) -> None:
    """Segments with their bores, the axis, and the bearings."""
    start = _height(shaft, 0.0)
    for segment in shaft.segments:
        length, outer, inner = (
            float(x) / jg.mm for x in (segment.length, segment.outer, segment.inner)
        )
        axes.add_patch(
            Rectangle((start, level - 0.5 * outer), length, outer, fc="#e8e8e8", ec=_GREY, zorder=2)
        )
        if inner > 0.0:
            for side in (-0.5, 0.5):
                ends = [start, start + length]
                axes.plot(ends, [level + side * inner] * 2, color=_GREY, lw=0.8, ls="--", zorder=3)
        start += length
    first = _height(shaft, 0.0)
    over = 0.06 * (start - first)
    ends = [first - over, start + over]
    axes.plot(ends, [level, level], color="black", lw=0.8, ls="-.", zorder=3)
    for bearing in shaft.bearings:
        _draw_bearing(axes, shaft, bearing, level)


def _radius_at(shaft: jg.Shaft, at: float) -> float:
    """Outer radius of the shaft at a place along Z [mm]."""
    ends = np.cumsum([float(segment.length) for segment in shaft.segments]) / jg.mm
    index = np.searchsorted(ends, at - _height(shaft, 0.0) - 1e-6)
    return 0.5 * float(shaft.segments[min(int(index), len(ends) - 1)].outer) / jg.mm


def _bearing_size(shaft: jg.Shaft, at: float) -> float:
    return 0.5 * _radius_at(shaft, at)


def _draw_bearing(axes: Axes, shaft: jg.Shaft, bearing: jg.Bearing, level: float) -> None:
    """A crossed box on either side of the shaft."""
    at = _height(shaft, bearing.at)
    size, radius = _bearing_size(shaft, at), _radius_at(shaft, at)
    left, right = at - 0.5 * size, at + 0.5 * size
    face = _AXIAL if float(bearing.axial) > 0.0 else "white"
    for inside, outside in ((radius, radius + size), (-radius, -radius - size)):
        low, high = level + min(inside, outside), level + max(inside, outside)
        axes.add_patch(Rectangle((left, low), size, size, fc=face, ec="black", lw=1.0, zorder=3))
        axes.plot([left, right], [low, high], color="black", lw=0.8, zorder=3)
        axes.plot([left, right], [high, low], color="black", lw=0.8, zorder=3)


class _BearingLabels(eqx.Module):
    """What is written next to the bearings of one shaft, from left to right.

    **Fields:**

    - `texts`: the loads, with their units [-].
    - `at`: places along Z from mid-face [mm].
    - `edges`: of the bearings, from the pinion's axis along S [mm].
    - `outwards`: direction along S away from the other shaft [-].
    """

    texts: list[str]
    at: np.ndarray
    edges: np.ndarray
    outwards: int


# Between a bearing and its label, and between labels [points].
_GAP = 4.0
# Of rows above the first that fits beside the gears [points].
_FREE_HEIGHT = 80.0
# Labels change the limits, these the scale, and that which labels meet: it settles in two or three.
_ROUNDS = 6


def _write_bearing_loads(
    axes: Axes, model: jg.PairModel, bearings: Sequence[Mapping[str, Any]]
) -> None:
    """The load on each bearing, on the side away from the other shaft, with room for all."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    shafts = _bearing_labels(model, bearings)
    x, y = axes.get_xlim(), axes.get_ylim()
    height = figure.get_figheight()
    drawn: list[Annotation] = []
    before = 0.0
    for _ in range(_ROUNDS):
        lay_out(figure)
        # How many millimetres of the picture a point of its letters takes.
        scale = figure.dpi / 72.0 / float(axes.transData.get_matrix()[0, 0])
        if abs(scale - before) < 1e-3 * scale:
            break
        before = scale
        for label in drawn:
            label.remove()
        parts = [_draw_labels(axes, each, scale) for each in shafts]
        drawn = [label for part, _ in parts for label in part]
        # Where labels pile up the sheet grows, not they into the shafts.
        piled = sum(above for _, above in parts)
        figure.set_figheight(height + max(0.0, piled - _FREE_HEIGHT) / 72.0)
        corners = axes.transData.inverted().transform(
            np.concatenate([label.get_window_extent().padded(6.0).get_points() for label in drawn])
        )
        low, high = np.min(corners, axis=0), np.max(corners, axis=0)
        axes.set_xlim(min(x[0], low[0]), max(x[1], high[0]))
        axes.set_ylim(min(y[0], low[1]), max(y[1], high[1]))


def _bearing_labels(
    model: jg.PairModel, bearings: Sequence[Mapping[str, Any]]
) -> list[_BearingLabels]:
    """Texts and places for each shaft that has bearings."""
    found = []
    for body, name in enumerate(BODIES):
        shaft, outwards = _mounts(model)[body], 2 * body - 1
        own = [
            (_height(shaft, shaft.bearings[each["index"]].at), each["load_N"])
            for each in bearings
            if each["gear"] == name
        ]
        if not own:
            continue
        own.sort(key=lambda pair: pair[0])
        level = body * float(_facts(model.pair)["working_centre_distance"]) / jg.mm
        edges = [
            level + outwards * (_radius_at(shaft, z) + _bearing_size(shaft, z)) for z, _ in own
        ]
        texts = ["\n".join(f"{axis} {load[axis]:.0f} N" for axis in "STZ") for _, load in own]
        at = np.asarray([z for z, _ in own])
        found.append(_BearingLabels(texts, at, np.asarray(edges), outwards))
    return found


def _draw_labels(
    axes: Axes, labels: _BearingLabels, scale: float
) -> tuple[list[Annotation], float]:
    """Labels of one shaft with the lines that lead to them, and the height of rows [points].

    The first row does not count; `scale` says how much of the picture a point is [mm].
    """
    out = labels.outwards
    look = {"fontsize": 8.5, "zorder": 6, "va": "bottom" if out > 0 else "top"}
    size = np.max([_text_size(axes, text, look) for text in labels.texts], axis=0)
    figure = axes.get_figure(root=True)
    rows, asides = _label_places(labels.at, scale * (size[0] + _GAP))
    # Rows begin beyond all bearings, so that no line runs through a neighbour's label.
    furthest = out * np.max(out * labels.edges)
    drawn = []
    for text, at, edge, row, aside in zip(
        labels.texts, labels.at, labels.edges, rows, asides, strict=True
    ):
        start = furthest if aside else edge
        away = out * (_GAP + row * (size[1] + _GAP))
        shifted = offset_copy(axes.transData, figure, 3.0 * aside, away, "points")
        ha = {-1: "right", 0: "center", 1: "left"}[int(aside)]
        place: dict[str, Any] = {"xytext": (at, start), "textcoords": shifted}
        drawn.append(axes.annotate(text, (at, edge), ha=ha, bbox=_BOX, **place, **look))
        if aside:
            top = offset_copy(axes.transData, figure, 0.0, away + out * size[1], "points")
            line = {"arrowstyle": "-", "color": _GREY, "lw": 0.8, "shrinkA": 0.0, "shrinkB": 0.0}
            place = {"xytext": (at, start), "textcoords": top, "arrowprops": line}
            drawn.append(axes.annotate("", (at, edge), zorder=5, **place))
    return drawn, float(np.max(rows) * (size[1] + _GAP))


def _text_size(axes: Axes, text: str, look: Mapping[str, Any]) -> np.ndarray:
    """Width and height of a text [points]."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    trial = axes.annotate(text, (0.0, 0.0), **look)
    size = np.asarray(trial.get_window_extent().size)
    trial.remove()
    return size * 72.0 / figure.dpi


def _label_places(at: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Where labels go so that none lies on another, nor on a line that leads to another.

    A label that has room stays above its bearing. Those of closer bearings become flags on poles:
    they point away from the gear, and each flies above those that it would hide.

    **Arguments:**

    - `at`: places along Z of bearings, from mid-face.
    - `width`: of a label, in the same unit.

    **Returns:**

    Row of each label, zero next to the bearings, and its side of the bearing along Z: -1, 0 or 1.
    """
    order = np.argsort(at, kind="stable")
    near = np.diff(at[order]) < width
    aside = np.zeros(len(at), int)
    aside[order[1:][near]] = 1
    aside[order[:-1][near]] = 1
    aside *= np.where(at < 0.0, -1, 1)
    middle = at + 0.5 * width * aside
    row = np.zeros(len(at), int)
    # From the outermost inwards: poles of later flags are clear of those that fly already.
    left, right = order[at[order] < 0.0], order[at[order] >= 0.0][::-1]
    for half in (left, right):
        for count, index in enumerate(half):
            before = half[:count]
            hidden = before[np.abs(middle[before] - middle[index]) < width]
            row[index] = 1 + np.max(row[hidden], initial=-1)
    return row, aside


def _draw_loads(axes: Axes, model: jg.PairModel, body: int, level: float) -> None:
    """The torque about Z, and what else loads a shaft from outside."""
    shaft = _mounts(model)[body]
    at = shaft.gear_at if shaft.torque_at is None else shaft.torque_at
    reach = 0.5 * _radius_at(shaft, _height(shaft, at)) + 0.05 * float(shaft.length) / jg.mm
    torque = _torque_on(model, body)
    ahead = np.sign(torque)
    for head in (1.0, 0.7):
        axes.annotate(
            "",
            (_height(shaft, at) + ahead * head * reach, level),
            xytext=(_height(shaft, at) - ahead * reach, level),
            arrowprops={"arrowstyle": "-|>", "color": _ORANGE, "lw": 1.8, "mutation_scale": 15},
            zorder=7,
        )
    label = {"textcoords": "offset points", "fontsize": 8.5, "bbox": _BOX, "zorder": 7}
    axes.annotate(
        f"{abs(torque):.4g} N m",
        (_height(shaft, at), level),
        xytext=(0, 8 * (1 - 2 * body)),
        ha="center",
        va="top" if body else "bottom",
        **label,
    )
    for extra in shaft.loads:
        z = _height(shaft, extra.at)
        force, moment = np.asarray(extra.force), np.asarray(extra.moment)
        words = ", ".join(
            f"{name} {value:.4g} {unit}"
            for values, kind, unit in ((force, "F", "N"), (moment, "M", "N m"))
            for name, value in zip((f"{kind}_{axis}" for axis in "STZ"), values, strict=True)
            if value
        )
        # The arrow has the direction of the part in the plane of the picture, not its size.
        in_plane = np.asarray([force[2], force[0]])
        size = float(np.hypot(*in_plane))
        aside = 36.0 * in_plane / size if size > 0.0 else np.asarray([0.0, -36.0])
        axes.plot(z, level, "o", ms=4, color=_RED, zorder=7)
        axes.annotate(
            words or "no load",
            (z, level),
            xytext=tuple(-aside),
            ha="center",
            va="center",
            arrowprops={"arrowstyle": "-|>" if size > 0.0 else "-", "color": _RED, "lw": 1.5},
            **label,
        )


def _torque_on(model: jg.PairModel, body: int) -> float:
    """Torque about +Z that the drive or what is driven puts on a shaft [N m]."""
    if body == 0:
        return float(model.torque)
    wheel = _mounts(model)[1]
    loads = wheel.loads if isinstance(wheel, jg.Shaft) else ()
    ratio = model.pair.wheel.teeth / model.pair.pinion.teeth
    return ratio * float(model.mesh_torque) - sum(float(load.moment[2]) for load in loads)


# --- One mesh cycle


@_house_look()
def transmission_error(dataset: xr.Dataset, title: str) -> Figure:
    """Transmission error over two mesh periods or the longer cycle, and its mesh harmonics.

    **Arguments:**

    - `dataset`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (time, order) = _panels((9.6, 4.0), f"Transmission error: {title}", 2, (1.7, 1.0))
    data = transmission_error_columns(dataset) | te_harmonics_columns(dataset)
    mean, rms, span = cycle_statistics(dataset["transmission_error_um"])
    width = _thin(dataset["phase"].values)
    time.plot(data["phase"], data["transmission_error_um"], color=_BLUE, lw=width)
    time.axhline(mean, color=_GREY, lw=0.8, ls="--")
    size = f"RMS {_digits(rms, 3)} µm, peak to peak {_digits(span, 3)} µm"
    time.set_title(f"mean {_digits(mean, 4)} µm (dashed), {size}", loc="left")
    # A nearly constant error must not look like a large one.
    room = max(0.6 * span, 5e-3 * abs(mean))
    middle = 0.5 * (np.max(data["transmission_error_um"]) + np.min(data["transmission_error_um"]))
    time.set_ylim(middle - room, middle + room)
    _phase_axis(time, "transmission error [µm]", dataset["phase"].values)
    order.vlines(data["harmonic"], 0.0, data["te_harmonic_um"], color=_BLUE)
    order.plot(data["harmonic"], data["te_harmonic_um"], "o", color=_BLUE)
    order.set(xlabel="mesh harmonic [-]", ylabel="amplitude [µm]", xticks=data["harmonic"])
    # Nor must its rounding.
    order.set_ylim(0.0, max(1.08 * np.max(data["te_harmonic_um"]), 1e-3 * abs(mean)))
    order.set_title("harmonics (zero to peak)", loc="left")
    return figure


@_house_look()
def stiffness_and_sharing(dataset: xr.Dataset, title: str) -> Figure:
    """Mesh stiffness over two mesh periods or the longer cycle, and each pair's share of the load.

    **Arguments:**

    - `dataset`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (stiffness, share) = _panels((9.6, 4.0), f"Mesh stiffness and load sharing: {title}", 2)
    data = mesh_stiffness_columns(dataset) | load_sharing_columns(dataset)
    mean, _, span = cycle_statistics(dataset["mesh_stiffness_N_um"])
    width = _thin(dataset["phase"].values)
    stiffness.plot(data["phase"], data["mesh_stiffness_N_um"], color=_BLUE, lw=width)
    stiffness.axhline(mean, color=_GREY, lw=0.8, ls="--")
    size = f"peak to peak {_digits(span, 3)} N/µm"
    stiffness.set_title(f"mean {_digits(mean, 4)} N/µm (dashed), {size}", loc="left")
    stiffness.set_ylim(0.0, 1.1 * np.max(data["mesh_stiffness_N_um"]))
    _phase_axis(stiffness, "mesh stiffness [N/µm]", dataset["phase"].values)
    pairs = np.unique(data["tooth_pair"])
    for pair in pairs:
        own = data["tooth_pair"] == pair
        share.plot(data["roll_mm"][own], data["load_sharing"][own], color=_BLUE, lw=width)
    count = "one tooth pair" if len(pairs) == 1 else f"{len(pairs)} tooth pairs"
    share.set_title(f"{count} from entry to exit", loc="left")
    share.set(
        xlabel="roll length at mid-face [mm]", ylabel="share of the mesh force [-]", ylim=(0, 1.09)
    )
    _mark_points(share, dataset["path_point_roll_mm"])
    return figure


@_house_look()
def flank_maps(dataset: xr.Dataset, title: str) -> Figure:
    """Line load and pressure over the pinion's flank, along its roll angle and diameter.

    **Arguments:**

    - `dataset`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, panels = _panels((9.6, 4.2), f"Loads on the pinion's flank: {title}", 2)
    for axes, (variable, (quantity, unit)) in zip(panels, _FLANK_MAPS.items(), strict=True):
        grid = flank_grid(dataset, variable, "pinion")
        place, diameter = _along_flank(dataset, grid["profile_position"].values)
        half = 0.5 * (place[1] - place[0])
        face = np.linspace(-0.5, 0.5, grid.sizes["slice"] + 1) * dataset.attrs["face_width_mm"]
        surface = axes.pcolormesh(
            np.append(place - half, place[-1] + half),
            face,
            grid.values.T,
            cmap=_SURFACE,
            vmin=0.0,
            rasterized=True,
        )
        axes.grid(False)
        axes.set(
            ylabel="position from mid-face [mm]",
        )
        _roll_axis(axes, place, diameter)
        axes.set_title(f"largest {_digits(float(dataset[variable].max()), 4)} {unit}", loc="left")
        angle, _ = _along_flank(dataset, dataset["path_point_position"].values)
        _mark_points(axes, dataset["path_point_position"].copy(data=angle), on_surface=True)
        figure.colorbar(surface, ax=axes, label=f"{quantity} [{unit}]")
    return figure


@_house_look()
def face_load(dataset: xr.Dataset, title: str) -> Figure:
    """Load per face width across the face: its mean over the cycle, and where it is largest.

    **Arguments:**

    - `dataset`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((7.2, 4.4), f"Load across the face: {title}")
    data = face_load_columns(dataset)
    face, load = data["face_position_mm"], data["face_load_mean_N_mm"]
    mean = float(np.mean(load))
    phase = float(dataset["phase"].values[_phase_of_largest(_loads_across(dataset))])
    style = {"marker": "o", "ms": 3.5}
    axes.plot(
        face,
        data["face_load_at_largest_N_mm"],
        color=_ORANGE,
        ls="--",
        label=f"at phase {phase:.3f}, where it is largest",
        **style,
    )
    axes.plot(face, load, color=_BLUE, label="mean over the cycle", **style)
    axes.axhline(
        mean,
        color=_GREY,
        lw=1.0,
        ls=":",
        label=rf"mean {_digits(mean, 4)} N/mm, $K_{{H\beta}}$ = {np.max(load) / mean:.3f}",
    )
    half = 0.5 * dataset.attrs["face_width_mm"]
    most = max(float(np.max(data["face_load_at_largest_N_mm"])), float(np.max(load)))
    axes.set(
        xlabel="position from mid-face, left (-Z) to right [mm]",
        ylabel="load per face width [N/mm]",
        xlim=(-half, half),
        ylim=(0.0, 1.35 * most),
    )
    axes.legend(loc="upper center")
    return figure


# --- Many torques, many widths


@_house_look()
def harris_map(
    torques_Nm: np.ndarray,
    phases: np.ndarray,
    te_um: np.ndarray,
    title: str,
    *,
    weight: np.ndarray | None = None,
) -> Figure:
    """Transmission error over phase for several torques, and its size over torque.

    **Arguments:**

    - `torques_Nm`: on the pinion [N m].
    - `phases`: positions in the cycle, in mesh periods [-].
    - `te_um`: transmission error, rows torques, columns phases [um].
    - `title`: the case or the finding.
    - `weight`: share of the cycle that each phase stands for [-]; by default from the distances
        between the phases.

    **Returns:**

    The figure.
    """
    figure, (curves, size) = _panels((9.6, 4.2), f"Harris map: {title}", 2, (1.5, 1.0))
    colours, norm = _torque_colours(torques_Nm)
    width = min(_thin(phases), 1.3)
    data = harris_map_columns(torques_Nm, phases, te_um, weight=weight)
    # Shafts and bearings lift each curve by far more than it moves.
    apart = float(np.ptp(te_um)) > 8.0 * float(np.max(data["te_peak_to_peak_um"]))
    for torque, error, mean in zip(torques_Nm, te_um, data["te_mean_um"], strict=True):
        shown = error - mean if apart else error
        curves.plot(*_unrolled(phases, shown), color=colours(norm(torque)), lw=width)
    label = "transmission error less its mean [µm]" if apart else "transmission error [µm]"
    _phase_axis(curves, label, phases)
    _torque_bar(figure, curves, norm, colours, torques_Nm)
    style = {"marker": "o", "ms": 3.5}
    size.plot(torques_Nm, data["te_peak_to_peak_um"], color=_ORANGE, label="peak to peak", **style)
    size.plot(torques_Nm, data["te_rms_um"], color=_BLUE, label="RMS", **style)
    size.set(xlabel="torque on the pinion [N m]", ylabel="TE fluctuation [µm]")
    size.set_ylim(0.0, 1.25 * float(np.max(data["te_peak_to_peak_um"])))
    size.legend(loc="upper left", ncols=2)
    return figure


def _torque_colours(torques_Nm: np.ndarray) -> tuple[Colormap, Normalize]:
    """A colour for each torque; the palest of the map is left out."""
    norm = Normalize(float(np.min(torques_Nm)), 1.08 * float(np.max(torques_Nm)))
    return matplotlib.colormaps[_SURFACE].resampled(256), norm


def _torque_bar(
    figure: Figure, axes: Axes, norm: Normalize, colours: Colormap, torques_Nm: np.ndarray
) -> None:
    """The bar that says which colour is which torque."""
    bar = figure.colorbar(
        ScalarMappable(norm, colours), ax=axes, label="torque on the pinion [N m]"
    )
    if np.ptp(torques_Nm) > 0.0:
        bar.ax.set_ylim(float(np.min(torques_Nm)), float(np.max(torques_Nm)))


@_house_look()
def te_spectrum(
    torques_Nm: np.ndarray,
    phases: np.ndarray,
    te_um: np.ndarray,
    title: str,
    *,
    weight: np.ndarray | None = None,
) -> Figure:
    """Orders of the transmission error at several torques, and its mesh harmonics over torque.

    A cycle of several mesh periods has orders between the mesh harmonics, in steps of one over the
    number of its periods: those of the shafts among them.

    **Arguments:**

    - `torques_Nm`, `phases`, `te_um`, `title`, `weight`: as for `harris_map`.

    **Returns:**

    The figure.
    """
    figure, (spectrum, size) = _panels(
        (9.6, 4.2), f"Spectrum of the TE over torque: {title}", 2, (1.5, 1.0)
    )
    order, amplitudes = _spectra(phases, te_um, weight)
    colours, norm = _torque_colours(torques_Nm)
    fine = _cycle_periods(phases) > 1
    style: dict[str, Any] = {"lw": 0.7} if fine else {"lw": 1.3, "marker": "o", "ms": 3.5}
    for torque, amplitude in zip(torques_Nm, amplitudes, strict=True):
        spectrum.plot(order, amplitude, color=colours(norm(torque)), **style)
    most = max(float(np.max(amplitudes)), 1e-9)
    # What is further down is rounding.
    spectrum.set(yscale="log", ylim=(max(float(np.min(amplitudes)), 1e-6 * most) / 1.5, 2.0 * most))
    spectrum.set(xlabel="order of the mesh frequency [-]", ylabel="amplitude of the TE [µm]")
    whole = _mesh_orders(phases)
    spectrum.set_xticks(whole)
    spectrum.set_xlim(0.0, whole[-1] + 0.5)
    if fine:
        step = f"orders in steps of 1/{_cycle_periods(phases)}; mesh harmonics dotted"
        spectrum.set_title(step, loc="left")
        for harmonic in whole:
            spectrum.axvline(harmonic, color=_GREY, lw=0.8, ls=":", zorder=0.5)
    else:
        spectrum.set_title("mesh harmonics (zero to peak)", loc="left")
    _torque_bar(figure, spectrum, norm, colours, torques_Nm)
    for harmonic, colour, marker in zip(
        whole, (_BLUE, _ORANGE, _GREEN, _RED), "os^v", strict=False
    ):
        over_torque = amplitudes[:, np.isclose(order, harmonic)][:, 0]
        label = f"order {harmonic}"
        size.plot(torques_Nm, over_torque, color=colour, marker=marker, ms=3.5, label=label)
    size.set(xlabel="torque on the pinion [N m]", ylabel="amplitude of the TE [µm]")
    low, high = size.get_ylim()
    size.set_ylim(0.0, high + 0.25 * (high - low))
    size.legend(loc="upper left", ncols=2)
    return figure


@_house_look()
def smoothing_bias(
    width_um: np.ndarray,
    mean_bias_um: np.ndarray,
    rms_bias_relative: np.ndarray,
    rms_exact_um: float,
    title: str,
    *,
    gradient_bias_relative: np.ndarray | None = None,
) -> Figure:
    """What smooth contact changes, as a function of its width.

    Where no cell is within the width of separation the bias is zero, apart from rounding: hollow
    triangles at the foot of the axes.

    **Arguments:**

    - `width_um`: of the smooth contact [um].
    - `mean_bias_um`: of the mean TE [um].
    - `rms_bias_relative`: of the RMS of the TE, over the exact one [-].
    - `rms_exact_um`: RMS of the TE with exact contact [um].
    - `title`: the case or the finding.
    - `gradient_bias_relative`: of the gradient, over the exact one [-].

    **Returns:**

    The figure.
    """
    figure, (mean, relative) = _panels((9.6, 4.0), f"Bias of smooth contact: {title}", 2)
    _draw_bias(mean, width_um, mean_bias_um, _BLUE, "mean TE")
    _draw_bias(relative, width_um, rms_bias_relative, _BLUE, "RMS of the TE")
    if gradient_bias_relative is not None:
        _draw_bias(relative, width_um, gradient_bias_relative, _ORANGE, "gradient", row=1)
    mean.set_ylabel("|bias of the mean TE| [µm]")
    mean.set_title("absolute", loc="left")
    relative.set_ylabel("|bias| / exact value [-]")
    relative.set_title(f"relative; the exact RMS is {_digits(rms_exact_um, 3)} µm", loc="left")
    for axes in (mean, relative):
        axes.set(xscale="log", yscale="log", xlabel="width of the smooth contact [µm]")
        axes.legend(loc="best")
    return figure


def _draw_bias(
    axes: Axes, width: np.ndarray, bias: np.ndarray, colour: str, label: str, *, row: int = 0
) -> None:
    size = np.abs(bias)
    shown = size > _ROUNDING * np.max(size)
    axes.plot(width[shown], size[shown], marker="os"[row], ms=4, color=colour, label=label)
    if not np.all(shown):
        axes.plot(
            width[~shown],
            np.full(np.count_nonzero(~shown), 0.03 + 0.05 * row),
            "v",
            ms=5,
            color=colour,
            mfc="none",
            label=f"{label}: zero",
            transform=axes.get_xaxis_transform(),
        )


# Biases this far below the largest are differences of equal numbers.
_ROUNDING = 1e-11


# --- Optimisation


@_house_look()
def master_curve(
    chart: Any, valley: Any, closed_form_um: np.ndarray, path: np.ndarray, title: str
) -> Figure:
    """RMS of the TE over depth and extent of tip relief, with the curves of least TE.

    **Arguments:**

    - `chart`: an `optimise.ReliefMap` of the RMS in um.
    - `valley`: its `optimise.Valley`.
    - `closed_form_um`: depth of the closed form at each extent of the chart, or NaN [um].
    - `path`: points of a search, rows of depth [um] and extent [-]; may have no rows.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((7.6, 5.8), f"Master Curve map: {title}")
    depth = chart.depth / jg.um
    levels = _levels(chart.value)
    surface = axes.contourf(
        chart.extent,
        depth,
        chart.value,
        levels=levels,
        cmap=_SURFACE,
        extend="min",
        norm=BoundaryNorm(levels, 256, extend="min"),
    )
    surface.set_edgecolor("face")
    axes.grid(False)
    figure.colorbar(
        surface, ax=axes, label="RMS of the transmission error [µm]", ticks=levels, format="%.3g"
    )
    outlined = {"lw": 2.0, "path_effects": [withStroke(linewidth=3.4, foreground="black")]}
    inside = np.where(closed_form_um <= np.max(depth), closed_form_um, np.nan)
    for curve, colour, style, label in (
        (_unbroken_valley(valley, chart) / jg.um, "white", "-", "valley, computed"),
        (inside, _ORANGE, "--", "closed form"),
    ):
        if np.isfinite(curve).any():
            axes.plot(chart.extent, curve, color=colour, ls=style, label=label, **outlined)
    if len(path):
        axes.plot(path[:, 1], path[:, 0], ".-", color=_PINK, lw=1.1, ms=5, label="search")
        for row, marker, size, label in ((0, "o", 7, "its start"), (-1, "*", 14, "its end")):
            place = path[row, ::-1]
            axes.plot(*place, marker, color=_PINK, mec="black", ms=size, label=label, ls="")
    axes.set(
        xlabel="extent of the tip relief over the path of contact [-]",
        ylabel="depth of the tip relief [µm]",
        xlim=(float(np.min(chart.extent)), float(np.max(chart.extent))),
        ylim=(float(np.min(depth)), float(np.max(depth))),
    )
    figure.legend(loc="outside lower center", ncols=5, frameon=False)
    return figure


def _levels(values: np.ndarray) -> np.ndarray:
    """Round, roughly geometric levels up to the largest value, over two decades at the most."""
    most = float(np.nanmax(values))
    least = max(float(np.nanmin(values)), most / 100.0)
    powers = 10.0 ** np.arange(np.floor(np.log10(least)), np.ceil(np.log10(most)) + 1.0)
    series = np.outer(powers, [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]).ravel()
    first = np.searchsorted(series, least, side="right")
    return series[first : np.searchsorted(series, most) + 1]


def _unbroken_valley(valley: Any, chart: Any) -> np.ndarray:
    """Depth of the valley where it means something, else NaN [m].

    That is where the best depth lies within the map and halves the response, and it ends where the
    best depth jumps from one valley to another.
    """
    low, high = np.min(chart.depth), np.max(chart.depth)
    room = 1e-6 * (high - low)
    within = (valley.depth > low + room) & (valley.depth < high - room)
    within &= valley.value < 0.5 * chart.value[0]
    jump = np.abs(np.diff(valley.depth, prepend=valley.depth[0])) > 0.3 * (high - low)
    return np.where(within & ~jump, valley.depth, np.nan)


@_house_look()
def search_trace(values_by_method: Mapping[str, np.ndarray], unit: str, title: str) -> Figure:
    """Best value so far over the number of evaluations, for several searches.

    **Arguments:**

    - `values_by_method`: objective at each evaluation, in order, under the search's name.
    - `unit`: of the objective.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((7.2, 4.4), f"Searches: {title}")
    colours = (_BLUE, _ORANGE, _GREEN, _RED, _SKY)
    best_values = [np.minimum.accumulate(values) for values in values_by_method.values()]
    for index, (name, best) in enumerate(zip(values_by_method, best_values, strict=True)):
        colour = colours[index % len(colours)]
        count = np.arange(1, len(best) + 1)
        axes.step(
            count,
            best,
            where="post",
            color=colour,
            label=f"{name}: {best[-1]:.4g} {unit} after {len(best)}",
        )
        axes.plot(count[-1], best[-1], "o", ms=5, color=colour)
    every = np.concatenate(best_values)
    if np.min(every) > 0.0 and np.max(every) > 20.0 * np.min(every):
        axes.set_yscale("log")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(left=0.9)
    axes.set(xlabel="evaluations of the objective [-]", ylabel=f"best objective so far [{unit}]")
    axes.legend(loc="upper right")
    return figure


@_house_look()
def before_after(dataset_before: xr.Dataset, dataset_after: xr.Dataset, title: str) -> Figure:
    """What an optimisation changed: transmission error and largest flank pressure.

    **Arguments:**

    - `dataset_before`: from `static_dataset`.
    - `dataset_after`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (error, pressure) = _panels((9.6, 4.2), f"Before and after: {title}", 2)
    cases = (("before", dataset_before, _ORANGE, "--"), ("after", dataset_after, _BLUE, "-"))
    for name, dataset, colour, style in cases:
        own = dataset["phase"].values
        phase, values = _unrolled(own, dataset["transmission_error_um"].values)
        mean, rms, _ = cycle_statistics(dataset["transmission_error_um"])
        error.plot(
            phase,
            values - mean,
            color=colour,
            ls=style,
            lw=_thin(own),
            label=f"{name}: mean {_digits(mean, 4)} µm, RMS {_digits(rms, 3)} µm",
        )
        most = _largest_pressure(dataset)
        pressure.plot(
            *_unrolled(own, most),
            color=colour,
            ls=style,
            lw=_thin(own),
            label=f"{name}: at most {_digits(np.max(most), 4)} MPa",
        )
    _phase_axis(error, "transmission error less its mean [µm]", dataset_after["phase"].values)
    _phase_axis(pressure, "largest flank pressure [MPa]", dataset_after["phase"].values)
    for axes in (error, pressure):
        # Room for the legend above the curves.
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.3 * (high - low))
        axes.legend(loc="upper center")
    return figure


# --- The sizing table


@_house_look()
def sizing(
    labels: Sequence[str],
    amounts: np.ndarray,
    torques_Nm: np.ndarray,
    te_um: np.ndarray,
    pressure_MPa: np.ndarray,
    title: str,
) -> Figure:
    """What each combination of amounts does to transmission error and pressure.

    One amount at several torques is a map; otherwise the best combinations stand below each other.

    **Arguments:**

    - `labels`: name and unit of each amount, as on an axis.
    - `amounts`: rows combinations from the best to the worst, columns amounts.
    - `torques_Nm`: on the pinion [N m].
    - `te_um`: peak to peak of the transmission error, rows combinations, columns torques [um].
    - `pressure_MPa`: largest pressure, likewise [MPa].
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    if len(labels) == 1 and min(te_um.shape) > 1:
        return _sizing_map(labels[0], amounts[:, 0], torques_Nm, te_um, title)
    return _sizing_ranks(labels, amounts, torques_Nm, te_um, pressure_MPa, title)


def _sizing_map(
    label: str, amounts: np.ndarray, torques_Nm: np.ndarray, te_um: np.ndarray, title: str
) -> Figure:
    """Peak to peak over amount and torque; a star marks what is best at its worst torque."""
    figure, (axes,) = _panels((7.6, 5.2), f"Sizing: {title}")
    rising, upwards = np.argsort(amounts), np.argsort(torques_Nm)
    surface = axes.pcolormesh(
        _cell_edges(amounts[rising]),
        _cell_edges(torques_Nm[upwards]),
        te_um[rising][:, upwards].T,
        cmap=_SURFACE,
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
        color=_PINK,
        mec="black",
        ms=12,
        label=f"best: {amounts[0]:g}, at most {_digits(worst, 3)} µm",
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


# Largest number of values that are written into a map, and of combinations in a chart.
_WRITTEN, _RANKS_SHOWN = 120, 20


def _cell_edges(values: np.ndarray) -> np.ndarray:
    """Edges half-way between rising values, and as far beyond the first and the last."""
    middle = 0.5 * (values[:-1] + values[1:])
    return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


def _sizing_ranks(
    labels: Sequence[str],
    amounts: np.ndarray,
    torques_Nm: np.ndarray,
    te_um: np.ndarray,
    pressure_MPa: np.ndarray,
    title: str,
) -> Figure:
    """The best combinations, one row each: amounts, transmission error and pressure."""
    count = min(_RANKS_SHOWN, len(amounts))
    size = (max(9.6, 7.6 + 0.9 * len(labels)), 2.9 + 0.26 * count)
    ratios = (0.25 + 0.3 * len(labels), 1.0, 1.0)
    figure, (table, error, pressure) = _panels(size, f"Sizing: {title}", 3, ratios)
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
        axes.hlines(rank, np.min(shown, axis=1), np.max(shown, axis=1), color=_GREY, lw=1.0)
        colours, norm = _torque_colours(torques_Nm)
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
    colours, norm = _torque_colours(torques_Nm)
    _torque_bar(figure, pressure, norm, colours, torques_Nm)
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
