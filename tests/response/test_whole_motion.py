"""All of a condensed body in motion, against all of its coordinates in plain NumPy."""

import dataclasses
import functools
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close
from hybrid_cases import APART, PAIRS, ROUND, TEETH, Dense, Gear, body, relieved

import jaxgear as jg
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._geometry._lines import contact_lines
from jaxgear._response._body_motion import body_motion, rotating_spectrum, start_angle
from jaxgear._response._gauges import GaugeInfluences, gauge_influences, rest_readings
from jaxgear._response._left_out import approach_by_modes
from jaxgear._response._spectrum import fitted_harmonics, joined_spectra, spectrum_of_steps
from jaxgear._response._whole_motion import (
    WholeBody,
    WholeModes,
    by_inertia,
    loads_on_seats,
    whole_modes,
)
from jaxgear._system._body_modes import BodyBasis, body_basis
from jaxgear._system._body_tables import body_in_mesh, flexible_body
from jaxgear._system._excited_shapes import excited_shapes
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import mode_arms, mode_loads

_PHASES = 8
_SPRINGS = np.array([[1e8, 1e8, 3e8, 1e5, 1e5, np.inf]])
_FREE = np.array([[np.inf] * 5 + [0.0]])
# About one and two orders of the teeth: backward and forward waves.
ORDERS = np.r_[TEETH[1] - 4 : TEETH[1] + 5, 2 * TEETH[1] - 2 : 2 * TEETH[1] + 3]
# None: that of the mesh acts on the modes too.
_DAMPING = jg.RayleighDamping(mass_factor=0.0, stiffness_factor=0.0)


class _Case(NamedTuple):
    """A wheel in motion, what is read of it, and forces on its teeth."""

    basis: BodyBasis
    body: WholeBody
    dynamics: jg.PairDynamics
    gauges: GaugeInfluences
    force: jnp.ndarray


def _own():
    return body("helical", layers=1, rotating=True)


def _sectors() -> int:
    sectors = _own().facts["sectors"]
    assert isinstance(sectors, int)
    return sectors


@functools.cache
def _rows() -> np.ndarray:
    """What is read of the wheel: its seat does not count."""
    rows = np.random.default_rng(4).normal(size=(2, _own().dofs))
    rows[:, _seat()] = 0.0
    return rows


def _seat() -> np.ndarray:
    return 3 * len(_own().rim_nodes) + np.arange(6)


@functools.cache
def _basis(count: int) -> BodyBasis:
    """So many natural modes; 0: all."""
    return body_basis(_own(), count).under_teeth(TEETH[1], _sectors())[0]


def _dynamics(flexible: FlexibleBody, damping=_DAMPING, *, rotating: bool = True):
    model = jg.PairModel(
        PAIRS["helical"](), 60.0, relieved(), APART, wheel_support=ROUND, wheel_body=flexible
    )
    grid = _grid()
    made = lambda m: pair_dynamics(m, grid, damping, gyroscopic=rotating, mesh_coordinates=4)
    return eqx.filter_jit(made)(model)


def _grid():
    return jg.mesh_grid(PAIRS["helical"](), phases=_PHASES, slices=2, periods=1)


@functools.cache
def _case(count: int) -> _Case:
    """On so many natural modes; 0: on all."""
    pair, own, basis = PAIRS["helical"](), _own(), _basis(count)
    flexible = flexible_body(own, pair, 1, _grid(), basis=basis)
    dynamics = _dynamics(flexible)
    gauges = gauge_influences(
        own, _rows(), np.zeros(2), pair, 1, _grid(), components=flexible.components
    )
    cells = dynamics.cycle.cells.lines.roll[0].size
    force = jnp.asarray(1e3 * np.random.default_rng(7).uniform(size=(_PHASES, cells)))
    return _Case(basis, _whole(flexible), dynamics, gauges, force)


def _whole(flexible: FlexibleBody, damping=_DAMPING, *, rotating: bool = True) -> WholeBody:
    """A body whose shapes are natural modes."""
    assert flexible.modes is not None
    return WholeBody(flexible, None, np.asarray(flexible.modes.waves), damping, rotating)


def _orbit(dynamics: jg.PairDynamics, speed: float) -> Orbit:
    """A response in which nothing moves yet: all loads are beside the mesh coordinates."""
    system, zero = dynamics.system, jnp.zeros(())
    return Orbit(
        speed=jnp.asarray(speed),
        place=system.rest,
        load=jnp.zeros_like(system.rest),
        motion=jnp.zeros((_PHASES, system.mass.shape[0])),
        start=jnp.zeros((2, system.mass.shape[0])),
        residual=zero,
        settled=jnp.asarray(True),
        steps=zero,
    )


def _read(case: _Case, dynamics: jg.PairDynamics, orbit: Orbit) -> np.ndarray:
    """What is read of the wheel at some orders."""
    turned = start_angle(PAIRS["helical"](), 1)
    motion = whole_modes(case.body, dynamics, orbit, 1, case.force, 3, angle=turned).beyond
    readings, _ = rest_readings(case.gauges, dynamics, orbit, case.force, TEETH[1])
    still = spectrum_of_steps(np.asarray(readings), _lengths(dynamics), TEETH[1])
    whole = joined_spectra(rotating_spectrum(motion, _rows() @ case.basis.motions), still)
    return np.array([whole.near(order) for order in ORDERS])


def _lengths(dynamics: jg.PairDynamics) -> np.ndarray:
    return np.asarray(dynamics.system.table.lengths)


@pytest.fixture(scope="module", autouse=True)
def built():
    """What most tests share, which takes longer than any of them."""
    return _case(0), _shaped(), _rows_of_cells()


@functools.cache
def _rows_of_cells() -> np.ndarray:
    """Overlap of cells per coordinate of the turning body, `[phase, cell, dof]`."""
    pair = PAIRS["helical"]()
    grid = jg.mesh_grid(pair, phases=_PHASES, slices=2, periods=TEETH[1])
    gears = [Gear(None, _FREE), Gear(_own(), _SPRINGS)]
    dense = Dense(pair, grid, gears, contact_lines(pair, grid))
    return np.stack([dense.rows(1, phase) for phase in range(_PHASES * TEETH[1])])


def _dense(case: _Case, speed: float, seats: np.ndarray | None = None) -> np.ndarray:
    """The same of all coordinates of the body, with its seats held, or moving, `[order, 6]`."""
    own, turning, lengths = _own(), -speed * TEETH[0] / TEETH[1], _lengths(case.dynamics)
    force = np.tile(case.force, (TEETH[1], 1))
    pressed = -np.einsum("pc,pcd->pd", force, _rows_of_cells())
    load = spectrum_of_steps(pressed, lengths, TEETH[1])
    inner = np.setdiff1d(np.arange(own.dofs), _seat())
    assert own.coriolis is not None
    assert own.stress_stiffening is not None
    assert own.spin_softening is not None
    softening = own.stress_stiffening - own.spin_softening
    found = []
    for place, order in enumerate(ORDERS):
        s = 1j * order * abs(turning)
        matrix = own.stiffness + turning**2 * softening + s * turning * own.coriolis
        matrix = (matrix + s**2 * own.mass)[inner]
        given = load.near(order)[inner]
        if seats is not None:
            # Following the seats is no strain of the body, but rounding of its stiffness would be.
            matrix_seat = matrix @ case.basis.following
            answer = np.linalg.solve(matrix[:, inner], given - matrix_seat @ seats[place])
            found.append(_rows() @ case.basis.following @ seats[place] + _rows()[:, inner] @ answer)
        else:
            found.append(_rows()[:, inner] @ np.linalg.solve(matrix[:, inner], given))
    return np.array(found)


@pytest.mark.parametrize("speed", [100.0, 1500.0, 4000.0])
def test_on_all_modes_it_is_the_motion_of_all_coordinates(speed):
    case = _case(0)
    wanted = _dense(case, speed)
    found = _read(case, case.dynamics, _orbit(case.dynamics, speed))
    assert_close(found, wanted, rtol=1e-6, atol=1e-7 * np.abs(wanted).max())


def test_what_few_modes_leave_out_falls_with_the_square_of_the_speed():
    case, off = _case(7), []
    for speed in (150.0, 300.0, 600.0):
        wanted = _dense(case, speed)
        found = _read(case, case.dynamics, _orbit(case.dynamics, speed))
        off.append(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))
    assert off[1] < 1e-3
    assert off[0] / off[1] == pytest.approx(0.25, rel=0.1)
    assert off[1] / off[2] == pytest.approx(0.25, rel=0.2)


# --- On combinations of modes, and with its seat in motion


@functools.cache
def _shaped() -> tuple[jg.PairDynamics, np.ndarray, np.ndarray]:
    """A wheel on few shapes and residual ones; all modes' combinations that they are, and waves."""
    pair, own, basis = PAIRS["helical"](), _own(), _basis(0)
    repeats = body_basis(own, 0).repeats(TEETH[1], _sectors())
    in_mesh = body_in_mesh(own, pair, 1, _grid(), repeats)
    found = excited_shapes(basis, in_mesh, pair, 1, _grid(), 12)
    assert found is not None
    shaped = found.of_body(in_mesh, basis)
    assert shaped.flexible.modes is not None
    assert shaped.flexible.modes.residual is not None
    assert_close(shaped.into, found.into[: len(shaped.made_of.square)], rtol=0.0, atol=0.0)
    assert np.all(found.into[len(shaped.made_of.square) :] == 0.0)
    return _dynamics(shaped.flexible), found.into, found.waves


def _own_dofs(dynamics: jg.PairDynamics) -> list[np.ndarray]:
    """Which of its degrees of freedom are the wheel's seat, its modes and its residual shapes."""
    (place,), dofs = dynamics.bodies, np.asarray(dynamics.dofs)
    each = list(place.seats), place.mode_dofs, place.residual_dofs
    return [np.flatnonzero(np.isin(dofs, some)) for some in each]


def _dynamic_stiffness(dynamics: jg.PairDynamics, speed: float, harmonic: int) -> np.ndarray:
    """Of the structure without mesh, damping and springs of no meaning, in space."""
    system, frequency = dynamics.system, harmonic * TEETH[0] * speed
    assert system.turning is not None
    assert system.gyroscopic is not None
    matrix = np.asarray(system.turning.stiffness_at(jnp.asarray(speed))).astype(complex)
    (place,) = dynamics.bodies
    own = _own_dofs(dynamics)
    alone = np.r_[own[1], own[2]]
    matrix[alone, alone] += np.r_[place.square, place.residual]
    matrix += 1j * frequency * speed * np.asarray(system.gyroscopic)
    return matrix - frequency**2 * np.asarray(system.mass)


def _in_time(dynamics: jg.PairDynamics, amplitudes: np.ndarray) -> np.ndarray:
    """What has such harmonics, from the zeroth, in the middles of the steps."""
    lengths = _lengths(dynamics)
    middles = 2.0 * np.pi * (np.cumsum(lengths) - 0.5 * lengths)
    waves = np.exp(1j * np.multiply.outer(middles, np.arange(len(amplitudes))))
    return np.real(waves @ amplitudes)


def _drawn(draw: np.random.Generator, size: int) -> np.ndarray:
    """Amplitudes of all harmonics."""
    found = draw.normal(size=(3, size)) + 1j * draw.normal(size=(3, size))
    found[0] = np.real(found[0])
    return found


@pytest.mark.parametrize("speed", [300.0, 2000.0])
def test_on_combinations_of_modes_it_is_the_motion_of_all_coordinates(speed):
    """However few, whatever their own load, and with residual shapes beside them."""
    case, draw = _case(0), np.random.default_rng(11)
    dynamics, into, waves = _shaped()
    case = case._replace(body=WholeBody(case.body.flexible, into, waves, _DAMPING, rotating=True))
    seat, modes, residual = _own_dofs(dynamics)
    load, vectors = _drawn(draw, 6), np.asarray(dynamics.system.vectors)[:, :6]
    load *= 1e3
    motion = np.zeros((3, len(dynamics.dofs)), dtype=complex)
    motion[:, seat] = 1e-6 * _drawn(draw, len(seat))
    motion[:, residual] = 1e-6 * _drawn(draw, len(residual))
    for harmonic in range(3):
        matrix = _dynamic_stiffness(dynamics, speed, harmonic)[modes]
        pushed = -vectors[modes] @ load[harmonic] - matrix @ motion[harmonic]
        motion[harmonic, modes] = np.linalg.solve(matrix[:, modes], pushed)
    orbit = _orbit(dynamics, speed)
    orbit = dataclasses.replace(
        orbit,
        motion=jnp.asarray(_in_time(dynamics, motion)),
        load=jnp.asarray(_in_time(dynamics, load)),
    )
    wanted = _dense(case, speed, _seats_on_body(dynamics, orbit))
    assert_close(_read(case, dynamics, orbit), wanted, rtol=1e-6, atol=1e-7 * np.abs(wanted).max())


def _seats_on_body(dynamics: jg.PairDynamics, orbit: Orbit) -> np.ndarray:
    """Motion of the seat as the body has it, at the orders, `[order, 6]`."""
    motion = body_motion(dynamics, orbit, 1)
    rows = np.eye(6, motion.amplitudes.shape[1])
    found = rotating_spectrum(motion, rows)
    return np.array([found.near(order) for order in ORDERS])


@pytest.mark.parametrize("rotating", [pytest.param(True, marks=pytest.mark.slow), False])
def test_modes_beside_the_shapes_move_as_those_of_the_structure_do(rotating):
    """With damping, and also where rigid motions do not turn with the body."""
    rate, speed, draw = 900.0, 1200.0, np.random.default_rng(3)
    damping = jg.RayleighDamping(mass_factor=rate, stiffness_factor=0.0)
    few, many = _case(12), _case(30)
    shapes = len(few.basis.square)
    into = np.eye(len(many.basis.square), shapes)
    flexible = many.body.flexible
    body = WholeBody(flexible, into, few.basis.waves, damping, rotating)
    dynamics = _dynamics(few.body.flexible, damping, rotating=rotating)
    seat, own, _ = _own_dofs(dynamics)
    motion = np.zeros((3, len(dynamics.dofs)), dtype=complex)
    motion[:, np.r_[seat, own]] = 1e-6 * _drawn(draw, len(seat) + len(own))
    orbit = _orbit(dynamics, speed)
    orbit = dataclasses.replace(orbit, motion=jnp.asarray(_in_time(dynamics, motion)))
    turned = start_angle(PAIRS["helical"](), 1)
    found = whole_modes(body, dynamics, orbit, 1, many.force, 3, angle=turned)
    found = found.modes - found.at_rest

    whole = _dynamics(flexible, damping, rotating=rotating)
    load = mode_loads(PAIRS["helical"](), 1, flexible, whole.cycle.cells.lines, many.force)
    pressed = fitted_harmonics(np.asarray(load), _lengths(whole), None)
    seat, modes, _ = _own_dofs(whole)
    for harmonic in range(3):
        matrix = _dynamic_stiffness(whole, speed, harmonic)[modes]
        matrix[:, modes] += 1j * rate * harmonic * TEETH[0] * speed * np.eye(len(modes))
        moved = motion[harmonic, np.r_[_own_dofs(dynamics)[0], own]]
        by_seat = matrix[:, seat] @ moved[: len(seat)]
        # Whatever moves the shapes does so here too.
        right = pressed[harmonic] - by_seat
        right[:shapes] += (matrix[:, modes[:shapes]] @ moved[len(seat) :] + by_seat)[:shapes]
        wanted = np.linalg.solve(matrix[:, modes], right) - pressed[harmonic] / many.basis.square
        assert_close(found[harmonic], wanted, rtol=1e-7, atol=1e-9 * np.abs(wanted).max())


def test_loads_on_modes_are_those_of_the_arms():
    case = _case(12)
    pair, lines = PAIRS["helical"](), case.dynamics.cycle.cells.lines
    arms = mode_arms(pair, 1, case.body.flexible, lines)
    wanted = -np.einsum("pcm,pc->pm", np.asarray(arms), case.force)
    once = mode_loads(pair, 1, case.body.flexible, lines, case.force)
    twice = mode_loads(pair, 1, case.body.flexible, lines, jnp.tile(case.force, (2, 1)))
    assert_close(np.asarray(once), wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
    assert_close(np.asarray(twice), np.tile(wanted, (2, 1)), rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize("rotating", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_modes_load_the_seats_as_those_of_the_structure_do(rotating):
    """By their inertia, wave by wave in coordinates that turn, and by the matrices in space."""
    case, speed, draw = _case(12), 1200.0, np.random.default_rng(9)
    dynamics = case.dynamics
    if not rotating:
        dynamics = _dynamics(case.body.flexible, rotating=False)
    body = _whole(case.body.flexible, rotating=rotating)
    seat, modes, _ = _own_dofs(dynamics)
    motion = np.zeros((3, len(dynamics.dofs)), dtype=complex)
    motion[:, modes] = 1e-6 * _drawn(draw, len(modes))
    orbit = _orbit(dynamics, speed)
    orbit = dataclasses.replace(orbit, motion=jnp.asarray(_in_time(dynamics, motion)))
    frequency = TEETH[0] * speed * np.arange(3)
    wanted = np.stack([_dynamic_stiffness(dynamics, speed, h)[seat] @ motion[h] for h in range(3)])
    found = by_inertia(dynamics, orbit, seat, modes, frequency)
    assert_close(found, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
    moved = body_motion(dynamics, orbit, 1, 2)
    assert moved.amplitudes.shape[1] == len(seat) + len(modes)
    whole = WholeModes(moved, np.zeros((3, len(modes))), frequency)
    assert_close(loads_on_seats(body, whole), wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_modes_bring_cells_closer_by_their_arms():
    case, modes = _case(12), np.random.default_rng(2).normal(size=(2 * _PHASES, 12))
    modes = jnp.asarray(modes[:, : len(case.basis.square)])
    pair, lines = PAIRS["helical"](), case.dynamics.cycle.cells.lines
    arms = np.asarray(mode_arms(pair, 1, case.body.flexible, lines))
    wanted = np.einsum("pcm,pm->pc", np.tile(arms, (2, 1, 1)), modes)
    found = approach_by_modes(pair, 1, case.body.flexible, lines, modes)
    assert_close(np.asarray(found), wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
