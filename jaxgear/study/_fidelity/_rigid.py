"""Rigid bodies in place of condensed ones, with the mass that these have."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxgear._system._model import PairModel
from jaxgear._system._mount import AbstractMount
from jaxgear._system._shaft import Shaft
from jaxgear.scene._schema import GEARS
from jaxgear.study._fidelity._level import Changes


def rigid_changes(bodies: Mapping[str, Any], rigid: PairModel) -> Mapping[str, Changes]:
    """What makes condensed bodies rigid: changes of keys, by the name of the level.

    All are, with the foundation that the scene has for rigid bodies and without; and, if both gears
    are condensed, the pinion alone.

    **Arguments:**

    - `bodies`: that are condensed, by gear.
    - `rigid`: the model with rigid bodies in their place.
    """
    mounts = {"pinion": rigid.pinion_support, "wheel": rigid.wheel_support}
    numbers: dict[str, Changes] = {}
    for gear, mesh_body in bodies.items():
        body = mesh_body.built.body
        inertia = body.rigid_motions.T @ (body.mass @ body.rigid_motions)
        own = _rigid_numbers(gear, inertia, mounts[gear])
        numbers[gear] = {f"{gear}.body.kind": "rigid", **own}
    whole = {key: value for own in numbers.values() for key, value in own.items()}
    bare = {f"{gear}.foundation": "none" for gear in numbers}
    found = {"rigid": whole, "rigid, no foundation": whole | bare}
    return found | ({"rigid pinion": numbers["pinion"]} if len(numbers) == len(GEARS) else {})


def _rigid_numbers(gear: str, inertia: np.ndarray, mount: AbstractMount) -> Changes:
    """The keys of a rigid body with the inertia of a condensed one, its shaft's share left out."""
    own = np.array([inertia[0, 0], inertia[5, 5], 0.5 * (inertia[3, 3] + inertia[4, 4])])
    if isinstance(mount, Shaft):
        own -= _shaft_inertia(mount)
    keys = ("mass_kg", "inertia_kg_m2", "transverse_inertia_kg_m2")
    named = (f"{gear}.body.{key}" for key in keys)
    return dict(zip(named, own.tolist(), strict=True))


def _shaft_inertia(shaft: Shaft) -> np.ndarray:
    """Mass, polar and transverse inertia of a shaft about its gear's middle [kg, kg m2]."""
    total, left = np.zeros(3), 0.0
    for segment in shaft.segments:
        length, outer, inner = (float(x) for x in (segment.length, segment.outer, segment.inner))
        mass = float(shaft.material.density) * math.pi / 4.0 * (outer**2 - inner**2) * length
        square = (outer**2 + inner**2) / 4.0
        away = left + 0.5 * length - float(shaft.gear_at)
        across = 0.25 * square + length**2 / 12.0 + away**2
        total += mass * np.array([1.0, 0.5 * square, across])
        left += length
    return total
