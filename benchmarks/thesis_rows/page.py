"""The page of findings, made from the rows and the answers that are kept."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from .row import AGREES, BEYOND, CANNOT, DIFFERS, OPEN, Answer, Row, answer_of

# Around the tables: what the page is, and reasons.
_TEMPLATE = Path(__file__).with_name("page.md")


def page(chapters: Mapping[str, Sequence[Row]], answers: Mapping[str, Answer]) -> str:
    """The page.

    **Arguments:**

    - `chapters`: rows by title.
    - `answers`: those kept, by place.

    **Returns:**

    Its text, of Markdown.
    """
    verdicts = Counter(
        answer_of(row, answers).verdict for rows in chapters.values() for row in rows
    )
    counts = ", ".join(
        f"{verdicts[each]} {each}" for each in (AGREES, DIFFERS, CANNOT, BEYOND, OPEN)
    )
    parts = [f"Of {sum(verdicts.values())} rows: {counts}.\n"]
    for title, rows in chapters.items():
        parts.append(f"## {title}\n")
        parts.append(
            "| thesis | says | here | setting; criterion | verdict |\n|---|---|---|---|---|"
        )
        parts.extend(_line(row, answer_of(row, answers)) for row in rows)
        parts.append("")
    return _TEMPLATE.read_text(encoding="utf-8").replace("{tables}", "\n".join(parts).strip())


def _line(row: Row, answer: Answer) -> str:
    here = ". ".join(part for part in (answer.ours, row.reason) if part)
    how = "; ".join(part for part in (row.setting, row.criterion) if part)
    verdict = f"**{answer.verdict}**" if answer.verdict == DIFFERS else answer.verdict
    cells = row.place, row.thesis, here, how, f"{verdict} {answer.version}".strip()
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"
