"""Pictures of studies of many designs, and their tables."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from jaxgear.plot._picture import Datasets, Picture, columns, drawn

# Numbers and keys in one picture; the table has all of them.
_NUMBERS, _KEYS = 4, 6
# Steps of a key, each with as many designs, over which a mean is taken.
_STEPS = 8


def designs_atlas(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `designs`, `effects` and `quantiles`."""
    designs, effects = datasets.get("designs"), datasets.get("effects")
    if designs is None:
        return
    solved = designs.isel(design=np.flatnonzero(designs["reason"].values == ""))
    if solved.sizes["design"] < 2:
        return
    keys = _strongest(solved, effects)
    numbers = [x for x in _of_role(solved, "number") if np.isfinite(solved[x].values).any()]
    if not keys or not numbers:
        return
    shown, least = numbers[:_NUMBERS], [x for x in _minimised(solved) if x in numbers]
    means = main_effects(solved, keys, numbers)
    part = means.sel(key=keys[:_KEYS], number=shown)
    table = columns(means, "number", "key", "middle", "mean")
    draw = drawn("_designs_pictures.main_effects", solved, part)
    yield Picture("main_effects", draw, table)
    if effects is not None:
        part = effects.sel(number=shown, first=keys[: 2 * _KEYS], second=keys[: 2 * _KEYS])
        part = part.isel(number=np.flatnonzero(np.isfinite(part["rest"].values)))
        table = columns(effects, "number", "first", "second", "share")
        if part.sizes["number"]:
            yield Picture("interactions", drawn("_designs_pictures.interactions", part), table)
    yield from _side_by_side(solved, [*keys[:_KEYS], *shown], least[0])
    yield from _every_pair(solved, [*keys[:4], *shown[:3]])
    if len(least) > 1 and (own := _with_all(solved, least[:2])) is not None:
        front = beaten(own, least)
        table = columns(own, "design", *least[:2]) | {"dominated": front.astype(int)}
        draw = drawn("_designs_pictures.trade", own, least[:2], front)
        yield Picture("pareto_designs", draw, table)
    if (found := datasets.get("quantiles")) is not None:
        table = columns(found, "number", "share", "value", "low", "high")
        draw = drawn("_designs_pictures.quantiles", solved, found.sel(number=shown))
        yield Picture("quantiles", draw, table)


def _side_by_side(designs: xr.Dataset, names: list[str], least: str) -> Iterator[Picture]:
    names = list(dict.fromkeys([*names, least]))
    if (own := _with_all(designs, names)) is not None:
        draw = drawn("_designs_pictures.parallel", own, names, least)
        yield Picture("parallel_coordinates", draw, columns(own, "design", *names))


def _every_pair(designs: xr.Dataset, names: list[str]) -> Iterator[Picture]:
    if (own := _with_all(designs, names)) is not None:
        draw = drawn("_designs_pictures.scatter_matrix", own, names)
        yield Picture("scatter_matrix", draw, columns(own, "design", *names))


def _with_all(designs: xr.Dataset, names: list[str]) -> xr.Dataset | None:
    """The designs that lack none of some numbers; None if these are fewer than two."""
    finite = np.all([np.isfinite(designs[name].values) for name in names], axis=0)
    return designs.isel(design=np.flatnonzero(finite)) if finite.sum() > 1 else None


def _of_role(designs: xr.Dataset, role: str) -> list[str]:
    return [str(name) for name, each in designs.data_vars.items() if each.attrs.get("role") == role]


def _strongest(designs: xr.Dataset, effects: xr.Dataset | None) -> list[str]:
    """Keys that are numbers and vary, those that do most first where that is known."""
    keys = [
        name
        for name in _of_role(designs, "key")
        if designs[name].dtype.kind in "if" and np.ptp(designs[name].values) > 0.0
    ]
    if effects is None:
        return keys
    both = effects["share"].sum("number")
    total = both.sum("second").values + both.sum("first").values
    strength = dict(zip(effects["first"].values.tolist(), total, strict=True))
    return sorted((key for key in keys if key in strength), key=lambda key: -strength[key])


def _minimised(designs: xr.Dataset) -> list[str]:
    """Numbers of which little is good; with one, another is what it is traded for."""
    named = designs.attrs.get("minimise", [])
    named = [named] if isinstance(named, str) else [str(each) for each in named]
    return [*named, *(x for x in _of_role(designs, "number") if x not in named)]


def main_effects(designs: xr.Dataset, keys: list[str], numbers: list[str]) -> xr.Dataset:
    """Means of numbers over steps of each key, `[number, key, step]`, and the middles of these."""
    middle = np.full((len(keys), _STEPS), np.nan)
    mean = np.full((len(numbers), len(keys), _STEPS), np.nan)
    for place, key in enumerate(keys):
        values = designs[key].values.astype(float)
        levels = np.unique(values)
        if len(levels) > _STEPS:
            edges = np.quantile(values, np.linspace(0.0, 1.0, _STEPS + 1))
            step = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, _STEPS - 1)
        else:
            step = np.searchsorted(levels, values)
        for at in np.unique(step):
            middle[place, at] = values[step == at].mean()
            for number, name in enumerate(numbers):
                own = designs[name].values[step == at]
                if (own := own[np.isfinite(own)]).size:
                    mean[number, place, at] = own.mean()
    return xr.Dataset(
        {"middle": (("key", "step"), middle), "mean": (("number", "key", "step"), mean)},
        coords={"key": keys, "number": numbers},
    ).assign_attrs(title=designs.attrs["title"])


def beaten(designs: xr.Dataset, names: list[str]) -> np.ndarray:
    """Which designs another one beats in the first two numbers."""
    first, second = (designs[name].values for name in names[:2])
    order = np.lexsort((second, first))
    best = np.minimum.accumulate(np.concatenate([[np.inf], second[order]]))[:-1]
    found = np.empty(len(order), dtype=bool)
    found[order] = second[order] >= best
    return found
