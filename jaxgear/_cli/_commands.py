"""The commands: each turns a good scene into a results folder and a summary."""

from collections.abc import Callable
from functools import partial

import numpy as np
import xarray as xr

from jaxgear import study
from jaxgear._checks import InputError
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._cli._writing import finish, written
from jaxgear._units import um
from jaxgear.plot import _dynamic_tables as dynamic_tables
from jaxgear.plot import _tables as tables
from jaxgear.plot._axes_tables import axes_columns
from jaxgear.plot._modification_tables import draw_modification
from jaxgear.plot._plots import (
    axes_pictures,
    dynamic_pictures,
    pictures,
    sliding_pictures,
)
from jaxgear.plot._sliding_tables import sliding_columns
from jaxgear.scene._build import couples_on_pinion, model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import KEYS, general
from jaxgear.study._body_surfaces import body_sections
from jaxgear.study._design import (
    refuse_unbounded,
    require_search,
    require_swept,
)
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
from jaxgear.study._gradients import check_gradients
from jaxgear.study._head import head
from jaxgear.study._modes import modes
from jaxgear.study._notes import sweep_notes
from jaxgear.study._optimising import optimisation, optimise_flanks
from jaxgear.study._progress import built_scene, narration, progress
from jaxgear.study._relief_map import map_relief
from jaxgear.study._result import Result, Summary, title_of
from jaxgear.study._results import static_dataset, write_dataset
from jaxgear.study._sensitivities import sensitivity
from jaxgear.study._sizing import (
    combinations_of,
    sizing_columns,
    sizing_summary,
    sizing_table,
)
from jaxgear.study._statics import (
    Statics,
    solve_statics,
    torques_of,
)

Command = Callable[[Scene, Folder], Summary]


def run(scene: Scene, folder: Folder) -> Summary:
    """Geometry, a quasi-static mesh cycle and, where asked for, sizing table and optimisation.

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
    # Impossible gears and endless searches are refused before any bar is drawn.
    model_of(scene)
    if scene.has_table("optimise"):
        refuse_unbounded(scene, tuple(scene["optimise.vary"]))
        require_swept(scene)
        require_search(scene)
    with narration("mesh cycle"):
        torques = _harris_torques(scene)
        statics = solve_statics(scene, torques)
        dataset = static_dataset(statics.model, statics.cycle, statics.law)
        about = {"units": "N m", "long_name": "torque on the pinion"}
        dataset = dataset.assign_coords(torque_Nm=("torque", torques, about))
        about = {"units": "um", "long_name": "transmission error over torque and phase"}
        dataset["harris_te_um"] = (("torque", "phase"), statics.harris / um, about)
        about = {"units": "um", "long_name": "amplitudes of its mesh harmonics"}
        harmonics = statics.harris_harmonics / um
        dataset["harris_te_harmonic_um"] = (("torque", "harmonic"), harmonics, about)
        summary = head(scene, statics)
        if scene.bodies:
            dataset, found = _on_bodies(scene, statics, dataset, folder)
            summary["static"] |= found
        _draw_statics(folder, scene, statics, dataset, summary["static"])
    groups = {}
    if scene.has_table("sweep"):
        dynamics = solve_dynamics(scene)
        found, groups = _sweep(scene, dynamics, folder)
        summary["notes"] += found.pop("notes")
        summary |= found
    write_dataset(dataset, folder / "result.nc", groups)
    if scene.has_table("sizing"):
        summary |= _sizing(scene, statics, folder)
    if scene.has_table("optimise"):
        found = optimisation(scene, statics, folder, torques)
        summary["notes"] += found.pop("notes")
        summary |= found
    return finish(scene, folder, summary)


def _on_bodies(
    scene: Scene, statics: Statics, dataset: xr.Dataset, folder: Folder
) -> tuple[xr.Dataset, Summary]:
    """Draw what condensed bodies do, and add it to the dataset; what they do to the summary."""
    from jaxgear.plot import _hybrid_tables
    from jaxgear.study import _hybrid, _hybrid_dataset

    with narration("bodies") as tell:
        answers = _hybrid.body_answers(scene, statics, tell)
        dataset = _hybrid_dataset.hybrid_variables(dataset, answers)
        tell("drawing")
        _hybrid_tables.draw(folder, title_of(scene), dataset, answers)
    return dataset, _hybrid_dataset.hybrid_summary(dataset, answers)


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


COMMANDS: dict[str, Command] = {
    "run": _at_fidelity("run", run),
    "map": _at_fidelity("map", map_relief),
    "optimise": _at_fidelity("optimise", optimise_flanks),
    "sweep": _at_fidelity("sweep", sweep_speeds),
    "modes": _study(modes),
    "check-grad": _study(check_gradients),
    "sensitivity": _study(sensitivity),
    "compare": compare,
    "condense": _study(lambda scene: study.condense(scene)),
}


def _harris_torques(scene: Scene) -> np.ndarray:
    """Torques of the Harris map: given, or from a quarter of the mesh's to half as much again."""
    if scene.get("map.torques_Nm") is not None:
        return torques_of(scene, "map.torques_Nm")
    torque, couples = scene["pair.torque_pinion_Nm"], couples_on_pinion(scene)
    on_mesh = torque + couples
    least = max(0.25 * on_mesh - couples, 0.05 * torque)
    return np.linspace(least, 1.5 * on_mesh - couples, 6)


def _draw_statics(
    folder: Folder,
    scene: Scene,
    statics: Statics,
    dataset: xr.Dataset,
    static: Summary,
) -> None:
    """The pictures of one mesh cycle."""
    model, title, bearings = statics.model, title_of(scene), static["bearings"]
    save(
        partial(pictures.gear_pair, model, title),
        tables.gear_pair_columns(model),
        folder,
        "gear_pair",
    )
    figure = partial(axes_pictures.axes, model.pair, title)
    save(figure, axes_columns(model.pair), folder, "axes")
    if not scene.has_table("optimise"):
        # A search draws them beside those that it finds.
        draw_modification({"given": model}, title, folder)
    data, speed = sliding_columns(model.pair), _told_speed(scene)
    figure = partial(sliding_pictures.sliding, data, dataset, static, title, pinion_speed=speed)
    save(figure, data, folder, "sliding")
    figure = partial(pictures.transmission_error, dataset, title)
    columns = tables.transmission_error_columns(dataset)
    harmonics = tables.te_harmonics_columns(dataset)
    save(figure, columns, folder, "transmission_error", harmonics=harmonics)
    figure = partial(pictures.stiffness_and_sharing, dataset, title)
    columns, pairs = tables.mesh_stiffness_columns(dataset), tables.load_sharing_columns(dataset)
    save(figure, columns, folder, "mesh_stiffness", tooth_pairs=pairs)
    for name, draw, columns in (
        ("flank_maps", pictures.flank_maps, tables.flank_maps_columns),
        ("face_load", pictures.face_load, tables.face_load_columns),
    ):
        save(partial(draw, dataset, title), columns(dataset), folder, name)
    weight = dataset["weight"].values
    torques, phase, error = (
        dataset[name].values for name in ("torque_Nm", "phase", "harris_te_um")
    )
    figure = partial(pictures.harris_map, torques, phase, error, title, weight=weight)
    columns = tables.harris_map_columns(torques, phase, error, weight=weight)
    curves = tables.harris_curves_columns(torques, phase, error)
    save(figure, columns, folder, "harris_map", curves=curves)
    figure = partial(pictures.te_spectrum, torques, phase, error, title, weight=weight)
    columns = tables.te_spectrum_columns(torques, phase, error, weight=weight)
    save(figure, columns, folder, "te_spectrum")
    if bearings:
        sections = body_sections(scene)
        figure = partial(pictures.shafts, model, statics.cycle, bearings, title, sections)
        columns = tables.shafts_columns(model, statics.cycle)
        rows = tables.bearing_columns(model, bearings)
        save(figure, columns, folder, "shafts", bearings=rows)


def _told_speed(scene: Scene) -> float | None:
    """The highest speed of the sweep, or that at which condensed bodies grow [rad/s]."""
    if scene.has_table("sweep"):
        return float(np.max(speeds_of(scene)))
    return scene.get("mesh.pinion_speed_rad_s") if scene.condensed else None


def _sizing(scene: Scene, statics: Statics, folder: Folder) -> Summary:
    """Every combination of the listed amounts: table, picture and the best of it."""
    count = len(combinations_of(scene)[1])
    with progress(count, "sizing") as done:
        table = sizing_table(scene, statics.grid, done)
    labels = [_amount_label(scene, key) for key in table.keys]
    error, pressure = (table.responses[name] for name in ("te_peak_to_peak_um", "max_pressure_MPa"))
    several = f"{len(table.torques)} torques up to " if len(table.torques) > 1 else ""
    title = f"{scene['name']}, {several}{max(table.torques):g} N m"
    figure = partial(pictures.sizing, labels, table.amounts, table.torques, error, pressure, title)
    save(figure, sizing_columns(table), folder, "sizing")
    return {"sizing": sizing_summary(scene, table)}


def _amount_label(scene: Scene, key: str) -> str:
    """A key of a flank as an axis names it."""
    _, gear, name = key.split(".", 2)
    unit = KEYS[general(key)].unit.replace("um", "µm") or "-"
    return f"{'both' if scene['sizing.symmetric'] else gear}: {name} [{unit}]"
