"""Loads on the flanks at speed: the largest of every response, and whole flanks at some speeds."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._table import PLACES
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._dynamic_loads import dynamic_line_load, dynamic_pressure
from jaxgear._units import MPa, deg, mm
from jaxgear.scene._schema import GEARS
from jaxgear.study._hybrid_dataset import tooth_angles
from jaxgear.study._results import Entry

# A slice less than this in contact says nothing of the load on its tooth.
_TOUCHES = 1e-6


@dataclasses.dataclass(frozen=True)
class FlankLoads:
    """What the flanks carry over one response.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `passage`: mesh periods since the entry of each line, at mid-face, shape `[step, line]` [-].
    - `pair`: number of the tooth pair on each line, in the order of entry, the same shape.
    - `touching`: whether any of a line is in contact, the same shape.
    - `face`: places of the slices from mid-face, shape `[slice]` [m].
    - `load`: line load, shape `[step, line, slice]` [N/m].
    - `pressure`: the same shape [Pa].
    - `teeth`: of pinion and wheel.
    - `width`: of the face in contact [m].
    """

    speed: float
    passage: np.ndarray
    pair: np.ndarray
    touching: np.ndarray
    face: np.ndarray
    load: np.ndarray
    pressure: np.ndarray
    teeth: tuple[int, int]
    width: float

    @property
    def pairs(self) -> int:
        """Number of tooth pairs that are told apart: mesh periods of the cycle."""
        return int(self.pair.max()) + 1

    @property
    def by_pair(self) -> np.ndarray:
        """Largest line load of each tooth pair, shape `[pair]` [N/m]."""
        most = np.zeros(self.pairs)
        np.maximum.at(most, self.pair.ravel(), self.load.max(axis=2).ravel())
        return most

    @property
    def worst(self) -> tuple[int, int, int]:
        """Step, line and slice of the largest line load."""
        step, line, piece = np.unravel_index(int(np.argmax(self.load)), self.load.shape)
        return int(step), int(line), int(piece)

    def numbers(self) -> dict[str, np.ndarray]:
        """The largest, and where it is, in SI."""
        step, line, piece = self.worst
        found = {
            "flank_line_load": self.load.max(),
            "flank_pressure": self.pressure.max(),
            "flank_passage": self.passage[step, line],
            "flank_face": self.face[piece],
            "flank_pair": self.pair[step, line],
            "flank_by_pair": self.by_pair,
        }
        return {name: np.asarray(value) for name, value in found.items()}

    def way(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The most loaded tooth pair from its entry to its exit.

        **Returns:**

        Passage, shape `[step]` [-]; line load and pressure, shape `[step, slice]` [N/m, Pa].
        """
        step, line, _ = self.worst
        places = np.nonzero((self.pair == self.pair[step, line]) & self.touching)
        order = np.argsort(self.passage[places], kind="stable")
        step, line = (each[order] for each in places)
        return self.passage[step, line], self.load[step, line], self.pressure[step, line]


@eqx.filter_jit
def _on_flanks(pair: PairDynamics, orbit: Orbit, law: AbstractContactLaw) -> tuple[Array, Array]:
    """Largest line load and pressure of each slice within each step."""
    load, pressure = (
        jnp.max(jnp.stack([read(pair, orbit, law, place=place) for place in PLACES]), axis=0)
        for read in (dynamic_line_load, dynamic_pressure)
    )
    return load, pressure


def flank_loads(pair: PairDynamics, orbit: Orbit, law: AbstractContactLaw) -> FlankLoads:
    """Work out what the flanks carry in a response.

    **Arguments:**

    - `pair`: in motion.
    - `orbit`: its response.
    - `law`: with which it was found.

    **Returns:**

    The loads.
    """
    load, pressure = (np.asarray(x) for x in _on_flanks(pair, orbit, law))
    lines, gears = pair.cycle.cells.lines, pair.cycle.system.pair
    times = len(load) // len(lines.phase)
    phase = np.asarray(lines.phase)
    at_middle = np.asarray(lines.roll).mean(axis=2)
    passage = (at_middle - float(gears.path_start)) / float(gears.transverse_base_pitch)
    number = np.rint(phase[:, None] - passage).astype(int) % lines.periods
    touching = (np.asarray(lines.fraction) > _TOUCHES).any(axis=2)
    again = lambda x: np.tile(x, (times, 1))
    return FlankLoads(
        speed=float(orbit.speed),
        passage=again(passage),
        pair=again(number),
        touching=again(touching),
        face=np.asarray(lines.face_position),
        load=load,
        pressure=pressure,
        teeth=(gears.pinion.teeth, gears.wheel.teeth),
        width=float(gears.face_width),
    )


# --- Dataset


def loads_over_speeds(numbers: list[list[dict[str, np.ndarray]]]) -> dict[str, Entry]:
    """The largest loads of every response.

    **Arguments:**

    - `numbers`: from `FlankLoads.numbers`, by direction of the sweep and speed.

    **Returns:**

    Entries over direction and speed, and over tooth pairs where there are several.
    """
    rows = lambda name: np.array([[each[name] for each in own] for own in numbers])
    dims = ("direction", "speed")
    found = {
        "max_line_load_N_mm": Entry(
            dims, rows("flank_line_load") * mm, "N/mm", "largest load per length of contact line"
        ),
        "max_pressure_MPa": Entry(
            dims, rows("flank_pressure") / MPa, "MPa", "largest Hertzian pressure"
        ),
        "max_line_load_passage": Entry(
            dims,
            rows("flank_passage"),
            "1",
            "where that load is: mesh periods since its tooth pair's entry at mid-face",
        ),
        "max_line_load_face_mm": Entry(
            dims, rows("flank_face") / mm, "mm", "where that load is, from mid-face"
        ),
    }
    by_pair = rows("flank_by_pair") * mm
    if by_pair.shape[2] > 1:
        found["max_line_load_tooth_pair"] = Entry(
            dims, rows("flank_pair"), "1", "tooth pair of that load, in the order of entry"
        )
        found["tooth_line_load_N_mm"] = Entry(
            (*dims, "tooth_pair"), by_pair, "N/mm", "largest line load of a tooth pair"
        )
    return found


def loads_summary(dataset: xr.Dataset) -> dict[str, Any]:
    """The largest load of a sweep, for the summary.

    **Arguments:**

    - `dataset`: with the entries of `loads_over_speeds`.

    **Returns:**

    Numbers with their units in the keys.
    """
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


def tooth_places(loads: FlankLoads, gear: str) -> np.ndarray:
    """Where the teeth of the tooth pairs stand on a gear, in the order of entry [degrees].

    **Arguments:**

    - `loads`: of a response.
    - `gear`: `pinion` or `wheel`.
    """
    index = GEARS.index(gear)
    return tooth_angles(index, loads.teeth[index], loads.pairs) / deg
