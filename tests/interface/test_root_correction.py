"""Teeth at different places of their elements, and the few pieces of rim that serve them all."""

import functools

import numpy as np
import pytest
from fem_cases import STEEL, ring

import jaxgear as jg
from fem_prep import (
    CUT,
    RIM,
    Grid,
    ReducedBody,
    Seat,
    assemble,
    condense,
    full_body,
    piece_of,
    refined,
    surface_of,
)
from fem_prep._solvers import factorise
from jaxgear import deg, mm
from jaxgear._interface._roots import RimSurface, RootPatches, interface_map
from jaxgear._system._body_tables import root_patches
from jaxgear.scene._root_correction import root_correction

# Elements around the wheel, and a number of teeth that has no divisor with it.
_ELEMENTS, _TEETH = 24, 19
_SLICES = 2


@functools.cache
def _body(holes: int = 0, *, bent: bool = False) -> ReducedBody:
    """A thick ring, with openings that reach near its surface, or bent elements in its depth."""
    outer, pitch = 0.5 * 2.0 * mm * _ELEMENTS, 2.0 * np.pi / _ELEMENTS
    radii = outer * np.array([0.5, 0.62, 0.82, 1.0] if bent else [0.5, 0.7, 0.85, 1.0])

    def solid(at: np.ndarray) -> np.ndarray:
        r, angle, _ = at.T
        number = np.round(angle / pitch).astype(int)
        opened = (number % (_ELEMENTS // max(holes, 1)) == 0) & (holes > 0)
        return ~(opened & (r > radii[1]) & (r < radii[2]))

    grid = ring(radii, _ELEMENTS, np.linspace(-6.0 * mm, 6.0 * mm, 3), keep=solid)
    if bent:
        x, y, _ = grid.nodes.T
        some = (np.hypot(x, y) < 0.8 * outer) & (np.hypot(x, y) > 0.6 * outer)
        grid.nodes[some, 1] += 0.2 * pitch * outer * np.sin(2.0 * np.arctan2(y, x))[some] ** 2
    seat = Seat("bore", grid.sets["bore"], np.zeros(3), False)
    return condense(full_body("ring", grid, STEEL, [seat]), method="guyan", modes=0)


def _pair(teeth: int) -> jg.GearPair:
    pinion, wheel = jg.Gear(20, 12.0 * mm, 0.2), jg.Gear(teeth, 10.0 * mm, 0.1)
    return jg.GearPair(pinion, wheel, 2.0 * mm, 20.0 * deg, 18.0 * deg)


def _correction(teeth: int, *, holes: int = 0, bent: bool = False):
    pair, body = _pair(teeth), _body(holes, bent=bent)
    grid = jg.mesh_grid(pair, slices=_SLICES)
    found = root_correction(body, STEEL, pair, 1, grid, points=12, axial="mortar")
    assert found is not None
    return found


@functools.cache
def _of_all_teeth():
    """The correction of the plain rim, and what it finds for all its teeth."""
    correction = _correction(_TEETH)
    return correction, correction(np.arange(_TEETH))


def _by_itself(tooth: int, reach: float) -> np.ndarray:
    """The correction of one tooth on a piece about its own middle, reaching so many pitches."""
    pair, body = _pair(_TEETH), _body()
    grid = jg.mesh_grid(pair, slices=_SLICES)
    patches = root_patches(pair, 1, grid, np.array([tooth]), points=12, axial="mortar")
    radius = float(np.hypot(*body.rim_nodes[0, :2]))
    beyond = reach * 2.0 * np.pi / _TEETH
    ends = patches.angles.min() - beyond, patches.angles.max() + beyond
    depth = 1.5 * patches.width
    piece = piece_of(body.nodes, body.bricks, radius=radius, angles=ends, depth=depth)
    # Eight elements for a pitch, rounded up.
    finer = refined(piece, -(-8 * _TEETH // _ELEMENTS), 4, 1)
    fine, coarse = (_on_all_nodes(each, patches) for each in (finer, piece))
    return fine - coarse


def _on_all_nodes(piece: Grid, patches: RootPatches) -> np.ndarray:
    """Give of the feet on a piece, whose nodes are all solved for under each load on a foot."""
    rows = interface_map(RimSurface(piece.nodes, surface_of(piece, RIM)), patches).rows
    stiffness, _ = assemble(piece, STEEL)
    free = np.setdiff1d(np.arange(len(piece.nodes)), piece.sets[CUT])
    kept = (3 * free[:, None] + np.arange(3)).ravel()
    loads = rows.T.toarray()[kept]
    return loads.T @ factorise(stiffness[kept][:, kept]).solve(loads)


def _near(found, wanted, tolerance):
    """Forces and moments have compliances of different units: each block by its own largest."""
    kinds = np.arange(found.shape[-1]) % 6 < 3
    for one in (kinds, ~kinds):
        for other in (kinds, ~kinds):
            block = np.ix_(one, other)
            scale = np.abs(wanted[block]).max()
            np.testing.assert_allclose(found[block], wanted[block], atol=tolerance * scale)


@pytest.mark.slow
def test_all_teeth_need_two_factors_on_a_rim_whose_elements_are_equal():
    """About the middle and about an edge of an element; as exact as each tooth's own factor."""
    correction, found = _of_all_teeth()
    assert correction.pieces == 2
    assert np.ptp(found[:, 1, 1]) > 0.01 * found[:, 1, 1].max()
    for tooth in (0, 1, 4, 11):
        alone = _correction(_TEETH)
        _near(found[tooth], alone(np.array([tooth]))[0], 1e-10)
        assert alone.pieces == 1


@pytest.mark.slow
def test_a_shared_piece_is_as_good_as_one_about_the_tooth():
    _, found = _of_all_teeth()
    for tooth in (4, 11):
        _near(found[tooth], _by_itself(tooth, 1.6), 1e-3)


@pytest.mark.slow
def test_pieces_above_holes_are_told_from_those_beside():
    correction, teeth = _correction(_TEETH, holes=3), np.array([0, 1, 2, 14, 9, 10])
    found = correction(teeth)
    # Tooth 0 is above a hole; 14 stands as 1 does two holes further on, and 9 and 10 on edges of
    # elements that have no hole in reach.
    assert correction.pieces == 4
    for place, tooth in ((0, 0), (2, 2), (3, 14)):
        _near(found[place], _correction(_TEETH, holes=3)(np.array([tooth]))[0], 1e-10)
    plain = _of_all_teeth()[1][teeth]
    assert np.abs(found - plain).max() > 0.1 * np.abs(plain).max()


def test_teeth_that_stand_alike_need_one_factor():
    correction = _correction(_ELEMENTS)
    found = correction(np.arange(_ELEMENTS))
    assert correction.pieces == 1
    for tooth in (1, 7, 23):
        _near(found[tooth], found[0], 1e-9)


def test_elements_that_differ_deep_under_the_rim_make_no_pieces_of_their_own():
    """Those of a web around its holes: each tooth would have another, for what it hardly feels."""
    correction = _correction(_ELEMENTS, bent=True)
    found = correction(np.arange(_ELEMENTS))
    assert correction.pieces == 1
    for tooth in (1, 7, 23):
        _near(found[tooth], found[0], 1e-9)


def test_what_is_kept_is_what_is_found_and_is_found_once(tmp_path, monkeypatch):
    """Of other teeth, or of a rim with holes, it is found again."""
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path))
    teeth = np.arange(2)
    first, again = _correction(_TEETH), _correction(_TEETH)
    kept = first.kept(teeth)
    np.testing.assert_array_equal(again.kept(teeth), kept)
    assert first.pieces > 0
    assert again.pieces == 0
    np.testing.assert_array_equal(first(teeth), kept)
    holed = _correction(_TEETH, holes=3)
    assert np.abs(holed.kept(teeth) - kept).max() > 1e-3 * np.abs(kept).max()
    assert np.abs(again.kept(teeth + 1) - kept).max() > 1e-3 * np.abs(kept).max()
    assert holed.pieces > 0
    assert again.pieces > 0
