"""Pictures of waves in turning bodies: spectra, waves by order, levels over speed."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxgear._response._wave_words import BENT, wave_words
from jaxgear.plot._palette import GREY, PINK, SURFACE, TEETH_SERIES
from jaxgear.plot._speed_axes import dots
from jaxgear.plot._style import BOX, axis_label, digits, legend_below, panels, write_at
from jaxgear.plot._wave_atlas import wave_level

_SERIES = (*TEETH_SERIES[:-1], PINK)
_MARKS = "osD^v<"
# Mesh harmonics shown in spectra and in the map of waves.
_HARMONICS = 3.5
# Orders closer than this, over the number of teeth, have no room for a label each in the middle.
_NEAR = 0.2
# Amplitudes are shown over so many powers of ten.
_DECADES = 4
# Waves that get a line of their own over speed.
_LINES = 6


def _at_peak(
    what: str, dataset: xr.Dataset, gear: str, size: tuple[float, float]
) -> tuple[Figure, list[Axes]]:
    """A figure of two axes headed by the case, the speed and the gear that it shows."""
    figure, both = panels(what, dataset, size, 2)
    speed = dataset.attrs["peak_speed_rad_s"]
    figure.suptitle(f"{what}: {dataset.attrs['title']}, pinion at {speed:.5g} rad/s: {gear}")
    return figure, both


def wave_spectra(dataset: xr.Dataset, gear: str) -> Figure:
    """What turns with the body and what stands still beside it show at the highest peak."""
    figure, both = _at_peak("Spectra of the probes", dataset, gear, (11.0, 5.0))
    teeth = dataset.attrs[f"teeth_{gear}"]
    order, amplitude = (
        dataset[f"{gear}_{name}"].values for name in ("order", "probe_amplitude_um")
    )
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
        axes.set(xlabel=f"order of the {gear}'s rotation", ylabel="amplitude [µm]", yscale="log")
        axes.set(ylim=(floor, 2.5 * most), xlim=(0.0, _HARMONICS * teeth))
        axes.set_title(where, loc="left")
        _name_strongest(axes, order, amplitude[own], shown, teeth)
        if own.any():
            axes.legend(loc="upper right", title="with the orders of its largest amplitudes")
        else:
            axes.text(0.5, 0.5, "no probe", transform=axes.transAxes, ha="center", color=GREY)
        # Ticks at the orders of the mesh.
        axes.set_xticks(teeth * np.arange(int(_HARMONICS) + 1))
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
        aside = 1.0 if at < _NEAR * teeth else float(aside)
        ha = {-1.0: "right", 0.0: "center", 1.0: "left"}[aside]
        look = {"ha": ha, "fontsize": 8.0, "bbox": BOX, "zorder": 5}
        write_at(axes, f"{at:.6g}", (at, found[at]), (3.0 * aside, 6), **look)


def wave_map(dataset: xr.Dataset, gear: str) -> Figure:
    """Amplitude of the waves around the rim by nodal diameter and order, at the highest peak.

    Waves that stand in space are on the lines of their mesh harmonic.
    """
    figure, both = _at_peak("Waves around the rim", dataset, gear, (10.6, 6.0))
    teeth = dataset.attrs[f"teeth_{gear}"]
    each, orders = (dataset[f"{gear}_wave_{name}"].values for name in ("diameters", "order"))
    seen = (orders <= _HARMONICS * teeth) & (orders > 0.5 * teeth)
    most = int(np.abs(dataset[f"{gear}_diameters"].values).max())
    amplitude = dataset[f"{gear}_wave_amplitude_um"]
    sizes = {name: amplitude.sel(component=name).values for name in ("axial", "radial")}
    high = max(float(values[seen].max(initial=0.0)) for values in sizes.values()) or 1.0
    low = high / 10.0**_DECADES
    span = np.array([-most - 0.5, most + 0.5])
    coloured = {"cmap": SURFACE, "norm": LogNorm(low, high), "edgecolors": "black"}
    for axes, (name, values) in zip(both, sizes.items(), strict=True):
        for harmonic in range(1, int(_HARMONICS) + 2):
            axes.plot(span, harmonic * teeth - span, color=GREY, lw=0.7, ls=":", zorder=0)
        shown = np.flatnonzero(seen & (values > low))
        shown = shown[np.argsort(values[shown])]
        size = values[shown]
        look: dict[str, Any] = {"s": _dot_size(size, low, high), "linewidths": 0.3, **coloured}
        points = axes.scatter(each[shown], orders[shown], c=size, **look)
        if shown.size:
            number, order = int(each[shown[-1]]), float(orders[shown[-1]])
            largest = digits(float(size[-1]), 3)
            words = f"{name}: order {order:g}, {wave_words(number)}: {largest} µm"
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
    for share in (high, 0.1 * high, 0.01 * high):
        look = {"marker": "o", "ls": "", "mec": "black", "mew": 0.3}
        look["color"] = points.to_rgba(np.asarray([share]))[0]
        look["ms"] = np.sqrt(_dot_size(share, low, high))
        handles.append(Line2D([], [], label=f"{digits(share, 2)} µm", **look))
    legend_below(figure, handles, ncols=4)
    return figure


def _dot_size(amplitude: Any, low: float, high: float) -> Any:
    """Area of the mark of an amplitude [square points]."""
    return 8.0 + 90.0 * (np.log(amplitude / low) / np.log(high / low)) ** 2


def wave_levels(dataset: xr.Dataset, gear: str) -> Figure:
    """RMS over all orders of the mesh, over speed: of the strongest waves, and of the probes.

    It is of the direction of the sweep with the highest peak.
    """
    figure, (left, right) = panels("Waves and probes over speed", dataset, (11.0, 5.4), 2)
    figure.suptitle(f"Waves and probes over speed: {dataset.attrs['title']}: {gear}")
    own = dataset.sel(direction=dataset.attrs["peak_direction"])
    speed, number = own["speed"].values, own[f"{gear}_diameters"].values
    level = wave_level(own, gear).values
    # Fewer nodal diameters are mostly the gear as a whole, and would hide the others.
    size = np.where(np.abs(number) >= BENT, level.max(axis=0), -1.0)
    strongest = np.argsort(-size, kind="stable")[: min(_LINES, int(np.sum(size >= 0.0)))]
    mark: dict[str, Any] = {"marker": dots(speed), "ms": 3}
    for place, wave in enumerate(sorted(strongest, key=lambda i: (abs(number[i]), number[i]))):
        look = mark.copy()
        look.update(color=_SERIES[place], ls="--" if number[wave] < 0 else "-")
        left.plot(speed, level[:, wave], label=wave_words(int(number[wave])), **look)
    left.set_title(f"waves around the rim, of {BENT} and more nodal diameters", loc="left")
    for place, name in enumerate(own[f"{gear}_probe"].values):
        turns = bool(own[f"{gear}_probe_turns"].values[place])
        look = mark.copy()
        look.update(color=_SERIES[place % 6], ls="-" if turns else "--")
        right.plot(speed, own[f"{gear}_probe_rms_um"].values[:, place], label=name, **look)
    right.set_title("probes", loc="left")
    for axes in (left, right):
        axes.axvline(dataset.attrs["peak_speed_rad_s"], color=GREY, lw=0.8, ls=":", zorder=0)
        axes.set(xlabel=axis_label(own["speed"]), ylabel="RMS of all mesh orders [µm]")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2, frameon=False)
    return figure
