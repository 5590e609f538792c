import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import (
    accessory,
    every_pair,
    exchanged,
    fzg_c14,
    helical_25_31,
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
from helpers import assert_close, assert_gradient, quick

import jaxgear as jg
from jaxgear import N_per_mm_um, mm, um


def _on(first: jg.AbstractFoundation, second: jg.AbstractFoundation | None = None):
    """Teeth on these foundations; by default the same under both gears."""
    second = first if second is None else second
    return jg.WeberBanaschek(pinion_foundation=first, wheel_foundation=second, face_coupling=None)


_WEBER = jg.WeberBanaschek(face_coupling=None)
_HALF_PLANES = _on(jg.WeberFoundation())


@eqx.filter_jit
def _compiled(law: jg.AbstractCompliance, pair: jg.GearPair, roll: jax.Array, load: jax.Array):
    return law(pair, roll, load)


def _compliance(
    law: jg.AbstractCompliance, pair: jg.GearPair, roll: jax.Array, load: jax.Array
) -> np.ndarray:
    """Of any number of positions, by one program of nine."""
    places = np.asarray(roll)
    found = [
        _compiled(law, pair, jnp.asarray(np.resize(places[i : i + 9], 9)), load)
        for i in range(0, roll.size, 9)
    ]
    return np.concatenate(found)[: roll.size]


def _load(newton_per_mm: float) -> jax.Array:
    return jnp.asarray(1e3 * newton_per_mm)


def _along(pair: jg.GearPair, *places: float) -> jax.Array:
    """Positions at these shares of the path of contact."""
    return pair.path_start + jnp.asarray(places) * pair.path_of_contact


def _at_pitch_point(pair: jg.GearPair, law: jg.AbstractCompliance, load: jax.Array) -> float:
    """Compliance at the pitch point [um mm/N]."""
    return float(_compliance(law, pair, pair.pitch_point[None], load)[0]) * N_per_mm_um


def _with_materials(pair: jg.GearPair, first: jg.Material, second: jg.Material) -> jg.GearPair:
    return eqx.tree_at(lambda p: [p.pinion.material, p.wheel.material], pair, [first, second])


# --- Weber and Banaschek against a table

_TABLE = [
    # line load [N/mm]; beam, foundation, contact [um mm/N]; c' and ISO's c'_th [N/(mm um)]
    (standard_17_43, 100.0, 0.0215, 0.0225, 0.0186, 15.99, 16.03, 0.975),
    (standard_30_30, 300.0, 0.0198, 0.0219, 0.0180, 16.76, 16.39, 0.975),
    (accessory, 275.0, 0.0111, 0.0172, 0.0140, 23.63, 22.35, 1.0),
]


@pytest.mark.parametrize(
    ("make", "load", "beam", "foundation", "contact", "stiffness", "iso", "rack"), quick(2, _TABLE)
)
def test_weber_and_banaschek_at_the_pitch_point(
    make, load, beam, foundation, contact, stiffness, iso, rack
):
    pair = make()
    rigid = _on(jg.NoFoundation())
    total, without = (_at_pitch_point(pair, law, _load(load)) for law in (_WEBER, rigid))
    # Doubling the load takes 4 (1 - nu^2) ln(sqrt 2)/(pi E) off the contact term, and it alone.
    eased = _at_pitch_point(pair, rigid, _load(2.0 * load))
    logarithm = 4.0 * 0.91 / (math.pi * 206.0) * 0.5 * math.log(2.0)
    assert_close(without - eased, logarithm, rtol=1e-8, atol=0.0)
    # The last printed digit is 0.5 % of the smallest of them.
    assert_close(total - without, foundation, rtol=1e-2, atol=0.0)
    assert_close(without, beam + contact, rtol=1e-2, atol=0.0)
    assert_close(1.0 / total, stiffness, rtol=5e-3, atol=0.0)
    # The printed ISO value of the accessory pair has the rack's factor in it already.
    assert_close(1.0 / total, iso * rack, rtol=6e-2, atol=0.0)


def test_parts_of_the_pitch_point():
    """Beam and contact apart, by the functions of one tooth."""
    beam_of = eqx.filter_jit(jg.beam_compliance)
    for make, load, beam, _, contact, *_ in _TABLE:
        pair = make()
        half = jg.hertz_contact(pair, pair.pitch_point).half_width(_load(load))
        got = np.zeros(2)
        for gear, roll in (
            (pair.pinion, pair.pitch_point),
            (pair.wheel, pair.tangent_length - pair.pitch_point),
        ):
            section = jg.tooth_section(pair, gear)
            angle = roll / section.base_radius
            # From contact to centreline along the common tangent of the base circle.
            depth = section.base_radius * (
                angle - jnp.tan(jnp.arctan(angle) - section.half_angle(angle))
            )
            got[0] += float(beam_of(section, gear.material, angle[None])[0])
            got[1] += float(jg.penetration_compliance(gear.material, depth, half))
        assert_close(got * N_per_mm_um, jnp.asarray([beam, contact]), rtol=1e-2, atol=0.0)


@every_pair
def test_weber_and_banaschek_near_iso(make):
    """Within 15 % of the measured formula without its C_M, at the line load of its validity."""
    pair = make()
    iso = jg.iso_stiffness(pair, _load(200.0))
    measured = iso.single / 0.8 / jnp.cos(pair.helix_angle) / N_per_mm_um
    found = 1.0 / _at_pitch_point(pair, _HALF_PLANES, _load(200.0))
    assert abs(found / float(measured) - 1.0) < 0.15


def test_mesh_stiffness_of_ross_62_62():
    """Physics B4, half-planes under the teeth: at most 6.386e8 N/m with two pairs, at 100 N/mm."""
    pair = ross_62_62()
    first = jnp.linspace(pair.path_start, pair.path_end - pair.transverse_base_pitch, 18)
    both = 1.0 / _compliance(_HALF_PLANES, pair, first, _load(100.0))
    both += 1.0 / _compliance(_HALF_PLANES, pair, first + pair.transverse_base_pitch, _load(100.0))
    assert_close(np.max(both) * 20.0 * mm, 6.386e8, rtol=3e-3, atol=0.0)


@pytest.mark.slow
def test_a_bore_chooses_the_ring():
    """Each gear by itself: a ring where its bore says how thick, a half-plane where none does."""
    bored, plain = ross_62_62(), standard_30_30()
    mixed = eqx.tree_at(
        lambda p: p.pinion,
        plain,
        eqx.tree_at(
            lambda g: g.bore, plain.pinion, jnp.asarray(30.0 * mm), is_leaf=lambda x: x is None
        ),
    )
    bodies = eqx.filter_jit(lambda pair: _WEBER.bodies(pair, 1))
    assert [len(bodies(pair)) for pair in (bored, plain, mixed)] == [6, 0, 3]
    body, sheared, bent = bodies(mixed)
    assert body.roll_sign == 1
    assert body.influence.shape == bent.influence.shape == (2, 3, 3)
    assert sheared.influence.shape == (2, 1, 1)
    roll = _along(mixed, 0.2, 0.7)
    chosen = _on(jg.RingFoundation(), jg.WeberFoundation())
    found = _compliance(chosen, mixed, roll, _load(200.0))
    assert_close(_compliance(_WEBER, mixed, roll, _load(200.0)), found, rtol=1e-13, atol=0.0)


@over(standard_17_43, slow=(standard_30_30, standard_50_50))
def test_stiffness_falls_towards_the_ends(make):
    """To 0.64-0.71 of the largest, of one pair to 0.61."""
    pair = make()
    stiffness = 1.0 / _compliance(_WEBER, pair, _along(pair, *np.linspace(0, 1, 9)), _load(200.0))
    share = stiffness[[0, -1]] / stiffness.max()
    assert ((share > 0.60) & (share < 0.75)).all()


def test_foundations_may_differ():
    """What a body of finite elements supplies is left out on its side only."""
    pair, load = helical_25_31(), _load(200.0)
    roll = _along(pair, 0.3, 0.8)
    none, first, second, both = (
        _compliance(_on(a, b), pair, roll, load)
        for a in (jg.NoFoundation(), jg.WeberFoundation())
        for b in (jg.NoFoundation(), jg.WeberFoundation())
    )
    assert_close(both - first, second - none, rtol=1e-9, atol=0.0)
    # The pinion's tooth is longer where its own tip is in contact.
    assert float((second - none)[1]) > float((second - none)[0]) > 0.0
    assert float((first - none)[0]) > float((first - none)[1]) > 0.0


# --- ISO 6336-1 method B


def test_iso_tr_6336_30():
    """Physics B3: F_t = 127352 N on 100 mm; the standard's own contact ratio differs by 2e-4."""
    iso = jg.iso_stiffness(iso_tr_6336_30(), jnp.asarray(127352.0 / 0.1))
    got = jnp.stack([iso.theoretical, iso.single]) / N_per_mm_um
    assert_close(got, jnp.asarray([17.85584, 12.37047]), rtol=1e-6, atol=0.0)
    got = jnp.stack([iso.mesh, iso.face]) / N_per_mm_um
    assert_close(got, jnp.asarray([17.46485, 14.84512]), rtol=2e-4, atol=0.0)


def test_iso_of_equal_gears():
    """50/50 of module 3, and its series by hand."""
    iso = jg.iso_stiffness(standard_50_50(), _load(300.0))
    got = jnp.stack([iso.theoretical, iso.single, iso.mesh]) / N_per_mm_um
    assert_close(got, jnp.asarray([18.02, 14.05, 22.0]), rtol=5e-4, atol=0.0)
    by_hand = 1.0 / (0.04723 + (0.15551 + 0.25791) / 50.0)
    assert_close(iso.theoretical / N_per_mm_um, by_hand, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    ("make", "theoretical"), [(standard_17_43, 16.03), (standard_30_30, 16.39), (accessory, 20.247)]
)
def test_iso_of_the_table(make, theoretical):
    """The accessory's 22.35 has C_B = 1.00335 x 1.1 in it, which leaves 20.25."""
    iso = jg.iso_stiffness(make(), _load(300.0))
    assert_close(iso.theoretical / N_per_mm_um, theoretical, rtol=4e-4, atol=0.0)


def test_iso_rack_factor_by_hand():
    """C_B = [1 + 0.5 (1.2 - h_fP)][1 - 0.02 (20 - alpha_n)] of the accessory pair, C_M = 0.8."""
    iso = jg.iso_stiffness(accessory(), _load(300.0))
    expected = 0.8 * (1.0 + 0.5 * (1.2 - 1.1933)) * (1.0 + 0.02 * 5.0)
    assert_close(iso.single / iso.theoretical, expected, rtol=1e-12, atol=0.0)
    mean = 0.75 * 1.421555 + 0.25
    assert_close(iso.mesh / iso.single, mean, rtol=1e-6, atol=0.0)
    assert_close(iso.face / iso.mesh, 0.85, rtol=1e-14, atol=0.0)


@pytest.mark.parametrize(
    ("load", "share"), [(6.25, 0.5), (50.0, 0.5**0.25), (100.0, 1.0), (1e3, 1.0)]
)
def test_iso_at_low_loads(load, share):
    """Below 100 N/mm the single stiffness falls like the fourth root; the theoretical one stays."""
    pair = power()
    low, nominal = (jg.iso_stiffness(pair, _load(x)) for x in (load, 200.0))
    assert_close(low.single / nominal.single, share, rtol=1e-12, atol=0.0)
    assert_close(low.theoretical, nominal.theoretical, rtol=1e-14, atol=0.0)


def test_iso_of_other_materials():
    """In proportion to the harmonic mean of both moduli over that of steel."""
    steel, soft = jg.Material(206e9), jg.Material(70e9)
    pair = power()
    one, mixed, other = (
        jg.iso_stiffness(_with_materials(pair, *both), _load(200.0)).single
        for both in ((steel, steel), (steel, soft), (soft, steel))
    )
    assert_close(mixed / one, 2.0 * 70.0 / 276.0, rtol=1e-12, atol=0.0)
    assert_close(mixed, other, rtol=1e-14, atol=0.0)


def test_iso_law_is_its_single_stiffness_normal_to_the_flank():
    """c' counts a transverse force and path per face width; along the line it is c'/cos(beta)."""
    pair = iso_tr_6336_30()
    found = jg.Iso6336()(pair, _along(pair, 0.0, 0.4, 1.0), _load(1273.52))
    expected = math.cos(math.radians(15.8)) / 12.37047
    assert_close(found * N_per_mm_um, jnp.full(3, expected), rtol=1e-6, atol=0.0)


# --- constant stiffness


def test_constant_stiffness():
    law = jg.ConstantStiffness(14.0 * N_per_mm_um)
    found = law(power(), _along(power(), 0.0, 0.4, 1.0), _load(200.0))
    assert_close(found, jnp.full(3, 1.0 / 14e9), rtol=1e-14, atol=0.0)
    assert_close(jg.single_pair_stiffness(power(), law, _load(1.0)), 14e9, rtol=1e-14, atol=0.0)


@pytest.mark.parametrize("stiffness", [0.0, -14e9, math.nan])
def test_no_stiffness_is_refused(stiffness):
    with pytest.raises(ValueError, match=r"`ConstantStiffness.stiffness` must be positive, got"):
        jg.ConstantStiffness(stiffness)


# --- Hertz


def test_hertz_of_the_fzg_c14_pair():
    """GEARpie at C under 200 N m on 14 mm: 5912.1 N, 1347.3 MPa, 199.6 um."""
    pair = fzg_c14()
    line = jg.nominal_line_load(pair, jnp.asarray(200.0))
    assert_close(line * 14.0 * mm, 5912.1, rtol=1e-5, atol=0.0)
    contact = jg.hertz_contact(pair, pair.pitch_point)
    assert_close(contact.pressure(line) / 1e6, 1347.3, rtol=1e-4, atol=0.0)
    assert_close(contact.half_width(line) / um, 199.6, rtol=5e-4, atol=0.0)


@every_pair
def test_radii_of_curvature(make):
    """1/rho = (1/xi + 1/(T1T2 - xi)) cos(beta_b), in the normal plane."""
    pair = make()
    roll = _along(pair, 0.2, 0.5, 0.9)
    inverse = (1.0 / roll + 1.0 / (pair.tangent_length - roll)) * jnp.cos(pair.base_helix_angle)
    assert_close(jg.hertz_contact(pair, roll).radius, 1.0 / inverse, rtol=1e-12, atol=0.0)


# --- scaling, symmetry

_LAWS = [_WEBER, jg.Iso6336()]
every_law = pytest.mark.parametrize("law", _LAWS, ids=["weber", "iso"])


@pytest.mark.slow
@over(helical_25_31, slow=(fzg_c14,))
def test_gears_may_change_places(make):
    pair, load = make(), _load(150.0)
    roll = _along(pair, 0.05, 0.5, 0.8)
    one = _compliance(_WEBER, pair, roll, load)
    other = _compliance(_WEBER, exchanged(pair), pair.tangent_length - roll, load)
    assert_close(other, one, rtol=1e-11, atol=0.0)


@every_law
def test_the_hand_of_the_helix_does_not_matter(law):
    pair = helical_25_31()
    roll = _along(pair, 0.05, 0.8)
    assert_close(
        *(_compliance(law, p, roll, _load(150.0)) for p in (mirrored(pair), pair)),
        rtol=1e-13,
        atol=0.0,
    )


@over(helical_25_31, slow=(fzg_c14,))
def test_stiffness_per_width_ignores_the_unit_of_length(make):
    """Line loads grow with the drawing, then every stress stays, and so does the stiffness."""
    pair = make()
    scaled = lengths_scaled(pair, by=37.0)
    roll = _along(pair, 0.05, 0.5)
    one = _compliance(_WEBER, pair, roll, _load(100.0))
    other = _compliance(_WEBER, scaled, 37.0 * roll, _load(3700.0))
    assert_close(other, one, rtol=1e-9, atol=0.0)


@pytest.mark.parametrize("poisson", quick(2, [0.0, 0.45, 0.2, 0.3]))
def test_equal_materials_are_one_material(poisson):
    """Twice as stiff under twice the load is half the compliance: only F'/E counts."""
    pair = helical_25_31()
    roll = _along(pair, 0.1, 0.6)
    one, stiff = (jg.Material(young, poisson) for young in (100e9, 200e9))
    soft = _compliance(_WEBER, _with_materials(pair, one, one), roll, _load(100.0))
    hard = _compliance(_WEBER, _with_materials(pair, stiff, stiff), roll, _load(200.0))
    assert_close(2.0 * hard, soft, rtol=1e-12, atol=0.0)
    # A mixed pair lies between the two, on either side of the mean by which gear is soft.
    mixed = _compliance(_WEBER, _with_materials(pair, one, stiff), roll, _load(100.0))
    swapped = _compliance(_WEBER, _with_materials(pair, stiff, one), roll, _load(100.0))
    hard = _compliance(_WEBER, _with_materials(pair, stiff, stiff), roll, _load(100.0))
    for other in (mixed, swapped):
        assert ((other > hard) & (other < soft)).all()


def test_exchange_carries_the_materials_along():
    pair = helical_25_31()
    assert float(pair.pinion.material.young) != float(pair.wheel.material.young)
    roll = _along(pair, 0.3)
    swapped = _with_materials(pair, pair.wheel.material, pair.pinion.material)
    one, other = (_compliance(_WEBER, p, roll, _load(100.0)) for p in (pair, swapped))
    assert abs(float(one[0] / other[0]) - 1.0) > 1e-4


@pytest.mark.slow
def test_largest_single_pair_stiffness():
    pair = fzg_c14()
    fine = 1.0 / _compliance(_WEBER, pair, _along(pair, *np.linspace(0.2, 0.8, 90)), _load(200.0))
    largest = eqx.filter_jit(jg.single_pair_stiffness)(pair, _WEBER, _load(200.0))
    assert_close(largest, fine.max(), rtol=1e-4, atol=0.0)


# --- gradients


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "places"),
    [
        # Mid-path, and crossing within the pinion's fillet.
        pytest.param(helical_25_31, (0.6, 0.01), marks=pytest.mark.slow),
        # Crossing within the pinion's fillet, within the wheel's, and below the wheel's chord.
        (power, (0.001, 0.93, 0.998)),
    ],
)
def test_gradients_of_weber_and_banaschek(make, places):
    """Every real field of the pair, its materials included, and the load."""
    argument = make(), _load(180.0)

    def stiffness(argument):
        pair, load = argument
        each = 1.0 / _WEBER(pair, _along(pair, *places), load) / N_per_mm_um
        return jnp.sum(jnp.asarray([1.0, 0.7, 1.6])[: len(places)] * each)

    assert_gradient(stiffness, argument, rtol=1e-4, step=1e-6, scale=sizes(argument))


@pytest.mark.parametrize(
    ("make", "wheel", "place", "below_chord"),
    [
        (helical_25_31, False, 0.01, False),
        (power, False, 0.001, False),
        (power, True, 0.93, False),
        (power, True, 0.998, True),
    ],
)
def test_loads_low_on_the_tooth_are_what_they_say(make, wheel, place, below_chord):
    """Heights at which those loads cross the centreline, against root chord and junction."""
    pair = make()
    section = jg.tooth_section(pair, pair.wheel if wheel else pair.pinion)
    roll = _along(pair, place)[0]
    roll = pair.tangent_length - roll if wheel else roll
    angle = roll / (jnp.cos(pair.base_helix_angle) * section.base_radius)
    height = section.base_radius / jnp.cos(jnp.arctan(angle) - section.half_angle(angle))
    chord = section.fillet(jnp.asarray(0.5 * math.pi))[1]
    junction = section.fillet(section.pressure_angle)[1]
    assert (float(height) < float(chord)) == below_chord
    assert float(height) < float(junction)


@pytest.mark.slow
def test_every_field_that_shapes_a_tooth_has_a_gradient():
    def compliance(pair: jg.GearPair) -> jax.Array:
        return _WEBER(pair, _along(pair, 0.4), _load(180.0))[0] * N_per_mm_um

    gradient = eqx.filter_jit(eqx.filter_grad(compliance))(helical_25_31())
    flat = jax.tree_util.tree_leaves_with_path(gradient)
    still = {jax.tree_util.keystr(path) for path, slope in flat if float(slope) == 0.0}
    # Of helical teeth the face width too: loads along the axis bend the body, a plate as thick.
    assert still == {f".{gear}.material.density" for gear in ("pinion", "wheel")}
    assert np.isfinite([float(slope) for _, slope in flat]).all()
    assert len(flat) == 24


@pytest.mark.slow
def test_gradients_of_iso():
    argument = helical_25_31(), _load(80.0)

    def mixed(argument):
        iso = jg.iso_stiffness(*argument)
        return (iso.theoretical + 2.0 * iso.single + 0.7 * iso.mesh) / N_per_mm_um

    assert_gradient(mixed, argument, rtol=1e-6, scale=sizes(argument))


def test_one_trace():
    def stiffness(pair, load):
        return _WEBER(pair, _along(pair, 0.5), load)

    traced = eqx.filter_jit(eqx.debug.assert_max_traces(stiffness, max_traces=1))
    for load in (100.0, 200.0):
        traced(power(), _load(load))
