r"""How what acts on one slice of a face reaches the others.

The operator $(1 - \lambda^2\,d^2/dz^2)^{-1}$ on a face of width $B$ with free ends. Its kernel is
$\cosh(z_</\lambda)\cosh((B - z_>)/\lambda)/(\lambda\sinh(B/\lambda))$, $z$ from one end: symmetric,
positive, of unit integral, so that it leaves alone what is even.
"""

import jax.numpy as jnp

from jaxgear._types import Reals, Scalar, Slices


def face_kernel(places: Slices, width: Scalar, face: Scalar, decay: Reals) -> Reals:
    r"""Means of the kernel over the slices of a face.

    Over the rectangle from one end to $a$ and to $b \ge a$ the kernel integrates to
    $a - \lambda\sinh(a/\lambda)\sinh((B - b)/\lambda)/\sinh(B/\lambda)$; slices are differences.

    **Arguments:**

    - `places`: middles of equal slices that follow each other, from mid-face [m].
    - `width`: of one slice [m].
    - `face`: $B$, of the gear itself, at least as wide as the slices together [m].
    - `decay`: $\lambda$, a scalar or one for each of a batch [m].

    **Returns:**

    What a unit on one slice leaves on each, shape `[..., slice, slice]` [-]. It is symmetric. Rows
    sum to 1 where the slices cover the face, and to less where the face goes on beyond them.
    """
    length = jnp.asarray(decay)[..., None, None]
    edges = jnp.append(places - 0.5 * width, places[-1] + 0.5 * width) + 0.5 * face
    edges = edges.reshape((1,) * jnp.ndim(decay) + (-1,))
    near = jnp.minimum(edges[..., :, None], edges[..., None, :])
    far = jnp.maximum(edges[..., :, None], edges[..., None, :])
    # Hyperbolic functions of wide faces overflow; these exponentials fall.
    from_ends = jnp.expm1(-2.0 * near / length) * jnp.expm1(-2.0 * (face - far) / length)
    ratio = jnp.exp((near - far) / length) * from_ends / (-2.0 * jnp.expm1(-2.0 * face / length))
    integral = near - length * ratio
    return jnp.diff(jnp.diff(integral, axis=-1), axis=-2) / width
