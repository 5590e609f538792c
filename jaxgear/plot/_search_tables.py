"""The data of the pictures of searches and of the map of tip relief, as columns with units."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from jaxgear._units import um
from jaxgear.plot._tables import Columns, _unrolled, joined


def smoothing_bias_columns(
    width_um: np.ndarray,
    mean_bias_um: np.ndarray,
    rms_bias_relative: np.ndarray,
    *,
    gradient_bias_relative: np.ndarray | None = None,
) -> Columns:
    """The data of `smoothing_bias`."""
    columns = {
        "width_um": width_um,
        "te_mean_bias_um": mean_bias_um,
        "te_rms_bias_relative": rms_bias_relative,
    }
    if gradient_bias_relative is not None:
        columns["gradient_bias_relative"] = gradient_bias_relative
    return columns


def master_curve_columns(chart: Any) -> Columns:
    """The data of `master_curve`, one row per place on the map."""
    depth, extent = np.meshgrid(chart.depth / um, chart.extent, indexing="ij")
    return {
        "depth_um": depth.ravel(),
        "extent": extent.ravel(),
        "te_rms_um": chart.value.ravel(),
    }


def valley_columns(chart: Any, valley: Any, closed_form_um: np.ndarray) -> Columns:
    """The data of `master_curve`, one row per extent: the best depth, and the closed form's."""
    return {
        "extent": chart.extent,
        "depth_um": valley.depth / um,
        "te_rms_um": valley.value,
        "closed_form_depth_um": closed_form_um,
    }


def search_trace_columns(values_by_method: Mapping[str, np.ndarray], unit: str) -> Columns:
    """The data of `search_trace`: each evaluation, of one method after the other."""
    return joined(
        [
            {
                "method": np.full(len(values), name),
                "evaluation": np.arange(1, len(values) + 1),
                with_unit("objective", unit): values,
            }
            for name, values in values_by_method.items()
        ]
    )


def with_unit(name: str, unit: str) -> str:
    """The name of a column, with its unit.

    **Arguments:**

    - `name`: of the quantity.
    - `unit`: as it stands in names; `-` where there is none.
    """
    return name if unit == "-" else f"{name}_{unit}"


def before_after_columns(dataset_before: xr.Dataset, dataset_after: xr.Dataset) -> Columns:
    """The data of `before_after`, of one design after the other."""
    parts = []
    for name, dataset in (("before", dataset_before), ("after", dataset_after)):
        own = dataset["phase"].values
        phase, error = _unrolled(own, dataset["transmission_error_um"].values)
        parts.append(
            {
                "design": np.full(len(phase), name),
                "phase": phase,
                "transmission_error_um": error,
                "max_pressure_MPa": _unrolled(own, _largest_pressure(dataset))[1],
            }
        )
    return joined(parts)


def _largest_pressure(dataset: xr.Dataset) -> np.ndarray:
    """Largest pressure on any line at each phase [MPa]."""
    return dataset["pressure_MPa"].max(("line", "slice")).values
