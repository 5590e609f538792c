"""What is written of waves in condensed bodies: data of their pictures, and shapes for ParaView."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import xarray as xr

from fem_prep import Grid, write_vtu
from jaxgear._cli._folder import Folder
from jaxgear._cli._saving import save
from jaxgear._response._waves import DIRECTIONS
from jaxgear._whole_file import whole_file
from jaxgear.plot._flank_tables import (
    flank_pressure_columns,
    largest_loads_columns,
    teeth_at_speed_columns,
)
from jaxgear.plot._plots import flank_pictures, wave_pictures
from jaxgear.plot._tables import Columns
from jaxgear.study._body_waves import (
    Looked,
    MovingBody,
    WaveWatch,
    main_wave,
)
from jaxgear.study._flank_loads import FlankLoads
from jaxgear.study._hybrid_dataset import hole_places

# Files for ParaView in one period.
_STATES = 12


def wave_spectra_columns(dataset: xr.Dataset, gear: str) -> Columns:
    """The data of `wave_spectra`, all orders, of one probe after the other."""
    order, names = dataset[f"{gear}_order"].values, dataset[f"{gear}_probe"].values
    return {
        "probe": np.repeat(names, len(order)),
        "order": np.tile(order, len(names)),
        "amplitude_um": dataset[f"{gear}_probe_amplitude_um"].values.ravel(),
    }


def wave_map_columns(dataset: xr.Dataset, gear: str) -> Columns:
    """The data of `wave_map`: a row for each wave."""
    amplitude = dataset[f"{gear}_wave_amplitude_um"].values
    return {
        "order": dataset[f"{gear}_wave_order"].values,
        "nodal_diameters": dataset[f"{gear}_wave_diameters"].values,
        "travel_rad_s": dataset[f"{gear}_wave_travel_rad_s"].values,
        **{f"{name}_um": amplitude[:, i] for i, name in enumerate(DIRECTIONS)},
    }


def _wave_level(own: xr.Dataset, gear: str) -> np.ndarray:
    """RMS of each wave, all directions together, `[speed, wave]` [um]."""
    return np.sqrt(np.sum(own[f"{gear}_wave_rms_um"].values ** 2, axis=-1))


def wave_levels_columns(dataset: xr.Dataset, gear: str) -> Columns:
    """The data of `wave_levels`, one row per speed, of one wave after the other."""
    own = dataset.sel(direction=dataset.attrs["peak_direction"])
    return _levels(own, "nodal_diameters", f"{gear}_diameters", _wave_level(own, gear))


def probe_levels_columns(dataset: xr.Dataset, gear: str) -> Columns:
    """The data of `wave_levels`, one row per speed, of one probe after the other."""
    own = dataset.sel(direction=dataset.attrs["peak_direction"])
    return _levels(own, "probe", f"{gear}_probe", own[f"{gear}_probe_rms_um"].values)


def _levels(own: xr.Dataset, name: str, of: str, level: np.ndarray) -> Columns:
    speed, each = own["speed"].values, own[of].values
    return {
        name: np.repeat(each, len(speed)),
        "pinion_speed_rad_s": np.tile(speed, len(each)),
        "rms_um": level.T.ravel(),
    }


def _grid(body: MovingBody) -> Grid:
    return Grid(body.built.body.nodes, body.built.body.bricks, MappingProxyType({}))


def write_shapes(folder: Folder, body: MovingBody, shape: np.ndarray, name: str) -> Path | None:
    """One order of a body over one of its periods, as a series of files for ParaView.

    **Arguments:**

    - `folder`: where to; the files get a folder of their own.
    - `body`: that moves.
    - `shape`: complex displacement of its nodes, shape `[node, 3]` [m].
    - `name`: of the series.

    **Returns:**

    The file that ParaView opens, or None: of a body without a grid there are none.
    """
    if not body.has_grid:
        return None
    own = folder / name
    own.mkdir(parents=True, exist_ok=True)
    files = []
    for step in range(_STATES):
        moved = np.real(shape * np.exp(2j * np.pi * step / _STATES))
        path = own / f"{name}_{step:02d}.vtu"
        write_vtu(path, _grid(body), {"displacement [m]": moved})
        files.append({"name": path.name, "time": step / _STATES})
    series = own / f"{name}.vtu.series"
    with whole_file(series) as draft:
        draft.write_text(
            json.dumps({"file-series-version": "1.0", "files": files}, indent=2) + "\n"
        )
    return series


def draw(
    folder: Folder,
    title: str,
    watch: WaveWatch,
    dataset: xr.Dataset,
    tell: Callable[[str], None] = lambda step: None,
) -> None:
    """The pictures of waves in condensed bodies, and their motion at the highest peak.

    **Arguments:**

    - `folder`: where to.
    - `title`: the case.
    - `watch`: that looked at the sweep.
    - `dataset`: from `waves_dataset`.
    - `tell`: told what begins.
    """
    _, _, speed, motions = watch.best[dataset.attrs["peak_direction"]]
    at_peak = f"{title}, pinion at {speed:.5g} rad/s"
    for gear, each in watch.looked.items():
        tell(f"{gear}: drawing")
        for name, picture, columns in (
            ("spectra", wave_pictures.wave_spectra, wave_spectra_columns),
            ("waves", wave_pictures.wave_map, wave_map_columns),
        ):
            figure = partial(picture, dataset, gear, f"{at_peak}: {gear}")
            save(figure, columns(dataset, gear), folder, f"{gear}_{name}")
        figure = partial(wave_pictures.wave_levels, dataset, gear, f"{title}: {gear}")
        probes, name = probe_levels_columns(dataset, gear), f"{gear}_levels"
        save(figure, wave_levels_columns(dataset, gear), folder, name, probes=probes)
        _draw_motion(folder, at_peak, each, motions[gear], tell)
    if flanks := watch.flanks(dataset.attrs["peak_direction"]):
        tell("loads on the flanks: drawing")
        _draw_flanks(folder, title, watch, dataset, flanks)


def _draw_flanks(
    folder: Folder, title: str, watch: WaveWatch, dataset: xr.Dataset, flanks: list[FlankLoads]
) -> None:
    figure = partial(flank_pictures.flank_pressure, flanks, f"{title}: the most loaded tooth pair")
    save(figure, flank_pressure_columns(flanks), folder, "flank_pressure")
    own = dataset.sel(direction=dataset.attrs["peak_direction"])
    save(
        partial(flank_pictures.largest_loads, own, title),
        largest_loads_columns(own),
        folder,
        "flank_loads",
    )
    for gear, each in watch.looked.items() if flanks[0].pairs > 1 else ():
        holes = hole_places(each.body.built)
        figure = partial(flank_pictures.teeth_at_speed, flanks, gear, holes, title)
        columns = teeth_at_speed_columns(flanks, gear, holes)
        save(figure, columns, folder, f"{gear}_teeth_at_speed")


def _draw_motion(folder: Folder, title: str, each: Looked, motion, tell) -> None:
    main, body = main_wave(each, motion), each.body
    tell(f"{body.gear}: its shape at order {main.order:g}")
    shape = body.shape(motion, main.order)
    if folder.pictures:
        moving = folder / f"{body.gear}_shape.gif"
        wave_pictures.animate_shape(moving, body, shape, main, f"{title}: {body.gear}")
    write_shapes(folder, body, shape, f"{body.gear}_shape")
