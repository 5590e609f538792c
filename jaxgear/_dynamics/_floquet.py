r"""Floquet's multipliers: how a disturbance of a periodic response grows in one period.

In every step the mesh ties the modes together through its few coordinates only, so that the
derivative of a cycle by its start, the monodromy matrix, is a product of steps that each cost a few
columns. Its eigenvalues are Floquet's multipliers: beyond 1 in size the response is there, but no
machine stays on it. One leaves through +1 at a fold, through -1 where the period doubles.
"""

import contextlib
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array

from jaxgear._compiled import lasting_rare
from jaxgear._dynamics._march_step import March, march_of
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._step_product import Monodromy, mean_tangents, product_of_steps
from jaxgear._dynamics._steppers import AbstractStepper, Exponential
from jaxgear._dynamics._system import DynamicSystem, ModalBasis
from jaxgear._dynamics._types import StepPlaces
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import CoordinateMatrix, Scalar

# A multiplier counts as beyond 1 from here: rounding and truncated harmonics shift it by less.
STABLE = 1.0 + 1e-6


@lasting_rare
def monodromy(
    system: DynamicSystem,
    modes: ModalBasis,
    orbit: Orbit,
    *,
    stepper: AbstractStepper = Exponential(),
    law: AbstractContactLaw = ExactContact(),
    follows: CoordinateMatrix | None = None,
) -> Monodromy:
    """Derivative of the state at the end of a response by that at its start (theory 10.1).

    A cell that closes within a step counts for the part of the step in which it is closed: what is
    found converges with the square of the step, where the derivative of the steps themselves
    has the error of a whole step wherever contact changes.

    **Arguments:**

    - `system`: what moves.
    - `modes`: its natural modes.
    - `orbit`: of this system, by any method, over one or more cycles.
    - `stepper`: `Midpoint` or, exact in the linear part, `Exponential`.
    - `law`: contact law whose tangent stiffness counts.
    - `follows`: what modes that are left out give, from `slow_modes` [m/N, 1/N, 1/(N m)].

    **Returns:**

    A square matrix on displacements of all modes, then velocities, of unit modal mass.
    """
    march = march_along(stepper, law, system, modes, orbit.speed, orbit.place)
    return product_of_steps(march, mean_tangents(march, orbit.place), follows)


def march_along(
    stepper: AbstractStepper,
    law: AbstractContactLaw,
    system: DynamicSystem,
    modes: ModalBasis,
    speed: Scalar,
    places: StepPlaces,
) -> March:
    """A march over the cycles of a response whose mesh coordinates in mid-steps are known [m, rad].

    The other arguments are those of `march_of`.
    """
    multiple = places.shape[0] // len(system.table.kinds)
    return march_of(stepper, law, system.over(multiple), modes, speed)


# Modes that swing in the multipliers of a sweep. Of the wheels of the accessory and the power pair
# 120 give the largest multiplier of twelve speeds to 1e-8, and 60 to 2e-8.
_SLOW = 80


class SlowModes(eqx.Module):
    """The modes by which disturbances die away last, and what all others give.

    **Fields:**

    - `basis`: of the slowest modes.
    - `follows`: mesh coordinates that the others give per excess load, at once; `None`: there are
        no others [m/N, 1/N, 1/(N m)].
    """

    basis: ModalBasis
    follows: CoordinateMatrix | None


def slow_modes(modes: ModalBasis, count: int = _SLOW) -> SlowModes:
    """The slowest modes of a system. The faster ones follow an excess load as springs do.

    **Arguments:**

    - `modes`: of a system.
    - `count`: modes to keep.

    **Returns:**

    They, and the compliance of the others.
    """
    if modes.square.size <= count:
        return SlowModes(modes, None)
    order = jnp.argsort(modes.square)
    slow, fast = (
        jax.tree.map(lambda x, i=i: x[i], _by_mode(modes)) for i in (order[:count], order[count:])
    )
    return SlowModes(_by_mode(slow), fast.mesh.T @ (fast.mesh / fast.square[:, None]))


def _by_mode(modes: ModalBasis) -> ModalBasis:
    """The same with the modes on the first axis of all arrays, or back."""
    return eqx.tree_at(lambda m: m.shape, modes, modes.shape.T)


def floquet_multipliers(monodromies: Array | np.ndarray, modes: ModalBasis) -> np.ndarray:
    """Floquet's multipliers, the eigenvalues of monodromy matrices, largest first (theory 10.1).

    This is not for tracing: no platform but the CPU finds eigenvalues of such matrices.

    **Arguments:**

    - `monodromies`: one, or many on leading axes.
    - `modes`: of the system: scaled by its frequencies, eigenvalues lose fewer digits.

    **Returns:**

    The multipliers on the last axis [-].
    """
    return _largest_first(np.linalg.eigvals(_scaled(monodromies, modes)))


# From this size on a few eigenvalues are found by Arnoldi's method: so many, in a subspace of so
# many vectors. Of the 470 of the accessory wheel on 200 shapes all take ten times as long.
_LARGE, _LEADING, _SUBSPACE = 200, 8, 60


def leading_multipliers(monodromy: Array | np.ndarray, modes: ModalBasis) -> np.ndarray:
    """The largest of Floquet's multipliers; of small systems all.

    **Arguments:**

    - `monodromy`: one matrix.
    - `modes`: of the system.

    **Returns:**

    The multipliers, largest first [-].
    """
    scaled = _scaled(monodromy, modes)
    if len(scaled) < _LARGE or not np.all(np.isfinite(scaled)):
        return _largest_first(np.linalg.eigvals(scaled))
    # Of many that hardly differ in size Arnoldi's method may not find all that it should.
    with contextlib.suppress(scipy.sparse.linalg.ArpackError):
        start = np.random.default_rng(0).standard_normal(len(scaled))
        found: Any = scipy.sparse.linalg.eigs(
            scaled, k=_LEADING, ncv=_SUBSPACE, v0=start, return_eigenvectors=False
        )
        return _largest_first(found)
    return _largest_first(np.linalg.eigvals(scaled))


def _scaled(monodromies: Array | np.ndarray, modes: ModalBasis) -> np.ndarray:
    """Matrices by the frequencies, so that displacements and velocities are of one size."""
    speed = np.sqrt(np.asarray(modes.square))
    weights = np.concatenate([speed, np.ones_like(speed)])
    return np.asarray(monodromies) * weights[:, None] / weights[None, :]


def _largest_first(found: np.ndarray) -> np.ndarray:
    order = np.argsort(-np.abs(found), axis=-1)
    return np.take_along_axis(found, order, axis=-1)
