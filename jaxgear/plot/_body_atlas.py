"""Pictures of condensed bodies: the grid, free natural frequencies, mode shapes."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from jaxgear._columns import Table
from jaxgear.plot._picture import GEARS, Datasets, Picture, columns, drawn

_MODES = ("mode", "frequency_Hz", "nodal_diameter", "nodal_circle", "kind", "family")


def body_atlas(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `pinion_body` and `wheel_body`."""
    for gear in GEARS:
        if (body := datasets.get(f"{gear}_body")) is None:
            continue
        draw = drawn("_body_pictures.families", body)
        yield Picture(f"{gear}_families", draw, _modes_columns(body))
        if "face" in body:
            r, z = body["section_mm"].values.reshape(-1, 2).T
            element = np.repeat(np.arange(body.sizes["element"]), body.sizes["corner"])
            table = Table({"element": element, "r_mm": r, "z_mm": z})
            yield Picture(f"{gear}_grid", drawn("_body_pictures.grid", body), table)
            shown = _modes_columns(body.isel(mode=body["shown"].values - 1))
            yield Picture(f"{gear}_modes", drawn("_body_pictures.mode_shapes", body), shown)


def _modes_columns(body: xr.Dataset) -> Table:
    """A row for each free mode of a body."""
    names = [name for name in _MODES if name in body]
    return columns(body, *names, share_of_nodal_diameter="nodal_diameter_share")
