"""Slips of units: numbers that are right by themselves, and cannot belong to the same gears.

Every number is weighed against others of its scene, such as a face width against the module. Far
off is a mistake, merely odd a remark. Ranges are wide: what has ever been built lies within.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from jaxgear._geometry._drawn import involute, transverse_angle
from jaxgear.scene._body_checks import root_diameter
from jaxgear.scene._schema import BY_PATH, GEARS, unit_of
from jaxgear.scene._weighing import Slip, Span, advice, weigh

Values = Mapping[str, Any]

_FACE = Span(0.2, 1.0, 200.0, 1000.0)
_FACE_OVER_DIAMETER = Span(0.0, 0.0, 5.0, 30.0)
_BORE = Span(0.002, 0.02, 1.0, 1.0)
_CENTRES = Span(0.5, 0.5, 2.0, 2.0)
# Teeth are 2.25 modules high and at their tips 0.7 thick.
_DEVIATION = Span(0.0, 0.0, 0.1, 1.0)
_DEPTH = Span(0.0, 3e-5, 0.1, 1.0)
_ALLOWANCE = Span(0.0, 0.0, 0.2, 1.0)
# Steel teeth give by their own module under 0.07 of Young's modulus on face times module.
_TORQUE = Span(0.0, 1e-6, 0.01, 0.1)
_SPEED = Span(0.0, 0.0, 0.04, 0.2)
_SHAFT_LENGTH = Span(0.03, 0.1, 30.0, 1000.0)
_SHAFT_DIAMETER = Span(0.005, 0.02, 2.0, 20.0)
# Working teeth are in mesh over two modules.
_BEARING = Span(0.5, 3.0, math.inf, math.inf)
_WEB = Span(0.02, 0.2, math.inf, math.inf)
_TOOTH_STIFFNESS = Span(1e-5, 5e-3, 1.0, 1e3)
_ANGLE = Span(0.0, 0.7, 1.5, math.inf)
_SMALL_ANGLE = Span(0.0, 1.0, math.inf, math.inf)
# Bodies may stand for all that turns with them, or for a gear that is held.
_MASS = Span(0.0, 0.02, 50.0, math.inf)
_INERTIA = Span(0.0, 5e-3, 1000.0, math.inf)
# Of sound in solids: 160 m/s in rubber, 18 000 in diamond; machine parts have 900 to 13 000.
_SOUND_LOW, _SOUND_HIGH = 800.0, 14_000.0
# Backlash over module beyond which a centre distance is odd.
_BACKLASH = 0.2


def slips(values: Values) -> list[Slip]:
    """Find what cannot belong together in a scene, or hardly.

    **Arguments:**

    - `values`: of the scene by path, in the units of the file, without those that are wrong.

    **Returns:**

    Mistakes and remarks; none where numbers that it takes are missing.
    """
    module = _number(values, "pair.module_mm")
    if module is None:
        return []
    found = list(_faces(values, module))
    if any(slip.impossible for slip in found):
        # With a wrong module all else would look wrong too.
        return found
    for check in (_angles, _centres, _deviations):
        found += check(values, module)
    odd_materials = list(_materials(values))
    # Loads are weighed against the material.
    found += odd_materials or _loads(values, module)
    for gear in GEARS:
        for check in (_bore, _shaft, _bearings, _body):
            found += check(gear, values, module)
    return found


def odd(values: Values) -> list[str]:
    """Remarks on numbers that hardly belong together.

    **Arguments:**

    - `values`: of a scene without mistakes.

    **Returns:**

    A sentence or two each.
    """
    return [f"{slip.message}." for slip in slips(values) if not slip.impossible]


def _faces(values: Values, module: float) -> Iterator[Slip]:
    """Face widths against the module: where both are off, the module is."""
    faces = {gear: _number(values, f"{gear}.face_width_mm") for gear in GEARS}
    known = {gear: face for gear, face in faces.items() if face is not None}
    off = {
        gear: list(weigh(f"{gear}.face_width_mm", face, module, _FACE, _of_module(module)))
        for gear, face in known.items()
    }
    if len(known) == len(GEARS) and all(off.values()):
        gear = max(known, key=lambda each: known[each])
        of = f"{gear}.face_width_mm, {known[gear]:g}"
        yield from weigh("pair.module_mm", module, known[gear], _FACE.inverse, of)
        return
    for gear, face in known.items():
        yield from off[gear]
        diameter = _diameter(gear, values)
        if diameter and not any(slip.impossible for slip in off[gear]):
            of = f"the {gear}'s reference diameter, {diameter:.4g}"
            yield from weigh(f"{gear}.face_width_mm", face, diameter, _FACE_OVER_DIAMETER, of)


def _angles(values: Values, module: float) -> Iterator[Slip]:
    del module
    key = "pair.pressure_angle_deg"
    yield from weigh(key, values.get(key, 0.0), 20.0, _ANGLE, "")
    for key in ("pair.helix_angle_deg", *(f"{gear}.body.web.web_angle_deg" for gear in GEARS)):
        yield from weigh(key, values.get(key, 0.0), 1.0, _SMALL_ANGLE, "")


def _materials(values: Values) -> Iterator[Slip]:
    """Young's modulus against density, by the speed of sound."""
    for gear in ("", *GEARS):
        table = f"{gear}.material" if gear else "material"
        if gear and not {f"{table}.young_GPa", f"{table}.density_kg_m3"} & set(values):
            continue
        found = _material(gear, values)
        if found is None or _SOUND_LOW <= _sound(*found) <= _SOUND_HIGH:
            continue
        young, density = found
        path = f"{table}.young_GPa" if f"{table}.young_GPa" in values else f"{table}.density_kg_m3"
        low, high = (speed**2 * density * 1e-9 for speed in (_SOUND_LOW, _SOUND_HIGH))
        yield Slip(
            path,
            False,
            f"{path}: a Young's modulus of {young:.4g} GPa and a density of {density:.4g} kg/m^3 "
            f"are odd together: sound would travel at {_sound(young, density):.3g} m/s, and "
            f"{_SOUND_LOW:g} to {_SOUND_HIGH:g} is usual. {advice(young, 'GPa', low, high)}",
        )


def _centres(values: Values, module: float) -> Iterator[Slip]:
    """A centre distance against that of the reference circles, and the backlash that it leaves."""
    path = "pair.centre_distance_mm"
    centres = _number(values, path)
    diameters = [_diameter(gear, values) for gear in GEARS]
    alpha = math.radians(values.get("pair.pressure_angle_deg") or 0.0)
    if centres is None or None in diameters or not alpha:
        return
    reference = 0.5 * sum(filter(None, diameters))
    of = f"half the sum of the reference diameters, {reference:.4g}"
    yield from weigh(path, centres, reference, _CENTRES, of)
    helix = math.radians(values.get("pair.helix_angle_deg") or 0.0)
    angle = transverse_angle(alpha, helix)
    shifts = sum(values.get(f"{gear}.profile_shift", 0.0) for gear in GEARS)
    teeth = sum(values[f"{gear}.teeth"] for gear in GEARS)
    tight = involute(angle) + 2.0 * shifts * math.tan(alpha) / teeth
    base = reference * math.cos(angle)
    # What lies beyond is refused with the gears.
    if not base < centres < 2.0 * reference or not 0.0 < tight < involute(1.0):
        return
    backlash = 2.0 * centres * (involute(math.acos(base / centres)) - tight)
    if backlash > _BACKLASH * module:
        yield Slip(
            path,
            False,
            f"{path} = {centres:.6g} mm leaves a backlash of {backlash:.3g} mm, which is odd: "
            f"{backlash / module:.2g} times {_of_module(module)}, where {_BACKLASH:g} or less is "
            "usual. The profile shifts ask for "
            f"{base / math.cos(angle_of_involute(tight)):.6g} mm; leave the key out for that",
        )


def _deviations(values: Values, module: float) -> Iterator[Slip]:
    """What is taken off flanks, and how far they are out of place, against the module."""
    for path, value in values.items():
        table = next((each for each in BY_PATH if path.startswith(f"{each}.")), "")
        key = path.removeprefix(f"{table}.") if table else path
        if table == "optimise.ties" or unit_of(path) != "um":
            continue
        span = _DEVIATION
        if key.endswith("thickness_allowance_um"):
            span = _ALLOWANCE
        elif not table and key.endswith((".depth_um", "crowning_um")):
            span = _DEPTH
        numbers = value if isinstance(value, list) else [value]
        numbers = [each for each in numbers if isinstance(each, float)]
        # Limits of a search and of a response are not sizes of gears.
        if numbers and table != "optimise.bounds" and not key.startswith("optimise."):
            largest = max(numbers, key=abs)
            yield from weigh(path, largest, 1e3 * module, span, _of_module(module))


def _loads(values: Values, module: float) -> Iterator[Slip]:
    """Torques against what teeth stand, speeds against sound, a stiffness against the material."""
    diameter, material = _diameter("pinion", values), _material("pinion", values)
    faces = [face for gear in GEARS if (face := _number(values, f"{gear}.face_width_mm"))]
    if diameter is None or material is None or not faces:
        return
    young, density = material
    # N/mm^2 times mm^3 is N mm.
    torque = 0.5 * diameter * min(faces) * module * young
    of = f"the torque whose tooth force over face and module is Young's modulus, {torque:.4g}"
    for key in (
        "pair.torque_pinion_Nm",
        *(f"{t}.torques_Nm" for t in ("map", "optimise", "sizing")),
    ):
        given = values.get(key, [])
        largest = max(given, default=0.0) if isinstance(given, list) else given
        span = _TORQUE if key.startswith("pair.") else _TORQUE._replace(low=0.0)
        yield from weigh(key, largest, torque, span, of)
    fastest = 2e3 * _sound(young, density) / diameter
    of = f"the speed at which pitch points outrun sound in the material, {fastest:.4g}"
    sweep = "sweep.pinion_speed_rad_s"
    for key in ("mesh.pinion_speed_rad_s", sweep, f"{sweep}.to"):
        given = values.get(key, 0.0)
        largest = max(given) if isinstance(given, list) else given
        yield from weigh(key, largest, fastest, _SPEED, of)
    key = "mesh.stiffness_N_mm_um"
    if values.get("mesh.stiffness") == "constant":
        of = f"Young's modulus, {young:g} N/(mm um)"
        yield from weigh(key, values.get(key, 0.0), young, _TOOTH_STIFFNESS, of)


def _bore(gear: str, values: Values, module: float) -> Iterator[Slip]:
    del module
    path, root = f"{gear}.bore_mm", root_diameter(gear, values)
    bore = _number(values, path)
    if not bore or root is None or root <= 0.0:
        return
    yield from weigh(path, bore, root, _BORE, f"the root diameter, {root:.4g}")


def _shaft(gear: str, values: Values, module: float) -> Iterator[Slip]:
    """Lengths of a shaft against the gear on it."""
    del module
    diameter = _diameter(gear, values)
    segments = _rows(values, f"{gear}.shaft.segments", "length_mm")
    if diameter is None or not segments:
        return
    of = f"the {gear}'s reference diameter, {diameter:.4g}"
    lengths = {f"{row}.length_mm": values[f"{row}.length_mm"] for row in segments}
    longest = max(lengths, key=lambda path: lengths[path])
    # The whole counts; one row of it is shown.
    whole = sum(lengths.values()) / lengths[longest]
    yield from weigh(longest, lengths[longest], diameter / whole, _SHAFT_LENGTH, of)
    for path in (f"{row}.outer_mm" for row in segments):
        yield from weigh(path, values.get(path, 0.0), diameter, _SHAFT_DIAMETER, of)


def _bearings(gear: str, values: Values, module: float) -> Iterator[Slip]:
    """Radial stiffness against the tooth force, which must not move a gear out of mesh."""
    pinion, torque = _diameter("pinion", values), _number(values, "pair.torque_pinion_Nm")
    if pinion is None or torque is None:
        return
    force = 2e3 * torque / pinion
    places = [f"{gear}.support", *_rows(values, f"{gear}.shaft.bearings", "at_mm")]
    for along in ("radial_S_N_m", "radial_T_N_m"):
        names = ("radial_N_m", along)
        each = [[f"{place}.{name}" for name in names] for place in places]
        held = [[path for path in paths if values.get(path)] for paths in each]
        known = {paths[0]: values[paths[0]] for paths in held if paths}
        if not known:
            continue
        stiffest = max(known, key=lambda path: known[path])
        needed = force / (1e-3 * module * len(known))
        of = (
            f"the tooth force of {force:.4g} N over {_of_module(module)}, and over the number of "
            "bearings: the gears would move out of mesh"
        )
        found = list(weigh(stiffest, known[stiffest], needed, _BEARING, of))
        yield from found
        if found:
            return


def _body(gear: str, values: Values, module: float) -> Iterator[Slip]:
    """Web, mass and inertia against the gear's teeth, and a solid disc of its size."""
    web = f"{gear}.body.web.web_thickness_mm"
    yield from weigh(web, values.get(web, 0.0), module, _WEB, _of_module(module))
    diameter, face = _diameter(gear, values), _number(values, f"{gear}.face_width_mm")
    material = _material(gear, values)
    if diameter is None or face is None or material is None:
        return
    mass = 0.25e-9 * math.pi * diameter**2 * face * material[1]
    inertia = mass * (1e-3 * diameter) ** 2 / 8.0
    for key, reference, span in (
        ("mass_kg", mass, _MASS),
        ("inertia_kg_m2", inertia, _INERTIA),
        ("transverse_inertia_kg_m2", 0.5 * inertia, _INERTIA),
    ):
        path = f"{gear}.body.{key}"
        of = f"that of a solid disc, {reference:.3g}"
        yield from weigh(path, values.get(path, 0.0), reference, span, of)


def _of_module(module: float) -> str:
    return f"pair.module_mm, {module:g}"


def _number(values: Values, path: str) -> float | None:
    value = values.get(path)
    return value if isinstance(value, float) else None


def _diameter(gear: str, values: Values) -> float | None:
    """Reference diameter [mm]."""
    module, teeth = _number(values, "pair.module_mm"), values.get(f"{gear}.teeth")
    helix = _number(values, "pair.helix_angle_deg")
    if module is None or teeth is None or helix is None:
        return None
    return module * teeth / math.cos(math.radians(helix))


def _material(gear: str, values: Values) -> tuple[float, float] | None:
    """Young's modulus [GPa] and density [kg/m3] of a gear, or of the scene."""
    found = []
    for key in ("young_GPa", "density_kg_m3"):
        own = _number(values, f"{gear}.material.{key}")
        found.append(_number(values, f"material.{key}") if own is None else own)
    return None if None in found else (found[0], found[1])


def _sound(young: float, density: float) -> float:
    """Speed of sound along a rod [m/s]."""
    return math.sqrt(1e9 * young / density)


def _rows(values: Values, table: str, key: str) -> list[str]:
    """Paths of the rows of a list of tables that have a key."""
    found: list[str] = []
    while f"{table}[{len(found)}].{key}" in values:
        found.append(f"{table}[{len(found)}]")
    return found


def angle_of_involute(value: float) -> float:
    """The angle of an involute, by Newton's method, in plain numbers.

    **Arguments:**

    - `value`: involute of the angle [rad].

    **Returns:**

    The angle [rad].
    """
    # Convex, and begun above the root: every step stays there.
    angle = min((3.0 * value) ** (1.0 / 3.0), 1.5)
    for _ in range(50):
        angle -= (involute(angle) - value) / math.tan(angle) ** 2
    return angle
