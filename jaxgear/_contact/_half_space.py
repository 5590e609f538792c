r"""Cells of a line of contact on an elastic half-space.

A force lowers the surface of a half-space at a distance $r$ by $(1-\nu^2)/(\pi E r)$ (Boussinesq).
Means of it over two rectangles have a closed form. Mirror images at the faces of the gear stand for
its free ends.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgear._geometry._gear import Material
from jaxgear._types import Reals, Scalar, Slices


def cells_on_half_space(
    material: Material,
    half_width: Scalar,
    length: Scalar,
    place: Slices,
    ends: tuple[Scalar, Scalar],
) -> Float[Array, "slice slice"]:
    """Compliance between cells of one line of contact.

    **Arguments:**

    - `material`: of the half-space.
    - `half_width`: over which the load of every cell is spread evenly, and its motion averaged [m].
    - `length`: of a cell along the line [m].
    - `place`: middles of the cells along the line [m].
    - `ends`: of the gear along the line, lower first [m].

    **Returns:**

    Mean motion of each cell by a force on each [m/N].
    """
    apart = place[:, None] - place[None, :]
    both = place[:, None] + place[None, :]
    total = _mean_of_rectangles(apart, length, half_width)
    for end in ends:
        total += _mean_of_rectangles(both - 2.0 * end, length, half_width)
    return (1.0 - material.poisson**2) / (jnp.pi * material.young) * total


def _mean_of_rectangles(apart: Reals, length: Scalar, half_width: Scalar) -> Reals:
    """Mean of 1/r between equal rectangles, `apart` along their lengths [1/m]."""
    width = 2.0 * half_width
    total = jnp.zeros_like(apart)
    for step, sign in ((length, 1.0), (0.0, -2.0), (-length, 1.0)):
        along = apart + step
        across = _fourth_integral(along, width) - _fourth_integral(along, 0.0 * width)
        total += 2.0 * sign * across
    return total / (length * width) ** 2


def _fourth_integral(x: Reals, y: Scalar) -> Reals:
    """What gives 1/r when differentiated twice by each of two coordinates; even in both [m3]."""
    distance = jnp.sqrt(x**2 + y**2)
    flat = jnp.abs(x) <= 1e-12 * (jnp.abs(y) + jnp.max(jnp.abs(x)))
    safe = jnp.where(flat, 1.0, jnp.abs(x))
    tall = jnp.where(jnp.abs(y) > 0.0, y, 1.0)
    first = jnp.where(flat, 0.0, 0.5 * x**2 * y * jnp.arcsinh(y / safe))
    second = 0.5 * x * y**2 * jnp.arcsinh(x / tall)
    return first + second - distance**3 / 6.0
