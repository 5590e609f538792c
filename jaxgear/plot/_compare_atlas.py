"""Pictures of comparisons of fidelity levels."""

from collections.abc import Iterator

from jaxgear.plot._picture import Datasets, Picture, columns, drawn


def comparison_pictures(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of comparisons: of each group an overview, and one a response."""
    for group in ("compare", "compare_statics", "compare_teeth"):
        if (found := datasets.get(group)) is None:
            continue
        table = columns(found, *map(str, found.data_vars))
        moving = "error_95_dynamic_ratio" in found
        draw = drawn("_compare_pictures.overview", found)
        yield Picture(f"{group}_overview" if moving else group, draw, table)
        for response in found.attrs["responses"].split():
            name = group if response == "dynamic_ratio" else f"{group}_{response}"
            draw = drawn("_compare_pictures.error_over_time", found, response)
            yield Picture(name, draw, table)
