"""What the thesis finds in motion, over a range of shafts and damping that it does not give.

Its shafts are unknown: trends count, not curves.
"""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from thesis_rows.drawn_errors import PLACES, profile_error
from thesis_rows.statics import THESIS

import jaxgear as jg
from jaxgear import um

pytestmark = pytest.mark.slow

_SPEEDS = np.linspace(20.0, 2000.0, 200)


@functools.cache
def _base():
    model = jg.model_of(jg.example_scene("accessory", THESIS))
    return model, jg.mesh_grid(model.pair, phases=100, slices=10)


@jax.jit
def _ratios(depth, bearing, mesh, structure):
    """Dynamic ratio at each speed, each from the quasi-static states, and where it has settled."""
    model, grid = _base()
    radial = lambda s: [x for b in s.bearings for x in (b.radial_s, b.radial_t)]
    shafts = [
        eqx.tree_at(radial, shaft, replace_fn=lambda x: bearing)
        for shaft in (model.pinion_support, model.wheel_support)
    ]
    tip = jg.TipRelief(depth, 0.25)
    model = dataclasses.replace(
        model, flanks=jg.Flanks(tip, tip), pinion_support=shafts[0], wheel_support=shafts[1]
    )
    system = jg.pair_dynamics(model, grid, jg.ModalDamping(mesh, structure)).system
    orbits = jg.steady_states(system, jnp.asarray(_SPEEDS))
    return jax.vmap(lambda orbit: jg.dynamic_ratio(system, orbit))(orbits), orbits.settled


@pytest.mark.parametrize("bearing", [1e8, 5e8, 1.04e9, 2e9])
@pytest.mark.parametrize("structure", [0.01, 0.02])
@pytest.mark.parametrize("mesh", [0.05, 0.07])
def test_relief_on_the_master_curve_lowers_the_dynamic_ratio(bearing, structure, mesh):
    """Fig. IV-4, 0 to 2000 rad/s: at every speed, and its peak from above 3 to below 2."""
    _base()
    found = [_ratios(*map(jnp.asarray, (d, bearing, mesh, structure))) for d in (0.0, 15.0 * um)]
    settled = np.asarray(found[0][1] & found[1][1])
    plain, relieved = (np.asarray(ratio)[settled] for ratio, _ in found)
    assert settled.sum() >= 190
    assert plain.max() > 3.0
    assert relieved.max() < 2.0
    assert np.all(relieved < plain - 0.1)
    assert relieved.mean() < 0.7 * plain.mean()


# --- Fig. IV-12: jumps, with profile errors on linear and on parabolic relief

# Of the relief on both flanks; of the profile errors from valley to peak, ISO grade 7.
_DEPTH, _EXTENT, _ERROR = 15.0 * um, 0.25, 13.0 * um
_METHOD = jg.HarmonicBalance(averaged=True)


@jax.jit
def _deviating(linear, parabolic, error, torque, bearing, mesh, structure):
    """The pair with both kinds of relief on both flanks, and profile errors of the pinion."""
    model, grid = _base()
    radial = lambda s: [x for b in s.bearings for x in (b.radial_s, b.radial_t)]
    shafts = [
        eqx.tree_at(radial, shaft, replace_fn=lambda x: bearing)
        for shaft in (model.pinion_support, model.wheel_support)
    ]
    relief = jg.TipRelief(linear, _EXTENT), jg.TipRelief(parabolic, _EXTENT, 2)
    pinion = jg.Superposed((*relief, jg.MeasuredProfile(PLACES, error)))
    model = dataclasses.replace(
        model,
        torque=torque,
        flanks=jg.Flanks(pinion, jg.Superposed(relief)),
        pinion_support=shafts[0],
        wheel_support=shafts[1],
    )
    return jg.pair_dynamics(model, grid, jg.ModalDamping(mesh, structure)).system


_balance = jax.jit(jg.harmonic_balance_problem)


@jax.jit
def _mean_load(balance, speed, terms):
    """Mean contact force over the static one, and whether the response is one."""
    orbit, _ = _METHOD.solve(balance, speed, terms)
    share = balance.system.table.lengths / balance.system.table.periods
    return jnp.sum(share * orbit.load[:, 0]) / balance.system.force, orbit.settled


def _folding(relief, error, torque, bearing, damping):
    """How far speed turns back on the branch from 200 to 2000 rad/s, at each pair of folds."""
    depths = [_DEPTH * (relief == shape) for shape in ("linear", "parabolic")]
    values = (*depths, error, torque, bearing, *damping)
    system = _deviating(*(jnp.asarray(x, dtype=float) for x in values))
    curve = jg.continuation(system, 200.0, 2000.0, method=_METHOD, stability=False)
    assert curve.ends == ("began", "left")
    balance = _balance(_METHOD, system)
    for i in np.linspace(0, curve.speed.size - 1, 8).astype(int):
        carried, settled = _mean_load(balance, *map(jnp.asarray, (curve.speed[i], curve.terms[i])))
        assert settled
        assert abs(carried - 1.0) < 0.01
    turns = [fold.speed for fold in curve.folds]
    return [up - down for up, down in zip(turns[::2], turns[1::2], strict=True)]


_SHAFTS = pytest.mark.parametrize("bearing", [1e8, 1.04e9])
_NONE = np.zeros_like(PLACES)
_USUAL, _LOW = (0.07, 0.02), (0.05, 0.01)


@_SHAFTS
def test_relief_of_either_shape_removes_jumps_from_flanks_without_errors(bearing):
    """With the scene's damping, at the load that the relief is made for."""
    _base()
    assert max(_folding("none", _NONE, 80.0, bearing, _USUAL)) > 20.0
    assert _folding("linear", _NONE, 80.0, bearing, _USUAL) == []
    assert _folding("parabolic", _NONE, 80.0, bearing, _USUAL) == []


@_SHAFTS
def test_which_relief_is_free_of_jumps_without_errors_depends_on_the_load(bearing):
    """With little damping: linear at the load that it is made for, parabolic at half of it."""
    _base()
    assert sum(_folding("linear", _NONE, 80.0, bearing, _LOW)) < 5.0
    assert max(_folding("parabolic", _NONE, 80.0, bearing, _LOW)) > 20.0
    assert max(_folding("linear", _NONE, 40.0, bearing, _LOW)) > 20.0
    assert _folding("parabolic", _NONE, 40.0, bearing, _LOW) == []


@_SHAFTS
@pytest.mark.parametrize("damping", [_USUAL, _LOW], ids=["usual", "low"])
def test_parabolic_relief_does_not_remove_jumps_from_flanks_with_errors(bearing, damping):
    """Against Fig. IV-12: with errors of 13 um both shapes jump, and about as far."""
    _base()
    widths = {
        relief: [
            max(_folding(relief, profile_error(_ERROR, seed), 80.0, bearing, damping), default=0.0)
            for seed in (1, 2, 3)
        ]
        for relief in ("linear", "parabolic")
    }
    assert min(widths["linear"]) > 10.0
    assert min(widths["parabolic"]) > 10.0
    assert 0.5 < sum(widths["parabolic"]) / sum(widths["linear"]) < 2.0
