"""What pictures need of a condensed body and matrices do not, kept beside it in the cache.

A view that is missing or spoilt is made again from the body's grid.
"""

import contextlib
import dataclasses
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fem_prep._cache import cache_folder
from jaxgear._app._whole_file import whole_file

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


def view_folder() -> Path:
    """Where views are kept: beside the bodies, so that neither takes the other for its own."""
    return cache_folder().with_name("views")


def keep_view(key: str, view: BodyView) -> None:
    """Keep a view in the cache; where that cannot be, it will be made again.

    **Arguments:**

    - `key`: that of the body.
    - `view`: what to keep.
    """
    arrays = {f"{_SET}{name}": nodes for name, nodes in view.sets.items()}
    arrays["shapes"] = view.shapes
    with contextlib.suppress(OSError):
        view_folder().mkdir(parents=True, exist_ok=True)
        with whole_file(view_folder() / f"{key}.npz") as draft, draft.open("wb") as file:
            np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]


def read_view(key: str, nodes: int) -> BodyView | None:
    """A view from the cache.

    **Arguments:**

    - `key`: that of the body.
    - `nodes`: of its grid.

    **Returns:**

    The view, or None if there is no good one.
    """
    try:
        with np.load(view_folder() / f"{key}.npz", allow_pickle=False) as file:
            shapes = file["shapes"]
            sets = {name.removeprefix(_SET): file[name] for name in file.files if name != "shapes"}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    fits = shapes.ndim == 3 and shapes.shape[1:] == (nodes, 3) and "rim" in sets
    inside = all(each.max(initial=0) < nodes for each in sets.values())
    return BodyView(sets, shapes) if fits and inside else None


def clear_views() -> int:
    """Remove all views; returns what was freed [byte]."""
    freed = 0
    for path in view_folder().glob("*.npz") if view_folder().is_dir() else ():
        with contextlib.suppress(OSError):
            size = path.stat().st_size
            path.unlink()
            freed += size
    return freed
