"""The two kinds of check: of what a user builds, and of the precision they build it in."""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool


class InputError(ValueError):
    """What a user gave cannot be; the message says why and what to do."""


def require(ok: bool | Bool[Array, ""], message: str, **values: object) -> None:
    """Raise `InputError`, a `ValueError`, unless `ok`. Says nothing while `ok` is being traced.

    The message is a format string, filled from `values` only when it is needed: an
    f-string would format a tracer, and fail, on every construction inside `jit`.

    **Arguments:**

    - `ok`: what must hold.
    - `message`: a format string: what must hold, what was given, what to do.
    - `values`: what fills the message.

    **Raises:**

    - `InputError` if `ok` is false.
    """
    if isinstance(ok, Tracer) or ok:
        return
    raise InputError(message.format(**values))


def in_numpy(value: Array) -> Array | np.ndarray:
    """A number for a check: in NumPy, for which nothing is compiled, unless JAX traces it.

    **Arguments:**

    - `value`: to be checked.

    **Returns:**

    The same value.
    """
    return value if isinstance(value, Tracer) else np.asarray(value)


def require_float64() -> None:
    """Raise unless JAX computes in double precision.

    A 0.1 m radius in single precision moves in steps of 7 nm, 0.7 % of a 1 um relief.

    **Raises:**

    - `ValueError` if `jax_enable_x64` is off.
    """
    require(
        jnp.zeros(()).dtype == jnp.float64,
        "jaxgear needs double precision, and JAX is in single precision. Put "
        '`jax.config.update("jax_enable_x64", True)` at the top of your script, before any array '
        "is made.",
    )
