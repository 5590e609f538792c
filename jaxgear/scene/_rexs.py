"""Cylindrical stages of REXS files (Reusable Engineering EXchange Standard, rexs.info) as scenes.

Versions 1.0 to 2.0 as XML. What is read: stages, gears, shafts of sections, bearings, loads of
shafts. Names of attributes are those of the REXS database; a gear's coordinate on its shaft is
that of its left side.
"""

import itertools
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from jaxgear._checks import InputError, require

# What one of a unit is in that of the scene's keys: mm, degrees, N m, N/m, N m/rad.
_UNITS = {
    "mm": 1.0,
    "m": 1e3,
    "°": 1.0,
    "rad": 180.0 / math.pi,
    "none": 1.0,
    "N m": 1.0,
    "kN m": 1e3,
    "N / m": 1.0,
    "N / mm": 1e3,
    "N / mum": 1e6,
    "N mm / rad": 1e-3,
    "N m / rad": 1.0,
    "1 / min": 1.0,
}
# Of a bearing where a file says none, or one that no bearing has [N/m, N/m, N m/rad].
_USUAL = {"radial_N_m": 1e9, "axial_N_m": 1e8, "tilt_Nm_rad": 1e4}
_BEARING = {
    "radial_N_m": "radial_stiffness",
    "axial_N_m": "axial_stiffness",
    "tilt_Nm_rad": "bending_stiffness",
}
_STIFFEST = 1e12
_READ = {
    *("gear_unit", "gear_casing", "cylindrical_stage", "cylindrical_gear", "shaft"),
    *("shaft_section", "external_load", "stage_gear_data", "rolling_bearing_row"),
    *("flank_geometry", "cylindrical_gear_flank"),
}


class Imported(NamedTuple):
    """A stage of a file as keys of a scene.

    **Fields:**

    - `keys`: tables of the scene, nested, in the units of the keys.
    - `remarks`: what was left out, and what was assumed.
    """

    keys: Mapping[str, Any]
    remarks: tuple[str, ...]


class _Component(NamedTuple):
    """One component: its type, its name, and its plain attributes with their units."""

    kind: str
    name: str
    attributes: Mapping[str, tuple[str, str]]

    def number(self, name: str) -> float | None:
        """An attribute as a number in the scene's unit; `None` where it is left out."""
        text, unit = self.attributes.get(name, ("", "none"))
        if not text:
            return None
        try:
            value = float(text) * _UNITS[unit]
        except (ValueError, KeyError):
            raise InputError(
                f"{self.kind} {self.name}: {name} must be a number in a unit that is known, got "
                f"{text} in {unit}."
            ) from None
        require(math.isfinite(value), "{name} must be finite, got {text}.", name=name, text=text)
        return value

    def needed(self, name: str) -> float:
        """The same, refused where it is left out."""
        value = self.number(name)
        if value is None:
            raise InputError(f"{self.kind} {self.name}: {name} is missing, without which no scene.")
        return value


class _Builder(ET.TreeBuilder):
    """Builds a tree of a document without a type of its own: entities could grow without end."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise InputError("A REXS file has no DOCTYPE. Write it again without.")


class _Model:
    """Components of a file, and who belongs to whom."""

    def __init__(self, content: bytes):
        try:
            root = ET.fromstring(content, ET.XMLParser(target=_Builder()))
        except ET.ParseError as error:
            raise InputError(f"not a REXS file: no XML: {error}.") from None
        # 2.0 may name a space.
        for each in root.iter():
            each.tag = each.tag.rpartition("}")[2] if isinstance(each.tag, str) else ""
        require(root.tag == "model", "not a REXS file: its root is {got}.", got=root.tag)
        self.version = root.get("version", "")
        self.application = root.get("applicationId", "")
        self.parts = {
            each.get("id", ""): _component(each) for each in root.iterfind("components/component")
        }
        self.relations = [
            (each.get("type", ""), {ref.get("role", ""): ref.get("id", "") for ref in each})
            for each in root.iterfind("relations/relation")
        ]

    def those(self, kind: str, **roles: str) -> Iterator[Mapping[str, str]]:
        """Relations of a kind in which some roles are played by given components."""
        for each, refs in self.relations:
            if each == kind and all(refs.get(role) == of for role, of in roles.items()):
                yield refs

    def shaft_of(self, part: str) -> str:
        """The shaft that carries a component."""
        for refs in self.those("assembly", part=part):
            if (shaft := refs.get("assembly", "")) in self.parts:
                return shaft
        raise InputError(f"The gear {part} is on no shaft.")

    def parts_on(self, shaft: str, kind: str) -> list[_Component]:
        """Components of a kind on a shaft."""
        ids = [refs.get("part", "") for refs in self.those("assembly", assembly=shaft)]
        return [
            self.parts[each] for each in ids if each in self.parts and self.parts[each].kind == kind
        ]


def _component(element: ET.Element) -> _Component:
    attributes = {
        each.get("id", ""): ((each.text or "").strip(), each.get("unit", "none"))
        for each in element.iterfind("attribute")
    }
    return _Component(element.get("type", ""), element.get("name", ""), attributes)


def scene_of_rexs(path: Path, stage: str = "") -> Imported:
    """Read a cylindrical stage of a REXS file.

    **Arguments:**

    - `path`: of the file (.rexs, XML).
    - `stage`: identifier of the stage; may be left out where there is one.

    **Raises:**

    - `InputError` if the file is none of REXS, has no such stage, or lacks what a scene needs.
    """
    try:
        model = _Model(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}.") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    gears = _gears_of(model, stage)
    pinion, wheel = (model.parts[each] for each in gears)
    remarks: list[str] = []
    flanks = [_flank(model, each) for each in gears]
    angles = [flank.number("normal_pressure_angle") for flank in flanks if flank]
    pressure_angle = next((each for each in angles if each is not None), None)
    if pressure_angle is None:
        pressure_angle = 20.0
        remarks.append("The pressure angle is missing: 20 degrees are taken.")
    keys: dict[str, Any] = {
        "schema": 1,
        "name": path.stem,
        "cite": f"REXS {model.version} file {path.name} of {model.application or 'nobody named'}",
        "pair": {
            "module_mm": pinion.needed("normal_module"),
            "pressure_angle_deg": pressure_angle,
            "helix_angle_deg": pinion.number("helix_angle_reference_diameter") or 0.0,
            "torque_pinion_Nm": _torque(model, gears, remarks),
        },
    }
    for name, part, gear, flank in zip(
        ("pinion", "wheel"), gears, (pinion, wheel), flanks, strict=True
    ):
        keys[name] = _gear(gear, flank) | {"shaft": _shaft(model, name, part, remarks)}
    left = sorted({each.kind for each in model.parts.values()} - _READ)
    left = [each for each in left if "bearing" not in each]
    if left:
        remarks.append(f"Left out: {', '.join(left)}.")
    remarks.append(
        "Both faces are taken as centred on each other, a bearing's coordinate as its middle; "
        "modifications of flanks are not read."
    )
    of_stage = model.parts.get(_stage_of(model, gears))
    if distance := of_stage and of_stage.number("center_distance"):
        remarks.append(
            f"The centre distance follows from the profile shifts; the file has {distance:g} mm: "
            "compare geometry.centre_distance_mm of a run."
        )
    return Imported(keys, tuple(remarks))


def _stage_of(model: _Model, gears: list[str]) -> str:
    """Identifier of the stage of two gears."""
    return next(
        refs["stage"]
        for refs in model.those("stage")
        if {refs.get("gear_1"), refs.get("gear_2")} == set(gears)
    )


def _gears_of(model: _Model, stage: str) -> list[str]:
    """Identifiers of pinion and wheel of a stage."""
    stages = {
        refs["stage"]: refs
        for refs in model.those("stage")
        if {"stage", "gear_1", "gear_2"} <= refs.keys()
        and all(_known(model, refs[role], "cylindrical_gear") for role in ("gear_1", "gear_2"))
    }
    told = ", ".join(
        f"{each} ({model.parts[refs['gear_1']].number('number_of_teeth'):g} and "
        f"{model.parts[refs['gear_2']].number('number_of_teeth'):g} teeth)"
        for each, refs in stages.items()
        if all(model.parts[refs[role]].number("number_of_teeth") for role in ("gear_1", "gear_2"))
    )
    require(stages, "there is no stage of two external cylindrical gears in the file.")
    require(
        stage in stages or (not stage and len(stages) == 1),
        "name one of its stages with --stage: {told}.",
        told=told or ", ".join(stages),
    )
    refs = stages[stage] if stage else next(iter(stages.values()))
    both = [refs["gear_1"], refs["gear_2"]]
    return sorted(both, key=lambda each: model.parts[each].needed("number_of_teeth"))


def _known(model: _Model, part: str, kind: str) -> bool:
    return part in model.parts and model.parts[part].kind == kind


def _flank(model: _Model, gear: str) -> _Component | None:
    """The left flank of a gear, or the right one where there is one only."""
    for refs in model.those("flank", gear=gear):
        for side in ("left", "right"):
            if refs.get(side) in model.parts:
                return model.parts[refs[side]]
    return None


def _gear(gear: _Component, flank: _Component | None) -> dict[str, Any]:
    found: dict[str, Any] = {
        "teeth": round(_teeth(gear)),
        "face_width_mm": gear.needed("face_width"),
    }
    if flank and (shift := flank.number("addendum_modification_coefficient")) is not None:
        found["profile_shift"] = shift
    for key, name in (
        ("tip_diameter_mm", "tip_diameter"),
        ("root_diameter_mm", "root_diameter"),
        ("bore_mm", "inner_diameter"),
    ):
        if value := gear.number(name):
            found[key] = abs(value)
    return found


def _teeth(gear: _Component) -> float:
    number = gear.needed("number_of_teeth")
    require(number >= 1.0, "{name} must have teeth, got {got:g}.", name=gear.name, got=number)
    return number


def _torque(model: _Model, gears: list[str], remarks: list[str]) -> float:
    """Torque on the pinion, passed on from loaded shafts through the stages, without losses."""
    known: dict[str, float] = {}
    for shaft, part in model.parts.items():
        if part.kind == "shaft":
            loads = [
                x.number("torque_around_u_axis") for x in model.parts_on(shaft, "external_load")
            ]
            if largest := max((abs(each) for each in loads if each), default=0.0):
                known[shaft] = largest
    sides = [
        [
            (model.shaft_of(refs[role]), _teeth(model.parts[refs[role]]))
            for role in ("gear_1", "gear_2")
        ]
        for refs in model.those("stage")
        if all(
            _known(model, refs.get(role, ""), "cylindrical_gear") for role in ("gear_1", "gear_2")
        )
    ]
    for _ in sides:
        for one, other in itertools.chain(sides, ([b, a] for a, b in sides)):
            if one[0] in known and other[0] not in known:
                known[other[0]] = known[one[0]] * abs(other[1] / one[1])
    torque = known.get(model.shaft_of(gears[0]))
    if torque is None:
        remarks.append("No shaft has a torque: 1 N m is taken. Set pair.torque_pinion_Nm.")
    return 1.0 if torque is None else torque


def _shaft(model: _Model, name: str, gear: str, remarks: list[str]) -> dict[str, Any]:
    """Segments, bearings, and where the gear is, from the shaft's own left end on."""
    shaft = model.shaft_of(gear)
    sections = sorted(
        model.parts_on(shaft, "shaft_section"), key=lambda x: x.needed("u_coordinate_on_shaft")
    )
    require(sections, "the {name}'s shaft has no sections.", name=name)
    start = sections[0].needed("u_coordinate_on_shaft")
    if any(_is_cone(each) for each in sections):
        remarks.append(f"{name}: a conical section of the shaft has its mean diameters.")
    part = model.parts[gear]
    middle = part.needed("u_coordinate_on_shaft") + 0.5 * part.needed("face_width") - start
    return {
        "gear_at_mm": middle,
        "segments": [
            {
                "length_mm": each.needed("length"),
                "outer_mm": _mean(each, "outer_diameter"),
                "inner_mm": _mean(each, "inner_diameter"),
            }
            for each in sections
        ],
        "bearings": list(_bearings(model, name, shaft, start, remarks)),
    }


def _is_cone(section: _Component) -> bool:
    ends = [section.number(f"outer_diameter_{end}") for end in ("begin", "end")]
    return ends[0] != ends[1]


def _mean(section: _Component, name: str) -> float:
    return 0.5 * sum(section.number(f"{name}_{end}") or 0.0 for end in ("begin", "end"))


def _bearings(
    model: _Model, name: str, shaft: str, start: float, remarks: list[str]
) -> Iterator[dict[str, Any]]:
    for refs in model.those("side", inner_part=shaft):
        part = model.parts.get(refs.get("assembly", ""))
        if part is None or "bearing" not in part.kind:
            continue
        found = {"at_mm": part.needed("u_coordinate_on_shaft_inner_side") - start}
        taken = []
        for key, attribute in _BEARING.items():
            value = part.number(attribute)
            if value is None or not 0.0 < value < _STIFFEST:
                value = _USUAL[key]
                taken.append(f"{key} = {value:g}")
            found[key] = value
        if taken:
            remarks.append(
                f"{name}: bearing {part.name or part.kind} has no such stiffness in the file: "
                f"{', '.join(taken)} taken."
            )
        yield found
