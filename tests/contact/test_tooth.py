import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import (
    accessory,
    fzg_c14,
    helical_25_31,
    lengths_scaled,
    over,
    power,
    sizes,
    standard_17_43,
    standard_30_30,
)
from helpers import assert_close, assert_gradient
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

import jaxgear as jg
from jaxgear import mm, um
from jaxgear._contact._tooth import contact_modulus, tooth_load

_STEEL = jg.Material(206e9, 0.3)
_SOFT = jg.Material(70e9, 0.34)


# One program for every tooth, as long as it is asked for the same number of points.
_beam = eqx.filter_jit(jg.beam_compliance)


def _rolls(pair: jg.GearPair, index: int, places: np.ndarray) -> jax.Array:
    """Roll angles in the virtual section at these shares of the path of contact."""
    roll = pair.path_start + jnp.asarray(places) * pair.path_of_contact
    if index == 1:
        roll = pair.tangent_length - roll
    section = _sections(pair)[index]
    return roll / (jnp.cos(pair.base_helix_angle) * section.base_radius)


def _sections(pair: jg.GearPair) -> list[jg.ToothSection]:
    return [jg.tooth_section(pair, gear) for gear in (pair.pinion, pair.wheel)]


# --- where the load acts


@over(accessory, fzg_c14, helical_25_31)
@pytest.mark.parametrize("index", [0, 1])
def test_load_by_plane_vectors(make, index):
    """The normal of the flank through the contact, cut with the tooth's centreline."""
    pair = make()
    section = _sections(pair)[index]
    rolls = _rolls(pair, index, np.asarray([0.1, 0.5, 0.9]))
    load = tooth_load(section, rolls)
    for i, roll in enumerate(rolls):
        place, along = jax.jvp(section.flank, (roll,), (jnp.ones(()),))
        x, y = (float(v) for v in place)
        # Square to the flank, towards the centreline.
        inwards = np.asarray([-float(along[1]), float(along[0])])
        inwards /= -np.linalg.norm(inwards) * np.sign(inwards[0])
        distance = -x / inwards[0]
        height = y + distance * inwards[1]
        angle = math.atan2(abs(inwards[1]), abs(inwards[0]))
        got = jnp.stack([load.depth[i], load.height[i], jnp.abs(load.angle[i])])
        assert_close(got, jnp.asarray([distance, height, angle]), rtol=1e-9, atol=0.0)
        # A load high on the tooth crosses below its contact: it presses towards the root.
        assert (float(load.angle[i]) > 0.0) == (height < y)


# --- the cantilever


class _DrawnTooth:
    """Half thickness against height, found point by point and independent of the library.

    Above the form circle it is the involute, below it what the rack's rounded corner leaves.
    """

    def __init__(self, section: jg.ToothSection):
        self.teeth, self.module = float(section.teeth), float(section.module)
        self.alpha, self.x = float(section.pressure_angle), float(section.profile_shift)
        deep, tip = float(section.dedendum), float(section.fillet_radius)
        self.tip = tip * self.module
        self.reference = 0.5 * self.teeth * self.module
        flat = 0.25 * math.pi - (deep - tip) * math.tan(self.alpha) - tip / math.cos(self.alpha)
        self.corner = complex(
            (0.5 * math.pi - flat) * self.module,
            self.reference - (deep - tip - self.x) * self.module,
        )
        self.root_radius = self.reference - (deep - self.x) * self.module
        self.root_half_angle = math.pi / self.teeth - 2.0 * flat / self.teeth
        self.root = self.root_radius * math.cos(self.root_half_angle)
        # Depth of the rack's straight flank, and the involute's lower end that it cuts.
        straight = deep - self.x - tip * (1.0 - math.sin(self.alpha))
        base = self.reference * math.cos(self.alpha)
        self.base = base
        roll = self.reference * math.sin(self.alpha) - straight * self.module / math.sin(self.alpha)
        form = math.hypot(base, roll)
        self.junction = form * math.cos(self.half_angle(form))

    def half_angle(self, radius: float) -> float:
        at = math.acos(min(self.base / radius, 1.0))
        own = (0.5 * math.pi + 2.0 * self.x * math.tan(self.alpha)) / self.teeth
        return own + math.tan(self.alpha) - self.alpha - math.tan(at) + at

    def half_thickness(self, height: float) -> float:
        if height >= self.junction:
            radius = brentq(
                lambda r: r * math.cos(self.half_angle(r)) - height,
                self.base,
                1.5 * self.reference,
                xtol=1e-15,
            )
            assert isinstance(radius, float)
            return radius * math.sin(self.half_angle(radius))

        def left_edge(turn: float) -> float:
            centre = (self.corner - self.reference * turn) * np.exp(-1j * turn)
            across = self.tip**2 - (height - centre.imag) ** 2
            return float(centre.real - math.sqrt(across)) if across >= 0.0 else math.inf

        turns = np.linspace(-0.3, 0.6, 451)
        nearest = turns[np.argmin([left_edge(t) for t in turns])]
        found = minimize_scalar(
            left_edge,
            bounds=(nearest - 2e-3, nearest + 2e-3),
            method="bounded",
            options={"xatol": 1e-11},
        )
        return left_edge(found.x)

    def integral(self, function: Callable[[float, float], float], top: float) -> float:
        """Of a function of height and full thickness, from the root chord up."""
        total, low = 0.0, self.root
        for high in (min(self.junction, top), top):
            if high > low:
                total += quad(
                    lambda y: function(y, 2.0 * self.half_thickness(y)),
                    low,
                    high,
                    epsabs=0.0,
                    epsrel=1e-7,
                )[0]
                low = high
        return total


@pytest.mark.parametrize(
    ("make", "index", "place"),
    [
        # Middle of the path, near the tip, and loads that cross within the fillet.
        (fzg_c14, 0, 0.5),
        (fzg_c14, 1, 0.05),
        (standard_30_30, 0, 0.02),
        (standard_30_30, 1, 0.03),
        (helical_25_31, 0, 0.0),
        (accessory, 0, 0.1),
        (accessory, 1, 0.4),
    ],
)
def test_cantilever_against_quadrature(make, index, place):
    """All of A2.1, on a tooth drawn from the rack."""
    pair = make()
    section = _sections(pair)[index]
    drawn = _DrawnTooth(section)
    roll = float(_rolls(pair, index, np.asarray([place]))[0])
    angle = math.atan(roll) - drawn.half_angle(drawn.base * math.hypot(1.0, roll))
    top = drawn.base / math.cos(angle)
    bending = drawn.integral(lambda y, d: (top - y) ** 2 / d**3, top)
    shear = drawn.integral(lambda _, d: 1.0 / d, top)
    # 12 (1 - 0.09) = 10.92, 2.4 x 1.3 = 3.12.
    expected = 10.92 * bending + (3.12 + 0.91 * math.tan(angle) ** 2) * shear
    expected *= math.cos(angle) ** 2 / 206e9
    got = _beam(section, _STEEL, jnp.asarray([roll, roll]))[0]
    assert_close(got, expected, rtol=1e-6, atol=0.0)


def test_the_fillet_cases_are_what_they_say():
    """Of the loads above, those near the start of contact cross between chord and junction."""
    for make, index, place in ((standard_30_30, 0, 0.02), (helical_25_31, 0, 0.0)):
        section = _sections(make())[index]
        drawn = _DrawnTooth(section)
        height = float(tooth_load(section, _rolls(make(), index, np.asarray([place]))).height[0])
        assert drawn.root < height < drawn.junction


@over(accessory, power)
def test_a_load_below_the_chord_finds_no_cantilever(make):
    """Of 25 degrees, a load at the start of the wheel's contact crosses within the body."""
    pair = make()
    section = _sections(pair)[1]
    rolls = _rolls(pair, 1, np.asarray([1.0, 0.999]))
    assert float(tooth_load(section, rolls).height[0]) < float(
        section.fillet(jnp.asarray(0.5 * math.pi))[1]
    )
    found = np.asarray(_beam(section, _STEEL, rolls))
    assert (np.abs(found) < 1e-22).all()


def test_cantilever_in_plane_strain_for_any_poisson():
    """Bending and compression shrink by 1 - nu^2, shear grows by 1 + nu: linear in both."""
    section = _sections(fzg_c14())[0]
    roll = _rolls(fzg_c14(), 0, np.asarray([0.6, 0.6]))
    value = {
        nu: float(_beam(section, jg.Material(206e9, nu), roll)[0]) for nu in (0.0, 0.2, 0.3, 0.4)
    }
    # a (1 - nu^2) + b (1 + nu) from two of them gives the other two.
    a, b = np.linalg.solve([[1.0, 1.0], [0.96, 1.2]], [value[0.0], value[0.2]])
    for nu in (0.3, 0.4):
        assert_close(value[nu], a * (1.0 - nu**2) + b * (1.0 + nu), rtol=1e-12, atol=0.0)
    assert min(a, b) > 0.0


# --- the foundation


def test_foundation_by_hand():
    """At 0.3, 5.214 (u/S)^2 + 1.04 u/S + 1.390 (1 + 0.2917 tan^2), near Weber's rounded numbers."""
    section = _sections(fzg_c14())[0]
    drawn = _DrawnTooth(section)
    roll = _rolls(fzg_c14(), 0, np.asarray([0.7]))
    at = float(roll[0])
    angle = math.atan(at) - drawn.half_angle(drawn.base * math.hypot(1.0, at))
    slender = drawn.base / math.cos(angle) - drawn.root_radius
    slender /= 2.0 * drawn.root_radius * drawn.root_half_angle
    cosine, tangent = math.cos(angle), math.tan(angle)
    got = float(jg.WeberFoundation()(section, _STEEL, roll)[0]) * 206e9 / cosine**2
    exact = 5.21391594 * slender**2 + 1.04 * slender + 1.39037759 * (1 + 0.29166667 * tangent**2)
    assert_close(got, exact, rtol=1e-8, atol=0.0)
    weber = 5.2 * slender**2 + slender + 1.4 * (1.0 + 0.294 * tangent**2)
    assert_close(got, weber, rtol=1.5e-2, atol=0.0)
    assert 0.4 < slender < 2.0


def test_no_foundation_gives_nothing():
    section = _sections(fzg_c14())[0]
    roll = _rolls(fzg_c14(), 0, np.asarray([0.2, 0.7]))
    assert list(jg.NoFoundation()(section, _STEEL, roll)) == [0.0, 0.0]


# --- Hertz and the logarithm


def test_contact_modulus_by_hand():
    """1/E* = 2 x 0.91/206 GPa for steel on steel; the sum of both for a mixed pair."""
    assert_close(contact_modulus(_STEEL, _STEEL), 206e9 / 1.82, rtol=1e-14, atol=0.0)
    mixed = 1.0 / (0.91 / 206e9 + (1.0 - 0.34**2) / 70e9)
    assert_close(contact_modulus(_STEEL, _SOFT), mixed, rtol=1e-14, atol=0.0)
    assert_close(contact_modulus(_SOFT, _STEEL), mixed, rtol=1e-14, atol=0.0)


def test_hertz_by_hand():
    """F' = 422 N/mm on rho = 8 mm: a_H = sqrt(8 F' rho 0.91/(pi E)), p_0 = 2 F'/(pi a_H)."""
    contact = jg.HertzContact(jnp.asarray(8.0 * mm), contact_modulus(_STEEL, _STEEL))
    load = jnp.asarray(422e3)
    half = math.sqrt(8.0 * 422e3 * 8e-3 * 0.91 / (math.pi * 206e9))
    assert_close(contact.half_width(load), half, rtol=1e-12, atol=0.0)
    assert_close(contact.pressure(load), 2.0 * 422e3 / (math.pi * half), rtol=1e-12, atol=0.0)


def test_pressure_without_load():
    """None, and a derivative that is a number: unloaded cells are part of every cycle."""
    contact = jg.HertzContact(jnp.asarray(8.0 * mm), contact_modulus(_STEEL, _STEEL))
    for load in (0.0, -3.0):
        value, slope = jax.value_and_grad(contact.pressure)(jnp.asarray(load))
        assert float(value) == 0.0
        assert np.isfinite(float(slope))


def _approach_of_a_half_plane(load: float, half: float, depth: float, young: float, nu: float):
    """Strain below a semi-elliptic pressure, summed from the surface to a depth (Johnson 4.45)."""
    peak = 2.0 * load / (math.pi * half)

    def strain(z: float) -> float:
        slant = math.hypot(half, z)
        across = -peak / half * ((half**2 + 2.0 * z**2) / slant - 2.0 * z)
        down = -peak * half / slant
        return -(1.0 - nu**2) / young * (down - nu / (1.0 - nu) * across)

    # The cancellation of `across` far below the surface limits the tolerance.
    return quad(strain, 0.0, depth, points=[half, 5.0 * half], limit=200, epsrel=1e-10)[0]


@pytest.mark.parametrize(("ratio", "rtol"), [(10.0, 1.5e-3), (30.0, 2e-4), (100.0, 1.5e-5)])
@pytest.mark.parametrize("material", [_STEEL, _SOFT], ids=["steel", "soft"])
def test_logarithm_against_the_half_plane(material, ratio, rtol):
    """Weber's logarithm is the limit of depths well beyond the contact."""
    load, half = 422e3, 200.0 * um
    young, nu = float(material.young), float(material.poisson)
    expected = _approach_of_a_half_plane(load, half, ratio * half, young, nu) / load
    got = jg.penetration_compliance(material, jnp.asarray(ratio * half), jnp.asarray(half))
    assert_close(got, expected, rtol=rtol, atol=0.0)


def test_two_equal_bodies_give_the_symmetric_form():
    """A2.6: 4 F'(1 - nu^2)/(pi E) [ln(2 sqrt(d1 d2)/a) - nu/(2 (1 - nu))]."""
    half, first, second = jnp.asarray(0.2 * mm), 1.7 * mm, 4.1 * mm
    got = sum(
        jg.penetration_compliance(_STEEL, jnp.asarray(depth), half) for depth in (first, second)
    )
    inner = math.log(2.0 * math.sqrt(first * second) / 0.2e-3) - 0.3 / 1.4
    assert_close(got, 4.0 * 0.91 / (math.pi * 206e9) * inner, rtol=1e-12, atol=0.0)


# --- scaling, gradients


@over(fzg_c14, helical_25_31)
def test_compliances_ignore_the_unit_of_length(make):
    """Deflection over load per length is a pure number over E."""
    pair = make()
    places = np.asarray([0.1, 0.6])
    for index in (0, 1):
        one, other = (
            (_sections(p)[index], _rolls(p, index, places))
            for p in (pair, lengths_scaled(pair, by=37.0))
        )
        for law in (_beam, jg.WeberFoundation()):
            assert_close(
                law(other[0], _STEEL, other[1]), law(one[0], _STEEL, one[1]), rtol=1e-9, atol=0.0
            )


def test_compliances_fall_with_stiffness():
    section = _sections(fzg_c14())[0]
    roll = _rolls(fzg_c14(), 0, np.asarray([0.4, 0.4]))
    stiff = jg.Material(412e9, 0.3)
    for law in (_beam, jg.WeberFoundation()):
        assert_close(
            2.0 * law(section, stiff, roll), law(section, _STEEL, roll), rtol=1e-13, atol=0.0
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "make", "index", "place"),
    [
        pytest.param(jg.beam_compliance, standard_17_43, 0, 0.5, marks=pytest.mark.slow),
        # Crossing within the fillet, 0.03 modules above the root chord.
        (jg.beam_compliance, accessory, 0, 0.05),
        (jg.WeberFoundation(), helical_25_31, 0, 0.6),
        (jg.WeberFoundation(), accessory, 0, 0.0),
    ],
)
def test_gradients(law, make, index, place):
    section = _sections(make())[index]
    roll = _rolls(make(), index, np.asarray([place]))

    def compliance(argument):
        return law(*argument)[0] * 206e9

    argument = (section, _STEEL, roll)
    assert_gradient(compliance, argument, rtol=1e-4, step=1e-7, scale=sizes(argument))


@pytest.mark.slow
def test_gradient_of_a_load_below_the_chord():
    """The cantilever is gone; what is left must not be NaN, for a search passes through here."""
    section = _sections(power())[1]
    rolls = _rolls(power(), 1, np.asarray([1.0, 0.5]))

    def total(argument):
        return jnp.sum(jg.beam_compliance(*argument)) * 206e9

    gradient = jax.tree.leaves(eqx.filter_jit(eqx.filter_grad(total))((section, _STEEL, rolls)))
    assert np.isfinite([np.asarray(slope).sum() for slope in gradient]).all()
    assert abs(float(gradient[-1][0])) < 1e-9 * float(gradient[-1][1])


def test_gradient_of_the_contact():
    contact = jg.HertzContact(jnp.asarray(8.0 * mm), contact_modulus(_STEEL, _SOFT))

    def mixed(argument):
        own, material, depth, load = argument
        approach = jg.penetration_compliance(material, depth, own.half_width(load)) * 206e9
        return approach + own.pressure(load) / 1e9

    argument = (contact, _SOFT, jnp.asarray(2.0 * mm), jnp.asarray(3e5))
    assert_gradient(mixed, argument, rtol=1e-7)
