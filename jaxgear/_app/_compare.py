"""Error against time: steady responses of a scene by many methods and settings, side by side."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxgear._app import _dynamic_pictures as dynamic_pictures
from jaxgear._app import _pictures as pictures
from jaxgear._app._commands import _finish, _names, _progress
from jaxgear._app._dynamics import dynamics_of, speeds_of
from jaxgear._app._model import grid_of, model_of
from jaxgear._app._scene import Scene
from jaxgear._app._statics import SolverFailure, Stopwatch, require_solved
from jaxgear._checks import require
from jaxgear._dynamics._floquet import monodromy, multipliers
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import Marching, quasi_static_start
from jaxgear._dynamics._orbit import AbstractMethod, Orbit
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import (
    AbstractStepper,
    Exponential,
    GeneralizedAlpha,
    HilberHughesTaylor,
    Midpoint,
    Newmark,
)
from jaxgear._dynamics._sweep import steady_states
from jaxgear._dynamics._system import DynamicSystem, PairDynamics, modal_basis
from jaxgear._dynamics._transient import transient
from jaxgear._dynamics._types import Speeds, Start
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._response._dynamic import dynamic_ratio, dynamic_transmission_error, orbit_rms
from jaxgear._system._model import PairModel
from jaxgear._types import Scalar
from jaxgear._units import um

if TYPE_CHECKING:
    Flags = Array
else:
    Flags = Bool[Array, "speed"]

Summary = dict[str, Any]

# A median error below this is good enough [-].
TOLERANCE = 1e-3
# A response within this of the reference is the same one; beyond, it is another branch [-].
_SAME_BRANCH = 0.03
# Of the speeds that count, so many must be on the reference's branch and settled, for a rung to be
# recommended [-].
_MOST = 0.9
# What is compared, in words.
_QUANTITIES = {"dynamic_ratio": "largest mesh force", "te_rms": "RMS of transmission error"}
# Speeds at which all rungs are compared, and time steps of the reference.
_SPEEDS, _REFERENCE_PHASES = 30, 1024
# Without a sweep in the scene: speeds as shares of the one at which the mesh frequency meets the
# mode with the largest share of its energy in the mesh [-].
_AROUND = 0.1, 2.5
# Runs of a program that are timed, at the most, and the seconds that suffice.
_RUNS, _ENOUGH = 5, 1.0
# Mesh periods of a cycle, at the most: the methods of short cycles are compared.
_PERIODS = 4
# A multiplier beyond this is unstable: rounding shifts it by less [-].
_STABLE = 1.0 + 1e-6


class Adaptive(AbstractMethod):
    """Integrate with an adaptive step from one cycle to the next, and hope that it settles.

    **Fields:**

    - `law`: smooth contact, or exact.
    - `rtol`: error of a step over the motion, and over the static deflection [-].
    - `cycles`: to integrate.
    - `tolerance`: change of the motion over the last cycle at which it counts as settled, relative
        [-].
    - `multiple`: cycles after which the response repeats, always 1.
    """

    law: AbstractContactLaw = eqx.field(default_factory=ExactContact)
    rtol: float = eqx.field(static=True, default=1e-4)
    cycles: int = eqx.field(static=True, default=50)
    tolerance: float = eqx.field(static=True, default=1e-4)
    multiple: int = eqx.field(static=True, default=1)

    def orbit(self, system: DynamicSystem, speed: Scalar, start: Start | None = None) -> Orbit:
        """Find the response at one speed; see `AbstractMethod`."""
        start = quasi_static_start(system) if start is None else start
        middles = system.table.middles
        late = (self.cycles - 2.0) * system.table.periods
        shares = jnp.concatenate([late + middles, late + system.table.periods + middles])
        times = jnp.concatenate([jnp.zeros(1), shares * system.mesh_period(speed)])
        found = transient(
            system, speed, 1.0, start, times,
            law=self.law, rtol=self.rtol, atol=self.rtol, throw=False,
        )  # fmt: skip
        last = slice(-middles.size, None)
        error = found.transmission_error[1:].reshape(2, -1)
        residual = jnp.max(jnp.abs(error[1] - error[0])) / jnp.max(jnp.abs(error))
        return Orbit(
            speed=speed,
            place=found.place[last],
            load=found.load[last],
            motion=found.motion[last],
            start=start,
            residual=residual,
            settled=(residual <= self.tolerance) & found.complete,
            steps=(found.steps + found.rejected).astype(float),
        )


@dataclass(frozen=True)
class Rung:
    """A method with its settings, on so many time steps and slices.

    `together` batches the speeds also where one after the other is faster; every `thinned`-th
    speed is computed, and the time scaled.
    """

    name: str
    family: str
    method: AbstractMethod
    phases: int
    slices: int
    together: bool = False
    thinned: int = 1


class Answers(eqx.Module):
    """What is compared, at each speed.

    **Fields:**

    - `dynamic_ratio`: largest mesh force over the static one [-].
    - `te_rms`: RMS of the dynamic transmission error [m].
    - `settled`: whether the method says that it has settled.
    """

    dynamic_ratio: Speeds
    te_rms: Speeds
    settled: Flags


def compare(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Steady responses by all methods against a reference by shooting: error over time.

    The reference has many more time steps than any rung and comes from another family than harmonic
    balance; slices are compared with a reference of many more slices. Speeds where the reference
    has not settled or is unstable are left out. At the others a rung is on the same branch if both
    numbers are within 3 % of the reference's, and its errors are those of these speeds; if they
    are fewer than half, its errors are those of all. Times are for all speeds, once compiled and
    with the mesh tabulated, best of a few runs.

    **Arguments:**

    - `scene`: checked against the schema.
    - `folder`: for the results; exists.
    - `quiet`: whether to show no progress.

    **Returns:**

    The summary that is also in `summary.json`.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if the mesh cycle or the reference was not solved at most speeds.
    """
    model = model_of(scene)
    require(
        scene["mesh.periods"] <= _PERIODS,
        "`compare` takes cycles of up to {most} mesh periods, got mesh.periods = {got}. Compare "
        "the scene with fewer: what is found of methods and steps holds for long cycles too.",
        most=_PERIODS,
        got=scene["mesh.periods"],
    )
    return compared(scene, model, rungs_of(scene), folder, quiet)


def compared(
    scene: Scene,
    model: PairModel,
    rungs: Sequence[Rung],
    folder: Path,
    quiet: bool,
    *,
    speeds: int = _SPEEDS,
    phases: int = _REFERENCE_PHASES,
) -> Summary:
    """Compare given rungs; see `compare`.

    **Arguments:**

    - `scene`: gives damping, slices and speeds.
    - `model`: of the scene.
    - `rungs`: with names of their own.
    - `folder`: for the results; exists.
    - `quiet`: whether to show no progress.
    - `speeds`: number of them.
    - `phases`: time steps of the reference in a mesh period.

    **Returns:**

    The summary.
    """
    watch = Stopwatch()
    tables = _Tables(scene, model, watch)
    own = int(scene["mesh.slices"])
    # Slices are compared with four times the scene's, or twice the most.
    most = max(rung.slices for rung in rungs)
    finest = sorted({own} | {2 * most for rung in rungs if rung.family == _SLICES})
    with _progress(len(rungs) + len(finest), "compare", quiet) as done:
        if scene.has_table("sweep"):
            at = _some(speeds_of(scene), speeds)
        else:
            at = _speeds_around(tables(phases, own).system, speeds)
        references: dict[int, _Reference] = {}
        for slices in finest:
            # Slices are compared on equal steps: half as many as the other reference has suffice.
            steps = phases if slices == own else phases // 2
            references[slices] = _reference(tables(steps, slices), at, watch)
            done(1)
        reference = references[own]
        if np.mean(reference.good) < 0.5:
            raise SolverFailure(
                "the reference, shooting from the quasi-static state, is settled and stable at "
                f"{np.count_nonzero(reference.good)} of {at.size} speeds only"
            )
        rows = []
        for rung in rungs:
            by = references[2 * most] if rung.family == _SLICES else reference
            rows.append(_row(rung, tables(rung.phases, rung.slices), at, by, watch))
            done(1)
    recommended = _recommended(rows, own)
    summary = _names(scene) | {
        "compare": {
            "rungs": rows,
            "recommended": recommended,
            "tolerance": TOLERANCE,
            "reference": {
                "name": f"shooting, exact linear part, {phases} steps",
                "slices": own,
                "slices_of_the_rungs_over_slices": 2 * most,
                "speeds_rad_s": np.asarray(at),
                "good": reference.good,
                "dynamic_ratio": reference.answers.dynamic_ratio,
                "te_rms_um": reference.answers.te_rms / um,
                "time_s": reference.time_s,
            },
        }
    }
    columns = _columns(rows)
    title = f"{scene['name']}, {scene['pair.torque_pinion_Nm']:g} N m, {at.size} speeds"
    for name, words in _QUANTITIES.items():
        figure = dynamic_pictures.compare(
            [row | {"error": _number(row["error"][name])} for row in rows],
            title,
            tolerance=TOLERANCE,
            recommended=recommended,
            quantity=f"median error of the {words}, relative",
        )
        ending = "" if name == "dynamic_ratio" else f"_{name}"
        pictures.save(figure, columns, folder, f"compare{ending}")
    return _finish(scene, folder, summary, watch)


_SLICES = "its slices, H20 N128"


def rungs_of(scene: Scene) -> list[Rung]:
    """All methods and settings that are compared on a scene.

    **Arguments:**

    - `scene`: gives the slices, and the width of smooth contact.

    **Returns:**

    The rungs, family by family.
    """
    own = int(scene["mesh.slices"])
    width = float(scene["mesh.smoothing_um"])
    balance = HarmonicBalance
    rungs = [
        Rung(f"H{h} N{n}", "harmonic balance", balance(harmonics=h), n, own)
        for h, n in ((5, 64), (10, 64), (20, 64), (20, 128), (40, 128), (40, 256))
    ]
    rungs += [
        Rung(f"H{h} N{n} vmap", "its speeds batched", balance(harmonics=h), n, own, together=True)
        for h, n in ((10, 64), (20, 128))
    ]
    if not scene["damping.active_mesh"]:
        rungs += [
            Rung(f"H{h} N{n} mean", "its contact averaged", averaged, n, own)
            for h, n in ((10, 64), (20, 128), (40, 256))
            for averaged in [balance(harmonics=h, averaged=True)]
        ]
    rungs += [
        Rung(f"{part * width:g} um", "its contact smooth, H20 N128", balance(law=law), 128, own)
        for part in (0.1, 0.3, 1.0, 3.0)
        for law in [SmoothContact(part * width * um)]
    ]
    rungs += [
        Rung(f"{s} slices" if s > 1 else "1 slice", _SLICES, balance(), 128, s)
        for s in sorted({1, 5, own, 2 * own})
    ]
    steppers: dict[str, tuple[str, AbstractStepper]] = {
        "midpoint": ("mid", Midpoint()),
        "exponential": ("exp", Exponential()),
    }
    rungs += [
        Rung(f"{short} N{n}", f"shooting, {name}", Shooting(stepper=stepper), n, own)
        for name, (short, stepper) in steppers.items()
        for n in (64, 128, 256)
    ]
    steppers |= {
        "Newmark": ("NM", Newmark()),
        "HHT": ("HHT", HilberHughesTaylor()),
        "generalised alpha": ("GA", GeneralizedAlpha()),
    }
    for name, (short, stepper) in steppers.items():
        rungs += [
            Rung(f"{short} {n}x{c}", f"march, {name}", Marching(stepper=stepper, cycles=c), n, own)
            for n, c in ((64, 100), (128, 100), (128, 400))
            if n > 64 or name not in ("HHT", "generalised alpha")
        ]
    smooth = Adaptive(law=SmoothContact(0.1 * width * um))
    return [*rungs, Rung("Tsit5 1e-4", "diffrax, 50 cycles", smooth, 128, own, thinned=10)]


class _Tables:
    """The pair in time on various numbers of steps and slices, each built once."""

    def __init__(self, scene: Scene, model: PairModel, watch: Stopwatch):
        self.scene, self.model, self.watch = scene, model, watch
        self.built: dict[tuple[int, int], PairDynamics] = {}

    def __call__(self, phases: int, slices: int) -> PairDynamics:
        """The pair on so many steps in a mesh period and slices across the face."""
        if (phases, slices) not in self.built:
            scene = self.scene.replace({"mesh.phases": phases, "mesh.slices": slices})
            grid = grid_of(scene, self.model)
            build = lambda model: dynamics_of(scene, model, grid)
            # It runs once: compiled in half the time it runs twice as long.
            options = {"xla_backend_optimization_level": 0}
            found = self.watch(build, self.model, options=options)
            require_solved(found.cycle.converged)
            self.built[phases, slices] = found
        return self.built[phases, slices]


def _some(speeds: np.ndarray, count: int) -> Speeds:
    """Some of the speeds, from the first to the last, none twice."""
    chosen = np.unique(np.linspace(0, speeds.size - 1, count).round().astype(int))
    return jnp.asarray(speeds[chosen])


def _speeds_around(system: DynamicSystem, count: int) -> Speeds:
    """Speeds around the one where the mesh frequency meets the mode of the mesh."""
    basis = jax.jit(modal_basis)(system)
    energy = np.sum(np.asarray(basis.mesh @ system.mean) * np.asarray(basis.mesh), axis=1)
    mode = int(np.argmax(energy / np.asarray(basis.square)))
    critical = float(np.sqrt(basis.square[mode])) / system.teeth
    return jnp.linspace(_AROUND[0] * critical, _AROUND[1] * critical, count)


@dataclass(frozen=True)
class _Reference:
    """Answers that others are compared with.

    `good` are the speeds where they are settled and stable.
    """

    answers: Answers
    good: np.ndarray
    time_s: float


def _reference(dynamics: PairDynamics, speeds: Speeds, watch: Stopwatch) -> _Reference:
    """Responses by shooting from the quasi-static state, after a march."""
    start = time.perf_counter()
    method = Shooting(stepper=Exponential(), warm_up=20)
    answers, change, modes = watch(_judged, method, dynamics.system, speeds)
    finite = np.isfinite(np.asarray(change)).all(axis=(1, 2))
    growth = np.full(finite.size, np.inf)
    growth[finite] = np.abs(multipliers(change[finite], modes)[:, 0])
    good = np.asarray(answers.settled) & (growth <= _STABLE)
    return _Reference(answers, good, time.perf_counter() - start)


def _judged(method: Shooting, system: DynamicSystem, speeds: Speeds):
    """Answers, monodromy matrices, and the modes that scale them."""
    modes = modal_basis(system)
    orbits = steady_states(system, speeds, method)
    change = jax.lax.map(lambda orbit: monodromy(system, modes, orbit), orbits)
    return _answers(system, orbits), change, modes


def _answers(system: DynamicSystem, orbits: Orbit) -> Answers:
    def one(orbit: Orbit):
        error = dynamic_transmission_error(system, orbit)
        return dynamic_ratio(system, orbit), orbit_rms(system, error)

    ratio, rms = jax.vmap(one)(orbits)
    return Answers(ratio, rms, orbits.settled)


def _row(
    rung: Rung, dynamics: PairDynamics, speeds: Speeds, reference: _Reference, watch: Stopwatch
) -> Summary:
    """One rung's line of the summary."""
    chosen = np.arange(rung.thinned // 2, speeds.size, rung.thinned)
    arguments = rung.method, dynamics.system, speeds[chosen]
    found, best, compiling = _timed(watch, _together if rung.together else _each, arguments)
    return {
        "name": rung.name,
        "family": rung.family,
        "dofs": len(dynamics.dofs) - dynamics.system.free.shape[1],
        "phases": rung.phases,
        "slices": rung.slices,
        "speeds": chosen.size,
        "time_s": best * speeds.size / chosen.size,
        "compile_s": compiling,
        **_errors(found, reference, chosen),
        "settled_share": float(np.mean(np.asarray(found.settled))),
    }


def _errors(found: Answers, reference: _Reference, chosen: np.ndarray) -> Summary:
    """Median and 95 % of the errors at the chosen speeds, and how many are on the same branch."""
    good = reference.good[chosen]
    errors = {}
    for name in _QUANTITIES:
        is_, should = (np.asarray(getattr(x, name)) for x in (found, reference.answers))
        errors[name] = np.abs(is_ / should[chosen] - 1.0)
    finite = good & np.all([np.isfinite(error) for error in errors.values()], axis=0)
    same = finite & np.all([error <= _SAME_BRANCH for error in errors.values()], axis=0)
    counted = same if 2 * np.count_nonzero(same) >= np.count_nonzero(good) else finite
    quantile = lambda error, share: (
        float(np.quantile(error[counted], share)) if counted.any() else None
    )
    return {
        "error": {name: quantile(error, 0.5) for name, error in errors.items()},
        "error_95": {name: quantile(error, 0.95) for name, error in errors.items()},
        "same_branch_share": float(np.count_nonzero(same) / max(np.count_nonzero(good), 1)),
    }


def _each(method: AbstractMethod, system: DynamicSystem, speeds: Speeds) -> Answers:
    """Answers as the library finds them: batched where that is faster."""
    if isinstance(method, Adaptive):
        return _answers(system, jax.lax.map(lambda speed: method.orbit(system, speed), speeds))
    return _answers(system, steady_states(system, speeds, method))


def _together(method: AbstractMethod, system: DynamicSystem, speeds: Speeds) -> Answers:
    """Answers at all speeds in one batch."""
    return _answers(system, jax.vmap(lambda speed: method.orbit(system, speed, None))(speeds))


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


def _recommended(rows: Sequence[Summary], slices: int) -> str | None:
    """Name of the fastest rung on the scene's slices that is good enough, if there is one."""
    good = [
        row
        for row in rows
        if row["slices"] == slices
        and row["family"] != _SLICES
        and min(row["same_branch_share"], row["settled_share"]) >= _MOST
        and all(error is not None and error <= TOLERANCE for error in row["error"].values())
    ]
    return min(good, key=lambda row: row["time_s"])["name"] if good else None


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
