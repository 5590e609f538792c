"""Modes and damping of gear pairs: in torsion by hand, on shafts that are alike all round."""

import functools
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient
from solve_cases import POWER

import jaxgear as jg
from jaxgear import mm
from jaxgear._dynamics._damping import ModalDamping, damping_matrix
from jaxgear._dynamics._modes import modes, pair_modes, stiffness_parts
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._interface._wrench import structure_vectors
from jaxgear._system._gear_body import RigidBody
from jaxgear._system._shaft import Shaft
from jaxgear._system._shaft_parts import Bearing, Segment
from jaxgear._system._structure import assemble_structure

DISC = RigidBody(2.0, 3e-3, 2e-3)


@functools.cache
def _torsional():
    pair = POWER.pair()
    model = jg.PairModel(
        pair, 308.8, pinion_body=RigidBody(2.0, 2e-3, 2e-3), wheel_body=RigidBody(6.0, 3e-2, 3e-2)
    )
    grid = jg.mesh_grid(pair, phases=16, slices=4)
    return eqx.filter_jit(lambda m: pair_dynamics(m, grid))(model)


@pytest.mark.slow
def test_torsional_pair_vibrates_on_the_mesh_alone():
    r"""$\sqrt{k/m_{eq}}/2\pi$, $1/m_{eq} = \cos^2\beta_b\,(r_{b1}^2/I_1 + r_{b2}^2/I_2)$."""
    dynamics = _torsional()
    got = eqx.filter_jit(pair_modes)(dynamics)
    radius = POWER.base_radius
    inverse = math.cos(POWER.base_helix) ** 2 * (radius[0] ** 2 / 2e-3 + radius[1] ** 2 / 3e-2)
    stiffness = float(dynamics.system.mean[0, 0])
    # 40 mm of face at 18 N/(mm um) or so.
    assert 5e8 < stiffness < 1.2e9
    expected = math.sqrt(stiffness * inverse) / (2.0 * math.pi)
    assert_close(got.frequency, np.array([expected]), rtol=1e-10, atol=0.0)
    assert_close(got.mesh, np.ones(1), rtol=1e-10, atol=0.0)
    assert_close(got.damping_ratio, np.array([0.07]), rtol=1e-9, atol=0.0)
    assert np.abs(np.asarray(got.parts)).max() == 0.0
    # Both gears turn against each other as their mesh force accelerates them.
    turned = np.asarray(got.shape[:, 0])
    assert_close(turned[1] / turned[0], radius[1] * 2e-3 / radius[0] / 3e-2, rtol=1e-8, atol=0.0)


def _shaft():
    """Bearings as stiff along S as along T, gear off the middle."""
    bearings = [Bearing(z * mm, 4e8, 4e8, 2e8, 2e4, 2e4) for z in (0.0, 60.0)]
    return Shaft([Segment(60 * mm, 30 * mm)], bearings, 25 * mm)


@eqx.filter_jit
def _assembled(pinion, wheel, body):
    structure = assemble_structure(pinion, wheel, body, DISC, jnp.ones(()), jnp.ones(()))
    return structure, stiffness_parts(structure)


@functools.cache
def _equal_gears():
    """Two equal spur gears on equal shafts, and their mesh per stiffness: all that is needed."""
    shaft = _shaft()
    gear = jg.Gear(30, 20 * mm)
    pair = jg.GearPair(gear, gear, 3 * mm)
    structure, parts = _assembled(shaft, shaft, DISC)
    vectors = np.zeros((structure.map.size, 2))
    vectors[np.asarray(structure.map.gear_dofs)] = np.asarray(structure_vectors(pair))
    mesh = vectors @ np.diag([1.0, 3e-5]) @ vectors.T
    half = structure.map.sizes[0]
    turn = np.zeros(structure.map.size)
    turn[5:half:6], turn[half + 5 :: 6] = 1.0, -1.0
    return structure, parts, jnp.asarray(mesh), jnp.asarray(turn)


def _damped(mass, stiffness, mesh, turn):
    """All matrices of the held system, what is free in it, and its damping."""
    free = (turn / jnp.sqrt(turn @ mass @ turn))[:, None]
    momentum = mass @ free
    whole = stiffness + mesh + 1e8 * momentum @ momentum.T
    return whole, free, damping_matrix(ModalDamping(), mass, whole, mesh, free)


@eqx.filter_jit
def _modes_on_shafts(structure, parts, mesh, turn):
    whole, free, damping = _damped(structure.mass, structure.stiffness, mesh, turn)
    found = modes(structure.mass, whole, mesh, free, parts, damping)
    return found, structure.mass @ free, damping @ free


@pytest.mark.slow
def test_equal_gears_on_round_shafts():
    """Shares sum to one, ratios are composite, what the mesh leaves alone comes in equal pairs."""
    structure, parts, mesh, turn = _equal_gears()
    got, momentum, lost = _modes_on_shafts(structure, parts, 4e8 * mesh, turn)
    count = got.frequency.size
    assert count == structure.map.size - 1
    assert got.names == ("pinion shaft", "wheel shaft", "pinion bearings", "wheel bearings")
    total = got.mesh + got.parts.sum(axis=0)
    assert_close(total, np.ones(count), rtol=1e-9, atol=0.0)
    expected = 0.07 * got.mesh + 0.02 * (1.0 - got.mesh)
    assert_close(got.damping_ratio, expected, rtol=1e-9, atol=0.0)
    assert np.abs(np.asarray(momentum.T @ got.shape)).max() < 1e-9
    assert np.abs(np.asarray(lost)).max() < 1e-6
    # Equal gears: either has half of what is not in the mesh.
    pinion = got.share("pinion shaft") + got.share("pinion bearings")
    assert_close(pinion, 0.5 * (1.0 - got.mesh), rtol=1e-8, atol=1e-9)
    crossing = np.asarray(got.crossing)
    assert crossing.sum() > count / 2
    assert np.abs(np.asarray(got.mesh)[crossing]).max() < 1e-12
    assert np.asarray(got.mesh).max() > 0.8


@pytest.mark.slow
def test_damping_of_equal_gears_on_round_shafts_has_derivatives():
    """Frequencies coincide by the dozen, and bearings, a shaft and a gear part them one by one."""
    structure, _, mesh, turn = _equal_gears()
    shaft = _shaft()
    softer = lambda where: eqx.tree_at(lambda s: where(s.bearings[0]), shaft, replace_fn=_half)
    others = (
        (softer(lambda b: b.radial_s), shaft, DISC),
        (softer(lambda b: (b.axial, b.tilt_t)), shaft, DISC),
        (shaft, eqx.tree_at(lambda s: s.segments[0].outer, shaft, 29.7 * mm), DISC),
        (shaft, shaft, eqx.tree_at(lambda b: b.transverse_inertia, DISC, 1.9e-3)),
    )
    found = [_assembled(*other)[0] for other in others]
    mass = jnp.stack([x.mass - structure.mass for x in found])
    stiffness = jnp.stack([x.stiffness - structure.stiffness for x in found])
    scale = np.tile([1.0, 1.0, 1.0, 30.0, 30.0, 30.0], structure.map.size // 6)
    weight = np.random.default_rng(3).normal(size=mesh.shape) * scale[:, None] * scale[None, :]

    def weighted(numbers):
        changes, mesh_stiffness = numbers
        *_, damping = _damped(
            structure.mass + jnp.tensordot(changes, mass, 1),
            structure.stiffness + jnp.tensordot(changes, stiffness, 1),
            mesh_stiffness * mesh,
            turn,
        )
        return jnp.sum(jnp.asarray(weight) * damping)

    numbers = [jnp.zeros(4), jnp.asarray(4e8)]
    # Modes that part are soon as far apart as they were from others: short steps.
    sizes = [jnp.asarray(1.0), jnp.asarray(4e6)]
    assert_gradient(weighted, numbers, rtol=3e-5, step=1e-6, scale=sizes)


def _half(x):
    return 0.5 * x
