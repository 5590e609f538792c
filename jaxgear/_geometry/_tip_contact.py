r"""How far the flanks are apart beyond the ends of the path of contact.

Nominal flanks touch on the line of action, from the wheel's tip to the pinion's. Before the first
point and behind the last one the tip corner of one gear faces the other's flank, off the line of
action, across a gap that grows from nothing: teeth that bend close it, and meet too early or part
too late (the pressure peaks that the thesis names, but leaves out, at its Fig. III-33).

The gap is the approach that brings corner and flank into touch when the gear of the corner stands
where it should and the other one turns. Had the other one stayed, it would be larger in the ratio
$1 + g'$, with $g'$ its slope along the path; the force at the corner, which is normal to the flank
that it meets, has on the corner's own gear an arm shorter in the ratio $1 - g'$. The solver leaves
that out: it keeps the arm of the line of action for both gears. Of the accessory pair (Guilbert
2017, tab. III-1) $g'$ is 3 % where the corner is 0.8 mm beyond the path.

The place of touch leaves the line of action too. On the corner's gear it stays at the tip; on the
other one it turns round at the start of active profile and moves up the flank again.
"""

import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._compiled import compiled
from jaxgear._geometry._pair import GearPair
from jaxgear._types import Reals

# Of the length between the base tangent points: what rounding makes of a place on the path [-].
_ROUNDING = 1e-13


@compiled
def tip_separation(pair: GearPair, roll: Reals) -> Reals:
    r"""Gap between a tip corner and the flank it faces, beyond the ends of the path of contact.

    A distance $s$ beyond the end it is $\frac{T_1T_2\,\rho_a}{2 r_b^2\rho}s^2\cos\beta_b$ to the
    leading order, with $\rho_a$ and $r_b$ the tip's roll length and the base radius of the
    corner's gear, and $\rho = T_1T_2 - \rho_a$ the roll length on the other. Each transverse
    section is on its own. The flank is continued as an involute to any radius that the corner
    reaches: not seen are its own tip, edge breaks and the teeth next to it (theory 1.15).

    **Arguments:**

    - `pair`: the gears.
    - `roll`: place on the path of contact, or on its continuation, from $T_1$ [m].

    **Returns:**

    Gap normal to the flank [m]; exactly zero, and so is its slope, between the ends of the path.
    """
    early, _ = _corner_on_flank(pair, 1, pair.path_start - roll)
    late, _ = _corner_on_flank(pair, 0, roll - pair.path_end)
    return (early + late) * jnp.cos(pair.base_helix_angle)


@compiled
def tip_contact_rolls(pair: GearPair, roll: Reals) -> tuple[Reals, Reals]:
    r"""Where the flanks touch, on each gear's own flank.

    On the path both places are those of the line of action. A distance $s$ beyond the end the
    corner's gear touches at its tip, and the other one at
    $\rho + \left(\frac{r_{b,o}\,\rho_a}{r_b\,\rho} - 1\right)s$ to the first order, in the terms of
    `tip_separation` and with $r_{b,o}$ the base radius of the other gear: above its start of
    active profile, if only the corner lies outside its own working pitch circle. The slope along
    the path jumps at either end, the place does not.

    **Arguments:**

    - `pair`: the gears.
    - `roll`: place on the path of contact, or on its continuation, from $T_1$ [m].

    **Returns:**

    Roll length of the touching point on the pinion, from $T_1$, and on the wheel, from $T_2$ [m].
    """
    early, late = pair.path_start - roll, roll - pair.path_end
    _, under_wheel_tip = _corner_on_flank(pair, 1, early)
    _, under_pinion_tip = _corner_on_flank(pair, 0, late)
    # Not by a minimum: at a tie its slope would be half of each side's.
    before, after = _is_outside(pair, early), _is_outside(pair, late)
    pinion = jnp.where(after, pair.tip_roll[0], roll)
    wheel = jnp.where(before, pair.tip_roll[1], pair.tangent_length - roll)
    pinion = jnp.where(before, under_wheel_tip, pinion)
    return pinion, jnp.where(after, under_pinion_tip, wheel)


def _is_outside(pair: GearPair, beyond: Reals) -> Array:
    """Whether a place is beyond an end of the path, by more than rounding.

    Each loop that XLA makes of a program may round the distance in its own way: at the very end one
    would take the corner's place, the next its absence.
    """
    return beyond > _ROUNDING * pair.tangent_length


def _corner_on_flank(pair: GearPair, body: int, beyond: Reals) -> tuple[Reals, Reals]:
    """Transverse gap at a gear's tip corner that is short of the end of the path, and its place.

    **Arguments:**

    - `pair`: the gears.
    - `body`: whose corner it is.
    - `beyond`: by how much the corner is short of the line of action [m].

    **Returns:**

    Angle by which the other gear is behind, times its base radius [m], and the roll length at
    which the corner meets that gear's flank [m]. Past the end of the path the gap is zero, and the
    roll length that of the end.
    """
    own_base, other_base = pair.base_radius[body], pair.base_radius[1 - body]
    tip_roll, tangent = pair.tip_roll[body], pair.tangent_length
    outside = _is_outside(pair, beyond)
    turn = jnp.where(outside, beyond, 0.0) / own_base
    # The corner, from the other gear's centre: along the line of action, and square to it.
    sine, versine = jnp.sin(turn), 2.0 * jnp.sin(0.5 * turn) ** 2
    along = tangent - tip_roll + tip_roll * versine - own_base * sine
    rise = own_base * versine + tip_roll * sine
    across = other_base + rise
    # Below its base circle, where only gears that interfere have their corners, a flank is radial.
    square = along**2 + rise * (other_base + across)
    reaches = outside & (square > 0.0)
    roll = jnp.where(reaches, jnp.sqrt(jnp.where(reaches, square, 1.0)), 0.0)
    angle = jnp.arctan2(along, across) - jnp.arctan2(roll, other_base)
    gap = other_base * angle + roll + beyond - (tangent - tip_roll)
    return jnp.where(outside, gap, 0.0), jnp.where(outside, roll, tangent - tip_roll)
