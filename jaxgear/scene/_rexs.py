"""Cylindrical stages of REXS files (Reusable Engineering EXchange Standard, rexs.info) as scenes.

What is read: stages, gears and their tools, shafts of sections, bearings, loads and speeds of
shafts, materials, modifications of flanks, one load case. Names of attributes are those of the
REXS database; a gear's coordinate on its shaft is that of its left side.
"""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from jaxgear._checks import InputError
from jaxgear._geometry._pair import GearPair
from jaxgear._units import mm
from jaxgear.scene._build_pair import pair_of
from jaxgear.scene._mistakes import SceneError
from jaxgear.scene._rexs_file import Component, read_rexs
from jaxgear.scene._rexs_flanks import flank_keys, modifications, paths_of
from jaxgear.scene._rexs_shafts import passed_on, shaft_keys, torque_of
from jaxgear.scene._rexs_stage import RexsStage, parts_on, stage_of, teeth_of
from jaxgear.scene._scene import Scene, read_scene
from jaxgear.scene._schema import GEARS

_RACK = "rack_shaped_tool"
# Key of a material, the attribute, ten to the power of what turns one into the other.
_MATERIAL = (
    ("young_GPa", "elastic_modulus", -3),
    ("poisson", "poisson_ratio", 0),
    ("density_kg_m3", "density", 3),
)
_READ = {
    *("gear_unit", "gear_casing", "cylindrical_stage", "cylindrical_gear", "shaft"),
    *("shaft_section", "external_load", "stage_gear_data", "rolling_bearing_row", "material"),
    *("flank_geometry", "cylindrical_gear_flank", "cylindrical_stage_gear_data"),
    *("rack_shaped_tool", "cylindrical_gear_manufacturing_settings"),
}
# Centre distances of a file and of profile shifts are the same within this [mm].
_SAME = 1e-6


class Imported(NamedTuple):
    """A stage of a file as keys of a scene.

    **Fields:**

    - `keys`: tables of the scene, nested, in the units of the keys.
    - `remarks`: what was left out, and what was assumed.
    """

    keys: Mapping[str, Any]
    remarks: tuple[str, ...]


def scene_of_rexs(path: Path, stage: str = "", case: str = "") -> Imported:
    """Read a cylindrical stage of a REXS file.

    **Arguments:**

    - `path`: of the file (.rexs, .rexsj or .rexsz).
    - `stage`: identifier of the stage; may be left out where there is one.
    - `case`: identifier of the load case; the first without it.

    **Raises:**

    - `InputError` if the file is none of REXS, has no such stage or load case, or makes no scene.
    """
    model = read_rexs(path)
    it = stage_of(model, stage, case)
    keys: dict[str, Any] = {
        "schema": 1,
        "name": path.stem,
        "cite": f"REXS {model.version} file {path.name} of {model.application or 'nobody named'}",
        **_materials(it),
        "pair": _pair(it),
    }
    for gear in GEARS:
        keys[gear] = {**_gear(it, gear), **keys.pop(f"{gear}.material", {}), **shaft_keys(it, gear)}
    scene = _draft(keys, path)
    pair_at = lambda distance: pair_of(scene.replace({"pair.centre_distance_mm": distance}))
    _set_centre_distance(it, keys, pair_of(scene), pair_at)
    distance = keys["pair"].get("centre_distance_mm")
    _set_flanks(it, keys, pair_of(scene) if distance is None else pair_at(distance))
    _draft(keys, path)
    _tell_the_rest(it)
    return Imported(keys, tuple(it.remarks))


def _pair(it: RexsStage) -> Mapping[str, Any]:
    pinion, remarks = it.part("pinion"), it.remarks
    flanks = [flank for gear in it.gears if (flank := _flank(it, gear)) is not None]
    angles = [it.model.parts[flank].number("normal_pressure_angle") for flank in flanks]
    pressure_angle = next((each for each in angles if each is not None), None)
    if pressure_angle is None:
        remarks.append("The pressure angle is missing: 20 degrees are taken.")
    loads = lambda shaft: [torque_of(x) for x in parts_on(it, shaft, "external_load")]
    torque = passed_on(it, lambda shaft: max(loads(shaft), default=0.0), forwards=True)
    if torque is None:
        remarks.append("No shaft has a torque: 1 N m is taken. Set pair.torque_pinion_Nm.")
    keys: dict[str, Any] = {
        "module_mm": float(pinion.needed("normal_module")),
        "pressure_angle_deg": 20.0 if pressure_angle is None else pressure_angle,
        "helix_angle_deg": pinion.number("helix_angle_reference_diameter") or 0.0,
        "torque_pinion_Nm": 1.0 if torque is None else torque,
    }
    turns = lambda shaft: abs(it.model.parts[shaft].number("rotational_speed") or 0.0)
    if speed := passed_on(it, turns, forwards=False):
        keys["speed_rpm"] = speed
    return keys


def _flank(it: RexsStage, gear: str) -> str | None:
    """Identifier of the left flank of a gear, or of the right one where there is one only."""
    for refs in it.model.those("flank", gear=gear):
        for side in ("left", "right"):
            if refs.get(side) in it.model.parts:
                return refs[side]
    return None


def _materials(it: RexsStage) -> Mapping[str, Any]:
    """The material of both gears, or one for each."""
    found: dict[str, Mapping[str, float]] = {}
    for name, gear in zip(GEARS, it.gears, strict=True):
        parts = it.model.related("reference", "referenced", "material", origin=gear)
        numbers = {
            key: value
            for key, attribute, scale in _MATERIAL
            for part in parts[:1]
            if (value := part.number(attribute, scale)) is not None
        }
        if len(numbers) < len(_MATERIAL):
            lacking = ", ".join(key for key, *_ in _MATERIAL if key not in numbers)
            it.remarks.append(f"{name}: steel is taken for {lacking}.")
        found[name] = numbers
    if found["pinion"] == found["wheel"]:
        return {"material": found["pinion"]} if found["pinion"] else {}
    return {f"{name}.material": {"material": numbers} for name, numbers in found.items() if numbers}


def _gear(it: RexsStage, name: str) -> dict[str, Any]:
    gear, flank = it.part(name), _flank(it, it.gears[GEARS.index(name)])
    found: dict[str, Any] = {
        "teeth": round(teeth_of(gear)),
        "face_width_mm": float(gear.needed("face_width")),
    }
    on_flank = {
        "addendum_modification_coefficient": "profile_shift",
        "addendum_coefficient_basic_profile": "addendum_coeff",
    }
    on_tool = {
        "addendum_coefficient_reference_profile": "dedendum_coeff",
        "tip_radius_factor": "fillet_radius_coeff",
        # Its name from version 2.0 on.
        "tip_corner_radius_factor_reference_profile": "fillet_radius_coeff",
    }
    for part, names in (
        (it.model.parts[flank] if flank else None, on_flank),
        (_tool(it, name), on_tool),
    ):
        for attribute, key in names.items():
            if part and (value := part.number(attribute)) is not None:
                found[key] = value
    for key, instead, attribute in (
        ("tip_diameter_mm", "addendum_coeff", "tip_diameter"),
        ("root_diameter_mm", "dedendum_coeff", "root_diameter"),
        ("bore_mm", "", "inner_diameter"),
    ):
        if value := gear.number(attribute):
            found[key] = abs(value)
            found.pop(instead, None)
    if "profile_shift" not in found:
        it.remarks.append(f"{name}: no profile shift is given, 0 is taken.")
    return found


def _tool(it: RexsStage, name: str) -> Component | None:
    """The rack that cuts a gear: of its flank's last step, or named by the gear itself."""
    gear = it.gears[GEARS.index(name)]
    steps = it.model.related("manufacturing_step", "tool", _RACK, workpiece=_flank(it, gear) or "")
    named = it.model.related("ordered_reference", "referenced", _RACK, origin=gear)
    return next(iter((*steps[::-1], *named)), None)


def _draft(keys: Mapping[str, Any], path: Path) -> Scene:
    """The scene of these keys, checked."""
    # Who looks up a key waits for no writer of scenes.
    import tomlkit

    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "draft.toml"
        draft.write_text(tomlkit.dumps(keys), encoding="utf-8")
        try:
            return read_scene(draft)
        except SceneError as error:
            words = [f"{mistake.path}: {mistake.message}." for mistake in error.mistakes]
            told = "\n".join([f"{path}: the stage makes no scene:", *words])
            raise InputError(told) from None


def _set_centre_distance(
    it: RexsStage,
    keys: dict[str, Any],
    pair: GearPair,
    pair_at: Callable[[float], GearPair],
) -> None:
    """Take the file's centre distance where it is not that of the profile shifts."""
    stage = it.model.parts.get(it.stage)
    given = stage and stage.number("center_distance")
    if not given:
        return
    of_shifts = float(pair.zero_backlash_centre_distance) / mm
    if abs(given - of_shifts) <= _SAME:
        return
    try:
        pair_at(given)
    except InputError as error:
        it.remarks.append(
            f"The centre distance of {given:g} mm does not fit: {error} That of the profile "
            f"shifts, {of_shifts:.6g} mm, is taken."
        )
        return
    keys["pair"]["centre_distance_mm"] = given
    more = 1e3 * (given - of_shifts)
    thinner = " Its teeth must be thinner than their shifts say." if more < -1.0 else ""
    it.remarks.append(
        f"The centre distance, {given:g} mm, is the file's: {more:+.3g} um against that of the "
        f"profile shifts without backlash.{thinner}"
    )


def _set_flanks(it: RexsStage, keys: dict[str, Any], pair: GearPair) -> None:
    """Add what the flanks are modified by."""
    found = {
        name: modifications(it.model, _flank(it, gear) or "")
        for name, gear in zip(GEARS, it.gears, strict=True)
    }
    if any(found.values()):
        keys["flank"] = {
            name: flank_keys(found[name], path, it.remarks)
            for name, path in zip(GEARS, paths_of(pair), strict=True)
            if found[name]
        }
    for name, gear in zip(GEARS, it.gears, strict=True):
        for refs in it.model.those("flank", gear=gear):
            sides = [modifications(it.model, refs.get(side, "")) for side in ("left", "right")]
            if {"left", "right"} <= refs.keys() and sides[0] != sides[1]:
                it.remarks.append(f"{name}: its flanks differ, the left one is taken.")


def _tell_the_rest(it: RexsStage) -> None:
    """Say what was left out, and what was assumed of all files."""
    carried = {kind for x in it.gears for kind in modifications(it.model, _flank(it, x) or "")}
    left = sorted({each.kind for each in it.model.parts.values()} - _READ - carried)
    left = [each for each in left if "bearing" not in each]
    if left:
        it.remarks.append(f"Left out: {', '.join(left)}.")
    forces = [f"force_{axis}_direction" for axis in "uvw"]
    loads = [x for gear in GEARS for x in parts_on(it, it.shaft_of(gear), "external_load")]
    if any(load.number(force) for load in loads for force in forces):
        it.remarks.append("Forces on the shafts are left out.")
    it.remarks.append(
        "Both faces are taken as centred on each other, a bearing's coordinate as its middle."
    )
