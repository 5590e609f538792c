"""Temperatures of condensed bodies, from the keys of a scene."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._checks import InputError
from jaxgear._system._flexible import FlexibleBody
from jaxgear.scene._body_tables import TemperatureKeys
from jaxgear.scene._build_pair import si

# Of steel, 1/K: DIN 3967, on backlash at other temperatures.
STEEL_EXPANSION = 1.15e-5


def free_strains(keys: TemperatureKeys) -> Array:
    r"""Free strains $\alpha\Delta T$ of hub and rim, `[2]`; none where none are given [-]."""
    if not keys.is_given:
        return jnp.zeros(2)
    expansion = STEEL_EXPANSION if keys.expansion_1_K is None else si(keys.expansion_1_K)
    return expansion * jnp.stack([si(keys.hub_K), si(keys.rim_K)])


def warmed(body: FlexibleBody, gear: str, keys: TemperatureKeys) -> FlexibleBody:
    """A condensed body at the temperatures of a scene, which may be traced.

    **Raises:**

    - `InputError` if it was put in mesh without any.
    """
    if not keys.is_given:
        return body
    if body.heat is None:
        raise InputError(
            f"{gear}.body.temperature: the {gear}'s condensed body was put in mesh without "
            "temperatures. Use `with_bodies(scene)` again, on the scene that has them."
        )
    return eqx.tree_at(lambda b: b.heat.strain, body, free_strains(keys))
