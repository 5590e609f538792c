"""The mesh in time: its cells, shared forces, averages over a step."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import cases
from helpers import quick

import jaxgear as jg
from jaxgear._dynamics._cell_forces import (
    cell_forces,
    mean_load,
    mean_ramp,
    mean_tangent,
    mesh_load,
)
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._table import (
    END,
    MIDDLE,
    START,
    mesh_at,
    mesh_within,
    ready_to_bear,
    repeated,
)

EXACT = jg.ExactContact()


@pytest.mark.slow
def test_steps_follow_the_phases_of_statics():
    dynamics = cases.torsional_pair()
    lines = dynamics.cycle.cells.lines
    table = dynamics.system.table
    np.testing.assert_allclose(table.lengths, lines.weight, rtol=1e-12)
    np.testing.assert_allclose(table.middles, lines.phase, rtol=0.0, atol=1e-12)
    assert table.kinds.count(0) + table.kinds.count(1) == lines.phase.size
    for kind in (0, 1):
        same = np.asarray(table.lengths)[np.asarray(table.kinds) == kind]
        assert np.ptp(same) < 1e-12


@pytest.mark.slow
def test_places_of_relieved_flanks_meet_between_steps():
    table = cases.torsional_pair(relief=15e-6).system.table
    ends, starts = np.asarray(table.gap[2][:-1]), np.asarray(table.gap[0][1:])
    np.testing.assert_allclose(ends, starts, rtol=0.0, atol=1e-15)
    assert float(np.ptp(np.asarray(table.gap[1]))) > 5e-6


def test_mesh_between_places_is_a_parabola():
    table = cases.two_dof().table
    for part, place in ((START, 0), (MIDDLE, 1), (END, 2)):
        np.testing.assert_array_equal(mesh_at(table, part).gap, table.gap[place])
    # A gap that is a parabola in time is met everywhere.
    time = jnp.asarray([0.0, 0.5, 1.0])[:, None, None]
    bent = dataclasses.replace(table, gap=jnp.broadcast_to(3.0 * time**2 - time, table.gap.shape))
    np.testing.assert_allclose(mesh_at(bent, 0.3).gap, 3.0 * 0.09 - 0.3, rtol=1e-12)


@pytest.mark.slow
def test_cells_that_cannot_be_in_contact_are_left_out():
    dynamics = cases.torsional_pair(relief=15e-6)
    table = repeated(dynamics.system.table, 2)
    assert table.kept is not None
    assert table.kept.shape[1] < table.stiffness.shape[1]
    places = list(itertools.product((mesh_at, mesh_within), (START, MIDDLE, END)))

    @jax.jit
    def forces(table):
        each = jax.vmap(lambda mesh, place: cell_forces(mesh, place, EXACT)[0])
        rest = jnp.tile(dynamics.system.rest, (2, 1))
        return [table.on_all_cells(each(cells(table, part), rest)) for cells, part in places]

    both = forces(table), forces(dataclasses.replace(table, kept=None))
    for place, found, wanted in zip(places, *both, strict=True):
        assert np.count_nonzero(wanted) > 64, place
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9, err_msg=str(place))


def test_repeated_table_goes_on():
    table = cases.sdof_rectangular(steps=20).table
    twice = repeated(table, 2)
    assert twice.periods == 2
    assert len(twice.kinds) == 40
    np.testing.assert_allclose(twice.edges[20:], 1.0 + np.asarray(table.edges), rtol=1e-12)
    np.testing.assert_array_equal(twice.gap[:, 20:], table.gap)
    assert repeated(table, 1) is table


@pytest.mark.parametrize(
    ("first", "last", "mean"),
    [(1.0, 3.0, 2.0), (-1.0, -2.0, 0.0), (-1.0, 1.0, 0.25), (1.0, -3.0, 0.125), (0.0, 0.0, 0.0)],
)
def test_mean_of_the_positive_part(first, last, mean):
    got = mean_ramp(jnp.asarray(first), jnp.asarray(last))
    np.testing.assert_allclose(got, mean, rtol=1e-14, atol=0.0)
    np.testing.assert_allclose(got, mean_ramp(jnp.asarray(last), jnp.asarray(first)), rtol=1e-14)


def test_mean_over_a_step_is_the_integral_and_its_slopes_are_true():
    random = np.random.default_rng(3)
    mesh = Mesh(
        jnp.asarray(random.uniform(1.0, 2.0, 5)),
        jnp.asarray(random.normal(size=5)),
        jnp.asarray(np.stack([np.ones(5), np.linspace(-1.0, 1.0, 5)], axis=1)),
        None,
    )
    first, last = jnp.asarray([0.2, 0.3]), jnp.asarray([-0.1, 0.5])
    mean = jax.jit(lambda *x: mean_load(mesh, mesh, mesh, *x))
    load, *slopes = mean(first, last)
    parts = (np.arange(20000) + 0.5) / 20000
    between = lambda s: mesh_load(mesh, first + s * (last - first), EXACT)[0]
    each = jax.jit(jax.vmap(between))(jnp.asarray(parts))
    np.testing.assert_allclose(load, np.mean(each, axis=0), rtol=1e-7)
    by_jax = jax.jit(jax.jacfwd(lambda *x: mean(*x)[0], argnums=(0, 1)))(first, last)
    for found, slope in zip(by_jax, slopes, strict=True):
        np.testing.assert_allclose(found, slope, rtol=1e-10, atol=1e-12)


def _coupled(random: np.random.Generator, lines: int) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """Cells of three slices, with a positive definite compliance in each; the last two dense."""
    factors = random.normal(size=(lines, lines, 3))
    coupling = np.einsum("iks,jks->ijs", factors, factors) * random.choice([0.1, 1.0, 10.0])
    stiffness = random.uniform(0.5, 2.0, 3 * lines)
    mesh = Mesh(
        jnp.asarray(stiffness),
        jnp.asarray(random.normal(size=3 * lines)),
        jnp.ones((3 * lines, 1)),
        jnp.asarray(coupling),
    )
    dense = np.zeros((3 * lines, 3 * lines))
    for s in range(3):
        rows = np.arange(lines) * 3 + s
        dense[np.ix_(rows, rows)] = coupling[:, :, s]
    return mesh, stiffness, dense


@pytest.mark.slow
def test_mean_over_a_step_has_true_slopes_where_cells_share_a_body():
    """Slices on their own, and the same coupling as a matrix of all cells."""
    mesh, _, dense = _coupled(np.random.default_rng(4), 3)
    dense = jnp.asarray(dense)
    arms = jnp.stack([jnp.ones(9), jnp.linspace(-1.0, 1.0, 9)], axis=1)
    by_slices = dataclasses.replace(mesh, arms=arms)
    ends = jnp.asarray([0.4, 0.1]), jnp.asarray([-0.2, 0.6])

    @jax.jit
    def both(mesh):
        mean = lambda *x: mean_load(mesh, mesh, mesh, *x)
        return mean(*ends), jax.jacfwd(lambda *x: mean(*x)[0], argnums=(0, 1))(*ends)

    found = [both(x) for x in (by_slices, dataclasses.replace(mesh, arms=arms, coupling=dense))]
    for (_, *slopes), by_jax in found:
        for slope, expected in zip(slopes, by_jax, strict=True):
            assert float(jnp.abs(slope).min()) > 0.0
            np.testing.assert_allclose(slope, expected, rtol=1e-9)
    for one, other in zip(found[0][0], found[1][0], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)


@pytest.mark.parametrize("lines", quick(1, [3, 2, 4]))
def test_lines_share_a_body_in_any_state_of_contact(lines):
    """Against the only set of closed cells that fits, found among all."""
    random = np.random.default_rng(lines)
    solve = jax.jit(lambda mesh, place: cell_forces(mesh, place, EXACT))
    for _ in range(100):
        mesh, stiffness, dense = _coupled(random, lines)
        place = random.normal()
        force = np.asarray(solve(mesh, jnp.asarray([place]))[0])
        free = place - np.asarray(mesh.gap)
        expected = np.zeros(3 * lines)
        for s in range(3):
            rows = np.arange(lines) * 3 + s
            own = dense[np.ix_(rows, rows)]
            for closed in itertools.product([False, True], repeat=lines):
                on = np.flatnonzero(closed)
                trial = np.zeros(lines)
                matrix = own[np.ix_(on, on)] + np.diag(1.0 / stiffness[rows[on]])
                trial[on] = np.linalg.solve(matrix, free[rows[on]])
                overlap = free[rows] - own @ trial
                if np.all(trial[on] >= 0.0) and np.all(np.delete(overlap, on) <= 0.0):
                    expected[rows] = trial
        np.testing.assert_allclose(force, expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("law", quick(1, [EXACT, jg.SmoothContact(0.3)]))
def test_tangent_is_the_slope_of_the_load(law):
    random = np.random.default_rng(9)
    mesh, _, _ = _coupled(random, 3)
    place = jnp.asarray([0.4])
    at = jax.jit(lambda x: mesh_load(mesh, x, law))
    load, tangent = at(place)
    step = 1e-6
    ends = [at(place + sign * step)[0] for sign in (1.0, -1.0)]
    np.testing.assert_allclose(tangent[:, 0], (ends[0] - ends[1]) / (2.0 * step), rtol=1e-6)
    assert load[0] > 0.0
    by_jax = jax.jit(jax.jacfwd(lambda x: at(x)[0]))(place)
    np.testing.assert_allclose(by_jax, tangent, rtol=1e-8)


# --- Ready for all cells to bear


@pytest.fixture(scope="module")
def relieved():
    return cases.torsional_pair(relief=5e-6)


def _bent(places, scale: float, lift: float):
    """Mesh coordinates of statics, larger or smaller, and further apart [m, rad]."""
    return scale * places.at[:, 0].add(-lift)


_STATES = {"all bear": (1.4, 0.0), "some bear": (0.5, 4e-6), "none bears": (1.0, 1e-4)}


@pytest.mark.parametrize("state", _STATES)
def test_a_table_that_is_ready_says_the_same(relieved, state):
    table, places = relieved.system.table, _bent(relieved.system.rest, *_STATES[state])
    ready = ready_to_bear(table)
    assert ready.ready is not None
    assert ready_to_bear(ready) is ready
    each = [(mesh_at, MIDDLE), (mesh_at, 0.3), (mesh_within, END)]

    @jax.jit
    def found(table, places):
        pressed = jax.vmap(lambda mesh, place: cell_forces(mesh, place, EXACT))
        loaded = jax.vmap(lambda mesh, place: mesh_load(mesh, place, EXACT))
        given = [cells(table, part) for cells, part in each]
        begin, middle, end = (mesh_at(table, part) for part in (START, MIDDLE, END))
        mean = jax.vmap(mean_tangent)(begin, middle, end, places, 0.9 * places)
        return [(pressed(x, places), loaded(x, places)) for x in given], mean

    one, other = found(table, places), found(ready, places)
    force = np.asarray(one[0][0][0][0])
    share = np.mean(force[np.asarray(mesh_at(table, MIDDLE).stiffness) > 0.0] > 0.0)
    assert {"all bear": share == 1.0, "some bear": 0.2 < share < 0.9, "none bears": share == 0.0}[
        state
    ]
    # The mean over a step is told by what overlaps change by in it, which may be little.
    for rtol, a, b in zip((1e-10, 1e-8), one, other, strict=True):
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
            np.testing.assert_allclose(y, x, rtol=rtol, atol=0.1 * rtol * float(np.abs(x).max()))


@pytest.mark.parametrize("state", ["all bear", "some bear"])
def test_derivatives_with_a_table_that_is_ready_are_the_same(relieved, state):
    table, places = relieved.system.table, _bent(relieved.system.rest, *_STATES[state])
    way = jnp.asarray(np.random.default_rng(2).normal(size=places.shape)) * jnp.abs(places)

    @jax.jit
    def along(table):
        mesh = mesh_at(table, MIDDLE)
        load = lambda place: jax.vmap(lambda x, own: mesh_load(x, own, EXACT)[0])(mesh, place)
        return jax.jvp(load, (places,), (way,))

    for a, b in zip(along(table), along(ready_to_bear(table)), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-10, atol=1e-11 * float(jnp.max(jnp.abs(a))))


def test_a_table_of_cells_on_their_own_needs_not_be_ready():
    table = cases.two_dof().table
    assert ready_to_bear(table) is table


def test_a_ready_table_that_goes_on_is_ready(relieved):
    table = relieved.system.table
    again = mesh_at(repeated(ready_to_bear(table), 2), MIDDLE)
    once = mesh_at(ready_to_bear(table), MIDDLE)
    assert again.bearing is not None
    assert once.bearing is not None
    for long, short in zip(*map(jax.tree.leaves, (again.bearing, once.bearing)), strict=True):
        np.testing.assert_array_equal(long, jnp.concatenate([short, short]))
