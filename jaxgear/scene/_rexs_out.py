"""A scene as a REXS file of version 1.5: what import reads, so that it comes back as it was.

Both flanks of a gear carry the same modifications; the u axis of both shafts is Z, the datum face
of both gears their -Z end.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from decimal import Decimal

from jaxgear._units import mm
from jaxgear.scene._build_pair import pair_of
from jaxgear.scene._gear_tables import BearingKeys, GearKeys, PairKeys, ShaftKeys
from jaxgear.scene._rexs_file import Component, Relation, RexsModel, plain_number
from jaxgear.scene._rexs_flanks import flank_components, paths_of
from jaxgear.scene._rexs_text import rexs_json, rexs_xml
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS, KEYS, general
from jaxgear.scene._sizes import of_material
from jaxgear.scene._tables import AbstractTables

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
    materials = _materials(file, scene.plain)
    tips = [2.0 * float(radius) / mm for radius in pair.tip_radius]
    gears = []
    for name, path, tip in zip(GEARS, paths_of(pair), tips, strict=True):
        keys, drives = scene.gear(name), name == "pinion"
        gear = _gear(file, name, keys, scene.pair, tip)
        speed = scene.pair.speed_rpm if drives else None
        shaft = _shaft(file, name, keys.shaft, casing, speed)
        ratio = 1.0 if drives else scene.wheel.teeth / scene.pinion.teeth
        torque = scene.pair.torque_pinion_Nm * ratio
        load = _load(file, name, keys.shaft, torque, defines=drives)
        file.relate("assembly", assembly=shaft, part=load)
        file.relate("assembly", assembly=unit, part=shaft)
        file.relate("assembly", assembly=shaft, part=gear)
        for part in (gear, shaft):
            file.reference(part, materials[name])
        flanks = _flanks(file, keys, scene.pair.pressure_angle_deg)
        file.relate("flank", gear=gear, **flanks)
        _steps(file, name, keys, flanks, flank_components(scene.flank.gear(name), path))
        kind = "cylindrical_stage_gear_data"
        data = file.add(kind, name, is_driving_gear=(_yes(drives), "none"))
        file.relate("stage_gear_data", stage=stage, gear=gear, stage_gear_data=data)
        gears.append(gear)
    file.relate("stage", stage=stage, gear_1=gears[0], gear_2=gears[1])
    model = RexsModel(_VERSION, "1", file.parts, tuple(file.relations), {})
    date = datetime.now().astimezone().isoformat(timespec="seconds")
    text = (rexs_json if as_json else rexs_xml)(model, date)
    said = {path: scene.value(path) for path in sorted(scene.given) if general(path) in KEYS}
    return text, tuple(_remarks(said))


def _mm(value: float) -> tuple[str, str]:
    return plain_number(value), "mm"


def _plain(value: float) -> tuple[str, str]:
    return plain_number(value), "none"


def _yes(value: bool) -> str:
    return "true" if value else "false"


def _materials(file: _Writing, tables: AbstractTables) -> Mapping[str, str]:
    """One material of both gears where they are alike, else one of each."""
    numbers = {}
    for name in GEARS:
        keys = ("young_GPa", "poisson", "density_kg_m3")
        young, poisson, density = (of_material(tables, name, key) or 0.0 for key in keys)
        numbers[name] = {
            "elastic_modulus": (plain_number(young, 3), "N / mm^2"),
            "poisson_ratio": _plain(poisson),
            "density": (plain_number(density, -3), "kg / dm^3"),
        }
    if numbers["pinion"] == numbers["wheel"]:
        return dict.fromkeys(GEARS, file.add("material", "material", **numbers["pinion"]))
    return {name: file.add("material", name, **numbers[name]) for name in GEARS}


def _gear(file: _Writing, name: str, gear: GearKeys, pair: PairKeys, tip: float) -> str:
    """A gear; `tip`: its tip diameter [mm]."""
    hand = 1.0 if name == "pinion" else -1.0
    attributes = {
        "number_of_teeth": (str(gear.teeth), "none"),
        "normal_module": _mm(pair.module_mm),
        "helix_angle_reference_diameter": (plain_number(hand * pair.helix_angle_deg), "deg"),
        "face_width": _mm(gear.face_width_mm),
        "u_coordinate_on_shaft": ("0", "mm"),
        "datum_face_orientation": ("negative", "none"),
    }
    if gear.shaft.is_given:
        middle, face = gear.shaft.gear_at_mm, gear.face_width_mm
        left = Decimal(plain_number(middle)) - Decimal(plain_number(face)) / 2
        attributes["u_coordinate_on_shaft"] = (str(left), "mm")
    drawn = {
        "tip_diameter": gear.tip_diameter_mm,
        "root_diameter": gear.root_diameter_mm,
        "inner_diameter": gear.bore_mm if "bore_mm" in gear.given else None,
    }
    if gear.tip_shortening_coeff:
        drawn["tip_diameter"] = tip
    attributes |= {key: _mm(value) for key, value in drawn.items() if value}
    return file.add("cylindrical_gear", name, **attributes)


def _shaft(file: _Writing, name: str, keys: ShaftKeys, casing: str, speed: float | None) -> str:
    """A shaft with its sections and bearings; bare where the gear only turns."""
    turns = {"defines_speed": (_yes(bool(speed)), "none")}
    if speed:
        turns["rotational_speed"] = (plain_number(speed), "1 / min")
    shaft = file.add("shaft", f"shaft of {name}", **turns)
    if keys.is_given:
        _sections(file, shaft, keys)
        for row in keys.bearings:
            file.relate("side", assembly=_bearing(file, row), inner_part=shaft, outer_part=casing)
    return shaft


def _load(file: _Writing, name: str, keys: ShaftKeys, torque: float, *, defines: bool) -> str:
    """The torque on a shaft [N m], where it enters or leaves."""
    place = keys.gear_at_mm if keys.torque_at_mm is None else keys.torque_at_mm
    return file.add(
        "external_load",
        f"torque on {name}",
        u_coordinate_on_shaft=(plain_number(place) if keys.is_given else "0", "mm"),
        torque_around_u_axis=(plain_number(torque), "N m"),
        transmits_torque=("true", "none"),
        defines_torque=(_yes(defines), "none"),
    )


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


def _flanks(file: _Writing, keys: GearKeys, pressure_angle: float) -> dict[str, str]:
    """Both flanks of a gear, at a pressure angle [deg]."""
    attributes = {
        "normal_pressure_angle": (plain_number(pressure_angle), "deg"),
        "addendum_modification_coefficient": _plain(keys.profile_shift),
    }
    if "tip_diameter_mm" not in keys.given and not keys.tip_shortening_coeff:
        attributes["addendum_coefficient_basic_profile"] = _plain(keys.addendum_coeff)
    return {side: file.add("cylindrical_gear_flank", side, **attributes) for side in _SIDES}


def _steps(
    file: _Writing,
    name: str,
    keys: GearKeys,
    sides: Mapping[str, str],
    components: Iterable[Component],
) -> None:
    """The rack that cuts the flanks of a gear, and what they are modified by."""
    shift = _plain(keys.profile_shift)
    rack = file.add(
        "rack_shaped_tool",
        f"rack of {name}",
        addendum_coefficient_reference_profile=_plain(keys.dedendum_coeff),
        tip_radius_factor=_plain(keys.fillet_radius_coeff),
    )
    kind = "cylindrical_gear_manufacturing_settings"
    settings = file.add(kind, name, generated_addendum_modification_coefficient=shift)
    modified = [file.put(each) for each in components]
    for flank in sides.values():
        file.relate(
            "manufacturing_step", workpiece=flank, tool=rack, manufacturing_settings=settings
        )
        for each in modified:
            file.reference(flank, each)


def _remarks(said: Mapping[str, object]) -> Iterator[str]:
    """What the file has no place for, of the values that a scene gives and not by default."""
    told: dict[str, None] = {}
    for path, value in said.items():
        key = general(path)
        if value == KEYS[key].default:
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
