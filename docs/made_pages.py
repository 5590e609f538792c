"""The pages that are made from the code: API, commands, and the notebooks beside the site.

Docstrings are Markdown with formulas, as these pages are, and go into them as they stand.
"""

import argparse
import enum
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jaxgear._cli._parser import parser

_ROOT = Path(__file__).parents[1]

# The groups of `jaxgear/__init__.pyi`, by the folder that a name comes from.
_GROUPS = {
    "_units": "Units and precision",
    "_geometry": "Geometry",
    "_flank": "Flanks",
    "_contact": "Compliance and mesh cells",
    "_interface": "Interface of bodies and mesh",
    "_system": "Bodies, shafts and systems",
    "_solve": "Contact at rest",
    "_dynamics": "Dynamics",
    "_response": "Responses",
    "scene": "Scenes",
}
_GROUP_OF = {"_program_cache": "_units", "_batches": "_units", "_smooth": "_units"}
_MODULES = {
    "jaxgear.scene": "Scene files",
    "jaxgear.study": "Studies",
    "jaxgear.plot": "Pictures",
    "jaxgear.report": "Report",
    "jaxgear.explore": "Explorer",
    "jaxgear.designs": "Studies of many designs",
    "fem_prep": "Gear bodies of finite elements",
    "optimise": "Searches",
}
_STUB_LINE = re.compile(r"^(?:from \.(\S*) import \(?\s*)(\w+) as \w+", re.MULTILINE)


def write_all(folder: Path) -> None:
    """Write all made pages below `folder`; a page that is as it was is not touched."""
    pages = {"commands.md": _commands(), **dict(_api())}
    for name in sorted((_ROOT / "examples").glob("*.ipynb")):
        pages[f"examples/{name.name}"] = name.read_text(encoding="utf-8")
    for name, text in pages.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def public_names(module: str) -> list[tuple[str, str]]:
    """The file and the name of everything that a package's stub names, in its order."""
    stub = _ROOT / module.replace(".", "/") / "__init__.pyi"
    return _STUB_LINE.findall(stub.read_text(encoding="utf-8"))


# --- Commands


def _commands() -> str:
    """The reference of commands, from the parser that reads them."""
    whole = parser()
    lines = ["# Commands", "", f"{whole.description}", "", "Made from the parser of `jaxgear`."]
    (commands,) = (x for x in whole._actions if isinstance(x, argparse._SubParsersAction))
    helps = {choice.dest: choice.help for choice in commands._choices_actions}
    for name, command in commands.choices.items():
        lines += ["", f"(command-{name})=", f"## jaxgear {name}", "", _sentence(helps[name] or "")]
        if command.description:
            lines += ["", command.description]
        usage = command.format_usage().removeprefix("usage: ")
        lines += ["", "```text", re.sub(r"\n +", "\n    ", usage).strip(), "```", ""]
        lines += [_argument(action) for action in command._actions]
    lines += ["", "## Exit codes", "", "| code | what happened |", "|---|---|"]
    lines += ["| 0 | all went well |", "| 1 | a solver failed, or a check did |"]
    lines += ["| 2 | a bad scene, an impossible gear, or wrong arguments |"]
    return "\n".join(lines) + "\n"


def _argument(action: argparse.Action) -> str:
    names = ", ".join(f"`{name}`" for name in action.option_strings)
    value = action.metavar or ""
    value = " ".join(value) if isinstance(value, tuple) else str(value)
    if action.choices is not None:
        value = " | ".join(str(choice) for choice in action.choices)
    shown = f"{names} `{value}`" if names and value and action.nargs != 0 else names or f"`{value}`"
    return f"- {shown}: {_escaped(action.help or '')}"


def _sentence(text: str) -> str:
    return _escaped(text[:1].upper() + text[1:] + ("" if text.endswith(".") else "."))


def _escaped(text: str) -> str:
    """Text of the terminal as Markdown: stars and brackets mean themselves."""
    return re.sub(r"([*\[\]<>_])", r"\\\1", text)


# --- API


def _api() -> Iterator[tuple[str, str]]:
    """Each page of the API by its file."""
    groups: dict[str, list[str]] = {group: [] for group in _GROUPS}
    for file, name in public_names("jaxgear"):
        folder = file.partition(".")[0]
        if folder:
            groups[_GROUP_OF.get(folder, folder)].append(name)
    for group, names in groups.items():
        title = _GROUPS[group]
        # Names of scenes are documented once, with the rest of `jaxgear.scene`.
        if group != "scene":
            yield f"api/{group.strip('_')}.md", _api_page(title, "jaxgear", names)
    for module, title in _MODULES.items():
        names = [name for _, name in public_names(module)]
        yield f"api/{module}.md", _api_page(title, module, names)


def _api_page(title: str, module: str, names: list[str]) -> str:
    package = importlib.import_module(module)
    about = inspect.getdoc(package) if module != "jaxgear" else None
    parts = [f"# {title}", f"Import as `{module}`."]
    parts += [about] if about else []
    for name in names:
        parts.append(_entry(module, name, getattr(package, name)))
    return "\n\n".join(parts) + "\n"


def _entry(module: str, name: str, thing: object) -> str:
    """One public name with its docstring, in the directive of its kind."""
    text = f"\n{_docstring(thing)}"
    if inspect.isclass(thing):
        members = "\n\n".join(_members(thing))
        signature = "" if inspect.isabstract(thing) or _is_choice(thing) else _signature(thing)
        body = f"{text}\n\n{members}".rstrip()
        return f":::::{{py:class}} {module}.{name}{signature}\n{body}\n:::::"
    if callable(thing):
        return f":::::{{py:function}} {module}.{name}{_signature(thing)}\n{text}\n:::::"
    return f":::::{{py:data}} {module}.{name}\n:value: {thing!r}\n:::::"


def _is_choice(thing: type) -> bool:
    return issubclass(thing, enum.Enum | BaseException)


def _members(thing: type) -> Iterator[str]:
    """Public methods and properties that a class has a docstring for, its own and inherited."""
    for name, member in inspect.getmembers_static(thing):
        if name.startswith("_") or not _is_ours(member):
            continue
        if isinstance(member, property):
            yield f"::::{{py:property}} {name}\n\n{_docstring(member)}\n::::"
        elif callable(getattr(thing, name)) and inspect.getdoc(member):
            yield f"::::{{py:method}} {name}{_signature(member)}\n\n{_docstring(member)}\n::::"


def _is_ours(member: object) -> bool:
    of = getattr(member, "fget", member)
    of = getattr(of, "__func__", of)
    module = str(getattr(inspect.unwrap(of) if callable(of) else of, "__module__", ""))
    return module.partition(".")[0] in {"jaxgear", "fem_prep", "optimise"}


def _docstring(thing: object) -> str:
    """The docstring, each formula that it cites as a link."""
    return re.sub(r"\btheory (\d+\.\d+)", r"[theory \1](#theory-\1)", inspect.getdoc(thing) or "")


def _signature(thing: Any) -> str:
    """Names and defaults of the arguments: shapes and units are in the text below."""
    try:
        found = inspect.signature(thing)
    except (TypeError, ValueError):
        return "()"
    kept = [
        parameter.replace(annotation=inspect.Parameter.empty, default=_default(parameter.default))
        for name, parameter in found.parameters.items()
        if name != "self"
    ]
    return str(found.replace(parameters=kept, return_annotation=inspect.Signature.empty))


class _Shown:
    """A default as a signature shows it."""

    def __init__(self, text: str):
        self._text = text

    def __repr__(self) -> str:
        return self._text


def _default(value: object) -> object:
    if value is inspect.Parameter.empty or isinstance(value, str | int | float | bool | None):
        return value
    if isinstance(value, tuple) and all(isinstance(x, str | int | float) for x in value):
        return value
    return _Shown("..." if callable(value) else f"{type(value).__name__}()")
