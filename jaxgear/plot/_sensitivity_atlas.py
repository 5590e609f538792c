"""Pictures of sensitivities."""

from collections.abc import Iterator
from functools import partial

from jaxgear.plot._picture import Datasets, Picture, columns
from jaxgear.plot._plots import sensitivity_pictures


def sensitivity_atlas(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `sensitivity` and `sensitivity_in_motion`."""
    for name in ("sensitivity", "sensitivity_in_motion"):
        if (found := datasets.get(name)) is not None:
            speeds = () if name == "sensitivity" else ("pinion_speed_rad_s",)
            table = columns(found, "response", *speeds, "value", "key", "measure", "sensitivity")
            yield Picture(name, partial(sensitivity_pictures.sensitivity, found), table)
