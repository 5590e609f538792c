"""Bodies that a rotation leaves as they are, taken apart by the number of waves around."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from fem_cases import STEEL, assert_near, pulls_on, small_wheel, web_probe, wheel_body
from helpers import quick
from scipy.sparse import csr_array

from fem_prep import _grounded
from fem_prep._boundary import full_body, recoupled
from fem_prep._condense import condense
from fem_prep._grounded import grounded
from fem_prep._hold import fixed_interface
from fem_prep._modes import free_modes, largest_rotation, lowest_modes, reduced_modes
from fem_prep._seats import Seat
from fem_prep._symmetry import Rotation, full_turn, waves_of
from fem_prep._web import GearBody, MeshSizing, body_grid


def turning(sectors, each=4, axis=2):
    """A rotation of points in no order, some of them on the axis."""
    count = sectors * each + axis
    image = np.arange(count)
    ring = image[: sectors * each].reshape(sectors, each)
    image[ring.ravel()] = np.roll(ring, -1, axis=0).ravel()
    shuffled = np.random.default_rng(sectors).permutation(count)
    result = np.empty(count, dtype=int)
    result[shuffled] = shuffled[image]
    return Rotation(sectors, result)


def unchanging(rotation, seed):
    """A full matrix that does not change when its points turn."""
    size = 3 * len(rotation.image)
    start = np.random.default_rng(seed).standard_normal((size, size))
    turns = [rotation.turned(np.eye(size), times) for times in range(rotation.sectors)]
    return np.sum([turn @ start @ turn.T for turn in turns], axis=0)


EVERY_NUMBER = pytest.mark.parametrize("sectors", [1, 2, 3, 4, 7, 8])


@EVERY_NUMBER
def test_motions_come_together_again(sectors):
    waves = waves_of(turning(sectors))
    motions = np.random.default_rng(0).standard_normal((3 * len(waves.rotation.image), 5))
    parts, weights = waves.parts(motions), waves.weights
    assert_near(waves.whole(parts), motions, 1e-14)
    assert np.dot(weights, [len(part) for part in parts]) == len(motions)
    products = [np.real(part.conj().T @ part) for part in parts]
    assert_near(np.tensordot(weights, products, axes=1), motions.T @ motions, 1e-14)


@EVERY_NUMBER
def test_matrices_do_not_mix_waves(sectors):
    """Parts of the forces are each matrix times that part of the motion."""
    waves = waves_of(turning(sectors))
    matrix = unchanging(waves.rotation, 1)
    motions = np.random.default_rng(0).standard_normal((len(matrix), 3))
    pairs = zip(waves.matrices(csr_array(matrix)), waves.parts(motions), strict=True)
    assert_near(waves.whole([each @ part for each, part in pairs]), matrix @ motions, 1e-13)


def test_a_turn_changes_only_the_phase():
    waves = waves_of(turning(5))
    motions = np.random.default_rng(0).standard_normal((3 * len(waves.rotation.image), 2))
    turned = waves.parts(waves.rotation.turned(motions, 1))
    for number, (before, after) in enumerate(zip(waves.parts(motions), turned, strict=True)):
        assert_near(after, np.exp(-2j * math.pi * number / 5) * before, 1e-14)


@functools.cache
def wheel(seats):
    return wheel_body(small_wheel(12), seats)


@pytest.mark.parametrize(("seats", "sectors"), [("ring", 12), ("mean", 3), ("none", 2)])
def test_modes_by_waves_are_those_of_the_whole_body(seats, sectors):
    full = wheel(seats)
    rotation = full.rotation(sectors)
    want, _ = free_modes(full, 40, rotation=full_turn(full.points))
    square, shapes = free_modes(full, 40, rotation=rotation)
    np.testing.assert_allclose(square, want, rtol=1e-8)
    assert_near(shapes.T @ (full.mass @ shapes), np.eye(40), 1e-10)
    left = full.stiffness @ shapes - (full.mass @ shapes) * square
    assert abs(left).max() < 1e-10 * abs(full.stiffness).max() * abs(shapes).max()


def rings(grounds, link):
    """Six equal masses on each of some rings, tied to the ground and to their neighbours."""
    count = len(grounds)
    rotation = turning(6, each=count // 3, axis=0)
    around = np.roll(np.eye(6), 1, axis=1)
    local = np.kron(np.eye(6), np.diag(grounds))
    local += link * np.kron(2 * np.eye(6) - around - around.T, np.eye(count))
    frames = np.zeros((6 * count, 6 * count))
    for sector, (turn, points) in enumerate(zip(rotation.matrices, rotation.orbits(), strict=True)):
        own = slice(count * sector, count * (sector + 1))
        rows = (3 * points[:, None] + np.arange(3)).ravel()
        frames[rows, own] = np.kron(np.eye(len(points)), turn)
    return csr_array(frames @ local @ frames.T), rotation


def test_all_modes_may_have_one_number_of_waves():
    """Links that are stiff leave only motions of whole rings, more than are sought at first."""
    grounds = np.arange(1.0, 61.0)
    stiffness, rotation = rings(grounds, 1e5)
    mass = csr_array(np.eye(stiffness.indptr.size - 1))
    square, shapes = lowest_modes(stiffness, mass, 50, 1.0, rotation)
    np.testing.assert_allclose(square, grounds[:50], rtol=1e-9)
    assert_near(shapes.T @ shapes, np.eye(50), 1e-10)
    # With weak ones there are six of each, two real ones to a number of waves.
    stiffness, rotation = rings(grounds, 1e-6)
    square, _ = lowest_modes(stiffness, mass, 50, 1.0, rotation)
    np.testing.assert_allclose(square, np.repeat(grounds, 6)[:50], rtol=1e-5)


@functools.cache
def solid():
    """A disc with nodes on its axis, on a ring of its face."""
    grid = body_grid(
        GearBody(rim_outer=60e-3, rim_width=12e-3), MeshSizing(sectors=12, web_radial=3)
    )
    near = (grid.nodes[:, 2] < -5.9e-3) & (grid.radius > 12e-3) & (grid.radius < 24e-3)
    seat = Seat("face", np.flatnonzero(near), np.array([0, 0, -6e-3]))
    probes = {"web": web_probe(grid), "axis": int(np.argmin(grid.radius + abs(grid.nodes[:, 2])))}
    return full_body("solid", grid, STEEL, [seat], probes=probes)


@pytest.mark.slow
@pytest.mark.parametrize(("sectors", "averaging"), quick(1, [(6, False), (3, True), (2, False)]))
def test_a_solid_body_sector_by_sector(sectors, averaging):
    """Points on the axis belong to all sectors: waves of none and of one move them."""
    plain = solid()
    seats = [Seat("face", plain.seats[0].nodes, plain.seats[0].point, averaging)]
    full = full_body("solid", plain.grid, STEEL, seats, probes=plain.probes)
    assert largest_rotation(full).sectors == 6
    one, every = (
        condense(full, modes=10, rotation=rotation, rotating=True)
        for rotation in (full.rotation(sectors), full_turn(full.points))
    )
    end = one.boundary_dofs
    for name in ("stiffness", "mass", "coriolis", "spin_softening", "stress_stiffening"):
        found, want = (getattr(body, name)[:end, :end] for body in (one, every))
        assert_near(found, want, 1e-10)
    assert_near(one.probe_rows[:, :, :end], every.probe_rows[:, :, :end], 1e-11)
    found, want = (reduced_modes(body, 16)[0][6:] for body in (one, every))
    np.testing.assert_allclose(found, want, rtol=1e-8)
    # Motions of the interior shapes, too, are those of the probes' nodes.
    moved = one.interior_shapes[:, list(full.probes.values())]
    assert_near(one.probe_rows[:, :, end:], np.moveaxis(moved, 0, 2), 1e-11)


def test_a_held_body_answers_to_any_load():
    """A load on one point has every number of waves."""
    full = solid()
    load = np.zeros((3 * full.points, 2))
    load[3 * full.probe_points[0], 0] = 1.0
    load[:, 1] = np.random.default_rng(0).standard_normal(len(load))
    rotations = (None, full_turn(full.points))
    found, want = (fixed_interface(full, rotation=each).loaded(load) for each in rotations)
    assert_near(found, want, 1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["herting", "craig-bampton"])
def test_a_body_that_is_held_already_is_not_held_again(method):
    full = wheel("ring")
    held = fixed_interface(full, rotation=full.rotation(4))
    bodies = [condense(full, method=method, modes=5, held=each) for each in (held, None)]
    assert [body.facts["sectors"] for body in bodies] == [4, 12]
    found, want = (reduced_modes(body, 30)[0][6:] for body in bodies)
    np.testing.assert_allclose(found, want, rtol=1e-9)


# --- Condensed


@functools.cache
def small(around, seats):
    full = wheel_body(small_wheel(around), seats)
    return full, condense(full, modes=10)


def as_is(body):
    return body


def untold(body):
    """The body without what it says of its sectors."""
    return replace(body, facts={})


def uneven(body):
    """The body with one number of a row of the second sector, and its twin, a little off."""
    stiffness = body.stiffness.copy()
    stiffness[40, 41] = stiffness[41, 40] = stiffness[40, 41] * (1 + 1e-9)
    return replace(body, stiffness=stiffness)


@pytest.mark.parametrize(
    ("around", "seats", "change", "taken_apart"),
    [
        (12, "ring", as_is, True),
        (9, "mean", as_is, True),
        (3, "ring", as_is, True),
        (8, "both", as_is, False),
        (12, "none", as_is, True),
        (12, "ring", uneven, False),
        (12, "ring", untold, False),
    ],
)
def test_modes_of_a_condensed_body_are_those_of_its_full_matrices(
    around, seats, change, taken_apart, monkeypatch
):
    full, body = small(around, seats)
    body, pulls = change(body), np.pad(pulls_on(full), [(0, 0), (0, body.interior)])
    whole = []
    factor = scipy.linalg.cho_factor
    monkeypatch.setattr(
        scipy.linalg, "cho_factor", lambda *args, **how: whole.append(1) or factor(*args, **how)
    )
    for springs in (None, pulls):
        added = 0.0 if springs is None else springs.T @ springs
        want = scipy.linalg.eigh(body.stiffness + added, body.mass, eigvals_only=True)[:30]
        square, shapes = reduced_modes(body, 30, springs)
        start = 6 if springs is None or seats == "none" else 0
        np.testing.assert_allclose(square[start:], want[start:], rtol=1e-8)
        assert_near(shapes.T @ (body.mass @ shapes), np.eye(30), 1e-10)
        left = (body.stiffness + added) @ shapes - (body.mass @ shapes) * square
        assert abs(left).max() < 1e-10 * abs(body.stiffness).max() * abs(shapes).max()
    assert (not whole) == taken_apart


# --- On supports


def balanced(full):
    """Two loads that balance each other, and have every number of waves."""
    load, rigid = np.random.default_rng(2).standard_normal((3 * full.points, 2)), full.rigid_motions
    return load - rigid @ np.linalg.solve(rigid.T @ rigid, rigid.T @ load)


def tied(full):
    """The body with two nodes of its rim tied by a spring along the line between them."""
    first, last = full.rim[[0, 7]]
    line = full.grid.nodes[last] - full.grid.nodes[first]
    pull = np.zeros(3 * full.points)
    pull[3 * full.rim_points[0] + np.arange(3)] = -line
    pull[3 * full.rim_points[7] + np.arange(3)] = line
    row = csr_array(pull[None] / np.linalg.norm(line))
    return replace(full, stiffness=csr_array(full.stiffness + 1e8 * (row.T @ row)))


@pytest.mark.parametrize("sectors", [12, 4, 3, 2, 1])
@pytest.mark.parametrize("seats", ["ring", "mean"])
@pytest.mark.parametrize("change", [as_is, tied], ids=["equal", "tied"])
def test_supports_of_a_free_body_carry_nothing(seats, sectors, change, monkeypatch):
    """Whether its sectors are equal, or only say so while a tie is in one of them."""
    full = change(wheel(seats))
    monkeypatch.setattr(_grounded, "largest_rotation", lambda full: full.rotation(sectors))
    load = balanced(full)
    motion = grounded(full).factor.solve(load)
    assert_near(full.stiffness @ motion, load, 1e-8)


def test_the_other_coupling_is_that_of_a_body_made_so():
    full = solid()
    seat = replace(full.seats[0], averaging=True)
    want = full_body("solid", full.grid, STEEL, [seat])
    found = recoupled(full)
    for name in ("stiffness", "mass", "averages", "spread"):
        assert abs(getattr(found, name) - getattr(want, name)).max() == 0
    np.testing.assert_array_equal(found.rim_points, want.rim_points)
    assert (found.seats[0].averaging, found.probes) == (True, {})
    again = recoupled(found)
    assert abs(again.stiffness - full.stiffness).max() == 0
    np.testing.assert_array_equal(again.rim_points, full.rim_points)
