"""What responses in motion are compared with: shooting, or harmonic balance on a richer model."""

from collections.abc import Sequence

import jax
import numpy as np

import jaxgear as jg
from jaxgear._dynamics._types import Speeds
from jaxgear.scene._scene import Scene
from jaxgear.study._fidelity._choice import MARGIN
from jaxgear.study._fidelity._level import FLOOR, Answers, Changes, Level
from jaxgear.study._fidelity._levels import Hierarchy
from jaxgear.study._fidelity._models import Models
from jaxgear.study._fidelity._motion import AbstractMotion, OperatingPoints, answers_of, each
from jaxgear.study._progress import narration
from jaxgear.study._result import Summary
from jaxgear.study._running import timed

# A response within this of the reference is the same one; beyond, it is another branch [-].
_SAME_BRANCH = 0.03
# A multiplier beyond this is unstable: rounding shifts it by less [-].
_STABLE = 1.0 + 1e-6
# Keys that leave the physical model as it is.
_NUMERICAL = {"mesh.slices", "sweep.steps", "sweep.harmonics"}
# Natural modes of each body of the richer model.
_MODES = 800


class MethodsProblem(AbstractMotion):
    """Methods and models against shooting: another family than harmonic balance, on many steps.

    Slices and bodies are compared with a reference of many more slices, on half the steps. Speeds
    where the reference has not converged or is unstable are left out. At the others a level is on
    the same branch if its numbers are within a few per cent of the reference's. Simpler bodies have
    no branch of the reference.
    """

    shares = (0.5 * MARGIN,)
    method = "shooting from the quasi-static state, is converged and stable"

    def __init__(
        self,
        scene: Scene,
        levels: Sequence[Level] | None = None,
        *,
        speeds: int = 30,
        steps: int = 1024,
    ):
        """Compare levels, or all, of a scene with a sweep and without condensed bodies.

        The reference has so many steps in a mesh period.
        """
        levels = Hierarchy(scene).methods() if levels is None else levels
        super().__init__(Models(scene, moving=True), levels, 2, speeds)
        self.steps = steps
        self.most = 2 * max(x.changes.get("mesh.slices", scene.mesh.slices) for x in levels)
        self.whole = any(level.axis in ("slices", "bodies") for level in levels)

    def finest(self, level: Level, place: OperatingPoints) -> Changes:
        """Many steps, and for other slices and bodies many slices: they are judged in full."""
        if self.whole and (place.words or level.axis != "method"):
            return {"mesh.slices": self.most, "sweep.steps": self.steps // 2}
        return {"sweep.steps": self.steps}

    def solved(self, pair: jg.PairDynamics, speeds: Speeds) -> tuple[Answers, np.ndarray]:
        """Responses by shooting, after time stepping; good where they are settled and stable."""
        method = jg.Shooting(stepper=jg.Exponential(), warm_up=20)
        answers, change, modes = timed(_with_monodromy, method, pair.system, speeds)
        finite = np.isfinite(np.asarray(change)).all(axis=(1, 2))
        growth = np.full(finite.size, np.inf)
        growth[finite] = np.abs(jg.floquet_multipliers(change[finite], modes)[:, 0])
        return answers, np.asarray(answers.solved) & (growth <= _STABLE)

    def branch(self, level: Level) -> float:
        """A few per cent; of other bodies all are on it."""
        if set(level.changes) - _NUMERICAL:
            return np.inf
        return max(_SAME_BRANCH, 2.0 * float(self.scene.compare.tolerance))

    def about(self) -> Summary:
        """The reference on the scene's own slices."""
        reference = self.reference_at(self.levels[0], self.places[0])
        return {
            "name": f"shooting, exact linear part, {self.steps} steps",
            "slices_of_the_rungs_over_slices": self.most,
            "te_rms_relative_to_at_least_um": float(FLOOR * reference.deflection),
            **self.told(reference),
        }


def _with_monodromy(method: jg.Shooting, system: jg.DynamicSystem, speeds: Speeds):
    """Answers, monodromy matrices, and the modes that scale them."""
    modes = jg.modal_basis(system)
    orbits = jg.steady_states(system, speeds, method)
    change = jax.lax.map(lambda orbit: jg.monodromy(system, modes, orbit), orbits)
    return answers_of(system, orbits, method.law), change, modes


class BodiesProblem(AbstractMotion):
    """Models against harmonic balance on a richer one: more modes and mesh coordinates.

    It has twice the steps of the scene, on the same slices. Levels by shooting and by a march,
    which have nothing of it in common, tell how far it can be trusted. Errors are those of all
    speeds at which the reference is converged.
    """

    method = "harmonic balance from the quasi-static state, is converged"

    def __init__(
        self,
        scene: Scene,
        levels: Sequence[Level] | None = None,
        *,
        speeds: int = 12,
        modes: int | None = None,
    ):
        """Compare levels, or all, of a scene with a sweep and bodies that can vibrate.

        Each body of the reference has so many natural modes, 800 by default, and no fewer than
        shapes in the scene. A speed costs a second to several.
        """
        own = scene.shape_count
        most = 0 if own == 0 else max(own, modes or _MODES)
        with narration("bodies of the reference"):
            models = Models(scene, moving=True)
            models({})
        levels = Hierarchy(scene).bodies(most) if levels is None else levels
        super().__init__(models, levels, 3, speeds)
        self.richest = {
            "model.shapes": "natural",
            "model.coordinates": most,
            "model.mesh_coordinates": scene.at_mesh_of_reference,
            "sweep.steps": 2 * scene.sweep.steps,
        }

    def finest(self, level: Level, place: OperatingPoints) -> Changes:
        """The same for all levels and places."""
        return self.richest

    def solved(self, pair: jg.PairDynamics, speeds: Speeds) -> tuple[Answers, np.ndarray]:
        """Harmonic balance; good where it has converged."""
        method = jg.HarmonicBalance(harmonics=self.scene.sweep.harmonics)
        answers = timed(each, method, pair.system, speeds)
        return answers, np.asarray(answers.solved)

    def size(self, level: Level) -> Summary:
        """Modes, and coordinates in which the mesh tells them apart."""
        bodies = self.pair(level.changes).bodies
        told = self.scene.changed(level.changes).at_mesh if bodies else 0
        return {"modes": sum(len(place.waves) for place in bodies), "mesh_coordinates": told}

    def about(self) -> Summary:
        """The richer model."""
        pair, steps = self.pair(self.richest), self.richest["sweep.steps"]
        modes = sum(len(place.waves) for place in pair.bodies)
        return {
            "name": f"harmonic balance, H{self.scene.sweep.harmonics} N{steps}, {modes} modes, "
            f"{pair.system.vectors.shape[1]} mesh coordinates",
            "motion_left_out_by_mesh_coordinates": float(pair.left_out),
            **self.told(self.reference_at(self.levels[0], self.places[0])),
        }
