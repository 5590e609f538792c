"""The report: what was asked, what is remarkable, a sizing, pictures with their data, numbers."""

import datetime
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from jaxgear.report._chapter import Chapter, chapter, chapters
from jaxgear.report._figures import MOST_BYTES, figures
from jaxgear.report._html import Markup, element, table
from jaxgear.report._numbers import number_tables, scene_tables, shown
from jaxgear.report._sizing_table import sizing_table
from jaxgear.report._verdicts import WORDS, verdicts


def report(folder: Path, command: str = "") -> str:
    """Write the results of a folder as one HTML page that needs no other file.

    Verdicts come first, then what was asked, the sizing, pictures with their data to download, all
    numbers, and versions. The page holds no script and asks nothing of a network; where pictures
    and tables are more than three megabytes, the largest tables are named and not held.

    **Arguments:**

    - `folder`: the results of a command, such as `results/accessory/sweep`, or of all commands on
        a scene, such as `results/accessory`.
    - `command`: the one that has written the folder, for a page of it alone; all in it without.

    **Returns:**

    The page.

    **Raises:**

    - `InputError` if the folder has no results, or spoilt ones.
    """
    found = [chapter(folder, command)] if command else chapters(folder)
    first = found[0]
    name = str(first.summary.get("name", folder.name))
    # What the words of a page take.
    room = MOST_BYTES - 400_000
    shown_chapters = []
    for each in found:
        text, room = _chapter(each, room, folder, alone=len(found) == 1)
        shown_chapters.append(text)
    body = element(
        "main",
        element("h1", name),
        element("p", _origin(first), class_="origin"),
        _contents(found) if len(found) > 1 else Markup(""),
        *shown_chapters,
        _asked(first),
        _versions(first),
    )
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", f"{name}: jaxgear"),
        element(
            "style",
            Markup(
                resources.files("jaxgear.report").joinpath("page.css").read_text(encoding="utf-8")
            ),
        ),
    )
    return f"<!DOCTYPE html>\n{element('html', head, element('body', body), lang='en')}\n"


def _origin(of: Chapter) -> str:
    now = datetime.datetime.now(datetime.UTC)
    cite = of.summary.get("cite") or of.asked.get("cite", "")
    source = f"Source of the gears: {cite}. " if cite else ""
    version = of.summary.get("versions", {}).get("jaxgear", "")
    return f"{source}Computed by jaxgear {version}; this page was written {now:%Y-%m-%d %H:%M} UTC."


def _contents(found: Sequence[Chapter]) -> Markup:
    links = [element("li", element("a", each.name, href=f"#{each.name}")) for each in found]
    return element("nav", element("ul", *links), aria_label="Commands")


def _chapter(of: Chapter, room: int, page: Path, *, alone: bool) -> tuple[Markup, int]:
    """Write what one command has found, and what is left of the room."""
    pictures, room = figures(of.folder, room, page)
    parts = [element("h2", f"Results of {of.name}")]
    parts += [element("h3", "What to know first"), _first(of)]
    if sizing := sizing_table(of.asked, of.summary) if alone or of.name == "run" else "":
        parts += [element("h3", "Sizing"), sizing]
    if pictures:
        parts += [element("h3", "Pictures"), pictures]
    parts.append(element("h3", "Numbers"))
    for name, tables in number_tables(of.summary):
        parts.append(element("details", element("summary", name), tables))
    return element("section", *parts, id=of.name), room


def _first(of: Chapter) -> Markup:
    found = verdicts(of.summary)
    if not found:
        return element("p", "Nothing is remarkable: no limit is broken, and no search has failed.")
    rows = [
        element("li", element("strong", WORDS[each.level], ": "), each.text, class_=each.level)
        for each in found
    ]
    return element("ul", *rows, class_="verdicts")


def _asked(of: Chapter) -> Markup:
    words = (
        "Every key of the scene, with what it did not say and was taken by default. The model "
        "that follows from it is under the numbers."
    )
    return element(
        "section", element("h2", "What was asked"), element("p", words), scene_tables(of.asked)
    )


def _versions(of: Chapter) -> Markup:
    rows = [(name, shown(value)) for name, value in of.summary.get("versions", {}).items()]
    body = table(("program", "version"), rows) if rows else element("p", "Not kept.")
    return element("section", element("h2", "Versions"), body)
