"""All pictures that datasets allow."""

from collections.abc import Iterator

from jaxgear.plot._compare_atlas import comparison_pictures
from jaxgear.plot._modes_atlas import modes_pictures
from jaxgear.plot._picture import Datasets, Picture


def pictures(datasets: Datasets) -> Iterator[Picture]:
    """The pictures that are drawn of datasets, in the order in which they are read.

    **Arguments:**

    - `datasets`: by group, of a result or of its `result.nc`.

    **Returns:**

    Pictures and their tables, one after the other: nothing is drawn unless asked for.
    """
    yield from modes_pictures(datasets)
    yield from comparison_pictures(datasets)
