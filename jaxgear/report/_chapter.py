"""One results folder, as a command has left it."""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from jaxgear._checks import InputError

_SUMMARY, _SCENE = "summary.json", "scene.toml"
# The file of a study of many designs.
_STUDY = "study.toml"


class Chapter(NamedTuple):
    """What one command has written.

    **Fields:**

    - `name`: of the command, as far as its folder tells.
    - `folder`: where it is.
    - `summary`: its numbers.
    - `asked`: the whole scene, with what was left to defaults, by paths of keys; before it the keys
        of a study.
    """

    name: str
    folder: Path
    summary: Mapping[str, Any]
    asked: Mapping[str, Any]


def chapter(folder: Path, name: str) -> Chapter:
    """Read one results folder.

    **Raises:**

    - `InputError` if it is none, or a spoilt one.
    """
    try:
        summary = json.loads((folder / _SUMMARY).read_text(encoding="utf-8"))
        asked = dict(_flat(tomllib.loads((folder / _SCENE).read_text(encoding="utf-8"))))
        if (folder / _STUDY).exists():
            study = tomllib.loads((folder / _STUDY).read_text(encoding="utf-8"))
            asked = dict(_flat(study, "study")) | asked
    except FileNotFoundError as error:
        missing = Path(error.filename).name
        raise InputError(
            f"{folder}: not a results folder: there is no {missing} in it. Name one that a "
            "command has written, such as results/accessory."
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}: cannot be read: {error}. Run its command again.") from None
    if not isinstance(summary, dict):
        raise InputError(f"{folder / _SUMMARY}: must be a table. Run its command again.")
    return Chapter(name, folder, summary, asked)


def chapters(folder: Path) -> list[Chapter]:
    """Read a results folder, and those of the other commands on the same scene in it.

    **Raises:**

    - `InputError` if there is none, or if one is spoilt.
    """
    below = sorted(each.parent for each in folder.glob(f"*/{_SUMMARY}"))
    found = [chapter(each, each.name) for each in below]
    name = "study" if (folder / _STUDY).exists() else "run"
    own = [chapter(folder, name)] if (folder / _SUMMARY).exists() or not found else []
    return own + found


def _flat(value: Any, path: str = "") -> list[tuple[str, Any]]:
    """Every leaf of nested tables, under its path."""
    if isinstance(value, dict):
        inner = [(f"{path}.{key}" if path else key, each) for key, each in value.items()]
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        inner = [(f"{path}[{index}]", each) for index, each in enumerate(value)]
    else:
        return [(path, value)]
    return [leaf for name, each in inner for leaf in _flat(each, name)]
