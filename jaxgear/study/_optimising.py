"""The command `optimise`: a search by gradient, judged exactly, and what became better."""

import importlib.metadata
import time
from functools import partial

import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._checks import InputError
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._cli._writing import finish
from jaxgear._geometry._lines import MeshGrid, mesh_grid
from jaxgear._interface._laws import ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._whole_file import write_text
from jaxgear.plot import _robust_tables as robust_tables
from jaxgear.plot import _tables as tables
from jaxgear.plot._modification_tables import draw_modification
from jaxgear.plot._plots import pictures, robust_pictures
from jaxgear.scene._build import smooth_law_of
from jaxgear.scene._rewriting import rewritten
from jaxgear.scene._scene import Scene
from jaxgear.scene._scene_files import files_seen_from
from jaxgear.study._design import (
    DesignSpace,
    design_space,
    is_dynamic,
    judged_speeds,
    left_out,
    objective_of,
    prepared_mesh,
    refuse_unbounded,
    require_search,
    require_swept,
    task_of,
)
from jaxgear.study._evaluations import objective_at, responses_at
from jaxgear.study._head import head
from jaxgear.study._notes import left_out_notes
from jaxgear.study._pareto import draw_front, front_of, front_remarks, is_asked_for
from jaxgear.study._progress import built_scene, narration, progress
from jaxgear.study._ranks import Doubtful
from jaxgear.study._result import Summary, title_of
from jaxgear.study._results import static_dataset
from jaxgear.study._robust import (
    hardened,
    reach_of,
    response_of,
    robust_notes,
    robust_summary,
    shown,
)
from jaxgear.study._running import timed
from jaxgear.study._scatter import Scatter, scatter_of
from jaxgear.study._search import (
    Search,
    best_of,
    best_of_starts,
    limits_notes,
    limits_summary,
    record_file,
    require_acting,
    search_of,
    smoothing_bias_of,
    smoothing_notes,
)
from jaxgear.study._statics import (
    SolverFailure,
    Statics,
    solve_statics,
    torques_of,
)


def optimise_flanks(scene: Scene, folder: Folder) -> Summary:
    """Gradient optimisation of [optimise].vary; writes NAME.optimised.toml.

    Arguments, results and errors as for `_commands.run`.
    """
    refuse_unbounded(scene, tuple(scene["optimise.vary"]))
    require_swept(scene)
    require_search(scene)
    scene = built_scene(scene)
    statics = solve_statics(scene)
    summary = head(scene, statics)
    found = optimisation(scene, statics, folder)
    summary["notes"] += found.pop("notes")
    return finish(scene, folder, summary | found)


# A better point by this much of the objective found elsewhere is worth a second search.
_CLEARLY_BETTER = 0.02


def descent(search: Search, space: DesignSpace, start: np.ndarray | None = None):
    """One search from a start, or from as many as the scene asks for, with a progress bar."""
    most = space.scene["optimise.max_evaluations"]
    most *= space.scene["optimise.starts"] if start is None else 1
    most *= 1 + len(space.scene.get("optimise.anneal_um", ()))
    with progress(most, f"searching by {search.name}") as done:
        watch = lambda point, value: done(1)
        if start is None:
            return best_of_starts(search, space, watch)
        return search.descend(start, watch)


def unless_beaten(
    found: optimise.SearchResult,
    rival: np.ndarray,
    value: float,
    search: Search,
    space: DesignSpace,
) -> tuple[optimise.SearchResult, bool]:
    """Search once more from a rival's point if its value is clearly better; says whether it was."""
    own = found.value
    if search.limits:
        # What is beyond a limit counts, as it does in the rival's value.
        own = float(search.objective(found.point[None])[0])
    if value >= (1.0 - _CLEARLY_BETTER) * own:
        return found, False
    return best_of(search, descent(search, space, rival), found), True


def optimisation(
    scene: Scene,
    before: Statics,
    folder: Folder,
    torques: np.ndarray | None = None,
) -> Summary:
    """Search with smooth contact, judge with exact contact, and show what became better."""
    space = design_space(
        scene,
        tuple(scene["optimise.vary"]),
        symmetric=scene["optimise.symmetric"],
        deflection=float(before.numbers["single_pair_deflection_um"]),
    )
    space.require_tied_start()
    improved = f"{scene['name']}.optimised.toml"
    # Before the search, so that a file that cannot be rewritten does not cost its result.
    _rewritten(scene, folder, _numbers(space, space.start))
    scatter = None
    if scene.has_table("robust"):
        teeth = np.asarray(before.cycle.cells.lines.tooth)
        scatter = scatter_of(space, before.model.pair, teeth)
    grid = before.grid
    moving = not space.flanks_only or (scatter is not None and not scatter.same_lines)
    if moving and not scene.bodies:
        # The contact ratio may grow with what changes; condensed bodies hold for one grid.
        grid = mesh_grid(
            before.model.pair,
            phases=grid.phases,
            slices=grid.slices,
            periods=grid.periods,
            beyond=grid.beyond,
            margin=1.0,
        )
    prepared = prepared_mesh(space, grid, before)
    file = record_file(space, folder, importlib.metadata.version("jaxgear"))
    search = search_of(space, grid, prepared, file)
    law = ExactContact()
    task = task_of(space, grid, law, prepared)
    exact = lambda point: float(timed(objective_at, task, np.asarray(point), law, options=QUICKLY))
    judged = judged_speeds(space, grid, ExactContact())
    judged_before = judged(space.start)
    _require_half(judged_before)
    require_acting(search, space)
    start = time.perf_counter()
    try:
        found = descent(search, space)
    except FloatingPointError as error:
        if not is_dynamic(scene):
            raise
        raise SolverFailure(f"{error} {_TOO_FEW}") from error
    seconds = time.perf_counter() - start
    few = _FEW_MEMBERS if is_dynamic(scene) else {}
    with narration("searching by differential evolution"):
        baseline = optimise.differential_evolution(search.objective, space.box, **few)
    rival = baseline.point, baseline.value
    found, restarted = unless_beaten(found, *rival, search, space)
    keys = _numbers(space, found.point)
    try:
        after = solve_statics(scene.replace(keys), torques)
    except InputError as error:
        raise SolverFailure(
            f"the search ended at impossible gears, {keys}: {error} Narrow [optimise.bounds]."
        ) from error
    with narration("search"):
        _draw_search(scene, folder, before, after, search.name, found, baseline)
    objectives = {
        name: exact(point)
        for name, point in (
            ("before", space.start),
            ("after", found.point),
            ("baseline", baseline.point),
        )
    }
    if not np.isfinite(list(objectives.values())).all():
        more = f", or {_TOO_FEW}" if is_dynamic(scene) else ""
        raise SolverFailure(f"the contact was not solved where the search began or ended{more}")
    write_text(_rewritten(scene, folder, keys), folder / improved)
    kept = lambda point: np.asarray(
        timed(responses_at, task, np.asarray(point), law, options=QUICKLY)
    )
    judged_after = judged(np.asarray(found.point))
    swept = baseline.evaluations if is_dynamic(scene) else 0
    remarks = left_out_notes(judged_before, judged_after, limited=swept)
    if not found.converged:
        more = "" if search.limits else " Raise optimise.max_evaluations."
        remarks.append(Doubtful(f"The search did not converge: {found.reason}.{more}"))
    bias = found.value - objectives["after"]
    own = objectives["before"], objectives["after"]
    remarks += smoothing_notes(scene["mesh.smoothing_um"], bias, *own)
    smoothly = search.slopes.at(smooth_law_of(scene).width)
    searched = lambda point: np.asarray(smoothly(jnp.asarray(point))[0])
    limits = limits_summary(search, kept, searched, found.point)
    remarks += limits_notes(limits)
    pareto = {}
    if is_asked_for(space):
        with progress(scene["optimise.pareto.points"], "front") as done:
            front = front_of(space, grid, prepared, space.start, done)
        pareto = {"pareto": draw_front(space, front, title_of(scene), folder)}
        remarks += front_remarks(front)
    robust: Summary = {}
    if scatter is not None:
        told, robust["robust"] = _robust(
            scatter, found.point, after, grid, prepared, folder, torques
        )
        remarks += told
    # Only now: what is stopped before begins with all that the search has found.
    for each in file.parent.glob(f"{file.stem}*{file.suffix}"):
        each.unlink()
    return pareto | {
        "notes": remarks,
        "optimise": {
            "minimise": scene.get("optimise.minimise", "weighted table"),
            "torques_Nm": torques_of(scene, "optimise.torques_Nm"),
            "objective_unit": objective_of(scene)[1],
            "variables": keys,
            "before": _judged(before, objectives["before"]),
            "after": _judged(after, objectives["after"]),
            "smooth_objective": found.value,
            "smooth_less_exact": bias,
            "smoothing_bias_at_most": smoothing_bias_of(search, space, found.point),
            "smoothing_um": scene["mesh.smoothing_um"],
            "method": search.name,
            "starts": scene["optimise.starts"],
            "limits": limits,
            "evaluations": found.evaluations,
            "gradient_evaluations": found.gradient_evaluations,
            "converged": found.converged,
            "reason": found.reason,
            "restarted_from_baseline": restarted,
            "at_bounds": space.at_bounds(found.point),
            "seconds_with_compiling": seconds,
            "differential_evolution": {
                "objective": objectives["baseline"],
                "variables": dict(zip(space.keys, baseline.point, strict=True)),
                "evaluations": baseline.evaluations,
                "converged": baseline.converged,
            },
            "scene": str(folder.path / improved),
        }
        | left_out(judged_before, judged_after)
        | robust,
    }


def _robust(
    scatter: Scatter,
    nominal: np.ndarray,
    nominal_statics: Statics,
    grid: MeshGrid,
    prepared: PreparedMesh | None,
    folder: Folder,
    torques: np.ndarray | None,
) -> tuple[list[str], Summary]:
    """Go on from a nominal optimum to the robust one, and show both on fresh gears."""
    space, scene = scatter.space, scatter.space.scene
    file = record_file(space, folder, importlib.metadata.version("jaxgear"), "robust")
    with progress(scene["optimise.max_evaluations"], "robust search") as done:
        told = lambda point, value: done(1)
        law = smooth_law_of(scene)
        made = hardened(scatter, nominal, grid, law, prepared, told, file)
    summary = robust_summary(made)
    improved = f"{scene['name']}.robust.toml"
    write_text(_rewritten(scene, folder, summary["variables"]), folder / improved)
    statics = solve_statics(scene.replace(summary["variables"]), torques)
    response, unit = response_of(scene), response_of(scene)[1]
    values = {
        name: shown(scene, each.fresh)
        for name, each in (("nominal", made.nominal), ("robust", made.robust))
    }
    datasets = {
        name: static_dataset(each.model, each.cycle, each.law)
        for name, each in (("nominal", nominal_statics), ("robust", statics))
    }
    title = f"{title_of(scene)}, {scene['robust.fresh_samples']} gears"
    figure = partial(
        robust_pictures.robust, values, datasets, scene["robust.share"], response, title
    )
    columns = robust_tables.robust_columns(values, unit)
    errors = robust_tables.robust_errors_columns(datasets)
    save(figure, columns, folder, "robust", transmission_error=errors)
    names, reach, ends = reach_of(made)
    figure = partial(robust_pictures.tornado, names, reach, ends, response, title_of(scene))
    columns = robust_tables.tornado_columns(names, reach, ends, unit)
    save(figure, columns, folder, "tornado")
    file.unlink(missing_ok=True)
    return robust_notes(made), summary | {"scene": str(folder.path / improved)}


# With responses at many speeds an evaluation takes a second, not a millisecond.
_FEW_MEMBERS = {"population": 5, "most_generations": 10}


_TOO_FEW = (
    "fewer than half of the speeds of [sweep] have a response that has settled and is not close to "
    "a fold. Raise the damping, or sweep other speeds."
)


def _require_half(judged: list[tuple[float, optimise.Judged]]) -> None:
    """Refuse a search that begins where most speeds do not count."""
    for _, each in judged:
        if 2 * int(np.sum(each.kept)) < each.speed.size:
            raise SolverFailure(_TOO_FEW)


def _numbers(space: DesignSpace, point: np.ndarray) -> dict[str, float]:
    """The keys of the scene that a point of the space sets."""
    return {key: float(value) for key, value in space.updates(np.asarray(point)).items()}


def _rewritten(scene: Scene, folder: Folder, keys: dict[str, float]) -> str:
    """The user's scene, from its new folder, with what command line and search changed."""
    files = files_seen_from(scene, folder.path)
    try:
        return rewritten(scene.path, scene.overridden() | files | keys)
    except ValueError as error:
        raise InputError(str(error)) from error


def _draw_search(
    scene: Scene,
    folder: Folder,
    before: Statics,
    after: Statics,
    name: str,
    found: optimise.SearchResult,
    baseline: optimise.SearchResult,
) -> None:
    """What became better, and how fast."""
    old, new = (static_dataset(each.model, each.cycle, each.law) for each in (before, after))
    figure = partial(pictures.before_after, old, new, title_of(scene))
    save(figure, tables.before_after_columns(old, new), folder, "before_after")
    draw_modification({"start": before.model, "optimised": after.model}, title_of(scene), folder)
    traces = {name: found.values, "differential evolution": baseline.values}
    unit = objective_of(scene)[1]
    figure = partial(pictures.search_trace, traces, unit, title_of(scene))
    save(figure, tables.search_trace_columns(traces, unit), folder, "search")


def _judged(statics: Statics, objective: float) -> dict[str, float]:
    """Objective with exact contact over all torques, and what changed at the scene's torque."""
    names = ("te_mean_um", "te_rms_um", "te_peak_to_peak_um", "max_line_load_N_mm")
    names += "max_pressure_MPa", "face_load_factor"
    numbers = {name: float(statics.numbers[name]) for name in names}
    return {"objective": objective} | numbers
