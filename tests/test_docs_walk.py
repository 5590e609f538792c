"""The pages walked as a reader does: commands in order, keys put where the page shows them."""

import json
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomlkit

import jaxgear
from jaxgear._cli._main import main

_ROOT = Path(__file__).parents[1]
_DOCS = _ROOT / "docs"
_BLOCK = re.compile(r"^```(sh|toml)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_SCENE = Path("gearbox.toml")


def _put(block: str) -> None:
    """Put a block's keys into the scene, each where one with the same meaning was."""
    scene = tomlkit.parse(_SCENE.read_text("utf-8"))
    _merge(scene, tomllib.loads(block))
    for table, keys in tomllib.loads(block).items():
        if isinstance(keys, dict):
            for name in re.findall(r"in place of (\w+)", block):
                _merge(scene[table], {name: None})
    _SCENE.write_text(tomlkit.dumps(scene), "utf-8")


def _merge(into, table) -> None:
    for key, value in table.items():
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        elif value is None:
            into.pop(key, None)
        else:
            into[key] = value


def _walk(page: str, *more: str) -> None:
    """Do what a page says; `more`: options that make its commands small."""
    for language, block in _BLOCK.findall((_ROOT / page).read_text("utf-8")):
        if language == "toml":
            _put(block)
            continue
        for line in re.findall(r"^(?:\.venv/bin/)?jaxgear (.*)$", block, re.MULTILINE):
            command = shlex.split(line, comments=True)
            small = () if command[0] in ("cache", "doctor", "init") else ("--quiet", *more)
            assert main([*command, *small]) == 0, line


def _numbers(text: str) -> list[float]:
    return [float(each) for each in re.findall(r"\d+\.?\d*", text)]


@pytest.mark.slow
def test_the_tutorial_ends_at_the_flanks_that_it_tells(tmp_path, monkeypatch):
    """From teeth and module to a search below a limit, and its table's numbers."""
    monkeypatch.chdir(tmp_path)
    page = (_DOCS / "tutorial.md").read_text("utf-8")
    _walk("docs/tutorial.md")
    run = json.loads(Path("results/gearbox/summary.json").read_text("utf-8"))["optimise"]
    depth, extent = (
        run["variables"][f"flank.pinion.tip_relief.{x}"] for x in ("depth_um", "extent")
    )
    rows = dict(re.findall(r"^\| (RMS|largest pressure|tip relief)(.*)\|$", page, re.MULTILINE))
    found = {
        "RMS": [run[when]["te_rms_um"] for when in ("before", "after")],
        "largest pressure": [run[when]["max_pressure_MPa"] for when in ("before", "after")],
        "tip relief": [depth, extent],
    }
    digits = {"RMS": 3, "largest pressure": 0, "tip relief": 2}
    for name, numbers in found.items():
        told = _numbers(rows[name])
        assert told == pytest.approx(numbers, abs=0.51 * 10.0 ** -digits[name], rel=0.02), name
    limited = Path("results/gearbox/optimise/summary.json").read_text("utf-8")
    assert all(each["kept"] for each in json.loads(limited)["optimise"]["limits"])


@pytest.mark.slow
@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_first_pages_lead_to_a_report(tmp_path, monkeypatch, page):
    monkeypatch.chdir(tmp_path)
    _walk(page, "--set=mesh.slices=5")
    assert Path("results/pair-23-64/report.html").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "more"),
    [
        ("map", ()),
        ("sweep", ("--set=sweep.pinion_speed_rpm.points=7", "--set=mesh.slices=5")),
        ("robust", ("--set=mesh.slices=5",)),
        (
            "bodies",
            ("--set=mesh.slices=5", "--set=wheel.body.fineness.elements_per_tooth=1"),
        ),
    ],
)
def test_the_guides_go_on_from_the_tutorial(tmp_path, monkeypatch, page, more):
    monkeypatch.chdir(tmp_path)
    first = re.search(
        r"^jaxgear init .*$", (_DOCS / "tutorial.md").read_text("utf-8"), re.MULTILINE
    )
    assert first is not None
    assert main(shlex.split(first[0])[1:]) == 0
    guide = (_DOCS / "guides" / f"{page}.md").read_text("utf-8")
    command = re.search(r"^jaxgear (\w+) (\w+)\.toml", guide, re.MULTILINE)
    assert command is not None
    if command[2] != _SCENE.stem:
        monkeypatch.setitem(globals(), "_SCENE", _SCENE.rename(f"{command[2]}.toml"))
    _walk(f"docs/guides/{page}.md", *more)
    assert Path(f"results/gearbox/{command[1]}/report.html").exists()


def test_the_page_of_caches_shows_and_clears_its_own(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path))
    (tmp_path / "bodies").mkdir()
    kept = tmp_path / "bodies" / f"{'0' * 64}.npz"
    kept.write_bytes(b"")
    _walk("docs/guides/caches.md")
    assert str(tmp_path) in capsys.readouterr().out
    assert not kept.exists()


@pytest.mark.slow
def test_the_page_of_studies_has_its_table(tmp_path, monkeypatch):
    """Its commands with eight designs in place of 4,096, then its lines of Python."""
    monkeypatch.chdir(tmp_path)
    page = (_DOCS / "studies.md").read_text("utf-8")
    shell, code = (re.search(rf"^```{x}\n(.*?)^```", page, re.M | re.S) for x in ("sh", "python"))
    assert shell is not None
    assert code is not None
    first, *more = re.findall(r"^jaxgear (.*)$", shell[1], re.MULTILINE)
    assert main(shlex.split(first, comments=True)) == 0
    study = Path("accessory-tolerances.toml")
    small = study.read_text("utf-8").replace("points = 4096", "points = 8")
    study.write_text(
        small.replace("set = [", 'set = [\n"mesh.slices=3", "mesh.phases=8",'), "utf-8"
    )
    for line in more:
        assert main(shlex.split(line, comments=True)) == 0, line
    names: dict[str, Any] = {"jg": jaxgear}
    exec(compile(code[1], "studies.md", "exec"), names)
    assert len(names["found"].table["static.te_rms_um"]) == 8
    assert Path("results/accessory-tolerances/report.html").exists()
