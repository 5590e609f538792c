r"""The transverse outline of a rack-cut tooth: involute flank and trochoid fillet.

A helical gear is cut by a rack whose normal section is the basic rack: seen along the axis it is
stretched by $1/\cos\beta$ along its pitch line, so that the round tip is part of an ellipse. Angles
are counted from the middle of a tooth.
"""

import math
from dataclasses import dataclass

import numpy as np

from ._checks import BodyError, require


@dataclass(frozen=True)
class ToothedGear:
    r"""What a toothed gear on a plain ring, held at its bore, is made from.

    **Fields:**

    - `teeth`: number of teeth [-].
    - `module`: normal module [m].
    - `pressure_angle`: normal pressure angle [rad].
    - `helix_angle`: at the reference circle, positive for a right hand [rad].
    - `profile_shift`: $x$ [-].
    - `dedendum`: $h^*_{fP}$ of the rack [-].
    - `fillet_radius`: $\rho^*_{fP}$ of the rack's tip [-].
    - `tip_radius`: of the gear [m].
    - `bore`: diameter at which the ring is held over its whole width [m].
    - `face_width`: of the gear itself [m].

    **Raises:**

    - `BodyError` if there is no ring to hold the teeth, or if they are pointed or undercut.
    """

    teeth: int
    module: float
    pressure_angle: float
    helix_angle: float
    profile_shift: float
    dedendum: float
    fillet_radius: float
    tip_radius: float
    bore: float
    face_width: float

    def __post_init__(self):
        require(
            self.bore > 0.0,
            "Teeth of finite elements stand on a ring that is held at its bore, and this gear has "
            "none. Give it a bore.",
        )
        require(
            self.root_radius - 0.5 * self.bore >= MIN_RIM * self.module,
            "Under teeth of finite elements the ring must be at least {least} modules thick, "
            "{want:.4g/mm} mm, got {got:.4g/mm} mm between bore and root circle. Make the bore "
            "smaller, or the body condensed.",
            least=MIN_RIM,
            want=MIN_RIM * self.module,
            got=self.root_radius - 0.5 * self.bore,
        )
        if not self.form_roll_squared > 0.0:
            raise BodyError(
                "The teeth are undercut, or their involute begins on the base circle: teeth of "
                "finite elements need a fillet that ends in an involute. Raise the profile shift."
            )
        if not (self.half_angle(self.tip_roll) > 0.0 and self.tip_roll > self.form_roll):
            raise BodyError("The teeth are pointed, or have no involute. Lower their tip circle.")

    @property
    def transverse_pressure_angle(self) -> float:
        r"""$\alpha_t$ [rad]."""
        return math.atan(math.tan(self.pressure_angle) / math.cos(self.helix_angle))

    @property
    def reference_radius(self) -> float:
        """$r$ [m]."""
        return 0.5 * self.teeth * self.module / math.cos(self.helix_angle)

    @property
    def base_radius(self) -> float:
        """$r_b$ [m]."""
        return self.reference_radius * math.cos(self.transverse_pressure_angle)

    @property
    def base_helix_angle(self) -> float:
        r"""$\beta_b$, signed as the helix [rad]."""
        return math.asin(math.sin(self.helix_angle) * math.cos(self.pressure_angle))

    @property
    def root_radius(self) -> float:
        """$r_f$ [m]."""
        return self.reference_radius - self.module * (self.dedendum - self.profile_shift)

    @property
    def twist(self) -> float:
        """Rotation of the transverse section per length of the axis, right-handed [rad/m]."""
        return math.tan(self.helix_angle) / self.reference_radius

    @property
    def pitch_angle(self) -> float:
        """Angle of one pitch [rad]."""
        return 2.0 * math.pi / self.teeth

    @property
    def tip_roll(self) -> float:
        """Roll length from the base tangent point to the tip [m]."""
        return math.sqrt(max(self.tip_radius**2 - self.base_radius**2, 0.0))

    @property
    def form_roll_squared(self) -> float:
        """Square of the roll length at which the involute begins [m2]."""
        radius, _ = self.fillet(np.array(self.pressure_angle))
        return float(radius) ** 2 - self.base_radius**2

    @property
    def form_roll(self) -> float:
        """Roll length at which the involute begins [m]."""
        return math.sqrt(max(self.form_roll_squared, 0.0))

    def half_angle(self, roll: np.ndarray | float) -> np.ndarray:
        r"""Half the angle of the tooth at a point of its involute.

        **Arguments:**

        - `roll`: roll length of the point [m].

        **Returns:**

        $\psi$ [rad].
        """
        angle = self.transverse_pressure_angle
        arc = 0.5 * math.pi + 2.0 * self.profile_shift * math.tan(self.pressure_angle)
        at_base = arc / self.teeth + math.tan(angle) - angle
        rolled = np.asarray(roll) / self.base_radius
        return at_base - (rolled - np.arctan(rolled))

    def involute(self, roll: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points of the flank.

        **Arguments:**

        - `roll`: roll lengths [m].

        **Returns:**

        Radii [m], and angles from the middle of the tooth [rad].
        """
        return np.hypot(self.base_radius, roll), self.half_angle(roll)

    def fillet(self, rack_angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r"""Points of the trochoid that the rack's round tip cuts.

        A point of the rack cuts when its normal passes through the pitch point.

        **Arguments:**

        - `rack_angle`: inclination of the rack's normal in its normal section, from $\alpha_n$,
            where the involute begins, to $\pi/2$ on the root circle [rad].

        **Returns:**

        Radii [m], and angles from the middle of the tooth [rad].
        """
        stretch = 1.0 / math.cos(self.helix_angle)
        tip = self.fillet_radius * self.module
        depth = (self.dedendum - self.fillet_radius - self.profile_shift) * self.module
        flat = 0.25 * math.pi - (self.dedendum - self.fillet_radius) * math.tan(self.pressure_angle)
        flat = self.module * (flat - self.fillet_radius / math.cos(self.pressure_angle))
        cosine, sine = np.cos(rack_angle), np.sin(rack_angle)
        along, down = stretch * (flat + tip * cosine), -(depth + tip * sine)
        # Where the normal through the point crosses the pitch line, the pitch point is to be.
        off_pitch_point = -down * cosine / (stretch * sine)
        turned = (off_pitch_point - along) / self.reference_radius
        radius = np.hypot(off_pitch_point, self.reference_radius + down)
        from_gap = np.arctan2(off_pitch_point, self.reference_radius + down) - turned
        return radius, math.pi / self.teeth - from_gap


MIN_RIM = 1.0  # thinnest ring under the teeth [modules]
