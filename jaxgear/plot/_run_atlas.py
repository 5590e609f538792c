"""Pictures of a run: the pair, its mesh cycle, its shafts and bodies, and the sizing table."""

from collections.abc import Iterator

import xarray as xr

from jaxgear.plot import _cycle_tables as tables
from jaxgear.plot._hybrid_tables import contact_line_loads, tooth_loads_columns, tooth_way_columns
from jaxgear.plot._picture import GEARS, Datasets, Picture, columns, drawn


def run_pictures(datasets: Datasets) -> Iterator[Picture]:
    """Pictures of the mesh cycle, the first dataset, and of the groups beside it."""
    cycle, pair = datasets.get(""), datasets.get("pair")
    if pair is not None:
        table = columns(pair, "gear", "S_mm", "T_mm").known("S_mm")
        yield Picture("gear_pair", drawn("_pair_pictures.gear_pair", pair), table)
        axes = datasets["axes"]
        table = columns(axes, *map(str, (*axes.coords, *axes.data_vars)))
        yield Picture("axes", drawn("_axes_pictures.axes", pair, axes), table)
    if (traces := datasets.get("modification")) is not None:
        table = columns(traces, "state", "gear", "trace", *sorted(map(str, traces.data_vars)))
        yield Picture("modification", drawn("_modification_pictures.modification", traces), table)
    if cycle is not None and "transmission_error_um" in cycle:
        if (slid := datasets.get("sliding")) is not None:
            table = columns(slid, *sorted(str(name) for name, each in slid.items() if each.dims))
            yield Picture("sliding", drawn("_sliding_pictures.sliding", slid, cycle), table)
        yield from _of_cycle(cycle)
    elif cycle is not None and "pair_te_um" in cycle:
        draw = drawn("_cycle_pictures.unloaded_error", cycle)
        beside = {
            "harmonics": columns(cycle, "harmonic", "unloaded_te_harmonic_um"),
            "tooth_pairs": tables.pair_error_columns(cycle),
        }
        table = tables.over_cycle(cycle, "unloaded_te_um")
        yield Picture("unloaded_transmission_error", draw, table, beside)
    if (roots := datasets.get("roots")) is not None:
        yield from _of_roots(roots)
    if pair is not None and (shafts := datasets.get("shafts")) is not None:
        names = ("gear", "index", "Z_mm", *(f"load_{axis}_N" for axis in "STZ"))
        bearings = columns(shafts, **{name: f"bearing_{name}" for name in names})
        table = columns(shafts, "gear", "Z_mm", "deflection_S_um", "deflection_T_um")
        draw = drawn("_shafts_pictures.shafts", pair, shafts)
        yield Picture("shafts", draw, table, {"bearings": bearings})
    if cycle is not None and "way_passage" in cycle:
        yield from _of_teeth(cycle)
    for gear in GEARS:
        if (body := datasets.get(f"{gear}_deflected")) is not None:
            names = ("angle_deg", "Z_mm", "radial_um", "tangential_um", "axial_um")
            for cause in body["cause"].values.tolist():
                draw = drawn("_hybrid_pictures.deflected_body", body, cause)
                table = columns(body.sel(cause=cause), *names)
                yield Picture(f"{gear}_under_{cause}", draw, table)
        for group in (f"{gear}_stress", f"{gear}_stress_moving"):
            if (body := datasets.get(group)) is not None:
                yield _of_stress(group, body)
    yield from _of_gauges(datasets)
    if (sized := datasets.get("sizing")) is not None:
        amounts, worst = sized["amount"].values, ("te_peak_to_peak_um", "max_pressure_MPa")
        over = ("combination", "torque")
        responses = [str(name) for name, each in sized.items() if each.dims == over]
        names = "rank", "rank_by_pressure", *amounts, "torque_pinion_Nm", *responses
        table = columns(sized, *names, *(f"worst_{name}" for name in worst))
        yield Picture("sizing", drawn("_sizing_pictures.sizing", sized), table)


def _of_stress(name: str, body: xr.Dataset) -> Picture:
    names = ("section_principal_MPa", "section_alternating_MPa")
    middles = body["section_mm"].mean("corner")
    places = {"r_mm": middles.isel(r_z=0), "Z_mm": middles.isel(r_z=1)}
    table = columns(body.assign(places), *places, *names)
    return Picture(name, drawn("_stress_pictures.body_stress", body), table)


def _of_gauges(datasets: Datasets) -> Iterator[Picture]:
    """Gauges over a revolution at rest, and by orders at the peak of a sweep; of one gear each."""
    for group, function, over in (
        ("gauges", "gauges", "turn"),
        ("gauges_moving", "gauge_spectra", "order"),
    ):
        if (found := datasets.get(group)) is None:
            continue
        tables = {}
        for gear in GEARS:
            if (gauge := f"{gear}_gauge") in found:
                units = {name: f"{gauge}_{name}" for name in ("strain_um_m", "stress_MPa")}
                place = {"gauge": gauge, {"turn": "turn_deg"}.get(over, over): f"{gear}_{over}"}
                tables[gear] = columns(found, **place, **units)
        first, *others = tables
        beside = {gear: tables[gear] for gear in others}
        yield Picture(group, drawn(f"_stress_pictures.{function}", found), tables[first], beside)
    if (found := datasets.get("gauges_swept")) is None:
        return
    shown, tables = found.rename(speed="pinion_speed_rad_s"), {}
    for gauge in (f"{gear}_gauge" for gear in GEARS if f"{gear}_gauge" in found):
        told = ("stress_largest_MPa", "stress_least_MPa", "stress_amplitude_MPa")
        of_gauge = {"gauge": gauge, **{name: f"{gauge}_{name}" for name in told}}
        place = ("direction", "pinion_speed_rad_s", "settled")
        tables[gauge.removesuffix("_gauge")] = columns(shown, *place, **of_gauge)
    first, *others = tables
    beside = {gear: tables[gear] for gear in others}
    draw = drawn("_stress_pictures.gauges_at_speed", found)
    yield Picture("gauges_at_speed", draw, tables[first], beside)


def _of_cycle(cycle: xr.Dataset) -> Iterator[Picture]:
    draw = drawn("_cycle_pictures.transmission_error", cycle)
    table = tables.over_cycle(cycle, "transmission_error_um")
    beside = {"harmonics": columns(cycle, "harmonic", "te_harmonic_um")}
    yield Picture("transmission_error", draw, table, beside)
    draw = drawn("_cycle_pictures.stiffness_and_sharing", cycle)
    beside = {"tooth_pairs": tables.load_sharing_columns(cycle)}
    table = tables.over_cycle(cycle, "mesh_stiffness_N_um")
    yield Picture("mesh_stiffness", draw, table, beside)
    draw = drawn("_cycle_pictures.flank_maps", cycle)
    yield Picture("flank_maps", draw, tables.flank_maps_columns(cycle))
    draw = drawn("_cycle_pictures.face_load", cycle)
    yield Picture("face_load", draw, tables.face_load_columns(cycle))
    if "harris_te_um" in cycle:
        named = {"torque_pinion_Nm": "torque_Nm", "phase": "phase"}
        curves = columns(cycle, **named, transmission_error_um="harris_te_um")
        draw = drawn("_cycle_pictures.harris_map", cycle)
        yield Picture("harris_map", draw, tables.harris_map_columns(cycle), {"curves": curves})
        table = columns(tables.spectra(cycle), "torque_pinion_Nm", "order", "te_order_um")
        yield Picture("te_spectrum", drawn("_cycle_pictures.te_spectrum", cycle), table)


def _of_roots(roots: xr.Dataset) -> Iterator[Picture]:
    names = "phase", "line", "face_position_mm", "gear", "root_stress_MPa", "root_compression_MPa"
    yield Picture("root_stress", drawn("_root_pictures.root_stress", roots), columns(roots, *names))
    names = "gear", "fillet", "fillet_half_thickness_mm", "fillet_height_mm", "fillet_stress_MPa"
    yield Picture(
        "root_outline", drawn("_root_pictures.root_outline", roots), columns(roots, *names)
    )


def _of_teeth(cycle: xr.Dataset) -> Iterator[Picture]:
    names = ("phase", "line", "face_position_mm", "line_load_N_mm")
    table = columns(contact_line_loads(cycle), *names)
    yield Picture("contact_lines", drawn("_hybrid_pictures.contact_line_loads", cycle), table)
    draw = drawn("_hybrid_pictures.tooth_way", cycle)
    yield Picture("tooth_way", draw, tooth_way_columns(cycle))
    for gear in GEARS:
        if f"{gear}_tooth_above_a_hole" in cycle:
            draw = drawn("_hybrid_pictures.tooth_loads", cycle, gear)
            yield Picture(f"{gear}_tooth_loads", draw, tooth_loads_columns(cycle, gear))
