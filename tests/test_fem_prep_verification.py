"""Plates, rings, rotors, shafts and wheels against closed forms.

Thin plates are the hardest for full integration: the closed forms need elements that are not much
longer than a plate is thick. By one half wave of the shape, cut out by symmetry, they are had fast.
"""

from dataclasses import replace

import numpy as np
import pytest
from fem_cases import (
    ACCESSORY,
    ACCESSORY_WEB,
    CORK,
    STEEL,
    accessory_wheel,
    answer,
    assert_near,
    bore_seat,
    boundary_rows,
    dofs,
    frequencies,
    lattice,
    modes_without,
    on_springs,
    padded,
    pulls_on,
    ring,
    rotating_terms,
    small_wheel,
    springs_on,
    sprung_modes,
    tooth_load,
    web_probe,
    wheel_body,
)
from helpers import quick
from scipy.optimize import brentq
from scipy.sparse import block_diag, csr_array
from scipy.special import iv, jv

from fem_prep._artefact import inertia_relief
from fem_prep._assembly import assemble
from fem_prep._boundary import full_body
from fem_prep._condense import condense
from fem_prep._hold import fixed_interface, recovered_displacements
from fem_prep._modes import free_modes, lowest_modes, reduced_modes
from fem_prep._seats import Seat
from fem_prep._web import GearBody, Holes, MeshSizing, body_grid

# omega a^2 sqrt(rho h / D), Poisson's ratio 0.3, outer edge free, by n: the first two.
ANNULI = {
    (0.3, "free"): [
        *((8.3535, 50.353), (18.2918, 58.784), (4.9060, 32.973)),
        *((12.2658, 51.005), (21.7834, 72.360), (33.4813, 96.222)),
    ],
    (0.3, "clamped"): [
        *((6.6604, 42.614), (6.5523, 44.631), (7.9565, 50.947)),
        *((13.2757, 62.053), (22.0738, 78.120), (33.5574, 98.783)),
    ],
    (0.5, "free"): [
        *((9.3135, 92.308), (17.1982, 96.266), (4.2711, 31.115)),
        *((11.4254, 47.462), (21.0672, 66.722), (32.9815, 89.373)),
    ],
}


def unit_of_plate(thickness):
    """Angular frequency of eigenvalue 1 of a plate of radius 1 [rad/s]."""
    bending = STEEL.young * thickness**3 / (12 * (1 - STEEL.poisson**2))
    return np.sqrt(bending / (STEEL.density * thickness))


def half_wave(hole, thickness, n, clamped, radial, around):
    """Eigenvalues of shapes cos(n angle), and of odd multiples of n, of an annular plate."""
    share = np.linspace(0, 1, radial + 1)
    # Finer at both edges.
    radii = hole + (1 - hole) * (0.2 * share + 0.8 * share**2 * (3 - 2 * share))
    end = np.pi / (2 * n) if n else 0.05
    angles = np.linspace(0, end, (around if n else 1) + 1)

    def place(at):
        r, angle, z = at.T
        return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)

    grid = lattice(radii, angles, [-thickness / 2, thickness / 2], place=place)
    angle = np.arctan2(grid.nodes[:, 1], grid.nodes[:, 0])
    cos, sin = np.cos(angle), np.sin(angle)
    turns = np.zeros((len(angle), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = cos
    turns[:, 1, 0], turns[:, 0, 1] = sin, -sin
    turns[:, 2, 2] = 1
    turn = csr_array(block_diag(list(turns)))
    stiffness, mass = (csr_array(turn.T @ each @ turn) for each in assemble(grid, STEEL))
    # The shape is even about the first edge and, but for n = 0, odd about the last.
    last = np.flatnonzero(angle > end - 1e-9)
    fixed = [dofs(np.flatnonzero(angle < 1e-9), 1), dofs(last, 0, 2) if n else dofs(last, 1)]
    if clamped:
        fixed.append(dofs(np.flatnonzero(grid.radius < hole + 1e-9)))
    unit = unit_of_plate(thickness)
    return frequencies(stiffness, mass, np.unique(np.concatenate(fixed)), 9, 5 * unit) / unit


def assert_eigenvalues(found, wanted, lowest, highest):
    """Relative errors of the nearest ones."""
    for value in wanted:
        error = (found / value - 1)[np.argmin(abs(found / value - 1))]
        assert lowest < error < highest, f"{value}: off by {error:.3g}"


@pytest.mark.parametrize("n", range(6))
@pytest.mark.parametrize("edge", ["free", "clamped"])
def test_annular_plates(edge, n):
    found = half_wave(0.3, 0.01, n, edge == "clamped", 14, 4)
    assert_eigenvalues(found, ANNULI[0.3, edge][n], -4e-3, 1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("thickness", [0.005, 0.01, 0.02])
@pytest.mark.parametrize(("hole", "edge"), ANNULI)
def test_annular_plates_finely(hole, edge, thickness):
    """Shear, rotary inertia and the free edges' layer, as wide as the plate is thick, lower all."""
    for n, wanted in enumerate(ANNULI[hole, edge]):
        found = half_wave(hole, thickness, n, edge == "clamped", 32, 8)
        assert_eigenvalues(found, wanted, -0.6 * thickness, 2e-3)


# Free circular plate, likewise: n and the eigenvalue.
CIRCULAR = [
    *((2, 5.3583), (0, 9.0031), (3, 12.4390), (1, 20.4746), (4, 21.8352)),
    *((2, 35.2601), (0, 38.4432)),
]


def clamped_plate(n, count):
    """Eigenvalues of a clamped circular plate: J I' - J' I = 0, without Poisson's ratio."""

    def edge(k):
        return jv(n, k) * iv(n + 1, k) + iv(n, k) * jv(n + 1, k)

    k = np.linspace(1.0, 14.0, 300)
    signs = np.sign(edge(k))
    places = np.flatnonzero(signs[1:] != signs[:-1])[:count]
    roots = [brentq(edge, k[place], k[place + 1]) for place in places]
    return np.array(roots, dtype=float) ** 2


def solid_disc(thickness, sectors, radial):
    body = GearBody(rim_outer=2.0, rim_width=thickness)
    return body_grid(body, MeshSizing(sectors, rim_axial=1, web_radial=radial))


@pytest.mark.slow
def test_circular_plates():
    """Whole plates: pairs are pairs, and no mode is missing."""
    thickness = 0.02
    grid = solid_disc(thickness, 48, 20)
    unit = unit_of_plate(thickness)
    wanted = np.repeat([value for _, value in CIRCULAR], [1 + (n > 0) for n, _ in CIRCULAR])
    # n = 5, the next one, lies between the last two.
    wanted = np.sort(np.append(wanted, [33.495] * 2))
    found = modes_without(grid, STEEL, np.array([], dtype=int), 6 + len(wanted), 5 * unit) / unit
    assert abs(found[:6]).max() < 1e-3
    assert np.all(abs(found[6:] / wanted - 1) < 1e-2)
    pairs = [np.repeat(clamped_plate(n, 2 - n // 2), 1 + (n > 0)) for n in range(4)]
    wanted = np.sort(np.concatenate(pairs))[:8]
    assert wanted[0] == pytest.approx(10.2158, rel=1e-5)
    fixed = dofs(grid.sets["rim"])
    found = modes_without(grid, STEEL, fixed, len(wanted), 10 * unit) / unit
    assert np.all(abs(found / wanted - 1) < 1.5e-2)


# ------------------------------------------------------------------------------- rings

RADIUS = 0.1
# Torsion constant of a square of edge 1.
SQUARE = 0.140577


def ring_frequencies(height, n, material=STEEL):
    """In its plane and out of it, of a thin ring of square section [rad/s]."""
    kappa = material.young * height**2 / (12 * material.density * RADIUS**4)
    shape = kappa * n**2 * (n**2 - 1) ** 2
    twist = material.young / (12 * material.lame[1] * SQUARE)
    return np.sqrt(shape / (n**2 + 1)), np.sqrt(shape / (n**2 + twist))


def square_ring(height, around, across):
    radii = np.linspace(RADIUS - height / 2, RADIUS + height / 2, across + 1)
    return ring(radii, around, radii - RADIUS)


def assert_ring(height, around, most, share):
    grid = square_ring(height, around, 2)
    stiffness, mass = assemble(grid, STEEL)
    shift = ring_frequencies(height, 2)[0] / 3
    square, shapes = lowest_modes(stiffness, mass, 6 + 4 * (most - 1) + 4, shift)
    axial = np.einsum("ij,ij->j", shapes[2::3], mass[2::3, 2::3] @ shapes[2::3])
    assert np.all((axial[6:] < 0.2) | (axial[6:] > 0.7))
    for n in range(2, most + 1):
        for kind, wanted in enumerate(ring_frequencies(height, n)):
            found = np.sqrt(square[6:][(axial[6:] > 0.5) == bool(kind)])
            pair = found[2 * (n - 2) : 2 * (n - 1)]
            assert np.all(abs(pair / wanted - 1) < share), (n, kind)


def test_rings_in_their_plane_and_out_of_it():
    assert_ring(0.005, 48, 3, 5e-3)


@pytest.mark.slow
def test_thin_rings():
    assert_ring(0.002, 96, 5, 3e-3)


def test_a_long_thin_cylinder():
    """A ring that cannot lengthen along its axis is stiffer, by 1 / (1 - nu^2)."""
    height = 0.005
    grid = square_ring(height, 48, 1)
    fixed = dofs(np.arange(len(grid.nodes)), 2)
    wanted = ring_frequencies(height, 2)[0] / np.sqrt(1 - STEEL.poisson**2)
    found = modes_without(grid, STEEL, fixed, 5, wanted / 3)[3:]
    np.testing.assert_allclose(found, wanted, rtol=6e-3)


# ---------------------------------------------------------------------------- rotation


def test_growth_of_a_rotating_disc():
    """Plane stress with free edges, at rim and bore."""
    a, b, speed = 0.03, 0.08, 1000.0
    grid = ring(np.linspace(a, b, 6), 16, [-0.5e-3, 0.5e-3])
    bore = int(grid.sets["bore"][0])
    full = wheel_body(grid, "mean", probes={"bore": bore})
    body = condense(full, modes=0)
    motion = inertia_relief(body, body.centrifugal_load) * speed**2
    rim = motion[: 3 * len(body.rim_nodes)].reshape(-1, 3)
    outward = body.rim_nodes / b
    radial = np.sum(rim * outward, axis=1)
    np.testing.assert_allclose(radial, 5.56976e-6, rtol=5e-4)
    inner = body.probe_rows[0] @ motion @ body.probe_points[0] / a
    assert inner == pytest.approx(6.09777e-6, rel=5e-4)


def test_a_rotating_ring():
    """Coriolis forces, spin softening and stress stiffening together, and each alone."""
    height, speed, count = 0.005, 500.0, 14
    grid = square_ring(height, 48, 1)
    full = full_body("ring", replace(grid, sets={"rim": grid.sets["rim"]}), STEEL, [])
    body = condense(full, modes=count, rotating=True, rotation=full.rotation(12))
    square, shapes = reduced_modes(body, count + 6)
    gyro, soft, stiff = (shapes.T @ each @ shapes for each in rotating_terms(body))
    none, one = np.zeros_like(gyro), np.eye(len(gyro))
    stiffness = np.diag(square) + speed**2 * (stiff - soft)
    state = np.block([[none, one], [-stiffness, -speed * gyro]])
    values, motions = np.linalg.eig(state.astype(complex))
    speeds = np.imag(values)
    for n in (2, 3):
        still = ring_frequencies(height, n)[0]
        # Each alone, in the modes at rest, whose motion is all in the plane.
        at = np.argmin(np.abs(np.sqrt(np.abs(square)) / still - 1) + (np.diag(soft) < 0.9))
        assert soft[at, at] == pytest.approx(1, rel=1e-3)
        assert stiff[at, at] == pytest.approx((n**2 - 1) ** 2 / (n**2 + 1), rel=2e-3)
        assert abs(gyro[at]).max() == pytest.approx(4 * n / (n**2 + 1), rel=4e-3)
        found = []
        for wanted, way in zip(rotating_ring(height, n, speed), (1, -1), strict=True):
            nearest = np.argmin(abs(speeds - wanted))
            assert speeds[nearest] == pytest.approx(wanted, rel=1e-2)
            assert abs(np.real(values[nearest])) < 1e-6 * wanted
            motion = shapes @ motions[: len(gyro), nearest]
            assert share_backward(body, motion, n, way) < 1e-3
            found.append(speeds[nearest])
        assert found[1] - found[0] == pytest.approx(4 * n * speed / (n**2 + 1), rel=5e-3)
    pair = np.array(rotating_ring(height, 2, speed)) / (2 * np.pi)
    np.testing.assert_allclose(pair, [269.148, 396.472], rtol=2e-6)


def rotating_ring(height, n, speed):
    """Forward and backward, seen from the ring [rad/s]."""
    still = ring_frequencies(height, n)[0]
    stiffened = np.sqrt(still**2 + (n * (n**2 - 1) * speed / (n**2 + 1)) ** 2)
    shift = 2 * n * speed / (n**2 + 1)
    return stiffened - shift, stiffened + shift


def share_backward(body, motion, n, way):
    """Of radial motion exp(i w t) the part exp(-i n angle) travels forward, with `way` 1."""
    places = body.rim_nodes[:, :2]
    radial = np.sum(motion[: 3 * len(places)].reshape(-1, 3)[:, :2] * places, axis=1)
    angle = np.arctan2(places[:, 1], places[:, 0])
    with_it, against = (abs(np.sum(radial * np.exp(1j * w * n * angle))) for w in (way, -way))
    return against / with_it


# ------------------------------------------------------------------------------ shafts


@pytest.mark.parametrize(
    ("material", "share"), [(CORK, 3e-3), (STEEL, 4e-2)], ids=["cork", "steel"]
)
def test_a_hollow_shaft_between_two_rigid_seats(material, share):
    """Its 12 by 12 stiffness is that of a Timoshenko beam with Cowper's shear coefficient.

    Rigid ends keep steel from drawing in, as the beam's do not.
    """
    inner, outer, length = 10e-3, 20e-3, 0.4
    grid = ring([inner, outer], 16, np.linspace(0, length, 11))
    z = grid.nodes[:, 2]
    middle = grid.sets["rim"][abs(z[grid.sets["rim"]] - length / 2) < 0.11 * length]
    grid = replace(grid, sets={"rim": middle})
    seats = [
        Seat("left", np.flatnonzero(z < 1e-9), np.zeros(3)),
        Seat("right", np.flatnonzero(z > length - 1e-9), np.array([0, 0, length])),
    ]
    body = condense(full_body("shaft", grid, material, seats), method="guyan", modes=0)
    ends = np.r_[body.seat_dofs("left"), body.seat_dofs("right")]
    rim = np.setdiff1d(np.arange(body.dofs), ends)
    coupling = body.stiffness[np.ix_(rim, ends)]
    found = body.stiffness[np.ix_(ends, ends)] - coupling.T @ np.linalg.solve(
        body.stiffness[np.ix_(rim, rim)], coupling
    )
    area, polar = np.pi * (outer**2 - inner**2), np.pi / 2 * (outer**4 - inner**4)
    poisson, hollow = material.poisson, (inner / outer) ** 2
    square = (1 + hollow) ** 2
    coefficient = 6 * (1 + poisson) * square
    coefficient /= (7 + 6 * poisson) * square + (20 + 12 * poisson) * hollow
    bending = material.young * polar / 2
    shear = 12 * bending / (coefficient * material.lame[1] * area * length**2)
    assert found[11, 11] == pytest.approx(material.lame[1] * polar / length, rel=1.2e-4)
    assert found[5, 11] == pytest.approx(-found[11, 11], rel=1e-9)
    beam = bending / (length**3 * (1 + shear))
    expected = {
        (8, 8): material.young * area / length,
        (6, 6): 12 * beam,
        (10, 6): -6 * beam * length,
        (9, 9): (4 + shear) * beam * length**2,
        (3, 9): (2 - shear) * beam * length**2,
    }
    for place, wanted in expected.items():
        assert found[place] == pytest.approx(wanted, rel=share)


# --------------------------------------------------------------------- wheels with holes


def diameters(full, shapes):
    """Number of nodal diameters that the axial motion of the rim is most of, by mode."""
    x, y, z = full.grid.nodes[full.rim].T
    middle = abs(z) < 1e-9
    axial = shapes[3 * full.rim_points[middle] + 2]
    angle = np.arctan2(y[middle], x[middle])
    waves = np.exp(1j * np.outer(np.arange(9), angle))
    parts = abs(waves @ axial)
    parts[0] /= np.sqrt(2)
    return parts.argmax(axis=0)


def splits(full, count, most):
    """Relative split of the lowest axial pair of each number of diameters, from 2 on."""
    square, shapes = free_modes(full, count)
    numbers = diameters(full, shapes)
    result = {}
    for n in range(2, most + 1):
        first, second = np.sqrt(square[np.flatnonzero(numbers == n)[:2]])
        result[n] = second / first - 1
    return result


def test_holes_split_the_pairs_that_symmetry_says():
    """h equal holes split a pair of n diameters if and only if 2 n is a multiple of h."""
    fineness = MeshSizing(16, rim_axial=2, rim_radial=1, web_radial=3, hub_radial=1)
    for holes, split in (((), set()), ((Holes(4, 14e-3, 84e-3),), {2, 4})):
        found = splits(wheel_body(accessory_wheel(holes, fineness)), 14, 4)
        assert {n for n, share in found.items() if share > 1e-6} == split
        assert all(share < 1e-9 for n, share in found.items() if n not in split)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("holes", "split"),
    [
        ((Holes(6, 12e-3, 84e-3),), {3}),
        ((Holes(5, 12e-3, 84e-3),), {5}),
        ((Holes(6, 10e-3, 70e-3), Holes(6, 10e-3, 96e-3, np.pi / 6)), {3}),
        ((Holes(3, 12e-3, 84e-3),), {3}),
    ],
)
def test_other_patterns_of_holes(holes, split):
    sectors = 40 if holes[0].count == 5 else 36
    full = wheel_body(
        accessory_wheel(holes, MeshSizing(sectors, rim_axial=2, rim_radial=1, hub_radial=1))
    )
    found = splits(full, 18, 5)
    assert {n for n, share in found.items() if share > 1e-6} == split
    assert all(share < 1e-8 for n, share in found.items() if n not in split)


# ------------------------------------------------------------------------- whole wheels


def on_bearings(full, body):
    """Full and condensed answers to a force on a tooth, on bearings and a mesh spring."""
    springs, load = springs_on(full), tooth_load(full)
    rows = boundary_rows(full)
    exact = rows @ answer(on_springs(full, springs), rows.T @ load)
    found = np.linalg.solve(body.stiffness + padded(body, springs), padded(body, load))
    return exact, found[: body.boundary_dofs]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("web", "young", "share"),
    quick(
        2, [(0.2e-3, 2.1e11, 1e-5), (9.5e-3, 2.1e11, 1e-9), (3e-3, 4e14, 1e-7), (None, 4e14, 1e-7)]
    ),
    ids=["thin", "as thick as the rim", "rigidified", "solid and rigidified"],
)
def test_extreme_wheels(web, young, share):
    body = replace(ACCESSORY, web=web and replace(ACCESSORY_WEB, thickness=web))
    grid = body_grid(body, MeshSizing(12, rim_axial=2, rim_radial=1, web_radial=4, hub_radial=1))
    full = wheel_body(grid, "ring", material=replace(STEEL, young=young))
    body = condense(full, modes=12)
    free, _ = free_modes(full, 8)
    square, _ = reduced_modes(body, 14)
    exact, found = on_bearings(full, body)
    rigid = body.rigid_motions
    np.testing.assert_allclose(square[6:], free, rtol=1e-6)
    assert abs(square[:6]).max() < 1e-6 * free[0]
    assert_near(found, exact, share)
    moved = abs(body.stiffness @ rigid).max()
    assert moved < 1e-12 * abs(body.stiffness).max() * abs(rigid).max()


@pytest.mark.slow
def test_the_accessory_wheel():
    """37,000 degrees of freedom, one sector per tooth, on 2,800 of the rim and 50 modes."""
    grid = accessory_wheel()
    assert 36_000 < grid.dofs < 40_000
    full = wheel_body(grid, "ring", probes={"web": web_probe(grid)})
    bodies = {
        (method, modes): condense(full, method=method, modes=modes)
        for method, modes in [
            ("herting", 50),
            ("herting", 10),
            ("herting", 0),
            ("craig-bampton", 50),
        ]
    }
    body = bodies["herting", 50]
    assert body.facts["sectors"] == 86
    # Free frequencies: exact by construction.
    free, _ = free_modes(full, 40)
    square, _ = reduced_modes(body, 46)
    np.testing.assert_allclose(np.sqrt(square[6:]), np.sqrt(free), rtol=1e-8)
    worse, _ = reduced_modes(bodies["craig-bampton", 50], 46)
    error = np.sqrt(worse[6:] / free) - 1
    assert 1e-4 < error.max() < 3e-2
    assert error.min() > 0
    # With bearings and a mesh spring: the real test.
    springs = springs_on(full)
    exact, _ = lowest_modes(on_springs(full, springs), full.mass, 40, 1e4)
    for key, limit in ((("herting", 50), 1e-3), (("craig-bampton", 50), 3e-2)):
        found = sprung_modes(bodies[key], 40, pulls_on(full))
        np.testing.assert_allclose(np.sqrt(found), np.sqrt(exact), rtol=limit)
    # Statics.
    wanted, found = on_bearings(full, body)
    assert_near(found, wanted, 1e-8)
    rigid = body.rigid_motions
    assert abs(body.stiffness @ rigid).max() < 1e-12 * abs(body.stiffness).max() * abs(rigid).max()
    exact = answer(on_springs(full, springs), full.centrifugal_load)
    at_probe = exact[dofs(full.probe_points)]
    for each in bodies.values():
        stiffness = each.stiffness + padded(each, springs)
        motion = np.linalg.solve(stiffness, each.centrifugal_load)
        assert_near(motion[: each.boundary_dofs], boundary_rows(full) @ exact, 1e-9)
        assert_near(each.probe_rows[0] @ motion, at_probe, 1e-9)
    shapes = recovered_displacements(fixed_interface(full), body, np.eye(body.dofs)[:, -3:])
    assert_near(shapes, body.interior_shapes[-3:], 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("coupling", quick(1, ["averaging", "rigid", "none"]))
@pytest.mark.parametrize("method", ["herting", "guyan"])
def test_a_body_that_spins_freely_moves_freely(coupling, method):
    """What rotation adds to the stiffness of rigid motions, for bodies that hang in space.

    A turn about the axis meets none. A tilt leaves the axis of largest inertia: its stiffness is
    C - A. A body that moves sideways leaves the axis of rotation, with all of its mass. This holds
    if stiffening by stresses, softening, and the forces in rigid seats belong together.
    """
    grid = small_wheel(16)
    seats = [] if coupling == "none" else [bore_seat(grid, coupling == "averaging")]
    full = full_body("wheel", grid, STEEL, seats)
    body = condense(full, method=method, modes=5, rotating=True)
    assert body.stress_stiffening is not None
    assert body.spin_softening is not None
    rigid = body.rigid_motions
    inertia = rigid.T @ body.mass @ rigid
    added = rigid.T @ (body.stress_stiffening - body.spin_softening) @ rigid
    assert abs(added[5, 5]) < 1e-10 * inertia[5, 5]
    assert added[3, 3] == pytest.approx(inertia[5, 5] - inertia[3, 3], rel=1e-10)
    assert added[0, 0] == pytest.approx(-inertia[0, 0], rel=1e-10)
    assert abs(added[2, 2]) < 1e-10 * inertia[0, 0]
