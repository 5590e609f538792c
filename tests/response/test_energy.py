"""Work on a pair with a condensed wheel: what the mesh gives, damping takes."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics.cases import sdof_parametric
from dynamics.test_condensed_bodies import _by_default, _pair

from jaxgear._dynamics._march import quasi_static_start, time_history
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steady_state import steady_state
from jaxgear._dynamics._steppers import Midpoint
from jaxgear._response._energy import energies, work_done


@eqx.filter_jit
def _marched(system, speed, start, cycles=1):
    return time_history(system, speed, start, cycles=cycles, keep=cycles, stepper=Midpoint())


@eqx.filter_jit
def _steady_cycle(system, speed):
    orbit = steady_state(system, speed, Shooting(stepper=Midpoint(), tolerance=1e-12))
    history = time_history(system, speed, orbit.start, cycles=1, keep=1, stepper=Midpoint())
    return orbit.settled, work_done(system, history)


def test_an_oscillator_is_in_balance():
    system = sdof_parametric(ripple=0.3, steps=64)
    start = jnp.asarray([[3.0], [0.5]])
    work = eqx.filter_jit(work_done)(system, _marched(system, jnp.asarray(0.9), start, 3))
    assert float(work.taken) > 0.1
    assert abs(float(work.missing)) < 1e-10 * float(work.taken)
    # It began far from rest: much of what was there at first is gone.
    assert abs(float(work.stored)) > 0.1 * float(work.taken)


@pytest.mark.slow
@pytest.mark.parametrize("whole", [True, False], ids=["all terms", "by default"])
@pytest.mark.parametrize("speed", [1700.0, 3960.0])
def test_the_mesh_gives_what_is_dissipated_in_a_steady_response(whole, speed):
    """Away from a wave's critical speed, and at it; the body turns under the wave."""
    system = _pair().system if whole else _by_default()
    settled, work = _steady_cycle(system, jnp.asarray(speed))
    assert bool(settled)
    mesh, taken = float(work.mesh), float(work.taken)
    assert taken > 0.0
    assert mesh == pytest.approx(taken, rel=1e-7)
    for name in ("load", "gyroscopic", "stored", "missing"):
        assert abs(float(getattr(work, name))) < 1e-7 * taken, name
    if speed > 3000.0:
        # At the critical speed damping would be out of balance by far without what turning does.
        assert abs(float(work.circulatory)) > 1e-3 * taken


@pytest.mark.slow
def test_a_standing_mesh_neither_gives_nor_takes_from_a_turning_body():
    """The phase stands still, the body turns and grows: the total is constant, as all cells stay
    closed."""
    system, steps = _by_default(), 64
    table = system.table
    still = lambda x: jnp.repeat(x[5:6], steps, axis=0)
    middle = lambda x: jnp.repeat(jnp.repeat(x[1:2, 5:6], 3, axis=0), steps, axis=1)
    frozen = dataclasses.replace(
        table,
        edges=jnp.linspace(0.0, 1.0, steps + 1),
        stiffness=still(table.stiffness),
        gap=middle(table.gap),
        arms=middle(table.arms),
        growth=middle(table.growth),
        coupling=still(table.coupling),
        kinds=(0,) * steps,
        kept=still(table.kept),
    )
    own = dataclasses.replace(system, table=frozen, rest=still(system.rest))
    history = _marched(own, jnp.asarray(3000.0), quasi_static_start(own), 2)
    found = eqx.filter_jit(energies)(own, history)
    swing = float(np.ptp(np.asarray(found.kinetic)))
    assert float(found.dissipated[-1]) > 0.1 * swing
    assert float(np.ptp(np.asarray(found.total))) < 1e-8 * swing
