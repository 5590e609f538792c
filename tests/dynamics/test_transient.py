"""Transients against closed forms and against SciPy's integrators on the same equations in NumPy.

The oscillators have unit mass and unit static deflection: 1 rad/s is the natural frequency.
"""

import dataclasses
import functools
import math
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import cases
from helpers import assert_close, observed_order, quick
from scipy.integrate import cumulative_trapezoid, solve_ivp

import jaxgear as jg
from jaxgear._dynamics._march import quasi_static_start
from jaxgear._dynamics._schedule import Schedule, run_up, start_stop, torque_step
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._table import MeshTable
from jaxgear._dynamics._transient import TransientError, transient
from jaxgear._dynamics._transient_result import Transient, reached_only

STEPS, WIDTH = 16, 0.05
LAW = jg.SmoothContact(WIDTH)
AT_REST = np.array([[1.0], [0.0]])


def _phases(steps: int = STEPS) -> np.ndarray:
    """Phases of start, middle and end of each step."""
    return (np.arange(steps) + np.array([[0.0], [0.5], [1.0]])) / steps


def _oscillator(
    *, damping: float = 0.0, ripple: float = 0.0, waviness: float = 0.0
) -> DynamicSystem:
    """x'' + c x' + k sigma(x - gap) = 1, with one wave of stiffness and of gap in a mesh period."""
    stiffness = 1.0 + ripple * np.cos(2.0 * np.pi * _phases()[1])
    table = MeshTable(
        edges=jnp.linspace(0.0, 1.0, STEPS + 1),
        stiffness=jnp.asarray(stiffness[:, None]),
        gap=jnp.asarray(waviness * np.sin(2.0 * np.pi * _phases())[..., None]),
        arms=jnp.ones((3, STEPS, 1, 1)),
        coupling=None,
        periods=1,
        kinds=(0,) * STEPS,
    )
    one = jnp.ones((1, 1))
    return DynamicSystem(
        mass=one,
        damping=damping * one,
        stiffness=0.0 * one,
        gyroscopic=None,
        vectors=one,
        load=jnp.ones(1),
        bow=None,
        mean=one,
        table=table,
        cell_damping=None,
        force=jnp.ones(()),
        transmission=jnp.ones(1),
        rest=jnp.ones((STEPS, 1)),
        free=jnp.zeros((1, 0)),
        teeth=1,
    )


def _run(
    system: DynamicSystem,
    speed: Any = 1.0,
    ratio: Any = 1.0,
    *,
    start: Any = AT_REST,
    end: float = 60.0,
    rtol: float = 1e-9,
    **options: Any,
) -> Transient:
    """Always as many samples and knots, so that one program serves many tests."""
    times = np.linspace(0.0, end, 2001)
    options = {"law": LAW, "rtol": rtol, "atol": rtol, **options}
    return transient(system, speed, ratio, jnp.asarray(start), jnp.asarray(times), **options)


# --- NumPy's own


def _ramp(x: np.ndarray, width: float) -> np.ndarray:
    v = np.clip(x / width + 1.0, 0.0, 2.0)
    return np.where(x < width, width * v**3 * (4.0 - v) / 16.0, x)


def _ramp_slope(x: np.ndarray, width: float) -> np.ndarray:
    v = np.clip(x / width + 1.0, 0.0, 2.0)
    return np.where(x < width, v**2 * (3.0 - v) / 4.0, 1.0)


def _by_scipy(system: DynamicSystem, speed: float, start: np.ndarray, times: np.ndarray):
    """Motion at given times, step by step of the table, at one speed."""
    table, matrix = system.table, np.asarray
    whirl = 0.0 if system.gyroscopic is None else speed * matrix(system.gyroscopic)
    losing, mass = matrix(system.damping) + whirl, matrix(system.mass)
    vectors, load = matrix(system.vectors), matrix(system.load)
    eta = 0.0 if system.cell_damping is None else float(system.cell_damping)
    edges, rate = matrix(table.edges), system.teeth * speed / (2.0 * np.pi)
    size = len(load)

    def slope(time, state, step, began, length):
        motion, velocity = state[:size], state[size:]
        part = (time * rate - began) / length
        lay = np.array([(1 - part) * (1 - 2 * part), 4 * part * (1 - part), part * (2 * part - 1)])
        gap, arms = (matrix(x)[:, step] for x in (table.gap, table.arms))
        place, moving = vectors.T @ motion, vectors.T @ velocity
        rows = np.tensordot(lay, arms, 1)
        overlap = rows @ place - lay @ gap
        closing = rows @ moving
        press = _ramp(overlap, WIDTH) + eta * _ramp_slope(overlap, WIDTH) * closing
        force = vectors @ (rows.T @ (matrix(table.stiffness)[step] * press))
        pull = load - force - matrix(system.stiffness) @ motion - losing @ velocity
        return np.concatenate([velocity, np.linalg.solve(mass, pull)])

    state, found = np.concatenate(start), [start[0]]
    steps = len(edges) - 1
    for i in range(math.ceil(times[-1] * rate * steps)):
        cycle, step = divmod(i, steps)
        ends = [(cycle + edges[step]) / rate, min((cycle + edges[step + 1]) / rate, times[-1])]
        given = (step, cycle + edges[step], edges[step + 1] - edges[step])
        inside = times[(times > ends[0] + 1e-9) & (times <= ends[1] + 1e-9)]
        at = np.unique(np.concatenate([np.clip(inside, *ends), ends[1:]]))
        done = solve_ivp(slope, ends, state, "DOP853", at, args=given, rtol=1e-11, atol=1e-12)
        state = done.y[:, -1]
        found.extend(done.y[:size, : len(inside)].T)
    return np.array(found)


# --- closed forms


def test_linear_oscillator_decays_as_in_closed_form():
    ratio = 0.05
    found = _run(_oscillator(damping=2.0 * ratio), start=[[1.4], [0.0]])
    damped = math.sqrt(1.0 - ratio**2)
    times = np.asarray(found.times)
    swing = np.cos(damped * times) + ratio / damped * np.sin(damped * times)
    expected = 1.0 + 0.4 * np.exp(-ratio * times) * swing
    assert_close(found.motion[:, 0], expected, rtol=0.0, atol=2e-8)
    assert_close(found.load[:, 0], expected, rtol=0.0, atol=2e-8)
    assert_close(found.transmission_error, expected, rtol=0.0, atol=2e-8)
    quick = -0.4 * np.exp(-ratio * times) * np.sin(damped * times) / damped
    assert_close(found.velocity[:, 0], quick, rtol=0.0, atol=2e-8)
    assert_close(found.phase, times / (2.0 * np.pi), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(("before", "after"), [(1.0, 0.8), (0.5, 0.7)])
def test_torque_step_of_a_constant_stiffness(before, after):
    at = 12.34567
    found = _run(_oscillator(), ratio=torque_step(before, after, at), start=[[before], [0.0]])
    since = np.maximum(np.asarray(found.times) - at, 0.0)
    expected = after + (before - after) * np.cos(since)
    assert_close(found.load[:, 0], expected, rtol=0.0, atol=5e-8)


@pytest.mark.parametrize("swing", [0.5, 3.0])
def test_energy_stays_at_a_frozen_phase(swing):
    # With 3.0 it leaves contact, at x < 0, and comes back.
    found = _run(_oscillator(), 0.0, start=[[1.0 + swing], [0.0]])
    place, speed = np.asarray(found.place[:, 0]), np.asarray(found.velocity[:, 0])
    assert (place.min() < -1.0) == (swing > 1.0)
    contact = np.asarray(jg.SmoothContact(WIDTH).energy(jnp.asarray(place)))
    energy = 0.5 * speed**2 + contact - place
    assert_close(energy, np.full_like(energy, energy[0]), rtol=0.0, atol=2e-6)
    assert float(jnp.max(jnp.abs(found.phase))) == 0.0


# --- other integrators


def _lossy() -> DynamicSystem:
    return _oscillator(damping=0.1, ripple=0.3, waviness=0.1)


@pytest.mark.slow
def test_contact_loss_agrees_with_scipy():
    system, speed = _lossy(), 0.85
    found = _run(system, speed, end=50.0)
    times = np.asarray(found.times)
    expected = _by_scipy(system, speed, AT_REST, times[::20])
    assert expected.min() < -0.5
    assert_close(found.motion[::20], expected, rtol=0.0, atol=1e-6)


@pytest.mark.slow
def test_implicit_and_explicit_solver_agree():
    system, speed = _lossy(), 0.85
    explicit = _run(system, speed, end=50.0)
    implicit = _run(system, speed, end=50.0, solver="kvaerno5")
    assert_close(implicit.place, explicit.place, rtol=0.0, atol=1e-5)
    # Stages beyond the end of a step see the step's own stiffness: no step fails at a jump.
    smooth = _run(_oscillator(damping=0.1, ripple=0.3), 1.5, end=50.0, solver="kvaerno5")
    assert int(smooth.rejected) < 0.1 * int(smooth.steps)


def _bodies_with_everything() -> DynamicSystem:
    """Approach and tilt, four cells with travelling gaps, whirl, damping in the cells."""
    system = cases.two_dof(steps=STEPS)
    return dataclasses.replace(
        system,
        gyroscopic=jnp.asarray([[0.0, 0.05], [-0.05, 0.0]]),
        cell_damping=jnp.asarray(0.04),
    )


@pytest.mark.slow
def test_coupled_coordinates_whirl_and_damping_cells_agree_with_scipy():
    system, speed = _bodies_with_everything(), 0.9
    start = np.array([[1.8, 0.1], [0.0, 0.2]])
    # The loops of forward mode must give the same.
    found = _run(system, speed, start=start, end=30.0, adjoint=diffrax.ForwardMode())
    times = np.asarray(found.times)
    expected = _by_scipy(system, speed, start, times[::20])
    assert_close(found.motion[::20], expected, rtol=0.0, atol=1e-6)


@pytest.mark.slow
def test_real_pair_obeys_newton_and_both_solvers():
    system = cases.torsional_pair(relief=20e-6).system
    system = dataclasses.replace(system, damping=jnp.zeros_like(system.damping))
    approach = np.asarray(system.vectors[:, 0])
    lightness = approach @ np.linalg.solve(np.asarray(system.mass), approach)
    speed = 0.7 * math.sqrt(float(system.mean[0, 0]) * lightness) / system.teeth
    end = 2.0 * float(system.mesh_period(jnp.asarray(speed)))
    options: dict[str, Any] = {"law": jg.SmoothContact(1e-7), "end": end}
    options |= {"start": quasi_static_start(system)}
    found = _run(system, speed, **options)
    implicit = _run(system, speed, solver="kvaerno5", **options)
    force = float(system.force)
    assert_close(implicit.load[:, 0], found.load[:, 0], rtol=0.0, atol=1e-6 * force)
    assert float(jnp.max(found.load[:, 0])) > 1.05 * force
    # F_m = F_s - m TE'', integrated; a load that jumps between samples costs what is allowed.
    closing = np.asarray(found.velocity) @ approach
    missing = lightness * (force - np.asarray(found.load[:, 0]))
    pushed = cumulative_trapezoid(missing, np.asarray(found.times), initial=0.0)
    assert_close(closing, pushed, rtol=0.0, atol=2e-3 * np.max(np.abs(pushed)))


# --- what the structure leaves out


def _with_second_dof(
    system: DynamicSystem, mass: float, stiffness, vectors, bow: float
) -> DynamicSystem:
    """The oscillator with a second, light degree of freedom that is far above its frequency."""
    return dataclasses.replace(
        system,
        mass=jnp.diag(jnp.asarray([1.0, mass])),
        damping=jnp.diag(jnp.asarray([float(system.damping[0, 0]), 0.0])),
        stiffness=jnp.asarray(stiffness, dtype=float),
        vectors=jnp.asarray(vectors, dtype=float),
        load=jnp.asarray([1.0, 0.0]),
        transmission=jnp.asarray([1.0, 0.0]),
        free=jnp.zeros((2, 0)),
        bow=jnp.full((1, 1), bow),
    )


def _bowed(system: DynamicSystem, bow: float) -> DynamicSystem:
    """On a body that gives way, beside a bystander."""
    return _with_second_dof(system, 1.0, [[0.0, 0.0], [0.0, 1e4]], [[1.0], [0.0]], bow)


def _sprung(system: DynamicSystem, light: float, spring: float) -> DynamicSystem:
    """A mass that pushes a light gear through a spring."""
    stiffness = spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return _with_second_dof(system, light, stiffness, [[0.0], [1.0]], 0.0)


_SLOW_ONES = {"below": 20.0, "end": 30.0}


@pytest.mark.slow
def test_bow_is_a_spring_in_series():
    system = _oscillator()
    table = dataclasses.replace(system.table, stiffness=2.0 * system.table.stiffness)
    stiff = dataclasses.replace(system, table=table)
    found = _run(_bowed(stiff, 0.5), start=[[1.5, 0.0], [0.0, 0.0]], **_SLOW_ONES)
    expected = 1.0 + 0.5 * np.cos(np.asarray(found.times))
    assert_close(found.motion[:, 0], expected, rtol=0.0, atol=1e-7)
    assert_close(found.load[:, 0], expected, rtol=0.0, atol=1e-7)
    assert_close(found.place[:, 0], 0.5 * expected, rtol=0.0, atol=1e-7)


@pytest.mark.slow
def test_fast_modes_that_follow_are_springs_without_mass():
    # As the light gear loses its mass, a bow is left.
    spring, lights = 50.0, (4e-3, 2e-3, 1e-3)
    start = [[1.0, 0.0], [0.0, 0.0]]
    bowed = _run(_bowed(_lossy(), 1.0 / spring), 0.85, start=start, **_SLOW_ONES)
    assert float(jnp.min(bowed.load)) == 0.0
    errors = []
    for light in lights:
        start = [[1.0, 1.0 - 1.0 / spring], [0.0, 0.0]]
        kept = _run(_sprung(_lossy(), light, spring), 0.85, start=start, **_SLOW_ONES)
        assert int(kept.steps) < 1.2 * int(bowed.steps)
        errors.append(float(jnp.max(jnp.abs(kept.motion[:, 0] - bowed.motion[:, 0]))))
    assert 0.9 < observed_order(lights, errors) < 1.1


# --- speeds that change


def test_profiles_integrate_and_invert():
    profile = Schedule([0.0, 2.0, 3.0, 3.0, 5.0, 6.0], [0.0, 4.0, 4.0, 2.0, 0.0, 3.0])
    # Triangle, rectangle, jump, triangle down to a standstill, triangle up, then constant.
    known = [(-1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (2.0, 4.0), (3.0, 8.0), (4.0, 9.5), (5.0, 10.0)]
    known += [(6.0, 11.5), (8.0, 17.5)]
    times, integrals = np.array(known).T
    stopped = start_stop(10.0, 1.0, 2.0, 4.0)

    @jax.jit
    def evaluated(times, integrals, places):
        there = jax.vmap(profile.integral)(times), jax.vmap(profile.when)(integrals)
        end = stopped.integral(jnp.asarray(9.0)), stopped.when(jnp.asarray(45.1))
        return *there, jax.vmap(profile)(places), *end

    places = np.array([0.5, 2.5, 3.0, 4.0, 9.0])
    sums, whens, values, end, never = evaluated(times, integrals[2:], places)
    assert_close(sums, integrals, rtol=1e-14, atol=1e-14)
    assert_close(whens, times[2:], rtol=1e-13, atol=1e-13)
    assert_close(values, np.array([1.0, 4.0, 2.0, 1.0, 3.0]), rtol=1e-14, atol=1e-14)
    assert_close(end, 45.0, rtol=1e-14, atol=1e-14)
    assert float(never) == math.inf


def test_run_up_peaks_behind_the_resonance_and_tends_to_the_steady_response():
    damping, wave = 0.05, 0.02
    system = _oscillator(damping=2.0 * damping, waviness=wave)
    peaks, places = [], []
    for end in (60.0, 240.0, 960.0):
        found = _run(system, run_up(0.7, 1.3, end), end=end, rtol=1e-7)
        swing = np.hypot(np.asarray(found.place[:, 0]) - 1.0, np.asarray(found.velocity[:, 0]))
        peaks.append(swing.max())
        places.append(float(found.speed[swing.argmax()]))
    steady = wave / (2.0 * damping)
    assert peaks[0] < peaks[1] < peaks[2] < 1.02 * steady
    assert peaks[2] > 0.96 * steady
    assert places[0] > places[1] > places[2] > 1.0


# --- batches and derivatives


def _waved(depth) -> DynamicSystem:
    """Jumping stiffness, contact loss, and flanks whose waves have a depth."""
    system = _lossy()
    table = dataclasses.replace(system.table, gap=depth * system.table.gap)
    return dataclasses.replace(system, table=table)


def _late_place(depth, speed, end: float = 16.0, most_steps: int = 4096) -> jax.Array:
    times, start = jnp.linspace(0.0, end, 3), jnp.asarray(AT_REST)
    options: dict[str, Any] = {"law": LAW, "rtol": 1e-10, "atol": 1e-10}
    options |= {"most_steps": most_steps}
    found = transient(_waved(depth), speed, 1.0, start, times, **options)
    return jnp.sum(found.place[:, 0] ** 2)


@pytest.mark.slow
def test_batches_agree_with_single_runs():
    speeds = jnp.asarray([0.0, 0.85])
    batch = jax.jit(jax.vmap(functools.partial(_late_place, jnp.ones(()))))(speeds)
    for speed, found in zip(speeds, batch, strict=True):
        alone = _run(_waved(1.0), speed, end=16.0, rtol=1e-10)
        assert_close(found, jnp.sum(alone.place[::1000, 0] ** 2), rtol=1e-8, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "most_steps"), [(2.0, 64), pytest.param(16.0, 4096, marks=pytest.mark.slow)]
)
def test_gradients_by_gap_and_by_speed(end, most_steps):
    # The speed moves the instants at which stiffness jumps: derivatives hold those too.
    place = functools.partial(_late_place, end=end, most_steps=most_steps)
    both = jax.jit(jax.value_and_grad(place, argnums=(0, 1)))
    at, step = np.array([1.0, 0.85]), 1e-4
    _, slopes = both(*at)
    for slope, move in zip(slopes, step * np.eye(2), strict=True):
        central = (both(*(at + move))[0] - both(*(at - move))[0]) / (2.0 * step)
        assert abs(float(central)) > 0.01
        assert_close(slope, central, rtol=1e-4, atol=1e-6)


# --- failures and bad input


def _recorded(end: float, **options):
    """Runs of one program: all steps kept, a meter shown, and not many steps allowed."""
    given = {"start": [[1.4], [0.0]], "dense": True, "progress": True, "most_steps": 300}
    return _run(_oscillator(), end=end, rtol=1e-8, **given, **options)


@pytest.mark.slow
def test_dense_output_and_progress_meter(capsys):
    found = _recorded(12.0)
    assert "100.00%" in capsys.readouterr().err
    between = found.at(jnp.asarray([0.0, 3.21, 11.99, 12.1]))
    expected = 1.0 + 0.4 * np.cos(np.asarray(between.times[:3]))
    assert_close(between.load[:3, 0], expected, rtol=0.0, atol=1e-6)
    assert jnp.isnan(between.load[3, 0])
    with pytest.raises(ValueError, match="dense=True"):
        dataclasses.replace(found, dense=None).at(jnp.asarray([1.0]))


@pytest.mark.slow
def test_too_few_steps_say_where_and_what_to_do():
    few = lambda **options: _run(_oscillator(), start=[[1.4], [0.0]], most_steps=300, **options)
    with pytest.raises(TransientError, match=r"stopped at \d.* after `most_steps` = 300 steps"):
        few(end=1e3)
    found = few(end=1e3, throw=False)
    assert not bool(found.complete)
    assert 10.0 < float(found.reached) < 1e3
    known = np.isfinite(np.asarray(found.place[:, 0]))
    assert (known == (np.asarray(found.times) <= float(found.reached))).all()


@pytest.mark.parametrize("derivative", quick(1, [jax.jacfwd, jax.jacrev]))
def test_what_was_not_reached_has_no_derivative(derivative):
    """Though it is a constant to the integrator; what was reached keeps its own."""
    known, ends = jnp.asarray([True, False]), jnp.asarray([[[2.0], [3.0]], [[0.0], [0.0]]])
    of = lambda factor: reached_only(factor * ends, known, {"depth": factor, "kept": 3})
    one = jnp.asarray(1.0)
    for found in (of(one), derivative(of)(one)):
        np.testing.assert_array_equal(found[0, :, 0], [2.0, 3.0])
        assert np.isnan(found[1]).all()


def test_forces_that_are_no_numbers_are_told():
    system = _oscillator()
    table = dataclasses.replace(system.table, gap=system.table.gap.at[:, 8:].set(jnp.nan))
    with pytest.raises(TransientError, match=r"stopped at 3\.1\d* s.*not numbers"):
        _run(dataclasses.replace(system, table=table))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed": -1.0}, "must not be negative, got -1 rad/s"),
        ({"ratio": torque_step, "says": (1.0, -1.0, 5.0)}, "part for good"),
        ({"start": [[1.0, 2.0], [0.0, 0.0]]}, "1 degrees of freedom"),
        ({"end": 0.0}, "must rise"),
        ({"solver": "rk4"}, "a solver of diffrax, got 'rk4'"),
        ({"most_steps": 0}, "must be positive"),
        ({"below": -2.0}, "must be positive, got -2 rad/s"),
    ],
)
def test_bad_input_is_refused(change, message):
    if "says" in change:
        change = {"ratio": change["ratio"](*change["says"])}
    with pytest.raises(ValueError, match=message):
        _run(_oscillator(), **change)


def test_bad_profiles_are_refused():
    with pytest.raises(ValueError, match="must not go back"):
        Schedule([0.0, 2.0, 1.0], [1.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="one value for each of two knots"):
        Schedule([0.0, 2.0], [1.0, 1.0, 1.0])
