"""Folders of results: one for each command, which change whole, and in which nothing is lost."""

import fcntl
import json
import os
import shutil
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from jaxgear import _cli
from jaxgear._cli import _folder
from jaxgear._cli._folder import Folder, begun, publish, written
from jaxgear._cli._main import main
from jaxgear._cli._writing import written as write_result
from jaxgear.scene._scene import read_scene
from jaxgear.study._result import Result, Summary
from jaxgear.study._statics import SolverFailure


def _writes(**files):
    """A command that writes texts under names."""

    def command(scene, folder):
        for name, text in files.items():
            path = folder / name.replace("__", "/")
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
        return {}

    return command


@pytest.fixture
def commands(monkeypatch):
    """Commands by name, for a test to fill in."""
    stub: Any = types.ModuleType("jaxgear._cli._commands")
    stub.COMMANDS = {}
    monkeypatch.setitem(sys.modules, stub.__name__, stub)
    monkeypatch.setattr(_cli, "_commands", stub, raising=False)
    return stub.COMMANDS


def _texts(folder: Path) -> dict[str, str]:
    """All files of a folder but lists, and what is in them."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != ".jaxgear.json")
    return {str(path.relative_to(folder)): path.read_text() for path in files}


def test_no_command_touches_what_another_has_written(accessory, commands):
    for name in ("run", "modes", "map"):
        commands[name] = _writes(scene=name, summary=name)
        assert main([name, accessory, "--quiet"]) == 0
    commands["modes"] = _writes(other="modes")
    assert main(["modes", accessory, "--set", "pair.torque_pinion_Nm=60", "--quiet"]) == 0
    assert _texts(Path("results/accessory")) == {
        "scene": "run",
        "summary": "run",
        "modes/other": "modes",
        "map/scene": "map",
        "map/summary": "map",
    }


def test_what_a_run_does_not_make_again_goes_and_what_is_the_users_stays(accessory, commands):
    folder = Path("results/accessory")
    commands["run"] = _writes(sweep="1", notes="1", shape__one="1", shape__two="1", sizing="1")
    assert main(["run", accessory, "--quiet"]) == 0
    (folder / "mine.txt").write_text("mine")
    (folder / "shape" / "mine.vtu").write_text("mine")
    # Of ours, but changed since.
    (folder / "notes").write_text("annotated")
    commands["run"] = _writes(sweep="2", shape__two="2")
    assert main(["run", accessory, "--quiet"]) == 0
    assert _texts(folder) == {
        "sweep": "2",
        "shape/two": "2",
        "shape/mine.vtu": "mine",
        "mine.txt": "mine",
        "notes": "annotated",
    }
    (folder / "shape" / "mine.vtu").unlink()
    commands["run"] = _writes(sweep="3")
    assert main(["run", accessory, "--quiet"]) == 0
    assert not (folder / "shape").exists()
    assert list(written(folder)) == ["sweep"]


@pytest.mark.parametrize(
    ("error", "code"),
    [(KeyboardInterrupt(), 130), (SolverFailure("no contact"), 1), (OSError(28, "full"), 1)],
)
def test_a_command_that_fails_leaves_the_folder_as_it_was(accessory, commands, error, code):
    commands["map"] = _writes(map="old", curve="old")
    assert main(["map", accessory, "--quiet"]) == 0
    before = {path: path.read_bytes() for path in Path("results").rglob("*") if path.is_file()}

    def fails(scene, folder):
        _writes(map="new", other="new")(scene, folder)
        raise error

    commands["map"] = fails
    assert main(["map", accessory, "--quiet"]) == code
    after = {path: path.read_bytes() for path in Path("results").rglob("*") if path.is_file()}
    assert after == before


def test_a_place_that_is_taken_is_no_traceback(accessory, commands, capsys):
    Path("results/accessory/sweep.csv").mkdir(parents=True)
    commands["run"] = _writes(**{"sweep.csv": "1"})
    assert main(["run", accessory]) == 1
    assert "cannot write results into results/accessory: " in capsys.readouterr().err


def test_a_scene_is_not_replaced_by_its_results(accessory, commands, capsys):
    Path("scene.toml").write_text(Path(accessory).read_text())
    commands["run"] = _writes(**{"scene.toml": "as run"})
    assert main(["run", "scene.toml", "--out", "."]) == 2
    assert "scene.toml: the results would replace the scene" in capsys.readouterr().err
    # The scene that a run has written is its own.
    shown = Path("scene.toml").read_text()
    commands["run"] = _writes(**{"scene.toml": shown})
    assert main(["run", "scene.toml", "--out", "new"]) == 0
    assert main(["run", "new/scene.toml", "--out", "new"]) == 0


def test_drafts_that_a_kill_left_are_cleared_and_those_at_work_are_not(tmp_path):
    left, working, young, mine = (
        tmp_path / name
        for name in (".jaxgear-draft-a", ".jaxgear-draft-b", ".jaxgear-new-c", ".jaxgear-mine")
    )
    for draft in (left, working, young, mine):
        draft.mkdir()
        (draft / "half.png").write_text("half")
    handle = os.open(working, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        with begun(Folder(tmp_path / "modes", common=tmp_path)) as folder:
            assert not left.exists()
            assert working.exists()
            assert young.exists()
            assert mine.exists()
            assert folder.draft is not None
            with begun(folder) as other:
                assert folder.draft.exists()
                assert other.draft != folder.draft
    finally:
        os.close(handle)
    assert not list((tmp_path / "modes").iterdir())


@pytest.mark.parametrize(
    "text", ["", "[1]", "{", '{"../precious": "%s"}', '{"/tmp/none": "%s", "gone": "0"}']
)
def test_a_list_that_is_spoilt_costs_no_file(tmp_path, text):
    precious, folder = tmp_path / "precious", tmp_path / "results"
    precious.write_text("all I have")
    with begun(Folder(folder)) as whole:
        (whole / "precious").write_text("all I have")
        publish(whole)
    digest = written(folder)["precious"]
    (folder / ".jaxgear.json").write_text(text.replace("%s", digest))
    with begun(Folder(folder)) as whole:
        publish(whole)
    assert precious.exists()


def test_a_copied_folder_is_as_well_known(accessory, commands):
    """By content, not by dates: after a copy nothing stale stays either."""
    commands["run"] = _writes(old="1", new="1")
    assert main(["run", accessory, "--quiet", "--out", "first"]) == 0
    shutil.copytree("first", "second")
    commands["run"] = _writes(new="2")
    assert main(["run", accessory, "--quiet", "--out", "second"]) == 0
    assert _texts(Path("second")) == {"new": "2"}


def test_scenes_in_a_results_folder_find_their_files(accessory, tmp_path):
    text = Path(accessory).read_text()
    table = tmp_path / "profile.csv"
    table.write_text("roll_length_mm,deviation_um\n1,0\n")
    for given, seen in (("profile.csv", "../../../profile.csv"), (str(table), str(table))):
        named = f"[flank.pinion]\nprofile_deviation_csv = '{given}'"
        Path(accessory).write_text(text.replace("[flank.pinion]", named))
        scene, folder = read_scene(accessory), Folder(Path("results/accessory/optimise"))
        folder.path.mkdir(parents=True, exist_ok=True)
        depth = "flank.pinion.tip_relief.depth_um"
        found: Summary = {"found": {"scene": "better.toml"}}
        summary = write_result(Result(scene, found, scenes={"better.toml": {depth: 9.0}}), folder)
        assert summary["found"]["scene"] == str(folder.path / "better.toml")
        assert read_scene(folder / "better.toml").value(depth) == 9.0
        for name in ("scene.toml", "better.toml"):
            there = read_scene(folder / name)
            assert there.value("flank.pinion.profile_deviation_csv") == seen
            assert (there.path.parent / seen).samefile(table)
        assert json.loads((folder / "summary.json").read_text()) == summary


def test_where_files_know_no_locks_no_draft_is_taken_for_left(tmp_path, monkeypatch):
    """Windows has no `fcntl`: who is at work is not known there."""
    monkeypatch.setattr(_folder, "fcntl", None)
    left = tmp_path / ".jaxgear-draft-a"
    left.mkdir()
    folder = Folder(tmp_path)
    with begun(folder) as draft:
        assert draft.draft is not None
        (draft.draft / "summary.json").write_text("{}")
        publish(draft)
    assert left.exists()
    assert (tmp_path / "summary.json").read_text() == "{}"
    assert sorted(path.name for path in tmp_path.iterdir())[0] == left.name
