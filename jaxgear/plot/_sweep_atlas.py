"""Pictures of a sweep, and their tables."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from jaxgear._columns import Table
from jaxgear._response._sweep_features import WAYS, fold_places
from jaxgear.plot._cycle import NO_FORCE, phase_shares
from jaxgear.plot._picture import Datasets, Picture, columns, drawn


def pictures_of_sweep(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `sweep` and `orbit`.

    Those of one direction show the one with the highest peak.
    """
    if (found := datasets.get("sweep")) is None:
        return
    critical = list(_critical(found))
    shown = found.rename(speed="pinion_speed_rad_s")
    shown["periods"] = shown["periods"].where(shown["periods"] != found.attrs["mesh_periods"], 1)
    speeds, labels = map(np.asarray, zip(*critical, strict=True))
    beside: dict[str, Table] = {"critical": Table({"pinion_speed_rad_s": speeds, "label": labels})}
    if "curve_speed" in found:
        names = {"piece": "curve_piece", "pinion_speed_rad_s": "curve_speed"}
        names |= {name: f"curve_{name}" for name in ("dynamic_ratio", "te_rms_um", "stable")}
        curve = columns(found.drop_dims(["direction", "speed"]), **names)
        folds = fold_places(found["curve_speed"].values, found["curve_piece"].values)
        beside["curve"] = curve
        turns = ("pinion_speed_rad_s", "dynamic_ratio")
        beside["folds"] = Table({name: curve[name] for name in turns}).rows(folds)
    names = ("direction", "pinion_speed_rad_s", "dynamic_ratio", "te_rms_um", "contact_loss")
    table = columns(shown, *names, "settled", "stable", "periods")
    yield Picture("sweep", drawn("_sweep_pictures.sweep", found, critical), table, beside)
    way = found.attrs["peak_direction"]
    words = f", {WAYS[way]}" if found.sizes["direction"] > 1 else ""
    own = found.sel(direction=way).assign_attrs(title=found.attrs["title"] + words)
    table = shown.sel(direction=way)
    if "root_stress_MPa" in found:
        names = ("direction", "pinion_speed_rad_s", "gear", "root_stress_MPa")
        roots = columns(shown, *names, "root_compression_MPa", "settled")
        draw = drawn("_root_pictures.root_stress_at_speed", found)
        yield Picture("root_stress_at_speed", draw, roots)
    yield from _pictures_of_orders(own, table)
    share = (own["mesh_force_ratio"].values <= NO_FORCE) @ phase_shares(own["phase"].values)
    surface = columns(table, "pinion_speed_rad_s", "phase", "mesh_force_ratio", "tooth_pairs")
    shares = Table({"pinion_speed_rad_s": own["speed"].values, "contact_loss": share})
    draw = drawn("_contact_pictures.contact_loss", own, share)
    yield Picture("contact_loss", draw, surface, {"shares": shares})
    if (orbit := datasets.get("orbit")) is not None:
        # A row for each step, of one branch after the other, as long as it lasts.
        names = ("branch", "phase", "mesh_force_ratio", "te_um", "te_rate_mm_s", "te_static_um")
        table = columns(orbit, *names).known("te_um")
        yield Picture("orbit", drawn("_contact_pictures.orbit", orbit), table)


def pictures_of_unbalance(datasets: Datasets) -> Iterator[Picture]:
    """The picture of the group `unbalance`."""
    if (dataset := datasets.get("unbalance")) is None:
        return
    shown = dataset.rename(speed="pinion_speed_rad_s")
    place = ("gear", "pinion_speed_rad_s")
    amplitudes = ("unbalance_frequency_Hz", "unbalance_te_um", "unbalance_mesh_force_N")
    beside = {
        "bearings": columns(shown, *place, "bearing", "unbalance_bearing_force_N"),
        "critical": columns(dataset, "critical_speed_rad_s", gear="critical_gear"),
    }
    draw = drawn("_unbalance_pictures.unbalance", dataset)
    yield Picture("unbalance", draw, columns(shown, *place, *amplitudes), beside)


def _pictures_of_orders(own: xr.Dataset, table: xr.Dataset) -> Iterator[Picture]:
    place = ("pinion_speed_rad_s", "order")
    mesh = table["order"] * float(table.attrs["teeth_pinion"]) / (2.0 * np.pi)
    spectrum = table.assign(frequency_Hz=mesh * table["pinion_speed_rad_s"])
    rays = columns(spectrum, *place, "frequency_Hz", "te_order_um")
    yield Picture("waterfall", drawn("_order_pictures.waterfall", own), rays)
    lines = columns(table, *place, "te_order_um", "mesh_force_order_N")
    beside = {}
    if "bearing" in table:
        beside["bearings"] = columns(table, "bearing", *place, "bearing_force_order_N")
    yield Picture("orders", drawn("_order_pictures.orders", own), lines, beside)


def _critical(dataset: xr.Dataset) -> Iterator[tuple[float, str]]:
    """Speeds [rad/s] at which harmonics of the mesh excite the modes that it shakes most."""
    teeth = dataset.attrs["teeth_pinion"]
    modes = zip(dataset["excited_mode"].values, dataset["excited_frequency_Hz"].values, strict=True)
    for number, own in modes:
        for harmonic in (1, 2, 3):
            name = f"mode {number}" if harmonic == 1 else f"mode {number} / {harmonic}"
            yield float(2.0 * np.pi * own / (teeth * harmonic)), name
