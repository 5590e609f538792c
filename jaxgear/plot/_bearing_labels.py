"""Texts beside the bearings of shafts, of which none hides another or a line to another."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Annotation
from matplotlib.transforms import offset_copy

from jaxgear.plot._labels import text_size
from jaxgear.plot._palette import GREY
from jaxgear.plot._style import BOX, laid_out, page_of


class Labels(NamedTuple):
    """What is written next to the bearings of one shaft, from left to right.

    **Fields:**

    - `texts`: the loads, with their units.
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


def write_labels(axes: Axes, shafts: list[Labels]) -> None:
    """Write the labels on the side away from the other shaft, and make room for all."""
    if not shafts:
        return
    figure = page_of(axes)
    x, y = axes.get_xlim(), axes.get_ylim()
    height = figure.get_figheight()
    drawn: list[Annotation] = []
    before = 0.0
    for _ in range(_ROUNDS):
        # How many millimetres of the picture a point of its letters takes.
        scale = 1.0 / laid_out(axes) / float(axes.transData.get_matrix()[0, 0])
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


def _draw_labels(axes: Axes, labels: Labels, scale: float) -> tuple[list[Annotation], float]:
    """Labels of one shaft with the lines that lead to them, and the height of rows [points].

    The first row does not count; `scale` says how much of the picture a point is [mm].
    """
    out = labels.outwards
    look = {"fontsize": 8.5, "zorder": 6, "va": "bottom" if out > 0 else "top"}
    size = np.max([text_size(axes, text, look) for text in labels.texts], axis=0)
    figure = page_of(axes)
    rows, asides = label_places(labels.at, scale * (size[0] + _GAP))
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
        drawn.append(axes.annotate(text, (at, edge), ha=ha, bbox=BOX, **place, **look))
        if aside:
            top = offset_copy(axes.transData, figure, 0.0, away + out * size[1], "points")
            line = {"arrowstyle": "-", "color": GREY, "lw": 0.8, "shrinkA": 0.0, "shrinkB": 0.0}
            place = {"xytext": (at, start), "textcoords": top, "arrowprops": line}
            drawn.append(axes.annotate("", (at, edge), zorder=5, **place))
    return drawn, float(np.max(rows) * (size[1] + _GAP))


def label_places(at: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Where labels go so that none lies on another, nor on a line that leads to another.

    A label that has room stays above its bearing. Those of closer bearings become flags on poles:
    they point away from the gear, and each flies above those that it would hide. Returns the row
    of each label, zero next to the bearings, and its side of the bearing along Z: -1, 0 or 1.
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
