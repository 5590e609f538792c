"""What responses react to, as bars: the strongest keys first."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxgear.plot._palette import BLUE, GREEN, ORANGE
from jaxgear.plot._style import panels

# Keys in each part of the picture; the table has all of them.
_SHOWN = 12
_COLOURS = (BLUE, ORANGE, GREEN)
# Smaller sensitivities are rounding.
_LEAST = 1e-9
_WORDS: dict[str, str] = {
    "%/%": "% per % of the key",
    "%/um": "% per µm",
    "%/0.01": "% per 0.01 of the key",
}
_NAMES = {
    "te_mean_um": ("mean TE", "µm"),
    "te_rms_um": ("RMS of the TE", "µm"),
    "max_pressure_MPa": ("largest pressure", "MPa"),
    "face_load_factor": ("face load factor", ""),
    "mesh_stiffness_mean_N_um": ("mesh stiffness", "N/µm"),
    "te_rms_dynamic_um": ("RMS of the dynamic TE", "µm"),
    "smooth_dynamic_ratio": ("dynamic ratio", ""),
    "bearing_force_order_1_N": ("bearing forces, order 1", "N"),
}


def sensitivity(found: xr.Dataset) -> Figure:
    """Bars of the keys that responses react to most.

    One panel for each response, keys of one measure below each other, a bar for each speed.
    """
    names = tuple(dict.fromkeys(found["response"].values.tolist()))
    groups = [
        (words, found.isel(key=places[:_SHOWN]))
        for measure, words in _WORDS.items()
        if len(places := np.flatnonzero(found["measure"].values == measure))
    ]
    rows = [part.sizes["key"] for _, part in groups]
    size = (3.4 + 2.3 * len(names), 1.8 + 0.27 * sum(rows) + 0.7 * len(rows))
    options: dict[str, Any] = {"height_ratios": [count + 1.2 for count in rows]}
    shape = len(names), len(groups)
    figure, grid = panels(found.attrs["title"], None, size, *shape, space=(0.03, 0.04), **options)
    for row, (words, part) in enumerate(groups):
        for column, name in enumerate(names):
            axes = grid[row * len(names) + column]
            own = part.isel(case=part["response"].values == name)
            _draw(axes, own)
            axes.set_xlabel(words)
            axes.set_yticks(range(rows[row]), part["key"].values.tolist(), fontsize=8.5)
            if column:
                axes.tick_params(labelleft=False)
            else:
                axes.set_ylabel("key")
            if not row:
                axes.set_title(_told(name, own["value"].values))
    figure.align_ylabels(grid[:: len(names)])
    if len(np.unique(found["pinion_speed_rad_s"].dropna("case"))) > 1:
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def _draw(axes: Axes, found: xr.Dataset) -> None:
    """Bars of one response, one beside the other for its speeds."""
    shares = np.nan_to_num(found["sensitivity"].values)
    shares = np.where(np.abs(shares) > _LEAST, shares, 0.0)
    count, places = shares.shape
    height = 0.8 / count
    for number, speed in enumerate(found["pinion_speed_rad_s"].values):
        at = np.arange(places) + (number - 0.5 * (count - 1)) * height
        look: dict[str, Any] = {"color": _COLOURS[number], "label": f"{speed:.6g} rad/s"}
        axes.barh(at, shares[number], height=0.9 * height, **look)
    axes.axvline(0.0, color="black", lw=0.8)
    axes.set_ylim(places - 0.4, -0.6)
    if not np.any(shares):
        axes.set(xticks=[0.0], xlim=(-1.0, 1.0))
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", backgroundcolor="white")
        return
    axes.locator_params(axis="x", nbins=4)
    axes.margins(x=0.08)


def _told(name: str, values: np.ndarray) -> str:
    """Name of a response and, where it is one number, its value."""
    words, unit = _NAMES[name]
    return words if len(values) > 1 else f"{words}\n{values[0]:.4g} {unit}".rstrip()
