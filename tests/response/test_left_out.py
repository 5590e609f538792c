"""What a response on few shapes leaves out of a body's motion, against one on many modes."""

import dataclasses
import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hybrid_cases import APART, PAIRS, ROUND, TEETH, body, relieved

import jaxgear as jg
from jaxgear._dynamics._harmonic import harmonic_balance_problem
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._response._left_out import LeftOut, left_out, mixed
from jaxgear._response._whole_motion import WholeBody
from jaxgear._system._body_modes import BodyBasis, body_basis
from jaxgear._system._body_tables import flexible_body
from jaxgear._system._flexible import FlexibleBody

_METHOD = jg.HarmonicBalance(harmonics=10)
_DAMPING = jg.RayleighDamping(mass_factor=0.0, stiffness_factor=3e-8)
_GRID = jg.mesh_grid(PAIRS["helical"](), phases=24, slices=2, periods=1)
# Natural modes of the wheel, and coordinates of its mesh: few, and as many as can be told apart.
_FEW, _MANY = (30, 4), (90, 60)


@functools.cache
def _basis(count: int) -> BodyBasis:
    own = _own()
    sectors = own.facts["sectors"]
    assert isinstance(sectors, int)
    return body_basis(own, count).under_teeth(TEETH[1], sectors)[0]


def _own():
    return body("helical", layers=1, rotating=True)


@functools.cache
def _on(count: int, coordinates: int) -> tuple[FlexibleBody, jg.PairDynamics]:
    """A pair whose turning wheel moves on so many natural modes."""
    pair = PAIRS["helical"]()
    flexible = flexible_body(_own(), pair, 1, _GRID, basis=_basis(count))
    model = jg.PairModel(pair, 60.0, relieved(), APART, wheel_support=ROUND, wheel_body=flexible)
    made = lambda m: pair_dynamics(
        m, _GRID, _DAMPING, gyroscopic=True, mesh_coordinates=coordinates
    )
    return flexible, eqx.filter_jit(made)(model)


@pytest.fixture(scope="module", autouse=True)
def built():
    """What all tests share, which takes longer than any of them."""
    return _on(*_FEW), _on(*_MANY)


def _whole(count: int) -> dict[int, WholeBody]:
    """The wheel on many natural modes, of which its motions are the first so many."""
    flexible, _ = _on(*_MANY)
    into = np.eye(len(_basis(_MANY[0]).square), count)
    waves = np.asarray(_basis(_MANY[0]).waves[:count])
    return {1: WholeBody(flexible, into, waves, _DAMPING, rotating=True)}


def _left_out(dynamics: jg.PairDynamics, orbit: Orbit) -> LeftOut:
    (place,) = dynamics.bodies
    whole = _whole(len(place.waves))
    return left_out(whole, dynamics, orbit, _METHOD.law, _METHOD.harmonics)


def _found(dynamics: jg.PairDynamics, speed: float, left: LeftOut | None = None) -> Orbit:
    """A response, with what was left out of another, if anything."""
    balance = harmonic_balance_problem(_METHOD, dynamics.system)
    load = np.zeros((_METHOD.harmonics + 1, len(dynamics.dofs)), dtype=complex)
    if left is not None:
        load = left.load
    # One program serves both.
    balance = dataclasses.replace(balance, beside=jnp.asarray(load))
    orbit, _ = _METHOD.solve(balance, jnp.asarray(speed))
    assert bool(orbit.settled)
    return orbit


def _closer(dynamics: jg.PairDynamics, left: LeftOut) -> jg.PairDynamics:
    gap = dynamics.system.table.gap - left.closer[None]
    return eqx.tree_at(lambda x: x.system.table.gap, dynamics, gap)


def _off(dynamics: jg.PairDynamics, orbit: Orbit, speed: float) -> np.ndarray:
    """Errors of forces and of transmission errors over a cycle, of their swing."""
    _, judge = _on(*_MANY)
    wanted, errors = _found(judge, speed), []
    for read in (lambda d, o: o.load[:, 0], lambda d, o: o.motion @ d.system.transmission):
        right = np.asarray(read(judge, wanted))
        apart = np.asarray(read(dynamics, orbit)) - right
        errors.append(np.linalg.norm(apart) / np.linalg.norm(right - right.mean()))
    return np.array(errors)


def test_a_response_on_many_modes_leaves_out_nothing():
    _, many = _on(*_MANY)
    orbit = _found(many, 1000.0)
    left = _left_out(many, orbit)
    assert np.abs(left.closer).max() < 1e-3 * np.ptp(np.asarray(orbit.place)[:, 0])
    assert np.abs(left.load).max() < 1e-6 * float(many.system.force)


@pytest.mark.parametrize(("speed", "force", "te"), [(1000.0, 0.3, 0.05), (1800.0, 0.15, 0.15)])
def test_with_it_few_modes_find_what_many_do(speed, force, te):
    """But for how often a cell's entry swings, which is of modes that are kept: a hundredth here.

    Once is enough, and again is no worse.
    """
    _, few = _on(*_FEW)
    moved, orbit = few, _found(few, speed)
    before = _off(few, orbit, speed)
    assert before.max() > 0.03
    for _ in range(3):
        left = _left_out(moved, orbit)
        moved = _closer(few, left)
        orbit = _found(moved, speed, left)
        assert np.all(_off(moved, orbit, speed) < np.array([force, te]) * before)


def test_rounds_that_drive_each_other_apart_are_mixed_to_their_root():
    """Two lengths and a load, each round of which is twice as far off as the last, three ways."""
    draw = np.random.default_rng(3)
    turn, root = -2.0 * np.linalg.qr(draw.normal(size=(4, 4)))[0], draw.normal(size=4)
    turn[:, 3] = 0.0
    part = lambda x: LeftOut(x[None, :2], 1e3 * (x[2:3] + 1j * x[3:])[None])
    whole = lambda each: np.r_[each.closer[0], each.load[0].real / 1e3, each.load[0].imag / 1e3]
    given, found = [part(np.zeros(4))], []
    for _ in range(8):
        found.append(part(root + turn @ (whole(given[-1]) - root)))
        given.append(mixed(given, found))
    assert np.abs(whole(given[1]) - whole(found[0])).max() < 1e-12
    assert np.abs(whole(given[-1]) - root).max() < 1e-6
