"""Pictures of many designs: what each key does, keys together, designs side by side, trades."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from jaxgear.plot._palette import BLUE, GREY, ORANGE, RED, SURFACE
from jaxgear.plot._style import legend_below, panels, written_unit

# Designs that are drawn; more hide each other, and make large files.
_DRAWN = 600
# Numbers that are too long for a tick.
_LARGE = 1e5


def main_effects(designs: xr.Dataset, means: xr.Dataset) -> Figure:
    """Every number over every key: designs as dots, and their mean over steps of the key."""
    keys, numbers = (means[x].values.tolist() for x in ("key", "number"))
    size = (1.6 + 2.4 * len(keys), 1.3 + 2.1 * len(numbers))
    shape: dict[str, Any] = {"sharey": "row", "sharex": "col"}
    figure, grid = panels("Main effects", means, size, len(keys), len(numbers), **shape)
    few = _some(designs)
    for place, axes in enumerate(grid):
        row, column = divmod(place, len(keys))
        own = means.sel(number=numbers[row], key=keys[column]).dropna("step")
        dots: dict[str, Any] = {"ls": "", "marker": ".", "ms": 3.0, "color": GREY, "alpha": 0.35}
        axes.plot(few[keys[column]], few[numbers[row]], rasterized=True, **dots)
        axes.plot(own["middle"], own["mean"], "o-", ms=4.0, color=BLUE)
        _ticks(axes.xaxis, designs[keys[column]])
        _ticks(axes.yaxis, designs[numbers[row]])
        if row == len(numbers) - 1:
            axes.set_xlabel(_label(designs[keys[column]]))
        if not column:
            axes.set_ylabel(_label(designs[numbers[row]]))
    return figure


def interactions(effects: xr.Dataset) -> Figure:
    """Shares of the variance of each number: of keys alone on the diagonal, of pairs below it."""
    names = effects["number"].values.tolist()
    count = effects.sizes["first"]
    size = (3.2 + (0.9 + 0.62 * count) * len(names), 2.6 + 0.5 * count)
    figure, grid = panels("Keys alone and in pairs", effects, size, len(names), sharey=True)
    for axes, name in zip(grid, names, strict=True):
        own = effects.sel(number=name)
        both = own["share"].values
        shares = 100.0 * np.tril(both + np.triu(both, 1).T)
        shown = np.where(np.tril(np.ones_like(shares)) > 0.0, shares, np.nan)
        axes.imshow(shown, cmap="Blues", vmin=0.0, vmax=100.0, aspect="auto")
        axes.grid(False)
        for row, column in zip(*np.nonzero(shown >= 0.5), strict=True):
            dark = "white" if shown[row, column] > 55.0 else "black"
            words: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8.5}
            axes.text(column, row, f"{shown[row, column]:.0f}", color=dark, **words)
        labels = [_short(key) for key in own["first"].values.tolist()]
        axes.set_xticks(range(count), labels, rotation=60, ha="right", fontsize=8.5)
        axes.set_yticks(range(count), labels, fontsize=8.5)
        axes.set_title(f"{_short(name)}\nshare of its variance [%], rest {float(own['rest']):.0%}")
        axes.set(xlabel="key", ylabel="key" if axes is grid[0] else "")
    return figure


def parallel(designs: xr.Dataset, names: list[str], least: str) -> Figure:
    """Every design as a line across keys and numbers, the best in front."""
    few = _some(designs.sortby(least), keep=20)
    figure, (axes,) = panels("Designs side by side", designs, (2.0 + 1.5 * len(names), 5.2))
    values = np.stack([few[name].values.astype(float) for name in names], axis=1)
    low, high = (
        np.asarray([float(edge(designs[name])) for name in names]) for edge in (np.min, np.max)
    )
    unit = (values - low) / np.where(high > low, high - low, 1.0)
    lines = [np.column_stack([np.arange(len(names)), row]) for row in unit[::-1]]
    rank = few[least].values[::-1]
    drawn = LineCollection(lines, cmap=f"{SURFACE}_r", lw=0.8, alpha=0.6, rasterized=True)
    drawn.set_array(rank)
    axes.add_collection(drawn)
    (best,) = axes.plot(np.arange(len(names)), unit[0], "o-", color=RED, lw=2.2)
    best.set_label(f"design {int(few['design'].values[0])}, the best by {_short(least)}")
    axes.set(xlim=(-0.3, len(names) - 0.7), ylim=(-0.14, 1.14), yticks=[])
    axes.set(ylabel="from the lowest to the highest value", xlabel="key or number")
    axes.set_xticks(range(len(names)), [_label(designs[name]) for name in names], fontsize=8.5)
    for place, (bottom, top) in enumerate(zip(low, high, strict=True)):
        for at, value, align in ((-0.03, bottom, "top"), (1.03, top, "bottom")):
            axes.text(place, at, f"{value:.4g}", ha="center", va=align, fontsize=8.5)
    axes.figure.colorbar(drawn, ax=axes, label=_label(designs[least]), pad=0.01)
    legend_below(figure, [best])
    return figure


def scatter_matrix(designs: xr.Dataset, names: list[str]) -> Figure:
    """Every key and number over every other, and how each is spread."""
    count, few = len(names), _some(designs)
    side = 1.4 + 1.75 * count
    figure, grid = panels("Every pair", designs, (side, side), count, count, sharex="col")
    for place, axes in enumerate(grid):
        row, column = divmod(place, count)
        if column > row:
            axes.set_visible(False)
            continue
        if row == column:
            axes.hist(designs[names[row]].values, bins=20, color=BLUE)
            axes.set_yticks([])
        else:
            dots: dict[str, Any] = {"ls": "", "marker": ".", "ms": 2.5, "color": BLUE}
            axes.plot(few[names[column]], few[names[row]], alpha=0.5, rasterized=True, **dots)
        _ticks(axes.xaxis, designs[names[column]])
        if row != column:
            _ticks(axes.yaxis, designs[names[row]])
        if row == count - 1:
            axes.set_xlabel(_label(designs[names[column]]), fontsize=8.5)
        if not column:
            words = _label(designs[names[row]]) if row else "number of designs"
            axes.set_ylabel(words, fontsize=8.5)
        else:
            axes.tick_params(labelleft=False)
    return figure


def trade(designs: xr.Dataset, names: list[str], dominated: np.ndarray) -> Figure:
    """Two numbers of which little is good, and the designs that no other beats in both."""
    figure, (axes,) = panels("Designs that trade one number for another", designs, (7.0, 5.0))
    first, second = (designs[name].values for name in names)
    few = _some(designs.isel(design=np.flatnonzero(dominated)))
    axes.plot(few[names[1]], few[names[0]], ".", ms=4.0, color=GREY, label="beaten in both")
    front = np.flatnonzero(~dominated)[np.argsort(first[~dominated])]
    axes.plot(second[front], first[front], "o-", color=BLUE, label="front")
    axes.set(xlabel=_label(designs[names[1]]), ylabel=_label(designs[names[0]]))
    for count, place in enumerate(front[:: max(1, len(front) // 6)]):
        number = str(int(designs["design"].values[place]))
        at: Any = (second[place], first[place])
        # One above, the next below: neighbours would hide each other.
        shift: Any = (5, -12 if count % 2 else 5)
        axes.annotate(number, at, shift, textcoords="offset points", fontsize=8.5)
    axes.legend(loc="best", title="numbers are those of the designs")
    return figure


def quantiles(designs: xr.Dataset, found: xr.Dataset) -> Figure:
    """What share of the designs stays below a value, quantiles with the bounds of their place."""
    names = found["number"].values.tolist()
    size = (1.0 + 3.6 * len(names), 4.3)
    figure, grid = panels("Gears as they are made", designs, size, len(names), sharey=True)
    for axes, name in zip(grid, names, strict=True):
        _distribution(axes, designs[name], found.sel(number=name))
        axes.set(xlabel=_label(designs[name]))
    grid[0].set_ylabel("share of the designs below [%]")
    grid[0].legend(loc="lower right")
    return figure


def _distribution(axes: Axes, values: xr.DataArray, found: xr.Dataset) -> None:
    ordered = np.sort(values.values[np.isfinite(values.values)])
    share = 100.0 * (np.arange(len(ordered)) + 1.0) / len(ordered)
    axes.step(ordered, share, where="post", color=BLUE)
    middle, at = found["value"].values, 100.0 * found["share"].values
    low, high = (np.abs(found[end].values - middle) for end in ("low", "high"))
    bars: dict[str, Any] = {"fmt": "o", "color": ORANGE, "capsize": 3.0, "zorder": 3}
    axes.errorbar(middle, at, xerr=[np.nan_to_num(low), np.nan_to_num(high)],
                  label="quantiles, 95 % sure", **bars)  # fmt: skip
    for value, place in zip(middle, at, strict=True):
        words = f"{place:g} %: {value:.4g}"
        shift: Any = (-8, 2) if place > 20.0 else (8, -2)
        side = "right" if place > 20.0 else "left"
        axes.annotate(
            words, (value, place), shift, textcoords="offset points", ha=side, fontsize=8.5
        )
    axes.margins(x=0.12)


def _ticks(axis: Axis, values: xr.DataArray) -> None:
    """A few ticks; of large numbers in thousands and millions, as 250M for 2.5e8."""
    axis.set_major_locator(MaxNLocator(4))
    if np.nanmax(np.abs(values.values)) >= _LARGE:
        axis.set_major_formatter(EngFormatter(sep=""))


def _some(designs: xr.Dataset, keep: int = 0) -> xr.Dataset:
    """As many designs as can be seen, evenly chosen; the first ones all."""
    count = designs.sizes["design"]
    if count <= _DRAWN:
        return designs
    rest = np.linspace(keep, count - 1, _DRAWN - keep).astype(int)
    return designs.isel(design=np.unique(np.concatenate([np.arange(keep), rest])))


def _label(variable: xr.DataArray) -> str:
    unit = written_unit(variable)
    return _short(str(variable.attrs["long_name"])) + ("" if unit == "-" else f" [{unit}]")


def _short(name: str) -> str:
    """What a key or a number is, in few words and two lines."""
    parts = name.split(".")
    head = [part for part in parts[:-1] if part not in ("flank", "static", "pair", "geometry")]
    last = parts[-1]
    for unit in ("_N_mm_um", "_Nm_rad", "_N_um", "_N_mm", "_N_m", "_MPa", "_GPa", "_Nm", "_um"):
        last = last.removesuffix(unit)
    for unit in ("_mm", "_deg", "_Hz", "_N", "_rad_s"):
        last = last.removesuffix(unit)
    lines = [" ".join(head), last] if head else [last]
    return "\n".join(line.replace("_", " ") for line in lines)
