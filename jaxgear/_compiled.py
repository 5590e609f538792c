"""Verbs that are compiled as a whole, and what can be known of values outside of a program.

A verb that is called as it is costs one program, not one for each of its operations. Inside
somebody else's program it is a part of that. What depends on values, such as a refusal, stands
outside of what is compiled: inside, values are not known.
"""

import functools
import inspect
import time
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._checks import is_traced
from jaxgear._kept_programs import (
    QUICKLY,
    USUALLY,
    Options,
    keeps_verbs,
    make_room,
    verb_called,
)

_Given = ParamSpec("_Given")
_Found = TypeVar("_Found")


def compiled(verb: Callable[_Given, _Found]) -> Callable[_Given, _Found]:
    """Compile a verb as a whole, once for all values of its arrays and real numbers.

    Integers, flags, texts, what is static in a module, and keyword-only arguments that are no
    arrays are settings: they are part of the program, and another value is another program.

    **Arguments:**

    - `verb`: a pure function.

    **Returns:**

    The same function, compiled where it is called.
    """
    return _compiled(verb)


def lasting(verb: Callable[_Given, _Found]) -> Callable[_Given, _Found]:
    """As `compiled`, of a verb that takes long to trace: in a study its program is kept on disk.

    All that the verb returns are arrays.

    **Arguments:**

    - `verb`: a pure function that stands in its module, or class, by its name.

    **Returns:**

    The same function, compiled where it is called.
    """
    return _compiled(verb, USUALLY)


def lasting_rare(verb: Callable[_Given, _Found]) -> Callable[_Given, _Found]:
    """As `lasting`, of a verb that a study calls a few times: a third of the time to compile.

    **Arguments:**

    - `verb`: as of `lasting`.

    **Returns:**

    The same function, compiled where it is called.
    """
    return _compiled(verb, QUICKLY)


def _compiled(
    verb: Callable[_Given, _Found], kept: Options | None = None
) -> Callable[_Given, _Found]:
    """A verb compiled as a whole; kept in studies where it is said how it is compiled."""
    program: Callable[..., _Found] = eqx.filter_jit(verb)
    names = inspect.signature(verb).parameters
    settings = {name for name, each in names.items() if each.kind is each.KEYWORD_ONLY}

    @functools.wraps(verb)
    def call(*args: _Given.args, **kwargs: _Given.kwargs) -> _Found:
        named = {
            name: value if name in settings else _traceable(value) for name, value in kwargs.items()
        }
        given = tuple(map(_traceable, args))
        if kept is not None and keeps_verbs() and not any_traced(given, named):
            return verb_called(call, verb, given, named, kept)
        started = time.monotonic()
        found = program(*given, **named)
        if time.monotonic() - started > _COMPILING and not any_traced(found):
            make_room()
        return found

    return call


# A call that takes longer may have compiled something [s].
_COMPILING = 0.3


def any_traced(*trees: Any) -> bool:
    """Whether JAX is tracing anything in some trees."""
    return any(map(is_traced, jax.tree.leaves(trees)))


def _traceable(value: Any) -> Any:
    """A Python float as an array: `filter_jit` would take it for a part of the program."""
    return jnp.asarray(value, dtype=float) if isinstance(value, float) else value


def in_numpy(value: Any) -> Any:
    """The numbers of an array, or the array itself while it is being traced: for arithmetic.

    A check on them costs no program.
    """
    return value if is_traced(value) else np.asarray(value)


def known_to_fail(ok: Any) -> bool:
    """Whether flags that must all hold are known not to: also under `jax.grad` without `jit`."""
    try:
        return not bool(jnp.all(ok))
    except jax.errors.TracerBoolConversionError:
        return False
