"""Pictures of hybrid models: loads across the face, one tooth's way, bodies that give."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from jaxgear._units import deg, mm, um
from jaxgear.plot._body_pictures import show
from jaxgear.plot._body_render import VIEW, frame, render
from jaxgear.plot._cycle import cycle_periods, cycle_statistics, unrolled
from jaxgear.plot._hybrid_tables import contact_line_loads as loads_shown
from jaxgear.plot._hybrid_tables import tooth_loads_columns
from jaxgear.plot._palette import BLUE, GREEN, GREY, ORANGE, RED, SKY
from jaxgear.plot._style import (
    BOX,
    SURFACE,
    digits,
    house_look,
    panels,
    phase_axis,
    round_down,
    titled,
)

SERIES = (BLUE, ORANGE, GREEN, RED, SKY, GREY)
_STYLES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))
# Of the body's radius: how far its largest displacement is drawn.
_DRAWN = 0.08
_DIRECTIONS = ("radial_um", "tangential_um", "axial_um")
HOLE = "#e3e3e3"


# --- Loads


@house_look()
def contact_line_loads(dataset: xr.Dataset) -> Figure:
    """Load on every contact line across the face, at phases of the period of the largest load.

    **Arguments:**

    - `dataset`: of the mesh cycle.

    **Returns:**

    The figure; one of its panels is at the phase of the largest line load.
    """
    figure = Figure(figsize=(10.0, 6.0))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True).ravel()
    figure.suptitle(f"Loads on the contact lines: {dataset.attrs['title']}")
    shown = loads_shown(dataset)
    load, face = shown["line_load_N_mm"].values, dataset["face_position_mm"].values
    most, half = float(load.max()), 0.5 * dataset.attrs["face_width_mm"]
    worst = int(np.argmax(load.max(axis=(1, 2))))
    colours = [SERIES[line % len(SERIES)] for line in range(load.shape[1])]
    for axes, place, phase in zip(panels, range(len(load)), shown["phase"].values, strict=True):
        for line, colour in enumerate(colours):
            if load[place, line].max() > 0.0:
                axes.plot(face, load[place, line], "o-", ms=3, color=colour)
        words = ", the largest load" if place == worst else ""
        axes.set_title(f"phase {phase:.3f}{words}", loc="left")
        axes.set(xlim=(-half, half), ylim=(0.0, 1.08 * most))
    for axes in panels[3:]:
        axes.set_xlabel("position from mid-face [mm]")
    for axes in panels[::3]:
        axes.set_ylabel("line load [N/mm]")
    figure.legend(
        [Line2D([], [], color=colour, marker="o", ms=3) for colour in colours],
        [_entered(int(number)) for number in shown["line"].values],
        loc="outside lower center",
        ncols=4,
        frameon=False,
    )
    return figure


def _entered(number: int) -> str:
    """When the pair on a line entered, in words."""
    if number < 0:
        return "pair that is about to enter"
    since = {0: "in this mesh period", 1: "one period before"}
    return f"pair that entered {since.get(number, f'{number} periods before')}"


@house_look()
def tooth_way(dataset: xr.Dataset) -> Figure:
    """Line load and pressure on the most loaded tooth pair, from its entry to its exit.

    **Arguments:**

    - `dataset`: of the mesh cycle.

    **Returns:**

    The figure.
    """
    figure, both = titled(dataset, "One tooth pair from entry to exit", (9.6, 4.2), 2)
    passage = dataset["way_passage"].values
    middle = 0.5 * (passage[1:] + passage[:-1])
    steps = np.concatenate([[1.5 * passage[0] - 0.5 * passage[1]], middle, passage[-1:]])
    half = 0.5 * dataset.attrs["face_width_mm"]
    face = np.linspace(-half, half, dataset.sizes["slice"] + 1)
    pair = int(dataset["way_tooth_pair"])
    several = cycle_periods(dataset["phase"].values) > 1
    for axes, (name, words, unit) in zip(
        both,
        (("way_line_load_N_mm", "line load", "N/mm"), ("way_pressure_MPa", "pressure", "MPa")),
        strict=True,
    ):
        values = dataset[name].values
        area = axes.pcolormesh(steps, face, values.T, cmap=SURFACE, vmin=0.0, rasterized=True)
        axes.grid(False)
        axes.set(
            xlabel="since entry at mid-face [mesh periods]", ylabel="position from mid-face [mm]"
        )
        words_of_pair = f"tooth pair {pair}, " if several else ""
        axes.set_title(f"{words_of_pair}largest {digits(values.max(), 4)} {unit}", loc="left")
        figure.colorbar(area, ax=axes, label=f"{words} [{unit}]")
    return figure


@house_look()
def tooth_loads(dataset: xr.Dataset, gear: str) -> Figure:
    """What each tooth carries over the revolution, with the places of holes in the web.

    **Arguments:**

    - `dataset`: of a cycle of several mesh periods.
    - `gear`: `pinion` or `wheel`: whose teeth.

    **Returns:**

    The figure.
    """
    figure = Figure(figsize=(9.6, 5.6))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(2, 1, sharex=True)
    figure.suptitle(f"What each tooth carries: {dataset.attrs['title']}")
    data = tooth_loads_columns(dataset, gear)
    angle = data["tooth_angle_deg"]
    step = 360.0 / dataset.attrs[f"teeth_{gear}"]
    low, high = angle.min() - 0.5 * step, angle.max() + 0.5 * step
    for axes, name, colour in zip(
        panels, ("line_load_max_N_mm", "load_over_mean"), (BLUE, GREEN), strict=True
    ):
        if f"{gear}_hole_deg" in dataset:
            middles, half = (dataset[f"{gear}_{x}_deg"].values for x in ("hole", "hole_half"))
            shade_holes(axes, middles, half, low, high)
        axes.plot(angle, data[name], "o-", ms=4, color=colour)
        axes.set_xlim(low, high)
        span = max(float(np.ptp(data[name])), 2e-3 * float(np.max(data[name])))
        axes.set_ylim(np.min(data[name]) - 0.15 * span, np.max(data[name]) + 0.15 * span)
    panels[0].set(ylabel="largest line load [N/mm]")
    # Steps in which a turn can be cut.
    panels[1].xaxis.set_major_locator(MaxNLocator(steps=[1, 1.5, 3, 6, 10]))
    panels[1].set(
        xlabel=f"place of the tooth on the {gear}, from tooth 0 [°]",
        ylabel="load over its way,\nof the mean tooth's [-]",
    )
    if f"{gear}_hole_deg" in dataset:
        figure.legend(
            [Patch(color=HOLE)],
            ["above a hole"],
            loc="outside lower center",
            frameon=False,
        )
    return figure


def shade_holes(
    axes: Axes, middles: np.ndarray, halves: np.ndarray, low: float, high: float
) -> None:
    """Shade what is above holes: their middles and half their angles, and the ends of the axis.

    All angles are in degrees.
    """
    for middle, half in zip(middles, halves, strict=True):
        for turn in (-360.0, 0.0, 360.0):
            left, right = middle - half + turn, middle + half + turn
            if right > low and left < high:
                axes.axvspan(left, right, color=HOLE, lw=0, zorder=0)


# --- Bodies


@house_look()
def deflected_body(dataset: xr.Dataset, cause: str) -> Figure:
    """A body deflected by what loads it, and the displacement of its rim around it.

    **Arguments:**

    - `dataset`: the group `pinion_deflected` or `wheel_deflected`.
    - `cause`: `mesh` or `rotation`.

    **Returns:**

    The figure; displacements are against the gear's seat.
    """
    figure = Figure(figsize=(11.6, 5.4))
    figure.set_layout_engine("constrained")
    # Each lays out its own margins.
    parts = figure.subfigures(1, 2, squeeze=False, width_ratios=(0.9, 1.0), wspace=0.02)
    left, right = parts[0]
    view, around = left.subplots(), right.subplots()
    shown = dataset.sel(cause=cause)
    gear, under = dataset.attrs["gear"], str(shown["under"].values)
    figure.suptitle(f"{dataset.attrs['title']}: {gear} under {under}")
    _draw_deflected(left, view, shown, with_mesh=cause == "mesh")
    data = {name: shown[name].values for name in ("angle_deg", "Z_mm", *_DIRECTIONS)}
    order = np.argsort(data["angle_deg"], kind="stable")
    middle = np.abs(data["Z_mm"]) < 1e-6 + np.abs(data["Z_mm"]).min()
    ends = {"mid-face": (middle, "-")}
    for words, z, style in (
        ("left end (-Z)", data["Z_mm"].min(), "--"),
        ("right end (+Z)", data["Z_mm"].max(), ":"),
    ):
        ends[words] = (np.abs(data["Z_mm"] - z) < 1e-6, style)
    for name, colour in zip(_DIRECTIONS, (BLUE, ORANGE, GREEN), strict=True):
        for chosen, style in ends.values():
            rows = order[chosen[order]]
            # A place before the first and one after the last: curves reach both ends.
            around_it = np.concatenate([rows[-1:], rows, rows[:1]])
            angle = data["angle_deg"][around_it]
            angle[[0, -1]] += -360.0, 360.0
            values = data[name][around_it]
            around.plot(angle, values, color=colour, ls=style, lw=1.3)
    around.set(
        xlabel="place on the rim, from the mesh about +Z [°]",
        ylabel="displacement of the rim [µm]",
        xlim=(-180.0, 180.0),
        xticks=np.arange(-180, 181, 60),
    )
    # Directions above, places below them; columns are filled first.
    handles = [
        Line2D([], [], color=colour, ls=style)
        for colour, (_, style) in zip((BLUE, ORANGE, GREEN), ends.values(), strict=True)
        for colour, style in ((colour, "-"), ("black", style))
    ]
    names = (name.removesuffix("_um") for name in _DIRECTIONS)
    words = [each for pair in zip(names, ends, strict=True) for each in pair]
    place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
    around.legend(handles, words, ncols=3, frameon=False, **place)
    return figure


def _draw_deflected(figure: FigureBase, axes: Axes, shown: xr.Dataset, *, with_mesh: bool) -> None:
    """The surface, displaced so that it can be seen, with the mesh on the viewer's side."""
    nodes, faces = shown["place_mm"].values, shown["face"].values
    field, most = shown["displacement_um"].values, float(shown["largest_um"])
    size, radius = np.linalg.norm(field, axis=1), float(np.hypot(*nodes.T[:2]).max())
    scale = round_down(_DRAWN * radius * mm / max(most * um, 1e-15))
    # The mesh is at S from the pinion's axis, at -S from the wheel's.
    turn = np.arctan2(VIEW[1], VIEW[0]) - float(shown["mesh_angle_deg"]) * deg
    cosine, sine = np.cos(turn), np.sin(turn)
    turned = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    moved = (nodes * mm + scale * field * um) @ turned
    colours = ScalarMappable(Normalize(0.0, most), SURFACE)
    fill = np.asarray(colours.to_rgba(size[faces].ravel()))[:, :3].reshape(-1, 8, 3)
    show(axes, render(moved, faces, fill, edges=True, pixels=620))
    place = np.array([*VIEW[:2], 0.0])
    place *= radius * mm / np.hypot(*VIEW[:2])
    where = place @ frame()[:, :2] / mm
    if with_mesh:
        axes.annotate(
            "mesh",
            (where[0], where[1]),
            xytext=(0, -44),
            textcoords="offset points",
            ha="center",
            va="top",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-|>", "color": RED, "lw": 1.8, "shrinkB": 0.0},
            color=RED,
            bbox=BOX,
        )
    axes.set_title(f"drawn {scale:g} times as large", loc="left")
    # Below, so that slender bodies stay in the middle.
    figure.colorbar(
        colours,
        ax=axes,
        location="bottom",
        label="displacement against the gear's seat [µm]",
        shrink=0.7,
        aspect=30,
    )


# --- Several models of one pair


@house_look()
def models_compared(datasets: Mapping[str, xr.Dataset], title: str) -> Figure:
    """Largest line load across the face, and transmission error, of several models of one pair.

    **Arguments:**

    - `datasets`: from `static_dataset`, under the names of the models, such as rigid, rigidified
        and flexible.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (across, error) = panels((10.4, 4.8), title, 2)
    for number, (name, dataset) in enumerate(datasets.items()):
        look = {"color": SERIES[number % 6], "ls": _STYLES[number % 6]}
        load = dataset["line_load_N_mm"].values.max(axis=(0, 1))
        face = dataset["face_position_mm"].values
        across.plot(face, load, label=f"{name}: at most {digits(load.max(), 4)} N/mm", **look)
        phase, values = unrolled(dataset["phase"].values, dataset["transmission_error_um"].values)
        mean, rms, _ = cycle_statistics(dataset["transmission_error_um"])
        words = f"{name}: mean {digits(mean, 4)} µm, RMS {digits(rms, 3)} µm"
        error.plot(phase, values - mean, label=words, **look)
    half = 0.5 * max(float(each.attrs["face_width_mm"]) for each in datasets.values())
    across.set(
        xlabel="position from mid-face [mm]",
        ylabel="largest line load over the cycle [N/mm]",
        xlim=(-half, half),
        ylim=(0.0, None),
    )
    longest = max(datasets.values(), key=lambda each: each.sizes["phase"])
    phase_axis(error, "transmission error less its mean [µm]", longest["phase"].values)
    for axes in (across, error):
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return figure
