"""Pictures of condensed bodies: the grid, natural frequencies by nodal diameter, mode shapes.

Coordinates are those of the body: Z along the axis from mid-face, X towards the middle of tooth 0.
"""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from jaxgear.plot._body_render import Rendered, frame, render
from jaxgear.plot._palette import BLUE, EITHER_WAY, GREEN, GREY, ORANGE, RED, SKY
from jaxgear.plot._style import legend_below, panels, write_at

_STEEL, _CUT = "#c3ccd6", "#efe3c2"
# How far the largest displacement of a mode is drawn, over the body's radius.
_SHOWN = 0.12


# --- The grid


def grid(body: xr.Dataset) -> Figure:
    """The finite elements: a view with a wedge cut out, and the section in the cut [mm]."""
    r, z = body["section_mm"].values.T
    share = float(np.clip(np.ptp(z) / np.max(r), 0.35, 1.4))
    ratios = (6.0, 4.6 * share + 1.0)
    size = (6.2 + ratios[1], 6.4)
    title = body.attrs["grid_title"]
    figure, (view, side) = panels(title, None, size, 2, width_ratios=ratios)
    names = body["part"].values.tolist()
    seats = (ORANGE, GREEN, RED, SKY)
    colours = [BLUE if name == "rim" else seats[(i - 1) % 4] for i, name in enumerate(names)]
    _draw_cut_body(view, body, colours)
    _draw_section(side, body, dict(zip(names, colours, strict=True)))
    patches = [*(Patch(color=colour) for colour in colours), Patch(fc=_CUT, ec=GREY)]
    labels = [name if name == "rim" else f"seat {name}" for name in names]
    legend_below(figure, patches, [*labels, "section"], ncols=min(len(names) + 1, 6))
    return figure


def _draw_cut_body(axes: Axes, body: xr.Dataset, parts: list[str]) -> None:
    """The surface without a wedge, rim and seats coloured, the cut in a colour of its own."""
    faces, cut = body["open_face"].values, body["is_cut"].values.astype(bool)
    colours = np.tile(to_rgb(_STEEL), (len(faces), 8, 1))
    for number, colour in enumerate(parts):
        colours[(body["part_of_node"].values[faces] == number).all(axis=1)] = to_rgb(colour)
    colours[cut] = to_rgb(_CUT)
    nodes = 1e-3 * body["node_mm"].values
    show(axes, render(nodes, faces, colours, flat=cut, edges=True, pixels=700))
    _draw_triad(axes)


def show(axes: Axes, picture: Rendered) -> None:
    """Put a shaded picture on axes in millimetres, which are not drawn."""
    left, right, bottom, top = (1e3 * end for end in picture.extent)
    axes.imshow(picture.image, extent=(left, right, bottom, top), interpolation="antialiased")
    axes.set_axis_off()


def fill_of(colours: ScalarMappable, values: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Colours of values at nodes, for the nodes of each face."""
    return np.asarray(colours.to_rgba(values[faces].ravel()))[:, :3].reshape(-1, 8, 3)


def _draw_triad(axes: Axes) -> None:
    """The directions of X, Y and Z, below on the left."""
    left, bottom = axes.get_xlim()[0], axes.get_ylim()[0]
    size = 0.09 * (axes.get_ylim()[1] - bottom)
    start = left + 0.9 * size, bottom - 0.2 * size
    axes.set_xlim(left=left - 0.3 * size)
    axes.set_ylim(bottom=bottom - 1.3 * size)
    look = {"arrowstyle": "-|>", "color": GREY, "shrinkA": 0.0, "shrinkB": 0.0}
    for name, (right, up) in zip("XYZ", size * frame()[:, :2], strict=True):
        axes.annotate("", (start[0] + right, start[1] + up), start, arrowprops=look)
        where = start[0] + 1.35 * right, start[1] + 1.35 * up
        axes.text(*where, name, color=GREY, ha="center", va="center")


def _draw_section(axes: Axes, body: xr.Dataset, colours: dict[str, str]) -> None:
    """Elements in the cut, over Z and radius; rim and seats as lines."""
    axes.grid(False)
    section, nodes = body["section_mm"].values, body["node_mm"].values
    axes.add_collection(PolyCollection(list(section[..., ::-1]), fc=_CUT, ec=GREY, lw=0.5))
    for number, colour in enumerate(colours.values()):
        x, y, z = nodes[body["part_of_node"].values == number].T
        r = np.hypot(x, y)
        if np.ptp(r) < 1e-3 * r.max():
            axes.plot([z.min(), z.max()], [r.mean()] * 2, color=colour, lw=4.0)
        else:
            # On several cylinders, as in a solid shaft or over a step.
            axes.plot(*np.unique(np.round([z, r], 3), axis=1), ".", color=colour, ms=5)
    for name, point in zip(body["seat"].values, body["seat_mm"].values, strict=True):
        look: dict[str, Any] = {
            "color": "white",
            "mec": colours.get(name, GREY),
            "mew": 1.8,
            "zorder": 4,
        }
        axes.plot(point[2], 0.0, "o", ms=6, **look)
    axes.axhline(0.0, color=GREY, lw=0.8, ls="-.")
    axes.autoscale_view()
    axes.set_ylim(bottom=-0.04 * section[..., 0].max())
    axes.set_aspect("equal")
    axes.set(xlabel="Z from mid-face [mm]", ylabel="radius [mm]")


# --- Modes


_COLOURS = {"axial": BLUE, "radial": ORANGE, "tangential": GREEN}
_MARKS = {"axial": "o", "radial": "s", "tangential": "^"}
# A mode whose nodal diameter has less of its energy has no clear number.
_CLEAR = 0.6


def families(modes: xr.Dataset) -> Figure:
    """Free natural frequencies over nodal diameters, families joined.

    The lowest modes of one kind are a family, the next ones another, and so on. A number at a
    mode counts its nodal circles. Hollow: modes whose nodal diameter is not clear.
    """
    figure, (axes,) = panels(modes.attrs["title"], None, (8.4, 6.4))
    diameter, kinds, rank = (modes[x].values for x in ("nodal_diameter", "kind", "family"))
    frequency, clear = 1e-3 * modes["frequency_Hz"], modes["nodal_diameter_share"] >= _CLEAR
    for kind, colour in _COLOURS.items():
        for each in range(1, 1 + int(rank[kinds == kind].max(initial=0))):
            line = np.flatnonzero((kinds == kind) & (rank == each))
            line = line[np.argsort(diameter[line])]
            for part in np.split(line, np.flatnonzero(np.diff(diameter[line]) > 1) + 1):
                axes.plot(diameter[part], frequency[part], color=colour)
    told = set()
    for mode, kind in enumerate(kinds):
        where = diameter[mode], float(frequency[mode])
        fill = _COLOURS[kind] if clear[mode] else "white"
        axes.plot(*where, _MARKS[kind], ms=7, mfc=fill, mec=_COLOURS[kind], mew=1.4)
        place = kind, diameter[mode], rank[mode]
        if "nodal_circle" in modes and place not in told:
            told.add(place)
            look = {"ha": "left", "fontsize": 8.5, "color": GREY}
            write_at(axes, f"{int(modes['nodal_circle'][mode])}", where, (7, -10), **look)
    axes.set(xlabel="nodal diameters", ylabel="free natural frequency [kHz]")
    axes.set_ylim(bottom=0.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    seen = [kind for kind in _MARKS if kind in kinds]
    marked: dict[str, Any] = {"ls": "", "ms": 7}
    handles = [Line2D([], [], color=_COLOURS[each], marker=_MARKS[each], **marked) for each in seen]
    names = [f"mostly {kind}" for kind in seen]
    if not clear.all():
        handles.append(Line2D([], [], mec=GREY, marker="o", mfc="white", **marked))
        names.append("no clear nodal diameter")
    title = "numbers: nodal circles" if "nodal_circle" in modes else None
    legend_below(figure, handles, names, ncols=4, title=title)
    return figure


def mode_shapes(body: xr.Dataset) -> Figure:
    """The lowest different mode shapes, deformed, coloured by motion along their main direction."""
    count = body.sizes["shown"]
    columns = min(3, count)
    rows = -(-count // columns)
    size = (3.4 * columns, 2.9 * rows + 1.1)
    figure, places = panels(body.attrs["title"], None, size, columns, rows, space=(0.02, 0.02))
    faces, nodes = body["face"].values, 1e-3 * body["node_mm"].values
    reach = _SHOWN * np.hypot(nodes[:, 0], nodes[:, 1]).max()
    colours = ScalarMappable(Normalize(-1.0, 1.0), EITHER_WAY)
    for panel in places:
        panel.set_axis_off()
    for panel, mode, shape in zip(
        places, body["shown"].values - 1, body["shape"].values, strict=False
    ):
        shape = shape / np.abs(shape).max()
        along = component_of(nodes, shape, str(body["kind"].values[mode]))
        fill = fill_of(colours, along / np.abs(along).max(), faces)
        show(panel, render(nodes + reach * shape, faces, fill, pixels=320))
        # A slender body is narrower than its panel, whose title is not.
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_title(str(body["label"].values[mode]))
    place: dict[str, Any] = {"location": "bottom", "shrink": 0.6, "aspect": 40, "pad": 0.02}
    bar = figure.colorbar(colours, ax=places, **place)
    bar.set_label("displacement along the direction named, of the largest")
    return figure


def component_of(nodes: np.ndarray, shape: np.ndarray, kind: str) -> np.ndarray:
    """Axial, radial or tangential displacement of every node."""
    if kind == "axial":
        return shape[:, 2]
    radius = np.maximum(np.hypot(nodes[:, 0], nodes[:, 1]), 1e-12)
    x, y = nodes[:, 0] / radius, nodes[:, 1] / radius
    if kind == "radial":
        return x * shape[:, 0] + y * shape[:, 1]
    return x * shape[:, 1] - y * shape[:, 0]
