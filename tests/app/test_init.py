"""`jaxgear init --pair`: a scene of one's own that runs at once."""

import io
import json
import math
import sys
from pathlib import Path

import jax
import pytest
from helpers import quick
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from jaxgear._cli import _init
from jaxgear._cli._main import main
from jaxgear.scene._assumed import assumed
from jaxgear.scene._build import pair_of
from jaxgear.scene._own_pair import (
    Wanted,
    fillet_radius,
    pinion_torque,
    profile_shifts,
    tip_shortening,
)
from jaxgear.scene._own_scene import scene_text
from jaxgear.scene._scene import read_scene
from jaxgear.scene._slips import odd

_OWN = ["init", "--pair", "23", "64", "--module", "2"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """An empty current folder, and nobody at the terminal."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    return tmp_path


def _wanted(teeth, module=2.0, pressure_angle=20.0, helix=0.0, **more):
    return Wanted("own", teeth, module, pressure_angle, helix, **more)


def _answered(monkeypatch, *lines):
    """A user at a terminal."""
    terminal = io.StringIO("".join(f"{line}\n" for line in lines))
    terminal.isatty = lambda: True
    monkeypatch.setattr(sys, "stdin", terminal)


# --- rules of thumb


def test_profile_shifts_of_the_rule():
    """0.4 (1 - 23/64) = 0.25625 from 60 teeth on; 0.02 (30 - z) below."""
    assert profile_shifts((23, 64), 20.0, 0.0) == (0.256, -0.256)
    assert profile_shifts((64, 23), 20.0, 0.0) == (-0.256, 0.256)
    assert profile_shifts((20, 25), 20.0, 0.0) == (0.2, 0.1)
    assert profile_shifts((40, 40), 20.0, 0.0) == (0.0, 0.0)
    # Undercut asks for more: 1.25 - 0.38 (1 - sin 20) - 10 sin^2 20 / 2 is 0.415, of 0.4.
    assert profile_shifts((10, 14), 20.0, 0.0)[0] == 0.416


def test_fillets_leave_the_flank_and_the_land():
    """0.25 / (1 - sin 14.5) = 0.3335 below 20 degrees, what the rack's tip has room for above."""
    assert [fillet_radius(angle) for angle in (14.5, 20.0, 25.0)] == [0.333, 0.38, 0.317]


def test_shifts_that_balance_shorten_no_tips():
    """Rounding of the centre distance, here 1e-14 above that without shifts, is none."""
    assert tip_shortening(_wanted((29, 83), helix=23.0)) == 0.0


def test_tip_shortening_of_the_textbook():
    """Two gears of 10 teeth, each shifted by 0.416: inv a_w = inv 20 + 0.0832 tan 20."""
    shift = 2.0 * profile_shifts((10, 10), 20.0, 0.0)[0]
    angle = math.radians(20.0)
    working = math.acos(10.0 * math.cos(angle) / (10.0 + shift - tip_shortening(_wanted((10, 10)))))
    involute = math.tan(angle) - angle + shift * math.tan(angle) / 10.0
    assert math.tan(working) - working == pytest.approx(involute, abs=2e-3)


def test_torque_follows_the_k_factor_or_the_power():
    """2 N/mm2 on 20 mm of 46 and 128 mm: 2 20 46 128/174 46/2000 = 31.1 N m."""
    assert pinion_torque(_wanted((23, 64))) == 31.0
    power = _wanted((23, 64), power=3e4, rpm=3000.0)
    assert pinion_torque(power) == pytest.approx(300.0 / math.pi)


# --- scenes that run


_TEETH = st.integers(10, 100)


@settings(max_examples=15, deadline=None)
@given(
    teeth=_TEETH,
    ratio=st.floats(1.0, 10.0),
    swapped=st.booleans(),
    module=st.floats(0.1, 20.0),
    angle=st.floats(14.5, 30.0),
    helix=st.sampled_from([0.0, 0.0, 8.0, -15.0, 25.0, 35.0]),
    loaded=st.booleans(),
)
def test_any_sane_pair_is_accepted(
    tmp_path_factory, teeth, ratio, swapped, module, angle, helix, loaded
):
    """By all checks of a scene, without a remark."""
    both = (teeth, max(10, round(teeth * ratio)))
    module = round(module, 3)
    assume(module >= 0.1)
    drive = {"power": 1e3 * module**3, "rpm": 900.0} if loaded else {}
    wanted = _wanted(both[:: -1 if swapped else 1], module, round(angle, 2), helix, **drive)
    path = tmp_path_factory.mktemp("own") / "own.toml"
    path.write_text(scene_text(wanted), encoding="utf-8")
    scene = read_scene(path)
    assert odd(scene) == []
    assert assumed(scene) == []
    assert scene.value("pinion.teeth") == wanted.teeth[0]


@pytest.mark.parametrize(
    "wanted",
    quick(
        3,
        [
            _wanted((10, 10), 0.5, 15.0, -20.0),
            _wanted((95, 560), 9.5, 18.0),
            _wanted((12, 120), 1.0, 30.0, 35.0),
            _wanted((10, 10)),
            _wanted((34, 10), 2.0, 29.0),
            _wanted((84, 580), 0.7, 14.5),
            _wanted((17, 19), 4.0, 25.0, 8.0),
        ],
    ),
)
def test_gears_at_the_ends_of_the_rules_are_possible(folder, wanted):
    """No undercut, interference, pointed teeth or lost contact."""
    path = folder / "own.toml"
    path.write_text(scene_text(wanted), encoding="utf-8")
    with jax.disable_jit():
        pair = pair_of(read_scene(path))
    assert pair.pinion.teeth == wanted.teeth[0]


# --- the command


def test_a_scene_is_written_and_nothing_overwritten(capsys):
    assert main([*_OWN, "--rpm", "3000", "--power", "30", "--helix", "15", "--face", "25"]) == 0
    assert capsys.readouterr().out.startswith(
        "pair-23-64.toml: own pair; what is marked as assumed"
    )
    scene = read_scene("pair-23-64.toml")
    assert scene.value("pair.torque_pinion_Nm") == pytest.approx(300.0 / math.pi)
    assert (scene.value("pair.helix_angle_deg"), scene.value("wheel.face_width_mm")) == (15.0, 25.0)
    assert "flank.pinion.crowning_um" in scene.value("optimise.vary")
    Path("pair-23-64.toml").write_text("mine")
    assert main(_OWN) == 2
    assert "exists already. Name another file with --out" in capsys.readouterr().err
    assert main([*_OWN, "--force"]) == 2
    assert "--force is for example scenes" in capsys.readouterr().err
    assert Path("pair-23-64.toml").read_text() == "mine"


def test_a_name_a_file_and_changes(capsys):
    own = [*_OWN, "--torque", "50", "--set", "mesh.slices=7", "--json"]
    assert main([*own, "--out", "new/my.toml"]) == 0
    assert json.loads(capsys.readouterr().out)["scene"] == str(Path("new/my.toml"))
    scene = read_scene("new/my.toml")
    assert (
        scene.value("name"),
        scene.value("mesh.slices"),
        scene.value("pair.torque_pinion_Nm"),
    ) == ("my", 7, 50.0)
    assert main(["init", "gearbox", *_OWN[1:], "--out", "new"]) == 0
    assert read_scene("new/gearbox.toml").value("name") == "gearbox"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["init"], "name an example scene (accessory, "),
        (["init", "--module", "2"], "--pair lacks"),
        (_OWN[:4], "--module lacks"),
        ([*_OWN[:2], "9", "64", *_OWN[4:]], "--pair: got 9 64, must be two numbers of teeth"),
        ([*_OWN, "--pressure-angle", "12"], "--pressure-angle: got 12, must be from 14.5 to 30"),
        ([*_OWN, "--helix", "50"], "--helix: got 50.0, must be a number >= -45 and <= 45"),
        ([*_OWN, "--power", "30"], "--power goes with --rpm"),
        ([*_OWN, "--power", "3", "--rpm", "9", "--torque", "5"], "--torque says it by itself"),
        ([*_OWN, "--face", "9000"], "--face: got 9000.0, must be a number >= 0.1 and <= 2000"),
        ([*_OWN[:-1], "0.5", "--face", "1999"], "pair.module_mm: got 0.5, must be at least"),
        ([*_OWN, "--set", "pinion.teeth=2"], "pinion.teeth: got 2, must be an integer >= 5"),
        (["init", "mine"], "For a pair of your own add --pair"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_and_nothing_written(folder, capsys, arguments, words):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert "Traceback" not in error
    assert not list(folder.iterdir())


def test_a_folder_that_cannot_be_written_is_named(capsys):
    Path("file").write_text("")
    assert main([*_OWN, "--out", "file/own.toml"]) == 2
    assert "cannot write file" in capsys.readouterr().err


def test_what_lacks_is_asked_for_on_a_terminal(monkeypatch, capsys):
    """Again until it can be read; what has a default may be left empty."""
    _answered(monkeypatch, "23", "23 64", "many", "2", "", "15", "", "", "30", "", "3000")
    assert main(["init"]) == 0
    scene = read_scene("pair-23-64.toml")
    assert (scene.value("pair.module_mm"), scene.value("pair.helix_angle_deg")) == (2.0, 15.0)
    assert scene.value("pair.torque_pinion_Nm") == pytest.approx(300.0 / math.pi)
    told = capsys.readouterr()
    assert told.err.count("teeth of pinion and wheel: ") == 2
    assert "a number was expected, got 'many'" in told.err
    assert told.out.count("\n") == 1


def test_nobody_who_answers_is_no_scene(monkeypatch, capsys, folder):
    _answered(monkeypatch, "23 64")
    assert main(["init"]) == 2
    assert "no answer, so nothing was written" in capsys.readouterr().err
    assert not list(folder.iterdir())


def test_every_option_is_a_key():
    assert all(key in _init.KEYS for key, _ in _init.OWN_PAIR.values())
