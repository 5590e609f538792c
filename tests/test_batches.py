"""Members of a batch: the same numbers however many stand side by side."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxgear as jg


def _root(member):
    """Newton's way to a square root: each member iterates as long as it needs."""
    number, scale = member
    step = lambda x: 0.5 * (x + number / x)
    goes_on = lambda x: jnp.abs(x * x - number) > 1e-13 * number
    return {
        "root": scale * jax.lax.while_loop(goes_on, step, number),
        "pair": jnp.stack([scale] * 2),
    }


@pytest.mark.parametrize("count", [1, 2, 6, 7])
@pytest.mark.parametrize("most", [1, 2, 3, 7, 100])
def test_a_batch_is_its_members(count, most):
    number, scale = np.arange(1.0, count + 1.0), np.linspace(-1.0, 1.0, count)
    found = jax.jit(lambda *both: jg.over_batch(_root, both, on_cpu=most))(number, scale)
    np.testing.assert_allclose(found["root"], scale * np.sqrt(number), rtol=1e-12)
    np.testing.assert_array_equal(found["pair"], np.stack([scale, scale], axis=1))


@pytest.mark.parametrize(("platform", "most"), [("cpu", 2), ("gpu", 5)])
def test_members_side_by_side(monkeypatch, platform, most):
    """On a CPU as many as `on_cpu`, elsewhere as `elsewhere`; rounds are of one size."""
    monkeypatch.setattr(jax, "default_backend", lambda: platform)
    sizes = []

    @jax.custom_batching.custom_vmap
    def seen(x):
        return x

    @seen.def_vmap
    def _(size, batched, x):
        assert batched == [True]
        sizes.append(size)
        return x, True

    found = jg.over_batch(seen, jnp.arange(12.0), on_cpu=2, elsewhere=5)
    np.testing.assert_array_equal(found, np.arange(12.0))
    assert set(sizes) == {{2: 2, 5: 4}[most]}


def test_a_batch_is_differentiated():
    numbers = jnp.arange(1.0, 6.0)
    value = lambda x: jnp.sum(jg.over_batch(lambda one: one**3, x, on_cpu=2))
    np.testing.assert_allclose(jax.grad(value)(numbers), 3.0 * numbers**2, rtol=1e-14)


def test_what_is_no_batch_is_refused():
    with pytest.raises(ValueError, match=r"as many members.* \(2,\), \(3,\)"):
        jg.over_batch(lambda both: both[0] + both[1], (jnp.zeros(2), jnp.zeros(3)))
    for no_batch in (jnp.asarray(1.0), ()):
        with pytest.raises(ValueError, match="as many members"):
            jg.over_batch(jnp.sin, no_batch)
    with pytest.raises(ValueError, match="at least one member"):
        jg.over_batch(jnp.sin, jnp.zeros(0))
    with pytest.raises(ValueError, match="got 0"):
        jg.over_batch(jnp.sin, jnp.zeros(3), on_cpu=0, elsewhere=0)
