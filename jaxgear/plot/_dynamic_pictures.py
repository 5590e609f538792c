"""The chart of methods: error over time."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxgear.plot._labels import Label, write_labels
from jaxgear.plot._palette import GREEN, GREY
from jaxgear.plot._speed_axes import SERIES
from jaxgear.plot._style import house_look, panels


@house_look()
def compare(
    rungs: Sequence[Mapping[str, Any]],
    title: str,
    *,
    tolerance: float | None = None,
    recommended: str | None = None,
    quantity: str = "error of the largest mesh force, relative",
    unit: str = "-",
) -> Figure:
    """Error over time for methods and their settings: what lies further down and left is better.

    **Arguments:**

    - `rungs`: each with `name`, `family`, `time_s` and `error`; those of one family are joined in
        the order given. An error that is not finite failed, and stands at the
        top; one of zero stands at the foot.
    - `title`: the case or the finding.
    - `tolerance`: the error that is asked for.
    - `recommended`: name of the rung to be marked.
    - `quantity`: what the error is of.
    - `unit`: of the error.

    **Returns:**

    The figure.
    """
    figure, (axes,) = panels((9.6, 6.2), f"Error over time: {title}")
    families = list(dict.fromkeys(str(rung["family"]) for rung in rungs))
    looks = dict(
        zip(
            families,
            zip(itertools.cycle(SERIES), itertools.cycle("os^vDP*X"), strict=False),
            strict=False,
        )
    )
    place = _rung_places(rungs, tolerance)
    handles = []
    for family in families:
        colour, marker = looks[family]
        rows = [row for row, rung in enumerate(rungs) if str(rung["family"]) == family]
        good = [row for row in rows if _is_seen(rungs[row])]
        axes.plot(*place[good].T, color=colour, lw=1.1, alpha=0.7, zorder=2.0)
        axes.plot(*place[good].T, marker, ls="", color=colour, ms=6.5, zorder=3.0)
        bad = [row for row in rows if row not in good]
        axes.plot(*place[bad].T, marker, color=colour, mfc="none", ms=6.5, zorder=3.0)
        handles.append(Line2D([], [], color=colour, marker=marker, ms=6.5, lw=1.1, label=family))
    axes.set(xscale="log", yscale="log", xlabel="time, without compilation [s]")
    axes.set_ylabel(f"{quantity} [{unit}]")
    asked = [] if tolerance is None else [[place[0, 0], tolerance]]
    _room_around(axes, np.concatenate([place, np.reshape(asked, (-1, 2))]))
    if tolerance is not None:
        axes.axhline(tolerance, color=GREEN, lw=1.2, ls="--", zorder=1.5)
        label = f"tolerance {tolerance:.2g}"
        handles.append(Line2D([], [], color=GREEN, lw=1.2, ls="--", label=label))
    for row, rung in enumerate(rungs):
        if rung["name"] == recommended:
            ring: dict[str, Any] = {"marker": "o", "ls": "", "mfc": "none", "mec": "black"}
            ring |= {"ms": 14, "mew": 1.6, "zorder": 3.5}
            axes.plot(*place[row], **ring)
            ring["ms"] = 9
            handles.append(Line2D([], [], label=f"recommended: {recommended}", **ring))
    failed = not all(np.isfinite(rung["error"]) for rung in rungs)
    exact = any(rung["error"] == 0.0 for rung in rungs)
    hollow: dict[str, Any] = {"marker": "o", "ls": "", "mfc": "none", "color": GREY, "ms": 6.5}
    words = {"no result (at the top)": failed, "no difference (at the foot)": exact}
    handles += [Line2D([], [], label=text, **hollow) for text, any_of in words.items() if any_of]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    _write_rungs(axes, rungs, place, looks, recommended, tolerance)
    return figure


def _is_seen(rung: Mapping[str, Any]) -> bool:
    """Whether the error has a place on a logarithmic axis."""
    return bool(np.isfinite(rung["error"])) and rung["error"] > 0.0


def _rung_places(rungs: Sequence[Mapping[str, Any]], tolerance: float | None) -> np.ndarray:
    """Rows time [s] and error of each rung: failures above all others, errors of zero below."""
    error = np.asarray([float(rung["error"]) for rung in rungs])
    seen = np.asarray([_is_seen(rung) for rung in rungs])
    others = [float(tolerance or 1e-3), *error[seen]]
    beyond = np.where(error == 0.0, min(others) / 3.0, 3.0 * max(others))
    time = np.asarray([max(float(rung["time_s"]), 1e-9) for rung in rungs])
    return np.stack([time, np.where(seen, error, beyond)], axis=1)


def _room_around(axes: Axes, place: np.ndarray) -> None:
    """Limits with room for labels, and a decade at least."""
    for low, high, set_limits in zip(
        np.min(place, axis=0), np.max(place, axis=0), (axes.set_xlim, axes.set_ylim), strict=True
    ):
        room = 4.0 if high < 10.0 * low else 1.35 * (high / low) ** 0.06
        set_limits(low / room, high * room)


def _write_rungs(
    axes: Axes,
    rungs: Sequence[Mapping[str, Any]],
    place: np.ndarray,
    looks: Mapping[str, tuple[str, str]],
    recommended: str | None,
    tolerance: float | None,
) -> None:
    """The name of every rung, the recommended one first and bold."""
    order = sorted(range(len(rungs)), key=lambda row: rungs[row]["name"] != recommended)
    labels = [
        Label(
            str(rungs[row]["name"]),
            (float(place[row, 0]), float(place[row, 1])),
            looks[str(rungs[row]["family"])][0],
            rungs[row]["name"] == recommended,
        )
        for row in order
    ]
    lines: list[np.ndarray] = []
    for family in looks:
        rows = [row for row, rung in enumerate(rungs) if str(rung["family"]) == family]
        lines.append(place[[row for row in rows if _is_seen(rungs[row])]])
    if tolerance is not None:
        lines.append(np.stack([axes.get_xlim(), np.full(2, tolerance)], axis=1))
    write_labels(axes, labels, lines)
