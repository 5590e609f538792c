"""The command `export`: bodies, scenes and results in the files that other programs read."""

import argparse
import functools
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from jaxgear._checks import InputError
from jaxgear._cli._plot import read_result
from jaxgear._whole_file import whole_file, write_text
from jaxgear.scene._rexs_out import rexs_of_scene
from jaxgear.scene._scene import Scene, read_scene
from jaxgear.scene._schema import GEARS

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
            return _OF_SCENES[args.form](read_scene(args.file, args.overrides), folder)
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


def _refuse_other_sides(scene: Scene) -> None:
    """Refuse a scene whose drive flanks do not carry, of which the file would not say so."""
    if (torque := scene.pair.torque_pinion_Nm) <= 0.0:
        words = f"got {torque:g}: the file is of drive flanks under load. Give a torque > 0"
        scene.refuse([("pair.torque_pinion_Nm", words)])


def _rexs(scene: Scene, folder: Path, form: str = "rexs") -> _Written:
    _refuse_other_sides(scene)
    text, remarks = rexs_of_scene(scene, as_json=form == "rexsj")
    target = folder / f"{scene.name}.{form}"
    if form == "rexsz":
        with whole_file(target) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr(f"{scene.name}.rexs", text)
    else:
        write_text(text, target)
    return [target], remarks


def _modelica(scene: Scene, folder: Path) -> _Written:
    _refuse_other_sides(scene)
    from jaxgear.study._mesh_map import mesh_map, modelica_table

    found = mesh_map(scene)
    target = folder / f"{scene.name}.mesh.txt"
    write_text(modelica_table("mesh_force", found.phase, found.approach, found.force), target)
    return [target], (
        "u1: phase in mesh periods, teeth of the pinion times its turns; repeat it yourself.",
        "u2: r_b1 phi_1 + r_b2 phi_2 [m], positive where the pinion runs ahead.",
        "y: force along the transverse line of action [N]; times r_b it is the torque on a gear.",
        f"r_b: {' and '.join(f'{radius:.9g}' for radius in found.base_radius)} m.",
    )


def _topography(scene: Scene, folder: Path) -> _Written:
    from jaxgear.study._topography import flank_topography, topography_grid, topography_rows

    files = []
    for gear in GEARS:
        found = flank_topography(scene, gear)
        for kind, text in (("flank", topography_rows), ("flank_grid", topography_grid)):
            files.append(folder / f"{scene.name}.{gear}_{kind}.csv")
            write_text(text(found), files[-1])
    return files, ("Deviations in um along the flank normal, positive where material is added.",)


_OF_SCENES: Mapping[str, Callable[[Scene, Path], _Written]] = {
    "rexs": _rexs,
    "rexsj": functools.partial(_rexs, form="rexsj"),
    "rexsz": functools.partial(_rexs, form="rexsz"),
    "modelica": _modelica,
    "topography": _topography,
}
