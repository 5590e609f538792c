"""Objectives over a range of speeds: means, what is left out, derivatives, folds, and scenes."""

import dataclasses
import functools
from typing import Any

import cases as pairs
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dynamics import cases

import jaxgear as jg
import optimise
from jaxgear import um
from jaxgear._interface._laws import ExactContact
from jaxgear.scene._build import grid_of, model_of
from jaxgear.scene._scene import SceneError, example_scene
from jaxgear.study._built import BuiltScene
from jaxgear.study._design import design_space
from jaxgear.study._evaluations import objective_at
from jaxgear.study._objectives import judged_speeds, objective_unit, task_of
from jaxgear.study._search_checks import require_searchable

# The mesh mode of the torsional pair is near 1200 rad/s.
_SPEEDS = np.array([500.0, 800.0, 1500.0, 2000.0])


def _method(**settings):
    return jg.HarmonicBalance(harmonics=8, averaged=True, tolerance=1e-12, **settings)


@functools.cache
def _pair():
    """The accessory pair that only turns, on teeth that are quick to compile."""
    pair = pairs.accessory()
    grid = jg.mesh_grid(pair, phases=32, slices=2)
    return jg.PairModel(pair, 80.0, compliance=jg.ConstantStiffness(14e9)), grid


def _over(**settings: Any):
    settings = {"method": _method(), "speeds": jnp.asarray(_SPEEDS)} | settings
    return optimise.OverSpeeds(optimise.DynamicRatio(), grid=_pair()[1], **settings)


def _relieved(values):
    depth, extent = values
    tip = jg.TipRelief(depth * um, extent)
    return dataclasses.replace(_pair()[0], flanks=jg.Flanks(tip, tip))


@eqx.filter_jit
def _judged(objective, values):
    return objective.judged(_relieved(values), jg.ExactContact())


_DESIGN = jnp.array([8.0, 0.25])


class _Known(optimise.OverSpeeds):
    """Over numbers that are known, and as many of them as count."""

    found: optimise.SpeedResults | None = None

    def judged(self, model, law):
        return self.found


def _known(kept, power):
    number = jnp.array([1.5, jnp.nan, 1.25, 3.0])
    found = optimise.SpeedResults(
        jnp.asarray(_SPEEDS), number, jnp.asarray(kept), jnp.ones(4), jnp.asarray(kept)
    )
    objective = _over()
    fields = {x.name: getattr(objective, x.name) for x in dataclasses.fields(objective)}
    known = _Known(**fields | {"power": power}, found=found)
    # It is not looked at.
    cycle = object.__new__(jg.MeshCycle)
    return float(known(_pair()[0], cycle, jg.ExactContact()))


@pytest.mark.parametrize("kept", [(True, False, True, True), (True, False, True, False)])
def test_mean_power_mean_and_worst_of_what_is_kept(kept):
    """What is left out does not reach the number, not even as a NaN."""
    number = np.array([1.5, np.nan, 1.25, 3.0])[list(kept)]
    assert _known(kept, 1.0) == pytest.approx(number.mean(), rel=1e-12)
    assert _known(kept, 8.0) == pytest.approx(np.mean(number**8) ** 0.125, rel=1e-12)
    assert _known(kept, np.inf) == pytest.approx(number.max(), rel=1e-12)


def test_fewer_than_half_of_the_speeds_are_no_number():
    for power in (1.0, np.inf):
        assert np.isnan(_known((True, False, False, False), power))


@pytest.mark.slow
def test_a_search_sees_true_derivatives():
    """Of the mean over speeds, by depth and extent, against central differences."""
    model, grid = _pair()
    function = optimise.over_torques(
        _relieved,
        _over(),
        model.torque[None],
        grid=grid,
        law=jg.ExactContact(),
        batched=False,
    )
    both = jax.jit(jax.value_and_grad(function))
    gradient = np.asarray(both(_DESIGN)[1])
    for index, step in enumerate((1e-4, 1e-6)):
        shift = step * np.eye(2)[index]
        above, below = (float(both(_DESIGN + side * shift)[0]) for side in (1.0, -1.0))
        assert gradient[index] == pytest.approx((above - below) / (2.0 * step), rel=1e-5)
    box = optimise.Box(lower=np.array([0.0, 0.1]), upper=np.array([25.0, 0.4]))
    result = optimise.lbfgs(function, np.asarray(_DESIGN), box, most_evaluations=8)
    assert result.value < result.values[0] - 0.03


@pytest.mark.slow
def test_speeds_that_have_not_settled_or_are_too_sensitive_are_left_out():
    """Few Newton steps are enough away from the mesh mode only."""
    found = _judged(_over(method=_method(most_steps=4)), _DESIGN)
    settled = np.asarray(found.settled)
    assert settled.any()
    assert not settled.all()
    np.testing.assert_array_equal(np.asarray(found.kept), settled)
    np.testing.assert_array_equal(np.asarray(found.left_out), _SPEEDS[~settled])
    assert np.all(np.asarray(found.number)[settled] > 1.0)
    # Of those that have settled, the one nearest to the mode is the most sensitive.
    sizes = np.sort(np.asarray(found.sensitivity)[settled])
    limit = 0.5 * (sizes[-1] + sizes[-2])
    fewer = _judged(_over(method=_method(most_steps=4), most_sensitive=limit), _DESIGN)
    assert fewer.left_out.size == found.left_out.size + 1
    np.testing.assert_array_equal(np.asarray(fewer.number), np.asarray(found.number))


@pytest.mark.slow
def test_bearing_force_sums_the_orders_of_all_bearings():
    """Half the squares of all amplitudes, by Parseval; and its derivative is true."""
    settings = ("mesh.phases=32", "mesh.slices=2", "mesh.stiffness=iso6336")
    scene = example_scene("accessory", settings)
    model = model_of(scene)
    grid = jg.mesh_grid(model.pair, phases=64, slices=2)
    method = _method()

    @jax.jit
    def found(depth):
        tip = jg.TipRelief(depth * um, 0.25)
        own = dataclasses.replace(model, flanks=jg.Flanks(tip, tip))
        dynamics = jg.pair_dynamics(own, grid)
        orbit = method.orbit(dynamics.system, jnp.asarray(900.0))
        orders = jg.dynamic_response(dynamics, orbit, 8).bearing_orders[:, :, :3]
        return optimise.BearingForce(1e-3)(dynamics, orbit, method.law), orders

    value, orders = found(5.0)
    assert orders.shape[1] == 4
    assert float(value) == pytest.approx(np.sqrt(0.5 * np.sum(np.asarray(orders) ** 2)), rel=1e-3)
    slope = float(jax.grad(lambda depth: found(depth)[0])(5.0))
    above, below = (float(found(5.0 + side * 1e-4)[0]) for side in (1.0, -1.0))
    assert slope == pytest.approx((above - below) / 2e-4, rel=1e-5)


@pytest.mark.slow
def test_no_derivative_at_a_fold():
    """A parametric oscillator's: regular below, refused where the branch turns back."""
    system = cases.sdof_parametric(steps=100)
    method = jg.HarmonicBalance(harmonics=10, averaged=True)
    orbit = eqx.filter_jit(method.orbit)(system, jnp.asarray(0.5))
    assert 0.01 < optimise.require_regular(system, orbit, method) <= 1.5
    curve = jg.continuation(system, 0.6, 1.1, method=method)
    assert curve.folds
    fold = curve.folds[0]
    balance = jg.harmonic_balance_problem(method, system)
    at_fold, _ = method.solve(balance, jnp.asarray(fold.speed), jnp.asarray(fold.terms))
    with pytest.raises(ValueError, match=r"at a fold, or close to one: condition"):
        optimise.require_regular(system, at_fold, method)
    lost = dataclasses.replace(method, most_steps=1)
    with pytest.raises(ValueError, match=r"finds no response"):
        optimise.require_regular(system, dataclasses.replace(orbit, place=0.0 * orbit.place), lost)


def test_powers_below_one_are_refused():
    with pytest.raises(ValueError, match=r"must be at least 1, got 0\.5"):
        _over(power=0.5)


_SCENE = (
    "mesh.phases=8",
    "mesh.slices=2",
    "mesh.stiffness=constant",
    "mesh.stiffness_N_mm_um=14.0",
)
_WANTED = {"optimise.minimise": "dynamic_ratio"}


def test_a_scene_without_speeds_is_told_so():
    with pytest.raises(SceneError, match=r"no such table. Add one, such as:\n\[sweep\]"):
        require_searchable(example_scene("accessory", _SCENE).replace(_WANTED))


@pytest.mark.slow
def test_a_scene_over_its_speeds():
    """The value is the mean of what each speed is judged to contribute."""
    sweep = ("sweep.pinion_speed_rad_s=[600.0, 900.0]", "sweep.steps=32", "sweep.harmonics=8")
    scene = example_scene("accessory", (*_SCENE, *sweep)).replace(_WANTED)
    keys = tuple(scene.value("optimise.vary"))
    space = design_space(BuiltScene(scene), keys, symmetric=True, deflection=10.0)
    grid = grid_of(scene, space.base)
    assert objective_unit(scene.optimise) == "-"
    task = task_of(space, grid, ExactContact(), None)
    value = jax.jit(lambda x: objective_at(task, x, ExactContact()))
    point = np.array([10.0, 0.25])
    ((torque, found),) = judged_speeds(space, grid, ExactContact())(point)
    assert torque == 80.0
    assert bool(jnp.all(found.kept))
    expected = np.asarray(found.number).mean()
    assert float(value(jnp.asarray(point))) == pytest.approx(expected, rel=1e-10)
