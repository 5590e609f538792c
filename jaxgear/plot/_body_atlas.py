"""Pictures of condensed bodies: the grid, free natural frequencies, mode shapes."""

from collections.abc import Iterator
from functools import partial

import numpy as np
import xarray as xr

from jaxgear.plot._picture import Columns, Datasets, Picture
from jaxgear.plot._plots import body_pictures


def body_atlas(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `pinion_body` and `wheel_body`."""
    for gear in ("pinion", "wheel"):
        if (body := datasets.get(f"{gear}_body")) is None:
            continue
        draw = partial(body_pictures.families, body)
        yield Picture(f"{gear}_families", draw, modes_columns(body))
        if "face" in body:
            r, z = body["section_mm"].values.reshape(-1, 2).T
            element = np.repeat(np.arange(body.sizes["element"]), body.sizes["corner"])
            table = {"element": element, "r_mm": r, "z_mm": z}
            yield Picture(f"{gear}_grid", partial(body_pictures.grid, body), table)
            shown = modes_columns(body.isel(mode=body["shown"].values - 1))
            yield Picture(f"{gear}_modes", partial(body_pictures.mode_shapes, body), shown)


def modes_columns(body: xr.Dataset) -> Columns:
    """A row for each free mode of a body."""
    names = {
        "mode": "mode",
        "frequency_Hz": "frequency_Hz",
        "nodal_diameter": "nodal_diameter",
        "nodal_circle": "nodal_circle",
        "kind": "kind",
        "family": "family",
        "share_of_nodal_diameter": "nodal_diameter_share",
    }
    return {column: body[name].values for column, name in names.items() if name in body}
