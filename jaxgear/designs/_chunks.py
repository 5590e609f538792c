"""The chunks of a study: which designs go into one file, and what it is called."""

import hashlib
import importlib.metadata
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from jaxgear.designs._asked import Study
from jaxgear.designs._evaluate import moved_keys
from jaxgear.designs._table import DesignTable


class Chunk(NamedTuple):
    """Designs that are computed together.

    **Fields:**

    - `name`: hash of all that their results depend on: the name of their file.
    - `designs`: their numbers in the table.
    """

    name: str
    designs: tuple[int, ...]


def chunks_of(study: Study, table: DesignTable) -> tuple[Chunk, ...]:
    """The chunks of a study, those of one body one after the other.

    **Arguments:**

    - `study`: from `read_study`.
    - `table`: its designs.
    """
    moved = set(moved_keys(study, table.keys))
    others = [place for place, key in enumerate(table.keys) if key not in moved]
    alike: dict[str, list[int]] = {}
    for design, row in enumerate(table.rows):
        alike.setdefault(repr([row[place] for place in others]), []).append(design)
    size, about = study.chunk, digest_of(origin_of(study))
    found = []
    for designs in alike.values():
        for begin in range(0, len(designs), size):
            own = tuple(designs[begin : begin + size])
            rows = [table.keys, own, [table.rows[design] for design in own]]
            found.append(Chunk(digest_of([about, rows])[:24], own))
    return tuple(found)


def digest_of(value: Any) -> str:
    """Hash of numbers and texts, by all their digits."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


# What of a study file changes no result.
_NOT_ABOUT = ("name", "work.", "keep.minimise", "keep.best", "set")


def origin_of(study: Study) -> Mapping[str, Any]:
    """All that results are made from besides the designs themselves: the chunk's size too.

    **Arguments:**

    - `study`: from `read_study`.

    **Returns:**

    Values by path: of the scene, of the study file, and the version of jaxgear.
    """
    scene, csv = study.scene, study.asked.design.csv
    named = {f"scene.{key}": path for key, path in scene.files.items()}
    if csv is not None:
        named["study.design.csv"] = study.path.parent / csv
    about = {key: x for key, x in study.values.items() if not key.startswith(_NOT_ABOUT)}
    return {
        **{f"scene.{key}": value for key, value in scene.fixed.items()},
        **{f"study.{key}": value for key, value in about.items()},
        **{f"{key} (its content)": _content(path) for key, path in named.items()},
        "study.work.chunk": study.chunk,
        "jaxgear": importlib.metadata.version("jaxgear"),
    }


def _content(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
