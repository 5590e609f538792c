"""Methods, slices and bodies of a scene in motion whose bodies are not condensed."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

from jaxgear._dynamics._adaptive import Adaptive
from jaxgear._dynamics._floquet import monodromy, multipliers
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import Marching
from jaxgear._dynamics._orbit import AbstractMethod
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steady_state import steady_states
from jaxgear._dynamics._steppers import (
    AbstractStepper,
    Exponential,
    GeneralizedAlpha,
    HilberHughesTaylor,
    Midpoint,
    Newmark,
)
from jaxgear._dynamics._system import DynamicSystem, PairDynamics, modal_basis
from jaxgear._dynamics._types import Speeds
from jaxgear._interface._laws import SmoothContact
from jaxgear._units import um
from jaxgear.scene._scene import Scene
from jaxgear.study._fidelity._choice import MARGIN
from jaxgear.study._fidelity._level import FLOOR, Answers, Level
from jaxgear.study._fidelity._models import Models, differing
from jaxgear.study._fidelity._motion import AbstractMotion, OperatingPoints, answers_of
from jaxgear.study._fidelity._static_levels import simpler_bodies
from jaxgear.study._result import Summary
from jaxgear.study._running import timed

# A response within this of the reference is the same one; beyond, it is another branch [-].
_SAME_BRANCH = 0.03
# A multiplier beyond this is unstable: rounding shifts it by less [-].
_STABLE = 1.0 + 1e-6
# Keys that leave the physical model as it is.
_NUMERICAL = {"mesh.slices", "sweep.steps", "sweep.harmonics"}


class MethodsProblem(AbstractMotion):
    """Methods and models against shooting: another family than harmonic balance, on many steps.

    Slices and bodies are compared with a reference of many more slices, on half the steps. Speeds
    where the reference has not converged or is unstable are left out. At the others a level is on
    the same branch if its numbers are within a few per cent of the reference's. Simpler bodies have
    no branch of the reference.
    """

    shares = (0.5 * MARGIN,)
    method = "shooting from the quasi-static state, is settled and stable"

    def __init__(
        self,
        scene: Scene,
        levels: Sequence[Level] | None = None,
        *,
        speeds: int = 30,
        steps: int = 1024,
    ):
        """Compare levels of a scene.

        **Arguments:**

        - `scene`: with a sweep, and without condensed bodies.
        - `levels`: all by default.
        - `speeds`: number of speeds.
        - `steps`: of the reference in a mesh period.
        """
        levels = method_levels(scene) if levels is None else levels
        super().__init__(scene, Models(scene, moving=True), levels, 2, speeds)
        self.steps = steps
        self.most = 2 * max(x.changes.get("mesh.slices", scene.mesh.slices) for x in levels)
        self.whole = any(level.axis in ("slices", "bodies") for level in levels)

    def finest(self, level: Level, place: OperatingPoints) -> Mapping[str, Any]:
        """Many steps, and for other slices and bodies many slices: they are judged in full."""
        if self.whole and (place.words or level.axis != "method"):
            return {"mesh.slices": self.most, "sweep.steps": self.steps // 2}
        return {"sweep.steps": self.steps}

    def solved(self, pair: PairDynamics, speeds: Speeds) -> tuple[Answers, np.ndarray]:
        """Responses by shooting, after a march; good where they are settled and stable."""
        method = Shooting(stepper=Exponential(), warm_up=20)
        answers, change, modes = timed(_with_monodromy, method, pair.system, speeds)
        finite = np.isfinite(np.asarray(change)).all(axis=(1, 2))
        growth = np.full(finite.size, np.inf)
        growth[finite] = np.abs(multipliers(change[finite], modes)[:, 0])
        return answers, np.asarray(answers.solved) & (growth <= _STABLE)

    def branch(self, level: Level) -> float:
        """A few per cent; of other bodies all are on it."""
        if set(level.changes) - _NUMERICAL:
            return np.inf
        return max(_SAME_BRANCH, 2.0 * float(self.scene.compare.tolerance))

    def size(self, level: Level) -> Summary:
        """Nothing besides."""
        return {}

    def about(self) -> Summary:
        """The reference on the scene's own slices."""
        reference = self._reference(self.levels[0], self.places[0])
        return {
            "name": f"shooting, exact linear part, {self.steps} steps",
            "slices_of_the_rungs_over_slices": self.most,
            "te_rms_relative_to_at_least_um": float(FLOOR * reference.deflection),
            **self.told(reference),
        }


def _with_monodromy(method: Shooting, system: DynamicSystem, speeds: Speeds):
    """Answers, monodromy matrices, and the modes that scale them."""
    modes = modal_basis(system)
    orbits = steady_states(system, speeds, method)
    change = jax.lax.map(lambda orbit: monodromy(system, modes, orbit), orbits)
    return answers_of(system, orbits, method.law), change, modes


def balance_level(scene: Scene, harmonics: int, steps: int) -> Level:
    """Harmonic balance with so many harmonics and time steps."""
    changes = differing(scene, {"sweep.harmonics": harmonics, "sweep.steps": steps})
    return Level(f"H{harmonics} N{steps}", "harmonic balance", "method", changes)


def model_levels(scene: Scene, slices: Sequence[int], numbers: Mapping[str, int]) -> list[Level]:
    """Other slices and simpler bodies, by one method.

    **Arguments:**

    - `scene`: that is compared.
    - `slices`: counts across the face.
    - `numbers`: harmonics and steps, by key.
    """
    by = "H{} N{}".format(*numbers.values())
    found = [
        Level(f"{n} slice{'s' if n > 1 else ''}", f"its slices, {by}", "slices",
              differing(scene, {"mesh.slices": n, **numbers}))
        for n in slices
    ]  # fmt: skip
    return found + [
        Level(name, f"its bodies, {by}", "bodies", {**changes, **differing(scene, numbers)})
        for name, changes in simpler_bodies(scene).items()
    ]


def method_levels(scene: Scene) -> list[Level]:
    """All methods and settings that are compared on a scene, family by family."""
    own, width = scene.mesh.slices, float(scene.mesh.smoothing_um)
    settings = {(5, 64), (10, 64), (20, 64), (20, 128), (40, 128), (40, 256)}
    settings.add((scene.sweep.harmonics, scene.sweep.steps))
    levels = [balance_level(scene, h, n) for h, n in sorted(settings, key=lambda x: (x[1], x[0]))]

    def level(name: str, family: str, method: AbstractMethod, steps: int, **more: Any) -> Level:
        changes = differing(scene, {"sweep.steps": steps})
        return Level(name, family, "method", changes, method, **more)

    levels += [
        level(
            f"H{h} N{n} vmap", "its speeds batched", HarmonicBalance(harmonics=h), n, batched=True
        )
        for h, n in ((10, 64), (20, 128))
    ]
    if not scene.damping.active_mesh:
        levels += [
            level(f"H{h} N{n} mean", "its contact averaged", averaged, n)
            for h, n in ((10, 64), (20, 128), (40, 256))
            for averaged in [HarmonicBalance(harmonics=h, averaged=True)]
        ]
    levels += [
        level(f"{part * width:g} um", "its contact smooth, H20 N128", smooth, 128)
        for part in (0.1, 0.3, 1.0, 3.0)
        for smooth in [HarmonicBalance(law=SmoothContact(part * width * um))]
    ]
    numbers = {"sweep.harmonics": 20, "sweep.steps": 128}
    levels += model_levels(scene, sorted({1, 5, own, 2 * own}), numbers)
    steppers: dict[str, tuple[str, AbstractStepper]] = {
        "midpoint": ("mid", Midpoint()),
        "exponential": ("exp", Exponential()),
    }
    levels += [
        level(f"{short} N{n}", f"shooting, {name}", Shooting(stepper=stepper), n)
        for name, (short, stepper) in steppers.items()
        for n in (64, 128, 256)
    ]
    steppers |= {
        "Newmark": ("NM", Newmark()),
        "HHT": ("HHT", HilberHughesTaylor()),
        "generalised alpha": ("GA", GeneralizedAlpha()),
    }
    for name, (short, stepper) in steppers.items():
        levels += [
            level(f"{short} {n}x{c}", f"march, {name}", Marching(stepper=stepper, cycles=c), n)
            for n, c in ((64, 100), (128, 100), (128, 400))
            if n > 64 or name not in ("HHT", "generalised alpha")
        ]
    smooth = Adaptive(law=SmoothContact(0.1 * width * um))
    return [*levels, level("Tsit5 1e-4", "diffrax, 50 cycles", smooth, 128, thinned=10)]
