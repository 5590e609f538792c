"""The commands: each writes what a study found into the folder of its results."""

import dataclasses
from collections.abc import Callable

from jaxgear import study
from jaxgear._cli._folder import REPORT, Folder
from jaxgear._cli._writing import written
from jaxgear._whole_file import write_text
from jaxgear.report import report
from jaxgear.scene._scene import Scene
from jaxgear.study._result import Summary

# Names of public studies, each imported when it is called.
_STUDIES = {
    "run": "run",
    "map": "relief_map",
    "optimise": "optimise",
    "sweep": "sweep",
    "modes": "modes",
    "check-grad": "check_gradients",
    "sensitivity": "sensitivity",
    "compare": "compare",
    "condense": "condense",
}
# Those that go on after a kill, and those before which a scene may leave the model to the program.
_REMEMBERING = ("run", "optimise")
_AT_FIDELITY = ("run", "map", "optimise", "sweep")


def _command(command: str) -> Callable[[Scene, Folder], Summary]:
    def run(scene: Scene, folder: Folder) -> Summary:
        # A study may keep there what it goes on with after a kill.
        memory = folder.kept(".")
        kept = (memory,) if command in _REMEMBERING else ()
        find = lambda scene: getattr(study, _STUDIES[command])(scene, *kept)
        loaded = scene.pair.torque_pinion_Nm != 0.0
        if command not in _AT_FIDELITY or scene.model.fidelity != "auto" or not loaded:
            result = find(scene)
        else:
            from jaxgear.study._fidelity import _auto

            scene, about = _auto.chosen(scene, command, memory / "fidelity.json")
            result = find(scene)
            told = _auto.told(result.summary, about)
            result = dataclasses.replace(result, summary=told)
        summary = written(result, folder)
        write_text(report(folder / ".", command), folder / REPORT)
        return summary

    return run


COMMANDS = {name: _command(name) for name in _STUDIES}
