"""Pictures of searches and of the map of tip relief, and their tables."""

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from jaxgear._columns import Table
from jaxgear.plot._cycle import largest_pressure, unrolled
from jaxgear.plot._picture import Datasets, Picture, columns, drawn, numbers


def searches_pictures(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `search_...`, `pareto` and `robust_...`."""
    before, after = (datasets.get(f"search_{name}") for name in ("before", "after"))
    if before is not None and after is not None:
        draw = drawn("_search_pictures.before_after", before, after)
        table = _curves({"before": before, "after": after}, pressure=True)
        yield Picture("before_after", draw, table)
    for name, group in (("search", "search_trace"), ("pareto", "pareto")):
        if (found := datasets.get(group)) is not None:
            draw = drawn(f"_search_pictures.{group}", found)
            yield Picture(name, draw, columns(found, *numbers(found)))
    gears, hardened = datasets.get("robust_gears"), datasets.get("search_robust")
    if gears is not None and after is not None and hardened is not None:
        draw = drawn("_search_pictures.robust", gears, after, hardened)
        ((name, values),) = gears.data_vars.items()
        rising = gears.assign({name: (values.dims, np.sort(values.values, axis=1))})
        errors = _curves({"nominal": after, "robust": hardened})
        table = columns(rising, "design", str(name))
        yield Picture("robust", draw, table, {"transmission_error": errors})
    if (found := datasets.get("robust_influences")) is not None:
        table = columns(found, "quantity", "moved")
        for design in found["design"].values:
            own = columns(found.sel(design=design), "quantity", *numbers(found)[1:])
            more = {f"{design}_{name}": own[name] for name in own if name != "quantity"}
            table |= more
        yield Picture("tornado", drawn("_search_pictures.tornado", found), table)


def _curves(designs: Mapping[str, xr.Dataset], *, pressure: bool = False) -> Table:
    """Curves over the cycle of several designs, one under the other."""
    parts: list[dict[str, np.ndarray]] = []
    for name, dataset in designs.items():
        phase = dataset["phase"].values
        place, error = unrolled(phase, dataset["transmission_error_um"].values)
        rows = {"design": np.full(len(place), name), "phase": place, "transmission_error_um": error}
        if pressure:
            rows["max_pressure_MPa"] = unrolled(phase, largest_pressure(dataset))[1]
        parts.append(rows)
    return Table.joined(parts)


def relief_map_pictures(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `relief_...` and `smoothing_bias`."""
    chart, valley = datasets.get("relief_map"), datasets.get("relief_valley")
    if chart is not None and valley is not None:
        search = datasets.get("relief_search")
        draw = drawn("_relief_pictures.master_curve", chart, valley, search)
        table = columns(chart, "depth_um", "extent", "te_rms_um")
        beside = {"valley": columns(valley, "extent", *numbers(valley))}
        yield Picture("master_curve", draw, table, beside)
    if (curve := datasets.get("relief_curve")) is not None:
        draw = drawn("_relief_pictures.traced_curve", curve)
        table = columns(curve, "extent", *numbers(curve))
        yield Picture("master_curve_traced", draw, table.known("depth_um"))
    curves = datasets.get("relief_torques")
    if chart is not None and curves is not None:
        draw = drawn("_relief_pictures.family", chart, curves)
        table = columns(curves, "torque_Nm", "extent", *numbers(curves))
        yield Picture("master_curve_torques", draw, table.known("depth_um"))
    if (bias := datasets.get("smoothing_bias")) is not None:
        draw = drawn("_relief_pictures.smoothing_bias", bias)
        names = ("width_um", "te_mean_bias_um", "te_rms_bias_relative")
        yield Picture("smoothing_bias", draw, columns(bias, *names))
