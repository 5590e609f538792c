"""A condensed body on combinations of the modes that it was made with, or on fewer of them."""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np

from jaxgear._system._body_modes import BodyBasis
from jaxgear._system._flexible import FlexibleBody


class Combinations(NamedTuple):
    """Orthonormal combinations of natural modes that are of unit mass and apart in stiffness.

    **Fields:**

    - `into`: the columns, `[mode, combination]` [-].
    - `square`: of their angular frequencies [rad2/s2].
    - `waves`, `diameters`: as of `BodyBasis`.
    """

    into: np.ndarray
    square: np.ndarray
    waves: np.ndarray
    diameters: np.ndarray

    def of_basis(self, basis: BodyBasis) -> BodyBasis:
        """The basis on these combinations of its modes."""
        return dataclasses.replace(
            basis,
            square=self.square,
            shapes=basis.shapes @ self.into,
            waves=self.waves,
            diameters=self.diameters,
        )

    def of_body(self, body: FlexibleBody) -> FlexibleBody:
        """The body on these combinations of its modes; what they leave deflects statically."""
        modes = body.modes
        assert modes is not None
        seats = modes.mass.shape[0] - modes.square.size
        into = jnp.asarray(self.into)
        all_into = jax.scipy.linalg.block_diag(jnp.eye(seats), into)
        mass = all_into.T @ modes.mass @ all_into
        onto = lambda matrix: None if matrix is None else all_into.T @ matrix @ all_into
        return dataclasses.replace(
            body,
            modes=dataclasses.replace(
                modes,
                square=jnp.asarray(self.square),
                rows=modes.rows @ into,
                load=into.T @ modes.load,
                heat=None if modes.heat is None else into.T @ modes.heat,
                # Of unit modal mass: what rounding leaves would tie pairs together.
                mass=mass.at[seats:, seats:].set(jnp.eye(self.square.size)),
                turning=onto(modes.turning),
                coriolis=onto(modes.coriolis),
                softening=onto(modes.softening),
                waves=tuple(int(wave) for wave in self.waves),
                diameters=tuple(int(number) for number in self.diameters),
            ),
        )


def lowest_modes(basis: BodyBasis, count: int) -> Combinations | None:
    """The lowest modes of a basis, as they are.

    **Arguments:**

    - `basis`: the modes.
    - `count`: number of modes, one less where a pair would be parted; 0 are all.

    **Returns:**

    These modes, or `None` if the basis has no more than so many.
    """
    size = len(basis.square)
    if count == 0 or count >= size:
        return None
    count -= int(basis.waves[count] < 0)
    return Combinations(
        into=np.eye(size)[:, :count],
        square=basis.square[:count],
        waves=basis.waves[:count],
        diameters=basis.diameters[:count],
    )
