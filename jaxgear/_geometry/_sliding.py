r"""How nominal flanks slide on each other along the path of contact.

At a distance $s - T_1C$ from the pitch point flanks of parallel gears slide at
$(\omega_1 + \omega_2)$ times that distance, spur and helical alike: the gears turn against each
other about the pitch axis, and what slides has no part along the axes. Positive where the pinion's
flank is the faster one, behind the pitch point (recess). Formulas: ISO 21771-1, sliding conditions
at the tooth flanks.
"""

import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._compiled import compiled, in_numpy
from jaxgear._geometry._pair import GearPair, pair_facts
from jaxgear._types import Reals, Scalar


@compiled
def sliding_speed(pair: GearPair, roll: Reals, pinion_speed: Scalar) -> Reals:
    r"""Speed at which the pinion's flank slides on the wheel's (theory 1.8).

    $v_g = \omega_1\,(1 + z_1/z_2)\,(s - T_1C)$.

    **Arguments:**

    - `pair`: the gears.
    - `roll`: places on the path of contact, from $T_1$ [m].
    - `pinion_speed`: $\omega_1$ [rad/s].

    **Returns:**

    Sliding speed [m/s]; negative before the pitch point, zero there.
    """
    return pinion_speed * _turning(pair) * (roll - pair.pitch_point)


@compiled
def specific_sliding(pair: GearPair, roll: Reals) -> Reals:
    r"""Sliding over the speed at which contact rolls along each flank (theory 1.8).

    $\zeta_1 = 1 - \frac{z_1}{z_2}\frac{T_1T_2 - s}{s}$, and $\zeta_2$ with the gears changed over.
    It falls without limit towards a gear's base tangent point: where it is most negative, below
    the pitch circle, flanks wear and pit first.

    **Arguments:**

    - `pair`: the gears.
    - `roll`: places on the path of contact, between the base tangent points, from $T_1$ [m].

    **Returns:**

    Specific sliding of pinion and wheel, stacked before the axes of `roll` [-].
    """
    ratio = pair.pinion.teeth / pair.wheel.teeth
    other = pair.tangent_length - roll
    return jnp.stack([1.0 - ratio * other / roll, 1.0 - roll / (ratio * other)])


def tooth_loss_factor(pair: GearPair) -> Scalar:
    r"""Mean power lost in a mesh with even load over coefficient of friction and power, $H_V$.

    $\frac{\pi(u + 1)}{z_1 u \cos\beta_b}
    (1 - \varepsilon_\alpha + \varepsilon_1^2 + \varepsilon_2^2)$ with $\varepsilon_1$,
    $\varepsilon_2$ the parts of the contact ratio behind and before the pitch point (Ohlendorf;
    Niemann and Winter, Maschinenelemente 2; ISO/TR 14179-2). Two pairs in contact carry half of
    the load each. What flanks with reliefs on bodies that deflect lose is `mesh_loss_factor`.

    **Arguments:**

    - `pair`: the gears, one or two pairs of which are in contact in each transverse section.

    **Returns:**

    $H_V$ [-].

    **Raises:**

    - `ValueError` if the profile contact ratio is not between 1 and 2.
    """
    ratio = in_numpy(pair_facts(pair).profile_contact_ratio)
    require(
        (ratio >= 1.0) & (ratio <= 2.0),
        "`tooth_loss_factor` is for one or two pairs in contact, a profile contact ratio between 1 "
        "and 2, got {got:.4g}. Use `mesh_loss_factor` of a solved mesh cycle.",
        got=ratio,
    )
    return _tooth_loss_factor(pair)


@compiled
def _tooth_loss_factor(pair: GearPair) -> Scalar:
    pitch = pair.transverse_base_pitch
    recess, approach = pair.path_end - pair.pitch_point, pair.pitch_point - pair.path_start
    recess, approach = recess / pitch, approach / pitch
    evenly = 1.0 - recess - approach + recess**2 + approach**2
    return jnp.pi / pair.pinion.teeth * _turning(pair) * evenly / jnp.cos(pair.base_helix_angle)


def _turning(pair: GearPair) -> float:
    """Speed of the gears against each other over the pinion's, 1 + 1/u [-]."""
    return 1.0 + pair.pinion.teeth / pair.wheel.teeth
