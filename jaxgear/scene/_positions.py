"""Where keys stand in a TOML text, by line."""

import re
import tomllib
from pathlib import Path
from typing import Any

import tree_sitter
import tree_sitter_toml

from jaxgear.scene._mistakes import Mistake, SceneError, read_text
from jaxgear.scene._paths import join, key_names


def positions(text: str) -> dict[str, int]:
    """Return the line, from 1, of every key, table and list entry in a valid TOML text."""
    parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_toml.language()))
    lines: dict[str, int] = {}
    rows: dict[str, int] = {}
    for node in parser.parse(text.encode()).root_node.children:
        if node.type == "pair":
            _place_pair(node, "", lines)
        elif node.type in ("table", "table_array_element"):
            line = node.start_point.row + 1
            names = key_names(_text_of(node.named_children[0]))
            prefix = ""
            for name in names[:-1]:
                prefix = join(prefix, name)
                lines.setdefault(prefix, line)
                if prefix in rows:
                    prefix = f"{prefix}[{rows[prefix]}]"
            prefix = join(prefix, names[-1])
            if node.type == "table_array_element":
                rows[prefix] = rows.get(prefix, -1) + 1
                lines.setdefault(prefix, line)
                prefix = f"{prefix}[{rows[prefix]}]"
            lines[prefix] = line
            for child in node.named_children[1:]:
                _place_pair(child, prefix, lines)
    return lines


def _place_pair(node: tree_sitter.Node, prefix: str, lines: dict[str, int]) -> None:
    """Note the lines of one `key = value`, and of what is inside the value."""
    if node.type != "pair":
        return
    line = node.start_point.row + 1
    # A comment behind the value is in the pair.
    key, value = (child for child in node.named_children if child.type != "comment")
    names = key_names(_text_of(key))
    for name in names[:-1]:
        prefix = join(prefix, name)
        lines.setdefault(prefix, line)
    path = join(prefix, names[-1])
    lines[path] = line
    _place_value(value, path, lines)


def _place_value(node: tree_sitter.Node, path: str, lines: dict[str, int]) -> None:
    if node.type == "inline_table":
        for child in node.named_children:
            _place_pair(child, path, lines)
    elif node.type == "array":
        entries = [child for child in node.named_children if child.type != "comment"]
        for index, entry in enumerate(entries):
            lines[f"{path}[{index}]"] = entry.start_point.row + 1
            _place_value(entry, f"{path}[{index}]", lines)


def _text_of(node: tree_sitter.Node) -> str:
    assert node.text is not None
    return node.text.decode()


def read_toml(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """The tables of a file, and the place of each key in it, as file:line.

    **Raises:**

    - `SceneError` if it cannot be read, or is no TOML.
    """
    text = read_text(path)
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        line = re.search(r"at line (\d+)", str(error))
        where = f"{path}:{line[1]}" if line else str(path)
        raise SceneError([Mistake(where, "", f"this is not valid TOML: {error}")]) from None
    return document, {key: f"{path}:{line}" for key, line in positions(text).items()}
