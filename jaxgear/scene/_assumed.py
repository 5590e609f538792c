"""Defaults that follow other numbers of a scene, and what is said of them."""

import itertools
import math
from collections.abc import Iterator, Mapping, Set
from typing import TYPE_CHECKING, Any

from jaxgear.scene._body_checks import root_diameter
from jaxgear.scene._schema import GEARS, KEYS

if TYPE_CHECKING:
    from jaxgear.scene._scene import Scene

# Of the root diameter: the bore of a gear whose shaft is not known, and the largest that a shaft
# asks for, beyond which a body is no ring but a rim [-].
_BORE, _LARGEST_BORE = 0.4, 0.7
# The stiffness of a tooth pair that asks for a foundation.
_TEETH = "weber-banaschek"


def assumed_fillets(values: Mapping[str, Any], given: Set[str]) -> dict[str, float]:
    """Fillet radius coefficients that are not given: the usual one, or the largest that fits.

    The rounded corners of the rack's tip must leave a land between its straight flanks, and with
    a large pressure angle there is less room for them.

    **Arguments:**

    - `values`: of the scene by path, in the units of the file, without those that are wrong.
    - `given`: keys that the user wrote.

    **Returns:**

    The coefficients that differ from the schema's default, by path [-].
    """
    return {
        path: largest
        for path, largest in _largest_fillets(values)
        if path not in given and largest < _usual(path)
    }


def assumed_bores(values: Mapping[str, Any], given: Set[str]) -> dict[str, float]:
    """Bores that are not given, of gears on a ring, which must be clamped at one.

    As wide as the shaft at the gear, but at most 0.7 of the root diameter; without a shaft 0.4 of
    it, about what keyed gears have.

    **Arguments:**

    - `values`: of the scene by path, in the units of the file, without those that are wrong.
    - `given`: keys that the user wrote.

    **Returns:**

    Bores by path [mm].
    """
    found = {}
    for gear in GEARS:
        path, root = f"{gear}.bore_mm", root_diameter(gear, values)
        if path in given or not root or root <= 0.0 or not _lies_on_ring(gear, values):
            continue
        shaft = _shaft_diameter(gear, values)
        wide = _BORE * root if shaft is None else min(shaft, _LARGEST_BORE * root)
        found[path] = float(f"{wide:.3g}")
    return found


def assumed_foundations(values: Mapping[str, Any], given: Set[str]) -> dict[str, str]:
    """Foundations that are not given, of gears that cannot have the default ring.

    A beam winds up by itself, and a ring must be clamped at a bore.

    **Arguments:**

    - `values`: of the scene by path, assumed bores among them.
    - `given`: keys that the user wrote.

    **Returns:**

    The choice by path.
    """
    return {
        f"{gear}.foundation": "weber"
        for gear in GEARS
        if not {"mesh.foundation", f"{gear}.foundation"} & given
        if not values.get(f"{gear}.bore_mm") or values.get(f"{gear}.body.kind") == "beam"
    }


def assumed(scene: "Scene") -> list[str]:
    """Remarks on defaults that follow other numbers of the scene.

    **Arguments:**

    - `scene`: as it was read.

    **Returns:**

    A sentence or two each.
    """
    bores = assumed_bores(scene.whole, scene.given)
    return [
        *(_told_bore(scene, path, bore) for path, bore in bores.items()),
        *_told_solid(scene),
        *_told_fillets(scene),
    ]


def _told_bore(scene: "Scene", path: str, bore: float) -> str:
    gear = path.partition(".")[0]
    shaft = _shaft_diameter(gear, scene.whole)
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


def _told_solid(scene: "Scene") -> list[str]:
    """Remarks on gears that are said to have no bore, and on what they stand on then."""
    return [
        f"The {gear} has no bore, so its body is not clamped and does not wind up: its foundation "
        "is weber, with which the mean TE of a bored pair was 40 % less than with finite elements. "
        f"Give {gear}.bore_mm, the diameter at which the body is held, for the default ring."
        for gear in GEARS
        if scene.get(f"{gear}.bore_mm") == 0.0
        if f"{gear}.foundation" in assumed_foundations(scene.values, scene.given)
        if scene["mesh.stiffness"] == _TEETH and scene[f"{gear}.body.kind"] == "rigid"
    ]


def _told_fillets(scene: "Scene") -> list[str]:
    fillets = assumed_fillets(scene.whole, scene.given)
    return [
        f"{path} was assumed to be {value:g}, not {_usual(path):g}: with "
        f"pair.pressure_angle_deg = {scene['pair.pressure_angle_deg']:g} and a dedendum of "
        f"{scene[path.replace('fillet_radius', 'dedendum')]:g} no larger one fits between the "
        "straight flanks of the rack that cuts the teeth. Give your own if you know it."
        for path, value in fillets.items()
    ]


def _lies_on_ring(gear: str, values: Mapping[str, Any]) -> bool:
    """Say whether the teeth of a rigid gear stand on a ring."""
    return (
        values.get(f"{gear}.foundation", values.get("mesh.foundation")) == "ring"
        and values.get("mesh.stiffness") == _TEETH
        and values.get(f"{gear}.body.kind") == "rigid"
    )


def _shaft_diameter(gear: str, values: Mapping[str, Any]) -> float | None:
    """Outer diameter of the shaft at mid-face; `None` without a shaft [mm]."""
    left = values.get(f"{gear}.shaft.gear_at_mm")
    for row in itertools.count():
        segment = f"{gear}.shaft.segments[{row}]"
        length, outer = (values.get(f"{segment}.{key}_mm") for key in ("length", "outer"))
        if left is None or length is None or outer is None:
            return None
        left -= length
        if left <= 0.0:
            return outer


def _usual(path: str) -> float:
    default = KEYS[path].default
    assert isinstance(default, float)
    return default


def _largest_fillets(values: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """The largest tip radius of each gear's rack over module, rounded down to a thousandth."""
    for gear in GEARS:
        angle = values.get("pair.pressure_angle_deg")
        dedendum = values.get(f"{gear}.dedendum_coeff")
        if angle is not None and dedendum is not None:
            alpha = math.radians(angle)
            room = 0.25 * math.pi - dedendum * math.tan(alpha)
            corner = (1.0 - math.sin(alpha)) / math.cos(alpha)
            # Not up to the very limit, where the least change of the angle would be too much.
            yield f"{gear}.fillet_radius_coeff", max(math.floor(1e3 * room / corner) / 1e3, 0.0)
