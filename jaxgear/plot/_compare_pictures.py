"""The overview of a comparison: errors of all rungs and responses, beside their time."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from jaxgear.plot._palette import BLUE, GREEN, GREY
from jaxgear.plot._style import house_look
from jaxgear.study._ladder import MARGIN, QUANTITIES, judged_by

# Of cells: well within the tolerance, within it, up to five times it, beyond.
_STEPS = (MARGIN, 1.0, 5.0)
_SHADES = ("#b7e3d3", "#e3f1d4", "#fbe6bd", "#f3bfa6")
# Width of a panel of bars [inches].
_BARS = 2.3


@house_look()
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
        return GREEN
    return GREY if rung.get("beyond") else BLUE
