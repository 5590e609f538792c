"""Digests of results folders, small enough to keep: numbers to rounding, texts to the character.

Of an array stay its shape and three weighted sums; two arrays whose sums agree to 1e-12 of what is
summed agree in every number that matters. Pictures are compared as SVG: their text to the
character, their coordinates as numbers.
"""

import csv
import hashlib
import json
import math
import re
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

_NUMBER = re.compile(r"(?<![#\w])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
# Pixels of an image within a picture, which hold no numbers; its place and size stay.
_PIXELS = re.compile(r"(?<=;base64,)[^\"]*")
# What the machine decides: seconds, and whether a body or a program was kept from before. Hashes
# of bodies have versions of libraries in them.
_OF_THE_MACHINE = re.compile(
    # What is left of equations that are solved to rounding is rounding.
    r"_s$|seconds|cost|time|cached|from_cache|version|memory|path|folder|compiled|programs|residual"
    r"|cache_key|content_hash",
    re.I,
)
_SUMS = 3
# Smaller numbers, in the units of files, are what rounding leaves of zero.
_NOTHING = 1e-10


def of_folder(folder: Path) -> dict[str, Any]:
    """Digest of every file of a results folder, by its path within."""
    found = {}
    for file in sorted(folder.rglob("*")):
        if file.is_file() and file.name != ".jaxgear.json":
            found[file.relative_to(folder).as_posix()] = _of_file(file)
    return found


def _of_file(file: Path) -> Any:
    match file.suffix:
        case ".json":
            return _flat(json.loads(file.read_text(encoding="utf-8")))
        case ".csv":
            return _of_csv(file)
        case ".nc":
            return _of_dataset(file)
        case ".svg":
            return _of_text(file.read_text(encoding="utf-8"))
        case ".toml":
            return file.read_text(encoding="utf-8").splitlines()
    # What else there is, PNG and bodies, must be there.
    return "there"


def _flat(value: Any, path: str = "") -> dict[str, Any]:
    """Every leaf of nested tables under its path, but for what the machine decides."""
    if path and _OF_THE_MACHINE.search(path.rpartition("/")[2]):
        return {}
    if isinstance(value, Mapping):
        rows = value.items()
    elif isinstance(value, list) and not all(isinstance(each, int | float) for each in value):
        rows = enumerate(value)
    elif isinstance(value, list):
        return {path: _of_numbers(np.asarray(value, dtype=float))}
    else:
        return {path: value}
    found: dict[str, Any] = {}
    for key, each in rows:
        found |= _flat(each, f"{path}/{key}")
    return found


def _of_csv(file: Path) -> dict[str, Any]:
    with file.open(encoding="utf-8", newline="") as lines:
        header, *rows = csv.reader(lines)
    found = {}
    for name, column in zip(header, zip(*rows, strict=True), strict=False):
        if _OF_THE_MACHINE.search(name):
            continue
        try:
            found[name] = _of_numbers(np.asarray([float(x or "nan") for x in column]))
        except ValueError:
            found[name] = _hash("\n".join(column))
    return {"header": header, "rows": len(rows), "columns": found}


def _of_dataset(file: Path) -> dict[str, Any]:
    found = {}
    for group, tree in xr.open_groups(file).items():
        for name, variable in tree.variables.items():
            if _OF_THE_MACHINE.search(str(name)):
                continue
            values = variable.values
            numbers = np.issubdtype(values.dtype, np.number)
            found[f"{group}:{name}"] = {
                "dims": list(variable.dims),
                "attributes": {key: str(value) for key, value in variable.attrs.items()},
                "values": _of_numbers(values) if numbers else _hash(repr(values.tolist())),
            }
    return found


def _of_text(text: str) -> dict[str, Any]:
    text = _PIXELS.sub("", text)
    # Where a line is drawn through thousands of places, their digits are numbers.
    numbers = np.asarray([float(each) for each in _NUMBER.findall(text)])
    return {"text": _hash(_NUMBER.sub("#", text)), "numbers": _of_numbers(numbers)}


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _of_numbers(values: np.ndarray) -> list[Any]:
    """Shape, count of numbers that are none, size of what is summed, and weighted sums."""
    flat = np.asarray(values, dtype=float).ravel()
    finite = np.isfinite(flat)
    weights = np.random.default_rng(flat.size).uniform(0.5, 1.0, (_SUMS, flat.size))
    weights[:, 1::2] *= -1.0
    kept = np.where(finite, flat, 0.0)
    return [
        list(np.shape(values)),
        int(np.sum(~finite)),
        float(np.sum(np.abs(kept))),
        *(float(x) for x in weights @ kept),
    ]


def differences(was: Any, now: Any, tolerance: float, path: str = "") -> list[str]:
    """Where two digests differ, a line each."""
    if isinstance(was, dict) and isinstance(now, dict):
        found = [f"{path}/{key}: missing" for key in was.keys() - now.keys()]
        found += [f"{path}/{key}: new" for key in now.keys() - was.keys()]
        for key in sorted(was.keys() & now.keys()):
            found += differences(was[key], now[key], tolerance, f"{path}/{key}")
        return found
    if _is_numbers(was) and _is_numbers(now):
        if was[:2] != now[:2]:
            return [f"{path}: shape and gaps {was[:2]}, now {now[:2]}"]
        far = max(abs(a - b) for a, b in zip(was[2:], now[2:], strict=True))
        size = max(was[2], 1e-300)
        return [f"{path}: {far / size:.1e} of its size"] if far > tolerance * size else []
    if isinstance(was, float) and isinstance(now, int | float):
        same = math.isclose(was, now, rel_tol=tolerance, abs_tol=_NOTHING)
        return [] if same else [f"{path}: {was!r}, now {now!r}"]
    if isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        found = []
        for index, (a, b) in enumerate(zip(was, now, strict=True)):
            found += differences(a, b, tolerance, f"{path}[{index}]")
        return found
    return [] if was == now else [f"{path}: {_shown(was)}, now {_shown(now)}"]


def _shown(value: Any) -> str:
    return textwrap.shorten(repr(value), 160)


def _is_numbers(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 + _SUMS and isinstance(value[0], list)


def of_lines(text: str) -> list[str]:
    """The lines of what a command says, numbers apart, but for what the machine decides."""
    lines = [line for line in text.splitlines() if not _OF_THE_MACHINE.search(line.split(" ")[0])]
    return [_NUMBER.sub("#", line) for line in lines]
