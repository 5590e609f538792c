"""Pictures of the stresses of condensed bodies, and of the strain gauges on them."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from jaxgear._units import deg, mm
from jaxgear.plot._body_pictures import fill_of, show
from jaxgear.plot._body_render import VIEW, render
from jaxgear.plot._palette import GREY, SERIES, SURFACE
from jaxgear.plot._picture import GEARS
from jaxgear.plot._speed_axes import flag
from jaxgear.plot._style import panels


def body_stress(body: xr.Dataset) -> Figure:
    """Stresses of a body: of its surface under its largest load, and of its section all around.

    Scales end where the nodes do that numbers are told of: loads of teeth and rigid seats are not
    what they look like close by.

    **Arguments:**

    - `body`: the group `pinion_stress` or `wheel_stress`.

    **Returns:**

    The figure.
    """
    title = f"Stresses of the {body.attrs['gear']}'s body"
    ratios = (1.25, 1.0, 1.0)
    figure, (view, *sides) = panels(title, body, (13.2, 5.2), 3, width_ratios=ratios)
    told = body["told"].values.astype(bool)
    values = body["von_mises_MPa"].values
    colours = _scale(values[told])
    _draw_surface(view, body, fill_of(colours, values, body["face"].values))
    view.set_title(f"von Mises stress, {body.attrs['under']}", loc="left")
    bar: dict[str, Any] = {"location": "bottom", "shrink": 0.8, "pad": 0.02}
    figure.colorbar(colours, ax=view, label="von Mises stress [MPa]", **bar)
    names = ("section_principal_MPa", "section_alternating_MPa")
    of_nodes = ("largest_principal_MPa", "alternating_MPa")
    for axes, name, nodes in zip(sides, names, of_nodes, strict=True):
        own = _scale(body[nodes].values[told])
        _draw_section(axes, body, own.to_rgba(body[name].values))
        figure.colorbar(own, ax=axes, label=f"{body[nodes].attrs['long_name']} [MPa]", **bar)
    return figure


def _scale(values: np.ndarray) -> ScalarMappable:
    return ScalarMappable(Normalize(min(0.0, float(values.min())), float(values.max())), SURFACE)


def _draw_surface(axes: Axes, body: xr.Dataset, colours: np.ndarray) -> None:
    """The surface, with the mesh on the viewer's side."""
    # The mesh is at S from the pinion's axis, at -S from the wheel's.
    turn = np.arctan2(VIEW[1], VIEW[0]) - float(body["mesh_angle_deg"]) * deg
    cosine, sine = np.cos(turn), np.sin(turn)
    turned = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    nodes = body["place_mm"].values * mm @ turned
    show(axes, render(nodes, body["face"].values, colours, edges=True, pixels=620))


def _draw_section(axes: Axes, body: xr.Dataset, colours: np.ndarray) -> None:
    axes.grid(False)
    section = body["section_mm"].values
    axes.add_collection(PolyCollection(list(section[..., ::-1]), fc=colours, ec="none"))
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set(xlabel="Z from mid-face [mm]", ylabel="radius [mm]")


def gauges(dataset: xr.Dataset) -> Figure:
    """Strains of all gauges over a revolution of their gears.

    **Arguments:**

    - `dataset`: the group `gauges`.

    **Returns:**

    The figure.
    """
    figure, shown = _of_gears("Strain gauges", dataset, 3.2)
    for axes, gear in shown:
        for number, name in enumerate(dataset[f"{gear}_gauge"].values):
            own = dataset.sel({f"{gear}_gauge": name})
            strain = own[f"{gear}_gauge_strain_um_m"]
            colour = SERIES[number % len(SERIES)]
            axes.plot(own[f"{gear}_turn"], strain, color=colour, lw=1.1, label=str(name))
        axes.set(
            xlabel=f"angle by which the {gear} has turned [°]",
            ylabel="strain [µm/m]",
            xlim=(0.0, 360.0),
            xticks=np.arange(0, 361, 60),
        )
        axes.legend(frameon=False, loc="best")
    return figure


def _of_gears(
    title: str, dataset: xr.Dataset, height: float = 3.4
) -> tuple[Figure, list[tuple[Axes, str]]]:
    """Axes for each gear that has gauges, so many inches high."""
    shown = [gear for gear in GEARS if f"{gear}_gauge" in dataset]
    size = (9.6, 1.2 + height * len(shown))
    figure, every = panels(title, dataset, size, rows=len(shown))
    return figure, list(zip(every, shown, strict=True))


# Below this part of the largest amplitude nothing is drawn, nor beyond so many orders of the teeth.
_FAINT, _HARMONICS = 1e-3, 3.5


def gauge_spectra(dataset: xr.Dataset) -> Figure:
    """Amplitudes of all gauges at the highest peak, by orders of their gears' rotation.

    **Arguments:**

    - `dataset`: the group `gauges_moving`.

    **Returns:**

    The figure.
    """
    figure, shown = _of_gears("Spectra of the strain gauges", dataset)
    for axes, gear in shown:
        teeth = dataset.attrs[f"teeth_{gear}"]
        order = dataset[f"{gear}_order"].values
        amplitude = dataset[f"{gear}_gauge_strain_um_m"].values
        near = (order > 0.0) & (order <= _HARMONICS * teeth)
        floor = _FAINT * float(amplitude[:, near].max(initial=1e-9))
        for harmonic in range(1, int(_HARMONICS) + 1):
            axes.axvline(harmonic * teeth, color=GREY, lw=0.8, ls=":", zorder=0)
        for number, (name, own) in enumerate(
            zip(dataset[f"{gear}_gauge"].values, amplitude, strict=True)
        ):
            seen = near & (own > floor)
            colour = SERIES[number % len(SERIES)]
            # Side by side where several are at one order.
            place = order[seen] + 0.004 * teeth * number
            axes.vlines(place, floor, own[seen], color=colour, lw=1.2)
            axes.plot(place, own[seen], "o", ms=3.5, color=colour, label=str(name))
        axes.set(
            xlabel=f"order of the {gear}'s rotation; dotted: its teeth",
            ylabel="amplitude of the strain [µm/m]",
            yscale="log",
            ylim=(floor, 3.0 * floor / _FAINT),
            xlim=(0.0, _HARMONICS * teeth),
        )
        axes.legend(loc="upper right")
    return figure


_LINES = {"up": "-", "down": "--", "cold": ":"}


def gauges_at_speed(dataset: xr.Dataset) -> Figure:
    """Largest and least stresses of all gauges over speed, of settled responses.

    **Arguments:**

    - `dataset`: the group `gauges_swept`.

    **Returns:**

    The figure.
    """
    figure, shown = _of_gears("Stress at the strain gauges", dataset)
    speed, settled = dataset["speed"].values, flag(dataset, "settled")
    for axes, gear in shown:
        for number, name in enumerate(dataset[f"{gear}_gauge"].values):
            own = dataset.sel({f"{gear}_gauge": name})
            for row, way in enumerate(dataset["direction"].values):
                look: dict[str, Any] = {
                    "color": SERIES[number % len(SERIES)],
                    "ls": _LINES[str(way)],
                    "lw": 1.1,
                }
                for part, mark in (("largest", "^"), ("least", "v")):
                    stress = own[f"{gear}_gauge_stress_{part}_MPa"].values[row]
                    label = f"{name}, {way}" if part == "largest" else None
                    values = np.where(settled[row], stress, np.nan)
                    axes.plot(speed, values, marker=mark, ms=3.0, label=label, **look)
        axes.set(xlabel="speed of the pinion [rad/s]", ylabel="stress [MPa]")
        axes.legend(frameon=False, loc="best")
    return figure
