"""Condensed bodies kept in the user's cache folder, each under the hash of what it was made from.

The cache only saves time: where it cannot be read or written, work goes on without it and a
`CacheWarning` says so.
"""

import contextlib
import dataclasses
import hashlib
import importlib.metadata
import json
import os
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
import platformdirs

from ._archive import read_about
from ._artefact import FORMAT
from ._body_file import read_body, write_body
from ._checks import BodyError, require

# Raised whenever the same inputs would give another body than before.
METHOD = 2

# Of all bodies together [byte]; those that were not used for longest go first.
LIMIT = 5_000_000_000

# A body says by this fact what it was made from: the name of its file may be wrong.
MADE_FROM = "made_from"

# Nobody writes to a draft that is as old as this any more [s].
_STALE = 3600.0

# Files are read in pieces of this size [byte].
_PIECE = 1 << 20


class CacheWarning(UserWarning):
    """The cache is of no use just now; the work is done all the same."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """A body in the cache.

    **Fields:**

    - `key`: hash of what it was made from.
    - `name`: of the body; empty if its file cannot be read.
    - `size`: of its file [byte].
    - `used`: when it was last read or written [s since 1970].
    """

    key: str
    name: str
    size: int
    used: float


def cache_folder() -> Path | None:
    """Where bodies are kept, None if they are not: below `$JAXGEAR_CACHE`, unless that is `off`.

    Without it, below the user's cache folder of the system.
    """
    own = os.environ.get("JAXGEAR_CACHE")
    if own == "off":
        return None
    # No author and no more words than the name: the same folder as that of compiled programs.
    user = platformdirs.user_cache_path("jaxgear", appauthor=False, opinion=False)
    return (Path(own).expanduser() if own else user) / "bodies"


def key_of(inputs: Mapping[str, object]) -> str:
    """Hash of everything that a body is made from.

    The format of the file, the number of the method and the version of jaxgear are part of it.

    **Arguments:**

    - `inputs`: by name: numbers, texts, arrays, dataclasses, and lists and mappings of them. Of a
        file, its content: `file_digest(path)`.

    **Returns:**

    SHA-256 as 64 hexadecimal digits.

    **Raises:**

    - `TypeError` if something else is among the inputs.
    """
    whole = {
        "format": FORMAT,
        "method": METHOD,
        "version": _version(),
        "inputs": _plain(inputs),
    }
    text = json.dumps(whole, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _version() -> str:
    """Version of jaxgear that is installed; empty if none is."""
    try:
        return importlib.metadata.version("jaxgear")
    except importlib.metadata.PackageNotFoundError:
        return ""


def file_digest(path: str | os.PathLike) -> str:
    """SHA-256 of the bytes of a file."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while piece := file.read(_PIECE):
            digest.update(piece)
    return digest.hexdigest()


class _HasFacts(Protocol):
    """What can be kept: a dataclass that says what else is known of it."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def facts(self) -> Mapping[str, object]: ...


# A body, or something else that is made offline and has facts and a file.
Kept = TypeVar("Kept", bound=_HasFacts)
_BodyFile = (read_body, write_body)


def cached(
    key: str,
    build: Callable[[], Kept],
    file: tuple[Callable[[Path], Kept], Callable[[Path, Kept], object]] = _BodyFile,  # ty: ignore[invalid-parameter-default]
) -> tuple[Kept, bool]:
    """A body from the cache, or built and kept there.

    Several processes may ask for the same body at once: each gets a whole one.

    **Arguments:**

    - `key`: from `key_of`.
    - `build`: makes the body.
    - `file`: reads it from a file, and writes it; without it those of a `ReducedBody`.

    **Returns:**

    The body, and whether it came from the cache.
    """
    folder = cache_folder()
    if folder is None:
        return _made(key, build), False
    path = folder / f"{key}.npz"
    read, write = file
    if path.is_file():
        try:
            body = read(path)
            require(
                body.facts.get(MADE_FROM) == key,
                "The file {path} holds a body that was made from something else.",
                path=path,
            )
        except (BodyError, OSError) as error:
            _warn(f"A condensed body in the cache cannot be used and is made anew. {error}")
        else:
            _mark_used(path)
            return body, True
    body = _made(key, build)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write(path, body)
    except OSError as error:
        _warn(
            f"The condensed body cannot be kept in {folder} ({error.strerror or error}) and "
            "will be made anew each time. Free space there, or set JAXGEAR_CACHE to a folder that "
            "can be written to."
        )
    _tidy(path)
    return body, False


def _made(key: str, build: Callable[[], Kept]) -> Kept:
    """A new body that says what it was made from."""
    body = build()
    return dataclasses.replace(body, facts={**body.facts, MADE_FROM: key})


def _tidy(newest: Path) -> None:
    """Remove what killed processes have left, and old bodies until the rest is within the limit."""
    for path in _files(".*.tmp"):
        with contextlib.suppress(OSError):
            if path.stat().st_mtime < time.time() - _STALE:
                path.unlink()
    found = []
    for path in _files("*.npz"):
        with contextlib.suppress(OSError):
            about = path.stat()
            found.append((about.st_mtime, about.st_size, path))
    excess = sum(size for _, size, _ in found) - LIMIT
    for _, size, path in sorted(found):
        if excess > 0 and path != newest:
            with contextlib.suppress(OSError):
                path.unlink()
                excess -= size


def cache_entries() -> list[Entry]:
    """All bodies in the cache, the last used first."""
    found = []
    for path in _files("*.npz"):
        try:
            facts = path.stat()
        except OSError:  # Another process cleared it.
            continue
        try:
            about = read_about(path)
            name = str(about.get("name") or about.get("kind", ""))
        except (BodyError, OSError):
            name = ""
        found.append(Entry(path.stem, name, facts.st_size, facts.st_mtime))
    return sorted(found, key=lambda entry: -entry.used)


def clear_cache(keys: Iterable[str] | None = None) -> int:
    """Remove bodies from the cache.

    **Arguments:**

    - `keys`: of the bodies; all, and what broken-off work has left, without it.

    **Returns:**

    What was freed [byte].
    """
    paths = _files("*.npz")
    if keys is None:
        paths += _files(".*.tmp")
    else:
        wanted = set(keys)
        paths = [path for path in paths if path.stem in wanted]
    freed = 0
    for path in paths:
        try:
            size = path.stat().st_size
            path.unlink()
        except OSError:
            continue
        freed += size
    return freed


def _files(pattern: str) -> list[Path]:
    folder = cache_folder()
    try:
        return sorted(folder.glob(pattern)) if folder else []
    except OSError:
        return []


def _mark_used(path: Path) -> None:
    # Only its place in the list suffers: a folder that is read only is of use all the same.
    with contextlib.suppress(OSError):
        os.utime(path)


def _warn(message: str) -> None:
    # Python says one message from one place once only, unless told otherwise.
    warnings.warn(message, CacheWarning, stacklevel=3)


def _plain(value: object) -> object:
    """What JSON knows, with a hash in the place of every array."""
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        kind = array.dtype.newbyteorder("<")
        if kind.hasobject:
            raise TypeError("An array of objects has no content that could be hashed.")
        content = hashlib.sha256(array.astype(kind, copy=False).tobytes()).hexdigest()
        return {"array": content, "dtype": kind.str, "shape": list(array.shape)}
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
        return {"class": type(value).__name__, "fields": _plain(fields)}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(
        f"What a body is made from must be numbers, texts, arrays or dataclasses, got "
        f"{type(value).__name__}. Of a file give its `file_digest`."
    )
