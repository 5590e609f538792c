"""Labels beside points, clear of each other and of what is drawn."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from jaxgear.plot._palette import GREY
from jaxgear.plot._style import BOX, laid_out, page_of, write_at


def apart(places: np.ndarray, distance: float, low: float, high: float) -> np.ndarray:
    """Rising places moved as little as possible so that neighbours are a distance apart.

    Least squares under `moved[i + 1] - moved[i] >= distance`: pools of neighbours that push each
    other share their mean. They stay between `low` and `high`; where there is no room for all, the
    distance shrinks.
    """
    if not len(places):
        return places
    distance = min(distance, (high - low) / max(len(places) - 1, 1))
    shift = distance * np.arange(len(places))
    pools: list[list[float]] = []
    for value in places - shift:
        pools.append([value, 1.0])
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (a, m), (b, n) = pools[-2:]
            pools[-2:] = [[(a * m + b * n) / (m + n), m + n]]
    level = np.concatenate([np.full(int(count), mean) for mean, count in pools])
    return np.clip(level, low, high - shift[-1]) + shift


def text_size(axes: Axes, text: str, look: Mapping[str, Any]) -> np.ndarray:
    """Width and height of a text anywhere on the page [points]."""
    figure = page_of(axes)
    # One that belongs to a place outside the axes has no size.
    trial = figure.text(0.5, 0.5, text, **look)
    size = np.asarray(trial.get_window_extent().size)
    trial.remove()
    return size * 72.0 / figure.dpi


class Label(NamedTuple):
    """A text that belongs to a point, in data coordinates, and how it stands out."""

    text: str
    at: tuple[float, float]
    colour: str
    bold: bool = False


# Directions around a point in which a label may stand, the best first, and how far [points].
_AROUND = np.deg2rad([30.0, -30.0, 150.0, 210.0, 90.0, -90.0, 60.0, 120.0, -60.0, 240.0, 0.0, 180])
_FAR = 20.0
_AWAY = (7.0, 14.0, 24.0, 36.0, 50.0, 66.0)


def write_labels(
    axes: Axes,
    labels: Sequence[Label],
    lines: Sequence[np.ndarray],
    *,
    points: np.ndarray | None = None,
    drop: bool = False,
) -> None:
    """Labels next to their points, clear of each other, of all points and of lines if possible.

    **Arguments:**

    - `axes`: with its final limits and labels.
    - `labels`: the important ones first.
    - `lines`, `points`: that should stay clear: rows of x and y.
    - `drop`: leave out a label that would lie on another, on a point, outside the axes or far away.
    """
    scale = laid_out(axes)
    to_points = lambda xy: scale * axes.transData.transform(np.reshape(xy, (-1, 2)))
    own = to_points([label.at for label in labels])
    places = own if points is None else np.concatenate([own, to_points(points)])
    dense = [np.empty((0, 2)), *(_filled(to_points(line)) for line in lines)]
    taken = np.concatenate(dense)
    frame = scale * axes.get_window_extent().get_points()
    boxes: list[np.ndarray] = []
    for label, point in zip(labels, own, strict=True):
        look: dict[str, Any] = {"fontsize": 8.5, "zorder": 6}
        look["weight"] = "bold" if label.bold else "normal"
        size = text_size(axes, label.text, look)
        trials = [
            _label_box(point, size, angle, away)
            for away, angle in itertools.product(_AWAY, _AROUND)
        ]
        costs = np.asarray([_cost(box, frame, boxes, places, taken) for box in trials])
        away = np.repeat(_AWAY, len(_AROUND))
        # One that stands out has a ring around its point.
        costs[:, 0] += 100.0 * (label.bold & (away < _AWAY[1]))
        best = int(np.argmin(costs.sum(axis=1) + 0.02 * away))
        if drop and (costs[best, 0] > 0.0 or away[best] > _FAR):
            continue
        box = trials[best]
        boxes.append(box)
        middle = 0.5 * (box[0] + box[1])
        leader = {"arrowstyle": "-", "color": GREY, "lw": 0.7, "shrinkA": 0.0, "shrinkB": 3.0}
        look |= {"color": label.colour, "va": "center"}
        look["arrowprops"] = leader if away[best] > _AWAY[label.bold] else None
        write_at(axes, label.text, label.at, tuple(middle - point), **look)


def _filled(line: np.ndarray) -> np.ndarray:
    """Points along a polyline, a few points of the page apart."""
    line = line[np.all(np.isfinite(line), axis=1)]
    if len(line) < 2:
        return line
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    along = np.linspace(0.0, length[-1], int(np.clip(length[-1] / 3.0, 2, 2000)))
    return np.stack([np.interp(along, length, x) for x in line.T], axis=1)


def _label_box(point: np.ndarray, size: np.ndarray, angle: float, away: float) -> np.ndarray:
    """Corners of a label whose nearest edge or corner lies so far away from its point."""
    towards = np.asarray([np.cos(angle), np.sin(angle)])
    middle = point + away * towards + 0.5 * size * np.clip(1.42 * towards, -1.0, 1.0)
    return np.stack([middle - 0.5 * size, middle + 0.5 * size])


def _cost(
    box: np.ndarray, frame: np.ndarray, boxes: Any, points: np.ndarray, lines: np.ndarray
) -> tuple[float, float]:
    """What speaks against a label there: what must not be under it, and what had better not."""
    inside = lambda x, room: np.count_nonzero(
        np.all((x > box[0] - room) & (x < box[1] + room), axis=1)
    )
    outside = np.any(box[0] < frame[0] + 1.0) or np.any(box[1] > frame[1] - 1.0)
    others = sum(bool(np.all((box[0] < b[1] + 1) & (b[0] < box[1] + 1))) for b in boxes)
    return 100.0 * (others + outside) + 20.0 * inside(points, 3.0), 1.0 * inside(lines, 1.0)


def write_rays(axes: Axes, rays: Sequence[np.ndarray], points: np.ndarray) -> None:
    """The number of each harmonic on its line, near the end but clear of these points."""
    right, top = axes.get_xlim()[1], axes.get_ylim()[1]
    size = np.asarray([right, top])
    for harmonic, ray in enumerate(rays, start=1):
        slope = ray[-1, 1] / ray[-1, 0]
        end = min(ray[-1, 0], top / slope)
        shares = np.linspace(0.97, 0.6, 25)
        places = shares[:, None] * np.asarray([end, slope * end])
        # Half a label, over the size of the axes.
        half = np.asarray([0.03, 0.03])
        apart = np.abs(places[:, None] - points) / size / half
        clear = np.all(np.max(apart, axis=2) > 1.0, axis=1)
        clear &= places[:, 0] < (1.0 - half[0]) * right
        x, y = places[int(np.argmax(clear))]
        look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8.5, "zorder": 2.5}
        look |= {"color": "#a06c00", "bbox": {**BOX, "alpha": 1.0}}
        axes.annotate(f"{harmonic} x", (x, y), **look)
