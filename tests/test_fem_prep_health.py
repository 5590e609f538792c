"""The health report against direct solutions, closed forms and hand values; what it warns of."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.sparse import csr_array, vstack
from scipy.sparse.linalg import spsolve

from fem_prep._answers import (
    Solid,
    conditioning,
    counts,
    described_modes,
    mass_properties,
    rigid_energies,
    rim_report,
    solid_of,
)
from fem_prep._artefact import ReducedBody, rigid_motions
from fem_prep._assembly import Material, surface_mass, volume
from fem_prep._boundary import Teeth, full_body
from fem_prep._checks import BodyError
from fem_prep._compared import free_error, seat_coupling_difference
from fem_prep._condense import condense
from fem_prep._health import health_report
from fem_prep._hold import fixed_interface
from fem_prep._modes import free_modes, lowest_modes, scale_of
from fem_prep._seats import Seat, dofs_of
from fem_prep._static_answers import (
    Springs,
    growth,
    growth_report,
    tooth_deflection,
    tooth_report,
    tooth_row,
)
from fem_prep._verdicts import verdicts
from fem_prep._web import GearBody, MeshSizing, Web, body_grid, exact_properties

MM = 1e-3
STEEL = Material()
SPRINGS = Springs()
# Its web sits off the middle, so that both edges of the rim grow by different amounts.
WHEEL = GearBody(60 * MM, 8 * MM, 20 * MM, Web(30 * MM, 3 * MM, 50 * MM, offset=1 * MM))
COARSE = MeshSizing(12, rim_axial=2, rim_radial=1, web_radial=2, hub_radial=1)


def wheel(averaging=False, teeth=None, material=STEEL):
    grid = body_grid(WHEEL, COARSE)
    seat = Seat("bore", grid.sets["seat:bore"], np.zeros(3), averaging)
    return full_body("wheel", grid, material, [seat], teeth=teeth)


@cache
def condensed(averaging=False):
    """The wheel, condensed, and its report, which is not asked for free modes of the full one."""
    full = wheel(averaging)
    reduced = condense(full, modes=20)
    return full, reduced, health_report(full, None, reduced, free_frequency=[1.0])


both = pytest.mark.parametrize("averaging", [False, True], ids=["rigid", "averaging"])


@pytest.fixture
def wheel20():
    return condensed()[:2]


@pytest.fixture(scope="module")
def reported():
    full, reduced, _ = condensed()
    solid = solid_of(exact_properties(WHEEL), STEEL.density)
    return health_report(full, None, reduced, exact=solid, root_thickness=9 * MM, couplings=True)


def pointed(seed=0):
    """Masses at points that springs do not join."""
    rng = np.random.default_rng(seed)
    masses, points = rng.uniform(0.1, 1.0, 7), rng.standard_normal((7, 3))
    body = ReducedBody(
        name="points",
        stiffness=np.zeros((21, 21)),
        mass=np.diag(np.repeat(masses, 3)),
        centrifugal_load=np.zeros(21),
        rim_nodes=points,
        rim_faces=np.zeros((0, 8), dtype=int),
        seats=(),
        seat_points=np.zeros((0, 3)),
        interior=0,
    )
    return body, masses, points


def on_springs(full, rows, stiffness):
    """Stiffness of a full body with springs between its boundary and the ground, put in as is."""
    added = rows.T @ csr_array(stiffness[:, None] * rows.toarray())
    return csr_array(full.stiffness + added)


def rows_of(full, reduced, *, mesh):
    """Springs of the one seat, and that of the mesh, on the unknowns."""
    size = 3 * full.points
    seat = full.averages if full.seats[0].averaging else csr_array(np.eye(6, size, k=size - 6))
    stiffness = np.array([1e8, 1e8, 1e8, 1e4, 1e4, 1e3])
    if not mesh:
        return csr_array(seat), stiffness
    rim = reduced.rim_nodes.size
    row = np.zeros((1, size))
    row[0, dofs_of(full.rim_points)] = tooth_row(reduced, SPRINGS.line_of_action)[:rim]
    return csr_array(vstack([seat, csr_array(row)])), np.append(stiffness, 2e8)


# --- Mass


def test_mass_centre_and_inertias_of_point_masses():
    body, masses, points = pointed()
    found = mass_properties(None, body, None)
    centre = masses @ points / masses.sum()
    square = masses @ points**2
    assert found["mass_kg"] == pytest.approx(masses.sum())
    np.testing.assert_allclose(found["centre_of_mass_mm"], 1e3 * centre, rtol=1e-12)
    assert found["polar_inertia_kg_m2"] == pytest.approx(square[0] + square[1])
    across = (square[0] + square[1]) / 2 + square[2]
    assert found["transverse_inertia_about_mid_face_kg_m2"] == pytest.approx(across)
    unbalance = 1e6 * np.hypot(*(masses @ points)[:2])
    assert found["unbalance_g_mm"] == pytest.approx(unbalance)


def test_a_deviation_is_that_from_what_is_given():
    body, masses, points = pointed()
    centre = masses @ points / masses.sum()
    inertia = np.einsum("i,ij,ik->jk", masses, points, points)
    inertia = np.trace(inertia) * np.eye(3) - inertia
    other = np.diag([inertia[0, 0] * 1.25, inertia[1, 1] * 1.25, inertia[2, 2] * 2])
    solid = Solid(masses.sum() / 1.1, centre + np.array([0, 0, 2 * MM]), other)
    found = mass_properties(None, body, solid)
    assert found["mass_deviation"] == pytest.approx(0.1)
    assert found["polar_inertia_deviation"] == pytest.approx(-0.5)
    assert found["transverse_inertia_deviation"] == pytest.approx(-0.2)
    assert found["centre_of_mass_deviation_mm"] == pytest.approx(2.0)


@pytest.mark.slow
def test_the_wheel_weighs_what_its_grid_and_its_solid_do(wheel20, reported):
    full, _ = wheel20
    exact = exact_properties(WHEEL)
    assert reported["mass_kg"] == pytest.approx(STEEL.density * volume(full.grid), rel=1e-12)
    # Arcs of 30 degrees as parabolas lose some of the volume, so the numbers are no rounding.
    assert 1e-5 < -reported["mass_deviation"] < 1e-3
    off = reported["mass_kg"] / (STEEL.density * exact.volume) - 1
    assert reported["mass_deviation"] == pytest.approx(off, rel=1e-6)
    assert reported["centre_of_mass_deviation_mm"] < 1e-4
    assert reported["condensed_mass_deviation"] < 1e-12


def test_lumped_teeth_count_but_not_against_the_solid(reported):
    teeth = Teeth(mass=0.02, polar_inertia=2e-5)
    full = wheel(teeth=teeth)
    solid = solid_of(exact_properties(WHEEL), STEEL.density)
    reduced = condense(full, method="guyan")
    assert counts(full, reduced)["modes"] == 0
    found = mass_properties(full, reduced, solid)
    more = found["polar_inertia_kg_m2"] - reported["polar_inertia_kg_m2"]
    assert more == pytest.approx(teeth.polar_inertia, rel=1e-9)
    # The skin is that of a cylinder, whose mass is all on its radius.
    skin = found["lumped_teeth_mass_kg"]
    assert found["teeth_mass_kg"] == teeth.mass
    assert skin == pytest.approx(teeth.polar_inertia / (30 * MM) ** 2, rel=1e-3)
    assert found["mass_kg"] - reported["mass_kg"] == pytest.approx(skin, rel=1e-9)
    for key in ("mass_deviation", "polar_inertia_deviation", "transverse_inertia_deviation"):
        assert found[key] == pytest.approx(reported[key], rel=1e-6)


def test_another_density_is_told():
    full = wheel(material=Material(density=2700.0))
    solid = solid_of(exact_properties(WHEEL), STEEL.density)
    found = mass_properties(full, condense(full, method="guyan"), solid)
    (said,) = verdicts(found)
    assert "66% below" in said
    assert "density" in said
    wrong = mass_properties(full, condense(full, method="guyan"), replace(solid, mass=1e-3 * 0.1))
    assert "units" in verdicts(wrong)[0]


# --- Rigid motions


def test_rigid_motions_store_nothing(reported):
    for key in ("rigid_body_energy_relative", "full_rigid_body_energy_relative"):
        assert max(reported[key]) < 1e-14
    assert reported["rigid_body_residual"] < 1e-12
    assert reported["full_rigid_body_residual"] < 1e-12
    assert reported["rigid_body_modes"] == 6


def test_a_spring_to_the_ground_is_told_by_its_energy(wheel20):
    _, reduced = wheel20
    stiffness = reduced.stiffness.copy()
    stiffness[1, 1] += 2e6
    found = rigid_energies(None, replace(reduced, stiffness=stiffness))
    energy = found["rigid_body_energy_J"]
    x = reduced.rim_nodes[0, 0]
    assert energy[1] == pytest.approx(1e6, rel=1e-6)
    assert energy[5] == pytest.approx(1e6 * x**2, rel=1e-6)
    alone = np.diag(stiffness) @ reduced.rigid_motions[:, 1] ** 2 / 2
    assert found["rigid_body_energy_relative"][1] == pytest.approx(1e6 / alone, rel=1e-6)
    assert any("holds the body" in said for said in verdicts(found))


# --- Free modes


def test_free_modes_are_those_of_the_full_body(wheel20, reported):
    full, _ = wheel20
    square, _ = free_modes(full, 20)
    np.testing.assert_allclose(
        reported["free_frequency_Hz"], np.sqrt(square) / (2 * np.pi), rtol=1e-9
    )
    assert reported["largest_free_frequency_error"] < 1e-9
    assert reported["nodal_diameter"][:2] == [2, 2]
    assert min(reported["nodal_diameter_share"][:6]) > 0.99
    told = sorted(f for family in reported["families"] for f in family["frequency_Hz"])
    assert told == sorted(reported["free_frequency_Hz"])
    # An axisymmetric body: no pair splits.
    assert len(reported["pairs"]) >= 6
    assert all(abs(pair["split"]) < 1e-9 for pair in reported["pairs"])


def test_the_rim_alone_shows_the_nodal_diameters(wheel20):
    full, reduced = wheel20
    whole = described_modes(reduced, fixed_interface(full), count=6)
    rim = described_modes(reduced, count=6)
    np.testing.assert_array_equal(rim.pattern.diameter, whole.pattern.diameter)
    np.testing.assert_allclose(rim.frequency, whole.frequency, rtol=1e-12)
    # The shapes are of unit modal mass: on the grid this is the energy.
    mass = full.grid_mass
    shape = whole.shapes[0].ravel()
    assert shape @ (mass @ shape) == pytest.approx(1.0, rel=1e-9)


def test_frequencies_already_known_are_not_sought(wheel20, reported):
    full, reduced = wheel20
    known = np.array(reported["free_frequency_Hz"][:12])
    modes = described_modes(reduced, count=20)
    given = free_error(full, modes, 1.01 * known)
    np.testing.assert_allclose(given["free_frequency_error"], 1 / 1.01 - 1, rtol=1e-6)
    assert "of the free body" in verdicts(given)[0]
    # What condensation knew already is among the facts.
    facts = {**reduced.facts, "free_frequency_Hz": known.tolist()}
    found = health_report(full, None, replace(reduced, facts=facts), modes=modes)
    assert len(found["free_frequency_error"]) == 12
    assert found["warnings"] == []


# --- On springs


@pytest.mark.slow
@both
def test_frequencies_on_springs_are_those_of_the_full_matrices(averaging):
    full, reduced, found = condensed(averaging)
    rows, stiffness = rows_of(full, reduced, mesh=True)
    square, _ = lowest_modes(on_springs(full, rows, stiffness), full.mass, 10, 0.1 * scale_of(full))
    wanted = np.sqrt(square) / (2 * np.pi)
    told = np.array(found["sprung_frequency_Hz"])
    error = np.array(found["sprung_frequency_error"])
    np.testing.assert_allclose(told / (1 + error), wanted, rtol=1e-8)
    np.testing.assert_allclose(told, wanted, rtol=1e-4)
    assert 1e-9 < found["largest_sprung_frequency_error"] < 1e-4


@both
def test_a_tooth_load_bends_as_the_full_matrices_say(averaging):
    full, reduced, report = condensed(averaging)
    rows, stiffness = rows_of(full, reduced, mesh=False)
    rim, row = reduced.rim_nodes.size, tooth_row(reduced, SPRINGS.line_of_action)
    torque = row[:rim] @ rigid_motions(reduced.rim_nodes)[:, 5]
    load = np.zeros(3 * full.points)
    load[dofs_of(full.rim_points)] = row[:rim]
    load -= torque * rows.toarray()[5]
    motion = np.asarray(spsolve(on_springs(full, rows, stiffness), load))
    found = tooth_deflection(reduced, row, SPRINGS)
    assert found is not None
    wanted = motion[dofs_of(full.rim_points)]
    np.testing.assert_allclose(found[:rim], wanted, atol=1e-8 * np.abs(wanted).max())

    assert report["tooth_deflection_error"] < 1e-8
    assert report["tooth_deflection_um_N"] == pytest.approx(1e6 * load @ motion, rel=1e-8)
    strain = motion @ (full.stiffness @ motion)
    assert report["tooth_deflection_of_body_um_N"] == pytest.approx(1e6 * strain, rel=1e-7)


def test_a_tooth_load_does_not_depend_on_the_order_of_the_seats():
    grid = body_grid(WHEEL, COARSE)
    nodes = np.asarray(grid.sets["seat:bore"])
    z = grid.nodes[nodes, 2]
    # Springs hold both edges of the bore against turning; the torque leaves at the right one.
    edges = [
        Seat(name, nodes[np.abs(z - at) < 1e-9], np.array([0.0, 0.0, at]))
        for name, at in (("left", z.min()), ("right", z.max()))
    ]
    told = {}
    for seats in (edges, edges[::-1]):
        reduced = condense(full_body("wheel", grid, STEEL, seats), method="guyan")
        row = tooth_row(reduced, SPRINGS.line_of_action)
        for seat in ("right", None):
            bent = tooth_deflection(reduced, row, SPRINGS, seat)
            assert bent is not None
            told[seats[0].name, seat] = tooth_report(reduced, bent, row, SPRINGS, seat)
        with pytest.raises(BodyError, match="got 'middle'; its seats are"):
            tooth_deflection(reduced, row, SPRINGS, "middle")
    assert told["left", "right"] == pytest.approx(told["right", "right"], rel=1e-7)
    assert told["right", None] == told["right", "right"]
    one, other = (told["left", seat]["tooth_deflection_um_N"] for seat in ("right", None))
    assert one != pytest.approx(other, rel=1e-3)


def test_a_truncated_body_is_told(wheel20):
    full, _ = wheel20
    reduced = condense(full, modes=2)
    found = health_report(full, None, reduced)
    assert found["modes"] == 2
    assert found["largest_sprung_frequency_error"] > 1e-3
    (said,) = found["warnings"]
    assert "Keep more modes." in said
    # Statics do not depend on modes.
    assert found["tooth_deflection_error"] < 1e-8
    assert found["centrifugal_growth_error"] < 1e-8


def test_springs_must_hold():
    with pytest.raises(BodyError, match="must be positive"):
        Springs(turn=0.0)


# --- Tooth and rim


def test_a_tooth_load_is_spread_over_the_elements_under_it(wheel20):
    _, reduced = wheel20
    turn = reduced.rigid_motions[: reduced.boundary_dofs, 5]
    radius, half = 30 * MM, np.pi / 12
    for width, elements in ((None, 1), (20 * MM, 1), (34 * MM, 3)):
        row = tooth_row(reduced, np.array([0.0, 1.0, 0.0]), width)
        assert row.reshape(-1, 3).sum(axis=0) == pytest.approx([0, 1, 0], abs=1e-12)
        # The mean of x over an even pressure on an arc.
        mean = radius * np.sin(elements * half) / (elements * half)
        assert row @ turn == pytest.approx(mean, rel=1e-3)
        # As much left as right of the middle.
        tilt = reduced.rigid_motions[: reduced.boundary_dofs, 3]
        assert row @ tilt == pytest.approx(0.0, abs=1e-12)


def test_size_of_the_rims_elements(wheel20):
    _, reduced = wheel20
    found = rim_report(reduced, 9 * MM)
    assert found["rim_element_arc_mm"] == pytest.approx(60 * np.pi / 12, rel=1e-9)
    z = np.unique(np.round(reduced.rim_nodes[:, 2], 9))[::2]
    assert found["rim_element_axial_mm"] == pytest.approx(1e3 * np.diff(z).max())
    assert not verdicts(found)
    (said,) = verdicts(rim_report(reduced, 7 * MM))
    assert "at least one element per tooth" in said


def test_the_line_of_action_pushes_the_tooth_around_and_inward():
    found = Springs(pressure_angle=np.radians(30.0)).line_of_action
    np.testing.assert_allclose(found, [-0.5, np.sqrt(0.75), 0.0])


# --- Centrifugal growth


def test_growth_is_the_mean_by_area(wheel20):
    _, reduced = wheel20
    x, y, z = reduced.rim_nodes.T
    # Nodes lie closer where the web is, so that their plain mean is another.
    assert abs(np.mean(z)) > 0.05 * MM
    grown = ((1 + z / (4 * MM)) / np.hypot(x, y))[:, None] * np.stack([x, y, 0 * z], axis=1)
    found = growth_report(reduced, grown.ravel(), (1.0,))
    at = [found[f"centrifugal_growth{place}_um_at_rad_s"]["1"] for place in ("", "_left", "_right")]
    np.testing.assert_allclose(at, [1e6, 0.0, 2e6], rtol=1e-9, atol=1e-3)


def test_an_annulus_grows_as_in_closed_form():
    r"""Rotating annulus in plane stress, radii 30 and 80 mm: 5.56976 um outside at 1000 rad/s."""
    body = GearBody(160 * MM, 1 * MM, 60 * MM)
    grid = body_grid(body, MeshSizing(16, rim_axial=1, web_radial=5))
    material = Material(2.1e11, 0.3, 7850.0)
    seat = Seat("bore", grid.sets["seat:bore"], np.zeros(3), averaging=True)
    reduced = condense(full_body("annulus", grid, material, [seat]), method="guyan")
    found = growth_report(reduced, growth(reduced), (1000.0, 2000.0))
    for place in ("", "_left", "_right"):
        at = found[f"centrifugal_growth{place}_um_at_rad_s"]
        assert at["1000"] == pytest.approx(5.56976, rel=3e-4)
        assert at["2000"] == pytest.approx(4 * at["1000"])


def test_edges_of_the_rim_grow_as_the_full_matrices_say(wheel20, reported):
    full, reduced = wheel20
    # Springs at one seat carry no balanced load, so they do not matter.
    rows, stiffness = rows_of(full, reduced, mesh=False)
    motion = np.asarray(spsolve(on_springs(full, rows, stiffness), full.centrifugal_load))
    x, y, z = reduced.rim_nodes.T
    moved = motion[dofs_of(full.rim_points)].reshape(-1, 3)
    radial = 1e6 * 1500.0**2 * (x * moved[:, 0] + y * moved[:, 1]) / np.hypot(x, y)
    left, right = (np.isclose(z, end) for end in (z.min(), z.max()))
    for name, edge in (("_left", left), ("_right", right)):
        told = reported[f"centrifugal_growth{name}_um_at_rad_s"]["1500"]
        assert told == pytest.approx(radial[edge].mean(), rel=1e-7)
    assert abs(radial[left].mean() / radial[right].mean() - 1) > 0.01
    assert reported["centrifugal_growth_error"] < 1e-8


def test_growth_is_about_the_bodys_own_centre(wheel20):
    """What accelerates the body as a whole does not strain it."""
    _, reduced = wheel20
    pushed = reduced.mass @ reduced.rigid_motions @ np.arange(1.0, 7.0) * 1e-3
    moved = replace(reduced, centrifugal_load=reduced.centrifugal_load + pushed)
    size = np.abs(growth(reduced)).max()
    np.testing.assert_allclose(growth(moved), growth(reduced), atol=1e-8 * size)


# --- Numbers of the matrices


def test_largest_frequency_and_condition(wheel20):
    _, reduced = wheel20
    found = conditioning(reduced)
    lower = np.linalg.inv(np.linalg.cholesky(reduced.mass))
    square = np.linalg.eigvalsh(lower @ reduced.stiffness @ lower.T)[-1]
    assert found["largest_frequency_Hz"] == pytest.approx(np.sqrt(square) / (2 * np.pi), rel=1e-3)
    scale = 1 / np.sqrt(np.diag(reduced.mass))
    condition = np.linalg.cond(reduced.mass * np.outer(scale, scale), 1)
    assert condition / 3 < found["mass_condition"] <= 1.001 * condition


def test_a_mass_that_is_not_definite_is_told(wheel20):
    _, reduced = wheel20
    mass = reduced.mass.copy()
    mass[0, 0] *= -1
    found = conditioning(replace(reduced, mass=mass))
    assert found == {"mass_definite": False}
    assert "not positive definite" in verdicts(found)[0]


# --- Coupling of seats


def test_rigid_seats_are_stiffer_and_the_difference_is_told(wheel20, reported):
    (seat,) = reported["seat_coupling"]
    assert (seat["name"], seat["coupling"]) == ("bore", "rigid")
    assert min(seat["difference"].values()) > 0.01
    assert reported["largest_coupling_frequency_difference"] > 0.02
    assert max(reported["coupling_frequency_difference"]) < 1e-6
    assert any("averaging" in said for said in reported["warnings"])
    # The other way round.
    _, reduced = wheel20
    soft = wheel(averaging=True)
    found = seat_coupling_difference(soft, reduced)
    (other,) = found["seat_coupling"]
    assert other["coupling"] == "averaging"
    for one, two in (("flexibility", "other_flexibility"), ("other_flexibility", "flexibility")):
        for name, value in other[one].items():
            assert value == pytest.approx(seat[two][name], rel=1e-7)


def test_flexibility_of_a_seat_is_against_the_mean_motion_of_the_rim(wheel20, reported):
    _, reduced = wheel20
    rim = reduced.rim_nodes.size
    rigid = rigid_motions(reduced.rim_nodes)
    held = np.zeros((6, reduced.dofs))
    held[:, :rim] = rigid.T @ surface_mass(reduced.rim_nodes, reduced.rim_faces)
    held *= np.abs(reduced.stiffness).max() / np.abs(held).max()
    bordered = np.block([[reduced.stiffness, held.T], [held, np.zeros((6, 6))]])
    load = np.zeros((len(bordered), 6))
    load[rim : rim + 6] = np.eye(6)
    given = 1e6 * np.diag(np.linalg.solve(bordered, load)[rim : rim + 6])
    wanted = [given[:2].mean(), given[2], given[3:5].mean(), given[5]]
    told = list(reported["seat_coupling"][0]["flexibility"].values())
    np.testing.assert_allclose(told, wanted, rtol=1e-7)


# --- The report as a whole


def test_the_report_is_plain_and_keeps_the_names_that_users_read(reported):
    again = json.loads(json.dumps(reported, allow_nan=False))
    assert again == reported
    names = "nodes elements dofs rim_nodes boundary_dofs modes mass_kg polar_inertia_kg_m2 "
    names += "rigid_body_modes free_frequency_Hz nodal_diameter nodal_circle "
    names += "centrifugal_growth_um_at_rad_s"
    assert set(names.split()) <= set(reported)
    assert set(reported["centrifugal_growth_um_at_rad_s"]) == {"500", "1000", "1500"}


def test_without_the_full_body_nothing_is_compared(wheel20, reported):
    _, reduced = wheel20
    found = health_report(None, None, reduced)
    assert not [name for name in found if name.endswith("error")]
    assert found["warnings"] == []
    for name in ("mass_kg", "tooth_deflection_um_N", "polar_inertia_kg_m2"):
        assert found[name] == pytest.approx(reported[name], rel=1e-9)


def test_a_body_for_statics_alone_is_not_judged(wheel20):
    _, reduced = wheel20
    with pytest.raises(BodyError, match="must have a mass"):
        health_report(None, None, replace(reduced, mass=0 * reduced.mass))


def test_a_body_without_seats_floats():
    grid = body_grid(WHEEL, COARSE)
    full = full_body("ring", grid, STEEL, [])
    found = health_report(full, None, condense(full, modes=10))
    assert found["centrifugal_growth_error"] < 1e-8
    assert "sprung_frequency_error" not in found
    assert found["warnings"] == []


@pytest.mark.parametrize(
    ("report", "words"),
    [
        ({"mass_deviation": 2e-3}, "mass is 0.2% above"),
        ({"polar_inertia_deviation": -2e-3}, "polar inertia is 0.2% below"),
        ({"mass_deviation": 1e9}, "The units are wrong"),
        ({"mass_deviation": -0.999}, "The units are wrong"),
        ({"condensed_mass_deviation": 1e-6}, "Condense it again"),
        (
            {"lumped_teeth_mass_kg": 0.072, "teeth_mass_kg": 0.06, "mass_kg": 1.0},
            "the body 1.2% too heavy",
        ),
        ({"rigid_body_modes": 7}, "has 7 rigid-body modes"),
        ({"rigid_body_energy_relative": [0.0, 1e-6]}, "store energy"),
        ({"full_rigid_body_energy_relative": [1e-6]}, "store energy"),
        ({"largest_sprung_frequency_error": 2e-3, "method": "guyan"}, "take Herting's"),
        ({"largest_sprung_frequency_error": 2e-3, "method": "herting"}, "Keep more modes."),
        ({"largest_free_frequency_error": 2e-3}, "of the free body"),
        ({"tooth_deflection_error": 1e-5}, "under a tooth load"),
        ({"centrifugal_growth_error": 1e-5}, "centrifugal growth"),
        ({"largest_coupling_frequency_difference": 0.1}, "change by up to 10%"),
        ({"smallest_jacobian_ratio": 0.01, "worst_brick_mm": [1.0, 2.0, 3.0]}, "1.000, 2.000"),
        ({"largest_aspect_ratio": 80.0}, "80 times as long"),
        ({"rim_elements_across": 1.0}, "has 1 element across"),
        ({"rim_element_arc_mm": 10.0, "root_thickness_mm": 3.0}, "3.3 times the thickness"),
    ],
)
def test_every_fault_has_its_sentence(report, words):
    (said,) = verdicts(report)
    assert words in said


def test_a_healthy_body_gives_no_warning():
    assert verdicts({}) == []
    fine = {
        "mass_deviation": 5e-4,
        "mass_kg": 1.0,
        "teeth_mass_kg": 0.06,
        "lumped_teeth_mass_kg": 0.069,
        "rigid_body_modes": 6,
        "rigid_body_energy_relative": [1e-12],
        "largest_sprung_frequency_error": 5e-4,
        "tooth_deflection_error": 1e-9,
        "smallest_jacobian_ratio": 0.3,
        "largest_aspect_ratio": 10.0,
        "rim_elements_across": 1.6,
        "rim_element_arc_mm": 5.0,
        "root_thickness_mm": 3.0,
    }
    assert verdicts(fine) == []
