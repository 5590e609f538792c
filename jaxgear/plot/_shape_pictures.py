"""A body in motion, as an animated picture."""

from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.animation import PillowWriter
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from jaxgear._units import mm, um
from jaxgear._whole_file import whole_file
from jaxgear.plot._body_pictures import component_of, fill_of, show
from jaxgear.plot._body_render import frame, render
from jaxgear.plot._palette import EITHER_WAY
from jaxgear.plot._style import round_down

# Pictures in one period, and in one second.
_FRAMES, _PER_SECOND = 16, 12
# Of the body's radius: how far its largest displacement is drawn.
_DRAWN = 0.07


def animate_shape(dataset: xr.Dataset, path: Path) -> None:
    """Write one order of a body over one of its periods, the group `shape_GEAR`, as .gif."""
    nodes, faces = dataset["place_mm"].values * mm, dataset["face"].values
    shape = um * (dataset["real_um"].values + 1j * dataset["imaginary_um"].values)
    component, radius = dataset.attrs["component"], dataset.attrs["radius_mm"] * mm
    along = component_of(nodes, shape, component)
    most = float(np.abs(along).max()) or 1.0
    scale = round_down(_DRAWN * radius / max(float(np.abs(shape).max()), 1e-15))
    colours = ScalarMappable(Normalize(-most / um, most / um), EITHER_WAY)
    order, wave = dataset.attrs["order"], dataset.attrs["wave"]
    words = f"order {order:g}: {wave}; drawn {scale:g} times as large"
    figure = Figure(figsize=(5.6, 4.4))
    figure.suptitle(dataset.attrs["title"])
    axes = figure.add_axes((0.02, 0.02, 0.76, 0.84))
    bar = figure.add_axes((0.82, 0.14, 0.03, 0.6))
    figure.colorbar(colours, cax=bar, label=f"{component} displacement [µm]")
    writer = PillowWriter(fps=_PER_SECOND)
    # The picture must not jump as the body moves.
    placed = nodes @ frame()[:, :2] / mm
    room = 1.2 * _DRAWN * float(np.abs(placed).max())
    low, high = placed.min(axis=0) - room, placed.max(axis=0) + room
    with whole_file(path) as draft, writer.saving(figure, str(draft), dpi=80):
        for step in range(_FRAMES):
            phase = np.exp(2j * np.pi * step / _FRAMES)
            fill = fill_of(colours, np.real(along * phase) / um, faces)
            moved = nodes + scale * np.real(shape * phase)
            axes.clear()
            show(axes, render(moved, faces, fill, edges=True, pixels=300))
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
            axes.set_title(words, fontsize=9.0)
            writer.grab_frame()
