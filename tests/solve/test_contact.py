"""The contact solver against an independent one, on thousands of convex problems.

The reference solves the dual: cell forces f >= 0 minimise f'(1/k + W H W')f / 2 + gap.f under
(W e).f = F, by non-negative least squares inside a bracketed search for the approach. Because the
energy is strictly convex in what is compared, agreement is uniqueness too.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, quick
from made_programs import made_programs
from scipy.optimize import nnls
from solve_cases import zero

import jaxgear as jg

SETTINGS = jg.SolverSettings()
MODERATE = 0.1  # flexibility of a body over that of all cells together, about
STRUCTURES = {"rigid": 0.0, "stiff": 1e-4, "moderate": MODERATE, "soft": 1e2, "very soft": 1e3}
GAPS = {"none": 0.0, "small": 1e-7, "usual": 5e-6, "wide": 1e-3}


class States(NamedTuple):
    """The fields of `ContactState`, with a leading axis of problems."""

    approach: np.ndarray
    load: np.ndarray
    overlap: np.ndarray
    force: np.ndarray
    converged: np.ndarray
    steps: np.ndarray


def _flexibility(rng, count: int, size: float, rank: int) -> np.ndarray:
    if size == 0.0 or rank == 0:
        return np.zeros((count, count))
    modes = rng.normal(size=(count, rank))
    return size * modes @ modes.T / rank


def _draw(rng, cells: int, coordinates: int, structure: float, gap: float, rank: int):
    """A random problem with p mesh coordinates; some cells are off, arms up to 50 mm."""
    stiffness = 10.0 ** rng.uniform(6.0, 8.0, cells)
    stiffness[1:] *= rng.random(cells - 1) > 0.2
    arms = np.ones((cells, coordinates))
    arms[:, 1:] = rng.uniform(-0.05, 0.05, (cells, coordinates - 1))
    flexibility = _flexibility(rng, coordinates, structure / stiffness.sum(), rank)
    # Tilt flexibility is per metre of arm twice over.
    arm_scale = np.array([1.0] + [40.0] * (coordinates - 1))
    flexibility *= np.outer(arm_scale, arm_scale)
    gaps = gap * rng.normal(size=cells)
    direction = np.eye(coordinates)[0]
    force = 10.0 ** rng.uniform(1.0, 4.5)
    return stiffness, gaps, arms, flexibility, direction, np.asarray(force)


def _draw_dense(rng, cells: int, structure: float, gap: float, *, all_in_mesh: bool):
    """Cells coupled through a dense flexibility: every cell is its own mesh coordinate."""
    stiffness = 10.0 ** rng.uniform(6.0, 8.0, cells)
    if not all_in_mesh:
        stiffness *= rng.random(cells) > 0.2
        stiffness[-1] = 1e7
    # A body: smooth influence that falls off with distance, so SPD.
    place = np.arange(cells)
    influence = np.exp(-np.abs(place[:, None] - place[None, :]) / 5.0)
    flexibility = structure / stiffness.sum() * influence
    gaps = gap * rng.normal(size=cells)
    force = np.asarray(10.0 ** rng.uniform(1.0, 4.5))
    return stiffness, gaps, np.eye(cells), flexibility, np.ones(cells), force


# A batch is a tuple of arrays: a `ContactProblem` holds one problem, and its shapes are checked.
Batch = tuple[Any, ...]
_TOGETHER = 60  # problems in one program


def _stack(problems) -> Batch:
    return tuple(np.stack(part) for part in zip(*problems, strict=True))


def _one(problem) -> jg.ContactProblem:
    return jg.ContactProblem(*(jnp.asarray(part) for part in problem))


@eqx.filter_jit
def _solve_batch(batch: Batch, law: jg.AbstractContactLaw, settings: jg.SolverSettings) -> Batch:
    def one(*problem: jax.Array) -> Batch:
        state = jg.contact_state(jg.ContactProblem(*problem), law, settings)
        return tuple(getattr(state, name) for name in States._fields)

    return jax.vmap(one)(*batch)


def _solve_all(
    batch: Batch, law: jg.AbstractContactLaw, settings: jg.SolverSettings = SETTINGS
) -> States:
    """Of any number of problems, by one program of sixty."""
    count = batch[0].shape[0]
    pieces = []
    for start in range(0, count, _TOGETHER):
        chosen = np.minimum(np.arange(start, start + _TOGETHER), count - 1)
        pieces.append(_solve_batch(tuple(part[chosen] for part in batch), law, settings))
    return States(*(np.concatenate(parts)[:count] for parts in zip(*pieces, strict=True)))


@eqx.filter_jit
def _solve(problem: jg.ContactProblem, law: jg.AbstractContactLaw = jg.ExactContact()):
    return jg.contact_state(problem, law, SETTINGS)


def _reference(stiffness, gaps, arms, flexibility, direction, force):
    """Approach and cell forces from the dual quadratic programme."""
    on = stiffness > 0.0
    coupling = arms[on] @ flexibility @ arms[on].T + np.diag(1.0 / stiffness[on])
    drive = arms[on] @ direction
    # Scaled so that least squares sees numbers of order one.
    scale = np.sqrt(np.diag(coupling))
    factor = np.linalg.cholesky(coupling / np.outer(scale, scale))
    short = np.max(np.abs(gaps[on])) + force * np.mean(np.diag(coupling))

    def forces(approach: float) -> np.ndarray:
        push = (drive * approach - gaps[on]) / scale
        right = np.linalg.solve(factor, push)
        unit = np.linalg.norm(right) or 1.0
        return nnls(factor.T, right / unit, maxiter=10000)[0] * unit / scale

    low, high = np.min(gaps[on]), np.min(gaps[on]) + short
    while drive @ forces(high) < force:
        high += high - low
    approach = zero(lambda t: drive @ forces(t) - force, low, high)
    # Between two active sets the answer is linear: with the set known it is found exactly.
    closed = forces(approach) > 0.0
    count = int(np.sum(closed))
    matrix = np.zeros((count + 1, count + 1))
    matrix[:count, :count] = coupling[np.ix_(closed, closed)]
    matrix[:count, count] = -drive[closed]
    matrix[count, :count] = drive[closed]
    right = np.append(-gaps[on][closed], force)
    row = np.append(np.max(np.abs(matrix[:count]), axis=1), np.max(np.abs(drive)))
    answer = np.linalg.solve(matrix / row[:, None], right / row)
    found = np.zeros(stiffness.size)
    found[np.flatnonzero(on)[closed]] = answer[:count]
    return answer[count], found


def _assert_balanced(batch: Batch, states: States, rtol: float) -> None:
    """Both balances, the overlaps and the law, in NumPy: sufficient for the unique minimum."""
    failed = np.flatnonzero(~states.converged)
    assert failed.size == 0, f"{failed.size} of {states.converged.size} did not converge: {failed}"
    k, gap, arms, flexibility, direction, force = (np.asarray(part) for part in batch)
    cell, load = states.force, states.load
    place = direction * states.approach[:, None]
    place = place - np.einsum("nij,nj->ni", flexibility, load)
    overlap = np.einsum("nci,ni->nc", arms, place) - gap
    pressed = k * np.maximum(overlap, 0.0)
    largest = np.abs(states.approach)[:, None] + np.max(np.abs(gap), axis=1, keepdims=True)
    noise = rtol * force[:, None] + 4e-15 * k * largest
    assert np.all(cell >= 0.0)
    assert np.all(np.abs(cell - pressed) <= noise)
    resultant = np.einsum("nci,nc->ni", arms, cell)
    reach = np.max(np.abs(arms), axis=1)
    assert np.all(np.abs(resultant - load) <= np.sum(noise, axis=1, keepdims=True) * reach)
    driving = np.einsum("ni,ni->n", direction, load)
    assert np.all(np.abs(driving - force) <= rtol * force)


@pytest.mark.parametrize("coordinates", quick(1, [1, 2, 3]))
def test_every_random_problem_converges_and_balances(coordinates):
    """5 structures, 4 gaps, full and deficient rank, 120 draws each: 12 000 problems in all."""
    rng = np.random.default_rng(coordinates)
    problems = [
        _draw(rng, 30, coordinates, structure, gap, rank)
        for structure in STRUCTURES.values()
        for gap in GAPS.values()
        for rank in {1, coordinates}
        for _ in range(120)
    ]
    stacked = _stack(problems)
    states = _solve_all(stacked, jg.ExactContact())
    _assert_balanced(stacked, states, rtol=1e-9)


@pytest.mark.parametrize("coordinates", quick(1, [2, 1, 3]))
def test_bodies_far_softer_than_cells_need_patience(coordinates):
    """A hundred thousand times softer: rounding leaves 1e-9 of the force, halvings pass 60."""
    rng = np.random.default_rng(70 + coordinates)
    problems = [
        _draw(rng, 30, coordinates, 1e5, gap, coordinates)
        for gap in GAPS.values()
        for _ in range(200)
    ]
    stacked = _stack(problems)
    patient = jg.SolverSettings(tolerance=1e-9, most_steps=300)
    _assert_balanced(stacked, _solve_all(stacked, jg.ExactContact(), patient), rtol=1e-7)


@pytest.mark.parametrize("coordinates", [1, 2, 3])
@pytest.mark.parametrize("structure", quick(2, STRUCTURES))
def test_random_problems_agree_with_the_dual(coordinates, structure):
    rng = np.random.default_rng(10 + coordinates)
    problems = [
        _draw(rng, 30, coordinates, STRUCTURES[structure], gap, coordinates)
        for gap in GAPS.values()
        for _ in range(15)
    ]
    states = _solve_all(_stack(problems), jg.ExactContact())
    for index, problem in enumerate(problems):
        approach, force = _reference(*problem)
        noise = 1e-9 * float(problem[5])
        assert_close(states.approach[index], approach, rtol=1e-8, atol=0.0)
        assert_close(states.force[index], force, rtol=1e-8, atol=noise)


@pytest.mark.parametrize("structure", ["stiff", "moderate", "soft"])
def test_dense_problems_agree_with_the_dual(structure):
    """20 to 40 cells coupled through a dense body."""
    rng = np.random.default_rng(20)
    for cells in (20, 40):
        problems = [
            _draw_dense(rng, cells, STRUCTURES[structure], gap, all_in_mesh=True)
            for gap in GAPS.values()
            for _ in range(20)
        ]
        stacked = _stack(problems)
        states = _solve_all(stacked, jg.ExactContact())
        _assert_balanced(stacked, states, rtol=1e-9)
        for index, problem in enumerate(problems[::5]):
            approach, force = _reference(*problem)
            assert_close(states.approach[5 * index], approach, rtol=1e-8, atol=0.0)
            assert_close(states.force[5 * index], force, rtol=1e-7, atol=1e-8 * float(problem[5]))


def test_dense_problems_with_cells_out_of_mesh_converge():
    """A cell without stiffness is out of contact, the first one too."""
    rng = np.random.default_rng(21)
    problems = [
        _draw_dense(rng, 20, MODERATE, gap, all_in_mesh=False)
        for gap in GAPS.values()
        for _ in range(20)
    ]
    stacked = _stack(problems)
    assert np.any(stacked[0][:, 0] == 0.0)
    _assert_balanced(stacked, _solve_all(stacked, jg.ExactContact()), rtol=1e-9)


@pytest.mark.parametrize("coordinates", quick(1, [2, 1, 3]))
@pytest.mark.parametrize("width", [1e-8, 1e-6, 1e-5])
def test_smooth_problems_converge_to_their_balance(coordinates, width):
    rng = np.random.default_rng(30 + coordinates)
    problems = [
        _draw(rng, 30, coordinates, structure, gap, coordinates)
        for structure in STRUCTURES.values()
        for gap in GAPS.values()
        for _ in range(25)
    ]
    stacked = _stack(problems)
    law = jg.SmoothContact(width)
    states = _solve_all(stacked, law)
    failed = np.flatnonzero(~states.converged)
    assert failed.size == 0, f"{failed.size} of {len(problems)} did not converge: {failed}"
    # The spline, written out again: w (1 + x/w)^3 (3 - x/w) / 16 between -w and w.
    x = states.overlap
    y = np.clip(x / width, -1.0, 1.0)
    ramp = np.where(x > width, x, width * (1.0 + y) ** 3 * (3.0 - y) / 16.0)
    stiffness, arms, force = (np.asarray(stacked[i]) for i in (0, 2, 5))
    resultant = np.einsum("nci,nc->ni", arms, stiffness * ramp)
    assert_close(resultant[:, 0], force, rtol=1e-8, atol=0.0)
    assert np.all(np.abs(resultant - states.load) <= 1e-8 * force[:, None])


def test_one_cell_alone_by_hand():
    """Only the cell without gap touches: t = F (1/k + w'Hw), and it carries everything."""
    flexibility = jnp.asarray([[2e-9, 1e-8], [1e-8, 4e-6]])
    problem = jg.ContactProblem(
        stiffness=jnp.asarray([3e8, 3e8, 3e8]),
        gap=jnp.asarray([1.0, 0.0, 1.0]),
        arms=jnp.asarray([[1.0, -0.01], [1.0, 0.002], [1.0, 0.01]]),
        flexibility=flexibility,
        direction=jnp.asarray([1.0, 0.0]),
        force=jnp.asarray(900.0),
    )
    state = _solve(problem)
    # w = (1, 0.002): w'Hw = 2e-9 + 2 * 0.002 * 1e-8 + 4e-6 * 0.002^2
    give = 2e-9 + 4e-11 + 1.6e-11
    assert bool(state.converged)
    assert_close(state.approach, 900.0 * (1 / 3e8 + give), rtol=1e-9, atol=0.0)
    assert_close(state.force, jnp.asarray([0.0, 900.0, 0.0]), rtol=1e-9, atol=1e-9)
    assert_close(state.load, jnp.asarray([900.0, 1.8]), rtol=1e-9, atol=0.0)


def test_two_springs_one_late_by_hand():
    """k1 = 1, k2 = 3 MN/m, gap 4 um at the second: it closes at 4 N."""
    for force, approach, second in ((2.0, 2e-6, 0.0), (4.0, 4e-6, 0.0), (16.0, 7e-6, 9.0)):
        problem = jg.ContactProblem(
            stiffness=jnp.asarray([1e6, 3e6]),
            gap=jnp.asarray([0.0, 4e-6]),
            arms=jnp.ones((2, 1)),
            flexibility=jnp.zeros((1, 1)),
            direction=jnp.ones(1),
            force=jnp.asarray(force),
        )
        state = _solve(problem)
        assert_close(state.approach, approach, rtol=1e-12, atol=0.0)
        expected = jnp.asarray([force - second, second])
        assert_close(state.force, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("gap", ["small", "usual"])
def test_dense_form_equals_the_mesh_coordinates(gap):
    """p = 2 with H, and p = cells with W = 1 and C = W H W', are one problem."""
    rng = np.random.default_rng(40)
    for _ in range(10):
        stiffness, gaps, arms, flexibility, direction, force = _draw(
            rng, 30, 2, MODERATE, GAPS[gap], 2
        )
        stiffness = np.where(stiffness > 0.0, stiffness, 1e6)
        few = _one((stiffness, gaps, arms, flexibility, direction, force))
        dense = (arms @ flexibility @ arms.T, arms @ direction, force)
        many = _one((stiffness, gaps, np.eye(30), *dense))
        a, b = (_solve(problem) for problem in (few, many))
        assert bool(a.converged & b.converged)
        assert_close(b.approach, a.approach, rtol=1e-10, atol=0.0)
        assert_close(b.force, a.force, rtol=1e-9, atol=1e-9 * float(force))
        assert_close(b.force, b.load, rtol=1e-9, atol=1e-9 * float(force))


def _smallish(rng_seed: int, structure: float, dense: bool) -> jg.ContactProblem:
    """A problem with open and closed cells, none near the edge."""
    rng = np.random.default_rng(rng_seed)
    draw = (
        _draw_dense(rng, 9, structure, 5e-6, all_in_mesh=True)
        if dense
        else _draw(rng, 9, 2, structure, 5e-6, 2)
    )
    return _one((*draw[:5], np.asarray(600.0 if dense else 90.0)))


def _number(law: jg.AbstractContactLaw):
    """A scalar of every part of the state, each of order one; H kept symmetric."""

    def number(problem: jg.ContactProblem):
        symmetric = 0.5 * (problem.flexibility + problem.flexibility.T)
        problem = eqx.tree_at(lambda p: p.flexibility, problem, symmetric)
        state = jg.contact_state(problem, law, SETTINGS)
        rng = np.random.default_rng(3)
        total = 1e5 * state.approach
        for part, size in ((state.load, 1e-2), (state.overlap, 1e5), (state.force, 1e-2)):
            total += size * jnp.sum(jnp.asarray(rng.uniform(0.5, 1.5, part.shape)) * part)
        return total

    return number


PARTS = ("stiffness", "gap", "arms", "flexibility", "direction", "force")
LAWS = {"exact": jg.ExactContact(), "smooth": jg.SmoothContact(2e-6)}


@pytest.mark.parametrize("dense", quick(1, [False, True]), ids=["two coordinates", "dense"])
@pytest.mark.parametrize("law", quick(2, LAWS))
def test_derivatives_are_those_of_the_solution(law, dense):
    """Forward, reverse and central differences by each input on its own, cells open and closed."""
    problem = _smallish(51, MODERATE, dense)
    share = float(np.mean(np.asarray(_solve(problem).overlap) > 0.0))
    assert 0.2 < share < 0.9
    number = _number(LAWS[law])

    @jax.jit
    def evaluated(problem, along):
        value, push = jax.linearize(number, problem)
        (reverse,) = jax.linear_transpose(lambda x: push(x), problem)(jnp.ones_like(value))
        return value, push(along), reverse

    step = 1e-6 if law == "exact" else 1e-5
    nothing = jax.tree.map(jnp.zeros_like, problem)
    at = lambda s, along: jax.tree.map(lambda x, d: x + s * d, problem, along)
    rng = np.random.default_rng(4)
    for part in PARTS:
        value = getattr(problem, part)
        change = float(np.max(np.abs(value))) * jnp.asarray(rng.normal(size=value.shape))
        along = eqx.tree_at(lambda p, part=part: getattr(p, part), nothing, change)
        ahead, behind = (evaluated(at(s, along), along)[0] for s in (step, -step))
        central = (ahead - behind) / (2 * step)
        _, forward, reverse = evaluated(problem, along)
        slope = np.sum(np.asarray(getattr(reverse, part)) * change)
        assert_close(forward, slope, rtol=1e-9, atol=0.0)
        assert_close(slope, central, rtol=1e-6, atol=0.0)


def test_derivative_by_the_width_of_smooth_contact():
    problem = _smallish(51, MODERATE, False)
    assert_gradient(lambda law: _number(law)(problem), jg.SmoothContact(2e-6), rtol=1e-6, step=1e-4)


def test_derivatives_exist_where_bodies_only_turn():
    """H = 0 is singular, and a direction in which it may grow."""
    problem = _smallish(52, 0.0, False)
    scale = eqx.tree_at(
        lambda p: (p.flexibility, p.direction),
        problem,
        (jnp.asarray([[1e-9, 1e-8], [1e-8, 1e-6]]), jnp.ones(2)),
    )
    number = _number(jg.ExactContact())
    assert_gradient(number, problem, rtol=1e-6, step=1e-7, scale=scale)


@pytest.mark.slow
@pytest.mark.parametrize("dense", quick(1, [False, True]), ids=["two coordinates", "dense"])
def test_second_derivatives_with_smooth_contact(dense):
    """Along a direction, forward and reverse over reverse, against differences of the gradient."""
    problem = _smallish(51, MODERATE, dense)
    number = _number(jg.SmoothContact(4e-6))

    def along(s):
        parts = [getattr(problem, part) for part in PARTS]
        rng = np.random.default_rng(5)
        moved = [x * (1.0 + s * jnp.asarray(rng.uniform(-1, 1, x.shape))) for x in parts]
        return number(jg.ContactProblem(*moved))

    @jax.jit
    def slopes(s):
        first = jax.grad(along)
        return jax.jvp(first, (s,), (1.0,)) if dense else jax.value_and_grad(first)(s)

    step = 1e-4
    central = (slopes(step)[0] - slopes(-step)[0]) / (2 * step)
    assert_close(slopes(0.0)[1], central, rtol=2e-6, atol=0.0)


def test_sensitivity_to_force_by_hand():
    """dt/dF of two closed springs on a flexible body: 1/(k1 + k2) + H."""
    problem = jg.ContactProblem(
        stiffness=jnp.asarray([1e6, 3e6]),
        gap=jnp.asarray([0.0, 4e-6]),
        arms=jnp.ones((2, 1)),
        flexibility=jnp.full((1, 1), 5e-8),
        direction=jnp.ones(1),
        force=jnp.asarray(16.0),
    )

    def approach(force):
        moved = eqx.tree_at(lambda p: p.force, problem, force)
        return jg.contact_state(moved, jg.ExactContact(), SETTINGS).approach

    for derivative in (jax.grad(approach), jax.jacfwd(approach)):
        assert_close(jax.jit(derivative)(problem.force), 3e-7, rtol=1e-12, atol=0.0)


def test_batches_equal_a_loop():
    rng = np.random.default_rng(60)
    problems = [_draw(rng, 30, 2, s, 5e-6, 2) for s in (0.0, 1e-4, 0.1, 1e2) for _ in range(4)]
    together = _solve_all(_stack(problems), jg.ExactContact())
    for index, problem in enumerate(problems):
        alone = _solve(_one(problem))
        same = jax.tree.map(lambda x, index=index: x[index], together)
        assert int(alone.steps) == int(same.steps)
        # Reductions may be ordered differently in a batch.
        assert_close(same.approach, alone.approach, rtol=1e-12, atol=0.0)
        assert_close(same.force, alone.force, rtol=1e-10, atol=1e-12 * float(problem[5]))


def test_one_trace_serves_all_values():
    rng = np.random.default_rng(61)
    problems = [_one(_draw(rng, 30, 2, structure, 5e-6, 2)) for structure in (0.0, 0.1, 1e2)]
    _solve(problems[0])
    with made_programs() as made:
        assert all(_solve(problem).converged for problem in problems)
    assert not made


def test_few_steps_are_needed():
    """Newton with a line search: 2 to 4 steps where cells and bodies are alike."""
    rng = np.random.default_rng(62)
    usual = _stack([_draw(rng, 30, 2, MODERATE, 5e-6, 2) for _ in range(500)])
    steps = _solve_all(usual, jg.ExactContact()).steps
    assert np.mean(steps) < 6.0
    assert np.max(steps) <= 16


def test_all_closed_takes_one_step():
    """The start has every cell closed: without gaps it is the answer."""
    rng = np.random.default_rng(63)
    for structure in (0.0, 0.1):
        problem = _one(_draw(rng, 30, 2, structure, 0.0, 2))
        problem = eqx.tree_at(lambda p: p.arms, problem, problem.arms.at[:, 1].multiply(1e-3))
        state = _solve(problem)
        assert bool(state.converged)
        assert int(state.steps) == 1


def test_giving_up_is_reported():
    """One step is not enough where cells are open, and the state says so."""
    problem = _smallish(51, MODERATE, False)
    hasty = jg.contact_state(problem, jg.ExactContact(), jg.SolverSettings(most_steps=1))
    assert not bool(hasty.converged)
    assert int(hasty.steps) == 1
    patient = _solve(problem)
    assert bool(patient.converged)
    assert int(patient.steps) > 1


def test_tolerance_is_of_the_imbalance():
    """A coarse tolerance stops earlier, but never calls a wrong state converged."""
    problem = _smallish(51, MODERATE, False)
    exact = _solve(problem)
    coarse = jg.contact_state(problem, jg.ExactContact(), jg.SolverSettings(tolerance=1e-2))
    assert bool(coarse.converged)
    assert int(coarse.steps) <= int(exact.steps)
    assert_close(coarse.approach, exact.approach, rtol=1e-2, atol=0.0)
