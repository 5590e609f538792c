"""The recipes for coding agents run as they are written."""

import re
import shlex
from pathlib import Path

import pytest

from jaxgear._cli._main import main

_SKILL = Path(__file__).parents[2] / "docs" / "skill" / "jaxgear" / "SKILL.md"
_TEXT = _SKILL.read_text(encoding="utf-8")
_RECIPES = re.findall(r"^## \d+\. (.*?)\n(.*?)(?=^## |\Z)", _TEXT, flags=re.DOTALL | re.MULTILINE)
# Those that compute no mesh.
_CHEAP = 3


def _carry_out(recipe: str) -> None:
    for language, block in re.findall(r"```(\w+)\n(.*?)```", recipe, flags=re.DOTALL):
        if language == "python":
            exec(compile(block, _SKILL.name, "exec"), {})
            continue
        for line in block.splitlines():
            program, *arguments = shlex.split(line)
            assert program == "jaxgear"
            assert main(arguments) == 0, line


def test_skill_has_the_common_form():
    """Front matter with a name, that of its folder, and a description within 1,024 characters."""
    head = re.match(r"---\nname: ([a-z0-9-]+)\ndescription: (.+)\n---\n", _TEXT)
    assert head is not None
    assert head[1] == _SKILL.parent.name
    assert 40 < len(head[2]) <= 1024
    assert len(_RECIPES) == 10


def test_cheap_recipes_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for _, recipe in _RECIPES[:_CHEAP]:
        _carry_out(recipe)
    assert "pair.toml" in capsys.readouterr().out
    assert (tmp_path / "exchange" / "back.toml").exists()


@pytest.mark.slow
def test_all_recipes_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _, recipe in _RECIPES:
        _carry_out(recipe)
    assert (tmp_path / "exchange" / "sweep.uff").exists()
    assert list(tmp_path.rglob("pair.optimised.toml"))
