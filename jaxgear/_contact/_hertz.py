"""Two flanks that press on each other: the compliance of their contact."""

import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._contact._tooth import HertzContact, contact_modulus
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._tip_contact import tip_contact_rolls
from jaxgear._types import Marks, Reals


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


@compiled
def corner_contact(pair: GearPair, roll: Reals) -> HertzContact:
    r"""The cylinders that touch, with the rounding of a tip corner beyond the path (theory 3.14).

    There the corner of one gear, a cylinder of its `tip_corner_radius`, presses on the other's
    flank, whose radius of curvature is that of the place which it meets. Of a gear whose radius is
    not known it is the flanks at the end of the path, as on it.

    **Arguments:**

    - `pair`: the gears.
    - `roll`: places on the path of contact, or on its continuation, from $T_1$ [m].

    **Returns:**

    Their equivalent radius at each place, and their contact modulus.
    """
    flanks = hertz_contact(pair, jnp.clip(roll, pair.path_start, pair.path_end))
    radius = flanks.radius
    met = tip_contact_rolls(pair, roll)
    for body, gear in enumerate((pair.pinion, pair.wheel)):
        if gear.tip_corner_radius is not None:
            flank = met[1 - body] / jnp.cos(pair.base_helix_angle)
            corner = gear.tip_corner_radius
            rounded = corner * flank / (corner + flank)
            radius = jnp.where(_at_corner(pair, body, roll), rounded, radius)
    return HertzContact(radius=radius, modulus=flanks.modulus)


@compiled
def at_known_corner(pair: GearPair, roll: Reals) -> Marks:
    """Where a tip corner touches whose radius is known.

    **Arguments:**

    - `pair`: the gears.
    - `roll`: places on the path of contact, or on its continuation, from $T_1$ [m].

    **Returns:**

    Whether each place is one.
    """
    known = jnp.zeros_like(roll, dtype=bool)
    for body, gear in enumerate((pair.pinion, pair.wheel)):
        if gear.tip_corner_radius is not None:
            known |= _at_corner(pair, body, roll)
    return known


def _at_corner(pair: GearPair, body: int, roll: Reals) -> Marks:
    """Behind the path the pinion's corner touches, before it the wheel's."""
    return roll < pair.path_start if body else roll > pair.path_end
