"""Loads of rotation and heat on the seats of condensed bodies, among those of a structure."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgear._system._flexible import condensed
from jaxgear._system._gear_body import AbstractGearBody
from jaxgear._types import Scalar


def seat_loads(
    bodies: tuple[AbstractGearBody, AbstractGearBody],
    loaded: tuple[tuple[int, ...], tuple[int, ...]],
    size: int,
    speed: Scalar,
    ratio: Scalar,
) -> Float[Array, " dof"]:
    """Loads of rotation and heat on the seats of condensed bodies.

    **Arguments:**

    - `bodies`: of pinion and wheel.
    - `loaded`: first degree of freedom of each of their nodes.
    - `size`: number of degrees of freedom.
    - `speed`: of the pinion [rad/s].
    - `ratio`: of the teeth, wheel over pinion [-].

    **Returns:**

    Loads on all degrees of freedom [N, N m].
    """
    load = jnp.zeros(size)
    for index, body in condensed(bodies):
        first, own = loaded[index][0], (speed, speed / ratio)[index]
        total = own**2 * body.seat_load
        if body.heat is not None:
            total = total + body.heat.seat_load
        load = load.at[first : first + body.seat_load.size].add(total)
    return load
