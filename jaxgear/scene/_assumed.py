"""Defaults that follow other numbers of a scene, and what is said of them."""

import math
from collections.abc import Collection, Iterator, Mapping, Set
from typing import TYPE_CHECKING, Any

from jaxgear.scene._gear_tables import GearKeys, PairKeys
from jaxgear.scene._schema import GEARS, KEYS
from jaxgear.scene._sizes import root_diameter
from jaxgear.scene._tables import AbstractTables, MeshKeys

if TYPE_CHECKING:
    from jaxgear.scene._scene import Scene

# Of the root diameter: the bore of a gear whose shaft is not known, and the largest that a shaft
# asks for, beyond which a body is no ring but a rim [-].
_BORE, _LARGEST_BORE = 0.4, 0.7
# What is usual, in both gears alike [-].
_FILLET: Any = KEYS["pinion.fillet_radius_coeff"].default
# The stiffness of a tooth pair that asks for a foundation.
_TEETH = "weber-banaschek"


def assumed_fillets(tables: AbstractTables, given: Set[str]) -> Iterator[tuple[str, float]]:
    """Fillet radius coefficients that are not given: the usual one, or the largest that fits."""
    for gear in GEARS:
        path = f"{gear}.fillet_radius_coeff"
        angle, dedendum = tables.pair.pressure_angle_deg, tables.gear(gear).dedendum_coeff
        if path not in given and angle is not None and dedendum is not None:
            largest = largest_fillet(angle, dedendum)
            if largest < _FILLET:
                yield path, largest


def largest_fillet(pressure_angle: float, dedendum: float) -> float:
    """The largest tip radius of a rack over module, rounded down to a thousandth [-].

    The pressure angle is in degrees, the dedendum over module. The rounded corners of the rack's
    tip must leave a land between its straight flanks, and with a large pressure angle there is
    less room for them.
    """
    alpha = math.radians(pressure_angle)
    room = 0.25 * math.pi - dedendum * math.tan(alpha)
    corner = (1.0 - math.sin(alpha)) / math.cos(alpha)
    # Not up to the very limit, where the least change of the angle would be too much.
    return max(math.floor(1e3 * room / corner) / 1e3, 0.0)


def assumed_bores(tables: AbstractTables, given: Set[str]) -> Iterator[tuple[str, float]]:
    """Bores that are not given, of gears on a ring, which must be clamped at one."""
    for gear in GEARS:
        path, root = f"{gear}.bore_mm", root_diameter(tables, gear)
        of, mesh = tables.gear(gear), tables.mesh
        stands = of.foundation or mesh.foundation, mesh.stiffness, of.body.kind
        if path in given or not root or root <= 0.0 or stands != ("ring", _TEETH, "rigid"):
            continue
        yield path, usual_bore(tables, gear)


def usual_bore(tables: AbstractTables, gear: str) -> float:
    """Diameter at which the body of a gear is held, if it is not known [mm].

    As wide as the shaft at the gear, but at most 0.7 of the root diameter; without a shaft 0.4 of
    it, about what keyed gears have.
    """
    shaft, root = _shaft_diameter(tables, gear), root_diameter(tables, gear) or 0.0
    wide = _BORE * root if shaft is None else min(shaft, _LARGEST_BORE * root)
    return float(f"{wide:.3g}")


def assumed_foundations(tables: AbstractTables, given: Set[str]) -> Iterator[tuple[str, str]]:
    """Foundations that are not given, of gears that cannot have the default ring.

    A beam winds up by itself, and a ring must be clamped at a bore.
    """
    for gear in GEARS:
        of = tables.gear(gear)
        if not {"mesh.foundation", f"{gear}.foundation"} & given:
            if not of.bore_mm or of.body.kind == "beam":
                yield f"{gear}.foundation", "weber"


def assumed(scene: "Scene") -> list[str]:
    """Remarks on defaults that follow other numbers of the scene."""
    return [
        *(
            _told_bore(path, bore, _shaft_diameter(scene, path.partition(".")[0]))
            for path, bore in assumed_bores(scene, scene.given)
        ),
        *_told_solid(scene.mesh, scene.gears, dict(assumed_foundations(scene, scene.given))),
        *(
            _told_fillet(path, value, scene.pair, scene.gear(path.partition(".")[0]))
            for path, value in assumed_fillets(scene, scene.given)
        ),
    ]


def _told_bore(path: str, bore: float, shaft: float | None) -> str:
    gear = path.partition(".")[0]
    if shaft is None:
        why = f"{_BORE:g} of the root diameter"
    elif bore < 0.999 * shaft:
        why = f"{_LARGEST_BORE:g} of the root diameter, as the shaft has {shaft:g}"
    else:
        why = "the diameter of the shaft there"
    return (
        f"{path} was assumed to be {bore:g} mm, {why}: from there to the teeth the {gear}'s body "
        "winds up, and its mass counts. Give the diameter at which the body is held."
    )


def _told_solid(mesh: MeshKeys, gears: Mapping[str, GearKeys], free: Collection[str]) -> list[str]:
    """Remarks on gears that are said to have no bore, and on what they stand on then."""
    return [
        f"The {gear} has no bore, so its body is not clamped and does not wind up: its foundation "
        "is weber, with which the mean TE of a bored pair was 40 % less than with finite elements. "
        f"Give {gear}.bore_mm, the diameter at which the body is held, for the default ring."
        for gear, keys in gears.items()
        if keys.bore_mm == 0.0 and f"{gear}.foundation" in free
        if mesh.stiffness == _TEETH and keys.body.kind == "rigid"
    ]


def _told_fillet(path: str, value: float, pair: PairKeys, gear: GearKeys) -> str:
    return (
        f"{path} was assumed to be {value:g}, not {_FILLET:g}: with "
        f"pair.pressure_angle_deg = {pair.pressure_angle_deg:g} and a dedendum of "
        f"{gear.dedendum_coeff:g} no larger one fits between the "
        "straight flanks of the rack that cuts the teeth. Give your own if you know it."
    )


def _shaft_diameter(tables: AbstractTables, gear: str) -> float | None:
    """Outer diameter of the shaft at mid-face; `None` without a shaft [mm]."""
    left = tables.gear(gear).shaft.gear_at_mm
    for segment in tables.gear(gear).shaft.segments:
        if None in (left, segment.length_mm, segment.outer_mm):
            return None
        left -= segment.length_mm
        if left <= 0.0:
            return segment.outer_mm
    return None
