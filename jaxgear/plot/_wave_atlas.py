"""Pictures of condensed bodies in a sweep: waves, probes, flanks, shapes; and their tables."""

from collections.abc import Iterator

import xarray as xr

from jaxgear.plot._picture import GEARS, Animation, Datasets, Picture, columns, drawn


def pictures_of_waves(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the groups `waves` and `flanks`.

    Those of one direction show the one with the highest peak.
    """
    if (waves := datasets.get("waves")) is None:
        return
    own = waves.sel(direction=waves.attrs["peak_direction"])
    table = own.rename(speed="pinion_speed_rad_s")
    for gear in GEARS:
        if f"{gear}_wave_rms_um" in waves:
            yield from _pictures_of_gear(waves, table, gear)
    flanks = datasets["flanks"]
    loads = ("line_load_N_mm", "pressure_MPa")
    way = columns(flanks, "pinion_speed_rad_s", "passage", "face_position_mm", *loads)
    draw = drawn("_flank_pictures.flank_pressure", flanks)
    yield Picture("flank_pressure", draw, way.known("passage"))
    names = ("max_line_load_N_mm", "max_pressure_MPa")
    places = ("max_line_load_passage", "max_line_load_face_mm")
    largest = columns(table, "pinion_speed_rad_s", *names, *places)
    yield Picture("flank_loads", drawn("_flank_pictures.largest_loads", own), largest)
    names = ("tooth_angle_deg", "line_load_max_N_mm", "above_a_hole")
    for gear in GEARS:
        if (angle := f"{gear}_tooth_angle_deg") in flanks:
            own = flanks.sortby(angle)
            own = own.rename({angle: names[0], f"{gear}_above_a_hole": names[2]})
            draw = drawn("_flank_pictures.teeth_at_speed", flanks, gear)
            teeth = columns(own, "pinion_speed_rad_s", "tooth_pair", *names)
            yield Picture(f"{gear}_teeth_at_speed", draw, teeth)


def _pictures_of_gear(waves: xr.Dataset, table: xr.Dataset, gear: str) -> Iterator[Picture]:
    named = {name: f"{gear}_{name}" for name in ("probe", "order")}
    rows = columns(waves, **named, amplitude_um=f"{gear}_probe_amplitude_um")
    yield Picture(f"{gear}_spectra", drawn("_wave_pictures.wave_spectra", waves, gear), rows)
    amplitude = waves[f"{gear}_wave_amplitude_um"]
    names = {"order": "order", "nodal_diameters": "diameters", "travel_rad_s": "travel_rad_s"}
    rows = columns(waves, **{name: f"{gear}_wave_{of}" for name, of in names.items()})
    along = amplitude.component.values
    rows |= {f"{name}_um": amplitude.sel(component=name).values for name in along}
    yield Picture(f"{gear}_waves", drawn("_wave_pictures.wave_map", waves, gear), rows)
    levels = table.assign(rms_um=wave_level(table, gear))
    levels = levels.rename({f"{gear}_diameters": "nodal_diameters"})
    rows = columns(levels, "nodal_diameters", "pinion_speed_rad_s", "rms_um")
    named = {"probe": f"{gear}_probe", "pinion_speed_rad_s": "pinion_speed_rad_s"}
    beside = {"probes": columns(table, **named, rms_um=f"{gear}_probe_rms_um")}
    draw = drawn("_wave_pictures.wave_levels", waves, gear)
    yield Picture(f"{gear}_levels", draw, rows, beside)


def wave_level(own: xr.Dataset, gear: str) -> xr.DataArray:
    """RMS of each wave, all directions on the body together, over speed and wave [um]."""
    return (own[f"{gear}_wave_rms_um"] ** 2).sum("component") ** 0.5


def animations_of_shapes(datasets: Datasets) -> Iterator[Animation]:
    """The groups `shape_GEAR` in motion."""
    for gear in GEARS:
        if (shape := datasets.get(f"shape_{gear}")) is not None:
            yield Animation(f"{gear}_shape", drawn("_shape_pictures.animate_shape", shape))
