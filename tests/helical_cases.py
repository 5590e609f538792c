"""A small helical gear that CalculiX was given too, and loads on one flank of it."""

import math

import numpy as np

from fem_prep._assembly import Material
from fem_prep._prism import FaceWaves
from fem_prep._tooth_section import ToothSizing
from fem_prep._tooth_shape import ToothedGear

STEEL = Material()
# Four modules wide: a contact line crosses half of its flank.
GEAR = ToothedGear(
    teeth=24,
    module=3e-3,
    pressure_angle=math.radians(20.0),
    helix_angle=math.radians(25.0),
    profile_shift=0.1,
    dedendum=1.25,
    fillet_radius=0.3,
    tip_radius=43.0e-3,
    bore=60e-3,
    face_width=12e-3,
)
# That of helical gears in scenes.
FINE = ToothSizing(flank=7, across=4, gap=6, ring=6, margin=1, waves=6)
WAVES = FaceWaves(GEAR.face_width, 10)
# Places along the face that are compared [m].
ACROSS = np.linspace(-5.5e-3, 5.5e-3, 12)


def even_load() -> np.ndarray:
    """100 N/mm along the middle row, by rows and waves [N/m^1/2]."""
    load = np.zeros((FINE.flank, WAVES.count))
    load[FINE.flank // 2, 0] = 1e5 * math.sqrt(GEAR.face_width)
    return load


def contact_line() -> np.ndarray:
    """100 N/mm along a line of the plane of action, spread over about two rows of the flank."""
    part = np.linspace(0.0, 1.0, FINE.flank + 1)
    part = 0.5 * (part + 0.5 - 0.5 * np.cos(np.pi * part))
    squares = GEAR.form_roll**2 + part * (GEAR.tip_roll**2 - GEAR.form_roll**2)
    roll = np.sqrt(0.5 * (squares[1:] + squares[:-1]))
    points, weights = np.polynomial.legendre.leggauss(40)
    z, weights = 0.5 * GEAR.face_width * points, 0.5 * GEAR.face_width * weights
    on_line = roll[FINE.flank // 2] + z * math.tan(GEAR.base_helix_angle)
    each = np.exp(-(((roll[:, None] - on_line) / (0.15 * (roll[-1] - roll[0]))) ** 2))
    each *= 1e5 / each.sum(axis=0)
    return (each * weights) @ WAVES.at(z)
