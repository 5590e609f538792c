"""The table of docs/reference_set.md, from a recorded run."""

from pathlib import Path

from benchmarks.reference.cases import FOLDER, read_rows

RECORDED = FOLDER / "recorded.csv"
_PAGE = FOLDER.parents[1] / "docs" / "reference_set.md"
_MARKS = ("<!-- table -->\n", "<!-- end of table -->\n")


def table_of(results: Path) -> str:
    """A row for each case and level, in Markdown: errors of all numbers, and time."""
    columns = ("case", "level", "number", "error_percent", "verdict", "again_s")
    groups: dict[tuple[str, str], list[dict[str, str]]] = {}
    for _, row in read_rows(results, columns):
        groups.setdefault((row["case"], row["level"]), []).append(row)
    lines = ["| case | level | errors | within | time |", "|---|---|---|---|---|"]
    for (case, level), rows in groups.items():
        parts = [f"{_short(each['number'])} {float(each['error_percent']):+.2g} %" for each in rows]
        within = sum(each["verdict"] == "within" for each in rows)
        if len(parts) > 6:
            worst = max(rows, key=lambda each: abs(float(each["error_percent"])))
            size = float(worst["error_percent"])
            parts = [f"largest of {len(rows)}: {_short(worst['number'])} {size:+.2g} %"]
        share = f"{within} of {len(rows)}"
        time = f"{float(rows[0]['again_s']):.2g} s"
        lines.append(f"| {case} | {level} | {', '.join(parts)} | {share} | {time} |")
    return "\n".join(lines) + "\n"


def write_page() -> None:
    """Put the table of the recorded run between the marks of the page."""
    text = _PAGE.read_text(encoding="utf-8")
    before, rest = text.split(_MARKS[0])
    _, after = rest.split(_MARKS[1])
    text = before + _MARKS[0] + table_of(RECORDED) + _MARKS[1] + after
    _PAGE.write_text(text, encoding="utf-8")


def _short(number: str) -> str:
    """A number's name without its group."""
    return "`" + number.partition(".")[2].removeprefix("bearings") + "`"
