"""What a run of a scene is: its mesh cycle, and whatever else the scene asks for."""

from pathlib import Path

import numpy as np

from jaxgear.scene._build import couples_on_pinion
from jaxgear.scene._gear_tables import PairKeys, ShaftKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._study_tables import MapKeys
from jaxgear.study._body_surfaces import body_sections
from jaxgear.study._built import BuiltScene, built_scene
from jaxgear.study._dynamics import fastest, solve_dynamics
from jaxgear.study._head import head, names_of, study
from jaxgear.study._no_load import no_load
from jaxgear.study._optimising import optimisation
from jaxgear.study._pair_dataset import (
    axes_dataset,
    modification_dataset,
    pair_dataset,
    sliding_dataset,
)
from jaxgear.study._progress import narration, progress
from jaxgear.study._result import Result, titled, together
from jaxgear.study._results import dataset_of, over, static_dataset
from jaxgear.study._search_checks import require_searchable
from jaxgear.study._shafts import shafts_dataset
from jaxgear.study._sizing import combinations_of, sizing_summary, sizing_table
from jaxgear.study._statics import Statics, solve_statics, torques_of
from jaxgear.study._sweep import sweep_result


@study
def statics(scene: Scene) -> Result:
    """A quasi-static mesh cycle: transmission error, stiffness, loads, sliding, shafts, bodies.

    **Arguments:**

    - `scene`: checked against the schema.

    **Returns:**

    The dataset of the cycle, groups `pair`, `axes`, `sliding`, `modification`, with
    `mesh.root_stress` `roots`, with bearings `shafts`, and `pinion_deflected` and
    `wheel_deflected` of condensed bodies; the summary. At torque 0 the transmission error of
    rigid gears, with `pair`, `axes` and `modification`.

    **Raises:**

    - `ValueError` if the gears are impossible.
    - `SolverFailure` if a contact problem was not solved.
    """
    if scene.plain.pair.torque_pinion_Nm == 0.0:
        return no_load(scene)
    built = built_scene(scene)
    return statics_result(built, *solved(built))


@study
def sizing(scene: Scene) -> Result:
    """Every combination of the amounts in [sizing], at every torque, the best first.

    Arguments and errors as for `statics`.

    **Returns:**

    The dataset `sizing`, and the summary.
    """
    found = sizing_result(built_scene(scene))
    return Result(found.scene, names_of(scene.name, scene.cite) | found.summary, found.datasets)


@study
def run(scene: Scene, memory: Path | None = None) -> Result:
    """All that a scene asks for: statics, and where it has their tables sweep, sizing and search.

    **Arguments:**

    - `scene`: checked against the schema.
    - `memory`: a folder for what a search that is killed has found: the next one goes on from it.

    **Returns:**

    The datasets and the summaries of `statics`, `sweep`, `sizing` and `optimise`; one model is
    solved for all of them. At torque 0 those of `statics` alone.

    **Raises:**

    As these.
    """
    if scene.plain.pair.torque_pinion_Nm == 0.0:
        return no_load(scene)
    built = built_scene(scene)
    # Impossible gears and endless searches are refused before anything is compiled.
    _ = built.model
    if scene.optimise.is_given:
        require_searchable(built.scene)
    found, torques = solved(built)
    result = statics_result(built, found, torques)
    if scene.sweep.is_given:
        result = together(result, sweep_result(built, solve_dynamics(built)))
    if scene.sizing.is_given:
        result = together(result, sizing_result(built))
    if scene.optimise.is_given:
        result = together(result, optimisation(built, found, torques, memory))
    return result


def solved(built: BuiltScene) -> tuple[Statics, np.ndarray]:
    """The mesh cycle of a scene with its bodies, and the torques of the Harris map [N m]."""
    with narration("mesh cycle"):
        scene = built.scene
        torques = _harris_torques(scene.map, scene.pair, scene.pinion.shaft)
        return solve_statics(built, torques), torques


def statics_result(built: BuiltScene, statics: Statics, torques: np.ndarray) -> Result:
    """Datasets and summary of a solved mesh cycle, with the torques of the Harris map [N m]."""
    scene, model, summary, files = built.scene, statics.model, head(built, statics), {}
    static = summary["static"]
    efficiency, friction = static["mesh_efficiency"], static["friction_coefficient"]
    groups = {
        "pair": pair_dataset(model.pair),
        "axes": axes_dataset(model.pair),
        "sliding": sliding_dataset(
            model.pair,
            efficiency,
            friction,
            # That at which condensed bodies grow, where no sweep says one.
            fastest(scene.sweep) or (scene.mesh.pinion_speed_rad_s if scene.condensed else None),
        ),
    }
    if not scene.optimise.is_given:
        # A search shows them beside those that it finds.
        groups["modification"] = modification_dataset({"given": (model.pair, model.flanks)})
    if static["bearings"]:
        sections = body_sections(scene.bodies)
        groups["shafts"] = shafts_dataset(model, statics.cycle, static["bearings"], sections)
    if scene.mesh.root_stress and statics.influences is not None:
        from jaxgear.study import _roots

        with narration("roots"):
            groups["roots"] = _roots.roots_dataset(model, statics.cycle, statics.influences)
        summary["roots"] = _roots.roots_summary(scene.gears, statics, groups["roots"])
    cycle = static_dataset(model, statics.cycle, statics.law)
    error = statics.harris, "transmission error over torque and phase"
    harmonics = statics.harris_harmonics, "amplitudes of its mesh harmonics"
    harris = dataset_of(
        over("torque phase", harris_te_um=error)
        | over("torque harmonic", harris_te_harmonic_um=harmonics),
        **over("torque", torque_Nm=(torques, "torque on the pinion")),
    )
    cycle = cycle.assign_coords(harris.coords).assign(harris.data_vars)
    if scene.bodies:
        from jaxgear.study import _body_answers, _body_fields, _hybrid_dataset

        with narration("bodies") as tell:
            answers = _body_answers.body_answers(scene.mesh, scene.bodies, statics, tell)
            cycle = _hybrid_dataset.hybrid_variables(cycle, answers)
            static |= _hybrid_dataset.hybrid_summary(cycle, answers)
            for answer in answers:
                if answer.fields:
                    name = f"{answer.gear}_deflected"
                    groups[name] = _body_fields.fields_dataset(answer)
                    files[f"{name}.vtu"] = _body_fields.grid_writer(answer)
    if scene.mesh.body_stress:
        from jaxgear.study import _stress_maps

        with narration("stresses") as tell:
            maps = _stress_maps.stress_maps(scene.mesh, scene.bodies, statics, tell)
        static["body_stress"] = _stress_maps.stress_summary(maps)
        for gear, found in maps.items():
            groups[f"{gear}_stress"] = _stress_maps.stress_dataset(gear, found)
            files[f"{gear}_stress.vtu"] = _stress_maps.stress_writer(found)
    if scene.gauges:
        from jaxgear.study._gauges import gauges_dataset, gauges_summary

        with narration("gauges"):
            groups["gauges"] = gauges_dataset(scene.mesh, scene.gauges, scene.bodies, statics)
        static["gauges"] = gauges_summary(groups["gauges"])
    named = {name: titled(each, scene.title) for name, each in ({"": cycle} | groups).items()}
    return Result(scene, summary, named, files)


def _harris_torques(asked: MapKeys, pair: PairKeys, shaft: ShaftKeys) -> np.ndarray:
    """Torques of the Harris map: given, or from a quarter of the mesh's to half as much again."""
    if asked.torques_Nm is not None:
        return torques_of("map", asked.torques_Nm, pair, shaft)
    torque, couples = abs(pair.torque_pinion_Nm), couples_on_pinion(shaft, pair.sense)
    on_mesh = torque + couples
    least = max(0.25 * on_mesh - couples, 0.05 * torque)
    return np.linspace(least, 1.5 * on_mesh - couples, 6)


def sizing_result(built: BuiltScene) -> Result:
    """The table of a scene's [sizing]."""
    scene = built.scene
    with progress(len(combinations_of(scene.sizing)[1]), "sizing") as done:
        table = sizing_table(built, done)
    torques = table["torque_pinion_Nm"].values
    several = f"{len(torques)} torques up to " if len(torques) > 1 else ""
    table = table.assign_attrs(title=f"{scene.name}, {several}{max(torques):g} N m")
    return Result(
        scene,
        {"sizing": sizing_summary(table, symmetric=scene.sizing.symmetric)},
        {"sizing": table},
    )
