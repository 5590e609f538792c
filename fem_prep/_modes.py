"""Natural modes of free bodies, of bodies on springs, and of condensed ones."""

import math
from collections.abc import Callable

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ._artefact import ReducedBody
from ._assembly import order
from ._boundary import FullBody
from ._checks import BodyError, Progress, require, silent
from ._solvers import factorise

# Angular frequencies, in wave speed over size, below which a mode is rigid and which the shift
# stands for. The softest webs have their first mode near 0.1, rounding leaves rigid ones at 1e-6.
RIGID = 1e-4
_SHIFT = 0.1


def scale_of(full: FullBody) -> float:
    """Wave speed over the size of the body [rad/s]."""
    speed = math.sqrt(full.material.young / full.material.density)
    return speed / float(np.ptp(full.grid.nodes, axis=0).max())


def operator_of(size: int, product: Callable[[np.ndarray], np.ndarray]) -> LinearOperator:
    """A function of a vector as a matrix, `[size, size]`."""
    # Without a type given, the library tries it on a vector of bytes, which solvers refuse.
    return LinearOperator((size, size), matvec=product, dtype=np.float64)  # pyright: ignore[reportCallIssue]


def lowest_modes(
    stiffness: csr_array, mass: csr_array, count: int, shift: float
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest modes of sparse matrices, the stiffness possibly singular.

    **Arguments:**

    - `stiffness`: symmetric, positive semi-definite, shape `[n, n]`.
    - `mass`: symmetric, positive definite, shape `[n, n]`.
    - `count`: number of modes.
    - `shift`: an angular frequency about that of the first elastic mode [rad/s].

    **Returns:**

    Squares of the angular frequencies [rad2/s2], rising, and shapes of unit modal mass,
    `[n, count]`.

    **Raises:**

    - `BodyError` if the iteration does not converge.
    """
    factor = factorise(stiffness + shift**2 * mass)
    inverse = operator_of(order(stiffness), factor.solve)
    # A start of its own: the library's is random, and results should repeat to the last digit.
    start = np.random.default_rng(0).standard_normal(order(stiffness))
    try:
        square, shapes = eigsh(
            stiffness, count, M=mass, sigma=-(shift**2), OPinv=inverse, which="LM", v0=start
        )
    except ArpackNoConvergence as error:
        raise BodyError(
            f"Only {len(error.eigenvalues)} of {count} natural modes converged. Ask for fewer "
            "modes, or check the grid for elements that are much worse than the others."
        ) from error
    rising = np.argsort(square)
    return square[rising], shapes[:, rising]


def free_modes(
    full: FullBody, count: int, *, progress: Progress = silent
) -> tuple[np.ndarray, np.ndarray]:
    """Elastic modes of a free body.

    **Arguments:**

    - `full`: the body.
    - `count`: number of elastic modes.
    - `progress`: told what begins.

    **Returns:**

    Squares of the angular frequencies [rad2/s2], rising, and shapes of unit modal mass,
    `[3 point, count]`.

    **Raises:**

    - `BodyError` if the body has other than six rigid motions.
    """
    scale = scale_of(full)
    with progress(f"{count} free modes of {order(full.stiffness)} unknowns"):
        square, shapes = lowest_modes(full.stiffness, full.mass, count + 6, _SHIFT * scale)
    rigid = int(np.sum(square < (RIGID * scale) ** 2))
    require(
        rigid == 6,
        "A free body must have six rigid motions, {name} has {rigid}. More than six: parts that "
        "hang together by an edge or not at all. Fewer: something holds the body, or it is "
        "hardly longer than its elements.",
        name=full.name,
        rigid=rigid,
    )
    return square[6:], shapes[:, 6:]


def reduced_modes(
    body: ReducedBody, count: int, springs: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest modes of a condensed body, free or on springs.

    **Arguments:**

    - `body`: the body.
    - `count`: number of modes, rigid ones included.
    - `springs`: stiffness added, shape `[dof, dof]` [SI].

    **Returns:**

    Squares of the angular frequencies [rad2/s2], rising, and shapes of unit modal mass,
    `[dof, count]`.
    """
    stiffness = body.stiffness if springs is None else body.stiffness + springs
    # Shifted and inverted, as one factor of a full matrix is 30 times cheaper than all its modes.
    shift = np.trace(stiffness) / np.trace(body.mass) * 1e-6
    factor = scipy.linalg.cho_factor(stiffness + shift * body.mass, check_finite=False)
    inverse = operator_of(
        body.dofs, lambda vector: scipy.linalg.cho_solve(factor, vector, check_finite=False)
    )
    start = np.random.default_rng(0).standard_normal(body.dofs)
    square, shapes = eigsh(
        stiffness, count, M=body.mass, sigma=-shift, OPinv=inverse, which="LM", v0=start
    )
    rising = np.argsort(square)
    return square[rising], shapes[:, rising]
