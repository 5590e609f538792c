"""What is wrong with a scene: every mistake with its place, its path and what to do."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

# Mistakes that a message lists; names that are looked for among the known ones take their time.
LISTED = 100
SET = "--set "
# No scene is as long as this [byte]; devices have no end.
_LONGEST = 10_000_000


@dataclasses.dataclass(frozen=True)
class Mistake:
    """One thing wrong with a scene.

    **Fields:**

    - `where`: `file:line`, the file alone, or the `--set` argument.
    - `path`: dotted path of the key or table; empty where the whole file is meant.
    - `message`: what was given, what is allowed, what to do.
    """

    where: str
    path: str
    message: str

    def __str__(self) -> str:
        return ": ".join(part for part in (self.where, self.path, self.message) if part)


class SceneError(Exception):
    """Everything that is wrong with a scene; `str()` is the block to show the user."""

    def __init__(self, mistakes: Sequence[Mistake]):
        self.mistakes = tuple(mistakes)
        count = len(self.mistakes)
        total = f"{count} mistake{'s' if count > 1 else ''}; nothing was computed."
        listed = list(map(str, self.mistakes[:LISTED]))
        more = [f"... and {count - LISTED} more"] if count > LISTED else []
        super().__init__("\n".join([*listed, *more, total]))


def in_order(mistake: Mistake) -> tuple[int, int]:
    """Sort mistakes by line; those of the file as a whole first, those of `--set` last."""
    if mistake.where.startswith(SET):
        return 2, 0
    line = mistake.where.rpartition(":")[2]
    return (1, int(line)) if line.isdecimal() else (0, 0)


def read_text(path: Path) -> str:
    """Read the text of a scene file; `SceneError` where there is none."""
    try:
        with path.open("rb") as file:
            content = file.read(_LONGEST + 1)
        if len(content) <= _LONGEST:
            return content.decode("utf-8-sig")
        message = f"the file is longer than {_LONGEST:,} bytes: it is no scene"
    except FileNotFoundError:
        message = "there is no such file. `jaxgear init accessory` writes an example scene"
    except IsADirectoryError:
        message = "this is a folder, a scene file (TOML) was expected"
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        message = "the file is not UTF-8 text. Save it with the encoding UTF-8"
        raise SceneError([Mistake(f"{path}:{line}", "", message)]) from None
    except OSError as error:
        message = f"the file could not be read: {error.strerror}"
    raise SceneError([Mistake(str(path), "", message)])
