"""Functions of the place on the path of contact, by a polynomial through few of its places."""

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._geometry._pair import GearPair
from jaxgear._types import Reals

if TYPE_CHECKING:
    PathValues = Array
    Polynomials = Array
else:
    PathValues = Float[Array, "*quantity node"]
    Polynomials = Float[Array, "degree *place"]

# Degree of the polynomial through the stiffness along the path. Where a load begins to cross
# the tooth below its root chord the stiffness has a kink, within 3e-4 of which it stays;
# elsewhere it is met to 1e-5.
_DEGREE = 32
_ANGLES = np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1)


class PathInterpolant(NamedTuple):
    """From a function's values at few places of the path of contact to those at many.

    Of any number of functions: the polynomials at the places are the same for all.

    **Fields:**

    - `nodes`: the few places, from $T_1$ [m].
    - `polynomials`: Chebyshev's, of all degrees, at the many places [-].
    """

    nodes: Reals
    polynomials: Polynomials

    def __call__(self, values: PathValues) -> Array:
        """Values at the many places, `[*quantity, *place]`, of one or several at the nodes."""
        transform = np.cos(np.outer(np.arange(_DEGREE + 1), _ANGLES)) * 2.0 / (_DEGREE + 1)
        transform[0] *= 0.5
        return jnp.tensordot(values @ jnp.asarray(transform).T, self.polynomials, axes=1)


def path_interpolant(pair: GearPair, roll: Reals) -> PathInterpolant:
    """Lay polynomials over the path of contact.

    **Arguments:**

    - `pair`: the gears.
    - `roll`: the many places, from $T_1$; those beyond the path take the values at its end [m].

    **Returns:**

    What takes values at its nodes to the places.
    """
    start, half = pair.path_start, 0.5 * pair.path_of_contact
    middle = start + half
    # The middle of a cell that is only partly in contact may lie beyond the end of the path.
    x = jnp.clip((roll - middle) / half, -1.0, 1.0)

    def following(carry: tuple[Reals, Reals], _: None):
        last, before = carry
        return (2.0 * x * last - before, last), before

    one = jnp.ones_like(x)
    _, polynomials = jax.lax.scan(following, (x, one), length=_DEGREE + 1)
    return PathInterpolant(middle + half * jnp.asarray(np.cos(_ANGLES)), polynomials)
