"""Feet of slices on the rim: rigid motions, resultants, the mortar's patch test, and the thesis's
connection in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jaxgear._interface._roots import (
    InterfaceMap,
    RimSurface,
    RootPatches,
    interface_map,
    serendipity,
)

RADIUS, HALF = 25e-3, 5e-3
AROUND = 24
HEIGHTS = HALF * np.array([-1.2, -0.4, 0.1, 0.5, 1.2])


def _rim(around: int = AROUND, heights: np.ndarray = HEIGHTS, skew: float = 0.0) -> RimSurface:
    """Elements between planes and meridians; skewed ones lean, and their planes wave."""
    fine = np.interp(np.arange(2 * len(heights) - 1) / 2, np.arange(len(heights)), heights)
    levels, columns = len(fine), 2 * around
    level, column = np.meshgrid(np.arange(levels), np.arange(columns), indexing="ij")
    # An element's middle lies on x, and another across the angle where atan2 jumps.
    angle = (column - 1) * np.pi / around
    z = fine[level]
    inside = 1.0 - (z / heights[-1]) ** 2
    angle = angle + skew * (z / RADIUS + 0.03 * np.sin(3 * angle))
    z = z + skew * 0.2 * HALF * inside * np.cos(2 * angle)
    number = level * columns + column
    nodes = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), z], axis=-1)
    at = lambda up, on: number[up, (on) % columns]
    bottom, left = np.meshgrid(range(0, levels - 1, 2), range(0, columns, 2), indexing="ij")
    bottom, left = bottom.ravel(), left.ravel()
    ups, ons = [0, 0, 2, 2, 0, 1, 2, 1], [0, 2, 2, 0, 1, 2, 1, 0]
    faces = np.stack([at(bottom + up, left + on) for up, on in zip(ups, ons, strict=True)], axis=1)
    # Nodes in the middles of elements belong to none of 8 nodes.
    used, faces = np.unique(faces, return_inverse=True)
    return RimSurface(nodes.reshape(-1, 3)[used], faces.reshape(-1, 8))


def _patches(slices: int = 5, helix: float = 0.0, **others) -> RootPatches:
    edges = np.linspace(-HALF, HALF, slices + 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    teeth = 2.0 * np.pi / 20 * np.array([0, 1, 3, 7, 10, 19])
    angles = teeth[:, None] + helix * middles / RADIUS
    return RootPatches(angles, edges, width=4.5e-3, **others)


def _frames(patches: RootPatches) -> np.ndarray:
    """Components along radius, tangent and axis of each foot from those in the body."""
    angle = patches.angles.ravel()
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0] = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    turn[:, 1] = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    turn[:, 2, 2] = 1.0
    return turn


def _near(found: np.ndarray, wanted: np.ndarray, share: float) -> None:
    off, size = np.abs(found - wanted).max(), np.abs(wanted).max()
    assert off <= share * size, f"off by {off / size:.3g} of {size:.3g}"


# --- Shape functions

NODES = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0)], float)


def test_shape_functions_are_one_at_their_own_node_and_sum_to_one():
    np.testing.assert_allclose(serendipity(NODES)[0], np.eye(8), rtol=0, atol=1e-15)
    values, slopes = serendipity(np.random.default_rng(0).uniform(-1, 1, (50, 2)))
    np.testing.assert_allclose(values.sum(axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(slopes.sum(axis=1), 0.0, rtol=0, atol=1e-14)


def test_shape_functions_hold_every_quadratic_and_two_cubics():
    at = np.random.default_rng(1).uniform(-1, 1, (50, 2))
    for i, j in [(1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2)]:
        field = lambda p, i=i, j=j: p[:, 0] ** i * p[:, 1] ** j
        np.testing.assert_allclose(serendipity(at)[0] @ field(NODES), field(at), atol=1e-14)


def test_slopes_of_the_shape_functions():
    at, step = np.random.default_rng(2).uniform(-1, 1, (20, 2)), 1e-6
    for axis in range(2):
        move = step * np.eye(2)[axis]
        central = (serendipity(at + move)[0] - serendipity(at - move)[0]) / (2 * step)
        np.testing.assert_allclose(serendipity(at)[1][..., axis], central, atol=1e-9)


# --- Rigid motions and resultants

every_connection = pytest.mark.parametrize(
    ("points", "axial"), [(2, "mortar"), (3, "mortar"), (4, "mortar"), (4, "collocation")]
)
# Two points a hair apart along the axis give a slope with fewer digits.
_DIGITS = {"mortar": 3e-10, "collocation": 1e-8}
every_grid = pytest.mark.parametrize(
    ("points", "axial", "skew"),
    [(2, "mortar", 0.0), (4, "mortar", 0.0), (4, "collocation", 0.0), (3, "mortar", 0.5)],
)


@every_grid
def test_feet_follow_every_rigid_motion(points, axial, skew):
    rim, patches = _rim(skew=skew), _patches(helix=0.4, points=points, axial=axial)
    found, turn = interface_map(rim, patches), _frames(patches)
    places = np.einsum("fji,fj->fi", turn, found.centres)
    for move in np.eye(6):
        at_rim = move[:3] + np.cross(move[3:], rim.nodes)
        wanted = np.concatenate(
            [
                np.einsum("fij,fj->fi", turn, move[:3] + np.cross(move[3:], places)),
                np.einsum("fij,j->fi", turn, move[3:]),
            ],
            axis=1,
        )
        _near((found.rows @ at_rim.ravel()).reshape(-1, 6), wanted, _DIGITS[axial])


@every_connection
def test_feet_stand_in_the_middle_of_their_patches(points, axial):
    patches = _patches(helix=0.4, points=points, axial=axial)
    centres = interface_map(_rim(), patches).centres.reshape(*patches.angles.shape, 3)
    # The middle of an arc, as wide as the patch, lies below the arc.
    sagitta = patches.width**2 / (8.0 * RADIUS)
    assert ((centres[..., 0] < RADIUS) & (centres[..., 0] > RADIUS - sagitta)).all()
    # The rim's elements are parabolas, and lie off the circle by micrometres.
    np.testing.assert_allclose(centres[..., 1], 0.0, atol=1e-3 * patches.width)
    middles = 0.5 * (patches.edges[1:] + patches.edges[:-1])
    np.testing.assert_allclose(centres[..., 2], np.broadcast_to(middles, (6, 5)), atol=1e-12)


@every_grid
def test_what_loads_the_feet_loads_the_rim(points, axial, skew):
    rim, patches = _rim(skew=skew), _patches(helix=-0.4, points=points, axial=axial)
    found, turn = interface_map(rim, patches), _frames(patches)
    load = np.random.default_rng(3).normal(size=(patches.angles.size, 2, 3)) * [[[1.0], [5e-3]]]
    on_rim = (found.rows.T @ load.ravel()).reshape(-1, 3)
    force, moment = np.moveaxis(np.einsum("fji,fkj->fki", turn, load), 1, 0)
    places = np.einsum("fji,fj->fi", turn, found.centres)
    _near(on_rim.sum(axis=0), force.sum(axis=0), _DIGITS[axial])
    wanted = (moment + np.cross(places, force)).sum(axis=0)
    _near(np.cross(rim.nodes, on_rim).sum(axis=0), wanted, _DIGITS[axial])


def test_the_frame_of_a_foot_turns_with_its_tooth():
    # A rim that repeats from tooth to tooth has the same rows in every tooth's own frame.
    rim = _rim(around=20)
    patches = _patches(slices=3)
    rows = interface_map(rim, patches).rows.toarray().reshape(6, 3, 6, -1, 3)
    for tooth in range(1, 6):
        turn = _frames(replace(patches, angles=patches.angles[tooth, :1]))[0]
        image = rim.nodes @ turn.T
        order = [np.argmin(((rim.nodes - at) ** 2).sum(axis=1)) for at in image]
        own = np.zeros_like(rows[0])
        own[:, :, order] = np.einsum("skni,ji->sknj", rows[tooth], turn)
        _near(own, rows[0], 1e-10)


# --- The thesis's connection


def test_two_points_are_the_thesis_s_connection():
    """Physics C 11: u from both points, omega = (u1 - u2).(d x Z)/|d|^2, S_f / sqrt 3 apart."""
    rim, patches = _rim(), _patches(slices=3, points=2)
    heights = rim.nodes[:, 2]
    angle = np.arctan2(rim.nodes[:, 1], rim.nodes[:, 0])
    # Away from the jump of the angle these are linear around, and parabolic along.
    slopes = np.random.default_rng(4).normal(size=(4, 3))
    field = lambda a, z: np.stack([a, z / HALF, (z / HALF) ** 2, a * z / HALF], axis=-1) @ slopes
    tooth = 2
    found = interface_map(rim, replace(patches, angles=patches.angles[tooth : tooth + 1]))
    got = (found.rows @ field(angle, heights).ravel()).reshape(-1, 6)
    middle = patches.angles[tooth, 0]
    turn = _frames(patches)[3 * tooth]
    apart = patches.width / math.sqrt(3.0) / RADIUS
    on_element = math.pi / AROUND
    for slice_, (low, high) in enumerate(zip(patches.edges[:-1], patches.edges[1:], strict=True)):
        mean, square = 0.5 * (low + high), (low**2 + low * high + high**2) / 3.0
        ends, moved = [], []
        for side in (-0.5, 0.5):
            a = middle + side * apart
            own = (a + on_element) % (2 * on_element) - on_element
            corner = a - own + on_element * NODES[:, 0]
            places = RADIUS * np.stack([np.cos(corner), np.sin(corner), 0 * corner], axis=1)
            ends.append(serendipity(np.array([[own / on_element, 0.0]]))[0][0] @ places)
            moved.append(np.array([a, mean / HALF, square / HALF**2, a * mean / HALF]) @ slopes)
        d = ends[1] - ends[0]
        omega = (moved[0] - moved[1]) @ np.cross(d, [0, 0, 1]) / (d @ d)
        _near(got[slice_, :3], turn @ (0.5 * (moved[0] + moved[1])), 1e-11)
        assert got[slice_, 5] == pytest.approx(omega, rel=1e-10)
        assert np.linalg.norm(d) == pytest.approx(apart * RADIUS, rel=3e-3)


# --- The patch test (thesis fig. II-21 and II-22)

ELEMENTS = 6


def _uniform(slices: int, axial: str, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radial loads of the rim's levels under a uniform line load of 1, and the exact ones."""
    rim = _rim(heights=heights)
    patches = _patches(slices, axial=axial)
    some = replace(patches, angles=patches.angles[:1])
    force = np.zeros((slices, 6))
    force[:, 0] = np.diff(patches.edges)
    on_rim = (interface_map(rim, some).rows.T @ force.ravel()).reshape(-1, 3)
    levels, place = np.unique(np.round(rim.nodes[:, 2], 12), return_inverse=True)
    exact = np.zeros(len(levels))
    for number, length in enumerate(np.diff(heights)):
        exact[2 * number : 2 * number + 3] += length / 6.0 * np.array([1.0, 4.0, 1.0])
    return np.bincount(place.ravel(), on_rim[:, 0]), exact


def _error(slices: int, axial: str, heights: np.ndarray | None = None) -> float:
    """Largest error of a nodal load over its exact value [-]."""
    heights = np.linspace(-HALF, HALF, ELEMENTS + 1) if heights is None else heights
    found, exact = _uniform(slices, axial, heights)
    return float(np.abs(found / exact - 1.0).max())


@pytest.mark.parametrize("slices", [1, 8, 12, 25, 40])
def test_mortar_takes_a_uniform_load_to_rounding(slices):
    assert _error(slices, "mortar") < 1e-12
    uneven = HALF * np.array([-1.0, -0.83, -0.2, 0.31, 0.4, 1.0])
    assert _error(slices, "mortar", uneven) < 1e-11


@pytest.mark.parametrize(("slices", "most"), [(8, 0.30), (12, 0.25), (25, 0.089), (40, 0.016)])
def test_collocation_has_spikes(slices, most):
    """Physics B7 has the errors."""
    assert 0.5 * most < _error(slices, "collocation") < 1.05 * most


# --- What is refused


def test_slices_off_the_rim_are_refused():
    edges = np.linspace(-1.3 * HALF, 1.1 * HALF, 7)
    patches = replace(_patches(6), edges=edges)
    with pytest.raises(ValueError, match=r"must be attached to the rim.*reaches from -6 to 6 mm"):
        interface_map(_rim(), patches)


def test_a_rim_with_a_gap_is_refused():
    rim = _rim()
    middle = rim.nodes[rim.faces[:, :4]].mean(axis=1)
    with pytest.raises(ValueError, match=r"Is the rim's set of nodes complete"):
        interface_map(replace(rim, faces=rim.faces[middle[:, 1] > -0.2 * RADIUS]), _patches())


def test_rows_are_sparse_and_of_the_rim_alone():
    found: InterfaceMap = interface_map(_rim(), _patches(slices=2))
    assert found.rows.shape == (6 * 12, 3 * len(_rim().nodes))
    # A foot sees the elements under its patch, no other.
    assert np.diff(found.rows.indptr).max() < 300
