"""Objectives across the face, and one number against another."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_gradient
from solve_cases import ACCESSORY

import jaxgear as jg
import optimise
from jaxgear import MPa, um

SPUR = jg.PairModel(ACCESSORY.pair(), 80.0, compliance=jg.ConstantStiffness(23e9))
GRID = jg.mesh_grid(SPUR.pair, phases=8, slices=8)
LAW = jg.ExactContact()


# A lead is given over the face of its own gear, contact spans the common one.
SHARE = ACCESSORY.common_width / ACCESSORY.face_width[0]
DEFLECTION = ACCESSORY.force(80.0) / (23e9 * ACCESSORY.common_width)


def _cycle(x, deviation=0.0):
    """The pair with helix slope and crowning of the pinion, and a deviation of the axes [um]."""
    flank = jg.Superposed((jg.HelixSlope(x[0] * um), jg.Crowning(x[1] * um)))
    axes = jg.Misalignment(deviation=deviation * um)
    where = lambda m: (m.flanks, m.misalignment)
    model = eqx.tree_at(where, SPUR, (jg.Flanks(flank), axes))
    return model, jg.mesh_cycle(model, GRID, law=LAW)


@jax.jit
def _numbers(x, deviation, widths):
    """Squared offset, its root with its sign, load at 1 and 2 slices of the ends, K_Hb; at more."""
    model, cycle = _cycle(x, deviation)
    parts = (
        optimise.PressureOffset(widths[0]),
        optimise.EdgeLoad(widths[1]),
        optimise.EdgeLoad(widths[1], slices=2),
        optimise.EdgeLoad(widths[1], slices=4),
        optimise.EdgeLoad(widths[1], slices=9),
    )
    square, one, two, all_of, more = (part(model, cycle, LAW) for part in parts)
    offset = optimise.pressure_offset(model.pair, cycle, LAW, widths[0])
    return jnp.stack([square, offset, one, two, jg.face_load_factor(cycle), all_of, more])


def _judged(slope=0.0, crowning=0.0, deviation=0.0, *, pressure=5.0 * MPa, load=1.0 / jg.mm):
    amounts = jnp.asarray([slope, crowning]), jnp.asarray(deviation)
    return np.asarray(_numbers(*amounts, jnp.asarray([pressure, load])))


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


@pytest.mark.slow
def test_an_even_pressure_is_centred():
    square, offset, *_ = _judged()
    assert square < 1e-24
    assert abs(offset) < 1e-12


@pytest.mark.slow
def test_offset_of_a_slope_by_hand():
    """Pressure goes with the root of a load that is linear across the face."""
    square, offset, *_ = _judged(4.0, pressure=1e-3 * MPa)
    place = (2.0 * np.arange(8) + 1.0) / 8.0 - 1.0
    # The most loaded tooth pair is alone: its overlap is the deflection and half the slope.
    pressure = np.sqrt(DEFLECTION + 0.5 * SHARE * 4.0 * um * place)
    expected = pressure @ place / pressure.sum()
    assert offset == pytest.approx(expected, rel=1e-3)
    assert square == pytest.approx(offset**2, rel=1e-12)


@pytest.mark.slow
def test_the_opposite_slope_centres_a_misaligned_pair():
    """An axis that deviates is a slope of the lead, so that a slope undoes it exactly.

    Over the common face the wheel moves away along the line of action by the deviation times the
    cosine of the working pressure angle.
    """
    own = jax.jit(jax.value_and_grad(_offset_by_slope))
    with_slope = optimise.ValueAndGradient(own)
    assert float(with_slope(jnp.zeros(1))[0]) > 0.1
    box = optimise.Box([-20.0], [20.0])
    found = optimise.lbfgs(with_slope, np.zeros(1), box, tolerance=1e-9)
    assert found.converged
    by_hand = 6.0 * math.cos(ACCESSORY.working_angle) / SHARE
    assert abs(found.point[0]) == pytest.approx(by_hand, rel=1e-6)
    square, _, _, _, factor, *_ = _judged(found.point[0], deviation=6.0)
    assert square < 1e-12
    assert factor == pytest.approx(1.0, abs=1e-6)
    assert _judged(-found.point[0], deviation=6.0)[0] > 1e-4


def _offset_by_slope(x):
    """Of a pair whose axes deviate by 6 um, in percent squared."""
    model, cycle = _cycle(jnp.append(x, 0.0), 6.0)
    return 1e4 * optimise.PressureOffset()(model, cycle, LAW)


def test_load_at_the_ends_by_hand():
    """The fuller end carries deflection plus 7/16 of the slope."""
    one, two = _judged(4.0, load=1e-3 / jg.mm)[2:4]
    by_hand = 23e9 * (DEFLECTION + SHARE * 4.0 * um * 7.0 / 16.0) * jg.mm
    assert one == pytest.approx(by_hand, rel=1e-4)
    # Two slices at either end have the same largest.
    assert two == pytest.approx(one, rel=1e-6)
    wide, *_, every, more = _judged(4.0)[2:]
    assert one < wide < one + math.log(8 * 2 * 2) + 1e-9
    # There are eight: nine at either end are the same as four, and none counts twice.
    assert more == every > wide


def test_ends_that_do_not_touch_carry_nothing():
    assert _judged(crowning=80.0)[2] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match="at least 1"):
        optimise.EdgeLoad(slices=0)


@pytest.mark.slow
def test_slopes_are_those_of_differences():
    def value(x):
        model, cycle = _cycle(x)
        offset, edge = optimise.PressureOffset(), optimise.EdgeLoad()
        return 1e4 * offset(model, cycle, LAW) + edge(model, cycle, LAW)

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
    with pytest.raises(ValueError, match="may be negative at the start, got"):
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


def test_front_from_a_design_that_is_perfect_in_one_number():
    """The second number is zero where the search begins, and not elsewhere."""
    feet = jnp.asarray([[0.2, 0.3], [0.8, 0.3]])
    squares = lambda x: jnp.sum((x[None, :] - feet) ** 2, axis=1)
    front = optimise.pareto_front(squares, np.asarray([0.8, 0.3]), BOX, points=3)
    assert front.kept.all()
    assert front.value[:, 1] == pytest.approx([0.36, 0.18, 0.0], abs=1e-5)
    assert front.value[-1, 0] == pytest.approx(0.36, abs=1e-9)
    # What is nothing everywhere cannot be traded.
    flat = lambda x: jnp.stack([squares(x)[0], 0.0 * x[0]])
    front = optimise.pareto_front(flat, np.asarray([0.5, 0.9]), BOX, points=5)
    assert front.front.shape == (1, 2)


def test_a_design_that_was_not_solved_exactly_does_not_count():
    front = optimise.pareto_front(
        _parabolas,
        np.asarray([0.5, 0.9]),
        BOX,
        points=2,
        exact=lambda x: np.asarray(_parabolas(x)) if x[0] < 0.5 else np.full(2, np.nan),
    )
    assert front.kept.all()
    assert front.dominated.tolist() == [False, True]
