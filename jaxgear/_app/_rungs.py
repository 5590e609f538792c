"""Rungs of the ladder of models and methods: what each answers, in which time, and how far off."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxgear._app import _dynamic_pictures as dynamic_pictures
from jaxgear._app import _pictures as pictures
from jaxgear._app._dynamics import dynamics_of
from jaxgear._app._model import grid_of
from jaxgear._app._scene import Scene
from jaxgear._app._statics import Stopwatch, require_solved
from jaxgear._dynamics._orbit import AbstractMethod, Orbit
from jaxgear._dynamics._sweep import steady_states
from jaxgear._dynamics._system import DynamicSystem, PairDynamics, modal_basis
from jaxgear._dynamics._types import Speeds
from jaxgear._response._dynamic import (
    dynamic_ratio,
    dynamic_transmission_error,
    orbit_mean,
    orbit_rms,
)
from jaxgear._system._model import PairModel

if TYPE_CHECKING:
    Flags = Array
else:
    Flags = Bool[Array, "speed"]

Summary = dict[str, Any]

# What can be compared, in words.
QUANTITIES = {
    "dynamic_ratio": "largest mesh force",
    "te_rms": "RMS of transmission error",
    "te_mean": "mean transmission error",
}
# Of the speeds that count, so many must be settled, for a rung to be recommended [-].
MOST = 0.9
# Without a sweep in the scene: speeds as shares of the one at which the mesh frequency meets the
# mode with the largest share of its energy in the mesh [-].
_AROUND = 0.1, 2.5
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

    `good` are the speeds where they are settled and stable.
    """

    answers: Answers
    good: np.ndarray
    time_s: float


class Tables:
    """The pair in time on various numbers of steps and slices, each built once.

    `made` gives the scene and its model for slices and changes of the scene.
    """

    def __init__(
        self,
        made: Callable[[int, Mapping[str, Any]], tuple[Scene, PairModel]],
        watch: Stopwatch,
    ):
        self.made, self.watch = made, watch
        self.built: dict[tuple[Any, ...], PairDynamics] = {}

    def __call__(
        self, phases: int, slices: int, changes: Mapping[str, Any] = MappingProxyType({})
    ) -> PairDynamics:
        """The pair on so many steps in a mesh period and slices across the face."""
        key = phases, slices, *sorted(changes.items())
        if key not in self.built:
            scene, model = self.made(slices, changes)
            grid = grid_of(scene.replace({"mesh.phases": phases}), model)
            build = lambda model: dynamics_of(scene, model, grid)
            # It runs once: compiled in half the time it runs twice as long.
            options = {"xla_backend_optimization_level": 0}
            found = self.watch(build, model, options=options)
            require_solved(found.cycle.converged)
            self.built[key] = found
        return self.built[key]


def some_speeds(speeds: np.ndarray, count: int) -> Speeds:
    """Some of the speeds, from the first to the last, none twice."""
    chosen = np.unique(np.linspace(0, speeds.size - 1, count).round().astype(int))
    return jnp.asarray(speeds[chosen])


def speeds_around(system: DynamicSystem, count: int) -> Speeds:
    """Speeds around the one where the mesh frequency meets the mode of the mesh."""
    basis = jax.jit(modal_basis)(system)
    energy = np.sum(np.asarray(basis.mesh @ system.mean) * np.asarray(basis.mesh), axis=1)
    mode = int(np.argmax(energy / np.asarray(basis.square)))
    critical = float(np.sqrt(basis.square[mode])) / system.teeth
    return jnp.linspace(_AROUND[0] * critical, _AROUND[1] * critical, count)


def answers_of(system: DynamicSystem, orbits: Orbit) -> Answers:
    """What is compared, of responses with the speed leading."""

    def one(orbit: Orbit):
        error = dynamic_transmission_error(system, orbit)
        return dynamic_ratio(system, orbit), orbit_rms(system, error), orbit_mean(system, error)

    ratio, rms, mean = jax.vmap(one)(orbits)
    return Answers(ratio, rms, mean, orbits.settled)


def each(method: AbstractMethod, system: DynamicSystem, speeds: Speeds) -> Answers:
    """Answers as the library finds them: batched where that is faster."""
    return answers_of(system, steady_states(system, speeds, method))


def together(method: AbstractMethod, system: DynamicSystem, speeds: Speeds) -> Answers:
    """Answers at all speeds in one batch."""
    return answers_of(system, jax.vmap(lambda speed: method.orbit(system, speed, None))(speeds))


def row_of(
    rung: Rung,
    dynamics: PairDynamics,
    speeds: Speeds,
    reference: Reference,
    watch: Stopwatch,
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
    - `watch`: keeps the time.
    - `program`: finds answers of a method, system and speeds.
    - `quantities`: that are compared.
    - `branch`: a response within this of the reference is the same one, and what is beyond
        counts as another branch; without it, all are the same one [-].

    **Returns:**

    The line.
    """
    chosen = np.arange(rung.thinned // 2, speeds.size, rung.thinned)
    arguments = rung.method, dynamics.system, speeds[chosen]
    found, best, compiling = _timed(watch, together if rung.together else program, arguments)
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
        errors[name] = np.abs(is_ / should[chosen] - 1.0)
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


def _timed(
    watch: Stopwatch, program: Callable[..., Answers], arguments: tuple[Any, ...]
) -> tuple[Answers, float, float]:
    """Answers of a program, seconds of its shortest run, and seconds to compile it.

    Programs that differ in real values only are compiled once.
    """
    compiled = watch.compile_s
    seconds: list[float] = []
    while True:
        before = watch.run_s
        found = watch(program, *arguments)
        seconds.append(watch.run_s - before)
        if len(seconds) == _RUNS or (len(seconds) > 1 and sum(seconds) > _ENOUGH):
            return found, min(seconds), watch.compile_s - compiled
        # What takes long is known well enough after once.
        if seconds[0] > 5.0 * _ENOUGH:
            return found, seconds[0], watch.compile_s - compiled


def is_good(row: Summary, tolerance: float) -> bool:
    """Whether a rung's errors are small enough, at enough speeds."""
    return min(row["same_branch_share"], row["settled_share"]) >= MOST and all(
        error is not None and error <= tolerance for error in row["error"].values()
    )


def cheapest(rows: Sequence[Summary], tolerance: float) -> Summary | None:
    """The fastest rung that is good enough, if there is one."""
    good = [row for row in rows if is_good(row, tolerance)]
    return min(good, key=lambda row: row["time_s"]) if good else None


def draw(
    rows: Sequence[Summary], title: str, folder: Path, tolerance: float, recommended: str | None
) -> None:
    """The chart of error over time for each quantity, and the rungs as a table.

    **Arguments:**

    - `rows`: lines of the summary.
    - `title`: the case.
    - `folder`: for the files; exists.
    - `tolerance`: of the errors, relative [-].
    - `recommended`: name of the rung to be marked.
    """
    columns = _columns(rows)
    for name in rows[0]["error"]:
        figure = dynamic_pictures.compare(
            [row | {"error": _number(row["error"][name])} for row in rows],
            title,
            tolerance=tolerance,
            recommended=recommended,
            quantity=f"median error of the {QUANTITIES[name]}, relative",
        )
        ending = "" if name == "dynamic_ratio" else f"_{name}"
        pictures.save(figure, columns, folder, f"compare{ending}")


def _columns(rows: Sequence[Summary]) -> dict[str, np.ndarray]:
    """The rungs as a table."""
    flat = [
        {key: value for key, value in row.items() if not isinstance(value, dict)}
        | {
            f"{kind}_{name}": value
            for kind in ("error", "error_95")
            for name, value in row[kind].items()
        }
        for row in rows
    ]
    return {key: np.asarray([_number(row[key]) for row in flat]) for key in flat[0]}


def _number(value: Any) -> Any:
    """The value, or what is not a number where there is none."""
    return np.nan if value is None else value


def timed_reference(find: Callable[[], tuple[Answers, np.ndarray]]) -> Reference:
    """A reference and the seconds that it took, compilation included."""
    start = time.perf_counter()
    answers, good = find()
    return Reference(answers, good, time.perf_counter() - start)
