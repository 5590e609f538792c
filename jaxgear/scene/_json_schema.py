"""The keys of a scene as JSON Schema, from which editors complete, explain and check."""

import re
from typing import Any

from jaxgear.scene._key import OPTIONAL, REQUIRED, Key, show
from jaxgear.scene._schema import ALWAYS, BY_PATH, KEYS

# The file that `init` writes beside a scene, and the line by which an editor finds it.
SCHEMA_FILE = "jaxgear.schema.json"
SCHEMA_LINE = f"#:schema ./{SCHEMA_FILE}\n"

_TYPES = {
    "float": {"type": "number"},
    "int": {"type": "integer"},
    "text": {"type": "string"},
    "bool": {"type": "boolean"},
}
_BOUNDS = {
    "above": "exclusiveMinimum",
    "at_least": "minimum",
    "below": "exclusiveMaximum",
    "at_most": "maximum",
}


def json_schema() -> dict[str, Any]:
    """All keys of the scene file as a JSON Schema (draft 2020-12).

    Types, bounds, lengths, choices, units and meanings, and the keys without which there is no
    scene. What holds between keys is left to `read_scene`.
    """
    root = _table()
    instead = {key.instead_of for key in KEYS.values()}
    for path, key in KEYS.items():
        home = next((table for table in BY_PATH if path.startswith(f"{table}.")), "")
        if home:
            _put_path(_inner(root, home), path.removeprefix(f"{home}."), _value(key))
            continue
        table, _, name = path.rpartition(".")
        node = _inner(root, table) if table else root
        node["properties"][name] = _either(node["properties"].get(name), _value(key))
        if key.default is REQUIRED and key.applies_if is None and path not in instead:
            node.setdefault("required", []).append(name)
    root["required"] += [table for table in ALWAYS if table]
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Scene of jaxgear",
    }
    return head | root


def _table() -> dict[str, Any]:
    return {"type": "object", "properties": {}, "additionalProperties": False}


def _inner(root: dict[str, Any], path: str) -> dict[str, Any]:
    """The schema of a table, made with those above it where there is none yet."""
    node = root
    for part in path.split("."):
        name = part.removesuffix("[]")
        known = node["properties"].get(name)
        if name != part:
            array: dict[str, Any] = {"type": "array", "items": _table()}
            known = known or array
            node["properties"][name], node = known, known["items"]
        elif known is None or known.get("type") == "object":
            node = node["properties"].setdefault(name, _table())
        else:
            # A value, or a table in its place, such as the speeds of a sweep.
            both = known if "anyOf" in known else _either(_table(), known)
            node["properties"][name] = both
            node = next(each for each in both["anyOf"] if each.get("type") == "object")
    return node


def _either(table: dict[str, Any] | None, value: dict[str, Any]) -> dict[str, Any]:
    """A value, or the table that may stand in its place."""
    if table is None:
        return value
    return {"description": value["description"], "anyOf": [value, table]}


def _put_path(table: dict[str, Any], path: str, value: dict[str, Any]) -> None:
    """Put a key whose name is the path of another, in quotes; nested tables may say the same."""
    table["additionalProperties"] = {"type": "object"}
    if "[]" in path:
        form = re.escape(path).replace(r"\[\]", r"\[(0|[1-9][0-9]*)\]")
        table.setdefault("patternProperties", {})[f"^{form}$"] = value
    else:
        table["properties"][path] = value


def _value(key: Key) -> dict[str, Any]:
    """The schema of one value."""
    found: dict[str, Any] = dict(_TYPES[key.kind.removesuffix("s")])
    found |= {
        word: getattr(key, name) for name, word in _BOUNDS.items() if getattr(key, name) is not None
    }
    if key.choices:
        found["enum"] = list(key.choices)
    if key.pattern:
        found["pattern"] = f"^(?:{key.pattern})$"
    if key.kind.endswith("s"):
        found = {"type": "array", "items": found, "minItems": key.length or 1}
        if key.length is not None:
            found["maxItems"] = key.length
    if key.default not in (REQUIRED, OPTIONAL):
        found["default"] = key.default
    return {"description": _description(key), **found}


def _description(key: Key) -> str:
    """What an editor shows of a key: meaning, unit, when it counts, what to do out of bounds."""
    condition = key.applies_if
    parts = [
        key.doc + (f" [{key.unit}]" if key.unit else ""),
        f"counts where {condition[0]} = {show(condition[1])}" if condition else "",
        f"instead of {key.instead_of}" if key.instead_of else "",
        key.remedy,
    ]
    return ". ".join(part for part in parts if part)
