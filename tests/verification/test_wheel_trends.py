"""Trends of turning flexible wheels that the thesis tells, over a few web geometries.

`benchmarks/wheel_trends.py` makes the tables. Asserted here is which of the thesis's statements
hold in them; those that turn out otherwise with these webs are named.
"""

import importlib.util
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

_FOLDER = Path(__file__).parents[2] / "benchmarks"

# Statements of a table that do not hold, and why.
_OTHERWISE: dict[str, set[str]] = {
    "rigidified": set(),
    "critical-speeds": set(),
    "basis": set(),
    "growth": set(),
    "waves": set(),
    "run-up": set(),
    "in-mesh": set(),
    "holes": set(),
}


@pytest.fixture(scope="module")
def trends():
    """The script, as a module; it takes parts of another."""
    sys.path.insert(0, str(_FOLDER))
    spec = importlib.util.spec_from_file_location("wheel_trends", _FOLDER / "wheel_trends.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up.
    sys.modules["wheel_trends"] = module
    spec.loader.exec_module(module)
    yield module
    sys.path.remove(str(_FOLDER))
    for name in ("wheel_trends", "hybrid_trends"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("name", _OTHERWISE)
def test_statements_of_the_thesis(trends, name):
    found = trends.FINDINGS[name]()
    assert {what for what, ok in found.holds.items() if not ok} == _OTHERWISE[name], found.told()
