"""A scene to play with: its mesh cycle at other flanks and loads, in milliseconds, and slopes."""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._checks import require
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
from jaxgear.scene._schema import key_at
from jaxgear.study._coast import require_drive
from jaxgear.study._derivatives import Keys
from jaxgear.study._evaluations import Variation, variation_of
from jaxgear.study._head import require_load
from jaxgear.study._progress import built_scene
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
    - `variation`: how flanks change the model.
    - `grid`: phases, lines and slices.
    - `law`: contact law.
    """

    scene: Scene
    knobs: tuple[Knob, ...]
    variation: Variation
    grid: MeshGrid
    law: AbstractContactLaw

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

    def cycle(self, values: np.ndarray) -> dict[str, Any]:
        """The mesh cycle at values of the knobs, in plain numbers with units in their names.

        **Raises:**

        - `SolverFailure` if the contact was not solved.
        """
        seen = timed(_seen, *self._asked(values))
        require_solved(seen.converged)
        return {
            "numbers": {name: float(value) for name, value in seen.numbers.items()},
            "phase": np.arange(self.grid.phases * self.grid.periods) / self.grid.phases,
            "te_um": seen.error / um,
            "mesh_stiffness_N_um": seen.stiffness * um,
            **_pictured(seen),
        }

    def slopes(self, values: np.ndarray, response: str) -> dict[str, float]:
        """Derivatives of one of `RESPONSES` by every knob, in units of their names."""
        require(
            response in RESPONSES, "no response {got}; there are {of}.", got=response, of=RESPONSES
        )
        weights = np.asarray([float(name == response) for name in RESPONSES])
        found = timed(_slopes, *self._asked(values), weights)
        return dict(zip((knob.key for knob in self.knobs), np.asarray(found).tolist(), strict=True))

    def relief_curve(self, values: np.ndarray) -> dict[str, Any]:
        """RMS of the transmission error over the depth of tip relief, the same on both gears."""
        high = max(knob.high for knob in self.knobs if knob.key in _DEPTHS)
        depths = np.linspace(0.0, high, _POINTS)
        rms = timed(_curve, *self._asked(values), depths)
        return {"depth_um": depths, "te_rms_um": rms / um}

    def _asked(self, values: np.ndarray) -> tuple[Any, ...]:
        keys = _Keys(tuple(knob.key for knob in self.knobs), self.variation)
        return keys, self.grid, self.law, jnp.asarray(values)


class _Keys(eqx.Module):
    """Keys that move, and how the model follows.

    **Fields:**

    - `names`: of the keys.
    - `variation`: how flanks change the model.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    variation: Variation

    def model(self, values: Reals) -> PairModel:
        given = dict(zip(self.names, values, strict=True))
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
    require_load(scene, what="live scene")
    require_drive(scene, why="a live scene moves the torque")
    scene = built_scene(scene)
    base = model_of(scene)
    real = scene.real_keys()
    names = [key for key in real if key.startswith("flank.") and "eccentric" not in key]
    names += [key for key in _OF_MODEL if key in real]
    knobs = tuple(map(_knob, names, Keys(scene, tuple(names)).centre.tolist()))
    variation = variation_of(scene, base, flanks_only=True)
    return LiveScene(scene, knobs, variation, grid_of(scene, base), law_of(scene.mesh))


def _knob(path: str, value: float) -> Knob:
    """A key with the range that a user would look at."""
    key = key_at(path)
    assert key is not None
    if path.endswith("_um"):
        high = max(40.0, 2.0 * abs(value))
        low = -high
    elif path in _OF_MODEL:
        low, high = 0.1 * value, 2.0 * value
    else:
        low, high = min(0.5 * value, 0.05), max(2.0 * value, 0.6)
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

    def weighted(values: Reals) -> Scalar:
        model = keys.model(values)
        cycle = mesh_cycle(model, grid, law=law, throw=False)
        numbers = headline(model, cycle, law)
        return weights @ jnp.stack([numbers[name] for name in RESPONSES])

    return jax.grad(weighted)(values)


def _curve(
    keys: _Keys, grid: MeshGrid, law: AbstractContactLaw, values: Reals, depths: Reals
) -> Reals:
    """RMS of the transmission error at each depth [m]."""
    both = np.asarray([name in _DEPTHS for name in keys.names])

    def rms(depth: Scalar) -> Scalar:
        model = keys.model(jnp.where(both, depth, values))
        cycle = mesh_cycle(model, grid, law=law, throw=False)
        return cycle_rms(cycle, transmission_error(model.pair, cycle))

    return jax.vmap(rms)(depths)


def _pictured(seen: _Seen) -> dict[str, Any]:
    """Largest pressure over the cycle on the flank `[bin along the path, slice]`, and along it."""
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
    return {
        "path_mm": [low, high],
        "pressure_MPa": largest,
        "face_load_N_mm": load.max(axis=0),
    }
