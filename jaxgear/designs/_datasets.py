"""Results of designs as datasets: of a chunk, and of all chunks together."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from jaxgear._columns import Table
from jaxgear.designs._asked import Study
from jaxgear.designs._chunks import Chunk
from jaxgear.designs._evaluate import Rows
from jaxgear.scene._schema import unit_of
from jaxgear.study._results import unit_of_name

# Arrays of designs, and what says where these are.
_ARRAY, _PLACES = "array", " of the design"


def chunk_dataset(study: Study, chunk: Chunk, rows: Rows) -> xr.Dataset:
    """The results of a chunk: a variable for each column, and for each array.

    **Arguments:**

    - `study`: says what is kept.
    - `chunk`: the designs.
    - `rows`: what was found of them.
    """
    keep, names = study.asked.keep, np.asarray(study.asked.keep.numbers)
    keys = {
        key: _entry("design", _column([row[key] for row in rows.values]), unit_of(key), key, "key")
        for key in rows.values[0]
    }
    numbers = {
        name: _entry("design", rows.numbers[:, place], unit_of_name(name)[0], name, "number")
        for place, name in enumerate(keep.numbers)
    }
    found = {**keys, **numbers, "reason": _reasons(rows.reasons)}
    if keep.gradients:
        dims, words = ("design", "number", "moved"), "derivative of a number by a key"
        found["gradient"] = _entry(dims, rows.slopes, "number/key", words, "gradient")
    for name, arrays in rows.arrays.items():
        label = name if name in keep.arrays else f"{name}{_PLACES}"
        found[label] = _stacked(arrays, len(rows.values))
    coordinates = {"design": _entry("design", np.asarray(chunk.designs), "", "design")}
    if keep.gradients:
        coordinates |= {
            "number": _entry("number", names, "", "what is differentiated"),
            "moved": _entry("moved", np.asarray(rows.moved), "", "by which key"),
        }
    return xr.Dataset(found, coords=coordinates)


def _entry(
    dims: str | tuple[str, ...], values: np.ndarray, unit: str, words: str, role: str = ""
) -> xr.Variable:
    return xr.Variable(dims, values, {"units": unit or "1", "long_name": words, "role": role})


def _column(values: Sequence[object]) -> np.ndarray:
    """Values of a key: numbers where all are, else texts."""
    plain = all(isinstance(x, int | float) and not isinstance(x, bool) for x in values)
    return np.asarray(values) if plain else np.asarray([str(x) for x in values], dtype=object)


def _reasons(reasons: Sequence[str]) -> xr.Variable:
    texts = np.asarray(reasons, dtype=object)
    return _entry("design", texts, "", "why a design has no results", "reason")


def _stacked(arrays: dict[int, xr.Variable], count: int) -> xr.Variable:
    """Arrays of some designs of so many, one behind the other; of unequal ones the rest is NaN.

    Of texts the rest is empty.
    """
    first = next(iter(arrays.values()))
    shape = np.max([each.shape for each in arrays.values()], axis=0)
    are_texts = first.dtype.kind in "OUS"
    whole = np.full((count, *shape), "" if are_texts else np.nan, object if are_texts else float)
    for place, each in arrays.items():
        whole[(place, *map(slice, each.shape))] = each.values
    told = {**first.attrs, "role": _ARRAY}
    return xr.Variable(("design", *first.dims), whole, told)


def together(files: Iterable[Path]) -> xr.Dataset:
    """The results of chunks as one dataset, in the order of the designs.

    **Arguments:**

    - `files`: of chunks, one at least.
    """
    parts = []
    for file in files:
        with xr.open_dataset(file, engine="netcdf4") as part:
            parts.append(part.load())
    sizes: dict[str, int] = {}
    for part in parts:
        sizes |= {str(dim): max(size, sizes.get(str(dim), 0)) for dim, size in part.sizes.items()}
    parts = [_filled(part, sizes) for part in parts]
    whole = xr.concat(
        parts, "design", data_vars="all", coords="minimal", compat="override", join="outer",
        combine_attrs="override",
    )  # fmt: skip
    whole = whole.sortby("design")
    for name in [str(each) for each in whole.data_vars if str(each).endswith(_PLACES)]:
        places = whole[name]
        # Of a design without results there are none.
        there = places.notnull().values
        if places.dtype.kind in "OUS":
            there &= places.values != ""
        known = places.values[there.all(axis=1)]
        if len(known) and ((places.values == known[0]) | ~there).all():
            own = xr.Variable(places.dims[1:], known[0], places.attrs)
            whole = whole.drop_vars(name).assign_coords({name.removesuffix(_PLACES): own})
    return whole


def _filled(part: xr.Dataset, sizes: Mapping[str, int]) -> xr.Dataset:
    """The results of a chunk, arrays that are longer in others filled up to their size."""
    found = {}
    for name, each in part.data_vars.items():
        more = {
            dim: (0, sizes[str(dim)] - size)
            for dim, size in each.sizes.items()
            if dim != "design" and size < sizes[str(dim)]
        }
        if more:
            nothing: Any = "" if each.dtype.kind in "OUS" else np.nan
            found[name] = each.variable.pad(more, constant_values=nothing)
    return part.drop_vars(found).assign(found)


def columns_of(designs: xr.Dataset) -> Table:
    """The table of all designs: number, keys, numbers, derivatives, reason; units in the names.

    **Arguments:**

    - `designs`: from `together`.
    """
    role = lambda name: [str(x) for x in designs.data_vars if designs[x].attrs.get("role") == name]
    found = {"design": designs["design"].values}
    found |= {name: designs[name].values for name in (*role("key"), *role("number"))}
    if "gradient" in designs:
        for number in designs["number"].values.tolist():
            for key in designs["moved"].values.tolist():
                slope = designs["gradient"].sel(number=number, moved=key)
                found[f"d {number} / d {key}"] = slope.values
    return Table(found | {"reason": designs["reason"].values})
