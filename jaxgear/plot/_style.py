"""What all pictures share: their look, how they are laid out and written, and common axes.

Figures are made without pyplot, so nothing is kept, shown or configured behind the caller's back.
"""

import contextlib
import gc
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation
from matplotlib.ticker import LogFormatterSciNotation, MaxNLocator, NullLocator
from matplotlib.transforms import Bbox, ScaledTranslation

from jaxgear._whole_file import whole_file
from jaxgear.plot._cycle import cycle_periods
from jaxgear.plot._palette import GREY, SURFACE

# Behind a text that stands on lines.
BOX = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.85}

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
def house_look() -> Generator[None]:
    """Sizes, grid and spines of every picture, for as long as it is drawn."""
    with matplotlib.rc_context(_LOOK):
        yield


@contextlib.contextmanager
def _uncollected() -> Generator[None]:
    """Collect no garbage for a while: each collection walks through all that JAX has traced."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def write_picture(draw: Callable[[], Figure], png: Path, svg: Path) -> None:
    """Draw a picture once and write it twice."""
    with house_look(), _uncollected():
        figure = draw()
        # Laying out takes as long as drawing, and both files can have the same layout.
        figure.set_dpi(_DPI)
        canvas = FigureCanvasAgg(figure)
        for axes in figure.axes:
            _plain_decades(axes)
            _measure_once(axes)
        lay_out(figure)
        figure.set_layout_engine("none")
        with whole_file(png) as draft:
            canvas.print_png(draft, pil_kwargs={"compress_level": _COMPRESSION})
        with whole_file(svg) as draft:
            FigureCanvasSVG(figure).print_svg(draft, metadata={"Date": None})


# A tenth more bytes than the default, for half the time.
_DPI, _COMPRESSION = 150, 1


# Where an axis shows more decades, ticks between them are too close to be told apart, and take as
# long to draw as all the rest.
_DECADES = 3.5


def _plain_decades(axes: Axes) -> None:
    """Decades as 0.1, 1, 10: letters that read as formulas take longest of all to draw."""
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        if axis.get_scale() == "log" and abs(np.log10(high / low)) > _DECADES:
            axis.set_minor_locator(NullLocator())
        if isinstance(axis.get_major_formatter(), LogFormatterSciNotation):
            axis.set_major_formatter("{x:g}")
        if isinstance(axis.get_minor_formatter(), LogFormatterSciNotation):
            axis.set_minor_formatter(_PlainWhereShown())


class _PlainWhereShown(LogFormatterSciNotation):
    """Values between decades as 0.2, 2, 20, where Matplotlib finds room for them."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def lay_out(figure: Figure) -> None:
    """Put the axes where they will be drawn; drawing to find out would cost as much again."""
    if engine := figure.get_layout_engine():
        engine.execute(figure)
    for axes in figure.axes:
        _set_aspect(axes)


def page_of(axes: Axes) -> Figure:
    """The whole figure that axes are on."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    return figure


def laid_out(axes: Axes) -> float:
    """Lay out the figure of axes, and return its points per pixel."""
    lay_out(page_of(axes))
    return 72.0 / page_of(axes).dpi


def _set_aspect(axes: Axes, renderer: Any = None) -> None:
    """Shape axes as drawing would."""
    locator = axes.get_axes_locator()
    axes.apply_aspect(locator(axes, renderer) if locator is not None else None)


def _measure_once(axes: Axes) -> None:
    """Let axes keep what stands round them: a layout measures all text in both its passes."""
    measure = axes.get_tightbbox
    margins: list[np.ndarray] = []

    def kept(renderer: RendererBase, **options: Any) -> Bbox | None:
        _set_aspect(axes, renderer)
        if not margins:
            found = measure(renderer, **options)
            if found is None:
                return None
            margins.append(np.subtract(found.extents, axes.bbox.extents))
            _keep_labels(axes)
        return Bbox.from_extents(*np.add(axes.bbox.extents, margins[0]))

    vars(axes)["get_tightbbox"] = kept


def _keep_labels(axes: Axes) -> None:
    """Leave labels as far from the axes as they are: to place them anew all ticks are measured."""
    figure, box = page_of(axes), axes.bbox.get_points()
    for across, axis in enumerate((axes.yaxis, axes.xaxis)):
        place = np.asarray(axis.label.get_position())
        far = axis.get_label_position() in ("top", "right")
        gap = [0.0, 0.0]
        gap[across] = (place[across] - box[int(far), across]) / figure.dpi
        place[across] = far
        shift = ScaledTranslation(gap[0], gap[1], figure.dpi_scale_trans)
        axis.set_label_coords(*place, transform=axes.transAxes + shift)


def panels(
    what: str,
    dataset: xr.Dataset | None,
    size: tuple[float, float],
    columns: int = 1,
    rows: int = 1,
    *,
    space: tuple[float, float] = (0.05, 0.03),
    **options: Any,
) -> tuple[Figure, list[Axes]]:
    """A figure of axes in rows and columns, headed by what it shows and by its dataset's title.

    **Arguments:**

    - `what`: is shown.
    - `dataset`: with its title; without it `what` is all of the heading.
    - `size`: of the figure [inches].
    - `columns`, `rows`: of axes, which are returned row by row.
    - `space`: between columns and between rows, over the size of the axes.
    - `options`: of `Figure.subplots`.
    """
    figure = Figure(figsize=size)
    figure.set_layout_engine("constrained", wspace=space[0], hspace=space[1])
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    figure.suptitle(what if dataset is None else f"{what}: {dataset.attrs['title']}")
    return figure, list(axes.ravel())


def legend_below(figure: Figure, *entries: Any, ncols: int = 1, **options: Any) -> None:
    """One legend of all axes, under them; none without entries.

    **Arguments:**

    - `figure`: with the axes.
    - `entries`: artists, or artists and their names; without them what the axes have.
    - `ncols`, `options`: of `Figure.legend`.
    """
    if entries and not entries[0]:
        return
    if len(entries) == 1:
        options["handles"], entries = entries[0], ()
    figure.legend(*entries, loc="outside lower center", ncols=ncols, frameon=False, **options)


def write_at(axes: Axes, text: str, at: Any, by: Any, **look: Any) -> Annotation:
    """A text beside a point, so many points of the page away from it, centred there."""
    place: dict[str, Any] = {"xytext": by, "textcoords": "offset points", "ha": "center"}
    return axes.annotate(text, at, **(place | look))


def surface(
    axes: Axes, across: np.ndarray, up: np.ndarray, values: np.ndarray, **look: Any
) -> QuadMesh:
    """Cells of a colour for each value, given by their edges; the first index runs across."""
    axes.grid(False)
    look = {"cmap": SURFACE, "rasterized": True, **look}
    return axes.pcolormesh(across, up, values.T, **look)


def axis_label(variable: xr.DataArray) -> str:
    """What a variable is, and its unit."""
    return f"{variable.attrs['long_name']} [{written_unit(variable)}]"


def written_unit(variable: xr.DataArray) -> str:
    """The unit of a variable as a picture shows it."""
    unit = str(variable.attrs["units"])
    return {"1": "-"}.get(unit, unit.replace("um", "µm").replace("2", "²"))


def draw_line(axes: Axes, dataset: xr.Dataset, across: str, up: str, **look: Any) -> Line2D:
    """A variable over another, both axes with their labels."""
    (line,) = axes.plot(dataset[across].values, dataset[up].values, **look)
    axes.set(xlabel=axis_label(dataset[across]), ylabel=axis_label(dataset[up]))
    return line


def room_above(axes: Axes, share: float) -> None:
    """Room for a legend or for letters above curves, in shares of their height."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + share * (high - low))


def over_steps(values: np.ndarray) -> np.ndarray:
    """Edges of the steps around rising values: half-way between them, the last at its end."""
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[1.5 * values[0] - 0.5 * values[1]], middle, values[-1:]])


def over_face(dataset: xr.Dataset) -> np.ndarray:
    """Edges of the slices, from mid-face [mm]."""
    return np.linspace(-0.5, 0.5, dataset.sizes["slice"] + 1) * dataset.attrs["face_width_mm"]


def digits(value: float, count: int) -> str:
    """The value to so many significant digits, zeros included."""
    return f"{value:#.{count}g}".rstrip(".")


def round_down(value: float) -> float:
    """The last round number: 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(r * power for r in (1.0, 2.0, 5.0) if r * power <= value))


def line_width(phase: np.ndarray) -> float:
    """Width of a line over the cycle: the longer, the thinner."""
    return 1.6 if cycle_periods(phase) < 4 else 0.7


def phase_axis(axes: Axes, label: str, phase: np.ndarray) -> None:
    """Name the axes of a curve over the cycle with these phases, unrolled or not."""
    last = max(2, cycle_periods(phase))
    axes.set(xlabel="mesh phase [mesh periods]", ylabel=label, xlim=(0, last))


def roll_axis(axes: Axes, angle: np.ndarray, diameter: np.ndarray) -> None:
    """Roll angle along a flank, and under each of its ticks the diameter there.

    An axis of its own for diameters would take as long to draw as all the rest.
    """
    low, high = float(angle[0]), float(angle[-1])
    ticks = np.asarray(MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(low, high))
    ticks = ticks[(ticks >= low) & (ticks <= high)]
    labels = [f"{tick:g}\n{np.interp(tick, angle, diameter):.2f}" for tick in ticks]
    axes.set_xticks(ticks, labels)
    axes.set(xlabel="roll angle [°], and under it diameter [mm]", xlim=(low, high))


def mark_points(axes: Axes, places: xr.DataArray, *, on_surface: bool = False) -> None:
    """Thin upright lines at A to E, with their letters on top of the axes."""
    halo = [withStroke(linewidth=2.2, foreground="white", alpha=0.6)] if on_surface else []
    for name, place in zip(places["path_point"].values, places.values, strict=True):
        if not np.isfinite(place):
            continue
        is_pitch = name == "C"
        axes.axvline(
            place,
            color="black" if on_surface else GREY,
            path_effects=halo,
            lw=1.2 if is_pitch else 0.8,
            ls="-" if is_pitch else ":",
        )
        inside = {"xycoords": ("data", "axes fraction"), "va": "top", "fontsize": 9, "bbox": BOX}
        write_at(axes, str(name), (place, 1.0), (0, -3), **inside)
