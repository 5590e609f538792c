"""Pictures of hybrid models: loads across the face, one tooth's way, bodies that give."""

from typing import Any

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
from jaxgear.plot._body_pictures import fill_of, show
from jaxgear.plot._body_render import VIEW, frame, render
from jaxgear.plot._cycle import cycle_periods
from jaxgear.plot._hybrid_tables import contact_line_loads as loads_shown
from jaxgear.plot._hybrid_tables import tooth_loads_columns
from jaxgear.plot._palette import BLUE, GREEN, ORANGE, RED, SURFACE, TEETH_SERIES
from jaxgear.plot._style import (
    BOX,
    digits,
    legend_below,
    over_face,
    over_steps,
    panels,
    round_down,
    surface,
    write_at,
)

# Of the body's radius: how far its largest displacement is drawn.
_DRAWN = 0.08
_DIRECTIONS = {"radial": BLUE, "tangential": ORANGE, "axial": GREEN}
HOLE = "#e3e3e3"


# --- Loads


def contact_line_loads(dataset: xr.Dataset) -> Figure:
    """Load on every contact line across the face, at phases of the period of the largest load.

    One of its panels is at the phase of the largest line load.
    """
    what, space = "Loads on the contact lines", (0.02, 0.02)
    figure, grid = panels(what, dataset, (10.0, 6.0), 3, 2, space=space, sharex=True, sharey=True)
    shown = loads_shown(dataset)
    load, face = shown["line_load_N_mm"].values, dataset["face_position_mm"].values
    half = 0.5 * dataset.attrs["face_width_mm"]
    worst = int(np.argmax(load.max(axis=(1, 2))))
    colours = [TEETH_SERIES[line % len(TEETH_SERIES)] for line in range(load.shape[1])]
    for place, (axes, phase) in enumerate(zip(grid, shown["phase"].values, strict=True)):
        for line, colour in enumerate(colours):
            if load[place, line].max() > 0.0:
                axes.plot(face, load[place, line], "o-", ms=3, color=colour)
        words = ", the largest load" if place == worst else ""
        axes.set_title(f"phase {phase:.3f}{words}", loc="left")
        axes.set(xlim=(-half, half), ylim=(0.0, 1.08 * float(load.max())))
    for axes in grid[3:]:
        axes.set_xlabel("position from mid-face [mm]")
    for axes in grid[::3]:
        axes.set_ylabel("line load [N/mm]")
    lines = [Line2D([], [], color=colour, marker="o", ms=3) for colour in colours]
    names = [_entered(int(number)) for number in shown["line"].values]
    legend_below(figure, lines, names, ncols=4)
    return figure


def _entered(number: int) -> str:
    """When the pair on a line entered, in words."""
    if number < 0:
        return "pair that is about to enter"
    since = {0: "in this mesh period", 1: "one period before"}
    return f"pair that entered {since.get(number, f'{number} periods before')}"


def tooth_way(dataset: xr.Dataset) -> Figure:
    """Line load and pressure on the most loaded tooth pair, from its entry to its exit."""
    figure, both = panels("One tooth pair from entry to exit", dataset, (9.6, 4.2), 2)
    cells = over_steps(dataset["way_passage"].values), over_face(dataset)
    several = cycle_periods(dataset["phase"].values) > 1
    pair = f"tooth pair {int(dataset['way_tooth_pair'])}, " if several else ""
    for axes, (name, words, unit) in zip(
        both,
        (("way_line_load_N_mm", "line load", "N/mm"), ("way_pressure_MPa", "pressure", "MPa")),
        strict=True,
    ):
        values = dataset[name].values
        area = surface(axes, *cells, values, vmin=0.0)
        axes.set(xlabel="since entry at mid-face [mesh periods]")
        axes.set(ylabel="position from mid-face [mm]")
        axes.set_title(f"{pair}largest {digits(values.max(), 4)} {unit}", loc="left")
        figure.colorbar(area, ax=axes, label=f"{words} [{unit}]")
    return figure


def tooth_loads(dataset: xr.Dataset, gear: str) -> Figure:
    """What each tooth carries over the revolution, with the places of holes in the web."""
    what, size = "What each tooth carries", (9.6, 5.6)
    figure, both = panels(what, dataset, size, 1, 2, space=(0.02, 0.02), sharex=True)
    data = tooth_loads_columns(dataset, gear)
    for axes, name, colour in zip(
        both, ("line_load_max_N_mm", "load_over_mean"), (BLUE, GREEN), strict=True
    ):
        tooth_axis(axes, dataset, gear, data["tooth_angle_deg"], f"{gear}_hole_deg")
        axes.plot(data["tooth_angle_deg"], data[name], "o-", ms=4, color=colour)
        span = max(float(np.ptp(data[name])), 2e-3 * float(np.max(data[name])))
        axes.set_ylim(np.min(data[name]) - 0.15 * span, np.max(data[name]) + 0.15 * span)
    both[0].set(xlabel="", ylabel="largest line load [N/mm]")
    both[1].set(ylabel="load over its way,\nof the mean tooth's [-]")
    if f"{gear}_hole_deg" in dataset:
        legend_below(figure, [Patch(color=HOLE)], ["above a hole"])
    return figure


def tooth_axis(axes: Axes, dataset: xr.Dataset, gear: str, angle: np.ndarray, holes: str) -> None:
    """Places of a gear's teeth [degrees] along an axis, and shades where holes are under them.

    **Arguments:**

    - `axes`: to draw on.
    - `dataset`: with the number of teeth, and with holes or without.
    - `gear`: `pinion` or `wheel`.
    - `angle`: of its teeth.
    - `holes`: name of the variable that has the middles of holes.
    """
    step = 360.0 / dataset.attrs[f"teeth_{gear}"]
    low, high = angle.min() - 0.5 * step, angle.max() + 0.5 * step
    if holes in dataset:
        halves = dataset[f"{gear}_hole_half_deg"].values
        for middle, half in zip(dataset[holes].values, halves, strict=True):
            for turn in (-360.0, 0.0, 360.0):
                left, right = middle - half + turn, middle + half + turn
                if right > low and left < high:
                    axes.axvspan(left, right, color=HOLE, lw=0, zorder=0)
    axes.set(xlim=(low, high), xlabel=f"place of the tooth on the {gear}, from tooth 0 [°]")
    # Steps in which a turn can be cut.
    axes.xaxis.set_major_locator(MaxNLocator(steps=[1, 1.5, 3, 6, 10]))


# --- Bodies


def deflected_body(dataset: xr.Dataset, cause: str) -> Figure:
    """A body deflected by `mesh` or `rotation`, and the displacement of its rim around it.

    Displacements are against the gear's seat.
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
    place, z = shown["angle_deg"].values, shown["Z_mm"].values
    order = np.argsort(place, kind="stable")
    middle = np.abs(z) < 1e-6 + np.abs(z).min()
    ends = {
        "mid-face": (middle, "-"),
        "left end (-Z)": (np.abs(z - z.min()) < 1e-6, "--"),
        "right end (+Z)": (np.abs(z - z.max()) < 1e-6, ":"),
    }
    for name, colour in _DIRECTIONS.items():
        for chosen, style in ends.values():
            rows = order[chosen[order]]
            # A place before the first and one after the last: curves reach both ends.
            around_it = np.concatenate([rows[-1:], rows, rows[:1]])
            angle = place[around_it]
            angle[[0, -1]] += -360.0, 360.0
            values = shown[f"{name}_um"].values[around_it]
            around.plot(angle, values, color=colour, ls=style, lw=1.3)
    around.set(
        xlabel="place on the rim, from the mesh about +Z [°]",
        ylabel="displacement of the rim [µm]",
        xlim=(-180.0, 180.0),
        xticks=np.arange(-180, 181, 60),
    )
    # Directions above, places below them; columns are filled first.
    handles, words = [], []
    for (name, colour), (end, (_, style)) in zip(_DIRECTIONS.items(), ends.items(), strict=True):
        handles += [Line2D([], [], color=colour, ls="-"), Line2D([], [], color="black", ls=style)]
        words += [name, end]
    above = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
    around.legend(handles, words, ncols=3, frameon=False, **above)
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
    show(axes, render(moved, faces, fill_of(colours, size, faces), edges=True, pixels=620))
    place = np.array([*VIEW[:2], 0.0])
    place *= radius * mm / np.hypot(*VIEW[:2])
    where = place @ frame()[:, :2] / mm
    if with_mesh:
        arrow = {"arrowstyle": "-|>", "color": RED, "lw": 1.8, "shrinkB": 0.0}
        look = {"va": "top", "annotation_clip": False, "arrowprops": arrow, "color": RED}
        write_at(axes, "mesh", where, (0, -44), bbox=BOX, **look)
    axes.set_title(f"drawn {scale:g} times as large", loc="left")
    # Below, so that slender bodies stay in the middle.
    bar: dict[str, Any] = {"ax": axes, "location": "bottom", "shrink": 0.7, "aspect": 30}
    figure.colorbar(colours, label="displacement against the gear's seat [µm]", **bar)
