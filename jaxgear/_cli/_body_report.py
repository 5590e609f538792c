"""The health report of a condensed body, for a reader."""

from collections.abc import Iterator, Mapping
from typing import Any

# Frequencies of a pair of modes, which differ by a turn, are the same within that.
_TWINS = 1e-6
_ROWS = 20


def report_lines(body: Mapping[str, Any]) -> list[str]:
    """What a body is, how good it is, and its lowest free modes: one of `bodies` in the summary."""
    parts = {
        "made from": "; ".join(_source(body)),
        "grid": "; ".join(_grid(body)),
        "kept": f"{body['condensed_dofs']:,} coordinates: {body['rim_nodes']:,} rim nodes, "
        f"{body['interior_shapes']} interior shapes; seats {', '.join(body['seats'])}",
        "mass": _mass(body),
        "rigid motions": f"{body['rigid_body_modes']}; they strain the body by "
        f"{body['rigid_body_residual']:.1e}",
        "rim growth": _growth(body),
    }
    if "tooth_deflection_of_body_um_N" in body:
        yields = 1e3 * body["tooth_deflection_of_body_um_N"]
        parts["tooth load"] = f"{yields:.4g} um under 1000 N on the rim at one tooth" + _off(
            body, "tooth_deflection_error"
        )
    compared = ("free", "free"), ("on springs", "sprung")
    words = [
        f"{what} within {body[key]:.1e}"
        for what, kind in compared
        if (key := f"largest_{kind}_frequency_error") in body
    ]
    if words:
        parts["frequencies"] = " and ".join(words) + " of the full body's"
    if (key := "largest_coupling_frequency_difference") in body:
        parts["seats"] = (
            f"rigid against averaging: frequencies on springs differ by up to {body[key]:.2%}"
        )
    if body["from_cache"]:
        parts["cost"] = f"{body['seconds']:.2g} s, from the cache"
    else:
        parts["cost"] = f"{body['seconds']:.3g} s, {body['peak_memory_MB']:,.0f} MB"
    width = max(map(len, parts))
    lines = [f"  {name:<{width}}  {text}" for name, text in parts.items() if text]
    return [str(body["gear"]), *lines, *_modes(body), ""]


def _source(body: Mapping[str, Any]) -> Iterator[str]:
    yield str(body["source"])
    if "method" in body:
        yield f"{body['method']}, {body['modes']} modes"
    if "young_GPa" in body:
        yield f"Young's modulus {body['young_GPa']:g} GPa"


def _grid(body: Mapping[str, Any]) -> Iterator[str]:
    if "nodes" in body:
        yield f"{body['elements']:,} elements, {body['nodes']:,} nodes, {body['dofs']:,} unknowns"
        if body.get("sectors", 1) > 1:
            yield f"{body['sectors']} equal sectors"
        yield f"worst Jacobian ratio {body['smallest_jacobian_ratio']:.2g}"


def _mass(body: Mapping[str, Any]) -> str:
    teeth = ""
    if "teeth_mass_kg" in body:
        teeth = (
            f", of it teeth {body['lumped_teeth_mass_kg']:.4g} laid on the rim "
            f"({body['teeth_mass_kg']:.4g} in truth; it keeps their inertia)"
        )
    text = (
        f"{body['mass_kg']:.5g} kg{teeth}; inertia {body['polar_inertia_kg_m2']:.5g} kg m2 polar, "
        f"{body['transverse_inertia_about_mid_face_kg_m2']:.5g} transverse about mid-face"
    )
    return text + _off(body, "mass_deviation", "the solid's")


def _growth(body: Mapping[str, Any]) -> str:
    mean, left, right = (
        body[f"centrifugal_growth{edge}_um_at_rad_s"] for edge in ("", "_left", "_right")
    )
    speed = max(mean, key=float)
    ends = f"left edge {left[speed]:.4g}, right {right[speed]:.4g}"
    off = _off(body, "centrifugal_growth_error")
    return f"{mean[speed]:.4g} um at {speed} rad/s ({ends}){off}"


def _off(body: Mapping[str, Any], key: str, whose: str = "the full body's") -> str:
    return f"; {abs(body[key]):.1e} off {whose}" if key in body else ""


def _modes(body: Mapping[str, Any]) -> Iterator[str]:
    """The lowest free modes, both of a pair on one line."""
    form = "  {:>7}  {:>11}  {:>9}  {:>7}  {}"
    yield form.format("mode", "Hz", "diameters", "circles", "mostly")
    rows, count = list(_rows(body)), len(body["free_frequency_Hz"])
    circles = body.get("nodal_circle", ["-"] * count)
    for modes, i in rows[:_ROWS]:
        frequency = f"{body['free_frequency_Hz'][i]:.6g}"
        yield form.format(modes, frequency, body["nodal_diameter"][i], circles[i], body["kind"][i])
    if len(rows) > _ROWS:
        yield f"  the other {len(rows) - _ROWS} are in {body['gear']}_families.csv"


def _rows(body: Mapping[str, Any]) -> Iterator[tuple[str, int]]:
    """Numbers of the modes of one line, and the first of them."""
    frequency, diameter = body["free_frequency_Hz"], body["nodal_diameter"]
    index = 0
    while index < len(frequency):
        twin = index + 1
        pair = (
            twin < len(frequency)
            and diameter[twin] == diameter[index] > 0
            and frequency[twin] < (1.0 + _TWINS) * frequency[index]
        )
        yield (f"{index + 1}, {twin + 1}" if pair else f"{index + 1}"), index
        index += 2 if pair else 1
