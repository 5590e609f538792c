"""What pictures over speed share: axes in all units of speed, cells, runs, marks."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import offset_copy
from numpy.typing import ArrayLike

from jaxgear._response._sweep_features import FEW
from jaxgear._units import rpm
from jaxgear.plot._palette import RED
from jaxgear.plot._style import page_of, panels


def stack(
    what: str, dataset: xr.Dataset, size: tuple[float, float], ratios: Sequence[float]
) -> tuple[Figure, list[Axes]]:
    """A figure with a column of axes over the same speeds."""
    options: dict[str, Any] = {"sharex": True, "height_ratios": ratios}
    return panels(what, dataset, size, 1, len(ratios), **options)


# Height of an axis with its ticks and its label [points].
_AXIS_HEIGHT = 35.0


def speed_axes(axes: Sequence[Axes], speed: np.ndarray, teeth: int) -> None:
    """Pinion speed in rad/s below the last axes; in rpm and as mesh frequency above the first."""
    top, bottom = axes[0], axes[-1]
    low, high = float(np.min(speed)), float(np.max(speed))
    room = 0.01 * (high - low) if high > low else 0.05 * high
    bottom.set(xlabel="pinion speed [rad/s]", xlim=(low - room, high + room))
    frequency, unit = frequency_unit(teeth * high / (2.0 * np.pi))
    scales = {
        "pinion speed [rpm]": 1.0 / rpm,
        f"mesh frequency [{unit}]": teeth / (2.0 * np.pi * frequency),
    }
    for row, (label, scale) in enumerate(scales.items()):
        above = top.secondary_xaxis(
            1.0,
            functions=scaled(scale),
            transform=offset_copy(top.transAxes, page_of(top), 0.0, row * _AXIS_HEIGHT, "points"),
        )
        above.set_xlabel(label, labelpad=4.0)
        above.tick_params(pad=2.0)


def scaled(scale: float) -> tuple[Callable[[ArrayLike], Any], Callable[[ArrayLike], Any]]:
    """To a second axis and back."""
    return lambda x: scale * np.asarray(x), lambda x: np.asarray(x) / scale


def frequency_unit(highest_Hz: float) -> tuple[float, str]:
    """The unit in which frequencies up to this one are read, in Hz, and its name."""
    return (1e3, "kHz") if highest_Hz >= 2e3 else (1.0, "Hz")


def runs(kind: np.ndarray) -> Iterator[tuple[Any, int, int]]:
    """Kind, first and last place of each run of equal values."""
    edges = np.nonzero(kind[1:] != kind[:-1])[0] + 1
    starts, ends = [0, *edges], [*edges, len(kind)]
    for start, end in zip(starts, ends, strict=True):
        if end > start:
            yield kind[start], int(start), int(end) - 1


def edges(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Edges of the cells around rising values: half-way between them, and both ends."""
    return np.concatenate([[low], 0.5 * (values[:-1] + values[1:]), [high]])


def speed_edges(speed: np.ndarray) -> np.ndarray:
    """Edges of cells around speeds, from the first to the last; around a single one 5%."""
    room = 0.05 * speed[0] if len(speed) == 1 else 0.0
    return edges(speed, float(speed[0] - room), float(speed[-1] + room))


def dots(speed: np.ndarray) -> str:
    """Marker of a line over these speeds: none where they are many."""
    return "o" if len(speed) <= FEW else ""


def flag(dataset: xr.Dataset, name: str) -> np.ndarray:
    """A flag of each response. Files hold flags as whole numbers, of which `~` makes others."""
    return dataset[name].values.astype(bool)


def mark_unsettled(axes: Axes, dataset: xr.Dataset, *, upright: bool) -> list[Line2D]:
    """Red marks along the axis of speed where a response did not settle; none or one line."""
    lost = ~flag(dataset, "settled")
    if not np.any(lost):
        return []
    speed = dataset["speed"].values[lost]
    style: dict[str, Any] = {"ls": "", "color": RED, "ms": 8, "mew": 1.6, "clip_on": False}
    style["label"] = f"not converged ({len(speed)} of {len(lost)})"
    if upright:
        place, transform = (np.full(len(speed), 0.008), speed), axes.get_yaxis_transform()
    else:
        place, transform = (speed, np.full(len(speed), 0.985)), axes.get_xaxis_transform()
    return axes.plot(*place, "_" if upright else "|", transform=transform, zorder=6, **style)


def mesh_rays(dataset: xr.Dataset, unit: float) -> list[np.ndarray]:
    """Rows of pinion speed [rad/s] and frequency of each harmonic of the mesh, in a unit [Hz]."""
    speed, teeth = dataset["speed"].values, int(dataset.attrs["teeth_pinion"])
    harmonics = range(1, int(dataset.attrs["harmonics"]) + 1)
    return [np.stack([speed, h * teeth * speed / (2.0 * np.pi * unit)], axis=1) for h in harmonics]
