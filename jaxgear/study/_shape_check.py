"""How far off a sweep is for the shapes on which its condensed bodies vibrate.

Excited shapes are combinations of several times as many natural modes. At a few speeds the response
is found again with all of these, or with twice as many natural modes where shapes are natural
modes, and more combinations of them in mesh: the difference is what the shapes leave out, in the
loads that the response really has.
"""

import dataclasses
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._units import um
from jaxgear.scene._build import law_of
from jaxgear.scene._scene import Scene
from jaxgear.study._built import BuiltScene
from jaxgear.study._dynamics import (
    Dynamics,
    Size,
    is_too_large,
    pair_in_motion,
    settings_of,
    size_of,
)
from jaxgear.study._fidelity._level import FLOOR
from jaxgear.study._fidelity._motion import each
from jaxgear.study._ranks import Doubtful
from jaxgear.study._result import Summary
from jaxgear.study._running import timed
from jaxgear.study._sweeping import Sweep

# At most so many speeds, one for so many of the sweep; how far off a response may be unsaid [-].
_MOST, _EACH, _TOLERANCE = 4, 8, 0.01


class ShapeCheck(NamedTuple):
    """Responses at a few speeds, and how far off they are from those with more modes.

    **Fields:**

    - `speeds`: of the pinion [rad/s].
    - `modes`, `shapes`: natural modes of all bodies with many, and shapes of those with few.
    - `force`, `te_rms`: relative errors of the largest mesh force and the RMS of transmission
        error at each; NaN where a response with all modes was not found [-].
    """

    speeds: np.ndarray
    modes: int
    shapes: int
    force: np.ndarray
    te_rms: np.ndarray

    @property
    def summary(self) -> Summary:
        """What a summary tells of it."""
        known = lambda values: [float(x) if np.isfinite(x) else None for x in values]
        return {
            "pinion_speed_rad_s": self.speeds,
            "natural_modes": self.modes,
            "shapes": self.shapes,
            "error_dynamic_ratio": known(self.force),
            "error_te_rms": known(self.te_rms),
        }

    @property
    def notes(self) -> list[str]:
        """A warning, where the shapes are too few."""
        found = []
        words = ("largest mesh force", self.force), ("RMS of transmission error", self.te_rms)
        for what, errors in words:
            if np.any(np.abs(errors) > _TOLERANCE):
                worst = int(np.nanargmax(np.abs(errors)))
                found.append(
                    Doubtful(
                        f"With {self.modes} natural modes of condensed bodies in place of the "
                        f"{self.shapes} shapes the {what} at {self.speeds[worst]:.5g} rad/s is "
                        f"{100.0 * abs(errors[worst]):.2g} % "
                        f"{'larger' if errors[worst] < 0.0 else 'smaller'}: raise "
                        "model.coordinates, or let teeth meet softer by tip relief."
                    )
                )
        return found


# What a sweep tells where nothing is checked, of `power-holes` (docs/accuracy.md).
UNCHECKED = Doubtful(
    "Over a cycle of so many mesh periods the shapes of condensed bodies are not checked unasked. "
    "Of helical teeth over holes the default was within 0.2 % of many more shapes in the largest "
    "mesh force, within 0.5 % in the RMS of transmission error. sweep.check_shapes = true checks a "
    "few speeds, in a minute each."
)


def is_unchecked(scene: Scene, size: Size) -> bool:
    """Whether a sweep leaves shapes unchecked: over a long cycle, unless the scene says.

    A speed takes minutes there with all modes.
    """
    if "check_shapes" in scene.sweep.given:
        return False
    fewer = any(body.on_modes is not None for body in scene.bodies.values())
    return fewer and is_too_large(scene.sweep, size)


def shape_check(built: BuiltScene, dynamics: Dynamics, found: Sweep) -> ShapeCheck | None:
    """Find responses of a sweep again with all modes of which shapes are made.

    **Arguments:**

    - `built`: the scene with its bodies.
    - `dynamics`: its pair in motion.
    - `found`: the sweep.

    **Returns:**

    The errors; or `None` where no shapes are left out, where the sweep does not go by harmonic
    balance, or where nothing has settled.

    **Raises:**

    - `SolverFailure` if the quasi-static cycle was not solved.
    """
    scene = built.scene
    richer = {
        gear: dataclasses.replace(body, flexible=body.on_modes())
        for gear, body in scene.bodies.items()
        if body.on_modes is not None
    }
    method = settings_of(law_of(scene.mesh), scene.sweep, size_of(dynamics.pair)).method
    chosen = _some(found)
    if not (richer and chosen.size and isinstance(method, HarmonicBalance)):
        return None
    whole = dataclasses.replace(scene, bodies=MappingProxyType({**scene.bodies, **richer}))
    whole = whole.replace({"model.mesh_coordinates": scene.at_mesh_of_reference})
    pair = pair_in_motion(BuiltScene(whole))
    speeds = found.speeds[chosen]
    answers = timed(each, method, pair.system, speeds)
    ratio, te_rms, _ = np.where(answers.solved, answers.values, np.nan)
    own = [found.responses[found.main][place].numbers for place in chosen]
    # Nobody needs a part of nothing.
    cycle = dynamics.pair.cycle
    least = FLOOR * float(np.mean(np.asarray(cycle.approach))) / um
    off = np.array([float(one.te_rms) for one in own]) / um - te_rms
    return ShapeCheck(
        speeds=speeds,
        modes=sum(len(place.waves) for place in pair.bodies),
        shapes=sum(len(place.waves) for place in dynamics.pair.bodies),
        force=np.array([float(one.dynamic_ratio) for one in own]) / ratio - 1.0,
        te_rms=off / np.maximum(te_rms, least),
    )


def _some(found: Sweep) -> np.ndarray:
    """Places of a few speeds where one response has settled: that of the highest, and others."""
    ways = list(found.responses.values())
    alone = [
        place
        for place, first in enumerate(ways[0])
        if all(way[place].settled and not way[place].differs(first) for way in ways)
    ]
    if not alone:
        return np.zeros(0, dtype=int)
    count = min(_MOST, -(-len(found.speeds) // _EACH))
    highest = max(alone, key=lambda place: ways[0][place].dynamic_ratio)
    # Where a cold start must find the same response, none of the others may be a guess.
    spread = np.linspace(0, len(alone) - 1, count + 1)[1:].round().astype(int)
    others = [alone[i] for i in spread if alone[i] != highest]
    return np.sort([highest, *others[: count - 1]])
