"""The commands: each turns a good scene into a results folder and a summary."""

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
import xarray as xr

from jaxgear._checks import InputError
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._cli._writing import finish, told, written
from jaxgear._interface._laws import ExactContact
from jaxgear._whole_file import write_csv, write_dataset
from jaxgear.plot import _dynamic_tables as dynamic_tables
from jaxgear.plot._plots import (
    dynamic_pictures,
    sensitivity_pictures,
)
from jaxgear.scene._build import model_of, smooth_law_of
from jaxgear.scene._scene import Scene
from jaxgear.study._dynamics import (
    Dynamics,
    Sweep,
    damping_summary,
    directions_of,
    drawn_sweep,
    marked,
    orbit_dataset,
    pieces_lost,
    require_damped,
    solve_dynamics,
    speeds_of,
    sweep_dataset,
    sweep_of,
    sweep_summary,
    way_of,
)
from jaxgear.study._gradients import dynamic_table, gradient_table
from jaxgear.study._head import finished, head, names_of
from jaxgear.study._modes import modes
from jaxgear.study._notes import steady_notes, sweep_notes
from jaxgear.study._optimising import optimisation, optimise
from jaxgear.study._progress import built_scene, narration, progress
from jaxgear.study._relief_map import relief_map
from jaxgear.study._result import Result, Summary, title_of
from jaxgear.study._run import run_of, sizing_result
from jaxgear.study._statics import (
    Statics,
)

Command = Callable[[Scene, Folder], Summary]


def run(scene: Scene, folder: Folder) -> Summary:
    """Geometry, a quasi-static mesh cycle and, where asked for, sweep, sizing and optimisation.

    **Arguments:**

    - `scene`: checked against the schema.
    - `folder`: for the results; exists.

    **Returns:**

    The summary that is also in `summary.json`.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved.
    """
    scene = built_scene(scene)
    model_of(scene)
    if scene.has_table("optimise"):
        # Endless searches are refused before any bar is drawn.
        refuse_unbounded(scene, tuple(scene["optimise.vary"]))
        require_swept(scene)
        require_search(scene)

    def swept(scene: Scene, statics: Statics, torques: np.ndarray) -> Result:
        return Result(scene, *_sweep(scene, solve_dynamics(scene), folder))

    def sized(scene: Scene, statics: Statics, torques: np.ndarray) -> Result:
        return sizing_result(scene, statics.grid)

    def searched(scene: Scene, statics: Statics, torques: np.ndarray) -> Result:
        return Result(scene, optimisation(scene, statics, folder, torques))

    result = run_of(scene, (("sweep", swept), ("sizing", sized), ("optimise", searched)))
    return written(dataclasses.replace(result, summary=finished(scene, result.summary)), folder)


def sweep_speeds(scene: Scene, folder: Folder) -> Summary:
    """Steady responses over the speeds of [sweep], in its directions, and round their folds.

    Arguments, results and errors as for `run`.
    """
    scene = built_scene(scene, moving=True)
    with narration("mesh cycle"):
        dynamics = solve_dynamics(scene)
    summary = head(scene, dynamics.statics)
    found, groups = _sweep(scene, dynamics, folder)
    write_dataset(xr.Dataset(), folder / "result.nc", groups)
    summary["notes"] += found.pop("notes")
    return finish(scene, folder, summary | found)


def _sweep(
    scene: Scene, dynamics: Dynamics, folder: Folder
) -> tuple[Summary, dict[str, xr.Dataset]]:
    """Sweep, draw what was found, and return its part of the summary, and datasets by name."""
    require_damped(scene, dynamics)
    watch = _wave_watch(scene, dynamics)
    count = len(speeds_of(scene)) * len(directions_of(scene))
    with progress(count, "sweep") as done:
        found = sweep_of(scene, dynamics.pair, done)
    model = dynamics.statics.model
    dataset = sweep_dataset(dynamics.pair, model, found)
    with narration("sweep"):
        _draw_sweep(folder, scene, dynamics, found, dataset)
    remarks = sweep_notes(scene, found.unsettled, count, list(pieces_lost(found)))
    summary = {
        "damping": damping_summary(scene, dynamics),
        "sweep": sweep_summary(scene, dynamics, found, dataset),
        "notes": remarks,
    }
    groups = {"sweep": dataset}
    if watch is not None:
        from jaxgear.plot import _wave_tables
        from jaxgear.study import _body_waves

        with narration("waves") as tell:
            groups["waves"] = _body_waves.waves_dataset(watch, found)
            summary["sweep"]["waves"] = _body_waves.waves_summary(watch, groups["waves"])
            _wave_tables.draw(folder, title_of(scene), watch, groups["waves"], tell)
    return summary, groups


def _wave_watch(scene: Scene, dynamics: Dynamics):
    """What looks at the waves of condensed bodies in a sweep; None where there are none."""
    if not dynamics.pair.bodies:
        if scene.rows("probes"):
            raise InputError("probes: they look at condensed bodies, of which this scene has none.")
        return None
    from jaxgear.study import _body_waves

    with narration("probes") as tell:
        return _body_waves.wave_watch(scene, dynamics.pair, tell)


def _draw_sweep(
    folder: Folder, scene: Scene, dynamics: Dynamics, found: Sweep, dataset: xr.Dataset
) -> None:
    """The pictures of a sweep; those of one direction show the one with the highest peak."""
    title, model = title_of(scene), dynamics.statics.model
    critical, natural = marked(dynamics, model.pair.pinion.teeth)
    over = drawn_sweep(dataset)
    figure = partial(dynamic_pictures.sweep, over, title, critical)
    beside = {"critical": dynamic_tables.critical_columns(critical)}
    if "curve_speed" in over:
        beside["curve"] = dynamic_tables.curve_columns(over)
        beside["folds"] = dynamic_tables.fold_columns(over)
    save(figure, dynamic_tables.sweep_columns(over), folder, "sweep", **beside)
    own, title_of_way = dataset.sel(direction=found.main), title + way_of(found)
    figure = partial(dynamic_pictures.waterfall, own, title_of_way, natural)
    save(figure, dynamic_tables.waterfall_columns(own), folder, "waterfall")
    figure = partial(dynamic_pictures.orders, own, title_of_way)
    columns, beside = dynamic_tables.orders_columns(own), {}
    if "bearing_force_order_N" in own:
        beside["bearings"] = dynamic_tables.bearing_orders_columns(own)
    save(figure, columns, folder, "orders", **beside)
    figure = partial(dynamic_pictures.contact_loss, own, title_of_way)
    columns = dynamic_tables.contact_loss_columns(own)
    shares = dynamic_tables.contact_shares_columns(own)
    save(figure, columns, folder, "contact_loss", shares=shares)
    orbit = orbit_dataset(dynamics.pair, model, found)
    speed = float(found.speeds[found.highest(found.main)[1]])
    figure = partial(dynamic_pictures.orbit, orbit, f"{title}, {speed:.5g} rad/s")
    save(figure, dynamic_tables.orbit_columns(orbit), folder, "orbit")


def compare(scene: Scene, folder: Folder) -> Summary:
    """One scene by many models and methods: error against time, and which suffices.

    Arguments, results and errors as for `run`.
    """
    from jaxgear.study import _compare

    if scene.has_table("sweep"):
        scene = built_scene(scene, moving=True)
    return _compare.compare(scene, folder)


def check_gradients(scene: Scene, folder: Folder) -> Summary:
    """Compare every derivative that an optimiser may use with central differences.

    Arguments and results as for `run`.

    A derivative that is wrong is counted in `check_grad.verdicts.WRONG`.
    """
    scene = built_scene(scene)
    laws = {"exact": ExactContact(), "smooth": smooth_law_of(scene)}
    table, steady = [], []
    moving = scene.has_table("sweep")
    with progress(len(laws) + moving, "derivatives") as done:
        for name, law in laws.items():
            table += [(name, row) for row in gradient_table(scene, law)]
            done(1)
        if moving:
            rows, steady = dynamic_table(scene, laws)
            table += rows
            done(1)
    remarks = steady_notes(steady)
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
    summary = names_of(scene) | {
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
    return finish(scene, folder, summary)


def condense(scene: Scene, folder: Folder) -> Summary:
    """Build the condensed bodies of a scene and say how good they are.

    Arguments, results and errors as for `run`.
    """
    from jaxgear.study import _condense

    return _condense.condense(scene, folder)


def sensitivity(scene: Scene, folder: Folder) -> Summary:
    """Find what the responses of a scene react to, and how strongly.

    Arguments, results and errors as for `run`.
    """
    from jaxgear.study import _sensitivities

    scene = built_scene(_sensitivities.with_own_modulus(scene))
    moving, remarks = scene.has_table("sweep"), []
    found = {}
    with progress(1 + moving, "derivatives") as done:
        found["sensitivity"] = _sensitivities.static_sensitivities(scene)
        done(1)
        if moving:
            steady, points = _sensitivities.moving_sensitivities(scene)
            remarks = steady_notes(points)
            if steady is not None:
                found["sensitivity_in_motion"] = steady
            done(1)
    if scene.condensed:
        remarks.append(_sensitivities.OF_BODIES)
    remarks += [words for each in found.values() for words in each.lost()]
    summary = names_of(scene) | {"notes": remarks}
    for name, each in found.items():
        acting = each.sorted()
        title = f"{title_of(scene)}: what the responses react to"
        save(
            partial(sensitivity_pictures.sensitivity, acting, title), acting.columns(), folder, name
        )
        summary[name] = acting.told()
    return finish(scene, folder, summary)


def _at_fidelity(name: str, command: Command):
    """A command that first chooses the model, where the scene leaves it to the program."""

    def chosen(scene: Scene, folder: Folder) -> Summary:
        if scene["model.fidelity"] != "auto":
            return command(scene, folder)
        from jaxgear.study import _fidelity

        scene, about = _fidelity.chosen(scene, name, folder)
        return _fidelity.told(command(scene, folder), about, folder)

    return chosen


def _study(found: Callable[[Scene], Result]) -> Command:
    """A command that writes what a study found."""
    return lambda scene, folder: written(found(scene), folder)


def _optimise(scene: Scene, folder: Folder) -> Summary:
    """The command `optimise`: what a search has found is kept in the folder of all commands."""
    return written(optimise(scene, folder.kept(".")), folder)


COMMANDS: dict[str, Command] = {
    "run": _at_fidelity("run", run),
    "map": _at_fidelity("map", _study(relief_map)),
    "optimise": _at_fidelity("optimise", _optimise),
    "sweep": _at_fidelity("sweep", sweep_speeds),
    "modes": _study(modes),
    "check-grad": check_gradients,
    "sensitivity": sensitivity,
    "compare": compare,
    "condense": condense,
}
