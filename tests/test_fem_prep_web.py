"""Parametric gear bodies: volumes and surfaces by hand, places of nodes, symmetry, refusals."""

import re
from math import cos, pi, radians, tan
from typing import Any

import numpy as np
import pytest

from fem_prep._brick import gauss_points, jacobians, shape_functions
from fem_prep._checks import BodyError
from fem_prep._grid import surface
from fem_prep._quality import check_grid, quality
from fem_prep._symmetry import rotation_of
from fem_prep._web import (
    GearBody,
    Holes,
    MeshSizing,
    SeatPlace,
    Segment,
    Web,
    body_grid,
    exact_properties,
    symmetry,
)

mm = 1e-3


def wheel(web=None, **others):
    """The accessory wheel of Guilbert 2017, Tab. III-1, with a thin web."""
    measures: dict[str, Any] = {"hub_outer": 50 * mm, "thickness": 3 * mm, "rim_inner": 118 * mm}
    body: dict[str, Any] = {"rim_outer": 126.86 * mm, "rim_width": 9.5 * mm, "bore": 40 * mm}
    body["web"] = Web(**(measures | (web or {})))
    return GearBody(**(body | others))


def leaning(**others):
    web = {"angle": radians(8), "offset": 1 * mm, "hub_width": 16 * mm, **others}
    return wheel(web, rim_width=14 * mm)


def stepped():
    """A hollow and a solid piece of shaft that meet under the middle of the web."""
    segments = (Segment(30 * mm, 36 * mm, 20 * mm), Segment(25 * mm, 40 * mm))
    seats = (SeatPlace("left", 0.0, 10 * mm), SeatPlace("right", 50 * mm, 6 * mm))
    return wheel(segments=segments, gear_at=30 * mm, seats=seats)


def webbed_pinion():
    """Its web stands on the shaft itself."""
    shaft = (Segment(60 * mm, 30 * mm, 16 * mm),)
    web = Web(hub_outer=30 * mm, thickness=2.5 * mm, rim_inner=56 * mm)
    seats = (SeatPlace("end", 60 * mm, 8 * mm),)
    return GearBody(64.9 * mm, 11.5 * mm, web=web, segments=shaft, gear_at=20 * mm, seats=seats)


ONE_RING = (Holes(6, 16 * mm, 84 * mm),)
TWO_RINGS = (Holes(4, 12 * mm, 70 * mm, 0.3), Holes(4, 14 * mm, 97 * mm, 0.3 + pi / 4))
BODIES = {
    "wheel": (wheel(), 24),
    "flush web": (wheel({"offset": 3.25 * mm}), 16),
    "leaning web": (leaning(), 24),
    "ring of holes": (wheel({"holes": ONE_RING}), 48),
    "staggered holes": (leaning(holes=TWO_RINGS), 64),
    "one hole": (wheel({"holes": (Holes(1, 20 * mm, 84 * mm, 2.0),)}), 43),
    "stepped shaft": (stepped(), 16),
    "webbed pinion": (webbed_pinion(), 15),
    "bored disc": (GearBody(60 * mm, 10 * mm, 20 * mm), 13),
    "full disc": (GearBody(60 * mm, 10 * mm), 14),
}
every_body = pytest.mark.parametrize(("body", "sectors"), BODIES.values(), ids=BODIES.keys())


def moments(grid):
    """Volume, and integrals of the place and of its square, by quadrature over the bricks."""
    points, weights = gauss_points(5)
    values, gradients = shape_functions(points)
    corners = grid.nodes[grid.bricks]
    content = np.linalg.det(jacobians(corners, gradients)) * weights
    place = np.einsum("pn,bni->bpi", values, corners)
    second = np.einsum("bp,bpi,bpj->ij", content, place, place)
    return content.sum(), np.einsum("bp,bpi->i", content, place), second


def area(grid):
    """Area of the outer faces; a face is the bottom of a brick."""
    bottom = [0, 1, 2, 3, 8, 9, 10, 11]
    points, weights = gauss_points(5)
    flat = points * [1, 1, 0]
    gradients = shape_functions(flat)[1][:, bottom, :2]
    sides = jacobians(grid.nodes[surface(grid)], gradients)
    return (np.linalg.norm(np.cross(sides[..., 0], sides[..., 1]), axis=-1) * weights).sum()


@every_body
def test_grid_is_one_sound_body(body, sectors):
    grid = body_grid(body, MeshSizing(sectors))
    check_grid(grid, radius=body.rim_outer / 2)
    assert quality(grid).smallest_jacobian_ratio > 0.1
    # A 20-node brick with a node twice has collapsed.
    assert all(len(set(brick)) == 20 for brick in grid.bricks.tolist())


@every_body
def test_volume_and_moments_are_the_bodys(body, sectors):
    volume, first, second = moments(body_grid(body, MeshSizing(sectors)))
    exact = exact_properties(body)
    # Arcs of quadratic elements are off by the fourth power of their angle.
    error = (2 * pi / sectors) ** 4 / 400 + 3e-5 * bool(body.web and body.web.holes)
    assert abs(volume / exact.volume - 1) < error
    assert np.abs(first - exact.first).max() < 3 * error * exact.volume * body.rim_outer
    assert np.abs(second - exact.second).max() < 3 * error * exact.second.max()


def test_volume_converges_at_fourth_order_to_the_exact_one():
    exact = exact_properties(wheel()).volume
    errors = [
        abs(moments(body_grid(wheel(), MeshSizing(n, web_radial=4)))[0] / exact - 1)
        for n in (12, 24, 86)
    ]
    assert errors[2] < 1e-7
    order = (
        np.log(errors[0] / errors[1]) / np.log(2),
        np.log(errors[1] / errors[2]) / np.log(86 / 24),
    )
    assert order == pytest.approx((4, 4), abs=0.05)


def test_exact_properties_by_hand():
    disc = exact_properties(GearBody(0.2, 0.03))
    assert disc.volume == pytest.approx(pi * 0.1**2 * 0.03)
    assert disc.polar == pytest.approx(disc.volume * 0.1**2 / 2)
    assert disc.transverse == pytest.approx(disc.volume * (3 * 0.1**2 + 0.03**2) / 12)
    # A leaning web: a frustum's shell is as thick along the axis as its normal says.
    whole = exact_properties(leaning())
    thick = 3 * mm / cos(radians(8))
    plate = pi * (59**2 - 25**2) * mm**2 * thick
    rest = pi * (25**2 - 20**2) * 16 * mm**3 + pi * (63.43**2 - 59**2) * 14 * mm**3
    assert whole.volume == pytest.approx(plate + rest)
    mean = 2 / 3 * (59**3 - 25**3) / (59**2 - 25**2) * mm
    assert whole.first[2] == pytest.approx(plate * (1 * mm + tan(radians(8)) * (mean - 42 * mm)))
    # One hole takes away its own moment and that of its offset.
    bored = exact_properties(wheel({"holes": (Holes(1, 20 * mm, 84 * mm, 2.0),)}))
    hole = pi * (10 * mm) ** 2 * 3 * mm
    lost = exact_properties(wheel()).second - bored.second
    assert exact_properties(wheel()).volume - bored.volume == pytest.approx(hole)
    assert bored.first[:2] == pytest.approx(-hole * 42 * mm * np.array([cos(2), np.sin(2)]))
    assert np.trace(lost[:2, :2]) == pytest.approx(hole * ((10 * mm) ** 2 / 2 + (42 * mm) ** 2))
    assert lost[2, 2] == pytest.approx(hole * (3 * mm) ** 2 / 12)


def test_exact_volume_of_a_shaft_by_hand():
    # Left: 36 mm over 20 mm; right: 40 mm, solid; the hub of 50 mm is 9.5 mm wide over both.
    shaft = pi / 4 * (30 * (36**2 - 20**2) + 25 * 40**2)
    hub = pi / 4 * 4.75 * (50**2 - 36**2 + 50**2 - 40**2)
    disc = pi / 4 * (3 * (118**2 - 50**2) + 9.5 * (126.86**2 - 118**2))
    assert exact_properties(stepped()).volume == pytest.approx((shaft + hub + disc) * mm**3)


def test_all_parts_share_their_faces():
    # Parts that merely touch would show the faces between them: the surface is the body's own.
    grid = body_grid(leaning(holes=ONE_RING), MeshSizing(60))
    lean = (59**2 - 25**2) / cos(radians(8))
    # An ellipse of the tangent plane is nearly what a hole takes from a cone of 8 degrees.
    faces = 2 * pi * (lean - 6 * 8**2 / cos(radians(8)))
    faces += 2 * pi * (25**2 - 20**2 + 63.43**2 - 59**2)
    thick = 3 / cos(radians(8))
    round_ = 40 * 16 + 50 * (16 - thick) + 118 * (14 - thick) + 126.86 * 14 + 6 * 16 * thick
    assert area(grid) == pytest.approx((faces + pi * round_) * mm**2, rel=3e-5)

    grid = body_grid(stepped(), MeshSizing(40))
    # From either side the faces make a full disc: the bore of the left piece has a bottom.
    faces = 2 * 126.86**2
    round_ = 126.86 * 9.5 + 118 * 6.5 + 50 * 6.5 + 36 * (30 - 4.75) + 20 * 30 + 40 * (25 - 4.75)
    assert area(grid) == pytest.approx(pi * (faces / 4 + round_) * mm**2, rel=1e-5)


@every_body
def test_grid_goes_over_into_itself_when_turned(body, sectors):
    fineness = MeshSizing(sectors)
    grid = body_grid(body, fineness)
    turn = rotation_of(grid.nodes, symmetry(body, fineness))
    assert turn is not None
    bricks = {tuple(brick) for brick in np.sort(grid.bricks, axis=1).tolist()}
    assert {tuple(b) for b in np.sort(turn.image[grid.bricks], axis=1).tolist()} == bricks
    for nodes in grid.sets.values():
        np.testing.assert_array_equal(np.sort(turn.image[nodes]), np.sort(nodes))


def test_symmetry_is_what_all_rings_share():
    holes = (Holes(4, 8 * mm, 70 * mm), Holes(6, 8 * mm, 100 * mm))
    assert symmetry(wheel({"holes": holes}), MeshSizing(84)) == 2
    assert symmetry(wheel(), MeshSizing(86)) == 86
    assert symmetry(stepped(), MeshSizing(86)) == 43


@every_body
def test_teeth_stand_on_the_middles_of_elements(body, sectors):
    grid = body_grid(body, MeshSizing(sectors))
    rim = np.intersect1d(grid.sets["rim"], grid.bricks[:, :8])
    angle = np.arctan2(grid.nodes[rim, 1], grid.nodes[rim, 0])
    place = angle * sectors / (2 * pi) - 0.5
    np.testing.assert_allclose(place, np.round(place), atol=1e-11)
    radius = grid.radius[grid.sets["rim"]]
    np.testing.assert_allclose(radius, body.rim_outer / 2, rtol=1e-14)
    assert np.abs(grid.nodes[grid.sets["rim"], 2]).max() == pytest.approx(body.rim_width / 2)


def test_accessory_wheel_has_the_size_that_was_planned():
    # Two elements through the rim where nothing is said.
    assert len(body_grid(wheel(), MeshSizing(86)).bricks) == 86 * (3 * 3 + 8 + 2 * 3)
    grid = body_grid(wheel(), MeshSizing(86, rim_radial=1))
    assert len(grid.bricks) == 86 * (3 * 3 + 8 + 3) == 1720
    # Corner nodes, mid nodes in the section, and mid nodes of arcs: hub, web and rim share edges.
    section = (16 + 24 + 16) + (9 * 2 + 25 + 18 - 2 * 5) + (8 + 10 + 8)
    assert grid.dofs == 3 * 86 * section == 34314
    assert len(grid.sets["rim"]) == 86 * 11
    assert len(grid.sets["seat:bore"]) == 86 * 11
    assert quality(grid).largest_aspect_ratio < 2.5


def test_fineness_is_heeded():
    fineness = MeshSizing(20, 6, 2, 5, 2, 4)
    # Through hub and rim six elements of about 1.6 mm: two beside the web, two in it, two beside.
    assert len(body_grid(wheel(), fineness).bricks) == 20 * (4 * 6 + 5 * 2 + 2 * 6)
    shaft = wheel(segments=(Segment(100 * mm, 50 * mm, 40 * mm),), gear_at=50 * mm)
    lengths = [
        len(body_grid(shaft, MeshSizing(20, web_radial=4, shaft=size)).bricks)
        for size in (45.25 * mm, 45.25 / 4 * mm)
    ]
    assert lengths[1] - lengths[0] == 20 * 2 * (4 - 1)


def test_seats_are_bands_of_the_shaft():
    grid = body_grid(stepped(), MeshSizing(16))
    left, right, gear = (
        grid.nodes[grid.sets[f"seat:{name}"]] for name in ("left", "right", "gear")
    )
    np.testing.assert_allclose(np.hypot(*left[:, :2].T), 18 * mm, rtol=1e-14)
    # Cut at the shaft's end: half of its 10 mm.
    assert (left[:, 2].min(), left[:, 2].max()) == pytest.approx((-30 * mm, -25 * mm))
    np.testing.assert_allclose(np.hypot(*right[:, :2].T), 20 * mm, rtol=1e-14)
    assert (right[:, 2].min(), right[:, 2].max()) == pytest.approx((17 * mm, 23 * mm))
    # One element along the seat: two circles of corners and arcs, and uprights between.
    assert len(left) == 16 * (2 + 2 + 1)
    assert (gear[:, 2].min(), gear[:, 2].max()) == pytest.approx((-4.75 * mm, 4.75 * mm))
    assert set(grid.sets) == {"rim", "seat:gear", "seat:left", "seat:right"}
    hollow = np.hypot(*gear[gear[:, 2] < -1e-9].T[:2])
    np.testing.assert_allclose(hollow, 10 * mm, rtol=1e-14)
    assert np.hypot(*gear[gear[:, 2] > 1e-9].T[:2]).max() < 10 * mm


def test_seat_is_cut_at_the_hub_and_at_a_step():
    segments = (Segment(30 * mm, 30 * mm, 16 * mm), Segment(50 * mm, 36 * mm, 16 * mm))
    seats = (SeatPlace("a", 24 * mm, 20 * mm), SeatPlace("b", 45 * mm, 20 * mm))
    body = wheel(segments=segments, gear_at=60 * mm, seats=seats)
    grid = body_grid(body, MeshSizing(12))
    ends = [grid.nodes[grid.sets[f"seat:{name}"], 2] + 60 * mm for name in "ab"]
    assert (ends[0].min(), ends[0].max()) == pytest.approx((14 * mm, 30 * mm))
    assert (ends[1].min(), ends[1].max()) == pytest.approx((35 * mm, 55 * mm))
    wide = SeatPlace("b", 50 * mm, 20 * mm)
    grid = body_grid(wheel(segments=segments, gear_at=60 * mm, seats=(wide,)), MeshSizing(12))
    assert grid.nodes[grid.sets["seat:b"], 2].max() + 60 * mm == pytest.approx(55.25 * mm)


def test_leaning_web_keeps_its_faces():
    body = leaning(holes=TWO_RINGS)
    grid = body_grid(body, MeshSizing(64))
    web = (25.5 * mm < grid.radius) & (grid.radius < 58.5 * mm)
    radius, z = grid.radius[web], grid.nodes[web, 2]
    middle = 1 * mm + tan(radians(8)) * (radius - 42 * mm)
    height = (z - middle) * cos(radians(8)) / (1.5 * mm)
    np.testing.assert_allclose(height, np.round(height), atol=1e-12)
    assert set(np.round(height)) == {-1, 0, 1}


def test_holes_are_round_and_in_their_places():
    grid = body_grid(leaning(holes=TWO_RINGS), MeshSizing(64))
    for ring in TWO_RINGS:
        for centre in ring.centres:
            distance = np.hypot(*(grid.nodes[:, :2] - centre).T)
            assert distance.min() == pytest.approx(ring.diameter / 2, rel=1e-13)
            wall = distance < ring.diameter / 2 * (1 + 1e-12)
            # Corners and arcs on both faces, and at least twelve elements around.
            assert wall.sum() % 5 == 0
            assert wall.sum() >= 12 * 5


@pytest.mark.parametrize("sectors", [8, 14, 86, 200])
def test_solid_axis_has_bricks_of_its_own(sectors):
    grid = body_grid(GearBody(60 * mm, 10 * mm), MeshSizing(sectors, rim_axial=1, web_radial=3))
    assert quality(grid).smallest_jacobian_ratio > 0.1
    on_axis = np.flatnonzero(grid.radius < 1e-12)
    assert len(on_axis) == 3
    assert np.isin(grid.bricks, on_axis).any(axis=1).sum() == sectors // 2


def refused(*parts):
    """The words that a refusal must contain, in this order."""
    return pytest.raises(BodyError, match=".*".join(re.escape(part) for part in parts))


@pytest.mark.parametrize(
    ("make", "parts"),
    [
        (lambda: Holes(0, 1 * mm, 50 * mm), ["Holes.count", "got 0"]),
        (lambda: Holes(3, 60 * mm, 50 * mm), ["Holes.diameter", "60 mm", "axis"]),
        (lambda: wheel({"holes": (Holes(4, 30 * mm, 78 * mm),)}), ["hub whole", "cut it by 1 mm"]),
        (
            lambda: wheel({"holes": (Holes(4, 30 * mm, 94 * mm),)}),
            ["rim whole", "cut it by 3 mm", "less than 24 mm"],
        ),
        (
            lambda: wheel({"holes": (Holes(12, 22 * mm, 84 * mm),)}),
            ["12 holes of 22 mm", "by 0.2592 mm"],
        ),
        (
            lambda: wheel({"holes": (Holes(6, 14 * mm, 74 * mm), Holes(6, 14 * mm, 96 * mm))}),
            ["circles of 74 mm and 96 mm", "by 3 mm"],
        ),
        (lambda: wheel({"hub_outer": 120 * mm}), ["Web.hub_outer", "120 mm and 118 mm"]),
        (lambda: wheel({"rim_inner": 127 * mm}), ["Web.rim_inner", "127 mm and 126.9 mm"]),
        (lambda: wheel({"thickness": -3 * mm}), ["Web.thickness", "-3 mm"]),
        (lambda: wheel({"angle": 8.0}), ["Web.angle", "radians"]),
        (lambda: wheel({"thickness": 10 * mm}), ["within the hub", "by 0.25 mm"]),
        (lambda: wheel({"offset": 4 * mm}), ["within the hub", "by 0.75 mm"]),
        (lambda: wheel({"hub_width": 2 * mm}), ["within the hub", "2 mm by 0.5 mm"]),
        (
            lambda: wheel({"angle": 0.2, "hub_width": 30 * mm}),
            ["within the rim", "11.46 degrees", "9.5 mm by 0.2266 mm"],
        ),
        (lambda: wheel(bore=50 * mm), ["GearBody.bore", "hub's outer diameter", "50 mm"]),
        (lambda: GearBody(60 * mm, 0.0), ["GearBody.rim_width"]),
        (lambda: GearBody(126.86, 9.5), ["in metres"]),
        (lambda: GearBody(0.9e-3, 1e-3), ["in metres"]),
        (lambda: Segment(0.0, 30 * mm), ["Segment.length"]),
        (lambda: Segment(10 * mm, 30 * mm, 30 * mm), ["Segment.inner", "30 mm"]),
        (
            lambda: wheel(segments=(Segment(0.03, 0.03, 0.02), Segment(0.03, 0.05, 0.03))),
            ["segments 1 and 2 share no material"],
        ),
        (
            lambda: wheel(segments=(Segment(0.03, 0.03),), gear_at=2 * mm),
            ["GearBody.gear_at", "between 4.75 and 25.25 mm, got 2 mm"],
        ),
        (
            lambda: wheel(segments=(Segment(0.06, 0.06),), gear_at=30 * mm),
            ["thicker than the hub", "segment 1", "60 mm"],
        ),
        (
            lambda: wheel(
                {"hub_width": 3 * mm},
                segments=(Segment(0.03, 0.06), Segment(0.03, 0.04)),
                gear_at=31.5 * mm,
            ),
            ["clear of web and rim", "segment 1"],
        ),
        (
            lambda: wheel(seats=(SeatPlace("a", 0.0, 0.01),)),
            ["has no `segments`", "seat:bore", "['a']"],
        ),
    ],
)
def test_bodies_that_cannot_be_are_refused(make, parts):
    with refused(*parts):
        make()


@pytest.mark.parametrize(
    ("seats", "parts"),
    [
        ([("a", 61.0, 5.0)], ["must lie on the shaft", "60 mm", "a is at 61 mm"]),
        ([("a", 5.0, 0.0)], ["0 mm wide"]),
        ([("a", 30.0, 5.0)], ["under the hub", "25.25 to 34.75 mm", "seat:gear"]),
        ([("a", 5.0, 5.0), ("a", 55.0, 5.0)], ["different names"]),
        ([("gear", 5.0, 5.0)], ["different names"]),
        ([("a", 5.0, 5.0), ("b", 8.0, 2.0)], ["gap", "a ends at 7.5 mm and b begins at 7 mm"]),
    ],
)
def test_seats_that_cannot_be_are_refused(seats, parts):
    places = tuple(SeatPlace(name, at * mm, width * mm) for name, at, width in seats)
    with refused(*parts):
        wheel(segments=(Segment(60 * mm, 40 * mm, 20 * mm),), gear_at=30 * mm, seats=places)


def test_sectors_must_suit_holes_and_a_solid_shaft():
    with refused("multiple of 6", "6 holes", "got 86", "Take 84 or 90"):
        body_grid(wheel({"holes": ONE_RING}), MeshSizing(86))
    with refused("multiple of 2", "pairs", "got 45", "Take 44 or 46"):
        body_grid(stepped(), MeshSizing(45))
    solid = wheel({"holes": ONE_RING}, bore=0.0)
    with refused("multiple of 12", "got 90", "Take 84 or 96"):
        body_grid(solid, MeshSizing(90))
    with refused("MeshSizing.sectors", "at least 8", "got 6"):
        MeshSizing(6)
    with refused("MeshSizing.rim_axial", "got 0"):
        MeshSizing(20, rim_axial=0)
    with refused("MeshSizing.shaft"):
        MeshSizing(20, shaft=-1.0)


def test_too_few_sectors_for_the_holes_are_told_how_many_suffice():
    body = wheel({"holes": (Holes(10, 20.4 * mm, 73.4 * mm, pi / 10),)})
    with pytest.raises(BodyError, match=r"go around every hole, got 90\. Take \d+") as refusal:
        body_grid(body, MeshSizing(90))
    (enough,) = re.findall(r"Take (\d+)", str(refusal.value))
    check_grid(body_grid(body, MeshSizing(int(enough))))
    between = (Holes(6, 25 * mm, 81 * mm), Holes(6, 19.9 * mm, 91 * mm, pi / 6))
    with refused("Web.holes", "leave room"):
        body_grid(wheel({"holes": between}), MeshSizing(24))
