"""The commands: each turns a good scene into a results folder and a summary."""

import dataclasses
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
from jaxgear._app import _campbell_pictures
from jaxgear._app import _curve_pictures as curve_pictures
from jaxgear._app import _dynamic_pictures as dynamic_pictures
from jaxgear._app import _pictures as pictures
from jaxgear._app import _robust_pictures as robust_pictures
from jaxgear._app._design import (
    DesignSpace,
    design_space,
    is_dynamic,
    judged_speeds,
    left_out,
    objective_function,
    objective_of,
    prepared_mesh,
    refuse_unbounded,
    require_search,
    require_swept,
    responses_function,
    round_up,
)
from jaxgear._app._dynamics import (
    Dynamics,
    Sweep,
    campbell_dataset,
    damping_summary,
    directions_of,
    drawn_sweep,
    marked,
    modes_dataset,
    modes_shown,
    modes_summary,
    orbit_dataset,
    pieces_lost,
    require_damped,
    solve_dynamics,
    speeds_of,
    sweep_dataset,
    sweep_of,
    sweep_summary,
    waves_of,
    way_of,
)
from jaxgear._app._gradients import dynamic_table, gradient_table
from jaxgear._app._model import model_of, smooth_law_of
from jaxgear._app._notes import left_out_notes, notes, steady_notes, sweep_notes
from jaxgear._app._pareto import draw_front, front_of, front_remarks, is_asked_for
from jaxgear._app._results import static_dataset, write_csv, write_dataset, write_json
from jaxgear._app._robust import (
    hardened,
    reach_of,
    response_of,
    robust_notes,
    robust_summary,
    shown,
)
from jaxgear._app._scatter import Scatter, scatter_of
from jaxgear._app._scene import Scene, rewrite_scene, write_scene
from jaxgear._app._schema import GEARS, KEYS, general
from jaxgear._app._search import (
    Search,
    best_of_starts,
    by_gradient,
    limits_summary,
    record_file,
    require_acting,
    search_of,
    smoothing_bias_of,
    smoothing_notes,
)
from jaxgear._app._sizing import (
    combinations_of,
    sizing_columns,
    sizing_summary,
    sizing_table,
)
from jaxgear._app._statics import (
    SolverFailure,
    Statics,
    Stopwatch,
    couples_on_pinion,
    geometry_summary,
    iso_summary,
    mounts_summary,
    smoothing_bias,
    solve_statics,
    torques_of,
)
from jaxgear._app._turning import require_retained, turning_dataset
from jaxgear._app._with_bodies import with_bodies
from jaxgear._checks import InputError
from jaxgear._geometry._lines import MeshGrid, mesh_grid
from jaxgear._interface._laws import ExactContact, SmoothContact
from jaxgear._response._transmission import cycle_rms, transmission_error
from jaxgear._solve._cycle import PreparedMesh, corrected_cycle
from jaxgear._system._model import PairModel
from jaxgear._types import Scalar
from jaxgear._units import um

Summary = dict[str, Any]


@contextmanager
def _progress(total: int, what: str, quiet: bool) -> Iterator[Callable[[int], None]]:
    """A progress bar on a terminal's standard error; the value is told how many more are done."""
    with tqdm.tqdm(
        total=total, desc=what, disable=quiet or None, file=sys.stderr, leave=False
    ) as bar:

        def done(count: int) -> None:
            bar.update(count)

        yield done


def _with_bodies(scene: Scene, quiet: bool, *, moving: bool = False) -> Scene:
    """The scene with its condensed bodies; where it has none, nothing is imported for them."""
    if not scene.condensed:
        return scene
    from jaxgear._app import _condense

    with _condense.steps("bodies", quiet) as tell:
        return with_bodies(scene, tell, moving=moving or scene.has_table("sweep"))


def run(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Geometry, a quasi-static mesh cycle and, where asked for, sizing table and optimisation.

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
    scene = _with_bodies(scene, quiet)
    # Impossible gears and endless searches are refused before any bar is drawn.
    model_of(scene)
    if scene.has_table("optimise"):
        refuse_unbounded(scene, tuple(scene["optimise.vary"]))
        require_swept(scene)
        require_search(scene)
    with _progress(2, "mesh cycle", quiet) as done:
        torques = _harris_torques(scene)
        statics = solve_statics(scene, watch, torques)
        done(1)
        dataset = static_dataset(statics.model, statics.cycle, statics.law)
        about = {"units": "N m", "long_name": "torque on the pinion"}
        dataset = dataset.assign_coords(torque_Nm=("torque", torques, about))
        about = {"units": "um", "long_name": "transmission error over torque and phase"}
        dataset["harris_te_um"] = (("torque", "phase"), statics.harris / um, about)
        about = {"units": "um", "long_name": "amplitudes of its mesh harmonics"}
        harmonics = statics.harris_harmonics / um
        dataset["harris_te_harmonic_um"] = (("torque", "harmonic"), harmonics, about)
        summary = _head(scene, statics)
        if scene.bodies:
            dataset, found = _on_bodies(scene, statics, dataset, folder, quiet)
            summary["static"] |= found
        write_dataset(dataset, folder / "result.nc")
        bearings = summary["static"]["bearings"]
        _draw_statics(folder, _title(scene), statics, dataset, bearings)
        done(1)
    if scene.has_table("sweep"):
        dynamics = solve_dynamics(scene, watch)
        found, swept = _sweep(scene, dynamics, folder, quiet)
        write_dataset(dataset, folder / "result.nc", swept)
        summary["notes"] += found.pop("notes")
        summary |= found
    if scene.has_table("sizing"):
        summary |= _sizing(scene, statics, folder, quiet, watch)
    if scene.has_table("optimise"):
        found = _optimisation(scene, statics, folder, quiet, watch, torques)
        summary["notes"] += found.pop("notes")
        summary |= found
    return _finish(scene, folder, summary, watch)


def _on_bodies(
    scene: Scene, statics: Statics, dataset: xr.Dataset, folder: Path, quiet: bool
) -> tuple[xr.Dataset, Summary]:
    """Draw what condensed bodies do, and add it to the dataset; what they do to the summary."""
    from jaxgear._app import _condense, _hybrid, _hybrid_dataset, _hybrid_pictures

    with _condense.steps("bodies", quiet) as tell:
        answers = _hybrid.body_answers(scene, statics, tell)
        dataset = _hybrid_dataset.hybrid_variables(dataset, answers)
        tell("drawing")
        _hybrid_pictures.draw(folder, _title(scene), dataset, answers)
    return dataset, _hybrid_dataset.hybrid_summary(dataset, answers)


def map_relief(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Master Curve map of symmetric tip relief, with closed form and the optimiser's path.

    Arguments, results and errors as for `run`.
    """
    watch = Stopwatch()
    # The closed form, and so the map, is for linear relief.
    linear = {f"flank.{gear}.tip_relief.shape": "linear" for gear in GEARS}
    scene = _with_bodies(scene.replace(linear), quiet)
    statics = solve_statics(scene, watch)
    summary = _head(scene, statics)
    deflection = summary["static"]["single_pair_deflection_um"] * um
    space = design_space(scene, _RELIEF_KEYS, symmetric=True, deflection=deflection / um)
    depth, extent = _map_axes(scene, deflection)
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
    if not (np.isfinite(chart.value).all() and np.isfinite(valley.value).all()):
        raise SolverFailure("the contact was not solved at some point of the map")
    variance = lambda variables, width: optimise.over_torques(
        space.model,
        optimise.TransmissionErrorVariance(),
        torque,
        grid=statics.grid,
        law=SmoothContact(width),
        prepared=meshes,
    )(variables)
    search = by_gradient(space, variance)
    found = _descent(search, space, quiet, space.start)
    lowest = int(np.argmin(valley.value))
    rival = np.asarray([valley.depth[lowest] / um, valley.extent[lowest]])
    best_on_grid = float(valley.value[lowest] ** 2)
    found, restarted = _unless_beaten(found, rival, best_on_grid, search, space, quiet)
    curve = _traced(
        space, statics, meshes, extent[::-1], float(valley.depth[-1]), float(depth[-1]), quiet
    )
    best = jax.jit(te_rms)(jnp.asarray(found.point[0] * um), jnp.asarray(found.point[1]))
    ratio = jnp.asarray(summary["geometry"]["profile_contact_ratio"])
    closed = _closed_form(np.append(extent, found.point[1]), ratio, deflection)
    summary["master_curve"] = {
        "depth_um": found.point[0],
        "extent": found.point[1],
        "te_rms_um": float(best),
        "closed_form_depth_um": closed[-1],
        "single_pair_deflection_um": deflection / um,
        "evaluations": found.evaluations,
        "gradient_evaluations": found.gradient_evaluations,
        "converged": found.converged,
        "restarted_from_grid": restarted,
        **_valley_summary(valley, closed[:-1]),
        "traced": _traced_summary(curve, ratio, deflection, float(depth[-1])),
    }
    # Relief of one and a half deflections parts the teeth at the ends of the path.
    relieved = jax.jit(lambda x: space.model(x))(jnp.asarray([1.5 * deflection / um, 0.3]))
    summary["smoothing_bias"] = _draw_bias(scene, folder, relieved, prepared, watch)
    figure = pictures.master_curve(chart, valley, closed[:-1], found.path, _title(scene))
    columns = pictures.master_curve_columns(chart, valley, closed[:-1])
    pictures.save(figure, columns, folder, "master_curve")
    traced = summary["master_curve"]["traced"]
    figure = curve_pictures.traced_curve(traced, _title(scene))
    pictures.save(figure, traced, folder, "master_curve_traced")
    if scene.get("map.torques_Nm") is not None:
        start, deepest = float(valley.depth[-1]), float(depth[-1])
        family = _family(space, extent[::-1], start, deepest, watch, quiet)
        summary["master_curve"]["torques"] = family
        figure = curve_pictures.family(chart, family, _title(scene))
        pictures.save(figure, curve_pictures.family_columns(family), folder, "master_curve_torques")
    return _finish(scene, folder, summary, watch)


_RELIEF_KEYS = ("flank.pinion.tip_relief.depth_um", "flank.pinion.tip_relief.extent")


def _map_axes(scene: Scene, deflection: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths [m] and extents of the map."""
    first, last = scene["map.depth_um.from"], scene.get("map.depth_um.to")
    if last is None:
        last = round_up(max(3.0 * deflection / um, 2.0 * first))
    extents = scene["map.extent.from"], scene["map.extent.to"]
    for name, low, high in (("depth_um", first, last), ("extent", *extents)):
        if not low < high:
            raise InputError(f"map.{name} must rise, got from = {low:g}, to = {high:g}.")
    depth = um * np.linspace(first, last, scene["map.depth_um.points"])
    return depth, np.linspace(*extents, scene["map.extent.points"])


def _family(
    space: DesignSpace,
    extent: np.ndarray,
    start: float,
    deepest: float,
    watch: Stopwatch,
    quiet: bool,
) -> list[Summary]:
    """The curve traced at each of `map.torques_Nm`, beside the closed form at that torque."""
    own, found = space.scene["pair.torque_pinion_Nm"], []
    for torque in torques_of(space.scene, "map.torques_Nm"):
        scene = space.scene.replace({"pair.torque_pinion_Nm": float(torque)})
        statics = solve_statics(scene, watch)
        prepare = lambda model, t, grid=statics.grid: optimise.prepare_torques(model, t, grid)
        meshes = watch(prepare, statics.model, statics.model.torque[None])
        # Deflections are nearly in proportion to the torque; and deeper is asked for by no one.
        near = min(start * float(torque) / own, deepest)
        curve = _traced(space, statics, meshes, extent, near, deepest, quiet)
        deflection = float(statics.numbers["single_pair_deflection_um"]) * um
        ratio = jnp.asarray(geometry_summary(statics.model)["profile_contact_ratio"])
        found.append(
            {"torque_Nm": float(torque), "single_pair_deflection_um": deflection / um}
            | _traced_summary(curve, ratio, deflection, deepest)
        )
    return found


def _traced(
    space: DesignSpace,
    statics: Statics,
    meshes: PreparedMesh,
    extent: np.ndarray,
    start: float,
    deepest: float,
    quiet: bool,
) -> optimise.TracedCurve:
    """The best depth followed from the longest of extents to the shortest, exactly."""
    residuals = optimise.residuals_over_torques(
        space.model,
        statics.model.torque[None],
        grid=statics.grid,
        law=ExactContact(),
        prepared=meshes,
    )
    deviations = lambda depth, extent: um * residuals(jnp.stack([depth / um, extent]))
    with _progress(extent.size, "Master Curve", quiet) as done:
        return optimise.traced_curve(deviations, extent, start, deepest=deepest, done=done)


def _traced_summary(
    curve: optimise.TracedCurve, ratio: Scalar, deflection: float, deepest: float
) -> dict[str, np.ndarray]:
    """The traced curve where it is one: found, and with less error than without relief."""
    kept = curve.settled & (curve.depth > 0.0) & (curve.depth <= deepest)
    return {
        "extent": curve.extent[kept],
        "depth_um": curve.depth[kept] / um,
        "te_rms_um": curve.rms[kept] / um,
        # RMS over error of depth, where the curve itself has none.
        "te_rms_per_depth": np.sqrt(0.5 * curve.bend[kept]),
        "closed_form_depth_um": _closed_form(curve.extent[kept], ratio, deflection),
    }


def _valley_summary(valley: optimise.Valley, closed: np.ndarray) -> Summary:
    """The best depth of each extent, and the best of all."""
    lowest = int(np.argmin(valley.value))
    return {
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


def optimise_flanks(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Gradient optimisation of [optimise].vary; writes NAME.optimised.toml.

    Arguments, results and errors as for `run`.
    """
    refuse_unbounded(scene, tuple(scene["optimise.vary"]))
    require_swept(scene)
    require_search(scene)
    watch = Stopwatch()
    scene = _with_bodies(scene, quiet)
    statics = solve_statics(scene, watch)
    summary = _head(scene, statics)
    found = _optimisation(scene, statics, folder, quiet, watch)
    summary["notes"] += found.pop("notes")
    return _finish(scene, folder, summary | found, watch)


def sweep_speeds(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Steady responses over the speeds of [sweep], in its directions, and round their folds.

    Arguments, results and errors as for `run`.
    """
    watch = Stopwatch()
    scene = _with_bodies(scene, quiet, moving=True)
    with _progress(1, "mesh cycle", quiet) as done:
        dynamics = solve_dynamics(scene, watch)
        done(1)
    summary = _head(scene, dynamics.statics)
    found, groups = _sweep(scene, dynamics, folder, quiet)
    write_dataset(xr.Dataset(), folder / "result.nc", groups)
    summary["notes"] += found.pop("notes")
    return _finish(scene, folder, summary | found, watch)


def _sweep(
    scene: Scene, dynamics: Dynamics, folder: Path, quiet: bool
) -> tuple[Summary, dict[str, xr.Dataset]]:
    """Sweep, draw what was found, and return its part of the summary, and datasets by name."""
    require_damped(scene, dynamics)
    watch = _wave_watch(scene, dynamics, quiet)
    count = len(speeds_of(scene)) * len(directions_of(scene))
    with _progress(count, "sweep", quiet) as done:
        found = sweep_of(scene, dynamics.pair, done, watch)
    model = dynamics.statics.model
    dataset = sweep_dataset(dynamics.pair, model, found)
    _draw_sweep(folder, scene, dynamics, found, dataset)
    remarks = sweep_notes(scene, found.unsettled, count, list(pieces_lost(found)))
    summary = {
        "damping": damping_summary(scene, dynamics),
        "sweep": sweep_summary(scene, dynamics, found, dataset),
        "notes": remarks,
    }
    groups = {"sweep": dataset}
    if watch is not None:
        from jaxgear._app import _body_waves, _condense, _wave_pictures

        with _condense.steps("waves", quiet) as tell:
            groups["waves"] = _body_waves.waves_dataset(watch, found)
            summary["sweep"]["waves"] = _body_waves.waves_summary(watch, groups["waves"])
            _wave_pictures.draw(folder, _title(scene), watch, groups["waves"], tell)
    return summary, groups


def _wave_watch(scene: Scene, dynamics: Dynamics, quiet: bool):
    """What looks at the waves of condensed bodies in a sweep; None where there are none."""
    if not dynamics.pair.bodies:
        if scene.rows("probes"):
            raise InputError("probes: they look at condensed bodies, of which this scene has none.")
        return None
    from jaxgear._app import _body_waves, _condense

    with _condense.steps("probes", quiet) as tell:
        return _body_waves.wave_watch(scene, dynamics.pair, tell)


def _draw_sweep(
    folder: Path, scene: Scene, dynamics: Dynamics, found: Sweep, dataset: xr.Dataset
) -> None:
    """The pictures of a sweep; those of one direction show the one with the highest peak."""
    save, title, model = pictures.save, _title(scene), dynamics.statics.model
    critical, natural = marked(dynamics, model.pair.pinion.teeth)
    over = drawn_sweep(dataset)
    figure = dynamic_pictures.sweep(over, title, critical)
    save(figure, dynamic_pictures.sweep_columns(over, critical), folder, "sweep")
    own, title_of_way = dataset.sel(direction=found.main), title + way_of(found)
    figure = dynamic_pictures.waterfall(own, title_of_way, natural)
    save(figure, dynamic_pictures.waterfall_columns(own), folder, "waterfall")
    for name, draw, columns in (
        ("orders", dynamic_pictures.orders, dynamic_pictures.orders_columns),
        ("contact_loss", dynamic_pictures.contact_loss, dynamic_pictures.contact_loss_columns),
    ):
        save(draw(own, title_of_way), columns(own), folder, name)
    orbit = orbit_dataset(dynamics.pair, model, found)
    speed = float(found.speeds[found.highest(found.main)[1]])
    figure = dynamic_pictures.orbit(orbit, f"{title}, {speed:.5g} rad/s")
    save(figure, dynamic_pictures.orbit_columns(orbit), folder, "orbit")


def natural_modes(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Natural frequencies with the mean mesh stiffness, strain energy, critical speeds.

    Arguments, results and errors as for `run`.
    """
    watch = Stopwatch()
    scene = _with_bodies(scene, quiet, moving=True)
    with _progress(1, "modes", quiet) as done:
        dynamics = solve_dynamics(scene, watch)
        done(1)
    teeth, harmonics = dynamics.statics.model.pair.pinion.teeth, scene["modes.harmonics"]
    require_retained(scene, dynamics.pair)
    count = modes_shown(scene, np.asarray(dynamics.modes.frequency))
    waves = waves_of(scene, dynamics, teeth, count, harmonics)
    dataset = modes_dataset(dynamics, count, waves)
    figure = dynamic_pictures.modes(dataset, _title(scene))
    pictures.save(figure, dynamic_pictures.modes_columns(dataset), folder, "modes")
    if waves is None:
        turning = campbell_dataset(scene, dynamics, teeth, count, harmonics)
        figure = dynamic_pictures.campbell(turning, _title(scene), harmonics=harmonics)
        columns = dynamic_pictures.campbell_columns(turning, harmonics=harmonics)
        pictures.save(figure, columns, folder, "campbell")
    else:
        turning = turning_dataset(waves, harmonics)
        _campbell_pictures.draw(folder, _title(scene), turning, waves)
    groups = {"modes": dataset, "campbell": turning}
    write_dataset(xr.Dataset(), folder / "result.nc", groups)
    summary = _head(scene, dynamics.statics) | {
        "damping": damping_summary(scene, dynamics),
        "modes": modes_summary(scene, dynamics, teeth, count, waves),
    }
    return _finish(scene, folder, summary, watch)


def compare(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """One scene by many models and methods: error against time, and which suffices.

    Arguments, results and errors as for `run`.
    """
    from jaxgear._app import _compare

    if scene.has_table("sweep"):
        scene = _with_bodies(scene, quiet, moving=True)
    return _compare.compare(scene, folder, quiet)


def check_gradients(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Compare every derivative that an optimiser may use with central differences.

    Arguments and results as for `run`.

    A derivative that is wrong is counted in `check_grad.verdicts.WRONG`.
    """
    watch = Stopwatch()
    scene = _with_bodies(scene, quiet)
    laws = {"exact": ExactContact(), "smooth": smooth_law_of(scene)}
    table, steady = [], []
    moving = scene.has_table("sweep")
    with _progress(len(laws) + moving, "derivatives", quiet) as done:
        for name, law in laws.items():
            table += [(name, row) for row in gradient_table(scene, law, watch)]
            done(1)
        if moving:
            rows, steady = dynamic_table(scene, laws, watch)
            table += rows
            done(1)
    remarks = steady_notes(steady)
    for remark in remarks:
        _warn(remark)
    columns = {
        name: np.asarray([getattr(row, name) for _, row in table])
        for name in ("response", "key", "forward", "reverse", "difference", "error", "verdict")
    }
    write_csv(
        {"contact": np.asarray([name for name, _ in table])} | columns, folder / "gradients.csv"
    )
    verdicts = ["ok", "no effect", "shares a place", "set changes", "WRONG"]
    if moving:
        verdicts.insert(1, "ok to 1e-5")
    counts = {verdict: int(np.sum(columns["verdict"] == verdict)) for verdict in verdicts}
    counts["WRONG"] += int(np.sum(columns["verdict"] == "WRONG at 1e-5"))
    judged = columns["error"][columns["verdict"] == "ok"]
    in_motion = columns["error"][columns["verdict"] == "ok to 1e-5"]
    summary = _names(scene) | {
        "check_grad": {
            "verdicts": counts,
            "largest_error_ok": float(np.max(judged, initial=0.0)),
            "largest_error_ok_to_1e-5": float(np.max(in_motion, initial=0.0)),
            "dynamics": [dataclasses.asdict(point) for point in steady],
            "rows": [
                {"contact": name, **{key: getattr(row, key) for key in columns}}
                for name, row in table
            ],
        },
        "notes": remarks,
    }
    return _finish(scene, folder, summary, watch)


def condense(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Build the condensed bodies of a scene and say how good they are.

    Arguments, results and errors as for `run`.
    """
    from jaxgear._app import _condense

    return _condense.condense(scene, folder, quiet)


def sensitivity(scene: Scene, folder: Path, quiet: bool) -> Summary:
    """Find what the responses of a scene react to, and how strongly.

    Arguments, results and errors as for `run`.
    """
    from jaxgear._app import _sensitivities
    from jaxgear._app._sensitivity_pictures import sensitivity as bars

    watch = Stopwatch()
    scene = _with_bodies(_sensitivities.with_own_modulus(scene), quiet)
    moving, remarks = scene.has_table("sweep"), []
    found = {}
    with _progress(1 + moving, "derivatives", quiet) as done:
        found["sensitivity"] = _sensitivities.static_sensitivities(scene, watch)
        done(1)
        if moving:
            steady, points = _sensitivities.moving_sensitivities(scene, watch)
            remarks = steady_notes(points)
            if steady is not None:
                found["sensitivity_in_motion"] = steady
            done(1)
    if scene.condensed:
        remarks.append(_sensitivities.OF_BODIES)
    remarks += [words for each in found.values() for words in each.lost()]
    for remark in remarks:
        _warn(remark)
    summary = _names(scene) | {"notes": remarks}
    for name, each in found.items():
        acting = each.sorted()
        title = f"{_title(scene)}: what the responses react to"
        pictures.save(bars(acting, title), acting.columns(), folder, name)
        summary[name] = acting.told()
    return _finish(scene, folder, summary, watch)


def _at_fidelity(name: str, command: Callable[[Scene, Path, bool], Summary]):
    """A command that first chooses the model, where the scene leaves it to the program."""

    def chosen(scene: Scene, folder: Path, quiet: bool) -> Summary:
        if scene["model.fidelity"] != "auto":
            return command(scene, folder, quiet)
        from jaxgear._app import _fidelity

        scene, about = _fidelity.chosen(scene, name, folder, quiet)
        return _fidelity.told(command(scene, folder, quiet), about, folder)

    return chosen


COMMANDS: dict[str, Callable[[Scene, Path, bool], Summary]] = {
    "run": _at_fidelity("run", run),
    "map": _at_fidelity("map", map_relief),
    "optimise": _at_fidelity("optimise", optimise_flanks),
    "sweep": _at_fidelity("sweep", sweep_speeds),
    "modes": natural_modes,
    "check-grad": check_gradients,
    "sensitivity": sensitivity,
    "compare": compare,
    "condense": condense,
}


def _names(scene: Scene) -> Summary:
    """What every summary begins with."""
    packages = ("jaxgear", "jax", "jaxlib", "equinox", "optax", "numpy", "scipy")
    versions = {name: importlib.metadata.version(name) for name in packages}
    return {"name": scene["name"], "cite": scene["cite"], "versions": versions}


def _head(scene: Scene, statics: Statics) -> Summary:
    """Names, model, geometry and statics."""
    known = notes(scene, statics)
    return (
        _names(scene)
        | {
            "model": {
                "pinion": scene["pinion.body.kind"],
                "wheel": scene["wheel.body.kind"],
                "stiffness": scene["mesh.stiffness"],
                "foundation": _foundation(scene),
                "contact": scene["mesh.contact"],
                "slices": scene["mesh.slices"],
                # Time steps, where statics are those that the dynamics begin with.
                "phases": statics.grid.phases,
                # Both gears' rotations are one coordinate: the drive.
                "dofs": len(statics.cycle.system.structure.map.free) - 1 + _modes_kept(scene),
            },
            "geometry": geometry_summary(statics.model),
            "iso6336": iso_summary(statics.model),
            "static": {key: float(value) for key, value in statics.numbers.items()}
            | mounts_summary(statics),
            "notes": known,
        }
        | _bodies(scene, known)
    )


def _modes_kept(scene: Scene) -> int:
    """Modes with which condensed bodies vibrate; none in statics."""
    bases = [body.basis for body in scene.bodies.values()]
    return sum(len(basis.square) for basis in bases if basis is not None)


def _foundation(scene: Scene) -> str:
    """What gives under the teeth of either gear; once, if it is the same."""
    given = [scene.get(f"{gear}.foundation", scene["mesh.foundation"]) for gear in GEARS]
    own = ["its condensed body" if gear in scene.bodies else None for gear in GEARS]
    if not any(own) and not any(f"{gear}.foundation" in scene.values for gear in GEARS):
        return scene["mesh.foundation"]
    named = zip(GEARS, own, given, strict=True)
    return ", ".join(f"{gear} {body or foundation}" for gear, body, foundation in named)


def _bodies(scene: Scene, known: list[str]) -> Summary:
    """What the condensed bodies are, as `condense` says it, and all notes; empty without them."""
    if not scene.bodies:
        return {}
    from jaxgear._app._condense import _body_summary, _remarks

    built = [each.built for each in scene.bodies.values()]
    said = [words for each in built for words in (*each.warnings, *_remarks(scene, each))]
    return {"bodies": [_body_summary(scene, each) for each in built], "notes": known + said}


def _title(scene: Scene) -> str:
    return f"{scene['name']}, {scene['pair.torque_pinion_Nm']:g} N m"


def _harris_torques(scene: Scene) -> np.ndarray:
    """Torques of the Harris map: given, or from a quarter of the mesh's to half as much again."""
    if scene.get("map.torques_Nm") is not None:
        return torques_of(scene, "map.torques_Nm")
    torque, couples = scene["pair.torque_pinion_Nm"], couples_on_pinion(scene)
    on_mesh = torque + couples
    least = max(0.25 * on_mesh - couples, 0.05 * torque)
    return np.linspace(least, 1.5 * on_mesh - couples, 6)


def _draw_statics(
    folder: Path,
    title: str,
    statics: Statics,
    dataset: xr.Dataset,
    bearings: list[dict[str, Any]],
) -> None:
    """The pictures of one mesh cycle."""
    save = pictures.save
    model = statics.model
    save(pictures.gear_pair(model, title), pictures.gear_pair_columns(model), folder, "gear_pair")
    for name, draw, columns in (
        ("transmission_error", pictures.transmission_error, pictures.transmission_error_columns),
        ("mesh_stiffness", pictures.stiffness_and_sharing, pictures.stiffness_and_sharing_columns),
        ("flank_maps", pictures.flank_maps, pictures.flank_maps_columns),
        ("face_load", pictures.face_load, pictures.face_load_columns),
    ):
        save(draw(dataset, title), columns(dataset), folder, name)
    weight = dataset["weight"].values
    torques, phase, error = (
        dataset[name].values for name in ("torque_Nm", "phase", "harris_te_um")
    )
    for name, draw, columns in (
        ("harris_map", pictures.harris_map, pictures.harris_map_columns),
        ("te_spectrum", pictures.te_spectrum, pictures.te_spectrum_columns),
    ):
        figure = draw(torques, phase, error, title, weight=weight)
        save(figure, columns(torques, phase, error, weight=weight), folder, name)
    if bearings:
        figure = pictures.shafts(model, statics.cycle, bearings, title)
        save(figure, pictures.shafts_columns(model, statics.cycle, bearings), folder, "shafts")


def _sizing(scene: Scene, statics: Statics, folder: Path, quiet: bool, watch: Stopwatch) -> Summary:
    """Every combination of the listed amounts: table, picture and the best of it."""
    count = len(combinations_of(scene)[1])
    with _progress(count, "sizing", quiet) as done:
        table = sizing_table(scene, statics.grid, watch, done)
    labels = [_amount_label(scene, key) for key in table.keys]
    error, pressure = (table.responses[name] for name in ("te_peak_to_peak_um", "max_pressure_MPa"))
    several = f"{len(table.torques)} torques up to " if len(table.torques) > 1 else ""
    title = f"{scene['name']}, {several}{max(table.torques):g} N m"
    figure = pictures.sizing(labels, table.amounts, table.torques, error, pressure, title)
    pictures.save(figure, sizing_columns(table), folder, "sizing")
    return {"sizing": sizing_summary(scene, table)}


def _amount_label(scene: Scene, key: str) -> str:
    """A key of a flank as an axis names it."""
    _, gear, name = key.split(".", 2)
    unit = KEYS[general(key)].unit.replace("um", "µm") or "-"
    return f"{'both' if scene['sizing.symmetric'] else gear}: {name} [{unit}]"


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


# A better point by this much of the objective found elsewhere is worth a second search.
_CLEARLY_BETTER = 0.02


def _descent(search: Search, space: DesignSpace, quiet: bool, start: np.ndarray | None = None):
    """One search from a start, or from as many as the scene asks for, with a progress bar."""
    most = space.scene["optimise.max_evaluations"]
    most *= space.scene["optimise.starts"] if start is None else 1
    most *= 1 + len(space.scene.get("optimise.anneal_um", ()))
    with _progress(most, search.name, quiet) as done:
        watch = lambda point, value: done(1)
        if start is None:
            return best_of_starts(search, space, watch)
        return search.descend(start, watch)


def _unless_beaten(
    found: optimise.SearchResult,
    rival: np.ndarray,
    value: float,
    search: Search,
    space: DesignSpace,
    quiet: bool,
) -> tuple[optimise.SearchResult, bool]:
    """Search once more from a rival's point if its value is clearly better; says whether it was."""
    if value >= (1.0 - _CLEARLY_BETTER) * found.value:
        return found, False
    return optimise.joined(_descent(search, space, quiet, rival), found), True


def _warn(text: str) -> None:
    print(f"jaxgear: warning: {text}", file=sys.stderr)


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
    space.require_tied_start()
    destination = folder / f"{scene['name']}.optimised.toml"
    # Before the search, so that a file that cannot be rewritten does not cost its result.
    _rewrite(scene, {}, destination)
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
    prepared = prepared_mesh(space, grid, watch)
    file = record_file(space, folder, importlib.metadata.version("jaxgear"))
    search = search_of(space, grid, prepared, file)
    exact = jax.jit(objective_function(space, grid, ExactContact(), prepared))
    judged = judged_speeds(space, grid, ExactContact())
    judged_before = judged(space.start)
    _require_half(judged_before)
    require_acting(search, space)
    start = time.perf_counter()
    try:
        found = _descent(search, space, quiet)
    except FloatingPointError as error:
        if not is_dynamic(scene):
            raise
        raise SolverFailure(f"{error} {_TOO_FEW}") from error
    seconds = time.perf_counter() - start
    limits = _FEW_MEMBERS if is_dynamic(scene) else {}
    with _progress(1, "differential evolution", quiet) as done:
        baseline = optimise.differential_evolution(search.objective, space.box, **limits)
        done(1)
    rival = baseline.point, baseline.value
    found, restarted = _unless_beaten(found, *rival, search, space, quiet)
    for each in folder.glob(f"{file.stem}*{file.suffix}"):
        each.unlink()
    if not found.converged:
        more = "" if search.limits else " Raise optimise.max_evaluations."
        _warn(f"the search did not converge: {found.reason}.{more}")
    keys = {key: float(value) for key, value in space.updates(jnp.asarray(found.point)).items()}
    try:
        after = solve_statics(scene.replace(keys), watch, torques)
    except InputError as error:
        raise SolverFailure(
            f"the search ended at impossible gears, {keys}: {error} Narrow [optimise.bounds]."
        ) from error
    _rewrite(scene, keys, destination)
    _draw_search(scene, folder, before, after, search.name, found, baseline)
    objectives = {
        name: float(exact(jnp.asarray(point)))
        for name, point in (
            ("before", space.start),
            ("after", found.point),
            ("baseline", baseline.point),
        )
    }
    if not np.isfinite(list(objectives.values())).all():
        more = f", or {_TOO_FEW}" if is_dynamic(scene) else ""
        raise SolverFailure(f"the contact was not solved where the search began or ended{more}")
    responses = jax.jit(responses_function(space, grid, ExactContact(), prepared))
    kept = lambda point: np.asarray(responses(jnp.asarray(point)))
    judged_after = judged(np.asarray(found.point))
    remarks = left_out_notes(judged_before, judged_after, limited=baseline.evaluations)
    bias = found.value - objectives["after"]
    own = objectives["before"], objectives["after"]
    remarks += smoothing_notes(scene["mesh.smoothing_um"], bias, *own)
    pareto = {}
    if is_asked_for(space):
        with _progress(scene["optimise.pareto.points"], "front", quiet) as done:
            front = front_of(space, grid, prepared, space.start, done)
        pareto = {"pareto": draw_front(space, front, _title(scene), folder)}
        remarks += front_remarks(front)
    robust: Summary = {}
    if scatter is not None:
        told, robust["robust"] = _robust(
            scatter, found.point, after, grid, prepared, folder, quiet, watch, torques
        )
        remarks += told
    for remark in remarks:
        _warn(remark)
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
            "limits": limits_summary(search, kept, found.point),
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
            "scene": str(destination),
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
    folder: Path,
    quiet: bool,
    watch: Stopwatch,
    torques: np.ndarray | None,
) -> tuple[list[str], Summary]:
    """Go on from a nominal optimum to the robust one, and show both on fresh gears."""
    space, scene = scatter.space, scatter.space.scene
    file = record_file(space, folder, importlib.metadata.version("jaxgear"), "robust")
    with _progress(scene["optimise.max_evaluations"], "robust search", quiet) as done:
        told = lambda point, value: done(1)
        law = smooth_law_of(scene)
        made = hardened(scatter, nominal, grid, law, prepared, told, file)
    file.unlink(missing_ok=True)
    summary = robust_summary(made)
    destination = folder / f"{scene['name']}.robust.toml"
    _rewrite(scene, summary["variables"], destination)
    statics = solve_statics(scene.replace(summary["variables"]), watch, torques)
    response, unit = response_of(scene), response_of(scene)[1]
    values = {
        name: shown(scene, each.fresh)
        for name, each in (("nominal", made.nominal), ("robust", made.robust))
    }
    datasets = {
        name: static_dataset(each.model, each.cycle, each.law)
        for name, each in (("nominal", nominal_statics), ("robust", statics))
    }
    title = f"{_title(scene)}, {scene['robust.fresh_samples']} gears"
    figure = robust_pictures.robust(values, datasets, scene["robust.share"], response, title)
    columns = robust_pictures.robust_columns(values, datasets, unit)
    pictures.save(figure, columns, folder, "robust")
    names, reach, ends = reach_of(made)
    figure = robust_pictures.tornado(names, reach, ends, response, _title(scene))
    columns = robust_pictures.tornado_columns(names, reach, ends, unit)
    pictures.save(figure, columns, folder, "tornado")
    return robust_notes(made), summary | {"scene": str(destination)}


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


def _rewrite(scene: Scene, keys: dict[str, float], destination: Path) -> None:
    """Write the user's scene with what the command line and the search changed."""
    try:
        rewrite_scene(scene.path, scene.overridden() | keys, destination)
    except ValueError as error:
        raise InputError(str(error)) from error


def _draw_search(
    scene: Scene,
    folder: Path,
    before: Statics,
    after: Statics,
    name: str,
    found: optimise.SearchResult,
    baseline: optimise.SearchResult,
) -> None:
    """What became better, and how fast."""
    old, new = (static_dataset(each.model, each.cycle, each.law) for each in (before, after))
    figure = pictures.before_after(old, new, _title(scene))
    pictures.save(figure, pictures.before_after_columns(old, new), folder, "before_after")
    traces = {name: found.values, "differential evolution": baseline.values}
    unit = objective_of(scene)[1]
    figure = pictures.search_trace(traces, unit, _title(scene))
    pictures.save(figure, pictures.search_trace_columns(traces, unit), folder, "search")


def _judged(statics: Statics, objective: float) -> dict[str, float]:
    """Objective with exact contact over all torques, and what changed at the scene's torque."""
    names = ("te_mean_um", "te_rms_um", "te_peak_to_peak_um", "max_line_load_N_mm")
    names += "max_pressure_MPa", "face_load_factor"
    numbers = {name: float(statics.numbers[name]) for name in names}
    return {"objective": objective} | numbers


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
