"""A loaded tooth of a condensed wheel against the whole wheel with its teeth in bricks.

The accessory wheel on a held bore. The hybrid model is what meshes: the condensed body, the feet of
slices on its rim, and a beam for each slice. Measured: 3 to 7 % more deflection than the full model
under an even load, at the edge of the face near the tip 9 %, most of it since the other teeth
stiffen the rim (4 %). `benchmarks/judge.py` prints all of it.
"""

import functools

import numpy as np
import pytest
from cases import accessory
from helpers import assert_close
from verification import tooth_model as tm

from fem_prep import check_grid, exact_properties, quality
from fem_prep._assembly import volume
from jaxgear.scene._teeth import facts_of_teeth

# Equal parts of the face, and those that are looked at: middle, quarter, edge.
PIECES = 9
ACROSS = [4, 6, 8]
PLACES = ["pitch point", "near the tip"]
TINY = tm.ToothFineness(
    base=2, flank=2, beside=0, rim_axial=3, rim_radial=1, web_radial=2, hub_radial=1
)
# Near the tip the usual grid gives 0.4 % less than this one.
FINER = tm.ToothFineness(base=6, gap=2, fillet=2, flank=6, rim_axial=10, web_radial=8)
COARSER = tm.ToothFineness(base=2, flank=3, rim_axial=3, rim_radial=1, web_radial=4)


def _edges() -> np.ndarray:
    half = 0.5 * float(accessory().face_width)
    return np.linspace(-half, half, PIECES + 1)


# --- the judge itself


def test_the_grid_with_teeth_is_sound():
    """No brick is crooked, the tooth weighs what it should, loads act along the line of action."""
    pair = accessory()
    body, material = tm.accessory_wheel(pair)
    gear = tm.toothed_gear(body, pair, 1, TINY, alone=True)
    check_grid(gear.grid, needs=("seat:bore",))
    assert quality(gear.grid).smallest_jacobian_ratio > 0.2
    tooth = facts_of_teeth(pair, 1).mass / (material.density * pair.wheel.teeth)
    found = volume(gear.grid) - exact_properties(body).volume
    assert_close(found, tooth, rtol=5e-3, atol=0.0)

    for place in tm.judged_places(pair, 1).values():
        loads = tm.loads_on(gear, place, _edges()).reshape(-1, 3, PIECES)
        length = np.diff(_edges())
        assert_close(loads.sum(axis=0), np.outer(place.normal, length), rtol=1e-9, atol=1e-15)
        x, y, z = gear.grid.nodes.T
        moment = x @ loads[:, 1] - y @ loads[:, 0]
        # The load is spread over a piece of the flank that is straight to 1e-4.
        assert_close(moment, -float(pair.base_radius[1]) * length, rtol=2e-4, atol=0.0)
        assert_close(z @ loads[:, 0], place.normal[0] * _moments(), rtol=1e-9, atol=1e-15)


def _moments() -> np.ndarray:
    """First moments of the pieces of the face."""
    return 0.5 * np.diff(_edges() ** 2)


# --- what it says


@functools.cache
def _full(fineness: tm.ToothFineness, alone: bool = False) -> dict[str, tm.Influence]:
    pair = accessory()
    body, material = tm.accessory_wheel(pair)
    model = tm.held(tm.toothed_gear(body, pair, 1, fineness, alone=alone), material)
    places = tm.judged_places(pair, 1)
    return {name: tm.full_influence(model, place, _edges()) for name, place in places.items()}


@functools.cache
def _hybrid() -> dict[str, tm.Influence]:
    pair = accessory()
    body, material = tm.accessory_wheel(pair)
    wheel = tm.condensed_wheel(body, material, pair.wheel.teeth)
    return tm.hybrid_influence(wheel, material, pair, 1, tm.judged_places(pair, 1), PIECES)


def _even(found: np.ndarray) -> np.ndarray:
    """Deflections at the three places under an even load on the whole face."""
    return found.sum(axis=1)[ACROSS]


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_a_loaded_flank_gives_as_that_of_the_full_model(place: str):
    full, hybrid = _full(FINER)[place], _hybrid()[place]
    assert_close(_even(hybrid.whole), _even(full.whole), rtol=0.09, atol=0.0)
    # Each part is right, not only their sum; at the edge real slices of a tooth help each other.
    assert_close(_even(hybrid.foot), _even(full.foot), rtol=0.07, atol=0.0)
    assert_close(_even(hybrid.tooth)[:2], _even(full.tooth)[:2], rtol=0.08, atol=0.0)
    assert np.all(_even(hybrid.root) > 0.03 * _even(full.foot))


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_the_full_model_has_converged(place: str):
    coarse, fine = (_full(each)[place].whole for each in (COARSER, tm.ToothFineness()))
    assert_close(_even(coarse), _even(fine), rtol=0.035, atol=0.0)
    # A grid that is finer gives more.
    assert np.all(_even(coarse) < _even(fine))


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_other_teeth_are_most_of_what_is_left(place: str):
    """The condensed rim is bare: without its other teeth the full wheel is nearer to it."""
    alone, full, hybrid = _full(FINER, True), _full(FINER), _hybrid()
    excess = [_even(hybrid[place].whole) / _even(each[place].whole) - 1.0 for each in (full, alone)]
    assert np.all(np.abs(excess[1]) < 0.05)
    assert np.abs(excess[1]).mean() < 0.5 * np.abs(excess[0]).mean()


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_slices_of_a_tooth_do_not_help_each_other(place: str):
    """A known limit: a load on a ninth of the face alone is carried by that ninth of the tooth."""
    full, hybrid = (each[place] for each in (_full(tm.ToothFineness()), _hybrid()))
    ratio = np.diagonal(hybrid.whole / full.whole)[ACROSS]
    assert np.all((1.2 < ratio) & (ratio < 2.8))
    # The feet alone are much nearer: they share the rim.
    assert np.all(np.diagonal(hybrid.foot / full.foot)[ACROSS] < 1.45)
