"""What [robust] lets scatter about a design, and the model of one gear of the sample."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._checks import InputError
from jaxgear._contact._root_influence import nearby_influences
from jaxgear._flank._deviations import (
    Flanks,
    HelixSlope,
    ProfileSlope,
    ProfileWaviness,
    Superposed,
)
from jaxgear._flank._indexing import Indexing
from jaxgear._flank._tolerances import flank_tolerances
from jaxgear._geometry._pair import GearPair
from jaxgear._system._model import PairModel
from jaxgear._types import Reals, Scalar
from jaxgear._units import um
from jaxgear.scene._build import flanks_of, misalignment_of, model_of
from jaxgear.scene._gear_tables import FlanksKeys
from jaxgear.scene._key import show
from jaxgear.scene._schema import GEARS, KEYS, general, is_unbalance, split_entry
from jaxgear.scene._study_tables import RobustKeys
from jaxgear.study._design import AMOUNTS, DesignSpace, keeps_teeth

_TORQUE = "pair.torque_pinion_Nm"
_INCLINATION = "pair.misalignment_inclination_um"
_DEVIATION = "pair.misalignment_deviation_um"
# They change no prepared mesh; flanks do not either.
_ALIGNMENT = (_INCLINATION, _DEVIATION)


class Tolerated(NamedTuple):
    """One random deviation of a tolerance class: of the pinion, 0, or the wheel, 1.

    Kinds are `profile slope`, `profile form`, `helix slope`, and `pitch` of a tooth, elsewhere -1.
    """

    gear: int
    kind: str
    tooth: int = -1


class Scatter(eqx.Module):
    """What scatters about a design, in file units.

    **Fields:**

    - `space`: the variables.
    - `keys`: of the scene, that scatter; the first of the quantities.
    - `tolerated`: deviations of a tolerance class; the rest of them.
    - `quantities`: how much each scatters, about zero, in the unit of its key or in um.
    """

    space: DesignSpace
    keys: tuple[str, ...] = eqx.field(static=True)
    tolerated: tuple[Tolerated, ...] = eqx.field(static=True)
    quantities: tuple[optimise.Quantity, ...] = eqx.field(static=True)

    @property
    def _light(self) -> bool:
        """Whether gears of the sample differ in flanks, alignment and torque alone."""
        return self.space.flanks_only and all(map(_is_light, self.keys))

    @property
    def same_mesh(self) -> bool:
        """Whether all gears of the sample share one prepared mesh for each torque."""
        return self._light and _TORQUE not in self.keys

    @property
    def same_lines(self) -> bool:
        """Whether what scatters leaves the contact lines where they are."""
        beside = "material.", "mesh."
        within = ".shaft.", ".support.", ".material."
        return all(
            _is_light(key) or key.startswith(beside) or any(part in key for part in within)
            for key in self.keys
        )

    def with_teeth(self) -> DesignSpace:
        """The variables, with influences on the roots that follow what scatters."""
        space = self.space
        if space.influences is None or all(map(keeps_teeth, self.keys)):
            return space
        return dataclasses.replace(space, influences=nearby_influences(space.base.pair))

    def model(self, values: Reals, drawn: Reals, torque: Scalar) -> PairModel:
        """The model of one gear of the sample; traceable by JAX.

        The torque [N m] is the one about which it may scatter.
        """
        scene, base = self.space.scene, self.space.base
        by = dict(zip(self.keys, drawn, strict=False))
        sense = scene.plain.pair.sense
        torque = torque + sense * by.pop(_TORQUE, 0.0)
        updates = self.space.updates(values)
        updates |= {key: updates.get(key, scene.value(key)) + more for key, more in by.items()}
        scene = scene.replace(updates)
        if self._light:
            own = flanks_of(scene, base.pair), misalignment_of(scene.pair, sense)
            model = eqx.tree_at(lambda m: (m.flanks, m.misalignment), base, own)
        else:
            model = model_of(scene)
        flanks = _deviated(scene.flank, sense, model, self.tolerated, drawn[len(self.keys) :])
        return eqx.tree_at(lambda m: (m.flanks, m.torque), model, (flanks, torque))


def _is_light(key: str) -> bool:
    return key.startswith("flank.") or key in (*_ALIGNMENT, _TORQUE)


def _deviated(
    given: FlanksKeys, sense: int, model: PairModel, tolerated: Sequence[Tolerated], drawn: Reals
) -> Flanks:
    """The flanks of a model with deviations of a tolerance class added, in um."""
    flanks = [model.flanks.pinion, model.flanks.wheel]
    indexing = [model.flanks.pinion_indexing, model.flanks.wheel_indexing]
    for (gear, kind, tooth), amount in zip(tolerated, drawn, strict=True):
        if kind == "pitch":
            indexing[gear] = _out_of_place(model.pair, gear, indexing[gear], tooth, amount * um)
            continue
        match kind:
            case "profile slope":
                more = ProfileSlope(amount * um)
            case "helix slope":
                more = HelixSlope(amount * um)
            case _:
                waves = float(given.gear(GEARS[gear], sense).accuracy_waves)
                # A cosine of whole waves has no slope, and no mean.
                more = ProfileWaviness(amount * um, waves, 0.5 * np.pi)
        flanks[gear] = Superposed((flanks[gear], more))
    return Flanks(flanks[0], flanks[1], indexing[0], indexing[1])


def _out_of_place(
    pair: GearPair, gear: int, indexing: Indexing | None, tooth: int, amount: Scalar
) -> Indexing:
    teeth = (pair.pinion, pair.wheel)[gear].teeth
    indexing = Indexing() if indexing is None else indexing
    error = jnp.broadcast_to(indexing.pitch_error, (teeth,)).at[tooth].add(amount)
    return eqx.tree_at(lambda i: i.pitch_error, indexing, error)


def scatter_of(space: DesignSpace, pair: GearPair, teeth: np.ndarray) -> Scatter:
    """What [robust] lets scatter about a design, the pitch errors of the teeth in mesh too."""
    scene, even = space.scene, space.scene.robust.even
    spread = {**scene.robust.scatter, **even}
    felt = {key for key in scene.real_keys() if not is_unbalance(key)} - {"mesh.smoothing_um"}
    dead = [key for key in spread if key not in felt]
    if dead:
        raise InputError(
            f"[robust] lets {', '.join(dead)} scatter, on which no objective depends: the "
            "smoothing width belongs to the method, unbalance to `jaxgear sweep`, and a stiffness "
            "counts only if mesh.stiffness uses it. Remove it."
        )
    named = [
        optimise.Quantity(key, 0.0, value / math.sqrt(3.0) if key in even else value, key in even)
        for key, value in spread.items()
    ]
    # One mesh period sees nothing of a wave over the revolution.
    tolerated = _tolerated(scene.robust, pair, teeth if scene.mesh.periods > 1 else teeth[:0])
    found = Scatter(
        space=space,
        keys=tuple(spread),
        tolerated=tuple(each for each, _ in tolerated),
        quantities=(*named, *(quantity for _, quantity in tolerated)),
    )
    _require_range(found)
    return found


def _tolerated(
    asked: RobustKeys, pair: GearPair, teeth: np.ndarray
) -> list[tuple[Tolerated, optimise.Quantity]]:
    """The deviations of a tolerance class along the flank normal.

    As many as act: pitch errors only of teeth in mesh, if there are any to speak of.
    """
    grade = asked.accuracy_grade
    if grade is None:
        return []
    found = []
    # Tolerances hold in the transverse plane, and along an arc; see `deviation_of_grade`.
    normal = float(jnp.cos(pair.base_helix_angle))
    along_arc = float(jnp.cos(pair.pressure_angle) * jnp.cos(pair.helix_angle))
    for gear, name in enumerate(GEARS):
        allowed = flank_tolerances(pair, gear, grade)
        amounts = [
            (Tolerated(gear, "profile slope"), normal * allowed.profile_slope),
            # A wave's amplitude is half of what it spans.
            (Tolerated(gear, "profile form"), 0.5 * normal * allowed.profile_form),
            (Tolerated(gear, "helix slope"), normal * allowed.helix_slope),
        ]
        # A single pitch is the difference of two teeth that are out of place independently.
        place = along_arc * allowed.single_pitch / np.sqrt(2.0)
        own = np.unique(teeth % (pair.pinion, pair.wheel)[gear].teeth)
        amounts += [(Tolerated(gear, "pitch", int(tooth)), place) for tooth in own]
        for each, most in amounts:
            label = f"{name} {each.kind}" + (f" of tooth {each.tooth}" if each.tooth >= 0 else "")
            share = float(most) / um / asked.tolerance_deviations
            found.append((each, optimise.Quantity(label, 0.0, share)))
    return found


def _require_range(scatter: Scatter) -> None:
    """Refuse a scatter that leaves the range of its key, or a torque that changes its sign."""
    scene, space = scatter.space.scene, scatter.space
    every = np.concatenate(
        [*samples_of(scatter), optimise.one_at_a_time_sample(scatter.quantities)]
    )
    ends = [space.updates(jnp.asarray(end)) for end in (space.box.lower, space.box.upper)]
    for column, key in enumerate(scatter.keys):
        rule = KEYS[general(split_entry(key)[0])]
        holds, allowed = rule.holds, rule.allowed
        least, most = float(every[:, column].min()), float(every[:, column].max())
        if key.startswith("flank.") and key.rpartition(".")[2] in AMOUNTS:
            # A scatter may leave some standing where none was to be removed.
            continue
        if key in ends[0]:
            low, high = (float(end[key]) for end in ends)
            what, remedy = f"between its bounds {low:g} and {high:g}", "narrow [optimise.bounds]"
        elif key == _TORQUE:
            # The same flanks carry in all gears; torques of a map or a search are sizes.
            sense = scene.plain.pair.sense
            low, high = (sense * float(size(space.torques)) for size in (min, max))
            what, remedy = f"{low:g} at the least", "raise the torque"
            holds = lambda torque, sense=sense: sense * torque > 0.0
            allowed = "> 0" if sense > 0 else "< 0"
        else:
            low = high = float(scene.value(key))
            what, remedy = f"{low:g}", "change it"
        reached = low + least, low + most, high + least, high + most
        if beyond := [value for value in reached if not holds(value)]:
            worst = beyond[0]
            path = f"robust.{'even' if key in scene.robust.even else 'scatter'}.{key}"
            raise InputError(
                f"{path} ({scene.where(path)}) is {show(scene.value(path))}: with {key} {what}, a "
                f"gear of the sample has {worst:.4g}, but it must be {allowed}. Take a "
                f"smaller deviation, {remedy}, or use [robust.even], whose band has ends."
            )


def samples_of(scatter: Scatter) -> tuple[np.ndarray, np.ndarray]:
    """The sample to search with, and the fresh one: deviations `[gear, quantity]`."""
    asked = scatter.space.scene.robust
    drawn = lambda count, seed: optimise.sample(scatter.quantities, count, seed)
    return drawn(asked.samples, asked.seed), drawn(asked.fresh_samples, asked.seed + 1)
