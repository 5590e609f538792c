"""The rounding of tip edges in a scene, and what is said without it."""

import numpy as np
import pytest

import jaxgear.study as studies
from jaxgear.scene import read_scene

_SCENE = """\
schema = 1
[pair]
module_mm = 2.0
torque_pinion_Nm = 200
[pinion]
teeth = 25
face_width_mm = 12.0
[wheel]
teeth = 31
face_width_mm = 10.0
[mesh]
phases = 16
slices = 3
stiffness = "constant"
stiffness_N_mm_um = 14.0
"""
_CORNERS = ("mesh.tip_contact=true", "pinion.tip_corner_radius_mm=0.2")


@pytest.mark.slow
def test_the_summary_and_the_dataset_have_the_pressure_of_the_corner(write):
    result = studies.statics(read_scene(write(_SCENE), _CORNERS))
    pressure = result.dataset["corner_pressure_MPa"]
    assert pressure.attrs["units"] == "MPa"
    largest = result.summary["static"]["max_corner_pressure_MPa"]
    assert largest == pytest.approx(float(pressure.max()), rel=1e-12)
    assert largest > 0.0
    # Part of all pressures, harder than the flanks at the end of the path are.
    sharp = studies.statics(read_scene(write(_SCENE), _CORNERS[:1]))
    at = np.asarray(pressure > 0.0)
    assert np.all(result.dataset["pressure_MPa"].values[at] == pressure.values[at])
    assert np.all(
        result.dataset["pressure_MPa"].values[at] > sharp.dataset["pressure_MPa"].values[at]
    )
    assert "max_corner_pressure_MPa" not in sharp.summary["static"]
    assert "Give pinion.tip_corner_radius_mm and wheel.tip" in " ".join(sharp.notes)
    assert "Give wheel.tip_corner_radius_mm." in " ".join(result.notes)


@pytest.mark.slow
def test_without_contact_of_tips_it_does_nothing_and_says_so(write):
    result = studies.statics(read_scene(write(_SCENE), _CORNERS[1:]))
    assert "tip_corner_radius_mm does nothing without mesh.tip_contact" in " ".join(result.notes)
