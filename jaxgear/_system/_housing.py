"""An elastic housing behind the bearings, in series with them."""

from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._system._shaft_parts import Bearing
from jaxgear._types import (
    as_reals,
)

if TYPE_CHECKING:
    BearingMatrix = Array
else:
    BearingMatrix = Float[Array, "bearing_direction bearing_direction"]


class Housing(eqx.Module):
    """An elastic housing, as the bearings see it. It has no mass.

    **Fields:**

    - `stiffness`: loads on its bearing seats per motion of the seats along S, T, Z; the
        pinion's bearings first, in their order, then the wheel's [N/m].

    **Raises:**

    - `ValueError` unless the matrix is square, three rows for each bearing, symmetric and positive
        definite.
    """

    stiffness: BearingMatrix = eqx.field(converter=as_reals)

    def __check_init__(self):
        shape = self.stiffness.shape
        require(
            len(shape) == 2 and shape[0] == shape[1] and shape[0] > 0 and shape[0] % 3 == 0,
            "`Housing.stiffness` must be a square matrix with the rows S, T, Z of each bearing, "
            "got the shape {got}.",
            got=shape,
        )
        if isinstance(self.stiffness, Tracer):
            return
        matrix = np.asarray(self.stiffness)
        uneven = float(np.abs(matrix - matrix.T).max() / np.abs(matrix).max())
        require(
            uneven < 1e-6,
            "`Housing.stiffness` must be symmetric, got entries that differ from their mirror "
            "image by {got:.3g} of the largest. Mind the order of rows and columns.",
            got=uneven,
        )
        lowest = float(np.linalg.eigvalsh(matrix)[0])
        require(
            lowest > 0.0,
            "`Housing.stiffness` must be positive definite, got a lowest eigenvalue of {got:.3g} "
            "N/m. A housing that is not held itself cannot hold a bearing.",
            got=lowest,
        )


def bearing_stiffness_on(bearings: list[Bearing], housing: Housing | None) -> BearingMatrix:
    """Stiffness along S, T, Z of all bearings, in series with that of the housing."""
    if not bearings:
        require(
            housing is None,
            "A housing must have bearings to hold. Give a shaft with bearings to the pinion or the "
            "wheel, or leave the housing out.",
        )
        return jnp.zeros((0, 0))
    springs = jnp.diag(jnp.concatenate([bearing.translation for bearing in bearings]))
    if housing is None:
        return springs
    require(
        housing.stiffness.shape == springs.shape,
        "`Housing.stiffness` must have three rows for each of the {count} bearings, the pinion's "
        "first, got the shape {got}.",
        count=len(bearings),
        got=housing.stiffness.shape,
    )
    behind = 0.5 * (housing.stiffness + housing.stiffness.T)
    series = springs @ jax.scipy.linalg.solve(springs + behind, behind, assume_a="pos")
    return 0.5 * (series + series.T)
