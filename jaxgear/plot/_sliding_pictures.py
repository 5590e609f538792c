"""The picture of sliding along the path of contact."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from jaxgear._units import mm
from jaxgear.plot._palette import GEAR_COLOURS, GREEN, GREY
from jaxgear.plot._style import axis_label, digits, mark_points, panels, room_above


def sliding(data: xr.Dataset, cycle: xr.Dataset) -> Figure:
    """Specific sliding of both flanks, and the speed of sliding over that of the pitch line.

    The dataset of the mesh cycle says where A to E are.
    """
    figure, (specific, speed) = panels("Sliding on the path of contact", data, (9.6, 4.2), 2)
    for gear, colour in zip(("pinion", "wheel"), GEAR_COLOURS, strict=True):
        values = data[f"specific_sliding_{gear}"]
        least = digits(float(np.min(values)), 3)
        specific.plot(data["roll_mm"], values, color=colour, label=f"{gear}: lowest {least}")
    specific.set(ylabel="specific sliding ζ [-]")
    specific.set_title("sliding over rolling speed of each flank", loc="left")
    specific.legend(loc="lower center")
    (line,) = speed.plot(data["roll_mm"], data["sliding_over_pitch_line_speed"], color=GREEN)
    pinion_speed = float(data["pinion_speed_rad_s"])
    if pinion_speed > 0.0:
        most = pinion_speed * mm * np.max(np.abs(data["sliding_speed_per_pinion_speed_mm"]))
        line.set_label(f"at most {digits(float(most), 3)} m/s at {pinion_speed:.5g} rad/s")
        speed.legend(loc="lower right")
    speed.set(ylabel="sliding over pitch line speed K_g [-]")
    share = 100.0 * (1.0 - float(data["mesh_efficiency"]))
    friction = float(data["friction_coefficient"])
    words = f"{digits(share, 3)} % of the power is lost with a friction of {friction:g}"
    speed.set_title(words, loc="left")
    for axes in (specific, speed):
        room_above(axes, 0.08)
        axes.axhline(0.0, color=GREY, lw=0.8)
        axes.set_xlabel(axis_label(data["roll_mm"]))
        mark_points(axes, cycle["path_point_roll_mm"])
    return figure
