"""`model.fidelity = "auto"`: a short comparison chooses the model that a command then runs with.

What was chosen is kept in the folder of all commands' results, under a hash of the scene: the next
command on the same scene does not pay for it again.
"""

import hashlib
import importlib.metadata
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from jaxgear._cli._folder import Folder
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._whole_file import write_json
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._scene_files import files_of
from jaxgear.study import _compare
from jaxgear.study._compare_statics import (
    Work,
    changed,
    compared_statics,
    needs_its_slices,
    simpler_bodies,
    static_rungs,
    takes_away,
)
from jaxgear.study._ladder import Summary
from jaxgear.study._objectives import looks_at_speeds
from jaxgear.study._progress import built_scene, progress
from jaxgear.study._rungs import Rung
from jaxgear.study._search_checks import require_searchable
from jaxgear.study._statics import SolverFailure

KEY = "model.fidelity"
FILE = "fidelity.json"
# Raised whenever the same scene would be given another rung than before.
_VERSION = 2
# Speeds, and steps of the reference of rigid bodies: a choice must cost less than what it saves.
_SPEEDS, _PHASES = 8, 512


def chosen(scene: Scene, command: str, folder: Folder) -> tuple[Scene, Summary]:
    """The scene at the cheapest fidelity that suffices for a command, and why.

    **Arguments:**

    - `scene`: with `model.fidelity = "auto"`.
    - `command`: `run`, `map`, `optimise` or `sweep`.
    - `folder`: for the results; what was chosen before is looked for there.

    **Returns:**

    The scene with the rung's keys, without bodies; and the `fidelity` part of the summary.
    """
    moving = in_motion(scene, command)
    # What [optimise] asks for is part of `run` too.
    searched = command in ("run", "optimise") and scene.has_table("optimise")
    if searched:
        # What is refused anyway costs no wait.
        require_searchable(scene)
    work: Work = "map" if command == "map" else "optimise" if searched else "run"
    key = digest(scene, "sweep" if moving else work)
    kept = _read(folder.kept(FILE))
    start = time.perf_counter()
    known = kept.get(key)
    about: Summary = known or {}
    if known is None:
        try:
            if moving:
                about = _in_motion(scene)
            else:
                about = _at_rest(_short(scene), work)
        except SolverFailure as error:
            why = f"There was nothing to compare with: {str(error).rstrip('.')}."
            about = _as_given(scene, why)
        about["seconds"] = time.perf_counter() - start
        write_json(kept | {key: about}, folder.kept(FILE))
    changes = about["changes"]
    said = {name: "left out" if value is None else value for name, value in changes.items()}
    about = about | {"changes": said, "from_cache": known is not None}
    return changed(scene, {**changes, KEY: "as given"}), about


def _short(scene: Scene) -> Scene:
    """The scene over one mesh period, where its cycle is long: rungs do not differ by that."""
    return scene.replace({"mesh.periods": 1}) if scene["mesh.periods"] > _compare.PERIODS else scene


def _as_given(scene: Scene, why: str) -> Summary:
    """The `fidelity` part of the summary where nothing could be chosen."""
    return {
        "rung": "as given",
        "changes": {},
        "why": f"{why} So the scene was taken as it is given.",
        "errors": {},
        "tolerance": scene["compare.tolerance"],
        "within_tolerance": False,
    }


def in_motion(scene: Scene, command: str) -> bool:
    """Whether a command asks for responses in motion: then these decide, and not statics."""
    swept = scene.has_table("sweep")
    if command == "optimise":
        return swept and looks_at_speeds(scene)
    return command == "sweep" or (command == "run" and swept)


def told(summary: Summary, about: Summary, folder: Folder) -> Summary:
    """A command's summary with what was chosen, rewritten.

    **Arguments:**

    - `summary`: of the command.
    - `about`: from `chosen`.
    - `folder`: of the results.

    **Returns:**

    The summary with `fidelity`, and a note.
    """
    note = f'model.fidelity = "auto" took the rung "{about["rung"]}". {about["why"]}'
    summary = summary | {"fidelity": about, "notes": [*summary.get("notes", []), note]}
    write_json(summary, folder / "summary.json")
    return summary


def digest(scene: Scene, work: str) -> str:
    """Hash of what a choice depends on: the scene, the files it names, the work, the version."""
    values = {key: value for key, value in scene.values.items() if key not in (KEY, "cite", "name")}
    files = {
        key: hashlib.sha256(path.read_bytes()).hexdigest()
        for key, path in files_of(scene).items()
        if path.is_file()
    }
    whole = {
        "values": values,
        "tables": sorted(scene.given),
        "files": files,
        "work": work,
        "version": [_VERSION, importlib.metadata.version("jaxgear")],
    }
    text = json.dumps(whole, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _read(file: Path) -> dict[str, Summary]:
    """What was chosen before; nothing where the file is missing or spoilt."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _at_rest(scene: Scene, work: Work) -> Summary:
    """The choice by the quasi-static cycle."""
    rungs = static_rungs(scene, few=True)
    with progress(len(rungs) + 3, "fidelity") as done:
        found = compared_statics(
            scene, work=work, rungs=rungs, quick=True, tell=lambda step: done(1)
        )
    row = found.choice.row
    changes = {} if row is None else dict(found.rungs[row["name"]].changes)
    return _about(found.summary, row, changes, "of the quasi-static cycle")


def _in_motion(scene: Scene) -> Summary:
    """The choice by responses in motion, at a few speeds."""
    if not scene.condensed:
        scene = _short(scene)
    scene = built_scene(scene, moving=True)
    if scene["mesh.periods"] > _compare.PERIODS:
        # A shorter cycle would be another body's: holes come again after many periods.
        return _as_given(scene, "Models with condensed bodies are compared over few mesh periods.")
    if scene.condensed:
        from jaxgear.study import _compare_bodies

        rungs = _asked_for(scene, _compare_bodies.few_rungs(scene))
        found, tried = _compare_bodies.chart(scene, rungs=rungs, speeds=_SPEEDS)
    else:
        rungs, model = _asked_for(scene, moving_rungs(scene)), model_of(scene)
        found, tried = _compare.chart(scene, model, rungs, speeds=_SPEEDS, phases=_PHASES)
    rows = {row["name"]: row for row in found["rungs"]}
    name = found["recommended"]
    row = None if name is None else rows[name]
    changes = {} if row is None else changes_in_motion(scene, tried[row["name"]])
    return _about(found, row, changes, "in motion")


def _asked_for(scene: Scene, rungs: Sequence[Rung]) -> list[Rung]:
    """Of rungs in motion, the scene's own first, those that still do what the scene asks for."""
    watched = [f"{scene[f'{row}.gear']}.body.probes" for row in scene.rows("probes")]
    own = rungs[0]

    def is_able(rung: Rung) -> bool:
        if needs_its_slices(scene) and rung.slices != own.slices:
            return False
        # Another method of the user's is not overruled: only slices and bodies are chosen then.
        if not _by_balance(scene) and (rung.method, rung.phases) != (own.method, own.phases):
            return False
        return not takes_away(scene, rung.changes, watched)

    return [rung for rung in rungs if is_able(rung)]


def moving_rungs(scene: Scene) -> list[Rung]:
    """The few rungs of rigid bodies in motion from which one is chosen; the scene's own first.

    **Arguments:**

    - `scene`: with a sweep.
    """
    own, steps, harmonics = scene["mesh.slices"], scene["sweep.steps"], scene["sweep.harmonics"]
    balance = HarmonicBalance(harmonics=harmonics)
    rungs = [Rung(f"H{harmonics} N{steps}", "harmonic balance", balance, steps, own)]
    rungs += [
        Rung(f"H{h} N{n}", "harmonic balance", HarmonicBalance(harmonics=h), n, own)
        for h, n in ((5, 64), (10, 64))
        if n <= steps and h < harmonics
    ]
    rungs += [
        Rung(f"{n} slice{'s' if n > 1 else ''}", _compare.SLICES, balance, steps, n)
        for n in (1, 5)
        if n < own
    ]
    return rungs + [
        Rung(name, _compare.MODELS, balance, steps, own, changes=MappingProxyType(changes))
        for name, changes in simpler_bodies(scene).items()
    ]


def changes_in_motion(scene: Scene, rung: Rung) -> dict[str, Any]:
    """Keys of the scene that make a rung of it, by harmonic balance where it is that.

    **Arguments:**

    - `scene`: that was compared.
    - `rung`: one of its rungs.
    """
    found: dict[str, Any] = dict(rung.changes)
    wanted: dict[str, Any] = {"mesh.slices": rung.slices}
    if _by_balance(scene) and isinstance(rung.method, HarmonicBalance):
        wanted |= {"sweep.steps": rung.phases, "sweep.harmonics": rung.method.harmonics}
    return found | {key: value for key, value in wanted.items() if scene[key] != value}


def _by_balance(scene: Scene) -> bool:
    return scene["sweep.method"] in ("auto", "harmonic")


def _about(found: Summary, row: Summary | None, changes: Mapping[str, Any], of: str) -> Summary:
    """The `fidelity` part of the summary."""
    best = found["rungs"][0] if row is None else row
    errors = best.get("error_95", best["error"])
    why = f"By a comparison {of}: {found['words']}"
    if row is None:
        why += " So the scene was taken as it is given."
    return {
        "rung": "as given" if row is None or not changes else row["name"],
        "changes": dict(changes),
        "why": why,
        "errors": errors,
        "errors_elsewhere": best.get("held_out"),
        "tolerance": found["tolerance"],
        "within_tolerance": row is not None,
        "time_s": best["time_s"],
    }
