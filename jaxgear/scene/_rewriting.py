"""Scenes written: whole, with defaults, or the user's own file with some keys changed."""

import itertools
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxgear._whole_file import write_text
from jaxgear.scene._key import show
from jaxgear.scene._mistakes import read_text
from jaxgear.scene._paths import filled_in, nested, put, steps_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import KEYS, ON_REQUEST, general, split_entry


def write_scene(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write the whole scene, defaults included; it reads back to the same values.

    Tables that ask for work, such as `[optimise]`, are written only if the user gave them.
    """
    import tomlkit

    wanted = {
        key: _plain(key, value)
        for key, value in scene.values.items()
        if (top := key.partition(".")[0]) not in ON_REQUEST or top in scene.given
    }
    write_text(tomlkit.dumps(nested(wanted)), Path(path))


def rewrite_scene(
    source: str | os.PathLike[str],
    updates: Mapping[str, object],
    destination: str | os.PathLike[str],
) -> None:
    """Write the user's own file with some keys changed or added, comments and order kept.

    **Arguments:**

    - `source`, `updates`: as of `rewritten`.
    - `destination`: the file to write; may be `source`.

    **Raises:**

    - `ValueError` as of `rewritten`.
    """
    write_text(rewritten(source, updates), Path(destination))


def rewritten(source: str | os.PathLike[str], updates: Mapping[str, object]) -> str:
    """Return the user's own file with some keys changed or added, comments and order kept.

    **Raises:**

    - `ValueError` if the file is laid out so that it cannot be changed and keep its comments, or
        has no such row or entry.
    """
    import tomlkit.exceptions

    text = read_text(Path(source))
    plain: dict[str, object] = {}
    wanted = tomllib.loads(text)
    for key, value in updates.items():
        path, whole = filled_in(wanted, key, _plain(key, value))
        try:
            put(wanted, steps_of(wanted, path), whole)
        except LookupError as error:
            raise ValueError(f"{source} has no {key} to change: {error.args[0]}.") from None
        plain[path] = whole
    # tomlkit loses its way among dotted keys and tables spread over a file, so its text is read
    # back; where one style of new table fails the other may not.
    for headers in (True, False):
        try:
            edited = _edited(text, plain, headers)
            good = tomllib.loads(edited) == wanted
        except (ValueError, LookupError, TypeError, tomlkit.exceptions.TOMLKitError):
            continue
        if good:
            return edited
    values = ", ".join(f"{key} = {show(value)}" for key, value in plain.items())
    raise ValueError(
        f"{source} could not be changed, because its tables are spread over the file. Gather each "
        f"table in one place, or change these by hand: {values}."
    )


def _edited(text: str, updates: Mapping[str, object], headers: bool) -> str:
    """Return the text with the keys changed.

    New tables get a header of their own at the top level and in `[flank]`, if `headers` says so,
    and are inline tables otherwise.
    """
    import tomlkit

    document = tomlkit.parse(text)
    for key, value in updates.items():
        steps = steps_of(document, key)
        inner: Any = document
        for depth, (step, after) in enumerate(itertools.pairwise(steps)):
            is_new = isinstance(step, str) and not isinstance(after, int)
            if is_new and not isinstance(inner.get(step), dict):
                header = headers and (depth == 0 or steps[:depth] == ["flank"])
                inner[step] = tomlkit.table() if header else tomlkit.inline_table()
            inner = inner[step]
        inner[steps[-1]] = _item(value, inner.get(steps[-1]) if isinstance(inner, dict) else None)
    return tomlkit.dumps(document)


def _item(value: object, old: object) -> object:
    """Return what tomlkit is given for a value that takes the place of `old`.

    Tables inside of lists are inline, unless the list is written with headers already.
    """
    import tomlkit
    import tomlkit.items

    if isinstance(value, dict):
        table = tomlkit.inline_table()
        table.update(value)
        return table
    if isinstance(value, list) and any(isinstance(row, dict) for row in value):
        if isinstance(old, tomlkit.items.AoT):
            return value
        rows = tomlkit.array()
        rows.extend(_item(row, None) for row in value)
        return rows.multiline(True)
    return value


def _plain(key: str, value: Any) -> Any:
    """Return a value as plain Python: numbers may arrive as JAX or NumPy scalars."""
    whole, index = split_entry(key)
    # Rows and lists of tables come from a scene that was read, so they are plain.
    kind = KEYS[general(whole)].kind if general(whole) in KEYS else "text"
    if kind == "float" or (kind == "floats" and index is not None):
        return float(value)
    if kind == "int":
        return int(value)
    if kind == "floats":
        return [float(entry) for entry in value]
    return value
