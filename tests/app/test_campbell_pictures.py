"""What files and pictures say of condensed bodies' modes, on a wheel of a few straight branches."""

import math

import numpy as np
import pytest

from jaxgear import plot
from jaxgear._checks import InputError
from jaxgear._dynamics._bodies import BodyPlace
from jaxgear._dynamics._campbell import AloneModes, TurningModes, critical_crossings
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._wave_content import WaveContent
from jaxgear.scene._scene import read_scene
from jaxgear.study._modes import modes_shown
from jaxgear.study._turning import (
    BodyWaves,
    alone_dataset,
    critical_dataset,
    require_retained,
    turning_dataset,
    wave_entries,
    waves_summary,
)

_TEETH = 20, 40
# On the wheel: an umbrella, and both waves of two nodal diameters.
_OWN, _N, _WAY = np.array([900.0, 2000.0, 2000.0]), np.array([0, 2, 2]), np.array([0, -1, 1])


def _waves() -> BodyWaves:
    speeds = np.linspace(0.0, 1500.0, 31)
    shape = np.ones((31, 3))
    turned = 0.5 * speeds[:, None] / (2.0 * np.pi) * _N * _WAY
    number = lambda values: np.tile(values, (31, 1))
    turning = TurningModes(
        speeds=speeds,
        frequency=_OWN + turned,
        space=_OWN + turned,
        body=_OWN * shape,
        gear=number(np.array([1, 1, 1])),
        diameters=number(_N),
        direction=number(_WAY),
        share=shape,
        mesh=0.1 * shape,
        likeness=shape,
        teeth=_TEETH,
    )
    one = np.ones(3)
    return BodyWaves(
        content=WaveContent(np.array([1, 1, 1]), _N, one, one, 0.0 * one, 0.1 * one),
        turning=turning,
        critical=critical_crossings(turning, (1, 2)),
        alone={"wheel": AloneModes(_OWN - 10.0, _N, np.array([0, 1, 2]), one)},
        frequency=_OWN,
    )


def test_summary_names_each_critical_speed():
    waves = _waves()
    alone = {"wheel": alone_dataset(waves, "wheel")}
    found = waves_summary(waves, critical_dataset(waves), alone)
    assert found["gear"] == ["wheel"] * 3
    rows = [row for row in found["critical"] if row["nodal_diameter"] == 2]
    assert [(row["harmonic"], row["direction"]) for row in rows] == [
        (2, "backward"),
        (2, "forward"),
        (1, "backward"),
        (1, "forward"),
    ]
    for row in rows:
        way = {"backward": -1, "forward": 1}[row["direction"]]
        order = row["harmonic"] * _TEETH[1] - way * 2
        assert row["order_on_body"] == pytest.approx(order, rel=1e-12)
        assert row["wheel_speed_rad_s"] == pytest.approx(2.0 * math.pi * 2000.0 / order)
        assert row["pinion_speed_rad_s"] == pytest.approx(2.0 * row["wheel_speed_rad_s"])
        assert row["frequency_body_Hz"] == pytest.approx(2000.0)
        mesh = row["harmonic"] * _TEETH[0] * row["pinion_speed_rad_s"] / (2.0 * math.pi)
        assert row["frequency_space_Hz"] == pytest.approx(mesh)
    (told,) = found["alone"]
    assert told["gear"] == "wheel"
    np.testing.assert_allclose(told["frequency_in_mesh_Hz"] - told["frequency_alone_Hz"], 10.0)
    assert list(wave_entries(waves)["nodal_diameter"].values) == [0, 2, 2]


def test_pictures_of_waves_and_their_data():
    waves = _waves()
    groups = {
        "campbell": turning_dataset(waves, 2),
        "critical": critical_dataset(waves),
        "alone_wheel": alone_dataset(waves, "wheel"),
    }
    groups = {name: each.assign_attrs(title="waves") for name, each in groups.items()}
    found = {each.name: each for each in plot.pictures(groups)}
    assert list(found) == ["campbell", "campbell_wheel", "modes_wheel_alone"]
    space = found["campbell"].table
    assert len(space["pinion_speed_rad_s"]) == 3 * 31
    assert set(space["direction"][space["mode"] == 2]) == {"backward"}
    assert len(found["campbell"].beside["critical"]["mode"]) == len(waves.critical) == 6
    body = found["campbell_wheel"].table
    np.testing.assert_allclose(body["frequency_body_Hz"][body["mode"] == 2], 2000.0)
    figures = [each.draw() for each in found.values()]
    for figure in figures:
        figure.draw_without_rendering()
    first, second = (figure.axes[0] for figure in figures[:2])
    words = {text.get_text() for text in first.texts}
    backward = 2.0 * math.pi * 2000.0 / (_TEETH[1] + 2) * 2.0
    assert f"2B {backward:.0f}" in words
    assert "on the wheel" in second.get_ylabel()


def test_a_line_ends_where_another_wave_leads_elsewhere_in_space():
    turning = turning_dataset(_waves(), 1).assign_attrs(title="waves")
    # From speed 20 on the mode is led by a wave of four diameters; from space that leaps between
    # holes, and does not on a whole wheel, where it is another name for the same motion.
    turned = turning["speed"].values * 0.5 / (2.0 * np.pi)
    turning["nodal_diameter"].values[20:, 2] = 4
    critical = critical_dataset(_waves()).assign_attrs(title="waves")

    def ends(frequency: np.ndarray) -> set[float]:
        turning["frequency_Hz"].values[:, 2] = frequency
        picture = next(iter(plot.pictures({"campbell": turning, "critical": critical})))
        lines = [np.asarray(line.get_xdata(), float) for line in picture.draw().axes[0].lines]
        return {float(x[-1]) for x in lines if x.size > 2}

    whole = ends(2000.0 + 2.0 * turned)
    assert 1000.0 in whole
    assert 950.0 not in whole
    leaping = ends(2000.0 + np.where(np.arange(31) < 20, 2.0, 4.0) * turned)
    assert 950.0 in leaping
    assert 1000.0 not in leaping


def test_modes_beyond_those_of_a_body_are_refused(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(
        'schema = 1\nname = "thin"\n[pair]\nmodule_mm = 3.0\ntorque_pinion_Nm = 100.0\n'
        "[pinion]\nteeth = 20\nface_width_mm = 20.0\n[wheel]\nteeth = 40\nface_width_mm = 20.0\n"
    )
    square = (2.0 * math.pi * np.array([1e3, 5e3])) ** 2
    place = object.__new__(BodyPlace)
    object.__setattr__(place, "square", square)
    object.__setattr__(place, "index", 1)
    pair = object.__new__(PairDynamics)
    object.__setattr__(pair, "bodies", (place,))
    require_retained(read_scene(path, ("modes.highest_Hz=4900.0",)).modes, 100, pair)
    require_retained(read_scene(path, ()).modes, 100, pair)
    beyond = read_scene(path, ("modes.highest_Hz=5100.0",)).modes
    with pytest.raises(InputError, match=r"wheel's condensed body.*5000 Hz.*model\.coordinates"):
        require_retained(beyond, 2, pair)
    assert modes_shown(beyond, np.array([1.0, 2.0, 6000.0]), 12) == 2
