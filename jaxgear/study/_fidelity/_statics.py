"""The quasi-static cycle by many models of one scene.

A point is a torque with flanks; an answer is what a mesh cycle comes to. The reference is the
scene's own model on more slices and phases, with exact contact.
"""

import functools
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxgear as jg
from jaxgear._checks import InputError
from jaxgear._contact._root_influence import Influences
from jaxgear._kept_programs import QUICKLY, USUALLY
from jaxgear._types import Flag, Reals
from jaxgear._units import um
from jaxgear.scene._build import flanks_of, grid_of, law_of, model_of
from jaxgear.scene._mesh_roots import asks_for_roots, influences_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS, STATIC_RESPONSES
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.study._design import twin
from jaxgear.study._fidelity._choice import MARGIN, worst
from jaxgear.study._fidelity._engine import (
    AbstractProblem,
    Run,
)
from jaxgear.study._fidelity._level import (
    FLOOR,
    NOTHING,
    RESPONSES,
    Answers,
    Changes,
    Level,
    Reference,
    errors_of,
    scales_of,
)
from jaxgear.study._fidelity._levels import Hierarchy
from jaxgear.study._fidelity._models import Models
from jaxgear.study._result import Summary
from jaxgear.study._running import seconds, timed
from jaxgear.study._statics import SolverFailure, headline, root_numbers

# Measured, and only looked at where a level is tried.
_EXTRAS = ("face_load_factor", "transverse_load_factor", "te_harmonic_1")
_ROOTS = "max_root_stress"
# Torques, over the scene's own, by which a level is chosen, and at which it is then tried.
_CHOSEN, _HELD_OUT = (1.0, 0.5), (0.7, 1.3)
# About what a tooth pair resists [N/(mm um)], for a relief of the size that a search looks at.
_TOOTH_PAIR = 14.0
# At least so many slices and phases has the reference of bodies that are not condensed.
_FINEST = (80, 256)

Work = Literal["run", "map", "optimise"]


class Point(NamedTuple):
    """An operating point: torque over the scene's own [-], flanks, whether it is chosen by."""

    words: str
    torque: float
    flank: Mapping[str, float]
    chosen: bool


class _Loaded(eqx.Module):
    """An operating point, or several with the point leading.

    **Fields:**

    - `torque`: on the pinion [N m].
    - `flanks`: deviations.
    """

    torque: Reals
    flanks: jg.Flanks


def points_of(scene: Scene, work: Work = "run") -> list[Point]:
    """Operating points: those by which a level is chosen, and others at which it is tried.

    A map and a search visit other flanks: relieved ones stand for them, depths larger by a share
    of what a tooth pair deflects by, extents of 0.3.
    """
    found = [
        Point(f"{share:g} x the torque", share, {}, share in _CHOSEN)
        for share in (*_CHOSEN, *_HELD_OUT)
    ]
    own = {key: scene.value(key) for key in visited(scene.optimise, work)}
    own = {key: value for key, value in own.items() if isinstance(value, float)}
    if not own:
        return found
    model = model_of(scene, {f"{gear}.body.kind": "rigid" for gear in scene.condensed})
    force = float(model.torque) / float(model.pair.base_radius[0])
    deflection = 1e-3 * force / float(model.pair.face_width) / _TOOTH_PAIR
    reliefs = [key.removesuffix("depth_um") + "extent" for key in own if key.endswith("depth_um")]
    for torque, depth, chosen in ((1.0, 1.0, True), (0.7, 0.5, False)):
        words = f"{torque:g} x the torque, flanks cut back by {depth:g} deflections"
        flank = {key: x + depth * deflection for key, x in own.items()}
        found.append(Point(words, torque, flank | dict.fromkeys(reliefs, 0.3), chosen))
    return found


def visited(asked: OptimiseKeys, work: Work) -> list[str]:
    """Keys of the flanks, depths among them, that a map or a search changes."""
    if work == "map":
        return [f"flank.{gear}.tip_relief.depth_um" for gear in GEARS]
    if work != "optimise" or not asked.is_given:
        return []
    keys = [key for key in asked.vary if key.startswith("flank.") and key.endswith("_um")]
    both = asked.symmetric
    return list(dict.fromkeys([*keys, *(twin(key) for key in keys if both)]))


def measured_of(roots: bool) -> tuple[str, ...]:
    """What is measured, with root stress or without."""
    return tuple(name for name in (*STATIC_RESPONSES, *_EXTRAS) if roots or name != _ROOTS)


def _answers(
    model: jg.PairModel,
    grid: jg.MeshGrid,
    law: jg.AbstractContactLaw,
    points: _Loaded,
    influences: Influences | None,
) -> Answers:
    """What is measured at each point, and what the mesh deflects by; times of points add up."""

    def one(point: _Loaded) -> tuple[Reals, Flag]:
        loaded = eqx.tree_at(lambda m: (m.torque, m.flanks), model, (point.torque, point.flanks))
        cycle = jg.mesh_cycle(loaded, grid, law=law, throw=False)
        error = jg.transmission_error(loaded.pair, cycle)
        stiffness = jg.cycle_mean(cycle, jg.mesh_stiffness(cycle))
        found = headline(loaded, cycle, law) | {
            "mesh_stiffness_mean_N_um": stiffness * um,
            "te_harmonic_1_um": jg.harmonic_amplitudes(cycle, error, 1)[0] / um,
        }
        if roots := root_numbers(loaded, cycle, influences):
            found[RESPONSES[_ROOTS].key] = jnp.max(jnp.stack(list(roots.values())))
        deflection = cycle.load[0, 0] / stiffness / um
        values = [*(found[RESPONSES[name].key] for name in measured_of(bool(roots))), deflection]
        return jnp.stack(values), jnp.all(cycle.converged)

    values, solved = jax.lax.map(one, points)
    return Answers(values.T, solved)


class StaticProblem(AbstractProblem):
    """The quasi-static cycle of a scene."""

    shares = (MARGIN, 0.5 * MARGIN)
    judged = ("largest errors", "largest error at the torques by which levels are chosen")

    def __init__(
        self,
        scene: Scene,
        *,
        work: Work = "run",
        levels: Sequence[Level] | None = None,
        points: Sequence[Point] | None = None,
        judge: Changes = NOTHING,
        quick: bool = False,
    ):
        """Cycles for some work, or at other points, by all levels or some.

        By default more slices and phases judge them, else what `judge` changes of the scene. With
        `quick`, programs are compiled for a short wait: times are about twice those of a run.
        """
        self.scene = scene
        self.levels = Hierarchy(scene).static() if levels is None else levels
        self.points = points_of(scene, work) if points is None else points
        roots = asks_for_roots(scene.mesh, scene.compare, scene.optimise)
        self.measured = measured_of(roots)
        # The mesh stiffness of condensed bodies is that of teeth alone: it compares with no other.
        apart = "mesh_stiffness_mean" if scene.condensed else ""
        self.names = tuple(x for x in self.measured if x not in (apart, *_EXTRAS))
        # Who asks for some responses only does not ask for others.
        self.extras = () if scene.compare.responses else _EXTRAS
        self.models = Models(scene, moving=False)
        self.options = QUICKLY if quick else USUALLY
        self._influences: dict[str, Influences | None] = {}
        slices, phases = 2 * scene.mesh.slices, 2 * scene.mesh.phases
        if not scene.condensed:
            slices, phases = max(slices, _FINEST[0]), max(phases, _FINEST[1])
        finer = {"mesh.slices": slices, "mesh.phases": phases}
        self.finest = {**(judge or finer), "mesh.contact": "exact"}
        self.chosen = np.asarray([point.chosen for point in self.points], dtype=bool)

    def require_responses(self) -> None:
        """Refuse responses of a scene without a sweep none of which the quasi-static cycle has.

        **Raises:**

        - `InputError` naming them.
        """
        named = self.scene.compare.responses
        if named and not set(named) & set(self.names):
            raise InputError(
                f"compare.responses names {', '.join(named)}: in motion only, or of teeth alone "
                "where bodies are condensed. Add a table [sweep], or name some of "
                f"{', '.join(self.names)}."
            )

    @functools.cached_property
    def _reference(self) -> Reference:
        run, before = self.run(Level("reference", "", changes=self.finest)), seconds()[1]
        answers = timed(run.program, *run.arguments, options=run.options)
        values, solved = np.asarray(answers.values), np.asarray(answers.solved)
        if not solved.all():
            raise SolverFailure("the reference, on more slices and phases, was not solved")
        time_s = (seconds()[1] - before) * run.times
        return Reference(values, solved, values[-1], time_s)

    def reference(self, level: Level) -> Reference:
        """The same for all levels."""
        return self._reference

    def run(self, level: Level) -> Run:
        """All points, also those where levels are tried only."""
        scene, model = self.models(level.changes)
        each = [
            _Loaded(
                # Couples on the pinion's shaft stay: the mesh has the share.
                model.torque + (point.torque - 1.0) * model.mesh_torque,
                flanks_of(scene.replace(point.flank), model.pair) if point.flank else model.flanks,
            )
            for point in self.points
        ]
        points = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(x) for x in leaves]), *each)
        # Solved once for all levels of sliced teeth, and once for those of elements.
        known, tooth = self._influences, scene.mesh.tooth
        if tooth not in known:
            known[tooth] = influences_of(scene, model.pair)
        arguments = model, grid_of(scene, model), law_of(scene.mesh), points, known[tooth]
        return Run(_answers, arguments, 1.0 / len(self.points), options=self.options)

    def line(self, level: Level, answers: Answers, at: Any) -> Summary:
        """The largest errors at the points by which levels are chosen, and at the others."""
        errors = errors_of(self.measured, answers, self._reference)
        solved = np.asarray(answers.solved)

        def largest(name: str, at: np.ndarray) -> float | None:
            value = float(np.max(errors[self.measured.index(name)][at]))
            return value if solved[at].all() and np.isfinite(value) else None

        system = eqx.filter_eval_shape(jg.PairModel.system, self.models(level.changes)[1])
        return {
            "beyond": level.beyond,
            # The drive is counted once.
            "dofs": len(system.structure.map.free) - 1,
            "error": {
                name: largest(name, self.chosen) for name in self.measured if name not in _EXTRAS
            },
            "held_out": {name: largest(name, ~self.chosen) for name in self.measured},
            "changes": {k: "left out" if x is None else x for k, x in level.changes.items()},
        }

    def remark(self, lines: Sequence[Summary], responses: Sequence[str]) -> str:
        """What another physical model would change by more than the tolerance."""
        found, tolerance = "", float(self.scene.compare.tolerance)
        for line in lines:
            far = {name: worst(line["error"], (name,)) for name in responses}
            far = {name: x for name, x in far.items() if tolerance < x < np.inf}
            if line["beyond"] and far:
                said = ", ".join(f"the {RESPONSES[x].words} by {100 * far[x]:.2g} %" for x in far)
                found += f' Beyond the scene: "{line["name"]}" changes {said}.'
        return found

    def about(self) -> Summary:
        """The reference, its points and what errors are relative to."""
        reference = self._reference
        keys = [RESPONSES[name].key for name in self.measured]
        values, scales = reference.values[: len(keys)], scales_of(self.measured, reference)
        mesh = self.scene.changed(self.finest).mesh
        whole = "teeth of finite elements" if mesh.tooth == "elements" else "as given"
        return {
            "name": f"{whole}, {mesh.slices} slices, {mesh.phases} phases, exact contact",
            "time_s": reference.time_s,
            "points": [point._asdict() for point in self.points],
            "values": dict(zip(keys, values, strict=True)),
            "relative_to": dict(zip(keys, scales, strict=True)),
            "relative_to_words": "the reference's own value; of fluctuations (RMS, peak to peak, "
            f"harmonic) at least {100 * FLOOR:g} % of mesh force over mean mesh stiffness",
        }
