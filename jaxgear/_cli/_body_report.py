"""The health report of a condensed body, for a reader."""

from collections.abc import Iterator, Mapping
from typing import Any

# Frequencies of a pair of modes, which differ by a turn, are the same within that.
_TWINS = 1e-6
_ROWS = 20


def report_lines(body: Mapping[str, Any]) -> list[str]:
    """What a body is, how good it is, and its lowest free modes.

    **Arguments:**

    - `body`: one of `bodies` in the summary.

    **Returns:**

    Lines of text.
    """
    parts = {
        "made from": _source(body),
        "grid": _grid(body),
        "kept": f"{body['condensed_dofs']:,} coordinates: {body['rim_nodes']:,} rim nodes, "
        f"{body['interior_shapes']} interior shapes; seats {', '.join(body['seats'])}",
        "mass": _mass(body),
        "rigid motions": f"{body['rigid_body_modes']}; they strain the body by "
        f"{body['rigid_body_residual']:.1e}",
        "rim growth": _growth(body),
        "tooth load": _tooth(body),
        "frequencies": _frequencies(body),
        "seats": _seats(body),
        "cost": _cost(body),
    }
    width = max(map(len, parts))
    lines = [f"{body['gear']}"]
    lines += [f"  {name:<{width}}  {text}" for name, text in parts.items() if text]
    return [*lines, *_modes(body), ""]


def _source(body: Mapping[str, Any]) -> str:
    words = [str(body["source"])]
    if "method" in body:
        words.append(f"{body['method']}, {body['modes']} modes")
    if "young_GPa" in body:
        words.append(f"Young's modulus {body['young_GPa']:g} GPa")
    return "; ".join(words)


def _grid(body: Mapping[str, Any]) -> str:
    if "nodes" not in body:
        return ""
    words = [f"{body['elements']:,} elements, {body['nodes']:,} nodes, {body['dofs']:,} unknowns"]
    if body.get("sectors", 1) > 1:
        words.append(f"{body['sectors']} equal sectors")
    words.append(f"worst Jacobian ratio {body['smallest_jacobian_ratio']:.2g}")
    return "; ".join(words)


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
    return (
        f"{mean[speed]:.4g} um at {speed} rad/s (left edge {left[speed]:.4g}, right "
        f"{right[speed]:.4g})" + _off(body, "centrifugal_growth_error")
    )


def _tooth(body: Mapping[str, Any]) -> str:
    if "tooth_deflection_of_body_um_N" not in body:
        return ""
    return (
        f"{1e3 * body['tooth_deflection_of_body_um_N']:.4g} um under 1000 N on the rim at one tooth"
        + _off(body, "tooth_deflection_error")
    )


def _frequencies(body: Mapping[str, Any]) -> str:
    words = [
        f"{what} within {body[key]:.1e}"
        for what, key in (
            ("free", "largest_free_frequency_error"),
            ("on springs", "largest_sprung_frequency_error"),
        )
        if key in body
    ]
    return " and ".join(words) + " of the full body's" if words else ""


def _off(body: Mapping[str, Any], key: str, whose: str = "the full body's") -> str:
    return f"; {abs(body[key]):.1e} off {whose}" if key in body else ""


def _seats(body: Mapping[str, Any]) -> str:
    key = "largest_coupling_frequency_difference"
    if key not in body:
        return ""
    return f"rigid against averaging: frequencies on springs differ by up to {body[key]:.2%}"


def _cost(body: Mapping[str, Any]) -> str:
    if body["from_cache"]:
        return f"{body['seconds']:.2g} s, from the cache"
    return f"{body['seconds']:.3g} s, {body['peak_memory_MB']:,.0f} MB"


def _modes(body: Mapping[str, Any]) -> Iterator[str]:
    """The lowest free modes, both of a pair on one line."""
    form = "  {:>7}  {:>11}  {:>9}  {:>7}  {}"
    yield form.format("mode", "Hz", "diameters", "circles", "mostly")
    rows, circles = list(_rows(body)), body.get("nodal_circle")
    for modes, index in rows[:_ROWS]:
        yield form.format(
            modes,
            f"{body['free_frequency_Hz'][index]:.6g}",
            body["nodal_diameter"][index],
            "-" if circles is None else circles[index],
            body["kind"][index],
        )
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
