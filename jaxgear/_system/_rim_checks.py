"""Rims of condensed bodies that cannot carry the teeth of their gear."""

import numpy as np

from jaxgear._checks import require
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._system._condensed import Condensed
from jaxgear._units import mm

# Longest element of a rim [pitches], widest [faces], and slices that even one element can follow.
_LONGEST, _WIDEST, _FEW_SLICES = 1.5, 0.5 + 1e-6, 3

# How far rim and root circle may be apart, of the radius.
_RIM_OFF = 5e-3


def check_rim(body: Condensed, pair: GearPair, index: int) -> None:
    """Refuse a body that cannot carry these teeth."""
    name = ("pinion", "wheel")[index]
    require(
        len(body.rim_faces) > 0,
        "The condensed body of the {name} must know the elements of its rim: give the faces with "
        "the matrices, or condense it from a grid.",
        name=name,
    )
    radius = float(np.median(np.hypot(body.rim_nodes[:, 0], body.rim_nodes[:, 1])))
    root = float(pair.root_radius[index])
    units = "" if 0.01 < radius / root < 100.0 else " Its file is in other units than metres."
    require(
        abs(radius - root) <= _RIM_OFF * root,
        "The rim of the {name}'s condensed body must have the radius of the root circle of its "
        "teeth, {root:.6g} mm, got {got:.6g} mm. It is the body of another gear.{units}",
        name=name,
        root=root / mm,
        got=radius / mm,
        units=units,
    )
    width = float(np.ptp(body.rim_nodes[:, 2]))
    face = float(pair.face_width)
    require(
        width >= (1.0 - 1e-6) * face,
        "The {name}'s condensed body must be at least as wide as the face in contact, {face:.6g} "
        "mm, got {got:.6g} mm.",
        name=name,
        face=face / mm,
        got=width / mm,
    )


def require_short_elements(name: str, around: float) -> None:
    """Refuse elements of a rim that cover too many teeth.

    **Arguments:**

    - `name`: of the gear.
    - `around`: pitches that one element covers [-].

    **Raises:**

    - `InputError` if they are too many.
    """
    require(
        around <= _LONGEST,
        "The elements of the rim of the {name}'s condensed body are too coarse for its teeth: one "
        "covers {around:.3g} pitches, at most {most:.3g} can be. Use more elements around, one for "
        "each tooth or more.",
        name=name,
        around=around,
        most=_LONGEST,
    )


def check_elements(body: Condensed, pair: GearPair, index: int, grid: MeshGrid) -> None:
    """Refuse a rim whose elements cannot follow the loads of teeth."""
    name, gear = ("pinion", "wheel")[index], (pair.pinion, pair.wheel)[index]
    corners = body.rim_nodes[body.rim_faces[:, :4]]
    angle = np.arctan2(corners[..., 1], corners[..., 0])
    turned = (angle - angle[:, :1] + np.pi) % (2.0 * np.pi)
    require_short_elements(name, float(np.ptp(turned, axis=1).max()) * gear.teeth / (2.0 * np.pi))
    across, face = float(np.ptp(corners[..., 2], axis=1).max()), float(pair.face_width)
    require(
        across <= _WIDEST * face or grid.slices <= _FEW_SLICES,
        "The elements of the rim of the {name}'s condensed body are too coarse for {slices} "
        "slices: one covers {across:.6g} mm of a face of {face:.6g} mm, at most half of it can be. "
        "Use more elements across the rim, or {few} slices.",
        name=name,
        slices=grid.slices,
        across=across / mm,
        face=face / mm,
        few=_FEW_SLICES,
    )
