"""Shafts, bearings, bodies and housing put together: statics by hand, thesis, refusals."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient
from solve_cases import ACCESSORY, POWER

import jaxgear as jg
from jaxgear._checks import InputError
from jaxgear._system._gear_body import BeamBody, RigidBody, solid_disc
from jaxgear._system._housing import Housing
from jaxgear._system._shaft import Shaft
from jaxgear._system._shaft_parts import Bearing, Segment, ShaftLoad
from jaxgear._system._structure import (
    assemble_structure,
    bearing_motion,
    driving_torque,
    static_flexibility,
)

YOUNG, SHEAR, DENSITY = 206e9, 206e9 / 2.6, 7850.0
DISC = RigidBody(2.0, 3e-3, 2e-3)

_bearings = eqx.filter_jit(bearing_motion)


@eqx.filter_jit
def _solved(vectors, *given):
    structure = assemble_structure(*given)
    return structure, static_flexibility(structure, vectors)


def _beside(mount, vectors=None, body: RigidBody | BeamBody = DISC, torque=0.0, housing=None):
    """One pinion beside a wheel that only turns; each direction of the gears is loaded in turn."""
    vectors = jnp.eye(12) if vectors is None else jnp.asarray(vectors)
    numbers = (jnp.asarray(torque), jnp.asarray(2.0))
    return _solved(vectors, mount, jg.Support(), body, DISC, *numbers, housing)


def _rod(length, bearings, gear_at, diameter=0.03, **options):
    return Shaft([Segment(length, diameter)], bearings, gear_at, **options)


def _sheared(diameter):
    """Cowper's for a solid shaft of steel, times G and the area."""
    return 7.8 / 8.8 * SHEAR * math.pi / 4 * diameter**2


def _bent(diameter):
    return YOUNG * math.pi / 64 * diameter**4


# --- One gear on one shaft


def _overhung(near, far, gear):
    """Deflection per load of a gear beyond two springs: 2e8 and 5e8 N/m, 30 mm shaft."""
    span, reach = far - near, gear - far
    bending = reach**2 * (span + reach) / 3 / _bent(0.03)
    shear = (reach**2 / span + reach) / _sheared(0.03)
    springs = (reach / span) ** 2 / 2e8 + (1 + reach / span) ** 2 / 5e8
    return bending + shear + springs


def _overhung_shaft():
    bearings = [Bearing(0.01, 2e8, 2e8, 1e8), Bearing(0.06, 5e8, 5e8)]
    return _rod(0.1, bearings, 0.09)


def test_overhung_gear_by_hand():
    """PC2(L+C)/3EI, shear, and the springs' settlement."""
    _, solved = _beside(_overhung_shaft())
    expected = _overhung(0.01, 0.06, 0.09)
    assert_close(jnp.diagonal(solved.mesh_flexibility)[:2], np.full(2, expected), rtol=1e-9, atol=0)
    # Along: the first bearing alone, and the shaft between it and the gear.
    along = 1e-8 + 0.08 / (YOUNG * math.pi / 4 * 0.03**2)
    assert_close(solved.mesh_flexibility[2, 2], along, rtol=1e-9, atol=0.0)


@pytest.mark.slow
def test_bearing_and_gear_positions_have_the_derivatives_of_the_formula():
    shaft = _overhung_shaft()

    @eqx.filter_jit
    @eqx.filter_grad
    def slopes(shaft):
        structure = assemble_structure(shaft, jg.Support(), DISC, DISC, jnp.zeros(()), jnp.ones(()))
        return static_flexibility(structure, jnp.eye(12)).mesh_flexibility[0, 0]

    got = slopes(shaft)
    got = jnp.stack([got.bearings[0].at, got.bearings[1].at, got.gear_at])
    expected = jax.jit(jax.grad(_overhung, argnums=(0, 1, 2)))(0.01, 0.06, 0.09)
    assert_close(got, jnp.stack(expected), rtol=1e-8, atol=0.0)


def test_flexibility_is_symmetric_and_the_gear_does_not_turn():
    """Maxwell and Betti over the gear's directions; rotation about Z belongs to the mesh."""
    structure, solved = _beside(_overhung_shaft())
    given = np.asarray(solved.response)[list(structure.map.gear_dofs)]
    assert_close(given, given.T, rtol=1e-9, atol=1e-20)
    assert np.abs(given[[5, 11]]).max() < 1e-20
    # Forces across turn the gear: about T along with S, the other way about S along with T.
    assert given[4, 0] > 0.0
    assert_close(given[3, 1], -given[4, 0], rtol=1e-12, atol=0.0)


def test_two_bearings_share_the_load_by_statics():
    """Whatever their stiffness: by the lever, and a moment as a couple."""
    load = ShaftLoad(0.03, (100.0, -40.0, 7.0), (2.0, 3.0, 0.0))
    bearings = [Bearing(0.0, 2e8, 3e8, 1e8), Bearing(0.1, 5e8, 9e7)]
    structure, solved = _beside(_rod(0.1, bearings, 0.05, loads=[load]))
    got = _bearings(structure, solved.offset).load
    # About T, dv/dz = +psi: a moment M_T is a couple of +M/L at the far end along S.
    expected = np.array([[70.0 - 30.0, -28.0 + 20.0, 7.0], [30.0 + 30.0, -12.0 - 20.0, 0.0]])
    assert_close(got[:, :3], expected, rtol=1e-9, atol=1e-9)
    moved = _bearings(structure, solved.offset).displacement[:, :2]
    springs = np.array([[2e8, 3e8], [5e8, 9e7]])
    assert_close(moved, expected[:, :2] / springs, rtol=1e-9, atol=0.0)


def test_three_bearings_by_the_three_moment_equation():
    """Two equal spans, a load at the middle of the first: 13/32, 22/32, -3/32 of it."""
    bearings = [Bearing(z, 1e9, 1e9, 1e9) for z in (0.0, 0.5, 1.0)]
    load = ShaftLoad(0.25, (32.0, 0.0, 0.0))
    slender = _rod(1.0, bearings, 0.75, 0.005, loads=[load])
    structure, solved = _beside(slender)
    got = _bearings(structure, solved.offset).load[:, 0]
    assert_close(got, np.array([13.0, 22.0, -3.0]), rtol=1e-3, atol=0.0)


def test_tilt_springs_hold_a_single_bearing():
    """A shaft on one bearing: load over stiffness, and lever squared over tilt stiffness."""
    bearing = Bearing(0.0, 2e8, 5e8, 1e8, 3e4, 4e4)
    structure, solved = _beside(_rod(0.05, [bearing], 0.05))
    own = 0.05**3 / 3 / _bent(0.03) + 0.05 / _sheared(0.03)
    # Along S it tilts about T, along T about S.
    expected = own + np.array([1 / 2e8 + 0.05**2 / 4e4, 1 / 5e8 + 0.05**2 / 3e4])
    assert_close(jnp.diagonal(solved.mesh_flexibility)[:2], expected, rtol=1e-9, atol=0.0)
    load = _bearings(structure, solved.response[:, 0]).load
    # The force is at a height above the bearing, so it turns it about +T.
    expected = np.array([[1.0, 0.0, 0.0, 0.0, 0.05]])
    assert_close(load, expected, rtol=1e-9, atol=1e-12)


# --- Torque


def test_rotation_about_z_is_that_of_the_mesh_alone():
    """Between the torque and the gear the shaft winds up; nothing else moves."""
    bearings = [Bearing(0.0, 2e8, 2e8, 1e8), Bearing(0.1, 5e8, 5e8)]
    shaft = _rod(0.1, bearings, 0.07, torque_at=0.02)
    structure, solved = _beside(shaft, torque=50.0)
    offset = np.array(solved.offset)
    dofs = structure.map.dofs
    wound = 50.0 * 0.05 / (SHEAR * math.pi / 32 * 0.03**4)
    for place, expected in (("torque", wound), ("left end", wound), ("right end", 0.0)):
        assert abs(offset[dofs[f"pinion {place}"] + 5] - expected) < 1e-12 * wound
    offset[5::6] = 0.0
    assert np.abs(offset).max() == 0.0
    assert np.abs(np.asarray(solved.mesh_offset)).max() < 1e-15 * wound


def test_couples_on_the_shafts_join_torque_and_reaction():
    couples = [ShaftLoad(0.0, moment=(0.0, 0.0, 5.0)), ShaftLoad(0.1, moment=(9.0, 9.0, -2.0))]
    bearings = [Bearing(0.0, 2e8, 2e8, 1e8), Bearing(0.1, 5e8, 5e8)]
    pinion = _rod(0.1, bearings, 0.07, loads=couples)
    wheel = _rod(0.1, bearings, 0.07, torque_at=0.0, loads=couples[:1])
    torque = jnp.asarray(50.0)
    assert_close(driving_torque(pinion, torque), 53.0, rtol=1e-15, atol=0.0)
    assert_close(driving_torque(jg.Support(), torque), 50.0, rtol=1e-15, atol=0.0)
    given = (pinion, wheel, DISC, DISC, torque, jnp.asarray(2.0))
    structure = eqx.filter_jit(assemble_structure)(*given)
    about = np.asarray(structure.load)[5::6]
    # The mesh brings -53 to the pinion and -106 to the wheel: every shaft is in balance.
    assert_close(about[:3], np.array([5.0, 50.0, -2.0]), rtol=1e-14, atol=0.0)
    assert_close(about[3:], np.array([101.0 + 5.0, 0.0, 0.0]), rtol=1e-14, atol=1e-14)


def test_beam_body_is_wound_up_by_the_torque():
    """Driven from the left, loaded at both ends of its face alike: half passes through it."""
    bearings = [Bearing(0.0, 2e8, 2e8, 1e8), Bearing(0.1, 5e8, 5e8)]
    shaft = _rod(0.1, bearings, 0.06, torque_at=0.0, body_width=0.02)
    radius = 0.05
    vectors = np.zeros((18, 1))
    vectors[[5, 11], 0] = 0.5 * radius
    vectors[17, 0] = 2 * radius
    structure, solved = _beside(shaft, vectors, BeamBody(0.02, 0.08), torque=40.0)
    force = jnp.asarray([40.0 / radius])
    motion = np.asarray(solved.offset - solved.response @ force)
    left, right = (structure.map.dofs[f"pinion gear {side}"] + 5 for side in ("left", "right"))
    twist = 20.0 * 0.02 / (SHEAR * math.pi / 32 * 0.08**4)
    assert_close(motion[[left, right]], np.array([twist, -twist]) / 2, rtol=1e-9, atol=0.0)
    # The rest of the residual is nothing: drive, mesh and springs balance at every node.
    residual = np.asarray(structure.stiffness) @ motion - np.asarray(structure.load)
    residual[list(structure.map.gear_dofs)] += vectors @ np.asarray(force)
    assert np.abs(residual).max() < 1e-9


@pytest.mark.slow
def test_stiff_beam_body_moves_as_a_rigid_one():
    """Both ends of the face follow the gear's centre where the body hardly bends."""
    bearings = [Bearing(0.0, 2e8, 2e8, 1e8), Bearing(0.1, 5e8, 5e8)]
    hard = BeamBody(0.001, 0.5, jg.Material(1e16, 0.3, 7850.0))
    across = np.zeros((18, 1))
    across[[0, 6], 0] = 0.5
    _, beam = _beside(_rod(0.1, bearings, 0.06, body_width=0.001), across, hard)
    _, rigid = _beside(_rod(0.1, bearings, 0.06), np.eye(12)[:, :1])
    expected, got = rigid.mesh_flexibility, beam.mesh_flexibility
    # The body replaces a millimetre of shaft, of the hundred between the bearings.
    assert_close(got, expected, rtol=3e-2, atol=0.0)
    assert float(got[0, 0]) < float(expected[0, 0])


# --- Both gears


@pytest.mark.slow
def test_supports_alone_are_the_pair_system():
    pair = POWER.pair()
    pinion = jg.Support(radial_s=2e8, radial_t=5e8, axial=1e8, tilt=3e5)
    wheel = jg.Support(radial_t=7e8, tilt=6e5)
    vectors = eqx.filter_jit(jg.structure_vectors)(pair)
    expected = eqx.filter_jit(jg.pair_system)(pair, jnp.asarray(300.0), pinion, wheel)
    given = (pinion, wheel, DISC, DISC, jnp.asarray(300.0), jnp.asarray(68 / 35))
    structure, solved = _solved(vectors, *given)
    assert structure.map.free == (0, 1, 2, 3, 4, 5, 7, 9, 10, 11)
    assert_close(solved.mesh_flexibility, expected.mesh_flexibility, rtol=1e-12, atol=0.0)
    load = jnp.asarray([[7000.0, -31.0]])
    moved = jax.jit(lambda load: expected.displacement(load))(load)
    assert_close(-solved.response @ load[0], moved[0], rtol=1e-12, atol=1e-25)
    assert np.abs(np.asarray(solved.mesh_offset)).max() == 0.0


def test_rigid_bodies_give_way_to_nothing():
    vectors = eqx.filter_jit(jg.structure_vectors)(POWER.pair())
    _, solved = _beside(jg.Support(), vectors, torque=300.0)
    assert np.abs(np.asarray(solved.mesh_flexibility)).max() < 1e-25
    assert np.abs(np.asarray(solved.response)).max() < 1e-20


def _thesis_pair(drawing, torque, shafts):
    """Static loads of both shafts' bearings under the mesh force at the pitch point."""
    numbers = (jnp.asarray(torque), jnp.asarray(drawing.teeth[1] / drawing.teeth[0]))
    vectors = eqx.filter_jit(jg.structure_vectors)(drawing.pair())
    structure, solved = _solved(vectors, *shafts, DISC, DISC, *numbers)
    force = torque / (drawing.base_radius[0] * math.cos(drawing.base_helix))
    return _bearings(structure, solved.offset - solved.response[:, 0] * force)


def test_bearings_of_the_accessory_pair():
    """Tables III-2 and III-3 of the thesis: displacements in um, on 1.04e9 N/m.

    A gear at 55 of 80 mm on the pinion's shaft, and half a millimetre off mid-span on the wheel's,
    fits all four bearings to the last printed digit.
    """
    pinion = _rod(0.08, [Bearing(z, 1.04e9, 1.04e9, 1e8) for z in (0.0, 0.08)], 0.055)
    wheel = _rod(0.08, [Bearing(z, 1.04e9, 1.04e9, 1e8) for z in (0.0, 0.08)], 0.0405)
    moved = _thesis_pair(ACCESSORY, 80.0, (pinion, wheel)).displacement[:, :2]
    expected = np.array([[-0.35, -0.70], [-0.77, -1.55], [0.55, 1.11], [0.57, 1.15]])
    assert_close(moved, 1e-6 * expected, rtol=0.0, atol=1.01e-8)


def test_bearings_of_the_power_pair():
    """Totals of tables III-6 and III-7: S 3444, T 6829 N; the axial force on one bearing."""
    shafts = [
        _rod(0.2, [Bearing(0.0, 1e9, 1e9, 1e8), Bearing(0.2, 1e9, 1e9)], at) for at in (0.09, 0.11)
    ]
    load = np.asarray(_thesis_pair(POWER, 308.8, shafts).load)
    total = load.reshape(2, 2, 5).sum(axis=1)
    assert_close(total[1, :2], np.array([3444.5, 6829.5]), rtol=1e-3, atol=0.0)
    assert_close(total[0, :3], -total[1, :3], rtol=1e-9, atol=0.0)
    # F_t tan(beta_b), pushed against the pinion's normal.
    assert_close(total[0, 2], 7648.4 * math.tan(math.radians(10.861291)), rtol=1e-4, atol=0.0)
    assert np.abs(load[[1, 3], 2]).max() == 0.0


# --- Housing


def _housed(stiffness):
    bearings = [Bearing(0.0, 2e8, 3e8, 1e8), Bearing(0.1, 5e8, 9e7)]
    load = ShaftLoad(0.03, (10.0, 20.0, 30.0))
    return _beside(_rod(0.1, bearings, 0.04, loads=[load]), housing=stiffness)


def test_housing_is_in_series_with_the_bearings():
    behind = np.array([1e8, 4e8, 2e8, 3e8, 7e7, 5e8])
    structure, _ = _housed(Housing(np.diag(behind)))
    own = np.array([2e8, 3e8, 1e8, 5e8, 9e7, 0.0])
    series = np.diag(own * behind / (own + behind))
    assert_close(structure.bearing_stiffness, series, rtol=1e-12, atol=1e-6)


def test_housing_couples_the_bearings():
    """Against the same springs with a node for each seat."""
    mixed = np.random.default_rng(11).normal(size=(6, 6))
    behind = 1e8 * (mixed @ mixed.T + 2 * np.eye(6))
    structure, solved = _housed(Housing(behind))
    plain, _ = _housed(None)
    seats = [6 * node + k for node in (0, 3) for k in range(3)]
    assert [structure.map.bearings[0], structure.map.bearings[1]] == [0, 18]
    own = np.diag([2e8, 3e8, 1e8, 5e8, 9e7, 0.0])
    size = structure.map.sizes[0]
    whole = np.zeros((size + 6, size + 6))
    whole[:size, :size] = np.asarray(plain.stiffness)[:size, :size]
    on_seat = [size + k for k in range(6)]
    whole[np.ix_(on_seat, on_seat)] = own + behind
    whole[np.ix_(seats, on_seat)] = whole[np.ix_(on_seat, seats)] = -own
    gear = structure.map.dofs["pinion gear"]
    whole[gear + 5, gear + 5] *= 2
    load = np.concatenate([np.asarray(structure.load)[:size], np.zeros(6)])
    motion = np.linalg.solve(whole, load)
    assert_close(solved.offset[:size], motion[:size], rtol=1e-8, atol=1e-15)
    loads = own @ (motion[seats] - motion[on_seat])
    got = _bearings(structure, solved.offset).load[:, :3]
    assert_close(got.ravel(), loads, rtol=1e-7, atol=1e-7)


def test_rigid_housing_is_the_ground():
    grounded, expected = _housed(None)
    stiff, got = _housed(Housing(1e18 * np.eye(6)))
    assert_close(stiff.bearing_stiffness, grounded.bearing_stiffness, rtol=1e-8, atol=1e-2)
    assert_close(got.offset, expected.offset, rtol=1e-7, atol=1e-15)


# --- Inertia


def test_solid_disc_by_hand():
    """Steel, 100 over 40 mm, 30 mm wide: 1.5536 kg."""
    disc = solid_disc(0.1, 0.04, 0.03, DENSITY)
    mass = DENSITY * math.pi / 4 * (0.01 - 0.0016) * 0.03
    assert_close(disc.mass, 1.5536, rtol=1e-4, atol=0.0)
    assert_close(disc.polar_inertia, mass * (0.01 + 0.0016) / 8, rtol=1e-13, atol=0.0)
    across = mass * ((0.01 + 0.0016) / 16 + 0.03**2 / 12)
    assert_close(disc.transverse_inertia, across, rtol=1e-13, atol=0.0)
    known = solid_disc(0.1, 0.04, 0.03, DENSITY, mass=1.2, polar_inertia=1e-3)
    assert_close(known.mass, 1.2, rtol=1e-15, atol=0.0)
    assert_close(known.polar_inertia, 1e-3, rtol=1e-15, atol=0.0)
    # As of any body that is even along its width.
    across = 0.5e-3 + 1.2 * 0.03**2 / 12
    assert_close(known.transverse_inertia, across, rtol=1e-13, atol=0.0)
    # Lighter than the drawn disc, and its mass near the rim: no number is refused.
    solid_disc(0.064, 0.025, 0.015, DENSITY, mass=0.3, polar_inertia=1.5e-4)


def test_bodies_add_their_inertia_at_the_gear():
    """Momentum of both bodies moving and turning as a whole, about each shaft's left end."""
    bearings = [Bearing(0.0, 2e8, 2e8, 1e8), Bearing(0.1, 5e8, 5e8)]
    structure, _ = _solved(
        jnp.eye(12),
        _rod(0.1, bearings, 0.04),
        jg.Support(),
        DISC,
        RigidBody(5.0, 8e-3, 7e-3),
        jnp.asarray(1.0),
        jnp.asarray(2.0),
    )
    rod = DENSITY * math.pi / 4 * 0.03**2 * 0.1
    heights = np.array([0.0, 0.04, 0.1, 0.0])
    motions = np.zeros((24, 4))
    motions[0:18:6, 0] = 1.0
    motions[4:18:6, 1], motions[0:18:6, 1] = 1.0, heights[:3]
    motions[3:18:6, 2], motions[1:18:6, 2] = 1.0, -heights[:3]
    motions[18 + 5, 3] = 1.0
    got = motions.T @ np.asarray(structure.mass) @ motions
    across = rod * (0.1**2 / 3 + 0.03**2 / 16) + 2e-3 + 2.0 * 0.04**2
    expected = np.diag([rod + 2.0, across, across, 8e-3])
    expected[0, 1] = expected[1, 0] = rod * 0.05 + 2.0 * 0.04
    assert_close(got, expected, rtol=1e-12, atol=1e-16)
    spin = motions.T @ np.asarray(structure.pinion_gyroscopic) @ motions
    polar = rod * 0.03**2 / 8 + 3e-3
    assert_close(spin[1, 2], -polar, rtol=1e-12, atol=0.0)
    assert_close(spin, -spin.T, rtol=1e-12, atol=1e-18)
    wheel = np.asarray(structure.wheel_gyroscopic)
    assert_close(wheel[18 + 3, 18 + 4], 8e-3, rtol=1e-15, atol=0.0)
    assert np.abs(wheel[:18]).max() == 0.0
    assert np.abs(np.asarray(structure.pinion_gyroscopic)[18:]).max() == 0.0


# --- Derivatives


@functools.cache
def _everything():
    """A beam pinion and a rigid wheel on stepped shafts in one housing, with loads outside."""
    pinion = Shaft(
        [Segment(0.05, 0.03, 0.01), Segment(0.07, 0.04, 0.01)],
        [Bearing(0.01, 2e8, 3e8, 1e8, 1e4, 2e4), Bearing(0.11, 5e8, 4e8, 3e7, 3e4, 1e4)],
        0.08,
        0.02,
        [ShaftLoad(0.03, (100.0, 200.0, 50.0), (2.0, 3.0, 4.0))],
        0.85,
        body_width=0.02,
    )
    wheel = Shaft(
        [Segment(0.09, 0.04, 0.02)],
        [Bearing(0.01, 2e8, 3e8, 1e8, 1e4, 2e4), Bearing(0.08, 5e8, 4e8, 3e7, 3e4, 1e4)],
        0.05,
    )
    mixed = np.random.default_rng(17).normal(size=(12, 12))
    housing = Housing(1e8 * (mixed @ mixed.T + 12 * np.eye(12)))
    torque, ratio = jnp.asarray(80.0), jnp.asarray(2.0)
    return pinion, wheel, BeamBody(0.02, 0.07), DISC, torque, ratio, housing


@pytest.mark.slow
def test_every_number_has_a_derivative():
    given = _everything()
    # Pinion: 2 x 3 of segments, 2 x 6 of bearings, 2 places, 3 of the load, shear, 3 of steel.
    assert (
        len(jax.tree.leaves(given)) == (6 + 12 + 2 + 3 + 1 + 3) + (3 + 12 + 1 + 3) + 5 + 3 + 2 + 1
    )
    draw = np.random.default_rng(19)
    vectors = draw.normal(size=(18, 2))
    # Moments of the normal force about Z, and levers in metres.
    vectors[[5, 11, 17]] = [[0.02, 0.0], [0.02, 0.0], [0.08, 0.0]]
    vectors[[3, 4, 9, 10, 15, 16]] *= 0.03
    vectors, weights = jnp.asarray(vectors), jnp.asarray(draw.normal(size=(2, 84, 84)))

    def weighted(given):
        built = assemble_structure(*given)
        solved = static_flexibility(built, vectors)
        held = bearing_motion(built, solved.offset)
        return (
            1e8 * jnp.sum(solved.mesh_flexibility * jnp.asarray([[1.0, 0.5], [0.5, 2.0]]))
            + 1e5 * jnp.sum(solved.mesh_offset)
            + 1e6 * jnp.sum(solved.response[:, 0] * weights[0, 0])
            + 1e-2 * jnp.sum(held.load * weights[0, :4, :5])
            + jnp.sum(built.mass * weights[0])
            + 1e2 * jnp.sum(built.pinion_gyroscopic * weights[1])
        )

    assert_gradient(weighted, given, rtol=1e-5, step=1e-6)


# --- Refusals


ENDS = (0.0, 0.1)


@pytest.mark.parametrize(
    ("bearings", "message"),
    [
        (
            [Bearing(z, 1e9, 1e9) for z in ENDS],
            r"The pinion's shaft is free to slide along Z\. Give .* `axial_N_m`",
        ),
        ([Bearing(z, 0.0, 1e9, 1e8) for z in ENDS], r"free to move along S\. .* `radial_S_N_m`"),
        ([Bearing(z, 1e9, 0.0, 1e8) for z in ENDS], r"free to move along T\. .* `radial_T_N_m`"),
        (
            [Bearing(0.02, 1e9, 1e9, 1e8)],
            r"free to tilt about T: only one place holds it along S\. .* `tilt_Nm_rad`",
        ),
        (
            [Bearing(0.02, 1e9, 1e9, 1e8), Bearing(0.08, 1e9)],
            r"free to tilt about S: only one place holds it along T",
        ),
        # Two bearings in one place are one.
        ([Bearing(0.05, 1e9, 1e9, 1e8), Bearing(0.05, 1e9, 1e9)], r"free to tilt about T"),
        ([Bearing(z, 0.0, 1e9, 1e8, 1e4, 1e4) for z in ENDS], r"free to move along S"),
        # Held, but a thousand million times less than elsewhere.
        ([Bearing(z, 1e9, 1e9, 0.5) for z in ENDS], r"free to slide along Z"),
    ],
)
def test_a_mechanism_is_refused(bearings, message):
    with pytest.raises(InputError, match=message):
        _rod(0.1, bearings, 0.05).check_held("pinion")


@pytest.mark.parametrize(
    "bearings",
    [
        [Bearing(0.0, 1e9, 1e9, 1e8), Bearing(0.1, 1e9, 1e9)],
        [Bearing(0.02, 1e9, 1e9, 1e8, 1e4, 1e4)],
        [Bearing(0.0, 1e9, 1e9, 1e6), Bearing(0.001, 1e9, 1e9)],
    ],
)
def test_a_held_shaft_is_let_through(bearings):
    _rod(0.1, bearings, 0.05).check_held("wheel")


def test_assembling_names_the_body_that_is_free():
    loose = _rod(0.1, [Bearing(z, 1e9, 1e9) for z in ENDS], 0.05)
    with pytest.raises(InputError, match=r"The wheel's shaft is free to slide"):
        assemble_structure(jg.Support(), loose, DISC, DISC, jnp.ones(()), jnp.ones(()))


def _refused(mount, body: RigidBody | BeamBody = DISC, housing=None):
    return assemble_structure(mount, jg.Support(), body, DISC, jnp.ones(()), jnp.ones(()), housing)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: RigidBody(0.0, 1e-3, 1e-3), r"`RigidBody\.mass` must be positive, got 0"),
        (lambda: RigidBody(1.0, 3e-3, 1e-3), r"at least half the polar inertia, .* exchanged"),
        (
            lambda: solid_disc(0.04, 0.05, 0.02, 7850.0),
            r"must be larger than its bore, got 0\.04 m",
        ),
        (lambda: Housing(np.eye(4)), r"rows S, T, Z of each bearing, got the shape \(4, 4\)"),
        (lambda: Housing(np.eye(3) + np.eye(3, k=1)), r"must be symmetric"),
        (lambda: Housing(np.diag([1.0, 1.0, -1e8])), r"positive definite, got .* -1e\+08"),
        (
            lambda: _refused(_overhung_shaft(), housing=Housing(np.eye(9))),
            r"each of the 2 bearings, the pinion's first, got the shape \(9, 9\)",
        ),
        (lambda: _refused(jg.Support(), housing=Housing(np.eye(3))), r"must have bearings to hold"),
        (
            lambda: _refused(jg.Support(), BeamBody(0.02, 0.08)),
            r"The pinion's body is a beam, which must be part of a shaft",
        ),
        (lambda: _refused(_overhung_shaft(), BeamBody(0.02, 0.08)), r"with `body_width`"),
    ],
)
def test_what_cannot_be_assembled_is_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()
