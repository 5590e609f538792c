"""Damping matrices: ratios by hand, what they do not depend on, derivatives where modes meet."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from dynamics.cases import two_dof
from helpers import assert_close, assert_gradient

from jaxgear._checks import InputError
from jaxgear._dynamics._damping import (
    ModalDamping,
    RayleighDamping,
    damping_matrix,
    free_of,
)
from jaxgear._dynamics._system import modal_basis


@eqx.filter_jit
def _matrix(damping, mass, stiffness, mesh):
    return damping.matrix(jnp.asarray(mass), jnp.asarray(stiffness), jnp.asarray(mesh))


_free_of = jax.jit(free_of)


def _random(size=7, loaded=2, seed=3):
    """Mass, stiffness and mesh of a system without symmetry; the mesh has few coordinates."""
    draw = np.random.default_rng(seed)
    mass = draw.normal(size=(size, size))
    structure = draw.normal(size=(size, size))
    vectors = draw.normal(size=(size, loaded))
    mesh = 5e6 * vectors @ vectors.T
    mass = mass @ mass.T + size * np.eye(size)
    return mass, 1e6 * (structure @ structure.T + np.eye(size)) + mesh, mesh


def _gears():
    """Two gears that move across and turn, on springs equally stiff all round.

    Four modes have one frequency: either gear across the line of action, both along it together,
    and a bystander's.
    """
    mass = np.diag([2.0, 2.0, 3e-3, 5.0, 5.0, 2e-2, 1.0])
    ground = np.diag([8e7, 8e7, 2e5, 2e8, 2e8, 4e5, 4e7])
    angle = math.radians(26.0)
    line = np.array([math.sin(angle), math.cos(angle)])
    vector = np.array([*line, 0.03, *-line, 0.06, 0.0])
    return mass, ground, vector, 3e8


# --- Values


def test_rayleigh_ratios_of_the_thesis():
    """25 1/s and 2.5 us: 0.98 % at 1 kHz, 7.9 % at 10 kHz."""
    speed = 2.0 * np.pi * np.array([1e3, 1e4])
    mass = np.array([2.0, 0.5])
    got = _matrix(
        RayleighDamping(25.0, 2.5e-6), np.diag(mass), np.diag(mass * speed**2), np.zeros((2, 2))
    )
    ratio = np.diagonal(got) / (2.0 * mass * speed)
    assert_close(ratio, np.array([0.0098, 0.0790]), rtol=5e-3, atol=0.0)
    assert_close(got, np.diag(25.0 * mass + 2.5e-6 * mass * speed**2), rtol=1e-14, atol=1e-300)


def test_single_mass_on_the_mesh_and_a_spring():
    """2 xi sqrt(k m), the ratio between both by the share of the stiffness."""
    got = _matrix(ModalDamping(0.07, 0.01), [[3.0]], [[4e8]], [[1e8]])
    assert_close(
        got[0, 0], 2.0 * (0.25 * 0.07 + 0.75 * 0.01) * math.sqrt(3.0 * 4e8), rtol=1e-14, atol=0
    )


def test_composite_ratio_of_each_mode():
    """Against modes of another eigen-solver; modes do not exchange damping."""
    mass, stiffness, mesh = _random()
    got = _matrix(ModalDamping(0.09, 0.015), mass, stiffness, mesh)
    square, shape = scipy.linalg.eigh(stiffness, mass)
    share = np.diagonal(shape.T @ mesh @ shape) / square
    assert share.max() > 0.6
    assert share.min() < 0.01
    ratio = 0.09 * share + 0.015 * (1.0 - share)
    expected = np.diag(2.0 * ratio * np.sqrt(square))
    assert_close(shape.T @ got @ shape, expected, rtol=1e-11, atol=1e-11 * expected.max())
    assert_close(got, got.T, rtol=1e-14, atol=1e-10)


def _torsional(given):
    """Mass, stiffness under a spring that holds the rolling gears, mesh, and their rolling on."""
    inertia, radius, mesh_stiffness, hold = given
    mass, mesh = jnp.diag(inertia), mesh_stiffness * radius[:, None] * radius[None, :]
    rolling = jnp.stack([1.0 / radius[0], -1.0 / radius[1]])
    rolling = rolling / jnp.sqrt(rolling @ mass @ rolling)
    momentum = mass @ rolling
    return mass, mesh + hold * momentum[:, None] * momentum[None, :], mesh, rolling[:, None]


@pytest.mark.parametrize("hold", [1e-3, 1.0, 1e3])
def test_torsional_pair_is_damped_in_the_mesh_alone(hold):
    """C = 2 xi sqrt(k m_eq) v v^T; it costs nothing to roll on, held at whatever frequency.

    Also at that of the mesh, where both modes are any mixture of the two motions.
    """
    inertia, radius, mesh_stiffness = np.array([3e-3, 2e-2]), np.array([0.03, 0.06]), 3e8
    inverse = np.sum(radius**2 / inertia)
    numbers = (inertia, radius, mesh_stiffness, hold * mesh_stiffness * inverse)
    given = [jnp.asarray(x) for x in numbers]
    got = _without_rolling(given)
    expected = 0.14 * math.sqrt(mesh_stiffness / inverse) * np.outer(radius, radius)
    assert_close(got, expected, rtol=1e-10, atol=1e-10 * expected.max())


@jax.jit
def _without_rolling(given):
    return damping_matrix(ModalDamping(), *_torsional(given))


def test_derivatives_of_a_torsional_pair_held_at_the_frequency_of_its_mesh():
    inertia, radius = np.array([3e-3, 2e-2]), np.array([0.03, 0.06])
    hold = 3e8 * np.sum(radius**2 / inertia)
    given = [jnp.asarray(x) for x in (inertia, radius, 3e8, hold)]
    weight = jnp.array([[1.0, 0.7], [0.7, -2.0]])
    assert_gradient(lambda x: jnp.sum(weight * _without_rolling(x)), given, rtol=1e-7)


def test_equal_ratios_are_a_square_root_of_the_stiffness():
    """C M^-1 C = 4 xi^2 K, so nothing is left of the modes."""
    mass, stiffness, mesh = _random()
    got = np.asarray(_matrix(ModalDamping(0.03, 0.03), mass, stiffness, mesh))
    expected = 4.0 * 0.03**2 * stiffness
    assert_close(got @ np.linalg.solve(mass, got), expected, rtol=1e-9, atol=1e-10 * expected.max())


def test_damping_does_not_depend_on_coordinates_or_units():
    mass, stiffness, mesh = _random()
    damping = ModalDamping()
    got = np.asarray(_matrix(damping, mass, stiffness, mesh))
    change = np.random.default_rng(9).normal(size=mass.shape) + 3.0 * np.eye(mass.shape[0])
    turned = _matrix(damping, *(change.T @ x @ change for x in (mass, stiffness, mesh)))
    expected = change.T @ got @ change
    assert_close(turned, expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max())
    scaled = _matrix(damping, 9.0 * mass, 16.0 * stiffness, 16.0 * mesh)
    assert_close(scaled, 12.0 * got, rtol=1e-12, atol=1e-12 * np.abs(got).max())


def test_free_motions_run_on_and_the_rest_is_as_it_was():
    mass, stiffness, mesh = _random()
    _, shape = scipy.linalg.eigh(stiffness, mass)
    raw = _matrix(ModalDamping(), mass, stiffness, mesh)
    got = _free_of(raw, jnp.asarray(mass), jnp.asarray(shape[:, 1:3]))
    between = shape.T @ np.asarray(raw) @ shape
    between[1:3], between[:, 1:3] = 0.0, 0.0
    assert_close(shape.T @ got @ shape, between, rtol=1e-9, atol=1e-11 * between.max())
    none = _free_of(raw, jnp.asarray(mass), jnp.zeros((mass.shape[0], 0)))
    assert_close(none, raw, rtol=0.0, atol=1e-300)


# --- Derivatives


def test_derivatives_of_a_system_without_symmetry():
    mass, stiffness, mesh = _random()

    def weighted(given):
        mass, stiffness, vectors, damping = given
        mesh = vectors @ vectors.T
        # Symmetric, as every stiffness is.
        mass, stiffness = 0.5 * (mass + mass.T), 0.5 * (stiffness + stiffness.T)
        weight = jnp.asarray(np.random.default_rng(4).normal(size=mass.shape))
        return jnp.sum(weight * damping.matrix(mass, stiffness + mesh, mesh))

    vectors = np.linalg.cholesky(mesh + 1e-3 * np.eye(mesh.shape[0]))[:, :2]
    given = [jnp.asarray(x) for x in (mass, stiffness - mesh, vectors)]
    assert_gradient(weighted, [*given, ModalDamping()], rtol=1e-7)
    assert_gradient(weighted, [*given, RayleighDamping(30.0, 2e-6)], rtol=1e-7)


def test_derivatives_where_unloaded_modes_meet():
    """Springs move apart all round, and tie gears to each other: modes that met mix and part."""
    mass, ground, vector, stiffness = _gears()
    scale = np.sqrt(np.diagonal(ground) + stiffness * vector**2)
    scale[-1] = math.sqrt(ground[-1, -1])

    def weighted(given):
        tied, mass, vector, stiffness, damping = given
        tied = 0.5 * (tied + tied.T) * jnp.asarray(scale[:, None] * scale[None, :])
        mesh = stiffness * vector[:, None] * vector[None, :]
        structure = jnp.asarray(ground) + tied
        weight = np.random.default_rng(4).normal(size=ground.shape) / (scale[:, None] * scale)
        return jnp.sum(jnp.asarray(weight) * damping.matrix(mass, structure + mesh, mesh))

    given = [
        jnp.zeros_like(jnp.asarray(ground)),
        jnp.asarray(mass),
        jnp.asarray(vector),
        jnp.asarray(stiffness),
        ModalDamping(),
    ]
    whole = ground + stiffness * np.outer(vector, vector)
    square = scipy.linalg.eigvalsh(whole, mass)
    gaps = np.diff(square) / square[1:]
    assert (gaps < 1e-12).sum() == 3
    # The mass of degrees of freedom apart is zero, and stays so in proportion to the largest.
    sizes = [jnp.asarray(1.0), jnp.asarray(1e-3), *given[2:]]
    assert_gradient(weighted, given, rtol=1e-7, step=1e-5, scale=sizes)


def test_no_derivative_where_modes_meet_in_the_mesh():
    """Two equal masses, each on its own mesh: mixtures are modes too, and share otherwise."""
    mass, whole = jnp.eye(2), 1e6 * jnp.eye(2)

    @jax.jit
    def slope(ratio, mesh, change):
        damping = ModalDamping(ratio, 0.02)
        return jax.jvp(lambda x: damping.matrix(mass, x, mesh), (whole,), (change,))[1]

    change = jnp.array([[1.0, 0.3], [0.3, 2.0]])
    met = slope(0.07, jnp.diag(jnp.array([4e5, 1e5])), change)
    assert np.isnan(np.asarray(met)).any()
    # With one ratio for all it is the slope of a square root, whatever the mesh carries.
    expected = 0.02 * np.asarray(change) / 1e3
    assert_close(
        slope(0.02, jnp.diag(jnp.array([4e5, 1e5])), change), expected, rtol=1e-12, atol=0.0
    )
    # Nor does it matter where the mesh carries nothing.
    assert_close(slope(0.07, jnp.zeros((2, 2)), change), expected, rtol=1e-12, atol=0.0)


def test_ratios_have_derivatives_where_modes_meet():
    """C is linear in the ratios."""
    mass, ground, vector, stiffness = _gears()
    mesh = stiffness * np.outer(vector, vector)
    given = [jnp.asarray(x) for x in (mass, ground + mesh, mesh)]
    slope = jax.jit(jax.jacfwd(lambda d: d.matrix(*given)))(ModalDamping(0.05, 0.01))
    for ratios, got in (((1.0, 0.0), slope.mesh), ((0.0, 1.0), slope.structure)):
        near = [_matrix(ModalDamping(*(0.5 * x for x in ratios)), *given)]
        expected = 2.0 * np.asarray(near[0])
        assert_close(got, expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max())


# --- Modes that share it


def _held_system(damping, fast=5e8, size=40):
    """A free motion held by a spring and a damper of no meaning, the others damped as given."""
    mass, stiffness, _ = _random(size)
    free = np.ones(size) / math.sqrt(np.ones(size) @ mass @ np.ones(size))
    momentum = mass @ free
    project = np.eye(size) - np.outer(free, momentum)
    loose = project.T @ stiffness @ project
    hold = np.outer(momentum, momentum)
    matrices = {
        "mass": mass,
        "damping": project.T @ damping(mass, loose) @ project + fast * hold,
        "stiffness": loose + fast**2 * hold,
        "vectors": np.zeros((size, 2)),
        "load": np.zeros(size),
        "transmission": np.zeros(size),
        "free": free[:, None],
    }
    given = {name: jnp.asarray(value) for name, value in matrices.items()}
    square = scipy.linalg.eigvalsh(loose, mass)
    return dataclasses.replace(two_dof(), **given), square[1:]


@pytest.mark.parametrize("factor", [1e-10, 1e-6])
def test_a_fast_hold_does_not_drown_what_hardly_damps(factor):
    """Rounding of the hold's damper is larger than the damping of the slowest modes."""
    system, square = _held_system(lambda mass, stiffness: factor * stiffness)
    basis = jax.jit(modal_basis)(system)
    assert_close(basis.square[:-1], square, rtol=1e-4, atol=1e-15 * 5e8**2)
    assert_close(basis.damping[:-1], factor * square, rtol=1e-4, atol=1e-14 * 5e8)


def test_modes_that_exchange_damping_are_refused_behind_a_hold():
    mixing = np.diag(np.arange(40.0))
    system, _ = _held_system(lambda mass, stiffness: mixing)
    with pytest.raises(InputError, match="exchanges energy between modes"):
        modal_basis(system)
    assert np.isnan(np.asarray(jax.jit(modal_basis)(system).damping)).all()


# --- Refusals


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: RayleighDamping(-1.0, 0.0), r"`RayleighDamping\.mass_factor` .* got -1 1/s"),
        (lambda: RayleighDamping(0.0, -1e-6), r"`RayleighDamping\.stiffness_factor` .* -1e-06 s"),
        (lambda: RayleighDamping(math.nan, 0.0), r"must not be negative, got nan"),
        (lambda: ModalDamping(mesh=7.0), r"`ModalDamping\.mesh` .* below 1, got 7\."),
        (lambda: ModalDamping(structure=-0.01), r"`ModalDamping\.structure` .* got -0\.01"),
        (lambda: ModalDamping(math.nan), r"`ModalDamping\.mesh` must be at least 0"),
    ],
)
def test_what_cannot_be_built_is_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()
