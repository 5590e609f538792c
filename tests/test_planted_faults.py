"""The data of planted faults keep up with the sources, and their judge can tell what it sees."""

import ast
import functools
import textwrap
from collections import Counter

import planted_faults
import pytest
from planted_faults import ROOT, Fault, absent_tests, examined, read_faults


@pytest.fixture(scope="module")
def faults() -> list[Fault]:
    return read_faults()


def test_each_fault_is_planted_in_one_place_and_has_its_tests(faults):
    for fault in faults:
        text = (ROOT / fault.file).read_text(encoding="utf-8")
        assert fault.planted_in(text) != text, fault.name
        compile(fault.planted_in(text), fault.file, "exec")
        assert fault.tests, fault.name
        assert not absent_tests(fault.tests, ROOT), fault.name
    assert max(Counter(fault.name for fault in faults).values()) == 1


@functools.cache
def _slow_ones(file: str) -> set[str]:
    """Names of the slow tests of a file, as far as all their variants are."""
    tests = [
        x for x in ast.parse((ROOT / file).read_bytes()).body if isinstance(x, ast.FunctionDef)
    ]
    marked = lambda test: "pytest.mark.slow" in map(ast.unparse, test.decorator_list)
    return {test.name for test in tests if marked(test)}


def test_each_fault_is_caught_by_a_fast_test(faults):
    """Else a change would break what only `make test-slow` sees."""
    for fault in faults:
        apart = (test.partition("[")[0].split("::") for test in fault.tests)
        assert any(name not in _slow_ones(file) for file, name in apart), fault.name


def test_each_stage_has_a_fault(faults):
    """All that compute: types alone have nothing that could go wrong at run time."""
    found = {fault.file.removesuffix(".py").split("/")[1] for fault in faults}
    stages = {path.stem for path in (ROOT / "jaxgear").glob("_[a-z]*") if path.stem != "_types"}
    assert stages <= found
    sides = Counter(fault.file.split("/")[0] for fault in faults)
    assert min(sides[name] for name in ("jaxgear", "fem_prep", "optimise")) >= 5
    assert len(faults) >= 40


def test_a_source_that_has_moved_on_is_refused(faults):
    for text in ("", 2 * faults[0].find):
        with pytest.raises(LookupError, match=r"must stand once in .*, it stands there [02] times"):
            faults[0].planted_in(text)


_TEST = """
import pytest
from jaxgear import twice

@pytest.fixture
def four():
    return twice(2)

def test_by_hand():
    assert twice(3) == 6

def test_zero():
    assert twice(0) == 0

def test_fixture(four):
    assert four == 4
"""


@pytest.fixture
def tree(tmp_path):
    """A repository of one function."""
    files = {
        "jaxgear/__init__.py": "def twice(x):\n    return 2 * x\n",
        "fem_prep/__init__.py": "",
        "optimise/__init__.py": "",
        "tests/test_twice.py": textwrap.dedent(_TEST),
        "pyproject.toml": "[tool.pytest.ini_options]\naddopts = ['--import-mode=importlib']\n",
    }
    for name, text in files.items():
        (tmp_path / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "tree" / name).write_text(text)
    return tmp_path / "tree"


@pytest.mark.parametrize(
    ("plant", "test", "caught_by", "trouble"),
    [
        ("3 * x", "test_by_hand", ("test_by_hand",), ""),
        ("3 * x", "test_zero", (), "NOT CAUGHT by test_zero"),
        ("1 / 0", "test_fixture", (), "ZeroDivisionError in setup of tests/test_twice.py::test_fi"),
        ("2 * y", "test_by_hand", (), "NameError in call"),
        ("2 * x\nimport none", "test_by_hand", (), "in collect"),
        ("2 * x", "test_gone", (), "the tree has none of its tests"),
    ],
)
@pytest.mark.slow
def test_verdicts(tree, tmp_path, plant, test, caught_by, trouble):
    source = (tree / "jaxgear" / "__init__.py").read_text()
    tests = (f"tests/test_twice.py::{test}",)
    fault = Fault("twice", "Not twice.", "jaxgear/__init__.py", "2 * x", plant, tests)
    row = examined(fault, tree, tmp_path / "scratch")
    assert row.caught_by == caught_by
    assert trouble in row.trouble
    assert bool(row.trouble) == (not caught_by)
    assert (tree / "jaxgear" / "__init__.py").read_text() == source


def test_sources_of_another_tree_are_refused(tree, tmp_path):
    """As where an editable install comes first: here the tree lacks a package."""
    (tree / "fem_prep" / "__init__.py").unlink()
    (tree / "fem_prep").rmdir()
    test = ("tests/test_twice.py::test_by_hand",)
    with pytest.raises(RuntimeError, match=r"must import the sources of .*, they imported"):
        planted_faults.heard_from(tree, test, tmp_path / "scratch")
