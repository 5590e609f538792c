"""Pictures of searches: how fast, what became better, what was traded, and gears as they are made.

All are drawn from the groups `search_...`, `pareto` and `robust_...` of a result.
"""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from jaxgear.plot._cycle import largest_pressure, unrolled
from jaxgear.plot._palette import BLUE, GREY, ORANGE, RED, TEETH_SERIES
from jaxgear.plot._style import axis_label, digits, line_width, panels, phase_axis, room_above

# Bars of a tornado chart; what is below them is too short to see.
_BARS = 12
_DESIGNS = (("nominal", ORANGE, "--"), ("robust", BLUE, "-"))
_OFF_MEAN = "transmission error less its mean [µm]"


def search_trace(dataset: xr.Dataset) -> Figure:
    """Best value so far over the number of evaluations, for the best of several searches."""
    figure, (axes,) = panels("Searches", dataset, (7.2, 4.4))
    objective = list(dataset.data_vars.values())[-1]
    # As it stands in files: its square has no sign of its own in a legend.
    unit = {"1": "-"}.get(objective.attrs["units"], objective.attrs["units"])
    of = dataset["method"].values
    falls = {
        name: np.minimum.accumulate(objective.values[of == name]) for name in dict.fromkeys(of)
    }
    lowest = sorted(falls, key=lambda name: falls[name][-1])[: len(TEETH_SERIES)]
    shown = {name: best for name, best in falls.items() if name in lowest}
    for (name, best), colour in zip(shown.items(), TEETH_SERIES, strict=False):
        count = np.arange(1, len(best) + 1)
        label = f"{name}: {best[-1]:.4g} {unit} after {len(best)}"
        axes.step(count, best, where="post", color=colour, label=label)
        axes.plot(count[-1], best[-1], "o", ms=5, color=colour)
    best = np.concatenate([*shown.values()])
    if np.min(best) > 0.0 and np.max(best) > 20.0 * np.min(best):
        axes.set_yscale("log")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(left=0.9)
    axes.set(xlabel="evaluations of the objective [-]", ylabel=f"best objective so far [{unit}]")
    more = len(falls) - len(shown)
    axes.legend(loc="best", title=f"{more} more end higher" if more else None)
    return figure


def _error_curve(axes: Axes, dataset: xr.Dataset, label: str, **look: Any) -> None:
    """The transmission error of a design about its mean; the label may name statistics."""
    phase = dataset["phase"].values
    mean, rms = (float(dataset[f"te_{name}_um"]) for name in ("mean", "rms"))
    place, curve = unrolled(phase, dataset["transmission_error_um"].values)
    words = label.format(mean=digits(mean, 4), rms=digits(rms, 3))
    axes.plot(place, curve - mean, lw=line_width(phase), label=words, **look)


def before_after(before: xr.Dataset, after: xr.Dataset) -> Figure:
    """What a search changed: transmission error and largest flank pressure."""
    figure, (error, pressure) = panels("Before and after", before, (9.6, 4.2), 2)
    for name, dataset, colour, style in (
        ("before", before, ORANGE, "--"),
        ("after", after, BLUE, "-"),
    ):
        look: dict[str, Any] = {"color": colour, "ls": style}
        _error_curve(error, dataset, name + ": mean {mean} µm, RMS {rms} µm", **look)
        phase, most = dataset["phase"].values, largest_pressure(dataset)
        label = f"{name}: at most {digits(np.max(most), 4)} MPa"
        pressure.plot(*unrolled(phase, most), lw=line_width(phase), label=label, **look)
    for axes, label in ((error, _OFF_MEAN), (pressure, "largest flank pressure [MPa]")):
        phase_axis(axes, label, after["phase"].values)
        room_above(axes, 0.3)
        axes.legend(loc="upper center")
    return figure


def pareto(dataset: xr.Dataset) -> Figure:
    """One number of designs over another, the designs that count joined."""
    figure, (axes,) = panels("Designs that trade one number for another", dataset, (6.4, 4.8))
    # From the least of the first number to the least of the second.
    first, second = list(dataset.data_vars.values())[:2]
    own, other = first.values, second.values
    beaten, kept = (dataset[name].values.astype(bool) for name in ("dominated", "kept"))
    order = np.flatnonzero(~beaten)[np.argsort(own[~beaten])]
    axes.plot(other[order], own[order], "o-", color=BLUE, label="front")
    square: dict[str, Any] = {"marker": "s", "ls": "", "mfc": "none", "color": GREY}
    cross: dict[str, Any] = {"marker": "x", "ls": "", "color": RED}
    for lost, label, look in (
        (beaten & kept, "dominated", square),
        (~kept, "beyond a limit", cross),
    ):
        if lost.any():
            axes.plot(other[lost], own[lost], label=label, **look)
    for each in (axes.xaxis, axes.yaxis):
        each.set_major_formatter(FuncFormatter(lambda x, _: f"{x:.6g}"))
    axes.set(xlabel=axis_label(second), ylabel=axis_label(first))
    axes.legend(loc="best")
    return figure


def robust(gears: xr.Dataset, nominal: xr.Dataset, hardened: xr.Dataset) -> Figure:
    """How the gears of two designs spread, and their transmission errors without deviations."""
    figure, (spread, error) = panels("Gears as they are made", gears, (10.4, 4.4), 2)
    (response,) = gears.data_vars.values()
    share = float(gears.attrs["share"])
    for (name, colour, style), dataset in zip(_DESIGNS, (nominal, hardened), strict=True):
        own = np.sort(response.sel(design=name).values)
        count = (np.arange(len(own)) + 0.5) / len(own)
        mean, mark = float(own.mean()), float(np.quantile(own, share))
        words = f"mean {digits(mean, 3)}, {100.0 * share:g} % below {digits(mark, 3)}"
        spread.plot(own, 100.0 * count, color=colour, ls=style, label=f"{name}: {words}")
        spread.plot(mean, 100.0 * float(np.mean(own <= mean)), "o", ms=6, color=colour)
        spread.plot(mark, 100.0 * share, "D", ms=6, color=colour)
        spread.plot([mark, mark], [0.0, 100.0 * share], ":", lw=1.0, color=colour)
        _error_curve(error, dataset, name + ": RMS {rms} µm", color=colour, ls=style)
    spread.axhline(100.0 * share, lw=1.0, ls=":", color=GREY)
    spread.set(xlabel=axis_label(response), ylabel="gears with less [%]", ylim=(0.0, 130.0))
    spread.set_yticks(np.arange(0.0, 101.0, 20.0))
    phase_axis(error, _OFF_MEAN, hardened["phase"].values)
    room_above(error, 0.25)
    titles = ("gears as they are made", "the gear without deviations")
    for axes, title in zip((spread, error), titles, strict=True):
        axes.set_title(title, loc="left")
        axes.legend(loc="upper center")
    return figure


def tornado(dataset: xr.Dataset) -> Figure:
    """What each thing that scatters, the most influential first, does by itself to two designs."""
    shown = min(dataset.sizes["quantity"], _BARS)
    size = (11.0, 1.9 + 0.42 * shown)
    figure, sides = panels("What scatters, and what it does", dataset, size, 2)
    place = np.arange(shown)
    for axes, (name, colour, _) in zip(sides, _DESIGNS, strict=True):
        low, response, high = list(dataset.sel(design=name).data_vars.values())[1:]
        middle = float(response)
        for amount, aside, face, label in (
            (low, -0.19, "white", "less"),
            (high, 0.19, colour, "more"),
        ):
            look: dict[str, Any] = {"color": face, "edgecolor": colour, "label": label}
            width = amount.values[:shown] - middle
            axes.barh(place + aside, width, left=middle, height=0.36, **look)
        axes.axvline(middle, lw=1.0, color=GREY)
        axes.set_yticks(place)
        axes.invert_yaxis()
        axes.set_title(f"{name}: {digits(middle, 3)} without deviations", loc="left")
        axes.set_xlabel(axis_label(response))
        axes.margins(x=0.08)
        axes.legend(loc="lower right", title="by itself")
    names, moved = (dataset[name].values[:shown] for name in ("quantity", "moved"))
    labels = [f"{n}\n{r}" for n, r in zip(names, moved, strict=True)]
    sides[0].set_yticklabels(labels, fontsize=8.0)
    sides[1].set_yticklabels([])
    edges = [axes.get_xlim() for axes in sides]
    for axes in sides:
        axes.set_xlim(min(low for low, _ in edges), max(high for _, high in edges))
    if (more := dataset.sizes["quantity"] - shown) > 0:
        figure.text(0.995, 0.005, f"{more} more do less", ha="right", va="bottom", fontsize=8.0)
    return figure
