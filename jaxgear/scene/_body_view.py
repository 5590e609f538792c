"""What pictures need of a condensed body and matrices do not, kept beside it in the cache.

A view that is missing or spoilt is made again from the body's grid.
"""

import contextlib
import dataclasses
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fem_prep import cache_folder
from jaxgear._whole_file import whole_file

_SET = "set:"


@dataclasses.dataclass(frozen=True)
class BodyView:
    """What pictures show of a body.

    **Fields:**

    - `sets`: nodes of the rim and of the seats, by name of the set.
    - `shapes`: lowest free modes, shape `[mode, node, 3]`, to any scale.
    """

    sets: Mapping[str, np.ndarray]
    shapes: np.ndarray


def view_folder() -> Path | None:
    """Where views are kept, if they are: beside the bodies, as neither is the other's kind."""
    bodies = cache_folder()
    return bodies and bodies.with_name("views")


def keep_view(key: str, view: BodyView) -> None:
    """Keep a view in the cache; where that cannot be, it will be made again.

    Views of bodies that are no longer in the cache go.
    """
    arrays = {f"{_SET}{name}": nodes for name, nodes in view.sets.items()}
    keep_beside(key, key, arrays | {"shapes": view.shapes})


def keep_beside(key: str, name: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Keep arrays beside the body with a key; their name begins with it."""
    bodies, folder = cache_folder(), view_folder()
    if bodies is None or folder is None:
        return
    held: dict[str, Any] = dict(arrays)
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        for path in folder.glob("*.npz"):
            if not (bodies / f"{path.name[: len(key)]}.npz").exists():
                path.unlink()
        with whole_file(folder / f"{name}.npz") as draft, draft.open("wb") as file:
            np.savez(file, **held)


def read_view(key: str, nodes: int) -> BodyView | None:
    """A view from the cache."""
    folder = view_folder()
    if folder is None:
        return None
    try:
        with np.load(folder / f"{key}.npz", allow_pickle=False) as file:
            shapes = file["shapes"]
            sets = {name.removeprefix(_SET): file[name] for name in file.files if name != "shapes"}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    fits = shapes.ndim == 3 and shapes.shape[1:] == (nodes, 3) and "rim" in sets
    inside = all(each.max(initial=0) < nodes for each in sets.values())
    return BodyView(sets, shapes) if fits and inside else None


def clear_views() -> int:
    """Remove all views; returns what was freed [byte]."""
    freed, folder = 0, view_folder()
    for path in folder.glob("*.npz") if folder and folder.is_dir() else ():
        with contextlib.suppress(OSError):
            size = path.stat().st_size
            path.unlink()
            freed += size
    return freed
