"""Stresses of condensed bodies over the speeds of a sweep: gauges, and maps at its highest peak."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr

from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._sweep_types import Direction, SweepPoint, Ways
from jaxgear._dynamics._system import PairDynamics
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._gauges import GaugeInfluences, moving_gauge_readings
from jaxgear._response._whole_motion import WholeBody, beyond_in_steps
from jaxgear._types import Reals
from jaxgear._units import MPa
from jaxgear.scene._body_heat import free_strains
from jaxgear.study._built import BuiltScene
from jaxgear.study._gauges import MICRO, Gauge, gauge_places, gauges_of, influences_of
from jaxgear.study._moving_body import moving_bodies, whole_body
from jaxgear.study._result import Summary
from jaxgear.study._results import Entry, dataset_of
from jaxgear.study._sweeping import Sweep

_PLACE = ("direction", "speed")
# What is told of a gauge at each speed, with what it is.
_TOLD = {
    "strain_mean_um_m": "mean strain over a revolution",
    "strain_amplitude_um_m": "half the range of the strain over a revolution",
    "stress_mean_MPa": "mean normal stress over a revolution",
    "stress_largest_MPa": "largest normal stress of a revolution",
    "stress_least_MPa": "least normal stress of a revolution",
    "stress_amplitude_MPa": "half the range of the normal stress over a revolution",
}


class GearGauges(NamedTuple):
    """Gauges on one body in motion.

    **Fields:**

    - `gauges`: of the scene.
    - `influences`: of all their nodes, with the modes of the body.
    - `strain`: free strains of hub and rim by heat [-].
    - `whole`: the body on these modes.
    """

    gauges: tuple[Gauge, ...]
    influences: GaugeInfluences
    strain: Reals
    whole: WholeBody


@dataclasses.dataclass
class StressWatch:
    """Reads the gauges of each response of a sweep, and keeps the one at the highest peak.

    **Fields:**

    - `pair`: that is swept.
    - `law`: of contact.
    - `gauges`: by gear.
    - `seen`: of each direction, by speed of the pinion [rad/s]: of each gear what `_TOLD` names of
        each gauge, shape `[gauge, number]`, in the units of files.
    - `peak`: of each direction whether it settled, its dynamic ratio, and the response.
    """

    pair: PairDynamics
    law: AbstractContactLaw
    gauges: Mapping[str, GearGauges]
    seen: dict[Direction, dict[float, dict[str, np.ndarray]]] = dataclasses.field(
        default_factory=dict
    )
    peak: dict[Direction, tuple[tuple[bool, float], Orbit]] = dataclasses.field(
        default_factory=dict
    )

    def __call__(self, ways: Ways, point: SweepPoint, ratio: float) -> None:
        """Look at a response, whose dynamic ratio is known [-]."""
        rank, speed = (point.settled, ratio), float(point.orbit.speed)
        numbers = {
            gear: _numbers(own, self.pair, point.orbit, self.law)
            for gear, own in self.gauges.items()
        }
        for way in ways:
            if way not in self.peak or rank > self.peak[way][0]:
                self.peak[way] = rank, point.orbit
            self.seen.setdefault(way, {})[speed] = numbers


def _numbers(
    own: GearGauges, pair: PairDynamics, orbit: Orbit, law: AbstractContactLaw
) -> np.ndarray:
    """What `_TOLD` names of each gauge, `[gauge, number]`."""
    beyond = jnp.asarray(beyond_in_steps(own.whole, pair, orbit, law, own.influences.index))
    found, turn = moving_gauge_readings(own.influences, pair, orbit, law, own.strain, beyond)
    of_nodes, turn = np.asarray(found).reshape(len(turn), -1, 2), np.asarray(turn)
    ends = np.cumsum([len(each.places) for each in own.gauges])[:-1]
    parts = zip(own.gauges, np.split(of_nodes, ends, axis=1), strict=True)
    shown = np.stack([each.shown(readings, turn) for each, readings in parts])
    strain, stress = shown[..., 0] / MICRO, shown[..., 1] / MPa
    most, least = stress.max(axis=1), stress.min(axis=1)
    half = 0.5 * np.ptp(strain, axis=1)
    # Steps of a mesh period are of two lengths at most, nearly equal: means are those of steps.
    numbers = strain.mean(axis=1), half, stress.mean(axis=1), most, least, 0.5 * (most - least)
    return np.stack(numbers, axis=1)


def stress_watch(built: BuiltScene, pair: PairDynamics) -> StressWatch:
    """What a sweep shows each response to: the gauges of a scene, and its highest peak.

    **Raises:**

    - `ValueError` if a gauge is where there is no node.
    """
    scene, found = built.scene, {}
    for gear, moving in moving_bodies(scene.bodies, scene.gears).items():
        body = scene.bodies[gear]
        gauges = gauges_of(scene.gauges, scene.condensed, gear, body.built, body.heated)
        if not gauges:
            continue
        influences = influences_of(
            scene.mesh, body, gauges, built.model.pair, built.grid_in_motion, moving.natural
        )
        if not scene.sweep.centrifugal:
            still = jnp.zeros_like(influences.rotation)
            influences = dataclasses.replace(influences, rotation=still)
        strain = free_strains(scene.gear(gear).body.temperature)
        found[gear] = GearGauges(gauges, influences, strain, whole_body(scene, moving))
    return StressWatch(pair, built.law, found)


# --- Results


def swept_gauges_dataset(watch: StressWatch, sweep: Sweep) -> xr.Dataset:
    """What the gauges of a scene read at each speed of a sweep, in each of its directions."""
    seen = [[watch.seen[way][speed] for speed in sweep.speeds] for way in sweep.responses]
    settled = [[each.settled for each in own] for own in sweep.responses.values()]
    entries: dict[str, Entry] = {
        "speed": Entry(("speed",), sweep.speeds, "rad/s", "speed of the pinion"),
        "direction": Entry(("direction",), list(sweep.responses), "1", "of the sweep"),
        "settled": Entry(_PLACE, settled, "1", "whether the response repeats"),
    }
    for gear, own in watch.gauges.items():
        entries |= gauge_places(gear, own.gauges)
        values = np.asarray([[each[gear] for each in row] for row in seen])
        for number, (name, words) in enumerate(_TOLD.items()):
            unit = "MPa" if name.endswith("MPa") else "um/m"
            dims, gauge = (*_PLACE, f"{gear}_gauge"), f"{gear}_gauge_{name}"
            entries[gauge] = Entry(dims, values[..., number], unit, f"{words}, in motion")
    return dataset_of(entries)


def swept_gauges_summary(dataset: xr.Dataset, gears: Sequence[str]) -> list[Summary]:
    """Of each gauge the largest stress and amplitude of the settled responses, and where."""
    settled = dataset["settled"].values.astype(bool)
    counts = settled if settled.any() else ~settled
    return [row for gear in gears for row in _summary_rows(dataset, gear, counts)]


def _summary_rows(dataset: xr.Dataset, gear: str, counts: np.ndarray) -> Iterator[Summary]:
    gauge = f"{gear}_gauge"
    for row in range(dataset.sizes[gauge]):
        own = dataset.isel({gauge: row})
        told: Summary = {"name": str(own[gauge].item()), "gear": gear}
        for name in ("stress_largest_MPa", "stress_amplitude_MPa"):
            values = np.where(counts, own[f"{gauge}_{name}"].values, -np.inf)
            way, place = np.unravel_index(int(np.argmax(values)), values.shape)
            head = name.removesuffix("_MPa")
            told |= {
                name: float(values[way, place]),
                f"{head}_at_pinion_speed_rad_s": float(own["speed"].values[place]),
                f"{head}_direction": str(own["direction"].values[way]),
            }
        yield told


class SweptStress(NamedTuple):
    """What a sweep says of stresses in bodies: parts of its summary, datasets, files."""

    summary: Summary
    datasets: dict[str, xr.Dataset]
    files: dict[str, Callable]


def swept_stress(
    built: BuiltScene, watch: StressWatch, sweep: Sweep, tell: Callable[[str], None]
) -> SweptStress:
    """Gauges over speed, and with `mesh.body_stress` maps at the highest peak; begins are told."""
    summary: Summary = {}
    datasets: dict[str, xr.Dataset] = {}
    files: dict[str, Callable] = {}
    if watch.gauges:
        datasets["gauges_swept"] = swept_gauges_dataset(watch, sweep)
        summary["gauges"] = swept_gauges_summary(datasets["gauges_swept"], list(watch.gauges))
    if built.scene.mesh.body_stress:
        from jaxgear.study import _stress_maps

        orbit = watch.peak[sweep.main][1]
        maps = _stress_maps.moving_stress_maps(built, watch.pair, orbit, tell)
        at = {"pinion_speed_rad_s": float(orbit.speed)}
        summary["body_stress"] = [at | each for each in _stress_maps.stress_summary(maps)]
        for gear, found in maps.items():
            datasets[f"{gear}_stress_moving"] = _stress_maps.stress_dataset(gear, found)
            files[f"{gear}_stress_moving.vtu"] = _stress_maps.stress_writer(found)
    return SweptStress(summary, datasets, files)
