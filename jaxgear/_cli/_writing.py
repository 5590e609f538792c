"""Results on their way into their folder."""

import json
from collections.abc import Mapping

import xarray as xr

from jaxgear import plot
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._whole_file import write_dataset, write_json, write_text
from jaxgear.scene._rewriting import rewritten, write_scene
from jaxgear.scene._scene import Scene
from jaxgear.scene._scene_files import files_seen_from
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
        for each in plot.animations(result.datasets) if folder.pictures else ():
            each.write(folder / f"{each.name}.gif")
    for name, write in result.files.items():
        write(folder / name)
    own = result.scene
    known = own.overridden() | files_seen_from(own, folder.path)
    for name, keys in result.scenes.items():
        write_text(rewritten(own.path, {**known, **keys}), folder / name)
    places = {name: str(folder.path / name) for name in result.scenes}
    return _closed(own, folder, _placed(result.summary, places))


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


def _closed(scene: Scene, folder: Folder, summary: Summary) -> Summary:
    write_scene(scene.replace(files_seen_from(scene, folder.path)), folder / "scene.toml")
    write_json(summary, folder / "summary.json")
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))
