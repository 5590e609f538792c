"""Pictures of waves in turning bodies: spectra, waves by order, levels over speed."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxgear._response._wave_words import BENT, wave_words
from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, PINK, RED, SKY
from jaxgear.plot._style import BOX, SURFACE, digits, house_look, panels
from jaxgear.plot._wave_atlas import wave_level

_SERIES = (BLUE, ORANGE, GREEN, RED, SKY, PINK)
_MARKS = "osD^v<"
# Mesh harmonics shown in spectra and in the map of waves.
_HARMONICS = 3.5
# Orders closer than this, over the number of teeth, have no room for a label each in the middle.
_NEAR = 0.2
# Amplitudes are shown over so many powers of ten.
_DECADES = 4
# Waves that get a line of their own over speed.
_LINES = 6


def _at_peak(dataset: xr.Dataset, gear: str) -> str:
    """The case, the speed and the gear that a picture shows."""
    speed = dataset.attrs["peak_speed_rad_s"]
    return f"{dataset.attrs['title']}, pinion at {speed:.5g} rad/s: {gear}"


# --- Spectra


@house_look()
def wave_spectra(dataset: xr.Dataset, gear: str) -> Figure:
    """What turns with the body and what stands still beside it show at the highest peak.

    **Arguments:**

    - `dataset`: the group `waves`.
    - `gear`: `pinion` or `wheel`.
    """
    figure, both = panels((11.0, 5.0), f"Spectra of the probes: {_at_peak(dataset, gear)}", 2)
    teeth = dataset.attrs[f"teeth_{gear}"]
    order = dataset[f"{gear}_order"].values
    amplitude = dataset[f"{gear}_probe_amplitude_um"].values
    turns = dataset[f"{gear}_probe_turns"].values.astype(bool)
    shown = (order > 0.0) & (order <= _HARMONICS * teeth)
    most = float(amplitude[:, shown].max(initial=1e-9))
    floor = most / 10.0**_DECADES
    words = ("turning with the body", "fixed in space")
    for axes, own, where in zip(both, (turns, ~turns), words, strict=True):
        for harmonic in range(1, int(_HARMONICS) + 1):
            axes.axvline(harmonic * teeth, color=GREY, lw=0.8, ls=":", zorder=0)
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
            axes.text(0.5, 0.5, "no probe", transform=axes.transAxes, ha="center", color=GREY)
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
            bbox=BOX,
            zorder=5,
        )


def _tooth_axis(axes: Axes, teeth: int) -> None:
    """Ticks at the orders of the mesh."""
    axes.set_xticks(teeth * np.arange(int(_HARMONICS) + 1))


# --- Waves by nodal diameter and order


@house_look()
def wave_map(dataset: xr.Dataset, gear: str) -> Figure:
    """Amplitude of the waves around the rim by nodal diameter and order, at the highest peak.

    **Arguments:**

    - `dataset`: the group `waves`.
    - `gear`: `pinion` or `wheel`.

    **Returns:**

    The figure; waves that stand in space are on the lines of their mesh harmonic.
    """
    figure, both = panels((10.6, 6.0), f"Waves around the rim: {_at_peak(dataset, gear)}", 2)
    teeth = dataset.attrs[f"teeth_{gear}"]
    each, orders = (dataset[f"{gear}_wave_{name}"].values for name in ("diameters", "order"))
    seen = (orders <= _HARMONICS * teeth) & (orders > 0.5 * teeth)
    most = int(np.abs(dataset[f"{gear}_diameters"].values).max())
    amplitude = dataset[f"{gear}_wave_amplitude_um"]
    sizes = {name: amplitude.sel(component=name).values for name in ("axial", "radial")}
    high = max(float(values[seen].max(initial=0.0)) for values in sizes.values()) or 1.0
    low = high / 10.0**_DECADES
    scale = LogNorm(low, high)
    span = np.array([-most - 0.5, most + 0.5])
    for axes, (name, values) in zip(both, sizes.items(), strict=True):
        for harmonic in range(1, int(_HARMONICS) + 2):
            axes.plot(span, harmonic * teeth - span, color=GREY, lw=0.7, ls=":", zorder=0)
        shown = np.flatnonzero(seen & (values > low))
        shown = shown[np.argsort(values[shown])]
        points = axes.scatter(
            each[shown],
            orders[shown],
            c=values[shown],
            s=_dot_size(values[shown], low, high),
            cmap=SURFACE,
            norm=scale,
            edgecolors="black",
            linewidths=0.3,
        )
        if shown.size:
            best = shown[-1]
            number, order = int(each[best]), float(orders[best])
            size = digits(float(values[best]), 3)
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
    figure.colorbar(points, ax=both, label="amplitude of the wave around the rim [µm]")
    handles = [Line2D([], [], color=GREY, lw=0.9, ls=":", label="stands still in space")]
    for share in (1.0, 0.1, 0.01):
        look: dict[str, Any] = {"marker": "o", "ls": "", "mec": "black", "mew": 0.3}
        look["color"] = points.to_rgba(np.asarray([share * high]))[0]
        size = np.sqrt(_dot_size(share * high, low, high))
        label = f"{digits(share * high, 2)} µm"
        handles.append(Line2D([], [], ms=size, label=label, **look))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _dot_size(amplitude: Any, low: float, high: float) -> Any:
    """Area of the mark of an amplitude [square points]."""
    return 8.0 + 90.0 * (np.log(amplitude / low) / np.log(high / low)) ** 2


# --- Levels over speed


@house_look()
def wave_levels(dataset: xr.Dataset, gear: str) -> Figure:
    """RMS over all orders of the mesh, over speed: of the strongest waves, and of the probes.

    **Arguments:**

    - `dataset`: the group `waves`.
    - `gear`: `pinion` or `wheel`.

    **Returns:**

    The figure, of the direction of the sweep with the highest peak.
    """
    title = f"Waves and probes over speed: {dataset.attrs['title']}: {gear}"
    figure, (left, right) = panels((11.0, 5.4), title, 2)
    own = dataset.sel(direction=dataset.attrs["peak_direction"])
    speed, number = own["speed"].values, own[f"{gear}_diameters"].values
    level = wave_level(own, gear).values
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
        axes.axvline(dataset.attrs["peak_speed_rad_s"], color=GREY, lw=0.8, ls=":", zorder=0)
        axes.set(xlabel="speed of the pinion [rad/s]", ylabel="RMS of all mesh orders [µm]")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, frameon=False)
    return figure
