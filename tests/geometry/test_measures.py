"""Span over teeth, measure over balls, tip and root diameters: there and back, and by points."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import quick
from scipy.optimize import least_squares

import jaxgear as jg
from jaxgear import deg, mm, um

_ODD = {"module": 3.0 * mm, "pressure_angle": 20.0 * deg, "helix_angle": 25.0 * deg}


def _pair(pinion, wheel, module=3.0 * mm, angle=20.0 * deg, helix=0.0):
    """Gears of teeth, profile shift and tooth thickness allowance."""
    gears = [
        jg.Gear(z, 20.0 * mm, profile_shift=x, thickness_allowance=thinner)
        for z, x, thinner in (pinion, wheel)
    ]
    return jg.GearPair(gears[0], gears[1], module, angle, helix)


def _both(*values):
    return jnp.asarray(values, dtype=float)


def test_spans_of_the_textbook():
    """SDP/SI, Elements of Metric Gear Technology, tables 10-4 and 10-5: 32.8266 and 42.0085 mm."""
    spur, helical = (_pair((24, 0.4, None), (40, 0.0, None), helix=b * deg) for b in (0.0, 25.0))
    assert abs(jg.span_measure(spur, _both(4, 5))[0] / mm - 32.8266) < 5e-5
    assert abs(jg.span_measure(helical, _both(5, 5))[0] / mm - 42.0085) < 5e-5
    assert jg.usual_span(spur)[0] == 4.0
    assert jg.usual_span(helical)[0] == 5.0


def test_measure_over_pins_of_the_textbook():
    """The same, table 10-9: module 1, 20 teeth, pins of 1.7 mm, 22.2941 mm."""
    pair = _pair((20, 0.0, None), (41, 0.0, None), module=1.0 * mm)
    measure = jg.ball_measure(pair, _both(1.7 * mm, 1.7 * mm))[0]
    assert abs(measure / mm - 22.2941) < 5e-5


# --- by points of the flanks


def _flank(pair, body, side):
    """Point and normal of one flank of the tooth on the x axis; right-hand, +z along the axis."""
    base = float(pair.base_radius[body])
    half = float(pair.half_thickness_at_base[body])
    pitch = float(jnp.tan(pair.helix_angle) / pair.reference_radius[body])

    def point(roll, height):
        turn = side * (half - (roll - np.arctan(roll))) + height * pitch
        radius = base * np.hypot(1.0, roll)
        return np.array([radius * np.cos(turn), radius * np.sin(turn), height])

    return point


def _turned(point, angle):
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ point


def _tangents(surface, at, step=1e-6):
    scale = np.array([1.0, 1e-2]) * step
    ends = np.eye(2) * scale
    return [(surface(*(at + e)) - surface(*(at - e))) / (2.0 * e.sum()) for e in ends]


@pytest.mark.parametrize("helix", [0.0, 25.0])
def test_a_span_is_a_common_normal_of_two_flanks(helix):
    """Found from points of two helicoids alone, wherever along the flanks it begins."""
    pair = _pair((24, 0.4, None), (40, 0.0, None), helix=helix * deg)
    spanned, angle = 5, 2.0 * np.pi / 24
    right, left = _flank(pair, 0, -1.0), _flank(pair, 0, 1.0)
    last = lambda roll, height: _turned(left(roll, height), (spanned - 1) * angle)

    def off(x):
        apart = last(*x[2:]) - right(*x[:2])
        along = [*_tangents(right, x[:2]), *_tangents(last, x[2:])]
        # Faces touch along lines: of all their common normals the one that is symmetric.
        cosines = (apart @ t / np.linalg.norm(apart) / np.linalg.norm(t) for t in along)
        return [*cosines, x[0] - x[2], x[1] + x[3]]

    found = least_squares(
        off, [0.5, 0.0, 0.5, 0.0], x_scale=[1.0, 1e-2] * 2, xtol=1e-15, ftol=1e-15
    )
    span = np.linalg.norm(last(*found.x[2:]) - right(*found.x[:2]))
    assert np.abs(found.fun).max() < 1e-8
    assert abs(jg.span_measure(pair, _both(spanned, 5))[0] / span - 1.0) < 1e-9
    radius = np.linalg.norm(right(*found.x[:2])[:2])
    assert abs(jg.span_radius(pair, _both(spanned, 5))[0] / radius - 1.0) < 1e-6


@pytest.mark.parametrize("teeth", [24, 25])
@pytest.mark.parametrize("helix", [0.0, 25.0])
def test_a_ball_touches_its_flanks_and_no_more(teeth, helix):
    """Its centre in the middle of a space is half a ball from the nearest point of the flank."""
    pair = _pair((teeth, 0.4, None), (40, 0.0, None), helix=helix * deg)
    ball = 5.25 * mm
    measure = float(jg.ball_measure(pair, _both(ball, ball))[0])
    across = (measure - ball) / (1.0 if teeth == 24 else np.cos(0.5 * np.pi / teeth))
    centre = _turned(np.array([0.5 * across, 0.0, 0.0]), np.pi / teeth)
    flank = _flank(pair, 0, 1.0)
    scaled = lambda x: (flank(*x) - centre) / ball
    found = least_squares(scaled, [0.5, 0.0], x_scale=[1.0, 1e-2], xtol=1e-15, gtol=1e-15)
    assert abs(np.linalg.norm(scaled(found.x)) - 0.5) < 1e-8
    radius = np.linalg.norm(flank(*found.x)[:2])
    assert abs(jg.ball_radius(pair, _both(ball, ball))[0] / radius - 1.0) < 1e-6
    # Two balls apart by whole spaces, as far across as can be.
    other = _turned(centre, 2.0 * np.pi / teeth * (teeth // 2))
    assert abs(np.linalg.norm(other - centre) + ball - measure) < 1e-12


@pytest.mark.parametrize("helix", [0.0, 12.0, 35.0])
def test_the_usual_ball_touches_midway_up_the_teeth(helix):
    pair = _pair((24, 0.4, None), (41, -0.1, None), helix=helix * deg)
    middle = pair.reference_radius + pair.normal_module * pair.of_bodies("profile_shift")
    assert np.allclose(jg.ball_radius(pair, jg.usual_ball(pair)), middle, rtol=1e-12, atol=0.0)


# --- there and back


@pytest.mark.parametrize(("teeth", "shift", "helix", "thinner"), quick(2, [
    (24, 0.4, 0.0, 0.0), (25, -0.2, 0.0, 60.0), (24, 0.0, 18.0, 40.0), (41, 0.9, 33.0, 0.0),
]))  # fmt: skip
def test_profile_shift_comes_back_from_either_measure(teeth, shift, helix, thinner):
    pair = _pair((teeth, shift, thinner * um), (40, 0.0, None), helix=helix * deg)
    drawn = {
        "teeth": teeth,
        "module": 3.0 * mm,
        "pressure_angle": 20.0 * deg,
        "helix_angle": helix * deg,
        "thickness_allowance": thinner * um,
    }
    spanned, ball = jg.usual_span(pair), jg.usual_ball(pair)
    span, over = jg.span_measure(pair, spanned)[0], jg.ball_measure(pair, ball)[0]
    back = jg.profile_shift_of_span(float(span), int(spanned[0]), **drawn)
    assert abs(back - shift) < 1e-12
    assert abs(jg.profile_shift_of_balls(float(over), float(ball[0]), **drawn) - shift) < 1e-12
    # The same closed forms for arrays.
    assert abs(jg.profile_shift_of_span(span, int(spanned[0]), **drawn) - shift) < 1e-12
    assert abs(jg.profile_shift_of_balls(over, ball[0], **drawn) - shift) < 1e-12


def test_addendum_and_dedendum_come_back_from_diameters():
    gears = (
        jg.Gear(23, 0.02, 0.25, 0.96, 1.31, 0.3, 0.04),
        jg.Gear(64, 0.02, -0.1, 1.02, 1.27, 0.3, 0.02),
    )
    pair = jg.GearPair(*gears, 2.0 * mm, 20.0 * deg, 17.0 * deg)
    for body, gear in enumerate(gears):
        drawn = {
            "teeth": gear.teeth,
            "module": 2.0 * mm,
            "helix_angle": 17.0 * deg,
            "profile_shift": float(gear.profile_shift),
        }
        tip, root = 2.0 * float(pair.tip_radius[body]), 2.0 * float(pair.root_radius[body])
        short = float(gear.tip_shortening)
        assert abs(jg.addendum_of_tip(tip, tip_shortening=short, **drawn) - gear.addendum) < 1e-12
        assert abs(jg.dedendum_of_root(root, **drawn) - gear.dedendum) < 1e-12


def test_a_shift_follows_its_measures():
    """1/(2 m sin alpha) per metre of span; over balls against central differences."""
    by_span = lambda w: jg.profile_shift_of_span(w, 5, teeth=24, **_ODD)
    slope = jax.jit(jax.grad(by_span))(jnp.asarray(42.0 * mm))
    assert abs(slope * 6.0 * mm * np.sin(20.0 * deg) - 1.0) < 1e-12
    by_balls = jax.jit(lambda m: jg.profile_shift_of_balls(m, 5.25 * mm, teeth=25, **_ODD))
    over, step = 93.0 * mm, 1.0 * um
    central = (by_balls(over + step) - by_balls(over - step)) / (2.0 * step)
    assert abs(jax.jit(jax.grad(by_balls))(jnp.asarray(over)) / central - 1.0) < 1e-6


def test_balls_that_fall_through_are_no_measure():
    with pytest.raises(ValueError, match="math domain"):
        jg.profile_shift_of_balls(60.0 * mm, 5.0 * mm, teeth=24, **_ODD)


def test_plain_numbers_need_no_jax():
    program = (
        "import sys; from jaxgear._geometry._drawn import profile_shift_of_span as f; "
        "print(f(0.0328, 4, teeth=24, module=0.003, pressure_angle=0.349)); "
        "sys.exit('jax' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)
