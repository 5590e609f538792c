r"""The elastic body under the axial loads of helical teeth: a ring sheared, and bent as a plate.

Like `ring_influence` for loads along the axis. Lengths are in units of the root radius and every
influence is displacement times $E b$ over load, a pure number. Along the axis a ring that is
clamped at its bore gives way in shear, as $r^{\pm n}$ by orders around it, and as a plate of
the thickness of its face: the classical solutions $r^{\pm n}, r^{2 \pm n}$ (Clebsch; Timoshenko
and Woinowsky-Krieger 1959, art. 62).
"""

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._types import PlateInfluence, Scalar, ShearInfluence

if TYPE_CHECKING:
    Plates = Array
else:
    Plates = Float[Array, "order displacement resultant"]

# Last order around the plate: what its orders give falls as their third power, and under couples
# as the load's own spread.
_PLATE_ORDERS = 48


def shear_influence(
    *,
    radius_ratio: Scalar,
    root_half_angle: Scalar,
    poisson: Scalar,
    pitch_angle: Scalar,
    neighbours: int,
    harmonics: int,
) -> ShearInfluence:
    r"""What an axial load at one tooth's root shears the roots of it and its neighbours by.

    $\frac{2(1+\nu)}{\pi}\bigl[\tfrac12\ln h + \sum_n \frac{\tanh(n\ln h)}{n}\,
    \mathrm{sinc}^2(n\theta_f)\cos n\Delta\theta\bigr]$, even along the face.

    **Arguments:**

    - `radius_ratio`, `root_half_angle`, `poisson`, `pitch_angle`, `neighbours`, `harmonics`: as of
        `ring_influence`.

    **Returns:**

    Displacement times $E b$ over load [-], for the teeth at 0, 1 ... `neighbours` pitches.
    """
    orders = jnp.asarray(np.arange(1.0, harmonics + 1.0))
    depth = jnp.log(radius_ratio)
    each = jnp.tanh(orders * depth) / orders * jnp.sinc(orders * root_half_angle / jnp.pi) ** 2
    turn = pitch_angle * jnp.asarray(np.arange(neighbours + 1.0))
    total = 0.5 * depth + jnp.cos(turn[:, None] * orders[None]) @ each
    return (2.0 * (1.0 + poisson) / jnp.pi * total)[:, None, None]


def plate_influence(
    *,
    radius_ratio: Scalar,
    root_half_angle: Scalar,
    poisson: Scalar,
    pitch_angle: Scalar,
    neighbours: int,
    thickness: Scalar,
) -> PlateInfluence:
    r"""What an axial load at one tooth's root bends the roots of it and its neighbours by.

    Kirchhoff's plate, clamped at the bore and free at the rim. The resultants are the load $Z$ and
    its couples over the root radius, which tip the rim outwards and along the circumference;
    displacements are $w$, $r_f\,\partial w/\partial r$ and $\partial w/\partial\theta$. A plate
    sees no load that is narrower than it is thick, so that the load's arc is no shorter than the
    face is wide.

    **Arguments:**

    - `radius_ratio`, `root_half_angle`, `poisson`, `pitch_angle`, `neighbours`: as of
        `ring_influence`.
    - `thickness`: $b$, over the root radius [-].

    **Returns:**

    Displacement times $E b$ over load [-], for the teeth at 0, 1 ... `neighbours` pitches.
    """
    orders = np.arange(_PLATE_ORDERS + 1.0)
    half = jnp.hypot(root_half_angle, 0.5 * thickness)
    each = _plate_receptances(radius_ratio, poisson)
    each *= (jnp.sinc(jnp.asarray(orders) * half / jnp.pi) ** 2)[:, None, None]
    each *= jnp.asarray(np.where(orders == 0.0, 0.5, 1.0))[:, None, None]
    turn = pitch_angle * jnp.asarray(np.arange(neighbours + 1.0))
    turns = turn[:, None] * jnp.asarray(orders)[None]
    even = jnp.einsum("kn,nij->kij", jnp.cos(turns), each)
    odd = jnp.einsum("kn,ni->ki", jnp.sin(turns) * jnp.asarray(orders)[None], each[:, 0])
    round_ = jnp.einsum("kn,n->k", jnp.cos(turns) * jnp.asarray(orders**2)[None], each[:, 0, 0])
    total = jnp.concatenate([even, -odd[:, None]], axis=1)
    last = jnp.concatenate([odd, round_[:, None]], axis=1)
    total = jnp.concatenate([total, last[:, :, None]], axis=2)
    return 12.0 * (1.0 - poisson**2) / (jnp.pi * thickness**2) * total


def _plate_receptances(radius_ratio: Scalar, poisson: Scalar) -> Plates:
    """Deflection and slope of the rim by force and couple for each order, of stiffness one."""
    bore, rim = 1.0 / radius_ratio, jnp.ones(())
    at_bore, at_rim = _solutions(bore, bore), _solutions(rim, bore)
    w, slope, second, third = at_rim
    squared = jnp.asarray(np.arange(_PLATE_ORDERS + 1.0))[:, None] ** 2
    couple = second + poisson * (slope - squared * w)
    force = third + second - slope - squared * (slope - 2.0 * w)
    force -= (1.0 - poisson) * squared * (slope - w)
    rows = jnp.stack([at_bore[0], at_bore[1], couple, force], axis=1)
    loads = jnp.asarray(np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]))
    found = jnp.linalg.solve(rows, jnp.broadcast_to(loads, (rows.shape[0], 4, 2)))
    return jnp.stack([w, slope], axis=1) @ found


def _solutions(r: Scalar, bore: Scalar) -> Array:
    """The four solutions of each order and three derivatives, `[derivative, order, solution]`.

    Falling ones are scaled at the bore: no power overflows.
    """
    none, one, log = jnp.zeros_like(r), jnp.ones_like(r), jnp.log(r)
    even = [
        [one, none, none, none],
        [log, 1.0 / r, -1.0 / r**2, 2.0 / r**3],
        [r**2, 2.0 * r, 2.0 * one, none],
        [r**2 * log, 2.0 * r * log + r, 2.0 * log + 3.0, 2.0 / r],
    ]
    first = [
        [r, one, none, none],
        [1.0 / r, -1.0 / r**2, 2.0 / r**3, -6.0 / r**4],
        [r**3, 3.0 * r**2, 6.0 * r, 6.0 * one],
        [r * log, log + 1.0, 1.0 / r, -1.0 / r**2],
    ]
    special = jnp.stack([jnp.stack([jnp.stack(each) for each in kind]) for kind in (even, first)])
    n = np.arange(2.0, _PLATE_ORDERS + 1.0)
    powers = jnp.asarray(np.stack([n, -n, n + 2.0, 2.0 - n], axis=1))
    scale = jnp.stack([one, bore, one, bore])
    value = (r / scale)[None] ** powers
    slope = value * powers / r
    second = slope * (powers - 1.0) / r
    third = second * (powers - 2.0) / r
    rest = jnp.stack([value, slope, second, third], axis=-1)
    return jnp.moveaxis(jnp.concatenate([special, rest]), -1, 0)
