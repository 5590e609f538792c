"""Quasi-static cycles of gears with condensed bodies, against the same mechanics in plain NumPy.

H1 has a condensed wheel, H2 both gears; the reference of `hybrid_cases` rebuilds the whole matrix
until its active set stands still.
"""

import dataclasses
import functools

import equinox as eqx
import hybrid_cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close
from hybrid_cases import APART, PAIRS, Dense, Gear, shaft, shaft_springs, stiffened

import jaxgear as jg
from fem_prep import ReducedBody
from jaxgear import um
from jaxgear._contact._cells import Misalignment, mesh_gap
from jaxgear._system._body_tables import flexible_body
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._model import PairModel

SPEED = 2000.0
SUPPORT = jg.Support(1e8, 2.5e8, 3e8, 1e5)
SPRINGS = np.array([[1e8, 2.5e8, 3e8, 1e5, 1e5, 0.0]])


@functools.cache
def _grid(kind: str, slices: int = 3) -> jg.MeshGrid:
    return jg.mesh_grid(PAIRS[kind](), phases=8, slices=slices)


@eqx.filter_jit
def _cycle(model: PairModel, grid: jg.MeshGrid, law: jg.AbstractContactLaw) -> jg.MeshCycle:
    return jg.mesh_cycle(model, grid, law=law, throw=False)


EXACT = jg.ExactContact()


@functools.cache
def _body(kind: str, index: int, seats: str = "bore", slices: int = 3) -> FlexibleBody:
    body = hybrid_cases.body(kind, index, seats=seats)
    return flexible_body(body, PAIRS[kind](), index, _grid(kind, slices))


def _stiff(factor: float) -> FlexibleBody:
    body = stiffened(hybrid_cases.body("spur", 1), factor)
    return flexible_body(body, PAIRS["spur"](), 1, _grid("spur"))


def _flanks(depth=12.0, extent=0.3, crowning=5.0) -> jg.Flanks:
    relief = jg.TipRelief(depth * um, extent)
    crowned = jg.Superposed(parts=(relief, jg.Crowning(crowning * um)))
    return jg.Flanks(pinion=crowned, wheel=relief)


def _h1(wheel: FlexibleBody | None = None, torque=20.0, **others) -> PairModel:
    """A rigid pinion and a condensed wheel, both on springs."""
    parts: dict = {"flanks": _flanks(), "speed": SPEED, "wheel_support": SUPPORT}
    parts["compliance"] = APART
    parts |= {"pinion_support": SUPPORT, "misalignment": Misalignment(8.0 * um, -12.0 * um)}
    parts |= {"wheel_body": _body("spur", 1) if wheel is None else wheel, **others}
    return PairModel(PAIRS["spur"](), torque, **parts)


def _h2(torque=150.0) -> PairModel:
    """Both gears condensed, helical, the wheel with its shaft on three bearings."""
    return PairModel(
        PAIRS["helical"](),
        torque,
        flanks=_flanks(),
        compliance=APART,
        speed=SPEED,
        pinion_support=SUPPORT,
        wheel_support=shaft(),
        pinion_body=_body("helical", 0),
        wheel_body=_body("helical", 1, "shaft"),
    )


def _gears(reduced: tuple[ReducedBody | None, ReducedBody | None], shaft: bool) -> list[Gear]:
    wheel = Gear(reduced[1], shaft_springs(), 1) if shaft else Gear(reduced[1], SPRINGS)
    return [Gear(reduced[0], SPRINGS), wheel]


def _compare(model: PairModel, cycle: jg.MeshCycle, dense: Dense, phases) -> None:
    gap = np.asarray(mesh_gap(model.pair, cycle.cells.lines, model.flanks, model.misalignment))
    motion = np.asarray(cycle.system.displacement(cycle.load))
    starts = cycle.system.structure.map.sizes[0]
    assert np.asarray(cycle.converged).all()
    for phase in phases:
        stiffness = np.asarray(cycle.cells.stiffness[phase])
        state = dense.state(phase, stiffness, gap[phase], float(model.torque), float(model.speed))
        assert float(cycle.approach[phase]) == pytest.approx(state.approach, rel=1e-8)
        force = np.asarray(cycle.force[phase])
        assert np.abs(force - state.force).max() < 1e-8 * state.force.max()
        # Apart from the pinion's rotation, which drives.
        own = [part.ravel().copy() for part in state.seats]
        turned = own[0][5]
        own[0][5::6] -= turned
        for found, wanted in zip(
            (motion[phase, :starts], motion[phase, starts:]), own, strict=True
        ):
            assert np.abs(found - wanted).max() < 1e-8 * np.abs(wanted).max()


@functools.cache
def _h1_cycle() -> jg.MeshCycle:
    return _cycle(_h1(), _grid("spur"), EXACT)


@functools.cache
def _h2_cycle() -> jg.MeshCycle:
    return _cycle(_h2(), _grid("helical"), EXACT)


def _dense(kind: str, cycle: jg.MeshCycle, bodies, shaft: bool, slices: int = 3) -> Dense:
    gears = _gears(bodies, shaft)
    return Dense(PAIRS[kind](), _grid(kind, slices), gears, cycle.cells.lines)


# --- Against all degrees of freedom


def test_h1_is_the_thesis_s_way():
    cycle = _h1_cycle()
    force, fraction = np.asarray(cycle.force), np.asarray(cycle.cells.lines.fraction)
    assert ((force == 0.0) & (fraction.reshape(force.shape) > 0.0)).any()
    bodies = (None, hybrid_cases.body("spur", 1))
    _compare(_h1(), cycle, _dense("spur", cycle, bodies, False), (1, 6))


@pytest.mark.slow
def test_h2_is_the_thesis_s_way():
    cycle = _h2_cycle()
    bodies = (hybrid_cases.body("helical", 0), hybrid_cases.body("helical", 1, seats="shaft"))
    _compare(_h2(), cycle, _dense("helical", cycle, bodies, True), (3,))


def test_light_loads_lose_contact():
    model = _h1(torque=0.4)
    cycle = _cycle(model, _grid("spur"), EXACT)
    carrying = (np.asarray(cycle.force) > 0.0).sum(axis=1)
    assert carrying.min() == 1
    bodies = (None, hybrid_cases.body("spur", 1))
    _compare(model, cycle, _dense("spur", cycle, bodies, False), (int(np.argmin(carrying)),))


@pytest.mark.slow
def test_one_slice_without_relief():
    model = _h1(_body("spur", 1, slices=1), flanks=_flanks(0.0, 0.3, 0.0), speed=0.0)
    cycle = _cycle(model, _grid("spur", 1), EXACT)
    bodies = (None, hybrid_cases.body("spur", 1))
    _compare(model, cycle, _dense("spur", cycle, bodies, False, 1), (2, 6))


# --- Balance


@pytest.mark.slow
def test_cell_forces_balance_the_torque():
    for cycle, torque in ((_h1_cycle(), 20.0), (_h2_cycle(), 150.0)):
        pair = cycle.system.pair
        arm = float(pair.base_radius[0] * jnp.cos(pair.base_helix_angle))
        np.testing.assert_allclose(np.asarray(cycle.force).sum(axis=1) * arm, torque, rtol=1e-10)


@pytest.mark.slow
def test_three_bearings_carry_the_mesh_force():
    cycle = _h2_cycle()
    pair, structure = cycle.system.pair, cycle.system.structure
    motion = jax.vmap(lambda x: jg.bearing_motion(structure, x))(
        cycle.system.displacement(cycle.load)
    )
    loads = np.asarray(motion.load)[:, :, :3]
    total = np.asarray(cycle.force).sum(axis=1)
    angle, helix = float(pair.working_pressure_angle), float(pair.base_helix_angle)
    flat = np.cos(helix)
    normal = -np.array([flat * np.sin(angle), flat * np.cos(angle), -np.sin(helix)])
    # Of a force on the wheel. Its overlap grows by a motion against the pinion's normal.
    np.testing.assert_allclose(loads.sum(axis=1), -total[:, None] * normal, rtol=1e-7)
    # Hyperstatic: all three carry, and about the axis across no moment is left.
    assert (np.abs(loads[:, :, 1]) > 0.01 * total[:, None]).all()


# --- Limits


def test_condensed_gears_have_no_foundation_of_their_own():
    teeth = _h1().tooth_compliance
    assert isinstance(teeth, jg.WeberBanaschek)
    assert isinstance(teeth.wheel_foundation, jg.NoFoundation)
    assert not isinstance(teeth.pinion_foundation, jg.NoFoundation)


def test_a_rigidified_body_is_a_rigid_gear():
    found, phases = [], (1, 6)
    for factor in (2e3, 2e5):
        model = _h1(_stiff(factor))
        cycle = _cycle(model, _grid("spur"), EXACT)
        assert np.asarray(cycle.converged).all()
        gap = np.asarray(mesh_gap(model.pair, cycle.cells.lines, model.flanks, model.misalignment))
        rigid = _dense("spur", cycle, (None, None), False)
        states = [
            rigid.state(p, np.asarray(cycle.cells.stiffness[p]), gap[p], 20.0) for p in phases
        ]
        approach = np.array([state.approach for state in states])
        force = np.array([state.force for state in states])
        off = np.asarray(cycle.approach)[list(phases)] / approach - 1.0
        share = (np.asarray(cycle.force)[list(phases)] - force) / force.max()
        found.append((np.abs(off).max(), np.abs(share).max()))
    # Both are of the first order in the body's flexibility.
    assert found[0][0] < 1e-2
    for first, second in zip(*found, strict=True):
        assert second == pytest.approx(first / 100.0, rel=0.05)


@pytest.mark.slow
def test_teeth_coupled_along_the_face_on_a_rigidified_body_are_those_of_a_rigid_gear():
    coupled = jg.WeberBanaschek(wheel_foundation=jg.NoFoundation(), face_coupling=jg.FaceCoupling())
    stiff = _h1(_stiff(2e7), compliance=coupled)
    rigid = dataclasses.replace(stiff, wheel_body=None)
    found, other = (_cycle(model, _grid("spur"), EXACT) for model in (stiff, rigid))
    assert np.asarray(found.converged).all()
    assert_close(found.approach, other.approach, rtol=1e-5, atol=0.0)
    assert_close(found.force, other.force, rtol=1e-4, atol=1e-4 * float(other.force.max()))


def test_a_very_soft_web_solves():
    """Its deflection is of the order of a tooth's height."""
    cycle = _cycle(_h1(_stiff(1e-3), speed=0.0), _grid("spur"), EXACT)
    assert np.asarray(cycle.converged).all()
    np.testing.assert_allclose(cycle.force.sum(axis=1), float(cycle.system.force), rtol=1e-8)
    assert float(cycle.approach.min()) > 1e3 * um


# --- Smooth contact and derivatives

NAMES = ("relief depth", "relief extent", "crowning", "torque", "bearing", "speed")
AT = np.array([12.0, 0.3, 5.0, 20.0, 2e8, SPEED])
WIDTH = jnp.asarray(2.0 * um)


def _smooth(at: jax.Array, wheel: FlexibleBody, width: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Variance and mean of the transmission error together [um2, um], and the error [m]."""
    depth, extent, crowning, torque, bearing, speed = at
    support = jg.Support(bearing, 2.5e8, 3e8, 1e5)
    flanks = _flanks(depth, extent, crowning)
    model = _h1(wheel, torque, flanks=flanks, speed=speed, wheel_support=support)
    cycle = jg.mesh_cycle(model, _grid("spur"), law=jg.SmoothContact(width), throw=False)
    error = cycle.approach / um
    # The bearing moves the mean alone: spur teeth push it with one force along one line.
    return jg.cycle_variance(cycle, error) + jg.cycle_mean(cycle, error), cycle.approach


_reverse = eqx.filter_jit(jax.grad(_smooth, has_aux=True))
_many = eqx.filter_jit(jax.vmap(_smooth, in_axes=(0, None, 0)))


@eqx.filter_jit
def _forward(at: jax.Array, along: jax.Array, wheel: FlexibleBody):
    return jax.jvp(lambda x: _smooth(x, wheel, WIDTH)[0], (at,), (along,))


@functools.cache
def _variants() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Results at many inputs, by one program: steps of each number, torques, widths."""
    steps = [AT + k * 1e-4 * AT * row for row in np.eye(6) for k in (-2, -1, 1, 2)]
    torques = [np.where(np.arange(6) == 3, torque, AT) for torque in (2.0, 40.0, 300.0)]
    plain = np.array([AT[0], AT[1], AT[2], AT[3], 1e8, AT[5]])
    at = np.array([*steps, *torques, plain, plain])
    widths = np.where(np.arange(len(at)) < len(at) - 2, float(WIDTH), 4.0 * um)
    widths[-1] = 0.4 * um
    value, approach = _many(jnp.asarray(at), _body("spur", 1), jnp.asarray(widths))
    return at, np.asarray(value), np.asarray(approach)


@pytest.mark.slow
def test_gradients_of_the_transmission_error():
    wheel, at = _body("spur", 1), jnp.asarray(AT)
    reverse = np.asarray(_reverse(at, wheel, WIDTH)[0])
    steps = _variants()[1][:24].reshape(6, 4)
    for i, name in enumerate(NAMES):
        move = 1e-4 * AT * np.eye(6)[i]
        central = (steps[i, 0] - 8.0 * steps[i, 1] + 8.0 * steps[i, 2] - steps[i, 3]) / 12.0
        forward = float(_forward(at, jnp.asarray(move), wheel)[1])
        assert abs(central) > 1e-8 * steps[i, 0], name
        assert forward == pytest.approx(reverse[i] * move[i], rel=1e-9), name
        assert central == pytest.approx(forward, rel=1e-5), name


@pytest.mark.slow
def test_torques_at_once_are_torques_in_turn():
    at, values, _ = _variants()
    for i in (24, 25, 26):
        one = _forward(jnp.asarray(at[i]), jnp.asarray(AT), _body("spur", 1))[0]
        assert values[i] == pytest.approx(float(one), rel=1e-10)


@pytest.mark.slow
def test_smooth_contact_tends_to_exact():
    approach = _variants()[2][-2:]
    off = np.abs(approach - np.asarray(_h1_cycle().approach)).max(axis=1)
    assert 1e-3 * um < off[0] < 2.0 * um
    assert off[1] < 0.2 * off[0]
