"""Condensed bodies against full ones: a small wheel, of 2,000 degrees of freedom."""

import contextlib
import functools
from dataclasses import replace

import numpy as np
import pytest
from fem_cases import (
    STEEL,
    answer,
    assert_near,
    boundary_rows,
    dofs,
    lattice,
    on_springs,
    padded,
    pulls_on,
    rotating_terms,
    small_wheel,
    springs_on,
    sprung_modes,
    tooth_load,
    web_probe,
    wheel_body,
)
from helpers import quick
from scipy.sparse import csc_array, diags_array

from fem_prep._artefact import inertia_relief, rigid_motions
from fem_prep._assembly import across, coriolis, order, stress_stiffening
from fem_prep._boundary import Teeth, full_body
from fem_prep._checks import BodyError
from fem_prep._condense import condense
from fem_prep._grid import Grid, merged
from fem_prep._hold import displacement_rows, fixed_interface, recovered_displacements
from fem_prep._modes import free_modes, largest_rotation, lowest_modes, reduced_modes
from fem_prep._seats import Seat
from fem_prep._solvers import available_solvers, factorise
from fem_prep._symmetry import Rotation

SEATS = ["ring", "mean", "both", "none"]


@functools.cache
def wheel(seats="ring", around=8):
    grid = small_wheel(around)
    return wheel_body(grid, seats, probes={"web": web_probe(grid), "hub": hub_node(grid)})


def hub_node(grid):
    return int(np.argmin(abs(grid.radius - 22.5e-3) + abs(grid.nodes[:, 2] - 4.75e-3)))


@functools.cache
def condensed(seats="ring", method="herting", modes=40, rotating=False):
    return condense(wheel(seats), method=method, modes=modes, rotating=rotating)


@functools.cache
def held(seats):
    return fixed_interface(wheel(seats))


@functools.cache
def free_of(seats):
    return free_modes(wheel(seats), 32)[0]


def general(full):
    """No rotation: every column of the rim is solved for."""
    return Rotation(1, np.arange(full.points))


# ----------------------------------------------------------------------- the projection


@pytest.mark.parametrize("seats", ["ring", "both", "none"])
def test_rows_of_nodes_are_what_all_motions_do_there(seats):
    full, body = wheel(seats), condensed(seats, modes=6, rotating=True)
    shapes = recovered_displacements(held(seats), body, np.eye(body.dofs))
    nodes = np.arange(3, len(full.grid.nodes), 41)
    rows = displacement_rows(held(seats), body, nodes)
    assert_near(rows, np.moveaxis(shapes[:, nodes], 0, 2), 1e-9)


@pytest.mark.parametrize("seats", ["ring", "both", "none"])
def test_every_matrix_is_the_full_one_in_the_shapes_of_the_coordinates(seats):
    """W'KW, W'MW and the rest, with the motion W of all nodes in unit coordinates."""
    full, body = wheel(seats), condensed(seats, modes=6, rotating=True)
    shapes = recovered_displacements(held(seats), body, np.eye(body.dofs))
    motion = shapes.reshape(body.dofs, -1).T
    growth = recovered_displacements(
        held(seats), body, inertia_relief(body, body.centrifugal_load)[:, None]
    )[0]
    stiffening = stress_stiffening(full.grid, full.material, growth)
    expected = {
        "mass": full.grid_mass,
        "coriolis": coriolis(full.grid_mass),
        "spin_softening": across(full.grid_mass),
    }
    for name, matrix in expected.items():
        assert_near(getattr(body, name), motion.T @ (matrix @ motion), 1e-10)
    # The grid's own stiffness, before seats are tied.
    stiffness = full_body("untied", full.grid, full.material, []).stiffness
    assert_near(body.stiffness, motion.T @ (stiffness @ motion), 1e-10)
    load = full.grid_mass @ (full.grid.nodes * [1, 1, 0]).ravel()
    assert_near(body.centrifugal_load, motion.T @ load, 1e-11)
    stiffened = motion.T @ (stiffening @ motion)
    forces = (stiffness @ growth.ravel() - load).reshape(-1, 3)
    for seat in full.seats:
        if not seat.averaging:
            # Forces on the nodes of a ring work along the second order of its turns too.
            product = forces[seat.nodes].T @ (full.grid.nodes[seat.nodes] - seat.point)
            turns = np.arange(body.dofs)[body.seat_dofs(seat.name)][3:]
            turning = (product + product.T) / 2 - np.trace(product) * np.eye(3)
            stiffened[np.ix_(turns, turns)] += turning
    assert body.stress_stiffening is not None
    assert_near(body.stress_stiffening, stiffened, 1e-10)
    for name, rows in zip(body.probes, body.probe_rows, strict=True):
        assert_near(rows, motion[dofs([full.probes[name]])], 1e-11)
    assert_near(rows_of_boundary(full) @ motion, np.eye(body.boundary_dofs, body.dofs), 1e-10)


def rows_of_boundary(full):
    """Coordinates of the boundary from the motion of the grid's nodes, by least squares."""
    rows = [np.eye(full.grid.dofs)[dofs(full.rim)]]
    for seat in full.seats:
        weights = full.grid_mass.diagonal()[dofs(seat.nodes)][:, None] ** 0.5
        fit = np.zeros((6, full.grid.dofs))
        motions = rigid_motions(full.grid.nodes[seat.nodes] - seat.point)
        fit[:, dofs(seat.nodes)] = np.linalg.pinv(weights * motions) * weights.T
        rows.append(fit)
    return np.concatenate(rows)


@pytest.mark.parametrize("seats", ["both", "none"])
def test_shapes_are_in_balance_inside_and_leave_the_boundary_alone(seats):
    """Constraint modes need forces at the boundary only, so K has no block between both."""
    full, rows = wheel(seats), boundary_rows(wheel(seats))
    boundary = order(rows)
    follow = held(seats).followed(np.eye(boundary))
    assert_near(rows @ follow, np.eye(boundary), 1e-11)
    force = full.stiffness @ follow
    # What is left when the best forces on the boundary are taken away.
    spread = rows.T.toarray()
    left = force - spread @ np.linalg.lstsq(spread, force)[0]
    assert abs(left).max() < 1e-11 * abs(full.stiffness).max()
    body = condensed(seats, modes=6, rotating=True)
    assert not body.stiffness[:boundary, boundary:].any()
    assert_near(body.stiffness[:boundary, :boundary], follow.T @ force, 1e-11)


@pytest.mark.parametrize("seats", SEATS)
def test_rigid_motions_survive(seats):
    full, body = wheel(seats), condensed(seats, modes=6, rotating=True)
    rigid = body.rigid_motions
    assert abs(body.stiffness @ rigid).max() < 1e-12 * abs(body.stiffness).max() * abs(rigid).max()
    moved = full.stiffness @ full.rigid_motions
    assert abs(moved).max() < 1e-12 * abs(full.stiffness).max() * abs(full.rigid_motions).max()
    assert_near(boundary_rows(full) @ full.rigid_motions, rigid[: body.boundary_dofs], 1e-13)
    exact = rigid_motions(full.grid.nodes)
    exact = exact.T @ (full.grid_mass @ exact)
    assert_near(full.rigid_motions.T @ (full.mass @ full.rigid_motions), exact, 1e-12)
    assert_near(rigid.T @ body.mass @ rigid, exact, 1e-11)
    # Every motion is one of the whole body, none is without mass.
    assert np.linalg.eigvalsh(body.mass)[0] > 0
    assert np.linalg.cond(body.mass) < 1e7
    for row, point in zip(body.probe_rows, body.probe_points, strict=True):
        assert_near(row @ rigid, rigid_motions(point[None]), 1e-11)


# ---------------------------------------------------------------- against the full body


@pytest.mark.parametrize("seats", ["ring", "both"])
def test_free_frequencies(seats):
    """Herting's modes are those of the free body; what is dropped are six rigid ones."""
    body = condensed(seats)
    assert body.interior == 40 + 1 + 6 + 3 * len(body.probes)
    square, _ = reduced_modes(body, 38)
    assert abs(square[:6]).max() < 1e-9 * square[6]
    np.testing.assert_allclose(square[6:], free_of(seats), rtol=2e-8)


def test_craig_bampton_is_worse_free():
    """Its modes are those of a body held at rim and seat."""
    body = condensed(method="craig-bampton")
    square, _ = reduced_modes(body, 38)
    error = np.sqrt(square[6:] / free_of("ring")) - 1
    assert 1e-6 < error.max() < 3e-2
    assert error.min() > -1e-9
    assert error[:6].max() < 1e-3


@pytest.mark.parametrize(
    ("seats", "method", "rtol"),
    quick(
        1,
        [
            ("ring", "herting", 5e-5),
            ("both", "herting", 5e-5),
            ("ring", "craig-bampton", 1e-2),
        ],
    ),
)
def test_frequencies_with_bearings_and_a_mesh_spring(seats, method, rtol):
    full, body = wheel(seats), condensed(seats, method)
    springs = springs_on(full)
    exact, _ = lowest_modes(on_springs(full, springs), full.mass, 30, 1e4)
    found = sprung_modes(body, 30, pulls_on(full))
    np.testing.assert_allclose(np.sqrt(found), np.sqrt(exact), rtol=rtol)
    # The springs matter: the lowest ones are far from those of the free body.
    assert np.sqrt(exact[0]) < 0.9 * np.sqrt(free_of(seats)[0])


@pytest.mark.parametrize("seats", quick(1, ["ring", "both"]))
def test_statics(seats):
    """A force on a tooth, on a probe and the centrifugal load: exact whatever the modes."""
    full, rows = wheel(seats), boundary_rows(wheel(seats))
    springs = springs_on(full)
    probe = dofs(full.probe_points)
    push = np.zeros((3 * full.points, 3))
    push[:, 0] = rows.T @ tooth_load(full)
    push[probe, 1] = [1, -2, 3, 2, 2, -1]
    push[:, 2] = full.centrifugal_load
    exact = answer(on_springs(full, springs), push)
    for method, modes in [("herting", 40), ("herting", 0), ("guyan", 0)]:
        body = condensed(seats, method, modes)
        load = np.zeros((body.dofs, 3))
        load[:, 0] = padded(body, tooth_load(full))
        load[:, 1] = np.einsum("pid,pi->d", body.probe_rows, push[probe, 1].reshape(-1, 3))
        load[:, 2] = body.centrifugal_load
        motion = np.linalg.solve(body.stiffness + padded(body, springs), load)
        for found, wanted in zip(motion[: body.boundary_dofs].T, (rows @ exact).T, strict=True):
            assert_near(found, wanted, 1e-9)
        if method == "guyan":
            continue
        at_probes = (body.probe_rows @ motion).reshape(-1, 3)
        for found, wanted in zip(at_probes.T, exact[probe].T, strict=True):
            assert_near(found, wanted, 1e-9)
        shapes = recovered_displacements(held(seats), body, motion)
        for found, wanted in zip(shapes, exact.T, strict=True):
            assert_near(found.ravel(), full.spread @ wanted, 1e-9)


def test_free_growth():
    """The same whatever the modes; a load that does not balance is refused."""
    growths = [
        inertia_relief(body, body.centrifugal_load)[: 3 * len(body.rim_nodes)]
        for body in (condensed("none", "herting", n) for n in (0, 10, 40))
    ]
    radial = np.sum(growths[0].reshape(-1, 3) * condensed("none").rim_nodes, axis=1)
    assert radial.min() > 0
    for growth in growths[1:]:
        assert_near(growth, growths[0], 1e-10)
    body = condensed("none")
    with pytest.raises(BodyError, match="must balance"):
        inertia_relief(body, padded(body, tooth_load(wheel("none"))))


def test_few_and_many_modes():
    """None and two hundred; Guyan has no interior, and all share their boundary."""
    many, none, guyan = (
        condensed("ring", method, n)
        for method, n in [("herting", 200), ("herting", 0), ("guyan", 0)]
    )
    boundary = guyan.dofs
    assert (many.interior, none.interior, guyan.interior) == (213, 13, 0)
    assert guyan.boundary_dofs == boundary == len(guyan.mass)
    for body in (many, none):
        assert_near(body.stiffness[:boundary, :boundary], guyan.stiffness, 1e-13)
        assert_near(body.mass[:boundary, :boundary], guyan.mass, 1e-12)
        inside = np.s_[boundary:, boundary:]
        assert_near(body.mass[inside], np.eye(body.interior), 1e-9)
        rising = np.diag(body.stiffness)[boundary:]
        assert_near(body.stiffness[inside], np.diag(rising), 1e-11)
        assert np.all(np.diff(rising) > 0)
    errors = [
        np.max(np.sqrt(reduced_modes(body, 38)[0][6:] / free_of("ring")) - 1)
        for body in (guyan, none, many)
    ]
    assert errors[0] > errors[1] > 0.1
    assert abs(errors[2]) < 1e-8


# ------------------------------------------------------------------------------ seats


@pytest.mark.parametrize("seats", ["mean", "both"])
def test_averaging_seats(seats):
    """A rigid motion is its own mean, and a force on the seat is that force on its nodes."""
    full = wheel(seats)
    rigid = full.rigid_motions
    for row, seat in enumerate(each for each in full.seats if each.averaging):
        rows = full.averages[6 * row : 6 * row + 6].toarray()
        at_seat = rigid_motions(seat.point[None])
        ring = np.concatenate([at_seat, np.eye(6)[3:]])
        assert_near(rows @ rigid, ring, 1e-12)
        force = np.array([3.0, -2.0, 5.0, 0.1, 0.2, -0.3])
        nodal = (full.spread @ (rows.T @ force)).reshape(-1, 3)
        assert set(np.flatnonzero(abs(nodal).max(axis=1) > 0)) == set(seat.nodes)
        assert_near(nodal.sum(axis=0), force[:3], 1e-12)
        arm = full.grid.nodes - seat.point
        assert_near(np.cross(arm, nodal).sum(axis=0), force[3:], 1e-12)


def test_rigid_rings_stiffen_and_means_do_not():
    """Rayleigh: each constraint raises every frequency. By how much is in the report."""
    free, mean, ring = (np.sqrt(free_of(seats)) for seats in ("none", "mean", "ring"))
    np.testing.assert_allclose(mean, free, rtol=1e-9)
    assert np.all(ring > mean * (1 - 1e-9))
    assert 1.1 < (ring / mean).max() < 2
    pull = []
    for seats in ("ring", "mean"):
        full, body = wheel(seats), condensed(seats)
        load = padded(body, tooth_load(full))
        stiffness = body.stiffness + padded(body, springs_on(full, mesh=0.0))
        pull.append(load @ np.linalg.solve(stiffness, load))
    assert 0.6 < pull[0] / pull[1] < 0.99


def test_teeth_keep_their_inertia():
    """A ring of teeth on the rim, of a larger mass for its smaller radius."""
    grid = small_wheel(8)
    teeth = Teeth(mass=0.05, polar_inertia=0.05 * 65e-3**2)
    plain, toothed = wheel("none"), wheel_body(grid, "none", teeth=teeth)
    rigid = plain.rigid_motions
    more = rigid.T @ ((toothed.mass - plain.mass) @ rigid)
    assert more[5, 5] == pytest.approx(teeth.polar_inertia, rel=1e-12)
    assert more[0, 0] == pytest.approx(teeth.mass * (65 / 63.43155) ** 2, rel=1e-3)
    gain = (toothed.mass - plain.mass).diagonal().reshape(-1, 3).max(axis=1)
    assert set(np.flatnonzero(gain)) == set(toothed.rim)
    load = toothed.centrifugal_load - plain.centrifugal_load
    radial = np.sum(load.reshape(-1, 3) * plain.grid.nodes, axis=1).sum()
    assert radial == pytest.approx(teeth.polar_inertia, rel=1e-12)
    assert condense(toothed, modes=0).facts["teeth_mass_kg"] == 0.05


def test_a_rigidified_body():
    """Young's modulus times 2000: the same mass, frequencies times its root."""
    stiff = wheel_body(small_wheel(8), "ring", material=replace(STEEL, young=2000 * STEEL.young))
    bodies = [condense(full, modes=10) for full in (stiff, wheel_body(small_wheel(8), "ring"))]
    ends = [body.boundary_dofs for body in bodies]
    masses = [body.mass[:end, :end] for body, end in zip(bodies, ends, strict=True)]
    assert_near(masses[0], masses[1], 1e-12)
    stiffnesses = [body.stiffness[:end, :end] for body, end in zip(bodies, ends, strict=True)]
    assert_near(stiffnesses[0], 2000 * stiffnesses[1], 1e-12)
    squares = [reduced_modes(body, 16)[0][6:] for body in bodies]
    np.testing.assert_allclose(squares[0], 2000 * squares[1], rtol=1e-9)


# --------------------------------------------------------------------------- symmetry


def pierced(count):
    """The wheel with openings through its web."""
    whole = small_wheel(8)
    middle = whole.nodes[whole.bricks].mean(axis=1)
    radius, angle = np.hypot(*middle.T[:2]), np.arctan2(middle[:, 1], middle[:, 0])
    column = np.round(angle * 8 / (2 * np.pi)).astype(int)
    gone = (radius > 37e-3) & (radius < 46e-3) & (column % (8 // count) == 0)
    used, bricks = np.unique(whole.bricks[~gone], return_inverse=True)
    assert np.sum(gone) == count
    sets = {name: np.searchsorted(used, nodes) for name, nodes in whole.sets.items()}
    return Grid(whole.nodes[used], bricks.reshape(-1, 20), sets)


@pytest.mark.parametrize(
    ("grid", "seats", "sectors"),
    quick(
        2,
        [("plain", seats, 8) for seats in ("mean", "none")]
        + [("holes", "ring", 4), ("holes", "mean", 4)],
    ),
)
def test_one_sector_says_what_all_columns_say(grid, seats, sectors):
    full = wheel_body(small_wheel(8) if grid == "plain" else pierced(4), seats)
    bodies = [
        condense(full, modes=5, rotating=True),
        condense(full, modes=5, rotating=True, rotation=general(full)),
    ]
    assert [body.facts["sectors"] for body in bodies] == [sectors, 1]
    end = bodies[0].boundary_dofs
    one, every = ({**vars(body)} for body in bodies)
    for name, share in [
        ("stiffness", 1e-13),
        ("mass", 2e-11),
        ("coriolis", 1e-12),
        ("spin_softening", 2e-12),
        ("stress_stiffening", 2e-11),
    ]:
        assert_near(one[name][:end, :end], every[name][:end, :end], share)
    assert_near(one["centrifugal_load"][:end], every["centrifugal_load"][:end], 1e-13)
    squares = [reduced_modes(body, 12)[0][6:] for body in bodies]
    np.testing.assert_allclose(*squares, rtol=1e-9)


def test_what_symmetry_is_found():
    assert largest_rotation(wheel("ring")).sectors == 8
    assert largest_rotation(wheel("both")).sectors == 1  # A seat's point is off the axis.
    assert wheel("ring").rotation(5) is None
    assert largest_rotation(wheel_body(pierced(2), "none")).sectors == 2
    eighth = wheel("ring").rotation(8)
    assert eighth is not None
    np.testing.assert_array_equal(eighth.images(8), np.arange(wheel("ring").points))
    moved = eighth.turned(wheel("ring").rigid_motions, 3)
    turn = np.kron(np.eye(2), eighth.matrix(3))
    assert_near(moved, wheel("ring").rigid_motions @ turn, 1e-12)


# ------------------------------------------------------------------------ the rim


def test_the_rim_is_in_order_and_its_faces_look_outward():
    full = wheel("ring")
    x, y, z = full.grid.nodes[full.rim].T
    angle = np.mod(np.arctan2(y, x) + np.pi, 2 * np.pi)
    assert np.all((np.diff(angle) > 1e-3) | ((abs(np.diff(angle)) < 1e-9) & (np.diff(z) > 1e-4)))
    faces = full.grid.nodes[full.rim][full.rim_faces]
    assert faces.shape == (24, 8, 3)
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 3] - faces[:, 0])
    assert np.all(np.sum(normal[:, :2] * faces[:, 4, :2], axis=1) > 0)
    corners = faces[:, [0, 1, 2, 3]]
    middles = (corners + np.roll(corners, -1, axis=1)) / 2
    assert abs(faces[:, 4:] - middles).max() < 5e-3
    assert condensed().dof_names[:3] == ["rim[0].x", "rim[0].y", "rim[0].z"]
    assert condensed().dof_names[condensed().seat_dofs("bore")][5] == "seat.bore.rz"


def test_progress_is_told():
    steps = []

    @contextlib.contextmanager
    def watch(step):
        steps.append(step)
        yield

    condense(wheel("ring"), modes=3, rotating=True, progress=watch)
    assert steps == [
        "factorising 1104 unknowns",
        "3 free modes of 1374 unknowns",
        "33 of 264 columns of the rim",
        "stiffness and mass",
        "terms of rotation",
    ]


# ------------------------------------------------------------------ what cannot be


def seats_of(grid, *nodes):
    return [Seat("ab"[n], each, np.zeros(3)) for n, each in enumerate(nodes)]


def bad(what):
    """Grid, seats and probes with one fault."""
    grid = small_wheel(8)
    rim, bore = grid.sets["rim"], grid.sets["bore"]
    line = bore[abs(np.arctan2(grid.nodes[bore, 1], grid.nodes[bore, 0])) < 1e-6]
    assert len(line) == 4
    return {
        "rim": (grid, seats_of(grid, np.append(bore, rim[3])), {}),
        "shared": (grid, seats_of(grid, bore[:50], bore[49:]), {}),
        "line": (grid, seats_of(grid, line), {}),
        "two nodes": (grid, seats_of(grid, bore[:2]), {}),
        "no nodes": (grid, seats_of(grid, bore[:0]), {}),
        "names": (grid, [Seat("a", bore[:50], np.zeros(3))] * 2, {}),
        "no face": (replace(grid, sets={"rim": rim[:7]}), [], {}),
        "empty rim": (replace(grid, sets={"rim": rim[:0]}), [], {}),
        "probe on the rim": (grid, [], {"p": int(rim[0])}),
        "probe on a ring": (grid, seats_of(grid, bore), {"p": int(bore[5])}),
    }[what]


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("rim", "belongs to 'rim' and to 'a'"),
        ("shared", "mm belongs to 'a' and to 'b'"),
        ("line", "not on one line, got 4"),
        ("two nodes", "got 2"),
        ("no nodes", "got 0"),
        ("names", "names of their own, got a, a"),
        ("no face", "got 7 nodes and no face"),
        ("empty rim", "got 0 nodes"),
        ("probe on the rim", "probe 'p' must be a node of its own"),
        ("probe on a ring", "probe 'p' must be a node of its own"),
    ],
)
def test_bad_boundaries_are_refused(what, says):
    grid, seats, probes = bad(what)
    with pytest.raises(BodyError, match=says):
        full_body("bad", grid, STEEL, seats, probes=probes)


@pytest.mark.parametrize(
    ("point", "says"),
    [
        ((0, 0, 9e-3), None),
        ((0, 0, -9e-3), None),
        ((0, 0, 26e-3), "got z = 26 mm and nodes from .* the other way round"),
        ((8e-3, 0, 0), r"point at \(8.000, 0.000, 0.000\) mm and the middle .* all the way around"),
    ],
)
def test_the_point_of_a_seat_lies_amid_its_nodes(point, says):
    grid = small_wheel(8)
    seat = Seat("a", grid.sets["bore"], np.array(point))
    if says is None:
        assert full_body("good", grid, STEEL, [seat]).seats == (seat,)
        return
    with pytest.raises(BodyError, match=says):
        full_body("bad", grid, STEEL, [seat])


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"method": "rubin"}, "herting, craig-bampton, guyan, got 'rubin'"),
        ({"modes": 201}, "between 0 and 200, got 201"),
        ({"modes": -1}, "got -1"),
    ],
)
def test_bad_orders_are_refused(asked, says):
    with pytest.raises(BodyError, match=says):
        condense(wheel("ring"), **asked)


def test_modes_of_a_held_body_need_seats_that_can_be_held():
    with pytest.raises(BodyError, match="rigid rings, or use Herting"):
        condense(wheel("mean"), method="craig-bampton", modes=3)


def with_block(far):
    """A wheel and a block beside its bore: loose, or sharing one edge with it like a hinge."""
    grid = small_wheel(8)
    angle = np.pi / 8

    def place(at):
        x, y, z = at.T
        cos, sin = np.cos(angle), np.sin(angle)
        x = x + 20e-3 - far
        return np.stack([x * cos - y * sin, x * sin + y * cos, z], axis=1)

    more = lattice([-3e-3, 0], [0, 3e-3], [-4.75e-3, -1.5e-3], place=place)
    nodes = np.concatenate([grid.nodes, more.nodes])
    bricks = np.concatenate([grid.bricks, more.bricks + len(grid.nodes)])
    nodes, bricks = merged(nodes, bricks, 1e-7)
    radius = np.hypot(nodes[:, 0], nodes[:, 1])
    grid = Grid(nodes, bricks, {"rim": np.flatnonzero(radius > radius.max() - 1e-9)})
    return full_body("odd", grid, STEEL, [])


LOOSE = pytest.mark.parametrize(("far", "motions"), [(2e-3, 12), (0, 7)], ids=["loose", "hinged"])


@pytest.mark.parametrize("solver", available_solvers())
@LOOSE
def test_parts_that_move_freely_are_refused(solver, far, motions, monkeypatch):
    """By every method."""
    monkeypatch.setattr("fem_prep._solvers.available_solvers", lambda: [solver])
    full = with_block(far)
    with pytest.raises(BodyError, match=f"six rigid motions, odd has {motions}"):
        free_modes(full, 12)
    for method, modes in [("herting", 4), ("herting", 0), ("craig-bampton", 4), ("guyan", 0)]:
        with pytest.raises(BodyError, match="loose parts"):
            condense(full, method=method, modes=modes)


@LOOSE
def test_parts_that_move_freely_are_seen_where_rounding_hides_them(far, motions, monkeypatch):
    """Pivots that should be none pass for small ones; without a free mode nothing else tells."""
    del motions

    def rounded(matrix):
        return factorise(csc_array(matrix + 1e-15 * diags_array(matrix.diagonal())))

    monkeypatch.setattr("fem_prep._hold.factorise", rounded)
    assert condense(wheel("ring"), method="guyan", modes=0).interior == 0
    with pytest.raises(BodyError, match="loose parts"):
        condense(with_block(far), method="guyan", modes=0)


def test_a_node_of_no_element_is_refused():
    grid = small_wheel(8)
    grid = replace(grid, nodes=np.concatenate([grid.nodes, np.zeros((1, 3))]))
    with pytest.raises(BodyError, match="no element"):
        condense(full_body("odd", grid, STEEL, []), modes=0)


# --------------------------------------------------------------------- the frame


@pytest.mark.parametrize("seats", ["ring", "mean"])
def test_a_load_fixed_in_space(seats):
    """Seen from the wheel it turns backward; all terms of rotation together leave f / k.

    Without them the wheel's inertia stays: f / (k - speed^2 m).
    """
    body = condensed(seats, modes=6, rotating=True)
    speed, stiffness = 3000.0, 1e8
    seat = body.seat_dofs("bore")
    springs = np.zeros_like(body.stiffness)
    springs[seat, seat] = np.diag([stiffness] * 3 + [1e5] * 3)
    still = body.stiffness + springs - speed**2 * body.mass
    gyro, soft, stiff = rotating_terms(body)
    turning = still + speed**2 * (stiff - soft - 1j * gyro)
    # cos(speed t) along x and -sin along y is the real part of (1, -i) exp(-i speed t).
    force = np.array([1, -1j, 0])
    rim = np.zeros((body.dofs, 2), dtype=complex)
    rim[seat, 0] = [*force, 0, 0, 0]
    rim[: 3 * len(body.rim_nodes), 1] = np.tile(force, len(body.rim_nodes)) / len(body.rim_nodes)
    found = stiffness * np.linalg.solve(turning, rim)[seat][:3]
    assert_near(found, np.stack([force, force], axis=1), 1e-10)
    mass = body.rigid_motions[:, 0] @ body.mass @ body.rigid_motions[:, 0]
    trapped = stiffness * np.linalg.solve(still, rim[:, 0])[seat][0].real
    assert trapped == pytest.approx(1 / (1 - speed**2 * mass / stiffness), rel=1e-3)
    assert trapped > 1.03
