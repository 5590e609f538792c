"""The file of condensed teeth: an archive of the arrays of `ToothElements`."""

import dataclasses
import os
from typing import Any

import numpy as np

from ._archive import archive_text, read_archive, write_archive
from ._body_checks import AGAIN
from ._checks import require
from ._tooth_compliance import ToothElements

_ARRAYS = ("roll", "compliance", "root_places", "root_stress")
_NUMBERS = ("face_width", "base_radius")


def write_teeth(path: str | os.PathLike, teeth: ToothElements) -> str:
    """Write condensed teeth to a file, whole or not at all.

    **Arguments:**

    - `path`: of the file; one that is there is replaced.
    - `teeth`: what to write.

    **Returns:**

    Their content hash.

    **Raises:**

    - `BodyError` if their facts cannot be written.
    - `OSError` if the file cannot be written.
    """
    arrays = {name: np.ascontiguousarray(getattr(teeth, name), dtype="<f8") for name in _ARRAYS}
    numbers = {name: getattr(teeth, name) for name in _NUMBERS}
    about = {"name": teeth.name, "kind": "teeth", **numbers, "facts": teeth.facts}
    return write_archive(path, arrays, archive_text(about))


def read_teeth(path: str | os.PathLike) -> ToothElements:
    """Read condensed teeth from a file.

    **Arguments:**

    - `path`: of a file that `write_teeth` wrote.

    **Returns:**

    The teeth, the same to the last digit.

    **Raises:**

    - `BodyError` if there is no such file, or if it is another one's, truncated or altered.
    """
    arrays, about = read_archive(path)
    names = {each.name for each in dataclasses.fields(ToothElements)}
    require(
        about.get("kind") == "teeth" and set(arrays) == set(_ARRAYS),
        "The file {path} is not that of condensed teeth. " + AGAIN,
        path=path,
    )
    fields: dict[str, Any] = {**arrays, **{name: about[name] for name in names & set(about)}}
    return ToothElements(**fields)
