"""A row: a figure, table or statement of the thesis, how it is asked, and when both agree."""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from .finding import Finding

AGREES, DIFFERS, CANNOT, OPEN = "agrees", "differs", "cannot", "not asked yet"
# What the thesis did not ask itself.
BEYOND = "beyond the thesis"


@dataclass(frozen=True)
class Row:
    """A figure, table or statement of the thesis.

    A row is asked by an experiment, or by a test of the suite; one that has neither is open, unless
    it says why it cannot be asked.

    **Fields:**

    - `place`: the figure, table or equation, with a word where one place has several statements.
    - `thesis`: its number or statement; empty if the question is ours.
    - `setting`: scene and changes with which it is asked here.
    - `experiment`: file and function that make the table.
    - `agrees`: statements of the table that must all hold for both to agree.
    - `told`: our number or statement, from the table.
    - `test`: path of the test that asks it instead.
    - `shows`: what that test shows.
    - `denies`: whether it shows that the thesis's statement does not hold.
    - `cannot`: why it cannot be asked.
    - `reason`: why the answer is what it is, or what it leaves open.
    """

    place: str
    thesis: str
    setting: str = ""
    experiment: str = ""
    agrees: tuple[str, ...] = ()
    told: Callable[[Finding], str] | None = None
    test: str = ""
    shows: str = ""
    denies: bool = False
    cannot: str = ""
    reason: str = ""

    @property
    def criterion(self) -> str:
        """When both agree, as text."""
        return f"`{self.test}` passes" if self.test else "; ".join(self.agrees)

    def verdict(self, found: Finding) -> str:
        """Whether a table agrees with the thesis."""
        if not self.thesis:
            return BEYOND
        return AGREES if all(found.holds[what] for what in self.agrees) else DIFFERS


@dataclass(frozen=True)
class Answer:
    """What was answered, and by which version of jaxgear."""

    ours: str
    verdict: str
    version: str


def answer_of(row: Row, answers: Mapping[str, Answer]) -> Answer:
    """The answer to a row that is kept, or that it has none.

    **Arguments:**

    - `row`: the row.
    - `answers`: those kept, by place.
    """
    if row.place in answers:
        return answers[row.place]
    return Answer(row.cannot, CANNOT if row.cannot else OPEN, "")


def experiment_of(name: str) -> Callable[[], Finding]:
    """The function that makes a table; its file is imported only now.

    **Arguments:**

    - `name`: file and function, with a dot between.
    """
    file, _, function = name.partition(".")
    return getattr(importlib.import_module(f".{file}", __package__), function)
