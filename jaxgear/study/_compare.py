"""Error against time: steady responses of a scene by many methods and settings, side by side."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._checks import require
from jaxgear._cli._folder import Folder
from jaxgear._cli._writing import finish
from jaxgear._dynamics._floquet import monodromy, multipliers
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import Marching, quasi_static_start
from jaxgear._dynamics._orbit import AbstractMethod, Orbit
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
from jaxgear._dynamics._transient import transient
from jaxgear._dynamics._types import Speeds, Start
from jaxgear._interface._laws import AbstractContactLaw, ExactContact, SmoothContact
from jaxgear._system._model import PairModel
from jaxgear._types import Scalar
from jaxgear._units import um
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import Scene
from jaxgear.study._compare_statics import (
    changed,
    compared_statics,
    draw_statics,
    require_at_rest,
    simpler_bodies,
    static_rungs,
)
from jaxgear.study._dynamics import speeds_of
from jaxgear.study._head import names_of
from jaxgear.study._ladder import MARGIN, cheapest
from jaxgear.study._progress import progress
from jaxgear.study._rungs import (
    TORQUE,
    Answers,
    Elsewhere,
    Reference,
    Rung,
    Summary,
    Tables,
    answers_of,
    counted,
    each,
    elsewhere,
    errors_elsewhere,
    recommendation,
    reported,
    row_of,
    some_speeds,
    timed_reference,
)
from jaxgear.study._running import timed
from jaxgear.study._statics import SolverFailure

# A response within this of the reference is the same one; beyond, it is another branch [-].
_SAME_BRANCH = 0.03
# Speeds at which all rungs are compared, and time steps of the reference.
_SPEEDS, _REFERENCE_PHASES = 30, 1024
# Mesh periods of a cycle, at the most: the methods of short cycles are compared.
PERIODS = 4
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


def compare(scene: Scene, folder: Folder) -> Summary:
    """One scene by many models and methods: error against time, and which suffices.

    Of a scene without [sweep] the quasi-static cycle is compared: see `compared_statics`. With
    [sweep] it stands beside the responses in motion: see `compared`, and `compare_bodies` for
    scenes with condensed bodies.

    **Arguments:**

    - `scene`: checked against the schema.
    - `folder`: for the results; exists.

    **Returns:**

    The summary that is also in `summary.json`.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if the mesh cycle or the reference was not solved at most speeds.
    """
    require(
        scene["mesh.periods"] <= PERIODS,
        "`compare` takes cycles of up to {most} mesh periods, got mesh.periods = {got}. "
        "Compare the scene with fewer: what is found of models and methods holds for long cycles "
        "too.",
        most=PERIODS,
        got=scene["mesh.periods"],
    )
    if not scene.has_table("sweep"):
        require_at_rest(scene)
        found = _statics(scene, folder, "compare")
        return finish(scene, folder, names_of(scene) | {"compare": found})
    statics = _statics(scene, folder, "compare_statics")
    if scene.condensed:
        # Finite elements are imported for scenes that have some only.
        from jaxgear.study import _compare_bodies

        return _compare_bodies.compare_bodies(scene, folder, statics=statics)
    rungs = [*rungs_of(scene), *model_rungs_of(scene)]
    return compared(scene, model_of(scene), rungs, folder, statics=statics)


def _statics(scene: Scene, folder: Folder, name: str) -> Summary:
    """The quasi-static part of the summary, drawn."""
    work = "optimise" if scene.has_table("optimise") else "run"
    rungs = static_rungs(scene)
    # The reference, and two put together.
    with progress(len(rungs) + 3, "compare statics") as done:
        tell = lambda step: done(1)
        chart = compared_statics(scene, work=work, rungs=rungs, tell=tell)
    draw_statics(chart, f"{scene['name']}, {scene['pair.torque_pinion_Nm']:g} N m", folder, name)
    return chart.summary


def compared(
    scene: Scene,
    model: PairModel,
    rungs: Sequence[Rung],
    folder: Folder,
    *,
    speeds: int = _SPEEDS,
    phases: int = _REFERENCE_PHASES,
    statics: Summary | None = None,
) -> Summary:
    """Compare given rungs of a scene in motion; see `chart`.

    **Arguments:**

    - `scene`: gives damping, slices and speeds.
    - `model`: of the scene.
    - `rungs`: with names of their own.
    - `folder`: for the results; exists.
    - `speeds`: number of them.
    - `phases`: time steps of the reference in a mesh period.
    - `statics`: what was found of the quasi-static cycle.

    **Returns:**

    The summary.
    """
    found, _ = chart(scene, model, rungs, speeds=speeds, phases=phases)
    return reported(scene, found, folder, statics)


def chart(
    scene: Scene,
    model: PairModel,
    rungs: Sequence[Rung],
    *,
    speeds: int = _SPEEDS,
    phases: int = _REFERENCE_PHASES,
) -> tuple[Summary, dict[str, Rung]]:
    """Steady responses by many models and methods against a reference by shooting.

    The reference has many more time steps than any rung and comes from another family than harmonic
    balance; slices and bodies are compared with a reference of many more slices. Speeds where the
    reference has not settled or is unstable are left out. At the others a rung is on the same
    branch if its numbers are within a few per cent of the reference's, and its errors are those of
    these speeds; if they are fewer than half, its errors are those of all. Simpler bodies have no
    branch of the reference: their errors are always those of all. Times are for all speeds, once
    compiled and with the mesh tabulated, best of a few runs. What is recommended was tried at
    speeds between these, and at another torque.

    **Arguments:**

    - `scene`, `model`, `rungs`, `speeds`, `phases`: as for `compared`.

    **Returns:**

    The `compare` part of the summary, and the rungs by name.

    **Raises:**

    - `SolverFailure` if the reference was not solved at most speeds.
    """
    tolerance = float(scene["compare.tolerance"])
    branch_of = lambda rung: None if rung.changes else max(_SAME_BRANCH, 2.0 * tolerance)
    tables = Tables(_made(scene, model))
    own = int(scene["mesh.slices"])
    at = some_speeds(speeds_of(scene), speeds)
    # Slices are compared with four times the scene's, or twice the most.
    most = 2 * max(rung.slices for rung in rungs)
    tried = {rung.name: rung for rung in rungs}
    whole = any(rung.family in (SLICES, MODELS) for rung in rungs)
    finest = sorted({own} | ({most} if whole else set()))
    # Slices are compared on equal steps: half as many as the other reference has suffice.
    steps = {slices: phases if slices == own else phases // 2 for slices in finest}

    def referred(speeds: Speeds, loads: Mapping[str, float]) -> Reference:
        pair = tables(steps[finest[-1]], finest[-1], loads=loads)
        return _reference(pair, speeds)

    with progress(len(rungs) + len(finest), "compare") as done:
        references: dict[int, Reference] = {}
        for slices in finest:
            references[slices] = _reference(tables(steps[slices], slices), at)
            done(1)
        if np.mean(references[own].good) < 0.5:
            raise SolverFailure(
                "the reference, shooting from the quasi-static state, is settled and stable at "
                f"{np.count_nonzero(references[own].good)} of {at.size} speeds only"
            )

        def row(rung: Rung) -> Summary:
            by = references[own if rung.family not in (SLICES, MODELS, _WHOLE) else finest[-1]]
            found = tables(rung.phases, rung.slices, rung.changes)
            program = _adaptive if isinstance(rung.method, Adaptive) else each
            line = row_of(rung, found, at, by, program=program, branch=branch_of(rung))
            done(1)
            return line

        rows = [row(rung) for rung in rungs]
        names = ("dynamic_ratio", "te_rms")
        itself = _itself(scene, rungs, rows)
        together = put_together(scene, tried, rows, tolerance, counted(scene, names))
        if together is not None:
            tried[together.name] = together
            rows.append(row(together))

        points: list[Elsewhere] = []

        def held_out(line: Summary) -> Mapping[str, float | None]:
            if not points:
                points.extend(elsewhere(scene, at, referred))
            rung = tried[line["name"]]
            program = _adaptive if isinstance(rung.method, Adaptive) else each
            branch = branch_of(rung)
            return errors_elsewhere(rung, points, tables, program=program, branch=branch)

        said = recommendation(scene, rows, itself, names, held_out)
    reference = references[own]
    return {
        "rungs": rows,
        **said,
        "reference": {
            "name": f"shooting, exact linear part, {phases} steps",
            "slices": own,
            "slices_of_the_rungs_over_slices": most,
            "speeds_rad_s": np.asarray(at),
            "held_out": [point.words for point in points],
            "good": reference.good,
            "dynamic_ratio": reference.answers.dynamic_ratio,
            "te_rms_um": reference.answers.te_rms / um,
            "te_rms_relative_to_at_least_um": reference.floors.get("te_rms", 0.0) / um,
            "time_s": reference.time_s,
        },
    }, tried


def _made(
    scene: Scene, model: PairModel
) -> Callable[[int, Mapping[str, Any]], tuple[Scene, PairModel]]:
    """Scene and model of a rung; the given model, where only slices and torque differ."""

    def made(slices: int, changes: Mapping[str, Any]) -> tuple[Scene, PairModel]:
        found = changed(scene, {"mesh.slices": slices, **changes})
        if set(changes) - {TORQUE}:
            return found, model_of(found)
        torque = jnp.asarray(found[TORQUE], dtype=float)
        return found, eqx.tree_at(lambda m: m.torque, model, torque)

    return made


SLICES = "its slices, H20 N128"
MODELS = "its bodies, H20 N128"
_WHOLE = "together"


def model_rungs_of(scene: Scene) -> list[Rung]:
    """Simpler bodies of a scene, in motion by one method."""
    own = int(scene["mesh.slices"])
    return [
        Rung(name, MODELS, HarmonicBalance(), 128, own, changes=MappingProxyType(changes))
        for name, changes in simpler_bodies(scene).items()
    ]


def _itself(scene: Scene, rungs: Sequence[Rung], rows: Sequence[Summary]) -> Summary:
    """The line of the scene's own settings, or of harmonic balance as it is by default."""
    asked = scene["sweep.harmonics"], scene["sweep.steps"]
    own = int(scene["mesh.slices"])
    for settings in (asked, (20, 128)):
        for rung, row in zip(rungs, rows, strict=True):
            plain = rung.method == HarmonicBalance(harmonics=settings[0])
            if plain and (rung.phases, rung.slices) == (settings[1], own) and not rung.changes:
                return row
    return rows[0]


def put_together(
    scene: Scene,
    rungs: Mapping[str, Rung],
    rows: Sequence[Summary],
    tolerance: float,
    responses: Sequence[str],
) -> Rung | None:
    """The cheapest good method on the cheapest good slices and bodies.

    **Arguments:**

    - `scene`: gives the slices.
    - `rungs`: by name.
    - `rows`: their lines.
    - `tolerance`: of the whole; each part may use up the same share of what a choice may [-].
    - `responses`: that count.

    **Returns:**

    The rung, or `None` if fewer than two parts differ from the scene.
    """
    own = int(scene["mesh.slices"])
    parts = []
    for kind in ("method", SLICES, MODELS):
        is_kind = lambda row, kind=kind: (
            row["family"] == kind if kind != "method" else row["family"] not in (SLICES, MODELS)
        )
        best = cheapest([row for row in rows if is_kind(row)], 0.5 * MARGIN * tolerance, responses)
        parts.append(None if best is None else rungs[best["name"]])
    method, slices, bodies = parts
    if slices is not None and slices.slices >= own:
        slices = None
    if method is None or (slices is None and bodies is None):
        return None
    name = ", ".join(part.name for part in (bodies, slices, method) if part is not None)
    return dataclasses.replace(
        method,
        name=name,
        family=_WHOLE,
        slices=own if slices is None else slices.slices,
        changes=MappingProxyType({}) if bodies is None else bodies.changes,
    )


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
    settings = {(5, 64), (10, 64), (20, 64), (20, 128), (40, 128), (40, 256)}
    settings.add((scene["sweep.harmonics"], scene["sweep.steps"]))
    rungs = [
        Rung(f"H{h} N{n}", "harmonic balance", balance(harmonics=h), n, own)
        for h, n in sorted(settings, key=lambda pair: (pair[1], pair[0]))
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
        Rung(f"{s} slices" if s > 1 else "1 slice", SLICES, balance(), 128, s)
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


def _reference(dynamics: PairDynamics, speeds: Speeds) -> Reference:
    """Responses by shooting from the quasi-static state, after a march."""

    def find() -> tuple[Answers, np.ndarray]:
        method = Shooting(stepper=Exponential(), warm_up=20)
        answers, change, modes = timed(_judged, method, dynamics.system, speeds)
        finite = np.isfinite(np.asarray(change)).all(axis=(1, 2))
        growth = np.full(finite.size, np.inf)
        growth[finite] = np.abs(multipliers(change[finite], modes)[:, 0])
        return answers, np.asarray(answers.settled) & (growth <= _STABLE)

    return timed_reference(find, dynamics)


def _judged(method: Shooting, system: DynamicSystem, speeds: Speeds):
    """Answers, monodromy matrices, and the modes that scale them."""
    modes = modal_basis(system)
    orbits = steady_states(system, speeds, method)
    change = jax.lax.map(lambda orbit: monodromy(system, modes, orbit), orbits)
    return answers_of(system, orbits, method.law), change, modes


def _adaptive(method: AbstractMethod, system: DynamicSystem, speeds: Speeds) -> Answers:
    """Answers one speed after the other: steps of their own length do not batch."""
    orbits = jax.lax.map(lambda speed: method.orbit(system, speed, None), speeds)
    return answers_of(system, orbits, method.law)
