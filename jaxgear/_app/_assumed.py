"""Defaults that follow other numbers of a scene, and what is said of them."""

import math
from collections.abc import Iterator, Mapping, Set
from typing import TYPE_CHECKING, Any

from jaxgear._app._schema import GEARS, KEYS

if TYPE_CHECKING:
    from jaxgear._app._scene import Scene


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


def assumed(scene: "Scene") -> list[str]:
    """Remarks on defaults that follow other numbers of the scene.

    **Arguments:**

    - `scene`: as it was read.

    **Returns:**

    A sentence or two each.
    """
    fillets = assumed_fillets(scene.values, scene.given)
    return [
        f"{path} was assumed to be {value:g}, not {_usual(path):g}: with "
        f"pair.pressure_angle_deg = {scene['pair.pressure_angle_deg']:g} and a dedendum of "
        f"{scene[path.replace('fillet_radius', 'dedendum')]:g} no larger one fits between the "
        "straight flanks of the rack that cuts the teeth. Give your own if you know it."
        for path, value in fillets.items()
    ]


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
