"""The numbers of a summary as tables, and the scene that was asked."""

from collections.abc import Iterator, Mapping
from typing import Any

from jaxgear.report._html import Markup, element, joined, table
from jaxgear.scene._schema import BY_PATH, KEYS, general, unit_of
from jaxgear.study._symbols import with_symbol

# What the report has elsewhere.
_ELSEWHERE = ("name", "cite", "notes", "versions", "geometry")
# Rows of a table shown; the files beside the report have all.
_MOST_ROWS = 40


def number_tables(summary: Mapping[str, Any]) -> list[tuple[str, Markup]]:
    """Write the tables of each part of a summary, under the part's name.

    **Arguments:**

    - `summary`: as `summary.json` has it.
    """
    parts = {key: value for key, value in summary.items() if key not in _ELSEWHERE}
    return [(key, joined(_tables(key, value))) for key, value in parts.items()]


def _tables(name: str, part: Any) -> Iterator[Markup]:
    """Plain numbers of a part as one table, each list of rows in it as one of its own."""
    values: list[tuple[str, str]] = []
    lists: list[tuple[str, list[Mapping[str, Any]]]] = []
    for path, value in _leaves(part, "" if isinstance(part, Mapping) else name):
        if isinstance(value, list) and value and isinstance(value[0], Mapping):
            lists.append((path, value))
        else:
            values.append((with_symbol(path), shown(value)))
    if values:
        yield table(("name", "value"), values)
    for path, rows in lists:
        yield _rows(path, rows)


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield from _leaves(each, f"{path}.{key}" if path else str(key))
    else:
        yield path, value


def _rows(caption: str, rows: list[Mapping[str, Any]]) -> Markup:
    """Write a list of records, a column for each of their names."""
    flat = [dict(_leaves(row, "")) for row in rows[:_MOST_ROWS]]
    # An empty table and a number without a name have nothing to show.
    names = [name for name in dict.fromkeys(name for row in flat for name in row) if name]
    more = f" (first {_MOST_ROWS} of {len(rows)})" if len(rows) > _MOST_ROWS else ""
    cells = [[shown(row.get(name, "")) for name in names] for row in flat]
    numbered = [(str(number), *row) for number, row in enumerate(cells, start=1)]
    return table(("number", *names), numbered, f"{caption}{more}")


def shown(value: Any) -> str:
    """Write a value for a reader: six digits, long lists by their length."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:.6g}"
    if isinstance(value, list):
        few = len(value) <= 6
        return ", ".join(map(shown, value)) if few else f"{len(value)} values"
    return "" if value is None else str(value)


def scene_tables(scene: Mapping[str, Any]) -> Markup:
    """Write what was asked: each key with its value, its unit, and whether that is the default.

    **Arguments:**

    - `scene`: values by paths of keys.
    """
    tables: dict[str, list[tuple[str, ...]]] = {}
    for path, value in scene.items():
        key = KEYS.get(general(path))
        home, name = _place(path)
        usual = "by default" if key is not None and value == key.default else ""
        meaning = key.doc if key is not None else ""
        row = (name, shown(value), unit_of(path), usual, meaning)
        tables.setdefault(home or "the scene", []).append(row)
    head = ("key", "value", "unit", "", "meaning")
    return joined(
        element("details", element("summary", f"[{name}]"), table(head, rows))
        for name, rows in tables.items()
    )


def _place(path: str) -> tuple[str, str]:
    """The table of a key and its name in it, which may be the path of another key."""
    for table_of in BY_PATH:
        if path.startswith(f"{table_of}."):
            return table_of, path.removeprefix(f"{table_of}.")
    home, _, name = path.rpartition(".")
    return home, name
