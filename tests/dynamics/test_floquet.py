"""Products of many steps, against one step after the other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import cases

import jaxgear as jg
from jaxgear._dynamics._floquet import leading_multipliers, slow_modes
from jaxgear._dynamics._step_product import _JOINED, _blocks, _over, _Step


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


def _behind_a_spring(light: float) -> jg.DynamicSystem:
    """The parametric oscillator, its teeth on a light body behind a spring."""
    whole = cases.sdof_parametric()
    spring = 20.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    mass = np.diag([1.0, light])
    return cases._system(
        whole.table,
        mass=mass,
        damping=0.04 * mass,
        stiffness=spring,
        vectors=[[0.0], [1.0]],
        load=[1.0, 0.0],
        mean=[[1.0]],
        rest=whole.rest,
    )


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1.95, 0.7])
def test_fast_modes_follow_as_springs(speed):
    """Multipliers of the slow modes, stable and not: their error falls with the fast ones' mass."""
    errors = []
    for light in (0.05, 0.025):
        system = _behind_a_spring(light)
        orbit = jg.steady_state(system, jnp.asarray(speed))
        modes = jg.modal_basis(system)
        slow = slow_modes(modes, 1)
        whole = jg.floquet_multipliers(jg.monodromy(system, modes, orbit), modes)
        assert (abs(whole[0]) > 1.0) == (speed > 1.0)
        with_springs, without = (
            leading_multipliers(jg.monodromy(system, slow.basis, orbit, follows=x), slow.basis)[0]
            for x in (slow.follows, None)
        )
        errors.append(np.min(np.abs(whole - with_springs)))
        assert np.min(np.abs(whole - without)) > 50.0 * errors[-1]
    assert errors[0] < 3e-5
    assert 1.8 < errors[0] / errors[1] < 6.0


def test_few_modes_are_all_kept():
    modes = jg.modal_basis(_behind_a_spring(1e-3))
    assert slow_modes(modes).basis is modes
    assert slow_modes(modes).follows is None
