"""Rungs of the ladder of models and methods: what each answers, in which time, and how far off."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._cli._writing import finish
from jaxgear._dynamics._orbit import AbstractMethod, Orbit
from jaxgear._dynamics._sweep import steady_states
from jaxgear._dynamics._system import DynamicSystem, PairDynamics
from jaxgear._dynamics._types import Speeds
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._dynamic import (
    dynamic_ratio,
    dynamic_transmission_error,
    orbit_mean,
    orbit_rms,
)
from jaxgear._response._loads import mesh_stiffness
from jaxgear._response._transmission import cycle_mean
from jaxgear._system._model import PairModel
from jaxgear.plot._plots import compare_pictures
from jaxgear.scene._build import grid_of
from jaxgear.scene._scene import Scene
from jaxgear.study._dynamics import dynamics_of
from jaxgear.study._head import names_of
from jaxgear.study._ladder import (
    MOST,
    QUANTITIES,
    choose,
    columns_of,
    for_each,
    words_of,
    worst,
)
from jaxgear.study._result import title_of
from jaxgear.study._running import seconds, timed
from jaxgear.study._statics import require_solved

if TYPE_CHECKING:
    Flags = Array
else:
    Flags = Bool[Array, "speed"]

Summary = dict[str, Any]

# A fluctuation is compared with this share of what teeth give way by, where it is less [-].
_FLOOR = 0.01
# Torque of the held-out points, over the scene's own.
HELD_OUT_TORQUE = 0.7
TORQUE = "pair.torque_pinion_Nm"
# Runs of a program that are timed, at the most, and the seconds that suffice.
_RUNS, _ENOUGH = 5, 1.0


@dataclass(frozen=True)
class Rung:
    """A model with a method and its settings, on so many time steps and slices.

    `together` batches the speeds also where one after the other is faster; every `thinned`-th
    speed is computed, and the time scaled. `changes` are values of the scene's keys that make the
    rung's model out of it.
    """

    name: str
    family: str
    method: AbstractMethod
    phases: int
    slices: int
    together: bool = False
    thinned: int = 1
    changes: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))


class Answers(eqx.Module):
    """What is compared, at each speed.

    **Fields:**

    - `dynamic_ratio`: largest mesh force over the static one [-].
    - `te_rms`: RMS of the dynamic transmission error [m].
    - `te_mean`: its mean [m].
    - `settled`: whether the method says that it has settled.
    """

    dynamic_ratio: Speeds
    te_rms: Speeds
    te_mean: Speeds
    settled: Flags


@dataclass(frozen=True)
class Reference:
    """Answers that others are compared with.

    `good` are the speeds where they are settled and stable; errors of a response are relative to
    its `floors` [m] where its own value is less.
    """

    answers: Answers
    good: np.ndarray
    time_s: float
    floors: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True)
class Elsewhere:
    """Speeds and a torque that rungs are not chosen by, and the reference there."""

    words: str
    speeds: Speeds
    loads: Mapping[str, float]
    reference: Reference


class Tables:
    """The pair in time on various numbers of steps and slices, each built once.

    `made` gives the scene and its model for slices and changes of the scene.
    """

    def __init__(
        self,
        made: Callable[[int, Mapping[str, Any]], tuple[Scene, PairModel]],
    ):
        self.made = made
        self.built: dict[tuple[Any, ...], PairDynamics] = {}
        self.builders: dict[tuple[Any, ...], Callable[[PairModel], PairDynamics]] = {}

    def __call__(
        self,
        phases: int,
        slices: int,
        changes: Mapping[str, Any] = MappingProxyType({}),
        loads: Mapping[str, float] = MappingProxyType({}),
    ) -> PairDynamics:
        """The pair on so many steps in a mesh period and slices across the face.

        Loads change real values only: nothing is compiled again for them.
        """
        program = phases, slices, *sorted(changes.items())
        key = *program, *sorted(loads.items())
        if key not in self.built:
            scene, model = self.made(slices, {**changes, **loads})
            if program not in self.builders:
                grid = grid_of(scene.replace({"mesh.phases": phases}), model)
                self.builders[program] = lambda model: dynamics_of(scene, model, grid)
            # It runs once: compiled in half the time it runs twice as long.
            options = (("xla_backend_optimization_level", 0),)
            found = timed(self.builders[program], model, options=options)
            require_solved(found.cycle.converged)
            self.built[key] = found
        return self.built[key]


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


def elsewhere(
    scene: Scene, at: Speeds, referred: Callable[[Speeds, Mapping[str, float]], Reference]
) -> list[Elsewhere]:
    """Speeds between those by which rungs are chosen, and a lower torque, with their reference.

    **Arguments:**

    - `scene`: that is compared.
    - `at`: the speeds by which rungs are chosen.
    - `referred`: the reference at speeds, with changes of the scene's loads.
    """
    loads = {TORQUE: HELD_OUT_TORQUE * float(scene[TORQUE])}
    return [
        Elsewhere(words, speeds, load, referred(speeds, load))
        for words, speeds, load in (
            ("speeds between these", other_speeds(at), {}),
            (f"these speeds at {HELD_OUT_TORQUE:g} x the torque", at, loads),
        )
    ]


def thinned(count: int, every: int) -> np.ndarray:
    """Places of every so many of some speeds, in their middle; of few speeds one at least."""
    return np.arange(min(every, count) // 2, count, every)


def answers_of(system: DynamicSystem, orbits: Orbit, law: AbstractContactLaw) -> Answers:
    """What is compared, of responses with the speed leading."""

    def one(orbit: Orbit):
        error = dynamic_transmission_error(system, orbit)
        return (
            dynamic_ratio(system, orbit, law),
            orbit_rms(system, error),
            orbit_mean(system, error),
        )

    ratio, rms, mean = jax.vmap(one)(orbits)
    return Answers(ratio, rms, mean, orbits.settled)


def each(method: AbstractMethod, system: DynamicSystem, speeds: Speeds) -> Answers:
    """Answers as the library finds them: batched where that is faster."""
    return answers_of(system, steady_states(system, speeds, method), method.law)


def together(method: AbstractMethod, system: DynamicSystem, speeds: Speeds) -> Answers:
    """Answers at all speeds in one batch."""
    orbits = jax.vmap(lambda speed: method.orbit(system, speed, None))(speeds)
    return answers_of(system, orbits, method.law)


def row_of(
    rung: Rung,
    dynamics: PairDynamics,
    speeds: Speeds,
    reference: Reference,
    *,
    program: Callable[..., Answers] = each,
    quantities: Sequence[str] = ("dynamic_ratio", "te_rms"),
    branch: float | None = None,
) -> Summary:
    """One rung's line of the summary.

    **Arguments:**

    - `rung`: the model and its method.
    - `dynamics`: its pair.
    - `speeds`: of the reference.
    - `reference`: its answers.
    - `program`: finds answers of a method, system and speeds.
    - `quantities`: that are compared.
    - `branch`: a response within this of the reference is the same one, and what is beyond
        counts as another branch; without it, all are the same one [-].

    **Returns:**

    The line.
    """
    chosen = thinned(speeds.size, rung.thinned)
    arguments = rung.method, dynamics.system, speeds[chosen]
    found, best, compiling = _shortest(together if rung.together else program, arguments)
    return {
        "name": rung.name,
        "family": rung.family,
        "dofs": len(dynamics.dofs) - dynamics.system.free.shape[1],
        "phases": rung.phases,
        "slices": rung.slices,
        "speeds": chosen.size,
        "time_s": best * speeds.size / chosen.size,
        "compile_s": compiling,
        **errors_of(found, reference, chosen, quantities, branch),
        "settled_share": float(np.mean(np.asarray(found.settled))),
    }


def counted(scene: Scene, quantities: Sequence[str]) -> tuple[str, ...]:
    """Of what is compared in motion, that which counts; all, where the scene names none of it."""
    named = scene.get("compare.responses") or quantities
    return tuple(name for name in quantities if name in named) or tuple(quantities)


def recommendation(
    scene: Scene,
    rows: Sequence[Summary],
    own: Summary,
    quantities: Sequence[str],
    held_out: Callable[[Summary], Mapping[str, float | None]],
) -> Summary:
    """What a comparison in motion comes to.

    **Arguments:**

    - `scene`: gives tolerance and responses.
    - `rows`: lines of the rungs.
    - `own`: that of the scene itself.
    - `quantities`: what was compared.
    - `held_out`: finds a rung's errors elsewhere; they are written into its line.

    **Returns:**

    Its part of the summary.
    """
    tolerance, responses = float(scene["compare.tolerance"]), counted(scene, quantities)

    def tried(row: Summary) -> Mapping[str, float | None]:
        if "held_out" not in row:
            row["held_out"] = held_out(row)
        return row["held_out"]

    choice = choose(rows, tolerance, responses, tried)
    return {
        "recommended": None if choice.row is None else choice.row["name"],
        "recommended_for": for_each(rows, tolerance, responses, tried),
        "words": words_of(choice, own, tolerance, responses, judged="95 % errors"),
        "tolerance": tolerance,
        "responses": list(responses),
    }


def errors_of(
    found: Answers,
    reference: Reference,
    chosen: np.ndarray,
    quantities: Sequence[str],
    branch: float | None,
) -> Summary:
    """Median and 95 % of the errors at the chosen speeds, and how many are on the same branch."""
    good = reference.good[chosen]
    errors = {}
    for name in quantities:
        is_, should = (np.asarray(getattr(x, name)) for x in (found, reference.answers))
        least = reference.floors.get(name, 0.0)
        errors[name] = np.abs(is_ - should[chosen]) / np.maximum(np.abs(should[chosen]), least)
    finite = good & np.all([np.isfinite(error) for error in errors.values()], axis=0)
    within = np.inf if branch is None else branch
    same = finite & np.all([error <= within for error in errors.values()], axis=0)
    counted = same if 2 * np.count_nonzero(same) >= np.count_nonzero(good) else finite
    quantile = lambda error, share: (
        float(np.quantile(error[counted], share)) if counted.any() else None
    )
    return {
        "error": {name: quantile(error, 0.5) for name, error in errors.items()},
        "error_95": {name: quantile(error, 0.95) for name, error in errors.items()},
        "same_branch_share": float(np.count_nonzero(same) / max(np.count_nonzero(good), 1)),
    }


def errors_elsewhere(
    rung: Rung,
    points: Sequence[Elsewhere],
    tables: Tables,
    *,
    program: Callable[..., Answers] = each,
    quantities: Sequence[str] = ("dynamic_ratio", "te_rms"),
    branch: float | None = None,
) -> dict[str, float | None]:
    """The largest of a rung's 95 % errors at held-out points.

    Arguments as for `row_of`. Where it is on another branch at too many speeds there is none.
    """
    found: dict[str, float | None] = dict.fromkeys(quantities, 0.0)
    for point in points:
        chosen = thinned(point.speeds.size, rung.thinned)
        pair = tables(rung.phases, rung.slices, rung.changes, point.loads)
        run = together if rung.together else program
        answers = timed(run, rung.method, pair.system, point.speeds[chosen])
        part = errors_of(answers, point.reference, chosen, quantities, branch)
        good = part["same_branch_share"] >= MOST
        for name, before in found.items():
            both = {"now": part["error_95"][name] if good else None, "before": before}
            largest = worst(both, tuple(both))
            found[name] = largest if np.isfinite(largest) else None
    return found


def _shortest(
    program: Callable[..., Answers], arguments: tuple[Any, ...]
) -> tuple[Answers, float, float]:
    """Answers of a program, seconds of its shortest run, and seconds to compile it.

    Programs that differ in real values only are compiled once.
    """
    compiled = seconds()[0]
    taken: list[float] = []
    while True:
        before = seconds()[1]
        found = timed(program, *arguments)
        taken.append(seconds()[1] - before)
        if len(taken) == _RUNS or (len(taken) > 1 and sum(taken) > _ENOUGH):
            return found, min(taken), seconds()[0] - compiled
        # What takes long is known well enough after once.
        if taken[0] > 5.0 * _ENOUGH:
            return found, taken[0], seconds()[0] - compiled


def reported(scene: Scene, found: Summary, folder: Folder, statics: Summary | None) -> Summary:
    """Draw a chart, and write the summary.

    **Arguments:**

    - `scene`: that was compared.
    - `found`: its chart.
    - `folder`: for the results; exists.
    - `statics`: what was found of the quasi-static cycle.

    **Returns:**

    The summary that is also in `summary.json`.
    """
    title = f"{title_of(scene)}, {len(found['reference']['speeds_rad_s'])} speeds"
    _draw(found, title, folder)
    beside = {} if statics is None else {"statics": statics}
    return finish(scene, folder, names_of(scene) | {"compare": found | beside})


def _draw(found: Summary, title: str, folder: Folder) -> None:
    """The chart of error over time for each quantity, and the rungs as a table."""
    rows, tolerance = found["rungs"], found["tolerance"]
    columns = columns_of(rows)
    figure = partial(
        compare_pictures.overview,
        rows,
        tuple(rows[0]["error"]),
        title,
        tolerance=tolerance,
        recommended=found["recommended"],
        words="error that 95 % of the speeds on the branch of the reference stay below",
    )
    save(figure, columns, folder, "compare_overview")
    for name in rows[0]["error"]:
        figure = partial(
            compare_pictures.error_over_time,
            [row | {"error": worst(row["error_95"], (name,))} for row in rows],
            title,
            tolerance=tolerance,
            recommended=found["recommended_for"].get(name),
            quantity=f"95 % error of the {QUANTITIES[name]}, relative",
        )
        ending = "" if name == "dynamic_ratio" else f"_{name}"
        save(figure, columns, folder, f"compare{ending}")


def timed_reference(
    find: Callable[[], tuple[Answers, np.ndarray]], dynamics: PairDynamics | None = None
) -> Reference:
    """A reference and the seconds that it took, compilation included.

    **Arguments:**

    - `find`: finds answers, and where they are good.
    - `dynamics`: the pair, for the floors of errors; without it there are none.
    """
    start = time.perf_counter()
    answers, good = find()
    seconds = time.perf_counter() - start
    return Reference(answers, good, seconds, {} if dynamics is None else floors_of(dynamics))


def floors_of(dynamics: PairDynamics) -> dict[str, float]:
    """What the RMS of a fluctuation is compared with at least: a hundredth of the teeth's give."""
    cycle = dynamics.cycle
    stiffness = jax.jit(lambda cycle: cycle_mean(cycle, mesh_stiffness(cycle)))(cycle)
    return {"te_rms": _FLOOR * abs(float(cycle.load[0, 0])) / float(stiffness)}
