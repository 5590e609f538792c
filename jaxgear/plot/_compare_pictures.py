"""The overview of a comparison: errors of all rungs and responses, beside their time."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxgear.plot._labels import Label, write_labels
from jaxgear.plot._palette import _BLUE, _GREEN, _GREY, SERIES
from jaxgear.plot._pictures import _house_look, _panels
from jaxgear.study._ladder import MARGIN, QUANTITIES, judged_by

# Of cells: well within the tolerance, within it, up to five times it, beyond.
_STEPS = (MARGIN, 1.0, 5.0)
_SHADES = ("#b7e3d3", "#e3f1d4", "#fbe6bd", "#f3bfa6")
# Width of a panel of bars [inches].
_BARS = 2.3


@_house_look()
def overview(
    rungs: Sequence[Mapping[str, Any]],
    responses: Sequence[str],
    title: str,
    *,
    tolerance: float,
    recommended: str | None,
    words: str,
) -> Figure:
    """Errors of every rung as a table with shades, its time and that of compiling it as bars.

    **Arguments:**

    - `rungs`: each with `name`, `family`, `time_s`, `compile_s` and errors by response.
    - `responses`: columns of the table.
    - `title`: the case.
    - `tolerance`: of the errors.
    - `recommended`: name of the rung to be marked.
    - `words`: what the errors are.

    **Returns:**

    The figure.
    """
    count = len(rungs)
    figure = Figure(figsize=(3.9 + 1.45 * len(responses) + 2 * _BARS, 1.9 + 0.3 * count))
    figure.set_layout_engine("constrained", wspace=0.02)
    ratios = (1.45 * len(responses), _BARS, _BARS)
    table, running, compiling = figure.subplots(1, 3, width_ratios=ratios)
    figure.suptitle(f"Models and methods compared: {title}")
    errors = np.asarray([[_number(judged_by(rung), name) for name in responses] for rung in rungs])
    table.imshow(
        np.where(np.isfinite(errors), np.digitize(errors / tolerance, _STEPS), 3.0),
        cmap=ListedColormap(_SHADES),
        vmin=-0.5,
        vmax=3.5,
        aspect="auto",
    )
    for row, column in np.ndindex(errors.shape):
        bold = "bold" if rungs[row]["name"] == recommended else "normal"
        text = _percent(float(errors[row, column]))
        table.text(column, row, text, ha="center", va="center", fontsize=9, fontweight=bold)
    heads = [QUANTITIES[name].replace(" of ", "\nof ").replace("mean ", "mean\n") for name in
             responses]  # fmt: skip
    table.set_xticks(range(len(responses)), heads, fontsize=9)
    table.tick_params(top=True, labeltop=True, bottom=False, labelbottom=False, length=0)
    table.set_yticks(range(count), [str(rung["name"]) for rung in rungs], fontsize=9)
    for label, rung in zip(table.get_yticklabels(), rungs, strict=True):
        label.set_fontweight("bold" if rung["name"] == recommended else "normal")
    table.set_xticks(np.arange(len(responses) - 1) + 0.5, minor=True)
    table.set_yticks(np.arange(count - 1) + 0.5, minor=True)
    table.grid(which="minor", color="white", lw=1.5)
    table.grid(which="major", visible=False)
    table.tick_params(which="minor", length=0)
    table.spines[:].set_visible(False)
    table.set_xlabel(
        f"{words};\nshades: up to {_percent(MARGIN * tolerance)}, {_percent(tolerance)}, "
        f"{_percent(5.0 * tolerance)}, and beyond",
        fontsize=9,
    )
    colours = [_colour(rung, recommended) for rung in rungs]
    times = [float(rung["time_s"]) for rung in rungs]
    _draw_times(running, times, colours, "each run [s]")
    # Less where the program came from the cache.
    _draw_times(compiling, [float(rung["compile_s"]) for rung in rungs], colours, "compiling [s]")
    return figure


def _draw_times(axes: Axes, seconds: Sequence[float], colours: Sequence[str], label: str) -> None:
    """Bars with their numbers."""
    times, count = np.maximum(seconds, 1e-9), len(seconds)
    axes.barh(range(count), times, color=colours, height=0.6)
    axes.set(xscale="log", ylim=(count - 0.5, -0.5), xlabel=label)
    axes.set_xlim(0.5 * times.min(), 6.0 * times.max())
    axes.set_yticks([])
    for row, time in enumerate(times):
        axes.text(1.15 * time, row, f"{time:.2g}", va="center", fontsize=8.5)


def _number(errors: Mapping[str, float | None], name: str) -> float:
    value = errors.get(name)
    return np.nan if value is None else float(value)


def _percent(error: float) -> str:
    if not np.isfinite(error):
        return "none"
    return f"{100.0 * error:.2g} %" if error < 0.995 else f"{error:.2g} x"


def _colour(rung: Mapping[str, Any], recommended: str | None) -> str:
    if rung["name"] == recommended:
        return _GREEN
    return _GREY if rung.get("beyond") else _BLUE


@_house_look()
def error_over_time(
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
    figure, (axes,) = _panels((9.6, 6.2), f"Error over time: {title}")
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
        axes.axhline(tolerance, color=_GREEN, lw=1.2, ls="--", zorder=1.5)
        label = f"tolerance {tolerance:.2g}"
        handles.append(Line2D([], [], color=_GREEN, lw=1.2, ls="--", label=label))
    for row, rung in enumerate(rungs):
        if rung["name"] == recommended:
            ring: dict[str, Any] = {"marker": "o", "ls": "", "mfc": "none", "mec": "black"}
            ring |= {"ms": 14, "mew": 1.6, "zorder": 3.5}
            axes.plot(*place[row], **ring)
            ring["ms"] = 9
            handles.append(Line2D([], [], label=f"recommended: {recommended}", **ring))
    failed = not all(np.isfinite(rung["error"]) for rung in rungs)
    exact = any(rung["error"] == 0.0 for rung in rungs)
    hollow: dict[str, Any] = {"marker": "o", "ls": "", "mfc": "none", "color": _GREY, "ms": 6.5}
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
