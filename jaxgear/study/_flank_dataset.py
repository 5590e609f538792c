"""Loads on the flanks at speed as datasets: the largest of all responses, whole flanks of some."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from jaxgear._response._flank_loads import FlankLoads
from jaxgear._units import MPa, deg, mm
from jaxgear.scene._schema import GEARS
from jaxgear.study._body_waves import Seen, WaveWatch
from jaxgear.study._hybrid_dataset import hole_places, tooth_angles
from jaxgear.study._result import Summary
from jaxgear.study._results import Entry

_PLACE = ("direction", "speed")


def largest_loads(seen: list[list[Seen]]) -> Mapping[str, Entry]:
    """The largest loads of every response, and of tooth pairs if there are several."""
    rows = lambda name: np.asarray([[getattr(each.flank, name) for each in own] for own in seen])
    found = {
        "max_line_load_N_mm": Entry(
            _PLACE, rows("line_load") * mm, "N/mm", "largest load per length of contact line"
        ),
        "max_pressure_MPa": Entry(
            _PLACE, rows("pressure") / MPa, "MPa", "largest Hertzian pressure"
        ),
        "max_line_load_passage": Entry(
            _PLACE,
            rows("passage"),
            "1",
            "where that load is: mesh periods since its tooth pair's entry at mid-face",
        ),
        "max_line_load_face_mm": Entry(
            _PLACE, rows("face") / mm, "mm", "where that load is, from mid-face"
        ),
    }
    by_pair = rows("by_pair") * mm
    if by_pair.shape[2] > 1:
        found["max_line_load_tooth_pair"] = Entry(
            _PLACE, rows("pair"), "1", "tooth pair of that load, in the order of entry"
        )
        found["tooth_line_load_N_mm"] = Entry(
            (*_PLACE, "tooth_pair"), by_pair, "N/mm", "largest line load of a tooth pair"
        )
    return found


def loads_summary(dataset: xr.Dataset) -> Summary:
    """The largest load of a sweep, for the summary."""
    load = dataset["max_line_load_N_mm"].values
    place = np.unravel_index(int(np.argmax(load)), load.shape)
    at = lambda name: float(dataset[name].values[place])
    found = {
        "max_line_load_N_mm": at("max_line_load_N_mm"),
        "max_pressure_MPa": float(dataset["max_pressure_MPa"].values.max()),
        "pinion_speed_rad_s": float(dataset["speed"].values[place[1]]),
        "passage": at("max_line_load_passage"),
        "face_position_mm": at("max_line_load_face_mm"),
    }
    if "max_line_load_tooth_pair" in dataset:
        found["tooth_pair"] = int(at("max_line_load_tooth_pair"))
    return found


class Teeth(NamedTuple):
    """The teeth of a gear over the tooth pairs of a cycle, and the holes in its web.

    **Fields:**

    - `gear`: `pinion` or `wheel`.
    - `count`: number of teeth.
    - `holes`: middle and half width of each, shape `[hole, 2]` [rad].
    """

    gear: str
    count: int
    holes: np.ndarray


def flanks_dataset(watch: WaveWatch, shown: list[FlankLoads]) -> xr.Dataset:
    """The flanks at some speeds: the most loaded tooth pair's way, and what each pair carries.

    A way of fewer steps than another ends with values that are not numbers.
    """
    gears = watch.pair.cycle.system.pair
    pairs, found = len(shown[0].by_pair), []
    for gear, each in watch.looked.items() if pairs > 1 else ():
        holes = hole_places(each.body.built)
        places = np.zeros((0, 2)) if holes is None else np.stack([holes.middles, holes.half], 1)
        found.append(Teeth(gear, each.body.teeth, places))
    return flanks_of(shown, float(gears.face_width), found)


def flanks_of(shown: list[FlankLoads], width: float, teeth: list[Teeth]) -> xr.Dataset:
    """As `flanks_dataset`, with the width of the face in contact [m] and the teeth of each gear."""
    ways = [each.way() for each in shown]
    steps = max(len(passage) for passage, _, _ in ways)
    padded = lambda x: np.pad(
        x, [(0, steps - len(x)), *[(0, 0)] * (x.ndim - 1)], constant_values=np.nan
    )
    rows = lambda which: np.stack([padded(way[which]) for way in ways])
    way, over = ("shown", "step"), ("shown", "step", "slice")
    entries = {
        "pinion_speed_rad_s": Entry(
            ("shown",), [each.speed for each in shown], "rad/s", "speed of the pinion"
        ),
        "face_position_mm": Entry(("slice",), shown[0].face / mm, "mm", "place from mid-face"),
        "passage": Entry(way, rows(0), "1", "mesh periods since the pair's entry at mid-face"),
        "line_load_N_mm": Entry(over, rows(1) * mm, "N/mm", "load per length of contact line"),
        "pressure_MPa": Entry(over, rows(2) / MPa, "MPa", "largest Hertzian pressure"),
    }
    if teeth:
        pair = ("tooth_pair",)
        load = np.stack([each.by_pair for each in shown]) * mm
        entries["tooth_pair"] = Entry(pair, np.arange(load.shape[1]), "1", "in order of entry")
        entries["line_load_max_N_mm"] = Entry(
            ("shown", *pair), load, "N/mm", "largest line load of a tooth pair"
        )
    for gear, count, holes in teeth:
        angle = tooth_angles(GEARS.index(gear), count, load.shape[1])
        words = f"place of the tooth on the {gear}, from tooth 0"
        entries[f"{gear}_tooth_angle_deg"] = Entry(pair, angle / deg, "deg", words)
        apart = np.abs(np.mod(angle[:, None] - holes[:, 0] + np.pi, 2.0 * np.pi) - np.pi)
        above = np.any(apart <= holes[:, 1], axis=1).astype(int)
        words = "whether the tooth is above a hole in the web"
        entries[f"{gear}_above_a_hole"] = Entry(pair, above, "1", words)
        for name, column in zip(("hole_angle_deg", "hole_half_deg"), holes.T, strict=True):
            words = "middle of a hole, or half the angle that it takes"
            entries[f"{gear}_{name}"] = Entry((f"{gear}_hole",), column / deg, "deg", words)
    counts = {f"teeth_{each.gear}": each.count for each in teeth}
    return xr.Dataset(
        {name: entry.variable() for name, entry in entries.items()},
        attrs={"face_width_mm": width / mm} | counts,
    )
