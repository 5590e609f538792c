"""Pictures of condensed bodies: the grid, natural frequencies by nodal diameter, mode shapes.

Coordinates are those of the body: Z along the axis from mid-face, X towards the middle of tooth 0.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from fem_prep._grid import Grid, surface
from jaxgear._app._body_render import Rendered, frame, render
from jaxgear._app._pictures import _BLUE, _GREEN, _GREY, _ORANGE, _RED, _SKY, Columns, _house_look

_STEEL, _CUT = "#c3ccd6", "#efe3c2"
# The wedge left out of the grid's picture, on the viewer's side [rad].
_WEDGE = (-0.06 * np.pi, 0.44 * np.pi)
# A face of eight nodes as a polygon: corners and middles in turn.
_AROUND = [0, 4, 1, 5, 2, 6, 3, 7]
_MOTION = "RdBu_r"
# How far the largest displacement of a mode is drawn, over the body's radius.
_SHOWN = 0.12


@dataclass(frozen=True)
class DrawnBody:
    """What of a body is drawn.

    **Fields:**

    - `grid`: with the sets `rim` and, for each seat, `seat:NAME` [m].
    - `seats`: place of each seat's own node, by name [m].
    """

    grid: Grid
    seats: Mapping[str, np.ndarray]

    @property
    def colours(self) -> dict[str, str]:
        """Colour of the rim and of every seat, by name of its set."""
        several = (_ORANGE, _GREEN, _RED, _SKY)
        seats = {f"seat:{name}": several[i % len(several)] for i, name in enumerate(self.seats)}
        return {"rim": _BLUE} | {
            name: colour for name, colour in seats.items() if name in self.grid.sets
        }


# --- The grid


@_house_look()
def grid(body: DrawnBody, title: str) -> Figure:
    """The finite elements: a view with a wedge cut out, and the section in the cut.

    **Arguments:**

    - `body`: with its grid.
    - `title`: the body and its size.

    **Returns:**

    The figure; the section in millimetres, Z from mid-face.
    """
    section = _section(body.grid)
    width, height = np.ptp(section[..., 1]), np.max(section[..., 0])
    share = float(np.clip(width / height, 0.35, 1.4))
    figure = Figure(figsize=(6.2 + 4.6 * share + 1.0, 6.4), dpi=150)
    figure.set_layout_engine("constrained", wspace=0.05)
    view, side = figure.subplots(1, 2, width_ratios=(6.0, 4.6 * share + 1.0))
    figure.suptitle(title)
    _draw_cut_body(view, body)
    _draw_section(side, body, section)
    colours = body.colours
    marks = [Patch(color=colour) for colour in colours.values()]
    names = [name.removeprefix("seat:") for name in colours]
    names = [name if name == "rim" else f"seat {name}" for name in names]
    figure.legend(
        [*marks, Patch(fc=_CUT, ec=_GREY)],
        [*names, "section"],
        loc="outside lower center",
        ncols=min(len(names) + 1, 6),
        frameon=False,
    )
    return figure


def grid_columns(body: DrawnBody) -> Columns:
    """The data of `grid`: outline of every element in the section."""
    section = 1e3 * _section(body.grid)
    face = np.repeat(np.arange(len(section)), section.shape[1])
    r, z = section.reshape(-1, 2).T
    return {"element": face, "r_mm": r, "z_mm": z}


def _draw_cut_body(axes: Axes, body: DrawnBody) -> None:
    """The surface without a wedge, rim and seats coloured, the cut in a colour of its own."""
    kept, opened = _opened(body.grid)
    colours = np.tile(to_rgb(_STEEL), (len(kept), 8, 1))
    for name, colour in body.colours.items():
        inside = np.zeros(len(body.grid.nodes), dtype=bool)
        inside[body.grid.sets[name]] = True
        colours[inside[kept].all(axis=1)] = to_rgb(colour)
    colours[opened] = to_rgb(_CUT)
    _show(axes, render(body.grid.nodes, kept, colours, flat=opened, edges=True, pixels=700))
    _draw_triad(axes)


def _show(axes: Axes, picture: Rendered) -> None:
    left, right, bottom, top = (1e3 * end for end in picture.extent)
    axes.imshow(picture.image, extent=(left, right, bottom, top), interpolation="antialiased")
    axes.set_axis_off()


def _draw_triad(axes: Axes) -> None:
    """The directions of X, Y and Z, below on the left."""
    left, bottom = axes.get_xlim()[0], axes.get_ylim()[0]
    size = 0.09 * (axes.get_ylim()[1] - bottom)
    start = left + 0.9 * size, bottom - 0.2 * size
    axes.set_xlim(left=left - 0.3 * size)
    axes.set_ylim(bottom=bottom - 1.3 * size)
    look = {"arrowstyle": "-|>", "color": _GREY, "shrinkA": 0.0, "shrinkB": 0.0}
    for name, (right, up) in zip("XYZ", size * frame()[:, :2], strict=True):
        axes.annotate("", (start[0] + right, start[1] + up), start, arrowprops=look)
        where = start[0] + 1.35 * right, start[1] + 1.35 * up
        axes.text(*where, name, color=_GREY, ha="center", va="center")


def _draw_section(axes: Axes, body: DrawnBody, section: np.ndarray) -> None:
    """Elements in the cut, over Z and radius; rim and seats as lines."""
    axes.grid(False)
    outline = 1e3 * section[..., ::-1]
    axes.add_collection(PolyCollection(list(outline), fc=_CUT, ec=_GREY, lw=0.5))
    for name, colour in body.colours.items():
        nodes = body.grid.nodes[body.grid.sets[name]]
        z, r = 1e3 * nodes[:, 2], 1e3 * np.hypot(nodes[:, 0], nodes[:, 1])
        if np.ptp(r) < 1e-3 * r.max():
            axes.plot([z.min(), z.max()], [r.mean()] * 2, color=colour, lw=4.0)
        else:
            # On several cylinders, as in a solid shaft or over a step.
            axes.plot(*np.unique(np.round([z, r], 3), axis=1), ".", color=colour, ms=5)
    for name, point in body.seats.items():
        colour = body.colours.get(f"seat:{name}", _GREY)
        axes.plot(1e3 * point[2], 0.0, "o", ms=6, color="white", mec=colour, mew=1.8, zorder=4)
    axes.axhline(0.0, color=_GREY, lw=0.8, ls="-.")
    axes.autoscale_view()
    axes.set_ylim(bottom=-0.04e3 * section[..., 0].max())
    axes.set_aspect("equal")
    axes.set(xlabel="Z from mid-face [mm]", ylabel="radius [mm]")


def _opened(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Outer faces with a wedge left out, and which of them the cut has laid open."""
    middle = grid.nodes[grid.bricks[:, :8]].mean(axis=1)
    angle = np.arctan2(middle[:, 1], middle[:, 0])
    left = grid.bricks[(angle < _WEDGE[0]) | (angle > _WEDGE[1])]
    kept = surface(Grid(grid.nodes, left))
    outside = {tuple(row) for row in np.sort(surface(grid)[:, :4], axis=1)}
    opened = [tuple(row) not in outside for row in np.sort(kept[:, :4], axis=1)]
    return kept, np.array(opened, dtype=bool)


def _section(grid: Grid) -> np.ndarray:
    """Faces of one side of the cut: radius and Z around each, shape `[face, 8, 2]` [m]."""
    kept, opened = _opened(grid)
    faces = grid.nodes[kept[opened]][:, _AROUND]
    middle = faces.mean(axis=1)
    angle = np.arctan2(middle[:, 1], middle[:, 0])
    near = np.abs(angle - _WEDGE[1]) < np.abs(angle - _WEDGE[0])
    return np.stack([np.hypot(faces[..., 0], faces[..., 1]), faces[..., 2]], axis=-1)[near]


# --- Modes


@dataclass(frozen=True)
class DrawnModes:
    """Free modes of a body, lowest first.

    **Fields:**

    - `frequency_Hz`: [Hz].
    - `diameter`: nodal diameters [-].
    - `circle`: nodal circles, or None if they are not known [-].
    - `share`: of the energy that the nodal diameter has [-].
    - `kind`: where most motion goes: "radial", "tangential" or "axial".
    """

    frequency_Hz: np.ndarray
    diameter: np.ndarray
    circle: np.ndarray | None
    share: np.ndarray
    kind: Sequence[str]

    def label(self, mode: int) -> str:
        """A mode in words."""
        words = [_counted(int(self.diameter[mode]), "nodal diameter")]
        if self.circle is not None:
            words.append(_counted(int(self.circle[mode]), "circle"))
        return f"{self.frequency_Hz[mode]:.5g} Hz, {self.kind[mode]}\n{', '.join(words)}"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count != 1 else ''}"


_COLOURS = {"axial": _BLUE, "radial": _ORANGE, "tangential": _GREEN}
_MARKS = {"axial": "o", "radial": "s", "tangential": "^"}
# A mode whose nodal diameter has less of its energy has no clear number.
_CLEAR = 0.6
# Frequencies of a pair differ by less than that; holes may part them.
_TWINS = 1e-3
# How many mode shapes are drawn.
_DRAWN = 9


@_house_look()
def families(modes: DrawnModes, title: str) -> Figure:
    """Free natural frequencies over nodal diameters, families joined.

    The lowest modes of one kind are a family, the next ones another, and so on. A number at a
    mode counts its nodal circles.

    **Arguments:**

    - `modes`: of the free body.
    - `title`: the body.

    **Returns:**

    The figure. Hollow: modes whose nodal diameter is not clear.
    """
    figure = Figure(figsize=(8.4, 6.4), dpi=150)
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    figure.suptitle(title)
    rank, kinds = _ranks(modes), np.asarray(modes.kind)
    for kind, colour in _COLOURS.items():
        for each in range(1 + int(rank[kinds == kind].max(initial=-1))):
            line = np.flatnonzero((kinds == kind) & (rank == each))
            line = line[np.argsort(modes.diameter[line])]
            for part in np.split(line, np.flatnonzero(np.diff(modes.diameter[line]) > 1) + 1):
                axes.plot(modes.diameter[part], 1e-3 * modes.frequency_Hz[part], color=colour)
    told = set()
    for mode, kind in enumerate(modes.kind):
        where = modes.diameter[mode], 1e-3 * modes.frequency_Hz[mode]
        fill = _COLOURS[kind] if modes.share[mode] >= _CLEAR else "white"
        axes.plot(*where, _MARKS[kind], ms=7, mfc=fill, mec=_COLOURS[kind], mew=1.4)
        place = kind, modes.diameter[mode], rank[mode]
        if modes.circle is not None and place not in told:
            told.add(place)
            look = {"textcoords": "offset points", "fontsize": 8.5, "color": _GREY}
            axes.annotate(f"{modes.circle[mode]}", where, (7, -10), **look)
    axes.set(xlabel="nodal diameters", ylabel="free natural frequency [kHz]")
    axes.set_ylim(bottom=0.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    look = {"ls": "", "ms": 7}
    handles = [
        Line2D([], [], color=_COLOURS[kind], marker=mark, **look)
        for kind, mark in _MARKS.items()
        if kind in kinds
    ]
    names = [f"mostly {kind}" for kind in _MARKS if kind in kinds]
    if np.any(modes.share < _CLEAR):
        handles.append(Line2D([], [], mec=_GREY, marker="o", mfc="white", **look))
        names.append("no clear nodal diameter")
    figure.legend(
        handles,
        names,
        loc="outside lower center",
        ncols=4,
        frameon=False,
        title=None if modes.circle is None else "numbers: nodal circles",
    )
    return figure


def families_columns(modes: DrawnModes) -> Columns:
    """The data of `families`, a row for each mode."""
    circles = {} if modes.circle is None else {"nodal_circle": modes.circle}
    return {
        "mode": np.arange(1, len(modes.frequency_Hz) + 1),
        "frequency_Hz": modes.frequency_Hz,
        "nodal_diameter": modes.diameter,
        **circles,
        "kind": np.asarray(modes.kind),
        "family": 1 + _ranks(modes),
        "share_of_nodal_diameter": modes.share,
    }


def _ranks(modes: DrawnModes) -> np.ndarray:
    """Number of each mode among those of its kind and nodal diameter; two make one pair."""
    rank = np.zeros(len(modes.frequency_Hz), dtype=int)
    seen: Counter[tuple[str, int]] = Counter()
    for mode, kind in enumerate(modes.kind):
        diameter = int(modes.diameter[mode])
        rank[mode] = seen[kind, diameter] // (2 if diameter else 1)
        seen[kind, diameter] += 1
    return rank


def chosen_modes(modes: DrawnModes) -> list[int]:
    """Modes, lowest first; of the two of a pair, which differ by a turn, the first only."""
    chosen: list[int] = []
    for mode, frequency in enumerate(modes.frequency_Hz):
        twin = any(
            modes.diameter[mode] == modes.diameter[other] > 0
            and modes.kind[mode] == modes.kind[other]
            and frequency < (1.0 + _TWINS) * modes.frequency_Hz[other]
            for other in chosen
        )
        if not twin:
            chosen.append(mode)
    return chosen


@_house_look()
def mode_shapes(body: DrawnBody, modes: DrawnModes, shapes: np.ndarray, title: str) -> Figure:
    """The lowest different mode shapes, deformed, coloured by motion along their main direction.

    **Arguments:**

    - `body`: with its grid.
    - `modes`: what they are.
    - `shapes`: of the same modes or of the first of them, `[mode, node, 3]`, to any scale.
    - `title`: the body.

    **Returns:**

    The figure.
    """
    chosen = [mode for mode in chosen_modes(modes) if mode < len(shapes)][:_DRAWN]
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = Figure(figsize=(3.4 * columns, 2.9 * rows + 1.1), dpi=150)
    figure.set_layout_engine("constrained", wspace=0.02, hspace=0.02)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    figure.suptitle(title)
    faces = surface(body.grid)
    nodes = body.grid.nodes
    colours = ScalarMappable(Normalize(-1.0, 1.0), _MOTION)
    for panel in panels:
        panel.set_axis_off()
    for panel, mode in zip(panels, chosen, strict=False):
        shape = shapes[mode] / np.abs(shapes[mode]).max()
        along = _component(nodes, shape, modes.kind[mode])
        along = along / np.abs(along).max()
        moved = nodes + _SHOWN * body.grid.radius.max() * shape
        fill = np.asarray(colours.to_rgba(along[faces].ravel()))[:, :3].reshape(-1, 8, 3)
        _show(panel, render(moved, faces, fill, pixels=320))
        # A slender body is narrower than its panel, whose title is not.
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_title(modes.label(mode))
    bar = figure.colorbar(
        colours, ax=list(panels), location="bottom", shrink=0.6, aspect=40, pad=0.02
    )
    bar.set_label("displacement along the direction named, of the largest")
    return figure


def mode_shapes_columns(modes: DrawnModes, shapes: np.ndarray) -> Columns:
    """Which modes `mode_shapes` draws; the shapes themselves are in the VTU file."""
    chosen = [mode for mode in chosen_modes(modes) if mode < len(shapes)][:_DRAWN]
    return {name: column[chosen] for name, column in families_columns(modes).items()}


def _component(nodes: np.ndarray, shape: np.ndarray, kind: str) -> np.ndarray:
    """Axial, radial or tangential displacement of every node."""
    if kind == "axial":
        return shape[:, 2]
    radius = np.maximum(np.hypot(nodes[:, 0], nodes[:, 1]), 1e-12)
    x, y = nodes[:, 0] / radius, nodes[:, 1] / radius
    radial, tangential = x * shape[:, 0] + y * shape[:, 1], x * shape[:, 1] - y * shape[:, 0]
    return radial if kind == "radial" else tangential
