"""Pictures of natural modes, and their tables."""

import itertools
from collections.abc import Iterator

import numpy as np
import xarray as xr

from jaxgear._columns import Table
from jaxgear.plot._picture import GEARS, Datasets, Picture, columns, drawn

_DIRECTIONS = {1: "forward", -1: "backward", 0: "none", 2: "both"}
_CRITICAL = (
    *("pinion_speed_rad_s", "wheel_speed_rad_s", "harmonic", "mode", "gear", "nodal_diameter"),
    *("direction", "frequency_space_Hz", "frequency_body_Hz", "mesh_energy"),
)
_ALONE = (
    *("nodal_diameter", "frequency_alone_Hz", "frequency_in_mesh_Hz", "mode_in_mesh"),
    "likeness",
)
_PLACE = ("mode", "pinion_speed_rad_s")


def pictures_of_modes(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `modes`, `campbell`, `critical` and `alone_GEAR`."""
    if (found := datasets.get("modes")) is not None:
        yield Picture("modes", drawn("_mode_pictures.modes", found), _modes_columns(found))
    turning, critical = datasets.get("campbell"), datasets.get("critical")
    if turning is None or "harmonics" not in turning.attrs:
        return
    table = turning.rename(speed="pinion_speed_rad_s")
    if critical is None:
        crossings = _crossing_columns(turning)
        draw = drawn("_mode_pictures.campbell", turning, crossings)
        curves = columns(table, *_PLACE, "frequency_Hz")
        yield Picture("campbell", draw, curves, {"critical": crossings})
        return
    draw = drawn("_campbell_pictures.campbell", turning, critical)
    words = table.assign(
        gear=table["gear"].copy(data=np.asarray(GEARS)[table["gear"].values]),
        direction=table["direction"].copy(
            data=np.vectorize(_DIRECTIONS.__getitem__)(table["direction"].values)
        ),
    )
    curves = columns(words, *_PLACE, "frequency_Hz", "nodal_diameter", "gear", "direction")
    yield Picture("campbell", draw, curves, {"critical": columns(critical, *_CRITICAL)})
    for index, gear in enumerate(GEARS):
        if (alone := datasets.get(f"alone_{gear}")) is None:
            continue
        own = turning.assign(
            frequency_body_Hz=turning["frequency_body_Hz"].where(turning["gear"] == index)
        )
        leads = (critical["gear"] == gear) & np.isfinite(critical["frequency_body_Hz"])
        mine = critical.isel(crossing=leads)
        draw = drawn("_campbell_pictures.campbell_on_body", own, mine, gear)
        curves = columns(own.rename(speed="pinion_speed_rad_s"), *_PLACE, "frequency_body_Hz")
        curves = curves.known("frequency_body_Hz")
        yield Picture(f"campbell_{gear}", draw, curves, {"critical": columns(mine, *_CRITICAL)})
        draw = drawn("_campbell_pictures.alone", alone, gear)
        yield Picture(f"modes_{gear}_alone", draw, columns(alone, *_ALONE))


def _modes_columns(dataset: xr.Dataset) -> Table:
    """One row per mode, the energy of each part in a column of its own."""
    shares = {
        f"energy_{part}": dataset["energy"].sel(part=part, drop=True)
        for part in dataset["part"].values
    }
    waves = [name for name in ("gear", "nodal_diameter", "wave_share") if name in dataset]
    return columns(dataset.assign(shares), "mode", "frequency_Hz", *waves, *shares, "damping_ratio")


def _crossing_columns(dataset: xr.Dataset) -> Table:
    """A row for each crossing of a mode, of gears without waves, with a harmonic of the mesh.

    Straight lines join the speeds of the dataset.
    """
    speed = dataset["speed"].values
    teeth, harmonics = (int(dataset.attrs[name]) for name in ("teeth_pinion", "harmonics"))
    names = [name for name in ("frequency_Hz", "mesh_energy") if name in dataset]
    values = [dataset[name].transpose("speed", "mode").values for name in names]
    found: list[tuple[float, ...]] = []
    for mode, harmonic in itertools.product(range(dataset.sizes["mode"]), range(1, harmonics + 1)):
        mesh = harmonic * teeth * speed / (2.0 * np.pi)
        for at in _crossings(speed, values[0][:, mode] - mesh):
            own = (float(np.interp(at, speed, each[:, mode])) for each in values)
            found.append((mode + 1, harmonic, at, *own))
    names = ["mode", "harmonic", "pinion_speed_rad_s", *names]
    rows = np.reshape(np.asarray(found), (-1, len(names)))
    return Table(dict(zip(names, rows.T, strict=True)))


def _crossings(speed: np.ndarray, apart: np.ndarray) -> list[float]:
    """Speeds at which a sampled difference vanishes, straight lines between the samples."""
    found = [float(x) for x in speed[(apart == 0.0) & (speed > 0.0)]]
    for left in np.nonzero(apart[1:] * apart[:-1] < 0.0)[0]:
        share = apart[left] / (apart[left] - apart[left + 1])
        found.append(float(speed[left] + share * (speed[left + 1] - speed[left])))
    return found
