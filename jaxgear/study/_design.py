"""What [optimise] asks for: variables and their bounds, the objective, the search."""

import dataclasses
import itertools
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._checks import InputError
from jaxgear._dynamics._damping import ModalDamping, RayleighDamping
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._system._gear_body import BeamBody
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft, drawn_heights
from jaxgear._types import Reals, Scalar
from jaxgear._units import mm
from jaxgear.scene._build import model_of, shared_places
from jaxgear.scene._motion import motion_mistakes
from jaxgear.scene._scene import Mistake, Scene, SceneError
from jaxgear.scene._schema import GEARS, split_entry, unit_of
from jaxgear.study._dynamics import damping_of, dynamic_grid_of, speeds_of
from jaxgear.study._evaluations import Task, Variation, variation_of
from jaxgear.study._running import timed
from jaxgear.study._statics import Statics, torques_of


class DesignSpace(eqx.Module):
    """The variables of an optimisation, in file units.

    **Fields:**

    - `scene`: whose keys they are.
    - `keys`: dotted path of each variable.
    - `symmetric`: whether the other gear's flank follows.
    - `ties`: dotted paths of other keys, and of the variable that each follows.
    - `base`: model of the scene itself.
    - `start`: value of each variable in the scene, in the unit of its key [-].
    - `box`: bounds of each variable, in the unit of its key.
    """

    scene: Scene = eqx.field(static=True)
    keys: tuple[str, ...] = eqx.field(static=True)
    symmetric: bool = eqx.field(static=True)
    ties: tuple[tuple[str, str], ...] = eqx.field(static=True)
    base: PairModel
    start: np.ndarray
    box: optimise.Box

    def updates(self, values: Reals | np.ndarray) -> dict[str, Any]:
        """Scene keys and their values at a point of the space, in the units of the keys."""
        pairs = dict(zip(self.keys, values, strict=True))
        if self.symmetric:
            pairs |= {twin(key): value for key, value in pairs.items()}
        return pairs | {key: pairs[owner] for key, owner in self.ties}

    def model(self, values: Reals | np.ndarray) -> PairModel:
        """The model at a point of the space; traceable by JAX."""
        return self.variation.model(self.updates(values))

    @property
    def variation(self) -> Variation:
        """How the variables change the model."""
        return variation_of(self.scene, self.base, flanks_only=self.flanks_only)

    @property
    def moved(self) -> tuple[tuple[str, ...], ...]:
        """Each variable's key, and those of all that follows it."""
        followers = {key: [key] for key in self.keys}
        for key in self.keys if self.symmetric else ():
            followers[key] += {twin(key)} - {key}
        for key, owner in self.ties:
            followers[owner].append(key)
        return tuple(map(tuple, followers.values()))

    def at_bounds(self, point: np.ndarray) -> list[str]:
        """The variables that ended on a bound: it, not the objective, decided their values."""
        unit = self.box.to_unit(point)
        near = np.minimum(unit, 1.0 - unit) <= _AT_BOUND
        return [key for key, at in zip(self.keys, near, strict=True) if at]

    def require_tied_start(self) -> None:
        """Refuse a search from tied values that differ: it would start from neither."""
        for key in self.keys if self.symmetric else ():
            mine, other = self.scene[key], self.scene.get(twin(key))
            if mine != other:
                theirs = "left out" if other is None else f"{other:g}"
                raise InputError(
                    f"With optimise.symmetric both gears must start alike, but {key} is {mine:g} "
                    f"and {twin(key)} is {theirs}. Make them equal, or set symmetric = false."
                )
        for key, owner in self.ties:
            mine, other = self.scene.get(key), self.scene[owner]
            if mine is None:
                raise InputError(
                    f"With optimise.symmetric {key} follows {owner} too, but it is left out. Give "
                    f"it the value {other:g}, or set symmetric = false."
                )
            if mine != other:
                raise InputError(
                    f"optimise.ties makes {key} follow {owner}, but they start at {mine:g} and "
                    f"{other:g}. Make them equal."
                )

    @property
    def flanks_only(self) -> bool:
        """Whether every variable is a flank correction."""
        return all(key.startswith("flank.") for key in (*self.keys, *dict(self.ties)))


# Of the range of a variable, how close to a bound counts as on it: least squares stay off it.
_AT_BOUND = 1e-4

_NOT_VARIABLE = (
    "pair.torque_pinion_Nm",
    "pair.power_kW",
    "pair.speed_rpm",
    "mesh.smoothing_um",
)


def twin(key: str) -> str:
    """The same key of the other gear's flank; a key that is no flank's is its own twin.

    So is the pitch error of one tooth: the other gear has other teeth.

    **Arguments:**

    - `key`: dotted path.

    **Returns:**

    Dotted path of the twin.
    """
    for gear, other in (GEARS, GEARS[::-1]):
        if key.startswith(f"flank.{gear}.") and not key.endswith("]"):
            return key.replace(gear, other, 1)
    return key


def refuse_twins(table: str, keys: tuple[str, ...]) -> None:
    """Refuse keys of both gears that are to be the same anyway.

    **Arguments:**

    - `table`: that has `symmetric`, and names the keys.
    - `keys`: dotted paths.

    **Raises:**

    - `InputError` if a key and its twin are both there.
    """
    if both := [key for key in keys if twin(key) != key and twin(key) in keys]:
        raise InputError(
            f"With {table}.symmetric the two gears share each correction, but [{table}] names "
            f"both of {', '.join(both)}. Name one, or set symmetric = false."
        )


def design_space(
    scene: Scene,
    keys: tuple[str, ...],
    *,
    symmetric: bool,
    deflection: float,
    tied: bool = True,
) -> DesignSpace:
    """The space that some keys of a scene span.

    **Arguments:**

    - `scene`: gives start and bounds.
    - `keys`: the variables.
    - `symmetric`: whether the other gear's flank follows.
    - `deflection`: of a single tooth pair, the scale of depths [um].
    - `tied`: whether keys follow as [optimise.ties] says.

    **Returns:**

    The space.

    **Raises:**

    - `InputError` if a key has no effect, or no bounds and none can be guessed, if two variables
        are the same, or if points of a shaft could pass each other.
    """
    _refuse_shaping(scene, keys)
    ties = _ties(scene, keys) if tied else {}
    for table, named in (("vary", keys), ("ties", tuple(ties))):
        if dead := [k for k in named if k in _NOT_VARIABLE or k not in scene.real_keys()]:
            raise InputError(
                f"optimise.{table} names {', '.join(dead)}, which no objective depends on: torques "
                "are optimise.torques_Nm, the smoothing width belongs to the method, and a "
                "stiffness counts only if mesh.stiffness uses it. Remove it."
            )
    _refuse_shaping(scene, tuple(ties))
    if symmetric:
        refuse_twins("optimise", (*keys, *ties))
        ties |= {twin(key): owner for key, owner in ties.items()}
    refuse_unbounded(scene, keys)
    base = model_of(scene)
    for key, owner in shared_places(scene, base).items():
        if key in keys:
            raise InputError(
                f"optimise.vary names {key}, whose point lies where {owner} does and moves with "
                "it: by itself it has no effect. Move it by 0.1 mm, or vary the other."
            )
    bounds = np.asarray([_bounds(scene, key, deflection) for key in keys], dtype=float)
    start = np.asarray([scene[key] for key in keys], dtype=float)
    space = DesignSpace(
        scene=scene,
        keys=keys,
        symmetric=symmetric,
        ties=tuple(ties.items()),
        base=base,
        start=start,
        box=optimise.Box(lower=bounds[:, 0], upper=bounds[:, 1]),
    )
    _require_order(space)
    _require_narrow(space)
    return space


def _ties(scene: Scene, keys: tuple[str, ...]) -> dict[str, str]:
    """Keys that follow one of the variables, and which."""
    table = "optimise.ties."
    pairs = {
        path.removeprefix(table): str(owner)
        for path, owner in scene.values.items()
        if path.startswith(table)
    }
    return {key: owner for key, owner in pairs.items() if owner in keys}


# Of the range of a depth, the largest width of smooth contact that leaves its effect to be seen.
_WIDEST = 0.5


def _require_narrow(space: DesignSpace) -> None:
    """Refuse smooth contact so wide that depths within their bounds make no difference to it."""
    width, span = float(space.scene["mesh.smoothing_um"]), space.box.upper - space.box.lower
    for key, most in zip(space.keys, span, strict=True):
        if key.startswith("flank.") and unit_of(key) == "um" and width > _WIDEST * most:
            raise InputError(
                f"mesh.smoothing_um = {width:g} is too wide for {key}, which moves over {most:g} "
                f"um: contact would hardly feel it. Take a tenth, {0.1 * most:.2g} um, or wider "
                "bounds."
            )


def _require_order(space: DesignSpace) -> None:
    """Refuse bounds within which points of a shaft, such as a bearing and the gear, could pass."""
    mounts = space.base.pinion_support, space.base.wheel_support
    if space.flanks_only or not any(isinstance(mount, Shaft) for mount in mounts):
        return
    gaps = jax.jit(lambda values: _gaps(space.model(values)))
    at_start = np.asarray(gaps(jnp.asarray(space.start)))
    # Heights are linear in positions, lengths and widths: each variable takes away its own share.
    taken = np.zeros((len(space.keys), at_start.size))
    for index in range(len(space.keys)):
        for bound in (space.box.lower[index], space.box.upper[index]):
            end = space.start.copy()
            end[index] = bound
            taken[index] = np.minimum(taken[index], np.asarray(gaps(jnp.asarray(end))) - at_start)
    closest = int(np.argmin(at_start + taken.sum(axis=0)))
    if at_start[closest] + taken[:, closest].sum() <= 0.0:
        movers = [key for key, share in zip(space.keys, taken[:, closest], strict=True) if share]
        raise InputError(
            f"Within the bounds of {', '.join(movers)} two points of a shaft could change places, "
            f"which are {at_start[closest] / mm:.6g} mm apart at the start. Narrow "
            "[optimise.bounds] so that bearings, gear, loads and ends keep their order."
        )


def _gaps(model: PairModel) -> Reals:
    """Distances between neighbouring nodes on both shafts [m]."""
    return jnp.concatenate(
        [
            jnp.diff(drawn_heights(mount, body if isinstance(body, BeamBody) else None))
            for mount, body in (
                (model.pinion_support, model.pinion_body),
                (model.wheel_support, model.wheel_body),
            )
            if isinstance(mount, Shaft)
        ]
    )


def _bounds(scene: Scene, key: str, deflection: float) -> tuple[float, float] | None:
    """Given bounds of a variable, or such as its kind suggests, or `None` if it suggests none.

    A depth reaches three deflections, a slope as far to either side; a bias, of which a quarter is
    in the corners, four times as far. An extent reaches half its path.
    """
    given = scene.get(f"optimise.bounds.{key}")
    if given is not None:
        return given[0], given[1]
    value = float(scene[key])
    most = max(round_up(3.0 * deflection), 2.0 * abs(value))
    match split_entry(key)[0].rpartition(".")[2]:
        case "extent":
            return min(0.02, value), max(0.5, value)
        case (
            "depth_um"
            | "crowning_um"
            | "profile_crowning_um"
            | "elliptical_crowning_um"
            | "eccentricity_um"
        ):
            return 0.0, most
        case (
            "helix_slope_um"
            | "profile_slope_um"
            | "pitch_error_um"
            | "misalignment_inclination_um"
            | "misalignment_deviation_um"
        ):
            return -most, most
        case "bias_um":
            return -4.0 * most, 4.0 * most
        case "eccentricity_angle_deg":
            return value - 180.0, value + 180.0
        case "accuracy_grade":
            return 1.0, 11.0
    return None


def _refuse_shaping(scene: Scene, keys: tuple[str, ...]) -> None:
    """Refuse to vary what a condensed body is made from, and does not follow or will not."""
    follows = lambda key: not scene.bodies and _will_follow(scene, key)
    shaping = [
        key
        for key in keys
        if any(scene.remakes(key, gear) for gear in scene.condensed) and not follows(key)
    ]
    if any(".body.web." in key for key in shaping):
        raise InputError(
            f"optimise.vary names {', '.join(shaping)}: one measure of a condensed body's web can "
            "be varied, in statics, by interpolating between bodies. In motion modes do not "
            "follow: leave [sweep] out, vary one measure of each gear, or run once for each web."
        )
    if shaping:
        raise InputError(
            f"optimise.vary names {', '.join(shaping)}, from which a condensed body is made: its "
            "finite elements do not follow. Vary flanks, bearing stiffnesses or misalignment, or "
            "make the body rigid."
        )


def _will_follow(scene: Scene, key: str) -> bool:
    """Whether bodies, once they are built, will be interpolated over a key: one measure of a web.

    Those that are to vibrate are not.
    """
    table = f"{split_entry(key)[0].rpartition('.')[0]}."
    measures = [each for each in scene["optimise.vary"] if each.startswith(table)]
    return ".body.web." in table and measures == [key] and not scene.has_table("sweep")


def refuse_unbounded(scene: Scene, keys: tuple[str, ...]) -> None:
    """Refuse variables that have no bounds and for which none can be guessed, all at once.

    **Arguments:**

    - `scene`: gives the bounds.
    - `keys`: the variables.

    **Raises:**

    - `InputError` naming them, with lines to add.
    """
    _refuse_shaping(scene, keys)
    lost = [key for key in keys if scene.get(key) is not None and not _bounds(scene, key, 1.0)]
    if not lost:
        return
    lines = []
    for key in lost:
        value = float(scene[key])
        low, high = sorted((0.9 * value, 1.1 * value or 1.0))
        lines.append(f'"{key}" = [{low:.6g}, {high:.6g}]')
    raise InputError(
        f"optimise.vary ({scene.where('optimise.vary')}) names {', '.join(lost)}, for which no "
        "bounds can be guessed. Add their lowest and highest values to the table "
        "[optimise.bounds], such as:\n" + "\n".join(lines)
    )


def round_up(value: float) -> float:
    """The next round number: 1, 2, 2.5, 4, 5 or 8 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(
        next(r * power for r in (1.0, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0) if r * power >= value)
    )


# Objectives that a scene may name: each of its weighted sum, and its unit there.
_OBJECTIVES: Mapping[str, tuple[Callable[[Scene], optimise.AbstractObjective], str]] = {
    "te_rms": (lambda scene: optimise.TransmissionErrorRms(), "um"),
    "te_peak_to_peak": (lambda scene: optimise.TransmissionErrorRange(), "um"),
    "te_harmonics": (lambda scene: optimise.TransmissionErrorHarmonics(_orders(scene)), "um2"),
    "max_pressure": (lambda scene: optimise.LargestPressure(), "MPa"),
    "face_load_factor": (lambda scene: optimise.FaceLoadFactor(), "-"),
    "pressure_offset": (lambda scene: optimise.PressureOffset(), "-"),
}
# The same of those that look at the speeds of [sweep]: numbers of a response.
_RESPONSES: Mapping[str, tuple[Callable[[Scene], optimise.AbstractResponse], str]] = {
    "dynamic_ratio": (lambda scene: optimise.DynamicRatio(_ratio_width(scene)), "-"),
    "bearing_force": (lambda scene: optimise.BearingForce(), "N"),
}

# Width of the smooth maximum of the dynamic ratio, in static mesh forces.
_RATIO_WIDTH = 0.02


def _ratio_width(scene: Scene) -> float:
    return scene.get("optimise.smoothing_ratio", _RATIO_WIDTH)


def _orders(scene: Scene) -> tuple[int, ...]:
    """The mesh harmonics that are to be made small."""
    return tuple(int(order) for order in scene.get("optimise.harmonics", (1,)))


def _minimised(scene: Scene) -> dict[str, float | None]:
    """What is to be made small, by name: its weight, or `None` where it is one thing alone."""
    if "optimise.minimise" in scene.values:
        return {scene["optimise.minimise"]: None}
    given = {name: scene.get(f"optimise.minimise.{name}") for name in (*_OBJECTIVES, *_RESPONSES)}
    return {name: weight for name, weight in given.items() if weight is not None}


def is_dynamic(scene: Scene) -> bool:
    """Whether the objective of a scene looks at its speeds."""
    return any(name in _RESPONSES for name in _minimised(scene))


def objective_of(
    scene: Scene, grid: MeshGrid | None = None
) -> tuple[optimise.AbstractObjective, str]:
    """The objective that a scene asks for, and its unit.

    **Arguments:**

    - `scene`: with `optimise.minimise`, a name or a table of weights.
    - `grid`: of the quasi-static cycles; `None`: that of the scene's own model.

    **Returns:**

    The objective and the unit of its value.

    **Raises:**

    - `InputError` if the dynamic ratio is asked for, and there is no [sweep].
    """
    named = _minimised(scene)
    (first, weight), *_ = named.items()
    if weight is not None:
        parts = tuple(_named(scene, name, grid)[0] for name in named)
        return optimise.WeightedSum(parts=parts, weights=list(named.values())), "weighted"
    if first == "te_rms":
        # Alone without the cone of an RMS.
        return optimise.TransmissionErrorVariance(), "um2"
    return _named(scene, first, grid)


def _named(
    scene: Scene, name: str, grid: MeshGrid | None
) -> tuple[optimise.AbstractObjective, str]:
    """An objective by its name, and its unit."""
    if name in _RESPONSES:
        return _over_speeds(scene, name, grid), _RESPONSES[name][1]
    return _OBJECTIVES[name][0](scene), _OBJECTIVES[name][1]


def front_objectives(
    scene: Scene, grid: MeshGrid | None = None
) -> tuple[tuple[optimise.AbstractObjective, str, str], ...]:
    """What is minimised and what it is traded against: objectives, names and units.

    **Arguments:**

    - `scene`: with `optimise.pareto.against`.
    - `grid`: as of `objective_of`.

    **Returns:**

    Two rows. The RMS of the transmission error is itself here, not its square.
    """
    against = scene["optimise.pareto.against"]
    objective, unit = _named(scene, against, grid)
    named = _minimised(scene)
    (first, weight), *_ = named.items()
    if weight is not None:
        return (objective_of(scene, grid)[0], "weighted", "-"), (objective, against, unit)
    own, own_unit = _named(scene, first, grid)
    return (own, first, own_unit), (objective, against, unit)


def smallest_width(objective: optimise.AbstractObjective) -> optimise.AbstractObjective:
    """The same objective with its smoothing taken away, for a re-check."""
    if isinstance(objective, optimise.WeightedSum):
        parts = tuple(smallest_width(part) for part in objective.parts)
        return dataclasses.replace(objective, parts=parts)
    if isinstance(objective, optimise.OverSpeeds):
        response = _sharpened(objective.response)
        return dataclasses.replace(objective, response=response)
    return _sharpened(objective)


# Of a smoothing width, for numbers that are told.
_SHARP = 1e-3


def _sharpened(smoothed: Any) -> Any:
    if not hasattr(smoothed, "width"):
        return smoothed
    return dataclasses.replace(smoothed, width=_SHARP * smoothed.width)


_AGAINST = "optimise.pareto.against"


def looks_at_speeds(scene: Scene) -> bool:
    """Whether the objective of a scene, or what it is traded against, looks at its speeds."""
    return is_dynamic(scene) or scene.get(_AGAINST) in _RESPONSES


def limits_objectives(scene: Scene, law: AbstractContactLaw) -> list[optimise.AbstractObjective]:
    """The responses of `limits_of`, in its order.

    **Arguments:**

    - `scene`: to look at.
    - `law`: contact law; with exact contact, which is for a re-check, nothing else is smoothed.
    """
    found = [_LIMITED[limit.name]() for limit in limits_of(scene)]
    return [smallest_width(each) for each in found] if isinstance(law, ExactContact) else found


def _over_speeds(scene: Scene, name: str, grid: MeshGrid | None) -> optimise.OverSpeeds:
    """A number of the responses over the speeds of [sweep]."""
    if not scene.has_table("sweep"):
        raise InputError(f"optimise.minimise names {name}, {_NO_SPEEDS}")
    steps = scene["sweep.steps"]
    if grid is None:
        grid = dynamic_grid_of(scene, model_of(scene))
    else:
        # With its margins, and the same share of the steps after a pair's entry.
        entry, fewest = round(grid.entry_phases * steps / grid.phases), steps // 8
        grid = dataclasses.replace(
            grid, phases=steps, entry_phases=min(max(entry, fewest), steps - fewest)
        )
    worst = scene.get("optimise.over_speeds", "mean") == "worst"
    damping = damping_of(scene)
    assert isinstance(damping, ModalDamping | RayleighDamping)
    return optimise.OverSpeeds(
        response=_RESPONSES[name][0](scene),
        speeds=jnp.asarray(speeds_of(scene)),
        grid=grid,
        damping=damping,
        method=HarmonicBalance(harmonics=scene["sweep.harmonics"], averaged=True),
        power=np.inf if worst else 1.0,
        gyroscopic=scene["model.gyroscopic"],
        active_mesh_damping=scene["damping.active_mesh"],
    )


_Judged = list[tuple[float, optimise.Judged]]


def judged_speeds(
    space: DesignSpace, grid: MeshGrid, law: AbstractContactLaw
) -> Callable[[np.ndarray], _Judged]:
    """What each speed contributes to the objective, if it looks at speeds.

    **Arguments:**

    - `space`: variables of the scene.
    - `grid`: of the quasi-static cycles.
    - `law`: contact law.

    **Returns:**

    A function of the variables, in the units of their keys: for each torque [N m] the numbers, and
    which of them count, for the user must hear of those that do not. So it is for what the
    objective is traded against.
    """
    if not looks_at_speeds(space.scene):
        return lambda values: []
    # Which speeds count does not depend on what is read from their responses.
    names = (*_minimised(space.scene), space.scene.get(_AGAINST))
    name = next(name for name in names if name in _RESPONSES)
    over_speeds = _over_speeds(space.scene, name, grid)

    @jax.jit
    def judge(values: Reals, torque: Scalar) -> optimise.Judged:
        model = eqx.tree_at(lambda m: m.torque, space.model(values), torque)
        return over_speeds.judged(model, law)

    torques = [float(torque) for torque in torques_of(space.scene, "optimise.torques_Nm")]
    return lambda values: [(t, judge(jnp.asarray(values), jnp.asarray(t))) for t in torques]


def left_out(before: _Judged, after: _Judged) -> dict[str, list[dict[str, Any]]]:
    """Part of the summary: speeds that do not count where a search began and ended."""
    if not before:
        return {}
    listed = lambda judged: [
        {
            "torque_Nm": torque,
            "count": int(each.left_out.size),
            "of": int(each.speed.size),
            "speeds_rad_s": np.asarray(each.left_out),
        }
        for torque, each in judged
    ]
    return {"speeds_left_out_before": listed(before), "speeds_left_out_after": listed(after)}


def require_swept(scene: Scene) -> None:
    """Refuse an objective over speeds in a scene that has none, or none that can be computed.

    **Arguments:**

    - `scene`: with a table [optimise].

    **Raises:**

    - `SceneError` with every mistake.
    """
    if not looks_at_speeds(scene):
        return
    found = motion_mistakes(scene, harmonic=True)
    bearings = [f"{gear}.shaft.bearings" for gear in GEARS]
    asked = {**dict.fromkeys(_minimised(scene), "optimise.minimise"), scene.get(_AGAINST): _AGAINST}
    if "bearing_force" in asked and not any(map(scene.rows, bearings)):
        key = asked["bearing_force"]
        found.append(
            Mistake(
                scene.where(key),
                key,
                f"names bearing_force, but neither {' nor '.join(bearings)} is there",
            )
        )
    if not scene.has_table("sweep"):
        names = (*_minimised(scene), scene.get(_AGAINST))
        name = next(name for name in names if name in _RESPONSES)
        weighted = f"optimise.minimise.{name}"
        key = weighted if weighted in scene.values else "optimise.minimise"
        key = key if is_dynamic(scene) else _AGAINST
        found.insert(0, Mistake(scene.where(key), key, f"names {name}, {_NO_SPEEDS}"))
    if found:
        raise SceneError(found)


_NO_SPEEDS = (
    "which is taken over the speeds of [sweep], and there is no such table. "
    "Add one, such as:\n[sweep]\n"
    "pinion_speed_rad_s = { from = 50.0, to = 3000.0, points = 100 }"
)


def prepared_mesh(
    space: DesignSpace, grid: MeshGrid, statics: Statics | None = None
) -> PreparedMesh | None:
    """The meshes at the scene's torques, if the variables leave them as they are.

    **Arguments:**

    - `space`: variables of the scene.
    - `grid`: of the quasi-static cycles.
    - `statics`: of the scene itself, whose mesh may be the one that is wanted.

    **Returns:**

    The prepared meshes, stacked.
    """
    if not space.flanks_only:
        return None
    torques = torques_of(space.scene, "optimise.torques_Nm")
    own = (
        statics is not None
        and statics.grid == grid
        and list(torques) == [float(statics.model.torque)]
    )
    if own and statics is not None and statics.prepared is not None:
        return jax.tree.map(lambda x: np.asarray(x)[None], statics.prepared)
    return timed(optimise.prepare_torques, space.base, torques, grid, options=QUICKLY)


def task_of(
    space: DesignSpace, grid: MeshGrid, law: AbstractContactLaw, prepared: PreparedMesh | None
) -> Task:
    """What a scene asks to be made small, over all its torques.

    **Arguments:**

    - `space`: variables of the scene.
    - `grid`: of the quasi-static cycles.
    - `law`: contact law; with exact contact, which is for a re-check, limits are not smoothed.
    - `prepared`: the meshes, where the variables leave them as they are.

    **Returns:**

    The task.
    """
    return Task(
        variation=space.variation,
        keys=space.moved,
        objective=objective_of(space.scene, grid)[0],
        limited=tuple(limits_objectives(space.scene, law)),
        torques=torques_of(space.scene, "optimise.torques_Nm"),
        grid=grid,
        prepared=prepared,
        worst=space.scene["optimise.over"] == "worst",
        batched=not is_dynamic(space.scene),
    )


# Responses that may have limits, with the unit in the key.
_LIMITED = {
    "max_pressure_MPa": optimise.LargestPressure,
    "te_peak_to_peak_um": optimise.TransmissionErrorRange,
    "face_load_factor": optimise.FaceLoadFactor,
    "edge_line_load_N_mm": optimise.EdgeLoad,
}


def limits_of(scene: Scene) -> tuple[optimise.Limit, ...]:
    """What [optimise.limits] allows, scaled by a tenth of itself.

    **Arguments:**

    - `scene`: to look at.

    **Returns:**

    The limits, in the order of the keys.
    """
    given = {name: scene.get(f"optimise.limits.{name}") for name in _LIMITED}
    return tuple(
        optimise.Limit(name, float(most), 0.1 * float(most))
        for name, most in given.items()
        if most is not None
    )


def require_search(scene: Scene) -> None:
    """Refuse a search that cannot do what the scene asks for.

    **Arguments:**

    - `scene`: with a table [optimise].

    **Raises:**

    - `SceneError` with every mistake.
    """
    squares = scene.get("optimise.minimise") == "te_rms" and scene["optimise.over"] == "mean"
    limited, method = bool(limits_of(scene)), scene["optimise.method"]
    orders = scene.get("optimise.harmonics", ())
    widths = [*scene.get("optimise.anneal_um", ()), scene["mesh.smoothing_um"]]
    wrong = {
        f'"{method}" is for a sum of squares: te_rms over the mean of torques': (
            "method",
            method == "least_squares" and not squares,
        ),
        f'"{method}" knows no limits: leave it out, and SLSQP keeps [optimise.limits]': (
            "method",
            method != "lbfgs" and limited,
        ),
        "needs lbfgs or adam, without [optimise.limits]": (
            "anneal_um",
            len(widths) > 1 and (method == "least_squares" or limited),
        ),
        "must fall, and end above mesh.smoothing_um: " + ", ".join(f"{w:g}" for w in widths): (
            "anneal_um",
            any(wide <= narrow for wide, narrow in itertools.pairwise(widths)),
        ),
        "must be whole numbers, less than half of mesh.phases": (
            "harmonics",
            any(order % 1.0 or 2.0 * order >= scene["mesh.phases"] for order in orders),
        ),
    }
    against = scene.get(_AGAINST)
    wrong[f'got "{against}", which optimise.minimise names too: name another response'] = (
        "pareto.against",
        against is not None and _minimised(scene) == {against: None},
    )
    found = [(f"optimise.{key}", words) for words, (key, is_wrong) in wrong.items() if is_wrong]
    if found:
        raise SceneError([Mistake(scene.where(key), key, words) for key, words in found])
