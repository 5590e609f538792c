r"""A gear pair: two gears at a working centre distance, and everything closed-form about it.

Subscript $t$ is the transverse section, $n$ the normal one, $w$ the working pitch
cylinder. Quantities of both gears carry the axis `body`: pinion, wheel. Positions along
the line of action are roll lengths from the pinion's base tangent point $T_1$; with the
pinion driving, contact runs from `path_start` (the wheel's tip) to `path_end`
(the pinion's tip). Formulas: ISO 21771-1, unless said.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._geometry._gear import Gear
from jaxgear._geometry._involute import inverse_involute, involute
from jaxgear._geometry._pair_facts import PairFacts
from jaxgear._geometry._tooth_checks import check_tooth
from jaxgear._types import Bodies, Scalar, as_optional_scalar, as_scalar
from jaxgear._units import deg, mm


def _derived(function: Callable[[Any], Array]) -> property:
    """A property that is traced once for each kind of pair: a program asks for lengths often.

    Outside of programs it is one program, and not one for each of its operations.
    """
    return property(jax.jit(function))


class GearPair(eqx.Module):
    r"""Two external involute gears, spur or helical, in mesh (theory 1.1 to theory 1.6).

    **Fields:**

    - `pinion`: the driving gear.
    - `wheel`: the driven gear.
    - `normal_module`: $m_n$ [m].
    - `pressure_angle`: normal pressure angle $\alpha_n$ [rad].
    - `helix_angle`: $\beta$ at the reference cylinder [rad]; positive is a right-hand pinion.
    - `centre_distance`: working centre distance [m], or `None` for the zero-backlash one that
        follows from the profile shifts.

    **Raises:**

    - `ValueError` if the pair is impossible: no working pressure angle, teeth that jam, are
        pointed, undercut, interfere or bottom, or a total contact ratio below 1.
    """

    pinion: Gear
    wheel: Gear
    normal_module: Scalar = eqx.field(converter=as_scalar)
    pressure_angle: Scalar = eqx.field(converter=as_scalar, default=20.0 * deg)
    helix_angle: Scalar = eqx.field(converter=as_scalar, default=0.0)
    centre_distance: Scalar | None = eqx.field(converter=as_optional_scalar, default=None)

    def __check_init__(self):
        _check_pair(self)

    def of_bodies(self, name: str) -> Bodies:
        """One number of both gears, e.g. `of_bodies("profile_shift")`, pinion first."""
        return jnp.stack([getattr(self.pinion, name), getattr(self.wheel, name)])

    @property
    def teeth(self) -> Bodies:
        """Numbers of teeth, as reals [-]."""
        return jnp.asarray([self.pinion.teeth, self.wheel.teeth], dtype=float)

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


@compiled
def profile_contact_ratio(pair: GearPair) -> Scalar:
    r"""$\varepsilon_\alpha$ [-]: the path of contact over the transverse base pitch."""
    return pair.path_of_contact / pair.transverse_base_pitch


@compiled
def overlap_ratio(pair: GearPair) -> Scalar:
    r"""$\varepsilon_\beta$ [-]: $b \tan|\beta_b| / p_{bt}$ (theory 1.7)."""
    tangent = jnp.tan(jnp.abs(pair.base_helix_angle))
    return pair.face_width * tangent / pair.transverse_base_pitch


@compiled
def total_contact_ratio(pair: GearPair) -> Scalar:
    r"""$\varepsilon_\gamma = \varepsilon_\alpha + \varepsilon_\beta$ [-] (theory 1.7)."""
    return profile_contact_ratio(pair) + overlap_ratio(pair)


@compiled
def full_tip_shortening(pair: GearPair) -> Scalar:
    r"""$k = x_1 + x_2 - y$ [-], the shortening that restores the rack's root clearance."""
    centre = pair.working_centre_distance - jnp.sum(pair.reference_radius)
    return jnp.sum(pair.of_bodies("profile_shift")) - centre / pair.normal_module


@compiled
def pair_facts(pair: GearPair) -> PairFacts:
    """Everything closed-form about a pair at once, compiled: for reports and checks.

    **Arguments:**

    - `pair`: the gears.

    **Returns:**

    Its facts.
    """
    ratios = (profile_contact_ratio, overlap_ratio, total_contact_ratio, full_tip_shortening)
    found = {ratio.__name__: ratio(pair) for ratio in ratios}
    own = {name: getattr(pair, name) for name in PairFacts._fields if name not in found}
    return PairFacts(**own, **found)


@compiled
def root_radii(pair: GearPair) -> Bodies:
    """The root radii of a pair by themselves, compiled: what a body needs to be built [m]."""
    return pair.root_radius


# How far inside the zero-backlash centre distance a pair may sit, as backlash over module:
# profile shifts on drawings are rounded to 1e-3 of the module.
_ROUNDED_SHIFT = 5e-3


def _check_pair(pair: GearPair) -> None:
    """Refuse what cannot run, in the order in which a designer would find out.

    Traced numbers are let through.
    """
    if any(isinstance(number, Tracer) for number in jax.tree.leaves(pair)):
        return
    module, pressure = float(pair.normal_module), float(pair.pressure_angle)
    require(module > 0.0, "The normal module must be positive, got {got:.6g} mm.", got=module / mm)
    require(
        0.0 < pressure < 45.0 * deg,
        "`GearPair.pressure_angle` must lie between 0 and 45 degrees, got {got:.4g} degrees. "
        "Angles are in radians: write `20.0 * jaxgear.deg`.",
        got=pressure / deg,
    )
    helix = float(pair.helix_angle)
    require(
        abs(helix) < 60.0 * deg,
        "`GearPair.helix_angle` must lie within 60 degrees, got {got:.4g} degrees. Angles are in "
        "radians: write `15.0 * jaxgear.deg`.",
        got=helix / deg,
    )
    facts = pair_facts(pair)
    # Plain numbers within somebody else's program.
    if any(isinstance(fact, Tracer) for fact in facts):
        return
    facts = jax.tree.map(np.asarray, facts)
    base_sum = facts.base_radius.sum()
    # The inverse involute has no answer below zero.
    angle = facts.zero_backlash_pressure_angle
    require(
        bool(np.isfinite(angle) and angle > 0.0),
        "The profile shifts sum to {got:.4g}, too negative for {teeth} teeth to have a working "
        "pressure angle without backlash. Raise them.",
        got=float(pair.pinion.profile_shift) + float(pair.wheel.profile_shift),
        teeth=pair.pinion.teeth + pair.wheel.teeth,
    )
    require(
        bool(facts.working_centre_distance > base_sum),
        "The centre distance must exceed the sum of the base radii, {limit:.6g} mm, or the gears "
        "have no line of action; got {got:.6g} mm. These profile shifts ask for {asked:.6g} mm.",
        got=facts.working_centre_distance / mm,
        limit=base_sum / mm,
        asked=facts.zero_backlash_centre_distance / mm,
    )
    require(
        bool(facts.backlash > -_ROUNDED_SHIFT * module),
        "The teeth jam: at the centre distance of {got:.6g} mm the backlash is {backlash:.4g} mm. "
        "Use {asked:.6g} mm or more, or lower the profile shifts.",
        got=facts.working_centre_distance / mm,
        backlash=facts.backlash / mm,
        asked=facts.zero_backlash_centre_distance / mm,
    )
    require(
        bool(facts.path_of_contact > 0.0 and facts.total_contact_ratio >= 1.0),
        "The total contact ratio must be at least 1, got {got:.4g} (profile {profile:.4g} + "
        "overlap {overlap:.4g}): the mesh would lose contact between teeth. Raise the addendum, "
        "reduce the centre distance or tip shortening, or widen a helical face.",
        got=facts.total_contact_ratio,
        profile=facts.profile_contact_ratio,
        overlap=facts.overlap_ratio,
    )
    for body in (0, 1):
        check_tooth((pair.pinion, pair.wheel), facts, body, module=module, pressure_angle=pressure)
