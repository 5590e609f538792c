"""The limit on what a fast test may take."""

import budget
import pytest

pytest_plugins = ["pytester"]

_TESTS = """
import time
import pytest

def _work():
    start = time.process_time()
    while time.process_time() - start < 0.3:
        pass

def test_short(): pass
def test_waits(): time.sleep(0.3)
def test_long(): _work()
@pytest.mark.slow
def test_slow(): _work()
@pytest.mark.end_to_end
def test_whole(): _work()
def test_wrong(): _work(); assert False

@pytest.fixture
def shared(): _work()
def test_shares(shared): pass
"""


@pytest.fixture
def run(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch):
    def run(limit: float, slowness: float = 1.0) -> pytest.RunResult:
        monkeypatch.setattr(budget, "_slowness", lambda: slowness)
        marks = "-o", "markers=slow\nend_to_end"
        options = "-o", f"fast_test_processor_s={limit}", "-p", "no:cacheprovider"
        return pytester.runpytest_inprocess(*options, *marks, plugins=[budget])

    pytester.makepyfile(_TESTS)
    return run


def test_a_fast_test_over_its_processor_seconds_fails_by_name(run):
    result = run(0.1)
    result.assert_outcomes(passed=5, failed=2)
    result.stdout.fnmatch_lines(["*_ test_long _*", "A fast test must take at most 0.1 s *"])
    result.stdout.fnmatch_lines(["*_ test_wrong _*", "*assert False*"])


def test_the_limit_is_stretched_where_the_machine_is_slow(run):
    run(0.2, slowness=20.0).assert_outcomes(passed=6, failed=1)
