"""Stress at the roots: against finite elements, along the face, its gradient, and ISO 6336-3."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, assert_gradient, quick
from solve_cases import ACCESSORY

import jaxgear as jg
from jaxgear import MPa, mm, um
from jaxgear._geometry._lines import contact_lines
from jaxgear.plot._run_atlas import run_pictures
from jaxgear.study._roots import roots_dataset

EXACT = jg.ExactContact()
# Teeth, shift, pressure angle [deg], dedendum, fillet, addendum, rim in modules; largest tension
# and compression times module over line load with loads at 0.4 and 0.8 of the flank's roll, of
# plane-strain finite elements: quadratic triangles of 0.012 modules along the fillets of the middle
# one of three teeth, the body held as far off as here. Half that size changes them by 0.3 %.
ELEMENTS = {
    "thin rim": ((60, 0.0, 20.0, 1.25, 0.38, 1.0, 0.8), (1.775, 2.599), (-1.748, -3.027)),
    "15 teeth": ((15, 0.5, 20.0, 1.25, 0.38, 0.9, 3.5), (1.999, 2.525), (-2.039, -3.346)),
    "150 teeth": ((150, -0.5, 25.0, 1.25, 0.3, 1.0, 6.0), (1.659, 2.471), (-1.940, -3.105)),
    "14.5 degrees": ((40, 0.0, 14.5, 1.25, 0.2, 1.0, 6.0), (2.993, 3.982), (-3.025, -4.582)),
    "accessory pinion": (
        (45, 0.341, 25.0, 1.1933, 0.25, 0.9447, 6.0),
        (1.749, 2.492),
        (-1.997, -3.289),
    ),
    "accessory wheel": (
        (86, 0.481, 25.0, 1.1933, 0.25, 0.9447, 6.0),
        (1.707, 2.513),
        (-1.975, -3.272),
    ),
}


def _influence(teeth, shift, angle, dedendum, fillet, addendum, rim, *, module=1.5 * mm):
    real = lambda value: jnp.asarray(float(value))
    root = 0.5 * teeth - dedendum + shift
    section = jg.ToothSection(
        *map(real, (teeth, module, math.radians(angle), shift, dedendum, fillet)),
        radius_ratio=real(root / (root - rim)),
    )
    base = 0.5 * teeth * math.cos(math.radians(angle))
    roll = math.sqrt(((0.5 * teeth + shift + addendum) / base) ** 2 - 1.0)
    return jg.root_influence(section, real(roll), real(0.3))


def _stresses(influence, rolls):
    """Along both fillets, of unit line loads on the tooth, times module."""
    return np.einsum("spt,lt->spl", influence.terms[1], influence.place_terms(jnp.asarray(rolls)))


@pytest.fixture(scope="module")
def settled():
    """The accessory pair on its own outlines, even load, and its influences."""
    model = jg.PairModel(ACCESSORY.pair(), 80.0, jg.Flanks(), jg.ConstantStiffness(14e9))
    grid = jg.mesh_grid(model.pair, phases=16, slices=8)
    return model, grid, eqx.filter_jit(jg.mesh_cycle)(model, grid), jg.root_influences(model.pair)


@pytest.mark.slow
@pytest.mark.parametrize("case", quick(2, ELEMENTS))
def test_stress_is_that_of_plane_strain_elements(case):
    gear, tension, compression = ELEMENTS[case]
    influence = _influence(*gear)
    share = np.asarray([0.4, 0.8])
    form, tip = float(influence.form_roll), float(influence.tip_roll)
    drive, coast = _stresses(influence, form + (tip - form) * share)
    assert_close(drive.max(axis=0), np.asarray(tension), rtol=0.01, atol=0.0)
    assert_close(coast.min(axis=0), np.asarray(compression), rtol=0.01, atol=0.0)


def test_the_module_only_scales():
    gear = ELEMENTS["accessory pinion"][0]
    small, large = (_influence(*gear, module=module) for module in (1.5 * mm, 6.0 * mm))
    assert_close(large.terms, small.terms, rtol=1e-9, atol=1e-9)
    assert_close(
        large.decay(jnp.asarray(0.5)), 4.0 * small.decay(jnp.asarray(0.5)), rtol=1e-12, atol=0.0
    )


@pytest.mark.slow
@pytest.mark.parametrize(("gear", "stress"), quick(1, [(0, 422.0), (1, 424.0)]))
def test_highest_point_of_single_contact(settled, gear, stress):
    """275.3 N/mm on one tooth in plane strain, of finite elements with 21 teeth."""
    model, _, _, influences = settled
    pair, influence = model.pair, influences[gear]
    start, pitch = pair.path_start, pair.transverse_base_pitch
    length = start + pitch if gear == 0 else pair.tangent_length - pair.path_end + pitch
    roll = length / pair.base_radius[gear]
    found = _stresses(influence, [float(roll)])[0].max() * 275.3e3 / (1.5 * mm)
    assert found == pytest.approx(stress * MPa, rel=0.015)


@pytest.mark.slow
def test_even_load_on_the_narrower_gear_stays_even(settled):
    model, _, cycle, influences = settled
    lines = cycle.cells.lines
    load = jg.slice_load(cycle)
    stress = jg.root_stress(model.pair, influences, lines, load)
    wheel = np.asarray(stress.drive[..., 1])
    assert_close(wheel, np.broadcast_to(wheel[..., :1], wheel.shape), rtol=1e-9, atol=1.0)
    # The wider pinion's ends help.
    pinion = np.asarray(stress.drive[..., 0]).max(axis=(0, 1))
    assert np.all(pinion < pinion[[3]] * (1.0 + 1e-12))
    doubled = jg.root_stress(model.pair, influences, lines, 2.0 * load)
    assert_close(doubled.drive, 2.0 * stress.drive, rtol=1e-12, atol=1e-3)
    worst = jg.largest_root_stress(stress, lines)
    assert float(worst[1].stress) == pytest.approx(wheel.max(), rel=1e-12)
    assert 0.0 < float(worst[1].height) < 0.5 * 1.5 * mm


@pytest.mark.slow
def test_gradient_by_flanks_and_torque(settled):
    model, grid, _, influences = settled

    def stress(moved):
        torque, slope = moved
        flanks = jg.Flanks(jg.HelixSlope(slope))
        own = dataclasses.replace(model, torque=torque, flanks=flanks)
        cycle = jg.mesh_cycle(own, grid, law=jg.SmoothContact(1 * um), throw=False)
        found = jg.root_stress(own.pair, influences, cycle.cells.lines, jg.slice_load(cycle))
        return jg.smooth_root_stress(found, jnp.asarray(2.0 * MPa)) / MPa

    assert_gradient(stress, (jnp.asarray(80.0), jnp.asarray(10 * um)), rtol=1e-5)


@pytest.mark.slow
def test_gradient_by_the_shape_of_the_tooth():
    def stress(moved):
        influence = _shaped(*moved)
        roll = influence.form_roll + 0.7 * (influence.tip_roll - influence.form_roll)
        along = influence.terms[1, 0] @ influence.place_terms(roll)
        return jg.smooth_maximum(along, jnp.asarray(0.01))

    def _shaped(shift, angle, fillet):
        section = jg.ToothSection(
            jnp.asarray(45.0), jnp.asarray(1.5 * mm), angle, shift, jnp.asarray(1.2), fillet
        )
        return jg.root_influence(section, jnp.asarray(0.6), jnp.asarray(0.3))

    assert_gradient(jax.jit(stress), tuple(map(jnp.asarray, (0.3, 0.43, 0.25))), rtol=1e-5)


@pytest.mark.slow
def test_influences_close_by_are_exact_in_value_and_slope(settled):
    pair = settled[0].pair
    near, away = jg.nearby_influences(pair), 1e-4
    for value, solved in zip(near.at(pair), settled[3], strict=True):
        assert_close(value.terms, solved.terms, rtol=1e-9, atol=1e-9)
    moved = lambda x: eqx.tree_at(
        lambda p: (p.pinion.profile_shift, p.wheel.fillet_radius),
        pair,
        (pair.pinion.profile_shift + x, pair.wheel.fillet_radius - x),
    )
    slopes = jax.jacfwd(lambda x: [each.terms for each in near.at(moved(x))])(0.0)
    ends = [jg.root_influences(moved(x)) for x in (-away, away)]
    for slope, low, high in zip(slopes, *ends, strict=True):
        central = (high.terms - low.terms) / (2.0 * away)
        assert_close(slope, central, rtol=1e-5, atol=1e-5 * float(jnp.abs(central).max()))


@pytest.mark.slow
@pytest.mark.parametrize("slices", [1, 200])
def test_any_number_of_slices_carries_the_same(settled, slices):
    """Even load on the narrower gear."""
    model, _, _, influences = settled
    found = []
    for count in (8, slices):
        lines = contact_lines(model.pair, jg.mesh_grid(model.pair, phases=8, slices=count))
        load = jnp.full(lines.roll.shape, 1e5)
        stress = jg.root_stress(model.pair, influences, lines, load)
        found.append(float(stress.largest[1]))
    assert found[1] == pytest.approx(found[0], rel=1e-9)


# Published for the load at the tip, 20 degrees, 1.25 dedendum and 0.38 of fillet: Y_Fa, Y_Sa
# (GB/T 3480, as in textbooks of machine design).
@pytest.mark.parametrize(
    ("teeth", "form", "correction"),
    [(17, 2.97, 1.52), (20, 2.80, 1.55), (40, 2.40, 1.67), (150, 2.14, 1.83)],
)
def test_factors_of_the_standard_are_the_published_ones(teeth, form, correction):
    real = lambda value: jnp.asarray(float(value))
    numbers = (teeth, math.radians(20.0), 0.0, 1.25, 0.38, 0.5 * teeth + 1.0)
    section = jg.root_section(*map(real, numbers))
    assert float(section.form_factor) == pytest.approx(form, rel=0.007)
    assert float(section.stress_correction) == pytest.approx(correction, rel=0.005)


def test_nominal_stress_by_hand(settled):
    """F_t/(b m) times its factors; a spur gear on a thick rim has no others."""
    pair = settled[0].pair
    found = jg.nominal_root_stress(pair, jnp.asarray(2400.0))
    plain = 2400.0 / (9.5e-3 * 1.5e-3)
    assert_close(
        found.stress, plain * found.form_factor * found.stress_correction, rtol=1e-12, atol=0.0
    )
    assert float(found.helix_factor) == float(found.deep_tooth_factor) == 1.0
    assert_close(found.safety(2.0 * found.stress), 2.0 * jnp.ones(2), rtol=1e-12, atol=0.0)


def test_dataset_and_pictures_hold_the_same_stresses(settled):
    model, _, cycle, influences = settled
    roots = roots_dataset(model, cycle, influences).assign_attrs(title="a pair")
    stress = jg.root_stress(model.pair, influences, cycle.cells.lines, jg.slice_load(cycle))
    largest = np.asarray(stress.largest) / MPa
    along = roots["fillet_stress_MPa"].sel(fillet="drive").max("point").values
    assert_close(along, largest, rtol=1e-12, atol=0.0)
    assert all({"units", "long_name"} <= set(each.attrs) for each in roots.variables.values())
    shown = {each.name: each for each in run_pictures({"roots": roots})}
    assert set(shown) == {"root_stress", "root_outline"}
    told = shown["root_stress"].table["root_stress_MPa"].max()
    assert told == pytest.approx(largest.max(), rel=1e-12)
    titles = [axes.get_title(loc="left") for axes in shown["root_outline"].draw().axes]
    assert [float(title.split()[2]) for title in titles] == pytest.approx(largest, rel=1e-3)
    pressed = roots["fillet_stress_MPa"].sel(fillet="coast").min("point").values
    assert [float(title.split()[5]) for title in titles] == pytest.approx(pressed, rel=1e-3)
