"""From the units of a scene file to SI."""

import jax
import numpy as np
import pytest

from jaxgear._system._shaft import Shaft
from jaxgear.scene._build import model_of
from jaxgear.scene._scene import example_scene

# Beside what the example scene says.
_GIVEN = (
    "pair.centre_distance_mm=99.5",
    "pair.misalignment_inclination_um=3.0",
    "pair.misalignment_deviation_um=-4.0",
    "flank.pinion.tip_relief.depth_um=8.0",
    "pinion.bore_mm=20.0",
    "pinion.thickness_allowance_um=30.0",
    "pinion.material.young_GPa=200.0",
    "flank.wheel.pitch_error_um=[5.0]",
    "flank.wheel.eccentricity_um=6.0",
    "flank.wheel.eccentricity_angle_deg=90.0",
    "mesh.stiffness=constant",
    "mesh.stiffness_N_mm_um=14.0",
)


@pytest.fixture(scope="module")
def model():
    return model_of(example_scene("accessory", _GIVEN))


def test_lengths_and_angles_reach_the_model_in_si(model):
    pair, shaft, indexing = model.pair, model.pinion_support, model.flanks.wheel_indexing
    assert isinstance(shaft, Shaft)
    assert indexing is not None
    found = {
        "module": pair.normal_module,
        "pressure angle": pair.pressure_angle,
        "centre distance": pair.centre_distance,
        "face width": pair.pinion.face_width,
        "bore": pair.pinion.bore,
        "allowance": pair.pinion.thickness_allowance,
        "inclination": model.misalignment.inclination,
        "deviation": model.misalignment.deviation,
        "pitch error": indexing.pitch_error[0],
        "eccentricity": indexing.eccentricity,
        "its angle": indexing.eccentricity_angle,
        "relief": model.flanks.pinion.parts[0].depth,
        "young": pair.pinion.material.young,
        "other young": pair.wheel.material.young,
        "tooth": model.compliance.stiffness,
    }
    expected = {
        "module": 1.5e-3,
        "pressure angle": np.radians(25.0),
        "centre distance": 99.5e-3,
        "face width": 11.5e-3,
        "bore": 20e-3,
        "allowance": 30e-6,
        "inclination": 3e-6,
        "deviation": -4e-6,
        "pitch error": 5e-6,
        "eccentricity": 6e-6,
        "its angle": np.pi / 2,
        "relief": 8e-6,
        "young": 200e9,
        "other young": 206e9,
        "tooth": 14e9,
    }
    assert {name: float(value) for name, value in found.items()} == pytest.approx(expected)


@pytest.mark.parametrize("key", ["material.young_GPa", "material.poisson"])
def test_a_modulus_moves_by_itself(key):
    """Nothing else is traced then, so that checks of the shafts meet plain heights."""
    scene = example_scene("accessory")

    def first_length(value):
        shaft = model_of(scene, {key: value}).wheel_support
        assert isinstance(shaft, Shaft)
        return shaft.segments[0].length

    assert jax.jvp(first_length, (scene.value(key),), (1.0,))[1] == 0.0
