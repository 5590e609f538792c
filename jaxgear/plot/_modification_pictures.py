"""The picture of what is taken off both flanks, as a gear checker prints it."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxgear.plot._palette import BLUE, ORANGE
from jaxgear.plot._style import legend_below, panels, roll_axis

# The first state, and what became of it.
_LOOKS: tuple[dict[str, Any], ...] = (
    # Dashes on top: where nothing changed both are seen.
    {"color": ORANGE, "ls": "--", "zorder": 3.0},
    {"color": BLUE, "ls": "-"},
)
_ENDS = {"profile left": "left end", "profile right": "right end"}
# Deviations within this of each other are one line [um].
_SAME = 1e-3
# A flank without corrections must look like one: least height of the axes [um].
_LEAST = 4.0


def modification(dataset: xr.Dataset) -> Figure:
    """Profile and lead traces of both flanks: as designed, as made, and before and after a search.

    All panels are of one scale, and added material is above zero.
    """
    what, space = "Flank modifications", (0.02, 0.02)
    figure, both = panels(what, dataset, (10.0, 6.6), 2, 2, space=space, sharey=True)
    states = [str(state) for state in dataset["state"].values]
    looks = dict(zip(states, _LOOKS[-len(states) :], strict=True))
    marks: dict[str, Line2D] = {}
    for gear, profile, lead in zip(dataset["gear"].values, both[::2], both[1::2], strict=True):
        own = dataset.sel(gear=gear)
        for state, look in looks.items():
            traces = own.sel(state=state)
            name = f"{state}, " if len(states) > 1 else ""
            middle = traces.sel(trace="profile")
            _draw_trace(profile, middle, "roll_angle_deg", look, name, marks)
            _draw_trace(lead, traces.sel(trace="lead"), "face_position_mm", look, name, marks)
        _draw_ends(profile, traces, look, name, marks)
        roll_axis(profile, middle["roll_angle_deg"].values, middle["diameter_mm"].values)
        profile.set_title(f"{gear}: profile at mid-face", loc="left")
        along = own.isel(state=-1).sel(trace="lead")
        place = float(along["diameter_mm"][0])
        lead.set_title(f"{gear}: lead at diameter {place:.2f} mm", loc="left")
        half = float(along["face_position_mm"].max())
        lead.set(xlabel="position from mid-face, left (-Z) to right [mm]", xlim=(-half, half))
        for axes in (profile, lead):
            axes.set_ylabel("material added [µm]")
    low, high = both[0].get_ylim()
    lack = max(_LEAST - (high - low), 0.0)
    both[0].set_ylim(low - 0.75 * lack, high + 0.25 * lack)
    legend_below(figure, list(marks.values()), list(marks), ncols=4)
    return figure


def _draw_trace(
    axes: Axes, trace: xr.Dataset, across: str, look: Any, name: str, marks: dict[str, Line2D]
) -> None:
    """One trace as designed and, where it differs, as made."""
    x, designed, made = (trace[key].values for key in (across, "designed_um", "made_um"))
    (marks[f"{name}as designed"],) = axes.plot(x, designed, **look)
    if np.max(np.abs(made - designed)) > _SAME:
        (marks[f"{name}as made"],) = axes.plot(x, made, **(look | {"lw": 0.9}))


def _draw_ends(
    axes: Axes, traces: xr.Dataset, look: Any, prefix: str, marks: dict[str, Line2D]
) -> None:
    """The profiles at both ends of a flank that is twisted, as made."""
    middle = traces["made_um"].sel(trace="profile").values
    for (name, words), style in zip(_ENDS.items(), (":", "-."), strict=True):
        x, values = (traces[key].sel(trace=name).values for key in ("roll_angle_deg", "made_um"))
        if np.ptp(values - middle) > _SAME:
            (line,) = axes.plot(x, values, color=look["color"], lw=1.0, ls=style)
            marks[f"{prefix}{words}"] = line
