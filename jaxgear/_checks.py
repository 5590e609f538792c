"""The two kinds of check: of what a user builds, and of the precision they build it in."""

import sys


class InputError(ValueError):
    """What a user gave cannot be; the message says why and what to do."""


def is_traced(value: object) -> bool:
    """Say whether JAX is tracing a value. Where nobody has imported JAX, it traces nothing.

    **Arguments:**

    - `value`: anything.
    """
    jax = sys.modules.get("jax")
    return jax is not None and isinstance(value, jax.core.Tracer)


def require(ok: object, message: str, **values: object) -> None:
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
    if is_traced(ok) or ok:
        return
    raise InputError(message.format(**values))


def require_float64() -> None:
    """Raise unless JAX computes in double precision.

    A 0.1 m radius in single precision moves in steps of 7 nm, 0.7 % of a 1 um relief.

    **Raises:**

    - `ValueError` if `jax_enable_x64` is off.
    """
    import jax.numpy as jnp

    require(
        jnp.zeros(()).dtype == jnp.float64,
        "jaxgear needs double precision, and JAX is in single precision. Put "
        '`jax.config.update("jax_enable_x64", True)` at the top of your script, before any array '
        "is made.",
    )
