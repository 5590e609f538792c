"""The commands: each turns a good scene into a results folder and a summary."""

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from jaxgear import study
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._cli._writing import finish, written
from jaxgear._interface._laws import ExactContact
from jaxgear._whole_file import write_csv
from jaxgear.plot._plots import (
    sensitivity_pictures,
)
from jaxgear.scene._build import smooth_law_of
from jaxgear.scene._scene import Scene
from jaxgear.study._gradients import dynamic_table, gradient_table
from jaxgear.study._head import names_of
from jaxgear.study._modes import modes
from jaxgear.study._notes import steady_notes
from jaxgear.study._optimising import optimise
from jaxgear.study._progress import built_scene, progress
from jaxgear.study._relief_map import relief_map
from jaxgear.study._result import Result, Summary, title_of
from jaxgear.study._run import run
from jaxgear.study._sweep import sweep

Command = Callable[[Scene, Folder], Summary]


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

    def at_fidelity(scene: Scene, folder: Folder) -> Summary:
        if scene["model.fidelity"] != "auto":
            return command(scene, folder)
        from jaxgear.study._fidelity import _auto

        scene, about = _auto.chosen(scene, name, folder.kept("fidelity.json"))
        summary = _auto.told(command(scene, folder), about)
        write_json(summary, folder / "summary.json")
        return summary

    return at_fidelity


def _study(found: Callable[[Scene], Result]) -> Command:
    """A command that writes what a study found."""
    return lambda scene, folder: written(found(scene), folder)


def _remembering(found: Callable[[Scene, Path], Result]) -> Command:
    """A command whose searches, if they are killed, are gone on with in the common folder."""
    return lambda scene, folder: written(found(scene, folder.kept(".")), folder)


COMMANDS: dict[str, Command] = {
    "run": _at_fidelity("run", _remembering(run)),
    "map": _at_fidelity("map", _study(relief_map)),
    "optimise": _at_fidelity("optimise", _remembering(optimise)),
    "sweep": _at_fidelity("sweep", _study(sweep)),
    "modes": _study(modes),
    "check-grad": check_gradients,
    "sensitivity": sensitivity,
    "compare": _study(lambda scene: study.compare(scene)),
    "condense": condense,
}
