"""Nodal diameters and circles: of plates in closed form, of shapes made by hand, of elements."""

import numpy as np
import pytest
from scipy.special import iv, ivp, jv, jvp

from fem_prep._assembly import Material, assemble
from fem_prep._checks import BodyError
from fem_prep._fourier import expected_split, families, identify, symmetry_splitting
from fem_prep._grid import EDGES, Grid, merged
from fem_prep._modes import lowest_modes

# Free circular plate, Poisson's ratio 0.3: omega a^2 sqrt(rho h / D) by n, for rising circles.
PLATE = {
    0: (9.0031, 38.4432, 87.7502),
    1: (20.4746, 59.8116, 118.957),
    2: (5.3583, 35.2601, 84.3662),
    3: (12.4390, 53.0078, 111.945),
    4: (21.8352, 73.5426, 142.431),
}
# Free annular plate with a hole of 0.3 of the outer radius, likewise.
ANNULUS = {
    0: (8.3535, 50.353),
    1: (18.2918, 58.784),
    2: (4.9060, 32.973),
    3: (12.2658, 51.005),
    4: (21.7834, 72.360),
    5: (33.4813,),
}


def circles(n):
    """Nodal circles of the lowest mode of n diameters: without one, a free plate moves rigidly."""
    return 1 if n < 2 else 0


def rings(radii, around, heights=(0.0,), start=0.1):
    angle = start + 2 * np.pi * np.arange(around) / around
    r, t, z = (x.ravel() for x in np.meshgrid(radii, angle, heights, indexing="ij"))
    return np.stack([r * np.cos(t), r * np.sin(t), z], axis=1)


def scattered(spacing, heights):
    """A square lattice, shaken, within the unit circle: no two nodes share a ring."""
    x = np.arange(-1, 1, spacing)
    points = np.stack([each.ravel() for each in np.meshgrid(x, x, heights)], axis=1)
    rng = np.random.default_rng(3)
    points[:, :2] += rng.uniform(0.2 * spacing, 0.5 * spacing, (len(points), 2))
    radius = np.hypot(points[:, 0], points[:, 1])
    return points[(radius < 1) & (radius > 0.02)]


def repeated(points, times):
    """The nodes of one sector, at as many places around the axis: each has few on its ring."""
    _, angle = polar(points)
    radius, height = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    inside = abs(angle) < np.pi / times
    turns = angle[inside] + 2 * np.pi * np.arange(times)[:, None] / times
    return np.stack(
        [
            f.ravel()
            for f in np.broadcast_arrays(
                radius[inside] * np.cos(turns), radius[inside] * np.sin(turns), height[inside]
            )
        ],
        axis=1,
    )


def turned(radial, tangential, axial, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = radial * cos - tangential * sin, radial * sin + tangential * cos
    return np.stack([x, y, axial + 0 * angle], axis=1)


def polar(points):
    return np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])


def plate_shape(points, n, eigenvalue, phase):
    """Kirchhoff's shape: J_n + C I_n with no bending moment at the edge; sections stay normal."""
    r, angle = polar(points)
    k = np.sqrt(eigenvalue)

    def moment(bessel, derivative):
        slope = k * derivative(n, k) - n**2 * bessel(n, k)
        return k**2 * derivative(n, k, 2) + 0.3 * slope

    c = -moment(jv, jvp) / moment(iv, ivp)
    w, dw = jv(n, k * r) + c * iv(n, k * r), k * (jvp(n, k * r) + c * ivp(n, k * r))
    cos, sin = np.cos(n * angle - phase), np.sin(n * angle - phase)
    z = points[:, 2]
    return turned(-z * dw * cos, z * n * w / r * sin, w * cos, angle)


@pytest.mark.parametrize(
    ("points", "share"),
    [
        (rings(np.linspace(0.02, 1, 17), 48, (-0.01, 0.0, 0.01)), 1 - 1e-9),
        (rings(np.linspace(0.02, 1, 17), 11, (-0.01, 0.01)), 1 - 1e-9),
        (scattered(0.05, (-0.01, 0.0, 0.01)), 0.94),
        (scattered(0.1, (-0.01, 0.0, 0.01)), 0.93),
        (repeated(scattered(0.05, (-0.01, 0.0, 0.01)), 6), 0.94),
    ],
    ids=["fine", "coarse", "scattered", "few", "repeated"],
)
def test_modes_of_the_free_circular_plate(points, share):
    names = [(n, s + circles(n)) for n in PLATE for s in range(3)]
    phases = np.random.default_rng(5).uniform(0, 2 * np.pi, len(names))
    values = [value for row in PLATE.values() for value in row]
    shapes = np.array(
        [plate_shape(points, n, v, p) for (n, _), v, p in zip(names, values, phases, strict=True)]
    )
    # Weights as of a mass: rings weigh as they are long, the lattice is even.
    weights = None if share < 0.99 else np.hypot(points[:, 0], points[:, 1])
    pattern = identify(points, shapes, weights=weights)
    assert list(zip(pattern.diameter, pattern.circle, strict=True)) == names
    assert set(pattern.kind) == {"axial"}
    assert pattern.share.min() > share
    assert pattern.spectrum.sum(axis=1).max() <= 1 + 1e-12
    assert pattern.covered > 0.99


def test_rigid_motions_torsion_breathing_and_umbrella():
    points = rings(np.linspace(0.3, 1, 9), 24, (-0.2, 0.2))
    r, angle = polar(points)
    x, y, z = np.eye(3)
    shapes = [
        (x + 0 * points, 1, 0, "radial", (0.5, 0.5, 0)),
        (z + 0 * points, 0, 0, "axial", (0, 0, 1)),
        (np.cross(z, points), 0, 0, "tangential", (0, 1, 0)),
        (np.cross(y, points * (1, 1, 0)), 1, 0, "axial", (0, 0, 1)),
        (turned(0, r * (r - 0.8), 0, angle), 0, 1, "tangential", (0, 1, 0)),
        (turned(1 / r, 0, 0, angle), 0, 0, "radial", (1, 0, 0)),
        (turned(0, 0, (r - 0.5) * (r - 0.9), angle), 0, 2, "axial", (0, 0, 1)),
        # A hub at rest but for noise.
        (turned(0, 0, np.where(r < 0.7, 0.01 * np.cos(1e3 * r), r), angle), 0, 0, "axial", ()),
        # Bending of a ring in its plane without extension: u_t = -u_r / n in amplitude.
        (turned(np.cos(3 * angle), -np.sin(3 * angle) / 3, 0, angle), 3, 0, "radial", (0.9, 0.1)),
        # A rim that rolls: its radial motion changes sign along the height, not the radius.
        (turned(5 * points[:, 2] * np.cos(2 * angle), 0, 0, angle), 2, 0, "radial", (1, 0, 0)),
    ]
    pattern = identify(points, np.array([shape for shape, *_ in shapes]))
    for mode, (_, n, s, kind, direction) in enumerate(shapes[:-1]):
        assert (pattern.diameter[mode], pattern.circle[mode]) == (n, s), mode
        assert pattern.kind[mode] == kind
        np.testing.assert_allclose(pattern.direction[mode][: len(direction)], direction, atol=1e-12)
    np.testing.assert_allclose(pattern.share, 1, atol=1e-12)
    assert pattern.diameter[-1] == 2
    # Half and half whichever way it moves: rounding must not name it.
    ways = np.linspace(0, 3, 20)[:, None, None]
    shifts = identify(points, np.cos(ways) * x + np.sin(ways) * y + 0 * points)
    assert set(shifts.kind) == {"radial"}


def test_energies_by_hand():
    """Half the weight moves as 2 cos 2 theta, the rest as sin 5 theta and by 0.5 at n = 0."""
    points = rings((0.5, 1.0), 32)
    r, angle = polar(points)
    axial = np.where(r < 0.7, 2 * np.cos(2 * angle), np.sin(5 * angle) + 0.5)
    shape = turned(0, 0, axial, angle)[None]
    expected = np.array([0.25, 2.0, 0.5]) / 2.75
    np.testing.assert_allclose(identify(points, shape).spectrum[0, [0, 2, 5]], expected, rtol=1e-12)
    weights = np.where(r < 0.7, 1.0, 3.0)
    pattern = identify(points, shape, weights=weights)
    expected = np.array([0.75, 2.0, 1.5]) / 4.25
    np.testing.assert_allclose(pattern.spectrum[0, [0, 2, 5]], expected, rtol=1e-12)
    assert (pattern.diameter[0], pattern.share[0]) == (2, pytest.approx(2 / 4.25))
    np.testing.assert_allclose(pattern.spectrum.sum(), 1, rtol=1e-12)


def test_what_a_ring_cannot_carry():
    """On 12 nodes n = 8 looks like 4; 6 cannot be told from its phase, and 10 is past `most`."""
    points = rings((0.5, 1.0), 12, start=0.0)
    shapes = np.array(
        [turned(0, 0, np.cos(n * polar(points)[1]), polar(points)[1]) for n in (8, 6)]
    )
    pattern = identify(points, shapes)
    assert pattern.spectrum.shape == (2, 6)
    assert (pattern.diameter[0], pattern.share[0]) == (4, pytest.approx(1))
    np.testing.assert_allclose(pattern.spectrum[1], 0, atol=1e-12)
    assert identify(points, shapes, most=3).share[0] < 1e-12


def test_the_spectrum_ends_at_what_a_third_of_the_weight_carries():
    """A gap of two pitches counts as a ring of half the nodes; one rich ring is not enough."""
    points = rings((0.5, 1.0), 24)
    shape = turned(0, 0, np.cos(2 * polar(points)[1]), polar(points)[1])[None]
    assert identify(points, shape).spectrum.shape[1] - 1 == 11
    some = np.arange(48) % 4 > 0
    assert identify(points[some], shape[:, some]).spectrum.shape[1] - 1 == 5
    rich = np.vstack([rings((0.2, 0.5, 1.0), 24), rings((0.8,), 48)])
    shape = turned(0, 0, np.cos(2 * polar(rich)[1]), polar(rich)[1])[None]
    most = [
        identify(rich, shape, weights=w).spectrum.shape[1] - 1
        for w in (np.ones(120), np.repeat((1, 0.6), (72, 48)))
    ]
    assert most == [20, 11]


def test_circles_are_counted_within_the_toothed_face():
    """A shaft that bends moves along the axis to and fro over its length, at its surface."""
    body, shaft = rings(np.linspace(0.2, 1, 9), 24, (-0.1, 0.1)), rings((0.2,), 24, (1.0, 2.0, 3.0))
    points = np.vstack([body, shaft])
    r, angle = polar(points)
    axial = r * np.cos(angle) * np.where(points[:, 2] > 0.5, -3.0, 1.0)
    pattern = identify(points, turned(0, 0, axial, angle)[None])
    assert (pattern.diameter[0], pattern.circle[0], pattern.covered) == (1, 0, 1)


def test_motion_that_has_no_mean_over_the_face_has_no_circles_but_rounding():
    """Opposite at both sides of a wheel: what is left of the mean must not be counted."""
    points = rings(np.linspace(0.4, 1.0, 7), 24, (-0.1, 0.0, 0.1))
    radius, angle = polar(points)
    shape = turned(0, 0, np.cos(3 * angle) * points[:, 2] * np.cos(9 * radius), angle)
    noise = 1e-12 * np.random.default_rng(1).normal(size=(5, *shape.shape))
    assert list(identify(points, shape + noise).circle) == [0] * 5


@pytest.mark.parametrize("points", [rings(np.linspace(0.2, 1, 8), 20), scattered(0.05, (0.0,))])
def test_neither_units_nor_phase_nor_the_turn_of_the_body_matter(points):
    def pattern_of(points, phase, unit):
        shape = plate_shape(points, 3, PLATE[3][1], phase)
        weights = 1 / (2 + np.hypot(points[:, 0], points[:, 1]))
        return identify(unit * points, shape[None] / unit, weights=weights * unit**3, most=8)

    plain = pattern_of(points, 0.4, 1.0)
    cos, sin = np.cos(0.3), np.sin(0.3)
    spun = points @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    for other in (pattern_of(points, 0.4, 1e-3), pattern_of(spun, 0.4 + 3 * 0.3, 1.0)):
        np.testing.assert_allclose(other.spectrum, plain.spectrum, rtol=0, atol=1e-9)
        assert other.circle[0] == plain.circle[0] == 1
    assert pattern_of(points, np.pi / 2, 1.0).circle[0] == 1


def test_rings_that_holes_interrupt_are_left_out():
    """Six holes take half of a ring: a fit there would be free to do anything inside them."""
    points = rings(np.linspace(0.2, 1, 9), 96)
    r, angle = polar(points)
    hole = (abs(r - 0.6) < 0.15) & (np.cos(6 * angle) > 0)
    points, r, angle = points[~hole], r[~hole], angle[~hole]
    shapes = np.array([turned(0, 0, (r - 0.55) * np.cos(n * angle), angle) for n in range(12)])
    pattern = identify(points, shapes)
    assert pattern.covered == pytest.approx(6 / 7.5)
    assert list(pattern.diameter) == list(range(12))
    assert set(pattern.circle) == {1}
    assert pattern.share.min() > 1 - 1e-9


def test_which_pairs_split_by_hand():
    assert [n for n in range(13) if expected_split(n, 6)] == [3, 6, 9, 12]
    assert [n for n in range(13) if expected_split(n, 5)] == [5, 10]
    assert [n for n in range(9) if expected_split(n, 4)] == [2, 4, 6, 8]
    assert [n for n in range(5) if expected_split(n, 1)] == [1, 2, 3, 4]
    assert not any(expected_split(n, 0) for n in range(9))


def test_families_and_pairs():
    points = rings(np.linspace(0.2, 1, 8), 20)
    r, angle = polar(points)

    def wave(n, phase, axial=0, radial=0):
        return turned(
            radial * np.cos(n * angle - phase), 0, axial * np.cos(n * angle - phase), angle
        )

    shapes = np.array(
        [
            wave(3, 0.1, axial=1),
            wave(2, 0.2, axial=1),
            wave(2, 0.2 + np.pi / 4, axial=1),
            wave(2, 0.0, axial=r - 0.6),
            wave(4, 0.0, radial=1),
            wave(3, 0.1 + np.pi / 6, axial=1),
            wave(0, 0.0, axial=1),
        ]
    )
    frequency = np.array([300.0, 101.0, 99.0, 250.0, 900.0, 300.0, 0.0])
    pattern = identify(points, shapes)
    found = families(pattern, frequency)
    assert [(each.kind, each.circle, list(each.modes)) for each in found] == [
        ("axial", 0, [6, 2, 1, 0, 5]),
        ("axial", 1, [3]),
        ("radial", 0, [4]),
    ]
    assert list(found[0].diameter) == [0, 2, 2, 3, 3]
    assert list(found[0].frequency) == [0, 99, 101, 300, 300]
    assert symmetry_splitting(pattern, frequency) == ((2, 1, pytest.approx(0.02)), (0, 5, 0.0))


def disc_grid(radii, sectors, heights, kept=lambda i, j, k: True):
    """Swept bricks between radii and heights, those left out that are not `kept`."""
    corner = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    place = np.vstack([corner, np.add(corner, (0, 0, 1)), np.zeros((12, 3))])
    place[EDGES[:, 2]] = (place[EDGES[:, 0]] + place[EDGES[:, 1]]) / 2
    cells = np.ndindex(len(radii) - 1, sectors, len(heights) - 1)
    cells = np.array([cell for cell in cells if kept(*cell)])[:, None, :]
    r, z = (
        x[cells[..., c]] + np.diff(x)[cells[..., c]] * place[:, c]
        for x, c in ((np.asarray(radii), 0), (np.asarray(heights), 2))
    )
    t = 2 * np.pi * (cells[..., 1] + place[:, 1] - 0.5) / sectors
    nodes = np.stack([r * np.cos(t), r * np.sin(t), z], axis=-1).reshape(-1, 3)
    return Grid(*merged(nodes, np.arange(len(nodes)).reshape(-1, 20), 1e-7))


def modes_of(grid, count):
    """Frequencies [rad/s] and pattern of the lowest elastic modes."""
    material = Material(young=2.1e11, poisson=0.3, density=7850.0)
    stiffness, mass = assemble(grid, material)
    square, shapes = lowest_modes(stiffness, mass, count + 6, 3000.0)
    shapes = shapes[:, 6:].T.reshape(count, -1, 3)
    return np.sqrt(square[6:]), identify(grid.nodes, shapes, weights=mass.diagonal()[::3])


RADII = np.linspace(0.03, 0.1, 6)
HEIGHTS = np.array([-0.001, 0.001])


def test_modes_of_the_free_annulus():
    frequency, pattern = modes_of(disc_grid(RADII, 40, HEIGHTS), 24)
    bending = 2.1e11 * 0.002**3 / 12 / (1 - 0.3**2)
    value = frequency * 0.1**2 * np.sqrt(7850 * 0.002 / bending)
    exact = sorted(
        (value, n, s + circles(n))
        for n, row in ANNULUS.items()
        for s, value in enumerate(row)
        for _ in range(1 if n == 0 else 2)
        if value < 55
    )
    # Modes of six and more diameters, beyond the table, are among them.
    listed = [mode for mode, n in enumerate(pattern.diameter) if n < 6][: len(exact)]
    assert len(listed) == len(exact) == 16
    assert [(pattern.diameter[m], pattern.circle[m]) for m in listed] == [e[1:] for e in exact]
    np.testing.assert_allclose(value[listed], [e[0] for e in exact], rtol=0.02)
    assert pattern.share.min() > 0.999
    assert max(gap for *_, gap in symmetry_splitting(pattern, frequency)) < 1e-9


@pytest.mark.parametrize(("holes", "every"), [(6, 4), (4, 6)])
def test_holes_split_the_pairs_that_symmetry_says(holes, every):
    grid = disc_grid(RADII, 24, HEIGHTS, lambda i, j, k: i not in (2, 3) or j % every > 0)
    frequency, pattern = modes_of(grid, 24)
    assert pattern.covered < 0.5
    assert pattern.share.min() > 0.85
    found = [
        (int(pattern.diameter[i]), gap) for i, _, gap in symmetry_splitting(pattern, frequency)
    ]
    split, paired = {n for n, gap in found if gap > 1e-4}, {n for n, gap in found if gap < 1e-8}
    assert all(gap > 1e-4 or gap < 1e-8 for _, gap in found)
    assert split == {n for n in split | paired if expected_split(n, holes)}
    assert not split & paired
    assert split | paired >= {1, 2, 3, 4, 5, 6}
    # A mode of n = 5 has a trace of 5 - h, 5 + h and so on, and of nothing else.
    n = 5
    mode = int(np.flatnonzero(pattern.diameter == n)[0])
    others = np.arange(pattern.spectrum.shape[1])
    mixed = ((others - n) % holes == 0) | ((others + n) % holes == 0)
    assert pattern.spectrum[mode, ~mixed].max() < 1e-12
    assert np.sort(pattern.spectrum[mode, mixed])[-2] > 1e-4


def test_directions_of_the_modes_of_a_wheel():
    radii, heights = (0.01, 0.018, 0.03, 0.042, 0.052, 0.06), (-0.006, -0.0015, 0.0015, 0.006)
    grid = disc_grid(radii, 16, heights, lambda i, j, k: i in (0, 4) or k == 1)
    frequency, pattern = modes_of(grid, 36)
    del frequency
    found = list(zip(pattern.diameter, pattern.circle, pattern.kind, strict=True))
    assert found[:3] == [(2, 0, "axial"), (2, 0, "axial"), (0, 1, "axial")]
    # The rim bends in its plane, n^2 : 1 in radial and tangential energy, and the wheel breathes.
    assert (2, 0, "radial") in found
    assert (0, 0, "radial") in found
    radial = pattern.direction[found.index((3, 0, "radial"))]
    assert 0.1 * 0.7 < radial[1] < 0.1 * 1.8


def test_mistakes_are_named():
    points = rings((0.5, 1.0), 12)
    shape = np.ones((1, 24, 3))
    with pytest.raises(BodyError, match=r"\[mode, 24, 3\].*got \[24, 3\]"):
        identify(points, shape[0])
    with pytest.raises(BodyError, match="not its row sums"):
        identify(points, shape, weights=-np.ones(24))
    with pytest.raises(BodyError, match="must move, 1 do not"):
        identify(points, 0 * shape)
    with pytest.raises(BodyError, match="Check that z is the axis"):
        identify(points[:, [2, 0, 1]] + [5, 0, 0], shape)
