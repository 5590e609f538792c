"""Pictures of one mesh cycle, and of the transmission error at many torques."""

from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from jaxgear.plot._cycle import (
    cycle_periods,
    cycle_statistics,
    flank_grid,
    mesh_orders,
    unrolled,
)
from jaxgear.plot._cycle_tables import (
    FLANK_MAPS,
    along_flank,
    face_load_columns,
    harris_map_columns,
    load_sharing_columns,
    over_cycle,
    phase_of_largest,
    spectra,
)
from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, RED
from jaxgear.plot._style import (
    SURFACE,
    digits,
    house_look,
    line_width,
    mark_points,
    phase_axis,
    roll_axis,
    titled,
)

_FLANK_MAPS = dict(
    zip(FLANK_MAPS, (("line load", "N/mm"), ("Hertzian pressure", "MPa")), strict=True)
)


@house_look()
def transmission_error(dataset: xr.Dataset) -> Figure:
    """Transmission error over two mesh periods or the longer cycle, and its mesh harmonics."""
    figure, (time, order) = titled(dataset, "Transmission error", (9.6, 4.0), 2, (1.7, 1.0))
    phase, error = over_cycle(dataset, "transmission_error_um").values()
    harmonic, amplitude = (dataset[name].values for name in ("harmonic", "te_harmonic_um"))
    mean, rms, span = cycle_statistics(dataset["transmission_error_um"])
    width = line_width(dataset["phase"].values)
    time.plot(phase, error, color=BLUE, lw=width)
    time.axhline(mean, color=GREY, lw=0.8, ls="--")
    size = f"RMS {digits(rms, 3)} µm, peak to peak {digits(span, 3)} µm"
    time.set_title(f"mean {digits(mean, 4)} µm (dashed), {size}", loc="left")
    # A nearly constant error must not look like a large one.
    room = max(0.6 * span, 5e-3 * abs(mean))
    middle = 0.5 * (np.max(error) + np.min(error))
    time.set_ylim(middle - room, middle + room)
    phase_axis(time, "transmission error [µm]", dataset["phase"].values)
    order.vlines(harmonic, 0.0, amplitude, color=BLUE)
    order.plot(harmonic, amplitude, "o", color=BLUE)
    order.set(xlabel="mesh harmonic [-]", ylabel="amplitude [µm]", xticks=harmonic)
    # Nor must its rounding.
    order.set_ylim(0.0, max(1.08 * np.max(amplitude), 1e-3 * abs(mean)))
    order.set_title("harmonics (zero to peak)", loc="left")
    return figure


@house_look()
def stiffness_and_sharing(dataset: xr.Dataset) -> Figure:
    """Mesh stiffness over the cycle, and each pair's share of the load."""
    figure, (stiffness, share) = titled(dataset, "Mesh stiffness and load sharing", (9.6, 4.0), 2)
    data = over_cycle(dataset, "mesh_stiffness_N_um")
    mean, _, span = cycle_statistics(dataset["mesh_stiffness_N_um"])
    width = line_width(dataset["phase"].values)
    stiffness.plot(data["phase"], data["mesh_stiffness_N_um"], color=BLUE, lw=width)
    stiffness.axhline(mean, color=GREY, lw=0.8, ls="--")
    size = f"peak to peak {digits(span, 3)} N/µm"
    stiffness.set_title(f"mean {digits(mean, 4)} N/µm (dashed), {size}", loc="left")
    stiffness.set_ylim(0.0, 1.1 * np.max(data["mesh_stiffness_N_um"]))
    phase_axis(stiffness, "mesh stiffness [N/µm]", dataset["phase"].values)
    data = load_sharing_columns(dataset)
    pairs = np.unique(data["tooth_pair"])
    for pair in pairs:
        own = data["tooth_pair"] == pair
        share.plot(data["roll_mm"][own], data["load_sharing"][own], color=BLUE, lw=width)
    count = "one tooth pair" if len(pairs) == 1 else f"{len(pairs)} tooth pairs"
    share.set_title(f"{count} from entry to exit", loc="left")
    share.set(
        xlabel="roll length at mid-face [mm]", ylabel="share of the mesh force [-]", ylim=(0, 1.09)
    )
    mark_points(share, dataset["path_point_roll_mm"])
    return figure


@house_look()
def flank_maps(dataset: xr.Dataset) -> Figure:
    """Line load and pressure over the pinion's flank, along its roll angle and diameter."""
    figure, both = titled(dataset, "Loads on the pinion's flank", (9.6, 4.2), 2)
    for axes, (variable, (quantity, unit)) in zip(both, _FLANK_MAPS.items(), strict=True):
        grid = flank_grid(dataset, variable, "pinion")
        place, diameter = along_flank(dataset, grid["profile_position"].values)
        half = 0.5 * (place[1] - place[0])
        face = np.linspace(-0.5, 0.5, grid.sizes["slice"] + 1) * dataset.attrs["face_width_mm"]
        surface = axes.pcolormesh(
            np.append(place - half, place[-1] + half),
            face,
            grid.values.T,
            cmap=SURFACE,
            vmin=0.0,
            rasterized=True,
        )
        axes.grid(False)
        axes.set_ylabel("position from mid-face [mm]")
        roll_axis(axes, place, diameter)
        axes.set_title(f"largest {digits(float(dataset[variable].max()), 4)} {unit}", loc="left")
        angle, _ = along_flank(dataset, dataset["path_point_position"].values)
        mark_points(axes, dataset["path_point_position"].copy(data=angle), on_surface=True)
        figure.colorbar(surface, ax=axes, label=f"{quantity} [{unit}]")
    return figure


@house_look()
def face_load(dataset: xr.Dataset) -> Figure:
    """Load per face width across the face: its mean over the cycle, and where it is largest."""
    figure, (axes,) = titled(dataset, "Load across the face", (7.2, 4.4))
    data = face_load_columns(dataset)
    face, load = data["face_position_mm"], data["face_load_mean_N_mm"]
    mean = float(np.mean(load))
    phase = float(dataset["phase"].values[phase_of_largest(dataset)])
    style = {"marker": "o", "ms": 3.5}
    axes.plot(
        face,
        data["face_load_at_largest_N_mm"],
        color=ORANGE,
        ls="--",
        label=f"at phase {phase:.3f}, where it is largest",
        **style,
    )
    axes.plot(face, load, color=BLUE, label="mean over the cycle", **style)
    axes.axhline(
        mean,
        color=GREY,
        lw=1.0,
        ls=":",
        label=rf"mean {digits(mean, 4)} N/mm, $K_{{H\beta}}$ = {np.max(load) / mean:.3f}",
    )
    half = 0.5 * dataset.attrs["face_width_mm"]
    most = max(float(np.max(data["face_load_at_largest_N_mm"])), float(np.max(load)))
    axes.set(
        xlabel="position from mid-face, left (-Z) to right [mm]",
        ylabel="load per face width [N/mm]",
        xlim=(-half, half),
        ylim=(0.0, 1.35 * most),
    )
    axes.legend(loc="upper center")
    return figure


@house_look()
def harris_map(dataset: xr.Dataset) -> Figure:
    """Transmission error over phase for several torques, and its size over torque."""
    figure, (curves, size) = titled(dataset, "Harris map", (9.6, 4.2), 2, (1.5, 1.0))
    phases, te_um = dataset["phase"].values, dataset["harris_te_um"].values
    data = harris_map_columns(dataset)
    torques_Nm = data["torque_pinion_Nm"]
    colours, norm = torque_colours(torques_Nm)
    width = min(line_width(phases), 1.3)
    # Shafts and bearings lift each curve by far more than it moves.
    apart = float(np.ptp(te_um)) > 8.0 * float(np.max(data["te_peak_to_peak_um"]))
    for torque, error, mean in zip(torques_Nm, te_um, data["te_mean_um"], strict=True):
        shown = error - mean if apart else error
        curves.plot(*unrolled(phases, shown), color=colours(norm(torque)), lw=width)
    label = "transmission error less its mean [µm]" if apart else "transmission error [µm]"
    phase_axis(curves, label, phases)
    torque_bar(figure, curves, torques_Nm)
    style = {"marker": "o", "ms": 3.5}
    size.plot(torques_Nm, data["te_peak_to_peak_um"], color=ORANGE, label="peak to peak", **style)
    size.plot(torques_Nm, data["te_rms_um"], color=BLUE, label="RMS", **style)
    size.set(xlabel="torque on the pinion [N m]", ylabel="TE fluctuation [µm]")
    size.set_ylim(0.0, 1.25 * float(np.max(data["te_peak_to_peak_um"])))
    size.legend(loc="upper left", ncols=2)
    return figure


def torque_colours(torques_Nm: np.ndarray) -> tuple[Colormap, Normalize]:
    """A colour for each torque; the palest of the map is left out."""
    norm = Normalize(float(np.min(torques_Nm)), 1.08 * float(np.max(torques_Nm)))
    return matplotlib.colormaps[SURFACE].resampled(256), norm


def torque_bar(figure: Figure, axes: Axes, torques_Nm: np.ndarray) -> None:
    """The bar that says which colour is which torque."""
    colours, norm = torque_colours(torques_Nm)
    bar = figure.colorbar(
        ScalarMappable(norm, colours), ax=axes, label="torque on the pinion [N m]"
    )
    if np.ptp(torques_Nm) > 0.0:
        bar.ax.set_ylim(float(np.min(torques_Nm)), float(np.max(torques_Nm)))


@house_look()
def te_spectrum(dataset: xr.Dataset) -> Figure:
    """Orders of the transmission error at several torques, and its mesh harmonics over torque."""
    figure, (spectrum, size) = titled(
        dataset, "Spectrum of the TE over torque", (9.6, 4.2), 2, (1.5, 1.0)
    )
    phases, torques_Nm = dataset["phase"].values, dataset["torque_Nm"].values
    data = spectra(dataset)
    order, amplitudes = data["order"].values, data["te_order_um"].values
    colours, norm = torque_colours(torques_Nm)
    fine = cycle_periods(phases) > 1
    style: dict[str, Any] = {"lw": 0.7} if fine else {"lw": 1.3, "marker": "o", "ms": 3.5}
    for torque, amplitude in zip(torques_Nm, amplitudes, strict=True):
        spectrum.plot(order, amplitude, color=colours(norm(torque)), **style)
    most = max(float(np.max(amplitudes)), 1e-9)
    # What is further down is rounding.
    spectrum.set(yscale="log", ylim=(max(float(np.min(amplitudes)), 1e-6 * most) / 1.5, 2.0 * most))
    spectrum.set(xlabel="order of the mesh frequency [-]", ylabel="amplitude of the TE [µm]")
    whole = mesh_orders(phases)
    spectrum.set_xticks(whole)
    spectrum.set_xlim(0.0, whole[-1] + 0.5)
    if fine:
        step = f"orders in steps of 1/{cycle_periods(phases)}; mesh harmonics dotted"
        spectrum.set_title(step, loc="left")
        for harmonic in whole:
            spectrum.axvline(harmonic, color=GREY, lw=0.8, ls=":", zorder=0.5)
    else:
        spectrum.set_title("mesh harmonics (zero to peak)", loc="left")
    torque_bar(figure, spectrum, torques_Nm)
    for harmonic, colour, marker in zip(whole, (BLUE, ORANGE, GREEN, RED), "os^v", strict=False):
        over_torque = amplitudes[:, np.isclose(order, harmonic)][:, 0]
        label = f"order {harmonic}"
        size.plot(torques_Nm, over_torque, color=colour, marker=marker, ms=3.5, label=label)
    size.set(xlabel="torque on the pinion [N m]", ylabel="amplitude of the TE [µm]")
    low, high = size.get_ylim()
    size.set_ylim(0.0, high + 0.25 * (high - low))
    size.legend(loc="upper left", ncols=2)
    return figure
