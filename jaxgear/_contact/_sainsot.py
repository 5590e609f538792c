"""The polynomial that Sainsot, Velex & Duverger 2004 fitted to the ring."""

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._contact._tooth import tooth_load
from jaxgear._geometry._gear import Material
from jaxgear._geometry._profile import ToothSection
from jaxgear._types import Reals, Scalar

if TYPE_CHECKING:
    Sainsot = Array
else:
    Sainsot = Float[Array, "coefficient"]

SAINSOT_RADIUS_RATIO = (1.4, 7.0)
"""Range of $h$ for which Sainsot's polynomial was fitted [-]; poor below 2, against the ring."""

SAINSOT_ROOT_HALF_ANGLE = (0.01, 0.12)
r"""Range of $\theta_f$ for which Sainsot's polynomial was fitted [rad]."""

# Columns A to F of Sainsot et al. 2004, J. Mech. Des. 126(4); rows L*, M*, P*, Q*.
_SAINSOT = np.array(
    [
        [-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045],
        [60.111e-5, 28.100e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086],
        [-50.952e-5, 185.50e-3, 0.0538e-4, 53.300e-3, 0.2895, 0.9236],
        [-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904],
    ]
)


def sainsot_coefficients(radius_ratio: Scalar, root_half_angle: Scalar) -> Sainsot:
    r"""$L^*, M^*, P^*, Q^*$ of Sainsot, Velex & Duverger 2004, for $\nu = 0.3$ only.

    $A/\theta_f^2 + Bh^2 + Ch/\theta_f + D/\theta_f + Eh + F$, valid within
    `SAINSOT_RADIUS_RATIO` and `SAINSOT_ROOT_HALF_ANGLE`; not checked.

    **Arguments:**

    - `radius_ratio`: $h$, root radius over bore radius [-].
    - `root_half_angle`: $\theta_f$ [rad].

    **Returns:**

    The four coefficients [-].
    """
    h, slender = radius_ratio, 1.0 / root_half_angle
    terms = jnp.stack([slender**2, h**2, h * slender, slender, h, jnp.ones_like(h)])
    return jnp.asarray(_SAINSOT) @ terms


def sainsot_compliance(
    section: ToothSection, material: Material, radius_ratio: Scalar, roll_angle: Reals
) -> Reals:
    r"""Compliance of the body under one tooth by Sainsot's polynomial.

    $\frac{\cos^2\alpha_p}{E}[L^*(u/S_f)^2 + M^* u/S_f + P^*(1 + Q^*\tan^2\alpha_p)]$ with
    $u = Y_c - r_f$ and $S_f = 2r_f\theta_f$. Only for $\nu = 0.3$: the material's own ratio is not
    used. The wind-up of the body, which all teeth share, is in it: one tooth pair at a time.

    **Arguments:**

    - `section`: the tooth.
    - `material`: of the body.
    - `radius_ratio`: $h$, root radius over bore radius [-].
    - `roll_angle`: of the loaded points [rad].

    **Returns:**

    Compliance at each point [m2/N].
    """
    load = tooth_load(section, roll_angle)
    bend, mixed, press, side = sainsot_coefficients(radius_ratio, section.root_half_angle)
    root_chord = 2.0 * section.root_radius * section.root_half_angle
    slender = (load.height - section.root_radius) / root_chord
    inner = bend * slender**2 + mixed * slender
    inner += press * (1.0 + side * jnp.tan(load.angle) ** 2)
    return jnp.cos(load.angle) ** 2 / material.young * inner
