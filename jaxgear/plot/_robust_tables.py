"""The data of the pictures of robust searches, as columns with units."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from jaxgear.plot._palette import _BLUE, _ORANGE
from jaxgear.plot._search_tables import with_unit
from jaxgear.plot._tables import Columns, _unrolled, joined

_DESIGNS = (("nominal", _ORANGE, "--"), ("robust", _BLUE, "-"))


def robust_columns(values: Mapping[str, np.ndarray], unit: str) -> Columns:
    """The data of `robust`: the values in rising order, of one design after the other."""
    return joined(
        [
            {
                "design": np.full(len(values[name]), name),
                with_unit("response", unit): np.sort(values[name]),
            }
            for name, _, _ in _DESIGNS
        ]
    )


def robust_errors_columns(datasets: Mapping[str, xr.Dataset]) -> Columns:
    """The data of `robust`: transmission errors over phase, of one design after the other."""
    parts = []
    for name, _, _ in _DESIGNS:
        own = datasets[name]["phase"].values
        phase, error = _unrolled(own, datasets[name]["transmission_error_um"].values)
        design = np.full(len(phase), name)
        parts.append({"design": design, "phase": phase, "transmission_error_um": error})
    return joined(parts)


def tornado_columns(
    names: Sequence[str],
    reach: Sequence[str],
    ends: Mapping[str, tuple[float, np.ndarray, np.ndarray]],
    unit: str,
) -> Columns:
    """The data of `tornado`."""
    columns: Columns = {"quantity": np.asarray(names), "moved": np.asarray(reach)}
    for name, _, _ in _DESIGNS:
        middle, low, high = ends[name]
        columns |= {
            with_unit(f"{name}_less", unit): low,
            with_unit(f"{name}_without_deviations", unit): np.full(len(low), middle),
            with_unit(f"{name}_more", unit): high,
        }
    return columns
