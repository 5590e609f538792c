"""The file of a condensed body.

It is an archive, see `write_archive`, in which every array of `ReducedBody` is a member under its
own name, little-endian float64 or int64; an array that is None is left out. Its text has `name`,
`seats`, `interior`, `probes` and `facts`.
"""

import os

import numpy as np

from ._archive import archive_text, content_digest, read_archive, write_archive
from ._artefact import ReducedBody
from ._body_checks import AGAIN, OPTIONAL, check_body
from ._checks import require

_FLOATS = ("stiffness", "mass", "centrifugal_load", "rim_nodes", "seat_points", "probe_points")
_FLOATS += ("probe_rows", "nodes", "interior_shapes")
_INTEGERS = ("rim_faces", "bricks")
_KINDS: dict[str, str] = {name: "<f8" for name in _FLOATS + OPTIONAL}
_KINDS |= {name: "<i8" for name in _INTEGERS}


def write_body(path: str | os.PathLike, body: ReducedBody) -> str:
    """Write a body to a file, whole or not at all.

    **Arguments:**

    - `path`: of the file; one that is there is replaced.
    - `body`: what to write.

    **Returns:**

    Its content hash.

    **Raises:**

    - `BodyError` if the body is not sound, see `check_body`, or its facts cannot be written.
    - `OSError` if the file cannot be written.
    """
    check_body(body)
    return write_archive(path, *_packed(body))


def read_body(path: str | os.PathLike) -> ReducedBody:
    """Read a body from a file.

    **Arguments:**

    - `path`: of a file that `write_body` wrote.

    **Returns:**

    The body, the same to the last digit.

    **Raises:**

    - `BodyError` if there is no such file; if it is no body's, truncated or altered; if its
        format or its units are others; or if the body is not sound, see `check_body`.
    """
    arrays, about = read_archive(path)
    missing = [name for name in (*_FLOATS, *_INTEGERS) if name not in arrays]
    keys = ("name", "seats", "interior", "probes", "facts")
    missing += [key for key in keys if key not in about]
    require(
        not missing,
        "The file {path} must hold all parts of a body, got none named {names}. " + AGAIN,
        path=path,
        names=", ".join(missing),
    )
    strange = sorted(name for name in arrays if _KINDS.get(name) != arrays[name].dtype.str)
    require(
        not strange,
        "Arrays of the file {path} must be known and hold float64, or int64 for elements, got "
        "{strange}. " + AGAIN,
        path=path,
        strange=", ".join(f"{name} of {arrays[name].dtype}" for name in strange),
    )
    body = ReducedBody(
        **arrays,
        name=about["name"],
        seats=tuple(about["seats"]),
        interior=about["interior"],
        probes=tuple(about["probes"]),
        facts=about["facts"],
    )
    check_body(body)
    return body


def content_hash(body: ReducedBody) -> str:
    """SHA-256 of everything that the file of a body holds, versions of the libraries too."""
    return content_digest(*_packed(body))


def _packed(body: ReducedBody) -> tuple[dict[str, np.ndarray], str]:
    """Arrays as they go into the file, and the text about them."""
    arrays = {
        name: np.ascontiguousarray(getattr(body, name), dtype=kind)
        for name, kind in _KINDS.items()
        if getattr(body, name) is not None
    }
    about = {
        "name": body.name,
        "seats": list(body.seats),
        "interior": body.interior,
        "probes": list(body.probes),
        "facts": body.facts,
    }
    return arrays, archive_text(about)
