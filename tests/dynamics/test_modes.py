"""Modes by hand and against closed forms; derivatives apart, near and at crossings; whirl."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from helpers import assert_close, assert_gradient, observed_order, quick

import jaxgear as jg
from jaxgear._checks import InputError
from jaxgear._dynamics._damping import ModalDamping
from jaxgear._dynamics._modes import (
    critical_speeds,
    modes,
    rotating_frequencies,
    stiffness_parts,
)
from jaxgear._system._gear_body import RigidBody
from jaxgear._system._housing import Housing
from jaxgear._system._shaft import Shaft
from jaxgear._system._shaft_parts import Bearing, Segment
from jaxgear._system._structure import assemble_structure

TURN = 2.0 * math.pi
DISC = RigidBody(2.0, 3e-3, 2e-3)


@eqx.filter_jit
def _modes(mass, stiffness, mesh=None, free=None, parts=(), damping=None, meet=1e-6):
    size = np.shape(mass)[0]
    return modes(
        jnp.asarray(mass),
        jnp.asarray(stiffness),
        jnp.zeros((size, size)) if mesh is None else jnp.asarray(mesh),
        jnp.zeros((size, 0)) if free is None else jnp.asarray(free),
        parts,
        damping,
        meet=meet,
    )


_assembled = eqx.filter_jit(assemble_structure)


def _between(size, *ends):
    """A unit spring between two degrees of freedom, or one and the ground."""
    along = np.zeros(size)
    along[list(ends)] = (1.0, -1.0)[: len(ends)]
    return np.outer(along, along)


def _random(size=6, seed=8):
    draw = np.random.default_rng(seed)
    mass, stiffness = draw.normal(size=(2, size, size))
    return mass @ mass.T + size * np.eye(size), 1e6 * (stiffness @ stiffness.T + np.eye(size))


# --- By hand


def test_one_mass_between_two_springs():
    """sqrt(k/m), energy by stiffness, ratio c/2 sqrt(km)."""
    got = _modes(
        np.array([[2.0]]),
        np.array([[8e6]]),
        np.array([[6e6]]),
        parts=[("ground", jnp.array([[2e6]]))],
        damping=jnp.array([[80.0]]),
    )
    assert_close(got.frequency, np.array([2000.0 / TURN]), rtol=1e-14, atol=0.0)
    assert_close(got.share("mesh"), np.array([0.75]), rtol=1e-14, atol=0.0)
    assert_close(got.share("ground"), np.array([0.25]), rtol=1e-14, atol=0.0)
    assert_close(got.damping_ratio, np.array([0.01]), rtol=1e-14, atol=0.0)
    assert_close(np.abs(got.shape), np.array([[math.sqrt(0.5)]]), rtol=1e-14, atol=0.0)
    assert not got.crossing.any()


def test_two_masses_on_three_springs():
    """Together at sqrt(k/m), against each other at sqrt(3k/m), with two thirds in the middle."""
    left, middle, right = (5e6 * _between(2, *ends) for ends in ((0,), (0, 1), (1,)))
    parts = [("left", jnp.asarray(left)), ("right", jnp.asarray(right))]
    got = _modes(0.2 * np.eye(2), left + middle + right, middle, parts=parts)
    expected = np.sqrt([5e6 / 0.2, 15e6 / 0.2]) / TURN
    assert_close(got.frequency, expected, rtol=1e-14, atol=0.0)
    assert_close(got.mesh, np.array([0.0, 2.0 / 3.0]), rtol=1e-14, atol=1e-15)
    sixth = np.array([0.5, 1.0 / 6.0])
    assert_close(got.parts, np.stack([sixth, sixth]), rtol=1e-14, atol=0.0)


@pytest.mark.parametrize("hold", ["on its momentum", "on one mass"])
def test_free_motion_is_left_out_whatever_holds_it(hold):
    """Three masses in a chain: sqrt(k/m) and sqrt(3k/m) beside the motion as a whole."""
    mass, spring = 0.5, 2e6
    chain = spring * (_between(3, 0, 1) + _between(3, 1, 2))
    whole = np.ones((3, 1)) / math.sqrt(3.0 * mass)
    held = 1e7 * (mass * whole) @ (mass * whole).T if "mom" in hold else 1e6 * _between(3, 0)
    inner = jnp.asarray(spring * _between(3, 0, 1))
    parts = [("first", inner), ("second", jnp.asarray(chain) - inner)]
    got = _modes(mass * np.eye(3), chain + held, None, whole, parts)
    expected = np.sqrt([spring / mass, 3.0 * spring / mass]) / TURN
    assert_close(got.frequency, expected, rtol=1e-11, atol=0.0)
    assert_close(got.parts, np.full((2, 2), 0.5), rtol=1e-11, atol=0.0)
    assert np.abs(whole.T @ got.shape).max() < 1e-9


def test_modes_are_orthogonal_and_diagonalise():
    mass, stiffness = _random()
    got = _modes(mass, stiffness)
    shape = np.asarray(got.shape)
    assert_close(shape.T @ mass @ shape, np.eye(6), rtol=1e-12, atol=1e-12)
    square = scipy.linalg.eigvalsh(stiffness, mass)
    assert_close(got.frequency, np.sqrt(square) / TURN, rtol=1e-11, atol=0.0)
    assert_close(shape.T @ stiffness @ shape, np.diag(square), rtol=1e-10, atol=1e-11 * square[-1])


def test_frequencies_scale_and_do_not_depend_on_coordinates():
    mass, stiffness = _random()
    mesh = 1e6 * _between(6, 1, 3)
    got = _modes(mass, stiffness + mesh, mesh)
    change = np.random.default_rng(2).normal(size=(6, 6)) + 3.0 * np.eye(6)
    new_mass, whole, new_mesh = (change.T @ x @ change for x in (mass, stiffness + mesh, mesh))
    turned = _modes(new_mass, whole, new_mesh)
    assert_close(turned.frequency, got.frequency, rtol=1e-9, atol=0.0)
    assert_close(turned.mesh, got.mesh, rtol=1e-8, atol=1e-10)
    scaled = _modes(4.0 * mass, 9.0 * (stiffness + mesh), 9.0 * mesh)
    assert_close(scaled.frequency, 1.5 * got.frequency, rtol=1e-11, atol=0.0)
    assert_close(scaled.mesh, got.mesh, rtol=1e-9, atol=1e-12)


def test_ratio_of_each_mode_is_the_composite_one():
    mass, structure = _random()
    mesh = 3e7 * _between(6, 1, 3)

    @jax.jit
    def found(mass, structure, mesh):
        damping = ModalDamping(0.08, 0.01).matrix(mass, structure + mesh, mesh)
        free = jnp.zeros((6, 0))
        return modes(mass, structure + mesh, mesh, free, [("rest", structure)], damping)

    got = found(*(jnp.asarray(x) for x in (mass, structure, mesh)))
    assert got.mesh.max() > 0.5
    assert_close(got.mesh + got.share("rest"), np.ones(6), rtol=1e-12, atol=0.0)
    expected = 0.08 * got.mesh + 0.01 * (1.0 - got.mesh)
    assert_close(got.damping_ratio, expected, rtol=1e-11, atol=0.0)


def test_critical_speeds():
    """A mode at 4500 Hz under 45 teeth: 100 turns a second, 50 by the second harmonic."""
    got = critical_speeds(jnp.array([4500.0, 900.0]), 45, (1, 2, 5))
    expected = TURN * np.array([[100.0, 50.0, 20.0], [20.0, 10.0, 4.0]])
    assert_close(got, expected, rtol=1e-14, atol=0.0)


# --- Derivatives


def _pair_of_springs(given):
    """Two equal masses of their own springs, and a spring between; a third one apart."""
    first, second, between, mass = given
    diagonal = jnp.stack([first + between, second + between, 7.0 * first])
    tie = between * jnp.asarray([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return mass * jnp.eye(3), jnp.diag(diagonal) - tie


def _found(given):
    mass, stiffness = _pair_of_springs(given)
    first = jnp.diag(jnp.stack([given[0], jnp.zeros(()), jnp.zeros(())]))
    free = jnp.zeros((3, 0))
    return modes(mass, stiffness, 0.2 * stiffness, free, [("first", first)], first, meet=1e-4)


def _energies(got):
    """All that does not depend on the vectors of modes that meet, of one size."""
    return jnp.stack([got.frequency / 1e2, got.parts[0], 1e-3 * got.damping_ratio, got.mesh])


def _weighted(given):
    """A number that all results have a part in; where modes meet, each of them the same one."""
    numbers, apart = given
    got = _found(numbers)
    weights = jnp.asarray(np.random.default_rng(12).normal(size=(5, 3)))
    second = jnp.where(apart, weights[:, 1], weights[:, 0])
    weights = weights.at[:, 1].set(second)
    # The sign of a shape is anybody's.
    shapes = jnp.where(apart, jnp.sum(weights[4] * got.shape[0] * got.shape[1]), 0.0)
    return jnp.sum(weights[:4] * _energies(got)) + shapes


def _pair(*numbers, apart):
    return [jnp.asarray(x) for x in numbers], jnp.asarray(apart)


def test_derivatives_of_separate_modes():
    assert_gradient(_weighted, _pair(1e6, 1.3e6, 2e5, 2.0, apart=True), rtol=1e-8)


def test_derivatives_near_a_crossing_are_each_modes_own():
    """Frequencies 1e-3 apart: curves bend within that distance, and steps are shorter."""
    given = _pair(1e6, 1.001e6, 5e2, 2.0, apart=True)
    assert_gradient(_weighted, given, rtol=1e-5, step=1e-6)


@pytest.mark.slow
def test_derivatives_at_a_crossing_are_those_of_the_modes_that_meet_together():
    """Which have one, whichever way the modes part; each mode is given the same."""
    # Steps are so short that the modes still count as met.
    given = _pair(1e6, 1e6, 0.0, 2.0, apart=False)
    sizes = _pair(1e6, 1e6, 1e6, 2.0, apart=False)
    assert_gradient(_weighted, given, rtol=1e-6, step=1e-5, scale=sizes)

    @jax.jit
    def slopes(given):
        return jax.jacrev(lambda x: _energies(_found(x)))(given)

    for slope in slopes(given[0]):
        assert np.isfinite(np.asarray(slope)).all()
        assert_close(slope[:, 0] + 1.0, slope[:, 1] + 1.0, rtol=1e-12, atol=0.0)
    by_first, by_second, by_tie, by_mass = (np.asarray(x)[0, 0] for x in slopes(given[0]))
    # By hand: the mean of the squares is (k_1 + k_2 + 2 k_12) / 2 m.
    each = math.sqrt(0.5e6) / TURN / 1e2 / 2.0
    expected = each * np.array([0.5e-6, 0.5e-6, 1e-6, -0.5])
    assert_close(np.array([by_first, by_second, by_tie, by_mass]), expected, rtol=1e-10, atol=0.0)


def test_shares_at_a_crossing_do_not_depend_on_the_mixture():
    """Whatever vectors an eigen-solver picks: half of each of two equal masses."""
    mass, stiffness = 2.0 * np.eye(3), np.diag([1e6, 1e6, 7e6])
    first = np.diag([1e6, 0.0, 0.0])
    got = _modes(mass, stiffness, first, damping=jnp.asarray(first))
    assert list(np.asarray(got.crossing)) == [True, True, False]
    assert_close(got.mesh, np.array([0.5, 0.5, 0.0]), rtol=1e-12, atol=1e-15)
    ratio = 0.5 * 0.5 * math.sqrt(0.5e6)
    assert_close(got.damping_ratio, np.array([ratio, ratio, 0.0]), rtol=1e-12, atol=1e-12)
    apart = _modes(mass, stiffness + 1e-5 * first, first)
    assert not apart.crossing.any()
    assert_close(apart.mesh, np.array([0.0, 1.0, 0.0]), rtol=1e-4, atol=1e-9)
    joined = _modes(mass, stiffness + 1e-5 * first, first, meet=1e-4)
    assert_close(joined.mesh, np.array([0.5, 0.5, 0.0]), rtol=1e-4, atol=1e-9)


def test_shapes_that_meet_have_no_derivative_and_leave_the_others_theirs():
    given = [jnp.asarray(x) for x in (1e6, 1e6, 0.0, 2.0)]

    @jax.jit
    def slopes(given):
        """Of products of entries, whose signs are anybody's."""
        return jax.jacrev(lambda x: _found(x).shape[:2].prod(axis=0) + _found(x).shape[2] ** 2)(
            given
        )

    by_first, by_second, by_tie, by_mass = (np.asarray(x) for x in slopes(given))
    assert not np.isfinite(by_tie[:2]).any()
    # The third is 1/m, so -1/m^2 by the mass and nothing by any spring.
    third = np.array([by_first[2], by_second[2], by_tie[2], by_mass[2]])
    assert_close(third, np.array([0.0, 0.0, 0.0, -0.25]), rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_derivatives_without_the_free_motion():
    """Torsional pair: springs, inertias and radii; the free motion goes with the radii."""

    def frequency(given):
        inertia, radius, mesh_stiffness, hold = given
        rolling = jnp.stack([1.0 / radius[0], -1.0 / radius[1]])
        rolling = rolling / jnp.sqrt(jnp.sum(inertia * rolling**2))
        pushed = inertia * rolling
        mesh = mesh_stiffness * radius[:, None] * radius[None, :]
        held = mesh + hold * pushed[:, None] * pushed[None, :]
        got = modes(jnp.diag(inertia), held, mesh, rolling[:, None])
        return got.frequency[0] + 1e3 * got.mesh[0]

    numbers = ([3e-3, 2e-2], [0.03, 0.06], 3e8, 2e10)
    given = [jnp.asarray(x) for x in numbers]
    equivalent = 0.03**2 / 3e-3 + 0.06**2 / 2e-2
    expected = math.sqrt(3e8 * equivalent) / TURN + 1e3
    assert_close(eqx.filter_jit(frequency)(given), expected, rtol=1e-10, atol=0.0)
    assert_gradient(frequency, given, rtol=1e-7)
    assert abs(float(eqx.filter_jit(jax.grad(frequency))(given)[3])) * 2e10 < 1e-6 * expected


# --- Shafts


def _support(stiffness=5e7):
    return jg.Support(stiffness, stiffness, stiffness, stiffness * 1e-3)


@eqx.filter_jit
def _frequencies_of_tube(shaft):
    """Of torsion, free, and of bending, its ends pinned."""
    matrices = shaft.matrices()
    size = 6 * shaft.layout.count
    turns = np.arange(5, size, 6)
    mass, stiffness = (x[np.ix_(turns, turns)] for x in (matrices.mass, matrices.stiffness))
    spin = jnp.ones((turns.size, 1)) / jnp.sqrt(jnp.sum(mass))
    momentum = mass @ spin
    none = jnp.zeros_like(mass)
    free = modes(mass, stiffness + 1e8 * momentum @ momentum.T, none, spin)
    bends = np.array([i for i in range(size) if i % 6 in (0, 4) and i not in (0, size - 6)])
    mass, stiffness = (x[np.ix_(bends, bends)] for x in (matrices.mass, matrices.stiffness))
    pinned = modes(mass, stiffness, jnp.zeros_like(mass), jnp.zeros((bends.size, 0)))
    return free.frequency, pinned.frequency


@pytest.mark.slow
def test_frequencies_of_a_tube_converge_with_divisions():
    """Torsion of the free tube, n/2L sqrt(G/rho), and bending of the pinned one."""
    torsion = np.arange(1, 4) / (2 * 0.4) * math.sqrt(210e9 / 2.6 / 7800.0)
    bending = np.array([782.56, 2903.8])
    counts, errors = (6, 12, 24), []
    for count in counts:
        shaft = Shaft(
            [Segment(0.4, 0.06, 0.02)],
            [Bearing(0.0), Bearing(0.4)],
            0.2,
            shear_coefficient=0.9,
            material=jg.Material(210e9, 0.3, 7800.0),
            divisions=count // 2,
        )
        free, pinned = _frequencies_of_tube(shaft)
        errors.append(np.concatenate([free[:3] / torsion - 1.0, pinned[:2] / bending - 1.0]))
    errors = np.asarray(errors)
    assert np.abs(errors[-1]).max() < 0.01
    # Shear in elements whose shapes are those of statics: order two as well.
    for error in errors.T:
        assert 1.85 < observed_order(1 / np.asarray(counts), error) < 2.15


@functools.cache
def _structures():
    numbers = (jnp.ones(()), jnp.asarray(2.0))
    bearings = [Bearing(0.01, 2e8, 3e8, 1e8, 2e4, 1e4), Bearing(0.06, 5e8, 4e8)]
    shaft = Shaft([Segment(0.08, 0.03)], bearings, 0.04)
    draw = np.random.default_rng(1).normal(size=(12, 12))
    housing = Housing(1e8 * (draw @ draw.T + 5.0 * np.eye(12)))
    return {
        "shaft and support": _assembled(_support(), shaft, DISC, DISC, *numbers),
        "housing": _assembled(shaft, shaft, DISC, DISC, *numbers, housing),
    }


@pytest.mark.parametrize("name", quick(1, ["shaft and support", "housing"]))
def test_parts_of_a_structure_sum_to_it(name):
    structure = _structures()[name]
    parts = dict(eqx.filter_jit(lambda s: dict(stiffness_parts(s)))(structure))
    whole = np.asarray(structure.stiffness)
    total = np.sum([np.asarray(x) for x in parts.values()], axis=0)
    assert_close(total, whole, rtol=1e-15, atol=1e-16 * whole.max())
    pinion = structure.map.sizes[0]
    begins = {"pinion": 0, "wheel": pinion}
    for gear, begin in begins.items():
        shaft, bearings = (np.asarray(parts[f"{gear} {x}"]) for x in ("shaft", "bearings"))
        assert_close(bearings, bearings.T, rtol=1e-15, atol=1e-6)
        assert np.linalg.eigvalsh(shaft)[0] > -1e-9 * whole.max()
        size = structure.map.sizes[0 if gear == "pinion" else 1]
        outside = np.setdiff1d(np.arange(whole.shape[0]), begin + np.arange(size))
        assert np.abs(shaft[outside]).max(initial=0.0) == 0.0
        # Moved as a whole, a shaft is not strained, and its springs are.
        for direction in range(3):
            moved = np.zeros(whole.shape[0])
            moved[begin + direction : begin + size : 6] = 1.0
            assert abs(moved @ shaft @ moved) < 1e-9 * whole.max()
            strained = moved @ bearings @ moved
            assert_close(strained, moved @ whole @ moved, rtol=1e-6, atol=1e-5)


def test_housing_ties_the_bearings_and_either_gear_gets_the_work_of_its_own():
    structure = _structures()["housing"]
    parts = dict(eqx.filter_jit(lambda s: dict(stiffness_parts(s)))(structure))
    motion = np.random.default_rng(6).normal(size=structure.map.size)
    rows = (np.asarray(structure.map.bearings)[:, None] + np.arange(3)).ravel()
    force = np.asarray(structure.bearing_stiffness) @ motion[rows]
    about = (np.asarray(structure.map.bearings)[:, None] + np.arange(3, 5)).ravel()
    couple = np.asarray(structure.bearing_tilt).ravel() * motion[about]
    for gear, first in (("pinion", 0), ("wheel", 6)):
        work = motion[rows][first : first + 6] @ force[first : first + 6]
        work += motion[about][first * 2 // 3 :][:4] @ couple[first * 2 // 3 :][:4]
        got = motion @ np.asarray(parts[f"{gear} bearings"]) @ motion
        assert_close(got, work, rtol=1e-10, atol=0.0)


# --- Whirl


def test_tilting_disc_parts_into_forward_and_backward_whirl():
    r"""$I_d\omega^2 \mp I_p\Omega\omega - k = 0$, of the pinion alone; the other five stay."""
    structure = _structures()["shaft and support"]
    keep = np.arange(6)
    pick = np.ix_(keep, keep)
    mass, stiffness, spin = (
        jnp.asarray(np.asarray(x)[pick])
        for x in (structure.mass, structure.stiffness, structure.pinion_gyroscopic)
    )
    free = jnp.zeros((6, 1)).at[5, 0].set(1.0 / math.sqrt(3e-3))
    momentum = mass @ free
    held = stiffness + 1e7 * momentum @ momentum.T
    speeds = np.array([0.0, 800.0, -2500.0])
    got = rotating_frequencies(mass, held, spin, free, jnp.asarray(speeds))
    tilt, translation = 5e4, math.sqrt(5e7 / 2.0) / TURN
    for speed, found in zip(speeds, got, strict=True):
        half = 0.5 * 3e-3 * abs(speed) / 2e-3
        whirl = np.array([-half, half]) + math.sqrt(half**2 + tilt / 2e-3)
        expected = np.sort([*(whirl / TURN), *([translation] * 3)])
        assert_close(found, expected, rtol=1e-11, atol=0.0)


def test_at_rest_nothing_whirls_and_free_motions_are_left_out():
    mass, stiffness = _random()
    draw = np.random.default_rng(7).normal(size=(6, 6))
    spin = jnp.asarray(draw - draw.T)
    none = jnp.zeros((6, 0))
    at_rest = np.asarray(_modes(mass, stiffness).frequency)
    mass, stiffness = jnp.asarray(mass), jnp.asarray(stiffness)
    got = rotating_frequencies(mass, stiffness, spin, none, jnp.array([0.0, 300.0]))
    assert_close(got[0], at_rest, rtol=1e-9, atol=0.0)
    # Against the first-order form itself.
    eye = np.eye(6)
    flow = np.block(
        [[0 * eye, eye], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, 300.0 * spin)]]
    )
    roots = np.linalg.eigvals(flow)
    assert np.abs(roots.real).max() < 1e-9 * np.abs(roots.imag).max()
    assert_close(got[1], np.sort(roots.imag[roots.imag > 0]) / TURN, rtol=1e-9, atol=0.0)


# --- Refusals

EYE = jnp.eye(2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: _modes(np.eye(2), np.eye(2)).share("wheel"), r"split into mesh, got `wheel`"),
        (lambda: modes(EYE, EYE, EYE, jnp.zeros((2, 0)), meet=0.5), r"`meet` .* got 0\.5"),
        (lambda: critical_speeds(jnp.ones(1), 0), r"got 0 teeth"),
        (lambda: critical_speeds(jnp.ones(1), 20, ()), r"harmonics from 1 on, .* harmonics \(\)"),
        (lambda: critical_speeds(jnp.ones(1), 20, (0, 1)), r"the harmonics \(0, 1\)"),
        (
            lambda: rotating_frequencies(EYE, EYE, EYE, jnp.zeros((2, 0)), jnp.ones(1)),
            r"must be antisymmetric, got entries up to 1 that miss their mirror image by 2",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
