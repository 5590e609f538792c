"""What is written of condensed bodies' modes: the data of their Campbell diagrams."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import xarray as xr

from jaxgear._app._dynamic_tables import _finite_columns
from jaxgear._app._folder import Folder
from jaxgear._app._plots import campbell_pictures
from jaxgear._app._saving import save
from jaxgear._app._schema import GEARS
from jaxgear._app._tables import Columns
from jaxgear._app._turning import DIRECTIONS, BodyWaves, alone_rows
from jaxgear._dynamics._campbell import CriticalSpeed


def draw(folder: Folder, title: str, dataset: xr.Dataset, waves: BodyWaves) -> None:
    """Draw all pictures of condensed bodies' modes.

    **Arguments:**

    - `folder`: where to.
    - `title`: the case.
    - `dataset`: from `turning_dataset`.
    - `waves`: that it was made of.
    """
    critical = waves.critical
    figure = partial(campbell_pictures.campbell, dataset, critical, title)
    save(figure, campbell_columns(dataset, critical), folder, "campbell")
    for gear in waves.alone:
        words = f"{title}, seen from the {gear}"
        figure = partial(campbell_pictures.campbell_on_body, dataset, critical, words, gear)
        columns = campbell_on_body_columns(dataset, critical, gear)
        save(figure, columns, folder, f"campbell_{gear}")
        rows = alone_rows(waves, gear)
        figure = partial(campbell_pictures.alone, rows, gear, title)
        save(figure, _finite_columns(rows), folder, f"modes_{gear}_alone")


def campbell_columns(dataset: xr.Dataset, critical: Sequence[CriticalSpeed]) -> Columns:
    """The data of `campbell`: one row per speed, then one row for each crossing."""
    columns: Columns = {"pinion_speed_rad_s": dataset["speed"].values}
    for mode in range(dataset.sizes["mode"]):
        own = dataset.isel(mode=mode)
        columns[f"frequency_mode_{mode + 1}_Hz"] = own["frequency_Hz"].values
        columns[f"nodal_diameter_mode_{mode + 1}"] = own["nodal_diameter"].values
        columns[f"direction_mode_{mode + 1}"] = own["direction"].values
    return _finite_columns(columns | _critical_columns(dataset, critical))


def _critical_columns(dataset: xr.Dataset, critical: Sequence[CriticalSpeed]) -> Columns:
    ratio = dataset.attrs["teeth_pinion"] / dataset.attrs["teeth_wheel"]
    speed = np.array([each.speed for each in critical])
    return {
        "critical_pinion_speed_rad_s": speed,
        "critical_wheel_speed_rad_s": ratio * speed,
        "critical_harmonic": np.array([each.harmonic for each in critical]),
        "critical_mode": np.array([each.mode + 1 for each in critical]),
        "critical_gear": np.array([GEARS[each.gear] for each in critical]),
        "critical_nodal_diameter": np.array([each.diameters for each in critical]),
        "critical_direction": np.array([DIRECTIONS[each.direction] for each in critical]),
        "critical_frequency_space_Hz": np.array([each.space for each in critical]),
        "critical_frequency_body_Hz": np.array([each.body for each in critical]),
        "critical_mesh_energy": np.array([each.mesh for each in critical]),
    }


def campbell_on_body_columns(
    dataset: xr.Dataset, critical: Sequence[CriticalSpeed], gear: str
) -> Columns:
    """The data of `campbell_on_body`: one row per speed, then one row for each crossing."""
    columns: Columns = {"pinion_speed_rad_s": dataset["speed"].values}
    for mode, own in enumerate(_on_body(dataset, gear).T, start=1):
        if np.isfinite(own).any():
            columns[f"frequency_body_mode_{mode}_Hz"] = own
    rows = [each for each in critical if GEARS[each.gear] == gear and np.isfinite(each.body)]
    return _finite_columns(columns | _critical_columns(dataset, rows))


def _on_body(dataset: xr.Dataset, gear: str) -> np.ndarray:
    own = dataset["gear"].values == GEARS.index(gear)
    return np.where(own, dataset["frequency_body_Hz"].values, np.nan)
