"""What a scene's responses react to: the derivatives that `check-grad` proves, in shares.

One sensitivity compares keys of any unit: per cent of a response per per cent of a key. A key in
micrometres is a deviation from the nominal and often 0: for it, per cent per micrometre; for
others that are 0, such as a profile shift, per cent per 0.01.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxgear._dynamics._system import PairDynamics
from jaxgear._interface._laws import ExactContact
from jaxgear._response._loads import mesh_stiffness
from jaxgear._response._transmission import cycle_mean
from jaxgear._solve._cycle import mesh_cycle
from jaxgear._types import Flags, Reals
from jaxgear._units import um
from jaxgear.plot._picture import Columns
from jaxgear.scene._build import grid_of, law_of, model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import split_entry
from jaxgear.study._dynamics import (
    MOST_UNKNOWNS,
    dynamic_grid_of,
    dynamics_of,
    size_of,
    speeds_of,
    unknowns_of,
)
from jaxgear.study._gradients import (
    _UNFUSED,
    SPEED,
    SteadyPoint,
    _damping_keys,
    _dynamic_names,
    _method,
    _moving,
    _steady_derivatives,
    _steady_point,
)
from jaxgear.study._running import timed
from jaxgear.study._statics import headline, require_solved

STATIC = (
    "te_mean_um",
    "te_rms_um",
    "max_pressure_MPa",
    "face_load_factor",
    "mesh_stiffness_mean_N_um",
)

# Smaller sensitivities are rounding.
LEAST = 1e-9
# Speeds of [sweep] at which sensitivities are found: the first, the last and between them.
_FEW_SPEEDS = 3


@dataclasses.dataclass(frozen=True)
class Sensitivities:
    """How responses react to keys.

    **Fields:**

    - `responses`: names, with their units; those in motion are repeated for each speed.
    - `speeds`: of the pinion for each response, or NaN of the quasi-static cycle [rad/s].
    - `values`: of the responses, in the units of their names.
    - `keys`: dotted paths, with their units.
    - `measures`: of each key: `%/%`, `%/um`, or, of another key that is 0, `%/0.01`
        of its unit.
    - `numbers`: sensitivities `[response, key]`, by measure; NaN where there is none.
    """

    responses: tuple[str, ...]
    speeds: np.ndarray
    values: np.ndarray
    keys: tuple[str, ...]
    measures: tuple[str, ...]
    numbers: np.ndarray

    def sorted(self) -> "Sensitivities":
        """The keys that act, the strongest first, those of one measure together."""
        most = np.max(np.abs(np.nan_to_num(self.numbers)), axis=0, initial=0.0)
        order = ("%/%", "%/um", "%/0.01")
        acting = [j for j in range(len(self.keys)) if most[j] > LEAST]
        acting.sort(key=lambda j: (order.index(self.measures[j]), -most[j]))
        return dataclasses.replace(
            self,
            keys=tuple(self.keys[j] for j in acting),
            measures=tuple(self.measures[j] for j in acting),
            numbers=self.numbers[:, acting],
        )

    def told(self) -> dict[str, dict[str, object]]:
        """The table for the summary: for each response its value and its keys, strongest first."""
        table = {}
        for i, name in enumerate(self.responses):
            at = "" if np.isnan(self.speeds[i]) else f"_at_{self.speeds[i]:g}_rad_s"
            own = self.numbers[i]
            order = sorted(range(len(self.keys)), key=lambda j: -abs(np.nan_to_num(own[j])))
            acting = [j for j in order if abs(np.nan_to_num(own[j])) > LEAST]
            table[name + at] = {"value": float(self.values[i])} | {
                f"{self.keys[j]} [{self.measures[j]}]": float(own[j]) for j in acting
            }
        return table

    def lost(self) -> list[str]:
        """A sentence on keys by which no response has a derivative, if there are any."""
        none = np.all(np.isnan(self.numbers), axis=0).tolist()
        keys = ", ".join(key for key, gone in zip(self.keys, none, strict=True) if gone)
        if not keys:
            return []
        return [
            f"No response has a derivative by {keys}. In motion that is so where natural modes "
            'that the mesh loads coincide: modal damping has none there, damping.kind = "rayleigh" '
            "has one."
        ]

    def columns(self) -> Columns:
        """One row for each response and key, under names with units."""
        count, each = len(self.responses), len(self.keys)
        speed = {"pinion_speed_rad_s": np.repeat(self.speeds, each)}
        return {
            "response": np.repeat(self.responses, each),
            **(speed if np.isfinite(self.speeds).any() else {}),
            "value": np.repeat(self.values, each),
            "key": np.tile(self.keys, count),
            "measure": np.tile(self.measures, count),
            "sensitivity": self.numbers.ravel(),
        }


# What a reader of the table has to know.
OF_BODIES = (
    "Young's modulus of a condensed body, with its shaft, is a key of its own here, "
    "body.young_GPa: that of the material is then of the teeth, the contact and all rigid gears' "
    "shafts."
)


def with_own_modulus(scene: Scene) -> Scene:
    """A scene whose condensed bodies each have the key of their own Young's modulus.

    Its value is that of the gear's material, so that nothing changes but what can be told apart:
    the body from the teeth and the other parts.

    **Arguments:**

    - `scene`: checked against the schema, its bodies not yet built.

    **Returns:**

    The scene.
    """
    added = {}
    for gear in scene.condensed:
        known = [f"{gear}.body.young_GPa", f"{gear}.body.superelement"]
        if all(scene.get(key) is None for key in known):
            shared = scene["material.young_GPa"]
            added[known[0]] = scene.get(f"{gear}.material.young_GPa", shared)
    return scene.replace(added)


def static_sensitivities(scene: Scene) -> Sensitivities:
    """How the quasi-static responses of a scene react to all of its real keys.

    **Arguments:**

    - `scene`: with its bodies.

    **Returns:**

    The sensitivities, the contact as the scene has it. The largest pressure is that of one place:
    where two are equal, the mean of what moves either.

    **Raises:**

    - `SolverFailure` if a phase was not solved.
    """
    keys, law = scene.real_keys(), law_of(scene)
    grid = grid_of(scene, model_of(scene))

    def respond(values: Reals) -> tuple[Reals, Flags]:
        model = model_of(scene.replace(dict(zip(keys, values, strict=True))))
        cycle = mesh_cycle(model, grid, law=law, throw=False)
        numbers = headline(model, cycle, law)
        stiffness = cycle_mean(cycle, mesh_stiffness(cycle)) * um
        found = [numbers[name] for name in STATIC[:-1]]
        return jnp.stack([*found, stiffness]), cycle.converged

    def derivatives(values: Reals) -> tuple[Reals, Reals, Flags]:
        value, push, converged = jax.linearize(respond, values, has_aux=True)
        return value, jax.lax.map(push, jnp.eye(len(keys))).T, converged

    centre = np.asarray([scene[key] for key in keys], dtype=float)
    value, slopes, converged = timed(derivatives, jnp.asarray(centre), options=_UNFUSED)
    require_solved(converged)
    still = np.full(len(STATIC), np.nan)
    return _in_shares(STATIC, still, np.asarray(value), keys, centre, np.asarray(slopes))


def moving_sensitivities(scene: Scene) -> tuple[Sensitivities | None, list[SteadyPoint]]:
    """How steady responses react to all real keys, damping and speed, at a few speeds of [sweep].

    **Arguments:**

    - `scene`: with a table [sweep], and its bodies.

    **Returns:**

    The sensitivities, exact contact, or `None` if no response has any; and how each speed went.

    **Raises:**

    - `SolverFailure` if a phase was not solved.
    """
    every = speeds_of(scene)
    places = np.unique(np.round(np.linspace(0, len(every) - 1, _FEW_SPEEDS)).astype(int))
    keys = scene.real_keys() + _damping_keys(scene)
    own = np.asarray([scene[key] for key in keys], dtype=float)
    grid = dynamic_grid_of(scene, model_of(scene))

    def flat(values: Reals) -> tuple[Reals, PairDynamics]:
        changed = scene.replace(dict(zip(keys, values, strict=True)))
        dynamics = dynamics_of(changed, model_of(changed), grid)
        return ravel_pytree(eqx.filter(_moving(dynamics), eqx.is_inexact_array))[0], dynamics

    def linearised(values: Reals) -> tuple[Reals, PairDynamics, Reals]:
        value, push, dynamics = jax.linearize(flat, values, has_aux=True)
        return value, dynamics, jax.lax.map(push, jnp.eye(len(keys)))

    value, dynamics, columns = timed(linearised, jnp.asarray(own), options=_UNFUSED)
    require_solved(dynamics.cycle.converged)
    if unknowns_of(scene, size_of(dynamics)) > MOST_UNKNOWNS:
        return None, [SteadyPoint("exact", every[0], None, None, "too many unknowns")]
    steady = _steady_derivatives(_method(scene, dynamics, ExactContact()))
    names, points, found = _dynamic_names(dynamics), [], []
    for speed in every[places]:
        numbers, slopes, *_, seen = timed(steady, value, jnp.asarray(speed), dynamics, columns)
        points.append(_steady_point("exact", float(speed), seen))
        if points[-1].verdict == "ok":
            at = np.append(own, speed)
            still = np.full(len(names), speed)
            parts = names, still, np.asarray(numbers), (*keys, SPEED), at, np.asarray(slopes).T
            found.append(_in_shares(*parts))
    return _joined(found) if found else None, points


def _joined(found: list[Sensitivities]) -> Sensitivities:
    """Those of several speeds as one."""
    return dataclasses.replace(
        found[0],
        responses=tuple(name for each in found for name in each.responses),
        speeds=np.concatenate([each.speeds for each in found]),
        values=np.concatenate([each.values for each in found]),
        numbers=np.concatenate([each.numbers for each in found]),
    )


def _in_shares(
    responses: tuple[str, ...],
    speeds: np.ndarray,
    values: np.ndarray,
    keys: tuple[str, ...],
    centre: np.ndarray,
    slopes: np.ndarray,
) -> Sensitivities:
    """Derivatives `[response, key]` in per cent."""
    measures = tuple(map(_measure, keys, centre))
    # Per cent of a response per 0.01 of a key is its relative change per one of it.
    scales = {"%/um": 100.0, "%/0.01": 1.0}
    per = [scales.get(measure, at) for measure, at in zip(measures, centre, strict=True)]
    with np.errstate(divide="ignore", invalid="ignore"):
        numbers = slopes * np.asarray(per) / values[:, None]
    numbers = np.where(np.isfinite(numbers), numbers, np.nan)
    return Sensitivities(responses, speeds, values, keys, measures, numbers)


def _measure(key: str, value: float) -> str:
    if split_entry(key)[0].endswith("_um"):
        return "%/um"
    return "%/%" if value else "%/0.01"
