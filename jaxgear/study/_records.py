"""Tables as datasets: each row a record."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

# Values, their unit, and what they are.
Told = tuple[ArrayLike, str, str]


def records(dimension: str, columns: Mapping[str, Told], **attributes: object) -> xr.Dataset:
    """A dataset over one dimension; a single value is one for all records.

    **Arguments:**

    - `dimension`: what a record is.
    - `columns`: values, units and long names, by name.
    - `attributes`: of the dataset.
    """
    return xr.Dataset(
        {
            name: (
                (dimension,) if np.ndim(values) else (),
                np.asarray(values),
                {"units": "1" if units == "-" else units, "long_name": words},
            )
            for name, (values, units, words) in columns.items()
        },
        attrs=attributes,
    )


def with_unit(name: str, unit: str) -> str:
    """The name of a variable, with its unit.

    **Arguments:**

    - `name`: of the quantity.
    - `unit`: as it stands in names; `-` where there is none.
    """
    return name if unit == "-" else f"{name}_{unit}"
