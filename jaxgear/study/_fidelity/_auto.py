"""`model.fidelity = "auto"`: a short comparison chooses the model that a command then runs with.

What was chosen may be kept in a file, under a hash of the scene: the next command on the same scene
does not pay for it again.
"""

import hashlib
import importlib.metadata
import json
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from jaxgear._whole_file import write_json
from jaxgear.scene._scene import Scene
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.scene._tables import SweepKeys
from jaxgear.study._built import built_scene
from jaxgear.study._fidelity._choice import judged_by
from jaxgear.study._fidelity._compare import PERIODS
from jaxgear.study._fidelity._engine import Comparison, compared
from jaxgear.study._fidelity._level import NOTHING, Changes, Level
from jaxgear.study._fidelity._levels import BY_BALANCE, OF_BALANCE, Hierarchy
from jaxgear.study._fidelity._moving import BodiesProblem, MethodsProblem
from jaxgear.study._fidelity._statics import StaticProblem, Work
from jaxgear.study._objectives import over_speeds
from jaxgear.study._result import Summary
from jaxgear.study._search_checks import require_searchable
from jaxgear.study._statics import SolverFailure

_KEY = "model.fidelity"
# Raised whenever the same scene would be given another level than before.
_VERSION = 2
# Speeds, and steps of the reference of rigid bodies: a choice must cost less than what it saves.
_SPEEDS, _STEPS = 8, 512


def chosen(scene: Scene, command: str, memory: Path | None = None) -> tuple[Scene, Summary]:
    """The scene at the cheapest fidelity that suffices for a command, and why.

    **Arguments:**

    - `scene`: with `model.fidelity = "auto"`.
    - `command`: `run`, `map`, `optimise` or `sweep`.
    - `memory`: a file of what was chosen before; without it the comparison is always made.

    **Returns:**

    The scene with the level's keys, without bodies; and the `fidelity` part of the summary.
    """
    moving = in_motion(scene.optimise, scene.sweep, command)
    # What [optimise] asks for is part of `run` too.
    searched = command in ("run", "optimise") and scene.optimise.is_given
    if searched:
        # What is refused anyway costs no wait.
        require_searchable(scene)
    work: Work = "map" if command == "map" else "optimise" if searched else "run"
    given = scene.values, scene.given, scene.files
    key, kept = digest(*given, "sweep" if moving else work), _read(memory)
    about = known = kept.get(key)
    if about is None:
        start = time.perf_counter()
        # Levels do not differ by the length of a cycle.
        long = scene.mesh.periods > PERIODS
        short = scene.replace({"mesh.periods": 1}) if long else scene
        try:
            own = scene if scene.condensed else short
            about = _in_motion(own) if moving else _at_rest(short, work)
        except SolverFailure as error:
            why = f"There was nothing to compare with: {str(error).rstrip('.')}."
            about = _as_given(scene.compare.tolerance, why)
        about["seconds"] = time.perf_counter() - start
        if memory is not None:
            write_json({**kept, key: about}, memory)
    changes = about["changes"]
    said = {name: "left out" if value is None else value for name, value in changes.items()}
    about = about | {"changes": said, "from_cache": known is not None}
    return scene.changed({**changes, _KEY: "as given"}), about


def told(summary: Summary, about: Summary) -> Summary:
    """A command's summary with what was chosen by `chosen`, and a note."""
    note = f'model.fidelity = "auto" took the level "{about["rung"]}". {about["why"]}'
    return summary | {"fidelity": about, "notes": [*summary.get("notes", []), note]}


def in_motion(asked: OptimiseKeys, sweep: SweepKeys, command: str) -> bool:
    """Whether a command asks for responses in motion: then these decide, and not statics."""
    swept = sweep.is_given
    if command == "optimise":
        return swept and bool(over_speeds(asked))
    return command == "sweep" or (command == "run" and swept)


def digest(
    said: Mapping[str, Any], given: Collection[str], files: Mapping[str, Path], work: str
) -> str:
    """Hash of what a choice depends on: values, what is given, files, the work, the version."""
    values = {key: x for key, x in said.items() if key not in (_KEY, "cite", "name")}
    contents = {
        key: hashlib.sha256(path.read_bytes()).hexdigest()
        for key, path in files.items()
        if path.is_file()
    }
    whole = {
        "values": values,
        "tables": sorted(given),
        "files": contents,
        "work": work,
        "version": [_VERSION, importlib.metadata.version("jaxgear")],
    }
    text = json.dumps(whole, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _read(file: Path | None) -> Mapping[str, Summary]:
    """What was chosen before; nothing where the file is missing or spoilt."""
    try:
        found = {} if file is None else json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _at_rest(scene: Scene, work: Work) -> Summary:
    """The choice by the quasi-static cycle."""
    levels = Hierarchy(scene).static(few=True)
    problem = StaticProblem(scene, work=work, levels=levels, quick=True)
    found = compared(problem, "compare statics")
    changes = found.chosen.changes if found.chosen else NOTHING
    return _about(found, changes, "of the quasi-static cycle")


def _in_motion(scene: Scene) -> Summary:
    """The choice by responses in motion, at a few speeds."""
    scene = built_scene(scene, moving=True).scene
    if scene.mesh.periods > PERIODS:
        # A shorter cycle would be another body's: holes come again after many periods.
        why = "Models with condensed bodies are compared over few mesh periods."
        return _as_given(scene.compare.tolerance, why)
    hierarchy = Hierarchy(scene)
    if scene.condensed:
        problem = BodiesProblem(scene, hierarchy.able(hierarchy.few()), speeds=_SPEEDS)
    else:
        levels = hierarchy.able(hierarchy.moving())
        problem = MethodsProblem(scene, levels, speeds=_SPEEDS, steps=_STEPS)
    found = compared(problem, "fidelity")
    changes = changes_in_motion(scene.sweep, found.chosen) if found.chosen else NOTHING
    return _about(found, changes, "in motion")


def changes_in_motion(asked: SweepKeys, level: Level) -> Changes:
    """Keys of the scene that make a level of it, by harmonic balance where it is that."""
    balanced = asked.method in BY_BALANCE and level.method is None
    gone = set() if balanced else OF_BALANCE
    return {key: value for key, value in level.changes.items() if key not in gone}


def _as_given(tolerance: float, why: str) -> Summary:
    """The `fidelity` part of the summary where nothing could be chosen."""
    return {
        "rung": "as given",
        "changes": {},
        "why": f"{why} So the scene was taken as it is given.",
        "errors": {},
        "tolerance": tolerance,
        "within_tolerance": False,
    }


def _about(found: Comparison, changes: Changes, of: str) -> Summary:
    """The `fidelity` part of the summary."""
    line = found.choice.line
    best = found.summary["rungs"][0] if line is None else line
    none = " So the scene was taken as it is given." if line is None else ""
    return {
        "rung": "as given" if line is None or not changes else line["name"],
        "changes": dict(changes),
        "why": f"By a comparison {of}: {found.summary['words']}{none}",
        "errors": judged_by(best),
        "errors_elsewhere": best.get("held_out"),
        "tolerance": found.summary["tolerance"],
        "within_tolerance": line is not None,
        "time_s": best["time_s"],
    }
