"""Error against time where bodies are condensed: how much of a model a scene needs.

From the scene's own bodies, slices, steps and harmonics one thing is changed at a time; at last all
that was cheaper and good enough is put together.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from jaxgear._cli._folder import Folder
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import Marching
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import Newmark
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft
from jaxgear._units import um
from jaxgear.scene._build import model_of
from jaxgear.scene._mesh_bodies import MeshBody, with_bodies
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import DYNAMIC_RESPONSES, GEARS
from jaxgear.study._dynamics import speeds_of
from jaxgear.study._ladder import MARGIN, cheapest
from jaxgear.study._progress import narration, progress
from jaxgear.study._rungs import (
    Elsewhere,
    Reference,
    Rung,
    Summary,
    Tables,
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

# Speeds at which all rungs are compared: one costs a tenth of a second to several.
_SPEEDS = 12
# Of the reference: modes of all bodies together, and combinations that the mesh tells apart.
_REFERENCE_MODES, _REFERENCE_COORDINATES = 400, 24
# Where the scene is silent.
_MODES, _COORDINATES = 100, 12
# Families of rungs, from which one each is put together.
_BODIES, _KEPT, _TOLD_APART = "bodies", "modes", "mesh coordinates"
_ACROSS, _BALANCE = "slices", "harmonics and steps"


def compare_bodies(
    scene: Scene,
    folder: Folder,
    *,
    rungs: Sequence[Rung] | None = None,
    speeds: int = _SPEEDS,
    modes: int | None = None,
    statics: Summary | None = None,
) -> Summary:
    """Compare the models of a scene with condensed bodies; see `chart`.

    **Arguments:**

    - `scene`: checked against the schema, with bodies that can vibrate.
    - `folder`: for the results; exists.
    - `rungs`, `speeds`, `modes`: as for `chart`.
    - `statics`: what was found of the quasi-static cycle.

    **Returns:**

    The summary that is also in `summary.json`.
    """
    found, _ = chart(scene, rungs=rungs, speeds=speeds, modes=modes)
    return reported(scene, found, folder, statics)


def chart(
    scene: Scene,
    *,
    rungs: Sequence[Rung] | None = None,
    speeds: int = _SPEEDS,
    modes: int | None = None,
) -> tuple[Summary, dict[str, Rung]]:
    """Steady responses by many models of one scene against a richer one: error over time.

    The reference is harmonic balance with many more modes, more mesh coordinates and twice the
    steps of the scene, on the same slices. Rungs by shooting and by a march, which have nothing
    of it in common, tell how far it can be trusted. Errors are those of all speeds at which
    the reference is settled; times are for all speeds, once compiled and with the mesh tabulated.
    What is recommended was tried at speeds between these, and at another torque.

    **Arguments:**

    - `scene`: checked against the schema, with bodies that can vibrate, and a sweep.
    - `rungs`: with names of their own, that of the scene itself first; all by default.
    - `speeds`: number of them.
    - `modes`: of each body of the reference; by default 400 of all bodies together.

    **Returns:**

    The `compare` part of the summary, and the rungs by name.

    **Raises:**

    - `ValueError` if bodies or gears are impossible, or cannot vibrate together.
    - `SolverFailure` if the mesh cycle or the reference was not solved at most speeds.
    """
    own = scene.get("model.coordinates", _MODES)
    most = modes or _REFERENCE_MODES // len(scene.condensed)
    most = 0 if own == 0 else max(own, most)
    with narration("bodies of the reference") as tell:
        models = _Models(scene, most, tell)
    tables = Tables(models)
    rungs = model_rungs(scene, most) if rungs is None else list(rungs)
    tried = {rung.name: rung for rung in rungs}
    steps = 2 * scene["sweep.steps"]
    tolerance = float(scene["compare.tolerance"])
    at = some_speeds(speeds_of(scene), speeds)
    richest = {
        "model.coordinates": most,
        "model.mesh_coordinates": max(_REFERENCE_COORDINATES, _coordinates(scene)),
    }
    method = HarmonicBalance(harmonics=scene["sweep.harmonics"])

    def referred(speeds: Any, loads: Mapping[str, float]) -> Reference:
        dynamics = tables(steps, scene["mesh.slices"], richest, loads)
        find = lambda: _settled(timed(each, method, dynamics.system, speeds))
        return timed_reference(find, dynamics)

    with progress(len(rungs) + 2, "compare") as done:
        reference = referred(at, {})
        done(1)
        if np.mean(reference.good) < 0.5:
            raise SolverFailure(
                "the reference, harmonic balance from the quasi-static state, is settled at "
                f"{np.count_nonzero(reference.good)} of {at.size} speeds only"
            )

        def row(rung: Rung) -> Summary:
            pair = tables(rung.phases, rung.slices, rung.changes)
            found = row_of(rung, pair, at, reference, quantities=DYNAMIC_RESPONSES)
            done(1)
            changed = scene.replace(rung.changes)
            return found | {
                "modes": sum(len(place.waves) for place in pair.bodies),
                "mesh_coordinates": _coordinates(changed) if pair.bodies else 0,
            }

        rows = [row(rung) for rung in rungs]
        itself = rows[0]
        whole = combined(rungs, rows, MARGIN * tolerance, counted(scene, DYNAMIC_RESPONSES))
        if whole is not None:
            tried[whole.name] = whole
            rows.append(row(whole))
        points: list[Elsewhere] = []

        def held_out(line: Summary) -> Mapping[str, float | None]:
            if not points:
                points.extend(elsewhere(scene, at, referred))
            rung = tried[line["name"]]
            return errors_elsewhere(rung, points, tables, quantities=DYNAMIC_RESPONSES)

        said = recommendation(scene, rows, itself, DYNAMIC_RESPONSES, held_out)
    kept = sorted((row for row in rows if row["family"] == _KEPT), key=lambda row: row["modes"])
    rows = [*kept, *(row for row in rows if row["family"] != _KEPT)]
    dynamics = tables(steps, scene["mesh.slices"], richest)
    about = _reference_summary(scene, dynamics, steps, at, reference)
    about["held_out"] = [point.words for point in points]
    return {"rungs": rows, **said, "reference": about}, tried


def model_rungs(scene: Scene, most: int) -> list[Rung]:
    """All models and settings that are compared on a scene with condensed bodies.

    **Arguments:**

    - `scene`: with its bodies.
    - `most`: modes of each body, at the most; 0 are all.

    **Returns:**

    The rungs: the scene itself, then family by family.
    """
    steps, harmonics = scene["sweep.steps"], scene["sweep.harmonics"]
    slices, modes = scene["mesh.slices"], scene.get("model.coordinates", _MODES)
    balance = HarmonicBalance(harmonics=harmonics)

    def model(name: str, family: str, changes: Mapping[str, Any]) -> Rung:
        own = changes.get("mesh.slices", slices)
        rest = {key: value for key, value in changes.items() if key != "mesh.slices"}
        return Rung(name, family, balance, steps, own, changes=MappingProxyType(rest))

    every = max(each.built.body.dofs for each in scene.bodies.values())
    kept = sorted({10, 50, 100, 200, most} - {0, modes})
    kept = [count for count in kept if count <= min(most or every, every)]
    rungs = [model(f"{modes or 'all'} modes", _KEPT, {})]
    rungs += [model(f"{count} modes", _KEPT, {"model.coordinates": count}) for count in kept]
    rungs += [
        model(f"{count} coordinates", _TOLD_APART, {"model.mesh_coordinates": count})
        for count in (6, 12, 24)
        if count != _coordinates(scene)
    ]
    rungs += [
        model(f"{count} slices", _ACROSS, {"mesh.slices": count})
        for count in (5, 10, 20)
        if count < slices
    ]
    rungs += [model(name, _BODIES, changes) for name, changes in rigid_changes(scene).items()]
    some = {(5, 64), (10, 64), (20, 64), (10, 128), (40, 128)}
    rungs += [
        Rung(f"H{h} N{n}", _BALANCE, HarmonicBalance(harmonics=h), n, slices)
        for h, n in sorted(some - {(harmonics, steps)}, key=lambda pair: (pair[1], pair[0]))
    ]
    march, shot = Marching(stepper=Newmark(), cycles=200), Shooting(warm_up=10)
    return [
        *rungs,
        Rung("NM 64x200", "march, Newmark", march, 64, slices, thinned=4),
        Rung("exp N64", "shooting, exponential", shot, 64, slices, thinned=4),
    ]


def few_rungs(scene: Scene) -> list[Rung]:
    """The scene itself, and the few rungs that are likely to be cheaper and to suffice."""
    wanted = ("10 modes", "50 modes", "5 slices", "H10 N64", "rigid", "rigid pinion")
    rungs = model_rungs(scene, scene.get("model.coordinates", _MODES))
    return [rungs[0], *(rung for rung in rungs[1:] if rung.name in wanted)]


def rigid_changes(scene: Scene) -> dict[str, dict[str, Any]]:
    """What makes bodies of a scene rigid, with the mass that they have as condensed ones.

    **Arguments:**

    - `scene`: with its bodies.

    **Returns:**

    Changes of keys, by the name of the rung: all rigid, with the foundation that the scene has for
    rigid bodies and without; and, if both gears are condensed, the pinion alone.
    """
    each = {gear: _rigid_numbers(scene, gear) for gear in scene.condensed}
    whole = {key: value for numbers in each.values() for key, value in numbers.items()}
    bare = {f"{gear}.foundation": "none" for gear in each}
    found = {"rigid": whole, "rigid, no foundation": whole | bare}
    if len(each) == len(GEARS):
        found["rigid pinion"] = each["pinion"]
    return found


def _rigid_numbers(scene: Scene, gear: str) -> dict[str, Any]:
    """The keys of a rigid body with the mass of a condensed one, of which its shaft is a part."""
    body = scene.bodies[gear].built.body
    rigid = body.rigid_motions
    inertia = rigid.T @ (body.mass @ rigid)
    mass, polar = inertia[0, 0], inertia[5, 5]
    transverse = 0.5 * (inertia[3, 3] + inertia[4, 4])
    kind = {f"{gear}.body.kind": "rigid"}
    model = model_of(scene.replace(kind))
    mount = (model.pinion_support, model.wheel_support)[GEARS.index(gear)]
    if isinstance(mount, Shaft):
        own = _shaft_inertia(mount)
        mass, polar, transverse = mass - own[0], polar - own[1], transverse - own[2]
    return kind | {
        f"{gear}.body.mass_kg": float(mass),
        f"{gear}.body.inertia_kg_m2": float(polar),
        f"{gear}.body.transverse_inertia_kg_m2": float(transverse),
    }


def _shaft_inertia(shaft: Shaft) -> np.ndarray:
    """Mass, polar and transverse inertia of a shaft about its gear's middle [kg, kg m2]."""
    total, left = np.zeros(3), 0.0
    for segment in shaft.segments:
        length, outer, inner = (float(x) for x in (segment.length, segment.outer, segment.inner))
        mass = float(shaft.material.density) * math.pi / 4.0 * (outer**2 - inner**2) * length
        square = (outer**2 + inner**2) / 4.0
        away = left + 0.5 * length - float(shaft.gear_at)
        across = 0.25 * square + length**2 / 12.0 + away**2
        total += mass * np.array([1.0, 0.5 * square, across])
        left += length
    return total


def combined(
    rungs: Sequence[Rung],
    rows: Sequence[Summary],
    allowed: float,
    responses: Sequence[str] | None = None,
) -> Rung | None:
    """All together that alone is good enough and cheaper than the scene itself.

    **Arguments:**

    - `rungs`: that of the scene first.
    - `rows`: their lines of the summary.
    - `allowed`: error of each alone [-].
    - `responses`: that count; all by default.

    **Returns:**

    The rung, or `None` if less than two families have such a one.
    """
    own, chosen = rungs[0], []
    left_over: set[str] = set()
    for family in (_BODIES, _KEPT, _TOLD_APART, _ACROSS, _BALANCE):
        if family in left_over:
            continue
        pairs = [
            (rung, row) for rung, row in zip(rungs, rows, strict=True) if rung.family == family
        ]
        best = cheapest([row for _, row in pairs], allowed, responses)
        if best is None or best["time_s"] >= rows[0]["time_s"]:
            continue
        chosen.append(next(rung for rung, row in pairs if row is best))
        if family == _BODIES and best["modes"] == 0:
            # Rigid bodies have neither modes nor anything of them to tell apart.
            left_over = {_KEPT, _TOLD_APART}
    if len(chosen) < 2:
        return None
    changes = {key: value for rung in chosen for key, value in rung.changes.items()}
    last = chosen[-1] if chosen[-1].family == _BALANCE else own
    return dataclasses.replace(
        own,
        name=", ".join(rung.name for rung in chosen),
        family="together",
        method=last.method,
        phases=last.phases,
        slices=min(rung.slices for rung in chosen),
        changes=MappingProxyType(changes),
    )


def fewer_modes(body: FlexibleBody, count: int) -> FlexibleBody:
    """A body with its lowest modes only; what they leave gives way statically.

    **Arguments:**

    - `body`: that vibrates.
    - `count`: number of modes, one less where a pair would be parted; 0 are all.

    **Returns:**

    The body.
    """
    modes = body.modes
    assert modes is not None
    if count == 0 or count >= modes.square.size:
        return body
    count -= modes.waves[count] < 0
    size = modes.mass.shape[0] - modes.square.size + count
    cut = lambda matrix: None if matrix is None else matrix[:size, :size]
    return dataclasses.replace(
        body,
        modes=dataclasses.replace(
            modes,
            square=modes.square[:count],
            rows=modes.rows[..., :count],
            load=modes.load[:count],
            mass=cut(modes.mass),
            turning=cut(modes.turning),
            coriolis=cut(modes.coriolis),
            softening=cut(modes.softening),
            waves=modes.waves[:count],
            diameters=modes.diameters[:count],
        ),
    )


class _Models:
    """Scene and model of a rung: bodies are built for each number of slices, and cut to modes."""

    def __init__(self, scene: Scene, most: int, tell: Callable[[str], None]):
        self.scene, self.own = scene, int(scene["mesh.slices"])
        richest = scene.replace({"model.coordinates": most})
        self.bodies = {self.own: with_bodies(richest, tell, moving=True).bodies}

    def __call__(self, slices: int, changes: Mapping[str, Any]) -> tuple[Scene, PairModel]:
        if slices not in self.bodies:
            other = self.scene.replace({"mesh.slices": slices})
            self.bodies[slices] = with_bodies(other, moving=True).bodies
        scene = self.scene.replace({"mesh.slices": slices, **changes})
        count = scene.get("model.coordinates", _MODES)
        bodies = {gear: _cut(self.bodies[slices][gear], count) for gear in scene.condensed}
        scene = dataclasses.replace(scene, bodies=MappingProxyType(bodies))
        return scene, model_of(scene)


def _cut(body: MeshBody, count: int) -> MeshBody:
    return dataclasses.replace(body, flexible=fewer_modes(body.flexible, count))


def _coordinates(scene: Scene) -> int:
    return scene.get("model.mesh_coordinates", _COORDINATES)


def _settled(answers: Any) -> tuple[Any, np.ndarray]:
    return answers, np.asarray(answers.settled)


def _reference_summary(
    scene: Scene, dynamics: Any, steps: int, speeds: Any, reference: Reference
) -> Summary:
    """What the rungs were compared with."""
    modes = sum(len(place.waves) for place in dynamics.bodies)
    told = dynamics.system.vectors.shape[1]
    answers = reference.answers
    return {
        "name": f"harmonic balance, H{scene['sweep.harmonics']} N{steps}, {modes} modes, "
        f"{told} mesh coordinates",
        "slices": scene["mesh.slices"],
        "motion_left_out_by_mesh_coordinates": float(dynamics.left_out),
        "speeds_rad_s": np.asarray(speeds),
        "good": reference.good,
        "dynamic_ratio": answers.dynamic_ratio,
        "te_rms_um": answers.te_rms / um,
        "te_mean_um": answers.te_mean / um,
        "time_s": reference.time_s,
    }
