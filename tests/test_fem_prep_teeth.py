"""Teeth of finite elements, condensed: their outline, their prism, and what is made of them."""

import dataclasses
import json
import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from helical_cases import ACROSS, FINE, GEAR, contact_line, even_load
from helpers import quick
from scipy.interpolate import CubicSpline

from fem_prep._assembly import Material
from fem_prep._checks import BodyError
from fem_prep._half_space import Strips, strip_compliance
from fem_prep._prism import FaceWaves, prism_stiffness, section_matrices
from fem_prep._tooth_compliance import ToothElements, _strips, condense_teeth
from fem_prep._tooth_file import read_teeth, write_teeth
from fem_prep._tooth_section import ToothSizing, tooth_section
from fem_prep._tooth_shape import ToothedGear
from jaxgear._geometry._profile import ToothSection

DATA = Path(__file__).parent / "data" / "calculix"
MODULE, STEEL = 1.5e-3, Material()
# The pinion of the accessory pair, narrow so that few waves do.
PINION = ToothedGear(
    teeth=45,
    module=MODULE,
    pressure_angle=math.radians(25.0),
    helix_angle=0.0,
    profile_shift=0.341,
    dedendum=1.1933,
    fillet_radius=0.25,
    tip_radius=35.67855e-3,
    bore=50e-3,
    face_width=3e-3,
)
HELICAL = dataclasses.replace(PINION, helix_angle=math.radians(20.0), tip_radius=37.8e-3)
COARSE = ToothSizing(flank=5, across=4, gap=4, ring=4, margin=1, waves=2)


@pytest.fixture(scope="module")
def spur() -> ToothElements:
    return condense_teeth(PINION, STEEL, 2, sizing=COARSE)


@pytest.fixture(scope="module")
def helical() -> ToothElements:
    return condense_teeth(HELICAL, STEEL, 2, sizing=COARSE)


def test_outline_of_a_spur_tooth_is_that_of_its_section():
    numbers = (45.0, MODULE, math.radians(25.0), 0.341, 1.1933, 0.25)
    other = ToothSection(*map(jnp.asarray, numbers))
    angle = np.linspace(math.radians(25.0), 0.5 * math.pi, 7)
    radius, half = PINION.fillet(angle)
    x, y = other.fillet(jnp.asarray(angle))
    np.testing.assert_allclose(radius * np.sin(half), x, rtol=1e-12)
    np.testing.assert_allclose(radius * np.cos(half), y, rtol=1e-12)
    roll = np.linspace(PINION.form_roll, PINION.tip_roll, 5)
    radius, half = PINION.involute(roll)
    x, _ = other.flank(jnp.asarray(roll / PINION.base_radius))
    np.testing.assert_allclose(radius * np.sin(half), x, rtol=1e-12)


def test_helical_fillet_ends_where_the_involute_begins_and_runs_on_in_it():
    """The envelope of a stretched rack is met in place and direction."""
    start = np.array([0.0, 1e-6])
    fillet = np.stack(HELICAL.fillet(HELICAL.pressure_angle + start))
    flank = np.stack(HELICAL.involute(HELICAL.form_roll * (1.0 + start)))
    np.testing.assert_allclose(fillet[:, 0], flank[:, 0], rtol=1e-12)
    slopes = [np.diff(curve[1]) / np.diff(curve[0]) for curve in (fillet, flank)]
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=1e-4)
    assert abs(HELICAL.fillet(np.array(0.5 * math.pi))[0] / HELICAL.root_radius - 1.0) < 1e-12


@pytest.mark.parametrize("twist", quick(1, [0.0, 20.0]))
def test_prism_moves_rigidly_and_strains_evenly(twist):
    """A prism that only moves bears no force; one that is stretched bears E times its area."""
    section = tooth_section(PINION, 1, COARSE)
    waves = FaceWaves(3e-3, 6)
    matrices = section_matrices(section.nodes, section.quads, STEEL, twist)
    count = len(section.nodes)
    stiffness = prism_stiffness(matrices, waves, np.arange(3 * count * waves.count))
    points, weights = np.polynomial.legendre.leggauss(8)
    z, weights = 1.5e-3 * points, 1.5e-3 * weights
    shapes = waves.at(z) * weights[:, None]
    # Places in space, of axes that turn with the section.
    turned = np.exp(1j * twist * z) * (section.nodes @ [1.0, 1.0j])[:, None]
    x, y, height = np.real(turned), np.imag(turned), np.broadcast_to(z, turned.shape)
    none, one = np.zeros_like(x), np.ones_like(x)

    def motion(across: np.ndarray, along: np.ndarray) -> np.ndarray:
        across = across * np.exp(-1j * twist * z)
        parts = np.stack([np.real(across), np.imag(across), along], axis=1)
        return (parts @ shapes).ravel()

    largest = np.abs(stiffness.data).max()
    rigid = [motion(one + 0j, none), motion(none + 0j, one), motion(1j * turned, none)]
    rigid += [motion(-1j * height, y), motion(height + 0j, -x)]
    for each in rigid:
        # The turning axes are met by polynomials up to some digits only.
        free = np.abs(stiffness @ each).max() / (largest * np.abs(each).max())
        assert free < (1e-14 if twist == 0.0 else 1e-8)
    stretched = motion(-STEEL.poisson * turned, height)
    area = stretched @ (stiffness @ stretched) / (STEEL.young * 3e-3)
    corners = section.nodes[section.quads[:, [0, 3, 6, 7, 8, 5, 2, 1]]]
    sides = np.roll(corners, -1, axis=1)
    crossed = corners[..., 0] * sides[..., 1] - corners[..., 1] * sides[..., 0]
    # Between the nodes of curved edges a little is missing.
    straight = 0.5 * np.abs(crossed.sum(axis=1)).sum()
    assert abs(area / straight - 1.0) < 5e-3


def test_half_space_between_strips_is_boussinesqs():
    """Far apart as points, and over a long strip as the logarithm of plane strain."""
    waves = FaceWaves(20e-3, 2)
    ends = np.array([0.0, 0.1e-3, 0.2e-3, 0.4e-3])
    strips = Strips(ends, np.zeros(3), np.ones(3))
    even = strip_compliance(strips, waves, STEEL)[:, 0, :, 0]
    np.testing.assert_allclose(even, even.T, rtol=1e-12)
    # What two strips of one width give more by their own loads than by each other's.
    closer = even[0, 0] - even[0, 1]
    plane = 2.0 * (1.0 - STEEL.poisson**2) / (math.pi * STEEL.young)
    assert abs(closer / (plane * 2.0 * math.log(2.0)) - 1.0) < 1e-3


def _symmetric(teeth: ToothElements) -> np.ndarray:
    own = teeth.compliance[0]
    return own.reshape(own.shape[0] * own.shape[1], -1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", quick(1, ["spur", "helical"]))
def test_teeth_obey_reciprocity_and_are_positive(kind, request):
    """Loads on one tooth move the next as the other way round, and no load does negative work."""
    teeth = request.getfixturevalue(kind)
    gear = {"spur": PINION, "helical": HELICAL}[kind]
    assert teeth.facts["asymmetry"] < 1e-9
    section = tooth_section(gear, 2, COARSE)
    waves = FaceWaves(gear.face_width, teeth.compliance.shape[2])
    middle = np.sqrt(0.5 * (section.roll[1:] ** 2 + section.roll[:-1] ** 2))
    radius = np.hypot(gear.base_radius, middle)
    strips = Strips(
        section.roll**2 / (2.0 * gear.base_radius),
        gear.twist * middle,
        np.hypot(1.0, gear.twist * radius),
    )
    share = strip_compliance(strips, waves, STEEL).reshape(_symmetric(teeth).shape)
    whole = _symmetric(teeth) + share
    assert np.linalg.eigvalsh(whole).min() > 0.0
    # The next tooth feels less than the loaded one, and mostly even loads.
    assert 0.0 < teeth.compliance[1][2, 0, 2, 0] < 0.7 * whole[2 * waves.count, 2 * waves.count]


@pytest.mark.slow
def test_teeth_beyond_those_in_mesh_hardly_matter(spur):
    finer = condense_teeth(PINION, STEEL, 2, sizing=dataclasses.replace(COARSE, margin=2))
    even = [teeth.compliance[1][:, 0, :, 0] for teeth in (spur, finer)]
    np.testing.assert_allclose(even[0], even[1], rtol=0.02)


@pytest.mark.slow
def test_helical_teeth_become_spur_ones(spur):
    slight = dataclasses.replace(PINION, helix_angle=1e-7)
    other = condense_teeth(slight, STEEL, 2, sizing=COARSE)
    scale = np.abs(spur.compliance).max()
    np.testing.assert_allclose(other.compliance, spur.compliance, atol=1e-5 * scale)
    np.testing.assert_allclose(
        other.root_stress, spur.root_stress, atol=1e-5 * np.abs(spur.root_stress).max()
    )


def test_root_is_pulled_on_the_loaded_side_and_pressed_on_the_other(spur):
    """Of an even load near the tip, by about as much as a cantilever of the tooth's root."""
    even = spur.root_stress[0, :, :, 0, -2, 0]
    # Stress per line load, over one of plane bending: 6 h / s^2.
    height, chord = 2.9e-3, 3.3e-3
    bending = 6.0 * height * math.cos(math.radians(30.0)) / chord**2
    assert 0.7 < even[0].max() / bending < 1.6
    assert -2.0 < even[1].min() / bending < -0.9


def test_file_of_teeth_is_read_as_it_was_written(spur, tmp_path):
    write_teeth(tmp_path / "teeth.npz", spur)
    again = read_teeth(tmp_path / "teeth.npz")
    assert again.face_width == spur.face_width
    assert again.facts["waves"] == spur.facts["waves"]
    for name in ("roll", "compliance", "root_places", "root_stress"):
        np.testing.assert_array_equal(getattr(again, name), getattr(spur, name))


def test_gears_without_a_ring_are_refused():
    with pytest.raises(BodyError, match=r"none\. Give it a bore"):
        dataclasses.replace(PINION, bore=0.0)
    with pytest.raises(BodyError, match=r"at least 1\.0 modules thick, 1\.5 mm, got 0\.9"):
        dataclasses.replace(PINION, bore=63e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["even", "line"])
def test_calculix_finds_helical_teeth_the_same(name, judged_by_calculix):
    """A run on 9,560 C3D20 that is kept; `benchmarks/judge_helical.py` makes it."""
    found, half_space = judged_by_calculix
    kept = json.loads((DATA / "helical_teeth.json").read_text())
    given = {"even": even_load, "line": contact_line}[name]()
    waves = FaceWaves(GEAR.face_width, found.compliance.shape[2])
    load = np.zeros((FINE.flank, waves.count))
    load[:, : given.shape[1]] = given
    whole = found.compliance.copy()
    whole[0] += half_space
    moved = np.einsum("timjn,jn,zm->tiz", whole, load, waves.at(ACROSS))
    wanted = 1e-6 * np.asarray(kept[name]["flank_um"])
    assert np.max(np.abs(moved[0] / wanted[0] - 1.0)) < 0.01
    assert np.max(np.abs(moved[1] - wanted[1])) < 0.002 * wanted[1].max()
    stress = np.einsum("spmjn,jn,m->sp", found.root_stress[0], load, waves.at(np.zeros(1))[0])
    extremes = np.array([stress[0].max(), stress[1].min()])
    assert np.max(np.abs(1e-6 * extremes / kept[name]["root_MPa"] - 1.0)) < 0.01


@pytest.fixture(scope="module")
def judged_by_calculix() -> tuple[ToothElements, np.ndarray]:
    """Teeth, and what was taken off of them."""
    found = condense_teeth(GEAR, STEEL, 2, sizing=FINE)
    waves = FaceWaves(GEAR.face_width, found.compliance.shape[2])
    return found, strip_compliance(_strips(GEAR, tooth_section(GEAR, 2, FINE)), waves, STEEL)


@pytest.mark.slow
def test_compliance_converges_with_the_size_of_elements():
    """With the half-space put back, errors fall at least with the square of the size."""

    def at_mid_height(sizing: ToothSizing) -> np.ndarray:
        teeth = condense_teeth(PINION, STEEL, 1, sizing=sizing)
        places = 0.5 * (teeth.roll[1:] ** 2 + teeth.roll[:-1] ** 2)
        spline = CubicSpline(places, np.eye(len(places)))
        roll = np.linspace(0.4, 0.8, 3) * (PINION.tip_roll - PINION.form_roll) + PINION.form_roll
        return np.array(
            [spline(r**2) @ teeth.compliance[0][:, 0, :, 0] @ spline(r**2) for r in roll]
        )

    sizes = [
        ToothSizing(flank=4 * n, across=4 * n, gap=4 * n, ring=4 * n, margin=1, waves=4)
        for n in (1, 2, 4)
    ]
    found = [at_mid_height(sizing) for sizing in sizes]
    first, second = (np.abs(found[n] - found[2]).max() for n in (0, 1))
    assert second < 0.3 * first
