"""What the command line takes: each command with its arguments, as tables."""

import argparse
import importlib.metadata
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxgear.scene._scene import READY

# The studies that `jaxgear init` writes.
READY_STUDIES = Path(__file__).parents[1] / "designs" / "ready"
# Commands that study a scene.
_STUDIES = {
    "run": "compute everything that the scene asks for",
    "map": "Master Curve map: RMS of transmission error over relief depth and extent",
    "optimise": "improve the keys of [optimise].vary; writes NAME.optimised.toml",
    "sweep": "steady responses over the speeds of [sweep]: dynamic ratio, orders, jumps",
    "modes": "natural frequencies, where their energy is, critical speeds",
    "check-grad": "compare the optimiser's derivatives with central differences",
    "sensitivity": "what the responses react to: per cent per per cent of each key, as bars",
    "compare": "one scene by many models and methods: error against time, and which suffices",
    "condense": "build the condensed bodies of the scene: files, pictures, health report",
}
# Options of one's own pair: the key that each is, and its question.
OWN_PAIR: Mapping[str, tuple[str, str]] = {
    "module": ("pair.module_mm", "normal module [mm]"),
    "pressure_angle": ("pair.pressure_angle_deg", "normal pressure angle [degrees; 20]"),
    "helix": ("pair.helix_angle_deg", "helix angle, + for a right-hand pinion [degrees; 0]"),
    "face": ("pinion.face_width_mm", "face width [mm; ten modules]"),
    "torque": ("pair.torque_pinion_Nm", "torque on the pinion [N m; moderate, or by power]"),
    "power": ("pair.power_kW", "power [kW; none]"),
    "rpm": ("pair.speed_rpm", "speed of the pinion [rpm; none]"),
}
# What `export` writes.
FORMS: Mapping[str, str] = {
    "op4": "Nastran's OUTPUT4, as text",
    "mtx": "Abaqus's *MATRIX INPUT",
    "rexs": "REXS 1.5, XML",
    "rexsj": "the same as JSON",
    "rexsz": "the same, packed",
    "modelica": "force of the mesh over phase and approach, for CombiTable2Ds",
    "topography": "both flanks as CSV, over face and roll length",
    "uff58": "orders and spectra of a sweep as a universal file, dataset 58",
}

# How shells complete the name of a file, for shtab.
_FILES = {"bash": "_shtab_compgen_files", "zsh": "_files", "tcsh": "f"}

_Arguments = Mapping[str, Mapping[str, Any]]


def _flag(text: str) -> Mapping[str, Any]:
    return {"action": "store_true", "help": text}


_COMMON: _Arguments = {
    "--out": {
        "type": Path,
        "metavar": "DIR",
        "help": "folder for the results; in it each command but run has one of its own",
    },
    "--set": {
        "action": "append",
        "default": [],
        "dest": "overrides",
        "metavar": "KEY=VALUE",
        "help": "change a key of the scene, e.g. pair.torque_pinion_Nm=120; repeatable",
    },
    "--json": _flag("print the summary as JSON"),
    "--quiet": _flag("print nothing but errors, and the JSON if asked for"),
}
_PICTURES: _Arguments = {
    "--no-pictures": {
        "action": "store_false",
        "dest": "pictures",
        "help": "draw none, and write only their data",
    },
}
_SCENE: _Arguments = {"scene": {"metavar": "SCENE", "type": Path, "help": "scene file (TOML)"}}
_QUIET: _Arguments = {"--quiet": _flag("print nothing but errors")}
_KEYS: _Arguments = {
    "pattern": {
        "metavar": "PATTERN",
        "nargs": "?",
        "default": "",
        "help": "part of a key or of its meaning, such as relief or wheel*bore; all without it",
    },
}
_EXPLAIN: _Arguments = {
    "key": {"metavar": "KEY", "help": "path of a key, such as pair.torque_pinion_Nm"},
}
_PLOT: _Arguments = {
    "result": {
        "metavar": "RESULT",
        "type": Path,
        "help": "result.nc of any command, or the folder that it is in",
    },
    "--out": {
        "type": Path,
        "metavar": "DIR",
        "help": "folder for the pictures; that of the result",
    },
    **_PICTURES,
    **_QUIET,
}
_STUDY: _Arguments = {
    "study": {"metavar": "STUDY", "type": Path, "help": "study file (TOML)"},
    "--out": {"type": Path, "metavar": "DIR", "help": "folder for the results; results/NAME"},
    "--resume": {
        "action": argparse.BooleanOptionalAction,
        "default": True,
        "help": "go on where it was; --no-resume first removes what is there (of a shard, its own)",
    },
    **_PICTURES,
    "--json": _flag("print the summary as JSON"),
    **_QUIET,
}
_PARTS: _Arguments = {
    "--shard": {"metavar": "I/N", "help": "compute part I of N only, counted from 0"},
    "--status": _flag("say how much is computed, and compute nothing"),
    "--collect": _flag("collect what is computed, and compute nothing"),
}
_EXPLORE: _Arguments = {
    "--out": {
        "type": Path,
        "metavar": "FILE",
        "help": "file that the page writes the scene into; NAME.explored.toml beside the scene",
    },
    "--set": _COMMON["--set"],
    "--key": {
        "action": "append",
        "default": [],
        "dest": "keys",
        "metavar": "KEY",
        "help": "a slider for this real key too, e.g. pinion.profile_shift; repeatable, and the "
        "page adds more",
    },
    "--port": {"type": int, "default": 0, "metavar": "N", "help": "port to listen on; a free one"},
    **_SCENE,
}
_EXPORT: _Arguments = {
    "file": {
        "metavar": "FILE",
        "type": Path,
        "help": "for op4 and mtx NAME.body.npz of `jaxgear condense`; for uff58 the result.nc of "
        "`jaxgear sweep`; else a scene",
    },
    "--form": {
        "choices": tuple(FORMS),
        "required": True,
        "help": "; ".join(f"{name}: {text}" for name, text in FORMS.items()),
    },
    "--set": _COMMON["--set"],
    "--out": {"type": Path, "metavar": "DIR", "help": "folder for the files; that of FILE"},
    **_QUIET,
}
_IMPORT: _Arguments = {
    "file": {"metavar": "FILE", "type": Path, "help": "REXS file, or universal file"},
    "--stage": {"default": "", "metavar": "ID", "help": "identifier of the stage; asked for"},
    "--load-case": {"default": "", "metavar": "ID", "help": "identifier of it; the first"},
    "--out": {"type": Path, "metavar": "DIR", "help": "folder, or a file that ends in .toml"},
    **_QUIET,
}
_REPORT: _Arguments = {
    "results": {"metavar": "RESULTS", "type": Path, "help": "folder of results"},
    "--out": {
        "type": Path,
        "metavar": "FILE",
        "help": "where the page goes; report.html in the folder",
    },
    **_QUIET,
}
_CACHE: _Arguments = {
    "--clear": _flag("remove all of them"),
    "--json": _flag("print the list as JSON"),
    **_QUIET,
}
_INIT = (
    "Writes an example scene, NAME.toml. With --pair it writes a scene of your own, whose shafts, "
    "bearings and profile shifts are sized by rules of thumb; on a terminal it asks for what it "
    "needs. --out is a folder, or a file that ends in .toml."
)


class _Parser(argparse.ArgumentParser):
    """A parser whose help fails where it cannot be written; the library's own says nothing."""

    def _print_message(self, message: str, file: Any = None) -> None:
        if file is sys.stdout:
            file.write(message)
        else:
            super()._print_message(message, file)


def parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    whole = _Parser(
        prog="jaxgear",
        description="Differentiable gear dynamics: from a scene file to transmission error, "
        "contact, and better flanks.",
        epilog="Begin with: jaxgear init accessory; jaxgear run accessory.toml",
        allow_abbrev=False,
    )
    whole.add_argument("--version", action="version", version=f"jaxgear {_version()}")
    commands = whole.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, text: str, arguments: _Arguments, **more: Any) -> _Parser:
        added = commands.add_parser(name, help=text, allow_abbrev=False, **more)
        _add(added, arguments)
        return added

    init = command(
        "init", "write an example scene, or one of your own pair", _COMMON, description=_INIT
    )
    names = " | ".join([*ready_names(), *study_names()])
    _add(init, {"name": {"metavar": "NAME", "nargs": "?", "help": names}})
    _add(init, {"--force": _flag("overwrite an example scene's NAME.toml")})
    own = init.add_argument_group("a pair of your own")
    pair = {"nargs": 2, "type": int, "metavar": ("PINION", "WHEEL"), "help": "numbers of teeth"}
    _add(own, {"--pair": pair})
    for option, (_, question) in OWN_PAIR.items():
        number = {"type": float, "metavar": "X", "help": question}
        _add(own, {f"--{option.replace('_', '-')}": number})
    for name, text in _STUDIES.items():
        command(name, text, {**_COMMON, **_SCENE, **_PICTURES})
    keys = command("keys", "look up the keys of a scene: unit, default, bounds, meaning", _KEYS)
    forms = {"--json": "print the keys as JSON", "--markdown": "print all keys as a page"}
    group = keys.add_mutually_exclusive_group()
    _add(group, {name: _flag(text) for name, text in forms.items()})
    command("schema", "print the JSON Schema of scenes, by which editors complete and check", {})
    command("explain", "all that is known of one key, with what example scenes have", _EXPLAIN)
    command("doctor", "say whether this installation is in order: versions, precision, speed", {})
    text = "a page with sliders for flanks and other real keys: pictures and slopes while they move"
    command("explore", text, _EXPLORE)
    text = "many designs of a scene as one table, with derivatives; resumes, works in parts"
    study = command("study", text, _STUDY)
    _add(study.add_mutually_exclusive_group(), _PARTS)
    text = "the scene of a stage of a REXS file; or measured orders of a universal file as CSV"
    command("import", text, _IMPORT)
    text = "a condensed body or a scene for other programs"
    command("export", text, _EXPORT)
    command("plot", "draw the pictures of a result.nc again, without computing", _PLOT)
    text = "one HTML page of a results folder, that of all commands on a scene too"
    command("report", text, _REPORT)
    text = "list the condensed bodies and compiled programs that are kept, or remove them"
    command("cache", text, _CACHE)
    return whole


def ready_names() -> list[str]:
    """Names of the example scenes."""
    return sorted(path.stem for path in READY.glob("*.toml"))


def study_names() -> list[str]:
    """Names of the example studies of many designs."""
    return sorted(path.stem for path in READY_STUDIES.glob("*.toml"))


def _add(to: Any, arguments: _Arguments) -> None:
    for name, options in arguments.items():
        added = to.add_argument(name, **options)
        if options.get("type") is Path:
            added.complete = _FILES


def _version() -> str:
    try:
        return importlib.metadata.version("jaxgear")
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"
