"""Results on their way into their folder."""

import json

import xarray as xr

from jaxgear import plot
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._whole_file import write_dataset, write_json
from jaxgear.scene._scene import Scene, write_scene
from jaxgear.scene._scene_files import files_seen_from
from jaxgear.study._head import finished
from jaxgear.study._progress import narration
from jaxgear.study._result import Result, Summary


def written(result: Result, folder: Folder) -> Summary:
    """Write all that a study found: datasets, pictures and their tables, files, summary, scene.

    **Arguments:**

    - `result`: of the study.
    - `folder`: where to.

    **Returns:**

    The summary as it is in `summary.json`.
    """
    groups = dict(result.datasets)
    if groups:
        write_dataset(groups.pop("", xr.Dataset()), folder / "result.nc", groups)
    with narration("pictures"):
        for each in plot.pictures(result.datasets):
            save(each.draw, each.table, folder, each.name, **each.beside)
    for name, write in result.files.items():
        write(folder / name)
    return _closed(result.scene, folder, result.summary)


def finish(scene: Scene, folder: Folder, summary: Summary) -> Summary:
    """Add remarks on the scene and the cost, and write what every results folder has."""
    return _closed(scene, folder, finished(scene, summary))


def _closed(scene: Scene, folder: Folder, summary: Summary) -> Summary:
    write_scene(scene.replace(files_seen_from(scene, folder.path)), folder / "scene.toml")
    write_json(summary, folder / "summary.json")
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))
