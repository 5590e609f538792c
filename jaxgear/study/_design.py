"""The variables of [optimise]: their bounds, what follows them, and which cannot be varied."""

from collections.abc import Iterable, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._checks import InputError
from jaxgear._contact._root_influence import Influences, NearbyInfluences
from jaxgear._response._gauges import GaugeInfluences
from jaxgear._system._gear_body import AbstractGearBody, BeamBody
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft, drawn_heights
from jaxgear._types import Reals
from jaxgear._units import mm
from jaxgear.scene._build import shared_places
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS, is_unbalance, split_entry, unit_of
from jaxgear.study._built import BuiltScene
from jaxgear.study._evaluations import Updates, Variation, variation_of
from jaxgear.study._gauge_tables import gauge_tables
from jaxgear.study._statics import torques_of


class DesignSpace(eqx.Module):
    """The variables of an optimisation, in file units.

    **Fields:**

    - `scene`: whose keys they are.
    - `keys`: dotted path of each variable.
    - `ties`: dotted paths of other keys, those of the other gear's flank first, and of the variable
        that each follows.
    - `base`: model of the scene itself.
    - `start`: value of each variable in the scene, in the unit of its key [-].
    - `box`: bounds of each variable, in the unit of its key.
    - `influences`: of loads on the roots, or `None` where they are not known or variables change
        the teeth [-].
    - `gauges`: what the gauges of each condensed body read, where [optimise] asks for it [-].
    """

    scene: Scene = eqx.field(static=True)
    keys: tuple[str, ...] = eqx.field(static=True)
    ties: tuple[tuple[str, str], ...] = eqx.field(static=True)
    base: PairModel
    start: np.ndarray
    box: optimise.Box
    influences: Influences | NearbyInfluences | None
    gauges: tuple[GaugeInfluences, ...] = ()

    def updates(self, values: Reals | np.ndarray) -> Updates:
        """Scene keys and their values at a point of the space, in the units of the keys."""
        pairs = dict(zip(self.keys, values, strict=True))
        return pairs | {key: pairs[owner] for key, owner in self.ties}

    def numbers(self, point: np.ndarray) -> Updates:
        """The same as plain numbers."""
        return {key: float(value) for key, value in self.updates(np.asarray(point)).items()}

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
        for key, owner in self.ties:
            mine, other = self.scene.value(key), self.scene.value(owner)
            if mine == other:
                continue
            if key == twin(owner):
                theirs = "left out" if mine is None else f"{mine:g}"
                raise InputError(
                    f"With optimise.symmetric both gears must start alike, but {owner} is "
                    f"{other:g} and {key} is {theirs}. Make them equal, or set symmetric = false."
                )
            if mine is None:
                raise InputError(
                    f"With optimise.symmetric {key} follows {owner} too, but it is left out. Give "
                    f"it the value {other:g}, or set symmetric = false."
                )
            raise InputError(
                f"optimise.ties makes {key} follow {owner}, but they start at {mine:g} and "
                f"{other:g}. Make them equal."
            )

    @property
    def flanks_only(self) -> bool:
        """Whether every variable is a flank correction."""
        return all(key.startswith("flank.") for key in (*self.keys, *dict(self.ties)))

    @property
    def torques(self) -> np.ndarray:
        """Pinion torques of the search [N m]."""
        return torques_of(
            "optimise", self.scene.optimise.torques_Nm, self.scene.pair, self.scene.pinion.shaft
        )


def keeps_teeth(key: str) -> bool:
    """Whether a real key leaves the shapes of the teeth, and what is under them, as they are."""
    mounts = ".shaft.", ".support."
    beside = "flank.", "pair.misalignment", "pair.torque"
    return key.startswith(beside) or any(part in key for part in mounts)


# Of the range of a variable, how close to a bound counts as on it: least squares stay off it.
_AT_BOUND = 1e-4

_NOT_VARIABLE = "pair.torque_pinion_Nm", "pair.power_kW", "pair.speed_rpm", "mesh.smoothing_um"


def twin(key: str) -> str:
    """The same key of the other gear's flank; a key that is no flank's is its own twin.

    So is the pitch error of one tooth: the other gear has other teeth.
    """
    for gear, other in (GEARS, GEARS[::-1]):
        if key.startswith(f"flank.{gear}.") and not key.endswith("]"):
            return key.replace(gear, other, 1)
    return key


def refuse_twins(table: str, keys: tuple[str, ...]) -> None:
    """Refuse keys of both gears that `symmetric` of a table makes the same anyway."""
    if both := [key for key in keys if twin(key) != key and twin(key) in keys]:
        raise InputError(
            f"With {table}.symmetric the two gears share each correction, but [{table}] names "
            f"both of {', '.join(both)}. Name one, or set symmetric = false."
        )


def design_space(
    built: BuiltScene,
    keys: tuple[str, ...],
    *,
    symmetric: bool,
    deflection: float,
    tied: bool = True,
    influences: Influences | None = None,
) -> DesignSpace:
    """The space that some keys of a scene span, from its values and within its bounds.

    Influences are those on the roots of the scene's own teeth. The deflection of a single tooth
    pair [um] is the scale of depths. Refused are keys without effect or bounds, variables that are
    the same, and points of a shaft that could pass each other.
    """
    scene, base = built.scene, built.model
    _refuse_shaping(scene, keys)
    follow = scene.optimise.ties if tied else {}
    ties = {key: owner for key, owner in follow.items() if owner in keys}
    felt = {key for key in scene.real_keys() if not is_unbalance(key)} - {*_NOT_VARIABLE}
    for table, named in (("vary", keys), ("ties", tuple(ties))):
        if dead := [key for key in named if key not in felt]:
            raise InputError(
                f"optimise.{table} names {', '.join(dead)}, which no objective depends on: torques "
                "are optimise.torques_Nm, the smoothing width belongs to the method, unbalance to "
                "`jaxgear sweep`, and a stiffness counts only if mesh.stiffness uses it. Remove it."
            )
    _refuse_shaping(scene, tuple(ties))
    if symmetric:
        refuse_twins("optimise", (*keys, *ties))
        twins = {twin(key): key for key in keys if twin(key) != key}
        ties = twins | ties | {twin(key): owner for key, owner in ties.items()}
    refuse_unbounded(scene, keys)
    for key, owner in shared_places(base).items():
        if key in keys:
            raise InputError(
                f"optimise.vary names {key}, whose point lies where {owner} does and moves with "
                "it: by itself it has no effect. Move it by 0.1 mm, or vary the other."
            )
    start = np.asarray([scene.value(key) for key in keys], dtype=float)
    given = scene.optimise.bounds
    pairs = zip(keys, map(float, start), strict=True)
    bounds = np.asarray([_bounds(given, key, x, deflection) for key, x in pairs], dtype=float)
    space = DesignSpace(
        scene=scene,
        keys=keys,
        ties=tuple(ties.items()),
        base=base,
        start=start,
        box=optimise.Box(lower=bounds[:, 0], upper=bounds[:, 1]),
        influences=influences if all(map(keeps_teeth, (*keys, *ties))) else None,
        gauges=gauge_tables(built, (*keys, *ties, *scene.robust.scatter, *scene.robust.even)),
    )
    _require_order(space)
    _require_narrow(space)
    return space


# Of the range of a depth, the largest width of smooth contact that leaves its effect to be seen.
_WIDEST = 0.5


def _require_narrow(space: DesignSpace) -> None:
    """Refuse smooth contact so wide that depths within their bounds make no difference to it."""
    width, span = float(space.scene.mesh.smoothing_um), space.box.upper - space.box.lower
    for key, most in zip(space.keys, span, strict=True):
        if key.startswith("flank.") and unit_of(key) == "um" and width > _WIDEST * most:
            raise InputError(
                f"mesh.smoothing_um = {width:g} is too wide for {key}, which moves over {most:g} "
                f"um: contact would hardly feel it. Take a tenth, {0.1 * most:.2g} um, or wider "
                "bounds."
            )


def _require_order(space: DesignSpace) -> None:
    """Refuse bounds within which points of a shaft, such as a bearing and the gear, could pass."""
    if space.flanks_only or not _on_shafts(space.base):
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
    heights = [
        drawn_heights(mount, body if isinstance(body, BeamBody) else None)
        for mount, body in _on_shafts(model)
    ]
    return jnp.concatenate([jnp.diff(each) for each in heights])


def _on_shafts(model: PairModel) -> list[tuple[Shaft, AbstractGearBody | None]]:
    """The shafts of a pair, each with the body on it."""
    both = (model.pinion_support, model.pinion_body), (model.wheel_support, model.wheel_body)
    return [(mount, body) for mount, body in both if isinstance(mount, Shaft)]


def _bounds(
    given: Mapping[str, Sequence[float]], key: str, value: float, deflection: float
) -> tuple[float, float] | None:
    """Given bounds of a variable, or such as its kind suggests, or `None` if it suggests none.

    A depth reaches three deflections, a slope as far to either side; a bias, of which a quarter is
    in the corners, four times as far. An extent reaches half its path.
    """
    if own := given.get(key):
        return own[0], own[1]
    most = max(round_up(3.0 * deflection), 2.0 * abs(value))
    name = split_entry(key)[0].rpartition(".")[2]
    match name:
        case "extent":
            return min(0.02, value), max(0.5, value)
        case "bias_um":
            return -4.0 * most, 4.0 * most
        case "eccentricity_angle_deg":
            return value - 180.0, value + 180.0
        case "accuracy_grade":
            return 1.0, 11.0
    if name in AMOUNTS or name == "eccentricity_um":
        return 0.0, most
    return (-most, most) if name in _EITHER_WAY else None


# Amounts of material that is removed.
AMOUNTS = ("depth_um", "crowning_um", "profile_crowning_um", "elliptical_crowning_um")
_EITHER_WAY = (
    "helix_slope_um",
    "profile_slope_um",
    "pitch_error_um",
    "misalignment_inclination_um",
    "misalignment_deviation_um",
)


def _refuse_shaping(scene: Scene, keys: tuple[str, ...]) -> None:
    """Refuse to vary what a condensed body is made from, and does not follow or will not."""
    # Once they are built; those that are to vibrate are not interpolated.
    still = not scene.bodies and not scene.sweep.is_given
    follows = lambda key: still and _is_one_of_a_web(key, scene.optimise.vary)
    remade = lambda key: any(scene.remakes(key, gear) for gear in scene.condensed)
    shaping = [key for key in keys if remade(key) and not follows(key)]
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


def _is_one_of_a_web(key: str, varied: Iterable[str]) -> bool:
    """Whether a key is the one measure of its web that is varied: bodies can be interpolated."""
    table = f"{split_entry(key)[0].rpartition('.')[0]}."
    return ".body.web." in table and [x for x in varied if x.startswith(table)] == [key]


def refuse_unbounded(scene: Scene, keys: tuple[str, ...]) -> None:
    """Refuse variables without bounds for which none can be guessed, with lines to add."""
    _refuse_shaping(scene, keys)
    values = {key: float(x) for key in keys if (x := scene.value(key)) is not None}
    given = scene.optimise.bounds
    now = {key: x for key, x in values.items() if not _bounds(given, key, x, 1.0)}
    if not now:
        return
    ends = {key: sorted((0.9 * x, 1.1 * x or 1.0)) for key, x in now.items()}
    lines = [f'"{key}" = [{low:.6g}, {high:.6g}]' for key, (low, high) in ends.items()]
    raise InputError(
        f"optimise.vary ({scene.where('optimise.vary')}) names {', '.join(now)}, for which no "
        "bounds can be guessed. Add their lowest and highest values to the table "
        "[optimise.bounds], such as:\n" + "\n".join(lines)
    )


def round_up(value: float) -> float:
    """The next round number: 1, 2, 2.5, 4, 5 or 8 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    steps = 1.0, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0
    return float(next(step * power for step in steps if step * power >= value))
