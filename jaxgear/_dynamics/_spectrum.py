"""Frequencies and energies of modes, with derivatives where frequencies meet."""

import functools
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array, Bool, Float

from jaxgear._dynamics._types import Matrix, ModeMatrix

if TYPE_CHECKING:
    ModeNumbers = Array
    PartModes = Array
    FlagPerMode = Array
    Matrices = Array
else:
    ModeNumbers = Float[Array, "mode"]
    PartModes = Float[Array, "part mode"]
    FlagPerMode = Bool[Array, "mode"]
    Matrices = Float[Array, "part dof dof"]


def meeting(values: Array, meet: float) -> FlagPerMode:
    """Whether each mode meets the one below or above it."""
    joined = _joined(values, meet)
    none = jnp.zeros(1, dtype=bool)
    return jnp.concatenate([none, joined]) | jnp.concatenate([joined, none])


def _joined(values: Array, meet: float) -> Array:
    """Whether each squared frequency meets the next one; what rounding cannot part does."""
    low, high = values[:-1], values[1:]
    rounding = values.size * jnp.finfo(values.dtype).eps * jnp.abs(values[-1])
    return high - low <= jnp.maximum((1.0 - (1.0 - meet) ** 2) * high, rounding)


def _means(values: Array, meet: float) -> tuple[Array, Array]:
    """Which modes meet, pair by pair, and the matrix that takes the mean over those that do."""
    group = jnp.concatenate(
        [jnp.zeros(1, dtype=int), jnp.cumsum(~_joined(values, meet), dtype=int)]
    )
    same = group[:, None] == group[None, :]
    weight = same.astype(values.dtype)
    return same, weight / jnp.sum(weight, axis=1, keepdims=True)


@functools.partial(jax.custom_jvp, nondiff_argnums=(2, 3))
def spectrum_of(
    stiffness: Matrix, forms: Matrices, count: int, meet: float
) -> tuple[ModeNumbers, ModeMatrix, PartModes]:
    """The lowest eigenvalues, their vectors, and of each form the values on the vectors.

    The latter are means over vectors whose values meet.
    """
    values, vectors = jnp.linalg.eigh(stiffness)
    values, vectors = values[:count], vectors[:, :count]
    _, mean = _means(values, meet)
    on_modes = jnp.einsum("ai,pab,bi->pi", vectors, forms, vectors)
    return values, vectors, on_modes @ mean.T


@spectrum_of.defjvp
def _spectrum_jvp(
    count: int, meet: float, primals: tuple[Array, Array], tangents: tuple[Array, Array]
):
    stiffness, forms = primals
    values, vectors = jnp.linalg.eigh(stiffness)
    low, lowest = values[:count], vectors[:, :count]
    same, mean = _means(low, meet)
    between = jnp.einsum("ai,pab,bj->pij", lowest, forms, vectors)
    on_modes = jnp.diagonal(between[:, :, :count], axis1=1, axis2=2)

    dot = vectors.T @ tangents[0] @ lowest
    values_dot = mean @ jnp.diagonal(dot[:count])
    gap = low[None, :] - values[:, None]
    met = jnp.concatenate([same, jnp.zeros((values.size - count, count), dtype=bool)])
    inverse = jnp.where(met, 0.0, 1.0 / jnp.where(met, 1.0, gap))
    turning = inverse * dot
    # What is turned among vectors that meet cancels in their mean.
    forms_dot = jnp.einsum("ai,pab,bi->pi", lowest, tangents[1], lowest)
    forms_dot = forms_dot + 2.0 * jnp.einsum("pij,ji->pi", between, turning)
    # One over a gap of zero: infinite, yet nothing to whoever does not ask for these vectors.
    own = jnp.eye(values.size, count, dtype=bool)
    steep = jnp.where(met & ~own, 1e300, 0.0)
    turning = turning + (steep * dot) * steep
    return (low, lowest, on_modes @ mean.T), (values_dot, vectors @ turning, forms_dot @ mean.T)
