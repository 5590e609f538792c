"""Pictures of the Master Curve as it was traced."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from jaxgear._app._pictures import _BLUE, _GREEN, _ORANGE, _house_look, _panels


@_house_look()
def traced_curve(traced: Mapping[str, np.ndarray], title: str) -> Figure:
    """The best depth over the extent, what is left there, and how much an error of depth costs.

    **Arguments:**

    - `traced`: part of the summary: extents, depths, RMS, and RMS per error of depth.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (left, middle, right) = _panels((11.0, 4.0), title, columns=3)
    extent, depth = traced["extent"], traced["depth_um"]
    left.plot(extent, depth, color=_BLUE, label="computed")
    left.plot(extent, traced["closed_form_depth_um"], "--", color=_ORANGE, label="closed form")
    if depth.size:
        left.set_ylim(0.0, 1.4 * float(np.max(depth)))
    left.set(ylabel="best depth of the tip relief [µm]")
    left.legend(loc="best")
    middle.plot(extent, traced["te_rms_um"], color=_BLUE)
    middle.set(ylabel="RMS of the transmission error there [µm]")
    middle.set_ylim(bottom=0.0)
    right.plot(extent, traced["te_rms_per_depth"], color=_GREEN)
    right.set(ylabel="RMS over error of depth [µm/µm]")
    right.set_ylim(bottom=0.0)
    for axes in (left, middle, right):
        axes.set(xlabel="extent over the path of contact [-]")
    return figure
