"""All pictures that datasets allow."""

from collections.abc import Iterator

from jaxgear.plot._body_atlas import body_atlas
from jaxgear.plot._modes_atlas import modes_pictures
from jaxgear.plot._picture import Datasets, Picture
from jaxgear.plot._sensitivity_atlas import sensitivity_atlas


def pictures(datasets: Datasets) -> Iterator[Picture]:
    """The pictures that are drawn of datasets, in the order in which they are read.

    **Arguments:**

    - `datasets`: by group, of a result or of its `result.nc`.

    **Returns:**

    Pictures and their tables, one after the other: nothing is drawn unless asked for.
    """
    yield from modes_pictures(datasets)
    yield from sensitivity_atlas(datasets)
    yield from body_atlas(datasets)
