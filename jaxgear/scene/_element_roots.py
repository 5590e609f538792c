"""Stresses at the roots of a scene's teeth of finite elements."""

from collections.abc import Sequence

import numpy as np

from fem_prep import ToothedGear, ToothElements
from jaxgear._contact._element_roots import (
    FILLET_POINTS,
    ElementRootInfluence,
    element_root_influence,
)
from jaxgear._contact._root_influence import RootInfluence
from jaxgear._contact._tooth_elements import tooth_tables


def element_roots(
    teeth: Sequence[tuple[ToothedGear, ToothElements]], plane: tuple[RootInfluence, RootInfluence]
) -> tuple[ElementRootInfluence, ElementRootInfluence]:
    """The influences of a scene's condensed teeth.

    **Arguments:**

    - `teeth`: of pinion and wheel, their shapes and what was condensed of them.
    - `plane`: the influences of the same teeth in plane strain.

    **Returns:**

    Pinion, wheel.
    """
    pinion, wheel = (gear_roots(*each, own) for each, own in zip(teeth, plane, strict=True))
    return pinion, wheel


def gear_roots(
    shape: ToothedGear, teeth: ToothElements, plane: RootInfluence
) -> ElementRootInfluence:
    """The influence of one gear's condensed teeth.

    **Arguments:**

    - `shape`: of the gear.
    - `teeth`: what was condensed of it.
    - `plane`: the influence of the same teeth in plane strain.

    **Returns:**

    The influence.
    """
    angle = np.linspace(shape.pressure_angle, 0.5 * np.pi, FILLET_POINTS)
    radius, half = shape.fillet(angle)
    land = np.linspace(half[-1], max(0.5 * shape.pitch_angle, half[-1]), FILLET_POINTS)[1:]
    fillet = _upright(np.append(radius, np.full(land.size, radius[-1])), np.append(half, land))
    up = np.linspace(shape.form_roll, shape.tip_roll, plane.flank.shape[0])
    # Tooth 0 lies along the first axis; the other side is mirrored onto this one.
    places = np.abs(teeth.root_places[0][..., ::-1])
    # Young's modulus has no part in stresses by given loads.
    tables = tooth_tables(teeth.compliance, teeth.roll, teeth.face_width, 1.0)
    outline = fillet, _upright(*shape.involute(up))
    return element_root_influence(teeth.root_stress, places, outline, tables, plane)


def _upright(radius: np.ndarray, half_angle: np.ndarray) -> np.ndarray:
    """Half thickness and height."""
    return radius[:, None] * np.stack([np.sin(half_angle), np.cos(half_angle)], axis=-1)
