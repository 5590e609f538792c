"""Loads and pressures on the contact lines of a steady response, at a place within each step.

As for the quasi-static cycle, they belong to slices that are at least half in contact.
"""

import jax.numpy as jnp

from jaxgear._compiled import compiled
from jaxgear._contact._hertz import corner_contact
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._table import MIDDLE
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._response._dynamic import line_loads, pressed_cells
from jaxgear._types import LineGrid


@compiled
def dynamic_line_load(
    dynamics: PairDynamics,
    orbit: Orbit,
    law: AbstractContactLaw = ExactContact(),
    *,
    place: float = MIDDLE,
) -> LineGrid:
    """Load per length of contact line at each slice, drive flanks.

    **Arguments:**

    - `dynamics`: the pair.
    - `orbit`: its response at one speed.
    - `law`: with which the response was found.
    - `place`: 0, 0.5 or 1: at the start of each step, in its middle or at its end. Where a tooth
        enters, the largest load is at a start [-].

    **Returns:**

    Line load at each step of the response [N/m].
    """
    pressed = pressed_cells(dynamics.system, orbit, law, place)
    by_cycle = line_loads(dynamics, pressed.force)
    return by_cycle.reshape(-1, *by_cycle.shape[-2:])


@compiled
def dynamic_pressure(
    dynamics: PairDynamics,
    orbit: Orbit,
    law: AbstractContactLaw = ExactContact(),
    *,
    place: float = MIDDLE,
) -> LineGrid:
    """Largest Hertzian pressure across the contact band at each slice, drive flanks.

    Arguments as for `dynamic_line_load`; beyond the path of contact it is that of a corner
    whose radius is known, else that of the cylinders at its end.

    **Returns:**

    Pressure at each step of the response [Pa].
    """
    pair, lines = dynamics.cycle.system.pair, dynamics.cycle.cells.lines
    load = dynamic_line_load(dynamics, orbit, law, place=place)
    times = load.shape[0] // lines.roll.shape[0]
    return corner_contact(pair, jnp.tile(lines.roll, (times, 1, 1))).pressure(load)
