"""Orders and spectra as functions of universal files, dataset 58: written, and measured ones read.

The format: "Universal File Datasets Summary", dataset 58, of the Structural Dynamics Research Lab,
University of Cincinnati. Written as text in double precision, in SI. Amplitudes are peak values.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from jaxgear._checks import InputError, require
from jaxgear._whole_file import write_text

# Types of functions, and of what is on an axis.
_SPECTRUM, _ORDER_CUT = 12, 27
_DISPLACEMENT, _FORCE, _FREQUENCY, _RPM, _ORDER = 8, 9, 18, 19, 20
# Real, double precision.
_DOUBLE = 4
# Orders of a sweep: the unit in the file, what a number is in it, the type.
_ORDINATES = {"um": ("m", 1e-6, _DISPLACEMENT), "N": ("N", 1.0, _FORCE)}


class Axis(NamedTuple):
    """One axis of a function.

    **Fields:**

    - `quantity`: the type of its data, by dataset 58: 18 frequency, 19 rpm, 20 order; 0 unknown.
    - `label`: what it is.
    - `unit`: as text.
    """

    quantity: int
    label: str
    unit: str


class Function58(NamedTuple):
    """A function of dataset 58.

    **Fields:**

    - `kind`: its type: 12 a spectrum, 27 an order cut, 1 a record over time, others by the dataset.
    - `name`: its first line.
    - `abscissa`: axis of `x`.
    - `ordinate`: axis of `values`.
    - `z_axis`: axis of `z`.
    - `x`: where the values are.
    - `values`: real or complex.
    - `z`: speed of a spectrum, order of a cut.
    """

    kind: int
    name: str
    abscissa: Axis
    ordinate: Axis
    z_axis: Axis
    x: np.ndarray
    values: np.ndarray
    z: float


def functions_of_sweep(sweep: xr.Dataset) -> Iterator[Function58]:
    """Order cuts over speed and spectra over frequency of all orders in a sweep.

    **Arguments:**

    - `sweep`: the group `sweep` of a result.
    """
    rpm = sweep["speed"].values * 30.0 / np.pi
    order = sweep["order"].values
    mesh = float(sweep.attrs["teeth_pinion"]) * rpm / 60.0
    speed, of_mesh = Axis(_RPM, "speed of pinion", "rpm"), Axis(_ORDER, "order of mesh", "1")
    frequency = Axis(_FREQUENCY, "frequency", "Hz")
    for name, table in _tables(sweep):
        unit, factor, quantity = _ORDINATES[str(table.attrs["units"])]
        ordinate = Axis(quantity, "peak amplitude", unit)
        amplitude = factor * table.transpose("speed", "order").values
        for index, each in enumerate(order):
            cut = amplitude[:, index]
            title = f"{name}, order {each:g}"
            yield Function58(_ORDER_CUT, title, speed, ordinate, of_mesh, rpm, cut, float(each))
        for index, each in enumerate(rpm):
            at, title = order * mesh[index], f"{name}, {each:.6g} rpm"
            yield Function58(
                _SPECTRUM, title, frequency, ordinate, speed, at, amplitude[index], float(each)
            )


def _tables(sweep: xr.Dataset) -> Iterator[tuple[str, xr.DataArray]]:
    """What a sweep has over speed and order alone, once for each entry of its other dimensions."""
    for name, table in sweep.data_vars.items():
        if {"speed", "order"} <= {*table.dims} and table.attrs.get("units") in _ORDINATES:
            others = [dim for dim in table.dims if dim not in ("speed", "order")]
            for place in itertools.product(*(range(table.sizes[dim]) for dim in others)):
                at = dict(zip(others, place, strict=True))
                words = [
                    f"{sweep[d].values[i]}" if d in sweep else f"{d} {i}" for d, i in at.items()
                ]
                yield " ".join([str(name), *words]), table.isel(at)


def write_functions(functions: Iterable[Function58], path: Path) -> None:
    """Write functions as a universal file, whole or not at all.

    **Arguments:**

    - `functions`: of real values.
    - `path`: of the file.
    """
    lines = (line for number, each in enumerate(functions, 1) for line in _lines(each, number))
    write_text("\n".join(lines) + "\n", path)


def _lines(function: Function58, number: int) -> Iterator[str]:
    x, values = function.x, function.values
    step = float(x[1] - x[0]) if len(x) > 1 else 0.0
    even = function.kind == _SPECTRUM and np.allclose(x, x[0] + step * np.arange(len(x)))
    yield from ("    -1", "    58", f"{function.name[:80]:<80}", f"{'peak amplitudes, SI':<80}")
    yield from ["NONE"] * 3
    entity = f"{'NONE':<10}{0:>10}{0:>4}"
    yield f"{function.kind:>5}{number:>10}{0:>5}{0:>10} {entity} {entity}"
    start, gap = (float(x[0]), step) if even else (0.0, 0.0)
    sizes = f"{_DOUBLE:>10}{len(x):>10}{int(even):>10}"
    yield f"{sizes}{start:13.5E}{gap:13.5E}{function.z:13.5E}"
    none = Axis(0, "NONE", "NONE")
    for axis in (function.abscissa, function.ordinate, none, function.z_axis):
        exponents = f"{0:>5}" * 3
        yield f"{axis.quantity:>10}{exponents} {axis.label[:20]:<20} {axis.unit[:20]:<20}"
    if even:
        cells, on_line = [f"{value:20.12E}" for value in values], 4
    else:
        pairs = zip(x, values, strict=True)
        cells, on_line = [f"{place:13.5E}{value:20.12E}" for place, value in pairs], 2
    for at in range(0, len(cells), on_line):
        yield "".join(cells[at : at + on_line])
    yield "    -1"


def is_universal_file(path: Path) -> bool:
    """Whether a file begins as a universal file does, or has the name of one."""
    if path.suffix.lower() in (".uff", ".unv"):
        return True
    try:
        with path.open("rb") as file:
            return file.readline(82).strip() == b"-1"
    except OSError:
        return False


def read_functions(path: Path) -> tuple[Function58, ...]:
    """Read the functions of a universal file, such as measured orders and spectra.

    pyuff does it (`pip install 'jaxgear[vibro]'`), text and binary.

    **Arguments:**

    - `path`: of the file.

    **Raises:**

    - `InputError` if pyuff is not there, or the file has no such functions.
    """
    try:
        import pyuff
    except ImportError:
        words = "reading universal files takes pyuff: pip install 'jaxgear[vibro]'."
        raise InputError(f"{path}: {words}") from None
    try:
        file = pyuff.UFF(str(path))
        places = np.flatnonzero(file.get_set_types() == 58)
        sets: list[Any] = [file.read_sets(int(at)) for at in places]
        found = tuple(_function(each) for each in sets)
    # The library raises what it meets: no type of its own.
    except Exception as error:
        raise InputError(f"{path}: not a universal file that can be read: {error}") from None
    require(found, "{path}: no functions (dataset 58) in it.", path=path)
    return found


def _function(found: Mapping[str, Any]) -> Function58:
    def axis(name: str) -> Axis:
        label = "z_axis_axis" if name == "z_axis" else f"{name}_axis"
        texts = (str(found[f"{label}_{each}"]).strip() for each in ("lab", "units_lab"))
        return Axis(int(found[f"{name}_spec_data_type"]), *texts)

    values = np.asarray(found["data"])
    return Function58(
        int(found["func_type"]),
        str(found["id1"]).strip(),
        axis("abscissa"),
        axis("ordinate"),
        axis("z_axis"),
        np.asarray(found["x"], dtype=float),
        values if np.iscomplexobj(values) else values.astype(float),
        float(found["z_axis_value"]),
    )


def table_of_functions(functions: Iterable[Function58]) -> Mapping[str, list[Any]]:
    """Functions as one long table: a row for each value, with what it belongs to.

    **Arguments:**

    - `functions`: to be laid out.
    """
    rows = [
        (
            *(number, each.name, each.kind, each.z, each.z_axis.unit, float(x)),
            *(each.abscissa.unit, float(np.real(value)), float(np.imag(value)), each.ordinate.unit),
        )
        for number, each in enumerate(functions, 1)
        for x, value in zip(each.x, each.values, strict=True)
    ]
    names = "function name kind z z_unit x x_unit real imaginary unit".split()
    return {name: list(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}
