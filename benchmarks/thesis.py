"""What the thesis found, asked here: one table of all of it.

    python benchmarks/thesis.py [--only PLACE ...] [--list] [--page]

Asks the rows of `thesis_rows`, or some of them by their place or by their experiment, prints the
tables from which they are answered, keeps answers and tables in `thesis.json` and makes
`docs/findings.md` from it. Bodies come from the cache after the first time; all rows take hours.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

from thesis_rows import (
    chapter_1,
    chapter_2,
    chapter_3_accessory,
    chapter_3_industrial,
    chapter_3_power,
    chapter_4_accessory,
    chapter_4_flanks,
    chapter_4_power,
)
from thesis_rows.finding import Finding
from thesis_rows.page import page
from thesis_rows.row import AGREES, DIFFERS, Answer, Row, answer_of, experiment_of

_FOLDER = Path(__file__).parent
KEPT = _FOLDER / "thesis.json"
PAGE = _FOLDER.parent / "docs" / "findings.md"
_FILES = (
    chapter_1,
    chapter_2,
    chapter_3_accessory,
    chapter_3_power,
    chapter_3_industrial,
    chapter_4_accessory,
    chapter_4_power,
    chapter_4_flanks,
)
CHAPTERS = {each.TITLE: each.ROWS for each in _FILES}


class Results:
    """What is kept: answers by place, and tables by experiment."""

    def __init__(self, path: Path = KEPT):
        read = json.loads(path.read_text("utf-8")) if path.exists() else {}
        self.path = path
        self.answers = {place: Answer(**each) for place, each in read.get("answers", {}).items()}
        self.tables = {name: Finding(**each) for name, each in read.get("tables", {}).items()}

    def keep(self) -> None:
        """Write them, one answer or row of a table a line."""
        parts = {
            "answers": {place: asdict(each) for place, each in sorted(self.answers.items())},
            "tables": {name: asdict(each) for name, each in sorted(self.tables.items())},
        }
        self.path.write_text(json.dumps(parts, indent=1, ensure_ascii=False) + "\n", "utf-8")


def every_row() -> list[Row]:
    """All rows, chapter by chapter."""
    return [row for rows in CHAPTERS.values() for row in rows]


def _plain(found: Finding) -> Finding:
    """A table as its file has it: numbers to five figures."""
    cell = lambda x: x if x is None or isinstance(x, str) else float(f"{float(x):.5g}")
    rows = [[cell(x) for x in row] for row in found.rows]
    holds = {what: bool(ok) for what, ok in found.holds.items()}
    return Finding(found.title, found.thesis, found.columns, rows, holds)


def answered(row: Row, found: Finding, version: str) -> Answer:
    """The answer to a row from its experiment's table."""
    assert row.told is not None
    return Answer(row.told(found), row.verdict(found), version)


def tested(rows: Sequence[Row], version: str) -> dict[str, Answer]:
    """The answers to rows from their tests, in one run of them all.

    **Raises:**

    - `CalledProcessError` if a test does not pass.
    """
    if not rows:
        return {}
    tests = sorted({row.test for row in rows})
    command = [sys.executable, "-m", "pytest", "-q", "-m", "slow or not slow", *tests]
    # As users compile, see tests/conftest.py.
    subprocess.run(command, cwd=_FOLDER.parent, check=True, env=os.environ | {"XLA_FLAGS": ""})
    verdict = lambda row: DIFFERS if row.denies else AGREES
    return {row.place: Answer(row.shows, verdict(row), version) for row in rows}


def ask(rows: Sequence[Row], results: Results) -> None:
    """Ask rows; what was answered is kept after each experiment."""
    import jax

    jax.config.update("jax_enable_x64", True)
    version = metadata.version("jaxgear")
    results.answers |= tested([row for row in rows if row.test], version)
    results.keep()
    for name in dict.fromkeys(row.experiment for row in rows if row.experiment):
        start = time.perf_counter()
        found = results.tables[name] = _plain(experiment_of(name)())
        print(found.told(), f"\n  ({time.perf_counter() - start:.0f} s)", flush=True)
        for row in (row for row in rows if row.experiment == name):
            answer = results.answers[row.place] = answered(row, found, version)
            print(f"{row.place}: {answer.verdict}. {answer.ours}", flush=True)
        results.keep()


def main() -> None:
    """Ask what the command line asks for."""
    parser = argparse.ArgumentParser(description="What the thesis found, asked here.")
    parser.add_argument("--only", nargs="*", metavar="PLACE", help="places, or experiments")
    parser.add_argument("--list", action="store_true", help="print the rows and their verdicts")
    parser.add_argument("--page", action="store_true", help="only make the page anew")
    options = parser.parse_args()
    results = Results()
    rows = every_row()
    if options.list:
        for row in rows:
            print(f"{row.place:<44}{answer_of(row, results.answers).verdict:<15}", end="")
            print(row.experiment or row.test)
        return
    if options.only is not None:
        known = {name for row in rows for name in (row.place, row.experiment, row.test) if name}
        unknown = sorted(set(options.only) - known)
        if unknown:
            parser.error(f"--only: no row or experiment {', '.join(unknown)}; see --list")
        rows = [row for row in rows if {row.place, row.experiment, row.test} & set(options.only)]
    if not options.page:
        ask(rows, results)
    PAGE.write_text(page(CHAPTERS, results.answers), encoding="utf-8")
    print(f"\nwritten to {KEPT} and {PAGE}")


if __name__ == "__main__":
    main()
