"""Load factors of settled cycles and of forces written down, and angles of gears that grow."""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, observed_order, quick
from solve_cases import ACCESSORY, POWER, run_cycle

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._response import _factors

STIFFNESS = 14e9
TORQUE = 120.0
EVEN = jg.Misalignment()
ASKEW = jg.Misalignment(deviation=11 * um)
DRAWINGS = {"spur": ACCESSORY, "helical": POWER}
every_drawing = pytest.mark.parametrize("drawing", DRAWINGS.values(), ids=DRAWINGS)

# One program each, and not one for each of their operations.
face_load = eqx.filter_jit(_factors.face_load)
face_load_factor = eqx.filter_jit(_factors.face_load_factor)
pressure_angle_change = eqx.filter_jit(_factors.pressure_angle_change)
smooth_face_load_factor = eqx.filter_jit(_factors.smooth_face_load_factor)
smooth_transverse_load_factor = eqx.filter_jit(_factors.smooth_transverse_load_factor)
transverse_load_factor = eqx.filter_jit(_factors.transverse_load_factor)
working_pressure_angle_change = eqx.filter_jit(_factors.working_pressure_angle_change)


class StartRemoved(jg.AbstractFlankDeviation):
    """Everything below the middle of the path is lower: a step that no line straddles for long.

    **Fields:**

    - `depth`: material removed there [m].
    """

    depth: jax.Array

    def __call__(self, profile, face):
        """Evaluate the deviation; see `AbstractFlankDeviation`."""
        del face
        return jnp.where(profile < 0.5, -self.depth, 0.0)


@functools.cache
def _pair(drawing) -> jg.GearPair:
    return drawing.pair()


def _settled(drawing, misalignment=EVEN, *, depth=0.0, slices=8, law=None) -> jg.MeshCycle:
    model = jg.PairModel(
        _pair(drawing),
        TORQUE,
        jg.Flanks(pinion=StartRemoved(jnp.asarray(depth))),
        jg.ConstantStiffness(STIFFNESS),
        misalignment=misalignment,
    )
    grid = jg.mesh_grid(model.pair, phases=16, slices=slices)
    return run_cycle(model, grid, law=law or jg.ExactContact())


def _written(force, fraction=None, weight=None, roll=None) -> jg.MeshCycle:
    """A cycle of the spur pair with these cell forces on `phase`, `line`, `slice`."""
    force = np.asarray(force, dtype=float)
    weight = np.full(len(force), 1.0 / len(force)) if weight is None else np.asarray(weight)
    fraction = np.ones(force.shape) if fraction is None else np.asarray(fraction, dtype=float)
    roll = np.full(force.shape, float(_pair(ACCESSORY).pitch_point)) if roll is None else roll
    return eqx.tree_at(
        lambda c: (
            c.force,
            c.cells.lines.weight,
            c.cells.lines.fraction,
            c.cells.lines.roll,
        ),
        _settled(ACCESSORY),
        tuple(jnp.asarray(x) for x in (force.reshape(len(force), -1), weight, fraction, roll)),
    )


# --- across the face


def test_face_load_by_hand():
    """0.25 (1 + 3, 2) + 0.75 (5, 7 + 1) = 4.75, 6.5 N on halves of 9.5 mm."""
    cycle = _written([[[1, 2], [3, 0]], [[5, 7], [0, 1]]], weight=[0.25, 0.75])
    found = face_load(_pair(ACCESSORY), cycle)
    assert_close(found, np.array([1000.0, 1000.0 * 6.5 / 4.75]), rtol=1e-13, atol=0.0)
    assert_close(face_load_factor(cycle), 6.5 / 5.625, rtol=1e-13, atol=0.0)


@every_drawing
@pytest.mark.parametrize("misalignment", quick(1, [ASKEW, EVEN]), ids=["askew", "even"])
def test_face_load_integrates_to_the_mesh_force(drawing, misalignment):
    cycle = _settled(drawing, misalignment)
    load = face_load(_pair(drawing), cycle)
    assert load.shape == (8,)
    total = float(jnp.sum(load)) * drawing.common_width / 8
    assert_close(total, drawing.force(TORQUE), rtol=1e-9, atol=0.0)


def test_even_spur_load_has_factor_one():
    assert_close(face_load_factor(_settled(ACCESSORY)), 1.0, rtol=1e-12, atol=0.0)


def test_misalignment_that_the_load_closes_by_hand():
    """Slices of each line in contact carry k' times their place in the gap, -s/2 to s/2.

    So their load per width is F/b + eps k' z s/b over the cycle: the factor is
    1 + eps k' b s (1 - 1/n) / (2 F) at the middle of the end slice.
    """
    cycle = _settled(ACCESSORY, ASKEW)
    in_mesh = cycle.cells.lines.fraction.reshape(cycle.force.shape) > 0.5
    assert bool(jnp.all(jnp.where(in_mesh, cycle.force > 0.0, True)))
    gap = ASKEW.deviation * math.cos(ACCESSORY.working_angle)
    width, ratio = ACCESSORY.common_width, ACCESSORY.contact_ratio
    expected = 1 + ratio * STIFFNESS * width * gap * (1 - 1 / 8) / (2 * ACCESSORY.force(TORQUE))
    assert 1.2 < float(expected) < 1.6
    assert_close(face_load_factor(cycle), expected, rtol=1e-9, atol=0.0)


@pytest.mark.slow
def test_misalignment_that_opens_one_end_by_hand():
    """Triangular loads: n lines share F = n k' s c^2 / (2 b) over the length c of the contact.

    The end of the face then carries n k' s c / b, which is sqrt(2 n k' s b / F) times the mean, as
    in ISO 6336-1 for factors above 2; the middle of the last slice closes by s/(2 slices) less.
    """
    slices, gap = 64, 200 * um
    cycle = _settled(ACCESSORY, jg.Misalignment(inclination=gap), slices=slices)
    gap *= math.sin(ACCESSORY.working_angle)
    width, ratio = ACCESSORY.common_width, ACCESSORY.contact_ratio
    single = 2 * STIFFNESS * gap * width / ACCESSORY.force(TORQUE)
    ends = (2 - ratio) * math.sqrt(single) + (ratio - 1) * math.sqrt(2 * single)
    short = ratio * STIFFNESS * gap / (2 * slices) / (ACCESSORY.force(TORQUE) / width)
    assert 2.0 < ends < 4.0
    assert_close(face_load_factor(cycle), ends - short, rtol=2e-3, atol=0.0)


@every_drawing
def test_opposite_misalignment_loads_the_other_end(drawing):
    pair = _pair(drawing)
    there, back = (
        face_load(pair, _settled(drawing, jg.Misalignment(deviation=sign * 11 * um)))
        for sign in (1.0, -1.0)
    )
    assert_close(jnp.max(there) / jnp.max(back), 1.0, rtol=1e-2, atol=0.0)
    assert_close(there, back[::-1], rtol=2e-2, atol=0.0)
    assert int(jnp.argmax(there)) != int(jnp.argmax(back))


# --- from pair to pair


def test_transverse_factor_by_hand():
    """Line loads 2, 6 over an even 4; alone 1; and 5/1.5 over an even 8/2.5 in the third."""
    force = [[[2, 2], [6, 6]], [[0, 0], [9, 9]], [[5, 0], [2, 1]]]
    fraction = [[[1, 1], [1, 1]], [[0, 0], [1, 1]], [[1, 0.5], [1, 0]]]
    roll = np.where(np.asarray(fraction) > 0.0, _pair(ACCESSORY).pitch_point, 0.0)
    # The last slice's middle is off the path: neither its force nor its length counts.
    cycle = _written(force, fraction, roll=roll)
    assert_close(transverse_load_factor(_pair(ACCESSORY), cycle), 1.5, rtol=1e-13, atol=0.0)
    third = eqx.tree_at(lambda c: c.force, cycle, cycle.force.at[0].set(1.0))
    expected = (5 / 1.5) / (7 / 2.5)
    assert_close(transverse_load_factor(_pair(ACCESSORY), third), expected, rtol=1e-13, atol=0.0)


@every_drawing
def test_equal_stiffness_without_deviations_shares_perfectly(drawing):
    factor = transverse_load_factor(_pair(drawing), _settled(drawing))
    assert_close(factor, 1.0, rtol=1e-9, atol=0.0)


def test_unequal_pairs_by_hand():
    """One of two pairs is e lower: they carry (F -+ k e)/2. Alone, each carries what it must."""
    depth = 3 * um
    cycle = _settled(ACCESSORY, depth=depth)
    lost = STIFFNESS * ACCESSORY.common_width * depth / ACCESSORY.force(TORQUE)
    assert 0.05 < lost < 0.2
    factor = transverse_load_factor(_pair(ACCESSORY), cycle)
    assert_close(factor, 1.0 + lost, rtol=1e-9, atol=0.0)


def test_pair_out_of_touch_keeps_its_length():
    """All of the load on one of two pairs is twice the even load."""
    factor = transverse_load_factor(_pair(ACCESSORY), _settled(ACCESSORY, depth=300 * um))
    assert_close(factor, 2.0, rtol=1e-9, atol=0.0)


def test_misalignment_is_not_unequal_sharing_in_a_spur_pair():
    factor = transverse_load_factor(_pair(ACCESSORY), _settled(ACCESSORY, ASKEW))
    assert_close(factor, 1.0, rtol=1e-9, atol=0.0)


@eqx.filter_jit
@eqx.filter_grad
def _slopes(cycle, pair):
    return _factors.smooth_transverse_load_factor(pair, cycle, jnp.asarray(1e-3))


@pytest.mark.parametrize("missing", quick(1, ["a line", "a phase", "all force"]))
def test_nothing_in_contact_is_no_division_by_zero(missing):
    """In value or slope: lines off the path, phases without any, and no force at all."""
    pair = _pair(ACCESSORY)
    force, fraction = np.ones((2, 2, 2)), np.ones((2, 2, 2))
    match missing:
        case "a line":
            fraction[0, 0] = 0.0
        case "a phase":
            fraction[0] = 0.0
        case _:
            force[0] = 0.0
    cycle = _written(force, fraction)
    assert float(transverse_load_factor(pair, cycle)) >= 1.0
    slopes = jax.tree.leaves(_slopes(cycle, pair))
    assert slopes
    assert all(bool(jnp.all(jnp.isfinite(slope))) for slope in slopes)


# --- for an optimiser


def test_smooth_factors_tend_to_the_sharp_ones_from_above():
    """By at most w ln n, and by w ln m where m values tie: two ends, or both pairs."""
    pair = _pair(ACCESSORY)
    cycle = _written([[[3, 1, 3], [1, 1, 1]], [[3, 1, 3], [1, 1, 1]]])
    widths = np.array([4e-2, 2e-2, 1e-2])
    sharp, count = face_load_factor(cycle), 3
    assert_close(sharp, 1.2, rtol=1e-13, atol=0.0)
    excess = [float(smooth_face_load_factor(cycle, jnp.asarray(w)) - sharp) for w in widths]
    assert_close(observed_order(widths, excess), 1.0, rtol=1e-3, atol=0.0)
    assert_close(excess[-1], 1e-2 * math.log(2), rtol=1e-6, atol=0.0)
    assert excess[0] <= widths[0] * math.log(count)
    sharp = transverse_load_factor(pair, cycle)
    assert_close(sharp, 1.4, rtol=1e-13, atol=0.0)
    found = smooth_transverse_load_factor(pair, cycle, jnp.asarray(1e-2))
    assert_close(found - sharp, 1e-2 * math.log(2), rtol=1e-6, atol=0.0)


def test_factors_are_differentiable():
    """In the forces of a cycle; these have derivatives in their turn, by tests of their own."""
    pair, settled = _pair(ACCESSORY), _settled(ACCESSORY, ASKEW)

    def factors(force):
        cycle = eqx.tree_at(lambda c: c.force, settled, force)
        width = jnp.asarray(0.02)
        load = _factors.face_load(pair, cycle) / 1e5
        return (
            _factors.smooth_face_load_factor(cycle, width)
            + 2.0 * _factors.smooth_transverse_load_factor(pair, cycle, width)
            + jnp.sum(load**2 * jnp.arange(1.0, 9.0))
        )

    assert_gradient(factors, settled.force, rtol=1e-6, step=1e-6)


# --- gears that grow


def test_pressure_angle_at_a_fixed_radius_by_hand():
    """A tenth of a percent lowers the 25.488 degrees of the power gears by 0.47 % (eq. 3.3)."""
    pair = _pair(POWER)
    radius = np.asarray(POWER.base_radius)
    change = np.asarray(pressure_angle_change(pair, jnp.asarray(1e-3 * radius)))
    angle = POWER.transverse_angle
    assert_close(change / angle, np.full(2, -0.0047), rtol=1e-2, atol=0.0)
    expected = math.acos(1.001 * math.cos(angle)) - angle
    assert_close(change, np.full(2, expected), rtol=1e-11, atol=0.0)


def test_pressure_angle_to_the_leading_order():
    """-cot(alpha) dr_b / r_b, with an error of the second order."""
    growth = np.array([1e-3, 1e-4, 1e-5])
    angle, radius = ACCESSORY.transverse_angle, np.asarray(ACCESSORY.base_radius)
    change = [
        pressure_angle_change(_pair(ACCESSORY), jnp.asarray([0.0, part * radius[1]]))
        for part in growth
    ]
    assert all(abs(float(x[0])) < 1e-15 for x in change)
    leading = -growth / math.tan(angle)
    error = [abs(float(x[1]) / y - 1.0) for x, y in zip(change, leading, strict=True)]
    assert_close(observed_order(growth, error, floor=1e-9), 1.0, rtol=1e-2, atol=0.0)


def test_pressure_angle_at_a_fixed_centre_distance_by_hand():
    """The wheel alone by 0.1 %: -cot(26.765 degrees) 78.441 / 118.816 thousandths, 0.28 %."""
    radius = np.asarray(POWER.base_radius)
    growth = jnp.asarray([0.0, 1e-3 * radius[1]])
    change = working_pressure_angle_change(_pair(POWER), growth)
    assert_close(change / POWER.working_angle, -0.0028, rtol=5e-3, atol=0.0)
    cosine = (radius.sum() + 1e-3 * radius[1]) / POWER.centre_distance
    assert_close(change, math.acos(cosine) - POWER.working_angle, rtol=1e-10, atol=0.0)


def test_both_angles_are_the_same_where_gears_run_at_their_reference_circles():
    pair = jg.GearPair(jg.Gear(30, 20 * mm), jg.Gear(50, 20 * mm), 2 * mm)
    growth = 1e-4 * pair.base_radius
    reference = pressure_angle_change(pair, growth)
    working = working_pressure_angle_change(pair, growth)
    assert_close(jnp.stack([working, working]), reference, rtol=1e-10, atol=0.0)


def test_pressure_angles_are_differentiable():
    pair = _pair(POWER)

    def angles(growth):
        fixed = jnp.sum(jnp.asarray([1.0, 2.0]) * pressure_angle_change(pair, growth))
        return fixed + 3.0 * working_pressure_angle_change(pair, growth)

    assert_gradient(angles, jnp.asarray([30 * um, 80 * um]), rtol=1e-6, step=1e-2)
