"""Sparse factors: they agree, say what is singular, and leave few entries."""

import numpy as np
import pytest
from fem_cases import accessory_wheel, assert_near, small_wheel, wheel_body
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from fem_prep import _solvers
from fem_prep._checks import BodyError
from fem_prep._modes import scale_of
from fem_prep._seats import dofs_of
from fem_prep._solvers import available_solvers, compliance_at, factorise
from fem_prep._web import MeshSizing

SOLVERS = [
    "superlu",
    pytest.param(
        "cholmod",
        marks=pytest.mark.skipif(
            "cholmod" not in available_solvers(), reason="scikit-sparse is not installed"
        ),
    ),
]


def held_stiffness():
    full = wheel_body(small_wheel(8), "ring")
    inside = np.setdiff1d(np.arange(3 * full.points), full.held)
    return full.stiffness[inside][:, inside]


def hermitian():
    """A complex matrix of the same pattern, positive definite."""
    real = held_stiffness()
    turn = np.exp(1j * np.linspace(0, 5, real.indptr.size - 1))
    return csr_array(real.multiply(turn[:, None]).multiply(turn.conj()))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("matrix", [held_stiffness(), hermitian()], ids=["real", "complex"])
def test_a_factor_solves(solver, matrix):
    """One column, some and many; the answer is the one of dense matrices."""
    right = np.random.default_rng(1).standard_normal((matrix.indptr.size - 1, 130))
    right = right.astype(matrix.dtype)
    factor = factorise(matrix, solver)
    exact = np.linalg.solve(matrix.toarray(), right)
    for columns in (slice(None), slice(0, 7), 3):
        assert_near(factor.solve(right[:, columns]), exact[:, columns], 1e-11)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("matrix", [held_stiffness(), hermitian()], ids=["real", "complex"])
def test_a_factor_leaves_the_load_alone(solver, matrix):
    right = np.ones((matrix.indptr.size - 1, 2), dtype=matrix.dtype)
    factorise(matrix, solver).solve(right)
    assert np.all(right == 1)


@pytest.mark.parametrize("solver", SOLVERS)
def test_compliance_of_some_nodes_is_a_block_of_the_inverse(solver):
    """In the order in which they are asked for."""
    matrix, nodes = held_stiffness(), np.array([40, 3, 17, 4])
    places = dofs_of(nodes)
    exact = np.linalg.inv(matrix.toarray())[np.ix_(places, places)]
    assert_near(compliance_at(matrix, nodes, solver), exact, 1e-11)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("around", [8, 15])
def test_what_floats_is_refused(solver, around):
    """Rounding turns pivots of none into small ones, which no library need notice."""
    full = wheel_body(small_wheel(around), "none")
    with pytest.raises(BodyError, match="held by nothing"):
        factorise(full.stiffness, solver)
    with pytest.raises(BodyError, match="held by nothing"):
        compliance_at(full.stiffness, np.arange(4), solver)
    # A thousandth of the lowest frequency is enough to hold it.
    held = full.stiffness + (1e-4 * scale_of(full)) ** 2 * full.mass
    assert factorise(held, solver).solver == solver


@pytest.mark.parametrize("solver", SOLVERS)
def test_rows_without_entries_are_refused(solver):
    matrix = held_stiffness().tolil()
    matrix[5, :] = matrix[:, 5] = 0.0
    matrix = csc_array(matrix)
    matrix.eliminate_zeros()
    with pytest.raises(BodyError, match="no element"):
        factorise(matrix, solver)


def test_too_little_memory_is_named(monkeypatch):
    def full_up(matrix):
        raise MemoryError

    monkeypatch.setitem(_solvers._SOLVERS, "superlu", full_up)
    with pytest.raises(BodyError, match="more memory than there is"):
        factorise(held_stiffness(), "superlu")


@pytest.mark.slow
def test_nodes_are_eliminated_whole_and_leave_fewer_entries():
    """Against the library's order of single unknowns, which this replaces."""
    fineness = MeshSizing(sectors=48, rim_axial=3, rim_radial=1, web_radial=5, hub_radial=1)
    full = wheel_body(accessory_wheel(fineness=fineness), "ring")
    matrix = csc_array(full.stiffness + scale_of(full) ** 2 * full.mass)
    order = _solvers._order(matrix)
    np.testing.assert_array_equal(np.sort(order), np.arange(3 * full.points))
    np.testing.assert_array_equal(order, dofs_of(order[::3] // 3))
    plain = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    nodal = splu(matrix[order][:, order], permc_spec="NATURAL", **plain)
    single = splu(matrix, permc_spec="MMD_AT_PLUS_A", **plain)
    assert nodal.nnz < 0.8 * single.nnz


def test_a_chain_is_eliminated_from_its_ends():
    """No entry is left that was not there, whatever the numbers of its nodes."""
    count = 50
    shuffled = np.random.default_rng(0).permutation(count)
    chain = 2.1 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    matrix = csc_array(np.kron(chain[np.ix_(shuffled, shuffled)], np.eye(3) + 0.1))
    order = _solvers._order(matrix)
    factor = splu(matrix[order][:, order], permc_spec="NATURAL", diag_pivot_thresh=0.0)
    assert factor.L.nnz <= 6 * count + 9 * (count - 1)
