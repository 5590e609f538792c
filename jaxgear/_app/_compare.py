"""Error against time: steady responses of a scene by many methods and settings, side by side."""

from collections.abc import Sequence
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._app._commands import _finish, _names, _progress
from jaxgear._app._dynamics import speeds_of
from jaxgear._app._model import model_of
from jaxgear._app._rungs import (
    Answers,
    Reference,
    Rung,
    Summary,
    Tables,
    answers_of,
    cheapest,
    draw,
    each,
    row_of,
    some_speeds,
    speeds_around,
    timed_reference,
)
from jaxgear._app._scene import Scene
from jaxgear._app._statics import SolverFailure, Stopwatch
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
from jaxgear._system._model import PairModel
from jaxgear._types import Scalar
from jaxgear._units import um

# A median error below this is good enough [-].
TOLERANCE = 1e-3
# A response within this of the reference is the same one; beyond, it is another branch [-].
_SAME_BRANCH = 0.03
# Speeds at which all rungs are compared, and time steps of the reference.
_SPEEDS, _REFERENCE_PHASES = 30, 1024
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


def compare(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Steady responses by all methods against a reference by shooting: error over time.

    A scene with condensed bodies is compared with other models of itself: see `compare_bodies`.

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
    require(
        scene["mesh.periods"] <= _PERIODS,
        "`compare` takes cycles of up to {most} mesh periods, got mesh.periods = {got}. Compare "
        "the scene with fewer: what is found of methods and steps holds for long cycles too.",
        most=_PERIODS,
        got=scene["mesh.periods"],
    )
    if scene.condensed:
        # Finite elements are imported for scenes that have some only.
        from jaxgear._app import _compare_bodies

        return _compare_bodies.compare_bodies(scene, folder, quiet)
    return compared(scene, model_of(scene), rungs_of(scene), folder, quiet)


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
    tables = Tables(
        lambda slices, changes: (scene.replace({"mesh.slices": slices, **changes}), model), watch
    )
    own = int(scene["mesh.slices"])
    # Slices are compared with four times the scene's, or twice the most.
    most = max(rung.slices for rung in rungs)
    finest = sorted({own} | {2 * most for rung in rungs if rung.family == _SLICES})
    with _progress(len(rungs) + len(finest), "compare", quiet) as done:
        if scene.has_table("sweep"):
            at = some_speeds(speeds_of(scene), speeds)
        else:
            at = speeds_around(tables(phases, own).system, speeds)
        references: dict[int, Reference] = {}
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
            found = tables(rung.phases, rung.slices)
            program = _adaptive if isinstance(rung.method, Adaptive) else each
            rows.append(row_of(rung, found, at, by, watch, program=program, branch=_SAME_BRANCH))
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
    title = f"{scene['name']}, {scene['pair.torque_pinion_Nm']:g} N m, {at.size} speeds"
    draw(rows, title, folder, TOLERANCE, recommended)
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


def _reference(dynamics: PairDynamics, speeds: Speeds, watch: Stopwatch) -> Reference:
    """Responses by shooting from the quasi-static state, after a march."""

    def find() -> tuple[Answers, np.ndarray]:
        method = Shooting(stepper=Exponential(), warm_up=20)
        answers, change, modes = watch(_judged, method, dynamics.system, speeds)
        finite = np.isfinite(np.asarray(change)).all(axis=(1, 2))
        growth = np.full(finite.size, np.inf)
        growth[finite] = np.abs(multipliers(change[finite], modes)[:, 0])
        return answers, np.asarray(answers.settled) & (growth <= _STABLE)

    return timed_reference(find)


def _judged(method: Shooting, system: DynamicSystem, speeds: Speeds):
    """Answers, monodromy matrices, and the modes that scale them."""
    modes = modal_basis(system)
    orbits = steady_states(system, speeds, method)
    change = jax.lax.map(lambda orbit: monodromy(system, modes, orbit), orbits)
    return answers_of(system, orbits), change, modes


def _adaptive(method: AbstractMethod, system: DynamicSystem, speeds: Speeds) -> Answers:
    """Answers one speed after the other: steps of their own length do not batch."""
    return answers_of(system, jax.lax.map(lambda speed: method.orbit(system, speed, None), speeds))


def _recommended(rows: Sequence[Summary], slices: int) -> str | None:
    """Name of the fastest rung on the scene's slices that is good enough, if there is one."""
    own = [row for row in rows if row["slices"] == slices and row["family"] != _SLICES]
    found = cheapest(own, TOLERANCE)
    return None if found is None else found["name"]
