"""Paths of a scene's keys: in text, in nested tables, and in flat mappings."""

import itertools
import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from jaxgear.scene._schema import BY_PATH, KEYS, TABLES, general, split_entry

_BARE = re.compile(r"[A-Za-z0-9_-]+")
# Quoted text, or an index outside of it.
_INDEX = re.compile(r"""("(?:[^"\\]|\\.)*"|'[^']*')|\[\s*(\d+)\s*\]""")
# The names and indices of a path.
_STEPS = re.compile(r"\[(\d+)\]|([^.\[\]]+)")


def put(document: dict[str, object], steps: Sequence[str | int], value: object) -> None:
    """Set a value in nested tables, which are made where they are missing, and in lists.

    **Raises:**

    - `LookupError` if a list is missing or too short.
    """
    inner: Any = document
    for step, after in itertools.pairwise(steps):
        held = inner.get(step) if isinstance(step, str) else inner[step]
        if isinstance(after, int):
            if not isinstance(held, list):
                raise LookupError(f"there is no list {step}")
            if after >= len(held):
                raise LookupError(f"{step} has {len(held)} entries, counted from 0")
        elif not isinstance(held, dict):
            held = inner[step] = {}
        inner = held
    inner[steps[-1]] = value


def nested(values: Mapping[str, object]) -> dict[str, Any]:
    """Return values under flat paths as nested tables and lists of tables."""
    root: dict[str, Any] = {}
    for path, value in values.items():
        inner: Any = root
        steps = steps_of({}, path)
        for step, after in itertools.pairwise(steps):
            if isinstance(step, str):
                inner = inner.setdefault(step, [] if isinstance(after, int) else {})
            else:
                inner += [{} for _ in range(step + 1 - len(inner))]
                inner = inner[step]
        inner[steps[-1]] = value
    return root


def steps_of(document: Mapping[str, Any], path: str) -> list[str | int]:
    """Split a path into names and indices.

    Below the tables of `BY_PATH` the path of the other key is split as the document
    spells it: one quoted name, which it is made where it is new, or nested tables.
    """
    for table in BY_PATH:
        if path.startswith(f"{table}."):
            names = table.split(".")
            inner: object = document
            for name in names:
                inner = inner.get(name) if isinstance(inner, Mapping) else None
            other = path.removeprefix(f"{table}.")
            return [*names, *(_spelled(inner, other) or [other])]
    return [int(index) if index else name for index, name in _STEPS.findall(path)]


def _spelled(table: object, path: str) -> list[str | int]:
    """Split a path as the table spells it; empty where not even its beginning is in there."""
    if not isinstance(table, Mapping):
        return []
    parts = path.split(".")
    for end in range(len(parts), 0, -1):
        name, rest = ".".join(parts[:end]), parts[end:]
        row, index = split_entry(name)
        if name in table:
            return [name, *(_spelled(table[name], ".".join(rest)) or rest)]
        if index is not None and isinstance(table.get(row), list):
            return [row, index, *rest]
    return []


def filled_in(document: Mapping[str, Any], path: str, value: object) -> tuple[str, object]:
    """Return the path and the value; for an entry of a list left to its default the whole list."""
    whole, index = split_entry(path)
    default = KEYS[general(whole)].default if general(whole) in KEYS else None
    if index is None or not isinstance(default, list) or index >= len(default):
        return path, value
    inner: Any = document
    for step in steps_of(document, whole):
        try:
            inner = inner[step]
        except (LookupError, TypeError):
            return whole, [*default[:index], value, *default[index + 1 :]]
    return path, value


def look_up(values: Mapping[str, Any], path: str, default: Any = None) -> Any:
    """The value of a key or of an entry of a list; `KeyError` if no scene has such a path."""
    if path in values:
        return values[path]
    key, index = split_entry(path)
    known = general(key)
    if not any(each in KEYS or each in TABLES for each in (known, f"{known}[]")):
        raise KeyError(path)
    entries = values.get(key)
    if index is not None and isinstance(entries, list) and index < len(entries):
        return entries[index]
    return default


def around(path: str) -> Iterator[str]:
    """Yield what is around a path, innermost first: of `a.b[0].c` that is `a.b[0]`, `a.b`, `a`."""
    while path := path[: max(path.rfind("."), path.rfind("["), 0)]:
        yield path


def join(prefix: str, name: str) -> str:
    """Append a name to a dotted path, in quotes where TOML would need them.

    Below the tables of `BY_PATH` the names are paths themselves, quoted or not.
    """
    by_path = f"{prefix}.".startswith(tuple(f"{table}." for table in BY_PATH))
    if not by_path and not _BARE.fullmatch(name):
        name = json.dumps(name, ensure_ascii=False)
    return f"{prefix}.{name}" if prefix else name


def key_names(text: str) -> list[str]:
    """Split a TOML key, `a."b.c".d`, into its names; `ValueError` if it is not one key."""
    node: object = tomllib.loads(f"{text} = 0")
    names: list[str] = []
    while isinstance(node, dict):
        ((name, node),) = node.items()
        names.append(name)
    return names


def key_steps(text: str) -> list[str | int]:
    """Split a TOML key that may have indices, `a."b.c"[0].d`; `ValueError` if it is not one."""
    # To TOML an index is a name too, marked as no key is.
    marked = _INDEX.sub(lambda found: found[1] or f'."\\u0000{found[2]}"', text)
    return [int(name[1:]) if name[:1] == "\0" else name for name in key_names(marked)]
