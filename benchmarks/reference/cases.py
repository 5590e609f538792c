"""The cases of the reference set: what is asked, what is known, and from where."""

import csv
import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path

FOLDER = Path(__file__).parent
HEAD = ("case", "number", "value", "within_percent")


@dataclasses.dataclass(frozen=True)
class Known:
    """A number that is known: its value in the unit of its name, and how near is near enough."""

    value: float
    within_percent: float

    def error_percent(self, found: float) -> float:
        """How far another value is off, of this one [%]."""
        return 100.0 * (found - self.value) / abs(self.value)

    def verdict(self, found: float) -> str:
        """`within`, `outside`, or `missing` where there is no finite number."""
        error = abs(self.error_percent(found))
        return (
            "missing" if error != error else "within" if error <= self.within_percent else "outside"
        )


@dataclasses.dataclass(frozen=True)
class Case:
    """A gear pair, or a disc, with numbers that are known of it.

    **Fields:**

    - `case`: its name.
    - `title`: what it is, in a line.
    - `command`: `run` or `modes` of a scene, or `disc`: free vibrations of a plain one.
    - `levels`: fidelity levels that suit it.
    - `origin`: where the numbers are from.
    - `unknown`: what the source leaves open.
    - `scene`: a file of `scenes`, or an example scene.
    - `set`: changes of it.
    - `disc`: measures of a disc [mm].
    - `numbers`: what is known, by names of the summary.
    """

    case: str
    title: str
    command: str
    levels: tuple[str, ...]
    origin: str
    unknown: str
    scene: str = ""
    set: tuple[str, ...] = ()
    disc: Mapping[str, float] = dataclasses.field(default_factory=dict)
    numbers: Mapping[str, Known] = dataclasses.field(default_factory=dict)


def read_cases(folder: Path = FOLDER) -> dict[str, Case]:
    """All cases by their names.

    **Raises:**

    - `ValueError` if a number is of no case, is no number, or a case has none.
    """
    numbers: dict[str, dict[str, Known]] = {}
    for line, row in read_rows(folder / "numbers.csv", HEAD):
        try:
            known = Known(float(row["value"]), float(row["within_percent"]))
        except ValueError:
            raise ValueError(
                f"numbers.csv:{line}: value and within_percent must be numbers."
            ) from None
        numbers.setdefault(row["case"], {})[row["number"]] = known
    found = {}
    for table in json.loads((folder / "cases.json").read_text(encoding="utf-8")):
        lists = {key: tuple(table[key]) for key in ("levels", "set")}
        known = numbers.pop(table["case"], {})
        if not known:
            raise ValueError(f"cases.json: {table['case']} has no numbers in numbers.csv.")
        found[table["case"]] = Case(**table | lists | {"numbers": known})
    if numbers:
        raise ValueError(f"numbers.csv: cases.json has no case {', '.join(numbers)}.")
    return found


def read_rows(path: Path, columns: tuple[str, ...]) -> list[tuple[int, dict[str, str]]]:
    """Rows of a CSV with their lines; lines that begin with # are left out.

    **Raises:**

    - `ValueError` if a column lacks.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.DictReader(file)
        lacking = [name for name in columns if name not in (reader.fieldnames or ())]
        if lacking:
            raise ValueError(f"{path.name}:1: columns {', '.join(lacking)} are missing.")
        rows = [(reader.line_num, row) for row in reader]
    for line, row in rows:
        if any(row[name] is None for name in columns):
            raise ValueError(f"{path.name}:{line}: has fewer columns than the first line.")
    return rows
