r"""Everything closed-form about a gear pair, whatever holds its numbers of teeth.

Subscript $t$ is the transverse section, $n$ the normal one, $w$ the working pitch
cylinder. Quantities of both gears carry the axis `body`: pinion, wheel. Positions along
the line of action are roll lengths from the pinion's base tangent point $T_1$; with the
pinion driving, contact runs from `path_start` (the wheel's tip) to `path_end`
(the pinion's tip). Formulas: ISO 21771-1, unless said.
"""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._geometry._gear import Gear
from jaxgear._geometry._involute import inverse_involute, involute
from jaxgear._types import Bodies, Scalar


def _derived(function: Callable[[Any], Array]) -> property:
    """A property that is traced once for each kind of pair: a program asks for lengths often.

    Outside of programs it is one program, and not one for each of its operations.
    """
    return property(jax.jit(function))


class AbstractGearPair(eqx.Module):
    r"""Lengths and angles of two external involute gears in mesh (theory 1.1 to theory 1.6).

    **Fields:**

    - `pinion`, `wheel`: the gears.
    - `normal_module`: $m_n$ [m].
    - `pressure_angle`, `helix_angle`: at the reference cylinder [rad].
    - `centre_distance`: working centre distance [m], or `None` for the zero-backlash one.
    """

    pinion: eqx.AbstractVar[Gear]
    wheel: eqx.AbstractVar[Gear]
    normal_module: eqx.AbstractVar[Scalar]
    pressure_angle: eqx.AbstractVar[Scalar]
    helix_angle: eqx.AbstractVar[Scalar]
    centre_distance: eqx.AbstractVar[Scalar | None]

    def of_bodies(self, name: str) -> Bodies:
        """One number of both gears, e.g. `of_bodies("profile_shift")`, pinion first."""
        return jnp.stack([getattr(self.pinion, name), getattr(self.wheel, name)])

    @property
    @abc.abstractmethod
    def teeth(self) -> Bodies:
        """Numbers of teeth, as reals [-]."""

    @property
    def thickness_allowances(self) -> Bodies:
        """Tooth thickness allowances, zero where there is none [m]."""
        given = [gear.thickness_allowance for gear in (self.pinion, self.wheel)]
        return jnp.stack([jnp.zeros(()) if one is None else one for one in given])

    @property
    def transverse_module(self) -> Scalar:
        """$m_t$ [m]."""
        return self.normal_module / jnp.cos(self.helix_angle)

    @_derived
    def transverse_pressure_angle(self) -> Scalar:
        r"""$\alpha_t$ at the reference cylinder [rad]."""
        return jnp.arctan(jnp.tan(self.pressure_angle) / jnp.cos(self.helix_angle))

    @_derived
    def base_helix_angle(self) -> Scalar:
        r"""$\beta_b$ [rad], signed as $\beta$."""
        return jnp.arcsin(jnp.sin(self.helix_angle) * jnp.cos(self.pressure_angle))

    @_derived
    def reference_radius(self) -> Bodies:
        """$r$ [m]."""
        return 0.5 * self.transverse_module * self.teeth

    @_derived
    def base_radius(self) -> Bodies:
        """$r_b$ [m]."""
        return self.reference_radius * jnp.cos(self.transverse_pressure_angle)

    @_derived
    def tip_radius(self) -> Bodies:
        """$r_a$ [m]."""
        height = (
            self.of_bodies("addendum")
            + self.of_bodies("profile_shift")
            - self.of_bodies("tip_shortening")
        )
        return self.reference_radius + self.normal_module * height

    @_derived
    def root_radius(self) -> Bodies:
        """$r_f$ [m]."""
        depth = self.of_bodies("dedendum") - self.of_bodies("profile_shift")
        return self.reference_radius - self.normal_module * depth

    @_derived
    def zero_backlash_pressure_angle(self) -> Scalar:
        r"""$\alpha_{wt}$ that the profile shifts give without backlash [rad]."""
        shift = jnp.sum(self.of_bodies("profile_shift"))
        value = involute(self.transverse_pressure_angle)
        value += 2.0 * shift * jnp.tan(self.pressure_angle) / jnp.sum(self.teeth)
        return inverse_involute(value)

    @_derived
    def zero_backlash_centre_distance(self) -> Scalar:
        """Centre distance that the profile shifts give without backlash [m]."""
        return jnp.sum(self.base_radius) / jnp.cos(self.zero_backlash_pressure_angle)

    @_derived
    def working_centre_distance(self) -> Scalar:
        """$a_w$ [m]: the given one, else the zero-backlash one."""
        if self.centre_distance is None:
            return self.zero_backlash_centre_distance
        return self.centre_distance

    @_derived
    def working_pressure_angle(self) -> Scalar:
        r"""$\alpha_{wt}$ [rad]."""
        if self.centre_distance is None:
            return self.zero_backlash_pressure_angle
        return jnp.arccos(jnp.sum(self.base_radius) / self.centre_distance)

    @_derived
    def working_pitch_radius(self) -> Bodies:
        """$r_w$ [m]."""
        return self.working_centre_distance * self.teeth / jnp.sum(self.teeth)

    @_derived
    def transverse_base_pitch(self) -> Scalar:
        """$p_{bt}$ [m]."""
        return jnp.pi * self.transverse_module * jnp.cos(self.transverse_pressure_angle)

    @property
    def face_width(self) -> Scalar:
        """Common face width [m]: mid-faces are aligned, so the smaller of the two."""
        return jnp.minimum(self.pinion.face_width, self.wheel.face_width)

    @_derived
    def tangent_length(self) -> Scalar:
        r"""$T_1T_2 = (r_{b1} + r_{b2})\tan\alpha_{wt}$ between the base tangent points [m]."""
        return jnp.sum(self.base_radius) * jnp.tan(self.working_pressure_angle)

    @_derived
    def tip_roll(self) -> Bodies:
        """Roll length from each gear's own base tangent point to its tip [m]."""
        # A floor of zero keeps an impossible gear finite until it is refused.
        return jnp.sqrt(jnp.maximum(self.tip_radius**2 - self.base_radius**2, 0.0))

    @_derived
    def form_roll(self) -> Bodies:
        r"""Roll length from each gear's own base tangent point to its form circle [m].

        Where the trochoid ends and the involute begins, $r_b \tan\alpha_t - h_{F}/\sin\alpha_t$
        with $h_F$ the depth of the rack's straight flank. Negative: undercut.
        """
        straight = self.of_bodies("dedendum") - self.of_bodies("profile_shift")
        straight -= self.of_bodies("fillet_radius") * (1.0 - jnp.sin(self.pressure_angle))
        angle = self.transverse_pressure_angle
        return self.base_radius * jnp.tan(angle) - self.normal_module * straight / jnp.sin(angle)

    @_derived
    def form_radius(self) -> Bodies:
        """$r_F$, the form circle at the fillet [m]."""
        return jnp.hypot(self.base_radius, self.form_roll)

    @_derived
    def path_start(self) -> Scalar:
        """$T_1A$, start of contact at the wheel's tip [m]."""
        return self.tangent_length - self.tip_roll[1]

    @_derived
    def path_end(self) -> Scalar:
        """$T_1E$, end of contact at the pinion's tip [m]."""
        return self.tip_roll[0]

    @_derived
    def pitch_point(self) -> Scalar:
        r"""$T_1C = r_{b1}\tan\alpha_{wt}$ [m]."""
        return self.base_radius[0] * jnp.tan(self.working_pressure_angle)

    @_derived
    def path_of_contact(self) -> Scalar:
        r"""$g_\alpha = \varepsilon_\alpha p_{bt}$ [m]."""
        return self.path_end - self.path_start

    @_derived
    def root_clearance(self) -> Bodies:
        """Distance from each gear's root to the other's tip [m]."""
        return self.working_centre_distance - self.root_radius - self.tip_radius[::-1]

    @_derived
    def tip_thickness(self) -> Bodies:
        """Transverse tooth thickness at the tip circle [m]."""
        at_tip = jnp.arctan2(self.tip_roll, self.base_radius)
        half = self.half_thickness_at_base - involute(at_tip)
        return 2.0 * self.tip_radius * half

    @_derived
    def half_thickness_at_base(self) -> Bodies:
        """Half the angle of a tooth at the base circle [rad], transverse, without backlash."""
        shift = self.of_bodies("profile_shift")
        arc = 0.5 * jnp.pi + 2.0 * shift * jnp.tan(self.pressure_angle)
        return arc / self.teeth + involute(self.transverse_pressure_angle)

    @_derived
    def backlash(self) -> Scalar:
        """Transverse circumferential backlash at the working pitch circle [m]."""
        angle = self.working_pressure_angle
        half = self.half_thickness_at_base - involute(angle)
        pitch = 2.0 * jnp.pi * self.working_pitch_radius[0] / self.teeth[0]
        return pitch - 2.0 * jnp.sum(self.working_pitch_radius * half)
