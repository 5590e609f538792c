"""Pictures of the stresses at the roots of the teeth."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxgear._columns import Table
from jaxgear.plot._cycle import unrolled
from jaxgear.plot._palette import GEAR_COLOURS, GREY
from jaxgear.plot._picture import GEARS
from jaxgear.plot._speed_axes import flag, speed_axes, stack
from jaxgear.plot._style import digits, legend_below, panels, phase_axis

_STRESS = "root_stress_MPa"


def over_cycle(roots: xr.Dataset) -> Table:
    """Largest stresses of each gear over the cycle, one of a single period twice in a row.

    **Arguments:**

    - `roots`: the group `roots`.
    """
    table, phase = {}, roots["phase"].values
    for gear in GEARS:
        largest = roots[_STRESS].sel(gear=gear).max(("line", "slice")).values
        table["phase"], table[f"{gear}_root_stress_MPa"] = unrolled(phase, largest)
    return Table(table)


def along_face(roots: xr.Dataset) -> Table:
    """Largest stresses of each gear along the face.

    **Arguments:**

    - `roots`: the group `roots`.
    """
    table = {"face_position_mm": roots["face_position_mm"].values}
    for gear in GEARS:
        own = roots.sel(gear=gear)
        table[f"{gear}_root_stress_MPa"] = own[_STRESS].max(("phase", "line")).values
        compression = own["root_compression_MPa"].min(("phase", "line")).values
        table[f"{gear}_root_compression_MPa"] = compression
    return Table(table)


def root_stress(roots: xr.Dataset) -> Figure:
    """Stress at the roots over the cycle and along the face.

    **Arguments:**

    - `roots`: the group `roots`.

    **Returns:**

    The figure.
    """
    figure, (time, face) = panels("Stress at the roots of the teeth", roots, (9.6, 4.2), 2)
    cycle, across = over_cycle(roots), along_face(roots)
    for gear, colour in zip(GEARS, GEAR_COLOURS, strict=True):
        largest = digits(float(roots[_STRESS].sel(gear=gear).max()), 4)
        label = f"{gear}: largest {largest} MPa"
        time.plot(cycle["phase"], cycle[f"{gear}_root_stress_MPa"], color=colour, label=label)
        place = across["face_position_mm"]
        style: dict[str, Any] = {"color": colour, "marker": "o", "ms": 3.0}
        face.plot(place, across[f"{gear}_root_stress_MPa"], **style)
        face.plot(place, across[f"{gear}_root_compression_MPa"], ls="--", **style)
    time.set_ylim(0.0, 1.2 * max(float(roots[_STRESS].max()), 1e-9))
    time.legend(loc="upper right")
    time.set_title("largest tension of any tooth", loc="left")
    phase_axis(time, "root stress [MPa]", roots["phase"].values)
    face.axhline(0.0, color=GREY, lw=0.8)
    face.set_title("tension; dashed: compression, other fillet", loc="left")
    face.set(xlabel="position from mid-face [mm]", ylabel="root stress [MPa]")
    return figure


def root_outline(roots: xr.Dataset) -> Figure:
    """Stress along both fillets on the outlines of the teeth, where it is largest.

    **Arguments:**

    - `roots`: the group `roots`.

    **Returns:**

    The figure.
    """
    figure, both = panels("Stress along the fillets where tension is largest", roots, (9.6, 4.6), 2)
    longest = float(np.abs(roots["fillet_stress_MPa"]).max())
    for axes, gear, colour in zip(both, GEARS, GEAR_COLOURS, strict=True):
        _draw_tooth(axes, roots.sel(gear=gear), colour, longest)
    return figure


def _draw_tooth(axes: Axes, own: xr.Dataset, colour: str, longest: float) -> None:
    half, height = (own[f"fillet_{name}_mm"].values for name in ("half_thickness", "height"))
    up, above = (own[f"flank_{name}_mm"].values for name in ("half_thickness", "height"))
    side, top = np.append(half, up), np.append(height, above)
    axes.plot(np.append(side, -side[::-1]), np.append(top, top[::-1]), color=GREY)
    # Into the tooth, where lines square to the hollow fillet part.
    tangent = np.stack([np.gradient(half), np.gradient(height)])
    inward = np.stack([-tangent[1], tangent[0]]) / np.hypot(*tangent)
    words = []
    for fillet, sign in (("drive", 1.0), ("coast", -1.0)):
        stress = own["fillet_stress_MPa"].sel(fillet=fillet).values
        size = np.abs(stress) / longest * 0.6 * np.max(half)
        x, y = sign * (half + inward[0] * size), height + inward[1] * size
        axes.fill(
            np.append(x, sign * half[::-1]), np.append(y, height[::-1]), color=colour, alpha=0.3
        )
        axes.plot(x, y, color=colour)
        words.append(digits(float(stress.max() if sign > 0.0 else stress.min()), 4))
    axes.set_aspect("equal")
    axes.set(xlabel="across the tooth [mm]", ylabel="height above the centre [mm]")
    name = str(own["gear"].values)
    axes.set_title(f"{name}: tension {words[0]} MPa, behind {words[1]} MPa", loc="left")


_WAYS: dict[str, dict[str, Any]] = {"up": {}, "down": {"ls": "--"}, "cold": {"ls": ":"}}


def root_stress_at_speed(swept: xr.Dataset) -> Figure:
    """Largest stresses at the roots over speed, of settled responses, beside those at rest.

    **Arguments:**

    - `swept`: the group `sweep`, with root stresses.

    **Returns:**

    The figure.
    """
    figure, (tension, compression) = stack(
        "Dynamic stress at the roots", swept, (9.6, 5.8), (3.0, 1.7)
    )
    settled, lines = flag(swept, "settled"), []
    for gear, colour in zip(GEARS, GEAR_COLOURS, strict=True):
        own = swept.sel(gear=gear)
        for row, way in enumerate(swept["direction"].values):
            look: dict[str, Any] = {"color": colour, "marker": "o", "ms": 3.0, **_WAYS[str(way)]}
            shown = np.where(settled[row], own[_STRESS].sel(direction=way), np.nan)
            label = f"{gear}, {way}"
            lines += tension.plot(swept["speed"], shown, label=label, **look)
            pressed = own["root_compression_MPa"].sel(direction=way)
            compression.plot(swept["speed"], np.where(settled[row], pressed, np.nan), **look)
        rest = float(own["static_root_stress_MPa"])
        label = f"{gear}, static: {digits(rest, 4)} MPa"
        lines.append(tension.axhline(rest, color=colour, lw=0.8, ls=(0, (1, 2)), label=label))
    tension.set_ylabel("largest tension [MPa]")
    compression.set_ylabel("compression,\nother fillet [MPa]")
    speed_axes([tension, compression], swept["speed"].values, int(swept.attrs["teeth_pinion"]))
    legend_below(figure, lines, ncols=3)
    figure.align_ylabels([tension, compression])
    return figure
