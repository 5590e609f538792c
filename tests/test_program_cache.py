"""Compiled programs kept between processes: found again, and never in the way."""

import errno
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import platformdirs
import pytest

from jaxgear import _program_cache
from jaxgear._program_cache import (
    CompilationCacheWarning,
    cache_compilations,
    clear_programs,
    kept_programs,
    programs_folder,
)

ROOT = Path(__file__).parents[1]

# Three programs in a process of their own; says what they give and how many were compiled.
_PROGRAMS = """
import resource, sys
import jax
before = dict(jax.config.values)
import jaxgear as jg
for name in jg.__all__:
    getattr(jg, name)
assert dict(jax.config.values) == before
if "short" in sys.argv:
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
jg.cache_compilations()
jg.cache_compilations()
found = []
jax.monitoring.register_event_listener(lambda event, **about: found.append(event))
for name in ("sin", "cos", "tan"):
    print(float(jax.jit(getattr(jax.lax, name))(2.0)))
print(found.count("/jax/compilation_cache/cache_hits"), "found")
"""


@pytest.fixture
def user(tmp_path, monkeypatch) -> Path:
    """An empty cache folder of a user whose JAX keeps no programs yet."""
    monkeypatch.setenv("JAXGEAR_CACHE", str(tmp_path / "cache"))
    for name in list(os.environ):
        if name.startswith(("JAX_COMPILATION_CACHE", "JAX_PERSISTENT", "JAX_ENABLE_COMPILATION")):
            monkeypatch.delenv(name)
    return tmp_path / "cache" / "compiled"


@pytest.fixture
def settings(user, monkeypatch) -> dict[str, object]:
    """What JAX is told to do, in place of telling it; nothing is set so far."""
    told: dict[str, object] = {}
    config = type(
        "Config",
        (),
        {"jax_enable_compilation_cache": True, "jax_compilation_cache_dir": None}
        | {"update": lambda self, name, value: told.update({name: value})},
    )
    monkeypatch.setattr(jax, "config", config())
    monkeypatch.setattr(jax.monitoring, "register_event_listener", lambda listener: None)
    monkeypatch.setattr(_program_cache.atexit, "register", lambda *given: None)
    return told


def _started(*arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", _PROGRAMS, *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _answer(process: subprocess.Popen) -> tuple[list[str], int, list[str]]:
    """What the programs gave, how many were found, and the notes of it."""
    output, errors = process.communicate()
    assert process.returncode == 0, errors
    *values, last = output.splitlines()
    said = [line for line in errors.splitlines() if "Warning:" in line]
    assert all("CompilationCacheWarning: Compiled programs" in line for line in said), errors
    return values, int(last.split()[0]), said


@pytest.mark.end_to_end
@pytest.mark.slow
def test_programs_are_compiled_once_and_whatever_befalls_them_is_one_note(user):
    # Two at once into an empty folder.
    (first, _, said), (second, _, too) = map(_answer, [_started(), _started()])
    assert first == second
    assert said == too == []
    (row,) = kept_programs()
    assert row.count == 3
    assert user.stat().st_mode & 0o777 == row.folder.stat().st_mode & 0o777 == 0o700
    assert _answer(_started()) == (first, 3, [])
    (row,) = kept_programs()
    assert (row.asked, row.found) == (3, 3)
    # One cut short, one emptied, one scrambled.
    one, two, three = sorted(row.folder.glob("*-cache"))
    one.write_bytes(one.read_bytes()[:50])
    two.write_bytes(b"")
    three.write_bytes(bytes(byte ^ 7 for byte in three.read_bytes()))
    values, found, said = _answer(_started())
    assert (values, found) == (first, 0)
    assert len(said) == 1
    assert "were damaged" in said[0]
    assert _answer(_started()) == (first, 3, [])
    # Now a disk on which nothing more has room: what was begun there is no entry.
    clear_programs()
    values, found, said = _answer(_started("short"))
    assert (values, found) == (first, 0)
    assert len(said) == 1
    assert "cannot be kept" in said[0]
    assert "File too large" in said[0]
    assert not list(user.rglob("*-cache"))


def test_the_folder(monkeypatch):
    monkeypatch.setenv("JAXGEAR_CACHE", "~/a")
    assert programs_folder() == Path.home() / "a/compiled"
    monkeypatch.setenv("JAXGEAR_CACHE", "off")
    assert programs_folder() is None
    monkeypatch.delenv("JAXGEAR_CACHE")
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name, **_: Path("/b") / name)
    assert programs_folder() == Path("/b/jaxgear/compiled")


def test_jax_is_told_to_keep_all_programs(user, settings):
    cache_compilations()
    folder = user / _program_cache._fingerprint()
    assert settings == {
        "jax_compilation_cache_dir": str(folder),
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }
    assert folder.is_dir()


@pytest.mark.parametrize("way", ["off", "jax"])
def test_the_cache_can_be_turned_off(user, settings, monkeypatch, way):
    if way == "off":
        monkeypatch.setenv("JAXGEAR_CACHE", "off")
    else:
        monkeypatch.setattr(jax.config, "jax_enable_compilation_cache", False)
    cache_compilations()
    assert not settings
    assert not user.exists()


def test_what_the_user_told_jax_stays(user, settings, monkeypatch, tmp_path):
    monkeypatch.setattr(jax.config, "jax_compilation_cache_dir", str(tmp_path / "own"))
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "2")
    cache_compilations()
    assert settings == {"jax_persistent_cache_min_entry_size_bytes": -1}
    assert not user.exists()


def _refuses(code: int):
    def refuse(*_, **__):
        raise OSError(code, os.strerror(code))

    return refuse


@pytest.mark.parametrize("fault", ["file", "full", "read only", "of another"])
def test_a_folder_that_will_not_do_is_one_note(user, settings, monkeypatch, fault):
    match fault:
        case "file":
            user.parent.mkdir()
            user.write_text("")
            words = "File exists"
        case "full":
            monkeypatch.setattr(tempfile, "TemporaryFile", _refuses(errno.ENOSPC))
            words = "No space left"
        case "read only":
            monkeypatch.setattr(Path, "mkdir", _refuses(errno.EROFS))
            words = "Read-only file system"
        case _:
            own = os.getuid()
            monkeypatch.setattr(os, "getuid", lambda: own + 1)
            words = "belongs to another user"
    notes = []
    cache_compilations(notes.append)
    assert len(notes) == 1
    assert words in notes[0]
    assert "Set JAXGEAR_CACHE to a folder" in notes[0]
    assert not settings
    with pytest.warns(CompilationCacheWarning, match=words):
        cache_compilations()


def test_others_are_shut_out_of_a_folder_that_was_open(user, settings):
    user.mkdir(parents=True)
    user.chmod(0o777)
    cache_compilations()
    assert user.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("what", ["jax", "jaxlib", "python", "processor"])
def test_another_version_or_processor_has_a_folder_of_its_own(monkeypatch, what):
    import jax.lib

    before = _program_cache._fingerprint()
    assert before == _program_cache._fingerprint()
    match what:
        case "jax":
            monkeypatch.setattr(jax, "__version__", "99")
        case "jaxlib":
            monkeypatch.setattr(jax.lib, "__version__", "99")
        case "python":
            monkeypatch.setattr(sys.implementation, "cache_tag", "cpython-399")
        case _:
            flags = _program_cache._processor()
            monkeypatch.setattr(_program_cache, "_processor", lambda: flags + " avx9")
    assert _program_cache._fingerprint() != before


def _kept(folder: Path, name: str, size: int, age: float) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}-cache"
    path.write_bytes(bytes(size))
    os.utime(path, (1e9 - age, 1e9 - age))
    return path


def test_what_was_not_used_for_longest_goes_where_the_cache_is_full(user, settings, monkeypatch):
    old = _kept(user / "other", "a", 40, 3.0)
    new, mid = _kept(user / "this", "b", 40, 1.0), _kept(user / "this", "c", 40, 2.0)
    monkeypatch.setattr(_program_cache, "LIMIT", 120)
    cache_compilations()
    assert old.exists()
    monkeypatch.setattr(_program_cache, "LIMIT", 80)
    cache_compilations()
    assert [path.exists() for path in (old, mid, new)] == [False, True, True]


def test_programs_are_listed_and_cleared(user):
    assert (kept_programs(), clear_programs()) == ([], 0)
    _kept(user / "one", "a", 40, 3.0)
    _kept(user / "two", "b", 30, 2.0)
    _kept(user / "two", "c", 20, 1.0)
    (user / "none").mkdir()
    last = json.dumps({"asked": 5, "found": 2})
    (user / "two" / "last_run.json").write_text(last)
    (user / "one" / "last_run.json").write_text("{")
    rows = [(row.folder.name, row.count, row.size, row.asked, row.found) for row in kept_programs()]
    assert rows == [("two", 2, 50, 5, 2), ("one", 1, 40, 0, 0)]
    assert kept_programs()[0].used == 1e9 - 1.0
    assert clear_programs() == 90 + len(last) + 1
    assert not [path for path in user.rglob("*") if path.is_file()]


@pytest.fixture
def watch(tmp_path):
    """What stands in the place of warnings, what it said, and what it passed on."""
    said, passed = [], []
    shown = _program_cache._Watch(lambda *given: passed.append(given[0]), tmp_path, said.append)
    return shown, said, passed


def _trouble(action: str, program: str, why: str) -> UserWarning:
    return UserWarning(f"Error {action} persistent compilation cache entry for '{program}': {why}")


def test_only_what_may_be_damaged_is_removed(watch, tmp_path):
    shown, said, passed = watch
    old = _kept(tmp_path, "jit_f-1", 1, 0.0)
    other = _kept(tmp_path, "jit_fg-1", 1, 0.0)
    new = tmp_path / "jit_f-2-cache"
    new.write_bytes(b"half")
    shown(_trouble("writing", "jit_f", "OSError: full"))
    assert [path.exists() for path in (old, other, new)] == [True, True, False]
    shown(_trouble("reading", "jit_f", "FileNotFoundError: gone"))
    assert old.exists()
    shown(_trouble("reading", "jit_f", "error: Error -5"))
    assert [path.exists() for path in (old, other)] == [False, True]
    assert len(said) == 1
    shown("something else")
    assert passed == ["something else"]
