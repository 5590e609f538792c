"""Linear equations solved by products: the solution, what it costs, and where there is none."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fem_cases import assert_near

from jaxgear._dynamics._gmres import gmres


def _case(size: int, spread: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """A matrix near the unit matrix, as those of harmonic balance are, and a right-hand side."""
    rng = np.random.default_rng(size)
    matrix = np.eye(size) + spread * rng.normal(size=(size, size)) / np.sqrt(size)
    return matrix, rng.normal(size=size)


def _solved(matrix, right, left, blocks=8, anew=6):
    solve = jax.jit(lambda a, b: gmres(lambda x: a @ x, b, left, blocks=blocks, anew=anew))
    found, rest = solve(jnp.asarray(matrix), jnp.asarray(right))
    return np.asarray(found), np.asarray(rest)


# One direction, fewer than a block, just one and two blocks, and more than are kept.
@pytest.mark.parametrize("size", [1, 7, 16, 33, 300])
def test_the_solution_is_that_of_the_matrix(size):
    matrix, right = _case(size)
    found, rest = _solved(matrix, right, 1e-12)
    assert_near(found, np.linalg.solve(matrix, right), 1e-10)
    assert np.linalg.norm(rest) <= 1e-12 * np.linalg.norm(right)
    np.testing.assert_allclose(rest, right - matrix @ found, rtol=0.0, atol=1e-14 * size)


def test_it_begins_anew_where_few_directions_are_kept():
    matrix, right = _case(120)
    size = np.linalg.norm(right)
    once, often = (_solved(matrix, right, 1e-11, blocks=1, anew=n)[1] for n in (1, 20))
    assert np.linalg.norm(once) > 1e-6 * size
    assert np.linalg.norm(often) <= 1e-11 * size


def test_as_many_products_as_different_eigenvalues():
    """And no more exactly than asked: a Krylov space knows each eigenvalue once."""
    values = jnp.repeat(jnp.asarray([1.0, 0.5, 3.0]), 40)
    counted = []

    def product(x):
        jax.debug.callback(lambda: counted.append(1))
        return values * x

    found, _ = jax.jit(lambda b: gmres(product, b, 1e-12, blocks=2, anew=2))(jnp.ones(120))
    jax.effects_barrier()
    assert_near(np.asarray(found), 1.0 / np.asarray(values), 1e-12)
    # Three directions, and one product for the residual.
    assert len(counted) == 4


def test_nothing_is_asked_and_nothing_can_be_found():
    matrix, right = _case(20)
    assert not np.any(_solved(matrix, 0.0 * right, 1e-9)[0])
    assert np.all(np.isnan(_solved(matrix, np.nan * right, 1e-9)[0]))
    assert not np.all(np.isfinite(_solved(np.zeros((20, 20)), right, 1e-9)[0]))


def test_orthogonality_lasts_until_the_residual_is_met():
    """Of a badly conditioned matrix and many directions: Gram-Schmidt once is enough."""
    rng = np.random.default_rng(3)
    sides = [np.linalg.qr(rng.normal(size=(150, 150)))[0] for _ in range(2)]
    matrix = sides[0] @ np.diag(np.geomspace(1.0, 1e-6, 150)) @ sides[1].T
    right = matrix @ rng.normal(size=150)
    found, rest = _solved(matrix, right, 1e-11, blocks=10, anew=2)
    assert np.linalg.norm(right - matrix @ found) <= 2e-11 * np.linalg.norm(right)
    np.testing.assert_allclose(rest, right - matrix @ found, rtol=0.0, atol=1e-14)
