"""Functions of the place on the path of contact, by a polynomial through few of its places."""

from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._geometry._pair import GearPair
from jaxgear._types import Reals

if TYPE_CHECKING:
    PathValues = Array
else:
    PathValues = Float[Array, "*quantity node"]

# Degree of the polynomial through the stiffness along the path. Where a load begins to cross
# the tooth below its root chord the stiffness has a kink, within 3e-4 of which it stays;
# elsewhere it is met to 1e-5.
_DEGREE = 32


def path_nodes(pair: GearPair) -> Reals:
    """Places on the path of contact through which the polynomial is laid, from $T_1$ [m].

    **Arguments:**

    - `pair`: the gears.
    """
    nodes = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    middle = 0.5 * (pair.path_start + pair.path_end)
    return middle + 0.5 * pair.path_of_contact * jnp.asarray(nodes)


def along_path(pair: GearPair, values: PathValues, roll: Reals) -> Reals:
    """Values at many places, by Chebyshev's interpolant over the path of contact.

    **Arguments:**

    - `pair`: the gears.
    - `values`: of one or several quantities at `path_nodes`, in any unit.
    - `roll`: places from $T_1$; those beyond the path take the values at its end [m].

    **Returns:**

    For each quantity, its values at all places, in its unit.
    """
    nodes = np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1)
    transform = np.cos(np.outer(np.arange(_DEGREE + 1), nodes)) * 2.0 / (_DEGREE + 1)
    transform[0] *= 0.5
    coefficients = values @ jnp.asarray(transform).T
    middle = 0.5 * (pair.path_start + pair.path_end)
    # The middle of a cell that is only partly in contact may lie beyond the end of the path.
    x = jnp.clip((roll - middle) / (0.5 * pair.path_of_contact), -1.0, 1.0)

    def following(carry: tuple[Reals, Reals], _: None):
        last, before = carry
        return (2.0 * x * last - before, last), last

    # Polynomials first, by their recurrence: they are the same for all quantities.
    _, polynomials = jax.lax.scan(following, (x, jnp.ones_like(x)), length=_DEGREE)
    rest = jnp.tensordot(coefficients[..., 1:], polynomials, axes=1)
    return rest + coefficients[..., :1].reshape(*coefficients.shape[:-1], *[1] * roll.ndim)
