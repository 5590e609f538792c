"""A response in motion in numbers: ratios, series, orders."""

from typing import Any, NamedTuple

import jax.numpy as jnp

from jaxgear._compiled import lasting
from jaxgear._contact._root_influence import Influences
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._dynamic import (
    bearing_loads,
    contact_force,
    dynamic_response,
    dynamic_transmission_error,
    order_amplitudes,
    pair_forces,
)
from jaxgear._response._dynamic_roots import dynamic_root_stress
from jaxgear._types import Reals

# A tooth pair carries from this share of the static force on: a pair that only just enters has
# cells of hardly any length.
_CARRIES = 1e-6


class Measured(NamedTuple):
    """The numbers of a response, in SI.

    **Fields:**

    - `dynamic_ratio`, `pair_ratio`, `line_load_ratio`, `te_mean`, `te_rms`, `te_peak_to_peak`,
        `contact_loss`: as of `dynamic_response` [-, -, -, m, m, m, -].
    - `force`: mesh force over the static one, shape `[step]` [-].
    - `error`: dynamic transmission error, shape `[step]` [m].
    - `pairs`: number of tooth pairs that carry, shape `[step]`.
    - `te_order`, `force_order`, `bearing_order`: amplitudes at half orders of the mesh frequency,
        shape `[order]` [m], `[order]` [N], `[order, bearing, 6]` [N, N m].
    - `root_stress`, `root_compression`: largest of each gear, shape `[gear]`; of no gear where
        there are no influences [Pa].
    """

    dynamic_ratio: Any
    pair_ratio: Any
    line_load_ratio: Any
    te_mean: Any
    te_rms: Any
    te_peak_to_peak: Any
    contact_loss: Any
    force: Any
    error: Any
    pairs: Any
    te_order: Any
    force_order: Any
    bearing_order: Any
    root_stress: Any
    root_compression: Any


@lasting
def measured(
    dynamics: PairDynamics,
    orbit: Orbit,
    law: AbstractContactLaw,
    orders: int,
    influences: Influences | None = None,
) -> Measured:
    """Measure a response, in one program.

    **Arguments:**

    - `dynamics`: the pair.
    - `orbit`: its response.
    - `law`: with which it was found.
    - `orders`: of the mesh frequency that are wanted.
    - `influences`: of loads on the roots, where their stresses are wanted.

    **Returns:**

    The numbers.
    """
    system = dynamics.system
    found = dynamic_response(dynamics, orbit, 1, law)
    force, error = contact_force(system, orbit), dynamic_transmission_error(system, orbit)
    tension = compression = jnp.zeros(0)
    if influences is not None:
        roots = dynamic_root_stress(dynamics, influences, orbit, law)
        tension, compression = roots.largest, jnp.min(roots.coast, axis=(0, 1, 2))
    carrying = pair_forces(dynamics, orbit, law) > _CARRIES * system.force
    return Measured(
        dynamic_ratio=found.dynamic_ratio,
        pair_ratio=found.pair_ratio,
        line_load_ratio=found.line_load_ratio,
        te_mean=found.te_mean,
        te_rms=found.te_rms,
        te_peak_to_peak=found.te_peak_to_peak,
        contact_loss=found.contact_loss,
        force=force / system.force,
        error=error,
        pairs=jnp.sum(carrying, axis=1, dtype=int),
        te_order=_half_orders(dynamics, error, orders),
        force_order=_half_orders(dynamics, force, orders),
        bearing_order=_half_orders(dynamics, bearing_loads(dynamics, orbit), orders),
        root_stress=tension,
        root_compression=compression,
    )


def _half_orders(dynamics: PairDynamics, values: Reals, count: int) -> Reals:
    """Amplitudes at half orders of the mesh frequency; zero where the response has none."""
    system = dynamics.system
    periods = values.shape[0] // len(system.table.kinds) * system.table.periods
    if periods % 2 == 0:
        return order_amplitudes(system, values, 2 * count, first=0.5)
    whole = order_amplitudes(system, values, count)
    return jnp.zeros((2 * count, *whole.shape[1:])).at[1::2].set(whole)
