"""The command `init`: writes an example scene, or that of one's own pair, asking for what lacks."""

import argparse
import dataclasses
import difflib
import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jaxgear._checks import InputError
from jaxgear._cli._parser import OWN_PAIR, READY_STUDIES, ready_names, study_names
from jaxgear._whole_file import write_csv, write_text
from jaxgear.scene._json_schema import SCHEMA_FILE, SCHEMA_LINE, json_schema
from jaxgear.scene._own_pair import Wanted
from jaxgear.scene._own_scene import scene_text
from jaxgear.scene._rewriting import rewritten
from jaxgear.scene._scene import READY, SceneError, read_scene
from jaxgear.scene._schema import KEYS

# What the rules of thumb hold for.
_TEETH, _PRESSURE_ANGLES = (10, 1000), (14.5, 30.0)


def write_first_scene(args: argparse.Namespace) -> tuple[Path, str]:
    """Write the scene that a command line asks for; the file, and where its numbers come from.

    **Raises:**

    - `InputError` if there is no such scene, something lacks, or the file cannot be written.
    """
    given = {option: getattr(args, option) for option in OWN_PAIR}
    own = args.pair is not None or any(value is not None for value in given.values())
    if args.name in study_names() and not own:
        return _write_study(args)
    if args.name is not None and not own:
        return _write_ready(args)
    if args.force:
        raise InputError("--force is for example scenes: your own may hold changes of yours.")
    if not own and not sys.stdin.isatty():
        raise InputError(
            f"name an example scene ({', '.join(ready_names())}), or give your own pair, such as "
            "--pair 23 64 --module 2."
        )
    return _write_own(args, _completed(args.pair, given))


def _write_ready(args: argparse.Namespace) -> tuple[Path, str]:
    """Write an example scene, with the changes of `--set`."""
    names = [*ready_names(), *study_names()]
    if args.name not in names:
        near = difflib.get_close_matches(args.name, names, 1)
        hint = f" Did you mean {near[0]}?" if near else " For a pair of your own add --pair."
        raise InputError(f"no example scene {args.name!r}; there are: {', '.join(names)}.{hint}")
    ready = READY / f"{args.name}.toml"
    scene = read_scene(ready, args.overrides)
    target = _target(args, args.name)
    if target.exists() and not args.force:
        raise InputError(f"{target} exists already. Use --force to overwrite it.")
    text = SCHEMA_LINE + rewritten(ready, scene.overridden())
    _write(target, lambda: write_text(text, target))
    return target, scene.cite


def _write_study(args: argparse.Namespace) -> tuple[Path, str]:
    """Write an example study of many designs, which names an example scene."""
    if args.overrides:
        raise InputError("--set is for scenes. A study has a list `set`: write the changes there.")
    target = _target(args, args.name)
    if target.exists() and not args.force:
        raise InputError(f"{target} exists already. Use --force to overwrite it.")
    text = (READY_STUDIES / f"{args.name}.toml").read_text(encoding="utf-8")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_text(text, target)
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror}") from None
    return target, f"a study of many designs: jaxgear study {target}"


def _write_own(args: argparse.Namespace, wanted: Wanted) -> tuple[Path, str]:
    """Write the scene of a pair, once it has been read without a mistake."""
    teeth = wanted.teeth
    name = args.name or (args.out.stem if _is_file(args.out) else f"pair-{teeth[0]}-{teeth[1]}")
    wanted = dataclasses.replace(wanted, name=name)
    target = _target(args, name)
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "draft.toml"
        draft.write_text(scene_text(wanted), encoding="utf-8")
        try:
            scene = read_scene(draft, args.overrides)
        except SceneError as error:
            words = [f"{mistake.path}: {mistake.message}." for mistake in error.mistakes]
            raise InputError("\n".join(words)) from None
        text = rewritten(draft, scene.overridden()) if args.overrides else scene_text(wanted)
    _write_new(target, SCHEMA_LINE + text)
    return target, scene.cite


def write_imported(args: argparse.Namespace) -> tuple[Path, tuple[str, ...]]:
    """Write the scene of a stage of a REXS file; the file, and what was left out or assumed.

    **Raises:**

    - `InputError` if there is no such stage, if it makes no scene, or the file cannot be written.
    """
    # Who looks up a key waits for no writer of scenes.
    import tomlkit

    from jaxgear.scene._rexs import scene_of_rexs

    found = scene_of_rexs(args.file, args.stage, args.load_case)
    target = _target(args, found.keys["name"])
    told = "".join(f"# {remark}\n" for remark in "\n".join(found.remarks).splitlines())
    text = f"{SCHEMA_LINE}{told}\n{tomlkit.dumps(found.keys)}"
    _write_new(target, text)
    return target, found.remarks


def write_measured(args: argparse.Namespace) -> Path:
    """Write the functions of a universal file as a table; the file.

    **Raises:**

    - `InputError` if there are none in it, or the file cannot be written.
    """
    from jaxgear.study._uff58 import read_functions, table_of_functions

    target = (args.out or Path()) / f"{args.file.stem}.measured.csv"
    table = table_of_functions(read_functions(args.file))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_csv(table, target)
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror}") from None
    return target


def _write_new(target: Path, text: str) -> None:
    """Write a scene that is not there yet."""

    def write() -> None:
        with target.open("x", encoding="utf-8") as file:
            file.write(text)

    _write(target, write)


def _write(target: Path, write: Callable[[], None]) -> None:
    """Write a scene, and its schema beside it, into a folder that need not be there yet."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write()
        write_text(json.dumps(json_schema()) + "\n", target.with_name(SCHEMA_FILE))
    except OSError as error:
        if isinstance(error, FileExistsError) and target.parent.is_dir():
            raise InputError(f"{target} exists already. Name another file with --out.") from None
        raise InputError(f"cannot write {target}: {error.strerror}") from None


def _is_file(out: Path | None) -> bool:
    return out is not None and out.suffix == ".toml"


def _target(args: argparse.Namespace, name: str) -> Path:
    return args.out if _is_file(args.out) else (args.out or Path()) / f"{name}.toml"


def _completed(teeth: list[int] | None, given: dict[str, float | None]) -> Wanted:
    """A pair by checked options, asked for on a terminal where a pair or a module lacks."""
    ask = _ask if (teeth is None or given["module"] is None) and sys.stdin.isatty() else None
    found: dict[str, Any]
    if teeth is None:
        if ask is None:
            raise InputError("--pair lacks: the numbers of teeth, such as --pair 23 64.")
        read_teeth = lambda text: _teeth([int(each) for each in text.split()])
        found = {"teeth": ask("teeth of pinion and wheel", read_teeth)}
    else:
        found = {"teeth": _teeth(teeth)}
    for option, (_, question) in OWN_PAIR.items():
        value = given[option]
        needed = option == "module" or (option == "rpm" and bool(ask and found["power"]))
        # The power is asked for only where it would count.
        if value is None and ask and not (option == "power" and found["torque"] is not None):
            read = lambda text, option=option: _checked(option, float(text))
            value = ask(question, read, needed=needed)
        elif value is not None:
            value = _checked(option, value)
        elif needed:
            raise InputError("--module lacks: the normal module in mm, such as --module 2.")
        found[option] = value
    if found["power"] is not None and (found["torque"] is None) == (found["rpm"] is None):
        raise InputError(
            "--power goes with --rpm, which give the torque; --torque says it by itself. Give "
            "--torque, or --power and --rpm."
        )
    known = {option: value for option, value in found.items() if value is not None}
    if "power" in known:
        known["power"] *= 1e3
    return Wanted("", **known)


def _ask(question: str, read: Callable[[str], Any], *, needed: bool = True) -> Any:
    """Ask on the terminal until the answer can be read; `None` for none where none is needed."""
    while True:
        print(f"{question}: ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line:
            raise InputError("no answer, so nothing was written.")
        if not line.strip() and not needed:
            return None
        try:
            return read(line.strip())
        except InputError as error:
            print(error, file=sys.stderr)
        except ValueError:
            print(f"a number was expected, got {line.strip()!r}", file=sys.stderr)


def _teeth(teeth: list[int]) -> tuple[int, int]:
    least, most = _TEETH
    if len(teeth) != 2 or not all(least <= each <= most for each in teeth):
        raise InputError(
            f"--pair: got {' '.join(map(str, teeth))}, must be two numbers of teeth from {least} "
            f"to {most}, which the rules of thumb are for."
        )
    return teeth[0], teeth[1]


def _checked(option: str, value: float) -> float:
    """Check an option by the key that it is."""
    name, (key, _) = f"--{option.replace('_', '-')}", OWN_PAIR[option]
    try:
        value = KEYS[key].read(value)
    except ValueError as error:
        raise InputError(f"{name}: {error}.") from None
    least, most = _PRESSURE_ANGLES
    if option == "pressure_angle" and not least <= value <= most:
        raise InputError(
            f"{name}: got {value:g}, must be from {least:g} to {most:g} degrees, which the rules "
            "of thumb are for."
        )
    return value
