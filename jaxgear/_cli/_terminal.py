"""What a command says on standard error while it works: bars, steps, warnings."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager

import tqdm


class Terminal:
    """Progress on a terminal's standard error; where that is none, nothing."""

    @contextmanager
    def bar(
        self, total: int, what: str
    ) -> Generator[tuple[Callable[[int], None], Callable[[str], None]]]:
        """A bar, as `Listener` has it."""
        with tqdm.tqdm(total=total, desc=what, disable=None, file=sys.stderr, leave=False) as shown:

            def done(count: int) -> None:
                shown.update(count)

            yield done, shown.set_postfix_str

    @contextmanager
    def line(self, what: str) -> Generator[Callable[[str], None]]:
        """A line that also says since when, as `Listener` has it."""
        with tqdm.tqdm(
            disable=None, file=sys.stderr, leave=False, bar_format=what + ": {desc} [{elapsed}]"
        ) as shown:
            shown.set_description_str("beginning")
            yield lambda step: shown.set_description_str(step)


def warn(text: str) -> None:
    """Say what a user should know, even where progress is not shown."""
    print(f"jaxgear: warning: {text}", file=sys.stderr)
