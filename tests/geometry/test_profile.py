import dataclasses
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import (
    accessory,
    every_pair,
    every_spur_pair,
    fzg_c14,
    helical_25_31,
    high_contact_ratio,
    iso_tr_6336_30,
    lengths_scaled,
    mirrored,
    over,
    power,
    sizes,
    standard_17_43,
    standard_30_30,
)
from helpers import assert_close, assert_gradient
from scipy.optimize import brentq, minimize_scalar

import jaxgear as jg
from jaxgear import deg, mm

_ROOT = jnp.asarray(0.5 * math.pi)
some_pairs = over(accessory, fzg_c14, standard_30_30, high_contact_ratio, power, helical_25_31)


def _sections(pair: jg.GearPair) -> list[jg.ToothSection]:
    return [jg.tooth_section(pair, gear) for gear in (pair.pinion, pair.wheel)]


class _Rack:
    """The generating rack, rolled round the blank: an independent picture of how a tooth is cut.

    The tooth stands on +Y, the rack's teeth point down at it from either side. Turning the blank
    by `turn` moves the rack to the left by the arc of the reference circle.
    """

    def __init__(self, section: jg.ToothSection):
        module, x = float(section.module), float(section.profile_shift)
        self.alpha = float(section.pressure_angle)
        self.tip = float(section.fillet_radius) * module
        self.reference = 0.5 * module * float(section.teeth)
        deep = float(section.dedendum) * module - self.tip
        flat = (
            0.25 * math.pi * module - deep * math.tan(self.alpha) - self.tip / math.cos(self.alpha)
        )
        line = self.reference + x * module
        # The middle of the corner that cuts the right-hand fillet, and a point of its flank.
        self.corner = complex(0.5 * math.pi * module - flat, line - deep)
        self.flank = complex(0.25 * math.pi * module, line)

    def seen_from_blank(self, point: complex, turn: np.ndarray) -> np.ndarray:
        return (point - self.reference * turn) * np.exp(-1j * turn)

    def gap_to_corner(self, point: complex) -> tuple[float, float]:
        """How near the rounded corner comes to a point of the blank, and at which turn."""
        return _least(lambda t: np.abs(self.seen_from_blank(self.corner, t) - point) - self.tip)

    def gap_to_flank(self, point: complex) -> tuple[float, float]:
        """How near the straight flank, taken as endless, comes to a point of the blank."""

        def gap(turn: np.ndarray) -> np.ndarray:
            # The rack's outward normal points to the left and down.
            outward = np.exp(1j * (math.pi + self.alpha - turn))
            return ((point - self.seen_from_blank(self.flank, turn)) * np.conj(outward)).real

        return _least(gap)


def _least(function: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """Least value over half a radian either way, and where."""
    turns = np.linspace(-0.5, 0.5, 2001)
    nearest = turns[np.argmin(function(turns))]
    found: Any = minimize_scalar(
        lambda t: float(function(np.asarray(t))),
        bounds=(nearest - 1e-3, nearest + 1e-3),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return float(found.fun), float(found.x)


@eqx.filter_jit
def _fillet(section: jg.ToothSection, angle: jax.Array):
    """A point of the fillet, and how it moves with the angle."""
    return jax.jvp(section.fillet, (angle,), (jnp.ones_like(angle),))


@eqx.filter_jit
def _flank(section: jg.ToothSection, roll: jax.Array):
    """A point of the flank, and how it moves with the roll angle."""
    return jax.jvp(section.flank, (roll,), (jnp.ones_like(roll),))


def _point(found: tuple[jax.Array, jax.Array]) -> complex:
    return complex(float(found[0]), float(found[1]))


# --- conjugacy: the tooth is what the rolling rack leaves


@some_pairs
def test_fillet_is_what_the_rounded_corner_leaves(make):
    """The corner touches every point of the fillet, along its own normal, and cuts no deeper."""
    for section in _sections(make()):
        rack = _Rack(section)
        for angle in np.linspace(float(section.pressure_angle), 0.5 * math.pi, 6):
            point = _point(_fillet(section, jnp.asarray(angle))[0])
            gap, turn = rack.gap_to_corner(point)
            assert abs(gap) < 1e-9 * float(section.module)
            # In the rack's own frame the touching point lies to the left and below.
            normal = (point - rack.seen_from_blank(rack.corner, np.asarray(turn))) / rack.tip
            direction = complex(normal * np.exp(1j * turn))
            assert abs(direction + np.exp(1j * angle)) < 1e-4


@some_pairs
def test_flank_is_what_the_straight_side_leaves(make):
    pair = make()
    tips = pair.tip_roll / pair.base_radius
    for section, tip in zip(_sections(pair), tips, strict=True):
        rack = _Rack(section)
        for roll in np.linspace(float(section.form_roll_angle), float(tip), 6):
            gap, _ = rack.gap_to_flank(_point(_flank(section, jnp.asarray(roll))[0]))
            assert abs(gap) < 1e-9 * float(section.module)


@some_pairs
def test_fillet_meets_the_involute(make):
    """In place and in direction."""
    for section in _sections(make()):
        start, start_slope = _flank(section, section.form_roll_angle)
        end, end_slope = _fillet(section, section.pressure_angle)
        assert_close(np.stack(end), np.stack(start), rtol=1e-11, atol=1e-15)
        along = [slope / np.hypot(*slope) for slope in map(np.stack, (start_slope, end_slope))]
        # The fillet runs down as the rack's angle grows.
        assert_close(along[1], -along[0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("lacking", [0.0, 0.0056, 0.0199])
def test_allowed_undercut_leaves_the_active_flank(lacking):
    """The corner cuts less than a thousandth of a micron per mm of module above the form circle."""
    sine = math.sin(20.0 * deg)
    shift = 1.25 - 0.38 * (1.0 - sine) - 7.5 * sine**2 - lacking
    pair = jg.GearPair(
        jg.Gear(15, 10.0 * mm, shift), jg.Gear(43, 10.0 * mm, addendum=0.9), 1.0 * mm
    )
    section = jg.tooth_section(pair, pair.pinion)
    rack = _Rack(section)
    start = float(pair.path_start / pair.base_radius[0])
    gaps = [
        rack.gap_to_corner(_point(_flank(section, jnp.asarray(roll))[0]))[0]
        for roll in np.linspace(start, 2.0 * start, 20)
    ]
    assert min(gaps) > -1e-6 * float(section.module)


# --- dimensions


@every_pair
def test_root_circle(make):
    for section in _sections(make()):
        x, y = _fillet(section, _ROOT)[0]
        depth = section.module * (section.dedendum - section.profile_shift)
        radius = 0.5 * section.module * section.teeth - depth
        assert_close(section.root_radius, radius, rtol=1e-14, atol=0.0)
        assert_close(jnp.hypot(x, y), radius, rtol=1e-13, atol=0.0)
        # The fillet leaves it tangentially.
        slope = _fillet(section, _ROOT)[1]
        assert abs(float(x * slope[0] + y * slope[1])) < 1e-12 * float(radius) ** 2


def test_root_half_angle_by_hand():
    """C14 pinion: pi/16 less half the tip's flat over r, (pi/4 - .87 tan 20 - .38/cos 20)/8."""
    flat = math.pi / 4.0 - 0.87 * math.tan(20.0 * deg) - 0.38 / math.cos(20.0 * deg)
    section = jg.tooth_section(fzg_c14(), fzg_c14().pinion)
    assert_close(section.root_half_angle, math.pi / 16.0 - flat / 8.0, rtol=1e-12, atol=0.0)


@every_spur_pair
def test_spur_section_is_the_gear(make):
    pair = make()
    sections = _sections(pair)
    for name in ("reference_radius", "base_radius", "root_radius"):
        got = jnp.stack([getattr(section, name) for section in sections])
        assert_close(got, getattr(pair, name), rtol=1e-13, atol=0.0)
    form = jnp.stack([section.form_roll_angle for section in sections])
    # The junction lies on the form circle, undercut or not.
    assert_close(form, jnp.abs(pair.form_roll / pair.base_radius), rtol=1e-9, atol=1e-12)


def test_virtual_teeth_of_iso_tr_6336_30():
    teeth = [float(section.teeth) for section in _sections(iso_tr_6336_30())]
    assert_close(jnp.asarray(teeth), jnp.asarray([18.90512, 114.54280]), rtol=0.0, atol=5e-6)


@every_pair
def test_virtual_gear_keeps_the_normal_curvature(make):
    """At the pitch point of the generating rack: r sin(alpha_t)/cos(beta_b)."""
    pair = make()
    expected = pair.reference_radius * jnp.sin(pair.transverse_pressure_angle)
    expected /= jnp.cos(pair.base_helix_angle)
    got = [s.base_radius * jnp.tan(s.pressure_angle) for s in _sections(pair)]
    assert_close(jnp.stack(got), expected, rtol=1e-12, atol=0.0)


@every_pair
def test_thickness_by_iso_21771(make):
    """s(r) = 2 r [s/(2 r_ref) + inv(alpha) - inv(alpha_r)], the rack's own on its pitch circle."""
    for section in _sections(make()):
        alpha = float(section.pressure_angle)
        arc = float(section.module) * (
            0.5 * math.pi + 2.0 * float(section.profile_shift) * math.tan(alpha)
        )
        reference = float(section.reference_radius)
        on_reference = 2.0 * reference * float(section.half_angle(jnp.asarray(math.tan(alpha))))
        assert_close(on_reference, arc, rtol=1e-12, atol=0.0)
        for growth in (0.98, 1.01, 1.04):
            radius = growth * reference
            angle = math.acos(reference * math.cos(alpha) / radius)
            inv = math.tan(alpha) - alpha - math.tan(angle) + angle
            half = arc / (2.0 * reference) + inv
            x, y = _flank(section, jnp.asarray(math.tan(angle)))[0]
            assert_close(jnp.hypot(x, y), radius, rtol=1e-13, atol=0.0)
            assert_close(jnp.arctan2(x, y), half, rtol=1e-12, atol=0.0)


@some_pairs
def test_root_chord_of_iso_6336_3(make):
    """Its s_Fn, the chord where the fillet is at 30 degrees to the centreline."""
    for section in _sections(make()):
        teeth, x = float(section.teeth), float(section.profile_shift)
        alpha, deep = float(section.pressure_angle), float(section.dedendum)
        tip = float(section.fillet_radius)
        E = math.pi / 4 - deep * math.tan(alpha) - (1.0 - math.sin(alpha)) * tip / math.cos(alpha)
        G = tip - deep + x
        H = 2.0 / teeth * (math.pi / 2 - E) - math.pi / 3
        theta = brentq(lambda t, g=2.0 * G / teeth, h=H: g * math.tan(t) - h - t, -0.5, 1.4)
        assert isinstance(theta, float)
        chord = teeth * math.sin(math.pi / 3 - theta)
        chord += math.sqrt(3.0) * (G / math.cos(theta) - tip)

        def off(angle: float, section: jg.ToothSection = section) -> float:
            slope = _fillet(section, jnp.asarray(angle))[1]
            return math.atan2(abs(float(slope[0])), abs(float(slope[1]))) - 30.0 * deg

        found = brentq(off, alpha + 1e-6, 0.5 * math.pi - 1e-6, xtol=1e-13)
        assert isinstance(found, float)
        half = _fillet(section, jnp.asarray(found))[0][0]
        assert_close(2.0 * half / section.module, chord, rtol=1e-9, atol=0.0)


def test_tooth_narrows_upwards():
    """From the root circle to the tip the height grows and the thickness falls."""
    pair = accessory()
    for section, tip in zip(_sections(pair), pair.tip_roll / pair.base_radius, strict=True):
        x, y = section.fillet(jnp.linspace(_ROOT, section.pressure_angle, 30))
        more_x, more_y = section.flank(jnp.linspace(section.form_roll_angle, tip, 30))
        half = np.concatenate([x, more_x[1:]])
        height = np.concatenate([y, more_y[1:]])
        assert (np.diff(height) > 0.0).all()
        assert (np.diff(half) < 0.0).all()


# --- scaling, symmetry, gradients


@some_pairs
def test_sections_scale(make):
    pair = make()
    for one, other in zip(_sections(pair), _sections(lengths_scaled(pair, by=37.0)), strict=True):
        assert_close(other.root_half_angle, one.root_half_angle, rtol=1e-11, atol=0.0)
        angle = jnp.asarray(0.9)
        expected = 37.0 * jnp.stack(one.fillet(angle))
        assert_close(jnp.stack(other.fillet(angle)), expected, rtol=1e-12, atol=1e-15)


def test_the_hand_of_the_helix_does_not_matter():
    for one, other in zip(_sections(power()), _sections(mirrored(power())), strict=True):
        assert_close(other, one, rtol=1e-14, atol=0.0)


@pytest.mark.slow
@over(helical_25_31, slow=(standard_17_43,))
def test_gradients(make):
    """Every point and size of both sections, each counted differently."""
    pair = make()

    def mixed(p: jg.GearPair) -> jax.Array:
        total = jnp.zeros(())
        for weight, section in zip((1.0, 1.7), _sections(p), strict=True):
            fillet = section.fillet(jnp.asarray(0.8))
            flank = section.flank(jnp.asarray(0.45))
            lengths = 3.0 * fillet[0] + 0.7 * fillet[1] + 1.3 * flank[0] - 0.4 * flank[1]
            total += weight * (lengths / section.module + 2.0 * section.root_half_angle)
            if make is helical_25_31:
                total += 0.3 * weight * section.form_roll_angle
        return total

    assert_gradient(mixed, pair, rtol=1e-6, scale=sizes(pair))


def test_every_field_of_a_section_is_differentiable():
    section = jg.tooth_section(helical_25_31(), helical_25_31().pinion)
    slopes = jax.tree.leaves(eqx.filter_grad(lambda s: s.root_half_angle)(section))
    # All but module, bore and, as the rack's tip stays over the same foot, the profile shift.
    named = dataclasses.fields(section)
    moving = [f.name for f, slope in zip(named, slopes, strict=True) if abs(float(slope)) > 1e-6]
    assert moving == ["teeth", "pressure_angle", "dedendum", "fillet_radius"]


def test_radius_ratio_is_that_of_the_real_gear():
    """Root circle over bore: 25 teeth of 2 mm at 17 degrees, x = 0.23, dedendum 1.28, on 20 mm."""
    pair = helical_25_31()
    root = 25 * 2.0 / (2 * math.cos(math.radians(17.0))) - 2.0 * (1.28 - 0.23)
    section = jg.tooth_section(pair, pair.pinion)
    assert_close(section.radius_ratio, root / 10.0, rtol=1e-12, atol=0.0)
    assert jg.tooth_section(standard_17_43(), standard_17_43().pinion).radius_ratio is None
