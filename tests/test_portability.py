"""What other systems would trip over: encodings, calls that only POSIX has, names of files."""

import ast
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

_ROOT = Path(__file__).parents[1]
_FILES = sorted(
    path
    for package in ("jaxgear", "fem_prep", "optimise")
    for path in (_ROOT / package).rglob("*.py")
)
_POSIX_MODULES = {
    *("fcntl", "grp", "posix", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty"),
}
_POSIX_OF_OS = {
    *("O_DIRECTORY", "O_NOFOLLOW", "chown", "fork", "getegid", "geteuid", "getgid", "getloadavg"),
    *("getuid", "killpg", "mkfifo", "nice", "openpty", "sched_getaffinity", "setsid", "statvfs"),
    *("sysconf", "uname", "wait4"),
}
_FORBIDDEN = set('<>:"|?*\\')
_RESERVED = {
    "con",
    "prn",
    "aux",
    "nul",
    *(f"{port}{i}" for port in ("com", "lpt") for i in range(10)),
}


def _without_encoding(call: ast.Call) -> bool:
    """Whether a call reads or writes text in the encoding that the system happens to have."""
    given = {each.arg for each in call.keywords}
    first = call.args[0] if call.args else None
    if {"encoding", None} & given:
        return False
    match call.func:
        case ast.Name("open"):
            mode = call.args[1] if len(call.args) > 1 else None
        case ast.Attribute(attr="read_text"):
            return first is None
        case ast.Attribute(attr="write_text"):
            return len(call.args) < 2
        case ast.Attribute(attr="open") if first is None or isinstance(first, ast.Constant):
            mode = first
        case ast.Attribute(attr="run" | "Popen" | "check_output"):
            return bool({"text", "universal_newlines"} & given)
        case _:
            return False
    return not (isinstance(mode, ast.Constant) and "b" in str(mode.value))


def _of_posix_only(nodes: Sequence[ast.AST]) -> list[tuple[str, int]]:
    """Modules and functions that Windows lacks, where nothing asks first whether they are there."""
    found = [(each, name) for each in nodes for name in _posix_names(each)]
    # Few files have any, and guards take long to find.
    guards = [each for each in nodes if _is_guard(each)] if found else []
    guarded = {id(inner) for each in guards for inner in ast.walk(each)}
    return [name for each, name in found if id(each) not in guarded]


def _posix_names(each: ast.AST) -> list[tuple[str, int]]:
    """What a node names of these, and in which line."""
    match each:
        case ast.Import(names):
            return [(x.name, each.lineno) for x in names if x.name in _POSIX_MODULES]
        case ast.ImportFrom(module) if module in _POSIX_MODULES:
            return [(module, each.lineno)]
        case ast.Attribute(ast.Name("os"), attr) if attr in _POSIX_OF_OS:
            return [(f"os.{attr}", each.lineno)]
        case _:
            return []


def _is_guard(each: ast.AST) -> bool:
    """Whether what is within is there, or is not missed."""
    match each:
        case ast.Try():
            return bool(each.handlers)
        case ast.With():
            return "suppress(AttributeError" in ast.unparse(each.items[0])
        case ast.If() | ast.IfExp():
            asked = ast.unparse(each.test)
        case ast.BoolOp():
            asked = ast.unparse(each)
        case ast.FunctionDef():
            # It returns at once without the module.
            first = next((x for x in each.body if isinstance(x, ast.If)), None)
            words = "" if first is None else ast.unparse(first.test)
            return words in {f"{name} is None" for name in _POSIX_MODULES}
        case _:
            return False
    return any(words in asked for words in ("hasattr(os", "os.name", "sys.platform"))


@pytest.mark.parametrize("path", _FILES, ids=lambda path: str(path.relative_to(_ROOT)))
def test_text_has_an_encoding_and_nothing_is_of_posix_only(path):
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    calls = [each for each in nodes if isinstance(each, ast.Call)]
    assert [each.lineno for each in calls if _without_encoding(each)] == []
    assert _of_posix_only(nodes) == []


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("open('a')", (1, 0)),
        ("open('a', 'rb')", (0, 0)),
        ("open('a', 'w', encoding='utf-8')", (0, 0)),
        ("path.open()", (1, 0)),
        ("path.open('wb')", (0, 0)),
        ("path.read_text()", (1, 0)),
        ("path.read_text('utf-8')", (0, 0)),
        ("path.write_text('x')", (1, 0)),
        ("subprocess.run(x, text=True)", (1, 0)),
        ("import resource", (0, 1)),
        ("try:\n    import resource\nexcept ImportError:\n    pass", (0, 0)),
        ("os.getuid()", (0, 1)),
        ("os.open(a, os.O_DIRECTORY)", (0, 1)),
        ("if hasattr(os, 'getuid') and os.getuid():\n    pass", (0, 0)),
    ],
)
def test_the_search_finds_what_it_is_for(code, found):
    nodes = list(ast.walk(ast.parse(code)))
    calls = [each for each in nodes if isinstance(each, ast.Call)]
    assert (sum(map(_without_encoding, calls)), len(_of_posix_only(nodes))) == found


def test_names_of_files_can_be_on_any_system():
    """No sign that Windows refuses, no two that differ in their case alone."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=_ROOT, capture_output=True, check=False
    ).stdout.decode("utf-8")
    names = listed.split("\0")[:-1]
    if not names:
        pytest.skip("not a checkout")
    parts = {part for name in names for part in name.split("/")}
    assert [part for part in parts if _FORBIDDEN & set(part) or part.endswith((".", " "))] == []
    assert [part for part in parts if part.partition(".")[0].lower() in _RESERVED] == []
    assert len({name.lower() for name in names}) == len(names)
    assert max(map(len, names)) < 150
