"""Where results go: a folder for each command, whose files change together and only once all exist.

A command writes into a draft inside its folder. When it has ended well, its files take the places
of those that the same command left there before, and what it did not write again is removed. Which
files these are stands in a list beside them, with a hash of each: a file that somebody has changed,
and one that is not on the list, is the user's.
"""

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

from jaxgear._whole_file import write_text

try:
    import fcntl
except ImportError:  # Windows: no draft is known to be at work, so all stay that a kill has left.
    fcntl = None

# The list that a command keeps of its files: the SHA-256 of each under its name.
_LIST = ".jaxgear.json"
# A draft has the first name until it is locked: with the second and no lock a kill has left it.
_NEW, _DRAFT = ".jaxgear-new-", ".jaxgear-draft-"

# The page that shows all results of a folder.
REPORT = "report.html"

# Results need at least as much space [byte].
_ROOM = 1 << 20


@dataclass(frozen=True)
class Folder:
    """The folder of a command's results.

    **Fields:**

    - `path`: where they are.
    - `pictures`: whether pictures are drawn, or their data written only.
    - `draft`: where they wait until the command has ended; they do not without it.
    - `common`: the folder of all commands on the scene; `path` without it.
    """

    path: Path
    pictures: bool = True
    draft: Path | None = None
    common: Path | None = None

    def __truediv__(self, name: str) -> Path:
        return (self.draft or self.path) / name

    def kept(self, name: str) -> Path:
        """A file that is no result: other commands, and those that go on after a kill, read it."""
        return (self.common or self.path) / name


@contextlib.contextmanager
def begun(folder: Folder) -> Generator[Folder]:
    """Make a folder, and give it with a draft in it that ends with the context.

    **Raises:**

    - `OSError`, or `ValueError` of a name that cannot be, if results cannot be written there.
    """
    folder.path.mkdir(parents=True, exist_ok=True)
    for path in {folder.path, folder.common or folder.path}:
        _clear_drafts(path)
    with _locked(Path(tempfile.mkdtemp(prefix=_NEW, dir=folder.path))) as draft:
        try:
            with tempfile.TemporaryFile(dir=draft) as file:
                file.write(bytes(_ROOM))
            yield Folder(folder.path, folder.pictures, draft, folder.common)
        finally:
            shutil.rmtree(draft, ignore_errors=True)


def publish(folder: Folder) -> None:
    """Put the files of a draft in their places, and remove what is left of the run before."""
    assert folder.draft is not None
    files = sorted(path for path in folder.draft.rglob("*") if path.is_file())
    new = {str(path.relative_to(folder.draft)): _digest(path) for path in files}
    old = written(folder.path)
    # What a kill leaves half done is still known.
    _note(folder.path, old | new)
    for name in new:
        (folder.path / name).parent.mkdir(exist_ok=True)
        os.replace(folder.draft / name, folder.path / name)
    for name in old.keys() - new.keys():
        _remove(folder.path, name, old[name])
    _note(folder.path, new)


def written(path: Path) -> dict[str, str]:
    """The files that a command has left in its folder, and the SHA-256 of each.

    There may be no list of them, or a spoilt one.
    """
    try:
        found = json.loads((path / _LIST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _note(path: Path, files: dict[str, str]) -> None:
    write_text(json.dumps(files, indent=1) + "\n", path / _LIST)


def _remove(path: Path, name: str, digest: str) -> None:
    """Remove a file of ours, and its own folder if nothing else is in it."""
    old = path / name
    # A name may lead elsewhere if somebody has written the list.
    if old.resolve().is_relative_to(path.resolve()) and old.is_file():
        if _digest(old) != digest:
            return
        old.unlink()
        if old.parent != path:
            with contextlib.suppress(OSError):
                old.parent.rmdir()


@contextlib.contextmanager
def _locked(new: Path) -> Generator[Path]:
    """Lock a draft while its command is at work, and name it so: the lock goes with the process."""
    if fcntl is None:
        yield new
        return
    handle = os.open(new, os.O_RDONLY)
    try:
        # Some file systems know no locks: drafts that a kill leaves there stay.
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield new.rename(new.with_name(_DRAFT + new.name.removeprefix(_NEW)))
    finally:
        os.close(handle)


def _clear_drafts(path: Path) -> None:
    """Remove the drafts of commands that were killed."""
    if fcntl is None:
        return
    for draft in path.glob(f"{_DRAFT}*"):
        with contextlib.suppress(OSError):
            handle = os.open(draft, os.O_RDONLY | os.O_DIRECTORY)
            try:
                # Fails while its command is at work.
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(draft)
            finally:
                os.close(handle)
