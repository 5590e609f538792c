"""What a run with condensed bodies adds to the dataset of its cycle, and to its summary."""

import dataclasses
from collections.abc import Mapping

import numpy as np
import xarray as xr

from jaxgear._units import deg, um
from jaxgear.scene._bodies import Drawn
from jaxgear.scene._body_build import BuiltBody
from jaxgear.scene._schema import GEARS
from jaxgear.study._body_answers import BodyAnswer
from jaxgear.study._hybrid import DIRECTIONS, radius_of
from jaxgear.study._result import Summary
from jaxgear.study._results import Entry, entries_over

# A slice less than this in contact says nothing of the load on its tooth.
_TOUCHES = 1e-6


def hybrid_variables(dataset: xr.Dataset, answers: list[BodyAnswer]) -> xr.Dataset:
    """The dataset of a cycle with what a run with condensed bodies adds.

    It is what bodies do, one tooth's way through the mesh and, over several mesh periods, what each
    tooth carries.
    """
    entries: dict[str, Entry] = {}
    for answer in answers:
        entries |= {**_of_body(answer), **_of_holes(dataset, answer)}
    entries |= _way_of_tooth(dataset)
    if _periods(dataset) > 1:
        entries |= _of_teeth(dataset)
    direction = Entry(("direction",), list(DIRECTIONS), "1", "direction in the frame of the body")
    added = {name: entry.variable() for name, entry in entries.items()}
    return dataset.assign(added).assign_coords(direction=direction.variable())


def _of_body(answer: BodyAnswer) -> Mapping[str, Entry]:
    gear, web = answer.gear, answer.web
    radius = float(np.median(radius_of(answer.built.body.rim_nodes)))
    against = f"of the {gear}'s rim under the mesh load, against the gear's seat"
    roots = Entry(
        ("phase", "line", "slice", "direction"),
        answer.roots / um,
        "um",
        f"displacement {against}, at the roots of its teeth",
    )
    largest = f"largest displacement {against}"
    parts = {
        "shift_um": (radius_of(web) / um, "um", "mean shift across the axis"),
        "axial_um": (web[:, 2] / um, "um", "mean shift along the axis"),
        "tilt_urad": (1e6 * radius_of(web[:, 3:]), "urad", "tilt"),
        "wind_up_um": (radius * web[:, 5] / um, "um", "wind-up, at the root circle,"),
    }
    rows = {
        f"{gear}_web_{name}": (values, unit, f"{words} {against}")
        for name, (values, unit, words) in parts.items()
    }
    return {
        f"{gear}_root_deflection_um": roots,
        f"{gear}_rim_deflection_um": Entry(("phase", "direction"), answer.rim / um, "um", largest),
        **entries_over(("phase",), rows),
    }


def _of_holes(dataset: xr.Dataset, answer: BodyAnswer) -> Mapping[str, Entry]:
    """Where the holes of a web are, and over several mesh periods which teeth stand above one."""
    gear, holes = answer.gear, hole_places(answer.built)
    entries: dict[str, Entry] = {}
    if holes is not None:
        web = f"a hole in the {gear}'s web"
        rows = {
            f"{gear}_hole_deg": (holes.middles / deg, "deg", f"middle of {web}, about its axis"),
            f"{gear}_hole_half_deg": (holes.half / deg, "deg", f"half the angle that {web} takes"),
        }
        entries |= entries_over((f"{gear}_hole",), rows)
    if (periods := _periods(dataset)) > 1:
        angles = tooth_angles(GEARS.index(gear), dataset.attrs[f"teeth_{gear}"], periods)
        # In degrees and back, as the dataset has them.
        above = np.zeros(periods, bool) if holes is None else holes.above(angles / deg * deg)
        words = f"1 where the tooth of the {gear} is above a hole, else 0"
        found = Entry(("tooth_pair",), above.astype(np.int8), "1", words)
        entries[f"{gear}_tooth_above_a_hole"] = found
    return entries


def _periods(dataset: xr.Dataset) -> int:
    phase = dataset["phase"].values
    return int(np.ceil(np.max(phase) - np.min(phase)))


def tooth_pairs(dataset: xr.Dataset) -> np.ndarray:
    """Number of the tooth pair on each line, in the order of entry, shape `[phase, line]` [-].

    The cycle begins again with the same pairs.
    """
    phase, passage = dataset["phase"].values, dataset["passage"].values
    return np.rint(phase[:, None] - passage).astype(int) % _periods(dataset)


def _way_of_tooth(dataset: xr.Dataset) -> Mapping[str, Entry]:
    """Line load and pressure of the most loaded tooth pair, from entry to exit."""
    pair, load = tooth_pairs(dataset), dataset["line_load_N_mm"].values
    most = pair[np.unravel_index(np.argmax(load.max(axis=2)), pair.shape)]
    touching = (dataset["fraction"].values > _TOUCHES).any(axis=2)
    places = np.nonzero((pair == most) & touching)
    order = np.argsort(dataset["passage"].values[places])
    way = lambda name: dataset[name].values[tuple(each[order] for each in places)]
    along = "its load per length of contact line"
    steps = {
        "way_passage": (way("passage"), "1", "mesh periods since that pair's entry at mid-face"),
        "way_share": (way("load_sharing"), "1", "its share of the mesh force"),
    }
    slices = {
        "way_line_load_N_mm": (way("line_load_N_mm"), "N/mm", along),
        "way_pressure_MPa": (way("pressure_MPa"), "MPa", "its largest Hertzian pressure"),
    }
    return {
        "way_tooth_pair": Entry((), int(most), "1", "tooth pair of the largest line load"),
        **entries_over(("step",), steps),
        **entries_over(("step", "slice"), slices),
    }


def _of_teeth(dataset: xr.Dataset) -> Mapping[str, Entry]:
    """What each tooth pair carries in its turn, and where its teeth stand on their bodies."""
    pair, periods = tooth_pairs(dataset), _periods(dataset)
    load = dataset["line_load_N_mm"].max("slice").values
    share = dataset["load_sharing"].values
    weight = dataset["weight"].values[:, None] * np.ones_like(share)
    most, largest, mean = np.zeros(periods), np.zeros(periods), np.zeros(periods)
    np.maximum.at(most, pair.ravel(), load.ravel())
    np.maximum.at(largest, pair.ravel(), share.ravel())
    np.add.at(mean, pair.ravel(), (periods * weight * share).ravel())
    over = "load of a pair over its way, over that of the mean pair"
    rows: dict[str, tuple[np.ndarray, str, str]] = {
        "tooth_pair": (np.arange(periods), "1", "pair, in order of entry"),
        "tooth_line_load_N_mm": (most, "N/mm", "largest line load of a pair"),
        "tooth_share": (largest, "1", "largest share of the mesh force that a pair has"),
        "tooth_load_over_mean": (mean, "1", over),
    }
    for index, gear in enumerate(GEARS):
        angles = tooth_angles(index, dataset.attrs[f"teeth_{gear}"], periods) / deg
        words = f"place of the tooth on the {gear}, from tooth 0"
        rows[f"{gear}_tooth_angle_deg"] = angles, "deg", words
    return entries_over(("tooth_pair",), rows)


def tooth_angles(index: int, teeth: int, periods: int) -> np.ndarray:
    """Where the teeth of so many pairs stand on the pinion, 0, or the wheel, 1; in their order.

    Angles about the body's axis, from 0 to a full turn [rad].
    """
    number = np.arange(periods) * (1 if index else -1)
    return 2.0 * np.pi / teeth * (number % teeth)


@dataclasses.dataclass(frozen=True)
class HolePlaces:
    """Holes of a web, as seen from its axis.

    **Fields:**

    - `middles`: of the holes, shape `[hole]` [rad].
    - `half`: angle that half of each takes, shape `[hole]` [rad].
    """

    middles: np.ndarray
    half: np.ndarray

    def above(self, angles: np.ndarray) -> np.ndarray:
        """Which of some angles lie above a hole."""
        apart = np.mod(angles[:, None] - self.middles + np.pi, 2.0 * np.pi) - np.pi
        return np.any(np.abs(apart) <= self.half, axis=1)


def hole_places(built: BuiltBody) -> HolePlaces | None:
    """Where the holes of a drawn body are, or None if it has none."""
    source = built.plan.source
    if not isinstance(source, Drawn) or source.body.web is None or not source.body.web.holes:
        return None
    middles, half = [], []
    for ring in source.body.web.holes:
        middles.append(ring.angle + 2.0 * np.pi / ring.count * np.arange(ring.count))
        half.append(np.full(ring.count, np.arcsin(min(1.0, ring.diameter / ring.circle))))
    return HolePlaces(np.concatenate(middles), np.concatenate(half))


def hole_numbers(dataset: xr.Dataset, gear: str, holes: HolePlaces | None) -> Summary:
    """Largest line loads of teeth above a hole and of those between holes, for the summary.

    Means over the teeth of either kind, and the largest of each; empty without holes, or if the
    cycle shows one kind only.
    """
    if holes is None or "tooth_line_load_N_mm" not in dataset:
        return {}
    above = holes.above(dataset[f"{gear}_tooth_angle_deg"].values * deg)
    if above.all() or not above.any():
        return {}
    load, share = dataset["tooth_line_load_N_mm"].values, dataset["tooth_load_over_mean"].values
    found: Summary = {}
    for words, chosen in (("above_holes", above), ("between_holes", ~above)):
        found |= {
            f"line_load_{words}_mean_N_mm": float(load[chosen].mean()),
            f"line_load_{words}_largest_N_mm": float(load[chosen].max()),
            f"load_{words}_over_mean": float(share[chosen].mean()),
        }
    return found


def hybrid_summary(dataset: xr.Dataset, answers: list[BodyAnswer]) -> Summary:
    """What a run with condensed bodies adds to `static`, of the dataset of `hybrid_variables`.

    A table for each condensed body, the unit in each key.
    """
    return {
        f"{answer.gear}_body": answer.numbers
        | hole_numbers(dataset, answer.gear, hole_places(answer.built))
        for answer in answers
    }
