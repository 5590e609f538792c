"""Plants faults in the sources, one at a time, and sees whether the tests catch each of them.

`planted_faults.toml` beside this file holds small mistakes as an engineer makes them: a sign, a
factor of two, a sine for a cosine, an error that is swallowed. Of each it names the tests that must
fail. They run on a copy of the tree, whose sources are shown to be those that were imported. Caught
is a fault by a test that fails; a test that cannot be collected, or whose fixtures break, is none.

`make test-faults`, or `python tests/planted_faults.py --help`. pytest loads this file as a plugin
too, to hear what became of each test.
"""

import argparse
import ast
import contextlib
import dataclasses
import importlib.util
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[1]
DATA = Path(__file__).with_suffix(".toml")
PACKAGES = ("jaxgear", "fem_prep", "optimise")

# Where the plugin writes what it heard.
_HEARD = "PLANTED_FAULTS_HEARD"
# Whoever writes a fault may write one that is none, but a file that cannot run.
_NOT_A_FAULT = {
    "ImportError",
    "IndentationError",
    "ModuleNotFoundError",
    "NameError",
    "SyntaxError",
    "UnboundLocalError",
}
# Runs share what JAX compiles, every program of it, unless the environment says otherwise.
_COMPILED = {
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}
_LONGEST = 900.0  # of one run [s]


@dataclasses.dataclass(frozen=True)
class Fault:
    """A mistake to plant.

    **Fields:**

    - `name`: by which it is called for.
    - `says`: what is wrong, in one sentence.
    - `file`: from the root of the tree.
    - `find`: text that stands there once.
    - `plant`: text in its place.
    - `tests`: node identifiers of the tests that must fail.
    """

    name: str
    says: str
    file: str
    find: str
    plant: str
    tests: tuple[str, ...]

    def planted_in(self, text: str) -> str:
        """The text with the mistake in it.

        **Raises:**

        - `LookupError` if its place is not there, or there more than once.
        """
        times = text.count(self.find)
        if times != 1:
            raise LookupError(
                f"The text to replace must stand once in {self.file}, it stands there {times} "
                f"times. The source has moved on: find the place anew, in {DATA.name}."
            )
        return text.replace(self.find, self.plant)


@dataclasses.dataclass(frozen=True)
class Row:
    """What became of a fault: the tests that caught it, or why none did, and how long it took."""

    fault: Fault
    caught_by: tuple[str, ...] = ()
    trouble: str = ""
    seconds: float = 0.0


def read_faults(path: Path = DATA) -> list[Fault]:
    """All faults, in the order in which data flows."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))["fault"]
    return [Fault(**table | {"tests": tuple(table["tests"])}) for table in tables]


def absent_tests(tests: Sequence[str], root: Path) -> list[str]:
    """Those of some node identifiers that a tree does not have; parameters are not looked at."""
    found: dict[str, set[str]] = {}
    for test in tests:
        file = test.partition("::")[0]
        if file not in found:
            path = root / file
            body = ast.parse(path.read_bytes()).body if path.is_file() else []
            found[file] = {node.name for node in body if isinstance(node, ast.FunctionDef)}
    return [test for test in tests if _function(test) not in found[test.partition("::")[0]]]


def _function(test: str) -> str:
    """`test_x` of `tests/file.py::test_x[spur]`."""
    return test.partition("::")[2].partition("[")[0]


# --- What pytest calls, in the process that runs the tests

_failures: list[dict[str, str]] = []


def pytest_exception_interact(node, call, report):
    """Take down what failed, in which part of a test, and by what."""
    when = call.when if report.when else "collect"
    _failures.append({"test": node.nodeid, "when": when, "error": call.excinfo.typename})


def pytest_sessionfinish(session, exitstatus):
    """Leave word of the failures, and of where our packages were imported from."""
    specs = {name: importlib.util.find_spec(name) for name in PACKAGES}
    heard = {
        "status": int(exitstatus),
        "failures": _failures,
        "origins": [str(spec and spec.origin) for spec in specs.values()],
    }
    Path(os.environ[_HEARD]).write_text(json.dumps(heard), encoding="utf-8")


# --- One run


def heard_from(
    tree: Path, tests: Sequence[str], scratch: Path, *, clean: bool = False
) -> Mapping[str, object]:
    """Run tests of a tree on its own sources.

    **Arguments:**

    - `tree`: a copy of the repository.
    - `tests`: node identifiers.
    - `scratch`: a folder for the plugin, and for all that runs keep.
    - `clean`: whether the sources are as they should be: only then what Python compiles is kept.

    **Returns:**

    What the plugin heard, and `output`, the text that pytest wrote.

    **Raises:**

    - `RuntimeError` if other sources than those of the tree were imported.
    """
    plugin = scratch / "plugin"
    plugin.mkdir(parents=True, exist_ok=True)
    shutil.copy(__file__, plugin)
    with tempfile.TemporaryDirectory(dir=scratch) as own:
        heard = Path(own) / "heard.json"
        # The path comes before the finder of an editable install, which knows the original tree.
        places = os.pathsep.join(map(str, (tree, plugin)))
        env = _COMPILED | {"JAX_COMPILATION_CACHE_DIR": str(scratch / "compiled")} | os.environ
        env |= {"PYTHONPATH": places, "JAXGEAR_CACHE": own, _HEARD: str(heard)}
        if not clean:
            env["PYTHONDONTWRITEBYTECODE"] = "1"
        command = [sys.executable, "-m", "pytest", "-q", "--no-header", "--tb=short"]
        command += ["-p", "no:cacheprovider", "-p", Path(__file__).stem, *tests]
        # A file of tests needs long where its fault makes a solver go on and on.
        limit = None if clean else _LONGEST
        try:
            ran = subprocess.run(
                command, cwd=tree, env=env, capture_output=True, text=True, timeout=limit
            )
        except subprocess.TimeoutExpired:
            return {"status": -1, "failures": [], "output": f"No end after {_LONGEST:g} s."}
        output = ran.stdout + ran.stderr
        if not heard.is_file():
            return {"status": -1, "failures": [], "output": output}
        found = json.loads(heard.read_text(encoding="utf-8"))
    for origin in found["origins"]:
        if not Path(origin).is_relative_to(tree):
            raise RuntimeError(
                f"The tests must import the sources of {tree}, they imported {origin}"
            )
    return found | {"output": output}


@contextlib.contextmanager
def planted(fault: Fault, tree: Path) -> Generator[None]:
    """Plant a fault in a tree, and take it out again."""
    path = tree / fault.file
    text = path.read_text(encoding="utf-8")
    path.write_text(fault.planted_in(text), encoding="utf-8")
    try:
        yield
    finally:
        path.write_text(text, encoding="utf-8")


def examined(fault: Fault, tree: Path, scratch: Path) -> Row:
    """Plant a fault in a tree, and run its tests there."""
    begin = time.perf_counter()
    row = lambda caught_by=(), trouble="": Row(
        fault, caught_by, trouble, time.perf_counter() - begin
    )
    missing = absent_tests(fault.tests, tree)
    tests = [test for test in fault.tests if test not in missing]
    if not tests:
        return row(trouble="the tree has none of its tests")
    try:
        with planted(fault, tree):
            heard = heard_from(tree, tests, scratch)
    except (LookupError, OSError) as error:
        return row(trouble=str(error))
    failures = heard["failures"]
    assert isinstance(failures, list)
    broken = [x for x in failures if x["when"] != "call" or x["error"] in _NOT_A_FAULT]
    if broken or heard["status"] not in (0, 1):
        why = [f"{x['error']} in {x['when']} of {x['test']}" for x in broken]
        return row(trouble=f"no verdict: {'; '.join(why) or str(heard['output'])[-2000:]}")
    by = dict.fromkeys(_function(failure["test"]) for failure in failures)
    return row(tuple(by), "" if by else "NOT CAUGHT by " + ", ".join(map(_function, tests)))


# --- All of them


def copied(source: Path, target: Path) -> Path:
    """Copy what git knows of a working tree, and what is new there and not ignored."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=source,
        capture_output=True,
        text=True,
        check=True,
    )
    for name in filter(None, listed.stdout.split("\0")):
        if (source / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source / name, target / name)
    return target


def examined_all(faults: Sequence[Fault], root: Path, scratch: Path, jobs: int) -> Iterator[Row]:
    """Examine faults in copies of a tree, in which their tests pass as long as there is none.

    **Arguments:**

    - `faults`: to be planted.
    - `root`: of the tree.
    - `scratch`: an empty folder.
    - `jobs`: how many to examine at once.

    **Raises:**

    - `SystemExit` if a test fails without any fault.
    """
    first = copied(root, scratch / "tree-0")
    every = list(dict.fromkeys(test for fault in faults for test in fault.tests))
    missing = absent_tests(every, first)
    begin = time.perf_counter()
    heard = heard_from(first, [test for test in every if test not in missing], scratch, clean=True)
    if heard["status"] != 0:
        sys.exit(f"{heard['output']}\nThese tests must pass while no fault is planted.")
    print(f"without a fault, {len(every) - len(missing)} tests pass", end=" ")
    print(f"({time.perf_counter() - begin:.0f} s)", flush=True)
    trees: queue.SimpleQueue[Path] = queue.SimpleQueue()
    trees.put(first)
    for number in range(1, jobs):
        trees.put(shutil.copytree(first, scratch / f"tree-{number}"))

    def examine(fault: Fault) -> Row:
        tree = trees.get()
        try:
            return examined(fault, tree, scratch)
        finally:
            trees.put(tree)

    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(examine, faults)


def _chosen(faults: Sequence[Fault], names: Sequence[str]) -> list[Fault]:
    unknown = set(names) - {fault.name for fault in faults}
    if unknown:
        sys.exit(f"There is no fault {', '.join(sorted(unknown))}; --list names all.")
    return [fault for fault in faults if not names or fault.name in names]


def main() -> int:
    """Examine the faults that the command line names; 1 if one of them is not caught."""
    parser = argparse.ArgumentParser(description="Plant faults, and see whether tests catch them.")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="repeatable")
    parser.add_argument("--list", action="store_true", help="name the faults, and stop")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="faults at once")
    parser.add_argument(
        "--against", type=Path, default=ROOT, metavar="PATH", help="sources and tests of this tree"
    )
    args = parser.parse_args()
    faults = _chosen(read_faults(), args.only)
    width = max(len(fault.name) for fault in faults)
    if args.list:
        for fault in faults:
            print(f"{fault.name:<{width}}  {fault.says}")
        return 0
    lost = []
    with tempfile.TemporaryDirectory(prefix="planted-faults-") as folder:
        scratch = Path(folder).resolve()
        print(f"{'fault':<{width}}  {'s':>4}  caught by")
        for row in examined_all(faults, args.against.resolve(), scratch, args.jobs):
            by = row.trouble or ", ".join(row.caught_by)
            print(f"{row.fault.name:<{width}}  {row.seconds:4.0f}  {by}", flush=True)
            lost += [row.fault.name] if row.trouble else []
    print(f"{len(faults) - len(lost)} of {len(faults)} faults caught")
    if lost:
        print(f"not caught: {', '.join(lost)}")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
