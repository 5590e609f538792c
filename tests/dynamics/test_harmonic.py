"""Harmonic balance: its equations, its limits, and the discretisation that it shares with time."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import cases
from fem_cases import assert_near
from helpers import quick

import jaxgear as jg
from jaxgear._dynamics import _harmonic_problem
from jaxgear._dynamics._harmonic import HarmonicBalance, harmonic_balance_problem
from jaxgear._dynamics._harmonic_basis import (
    analysis_of,
    as_matrix,
    basis_of,
    closest_terms,
    periodic_analysis,
    periodic_basis,
    rates_of,
)
from jaxgear._dynamics._harmonic_problem import imbalance, linearised, root_of
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steady_state import steady_state, steady_states
from jaxgear._dynamics._steppers import Midpoint
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._response._dynamic import contact_force, dynamic_ratio, order_amplitudes

SPEEDS = jnp.asarray([0.3, 0.5, 0.9, 1.3, 2.4])


def _variant(name: str) -> tuple[DynamicSystem, HarmonicBalance]:
    system = cases.two_dof(steps=48)
    if name == "cell damping":
        system = dataclasses.replace(system, cell_damping=jnp.asarray(0.1))
        return system, HarmonicBalance(harmonics=6, law=jg.SmoothContact(0.2))
    if name == "bow":
        system = dataclasses.replace(system, bow=jnp.asarray([[0.1, 0.02], [0.02, 0.3]]))
    return system, HarmonicBalance(
        harmonics=6, averaged=name == "averaged", multiple=2 if name == "two" else 1
    )


@pytest.mark.parametrize("name", quick(2, ["exact", "averaged", "two", "bow", "cell damping"]))
def test_matrix_is_the_derivative_of_the_residual(name):
    system, method = _variant(name)

    @jax.jit
    def both(shift):
        balance = harmonic_balance_problem(method, system)
        problem, _ = balance.at_speed(jnp.asarray(0.7))
        terms = balance.rest + shift * jnp.cos(jnp.arange(balance.rest.size, dtype=float)).reshape(
            balance.rest.shape
        )

        matrix = jax.jacfwd(lambda x: imbalance(problem, x))(terms)
        return linearised(problem, terms)[1], matrix.reshape(terms.size, terms.size)

    ours, expected = both(0.1)
    np.testing.assert_allclose(ours, expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", quick(1, ["exact", "averaged", "two"]))
def test_loads_that_move_the_structure_as_much_as_gaps_recede_change_no_force(name):
    """The motion is then that without them and theirs: of the structure alone, without contact."""
    system, method = _variant(name)
    speed, rng = jnp.asarray(0.9), np.random.default_rng(6)
    balance = harmonic_balance_problem(method, system)
    count, dofs = balance.count, system.mass.shape[0]
    drawn = 0.02 * rng.normal(size=(2, count + 1, dofs))
    amplitude = drawn[0] + 1j * drawn[1] * (np.arange(count + 1) > 0)[:, None]
    # On both cycles alike, and on harmonics of the mesh alone, as the gaps are.
    amplitude[np.arange(count + 1) % method.multiple > 0] = 0.0
    at, moved = np.asarray(system.table.edges), []
    for part in (0.0, 0.5, 1.0):
        angle = 2.0 * np.pi * (at[:-1] + part * np.diff(at)) / method.multiple
        waves = np.exp(1j * np.multiply.outer(angle, np.arange(count + 1)))
        moved.append(np.real(waves @ amplitude))
    met = np.stack(moved) @ np.asarray(system.vectors)
    gap = system.table.gap + jnp.einsum("apcn,apn->apc", system.table.arms, jnp.asarray(met))
    frequency = float(speed) * np.arange(count + 1) / method.multiple
    mass, rates, stiffness = (
        np.asarray(x) for x in (system.mass, system.rates_at(speed), system.stiffness)
    )
    load = amplitude @ stiffness.T - frequency[:, None] ** 2 * (amplitude @ mass.T)
    load = load + 1j * frequency[:, None] * (amplitude @ rates.T)

    shifted = eqx.tree_at(lambda x: x.table.gap, system, gap)
    other = dataclasses.replace(
        harmonic_balance_problem(method, shifted), beside=jnp.asarray(load), rest=balance.rest
    )
    # One program serves both.
    none = dataclasses.replace(balance, beside=jnp.zeros(load.shape, dtype=complex))
    plain, _ = method.solve(none, speed)
    found, _ = method.solve(other, speed)
    assert bool(plain.settled)
    assert bool(found.settled)
    assert np.ptp(np.asarray(plain.load)[:, 0]) > 0.1
    assert_near(np.asarray(found.load), np.asarray(plain.load), 1e-7)
    middle = np.tile(moved[1], (method.multiple, 1))
    assert_near(np.asarray(found.motion), np.asarray(plain.motion) + middle, 1e-7)
    begins = np.real(amplitude.sum(axis=0)), np.real((1j * frequency) @ amplitude)
    assert_near(np.asarray(found.start), np.asarray(plain.start) + np.stack(begins), 1e-7)


@pytest.mark.parametrize("name", quick(1, ["averaged", "bow", "exact", "two", "cell damping"]))
def test_iteration_finds_what_the_matrix_does(name, monkeypatch):
    """A response with open cells, and its derivatives by speed and load in both directions."""
    system, method = _variant(name)
    at = jnp.asarray([0.9, 0.3])

    def response(at, method):
        balance = harmonic_balance_problem(
            method, dataclasses.replace(system, load=at[1] * system.load)
        )
        problem, _ = balance.at_speed(at[0])
        terms, error, steps = root_of((1e-9, 60), problem, balance.rest)
        return terms, (error, steps)

    def found(method):
        """Each time one program of its own."""

        @jax.jit
        def all_of_it(at):
            terms, push, seen = jax.linearize(lambda x: response(x, method), at, has_aux=True)
            along = lambda moved: push(moved)
            pull = jax.linear_transpose(along, at)
            # One after the other: batched they take far longer to compile.
            (reverse,) = jax.lax.map(pull, jnp.eye(terms.size).reshape(-1, *terms.shape))
            return terms, jax.lax.map(along, jnp.eye(at.size)), reverse, seen

        terms, forward, reverse, seen = all_of_it(at)
        return terms, jnp.moveaxis(forward, 0, -1), reverse.reshape(*terms.shape, at.size), seen

    expected = found(method)
    monkeypatch.setattr(_harmonic_problem, "MOST_DIRECT", 0)
    # Another number of steps makes a problem that JAX has not traced yet.
    iterated = found(dataclasses.replace(method, most_steps=method.most_steps + 1))
    for one, other in zip(iterated[:3], expected[:3], strict=True):
        assert_near(np.asarray(one), np.asarray(other), 1e-10)
    error, steps = expected[3]
    assert float(error) <= 1e-9
    assert float(steps) > 2.0


@pytest.mark.parametrize("averaged", [False, True])
def test_a_transform_over_mesh_periods_does_what_the_matrices_do(averaged):
    """Steps of two lengths, four mesh periods, a number of harmonics that these do not divide."""
    periods, count = 4, 10
    lengths = jnp.asarray([0.2, 0.2, 0.2, 0.1, 0.15, 0.15])
    edges = jnp.concatenate([jnp.zeros(1), jnp.cumsum(jnp.tile(lengths, periods))])
    middles = 0.5 * (edges[1:] + edges[:-1])
    rng = np.random.default_rng(1)
    terms, known = rng.normal(size=(2 * count + 1, 3)), rng.normal(size=(middles.size, 3))

    @jax.jit
    def both(terms, known):
        matrix = basis_of(middles / periods, count)
        analysis = analysis_of(matrix, jnp.diff(edges) / periods, averaged=averaged)
        values = periodic_basis(middles[: lengths.size], count, periods)
        analyst = periodic_analysis(values, lengths / periods, averaged=averaged)
        rates = [rates_of(each, jnp.asarray(0.3)) for each in (matrix, values)]
        return (
            (matrix, as_matrix(values)),
            (matrix @ terms, values @ terms),
            tuple(each @ terms for each in rates),
            (analysis @ known, analyst @ known),
            tuple(closest_terms(x, jnp.diff(edges), known) for x in (matrix, values)),
        )

    for expected, found in both(jnp.asarray(terms), jnp.asarray(known)):
        assert_near(np.asarray(found), np.asarray(expected), 1e-11)


@pytest.mark.slow
def test_long_cycles_are_iterated_for():
    """Of a thousand and more harmonics, whose matrix would have 0.5 GB."""
    system = cases.two_dof(steps=48)
    orbits = [
        jax.jit(lambda s, m=m: m.orbit(s, jnp.asarray(0.9)))(system)
        for m in (HarmonicBalance(harmonics=20), HarmonicBalance(harmonics=20, multiple=50))
    ]
    assert 2 * (2 * 20 * 50 + 1) > 2 * _harmonic_problem.MOST_AT_ONCE
    assert all(bool(orbit.settled) for orbit in orbits)
    one, many = (np.asarray(orbit.place) for orbit in orbits)
    assert_near(many, np.tile(one, (50, 1)), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("gyroscopic", quick(1, [None, 0.2]))
def test_bilinear_harmonics_are_the_midpoint_rule(gyroscopic):
    """Two codes, one number: all harmonics of an odd number of equal steps, contact lost."""
    system = cases.two_dof(steps=41, load=0.08)
    if gyroscopic is not None:
        turning = gyroscopic * jnp.asarray([[0.0, 1.0], [-1.0, 0.0]])
        system = dataclasses.replace(system, gyroscopic=turning)
    method = HarmonicBalance(harmonics=20, bilinear=True)
    shooting = Shooting(stepper=Midpoint(), tolerance=1e-13)
    both = jax.jit(
        jax.vmap(
            lambda speed: (
                steady_state(system, speed, method),
                steady_state(system, speed, shooting),
            )
        )
    )
    harmonic, shot = both(SPEEDS)
    assert np.all(harmonic.settled)
    assert np.all(shot.settled)
    # Most cells have opened.
    assert float(jnp.min(shot.load[:, :, 0])) < 0.3 * 0.08
    np.testing.assert_allclose(harmonic.place, shot.place, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(harmonic.load, shot.load, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(harmonic.motion, shot.motion, rtol=0.0, atol=1e-11)


@pytest.mark.slow
def test_slow_gears_run_as_at_rest():
    dynamics = cases.torsional_pair(relief=15e-6)
    method = HarmonicBalance(harmonics=15)
    slow = jax.jit(lambda s: steady_state(s, jnp.asarray(1.0), method))(dynamics.system)
    swing = float(np.ptp(np.asarray(dynamics.system.rest[:, 0])))
    np.testing.assert_allclose(
        slow.place[:, 0], dynamics.system.rest[:, 0], rtol=0.0, atol=0.02 * swing
    )
    np.testing.assert_allclose(
        contact_force(dynamics.system, slow), dynamics.system.force, rtol=1e-2
    )


@pytest.mark.slow
def test_mesh_force_is_the_static_one_less_inertia():
    """F_m = F_s - m_eq TE'' for gears that only turn, with the damping force."""
    system = cases.torsional_pair(relief=15e-6).system
    method = HarmonicBalance(harmonics=12)

    @jax.jit
    def amplitudes(system, speed):
        balance = harmonic_balance_problem(method, system)
        problem, _ = balance.at_speed(speed)
        orbit, terms = method.solve(balance, speed)
        load = balance.analysis @ orbit.load
        return problem.base, terms[0], load[:, 0], orbit

    base, place, load, orbit = amplitudes(system, jnp.asarray(900.0))
    base = float(base)
    assert bool(orbit.settled)
    inverse = np.asarray(system.vectors[:, 0]) @ np.linalg.solve(
        np.asarray(system.mass), np.asarray(system.vectors[:, 0])
    )
    damping = np.asarray(system.damping)
    # All damping is in the mesh: C = c v v^T, apart from the rotation that is held.
    v = np.asarray(system.vectors[:, 0])
    inertia = np.linalg.solve(np.asarray(system.mass), v)
    viscous = inertia @ damping @ inertia / inverse**2
    order = np.arange(1.0, 13.0)
    cosine, sine = np.asarray(place[1:13]), np.asarray(place[13:])
    speed_cosine, speed_sine = order * base * sine, -order * base * cosine
    force_cosine = (order * base) ** 2 * cosine / inverse - viscous * speed_cosine
    force_sine = (order * base) ** 2 * sine / inverse - viscous * speed_sine
    size = np.abs(load[1:]).max()
    np.testing.assert_allclose(load[0], system.force, rtol=1e-9)
    np.testing.assert_allclose(load[1:13], force_cosine, rtol=0.0, atol=1e-9 * size)
    np.testing.assert_allclose(load[13:], force_sine, rtol=0.0, atol=1e-9 * size)


@pytest.mark.slow
def test_batches_agree_with_single_speeds():
    system = cases.two_dof(steps=48)
    method = HarmonicBalance(harmonics=8)
    mapped = eqx.filter_jit(steady_states)(system, SPEEDS, method)
    batched = jax.jit(jax.vmap(lambda speed: steady_state(system, speed, method)))(SPEEDS)
    np.testing.assert_allclose(mapped.place, batched.place, rtol=0.0, atol=1e-10)
    np.testing.assert_array_equal(mapped.settled, batched.settled)


def test_uneven_steps_keep_the_mean_out_of_the_harmonics():
    system = cases.sdof_rectangular(steps=40, contact_ratio=1.2)
    balance = eqx.filter_jit(harmonic_balance_problem)(HarmonicBalance(harmonics=10), system)
    constant = balance.analysis @ jnp.ones(40)
    np.testing.assert_allclose(constant, np.eye(21)[0], rtol=0.0, atol=1e-14)
    wave = 2.0 * np.pi * np.asarray(system.table.middles)
    amplitude = order_amplitudes(system, jnp.asarray(3.0 + 2.0 * np.cos(2.0 * wave)), 4)
    np.testing.assert_allclose(amplitude, [0.0, 2.0, 0.0, 0.0], rtol=0.0, atol=2e-2)


def test_more_harmonics_than_steps_can_carry_are_refused():
    with pytest.raises(ValueError, match="24 harmonics need more than 48 time steps, got 48"):
        harmonic_balance_problem(HarmonicBalance(harmonics=24), cases.two_dof(steps=48))
    with pytest.raises(ValueError, match="must be at least 1, got 0"):
        HarmonicBalance(harmonics=0)
    with pytest.raises(ValueError, match="for `ExactContact`"):
        HarmonicBalance(law=jg.SmoothContact(1e-6), averaged=True)
    with pytest.raises(ValueError, match="starts from harmonics"):
        steady_state(cases.two_dof(steps=48), jnp.asarray(1.0), start=jnp.zeros((2, 2)))


@pytest.mark.parametrize("speed", [0.0, -3.0])
def test_speeds_must_be_positive(speed):
    with pytest.raises(ValueError, match="must be positive"):
        steady_state(cases.two_dof(steps=48), jnp.asarray(speed))
    with pytest.raises(ValueError, match="must be positive"):
        steady_states(cases.two_dof(steps=48), jnp.asarray([1.0, speed]))


def test_what_has_not_settled_has_no_derivative():
    """In neither direction; but what is left out of a result leaves its derivative as it is."""
    system = cases.sdof_rectangular(damping_ratio=0.08, steps=32)
    method = HarmonicBalance(harmonics=8, most_steps=4)

    def ratios(speeds):
        orbits = steady_states(system, speeds, method)
        each = jax.vmap(lambda orbit: dynamic_ratio(system, orbit))(orbits)
        return jnp.append(each, jnp.sum(jnp.where(orbits.settled, each, 0.0))), orbits.settled

    @jax.jit
    def derivatives(speeds):
        values, push, settled = jax.linearize(ratios, speeds, has_aux=True)
        along = lambda moved: push(moved)
        pull = jax.linear_transpose(along, speeds)
        (reverse,) = jax.lax.map(pull, jnp.eye(values.size))
        return (jax.lax.map(along, jnp.eye(speeds.size)).T, reverse), settled

    both, settled = derivatives(jnp.asarray([2.3, 0.8]))
    np.testing.assert_array_equal(settled, [True, False])
    for *slopes, of_sum in both:
        np.testing.assert_array_equal(np.isnan(slopes), [[False, False], [False, True]])
        np.testing.assert_array_equal(of_sum, [slopes[0][0], 0.0])
        assert abs(of_sum[0]) > 1e-3
