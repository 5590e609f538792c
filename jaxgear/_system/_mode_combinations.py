"""A condensed body on combinations of its natural modes, or on fewer of them."""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxgear._system._body_in_mesh import BodyInMesh
from jaxgear._system._body_modes import BodyBasis, BodyModes, wave_partners, whole_pairs
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._residual_shapes import Residual
from jaxgear._types import as_reals


class ShapedBody(NamedTuple):
    """A body on combinations of its modes.

    **Fields:**

    - `flexible`: its tables; what the combinations leave deflects statically.
    - `basis`: the combinations as a basis, without residual shapes.
    - `made_of`: natural modes that the combinations are made of, without residual shapes.
    - `into`: the combinations by these, `[mode, combination]` [-].
    """

    flexible: FlexibleBody
    basis: BodyBasis
    made_of: BodyBasis
    into: np.ndarray


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
        parts = self.residual.parts(partner, np.asarray(number))
        # Each wave is of few modes.
        some = [np.any(own != 0.0, axis=(1, 2)) for own in parts]
        of_wave = [
            np.tensordot(basis.shapes[:, chosen], own[chosen], axes=1)
            for chosen, own in zip(some, parts, strict=True)
        ]
        return np.stack(of_wave, axis=1).reshape(len(basis.shapes), -1)

    def of_body(self, body: BodyInMesh, basis: BodyBasis) -> ShapedBody:
        """A body on these combinations of its modes.

        **Arguments:**

        - `body`: in mesh.
        - `basis`: its natural modes.

        **Returns:**

        The body.
        """
        own, residual = self.of_basis(basis), self.residual
        made_of = lowest_modes(basis, 1 + int(np.flatnonzero(np.any(self.into, axis=1))[-1]))
        into = self.into[: len(made_of.square)]
        found = body.moving(own)
        modes = found.modes
        if residual is None or not residual.square.size:
            return ShapedBody(found, own, made_of, into)
        assert modes is not None
        waves = residual.waves(np.asarray(wave_partners(basis.waves)[1]))
        parts = self.residual_motions(basis)
        beside = _beside(modes, body, own, residual, waves, parts)
        moving = dataclasses.replace(found, modes=beside)
        return ShapedBody(moving, own, made_of, into)


def _beside(
    modes: BodyModes,
    body: BodyInMesh,
    own: BodyBasis,
    residual: Residual,
    waves: tuple[int, ...],
    parts: np.ndarray,
) -> BodyModes:
    """Modes and residual shapes beside them, from the motion per part of these."""
    count = residual.square.size
    apart = parts.reshape(len(parts), len(waves), count, 2)
    shapes = apart[..., 0].sum(axis=1)
    # What they become as the body turns beneath them: other shapes, whose inertia counts.
    turned = np.tensordot(apart[..., 1], np.array(waves, dtype=float), axes=(1, 0))
    moved, condensed = np.concatenate([shapes, turned], axis=1), body.condensed

    def bordered(closed: np.ndarray, matrix: np.ndarray, beside: np.ndarray, sign: float):
        """A matrix on modes, and on motions beside them; it is as symmetric as its sign says."""
        acting = matrix @ beside
        between = own.motions.T @ acting
        return as_reals(np.block([[closed, between], [sign * between.T, beside.T @ acting]]))

    size = modes.size
    turning = np.zeros((size + 2 * count, size + count))
    turning[:size, :size] = modes.turning
    turning[size + count :, size:] = np.eye(count)
    coriolis, softening = modes.coriolis, modes.softening
    if coriolis is not None:
        assert condensed.coriolis is not None
        coriolis = bordered(np.asarray(coriolis), condensed.coriolis, moved, -1.0)
    if softening is not None:
        assert condensed.stress_stiffening is not None
        assert condensed.spin_softening is not None
        stiffens = condensed.stress_stiffening - condensed.spin_softening
        softening = bordered(np.asarray(softening), stiffens, shapes, 1.0)
    on_shapes = lambda load: as_reals(shapes.T @ load)
    heat = None
    if modes.heat is not None:
        assert body.heat is not None
        heat = jnp.concatenate([modes.heat, on_shapes(body.heat.T)])
    return dataclasses.replace(
        modes,
        square=jnp.concatenate([modes.square, as_reals(residual.square)]),
        load=jnp.concatenate([modes.load, on_shapes(condensed.centrifugal_load)]),
        heat=heat,
        mass=bordered(np.asarray(modes.mass), condensed.mass, moved, 1.0),
        turning=as_reals(turning),
        coriolis=coriolis,
        softening=softening,
        residual=residual.rows(body.rows(parts), waves),
    )


def lowest_modes(basis: BodyBasis, count: int) -> BodyBasis:
    """The lowest modes of a basis.

    **Arguments:**

    - `basis`: the modes.
    - `count`: number of modes, one less where a pair would be parted; 0 are all.

    **Returns:**

    They; all if there are no more than so many.
    """
    if count == 0 or count >= len(basis.square):
        return basis
    count = whole_pairs(count, basis.waves)
    return dataclasses.replace(
        basis,
        square=basis.square[:count],
        shapes=basis.shapes[:, :count],
        waves=basis.waves[:count],
        diameters=basis.diameters[:count],
    )
