"""The command `plot`: pictures and tables of a result again, from its datasets alone."""

from pathlib import Path
from typing import TYPE_CHECKING

from jaxgear._checks import InputError

if TYPE_CHECKING:
    from jaxgear.plot._picture import Datasets


def draw_again(result: Path, folder: Path, *, pictures: bool = True) -> list[str]:
    """Draw all pictures and write all tables that the datasets of a result allow; their names.

    Neither JAX nor the scene is needed.

    **Raises:**

    - `InputError` if the file is no result, or one without pictures.
    - `OSError` if the folder cannot be written to.
    """
    from jaxgear import plot
    from jaxgear._cli._folder import Folder
    from jaxgear._cli._writing import write_pictures

    datasets = read_result(result)
    found = list(plot.pictures(datasets))
    if not found:
        raise InputError(
            f"{result}: there is nothing in it to draw. Name the result.nc of a results folder "
            "that this version of jaxgear has written."
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_pictures(datasets, Folder(folder, pictures))
    return [each.name for each in found]


def read_result(result: Path) -> "Datasets":
    """The datasets of a `result.nc`, by group; the group at the root has no name.

    **Raises:**

    - `InputError` if the file is no result.
    """
    import xarray as xr

    if not result.is_file():
        raise InputError(f"{result}: no such file. Name the result.nc of a results folder.")
    try:
        groups = xr.open_groups(result, engine="netcdf4")
        datasets = {name.strip("/"): each.load() for name, each in groups.items()}
        for each in groups.values():
            each.close()
        return datasets
    except (OSError, ValueError) as error:
        why = "no netCDF file" if isinstance(error, OSError) else str(error)
        raise InputError(
            f"{result}: not a result of jaxgear: {why}. Name the result.nc of a results folder."
        ) from None
