"""What a body must be, said kindly, and how long work tells how far it is."""

import contextlib
from collections.abc import Callable

Progress = Callable[[str], contextlib.AbstractContextManager[None]]
"""Called with what begins; the context lasts as long as it does."""


class BodyError(ValueError):
    """A gear body that cannot be, or is not what it claims; the message says what to do."""


def require(ok: object, message: str, **values: object) -> None:
    """Raise `BodyError` unless `ok`.

    **Arguments:**

    - `ok`: what must hold.
    - `message`: a format string: what must hold, what was given, what to do.
    - `values`: what fills the message.

    **Raises:**

    - `BodyError` if `ok` is false.
    """
    if not ok:
        raise BodyError(message.format(**values))


def silent(step: str) -> contextlib.AbstractContextManager[None]:
    """Progress that nobody watches."""
    del step
    return contextlib.nullcontext()
