"""Objectives of whole designs: values, gradients, and an optimisation from start to end."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, quick
from solve_cases import ACCESSORY, POWER, spread, symmetric_relief

import jaxgear as jg
import optimise
from jaxgear import MPa, um

BASE = jg.PairModel(ACCESSORY.pair(), 80.0)
CONSTANT = jg.PairModel(ACCESSORY.pair(), 80.0, compliance=jg.ConstantStiffness(23e9))
HELICAL = jg.PairModel(POWER.pair(), 300.0, compliance=jg.ConstantStiffness(14e9))
EXACT = jg.ExactContact()
SMOOTH = jg.SmoothContact(1 * um)


def _design(base: jg.PairModel):
    """Depth in um and extent of both gears' relief."""

    def model(variables):
        flanks = symmetric_relief(variables[0] * um, variables[1])
        return eqx.tree_at(lambda m: m.flanks, base, flanks)

    return model


_GRID = jg.mesh_grid(CONSTANT.pair, phases=32, slices=2)


@pytest.fixture(scope="module")
def settled():
    model = _design(CONSTANT)(jnp.asarray([8.0, 0.25]))
    return model, jg.mesh_cycle(model, _GRID)


@pytest.fixture(scope="module")
def sloped():
    """Wide helical gears with a helix slope."""
    model = eqx.tree_at(lambda m: m.flanks, HELICAL, jg.Flanks(jg.HelixSlope(12 * um)))
    return model, jg.mesh_cycle(model, jg.mesh_grid(model.pair, phases=8, slices=8))


def test_variance_is_the_square_of_the_rms_in_um(settled):
    model, cycle = settled
    error = np.asarray(cycle.approach) / um
    found = optimise.TransmissionErrorVariance()(model, cycle, EXACT)
    assert_close(found, spread(cycle, error) ** 2, rtol=1e-12, atol=0.0)
    # Rounded at its cone by 0.01 um: hypot(rms, 0.01).
    found = optimise.TransmissionErrorRms(0.01 * um)(model, cycle, EXACT)
    assert_close(found, math.hypot(spread(cycle, error), 0.01), rtol=1e-12, atol=0.0)


def test_variance_of_the_plain_pair_by_hand():
    """delta^2 (eps - 1)(2 - eps) / 4, in um2."""
    model = _design(CONSTANT)(jnp.asarray([0.0, 0.25]))
    cycle = jg.mesh_cycle(model, _GRID)
    delta = ACCESSORY.force(80.0) / (23e9 * ACCESSORY.common_width) / um
    ratio = ACCESSORY.contact_ratio
    found = optimise.TransmissionErrorVariance()(model, cycle, EXACT)
    assert_close(found, 0.25 * delta**2 * (ratio - 1) * (2 - ratio), rtol=1e-6, atol=0.0)


@pytest.mark.slow
def test_variance_of_a_helical_pair_is_transverse(sloped):
    model, cycle = sloped
    transverse = np.asarray(cycle.approach) / math.cos(POWER.base_helix) / um
    found = optimise.TransmissionErrorVariance()(model, cycle, EXACT)
    assert_close(found, spread(cycle, transverse) ** 2, rtol=1e-9, atol=0.0)


def test_chosen_harmonics_are_their_part_of_the_variance(settled):
    """Half the squares of their amplitudes; all of them are the whole, up to uneven phases."""
    model, cycle = settled
    amplitude = np.asarray(jg.harmonic_amplitudes(cycle, cycle.approach, 3)) / um
    some = optimise.TransmissionErrorHarmonics((1, 3))(model, cycle, EXACT)
    assert_close(some, 0.5 * (amplitude[0] ** 2 + amplitude[2] ** 2), rtol=1e-12, atol=0.0)
    whole = float(optimise.TransmissionErrorVariance()(model, cycle, EXACT))
    every = float(optimise.TransmissionErrorHarmonics(tuple(range(1, 16)))(model, cycle, EXACT))
    assert_close(every, whole, rtol=0.02, atol=0.0)
    with pytest.raises(ValueError, match="harmonics from 1"):
        optimise.TransmissionErrorHarmonics((0, 1))


def test_range_is_a_bound_of_the_peak_to_peak_in_um(settled):
    model, cycle = settled
    exact = np.ptp(np.asarray(cycle.approach)) / um
    found = float(optimise.TransmissionErrorRange(0.01 * um)(model, cycle, EXACT))
    assert exact < found < exact + 2 * 0.01 * math.log(32) + 1e-9
    wide = float(optimise.TransmissionErrorRange(0.1 * um)(model, cycle, EXACT))
    assert wide > found


def test_largest_pressure_is_a_bound_in_megapascals(settled):
    model, cycle = settled
    exact = float(jnp.max(jg.hertz_pressure(model.pair, cycle, EXACT))) / MPa
    assert 300.0 < exact < 1500.0
    found = float(optimise.LargestPressure(1 * MPa)(model, cycle, EXACT))
    cells = cycle.force.size
    assert exact < found < exact + math.log(cells)


@pytest.mark.slow
def test_face_load_factor_is_a_bound(sloped):
    """The exact factor, and at most `width ln(slices)` above it."""
    model, cycle = sloped
    exact = float(jg.face_load_factor(cycle))
    assert 1.1 < exact < 2.0
    found = float(optimise.FaceLoadFactor(0.02)(model, cycle, EXACT))
    assert exact < found < exact + 0.02 * math.log(8)


def test_weighted_sum_by_hand(settled):
    model, cycle = settled
    parts = (optimise.TransmissionErrorVariance(), optimise.LargestPressure())
    values = [float(part(model, cycle, EXACT)) for part in parts]
    total = optimise.WeightedSum(parts, [2.0, 0.01])(model, cycle, EXACT)
    assert_close(total, 2.0 * values[0] + 0.01 * values[1], rtol=1e-13, atol=0.0)


@pytest.mark.slow
def test_torques_are_averaged_or_the_worst_taken_and_residuals_sum_to_their_mean():
    """Plain pair of constant stiffness: the variance goes with the square of the torque."""
    # The torque of the design itself is replaced.
    design = _design(eqx.tree_at(lambda m: m.torque, CONSTANT, jnp.asarray(7.0)))
    torques = jnp.asarray([40.0, 80.0, 120.0])
    settings: Any = dict(grid=jg.mesh_grid(CONSTANT.pair, phases=16, slices=1), law=EXACT)
    variance = optimise.TransmissionErrorVariance()
    mean, worst = (
        optimise.over_torques(design, variance, torques, worst=worst, **settings)
        for worst in (False, True)
    )
    residuals = optimise.residuals_over_torques(design, torques, **settings)
    found = jax.jit(lambda x: (mean(x), worst(x), jnp.sum(residuals(x) ** 2)))
    delta = ACCESSORY.force(80.0) / (23e9 * ACCESSORY.common_width) / um
    ratio = ACCESSORY.contact_ratio
    at_80 = 0.25 * delta**2 * (ratio - 1) * (2 - ratio)
    plain = found(jnp.asarray([0.0, 0.25]))
    expected = (at_80 * (0.25 + 1.0 + 2.25) / 3, at_80 * 2.25)
    assert_close(plain[:2], expected, rtol=1e-6, atol=0.0)
    relieved = found(jnp.asarray([8.0, 0.25]))
    assert_close(relieved[2], relieved[0], rtol=1e-12, atol=0.0)


@pytest.mark.slow
def test_what_the_variables_leave_alone_may_be_prepared():
    """Stiffness and system computed once: the same values and slopes."""
    grid = jg.mesh_grid(CONSTANT.pair, phases=8, slices=2)
    torques = jnp.asarray([60.0, 90.0])
    slow, fast = (
        optimise.over_torques(
            _design(CONSTANT),
            optimise.TransmissionErrorVariance(),
            torques,
            grid=grid,
            law=EXACT,
            prepared=prepared,
        )
        for prepared in (None, optimise.prepare_torques(CONSTANT, torques, grid))
    )
    point = jnp.asarray([9.0, 0.27])
    expected = jax.jit(jax.value_and_grad(slow))(point)
    assert_close(jax.jit(jax.value_and_grad(fast))(point), expected, rtol=1e-10, atol=0.0)


ALL = optimise.WeightedSum(
    (
        optimise.TransmissionErrorVariance(),
        optimise.TransmissionErrorRms(),
        optimise.TransmissionErrorRange(0.3 * um),
        optimise.LargestPressure(30 * MPa),
        optimise.FaceLoadFactor(0.1),
    ),
    [1.0, 2.0, 3.0, 1e-3, 1.0],
)
LAWS = {"exact": EXACT, "smooth": SMOOTH}


@pytest.mark.parametrize("law", quick(1, LAWS))
def test_gradients_of_all_objectives(law):
    """No cell is within a step of separation, so exact contact has a derivative too."""
    grid = jg.mesh_grid(CONSTANT.pair, phases=16, slices=2)
    function = optimise.over_torques(
        _design(CONSTANT),
        ALL,
        jnp.asarray([60.0, 90.0]),
        grid=grid,
        law=LAWS[law],
    )
    assert_gradient(function, jnp.asarray([4.3, 0.271]), rtol=1e-6, step=1e-5)


@pytest.mark.parametrize("law", ["exact", pytest.param("smooth", marks=pytest.mark.slow)])
@pytest.mark.slow
def test_gradients_with_cells_open_and_closed(law):
    """Crowning and relief of a helical pair, some of whose cells never touch."""

    def model(x):
        flank = jg.Superposed((jg.TipRelief(x[0] * um, x[1]), jg.Crowning(x[2] * um)))
        return eqx.tree_at(lambda m: m.flanks, HELICAL, jg.Flanks(flank, flank))

    grid = jg.mesh_grid(HELICAL.pair, phases=8, slices=8)
    variables = jnp.asarray([14.0, 0.25, 9.0])
    cycle = eqx.filter_jit(jg.mesh_cycle)(model(variables), grid)
    carried = cycle.cells.stiffness > 1.0
    assert bool(jnp.any(carried & (cycle.overlap < 0.0)))
    function = optimise.over_torques(
        model,
        optimise.TransmissionErrorVariance(),
        jnp.asarray([300.0]),
        grid=grid,
        law=LAWS[law],
    )
    assert_gradient(lambda x: 1e3 * function(x), variables, rtol=1e-5, step=1e-6)


@pytest.mark.slow
def test_gradient_by_the_gears_themselves():
    """Module, helix, shift: macro geometry through contact to the objective."""
    grid = jg.mesh_grid(HELICAL.pair, phases=8, slices=8)

    def model(x):
        changed = (x[0] * 1e-3, x[1], x[2])
        where = lambda m: (m.pair.normal_module, m.pair.helix_angle, m.pair.pinion.profile_shift)
        return eqx.tree_at(where, HELICAL, tuple(changed))

    function = optimise.over_torques(
        model,
        optimise.TransmissionErrorVariance(),
        jnp.asarray([300.0]),
        grid=grid,
        law=EXACT,
    )
    start = jnp.asarray([2.5, math.radians(12.0), 0.275])
    assert_gradient(lambda x: 1e3 * function(x), start, rtol=1e-5, step=1e-6)


# --- from start to end

BOX = optimise.Box([0.0, 0.05], [40.0, 0.5])


@pytest.fixture(scope="module")
def search():
    grid = jg.mesh_grid(BASE.pair, phases=64, slices=1)
    objective = optimise.over_torques(
        _design(BASE),
        optimise.TransmissionErrorVariance(),
        jnp.asarray([80.0]),
        grid=grid,
        law=jg.SmoothContact(0.5 * um),
    )
    return objective, optimise.lbfgs(objective, np.array([0.0, 0.25]), BOX, most_evaluations=45)


def _exact_rms(point: np.ndarray) -> float:
    """In um, with exact contact on a finer grid than the search's."""
    model = _design(BASE)(jnp.asarray(point))
    cycle = eqx.filter_jit(jg.mesh_cycle)(model, jg.mesh_grid(BASE.pair, phases=200, slices=2))
    return spread(cycle, np.asarray(cycle.approach)) / um


@pytest.mark.slow
def test_search_ends_in_the_valley(search):
    """From no relief (2.36 um) to less than 0.3 um in fewer than 50 gradients."""
    _, result = search
    assert_close(math.sqrt(result.values[0]), 2.36, rtol=2e-2, atol=0.0)
    assert result.gradient_evaluations < 50
    assert math.sqrt(result.value) < 0.3
    assert _exact_rms(result.point) < 0.3


@pytest.mark.slow
def test_valley_found_is_that_of_the_master_curve(search):
    """Depth over the closed form with the stiffest pair: 0.80 to 0.90 within Gamma*."""
    _, result = search
    load = 80.0 / ACCESSORY.base_radius[0] / ACCESSORY.common_width
    stiffness = eqx.filter_jit(jg.single_pair_stiffness)
    stiffest = float(stiffness(BASE.pair, BASE.compliance, jnp.asarray(load)))
    run = result.point[1] * ACCESSORY.contact_ratio
    closed = load / stiffest / um * run / (2 * run - (ACCESSORY.contact_ratio - 1))
    longest = (ACCESSORY.contact_ratio - 1) / ACCESSORY.contact_ratio
    assert 0.5 * longest < result.point[1] < 1.1 * longest
    assert 0.75 < result.point[0] / closed < 0.95


@pytest.mark.slow
def test_differential_evolution_finds_no_better(search):
    objective, by_gradient = search
    result = optimise.differential_evolution(objective, BOX, seed=0, most_generations=25)
    assert result.evaluations > 5 * by_gradient.evaluations
    assert math.sqrt(result.value) < 0.3
    assert _exact_rms(result.point) < 0.3
    # Within a twentieth of a micrometre of each other, in a valley that is flat.
    assert abs(math.sqrt(result.value) - math.sqrt(by_gradient.value)) < 0.05


# --- the Master Curve, traced

_LONGEST = (ACCESSORY.contact_ratio - 1.0) / ACCESSORY.contact_ratio


def _residuals(base: jg.PairModel, phases: int, law: jg.AbstractContactLaw = EXACT):
    grid = jg.mesh_grid(base.pair, phases=phases, slices=1)
    return optimise.residuals_over_torques(
        _design(base), jnp.asarray([base.torque]), grid=grid, law=law
    )


@pytest.fixture(scope="module")
def constant():
    """Deviations of the pair of constant stiffness, and the closed form [um]."""
    deflection = ACCESSORY.force(80.0) / (23e9 * ACCESSORY.common_width) / um
    closed = lambda extent: np.asarray(
        optimise.master_curve_depth(
            jnp.asarray(extent), jnp.asarray(ACCESSORY.contact_ratio), jnp.asarray(deflection)
        )
    )
    return _residuals(CONSTANT, 48), closed


@pytest.mark.slow
def test_the_traced_curve_is_the_closed_form(constant):
    """From half the depth at the longest extent down to where depths grow without bound."""
    residuals, closed = constant
    extent = np.linspace(_LONGEST, 0.56 * _LONGEST, 12)
    scaled = lambda depth, extent: um * residuals(jnp.stack([depth / um, extent]))
    curve = optimise.traced_curve(scaled, extent, 0.5 * um * float(closed(_LONGEST)))
    assert curve.settled.all()
    assert_close(curve.depth / um, closed(extent), rtol=1e-6, atol=0.0)
    assert curve.rms.max() < 1e-6 * um
    # On the exact curve a depth that is off by x costs an RMS of x sqrt(bend / 2).
    off = curve.depth[3] + np.array([-0.2, 0.2]) * um
    run = jax.jit(lambda depth: jnp.sqrt(jnp.sum(scaled(depth, extent[3]) ** 2)))
    rms = np.asarray([run(jnp.asarray(each)) for each in off])
    assert_close(rms, np.full(2, 0.2 * um * math.sqrt(0.5 * curve.bend[3])), rtol=2e-2, atol=0.0)
    assert_close(curve.margin(float(rms[1]))[3], 0.2 * um, rtol=2e-2, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "start",
    [
        (0.5, 0.31),
        pytest.param((30.0, 0.2), marks=pytest.mark.slow),
        pytest.param((12.0, 0.4), marks=pytest.mark.slow),
    ],
)
def test_least_squares_land_on_the_closed_form(constant, start):
    residuals, closed = constant
    box = optimise.Box([0.0, 0.9 * _LONGEST], [60.0, _LONGEST])
    found = optimise.least_squares(residuals, np.asarray(start), box, tolerance=1e-12)
    assert found.converged
    assert found.evaluations < 30
    assert_close(found.point[0], float(closed(found.point[1])), rtol=1e-6, atol=0.0)
