"""The public set of reference results: this version against it, or another program.

    python -m benchmarks.reference [--levels default,coarse] [--only fzg-c] [--out folder]
    python -m benchmarks.reference --blank form.csv [--only fzg-c]
    python -m benchmarks.reference --judge form.csv

The first runs all cases at their fidelity levels, prints errors and times, and writes
`results.csv` to the folder; with `--page` the table of docs/reference_set.md too. The second writes
a CSV for the numbers of another program, the third says which of them are within the bounds.
"""

import argparse
import csv
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.reference.cases import Case, read_cases
from benchmarks.reference.judge import Verdict, judged, write_blank
from benchmarks.reference.page import RECORDED, table_of, write_page


def main() -> int:
    """Do what the command line asks for; 1 if numbers lie outside of their bounds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--levels", help="of those that suit a case; default: all")
    parser.add_argument("--only", action="append", help="a case; may be given again")
    parser.add_argument("--out", type=Path, default=Path("results") / "reference")
    parser.add_argument("--page", action="store_true", help="keep the results for the docs")
    parser.add_argument("--blank", type=Path, metavar="CSV")
    parser.add_argument("--judge", type=Path, metavar="CSV")
    asked = parser.parse_args()
    cases = _chosen(parser, read_cases(), asked.only)
    if asked.blank is not None:
        write_blank(asked.blank, cases)
        print(
            f"{asked.blank}: fill in the column value. Scenes are in benchmarks/reference/scenes."
        )
        return 0
    if asked.judge is not None:
        try:
            return _told(judged(asked.judge, cases), cases)
        except (OSError, ValueError) as error:
            parser.error(str(error))
    return _run(parser, asked, cases)


def _chosen(
    parser: argparse.ArgumentParser, cases: dict[str, Case], only: list[str] | None
) -> dict[str, Case]:
    if unknown := [name for name in only or () if name not in cases]:
        parser.error(f"no case {', '.join(unknown)}; there are: {', '.join(cases)}.")
    return {name: case for name, case in cases.items() if not only or name in only}


def _told(verdicts: list[Verdict], cases: Mapping[str, Case]) -> int:
    """Print verdicts, then how many lie within; what is missing judges nothing."""
    for case in cases.values():
        rows = [each for each in verdicts if each.case == case.case]
        if rows:
            print(f"{case.case}: {case.title}")
        for each in rows:
            error = f"{each.error_percent:+.3g} %, {each.within_percent:g} % allowed"
            words = "" if each.verdict == "missing" else error
            print(f"  {each.number:<36} {each.verdict:<8} {words}")
    count = {word: sum(x.verdict == word for x in verdicts) for word in ("within", "outside")}
    print(f"{count['within']} within, {count['outside']} outside, {len(verdicts)} rows")
    return int(count["outside"] > 0)


def _run(parser: argparse.ArgumentParser, asked: Any, cases: Mapping[str, Case]) -> int:
    import jax

    import jaxgear as jg
    from benchmarks.reference.runs import LEVELS, Row, rows_of

    jax.config.update("jax_enable_x64", True)
    jg.cache_compilations()
    levels = asked.levels.split(",") if asked.levels else list(LEVELS)
    if unknown := [name for name in levels if name not in LEVELS]:
        parser.error(f"no level {', '.join(unknown)}; there are: {', '.join(LEVELS)}.")
    if asked.page and (asked.levels or asked.only):
        parser.error("--page takes the whole set: leave out --levels and --only.")
    tell = lambda words: print(words, file=sys.stderr, flush=True)
    asked.out.mkdir(parents=True, exist_ok=True)
    results = asked.out / "results.csv"
    # Row by row: what was found is there, should the rest be stopped.
    with results.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(Row._fields)
        for row in rows_of(cases.values(), levels, tell):
            table.writerow([f"{x:.6g}" if isinstance(x, float) else x for x in row])
            file.flush()
    print(table_of(results))
    print(f"all numbers: {results}")
    if asked.page:
        RECORDED.write_bytes(results.read_bytes())
        write_page()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
