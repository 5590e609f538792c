import jax.numpy as jnp
import jaxtyping
import pytest
from jaxtyping import Array, Float
from late_checks import checked

import jaxgear as jg


@jaxtyping.jaxtyped(typechecker=checked)
def _shortened(x: Float[Array, " entry"], by: int) -> Float[Array, " entry"]:
    return x[by:]


def test_shapes_are_checked_in_every_call_and_of_what_is_returned():
    x = jnp.zeros(3)
    for _ in range(2):
        assert _shortened(x, 0).shape == (3,)
        with pytest.raises(jaxtyping.TypeCheckError, match="return value"):
            _shortened(x, 1)
        with pytest.raises(jaxtyping.TypeCheckError, match="parameters"):
            _shortened(x[None], 0)


def test_shapes_are_checked_in_the_packages():
    with pytest.raises(jaxtyping.TypeCheckError, match="width"):
        jg.smooth_ramp(jnp.zeros(3), jnp.ones(2))
