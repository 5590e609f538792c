"""What a command says on standard error while it works: bars, steps, warnings."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import tqdm

from jaxgear._app._scene import Scene
from jaxgear._app._with_bodies import with_bodies


@contextmanager
def progress(total: int, what: str, quiet: bool) -> Iterator[Callable[[int], None]]:
    """A progress bar on a terminal's standard error; the value is told how many more are done."""
    with (
        tqdm.tqdm(
            total=total, desc=what, disable=quiet or None, file=sys.stderr, leave=False
        ) as bar,
        _spoken_by(bar.set_postfix_str),
    ):

        def done(count: int) -> None:
            bar.update(count)

        yield done


@contextmanager
def narration(what: str, quiet: bool) -> Iterator[Callable[[str], None]]:
    """A line on a terminal's standard error that says what is being done, and since when."""
    with (
        tqdm.tqdm(
            disable=quiet or None,
            file=sys.stderr,
            leave=False,
            bar_format=what + ": {desc} [{elapsed}]",
        ) as line,
        _spoken_by(line.set_description_str),
    ):
        line.set_description_str("beginning")

        def tell(step: str) -> None:
            line.set_description_str(step)

        yield tell


# What shows the step that is under way: the innermost bar or line.
_SHOWN: ContextVar[Callable[[str], None] | None] = ContextVar("_SHOWN", default=None)


@contextmanager
def _spoken_by(show: Callable[[str], None]) -> Iterator[None]:
    """Let `say` show steps there for a while."""
    token = _SHOWN.set(show)
    try:
        yield
    finally:
        _SHOWN.reset(token)


def say(step: str) -> None:
    """Say what is being done, beside the bar or in the line that is shown, if one is.

    **Arguments:**

    - `step`: in a word or two, such as compiling.
    """
    show = _SHOWN.get()
    if show is not None:
        show(step)


def warn(text: str) -> None:
    """Say what a user should know, even where progress is not shown."""
    print(f"jaxgear: warning: {text}", file=sys.stderr)


def built_scene(scene: Scene, quiet: bool, *, moving: bool = False) -> Scene:
    """The scene with its condensed bodies; where it has none, nothing is imported for them."""
    if not scene.condensed:
        return scene
    with narration("bodies", quiet) as tell:
        return with_bodies(scene, tell, moving=moving or scene.has_table("sweep"))
