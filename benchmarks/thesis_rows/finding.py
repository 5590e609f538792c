"""A table that an experiment makes, and what it says."""

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Finding:
    """A table, and what it says.

    **Fields:**

    - `title`: what it is of.
    - `thesis`: what the thesis says.
    - `columns`: names, with units.
    - `rows`: one list for each row.
    - `holds`: statements, and whether they do.
    """

    title: str
    thesis: str
    columns: list[str]
    rows: list[list[Any]] = field(default_factory=list)
    holds: dict[str, bool] = field(default_factory=dict)

    def told(self) -> str:
        """The table as text."""
        cells = [self.columns, *([_cell(x) for x in row] for row in self.rows)]
        widths = [max(len(row[i]) for row in cells) for i in range(len(self.columns))]
        lines = [f"\n{self.title}", f"  thesis: {self.thesis}"]
        for row in cells:
            first = f"  {row[0]:<{widths[0]}}"
            rest = zip(row[1:], widths[1:], strict=True)
            lines.append("  ".join([first, *(f"{text:>{width}}" for text, width in rest)]))
        lines += [f"  {'yes' if ok else 'NO ':<3} {what}" for what, ok in self.holds.items()]
        return "\n".join(lines)

    def values(self, column: str, *labels: Any) -> list[Any]:
        """What stands in a column, of the rows whose first cells are the labels.

        **Raises:**

        - `LookupError` if there is no such row.
        """
        at = self.columns.index(column)
        found = [row[at] for row in self.rows if row[: len(labels)] == list(labels)]
        if not found:
            raise LookupError(f"{self.title}: no row {labels}")
        return found

    def listed(self, column: str, *labels: Any, form: str = ".3g") -> str:
        """Of a column the first value of each label, with commas between."""
        rows = [label if isinstance(label, tuple) else (label,) for label in labels]
        told = ", ".join(format(self.values(column, *row)[0], form) for row in rows)
        return told.replace("%", " %")


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    return "-" if value is None else f"{value:.4g}"
