import functools
import itertools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import fzg_c14, helical_25_31, over, standard_30_30
from helpers import assert_close, assert_gradient, quick

import jaxgear as jg
from jaxgear._contact._ring import ring_influence, ring_receptances, root_resultants
from jaxgear._contact._sainsot import (
    SAINSOT_RADIUS_RATIO,
    SAINSOT_ROOT_HALF_ANGLE,
    sainsot_coefficients,
    sainsot_compliance,
)
from jaxgear._contact._tooth import tooth_load

_STEEL = jg.Material(206e9, 0.3)
_PITCH = 2.0 * math.pi / 30
_MODEL = ("parallel", "mean")
_LITERATURE = ("radial", "point")


@functools.cache
def _program(neighbours, harmonics, traction, measure):
    def influence(ratio, half, poisson, pitch):
        return ring_influence(
            radius_ratio=ratio,
            root_half_angle=half,
            poisson=poisson,
            pitch_angle=pitch,
            neighbours=neighbours,
            harmonics=harmonics,
            traction=traction,
            measure=measure,
        )

    return jax.jit(influence)


def _influence(
    ratio, half, variant=_MODEL, *, poisson=0.3, pitch=_PITCH, neighbours=1, harmonics=120
):
    values = (jnp.asarray(float(value)) for value in (ratio, half, poisson, pitch))
    return np.asarray(_program(neighbours, harmonics, *variant)(*values))


@functools.cache
def _receptances(harmonics):
    return jax.jit(
        lambda ratio, poisson: ring_receptances(
            radius_ratio=ratio, poisson=poisson, harmonics=harmonics
        )
    )


# --- one harmonic


def _by_collocation(order: int, ratio: float, poisson: float) -> np.ndarray:
    """Receptance from the equations of elasticity alone, by Chebyshev collocation in r; 2 G = 1."""
    points = 64
    node = np.cos(np.pi * np.arange(points) / (points - 1))
    side = np.where((np.arange(points) % (points - 1)) == 0, 2.0, 1.0)
    side *= (-1.0) ** np.arange(points)
    apart = node[:, None] - node[None] + np.eye(points)
    slope = np.outer(side, 1.0 / side) / apart
    slope -= np.diag(slope.sum(axis=1))
    inner = 1.0 / ratio
    slope /= 0.5 * (1.0 - inner)
    radius = (inner + 0.5 * (1.0 - inner) * (node + 1.0))[:, None]
    zero, one = np.zeros((points, points)), np.eye(points)
    # Strains, Hooke's law and equilibrium of u_r = U cos(n theta), u_theta = V sin(n theta).
    stretch = np.hstack([slope, zero])
    hoop = np.hstack([one, order * one]) / radius
    shear = 0.5 * np.hstack([-order * one / radius, slope - one / radius])
    bulk = poisson / (1.0 - 2.0 * poisson) * (stretch + hoop)
    radial, around = stretch + bulk, hoop + bulk
    balance = np.vstack(
        [
            slope @ radial + (order * shear + radial - around) / radius,
            slope @ shear + (2.0 * shear - order * around) / radius,
        ]
    )
    right = np.zeros((2 * points, 2))
    for component, traction in enumerate((radial, shear)):
        rim, bore = component * points, (component + 1) * points - 1
        balance[rim], right[rim, component] = traction[0], 1.0
        balance[bore] = np.eye(2 * points)[bore]
    return np.linalg.solve(balance, right)[[0, points]]


@pytest.mark.parametrize(("ratio", "poisson"), [(1.1, 0.3), (1.8, 0.2), (4.0, 0.3), (4.0, 0.45)])
def test_harmonics_by_collocation(ratio, poisson):
    found = _receptances(24)(jnp.asarray(ratio), jnp.asarray(poisson))
    for order in (0, 1, 2, 3, 9, 24):
        expected = _by_collocation(order, ratio, poisson)
        assert_close(found[..., order], expected, rtol=2e-7, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("ratio", [1.02, 1.4, 30.0])
def test_harmonics_are_reciprocal_and_tend_to_the_half_plane(ratio):
    """Betti: symmetric. Short waves: (1 - nu) and (1 - 2 nu)/2 over n, times 2."""
    found = np.asarray(_receptances(3000)(jnp.asarray(ratio), jnp.asarray(0.3)))
    size = np.abs(found).max(axis=(0, 1))
    assert np.isfinite(found).all()
    assert (np.abs(found[0, 1] - found[1, 0]) < 1e-11 * size).all()
    assert (found[0, 0] * found[1, 1] > found[0, 1] ** 2).all()
    expected = np.asarray([[1.4, 0.4], [0.4, 1.4]])
    assert_close(3000.0 * found[..., -1], expected, rtol=2e-3, atol=0.0)


# --- the whole series


def _summed(ratio, half, variant, poisson, shifts):
    """The influence matrices by plain sums of 3000 waves, in components and not in parities."""
    node, weight = np.polynomial.legendre.leggauss(400)
    angle, weight = half * node, half * weight
    sine, cosine = np.sin(angle), np.cos(angle)
    level, zero = np.ones(400), np.zeros(400)
    if variant[0] == "radial":
        # Forces per angle; a moment of unit size about the root point with the arms r_f theta.
        loads = [(level, zero), (zero, level), (-1.5 * angle / half**3, zero)]
        loads = [(r / (2.0 * half), t / (2.0 * half)) for r, t in loads[:2]] + loads[2:]
    else:
        # Forces outward and across, then the moment of each force about the root point.
        turning = -sine / (weight @ sine**2)
        lift = -weight @ (cosine - 1.0) / (2.0 * half)
        own = [
            (level / (2.0 * half), zero),
            (lift * turning, level / (2.0 * half)),
            (turning, zero),
        ]
        loads = [(o * cosine + a * sine, a * cosine - o * sine) for o, a in own]
    n = np.arange(3001.0)
    series = np.asarray(_receptances(3000)(jnp.asarray(ratio), jnp.asarray(poisson)))
    series = series * np.where(n == 0.0, 0.5, 1.0) * (1.0 + poisson) / math.pi
    waves = np.exp(1j * np.outer(n, angle))
    found = np.zeros((len(shifts), 3, 3))
    for j, (radial, across) in enumerate(loads):
        p, q = waves @ (weight * radial), waves @ (weight * across)
        sym = np.einsum("abn,bn->an", series, np.stack([p.real, q.imag]))
        anti = np.einsum("abn,bn->an", series, np.stack([p.imag, -q.real]))
        for k, shift in enumerate(shifts):
            at = shift + (angle if variant[1] == "mean" else np.zeros(1))
            c, s = np.cos(np.outer(at, n)), np.sin(np.outer(at, n))
            u, v = c @ sym[0] + s @ anti[0], s @ sym[1] - c @ anti[1]
            if variant[1] == "mean":
                found[k, :, j] = [weight @ (r * u + t * v) for r, t in loads]
            else:
                found[k, :2, j] = u[0], v[0]
    return found


@pytest.mark.parametrize("variant", quick(2, [_MODEL, _LITERATURE]))
@pytest.mark.parametrize(("ratio", "poisson"), [(1.15, 0.3), (2.5, 0.25)])
def test_influence_by_a_plain_sum(variant, ratio, poisson):
    """The closed form of the disc, the parities and the tractions, all at once."""
    half = 0.098
    found = _influence(ratio, half, variant, poisson=poisson)
    expected = _summed(ratio, half, variant, poisson, [0.0, _PITCH])
    # The rotation of a point converges too slowly to be summed; the published table has it.
    if variant[1] == "point":
        found, expected = found[:, :2], expected[:, :2]
    assert_close(found, expected, rtol=3e-5, atol=3e-5)


def test_truncation_falls_with_the_rim():
    """Order N leaves h^(-2 N) of the largest term, and one module of rim less than 1e-6."""
    scale = np.sqrt(np.diagonal(_influence(1.1, 0.1, harmonics=240)[0]))
    for ratio in (1.05, 1.1, 1.2):
        fine, coarse = (_influence(ratio, 0.1, harmonics=n) for n in (240, 60))
        scale = np.sqrt(np.diagonal(fine[0]))
        error = np.abs((coarse - fine) / np.outer(scale, scale)[None]).max()
        assert 0.3 < error * ratio**120 < 3.0
    rim = 13.75 / 12.75
    fine, usual = (_influence(rim, 0.1, harmonics=n) for n in (240, 120))
    scale = np.sqrt(np.diagonal(fine[0]))
    assert np.abs((usual - fine) / np.outer(scale, scale)[None]).max() < 1e-6


@pytest.mark.parametrize("variant", [_MODEL, _LITERATURE])
def test_any_ring_gives_numbers(variant):
    for ratio, half in itertools.product((1.02, 1.1, 5.0, 30.0), (0.001, 0.1)):
        found = _influence(ratio, half, variant)
        assert np.isfinite(found).all()
        assert (np.diagonal(found[0]) > 0.0).all()


@pytest.mark.parametrize(("ratio", "half"), [(0.9, 0.1), (2.0, 0.11), (2.0, -0.01)])
def test_impossible_rings_are_refused(ratio, half):
    with pytest.raises(ValueError, match="must"):
        ring_influence(
            radius_ratio=jnp.asarray(ratio),
            root_half_angle=jnp.asarray(half),
            poisson=jnp.asarray(0.3),
            pitch_angle=jnp.asarray(_PITCH),
            neighbours=0,
            harmonics=4,
        )


# --- exact limits

_TWELVE = 2.0 * math.pi / 12


def _all_round(ratio, half, variant=_MODEL):
    return _influence(ratio, half, variant, pitch=_TWELVE, neighbours=11, harmonics=48)


@pytest.mark.parametrize("ratio", [1.02, 1.4, 5.0, 30.0])
def test_teeth_that_touch_make_a_pressed_and_a_twisted_ring(ratio):
    """Every tooth loaded: Lame's tube, and u = T/(4 pi G)(1/r_i^2 - 1/r_o^2) r_o."""
    total = _all_round(ratio, 0.5 * _TWELVE, ("radial", "mean")).sum(axis=0)
    # 12 forces on 2 pi: pressure 12/(2 pi). Lame's u = A r + B/r, clamped at r = 1/h.
    inner = 1.0 / ratio**2
    pressed = 1.3 * 12.0 / (2.0 * math.pi) * (1.0 - inner) / (1.0 / (1.0 - 0.6) + inner)
    twisted = 2.0 * 1.3 * 12.0 / (4.0 * math.pi) * (ratio**2 - 1.0)
    # What is left is the quadrature between touching roots, 3e-6 of one tooth's own deflection.
    assert_close(total[0, 0], pressed, rtol=1e-6, atol=1e-5)
    assert_close(total[1, 1], twisted, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("half", [0.02, 0.2])
def test_wind_up_carries_the_torque_of_every_load(half):
    """Of Q and of M/r_f, both r_f, in displacement and in rotation: no torque is lost.

    The sum over all teeth keeps the orders 0, 12, 24 ...; of those the difference between two
    bores keeps order 0 only, 4^-24 being nothing.
    """
    found = (_all_round(6.0, half) - _all_round(4.0, half)).sum(axis=0)
    wind_up = 12.0 * 2.0 * 1.3 / (4.0 * math.pi) * (36.0 - 16.0)
    assert_close(found[1:, 1:], np.full((2, 2), wind_up), rtol=1e-10, atol=0.0)
    assert np.abs(found[0, 1:]).max() + np.abs(found[1:, 0]).max() < 1e-9


@functools.cache
def _smaller_bore(variant):
    """What halving a small bore adds, to the loaded tooth and to the next one."""
    return _influence(120.0, 0.1, variant) - _influence(60.0, 0.1, variant)


_DRIFT = 1.3 * 1.8 / (math.pi * 2.8) * math.log(2.0)
_TWIST = 2.0 * 1.3 / (4.0 * math.pi) * (120.0**2 - 60.0**2)


def test_a_small_bore_holds_the_body_by_a_logarithm():
    """A force moves a disc held at a small bore by kappa/(2 pi (kappa + 1) G) ln h; twist apart."""
    found, turn = _smaller_bore(_MODEL), np.asarray([0.0, _PITCH])
    assert_close(found[:, 0, 0], _DRIFT * np.cos(turn), rtol=2e-3, atol=0.0)
    for row, column in itertools.product((1, 2), (1, 2)):
        # A pure moment does not push, and a drifting body does not turn.
        drift = _DRIFT * np.cos(turn) if (row, column) == (1, 1) else np.zeros(2)
        assert np.abs(found[:, row, column] - _TWIST - drift).max() < 2e-3


def test_radial_tractions_lose_the_torque_of_the_moment():
    """A2.4 (iii): a rotation is felt, a torque is not exerted; for M/r_f pushes by -Q."""
    found = _smaller_bore(_LITERATURE)[0]
    assert_close(found[2, 1], _TWIST, rtol=1e-4, atol=0.0)
    assert_close(found[1, 2], -_DRIFT, rtol=1e-2, atol=0.0)


def test_a_narrow_root_stands_on_a_half_plane():
    """Weber's L and M from the mean, 24/pi from the point, and Flamant's logarithm in N and Q."""
    stretch, ratio, half = 0.91 / math.pi, 2.0, 1e-5
    mean, point = (_influence(ratio, half, variant)[0] for variant in (_MODEL, _LITERATURE))
    assert_close(4.0 * half**2 * mean[2, 2], 18.0 * stretch, rtol=1e-8, atol=0.0)
    assert_close(4.0 * half**2 * point[2, 2], 24.0 * stretch, rtol=1e-8, atol=0.0)
    coupling = 2.0 * half * (mean[1, 2] + mean[2, 1])
    assert_close(coupling, 2.0 * 1.3 * 0.4, rtol=1e-4, atol=0.0)
    for variant, wide in ((_MODEL, mean), (_LITERATURE, point)):
        narrow = _influence(ratio, 0.5 * half, variant)[0]
        growth = np.diagonal(narrow - wide)[:2]
        assert_close(growth, np.full(2, 2.0 * stretch * math.log(2.0)), rtol=half, atol=0.0)


@pytest.mark.parametrize("ratio", [1.1, 2.0, 30.0])
def test_mean_influence_of_all_teeth_is_symmetric_and_stores_energy(ratio):
    found = _all_round(ratio, 0.2)
    assert_close(found[:0:-1], found[1:].swapaxes(1, 2), rtol=1e-10, atol=1e-10)
    index = (np.arange(12)[:, None] - np.arange(12)[None]) % 12
    whole = found[index].transpose(0, 2, 1, 3).reshape(36, 36)
    assert np.abs(whole - whole.T).max() < 1e-10 * whole.max()
    values = np.linalg.eigvalsh(whole)
    assert values.min() > 0.0


# --- the literature


def _coefficients(ratio, half):
    """L*, M*, P*, Q* of the exact ring, as Sainsot defines them."""
    own = _influence(ratio, half, _LITERATURE, pitch=0.25)[0]
    chord = 2.0 * half
    mixed = chord * (own[1, 2] + own[2, 1])
    return np.asarray([chord**2 * own[2, 2], mixed, own[1, 1], own[0, 0] / own[1, 1]])


# Physics A2.4; the last figure of each is rounded.
_TABLE = (
    (1.4, 0.05, (6.905, 0.999, 2.555, 0.622), (6.872, 1.043, 2.181, 0.608)),
    (1.4, 0.10, (6.877, 1.035, 2.175, 0.569), (6.640, 0.872, 1.786, 0.526)),
    (2.0, 0.10, (6.888, 1.140, 2.727, 0.496), (6.860, 1.095, 2.663, 0.489)),
    (4.0, 0.05, (6.936, 1.382, 5.912, 0.346), (6.942, 1.409, 5.931, 0.348)),
    (4.0, 0.10, (6.914, 1.635, 5.532, 0.303), (6.913, 1.598, 5.533, 0.301)),
    (7.0, 0.10, (6.922, 2.799, 12.52, 0.149), (6.921, 2.936, 12.54, 0.148)),
)


@functools.cache
def _polynomial():
    return jax.jit(sainsot_coefficients)


@pytest.mark.parametrize(("ratio", "half", "polynomial", "exact"), _TABLE)
def test_table_of_sainsot_and_of_the_ring(ratio, half, polynomial, exact):
    rounding = np.where(np.asarray(exact) > 10.0, 6e-3, 7e-4)
    fitted = np.asarray(_polynomial()(jnp.asarray(ratio), jnp.asarray(half)))
    assert (np.abs(fitted - np.asarray(polynomial)) < rounding).all()
    assert (np.abs(_coefficients(ratio, half) - np.asarray(exact)) < rounding).all()


def test_polynomial_within_its_range():
    """From h = 2 on L* is right within 1 %, P* 4 %, Q* 5 % and M* 13 %; at 1.4 P* is not."""
    assert SAINSOT_RADIUS_RATIO == (1.4, 7.0)
    assert SAINSOT_ROOT_HALF_ANGLE == (0.01, 0.12)
    for ratio, half in itertools.product((2.0, 3.0, 5.0, 7.0), (0.04, 0.08, 0.12)):
        fitted = np.asarray(_polynomial()(jnp.asarray(ratio), jnp.asarray(half)))
        error = np.abs(fitted / _coefficients(ratio, half) - 1.0)
        assert (error < np.asarray([0.01, 0.13, 0.04, 0.05])).all()
    thin = _polynomial()(jnp.asarray(1.4), jnp.asarray(0.1))
    assert_close(thin[2] / _coefficients(1.4, 0.1)[2], 1.217, rtol=2e-3, atol=0.0)


def test_influence_of_thirty_teeth():
    """Physics A2.5. Its rotation was summed to 300 orders only and is 1e-4 low."""
    found = _influence(2.0, 0.1004, _LITERATURE)
    own = [[1.3008, 0.0, 0.0], [0.0, 2.6605, 1.9463], [0.0, 3.5039, 170.12]]
    other = [[0.3763, 0.0119, -2.4719], [-0.0119, 1.6925, -0.7525], [2.566, 0.9307, -17.28]]
    assert_close(found, np.asarray([own, other]), rtol=1.5e-4, atol=6e-5)


@pytest.mark.parametrize(
    ("teeth", "ratios"),
    [
        (20, (0.19, 0.31, 0.48, 0.69)),
        (30, (0.22, 0.34, 0.49, 0.69)),
        (50, (0.27, 0.38, 0.51, 0.69)),
    ],
)
def test_coupling_of_adjacent_teeth(teeth, ratios):
    """Physics A2.5: deflection of the next tooth over that of the loaded one."""
    root, tangent = 0.5 * teeth - 1.25, math.tan(math.radians(20.0))
    load = np.asarray([-tangent, 1.0, 1.25 / root])
    pitch = 2.0 * math.pi / teeth
    for ratio, expected, own in zip(
        (1.5, 2.0, 3.0, 5.0), ratios, (3.90, 4.74, 6.18, 10.0), strict=True
    ):
        found = _influence(ratio, 1.38 / root, _LITERATURE, pitch=pitch)
        bent = np.einsum("i,kij,j->k", load, found, load)
        assert abs(bent[1] / bent[0] - expected) < 6e-3
        if teeth == 30:
            assert abs(bent[0] / own - 1.0) < 2e-3


# --- a tooth's load on its root


_resultants = eqx.filter_jit(root_resultants)


@eqx.filter_jit
def _rolls(section: jg.ToothSection) -> jax.Array:
    start, middle = section.form_roll_angle, jnp.tan(section.pressure_angle)
    return start + jnp.asarray([0.2, 0.9, 1.4]) * (middle - start)


@over(fzg_c14, helical_25_31)
def test_resultants_have_the_arm_of_the_base_circle(make):
    """Unit force along the common normal: |s| = 1 and torque r_b about the centre."""
    pair = make()
    for gear in (pair.pinion, pair.wheel):
        section = jg.tooth_section(pair, gear)
        force, across, moment = np.asarray(_resultants(section, _rolls(section))).T
        assert_close(np.hypot(force, across), np.ones(3), rtol=1e-13, atol=0.0)
        torque = (across + moment) * float(section.root_radius)
        assert_close(torque, np.full(3, float(section.base_radius)), rtol=1e-12, atol=0.0)
        assert (across > 0.0).all()
        # High on the tooth the load points inward.
        assert force[2] < 0.0


def test_sainsot_by_hand():
    """A2.2 with the polynomial's own four numbers."""
    section = jg.tooth_section(fzg_c14(), fzg_c14().pinion)
    rolls, ratio = _rolls(section), jnp.asarray(2.5)
    load = tooth_load(section, rolls)
    angle, height = np.asarray(load.angle), np.asarray(load.height)
    half, root = float(section.root_half_angle), float(section.root_radius)
    row = np.asarray([half**-2, 6.25, 2.5 / half, 1.0 / half, 2.5, 1.0])
    bend, mixed, press, side = (
        row @ column
        for column in (
            (-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045),
            (60.111e-5, 28.1e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086),
            (-50.952e-5, 185.5e-3, 0.0538e-4, 53.3e-3, 0.2895, 0.9236),
            (-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904),
        )
    )
    slender = (height - root) / (2.0 * root * half)
    inner = bend * slender**2 + mixed * slender + press * (1.0 + side * np.tan(angle) ** 2)
    got = sainsot_compliance(section, _STEEL, ratio, rolls)
    assert_close(got, np.cos(angle) ** 2 / 206e9 * inner, rtol=1e-12, atol=0.0)


def test_ring_agrees_with_sainsot_as_a_foundation():
    """A whole tooth of z = 30, where the polynomial is at home: within 3 %."""
    section = jg.tooth_section(standard_30_30(), standard_30_30().pinion)
    rolls = _rolls(section)
    load = np.asarray(_resultants(section, rolls))
    half = float(section.root_half_angle)
    for ratio in (2.0, 4.0):
        found = _influence(ratio, half, _LITERATURE)[0]
        exact = np.einsum("pi,ij,pj->p", load, found, load) / 206e9
        fitted = sainsot_compliance(section, _STEEL, jnp.asarray(ratio), rolls)
        assert_close(exact, fitted, rtol=3e-2, atol=0.0)


# --- derivatives


@pytest.mark.parametrize(
    ("variant", "transform"), quick(1, [(_MODEL, jax.grad), (_LITERATURE, jax.jacfwd)])
)
def test_gradients(variant, transform):
    """By both modes; each is one program, and the differences need no other than the tests' own."""
    weights = np.random.default_rng(3).normal(size=(2, 3, 3)) / np.asarray([1.0, 1.0, 10.0])
    program = _program(1, 120, *variant)

    def total(argument):
        return jnp.sum(jnp.asarray(weights) * program(*argument))

    slopes = jax.jit(transform(total))
    for ratio in (1.02, 1.7, 30.0):
        values = np.asarray([ratio, 0.09, 0.27, _PITCH])
        found = np.asarray(slopes(tuple(map(jnp.asarray, values))))
        for index, slope in enumerate(found):
            step = np.zeros(4)
            step[index] = 1e-5 * (values[index] - (1.0 if index == 0 else 0.0))
            ahead, behind = (
                np.sum(weights * np.asarray(program(*map(jnp.asarray, values + way * step))))
                for way in (1.0, -1.0)
            )
            assert_close(slope, (ahead - behind) / (2.0 * step[index]), rtol=1e-6, atol=0.0)


def test_gradient_of_a_foundation():
    """Through the tooth's own geometry as well."""
    section = jg.tooth_section(helical_25_31(), helical_25_31().pinion)
    rolls = _rolls(section)[1:2]

    def compliance(argument):
        section, ratio, rolls = argument
        load = root_resultants(section, rolls)[0]
        return 206e9 * sainsot_compliance(section, _STEEL, ratio, rolls)[0] + load @ load[::-1]

    assert_gradient(compliance, (section, jnp.asarray(3.0), rolls), rtol=1e-6)


def test_one_trace():
    @eqx.debug.assert_max_traces(max_traces=1)
    def own(ratio, half):
        return ring_influence(
            radius_ratio=ratio,
            root_half_angle=half,
            poisson=jnp.asarray(0.3),
            pitch_angle=jnp.asarray(_PITCH),
            neighbours=0,
            harmonics=4,
        )

    program = jax.jit(own)
    assert program(jnp.asarray(2.0), jnp.asarray(0.1)).shape == (1, 3, 3)
    assert program(jnp.asarray(3.0), jnp.asarray(0.05)).shape == (1, 3, 3)
