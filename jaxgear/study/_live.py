"""A scene to play with: its mesh cycle at other flanks and loads, in milliseconds, and slopes.

Other real keys move too: the model is built anew for them, outside of the programs.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._checks import InputError, require
from jaxgear._columns import Table
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._loads import hertz_pressure, line_load, mesh_stiffness
from jaxgear._response._transmission import cycle_rms, transmission_error
from jaxgear._solve._cycle import mesh_cycle
from jaxgear._system._model import PairModel
from jaxgear._types import Flag, Reals, Scalar
from jaxgear._units import MPa, mm, um
from jaxgear.scene._build import grid_of, law_of, model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import REAL_KEYS, general, key_at
from jaxgear.study._built import built_scene
from jaxgear.study._coast import on_coast
from jaxgear.study._derivatives import Keys, usual_size
from jaxgear.study._evaluations import Variation, variation_of
from jaxgear.study._head import without_load
from jaxgear.study._running import timed
from jaxgear.study._statics import headline, require_solved

# Keys of the model itself that move without another program, and where they are in it.
_OF_MODEL = {
    "pair.torque_pinion_Nm": (lambda model: model.torque, 1.0),
    "pair.misalignment_inclination_um": (lambda model: model.misalignment.inclination, um),
    "pair.misalignment_deviation_um": (lambda model: model.misalignment.deviation, um),
}
_DEPTHS = ("flank.pinion.tip_relief.depth_um", "flank.wheel.tip_relief.depth_um")
# Responses that have slopes, of those that are told.
RESPONSES = ("te_rms_um", "te_mean_um", "te_peak_to_peak_um", "max_pressure_MPa")
RESPONSES += ("max_line_load_N_mm", "face_load_factor", "transverse_load_factor")
# Bins along the path of contact in a picture of pressure, and depths of a curve.
_BINS, _POINTS = 48, 25


class Knob(NamedTuple):
    """A key that may be moved.

    **Fields:**

    - `key`: its path; the unit is in its name.
    - `value`: of the scene, in that unit.
    - `low`, `high`: between which it may be moved.
    - `unit`: of the three.
    - `meaning`: for a reader.
    """

    key: str
    value: float
    low: float
    high: float
    unit: str
    meaning: str


class _Seen(NamedTuple):
    """What is told of one cycle, in SI but for the numbers, which have units in their names."""

    numbers: dict[str, Scalar]
    error: Reals
    stiffness: Reals
    load: Reals
    pressure: Reals
    roll: Reals
    converged: Flag


@dataclasses.dataclass(frozen=True)
class LiveScene:
    """A scene whose flanks, torque and misalignment move without compiling again.

    **Fields:**

    - `scene`: where it begins.
    - `knobs`: what may be moved.
    - `model`: of the scene.
    - `built`: keys among those of the knobs for which the model is built anew.
    """

    scene: Scene
    knobs: tuple[Knob, ...]
    model: PairModel
    built: tuple[str, ...] = ()

    @property
    def others(self) -> tuple[str, ...]:
        """Real keys that are no knobs yet."""
        known = {knob.key for knob in self.knobs}
        return tuple(key for key in self.scene.real_keys() if key not in known)

    def with_key(self, key: str) -> "LiveScene":
        """The same with one knob more, of any real key.

        **Raises:**

        - `ValueError` if the key is none of `others`, with the reason.
        """
        if any(knob.key == key for knob in self.knobs):
            return self
        if key not in self.others:
            remade = any(self.scene.remakes(key, gear) for gear in self.scene.condensed)
            raise InputError(_why_not(key, shapes_body=remade))
        knob = _knob(key, float(self.scene.value(key)))
        return dataclasses.replace(self, knobs=(*self.knobs, knob), built=(*self.built, key))

    def values(self, changes: Mapping[str, float]) -> np.ndarray:
        """Values of all knobs, with some changed, each in its unit.

        **Raises:**

        - `ValueError` if a key is no knob, or its value is not within its bounds.
        """
        known = {knob.key: knob for knob in self.knobs}
        for key, value in changes.items():
            require(key in known, "{key} is not among the keys that move here.", key=key)
            least, most = known[key].low, known[key].high
            require(
                least <= value <= most,
                "{key} must be between {least:g} and {most:g}, got {value:g}.",
                key=key,
                least=least,
                most=most,
                value=value,
            )
        return np.asarray([changes.get(knob.key, knob.value) for knob in self.knobs], dtype=float)

    def cycle(self, values: np.ndarray) -> "LiveCycle":
        """The mesh cycle at values of the knobs.

        **Raises:**

        - `SolverFailure` if the contact was not solved.
        """
        keys, grid, *more = self._asked(values)
        seen = timed(_seen, keys, grid, *more)
        require_solved(seen.converged)
        numbers = {name: float(value) for name, value in seen.numbers.items()}
        return _pictured(seen, numbers, np.arange(grid.phases * grid.periods) / grid.phases)

    def slopes(self, values: np.ndarray, response: str) -> dict[str, float]:
        """Derivatives of one of `RESPONSES` by every knob, in units of their names.

        In reverse by what moves within the program, forward by what the model is built from.
        """
        require(
            response in RESPONSES, "no response {got}; there are {of}.", got=response, of=RESPONSES
        )
        weights = np.asarray([float(name == response) for name in RESPONSES])
        asked = self._asked(values)
        found = np.asarray(timed(_slopes, *asked, weights)).tolist()
        scene = self._at(values)
        for key in self.built:
            along = _model_along(Keys(scene, (key,)))
            found.append(float(weights @ timed(_pushed, *asked, along)))
        return dict(zip((knob.key for knob in self.knobs), found, strict=True))

    def relief_curve(self, values: np.ndarray) -> Table:
        """RMS of the transmission error over the depth of tip relief, the same on both gears."""
        high = max(knob.high for knob in self.knobs if knob.key in _DEPTHS)
        depths = np.linspace(0.0, high, _POINTS)
        rms = timed(_curve, *self._asked(values), depths)
        return Table({"depth_um": depths, "te_rms_um": rms / um})

    def _at(self, values: np.ndarray) -> Scene:
        """The scene with the values of the keys for which the model is built anew."""
        own = len(self.knobs) - len(self.built)
        return self.scene.replace(
            dict(zip(self.built, np.asarray(values)[own:].tolist(), strict=True))
        )

    def _asked(self, values: np.ndarray) -> tuple[Any, ...]:
        """What the programs take: how the model follows, the grid that a run has, and values."""
        scene = self._at(values)
        model = model_of(scene) if self.built else self.model
        own = len(self.knobs) - len(self.built)
        names = tuple(knob.key for knob in self.knobs[:own])
        keys = _Keys(names, variation_of(scene, model, flanks_only=True))
        return keys, grid_of(scene, model), law_of(scene.mesh), jnp.asarray(values)[:own]


class _Keys(eqx.Module):
    """Keys that move, and how the model follows.

    **Fields:**

    - `names`: of the keys.
    - `variation`: how flanks change the model.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    variation: Variation

    def model(self, values: Reals) -> PairModel:
        given = dict(zip(self.names, jnp.unstack(values), strict=True))
        of_model = {key: given.pop(key) for key in _OF_MODEL if key in given}
        model = self.variation.model(given)
        for key, value in of_model.items():
            where, unit = _OF_MODEL[key]
            model = eqx.tree_at(where, model, value * unit)
        return model


def live_scene(scene: Scene) -> LiveScene:
    """Prepare a scene to be played with: its flanks, torque and misalignment.

    **Arguments:**

    - `scene`: checked against the schema.

    **Raises:**

    - `ValueError` if the gears are impossible.
    """
    scene.refuse(without_load(scene.plain.pair, what="live scene"))
    scene.refuse(on_coast(scene.plain.pair, why="a live scene moves the torque"))
    built = built_scene(scene)
    scene = built.scene
    real = scene.real_keys()
    names = [key for key in real if key.startswith("flank.") and "eccentric" not in key]
    names += [key for key in _OF_MODEL if key in real]
    knobs = tuple(_knob(name, float(scene.value(name))) for name in names)
    return LiveScene(scene, knobs, built.model)


def _why_not(path: str, *, shapes_body: bool) -> str:
    """Why a key has no knob."""
    key = key_at(path)
    if key is None:
        return f"{path} is no key of a scene: `jaxgear keys` looks them up."
    if shapes_body:
        return f"{path} shapes a condensed body, which is built apart: set it in the scene."
    if general(path) in REAL_KEYS or f"{general(path)}[]" in REAL_KEYS:
        return f"{path} is not in this scene, or does nothing in it: set it in the scene."
    return f"{path} is no real number that moves on its own: set it in the scene."


def _knob(path: str, value: float) -> Knob:
    """A key with the range that a user would look at."""
    key = key_at(path)
    assert key is not None
    if path.endswith("_um"):
        high = max(40.0, 2.0 * abs(value))
        low = -high
    elif path in _OF_MODEL:
        low, high = 0.1 * value, 2.0 * value
    elif path.startswith("flank."):
        low, high = min(0.5 * value, 0.05), max(2.0 * value, 0.6)
    else:
        size = max(usual_size(path, value), 20.0 if path.endswith("_deg") else 0.0)
        low, high = value - 0.5 * size, value + 0.5 * size
    bounds = [
        (key.at_least, max, low),
        (key.at_most, min, high),
    ]
    low, high = (chosen(at, edge) if edge is not None else at for edge, chosen, at in bounds)
    # An open bound is no place to stand on.
    if key.above is not None and low <= key.above:
        low = key.above + 0.01 * (high - key.above)
    if key.below is not None and high >= key.below:
        high = key.below - 0.01 * (key.below - low)
    return Knob(path, value, low, high, key.unit, key.doc)


def _model_along(key: Keys) -> PairModel:
    """How the model moves with one key, per unit of its name.

    A number that does not move has a zero, so that one program serves all keys.
    """
    build = lambda value: eqx.filter(model_of(key.moved(value)), eqx.is_inexact_array)
    value = jnp.asarray(key.centre)
    model, along = eqx.filter_jvp(build, (value,), (jnp.ones_like(value),))
    either = lambda number, moves: jnp.zeros_like(number) if moves is None else moves
    return jax.tree.map(either, model, along)


def _pushed(
    keys: _Keys,
    grid: MeshGrid,
    law: AbstractContactLaw,
    values: Reals,
    along: PairModel,
) -> Reals:
    """Derivatives of all responses as the model that flanks change moves along, forward."""

    def told(base: PairModel) -> Reals:
        moved = eqx.tree_at(lambda each: each.variation.base, keys, base)
        return _told(moved, grid, law, values)

    return eqx.filter_jvp(told, (keys.variation.base,), (along,))[1]


def _told(keys: _Keys, grid: MeshGrid, law: AbstractContactLaw, values: Reals) -> Reals:
    model = keys.model(values)
    cycle = mesh_cycle(model, grid, law=law, throw=False)
    numbers = headline(model, cycle, law)
    return jnp.stack([numbers[name] for name in RESPONSES])


def _seen(keys: _Keys, grid: MeshGrid, law: AbstractContactLaw, values: Reals) -> _Seen:
    model = keys.model(values)
    cycle = mesh_cycle(model, grid, law=law, throw=False)
    return _Seen(
        numbers=headline(model, cycle, law),
        error=transmission_error(model.pair, cycle),
        stiffness=mesh_stiffness(cycle),
        load=line_load(cycle, law),
        pressure=hertz_pressure(model.pair, cycle, law),
        roll=cycle.cells.lines.roll,
        converged=jnp.all(cycle.converged),
    )


def _slopes(
    keys: _Keys, grid: MeshGrid, law: AbstractContactLaw, values: Reals, weights: Reals
) -> Reals:
    """Derivatives of a weighted sum of the responses by all values, in reverse."""
    return jax.grad(lambda values: weights @ _told(keys, grid, law, values))(values)


def _curve(
    keys: _Keys, grid: MeshGrid, law: AbstractContactLaw, values: Reals, depths: Reals
) -> Reals:
    """RMS of the transmission error at each depth [m]."""
    both = np.asarray([name in _DEPTHS for name in keys.names])

    def rms(depth: Scalar) -> Scalar:
        model = keys.model(jnp.where(both, depth, values))
        cycle = mesh_cycle(model, grid, law=law, throw=False)
        return cycle_rms(cycle, transmission_error(model.pair, cycle))

    # One after the other: side by side each would wait for the longest search for contact.
    return jax.lax.map(rms, depths)


class LiveCycle(NamedTuple):
    """What is shown of a mesh cycle, in plain numbers with units in their names.

    **Fields:**

    - `numbers`: by their names in a summary.
    - `phase`: in mesh periods, of the transmission error and the mesh stiffness.
    - `te_um`, `mesh_stiffness_N_um`: over phase.
    - `path_mm`: between which teeth touch, along the path of contact.
    - `pressure_MPa`: the largest over the cycle on the flank, `[bin along the path, slice]`.
    - `face_load_N_mm`: the largest over the cycle at each slice.
    """

    numbers: Mapping[str, float]
    phase: np.ndarray
    te_um: np.ndarray
    mesh_stiffness_N_um: np.ndarray
    path_mm: list[float]
    pressure_MPa: np.ndarray
    face_load_N_mm: np.ndarray


def _pictured(seen: _Seen, numbers: Mapping[str, float], phase: np.ndarray) -> LiveCycle:
    """A cycle as it is shown."""
    slices = seen.roll.shape[-1]
    roll = np.asarray(seen.roll).reshape(-1, slices)
    pressure = np.asarray(seen.pressure).reshape(-1, slices) / MPa
    load = np.asarray(seen.load).reshape(-1, slices) * mm
    touching = pressure > 0.0
    low, high = (edge(roll[touching]) / mm for edge in (np.min, np.max))
    span = max(high - low, 1e-9)
    bins = np.clip((_BINS * (roll / mm - low) / span).astype(int), 0, _BINS - 1)
    largest = np.zeros((_BINS, slices))
    columns = np.broadcast_to(np.arange(slices), roll.shape)
    np.maximum.at(largest, (bins[touching], columns[touching]), pressure[touching])
    return LiveCycle(
        numbers=numbers,
        phase=phase,
        te_um=np.asarray(seen.error) / um,
        mesh_stiffness_N_um=np.asarray(seen.stiffness) * um,
        path_mm=[low, high],
        pressure_MPa=largest,
        face_load_N_mm=load.max(axis=0),
    )
