"""One mass on a contact: the tables of B5 by every method, closed forms, orders, other codes."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import reference
from dynamics.cases import (
    ON_THEIR_OWN,
    as_bodies,
    as_cells,
    sdof_backlash,
    sdof_driven,
    sdof_parametric,
    sdof_rectangular,
    torsional_pair,
    two_dof,
)
from helpers import assert_close, observed_order, quick

from jaxgear._dynamics._floquet import floquet_multipliers, monodromy
from jaxgear._dynamics._harmonic import HarmonicBalance, harmonic_balance_problem
from jaxgear._dynamics._march import TimeStepping, quasi_static_start, time_history
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steppers import (
    Exponential,
    GeneralizedAlpha,
    HilberHughesTaylor,
    Midpoint,
    Newmark,
)
from jaxgear._dynamics._system import modal_basis

# The softening oscillator: RMS about the mean, largest, least; and cycles after which it repeats.
UP = {
    0.50: (0.52226, 1.98539, 0.14628, 1),
    0.70: (0.43500, 1.61480, 0.38629, 1),
    0.75: (0.51180, 1.74754, 0.30105, 1),
    0.85: (1.55067, 2.82339, -1.55553, 1),
    1.20: (0.42880, 1.53736, 0.32461, 1),
    1.50: (0.16310, 1.20061, 0.73931, 1),
    2.00: (0.99289, 2.42641, -0.39836, 2),
    2.30: (0.04888, 1.05928, 0.92104, 1),
}
DOWN = {0.75: (2.06952, 3.40656, -2.45721, 1), 1.50: (2.15875, 3.46206, -2.71696, 2)}
# B5 (b): RMS about the mean, of the sweep up; down it jumps between 0.75 and 0.70.
SHAKEN = {0.50: 0.01176, 0.70: 0.03365, 1.00: 0.13308}

ALL_SPEEDS = (
    *(0.5, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2),
    *(1.5, 1.8, 1.9, 2.0, 2.1, 2.3),
)
STEPS = 200
HARMONICS = 20


class Row(NamedTuple):
    """A response that is known, and a motion on it from which methods may start."""

    speed: float
    multiple: int
    known: tuple[float, ...]
    start: tuple[float, float]
    path: np.ndarray


@functools.cache
def _table() -> list[Row]:
    """All rows of B5 (a), each on its branch."""
    oscillator, rows = reference.parametric(), []
    for table, speeds in ((UP, ALL_SPEEDS), (DOWN, ALL_SPEEDS[::-1])):
        swept = reference.sweep(oscillator, speeds, steps=STEPS)
        for speed, (*known, multiple) in table.items():
            path = swept[speed].path[-multiple * STEPS :]
            rows.append(Row(speed, multiple, tuple(known), swept[speed].start, path))
    return rows


@functools.cache
def _shaken() -> list[Row]:
    """B5 (b), its values and both branches between the jumps."""
    speeds, rows = (0.5, 0.7, 0.75, 0.8, 0.85, 1.0), []
    for direction in (1, -1):
        swept = reference.sweep(reference.backlash(), speeds[::direction], (1.1, 0.0), steps=STEPS)
        for speed in (*SHAKEN, 0.75, 0.8):
            settled = swept[speed]
            known = SHAKEN.get(speed, settled.statistics.rms)
            rows.append(Row(speed, 1, (known,), settled.start, settled.path[-STEPS:]))
    return rows


def _differences(place: jax.Array, row: Row) -> np.ndarray:
    """Of a response from what is known, over the RMS: the least value may pass through zero."""
    found = np.array(reference.statistics(np.asarray(place)))[: len(row.known)]
    return np.abs(found - row.known) / row.known[0]


def _terms(path: np.ndarray, count: int) -> np.ndarray:
    """Mean, cosines and sines of equally spaced samples."""
    lines = np.fft.rfft(path)[: count + 1] / len(path)
    return np.concatenate([[lines[0].real], 2.0 * lines[1:].real, -2.0 * lines[1:].imag])


def _column(rows: list[Row], name: str) -> jax.Array:
    return jnp.asarray([getattr(row, name) for row in rows])


def _one_after_the_other(function):
    """Map over leading axes of at most ten lanes; ten always, so that it is compiled once."""
    run = jax.jit(lambda *columns: jax.lax.map(lambda lane: function(*lane), columns))

    def padded(*columns: jax.Array):
        count = columns[0].shape[0]
        chosen = jnp.minimum(jnp.arange(10), count - 1)
        found = run(*(column[chosen] for column in columns))
        return jax.tree.map(lambda x: np.asarray(x)[:count], found)

    return padded


# --- harmonic balance


@functools.cache
def _balance(multiple: int, averaged: bool = False):
    """Harmonic balance of B5 (a), from harmonics at each of many speeds."""
    method = HarmonicBalance(harmonics=HARMONICS, multiple=multiple, averaged=averaged)
    # Overlaps that are straight between the ends of a step cost twice the steps.
    system = sdof_parametric(steps=2 * STEPS if averaged else STEPS)

    def at(speed, near):
        return method.solve(harmonic_balance_problem(method, system), speed, near)[0]

    return _one_after_the_other(at)


def _near(rows: list[Row], multiple: int) -> jax.Array:
    paths = [np.tile(row.path, multiple // row.multiple) for row in rows]
    return jnp.asarray([_terms(path, HARMONICS * multiple)[None] for path in paths])


# `test_sweep.py` holds the same table by all three methods, from one speed to the next.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("multiple", "averaged"),
    [(1, False), (2, False), (2, True)],
    ids=["one cycle", "two cycles", "averaged"],
)
def test_harmonic_balance_holds_the_table_of_b5(multiple, averaged):
    rows = [row for row in _table() if multiple % row.multiple == 0]
    orbits = _balance(multiple, averaged)(_column(rows, "speed"), _near(rows, multiple))
    assert bool(jnp.all(orbits.settled))
    assert float(jnp.max(orbits.residual)) < 1e-9
    for place, row in zip(orbits.place, rows, strict=True):
        assert np.max(_differences(place[:, 0], row)) < 1e-3, row


@pytest.mark.slow
def test_harmonic_balance_from_the_quasi_static_state_finds_one_of_the_orbits():
    speeds = jnp.asarray([0.5, 0.75, 2.0])
    stiffness = np.asarray(sdof_parametric(steps=STEPS).table.stiffness[:, 0])
    # Sampled at mid-steps, half a step after the first of the terms' own instants.
    lines = np.fft.rfft(1.0 / stiffness)[: HARMONICS + 1] / STEPS
    lines = lines * np.exp(-1.0j * np.pi / STEPS * np.arange(HARMONICS + 1))
    terms = np.concatenate([[lines[0].real], 2.0 * lines[1:].real, -2.0 * lines[1:].imag])
    near = jnp.tile(jnp.asarray(terms)[None, None, :], (3, 1, 1))
    orbits = _balance(1)(speeds, near)
    assert bool(jnp.all(orbits.settled))
    for speed, place in zip(speeds.tolist(), orbits.place, strict=True):
        known = reference.catalogue(
            reference.parametric(), speed, multiples=(1,), across=5, settling=20, steps=STEPS
        )
        rows = [Row(speed, 1, motion.statistics, motion.start, motion.position) for motion in known]
        assert min(np.max(_differences(place[:, 0], row)) for row in rows) < 1e-3, speed


@pytest.mark.slow
def test_harmonic_balance_of_one_period_returns_the_unstable_orbit_where_period_doubles():
    (known,) = reference.catalogue(
        reference.parametric(), 2.0, multiples=(1,), across=5, settling=10, steps=STEPS
    )
    assert not known.stable
    row = Row(2.0, 1, known.statistics, known.start, np.roll(known.position, 5))
    orbit = _balance(1)(jnp.asarray([2.0]), _near([row], 1))
    assert bool(orbit.settled[0])
    assert np.max(_differences(orbit.place[0, :, 0], row)) < 1e-3


@functools.cache
def _backlash_system(speeds: tuple[float, ...]):
    systems = [sdof_backlash(speed, steps=STEPS) for speed in speeds]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *systems)


def test_harmonic_balance_holds_the_values_of_b5_with_backlash():
    method = HarmonicBalance(harmonics=HARMONICS)
    rows = _shaken()

    @jax.jit
    def run(systems, speeds, near):
        def at(given):
            system, speed, near = given
            return method.solve(harmonic_balance_problem(method, system), speed, near)[0]

        return jax.lax.map(at, (systems, speeds, near))

    systems = _backlash_system(tuple(row.speed for row in rows))
    signs = jnp.asarray([1.0, -1.0, 1.0])
    near = _near(rows, 1) * signs[None, :, None]
    orbits = run(systems, _column(rows, "speed"), near)
    assert bool(jnp.all(orbits.settled))
    for orbit, row in zip(orbits.place, rows, strict=True):
        assert _differences(orbit[:, 0], row)[0] < 1e-3, row
        assert_close(orbit[:, 1], -orbit[:, 0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("speed", [0.31, 1.0, 3.7])
def test_harmonic_balance_is_the_closed_form_while_contact_is_closed(speed):
    """A gap that moves by five harmonics excites; stiffness is constant, nothing opens."""
    system = sdof_driven(steps=64)
    method = HarmonicBalance(harmonics=8)
    orbit = eqx.filter_jit(method.orbit)(system, jnp.asarray(speed))
    phase = np.asarray(system.table.middles)
    order = np.arange(1, 6)
    # x'' + 2 zeta x' + (x - delta) = F.
    gap = np.fft.rfft(np.asarray(system.table.gap[1, :, 0]))[1:6] / len(phase)
    gap = 2.0 * gap * np.exp(-2.0j * np.pi * order * phase[0])
    lines = reference.linear_response(0.05, 1.0, gap, order * speed)
    expected = 10.0 + np.real(np.exp(2.0j * np.pi * phase[:, None] * order) @ lines)
    assert_close(orbit.place[:, 0], expected, rtol=1e-12, atol=0.0)


@pytest.mark.slow
def test_two_coordinates_without_contact_loss_are_the_closed_form():
    system = two_dof(steps=64, ripple=0.0, load=20.0)
    speed, phase = 0.9, np.asarray(system.table.middles)
    orbit = eqx.filter_jit(HarmonicBalance(harmonics=8).orbit)(system, jnp.asarray(speed))
    bodies, cells = as_bodies(system), as_cells(system)
    rows, stiffness = cells.arms[1, 0], cells.stiffness[0]
    assert np.ptp(cells.stiffness, axis=0).max() < 1e-14
    whole = bodies.stiffness + (rows.T * stiffness) @ rows
    gap = (cells.gap[1] * stiffness) @ rows
    lines = np.fft.rfft(gap + bodies.load, axis=0) / len(phase)
    motion = np.zeros((len(phase), 2))
    for h in range(len(phase) // 2):
        s = 1.0j * h * speed
        answer = np.linalg.solve(s**2 * bodies.mass + s * bodies.damping + whole, lines[h])
        turn = np.exp(2.0j * np.pi * h * (phase - phase[0]))
        motion += (1.0 if h == 0 else 2.0) * np.real(turn[:, None] * answer)
    assert_close(orbit.motion, motion, rtol=1e-10, atol=1e-10)


# --- marching

SAME = {
    "jumping stiffness": (lambda: sdof_rectangular(steps=60), 0.8),
    "two coordinates": (lambda: two_dof(steps=60), 0.9),
    "backlash": (lambda: sdof_backlash(0.85, steps=60), 0.85),
    "gear pair": (lambda: torsional_pair(compliance=ON_THEIR_OWN).system, 1000.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", quick(1, SAME))
def test_newmark_marches_as_the_judge_does(case):
    """Modes and few mesh coordinates here, all freedoms and the thesis's two loops there."""
    build, speed = SAME[case]
    system = build()

    @eqx.filter_jit
    def run(system, speed):
        start = quasi_static_start(system)
        return time_history(system, speed, start, cycles=6, keep=6, stepper=Newmark())

    history = run(system, jnp.asarray(speed))
    begin = np.asarray(history.start[0]), np.asarray(history.start[1])
    frequency = system.teeth * speed
    record = reference.newmark(as_bodies(system), as_cells(system), frequency, begin, cycles=6)
    assert bool(history.converged)
    force = record.force[:, 1, 0]
    assert np.min(np.abs(force)) == 0.0 or case == "two coordinates"
    for found, known in (
        (history.motion, record.motion[:, 1]),
        (history.velocity, record.velocity[:, 1]),
        (history.load, record.force[:, 1]),
    ):
        scale = np.max(np.abs(known))
        assert_close(found / scale, known / scale, rtol=0.0, atol=1e-10)


STEPPERS = {
    "midpoint": Midpoint(),
    "Newmark": Newmark(),
    "generalised alpha": GeneralizedAlpha(0.8),
    "HHT": HilberHughesTaylor(-0.05),
    "exponential": Exponential(),
}


@pytest.mark.parametrize("name", quick(1, STEPPERS))
def test_steppers_are_of_second_order(name):
    """Four periods of the closed contact in 160, 320 and 640 steps."""
    stepper, speed, waves = STEPPERS[name], 1.2, (4, 2, 1)
    systems = [sdof_parametric(ripple=0.2, steps=160, waves=count) for count in waves]
    systems = jax.tree.map(lambda *leaves: jnp.stack(leaves), *systems)

    @jax.jit
    @jax.vmap
    def run(system, slow):
        start = jnp.asarray([[1.0], [0.0]])
        return time_history(system, slow, start, cycles=4, keep=4, stepper=stepper)

    history = run(systems, speed / jnp.asarray(waves, dtype=float))
    oscillator = reference.parametric(ripple=0.2)
    path, known = reference.march(oscillator, speed, (1.0, 0.0), periods=4, steps=800)
    assert np.min(path) > 0.0
    errors = []
    for lane, count in enumerate(waves):
        last = 160 * 4 // count - 1
        found = history.motion[lane, last, 0], history.velocity[lane, last, 0]
        errors.append(float(np.hypot(*np.subtract(found, known))))
    order = observed_order(np.array(waves, dtype=float), errors)
    assert 1.95 < order < 2.05, (order, errors)


@pytest.mark.slow
@pytest.mark.parametrize("name", quick(1, ["Newmark", "midpoint"]))
def test_marching_stays_on_the_branches_of_b5(name):
    rows = _table()
    system = sdof_parametric(steps=2 * STEPS)
    method = TimeStepping(stepper=STEPPERS[name], cycles=240, multiple=2)
    starts = jnp.asarray([row.start for row in rows])[:, :, None]
    run = jax.jit(jax.vmap(lambda speed, start: method.orbit(system, speed, start)))
    orbits = run(_column(rows, "speed"), starts + 0.02)
    assert bool(jnp.all(orbits.settled))
    for motion, row in zip(orbits.motion, rows, strict=True):
        assert np.max(_differences(motion[:, 0], row)) < 1e-3, row
        halves = motion[: 2 * STEPS, 0], motion[2 * STEPS :, 0]
        apart = float(jnp.max(jnp.abs(halves[0] - halves[1])))
        assert (apart > 0.1) == (row.multiple == 2), row


# --- shooting


@functools.cache
def _modes():
    return jax.jit(modal_basis)(sdof_parametric(steps=2 * STEPS))


@functools.cache
def _shoot(multiple: int, name: str):
    """Shooting at B5 (a), from motions at each of many speeds; multipliers as well."""
    method = Shooting(stepper=STEPPERS[name], multiple=multiple, warm_up=0)
    system = sdof_parametric(steps=2 * STEPS)
    modes = _modes()

    def at(speed, start):
        orbit = method.orbit(system, speed, start)
        return orbit, monodromy(system, modes, orbit, stepper=method.stepper)

    return _one_after_the_other(at)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("multiple", "name"), [(1, "exponential"), (2, "exponential"), (2, "midpoint")]
)
def test_shooting_holds_the_table_of_b5(multiple, name):
    rows = [row for row in _table() if multiple % row.multiple == 0]
    starts = jnp.asarray([row.start for row in rows])[:, :, None]
    # Not on the orbit itself: Newton has to find it.
    orbits, _ = _shoot(multiple, name)(_column(rows, "speed"), starts + 0.02)
    assert bool(jnp.all(orbits.settled))
    for orbit, row in zip(orbits.place, rows, strict=True):
        assert np.max(_differences(orbit[:, 0], row)) < 1e-3, row


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "multiple"), quick(1, [(2.0, 1), (0.75, 1), (1.5, 2)]))
def test_shooting_finds_unstable_orbits_and_their_multipliers(speed, multiple):
    oscillator = reference.parametric()
    found = reference.catalogue(
        oscillator, speed, multiples=(multiple,), across=7, settling=8, steps=STEPS
    )
    (coarse,) = [motion for motion in found if not motion.stable]
    unstable = reference.polished(oscillator, coarse)
    rows = [Row(speed, multiple, unstable.statistics, unstable.start, unstable.position)]
    starts = jnp.asarray([unstable.start])[:, :, None]
    orbits, matrices = _shoot(multiple, "exponential")(jnp.asarray([speed]), starts)
    assert bool(orbits.settled[0])
    assert np.max(_differences(orbits.place[0, :, 0], rows[0])) < 1e-3
    grown = floquet_multipliers(jnp.asarray(matrices), _modes())[0]
    assert np.max(np.abs(np.imag(grown))) == 0.0
    assert_close(np.real(grown), np.real(unstable.multipliers), rtol=2e-3, atol=0.0)


@pytest.mark.slow
def test_shooting_holds_the_values_of_b5_with_backlash():
    rows = _shaken()
    method = Shooting(warm_up=0)

    @jax.jit
    def run(systems, speeds, starts):
        return jax.lax.map(lambda given: method.orbit(*given), (systems, speeds, starts))

    starts = jnp.asarray([row.start for row in rows])[:, :, None] + 0.01
    systems = _backlash_system(tuple(row.speed for row in rows))
    orbits = run(systems, _column(rows, "speed"), starts)
    assert bool(jnp.all(orbits.settled))
    for orbit, row in zip(orbits.place, rows, strict=True):
        assert _differences(orbit[:, 0], row)[0] < 1e-3, row
