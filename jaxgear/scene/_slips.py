"""Slips of units: numbers that are right by themselves, and cannot belong to the same gears.

Every number is weighed against others of its scene, such as a face width against the module. Far
off is a mistake, merely odd a remark. Ranges are wide: what has ever been built lies within.
"""

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from jaxgear._geometry._drawn import involute, transverse_angle
from jaxgear.scene._schema import BY_PATH, GEARS, unit_of
from jaxgear.scene._sizes import of_material, reference_diameter, root_diameter
from jaxgear.scene._tables import AbstractTables
from jaxgear.scene._weighing import Slip, Span, advice, weigh

if TYPE_CHECKING:
    from jaxgear.scene._scene import Scene

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


def slips(tables: AbstractTables, values: Values) -> list[Slip]:
    """Find what cannot belong together in a scene, or hardly."""
    module = tables.pair.module_mm
    if module is None:
        return []
    found = list(_faces(tables, module))
    if any(slip.impossible for slip in found):
        # With a wrong module all else would look wrong too.
        return found
    found += [*_angles(tables), *_centres(tables, module), *_deviations(values, module)]
    odd_materials = list(_materials(tables))
    # Loads are weighed against the material.
    found += odd_materials or _loads(tables, values, module)
    for gear in GEARS:
        found += [*_bore(tables, gear), *_shaft(tables, gear)]
        found += [*_bearings(tables, gear, module), *_body(tables, gear, module)]
    return found


def odd(scene: "Scene") -> list[str]:
    """Remarks on numbers of a scene without mistakes that hardly belong together."""
    return [f"{slip.message}." for slip in slips(scene, scene.whole) if not slip.impossible]


def _faces(tables: AbstractTables, module: float) -> Iterator[Slip]:
    """Face widths against the module: where both are off, the module is."""
    faces = {gear: tables.gear(gear).face_width_mm for gear in GEARS}
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
        diameter = reference_diameter(tables, gear)
        if diameter and not any(slip.impossible for slip in off[gear]):
            of = f"the {gear}'s reference diameter, {diameter:.4g}"
            yield from weigh(f"{gear}.face_width_mm", face, diameter, _FACE_OVER_DIAMETER, of)


def _angles(tables: AbstractTables) -> Iterator[Slip]:
    pair = tables.pair
    yield from weigh("pair.pressure_angle_deg", pair.pressure_angle_deg, 20.0, _ANGLE, "")
    angles = {"pair.helix_angle_deg": pair.helix_angle_deg} | {
        f"{gear}.body.web.web_angle_deg": tables.gear(gear).body.web.web_angle_deg for gear in GEARS
    }
    for path, angle in angles.items():
        yield from weigh(path, angle, 1.0, _SMALL_ANGLE, "")


def _materials(tables: AbstractTables) -> Iterator[Slip]:
    """Young's modulus against density, by the speed of sound."""
    shared, keys = tables.material, ("young_GPa", "density_kg_m3")
    for table in ("material", *(f"{gear}.material" for gear in GEARS)):
        own = shared if table == "material" else tables.gear(table.partition(".")[0]).material
        said = [key for key in keys if getattr(own, key) is not None]
        young, density = (getattr(own if key in said else shared, key) for key in keys)
        if not said or young is None or density is None:
            continue
        if _SOUND_LOW <= _sound(young, density) <= _SOUND_HIGH:
            continue
        path = f"{table}.{said[0]}"
        low, high = (speed**2 * density * 1e-9 for speed in (_SOUND_LOW, _SOUND_HIGH))
        yield Slip(
            path,
            False,
            f"{path}: a Young's modulus of {young:.4g} GPa and a density of {density:.4g} kg/m^3 "
            f"are odd together: sound would travel at {_sound(young, density):.3g} m/s, and "
            f"{_SOUND_LOW:g} to {_SOUND_HIGH:g} is usual. {advice(young, 'GPa', low, high)}",
        )


def _centres(tables: AbstractTables, module: float) -> Iterator[Slip]:
    """A centre distance against that of the reference circles, and the backlash that it leaves."""
    path, pair = "pair.centre_distance_mm", tables.pair
    centres, diameters = pair.centre_distance_mm, [reference_diameter(tables, g) for g in GEARS]
    alpha = math.radians(pair.pressure_angle_deg or 0.0)
    if centres is None or None in diameters or not alpha:
        return
    reference = 0.5 * sum(filter(None, diameters))
    of = f"half the sum of the reference diameters, {reference:.4g}"
    yield from weigh(path, centres, reference, _CENTRES, of)
    angle = transverse_angle(alpha, math.radians(pair.helix_angle_deg))
    shifts = sum(tables.gear(gear).profile_shift or 0.0 for gear in GEARS)
    teeth = tables.pinion.teeth + tables.wheel.teeth
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
        # Limits of a search and of a response are not sizes of gears.
        searched = table in ("optimise.ties", "optimise.bounds") or key.startswith("optimise.")
        if searched or unit_of(path) != "um":
            continue
        span = _DEVIATION
        if key.endswith("thickness_allowance_um"):
            span = _ALLOWANCE
        elif not table and key.endswith((".depth_um", "crowning_um")):
            span = _DEPTH
        numbers = value if isinstance(value, list) else [value]
        numbers = [each for each in numbers if isinstance(each, float)]
        largest = max(numbers, key=abs, default=None)
        yield from weigh(path, largest, 1e3 * module, span, _of_module(module))


def _loads(tables: AbstractTables, values: Values, module: float) -> Iterator[Slip]:
    """Torques against what teeth stand, speeds against sound, a stiffness against the material."""
    diameter = reference_diameter(tables, "pinion")
    young, density = (of_material(tables, "pinion", k) for k in ("young_GPa", "density_kg_m3"))
    faces = [face for gear in GEARS if (face := tables.gear(gear).face_width_mm)]
    if diameter is None or young is None or density is None or not faces:
        return
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
    if tables.mesh.stiffness == "constant":
        key, of = "mesh.stiffness_N_mm_um", f"Young's modulus, {young:g} N/(mm um)"
        yield from weigh(key, tables.mesh.stiffness_N_mm_um, young, _TOOTH_STIFFNESS, of)


def _bore(tables: AbstractTables, gear: str) -> Iterator[Slip]:
    bore, root = tables.gear(gear).bore_mm, root_diameter(tables, gear)
    if root is not None and root > 0.0:
        yield from weigh(f"{gear}.bore_mm", bore, root, _BORE, f"the root diameter, {root:.4g}")


def _shaft(tables: AbstractTables, gear: str) -> Iterator[Slip]:
    """Lengths of a shaft against the gear on it."""
    diameter, table = reference_diameter(tables, gear), f"{gear}.shaft.segments"
    # What lies behind a wrong row has no place.
    right = lambda row: row.length_mm is not None
    segments = list(itertools.takewhile(right, tables.gear(gear).shaft.segments))
    if diameter is None or not segments:
        return
    of = f"the {gear}'s reference diameter, {diameter:.4g}"
    lengths = [each.length_mm for each in segments]
    longest = lengths.index(max(lengths))
    # The whole counts; one row of it is shown.
    whole = sum(lengths) / lengths[longest]
    path = f"{table}[{longest}].length_mm"
    yield from weigh(path, lengths[longest], diameter / whole, _SHAFT_LENGTH, of)
    for row, each in enumerate(segments):
        yield from weigh(f"{table}[{row}].outer_mm", each.outer_mm, diameter, _SHAFT_DIAMETER, of)


def _bearings(tables: AbstractTables, gear: str, module: float) -> Iterator[Slip]:
    """Radial stiffness against the tooth force, which must not move a gear out of mesh."""
    pinion, torque = reference_diameter(tables, "pinion"), tables.pair.torque_pinion_Nm
    if pinion is None or torque is None:
        return
    force, of = 2e3 * abs(torque) / pinion, tables.gear(gear)
    rows = enumerate(itertools.takewhile(lambda row: row.at_mm is not None, of.shaft.bearings))
    places = {f"{gear}.support": of.support} | {f"{gear}.shaft.bearings[{i}]": x for i, x in rows}
    for along in ("radial_S_N_m", "radial_T_N_m"):
        known = {}
        for place, springs in places.items():
            for name in (along, "radial_N_m"):
                if getattr(springs, name):
                    known[place] = (getattr(springs, name), f"{place}.{name}")
        if not known:
            continue
        stiffness, stiffest = max(known.values(), key=lambda each: each[0])
        needed = force / (1e-3 * module * len(known))
        why = (
            f"the tooth force of {force:.4g} N over {_of_module(module)}, and over the number of "
            "bearings: the gears would move out of mesh"
        )
        found = list(weigh(stiffest, stiffness, needed, _BEARING, why))
        yield from found
        if found:
            return


def _body(tables: AbstractTables, gear: str, module: float) -> Iterator[Slip]:
    """Web, mass and inertia against the gear's teeth, and a solid disc of its size."""
    of = tables.gear(gear)
    web, body = f"{gear}.body.web.web_thickness_mm", of.body
    yield from weigh(web, body.web.web_thickness_mm, module, _WEB, _of_module(module))
    diameter, density = reference_diameter(tables, gear), of_material(tables, gear, "density_kg_m3")
    if diameter is None or of.face_width_mm is None or density is None:
        return
    mass = 0.25e-9 * math.pi * diameter**2 * of.face_width_mm * density
    inertia = mass * (1e-3 * diameter) ** 2 / 8.0
    for key, value, reference, span in (
        ("mass_kg", body.mass_kg, mass, _MASS),
        ("inertia_kg_m2", body.inertia_kg_m2, inertia, _INERTIA),
        ("transverse_inertia_kg_m2", body.transverse_inertia_kg_m2, 0.5 * inertia, _INERTIA),
    ):
        disc = f"that of a solid disc, {reference:.3g}"
        yield from weigh(f"{gear}.body.{key}", value, reference, span, disc)


def _of_module(module: float) -> str:
    return f"pair.module_mm, {module:g}"


def _sound(young: float, density: float) -> float:
    """Speed of sound along a rod [m/s]."""
    return math.sqrt(1e9 * young / density)


def angle_of_involute(value: float) -> float:
    """The angle [rad] of which the involute is `value`, by Newton's method, in plain numbers."""
    # Convex, and begun above the root: every step stays there.
    angle = min((3.0 * value) ** (1.0 / 3.0), 1.5)
    for _ in range(50):
        angle -= (involute(angle) - value) / math.tan(angle) ** 2
    return angle
