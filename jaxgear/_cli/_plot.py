"""The command `plot`: pictures and tables of a result again, from its datasets alone."""

import argparse
from pathlib import Path
from typing import Any

from jaxgear._checks import InputError


def add_plot_parser(commands: Any) -> None:
    """Add the command to those of a parser.

    **Arguments:**

    - `commands`: what `add_subparsers` returned.
    """
    parser: argparse.ArgumentParser = commands.add_parser(
        "plot",
        help="draw the pictures of a result.nc again, without computing",
        allow_abbrev=False,
    )
    parser.add_argument("result", metavar="RESULT", type=Path, help="result.nc of any command")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the pictures; that of the result"
    )
    parser.add_argument(
        "--no-pictures",
        action="store_false",
        dest="pictures",
        help="draw none, and write only their data",
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def draw_again(result: Path, folder: Path, *, pictures: bool = True) -> list[str]:
    """Draw all pictures and write all tables that the datasets of a result allow.

    Neither JAX nor the scene is needed.

    **Arguments:**

    - `result`: path of a `result.nc`.
    - `folder`: where to; it is made if it does not exist.
    - `pictures`: whether they are drawn, or their tables written only.

    **Returns:**

    The names of the pictures.

    **Raises:**

    - `InputError` if the file is no result, or one without pictures.
    - `OSError` if the folder cannot be written to.
    """
    import xarray as xr

    from jaxgear import plot
    from jaxgear._cli._folder import Folder
    from jaxgear._cli._saving import save

    if not result.is_file():
        raise InputError(f"{result}: no such file. Name the result.nc of a results folder.")
    try:
        groups = xr.open_groups(result, engine="netcdf4")
        datasets = {name.strip("/"): each.load() for name, each in groups.items()}
        for each in groups.values():
            each.close()
    except (OSError, ValueError) as error:
        why = "no netCDF file" if isinstance(error, OSError) else str(error)
        raise InputError(
            f"{result}: not a result of jaxgear: {why}. Name the result.nc of a results folder."
        ) from None
    found = list(plot.pictures(datasets))
    if not found:
        raise InputError(
            f"{result}: there is nothing in it to draw. Name the result.nc of a results folder "
            "that this version of jaxgear has written."
        )
    folder.mkdir(parents=True, exist_ok=True)
    into = Folder(folder, pictures)
    for each in found:
        save(each.draw, each.table, into, each.name, **each.beside)
    for each in plot.animations(datasets) if pictures else ():
        each.write(into / f"{each.name}.gif")
    return [each.name for each in found]
