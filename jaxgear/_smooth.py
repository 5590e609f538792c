"""Smooth stand-ins for sharp functions. Widths are arguments, in the unit of what they smooth."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgear._types import Reals, Scalar


def smooth_ramp(x: Reals, width: Scalar) -> Reals:
    r"""`max(0, x)` with its corner rounded by a twice differentiable spline.

    For $|x| < w$ it is $w (1 + x/w)^3 (3 - x/w) / 16$, outside it *is* the sharp ramp,
    so the bias is exactly zero where nothing lies within `width` of the corner.
    At the corner it is $3w/16$.

    **Arguments:**

    - `x`: any real array.
    - `width`: half-width $w > 0$ of the rounded corner, in the unit of `x`.

    **Returns:**

    An array like `x`, in its unit.
    """
    v = jnp.clip(x / width + 1.0, 0.0, 2.0)
    return jnp.where(x < width, width * v**3 * (4.0 - v) / 16.0, x)


def smooth_ramp_integral(x: Reals, width: Scalar) -> Reals:
    r"""Integral of `smooth_ramp` from $-\infty$: the energy whose slope it is.

    Beyond the corner it exceeds $x^2/2$ by the constant $w^2/10$.

    **Arguments:**

    - `x`: any real array.
    - `width`: half-width of the rounded corner, in the unit of `x`.

    **Returns:**

    An array like `x`, in its unit squared.
    """
    v = jnp.clip(x / width + 1.0, 0.0, 2.0)
    return jnp.where(x < width, width**2 * (v**4 - v**5 / 5.0) / 16.0, 0.5 * x**2 + 0.1 * width**2)


def smooth_maximum(x: Float[Array, "..."], width: Scalar) -> Scalar:
    r"""A differentiable upper bound of the largest element: $w \log \sum \exp(x/w)$ (theory 11.5).

    It exceeds the maximum by at most $w \log n$ for $n$ elements.

    **Arguments:**

    - `x`: any real array; all its elements take part.
    - `width`: $w > 0$, in the unit of `x`.

    **Returns:**

    The bound, in the unit of `x`.
    """
    return width * jax.scipy.special.logsumexp(x / width)
