"""Separation and place of touch beyond the path, against profiles turned until they touch."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import (
    accessory,
    exchanged,
    fzg_c14,
    helical_25_31,
    iso_tr_6336_30,
    lengths_scaled,
    mirrored,
    over,
    sizes,
    standard_17_43,
)
from helpers import assert_close, assert_gradient, observed_order

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._geometry._tip_contact import tip_contact_rolls, tip_separation

# Programs are shared by giving every one the same number of places.
_PLACES = 400


@eqx.filter_jit
def _touch(pair: jg.GearPair, roll: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Gap, place on the pinion, place on the wheel, and by reverse slopes how they change."""

    def all_three(roll: jax.Array) -> jax.Array:
        return jnp.stack([tip_separation(pair, roll), *tip_contact_rolls(pair, roll)])

    values, back = jax.vjp(all_three, roll)
    slopes = [back(jnp.zeros_like(values).at[row].set(1.0))[0] for row in range(3)]
    return values, jnp.stack(slopes)


def _touching(pair: jg.GearPair, roll: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What `_touch` finds, at any number of places up to the common one."""
    padded = np.full(_PLACES, roll.flat[0])
    padded[: roll.size] = roll.ravel()
    values, slopes = (np.asarray(x) for x in _touch(pair, jnp.asarray(padded)))
    shape = (3, *roll.shape)
    return values[:, : roll.size].reshape(shape), slopes[:, : roll.size].reshape(shape)


def _evaluated(pair: jg.GearPair, roll: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gap and its slope along the path."""
    values, slopes = _touching(pair, roll)
    return values[0], slopes[0]


def _rolls(pair: jg.GearPair, roll: np.ndarray) -> np.ndarray:
    """Place of touch on the pinion and on the wheel."""
    return _touching(pair, roll)[0][1:]


# Unequal and helical, few teeth, an involute used almost from its base circle.
various_pairs = over(accessory, helical_25_31, slow=(standard_17_43, fzg_c14, iso_tr_6336_30))

# Distance beyond the end of the path, in base pitches.
BEYOND = np.array([0.003, 0.05, 0.1, 0.2, 0.35, 0.5])


def _places(pair: jg.GearPair, beyond: np.ndarray = BEYOND) -> np.ndarray:
    """The same distances before the start of the path and behind its end."""
    step = beyond * float(pair.transverse_base_pitch)
    return np.stack([float(pair.path_start) - step, float(pair.path_end) + step])


def _gaps(pair: jg.GearPair, beyond: np.ndarray = BEYOND) -> np.ndarray:
    return _evaluated(pair, _places(pair, beyond))[0]


class _Facing:
    """One gear whose flank is faced by the other's profile, in the transverse section.

    The gear stands at the origin, the other at +a on the line of centres. At the pitch point both
    flanks cross that line; the faced gear's flank looks anticlockwise, and so does the other's.
    """

    def __init__(self, pair: jg.GearPair, body: int):
        self.base, self.other_base = np.asarray(pair.base_radius)[[body, 1 - body]]
        self.form, self.other_form = np.asarray(pair.form_radius)[[body, 1 - body]]
        self.tip, self.other_tip = np.asarray(pair.tip_radius)[[body, 1 - body]]
        self.land = float(pair.tip_thickness[1 - body]) / self.other_tip
        self.centre = float(pair.working_centre_distance)
        self.angle = math.acos((self.base + self.other_base) / self.centre)
        self.sense = 1 - 2 * body
        self.pitch_point = float(pair.pitch_point)

    def flank(self, radius, turned, base):
        """Polar angle of an involute at a radius, turned from where it crosses the centres."""
        pressure = np.arccos(np.minimum(base / radius, 1.0))
        inv = np.tan(pressure) - pressure
        return math.tan(self.angle) - self.angle - inv + turned / base

    def profile(self, roll: float) -> tuple[np.ndarray, np.ndarray]:
        """The other gear's flank from form circle to tip corner, then its tip land."""
        radius = np.linspace(max(self.other_form, self.other_base), self.other_tip, 4001)
        turned = self.sense * (roll - self.pitch_point)
        angle = math.pi + self.flank(radius, -turned, self.other_base)
        land = angle[-1] - np.linspace(0.0, self.land, 1001)[1:]
        radius = np.concatenate([radius, np.full(land.shape, self.other_tip)])
        angle = np.concatenate([angle, land])
        return self.centre + radius * np.cos(angle), radius * np.sin(angle)

    def gaps(self, roll: float) -> np.ndarray:
        """Turn of the faced gear that brings its flank to each point, as an arc of its base."""
        x, y = self.profile(roll)
        radius, angle = np.hypot(x, y), np.arctan2(y, x)
        turned = self.sense * (roll - self.pitch_point)
        gap = self.base * (angle - self.flank(radius, turned, self.base))
        return np.where((radius >= self.form) & (radius <= self.tip), gap, np.inf)

    def place(self, roll: float, point: int) -> float:
        """Roll length on the faced gear of one point of the other's profile."""
        x, y = (part[point] for part in self.profile(roll))
        return math.sqrt(x**2 + y**2 - self.base**2)

    def arm(self, roll: float) -> float:
        """Distance of the corner gear's centre from the flank's normal through the corner."""
        x, y = (part[4000] for part in self.profile(roll))
        # The normal touches the base circle where the radius there is square to it.
        turn = math.atan2(y, x) - math.acos(self.base / math.hypot(x, y))
        return self.centre * math.cos(turn) - self.base


# --- the gap itself


@various_pairs
def test_profiles_turned_until_they_touch(make):
    """The least turn over both whole profiles, which is that of the tip corner, and its place."""
    pair = make()
    found = _gaps(pair) / math.cos(float(pair.base_helix_angle))
    places = _rolls(pair, _places(pair))
    for body in (0, 1):
        facing = _Facing(pair, body)
        tip_roll = math.sqrt(facing.other_tip**2 - facing.other_base**2)
        assert_close(places[1 - body, body], np.full(BEYOND.size, tip_roll), rtol=1e-12, atol=0.0)
        on_flank = places[body, body]
        for roll, gap, place in zip(_places(pair)[body], found[body], on_flank, strict=True):
            turns = facing.gaps(roll)
            assert np.argmin(turns) == 4000
            assert_close(gap, np.min(turns), rtol=1e-9, atol=1e-15)
            assert_close(place, facing.place(roll, 4000), rtol=1e-11, atol=0.0)


def test_the_numeric_check_finds_contact_on_the_path():
    """Within the path the two involutes touch, so that the check above can tell."""
    pair = helical_25_31()
    for body in (0, 1):
        facing, roll = _Facing(pair, body), float(pair.pitch_point) + 0.3 * mm
        turns = facing.gaps(roll)
        assert abs(np.min(turns)) < 1e-3 * um
        assert np.argmin(turns) < 4000
        # As near as the points of the profile are to each other.
        place = _rolls(pair, np.asarray([roll]))[body, 0]
        assert abs(place - facing.place(roll, int(np.argmin(turns)))) < 2 * um


def test_leading_order_by_hand():
    """T1T2 rho_a s^2 / (2 r_b^2 rho) with the radii of the accessory gears (Guilbert 2017)."""
    tangent = 99.45028 * math.sin(math.radians(26.444079))
    wheel, pinion = math.sqrt(66.63855**2 - 58.456852**2), math.sqrt(35.67855**2 - 30.587888**2)
    step = 0.001 * 4.270875
    early = tangent * wheel / (2 * 58.456852**2 * (tangent - wheel)) * step**2
    late = tangent * pinion / (2 * 30.587888**2 * (tangent - pinion)) * step**2
    found = _gaps(accessory(), np.array([0.001]))[:, 0] / mm
    assert_close(found, np.array([early, late]), rtol=3e-4, atol=0.0)


def test_gap_of_the_accessory_pair():
    """Three quarters of a micrometre at 0.05 base pitches, a tooth's bending at 0.2."""
    found = _gaps(accessory(), np.array([0.05, 0.1, 0.2])) / um
    expected = np.array([[0.778, 3.151, 12.911], [0.772, 3.114, 12.676]])
    assert_close(found, expected, rtol=1e-3, atol=0.0)


@over(accessory, fzg_c14, helical_25_31)
def test_gap_grows_with_the_square(make):
    beyond = np.array([2e-3, 4e-3, 8e-3])
    for gap in _gaps(make(), beyond):
        assert_close(observed_order(beyond, gap / mm), 2.0, rtol=1e-2, atol=0.0)


@various_pairs
def test_gap_is_exactly_zero_on_the_path_and_grows_beyond(make):
    pair = make()
    start, end = float(pair.path_start), float(pair.path_end)
    inside, _ = _evaluated(pair, np.linspace(start, end, 12)[1:-1])
    assert np.all(inside == 0.0)
    # Far beyond too: lines of a wide helical face run on for several base pitches.
    outside = _gaps(pair, np.linspace(0.02, 4.0, 200))
    assert np.all(np.diff(outside, axis=1) > 0.0)


# --- its slope


@various_pairs
def test_no_slope_on_the_path(make):
    """Exactly none, and at the ends, which a rounding error may miss, nothing else than none."""
    pair = make()
    roll = np.linspace(float(pair.path_start), float(pair.path_end), 9)
    _, slope = _evaluated(pair, roll)
    assert np.all(slope[1:-1] == 0.0)
    assert np.all(np.abs(slope) < 1e-14)


@various_pairs
def test_the_ends_of_the_path_are_on_it_however_they_are_rounded(make):
    pair = make()
    ends = np.array([float(pair.path_start), float(pair.path_end)])
    roll = (ends[:, None] + np.arange(-8.0, 9.0) * np.spacing(float(pair.tangent_length))).ravel()
    gap, slope = _evaluated(pair, roll)
    assert np.all(gap == 0.0)
    assert np.all(slope == 0.0)
    on_line = np.stack([roll, float(pair.tangent_length) - roll])
    assert_close(_rolls(pair, roll), on_line, rtol=1e-14, atol=1e-15)


@pytest.mark.slow
def test_gears_have_no_slope_where_the_gap_is_zero():
    pair = helical_25_31()

    start, end = float(pair.path_start), float(pair.path_end)
    roll = jnp.asarray(np.linspace(start, end, 7)[1:-1])

    def gaps(pair: jg.GearPair) -> jax.Array:
        return jnp.sum(tip_separation(pair, roll))

    slopes = jax.tree.leaves(eqx.filter_jit(eqx.filter_grad(gaps))(pair))
    assert slopes
    assert all(float(slope) == 0.0 for slope in slopes)


@various_pairs
def test_slope_shortens_the_arm_of_the_force(make):
    """Virtual work: the force at the corner has the arm (1 - g') r_b on the corner's gear."""
    pair = make()
    helix = math.cos(float(pair.base_helix_angle))
    places = _places(pair)
    slopes = _evaluated(pair, places)[1] * np.array([[-1.0], [1.0]]) / helix
    assert np.all(slopes > 0.0)
    for body in (0, 1):
        facing = _Facing(pair, body)
        arms = np.array([facing.arm(roll) for roll in places[body]])
        assert_close(1.0 - slopes[body], arms / facing.other_base, rtol=1e-10, atol=0.0)


@pytest.mark.slow
@over(helical_25_31, slow=(standard_17_43,))
def test_gap_is_differentiable_in_the_gears(make):
    pair = make()
    places = jnp.asarray(_places(pair, np.array([0.05, 0.2, 0.5])))
    weight = jnp.asarray([[3.0, 1.0, 0.3], [2.0, 0.7, 0.5]]) / um

    def gaps(arguments):
        pair, roll = arguments
        return jnp.sum(weight * tip_separation(pair, roll))

    scale = (jax.tree.map(lambda x: 1e-2 * x, sizes(pair)), 1e-2 * places)
    assert_gradient(gaps, (pair, places), rtol=1e-5, step=1e-3, scale=scale)


def test_corner_below_a_base_circle_stays_finite():
    """Only gears that interfere get there, and only as copies that nobody has checked."""
    pair = eqx.tree_at(lambda p: p.wheel.addendum, standard_17_43(), jnp.asarray(1.6))
    assert float(pair.path_start) < 0.0
    values, slopes = _touching(pair, np.linspace(float(pair.path_start) - 2 * mm, 0.0, _PLACES))
    assert np.all(np.isfinite(values))
    assert np.all(np.isfinite(slopes))


# --- the place of touch


def test_place_on_the_accessory_wheel():
    """0.8 mm past E: 26.249 mm, above the start of active profile; straight on it were 25.121."""
    pair = accessory()
    end, tangent = float(pair.path_end), float(pair.tangent_length)
    rolls = _rolls(pair, np.asarray([end, end + 0.8 * mm])) / mm
    expected = np.asarray([[end / mm, end / mm], [25.921, 26.249]])
    assert_close(rolls, expected, rtol=2e-5, atol=0.0)
    assert_close(np.asarray((tangent - end) / mm - 0.8), 25.121, rtol=2e-5, atol=0.0)


@various_pairs
def test_places_on_the_path_are_those_of_the_line_of_action(make):
    pair = make()
    roll = np.linspace(float(pair.path_start), float(pair.path_end), 9)
    values, slopes = _touching(pair, roll)
    expected = np.stack([roll, float(pair.tangent_length) - roll])
    assert_close(values[1:], expected, rtol=1e-14, atol=1e-15)
    assert np.all(slopes[1:, 1:-1] == np.asarray([[1.0], [-1.0]]))


@various_pairs
def test_places_are_continuous_at_the_ends(make):
    """Beyond, the corner stays, and on the other flank the slope is that of first order."""
    pair = make()
    base, tip = np.asarray(pair.base_radius), np.asarray(pair.tip_roll)
    tangent = float(pair.tangent_length)
    step = 1e-8 * float(pair.transverse_base_pitch)
    values, slopes = _touching(pair, _places(pair, np.asarray([-1e-8, 1e-8])))
    places, slopes = values[1:], slopes[1:] * np.asarray([[-1.0], [1.0]])
    for body in (0, 1):
        start = tangent - tip[1 - body]
        rate = base[body] * tip[1 - body] / (base[1 - body] * start) - 1.0
        assert rate > 0.0
        expected = start + step * np.asarray([1.0, rate])
        assert_close(places[body, body], expected, rtol=1e-9, atol=0.0)
        assert_close(slopes[body, body, 1], rate, rtol=1e-4, atol=0.0)
        corner = tip[1 - body] + step * np.asarray([-1.0, 0.0])
        assert_close(places[1 - body, body], corner, rtol=1e-14, atol=0.0)
        assert slopes[1 - body, body, 1] == 0.0


@various_pairs
def test_corner_moves_up_the_other_flank(make):
    """Away from the start of active profile all the time, by ever longer steps."""
    pair = make()
    places = _rolls(pair, _places(pair, np.linspace(0.0, 0.5, 200)[1:]))
    for body in (0, 1):
        start = float(pair.tangent_length - pair.tip_roll[1 - body])
        on_flank = places[body, body]
        assert on_flank[0] > start
        assert np.all(np.diff(on_flank) > 0.0)


@pytest.mark.slow
def test_places_are_differentiable_in_the_gears():
    """On the path and beyond either end of it."""
    pair = helical_25_31()
    beyond = np.array([0.05, 0.2, 0.5, -0.1, -0.3])
    places = jnp.asarray(_places(pair, beyond))
    weight = jnp.asarray(np.random.default_rng(5).uniform(0.5, 1.5, (2, *places.shape))) / mm

    def places_of_touch(arguments):
        pair, roll = arguments
        return jnp.sum(weight * jnp.stack(tip_contact_rolls(pair, roll)))

    scale = (jax.tree.map(lambda x: 1e-2 * x, sizes(pair)), 1e-2 * places)
    assert_gradient(places_of_touch, (pair, places), rtol=1e-6, step=1e-4, scale=scale)


# --- symmetries


@over(accessory, helical_25_31)
def test_pinion_and_wheel_change_places(make):
    pair = make()
    roll = _places(pair)
    other, _ = _touching(exchanged(pair), float(pair.tangent_length) - roll)
    own, _ = _touching(pair, roll)
    assert_close(other[0], own[0], rtol=1e-9, atol=1e-15)
    assert_close(other[[2, 1]], own[1:], rtol=1e-12, atol=0.0)


def test_hand_of_the_helix_does_not_matter():
    pair = helical_25_31()
    assert_close(_gaps(mirrored(pair)), _gaps(pair), rtol=1e-12, atol=0.0)


@over(accessory, helical_25_31)
def test_gap_scales_with_the_gears(make):
    pair = make()
    larger, own = lengths_scaled(pair, 37.0), pair
    assert_close(_gaps(larger), 37.0 * _gaps(own), rtol=1e-9, atol=1e-14)
    rolls, expected = _rolls(larger, _places(larger)), 37.0 * _rolls(own, _places(own))
    assert_close(rolls, expected, rtol=1e-12, atol=0.0)


def test_helical_gap_is_the_transverse_one_along_the_normal():
    """The same transverse section as a spur pair: module, pressure angle and heights of its own."""
    pair = helical_25_31()
    helix = float(pair.helix_angle)

    def spur(gear: jg.Gear) -> jg.Gear:
        height = gear.addendum - gear.tip_shortening
        return eqx.tree_at(
            lambda g: [g.profile_shift, g.addendum, g.dedendum, g.tip_shortening, g.fillet_radius],
            gear,
            [
                gear.profile_shift * math.cos(helix),
                height * math.cos(helix),
                gear.dedendum * math.cos(helix),
                jnp.zeros(()),
                gear.fillet_radius * math.cos(helix),
            ],
        )

    section = jg.GearPair(
        spur(pair.pinion),
        spur(pair.wheel),
        pair.transverse_module,
        pair.transverse_pressure_angle,
        0.0,
        pair.working_centre_distance,
    )
    expected = math.cos(float(pair.base_helix_angle)) * _gaps(section)
    assert_close(_gaps(pair), expected, rtol=1e-9, atol=1e-15)


def test_one_trace():
    traced = eqx.filter_jit(eqx.debug.assert_max_traces(tip_separation, max_traces=1))
    for roll in (10 * mm, 12 * mm, 20 * mm):
        traced(accessory(), jnp.asarray([roll]))


@pytest.mark.parametrize("shape", [(), (4,), (2, 3, 4)])
def test_shapes_are_kept(shape):
    roll = jnp.full(shape, 10 * mm)
    for values in (tip_separation(accessory(), roll), *tip_contact_rolls(accessory(), roll)):
        assert values.shape == shape
