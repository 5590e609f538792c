"""All of a condensed body in motion, against all of its coordinates in plain NumPy."""

import dataclasses
import functools
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy
from helpers import assert_close
from hybrid_cases import APART, PAIRS, ROUND, TEETH, Dense, Gear, body, relieved

import jaxgear as jg
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._geometry._lines import contact_lines
from jaxgear._response._body_motion import rotating_spectrum, start_angle
from jaxgear._response._gauges import gauge_influences, rest_readings
from jaxgear._response._spectrum import joined_spectra, spectrum_of_steps
from jaxgear._response._whole_motion import whole_motion, whole_rows
from jaxgear._system._body_modes import BodyBasis, body_basis
from jaxgear._system._body_tables import flexible_body
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import mode_arms, mode_loads
from jaxgear._system._held_body import held_answers

_PHASES = 8
_SPRINGS = np.array([[1e8, 1e8, 3e8, 1e5, 1e5, np.inf]])
_FREE = np.array([[np.inf] * 5 + [0.0]])
# About one and two orders of the teeth: backward and forward waves.
ORDERS = np.r_[TEETH[1] - 4 : TEETH[1] + 5, 2 * TEETH[1] - 2 : 2 * TEETH[1] + 3]
# None: that of the mesh acts on the modes too.
_DAMPING = jg.RayleighDamping(mass_factor=0.0, stiffness_factor=0.0)


class _Case(NamedTuple):
    """A wheel in motion, what is read of it, and forces on its teeth."""

    grid: jg.MeshGrid
    basis: BodyBasis
    flexible: FlexibleBody
    dynamics: jg.PairDynamics
    rows: np.ndarray
    force: np.ndarray


def _own():
    return body("helical", layers=1, rotating=True)


@functools.cache
def _case(count: int) -> _Case:
    """On so many natural modes; 0: on all."""
    pair, own = PAIRS["helical"](), _own()
    grid = jg.mesh_grid(pair, phases=_PHASES, slices=2, periods=1)
    sectors = own.facts["sectors"]
    assert isinstance(sectors, int)
    basis, _ = body_basis(own, count).under_teeth(TEETH[1], sectors)
    flexible = flexible_body(own, pair, 1, grid, basis=basis)
    model = jg.PairModel(pair, 60.0, relieved(), APART, wheel_support=ROUND, wheel_body=flexible)
    made = lambda m: pair_dynamics(m, grid, _DAMPING, gyroscopic=True, mesh_coordinates=4)
    dynamics = eqx.filter_jit(made)(model)
    draw = np.random.default_rng(4)
    rows = draw.normal(size=(2, own.dofs))
    rows[:, 3 * len(own.rim_nodes) :][:, :6] = 0.0
    force = 1e3 * draw.uniform(size=(_PHASES, dynamics.cycle.cells.lines.roll[0].size))
    return _Case(grid, basis, flexible, dynamics, rows, force)


def _orbit(case: _Case, speed: float) -> Orbit:
    """A response in which nothing moves yet: all loads are beside the mesh coordinates."""
    system, zero = case.dynamics.system, jnp.zeros(())
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


def _read(case: _Case, speed: float) -> np.ndarray:
    """What is read of the wheel at some orders."""
    pair, dynamics = PAIRS["helical"](), case.dynamics
    own, orbit, force = _own(), _orbit(case, speed), jnp.asarray(case.force)
    load = mode_loads(pair, 1, case.flexible, dynamics.cycle.cells.lines, force)
    turned = start_angle(pair, 1)
    motion = whole_motion(dynamics, orbit, 1, np.asarray(load), 3, angle=turned, rotating=True)
    answers, seen = held_answers(own, case.rows), case.basis.motions
    shown = whole_rows(own, case.basis, seen, case.rows, answers, rotating=True)
    parts = case.flexible.components
    gauges = gauge_influences(own, case.rows, np.zeros(2), pair, 1, case.grid, components=parts)
    readings, _ = rest_readings(gauges, dynamics, orbit, force, TEETH[1])
    still = spectrum_of_steps(np.asarray(readings), _lengths(case), TEETH[1])
    whole = joined_spectra(rotating_spectrum(motion, shown), still)
    return np.array([whole.near(order) for order in ORDERS])


def _lengths(case: _Case) -> np.ndarray:
    return np.asarray(case.dynamics.system.table.lengths)


@functools.cache
def _rows_of_cells() -> np.ndarray:
    """Overlap of cells per coordinate of the turning body, `[phase, cell, dof]`."""
    pair = PAIRS["helical"]()
    grid = jg.mesh_grid(pair, phases=_PHASES, slices=2, periods=TEETH[1])
    gears = [Gear(None, _FREE), Gear(_own(), _SPRINGS)]
    dense = Dense(pair, grid, gears, contact_lines(pair, grid))
    return np.stack([dense.rows(1, phase) for phase in range(_PHASES * TEETH[1])])


def _dense(case: _Case, speed: float) -> np.ndarray:
    """The same of all coordinates of the body, with its seats held."""
    own, turning = _own(), -speed * TEETH[0] / TEETH[1]
    force = np.tile(case.force, (TEETH[1], 1))
    pressed = -np.einsum("pc,pcd->pd", force, _rows_of_cells())
    load = spectrum_of_steps(pressed, _lengths(case), TEETH[1])
    first = 3 * len(own.rim_nodes)
    inner = np.setdiff1d(np.arange(own.dofs), np.arange(first, first + 6))
    at = np.ix_(inner, inner)
    assert own.coriolis is not None
    assert own.stress_stiffening is not None
    assert own.spin_softening is not None
    softening = (own.stress_stiffening - own.spin_softening)[at]
    found = []
    for order in ORDERS:
        s = 1j * order * abs(turning)
        matrix = own.stiffness[at] + turning**2 * softening
        matrix = matrix + s * turning * own.coriolis[at] + s**2 * own.mass[at]
        answer = np.linalg.solve(matrix, load.near(order)[inner])
        found.append(case.rows[:, inner] @ answer)
    return np.array(found)


@pytest.mark.parametrize("speed", [100.0, 1500.0, 4000.0])
def test_on_all_modes_it_is_the_motion_of_all_coordinates(speed):
    case = _case(0)
    wanted = _dense(case, speed)
    assert_close(_read(case, speed), wanted, rtol=1e-6, atol=1e-7 * np.abs(wanted).max())


def test_what_few_modes_leave_out_falls_with_the_square_of_the_speed():
    case, off = _case(7), []
    for speed in (150.0, 300.0, 600.0):
        wanted = _dense(case, speed)
        off.append(np.linalg.norm(_read(case, speed) - wanted) / np.linalg.norm(wanted))
    assert off[1] < 1e-3
    assert off[0] / off[1] == pytest.approx(0.25, rel=0.1)
    assert off[1] / off[2] == pytest.approx(0.25, rel=0.2)


@pytest.mark.parametrize("rotating", [True, False])
def test_inertia_is_that_of_the_motion_on_the_body(rotating):
    """Against differences of a motion that is turned back by a matrix."""
    case, speed, own = _case(12), 900.0, _own()
    pair, turning = PAIRS["helical"](), speed * TEETH[0] / TEETH[1]
    place, system = case.dynamics.bodies[0], case.dynamics.system
    moved = np.r_[list(place.seats), place.mode_dofs]
    swing = np.zeros((2, system.mass.shape[0]))
    swing[:, np.isin(case.dynamics.dofs, moved)] = np.random.default_rng(9).normal(
        size=(2, np.isin(case.dynamics.dofs, moved).sum())
    )
    lengths = _lengths(case)
    middles = 2.0 * np.pi * (np.cumsum(lengths) - 0.5 * lengths)
    waves = np.stack([np.cos(middles), np.sin(middles)], axis=1)
    orbit = dataclasses.replace(_orbit(case, speed), motion=jnp.asarray(waves @ swing))
    none, begin = np.zeros((_PHASES, case.basis.square.size)), start_angle(pair, 1)
    motion = whole_motion(case.dynamics, orbit, 1, none, 3, angle=begin, rotating=rotating)
    answers, basis = held_answers(own, case.rows), case.basis
    shown = whole_rows(own, basis, basis.motions, case.rows, answers, rotating=rotating)
    # Of inertia alone.
    shown[:, : basis.motions.shape[1]] = 0.0
    found = rotating_spectrum(motion, shown)

    whole = np.zeros((2, max(case.dynamics.dofs) + 1))
    whole[:, list(case.dynamics.dofs)] = swing
    one, other = whole[:, moved]
    slow = np.r_[np.zeros(6), basis.diameters] < 2

    def on_body(angle: float) -> tuple[np.ndarray, np.ndarray]:
        """Motion where the wheel has turned so far: what turns with it, and what stands still."""
        tooth = TEETH[1] * angle
        in_space = np.cos(tooth) * one + np.sin(tooth) * other
        # It turns about -Z.
        back = scipy.linalg.expm(-(begin - angle) * basis.turning)
        if rotating:
            return back @ in_space, np.zeros_like(in_space)
        return back @ np.where(slow, 0.0, in_space), back @ np.where(slow, in_space, 0.0)

    step, at = 1e-4, 0.37
    before, now, after = (on_body(at + i * step)[0] for i in (-1, 0, 1))
    faster = (before - 2.0 * now + after) * (turning / step) ** 2
    faster -= (TEETH[1] * turning) ** 2 * on_body(at)[1]
    fast, now = (after - before) * turning / (2.0 * step), now + on_body(at)[1]
    inertia = -own.mass @ basis.motions @ faster
    if rotating:
        assert own.coriolis is not None
        assert own.stress_stiffening is not None
        assert own.spin_softening is not None
        inertia += turning * own.coriolis @ basis.motions @ fast
        softening = own.stress_stiffening - own.spin_softening
        inertia -= turning**2 * softening @ basis.motions @ now
    left = answers - ((case.rows @ basis.shapes) / basis.square) @ basis.shapes.T
    wanted = left @ inertia
    assert_close(found.at(np.array([at]))[0], wanted, rtol=1e-5, atol=0.0)


def test_loads_on_modes_are_those_of_the_arms():
    case = _case(12)
    pair, lines = PAIRS["helical"](), case.dynamics.cycle.cells.lines
    arms = mode_arms(pair, 1, case.flexible, lines)
    wanted = -np.einsum("pcm,pc->pm", np.asarray(arms), case.force)
    once = mode_loads(pair, 1, case.flexible, lines, jnp.asarray(case.force))
    twice = mode_loads(pair, 1, case.flexible, lines, jnp.asarray(np.tile(case.force, (2, 1))))
    assert_close(np.asarray(once), wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
    assert_close(np.asarray(twice), np.tile(wanted, (2, 1)), rtol=1e-12, atol=1e-20)
