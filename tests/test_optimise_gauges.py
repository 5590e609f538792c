"""Stress at gauges as what a search makes small: values, derivatives, refusals."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient
from hybrid_cases import APART, PAIRS, ROUND, body, heated, relieved
from tiny_cases import tiny_scene

import jaxgear as jg
import optimise
from jaxgear import MPa, um
from jaxgear._checks import InputError
from jaxgear._system._body_tables import flexible_body
from jaxgear.scene._scene import read_scene
from jaxgear.study._built import BuiltScene
from jaxgear.study._gauge_tables import gauge_tables
from jaxgear.study._objectives import CRITERIA

_STRAIN = np.array([9e-4, 3e-4])


@functools.cache
def _case():
    """A heated wheel, two gauges that read anything, and a cycle."""
    pair, own, heat = PAIRS["helical"](), body("helical"), heated("helical")
    grid = jg.mesh_grid(pair, phases=8, slices=2, periods=1)
    flexible = flexible_body(own, pair, 1, grid, heat=heat.load)
    flexible = eqx.tree_at(lambda b: b.heat.strain, flexible, jnp.asarray(_STRAIN))
    model = jg.PairModel(
        pair, 100.0, relieved(), APART, wheel_support=ROUND, wheel_body=flexible, speed=700.0
    )
    draw = np.random.default_rng(4)
    # Of the size of stresses of steel: some megapascals.
    rows = 1e12 * draw.normal(size=(14, own.dofs))
    gauges = jg.gauge_influences(
        own,
        rows,
        draw.normal(size=14),
        pair,
        1,
        grid,
        components=flexible.components,
        heat=(1e9 * draw.normal(size=(14, 2)), heat.load),
    )
    return model, grid, gauges


@pytest.mark.slow
def test_stresses_of_a_search_are_those_that_gauges_read():
    model, grid, gauges = _case()
    cycle = eqx.filter_jit(jg.mesh_cycle)(model, grid)
    read = eqx.filter_jit(jg.gauge_readings)
    found, _ = read(gauges, model.pair, cycle, model.speed, jnp.asarray(_STRAIN))
    each = np.asarray(found).reshape(len(found), 2, 7)
    principal = np.linalg.eigvalsh(each[..., [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]).max() / MPa
    amplitude = 0.5 * np.ptp(each[..., 6], axis=0).max() / MPa
    for kind, wanted in (
        (optimise.GaugeStress, principal),
        (optimise.GaugeStressAmplitude, amplitude),
    ):
        # Sharp, it is the largest; as it is, a little above.
        sharp, smooth = kind(gauges=(gauges,), width=1e-3 * MPa), kind(gauges=(gauges,))
        judge = eqx.filter_jit(lambda one: one(model, cycle, jg.ExactContact()))
        assert_close(float(judge(sharp)), wanted, rtol=1e-4, atol=0.0)
        assert wanted < float(judge(smooth)) < wanted + 10.0 * float(smooth.width) / MPa


@pytest.mark.slow
@pytest.mark.parametrize("kind", [optimise.GaugeStress, optimise.GaugeStressAmplitude])
def test_stresses_of_a_search_have_derivatives(kind):
    """By flanks, torque, speed and temperatures."""
    model, grid, gauges = _case()
    law, objective = jg.SmoothContact(0.5 * um), kind(gauges=(gauges,))

    def judged(moved):
        flanks, torque, speed, strain = moved
        places = lambda m: (m.flanks, m.torque, m.speed, m.wheel_body.heat.strain)
        own = eqx.tree_at(places, model, (flanks, torque, speed, strain))
        return objective(own, jg.mesh_cycle(own, grid, law=law), law)

    moved = (model.flanks, model.torque, model.speed, jnp.asarray(_STRAIN))
    assert_gradient(eqx.filter_jit(judged), moved, rtol=1e-5)


_VARY = '[optimise]\nvary = ["pinion.profile_shift"]\n'
_GAUGE = """[[gauges]]
gear = "wheel"
radius_mm = 22.0
height_mm = 1.5
"""


def _refused(path, text, varied=()):
    path.write_text(tiny_scene(modes=2, gear_at=20.0) + text)
    return lambda: gauge_tables(BuiltScene(read_scene(path)), varied)


def test_searches_say_what_they_need_of_gauges(tmp_path):
    path = tmp_path / "tiny.toml"
    asked = f'{_VARY}minimise = "max_gauge_stress"\n'
    with pytest.raises(InputError, match=r"optimise\.minimise names stress at gauges"):
        _refused(path, asked)()
    limited = f"{_VARY}[optimise.limits]\ngauge_stress_amplitude_MPa = 90.0\n"
    with pytest.raises(InputError, match=r"limits\.gauge_stress_amplitude_MPa names stress"):
        _refused(path, limited)()
    assert _refused(path, f'{_VARY}minimise = "te_rms"\n')() == ()
    names = {"max_gauge_stress", "gauge_stress_amplitude"}
    assert names <= set(CRITERIA)


def test_gauges_that_stand_still_and_other_materials_are_refused(tmp_path):
    path = tmp_path / "tiny.toml"
    text = f'{_VARY}minimise = "gauge_stress_amplitude"\n'
    fixed = text + _GAUGE + 'frame = "fixed"\n'
    path.write_text(tiny_scene(modes=2, gear_at=20.0) + fixed)
    scene = read_scene(path)
    object.__setattr__(scene, "bodies", {"wheel": None})
    with pytest.raises(InputError, match="one that stands"):
        gauge_tables(BuiltScene(scene), ())
    path.write_text(tiny_scene(modes=2, gear_at=20.0) + text + _GAUGE)
    scene = read_scene(path)
    object.__setattr__(scene, "bodies", {"wheel": None})
    with pytest.raises(InputError, match="change in themselves"):
        gauge_tables(BuiltScene(scene), ("wheel.body.young_GPa",))
