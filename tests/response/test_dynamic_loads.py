"""Line load and pressure of a response: those of the quasi-static cycle where it does not swing."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics.cases import torsional_pair
from dynamics.test_condensed_bodies import _pair
from fem_cases import assert_near

import jaxgear as jg
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics


def _at_rest(dynamics: PairDynamics, times: int) -> Orbit:
    """The quasi-static states, gone through a number of times at vanishing speed."""
    system, none = dynamics.system, jnp.zeros(())
    place = jnp.tile(system.rest, (times, 1))
    size = len(system.mass)
    return Orbit(
        speed=none,
        place=place,
        load=jnp.zeros_like(place),
        motion=jnp.zeros((len(place), size)),
        start=jnp.zeros((2, size)),
        residual=none,
        settled=jnp.asarray(True),
        steps=none,
    )


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("make", [torsional_pair, _pair], ids=["rigid", "condensed"])
def test_without_swing_it_is_the_quasi_static_cycle(make, times):
    dynamics, law = make(), jg.ExactContact()
    orbit, again = _at_rest(dynamics, times), lambda x: np.tile(np.asarray(x), (times, 1, 1))
    pair, cycle = dynamics.cycle.system.pair, dynamics.cycle
    load = np.asarray(eqx.filter_jit(jg.dynamic_line_load)(dynamics, orbit, law))
    assert_near(load, again(jg.line_load(cycle, law)), 1e-9)
    pressure = np.asarray(eqx.filter_jit(jg.dynamic_pressure)(dynamics, orbit, law))
    assert_near(pressure, again(jg.hertz_pressure(pair, cycle, law)), 1e-6)
    assert pressure.max() > 1e8


@pytest.mark.slow
def test_without_swing_roots_carry_what_they_do_at_rest():
    """In the middle of the steps; at their limits this orbit has no forces."""
    dynamics = torsional_pair()
    pair, cycle = dynamics.cycle.system.pair, dynamics.cycle
    influences, lines = jg.root_influences(pair), cycle.cells.lines
    found = jg.dynamic_root_stress(dynamics, influences, _at_rest(dynamics, 2)).drive
    still = jg.root_stress(pair, influences, lines, jg.slice_load(cycle)).drive
    assert found.shape[0] == 6 * still.shape[0]
    middle = np.asarray(found)[2 * len(still) : 4 * len(still)]
    assert_near(middle, np.tile(np.asarray(still), (2, 1, 1, 1)), 1e-9)
    assert float(still.max()) > 1e7
