"""The set as a form for other programs: a CSV to fill, and the verdict on one that is filled."""

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from benchmarks.reference.cases import Case, read_rows

COLUMNS = ("case", "number", "value")


class Verdict(NamedTuple):
    """A number of another program beside the known one; NaN where it gave none."""

    case: str
    number: str
    value: float
    error_percent: float
    within_percent: float
    verdict: str


def write_blank(path: Path, cases: Mapping[str, Case]) -> None:
    """Write a row for every number, its value left empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        rows.writerows((case.case, name, "") for case in cases.values() for name in case.numbers)


def judged(path: Path, cases: Mapping[str, Case]) -> list[Verdict]:
    """What a filled CSV is worth, number by number, in its order.

    **Raises:**

    - `ValueError` if it names a case or number that there is not, twice the same, or gives
      something else than a number.
    """
    return list(_judged(path, cases))


def _judged(path: Path, cases: Mapping[str, Case]) -> Iterator[Verdict]:
    seen = set()
    for line, row in read_rows(path, COLUMNS):
        case, number, text = (row[name].strip() for name in COLUMNS)
        known = cases[case].numbers.get(number) if case in cases else None
        where = f"{path.name}:{line}: {case} {number}"
        if known is None:
            raise ValueError(f"{where} is not in the set; --blank writes what is.")
        if (case, number) in seen:
            raise ValueError(f"{where} stands there twice.")
        seen.add((case, number))
        try:
            value = float(text or "nan")
        except ValueError:
            raise ValueError(f"{where}: {text!r} is no number.") from None
        error = known.error_percent(value)
        yield Verdict(case, number, value, error, known.within_percent, known.verdict(value))
