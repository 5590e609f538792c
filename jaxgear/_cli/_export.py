"""The command `export`: bodies, scenes and results in the files that other programs read."""

import argparse
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jaxgear._checks import InputError
from jaxgear._cli._plot import read_result
from jaxgear._whole_file import whole_file, write_text
from jaxgear.scene._rexs_out import rexs_of_scene
from jaxgear.scene._scene import read_scene
from jaxgear.scene._schema import GEARS

if TYPE_CHECKING:
    from jaxgear.study._mesh_map import MeshMap
    from jaxgear.study._topography import Topography

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
        if args.form in ("rexs", "rexsj", "rexsz", "modelica", "topography"):
            scene = read_scene(args.file, args.overrides)
            if args.form != "topography":
                scene.refuse(_other_sides(scene.pair.torque_pinion_Nm))
            if args.form == "modelica":
                from jaxgear.study._mesh_map import mesh_map

                return _modelica(scene.name, mesh_map(scene), folder)
            if args.form == "topography":
                from jaxgear.scene._build_pair import flanks_of, pair_of
                from jaxgear.study._topography import flank_topography

                flanks = flanks_of(scene, pair := pair_of(scene))
                grids = {gear: flank_topography(pair, flanks, gear) for gear in GEARS}
                return _topography(scene.name, grids, folder)
            text, remarks = rexs_of_scene(scene, as_json=args.form == "rexsj")
            return [_rexs(scene.name, text, folder, args.form)], remarks
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


def _other_sides(torque: float) -> Iterator[tuple[str, str]]:
    """A torque under which drive flanks do not carry: the file would not say so."""
    if torque <= 0.0:
        words = f"got {torque:g}: the file is of drive flanks under load. Give a torque > 0"
        yield "pair.torque_pinion_Nm", words


def _rexs(name: str, text: str, folder: Path, form: str) -> Path:
    target = folder / f"{name}.{form}"
    if form == "rexsz":
        with whole_file(target) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr(f"{name}.rexs", text)
    else:
        write_text(text, target)
    return target


def _modelica(name: str, found: "MeshMap", folder: Path) -> _Written:
    from jaxgear.study._mesh_map import modelica_table

    target = folder / f"{name}.mesh.txt"
    write_text(modelica_table("mesh_force", found.phase, found.approach, found.force), target)
    return [target], (
        "u1: phase in mesh periods, teeth of the pinion times its turns; repeat it yourself.",
        "u2: r_b1 phi_1 + r_b2 phi_2 [m], positive where the pinion runs ahead.",
        "y: force along the transverse line of action [N]; times r_b it is the torque on a gear.",
        f"r_b: {' and '.join(f'{radius:.9g}' for radius in found.base_radius)} m.",
    )


def _topography(name: str, flanks: "Mapping[str, Topography]", folder: Path) -> _Written:
    from jaxgear.study._topography import topography_grid, topography_rows

    files = []
    for gear, found in flanks.items():
        for kind, text in (("flank", topography_rows), ("flank_grid", topography_grid)):
            files.append(folder / f"{name}.{gear}_{kind}.csv")
            write_text(text(found), files[-1])
    return files, ("Deviations in um along the flank normal, positive where material is added.",)
