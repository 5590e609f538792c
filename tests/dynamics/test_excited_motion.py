"""Pairs whose wheel moves on shapes that its mesh excites: responses, marches, Floquet, slopes."""

import dataclasses
import functools
from typing import NamedTuple

import equinox as eqx
import hybrid_cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fem_cases import assert_near
from hybrid_cases import APART, PAIRS, ROUND, relieved

import jaxgear as jg
from jaxgear import um
from jaxgear._dynamics._floquet import floquet_multipliers, leading_multipliers, monodromy
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steady_state import steady_state, steady_states
from jaxgear._dynamics._steppers import Midpoint
from jaxgear._dynamics._system import ModalBasis, modal_basis
from jaxgear._response._dynamic import dynamic_transmission_error, orbit_variance
from jaxgear._system._body_modes import body_basis
from jaxgear._system._body_tables import body_in_mesh
from jaxgear._system._excited_shapes import excited_shapes
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._mode_combinations import lowest_modes
from jaxgear._system._scaled_body import scaled_body

COUNT, SPEEDS = 32, jnp.asarray([700.0, 1700.0, 2900.0])


class _Case(NamedTuple):
    """A wheel, its teeth, and the mesh periods after which it is itself again."""

    kind: str
    shape: dict
    periods: int = 1


CASES = {
    "spur": _Case("spur", {"modes": 8, "rotating": True}),
    "helical": _Case("helical", {"modes": 8}),
    "holes": _Case("spur", {"modes": 8, "holes": 6}, periods=8),
}
every_case = pytest.mark.parametrize("name", CASES)


@functools.cache
def _grid(kind: str, periods: int) -> jg.MeshGrid:
    return jg.mesh_grid(PAIRS[kind](), phases=15, slices=2, periods=periods)


@functools.cache
def _wheels(name: str) -> dict[str, FlexibleBody]:
    """The wheel on 128 natural modes, as many excited shapes as are tried, and natural ones."""
    case = CASES[name]
    body, pair = hybrid_cases.body(case.kind, 1, **case.shape), PAIRS[case.kind]()
    grid = _grid(case.kind, case.periods)
    sectors = body.facts["sectors"]
    assert isinstance(sectors, int)
    basis, repeats = body_basis(body, 4 * COUNT).under_teeth(pair.wheel.teeth, sectors)
    in_mesh = body_in_mesh(body, pair, 1, grid, repeats)
    excited = excited_shapes(basis, in_mesh, pair, 1, grid, COUNT)
    assert excited is not None
    return {
        "all": in_mesh.moving(basis),
        "excited": excited.of_body(in_mesh, basis).flexible,
        "natural": in_mesh.moving(lowest_modes(basis, COUNT)),
    }


def _model(case: _Case, wheel: FlexibleBody, **others) -> jg.PairModel:
    parts: dict = {"flanks": relieved(), "pinion_support": ROUND, "wheel_support": ROUND}
    parts |= {"compliance": APART, "wheel_body": wheel}
    return jg.PairModel(PAIRS[case.kind](), 20.0, **{**parts, **others})


@functools.cache
def _system(name: str, shapes: str):
    case = CASES[name]
    grid, whole = _grid(case.kind, case.periods), "rotating" in case.shape
    make = lambda model: pair_dynamics(model, grid, gyroscopic=whole, mesh_coordinates=6)
    return eqx.filter_jit(make)(_model(case, _wheels(name)[shapes])).system


@functools.cache
def _orbits(name: str, shapes: str):
    method = HarmonicBalance(harmonics=7)
    return eqx.filter_jit(steady_states)(_system(name, shapes), SPEEDS, method)


@pytest.mark.slow
@every_case
def test_responses_are_closer_to_those_of_all_modes_than_with_as_many_natural_ones(name):
    """The body is small, and the seven harmonics excite few of its higher modes."""
    exact, excited, natural = (_orbits(name, each) for each in ("all", "excited", "natural"))
    assert all(np.asarray(each.settled).all() for each in (exact, excited, natural))
    force = lambda orbits: np.asarray(orbits.load)[:, :, 0]
    swing = np.ptp(force(exact), axis=1)
    off, other = (
        np.abs(force(each) - force(exact)).max(axis=1) / swing for each in (excited, natural)
    )
    assert off.max() < 0.05
    assert off.mean() < other.mean()


@pytest.mark.slow
@every_case
def test_a_march_that_closes_is_the_response_by_harmonics(name):
    """With all harmonics and steps of one length, the midpoint rule is harmonic balance."""
    system = _system(name, "excited")
    steps, periods = len(system.table.kinds), system.table.periods
    table = dataclasses.replace(
        system.table, edges=jnp.linspace(0.0, periods, steps + 1), kinds=(0,) * steps
    )
    system = dataclasses.replace(system, table=table)
    steady, speeds = eqx.filter_jit(steady_states), jnp.asarray([2200.0, 3390.0])
    harmonic = HarmonicBalance(harmonics=7, bilinear=True, tolerance=1e-12)
    balanced = steady(system, speeds, harmonic)
    shot = steady(system, speeds, Shooting(stepper=Midpoint(), tolerance=1e-13))
    assert np.asarray(balanced.settled & shot.settled).all()
    if periods == 1:
        assert_near(np.asarray(balanced.load), np.asarray(shot.load), 1e-9)
    else:
        # Seven harmonics of the mesh are not all that eight periods have.
        off = np.abs(np.asarray(balanced.load - shot.load)).max()
        assert off < 0.05 * np.ptp(np.asarray(shot.load)[:, :, 0])


@pytest.mark.slow
@every_case
def test_slow_multipliers_are_those_of_all_modes(name):
    found = []
    for shapes in ("all", "excited"):
        system, orbits = _system(name, shapes), _orbits(name, shapes)
        modes = modal_basis(system)
        matrix = monodromy(system, modes, jax.tree.map(lambda x: x[1], orbits))
        each = floquet_multipliers(matrix, modes)
        # Arnoldi's method finds the same as all eigenvalues at once.
        leading = leading_multipliers(matrix, modes)
        assert np.abs(leading) == pytest.approx(np.abs(each[: len(leading)]), abs=1e-10)
        found.append(np.abs(each[:6]))
    assert found[1].max() < 1.0
    # Eight of the shapes are natural modes; over more periods a slow mode's error adds up.
    assert found[1] == pytest.approx(found[0], abs=5e-4 * max(CASES[name].periods, 2))


NAMES = "relief", "speed", "bearing", "damping", "modulus", "density"


@pytest.mark.slow
def test_slopes_of_a_response_are_those_of_differences():
    """Variance of the dynamic transmission error, by implicit differentiation."""
    case, method = CASES["spur"], HarmonicBalance(harmonics=7, tolerance=1e-12)
    wheel, grid = _wheels("spur")["excited"], _grid("spur", 1)

    @jax.jit
    @jax.value_and_grad
    def variance(factors):
        deeper, faster, stiffer, damped, modulus, density = factors
        relief = jg.TipRelief(12.0 * um * deeper, 0.3)
        flanks = jg.Flanks(jg.Superposed(parts=(relief, jg.Crowning(5.0 * um))), relief)
        support = jg.Support(1e8 * stiffer, 1.2e8 * stiffer, 3e8, 1e5)
        scaled = scaled_body(wheel, young=modulus, density=density)
        model = _model(case, scaled, flanks=flanks, wheel_support=support)
        damping = jg.ModalDamping(0.07 * damped, 0.02 * damped)
        dynamics = pair_dynamics(model, grid, damping, gyroscopic=True, mesh_coordinates=6)
        system = dynamics.system
        orbit = steady_state(system, 2200.0 * faster, method)
        return orbit_variance(system, dynamic_transmission_error(system, orbit) / um)

    at, step = jnp.ones(len(NAMES)), 1e-5
    value, gradient = variance(at)
    for i, name in enumerate(NAMES):
        away = step * jnp.eye(len(NAMES))[i]
        central = float((variance(at + away)[0] - variance(at - away)[0]) / (2.0 * step))
        assert abs(central) > 1e-4 * float(value), name
        assert float(gradient[i]) == pytest.approx(central, rel=1e-4), name


def test_few_of_many_multipliers_are_the_largest():
    random = np.random.default_rng(1)
    square, none = jnp.linspace(1.0, 9.0, 150) ** 2, jnp.zeros(150)
    modes = ModalBasis(square, jnp.eye(150), none, none[:, None], none)
    weights = np.concatenate([np.sqrt(np.asarray(square)), np.ones(150)])
    matrix = random.normal(size=(300, 300)) / 20.0
    monodromy_matrix = matrix / weights[:, None] * weights
    every = floquet_multipliers(monodromy_matrix, modes)
    few = leading_multipliers(monodromy_matrix, modes)
    assert 6 <= len(few) < 20
    assert np.abs(few) == pytest.approx(np.abs(every[: len(few)]), rel=1e-8)
