"""The brick's shape functions, the quality of a grid, and every way in which one is refused."""

import dataclasses
import re

import numpy as np
import pytest

from fem_prep._brick import REFERENCE_NODES, gauss_points, jacobians, shape_functions
from fem_prep._checks import BodyError
from fem_prep._grid import EDGES, Grid, merged
from fem_prep._quality import check_grid, quality
from fem_prep._rim_quality import check_rim

INNER, OUTER, WIDTH = 0.02, 0.04, 0.01


def ring(sectors=8, *, start=0, stop=None, straight=False, layers=1):
    """A ring of bricks with sets on its outside and bore."""
    stop = sectors if stop is None else stop
    bricks = [
        (REFERENCE_NODES + np.array([0, sector, layer])) / [1, sectors, layers]
        for sector in range(start, stop)
        for layer in range(layers)
    ]
    places = np.concatenate(bricks)
    nodes = cylindrical(places)
    if straight:
        whole = nodes.reshape(-1, 20, 3)
        whole[:, EDGES[:, 2]] = whole[:, EDGES[:, :2]].mean(axis=2)
        nodes = whole.reshape(-1, 3)
    numbers = np.arange(len(nodes)).reshape(-1, 20)
    nodes, bricks = merged(nodes, numbers, 1e-9)
    # A set must not be chosen by the radius of nodes that are not on it.
    share, first = np.empty(len(nodes)), bricks.ravel()
    share[first] = places[:, 0]
    sets = {"rim": np.flatnonzero(share == 1), "seat:bore": np.flatnonzero(share == 0)}
    return Grid(nodes, bricks, sets)


def cylindrical(places):
    """Coordinates of places given by shares of radius, turn and width."""
    radius = INNER + (OUTER - INNER) * places[:, 0]
    angle = 2 * np.pi * places[:, 1]
    along = WIDTH * (places[:, 2] - 0.5)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), along], axis=1)


def changed(grid, *, nodes=None, bricks=None, **sets):
    """The grid with some of it replaced; sets by their names, `seat` for the bore's."""
    names = {"rim": "rim", "seat": "seat:bore"}
    return Grid(
        grid.nodes if nodes is None else nodes,
        grid.bricks if bricks is None else bricks,
        {**grid.sets, **{names.get(name, name): value for name, value in sets.items()}},
    )


def refused(grid, *words, **options):
    with pytest.raises(BodyError) as caught:
        check_grid(grid, **options)
    for word in words:
        assert re.search(word, str(caught.value)), f"{word} is not in: {caught.value}"


def test_shape_functions_are_one_at_their_node_and_zero_at_the_others():
    values, _ = shape_functions(REFERENCE_NODES)
    np.testing.assert_allclose(values, np.eye(20), atol=1e-15)


def test_shape_functions_reproduce_every_quadratic():
    points = np.random.default_rng(0).random((7, 3))
    values, gradients = shape_functions(points)

    def quadratics(at):
        x, y, z = at.T
        return np.stack([1 + 0 * x, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x], axis=-1)

    np.testing.assert_allclose(values @ quadratics(REFERENCE_NODES), quadratics(points), atol=1e-14)
    step = 1e-5
    for axis in range(3):
        ahead, behind = points.copy(), points.copy()
        ahead[:, axis] += step
        behind[:, axis] -= step
        slope = (shape_functions(ahead)[0] - shape_functions(behind)[0]) / (2 * step)
        np.testing.assert_allclose(gradients[:, :, axis], slope, atol=1e-9)


@pytest.mark.parametrize(("order", "count"), [(2, 8), (3, 8), (4, 27), (5, 27)])
def test_gauss_points_are_exact_to_their_order_and_no_further(order, count):
    points, weights = gauss_points(order)
    assert points.shape == (count, 3)
    exact = 2 * round(count ** (1 / 3)) - 1
    for power in range(exact + 1):
        integrals = weights @ points**power
        np.testing.assert_allclose(integrals, 1 / (power + 1), rtol=1e-13)
    assert abs(weights @ points[:, 0] ** (exact + 1) - 1 / (exact + 2)) > 1e-5


def test_the_volume_of_a_ring_is_that_of_its_quadratic_arcs():
    grid = ring(12)
    points, weights = gauss_points(5)
    matrices = jacobians(grid.nodes[grid.bricks], shape_functions(points)[1])
    volume = np.linalg.det(matrices) @ weights
    # Area between a parabola through three points of a circle and its chord: 2/3 of chord * sag.
    half = np.pi / 12
    area = 0.5 * np.sin(2 * half) + 2 / 3 * 2 * np.sin(half) * (1 - np.cos(half))
    np.testing.assert_allclose(volume, area * (OUTER**2 - INNER**2) * WIDTH, rtol=1e-12)


def test_quality_of_bricks_by_hand():
    box = REFERENCE_NODES * [2.0, 3.0, 6.0]
    taper = 1 - REFERENCE_NODES[:, 2:] / 2
    frustum = REFERENCE_NODES * np.concatenate([taper, taper, np.ones_like(taper)], axis=1)
    grid = Grid(np.concatenate([box, frustum + 9]), np.arange(40).reshape(2, 20))
    found = quality(grid)
    # The frustum's section is (1 - z/2)^2 of that at its foot.
    np.testing.assert_allclose(found.jacobian_ratio, [1.0, 0.25], rtol=1e-12)
    np.testing.assert_allclose(found.aspect_ratio, [3.0, np.sqrt(1.5) / 0.5], rtol=1e-12)
    assert found.worst == 1
    assert found.smallest_jacobian_ratio == pytest.approx(0.25)
    assert found.largest_aspect_ratio == pytest.approx(3.0)
    np.testing.assert_allclose(found.place, [9.375, 9.375, 9.5])


def test_quality_ignores_the_unit_of_length():
    grid = ring(5)
    one, other = quality(grid), quality(dataclasses.replace(grid, nodes=37 * grid.nodes))
    np.testing.assert_allclose(one.jacobian_ratio, other.jacobian_ratio, rtol=1e-12)
    np.testing.assert_allclose(one.aspect_ratio, other.aspect_ratio, rtol=1e-12)


def test_a_good_ring_passes_and_tells_its_radius():
    grid = ring(8, layers=2)
    check_grid(grid, needs=("rim", "seat:bore"), radius=OUTER)
    assert check_rim(grid) == pytest.approx(OUTER, rel=1e-12)


def test_a_file_of_six_digits_passes():
    check_grid(dataclasses.replace(ring(), nodes=np.round(ring().nodes, 7)), radius=OUTER)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_a_wrong_unit_is_named(factor):
    refused(
        changed(ring(), nodes=factor * ring().nodes), "length_unit", "1e-3 m for one in millimetres"
    )


def test_numbers_shapes_and_sets():
    good = ring()
    nodes = good.nodes.copy()
    nodes[5, 1] = np.nan
    refused(changed(good, nodes=nodes), "1 of .* not finite", "node 5")
    refused(changed(good, bricks=good.bricks[:, :8]), r"\[brick, 20\], got \[8, 8\]")
    refused(changed(good, bricks=good.bricks + 7), "names nodes 7 to")
    refused(changed(good, rim=np.array([], int)), "'rim' is empty")
    refused(changed(good, other=np.array([10**6])), "'other' names nodes 1000000")
    refused(good, "'seat:left'; it has 'rim', 'seat:bore'", needs=("rim", "seat:left"))


def test_a_node_without_a_brick():
    good = ring()
    refused(
        changed(good, nodes=np.concatenate([good.nodes, [[0.001, 0.002, 0.003]]])),
        "1 of .* belong to no brick",
        r"\(1, 2, 3\) mm",
    )


def test_loose_parts_are_counted_and_placed():
    good = ring()
    lump = REFERENCE_NODES * 1e-3 + [0, 0, 0.002]
    bricks = np.concatenate([good.bricks, [np.arange(20) + len(good.nodes)]])
    loose = changed(good, nodes=np.concatenate([good.nodes, lump]), bricks=bricks)
    refused(loose, "2 loose parts: 8 bricks", r"1 bricks around \(0.5, 0.5, 2.5\) mm", "leave out")


def test_parts_that_only_touch_say_how_many_nodes_coincide():
    whole = ring()
    bricks = np.arange(160).reshape(8, 20)
    nodes = whole.nodes[whole.bricks.ravel()]
    apart = Grid(nodes + 1e-8 * np.random.default_rng(3).random(nodes.shape), bricks, {})
    refused(
        apart, "8 loose parts", "pairs of nodes lie at the same place", "; and 4 more. ", needs=()
    )
    # One brick cut free on one side only leaves one part with a slit.
    last = whole.bricks[-1]
    shared = np.intersect1d(last, whole.bricks[0])
    bricks = whole.bricks.copy()
    nodes = np.concatenate([whole.nodes, whole.nodes[shared]])
    new = {node: len(whole.nodes) + i for i, node in enumerate(shared)}
    bricks[-1] = [new.get(node, node) for node in last]
    refused(Grid(nodes, bricks, {}), "^8 pairs of nodes", "slit", needs=())


def test_inverted_and_collapsed_bricks():
    good = ring()
    mirrored = changed(good, nodes=good.nodes * [1, 1, -1])
    refused(mirrored, "Every brick is inverted", "mirror")
    bricks = good.bricks.copy()
    bricks[2] = bricks[2, [4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11, 16, 17, 18, 19]]
    refused(changed(good, bricks=bricks), "1 of 8 bricks are inverted", "brick 2")
    # A wedge written as a brick: one face is an edge.
    bricks = good.bricks.copy()
    bricks[5, [3, 11, 7, 15, 19]] = bricks[5, [0, 0, 4, 4, 16]]
    used, bricks = np.unique(bricks, return_inverse=True)
    refused(Grid(good.nodes[used], bricks.reshape(8, 20)), "1 of 8 .* collapsed", needs=())


def test_mid_nodes_in_another_order():
    good = ring()
    nastran = [*range(12), *range(16, 20), *range(12, 16)]
    refused(changed(good, bricks=good.bricks[:, nastran]), "8 of 8 .* not between", "wrong order")


def test_straight_edges_on_the_rim_say_how_far_they_are_off():
    sag = 1e6 * OUTER * (1 - np.cos(np.pi / 24))
    refused(ring(24, straight=True), "linear: 48 of 48 edges", f"{sag:.3g} um", "SecondOrderLinear")
    # With so many sectors the sag is below the rounding of files, and nothing is lost.
    check_rim(ring(400, straight=True))


def test_rim_nodes_off_the_cylinder():
    good = ring()
    nodes = good.nodes.copy()
    worst = good.sets["rim"][4]
    nodes[worst] *= [1.002, 1.002, 1]
    refused(changed(good, nodes=nodes), "radius 40 mm", "1 of 40", "40.08 mm", "chamfers")
    check_grid(changed(good, nodes=good.nodes * [1 + 1e-5, 1, 1]))
    cone = 1 + good.nodes[:, 2:] @ [[1, 1, 0]]
    refused(changed(good, nodes=good.nodes * cone), "nodes are 39.8 to 40.2 mm")


@pytest.mark.parametrize(
    ("turn", "shift", "words"),
    [
        ([[0, 0, 1], [1, 0, 0], [0, 1, 0]], 0, (r"direction \(1, 0, 0\)", "90 degrees")),
        ([[0, 1, 0], [0, 0, 1], [1, 0, 0]], 0, (r"direction \(0, 1, 0\)", "90 degrees")),
        (np.eye(3), 3e-3, (r"direction \(0, 0, 1\)", "0 degrees", r"through \(3, 3, 0\) mm")),
    ],
)
def test_another_axis_is_found(turn, shift, words):
    grid = ring()
    nodes = grid.nodes @ np.transpose(turn) + [shift, shift, 0]
    refused(changed(grid, nodes=nodes), "radius 40 mm", *words)


def test_the_expected_radius():
    good = ring()
    refused(good, "radius of 41 mm; the grid's has 40 mm. Mesh", radius=0.041)
    refused(good, "A diameter was taken for a radius", radius=2 * OUTER)
    refused(good, "length_unit", radius=1e-3 * OUTER)
    check_grid(good, radius=OUTER * 1.0005)


def test_rim_sets_that_are_no_whole_surface():
    good = ring(8, layers=2)
    rim = good.sets["rim"]
    corners = np.intersect1d(rim, good.bricks[:, :8])
    refused(changed(good, rim=corners), "mid nodes too", "16 outer faces .* only 0")
    inside = np.setdiff1d(np.arange(len(good.nodes)), np.concatenate([*good.sets.values()]))
    inner = inside[np.abs(good.nodes[inside, 2]) < 1e-6]
    refused(changed(good, rim=np.append(rim, inner)), "outside of the body; 8 of its")
    end = inside[good.nodes[inside, 2] > WIDTH / 2 - 1e-6]
    refused(changed(good, rim=np.append(rim, end[:1])), "whole outer faces; 1 of its")
    edge = rim[good.nodes[rim, 2] > WIDTH / 2 - 1e-6]
    refused(changed(good, rim=edge), "whole outer faces")


def test_rim_sets_that_do_not_go_round():
    half = ring(8, stop=4)
    refused(half, "all the way round", "open in 1 places")
    # Three layers with the middle one left out of the set are two bands.
    tall = ring(8, layers=3)
    rim = tall.sets["rim"]
    middle = np.abs(tall.nodes[:, 2]) < WIDTH / 6 - 1e-6
    refused(changed(tall, rim=rim[~middle[rim]]), "one band", "4 edges that go round")
    holed = changed(tall, bricks=np.delete(tall.bricks, 4, axis=0))
    refused(holed, "without gaps and holes; it is open in 1 places", r"near \(")


def test_the_middle_of_the_rim():
    good = ring()
    refused(
        changed(good, nodes=good.nodes + np.array([0, 0, 0.002])), "z = 2 mm, between -3 and 7 mm"
    )


def test_seats():
    good = ring()
    seat = good.sets["seat:bore"]
    refused(changed(good, seat=seat[:2]), "three nodes or more, got 2")
    nodes = good.nodes
    line = seat[np.isclose(nodes[seat, 1], 0) & (nodes[seat, 0] > 0)]
    assert len(line) == 3
    refused(changed(good, seat=line), "one straight line, from")
    refused(changed(good, seat=np.append(seat, good.sets["rim"][:2])), "share 2 nodes")
    more = {"seat:more": np.append(seat[:1], np.setdiff1d(np.arange(30), good.sets["rim"]))}
    refused(changed(good, **more), "'seat:more' and 'seat:bore' share")
