"""Many members of one kind: one after the other on a CPU, side by side on other devices."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jaxgear._checks import require

_Found = TypeVar("_Found")


def over_batch(
    function: Callable[[Any], _Found], members: Any, *, on_cpu: int = 1, elsewhere: int = 64
) -> _Found:
    """What a function of one member makes of each of many.

    Those side by side all wait for the one that iterates longest, and a processor's cache holds the
    numbers of few: on a CPU one after the other is often as fast. A GPU is full with a hundred mesh
    cycles or steady states, and one alone leaves it idle. It can be traced and differentiated; the
    device is that of JAX's default backend.

    **Arguments:**

    - `function`: of one member, traceable by JAX.
    - `members`: arrays, or a pytree of them, members along the first axis.
    - `on_cpu`: so many at most side by side on a CPU, at least 1.
    - `elsewhere`: on other devices: memory grows with it.

    **Returns:**

    What the function returns, members along the first axis.

    **Raises:**

    - `ValueError` if there are no members, arrays have different numbers of them, or none may stand
        side by side.
    """
    most = on_cpu if jax.default_backend() == "cpu" else elsewhere
    counts = {jnp.shape(x)[:1] for x in jax.tree.leaves(members)}
    require(
        len(counts) == 1 and () not in counts,
        "All arrays of a batch must have as many members, along their first axis; shapes begin "
        "with {got}.",
        got=", ".join(map(str, sorted(counts))) or "nothing",
    )
    ((count,),) = counts
    require(count > 0, "A batch needs at least one member.")
    require(most > 0, "At least one member must be computed at a time, got {most}.", most=most)
    if most == 1:
        return jax.lax.map(function, members)
    rounds = -(-count // most)
    if rounds == 1:
        return jax.vmap(function)(members)
    # As many in each round: the last is not another program. Places left over repeat a member.
    abreast = -(-count // rounds)
    places = jnp.minimum(jnp.arange(rounds * abreast), count - 1).reshape(rounds, abreast)
    found = jax.lax.map(
        lambda own: jax.vmap(function)(jax.tree.map(lambda x: jnp.asarray(x)[own], members)), places
    )
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:count], found)
