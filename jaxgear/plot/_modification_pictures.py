"""The picture of what is taken off both flanks, as a gear checker prints it.

Its data are in `_modification_tables`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxgear.plot._modification_tables import TRACES
from jaxgear.plot._palette import _BLUE, _ORANGE
from jaxgear.plot._pictures import _house_look, _roll_axis
from jaxgear.study._results import BODIES

# The first state, and what became of it.
_LOOKS: tuple[dict[str, Any], ...] = (
    # Dashes on top: where nothing changed both are seen.
    {"color": _ORANGE, "ls": "--", "zorder": 3.0},
    {"color": _BLUE, "ls": "-"},
)
_ENDS = {"profile left": "left end", "profile right": "right end"}
# Deviations within this of each other are one line [um].
_SAME = 1e-3
# A flank without corrections must look like one: least height of the axes [um].
_LEAST = 4.0
_PLOTTED = ("roll_angle_deg", "diameter_mm", "face_position_mm", "designed_um", "made_um")


@_house_look()
def modification(data: Mapping[str, np.ndarray], title: str) -> Figure:
    """Profile and lead traces of both flanks: as designed, as made, and before and after a search.

    **Arguments:**

    - `data`: from `modification_columns`, of one or two models.
    - `title`: the case.

    **Returns:**

    The figure; all panels are of one scale, and added material is above zero.
    """
    figure = Figure(figsize=(10.0, 6.6))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(2, 2, sharey=True)
    figure.suptitle(f"Flank modifications: {title}")
    states = list(dict.fromkeys(data["state"]))
    looks = dict(zip(states, _LOOKS[-len(states) :], strict=True))
    marks: dict[str, Line2D] = {}
    for gear, (profile, lead) in zip(BODIES, panels, strict=True):
        for state, look in looks.items():
            own = (data["gear"] == gear) & (data["state"] == state)
            traces = {
                name: {key: data[key][own & (data["trace"] == name)] for key in _PLOTTED}
                for name in TRACES
            }
            name = f"{state}, " if len(states) > 1 else ""
            _draw_trace(profile, traces["profile"], "roll_angle_deg", look, name, marks)
            _draw_trace(lead, traces["lead"], "face_position_mm", look, name, marks)
        _draw_ends(profile, traces, look, name, marks)
        _roll_axis(profile, *(traces["profile"][key] for key in ("roll_angle_deg", "diameter_mm")))
        profile.set_title(f"{gear}: profile at mid-face", loc="left")
        place = traces["lead"]["diameter_mm"][0]
        lead.set_title(f"{gear}: lead at diameter {place:.2f} mm", loc="left")
        half = float(np.max(traces["lead"]["face_position_mm"]))
        lead.set(xlabel="position from mid-face, left (-Z) to right [mm]", xlim=(-half, half))
        for axes in (profile, lead):
            axes.set_ylabel("material added [µm]")
    low, high = panels[0, 0].get_ylim()
    lack = max(_LEAST - (high - low), 0.0)
    panels[0, 0].set_ylim(low - 0.75 * lack, high + 0.25 * lack)
    figure.legend(
        list(marks.values()), list(marks), loc="outside lower center", ncols=4, frameon=False
    )
    return figure


def _draw_trace(
    axes: Axes,
    trace: Mapping[str, np.ndarray],
    across: str,
    look: Mapping[str, Any],
    name: str,
    marks: dict[str, Line2D],
) -> None:
    """One trace as designed and, where it differs, as made."""
    x, designed, made = (trace[key] for key in (across, "designed_um", "made_um"))
    (marks[f"{name}as designed"],) = axes.plot(x, designed, **look)
    if np.max(np.abs(made - designed)) > _SAME:
        (marks[f"{name}as made"],) = axes.plot(x, made, **{**look, "lw": 0.9})


def _draw_ends(
    axes: Axes,
    traces: Mapping[str, Mapping[str, np.ndarray]],
    look: Mapping[str, Any],
    prefix: str,
    marks: dict[str, Line2D],
) -> None:
    """The profiles at both ends of a flank that is twisted, as made."""
    middle = traces["profile"]["made_um"]
    for (name, words), style in zip(_ENDS.items(), (":", "-."), strict=True):
        x, values = (traces[name][key] for key in ("roll_angle_deg", "made_um"))
        if np.ptp(values - middle) > _SAME:
            (line,) = axes.plot(x, values, color=look["color"], lw=1.0, ls=style)
            marks[f"{prefix}{words}"] = line
