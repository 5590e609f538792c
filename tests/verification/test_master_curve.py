"""The Master Curve against the whole model: closed form, numeric table, and a real gear pair.

Thin slices of constant stiffness and rigid supports make its closed form exact;
the derivation is one of loads on pairs a base pitch apart, so the library's cycle is the test.
"""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, observed_order, quick
from solve_cases import (
    ACCESSORY,
    FZG_C14,
    POWER,
    Drawing,
    lowest,
    symmetric_relief,
    with_contact_ratio,
)

import jaxgear as jg
from jaxgear import um

STIFFNESS = 14e9


def _deflection(drawing: Drawing, torque: float) -> float:
    """Normal deflection of one pair of slices that carries everything, F cos(beta_b) / (k' b)."""
    length = drawing.common_width / math.cos(drawing.base_helix)
    return drawing.force(torque) / (STIFFNESS * length)


def _short(extent: float, ratio: float) -> float:
    """A3.2, depth over deflection: lambda / (2 lambda - (eps - 1))."""
    run = extent * ratio
    return run / (2 * run - (ratio - 1))


@functools.cache
def _program(drawing: Drawing, phases: int, slices: int):
    """Mean and RMS of the normal approach at any torque, depth and extent: one program."""
    base = jg.PairModel(drawing.pair(), 1.0, compliance=jg.ConstantStiffness(STIFFNESS))
    grid = jg.mesh_grid(base.pair, phases=phases, slices=slices)

    @jax.jit
    def response(torque, depth, extent):
        flanks = symmetric_relief(depth, extent)
        model = eqx.tree_at(lambda m: (m.torque, m.flanks), base, (torque, flanks))
        cycle = jg.mesh_cycle(model, grid, throw=False)
        mean, rms = jg.cycle_mean(cycle, cycle.approach), jg.cycle_rms(cycle, cycle.approach)
        return mean, rms, jnp.all(cycle.converged)

    return response


def _response(drawing: Drawing, torque: float, *, phases: int, slices: int):
    """Mean and RMS of the normal approach over delta, as a function of E/delta, Gamma."""
    delta, program = _deflection(drawing, torque), _program(drawing, phases, slices)

    def checked(depth: float, extent: float) -> tuple[float, float]:
        given = (jnp.asarray(x) for x in (torque, depth * delta, extent))
        mean, rms, converged = program(*given)
        assert bool(converged)
        return float(mean) / delta, float(rms) / delta

    return checked


# Ratios of 1.42, 1.46, 1.17, 1.6, 1.93; extents as shares of Gamma*, all above a half.
SPUR = {
    "45/86": ACCESSORY,
    "16/24": FZG_C14,
    "1.17": with_contact_ratio(1.17),
    "1.6": with_contact_ratio(1.6),
    "1.93": with_contact_ratio(1.93),
}


@pytest.mark.parametrize("name", quick(1, SPUR))
def test_spur_pair_is_still_on_the_curve(name):
    drawing = SPUR[name]
    ratio = drawing.contact_ratio
    response = _response(drawing, 90.0, phases=64, slices=2)
    plain = response(0.0, 0.2)[1]
    assert_close(plain, 0.5 * math.sqrt((ratio - 1) * (2 - ratio)), rtol=1e-7, atol=0.0)
    for share in (0.53, 0.6, 0.75, 0.9, 0.99, 1.0):
        extent = share * (ratio - 1) / ratio
        mean, rms = response(_short(extent, ratio), extent)
        assert rms < 1e-10, (share, rms)
        # Still, and at the single pair's deflection: one pair carries all in effect.
        assert_close(mean, 1.0, rtol=1e-9, atol=0.0)
        # Off the curve it moves, so that stillness means something.
        assert response(1.1 * _short(extent, ratio), extent)[1] > 1e-3


@pytest.mark.parametrize("torque", [5.0, 900.0])
def test_curve_scales_with_the_load(torque):
    response = _response(ACCESSORY, torque, phases=64, slices=2)
    assert response(_short(0.25, ACCESSORY.contact_ratio), 0.25)[1] < 1e-10


def test_curve_is_the_computed_optimum():
    """The library's formula, the derivation's, and the minimum found by search are one depth."""
    import optimise

    ratio = ACCESSORY.contact_ratio
    response = _response(ACCESSORY, 80.0, phases=64, slices=2)
    for extent in (0.2, 0.25, 0.29):
        closed = _short(extent, ratio)
        best, _ = lowest(
            lambda e, extent=extent: response(e, extent)[1], 0.8 * closed, 1.2 * closed, within=1e-9
        )
        formula = optimise.master_curve_depth(
            jnp.asarray(extent), jnp.asarray(ratio), jnp.asarray(1.0)
        )
        assert_close(formula, closed, rtol=1e-12, atol=0.0)
        assert_close(best, closed, rtol=1e-6, atol=0.0)


HELICAL = {
    "35/68": POWER,
    "narrow": with_contact_ratio(1.6, helix_angle=math.radians(10.0), face_width=0.01),
    "wide": with_contact_ratio(1.4, helix_angle=math.radians(25.0), face_width=0.03),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", quick(1, HELICAL))
def test_helical_pair_is_still_on_the_curve(name):
    """The same curve for any overlap: every slice alone carries a constant load.

    Inside Gamma* the ends of the path are open, so slices cut by them do not matter.
    """
    drawing = HELICAL[name]
    ratio = drawing.contact_ratio
    response = _response(drawing, 90.0, phases=48, slices=64)
    plain = response(0.0, 0.2)[1]
    for share in (0.6, 0.8, 0.9):
        extent = share * (ratio - 1) / ratio
        mean, rms = response(_short(extent, ratio), extent)
        assert rms < 1e-10
        assert_close(mean, 1.0, rtol=1e-9, atol=0.0)
    assert plain > 1e-3


@pytest.mark.slow
def test_helical_residual_at_the_longest_relief_falls_with_the_slices():
    """At Gamma* the ends are just closing: slices cut by the end of the path carry wrongly.

    Loads there grow linearly over a stretch that shrinks with the slices: second order, with
    scatter from where the slices happen to fall.
    """
    extent = (POWER.contact_ratio - 1) / POWER.contact_ratio
    slices = np.array([10, 20, 40, 80])
    residual = []
    for count in slices:
        response = _response(POWER, 90.0, phases=4 * int(count), slices=int(count))
        residual.append(response(1.0, extent)[1])
    assert 1.7 < observed_order(1 / slices, residual, bend=0.6) < 2.6
    assert residual[-1] < 2e-5


# eps_alpha = 1.6, Gamma* = 0.375, in units of delta: best depth and least RMS. The
# last two depths are of 200 000 points solved in closed form; A3.4 rounds them to its formula's.
TABLE = [
    (0.225, 3.00, 0.0),
    (0.25, 2.00, 0.0),
    (0.35, 1.077, 0.0),
    (0.375, 1.00, 0.0),
    (0.40, 0.9511, 0.00896),
    (0.50, 0.9664, 0.04487),
]


@pytest.fixture(scope="module")
def ratio_16():
    drawing = with_contact_ratio(1.6)
    return _response(drawing, 90.0, phases=400, slices=1)


@pytest.mark.parametrize(("extent", "depth", "least"), TABLE)
def test_numeric_table(ratio_16, extent, depth, least):
    best, rms = lowest(lambda e: ratio_16(e, extent)[1], 0.7 * depth, 1.3 * depth, within=1e-7)
    assert abs(best - depth) < 5e-4
    assert abs(rms - least) < 3e-5


@pytest.mark.parametrize(
    ("extent", "depth", "rms"),
    # The first-harmonic depth, A3.3, with the RMS that the table gives there.
    [(0.225, 3.138, 0.0074), (0.25, 2.214, 0.021), (0.35, 1.084, 0.0017), (0.5, 0.970, 0.0449)],
)
def test_first_harmonic_column(ratio_16, extent, depth, rms):
    run = 1.6 * extent
    sines = math.sin(math.pi * (1.6 - run)) * math.sin(math.pi * run)
    formula = 1 / 1.6 / (1 - extent - sines / (math.pi * run * math.sin(math.pi * 1.6)))
    assert_close(formula, depth, rtol=6e-4, atol=0.0)
    # The table rounds to two digits.
    assert_close(ratio_16(formula, extent)[1], rms, rtol=5e-2, atol=0.0)


@pytest.mark.parametrize(
    ("load", "short", "long"),
    [(0.5, 0.083, 0.111), (0.75, 0.046, 0.059), (1.25, 0.052, 0.061), (1.5, 0.105, 0.122)],
)
def test_off_design_loads(load, short, long):
    """RMS over the design deflection, at other loads."""
    drawing = with_contact_ratio(1.6)
    response = _response(drawing, 90.0 * load, phases=400, slices=1)
    # Depths and RMS are counted in the deflection of the load that acts.
    assert_close(load * response(2.0 / load, 0.25)[1], short, rtol=1e-2, atol=0.0)
    assert_close(load * response(1.0 / load, 0.375)[1], long, rtol=1e-2, atol=0.0)


# --- the accessory pair of the thesis, Weber-Banaschek stiffness, only turning, 80 N m


@pytest.fixture(scope="module")
def accessory():
    base = jg.PairModel(ACCESSORY.pair(), 80.0)
    grid = jg.mesh_grid(base.pair, phases=96, slices=2)

    @jax.jit
    def rms(depth, extent):
        model = eqx.tree_at(lambda m: m.flanks, base, symmetric_relief(depth * um, extent))
        cycle = jg.mesh_cycle(model, grid, throw=False)
        error = jg.transmission_error(model.pair, cycle)
        return jg.cycle_rms(cycle, error) / um, jg.cycle_mean(cycle, error) / um

    return lambda depth, extent: [float(x) for x in rms(jnp.asarray(depth), jnp.asarray(extent))]


@pytest.mark.slow
def test_accessory_pair_plain(accessory):
    """Rigid slice model, 9.5 mm: RMS 2.36 um, mean 9.87 um."""
    rms, mean = accessory(0.0, 0.25)
    assert 2.3 < rms < 2.5
    assert_close(mean, 9.87, rtol=2e-2, atol=0.0)


@pytest.mark.slow
def test_accessory_pair_best_depth(accessory):
    """A third less stiff at its ends than in its middle: 0.80 to 0.90 of the closed form."""
    load = 80.0 / ACCESSORY.base_radius[0] / ACCESSORY.common_width
    pair = ACCESSORY.pair()
    stiffness = eqx.filter_jit(jg.single_pair_stiffness)
    largest = stiffness(pair, jg.WeberBanaschek(face_coupling=None), jnp.asarray(load))
    assert_close(largest, 23.63e9, rtol=2e-2, atol=0.0)
    delta = load / float(largest) / um
    closed = delta * _short(0.25, ACCESSORY.contact_ratio)
    assert_close(closed, 14.3, rtol=1e-2, atol=0.0)
    best, rms = lowest(lambda e: accessory(e, 0.25)[0], 0.5 * closed, 1.5 * closed, within=1e-4)
    assert 0.80 < best / closed < 0.90
    assert rms < 0.3
