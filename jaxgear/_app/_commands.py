"""The commands: each turns a good scene into a results folder and a summary."""

import importlib.metadata
import json
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tqdm
import xarray as xr

import optimise
from jaxgear._app import _pictures as pictures
from jaxgear._app._design import (
    DesignSpace,
    design_space,
    objective_function,
    objective_of,
    prepared_mesh,
    round_up,
    torques_of,
)
from jaxgear._app._gradients import GradientRow, gradient_table
from jaxgear._app._model import smooth_law_of
from jaxgear._app._results import static_dataset, write_csv, write_dataset, write_json
from jaxgear._app._scene import Scene, rewrite_scene, write_scene
from jaxgear._app._statics import (
    SolverFailure,
    Statics,
    Stopwatch,
    geometry_summary,
    iso_summary,
    require_solved,
    smoothing_bias,
    solve_statics,
)
from jaxgear._interface._laws import ExactContact
from jaxgear._response._transmission import cycle_rms, transmission_error
from jaxgear._solve._cycle import PreparedMesh, corrected_cycle
from jaxgear._system._model import PairModel
from jaxgear._types import Reals, Scalar
from jaxgear._units import um

Summary = dict[str, Any]


@contextmanager
def _progress(total: int, what: str, quiet: bool) -> Iterator[Callable[[int], None]]:
    """A progress bar on standard error; the value is told how many more are done."""
    with tqdm.tqdm(total=total, desc=what, disable=quiet, file=sys.stderr, leave=False) as bar:

        def done(count: int) -> None:
            bar.update(count)

        yield done


def run(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Geometry, a quasi-static mesh cycle and, where the scene asks for it, the optimisation.

    **Arguments:**

    - `scene`: checked against the schema.
    - `folder`: for the results; exists.
    - `quiet`: whether to show no progress.

    **Returns:**

    The summary that is also in `summary.json`.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved.
    """
    watch = Stopwatch()
    with _progress(2, "mesh cycle", quiet) as done:
        torques = _harris_torques(scene)
        statics = solve_statics(scene, watch, torques)
        done(1)
        dataset = static_dataset(statics.model, statics.cycle, statics.law)
        about = {"units": "N m", "long_name": "torque on the pinion"}
        dataset = dataset.assign_coords(torque_Nm=("torque", torques, about))
        about = {"units": "um", "long_name": "transmission error over torque and phase"}
        dataset["harris_te_um"] = (("torque", "phase"), statics.harris / um, about)
        write_dataset(dataset, folder / "result.nc")
        _draw_statics(folder, _title(scene), statics, dataset)
        done(1)
    summary = _head(scene, statics)
    if scene.has_table("optimise"):
        summary |= _optimisation(scene, statics, folder, quiet, watch, torques)
    return _finish(scene, folder, summary, watch)


def map_relief(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Master Curve map of symmetric tip relief, with closed form and the optimiser's path.

    Arguments, results and errors as for `run`.
    """
    watch = Stopwatch()
    statics = solve_statics(scene, watch)
    summary = _head(scene, statics)
    keys = ("flank.pinion.tip_relief.depth_um", "flank.pinion.tip_relief.extent")
    deflection = summary["static"]["single_pair_deflection_um"] * um
    space = design_space(scene, keys, symmetric=True, deflection=deflection / um)
    most = scene.get("map.depth_um.to", round_up(3.0 * deflection / um))
    depth = um * np.linspace(scene["map.depth_um.from"], most, scene["map.depth_um.points"])
    extent = np.linspace(
        scene["map.extent.from"], scene["map.extent.to"], scene["map.extent.points"]
    )

    torque = statics.model.torque[None]
    meshes = watch(
        lambda model, t: optimise.prepare_torques(model, t, statics.grid), statics.model, torque
    )
    prepared = jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[0]), meshes)

    def te_rms(depth: Scalar, extent: Scalar) -> Scalar:
        model = space.model(jnp.stack([depth / um, extent]))
        cycle = corrected_cycle(prepared, model)
        rms = cycle_rms(cycle, transmission_error(model.pair, cycle)) / um
        return jnp.where(jnp.all(cycle.converged), rms, jnp.nan)

    with _progress(depth.size * extent.size, "map", quiet) as done:
        chart, valley = optimise.relief_map(te_rms, depth, extent, done=done)
    require_solved(np.isfinite(chart.value))
    ratio = jnp.asarray(summary["geometry"]["profile_contact_ratio"])
    closed = _closed_form(extent, ratio, deflection)
    variance = optimise.over_torques(
        space.model,
        optimise.TransmissionErrorVariance(),
        torque,
        grid=statics.grid,
        law=smooth_law_of(scene),
        prepared=meshes,
    )
    found = _descent(space, variance, quiet)
    best = jax.jit(te_rms)(jnp.asarray(found.point[0] * um), jnp.asarray(found.point[1]))
    at_best = _closed_form(found.point[1:], ratio, deflection)
    lowest = int(np.argmin(valley.value))
    summary["master_curve"] = {
        "depth_um": found.point[0],
        "extent": found.point[1],
        "te_rms_um": float(best),
        "closed_form_depth_um": at_best[0],
        "single_pair_deflection_um": deflection / um,
        "evaluations": found.evaluations,
        "gradient_evaluations": found.gradient_evaluations,
        "grid_best": {
            "depth_um": valley.depth[lowest] / um,
            "extent": valley.extent[lowest],
            "te_rms_um": valley.value[lowest],
        },
        "valley": {
            "extent": valley.extent,
            "depth_um": valley.depth / um,
            "te_rms_um": valley.value,
            "closed_form_depth_um": closed,
        },
    }
    # Relief of one and a half deflections parts the teeth at the ends of the path.
    relieved = jax.jit(lambda x: space.model(x))(jnp.asarray([1.5 * deflection / um, 0.3]))
    summary["smoothing_bias"] = _draw_bias(scene, folder, relieved, prepared, watch)
    figure = pictures.master_curve(chart, valley, closed, found.path, _title(scene))
    pictures.save(
        figure, pictures.master_curve_columns(chart, valley, closed), folder, "master_curve"
    )
    return _finish(scene, folder, summary, watch)


def optimise_flanks(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Gradient optimisation of [optimise].vary; writes NAME.optimised.toml.

    Arguments, results and errors as for `run`.
    """
    watch = Stopwatch()
    statics = solve_statics(scene, watch)
    summary = _head(scene, statics) | _optimisation(scene, statics, folder, quiet, watch)
    return _finish(scene, folder, summary, watch)


def check_gradients(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Compare every derivative that an optimiser may use with central differences.

    Arguments and results as for `run`.

    **Raises:**

    - `SolverFailure` if a derivative is wrong, after the table is written.
    """
    watch = Stopwatch()
    laws = {"exact": ExactContact(), "smooth": smooth_law_of(scene)}
    table = []
    with _progress(len(laws), "derivatives", quiet) as done:
        for name, law in laws.items():
            table += [(name, row) for row in gradient_table(scene, law, watch)]
            done(1)
    columns = {
        name: np.asarray([getattr(row, name) for _, row in table])
        for name in ("response", "key", "forward", "reverse", "difference", "error", "verdict")
    }
    write_csv(
        {"contact": np.asarray([name for name, _ in table])} | columns, folder / "gradients.csv"
    )
    counts = {
        verdict: int(np.sum(columns["verdict"] == verdict))
        for verdict in ("ok", "no effect", "set changes", "WRONG")
    }
    judged = columns["error"][columns["verdict"] == "ok"]
    summary = _names(scene) | {
        "check_grad": {
            "verdicts": counts,
            "largest_error_ok": float(np.max(judged, initial=0.0)),
            "rows": [
                {"contact": name, **{key: getattr(row, key) for key in columns}}
                for name, row in table
            ],
        }
    }
    if not quiet:
        print(_gradient_text(table), file=sys.stderr)
    summary = _finish(scene, folder, summary, watch)
    if counts["WRONG"]:
        raise SolverFailure(
            f"{counts['WRONG']} derivatives disagree with central differences by more than 1e-6; "
            f"they are marked WRONG in {folder / 'gradients.csv'}."
        )
    return summary


COMMANDS: dict[str, Callable[[Scene, Path, bool], Summary]] = {
    "run": run,
    "map": map_relief,
    "optimise": optimise_flanks,
    "check-grad": check_gradients,
}


def _names(scene: Scene) -> Summary:
    """What every summary begins with."""
    packages = ("jaxgear", "jax", "jaxlib", "equinox", "optax", "numpy", "scipy")
    versions = {name: importlib.metadata.version(name) for name in packages}
    return {"name": scene["name"], "cite": scene["cite"], "versions": versions}


def _head(scene: Scene, statics: Statics) -> Summary:
    """Names, model, geometry and statics."""
    return _names(scene) | {
        "model": {
            "pinion": scene["pinion.body.kind"],
            "wheel": scene["wheel.body.kind"],
            "stiffness": scene["mesh.stiffness"],
            "foundation": scene["mesh.foundation"],
            "contact": scene["mesh.contact"],
            "slices": scene["mesh.slices"],
            "phases": scene["mesh.phases"],
            "dofs": 1
            + sum(
                getattr(support, name) is not None
                for support in (statics.model.pinion_support, statics.model.wheel_support)
                for name in ("radial_s", "radial_t", "axial", "tilt", "tilt")
            ),
        },
        "geometry": geometry_summary(statics.model),
        "iso6336": iso_summary(statics.model),
        "static": {key: float(value) for key, value in statics.numbers.items()},
    }


def _title(scene: Scene) -> str:
    return f"{scene['name']}, {scene['pair.torque_pinion_Nm']:g} N m"


def _harris_torques(scene: Scene) -> np.ndarray:
    """Torques of the Harris map: given, or from a quarter of the scene's to half as much again."""
    nominal = scene["pair.torque_pinion_Nm"] * np.linspace(0.25, 1.5, 6)
    return np.asarray(scene.get("map.torques_Nm", nominal), dtype=float)


def _draw_statics(folder: Path, title: str, statics: Statics, dataset: xr.Dataset) -> None:
    """The pictures of one mesh cycle."""
    save = pictures.save
    model = statics.model
    save(pictures.gear_pair(model, title), pictures.gear_pair_columns(model), folder, "gear_pair")
    for name, draw, columns in (
        ("transmission_error", pictures.transmission_error, pictures.transmission_error_columns),
        ("mesh_stiffness", pictures.stiffness_and_sharing, pictures.stiffness_and_sharing_columns),
        ("flank_maps", pictures.flank_maps, pictures.flank_maps_columns),
    ):
        save(draw(dataset, title), columns(dataset), folder, name)
    phase, weight = dataset["phase"].values, dataset["weight"].values
    torques, error = dataset["torque_Nm"].values, dataset["harris_te_um"].values
    figure = pictures.harris_map(torques, phase, error, title, weight=weight)
    columns = pictures.harris_map_columns(torques, phase, error, weight=weight)
    save(figure, columns, folder, "harris_map")


def _draw_bias(
    scene: Scene, folder: Path, model: PairModel, prepared: PreparedMesh, watch: Stopwatch
) -> Summary:
    """Smooth against exact contact on a flank whose ends are out of contact."""
    widths = um * np.geomspace(0.02, 5.0, 17)
    mean, rms, exact = map(np.asarray, watch(smoothing_bias, model, prepared, jnp.asarray(widths)))
    relative = rms / max(float(exact), 1e-12 * um)
    data = widths / um, mean / um, relative
    title = f"{_title(scene)}, tip relief that parts the teeth"
    figure = pictures.smoothing_bias(*data, float(exact) / um, title)
    pictures.save(figure, pictures.smoothing_bias_columns(*data), folder, "smoothing_bias")
    return {"width_um": widths / um, "te_mean_bias_um": mean / um, "te_rms_bias_relative": relative}


def _closed_form(extent: np.ndarray, ratio: Scalar, deflection: float) -> np.ndarray:
    """Depth of the closed-form Master Curve [um]."""
    closed_form = jax.jit(optimise.master_curve_depth)
    depth = closed_form(jnp.asarray(extent), ratio, jnp.asarray(deflection))
    return np.asarray(depth) / um


def _descent(
    space: DesignSpace, objective: Callable[[Reals], Scalar], quiet: bool
) -> optimise.SearchResult:
    """The gradient search that the scene names, with a progress bar."""
    scene = space.scene
    search = {"lbfgs": optimise.lbfgs, "adam": optimise.adam}[scene["optimise.method"]]
    most = scene["optimise.max_evaluations"]
    with _progress(most, scene["optimise.method"], quiet) as done:
        return search(
            objective,
            space.start,
            space.box,
            most_evaluations=most,
            watch=lambda point, value: done(1),
        )


def _optimisation(
    scene: Scene,
    before: Statics,
    folder: Path,
    quiet: bool,
    watch: Stopwatch,
    torques: np.ndarray | None = None,
) -> Summary:
    """Search with smooth contact, judge with exact contact, and show what became better."""
    space = design_space(
        scene,
        tuple(scene["optimise.vary"]),
        symmetric=scene["optimise.symmetric"],
        deflection=float(before.numbers["single_pair_deflection_um"]),
    )
    prepared = prepared_mesh(space, before.grid, watch)
    smooth = objective_function(space, before.grid, smooth_law_of(scene), prepared)
    exact = jax.jit(objective_function(space, before.grid, ExactContact(), prepared))
    start = time.perf_counter()
    found = _descent(space, smooth, quiet)
    seconds = time.perf_counter() - start
    with _progress(1, "differential evolution", quiet) as done:
        baseline = optimise.differential_evolution(smooth, space.box)
        done(1)
    keys = {key: float(value) for key, value in space.updates(jnp.asarray(found.point)).items()}
    after = solve_statics(scene.replace(keys), watch, torques)
    values = {
        name: float(exact(jnp.asarray(point)))
        for name, point in (("before", space.start), ("after", found.point))
    }
    _, unit = objective_of(scene)
    destination = Path(f"{scene['name']}.optimised.toml")
    updates = scene.overridden() | keys
    rewrite_scene(scene.path, updates, folder / destination)
    old, new = (static_dataset(each.model, each.cycle, each.law) for each in (before, after))
    title = _title(scene)
    figure = pictures.before_after(old, new, title)
    pictures.save(figure, pictures.before_after_columns(old, new), folder, "before_after")
    traces = {
        scene["optimise.method"]: found.values,
        "differential evolution": baseline.values,
    }
    figure = pictures.search_trace(traces, unit, title)
    pictures.save(figure, pictures.search_trace_columns(traces, unit), folder, "search")
    return {
        "optimise": {
            "minimise": scene.get("optimise.minimise", "weighted table"),
            "torques_Nm": torques_of(scene),
            "objective_unit": unit,
            "variables": keys,
            "before": _judged(before, values["before"]),
            "after": _judged(after, values["after"]),
            "smooth_objective": found.value,
            "smooth_less_exact": found.value - values["after"],
            "smoothing_um": scene["mesh.smoothing_um"],
            "method": scene["optimise.method"],
            "evaluations": found.evaluations,
            "gradient_evaluations": found.gradient_evaluations,
            "converged": found.converged,
            "reason": found.reason,
            "seconds_with_compiling": seconds,
            "differential_evolution": {
                "objective": float(exact(jnp.asarray(baseline.point))),
                "variables": dict(zip(space.keys, baseline.point, strict=True)),
                "evaluations": baseline.evaluations,
                "converged": baseline.converged,
            },
            "scene": str(folder / destination),
        }
    }


def _judged(statics: Statics, objective: float) -> dict[str, float]:
    """Objective with exact contact over all torques, and what changed at the scene's torque."""
    names = ("te_mean_um", "te_rms_um", "te_peak_to_peak_um", "max_line_load_N_mm")
    numbers = {name: float(statics.numbers[name]) for name in (*names, "max_pressure_MPa")}
    return {"objective": objective} | numbers


def _gradient_text(table: list[tuple[str, GradientRow]]) -> str:
    """The table of derivatives for a reader; rows without effect are only counted."""
    lines = [
        f"{'contact':<8} {'response':<24} {'key':<40} {'forward':>14} {'reverse':>14} "
        f"{'central':>14} {'rel. error':>10}  verdict"
    ]
    shown = [(name, row) for name, row in table if row.verdict != "no effect"]
    lines += [
        f"{name:<8} {row.response:<24} {row.key:<40} {row.forward:>14.7g} {row.reverse:>14.7g} "
        f"{row.difference:>14.7g} {row.error:>10.1e}  {row.verdict}"
        for name, row in shown
    ]
    lines.append(f"and {len(table) - len(shown)} rows without effect, in gradients.csv")
    return "\n".join(lines)


def _finish(scene: Scene, folder: Path, summary: Summary, watch: Stopwatch) -> Summary:
    """Add the cost, and write what every results folder has."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    summary["cost"] = {
        "compile_s": watch.compile_s,
        "run_s": watch.run_s,
        "peak_memory_MB": peak / (1024.0**2 if sys.platform == "darwin" else 1024.0),
    }
    write_scene(scene, folder / "scene.toml")
    write_json(summary, folder / "summary.json")
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))
