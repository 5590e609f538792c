"""What the wheel contains, who owns it, and what it needs."""

import ast
import configparser
import importlib
import importlib.metadata
import importlib.util
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {"jaxgear", "fem_prep", "optimise"}

# Used without being imported: JAX writes lowered programs with it.
_UNSEEN = {"flatbuffers"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> dict[str, bytes]:
    """Every file in a wheel built from here."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    built = subprocess.run([*command, str(ROOT)], capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    (path,) = folder.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _shipped() -> set[str]:
    """Every file of ours that belongs in the wheel."""
    return {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def _about(wheel: dict[str, bytes], name: str) -> str:
    """Text of one file in the wheel's own folder."""
    (path,) = (path for path in wheel if path.endswith(f".dist-info/{name}"))
    return wheel[path].decode()


def test_wheel_holds_the_packages_and_nothing_else(wheel):
    ours = {name for name in wheel if not name.split("/")[0].endswith(".dist-info")}
    assert ours == _shipped()
    assert {name.split("/")[0] for name in ours} == PACKAGES


def test_wheel_holds_the_scenes(wheel):
    scenes = {name for name in wheel if name.startswith("jaxgear/scene/scenes/")}
    assert "jaxgear/scene/scenes/accessory.toml" in scenes
    assert "jaxgear/scene/scenes/own_pair.template" in scenes
    for scene in (name for name in scenes if name.endswith(".toml")):
        tomllib.loads(wheel[scene].decode())


def test_wheel_holds_the_licence(wheel):
    assert _about(wheel, "licenses/LICENSE") == (ROOT / "LICENSE").read_text()


def test_wheel_offers_the_command(wheel):
    commands = configparser.ConfigParser()
    commands.read_string(_about(wheel, "entry_points.txt"))
    module, _, function = commands["console_scripts"]["jaxgear"].partition(":")
    assert callable(getattr(importlib.import_module(module), function))


@pytest.mark.parametrize("name", sorted(PACKAGES))
def test_package_is_ours_and_not_shadowed(name):
    # A folder of that name under tests/ would be a namespace package in its place: no origin.
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    assert not (ROOT / "tests" / name).exists()
    assert set(importlib.metadata.packages_distributions().get(name, [])) <= {"jaxgear"}


def test_what_is_imported_is_declared_and_what_is_declared_is_imported():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = {_distribution(text) for text in project["dependencies"]}
    owners = importlib.metadata.packages_distributions()
    imported = {_distribution(owners[name][0]) for name in _imported() if name in owners}
    extras = {
        _distribution(text) for own in project["optional-dependencies"].values() for text in own
    }
    # What only an extra brings is imported where it is asked for.
    assert imported - declared - extras == set()
    assert declared - imported == _UNSEEN


def _distribution(requirement: str) -> str:
    """Name of a distribution, as an index spells it."""
    name = requirement
    for mark in "<>=!~[; ":
        name = name.partition(mark)[0]
    return name.lower().replace("_", "-")


def _imported() -> set[str]:
    """First names of all absolute imports in our packages that are not ours or Python's."""
    names = set()
    for path in _shipped():
        if not path.endswith(".py"):
            continue
        for node in ast.walk(ast.parse((ROOT / path).read_bytes())):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names.add(node.module.partition(".")[0])
    return names - sys.stdlib_module_names - PACKAGES
