"""Power lost in sliding: against the closed form, by hand, and its derivatives."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from cases import sizes
from helpers import assert_close, assert_gradient
from solve_cases import ACCESSORY

import jaxgear as jg


@pytest.fixture(scope="module")
def pair():
    return ACCESSORY.pair()


@pytest.fixture(scope="module")
def cycle(pair):
    """Constant stiffness on rigid bodies: pairs in contact share the load evenly."""
    model = jg.PairModel(pair, 120.0, compliance=jg.ConstantStiffness(14e9))
    return jg.mesh_cycle(model, jg.mesh_grid(pair, phases=64, slices=1))


def test_even_loads_lose_what_the_closed_form_says(pair, cycle):
    """The step with the pitch point in it, where sliding turns round, is the only one not exact."""
    exact = float(jg.tooth_loss_factor(pair))
    found = float(jg.mesh_loss_factor(pair, cycle))
    assert_close(found, exact, rtol=1e-3, atol=0.0)
    assert_close(
        jg.mesh_efficiency(pair, cycle, jnp.asarray(0.05)), 1.0 - 0.05 * found, rtol=1e-14, atol=0.0
    )


def test_one_cell_by_hand(pair, cycle):
    """All load 2 mm behind the pitch point: 2 mm (1 + 45/86) over r_b1 = 30.587891 mm."""
    force = np.zeros(cycle.force.shape)
    force[:, 0] = 700.0
    roll = jnp.full(cycle.cells.lines.roll.shape, pair.pitch_point + 2e-3)
    one = eqx.tree_at(lambda c: (c.force, c.cells.lines.roll), cycle, (jnp.asarray(force), roll))
    assert_close(jg.mesh_loss_factor(pair, one), 0.09959863, rtol=1e-7, atol=0.0)


@pytest.mark.slow
def test_efficiency_is_differentiable(cycle):
    """By every number of the drawing, the loads and the coefficient."""
    told = lambda given: jg.mesh_efficiency(
        given[0], eqx.tree_at(lambda c: c.force, cycle, given[1]), given[2]
    )
    given = ACCESSORY.pair(), cycle.force, jnp.asarray(0.05)
    assert_gradient(told, given, rtol=1e-5, step=1e-7, scale=sizes(given))
