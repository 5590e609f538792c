"""Heat of condensed bodies in mesh, against growth by hand and all coordinates in plain NumPy."""

import dataclasses
import functools

import equinox as eqx
import hybrid_cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient
from hybrid_cases import APART, PAIRS, ROUND, Dense, Gear, relieved

import jaxgear as jg
from jaxgear import um
from jaxgear._contact._cells import mesh_gap
from jaxgear._dynamics._cell_forces import cell_forces
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._dynamics._table import MIDDLE, mesh_at
from jaxgear._response._gauges import gauge_influences, gauge_readings
from jaxgear._system._body_family import table_difference
from jaxgear._system._body_modes import body_basis
from jaxgear._system._body_tables import body_in_mesh, flexible_body
from jaxgear._system._excited_shapes import excited_shapes
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._foot_tables import foot_tables
from jaxgear._system._model import PairModel
from jaxgear._system._scaled_body import scaled_body

_SPRINGS = np.array([[1e8, 1e8, 3e8, 1e5, 1e5, np.inf]])
_FREE = np.array([[np.inf] * 5 + [0.0]])
# A hub 80 K above the rim's 30 K, of steel.
_STRAIN = 11.5e-6 * np.array([80.0, 30.0])


@functools.cache
def _grid(kind: str, phases: int = 8) -> jg.MeshGrid:
    return jg.mesh_grid(PAIRS[kind](), phases=phases, slices=2, periods=1)


@functools.cache
def _body(kind: str, index: int, seats: str = "bore", count: int | None = None) -> FlexibleBody:
    """A wheel or pinion that may warm, as cold as it is drawn."""
    own = hybrid_cases.body(kind, index, seats=seats)
    heat = hybrid_cases.heated(kind, index, seats=seats).load
    basis = None if count is None else body_basis(own, count)
    return flexible_body(own, PAIRS[kind](), index, _grid(kind), heat=heat, basis=basis)


def _warm(body: FlexibleBody, strain) -> FlexibleBody:
    return eqx.tree_at(lambda b: b.heat.strain, body, jnp.asarray(strain))


def _model(kind: str, torque: float = 100.0, **others) -> PairModel:
    return PairModel(PAIRS[kind](), torque, relieved(), APART, wheel_support=ROUND, **others)


_cycle = eqx.filter_jit(jg.mesh_cycle)
_in_motion = eqx.filter_jit(lambda model, grid: pair_dynamics(model, grid, mesh_coordinates=4))
_forces = jax.jit(jax.vmap(lambda mesh, place: cell_forces(mesh, place, jg.ExactContact())[0]))
every_kind = pytest.mark.parametrize(
    "kind", [pytest.param("spur", marks=pytest.mark.slow), "helical"]
)


@pytest.mark.slow
@every_kind
@pytest.mark.parametrize(("seats", "index"), [("mean", 1), ("bore", 0)])
def test_a_gear_as_warm_everywhere_grows_along_its_normals(kind, index, seats):
    """All points of it move by their place times the free strain, and so do its flanks."""
    strain, pair = 4e-4, PAIRS[kind]()
    body = _warm(_body(kind, index, seats), [strain, strain])
    lines = jg.contact_lines(pair, _grid(kind))
    found = np.asarray(foot_tables(pair, index, body, lines).heated)
    roll = np.asarray(lines.roll if index == 0 else pair.tangent_length - lines.roll)
    helix = float(pair.base_helix_angle)
    along = roll * np.cos(helix) - (1, -1)[index] * np.sin(helix) * np.asarray(lines.face_position)
    wanted = strain * along.reshape(found.shape)
    assert np.abs(found - wanted).max() < 1e-6 * np.abs(wanted).max()
    assert body.heat is not None
    assert np.abs(np.asarray(body.heat.seat_load)).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(PAIRS))
def test_two_gears_that_are_as_warm_run_as_cold_ones(kind):
    """Both grow alike: flanks stay conjugate, and only come closer by the growth of both bases."""
    pair, strain = PAIRS[kind](), 3e-4
    bodies = [_body(kind, index) for index in (0, 1)]
    cold, warm = (
        _cycle(
            _model(kind, pinion_body=own[0], wheel_body=own[1], pinion_support=ROUND), _grid(kind)
        )
        for own in (bodies, [_warm(each, [strain, strain]) for each in bodies])
    )
    assert_close(np.asarray(warm.force), np.asarray(cold.force), rtol=1e-6, atol=1e-6)
    helix = float(pair.base_helix_angle)
    nearer = strain * float(pair.tangent_length) * np.cos(helix)
    moved = np.asarray(cold.approach) - np.asarray(warm.approach)
    np.testing.assert_allclose(moved, nearer, rtol=1e-6)


@pytest.mark.slow
@every_kind
def test_a_heated_wheel_rests_as_all_of_its_coordinates_say(kind):
    pair, grid, torque = PAIRS[kind](), _grid(kind), 100.0
    model = _model(kind, torque, wheel_body=_warm(_body(kind, 1), _STRAIN), speed=800.0)
    cycle = _cycle(model, grid)
    own, heat = hybrid_cases.body(kind), hybrid_cases.heated(kind)
    gears = [Gear(None, _FREE), Gear(own, _SPRINGS, load=_STRAIN @ heat.load)]
    dense = Dense(pair, grid, gears, cycle.cells.lines)
    gap = np.asarray(mesh_gap(pair, cycle.cells.lines, model.flanks, model.misalignment))
    # What grows beyond the feet: all of a cold foot's place against the flank.
    body = _warm(_body(kind, 1), [0.0, _STRAIN[1]])
    assert body.heat is not None
    still = dataclasses.replace(body.heat, feet=0.0 * body.heat.feet)
    teeth = foot_tables(pair, 1, dataclasses.replace(body, heat=still), cycle.cells.lines).heated
    for phase in (1, 6):
        stiffness = np.asarray(cycle.cells.stiffness)[phase]
        found = dense.state(phase, stiffness, gap[phase] - np.asarray(teeth)[phase], torque, 800.0)
        assert_close(np.asarray(cycle.force)[phase], found.force, rtol=1e-7, atol=1e-6)
    cold = _cycle(_model(kind, torque, wheel_body=_body(kind, 1), speed=800.0), grid)
    assert np.abs(np.asarray(cold.force) - np.asarray(cycle.force)).max() > 10.0


@pytest.mark.slow
@every_kind
def test_a_heated_wheel_in_motion_rests_as_it_does_in_statics(kind):
    """On few modes and mesh coordinates: what they leave out of the heat is in the gaps."""
    model = _model(kind, 60.0, wheel_body=_warm(_body(kind, 1, count=7), _STRAIN))
    dynamics = _in_motion(model, _grid(kind))
    system, force = dynamics.system, np.asarray(dynamics.cycle.force)
    found = _forces(mesh_at(system.table, MIDDLE).at(jnp.zeros(())), system.rest)
    found = np.asarray(system.table.on_all_cells(found))
    assert_close(found, force, rtol=1e-8, atol=1e-6)
    # The load that the modes bear is there: at rest they lie where heat has them.
    assert isinstance(model.wheel_body, FlexibleBody)
    modes = model.wheel_body.modes
    assert modes is not None
    assert modes.heat is not None
    count = modes.square.size
    assert_close(np.asarray(system.load)[-count:], modes.heat @ _STRAIN, rtol=1e-12, atol=0.0)
    assert np.abs(np.asarray(system.load)[-count:]).max() > 0.0


@pytest.mark.slow
def test_combinations_of_modes_and_residual_shapes_bear_the_heat_of_the_modes():
    own, pair, grid = hybrid_cases.body("spur", 1), PAIRS["spur"](), _grid("spur")
    heat = hybrid_cases.heated("spur", 1).load
    basis = body_basis(own, 60)
    in_mesh = body_in_mesh(own, pair, 1, grid, 1, heat=heat)
    shapes = excited_shapes(basis, in_mesh, pair, 1, grid, 20)
    assert shapes is not None
    assert shapes.residual is not None
    every, found = in_mesh.moving(basis).modes, shapes.of_body(in_mesh, basis).flexible.modes
    assert every is not None
    assert found is not None
    into = np.concatenate([shapes.into, shapes.residual.into], axis=1)
    assert every.heat is not None
    assert found.heat is not None
    scale = float(jnp.abs(every.heat).max())
    assert_close(found.heat / scale, into.T @ every.heat / scale, rtol=0.0, atol=1e-12)


@pytest.mark.slow
def test_gauges_on_a_heated_wheel_read_what_all_of_its_coordinates_say():
    model = _model("helical", wheel_body=_warm(_body("helical", 1), _STRAIN))
    assert isinstance(model.wheel_body, FlexibleBody)
    own, heat = hybrid_cases.body("helical"), hybrid_cases.heated("helical")
    grid, draw = _grid("helical"), np.random.default_rng(3)
    rows, beside = draw.normal(size=(2, own.dofs)), draw.normal(size=(2, 2))
    cycle = _cycle(model, grid)
    gauges = gauge_influences(
        own,
        rows,
        np.zeros(2),
        model.pair,
        1,
        grid,
        components=model.wheel_body.components,
        heat=(beside, heat.load),
    )
    read = eqx.filter_jit(gauge_readings)
    zero = jnp.zeros(())
    warm, _ = read(gauges, model.pair, cycle, zero, jnp.asarray(_STRAIN))
    cold, _ = read(gauges, model.pair, cycle, zero)
    # The same seats and forces: the difference is the body's own answer with its seats held.
    first = 3 * len(own.rim_nodes)
    inner = np.setdiff1d(np.arange(own.dofs), np.arange(first, first + 6))
    moved = np.linalg.solve(own.stiffness[np.ix_(inner, inner)], (_STRAIN @ heat.load)[inner])
    wanted = rows[:, inner] @ moved + beside @ _STRAIN
    assert_close(np.asarray(warm - cold), np.tile(wanted, (len(cold), 1)), rtol=1e-7, atol=1e-12)


@pytest.mark.slow
def test_a_heated_wheel_has_derivatives_by_its_temperatures():
    model = _model("helical", wheel_body=_warm(_body("helical", 1), _STRAIN))
    law, grid = jg.SmoothContact(0.5 * um), _grid("helical")

    def fluctuation(strain):
        own = eqx.tree_at(lambda m: m.wheel_body.heat.strain, model, strain)
        cycle = jg.mesh_cycle(own, grid, law=law)
        return 1e6 * jg.cycle_rms(cycle, jg.transmission_error(own.pair, cycle))

    assert_gradient(eqx.filter_jit(fluctuation), jnp.asarray(_STRAIN), rtol=1e-5)


@pytest.mark.slow
def test_a_stiffer_body_grows_as_much_by_heat_and_loads_its_seats_more():
    body = _warm(_body("helical", 1, "shaft", 7), _STRAIN)
    found = scaled_body(body, young=2.0, density=1.5)
    own = hybrid_cases.body("helical", seats="shaft")
    made = dataclasses.replace(
        own,
        stiffness=2.0 * own.stiffness,
        mass=1.5 * own.mass,
    )
    heat = 2.0 * hybrid_cases.heated("helical", seats="shaft").load
    basis = body_basis(made, 7)
    wanted = flexible_body(made, PAIRS["helical"](), 1, _grid("helical"), heat=heat, basis=basis)
    assert found.heat is not None
    assert found.modes is not None
    assert found.modes.heat is not None
    assert wanted.heat is not None
    assert wanted.modes is not None
    assert wanted.modes.heat is not None
    scale = float(jnp.abs(wanted.heat.feet).max())
    assert_close(found.heat.feet, wanted.heat.feet, rtol=1e-7, atol=1e-7 * scale)
    size = lambda body: np.linalg.norm(np.asarray(body.modes.heat), axis=1)
    np.testing.assert_allclose(size(found), size(wanted), rtol=1e-6, atol=1e-6 * size(wanted).max())
    # Bearings on a shaft that grows along itself.
    load = float(jnp.abs(wanted.heat.seats).max())
    assert load > 1e3
    assert_close(found.heat.seats, wanted.heat.seats, rtol=1e-7, atol=1e-7 * load)


def test_bodies_of_a_family_are_told_apart_by_their_heat():
    body = _body("helical", 1)
    assert body.heat is not None
    other = eqx.tree_at(lambda b: b.heat.feet, body, 1.02 * body.heat.feet)
    assert table_difference(body, body) == 0.0
    assert table_difference(other, body) == pytest.approx(0.02, rel=1e-6)
