"""The drawing of axes and signs: its arrows against what the model itself does."""

import numpy as np
import pytest
from cases import helical_25_31, standard_17_43
from helpers import assert_close

import jaxgear as jg
from jaxgear import mm
from jaxgear.plot._axes_pictures import axes
from jaxgear.study._pair_dataset import axes_dataset, pair_dataset


def _arrows(pair):
    data = axes_dataset(pair)
    place, along = (
        np.stack([data[name.format(axis)].values for axis in "STZ"], axis=1)
        for name in ("{}_mm", "along_{}")
    )
    return {name: (place[i], along[i]) for i, name in enumerate(data["arrow"].values)}


def test_forces_are_those_of_the_model():
    """Of a right-hand pinion that drives about +Z: it is pushed to +Z, the wheel to -Z."""
    pair = helical_25_31()
    assert float(pair.helix_angle) > 0.0
    arrows = _arrows(pair)
    # A force along the normal does this work on translations of the pinion and the wheel.
    approach = np.asarray(jg.structure_vectors(pair))[:, 0]
    for name, own in (("pinion", approach[:3]), ("wheel", approach[6:9])):
        assert_close(arrows[f"force on the {name}"][1], -own, rtol=1e-12, atol=1e-15)
    assert arrows["force on the pinion"][1][2] > 0.0 > arrows["force on the wheel"][1][2]


def test_a_right_hand_tooth_turns_with_its_way_along_z():
    """At the side of +T what turns about +Z moves to -S; the wheel's teeth go the other way."""
    right = _arrows(helical_25_31())
    assert_close(right["tooth trace of the pinion"][1], np.asarray([-0.292372, 0.0, 0.956305]),
                 rtol=1e-5, atol=1e-12)  # fmt: skip
    assert right["tooth trace of the wheel"][1][0] > 0.0
    spur = _arrows(standard_17_43())
    assert_close(spur["tooth trace of the pinion"][1], np.asarray([0.0, 0.0, 1.0]),
                 rtol=1e-12, atol=1e-12)  # fmt: skip


def test_torques_and_turns():
    """The drive turns the pinion, and the load works against the wheel's turn."""
    arrows = _arrows(helical_25_31())
    turns = [arrows[f"rotation of the {gear}"][1][2] for gear in ("pinion", "wheel")]
    loads = [arrows[f"torque on the {gear}"][1][2] for gear in ("pinion", "wheel")]
    assert turns == [1.0, -1.0]
    assert loads == [1.0, 1.0]


@pytest.mark.parametrize("make", [helical_25_31, standard_17_43])
def test_drawing_says_hand_and_centre_distance(make):
    pair = make()
    figure = axes(pair_dataset(pair), axes_dataset(pair).assign_attrs(title="case"))
    words = [panel.get_title(loc="left") for panel in figure.axes]
    assert f"{float(pair.working_centre_distance) / mm:.4g} mm" in words[0]
    helical = bool(pair.helix_angle != 0.0)
    assert words[1] == (
        "seen from +T: right-hand pinion, +17°" if helical else "seen from +T: spur"
    )
    pushed = [text.get_text() for text in figure.axes[1].texts].count("axial force")
    assert pushed == (2 if helical else 0)
