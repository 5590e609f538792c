"""Derivatives of steady responses, in everything a pair is made of, against central differences."""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import quick

import jaxgear as jg
from jaxgear import um
from jaxgear._dynamics._damping import ModalDamping
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._pair_dynamics import pair_dynamics
from jaxgear._response._dynamic import (
    bearing_loads,
    contact_force,
    dynamic_transmission_error,
    orbit_variance,
    order_amplitudes,
    smooth_dynamic_ratio,
)

# Each variable is a factor on its own value, so that every derivative is per relative change.
_VARIABLES = (
    "pinion depth",
    "pinion extent",
    "wheel depth",
    "wheel extent",
    "helix slope",
    "mesh damping",
    "structure damping",
    "pinion bearings along S",
    "all bearings",
    "mesh stiffness",
    "shaft length",
    "torque",
    "density",
    "speed",
)


_METHODS = {
    "exact": HarmonicBalance(harmonics=10, tolerance=1e-12),
    "averaged": HarmonicBalance(harmonics=10, tolerance=1e-12, averaged=True),
    "smooth": HarmonicBalance(law=jg.SmoothContact(0.3 * um), harmonics=10, tolerance=1e-12),
}


@functools.cache
def _base():
    """The accessory pair on its shafts, whose bearings are as stiff along S as along T."""
    model = jg.model_of(jg.example_scene("accessory"))
    grid = jg.mesh_grid(model.pair, phases=32, slices=4)
    return dataclasses.replace(model, compliance=jg.ConstantStiffness(14e9)), grid


def _scaled(where, tree, factor):
    return eqx.tree_at(where, tree, replace_fn=lambda x: factor * x)


def _dynamics(factors):
    base, grid = _base()
    by = dict(zip(_VARIABLES, factors, strict=True))
    pinion = jg.TipRelief(10.0 * um * by["pinion depth"], 0.25 * by["pinion extent"])
    wheel = jg.TipRelief(8.0 * um * by["wheel depth"], 0.3 * by["wheel extent"])
    slope = jg.HelixSlope(4.0 * um * by["helix slope"])
    shaft = base.pinion_support
    radial = lambda s: [x for b in s.bearings for x in (b.radial_s, b.radial_t)]
    shaft = _scaled(radial, shaft, by["all bearings"])
    along = lambda s: [b.radial_s for b in s.bearings]
    shaft = _scaled(along, shaft, by["pinion bearings along S"])
    ends = lambda s: (s.segments[0].length, s.bearings[1].at)
    shaft = _scaled(ends, shaft, by["shaft length"])
    steel = lambda p: (p.pinion.material.density, p.wheel.material.density)
    model = dataclasses.replace(
        base,
        pair=_scaled(steel, base.pair, by["density"]),
        torque=base.torque * by["torque"],
        flanks=jg.Flanks(jg.Superposed((pinion, slope)), wheel),
        compliance=jg.ConstantStiffness(14e9 * by["mesh stiffness"]),
        pinion_support=_scaled(lambda s: s.material.density, shaft, by["density"]),
    )
    damping = ModalDamping(0.07 * by["mesh damping"], 0.02 * by["structure damping"])
    return pair_dynamics(model, grid, damping)


def _responses(factors, speed, names):
    """By some methods, and the least contact force and whether it has settled."""
    dynamics = _dynamics(factors)
    system = dynamics.system
    values, seen = [], []
    for name in names:
        orbit = _METHODS[name].orbit(system, speed * factors[-1])
        error = dynamic_transmission_error(system, orbit)
        order = order_amplitudes(system, bearing_loads(dynamics, orbit), 1)[0]
        values += [
            orbit_variance(system, error) / um**2,
            smooth_dynamic_ratio(system, orbit, jnp.asarray(0.02)),
            order[0, 0],
            order[0, 1],
            order[2, 0],
        ]
        seen.append((jnp.min(contact_force(system, orbit)) / system.force, orbit.settled))
    return jnp.stack(values), seen


@functools.partial(jax.jit, static_argnames="names")
def _derivatives(factors, speed, names):
    """Values, and derivatives in both directions: one program, one column after the other."""
    value, push, seen = jax.linearize(lambda x: _responses(x, speed, names), factors, has_aux=True)
    pull = jax.linear_transpose(lambda moved: push(moved), factors)
    forward = jax.lax.map(lambda moved: push(moved), jnp.eye(factors.size)).T
    reverse = jax.lax.map(lambda weights: pull(weights)[0], jnp.eye(value.size))
    return value, forward, reverse, seen


def _differences(speed, step, names):
    """Central differences of orbits that have converged to rounding, extrapolated from two steps.

    Frequencies that coincide part with a factor on one direction: what follows bends a lot.
    """
    columns = []
    for index in range(len(_VARIABLES)):
        slopes = []
        for width in (step, 0.5 * step):
            ends = []
            for side in (1.0, -1.0):
                factors = np.ones(len(_VARIABLES))
                factors[index] += side * width
                ends.append(np.asarray(_derivatives(jnp.asarray(factors), speed, names)[0]))
            slopes.append((ends[0] - ends[1]) / (2.0 * width))
        columns.append((4.0 * slopes[1] - slopes[0]) / 3.0)
    return np.stack(columns, axis=1)


@pytest.fixture
def traced(names):
    """All derivatives at once: a program that takes longer to trace than all that it is asked."""
    _base()
    ones, speed = jnp.ones(len(_VARIABLES)), jnp.asarray(700.0)
    jax.block_until_ready(_derivatives(ones, speed, names))


@pytest.mark.usefixtures("traced")
@pytest.mark.parametrize(
    ("speed", "parts", "names"),
    quick(
        1,
        [
            (1000.0, True, ("exact",)),
            (1000.0, True, ("averaged", "smooth")),
            (700.0, False, tuple(_METHODS)),
        ],
    ),
)
def test_steady_responses_have_derivatives_in_everything(speed, parts, names):
    """In both directions, to 1e-5 of central differences."""
    speed = jnp.asarray(speed)
    value, forward, reverse, seen = _derivatives(jnp.ones(len(_VARIABLES)), speed, names)
    assert all(bool(settled) for _, settled in seen)
    assert all((float(least) <= 0.0) == parts for least, _ in seen)
    # Shorter where cells part; rounding shows below, what bends above.
    expected = _differences(speed, 6e-5 if parts else 1.2e-4, names)
    size = np.maximum(np.abs(expected), 1e-3 * np.abs(np.asarray(value))[:, None])
    for found in (forward, reverse):
        wrong = np.abs(np.asarray(found) - expected) / size
        assert wrong.max() < 1e-5, (_VARIABLES[int(wrong.max(axis=0).argmax())], wrong.max())
    # All of them matter.
    assert np.all(np.abs(expected / np.asarray(value)[:, None]).max(axis=0) > 1e-3)
