"""Marching: the rules of the steppers, their order, their energy, and the forces they report."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import cases
from helpers import quick

import jaxgear as jg
from jaxgear._dynamics import _pressing
from jaxgear._dynamics._march import TimeStepping, at_rest, quasi_static_start, time_history
from jaxgear._dynamics._march_step import rule_of
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._pressing import Pressing, pressed
from jaxgear._dynamics._steady_state import steady_state
from jaxgear._dynamics._steppers import (
    Exponential,
    GeneralizedAlpha,
    HilberHughesTaylor,
    Midpoint,
    Newmark,
)
from jaxgear._dynamics._system import modal_basis
from jaxgear._response._energy import energies

STEPPERS = {
    "midpoint": Midpoint(),
    "exponential": Exponential(),
    "newmark": Newmark(),
    "generalised alpha": GeneralizedAlpha(0.8),
    "hht": HilberHughesTaylor(-0.05),
}


# The others carry an acceleration that is not that of the start of a step.
@pytest.mark.parametrize("name", quick(1, ["exponential", "newmark", "midpoint"]))
def test_rule_against_the_mode_itself(name):
    """One step of damped and overdamped modes under a constant load: exact, or right to h^3."""
    stepper = STEPPERS[name]
    square, damping = jnp.asarray([1.0, 4.0, 0.04]), jnp.asarray([0.1, 4.0, 3.0])

    @jax.jit
    def error(step):
        place, speed, load = jnp.full(3, 0.3), jnp.full(3, -0.2), jnp.full(3, 0.7)
        state = (place, speed, load - damping * speed - square * place)[: stepper.carries]
        ended = stepper.advance(state, load, square, damping, step)[0]
        zero, one = jnp.zeros(3), jnp.ones(3)
        matrix = jnp.stack(
            [
                jnp.stack([zero, one, zero]),
                jnp.stack([-square, -damping, one]),
                jnp.stack([zero, zero, zero]),
            ]
        )
        exact = jax.vmap(jax.scipy.linalg.expm, in_axes=2)(step * matrix)
        start = jnp.stack([place, speed, load], axis=1)
        found = jnp.sum(exact * start[:, None, :], axis=2)
        return jnp.max(jnp.abs(found[:, :2] - jnp.stack(ended[:2], axis=1)))

    fine, coarse = (float(error(jnp.asarray(h))) for h in (0.01, 0.02))
    if name == "exponential":
        assert coarse < 1e-14
    else:
        assert 2.8 < np.log2(coarse / fine) < 3.2


@pytest.mark.slow
def test_rule_agrees_with_its_stepper():
    system = cases.two_dof(steps=40)
    state, load = np.random.default_rng(1).normal(size=(3, 2)), np.array([0.4, -1.0])

    @jax.jit
    def both(state, load):
        """Of every stepper, its rule, and the end of a step with what it reports on the way."""
        modes, step = modal_basis(system), jnp.asarray(0.05)
        found = []
        for stepper in STEPPERS.values():
            rule = rule_of(stepper, system, modes, step, jnp.asarray(1.0))
            own = tuple(state[: stepper.carries])
            found.append((rule, stepper.advance(own, load, modes.square, modes.damping, step)))
        return found

    for rule, (ended, near, rate) in both(jnp.asarray(state), jnp.asarray(load)):
        rule = jax.tree.map(np.asarray, rule)
        own = state[: len(ended)]
        ours = np.sum(rule.state * own[None], axis=1) + rule.load * load[None]
        np.testing.assert_allclose(ours, np.stack(ended), rtol=1e-12)
        ours = np.sum(rule.near * own, axis=0) + rule.near_load * load
        np.testing.assert_allclose(ours, near, rtol=1e-12)
        ours = np.sum(rule.rate * own, axis=0) + rule.rate_load * load
        np.testing.assert_allclose(ours, rate, rtol=1e-12)


@pytest.mark.parametrize("name", quick(1, ["exponential", "midpoint", "newmark", "hht"]))
def test_second_order(name):
    """The settled response against steps four times finer.

    Stiffness jumps between steps, but for the rule that carries a mixed acceleration over it.
    """
    stepper = STEPPERS[name]
    smooth = name == "hht"
    build = cases.sdof_parametric if smooth else cases.sdof_rectangular

    def motion(steps: int) -> np.ndarray:
        system = build(steps=steps, damping_ratio=0.2)
        history = jax.jit(
            lambda: time_history(
                system, jnp.asarray(0.8), quasi_static_start(system), cycles=25, stepper=stepper
            )
        )()
        every = steps // 40
        return np.asarray(history.motion[every - 1 :: every, 0])

    coarse, fine, finest = (motion(steps) for steps in (40, 80, 320))
    ratio = np.abs(coarse - finest).max() / np.abs(fine - finest).max()
    assert 3.4 < ratio < 5.2


def _bouncing(stiffness: float = 1.0):
    """No damping and stiffness that stands still: energy has nowhere to go."""
    system = cases.sdof_parametric(damping_ratio=0.0, ripple=0.0, steps=64)
    return dataclasses.replace(system, damping=jnp.zeros((1, 1)))


_marched = eqx.filter_jit(time_history)


def _energies(step: float, stepper, *, averaged: bool) -> np.ndarray:
    speed, start = jnp.asarray(2.0 * np.pi / (64 * step)), jnp.asarray([[4.0], [0.0]])
    given: dict[str, Any] = {"stepper": stepper, "averaged": averaged, "cycles": 20, "keep": 20}
    history = _marched(_bouncing(), speed, start, **given)
    place, velocity = np.asarray(history.motion[:, 0]), np.asarray(history.velocity[:, 0])
    return 0.5 * velocity**2 + 0.5 * np.maximum(place, 0.0) ** 2 - place


@pytest.mark.slow
def test_energy_of_bouncing_flanks():
    """Averaged contact conserves it to rounding; Newmark drifts, at second order at the least."""
    kept = _energies(0.1, Midpoint(), averaged=True)
    np.testing.assert_allclose(kept, 4.0, rtol=0.0, atol=1e-9)
    coarse, fine = (
        np.abs(_energies(h, Newmark(), averaged=False) - 4.0).max() for h in (0.1, 0.05)
    )
    assert coarse > 1e-4
    assert coarse / fine > 3.5


@pytest.mark.slow
def test_energy_in_contact_is_conserved_at_a_standing_phase():
    """A real pair whose phase stands still, undamped, pushed: drift of second order in the step."""
    dynamics = cases.torsional_pair()
    system = dynamics.system
    table = system.table
    still = lambda x, axis: jnp.repeat(jnp.take(x, jnp.asarray([5]), axis=axis), 32, axis=axis)
    frozen = dataclasses.replace(
        table,
        edges=jnp.linspace(0.0, 1.0, 33),
        stiffness=still(table.stiffness, 0),
        gap=still(table.gap, 1),
        arms=still(table.arms, 1),
        coupling=still(table.coupling, 0),
        kinds=(0,) * 32,
        kept=still(table.kept, 0),
    )
    system = dataclasses.replace(
        system, table=frozen, damping=jnp.zeros_like(system.damping), rest=still(system.rest, 0)
    )
    rest = eqx.filter_jit(quasi_static_start)(system)
    kick = jnp.linalg.solve(system.mass, system.vectors[:, 0])
    start = rest.at[1].set(kick * 0.6 / (system.vectors[:, 0] @ kick))

    @jax.jit
    def drift(speed):
        history = time_history(system, speed, start, cycles=4, keep=4, stepper=Newmark())
        found = energies(system, history)
        return jnp.ptp(found.total) / jnp.max(found.kinetic), jnp.min(history.load[:, 0])

    (coarse, lost), (fine, _) = (drift(jnp.asarray(v)) for v in (1500.0, 3000.0))
    assert lost == 0.0
    assert coarse < 0.05
    assert coarse / fine > 3.0


@pytest.mark.slow
def test_damping_takes_what_energy_loses():
    system = cases.sdof_parametric(ripple=0.0, steps=64)
    start = jnp.asarray([[4.0], [0.0]])
    found = jax.jit(
        lambda: energies(
            system, time_history(system, jnp.asarray(1.0), start, cycles=3, keep=3, averaged=True)
        )
    )()
    assert float(found.dissipated[-1]) > 1.0
    np.testing.assert_allclose(found.total, 4.0, rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_marches_end_in_the_response_of_harmonic_balance():
    system = cases.two_dof(steps=100)
    speed = jnp.asarray(0.62)
    reference = jax.jit(lambda: steady_state(system, speed))()
    peak = float(jnp.max(reference.load[:, 0]))
    for name in ("midpoint", "newmark", "hht"):
        method = TimeStepping(stepper=STEPPERS[name], cycles=120, tolerance=1e-6)
        orbit = jax.jit(lambda m=method: steady_state(system, speed, m))()
        assert bool(orbit.settled)
        np.testing.assert_allclose(float(jnp.max(orbit.load[:, 0])), peak, rtol=4e-3)
        np.testing.assert_allclose(orbit.motion, reference.motion, rtol=0.0, atol=0.01)


@pytest.mark.slow
def test_mesh_force_obeys_newton():
    """M a = F - C v - K q - V g in every step of the midpoint rule, gears that only turn."""
    system = cases.torsional_pair(relief=15e-6).system
    start = eqx.filter_jit(quasi_static_start)(system)
    history = eqx.filter_jit(time_history)(system, jnp.asarray(1000.0), start, cycles=30)
    begun = np.concatenate([np.asarray(history.start[:1]), np.asarray(history.motion[:-1])])
    rate = np.concatenate([np.asarray(history.start[1:]), np.asarray(history.velocity[:-1])])
    step = np.asarray(system.table.lengths * system.mesh_period(jnp.asarray(1000.0)))[:, None]
    acceleration = (np.asarray(history.velocity) - rate) / step
    middle = 0.5 * (np.asarray(history.motion) + begun)
    moved = 0.5 * (np.asarray(history.velocity) + rate)
    balance = (
        acceleration @ np.asarray(system.mass)
        + moved @ np.asarray(system.damping)
        + middle @ np.asarray(system.stiffness)
        + np.asarray(history.load) @ np.asarray(system.vectors).T
    )
    size = float(jnp.max(jnp.abs(system.load)))
    expected = np.broadcast_to(np.asarray(system.load, dtype=float), balance.shape)
    np.testing.assert_allclose(balance, expected, rtol=0.0, atol=1e-6 * size)
    ratio = np.asarray(history.load[:, 0]) / float(system.force)
    # F_m = F_s - m_eq (TE_n'' and its damping), along the approach alone.
    inverse = np.linalg.solve(np.asarray(system.mass), np.asarray(system.vectors[:, 0]))
    approach = np.asarray(system.vectors[:, 0]) @ inverse
    pushed = (
        acceleration
        + moved @ np.linalg.solve(np.asarray(system.mass), np.asarray(system.damping)).T
    )
    inertia = pushed @ np.asarray(system.vectors[:, 0]) / approach / float(system.force)
    np.testing.assert_allclose(ratio, 1.0 - inertia, rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_start_from_rest_settles_where_the_quasi_static_start_does():
    system = cases.two_dof(steps=60)
    speed = jnp.asarray(1.7)
    ends = jax.jit(
        lambda starts: jax.vmap(
            lambda start: time_history(system, speed, start, cycles=150, stepper=Exponential())
        )(starts)
    )(jnp.stack([at_rest(system), quasi_static_start(system)]))
    assert np.all(ends.converged)
    np.testing.assert_allclose(ends.motion[0], ends.motion[1], rtol=0.0, atol=1e-6)


def test_contact_of_cells_that_are_all_coupled():
    """Against every set of closed cells: the one whose forces press and whose gaps are open."""
    cells, width = 6, 3
    random = np.random.default_rng(5)
    spread = random.normal(size=(cells, cells))
    stiffness, arms = 1.0 + random.random(cells), random.normal(size=(cells, width))
    coupling, own = 0.1 * spread @ spread.T, random.normal(size=(width, width))
    # Not symmetric, as where gyroscopic forces tie the modes together.
    yields = own @ own.T + 0.2 * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    given = coupling + arms @ yields @ arms.T

    def ours(place):
        own: Any = (jnp.asarray(x) for x in (stiffness, 0.0 * stiffness, arms, coupling))
        mesh = Mesh(*own)
        zero, one = jnp.zeros(width), jnp.asarray(1.0)
        nothing = jnp.zeros((width, width))
        problem = Pressing(
            jg.ExactContact(), (mesh,), None, place, jnp.asarray(yields), zero, nothing, None, one
        )
        return pressed(problem, zero)

    solve = jax.jit(lambda place: (*ours(place), jax.jacfwd(lambda x: ours(x)[0])(place)))
    closed = []
    for _ in range(5):
        place = random.normal(size=width)
        load, error, slope = solve(jnp.asarray(place))
        found = []
        for number in range(2**cells):
            some = np.array([bool(number >> i & 1) for i in range(cells)])
            tied = np.diag(1.0 / stiffness[some]) + given[np.ix_(some, some)]
            force = np.zeros(cells)
            force[some] = np.linalg.solve(tied, arms[some] @ place)
            if np.all(force >= 0.0) and np.all((arms @ place - given @ force)[~some] <= 0.0):
                found.append((arms.T @ force, arms[some].T @ np.linalg.solve(tied, arms[some])))
                closed.append(some.sum())
        assert len(found) == 1
        assert float(error) < 1e-12
        np.testing.assert_allclose(load, found[0][0], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(slope, found[0][1], rtol=1e-9, atol=1e-11)
    assert 0 < min(closed) < max(closed)


@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_contact_that_was_not_solved_has_no_derivative(derivative, monkeypatch):
    """Two springs of 1 N/m, pushed 5 m onto a node that gives 1 m/N: g = (5 - g) + (4 - g)."""
    one = jnp.ones((1, 1))
    mesh = Mesh(jnp.ones(2), jnp.asarray([0.0, 1.0]), jnp.ones((2, 1)), None)

    def load(place):
        problem = Pressing(
            *(jg.ExactContact(), (mesh,), None, place, one, jnp.zeros(1), 0.0 * one, None),
            scale=jnp.asarray(1.0),
        )
        return pressed(problem, jnp.zeros(1))[0][0]

    place = jnp.asarray([5.0])
    found, slope = jax.jit(lambda place: (load(place), derivative(load)(place)))(place)
    assert found == pytest.approx(3.0, rel=1e-12)
    assert slope[0] == pytest.approx(2.0 / 3.0, rel=1e-12)
    # One step does not know yet that it was the last.
    monkeypatch.setattr(_pressing, "_MOST_STEPS", 1)
    assert np.isnan(jax.jit(lambda place: derivative(load)(place))(place)[0])


@pytest.mark.slow
def test_smooth_contact_without_slices_near_separation_is_exact_contact():
    system = cases.two_dof(steps=60, load=5.0)
    one = lambda law: jax.jit(
        lambda: time_history(
            system, jnp.asarray(1.7), quasi_static_start(system), cycles=5, law=law
        )
    )()
    exact, smooth = one(jg.ExactContact()), one(jg.SmoothContact(0.1))
    np.testing.assert_array_equal(exact.load, smooth.load)


def test_active_mesh_damping_acts_in_contact_only():
    """Free flight between bounces keeps its energy, contact loses some."""
    system = dataclasses.replace(_bouncing(), cell_damping=jnp.asarray(0.1))
    start = jnp.asarray([[4.0], [0.0]])
    history = eqx.filter_jit(time_history)(
        system, jnp.asarray(2.0 * np.pi / 6.4), start, cycles=3, keep=3, stepper=Exponential()
    )
    place, velocity = np.asarray(history.motion[:, 0]), np.asarray(history.velocity[:, 0])
    energy = 0.5 * velocity**2 + 0.5 * np.maximum(place, 0.0) ** 2 - place
    flies = (place[1:] < -0.2) & (place[:-1] < -0.2)
    assert flies.sum() > 5
    # Nothing is left of a force, but the split of constant stiffness over the step.
    np.testing.assert_allclose(np.diff(energy)[flies], 0.0, rtol=0.0, atol=2e-3)
    assert energy[0] - energy[-1] > 0.5


def test_what_cannot_be_marched_is_refused():
    system = cases.two_dof(steps=60)
    with pytest.raises(ValueError, match="keep = 3 of 2"):
        time_history(system, jnp.asarray(1.0), at_rest(system), cycles=2, keep=3)
    with pytest.raises(ValueError, match="use `Midpoint`"):
        time_history(
            system, jnp.asarray(1.0), at_rest(system), cycles=2, stepper=Newmark(), averaged=True
        )
    with pytest.raises(ValueError, match="Only exact contact"):
        time_history(
            system,
            jnp.asarray(1.0),
            at_rest(system),
            cycles=2,
            law=jg.SmoothContact(0.1),
            averaged=True,
        )
    with pytest.raises(ValueError, match="0 to 1, got 2"):
        GeneralizedAlpha(2.0)
    with pytest.raises(ValueError, match=r"-1/3 to 0, got 0\.1"):
        HilberHughesTaylor(0.1)
    with pytest.raises(ValueError, match="must be positive"):
        Newmark(beta=0.0)
