r"""Real flanks: what is removed from, or added to, the nominal involute helicoid.

A positive deviation adds material along the outward normal, so it closes the gap. Depths
are material *removed*, as a user types them, and stay positive. Every law is written in two
dimensionless coordinates of the gear that carries it, so extents are fractions:

- `profile`: 0 where contact starts on this gear's flank, near its root, 1 at its tip, linear
  in roll length; one unit is the path of contact $\varepsilon_\alpha p_{bt}$.
- `face`: -1 at the left (-Z) end of this gear's face, 0 at mid-face, 1 at the right end.

Beyond 0..1 and -1..1 the laws go on smoothly. Sources: physics A1.7b, thesis figs. III-5, IV-9.
"""

import abc

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._types import Reals, Scalar, as_scalar


class AbstractFlankDeviation(eqx.Module):
    """A scalar field over one flank, along its surface normal."""

    @abc.abstractmethod
    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation.

        **Arguments:**

        - `profile`: place between start of active profile and tip [-].
        - `face`: place across the face [-], of the shape of `profile`.

        **Returns:**

        Deviation [m], positive where material is added.
        """


def _relief(distance: Reals, depth: Scalar, extent: Scalar, exponent: int) -> Reals:
    """Removal of `depth` at distance 0 that fades out at distance `extent`."""
    return -depth * jnp.maximum(1.0 - distance / extent, 0.0) ** exponent


def _check_extent(extent: Scalar, owner: str, whole: str) -> None:
    require(
        (extent > 0.0) & (extent <= 1.0),
        "`"
        + owner
        + ".extent` must lie in (0, 1], got {got:.6g}: it is a fraction of "
        + whole
        + ", not a length.",
        got=extent,
    )


def _check_exponent(exponent: int, owner: str) -> None:
    require(
        exponent in (1, 2),
        "`" + owner + ".exponent` must be 1 (linear) or 2 (parabolic), got {got}.",
        got=exponent,
    )


class TipRelief(AbstractFlankDeviation):
    """Relief that grows towards the tip.

    **Fields:**

    - `depth`: material removed at the tip [m].
    - `extent`: length along the path of contact over the path of contact [-].
    - `exponent`: 1 is linear, 2 parabolic.

    **Raises:**

    - `ValueError` if the extent is no fraction.
    """

    depth: Scalar = eqx.field(converter=as_scalar)
    extent: Scalar = eqx.field(converter=as_scalar)
    exponent: int = eqx.field(static=True, default=1)

    def __check_init__(self):
        _check_extent(self.extent, "TipRelief", "the path of contact")
        _check_exponent(self.exponent, "TipRelief")

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del face
        return _relief(1.0 - profile, self.depth, self.extent, self.exponent)


class RootRelief(AbstractFlankDeviation):
    """Relief that grows towards the start of active profile.

    **Fields:**

    - `depth`: material removed at the start of active profile [m].
    - `extent`: length along the path of contact over the path of contact [-].
    - `exponent`: 1 is linear, 2 parabolic.

    **Raises:**

    - `ValueError` if the extent is no fraction.
    """

    depth: Scalar = eqx.field(converter=as_scalar)
    extent: Scalar = eqx.field(converter=as_scalar)
    exponent: int = eqx.field(static=True, default=1)

    def __check_init__(self):
        _check_extent(self.extent, "RootRelief", "the path of contact")
        _check_exponent(self.exponent, "RootRelief")

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del face
        return _relief(profile, self.depth, self.extent, self.exponent)


class Crowning(AbstractFlankDeviation):
    """Parabolic crowning across the face.

    **Fields:**

    - `depth`: material removed at both ends of the face [m].
    """

    depth: Scalar = eqx.field(converter=as_scalar)

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del profile
        return -self.depth * face**2


class EndRelief(AbstractFlankDeviation):
    """Relief that grows towards one end of the face, or both.

    **Fields:**

    - `depth`: material removed at the end of the face [m].
    - `extent`: length across the face over the face width [-].
    - `exponent`: 1 is linear, 2 parabolic.
    - `left`: whether the -Z end is relieved.
    - `right`: whether the +Z end is relieved.

    **Raises:**

    - `ValueError` if the extent is no fraction, or neither end is relieved.
    """

    depth: Scalar = eqx.field(converter=as_scalar)
    extent: Scalar = eqx.field(converter=as_scalar)
    exponent: int = eqx.field(static=True, default=1)
    left: bool = eqx.field(static=True, default=True)
    right: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        _check_extent(self.extent, "EndRelief", "the face width")
        _check_exponent(self.exponent, "EndRelief")
        require(
            self.left or self.right, "`EndRelief` must relieve the left end, the right, or both."
        )

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del profile
        total = jnp.zeros_like(face)
        for relieved, towards in ((self.left, 1.0), (self.right, -1.0)):
            if relieved:
                distance = 0.5 * (1.0 + towards * face)
                total += _relief(distance, self.depth, self.extent, self.exponent)
        return total


class HelixSlope(AbstractFlankDeviation):
    """A lead that is straight but inclined.

    **Fields:**

    - `amount`: material added at the right end relative to the left, over the face width [m].
    """

    amount: Scalar = eqx.field(converter=as_scalar)

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del profile
        return 0.5 * self.amount * face


class Superposed(AbstractFlankDeviation):
    """The sum of several deviations of one flank. Without parts, the nominal involute.

    **Fields:**

    - `parts`: the deviations.
    """

    parts: tuple[AbstractFlankDeviation, ...] = ()

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        total = jnp.zeros_like(profile)
        for part in self.parts:
            total += part(profile, face)
        return total


class Flanks(eqx.Module):
    """The loaded flanks of a pair.

    **Fields:**

    - `pinion`: deviations of the pinion's teeth.
    - `wheel`: deviations of the wheel's teeth.
    """

    pinion: AbstractFlankDeviation = eqx.field(default_factory=Superposed)
    wheel: AbstractFlankDeviation = eqx.field(default_factory=Superposed)
