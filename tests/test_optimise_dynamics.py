"""Objectives over a range of speeds: means, what is left out, derivatives, folds, and scenes."""

import dataclasses
import functools

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
from jaxgear._app._design import design_space, judged_speeds, objective_function, objective_of
from jaxgear._app._model import grid_of
from jaxgear._app._scene import ready_scene
from jaxgear._checks import InputError
from jaxgear._interface._laws import ExactContact

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


def _over(**settings):
    settings = {"method": _method(), "speeds": jnp.asarray(_SPEEDS)} | settings
    return optimise.OverSpeeds(optimise.DynamicRatio(), grid=_pair()[1], **settings)


def _relieved(values):
    depth, extent = values
    tip = jg.TipRelief(depth * um, extent)
    return dataclasses.replace(_pair()[0], flanks=jg.Flanks(tip, tip))


@eqx.filter_jit
def _judged(objective, values):
    model = _relieved(values)
    cycle = jg.mesh_cycle(model, _pair()[1])
    value = lambda o: o(model, cycle, jg.ExactContact())
    return objective.judged(model, jg.ExactContact()), [
        value(dataclasses.replace(objective, power=power)) for power in (1.0, 8.0, np.inf)
    ]


_DESIGN = jnp.array([8.0, 0.25])


def test_mean_power_mean_and_worst():
    found, values = _judged(_over(), _DESIGN)
    assert bool(jnp.all(found.kept))
    number = np.asarray(found.number)
    assert float(values[0]) == pytest.approx(number.mean(), rel=1e-12)
    assert float(values[1]) == pytest.approx(np.mean(number**8) ** 0.125, rel=1e-12)
    assert float(values[2]) == pytest.approx(number.max(), rel=1e-12)
    assert number.max() > 1.2


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


def test_speeds_that_have_not_settled_are_left_out_and_counted():
    """One Newton step is too few for them; a fall below half of the speeds is no number."""
    found, values = _judged(_over(method=_method(most_steps=1)), _DESIGN)
    assert not bool(jnp.any(found.settled))
    assert found.left_out.size == _SPEEDS.size
    assert all(np.isnan(float(value)) for value in values)


def test_speeds_that_are_too_sensitive_are_left_out():
    """The mean is that over the others."""
    found, _ = _judged(_over(), _DESIGN)
    limit = np.sort(np.asarray(found.sensitivity))[2:].mean()
    fewer, values = _judged(_over(most_sensitive=limit), _DESIGN)
    assert fewer.left_out.size == 1
    kept = np.asarray(fewer.kept)
    assert float(values[0]) == pytest.approx(np.asarray(found.number)[kept].mean(), rel=1e-12)


def test_no_derivative_at_a_fold():
    """A parametric oscillator's: regular below, refused where the branch turns back."""
    system = cases.sdof_parametric(steps=100)
    method = jg.HarmonicBalance(harmonics=10, averaged=True)
    orbit = eqx.filter_jit(method.orbit)(system, jnp.asarray(0.5))
    assert 0.01 < optimise.require_regular(system, orbit, method) <= 1.5
    curve = jg.continuation(system, 0.6, 1.1, method=method)
    assert curve.folds
    fold = curve.folds[0]
    balance = jg.balance_of(method, system)
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
    with pytest.raises(InputError, match=r"no such table. Add one, such as:\n\[sweep\]"):
        objective_of(ready_scene("accessory", _SCENE).replace(_WANTED))


def test_a_scene_over_its_speeds():
    """The value is the mean of what each speed is judged to contribute."""
    sweep = ("sweep.pinion_speed_rad_s=[600.0, 900.0]", "sweep.steps=32", "sweep.harmonics=8")
    scene = ready_scene("accessory", (*_SCENE, *sweep)).replace(_WANTED)
    space = design_space(scene, tuple(scene["optimise.vary"]), symmetric=True, deflection=10.0)
    grid = grid_of(scene, space.base)
    assert objective_of(scene)[1] == "-"
    value = jax.jit(objective_function(space, grid, ExactContact(), None))
    point = np.array([10.0, 0.25])
    ((torque, found),) = judged_speeds(space, grid, ExactContact(), point)
    assert torque == 80.0
    assert bool(jnp.all(found.kept))
    expected = np.asarray(found.number).mean()
    assert float(value(jnp.asarray(point))) == pytest.approx(expected, rel=1e-10)
