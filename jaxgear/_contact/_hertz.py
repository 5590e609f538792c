"""Two flanks that press on each other: the compliance of their contact."""

import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._contact._tooth import HertzContact, contact_modulus
from jaxgear._geometry._pair import GearPair
from jaxgear._types import Reals


@compiled
def hertz_contact(pair: GearPair, roll: Reals) -> HertzContact:
    """The cylinders that touch at given positions, in the normal plane (theory 3.7).

    **Arguments:**

    - `pair`: the gears.
    - `roll`: positions on the path of contact [m].

    **Returns:**

    Their equivalent radius at each position, and their contact modulus.
    """
    radius = roll * (pair.tangent_length - roll) / pair.tangent_length
    return HertzContact(
        radius=radius / jnp.cos(pair.base_helix_angle),
        modulus=contact_modulus(pair.pinion.material, pair.wheel.material),
    )
