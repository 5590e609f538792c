r"""Real flanks: what is removed from, or added to, the nominal involute helicoid.

A positive deviation adds material along the outward normal, so it closes the gap. Depths
are material *removed*, as a user types them, and stay positive. Every law is written in two
dimensionless coordinates of the gear that carries it, so extents are fractions:

- `profile`: 0 where contact starts on this gear's flank, near its root, 1 at its tip, linear
  in roll length; one unit is the path of contact $\varepsilon_\alpha p_{bt}$.
- `face`: -1 at the left (-Z) end of this gear's face, 0 at mid-face, 1 at the right end.

Beyond 0..1 and -1..1 the laws go on smoothly, unless said. Reliefs, crowning: thesis figs. III-5,
IV-9. Slopes, barrelling and twist are named as in ISO 21771-1.
"""

import abc

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._compiled import in_numpy
from jaxgear._flank._indexing import Indexing
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
        (in_numpy(extent) > 0.0) & (in_numpy(extent) <= 1.0),
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
    """Relief that grows towards the tip (theory 2.1).

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
    """Relief that grows towards the start of active profile (theory 2.1).

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


class ProfileCrowning(AbstractFlankDeviation):
    """Parabolic crowning along the profile: barrelling (theory 2.2).

    **Fields:**

    - `depth`: material removed at the start of active profile and at the tip [m].
    """

    depth: Scalar = eqx.field(converter=as_scalar)

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del face
        return -self.depth * (2.0 * profile - 1.0) ** 2


class ProfileSlope(AbstractFlankDeviation):
    """A profile that is straight but inclined: another pressure angle.

    **Fields:**

    - `amount`: material added at the tip relative to the start of active profile [m]; at the
        middle of the path there is none.
    """

    amount: Scalar = eqx.field(converter=as_scalar)

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del face
        return self.amount * (profile - 0.5)


class ProfileWaviness(AbstractFlankDeviation):
    """A form deviation of the profile: one sine, the same across the face.

    **Fields:**

    - `amplitude`: from the mean to a peak, half of the peak-to-peak [m].
    - `waves`: periods between start of active profile and tip [-]; the mean is zero if whole.
    - `phase`: at the start of active profile [rad].
    """

    amplitude: Scalar = eqx.field(converter=as_scalar)
    waves: Scalar = eqx.field(converter=as_scalar)
    phase: Scalar = eqx.field(converter=as_scalar, default=0.0)

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del face
        return self.amplitude * jnp.sin(2.0 * jnp.pi * self.waves * profile + self.phase)


class Crowning(AbstractFlankDeviation):
    """Parabolic crowning across the face (theory 2.2).

    **Fields:**

    - `depth`: material removed at both ends of the face [m].
    """

    depth: Scalar = eqx.field(converter=as_scalar)

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del profile
        return -self.depth * face**2


class EllipticalCrowning(AbstractFlankDeviation):
    r"""Crowning across the face along half an ellipse: flat in the middle, steep at the ends.

    $-d\,(1 - \sqrt{1 - z^2})$ with $z$ the place across the face: the semi-axes are half the face
    width and the depth. At the ends the ellipse is as steep as a wall; there and beyond,
    the depth is constant and the slope zero. Crowning that is partly parabolic is the sum of
    this and `Crowning` in `Superposed`; a class of its own would only repeat that sum (theory 2.2).

    **Fields:**

    - `depth`: material removed at both ends of the face [m].
    """

    depth: Scalar = eqx.field(converter=as_scalar)

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        del profile
        inside = 1.0 - face**2
        # The root of zero has no slope to multiply by a zero, so it must not be taken at all.
        root = jnp.where(inside > 0.0, jnp.sqrt(jnp.where(inside > 0.0, inside, 1.0)), 0.0)
        return -self.depth * (1.0 - root)


class EndRelief(AbstractFlankDeviation):
    """Relief that grows towards one end of the face, or both (theory 2.1).

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


class Bias(AbstractFlankDeviation):
    r"""Twist: a profile slope that changes across the face, bilinear, without slope or mean.

    $\tfrac12 S\,(p - \tfrac12)\,z$ with $p$ the place on the profile, $z$ the one across the face.
    The same $S$ is the profile slope at the right end less that at the left end, and the helix
    slope at the tip less that at the start of active profile (theory 2.3).

    **Fields:**

    - `amount`: $S$ [m]. If positive, the tip's right corner and the opposite one have
        $S/4$ of material added, the other two as much removed.
    """

    amount: Scalar = eqx.field(converter=as_scalar)

    def __call__(self, profile: Reals, face: Reals) -> Reals:
        """Evaluate the deviation [m]; see the base class."""
        return 0.5 * self.amount * (profile - 0.5) * face


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
    - `pinion_indexing`: how the pinion's teeth differ from each other, or `None` if alike.
    - `wheel_indexing`: the same for the wheel's teeth.
    """

    pinion: AbstractFlankDeviation = eqx.field(default_factory=Superposed)
    wheel: AbstractFlankDeviation = eqx.field(default_factory=Superposed)
    pinion_indexing: Indexing | None = None
    wheel_indexing: Indexing | None = None
