"""Pictures of condensed bodies in a sweep: waves, probes, flanks, shapes; and their tables."""

from collections.abc import Iterator
from functools import partial

import numpy as np
import xarray as xr

from jaxgear.plot._picture import Animation, Columns, Datasets, Picture, columns
from jaxgear.plot._plots import flank_pictures, shape_pictures, wave_pictures

_GEARS = ("pinion", "wheel")


def pictures_of_waves(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `waves` and `flanks`.

    Those of one direction show the one with the highest peak.
    """
    if (waves := datasets.get("waves")) is None:
        return
    own = waves.sel(direction=waves.attrs["peak_direction"])
    table = own.rename(speed="pinion_speed_rad_s")
    gears = [gear for gear in _GEARS if f"{gear}_wave_rms_um" in waves]
    for gear in gears:
        yield from _pictures_of_gear(waves, table, gear)
    flanks = datasets["flanks"]
    way = columns(
        flanks,
        *("pinion_speed_rad_s", "passage", "face_position_mm", "line_load_N_mm", "pressure_MPa"),
    )
    lasts = np.isfinite(way["passage"])
    way = {name: values[lasts] for name, values in way.items()}
    yield Picture("flank_pressure", partial(flank_pictures.flank_pressure, flanks), way)
    names = ("max_line_load_N_mm", "max_pressure_MPa")
    places = ("max_line_load_passage", "max_line_load_face_mm")
    largest = columns(table, "pinion_speed_rad_s", *names, *places)
    yield Picture("flank_loads", partial(flank_pictures.largest_loads, own), largest)
    for gear in [gear for gear in _GEARS if f"{gear}_tooth_angle_deg" in flanks]:
        draw = partial(flank_pictures.teeth_at_speed, flanks, gear)
        yield Picture(f"{gear}_teeth_at_speed", draw, _teeth_columns(flanks, gear))


def _pictures_of_gear(waves: xr.Dataset, table: xr.Dataset, gear: str) -> Iterator[Picture]:
    named = {f"{gear}_probe": "probe", f"{gear}_order": "order"}
    spectra = waves.rename({**named, f"{gear}_probe_amplitude_um": "amplitude_um"})
    rows = columns(spectra, "probe", "order", "amplitude_um")
    yield Picture(f"{gear}_spectra", partial(wave_pictures.wave_spectra, waves, gear), rows)
    amplitude = waves[f"{gear}_wave_amplitude_um"]
    rows = {
        "order": waves[f"{gear}_wave_order"].values,
        "nodal_diameters": waves[f"{gear}_wave_diameters"].values,
        "travel_rad_s": waves[f"{gear}_wave_travel_rad_s"].values,
        **{
            f"{name}_um": amplitude.sel(component=name).values
            for name in amplitude.component.values
        },
    }
    yield Picture(f"{gear}_waves", partial(wave_pictures.wave_map, waves, gear), rows)
    levels = table.assign(rms_um=wave_level(table, gear))
    levels = levels.rename({f"{gear}_diameters": "nodal_diameters"})
    rows = columns(levels, "nodal_diameters", "pinion_speed_rad_s", "rms_um")
    probes = table.rename({f"{gear}_probe": "probe", f"{gear}_probe_rms_um": "rms_um"})
    beside = {"probes": columns(probes, "probe", "pinion_speed_rad_s", "rms_um")}
    yield Picture(f"{gear}_levels", partial(wave_pictures.wave_levels, waves, gear), rows, beside)


def wave_level(own: xr.Dataset, gear: str) -> xr.DataArray:
    """RMS of each wave, all directions on the body together, over speed and wave [um]."""
    return (own[f"{gear}_wave_rms_um"] ** 2).sum("component") ** 0.5


def _teeth_columns(flanks: xr.Dataset, gear: str) -> Columns:
    """A row for each tooth at each speed, in the order in which the teeth stand on the gear."""
    own = flanks.sortby(f"{gear}_tooth_angle_deg")
    own = own.rename(
        {f"{gear}_tooth_angle_deg": "tooth_angle_deg", f"{gear}_above_a_hole": "above_a_hole"}
    )
    names = ("pinion_speed_rad_s", "tooth_pair", "tooth_angle_deg", "line_load_max_N_mm")
    return columns(own, *names, "above_a_hole")


def animations_of_shapes(datasets: Datasets) -> Iterator[Animation]:
    """The groups `shape_GEAR` in motion."""
    for gear in _GEARS:
        if (shape := datasets.get(f"shape_{gear}")) is not None:
            yield Animation(f"{gear}_shape", partial(shape_pictures.animate_shape, shape))
