"""Shafts of a REXS file as a scene has them: sections, bearings, where the torque enters."""

import itertools
from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal
from typing import Any

from jaxgear.scene._rexs_file import Component
from jaxgear.scene._rexs_stage import GEAR, ROLES, RexsStage, parts_on, shaft_of, teeth_of

# Of a bearing where a file says none, or one that no bearing has [N/m, N/m, N m/rad].
_USUAL = {"radial_N_m": 1e9, "axial_N_m": 1e8, "tilt_Nm_rad": 1e4}
_BEARING = {
    "radial_N_m": "radial_stiffness",
    "axial_N_m": "axial_stiffness",
    "tilt_Nm_rad": "bending_stiffness",
}
_STIFFEST = 1e12


def torque_of(load: Component) -> float:
    """Amount of the torque of a load about the shaft [N m]."""
    return abs(load.number("torque_around_u_axis") or 0.0)


def passed_on(it: RexsStage, of: Callable[[str], float], *, forwards: bool) -> float | None:
    """What the pinion's shaft has, passed on from others through the stages, without losses.

    `forwards`: in proportion to the teeth, as torques are; else against them, as speeds are.
    """
    model = it.model
    known = {
        each: value for each, x in model.parts.items() if x.kind == "shaft" and (value := of(each))
    }
    sides = [
        [(shaft_of(model, refs[role]), teeth_of(model.parts[refs[role]])) for role in ROLES]
        for refs in model.those("stage")
        if all(model.is_a(refs.get(role, ""), GEAR) for role in ROLES)
    ]
    for _ in sides:
        for one, other in itertools.chain(sides, ([b, a] for a, b in sides)):
            if one[0] in known and other[0] not in known:
                ratio = other[1] / one[1] if forwards else one[1] / other[1]
                known[other[0]] = known[one[0]] * ratio
    return known.get(it.shaft_of("pinion"))


def shaft_keys(it: RexsStage, name: str) -> Mapping[str, Any]:
    """Segments, bearings, and where the gear is, from the shaft's own left end on."""
    shaft, part, remarks = it.shaft_of(name), it.part(name), it.remarks
    place = lambda x: x.needed("u_coordinate_on_shaft")
    sections = sorted(parts_on(it, shaft, "shaft_section"), key=place)
    lacking = [] if sections else ["sections"]
    lacking += [] if list(_held(it, shaft)) else ["bearings"]
    if lacking:
        told = " and no ".join(lacking)
        remarks.append(f"{name}: its shaft has no {told} in the file, so the gear only turns.")
        return {}
    start = place(sections[0])
    if any(_is_cone(each) for each in sections):
        remarks.append(f"{name}: a conical section of the shaft has its mean diameters.")
    if len(parts_on(it, shaft, GEAR)) > 1:
        remarks.append(f"{name}: mass and forces of the other gears on its shaft are left out.")
    middle = float(place(part) + part.needed("face_width") / 2 - start)
    keys: dict[str, Any] = {
        "gear_at_mm": middle,
        "segments": [
            {
                "length_mm": float(each.needed("length")),
                "outer_mm": _mean(each, "outer_diameter"),
                "inner_mm": _mean(each, "inner_diameter"),
            }
            for each in sections
        ],
        "bearings": list(_bearings(it, name, shaft, start)),
    }
    loads = sorted(parts_on(it, shaft, "external_load"), key=torque_of)
    if loads and torque_of(loads[-1]) and loads[-1].decimal("u_coordinate_on_shaft") is not None:
        at = float(place(loads[-1]) - start)
        if at != middle:
            keys["torque_at_mm"] = at
    return {"shaft": keys}


def _is_cone(section: Component) -> bool:
    ends = [section.number(f"outer_diameter_{end}") for end in ("begin", "end")]
    return ends[0] != ends[1]


def _mean(section: Component, name: str) -> float:
    return 0.5 * sum(section.number(f"{name}_{end}") or 0.0 for end in ("begin", "end"))


def _held(it: RexsStage, shaft: str) -> Iterator[Component]:
    """Bearings of a shaft."""
    for refs in it.model.those("side", inner_part=shaft):
        part = it.model.parts.get(refs.get("assembly", ""))
        if part and "bearing" in part.kind:
            yield part


def _bearings(it: RexsStage, name: str, shaft: str, start: Decimal) -> Iterator[Mapping[str, Any]]:
    for part in _held(it, shaft):
        found = {"at_mm": float(part.needed("u_coordinate_on_shaft_inner_side") - start)}
        taken = []
        for key, attribute in _BEARING.items():
            value = part.number(attribute)
            # Of a bearing from a catalogue a stiffness of 0 is one that is not known.
            if value == 0.0 and part.kind == "concept_bearing":
                continue
            if value is None or not 0.0 < value < _STIFFEST:
                value = _USUAL[key]
                taken.append(f"{key} = {value:g}")
            found[key] = value
        if taken:
            it.remarks.append(
                f"{name}: bearing {part.name or part.kind} has no such stiffness in the file: "
                f"{', '.join(taken)} taken."
            )
        yield found
