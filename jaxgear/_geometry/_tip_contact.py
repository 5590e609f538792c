r"""How far the flanks are apart beyond the ends of the path of contact.

Nominal flanks touch on the line of action, from the wheel's tip to the pinion's. Before the first
point and behind the last one the tip corner of one gear faces the other's flank, off the line of
action, across a gap that grows from nothing: teeth that bend close it, and meet too early or part
too late (the pressure peaks that the thesis names, but leaves out, at its Fig. III-33).

The gap is the approach that brings corner and flank into touch when the gear of the corner stands
where it should and the other one turns. Had the other one stayed, it would be larger in the ratio
$1 + g'$, with $g'$ its slope along the path; the force at the corner, which is normal to the flank
that it meets, has on the corner's own gear an arm shorter in the ratio $1 - g'$.
"""

import jax.numpy as jnp

from jaxgear._geometry._pair import GearPair
from jaxgear._types import Reals, Scalar


def tip_separation(pair: GearPair, roll: Reals) -> Reals:
    r"""Gap between a tip corner and the flank it faces, beyond the ends of the path of contact.

    A distance $s$ beyond the end it is $\frac{T_1T_2\,\rho_a}{2 r_b^2\rho}s^2\cos\beta_b$ to the
    leading order, with $\rho_a$ and $r_b$ the tip's roll length and the base radius of the
    corner's gear, and $\rho = T_1T_2 - \rho_a$ the roll length on the other. Each transverse
    section is on its own. The flank is continued as an involute to any radius that the corner
    reaches: not seen are its own tip, edge breaks and the teeth next to it.

    **Arguments:**

    - `pair`: the gears.
    - `roll`: place on the path of contact, or on its continuation, from $T_1$ [m].

    **Returns:**

    Gap normal to the flank [m]; exactly zero, and so is its slope, between the ends of the path.
    """
    base, tip = pair.base_radius, pair.tip_roll
    early = _corner_gap(pair.path_start - roll, tip[1], base[1], base[0], pair.tangent_length)
    late = _corner_gap(roll - pair.path_end, tip[0], base[0], base[1], pair.tangent_length)
    return (early + late) * jnp.cos(pair.base_helix_angle)


def _corner_gap(
    beyond: Reals, tip_roll: Scalar, own_base: Scalar, other_base: Scalar, tangent: Scalar
) -> Reals:
    """Transverse gap at a tip corner that is short of the end of the path; zero past it.

    **Arguments:**

    - `beyond`: by how much the corner is short of the line of action [m].
    - `tip_roll`: of the corner's gear, at its tip [m].
    - `own_base`: base radius of the corner's gear [m].
    - `other_base`: base radius of the gear whose flank the corner faces [m].
    - `tangent`: length between the base tangent points [m].

    **Returns:**

    Angle by which the other gear is behind, times its base radius [m].
    """
    outside = beyond > 0.0
    turn = jnp.where(outside, beyond, 0.0) / own_base
    # The corner, from the other gear's centre: along the line of action, and square to it.
    sine, versine = jnp.sin(turn), 2.0 * jnp.sin(0.5 * turn) ** 2
    along = tangent - tip_roll + tip_roll * versine - own_base * sine
    across = other_base + own_base * versine + tip_roll * sine
    # Below its base circle, where only gears that interfere have their corners, a flank is radial.
    square = along**2 + across**2 - other_base**2
    reaches = outside & (square > 0.0)
    roll = jnp.where(reaches, jnp.sqrt(jnp.where(reaches, square, 1.0)), 0.0)
    angle = jnp.arctan2(along, across) - jnp.arctan2(roll, other_base)
    gap = other_base * angle + roll + beyond - (tangent - tip_roll)
    return jnp.where(outside, gap, 0.0)
