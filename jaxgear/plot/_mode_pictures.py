"""Pictures of natural modes: where their energy is, and their Campbell diagram."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxgear.plot._labels import Label, apart, write_labels, write_rays
from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, RED, SKY
from jaxgear.plot._picture import Columns
from jaxgear.plot._speed_axes import PURPLE, dots, frequency_unit, speed_axes
from jaxgear.plot._style import house_look, lay_out, panels

_PARTS = {
    "mesh": (BLUE, ""),
    "pinion": (ORANGE, "///"),
    "wheel": (GREEN, "\\\\\\"),
    "shafts": (SKY, "..."),
    "bearings": (PURPLE, "xxx"),
}
_MODES_SHOWN = 40


@house_look()
def modes(dataset: xr.Dataset) -> Figure:
    """Where each mode stores its strain energy, one bar per mode with its natural frequency.

    **Arguments:**

    - `dataset`: the group `modes`. Frequency zero is a motion that nothing holds.
    """
    every = dataset.sizes["mode"]
    count = min(_MODES_SHOWN, every)
    title = f"Natural modes and their energy: {dataset.attrs['title']}"
    figure, (axes,) = panels((8.4, max(3.4, 2.0 + 0.27 * count)), title)
    frequency = dataset["frequency_Hz"].values[:count]
    energy = np.nan_to_num(dataset["energy"].values[:count])
    place, left = np.arange(1, count + 1), np.zeros(count)
    handles = []
    for part, share in zip(dataset["part"].values, energy.T, strict=True):
        colour, hatch = _PARTS[str(part)]
        # Hatching tells parts apart without colour.
        look = {"fc": colour, "hatch": hatch, "ec": "white", "lw": 0.0}
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
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    return figure


def _frequency_text(frequency: float) -> str:
    """A frequency to four digits, at least whole hertz."""
    return f"{frequency:,.0f}" if frequency >= 1000.0 else f"{frequency:.4g}"


def _write_damping(axes: Axes, damping: np.ndarray, shown: np.ndarray) -> None:
    """The damping ratio of each mode at the end of its bar."""
    right = axes.get_yaxis_transform()
    for row in np.nonzero(shown & np.isfinite(damping))[0]:
        text = f"{100.0 * damping[row]:.2f}"
        axes.text(1.015, row + 1.0, text, transform=right, va="center", fontsize=8.5)
    axes.text(
        1.015, 0.35, "damping ratio [%]", transform=right, va="bottom", fontsize=8.5, color=GREY
    )


@house_look()
def campbell(dataset: xr.Dataset, crossings: Columns) -> Figure:
    """Natural frequencies over pinion speed, the mesh harmonics, and where they cross.

    **Arguments:**

    - `dataset`: the group `campbell`; each mode is followed through the speeds.
    - `crossings`: from `crossing_columns`; the more energy in the mesh, the larger the mark.
    """
    figure, (axes,) = panels((9.6, 6.4), f"Campbell diagram: {dataset.attrs['title']}")
    speed, frequency = dataset["speed"].values, dataset["frequency_Hz"].values
    teeth, harmonics = (int(dataset.attrs[name]) for name in ("teeth_pinion", "harmonics"))
    highest = float(harmonics * teeth * speed[-1] / (2.0 * np.pi))
    inside = frequency[np.isfinite(frequency) & (frequency <= highest)]
    # Of modes above, up to which no harmonic reaches, one is as good as many.
    top = 1.12 * max(float(np.max(inside, initial=0.0)), 0.3 * highest)
    unit, name = frequency_unit(top)
    rays = [
        np.stack([speed, h * teeth * speed / (2.0 * np.pi * unit)], axis=1)
        for h in range(1, harmonics + 1)
    ]
    for ray in rays:
        axes.plot(*ray.T, color=ORANGE, lw=1.1, ls=(0, (6, 2)), zorder=2.0)
    curves = [np.stack([speed, column / unit], axis=1) for column in frequency.T]
    for curve in curves:
        axes.plot(*curve.T, color=BLUE, lw=1.3, marker=dots(speed), ms=3, zorder=2.1)
    axes.set_ylabel(f"natural frequency [{name}]")
    speed_axes([axes], speed, teeth)
    axes.set_ylim(0.0, top / unit)
    has_energy = "mesh_energy" in crossings
    energy = crossings["mesh_energy"] if has_energy else np.ones(len(crossings["mode"]))
    places = np.stack(
        [crossings["pinion_speed_rad_s"], crossings["frequency_Hz"] / unit],
        axis=1,
    )
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
        Line2D([], [], color=ORANGE, lw=1.1, ls=(0, (6, 2)), label="mesh frequency and harmonics"),
    ]
    for share in (0.1, 0.5, 1.0) if has_energy else (0.0,):
        diameter = np.sqrt(12.0 + 110.0 * share if has_energy else 30.0)
        label = f"{100 * share:.0f} %"
        if share == 0.1:
            label = f"crossing, energy in the mesh {label}"
        label = label if has_energy else "crossing"
        style: dict[str, Any] = {"marker": "o", "ls": "", "ms": diameter, "mec": "white"}
        handles.append(Line2D([], [], color=RED, label=label, **style))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)
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
    figure = axes.get_figure(root=True)
    assert figure is not None
    lay_out(figure)
    height = 72.0 / figure.dpi * axes.get_window_extent().height
    places = apart(np.asarray(list(ends)), top * 10.0 / height, 0.0, top)
    x = float(curves[0][-1, 0])
    for (end, modes), place in zip(ends.items(), places, strict=True):
        axes.annotate(
            ", ".join(map(str, modes)),
            (x, end),
            xytext=(24.0, (place - end) / top * height),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
            color=BLUE,
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": BLUE, "lw": 0.5, "shrinkA": 1, "shrinkB": 1},
        )
    axes.annotate(
        "mode",
        (1.0, 1.0),
        xycoords="axes fraction",
        xytext=(12, 6),
        textcoords="offset points",
        fontsize=8.5,
        color=BLUE,
    )


# Of the axes' height: modes that are closer are drawn as one line.
_ONE_LINE = 0.003
