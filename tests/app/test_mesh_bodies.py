"""Condensed bodies and the scenes that they were built for."""

import dataclasses
import re
from types import MappingProxyType

import jax
import pytest

from jaxgear._checks import InputError
from jaxgear.scene import _mesh_bodies
from jaxgear.scene._build import model_of
from jaxgear.scene._mesh_bodies import MeshBody
from jaxgear.scene._scene import example_scene
from jaxgear.scene._with_bodies import with_bodies


@pytest.fixture
def scene():
    """A scene whose wheel has been built: nothing here looks into it."""
    body = object.__new__(MeshBody)
    assert body.follows is None
    built = MappingProxyType({"wheel": body})
    named = example_scene("accessory-h1", ("wheel.body.young_GPa=206.0",))
    return dataclasses.replace(named, bodies=built)


@pytest.mark.parametrize(
    "key",
    [
        "pair.module_mm",
        "wheel.profile_shift",
        "wheel.addendum_coeff",
        "pinion.face_width_mm",
        "wheel.shaft.gear_at_mm",
        "wheel.shaft.segments[0].outer_mm",
        "wheel.shaft.bearings[1].at_mm",
        "material.poisson",
        "wheel.body.web.web_thickness_mm",
        "mesh.slices",
        "mesh.tooth",
        "mesh.face_coupling",
        "mesh.stiffness",
        "mesh.root_points",
    ],
)
def test_a_body_stays_behind_when_it_would_be_another(scene, key):
    assert "wheel" not in scene.replace({key: scene.value(key)}).bodies


@pytest.mark.parametrize(
    "key",
    [
        "pair.torque_pinion_Nm",
        "flank.wheel.crowning_um",
        "pinion.profile_shift",
        "pinion.addendum_coeff",
        "wheel.shaft.bearings[1].radial_N_m",
        "mesh.phases",
        "material.young_GPa",
        "wheel.body.young_GPa",
    ],
)
def test_a_body_stays_with_what_leaves_it_the_same(scene, key):
    assert "wheel" in scene.replace({key: scene.value(key)}).bodies


@pytest.mark.parametrize("changes", [{"model.shapes": "natural"}, {"model.coordinates": 300}])
def test_other_shapes_make_another_body_of_one_that_vibrates(scene, changes):
    still = scene.bodies["wheel"]
    moving = dataclasses.replace(still, built=None, flexible=None, basis=object())
    vibrating = dataclasses.replace(scene, bodies=MappingProxyType({"wheel": moving}))
    assert "wheel" not in vibrating.replace(changes).bodies
    assert "wheel" in vibrating.replace({"model.mesh_coordinates": 24}).bodies
    # In statics shapes play no part.
    assert "wheel" in scene.replace(changes).bodies


def test_there_is_no_derivative_by_what_a_body_is_made_from(scene):
    def moved(shift):
        return model_of(scene.replace({"wheel.profile_shift": shift})).torque

    with pytest.raises(InputError, match=r"do not follow wheel\.profile_shift: there is no deriv"):
        jax.grad(moved)(0.481)
    keys = scene.real_keys()
    assert "wheel.profile_shift" not in keys
    assert "wheel.shaft.bearings[0].at_mm" not in keys
    assert {"pinion.profile_shift", "wheel.shaft.bearings[0].radial_N_m"} <= set(keys)


def test_scenes_of_rigid_bodies_need_none():
    rigid = example_scene("accessory")
    assert with_bodies(rigid) is rigid


def test_elements_that_cover_too_many_teeth_are_refused_before_any_work(monkeypatch):
    monkeypatch.setattr("jaxgear.scene._mesh_bodies.built_body", lambda *_: pytest.fail("built"))
    scene = example_scene("accessory-h1", ("wheel.body.fineness.sectors=50",))
    with pytest.raises(InputError, match=r"one covers 1\.72 pitches"):
        with_bodies(scene)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ('mesh.tooth="elements"', "carries such teeth in statics only"),
        ("pinion.thickness_allowance_um=50.0", "pinion.thickness_allowance_um: back flanks are"),
        ("model.gyroscopic=true", "wheel.body.rotating_terms = true"),
    ],
)
def test_what_condensed_bodies_cannot_do_in_motion_is_refused_before_they_are_built(
    settings, words, monkeypatch
):
    def built(*_):
        raise AssertionError("a body is built")

    monkeypatch.setattr(_mesh_bodies, "built_body", built)
    with pytest.raises(InputError, match=re.escape(words)):
        _mesh_bodies.with_bodies(example_scene("accessory-h1", (settings,)), moving=True)


def test_long_cycles_have_fewer_steps_and_harmonics_unless_the_scene_says():
    def beyond(*settings: str) -> dict[str, int]:
        scene = example_scene("power-holes", ("sweep.pinion_speed_rad_s=[1.0]", *settings))
        return _mesh_bodies._for_long_cycles(scene.mesh, scene.sweep)

    fewer = {"sweep.steps": 64, "sweep.harmonics": 10}
    assert beyond() == beyond('sweep.method="harmonic"') == fewer
    assert beyond("sweep.steps=128") == beyond("sweep.harmonics=20") == {}
    assert beyond('sweep.method="newmark"') == beyond("mesh.periods=20") == {}


def test_helical_teeth_over_holes_keep_natural_modes_unless_the_scene_says():
    def kept(*settings: str) -> tuple[str, int, int]:
        scene = example_scene("power-holes", settings)
        changes = _mesh_bodies._where_teeth_differ(scene.model, scene.plain.pair.helix_angle_deg)
        scene = _mesh_bodies._unsaid(scene, changes)
        return scene.model.shapes, scene.shape_count, scene.at_mesh

    natural, excited = ("natural", 800, 100), ("excited", 250, 28)
    assert kept() == natural
    # Who names natural modes has as many as on other bodies, however long the cycle turns out.
    assert kept('model.shapes="natural"') == ("natural", 100, 100)
    assert kept("model.coordinates=90", "model.mesh_coordinates=24") == ("natural", 90, 24)
    assert kept('model.shapes="excited"') == excited
    # Spur teeth load few waves.
    assert kept("pair.helix_angle_deg=0.0") == ("excited", 250, 16)
