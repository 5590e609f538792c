"""A scene as a REXS file of version 1.5: what import reads, so that it comes back as it was.

Both flanks of a gear carry the same modifications; the u axis of both shafts is Z, the datum face
of both gears their -Z end.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from datetime import datetime
from decimal import Decimal

from jaxgear._units import mm
from jaxgear.scene._build_pair import pair_of
from jaxgear.scene._gear_tables import BearingKeys, GearKeys, ShaftKeys
from jaxgear.scene._rexs_file import Component, Relation, RexsModel, plain_number
from jaxgear.scene._rexs_flanks import Path, flank_components, paths_of
from jaxgear.scene._rexs_text import rexs_json, rexs_xml
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS, KEYS, general
from jaxgear.scene._sizes import of_material

_VERSION = "1.5"
_SIDES = ("left", "right")
# Keys that the file has a place for, below the table of each; a G stands for either gear.
_PLACES = {
    "": "schema name",
    "material.": "young_GPa poisson density_kg_m3",
    "G.material.": "young_GPa poisson density_kg_m3",
    "pair.": "module_mm pressure_angle_deg helix_angle_deg torque_pinion_Nm speed_rpm "
    "centre_distance_mm",
    "G.": "teeth profile_shift addendum_coeff tip_diameter_mm dedendum_coeff root_diameter_mm "
    "fillet_radius_coeff face_width_mm bore_mm",
    "G.shaft.": "gear_at_mm torque_at_mm",
    "G.shaft.segments[].": "length_mm outer_mm inner_mm",
    "G.shaft.bearings[].": "at_mm radial_N_m axial_N_m tilt_Nm_rad",
    "flank.G.": "crowning_um profile_crowning_um helix_slope_um profile_slope_um",
    "flank.G.tip_relief.": "depth_um extent shape",
    "flank.G.root_relief.": "depth_um extent shape",
    "flank.G.end_relief.": "side depth_um extent shape",
}
_CARRIED = {f"{table}{key}" for table, keys in _PLACES.items() for key in keys.split()}
# Keys that come back as another, which says the same.
_INSTEAD = {
    "pair.power_kW": "its torque",
    "G.span_mm": "its profile shift",
    "G.span_teeth": "",
    "G.over_balls_mm": "its profile shift",
    "G.ball_mm": "",
    "G.tip_shortening_coeff": "the tip diameter",
}


@dataclasses.dataclass
class _Writing:
    """A file as it grows."""

    parts: dict[str, Component] = dataclasses.field(default_factory=dict)
    relations: list[Relation] = dataclasses.field(default_factory=list)

    def add(self, kind: str, name: str, **attributes: tuple[str, str]) -> str:
        """A component more; its identifier."""
        return self.put(Component(kind, name, attributes))

    def put(self, component: Component) -> str:
        self.parts[identifier := str(len(self.parts) + 1)] = component
        return identifier

    def relate(self, kind: str, **roles: str) -> None:
        self.relations.append(Relation(kind, roles))

    def reference(self, origin: str, referenced: str) -> None:
        self.relate("reference", origin=origin, referenced=referenced)


def rexs_of_scene(scene: Scene, as_json: bool = False) -> tuple[str, tuple[str, ...]]:
    """Write a scene as a REXS file.

    **Arguments:**

    - `scene`: a pair, with or without shafts.
    - `as_json`: JSON (.rexsj) in place of XML (.rexs).

    **Returns:**

    The file as text, and remarks on what it has no place for.

    **Raises:**

    - `InputError` if the gears are impossible.
    """
    pair = pair_of(scene)
    file = _Writing()
    unit = file.add("gear_unit", scene.name)
    casing = file.add("gear_casing", "casing")
    file.relate("assembly", assembly=unit, part=casing)
    distance = float(pair.working_centre_distance) / mm
    given = scene.pair.centre_distance_mm
    stage = file.add("cylindrical_stage", "stage", center_distance=_mm(given or distance))
    file.relate("assembly", assembly=unit, part=stage)
    materials = _materials(file, scene)
    tips = [2.0 * float(radius) / mm for radius in pair.tip_radius]
    gears = []
    for name, path, tip in zip(GEARS, paths_of(pair), tips, strict=True):
        gear = _gear(file, scene, name, tip)
        shaft = _shaft(file, scene, name, casing)
        file.relate("assembly", assembly=unit, part=shaft)
        file.relate("assembly", assembly=shaft, part=gear)
        for part in (gear, shaft):
            file.reference(part, materials[name])
        _flanks(file, scene, name, gear, path)
        drives = "true" if name == "pinion" else "false"
        kind = "cylindrical_stage_gear_data"
        data = file.add(kind, name, is_driving_gear=(drives, "none"))
        file.relate("stage_gear_data", stage=stage, gear=gear, stage_gear_data=data)
        gears.append(gear)
    file.relate("stage", stage=stage, gear_1=gears[0], gear_2=gears[1])
    model = RexsModel(_VERSION, "1", file.parts, tuple(file.relations), {})
    date = datetime.now().astimezone().isoformat(timespec="seconds")
    text = (rexs_json if as_json else rexs_xml)(model, date)
    return text, tuple(_remarks(scene))


def _mm(value: float) -> tuple[str, str]:
    return plain_number(value), "mm"


def _plain(value: float) -> tuple[str, str]:
    return plain_number(value), "none"


def _materials(file: _Writing, scene: Scene) -> Mapping[str, str]:
    """One material of both gears where they are alike, else one of each."""
    numbers = {
        name: {
            "elastic_modulus": (plain_number(_of(scene, name, "young_GPa"), 3), "N / mm^2"),
            "poisson_ratio": _plain(_of(scene, name, "poisson")),
            "density": (plain_number(_of(scene, name, "density_kg_m3"), -3), "kg / dm^3"),
        }
        for name in GEARS
    }
    if numbers["pinion"] == numbers["wheel"]:
        return dict.fromkeys(GEARS, file.add("material", "material", **numbers["pinion"]))
    return {name: file.add("material", name, **numbers[name]) for name in GEARS}


def _of(scene: Scene, gear: str, key: str) -> float:
    value = of_material(scene, gear, key)
    assert value is not None
    return value


def _gear(file: _Writing, scene: Scene, name: str, tip: float) -> str:
    """A gear; `tip`: its tip diameter [mm]."""
    gear: GearKeys = scene.gear(name)
    hand = 1.0 if name == "pinion" else -1.0
    attributes = {
        "number_of_teeth": (str(gear.teeth), "none"),
        "normal_module": _mm(scene.pair.module_mm),
        "helix_angle_reference_diameter": (plain_number(hand * scene.pair.helix_angle_deg), "deg"),
        "face_width": _mm(gear.face_width_mm),
        "u_coordinate_on_shaft": ("0", "mm"),
        "datum_face_orientation": ("negative", "none"),
    }
    if _has_shaft(scene, name):
        middle, face = gear.shaft.gear_at_mm, gear.face_width_mm
        left = Decimal(plain_number(middle)) - Decimal(plain_number(face)) / 2
        attributes["u_coordinate_on_shaft"] = (str(left), "mm")
    drawn = {
        "tip_diameter": scene.value(f"{name}.tip_diameter_mm"),
        "root_diameter": scene.value(f"{name}.root_diameter_mm"),
        "inner_diameter": gear.bore_mm if f"{name}.bore_mm" in scene.given else None,
    }
    if gear.tip_shortening_coeff:
        drawn["tip_diameter"] = tip
    attributes |= {key: _mm(value) for key, value in drawn.items() if value}
    return file.add("cylindrical_gear", name, **attributes)


def _has_shaft(scene: Scene, name: str) -> bool:
    return f"{name}.shaft" in scene.given


def _shaft(file: _Writing, scene: Scene, name: str, casing: str) -> str:
    """A shaft with its sections, bearings and torque; bare where the gear only turns."""
    gear = scene.gear(name)
    driving = name == "pinion"
    speed = scene.pair.speed_rpm if driving else None
    turns = {"defines_speed": ("true" if speed else "false", "none")}
    if speed:
        turns["rotational_speed"] = (plain_number(speed), "1 / min")
    shaft = file.add("shaft", f"shaft of {name}", **turns)
    keys: ShaftKeys = gear.shaft
    at = "0"
    if _has_shaft(scene, name):
        _sections(file, shaft, keys)
        for row in keys.bearings:
            file.relate("side", assembly=_bearing(file, row), inner_part=shaft, outer_part=casing)
        place = keys.gear_at_mm if keys.torque_at_mm is None else keys.torque_at_mm
        at = plain_number(place)
    ratio = 1.0 if driving else scene.wheel.teeth / scene.pinion.teeth
    load = file.add(
        "external_load",
        f"torque on {name}",
        u_coordinate_on_shaft=(at, "mm"),
        torque_around_u_axis=(plain_number(scene.pair.torque_pinion_Nm * ratio), "N m"),
        transmits_torque=("true", "none"),
        defines_torque=("true" if driving else "false", "none"),
    )
    file.relate("assembly", assembly=shaft, part=load)
    return shaft


def _sections(file: _Writing, shaft: str, keys: ShaftKeys) -> None:
    at = Decimal(0)
    for each in keys.segments:
        outer, inner = _mm(each.outer_mm), _mm(each.inner_mm)
        section = file.add(
            "shaft_section",
            "section",
            u_coordinate_on_shaft=(str(at), "mm"),
            length=_mm(each.length_mm),
            outer_diameter_begin=outer,
            outer_diameter_end=outer,
            inner_diameter_begin=inner,
            inner_diameter_end=inner,
        )
        at += Decimal(plain_number(each.length_mm))
        file.relate("assembly", assembly=shaft, part=section)


def _bearing(file: _Writing, row: BearingKeys) -> str:
    """A bearing; what it does not hold has a stiffness of zero."""
    radial = row.radial_N_m
    if radial is None:
        radial = 0.5 * ((row.radial_S_N_m or 0.0) + (row.radial_T_N_m or 0.0))
    axial = row.axial_N_m or 0.0
    return file.add(
        "concept_bearing",
        "bearing",
        u_coordinate_on_shaft_inner_side=_mm(row.at_mm),
        radial_stiffness=(plain_number(radial), "N / m"),
        axial_stiffness=(plain_number(axial), "N / m"),
        bending_stiffness=(plain_number(row.tilt_Nm_rad or 0.0, 3), "N mm / rad"),
        axial_force_absorption=("both_directions" if axial else "no_direction", "none"),
        radial_force_absorption=("true" if radial else "false", "none"),
    )


def _flanks(file: _Writing, scene: Scene, name: str, gear: str, path: Path) -> None:
    """Both flanks of a gear with the rack that cuts them and what they are modified by."""
    keys: GearKeys = scene.gear(name)
    shift = _plain(keys.profile_shift)
    attributes = {
        "normal_pressure_angle": (plain_number(scene.pair.pressure_angle_deg), "deg"),
        "addendum_modification_coefficient": shift,
    }
    if f"{name}.tip_diameter_mm" not in scene.given and not keys.tip_shortening_coeff:
        attributes["addendum_coefficient_basic_profile"] = _plain(keys.addendum_coeff)
    sides = {side: file.add("cylindrical_gear_flank", side, **attributes) for side in _SIDES}
    file.relate("flank", gear=gear, **sides)
    rack = file.add(
        "rack_shaped_tool",
        f"rack of {name}",
        addendum_coefficient_reference_profile=_plain(keys.dedendum_coeff),
        tip_radius_factor=_plain(keys.fillet_radius_coeff),
    )
    kind = "cylindrical_gear_manufacturing_settings"
    settings = file.add(kind, name, generated_addendum_modification_coefficient=shift)
    modified = [file.put(each) for each in flank_components(scene.flank.gear(name), path)]
    for flank in sides.values():
        file.relate(
            "manufacturing_step", workpiece=flank, tool=rack, manufacturing_settings=settings
        )
        for each in modified:
            file.reference(flank, each)


def _remarks(scene: Scene) -> Iterator[str]:
    """What the file has no place for, of what the scene says and not by default."""
    told: dict[str, None] = {}
    for path in sorted(scene.given):
        key = general(path)
        if key not in KEYS or scene.value(path) == KEYS[key].default:
            continue
        short = _either(key)
        if short in _INSTEAD:
            if _INSTEAD[short]:
                yield f"Instead of {path} the file has {_INSTEAD[short]}."
        elif short not in _CARRIED:
            told.setdefault(key)
    if told:
        yield f"Left out: {', '.join(told)}."
    yield (
        "The sign of helix_slope and profile_slope is that of the scene: positive where material "
        "is added at the non-datum face (+Z), or at the tip."
    )


def _either(key: str) -> str:
    """A key with G for the name of a gear."""
    steps = ["G" if step in GEARS else step for step in key.split(".")]
    return ".".join(steps)
