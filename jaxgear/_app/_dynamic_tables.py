"""The data of the pictures of dynamics, as columns with units."""

import itertools
from collections.abc import Sequence

import numpy as np
import xarray as xr

from jaxgear._app._tables import Columns, _shares

# What is smaller than this share of the static force is rounding: the teeth are apart.
_NO_FORCE = 1e-9


def _finite_columns(columns: Columns) -> Columns:
    """The columns with empty cells where a number is not finite."""
    found = {}
    for name, values in columns.items():
        values = np.asarray(values)
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            values = np.asarray([f"{x:.10g}" if np.isfinite(x) else "" for x in values], object)
        found[name] = values
    return found


_QUANTITIES = ("dynamic_ratio", "te_rms_um", "contact_loss")

_FLAGS = ("settled", "stable", "periods")


# A sweep of so few speeds shows each.
_FEW = 60


def sweep_columns(dataset: xr.Dataset, critical: Sequence[tuple[float, str]] = ()) -> Columns:
    """The data of `sweep`: one row per speed, then points of the curve, folds, critical speeds."""
    columns: Columns = {"pinion_speed_rad_s": dataset["speed"].values}
    for direction in dataset["direction"].values:
        own = dataset.sel(direction=direction)
        for name in (*_QUANTITIES, *_FLAGS):
            if name in own:
                columns[f"{name}_{direction}"] = own[name].values
    if "curve_speed" in dataset:
        piece, curve = _curve_points(dataset)
        columns |= {"curve_piece": piece, "curve_pinion_speed_rad_s": curve["curve_speed"]}
        columns |= {name: values for name, values in curve.items() if name != "curve_speed"}
        folds = _folds(dataset)
        columns["fold_pinion_speed_rad_s"] = dataset["curve_speed"].values[folds]
        columns["fold_dynamic_ratio"] = dataset["curve_dynamic_ratio"].values[folds]
    if critical:
        columns["critical_pinion_speed_rad_s"] = np.asarray([speed for speed, _ in critical])
        columns["critical_label"] = np.asarray([label for _, label in critical])
    return _finite_columns(columns)


_CURVE = ("curve_speed", "curve_dynamic_ratio", "curve_te_rms_um", "curve_stable")


def _curve_points(dataset: xr.Dataset) -> tuple[np.ndarray, Columns]:
    """Number of the piece of each finite point of the continuation curve, and its data."""
    finite = np.isfinite(dataset["curve_speed"].values)
    piece = np.cumsum(np.concatenate([[False], finite[1:] & ~finite[:-1]]))
    curve = {name: dataset[name].values[finite] for name in _CURVE if name in dataset}
    return piece[finite] - np.min(piece[finite], initial=np.max(piece)), curve


def _folds(dataset: xr.Dataset) -> np.ndarray:
    """Points of the continuation curve where its speed turns round."""
    ahead = np.diff(dataset["curve_speed"].values)
    return np.nonzero(ahead[1:] * ahead[:-1] < 0.0)[0] + 1


# A step between neighbouring speeds is a leap if it is this share of the axis, and so many times
# larger than the steps on either side.
_LEAP, _STANDS_OUT = 0.05, 4.0


# More arrows say no more.
_ARROWS = 6


def _leaps(values: np.ndarray, shown: np.ndarray, height: float) -> np.ndarray:
    """Places of steps to the next value that are leaps, the largest first."""
    step = np.abs(np.diff(np.where(shown, values, np.nan)))
    around = np.concatenate([[np.nan] * 2, step, [np.nan] * 2])
    beside = np.stack([around[:-4], around[1:-3], around[3:-1], around[4:]])
    usual = np.max(np.where(np.isfinite(beside), beside, 0.0), axis=0)
    known = np.count_nonzero(np.isfinite(beside), axis=0) >= 2
    found = np.nonzero(known & (step > _LEAP * height) & (step > _STANDS_OUT * usual))[0]
    return found[np.argsort(-step[found], kind="stable")][:_ARROWS]


def waterfall_columns(dataset: xr.Dataset) -> Columns:
    """The data of `waterfall`, one row per speed and order."""
    speed, order, amplitude = _orders_of(dataset, "te_order_um")
    each_speed, each_order = (x.ravel() for x in np.meshgrid(speed, order, indexing="ij"))
    frequency = each_order * float(dataset.attrs["teeth_pinion"]) * each_speed / (2.0 * np.pi)
    return _finite_columns(
        {
            "pinion_speed_rad_s": each_speed,
            "order": each_order,
            "frequency_Hz": frequency,
            "te_order_um": amplitude.ravel(),
        }
    )


def _orders_of(dataset: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Speeds, positive orders, and their finite amplitudes, rows speeds."""
    order = dataset["order"].values.astype(float)
    chosen = order > 0.0
    amplitude = dataset[name].transpose("speed", "order").values[:, chosen]
    return dataset["speed"].values, order[chosen], np.nan_to_num(amplitude, posinf=0.0)


_ORDER_PANELS = {
    "te_order_um": "amplitude of\nthe TE [µm]",
    "mesh_force_order_N": "amplitude of the\nmesh force [N]",
    "bearing_force_order_N": "amplitude of bearing\nforces [N]",
}


def orders_columns(dataset: xr.Dataset) -> Columns:
    """The data of `orders`, one row per speed."""
    columns: Columns = {"pinion_speed_rad_s": dataset["speed"].values}
    for name in _ORDER_PANELS:
        if name not in dataset:
            continue
        quantity, unit = name.rsplit("_", 1)
        each = [("", dataset)]
        if name == "bearing_force_order_N":
            each = [
                (f"_{str(bearing).replace(' ', '_')}", dataset.isel(bearing=row))
                for row, bearing in enumerate(_bearing_names(dataset))
            ]
        for ending, own in each:
            _, order, amplitude = _orders_of(own, name)
            for value, column in zip(order, amplitude.T, strict=True):
                columns[f"{quantity}_{value:g}{ending}_{unit}"] = column
    return _finite_columns(columns)


def _bearing_names(dataset: xr.Dataset) -> list[str]:
    """The bearings' names, or their numbers where they have none."""
    if "bearing_force_order_N" not in dataset:
        return []
    return [str(x) for x in dataset["bearing"].values]


def contact_loss_columns(dataset: xr.Dataset) -> Columns:
    """The data of `contact_loss`: one row per speed and phase, then the share of each speed."""
    speed, phase = dataset["speed"].values, dataset["phase"].values
    each_speed, each_phase = (x.ravel() for x in np.meshgrid(speed, phase, indexing="ij"))
    columns: Columns = {"pinion_speed_rad_s": each_speed, "phase": each_phase}
    for name in ("mesh_force_ratio", "tooth_pairs"):
        if name in dataset:
            columns[name] = dataset[name].transpose("speed", "phase").values.ravel()
    force = dataset["mesh_force_ratio"].transpose("speed", "phase").values
    share = (force <= _NO_FORCE) @ _shares(phase) if len(phase) > 1 else force[:, 0] <= _NO_FORCE
    columns |= {"share_pinion_speed_rad_s": speed, "contact_loss": share}
    return _finite_columns(columns)


def modes_columns(dataset: xr.Dataset) -> Columns:
    """The data of `modes`, one row per mode."""
    columns: Columns = {
        "mode": np.arange(1, dataset.sizes["mode"] + 1),
        "frequency_Hz": dataset["frequency_Hz"].values,
    }
    for name in ("gear", "nodal_diameter", "wave_share"):
        if name in dataset:
            columns[name] = dataset[name].values
    for part in dataset["part"].values:
        columns[f"energy_{part}"] = dataset["energy"].sel(part=part).values
    if "damping_ratio" in dataset:
        columns["damping_ratio"] = dataset["damping_ratio"].values
    return _finite_columns(columns)


def campbell_columns(dataset: xr.Dataset, *, harmonics: int = 4) -> Columns:
    """The data of `campbell`: frequencies, one row per speed, then one row for each crossing."""
    speed, teeth = dataset["speed"].values, int(dataset.attrs["teeth_pinion"])
    frequency = dataset["frequency_Hz"].transpose("speed", "mode").values
    columns: Columns = {"pinion_speed_rad_s": speed}
    for mode, column in enumerate(frequency.T, start=1):
        columns[f"frequency_mode_{mode}_Hz"] = column
    has_energy = "mesh_energy" in dataset
    found: list[tuple[float, ...]] = []
    for mode, harmonic in itertools.product(range(frequency.shape[1]), range(1, harmonics + 1)):
        own = frequency[:, mode]
        for at in _crossings(speed, own - harmonic * teeth * speed / (2.0 * np.pi)):
            row = (float(mode + 1), float(harmonic), at, float(np.interp(at, speed, own)))
            if has_energy:
                share = dataset["mesh_energy"].isel(mode=mode).values
                row += (float(np.interp(at, speed, share)),)
            found.append(row)
    names = ["mode", "harmonic", "critical_pinion_speed_rad_s", "critical_frequency_Hz"]
    names += ["mesh_energy"] if has_energy else []
    table = np.asarray(found).reshape(-1, len(names))
    columns |= dict(zip(names, table.T, strict=True))
    return _finite_columns(columns)


def _crossings(speed: np.ndarray, apart: np.ndarray) -> list[float]:
    """Speeds at which a sampled difference vanishes, straight lines between the samples."""
    found = [float(x) for x in speed[(apart == 0.0) & (speed > 0.0)]]
    for left in np.nonzero(apart[1:] * apart[:-1] < 0.0)[0]:
        share = apart[left] / (apart[left] - apart[left + 1])
        found.append(float(speed[left] + share * (speed[left + 1] - speed[left])))
    return found


def orbit_columns(dataset: xr.Dataset) -> Columns:
    """The data of `orbit`, one row per step; branches side by side."""
    columns: Columns = {}
    for row, branch in enumerate(dataset["branch"].values):
        branch = str(branch).replace(" ", "_")
        phase, force, error, rate = _branch(dataset, row)
        columns |= {
            f"phase_{branch}": phase,
            f"mesh_force_ratio_{branch}": force,
            f"te_{branch}_um": error,
            f"te_rate_{branch}_mm_s": rate,
        }
    if "te_static_um" in dataset:
        columns["te_static_um"] = dataset["te_static_um"].values
    return _finite_columns(columns)


def _branch(dataset: xr.Dataset, row: int) -> tuple[np.ndarray, ...]:
    """Phase, mesh force ratio, TE [um] and its rate [mm/s] of one branch, as long as it lasts."""
    own = dataset.isel(branch=row)
    names = ("mesh_force_ratio", "te_um", "te_rate_mm_s")
    rows = np.stack([dataset["phase"].values, *(own[name].values for name in names)])
    return tuple(rows[:, np.all(np.isfinite(rows), axis=0)])
