"""Gear bodies with coarse teeth all around, beside a plain ring with the same rim."""

import dataclasses
import math

import numpy as np
import pytest

from fem_prep import (
    BodyError,
    Compliance,
    GearBody,
    Grid,
    Material,
    MeshSizing,
    Seat,
    ToothedGear,
    Web,
    fixed_interface,
    full_body,
    read_compliance,
    ribbed_grids,
    write_compliance,
)
from fem_prep._brick import gauss_points, jacobians, shape_functions
from jaxgear._interface._roots import RimSurface, RootPatches, interface_map

GEAR = ToothedGear(24, 2e-3, math.radians(20.0), 0.0, 0.2, 1.25, 0.3, 27e-3, 20e-3, 8e-3)
DISC = GearBody(2.0 * GEAR.root_radius, 8e-3, bore=20e-3)
WEB = Web(hub_outer=24e-3, thickness=3e-3, rim_inner=36e-3)
COARSE = MeshSizing(48, rim_axial=1, rim_radial=1, web_radial=2)


def _volume(grid: Grid) -> np.ndarray:
    """Of every brick [m3]; a folded one has none."""
    points, weights = gauss_points(4)
    sides = np.linalg.det(jacobians(grid.nodes[grid.bricks], shape_functions(points)[1]))
    return np.where((sides > 0.0).all(axis=1), sides @ weights, np.nan)


@pytest.mark.parametrize("sectors", [48, 60])
@pytest.mark.parametrize("helix", [0.0, 20.0])
def test_body_and_ring_have_the_same_rim_and_teeth(helix, sectors):
    gear = dataclasses.replace(GEAR, helix_angle=math.radians(helix))
    tip = gear.root_radius + 4.5e-3
    gear = dataclasses.replace(gear, tip_radius=tip)
    body = dataclasses.replace(DISC, rim_outer=2.0 * gear.root_radius, web=WEB)
    (first, faces), (ring, others) = ribbed_grids(
        body, dataclasses.replace(COARSE, sectors=sectors), gear
    )
    assert len(faces) == len(others)
    assert len(faces) % sectors == 0
    on_rim = lambda grid, faces: np.sort(np.round(grid.nodes[faces].mean(axis=1), 9), axis=0)
    np.testing.assert_allclose(on_rim(first, faces), on_rim(ring, others), atol=2e-9)
    for grid in (first, ring):
        assert np.isfinite(_volume(grid)).all()
        assert len(np.unique(grid.bricks)) == len(grid.nodes)
        assert abs(grid.radius.max() - tip) < 1e-9


def test_teeth_are_as_thick_as_their_flanks():
    grid, _ = ribbed_grids(DISC, COARSE, GEAR)[0]
    tip = grid.nodes[grid.radius > GEAR.tip_radius - 1e-9]
    angle = np.abs(np.arctan2(tip[:, 1], tip[:, 0]))
    half = angle[angle < 0.5 * GEAR.pitch_angle].max()
    assert abs(half / float(GEAR.half_angle(GEAR.tip_roll)) - 1.0) < 1e-9


def _give(ribbed, seat: str) -> float:
    """Of one tooth's foot along its tangent [m/N]."""
    grid, faces = ribbed
    full = full_body("gear", grid, Material(), [Seat("gear", grid.sets[seat], np.zeros(3))])
    none = np.zeros(0, dtype=int)
    full = dataclasses.replace(full, rim=none, rim_points=none)
    held = fixed_interface(full, rotation=full.rotation(24))
    patches = RootPatches(np.zeros((1, 1)), np.array([-4e-3, 4e-3]), 4e-3)
    row = interface_map(RimSurface(grid.nodes, faces), patches).rows[[1]] @ full.spread
    return float((row @ held.loaded(row.T.toarray())).item())


@pytest.mark.slow
def test_disc_is_the_ring_and_a_thin_web_gives_more():
    disc, ring = (_give(each, "seat:bore") for each in ribbed_grids(DISC, COARSE, GEAR))
    assert abs(disc / ring - 1.0) < 0.01
    web = dataclasses.replace(DISC, web=WEB)
    assert _give(ribbed_grids(web, COARSE, GEAR)[0], "seat:bore") > 1.1 * ring


@pytest.mark.slow
def test_without_teeth_the_elements_are_the_same_and_the_rim_gives_more():
    web = dataclasses.replace(DISC, web=WEB)
    ribbed, smooth = (ribbed_grids(web, COARSE, GEAR, teeth=teeth) for teeth in (True, False))
    for (grid, faces), (plain, others) in zip(ribbed, smooth, strict=True):
        np.testing.assert_array_equal(plain.bricks, grid.bricks[: len(plain.bricks)])
        np.testing.assert_array_equal(plain.nodes, grid.nodes[: len(plain.nodes)])
        np.testing.assert_array_equal(others, faces)
        assert abs(plain.radius.max() - GEAR.root_radius) < 1e-9
    assert _give(smooth[0], "seat:bore") > 1.01 * _give(ribbed[0], "seat:bore")


def test_too_few_elements_around_are_refused():
    with pytest.raises(BodyError, match="at least two for each tooth, 48, got 24"):
        ribbed_grids(DISC, MeshSizing(24), GEAR)


def test_a_compliance_is_read_as_it_was_written(tmp_path):
    give = Compliance(np.array([[2.0, 0.5], [0.5, 1.0]]), {"made_from": "this"})
    write_compliance(tmp_path / "give.npz", give)
    found = read_compliance(tmp_path / "give.npz")
    np.testing.assert_array_equal(found.matrix, give.matrix)
    assert found.facts == give.facts
    with pytest.raises(BodyError, match="There is no file"):
        read_compliance(tmp_path / "other.npz")
