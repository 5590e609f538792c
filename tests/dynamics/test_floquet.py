"""Products of many steps, against one step after the other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxgear._dynamics._floquet import _JOINED, _blocks, _over, _Step


@pytest.mark.parametrize(("length", "seen"), [(2 * _JOINED + 7, 2), (2 * _JOINED, 4), (3, 2)])
def test_blocks_of_steps_are_their_product(length, seen):
    """Blocks of unlike size, with and without damping cells, over two periods."""
    size, width = 6, 2
    random = np.random.default_rng(3)
    free = np.linalg.qr(random.normal(size=(size, size)))[0]
    look, push = random.normal(size=(seen, size)), random.normal(size=(size, width))
    gains = 0.1 * random.normal(size=(2, length, width, seen))
    step = _Step(jnp.asarray(free), jnp.asarray(look), jnp.asarray(push))

    def product(gains):
        blocks = _blocks(step, gains)
        state = jnp.eye(size)
        for period in range(2):
            for joined, each in blocks:
                for gain in each[period]:
                    state = _over(joined, gain, state)
        return state, sum(each.shape[1] * each.shape[2] for _, each in blocks)

    found, count = jax.jit(product)(jnp.asarray(gains))
    assert count == length
    expected = np.eye(size)
    for gain in gains.reshape(-1, width, seen):
        expected = (free - push @ gain @ look) @ expected
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())
    leading = lambda matrix: np.sort(np.abs(np.linalg.eigvals(matrix)))[-2:]
    np.testing.assert_allclose(leading(np.asarray(found)), leading(expected), rtol=1e-8)
