"""The study `optimise`: a search by gradient, judged exactly, and what became better."""

from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr

from jaxgear._checks import InputError
from jaxgear._geometry._lines import MeshGrid, mesh_grid
from jaxgear._interface._laws import ExactContact
from jaxgear._kept_programs import QUICKLY
from jaxgear._solve._cycle import PreparedMesh
from jaxgear.scene._build import smooth_law_of
from jaxgear.scene._rewriting import rewritten
from jaxgear.scene._scene import Scene
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.study._built import BuiltScene, built_scene
from jaxgear.study._design import DesignSpace, design_space
from jaxgear.study._evaluations import objective_at, responses_at
from jaxgear.study._head import head, study
from jaxgear.study._objectives import (
    JudgedSpeeds,
    in_unit,
    is_dynamic,
    judged_speeds,
    objective_unit,
    prepared_mesh,
    task_of,
)
from jaxgear.study._pair_dataset import modification_dataset
from jaxgear.study._pareto import front_result
from jaxgear.study._ranks import Doubtful
from jaxgear.study._result import Result, Summary, titled, together
from jaxgear.study._results import Entry, dataset_of, over, static_dataset
from jaxgear.study._robust import hardened
from jaxgear.study._robust_report import robust_datasets, robust_notes, robust_summary
from jaxgear.study._running import timed
from jaxgear.study._scatter import Scatter, scatter_of
from jaxgear.study._search import (
    TOO_FEW_SPEEDS,
    Search,
    Searched,
    forget,
    limits_notes,
    limits_summary,
    record_file,
    require_acting,
    search_of,
    searched,
    smoothing_bias_of,
    smoothing_notes,
)
from jaxgear.study._search_checks import require_searchable
from jaxgear.study._statics import SolverFailure, Statics, solve_statics
from jaxgear.study._sweep_notes import left_out_notes
from optimise import SearchResult


@study
def optimise(scene: Scene, memory: Path | None = None) -> Result:
    """Gradient optimisation of [optimise].vary, with what [optimise.pareto] and [robust] ask for.

    **Arguments:**

    - `scene`: checked against the schema.
    - `memory`: a folder for what a search that is killed has found: the next one goes on from it.

    **Returns:**

    Groups `search_...`, `modification`, `pareto` and `robust_...`, the summary, and the improved
    scenes.

    **Raises:**

    - `ValueError` if the gears are impossible, or the scene asks for what cannot be searched.
    - `SolverFailure` if a contact problem was not solved.
    """
    require_searchable(scene)
    built = built_scene(scene)
    statics = solve_statics(built)
    first = Result(built.scene, head(built, statics))
    return together(first, optimisation(built, statics, memory=memory))


class _Posed(NamedTuple):
    """What is searched: meshes where variables leave them as they are, scatter where asked for."""

    space: DesignSpace
    grid: MeshGrid
    prepared: PreparedMesh | None
    scatter: Scatter | None


def optimisation(
    built: BuiltScene,
    before: Statics,
    torques: np.ndarray | None = None,
    memory: Path | None = None,
) -> Result:
    """Search with smooth contact, judge with exact contact, and say what became better.

    The statics of the scene and of what is found have the same further torques [N m]: one program.
    The result is to be joined to that of the statics.
    """
    scene, problem = built.scene, _problem(built, before)
    space, grid, prepared, scatter = problem
    file = record_file(space, memory)
    search = search_of(space, grid, prepared, file)
    speeds = judged_speeds(space, grid, ExactContact())
    at_start = speeds(space.start)
    if any(2 * int(np.sum(each.kept)) < each.speed.size for _, each in at_start):
        raise SolverFailure(TOO_FEW_SPEEDS)
    require_acting(search, space)
    made = searched(search, space)
    after = _solved(space, made.found.point, torques)
    own, notes = _judged(problem, search, made, (before, after))
    at_end = speeds(np.asarray(made.found.point))
    notes = left_out_notes(at_start, at_end) + notes
    name = f"{scene.name}.optimised.toml"
    own |= left_out(at_start, at_end) | {"scene": name}
    states = {"start": before.model, "optimised": after.model}
    flanks = modification_dataset({name: (it.pair, it.flanks) for name, it in states.items()})
    result = Result(
        scene,
        {"optimise": own, "notes": notes},
        {
            "search_before": _design_dataset(scene.title, before),
            "search_after": _design_dataset(scene.title, after),
            "search_trace": titled(_trace(scene.optimise, search.name, made), scene.title),
            "modification": titled(flanks, scene.title),
        },
        scenes={name: space.numbers(made.found.point)},
    )
    if scene.optimise.pareto.against is not None:
        result = together(front_result(space, grid, prepared), result)
    if scatter is not None:
        more = _robust(problem, scatter, made.found.point, torques, memory)
        own["robust"] = more.summary.pop("robust")
        result = together(result, more)
    # Only now: what is stopped before begins with all that the search has found.
    forget(file)
    return result


def _robust(
    problem: _Posed,
    scatter: Scatter,
    nominal: np.ndarray,
    torques: np.ndarray | None,
    memory: Path | None,
) -> Result:
    """Go on from a nominal optimum to the robust one, and judge both on fresh gears."""
    space, grid, prepared, _ = problem
    scene, file = space.scene, record_file(space, memory, "robust")
    made = hardened(scatter, nominal, grid, smooth_law_of(scene.mesh), prepared, file)
    keys, name = space.numbers(made.found.point), f"{scene.name}.robust.toml"
    statics = _solved(space, made.found.point, torques)
    datasets = {**robust_datasets(made), "search_robust": _design_dataset(scene.title, statics)}
    summary = {"robust": robust_summary(made) | {"scene": name}, "notes": robust_notes(made)}
    forget(file)
    return Result(scene, summary, datasets, scenes={name: keys})


def _problem(built: BuiltScene, before: Statics) -> _Posed:
    """Variables, grid and meshes of a search; refuses what cannot be begun or written down."""
    scene = built.scene
    space = design_space(
        built,
        tuple(scene.optimise.vary),
        symmetric=scene.optimise.symmetric,
        deflection=float(before.numbers["single_pair_deflection_um"]),
        influences=before.influences,
    )
    space.require_tied_start()
    try:
        # Before the search, so that a file that cannot be rewritten does not cost its result.
        rewritten(scene.path, scene.overridden() | space.numbers(space.start))
    except ValueError as error:
        raise InputError(str(error)) from error
    pair, grid, scatter = before.model.pair, before.grid, None
    if scene.robust.is_given:
        scatter = scatter_of(space, pair, np.asarray(before.cycle.cells.lines.tooth))
    moving = not space.flanks_only or (scatter is not None and not scatter.same_lines)
    if moving and not scene.bodies:
        # The contact ratio may grow with what changes; condensed bodies hold for one grid.
        names = "phases", "slices", "periods", "beyond"
        grid = mesh_grid(pair, **{name: getattr(grid, name) for name in names}, margin=1.0)
    return _Posed(space, grid, prepared_mesh(space, grid, before), scatter)


def _solved(space: DesignSpace, point: np.ndarray, torques: np.ndarray | None) -> Statics:
    """The statics of a design, as its own scene would have them."""
    keys = space.numbers(point)
    try:
        # Those that follow small changes are of a sample of gears, not of a design.
        teeth = space.influences if isinstance(space.influences, tuple) else None
        return solve_statics(BuiltScene(space.scene.replace(keys)), torques, teeth)
    except InputError as error:
        raise SolverFailure(
            f"the search ended at impossible gears, {keys}: {error} Narrow [optimise.bounds]."
        ) from error


def _judged(
    problem: _Posed, search: Search, made: Searched, statics: tuple[Statics, Statics]
) -> tuple[Summary, list[str]]:
    """Judge with exact contact where a search began and ended: part of the summary, and remarks."""
    space, found = problem.space, made.found
    scene, law = space.scene, ExactContact()
    task = task_of(space, problem.grid, law, problem.prepared)
    exact = lambda point: float(timed(objective_at, task, np.asarray(point), law, options=QUICKLY))
    before, after = exact(space.start), exact(found.point)
    if not np.isfinite([before, after]).all():
        more = f", or {TOO_FEW_SPEEDS}" if is_dynamic(scene.optimise) else ""
        raise SolverFailure(f"the contact was not solved where the search began or ended{more}")
    bias, notes = found.value - after, []
    if not found.converged:
        more = "" if search.limits else " Raise optimise.max_evaluations."
        notes.append(Doubtful(f"The search did not converge: {found.reason}.{more}"))
    notes += smoothing_notes(scene.mesh.smoothing_um, bias, before, after)
    limits = []
    if search.limits:
        end = np.asarray(found.point)
        exactly = np.asarray(timed(responses_at, task, end, law, options=QUICKLY))
        smoothly = np.asarray(
            search.slopes.at(smooth_law_of(scene.mesh).width)(jnp.asarray(end))[0]
        )
        limits = limits_summary(search.limits, exactly[1:], smoothly[1:])
        notes += limits_notes(limits)
    summary = {
        "minimise": scene.optimise.alone or "weighted table",
        "torques_Nm": space.torques,
        "objective_unit": objective_unit(scene.optimise),
        "variables": space.numbers(found.point),
        "before": _numbers_of(statics[0], before),
        "after": _numbers_of(statics[1], after),
        "smooth_objective": found.value,
        "smooth_less_exact": bias,
        "smoothing_bias_at_most": smoothing_bias_of(search, space, found.point),
        "smoothing_um": scene.mesh.smoothing_um,
        "method": search.name,
        "starts": len(made.each) + made.left_out,
        "starts_left_out": made.left_out,
        "searches": [_row(space, each) for each in made.each],
        "limits": limits,
        "evaluations": found.evaluations,
        "gradient_evaluations": found.gradient_evaluations,
        "converged": found.converged,
        "reason": found.reason,
        "at_bounds": space.at_bounds(found.point),
        "seconds_with_compiling": made.seconds,
    }
    return summary, notes


def _row(space: DesignSpace, found: SearchResult) -> Summary:
    """Part of the summary: where one search ended."""
    return {
        "smooth_objective": found.value,
        "variables": dict(zip(space.keys, found.point, strict=True)),
        "evaluations": found.evaluations,
        "converged": found.converged,
    }


def _numbers_of(statics: Statics, objective: float) -> Summary:
    """Objective with exact contact over all torques, and what changed at the scene's torque."""
    names = ("te_mean_um", "te_rms_um", "te_peak_to_peak_um", "max_line_load_N_mm")
    names += "max_pressure_MPa", "face_load_factor"
    names += tuple(name for name in statics.numbers if name.startswith("max_root_stress"))
    return {"objective": objective} | {name: float(statics.numbers[name]) for name in names}


def left_out(before: JudgedSpeeds, after: JudgedSpeeds) -> Summary:
    """Part of the summary: speeds that do not count where a search began and ended."""
    row = lambda torque, each: {
        "torque_Nm": torque,
        "count": int(each.left_out.size),
        "of": int(each.speed.size),
        "speeds_rad_s": np.asarray(each.left_out),
    }
    ends = {"before": before, "after": after}
    return {
        f"speeds_left_out_{name}": [row(*each) for each in judged]
        for name, judged in ends.items()
        if judged
    }


def _design_dataset(title: str, statics: Statics) -> xr.Dataset:
    """The mesh cycle of a design, with mean and RMS of its transmission error."""
    dataset = static_dataset(statics.model, statics.cycle, statics.law)
    for name, words in (("mean", "mean"), ("rms", "RMS about its mean")):
        key, words = f"te_{name}_um", f"{words} of the transmission error"
        dataset[key] = Entry((), float(statics.numbers[key]), "um", words).variable()
    return titled(dataset, title)


def _trace(asked: OptimiseKeys, name: str, made: Searched) -> xr.Dataset:
    """The objective at each evaluation, of one search after the other."""
    counts = [np.arange(1, len(each.values) + 1) for each in made.each]
    starts = ["from the scene", *(f"from start {k}" for k in range(2, len(made.each) + 1))]
    methods = [f"{name} {start}" for start, own in zip(starts, counts, strict=True) for _ in own]
    objective, unit = np.concatenate([each.values for each in made.each]), objective_unit(asked)
    found = over(
        "record",
        method=(methods, "method of the search, and from where"),
        evaluation=(np.concatenate(counts), "number of the evaluation"),
    ) | in_unit("objective", ("record",), objective, unit, "objective")
    return dataset_of(found)
