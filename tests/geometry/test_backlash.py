import dataclasses
import math
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import (
    accessory,
    exchanged,
    helical_25_31,
    mirrored,
    over,
    sizes,
    standard_30_30,
)
from helpers import assert_close, assert_gradient, quick

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._geometry._backlash import (
    back_lines,
    check_backlash,
    has_back_contact,
    mirror_point,
    normal_backlash,
)
from jaxgear._geometry._pair import pair_facts

_backlash = jax.jit(normal_backlash)
_mirror = jax.jit(mirror_point)
_contact_lines = eqx.filter_jit(jg.contact_lines)
_back_lines = eqx.filter_jit(back_lines)


def _thinned(pair: jg.GearPair, pinion: float, wheel: float) -> jg.GearPair:
    """The pair with these tooth thickness allowances [um]."""
    return eqx.tree_at(
        lambda p: (p.pinion.thickness_allowance, p.wheel.thickness_allowance),
        pair,
        (jnp.asarray(pinion * um), jnp.asarray(wheel * um)),
        is_leaf=lambda x: x is None,
    )


def _grid(pair: jg.GearPair, beyond: float = 0.0) -> jg.MeshGrid:
    return jg.mesh_grid(pair, phases=16, slices=5, beyond=beyond)


# --- how far back flanks are apart


def test_allowances_alone_by_hand():
    """A pair without backlash, teeth 60 and 40 um thinner at 20 degrees: 100 um cos(20 deg)."""
    assert_close(
        _backlash(_thinned(standard_30_30(), 60.0, 40.0)), 93.96926208 * um, rtol=1e-9, atol=0.0
    )


def test_centre_distance_alone_by_hand():
    """30/30 teeth of module 3 at 90.3 mm instead of 90 mm.

    cos(a_w) = 0.9396926 / 1.0033333 = 0.9365707, a_w = 20.51665 deg, inv(a_w) = 0.01613271, so
    inv(a_w) - inv(20 deg) = 0.00122832: times both base diameters, 2 x 84.572336 mm, 0.2077642 mm.
    """
    pair = _thinned(standard_30_30(), 0.0, 0.0)
    wider = eqx.tree_at(
        lambda p: p.centre_distance, pair, jnp.asarray(90.3 * mm), is_leaf=lambda x: x is None
    )
    assert_close(_backlash(wider), 0.2077642 * mm, rtol=1e-6, atol=0.0)


@over(helical_25_31, accessory)
def test_backlash_is_that_of_the_pair_and_both_allowances(make):
    pair = make()
    facts = pair_facts(pair)
    along_path = jnp.cos(facts.working_pressure_angle) * jnp.cos(facts.base_helix_angle)
    own = float(facts.backlash * along_path)
    expected = own + 120.0 * um * math.cos(float(pair.pressure_angle))
    assert_close(_backlash(_thinned(pair, 70.0, 50.0)), expected, rtol=1e-9, atol=0.0)


def test_no_allowance_and_no_play_is_exactly_none():
    assert float(_backlash(_thinned(accessory(), 0.0, 0.0))) == 0.0


def _touch(pair: jg.GearPair, taken: tuple[float, float], turn: float) -> tuple[float, ...]:
    """Exact involute teeth, turned until they touch.

    A tooth of the pinion is turned from the line of centres by `turn` [rad], the wheel until the
    drive flanks touch, then until the back flanks do. No line of action is used.

    Returns the place of the drive contact on the pinion, the place of the back contact, both as
    roll lengths, and the backlash on the wheel's base circle [m].
    """
    base, tip = np.asarray(pair.base_radius), np.asarray(pair.tip_radius)
    half, reference = np.asarray(pair.half_thickness_at_base), np.asarray(pair.reference_radius)
    angles = np.asarray(taken) / (math.cos(float(pair.helix_angle)) * reference)
    radius = np.linspace(base[0], tip[0], 200_001)
    centres = float(pair.working_centre_distance)

    def half_angle(body, r):
        pressure = np.arccos(base[body] / r)
        return half[body] - (np.tan(pressure) - pressure)

    def seen_from_wheel(polar):
        """Angle from the line of centres and radius, about the wheel's centre."""
        s, t = radius * np.cos(polar) - centres, radius * np.sin(polar)
        return np.arctan2(t, -s), np.hypot(s, t)

    def in_reach(r):
        return (r >= base[1]) & (r <= tip[1])

    # The flank towards +T pushes the tooth ahead, whose flank looks back.
    drive, reach = seen_from_wheel(turn + half_angle(0, radius))
    reach = np.where(in_reach(reach), reach, np.nan)
    centre = drive + half_angle(1, reach)
    pushed = int(np.nanargmax(centre))
    # The flank towards -T, thinner, and the tooth behind, thinner on the flank that looks ahead.
    back, reach = seen_from_wheel(turn - half_angle(0, radius) + angles[0])
    reach = np.where(in_reach(reach), reach, np.nan)
    behind = centre[pushed] - 2.0 * np.pi / pair.wheel.teeth
    apart = back - (behind + half_angle(1, reach) - angles[1])
    met = int(np.nanargmin(apart))
    roll = np.sqrt(radius**2 - base[0] ** 2)
    return float(roll[pushed]), float(roll[met]), float(base[1] * apart[met])


@pytest.mark.parametrize("turn", [-0.03, 0.04])
@over(helical_25_31, accessory)
def test_involute_teeth_turned_until_they_touch(make, turn):
    """Backlash, and where back flanks touch: where the pinion's are, or the wheel's come to be.

    The place taken is half-way between: the pinion's flanks are there if the wheel closes the gap,
    and further on by the backlash if the pinion turns back by itself.
    """
    taken = (90.0, 35.0)
    pair = _thinned(make(), *taken)
    drive, back, gap = _touch(pair, (taken[0] * um, taken[1] * um), turn)
    helix = math.cos(float(pair.base_helix_angle))
    assert_close(_backlash(pair), gap * helix, rtol=1e-8, atol=0.0)
    # A flank is met flat, so its place is known less well than its distance.
    place = 2.0 * float(_mirror(pair)) - drive - (back + 0.5 * gap)
    pitch = float(pair.transverse_base_pitch)
    assert abs(place - pitch * round(place / pitch)) < 2e-3 * gap
    # The drive flank is where no allowance moves it.
    assert_close(
        drive,
        pair.base_radius[0] * (turn + pair.working_pressure_angle + pair.half_thickness_at_base[0]),
        rtol=1e-5,
        atol=0.0,
    )


# --- when


def test_mirror_point_of_equal_gears_by_hand():
    """30/30 of module 3: pitch point at 45 sin(20) mm, half a tooth later a quarter pitch on."""
    sine, cosine = math.sin(math.radians(20.0)), math.cos(math.radians(20.0))
    expected = (45.0 * sine + 0.75 * math.pi * cosine) * mm
    assert_close(_mirror(standard_30_30()), expected, rtol=1e-12, atol=0.0)


@over(accessory)
def test_mirror_point_is_half_a_tooth_past_the_pitch_point(make):
    """On the working pitch circle without backlash, from thicknesses at the reference circle."""
    pair = make()
    module = float(pair.normal_module) / math.cos(float(pair.helix_angle))
    shift = float(pair.pinion.profile_shift)
    arc = module * (0.5 * math.pi + 2.0 * shift * math.tan(float(pair.pressure_angle)))
    involute = lambda x: math.tan(x) - x
    working, own = float(pair.working_pressure_angle), float(pair.transverse_pressure_angle)
    reference = 0.5 * module * pair.pinion.teeth
    half = arc / (2.0 * reference) + involute(own) - involute(working)
    path = half * float(pair.working_pitch_radius[0]) * math.cos(working)
    assert_close(_mirror(pair), float(pair.pitch_point) + path, rtol=1e-9, atol=0.0)


@over(helical_25_31, accessory)
def test_mirror_point_knows_no_pinion(make):
    """Whichever gear is called the pinion, teeth of one lie where gaps of the other do."""
    pair = _thinned(make(), 80.0, 30.0)
    other = exchanged(pair)
    together = _mirror(pair) + _mirror(other)
    expected = pair.tangent_length + 0.5 * pair.transverse_base_pitch
    assert_close(together, expected, rtol=1e-9, atol=0.0)


def test_allowances_move_the_mirror_point_by_a_quarter():
    """At first order, and apart by cos(alpha_n)/cos(beta_b): the wheel's on, the pinion's back."""
    pair = helical_25_31()
    along = math.cos(float(pair.pressure_angle)) / math.cos(float(pair.base_helix_angle))
    none = float(_mirror(_thinned(pair, 0.0, 0.0)))
    for taken, sign in (((40.0, 0.0), -1.0), ((0.0, 40.0), 1.0)):
        moved = float(_mirror(_thinned(pair, *taken))) - none
        assert_close(moved, sign * 10.0 * um * along, rtol=1e-9, atol=0.0)
    assert abs(float(_mirror(_thinned(pair, 25.0, 25.0))) - none) < 1e-15


# --- where


@pytest.mark.parametrize(
    ("make", "beyond"), quick(1, [(helical_25_31, 0.0), (helical_25_31, 0.2), (accessory, 0.0)])
)
def test_back_lines_are_those_of_the_mirrored_pair_backwards(make, beyond):
    """In a mirror through both axes the gears turn the other way, and back flanks drive."""
    pair = _thinned(make(), 60.0, 60.0)
    other = mirrored(pair)
    grid = _grid(pair, beyond)
    drive = _contact_lines(other, grid)
    taken = np.concatenate([[0.0], np.cumsum(np.asarray(drive.weight))])
    mirror = 2.0 * float((_mirror(pair) - pair.path_start) / pair.transverse_base_pitch + beyond)
    start, back, end = _back_lines(pair, grid, jnp.asarray((mirror - taken)[::-1]))
    assert bool(back.complete)
    ours = np.asarray(back.fraction)[::-1, :, ::-1]
    theirs = np.asarray(drive.fraction)
    np.testing.assert_allclose(np.sort(ours, axis=1), np.sort(theirs, axis=1), rtol=0, atol=1e-9)
    known = lambda roll, part: np.sort(np.where(part > 1e-9, np.asarray(roll), np.inf), axis=1)
    rolls = known(np.asarray(back.roll)[::-1, :, ::-1], ours)
    np.testing.assert_allclose(rolls, known(drive.roll, theirs), rtol=1e-9)
    # Backwards: the end of a step is nearer to the pinion's tangent point than its start.
    step = np.asarray(drive.weight)[::-1] * float(pair.transverse_base_pitch)
    for lines, sign in ((start, 0.5), (end, -0.5)):
        moved = np.asarray(lines.roll - back.roll)
        np.testing.assert_allclose(moved, np.broadcast_to(sign * step[:, None, None], moved.shape))


@over(helical_25_31, accessory)
def test_back_lines_pass_places_opposite_to_drive_lines(make):
    """At every phase and height 2X - x is the place of a back flank, whole base pitches apart."""
    pair = _thinned(make(), 60.0, 20.0)
    grid = _grid(pair)
    drive = _contact_lines(pair, grid)
    edges = jnp.concatenate([jnp.zeros(1), jnp.cumsum(drive.weight)])
    _, back, _ = _back_lines(pair, grid, edges)
    pitch = float(pair.transverse_base_pitch)
    opposite = 2.0 * float(_mirror(pair)) - np.asarray(drive.roll)[:, :, ::-1]
    pitches = (opposite - np.asarray(back.roll)) / pitch
    assert np.max(np.abs(pitches - np.round(pitches))) < 1e-9
    np.testing.assert_allclose(back.phase, drive.phase, atol=1e-12)


def test_back_flanks_of_equal_gears_are_half_a_period_late():
    """Without backlash and shift: the path is its own mirror image, teeth are as wide as gaps."""
    pair = _thinned(standard_30_30(), 0.0, 0.0)
    grid = _grid(pair)
    _, now, _ = _back_lines(pair, grid, jnp.linspace(0.0, 1.0, 25))
    length = np.asarray(jnp.sum(now.fraction, axis=(1, 2)))
    drive = _contact_lines(pair, jg.mesh_grid(pair, phases=24, slices=5))
    entry = float(pair.path_of_contact / pair.transverse_base_pitch) % 1.0
    # Of 24 steps the drive flanks have two lines until a pair leaves, then one.
    late = (np.arange(24) / 24.0 + 0.5) % 1.0
    share = np.clip((entry - late) * 24.0, 0.0, 1.0)
    np.testing.assert_allclose(length, 5.0 * (1.0 + share), atol=1e-9)
    assert abs(np.mean(length) - float(jnp.sum(drive.fraction.sum((1, 2)) * drive.weight))) < 1e-9


@over(helical_25_31, accessory)
def test_no_line_is_missing_however_steps_lie(make):
    """Mean length of all lines, for steps that nothing aligns, on the fewest phases."""
    pair = _thinned(make(), 60.0, 20.0)
    grid = jg.mesh_grid(make(), phases=8, slices=2)
    expected = float(jg.mean_line_length(pair))
    for offset in (0.0, 0.37, 0.99):
        _, back, _ = _back_lines(pair, grid, jnp.linspace(0.0, 1.0, 9) + offset)
        assert bool(back.complete)
        length = float(jnp.sum(back.fraction) / 8.0 * back.length)
        assert_close(length, expected, rtol=1e-9, atol=0.0)


# --- what is refused


def test_asking_for_back_contact():
    """An allowance on either gear does, be it zero."""
    pair = standard_30_30()
    thinner = _thinned(pair, 0.0, 0.0)
    assert not has_back_contact(pair)
    for gear in ("pinion", "wheel"):
        one = dataclasses.replace(getattr(pair, gear), thickness_allowance=0.0)
        assert has_back_contact(eqx.tree_at(lambda p, gear=gear: getattr(p, gear), pair, one))
    assert has_back_contact(thinner)


def test_a_negative_allowance_is_refused():
    gear = standard_30_30().pinion
    with pytest.raises(ValueError, match=r"must not be negative, got -1e-05 m\. Change its sign"):
        dataclasses.replace(gear, thickness_allowance=-10.0 * um)


def test_flanks_that_overlap_are_refused_with_what_would_do():
    """At 5 um less than the centre distance without backlash: 2 x 5 um tan(20 deg) are missing.

    To first order that is 3.42 um along the path, or 3.64 um of allowances.
    """
    tight = eqx.tree_at(
        lambda p: p.centre_distance,
        standard_30_30(),
        jnp.asarray(90.0 * mm - 5.0 * um),
        is_leaf=lambda x: x is None,
    )
    check_backlash(tight)
    needed = -float(_backlash(_thinned(tight, 0.0, 0.0))) / math.cos(math.radians(20.0)) / um
    assert_close(needed, 10.0 * math.tan(math.radians(20.0)), rtol=1e-3, atol=0.0)
    with pytest.raises(ValueError, match=re.escape(f"sum to 1 um, to {needed:.4g} um or more")):
        check_backlash(_thinned(tight, 1.0, 0.0))
    check_backlash(_thinned(tight, 2.0, needed - 2.0 + 1e-6))


def test_an_allowance_that_leaves_no_tip_is_refused():
    pair = standard_30_30()
    facts = pair_facts(pair)
    at_tip = float(facts.tip_radius[1] / facts.reference_radius[1])
    most = float(facts.tip_thickness[1]) / at_tip / um
    check_backlash(_thinned(pair, 0.0, 0.999 * most))
    with pytest.raises(
        ValueError, match=re.escape(f"wheel's teeth at their tips, where {most:.4g}")
    ):
        check_backlash(_thinned(pair, 0.0, 1.001 * most))


# --- gradients


@pytest.mark.slow
def test_backlash_and_back_lines_are_differentiable():
    """Steps stay where they are while the teeth move through them."""
    pair = _thinned(helical_25_31(), 60.0, 90.0)
    grid = jg.mesh_grid(helical_25_31(), phases=8, slices=2)
    draw = jnp.asarray(np.random.default_rng(3).uniform(size=(8, grid.lines, 2)))

    def seen(pair: jg.GearPair) -> jax.Array:
        _, back, _ = back_lines(pair, grid, jnp.linspace(0.0, 1.0, 9))
        places = jnp.sum(draw * back.fraction * (back.roll - pair.path_start))
        return normal_backlash(pair) + 0.1 * mirror_point(pair) + 0.01 * places

    assert_gradient(seen, pair, rtol=1e-5, step=1e-6, scale=sizes(pair))
