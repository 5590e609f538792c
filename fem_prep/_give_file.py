"""The file of a compliance between loads that took long to find."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ._archive import archive_text, read_archive, write_archive
from ._body_checks import AGAIN
from ._checks import require


@dataclass(frozen=True)
class Compliance:
    """A compliance between loads.

    **Fields:**

    - `matrix`: of motions by loads, `[load, load]` [SI].
    - `facts`: what else is known.
    """

    matrix: np.ndarray
    facts: Mapping[str, object] = field(default_factory=dict)


def write_compliance(path: str | os.PathLike, give: Compliance) -> str:
    """Write a compliance to a file, whole or not at all; returns its content hash."""
    matrix = np.ascontiguousarray(give.matrix, dtype="<f8")
    return write_archive(
        path, {"matrix": matrix}, archive_text({"kind": "give", "facts": give.facts})
    )


def read_compliance(path: str | os.PathLike) -> Compliance:
    """Read a compliance from a file that `write_compliance` wrote.

    **Raises:**

    - `BodyError` if there is no such file, or if it is another one's, truncated or altered.
    """
    arrays, about = read_archive(path)
    require(
        about.get("kind") == "give" and set(arrays) == {"matrix"},
        "The file {path} is not that of a compliance. " + AGAIN,
        path=path,
    )
    return Compliance(arrays["matrix"], about["facts"])
