"""The benchmark of whole commands: how it splits seconds, and that it measures a process."""

import importlib
import sys
from pathlib import Path

import pytest

_FOLDER = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture(scope="module")
def bench():
    sys.path.insert(0, str(_FOLDER))
    try:
        yield importlib.import_module("bench_answers")
    finally:
        sys.path.remove(str(_FOLDER))


def test_each_moment_belongs_to_the_innermost_span(bench):
    spans = [
        ("import", 1.0, 2.0),
        ("draw", 3.0, 9.0),
        ("import", 3.0, 4.0),
        ("trace", 5.0, 7.0),
        ("trace", 5.5, 6.0),
        ("write", 8.0, 8.5),
        # Its end was read on the clock a little after that of the span around it.
        ("compile", 8.75, 9.25),
    ]
    found = bench.parted(spans[::-1], 0.0, 10.0)
    known = {"import": 2.0, "draw": 2.25, "trace": 2.0, "write": 0.5, "compile": 0.25, "solve": 3.0}
    assert {kind: seconds for kind, seconds in found.items() if seconds} == known
    assert sum(bench.parted(spans, 0.5, 8.25).values()) == pytest.approx(7.75)


def test_a_process_is_measured(bench, tmp_path):
    """Its own seconds, memory and exit code, and the import of a file as such."""
    (tmp_path / "busy.py").write_text("x = sum(i * i for i in range(3_000_000))\n")
    (tmp_path / "script.py").write_text(
        "import sys\nsys.path.insert(0, '.')\nimport busy\nraise SystemExit(0)\n"
    )
    found = bench.answered(Path(sys.executable), ("python", "script.py"), tmp_path, {})
    assert found.code == 0
    assert found.memory_MB > 1.0
    assert 0.0 < found.processor_s
    assert 0.5 * found.processor_s < found.parts_s["import"] < found.processor_s
    (tmp_path / "wrong.py").write_text("raise SystemExit(3)\n")
    assert bench.answered(Path(sys.executable), ("python", "wrong.py"), tmp_path, {}).code == 3


def test_the_page_on_python_has_two_snippets(bench):
    at_rest, in_motion = bench.snippets()
    assert in_motion.startswith(at_rest)
    assert "torque=80.0" in at_rest
    assert "steady_state" in in_motion
