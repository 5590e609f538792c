"""A file that appears whole or not at all."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a draft's path in the same folder, which replaces `path` if nothing goes wrong.

    **Arguments:**

    - `path`: of the file to be.
    """
    # The ending stays last: writers choose a format by it.
    draft = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield draft
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def write_text(text: str, path: Path) -> None:
    """Write a text as UTF-8, whole.

    **Arguments:**

    - `text`: all of it, with the end of its last line.
    - `path`: of the file.
    """
    with whole_file(path) as draft:
        draft.write_bytes(text.encode())
