"""The picture of sliding along the path of contact. Its data are in `_sliding_tables`."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from jaxgear._units import mm
from jaxgear.plot._palette import _BLUE, _GREEN, _GREY, _ORANGE
from jaxgear.plot._pictures import _digits, _house_look, _mark_points, _panels
from jaxgear.study._results import BODIES


@_house_look()
def sliding(
    data: Mapping[str, np.ndarray],
    dataset: xr.Dataset,
    static: Mapping[str, Any],
    title: str,
    *,
    pinion_speed: float | None = None,
) -> Figure:
    """Specific sliding of both flanks, and the speed of sliding over that of the pitch line.

    **Arguments:**

    - `data`: from `sliding_columns`.
    - `dataset`: from `static_dataset`: where A to E are.
    - `static`: of the summary: efficiency and coefficient of friction.
    - `title`: the case.
    - `pinion_speed`: at which the largest speed of sliding is told [rad/s].

    **Returns:**

    The figure.
    """
    figure, (specific, speed) = _panels((9.6, 4.2), f"Sliding on the path of contact: {title}", 2)
    for gear, colour in zip(BODIES, (_BLUE, _ORANGE), strict=True):
        values = data[f"specific_sliding_{gear}"]
        least = _digits(float(np.min(values)), 3)
        specific.plot(data["roll_mm"], values, color=colour, label=f"{gear}: lowest {least}")
    specific.set(ylabel="specific sliding ζ [-]")
    specific.set_title("sliding over rolling speed of each flank", loc="left")
    specific.legend(loc="lower center")
    (line,) = speed.plot(data["roll_mm"], data["sliding_over_pitch_line_speed"], color=_GREEN)
    if pinion_speed:
        most = pinion_speed * mm * np.max(np.abs(data["sliding_speed_per_pinion_speed_mm"]))
        line.set_label(f"at most {_digits(float(most), 3)} m/s at {pinion_speed:.5g} rad/s")
        speed.legend(loc="lower right")
    speed.set(ylabel="sliding over pitch line speed K_g [-]")
    share, friction = 100.0 * (1.0 - static["mesh_efficiency"]), static["friction_coefficient"]
    words = f"{_digits(share, 3)} % of the power is lost with a friction of {friction:g}"
    speed.set_title(words, loc="left")
    for axes in (specific, speed):
        low, high = axes.get_ylim()
        # Room for the letters of the points.
        axes.set_ylim(low, high + 0.08 * (high - low))
        axes.axhline(0.0, color=_GREY, lw=0.8)
        axes.set_xlabel("roll length from the pinion's base tangent point [mm]")
        _mark_points(axes, dataset["path_point_roll_mm"])
    return figure
