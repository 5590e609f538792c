import functools
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import (
    accessory,
    every_helical_pair,
    every_pair,
    exchanged,
    fzg_c14,
    fzg_h501,
    helical_25_31,
    high_contact_ratio,
    iso_tr_6336_30,
    lengths_scaled,
    mirrored,
    over,
    power,
    ross_62_62,
    sizes,
    standard_17_43,
    standard_30_30,
    standard_50_50,
)
from helpers import assert_close, assert_gradient, observed_order, quick

import jaxgear as jg
from jaxgear import deg, mm

_Maker = Callable[[], jg.GearPair]

_LENGTHS = (
    "transverse_module",
    "reference_radius",
    "base_radius",
    "tip_radius",
    "root_radius",
    "form_radius",
    "zero_backlash_centre_distance",
    "working_centre_distance",
    "working_pitch_radius",
    "transverse_base_pitch",
    "face_width",
    "tangent_length",
    "tip_roll",
    "form_roll",
    "path_start",
    "path_end",
    "pitch_point",
    "path_of_contact",
    "root_clearance",
    "tip_thickness",
)
_ANGLES = (
    "transverse_pressure_angle",
    "zero_backlash_pressure_angle",
    "working_pressure_angle",
    "half_thickness_at_base",
)
_RATIOS = ("profile_contact_ratio", "overlap_ratio", "total_contact_ratio", "full_tip_shortening")
_OTHERS = ("teeth", "base_helix_angle", "reference_radius", "backlash")


@eqx.filter_jit
def _all_numbers(pair: jg.GearPair) -> dict[str, jax.Array]:
    of_pair = {name: getattr(pair, name) for name in (*_LENGTHS, *_ANGLES, *_OTHERS)}
    return of_pair | {name: getattr(jg, name)(pair) for name in _RATIOS}


def _numbers(pair: jg.GearPair) -> SimpleNamespace:
    """All that is closed-form of a pair by its name, in NumPy: one program, not one for each."""
    return SimpleNamespace(**jax.tree.map(np.asarray, _all_numbers(pair)))


# --- printed values of the data sheets in `cases`, to the last digit printed

_DIMENSIONS: list[tuple[_Maker, str, object, float, float]] = [
    (accessory, "working_centre_distance", 99.45028, 5e-6, mm),
    (accessory, "working_pressure_angle", 26.444079, 5e-7, deg),
    (accessory, "base_radius", [30.587888, 58.456852], 5e-7, mm),
    (accessory, "tip_radius", [35.67855, 66.63855], 1e-9, mm),
    (accessory, "root_radius", [32.47155, 63.43155], 1e-9, mm),
    (accessory, "transverse_base_pitch", 4.270875, 5e-7, mm),
    (power, "transverse_pressure_angle", 25.488316, 5e-7, deg),
    (power, "working_pressure_angle", 26.764551, 5e-7, deg),
    (power, "base_helix_angle", 10.861291, 5e-7, deg),
    (power, "working_centre_distance", 133.072315, 5e-7, mm),
    (power, "base_radius", [40.37422, 78.441341], 5e-7, mm),
    (power, "tip_radius", [47.854901, 90.116451], 5e-7, mm),
    (power, "root_radius", [42.259901, 84.521451], 5e-7, mm),
    (power, "transverse_base_pitch", 7.247963, 5e-7, mm),
    (fzg_c14, "working_centre_distance", 91.5001, 5e-5, mm),
    (fzg_c14, "working_pressure_angle", 22.4389, 5e-5, deg),
    (fzg_c14, "base_radius", [33.8289, 50.7434], 5e-5, mm),
    (fzg_c14, "root_radius", [31.193, 49.147], 5e-4, mm),
    (fzg_h501, "working_centre_distance", 91.5003, 5e-5, mm),
    (fzg_h501, "working_pressure_angle", 22.1153, 5e-5, deg),
    (fzg_h501, "base_radius", [33.9074, 50.8610], 5e-5, mm),
    (ross_62_62, "base_radius", [58.26094249, 58.26094249], 5e-9, mm),
    (standard_50_50, "base_radius", [70.476947, 70.476947], 5e-7, mm),
    (standard_50_50, "working_centre_distance", 150.0, 1e-9, mm),
]


@pytest.mark.parametrize(("make", "name", "printed", "last_digit", "unit"), _DIMENSIONS)
def test_printed_dimensions(make, name, printed, last_digit, unit):
    got = getattr(_numbers(make()), name) / unit
    assert_close(got, np.asarray(printed), rtol=0.0, atol=last_digit)


@pytest.mark.parametrize(
    ("make", "profile", "overlap", "shortening", "last_digit"),
    [
        (accessory, 1.421555, 0.0, 0.0218136, 5e-7),
        (power, 1.397121, 1.058886, 0.0136145, 5e-7),
        (fzg_c14, 1.46243, 0.0, 0.01985, 5e-6),
        (fzg_h501, 1.47151, 0.54138, 0.00897, 5e-6),
        (iso_tr_6336_30, 1.54934, 1.08337, 0.00093, 5e-6),
        (ross_62_62, 1.78977987, 0.0, 0.0, 5e-9),
        (standard_50_50, 1.75467, 0.0, 0.0, 5e-6),
    ],
)
def test_printed_ratios(make, profile, overlap, shortening, last_digit):
    pair = _numbers(make())
    got = [pair.profile_contact_ratio, pair.overlap_ratio, pair.full_tip_shortening]
    assert_close(
        np.stack(got), np.asarray([profile, overlap, shortening]), rtol=0.0, atol=last_digit
    )
    assert_close(pair.total_contact_ratio, profile + overlap, rtol=0.0, atol=2.0 * last_digit)


@pytest.mark.parametrize(
    ("make", "profile", "last_digit", "tip_radius"),
    [
        (accessory, 1.390682, 5e-7, None),
        (power, 1.3788, 5e-5, None),
        (fzg_c14, 1.4377, 5e-5, (82.457 / 2, 118.365 / 2)),
        (fzg_h501, 1.46, 5e-3, (40.336, 58.132)),
    ],
)
def test_full_tip_shortening(make, profile, last_digit, tip_radius):
    """Shortened tips: printed contact ratio and tip circle, and the rack's own root clearance."""
    pair = make()
    k = jg.full_tip_shortening(pair)
    pair = eqx.tree_at(lambda p: [p.pinion.tip_shortening, p.wheel.tip_shortening], pair, [k, k])
    got = _numbers(pair)
    assert_close(got.profile_contact_ratio, profile, rtol=0.0, atol=last_digit)
    if tip_radius is not None:
        assert_close(got.tip_radius / mm, np.asarray(tip_radius), rtol=0.0, atol=5e-4)
    spare = pair.of_bodies("dedendum") - pair.of_bodies("addendum")[::-1]
    assert_close(got.root_clearance, pair.normal_module * spare, rtol=1e-12, atol=0.0)


def test_path_of_the_fzg_c14_pair():
    """Distances from A on the path of contact that GEARpie reports [mm]."""
    pair = _numbers(fzg_c14())
    a, pitch = pair.path_start, pair.transverse_base_pitch
    places = np.stack([pair.path_end - pitch, pair.pitch_point, a + pitch, pair.path_end]) - a
    assert_close(places / mm, np.asarray([6.14, 9.68, 13.28, 19.43]), rtol=0.0, atol=6e-3)


# --- by hand


@every_pair
def test_path_of_contact_from_a_drawing(make):
    """Tip circles cut the common tangent of the base circles; no formula, plane vectors."""
    pair = _numbers(make())
    base, tip = pair.base_radius, pair.tip_radius
    centre = float(pair.working_centre_distance)
    # The inner tangent touches both base circles, so its angle has this cosine.
    cosine = base.sum() / centre
    along = np.asarray([math.sqrt(1.0 - cosine**2), cosine])
    first = base[0] * np.asarray([along[1], -along[0]])
    second = np.asarray([centre, 0.0]) - base[1] * np.asarray([along[1], -along[0]])

    def crossing(middle: np.ndarray, radius: float, side: float) -> float:
        foot = (middle - first) @ along
        distance = np.linalg.norm(first + foot * along - middle)
        return float(foot + side * math.sqrt(radius**2 - distance**2))

    # The pinion's tip leaves beyond its own foot, the wheel's tip enters before its own.
    end = crossing(np.zeros(2), tip[0], 1.0)
    start = crossing(np.asarray([centre, 0.0]), tip[1], -1.0)
    # The line of centres is cut at the pitch point.
    pitch_point = -first[1] / along[1]
    got = [pair.path_start, pair.path_end, pair.pitch_point, pair.tangent_length]
    length = float(np.linalg.norm(second - first))
    expected = np.asarray([start, end, pitch_point, length])
    assert_close(np.stack(got), expected, rtol=1e-11, atol=1e-14)
    assert 0.0 <= start < pitch_point < end <= length


@pytest.mark.parametrize(
    ("make", "ratio"),
    [
        # (sqrt(r_a1^2 - r_b1^2) + sqrt(r_a2^2 - r_b2^2) - a sin(alpha)) / p_b on a calculator.
        (standard_17_43, (5.143116 + 9.903180 - 10.260604) / 2.952131),
        (standard_30_30, (2.0 * 22.712992 - 30.781813) / 8.856394),
        (high_contact_ratio, (30.389514 + 41.145139 - 51.303021) / 8.856394),
    ],
)
def test_contact_ratio_by_hand(make, ratio):
    assert_close(_numbers(make()).profile_contact_ratio, ratio, rtol=1e-6, atol=0.0)


@pytest.mark.slow
def test_contact_ratio_tends_to_that_of_two_racks():
    """4 h_a / (pi sin 2 alpha), met like 1 over the number of teeth."""
    teeth = np.asarray([2000, 4000, 8000])
    limit = 4.0 / (math.pi * math.sin(40.0 * deg))
    errors = []
    for z in teeth:
        gear = jg.Gear(int(z), 20.0 * mm)
        ratio = jg.profile_contact_ratio(jg.GearPair(gear, gear, 1.0 * mm))
        errors.append(abs(float(ratio) / limit - 1.0))
    assert errors[-1] < 1e-2
    assert_close(observed_order(1.0 / teeth, errors), 1.0, rtol=0.05, atol=0.0)


def test_overlap_ratio_by_hand():
    """b sin(beta) / (pi m_n), which needs neither the base helix nor the transverse section."""
    expected = 18.0 * math.sin(17.0 * deg) / (math.pi * 2.0)
    assert_close(_numbers(helical_25_31()).overlap_ratio, expected, rtol=1e-12, atol=0.0)


@every_pair
def test_helix_and_sections_agree(make):
    """tan(beta_b) = tan(beta) cos(alpha_t); the normal base pitch is the rack's."""
    pair = make()
    got = _numbers(pair)
    tangent = math.tan(pair.helix_angle) * np.cos(got.transverse_pressure_angle)
    assert_close(np.tan(got.base_helix_angle) + 1.0, tangent + 1.0, rtol=1e-13, atol=0.0)
    normal_pitch = got.transverse_base_pitch * np.cos(got.base_helix_angle)
    rack_pitch = math.pi * float(pair.normal_module) * math.cos(pair.pressure_angle)
    assert_close(normal_pitch, rack_pitch, rtol=1e-13, atol=0.0)
    around = got.teeth * got.transverse_base_pitch
    assert_close(around, 2.0 * math.pi * got.base_radius, rtol=1e-13, atol=0.0)


@every_pair
def test_undercut_and_form_circle_by_iso_21771(make):
    """Form circle from the rack's straight flank in the transverse section."""
    pair = make()
    straight = [
        float(
            g.dedendum - g.profile_shift - g.fillet_radius * (1.0 - math.sin(pair.pressure_angle))
        )
        for g in (pair.pinion, pair.wheel)
    ]
    got = _numbers(pair)
    alpha = float(got.transverse_pressure_angle)
    # The rack's flank ends at this depth; the line of action meets it so far from pitch point.
    roll = got.reference_radius * math.sin(alpha)
    roll -= np.asarray(straight) * float(pair.normal_module) / math.sin(alpha)
    assert_close(got.form_radius, np.hypot(got.base_radius, roll), rtol=1e-13, atol=0.0)
    shift = np.asarray(pair.of_bodies("profile_shift"))
    limit = np.asarray(straight) + shift
    limit -= got.teeth * math.sin(alpha) ** 2 / (2.0 * math.cos(pair.helix_angle))
    undercut = shift < limit
    assert list(got.form_roll < 0.0) == list(undercut)
    assert undercut.any() == (make is standard_17_43)


def test_tip_thickness_by_hand():
    """30 teeth of module 3: s_a = 2 r_a (s/2r + inv 20 deg - inv 28.2415 deg)."""
    at_tip = math.acos(42.28616794 / 48.0)
    expected = 96.0 * (math.pi / 60.0 + 0.014904383867 - (math.tan(at_tip) - at_tip))
    got = _numbers(standard_30_30()).tip_thickness / mm
    assert_close(got, np.asarray([expected, expected]), rtol=1e-8, atol=0.0)
    assert 0.6 < expected / 3.0 < 0.8


@every_pair
def test_working_circles_share_the_pitch(make):
    """Tooth, tooth and backlash fill the pitch on the working circles."""
    pair = _numbers(make())
    working, angle = pair.working_pitch_radius, pair.working_pressure_angle
    filled = 2.0 * working * (pair.half_thickness_at_base - (np.tan(angle) - angle))
    pitch = 2.0 * math.pi * working / pair.teeth
    assert_close(pitch[0], pitch[1], rtol=1e-13, atol=0.0)
    assert_close(np.sum(filled) + pair.backlash, pitch[0], rtol=1e-12, atol=0.0)
    assert_close(np.sum(working), pair.working_centre_distance, rtol=1e-13, atol=0.0)


# --- the centre distance


@over(helical_25_31, slow=(accessory, power))
def test_no_backlash_at_the_distance_that_the_shifts_ask_for(make):
    pair = make()
    free = eqx.tree_at(lambda p: p.centre_distance, pair, None, is_leaf=lambda x: x is None)
    assert abs(float(free.backlash)) < 1e-12 * float(free.normal_module)
    distance = free.zero_backlash_centre_distance
    given = jg.GearPair(
        free.pinion,
        free.wheel,
        free.normal_module,
        free.pressure_angle,
        free.helix_angle,
        distance,
    )
    got, expected = _numbers(given), _numbers(free)
    for name in (*_LENGTHS, *_ANGLES):
        assert_close(getattr(got, name), getattr(expected, name), rtol=1e-11, atol=1e-15)


def test_centre_distance_given_or_not_differentiates_differently():
    """A given one does not follow the profile shifts; the pressure angle then does not either."""

    @eqx.filter_jit
    @eqx.filter_grad
    def slopes(pair: jg.GearPair) -> jax.Array:
        return pair.working_pressure_angle

    free = power()
    given = eqx.tree_at(
        lambda p: p.centre_distance, free, free.working_centre_distance, is_leaf=lambda x: x is None
    )
    assert float(slopes(given).pinion.profile_shift) == 0.0
    # d inv(alpha_wt)/dx = 2 tan(alpha_n)/(z1 + z2), and d inv = tan^2 d alpha.
    slope = 2.0 * math.tan(25.0 * deg) / 103.0 / math.tan(26.764551 * deg) ** 2
    assert_close(slopes(free).pinion.profile_shift, slope, rtol=1e-6, atol=0.0)


@over(helical_25_31, iso_tr_6336_30)
def test_backlash_grows_with_the_centre_distance(make):
    """Moving one axis away by da opens either flank by sin(alpha_wt) da along the path."""

    @eqx.filter_jit
    @eqx.filter_value_and_grad
    def along_path(p: jg.GearPair) -> jax.Array:
        return p.backlash * jnp.cos(p.working_pressure_angle)

    got = _numbers(make())
    along, slope = along_path(make())
    sine = np.sin(got.working_pressure_angle)
    assert_close(slope.centre_distance, 2.0 * sine, rtol=1e-10, atol=0.0)
    # And in the large: 2 (r_b1 + r_b2) (inv alpha_wt - inv of the angle without backlash).
    at, free = got.working_pressure_angle, got.zero_backlash_pressure_angle
    opened = np.tan(at) - at - (np.tan(free) - free)
    assert_close(along, 2.0 * np.sum(got.base_radius) * opened, rtol=1e-9, atol=0.0)


# --- scaling, symmetry


@every_pair
def test_lengths_scale_and_ratios_do_not(make):
    pair = make()
    scaled, pair = _numbers(lengths_scaled(pair, by=37.0)), _numbers(pair)
    for name in _LENGTHS:
        assert_close(getattr(scaled, name), 37.0 * getattr(pair, name), rtol=1e-11, atol=1e-14)
    for name in _ANGLES:
        assert_close(getattr(scaled, name), getattr(pair, name), rtol=1e-12, atol=0.0)
    for name in _RATIOS:
        assert_close(1.0 + getattr(scaled, name), 1.0 + getattr(pair, name), rtol=1e-12, atol=0.0)


@over(helical_25_31, slow=(accessory, power, fzg_c14))
def test_gears_may_change_places(make):
    pair, other = _numbers(make()), _numbers(exchanged(make()))
    reversed_path = {
        "path_start": pair.tangent_length - pair.path_end,
        "path_end": pair.tangent_length - pair.path_start,
        "pitch_point": pair.tangent_length - pair.pitch_point,
    }
    for name in (*_LENGTHS, *_ANGLES):
        value = getattr(pair, name)
        expected = reversed_path.get(name, value[::-1] if value.ndim else value)
        assert_close(getattr(other, name), expected, rtol=1e-12, atol=1e-15)
    for name in _RATIOS:
        assert_close(1.0 + getattr(other, name), 1.0 + getattr(pair, name), rtol=1e-13, atol=0.0)


@every_helical_pair
def test_hand_of_the_helix(make):
    """Only the base helix angle knows the hand."""
    pair, other = _numbers(make()), _numbers(mirrored(make()))
    assert_close(other.base_helix_angle, -pair.base_helix_angle, rtol=1e-14, atol=0.0)
    assert float(pair.base_helix_angle) > 0.0
    for name in (*_LENGTHS, *_ANGLES, *_RATIOS):
        assert_close(getattr(other, name), getattr(pair, name), rtol=1e-14, atol=0.0)


def test_common_face_is_the_narrower():
    assert_close(_numbers(accessory()).face_width / mm, 9.5, rtol=1e-14, atol=0.0)
    assert_close(_numbers(helical_25_31()).face_width / mm, 18.0, rtol=1e-14, atol=0.0)


# --- gradients


@pytest.mark.slow
@pytest.mark.parametrize("names", [_LENGTHS, _ANGLES])
def test_gradients_of_dimensions(names):
    """A different multiple of each, so that no two errors cancel."""
    pair = helical_25_31()

    def mixed(p: jg.GearPair) -> jax.Array:
        return jnp.sum(
            jnp.stack([(1.0 + i) * jnp.sum(getattr(p, name)) for i, name in enumerate(names)])
        )

    assert_gradient(mixed, pair, rtol=1e-6, scale=sizes(pair))


@pytest.mark.parametrize(
    ("make", "ratio"),
    quick(
        2,
        [
            (helical_25_31, jg.total_contact_ratio),
            (helical_25_31, jg.full_tip_shortening),
            (power, jg.profile_contact_ratio),
            (accessory, jg.profile_contact_ratio),
        ],
    ),
)
def test_gradients_of_ratios(make, ratio):
    pair = make()
    assert_gradient(ratio, pair, rtol=1e-6, scale=sizes(pair))


@functools.cache
def _slopes(ratio: Callable[[jg.GearPair], jax.Array]) -> Callable[[jg.GearPair], jg.GearPair]:
    return eqx.filter_jit(eqx.filter_grad(ratio))


def test_gradient_of_a_spur_pair_by_its_helix_angle():
    """The overlap grows with |beta|, by b/(pi m_n) on the side of a right-hand pinion."""
    slope = _slopes(jg.overlap_ratio)(accessory()).helix_angle
    assert_close(slope, 9.5 / (1.5 * math.pi), rtol=1e-12, atol=0.0)


def test_every_parameter_of_a_pair_is_differentiable():
    """Which parameters move which ratio, leaf by leaf; the others get an honest zero."""
    pair = helical_25_31()
    leaves = jax.tree.leaves(eqx.filter(pair, eqx.is_inexact_array))
    # Ten of each gear and its material, and four of the pair.
    assert len(leaves) == 24
    expected = {
        jg.profile_contact_ratio: {
            ".normal_module", ".pressure_angle", ".helix_angle", ".centre_distance",
            ".pinion.addendum", ".pinion.profile_shift", ".pinion.tip_shortening",
            ".wheel.addendum", ".wheel.profile_shift", ".wheel.tip_shortening",
        },
        jg.overlap_ratio: {".normal_module", ".helix_angle", ".wheel.face_width"},
        jg.full_tip_shortening: {
            ".normal_module", ".helix_angle", ".centre_distance",
            ".pinion.profile_shift", ".wheel.profile_shift",
        },
    }  # fmt: skip
    for ratio, names in expected.items():
        gradient = jax.tree_util.tree_leaves_with_path(_slopes(ratio)(pair))
        assert len(gradient) == 24
        moving = {jax.tree_util.keystr(path) for path, slope in gradient if abs(slope) > 1e-9}
        assert moving == names


def test_overlap_does_not_depend_on_the_pressure_angle():
    """b sin(beta)/(pi m_n) has none, though the formula used goes by the base cylinder."""
    slope = _slopes(jg.overlap_ratio)(helical_25_31()).pressure_angle
    assert abs(float(slope)) < 1e-12


# --- refusals


def _pair(pinion: dict[str, float] | None = None, wheel=None, **rest) -> jg.GearPair:
    """25 and 40 standard teeth of module 2, with changes."""
    first: dict[str, Any] = {"teeth": 25, "face_width": 20.0 * mm} | (pinion or {})
    second: dict[str, Any] = {"teeth": 40, "face_width": 20.0 * mm} | (wheel or {})
    return jg.GearPair(
        jg.Gear(**first),
        jg.Gear(**second),
        **({"normal_module": 2.0 * mm} | rest),
    )


def test_the_pair_that_the_refusals_change_is_fine():
    _pair()


_SHARP = {"dedendum": 1.0, "fillet_radius": 0.0}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"normal_module": 0.0}, r"normal module must be positive, got 0 mm\."),
        ({"normal_module": -2.0 * mm}, r"got -2 mm\."),
        # 32.5 x 2 x cos 20 deg = 61.0800 mm.
        (
            {"centre_distance": 61.0 * mm},
            r"exceed the sum of the base radii, 61\.08 mm, .* got 61 mm\. .* ask for 65 mm\.",
        ),
        # j = 2 sin(20 deg)/cos(20 deg) da = -0.0146 mm.
        (
            {"centre_distance": 64.98 * mm},
            r"teeth jam: at the centre distance of 64\.98 mm the backlash is -0\.0145\d mm\. "
            r"Use 65 mm or more",
        ),
        (
            {"pinion": {"addendum": 0.5}, "wheel": {"addendum": 0.5}},
            r"total contact ratio must be at least 1, got 0\.89\d+ "
            r"\(profile 0\.89\d+ \+ overlap 0\)",
        ),
        ({"centre_distance": 66.5 * mm}, r"contact ratio must be at least 1, got 0\.97"),
        (
            {"pinion": {"teeth": 12, "profile_shift": 1.0}},
            r"The pinion's teeth are pointed: thickness -0\.\d+ mm at the tip diameter 32 mm\.",
        ),
        (
            {"pinion": {"teeth": 40}, "wheel": {"teeth": 12, "profile_shift": 1.0}},
            r"The wheel's teeth are pointed: thickness -0\.\d+ mm at the tip diameter 32 mm\.",
        ),
        # 1.25 - 0.38 (1 - sin 20) - 12 sin^2(20)/2 = 0.2981.
        (
            {"pinion": {"teeth": 12}},
            r"The pinion is undercut: with 12 teeth .* at least 0\.2981, got 0\.",
        ),
        (
            {"pinion": {"teeth": 40}, "wheel": {"teeth": 12}},
            r"The wheel is undercut: with 12 teeth .* at least 0\.2981, got 0\.",
        ),
        (
            {"pinion": {"teeth": 20}, "wheel": {"teeth": 100, "addendum": 1.2}},
            r"Interference: the wheel's tip reaches the pinion at diameter 37\.\d+ mm, below its "
            r"form diameter 37\.\d+ mm",
        ),
        (
            {"pinion": {"teeth": 100, "addendum": 1.2}, "wheel": {"teeth": 20}},
            r"Interference: the pinion's tip reaches the wheel at diameter 37\.\d+ mm",
        ),
        (
            {"pinion": _SHARP, "wheel": {"addendum": 1.02}},
            r"The wheel's tip touches the pinion's root: clearance -0\.04 mm\.",
        ),
        (
            {"pinion": {"addendum": 1.02}, "wheel": _SHARP},
            r"The pinion's tip touches the wheel's root: clearance -0\.04 mm\.",
        ),
        # (pi/4 - 1.5 tan 20)/(1/cos 20 - tan 20) = 0.342.
        (
            {"pinion": {"dedendum": 1.5, "fillet_radius": 0.5}},
            r"The pinion's rack has a pointed tip: a fillet radius coefficient of 0\.5 .* "
            r"Use at most 0\.342",
        ),
        (
            {"wheel": {"dedendum": 1.5, "fillet_radius": 0.5}},
            r"The wheel's rack has a pointed tip",
        ),
        ({"pinion": {"profile_shift": math.nan}}, r"profile shifts sum to nan, too negative"),
        (
            {"pinion": {"profile_shift": -4.0}},
            r"shifts sum to -[0-9.]+, too negative for \d+ teeth",
        ),
        ({"pressure_angle": 20.0}, r"between 0 and 45 degrees, got 1146 degrees.*jaxgear.deg"),
        ({"helix_angle": 12.0}, r"within 60 degrees, got 687.5 degrees"),
        ({"wheel": {"addendum": math.nan}}, "got nan"),
    ],
)
def test_impossible_pairs_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        _pair(**changes)


def test_shifts_too_negative_for_any_pressure_angle_are_refused():
    """inv(alpha_wt) of 200 + 200 teeth is negative below a sum of -8.2."""
    gear = {"teeth": 200, "profile_shift": -4.5}
    with pytest.raises(ValueError, match=r"."):
        _pair(gear, gear)


def test_a_helical_pair_may_live_on_its_overlap():
    """Profile contact ratio below 1 is refused only where nothing overlaps."""
    short = {"addendum": 0.5}
    pair = _pair(short, short, helix_angle=20.0 * deg)
    assert float(jg.profile_contact_ratio(pair)) < 1.0 < float(jg.total_contact_ratio(pair))


def test_seventeen_standard_teeth_are_allowed():
    """They lack 1.25 - 0.38 (1 - sin 20) - 17 sin^2(20)/2 = 0.0056 of profile shift."""
    pair = standard_17_43()
    lacking = -pair.form_roll[0] * math.sin(20.0 * deg) / pair.normal_module
    sine = math.sin(20.0 * deg)
    expected = 1.25 - 0.38 * (1.0 - sine) - 8.5 * sine**2
    assert_close(lacking, expected, rtol=1e-10, atol=0.0)
    assert 0.0 < expected < 0.01


@pytest.mark.parametrize(("lacking", "allowed"), [(0.0199, True), (0.0201, False)])
def test_how_much_undercut_is_harmless(lacking, allowed):
    sine = math.sin(20.0 * deg)
    limit = 1.25 - 0.38 * (1.0 - sine) - 6.0 * sine**2
    pinion = {"teeth": 12, "profile_shift": limit - lacking}
    wheel = {"addendum": 0.9}
    if allowed:
        _pair(pinion, wheel)
    else:
        with pytest.raises(ValueError, match="undercut"):
            _pair(pinion, wheel)


@pytest.mark.parametrize(("radius", "allowed"), [(0.4719, True), (0.4722, False)])
def test_the_fullest_tip_radius(radius, allowed):
    """(pi/4 - 1.25 tan 20)/(1/cos 20 - tan 20) = 0.47203, where the rack's tip is all round."""
    pinion = {"fillet_radius": radius}
    wheel = {"addendum": 0.9}
    if allowed:
        _pair(pinion, wheel)
    else:
        with pytest.raises(ValueError, match="pointed tip"):
            _pair(pinion, wheel)


@pytest.mark.parametrize(("jam", "allowed"), [(0.0049, True), (0.0051, False)])
def test_how_much_jam_is_rounding(jam, allowed):
    """Profile shifts on drawings are rounded, so a few thousandths of the module are let pass."""
    distance = 65.0 * mm - jam * 2.0 * mm / (2.0 * math.tan(20.0 * deg))
    if allowed:
        _pair(centre_distance=distance)
    else:
        with pytest.raises(ValueError, match="jam"):
            _pair(centre_distance=distance)


def test_checks_are_silent_while_tracing():
    """A search may pass through impossible gears; it gets a number, not an error."""

    @eqx.filter_jit
    @eqx.debug.assert_max_traces(max_traces=1)
    def ratio(shift):
        return jg.profile_contact_ratio(_pair({"teeth": 12, "profile_shift": shift}))

    assert np.isfinite([float(ratio(jnp.asarray(x))) for x in (0.0, 0.3, 0.5)]).all()
