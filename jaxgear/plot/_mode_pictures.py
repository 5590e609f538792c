"""Pictures of natural modes: where their energy is, and their Campbell diagram."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxgear._columns import Table
from jaxgear.plot._labels import Label, apart, write_labels, write_rays
from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY
from jaxgear.plot._speed_axes import dots, frequency_unit, mesh_rays, speed_axes
from jaxgear.plot._style import laid_out, legend_below, panels, write_at

_PARTS = {
    "mesh": (BLUE, ""),
    "pinion": (ORANGE, "///"),
    "wheel": (GREEN, "\\\\\\"),
    "shafts": (SKY, "..."),
    "bearings": (PURPLE, "xxx"),
}
_MODES_SHOWN = 40
_RAY: dict[str, Any] = {"color": ORANGE, "lw": 1.1, "ls": (0, (6, 2))}


def modes(dataset: xr.Dataset) -> Figure:
    """Where each mode stores its strain energy, one bar per mode with its natural frequency.

    Frequency zero is a motion that nothing holds.
    """
    every = dataset.sizes["mode"]
    count = min(_MODES_SHOWN, every)
    size = (8.4, max(3.4, 2.0 + 0.27 * count))
    figure, (axes,) = panels("Natural modes and their energy", dataset, size)
    frequency = dataset["frequency_Hz"].values[:count]
    energy = np.nan_to_num(dataset["energy"].values[:count])
    place, left = np.arange(1, count + 1), np.zeros(count)
    handles = []
    for part, share in zip(dataset["part"].values, energy.T, strict=True):
        colour, hatch = _PARTS[str(part)]
        # Hatching tells parts apart without colour.
        look: dict[str, Any] = {"fc": colour, "hatch": hatch, "ec": "white", "lw": 0.0}
        axes.barh(place, share, left=left, height=0.74, **look)
        handles.append(Patch(label=str(part), **look))
        left = left + share
    free = frequency <= 1e-6 * np.max(frequency, initial=0.0)
    for row in np.nonzero(free)[0]:
        axes.text(0.01, place[row], "turns freely", va="center", color=GREY, fontsize=8.5)
    names = [f"{n}:  {_frequency_text(f)}" for n, f in zip(place, frequency, strict=True)]
    waves = "nodal_diameter" in dataset
    if waves:
        leads = zip(dataset["gear"].values, dataset["nodal_diameter"].values, strict=True)
        names = [f"{gear} {n} ND   {name}" for name, (gear, n) in zip(names, leads, strict=False)]
    axes.set_yticks(place, names)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.set(
        xlim=(0.0, 1.0),
        ylim=(count + 0.6, 0.4),
        xlabel="share of the strain energy [-]",
        ylabel=f"{'leading wave, ' * waves}mode and natural frequency [Hz]",
    )
    _write_damping(axes, dataset["damping_ratio"].values[:count], ~free)
    if count < every:
        axes.set_title(f"the first {count} of {every} modes", loc="left")
    legend_below(figure, handles, ncols=6)
    return figure


def _frequency_text(frequency: float) -> str:
    """A frequency to four digits, at least whole hertz."""
    return f"{frequency:,.0f}" if frequency >= 1000.0 else f"{frequency:.4g}"


def _write_damping(axes: Axes, damping: np.ndarray, shown: np.ndarray) -> None:
    """The damping ratio of each mode at the end of its bar."""
    look: dict[str, Any] = {"transform": axes.get_yaxis_transform(), "fontsize": 8.5}
    for row in np.nonzero(shown & np.isfinite(damping))[0]:
        axes.text(1.015, row + 1.0, f"{100.0 * damping[row]:.2f}", va="center", **look)
    axes.text(1.015, 0.35, "damping ratio [%]", va="bottom", color=GREY, **look)


def campbell(dataset: xr.Dataset, crossings: Table) -> Figure:
    """Natural frequencies over pinion speed, the mesh harmonics, and where they cross.

    Each mode is followed through the speeds; the more energy in the mesh, the larger the mark.
    """
    figure, (axes,) = panels("Campbell diagram", dataset, (9.6, 6.4))
    speed, frequency = dataset["speed"].values, dataset["frequency_Hz"].values
    highest = float(mesh_rays(dataset, 1.0)[-1][-1, 1])
    inside = frequency[np.isfinite(frequency) & (frequency <= highest)]
    # Of modes above, up to which no harmonic reaches, one is as good as many.
    top = 1.12 * max(float(np.max(inside, initial=0.0)), 0.3 * highest)
    unit, name = frequency_unit(top)
    rays = mesh_rays(dataset, unit)
    for ray in rays:
        axes.plot(*ray.T, zorder=2.0, **_RAY)
    curves = [np.stack([speed, column / unit], axis=1) for column in frequency.T]
    for curve in curves:
        axes.plot(*curve.T, color=BLUE, lw=1.3, marker=dots(speed), ms=3, zorder=2.1)
    axes.set_ylabel(f"natural frequency [{name}]")
    speed_axes([axes], speed, int(dataset.attrs["teeth_pinion"]))
    axes.set_ylim(0.0, top / unit)
    has_energy = "mesh_energy" in crossings
    energy = crossings["mesh_energy"] if has_energy else np.ones(len(crossings["mode"]))
    places = np.stack([crossings["pinion_speed_rad_s"], crossings["frequency_Hz"] / unit], axis=1)
    size = 12.0 + 110.0 * energy if has_energy else np.full(len(energy), 30.0)
    axes.scatter(*places.T, s=size, color=RED, ec="white", lw=0.7, zorder=3.0, clip_on=True)
    write_rays(axes, rays, places)
    _write_modes(axes, curves)
    important = np.argsort(-energy, kind="stable")
    chosen = [x for x in important if energy[x] >= 0.1 and places[x, 1] < 0.98 * top / unit]
    labels = [
        Label(f"{places[x, 0]:.0f} rad/s", (float(places[x, 0]), float(places[x, 1])), RED)
        for x in chosen[:_LABELS]
    ]
    if labels:
        write_labels(axes, labels, [*rays, *curves], points=places, drop=True)
    handles = [
        Line2D([], [], color=BLUE, lw=1.3, label="natural frequency"),
        Line2D([], [], label="mesh frequency and harmonics", **_RAY),
    ]
    dot: dict[str, Any] = {"color": RED, "marker": "o", "ls": "", "mec": "white"}
    sizes = {"crossing": 30.0}
    if has_energy:
        words = ("crossing, energy in the mesh 10 %", "50 %", "100 %")
        sizes = {
            word: 12.0 + 110.0 * share for word, share in zip(words, (0.1, 0.5, 1.0), strict=True)
        }
    handles += [Line2D([], [], ms=np.sqrt(each), label=x, **dot) for x, each in sizes.items()]
    legend_below(figure, handles, ncols=5)
    return figure


# Labels beyond these make a picture a table; the table is the CSV.
_LABELS = 16


def _write_modes(axes: Axes, curves: Sequence[np.ndarray]) -> None:
    """The number of each mode at the right end of its curve, and a line that leads there.

    Modes that coincide have one label.
    """
    top = axes.get_ylim()[1]
    ends: dict[float, list[int]] = {}
    for end, mode in sorted(
        (float(curve[-1, 1]), mode)
        for mode, curve in enumerate(curves, start=1)
        if 0.0 <= curve[-1, 1] <= top
    ):
        last = max(ends, default=-top)
        ends.setdefault(last if end - last < _ONE_LINE * top else end, []).append(mode)
    if not ends:
        return
    height = laid_out(axes) * axes.get_window_extent().height
    places = apart(np.asarray(list(ends)), top * 10.0 / height, 0.0, top)
    x = float(curves[0][-1, 0])
    look: dict[str, Any] = {"ha": "left", "fontsize": 8.5, "color": BLUE}
    line = {"arrowstyle": "-", "color": BLUE, "lw": 0.5, "shrinkA": 1, "shrinkB": 1}
    for (end, modes), place in zip(ends.items(), places, strict=True):
        by = (24.0, (place - end) / top * height)
        beyond = {"va": "center", "annotation_clip": False, "arrowprops": line}
        write_at(axes, ", ".join(map(str, modes)), (x, end), by, **look, **beyond)
    write_at(axes, "mode", (1.0, 1.0), (12, 6), xycoords="axes fraction", **look)


# Of the axes' height: modes that are closer are drawn as one line.
_ONE_LINE = 0.003
