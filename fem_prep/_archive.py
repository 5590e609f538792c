"""One npz file for what was condensed: written whole or not at all, refused if anything is wrong.

It is an uncompressed npz without pickled objects: arrays, and two members that are texts, as bytes
of UTF-8: `about`, a JSON object with `format`, `units`, `versions` and more, and `hash`, the
SHA-256 of all others, see `content_digest`.
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

from ._artefact import FORMAT, UNITS
from ._body_checks import AGAIN
from ._checks import BodyError, require

TEXTS = ("about", "hash")
# Whose versions a file names.
_LIBRARIES = ("jaxgear", "numpy", "scipy", "scikit-fem")


def archive_text(about: Mapping[str, object]) -> str:
    """What an archive says of itself, as JSON.

    **Arguments:**

    - `about`: `name`, `facts` and more; format, units and versions are added.

    **Raises:**

    - `BodyError` if the facts cannot be written.
    """
    whole = {
        "format": FORMAT,
        "units": UNITS,
        **about,
        "versions": {name: _version(name) for name in _LIBRARIES},
    }
    try:
        return json.dumps(whole, sort_keys=True, allow_nan=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise BodyError(
            "`ReducedBody.facts` must be finite numbers, texts, and lists and mappings of them, "
            f"got something else: {error}. Leave it out, or write it as a text."
        ) from error


def write_archive(path: str | os.PathLike, arrays: Mapping[str, np.ndarray], text: str) -> str:
    """Write an archive, whole or not at all.

    **Arguments:**

    - `path`: of the file; one that is there is replaced.
    - `arrays`: by name.
    - `text`: from `archive_text`.

    **Returns:**

    The content's hash.

    **Raises:**

    - `OSError` if the file cannot be written.
    """
    digest = content_digest(arrays, text)
    held: dict[str, Any] = {"about": _bytes(text), "hash": _bytes(digest), **arrays}
    target = Path(path)
    # In the same folder, as a file can only be renamed within one file system.
    draft = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
    try:
        with open(draft, "xb") as file:
            np.savez(file, **held)
            file.flush()
            os.fsync(file.fileno())
        os.replace(draft, target)
    finally:
        draft.unlink(missing_ok=True)
    return digest


def read_archive(path: str | os.PathLike) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read an archive.

    **Arguments:**

    - `path`: of a file that `write_archive` wrote.

    **Returns:**

    Its arrays, and what it says of itself.

    **Raises:**

    - `BodyError` if there is no such file; if it is another one's, truncated or altered; or if its
        format or its units are others.
    """
    members = _members(Path(path), None)
    about, text = _about(members, path)
    arrays = {name: array for name, array in members.items() if name not in TEXTS}
    require(
        content_digest(arrays, text) == _text(members["hash"]),
        "The file {path} was altered after it was written: its content does not match its hash. "
        + AGAIN,
        path=path,
    )
    return arrays, about


def read_about(path: str | os.PathLike) -> dict[str, Any]:
    """What a file says of itself in words, without reading its matrices.

    **Arguments:**

    - `path`: of a file that `write_archive` wrote.

    **Returns:**

    What it says, and `hash`; the matrices are not checked against it.

    **Raises:**

    - `BodyError` if it is no such file, or of another format or other units.
    """
    members = _members(Path(path), TEXTS)
    about, _ = _about(members, path)
    return {**about, "hash": _text(members["hash"])}


def content_digest(arrays: Mapping[str, np.ndarray], about: str) -> str:
    """SHA-256 of the text, then name, type, shape and bytes of every array, sorted by name."""
    digest = hashlib.sha256(about.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"\0{name} {array.dtype.str} {array.shape}\0".encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def _plain(value: object) -> object:
    """NumPy's numbers and arrays, and mappings of any kind, as JSON knows them."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"a value of the type {type(value).__name__}")


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


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
        all(name in members for name in TEXTS),
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
        isinstance(found, int) and 1 <= found <= FORMAT,
        "The file {path} must have format {want}, got {found}. {advice}",
        path=path,
        want=FORMAT,
        found=found,
        advice="Condense the body again with this version of jaxgear."
        if not isinstance(found, int) or found < 1
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
