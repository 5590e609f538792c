"""The data of the pictures of Master Curves, as columns with units."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


def family_columns(curves: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """The data of `family`, one torque under the other."""
    names = ("extent", "depth_um", "te_rms_um", "te_rms_per_depth", "closed_form_depth_um")
    joined = {name: np.concatenate([np.asarray(each[name]) for each in curves]) for name in names}
    torque = [np.full(len(each["extent"]), each["torque_Nm"]) for each in curves]
    return {"torque_Nm": np.concatenate(torque)} | joined
