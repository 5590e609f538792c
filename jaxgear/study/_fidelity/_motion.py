"""Steady responses as a problem of comparison: points are speeds at a torque.

Levels are judged by what 95 % of the speeds keep, where the reference is converged and stable. What
is recommended was tried at speeds between these, and at another torque.
"""

import abc
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxgear as jg
from jaxgear._dynamics._adaptive import Adaptive
from jaxgear._dynamics._types import Speeds
from jaxgear._kept_programs import QUICKLY
from jaxgear._types import Reals, Scalar
from jaxgear._units import um
from jaxgear.scene._build import grid_of
from jaxgear.scene._schema import DYNAMIC_RESPONSES
from jaxgear.study._dynamics import dynamics_of, speeds_of
from jaxgear.study._fidelity._choice import MOST, worst
from jaxgear.study._fidelity._engine import AbstractProblem, Run
from jaxgear.study._fidelity._level import (
    NOTHING,
    RESPONSES,
    Answers,
    Changes,
    Level,
    Reference,
    errors_of,
)
from jaxgear.study._fidelity._models import Models
from jaxgear.study._result import Summary
from jaxgear.study._running import timed
from jaxgear.study._statics import SolverFailure, require_solved

# Torque of the held-out points, over the scene's own [-].
_HELD_OUT = 0.7


class OperatingPoints(NamedTuple):
    """Where steady responses are compared: speeds of the pinion [rad/s], and changes of loads."""

    words: str
    speeds: Speeds
    loads: Changes = NOTHING


class AbstractMotion(AbstractProblem):
    """Steady responses of a scene over its speeds."""

    judged = (
        "95 % errors",
        "error that 95 % of the speeds on the branch of the reference stay below",
    )
    # The reference in words of an error message.
    method: str

    def __init__(self, models: Models, levels: Sequence[Level], names: int, speeds: int):
        """Levels of a scene with a sweep, by so many responses at so many speeds."""
        self.scene, self.models, self.levels = (scene := models.scene), models, levels
        self.names = DYNAMIC_RESPONSES[:names]
        at = some_speeds(speeds_of(scene.sweep), speeds)
        loads = {"pair.torque_pinion_Nm": _HELD_OUT * float(scene.pair.torque_pinion_Nm)}
        self.places = (
            OperatingPoints("", at),
            OperatingPoints("speeds between these", other_speeds(at)),
            OperatingPoints(f"these speeds at {_HELD_OUT:g} x the torque", at, loads),
        )
        self.pairs: dict[Any, jg.PairDynamics] = {}
        self.builders: dict[Any, Callable[[jg.PairModel], jg.PairDynamics]] = {}
        self.references: dict[Any, Reference] = {}

    @abc.abstractmethod
    def finest(self, level: Level, place: OperatingPoints) -> Changes:
        """Changes of the scene that make the reference of a level."""

    @abc.abstractmethod
    def solved(self, pair: jg.PairDynamics, speeds: Speeds) -> tuple[Answers, np.ndarray]:
        """Answers of the reference, and where they may be compared with."""

    def branch(self, level: Level) -> float:
        """A response within this of the reference is on the same branch; here all are [-]."""
        return np.inf

    def size(self, level: Level) -> Summary:
        """What of a level's size is told besides."""
        return {}

    def pair(self, changes: Changes, loads: Changes = NOTHING) -> jg.PairDynamics:
        """The pair in time, built once; loads are real values: nothing is compiled for them."""
        program = tuple(sorted((k, v) for k, v in changes.items() if k != "sweep.harmonics"))
        key = program, tuple(sorted(loads.items()))
        if key not in self.pairs:
            scene, model = self.models({**changes, **loads})
            grid = grid_of(scene, model, scene.sweep.steps)
            build = self.builders.setdefault(program, lambda x: dynamics_of(x, grid, scene))
            # It runs once.
            found = timed(build, model, options=QUICKLY)
            require_solved(found.cycle.converged)
            self.pairs[key] = found
        return self.pairs[key]

    def reference(self, level: Level) -> Reference:
        """What a level is compared with, at the speeds by which it is chosen."""
        found = self.reference_at(level, self.places[0])
        if np.mean(found.good) < 0.5:
            raise SolverFailure(
                f"the reference, {self.method} at {np.count_nonzero(found.good)} of "
                f"{found.good.size} speeds only"
            )
        return found

    def reference_at(self, level: Level, place: OperatingPoints) -> Reference:
        """The same at any speeds, good or not."""
        changes = self.finest(level, place)
        key = place.words, tuple(sorted(changes.items()))
        if key not in self.references:
            pair, start = self.pair(changes, place.loads), time.perf_counter()
            answers, good = self.solved(pair, place.speeds)
            taken = time.perf_counter() - start
            deflection = np.asarray(timed(_deflection, pair.cycle))
            self.references[key] = Reference(np.asarray(answers.values), good, deflection, taken)
        return self.references[key]

    def run(self, level: Level, place: OperatingPoints | None = None) -> Run:
        """A level at some speeds: those by which it is chosen, where none are given."""
        place = place or self.places[0]
        pair = self.pair(level.changes, place.loads)
        harmonics = level.changes.get("sweep.harmonics", self.scene.sweep.harmonics)
        method = level.method or jg.HarmonicBalance(harmonics=harmonics)
        at = thinned(place.speeds.size, level.thinned)
        program = one_by_one if isinstance(method, Adaptive) else each
        return Run(
            together if level.batched else program,
            (method, pair.system, place.speeds[at]),
            times=place.speeds.size / at.size,
            at=at,
        )

    def line(self, level: Level, answers: Answers, at: Any) -> Summary:
        """Median and 95 % of the errors, and how many speeds are on the branch of the reference."""
        pair, reference = self.pair(level.changes), self.reference_at(level, self.places[0])
        return {
            "dofs": len(pair.dofs) - pair.system.free.shape[1],
            "phases": level.changes.get("sweep.steps", self.scene.sweep.steps),
            "slices": level.changes.get("mesh.slices", self.scene.mesh.slices),
            "speeds": len(at),
            **over_speeds(self.names, answers, reference, at, self.branch(level)),
            "settled_share": float(np.mean(np.asarray(answers.solved))),
            **self.size(level),
        }

    def held_out(self, level: Level) -> Mapping[str, float | None]:
        """The largest of the 95 % errors; none where it is on another branch too often."""
        errors = []
        for place in self.places[1:]:
            run, reference = self.run(level, place), self.reference_at(level, place)
            answers = timed(run.program, *run.arguments)
            part = over_speeds(self.names, answers, reference, run.at, self.branch(level))
            errors.append(part["error_95"] if part["same_branch_share"] >= MOST else {})
        largest = {name: max(worst(part, (name,)) for part in errors) for name in self.names}
        return {name: x if np.isfinite(x) else None for name, x in largest.items()}

    def told(self, reference: Reference) -> Summary:
        """What both kinds of reference tell: speeds, answers, seconds."""
        tried = [place.words for place in self.places[1:]]
        return {
            "slices": self.scene.mesh.slices,
            "speeds_rad_s": np.asarray(self.places[0].speeds),
            "held_out": [words for words in tried if any(words == x for x, _ in self.references)],
            "good": reference.good,
            **{RESPONSES[name].key: reference.values[row] for row, name in enumerate(self.names)},
            "time_s": reference.time_s,
        }


# --- Speeds


def some_speeds(speeds: np.ndarray, count: int) -> Speeds:
    """Some of the speeds, from the first to the last, none twice."""
    chosen = np.unique(np.linspace(0, speeds.size - 1, count).round().astype(int))
    return jnp.asarray(speeds[chosen])


def other_speeds(speeds: Speeds) -> Speeds:
    """As many speeds in the same range, none of them among those given: between neighbours."""
    between = 0.5 * (speeds[1:] + speeds[:-1])
    if not between.size:
        return 0.9 * speeds
    # One more, so that programs need not be compiled again.
    return jnp.sort(jnp.append(between, 0.25 * speeds[-2] + 0.75 * speeds[-1]))


def thinned(count: int, every: int) -> np.ndarray:
    """Places of every so many of some speeds, in their middle; of few speeds one at least."""
    return np.arange(min(every, count) // 2, count, every)


# --- Answers


def answers_of(system: jg.DynamicSystem, orbits: jg.Orbit, law: jg.AbstractContactLaw) -> Answers:
    """What is compared, of responses with the speed leading."""

    def one(orbit: jg.Orbit) -> Reals:
        error = jg.dynamic_transmission_error(system, orbit) / um
        ratio = jg.dynamic_ratio(system, orbit, law)
        return jnp.stack([ratio, jg.orbit_rms(system, error), jg.orbit_mean(system, error)])

    return Answers(jax.vmap(one)(orbits).T, orbits.settled)


def each(method: jg.AbstractMethod, system: jg.DynamicSystem, speeds: Speeds) -> Answers:
    """Answers as the library finds them: batched where that is faster."""
    return answers_of(system, jg.steady_states(system, speeds, method), method.law)


def together(method: jg.AbstractMethod, system: jg.DynamicSystem, speeds: Speeds) -> Answers:
    """Answers at all speeds in one batch."""
    orbits = jax.vmap(lambda speed: method.orbit(system, speed, None))(speeds)
    return answers_of(system, orbits, method.law)


def one_by_one(method: jg.AbstractMethod, system: jg.DynamicSystem, speeds: Speeds) -> Answers:
    """Answers one speed after the other: steps of their own length do not batch."""
    orbits = jax.lax.map(lambda speed: method.orbit(system, speed, None), speeds)
    return answers_of(system, orbits, method.law)


def _deflection(cycle: jg.MeshCycle) -> Scalar:
    """What the teeth deflect by on average [um]."""
    return cycle.load[0, 0] / jg.cycle_mean(cycle, jg.mesh_stiffness(cycle)) / um


def over_speeds(
    names: Sequence[str], answers: Answers, reference: Reference, at: np.ndarray, branch: float
) -> Summary:
    """Median and 95 % of the errors at speeds, and how many are on the branch of the reference.

    Those within `branch` are. Where fewer than half of the good speeds are, the errors are those of
    all. There is none where there is no number.
    """
    good = reference.good[at]
    errors = errors_of(names, answers, reference, at)
    finite = good & np.all(np.isfinite(errors), axis=0)
    same = finite & np.all(errors <= branch, axis=0)
    counts = same if 2 * np.count_nonzero(same) >= np.count_nonzero(good) else finite
    found: Summary = {}
    for key, share in (("error", 0.5), ("error_95", 0.95)):
        values = [None] * len(names)
        if counts.any():
            values = np.quantile(errors[:, counts], share, axis=1).tolist()
        found[key] = dict(zip(names, values, strict=True))
    share = np.count_nonzero(same) / max(np.count_nonzero(good), 1)
    return found | {"same_branch_share": float(share)}
