import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, quick
from numpy.typing import ArrayLike

import jaxgear as jg
from jaxgear import um
from jaxgear._flank._deviations import (
    Bias,
    EllipticalCrowning,
    ProfileCrowning,
    ProfileSlope,
    ProfileWaviness,
)

_MIDDLE = 0.5


@eqx.filter_jit
def _compiled(law: jg.AbstractFlankDeviation, profile: jax.Array, face: jax.Array) -> jax.Array:
    return law(profile, face)


# No test looks at more places at once.
_MOST = 441


def _of(law: jg.AbstractFlankDeviation, profile: ArrayLike, face: ArrayLike) -> np.ndarray:
    """The deviation at any number of places [m], by one program for a law."""
    places = np.broadcast_arrays(np.asarray(profile, dtype=float), face)
    filled = (jnp.asarray(np.resize(each, _MOST), dtype=float) for each in places)
    assert places[0].size <= _MOST
    return np.asarray(_compiled(law, *filled))[: places[0].size].reshape(places[0].shape)


def _at(law: jg.AbstractFlankDeviation, profile: float, face: float = 0.0) -> float:
    """The deviation at one place [um]."""
    return float(_of(law, profile, face)) / um


def _laws(depth: float) -> list[jg.AbstractFlankDeviation]:
    """One of each kind: those that only remove material, then those that do both."""
    return [
        jg.TipRelief(depth, 0.3),
        jg.TipRelief(depth, 0.3, 2),
        jg.RootRelief(depth, 0.3),
        jg.RootRelief(depth, 0.3, 2),
        jg.Crowning(depth),
        jg.EndRelief(depth, 0.3),
        jg.EndRelief(depth, 0.3, 2, right=False),
        ProfileCrowning(depth),
        EllipticalCrowning(depth),
        jg.HelixSlope(depth),
        ProfileSlope(depth),
        Bias(depth),
        ProfileWaviness(depth, 3.0, 0.4),
    ]


_REMOVING = 9
every_law = pytest.mark.parametrize("kind", range(13))


# --- by hand


@pytest.mark.parametrize(
    ("law", "profile", "face", "microns"),
    [
        # -E (1 - s/L) with s from the tip and L = 0.4: half-way at 0.8.
        (jg.TipRelief(20 * um, 0.4), 1.0, 0.3, -20.0),
        (jg.TipRelief(20 * um, 0.4), 0.8, 0.3, -10.0),
        (jg.TipRelief(20 * um, 0.4), 0.7, 0.3, -5.0),
        (jg.TipRelief(20 * um, 0.4), 0.6, 0.3, 0.0),
        (jg.TipRelief(20 * um, 0.4), 0.1, 0.3, 0.0),
        (jg.TipRelief(20 * um, 0.4, 2), 1.0, 0.3, -20.0),
        (jg.TipRelief(20 * um, 0.4, 2), 0.8, 0.3, -5.0),
        (jg.TipRelief(20 * um, 0.4, 2), 0.7, 0.3, -1.25),
        (jg.TipRelief(20 * um, 1.0), 0.0, 0.3, 0.0),
        (jg.TipRelief(20 * um, 1.0), 0.25, 0.3, -5.0),
        # The middle of a cell may lie past the tip: the slope goes on.
        (jg.TipRelief(20 * um, 0.4), 1.1, 0.3, -25.0),
        (jg.RootRelief(20 * um, 0.4), 0.0, 0.3, -20.0),
        (jg.RootRelief(20 * um, 0.4), 0.1, 0.3, -15.0),
        (jg.RootRelief(20 * um, 0.4), 0.5, 0.3, 0.0),
        (jg.RootRelief(20 * um, 0.4, 2), 0.2, 0.3, -5.0),
        (jg.RootRelief(20 * um, 0.4), -0.1, 0.3, -25.0),
        (jg.Crowning(8 * um), 0.2, 0.0, 0.0),
        (jg.Crowning(8 * um), 0.2, 0.5, -2.0),
        (jg.Crowning(8 * um), 0.2, -1.0, -8.0),
        (jg.Crowning(8 * um), 0.2, 1.0, -8.0),
        # 0.4 of the face from either end: at -1 + 0.8 the left one has faded out.
        (jg.EndRelief(20 * um, 0.4), 0.2, -1.0, -20.0),
        (jg.EndRelief(20 * um, 0.4), 0.2, -0.6, -10.0),
        (jg.EndRelief(20 * um, 0.4), 0.2, -0.2, 0.0),
        (jg.EndRelief(20 * um, 0.4), 0.2, 0.0, 0.0),
        (jg.EndRelief(20 * um, 0.4), 0.2, 0.8, -15.0),
        (jg.EndRelief(20 * um, 0.4, 2), 0.2, 0.6, -5.0),
        (jg.EndRelief(20 * um, 0.4, right=False), 0.2, -1.0, -20.0),
        (jg.EndRelief(20 * um, 0.4, right=False), 0.2, 1.0, 0.0),
        (jg.EndRelief(20 * um, 0.4, left=False), 0.2, -1.0, 0.0),
        (jg.EndRelief(20 * um, 0.4, left=False), 0.2, 1.0, -20.0),
        # Long reliefs of both ends add where they meet.
        (jg.EndRelief(20 * um, 1.0), 0.2, 0.0, -20.0),
        (jg.HelixSlope(6 * um), 0.2, 1.0, 3.0),
        (jg.HelixSlope(6 * um), 0.2, -1.0, -3.0),
        (jg.HelixSlope(-6 * um), 0.2, 0.5, -1.5),
        (ProfileSlope(6 * um), 0.0, 0.3, -3.0),
        (ProfileSlope(6 * um), 0.5, 0.3, 0.0),
        (ProfileSlope(6 * um), 0.75, 0.3, 1.5),
        (ProfileSlope(6 * um), 1.0, 0.3, 3.0),
        (ProfileSlope(6 * um), 1.1, 0.3, 3.6),
        (ProfileCrowning(8 * um), 0.0, 0.3, -8.0),
        (ProfileCrowning(8 * um), 0.25, 0.3, -2.0),
        (ProfileCrowning(8 * um), 0.5, 0.3, 0.0),
        (ProfileCrowning(8 * um), 1.0, 0.3, -8.0),
        # 3-4-5: at 0.6 of the way to the end the ellipse has 0.8 of its height left.
        (EllipticalCrowning(10 * um), 0.2, 0.0, 0.0),
        (EllipticalCrowning(10 * um), 0.2, 0.6, -2.0),
        (EllipticalCrowning(10 * um), 0.2, -0.8, -4.0),
        (EllipticalCrowning(10 * um), 0.2, 1.0, -10.0),
        (EllipticalCrowning(10 * um), 0.2, -1.0, -10.0),
        (EllipticalCrowning(10 * um), 0.2, 1.3, -10.0),
        (jg.Superposed((jg.Crowning(5 * um), EllipticalCrowning(10 * um))), 0.2, 0.6, -3.8),
        # A profile slope of +4 at the right end and -4 at the left: they differ by 8.
        (Bias(8 * um), 1.0, 1.0, 2.0),
        (Bias(8 * um), 0.0, 1.0, -2.0),
        (Bias(8 * um), 1.0, -1.0, -2.0),
        (Bias(8 * um), 0.0, -1.0, 2.0),
        (Bias(8 * um), 0.75, 0.5, 0.5),
        (Bias(8 * um), 0.5, 0.7, 0.0),
        (ProfileWaviness(4 * um, 3.0), 0.0, 0.3, 0.0),
        (ProfileWaviness(4 * um, 3.0), 1 / 12, 0.3, 4.0),
        (ProfileWaviness(4 * um, 3.0), 0.25, 0.3, -4.0),
        (ProfileWaviness(4 * um, 1.0, np.pi / 2), 0.0, 0.3, 4.0),
        (ProfileWaviness(4 * um, 1.0, np.pi / 2), 1 / 6, 0.3, 2.0),
        (jg.Superposed(), 0.9, 0.9, 0.0),
    ],
)
def test_by_hand(law, profile, face, microns):
    assert abs(_at(law, profile, face) - microns) < 1e-12


def test_extents_of_the_face_count_the_whole_face():
    """A quarter of the face is half of the way from an end to the middle."""
    law = jg.EndRelief(20 * um, 0.25, left=False)
    assert _at(law, _MIDDLE, 0.5) == 0.0
    assert _at(law, _MIDDLE, 0.51) < 0.0


@every_law
def test_depth_is_material_removed(kind):
    """A typed depth is positive and opens the gap; a negative one adds material."""
    profile, face = (x.ravel() for x in np.meshgrid(np.linspace(0, 1, 21), np.linspace(-1, 1, 21)))
    removed, added = (_of(_laws(depth)[kind], profile, face) for depth in (10 * um, -10 * um))
    np.testing.assert_array_equal(removed, -added)
    if kind >= _REMOVING:
        assert removed.min() < -2 * um
        assert removed.max() > 2 * um
    else:
        assert removed.max() == 0.0
        assert abs(removed.min() + 10 * um) < 1e-12 * um


@every_law
def test_deviations_scale_with_their_depth(kind):
    profile, face = np.asarray([0.1, 0.55, 0.95]), np.asarray([-0.9, 0.2, 0.8])
    one, other = (_of(_laws(depth)[kind], profile, face) for depth in (3 * um, 37 * 3 * um))
    assert_close(other, 37.0 * one, rtol=1e-13, atol=1e-20)


def test_signs_of_what_is_added():
    """Positive amounts add material at the right end, at the tip, and at the tip's right corner."""
    for law in (jg.HelixSlope(4 * um), ProfileSlope(4 * um), Bias(4 * um)):
        assert _at(law, 0.9, 0.8) > 0.1
        assert _at(law, 0.1, -0.8) * (-1 if not isinstance(law, Bias) else 1) > 0.1
    assert _at(Bias(4 * um), 0.9, -0.8) < -0.1
    assert _at(Bias(4 * um), 0.1, 0.8) < -0.1


@pytest.mark.parametrize(
    "law",
    [
        jg.HelixSlope(7 * um),
        ProfileSlope(7 * um),
        Bias(7 * um),
        ProfileWaviness(7 * um, 3.0, 0.4),
    ],
)
def test_mean_over_the_flank_is_zero(law):
    """The mid-point rule is exact for the straight ones, and for whole waves."""
    middle = (np.arange(20) + 0.5) / 20
    profile, face = (x.ravel() for x in np.meshgrid(middle, 2.0 * middle - 1.0))
    values = _of(law, profile, face) / um
    assert np.abs(values).max() > 1.0
    assert abs(values.mean()) < 1e-14


def test_bias_is_both_twists():
    """One number: change of the profile slope across the face, of the helix slope along it."""
    corner = {(p, z): _at(Bias(8 * um), p, z) for p in (0.0, 1.0) for z in (-1.0, 1.0)}
    profile_slope = {z: corner[1.0, z] - corner[0.0, z] for z in (-1.0, 1.0)}
    helix_slope = {p: corner[p, 1.0] - corner[p, -1.0] for p in (0.0, 1.0)}
    assert profile_slope[1.0] - profile_slope[-1.0] == pytest.approx(8.0, rel=1e-13)
    assert helix_slope[1.0] - helix_slope[0.0] == pytest.approx(8.0, rel=1e-13)


def test_crowning_along_either_direction_has_one_shape():
    z = np.linspace(-1.2, 1.2, 13)
    across = _of(jg.Crowning(10 * um), 0.0, z)
    along = _of(ProfileCrowning(10 * um), 0.5 + 0.5 * z, 0.0)
    assert_close(along, across, rtol=1e-12, atol=1e-18)


def test_elliptical_crowning_lies_on_its_ellipse():
    """(z/1)^2 + (height/depth)^2 = 1; in the middle it is a parabola of half the depth."""
    z = np.linspace(-1.0, 1.0, 41)
    height = 1.0 + _of(EllipticalCrowning(10 * um), 0.0, z) / (10 * um)
    assert_close(z**2 + height**2, np.ones(41), rtol=1e-13, atol=0.0)
    assert _at(EllipticalCrowning(10 * um), 0.5, 1e-3) == pytest.approx(-5e-6, rel=1e-6)


def test_tip_and_root_are_mirror_images():
    profile = np.linspace(0.0, 1.0, 11)
    for exponent in (1, 2):
        tip = _of(jg.TipRelief(10 * um, 0.35, exponent), profile, 0.0)
        root = _of(jg.RootRelief(10 * um, 0.35, exponent), 1.0 - profile, 0.0)
        assert_close(tip, root, rtol=1e-12, atol=1e-18)


def test_left_and_right_are_mirror_images():
    face = np.linspace(-1.0, 1.0, 11)
    left = _of(jg.EndRelief(10 * um, 0.35, right=False), 0.0, face)
    right = _of(jg.EndRelief(10 * um, 0.35, left=False), 0.0, -face)
    assert_close(left, right, rtol=1e-12, atol=1e-18)


def test_parabolic_relief_starts_smoothly():
    """A linear one has a corner where it starts, a parabolic one a slope of zero."""
    slopes = {
        exponent: jax.grad(jg.TipRelief(10 * um, 0.4, exponent), 0)(
            jnp.asarray(0.6 + 1e-6), jnp.zeros(())
        )
        for exponent in (1, 2)
    }
    assert_close(slopes[1], -10 * um / 0.4, rtol=1e-9, atol=0.0)
    assert abs(float(slopes[2])) < 1e-5 * 10 * um / 0.4


def test_superposition():
    parts = tuple(_laws(4 * um))
    profile, face = np.asarray([0.1, 0.55, 0.95]), np.asarray([-0.9, 0.2, 0.8])
    expected = np.sum([_of(part, profile, face) for part in parts], axis=0)
    assert_close(_of(jg.Superposed(parts), profile, face), expected, rtol=1e-13, atol=0.0)
    nested = jg.Superposed((jg.Superposed(parts[:3]), jg.Superposed(parts[3:])))
    assert_close(_of(nested, profile, face), expected, rtol=1e-13, atol=0.0)


def test_flanks_are_nominal_unless_said():
    flanks = jg.Flanks(pinion=jg.Crowning(5 * um))
    assert _at(flanks.pinion, 0.5, 1.0) == pytest.approx(-5.0, abs=1e-12)
    assert _at(flanks.wheel, 1.0, 1.0) == 0.0


# --- refusals


@pytest.mark.parametrize("extent", [0.0, -0.1, 1.0001, 0.35e3, np.nan])
@pytest.mark.parametrize(
    ("kind", "whole"),
    [
        (jg.TipRelief, "the path of contact"),
        (jg.RootRelief, "the path of contact"),
        (jg.EndRelief, "the face width"),
    ],
)
def test_extents_that_are_no_fraction_are_refused(kind, whole, extent):
    message = (
        rf"`{kind.__name__}\.extent` must lie in \(0, 1\], got .*: it is a fraction of {whole}"
    )
    with pytest.raises(ValueError, match=message):
        kind(10 * um, extent)


@pytest.mark.parametrize("kind", [jg.TipRelief, jg.RootRelief, jg.EndRelief])
@pytest.mark.parametrize("exponent", quick(4, [0, 3, -1]))
def test_other_exponents_are_refused(kind, exponent):
    with pytest.raises(
        ValueError, match=rf"`{kind.__name__}\.exponent` must be 1 .* got {exponent}"
    ):
        kind(10 * um, 0.3, exponent)


def test_a_relief_of_neither_end_is_refused():
    with pytest.raises(ValueError, match="must relieve the left end, the right, or both"):
        jg.EndRelief(10 * um, 0.3, left=False, right=False)


# --- gradients


@every_law
def test_gradients(kind):
    """By depth, extent and place together, away from the corners of the laws."""
    profile, face = jnp.asarray([0.12, 0.55, 0.9]), jnp.asarray([-0.8, 0.2, 0.9])
    factors = jnp.asarray([1.0, 0.7, 1.9])

    def mixed(argument):
        law, x, z = argument
        return jnp.sum(factors * law(x, z)) / um

    assert_gradient(mixed, (_laws(10 * um)[kind], profile, face), rtol=1e-6)


@every_law
def test_gradient_at_zero_depth(kind):
    """A search starts from nominal flanks: the first micron must count there, as it does later."""
    profile, face = jnp.asarray([0.12, 0.5, 0.9]), jnp.asarray([-0.8, 0.2, 0.9])

    @eqx.filter_jit
    @eqx.filter_grad
    def slopes(law):
        return jnp.sum(jnp.asarray([1.0, 0.7, 1.9]) * law(profile, face))

    at_zero, later = (slopes(_laws(depth)[kind]) for depth in (0.0, 10 * um))
    name = {9: "amount", 10: "amount", 11: "amount", 12: "amplitude"}.get(kind, "depth")
    assert_close(getattr(at_zero, name), getattr(later, name), rtol=1e-13, atol=0.0)
    assert abs(float(getattr(later, name))) > 0.01
    # While nothing is removed its extent does not matter; it is a zero, not a gap in the tree.
    if hasattr(at_zero, "extent"):
        assert float(at_zero.extent) == 0.0
        assert float(later.extent) != 0.0


@eqx.filter_jit
def _slopes(argument):
    return eqx.filter_grad(lambda x: x[0](jnp.zeros(()), x[1]))(argument)


@pytest.mark.parametrize("face", [-1.5, -1.0, 1.0, 1.0 + 1e-12, 7.0])
def test_elliptical_crowning_has_slopes_at_its_ends(face):
    """As steep as a wall there: the slope by the place is that of the constant outside."""
    law, at = EllipticalCrowning(10 * um), jnp.asarray(face)
    by_law, by_face = _slopes((law, at))
    assert float(by_law.depth) == -1.0
    assert float(by_face) == 0.0


def test_slope_of_elliptical_crowning():
    """-d z / sqrt(1 - z^2), finite as close to the ends as numbers go."""
    law = EllipticalCrowning(10 * um)
    slope = jax.jit(jax.vmap(jax.grad(law, 1)))
    face = jnp.asarray([-0.8, 0.0, 0.6, 1.0 - 1e-15])
    expected = -10 * um * np.asarray([-0.8 / 0.6, 0.0, 0.6 / 0.8])
    found = slope(jnp.zeros(4), face)
    assert_close(found[:3], expected, rtol=1e-13, atol=1e-20)
    assert -1e4 < float(found[3]) < -100.0


@pytest.mark.parametrize("exponent", [1, 2])
def test_derivative_by_the_extent(exponent):
    """d/dL of -E (1 - s/L)^n is -E n (1 - s/L)^(n - 1) s/L^2."""
    law = jg.TipRelief(20 * um, 0.4, exponent)
    slope = eqx.filter_grad(lambda x: x(jnp.asarray(0.9), jnp.zeros(())))(law).extent
    expected = -20 * um * exponent * 0.75 ** (exponent - 1) * 0.1 / 0.16
    assert_close(slope, expected, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    ("law", "count"),
    [
        (jg.TipRelief(0, 1), 2),
        (jg.RootRelief(0, 1), 2),
        (jg.EndRelief(0, 1), 2),
        (jg.Crowning(0), 1),
        (jg.HelixSlope(0), 1),
        (ProfileSlope(0), 1),
        (ProfileCrowning(0), 1),
        (EllipticalCrowning(0), 1),
        (Bias(0), 1),
        (ProfileWaviness(0, 3), 3),
        (jg.Superposed(tuple(_laws(0))), 21),
    ],
)
def test_every_number_is_a_leaf(law, count):
    assert len(jax.tree.leaves(eqx.filter(law, eqx.is_inexact_array))) == count
