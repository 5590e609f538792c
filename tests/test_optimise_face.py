"""Objectives across the face, and one number against another."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient
from solve_cases import ACCESSORY

import jaxgear as jg
import optimise
from jaxgear import MPa, um

SPUR = jg.PairModel(ACCESSORY.pair(), 80.0, compliance=jg.ConstantStiffness(23e9))
GRID = jg.mesh_grid(SPUR.pair, phases=8, slices=8)
LAW = jg.ExactContact()
WIDTH = jnp.asarray(5.0 * MPa)


def _sloped(amount, base: jg.PairModel = SPUR) -> jg.PairModel:
    return eqx.tree_at(lambda m: m.flanks, base, jg.Flanks(jg.HelixSlope(amount)))


@eqx.filter_jit
def _judged(objective, model: jg.PairModel):
    cycle = jg.mesh_cycle(model, GRID, law=LAW)
    return objective(model, cycle, LAW), cycle


@pytest.mark.parametrize("width", [0.01, 0.3, 5.0])
def test_largest_of_loads_is_a_bound_and_nothing_stays_nothing(width):
    loads = jnp.asarray([[0.0, 2.0, 0.0], [0.0, 1.0, 3.0], [0.0, 0.0, 3.0]])
    found = np.asarray(optimise.loaded_maximum(loads, jnp.asarray(width)))
    exact = np.asarray([0.0, 2.0, 3.0])
    assert found[0] == pytest.approx(0.0, abs=1e-12)
    assert np.all(found[1:] >= exact[1:])
    assert np.all(found[1:] <= exact[1:] + width * math.log(3.0))
    # Two of three alike: w log(2 exp(3/w) - 1).
    if width > 0.1:
        by_hand = width * math.log(2.0 * math.exp(3.0 / width) - 1.0)
        assert found[2] == pytest.approx(by_hand, rel=1e-12)


def test_an_even_pressure_is_centred():
    value, cycle = _judged(optimise.PressureOffset(), SPUR)
    assert float(value) < 1e-24
    assert abs(float(optimise.pressure_offset(SPUR.pair, cycle, LAW, WIDTH))) < 1e-12


def test_offset_of_a_slope_by_hand():
    """Pressure goes with the root of a load that is linear across the face."""
    amount = 4.0 * um
    value, cycle = _judged(optimise.PressureOffset(1e-3 * MPa), _sloped(amount))
    place = (2.0 * np.arange(8) + 1.0) / 8.0 - 1.0
    # A single tooth pair carries most: its overlap is the deflection and half the slope.
    deflection = ACCESSORY.force(80.0) / (23e9 * ACCESSORY.common_width)
    pressure = np.sqrt(deflection + 0.5 * amount * place)
    expected = float((pressure @ place / pressure.sum()) ** 2)
    assert_close(value, expected, rtol=1e-3, atol=0.0)
    toward = optimise.pressure_offset(SPUR.pair, cycle, LAW, WIDTH)
    assert float(toward) > 0.0


def test_the_opposite_slope_centres_a_misaligned_pair():
    """An axis that deviates is a slope of the lead, so that a slope undoes it exactly."""
    tilted = eqx.tree_at(lambda m: m.misalignment, SPUR, jg.Misalignment(deviation=6.0 * um))
    objective = lambda x: 1e2 * _judged(optimise.PressureOffset(), _sloped(um * x[0], tilted))[0]
    assert float(objective(jnp.zeros(1))) > 0.01
    box = optimise.Box([-20.0], [20.0])
    found = optimise.lbfgs(objective, np.zeros(1), box, tolerance=1e-10)
    assert found.converged
    centred, cycle = _judged(optimise.PressureOffset(), _sloped(um * found.point[0], tilted))
    assert float(centred) < 1e-12
    assert_close(jg.face_load_factor(cycle), 1.0, rtol=1e-5, atol=0.0)
    # Contact spans the common face, over which a deviation is given: slope and deviation cancel.
    opposite, _ = _judged(optimise.PressureOffset(), _sloped(um * -found.point[0], tilted))
    assert float(opposite) > 0.01


def test_load_at_the_ends_by_hand():
    """The steeper end carries deflection plus 7/16 of the slope."""
    value, _ = _judged(optimise.EdgeLoad(1e-3 / jg.mm), _sloped(4.0 * um))
    deflection = ACCESSORY.force(80.0) / (23e9 * ACCESSORY.common_width)
    assert_close(value, 23e9 * (deflection + 4.0 * um * 7.0 / 16.0) * 1e-3, rtol=1e-4, atol=0.0)
    wide, _ = _judged(optimise.EdgeLoad(), _sloped(4.0 * um))
    assert float(value) < float(wide) < float(value) + math.log(8 * 2 * 2) + 1e-9
    # Two slices at either end have the same largest.
    two, _ = _judged(optimise.EdgeLoad(1e-3 / jg.mm, slices=2), _sloped(4.0 * um))
    assert_close(two, value, rtol=1e-6, atol=0.0)


def test_ends_that_do_not_touch_carry_nothing():
    crowned = eqx.tree_at(lambda m: m.flanks, SPUR, jg.Flanks(jg.Crowning(80.0 * um)))
    value, _ = _judged(optimise.EdgeLoad(), crowned)
    assert float(value) == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match="at least 1"):
        optimise.EdgeLoad(slices=0)


@pytest.mark.parametrize("objective", [optimise.PressureOffset(), optimise.EdgeLoad()])
def test_slopes_are_those_of_differences(objective):
    def value(x):
        flank = jg.Superposed((jg.HelixSlope(x[0] * um), jg.Crowning(x[1] * um)))
        model = eqx.tree_at(lambda m: m.flanks, SPUR, jg.Flanks(flank))
        return objective(model, jg.mesh_cycle(model, GRID, law=LAW), LAW)

    assert_gradient(jax.jit(value), jnp.asarray([3.0, 2.0]), rtol=1e-5, step=1e-4)


# --- Fronts


def _parabolas(x):
    """Two distances in a plane: the front is the straight line between their feet."""
    feet = jnp.asarray([[0.2, 0.3], [0.8, 0.3]])
    return 1.0 + jnp.sum((x[None, :] - feet) ** 2, axis=1)


BOX = optimise.Box([0.0, 0.0], [1.0, 1.0])


def test_front_of_two_parabolas():
    """1 + d^2 and 1 + (0.6 - d)^2."""
    front = optimise.pareto_front(_parabolas, np.asarray([0.5, 0.9]), BOX, points=5)
    assert front.kept.all()
    assert not front.dominated.any()
    assert np.abs(front.point[:, 1] - 0.3).max() < 1e-4
    along = front.point[:, 0] - 0.2
    expected = 1.0 + np.stack([along**2, (0.6 - along) ** 2], axis=1)
    assert np.abs(front.value - expected).max() < 1e-6
    # Evenly over the second number, from 1.36 to 1.
    assert np.abs(front.value[:, 1] - np.linspace(1.36, 1.0, 5)).max() < 1e-3
    assert front.front.shape == (5, 2)


def test_front_that_a_limit_cuts_off():
    """No design with x above 0.4: the second number stays above 1.16."""
    with_limit = lambda x: jnp.append(_parabolas(x), x[0])
    limit = optimise.Limit("x", 0.4, 0.1)
    front = optimise.pareto_front(with_limit, np.asarray([0.3, 0.9]), BOX, points=4, limits=[limit])
    assert front.kept.all()
    assert front.point[:, 0].max() < 0.4 + 1e-4
    assert front.value[:, 1].min() == pytest.approx(1.16, abs=1e-3)


def test_designs_beyond_a_limit_are_said_and_do_not_count():
    with_limit = lambda x: jnp.append(_parabolas(x), x[0])
    limit = optimise.Limit("x", -0.5, 0.1)
    front = optimise.pareto_front(with_limit, np.asarray([0.3, 0.9]), BOX, points=3, limits=[limit])
    assert not front.kept.any()
    assert front.dominated.all()
    assert front.front.shape == (0, 2)
    assert all("x is above -0.5" in reason for reason in front.reason)


def test_a_front_of_one_design_and_bad_starts():
    same = lambda x: jnp.repeat(_parabolas(x)[:1], 2)
    front = optimise.pareto_front(same, np.asarray([0.5, 0.9]), BOX)
    assert front.point.shape == (2, 2)
    with pytest.raises(ValueError, match="two ends"):
        optimise.pareto_front(same, np.asarray([0.5, 0.9]), BOX, points=1)
    with pytest.raises(ValueError, match="must be positive"):
        optimise.pareto_front(lambda x: x - 0.6, np.asarray([0.5, 0.9]), BOX)
    with pytest.raises(FloatingPointError, match="at the start"):
        optimise.pareto_front(lambda x: x / 0.0, np.asarray([0.5, 0.9]), BOX)


def test_what_dominates():
    value = np.asarray([[1.0, 3.0], [2.0, 2.0], [2.5, 2.5], [3.0, 1.0], [1.0 - 1e-9, 3.5]])
    front = optimise.ParetoFront(
        point=np.zeros((5, 1)),
        value=value,
        allowed=value[:, 1],
        kept=np.asarray([True, True, True, False, True]),
        settled=np.ones(5, bool),
        reason=("",) * 5,
        evaluations=1,
    )
    assert front.dominated.tolist() == [False, False, True, True, True]
    assert front.front.tolist() == [[1.0, 3.0], [2.0, 2.0]]
