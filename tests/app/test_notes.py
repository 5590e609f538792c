"""Remarks on results."""

import jax.numpy as jnp
import pytest

from jaxgear.scene._build import model_of
from jaxgear.scene._scene import example_scene
from jaxgear.study import _notes


@pytest.mark.parametrize(
    ("slices", "off", "told"), [(20, 700.0, True), (20, 950.0, False), (4, 700.0, False)]
)
def test_a_pressure_that_slices_make_is_told(slices, off, told):
    numbers = {"max_pressure_MPa": 1000.0, "max_pressure_off_ends_MPa": off}
    numbers = {name: jnp.asarray(value) for name, value in numbers.items()}
    found = [*_notes._on_corners(slices, numbers)]
    assert ["over a corner" in words for words in found] == [True] * told


def _on_cycle(*given: str) -> list[str]:
    scene = example_scene("accessory", given)
    return [*_notes._on_cycle(scene.mesh, scene.gears, scene.flank)]


@pytest.mark.parametrize(("periods", "told"), [(44, True), (45, False), (90, False)])
def test_part_of_a_revolution_is_told(periods, told):
    found = _on_cycle("flank.pinion.eccentricity_um=3.0", f"mesh.periods={periods}")
    assert len(found) == told
    assert all("no whole revolution of the pinion" in words for words in found)


def test_pitch_errors_that_one_period_leaves_out_are_told():
    grade = "flank.wheel.accuracy_grade=5"
    (words,) = _on_cycle(grade)
    assert "leaves out the pitch errors of flank.wheel.accuracy_grade" in words
    assert not _on_cycle(grade, "mesh.periods=2")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("mesh.stiffness=iso6336",), []),
        (("mesh.face_coupling=coupled",), []),
        (("mesh.face_coupling=coupled", "mesh.stiffness=iso6336"), ["no part of it spreads"]),
        (
            ("mesh.face_coupling=coupled", "mesh.tooth=elements"),
            ["whole teeth feel all", "mesh.foundation does nothing"],
        ),
    ],
)
def test_keys_that_a_model_of_the_teeth_does_not_look_at_are_told(given, told):
    scene = example_scene("accessory", given)
    found = [*_notes._on_teeth(scene.mesh, scene.gears)]
    assert len(found) == len(told)
    assert all(words in each for words, each in zip(told, found, strict=True))


@pytest.mark.parametrize(
    ("name", "given", "told"),
    [
        ("accessory", (), None),
        ("power", (), "1 to 6 % low"),
        ("power", ("mesh.face_coupling=none",), "16 to 35 % low"),
        ("power", ("mesh.tooth=elements",), None),
    ],
)
def test_slices_of_helical_teeth_are_told_to_be_off(name, given, told):
    scene = example_scene(name, given)
    found = [*_notes._on_helical_teeth(scene.mesh, scene.pair.helix_angle_deg)]
    assert [told in each for each in found] == ([] if told is None else [True])


def test_strengths_and_thin_rims_are_told_where_roots_are_looked_at():
    def told(*given: str) -> list[str]:
        scene = example_scene("accessory", given)
        return [*_notes._on_roots(scene.mesh, scene.gears, model_of(scene))]

    assert not told()
    (idle,) = told("pinion.root_strength_MPa=600")
    assert "pinion.root_strength_MPa does nothing: write mesh.root_stress = true" in idle
    lacking, thin = told(
        "mesh.root_stress=true", "pinion.bore_mm=62", "wheel.root_strength_MPa=600"
    )
    assert "no safety without pinion.root_strength_MPa: give" in lacking
    assert "The pinion's rim is 0.46 tooth heights thick" in thin


@pytest.mark.parametrize(
    ("foundation", "inner", "told"),
    [
        ("weber", 20.0, "on a ring at most 2 %"),
        ("weber", 45.0, None),
        ("weber", 0.0, None),
        ("ring", 20.0, None),
        ("ring", 45.0, 'Write pinion.foundation = "weber"'),
        ("none", 20.0, None),
    ],
)
def test_foundations_under_beams_are_told_as_they_were_measured(foundation, inner, told):
    """The root circle is 64.9 mm, 3.2 and 1.4 times as wide as the bores."""
    given = ["pinion.body.kind=beam", f"pinion.foundation={foundation}"]
    given += ["pinion.shaft.segments[0].outer_mm=50", f"pinion.shaft.segments[0].inner_mm={inner}"]
    scene = example_scene("accessory", given)
    found = [*_notes._on_foundations(scene.mesh, scene.gears, model_of(scene))]
    assert [told in each for each in found] == ([] if told is None else [True])
