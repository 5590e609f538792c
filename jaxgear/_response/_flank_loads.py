"""Loads on the flanks of a pair in motion: the largest, and one tooth pair's way."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._table import PLACES
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._dynamic_loads import dynamic_line_load, dynamic_pressure

# A slice less than this in contact says nothing of the load on its tooth.
_TOUCHES = 1e-6


class LargestLoad(NamedTuple):
    """The largest loads of one response.

    **Fields:**

    - `line_load`, `pressure`: the largest of either [N/m, Pa].
    - `passage`: where that line load is: mesh periods since its tooth pair's entry at mid-face.
    - `face`: where that line load is, from mid-face [m].
    - `pair`: tooth pair of that line load, in the order of entry.
    - `by_pair`: largest line load of each tooth pair, shape `[pair]` [N/m].
    """

    line_load: float
    pressure: float
    passage: float
    face: float
    pair: int
    by_pair: np.ndarray


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
    """

    speed: float
    passage: np.ndarray
    pair: np.ndarray
    touching: np.ndarray
    face: np.ndarray
    load: np.ndarray
    pressure: np.ndarray

    @property
    def by_pair(self) -> np.ndarray:
        """Largest line load of each tooth pair of the cycle, shape `[pair]` [N/m]."""
        most = np.zeros(int(self.pair.max()) + 1)
        np.maximum.at(most, self.pair.ravel(), self.load.max(axis=2).ravel())
        return most

    @property
    def largest(self) -> LargestLoad:
        """The largest loads, and where they are."""
        step, line, piece = self._worst
        return LargestLoad(
            line_load=float(self.load.max()),
            pressure=float(self.pressure.max()),
            passage=float(self.passage[step, line]),
            face=float(self.face[piece]),
            pair=int(self.pair[step, line]),
            by_pair=self.by_pair,
        )

    @property
    def _worst(self) -> tuple[int, int, int]:
        """Step, line and slice of the largest line load."""
        step, line, piece = np.unravel_index(int(np.argmax(self.load)), self.load.shape)
        return int(step), int(line), int(piece)

    def way(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The most loaded tooth pair from its entry to its exit.

        **Returns:**

        Passage, shape `[step]` [-]; line load and pressure, shape `[step, slice]` [N/m, Pa].
        """
        step, line, _ = self._worst
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
    phase = np.asarray(lines.phase)
    at_middle = np.asarray(lines.roll).mean(axis=2)
    passage = (at_middle - float(gears.path_start)) / float(gears.transverse_base_pitch)
    number = np.rint(phase[:, None] - passage).astype(int) % lines.periods
    touching = (np.asarray(lines.fraction) > _TOUCHES).any(axis=2)
    again = lambda x: np.tile(x, (len(load) // len(phase), 1))
    return FlankLoads(
        speed=float(orbit.speed),
        passage=again(passage),
        pair=again(number),
        touching=again(touching),
        face=np.asarray(lines.face_position),
        load=load,
        pressure=pressure,
    )
