"""The file of a condensed body: written whole or not at all, and refused if anything is wrong.

It is an uncompressed npz without pickled objects. Every array of `ReducedBody` is a member under
its own name, little-endian float64 or int64; an array that is None is left out. Two members are
texts, as bytes of UTF-8: `about`, a JSON object with `format`, `units`, `name`, `seats`,
`interior`, `probes`, `facts` and `versions`; and `hash`, the SHA-256 of all others, see `_digest`.
"""

import hashlib
import importlib.metadata
import json
import os
import secrets
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ._artefact import FORMAT, UNITS, ReducedBody
from ._body_checks import AGAIN, OPTIONAL, check_body
from ._checks import BodyError, require

_FLOATS = ("stiffness", "mass", "centrifugal_load", "rim_nodes", "seat_points", "probe_points")
_FLOATS += ("probe_rows", "nodes", "interior_shapes")
_INTEGERS = ("rim_faces", "bricks")
_TEXTS = ("about", "hash")
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
    arrays, about = _packed(body)
    digest = _digest(arrays, about)
    target = Path(path)
    # In the same folder, as a file can only be renamed within one file system.
    draft = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
    try:
        with open(draft, "xb") as file:
            np.savez(file, about=_bytes(about), hash=_bytes(digest), **arrays)  # pyright: ignore[reportArgumentType]
            file.flush()
            os.fsync(file.fileno())
        os.replace(draft, target)
    finally:
        draft.unlink(missing_ok=True)
    return digest


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
    members = _members(Path(path), None)
    about, text = _about(members, path)
    arrays = {name: array for name, array in members.items() if name not in _TEXTS}
    require(
        _digest(arrays, text) == _text(members["hash"]),
        "The file {path} was altered after it was written: its content does not match its hash. "
        + AGAIN,
        path=path,
    )
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


def read_about(path: str | os.PathLike) -> dict[str, Any]:
    """What the file of a body says of it in words, without reading its matrices.

    **Arguments:**

    - `path`: of a file that `write_body` wrote.

    **Returns:**

    `format`, `units`, `name`, `seats`, `interior`, `probes`, `facts`, `versions` and `hash`; the
    matrices are not checked against the last.

    **Raises:**

    - `BodyError` if it is no body's file, or of another format or other units.
    """
    members = _members(Path(path), _TEXTS)
    about, _ = _about(members, path)
    return {**about, "hash": _text(members["hash"])}


def content_hash(body: ReducedBody) -> str:
    """SHA-256 of everything that the file of a body holds, versions of the libraries too."""
    return _digest(*_packed(body))


def _packed(body: ReducedBody) -> tuple[dict[str, np.ndarray], str]:
    """Arrays as they go into the file, and the text about them."""
    arrays = {
        name: np.ascontiguousarray(getattr(body, name), dtype=kind)
        for name, kind in _KINDS.items()
        if getattr(body, name) is not None
    }
    about = {
        "format": FORMAT,
        "units": UNITS,
        "name": body.name,
        "seats": list(body.seats),
        "interior": body.interior,
        "probes": list(body.probes),
        "facts": body.facts,
        "versions": _versions(),
    }
    try:
        text = json.dumps(about, sort_keys=True, allow_nan=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise BodyError(
            "`ReducedBody.facts` must be finite numbers, texts, and lists and mappings of them, "
            f"got something else: {error}. Leave it out, or write it as a text."
        ) from error
    return arrays, text


def _plain(value: object) -> object:
    """NumPy's numbers and arrays, and mappings of any kind, as JSON knows them."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"a value of the type {type(value).__name__}")


def _versions() -> dict[str, str]:
    found = {}
    for package in ("jaxgear", "numpy", "scipy", "scikit-fem"):
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def _digest(arrays: Mapping[str, np.ndarray], about: str) -> str:
    """SHA-256 of the text, then name, type, shape and bytes of every array, sorted by name."""
    digest = hashlib.sha256(about.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"\0{name} {array.dtype.str} {array.shape}\0".encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def _bytes(text: str) -> np.ndarray:
    return np.frombuffer(text.encode(), dtype=np.uint8)


def _text(array: np.ndarray) -> str:
    return array.tobytes().decode()


def _members(path: Path, wanted: tuple[str, ...] | None) -> dict[str, np.ndarray]:
    """Arrays of an npz file, all or the wanted ones, or the reason why there are none."""
    require(
        path.is_file(),
        "There is no file {path}. Condense the body, which writes it, or correct the path.",
        path=path,
    )
    with open(path, "rb") as file:
        start = file.read(4)
    require(
        start == b"PK\3\4",
        "The file {path} is not that of a condensed body, which is an npz archive. Name the file "
        "that condensing wrote; matrices from elsewhere are to be imported first.",
        path=path,
    )
    try:
        # Opened here, as NumPy leaves a file open that it cannot read.
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            names = wanted if wanted else archive.files
            return {name: archive[name] for name in names if name in archive.files}
    except (zipfile.BadZipFile, EOFError, ValueError, KeyError, NotImplementedError) as error:
        # The list of contents stands at the end of the archive: it goes first when a copy stops.
        whole = zipfile.is_zipfile(path)
        reason = "was altered after it was written" if whole else "is truncated"
        raise BodyError(f"The file {path} {reason} ({error}). {AGAIN}") from error


def _about(members: Mapping[str, np.ndarray], path: object) -> tuple[dict, str]:
    """The text about a body, once it is known that this version can read the rest."""
    require(
        all(name in members for name in _TEXTS),
        "The file {path} holds arrays, but not those of a condensed body. Name the file that "
        "condensing wrote; matrices from elsewhere are to be imported first.",
        path=path,
    )
    try:
        text = _text(members["about"])
        about = json.loads(text)
        found, units = about["format"], about["units"]
    except (ValueError, KeyError, TypeError) as error:
        raise BodyError(
            f"The file {path} was altered after it was written: its text cannot be read. {AGAIN}"
        ) from error
    require(
        found == FORMAT,
        "The file {path} must have format {want}, got {found}. {advice}",
        path=path,
        want=FORMAT,
        found=found,
        advice="Condense the body again with this version of jaxgear."
        if not isinstance(found, int) or found < FORMAT
        else "It comes from a newer jaxgear: update, or condense the body again.",
    )
    require(
        units == UNITS,
        "The file {path} must be in {want}, got {units}. It was not written by jaxgear: import its "
        "matrices, which states their units.",
        path=path,
        want=UNITS,
        units=units,
    )
    return about, text
