"""Pictures of hybrid models: loads across the face, one tooth's way, bodies that give.

Their data are in `_hybrid_tables`.
"""

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

from fem_prep import surface
from jaxgear._units import deg, mm, um
from jaxgear.plot._body_pictures import show
from jaxgear.plot._body_render import VIEW, frame, render
from jaxgear.plot._hybrid_tables import (
    _largest_across,
    _loaded_lines,
    _phases_shown,
    deflected_body_columns,
    tooth_loads_columns,
)
from jaxgear.plot._palette import _BLUE, _GREEN, _GREY, _ORANGE, _RED, _SKY
from jaxgear.plot._pictures import (
    _BOX,
    _SURFACE,
    _digits,
    _house_look,
    _panels,
    _phase_axis,
    _round_down,
)
from jaxgear.plot._tables import _cycle_periods, _unrolled
from jaxgear.study._hybrid import DIRECTIONS, BodyAnswer, BodyField
from jaxgear.study._hybrid_dataset import HolePlaces

_SERIES = (_BLUE, _ORANGE, _GREEN, _RED, _SKY, _GREY)
_STYLES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))
# Of the body's radius: how far its largest displacement is drawn.
_DRAWN = 0.08
_HOLE = "#e3e3e3"


# --- Loads


@_house_look()
def contact_line_loads(dataset: xr.Dataset, title: str) -> Figure:
    """Load on every contact line across the face, at phases of the period of the largest load.

    **Arguments:**

    - `dataset`: from `static_dataset`.
    - `title`: the case or the finding.

    **Returns:**

    The figure; one of its panels is at the phase of the largest line load.
    """
    figure = Figure(figsize=(10.0, 6.0))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True).ravel()
    figure.suptitle(f"Loads on the contact lines: {title}")
    load, chosen = dataset["line_load_N_mm"].values, _phases_shown(dataset)
    lines, most = _loaded_lines(dataset, chosen), float(load[chosen].max())
    face, half = dataset["face_position_mm"].values, 0.5 * dataset.attrs["face_width_mm"]
    worst = int(np.argmax(load.max(axis=(1, 2))))
    for axes, phase in zip(panels, chosen, strict=True):
        for place, line in enumerate(lines):
            if load[phase, line].max() > 0.0:
                colour = _SERIES[place % len(_SERIES)]
                axes.plot(face, load[phase, line], "o-", ms=3, color=colour)
        words = ", the largest load" if phase == worst else ""
        axes.set_title(f"phase {dataset['phase'].values[phase]:.3f}{words}", loc="left")
        axes.set(xlim=(-half, half), ylim=(0.0, 1.08 * most))
    for axes in panels[3:]:
        axes.set_xlabel("position from mid-face [mm]")
    for axes in panels[::3]:
        axes.set_ylabel("line load [N/mm]")
    numbers = dataset["line"].values[lines]
    figure.legend(
        [
            Line2D([], [], color=_SERIES[i % len(_SERIES)], marker="o", ms=3)
            for i in range(len(lines))
        ],
        [_entered(int(number)) for number in numbers],
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


@_house_look()
def tooth_way(dataset: xr.Dataset, title: str) -> Figure:
    """Line load and pressure on the most loaded tooth pair, from its entry to its exit.

    **Arguments:**

    - `dataset`: with the variables of `hybrid_variables`.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, panels = _panels((9.6, 4.2), f"One tooth pair from entry to exit: {title}", 2)
    passage = dataset["way_passage"].values
    middle = 0.5 * (passage[1:] + passage[:-1])
    steps = np.concatenate([[1.5 * passage[0] - 0.5 * passage[1]], middle, passage[-1:]])
    half = 0.5 * dataset.attrs["face_width_mm"]
    face = np.linspace(-half, half, dataset.sizes["slice"] + 1)
    pair = int(dataset["way_tooth_pair"])
    several = _cycle_periods(dataset["phase"].values) > 1
    for axes, (name, words, unit) in zip(
        panels,
        (("way_line_load_N_mm", "line load", "N/mm"), ("way_pressure_MPa", "pressure", "MPa")),
        strict=True,
    ):
        values = dataset[name].values
        area = axes.pcolormesh(steps, face, values.T, cmap=_SURFACE, vmin=0.0, rasterized=True)
        axes.grid(False)
        axes.set(
            xlabel="since entry at mid-face [mesh periods]", ylabel="position from mid-face [mm]"
        )
        words_of_pair = f"tooth pair {pair}, " if several else ""
        axes.set_title(f"{words_of_pair}largest {_digits(values.max(), 4)} {unit}", loc="left")
        figure.colorbar(area, ax=axes, label=f"{words} [{unit}]")
    return figure


@_house_look()
def tooth_loads(dataset: xr.Dataset, gear: str, holes: HolePlaces | None, title: str) -> Figure:
    """What each tooth carries over the revolution, with the places of holes in the web.

    **Arguments:**

    - `dataset`: with the variables of `hybrid_variables`, over several mesh periods.
    - `gear`: `pinion` or `wheel`: whose teeth.
    - `holes`: of its web.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure = Figure(figsize=(9.6, 5.6))
    figure.set_layout_engine("constrained")
    panels = figure.subplots(2, 1, sharex=True)
    figure.suptitle(f"What each tooth carries: {title}")
    data = tooth_loads_columns(dataset, gear, holes)
    angle = data["tooth_angle_deg"]
    step = 360.0 / dataset.attrs[f"teeth_{gear}"]
    low, high = angle.min() - 0.5 * step, angle.max() + 0.5 * step
    for axes, name, colour in zip(
        panels, ("line_load_max_N_mm", "load_over_mean"), (_BLUE, _GREEN), strict=True
    ):
        if holes is not None:
            _shade_holes(axes, holes, low, high)
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
    if holes is not None:
        figure.legend(
            [Patch(color=_HOLE)],
            ["above a hole"],
            loc="outside lower center",
            frameon=False,
        )
    return figure


def _shade_holes(axes: Axes, holes: HolePlaces, low: float, high: float) -> None:
    for middle, half in zip(holes.middles / deg, holes.half / deg, strict=True):
        for turn in (-360.0, 0.0, 360.0):
            left, right = middle - half + turn, middle + half + turn
            if right > low and left < high:
                axes.axvspan(left, right, color=_HOLE, lw=0, zorder=0)


# --- Bodies


@_house_look()
def deflected_body(answer: BodyAnswer, shown: BodyField, title: str) -> Figure:
    """A body deflected by what loads it, and the displacement of its rim around it.

    **Arguments:**

    - `answer`: of the body, with its grid.
    - `shown`: one of its fields.
    - `title`: the case or the finding.

    **Returns:**

    The figure; displacements are against the gear's seat.
    """
    figure = Figure(figsize=(11.6, 5.4))
    figure.set_layout_engine("constrained")
    # Each lays out its own margins.
    parts = figure.subfigures(1, 2, squeeze=False, width_ratios=(0.9, 1.0), wspace=0.02)
    left, right = parts[0]
    view, around = left.subplots(), right.subplots()
    figure.suptitle(f"{title}: {answer.gear} under {shown.words}")
    _draw_deflected(left, view, answer, shown)
    data = deflected_body_columns(answer, shown)
    order = np.argsort(data["angle_deg"], kind="stable")
    middle = np.abs(data["Z_mm"]) < 1e-6 + np.abs(data["Z_mm"]).min()
    ends = {"mid-face": (middle, "-")}
    for words, z, style in (
        ("left end (-Z)", data["Z_mm"].min(), "--"),
        ("right end (+Z)", data["Z_mm"].max(), ":"),
    ):
        ends[words] = (np.abs(data["Z_mm"] - z) < 1e-6, style)
    for name, colour in zip(DIRECTIONS, (_BLUE, _ORANGE, _GREEN), strict=True):
        for chosen, style in ends.values():
            rows = order[chosen[order]]
            # A place before the first and one after the last: curves reach both ends.
            around_it = np.concatenate([rows[-1:], rows, rows[:1]])
            angle = data["angle_deg"][around_it]
            angle[[0, -1]] += -360.0, 360.0
            values = data[f"{name}_um"][around_it]
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
        for colour, (_, style) in zip((_BLUE, _ORANGE, _GREEN), ends.values(), strict=True)
        for colour, style in ((colour, "-"), ("black", style))
    ]
    words = [each for pair in zip(DIRECTIONS, ends, strict=True) for each in pair]
    place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
    around.legend(handles, words, ncols=3, frameon=False, **place)
    return figure


def _draw_deflected(figure: FigureBase, axes: Axes, answer: BodyAnswer, shown: BodyField) -> None:
    """The surface, displaced so that it can be seen, with the mesh on the viewer's side."""
    grid = answer.grid
    size = np.linalg.norm(shown.field, axis=1)
    scale = _round_down(_DRAWN * float(grid.radius.max()) / max(float(size.max()), 1e-15))
    # The mesh is at S from the pinion's axis, at -S from the wheel's.
    towards = (0.0 if answer.gear == "pinion" else np.pi) - shown.turn
    turn = np.arctan2(VIEW[1], VIEW[0]) - towards
    cosine, sine = np.cos(turn), np.sin(turn)
    turned = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    moved = (grid.nodes + scale * shown.field) @ turned
    faces = surface(grid)
    colours = ScalarMappable(Normalize(0.0, float(size.max()) / um), _SURFACE)
    fill = np.asarray(colours.to_rgba((size / um)[faces].ravel()))[:, :3].reshape(-1, 8, 3)
    show(axes, render(moved, faces, fill, edges=True, pixels=620))
    place = np.array([*VIEW[:2], 0.0])
    place *= float(grid.radius.max()) / np.hypot(*VIEW[:2])
    where = place @ frame()[:, :2] / mm
    if shown.what == "mesh":
        axes.annotate(
            "mesh",
            (where[0], where[1]),
            xytext=(0, -44),
            textcoords="offset points",
            ha="center",
            va="top",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-|>", "color": _RED, "lw": 1.8, "shrinkB": 0.0},
            color=_RED,
            bbox=_BOX,
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


@_house_look()
def models_compared(datasets: Mapping[str, xr.Dataset], title: str) -> Figure:
    """Largest line load across the face, and transmission error, of several models of one pair.

    **Arguments:**

    - `datasets`: from `static_dataset`, under the names of the models, such as rigid, rigidified
        and flexible.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (across, error) = _panels((10.4, 4.8), title, 2)
    for number, (name, dataset) in enumerate(datasets.items()):
        look = {"color": _SERIES[number % 6], "ls": _STYLES[number % 6]}
        load = _largest_across(dataset)
        face = dataset["face_position_mm"].values
        across.plot(face, load, label=f"{name}: at most {_digits(load.max(), 4)} N/mm", **look)
        phase, values = _unrolled(dataset["phase"].values, dataset["transmission_error_um"].values)
        weight = dataset["weight"].values
        mean = float(weight @ dataset["transmission_error_um"].values)
        rms = float(np.sqrt(weight @ (dataset["transmission_error_um"].values - mean) ** 2))
        words = f"{name}: mean {_digits(mean, 4)} µm, RMS {_digits(rms, 3)} µm"
        error.plot(phase, values - mean, label=words, **look)
    half = 0.5 * max(float(each.attrs["face_width_mm"]) for each in datasets.values())
    across.set(
        xlabel="position from mid-face [mm]",
        ylabel="largest line load over the cycle [N/mm]",
        xlim=(-half, half),
        ylim=(0.0, None),
    )
    longest = max(datasets.values(), key=lambda each: each.sizes["phase"])
    _phase_axis(error, "transmission error less its mean [µm]", longest["phase"].values)
    for axes in (across, error):
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return figure


# --- All that a run draws
