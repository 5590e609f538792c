"""A condensed body on combinations of the modes that it was made with, or on fewer of them."""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array

from jaxgear._compiled import compiled
from jaxgear._system._body_modes import BodyBasis, BodyModes, wave_partners
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._residual_shapes import Residual
from jaxgear._types import as_reals


class Combinations(NamedTuple):
    """Orthonormal combinations of natural modes that are of unit mass and apart in stiffness.

    **Fields:**

    - `into`: the columns, `[mode, combination]` [-].
    - `square`: of their angular frequencies [rad2/s2].
    - `waves`, `diameters`: as of `BodyBasis`.
    - `residual`: shapes beside them that stand still in space, or `None`.
    """

    into: np.ndarray
    square: np.ndarray
    waves: np.ndarray
    diameters: np.ndarray
    residual: Residual | None = None

    def of_basis(self, basis: BodyBasis) -> BodyBasis:
        """The basis on these combinations of its modes, without residual shapes."""
        return dataclasses.replace(
            basis,
            square=self.square,
            shapes=basis.shapes @ self.into,
            waves=self.waves,
            diameters=self.diameters,
        )

    def residual_motions(self, basis: BodyBasis) -> np.ndarray:
        """Motion of the body's coordinates per part of a residual shape, `[dof, part]` [kg^-1/2].

        By wave, then by shape, then the two of a pair, as of `Residual.parts`.
        """
        assert self.residual is not None
        partner, number = wave_partners(basis.waves)
        _, parts = self.residual.parts(partner, np.asarray(number))
        # Each wave is of few modes.
        some = [np.any(own != 0.0, axis=(1, 2)) for own in parts]
        of_wave = [
            np.tensordot(basis.shapes[:, chosen], own[chosen], axes=1)
            for chosen, own in zip(some, parts, strict=True)
        ]
        return np.stack(of_wave, axis=1).reshape(len(basis.shapes), -1)

    def of_body(self, body: FlexibleBody) -> FlexibleBody:
        """The body on these combinations of its modes; what they leave deflects statically."""
        modes = body.modes
        assert modes is not None
        assert modes.residual is None
        none = Residual(np.zeros((len(self.into), 0)), np.zeros(0))
        residual = none if self.residual is None else self.residual
        partner, number = wave_partners(modes.waves)
        given = (self.into, residual.into, self.square, residual.square)
        combined = _combined(modes, *map(as_reals, given))
        kept = (
            residual.rows(modes.rows, partner, np.asarray(number)) if residual.square.size else None
        )
        return dataclasses.replace(
            body,
            modes=dataclasses.replace(
                combined,
                waves=tuple(int(wave) for wave in self.waves),
                diameters=tuple(int(number) for number in self.diameters),
                residual=kept,
            ),
        )


@compiled
def _combined(
    modes: BodyModes, into: Array, own: Array, square: Array, residual_square: Array
) -> BodyModes:
    """Modes on combinations of theirs and on residual shapes, whose waves are not told."""
    seats, count = modes.seat_dofs, residual_square.size
    closed = seats + square.size
    # All that moves: the coordinates, and what residual shapes become as the body turns.
    moving = jnp.concatenate([into, own, modes.turning[seats:, seats:] @ own], axis=1)
    moving = jax.scipy.linalg.block_diag(jnp.eye(seats), moving)
    size = closed + count
    shapes = moving[seats:, seats:size]
    onto = lambda matrix: None if matrix is None else moving.T @ matrix @ moving
    mass, softening = onto(modes.mass), onto(modes.softening)
    assert mass is not None
    turning = jnp.zeros((size + count, size)).at[size:, closed:].set(jnp.eye(count))
    own_turning = moving[:, :closed].T @ modes.turning @ moving[:, :closed]
    return dataclasses.replace(
        modes,
        square=jnp.concatenate([square, residual_square]),
        rows=modes.rows @ into,
        load=shapes.T @ modes.load,
        heat=None if modes.heat is None else shapes.T @ modes.heat,
        # Of unit modal mass: what rounding leaves would tie pairs together.
        mass=mass.at[seats:closed, seats:closed].set(jnp.eye(square.size)),
        turning=turning.at[:closed, :closed].set(own_turning),
        coriolis=onto(modes.coriolis),
        softening=None if softening is None else softening[:size, :size],
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
