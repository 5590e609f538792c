"""Synchronous responses to unbalance, against the closed forms of a rigid rotor on springs."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, quick

import jaxgear as jg
from jaxgear import mm
from jaxgear._system._gear_body import RigidBody
from jaxgear._system._model import PairModel

MASS, POLAR, ACROSS = 2.0, 4e-3, 3e-3
RADIAL, TILT = 4e6, 9e3
MOMENT, ANGLE, HEIGHT = 3e-5, 0.7, 12e-3


@functools.cache
def _rotors(gyroscopic: bool) -> jg.PairDynamics:
    """Two rotors, with a mesh a million times as soft as their springs between them."""
    gears = jg.Gear(20, 12.0 * mm), jg.Gear(30, 12.0 * mm)
    pair = jg.GearPair(*gears, 2.0 * mm, 0.35, 0.0)
    support, body = jg.Support(RADIAL, RADIAL, 1e7, TILT), RigidBody(MASS, POLAR, ACROSS)
    model = PairModel(
        pair,
        1e-6,
        compliance=jg.ConstantStiffness(100.0),
        pinion_support=support,
        wheel_support=support,
        pinion_body=body,
        wheel_body=body,
    )
    grid = jg.mesh_grid(pair, phases=8, slices=1)
    none = jg.ModalDamping(mesh=0.0, structure=0.0)
    return jg.pair_dynamics(model, grid, none, gyroscopic=gyroscopic)


@pytest.mark.parametrize("gyroscopic", quick(1, [True, False]))
@pytest.mark.parametrize("gear", quick(1, ["wheel", "pinion"]))
@pytest.mark.parametrize("speed", [700.0, 2600.0])
def test_a_rigid_rotor_whirls_as_jeffcott_says(gyroscopic, gear, speed):
    """u = me w^2 / (k - m w^2), tilt h me w^2 / (k_t - (I_t - I_p) w^2): below and above critical.

    The rotor is at 1414 rad/s. It whirls in a circle with its own turning, the wheel backwards.
    """
    dynamics = _rotors(gyroscopic)
    unbalance = jg.Unbalance(MOMENT, ANGLE, HEIGHT, f"{gear} gear")
    found = jg.unbalance_response(dynamics, unbalance, speed)
    own = speed * (1.0 if gear == "pinion" else 20.0 / 30.0)
    assert_close(found.frequency, own, rtol=1e-14, atol=0.0)
    push = MOMENT * own**2 * np.exp(1j * ANGLE)
    moved = push / (RADIAL - MASS * own**2)
    tilted = HEIGHT * push / (TILT - (ACROSS - gyroscopic * POLAR) * own**2)
    turn = -1j if gear == "pinion" else 1j
    # A force along S tilts about T, one along T against S.
    wanted = [moved, turn * moved, 0.0, -turn * tilted, tilted]
    first = dynamics.dofs.index(0 if gear == "pinion" else 6)
    assert_close(found.motion[first : first + 5], jnp.asarray(wanted), rtol=2e-5, atol=1e-12)
    assert abs(float(jnp.abs(found.mesh_force))) < 1e-3


@pytest.mark.parametrize("gyroscopic", quick(1, [True, False]))
def test_critical_speeds_are_those_of_the_rigid_rotor(gyroscopic):
    """sqrt(k/m), and tilting sqrt(k_t / (I_t - I_p)): a disc that spins faster has none."""
    dynamics, ratio = _rotors(gyroscopic), 30.0 / 20.0
    tilting = [] if gyroscopic else [np.sqrt(TILT / ACROSS)]
    for gear, speed in (("pinion", 1.0), ("wheel", ratio)):
        unbalance = jg.Unbalance(MOMENT, ANGLE, HEIGHT, f"{gear} gear")
        found = jg.unbalance_critical_speeds(dynamics, unbalance)
        wanted = speed * np.asarray([np.sqrt(RADIAL / MASS), *tilting])
        # The mesh parts what are two of one speed along and across its normal.
        assert_close(np.unique(np.rint(found)), np.rint(wanted), rtol=0.0, atol=0.0)


def test_responses_of_one_shaft_add_up_and_those_of_two_are_refused():
    dynamics = _rotors(True)
    two = [jg.Unbalance(MOMENT, ANGLE, HEIGHT), jg.Unbalance(2.0 * MOMENT, -ANGLE)]
    each = [jg.unbalance_response(dynamics, one, 900.0).motion for one in two]
    both = jg.unbalance_response(dynamics, two, 900.0).motion
    assert_close(both, each[0] + each[1], rtol=1e-12, atol=1e-18)
    apart = [*two, jg.Unbalance(MOMENT, node="wheel gear")]
    with pytest.raises(ValueError, match="must be on one shaft, got pinion and wheel"):
        jg.unbalance_response(dynamics, apart, 900.0)
    with pytest.raises(ValueError, match="must be on one shaft, got none"):
        jg.unbalance_critical_speeds(dynamics, [])


def test_damping_of_cells_damps_unbalance_too():
    """Closed cells damp as their mean stiffness does: what is left out of the damping matrix."""
    dynamics, own, speed = _rotors(True), 1e5, 900.0
    active = eqx.tree_at(
        lambda d: d.system.cell_damping, dynamics, jnp.asarray(own), is_leaf=lambda x: x is None
    )
    whole = dynamics.system.damping + own * dynamics.system.mesh_stiffness
    damped = eqx.tree_at(lambda d: d.system.damping, dynamics, whole)
    bare, found, wanted = (
        jg.unbalance_response(each, jg.Unbalance(MOMENT), speed)
        for each in (dynamics, active, damped)
    )
    assert_close(found.motion, wanted.motion, rtol=1e-12, atol=0.0)
    # What closed cells press with has their damping in it.
    pressed = wanted.mesh_force * (1.0 + 1j * speed * own)
    assert_close(found.mesh_force, pressed, rtol=1e-12, atol=0.0)
    assert abs(bare.mesh_force - wanted.mesh_force) > 0.1 * abs(bare.mesh_force)


def test_responses_to_unbalance_are_differentiable():
    dynamics, sizes = _rotors(True), jnp.asarray([MOMENT, HEIGHT, 900.0])

    def amplitude(shares):
        x = shares * sizes
        found = jg.unbalance_response(dynamics, jg.Unbalance(x[0], 0.0, x[1]), x[2])
        return 1e10 * jnp.sum(jnp.abs(found.motion[:5]) ** 2)

    assert_gradient(amplitude, jnp.ones(3), rtol=1e-6)


def test_an_unbalance_at_no_node_is_refused():
    nowhere = jg.Unbalance(1.0, node="pinion bearing 0")
    with pytest.raises(ValueError, match=r"must be a node .*pinion gear.* got 'pinion bearing 0'"):
        jg.unbalance_response(_rotors(True), nowhere, 1.0)
