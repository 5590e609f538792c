"""What responses react to, as bars: the strongest keys first."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxgear.plot._palette import BLUE, GREEN, ORANGE
from jaxgear.plot._style import house_look
from jaxgear.study._sensitivities import LEAST, Sensitivities

# Keys in each part of the picture; the table has all of them.
_SHOWN = 12
_COLOURS = (BLUE, ORANGE, GREEN)
_WORDS: dict[str, str] = {
    "%/%": "% per % of the key",
    "%/um": "% per µm",
    "%/0.01": "% per 0.01 of the key",
}


@house_look()
def sensitivity(found: Sensitivities, title: str) -> Figure:
    """Bars of the keys that responses react to most.

    **Arguments:**

    - `found`: with the keys sorted.
    - `title`: the case or the finding.

    **Returns:**

    One panel for each response, keys of one measure below each other, a bar for each speed.
    """
    names = tuple(dict.fromkeys(found.responses))
    groups = [
        (measure, places[:_SHOWN])
        for measure in _WORDS
        if (places := [j for j, own in enumerate(found.measures) if own == measure])
    ]
    rows = [len(places) for _, places in groups]
    size = (3.4 + 2.3 * len(names), 1.8 + 0.27 * sum(rows) + 0.7 * len(rows))
    figure = Figure(figsize=size)
    figure.set_layout_engine("constrained", wspace=0.03, hspace=0.04)
    ratios = [count + 1.2 for count in rows]
    panels = figure.subplots(len(groups), len(names), squeeze=False, height_ratios=ratios)
    for row, (measure, places) in enumerate(groups):
        for column, name in enumerate(names):
            axes = panels[row, column]
            _draw(axes, found, name, places)
            axes.set_xlabel(_WORDS[measure])
            axes.set_yticks(range(len(places)), [found.keys[j] for j in places], fontsize=8.5)
            if column:
                axes.tick_params(labelleft=False)
            else:
                axes.set_ylabel("key")
            if not row:
                axes.set_title(_told(name, found))
    figure.suptitle(title)
    figure.align_ylabels(panels[:, 0])
    if len(set(found.speeds[~np.isnan(found.speeds)])) > 1:
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def _draw(axes: Axes, found: Sensitivities, name: str, places: list[int]) -> None:
    """Bars of one response, one beside the other for its speeds."""
    own = [i for i, response in enumerate(found.responses) if response == name]
    height = 0.8 / len(own)
    for number, i in enumerate(own):
        at = np.arange(len(places)) + (number - 0.5 * (len(own) - 1)) * height
        label = f"{found.speeds[i]:.6g} rad/s"
        width = np.nan_to_num(found.numbers[i, places])
        width = np.where(np.abs(width) > LEAST, width, 0.0)
        axes.barh(at, width, height=0.9 * height, color=_COLOURS[number], label=label)
    axes.axvline(0.0, color="black", lw=0.8)
    axes.set_ylim(len(places) - 0.4, -0.6)
    if not np.any(np.abs(np.nan_to_num(found.numbers[np.ix_(own, places)])) > LEAST):
        axes.set(xticks=[0.0], xlim=(-1.0, 1.0))
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", backgroundcolor="white")
        return
    axes.locator_params(axis="x", nbins=4)
    axes.margins(x=0.08)


_NAMES = {
    "te_mean_um": ("mean TE", "µm"),
    "te_rms_um": ("RMS of the TE", "µm"),
    "max_pressure_MPa": ("largest pressure", "MPa"),
    "face_load_factor": ("face load factor", ""),
    "mesh_stiffness_mean_N_um": ("mesh stiffness", "N/µm"),
    "te_rms_dynamic_um": ("RMS of the TE in motion", "µm"),
    "smooth_dynamic_ratio": ("dynamic ratio", ""),
    "bearing_force_order_1_N": ("bearing forces, order 1", "N"),
}


def _told(name: str, found: Sensitivities) -> str:
    """Name of a response and, where it is one number, its value."""
    words, unit = _NAMES[name]
    values = [found.values[i] for i, own in enumerate(found.responses) if own == name]
    return words if len(values) > 1 else f"{words}\n{values[0]:.4g} {unit}".rstrip()
