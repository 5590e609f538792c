"""The involute function and its inverse. Angles in radians."""

import jax
import jax.numpy as jnp

from jaxgear._types import Reals


def involute(angle: Reals) -> Reals:
    r"""$\mathrm{inv}\,\alpha = \tan\alpha - \alpha$ (ISO 21771-1, theory 1.2).

    **Arguments:**

    - `angle`: pressure angle [rad].

    **Returns:**

    Its involute [rad].
    """
    return jnp.tan(angle) - angle


@jax.custom_jvp
def inverse_involute(value: Reals) -> Reals:
    r"""The pressure angle whose involute is `value` (theory 1.2).

    Newton from $(3q)^{1/3} - 2q/5$, which needs four steps for any gear; six are taken. Its
    derivative is that of the inverse function, $1/\tan^2\alpha$.

    **Arguments:**

    - `value`: $q > 0$ [rad].

    **Returns:**

    Pressure angle [rad].
    """
    angle = jnp.cbrt(3.0 * value) - 0.4 * value
    # Written out, XLA would repeat all steps within each use of the angle.
    return jax.lax.fori_loop(0, 6, lambda _, x: x - (involute(x) - value) / jnp.tan(x) ** 2, angle)


@inverse_involute.defjvp
def _inverse_involute_jvp(primals: tuple[Reals], tangents: tuple[Reals]) -> tuple[Reals, Reals]:
    angle = inverse_involute(primals[0])
    return angle, tangents[0] / jnp.tan(angle) ** 2
