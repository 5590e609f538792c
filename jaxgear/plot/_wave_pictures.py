"""Pictures of waves in turning bodies: spectra, waves by order, levels over speed, a moving shape.

Their data are in `_wave_tables`.
"""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fem_prep import surface
from jaxgear._response._waves import DIRECTIONS
from jaxgear._units import mm, um
from jaxgear._whole_file import whole_file
from jaxgear.plot._body_pictures import show
from jaxgear.plot._body_render import frame, render
from jaxgear.plot._palette import _BLUE, _GREEN, _GREY, _ORANGE, _PINK, _RED, _SKY
from jaxgear.plot._pictures import _BOX, _SURFACE, _digits, _house_look, _panels, _round_down
from jaxgear.plot._wave_tables import _grid, _wave_level, wave_map_columns
from jaxgear.study._body_waves import (
    BENT,
    MainWave,
    MovingBody,
    wave_words,
)

# Pictures in one period of an animation.
_FRAMES = 16

_SERIES = (_BLUE, _ORANGE, _GREEN, _RED, _SKY, _PINK)
_MARKS = "osD^v<"
# Mesh harmonics shown in spectra and in the map of waves.
_HARMONICS = 3.5
# Orders closer than this, over the number of teeth, have no room for a label each in the middle.
_NEAR = 0.2
# Amplitudes are shown over so many powers of ten.
_DECADES = 4
# Waves that get a line of their own over speed.
_LINES = 6
_PER_SECOND = 12
# Of the body's radius: how far its largest displacement is drawn.
_DRAWN = 0.07
_MOTION = "RdBu_r"


# --- Spectra


@_house_look()
def wave_spectra(dataset: xr.Dataset, gear: str, title: str) -> Figure:
    """What turns with the body and what stands still beside it show at the highest peak.

    **Arguments:**

    - `dataset`: from `waves_dataset`.
    - `gear`: `pinion` or `wheel`.
    - `title`: the case.

    **Returns:**

    The figure.
    """
    figure, panels = _panels((11.0, 5.0), f"Spectra of the probes: {title}", 2)
    teeth = dataset.attrs[f"teeth_{gear}"]
    order = dataset[f"{gear}_order"].values
    amplitude = dataset[f"{gear}_probe_amplitude_um"].values
    turns = dataset[f"{gear}_probe_turns"].values.astype(bool)
    shown = (order > 0.0) & (order <= _HARMONICS * teeth)
    most = float(amplitude[:, shown].max(initial=1e-9))
    floor = most / 10.0**_DECADES
    words = ("turning with the body", "fixed in space")
    for axes, own, where in zip(panels, (turns, ~turns), words, strict=True):
        for harmonic in range(1, int(_HARMONICS) + 1):
            axes.axvline(harmonic * teeth, color=_GREY, lw=0.8, ls=":", zorder=0)
        for number, probe in enumerate(np.flatnonzero(own)):
            seen = shown & (amplitude[probe] > floor)
            look: dict[str, Any] = {"color": _SERIES[number % 6]}
            # Side by side where both are at one order.
            place = order[seen] + 0.004 * teeth * number
            axes.vlines(place, floor, amplitude[probe][seen], lw=1.2, **look)
            name = str(dataset[f"{gear}_probe"].values[probe])
            axes.plot(place, amplitude[probe][seen], _MARKS[number % 6], ms=3.5, label=name, **look)
        axes.set(
            xlabel=f"order of the {gear}'s rotation",
            ylabel="amplitude [µm]",
            yscale="log",
            ylim=(floor, 2.5 * most),
            xlim=(0.0, _HARMONICS * teeth),
        )
        axes.set_title(where, loc="left")
        _name_strongest(axes, order, amplitude[own], shown, teeth)
        if own.any():
            axes.legend(loc="upper right", title="with the orders of its largest amplitudes")
        else:
            axes.text(0.5, 0.5, "no probe", transform=axes.transAxes, ha="center", color=_GREY)
        _tooth_axis(axes, teeth)
    return figure


def _name_strongest(
    axes: Axes, order: np.ndarray, amplitude: np.ndarray, shown: np.ndarray, teeth: int
) -> None:
    """Write the orders of each probe's largest amplitude of all, and of those by the mesh."""
    found: dict[float, float] = {}
    for chosen in (shown, shown & (order > 0.5 * teeth)):
        for row in amplitude if chosen.any() else ():
            best = np.flatnonzero(chosen)[np.argmax(row[chosen])]
            if row[best] > 0.0:
                at = float(order[best])
                found[at] = max(found.get(at, 0.0), float(row[best]))
    places = sorted(found)
    for number, at in enumerate(places):
        near = [other - at for other in places[max(number - 1, 0) : number + 2] if other != at]
        # Those of neighbours lie away from each other, and none on the axis.
        aside = next((-np.sign(gap) for gap in near if abs(gap) < _NEAR * teeth), 0.0)
        aside = 1.0 if at < _NEAR * teeth else aside
        axes.annotate(
            f"{at:.6g}",
            (at, found[at]),
            xytext=(3.0 * aside, 6),
            textcoords="offset points",
            ha={-1.0: "right", 0.0: "center", 1.0: "left"}[float(aside)],
            fontsize=8.0,
            bbox=_BOX,
            zorder=5,
        )


def _tooth_axis(axes: Axes, teeth: int) -> None:
    """Ticks at the orders of the mesh."""
    axes.set_xticks(teeth * np.arange(int(_HARMONICS) + 1))


# --- Waves by nodal diameter and order


@_house_look()
def wave_map(dataset: xr.Dataset, gear: str, title: str) -> Figure:
    """Amplitude of the waves around the rim by nodal diameter and order, at the highest peak.

    **Arguments:**

    - `dataset`: from `waves_dataset`.
    - `gear`: `pinion` or `wheel`.
    - `title`: the case.

    **Returns:**

    The figure; waves that stand in space are on the lines of their mesh harmonic.
    """
    figure, panels = _panels((10.6, 6.0), f"Waves around the rim: {title}", 2)
    teeth = dataset.attrs[f"teeth_{gear}"]
    data = wave_map_columns(dataset, gear)
    seen = (data["order"] <= _HARMONICS * teeth) & (data["order"] > 0.5 * teeth)
    most = int(np.abs(dataset[f"{gear}_diameters"].values).max())
    sizes = {name: data[f"{name}_um"] for name in ("axial", "radial")}
    high = max(float(values[seen].max(initial=0.0)) for values in sizes.values()) or 1.0
    low = high / 10.0**_DECADES
    scale = LogNorm(low, high)
    span = np.array([-most - 0.5, most + 0.5])
    for axes, (name, values) in zip(panels, sizes.items(), strict=True):
        for harmonic in range(1, int(_HARMONICS) + 2):
            axes.plot(span, harmonic * teeth - span, color=_GREY, lw=0.7, ls=":", zorder=0)
        shown = np.flatnonzero(seen & (values > low))
        shown = shown[np.argsort(values[shown])]
        points = axes.scatter(
            data["nodal_diameters"][shown],
            data["order"][shown],
            c=values[shown],
            s=_dot_size(values[shown], low, high),
            cmap=_SURFACE,
            norm=scale,
            edgecolors="black",
            linewidths=0.3,
        )
        if shown.size:
            best = shown[-1]
            number, order = int(data["nodal_diameters"][best]), float(data["order"][best])
            size = _digits(float(values[best]), 3)
            words = f"{name}: order {order:g}, {wave_words(number)}: {size} µm"
            axes.set_title(words, loc="left")
        axes.axvline(0.0, color="black", lw=0.6, zorder=0)
        axes.set(
            xlabel="nodal diameters: backward < 0 < forward",
            ylabel=f"order of the {gear}'s rotation, on the body",
            xlim=span,
            ylim=(0.5 * teeth, _HARMONICS * teeth),
            yticks=teeth * np.arange(1, int(_HARMONICS) + 1),
        )
    figure.colorbar(points, ax=panels, label="amplitude of the wave around the rim [µm]")
    handles = [Line2D([], [], color=_GREY, lw=0.9, ls=":", label="stands still in space")]
    for share in (1.0, 0.1, 0.01):
        look: dict[str, Any] = {"marker": "o", "ls": "", "mec": "black", "mew": 0.3}
        look["color"] = points.to_rgba(np.asarray([share * high]))[0]
        size = np.sqrt(_dot_size(share * high, low, high))
        label = f"{_digits(share * high, 2)} µm"
        handles.append(Line2D([], [], ms=size, label=label, **look))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _dot_size(amplitude: Any, low: float, high: float) -> Any:
    """Area of the mark of an amplitude [square points]."""
    return 8.0 + 90.0 * (np.log(amplitude / low) / np.log(high / low)) ** 2


# --- Levels over speed


@_house_look()
def wave_levels(dataset: xr.Dataset, gear: str, title: str) -> Figure:
    """RMS over all orders of the mesh, over speed: of the strongest waves, and of the probes.

    **Arguments:**

    - `dataset`: from `waves_dataset`.
    - `gear`: `pinion` or `wheel`.
    - `title`: the case.

    **Returns:**

    The figure, of the direction of the sweep with the highest peak.
    """
    figure, (left, right) = _panels((11.0, 5.4), f"Waves and probes over speed: {title}", 2)
    own = dataset.sel(direction=dataset.attrs["peak_direction"])
    speed, number = own["speed"].values, own[f"{gear}_diameters"].values
    level = _wave_level(own, gear)
    # Fewer nodal diameters are mostly the gear as a whole, and would hide the others.
    size = np.where(np.abs(number) >= BENT, level.max(axis=0), -1.0)
    strongest = np.argsort(-size, kind="stable")[: min(_LINES, int(np.sum(size >= 0.0)))]
    mark = "o" if speed.size < 40 else ""
    for place, wave in enumerate(sorted(strongest, key=lambda i: (abs(number[i]), number[i]))):
        left.plot(
            speed,
            level[:, wave],
            marker=mark,
            ms=3,
            color=_SERIES[place],
            ls="--" if number[wave] < 0 else "-",
            label=wave_words(int(number[wave])),
        )
    left.set_title(f"waves around the rim, of {BENT} and more nodal diameters", loc="left")
    for place, name in enumerate(own[f"{gear}_probe"].values):
        values = own[f"{gear}_probe_rms_um"].values[:, place]
        turns = bool(own[f"{gear}_probe_turns"].values[place])
        look: dict[str, Any] = {"color": _SERIES[place % 6], "ls": "-" if turns else "--"}
        right.plot(speed, values, marker=mark, ms=3, label=name, **look)
    right.set_title("probes", loc="left")
    for axes in (left, right):
        axes.axvline(dataset.attrs["peak_speed_rad_s"], color=_GREY, lw=0.8, ls=":", zorder=0)
        axes.set(xlabel="speed of the pinion [rad/s]", ylabel="RMS of all mesh orders [µm]")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, frameon=False)
    return figure


# --- The body in motion


def animate_shape(
    path: Path, body: MovingBody, shape: np.ndarray, main: MainWave, title: str
) -> None:
    """One order of a body over one of its periods, as an animated picture.

    **Arguments:**

    - `path`: of the file, with the ending .gif.
    - `body`: that moves.
    - `shape`: complex displacement of its nodes, shape `[node, 3]` [m].
    - `main`: which order that is.
    - `title`: the case.
    """
    nodes, faces = body.nodes, _faces(body)
    along = _along(nodes, shape, main.component)
    most = float(np.abs(along).max()) or 1.0
    scale = _round_down(_DRAWN * body.radius / max(float(np.abs(shape).max()), 1e-15))
    colours = ScalarMappable(Normalize(-most / um, most / um), _MOTION)
    with _house_look(), whole_file(path) as draft:
        figure = Figure(figsize=(5.6, 4.4))
        figure.suptitle(title)
        axes = figure.add_axes((0.02, 0.02, 0.76, 0.84))
        bar = figure.add_axes((0.82, 0.14, 0.03, 0.6))
        figure.colorbar(colours, cax=bar, label=f"{DIRECTIONS[main.component]} displacement [µm]")
        words = f"order {main.order:g}: {main.words}; drawn {scale:g} times as large"
        writer = PillowWriter(fps=_PER_SECOND)
        low, high = _window(nodes)
        with writer.saving(figure, str(draft), dpi=80):
            for step in range(_FRAMES):
                phase = np.exp(2j * np.pi * step / _FRAMES)
                values = np.real(along * phase) / um
                fill = np.asarray(colours.to_rgba(values[faces].ravel()))[:, :3]
                moved = nodes + scale * np.real(shape * phase)
                axes.clear()
                show(axes, render(moved, faces, fill.reshape(-1, 8, 3), edges=True, pixels=300))
                # The picture must not jump as the body moves.
                axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
                axes.set_title(words, fontsize=9.0)
                writer.grab_frame()


def _window(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the viewer sees of a body with room to move: left and lower, right and upper end."""
    placed = nodes @ frame()[:, :2] / mm
    room = 1.2 * _DRAWN * float(np.abs(placed).max())
    return placed.min(axis=0) - room, placed.max(axis=0) + room


def _faces(body: MovingBody) -> np.ndarray:
    """The surface of a body, or its rim if no more is known."""
    if not body.has_grid:
        return body.built.body.rim_faces
    return surface(_grid(body))


def _along(nodes: np.ndarray, shape: np.ndarray, component: int) -> np.ndarray:
    """Radial, tangential or axial part of a displacement."""
    if component == 2:
        return shape[:, 2]
    radius = np.maximum(np.hypot(nodes[:, 0], nodes[:, 1]), 1e-12)
    x, y = nodes[:, 0] / radius, nodes[:, 1] / radius
    parts = x * shape[:, 0] + y * shape[:, 1], x * shape[:, 1] - y * shape[:, 0]
    return parts[component]


# --- All that a sweep draws of waves
