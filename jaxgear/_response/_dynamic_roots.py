"""Stress at the roots of the teeth of a pair in motion, by the loads on its contact lines.

As for other loads, the largest are looked for at the start, in the middle and at the end of each
step. Drive flanks: where back flanks touch, what they do to the roots is not in it.
"""

import jax
import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._contact._root_influence import Influences
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._table import PLACES
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._response._dynamic import pressed_cells
from jaxgear._response._root_stress import RootStress, root_stress


@compiled
def dynamic_root_stress(
    dynamics: PairDynamics,
    influences: Influences,
    orbit: Orbit,
    law: AbstractContactLaw = ExactContact(),
) -> RootStress:
    """Largest stresses of the fillets in a steady response.

    **Arguments:**

    - `dynamics`: the pair.
    - `influences`: of loads on the roots of its teeth.
    - `orbit`: its response at one speed.
    - `law`: with which the response was found.

    **Returns:**

    The stresses over the steps of the response, at the start, in the middle and at the end of each,
    one after the other; the last axis pinion and wheel.
    """
    pair, lines = dynamics.cycle.system.pair, dynamics.cycle.cells.lines
    cells = lines.roll[0].size
    forces = [pressed_cells(dynamics.system, orbit, law, place).force for place in PLACES]
    # A response over several cycles meets the lines of one again and again.
    load = jnp.concatenate(forces)[:, :cells].reshape(-1, *lines.roll.shape) / lines.length
    found = jax.lax.map(lambda own: root_stress(pair, influences, lines, own), load)
    return jax.tree.map(lambda values: values.reshape(-1, *values.shape[2:]), found)
