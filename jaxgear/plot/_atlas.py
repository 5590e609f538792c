"""All pictures that datasets allow."""

from collections.abc import Iterator

from jaxgear.plot._modes_atlas import modes_pictures
from jaxgear.plot._picture import Datasets, Picture
from jaxgear.plot._run_atlas import run_pictures
from jaxgear.plot._search_atlas import relief_map_pictures, searches_pictures


def pictures(datasets: Datasets) -> Iterator[Picture]:
    """The pictures that are drawn of datasets, in the order in which they are read.

    **Arguments:**

    - `datasets`: by group, of a result or of its `result.nc`.

    **Returns:**

    Pictures and their tables, one after the other: nothing is drawn unless asked for.
    """
    yield from run_pictures(datasets)
    yield from modes_pictures(datasets)
    yield from searches_pictures(datasets)
    yield from relief_map_pictures(datasets)
