"""One beam: matrices against quadrature of its shapes, limits, rigid motions, shear coefficient."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient

import jaxgear as jg
from jaxgear._system._beam import (
    Beam,
    beam_gyroscopic,
    beam_mass,
    beam_shapes,
    beam_stiffness,
    cowper_coefficient,
)

# Stocky, so that bending and shear weigh alike.
TUBE = Beam(0.05, 0.06, 0.02, 0.7, jg.Material(206e9, 0.3, 7850.0))

_shapes = jax.jit(jax.vmap(beam_shapes, (None, 0)))
_slopes = jax.jit(jax.vmap(jax.jacfwd(beam_shapes, argnums=1), (None, 0)))


@eqx.filter_jit
def _matrices(beam):
    return beam_stiffness(beam), beam_mass(beam), beam_gyroscopic(beam)


@functools.cache
def _tube_matrices():
    return tuple(np.asarray(matrix) for matrix in _matrices(TUBE))


def _section(beam):
    """Area, second moment, shear modulus."""
    outer, inner = float(beam.outer), float(beam.inner)
    modulus = float(beam.material.young) / 2 / (1 + float(beam.material.poisson))
    area, second = np.pi / 4 * (outer**2 - inner**2), np.pi / 64 * (outer**4 - inner**4)
    return area, second, modulus


@functools.cache
def _by_quadrature():
    """Energies of the shapes: five points integrate the sixth degree exactly."""
    area, second, shear = _section(TUBE)
    young, density, length = 206e9, 7850.0, 0.05
    points, weights = np.polynomial.legendre.leggauss(5)
    points, weights = 0.5 * (points + 1), 0.5 * weights * length
    shapes = np.asarray(_shapes(TUBE, jnp.asarray(points)))
    slopes = np.asarray(_slopes(TUBE, jnp.asarray(points))) / length
    strains = slopes.copy()
    # dv/dz = psi and dw/dz = -phi where there is no shear.
    strains[:, 0] -= shapes[:, 4]
    strains[:, 1] += shapes[:, 3]
    sheared = 0.7 * shear * area
    rigidity = [sheared, sheared, young * area, young * second, young * second, 2 * shear * second]
    inertia = density * np.array([area, area, area, second, second, 2 * second])
    spin = np.zeros((6, 6))
    spin[3, 4], spin[4, 3] = 2 * density * second, -2 * density * second

    def integral(left, middle, right):
        return np.einsum("q,qai,ab,qbj->ij", weights, left, middle, right)

    return (
        integral(strains, np.diag(rigidity), strains),
        integral(shapes, np.diag(inertia), shapes),
        integral(shapes, spin, shapes),
    )


@pytest.mark.parametrize("which", [0, 1, 2])
def test_matrices_are_energies_of_the_shapes(which):
    expected, got = _by_quadrature()[which], _tube_matrices()[which]
    assert_close(got, expected, rtol=1e-11, atol=1e-14 * np.abs(expected).max())


def test_shapes_are_what_a_finer_beam_does():
    """Cut at three tenths: without a load there the cut moves as the shapes say."""
    first, second = (
        np.asarray(_matrices(eqx.tree_at(lambda b: b.length, TUBE, jnp.asarray(length)))[0])
        for length in (0.015, 0.035)
    )
    whole = np.zeros((18, 18))
    whole[:12, :12] += first
    whole[6:, 6:] += second
    ends = [*range(6), *range(12, 18)]
    expected = -np.linalg.solve(whole[6:12, 6:12], whole[6:12][:, ends])
    got = _shapes(TUBE, jnp.asarray([0.3]))[0]
    assert_close(got, expected, rtol=1e-11, atol=1e-14 * np.abs(expected).max())


def test_shapes_take_the_motion_of_the_ends():
    ends = np.asarray(_shapes(TUBE, jnp.asarray([0.0, 1.0]))).reshape(12, 12)
    assert_close(ends, np.eye(12), rtol=0.0, atol=1e-14)


def test_slender_limit_is_euler_bernoulli():
    """12, 6L, 4L2, 2L2 over L3, and 156, 22L, 54, -13L, 4L2, -3L2 over 420."""
    thread = Beam(1.0, 1e-4, 0.0, 1.0, jg.Material(206e9, 0.3, 7850.0))
    stiffness, mass, _ = (np.asarray(matrix) for matrix in _matrices(thread))
    area, second, _ = _section(thread)
    bending = stiffness[np.ix_([0, 4, 6, 10], [0, 4, 6, 10])] / (206e9 * second)
    expected = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    assert_close(bending, np.array(expected, dtype=float), rtol=1e-6, atol=0.0)
    moving = mass[np.ix_([0, 4, 6, 10], [0, 4, 6, 10])] / (7850.0 * area) * 420
    expected = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    assert_close(moving, np.array(expected, dtype=float), rtol=1e-6, atol=0.0)


def _rigid_motions(heights):
    """Three translations and three rotations about the origin, of nodes along Z."""
    motions = np.zeros((6 * len(heights), 6))
    for node, height in enumerate(heights):
        motions[6 * node : 6 * node + 6] = np.eye(6)
        motions[6 * node, 4], motions[6 * node + 1, 3] = height, -height
    return motions


def test_rigid_motions_take_no_load():
    stiffness, *_ = _tube_matrices()
    motions = _rigid_motions([0.3, 0.35])
    loads = stiffness @ motions
    assert np.abs(loads).max() < 1e-14 * np.abs(stiffness).max()
    # Nothing else is free: six of twelve.
    assert np.linalg.matrix_rank(stiffness / np.abs(stiffness).max(), tol=1e-9) == 6


def test_rigid_motions_have_the_momentum_of_a_tube():
    _, mass, gyroscopic = _tube_matrices()
    area, second, _ = _section(TUBE)
    whole, middle = 7850.0 * area * 0.05, 0.325
    across = 7850.0 * second * 0.05 + whole * (0.05**2 / 12 + middle**2)
    expected = np.diag([whole, whole, whole, across, across, 7850.0 * 2 * second * 0.05])
    expected[0, 4] = expected[4, 0] = whole * middle
    expected[1, 3] = expected[3, 1] = -whole * middle
    motions = _rigid_motions([0.3, 0.35])
    assert_close(motions.T @ mass @ motions, expected, rtol=1e-12, atol=1e-15)
    # Spinning, a whole tube resists turning over as a disc of its polar inertia.
    spin = np.zeros((6, 6))
    spin[3, 4], spin[4, 3] = expected[5, 5], -expected[5, 5]
    assert_close(motions.T @ gyroscopic @ motions, spin, rtol=1e-12, atol=1e-16)


def test_gyroscopic_matrix_does_no_work():
    *_, gyroscopic = _tube_matrices()
    assert np.abs(gyroscopic + gyroscopic.T).max() == 0.0
    assert np.abs(gyroscopic).max() > 0.0


def test_short_beam_is_a_disc():
    """As the length goes, only the sections' own inertia is left at its two nodes."""
    disc = eqx.tree_at(lambda b: b.length, TUBE, jnp.asarray(1e-7))
    *_, gyroscopic = _matrices(disc)
    _, second, _ = _section(TUBE)
    expected = 2 * 7850.0 * second * 1e-7
    ends = np.asarray(gyroscopic)[np.ix_([3, 9], [4, 10])]
    assert_close(ends.sum(), expected, rtol=1e-9, atol=0.0)
    # All sections follow the ends in shear, without a turn of their own: thirds and sixths.
    assert_close(ends / expected, np.array([[2.0, 1.0], [1.0, 2.0]]) / 6, rtol=1e-9, atol=0.0)


@pytest.mark.parametrize("poisson", [0.0, 0.3])
def test_shear_coefficient_of_solid_and_thin_tubes(poisson):
    """6(1+nu)/(7+6nu) = 0.886 and 2(1+nu)/(4+3nu) = 0.531 for steel."""
    ratios = jnp.asarray([0.0, 1.0])
    got = cowper_coefficient(jnp.ones(2), ratios, jnp.full(2, poisson))
    solid, thin = 6 * (1 + poisson) / (7 + 6 * poisson), 2 * (1 + poisson) / (4 + 3 * poisson)
    assert_close(got, np.array([solid, thin]), rtol=1e-14, atol=0.0)
    between = cowper_coefficient(jnp.asarray(0.06), jnp.asarray(0.02), jnp.asarray(0.3))
    # m = 1/3, nu = 0.3: 7.8 (10/9)^2 / (8.8 (10/9)^2 + 23.6/9) = 9.6296 / 13.4864.
    assert_close(between, 0.71402, rtol=1e-5, atol=0.0)


@pytest.mark.slow
def test_every_number_of_a_beam_has_a_derivative():
    assert len(jax.tree.leaves(eqx.filter(TUBE, eqx.is_inexact_array))) == 7
    weights = jnp.asarray(np.random.default_rng(3).normal(size=(3, 12, 12)))
    sizes = [np.abs(matrix).max() for matrix in _tube_matrices()]

    def weighted(beam):
        matrices = (beam_stiffness(beam), beam_mass(beam), beam_gyroscopic(beam))
        parts = [
            jnp.sum(weight * matrix) / size
            for weight, matrix, size in zip(weights, matrices, sizes, strict=True)
        ]
        return jnp.sum(jnp.stack(parts))

    assert_gradient(weighted, TUBE, rtol=1e-7)
