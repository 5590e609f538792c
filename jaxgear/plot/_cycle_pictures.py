"""Pictures of one mesh cycle, and of the transmission error at many torques."""

from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from jaxgear.plot._cycle import cycle_periods, cycle_statistics, flank_grid, mesh_orders, unrolled
from jaxgear.plot._cycle_tables import (
    FLANK_MAPS,
    along_flank,
    face_load_columns,
    harris_map_columns,
    load_sharing_columns,
    over_cycle,
    pair_error_columns,
    phase_of_largest,
    spectra,
)
from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, RED, SURFACE
from jaxgear.plot._style import (
    axis_label,
    digits,
    line_width,
    mark_points,
    over_face,
    panels,
    phase_axis,
    roll_axis,
    room_above,
    surface,
)

_MARKED: dict[str, Any] = {"marker": "o", "ms": 3.5}
_FLANK_MAPS = dict(
    zip(FLANK_MAPS, (("line load", "N/mm"), ("Hertzian pressure", "MPa")), strict=True)
)


def _draw_over_cycle(axes: Axes, dataset: xr.Dataset, name: str, label: str, sizes: str) -> float:
    """A variable over the cycle with its mean, which is returned; `sizes` names its statistics."""
    phase, values = over_cycle(dataset, name).values()
    mean, rms, span = cycle_statistics(dataset[name])
    axes.plot(phase, values, color=BLUE, lw=line_width(dataset["phase"].values))
    axes.axhline(mean, color=GREY, lw=0.8, ls="--")
    unit = label.partition("[")[2].rstrip("]")
    sizes = sizes.format(rms=f"RMS {digits(rms, 3)} {unit}")
    words = f"mean {digits(mean, 4)} {unit} (dashed), {sizes}peak to peak {digits(span, 3)} {unit}"
    axes.set_title(words, loc="left")
    phase_axis(axes, label, dataset["phase"].values)
    return mean


def transmission_error(dataset: xr.Dataset) -> Figure:
    """Transmission error over two mesh periods or the longer cycle, and its mesh harmonics."""
    figure, (time, order) = panels(
        "Transmission error", dataset, (9.6, 4.0), 2, width_ratios=(1.7, 1.0)
    )
    name, label = "transmission_error_um", "transmission error [µm]"
    mean = _draw_over_cycle(time, dataset, name, label, "{rms}, ")
    error = dataset[name].values
    # A nearly constant error must not look like a large one.
    room = max(0.6 * float(np.ptp(error)), 5e-3 * abs(mean))
    middle = 0.5 * (np.max(error) + np.min(error))
    time.set_ylim(middle - room, middle + room)
    harmonic, amplitude = (dataset[name].values for name in ("harmonic", "te_harmonic_um"))
    order.vlines(harmonic, 0.0, amplitude, color=BLUE)
    order.plot(harmonic, amplitude, "o", color=BLUE)
    order.set(xlabel="mesh harmonic [-]", ylabel="amplitude [µm]", xticks=harmonic)
    # Nor must its rounding.
    order.set_ylim(0.0, max(1.08 * np.max(amplitude), 1e-3 * abs(mean)))
    order.set_title("harmonics (zero to peak)", loc="left")
    return figure


def stiffness_and_sharing(dataset: xr.Dataset) -> Figure:
    """Mesh stiffness over the cycle, and each pair's share of the load."""
    figure, (stiffness, share) = panels("Mesh stiffness and load sharing", dataset, (9.6, 4.0), 2)
    name = "mesh_stiffness_N_um"
    _draw_over_cycle(stiffness, dataset, name, "mesh stiffness [N/µm]", "")
    stiffness.set_ylim(0.0, 1.1 * float(dataset[name].max()))
    data, width = load_sharing_columns(dataset), line_width(dataset["phase"].values)
    pairs = np.unique(data["tooth_pair"])
    for pair in pairs:
        own = data["tooth_pair"] == pair
        share.plot(data["roll_mm"][own], data["load_sharing"][own], color=BLUE, lw=width)
    count = "one tooth pair" if len(pairs) == 1 else f"{len(pairs)} tooth pairs"
    share.set_title(f"{count} from entry to exit", loc="left")
    share.set(xlabel="roll length at mid-face [mm]", ylabel="share of the mesh force [-]")
    share.set_ylim(0, 1.09)
    mark_points(share, dataset["path_point_roll_mm"])
    return figure


def flank_maps(dataset: xr.Dataset) -> Figure:
    """Line load and pressure over the pinion's flank, along its roll angle and diameter."""
    figure, both = panels("Loads on the pinion's flank", dataset, (9.6, 4.2), 2)
    for axes, (variable, (quantity, unit)) in zip(both, _FLANK_MAPS.items(), strict=True):
        grid = flank_grid(dataset, variable, "pinion")
        place, diameter = along_flank(dataset, grid["profile_position"].values)
        half = 0.5 * (place[1] - place[0])
        edges = np.append(place - half, place[-1] + half)
        area = surface(axes, edges, over_face(dataset), grid.values, vmin=0.0)
        axes.set_ylabel("position from mid-face [mm]")
        roll_axis(axes, place, diameter)
        axes.set_title(f"largest {digits(float(dataset[variable].max()), 4)} {unit}", loc="left")
        angle, _ = along_flank(dataset, dataset["path_point_position"].values)
        mark_points(axes, dataset["path_point_position"].copy(data=angle), on_surface=True)
        figure.colorbar(area, ax=axes, label=f"{quantity} [{unit}]")
    return figure


def face_load(dataset: xr.Dataset) -> Figure:
    """Load per face width across the face: its mean over the cycle, and where it is largest."""
    figure, (axes,) = panels("Load across the face", dataset, (7.2, 4.4))
    face, load, largest = face_load_columns(dataset).values()
    mean, phase = float(np.mean(load)), float(dataset["phase"].values[phase_of_largest(dataset)])
    words = f"at phase {phase:.3f}, where it is largest"
    axes.plot(face, largest, color=ORANGE, ls="--", label=words, **_MARKED)
    axes.plot(face, load, color=BLUE, label="mean over the cycle", **_MARKED)
    words = rf"mean {digits(mean, 4)} N/mm, $K_{{H\beta}}$ = {np.max(load) / mean:.3f}"
    axes.axhline(mean, color=GREY, lw=1.0, ls=":", label=words)
    half = 0.5 * dataset.attrs["face_width_mm"]
    axes.set(
        xlabel="position from mid-face, left (-Z) to right [mm]",
        ylabel="load per face width [N/mm]",
        xlim=(-half, half),
        ylim=(0.0, 1.35 * max(float(np.max(largest)), float(np.max(load)))),
    )
    axes.legend(loc="upper center")
    return figure


def harris_map(dataset: xr.Dataset) -> Figure:
    """Transmission error over phase for several torques, and its size over torque."""
    figure, (curves, size) = panels("Harris map", dataset, (9.6, 4.2), 2, width_ratios=(1.5, 1.0))
    phases, te_um = dataset["phase"].values, dataset["harris_te_um"].values
    torques_Nm, means, rms, spans = harris_map_columns(dataset).values()
    colours, norm = torque_colours(torques_Nm)
    # Shafts and bearings lift each curve by far more than it moves.
    apart = float(np.ptp(te_um)) > 8.0 * float(np.max(spans))
    for torque, error, mean in zip(torques_Nm, te_um, means, strict=True):
        curve = unrolled(phases, error - mean if apart else error)
        curves.plot(*curve, color=colours(norm(torque)), lw=min(line_width(phases), 1.3))
    label = "transmission error less its mean [µm]" if apart else "transmission error [µm]"
    phase_axis(curves, label, phases)
    torque_bar(figure, curves, torques_Nm)
    size.plot(torques_Nm, spans, color=ORANGE, label="peak to peak", **_MARKED)
    size.plot(torques_Nm, rms, color=BLUE, label="RMS", **_MARKED)
    size.set(xlabel=axis_label(dataset["torque_Nm"]), ylabel="TE fluctuation [µm]")
    size.set_ylim(0.0, 1.25 * float(np.max(spans)))
    size.legend(loc="upper left", ncols=2)
    return figure


def torque_colours(torques_Nm: np.ndarray) -> tuple[Colormap, Normalize]:
    """A colour for each torque; the palest of the map is left out."""
    norm = Normalize(float(np.min(torques_Nm)), 1.08 * float(np.max(torques_Nm)))
    return matplotlib.colormaps[SURFACE].resampled(256), norm


def torque_bar(figure: Figure, axes: Axes, torques_Nm: np.ndarray) -> None:
    """The bar that says which colour is which torque."""
    colours, norm = torque_colours(torques_Nm)
    label = "torque on the pinion [N m]"
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=axes, label=label)
    if np.ptp(torques_Nm) > 0.0:
        bar.ax.set_ylim(float(np.min(torques_Nm)), float(np.max(torques_Nm)))


def te_spectrum(dataset: xr.Dataset) -> Figure:
    """Orders of the transmission error at several torques, and its mesh harmonics over torque."""
    what = "Spectrum of the TE over torque"
    figure, (spectrum, size) = panels(what, dataset, (9.6, 4.2), 2, width_ratios=(1.5, 1.0))
    phases, torques_Nm = dataset["phase"].values, dataset["torque_Nm"].values
    data = spectra(dataset)
    order, amplitudes = data["order"].values, data["te_order_um"].values
    colours, norm = torque_colours(torques_Nm)
    fine = cycle_periods(phases) > 1
    for torque, amplitude in zip(torques_Nm, amplitudes, strict=True):
        style: dict[str, Any] = {"lw": 0.7} if fine else {"lw": 1.3, **_MARKED}
        spectrum.plot(order, amplitude, color=colours(norm(torque)), **style)
    most = max(float(np.max(amplitudes)), 1e-9)
    # What is further down is rounding.
    spectrum.set(yscale="log", ylim=(max(float(np.min(amplitudes)), 1e-6 * most) / 1.5, 2.0 * most))
    spectrum.set(xlabel="order of the mesh frequency [-]", ylabel="amplitude of the TE [µm]")
    whole = mesh_orders(phases)
    spectrum.set_xticks(whole)
    spectrum.set_xlim(0.0, whole[-1] + 0.5)
    words = "mesh harmonics (zero to peak)"
    if fine:
        words = f"orders in steps of 1/{cycle_periods(phases)}; mesh harmonics dotted"
        for harmonic in whole:
            spectrum.axvline(harmonic, color=GREY, lw=0.8, ls=":", zorder=0.5)
    spectrum.set_title(words, loc="left")
    torque_bar(figure, spectrum, torques_Nm)
    for harmonic, colour, marker in zip(whole, (BLUE, ORANGE, GREEN, RED), "os^v", strict=False):
        over_torque = amplitudes[:, np.isclose(order, harmonic)][:, 0]
        look: dict[str, Any] = {"color": colour, "marker": marker, "ms": 3.5}
        size.plot(torques_Nm, over_torque, label=f"order {harmonic}", **look)
    size.set(xlabel=axis_label(dataset["torque_Nm"]), ylabel="amplitude of the TE [µm]")
    room_above(size, 0.25)
    size.set_ylim(bottom=0.0)
    size.legend(loc="upper left", ncols=2)
    return figure


def unloaded_error(dataset: xr.Dataset) -> Figure:
    """Transmission error of rigid gears over the cycle, below those of each pair, and harmonics."""
    figure, (time, order) = panels(
        "Transmission error without load", dataset, (9.6, 4.0), 2, width_ratios=(1.7, 1.0)
    )
    name, label = "unloaded_te_um", "transmission error [µm]"
    alone = pair_error_columns(dataset)
    periods = cycle_periods(dataset["phase"].values)
    end = max(periods, 2)
    for pair in np.unique(alone["tooth_pair"]):
        own = alone["tooth_pair"] == pair
        passage, error = alone["passage"][own], alone["pair_te_um"][own]
        before = int(np.ceil(np.max(passage) / periods))
        for entry in range(pair - before * periods, end + 1, periods):
            time.plot(entry + passage, error, color=ORANGE, lw=0.8, zorder=1)
    time.plot([], [], color=ORANGE, lw=0.8, label="of one tooth pair alone")
    _draw_over_cycle(time, dataset, name, label, "{rms}, ")
    values = dataset[name].values
    # Pairs that do not touch are far off; what counts is where they cross.
    room = max(float(np.ptp(values)), 1e-3)
    time.set_ylim(np.min(values) - 0.3 * room, np.max(values) + 1.5 * room)
    time.set_xlim(0.0, end)
    time.legend(loc="upper right")
    harmonic, amplitude = (dataset[it].values for it in ("harmonic", "unloaded_te_harmonic_um"))
    order.vlines(harmonic, 0.0, amplitude, color=BLUE)
    order.plot(harmonic, amplitude, "o", color=BLUE)
    order.set(xlabel="mesh harmonic [-]", ylabel="amplitude [µm]", xticks=harmonic)
    order.set_ylim(0.0, max(1.08 * np.max(amplitude), 1e-3))
    order.set_title("harmonics (zero to peak)", loc="left")
    return figure
