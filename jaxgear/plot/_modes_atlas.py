"""Pictures of natural modes: where their energy is, and how they meet the mesh."""

from collections.abc import Iterator
from functools import partial

from jaxgear.plot._dynamic_tables import campbell_columns, crossing_columns, modes_columns
from jaxgear.plot._picture import Datasets, Picture
from jaxgear.plot._plots import dynamic_pictures


def modes_pictures(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `modes` and `campbell`."""
    if (found := datasets.get("modes")) is not None:
        draw = partial(dynamic_pictures.modes, found, found.attrs["title"])
        yield Picture("modes", draw, modes_columns(found))
    turning = datasets.get("campbell")
    if turning is not None and "harmonics" in turning.attrs:
        harmonics = int(turning.attrs["harmonics"])
        draw = partial(
            dynamic_pictures.campbell, turning, turning.attrs["title"], harmonics=harmonics
        )
        rows = crossing_columns(turning, harmonics=harmonics)
        yield Picture("campbell", draw, campbell_columns(turning), {"critical": rows})
