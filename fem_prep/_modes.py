"""Natural modes of free bodies, of bodies on springs, and of condensed ones."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from ._artefact import ReducedBody
from ._assembly import order
from ._boundary import FullBody
from ._checks import BodyError, Progress, require, silent
from ._equal_sectors import equal_sectors
from ._repeated import repeated
from ._solvers import Factor, factorise
from ._symmetry import Rotation, Waves, full_turn, rotation_of, waves_of

# Angular frequencies, in wave speed over size, below which a mode is rigid and which the shift
# stands for. The softest webs have their first mode near 0.1, rounding leaves rigid ones at 1e-6.
_RIGID = 1e-4
_SHIFT = 0.1

# One or many columns to as many.
_Columns = Callable[[np.ndarray], np.ndarray]


def scale_of(full: FullBody) -> float:
    """Wave speed over the size of the body [rad/s]."""
    speed = math.sqrt(full.material.young / full.material.density)
    return speed / float(np.ptp(full.grid.nodes, axis=0).max())


def largest_rotation(full: FullBody) -> Rotation:
    """The rotation by the smallest sector after which the body is the same.

    Every node of the rim comes to a place of another, so their number is a multiple of it.
    """
    rim = full.grid.nodes[full.rim]
    for sectors in range(len(rim), 1, -1):
        if len(rim) % sectors or rotation_of(rim, sectors) is None:
            continue
        if (found := full.rotation(sectors)) is not None:
            return found
    return full_turn(full.points)


def operator_of(
    size: int, product: Callable[[np.ndarray], np.ndarray], kind: np.dtype | type = np.float64
) -> LinearOperator:
    """A function of a vector as a matrix, `[size, size]`."""
    # Without a type given, the library tries it on a vector of bytes, which solvers refuse.
    return LinearOperator((size, size), matvec=product, dtype=kind)  # ty: ignore[missing-argument, unknown-argument, parameter-already-assigned]


@dataclass(frozen=True)
class _Pencil:
    """Stiffness and mass, real or complex, and the factor of their sum.

    **Fields:**

    - `stiffness`: positive semi-definite, shape `[n, n]`.
    - `mass`: positive definite, shape `[n, n]`.
    - `shift`: square of an angular frequency [rad2/s2].
    - `factor`: of the stiffness and `shift` times the mass.
    """

    stiffness: csr_array
    mass: csr_array
    shift: float
    factor: Factor

    def lowest(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Squares of angular frequencies, rising, and shapes of unit modal mass, `[n, count]`."""
        size = order(self.stiffness)
        if size < 4 * count + 20:
            return self._lowest_of_all(min(count, size))
        # A start of its own: the library's is random, and results should repeat to the last digit.
        start = np.random.default_rng(0).standard_normal(size).astype(self.stiffness.dtype)
        square, shapes = eigsh(
            self.stiffness,
            count,
            M=self.mass,
            sigma=-self.shift,
            OPinv=operator_of(size, self.factor.solve, start.dtype),
            which="LM",
            v0=start,
        )
        if np.iscomplexobj(shapes):
            # The library's method for those does not make shapes orthogonal.
            products = [shapes.conj().T @ (each @ shapes) for each in (self.stiffness, self.mass)]
            square, mixed = scipy.linalg.eigh(*products)
            shapes = shapes @ mixed
        rising = np.argsort(square)
        return square[rising], shapes[:, rising]

    def _lowest_of_all(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """The same for small matrices, of whose modes the iteration cannot find most."""
        size, mass = order(self.stiffness), self.mass.toarray()
        both = self.stiffness.toarray() + self.shift * mass
        inverse, shapes = scipy.linalg.eigh(mass, both, subset_by_index=(size - count, size - 1))
        return 1 / inverse[::-1] - self.shift, (shapes / np.sqrt(inverse))[:, ::-1]


def lowest_modes(
    stiffness: csr_array,
    mass: csr_array,
    count: int,
    shift: float,
    rotation: Rotation | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest modes of sparse matrices, the stiffness possibly singular.

    **Arguments:**

    - `stiffness`: symmetric, positive semi-definite, shape `[n, n]`.
    - `mass`: symmetric, positive definite, shape `[n, n]`.
    - `count`: number of modes.
    - `shift`: an angular frequency about that of the first elastic mode [rad/s].
    - `rotation`: of the points that the unknowns belong to, three each, that leaves both matrices
        as they are; modes are then sought by the number of their waves around.

    **Returns:**

    Squares of the angular frequencies [rad2/s2], rising, and shapes of unit modal mass,
    `[n, count]`.

    **Raises:**

    - `BodyError` if the iteration does not converge.
    """
    waves = waves_of(full_turn(order(stiffness) // 3) if rotation is None else rotation)
    pencils = [
        _Pencil(k, m, shift**2, factorise(k + shift**2 * m))
        for k, m in zip(waves.matrices(stiffness), waves.matrices(mass), strict=True)
    ]
    first = min(count, 4 + 2 * count // waves.rotation.sectors)
    try:
        found = [pencil.lowest(first) for pencil in pencils]
        # Numbers of waves of which all modes found are among the lowest may have more of them.
        while more := _unfinished(pencils, found, waves.weights, count):
            for number in more:
                found[number] = pencils[number].lowest(2 * len(found[number][0]))
    except ArpackNoConvergence as error:
        raise BodyError(
            f"Only {len(error.eigenvalues)} of {count} natural modes converged. Ask for fewer "
            "modes, or check the grid for elements that are much worse than the others."
        ) from error
    return _real_modes(waves, found, count)


def _unfinished(
    pencils: Sequence[_Pencil],
    found: Sequence[tuple[np.ndarray, np.ndarray]],
    weights: Sequence[int],
    count: int,
) -> list[int]:
    """Numbers of waves that may have more of the lowest modes than were found."""
    pairs = zip(found, weights, strict=True)
    known = np.sort(np.concatenate([np.repeat(square, weight) for (square, _), weight in pairs]))
    last = known[count - 1] if len(known) >= count else math.inf
    return [
        number
        for number, (square, _) in enumerate(found)
        if square[-1] < last and len(square) < order(pencils[number].stiffness)
    ]


def _real_modes(
    waves: Waves, found: Sequence[tuple[np.ndarray, np.ndarray]], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The lowest of modes given by number of waves, their shapes complex amplitudes."""
    weights = waves.weights
    repeated = [np.repeat(each, weight) for (each, _), weight in zip(found, weights, strict=True)]
    square = np.concatenate(repeated)
    rising = np.argsort(square, kind="stable")[:count]
    parts, start = [], 0
    for (_, shapes), weight in zip(found, weights, strict=True):
        # A complex shape and its conjugate are two real ones, a quarter of a wave apart.
        quarters = np.array([1.0]) if weight == 1 else np.array([1, -1j]) / math.sqrt(2)
        both = (shapes[:, :, None] * quarters).reshape(len(shapes), -1)
        every = np.zeros((len(shapes), len(square)), dtype=both.dtype)
        every[:, start : start + both.shape[1]] = both
        parts.append(every[:, rising])
        start += both.shape[1]
    return square[rising], waves.whole(parts)


def free_modes(
    full: FullBody,
    count: int,
    *,
    rotation: Rotation | None = None,
    progress: Progress = silent,
) -> tuple[np.ndarray, np.ndarray]:
    """Elastic modes of a free body.

    **Arguments:**

    - `full`: the body.
    - `count`: number of elastic modes.
    - `rotation`: a rotation that leaves the body as it is; the smallest one is sought without it.
    - `progress`: told what begins.

    **Returns:**

    Squares of the angular frequencies [rad2/s2], rising, and shapes of unit modal mass,
    `[3 point, count]`.

    **Raises:**

    - `BodyError` if the body has other than six rigid motions.
    """
    scale = scale_of(full)
    rotation = largest_rotation(full) if rotation is None else rotation
    with progress(f"{count} free modes of {order(full.stiffness)} unknowns"):
        square, shapes = lowest_modes(
            full.stiffness, full.mass, count + 6, _SHIFT * scale, rotation
        )
    rigid = int(np.sum(square < (_RIGID * scale) ** 2))
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
    - `springs`: rows that give the stretch of springs of unit stiffness, `[spring, dof]` [SI].

    **Returns:**

    Squares of the angular frequencies [rad2/s2], rising, and shapes of unit modal mass,
    `[dof, count]`.
    """
    springs = np.zeros((0, body.dofs)) if springs is None else springs
    # Shifted and inverted, as one factor of a full matrix is 30 times cheaper than all its modes.
    shift = (np.trace(body.stiffness) + np.sum(springs**2)) / np.trace(body.mass) * 1e-6
    resist, weigh, answer = _shifted(body, shift)
    pulled = answer(springs.T)
    forces = np.linalg.inv(np.eye(len(springs)) + springs @ pulled)

    def inverse(vector: np.ndarray) -> np.ndarray:
        motion = answer(vector)
        return motion - pulled @ (forces @ (springs @ motion))

    mass = operator_of(body.dofs, weigh)
    start = np.random.default_rng(0).standard_normal(body.dofs)
    # Of the first matrix only the size is used.
    _, shapes = eigsh(
        mass,
        count,
        M=mass,
        sigma=-shift,
        OPinv=operator_of(body.dofs, inverse),
        which="LM",
        v0=start,
    )
    # By the energies of the shapes: springs on a body that the shift hardly holds cost digits.
    energy = np.sum(shapes * resist(shapes), axis=0) + np.sum((springs @ shapes) ** 2, axis=0)
    square = energy / np.sum(shapes * weigh(shapes), axis=0)
    rising = np.argsort(square)
    return square[rising], shapes[:, rising]


def _shifted(body: ReducedBody, shift: float) -> tuple[_Columns, _Columns, _Columns]:
    """Products with a condensed stiffness and mass, and answers of the shifted stiffness."""
    sectors = equal_sectors(body.rim_nodes, body.facts)
    if sectors is not None:
        stiffness, mass = (repeated(sectors, each) for each in (body.stiffness, body.mass))
        if stiffness is not None and mass is not None:
            return stiffness.times, mass.times, stiffness.plus(mass, shift).solver()
    factor = scipy.linalg.cho_factor(
        body.stiffness + shift * body.mass, overwrite_a=True, check_finite=False
    )
    return (
        lambda motion: body.stiffness @ motion,
        lambda motion: body.mass @ motion,
        lambda load: scipy.linalg.cho_solve(factor, load, check_finite=False),
    )
