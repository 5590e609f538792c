"""Scenes in files, for the tests of commands."""

from pathlib import Path

import pytest


@pytest.fixture
def write(tmp_path):
    """A function that writes a scene and returns its path."""

    def written(text: str) -> Path:
        path = tmp_path / "scene.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


@pytest.fixture
def accessory(tmp_path, monkeypatch) -> str:
    """The example scene of this name, in an empty current folder."""
    # Not above: the shape checks must stand before anything of ours is imported.
    from jaxgear._cli._main import main

    monkeypatch.chdir(tmp_path)
    assert main(["init", "accessory", "--quiet"]) == 0
    return "accessory.toml"
