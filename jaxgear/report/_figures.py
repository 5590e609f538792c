"""Pictures of a results folder inside a page, with their data to download."""

import base64
import re
from collections.abc import Iterator
from pathlib import Path

from jaxgear.report._html import Markup, element, joined

# A page that a letter can carry [byte]. What is inside a page takes four bytes for three.
MOST_BYTES = 3_000_000
_TEXT = re.compile(r"<text[^>]*>([^<]+)")
_NUMBER = re.compile(r"[\s\d.,+\-\u2212eE\u00d7%]*")


def figures(folder: Path, room: int, page: Path) -> tuple[Markup, int]:
    """Show the pictures of a folder, each with links to its tables.

    **Arguments:**

    - `folder`: with NAME.svg or NAME.png, NAME.csv, NAME_KEY.csv.
    - `room`: what there is for them [byte]. Where it does not suffice, the largest tables are
        named and not held, then the largest pictures.
    - `page`: the folder in which the page lies, to name such files from there.

    **Returns:**

    The pictures, and what is left of the room.
    """
    pictures = {path.stem: _smaller(path) for path in _in_order(folder)}
    tables = {name: _tables(folder, name, pictures) for name in pictures}
    every = [*pictures.values(), *(path for paths in tables.values() for path in paths)]
    held = _held(every, room)
    shown = [_figure(path, tables[name], held, page) for name, path in pictures.items()]
    return joined(shown), room - sum(_inside(path) for path in held)


def _in_order(folder: Path) -> list[Path]:
    """Pictures in the order in which they were drawn."""
    found = {path.stem: path for ending in ("png", "svg") for path in folder.glob(f"*.{ending}")}
    return sorted(found.values(), key=lambda path: (path.stat().st_mtime_ns, path.name))


def _smaller(picture: Path) -> Path:
    """The form of a picture that takes less room: a body in space has thousands of edges."""
    forms = [picture.with_suffix(ending) for ending in (".svg", ".png")]
    return min((each for each in forms if each.exists()), key=lambda path: path.stat().st_size)


def _tables(folder: Path, name: str, pictures: dict[str, Path]) -> list[Path]:
    """NAME.csv and NAME_KEY.csv, unless these belong to a picture with a longer name."""
    beside = [
        path
        for path in sorted(folder.glob(f"{name}_*.csv"))
        if not any(path.stem.startswith(each) and len(each) > len(name) for each in pictures)
    ]
    return [path for path in (folder / f"{name}.csv", *beside) if path.exists()]


def _held(paths: list[Path], room: int) -> set[Path]:
    """The files that a page holds: pictures before tables, small before large."""
    held = set()
    for path in sorted(paths, key=lambda path: (path.suffix == ".csv", path.stat().st_size)):
        if _inside(path) > room:
            break
        room -= _inside(path)
        held.add(path)
    return held


def _inside(path: Path) -> int:
    return path.stat().st_size * 4 // 3 + 200


def _figure(path: Path, tables: list[Path], held: set[Path], page: Path) -> Markup:
    title = path.stem.replace("_", " ")
    beside = lambda each: each.relative_to(page).as_posix()
    if path in held:
        shown = element("img", src=_data(path), alt=_told(title, path))
    else:
        shown = element("p", f"The picture is in {beside(path)}, beside this page.")
    links = [
        element("a", table.name, href=_data(table), download=table.name)
        if table in held
        else joined((beside(table), " (beside this page)"))
        for table in tables
    ]
    data = joined(part for link in links for part in (", ", link))[2:] if links else ""
    about = joined((title, " · data: ", Markup(data))) if data else title
    return element("figure", shown, element("figcaption", about))


def _data(path: Path) -> str:
    kinds = {".svg": "image/svg+xml", ".png": "image/png", ".csv": "text/csv"}
    code = base64.b64encode(path.read_bytes()).decode()
    return f"data:{kinds[path.suffix]};base64,{code}"


def _told(title: str, path: Path) -> str:
    """What a picture shows for who does not see it: its title, and the words in it."""
    vector = path.with_suffix(".svg")
    words = dict.fromkeys(_words(vector)) if vector.exists() else ()
    return ". ".join((title, *words))


def _words(picture: Path) -> Iterator[str]:
    for found in _TEXT.findall(picture.read_text(encoding="utf-8")):
        if not _NUMBER.fullmatch(found):
            yield found.strip()
