"""The command `study`: many designs of a scene, computed in parts, collected in one table."""

import argparse
import importlib.util
import json
import re
from pathlib import Path
from typing import Any

import xarray as xr

from jaxgear import designs
from jaxgear._checks import InputError
from jaxgear._cli._folder import REPORT, Folder
from jaxgear._cli._writing import write_pictures
from jaxgear._columns import Table
from jaxgear._whole_file import whole_file, write_csv, write_dataset, write_json, write_text
from jaxgear.designs._collect import Collected
from jaxgear.designs._work import WHOLE
from jaxgear.report import report
from jaxgear.scene._rewriting import rewritten, write_scene
from jaxgear.study._progress import narration
from jaxgear.study._result import Summary


def studied(args: argparse.Namespace) -> Summary:
    """Do what a command line asks of a study; the summary of what is there then.

    **Raises:**

    - `InputError` or `SceneError` if it cannot be.
    - `OSError` if results cannot be written.
    """
    folder = args.out or Path("results") / designs.read_study(args.study).name
    if args.status:
        return {"study": designs.status(args.study, folder)._asdict()}
    if args.shard is not None:
        # Of its results whoever collects all makes the table.
        designs.run(args.study, folder, shard=_shard(args.shard), anew=not args.resume)
        return {"study": designs.status(args.study, folder)._asdict()}
    if args.collect:
        found = designs.collect(args.study, folder)
    else:
        found = designs.run(args.study, folder, shard=WHOLE, anew=not args.resume)
    write_results(found, Folder(folder, args.pictures))
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))


def _shard(text: str) -> designs.Shard:
    found = re.fullmatch(r"(\d+)/(\d+)", text)
    if found is None:
        raise InputError(f"--shard: got {text!r}, must be I/N, such as 0/2: the first half of two.")
    return designs.Shard(int(found[1]), int(found[2]))


def write_results(found: Collected, folder: Folder) -> None:
    """Write the table, the arrays, pictures, the best designs as scenes, and the report."""
    table = found.table
    if importlib.util.find_spec("pyarrow"):
        _write_parquet(table, dict(found.designs.attrs), folder / "designs.parquet")
    else:
        write_csv(table, folder / "designs.csv", digits=17)
    write_dataset(xr.Dataset(), folder / "result.nc", found.datasets)
    scene = found.scene
    known = scene.overridden() | scene.files_from(folder.path)
    for number, values in enumerate(found.best, start=1):
        # Under a name of its own its results do not replace those of the others.
        name = f"{found.summary['name']}_best_{number}"
        text = rewritten(scene.path, {**known, **values, "name": name})
        write_text(text, folder / f"best_{number}.toml")
    with narration("pictures"):
        write_pictures(found.datasets, folder)
    write_text(found.designs.attrs["study"], folder / "study.toml")
    write_scene(scene.replace(scene.files_from(folder.path)), folder / "scene.toml")
    write_json(found.summary, folder / "summary.json")
    write_text(report(folder / ".", "study"), folder / REPORT)


def _write_parquet(table: Table, about: dict[str, Any], path: Path) -> None:
    """Write a table as Parquet, with what it was made from in its metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = pa.table({name: pa.array(values) for name, values in table.items()})
    words = {
        key: value if isinstance(value, str) else json.dumps(value) for key, value in about.items()
    }
    with whole_file(path) as draft:
        pq.write_table(columns.replace_schema_metadata(words), draft)
