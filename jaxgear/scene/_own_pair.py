"""Sizes of one's own pair: what is not given follows rules of thumb, each with its source.

The rules give a pair that runs, not one that lasts: strength is not checked. Lengths are in
millimetres, forces in newtons, angles in degrees.
"""

import dataclasses
import math

from jaxgear._geometry._drawn import involute, transverse_angle
from jaxgear.scene._assumed import largest_fillet
from jaxgear.scene._slips import angle_of_involute

# Profile A of ISO 53, over module.
ADDENDUM, DEDENDUM, FILLET = 1.0, 1.25, 0.38
# Teeth at their tips over module (DIN 3960: not less than 0.2).
_TIP = 0.25
# Shigley, Mechanical Engineering Design: faces of 3 to 5 circular pitches; ten modules are 3.2.
_FACE = 10.0
# The K factor F_t (u + 1)/(b d u) of Lloyd's, moderate for hardened steel (Dudley, Handbook of
# Practical Gear Design) [N/mm2].
K_FACTOR = 2.0
# Half of the 41 N/mm2 of the ASME code for transmission shafting with keyways (1927), for bending
# comes on top [N/mm2].
TORSION = 20.0
# Rim under the teeth over their height, from which on it is as good as solid (ISO 6336-3).
_RIM = 1.2
# Of the root diameter: no shaft is thinner, and where teeth leave no rim none is thicker.
_THINNEST, _WITHOUT_RIM = 0.2, 0.4
# Deep-groove ball bearings of the 62 series: balls, and their diameter over the bore's.
_BALLS, _BALL = 9, 0.28
# Kraemer, Dynamics of Rotors and Foundations (1993): radial stiffness of ball bearings,
# k_b n^(2/3) d^(1/3) F^(1/3), in newtons and metres [N^(2/3) m^(-4/3)].
_BEARING = 13e6
AXIAL = 0.2


@dataclasses.dataclass(frozen=True)
class Wanted:
    """What is known of a pair.

    **Fields:**

    - `name`: of the scene.
    - `teeth`: of pinion and wheel [-].
    - `module`: normal module [mm].
    - `pressure_angle`: normal pressure angle [deg].
    - `helix`: helix angle, positive for a right-hand pinion [deg].
    - `face`: face width, or `None` [mm].
    - `torque`: on the pinion, or `None` [N m].
    - `power`: on the pinion, with a speed in place of the torque, or `None` [W].
    - `rpm`: speed of the pinion in revolutions per minute, or `None` [rpm].
    """

    name: str
    teeth: tuple[int, int]
    module: float
    pressure_angle: float = 20.0
    helix: float = 0.0
    face: float | None = None
    torque: float | None = None
    power: float | None = None
    rpm: float | None = None


@dataclasses.dataclass(frozen=True)
class Sizes:
    """Sizes of one gear and its shaft.

    **Fields:**

    - `teeth`: number of teeth.
    - `shift`: profile shift [-].
    - `shaft`: diameter of its shaft [mm].
    - `bearing`: radial stiffness of each of its bearings [N/m].
    """

    teeth: int
    shift: float
    shaft: float
    bearing: float


def profile_shifts(
    teeth: tuple[int, int], pressure_angle: float, helix: float
) -> tuple[float, float]:
    r"""Profile shifts that balance a pair, and undercut neither gear.

    Of virtual spur teeth $z/\cos^3\beta$ (BS PD 6457): where they sum to 60 or more, $x_1 =
    -x_2$, the larger of $0.4(1 - z_1/z_2)$ and $0.02(30 - z_1)$ with the smaller gear as 1; else
    each $0.02(30 - z)$. Not so much that a tip is thinner than 0.25 modules, but as far up as the
    rack's straight flank asks for, lest it undercut.
    """
    few, many = sorted(virtual := [z / math.cos(math.radians(helix)) ** 3 for z in teeth])
    if few + many >= 60.0:
        balanced = max(0.4 * (1.0 - few / many), 0.02 * (30.0 - few))
        shifts = [balanced if z == few else -balanced for z in virtual]
        shifts = [0.0, 0.0] if few == many else shifts
    else:
        shifts = [0.02 * (30.0 - z) for z in virtual]
    pinion, wheel = (
        round(_within_limits(x, z, pressure_angle, helix), 3)
        for x, z in zip(shifts, teeth, strict=True)
    )
    return pinion, wheel


def fillet_radius(pressure_angle: float) -> float:
    """Tip radius over module of a rack of dedendum 1.25: the usual one, or what fits [-].

    The straight flank above it must be as long as the mating addendum, to a ten-thousandth: 0.38 at
    20 degrees, less below.
    """
    fits = min(FILLET, largest_fillet(pressure_angle, DEDENDUM))
    longest = (DEDENDUM - ADDENDUM) / (1.0 - math.sin(math.radians(pressure_angle)))
    return min(fits, math.floor(1e3 * longest + 0.1) / 1e3)


def tip_shortening(wanted: Wanted) -> float:
    r"""$k = x_1 + x_2 - y$, which keeps the rack's clearance where both gears are shifted [-]."""
    shifts = sum(profile_shifts(wanted.teeth, wanted.pressure_angle, wanted.helix))
    beta, teeth = math.radians(wanted.helix), sum(wanted.teeth)
    angle = _transverse(wanted.pressure_angle, wanted.helix)
    normal = math.tan(math.radians(wanted.pressure_angle))
    working = angle_of_involute(involute(angle) + 2.0 * shifts * normal / teeth)
    centres = 0.5 * teeth / math.cos(beta) * (math.cos(angle) / math.cos(working) - 1.0)
    # Shifts that balance leave rounding, which is no thousandth.
    return max(math.ceil(1e3 * (shifts - centres) - 1e-6) / 1e3, 0.0)


def face_width(wanted: Wanted) -> float:
    """Ten modules, but not more than the pinion's reference diameter; or what is given [mm]."""
    if wanted.face is not None:
        return wanted.face
    return rounded(min(_FACE * wanted.module, min(_diameters(wanted))))


def pinion_torque(wanted: Wanted) -> float:
    """Torque given, by power and speed, or for a moderate K factor [N m]."""
    if wanted.torque is not None:
        return wanted.torque
    if wanted.power is not None and wanted.rpm is not None:
        return wanted.power / (wanted.rpm * math.pi / 30.0)
    pinion, wheel = _diameters(wanted)
    force = K_FACTOR * face_width(wanted) * pinion * wheel / (pinion + wheel)
    return rounded(0.5e-3 * force * pinion)


def _least_shift(teeth: int, pressure_angle: float, helix: float) -> float:
    """Profile shift from which on the rack's straight flank cuts the whole involute [-]."""
    normal, beta = math.radians(pressure_angle), math.radians(helix)
    straight = DEDENDUM - fillet_radius(pressure_angle) * (1.0 - math.sin(normal))
    least = (
        straight - 0.5 * teeth / math.cos(beta) * math.sin(_transverse(pressure_angle, helix)) ** 2
    )
    return math.ceil(1e3 * least) / 1e3


def _within_limits(shift: float, teeth: int, pressure_angle: float, helix: float) -> float:
    """A profile shift lowered until the tip is thick enough, then raised against undercut [-]."""
    while _tip_thickness(shift, teeth, pressure_angle, helix) < _TIP:
        shift -= 0.02
    return max(shift, _least_shift(teeth, pressure_angle, helix))


def _tip_thickness(shift: float, teeth: int, pressure_angle: float, helix: float) -> float:
    """Thickness at the tip over module, in the normal section [-]."""
    angle, cosine = _transverse(pressure_angle, helix), math.cos(math.radians(helix))
    thickness = 0.5 * math.pi + 2.0 * shift * math.tan(math.radians(pressure_angle))
    diameter = teeth / cosine
    tip = diameter + 2.0 * (ADDENDUM + shift)
    half = (
        thickness / teeth + involute(angle) - involute(math.acos(diameter * math.cos(angle) / tip))
    )
    return tip * half * cosine


def _transverse(pressure_angle: float, helix: float) -> float:
    """Transverse pressure angle [rad]."""
    return transverse_angle(math.radians(pressure_angle), math.radians(helix))


def _diameters(wanted: Wanted) -> tuple[float, float]:
    """Reference diameters [mm]."""
    scale = wanted.module / math.cos(math.radians(wanted.helix))
    return wanted.teeth[0] * scale, wanted.teeth[1] * scale


def sizes(wanted: Wanted) -> tuple[Sizes, Sizes]:
    """Profile shifts, shafts and bearings of both gears."""
    shifts = profile_shifts(wanted.teeth, wanted.pressure_angle, wanted.helix)
    diameters, torque = _diameters(wanted), 1e3 * pinion_torque(wanted)
    angle = _transverse(wanted.pressure_angle, wanted.helix)
    force = 2.0 * torque / diameters[0] / math.cos(angle)
    found = []
    for teeth, shift, diameter in zip(wanted.teeth, shifts, diameters, strict=True):
        root = diameter - 2.0 * wanted.module * (DEDENDUM - shift)
        shaft = _shaft_diameter(torque * teeth / wanted.teeth[0], root, wanted.module)
        ball = 1e-3 * _BALL * shaft
        stiffness = _BEARING * (_BALLS**2 * ball * 0.5 * force) ** (1.0 / 3.0)
        found.append(Sizes(teeth, shift, shaft, stiffness))
    return found[0], found[1]


def _shaft_diameter(torque: float, root: float, module: float) -> float:
    """Diameter by torsion alone, within what the gear leaves [mm]."""
    by_torsion = (16.0 * torque / (math.pi * TORSION)) ** (1.0 / 3.0)
    rimmed = root - 2.0 * _RIM * (ADDENDUM + DEDENDUM) * module
    return rounded(min(max(by_torsion, _THINNEST * root), max(rimmed, _WITHOUT_RIM * root)))


def rounded(value: float) -> float:
    """Round to two digits, downwards: the next size that a drawing would have."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / scale + 1e-9) * scale:.2g}")
