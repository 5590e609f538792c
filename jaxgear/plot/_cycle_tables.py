"""What the pictures of a mesh cycle show, as columns with units."""

import numpy as np
import xarray as xr

from jaxgear._columns import Table
from jaxgear._units import deg
from jaxgear.plot._cycle import amplitudes_of, cycle_periods, flank_grid, mesh_orders, unrolled

# Less of a slice than this is not in contact.
_TOUCHES = 1e-6
FLANK_MAPS = ("line_load_N_mm", "pressure_MPa")


def over_cycle(dataset: xr.Dataset, name: str) -> Table:
    """A variable over phase, from 0 to the end of the cycle; of a single period twice."""
    phase, values = unrolled(dataset["phase"].values, dataset[name].values)
    return Table({"phase": phase, name: values})


def load_sharing_columns(dataset: xr.Dataset) -> Table:
    """Share of the load over roll length, of one tooth pair after the other."""
    phase = dataset["phase"].values
    roll = dataset["roll_mm"].mean("slice").values
    touching = (dataset["fraction"] > _TOUCHES).any("slice").values
    sharing = dataset["load_sharing"].values
    # In the order of entry; the cycle begins again with the same pair.
    pair = np.rint(phase[:, None] - dataset["passage"].values).astype(int) % cycle_periods(phase)
    parts = []
    for one in np.unique(pair):
        places = np.nonzero(pair == one)
        places = tuple(x[np.argsort(roll[places])] for x in places)
        first, last = np.nonzero(touching[places])[0][[0, -1]]
        # One free place on either side, so that entry and exit are seen.
        shown = tuple(x[max(first - 1, 0) : last + 2] for x in places)
        parts.append((np.full(len(shown[0]), one), roll[shown], sharing[shown]))
    names = ("tooth_pair", "roll_mm", "load_sharing")
    return Table.joined([dict(zip(names, part, strict=True)) for part in parts])


def flank_maps_columns(dataset: xr.Dataset) -> Table:
    """Line load and pressure, one row per place on the pinion's flank."""
    grids = {name: flank_grid(dataset, name, "pinion") for name in FLANK_MAPS}
    first = grids["pressure_MPa"]
    place, face = np.meshgrid(
        first["profile_position"].values, first["face_position_mm"].values, indexing="ij"
    )
    angle, diameter = along_flank(dataset, place.ravel())
    columns = {
        "profile_position": place.ravel(),
        "roll_angle_deg": angle,
        "diameter_mm": diameter,
        "face_position_mm": face.ravel(),
    }
    return Table(columns) | {name: grid.values.ravel() for name, grid in grids.items()}


def along_flank(dataset: xr.Dataset, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Roll angle [degrees] and diameter [mm] at places on the pinion's flank, root 0 to tip 1."""
    start, end = dataset["path_point_roll_mm"].sel(path_point=["A", "E"]).values
    roll, base = start + place * (end - start), dataset.attrs["base_radius_pinion_mm"]
    return roll / base / deg, 2.0 * np.hypot(base, roll)


def face_load_columns(dataset: xr.Dataset) -> Table:
    """Load per face width: its mean over the cycle, and at the phase where it is largest."""
    force = dataset["cell_force_N"].sum("line").values
    load = force * force.shape[1] / dataset.attrs["face_width_mm"]
    return Table(
        {
            "face_position_mm": dataset["face_position_mm"].values,
            "face_load_mean_N_mm": dataset["weight"].values @ load,
            "face_load_at_largest_N_mm": load[phase_of_largest(dataset)],
        }
    )


def phase_of_largest(dataset: xr.Dataset) -> int:
    """The phase at which a slice carries most."""
    return int(np.argmax(np.max(dataset["cell_force_N"].sum("line").values, axis=1)))


def harris_map_columns(dataset: xr.Dataset) -> Table:
    """Mean and size of the transmission error, one row per torque."""
    error, weight = dataset["harris_te_um"].values, dataset["weight"].values
    mean = error @ weight
    return Table(
        {
            "torque_pinion_Nm": dataset["torque_Nm"].values,
            "te_mean_um": mean,
            "te_rms_um": np.sqrt((error - mean[:, None]) ** 2 @ weight),
            "te_peak_to_peak_um": np.ptp(error, axis=1),
        }
    )


def spectra(dataset: xr.Dataset) -> xr.Dataset:
    """Amplitudes `te_order_um` of the transmission error over torque and order.

    A cycle of several mesh periods has orders between the mesh harmonics, in steps of one over the
    number of its periods: those of the shafts among them.
    """
    phase = dataset["phase"].values
    periods, last = cycle_periods(phase), mesh_orders(phase)[-1]
    order = np.arange(1, last * periods + 1) / periods
    error, weight = dataset["harris_te_um"].values, dataset["weight"].values
    found = amplitudes_of(phase, weight, error, order)
    return xr.Dataset(
        {"te_order_um": (("torque", "order"), found)},
        {"torque_pinion_Nm": ("torque", dataset["torque_Nm"].values), "order": order},
    )


def pair_error_columns(dataset: xr.Dataset) -> Table:
    """Transmission error without load that each tooth pair alone would have, pair after pair."""
    phase = dataset["phase"].values
    pairs, error = dataset["tooth_pair"].values, dataset["pair_te_um"].values
    periods = cycle_periods(phase)
    parts = []
    for one in np.unique(pairs % periods):
        places = np.nonzero((pairs % periods == one) & np.isfinite(error))
        # Since the entry of the pair: the cycle begins again with it.
        since = phase[places[0]] - pairs[places]
        order = np.argsort(since)
        parts.append((np.full(order.size, one), since[order], error[places][order]))
    names = ("tooth_pair", "passage", "pair_te_um")
    return Table.joined([dict(zip(names, part, strict=True)) for part in parts])
