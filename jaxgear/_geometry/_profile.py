r"""The shape of one tooth in its (virtual) spur section: involute flank and trochoid fillet.

A helical gear is treated as its virtual spur gear of $z_n = z/(\cos^2\beta_b\cos\beta)$
teeth and module $m_n$ (ISO 6336-3). Coordinates have their origin at the gear's centre,
`height` along the tooth's centreline, and the tooth is symmetric about it.
"""

import equinox as eqx
import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._geometry._gear import Gear
from jaxgear._geometry._pair import GearPair
from jaxgear._types import Reals, Scalar


class ToothSection(eqx.Module):
    r"""A rack-generated tooth of a spur gear whose number of teeth need not be whole.

    **Fields:**

    - `teeth`: $z_n$ [-].
    - `module`: $m_n$ [m].
    - `pressure_angle`: $\alpha_n$ [rad].
    - `profile_shift`: $x$ [-].
    - `dedendum`: $h^*_{fP}$ [-].
    - `fillet_radius`: $\rho^*_{fP}$ of the rack's tip [-].
    - `radius_ratio`: root circle over bore of the body under it, or `None` without a bore [-].
    """

    teeth: Scalar
    module: Scalar
    pressure_angle: Scalar
    profile_shift: Scalar
    dedendum: Scalar
    fillet_radius: Scalar
    radius_ratio: Scalar | None = None

    @property
    def _rack_tip_land(self) -> Scalar:
        """Half the flat at the rack's tip, between the centres of its two tip radii [m]."""
        angle = self.pressure_angle
        half = 0.25 * jnp.pi - (self.dedendum - self.fillet_radius) * jnp.tan(angle)
        return self.module * (half - self.fillet_radius / jnp.cos(angle))

    @property
    def reference_radius(self) -> Scalar:
        """$r$ [m]."""
        return 0.5 * self.module * self.teeth

    @property
    def base_radius(self) -> Scalar:
        """$r_b$ [m]."""
        return self.reference_radius * jnp.cos(self.pressure_angle)

    @property
    def root_radius(self) -> Scalar:
        """$r_f$ [m]."""
        return self.reference_radius - self.module * (self.dedendum - self.profile_shift)

    def half_angle(self, roll_angle: Reals) -> Reals:
        r"""Half the angle of the tooth where the involute's roll angle is given.

        **Arguments:**

        - `roll_angle`: $\tan\alpha(r)$ [rad].

        **Returns:**

        $\psi = s/(2r)$ [rad].
        """
        angle = self.pressure_angle
        half = (0.5 * jnp.pi + 2.0 * self.profile_shift * jnp.tan(angle)) / self.teeth
        at_reference = jnp.tan(angle) - angle
        return half + at_reference - (roll_angle - jnp.arctan(roll_angle))

    def flank(self, roll_angle: Reals) -> tuple[Reals, Reals]:
        r"""A point of the involute.

        **Arguments:**

        - `roll_angle`: $\tan\alpha(r)$ [rad].

        **Returns:**

        Half thickness and height [m].
        """
        radius = self.base_radius * jnp.sqrt(1.0 + roll_angle**2)
        half = self.half_angle(roll_angle)
        return radius * jnp.sin(half), radius * jnp.cos(half)

    def fillet(self, rack_angle: Reals) -> tuple[Reals, Reals]:
        r"""A point of the trochoid that the rack's rounded tip cuts as its line rolls off.

        **Arguments:**

        - `rack_angle`: inclination of the rack's tip normal [rad], from $\alpha_n$ (where the
            involute begins) to $\pi/2$ (the root circle).

        **Returns:**

        Half thickness and height [m].
        """
        tip_radius = self.fillet_radius * self.module
        depth = (self.dedendum - self.fillet_radius - self.profile_shift) * self.module
        sine, cosine = jnp.sin(rack_angle), jnp.cos(rack_angle)
        reach = depth / sine + tip_radius
        turn = (depth * cosine / sine - self._rack_tip_land) / self.reference_radius
        turn = turn + jnp.pi / self.teeth
        x, y = reach * cosine, self.reference_radius - reach * sine
        return x * -jnp.cos(turn) + y * jnp.sin(turn), x * jnp.sin(turn) + y * jnp.cos(turn)

    @property
    def root_half_angle(self) -> Scalar:
        r"""$\theta_f$, half the angle of the tooth at its root circle [rad]."""
        x, y = self.fillet(jnp.asarray(0.5 * jnp.pi))
        return jnp.arctan2(x, y)

    @property
    def form_roll_angle(self) -> Scalar:
        """Roll angle at which the involute begins [rad]."""
        x, y = self.fillet(self.pressure_angle)
        radius_squared = x**2 + y**2
        return jnp.sqrt(jnp.maximum(radius_squared / self.base_radius**2 - 1.0, 0.0))


@compiled
def tooth_section(pair: GearPair, gear: Gear) -> ToothSection:
    """The virtual spur tooth of one gear of a pair (theory 1.10).

    **Arguments:**

    - `pair`: gives the module and the angles.
    - `gear`: `pair.pinion` or `pair.wheel`.

    **Returns:**

    The tooth in its normal section, on a body with the gear's own ratio of root circle to bore.
    """
    spread = jnp.cos(pair.base_helix_angle) ** 2 * jnp.cos(pair.helix_angle)
    return ToothSection(
        teeth=gear.teeth / spread,
        module=pair.normal_module,
        pressure_angle=pair.pressure_angle,
        profile_shift=gear.profile_shift,
        dedendum=gear.dedendum,
        fillet_radius=gear.fillet_radius,
        radius_ratio=_radius_ratio(pair, gear),
    )


@compiled
def transverse_section(pair: GearPair, gear: Gear) -> ToothSection:
    r"""The tooth as it is seen along the axis: what the gear's body is loaded by (theory 3.15).

    Flank, root circle and the tooth's angle on it are exact. The rack's tip, in this section part
    of an ellipse, is the circle that leaves the same land between the tips of two teeth.

    **Arguments:**

    - `pair`: gives the module and the angles.
    - `gear`: `pair.pinion` or `pair.wheel`.

    **Returns:**

    The tooth in its transverse section, on the gear's own body.
    """
    cosine = jnp.cos(pair.helix_angle)
    angle = pair.transverse_pressure_angle
    tip = lambda angle: 1.0 / jnp.cos(angle) - jnp.tan(angle)
    return ToothSection(
        teeth=jnp.asarray(float(gear.teeth)),
        module=pair.transverse_module,
        pressure_angle=angle,
        profile_shift=gear.profile_shift * cosine,
        dedendum=gear.dedendum * cosine,
        fillet_radius=gear.fillet_radius * tip(pair.pressure_angle) / tip(angle),
        radius_ratio=_radius_ratio(pair, gear),
    )


def _radius_ratio(pair: GearPair, gear: Gear) -> Scalar | None:
    """Root circle over bore, if there is one [-]."""
    if gear.bore is None:
        return None
    reference = 0.5 * pair.transverse_module * gear.teeth
    root = reference - pair.normal_module * (gear.dedendum - gear.profile_shift)
    return 2.0 * root / gear.bore
