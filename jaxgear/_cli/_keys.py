"""The command `keys`: every key of the scene file looked up, as text, as JSON and as a page."""

import argparse
import fnmatch
import json
import re
import sys
from collections.abc import Iterable
from typing import Any

from jaxgear.scene._key import OPTIONAL, REQUIRED, Key, show
from jaxgear.scene._scene import READY, read_scene
from jaxgear.scene._schema import (
    BY_PATH,
    GEARS,
    KEYS,
    general,
    key_at,
    nearest,
    scales_body,
    shapes_body,
    shapes_teeth,
)
from jaxgear.study._symbols import SYMBOLS

# Of these tables every real key has one of its own: they are told by one example each.
_EXAMPLE = "pair.module_mm"
_NUMBERS = ("above", "at_least", "below", "at_most", "length")
_PAGE = """\
# Keys of the scene file

Written by `jaxgear keys --markdown`, from what a scene is checked against; `jaxgear keys PATTERN`
looks one up. `[]` stands for any row of a list of tables, counted from 0 in paths. A required key
must be there where its table is; `[pair]`, `[pinion]` and `[wheel]` must be. The unit is part of
the name of a key.
"""


def print_keys(args: argparse.Namespace) -> int:
    """Print the keys that were asked for, and return the exit code: 2 where none is like these."""
    if args.markdown:
        print(page(), end="")
        return 0
    found = matching(args.pattern)
    if not found:
        near = nearest(general(args.pattern), (key.path for key in _listed()))
        hint = f" Did you mean {near}?" if near else " `jaxgear keys` lists all of them."
        print(f"jaxgear: no key of a scene is like {show(args.pattern)}.{hint}", file=sys.stderr)
        return 2
    if args.json:
        print(json.dumps([_told(key) for key in found], indent=2))
    else:
        print("\n".join(map(_text, found)))
    return 0


def explain_key(path: str) -> int:
    """Print all that is known of one key; the exit code is 2 where there is none."""
    key = key_at(path)
    if key is None:
        if name := next((x for x, symbol in SYMBOLS.items() if path in (x, symbol)), None):
            print(f"{name}, symbol {SYMBOLS[name]}: a result in the summary, no key of a scene.")
            return 0
        near = nearest(general(path), KEYS)
        hint = f" Did you mean {near}?" if near else " `jaxgear keys` lists all of them."
        print(f"jaxgear: a scene has no key {show(path)}.{hint}", file=sys.stderr)
        return 2
    print("\n".join([_text(key), *(f"    {line}" for line in _more(key))]))
    return 0


def _more(key: Key) -> Iterable[str]:
    """What else is known of a key: its derivative, what it makes anew, what example scenes have."""
    if key.remedy:
        yield f"{key.remedy}."
    if key.differentiable:
        yield "Responses have derivatives by it: it may be searched ([optimise].vary) and scatter."
    for gear in GEARS:
        if scales_body(key.path, gear):
            yield f"A condensed body of the {gear} follows it, and is not made anew."
        elif shapes_body(key.path, gear):
            yield f"Another value makes another condensed body of the {gear}."
    if shapes_teeth(key.path):
        yield "Another value makes other teeth of finite elements."
    for ready in sorted(READY.glob("*.toml")):
        scene = read_scene(ready)
        given = [scene.values[each] for each in scene.given if general(each) == key.path]
        if given:
            yield f"{ready.stem}: {', '.join(map(show, given))}"


def matching(pattern: str) -> list[Key]:
    """Find keys, in the order of the schema, by a part of their path or of their meaning.

    In any case; `*` and `?` stand for any text and any sign, an index for any row. Keys of tables
    whose keys are paths of other keys are found by their own path only.
    """
    form = f"*{general(pattern).lower().replace('[', '[[]')}*"
    alike = lambda text: fnmatch.fnmatchcase(text.lower(), form)
    if not pattern:
        return list(_listed())
    plain = [key for path, key in KEYS.items() if not path.startswith(BY_PATH)]
    found = [key for key in plain if alike(key.path) or alike(key.doc)]
    found = found or [key for key in _listed() if alike(key.path)]
    return found or [key for key in KEYS.values() if alike(key.path)]


def _told(key: Key) -> dict[str, Any]:
    """All that is known of a key, in plain types."""
    return {
        "key": key.path,
        "kind": key.kind,
        "unit": key.unit,
        "required": key.default is REQUIRED,
        "default": None if key.default in (REQUIRED, OPTIONAL) else key.default,
        **{name: getattr(key, name) for name in _NUMBERS},
        "choices": list(key.choices),
        "counts_if": _equation(key.applies_if),
        "default_if": _equation(key.default_if),
        "instead_of": key.instead_of,
        "differentiable": key.differentiable,
        "meaning": key.doc,
        "remedy": key.remedy,
    }


def page() -> str:
    """Write the page of all keys, by tables, in Markdown."""
    tables: dict[str, list[Key]] = {}
    for key in _listed():
        # Both gears have the same keys.
        if not re.search(r"\bwheel\b", key.path):
            tables.setdefault(key.table, []).append(key)
    return "\n".join([_PAGE, *(_section(table, keys) for table, keys in tables.items())])


def _listed() -> Iterable[Key]:
    """All keys; of the tables whose keys are paths of other keys, one example each."""
    for path, key in KEYS.items():
        table = next((each for each in BY_PATH if path.startswith(f"{each}.")), "")
        first = _EXAMPLE if table != "sizing.amounts" else "flank.pinion.tip_relief.depth_um"
        if not table or path == f"{table}.{first}":
            yield key


def _text(key: Key) -> str:
    return f"{key.path}\n    {key.doc}\n    {key.allowed}; {_default(key)}"


def _default(key: Key) -> str:
    """Say what the absence of a key means, and when it counts."""
    if key.default is REQUIRED:
        text = "required"
    elif key.default is OPTIONAL:
        text = "optional"
    else:
        text = f"default {show(key.default)}"
    if condition := key.applies_if or key.default_if:
        text += f" where {_equation(condition)}"
    if key.instead_of:
        return f"{text}, instead of {key.instead_of}"
    others = [each.path for each in KEYS.values() if each.instead_of == key.path]
    return f"{text}; or {', '.join(others)}" if others else text


def _equation(condition: tuple[str, str] | None) -> str:
    return f"{condition[0]} = {show(condition[1])}" if condition else ""


def _section(table: str, keys: Iterable[Key]) -> str:
    """One table of the page."""
    twin = re.sub(r"\bpinion\b", "wheel", table)
    names = [
        f"`[[{name.removesuffix('[]')}]]`" if name.endswith("[]") else f"`[{name}]`"
        for name in dict.fromkeys((table, twin))
    ]
    title = ", ".join(names) if table else "Above all tables"
    head = ["| key | value | default | meaning |", "|---|---|---|---|"]
    lines = []
    for key in keys:
        name, default = key.path.removeprefix(f"{table}."), _default(key).removeprefix("default ")
        lines.append(f"| `{name}` | {key.allowed} | {default} | {key.doc} |")
    return "\n".join([f"## {title}", "", *head, *lines, ""])
