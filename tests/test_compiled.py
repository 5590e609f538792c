"""Public verbs are compiled as a whole: few programs, and none anew for another real number."""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_programs import made_programs

import jaxgear as jg
from jaxgear import deg, mm, um
from jaxgear._compiled import compiled, known_to_fail


def _pair() -> jg.GearPair:
    common: dict[str, Any] = dict(addendum=0.9447, dedendum=1.1933, fillet_radius=0.25)
    return jg.GearPair(
        pinion=jg.Gear(45, 11.5 * mm, profile_shift=0.341, **common),
        wheel=jg.Gear(86, 9.5 * mm, profile_shift=0.481, **common),
        normal_module=1.5 * mm,
        pressure_angle=25.0 * deg,
    )


def _model(
    torque: float | jax.Array = 80.0,
    depth: float = 12.0,
    compliance: jg.AbstractCompliance | None = None,
) -> jg.PairModel:
    """Of constant stiffness, which is traced soonest, unless another is given."""
    relief = jg.Superposed((jg.TipRelief(depth * um, 0.25),))
    flanks, law = jg.Flanks(relief, relief), compliance or jg.ConstantStiffness(14e9)
    return jg.PairModel(_pair(), torque=torque, flanks=flanks, compliance=law)


@functools.cache
def _grid(phases: int = 16) -> jg.MeshGrid:
    return jg.mesh_grid(_pair(), phases=phases, slices=2)


def _statics(model: jg.PairModel, grid: jg.MeshGrid) -> float:
    cycle = jg.mesh_cycle(model, grid)
    te = jg.transmission_error(model.pair, cycle)
    return float(jg.cycle_variance(cycle, te))


def test_a_mesh_cycle_from_gears_to_a_number_is_a_handful_of_programs():
    """On a grid that no other test has: whatever these have compiled, it is compiled anew."""
    law, grid = jg.WeberBanaschek(), _grid(phases=18)
    with made_programs() as whole:
        first = _statics(_model(compliance=law), grid)
    assert 3 <= len(whole) <= 20, whole
    with made_programs() as again:
        second = _statics(_model(torque=95.0, depth=3.0, compliance=law), grid)
    assert again == []
    assert second != first
    with made_programs() as finer:
        _statics(_model(), _grid(phases=24))
    assert finer != [], "another number of phases is another program"


def test_a_pair_of_other_teeth_is_built_without_a_program():
    facts = [jg.pair_facts(_pair())]
    with made_programs() as made:
        pinion, wheel = (dataclasses.replace(_pair().pinion, teeth=teeth) for teeth in (44, 85))
        other = jg.GearPair(pinion, wheel, 1.5 * mm, 25.0 * deg)
        facts.append(jg.pair_facts(other))
    assert made == []
    ratio = [np.asarray(each.reference_radius) / (0.75 * mm) for each in facts]
    np.testing.assert_allclose(ratio, [[45.0, 86.0], [44.0, 85.0]], rtol=1e-14)
    np.testing.assert_allclose(facts[1].base_radius, other.base_radius, rtol=1e-14)


@pytest.mark.slow
def test_verbs_of_dynamics_are_compiled_as_a_whole():
    """A pair in motion, its modes, a march and a sweep; other speeds and loads compile nothing.

    On a grid that no other test has, as above.
    """
    grid = _grid(phases=32)
    method = jg.HarmonicBalance(harmonics=4)
    settings = jg.SweepSettings(method=method)

    def ratio(dynamics: jg.PairDynamics, speed: float) -> float:
        orbit = jg.steady_state(dynamics.system, jnp.asarray(speed), method)
        return float(jg.dynamic_ratio(dynamics.system, orbit))

    with made_programs() as whole:
        dynamics = jg.pair_dynamics(_model(80.0), grid)
        first = ratio(dynamics, 800.0)
    assert len(whole) <= 25, whole
    rest = jg.at_rest(dynamics.system)
    with made_programs() as whole:
        jg.pair_modes(dynamics)
        jg.time_history(dynamics.system, jnp.asarray(700.0), rest, cycles=2)
    assert len(whole) <= 6, whole
    points = jg.sweep(dynamics.system, [500.0, 520.0], settings=settings)
    with made_programs() as again:
        other = jg.pair_dynamics(_model(90.0), grid)
        second = ratio(other, 650.0)
        jg.pair_modes(other)
        jg.time_history(other.system, jnp.asarray(750.0), rest, cycles=2)
        points = (*points, *jg.sweep(other.system, [505.0, 530.0], settings=settings))
    assert again == []
    assert second != first
    assert all(point.settled for point in points)


def test_a_real_number_of_python_is_no_part_of_a_program():
    twice = compiled(lambda x: 2.0 * jnp.sin(x))
    assert float(twice(0.5)) == 2.0 * np.sin(0.5)
    with made_programs() as again:
        assert float(twice(0.75)) == pytest.approx(2.0 * np.sin(0.75), rel=1e-15)
    assert again == []


# --- Contact that is not solved


_HASTY = jg.SolverSettings(most_steps=1)


def _unsolvable(torque: float | jax.Array = 80.0, throw_in_jit: bool = False) -> jg.MeshCycle:
    # Relief so deep that the first guess, all cells closed, is far off.
    model = _model(torque, depth=80.0)
    return jg.mesh_cycle(model, _grid(), settings=_HASTY, throw_in_jit=throw_in_jit)


def test_unsolved_contact_raises_with_the_phases_where_values_are_known():
    words = r"Raise `most_steps`.* Not solved: \d+ of 16 phases, first \d+"
    with pytest.raises(RuntimeError, match=words):
        _unsolvable()
    # Under a derivative without `jit` the values are known too.
    with pytest.raises(RuntimeError, match="not solved at some phase"):
        jax.grad(lambda torque: jnp.sum(_unsolvable(torque).approach))(80.0)


def test_failure_is_known_where_values_are():
    bad = jnp.asarray([1.0, -1.0])
    assert known_to_fail(bad > 0.0)
    assert not known_to_fail(bad < 2.0)
    seen = []
    noted = lambda x: (seen.append(known_to_fail(x > 0.0)), jnp.sum(x))[1]
    jax.grad(noted)(bad)
    jax.jit(noted)(bad)
    jax.vmap(noted)(bad)
    assert seen == [True, False, False]


@pytest.mark.parametrize("throw_in_jit", [False, True])
def test_only_a_program_that_is_asked_to_raise_calls_back(throw_in_jit: bool):
    """Inside another program unsolved contact is told by values, and raises if asked to."""
    program = jax.jit(lambda torque: _unsolvable(torque, throw_in_jit)).lower(80.0)
    assert ("callback" in program.as_text()) == throw_in_jit
    if throw_in_jit:
        with pytest.raises(RuntimeError, match="not solved at some phase"):
            jax.block_until_ready(program.compile()(80.0))
    else:
        assert not np.all(program.compile()(80.0).converged)


@pytest.mark.slow
def test_refusals_by_values_stand_outside_of_what_is_compiled():
    system = jg.pair_dynamics(_model(), _grid(32)).system
    for speed in (0.0, -3.0):
        with pytest.raises(ValueError, match="speed must be positive"):
            jg.steady_state(system, jnp.asarray(speed))
    crossed = jnp.asarray(np.random.default_rng(1).normal(size=system.damping.shape))
    mixed = dataclasses.replace(system, damping=system.damping + 1e3 * crossed @ crossed.T)
    with pytest.raises(ValueError, match="exchanges energy between modes"):
        jg.modal_basis(mixed)
