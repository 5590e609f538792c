"""The commands: each writes what a study found into the folder of its results."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path

from jaxgear import study
from jaxgear._cli._folder import Folder
from jaxgear._cli._writing import written
from jaxgear.scene._scene import Scene
from jaxgear.study._result import Result, Summary

# A study as a command calls it, and where it may keep what it goes on with after a kill.
Found = Callable[[Scene, Path], Result]
Command = Callable[[Scene, Folder], Summary]


def _plain(name: str) -> Found:
    """A public study by its name, imported when it is called."""
    return lambda scene, memory: getattr(study, name)(scene)


def _remembering(name: str) -> Found:
    """A study that goes on after a kill."""
    return lambda scene, memory: getattr(study, name)(scene, memory)


def _at_fidelity(command: str, found: Found) -> Found:
    """A study before which the model is chosen, where the scene leaves it to the program."""

    def at_fidelity(scene: Scene, memory: Path) -> Result:
        if scene.model.fidelity != "auto":
            return found(scene, memory)
        from jaxgear.study._fidelity import _auto

        scene, about = _auto.chosen(scene, command, memory / "fidelity.json")
        result = found(scene, memory)
        return dataclasses.replace(result, summary=_auto.told(result.summary, about))

    return at_fidelity


def _writing(found: Found) -> Command:
    """A command that writes what a study found."""
    return lambda scene, folder: written(found(scene, folder.kept(".")), folder)


_STUDIES: Mapping[str, Found] = {
    "run": _at_fidelity("run", _remembering("run")),
    "map": _at_fidelity("map", _plain("relief_map")),
    "optimise": _at_fidelity("optimise", _remembering("optimise")),
    "sweep": _at_fidelity("sweep", _plain("sweep")),
    "modes": _plain("modes"),
    "check-grad": _plain("check_gradients"),
    "sensitivity": _plain("sensitivity"),
    "compare": _plain("compare"),
    "condense": _plain("condense"),
}
COMMANDS: dict[str, Command] = {name: _writing(found) for name, found in _STUDIES.items()}
