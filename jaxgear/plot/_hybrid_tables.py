"""What the pictures of hybrid models show, as columns with units."""

import numpy as np
import xarray as xr

from jaxgear._columns import Table
from jaxgear.plot._cycle import cycle_periods
from jaxgear.plot._picture import columns

# Phases shown side by side.
_SHOWN = 6


def contact_line_loads(dataset: xr.Dataset) -> xr.Dataset:
    """The line loads at the phases that are drawn, of the lines that carry any."""
    every = dataset["line_load_N_mm"].values
    # In equal steps through the mesh period of the largest load, which is among them.
    each = len(every) // cycle_periods(dataset["phase"].values)
    worst = int(np.argmax(every.max(axis=(1, 2))))
    steps = np.rint(np.arange(_SHOWN) * each / _SHOWN).astype(int)
    phases = np.sort(each * (worst // each) + (worst % each + steps) % each)
    lines = np.flatnonzero(every[phases].max(axis=(0, 2)) > 0.0)
    return dataset[["line_load_N_mm"]].isel(phase=phases, line=lines)


def tooth_way_columns(dataset: xr.Dataset) -> Table:
    """One tooth pair's way, one row per place."""
    names = {"passage": "way_passage", "share_of_mesh_force": "way_share"}
    names |= {"face_position_mm": "face_position_mm"}
    loads = {name: f"way_{name}" for name in ("line_load_N_mm", "pressure_MPa")}
    return columns(dataset, **names, **loads)


def tooth_loads_columns(dataset: xr.Dataset, gear: str) -> Table:
    """What each tooth of a gear carries, in the order of their places on it."""
    return columns(
        dataset.sortby(f"{gear}_tooth_angle_deg"),
        tooth_pair="tooth_pair",
        tooth_angle_deg=f"{gear}_tooth_angle_deg",
        line_load_max_N_mm="tooth_line_load_N_mm",
        share_max="tooth_share",
        load_over_mean="tooth_load_over_mean",
        above_a_hole=f"{gear}_tooth_above_a_hole",
    )
