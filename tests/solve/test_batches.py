"""Batches of coupled contact problems: what they share, and that each is the one solved alone."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close

import jaxgear as jg

CELLS, GAPS = 12, 5
SETTINGS = jg.SolverSettings()


def _problem() -> jg.ContactProblem:
    """Cells that all feel each other, and a drive."""
    rng = np.random.default_rng(5)
    stiffness = rng.uniform(0.5e8, 1.5e8, CELLS)
    root = rng.normal(size=(CELLS, CELLS))
    return jg.ContactProblem(
        stiffness=jnp.asarray(stiffness),
        gap=jnp.zeros(CELLS),
        arms=jnp.ones((CELLS, 1)),
        flexibility=jnp.zeros((1, 1)),
        direction=jnp.ones(1),
        force=jnp.asarray(500.0),
        coupling=jnp.asarray(root @ root.T / CELLS / stiffness.mean()),
    )


def _approach(gap: jax.Array, law: jg.AbstractContactLaw) -> jax.Array:
    problem = _problem()
    problem = jg.ContactProblem(**{**vars(problem), "gap": gap})
    return jg.contact_state(problem, law, SETTINGS).approach


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", [jg.ExactContact(), jg.SmoothContact(2e-6)], ids=["exact", "smooth"]
)
def test_a_batch_of_gaps_is_each_solved_alone(law):
    """Values and gradients, open and closed cells; nested batches too.

    Of the first problem the second half of the cells is far out of contact: the others are solved
    by themselves.
    """
    gaps = jnp.asarray(np.random.default_rng(6).uniform(0.0, 8e-6, (2, GAPS, CELLS)))
    gaps = gaps.at[0, 0, CELLS // 2 :].set(1e-3)
    both = jax.value_and_grad(lambda gap: _approach(gap, law))
    alone = jax.jit(both)
    found = jax.jit(jax.vmap(jax.vmap(both)))(gaps)
    for i, j in np.ndindex(2, GAPS):
        value, slope = alone(gaps[i, j])
        assert_close(found[0][i, j], value, rtol=1e-12, atol=0.0)
        assert_close(found[1][i, j], slope, rtol=1e-10, atol=1e-14)
    assert 0.0 < float(jnp.mean(found[1] == 0.0)) < 0.9 or not isinstance(law, jg.ExactContact)


def test_the_first_guess_spares_factors():
    """Without gaps all cells close at once; under a steep flank the guess is close."""
    problem = _problem()
    # Each cell feels its neighbours, as along the face of a tooth.
    apart = np.abs(np.subtract.outer(np.arange(CELLS), np.arange(CELLS)))
    coupling = jnp.asarray(np.exp(-apart) / 1e8)
    even = dataclasses.replace(problem, coupling=coupling)
    steep = dataclasses.replace(even, gap=jnp.linspace(0.0, 1e-5, CELLS))
    taken = {}
    for name, each in (("even", even), ("steep", steep)):
        state = jg.contact_state(each, jg.ExactContact(), SETTINGS)
        assert bool(state.converged)
        taken[name] = int(state.steps)
    assert taken["even"] == 1
    assert 0.2 < float(jnp.mean(state.force > 0.0)) < 0.6
    assert taken["steep"] <= 2
