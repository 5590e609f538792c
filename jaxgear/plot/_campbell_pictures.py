"""Pictures of the modes of condensed bodies: Campbell diagrams, and gears alone and in mesh.

Colours tell numbers of nodal diameters, at each speed those of the wave that leads there.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from jaxgear.plot._labels import Label, write_labels, write_rays
from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY
from jaxgear.plot._picture import GEARS
from jaxgear.plot._speed_axes import frequency_unit, mesh_rays, runs, speed_axes
from jaxgear.plot._style import legend_below, panels

# Of waves of two and more nodal diameters; fewer are in grey and black.
_WAVES = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, "#8c6d31", "#5254a3")
# With the gear, against it, neither.
_STYLES: dict[int, Any] = {1: "-", -1: (0, (5, 2)), 0: "-", 2: (0, (1, 1.2))}
_LETTERS = {"forward": "F", "backward": "B", "none": "", "both": ""}
_RAYS: dict[str, Any] = {"color": "#b08000", "lw": 1.0, "ls": (0, (8, 2, 1, 2))}
# Labels beyond these make a picture a table; the table is the CSV.
_LABELS = 24


# --- Seen from space


def campbell(dataset: xr.Dataset, critical: xr.Dataset) -> Figure:
    """Natural frequencies seen from space over pinion speed, and where mesh harmonics meet them."""
    figure, (axes,) = panels("Campbell diagram", dataset, (9.6, 7.0))
    frequency = np.abs(dataset["frequency_Hz"].values)
    unit, name = frequency_unit(float(np.nanmax(frequency[0])))
    rays = mesh_rays(dataset, unit)
    for ray in rays:
        axes.plot(*ray.T, zorder=1.9, **_RAYS)
    curves = _draw_waves(axes, dataset, frequency / unit, _goes_on(dataset))
    axes.set_ylabel(f"natural frequency seen from space [{name}]")
    shown = _draw_critical(axes, dataset, critical, "frequency_space_Hz", rays, [*rays, *curves])
    _legend(figure, dataset, np.unique(dataset["nodal_diameter"].values), shown, harmonics=True)
    return figure


def _draw_critical(
    axes: Axes, dataset: xr.Dataset, critical: xr.Dataset, name: str, rays: Any, lines: Any
) -> xr.Dataset:
    """Limits of the axes, and marks at the critical speeds inside them, which are returned.

    Rays have their numbers; labels are clear of lines.
    """
    highest = float(np.nanmax(np.abs(dataset["frequency_Hz"].values[0])))
    unit, _ = frequency_unit(highest)
    speed_axes([axes], dataset["speed"].values, int(dataset.attrs["teeth_pinion"]))
    axes.set_ylim(0.0, 1.06 * highest / unit)
    shown = critical.isel(crossing=critical[name].values < 0.99 * 1.06 * highest)
    places = np.stack([shown["pinion_speed_rad_s"], shown[name] / unit], axis=1)
    _mark_critical(axes, shown, places)
    write_rays(axes, rays, places)
    _label_critical(axes, shown, places, lines)
    return shown


def _colour(diameters: int) -> str:
    return ("#a8a8a8", "black")[diameters] if diameters < 2 else _WAVES[(diameters - 2) % 8]


def _goes_on(dataset: xr.Dataset) -> np.ndarray:
    """Whether a mode goes on from each speed to the next as it is seen from space.

    Between holes a mode is of several waves, each with a frequency of its own from there. Where
    another one leads the frequency leaps by a turn of the gear at least.
    """
    step = np.diff(dataset["frequency_Hz"].values, axis=0)
    around = np.pad(step, ((1, 1), (0, 0)), "reflect")
    before, after = around[:-2], around[2:]
    leap = np.abs(step - 0.5 * (before + after))
    teeth = np.array([dataset.attrs[f"teeth_{gear}"] for gear in GEARS])
    turns = (teeth[0] / teeth)[dataset["gear"].values[1:]] * dataset["speed"].values[1:, None]
    # Near rest a turn is little, and a mode that the mesh splits bends by as much.
    bent = leap <= 4.0 * np.minimum(np.abs(before), np.abs(after))
    return bent | (leap <= 0.5 * turns / (2.0 * np.pi))


def _draw_waves(
    axes: Axes, dataset: xr.Dataset, frequency: np.ndarray, goes_on: np.ndarray
) -> list[np.ndarray]:
    """Every mode in pieces of one leading wave and direction; all curves.

    Where the leading wave changes, pieces are joined if the mode goes on.
    """
    speed, curves = dataset["speed"].values, []
    diameters, direction = dataset["nodal_diameter"].values, dataset["direction"].values
    for mode, own in enumerate(frequency.T):
        kinds = 10 * diameters[:, mode] + direction[:, mode]
        for _, first, last in runs(kinds):
            n, way = int(diameters[first, mode]), int(direction[first, mode])
            # Up to where the next piece begins.
            on = last + 1 < len(own) and bool(goes_on[last, mode])
            part = slice(first, last + 1 + on)
            look: dict[str, Any] = {"color": _colour(n), "ls": _STYLES[way]}
            look["lw"] = 1.4 if n >= 2 else 0.9
            axes.plot(speed[part], own[part], zorder=2.0 + 0.1 * (n >= 2), **look)
        curves.append(np.stack([speed, own], axis=1))
    return curves


def _mark_critical(axes: Axes, shown: xr.Dataset, places: np.ndarray) -> None:
    """A dot where the mesh frequency itself meets a mode, rings for its harmonics."""
    kinds = zip(shown["nodal_diameter"].values, shown["harmonic"].values, places, strict=True)
    for diameters, harmonic, (x, y) in kinds:
        colour = _colour(int(diameters))
        style: dict[str, Any] = {"s": 30.0, "color": colour, "ec": "white", "lw": 0.6}
        if harmonic > 1:
            style = {"s": 14.0, "facecolors": "white", "edgecolors": colour, "lw": 0.9}
        axes.scatter([x], [y], zorder=3.2 if harmonic == 1 else 3.0, **style)


def _label_critical(
    axes: Axes, shown: xr.Dataset, places: np.ndarray, lines: Sequence[np.ndarray]
) -> None:
    """Nodal diameters, direction and speed at what the mesh frequency meets."""
    number, energy = shown["nodal_diameter"].values, shown["mesh_energy"].values
    first = np.flatnonzero(shown["harmonic"].values == 1).tolist()
    # Waves first, then what moves the mesh most.
    first.sort(key=lambda i: (number[i] < 2, -energy[i]))
    labels = []
    for i in first[:_LABELS]:
        x, y = map(float, places[i])
        words = f"{number[i]}{_LETTERS[shown['direction'].values[i]]} {x:.0f}"
        labels.append(Label(words, (x, y), _colour(max(int(number[i]), 1))))
    if labels:
        write_labels(axes, labels, lines, points=places, drop=True)


def _legend(
    figure: Figure,
    dataset: xr.Dataset,
    numbers: np.ndarray,
    shown: xr.Dataset,
    *,
    harmonics: bool,
) -> None:
    handles = [Line2D([], [], color=_colour(int(n)), lw=1.6, label=f"n = {n}") for n in numbers]
    ways = {1: "forward, F", -1: "backward, B"}
    if (dataset["direction"].values == 2).any():
        ways[2] = "both: stands on the body"
    for way, words in ways.items():
        handles.append(Line2D([], [], color=GREY, lw=1.4, ls=_STYLES[way], label=words))
    if harmonics:
        handles.append(Line2D([], [], label="mesh harmonics", **_RAYS))
    dot: dict[str, Any] = {"marker": "o", "ls": "", "color": GREY}
    if shown.sizes["crossing"]:
        handles.append(Line2D([], [], ms=5.5, label="critical [rad/s]", **dot))
    if (shown["harmonic"] > 1).any():
        handles.append(Line2D([], [], ms=4.0, mfc="white", label="by harmonics", **dot))
    title = "nodal diameters n of the leading wave, and which way it runs"
    legend_below(figure, handles, ncols=7, title=title)


# --- Seen from a gear


def campbell_on_body(dataset: xr.Dataset, critical: xr.Dataset, gear: str) -> Figure:
    """Natural frequencies on a gear over pinion speed, with the orders by which the mesh comes.

    Harmonic h comes to a wave of n nodal diameters as order h Z - n if it runs forward, h Z + n if
    it runs backward.
    """
    figure, (axes,) = panels("Campbell diagram on the body", dataset, (9.6, 7.0))
    title = f"Campbell diagram on the body: {dataset.attrs['title']}, seen from the {gear}"
    figure.suptitle(title)
    speed, teeth = dataset["speed"].values, int(dataset.attrs["teeth_pinion"])
    own = dataset["frequency_body_Hz"].values
    unit, name = frequency_unit(float(np.max(np.abs(dataset["frequency_Hz"].values[0]))))
    same = np.diff(dataset["nodal_diameter"].values, axis=0) == 0
    curves = _draw_waves(axes, dataset, own / unit, same)
    turned = teeth / dataset.attrs[f"teeth_{gear}"] * speed / (2.0 * np.pi * unit)
    number = dataset.attrs[f"teeth_{gear}"]
    waves = np.unique(dataset["nodal_diameter"].values[np.isfinite(own)])
    rays = []
    for harmonic in range(1, int(dataset.attrs["harmonics"]) + 1):
        rays.append(np.stack([speed, harmonic * number * turned], axis=1))
        for n in waves.tolist():
            for way in (1, -1) if n > 0 else (0,):
                ray = (harmonic * number - way * n) * turned
                look: dict[str, Any] = {"color": _colour(n), "ls": _STYLES[way], "lw": 0.6}
                axes.plot(speed, ray, zorder=1.8, alpha=0.8 if harmonic == 1 else 0.35, **look)
    axes.set_ylabel(f"natural frequency on the {gear} [{name}]")
    shown = _draw_critical(axes, dataset, critical, "frequency_body_Hz", rays, curves)
    _legend(figure, dataset, waves, shown, harmonics=False)
    orders = f"thin lines: orders h x {number} - n (F) and h x {number} + n (B) of the {gear}"
    axes.set_title(orders, loc="left", fontsize=9)
    return figure


# --- Alone and in mesh


def alone(dataset: xr.Dataset, gear: str) -> Figure:
    """Natural frequencies over nodal diameters of a gear alone on its bearings, and in mesh.

    After Guilbert 2017, Fig. III-19.
    """
    figure, (axes, change) = panels(
        "Modes alone and in mesh", dataset, (10.0, 5.6), 2, width_ratios=(1.4, 1.0)
    )
    names = ("nodal_diameter", "frequency_alone_Hz", "frequency_in_mesh_Hz", "likeness")
    number, before, after, likeness = (dataset[name].values for name in names)
    unit, name = frequency_unit(float(np.max(before, initial=1.0)))
    for n, low, high in zip(number, before / unit, after / unit, strict=True):
        axes.plot([n - 0.12, n + 0.12], [low, high], color=GREY, lw=0.8, zorder=2.0)
    look: dict[str, Any] = {"s": 34, "fc": "white", "ec": BLUE, "lw": 1.3, "zorder": 3}
    axes.scatter(number - 0.12, before / unit, label="alone", **look)
    percent = 100.0 * (after / before - 1.0)
    sure = likeness >= 0.5
    looks: tuple[dict[str, Any], ...] = (
        {"s": 30, "color": ORANGE, "label": "in mesh"},
        {"s": 40, "color": RED, "marker": "X", "ec": "white", "lw": 0.5},
    )
    for fits, style in zip((sure, ~sure), looks, strict=True):
        if fits.any():
            style: dict[str, Any] = {"label": "in mesh, much changed", "zorder": 3} | style
            axes.scatter(number[fits] + 0.12, after[fits] / unit, **style)
            change.scatter(number[fits], percent[fits], **style)
    change.axhline(0.0, color=GREY, lw=0.8)
    for each in (axes, change):
        each.xaxis.set_major_locator(MaxNLocator(integer=True))
        each.set_xlabel("nodal diameters [-]")
    axes.set(ylabel=f"natural frequency of the {gear} on its bearings [{name}]", ylim=(0.0, None))
    change.set_ylabel("change by the mesh [%]")
    legend_below(figure, *axes.get_legend_handles_labels(), ncols=3)
    return figure
