"""Pictures of a sweep, and their tables."""

from collections.abc import Iterator
from functools import partial

import numpy as np
import xarray as xr

from jaxgear._response._sweep_features import WAYS, fold_places
from jaxgear.plot._cycle import phase_shares
from jaxgear.plot._picture import Columns, Datasets, Picture, columns
from jaxgear.plot._plots import contact_pictures, order_pictures, sweep_pictures

# What is smaller than this share of the static force is rounding: the teeth are apart.
_NO_FORCE = 1e-9


def pictures_of_sweep(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `sweep` and `orbit`.

    Those of one direction show the one with the highest peak.
    """
    if (found := datasets.get("sweep")) is None:
        return
    critical = list(_critical(found))
    shown = found.rename(speed="pinion_speed_rad_s")
    shown["periods"] = shown["periods"].where(shown["periods"] != found.attrs["mesh_periods"], 1)
    beside = {"critical": _critical_columns(critical)}
    if "curve_speed" in found:
        beside |= {"curve": _curve_columns(found), "folds": _fold_columns(found)}
    names = ("direction", "pinion_speed_rad_s", "dynamic_ratio", "te_rms_um", "contact_loss")
    table = columns(shown, *names, "settled", "stable", "periods")
    yield Picture("sweep", partial(sweep_pictures.sweep, found, critical), table, beside)
    way = found.attrs["peak_direction"]
    words = f", {WAYS[way]}" if found.sizes["direction"] > 1 else ""
    own = found.sel(direction=way).assign_attrs(title=found.attrs["title"] + words)
    table = shown.sel(direction=way)
    yield from _pictures_of_orders(own, table)
    share = _share_without_contact(own)
    surface = columns(table, "pinion_speed_rad_s", "phase", "mesh_force_ratio", "tooth_pairs")
    shares = {"pinion_speed_rad_s": own["speed"].values, "contact_loss": share}
    draw = partial(contact_pictures.contact_loss, own, share)
    yield Picture("contact_loss", draw, surface, {"shares": shares})
    if (orbit := datasets.get("orbit")) is not None:
        yield Picture("orbit", partial(contact_pictures.orbit, orbit), _orbit_columns(orbit))


def _pictures_of_orders(own: xr.Dataset, table: xr.Dataset) -> Iterator[Picture]:
    place = ("pinion_speed_rad_s", "order")
    mesh = table["order"] * float(table.attrs["teeth_pinion"]) / (2.0 * np.pi)
    spectrum = table.assign(frequency_Hz=mesh * table["pinion_speed_rad_s"])
    rays = columns(spectrum, *place, "frequency_Hz", "te_order_um")
    yield Picture("waterfall", partial(order_pictures.waterfall, own), rays)
    lines = columns(table, *place, "te_order_um", "mesh_force_order_N")
    beside = {}
    if "bearing" in table:
        beside["bearings"] = columns(table, "bearing", *place, "bearing_force_order_N")
    yield Picture("orders", partial(order_pictures.orders, own), lines, beside)


def _critical(dataset: xr.Dataset) -> Iterator[tuple[float, str]]:
    """Speeds [rad/s] at which harmonics of the mesh excite the modes that it shakes most."""
    teeth = dataset.attrs["teeth_pinion"]
    for number, own in zip(
        dataset["excited_mode"].values, dataset["excited_frequency_Hz"].values, strict=True
    ):
        for harmonic in (1, 2, 3):
            name = f"mode {number}" if harmonic == 1 else f"mode {number} / {harmonic}"
            yield float(2.0 * np.pi * own / (teeth * harmonic)), name


def _critical_columns(critical: list[tuple[float, str]]) -> Columns:
    speed, label = zip(*critical, strict=True)
    return {"pinion_speed_rad_s": np.asarray(speed), "label": np.asarray(label)}


def _curve_columns(dataset: xr.Dataset) -> Columns:
    """A row for each point of the continuation curve, piece by piece."""
    names = ("piece", "dynamic_ratio", "te_rms_um", "stable")
    own = dataset.drop_dims(["direction", "speed"])
    own = own.rename({f"curve_{name}": name for name in names})
    own = own.rename(curve_speed="pinion_speed_rad_s")
    return columns(own, "piece", "pinion_speed_rad_s", *names[1:])


def _fold_columns(dataset: xr.Dataset) -> Columns:
    """A row for each fold of the continuation curve."""
    folds = fold_places(dataset["curve_speed"].values, dataset["curve_piece"].values)
    own = _curve_columns(dataset)
    return {name: own[name][folds] for name in ("pinion_speed_rad_s", "dynamic_ratio")}


def _share_without_contact(dataset: xr.Dataset) -> np.ndarray:
    """Share of the time in which the teeth are apart, over speed."""
    return (dataset["mesh_force_ratio"].values <= _NO_FORCE) @ phase_shares(dataset["phase"].values)


def _orbit_columns(dataset: xr.Dataset) -> Columns:
    """A row for each step, of one branch after the other, as long as it lasts."""
    names = ("branch", "phase", "mesh_force_ratio", "te_um", "te_rate_mm_s", "te_static_um")
    table = columns(dataset, *names)
    lasts = np.isfinite(table["te_um"])
    return {name: values[lasts] for name, values in table.items()}
