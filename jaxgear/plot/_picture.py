"""A picture of results: what draws it, and the tables that it shows."""

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import xarray as xr

from jaxgear._columns import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Order in which datasets have the gears.
GEARS = ("pinion", "wheel")

# Datasets by group, as a result has them and as `result.nc` holds them.
Datasets = Mapping[str, xr.Dataset]


class Picture(NamedTuple):
    """One picture and its data.

    **Fields:**

    - `name`: of its files, without ending.
    - `draw`: returns the figure. Matplotlib is imported when it is called, and not before.
    - `table`: its data, under names with units, a row for each record.
    - `beside`: more of its data, whose rows are other records, by what tells them apart.
    """

    name: str
    draw: "Callable[[], Figure]"
    table: Table
    beside: Mapping[str, Table] = MappingProxyType({})


def drawn(function: str, *of: Any) -> Callable[..., Any]:
    """How a picture is drawn, in the look that all have.

    **Arguments:**

    - `function`: `module.function` of this package, imported when it draws: matplotlib costs half
        a second.
    - `of`: what it is called with.
    """

    def draw(*more: Any) -> Any:
        module, _, name = function.partition(".")
        from jaxgear.plot._style import house_look

        with house_look():
            return getattr(importlib.import_module(f"jaxgear.plot.{module}"), name)(*of, *more)

    return draw


def columns(dataset: xr.Dataset, *names: str, **renamed: str) -> Table:
    """Variables of a dataset as a table: one row for each place along their dimensions.

    **Arguments:**

    - `dataset`: whose names have units.
    - `names`: of coordinates and variables, in the order of the columns. All are spread over the
        dimensions of all of them, in the order in which these come up.
    - `renamed`: further ones, under the names of their columns.

    **Returns:**

    The table.
    """
    of = dict(zip(names, names, strict=True)) | renamed
    together = xr.broadcast(*(dataset[name] for name in of.values()))
    order = together[0].dims
    spread = (each.transpose(*order).values.ravel() for each in together)
    return Table(dict(zip(of, spread, strict=True)))


def numbers(dataset: xr.Dataset) -> list[str]:
    """Variables of a table but for sentences."""
    return [str(name) for name in dataset.data_vars if name != "reason"]


class Animation(NamedTuple):
    """A picture that moves: a file, without a table.

    **Fields:**

    - `name`: of the file, without the ending .gif.
    - `write`: writes it to a path. Matplotlib is imported when it is called, and not before.
    """

    name: str
    write: Callable[[Path], None]
