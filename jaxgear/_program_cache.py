"""Compiled programs, kept in the user's cache folder by JAX's own means.

JAX does not compile a program that it finds there; everything that a program depends on is part of
its key, but for the processor, which the name of the folder states. The cache only saves time:
whatever is wrong with it is said once, and the work goes on. Whoever can write to the folder can
have his code run by whoever uses it, so it belongs to one user alone.
"""

import atexit
import collections
import contextlib
import dataclasses
import glob
import hashlib
import json
import os
import platform
import re
import stat
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import platformdirs

# Of all folders together [byte]. JAX's own limit scans the folder at each write; this one is
# kept once in a process.
LIMIT = 1_000_000_000

_LAST_RUN = "last_run.json"

# What JAX says of an entry that it cannot read or write: the program, and why.
_TROUBLE = re.compile(r"Error (reading|writing) persistent compilation cache entry for '(.*?)': ")

# What tells processors apart: the words of Linux on x86, on ARM and on RISC-V.
_PROCESSOR = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags", "Features")
_PROCESSOR += ("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "isa", "uarch")

Tell = Callable[[str], None]


class CompilationCacheWarning(UserWarning):
    """The cache of compiled programs is of no use just now; the work is done all the same."""


@dataclasses.dataclass(frozen=True)
class Programs:
    """The compiled programs in one folder: for one processor, JAX and Python.

    **Fields:**

    - `folder`: where they are.
    - `count`: how many there are.
    - `size`: of their files [byte].
    - `used`: when one was last read or written [s since 1970].
    - `asked`, `found`: how many programs the last process that ended here has asked for, and how
        many of these it did not compile; none of either if that is not known.
    """

    folder: Path
    count: int
    size: int
    used: float
    asked: int
    found: int


def _warned(text: str) -> None:
    warnings.warn(text, CompilationCacheWarning, stacklevel=3)


def cache_compilations(tell: Tell = _warned) -> None:
    """Keep compiled programs for later processes, and take from there what is compiled already.

    They are in the cache folder of the user, or below `$JAXGEAR_CACHE`, which may be `off`. A
    folder that JAX was given, such as by `$JAX_COMPILATION_CACHE_DIR`, is used as it is.

    This sets up JAX for the whole process. Importing jaxgear does not.

    **Arguments:**

    - `tell`: told, once, what keeps the cache from being of use; a warning if it is left out.
    """
    import jax

    config: Any = jax.config
    base = programs_folder()
    if not config.jax_enable_compilation_cache or base is None:
        return
    given = config.jax_compilation_cache_dir
    if not given:
        folder = base / _fingerprint()
        fault = _fault_of(base) or _fault_of(folder)
        if fault:
            tell(
                f"Compiled programs cannot be kept in {folder} ({fault}), so that this run is "
                "slower than it need be. Set JAXGEAR_CACHE to a folder of your own with space in "
                "it, or to off."
            )
            return
        _prune(base)
        _note_use(folder)
        config.update("jax_compilation_cache_dir", str(folder))
    else:
        folder = Path(given)
    # Programs of gear pairs are many and small, and each counts. Nobody's own choice is changed.
    for name, value in (("min_compile_time_secs", 0.0), ("min_entry_size_bytes", -1)):
        if f"JAX_PERSISTENT_CACHE_{name.upper()}" not in os.environ:
            config.update(f"jax_persistent_cache_{name}", value)
    if not isinstance(warnings.showwarning, _Watch):
        warnings.filterwarnings("always", _TROUBLE.pattern, UserWarning)
        warnings.showwarning = _Watch(warnings.showwarning, folder, tell)  # ty: ignore[invalid-assignment]


def set_up(tell: Tell = _warned) -> None:
    """Set a process of our own up: double precision, and compiled programs that are kept.

    **Arguments:**

    - `tell`: as of `cache_compilations`.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    # Where each operation stands in the sources is for profilers; XLA takes a while to join that.
    if "JAX_TRACEBACK_IN_LOCATIONS_LIMIT" not in os.environ:
        jax.config.update("jax_traceback_in_locations_limit", 0)
    cache_compilations(tell)


def programs_folder() -> Path | None:
    """Where compiled programs are kept, a folder for each processor, JAX and Python; None: nowhere.

    It is below `$JAXGEAR_CACHE`, or below the user's cache folder.
    """
    own = os.environ.get("JAXGEAR_CACHE")
    if own == "off":
        return None
    # No author and no more words than the name: the same folder as that of condensed bodies.
    user = platformdirs.user_cache_path("jaxgear", appauthor=False, opinion=False)
    return (Path(own).expanduser() if own else user) / "compiled"


def kept_programs() -> list[Programs]:
    """What is kept, a row for each processor, JAX and Python, the last used first."""
    found = []
    for folder in _folders(programs_folder()):
        entries = list(_entries(folder))
        if not entries:
            continue
        try:
            last = json.loads((folder / _LAST_RUN).read_text("utf-8"))
            asked, hits = int(last["asked"]), int(last["found"])
        except (OSError, ValueError, KeyError, TypeError):
            asked = hits = 0
        size, used = sum(each[1] for each in entries), max(each[0] for each in entries)
        found.append(Programs(folder, len(entries), size, used, asked, hits))
    return sorted(found, key=lambda each: -each.used)


def clear_programs() -> int:
    """Remove all compiled programs; returns what was freed [byte].

    The folders stay: another process may be about to write to one.
    """
    freed = 0
    for folder in _folders(programs_folder()):
        for path in folder.rglob("*"):
            with contextlib.suppress(OSError):
                size = path.stat().st_size
                freed += size * (path.is_file() and _removed(path))
    return freed


def _fingerprint() -> str:
    """Name of the folder for programs of this processor, JAX and Python."""
    # As imported: after an update in the place of another version its files would say otherwise.
    import jax
    import jax.lib

    words = [
        f"jax-{jax.__version__}",
        jax.lib.__version__,
        sys.implementation.cache_tag or "",
    ]
    return "-".join([*words, hashlib.sha256(_processor().encode()).hexdigest()[:12]])


def _processor() -> str:
    """What is known of the processor: a program of another one may not run here."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            # The first one: they are alike, and the file may be long.
            lines = [line for line in iter(file.readline, "\n") if line]
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    known = [line for line in lines if line.partition(":")[0].strip() in _PROCESSOR]
    return f"{platform.machine()} {''.join(known)}"


def _fault_of(folder: Path) -> str:
    """Make a folder that nobody else can write to; say why that cannot be, if it cannot."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.stat()
        if hasattr(os, "getuid") and about.st_uid != os.getuid():
            return "it belongs to another user, who could have programs of his own run"
        if stat.S_IMODE(about.st_mode) & 0o077:
            folder.chmod(0o700)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"written")
    except OSError as error:
        return error.strerror or str(error)
    return ""


class _Watch:
    """Shows warnings as ever, but of JAX's about the cache only the first, in our words.

    An entry that cannot be read is removed: JAX itself would try it again for ever.
    """

    def __init__(self, usual: Callable[..., None], folder: Path, tell: Tell):
        self.usual = usual
        self.folder = folder
        self.tell = tell
        self.told = False
        # Clocks of file systems are coarser.
        self.begun = time.time() - 1.0

    def __call__(self, message: object, *about: object) -> None:
        trouble = _TROUBLE.match(str(message))
        if trouble is None:
            self.usual(message, *about)
            return
        action, program = trouble.groups()
        why = str(message)[trouble.end() :]
        if action == "reading" and why.startswith("FileNotFoundError"):
            # Another process has just removed it.
            return
        for path in self.folder.glob(f"{glob.escape(program)}-*-cache"):
            # Which of these it was is not said. Of one that was to be written half may be there.
            with contextlib.suppress(OSError):
                if action == "reading" or path.stat().st_mtime > self.begun:
                    path.unlink()
        if not self.told:
            self.told = True
            self.tell(self._words(action, why))

    def _words(self, action: str, why: str) -> str:
        if action == "reading":
            return (
                f"Compiled programs in {self.folder} were damaged ({why}). They have been removed "
                "and are compiled anew."
            )
        return (
            f"Compiled programs cannot be kept in {self.folder} ({why}): later runs will compile "
            "them again. Free space there, or set JAXGEAR_CACHE to a folder with space, or to off."
        )


def _note_use(folder: Path) -> None:
    """At the end of the process, note how many programs it took from the cache."""
    import jax

    events: collections.Counter[str] = collections.Counter()
    jax.monitoring.register_event_listener(lambda event, **about: events.update([event]))
    atexit.register(_write_use, folder, events)


def _write_use(folder: Path, events: collections.Counter[str]) -> None:
    start = "/jax/compilation_cache/"
    asked, found = (events[start + name] for name in ("compile_requests_use_cache", "cache_hits"))
    if asked:
        with contextlib.suppress(OSError):
            (folder / _LAST_RUN).write_text(json.dumps({"asked": asked, "found": found}), "utf-8")


def _prune(base: Path) -> None:
    """Remove what was not used for longest, until the rest is within the limit."""
    entries = [entry for folder in _folders(base) for entry in _entries(folder)]
    excess = sum(size for _, size, _ in entries) - LIMIT
    for _, size, path in sorted(entries) if excess > 0 else ():
        if excess <= 0:
            return
        excess -= size * _removed(path)


def _folders(base: Path | None) -> list[Path]:
    try:
        return sorted(path for path in base.iterdir() if path.is_dir()) if base else []
    except OSError:
        return []


def _entries(folder: Path) -> Iterator[tuple[float, int, Path]]:
    """When each program was last used, its size, and its file."""
    try:
        with os.scandir(folder) as found:
            for entry in found:
                # JAX leaves no mark where it reads, but most file systems do, once a day.
                with contextlib.suppress(OSError):
                    about = entry.stat()
                    if entry.name.endswith("-cache"):
                        used = max(about.st_atime, about.st_mtime)
                        yield used, about.st_size, Path(entry.path)
    except OSError:
        return


def _removed(path: Path) -> bool:
    """Remove a file; say whether it is gone, by our hand."""
    try:
        path.unlink()
    except OSError:
        return False
    return True
