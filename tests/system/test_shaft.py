"""A stepped shaft: layout, statics and vibration against closed forms, refusals."""

import functools
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from helpers import assert_close, assert_gradient, observed_order

import jaxgear as jg
from jaxgear._checks import InputError
from jaxgear._system._gear_body import BeamBody
from jaxgear._system._shaft import Shaft, node_heights
from jaxgear._system._shaft_parts import Bearing, Segment, ShaftLoad

YOUNG, SHEAR, DENSITY = 206e9, 206e9 / 2.6, 7850.0

_matrices = eqx.filter_jit(
    lambda shaft, body=None: shaft.matrices(None if body is None else body.piece)
)


def _area(outer, inner=0.0):
    return math.pi / 4 * (outer**2 - inner**2)


def _second(outer, inner=0.0):
    return math.pi / 64 * (outer**4 - inner**4)


def _ends(length):
    return (Bearing(0.0, 1e9, 1e9, 1e8), Bearing(length, 1e9, 1e9))


def _stepped(**options):
    """Two sections, gear between the torque and the second bearing, loads at both ends."""
    return Shaft(
        [Segment(0.06, 0.03, 0.01), Segment(0.04, 0.05, 0.02)],
        [Bearing(0.02, 1e9, 2e9, 1e8), Bearing(0.09, 3e9, 4e9, 0.0, 1e4, 2e4)],
        0.07,
        0.01,
        [ShaftLoad(0.03, (1.0, 2.0, 3.0)), ShaftLoad(0.095, moment=(4.0, 5.0, 6.0))],
        **options,
    )


# --- Layout


def test_nodes_lie_in_order_and_have_names():
    shaft = _stepped()
    assert dict(shaft.layout.nodes) == {
        "left end": 0,
        "torque": 1,
        "bearing 0": 2,
        "load 0": 3,
        "end of segment 0": 4,
        "gear": 5,
        "bearing 1": 6,
        "load 1": 7,
        "right end": 8,
    }
    expected = np.array([0.0, 0.01, 0.02, 0.03, 0.06, 0.07, 0.09, 0.095, 0.1])
    assert_close(node_heights(shaft), expected, rtol=1e-15, atol=1e-17)
    assert shaft.layout.segments == (0, 0, 0, 0, 1, 1, 1, 1)


def test_points_in_one_place_share_the_node_of_the_first_in_rank():
    """Bearing, gear, torque, load, end of segment; a nanometre does not part them."""
    shaft = Shaft(
        [Segment(0.05, 0.03), Segment(0.05, 0.04)],
        _ends(0.1),
        0.05 + 5e-10,
        0.05,
        [ShaftLoad(0.1)],
    )
    assert shaft.layout.owners == ("bearing 0", "gear", "bearing 1")
    nodes = shaft.layout.nodes
    assert nodes["gear"] == nodes["torque"] == nodes["end of segment 0"] == 1
    assert nodes["load 0"] == nodes["right end"] == nodes["bearing 1"] == 2

    def heights(gear_at, boundary):
        moved = eqx.tree_at(lambda s: (s.gear_at, s.segments[0].length), shaft, (gear_at, boundary))
        return node_heights(moved)

    at = (jnp.asarray(0.05), jnp.asarray(0.05))
    by_gear, by_boundary = jax.jit(jax.jacfwd(heights, argnums=(0, 1)))(*at)
    assert_close(by_gear, np.array([0.0, 1.0, 0.0]), rtol=0.0, atol=1e-15)
    # The right end belongs to its bearing too, so no node follows the segment.
    assert np.abs(np.asarray(by_boundary)).max() == 0.0


def test_divisions_cut_each_stretch_evenly():
    shaft = Shaft([Segment(0.1, 0.03)], _ends(0.1), 0.04, divisions=4)
    expected = np.concatenate([np.linspace(0, 0.04, 5), np.linspace(0.04, 0.1, 5)[1:]])
    assert_close(node_heights(shaft), expected, rtol=1e-14, atol=1e-17)
    assert shaft.layout.nodes["gear"] == shaft.layout.nodes["torque"] == 4
    assert shaft.layout.nodes["right end"] == 8


def test_beam_body_lies_between_two_nodes():
    shaft = Shaft([Segment(0.1, 0.03, 0.01)], _ends(0.1), 0.04, body_width=0.02, divisions=2)
    nodes = shaft.layout.nodes
    assert (nodes["gear left"], nodes["gear right"], nodes["right end"]) == (2, 3, 5)
    assert "gear" not in nodes
    assert "torque" not in nodes
    assert shaft.layout.torque_nodes == shaft.layout.gear_nodes == (2, 3)
    body = BeamBody(0.02, 0.08, jg.Material(100e9, 0.25, 5000.0))
    assert_close(node_heights(shaft, body)[2:4], np.array([0.03, 0.05]), rtol=1e-14, atol=0.0)
    matrices = _matrices(shaft, body)
    # Stretch between its nodes: only the body's own section and material.
    expected = 100e9 * _area(0.08, 0.01) / 0.02
    assert_close(-matrices.stiffness[14, 20], expected, rtol=1e-12, atol=0.0)
    whole = DENSITY * _area(0.03, 0.01) * 0.08 + 5000.0 * _area(0.08, 0.01) * 0.02
    axial = np.asarray(matrices.mass)[2::6, 2::6]
    assert_close(axial.sum(), whole, rtol=1e-12, atol=0.0)


def test_torque_at_mid_face_enters_at_both_ends_of_a_beam_body():
    shaft = Shaft([Segment(0.1, 0.03)], _ends(0.1), 0.04, 0.04, body_width=0.02)
    assert shaft.layout.torque_nodes == (1, 2)
    outside = Shaft([Segment(0.1, 0.03)], _ends(0.1), 0.04, 0.02, body_width=0.02)
    assert outside.layout.torque_nodes == (1,)


def test_shaft_is_rebuilt_under_tracing_with_its_layout():
    shaft = _stepped()

    def far_end(length, layout):
        segments = [Segment(length, 0.03, 0.01), shaft.segments[1]]
        built = Shaft(segments, shaft.bearings, 0.07, 0.01, shaft.loads, layout=layout)
        return node_heights(built)[-1]

    slope = jax.jit(jax.grad(lambda x: far_end(x, shaft.layout)))(0.06)
    assert_close(slope, 1.0, rtol=1e-14, atol=0.0)
    with pytest.raises(InputError, match=r"cannot be laid out .* `layout=built\.layout`"):
        jax.jit(lambda x: far_end(x, None))(0.06)


# --- Statics


def _clamped(matrices):
    """Flexibility of every node but the first, which is held."""
    return np.linalg.inv(np.asarray(matrices.stiffness)[6:, 6:])


def _cowper(outer, inner=0.0):
    square = (inner / outer) ** 2
    whole = (1 + square) ** 2
    return 7.8 * whole / (8.8 * whole + 23.6 * square)


@pytest.mark.parametrize("divisions", [1, 3])
def test_cantilever(divisions):
    """PL3/3EI + PL/kGA at the tip, whatever the number of elements."""
    length, outer, inner = 0.1, 0.06, 0.02
    shaft = Shaft([Segment(length, outer, inner)], _ends(length), length, divisions=divisions)
    tip = _clamped(_matrices(shaft))[-6:, -6:]
    bending, shear = YOUNG * _second(outer, inner), SHEAR * _area(outer, inner)
    across = length**3 / 3 / bending + length / (_cowper(outer, inner) * shear)
    turn, slope = length / bending, length**2 / 2 / bending
    twist = length / (2 * SHEAR * _second(outer, inner))
    stretch = length / (YOUNG * _area(outer, inner))
    expected = np.diag([across, across, stretch, turn, turn, twist])
    # A force along S turns it about T; one along T turns it the other way about S.
    expected[0, 4] = expected[4, 0] = slope
    expected[1, 3] = expected[3, 1] = -slope
    assert_close(tip, expected, rtol=1e-10, atol=1e-20)


def test_given_shear_coefficient():
    length, outer = 0.1, 0.06
    shaft = Shaft([Segment(length, outer)], _ends(length), length, shear_coefficient=0.9)
    across = _clamped(_matrices(shaft))[-6, -6]
    expected = length**3 / 3 / YOUNG / _second(outer) + length / (0.9 * SHEAR * _area(outer))
    assert_close(across, expected, rtol=1e-11, atol=0.0)


def test_stepped_cantilever():
    """Unit load: the sum over the sections of the integrals of M2/EI and Q2/kGA."""
    first, second = (0.06, 0.05, 0.02), (0.04, 0.03, 0.01)
    shaft = Shaft([Segment(*first), Segment(*second)], _ends(0.1), 0.1)
    flexibility = _clamped(_matrices(shaft))
    across = 0.0
    for (length, outer, inner), (near, far) in zip(
        (first, second), ((0.1, 0.04), (0.04, 0.0)), strict=True
    ):
        across += (near**3 - far**3) / 3 / (YOUNG * _second(outer, inner))
        across += length / (_cowper(outer, inner) * SHEAR * _area(outer, inner))
    assert_close(flexibility[-6, -6], across, rtol=1e-10, atol=0.0)
    # Maxwell and Betti, over all nodes.
    assert_close(flexibility, flexibility.T, rtol=1e-9, atol=1e-14 * np.abs(flexibility).max())


def test_simply_supported_at_mid_span():
    """PL3/48EI + PL/4kGA."""
    length, outer = 0.3, 0.05
    shaft = Shaft([Segment(length, outer)], _ends(length), length / 2)
    plane = [4, 6, 10, 16]
    stiffness = np.asarray(_matrices(shaft).stiffness)[np.ix_(plane, plane)]
    expected = length**3 / 48 / (YOUNG * _second(outer))
    expected += length / 4 / (_cowper(outer) * SHEAR * _area(outer))
    assert_close(np.linalg.inv(stiffness)[1, 1], expected, rtol=1e-10, atol=0.0)


def test_rigid_motions_of_the_whole_shaft_take_no_load():
    shaft = _stepped(divisions=2)
    stiffness = np.asarray(_matrices(shaft).stiffness)
    heights = np.asarray(node_heights(shaft))
    motions = np.tile(np.eye(6), (len(heights), 1))
    motions[0::6, 4], motions[1::6, 3] = heights, -heights
    assert np.abs(stiffness @ motions).max() < 1e-14 * np.abs(stiffness).max()


# --- Vibration


# The numbers by hand are of this steel.
LENGTH, OUTER, INNER = 0.4, 0.06, 0.02
PINNED = jg.Material(210e9, 0.3, 7800.0)


@functools.cache
def _pinned(divisions):
    """Plane matrices (S, about T) of a pinned tube, and the whole ones."""
    shaft = Shaft(
        [Segment(LENGTH, OUTER, INNER)],
        _ends(LENGTH),
        LENGTH,
        shear_coefficient=0.9,
        material=PINNED,
        divisions=divisions,
    )
    return tuple(
        np.asarray(matrix) for matrix in jax.tree.leaves(eqx.filter(_matrices(shaft), eqx.is_array))
    )


def _frequencies(divisions):
    stiffness, mass, _ = _pinned(divisions)
    size = stiffness.shape[0]
    plane = sorted({*range(0, size, 6), *range(4, size, 6)} - {0, size - 6})
    pick = np.ix_(plane, plane)
    squares = np.asarray(scipy.linalg.eigh(stiffness[pick], mass[pick], eigvals_only=True))
    return np.sqrt(squares[:4]) / 2 / np.pi


def _whirl(order, spin):
    """Exact whirl speeds of a pinned Timoshenko shaft, rising: sine deflection, cosine rotation.

    With chi = psi - i phi: I chi'' - 2 i I Omega chi' on top of bending and shear.
    """
    area, second = _area(OUTER, INNER), _second(OUTER, INNER)
    wave, shear = order * np.pi / LENGTH, 0.9 * 210e9 / 2.6 * area
    inertia = 7800.0 * second
    across = np.array([-7800.0 * area, 0.0, shear * wave**2])
    turn = np.array([-inertia, 2 * inertia * spin, 210e9 * second * wave**2 + shear])
    whole = np.polymul(across, turn)
    whole[-1] -= (shear * wave) ** 2
    return np.sort(np.roots(whole).real)


def test_frequencies_of_a_pinned_tube():
    """Physics A5: D 60, d 20, L 400 mm, 16 elements; and the exact ones they tend to."""
    assert_close(_frequencies(16), np.array([782.61, 2906.5, 5935.4, 9524.0]), rtol=2e-5, atol=0.0)
    exact = np.array([_whirl(order, 0.0)[2] for order in (1, 2, 3, 4)]) / 2 / np.pi
    assert_close(exact, np.array([782.56, 2903.8, 5913.4, 9435.9]), rtol=2e-5, atol=0.0)


def test_frequencies_converge_to_the_exact_ones():
    exact = np.array([_whirl(order, 0.0)[2] for order in (1, 2)]) / 2 / np.pi
    counts = [8, 16, 32]
    errors = np.array([_frequencies(count)[:2] / exact - 1 for count in counts])
    # From above, as of every consistent mass. Static shapes shear more the shorter the element,
    # which leaves the second order, not the fourth of beams without shear.
    assert (errors > 0).all()
    for error in errors.T:
        assert 1.95 < observed_order(1 / np.asarray(counts), error) < 2.1


def test_spin_parts_the_whirls():
    """A spinning pinned tube against the exact forward and backward whirl, 6000 rad/s."""
    spin = 6000.0
    stiffness, mass, gyroscopic = _pinned(32)
    size = stiffness.shape[0]
    lateral = {i for i in range(size) if i % 6 in (0, 1, 3, 4)}
    keep = sorted(lateral - {0, 1, size - 6, size - 5})
    pick = np.ix_(keep, keep)
    stiffness, mass, gyroscopic = stiffness[pick], mass[pick], spin * gyroscopic[pick]
    none = np.zeros_like(mass)
    held = np.block([[none, np.eye(len(keep))], [-stiffness, -gyroscopic]])
    moved = np.block([[np.eye(len(keep)), none], [none, mass]])
    speeds: Any = scipy.linalg.eigvals(held, moved)
    assert np.abs(speeds.real).max() < 1e-6 * np.abs(speeds.imag).max()
    got = np.sort(speeds.imag[speeds.imag > 0])[:2]
    slow, fast = np.sort(np.abs(_whirl(1, spin)))[:2]
    assert fast / slow > 1.03
    assert_close(got, np.array([slow, fast]), rtol=2e-5, atol=0.0)


# --- Derivatives


@pytest.mark.slow
def test_every_number_of_a_shaft_has_a_derivative():
    shaft = _stepped(shear_coefficient=0.8)
    weights = jnp.asarray(np.random.default_rng(5).normal(size=(3, 54, 54)))

    def weighted(shaft):
        matrices = shaft.matrices()
        return (
            1e-9 * jnp.sum(weights[0] * matrices.stiffness)
            + jnp.sum(weights[1] * matrices.mass)
            + 1e3 * jnp.sum(weights[2] * matrices.gyroscopic)
        )

    # Stiffnesses of bearings and loads do not enter; everything that has a place does.
    def places(shaft):
        return jax.tree.leaves(
            [
                shaft.segments,
                [bearing.at for bearing in shaft.bearings],
                [shaft.gear_at, shaft.torque_at, [load.at for load in shaft.loads]],
                [shaft.shear_coefficient, shaft.material],
            ]
        )

    def moved(values):
        return weighted(eqx.tree_at(places, shaft, values))

    leaves = places(shaft)
    assert len(leaves) == 16
    assert_gradient(moved, leaves, rtol=1e-6, step=1e-6)


# --- Refusals


ROD = (Segment(0.1, 0.03),)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Segment(0.0, 0.03), r"`Segment\.length` must be positive, got 0 m"),
        (lambda: Segment(-0.1, 0.03), r"`Segment\.length` must be positive, got -0\.1 m"),
        (lambda: Segment(math.nan, 0.03), r"`Segment\.length` must be positive"),
        (lambda: Segment(0.1, 0.03, 0.03), r"got 0\.03 m outside and 0\.03 m inside"),
        (lambda: Segment(0.1, 0.03, 0.04), r"`Segment\.outer` must exceed `Segment\.inner`"),
        (lambda: Segment(0.1, 0.03, -0.01), r"`Segment\.inner` must not be negative"),
        (lambda: Bearing(0.0, -1e9), r"`Bearing\.radial_s` must not be negative, got -1e\+09"),
        (lambda: Bearing(0.0, tilt_t=-1.0), r"`Bearing\.tilt_t` must not be negative"),
        (lambda: ShaftLoad(0.0, (1.0, 2.0)), r"`ShaftLoad\.force` must have the three components"),
        (lambda: BeamBody(0.02, 0.0), r"`BeamBody\.outer` must be positive"),
        (lambda: Shaft((), _ends(0.1), 0.0), r"must have a segment, got none"),
        (lambda: Shaft(ROD, (), 0.05), r"must have a bearing, got none\. .* `Support`"),
        (
            lambda: Shaft(ROD, _ends(0.11), 0.05),
            r"bearing 1 of a shaft must lie on it, between 0 and 0\.1 m .* got 0\.11 m",
        ),
        (lambda: Shaft(ROD, _ends(0.1), 55.0), r"gear of a shaft .* got 55 m"),
        (lambda: Shaft(ROD, _ends(0.1), 0.05, -0.01), r"torque of a shaft .* got -0\.01 m"),
        (
            lambda: Shaft(ROD, _ends(0.1), 0.05, None, [ShaftLoad(0.0), ShaftLoad(0.2)]),
            r"load 1 of a shaft .* got 0\.2 m",
        ),
        (
            lambda: Shaft(ROD, _ends(0.1), 0.05, shear_coefficient=1.2),
            r"`Shaft\.shear_coefficient` must lie between 0 and 1, got 1\.2",
        ),
        (lambda: Shaft(ROD, _ends(0.1), 0.05, divisions=0), r"at least one element, got 0"),
        (
            lambda: Shaft(ROD, _ends(0.1), 0.005, body_width=0.02),
            r"face of a gear .* between 0 and 0\.1 m, got -0\.005 to 0\.015 m",
        ),
        (
            lambda: Shaft(ROD, _ends(0.1), 0.05, 0.055, body_width=0.02),
            r"nothing between the ends of its face, 0\.04 to 0\.06 m, but the torque is at 0\.055",
        ),
        (
            lambda: Shaft([*ROD, *ROD], _ends(0.2), 0.105, body_width=0.02),
            r"but the end of segment 0 is at 0\.1 m",
        ),
        (
            lambda: Shaft(ROD, [*_ends(0.1), Bearing(0.05)], 0.05, body_width=0.02),
            r"but the bearing 2 is at 0\.05 m",
        ),
        (
            lambda: Shaft([Segment(0.1, 0.03, 0.02)], _ends(0.1), 0.05, body_width=0.02).matrices(
                BeamBody(0.02, 0.02).piece
            ),
            r"`BeamBody\.outer` must exceed the shaft's inner diameter there, 0\.02 m, got 0\.02 m",
        ),
        (
            lambda: node_heights(Shaft(ROD, _ends(0.1), 0.05), BeamBody(0.02, 0.08)),
            r"laid out for the body that it carries",
        ),
    ],
)
def test_what_cannot_be_built_is_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()


@pytest.mark.slow
def test_points_that_change_places_are_refused():
    shaft = Shaft(ROD, _ends(0.1), 0.05, 0.06)
    moved = eqx.tree_at(lambda s: s.gear_at, shaft, jnp.asarray(0.07))
    with pytest.raises(InputError, match=r"keep the order .* bearing 0, gear, torque, bearing 1"):
        node_heights(moved)
