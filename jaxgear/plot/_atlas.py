"""All pictures that datasets allow."""

from collections.abc import Iterator

from jaxgear.plot._body_atlas import body_atlas
from jaxgear.plot._compare_atlas import comparison_pictures
from jaxgear.plot._designs_atlas import designs_atlas
from jaxgear.plot._modes_atlas import pictures_of_modes
from jaxgear.plot._picture import Animation, Datasets, Picture
from jaxgear.plot._run_atlas import run_pictures
from jaxgear.plot._search_atlas import relief_map_pictures, searches_pictures
from jaxgear.plot._sensitivity_atlas import sensitivity_atlas
from jaxgear.plot._sweep_atlas import pictures_of_sweep, pictures_of_unbalance
from jaxgear.plot._wave_atlas import animations_of_shapes, pictures_of_waves


def pictures(datasets: Datasets) -> Iterator[Picture]:
    """The pictures that are drawn of datasets, in the order in which they are read.

    **Arguments:**

    - `datasets`: by group, of a result or of its `result.nc`.

    **Returns:**

    Pictures and their tables, one after the other: nothing is drawn unless asked for.
    """
    yield from run_pictures(datasets)
    yield from pictures_of_modes(datasets)
    yield from pictures_of_sweep(datasets)
    yield from pictures_of_unbalance(datasets)
    yield from pictures_of_waves(datasets)
    yield from searches_pictures(datasets)
    yield from relief_map_pictures(datasets)
    yield from comparison_pictures(datasets)
    yield from sensitivity_atlas(datasets)
    yield from body_atlas(datasets)
    yield from designs_atlas(datasets)


def animations(datasets: Datasets) -> Iterator[Animation]:
    """The pictures that move.

    **Arguments:**

    - `datasets`: as of `pictures`.

    **Returns:**

    One after the other: nothing is drawn unless asked for.
    """
    yield from animations_of_shapes(datasets)
