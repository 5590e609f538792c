"""What [optimise] asks for: variables and their bounds, the objective, the search."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._app._model import flanks_of, model_of
from jaxgear._app._scene import Scene
from jaxgear._app._schema import GEARS
from jaxgear._app._statics import Stopwatch
from jaxgear._checks import InputError
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._system._model import PairModel
from jaxgear._types import Reals, Scalar


class DesignSpace(eqx.Module):
    """The variables of an optimisation, in file units.

    **Fields:**

    - `scene`: whose keys they are.
    - `keys`: dotted path of each variable.
    - `symmetric`: whether the other gear's flank follows.
    - `base`: model of the scene itself.
    - `start`: value of each variable in the scene, in the unit of its key [-].
    - `box`: bounds of each variable, in the unit of its key.
    """

    scene: Scene = eqx.field(static=True)
    keys: tuple[str, ...] = eqx.field(static=True)
    symmetric: bool = eqx.field(static=True)
    base: PairModel
    start: np.ndarray
    box: optimise.Box

    def updates(self, values: Reals) -> dict[str, Scalar]:
        """Scene keys and their values at a point of the space, in the units of the keys."""
        pairs = dict(zip(self.keys, values, strict=True))
        if self.symmetric:
            pairs |= {_twin(key): value for key, value in pairs.items()}
        return pairs

    def model(self, values: Reals) -> PairModel:
        """The model at a point of the space; traceable by JAX."""
        scene = self.scene.replace(self.updates(values))
        if self.flanks_only:
            return eqx.tree_at(lambda model: model.flanks, self.base, flanks_of(scene))
        return model_of(scene)

    def at_bounds(self, point: np.ndarray) -> list[str]:
        """The variables that ended on a bound: it, not the objective, decided their values."""
        unit = self.box.to_unit(point)
        return [key for key, place in zip(self.keys, unit, strict=True) if place in (0.0, 1.0)]

    def require_symmetric_start(self) -> None:
        """Refuse a symmetric search from two different flanks: it would start from neither."""
        for key in self.keys if self.symmetric else ():
            mine, other = self.scene[key], self.scene[_twin(key)]
            if mine != other:
                raise InputError(
                    f"With optimise.symmetric both gears must start alike, but {key} is {mine:g} "
                    f"and {_twin(key)} is {other:g}. Make them equal, or set symmetric = false."
                )

    @property
    def flanks_only(self) -> bool:
        """Whether every variable is a flank correction."""
        return all(key.startswith("flank.") for key in self.keys)


_NOT_VARIABLE = ("pair.torque_pinion_Nm", "mesh.smoothing_um")


def _twin(key: str) -> str:
    """The same key of the other gear's flank; a key that is no flank's is its own twin."""
    for gear, other in (GEARS, GEARS[::-1]):
        if key.startswith(f"flank.{gear}."):
            return key.replace(gear, other, 1)
    return key


def design_space(
    scene: Scene, keys: tuple[str, ...], *, symmetric: bool, deflection: float
) -> DesignSpace:
    """The space that some keys of a scene span.

    **Arguments:**

    - `scene`: gives start and bounds.
    - `keys`: the variables.
    - `symmetric`: whether the other gear's flank follows.
    - `deflection`: of a single tooth pair, the scale of depths [um].

    **Returns:**

    The space.

    **Raises:**

    - `InputError` if a key has no effect, or no bounds and none can be guessed, or if two
        variables are the same.
    """
    if dead := [key for key in keys if key in _NOT_VARIABLE or key not in scene.real_keys()]:
        raise InputError(
            f"optimise.vary names {', '.join(dead)}, which no objective depends on: torques are "
            "optimise.torques_Nm, the smoothing width belongs to the method, and a stiffness "
            "counts only if mesh.stiffness uses it. Remove it."
        )
    if symmetric and (both := [key for key in keys if _twin(key) != key and _twin(key) in keys]):
        raise InputError(
            f"With optimise.symmetric the two gears share each correction, but optimise.vary names "
            f"both of {', '.join(both)}. Name one, or set symmetric = false."
        )
    base = model_of(scene)
    bounds = np.asarray([_bounds(scene, key, deflection) for key in keys], dtype=float)
    start = np.asarray([scene[key] for key in keys], dtype=float)
    return DesignSpace(
        scene=scene,
        keys=keys,
        symmetric=symmetric,
        base=base,
        start=start,
        box=optimise.Box(lower=bounds[:, 0], upper=bounds[:, 1]),
    )


def _bounds(scene: Scene, key: str, deflection: float) -> tuple[float, float]:
    """Given bounds of a variable, or three deflections for a depth, half the path for an extent."""
    given = scene.get(f"optimise.bounds.{key}")
    if given is not None:
        return given[0], given[1]
    most = max(round_up(3.0 * deflection), 2.0 * abs(float(scene[key])))
    name = key.rpartition(".")[2]
    if name == "extent":
        return min(0.02, scene[key]), max(0.5, scene[key])
    if name in ("depth_um", "crowning_um"):
        return 0.0, most
    if name == "helix_slope_um" or name.startswith("misalignment"):
        return -most, most
    raise InputError(
        f"optimise.vary names {key}, for which no bounds can be guessed. Add them: "
        f"[optimise.bounds] with {key} = [lowest, highest]."
    )


def round_up(value: float) -> float:
    """The next round number: 1, 2, 2.5, 4, 5 or 8 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(
        next(r * power for r in (1.0, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0) if r * power >= value)
    )


_OBJECTIVES = {
    "te_rms": optimise.TransmissionErrorRms,
    "te_peak_to_peak": optimise.TransmissionErrorRange,
    "max_pressure": optimise.LargestPressure,
}


def objective_of(scene: Scene) -> tuple[optimise.AbstractObjective, str]:
    """The objective that a scene asks for, and its unit.

    **Arguments:**

    - `scene`: with `optimise.minimise`, a name or a table of weights.

    **Returns:**

    The objective and the unit of its value.
    """
    weights = {
        name: scene[f"optimise.minimise.{name}"]
        for name in _OBJECTIVES
        if f"optimise.minimise.{name}" in scene.values
    }
    if weights:
        parts = tuple(_OBJECTIVES[name]() for name in weights)
        return optimise.WeightedSum(parts=parts, weights=list(weights.values())), "weighted"
    match scene["optimise.minimise"]:
        case "te_rms":
            return optimise.TransmissionErrorVariance(), "um2"
        case "te_peak_to_peak":
            return optimise.TransmissionErrorRange(), "um"
        case _:
            return optimise.LargestPressure(), "MPa"


def torques_of(scene: Scene) -> np.ndarray:
    """Pinion torques over which the objective is taken [N m]."""
    return np.asarray(scene.get("optimise.torques_Nm", [scene["pair.torque_pinion_Nm"]]), float)


def prepared_mesh(space: DesignSpace, grid: MeshGrid, watch: Stopwatch) -> PreparedMesh | None:
    """The meshes at the scene's torques, if the variables leave them as they are."""
    if not space.flanks_only:
        return None
    torques = jnp.asarray(torques_of(space.scene))
    return watch(lambda model, t: optimise.prepare_torques(model, t, grid), space.base, torques)


def objective_function(
    space: DesignSpace, grid: MeshGrid, law: AbstractContactLaw, prepared: PreparedMesh | None
) -> Callable[[Reals], Scalar]:
    """The objective as a function of the variables, over all torques of the scene."""
    objective, _ = objective_of(space.scene)
    return optimise.over_torques(
        space.model,
        objective,
        jnp.asarray(torques_of(space.scene)),
        grid=grid,
        law=law,
        worst=space.scene["optimise.over"] == "worst",
        prepared=prepared,
    )
