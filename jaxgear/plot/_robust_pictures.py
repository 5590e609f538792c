"""Pictures of a robust optimum: the gears that are made of two designs, and what spreads them."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from jaxgear.plot._cycle import cycle_statistics
from jaxgear.plot._palette import _GREY
from jaxgear.plot._pictures import _digits, _house_look, _panels, _phase_axis, _thin
from jaxgear.plot._robust_tables import _DESIGNS
from jaxgear.plot._tables import _unrolled

# Bars of a tornado chart; what is below them is too short to see.
_BARS = 12


@_house_look()
def robust(
    values: Mapping[str, np.ndarray],
    datasets: Mapping[str, xr.Dataset],
    share: float,
    response: tuple[str, str],
    title: str,
) -> Figure:
    """How the gears of two designs spread, and their transmission errors without deviations.

    **Arguments:**

    - `values`: response in each gear of a fresh sample, under `nominal` and `robust`, in its unit.
    - `datasets`: from `static_dataset`, of the designs without deviations.
    - `share`: of the gears that is marked [-].
    - `response`: its name and unit.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    figure, (spread, error) = _panels((10.4, 4.4), f"Gears as they are made: {title}", 2)
    what, unit = response[0], response[1].replace("um", "µm")
    for name, colour, style in _DESIGNS:
        own = np.sort(values[name])
        count = (np.arange(len(own)) + 0.5) / len(own)
        mean, mark = float(own.mean()), float(np.quantile(own, share))
        spread.plot(
            own,
            100.0 * count,
            color=colour,
            ls=style,
            label=f"{name}: mean {_digits(mean, 3)}, {100.0 * share:g} % below {_digits(mark, 3)}",
        )
        spread.plot(mean, 100.0 * float(np.mean(own <= mean)), "o", ms=6, color=colour)
        spread.plot(mark, 100.0 * share, "D", ms=6, color=colour)
        spread.plot([mark, mark], [0.0, 100.0 * share], ":", lw=1.0, color=colour)
    spread.axhline(100.0 * share, lw=1.0, ls=":", color=_GREY)
    spread.set(xlabel=f"{what} [{unit}]", ylabel="gears with less [%]", ylim=(0.0, 130.0))
    spread.set_yticks(np.arange(0.0, 101.0, 20.0))
    spread.set_title("gears as they are made", loc="left")
    spread.legend(loc="upper center")
    for name, colour, style in _DESIGNS:
        dataset = datasets[name]
        own = dataset["phase"].values
        phase, curve = _unrolled(own, dataset["transmission_error_um"].values)
        mean, rms, _ = cycle_statistics(dataset["transmission_error_um"])
        label = f"{name}: RMS {_digits(rms, 3)} µm"
        error.plot(phase, curve - mean, color=colour, ls=style, lw=_thin(own), label=label)
    own = datasets["robust"]["phase"].values
    _phase_axis(error, "transmission error less its mean [µm]", own)
    low, high = error.get_ylim()
    error.set_ylim(low, high + 0.25 * (high - low))
    error.set_title("the gear without deviations", loc="left")
    error.legend(loc="upper center")
    return figure


@_house_look()
def tornado(
    names: Sequence[str],
    reach: Sequence[str],
    ends: Mapping[str, tuple[float, np.ndarray, np.ndarray]],
    response: tuple[str, str],
    title: str,
) -> Figure:
    """What each thing that scatters does by itself, to two designs.

    **Arguments:**

    - `names`: of the quantities, the most influential first.
    - `reach`: how far each was moved, in words.
    - `ends`: under `nominal` and `robust` the response of the gear without deviations, and with
        each quantity down and up.
    - `response`: its name and unit.
    - `title`: the case or the finding.

    **Returns:**

    The figure.
    """
    shown = min(len(names), _BARS)
    figure, panels = _panels(
        (11.0, 1.9 + 0.42 * shown), f"What scatters, and what it does: {title}", 2
    )
    place = np.arange(shown)
    for axes, (name, colour, _) in zip(panels, _DESIGNS, strict=True):
        middle, low, high = ends[name]
        for amount, face, label in ((low, "white", "less"), (high, colour, "more")):
            axes.barh(
                place + (-0.19 if amount is low else 0.19),
                amount[:shown] - middle,
                left=middle,
                height=0.36,
                color=face,
                edgecolor=colour,
                label=label,
            )
        axes.axvline(middle, lw=1.0, color=_GREY)
        axes.set_yticks(place)
        axes.invert_yaxis()
        axes.set_title(f"{name}: {_digits(middle, 3)} without deviations", loc="left")
        axes.set_xlabel(f"{response[0]} [{response[1].replace('um', 'µm')}]")
        axes.margins(x=0.08)
        axes.legend(loc="lower right", title="by itself")
    panels[0].set_yticklabels(
        [f"{n}\n{r}" for n, r in zip(names[:shown], reach[:shown], strict=True)], fontsize=8.0
    )
    panels[1].set_yticklabels([])
    edges = [axes.get_xlim() for axes in panels]
    for axes in panels:
        axes.set_xlim(min(low for low, _ in edges), max(high for _, high in edges))
    if len(names) > shown:
        figure.text(
            0.995,
            0.005,
            f"{len(names) - shown} more do less",
            ha="right",
            va="bottom",
            fontsize=8.0,
        )
    return figure
