"""How the teeth of one gear differ from each other: pitch errors and eccentricity."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._types import Scalar, Teeth, as_scalar


def _as_list(value: object) -> Array:
    return jnp.atleast_1d(jnp.asarray(value, dtype=float))


class Indexing(eqx.Module):
    """Where the flanks of one gear stand around its axis (theory 2.5).

    Tooth 0 enters contact at phase 0, tooth 1 one mesh period later. An eccentric gear keeps its
    involutes; their axis runs round the axis of rotation.

    **Fields:**

    - `pitch_error`: cumulative pitch error of each tooth, positive where material is added, along
        the flank normal; one value for all teeth alike [m].
    - `eccentricity`: distance of the teeth's axis from the axis of rotation [m].
    - `eccentricity_angle`: of the offset at phase 0, from S in the gear's own sense of
        rotation [rad].

    **Raises:**

    - `ValueError` if the eccentricity is negative.
    """

    pitch_error: Teeth = eqx.field(converter=_as_list, default=0.0)
    eccentricity: Scalar = eqx.field(converter=as_scalar, default=0.0)
    eccentricity_angle: Scalar = eqx.field(converter=as_scalar, default=0.0)

    def __check_init__(self):
        require(
            self.eccentricity >= 0.0,
            "`Indexing.eccentricity` is a distance and cannot be negative, got {got:.6g} m. Turn "
            "`eccentricity_angle` by pi instead.",
            got=self.eccentricity,
        )
