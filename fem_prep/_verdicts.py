"""What of a condensed body is not as it should be, and what to do."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

# What is not as it should be. Frequencies and statics: what the synthesis promises.
_MASS_OFF = 1e-3
_RIGID_ENERGY = 1e-8
_FREQUENCY_OFF = 1e-3
_STATIC_OFF = 1e-7
# Frequencies on springs that differ by more say that the coupling of the seats is a decision.
_COUPLING_OFF = 0.02
# The skin in the place of teeth keeps their inertia, not their mass: what of that is worth a word.
_SKIN_OFF = 0.01
# Slender bricks stiffen thin webs, skew ones everything; both are fair well beyond what gears need.
_JACOBIAN, _ASPECT = 0.1, 25.0
# One element of 1.5 root thicknesses per tooth gives 4% less deflection under an even load than
# elements of 0.4, one of 0.75 gives 0.6% less; longer ones carry two teeth.
_LONG_ELEMENT = 2.0
_FEWEST_ACROSS = 2


def verdicts(report: Mapping[str, Any]) -> list[str]:
    """What of a health report is not as it should be, and what to do.

    **Arguments:**

    - `report`: see `health_report`; what it lacks is not judged.

    **Returns:**

    Sentences; none if all is well.
    """
    return [
        *_of_mass(report),
        *_of_rigid_motions(report),
        *_of_truncation(report),
        *_of_statics(report),
        *_of_seats(report),
        *_of_grid(report),
    ]


def _value(report: Mapping[str, Any], key: str, otherwise: float = 0.0) -> float:
    value = report.get(key, otherwise)
    return float(value) if isinstance(value, int | float) else otherwise


def _largest(report: Mapping[str, Any], key: str) -> float:
    values = report.get(key, [])
    return max(values) if isinstance(values, list) and values else 0.0


def _of_mass(report: Mapping[str, Any]) -> Iterator[str]:
    if report.get("mass_definite") is False:
        yield (
            "The condensed mass is not positive definite, so the body cannot be moved in time. "
            "Condense it again, or check the files that it came from."
        )
    off = {
        "mass": _value(report, "mass_deviation"),
        "polar inertia": _value(report, "polar_inertia_deviation"),
        "transverse inertia": _value(report, "transverse_inertia_deviation"),
    }
    name, worst = max(off.items(), key=lambda each: abs(each[1]))
    if abs(worst) > _MASS_OFF:
        cause = (
            "The grid is too coarse for its arcs, or not of this body, or the density is another "
            "one: refine it, or correct the density."
        )
        if not 0.1 < 1 + worst < 10:
            cause = "The units are wrong: check those of lengths and of the density."
        yield (
            f"The {name} is {_percent(worst)} {'above' if worst > 0 else 'below'} that of the "
            f"solid and should match it to {_percent(_MASS_OFF)}. {cause}"
        )
    if _value(report, "condensed_mass_deviation") > _RIGID_ENERGY:
        yield (
            "The condensed body does not weigh what the full one does: rigid motions differ by "
            f"{_value(report, 'condensed_mass_deviation'):.1e}, which should be rounding only. "
            "Condense it again."
        )
    skin, teeth = _value(report, "lumped_teeth_mass_kg"), _value(report, "teeth_mass_kg")
    excess = (skin - teeth) / _value(report, "mass_kg", math.inf)
    if excess > _SKIN_OFF:
        yield (
            f"The teeth are laid on the rim so that they keep their polar inertia. As {skin:.4g} "
            f"kg, where they weigh {teeth:.4g}, they make the body {_percent(excess)} too heavy: "
            "allow for it where the body moves sideways or along its axis, or leave them out."
        )


def _of_rigid_motions(report: Mapping[str, Any]) -> Iterator[str]:
    count = report.get("rigid_body_modes", 6)
    if count != 6:
        yield (
            f"The body has {count} rigid-body modes and must have six. More: parts that hang "
            "together by an edge, or not at all. Fewer: something holds it."
        )
    energy = max(
        _largest(report, "rigid_body_energy_relative"),
        _largest(report, "full_rigid_body_energy_relative"),
    )
    if energy > _RIGID_ENERGY:
        yield (
            f"Rigid motions store energy, {energy:.1e} of what their displacements would store "
            f"alone; it should be below {_RIGID_ENERGY:.0e}. Something holds the body, nodes are "
            "not where the matrices think, or the matrices were written with few digits."
        )


def _of_truncation(report: Mapping[str, Any]) -> Iterator[str]:
    for name, words in (("sprung", "on springs"), ("free", "of the free body")):
        error = _value(report, f"largest_{name}_frequency_error")
        if error > _FREQUENCY_OFF:
            method = report.get("method")
            remedy = "Keep more modes" + ("." if method == "herting" else ", or take Herting's.")
            yield (
                f"Natural frequencies {words} are up to {_percent(error)} off those of the full "
                f"body, and should match to {_percent(_FREQUENCY_OFF)}. {remedy}"
            )
            return


def _of_statics(report: Mapping[str, Any]) -> Iterator[str]:
    for key, what in (
        ("tooth_deflection_error", "deflection under a tooth load"),
        ("centrifugal_growth_error", "centrifugal growth"),
    ):
        error = _value(report, key)
        if error > _STATIC_OFF:
            yield (
                f"The {what} of the condensed body is {error:.1e} off that of the full one; it "
                f"should be exact but for rounding, {_STATIC_OFF:.0e}. Are there bricks much worse "
                "than the others, or springs much stiffer than the body?"
            )


def _of_seats(report: Mapping[str, Any]) -> Iterator[str]:
    difference = _value(report, "largest_coupling_frequency_difference")
    if difference > _COUPLING_OFF:
        yield (
            f"Frequencies on springs change by up to {_percent(difference)} between rigid seats "
            "and averaging ones. Take rigid ones where a ring or a hub grips the seat tightly, "
            "averaging ones where it is soft."
        )


def _of_grid(report: Mapping[str, Any]) -> Iterator[str]:
    ratio = _value(report, "smallest_jacobian_ratio", 1.0)
    slender = _value(report, "largest_aspect_ratio", 1.0)
    if ratio < _JACOBIAN:
        place = report.get("worst_brick_mm", [])
        where = ", ".join(f"{x:.3f}" for x in place) if isinstance(place, list) else ""
        yield (
            f"The worst brick, at {where} mm, is badly distorted: its Jacobian ratio is "
            f"{ratio:.3f} and should be above {_JACOBIAN:g}. Mesh that place more evenly."
        )
    if slender > _ASPECT:
        yield (
            f"A brick has edges of which one is {slender:.0f} times as long as another; above "
            f"{_ASPECT:g} stresses and bending get poor. Use more elements along it."
        )
    across = _value(report, "rim_elements_across", float(_FEWEST_ACROSS))
    if round(across) < _FEWEST_ACROSS:
        yield (
            f"The rim has {across:.0f} element across the toothed face and should have at least "
            f"{_FEWEST_ACROSS}, or loads along the face are smeared. Use more."
        )
    arc, root = _value(report, "rim_element_arc_mm"), _value(report, "root_thickness_mm")
    if root and arc > _LONG_ELEMENT * root:
        yield (
            f"An element of the rim is {arc:.2f} mm long around, {arc / root:.1f} times the "
            f"thickness of a tooth at its root, {root:.2f} mm. The body is too stiff under one "
            "tooth then: use at least one element per tooth."
        )


def _percent(part: float) -> str:
    return f"{100 * abs(part):.2g}%"
