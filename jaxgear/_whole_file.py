"""Files that appear whole or not at all: texts, JSON, tables and datasets."""

import contextlib
import csv
import errno
import json
import math
import os
import secrets
import shutil
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    import xarray as xr


# A dataset needs as much space besides its arrays [byte].
_ROOM = 1 << 16


@contextlib.contextmanager
def whole_file(path: Path) -> Generator[Path]:
    """Give a draft's path in the same folder, which replaces `path` if nothing goes wrong.

    **Arguments:**

    - `path`: of the file to be.
    """
    # The ending stays last: writers choose a format by it.
    # Processes in containers of one cluster have the same numbers.
    draft = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        yield draft
        # On the disc before the name is: a machine that fails leaves the old file or the new one.
        # Windows brings only files there that are open for writing.
        with draft.open("r+b") as file:
            os.fsync(file.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def write_text(text: str, path: Path) -> None:
    """Write a text as UTF-8, whole.

    **Arguments:**

    - `text`: all of it, with the end of its last line.
    - `path`: of the file.
    """
    with whole_file(path) as draft:
        draft.write_bytes(text.encode())


def write_dataset(
    dataset: "xr.Dataset", path: Path, groups: "Mapping[str, xr.Dataset] | None" = None
) -> None:
    """Write a dataset as netCDF4.

    **Arguments:**

    - `dataset`: at the root of the file; it may be empty.
    - `path`: of the file.
    - `groups`: further datasets under their names, to be read with `group=`.

    **Raises:**

    - `OSError` if it cannot be written, of a full disk with its number.
    """
    size = sum(each.nbytes for each in (dataset, *(groups or {}).values()))
    with whole_file(path) as draft:
        try:
            _write_groups({"/": dataset, **(groups or {})}, draft)
        except (OSError, RuntimeError) as error:
            # The library calls a full disk by other names.
            if shutil.disk_usage(path.parent).free < size + _ROOM:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
            if isinstance(error, OSError):
                raise
            raise OSError(errno.EIO, str(error), str(path)) from error


def _write_groups(datasets: "Mapping[str, xr.Dataset]", path: Path) -> None:
    """Write datasets as groups of one file, opened once: each opening costs as much as a group."""
    import netCDF4
    from xarray.backends import NetCDF4DataStore

    with netCDF4.Dataset(path, mode="w", format="NETCDF4") as file:
        for name, dataset in datasets.items():
            dataset.dump_to_store(NetCDF4DataStore(file.createGroup(name)))


def write_json(summary: Mapping[str, object], path: Path) -> None:
    """Write a summary as JSON: arrays as lists, and what is not a finite number as null."""
    text = json.dumps(as_json(summary), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(text + "\n", path)


def as_json(value: Any) -> object:
    """The value in the types that JSON knows; what is not a finite number is null.

    **Arguments:**

    - `value`: numbers, texts, arrays, lists and tables of them.
    """
    if isinstance(value, Mapping):
        return {str(key): as_json(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(each) for each in value]
    if isinstance(value, float):
        # NumPy's own double is a float too.
        return float(value) if math.isfinite(value) else None
    if isinstance(value, str | int | None):
        return value
    if hasattr(value, "tolist"):
        return as_json(value.tolist())
    raise TypeError(f"A summary holds numbers, texts, lists and tables, got {type(value)}.")


def write_csv(columns: Mapping[str, Any], path: Path, digits: int = 10) -> None:
    """Write one table as CSV, a row for each record, with ten digits.

    **Arguments:**

    - `columns`: numbers or texts under their names, units included, all of one length. The cell of
        what is not a finite number, or None, is empty.
    - `path`: of the file.
    - `digits`: of each number; 17 give back the same one.

    **Raises:**

    - `ValueError` if a column is not one-dimensional, or not as long as the others.
    """
    # Files of text are written where no number is needed.
    import numpy as np

    texts = []
    for name, values in columns.items():
        array = np.asarray(values)
        if array.ndim != 1:
            raise ValueError(f"Column `{name}` must be one-dimensional, got shape {array.shape}.")
        texts.append([_cell(x, digits) for x in array.tolist()])
    lengths = {name: len(each) for name, each in zip(columns, texts, strict=True)}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"The columns of a table must have one length, got {lengths}.")
    with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*texts, strict=True))


def _cell(value: object, digits: int) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    number = cast(float, value)
    return f"{number:.{digits}g}" if math.isfinite(number) else ""
