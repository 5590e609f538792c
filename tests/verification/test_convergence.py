"""Orders of convergence: with phases, with slices, and of smooth contact to exact.

A grid is averaged over what it cannot resolve, so a relieved mesh converges with the square of the
step; the reference is a much finer grid of the same model.
"""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, observed_order
from solve_cases import ACCESSORY, POWER, run_cycle, symmetric_relief, with_contact_ratio

import jaxgear as jg
from jaxgear import um

EXACT = jg.ExactContact()
CONSTANT = jg.ConstantStiffness(14e9)
CROWNED = jg.Superposed((jg.TipRelief(10 * um, 0.2), jg.Crowning(5 * um)))


def _rms(model: jg.PairModel, *, law: jg.AbstractContactLaw = EXACT, **grid) -> float:
    cycle = run_cycle(model, jg.mesh_grid(model.pair, **grid), law=law)
    return float(jg.cycle_rms(cycle, jg.transmission_error(model.pair, cycle)))


def _order(sizes, values, best, bend: float) -> float:
    errors = np.abs(np.asarray(values) / best - 1.0)
    return observed_order(1.0 / np.asarray(sizes), errors, bend=bend)


@pytest.mark.slow
def test_plain_spur_pair_of_constant_stiffness_needs_no_phases():
    drawing = with_contact_ratio(1.6)
    model = jg.PairModel(drawing.pair(), 100.0, compliance=CONSTANT)
    delta = drawing.force(100.0) / (14e9 * drawing.common_width)
    for phases in (8, 11, 50):
        rms = _rms(model, phases=phases, slices=1)
        assert_close(rms, 0.5 * delta * math.sqrt(0.6 * 0.4), rtol=1e-7, atol=0.0)


PHASES = (16, 32, 64)
SPUR, HELICAL = ACCESSORY.pair(), POWER.pair()
WEBER = jg.WeberBanaschek()
UNEVENT = {
    # No event but entry and exit, with which the phases are aligned: the mid-point rule.
    "plain spur": (jg.PairModel(SPUR, 80.0, compliance=WEBER), 1),
    "plain helical": (jg.PairModel(HELICAL, 300.0, compliance=CONSTANT), 12),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", UNEVENT)
def test_order_in_phases(case):
    model, slices = UNEVENT[case]
    values = [_rms(model, phases=n, slices=slices) for n in PHASES]
    best = _rms(model, phases=1000, slices=slices)
    assert 1.8 < _order(PHASES, values, best, bend=0.2) < 2.2
    assert abs(values[1] / best - 1.0) < 1e-2


CONSTANT_CASE = "relieved spur, constant"
EVENTFUL = {
    "relieved spur": (jg.PairModel(SPUR, 80.0, symmetric_relief(8 * um, 0.23), WEBER), 1),
    CONSTANT_CASE: (
        jg.PairModel(SPUR, 80.0, symmetric_relief(8 * um, 0.23), CONSTANT),
        1,
    ),
    "crowned helical": (
        jg.PairModel(HELICAL, 300.0, jg.Flanks(CROWNED, CROWNED), CONSTANT),
        16,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [CONSTANT_CASE, "crowned helical", pytest.param("relieved spur", marks=pytest.mark.slow)],
)
def test_errors_stay_under_a_square_of_the_step(case):
    """Where a relief begins between phases the error scatters, below an envelope of order 2."""
    model, slices = EVENTFUL[case]
    best = _rms(model, phases=2000, slices=slices)
    counts = np.array([12, 48, 192])
    errors = np.array([_rms(model, phases=int(n), slices=slices) / best - 1.0 for n in counts])
    assert np.all(np.abs(errors) * counts**2 < 4.0), errors
    assert np.max(np.abs(errors)) > 1e-4


@pytest.mark.slow
def test_contact_length_needs_no_slices():
    """Swept parallelograms tile the plane of action: plain and constant, any count is exact."""
    model, _ = UNEVENT["plain helical"]
    values = [_rms(model, phases=32, slices=n) for n in (2, 7, 30)]
    assert_close(values[:2], [values[2]] * 2, rtol=1e-10, atol=0.0)


@pytest.mark.slow
def test_order_in_slices_of_a_crowned_helical_pair():
    model, _ = EVENTFUL["crowned helical"]
    counts = (10, 20, 40)
    values = [_rms(model, phases=32, slices=n) for n in counts]
    best = _rms(model, phases=32, slices=500)
    assert 1.8 < _order(counts, values, best, bend=0.2) < 2.2
    assert abs(values[1] / best - 1.0) < 1e-2


@pytest.mark.slow
def test_order_in_slices_of_a_crowned_spur_pair():
    """Crowned so that the ends of the face never touch: the edge of contact is what converges."""
    flank = jg.Crowning(14 * um)
    model = jg.PairModel(SPUR, 80.0, jg.Flanks(flank, flank), CONSTANT)
    counts = (10, 20, 40, 80)
    values = [_rms(model, phases=32, slices=n) for n in counts]
    best = _rms(model, phases=32, slices=1000)
    errors = np.abs(np.array(values) / best - 1.0)
    assert np.all(errors * np.array(counts) ** 2 < 2.0), errors
    assert errors[0] > 1e-5


# --- smooth contact


@pytest.mark.slow
def test_smooth_contact_tends_to_exact_contact():
    """Bias of order width squared: the spline's excess is confined to cells within the width."""
    model, slices = EVENTFUL["crowned helical"]
    exact = _rms(model, phases=64, slices=slices)
    widths = np.array([4.0, 2.0, 1.0, 0.5]) * um
    smooth = [_rms(model, law=jg.SmoothContact(w), phases=64, slices=slices) for w in widths]
    assert 1.8 < _order(1.0 / widths, smooth, exact, bend=0.2) < 2.2
    assert abs(smooth[-1] / exact - 1.0) < 1e-3


@pytest.mark.slow
def test_smooth_contact_is_exact_where_no_cell_is_near_separation():
    """Whatever the teeth: of constant stiffness, for those are compiled soonest."""
    model = jg.PairModel(SPUR, 80.0, compliance=CONSTANT)
    grid = jg.mesh_grid(SPUR, phases=32, slices=1)
    exact = run_cycle(model, grid)
    carried = exact.cells.stiffness > 1.0
    nearest = float(jnp.min(jnp.where(carried, jnp.abs(exact.overlap), jnp.inf)))
    assert nearest > 4 * um
    smooth = run_cycle(model, grid, law=jg.SmoothContact(4 * um))
    assert_close(smooth.approach, exact.approach, rtol=1e-12, atol=0.0)
    # Beyond that distance it does show.
    wide = run_cycle(model, grid, law=jg.SmoothContact(20 * um))
    assert float(jnp.max(jnp.abs(wide.approach / exact.approach - 1.0))) > 1e-3
