r"""How far along its face a tooth feels a load: operators in the place of slices on their own.

A part of a tooth that gives $c$ under an even line load obeys $u - \lambda^2 u'' = c f'$ along
the face, $\lambda$ its decay length, and its ends are free at the gear's own faces: $u' = 0$. That
is the equation of a foundation whose neighbours are tied by shear (Pasternak's, upside down). An
even load moves it by $c f'$ whatever $\lambda$ is, a cosine of wave number $k$ by
$c/(1 + \lambda^2 k^2)$, and where the other gear ends before it the part beyond helps to carry.
$\lambda \to 0$ are slices on their own.

The contact itself is of no single length. Below a strip of half width $a_H$ on an elastic
half-space a load $\cos kz$ gives $\frac{2(1-\nu^2)}{\pi E}\ln\frac{1}{k t_0}$ with
$t_0 = a_H e^{\gamma - 1/2}/4$ in the middle of the strip (the modified Bessel function $K_0(kx)$
over Hertz' ellipse), and an even load Weber's $\ln(2d/a_H) - \nu/(2(1-\nu)) = \ln(t_1/t_0)$.
Since $\int_{t_0}^{t_1}\frac{1}{1 + k^2t^2}\frac{dt}{t}$ is both, penetration is a sum of such parts
with all lengths from $t_0$ to $t_1$, in equal shares on a scale of logarithms. None is fitted.
"""

from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._compiled import compiled, in_numpy
from jaxgear._types import Bodies, Reals, Scalar, as_scalar

if TYPE_CHECKING:
    Lengths = Array
else:
    Lengths = Float[Array, " length"]

# Euler's constant.
_EULER = float(np.euler_gamma)

STRIP = 0.25 * float(np.exp(_EULER - 0.5))
r"""$t_0/a_H$, the shortest length in a contact over its half width [-]."""


class FaceCoupling(eqx.Module):
    r"""Decay lengths of the parts of a tooth along its face, in modules (theory 4.1 to theory 4.4).

    Found by comparison with 3-D finite elements of single gears under cosine loads, 45 and 86
    teeth, faces of 7.7 and 6.3 modules, solid bodies. With these and no length of its own for the
    contact, modes 0 to 7 of 24 lines and of neighbouring teeth are met to 4 % (RMS).

    **Fields:**

    - `beam`: of the tooth as a cantilever [-].
    - `root`: of what is near the root, the half-plane part of the foundation [-].
    - `body`: of the rest of the body, within a tooth and from tooth to tooth [-].
    - `end`: how far from its faces a gear is in plane stress rather than plane strain [-].
    - `free_end`: by how much the contact's image in a free end is enlarged, over that of
        Guilbault; zero: a plane of symmetry, and an even load is met evenly up to the ends [-].

    **Raises:**

    - `ValueError` unless all are positive, and `body` is no less than `root`.
    """

    beam: Scalar = eqx.field(converter=as_scalar, default=1.11)
    root: Scalar = eqx.field(converter=as_scalar, default=1.94)
    body: Scalar = eqx.field(converter=as_scalar, default=4.0)
    end: Scalar = eqx.field(converter=as_scalar, default=1.66)
    free_end: Scalar = eqx.field(converter=as_scalar, default=1.0)

    def __check_init__(self):
        for name in ("beam", "root", "body", "end"):
            require(
                in_numpy(getattr(self, name)) > 0.0,
                "`FaceCoupling.{name}` is a length in modules, so it must be positive, got "
                "{got:.6g}. To leave slices on their own, give no `FaceCoupling`.",
                name=name,
                got=getattr(self, name),
            )
        # With it, no difference of the two operators is negative.
        require(
            in_numpy(self.body) >= in_numpy(self.root),
            "`FaceCoupling.body` must be no less than `root`, {root:.6g}, got {got:.6g}: a body "
            "spreads a load further than the root of one tooth.",
            root=self.root,
            got=self.body,
        )

    def end_image(self, poisson: Reals, angle: Reals) -> Reals:
        r"""By how much the contact's image in a free end exceeds that in a plane of symmetry [-].

        $\psi(\pi/\omega - 1) - 1$ with $\psi = 1.29 - (0.08 - 0.5\nu)/(1 - \nu)$; 0.39 for steel at
        a right angle. Attributed to Guilbault 2011, J. Tribol. 133, 031402, for the elastic
        quarter-space: the text was not at hand, so that what holds the factor is its error against
        finite elements. A wedge of the angle $\omega$ is filled by $2\pi/\omega$ images, half of
        them in each of its sides: beside its edge a load meets $\pi/\omega$ times what it meets
        far from it.

        **Arguments:**

        - `poisson`: Poisson's ratio [-].
        - `angle`: $\omega$ between flank and face [rad].
        """
        square = 1.0 + self.free_end * (0.29 - (0.08 - 0.5 * poisson) / (1.0 - poisson))
        return square * (jnp.pi / angle - 1.0) - 1.0

    def finite_width(self, face_width: Scalar, module: Scalar, poisson: Scalar) -> Scalar:
        r"""How much more a gear gives than in plane strain, under an even load.

        $1 + \frac{\nu^2}{1-\nu^2}\,\frac{\tanh x}{x}$ with $x = b/(2 e m_n)$: in plane stress near
        both faces, in plane strain far from them. A narrow gear is a disc in plane stress.

        **Arguments:**

        - `face_width`: $b$ of the gear [m].
        - `module`: $m_n$ [m].
        - `poisson`: Poisson's ratio [-].

        **Returns:**

        The factor on everything but the contact [-].
        """
        x = 0.5 * face_width / (self.end * module)
        return 1.0 + poisson**2 / (1.0 - poisson**2) * jnp.tanh(x) / x


@compiled
def face_operator(
    length: Reals, slices: int, common: Scalar, face: Scalar
) -> Float[Array, "*length slice slice"]:
    r"""Motion of each slice per force on each, of a part of compliance one.

    Means over slices of
    $\frac{\cosh(z_</\lambda)\cosh((B - z_>)/\lambda)}{\lambda\sinh(B/\lambda)}$, in exponentials
    that neither overflow nor cancel where slices are far longer or far shorter than $\lambda$.
    Symmetric, positive definite; every row's sum times a slice's width is 1 where the slices cover
    the whole face.

    **Arguments:**

    - `length`: $\lambda$, one or several [m].
    - `slices`: over the common face.
    - `common`: length of the common face, in the middle of the gear's own [m].
    - `face`: length $B$ of the gear's own face [m].

    **Returns:**

    The operator for each length [1/m].
    """
    width, index = common / slices, np.arange(slices)
    place = 0.5 * (face - common) + width * _beside(index + 0.5, length)
    lower, upper = np.minimum.outer(index, index), np.maximum.outer(index, index)
    length = length[..., None]
    step = width / length
    mean = -jnp.expm1(-step) / step
    whole = -jnp.expm1(-2.0 * face / length)
    # The images of a slice beyond both ends of the face.
    left, right = jnp.exp(-2.0 * place / length), jnp.exp(-2.0 * (face - place) / length)
    images = (1.0 + left[..., lower]) * (1.0 + right[..., upper])
    between = np.maximum(upper - lower - 1.0, 0.0)
    apart = jnp.exp(-step[..., None] * _beside(between, length[..., 0])) * images
    apart = (0.5 * mean**2 / (length * whole))[..., None] * apart
    # Within one slice: what an even load gives, less what comes from the rest of the face.
    taken = (1.0 + left) * -jnp.expm1((width - 2.0 * (face - place)) / length)
    taken += (1.0 + right) * -jnp.expm1((width - 2.0 * place) / length)
    own = (1.0 - 0.5 * mean * taken / whole) / width
    same = np.broadcast_to(np.eye(slices, dtype=bool), apart.shape)
    return jnp.where(same, own[..., None], apart)


@compiled
def leaning_operator(
    length: Lengths,
    lost: Lengths,
    slices: int,
    common: Scalar,
    face: Scalar,
    shift: Scalar,
    apart: Scalar,
) -> Float[Array, "length slice slice"]:
    r"""The operator between places in a body that are shifted along its face, in reach of slices.

    What presses on the flank of a helical tooth meets the middle of it further along its face; what
    would meet it beyond its end meets it at the end. Symmetric, positive definite; between two
    teeth, nearest places of which are not abreast, neither.

    **Arguments:**

    - `length`: $\lambda$, none far above the face [m].
    - `lost`: of the body at either end, where it bears nothing, for each [m].
    - `slices`, `common`, `face`: as of `face_operator`.
    - `shift`: towards the second end of the face [m].
    - `apart`: by how much further the places of rows are shifted than those of columns [m].

    **Returns:**

    The operator for each length [1/m].
    """
    width = common / slices
    # No less than a slice is left to bear, nor than half of the face.
    lost = jnp.minimum(lost, jnp.minimum(0.5 * (face - width), 0.25 * face))
    place = 0.5 * (face - common) + width * jnp.asarray(np.arange(slices) + 0.5) + shift
    bearing = (face - 2.0 * lost)[:, None]

    def inside(more: Scalar) -> Reals:
        """Strictly: without a shift no place leaves the face by rounding."""
        moved = (place + more)[None] - lost[:, None]
        moved = jnp.where(moved < (0.5 - 1e-9) * width, 0.5 * width, moved)
        over = moved > bearing - (0.5 - 1e-9) * width
        return jnp.where(over, bearing - 0.5 * width, moved)

    rows, columns = inside(0.5 * apart)[:, :, None], inside(-0.5 * apart)[:, None, :]
    length, bearing = length[:, None, None], bearing[..., None]
    between, step = jnp.abs(rows - columns), width / length

    def mean(distance: Reals, sign: float, far: Reals) -> Reals:
        r"""Twice the integral of $e^{-|x|/\lambda}$, or of its inverse times what is far less."""
        scaled = jnp.abs(distance) / length
        return jnp.exp(-sign * scaled - far) + sign * scaled * jnp.exp(-far)

    def means(sign: float, far: Reals) -> Reals:
        ends = mean(between + width, sign, far) + mean(between - width, sign, far)
        return (ends - 2.0 * mean(between, sign, far)) / step**2

    # A slice's mean of an exponential is that of its middle, times this.
    wider = (jnp.sinh(0.5 * step) / (0.5 * step)) ** 2
    sums, far = rows + columns, 2.0 * bearing / length
    images = wider * (jnp.exp(-sums / length) + jnp.exp(sums / length - far))
    direct = means(1.0, jnp.zeros_like(far)) + means(-1.0, far)
    return (direct + images) / (-2.0 * length * jnp.expm1(-far))


@compiled
def end_images(
    length: Reals, slices: int, common: Scalar, face: Scalar, ends: Bodies | None = None
) -> Float[Array, "*length slice slice"]:
    r"""What the mirror images of slices beyond both ends of a face add to them.

    Means over slices of $\frac{1}{2\lambda}(e^{-(z + z')/\lambda} + e^{-(2B - z - z')/\lambda})$: a
    free end is no plane of symmetry, and gives way by more than the image in it.

    **Arguments:**

    - `length`, `slices`, `common`, `face`: as of `face_operator`.
    - `ends`: factors on the images beyond the first end and the second; by default 1 [-].

    **Returns:**

    The operator for each length, of rank two [1/m].
    """
    ends = jnp.ones(2) if ends is None else ends
    width = common / slices
    first = 0.5 * (face - common) + width * _beside(np.arange(float(slices)), length)
    length = length[..., None]
    mean = -jnp.expm1(-width / length) / (width / length)
    left = mean * jnp.exp(-first / length)
    right = mean * jnp.exp((first + width - face) / length)
    pairs = zip(ends, (left, right), strict=True)
    both = sum(factor * x[..., :, None] * x[..., None, :] for factor, x in pairs)
    return 0.5 * both / length[..., None]


def _beside(numbers: np.ndarray, length: Reals) -> Array:
    """Numbers on axes of their own, after those of the lengths."""
    return jnp.asarray(numbers).reshape(*[1] * length.ndim, *numbers.shape)
