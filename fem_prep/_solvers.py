"""Factors of sparse symmetric positive definite matrices, by the fastest library at hand."""

import importlib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

from ._checks import BodyError, require

# Unknowns of a node, which follow each other.
_NODE = 3

# Symmetric mode, with pivots on the diagonal: five times as fast as SuperLU's own choice.
_SYMMETRIC = {"SymmetricMode": True}

# Columns solved at a time: enough for the libraries' dense kernels, few enough for the caches.
_COLUMNS = 64

# Motion under a random load, of a matrix scaled to a unit diagonal. Bodies that are held have up to
# 1e3, those that hardly are 1e5; pivots that are but rounding give 1e14 and more.
_GROWTH = 1e12


@dataclass(frozen=True)
class Factor:
    """A factorised matrix.

    **Fields:**

    - `solver`: library that made it.
    - `solve_few`: solves for a vector or some columns.
    """

    solver: str
    solve_few: Callable[[np.ndarray], np.ndarray]

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solve for one or many right-hand sides, shape `[n]` or `[n, column]`."""
        if right.ndim == 1 or right.shape[1] <= _COLUMNS:
            return self.solve_few(right)
        # In Fortran's order a column is contiguous, as every library wants it.
        result = np.empty(right.shape, dtype=right.dtype, order="F")
        for start in range(0, right.shape[1], _COLUMNS):
            part = slice(start, start + _COLUMNS)
            result[:, part] = self.solve_few(np.asfortranarray(right[:, part]))
        return result


def _by_cholmod(matrix: csc_array) -> Callable[[np.ndarray], np.ndarray]:
    cholmod = importlib.import_module("sksparse.cholmod")
    return cholmod.cholesky(matrix, mode="supernodal")


def _in_order(matrix: csc_array, order: np.ndarray) -> SuperLU:
    ordered = matrix[order][:, order]
    return splu(ordered, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=_SYMMETRIC)


def _by_superlu(matrix: csc_array) -> Callable[[np.ndarray], np.ndarray]:
    order = _order(matrix)
    factor = _in_order(matrix, order)

    def solve(right: np.ndarray) -> np.ndarray:
        result = np.empty_like(right)
        result[order] = factor.solve(right[order])
        return result

    return solve


def _order(matrix: csc_array) -> np.ndarray:
    """Order of elimination that leaves few entries: minimum degree, of nodes of three unknowns."""
    size = matrix.indptr.size - 1
    rows, columns = matrix.tocoo().coords
    links = csc_array((np.ones(len(rows)), (rows // _NODE, columns // _NODE)))
    links.data[:] = 1.0
    # Any definite matrix of that pattern: the library gives its order with a factor only.
    definite = csc_array(diags_array(links.sum(axis=1) + 1.0) - links)
    factor = splu(definite, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=_SYMMETRIC)
    return np.argsort(factor.perm_c[np.arange(size) // _NODE], kind="stable")


# Wheels of 10, 37 and 103 thousand unknowns, one thread: CHOLMOD factorises 2, 2.6 and 4 times as
# fast as SuperLU, solves many columns 4, 5 and 7 times as fast and takes half the memory, if it
# finds OpenBLAS; with the reference BLAS it takes up to twice as long. What else comes in wheels
# for pip (PARDISO, QDLDL, CHOLMOD in cvxopt and in cholespy) solves columns no faster than SuperLU,
# or factorises slower; that of MUMPS wants NumPy 1.
_SOLVERS = {"cholmod": _by_cholmod, "superlu": _by_superlu}


def available_solvers() -> list[str]:
    """Solvers that can be used here, fastest first."""
    try:
        importlib.import_module("sksparse.cholmod")
    except ImportError:
        return ["superlu"]
    return list(_SOLVERS)


def factorise(matrix: csr_array | csc_array, solver: str | None = None) -> Factor:
    """Factorise a symmetric, or Hermitian, positive definite sparse matrix.

    **Arguments:**

    - `matrix`: shape `[n, n]`.
    - `solver`: "superlu" (SciPy's) or "cholmod" (scikit-sparse, the extra `cholmod`); the fastest
        at hand without it.

    **Returns:**

    Its factor.

    **Raises:**

    - `BodyError` if the solver is not there, or if the matrix is singular or not definite.
    """
    known = available_solvers()
    chosen = known[0] if solver is None else solver
    require(
        chosen in known,
        "The sparse solver must be one of {known}, got {chosen!r}. scikit-sparse brings cholmod: "
        "`pip install 'jaxgear[cholmod]'`.",
        known=", ".join(known),
        chosen=chosen,
    )
    columns = csc_array(matrix)
    scale = np.sqrt(np.abs(columns.diagonal()))
    with _told(len(scale)):
        factor = Factor(chosen, _SOLVERS[chosen](columns))
        load = np.random.default_rng(0).standard_normal(len(scale)).astype(columns.dtype)
        growth = np.linalg.norm(scale * factor.solve(scale * load)) / np.linalg.norm(load)
        _require_held(float(growth))
    return factor


def compliance_at(matrix: csr_array, nodes: np.ndarray, solver: str | None = None) -> np.ndarray:
    r"""What some nodes give under loads on them: a block of the inverse of a stiffness.

    With these nodes last in the order of elimination, the last block of the factors is that of
    the Schur complement, whose inverse this is: nothing is solved for the other nodes.

    **Arguments:**

    - `matrix`: symmetric positive definite, of three unknowns a node, shape `[n, n]` [N/m].
    - `nodes`: numbers of some of its nodes, shape `[node]`.
    - `solver`: as of `factorise`; CHOLMOD does not show such a block, and solves for it.

    **Returns:**

    Shape `[3 node, 3 node]`, in the order of `nodes` [m/N].

    **Raises:**

    - `BodyError` if the matrix is singular or not definite.
    """
    size = matrix.indptr.size - 1
    last = (_NODE * nodes[:, None] + np.arange(_NODE)).ravel()
    if (solver or available_solvers()[0]) != "superlu":
        units = np.zeros((size, len(last)))
        units[last, np.arange(len(last))] = 1.0
        return factorise(matrix, solver).solve(units)[last]
    others = np.setdiff1d(np.arange(size), last)
    columns = csc_array(matrix)
    with _told(size):
        order = others[_order(columns[others][:, others])]
        factor = _in_order(columns, np.concatenate([order, last]))
        lower, upper = (each[-len(last) :, -len(last) :].toarray() for each in (factor.L, factor.U))
        given = np.linalg.inv(lower @ upper)
        _require_held(float(np.abs(np.diagonal(given) * columns.diagonal()[last]).max()))
    return given


def _require_held(growth: float) -> None:
    """Refuse a matrix whose scaled inverse is so large."""
    if not growth < _GROWTH:
        raise ArithmeticError("singular to rounding")


@contextmanager
def _told(unknowns: int) -> Generator[None]:
    """Say in words of bodies what libraries have to say of a matrix."""
    try:
        yield
    except MemoryError as error:
        raise BodyError(
            f"To factorise {unknowns} unknowns takes more memory than there is. Make the grid "
            "coarser."
        ) from error
    except Exception as error:
        # The libraries' own classes: SuperLU's RuntimeError, CHOLMOD's not positive definite.
        raise BodyError(
            f"The stiffness of the body could not be factorised ({error}): part of it is held by "
            "nothing. Are there loose parts, parts that hang together by an edge, or nodes that "
            "belong to no element?"
        ) from error
