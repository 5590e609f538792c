"""The data of the pictures of dynamics, as columns with units."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from jaxgear.plot._tables import Columns, _shares, joined

# What is smaller than this share of the static force is rounding: the teeth are apart.
_NO_FORCE = 1e-9


_QUANTITIES = ("dynamic_ratio", "te_rms_um", "contact_loss")

_FLAGS = ("settled", "stable", "periods")


# A sweep of so few speeds shows each.
_FEW = 60


def sweep_columns(dataset: xr.Dataset) -> Columns:
    """The data of `sweep`, one row per speed, of one direction after the other."""
    names = [name for name in (*_QUANTITIES, *_FLAGS) if name in dataset]
    speed, directions = dataset["speed"].values, dataset["direction"].values
    own = dataset[names].transpose("direction", "speed")
    return {
        "direction": np.repeat(directions, len(speed)),
        "pinion_speed_rad_s": np.tile(speed, len(directions)),
        **{name: own[name].values.ravel() for name in names},
    }


def curve_columns(dataset: xr.Dataset) -> Columns:
    """The data of `sweep`, a row for each point of the continuation curve, piece by piece."""
    piece, curve = _curve_points(dataset)
    return {"piece": piece} | {_CURVE[name]: values for name, values in curve.items()}


def fold_columns(dataset: xr.Dataset) -> Columns:
    """The data of `sweep`, a row for each fold of the continuation curve."""
    folds = _folds(dataset)
    return {_CURVE[name]: dataset[name].values[folds] for name in list(_CURVE)[:2]}


def critical_columns(critical: Sequence[tuple[float, str]]) -> Columns:
    """The data of `sweep`, a row for each critical speed."""
    return {
        "pinion_speed_rad_s": np.asarray([speed for speed, _ in critical]),
        "label": np.asarray([label for _, label in critical]),
    }


# What is known of points of the continuation curve, and what it is called in their table.
_CURVE = {
    "curve_speed": "pinion_speed_rad_s",
    "curve_dynamic_ratio": "dynamic_ratio",
    "curve_te_rms_um": "te_rms_um",
    "curve_stable": "stable",
}


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
    return {
        "pinion_speed_rad_s": each_speed,
        "order": each_order,
        "frequency_Hz": frequency,
        "te_order_um": amplitude.ravel(),
    }


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
    """The data of `orders`, one row per speed and order."""
    names = [
        name for name in _ORDER_PANELS if name in dataset and "bearing" not in dataset[name].dims
    ]
    return _over_orders(dataset, names)


def bearing_orders_columns(dataset: xr.Dataset) -> Columns:
    """The data of `orders`, one row per speed and order, of one bearing after the other."""
    parts = []
    for row, bearing in enumerate(_bearing_names(dataset)):
        own = _over_orders(dataset.isel(bearing=row), ["bearing_force_order_N"])
        parts.append({"bearing": np.full(len(own["order"]), bearing)} | own)
    return joined(parts)


def _over_orders(dataset: xr.Dataset, names: Sequence[str]) -> Columns:
    speed, order, _ = _orders_of(dataset, names[0])
    return {
        "pinion_speed_rad_s": np.repeat(speed, len(order)),
        "order": np.tile(order, len(speed)),
        **{name: _orders_of(dataset, name)[2].ravel() for name in names},
    }


def _bearing_names(dataset: xr.Dataset) -> list[str]:
    """The bearings' names, or their numbers where they have none."""
    if "bearing_force_order_N" not in dataset:
        return []
    return [str(x) for x in dataset["bearing"].values]


def contact_loss_columns(dataset: xr.Dataset) -> Columns:
    """The data of `contact_loss`, one row per speed and phase."""
    speed, phase = dataset["speed"].values, dataset["phase"].values
    names = [name for name in ("mesh_force_ratio", "tooth_pairs") if name in dataset]
    return {
        "pinion_speed_rad_s": np.repeat(speed, len(phase)),
        "phase": np.tile(phase, len(speed)),
        **{name: dataset[name].transpose("speed", "phase").values.ravel() for name in names},
    }


def contact_shares_columns(dataset: xr.Dataset) -> Columns:
    """The data of `contact_loss`, one row per speed: the share of time without contact."""
    phase = dataset["phase"].values
    force = dataset["mesh_force_ratio"].transpose("speed", "phase").values
    share = (force <= _NO_FORCE) @ _shares(phase) if len(phase) > 1 else force[:, 0] <= _NO_FORCE
    return {"pinion_speed_rad_s": dataset["speed"].values, "contact_loss": share}


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
    return columns


def campbell_columns(dataset: xr.Dataset) -> Columns:
    """The data of `campbell`, one row per speed, of one mode after the other."""
    return over_modes(dataset, {"frequency_Hz": dataset["frequency_Hz"].values})


def over_modes(dataset: xr.Dataset, values: Mapping[str, np.ndarray]) -> Columns:
    """A table over speed, of one mode after the other.

    **Arguments:**

    - `dataset`: over speed and mode.
    - `values`: rows speeds, columns modes, under the names of their columns.
    """
    speeds, modes = dataset.sizes["speed"], dataset.sizes["mode"]
    return {
        "mode": np.repeat(np.arange(1, modes + 1), speeds),
        "pinion_speed_rad_s": np.tile(dataset["speed"].values, modes),
        **{name: each.T.ravel() for name, each in values.items()},
    }


def crossing_columns(dataset: xr.Dataset, *, harmonics: int = 4) -> Columns:
    """The data of `campbell`, a row for each crossing of a mode with a harmonic of the mesh."""
    speed, teeth = dataset["speed"].values, int(dataset.attrs["teeth_pinion"])
    frequency = dataset["frequency_Hz"].transpose("speed", "mode").values
    known = {"frequency_Hz": frequency}
    if "mesh_energy" in dataset:
        known["mesh_energy"] = dataset["mesh_energy"].transpose("speed", "mode").values
    found: list[tuple[float, ...]] = []
    for mode, harmonic in itertools.product(range(frequency.shape[1]), range(1, harmonics + 1)):
        mesh = harmonic * teeth * speed / (2.0 * np.pi)
        for at in _crossings(speed, frequency[:, mode] - mesh):
            own = (float(np.interp(at, speed, values[:, mode])) for values in known.values())
            found.append((mode + 1, harmonic, at, *own))
    names = ("mode", "harmonic", "pinion_speed_rad_s", *known)
    return dict(zip(names, np.reshape(np.asarray(found), (-1, len(names))).T, strict=True))


def _crossings(speed: np.ndarray, apart: np.ndarray) -> list[float]:
    """Speeds at which a sampled difference vanishes, straight lines between the samples."""
    found = [float(x) for x in speed[(apart == 0.0) & (speed > 0.0)]]
    for left in np.nonzero(apart[1:] * apart[:-1] < 0.0)[0]:
        share = apart[left] / (apart[left] - apart[left + 1])
        found.append(float(speed[left] + share * (speed[left + 1] - speed[left])))
    return found


def orbit_columns(dataset: xr.Dataset) -> Columns:
    """The data of `orbit`, one row per step, of one branch after the other."""
    parts = []
    for row, branch in enumerate(dataset["branch"].values):
        phase, force, error, rate = _branch(dataset, row)
        part = {
            "branch": np.full(len(phase), str(branch)),
            "phase": phase,
            "mesh_force_ratio": force,
            "te_um": error,
            "te_rate_mm_s": rate,
        }
        if "te_static_um" in dataset:
            part["te_static_um"] = dataset["te_static_um"].sel(phase=phase).values
        parts.append(part)
    return joined(parts)


def _branch(dataset: xr.Dataset, row: int) -> tuple[np.ndarray, ...]:
    """Phase, mesh force ratio, TE [um] and its rate [mm/s] of one branch, as long as it lasts."""
    own = dataset.isel(branch=row)
    names = ("mesh_force_ratio", "te_um", "te_rate_mm_s")
    rows = np.stack([dataset["phase"].values, *(own[name].values for name in names)])
    return tuple(rows[:, np.all(np.isfinite(rows), axis=0)])
