"""What pictures read out of the dataset of a mesh cycle, in NumPy."""

import math

import numpy as np
import xarray as xr

_HARMONICS = 10

# What is smaller than this share of the static force is rounding: the teeth are apart.
NO_FORCE = 1e-9
# A slice has a place on the flank if its middle is on the path of contact.
_ON_FLANK = 0.5


def cycle_periods(phase: np.ndarray) -> int:
    """Number of mesh periods in the cycle: phases fill it but for half a step at the ends."""
    return int(np.ceil(np.max(phase) - np.min(phase)))


def unrolled(phase: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Phase and values from 0 to the end of the cycle; one of a single period twice in a row."""
    periods = cycle_periods(phase)
    place = phase % periods
    order = np.argsort(place, kind="stable")
    times = 2 if periods == 1 else 1
    shifts = periods * np.arange(times)[:, None]
    return (place[order] + shifts).ravel(), np.tile(values[order], times)


def phase_shares(phases: np.ndarray) -> np.ndarray:
    """Half the distances to both neighbours, around the cycle, over its length."""
    periods = cycle_periods(phases)
    around = np.concatenate([[phases[-1] - periods], phases, [phases[0] + periods]])
    return 0.5 * (around[2:] - around[:-2]) / periods


def amplitudes_of(
    phase: np.ndarray, weight: np.ndarray, values: np.ndarray, orders: np.ndarray
) -> np.ndarray:
    """Amplitudes of the orders of the mesh frequency, zero to peak; rows as those of `values`."""
    fluctuation = values - (values @ weight)[..., None]
    turning = np.exp(-2.0j * np.pi * orders[:, None] * phase)
    return 2.0 * np.abs((weight * fluctuation) @ turning.T)


def mesh_orders(phase: np.ndarray) -> np.ndarray:
    """The mesh harmonics that the phases can tell apart, the first few."""
    each = len(phase) // cycle_periods(phase)
    return np.arange(1, min(_HARMONICS, (each - 1) // 2) + 1)


def largest_pressure(dataset: xr.Dataset) -> np.ndarray:
    """Largest pressure on any line at each phase [MPa]."""
    return dataset["pressure_MPa"].max(("line", "slice")).values


def cycle_statistics(values: xr.DataArray) -> tuple[float, float, float]:
    """Mean over the cycle, RMS of the fluctuation about it, and peak to peak of a variable.

    It is over phase, from a dataset with its `weight`.
    """
    weight, y = values["weight"].values, values.values
    mean = float(np.sum(weight * y))
    return mean, math.sqrt(float(np.sum(weight * (y - mean) ** 2))), float(np.ptp(y))


def flank_grid(dataset: xr.Dataset, variable: str, body: str, *, points: int = 81) -> xr.DataArray:
    """Collect what all lines saw at all phases onto one flank, of `pinion` or `wheel`.

    The variable, one over phase, line and slice, is returned over `face_position_mm` and so many
    points of `profile_position`, 0 near the root of this flank to 1 at its tip.

    **Raises:**

    - `ValueError` if there is no such body, or no such variable over the cells.
    """
    if body not in ("pinion", "wheel"):
        raise ValueError(f"`body` must be one of pinion, wheel, got {body!r}.")
    source = dataset[variable]
    if source.dims != ("phase", "line", "slice"):
        raise ValueError(f"`{variable}` must be over phase, line and slice, got {source.dims}.")
    place = dataset["profile_position"].values
    place = place if body == "pinion" else 1.0 - place
    on_flank = dataset["fraction"].values >= _ON_FLANK
    profile = np.linspace(0.0, 1.0, points)
    values = []
    for each in range(source.sizes["slice"]):
        seen = on_flank[:, :, each]
        x, y = place[:, :, each][seen], source.values[:, :, each][seen]
        order = np.argsort(x)
        values.append(np.interp(profile, x[order], y[order]))
    about = {"units": "1", "long_name": f"place on the {body}'s flank, 0 root to 1 tip"}
    face = dataset["face_position_mm"]
    return xr.DataArray(
        np.stack(values, axis=1),
        dims=("profile_position", "slice"),
        coords={
            "profile_position": ("profile_position", profile, about),
            "face_position_mm": ("slice", face.values, face.attrs),
        },
        attrs=source.attrs,
        name=variable,
    )
