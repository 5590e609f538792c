"""Example scenes with changes, set in motion, and their sweeps."""

import dataclasses
import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxgear as jg
from jaxgear import (
    DynamicSystem,
    HarmonicBalance,
    Modes,
    Orbit,
    PairDynamics,
    PairModel,
    Scene,
    dynamic_response,
    example_scene,
    grid_of,
    model_of,
    modes,
    steady_states,
)
from jaxgear.scene._mesh_bodies import with_bodies
from jaxgear.scene._schema import GEARS
from jaxgear.study._dynamics import dynamics_of

from .statics import THESIS

# Slices and time steps that tell trends; bodies move on the shapes that scenes have by default.
COARSE = ("mesh.slices=10", "sweep.steps=64", "sweep.pinion_speed_rad_s=[1000.0]")
HARMONICS = 14
# What a body that hardly deforms can do without.
QUICK = ("interface=guyan", "modes=0", "compare_seats=false")
# Of the pinion; below the first of them higher harmonics of the mesh meet the modes of the teeth
# [rad/s].
SLOW = 700.0
SPEEDS = np.arange(200.0, 3001.0, 50.0)
# Of the strain energy of a mode: with less in the mesh it is not excited.
FAST = np.arange(1500.0, 3001.0, 100.0)


# --- Pairs in motion


class Moving(NamedTuple):
    """An example scene with changes, in motion."""

    scene: Scene
    model: PairModel
    dynamics: PairDynamics
    modes: Modes

    @property
    def system(self) -> DynamicSystem:
        """What moves."""
        return self.dynamics.system

    @property
    def ratio(self) -> float:
        """Speed of the wheel over the pinion's [-]."""
        pair = self.model.pair
        return pair.pinion.teeth / pair.wheel.teeth

    @property
    def sectors(self) -> tuple[int, int]:
        """Equal sectors of both bodies; 0: rigid."""
        bodies = self.scene.bodies
        each = [
            int(bodies[gear].built.body.facts["sectors"]) if gear in bodies else 0 for gear in GEARS
        ]
        return each[0], each[1]


# One at a time: a body's matrices take up to 300 MB.
@functools.lru_cache(maxsize=1)
def moving(name: str, *settings: str) -> Moving:
    """An example scene with changes, set in motion."""
    condensed = bool(example_scene(name).condensed)
    scene = example_scene(name, [*THESIS, *COARSE, *settings])
    if condensed:
        scene = with_bodies(scene, moving=True)
    return set_going(scene, model_of(scene))


_modes = jax.jit(modes)


def set_going(scene: Scene, model: PairModel) -> Moving:
    """A model of a scene, set in motion."""
    grid = grid_of(scene, model, scene.sweep.steps)

    dynamics = eqx.filter_jit(lambda model: dynamics_of(model, grid, scene))(model)
    system = dynamics.system
    whole = _modes(system.mass, system.whole_stiffness, system.mesh_stiffness, system.free)
    assert bool(jnp.all(dynamics.cycle.converged)), "the contact was not solved at some phase"
    return Moving(scene, model, dynamics, whole)


def without_growth(system: DynamicSystem) -> DynamicSystem:
    """The same without centrifugal load."""
    table, terms = system.table, system.turning
    assert table.growth is not None
    assert terms is not None
    table = dataclasses.replace(table, growth=0.0 * table.growth)
    terms = dataclasses.replace(terms, load=0.0 * terms.load)
    return dataclasses.replace(system, table=table, turning=terms)


_responses = eqx.filter_jit(steady_states)


@eqx.filter_jit
def line_loads(dynamics: PairDynamics, orbits: Orbit):
    """Largest line load over the largest at vanishing speed."""
    one = lambda orbit: dynamic_response(dynamics, orbit, 1, jg.ExactContact()).line_load_ratio
    return jax.lax.map(one, orbits)


class Curve(NamedTuple):
    """Dynamic ratio over speed, NaN where no response was found."""

    speed: np.ndarray
    ratio: np.ndarray

    @property
    def main(self) -> float:
        """Speed of the highest peak above `SLOW` [rad/s]."""
        return vertex(self.speed, np.where(self.speed > SLOW, np.nan_to_num(self.ratio), 0.0))


def sweep(system: DynamicSystem, speeds: np.ndarray = SPEEDS) -> tuple[Curve, Orbit]:
    """Responses of harmonic balance, each from the quasi-static state."""
    orbits = _responses(system, jnp.asarray(speeds), HarmonicBalance(harmonics=HARMONICS))
    ratio = np.asarray(orbits.load)[:, :, 0].max(axis=1) / float(system.force)
    return Curve(speeds, np.where(np.asarray(orbits.settled), ratio, np.nan)), orbits


def fine(system: DynamicSystem) -> Curve:
    """The sweep, with more speeds about its highest peak."""
    curve, _ = sweep(system)
    more = np.arange(curve.main - 45.0, curve.main + 46.0, 10.0)
    other, _ = sweep(system, more)
    order = np.argsort(speeds := np.concatenate([curve.speed, more]))
    return Curve(speeds[order], np.concatenate([curve.ratio, other.ratio])[order])


def vertex(speeds: np.ndarray, values: np.ndarray, at: int | None = None) -> float:
    """Where a parabola through a value, by default the largest, and its neighbours has its top."""
    at = int(np.argmax(values)) if at is None else at
    if at in (0, len(values) - 1):
        return float(speeds[at])
    a, b, _ = np.polyfit(speeds[at - 1 : at + 2] - speeds[at], values[at - 1 : at + 2], 2)
    return float(speeds[at] - 0.5 * b / a)


@functools.cache
def rigid(name: str) -> Curve:
    """The rigid pair as it is, with foundations."""
    return fine(moving(name).system)


def at_speeds(curve: Curve, speeds: np.ndarray) -> np.ndarray:
    """Ratios of a curve at speeds that are among its own."""
    return curve.ratio[np.searchsorted(curve.speed, speeds)]
