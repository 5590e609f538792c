"""The command `export`: bodies, scenes and results in the files that other programs read."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from jaxgear._checks import InputError
from jaxgear._cli._plot import read_result
from jaxgear._whole_file import write_text
from jaxgear.scene._rexs_out import rexs_of_scene
from jaxgear.scene._scene import Scene, read_scene

# The files, and what there is to say of them.
_Written = tuple[Sequence[Path], Sequence[str]]


def exported(args: argparse.Namespace) -> _Written:
    """Write what a command line asks for; the files, and what was left out.

    **Raises:**

    - `InputError` if a file is not of the right kind, or none can be written.
    - `SceneError` if a scene has mistakes.
    """
    folder = args.out or args.file.parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if args.form in _OF_SCENES:
            scene = read_scene(args.file, args.overrides)
            return _OF_SCENES[args.form](scene, folder)
        return [_uff58(args.file, folder)] if args.form == "uff58" else _body(args, folder), ()
    except OSError as error:
        raise InputError(f"cannot write into {folder}: {error.strerror}.") from None


def _body(args: argparse.Namespace, folder: Path) -> Sequence[Path]:
    from fem_prep import BodyError, export_body, read_body

    try:
        return export_body(read_body(args.file), folder, args.form)
    except BodyError as error:
        raise InputError(str(error)) from None


def _uff58(result: Path, folder: Path) -> Path:
    from jaxgear.study._uff58 import functions_of_sweep, write_functions

    sweep = read_result(result).get("sweep")
    if sweep is None:
        raise InputError(f"{result}: no sweep in it. Name the result.nc of `jaxgear sweep`.")
    target = folder / "sweep.uff"
    write_functions(functions_of_sweep(sweep), target)
    return target


def _rexs(scene: Scene, folder: Path) -> _Written:
    text, remarks = rexs_of_scene(scene)
    target = folder / f"{scene.name}.rexs"
    write_text(text, target)
    return [target], remarks


_OF_SCENES: Mapping[str, Callable[[Scene, Path], _Written]] = {"rexs": _rexs}
