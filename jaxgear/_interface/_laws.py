"""Contact laws: how much a cell is compressed by an overlap. Cells never pull."""

import abc

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._compiled import in_numpy
from jaxgear._smooth import smooth_ramp, smooth_ramp_integral
from jaxgear._types import Reals, Scalar, as_scalar


class AbstractContactLaw(eqx.Module):
    """Compression of a cell as a convex function's slope of its overlap."""

    @abc.abstractmethod
    def compression(self, overlap: Reals) -> Reals:
        """Compression of each cell [m] at an `overlap` of the undeformed flanks [m]."""

    @abc.abstractmethod
    def energy(self, overlap: Reals) -> Reals:
        """Integral of the compression over the overlap [m2]."""


class ExactContact(AbstractContactLaw):
    """Unilateral contact: compressed by the overlap, or free (theory 5.4)."""

    def compression(self, overlap: Reals) -> Reals:
        """Return the positive part of the overlap [m]."""
        return jnp.maximum(overlap, 0.0)

    def energy(self, overlap: Reals) -> Reals:
        """Return half the square of the compression [m2]."""
        return 0.5 * jnp.maximum(overlap, 0.0) ** 2


class SmoothContact(AbstractContactLaw):
    """Twice differentiable contact, exact wherever no cell is within `width` of separation.

    A cell just closed carries 3/16 of the width. See `smooth_ramp` for the spline (theory 5.4).

    **Fields:**

    - `width`: half the range of overlap over which contact closes [m].

    **Raises:**

    - `ValueError` unless the width is positive.
    """

    width: Scalar = eqx.field(converter=as_scalar)

    def __check_init__(self):
        require(
            in_numpy(self.width) > 0.0,
            "`SmoothContact.width` must be positive, got {got:.6g} m. Without smoothing, use "
            "`ExactContact`.",
            got=self.width,
        )

    def compression(self, overlap: Reals) -> Reals:
        """Return the rounded positive part of the overlap [m]."""
        return smooth_ramp(overlap, self.width)

    def energy(self, overlap: Reals) -> Reals:
        """Return the integral of the compression [m2]."""
        return smooth_ramp_integral(overlap, self.width)
