"""The data of the pictures of robust searches, as columns with units."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from jaxgear._app._palette import _BLUE, _ORANGE
from jaxgear._app._tables import Columns, _unrolled

_DESIGNS = (("nominal", _ORANGE, "--"), ("robust", _BLUE, "-"))


def robust_columns(
    values: Mapping[str, np.ndarray], datasets: Mapping[str, xr.Dataset], unit: str
) -> Columns:
    """The data of `robust`: values in rising order, and transmission errors over phase."""
    ending = "" if unit == "-" else f"_{unit}"
    columns: Columns = {}
    for name, _, _ in _DESIGNS:
        columns[f"{name}{ending}"] = np.sort(values[name])
    for name, _, _ in _DESIGNS:
        own = datasets[name]["phase"].values
        phase, error = _unrolled(own, datasets[name]["transmission_error_um"].values)
        columns |= {f"phase_{name}": phase, f"transmission_error_{name}_um": error}
    return columns


def tornado_columns(
    names: Sequence[str],
    reach: Sequence[str],
    ends: Mapping[str, tuple[float, np.ndarray, np.ndarray]],
    unit: str,
) -> Columns:
    """The data of `tornado`."""
    ending = "" if unit == "-" else f"_{unit}"
    columns: Columns = {"quantity": np.asarray(names), "moved": np.asarray(reach)}
    for name, _, _ in _DESIGNS:
        middle, low, high = ends[name]
        columns |= {
            f"{name}_less{ending}": low,
            f"{name}_without_deviations{ending}": np.full(len(low), middle),
            f"{name}_more{ending}": high,
        }
    return columns
