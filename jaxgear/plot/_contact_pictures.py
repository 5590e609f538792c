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

from jaxgear.plot._cycle import cycle_periods, phase_shares
from jaxgear.plot._palette import BLUE, GREY, RED
from jaxgear.plot._speed_axes import (
    NO_FORCE,
    dots,
    edges,
    mark_unsettled,
    speed_axes,
    speed_edges,
    stack,
)
from jaxgear.plot._style import SURFACE, digits, house_look, panels


@house_look()
def contact_loss(dataset: xr.Dataset, share: np.ndarray) -> Figure:
    """Mesh force over pinion speed and mesh phase, where the teeth part, and for how long.

    **Arguments:**

    - `dataset`: one direction of the group `sweep`.
    - `share`: of the time without contact, over speed [-].
    """
    title = f"Contact over speed and phase: {dataset.attrs['title']}"
    figure, panels = stack((9.6, 7.6), title, (3.0, 1.8, 1.0))
    speed, phase = dataset["speed"].values, dataset["phase"].values
    force, periods = dataset["mesh_force_ratio"].values, cycle_periods(phase)
    cells = speed_edges(speed), edges(phase, 0.0, float(periods))
    apart = force <= NO_FORCE
    norm = Normalize(0.0, max(1.0, float(np.max(force))))
    surface = panels[0].pcolormesh(
        *cells,
        np.ma.masked_where(apart, force).T,
        cmap=matplotlib.colormaps[SURFACE].with_extremes(bad="white"),
        norm=norm,
        rasterized=True,
    )
    figure.colorbar(surface, ax=panels[0], label="mesh force / static [-]", pad=0.01)
    _outline_loss(panels[0], speed, phase, apart)
    panels[0].set_ylabel("mesh phase [mesh periods]")
    _draw_pairs(panels[1], dataset["tooth_pairs"].values, cells)
    panels[-1].fill_between(speed, 0.0, 100.0 * share, color=RED, alpha=0.3, lw=0)
    panels[-1].plot(speed, 100.0 * share, color=RED, lw=1.2, marker=dots(speed), ms=3)
    most = 100.0 * float(np.max(share, initial=0.0))
    panels[-1].set(ylabel="no contact\n[% of time]", ylim=(0.0, max(1.1 * most, 1.0)))
    for axes in panels[:-1]:
        axes.grid(False)
        axes.set_ylim(0.0, periods)
    speed_axes(panels, speed, int(dataset.attrs["teeth_pinion"]))
    panels[-1].set_xlim(cells[0][0], cells[0][-1])
    figure.align_ylabels(panels)
    handles: list[Any] = mark_unsettled(panels[0], dataset, upright=False)
    if np.any(apart):
        handles.append(Patch(fc="white", ec=RED, lw=1.4, label="teeth apart: no mesh force"))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _outline_loss(axes: Axes, speed: np.ndarray, phase: np.ndarray, apart: np.ndarray) -> None:
    """The line around the places where the teeth are apart."""
    if min(apart.shape) > 1 and np.any(apart) and not np.all(apart):
        axes.contour(
            speed, phase, apart.T.astype(float), levels=[0.5], colors=[RED], linewidths=1.1
        )


def _draw_pairs(axes: Axes, pairs: np.ndarray, cells: tuple[np.ndarray, np.ndarray]) -> None:
    """How many tooth pairs carry, over speed and phase."""
    most = max(int(np.max(pairs)), 2)
    shades = matplotlib.colormaps["Blues"](np.linspace(0.25, 0.75, most))
    colours = ListedColormap([(1.0, 1.0, 1.0, 1.0), *map(tuple, shades)])
    surface = axes.pcolormesh(
        *cells,
        pairs.T,
        cmap=colours,
        vmin=-0.5,
        vmax=most + 0.5,
        rasterized=True,
    )
    figure = axes.get_figure(root=True)
    assert figure is not None
    bar = figure.colorbar(surface, ax=axes, label="tooth pairs [-]", pad=0.01)
    bar.set_ticks(list(range(most + 1)))
    bar.ax.minorticks_off()
    axes.set_ylabel("mesh phase\n[mesh periods]")


@house_look()
def orbit(dataset: xr.Dataset) -> Figure:
    """A settled response: mesh force and dynamic TE over time, and the phase portrait.

    Where two branches exist at the same speed they stand side by side, with the same scales.

    **Arguments:**

    - `dataset`: the group `orbit`.
    """
    count, title = dataset.sizes["branch"], f"Steady response: {dataset.attrs['title']}"
    if count == 1:
        figure, row = panels((12.6, 4.4), title, 3, (1.35, 1.35, 1.0))
        columns = [row]
    else:
        figure = Figure(figsize=(max(9.6, 4.6 * count), 9.6))
        figure.set_layout_engine("constrained", hspace=0.03)
        grid = figure.subplots(
            3, count, squeeze=False, sharex="row", sharey="row", height_ratios=(1, 1, 1.5)
        )
        figure.suptitle(title)
        columns = [list(grid[:, column]) for column in range(count)]
    branches = [dataset.isel(branch=row).dropna("phase", subset=["te_um"]) for row in range(count)]
    longest = max(2, *(cycle_periods(own["phase"].values) for own in branches), 2)
    static = dataset["te_static_um"].dropna("phase")
    for own, axes in zip(branches, columns, strict=True):
        _draw_orbit(axes, own, static, longest, alone=count == 1)
    handles = [
        Line2D([], [], color=BLUE, label="response"),
        Line2D([], [], color=RED, lw=3.0, label="teeth apart"),
        Line2D([], [], color="black", marker="o", ls="", ms=5, label="once per mesh period"),
    ]
    handles.insert(1, Line2D([], [], color=GREY, ls="--", lw=1.1, label="quasi-static"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
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
        panel.set(xlim=(0, longest), xlabel="mesh phase [mesh periods]")
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
    portrait.set_xlabel("dynamic TE [µm]")
    labels = ("mesh force / static [-]", "dynamic TE [µm]", "rate of the TE [mm/s]")
    for panel, label in zip(axes, labels, strict=True):
        panel.set_ylabel(label)
        panel.tick_params(labelleft=True)
    texts = [f"largest {digits(float(np.max(force)), 3)}", f"no contact {share:.3g} % of time"]
    name = "" if alone else f"{own['branch'].item()}: "
    over[0].set_title(name + ", ".join(texts), loc="left")
    over[1].set_title(_orbit_state(own, periods), loc="left")
    portrait.set_title("phase portrait", loc="left")


def _orbit_state(own: xr.Dataset, periods: int) -> str:
    """After how many mesh periods a response repeats, and whether it is to be trusted."""
    words = ["repeats every " + ("mesh period" if periods == 1 else f"{periods} mesh periods")]
    if not bool(own["settled"]):
        words.append("NOT SETTLED")
    words.append("stable" if bool(own["stable"]) else "UNSTABLE")
    return ", ".join(words)
