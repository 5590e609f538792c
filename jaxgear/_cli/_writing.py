"""Results on their way into their folder."""

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from jaxgear import plot
from jaxgear._cli._folder import Folder
from jaxgear._whole_file import write_csv, write_dataset, write_json, write_text
from jaxgear.scene._json_schema import SCHEMA_LINE
from jaxgear.scene._rewriting import rewritten, write_scene
from jaxgear.study._progress import narration, say
from jaxgear.study._result import Result, Summary


def written(result: Result, folder: Folder) -> Summary:
    """Write all that a study found: datasets, pictures and their tables, files, summary, scene.

    Returns the summary as it is in `summary.json`.
    """
    groups = dict(result.datasets)
    if groups:
        write_dataset(groups.pop("", xr.Dataset()), folder / "result.nc", groups)
    with narration("pictures"):
        write_pictures(result.datasets, folder)
    for name, write in result.files.items():
        write(folder / name)
    own = result.scene
    known = own.overridden() | own.files_from(folder.path)
    for name, keys in result.scenes.items():
        # The schema that it names stays beside the scene that it is made from.
        text = rewritten(own.path, {**known, **keys}).removeprefix(SCHEMA_LINE)
        write_text(text, folder / name)
    places = {name: str(folder.path / name) for name in result.scenes}
    write_scene(own.replace(own.files_from(folder.path)), folder / "scene.toml")
    write_json(_placed(result.summary, places), folder / "summary.json")
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))


def _placed(summary: Summary, places: Mapping[str, str]) -> Summary:
    """A summary whose scenes have their paths for their names."""
    return {
        key: _placed(value, places)
        if isinstance(value, dict)
        else places.get(value, value)
        if key == "scene"
        else value
        for key, value in summary.items()
    }


def write_pictures(datasets: Mapping[str, xr.Dataset], folder: Folder) -> None:
    """Write the tables of all pictures of datasets and, where they are wanted, the pictures."""
    for each in plot.pictures(datasets):
        save(each.draw, each.table, folder, each.name, **each.beside)
    for each in plot.animations(datasets) if folder.pictures else ():
        each.write(folder / f"{each.name}.gif")


def save(
    draw: Callable[[], Any],
    columns: Mapping[str, np.ndarray],
    folder: Folder,
    name: str,
    **beside: Mapping[str, np.ndarray],
) -> None:
    """Write a picture's data, and the picture where pictures are wanted.

    **Arguments:**

    - `draw`: returns the figure; called only for a picture.
    - `columns`: its data, under names with units: one table.
    - `folder`: where to.
    - `name`: of the files, without ending: NAME.csv, NAME.png and NAME.svg.
    - `beside`: more of its data, whose rows are other records: NAME_KEY.csv for each KEY.
    """
    write_csv(columns, folder / f"{name}.csv")
    for key, others in beside.items():
        write_csv(others, folder / f"{name}_{key}.csv")
    if folder.pictures:
        # Matplotlib costs half a second.
        from jaxgear.plot._style import write_picture

        say(f"drawing {name}")
        write_picture(draw, folder / f"{name}.png", folder / f"{name}.svg")
