"""The gear pair as a sizing program tables it: pinion, wheel, and what both share."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from jaxgear.report._html import Markup, joined, table
from jaxgear.study._symbols import SYMBOLS

# Name, symbol of ISO 21771-1 and unit of what each gear has: a key of the scene, or of the geometry
# in the summary.
_OF_SCENE = (
    ("Number of teeth", "z", "", "{gear}.teeth"),
    ("Profile shift coefficient", "x", "", "{gear}.profile_shift"),
    ("Face width", "b", "mm", "{gear}.face_width_mm"),
    ("Bore", "", "mm", "{gear}.bore_mm"),
    ("Addendum coefficient", "h_aP*", "", "{gear}.addendum_coeff"),
    ("Dedendum coefficient", "h_fP*", "", "{gear}.dedendum_coeff"),
    ("Fillet radius coefficient of the rack", "rho_fP*", "", "{gear}.fillet_radius_coeff"),
)
_OF_GEOMETRY = (
    ("Reference diameter", "d", "mm", "reference_diameter_{gear}_mm"),
    ("Base diameter", "d_b", "mm", "base_diameter_{gear}_mm"),
    ("Tip diameter", "d_a", "mm", "tip_diameter_{gear}_mm"),
    ("Root diameter", "d_f", "mm", "root_diameter_{gear}_mm"),
    ("Root form diameter", "d_Ff", "mm", "form_diameter_{gear}_mm"),
    ("Working pitch diameter", "d_w", "mm", "working_pitch_diameter_{gear}_mm"),
    ("Tooth thickness at the tip", "s_a", "mm", "tip_thickness_{gear}_mm"),
    ("Tip clearance at its root", "c", "mm", "root_clearance_{gear}_mm"),
    ("Span measurement", "W_k", "mm", "span_{gear}_mm"),
    ("Teeth spanned", "k", "", "span_teeth_{gear}"),
    ("Dimension over balls", "M_dK", "mm", "over_balls_{gear}_mm"),
    ("Diameter of the balls", "D_M", "mm", "ball_{gear}_mm"),
)
_OF_PAIR = (
    ("Normal module", "m_n", "mm", "pair.module_mm"),
    ("Normal pressure angle", "alpha_n", "degrees", "pair.pressure_angle_deg"),
    ("Helix angle", "beta", "degrees", "pair.helix_angle_deg"),
    ("Torque on the pinion", "T_1", "N m", "pair.torque_pinion_Nm"),
    ("Speed of the pinion", "n_1", "1/min", "pair.speed_rpm"),
    ("Power", "P", "kW", "pair.power_kW"),
)
# Numbers of the summary that a sizing shows, each with its table.
_FOUND = (
    ("geometry", "Centre distance", "centre_distance", "mm"),
    ("geometry", "Working transverse pressure angle", "working_pressure_angle", "deg"),
    ("geometry", "Common face width", "common_face_width", "mm"),
    ("geometry", "Transverse contact ratio", "profile_contact_ratio", ""),
    ("geometry", "Overlap ratio", "overlap_ratio", ""),
    ("geometry", "Total contact ratio", "total_contact_ratio", ""),
    ("geometry", "Circumferential backlash", "backlash", "mm"),
    ("iso6336", "Tangential force at the reference circle", "tangential_force", "N"),
    ("iso6336", "Mesh stiffness of ISO 6336-1", "c_gamma_alpha", "N_mm_um"),
    ("static", "Mesh stiffness, calculated, mean", "mesh_stiffness_mean", "N_um"),
    ("static", "Transmission error, peak to peak", "te_peak_to_peak", "um"),
    ("static", "Largest contact pressure", "max_pressure", "MPa"),
    ("static", "Face load factor", "face_load_factor", ""),
    ("static", "Transverse load factor", "transverse_load_factor", ""),
    ("static", "Lowest specific sliding, pinion", "specific_sliding_lowest_pinion", ""),
    ("static", "Lowest specific sliding, wheel", "specific_sliding_lowest_wheel", ""),
    ("static", "Efficiency of the mesh", "mesh_efficiency", ""),
)
_UNITS = {"deg": "degrees", "N_mm_um": "N/(mm um)", "N_um": "N/um"}


def sizing_table(asked: Mapping[str, Any], summary: Mapping[str, Any]) -> Markup:
    """Write both tables; nothing without geometry in the summary.

    **Arguments:**

    - `asked`: the scene, by paths of keys.
    - `summary`: as `summary.json` has it.
    """
    geometry = summary.get("geometry")
    if not isinstance(geometry, Mapping):
        return Markup("")
    head = ("", "symbol", "unit", "pinion", "wheel")
    return joined(
        (
            table(head, [*_gears(_OF_SCENE, asked), *_gears(_OF_GEOMETRY, geometry)], "Gears"),
            table(("", "symbol", "unit", "value"), list(_pair(asked, summary)), "Pair"),
        )
    )


def _gears(
    lines: tuple[tuple[str, str, str, str], ...], values: Mapping[str, Any]
) -> Iterator[tuple[str, ...]]:
    for name, symbol, unit, key in lines:
        both = [values.get(key.format(gear=gear)) for gear in ("pinion", "wheel")]
        if any(each is not None for each in both):
            yield name, symbol, unit, *map(_shown, both)


def _pair(asked: Mapping[str, Any], summary: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    given = dict(asked)
    power, speed = (asked.get(f"pair.{key}") for key in ("power_kW", "speed_rpm"))
    if power is not None and speed:
        given["pair.torque_pinion_Nm"] = 1e3 * power / (2.0 * math.pi * speed / 60.0)
    for name, symbol, unit, key in _OF_PAIR:
        if given.get(key) is not None:
            yield name, symbol, unit, _shown(given[key])
    for group, name, key, unit in _FOUND:
        value = summary.get(group, {}).get(f"{key}_{unit}" if unit else key)
        if value is not None:
            yield name, SYMBOLS.get(key, ""), _UNITS.get(unit, unit), _shown(value)


def _shown(value: Any) -> str:
    # A backlash of 1e-15 mm is none.
    return "" if value is None else f"{0.0 if abs(value) < 1e-12 else value:.6g}"
