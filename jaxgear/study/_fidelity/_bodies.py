"""Scenes in motion with condensed bodies: how much of a model they need.

From the scene's own bodies, slices, steps and harmonics one thing is changed at a time; at last all
that was cheaper and good enough is put together.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import Marching
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import Newmark
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._types import Speeds
from jaxgear._system._shaft import Shaft
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._fidelity._engine import own_of
from jaxgear.study._fidelity._level import Answers, Level
from jaxgear.study._fidelity._models import Models, changed, differing
from jaxgear.study._fidelity._motion import AbstractMotion, OperatingPoints, each
from jaxgear.study._progress import narration
from jaxgear.study._result import Summary
from jaxgear.study._running import timed

# Of the reference: modes of all bodies together, and combinations that the mesh tells apart.
_REFERENCE_MODES, _REFERENCE_COORDINATES = 400, 24
# Where the scene is silent.
_COORDINATES = 12


class BodiesProblem(AbstractMotion):
    """Models against harmonic balance on a richer one: more modes and mesh coordinates.

    It has twice the steps of the scene, on the same slices. Levels by shooting and by a march,
    which have nothing of it in common, tell how far it can be trusted. Errors are those of all
    speeds at which the reference is converged.
    """

    method = "harmonic balance from the quasi-static state, is settled"

    def __init__(
        self,
        scene: Scene,
        levels: Sequence[Level] | None = None,
        *,
        speeds: int = 12,
        modes: int | None = None,
    ):
        """Compare levels of a scene.

        **Arguments:**

        - `scene`: with bodies that can vibrate, and a sweep.
        - `levels`: all by default.
        - `speeds`: number of speeds: one costs a tenth of a second to several.
        - `modes`: of each body of the reference; by default 400 of all bodies together.
        """
        own = scene.model.modes
        most = modes or _REFERENCE_MODES // len(scene.condensed)
        most = 0 if own == 0 else max(own, most)
        with narration("bodies of the reference"):
            models = Models(scene, moving=True, coordinates=most)
            models({})
        levels = body_levels(scene, most) if levels is None else levels
        super().__init__(scene, models, levels, 3, speeds)
        self.richest = {
            "model.coordinates": most,
            "model.mesh_coordinates": max(_REFERENCE_COORDINATES, _coordinates(scene)),
            "sweep.steps": 2 * scene.sweep.steps,
        }

    def finest(self, level: Level, place: OperatingPoints) -> Mapping[str, Any]:
        """The same for all levels and places."""
        return self.richest

    def solved(self, pair: PairDynamics, speeds: Speeds) -> tuple[Answers, np.ndarray]:
        """Harmonic balance; good where it has converged."""
        method = HarmonicBalance(harmonics=self.scene.sweep.harmonics)
        answers = timed(each, method, pair.system, speeds)
        return answers, np.asarray(answers.solved)

    def branch(self, level: Level) -> float:
        """All responses are on the same branch."""
        return np.inf

    def size(self, level: Level) -> Summary:
        """Modes, and coordinates in which the mesh tells them apart."""
        bodies = self.pair(level.changes).bodies
        told = _coordinates(changed(self.scene, level.changes)) if bodies else 0
        return {"modes": sum(len(place.waves) for place in bodies), "mesh_coordinates": told}

    def about(self) -> Summary:
        """The richer model."""
        pair, steps = self.pair(self.richest), self.richest["sweep.steps"]
        modes = sum(len(place.waves) for place in pair.bodies)
        told = pair.system.vectors.shape[1]
        return {
            "name": f"harmonic balance, H{self.scene.sweep.harmonics} N{steps}, {modes} modes, "
            f"{told} mesh coordinates",
            "motion_left_out_by_mesh_coordinates": float(pair.left_out),
            **self.told(self._reference(self.levels[0], self.places[0])),
        }


def body_levels(scene: Scene, most: int) -> list[Level]:
    """All models and settings that are compared on a scene with condensed bodies.

    **Arguments:**

    - `scene`: with its bodies.
    - `most`: modes of each body, at the most; 0 are all.

    **Returns:**

    The levels, family by family; those of modes from the fewest to the most.
    """
    steps, harmonics = scene.sweep.steps, scene.sweep.harmonics
    slices, modes = scene.mesh.slices, scene.model.modes
    every = max(body.built.body.dofs for body in scene.bodies.values())
    retained = {x for x in {10, 50, 100, 200, most} - {0, modes} if x <= min(most or every, every)}

    def retaining(count: int) -> Level:
        changes = {} if count == modes else {"model.coordinates": count}
        return Level(f"{count or 'all'} modes", "modes", "modes", changes)

    levels = [retaining(x) for x in sorted({*retained, modes}, key=lambda x: x or math.inf)]
    levels += [
        Level(f"{n} coordinates", "mesh coordinates", "mesh coordinates",
              {"model.mesh_coordinates": n})
        for n in (6, 12, 24)
        if n != _coordinates(scene)
    ]  # fmt: skip
    levels += [
        Level(f"{n} slices", "slices", "slices", {"mesh.slices": n})
        for n in (5, 10, 20)
        if n < slices
    ]
    levels += [Level(name, "bodies", "bodies", x) for name, x in rigid_changes(scene).items()]
    some = {(5, 64), (10, 64), (20, 64), (10, 128), (40, 128)}
    levels += [
        Level(f"H{h} N{n}", "harmonics and steps", "method",
              differing(scene, {"sweep.harmonics": h, "sweep.steps": n}))
        for h, n in sorted(some - {(harmonics, steps)}, key=lambda pair: (pair[1], pair[0]))
    ]  # fmt: skip
    march, shot = Marching(stepper=Newmark(), cycles=200), Shooting(warm_up=10)
    coarse = differing(scene, {"sweep.steps": 64})
    return [
        *levels,
        Level("NM 64x200", "march, Newmark", "", coarse, march, thinned=4),
        Level("exp N64", "shooting, exponential", "", coarse, shot, thinned=4),
    ]


def few_levels(scene: Scene) -> list[Level]:
    """The scene itself, and the few levels that are likely to be cheaper and to suffice."""
    levels = body_levels(scene, scene.model.modes)
    own = own_of(levels)
    wanted = ("10 modes", "50 modes", "5 slices", "H10 N64", "rigid", "rigid pinion")
    return [own, *(level for level in levels if level.name in wanted and level is not own)]


def rigid_changes(scene: Scene) -> Mapping[str, Mapping[str, Any]]:
    """What makes bodies of a scene rigid, with the mass that they have as condensed ones.

    **Returns:**

    Changes of keys, by the name of the level: all rigid, with the foundation that the scene has for
    rigid bodies and without; and, if both gears are condensed, the pinion alone.
    """
    numbers = {gear: _rigid_numbers(scene, gear) for gear in scene.condensed}
    whole = {key: value for own in numbers.values() for key, value in own.items()}
    bare = {f"{gear}.foundation": "none" for gear in numbers}
    found = {"rigid": whole, "rigid, no foundation": whole | bare}
    if len(numbers) == len(GEARS):
        found["rigid pinion"] = numbers["pinion"]
    return found


def _rigid_numbers(scene: Scene, gear: str) -> dict[str, Any]:
    """The keys of a rigid body with the mass of a condensed one, of which its shaft is a part."""
    body = scene.bodies[gear].built.body
    rigid = body.rigid_motions
    inertia = rigid.T @ (body.mass @ rigid)
    own = np.array([inertia[0, 0], inertia[5, 5], 0.5 * (inertia[3, 3] + inertia[4, 4])])
    kind = {f"{gear}.body.kind": "rigid"}
    model = model_of(scene.replace(kind))
    mount = (model.pinion_support, model.wheel_support)[GEARS.index(gear)]
    if isinstance(mount, Shaft):
        own -= _shaft_inertia(mount)
    keys = ("mass_kg", "inertia_kg_m2", "transverse_inertia_kg_m2")
    numbers = zip(keys, own.tolist(), strict=True)
    return kind | {f"{gear}.body.{key}": value for key, value in numbers}


def _shaft_inertia(shaft: Shaft) -> np.ndarray:
    """Mass, polar and transverse inertia of a shaft about its gear's middle [kg, kg m2]."""
    total, left = np.zeros(3), 0.0
    for segment in shaft.segments:
        length, outer, inner = (float(x) for x in (segment.length, segment.outer, segment.inner))
        mass = float(shaft.material.density) * math.pi / 4.0 * (outer**2 - inner**2) * length
        square = (outer**2 + inner**2) / 4.0
        away = left + 0.5 * length - float(shaft.gear_at)
        across = 0.25 * square + length**2 / 12.0 + away**2
        total += mass * np.array([1.0, 0.5 * square, across])
        left += length
    return total


def _coordinates(scene: Scene) -> int:
    return scene.model.at_mesh
