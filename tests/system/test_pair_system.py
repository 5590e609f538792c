"""Two rigid bodies on springs: loads, flexibility, refusals."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient
from solve_cases import ACCESSORY, POWER

import jaxgear as jg
from jaxgear._system._structure import static_flexibility

PINION = jg.Support(radial_s=2e8, radial_t=5e8, axial=1e8, tilt=3e5)
WHEEL = jg.Support(radial_s=4e8, radial_t=7e8, axial=2e8, tilt=6e5)


def test_mesh_force_balances_the_torque():
    """308.8 N m on the power pair: normal 7788 N; 80 N m on the accessory: 2615 N."""
    power = jg.pair_system(POWER.pair(), jnp.asarray(308.8))
    assert_close(power.force, 7788.0, rtol=1e-4, atol=0.0)
    accessory = jg.pair_system(ACCESSORY.pair(), jnp.asarray(80.0))
    assert_close(accessory.force, 80.0 / 0.0305879, rtol=1e-5, atol=0.0)


def test_bearing_loads_of_the_power_pair():
    """Totals of tables III-6 and III-7 of the thesis: S 3444 N, T 6829 N, transverse 7648 N."""
    system = jg.pair_system(POWER.pair(), jnp.asarray(308.8))
    on_wheel = system.vectors[:3, 0] * system.force
    assert_close(on_wheel[:2], jnp.asarray([3444.5, 6829.5]), rtol=1e-3, atol=0.0)
    assert_close(jnp.hypot(on_wheel[0], on_wheel[1]), 7648.0, rtol=1e-3, atol=0.0)
    # Axial: F_t tan(beta_b).
    assert_close(on_wheel[2], -7648.4 * math.tan(math.radians(10.861291)), rtol=1e-4, atol=0.0)
    assert_close(system.vectors[6:9, 0], -system.vectors[:3, 0], rtol=1e-14, atol=0.0)


def test_torques_of_both_bodies_balance_the_mesh_force():
    system = jg.pair_system(POWER.pair(), jnp.asarray(308.8))
    moments = system.vectors[jnp.asarray([5, 11]), 0] * system.force
    assert_close(moments, jnp.asarray([308.8, 308.8 * 68 / 35]), rtol=1e-12, atol=0.0)


# Motion per load in S, T, Z and about them [m/N, rad/(N m)].
PINION_GIVES = [1 / 2e8, 1 / 5e8, 1 / 1e8, 1 / 3e5, 1 / 3e5, 0.0]
WHEEL_GIVES = [1 / 4e8, 1 / 7e8, 1 / 2e8, 1 / 6e5, 1 / 6e5, 0.0]


def test_body_order_is_pinion_then_wheel():
    """A mesh load of its own on each degree of freedom: motion by its spring, none about Z."""
    system = jg.pair_system(POWER.pair(), jnp.asarray(10.0), PINION, WHEEL)
    alone = static_flexibility(system.structure, jnp.eye(12)).response
    expected = jnp.diag(jnp.asarray(PINION_GIVES + WHEEL_GIVES))
    assert_close(alone, expected, rtol=1e-14, atol=1e-24)


def test_mesh_flexibility_of_a_spur_pair_by_hand():
    """Springs in series along the line of action; tilt about the normal's axis apart from it."""
    pair = ACCESSORY.pair()
    system = jg.pair_system(pair, jnp.asarray(80.0), PINION, WHEEL)
    sine, cosine = math.sin(ACCESSORY.working_angle), math.cos(ACCESSORY.working_angle)
    along = sine**2 * (1 / 2e8 + 1 / 4e8) + cosine**2 * (1 / 5e8 + 1 / 7e8)
    # Y = (-cos, sin, 0): both gears tilt against each other about it.
    across = 1 / 3e5 + 1 / 6e5
    expected = jnp.asarray([[along, 0.0], [0.0, across]])
    assert_close(system.mesh_flexibility, expected, rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_mesh_flexibility_of_a_helical_pair_by_hand(sign):
    """Tilt of the bodies moves a helical pitch point: (n x r)_S,T of the axial normal part."""
    pair = eqx.tree_at(lambda p: p.helix_angle, POWER.pair(), replace_fn=lambda b: sign * b)
    system = jg.pair_system(pair, jnp.asarray(308.8), PINION, WHEEL)
    angle, helix = POWER.working_angle, sign * POWER.base_helix
    cosine = math.cos(helix)
    along = cosine**2 * math.sin(angle) ** 2 * (1 / 2e8 + 1 / 4e8)
    along += cosine**2 * math.cos(angle) ** 2 * (1 / 5e8 + 1 / 7e8)
    along += math.sin(helix) ** 2 * (1 / 1e8 + 1 / 2e8)
    teeth = np.asarray(POWER.teeth)
    first, second = POWER.centre_distance * teeth / teeth.sum()
    # u.n for a turn w of the pinion: w.(r x n) with r = (r_w1, 0, 0), n = (.., .., -sin beta_b):
    # T component +r_w1 sin(beta_b); for the wheel r = (-r_w2, 0, 0), n2 = -n: the same sign.
    along += math.sin(helix) ** 2 * (first**2 / 3e5 + second**2 / 6e5)
    coupling = math.sin(helix) * math.sin(angle) * (first / 3e5 - second / 6e5)
    expected = jnp.asarray([[along, coupling], [coupling, 1 / 3e5 + 1 / 6e5]])
    assert_close(system.mesh_flexibility, expected, rtol=1e-12, atol=0.0)


def test_bodies_move_away_from_the_mesh():
    """Under the mesh force each centre moves by load over stiffness, against its own normal."""
    system = jg.pair_system(ACCESSORY.pair(), jnp.asarray(80.0), PINION, WHEEL)
    load = jnp.asarray([[1000.0, 0.0], [0.0, 2.0]])
    moved = system.displacement(load)
    sine, cosine = math.sin(ACCESSORY.working_angle), math.cos(ACCESSORY.working_angle)
    under_force = jnp.asarray([-sine / 2e8, -cosine / 5e8, 0.0, sine / 4e8, cosine / 7e8, 0.0])
    rows = jnp.asarray([0, 1, 2, 6, 7, 8])
    assert_close(moved[0][rows], 1000.0 * under_force, rtol=1e-12, atol=1e-20)
    under_moment = jnp.asarray([cosine / 3e5, -sine / 3e5, 0.0, -cosine / 6e5, sine / 6e5, 0.0])
    assert_close(moved[1][rows + 3], 2.0 * under_moment, rtol=1e-12, atol=1e-20)


def test_displacement_is_what_the_mesh_loses():
    """V.X of the displacements equals -H g: one flexibility, seen from both sides."""
    system = jg.pair_system(POWER.pair(), jnp.asarray(308.8), PINION, WHEEL)
    load = jnp.asarray([[7000.0, -31.0]])
    lost = system.displacement(load) @ system.vectors
    assert_close(lost, -load @ system.mesh_flexibility, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("torque", [0.0, -80.0, math.nan])
def test_torque_must_be_positive(torque):
    with pytest.raises(ValueError, match="torque must be positive"):
        jg.pair_system(ACCESSORY.pair(), jnp.asarray(torque))


@pytest.mark.parametrize("name", ["radial_s", "radial_t", "axial", "tilt"])
@pytest.mark.parametrize("stiffness", [0.0, -1e8, math.nan])
def test_stiffness_must_be_positive(name, stiffness):
    with pytest.raises(ValueError, match=rf"`Support\.{name}` must be positive"):
        jg.Support(**{name: stiffness})


def test_system_assembles_under_jit():
    pair = POWER.pair()
    eager = jg.pair_system(pair, jnp.asarray(308.8), PINION, WHEEL)
    traced = eqx.filter_jit(jg.pair_system)(pair, jnp.asarray(308.8), PINION, WHEEL)
    assert_close(traced.mesh_flexibility, eager.mesh_flexibility, rtol=1e-13, atol=0.0)


def test_every_stiffness_has_a_derivative():
    supports = (PINION, WHEEL)
    assert len(jax.tree.leaves(eqx.filter(supports, eqx.is_inexact_array))) == 8
    pair = POWER.pair()

    def weighted(argument):
        (pinion, wheel), torque = argument
        system = jg.pair_system(pair, torque, pinion, wheel)
        weights = jnp.asarray([[1.0, 0.02], [0.03, 1e-4]])
        return jnp.sum(weights * system.mesh_flexibility) + 1e-13 * system.force

    assert_gradient(weighted, (supports, jnp.asarray(308.8)), rtol=1e-7)
