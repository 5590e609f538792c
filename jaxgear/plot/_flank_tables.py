"""The data of the pictures of moving loads on the flanks, as columns with units."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from jaxgear._units import MPa, deg, mm
from jaxgear.plot._tables import Columns, joined
from jaxgear.study._flank_loads import FlankLoads, tooth_places
from jaxgear.study._hybrid_dataset import HolePlaces


def flank_pressure_columns(chosen: Sequence[FlankLoads]) -> Columns:
    """The data of `flank_pressure`, one row per place on the flank at each speed."""
    rows = []
    for each in chosen:
        passage, load, pressure = each.way()
        shape = load.shape
        rows.append(
            {
                "pinion_speed_rad_s": np.full(load.size, each.speed),
                "passage": np.broadcast_to(passage[:, None], shape).ravel(),
                "face_position_mm": np.broadcast_to(each.face / mm, shape).ravel(),
                "line_load_N_mm": load.ravel() * mm,
                "pressure_MPa": pressure.ravel() / MPa,
            }
        )
    return joined(rows)


def largest_loads_columns(dataset: xr.Dataset) -> Columns:
    """The data of `largest_loads`."""
    names = (
        "max_line_load_N_mm",
        "max_pressure_MPa",
        "max_line_load_passage",
        "max_line_load_face_mm",
    )
    speed = {"pinion_speed_rad_s": dataset["speed"].values}
    return speed | {name: dataset[name].values for name in names}


def teeth_at_speed_columns(
    chosen: Sequence[FlankLoads], gear: str, holes: HolePlaces | None
) -> Columns:
    """The data of `teeth_at_speed`, a row for each tooth at each speed."""
    angle = tooth_places(chosen[0], gear)
    order = np.argsort(angle, kind="stable")
    above = np.zeros(len(angle), bool) if holes is None else holes.above(angle * deg)
    many = len(chosen)
    return {
        "pinion_speed_rad_s": np.repeat([each.speed for each in chosen], len(angle)),
        "tooth_pair": np.tile(order, many),
        "tooth_angle_deg": np.tile(angle[order], many),
        "line_load_max_N_mm": np.concatenate([each.by_pair[order] * mm for each in chosen]),
        "above_a_hole": np.tile(above[order].astype(int), many),
    }
