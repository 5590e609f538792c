"""Loads on the flanks at speed as datasets: the largest of all responses, whole flanks of some."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from jaxgear._response._flank_loads import FlankLoads
from jaxgear._units import mm
from jaxgear.scene._schema import GEARS
from jaxgear.study._body_waves import Seen, WaveWatch
from jaxgear.study._hybrid_dataset import hole_places, tooth_angles
from jaxgear.study._result import Summary
from jaxgear.study._results import Entries, dataset_of, over


def largest_loads(seen: list[list[Seen]]) -> Entries:
    """The largest loads of every response, and of tooth pairs if there are several."""

    def rows(name: str) -> np.ndarray:
        return np.asarray([[getattr(each.flank, name) for each in own] for own in seen])

    found = over(
        "direction speed",
        max_line_load_N_mm=(rows("line_load"), "largest load per length of contact line"),
        max_pressure_MPa=(rows("pressure"), "largest Hertzian pressure"),
        max_line_load_passage=(
            rows("passage"),
            "where that load is: mesh periods since its tooth pair's entry at mid-face",
        ),
        max_line_load_face_mm=(rows("face"), "where that load is, from mid-face"),
    )
    by_pair, words = rows("by_pair"), "largest line load of a tooth pair"
    if by_pair.shape[2] > 1:
        pair = rows("pair"), "tooth pair of that load, in the order of entry"
        found |= over("direction speed", max_line_load_tooth_pair=pair)
        found |= over("direction speed tooth_pair", tooth_line_load_N_mm=(by_pair, words))
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

    Of each hole its middle and its half width, shape `[hole, 2]` [rad].
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
    passage, load, pressure = map(rows, range(3))
    entries = (
        over("shown", pinion_speed_rad_s=([each.speed for each in shown], "speed of the pinion"))
        | over("slice", face_position_mm=(shown[0].face, "place from mid-face"))
        | over("shown step", passage=(passage, "mesh periods since the pair's entry at mid-face"))
        | over(
            "shown step slice",
            line_load_N_mm=(load, "load per length of contact line"),
            pressure_MPa=(pressure, "largest Hertzian pressure"),
        )
    )
    if teeth:
        load = np.stack([each.by_pair for each in shown])
        words = "largest line load of a tooth pair"
        entries |= over("tooth_pair", tooth_pair=(np.arange(load.shape[1]), "in order of entry"))
        entries |= over("shown tooth_pair", line_load_max_N_mm=(load, words))
    for gear, count, holes in teeth:
        angle = tooth_angles(GEARS.index(gear), count, load.shape[1])
        apart = np.abs(np.mod(angle[:, None] - holes[:, 0] + np.pi, 2.0 * np.pi) - np.pi)
        above = np.any(apart <= holes[:, 1], axis=1).astype(int)
        words = "middle of a hole, or half the angle that it takes"
        named = {
            f"{gear}_tooth_angle_deg": (angle, f"place of the tooth on the {gear}, from tooth 0"),
            f"{gear}_above_a_hole": (above, "whether the tooth is above a hole in the web"),
        }
        of_holes = {
            f"{gear}_{name}": (column, words)
            for name, column in zip(("hole_angle_deg", "hole_half_deg"), holes.T, strict=True)
        }
        entries |= over("tooth_pair", **named) | over(f"{gear}_hole", **of_holes)
    counts = {f"teeth_{each.gear}": each.count for each in teeth}
    return dataset_of(entries).assign_attrs({"face_width_mm": width / mm} | counts)
