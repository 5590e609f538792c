"""Matrices of a grid: patch test, rigid motions, mass, rotation; solutions exact in 3-D."""

from dataclasses import replace

import numpy as np
import pytest
from fem_cases import (
    ACCESSORY,
    ACCESSORY_FINENESS,
    CORK,
    SIGNS,
    STEEL,
    accessory_wheel,
    assert_near,
    block,
    dofs,
    frequencies,
    lattice,
    linear_field,
    ring,
    shaken,
    small_wheel,
    straightened,
)
from helpers import observed_order
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.sparse.linalg import eigsh
from scipy.special import jv, yv

from fem_prep._artefact import rigid_motions
from fem_prep._assembly import (
    Material,
    across,
    assemble,
    centrifugal_load,
    coriolis,
    stress_stiffening,
    surface_mass,
    volume,
)
from fem_prep._brick import REFERENCE_NODES, gauss_points, shape_functions
from fem_prep._checks import BodyError
from fem_prep._grid import surface, surface_of
from fem_prep._solvers import available_solvers, factorise
from fem_prep._web import exact_properties

STRAINS = [
    np.outer(np.eye(3)[i], np.eye(3)[j]) + np.outer(np.eye(3)[j], np.eye(3)[i])
    for i, j in [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)]
]


def stress_of(slopes, material):
    dilatation, shear = material.lame
    return dilatation * np.trace(slopes) * np.eye(3) + shear * (slopes + slopes.T)


def patch():
    """Eight bricks with straight edges, all their corners moved."""
    return shaken(block(1.0, 1.2, 0.8, (2, 2, 2)), 0.08)


def bent():
    """The same with edges that are curved."""
    return shaken(block(1.0, 1.2, 0.8, (2, 2, 2)), 0.03, curved=True)


# ---------------------------------------------------------------- the brick, said a second time


def serendipity(at):
    """Values of the 20 shape functions at a place in the cube from -1 to 1 (Zienkiewicz, 8.7)."""
    along = np.where(SIGNS == 0, 1 - at**2, 1 + SIGNS * at)
    corner = np.all(SIGNS != 0, axis=1)
    return along.prod(axis=1) * np.where(corner, (SIGNS @ at - 2) / 8, 0.25)


def brick_by_hand(nodes, material, points):
    """Stiffness, mass and centrifugal load of one brick in Voigt's notation."""
    places, weights = np.polynomial.legendre.leggauss(points)
    dilatation, shear = material.lame
    elastic = np.diag([2 * shear] * 3 + [shear] * 3)
    elastic[:3, :3] += dilatation
    stiffness, mass, load = np.zeros((60, 60)), np.zeros((60, 60)), np.zeros(60)
    for index in np.ndindex(points, points, points):
        at = places[list(index)]
        value = serendipity(at)
        # Complex steps: derivatives to the last digit.
        slopes = np.stack([serendipity(at + 1e-30j * e).imag / 1e-30 for e in np.eye(3)], axis=1)
        jacobian = nodes.T @ slopes
        scale = np.linalg.det(jacobian) * weights[list(index)].prod()
        x, y, z = (slopes @ np.linalg.inv(jacobian)).T
        none = np.zeros(20)
        rows = [[x, none, none], [none, y, none], [none, none, z]]
        rows += [[y, x, none], [none, z, y], [z, none, x]]
        strain = np.array([np.stack(row, axis=1).ravel() for row in rows])
        stiffness += scale * strain.T @ elastic @ strain
        motion = np.kron(value, np.eye(3))
        mass += scale * material.density * motion.T @ motion
        load += scale * material.density * motion.T @ (value @ nodes * [1, 1, 0])
    return stiffness, mass, load


def test_shape_functions_against_their_formula():
    np.testing.assert_array_equal(2 * REFERENCE_NODES - 1, SIGNS)
    places, weights = gauss_points(5)
    values, _ = shape_functions(places)
    expected = [serendipity(2 * at - 1) for at in places]
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-14)
    assert weights.sum() == pytest.approx(1, abs=1e-14)


@pytest.mark.parametrize("curved", [False, True])
def test_one_brick_against_voigt_notation(curved):
    grid = shaken(block(1.0, 1.0, 1.0, (1, 1, 1)), 0.07, curved=curved)
    order = grid.bricks[0]
    stiffness, mass = (each.toarray() for each in assemble(grid, STEEL))
    place = dofs(order)
    expected = brick_by_hand(grid.nodes[order], STEEL, 3)
    load = centrifugal_load(mass, grid.nodes)[place]
    found = (*(matrix[np.ix_(place, place)] for matrix in (stiffness, mass)), load)
    for each, wanted in zip(found, expected, strict=True):
        assert_near(each, wanted, 1e-13)


def test_centrifugal_load_against_a_finer_quadrature():
    """Bricks with straight edges: 27 points are exact, so 125 find the same."""
    grid = patch()
    found = centrifugal_load(assemble(grid, STEEL)[1], grid.nodes)
    wanted = np.zeros(grid.dofs)
    for brick in grid.bricks:
        wanted[dofs(brick)] += brick_by_hand(grid.nodes[brick], STEEL, 5)[2]
    assert_near(found, wanted, 1e-13)


# --------------------------------------------------------------- what every motion must do


@pytest.mark.parametrize("grid", [patch(), bent()], ids=["straight", "curved"])
@pytest.mark.parametrize("strain", STRAINS)
def test_patch(grid, strain):
    """Whatever the shape of the bricks, a uniform strain is found inside from its boundary."""
    stiffness, _ = assemble(grid, STEEL)
    exact = linear_field(grid, strain)
    outer = dofs(np.unique(surface(grid)))
    inner = np.setdiff1d(np.arange(grid.dofs), outer)
    assert inner.size >= 18
    matrix = stiffness.toarray()
    load = -matrix[np.ix_(inner, outer)] @ exact[outer]
    found = np.linalg.solve(matrix[np.ix_(inner, inner)], load)
    np.testing.assert_allclose(found, exact[inner], rtol=0, atol=1e-13 * abs(exact).max())
    energy = volume(grid) * np.sum(stress_of(strain, STEEL) * strain)
    assert exact @ (stiffness @ exact) == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("make", [patch, bent, small_wheel])
def test_rigid_motions_strain_nothing(make):
    grid = make()
    stiffness, _ = assemble(grid, STEEL)
    rigid = rigid_motions(grid.nodes)
    assert abs(stiffness @ rigid).max() < 1e-14 * abs(stiffness).max() * abs(rigid).max()
    assert abs(stiffness - stiffness.T).max() < 1e-14 * abs(stiffness).max()


def test_mass_and_inertias_of_the_accessory_wheel():
    """One brick per tooth, 86 around: 3e-6 of the exact volume, and of the moments of inertia."""
    grid = accessory_wheel(fineness=replace(ACCESSORY_FINENESS, web_radial=2, hub_radial=1))
    # Outer and inner radius, height of hub, web and rim.
    rings = 1e-3 * np.array([[25, 20, 9.5], [59, 25, 3], [63.43155, 59, 9.5]])
    outer, inner, height = rings.T
    masses = STEEL.density * np.pi * (outer**2 - inner**2) * height
    polar = masses @ (outer**2 + inner**2) / 2
    across_it = polar / 2 + masses @ height**2 / 12
    rigid = rigid_motions(grid.nodes)
    found = rigid.T @ (assemble(grid, STEEL)[1] @ rigid)
    exact = np.diag([masses.sum()] * 3 + [across_it] * 2 + [polar])
    np.testing.assert_allclose(np.diag(found), np.diag(exact), rtol=3e-6)
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    np.testing.assert_allclose(found / size, exact / size, rtol=0, atol=3e-6)
    properties = exact_properties(ACCESSORY)
    assert volume(grid) == pytest.approx(properties.volume, rel=3e-6)
    assert properties.volume * STEEL.density == pytest.approx(masses.sum(), rel=1e-12)


def test_arcs_are_round_to_fourth_order():
    around = np.array([10, 14, 20])
    volumes = [volume(ring([0.5, 1.0], n, [0.0, 1.0])) for n in around]
    errors = abs(np.array(volumes) / (0.75 * np.pi) - 1)
    assert observed_order(1 / around, errors) == pytest.approx(4, abs=0.1)


def test_a_grid_in_pieces_is_assembled_alike(monkeypatch):
    grid = bent()
    whole = [each.toarray() for each in assemble(grid, STEEL)]
    stiffening = stress_stiffening(grid, STEEL, grid.nodes**2).toarray()
    monkeypatch.setattr("fem_prep._assembly._CHUNK", 3)
    found = [each.toarray() for each in assemble(grid, STEEL)]
    found.append(stress_stiffening(grid, STEEL, grid.nodes**2).toarray())
    for each, wanted in zip(found, [*whole, stiffening], strict=True):
        assert_near(each, wanted, 1e-14)


# ----------------------------------------------------------------------------- rotation


def test_terms_of_rotation_on_rigid_motions():
    """Signs by hand: moving along x, a rotating body is pushed along -2 z x v = -2 v y."""
    grid = bent()
    _, mass = assemble(grid, STEEL)
    skew, plane = coriolis(mass), across(mass)
    assert abs(skew + skew.T).max() == 0
    total = STEEL.density * volume(grid)
    rigid = rigid_motions(grid.nodes)
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])
    moved = rigid[:, :3].T @ skew @ rigid[:, :3]
    np.testing.assert_allclose(moved, 2 * total * turn, rtol=0, atol=1e-12 * total)
    found = rigid[:, :3].T @ plane @ rigid[:, :3]
    np.testing.assert_allclose(found, total * np.diag([1, 1, 0]), rtol=0, atol=1e-12 * total)
    # Spinning faster by w presses outward by 2 w times the centrifugal load of unit speed.
    load = centrifugal_load(mass, grid.nodes)
    np.testing.assert_allclose(skew @ rigid[:, 5], -2 * load, rtol=0, atol=1e-12 * abs(load).max())
    np.testing.assert_allclose(plane @ grid.nodes.ravel(), load, rtol=0, atol=1e-15)


def test_stress_stiffening_of_a_uniform_stress():
    """u' K v = V tr(A s B') for u = A x, v = B x: symmetric, and nothing for translations."""
    rng = np.random.default_rng(4)
    for grid in (patch(), bent()):
        strain, first, second = rng.standard_normal((3, 3, 3))
        stiffness = stress_stiffening(grid, STEEL, linear_field(grid, strain).reshape(-1, 3))
        assert abs(stiffness - stiffness.T).max() < 1e-15 * abs(stiffness).max()
        left, right = (linear_field(grid, slopes) for slopes in (first, second))
        stress = stress_of(strain, STEEL) / 2
        expected = volume(grid) * np.trace(first @ (stress + stress.T) @ second.T)
        assert left @ (stiffness @ right) == pytest.approx(expected, rel=1e-11)
        moved = stiffness @ rigid_motions(grid.nodes)[:, :3]
        assert abs(moved).max() < 1e-14 * abs(stiffness).max()


def test_faces_look_outward():
    """Corners counter-clockwise seen from outside, then the middles that follow them."""
    grid = patch()
    faces = grid.nodes[surface(grid)]
    assert faces.shape == (24, 8, 3)
    corners, middles = faces[:, :4], faces[:, 4:]
    np.testing.assert_allclose(middles, (corners + np.roll(corners, -1, axis=1)) / 2, rtol=1e-12)
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    outward = corners.mean(axis=1) - grid.nodes.mean(axis=0)
    assert np.all(np.sum(normal * outward, axis=1) > 0)


def test_skin():
    """Area and moments of a flat distorted face and of a cylinder."""
    grid = straightened(
        lattice([0, 1], [0, 0.7, 1], [0, 1], place=lambda at: at * (1 + 0.3 * at[:, [1, 2, 0]]))
    )
    x, y, z = grid.nodes.T
    floor = replace(grid, sets={"floor": np.flatnonzero(z == 0)})
    area = surface_mass(grid.nodes, surface_of(floor, "floor"))[::3, ::3]
    # Corners (0, 0), (1, 0), (1.3, 1), (0, 1): the area, and the integral of y.
    assert np.ones(len(x)) @ (area @ np.ones(len(x))) == pytest.approx(1.15, rel=1e-14)
    assert y @ (area @ np.ones(len(x))) == pytest.approx(0.6, rel=1e-14)
    wheel = small_wheel(43)
    skin = surface_mass(wheel.nodes, surface_of(wheel, "rim"))
    rigid = rigid_motions(wheel.nodes)
    radius, width = 63.43155e-3, 9.5e-3
    exact = 2 * np.pi * radius * width * np.array([1, 1, 1, 0, 0, radius**2])
    exact[3:5] = exact[0] * (radius**2 / 2 + width**2 / 12)
    np.testing.assert_allclose(np.diag(rigid.T @ (skin @ rigid)), exact, rtol=3e-6)


# -------------------------------------------------- exact solutions in three dimensions


def nearest_mode(stiffness, mass, target):
    """Relative error of the angular frequency nearest to `target`."""
    square = eigsh(stiffness, 6, M=mass, sigma=target**2, return_eigenvectors=False)
    errors = np.sqrt(square) / target - 1
    return abs(errors).min()


def test_lame_modes_of_a_cube():
    """A free cube has modes that shear it and change no volume: u = sin x cos y, -cos x sin y."""
    target = np.sqrt(2 * STEEL.lame[1] / STEEL.density) * np.pi
    counts = np.array([2, 3, 4])
    errors = [nearest_mode(*assemble(block(1, 1, 1, (n, n, n)), STEEL), target) for n in counts]
    assert errors[-1] < 6e-4
    assert observed_order(1 / counts, errors) == pytest.approx(4, abs=0.3)


def test_torsional_mode_of_a_thick_ring():
    """u = J1(k r) Y2(k a) - Y1(k r) J2(k a) along the circle, with no shear at both edges."""

    def shear(k):
        return jv(2, k / 2) * yv(2, k) - jv(2, k) * yv(2, k / 2)

    wave = brentq(shear, 6.5, 7.0)
    target = wave * np.sqrt(STEEL.lame[1] / STEEL.density)
    counts = np.array([2, 3, 4])
    errors = []
    for n in counts:
        grid = ring(np.linspace(0.5, 1, n + 1), 8 * n, [0, 0.5])
        plane = dofs(np.arange(len(grid.nodes)), 0, 1)
        stiffness, mass = (each[plane][:, plane] for each in assemble(grid, STEEL))
        errors.append(nearest_mode(stiffness, mass, target))
    assert errors[-1] < 3e-4
    assert observed_order(1 / counts, errors) == pytest.approx(4, abs=0.3)


def test_energy_of_a_spinning_disc():
    """Without Poisson's effect a disc of any thickness is in plane stress."""
    a, b, height = 0.03, 0.08, 0.02

    def growth(r):
        shape = a**2 + b**2 - r**2 / 3 + (a * b / r) ** 2
        return CORK.density * 3 / (8 * CORK.young) * r * shape

    exact, _ = quad(lambda r: CORK.density * r**2 * growth(r) * 2 * np.pi * height, a, b)
    counts, errors = np.array([3, 4, 6]), []
    for n in counts:
        grid = ring(np.linspace(a, b, n + 1), 8 * n, [0, height])
        stiffness, mass = assemble(grid, CORK)
        load = centrifugal_load(mass, grid.nodes)
        # The load balances itself: springs that hold the rigid motions are not stretched.
        factor = factorise(stiffness + 1e6 * mass)
        motion = np.zeros(grid.dofs)
        for _ in range(4):
            motion += factor.solve(load - stiffness @ motion)
        errors.append(abs(load @ motion / exact - 1))
    assert errors[-1] < 1.5e-5
    assert observed_order(1 / counts, errors) == pytest.approx(4, abs=0.3)


@pytest.mark.parametrize("inner", [0.5, 0.9])
def test_torsion_of_a_hollow_shaft(inner):
    """u = z r along the circle is in the elements' space: torque G J / L, and no force inside."""
    length = 3.0
    grid = ring([inner, 1.0], 24, np.linspace(0, length, 5))
    stiffness, _ = assemble(grid, STEEL)
    x, y, z = grid.nodes.T
    twist = (np.stack([-y * z, x * z, 0 * z], axis=1) / length).ravel()
    force = (stiffness @ twist).reshape(-1, 3)
    polar = np.pi / 2 * (1 - inner**4)
    assert twist @ force.ravel() == pytest.approx(STEEL.lame[1] * polar / length, rel=3e-5)
    between = (z > 1e-9) & (z < length - 1e-9)
    assert abs(force[between]).max() < 1e-12 * abs(force).max()


def test_a_cantilever_that_is_pushed_at_its_end():
    """P L^3 / 3 E I and the shear of a section of shape factor 5/6."""
    length, height = 1.0, 0.1
    grid = block(length, height, 0.05, (10, 2, 1))
    stiffness, _ = assemble(grid, CORK)
    faces = surface_of(replace(grid, sets={"end": nodes_at(grid, 0, length)}), "end")
    load = surface_mass(grid.nodes, faces) @ np.tile([0, 1.0, 0], len(grid.nodes))
    free = np.setdiff1d(np.arange(grid.dofs), dofs(nodes_at(grid, 0, 0.0)))
    motion = np.zeros(grid.dofs)
    motion[free] = factorise(stiffness[free][:, free]).solve(load[free])
    area, inertia = height * 0.05, height**3 * 0.05 / 12
    bending = length**3 / (3 * CORK.young * inertia)
    shear = length / (5 / 6 * CORK.lame[1] * area)
    assert load.sum() == pytest.approx(area, rel=1e-12)
    assert load @ motion / area**2 == pytest.approx(bending + shear, rel=1.5e-3)


@pytest.mark.parametrize("strain", [0.0, 2e-3])
def test_a_beam_in_tension(strain):
    """Ends guided, w = cos k x: Timoshenko's frequencies; tension N adds N k^2 / rho A."""
    length, height = 1.0, 0.04
    grid = block(length, height, height, (16, 2, 1))
    stiffness, mass = assemble(grid, CORK)
    pulled = grid.nodes * [strain, 0, 0]
    ends = np.concatenate([nodes_at(grid, 0, 0.0), nodes_at(grid, 0, length)])
    fixed = np.union1d(dofs(ends, 0), dofs(np.arange(len(grid.nodes)), 2))
    stiffness = stiffness + stress_stiffening(grid, CORK, pulled)
    found = frequencies(stiffness, mass, fixed, 4, 1000.0)[1:]
    k = np.arange(1, 4) * np.pi / length
    gyration, density = height**2 / 12, CORK.density
    shear = density / (5 / 6 * CORK.lame[1])
    linear = 1 + gyration * k**2 * (1 + CORK.young / density * shear)
    quadratic = shear * gyration
    square = 2 * CORK.young / density * gyration * k**4
    square = square / (linear + np.sqrt(linear**2 - 2 * quadratic * square))
    square = square + CORK.young * strain / density * k**2
    np.testing.assert_allclose(found, np.sqrt(square), rtol=4e-3)
    assert found[0] == pytest.approx(np.sqrt(square[0]), rel=4e-4)


def nodes_at(grid, axis, place):
    return np.flatnonzero(abs(grid.nodes[:, axis] - place) < 1e-9)


# --------------------------------------------------------------------- what cannot be


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"young": 206e3}, "in pascals"),
        ({"young": 2e17}, "1e16 Pa, got 2e"),
        ({"young": float("nan")}, "got nan"),
        ({"poisson": 0.5}, "Poisson"),
        ({"poisson": -1.0}, "without the ends"),
        ({"density": 7.85e-9}, "steel has 7850"),
        ({"density": 2e5}, "kg/m3"),
    ],
)
def test_an_absurd_material_is_refused(wrong, says):
    with pytest.raises(BodyError, match=says):
        Material(**wrong)


def test_an_inverted_brick_is_refused():
    grid = patch()
    bricks = grid.bricks.copy()
    upside_down = [4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11, 16, 17, 18, 19]
    bricks[3] = bricks[3][upside_down]
    with pytest.raises(BodyError, match="1 of 8 have not"):
        assemble(replace(grid, bricks=bricks), STEEL)


def test_solvers_agree_and_refuse_what_is_singular():
    stiffness, mass = assemble(patch(), STEEL)
    matrix = (stiffness + 1e9 * mass).tocsc()
    right = np.random.default_rng(0).standard_normal((matrix.shape[0], 150))
    for solver in available_solvers():
        factor = factorise(matrix, solver)
        assert factor.solver == solver
        for columns in (right, right[:, 0], right[:, :64]):
            residual = matrix @ factor.solve(columns) - columns
            assert abs(residual).max() < 1e-9
        with pytest.raises(BodyError, match="held by nothing"):
            factorise(matrix * 0, solver)
    assert factorise(matrix).solver == available_solvers()[0]
    with pytest.raises(BodyError, match=r"one of .*superlu, got 'mumps'"):
        factorise(matrix, "mumps")
