"""What is written of condensed bodies' modes: the data of their Campbell diagrams."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import xarray as xr

from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._dynamics._campbell import CriticalSpeed
from jaxgear.plot._dynamic_tables import over_modes
from jaxgear.plot._plots import campbell_pictures
from jaxgear.plot._tables import Columns
from jaxgear.scene._schema import GEARS
from jaxgear.study._turning import DIRECTIONS, BodyWaves, alone_rows


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
    rows = critical_columns(dataset, critical)
    save(figure, campbell_columns(dataset), folder, "campbell", critical=rows)
    for gear in waves.alone:
        words = f"{title}, seen from the {gear}"
        figure = partial(campbell_pictures.campbell_on_body, dataset, critical, words, gear)
        columns = campbell_on_body_columns(dataset, gear)
        own = [each for each in critical if GEARS[each.gear] == gear and np.isfinite(each.body)]
        rows = critical_columns(dataset, own)
        save(figure, columns, folder, f"campbell_{gear}", critical=rows)
        rows = alone_rows(waves, gear)
        figure = partial(campbell_pictures.alone, rows, gear, title)
        save(figure, rows, folder, f"modes_{gear}_alone")


def campbell_columns(dataset: xr.Dataset) -> Columns:
    """The data of `campbell`, one row per speed, of one mode after the other."""
    named = {
        "gear": np.asarray(GEARS)[dataset["gear"].values],
        "direction": np.vectorize(DIRECTIONS.__getitem__)(dataset["direction"].values),
    }
    names = ("frequency_Hz", "nodal_diameter")
    return over_modes(dataset, {name: dataset[name].values for name in names} | named)


def critical_columns(dataset: xr.Dataset, critical: Sequence[CriticalSpeed]) -> Columns:
    """The data of `campbell` and `campbell_on_body`, a row for each critical speed."""
    ratio = dataset.attrs["teeth_pinion"] / dataset.attrs["teeth_wheel"]
    speed = np.array([each.speed for each in critical])
    return {
        "pinion_speed_rad_s": speed,
        "wheel_speed_rad_s": ratio * speed,
        "harmonic": np.array([each.harmonic for each in critical]),
        "mode": np.array([each.mode + 1 for each in critical]),
        "gear": np.array([GEARS[each.gear] for each in critical]),
        "nodal_diameter": np.array([each.diameters for each in critical]),
        "direction": np.array([DIRECTIONS[each.direction] for each in critical]),
        "frequency_space_Hz": np.array([each.space for each in critical]),
        "frequency_body_Hz": np.array([each.body for each in critical]),
        "mesh_energy": np.array([each.mesh for each in critical]),
    }


def campbell_on_body_columns(dataset: xr.Dataset, gear: str) -> Columns:
    """The data of `campbell_on_body`: where a mode is one of the gear's, its frequency there."""
    columns = over_modes(dataset, {"frequency_body_Hz": _on_body(dataset, gear)})
    known = np.isfinite(columns["frequency_body_Hz"])
    return {name: values[known] for name, values in columns.items()}


def _on_body(dataset: xr.Dataset, gear: str) -> np.ndarray:
    own = dataset["gear"].values == GEARS.index(gear)
    return np.where(own, dataset["frequency_body_Hz"].values, np.nan)
