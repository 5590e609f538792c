"""What all pictures share: their look, how they are laid out and written, and common axes.

Figures are made without pyplot, so nothing is kept, shown or configured behind the caller's back.
"""

import contextlib
import gc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogFormatterSciNotation, MaxNLocator
from matplotlib.transforms import Bbox, ScaledTranslation

from jaxgear._whole_file import whole_file
from jaxgear.plot._cycle import cycle_periods
from jaxgear.plot._palette import GREY

# Colour map of what lies over an area.
SURFACE = "viridis"
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
def house_look() -> Iterator[None]:
    """Sizes, grid and spines of every picture, for as long as it is drawn."""
    with matplotlib.rc_context(_LOOK):
        yield


@contextlib.contextmanager
def _uncollected() -> Iterator[None]:
    """Collect no garbage for a while: each collection walks through all that JAX has traced."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def write_picture(draw: Callable[[], Figure], png: Path, svg: Path) -> None:
    """Draw a picture and write it twice.

    **Arguments:**

    - `draw`: returns the figure.
    - `png`: path of the one file.
    - `svg`: path of the other.
    """
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


def _plain_decades(axes: Axes) -> None:
    """Decades as 0.1, 1, 10: letters that read as formulas take longest of all to draw."""
    for axis in (axes.xaxis, axes.yaxis):
        if isinstance(axis.get_major_formatter(), LogFormatterSciNotation):
            axis.set_major_formatter("{x:g}")


def lay_out(figure: Figure) -> None:
    """Put the axes where they will be drawn; drawing to find out would cost as much again.

    **Arguments:**

    - `figure`: with all that needs room.
    """
    if engine := figure.get_layout_engine():
        engine.execute(figure)
    for axes in figure.axes:
        _set_aspect(axes)


def _set_aspect(axes: Axes, renderer: Any = None) -> None:
    """Shape axes as drawing would."""
    locator = axes.get_axes_locator()
    axes.apply_aspect(locator(axes, renderer) if locator else None)


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
    figure = axes.get_figure(root=True)
    assert figure is not None
    (left, bottom), (right, top) = axes.bbox.get_points()
    x, y = axes.xaxis.label.get_position()
    above = axes.xaxis.get_label_position() == "top"
    gap = ScaledTranslation(
        0.0, (y - (top if above else bottom)) / figure.dpi, figure.dpi_scale_trans
    )
    axes.xaxis.set_label_coords(x, float(above), transform=axes.transAxes + gap)
    x, y = axes.yaxis.label.get_position()
    beyond = axes.yaxis.get_label_position() == "right"
    gap = ScaledTranslation(
        (x - (right if beyond else left)) / figure.dpi, 0.0, figure.dpi_scale_trans
    )
    axes.yaxis.set_label_coords(float(beyond), y, transform=axes.transAxes + gap)


def panels(
    size: tuple[float, float], title: str, columns: int = 1, ratios: tuple[float, ...] | None = None
) -> tuple[Figure, list[Axes]]:
    """A figure with a row of axes."""
    figure = Figure(figsize=size)
    figure.set_layout_engine("constrained", wspace=0.05)
    axes = figure.subplots(1, columns, squeeze=False, width_ratios=ratios)
    figure.suptitle(title)
    return figure, list(axes[0])


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
        axes.annotate(
            str(name),
            (place, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, -3),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=9,
            bbox=BOX,
        )
