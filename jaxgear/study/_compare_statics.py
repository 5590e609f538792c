"""Error against time of the quasi-static cycle: bodies, slices, phases, contact, stiffness.

From the scene one thing is changed at a time, and at last what was cheaper and good enough is put
together. The reference is the scene's own model on more slices and phases, with exact contact.
"""

import dataclasses
import gc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._checks import InputError
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._flank._deviations import Flanks
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._loads import mesh_stiffness
from jaxgear._response._transmission import (
    cycle_mean,
    harmonic_amplitudes,
    transmission_error,
)
from jaxgear._solve._cycle import mesh_cycle
from jaxgear._system._model import PairModel
from jaxgear._types import Reals, Scalar
from jaxgear._units import um
from jaxgear.plot._plots import compare_pictures
from jaxgear.scene._build import flanks_of, grid_of, law_of, model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS, STATIC_RESPONSES
from jaxgear.scene._with_bodies import with_bodies
from jaxgear.study._design import twin
from jaxgear.study._ladder import (
    MARGIN,
    QUANTITIES,
    Choice,
    Summary,
    cheapest_of_families,
    choose,
    columns_of,
    for_each,
    words_of,
    worst,
)
from jaxgear.study._running import stopwatch, timed
from jaxgear.study._statics import SolverFailure, headline

# Of the summary's static part, under their names here; and what is only looked at elsewhere.
_KEYS = {
    "te_mean": "te_mean_um",
    "te_rms": "te_rms_um",
    "te_peak_to_peak": "te_peak_to_peak_um",
    "max_line_load": "max_line_load_N_mm",
    "max_pressure": "max_pressure_MPa",
    "mesh_stiffness_mean": "mesh_stiffness_mean_N_um",
    "face_load_factor": "face_load_factor",
    "transverse_load_factor": "transverse_load_factor",
    "te_harmonic_1": "te_harmonic_1_um",
}
EXTRAS = ("face_load_factor", "transverse_load_factor", "te_harmonic_1")
# A fluctuation is compared with this share of what the mesh gives way by, where it is less: nobody
# needs two per cent of nothing [-].
FLOOR = 0.01
_FLUCTUATIONS = ("te_rms", "te_peak_to_peak", "te_harmonic_1")
# Torques, over the scene's own, by which a rung is chosen, and at which it is then tried.
_CHOSEN, _HELD_OUT = (1.0, 0.5), (0.7, 1.3)
# About what a tooth pair resists [N/(mm um)], for a relief of the size that a search looks at.
_TOOTH_PAIR = 14.0
# Seconds of runs that suffice to time a program.
_ENOUGH = 1.0
# Of rungs, and of the reference.
_SLICES, _PHASES = (1, 5, 10, 20, 40), (16, 32, 64, 128)
_FINEST = (40, 128)
_IN_HARMONIC = 8

Work = Literal["run", "map", "optimise"]


@dataclass(frozen=True)
class StaticRung:
    """A model of the quasi-static cycle: what it changes of the scene.

    `changes` are new values of keys, or `None` for a table that is taken out; a rung `beyond` the
    scene is another physical model than the one asked for.
    """

    name: str
    family: str
    changes: Mapping[str, Any]
    beyond: bool = False


@dataclass(frozen=True)
class Point:
    """An operating point: torque over the scene's own, flanks, and whether it serves to choose."""

    words: str
    torque: float
    flank: Mapping[str, float]
    chosen: bool


class _Loaded(eqx.Module):
    """Torque and flanks of an operating point, or of several with the point leading.

    **Fields:**

    - `torque`: on the pinion [N m].
    - `flanks`: deviations.
    """

    torque: Reals
    flanks: Flanks


def changed(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """A scene with other values, and without some tables.

    **Arguments:**

    - `scene`: checked against the schema.
    - `changes`: value by key; of a table, `None`: it is taken out.

    **Returns:**

    The scene; unchecked.
    """
    gone = tuple(key for key, value in changes.items() if value is None)
    left = lambda key: not any(key == table or key.startswith(f"{table}.") for table in gone)
    kept = lambda mapping: MappingProxyType({k: v for k, v in mapping.items() if left(k)})
    scene = dataclasses.replace(
        scene,
        values=kept(scene.values),
        given=frozenset(filter(left, scene.given)),
        lines=kept(scene.lines),
        known=kept(scene.known),
    )
    return scene.replace({key: value for key, value in changes.items() if value is not None})


def static_rungs(scene: Scene, *, few: bool = False) -> list[StaticRung]:
    """All models of the quasi-static cycle that are compared.

    **Arguments:**

    - `scene`: checked against the schema.
    - `few`: whether only what can save time is wanted, and not more than is likely to.

    **Returns:**

    The scene itself first, then family by family.
    """
    own, phases = scene["mesh.slices"], scene["mesh.phases"]
    rungs = [StaticRung("as given", "as given", {})]
    rungs += [
        StaticRung(name, "bodies", changes) for name, changes in simpler_bodies(scene).items()
    ]
    counts = _SLICES
    if few:
        counts = () if needs_its_slices(scene) else (5,)
    # Of the highest harmonic that a search looks at, so many positions in its period at least.
    least = _IN_HARMONIC * max(scene.get("optimise.harmonics", (1.0,)))
    rungs += [
        StaticRung(f"{n} slice{'s' if n > 1 else ''}", "slices", {"mesh.slices": n})
        for n in counts
        if n != own and (n < own or not (few or scene.condensed))
    ]
    rungs += [
        StaticRung(f"{n} phases", "phases", {"mesh.phases": n})
        for n in ((16, 32) if few else _PHASES)
        if n != phases and (n < phases or not (few or scene.condensed))
        if n >= least or not few
    ]
    if scene["mesh.stiffness"] == "weber-banaschek":
        rungs += _on_stiffness(scene, few)
    if not few:
        other = "smooth" if scene["mesh.contact"] == "exact" else "exact"
        rungs.append(StaticRung(f"{other} contact", "contact", {"mesh.contact": other}))
    return [rung for rung in rungs if not takes_away(scene, rung.changes)]


def simpler_bodies(scene: Scene) -> dict[str, dict[str, Any]]:
    """What makes the bodies of a scene simpler, rung by rung of the ladder.

    **Arguments:**

    - `scene`: checked against the schema.

    **Returns:**

    Changes of keys, by the name of the rung: condensed bodies and beams made rigid, each alone and
    together, with and without a foundation; the pair without shafts and bearings, that only turns.
    """
    found: dict[str, dict[str, Any]] = {}
    elastic = [gear for gear in GEARS if scene[f"{gear}.body.kind"] != "rigid"]
    rigid = lambda gears: {f"{gear}.body.kind": "rigid" for gear in gears}
    if len(elastic) == len(GEARS):
        found["rigid pinion"] = rigid(["pinion"])
    if elastic:
        found["rigid bodies"] = rigid(elastic)
    if scene.condensed:
        bare = {f"{gear}.foundation": "none" for gear in scene.condensed}
        found["rigid bodies, no foundation"] = rigid(elastic) | bare
    mounts = [
        f"{gear}.{mount}"
        for gear in GEARS
        for mount in ("shaft", "support")
        if any(key.startswith(f"{gear}.{mount}.") for key in scene.values)
    ]
    loaded = any(scene.rows(f"{gear}.shaft.loads") for gear in GEARS)
    if mounts and not loaded and scene.get("housing.stiffness_csv") is None:
        found["torsional pair"] = rigid(elastic) | dict.fromkeys(mounts)
    return found


def _on_stiffness(scene: Scene, few: bool) -> list[StaticRung]:
    """Foundations and line loads: less than the scene has, and what lies beyond it."""
    key, updates = "mesh.line_load_updates", scene["mesh.line_load_updates"]
    found = []
    chosen = {
        gear: scene.get(f"{gear}.foundation", scene["mesh.foundation"])
        for gear in GEARS
        if gear not in scene.condensed
    }
    less = {f"{gear}.foundation": "weber" for gear, name in chosen.items() if name == "ring"}
    if less:
        found.append(StaticRung("Weber foundation", "foundation", less))
    if updates:
        found.append(StaticRung("nominal line load", "line loads", {key: 0}))
    if few:
        return found
    none = {f"{gear}.foundation": "none" for gear, name in chosen.items() if name != "none"}
    if none:
        found.append(StaticRung("no foundation", "foundation", none))
    if not updates:
        found.append(StaticRung("2 line load updates", "beyond the scene", {key: 2}, beyond=True))
    return found


def _named(scene: Scene) -> list[str]:
    """Keys that a search varies, ties, lets scatter or looks at."""
    if not scene.has_table("optimise"):
        return []
    small = scene.get("optimise.minimise"), scene.get("optimise.pareto.against")
    forces = "bearing_force" in small or scene.get("optimise.minimise.bearing_force") is not None
    bearings = [f"{gear}.shaft.bearings" for gear in GEARS] if forces else []
    tables = ("optimise.ties.", "robust.scatter.", "robust.even.")
    others = [key.removeprefix(table) for table in tables for key in scene.values
              if key.startswith(table)]  # fmt: skip
    return [*scene["optimise.vary"], *others, *bearings]


def takes_away(scene: Scene, changes: Mapping[str, Any], more: Sequence[str] = ()) -> bool:
    """Whether changes of a scene take away what its search names.

    **Arguments:**

    - `scene`: checked against the schema.
    - `changes`: as for `changed`.
    - `more`: keys that have to stay too.
    """
    tables = [key for key, value in changes.items() if value is None]
    tables += [key.removesuffix(".kind") for key in changes if key.endswith(".body.kind")]
    named = [*_named(scene), *more]
    return any(key.startswith(f"{table}.") for key in named for table in tables)


def needs_its_slices(scene: Scene) -> bool:
    """Whether a search limits the load of the last slices, which other slices have not."""
    limited = scene.get("optimise.limits.edge_line_load_N_mm") is not None
    return limited and scene.has_table("optimise")


def points_of(scene: Scene, work: Work = "run") -> list[Point]:
    """Operating points at which rungs are compared.

    **Arguments:**

    - `scene`: gives torque and flanks.
    - `work`: a map and a search visit other flanks: relieved ones stand for them.

    **Returns:**

    Those by which a rung is chosen, and others at which it is tried.
    """
    found = [
        Point(f"{share:g} x the torque", share, {}, share in _CHOSEN)
        for share in (*_CHOSEN, *_HELD_OUT)
    ]
    keys = _visited(scene, work)
    if keys:
        for torque, depth, chosen in ((1.0, 1.0, True), (0.7, 0.5, False)):
            words = f"{torque:g} x the torque, flanks cut back by {depth:g} deflections"
            found.append(Point(words, torque, _cut_back(scene, keys, depth), chosen))
    return found


def _visited(scene: Scene, work: Work) -> list[str]:
    """Keys of the flanks that a map or a search changes."""
    relief = [f"flank.{gear}.tip_relief.depth_um" for gear in GEARS]
    if work == "map":
        return relief
    if work != "optimise" or not scene.has_table("optimise"):
        return []
    keys = [key for key in scene["optimise.vary"] if key.startswith("flank.")]
    keys = [key for key in keys if key.endswith("_um") and isinstance(scene.get(key), float)]
    both = scene["optimise.symmetric"]
    return list(dict.fromkeys([*keys, *(twin(key) for key in keys if both)]))


def _cut_back(scene: Scene, keys: Sequence[str], share: float) -> dict[str, float]:
    """Depths that are larger by a share of what a tooth pair gives way by; extents of 0.3."""
    model = model_of(changed(scene, {f"{gear}.body.kind": "rigid" for gear in scene.condensed}))
    force = float(model.torque) / float(model.pair.base_radius[0])
    depth = share * 1e-3 * force / float(model.pair.face_width) / _TOOTH_PAIR
    found = {key: float(scene[key]) + depth for key in keys}
    reliefs = [key.removesuffix("depth_um") + "extent" for key in keys if key.endswith("depth_um")]
    return found | dict.fromkeys(reliefs, 0.3)


def _answers(
    model: PairModel, grid: MeshGrid, law: AbstractContactLaw, points: _Loaded
) -> dict[str, Reals]:
    """What is compared at each point; one after the other, so that times add up."""

    def one(point: _Loaded) -> dict[str, Scalar]:
        loaded = eqx.tree_at(lambda m: (m.torque, m.flanks), model, (point.torque, point.flanks))
        cycle = mesh_cycle(loaded, grid, law=law, throw=False)
        error = transmission_error(loaded.pair, cycle)
        stiffness = cycle_mean(cycle, mesh_stiffness(cycle))
        return headline(loaded, cycle, law) | {
            "mesh_stiffness_mean_N_um": stiffness * um,
            "te_harmonic_1_um": harmonic_amplitudes(cycle, error, 1)[0] / um,
            "give_um": cycle.load[0, 0] / stiffness / um,
            "solved": jnp.all(cycle.converged),
        }

    return jax.lax.map(one, points)


@dataclass(frozen=True)
class _Found:
    """Answers at each point, with the seconds that a cycle takes."""

    values: Mapping[str, np.ndarray]
    time_s: float
    compile_s: float
    dofs: int


class _Solver:
    """Answers of rungs: bodies are put in mesh, and programs compiled, once."""

    def __init__(
        self,
        scene: Scene,
        points: Sequence[Point],
        tell: Callable[[str], None],
        *,
        quick: bool,
    ):
        self.points, self.tell = points, tell
        # Bodies that vibrate are no use in statics, and are one for each number of slices.
        self.plain = dataclasses.replace(scene, bodies=MappingProxyType({}))
        self.scenes: dict[int, Scene] = {}
        # What is compiled in half the time runs twice as long: good enough to choose by.
        self.options = (("xla_backend_optimization_level", 0),) if quick else ()

    def __call__(self, changes: Mapping[str, Any]) -> _Found:
        scene = self._with_bodies(changes)
        model = model_of(scene)
        points = self._loaded(scene, model)
        arguments = model, grid_of(scene, model), law_of(scene), points
        seconds = []
        # A watch of its own, so that programs of many shapes are not kept.
        with stopwatch() as watch:
            # The shortest of many: other work on the machine makes most runs longer, hardly all.
            for _ in range(400):
                before = watch.run_s
                found = timed(_answers, *arguments, options=self.options)
                seconds.append(watch.run_s - before)
                if sum(seconds) > _ENOUGH:
                    break
        values = {key: np.asarray(value) for key, value in found.items()}
        gc.collect()
        dofs = _dofs(model)
        return _Found(values, min(seconds) / len(self.points), watch.compile_s, dofs)

    def _with_bodies(self, changes: Mapping[str, Any]) -> Scene:
        """A rung's scene, with its condensed bodies."""
        wanted = changed(self.plain, changes)
        if not wanted.condensed:
            return wanted
        slices = wanted["mesh.slices"]
        if slices not in self.scenes:
            sliced = self.plain.replace({"mesh.slices": slices})
            self.scenes[slices] = with_bodies(sliced, self.tell)
        rest = {key: value for key, value in changes.items() if key != "mesh.slices"}
        return changed(self.scenes[slices], rest)

    def _loaded(self, scene: Scene, model: PairModel) -> _Loaded:
        each = [
            _Loaded(
                # Couples on the pinion's shaft stay: the mesh has the share.
                model.torque + (point.torque - 1.0) * model.mesh_torque,
                flanks_of(scene.replace(point.flank), model.pair) if point.flank else model.flanks,
            )
            for point in self.points
        ]
        return jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(x) for x in leaves]), *each)


def _dofs(model: PairModel) -> int:
    """Coordinates of the structure that are free, the drive counted once."""
    found = eqx.filter_eval_shape(PairModel.system, model)
    return len(found.structure.map.free) - 1


def scales_of(reference: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What errors are relative to, at each point, in the unit of the response.

    The reference's own value; of fluctuations at least a hundredth of what its mesh gives way by.
    """
    floor = FLOOR * np.abs(reference["give_um"])
    return {
        name: np.maximum(np.abs(reference[key]), floor if name in _FLUCTUATIONS else 0.0)
        for name, key in _KEYS.items()
    }


def static_row(
    rung: StaticRung, found: Any, reference: Mapping[str, np.ndarray], points: Sequence[Point]
) -> Summary:
    """One rung's line of the summary.

    **Arguments:**

    - `rung`: what is changed.
    - `found`: its `values`, `time_s`, `compile_s` and `dofs`.
    - `reference`: values of the reference.
    - `points`: where they were found.

    **Returns:**

    The line; `error` is the largest at the points that serve to choose, `held_out` at the others.
    """
    scales, chosen = scales_of(reference), np.asarray([point.chosen for point in points])
    errors = {
        name: np.abs(found.values[key] - reference[key]) / scales[name]
        for name, key in _KEYS.items()
    }
    solved = found.values["solved"]

    def largest(name: str, at: np.ndarray) -> float | None:
        value = float(np.max(errors[name][at]))
        return value if solved[at].all() and np.isfinite(value) else None

    return {
        "name": rung.name,
        "family": rung.family,
        "beyond": rung.beyond,
        "dofs": found.dofs,
        "time_s": found.time_s,
        "compile_s": found.compile_s,
        "error": {name: largest(name, chosen) for name in STATIC_RESPONSES},
        "held_out": {name: largest(name, ~chosen) for name in _KEYS},
        "changes": {key: "left out" if x is None else x for key, x in rung.changes.items()},
    }


def static_responses(scene: Scene) -> tuple[str, ...]:
    """The responses of the quasi-static cycle that count; all, where the scene names none.

    The mesh stiffness of condensed bodies is that of teeth alone: it compares with no other.
    """
    apart = {"mesh_stiffness_mean"} if scene.condensed else set()
    every = tuple(name for name in STATIC_RESPONSES if name not in apart)
    named = scene.get("compare.responses") or every
    return tuple(name for name in every if name in named) or every


def require_at_rest(scene: Scene) -> None:
    """Refuse responses none of which the quasi-static cycle of a scene has.

    **Arguments:**

    - `scene`: without a sweep.

    **Raises:**

    - `InputError` naming them.
    """
    named = scene.get("compare.responses")
    if named and not set(named) & set(static_responses(scene)):
        raise InputError(
            f"compare.responses names {', '.join(named)}: in motion only, or of teeth alone where "
            "bodies are condensed. Add a table [sweep], or name some of "
            f"{', '.join(static_responses(scene))}."
        )


@dataclass(frozen=True)
class StaticChart:
    """Rungs of the quasi-static cycle, their lines, and what was chosen."""

    rungs: Mapping[str, StaticRung]
    choice: Choice
    summary: Summary

    @property
    def rows(self) -> list[Summary]:
        """Lines of the rungs, that of the scene first."""
        return self.summary["rungs"]


def finest_of(scene: Scene) -> dict[str, Any]:
    """Changes that make the reference: at least twice the slices and phases, exact contact."""
    slices, phases = 2 * scene["mesh.slices"], 2 * scene["mesh.phases"]
    if not scene.condensed:
        slices, phases = max(slices, 2 * _FINEST[0]), max(phases, 2 * _FINEST[1])
    return {"mesh.slices": slices, "mesh.phases": phases, "mesh.contact": "exact"}


def compared_statics(
    scene: Scene,
    *,
    work: Work = "run",
    rungs: Sequence[StaticRung] | None = None,
    quick: bool = False,
    tell: Callable[[str], None] = lambda step: None,
) -> StaticChart:
    """The quasi-static cycle by many models of one scene: error against time.

    **Arguments:**

    - `scene`: with its bodies, or they are built.
    - `work`: what the cycles are for.
    - `rungs`: that of the scene itself first; all by default.
    - `quick`: whether to compile for a short wait, not for short runs: times are about twice those
        of a run then.
    - `tell`: told what begins.

    **Returns:**

    Lines of the rungs and the recommendation.

    **Raises:**

    - `SolverFailure` if the reference was not solved.
    """
    points, tolerance = points_of(scene, work), float(scene["compare.tolerance"])
    responses = static_responses(scene)
    # Who asks for some responses only does not ask for others.
    extras = () if scene.get("compare.responses") else EXTRAS
    solver = _Solver(scene, points, tell, quick=quick)
    tell("reference")
    finest = finest_of(scene)
    best = solver(finest)
    if not best.values["solved"].all():
        raise SolverFailure("the reference, on more slices and phases, was not solved")
    tried = {rung.name: rung for rung in (static_rungs(scene) if rungs is None else rungs)}
    rows: list[Summary] = []

    def add(rung: StaticRung) -> None:
        tell(rung.name)
        rows.append(static_row(rung, solver(rung.changes), best.values, points))
        tried[rung.name] = rung

    for rung in list(tried.values()):
        add(rung)
    for share in (MARGIN, 0.5 * MARGIN):
        whole = combined_statics(tried, rows, share * tolerance, responses)
        if whole is not None and whole.name not in tried:
            add(whole)
    held_out = lambda row: row["held_out"]
    choice = choose(rows, tolerance, responses, held_out, extras)
    found = None if choice.row is None else choice.row["name"]
    scales = scales_of(best.values)
    return StaticChart(
        tried,
        choice,
        {
            "rungs": rows,
            "recommended": found,
            "recommended_for": for_each(rows, tolerance, responses, held_out),
            "words": words_of(choice, rows[0], tolerance, responses, judged="largest errors")
            + _beyond(rows, responses, tolerance),
            "tolerance": tolerance,
            "responses": list(responses),
            "reference": {
                "name": f"as given, {finest['mesh.slices']} slices, {finest['mesh.phases']} phases,"
                " exact contact",
                "time_s": best.time_s,
                "points": [dataclasses.asdict(p) | {"flank": dict(p.flank)} for p in points],
                "values": {key: best.values[key] for key in _KEYS.values()},
                "relative_to": {_KEYS[name]: scale for name, scale in scales.items()},
                "relative_to_words": "the reference's own value; of fluctuations (RMS, peak to "
                f"peak, harmonic) at least {100 * FLOOR:g} % of mesh force over mean mesh "
                "stiffness",
            },
        },
    )


def combined_statics(
    rungs: Mapping[str, StaticRung],
    rows: Sequence[Summary],
    allowed: float,
    responses: Sequence[str],
) -> StaticRung | None:
    """All together that alone is good enough and cheaper than the scene itself.

    **Arguments:**

    - `rungs`: by name.
    - `rows`: their lines, that of the scene first.
    - `allowed`: error of each alone [-].
    - `responses`: that count.

    **Returns:**

    The rung, or `None` if less than two families have such a one.
    """
    alone = [row for row in rows if row["family"] != "together"]
    parts = [rungs[row["name"]] for row in cheapest_of_families(alone, allowed, responses)]
    if len(parts) < 2:
        return None
    changes = {key: value for rung in parts for key, value in rung.changes.items()}
    return StaticRung(", ".join(rung.name for rung in parts), "together", changes)


def _beyond(rows: Sequence[Summary], responses: Sequence[str], tolerance: float) -> str:
    """What another physical model would change by more than the tolerance."""
    found = ""
    for row in rows:
        far = {name: worst(row["error"], (name,)) for name in responses}
        far = {name: x for name, x in far.items() if tolerance < x < np.inf}
        if row["beyond"] and far:
            said = ", ".join(f"the {QUANTITIES[x]} by {100 * far[x]:.2g} %" for x in far)
            found += f' Beyond the scene: "{row["name"]}" changes {said}.'
    return found


def draw_statics(chart: StaticChart, title: str, folder: Folder, name: str = "compare") -> None:
    """An overview of all rungs and responses, and a chart of error over time for each.

    **Arguments:**

    - `chart`: what was found.
    - `title`: the case.
    - `folder`: for the files; exists.
    - `name`: what the files' names begin with.
    """
    found, rows = chart.summary, chart.rows
    figure = partial(
        compare_pictures.overview,
        rows,
        found["responses"],
        f"{title}, quasi-static cycle",
        tolerance=found["tolerance"],
        recommended=found["recommended"],
        words="largest error at the torques by which rungs are chosen",
    )
    columns = columns_of(rows)
    save(figure, columns, folder, name)
    for response in found["responses"]:
        figure = partial(
            compare_pictures.error_over_time,
            [row | {"error": worst(row["error"], (response,))} for row in rows],
            f"{title}, quasi-static cycle",
            tolerance=found["tolerance"],
            recommended=found["recommended_for"][response],
            quantity=f"largest error of the {QUANTITIES[response]}, relative",
        )
        save(figure, columns, folder, f"{name}_{response}")
