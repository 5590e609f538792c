"""What the summary says of each gear's drawing."""

import pytest

from jaxgear import mm
from jaxgear.scene._build import pair_of
from jaxgear.scene._scene import read_scene
from jaxgear.study._drawing import drawing_summary

_PAIR = """\
schema = 1
[pair]
module_mm = 3.0
torque_pinion_Nm = 120.0
[pinion]
teeth = 24
profile_shift = 0.4
face_width_mm = 30.0
bore_mm = 25.0
[wheel]
teeth = 41
face_width_mm = 30.0
bore_mm = 40.0
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Return a function that tells the drawing of the pair with some settings."""
    path = tmp_path_factory.mktemp("drawn") / "scene.toml"
    path.write_text(_PAIR)

    def told(*settings):
        scene = read_scene(path, settings)
        return drawing_summary(scene.gears, pair_of(scene))

    return told


def test_diameters_spans_and_balls_of_both_gears(told):
    """SDP/SI, Elements of Metric Gear Technology, table 10-4: 32.8266 mm over 4 teeth."""
    found = told()
    assert found["tip_diameter_pinion_mm"] == pytest.approx(80.4)
    assert found["root_diameter_wheel_mm"] == pytest.approx(115.5)
    assert found["base_diameter_pinion_mm"] == pytest.approx(72.0 * 0.9396926)
    assert (found["span_teeth_pinion"], found["span_teeth_wheel"]) == (4.0, 5.0)
    assert found["span_pinion_mm"] == pytest.approx(32.8266, abs=5e-5)
    assert found["ball_pinion_mm"] == pytest.approx(5.7)
    assert found["over_balls_pinion_mm"] > found["tip_diameter_pinion_mm"]


def test_what_is_measured_with_can_be_named(told):
    found = told("pinion.span_teeth=5", "wheel.ball_mm=5.0")
    assert found["span_teeth_pinion"] == 5.0
    # One base pitch more.
    assert found["span_pinion_mm"] == pytest.approx(32.8266 + 3.141593 * 3.0 * 0.9396926, abs=1e-4)
    assert found["ball_wheel_mm"] == pytest.approx(5.0)
    assert found["over_balls_wheel_mm"] < told()["over_balls_wheel_mm"]


def test_what_touches_no_involute_is_no_measure(told):
    """Over 12 of 24 teeth the faces pass beyond the tips; one of 1 mm hides between them."""
    found = told("pinion.span_teeth=12", "pinion.ball_mm=1.0")
    assert found["span_pinion_mm"] != found["span_pinion_mm"]
    assert found["over_balls_pinion_mm"] != found["over_balls_pinion_mm"]
    assert found["span_wheel_mm"] * mm > 0.0
