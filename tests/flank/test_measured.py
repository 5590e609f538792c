import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import accessory, helical_25_31, over, power, sizes
from helpers import assert_close, assert_gradient, observed_order

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._contact._cells import flank_coordinates
from jaxgear._flank._measured import (
    MeasuredProfile,
    MeasuredTopography,
    diameter_of_profile_place,
    face_place_of_position,
    profile_place_of_diameter,
    profile_place_of_roll,
    profile_place_of_roll_angle,
    roll_angle_of_profile_place,
    roll_of_profile_place,
)

both_gears = pytest.mark.parametrize("gear", [0, 1])


def _profile() -> MeasuredProfile:
    return MeasuredProfile([0.0, 0.25, 0.75, 1.0], np.asarray([-4.0, 2.0, 0.0, -8.0]) * um)


def _topography() -> MeasuredTopography:
    deviation = np.asarray([[1.0, 3.0, -1.0], [5.0, -2.0, 4.0]]) * um
    return MeasuredTopography([0.2, 0.8], [-1.0, 0.0, 0.5], deviation)


@jax.jit
def _evaluated(law, profile, face):
    return law(profile, face)


# --- tables by hand


def test_profile_by_hand():
    place = jnp.asarray([0.0, 0.125, 0.25, 0.5, 0.7, 0.75, 0.875, 1.0])
    microns = np.asarray([-4.0, -1.0, 2.0, 1.0, 0.2, 0.0, -4.0, -8.0])
    found = _evaluated(_profile(), place, jnp.linspace(-2.0, 2.0, 8))
    assert_close(found, microns * um, rtol=1e-13, atol=1e-18)


def test_topography_by_hand():
    """Its six points, a point on each kind of edge, and the middle of a cell: the mean of four."""
    profile = jnp.asarray([0.2, 0.2, 0.2, 0.8, 0.8, 0.8, 0.5, 0.2, 0.5, 0.35])
    face = jnp.asarray([-1.0, 0.0, 0.5, -1.0, 0.0, 0.5, -1.0, 0.25, -0.5, 0.4])
    # The last: a quarter of the way up, at columns 0 and 0.5, then 0.8 of the way across.
    last = 0.2 * (0.75 * 3.0 + 0.25 * -2.0) + 0.8 * (0.75 * -1.0 + 0.25 * 4.0)
    microns = np.asarray([1.0, 3.0, -1.0, 5.0, -2.0, 4.0, 3.0, 1.0, 1.75, last])
    assert_close(_evaluated(_topography(), profile, face), microns * um, rtol=1e-12, atol=1e-18)


def test_beyond_the_ends_the_last_value_stays():
    place = jnp.asarray([-3.0, 0.0, 1.0, 1.2])
    found = _evaluated(_profile(), place, jnp.zeros(4))
    assert_close(found, np.asarray([-4.0, -4.0, -8.0, -8.0]) * um, rtol=1e-14, atol=0.0)
    outside = [(-1.0, -2.0, 1.0), (-1.0, 2.0, -1.0), (2.0, -2.0, 5.0), (2.0, 0.0, -2.0)]
    profile, face, microns = (jnp.asarray(x) for x in zip(*outside, strict=True))
    assert_close(_evaluated(_topography(), profile, face), microns * um, rtol=1e-14, atol=0.0)


def test_topography_that_is_alike_across_the_face_is_a_profile():
    profile = _profile()
    grid = jnp.broadcast_to(profile.deviation[:, None], (4, 3))
    topography = MeasuredTopography(profile.place, [-1.0, 0.3, 1.0], grid)
    place, face = jnp.linspace(-0.2, 1.2, 29), jnp.linspace(1.1, -1.1, 29)
    expected = _evaluated(profile, place, face)
    assert_close(_evaluated(topography, place, face), expected, rtol=1e-12, atol=1e-18)


def test_table_of_a_smooth_law_converges_at_second_order():
    sizes = np.asarray([8, 16, 32, 64])
    profile, face = jnp.linspace(0.0, 1.0, 501), jnp.zeros(501)
    wave = np.sin(2.0 * np.pi * np.asarray(profile) + 0.4)
    errors = []
    for size in sizes:
        place = np.linspace(0.0, 1.0, int(size) + 1)
        table = MeasuredProfile(place, np.sin(2.0 * np.pi * place + 0.4))
        errors.append(np.abs(np.asarray(_evaluated(table, profile, face)) - wave).max())
    assert observed_order(1.0 / sizes, errors, bend=0.2) == pytest.approx(2.0, abs=0.1)


def test_tables_keep_any_shape_and_map():
    grid = jnp.linspace(0.0, 1.0, 24).reshape(2, 3, 4)
    for law in (_profile(), _topography()):
        whole = _evaluated(law, grid, 1.5 * grid - 0.9)
        mapped = jax.jit(jax.vmap(jax.vmap(law)))(grid, 1.5 * grid - 0.9)
        assert whole.shape == grid.shape
        assert_close(mapped, whole, rtol=1e-14, atol=0.0)


# --- gradients


@pytest.mark.parametrize("make", [_profile, _topography])
def test_gradients(make):
    """By places, faces, deviations and by where it is asked, away from the table's corners."""
    profile = jnp.asarray([-0.1, 0.13, 0.3, 0.6, 0.95, 1.2])
    face = jnp.asarray([-0.7, 0.2, 1.3, -0.2, 0.3, -1.4])
    factors = jnp.asarray([1.0, 0.7, 1.9, -0.8, 1.3, 0.4])

    def mixed(argument):
        law, x, z = argument
        return jnp.sum(factors * law(x, z)) / um

    assert_gradient(mixed, (make(), profile, face), rtol=1e-6)


def test_derivative_by_a_point_of_the_table():
    """A point acts as a hat: 0.4 of the way from the second to the third, nothing elsewhere."""
    slope = eqx.filter_jit(eqx.filter_grad(lambda law: law(jnp.asarray(0.45), jnp.zeros(()))))(
        _profile()
    )
    assert_close(slope.deviation, np.asarray([0.0, 0.6, 0.4, 0.0]), rtol=1e-13, atol=1e-15)
    # Moving a point of a slope s along the profile lowers what lies between by s times its share.
    expected = -(-2 * um / 0.5) * np.asarray([0.0, 0.6, 0.4, 0.0])
    assert_close(slope.place, expected, rtol=1e-12, atol=1e-20)


def test_derivatives_on_the_points_are_finite():
    law = _topography()

    def total(argument):
        return jnp.sum(argument[0](*argument[1:]))

    profile, face = (x.ravel() for x in jnp.meshgrid(law.place, law.face))
    slopes = eqx.filter_jit(eqx.filter_grad(total))((law, profile, face))
    assert all(bool(jnp.isfinite(x).all()) for x in jax.tree.leaves(slopes))


# --- places, rolls and diameters


@eqx.filter_jit
def _there_and_back(pair, gear, place):
    """Places and the ends of the flank, through each of the three coordinates."""
    back = (
        profile_place_of_roll(pair, gear, roll_of_profile_place(pair, gear, place)),
        profile_place_of_diameter(pair, gear, diameter_of_profile_place(pair, gear, place)),
        profile_place_of_roll_angle(pair, gear, roll_angle_of_profile_place(pair, gear, place)),
    )
    form_and_tip = 2.0 * jnp.stack([pair.form_radius[gear], pair.tip_radius[gear]])
    start = pair.tangent_length - pair.tip_roll[1 - gear]
    return (
        back,
        profile_place_of_diameter(pair, gear, form_and_tip),
        profile_place_of_roll(pair, gear, start),
    )


@over(accessory, helical_25_31)
@both_gears
def test_there_and_back(make, gear):
    """The tip is at 1; where the other gear's tip touches is at 0, above the form circle."""
    place = jnp.linspace(0.0, 1.1, 7)
    back, (form, tip), start = _there_and_back(make(), gear, place)
    assert_close(back, (place,) * 3, rtol=1e-11, atol=1e-12)
    assert float(tip) == pytest.approx(1.0, abs=1e-12)
    assert float(start) == pytest.approx(0.0, abs=1e-12)
    assert -1.0 < float(form) < 0.0


def test_accessory_by_hand():
    """From the data sheet: base and tip radii 30.587888, 35.67855; 58.456852, 66.63855 mm."""
    pair = accessory()
    path = 1.421555 * 4.270875
    pinion_tip, wheel_tip = (
        np.sqrt(35.67855**2 - 30.587888**2),
        np.sqrt(66.63855**2 - 58.456852**2),
    )
    rolls = np.asarray([pinion_tip - path, pinion_tip - 0.25 * path])
    place = profile_place_of_roll(pair, 0, jnp.asarray(rolls * mm))
    assert_close(place, np.asarray([0.0, 0.75]), rtol=1e-5, atol=1e-5)
    # The wheel's flank runs the other way: from its start of active profile out to its own tip.
    rolls = np.asarray([wheel_tip - path, wheel_tip - 0.25 * path])
    place = profile_place_of_roll(pair, 1, jnp.asarray(rolls * mm))
    assert_close(place, np.asarray([0.0, 0.75]), rtol=1e-5, atol=1e-5)
    angle = profile_place_of_roll_angle(pair, 0, jnp.asarray(pinion_tip / 30.587888))
    assert float(angle) == pytest.approx(1.0, abs=1e-5)


def test_places_are_those_of_the_cells():
    """Each cell touches both gears at one point of the plane of action."""
    grid = jg.mesh_grid(helical_25_31(), phases=8, slices=4)

    @eqx.filter_jit
    def both_ways(pair):
        lines = jg.contact_lines(pair, grid)
        pinion, wheel = flank_coordinates(pair, lines)
        z = jnp.broadcast_to(lines.face_position[None, None, :], pinion[1].shape)
        own = profile_place_of_roll(pair, 0, lines.roll)
        other = profile_place_of_roll(pair, 1, pair.tangent_length - lines.roll)
        faces = (face_place_of_position(pair, gear, z) for gear in (0, 1))
        return tuple(zip((own, other), faces, strict=True)), (pinion, wheel)

    found, expected = both_ways(helical_25_31())
    assert_close(found, expected, rtol=1e-12, atol=1e-12)


def test_places_move_with_the_gears():
    """A longer wheel tooth starts lower on the pinion: what was measured moves up the path."""

    def place(pair):
        return jnp.sum(profile_place_of_diameter(pair, 0, jnp.asarray([93.0, 94.5]) * mm))

    assert_gradient(place, helical_25_31(), rtol=1e-6, scale=sizes(helical_25_31()))
    raised = eqx.tree_at(lambda p: p.wheel.addendum, power(), replace_fn=lambda x: x + 0.01)
    assert float(place(raised)) > float(place(power()))


def test_below_the_base_circle_there_is_no_place():
    assert np.isnan(profile_place_of_diameter(accessory(), 0, jnp.asarray(61.0 * mm)))


# --- refusals


@pytest.mark.parametrize("place", [[0.0, 0.5, 0.5], [0.0, 0.6, 0.5], [0.0, np.nan, 1.0]])
def test_places_that_do_not_increase_are_refused(place):
    with pytest.raises(ValueError, match=r"`MeasuredProfile\.place` must increase"):
        MeasuredProfile(place, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"`MeasuredTopography\.face` must increase"):
        MeasuredTopography([0.0, 1.0], place, np.zeros((2, 3)))


def test_tables_without_points_are_refused():
    with pytest.raises(ValueError, match=r"`MeasuredProfile\.place` must list at least two"):
        MeasuredProfile([0.0], [0.0])
    with pytest.raises(ValueError, match=r"`MeasuredTopography\.face` must list at least two"):
        MeasuredTopography([0.0, 1.0], [0.0], np.zeros((2, 1)))


def test_deviations_that_do_not_fit_the_places_are_refused():
    with pytest.raises(ValueError, match=r"`MeasuredProfile\.deviation` must have one value for"):
        MeasuredProfile([0.0, 1.0], [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"shape \(2, 3\), got \(3, 2\)"):
        MeasuredTopography([0.0, 1.0], [-1.0, 0.0, 1.0], np.zeros((3, 2)))
    with pytest.raises(ValueError, match="not finite"):
        MeasuredProfile([0.0, 1.0], [0.0, np.nan])


def test_a_third_gear_is_refused():
    with pytest.raises(ValueError, match="A gear is 0, the pinion, or 1, the wheel, got 2"):
        profile_place_of_roll(accessory(), 2, jnp.zeros(()))


def test_every_number_is_a_leaf():
    assert len(jax.tree.leaves(_profile())) == 2
    assert len(jax.tree.leaves(_topography())) == 3
