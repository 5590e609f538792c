"""Sliding along the path of contact: by hand, from velocities, and Ohlendorf's loss factor."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import helical_25_31, sizes
from helpers import assert_close, assert_gradient
from solve_cases import Drawing

import jaxgear as jg
from jaxgear import mm

# Standard teeth of module 2: r = 20, 40; r_b = 18.793852, 37.587705; r_a = 22, 42 mm, so that
# T1A = 1.781826, T1C = 6.840403, T1E = 11.436394 of T1T2 = 20.521209 mm.
BY_HAND = Drawing(teeth=(20, 40), module=2.0 * mm)
START, PITCH_POINT, END = 1.7818264 * mm, 6.8404029 * mm, 11.4363942 * mm


@pytest.fixture(scope="module")
def pair():
    return BY_HAND.pair()


def test_sliding_by_hand(pair):
    """1 - 18.739382/(2 x 1.781826) and 1 - 2 x 11.436394/9.084814 are the lowest of each gear."""
    roll = jnp.asarray([START, PITCH_POINT, END])
    found = np.asarray(jg.specific_sliding(pair, roll))
    assert_close(found[0, 0], -4.258476, rtol=1e-6, atol=0.0)
    assert_close(found[1, 2], -1.517695, rtol=1e-6, atol=0.0)
    assert np.abs(found[:, 1]).max() < 1e-6
    # 1.5 x 100 rad/s x 5.058577 mm before the pitch point, 4.595991 mm behind it.
    speed = jg.sliding_speed(pair, roll, jnp.asarray(100.0))
    assert_close(speed[0], -0.7587865, rtol=1e-6, atol=0.0)
    assert_close(speed[2], 0.6893987, rtol=1e-6, atol=0.0)


def test_loss_factor_by_hand(pair):
    """e1 = 0.778419, e2 = 0.856767 on p_b = 5.904263 mm: pi 1.5/20 (1 - e1 - e2 + e1^2 + e2^2)."""
    assert_close(jg.tooth_loss_factor(pair), 0.1660645, rtol=1e-5, atol=0.0)


def test_sliding_is_the_difference_of_the_velocities_of_both_flanks():
    """Helical gears, at the place of contact in the transverse plane, each turning by itself."""
    pair = helical_25_31()
    facts = jax.tree.map(np.asarray, jg.pair_facts(pair))
    angle = facts.working_pressure_angle
    roll = np.linspace(facts.path_start, facts.path_end, 7)
    along, across = (np.sin(angle), np.cos(angle)), (np.cos(angle), -np.sin(angle))
    place = facts.base_radius[0] * np.asarray(across) + roll[:, None] * np.asarray(along)
    from_wheel = place - [facts.working_centre_distance, 0.0]
    turned = lambda speed, arm: speed * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    speeds = 250.0, -250.0 * pair.pinion.teeth / pair.wheel.teeth
    apart = turned(speeds[0], place) - turned(speeds[1], from_wheel)
    # Along the line of action flanks neither part nor dig in.
    assert np.abs(apart @ along).max() < 1e-12
    found = jg.sliding_speed(pair, jnp.asarray(roll), jnp.asarray(speeds[0]))
    assert_close(found, apart @ -np.asarray(across), rtol=1e-11, atol=1e-12)
    rolled = [turned(speed, arm) @ -np.asarray(across) for speed, arm in
              zip(speeds, (place, from_wheel), strict=True)]  # fmt: skip
    slid = np.stack([1.0 - rolled[1] / rolled[0], 1.0 - rolled[0] / rolled[1]])
    assert_close(jg.specific_sliding(pair, jnp.asarray(roll)), slid, rtol=1e-10, atol=1e-12)


def test_sliding_follows_the_drawing():
    roll = jnp.asarray(15.0 * mm)

    def told(pair: jg.GearPair):
        speed = jg.sliding_speed(pair, roll, jnp.asarray(100.0))
        return speed + jnp.sum(jg.specific_sliding(pair, roll)) + jg.tooth_loss_factor(pair)

    drawn = helical_25_31()
    assert_gradient(told, drawn, rtol=1e-5, step=1e-7, scale=sizes(drawn))


def test_a_high_contact_ratio_has_no_closed_form():
    high = Drawing(
        teeth=(60, 90), module=2.0 * mm, addendum=(1.4, 1.4), dedendum=(1.6, 1.6), fillet=0.1
    )
    with pytest.raises(ValueError, match=r"contact ratio between 1 and 2, got 2.*mesh_loss_factor"):
        jg.tooth_loss_factor(high.pair())
    assert math.isfinite(float(jg.sliding_speed(high.pair(), jnp.asarray(0.01), jnp.asarray(1.0))))
