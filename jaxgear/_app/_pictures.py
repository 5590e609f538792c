"""The canonical pictures. Each is a function from plain arrays or the dataset to a figure.

Every picture has beside it the function that gives its data as columns, for `save`. Figures are
made without pyplot, so nothing is kept, shown or configured behind the caller's back.
"""

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import matplotlib
import numpy as np
import xarray as xr
from jaxtyping import Array
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, NullFormatter

import jaxgear as jg
from jaxgear._app._results import BODIES, cycle_statistics, flank_grid, whole_file, write_csv

Columns = dict[str, np.ndarray]

# Okabe and Ito's palette, told apart by colour-blind readers too.
_BLUE, _ORANGE, _GREEN, _RED, _SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9"
_GREY, _PINK = "#6b6b6b", "#ff6f91"
_SURFACE = "viridis"

_LOOK: dict[Any, Any] = {
    "font.size": 10.0,
    "axes.titlesize": 10.0,
    "figure.titlesize": 12.0,
    "legend.fontsize": 9.0,
    "legend.framealpha": 0.9,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.6,
    # Letters stay text in SVG, and two runs write the same file.
    "svg.fonttype": "none",
    "svg.hashsalt": "jaxgear",
}


@contextlib.contextmanager
def _house_look() -> Iterator[None]:
    """Sizes, grid and spines of every picture, for as long as it is drawn."""
    with matplotlib.rc_context(_LOOK):
        yield


def save(
    figure: Figure, columns: Mapping[str, np.ndarray], folder: Path, name: str
) -> tuple[Path, Path, Path]:
    """Write a picture twice, and its data beside it.

    **Arguments:**

    - `figure`: the picture.
    - `columns`: its data, under names with units.
    - `folder`: where to.
    - `name`: of the files, without ending.

    **Returns:**

    Paths of NAME.png, NAME.svg and NAME.csv.
    """
    png, svg, table = (folder / f"{name}.{ending}" for ending in ("png", "svg", "csv"))
    with _house_look():
        with whole_file(png) as draft:
            figure.savefig(draft, dpi=150)
        with whole_file(svg) as draft:
            figure.savefig(draft, metadata={"Date": None})
    write_csv(columns, table)
    return png, svg, table


def _panels(
    size: tuple[float, float], title: str, columns: int = 1, ratios: tuple[float, ...] | None = None
) -> tuple[Figure, list[Axes]]:
    """A figure with a row of axes."""
    figure = Figure(figsize=size)
    figure.set_layout_engine("constrained", wspace=0.05)
    axes = figure.subplots(1, columns, squeeze=False, width_ratios=ratios)
    figure.suptitle(title)
    return figure, list(axes[0])


# --- The pair in mesh


@_house_look()
def gear_pair(model: jg.PairModel, title: str = "") -> Figure:
    """Both gears in the transverse plane, touching at the pitch point, seen from +Z.

    **Arguments:**

    - `model`: gives the pair.
    - `title`: by default the numbers of teeth and the contact ratio.

    **Returns:**

    The figure, in millimetres from the pinion's centre.
    """
    pair = model.pair
    if not title:
        ratio = float(jg.profile_contact_ratio(pair))
        title = (
            f"Gear pair {pair.pinion.teeth}/{pair.wheel.teeth} in the transverse plane, "
            rf"$\varepsilon_\alpha$ = {ratio:.3f}"
        )
    figure, (axes,) = _panels((7.4, 7.6), title)
    axes.grid(False)
    pitch_radius = float(pair.working_pitch_radius[0]) / jg.mm
    window = 2.1 * float(pair.transverse_base_pitch) / jg.mm
    for body, colour in enumerate((_BLUE, _ORANGE)):
        _draw_gear(axes, pair, body, colour)
    _draw_path(axes, pair)
    axes.set(
        xlim=(pitch_radius - window, pitch_radius + window),
        ylim=(-window, window),
        xlabel="S, from pinion to wheel [mm]",
        ylabel="T [mm]",
    )
    axes.set_aspect("equal")
    kinds = [Line2D([], [], color=_GREY, lw=0.9, ls=style) for style in _CIRCLES.values()]
    action = Line2D([], [], color=_GREEN, lw=1.0, ls=(0, (6, 2)))
    active = Line2D([], [], color=_GREEN, lw=3.0)
    figure.legend(
        [*kinds, action, active],
        [f"{name} circle" for name in _CIRCLES] + ["line of action", "path of contact"],
        loc="outside lower center",
        ncols=3,
        frameon=False,
    )
    return figure


def gear_pair_columns(model: jg.PairModel) -> Columns:
    """The tooth outlines of `gear_pair` [mm]."""
    columns = {}
    for body, name in enumerate(BODIES):
        outline = _outline(model.pair, body) / jg.mm
        columns |= {f"{name}_S_mm": outline[0], f"{name}_T_mm": outline[1]}
    return columns


_CIRCLES = {"tip": "-", "working pitch": "-.", "base": "--", "root": ":"}
_TEETH_SHOWN = 7


def _draw_gear(axes: Axes, pair: jg.GearPair, body: int, colour: str) -> None:
    """Teeth and circles of one gear."""
    centre = _centre(pair, body) / jg.mm
    outline = _outline(pair, body) / jg.mm
    axes.fill(*np.concatenate([outline, centre[:, None]], axis=1), color=colour, alpha=0.22, lw=0)
    axes.plot(*outline, color=colour, lw=1.5, gid=BODIES[body])
    radii = (pair.tip_radius, pair.working_pitch_radius, pair.base_radius, pair.root_radius)
    towards = np.pi * body + np.linspace(-1.3, 1.3, 601)
    for radius, style in zip(radii, _CIRCLES.values(), strict=True):
        arc = float(radius[body]) / jg.mm * np.stack([np.cos(towards), np.sin(towards)])
        axes.plot(*(centre[:, None] + arc), color=colour, lw=0.9, ls=style)
    inwards = (-1.0, 1.0)[body]
    axes.annotate(
        f"{BODIES[body]}, {(pair.pinion, pair.wheel)[body].teeth} teeth",
        (0.5 + 0.48 * inwards, 0.02),
        xycoords="axes fraction",
        ha=("left", "right")[body],
        color=colour,
        weight="bold",
        bbox=_BOX,
    )


_BOX = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.85}


def _draw_path(axes: Axes, pair: jg.GearPair) -> None:
    """Line of action, path of contact, and A to E."""
    angle = float(pair.working_pressure_angle)
    along = np.asarray([np.sin(angle), np.cos(angle)])
    aside = np.asarray([along[1], -along[0]])
    foot = float(pair.base_radius[0]) / jg.mm * aside
    start, end = float(pair.path_start) / jg.mm, float(pair.path_end) / jg.mm
    whole = foot + np.outer([0.0, float(pair.tangent_length) / jg.mm], along)
    axes.plot(*whole.T, color=_GREEN, lw=1.0, ls=(0, (6, 2)))
    active = foot + np.outer([start, end], along)
    axes.plot(*active.T, color=_GREEN, lw=3.0, solid_capstyle="butt", gid="path of contact")
    pitch = float(pair.transverse_base_pitch) / jg.mm
    points = {"A": start, "C": float(pair.pitch_point) / jg.mm, "E": end}
    if 1.0 < (end - start) / pitch < 2.0:
        points |= {"B": end - pitch, "D": start + pitch}
    for name, roll in points.items():
        place = foot + roll * along
        axes.plot(*place, "o", ms=5, color="white", mec=_GREEN, mew=1.5, zorder=4)
        axes.annotate(
            name,
            (place[0], place[1]),
            xytext=(14 * aside[0], 14 * aside[1]),
            textcoords="offset points",
            ha="center",
            va="center",
            weight="bold",
            bbox=_BOX,
            zorder=5,
        )


def _centre(pair: jg.GearPair, body: int) -> np.ndarray:
    """Place of a gear's axis in S and T [m]."""
    return np.asarray([float(pair.working_centre_distance) * body, 0.0])


def _outline(pair: jg.GearPair, body: int) -> np.ndarray:
    """Outline of several teeth around the mesh, S and T [m]."""
    radius, half = _tooth(pair, body)
    step = 2.0 * np.pi / float(pair.teeth[body])
    # The loaded flank, which leads anticlockwise on either gear, passes through the pitch point.
    roll = np.asarray([pair.pitch_point, pair.tangent_length - pair.pitch_point])[body]
    turned = roll / float(pair.base_radius[body]) - float(pair.half_thickness_at_base[body])
    centreline = np.pi * body - float(pair.working_pressure_angle) + turned
    shown = min(_TEETH_SHOWN, int(pair.teeth[body]))
    teeth = centreline + step * (np.arange(shown) - shown // 2)
    around = np.concatenate([-half, half[::-1]])
    angle = (teeth[:, None] + around).ravel()
    distance = np.tile(np.concatenate([radius, radius[::-1]]), len(teeth))
    return _centre(pair, body)[:, None] + distance * np.stack([np.cos(angle), np.sin(angle)])


def _tooth(pair: jg.GearPair, body: int) -> tuple[np.ndarray, np.ndarray]:
    """Radius [m] and half angle [rad] of a tooth, from mid-space over the flank to mid-tip."""
    x, y = map(np.asarray, _half_tooth(pair, body))
    radius, half = np.hypot(x, y), np.arctan2(x, y)
    space = np.linspace(np.pi / float(pair.teeth[body]), half[0], 7)[:-1]
    land = np.linspace(half[-1], 0.0, 7)[1:]
    radius = np.concatenate([np.full(6, radius[0]), radius, np.full(6, radius[-1])])
    return radius, np.concatenate([space, half, land])


@eqx.filter_jit
def _half_tooth(pair: jg.GearPair, body: int) -> tuple[Array, Array]:
    """Half thickness and height of a tooth from root circle to tip [m]."""
    section = _transverse_section(pair, body)
    x, y = section.fillet(jnp.linspace(0.5 * jnp.pi, section.pressure_angle, 25))
    tip = pair.tip_roll[body] / section.base_radius
    u, v = section.flank(jnp.linspace(section.form_roll_angle, tip, 101))
    return jnp.concatenate([x, u[1:]]), jnp.concatenate([y, v[1:]])


def _transverse_section(pair: jg.GearPair, body: int) -> jg.ToothSection:
    """The tooth that the rack's transverse section cuts.

    Exact for spur gears. The tip radius of a helical gear's rack is an ellipse there; a circle of
    the same depth stands for it, which touches the fillet only.
    """
    gear = (pair.pinion, pair.wheel)[body]
    to_transverse = jnp.cos(pair.helix_angle)
    return jg.ToothSection(
        teeth=pair.teeth[body],
        module=pair.transverse_module,
        pressure_angle=pair.transverse_pressure_angle,
        profile_shift=gear.profile_shift * to_transverse,
        dedendum=gear.dedendum * to_transverse,
        fillet_radius=gear.fillet_radius * to_transverse,
    )


# --- One mesh cycle


@_house_look()
def transmission_error(dataset: xr.Dataset, title: str) -> Figure:
    """Transmission error over two mesh periods, and its mesh harmonics.

    **Arguments:**

    - `dataset`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (time, order) = _panels((9.6, 4.0), title, 2, (1.7, 1.0))
    data = transmission_error_columns(dataset)
    mean, rms, span = cycle_statistics(dataset["transmission_error_um"])
    time.plot(data["phase"], data["transmission_error_um"], color=_BLUE)
    time.axhline(mean, color=_GREY, lw=0.8, ls="--")
    size = f"RMS {_digits(rms, 3)} µm, peak to peak {_digits(span, 3)} µm"
    time.set_title(f"mean {_digits(mean, 4)} µm (dashed), {size}", loc="left")
    # A nearly constant error must not look like a large one.
    room = max(0.6 * span, 5e-3 * abs(mean))
    middle = 0.5 * (np.max(data["transmission_error_um"]) + np.min(data["transmission_error_um"]))
    time.set_ylim(middle - room, middle + room)
    _phase_axis(time, "transmission error [µm]")
    order.vlines(data["harmonic"], 0.0, data["te_harmonic_um"], color=_BLUE)
    order.plot(data["harmonic"], data["te_harmonic_um"], "o", color=_BLUE)
    order.set(xlabel="mesh harmonic [-]", ylabel="amplitude [µm]", xticks=data["harmonic"])
    # Nor must its rounding.
    order.set_ylim(0.0, max(1.08 * np.max(data["te_harmonic_um"]), 1e-3 * abs(mean)))
    order.set_title("harmonics (zero to peak)", loc="left")
    return figure


def transmission_error_columns(dataset: xr.Dataset) -> Columns:
    """The data of `transmission_error`."""
    phase, error = _two_periods(dataset, "transmission_error_um")
    return {
        "phase": phase,
        "transmission_error_um": error,
        "harmonic": dataset["harmonic"].values,
        "te_harmonic_um": dataset["te_harmonic_um"].values,
    }


@_house_look()
def stiffness_and_sharing(dataset: xr.Dataset, title: str) -> Figure:
    """Mesh stiffness over two mesh periods, and one pair's share of the load.

    **Arguments:**

    - `dataset`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (stiffness, share) = _panels((9.6, 4.0), title, 2)
    data = stiffness_and_sharing_columns(dataset)
    mean, _, span = cycle_statistics(dataset["mesh_stiffness_N_um"])
    stiffness.plot(data["phase"], data["mesh_stiffness_N_um"], color=_BLUE)
    stiffness.axhline(mean, color=_GREY, lw=0.8, ls="--")
    size = f"peak to peak {_digits(span, 3)} N/µm"
    stiffness.set_title(f"mean {_digits(mean, 4)} N/µm (dashed), {size}", loc="left")
    stiffness.set_ylim(0.0, 1.1 * np.max(data["mesh_stiffness_N_um"]))
    _phase_axis(stiffness, "mesh stiffness [N/µm]")
    share.plot(data["roll_mm"], data["load_sharing"], color=_BLUE)
    share.set_title("one tooth pair from entry to exit", loc="left")
    share.set(
        xlabel="roll length at mid-face [mm]", ylabel="share of the mesh force [-]", ylim=(0, 1.09)
    )
    _mark_points(share, dataset["path_point_roll_mm"])
    return figure


def stiffness_and_sharing_columns(dataset: xr.Dataset) -> Columns:
    """The data of `stiffness_and_sharing`."""
    phase, stiffness = _two_periods(dataset, "mesh_stiffness_N_um")
    roll = dataset["roll_mm"].mean("slice").values.ravel()
    order = np.argsort(roll)
    touching = (dataset["fraction"] > 1e-6).any("slice").values.ravel()[order]
    first, last = np.nonzero(touching)[0][[0, -1]]
    # One free place on either side, so that entry and exit are seen.
    order = order[max(first - 1, 0) : last + 2]
    return {
        "phase": phase,
        "mesh_stiffness_N_um": stiffness,
        "roll_mm": roll[order],
        "load_sharing": dataset["load_sharing"].values.ravel()[order],
    }


@_house_look()
def flank_maps(dataset: xr.Dataset, title: str) -> Figure:
    """Line load and pressure over the pinion's flank.

    **Arguments:**

    - `dataset`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, panels = _panels((9.6, 4.2), title, 2)
    for axes, (variable, (quantity, unit)) in zip(panels, _FLANK_MAPS.items(), strict=True):
        grid = flank_grid(dataset, variable, "pinion")
        place = grid["profile_position"].values
        half = 0.5 * (place[1] - place[0])
        face = np.linspace(-0.5, 0.5, grid.sizes["slice"] + 1) * dataset.attrs["face_width_mm"]
        surface = axes.pcolormesh(
            np.append(place - half, place[-1] + half),
            face,
            grid.values.T,
            cmap=_SURFACE,
            vmin=0.0,
            rasterized=True,
        )
        axes.grid(False)
        axes.set(
            xlabel="place on the pinion's flank, root 0, tip 1 [-]",
            ylabel="position from mid-face [mm]",
            xlim=(0, 1),
        )
        axes.set_title(f"largest {_digits(float(dataset[variable].max()), 4)} {unit}", loc="left")
        _mark_points(axes, dataset["path_point_position"], on_surface=True)
        figure.colorbar(surface, ax=axes, label=f"{quantity} [{unit}]")
    return figure


_FLANK_MAPS = {
    "line_load_N_mm": ("line load", "N/mm"),
    "pressure_MPa": ("Hertzian pressure", "MPa"),
}


def flank_maps_columns(dataset: xr.Dataset) -> Columns:
    """The data of `flank_maps`, one row per place on the flank."""
    grids = {name: flank_grid(dataset, name, "pinion") for name in _FLANK_MAPS}
    first = grids["pressure_MPa"]
    place, face = np.meshgrid(
        first["profile_position"].values, first["face_position_mm"].values, indexing="ij"
    )
    columns = {"profile_position": place.ravel(), "face_position_mm": face.ravel()}
    return columns | {name: grid.values.ravel() for name, grid in grids.items()}


def _digits(value: float, count: int) -> str:
    """The value to so many significant digits, zeros included."""
    return f"{value:#.{count}g}".rstrip(".")


def _two_periods(dataset: xr.Dataset, variable: str) -> tuple[np.ndarray, np.ndarray]:
    """Phase and values of a variable, twice in a row."""
    phase, values = dataset["phase"].values, dataset[variable].values
    return np.concatenate([phase, phase + 1.0]), np.tile(values, 2)


def _phase_axis(axes: Axes, label: str) -> None:
    axes.set(xlabel="mesh phase [mesh periods]", ylabel=label, xlim=(0, 2))


def _mark_points(axes: Axes, places: xr.DataArray, *, on_surface: bool = False) -> None:
    """Thin upright lines at A to E, with their letters on top of the axes."""
    halo = [withStroke(linewidth=2.2, foreground="white", alpha=0.6)] if on_surface else []
    for name, place in zip(places["path_point"].values, places.values, strict=True):
        if not np.isfinite(place):
            continue
        is_pitch = name == "C"
        axes.axvline(
            place,
            color="black" if on_surface else _GREY,
            path_effects=halo,
            lw=1.2 if is_pitch else 0.8,
            ls="-" if is_pitch else ":",
        )
        axes.annotate(
            str(name),
            (place, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, -3),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=9,
            bbox=_BOX,
        )


# --- Many torques, many widths


@_house_look()
def harris_map(
    torques_Nm: np.ndarray,
    phases: np.ndarray,
    te_um: np.ndarray,
    title: str,
    *,
    weight: np.ndarray | None = None,
) -> Figure:
    """Transmission error over phase for several torques, and its size over torque.

    **Arguments:**

    - `torques_Nm`: on the pinion [N m].
    - `phases`: positions in the mesh period [-].
    - `te_um`: transmission error, rows torques, columns phases [um].
    - `title`: the case or the finding.
    - `weight`: share of the period that each phase stands for [-]; by default from the distances
        between the phases.

    **Returns:**

    The figure.
    """
    figure, (curves, size) = _panels((9.6, 4.2), title, 2, (1.5, 1.0))
    colours = matplotlib.colormaps[_SURFACE].resampled(256)
    norm = Normalize(float(np.min(torques_Nm)), 1.08 * float(np.max(torques_Nm)))
    twice = np.concatenate([phases, phases + 1.0])
    for torque, error in zip(torques_Nm, te_um, strict=True):
        curves.plot(twice, np.tile(error, 2), color=colours(norm(torque)), lw=1.3)
    _phase_axis(curves, "transmission error [µm]")
    figure.colorbar(
        ScalarMappable(norm, colours), ax=curves, label="torque on the pinion [N m]"
    ).ax.set_ylim(float(np.min(torques_Nm)), float(np.max(torques_Nm)))
    data = harris_map_columns(torques_Nm, phases, te_um, weight=weight)
    style = {"marker": "o", "ms": 3.5}
    size.plot(torques_Nm, data["te_peak_to_peak_um"], color=_ORANGE, label="peak to peak", **style)
    size.plot(torques_Nm, data["te_rms_um"], color=_BLUE, label="RMS", **style)
    size.set(xlabel="torque on the pinion [N m]", ylabel="TE fluctuation [µm]")
    size.set_ylim(0.0, 1.25 * float(np.max(data["te_peak_to_peak_um"])))
    size.legend(loc="upper left", ncols=2)
    return figure


def harris_map_columns(
    torques_Nm: np.ndarray,
    phases: np.ndarray,
    te_um: np.ndarray,
    *,
    weight: np.ndarray | None = None,
) -> Columns:
    """The data of `harris_map`, one row per torque; one column per phase follows the statistics."""
    weight = _shares(phases) if weight is None else weight
    mean = te_um @ weight
    columns = {
        "torque_pinion_Nm": np.asarray(torques_Nm),
        "te_mean_um": mean,
        "te_rms_um": np.sqrt((te_um - mean[:, None]) ** 2 @ weight),
        "te_peak_to_peak_um": np.ptp(te_um, axis=1),
    }
    at_phase = zip(phases, te_um.T, strict=True)
    return columns | {f"te_um_at_phase_{phase:.6f}": error for phase, error in at_phase}


def _shares(phases: np.ndarray) -> np.ndarray:
    """Half the distances to both neighbours, around the period."""
    around = np.concatenate([[phases[-1] - 1.0], phases, [phases[0] + 1.0]])
    return 0.5 * (around[2:] - around[:-2])


@_house_look()
def smoothing_bias(
    width_um: np.ndarray,
    mean_bias_um: np.ndarray,
    rms_bias_relative: np.ndarray,
    rms_exact_um: float,
    title: str,
    *,
    gradient_bias_relative: np.ndarray | None = None,
) -> Figure:
    """What smooth contact changes, as a function of its width.

    Where no cell is within the width of separation the bias is zero, apart from rounding: hollow
    triangles at the foot of the axes.

    **Arguments:**

    - `width_um`: of the smooth contact [um].
    - `mean_bias_um`: of the mean TE [um].
    - `rms_bias_relative`: of the RMS of the TE, over the exact one [-].
    - `rms_exact_um`: RMS of the TE with exact contact [um].
    - `title`: the case or the finding.
    - `gradient_bias_relative`: of the gradient, over the exact one [-].

    **Returns:**

    The figure.
    """
    figure, (mean, relative) = _panels((9.6, 4.0), title, 2)
    _draw_bias(mean, width_um, mean_bias_um, _BLUE, "mean TE")
    _draw_bias(relative, width_um, rms_bias_relative, _BLUE, "RMS of the TE")
    if gradient_bias_relative is not None:
        _draw_bias(relative, width_um, gradient_bias_relative, _ORANGE, "gradient", row=1)
    mean.set_ylabel("|bias of the mean TE| [µm]")
    mean.set_title("absolute", loc="left")
    relative.set_ylabel("|bias| / exact value [-]")
    relative.set_title(f"relative; the exact RMS is {_digits(rms_exact_um, 3)} µm", loc="left")
    for axes in (mean, relative):
        axes.set(xscale="log", yscale="log", xlabel="width of the smooth contact [µm]")
        axes.legend(loc="best")
    return figure


def _draw_bias(
    axes: Axes, width: np.ndarray, bias: np.ndarray, colour: str, label: str, *, row: int = 0
) -> None:
    size = np.abs(bias)
    shown = size > _ROUNDING * np.max(size)
    axes.plot(width[shown], size[shown], marker="os"[row], ms=4, color=colour, label=label)
    if not np.all(shown):
        axes.plot(
            width[~shown],
            np.full(np.count_nonzero(~shown), 0.03 + 0.05 * row),
            "v",
            ms=5,
            color=colour,
            mfc="none",
            label=f"{label}: zero",
            transform=axes.get_xaxis_transform(),
        )


# Biases this far below the largest are differences of equal numbers.
_ROUNDING = 1e-11


def smoothing_bias_columns(
    width_um: np.ndarray,
    mean_bias_um: np.ndarray,
    rms_bias_relative: np.ndarray,
    *,
    gradient_bias_relative: np.ndarray | None = None,
) -> Columns:
    """The data of `smoothing_bias`."""
    columns = {
        "width_um": width_um,
        "te_mean_bias_um": mean_bias_um,
        "te_rms_bias_relative": rms_bias_relative,
    }
    if gradient_bias_relative is not None:
        columns["gradient_bias_relative"] = gradient_bias_relative
    return columns


# --- Optimisation


@_house_look()
def master_curve(
    chart: Any, valley: Any, closed_form_um: np.ndarray, path: np.ndarray, title: str
) -> Figure:
    """RMS of the TE over depth and extent of tip relief, with the curves of least TE.

    **Arguments:**

    - `chart`: an `optimise.ReliefMap` of the RMS in um.
    - `valley`: its `optimise.Valley`.
    - `closed_form_um`: depth of the closed form at each extent of the chart, or NaN [um].
    - `path`: points of a search, rows of depth [um] and extent [-]; may have no rows.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((7.6, 5.8), title)
    depth = chart.depth / jg.um
    levels = _levels(chart.value)
    surface = axes.contourf(
        chart.extent,
        depth,
        chart.value,
        levels=levels,
        cmap=_SURFACE,
        extend="min",
        norm=BoundaryNorm(levels, 256, extend="min"),
    )
    surface.set_edgecolor("face")
    axes.grid(False)
    figure.colorbar(
        surface, ax=axes, label="RMS of the transmission error [µm]", ticks=levels, format="%.3g"
    )
    outlined = {"lw": 2.0, "path_effects": [withStroke(linewidth=3.4, foreground="black")]}
    inside = np.where(closed_form_um <= np.max(depth), closed_form_um, np.nan)
    for curve, colour, style, label in (
        (_unbroken_valley(valley, chart) / jg.um, "white", "-", "valley, computed"),
        (inside, _ORANGE, "--", "closed form"),
    ):
        if np.isfinite(curve).any():
            axes.plot(chart.extent, curve, color=colour, ls=style, label=label, **outlined)
    if len(path):
        axes.plot(path[:, 1], path[:, 0], ".-", color=_PINK, lw=1.1, ms=5, label="search")
        for row, marker, size, label in ((0, "o", 7, "its start"), (-1, "*", 14, "its end")):
            place = path[row, ::-1]
            axes.plot(*place, marker, color=_PINK, mec="black", ms=size, label=label, ls="")
    axes.set(
        xlabel="extent of the tip relief over the path of contact [-]",
        ylabel="depth of the tip relief [µm]",
        xlim=(float(np.min(chart.extent)), float(np.max(chart.extent))),
        ylim=(float(np.min(depth)), float(np.max(depth))),
    )
    figure.legend(loc="outside lower center", ncols=5, frameon=False)
    return figure


def _levels(values: np.ndarray) -> np.ndarray:
    """Round, roughly geometric levels up to the largest value, over two decades at the most."""
    most = float(np.nanmax(values))
    least = max(float(np.nanmin(values)), most / 100.0)
    powers = 10.0 ** np.arange(np.floor(np.log10(least)), np.ceil(np.log10(most)) + 1.0)
    series = np.outer(powers, [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]).ravel()
    first = np.searchsorted(series, least, side="right")
    return series[first : np.searchsorted(series, most) + 1]


def _unbroken_valley(valley: Any, chart: Any) -> np.ndarray:
    """Depth of the valley where it means something, else NaN [m].

    That is where the best depth lies within the map and halves the response, and it ends where the
    best depth jumps from one valley to another.
    """
    low, high = np.min(chart.depth), np.max(chart.depth)
    room = 1e-6 * (high - low)
    within = (valley.depth > low + room) & (valley.depth < high - room)
    within &= valley.value < 0.5 * chart.value[0]
    jump = np.abs(np.diff(valley.depth, prepend=valley.depth[0])) > 0.3 * (high - low)
    return np.where(within & ~jump, valley.depth, np.nan)


def master_curve_columns(chart: Any, valley: Any, closed_form_um: np.ndarray) -> Columns:
    """The data of `master_curve`: the map's rows, then the two curves beside them."""
    depth, extent = np.meshgrid(chart.depth / jg.um, chart.extent, indexing="ij")
    return {
        "depth_um": depth.ravel(),
        "extent": extent.ravel(),
        "te_rms_um": chart.value.ravel(),
        "curve_extent": chart.extent,
        "valley_depth_um": valley.depth / jg.um,
        "valley_te_rms_um": valley.value,
        "closed_form_depth_um": closed_form_um,
    }


@_house_look()
def search_trace(values_by_method: Mapping[str, np.ndarray], unit: str, title: str) -> Figure:
    """Best value so far over the number of evaluations, for several searches.

    **Arguments:**

    - `values_by_method`: objective at each evaluation, in order, under the search's name.
    - `unit`: of the objective.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (axes,) = _panels((7.2, 4.4), title)
    colours = (_BLUE, _ORANGE, _GREEN, _RED, _SKY)
    best_values = [np.minimum.accumulate(values) for values in values_by_method.values()]
    for index, (name, best) in enumerate(zip(values_by_method, best_values, strict=True)):
        colour = colours[index % len(colours)]
        count = np.arange(1, len(best) + 1)
        axes.step(
            count,
            best,
            where="post",
            color=colour,
            label=f"{name}: {best[-1]:.4g} {unit} after {len(best)}",
        )
        axes.plot(count[-1], best[-1], "o", ms=5, color=colour)
    every = np.concatenate(best_values)
    if np.min(every) > 0.0 and np.max(every) > 20.0 * np.min(every):
        axes.set_yscale("log")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(left=0.9)
    axes.set(xlabel="evaluations of the objective [-]", ylabel=f"best objective so far [{unit}]")
    axes.legend(loc="upper right")
    return figure


def search_trace_columns(values_by_method: Mapping[str, np.ndarray], unit: str) -> Columns:
    """The data of `search_trace`: the objective at each evaluation, unsorted."""
    most = max(len(values) for values in values_by_method.values())
    columns = {"evaluation": np.arange(1, most + 1)}
    return columns | {f"{name}_{unit}": values for name, values in values_by_method.items()}


@_house_look()
def before_after(dataset_before: xr.Dataset, dataset_after: xr.Dataset, title: str) -> Figure:
    """What an optimisation changed: transmission error and largest flank pressure.

    **Arguments:**

    - `dataset_before`: from `static_dataset`.
    - `dataset_after`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (error, pressure) = _panels((9.6, 4.2), title, 2)
    cases = (("before", dataset_before, _ORANGE, "--"), ("after", dataset_after, _BLUE, "-"))
    for name, dataset, colour, style in cases:
        phase, values = _two_periods(dataset, "transmission_error_um")
        mean, rms, _ = cycle_statistics(dataset["transmission_error_um"])
        error.plot(
            phase,
            values - mean,
            color=colour,
            ls=style,
            label=f"{name}: mean {_digits(mean, 4)} µm, RMS {_digits(rms, 3)} µm",
        )
        most = _largest_pressure(dataset)
        pressure.plot(
            phase,
            np.tile(most, 2),
            color=colour,
            ls=style,
            label=f"{name}: at most {_digits(np.max(most), 4)} MPa",
        )
    _phase_axis(error, "transmission error less its mean [µm]")
    _phase_axis(pressure, "largest flank pressure [MPa]")
    for axes in (error, pressure):
        # Room for the legend above the curves.
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.3 * (high - low))
        axes.legend(loc="upper center")
    return figure


def before_after_columns(dataset_before: xr.Dataset, dataset_after: xr.Dataset) -> Columns:
    """The data of `before_after`."""
    columns = {}
    for name, dataset in (("before", dataset_before), ("after", dataset_after)):
        phase, error = _two_periods(dataset, "transmission_error_um")
        columns |= {
            f"phase_{name}": phase,
            f"transmission_error_{name}_um": error,
            f"pressure_{name}_MPa": np.tile(_largest_pressure(dataset), 2),
        }
    return columns


def _largest_pressure(dataset: xr.Dataset) -> np.ndarray:
    """Largest pressure on any line at each phase [MPa]."""
    return dataset["pressure_MPa"].max(("line", "slice")).values
