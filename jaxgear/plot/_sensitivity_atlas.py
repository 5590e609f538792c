"""Pictures of sensitivities."""

from collections.abc import Iterator

from jaxgear.plot._picture import Datasets, Picture, columns, drawn


def sensitivity_atlas(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `sensitivity` and `sensitivity_in_motion`."""
    for name in ("sensitivity", "sensitivity_in_motion"):
        if (found := datasets.get(name)) is not None:
            speeds = () if name == "sensitivity" else ("pinion_speed_rad_s",)
            table = columns(found, "response", *speeds, "value", "key", "measure", "sensitivity")
            yield Picture(name, drawn("_sensitivity_pictures.sensitivity", found), table)
