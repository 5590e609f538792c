"""Gauges on a condensed body at rest, against all of its coordinates in plain NumPy."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from fem_cases import STEEL
from helpers import assert_close, assert_gradient
from hybrid_cases import APART, PAIRS, ROUND, TEETH, Dense, Gear, body, heated, relieved

import jaxgear as jg
from jaxgear import um
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._response._dynamic import forces_in_motion
from jaxgear._response._gauges import (
    direction_rows,
    gauge_influences,
    gauge_readings,
    moving_gauge_readings,
    rest_readings,
)
from jaxgear._system._body_modes import body_basis
from jaxgear._system._body_tables import flexible_body

_SPEED = 900.0
_SPRINGS = np.array([[1e8, 1e8, 3e8, 1e5, 1e5, np.inf]])
_FREE = np.array([[np.inf] * 5 + [0.0]])


def _mesh(kind: str, periods: int = 1) -> tuple[jg.PairModel, jg.MeshGrid]:
    grid = jg.mesh_grid(PAIRS[kind](), phases=8, slices=3, periods=periods)
    flexible = flexible_body(body(kind), PAIRS[kind](), 1, grid)
    model = jg.PairModel(
        PAIRS[kind](),
        100.0,
        relieved(),
        wheel_support=ROUND,
        wheel_body=flexible,
        speed=_SPEED,
    )
    return model, grid


def _rows(kind: str, count: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Gauges that read anything."""
    draw = np.random.default_rng(3)
    return draw.normal(size=(count, body(kind).dofs)), draw.normal(size=count)


def _influences(model, grid, kind: str, rows, rotation):
    own = model.wheel_body
    return gauge_influences(
        body(kind), rows, rotation, model.pair, 1, grid, components=own.components
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["spur", "helical"])
def test_readings_are_those_of_the_whole_body(kind):
    model, grid = _mesh(kind, periods=2)
    rows, rotation = _rows(kind)
    cycle = jg.mesh_cycle(model, grid)
    gauges = _influences(model, grid, kind, rows, rotation)
    found, turn = eqx.filter_jit(gauge_readings)(gauges, model.pair, cycle, model.speed)
    assert found.shape == (8 * TEETH[1], 2)
    own, speed = body(kind), _SPEED * TEETH[0] / TEETH[1]
    dense = Dense(PAIRS[kind](), grid, [Gear(None, _FREE), Gear(own, _SPRINGS)], cycle.cells.lines)
    seat = slice(3 * len(own.rim_nodes), 3 * len(own.rim_nodes) + 6)
    inner = np.setdiff1d(np.arange(own.dofs), np.arange(seat.start, seat.stop))
    places = np.asarray(cycle.system.structure.map.loaded[1])[0] + np.arange(6)
    seats = np.asarray(cycle.system.displacement(cycle.load))[:, places]
    # A phase of each of two mesh periods: another tooth bears the load.
    for phase in (1, 8 + 6):
        angle = dense.turned(1, phase)
        assert np.cos(float(turn[phase]) - angle) == pytest.approx(1.0, abs=1e-12)
        c, s = np.cos(angle), np.sin(angle)
        back = np.kron(np.eye(2), [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        motion = np.zeros(own.dofs)
        motion[seat] = back @ seats[phase]
        load = -dense.rows(1, phase).T @ np.asarray(cycle.force)[phase]
        load += speed**2 * own.centrifugal_load
        right = load[inner] - own.stiffness[inner, seat] @ motion[seat]
        motion[inner] = np.linalg.solve(own.stiffness[np.ix_(inner, inner)], right)
        wanted = rows @ motion + speed**2 * rotation
        assert_close(np.asarray(found[phase]), wanted, rtol=1e-8, atol=0.0)
    # The cycle repeats while the body turns on: after a revolution it is where it was.
    steps = np.angle(np.exp(1j * np.diff(np.append(turn, turn[0]))))
    assert np.all(steps < 0.0)
    assert steps.sum() == pytest.approx(-2.0 * np.pi, rel=1e-9)


@pytest.mark.slow
def test_a_gauge_in_motion_reads_what_it_reads_at_rest_where_nothing_accelerates():
    """On few modes that do what any loads make them do at rest; what they do beyond that counts."""
    grid = jg.mesh_grid(PAIRS["helical"](), phases=8, slices=2, periods=1)
    own, heat = body("helical"), heated("helical")
    basis, strain = body_basis(own, 7), jnp.asarray([9e-4, 3e-4])
    flexible = flexible_body(own, PAIRS["helical"](), 1, grid, heat=heat.load, basis=basis)
    flexible = eqx.tree_at(lambda b: b.heat.strain, flexible, strain)
    model = jg.PairModel(
        PAIRS["helical"](), 60.0, relieved(), APART, wheel_support=ROUND, wheel_body=flexible
    )
    dynamics = eqx.filter_jit(lambda m: pair_dynamics(m, grid, mesh_coordinates=4))(model)
    cycle, modes = dynamics.cycle, flexible.modes
    assert modes is not None
    assert modes.heat is not None
    system, zero = dynamics.system, jnp.zeros(())
    pressing = jnp.asarray(np.random.default_rng(7).normal(size=system.rest.shape))
    at_rest = np.asarray(cycle.system.displacement(cycle.load))
    own_dofs = [list(dynamics.dofs).index(dof) for dof in dynamics.bodies[0].mode_dofs]
    loaded = np.asarray(system.load_at(zero)[None] - pressing @ system.vectors.T)[:, own_dofs]
    still = loaded / np.asarray(modes.square)
    motion = np.concatenate([at_rest, still], axis=1)[:, list(dynamics.dofs)]
    orbit = Orbit(
        speed=zero,
        place=system.rest,
        load=pressing,
        motion=jnp.asarray(motion),
        start=jnp.zeros((2, motion.shape[1])),
        residual=zero,
        settled=jnp.asarray(True),
        steps=zero,
    )
    rows, rotation = _rows("helical")
    beside = np.random.default_rng(5).normal(size=(2, 2))
    read = functools.partial(
        gauge_influences,
        own,
        rows,
        rotation,
        model.pair,
        1,
        grid,
        components=flexible.components,
        heat=(beside, heat.load),
    )
    found, turn = moving_gauge_readings(
        read(basis=basis), dynamics, orbit, jg.ExactContact(), strain
    )
    wanted, angle = eqx.filter_jit(gauge_readings)(read(), model.pair, cycle, zero, strain)
    assert_close(np.asarray(turn), np.asarray(angle), rtol=1e-12, atol=0.0)
    scale = float(jnp.abs(wanted).max())
    assert_close(np.asarray(found), np.asarray(wanted), rtol=1e-6, atol=1e-7 * scale)
    # Forces alone are read as they are without any motion and heat.
    held = eqx.tree_at(lambda g: (g.seats, g.heat), read(), replace_fn=jnp.zeros_like)
    held = eqx.tree_at(lambda g: g.modes, held, None, is_leaf=lambda x: x is None)
    force = forces_in_motion(dynamics, orbit, jg.ExactContact())
    for periods in (1, TEETH[1]):
        alone, _ = rest_readings(read(), dynamics, orbit, force, periods)
        wanted_alone, _ = eqx.filter_jit(gauge_readings)(held, model.pair, cycle, zero)
        assert_close(
            np.asarray(alone), np.asarray(wanted_alone)[: 8 * periods], rtol=1e-6, atol=1e-7 * scale
        )
    # Of a mode that does not turn what it does beyond is added as it is.
    unturned = int(np.flatnonzero(basis.waves == 0)[0])
    moved = eqx.tree_at(lambda o: o.motion, orbit, orbit.motion.at[:, own_dofs[unturned]].add(1e-9))
    more, _ = moving_gauge_readings(read(basis=basis), dynamics, moved, jg.ExactContact(), strain)
    added = np.broadcast_to(1e-9 * rows @ basis.shapes[:, unturned], more.shape)
    assert_close(np.asarray(more - found), added, rtol=1e-6, atol=1e-7 * np.abs(added).max())


@pytest.mark.slow
def test_readings_have_derivatives_by_flanks_torque_and_speed():
    model, grid = _mesh("spur")
    gauges = _influences(model, grid, "spur", *_rows("spur"))
    law = jg.SmoothContact(0.5 * um)

    def largest(moved: tuple) -> jnp.ndarray:
        flanks, torque, speed = moved
        own = eqx.tree_at(lambda m: (m.flanks, m.torque, m.speed), model, (flanks, torque, speed))
        cycle = jg.mesh_cycle(own, grid, law=law)
        found, _ = gauge_readings(gauges, own.pair, cycle, own.speed)
        return jnp.sum(found[:, 0] ** 2)

    moved = (model.flanks, model.torque, model.speed)
    assert_gradient(eqx.filter_jit(largest), moved, rtol=1e-5)


def test_strain_along_a_direction_by_hand():
    # Pull along x: Poisson's part of it across, nothing sheared.
    stress = np.array([[2.1e8, 0.0, 0.0, 0.0, 0.0, 0.0]] * 3)
    along = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0]])
    found = direction_rows(stress, along, STEEL.young, STEEL.poisson)
    strain = np.array([1e-3, -0.3e-3, (0.36 - 0.3 * 0.64) * 1e-3])
    np.testing.assert_allclose(found[:, 0], strain, rtol=1e-12)
    np.testing.assert_allclose(found[:, 1], [2.1e8, 0.0, 0.36 * 2.1e8], rtol=1e-12, atol=1e-6)
    with pytest.raises(ValueError, match="length one"):
        direction_rows(stress, 2.0 * along, STEEL.young, STEEL.poisson)
