"""Cells that share a body within each slice, against the same problem stated densely.

The dense statement has one mesh coordinate per cell, $W = 1$, and $A H A^T + C$ in its flexibility:
nothing of the slice-wise elimination is in it. The reference solves the dual by non-negative least
squares.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close
from scipy.optimize import nnls
from solve_cases import zero

import jaxgear as jg
from jaxgear._contact._coupling import body_yield, share_with_body

SETTINGS = jg.SolverSettings()
LINES, SLICES = 3, 4
CELLS = LINES * SLICES
# Flexibility of the bodies over that of the cells, about.
BODIES = (1e-3, 0.3, 30.0)
STRUCTURES = (0.0, 1e-3, 0.3, 30.0)
GAPS = (0.0, 1e-7, 5e-6, 1e-3)


class Draw(NamedTuple):
    """The fields of `ContactProblem`, in their order."""

    stiffness: np.ndarray
    gap: np.ndarray
    arms: np.ndarray
    flexibility: np.ndarray
    direction: np.ndarray
    force: np.ndarray
    coupling: np.ndarray


def _body(rng: np.random.Generator, size: float, lines: int, slices: int) -> np.ndarray:
    """A symmetric positive semi-definite compliance in each slice, of full rank or of one."""
    modes = rng.normal(size=(slices, lines, int(rng.choice([1, lines]))))
    return size * np.einsum("sia,sja->ijs", modes, modes) / modes.shape[2]


def _draw(rng: np.random.Generator, body: float, structure: float, gap: float) -> Draw:
    """Two mesh coordinates; some cells are out of mesh."""
    stiffness = 10.0 ** rng.uniform(6.0, 8.0, CELLS)
    stiffness[1:] *= rng.random(CELLS - 1) > 0.2
    arms = np.stack([np.ones(CELLS), rng.uniform(-0.05, 0.05, CELLS)], axis=1)
    modes = rng.normal(size=(2, 2)) * np.array([[1.0], [40.0]])
    return Draw(
        stiffness,
        gap * rng.normal(size=CELLS),
        arms,
        structure / stiffness.sum() * modes @ modes.T,
        np.array([1.0, 0.0]),
        np.asarray(10.0 ** rng.uniform(1.0, 4.5)),
        _body(rng, body / stiffness.max(), LINES, SLICES),
    )


def _flat(coupling: np.ndarray) -> np.ndarray:
    """The compliance of all cells, line times slice, as one matrix."""
    lines, _, slices = coupling.shape
    full = np.zeros((lines, slices, lines, slices))
    for k in range(slices):
        full[:, k, :, k] = coupling[:, :, k]
    return full.reshape(lines * slices, -1)


def _dense(draw: Draw) -> tuple[np.ndarray, ...]:
    flexibility = draw.arms @ draw.flexibility @ draw.arms.T + _flat(draw.coupling)
    driven = draw.arms @ draw.direction
    return draw.stiffness, draw.gap, np.eye(CELLS), flexibility, driven, draw.force


def _one(draw: tuple[np.ndarray, ...]) -> jg.ContactProblem:
    return jg.ContactProblem(*(jnp.asarray(part) for part in draw))


class States(NamedTuple):
    """Approach, cell forces, loads and convergence of many problems."""

    approach: np.ndarray
    force: np.ndarray
    load: np.ndarray
    converged: np.ndarray
    steps: np.ndarray


@eqx.filter_jit
def _batch(parts: tuple[jax.Array, ...], law: jg.AbstractContactLaw) -> tuple[jax.Array, ...]:
    def one(*part: jax.Array) -> tuple[jax.Array, ...]:
        state = jg.contact_state(jg.ContactProblem(*part), law, SETTINGS)
        return tuple(getattr(state, name) for name in States._fields)

    return jax.vmap(one)(*parts)


def _solve_all(draws: Sequence[tuple[np.ndarray, ...]]) -> States:
    """Any number of problems, by one program of 48."""
    parts = [np.stack(part) for part in zip(*draws, strict=True)]
    found = []
    for first in range(0, len(draws), 48):
        some = [np.resize(part[first : first + 48], (48, *part.shape[1:])) for part in parts]
        found.append(_batch(tuple(jnp.asarray(part) for part in some), jg.ExactContact()))
    return States(*(np.concatenate(x)[: len(draws)] for x in zip(*found, strict=True)))


_solve = eqx.filter_jit(jg.contact_state)


def _draws(seed: int, each: int) -> list[Draw]:
    rng = np.random.default_rng(seed)
    return [
        _draw(rng, body, structure, gap)
        for body in BODIES
        for structure in STRUCTURES
        for gap in GAPS
        for _ in range(each)
    ]


# --- the two functions of a slice


def test_yield_and_sharing_against_full_matrices():
    """C f and (1 + K C)^-1 r of 4 lines in 5 slices, open cells included, by LAPACK."""
    rng = np.random.default_rng(1)
    coupling = _body(rng, 1e-8, 4, 5)
    stiffness = 10.0 ** rng.uniform(6, 10, 20) * (rng.random(20) > 0.3)
    columns = rng.normal(size=(20, 3))
    full = _flat(coupling)
    found = jax.jit(body_yield)(jnp.asarray(coupling), jnp.asarray(columns[:, 0]))
    assert_close(found, full @ columns[:, 0], rtol=1e-13, atol=1e-22)
    shared = jax.jit(share_with_body)(*(jnp.asarray(x) for x in (coupling, stiffness, columns)))
    expected = np.linalg.solve(np.eye(20) + stiffness[:, None] * full, columns)
    assert_close(shared, expected, rtol=1e-9, atol=1e-9)


def test_sharing_needs_no_pivots_however_stiff():
    """Cells a million times stiffer than their body, one tooth's influence on all: rank one."""
    coupling = jnp.ones((3, 3, 1)) * 1e-8
    stiffness = jnp.full(3, 1e14)
    shared = jax.jit(share_with_body)(coupling, stiffness, stiffness[:, None])[:, 0]
    # 1 + K C with C = c 1 1^T: each carries k/(1 + 3 k c).
    assert_close(shared, jnp.full(3, 1e14 / (1 + 3e6)), rtol=1e-9, atol=0.0)


def test_two_teeth_on_one_body_by_hand():
    """1e-8 of their own, 1e-8 and 0.5e-8 from the body: 1/(2.5e-8) each, 800 N close them 10 um."""
    problem = _one(
        (
            np.full(2, 1e8),
            np.zeros(2),
            np.ones((2, 1)),
            np.zeros((1, 1)),
            np.ones(1),
            np.asarray(800.0),
            np.array([[1e-8, 0.5e-8], [0.5e-8, 1e-8]])[:, :, None],
        )
    )
    state = _solve(problem, jg.ExactContact(), SETTINGS)
    assert_close(state.approach, 1e-5, rtol=1e-12, atol=0.0)
    assert_close(state.force, jnp.full(2, 400.0), rtol=1e-12, atol=0.0)
    # Overlap is what the cells themselves give: 400 N on 1e8 N/m.
    assert_close(state.overlap, jnp.full(2, 4e-6), rtol=1e-12, atol=0.0)


# --- against the dense statement and the dual


def test_coupled_cells_equal_the_dense_statement():
    draws = _draws(2, 3)
    coupled, dense = _solve_all(draws), _solve_all([_dense(draw) for draw in draws])
    assert coupled.converged.all()
    assert dense.converged.all()
    some_open = [
        np.any(f[d.stiffness > 0] == 0.0) for d, f in zip(draws, coupled.force, strict=True)
    ]
    assert 0.2 < np.mean(some_open) < 0.9
    force = np.array([float(draw.force) for draw in draws])[:, None]
    assert_close(coupled.approach, dense.approach, rtol=1e-9, atol=0.0)
    assert np.max(np.abs(coupled.force - dense.force) / force) < 1e-8


def test_every_random_problem_converges_and_balances():
    """3 bodies, 4 structures, 4 gaps, 60 draws each: 2880 problems, balanced in NumPy."""
    draws = _draws(3, 60)
    states = _solve_all(draws)
    assert states.converged.all(), np.flatnonzero(~states.converged)
    assert states.steps.max() < 60
    k, gap, arms, flexibility, direction, force, coupling = (
        np.stack(part) for part in zip(*draws, strict=True)
    )
    load = np.einsum("nci,nc->ni", arms, states.force)
    place = direction * states.approach[:, None] - np.einsum("nij,nj->ni", flexibility, load)
    by_line = states.force.reshape(-1, LINES, SLICES)
    given = np.einsum("nijs,njs->nis", coupling, by_line).reshape(-1, CELLS)
    moved = np.einsum("nci,ni->nc", arms, place)
    pressed = k * np.maximum(moved - given - gap, 0.0)
    reach = np.abs(moved).max(axis=1, keepdims=True) + np.abs(gap).max(axis=1, keepdims=True)
    noise = 1e-9 * force[:, None] + 1e-14 * k * reach
    assert np.all(states.force >= 0.0)
    assert np.all(np.abs(states.force - pressed) <= noise)
    assert_close(load[:, 0], force, rtol=1e-9, atol=0.0)


def _dual(stiffness, gap, arms, flexibility, direction, force):
    """Approach and cell forces of a dense problem: min f'Gf/2 + gap.f with f >= 0, e.f = F."""
    del arms
    on = stiffness > 0.0
    matrix = flexibility[np.ix_(on, on)] + np.diag(1.0 / stiffness[on])
    scale = 1.0 / np.sqrt(np.diag(matrix))
    factor = np.linalg.cholesky(matrix * np.outer(scale, scale))
    drive = direction[on]

    def forces(approach: float) -> np.ndarray:
        right = np.linalg.solve(factor, (drive * approach - gap[on]) * scale)
        unit = np.linalg.norm(right) or 1.0
        return nnls(factor.T, right / unit, maxiter=10000)[0] * unit * scale

    low = float(np.min(gap[on]))
    high = low + np.max(np.abs(gap[on])) + float(force) * np.mean(np.diag(matrix))
    while drive @ forces(high) < force:
        high += high - low
    approach = zero(lambda t: drive @ forces(t) - float(force), low, high)
    found = np.zeros(stiffness.size)
    found[on] = forces(approach)
    return approach, found


def test_coupled_cells_agree_with_the_dual():
    draws = _draws(4, 1)
    states = _solve_all(draws)
    for index, draw in enumerate(draws):
        approach, force = _dual(*_dense(draw))
        assert_close(states.approach[index], approach, rtol=1e-8, atol=0.0)
        assert np.max(np.abs(states.force[index] - force)) < 1e-6 * float(draw.force)


def test_bodies_that_do_not_give_change_nothing():
    """C = 0 and no C at all."""
    draws = _draws(5, 1)
    stiff = [draw._replace(coupling=np.zeros_like(draw.coupling)) for draw in draws]
    none, zeros = _solve_all([draw[:6] for draw in draws]), _solve_all(stiff)
    assert_close(zeros.approach, none.approach, rtol=1e-12, atol=0.0)
    assert_close(zeros.force, none.force, rtol=1e-9, atol=1e-9)


def test_cells_out_of_mesh_feel_the_body_in_vain():
    """Couplings of cells without stiffness are never looked at."""
    draw = _draw(np.random.default_rng(6), 0.3, 0.1, 5e-6)
    off = (draw.stiffness == 0.0).reshape(LINES, SLICES)
    assert off.any()
    wild = np.where(off[:, None] | off[None], 7.0 * draw.coupling, draw.coupling)
    one = _solve_all([draw, draw._replace(coupling=wild)])
    assert_close(one.force[1], one.force[0], rtol=1e-9, atol=1e-9 * float(draw.force))


def test_the_state_is_the_minimum_of_the_energy():
    """Of approach and forces, all free, written out in NumPy; it rises in every direction."""
    rng = np.random.default_rng(7)
    for draw in _draws(8, 1)[::3]:
        state = _solve_all([draw])
        given = draw.arms @ draw.flexibility @ draw.arms.T + _flat(draw.coupling)
        drive = draw.arms @ draw.direction

        def energy(t, f, draw=draw, given=given, drive=drive):
            overlap = np.maximum(drive * t - given @ f - draw.gap, 0.0)
            stored = 0.5 * f @ given @ f + 0.5 * np.sum(draw.stiffness * overlap**2)
            return stored - float(draw.force) * t

        t, f = float(state.approach[0]), state.force[0]
        least = energy(t, f)
        size = abs(float(draw.force) * t) + 1e-30
        for step in (1e-1, 1e-3):
            for _ in range(20):
                aside = energy(
                    t * (1 + step * rng.normal()), f + step * draw.force * rng.normal(size=CELLS)
                )
                assert aside >= least - 1e-12 * size


# --- derivatives


def _small() -> Draw:
    """Open and closed cells, none near the edge."""
    draw = _draw(np.random.default_rng(11), 0.5, 0.1, 5e-6)
    return draw._replace(force=np.asarray(120.0))


LAWS = {"exact": jg.ExactContact(), "smooth": jg.SmoothContact(4e-6)}


def _number(law: jg.AbstractContactLaw):
    """A scalar of every part of the state, each of order one; H and C kept symmetric."""
    weights = jnp.asarray(np.random.default_rng(12).uniform(0.5, 1.5, (3, CELLS)))

    def number(problem: jg.ContactProblem) -> jax.Array:
        assert problem.coupling is not None
        symmetric = (
            0.5 * (problem.flexibility + problem.flexibility.T),
            0.5 * (problem.coupling + jnp.swapaxes(problem.coupling, 0, 1)),
        )
        problem = eqx.tree_at(lambda p: (p.flexibility, p.coupling), problem, symmetric)
        state = jg.contact_state(problem, law, SETTINGS)
        return (
            1e5 * state.approach
            + 1e-2 * jnp.sum(weights[0, :2] * state.load)
            + 1e5 * jnp.sum(weights[1] * state.overlap)
            + 1e-2 * jnp.sum(weights[2] * state.force)
        )

    return number


@pytest.mark.parametrize("law", ["exact", pytest.param("smooth", marks=pytest.mark.slow)])
def test_derivatives_are_those_of_the_solution(law):
    """Forward, reverse and central differences by each field on its own."""
    problem = _one(_small())
    closed = float(jnp.mean(_solve(problem, LAWS[law], SETTINGS).overlap > 0.0))
    assert 0.2 < closed < 0.9
    number = jax.jit(_number(LAWS[law]))
    reverse = jax.jit(jax.grad(number))(problem)
    forward = jax.jit(lambda p, d: jax.jvp(number, (p,), (d,))[1])
    nothing = jax.tree.map(jnp.zeros_like, problem)
    rng = np.random.default_rng(13)
    step = 1e-6
    for part in Draw._fields:
        value = getattr(problem, part)
        change = float(jnp.max(jnp.abs(value))) * jnp.asarray(rng.normal(size=value.shape))
        along = eqx.tree_at(lambda p, part=part: getattr(p, part), nothing, change)
        ahead, behind = (
            number(jax.tree.map(lambda x, d, s=s: x + s * d, problem, along)) for s in (step, -step)
        )
        slope = jnp.sum(getattr(reverse, part) * change)
        assert abs(float(slope)) > 1e-3
        assert_close(forward(problem, along), slope, rtol=1e-9, atol=0.0)
        assert_close(slope, (ahead - behind) / (2 * step), rtol=2e-6, atol=0.0)


@pytest.mark.slow
def test_second_derivatives_with_smooth_contact():
    problem = _one(_small())
    number = _number(LAWS["smooth"])
    rng = np.random.default_rng(14)
    turns = [jnp.asarray(rng.uniform(-1, 1, getattr(problem, x).shape)) for x in Draw._fields]

    def along(s: jax.Array) -> jax.Array:
        parts = [
            getattr(problem, x) * (1.0 + s * t) for x, t in zip(Draw._fields, turns, strict=True)
        ]
        return number(jg.ContactProblem(*parts))

    value_and_slope = jax.jit(jax.value_and_grad(along))
    step = 1e-4
    (ahead, slope_ahead), (behind, slope_behind) = (value_and_slope(s) for s in (step, -step))
    mean_slope = 0.5 * (slope_ahead + slope_behind)
    assert_close(mean_slope, (ahead - behind) / (2 * step), rtol=1e-5, atol=0.0)
    central = (slope_ahead - slope_behind) / (2 * step)
    assert_close(jax.jit(jax.jacfwd(jax.grad(along)))(0.0), central, rtol=1e-5, atol=0.0)


def test_gradient_where_the_body_is_rigid():
    """Without gaps F t is twice the stored energy: the slope by C at C = 0 is f.dC.f/F."""
    draw = _small()
    draw = draw._replace(
        coupling=np.zeros_like(draw.coupling), flexibility=np.zeros((2, 2)), gap=np.zeros(CELLS)
    )
    change = _body(np.random.default_rng(15), 1e-9, LINES, SLICES)

    def approach(coupling: jax.Array) -> jax.Array:
        problem = _one(draw[:6])
        problem = jg.ContactProblem(
            *(getattr(problem, x) for x in Draw._fields[:6]), coupling=coupling
        )
        return jg.contact_state(problem, jg.ExactContact(), SETTINGS).approach

    force = _solve_all([draw]).force[0]
    slope = jax.jit(jax.grad(approach))(jnp.asarray(draw.coupling))
    expected = force @ _flat(change) @ force / float(draw.force)
    assert_close(jnp.sum(slope * change), expected, rtol=1e-9, atol=0.0)
