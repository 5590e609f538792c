"""What a gear body lets one tooth pair do to the next: common to both, and no matter of relief."""

import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._contact._compliance import AbstractCompliance
from jaxgear._geometry._pair import GearPair
from jaxgear._types import Scalar


@compiled
def shared_compliance(pair: GearPair, compliance: AbstractCompliance) -> Scalar:
    r"""What a pair makes the next one give through the bodies, on the mean of double contact.

    Two pairs that give $c$ each by themselves and $g$ by each other deflect by $F c$ where one of
    them bears the load and by $F (c + g)/2$ where they share it. The difference, which relief is
    to make up for, is that of pairs that know nothing of each other and give $c - g$; the rest is
    in the mean of the transmission error alone. So the closed form of the Master Curve holds with
    $c - g$.

    **Arguments:**

    - `pair`: the gears.
    - `compliance`: of one tooth pair.

    **Returns:**

    $g$, motion along the normal over line load [m2/N]; zero where no body couples the teeth.
    """
    pitch = pair.transverse_base_pitch
    place = jnp.linspace(0.0, 1.0, 17)
    roll = pair.path_start + place * jnp.maximum(pair.path_of_contact - pitch, 0.0)
    return jnp.mean(compliance.felt(pair, roll))
