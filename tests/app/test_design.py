"""Variables of any kind: twins, bounds, remedies, and derivatives through shafts."""

import re
import tomllib
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import optimise
from jaxgear._checks import InputError
from jaxgear._interface._laws import ExactContact
from jaxgear.scene._build import grid_of
from jaxgear.scene._scene import example_scene
from jaxgear.study._built import BuiltScene
from jaxgear.study._design import design_space, twin
from jaxgear.study._evaluations import objective_at
from jaxgear.study._objectives import objective_unit, task_of
from jaxgear.study._search import (
    Search,
    by_gradient,
    record_file,
    require_acting,
    searched,
    smoothing_notes,
    unless_beaten,
)
from jaxgear.study._statics import SolverFailure

_RELIEF = "flank.pinion.tip_relief.depth_um"
_COARSE = ("mesh.phases=8", "mesh.slices=4", "mesh.stiffness=iso6336")


def _space(keys, *settings, symmetric=False):
    scene = example_scene("accessory", (*_COARSE, *settings))
    return design_space(BuiltScene(scene), tuple(keys), symmetric=symmetric, deflection=10.0)


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("flank.wheel.end_relief.depth_um", "flank.pinion.end_relief.depth_um"),
        ("flank.pinion.eccentricity_um", "flank.wheel.eccentricity_um"),
        ("flank.pinion.pitch_error_um[3]", "flank.pinion.pitch_error_um[3]"),
        ("pinion.shaft.bearings[0].at_mm", "pinion.shaft.bearings[0].at_mm"),
        ("pair.helix_angle_deg", "pair.helix_angle_deg"),
    ],
)
def test_flanks_have_twins_and_all_else_has_not(key, expected):
    assert twin(key) == expected
    assert twin(expected) == key


def test_bounds_that_are_guessed():
    """Three deflections of 10 um are rounded up to 40."""
    guessed = {
        "flank.pinion.tip_relief.depth_um": (0.0, 40.0),
        "flank.pinion.tip_relief.extent": (0.02, 0.5),
        "flank.pinion.profile_crowning_um": (0.0, 40.0),
        "flank.pinion.elliptical_crowning_um": (0.0, 40.0),
        "flank.pinion.profile_slope_um": (-40.0, 40.0),
        "flank.pinion.bias_um": (-160.0, 160.0),
        "flank.wheel.pitch_error_um[1]": (-40.0, 40.0),
        "flank.wheel.eccentricity_um": (0.0, 40.0),
        "flank.wheel.eccentricity_angle_deg": (-180.0, 180.0),
        "flank.wheel.accuracy_grade": (1.0, 11.0),
    }
    space = _space(
        guessed,
        "flank.wheel.accuracy_grade=5",
        f"flank.wheel.pitch_error_um={[0.0, 1.0] + [0.0] * 84}",
    )
    found = dict(zip(guessed, zip(space.box.lower, space.box.upper, strict=True), strict=True))
    assert found == guessed
    assert space.flanks_only


@pytest.mark.parametrize("key", ["pinion.shaft.bearings[0].at_mm", "pinion.shaft.gear_at_mm"])
def test_remedy_is_valid_toml(key):
    with pytest.raises(InputError, match=r"no bounds can be guessed") as caught:
        _space([key])
    (line,) = re.findall(r'".+" = \[.+\]', str(caught.value))
    ((written, bounds),) = tomllib.loads(line).items()
    assert written == key
    assert bounds[0] < bounds[1]
    # And it is understood where it is asked for.
    assert _space([key], f'optimise.bounds."{key}"={bounds}').keys == (key,)


def test_points_of_a_shaft_must_not_pass_each_other():
    """The pinion at 55 mm may come as far as 70, a bearing from 80 as far as 65."""
    keys = ("pinion.shaft.gear_at_mm", "pinion.shaft.bearings[1].at_mm")
    apart = [
        'optimise.bounds."pinion.shaft.gear_at_mm"=[50.0, 60.0]',
        'optimise.bounds."pinion.shaft.bearings[1].at_mm"=[65.0, 80.0]',
    ]
    assert not _space(keys, *apart).flanks_only
    with pytest.raises(InputError, match=r"change places, which are 25 mm apart") as caught:
        _space(keys, apart[0].replace("60.0", "70.0"), apart[1])
    assert all(key in str(caught.value) for key in keys)


def test_symmetric_search_from_a_grade_of_one_gear_is_refused():
    space = _space(["flank.pinion.accuracy_grade"], "flank.pinion.accuracy_grade=5", symmetric=True)
    with pytest.raises(InputError, match=r"flank.wheel.accuracy_grade is left out"):
        space.require_tied_start()


def test_tied_keys_follow_their_variable():
    keys = ["flank.pinion.crowning_um"]
    tie = 'optimise.ties."flank.wheel.tip_relief.depth_um"="flank.pinion.crowning_um"'
    vary = f"optimise.vary={keys}"
    space = _space(keys, vary, tie)
    updates = space.updates(jnp.array([7.0]))
    assert {key: float(value) for key, value in updates.items()} == {
        "flank.pinion.crowning_um": 7.0,
        "flank.wheel.tip_relief.depth_um": 7.0,
    }
    assert space.flanks_only
    space.require_tied_start()
    unlike = _space(keys, vary, tie, "flank.pinion.crowning_um=2.0")
    with pytest.raises(InputError, match=r"they start at 0 and 2. Make them equal"):
        unlike.require_tied_start()


def test_ties_are_symmetric_too():
    """With `symmetric` the other gear's key follows as well, and must start alike."""
    variable, tied = "flank.pinion.tip_relief.depth_um", "flank.pinion.crowning_um"
    tie = f'optimise.ties."{tied}"="{variable}"'
    space = _space([variable], f'optimise.vary=["{variable}"]', tie, symmetric=True)
    updates = {key: float(value) for key, value in space.updates(jnp.array([7.0])).items()}
    assert updates == dict.fromkeys((variable, twin(variable), tied, twin(tied)), 7.0)
    space.require_tied_start()
    other = f"{twin(tied)}=1.0"
    unlike = _space([variable], f'optimise.vary=["{variable}"]', tie, other, symmetric=True)
    with pytest.raises(
        InputError, match=r"makes flank.wheel.crowning_um follow .* start at 1 and 0"
    ):
        unlike.require_tied_start()


def test_a_map_of_two_reliefs_knows_no_ties():
    tie = f'optimise.ties."{twin(_RELIEF)}"="{_RELIEF}"'
    scene = example_scene("accessory", (*_COARSE, tie, "optimise.symmetric=false"))
    options: Any = dict(symmetric=True, deflection=10.0)
    space = design_space(BuiltScene(scene), (_RELIEF,), **options, tied=False)
    assert space.ties == ((twin(_RELIEF), _RELIEF),)
    with pytest.raises(InputError, match="names both of"):
        design_space(BuiltScene(scene), (_RELIEF,), **options)


def test_a_search_that_keeps_no_limit_goes_on_from_a_rival_that_does():
    """x above 6 is asked for, as a limit of -x; the rival is there, the search has stopped at 1."""
    space = _space([_RELIEF])
    limit = optimise.Limit("depth", -6.0, 1.0)
    value = lambda x: jnp.stack([x[0] ** 2, -x[0]])
    penalised = optimise.Batched(
        jax.vmap(lambda x: value(x)[0] + 1e2 * jnp.maximum(6.0 - x[0], 0.0) ** 2)
    )
    descend = lambda start, watch: optimise.constrained(value, [limit], start, space.box)
    slopes = optimise.with_jacobian(lambda x, width: value(x))
    search = Search("slsqp", penalised, slopes, lambda each: float(each[0]), descend, (limit,))
    stuck = optimise.constrained(
        value, [limit], np.array([1.0]), optimise.Box(np.zeros(1), np.full(1, 1.5))
    )
    assert not stuck.converged
    assert stuck.value < 36.0
    found, again = unless_beaten(stuck, np.array([7.0]), 49.0, search, space)
    assert again
    assert found.point[0] == pytest.approx(6.0, abs=1e-3)
    kept, again = unless_beaten(found, np.array([7.0]), 49.0, search, space)
    assert not again
    assert kept is found


def _dented(x):
    """Least, of -1, at a depth of 30; a search from 5 ends at 8, of -0.5, if it only descends."""
    hole = lambda at: jnp.exp(-0.05 * (x[0] - at) ** 2)
    return -hole(30.0) - 0.5 * hole(8.0)


@pytest.mark.parametrize(("starts", "deepest"), [("1", 8.0), ("2", 30.0), ("4", 30.0)])
def test_a_search_begins_from_the_best_of_its_bounds_too(starts, deepest):
    space = _space([_RELIEF], f"optimise.starts={starts}", f"{_RELIEF}=5.0")
    slopes = optimise.with_gradient(lambda x, width: _dented(x))
    objective = optimise.Batched(jax.vmap(_dented))
    made = searched(by_gradient(space, slopes, objective), space)
    assert made.found.point[0] == pytest.approx(deepest, abs=1e-2)
    assert len(made.each) == int(starts)
    assert made.each[0].point[0] == pytest.approx(8.0, abs=1e-2)
    assert made.found.evaluations == sum(each.evaluations for each in made.each)
    assert made.left_out == 0


def test_starts_where_gears_are_impossible_are_left_out():
    """A search that fails from the scene itself fails; without any other gears it stands alone."""
    space, descend = _space([_RELIEF], f"{_RELIEF}=5.0"), optimise.lbfgs
    slopes = optimise.with_gradient(lambda x, width: _dented(x))
    search = by_gradient(space, slopes, optimise.Batched(jax.vmap(_dented)))

    def possible(start, watch):
        if start[0] > 20.0:
            raise FloatingPointError("impossible")
        return descend(_dented, start, space.box, watch=watch)

    made = searched(search._replace(descend=possible), space)
    assert made.left_out > 0
    assert len(made.each) + made.left_out == 5
    assert made.found.point[0] == pytest.approx(8.0, abs=1e-2)
    nothing = optimise.Batched(jax.vmap(lambda x: jnp.nan * x[0]))
    alone = searched(search._replace(objective=nothing), space)
    assert (len(alone.each), alone.left_out) == (1, 4)
    with pytest.raises(FloatingPointError, match="impossible"):
        searched(search._replace(descend=possible), replace(space, start=np.array([25.0])))


def _never(start, watch) -> optimise.SearchResult:
    raise AssertionError("Nothing is to be searched.")


def test_a_variable_that_changes_nothing_is_named():
    """The second of two keys, and a start from where nothing is known."""
    space = _space([_RELIEF, "flank.pinion.crowning_um"])
    slopes = optimise.with_gradient(lambda x, width: x[0] * width)
    flat = Search("lbfgs", optimise.Batched(jnp.asarray), slopes, float, _never)
    with pytest.raises(InputError, match=r"names flank.pinion.crowning_um, which changes nothing"):
        require_acting(flat, space)
    lost = flat._replace(slopes=optimise.with_gradient(lambda x, width: jnp.nan * x[0]))
    with pytest.raises(SolverFailure, match=r"The start: .*tip_relief.depth_um.: 0.0"):
        require_acting(lost, space)


def test_a_tie_of_what_nothing_depends_on_is_refused():
    variable = "flank.pinion.crowning_um"
    tie = f'optimise.ties."mesh.smoothing_um"="{variable}"'
    with pytest.raises(InputError, match=r"optimise.ties names mesh.smoothing_um"):
        _space([variable], f'optimise.vary=["{variable}"]', tie)


def test_a_variable_next_to_its_bound_is_on_it():
    """A search through the inside of the box does not touch its faces."""
    space = _space(["flank.pinion.crowning_um", "flank.wheel.crowning_um"])
    most = space.box.upper
    assert space.at_bounds(most * np.array([1.0 - 1e-6, 0.99])) == [space.keys[0]]


def test_contact_too_smooth_for_a_depth_is_refused():
    key = "flank.pinion.crowning_um"
    bounds = f"optimise.bounds.{key}=[0.0, 4.0]"
    _space([key], bounds, "mesh.smoothing_um=2.0")
    with pytest.raises(InputError, match=r"too wide for .*crowning_um, which moves over 4 um"):
        _space([key], bounds, "mesh.smoothing_um=2.1")


def test_a_bias_is_worth_a_word_if_it_is_a_part_of_the_gain():
    assert not smoothing_notes(0.5, 0.04, before=5.0, after=4.0)
    (words,) = smoothing_notes(0.5, -0.06, before=5.0, after=4.0)
    assert "0.5 um wide" in words
    assert "-0.06 off the exact one, and the search gained 1." in words
    assert smoothing_notes(0.5, 1e-9, before=4.0, after=4.0)


def test_the_record_of_a_search_is_that_of_its_model(tmp_path):
    """A file of measured flanks may change, and the scene's text with it does not."""
    space = _space([_RELIEF])
    file = record_file(space, tmp_path, version="1")
    assert file == record_file(_space([_RELIEF]), tmp_path, version="1")
    assert record_file(space, None) is None
    changed = eqx.tree_at(lambda x: x.base.flanks.pinion.parts[3].depth, space, jnp.asarray(1e-6))
    others = [
        record_file(changed, tmp_path, version="1"),
        record_file(space, tmp_path, version="2"),
        record_file(_space([_RELIEF], "pair.torque_pinion_Nm=81.0"), tmp_path, version="1"),
    ]
    assert len({file, *others}) == 4


@pytest.mark.slow
def test_face_load_factor_follows_bearings_and_sections():
    """Its derivatives by rows of a shaft and by a flank against central differences."""
    keys = (
        "pinion.shaft.bearings[1].at_mm",
        "pinion.shaft.segments[0].outer_mm",
        "wheel.shaft.bearings[0].radial_N_m",
        "flank.pinion.helix_slope_um",
    )
    space = _space(
        keys,
        "optimise.minimise=face_load_factor",
        'optimise.bounds."pinion.shaft.bearings[1].at_mm"=[70.0, 90.0]',
        'optimise.bounds."pinion.shaft.segments[0].outer_mm"=[20.0, 40.0]',
        'optimise.bounds."wheel.shaft.bearings[0].radial_N_m"=[1e8, 2e9]',
    )
    assert objective_unit(space.scene.optimise) == "-"
    grid = grid_of(space.scene, space.base)
    task = task_of(space, grid, ExactContact(), None)
    both = jax.jit(jax.value_and_grad(lambda x: objective_at(task, x, ExactContact())))
    gradient = np.asarray(both(jnp.asarray(space.start))[1])
    step = 1e-5 * (space.box.upper - space.box.lower)
    for index in range(len(keys)):
        shift = step[index] * np.eye(len(keys))[index]
        above, below = (float(both(jnp.asarray(space.start + s))[0]) for s in (shift, -shift))
        assert gradient[index] != 0.0
        expected = (above - below) / (2.0 * step[index])
        assert gradient[index] == pytest.approx(expected, rel=1e-5)
