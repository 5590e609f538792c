"""Pictures of motion through the mesh: contact over speed and phase, and one steady response."""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxgear.plot._cycle import NO_FORCE, cycle_periods, phase_shares
from jaxgear.plot._palette import BLUE, GREY, RED, SURFACE
from jaxgear.plot._speed_axes import dots, edges, mark_unsettled, speed_axes, speed_edges, stack
from jaxgear.plot._style import axis_label, digits, legend_below, page_of, panels, surface

_FORCE = "mesh force / static [-]"
_PHASE = "mesh phase [mesh periods]"


def contact_loss(dataset: xr.Dataset, share: np.ndarray) -> Figure:
    """Mesh force over pinion speed and mesh phase, where the teeth part, and for how long."""
    what, size = "Contact over speed and phase", (9.6, 7.6)
    figure, column = stack(what, dataset, size, (3.0, 1.8, 1.0))
    over, pairs, lost = column
    speed, phase = dataset["speed"].values, dataset["phase"].values
    force, periods = dataset["mesh_force_ratio"].values, cycle_periods(phase)
    cells = speed_edges(speed), edges(phase, 0.0, float(periods))
    apart = force <= NO_FORCE
    norm = Normalize(0.0, max(1.0, float(np.max(force))))
    colours = matplotlib.colormaps[SURFACE].with_extremes(bad="white")
    area = surface(over, *cells, np.ma.masked_where(apart, force), cmap=colours, norm=norm)
    figure.colorbar(area, ax=over, label=_FORCE, pad=0.01)
    if min(apart.shape) > 1 and np.any(apart) and not np.all(apart):
        # Around the places where the teeth are apart.
        line: dict[str, Any] = {"levels": [0.5], "colors": [RED], "linewidths": 1.1}
        over.contour(speed, phase, apart.T.astype(float), **line)
    over.set_ylabel(_PHASE)
    _draw_pairs(pairs, dataset["tooth_pairs"].values, cells)
    lost.fill_between(speed, 0.0, 100.0 * share, color=RED, alpha=0.3, lw=0)
    lost.plot(speed, 100.0 * share, color=RED, lw=1.2, marker=dots(speed), ms=3)
    most = 100.0 * float(np.max(share, initial=0.0))
    lost.set(ylabel="no contact\n[% of time]", ylim=(0.0, max(1.1 * most, 1.0)))
    for axes in (over, pairs):
        axes.set_ylim(0.0, periods)
    speed_axes(column, speed, int(dataset.attrs["teeth_pinion"]))
    lost.set_xlim(cells[0][0], cells[0][-1])
    figure.align_ylabels(column)
    handles: list[Any] = mark_unsettled(over, dataset, upright=False)
    if np.any(apart):
        handles.append(Patch(fc="white", ec=RED, lw=1.4, label="teeth apart: no mesh force"))
    legend_below(figure, handles, ncols=2)
    return figure


def _draw_pairs(axes: Axes, pairs: np.ndarray, cells: tuple[np.ndarray, np.ndarray]) -> None:
    """How many tooth pairs carry, over speed and phase."""
    most = max(int(np.max(pairs)), 2)
    shades = matplotlib.colormaps["Blues"](np.linspace(0.25, 0.75, most))
    colours = ListedColormap([(1.0, 1.0, 1.0, 1.0), *map(tuple, shades)])
    area = surface(axes, *cells, pairs, cmap=colours, vmin=-0.5, vmax=most + 0.5)
    bar = page_of(axes).colorbar(area, ax=axes, label="tooth pairs [-]", pad=0.01)
    bar.set_ticks(list(range(most + 1)))
    bar.ax.minorticks_off()
    axes.set_ylabel(_PHASE.replace(" [", "\n["))


def orbit(dataset: xr.Dataset) -> Figure:
    """A settled response: mesh force and dynamic TE over time, and the phase portrait.

    Where two branches exist at the same speed they stand side by side, with the same scales.
    """
    count, what = dataset.sizes["branch"], "Steady response"
    if count == 1:
        figure, row = panels(what, dataset, (12.6, 4.4), 3, width_ratios=(1.35, 1.35, 1.0))
        columns = [row]
    else:
        size = (max(9.6, 4.6 * count), 9.6)
        shared: dict[str, Any] = {"sharex": "row", "sharey": "row", "height_ratios": (1, 1, 1.5)}
        figure, grid = panels(what, dataset, size, count, 3, space=(0.02, 0.03), **shared)
        columns = [grid[column::count] for column in range(count)]
    branches = [dataset.isel(branch=row).dropna("phase", subset=["te_um"]) for row in range(count)]
    longest = max(2, *(cycle_periods(own["phase"].values) for own in branches), 2)
    static = dataset["te_static_um"].dropna("phase")
    for own, axes in zip(branches, columns, strict=True):
        _draw_orbit(axes, own, static, longest, alone=count == 1)
    handles = [
        Line2D([], [], color=BLUE, label="response"),
        Line2D([], [], color=GREY, ls="--", lw=1.1, label="quasi-static"),
        Line2D([], [], color=RED, lw=3.0, label="teeth apart"),
        Line2D([], [], color="black", marker="o", ls="", ms=5, label="once per mesh period"),
    ]
    legend_below(figure, handles, ncols=4)
    return figure


def _draw_orbit(
    axes: Sequence[Axes], own: xr.Dataset, static: xr.DataArray, longest: int, *, alone: bool
) -> None:
    """Force, TE and phase portrait of one branch."""
    names = ("phase", "mesh_force_ratio", "te_um", "te_rate_mm_s")
    phase, force, error, rate = (own[name].values for name in names)
    periods, apart = cycle_periods(phase), force <= NO_FORCE
    share = 100.0 * float(apart @ phase_shares(phase))
    times = max(longest // periods, 1)
    along = np.concatenate([phase + periods * time for time in range(times)])
    over, portrait = axes[:2], axes[2]
    for panel, values in zip(over, (force, error), strict=True):
        repeated, lost = np.tile(values, times), np.tile(apart, times)
        panel.plot(along, repeated, color=BLUE, lw=1.4)
        panel.plot(along, np.where(lost, repeated, np.nan), color=RED, lw=3.0, zorder=3)
        panel.set(xlim=(0, longest), xlabel=_PHASE)
    cycle = cycle_periods(static["phase"].values)
    for time in range(max(longest // cycle, 1)):
        place = static["phase"].values + cycle * time
        over[1].plot(place, static.values, color=GREY, lw=1.1, ls="--")
    over[0].axhline(1.0, color=GREY, lw=0.8, ls="--", zorder=1)
    closed = lambda x: np.append(x, x[:1])
    portrait.plot(closed(error), closed(rate), color=BLUE, lw=1.4)
    lost = (closed(np.where(apart, x, np.nan)) for x in (error, rate))
    portrait.plot(*lost, color=RED, lw=3.0)
    once = np.searchsorted(phase, phase[0] + np.arange(periods))
    portrait.plot(error[once], rate[once], "o", color="black", ms=5, zorder=4)
    portrait.set_xlabel(axis_label(own["te_um"]))
    labels = (_FORCE, axis_label(own["te_um"]), "rate of the TE [mm/s]")
    name = "" if alone else f"{own['branch'].item()}: "
    size = f"largest {digits(float(np.max(force)), 3)}, no contact {share:.3g} % of time"
    titles = (name + size, _orbit_state(own, periods), "phase portrait")
    for panel, label, title in zip(axes, labels, titles, strict=True):
        panel.set_ylabel(label)
        panel.tick_params(labelleft=True)
        panel.set_title(title, loc="left")


def _orbit_state(own: xr.Dataset, periods: int) -> str:
    """After how many mesh periods a response repeats, and whether it is to be trusted."""
    words = ["repeats every " + ("mesh period" if periods == 1 else f"{periods} mesh periods")]
    if not bool(own["settled"]):
        words.append("NOT SETTLED")
    words.append("stable" if bool(own["stable"]) else "UNSTABLE")
    return ", ".join(words)
