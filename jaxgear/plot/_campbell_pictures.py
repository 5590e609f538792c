"""Pictures of the modes of condensed bodies: Campbell diagrams, and gears alone and in mesh.

Their data are in `_campbell_tables`. Colours tell numbers of nodal diameters, at each speed those
of the wave that leads there.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from jaxgear._dynamics._campbell import CriticalSpeed
from jaxgear.plot._campbell_tables import (
    _on_body,
)
from jaxgear.plot._dynamic_pictures import (
    _frequency_unit,
    _runs,
    _speed_axes,
    _write_rays,
)
from jaxgear.plot._labels import Label, write_labels
from jaxgear.plot._palette import _BLUE, _GREEN, _GREY, _ORANGE, _RED, _SKY, PURPLE
from jaxgear.plot._pictures import _house_look, _panels
from jaxgear.scene._schema import GEARS

# Of waves of two and more nodal diameters; fewer are in grey and black.
_WAVES = (_BLUE, _ORANGE, _GREEN, _RED, PURPLE, _SKY, "#8c6d31", "#5254a3")
# With the gear, against it, neither.
_STYLES: dict[int, Any] = {1: "-", -1: (0, (5, 2)), 0: "-", 2: (0, (1, 1.2))}
_LETTERS = {1: "F", -1: "B", 0: "", 2: ""}
# Labels beyond these make a picture a table; the table is the CSV.
_LABELS = 24


# --- Seen from space


@_house_look()
def campbell(dataset: xr.Dataset, critical: Sequence[CriticalSpeed], title: str) -> Figure:
    """Natural frequencies seen from space over pinion speed, and where mesh harmonics meet them.

    **Arguments:**

    - `dataset`: from `turning_dataset`.
    - `critical`: crossings.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((9.6, 7.0), f"Campbell diagram: {title}")
    speed, teeth = dataset["speed"].values, int(dataset.attrs["teeth_pinion"])
    frequency = np.abs(dataset["frequency_Hz"].values)
    unit, name = _frequency_unit(float(np.nanmax(frequency[0])))
    top = 1.06 * float(np.nanmax(frequency[0])) / unit
    count = int(dataset.attrs["harmonics"])
    rays = [
        np.stack([speed, h * teeth * speed / (2.0 * np.pi * unit)], axis=1)
        for h in range(1, count + 1)
    ]
    for ray in rays:
        axes.plot(*ray.T, color="#b08000", lw=1.0, ls=(0, (8, 2, 1, 2)), zorder=1.9)
    curves = _draw_waves(axes, dataset, frequency / unit)
    axes.set_ylabel(f"natural frequency seen from space [{name}]")
    _speed_axes([axes], speed, teeth)
    axes.set_ylim(0.0, top)
    shown = [each for each in critical if each.space / unit < 0.99 * top]
    places = np.array([[each.speed, each.space / unit] for each in shown]).reshape(-1, 2)
    _mark_critical(axes, shown, places)
    _write_rays(axes, rays, places)
    _label_critical(axes, shown, places, [*rays, *curves])
    _legend(figure, np.unique(dataset["nodal_diameter"].values), shown, harmonics=True)
    return figure


def _colour(diameters: int) -> str:
    return ("#a8a8a8", "black")[diameters] if diameters < 2 else _WAVES[(diameters - 2) % 8]


def _draw_waves(
    axes: Axes, dataset: xr.Dataset, frequency: np.ndarray, *, joined: bool = True
) -> list[np.ndarray]:
    """Every mode in pieces of one leading wave and direction; all curves.

    Where the leading wave changes, pieces are joined or not.
    """
    speed, curves = dataset["speed"].values, []
    diameters, direction = dataset["nodal_diameter"].values, dataset["direction"].values
    for mode, own in enumerate(frequency.T):
        kinds = 10 * diameters[:, mode] + direction[:, mode]
        for _, first, last in _runs(kinds):
            n, way = int(diameters[first, mode]), int(direction[first, mode])
            # Up to where the next piece begins.
            on = joined or bool(diameters[min(last + 1, len(own) - 1), mode] == n)
            part = slice(first, last + 1 + on)
            look: dict[str, Any] = {"color": _colour(n), "ls": _STYLES[way]}
            look["lw"] = 1.4 if n >= 2 else 0.9
            axes.plot(speed[part], own[part], zorder=2.0 + 0.1 * (n >= 2), **look)
        curves.append(np.stack([speed, own], axis=1))
    return curves


def _mark_critical(axes: Axes, shown: Sequence[CriticalSpeed], places: np.ndarray) -> None:
    """A dot where the mesh frequency itself meets a mode, rings for its harmonics."""
    for each, (x, y) in zip(shown, places, strict=True):
        colour = _colour(each.diameters)
        style: dict[str, Any] = {"s": 30.0, "color": colour, "ec": "white", "lw": 0.6}
        if each.harmonic > 1:
            style = {"s": 14.0, "facecolors": "white", "edgecolors": colour, "lw": 0.9}
        axes.scatter([x], [y], zorder=3.2 if each.harmonic == 1 else 3.0, **style)


def _label_critical(
    axes: Axes, shown: Sequence[CriticalSpeed], places: np.ndarray, lines: Sequence[np.ndarray]
) -> None:
    """Nodal diameters, direction and speed at what the mesh frequency meets."""
    first = [i for i, each in enumerate(shown) if each.harmonic == 1]
    # Waves first, then what moves the mesh most.
    first.sort(key=lambda i: (shown[i].diameters < 2, -shown[i].mesh))
    labels = []
    for i in first[:_LABELS]:
        each = shown[i]
        words = f"{each.diameters}{_LETTERS[each.direction]} {each.speed:.0f}"
        at = float(places[i, 0]), float(places[i, 1])
        labels.append(Label(words, at, _colour(max(each.diameters, 1))))
    if labels:
        write_labels(axes, labels, lines, points=places, drop=True)


def _legend(
    figure: Figure, numbers: np.ndarray, shown: Sequence[CriticalSpeed], *, harmonics: bool
) -> None:
    handles = [Line2D([], [], color=_colour(int(n)), lw=1.6, label=f"n = {n}") for n in numbers]
    for way, words in ((1, "forward, F"), (-1, "backward, B")):
        handles.append(Line2D([], [], color=_GREY, lw=1.4, ls=_STYLES[way], label=words))
    if harmonics:
        line: dict[str, Any] = {"color": "#b08000", "lw": 1.0, "ls": (0, (8, 2, 1, 2))}
        handles.append(Line2D([], [], label="mesh harmonics", **line))
    dot: dict[str, Any] = {"marker": "o", "ls": "", "color": _GREY}
    if shown:
        handles.append(Line2D([], [], ms=5.5, label="critical [rad/s]", **dot))
    if any(each.harmonic > 1 for each in shown):
        handles.append(Line2D([], [], ms=4.0, mfc="white", label="by harmonics", **dot))
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=7,
        frameon=False,
        title="nodal diameters n of the leading wave, and which way it runs",
    )


# --- Seen from a gear


@_house_look()
def campbell_on_body(
    dataset: xr.Dataset, critical: Sequence[CriticalSpeed], title: str, gear: str
) -> Figure:
    """Natural frequencies on a gear over pinion speed, with the orders by which the mesh comes.

    Harmonic h comes to a wave of n nodal diameters as order h Z - n if it runs forward, h Z + n if
    it runs backward.

    **Arguments:**

    - `dataset`: from `turning_dataset`.
    - `critical`: crossings.
    - `title`: the case or the finding.
    - `gear`: pinion or wheel.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((9.6, 7.0), f"Campbell diagram on the body: {title}")
    speed, teeth = dataset["speed"].values, int(dataset.attrs["teeth_pinion"])
    own = _on_body(dataset, gear)
    rest = np.abs(dataset["frequency_Hz"].values[0])
    unit, name = _frequency_unit(float(np.max(rest)))
    top = 1.06 * float(np.max(rest)) / unit
    curves = _draw_waves(axes, dataset, own / unit, joined=False)
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
    _speed_axes([axes], speed, teeth)
    axes.set_ylim(0.0, top)
    shown = [
        each
        for each in critical
        if GEARS[each.gear] == gear and np.isfinite(each.body) and each.body / unit < 0.99 * top
    ]
    places = np.array([[each.speed, each.body / unit] for each in shown]).reshape(-1, 2)
    _mark_critical(axes, shown, places)
    _write_rays(axes, rays, places)
    _label_critical(axes, shown, places, curves)
    _legend(figure, waves, shown, harmonics=False)
    orders = f"thin lines: orders h x {number} - n (F) and h x {number} + n (B) of the {gear}"
    axes.set_title(orders, loc="left", fontsize=9)
    return figure


# --- Alone and in mesh


@_house_look()
def alone(rows: Mapping[str, np.ndarray], gear: str, title: str) -> Figure:
    """Natural frequencies over nodal diameters of a gear alone on its bearings, and in mesh.

    After Guilbert 2017, Fig. III-19.

    **Arguments:**

    - `rows`: from `alone_rows`.
    - `gear`: pinion or wheel.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes, change) = _panels(
        (10.0, 5.6), f"Modes alone and in mesh: {title}", columns=2, ratios=(1.4, 1.0)
    )
    number, before = rows["nodal_diameter"], rows["frequency_alone_Hz"]
    after = rows["frequency_in_mesh_Hz"]
    unit, name = _frequency_unit(float(np.max(before, initial=1.0)))
    for n, low, high in zip(number, before / unit, after / unit, strict=True):
        axes.plot([n - 0.12, n + 0.12], [low, high], color=_GREY, lw=0.8, zorder=2.0)
    look: dict[str, Any] = {"s": 34, "fc": "white", "ec": _BLUE, "lw": 1.3, "zorder": 3}
    axes.scatter(number - 0.12, before / unit, label="alone", **look)
    percent = 100.0 * (after / before - 1.0)
    sure = rows["likeness"] >= 0.5
    looks: tuple[dict[str, Any], ...] = (
        {"s": 30, "color": _ORANGE, "label": "in mesh"},
        {"s": 40, "color": _RED, "marker": "X", "ec": "white", "lw": 0.5},
    )
    for fits, style in zip((sure, ~sure), looks, strict=True):
        if fits.any():
            style = {"label": "in mesh, much changed", "zorder": 3} | style
            axes.scatter(number[fits] + 0.12, after[fits] / unit, **style)
            change.scatter(number[fits], percent[fits], **style)
    change.axhline(0.0, color=_GREY, lw=0.8)
    for each in (axes, change):
        each.xaxis.set_major_locator(MaxNLocator(integer=True))
        each.set_xlabel("nodal diameters [-]")
    axes.set(
        ylabel=f"natural frequency of the {gear} on its bearings [{name}]",
        ylim=(0.0, None),
    )
    change.set_ylabel("change by the mesh [%]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return figure
