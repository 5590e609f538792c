"""Pictures of searches and of the map of tip relief, and their tables."""

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import xarray as xr

from jaxgear.plot._cycle import largest_pressure, unrolled
from jaxgear.plot._picture import Columns, Datasets, Picture, columns
from jaxgear.plot._plots import relief_pictures, search_pictures


def searches_pictures(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `search_...`, `pareto` and `robust_...`."""
    before, after = (datasets.get(f"search_{name}") for name in ("before", "after"))
    if before is not None and after is not None:
        draw = partial(search_pictures.before_after, before, after)
        table = _curves({"before": before, "after": after}, pressure=True)
        yield Picture("before_after", draw, table)
    for name, group, draw in (
        ("search", "search_trace", search_pictures.search_trace),
        ("pareto", "pareto", search_pictures.pareto),
    ):
        if (found := datasets.get(group)) is not None:
            yield Picture(name, partial(draw, found), columns(found, *_numbers(found)))
    gears, hardened = datasets.get("robust_gears"), datasets.get("search_robust")
    if gears is not None and after is not None and hardened is not None:
        draw = partial(search_pictures.robust, gears, after, hardened)
        ((name, values),) = gears.data_vars.items()
        rising = gears.assign({name: (values.dims, np.sort(values.values, axis=1))})
        errors = _curves({"nominal": after, "robust": hardened})
        table = columns(rising, "design", str(name))
        yield Picture("robust", draw, table, {"transmission_error": errors})
    if (found := datasets.get("robust_influences")) is not None:
        table = columns(found, "quantity", "moved")
        for design in found["design"].values:
            own = columns(found.sel(design=design), "quantity", *_numbers(found)[1:])
            own.pop("quantity")
            table |= {f"{design}_{name}": values for name, values in own.items()}
        yield Picture("tornado", partial(search_pictures.tornado, found), table)


def _numbers(dataset: xr.Dataset) -> list[str]:
    """Variables of a table but for sentences."""
    return [str(name) for name in dataset.data_vars if name != "reason"]


def _curves(designs: Mapping[str, xr.Dataset], *, pressure: bool = False) -> Columns:
    """Curves over the cycle of several designs, one under the other."""
    parts: list[dict[str, np.ndarray]] = []
    for name, dataset in designs.items():
        phase = dataset["phase"].values
        place, error = unrolled(phase, dataset["transmission_error_um"].values)
        rows = {"design": np.full(len(place), name), "phase": place, "transmission_error_um": error}
        if pressure:
            rows["max_pressure_MPa"] = unrolled(phase, largest_pressure(dataset))[1]
        parts.append(rows)
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def relief_map_pictures(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `relief_...` and `smoothing_bias`."""
    chart, valley = datasets.get("relief_map"), datasets.get("relief_valley")
    if chart is not None and valley is not None:
        search = datasets.get("relief_search")
        draw = partial(relief_pictures.master_curve, chart, valley, search)
        table = columns(chart, "depth_um", "extent", "te_rms_um")
        yield Picture(
            "master_curve", draw, table, {"valley": columns(valley, "extent", *_numbers(valley))}
        )
    if (curve := datasets.get("relief_curve")) is not None:
        draw = partial(relief_pictures.traced_curve, curve)
        yield Picture(
            "master_curve_traced", draw, _known(columns(curve, "extent", *_numbers(curve)))
        )
    curves = datasets.get("relief_torques")
    if chart is not None and curves is not None:
        draw = partial(relief_pictures.family, chart, curves)
        table = columns(curves, "torque_Nm", "extent", *_numbers(curves))
        yield Picture("master_curve_torques", draw, _known(table))
    if (bias := datasets.get("smoothing_bias")) is not None:
        draw = partial(relief_pictures.smoothing_bias, bias)
        names = ("width_um", "te_mean_bias_um", "te_rms_bias_relative")
        yield Picture("smoothing_bias", draw, columns(bias, *names))


def _known(table: Columns) -> Columns:
    """The rows of a table of curves where there is a curve."""
    known = np.isfinite(table["depth_um"])
    return {name: values[known] for name, values in table.items()}
