"""Counts of the sources, beside those of version 0.8: how much there is, and how far it reaches.

`make measure`, or `python benchmarks/measure.py [ROOT]` for another checkout. In one of version 0.8
the layers are still one folder, `jaxgear/_app`, where nothing counts as outside of `scene`.
"""

import ast
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

PACKAGES = ("jaxgear", "fem_prep", "optimise")
LAYERS = ("scene", "study", "plot", "report", "explore", "_cli", "_app")
LONGEST_FILE, LONGEST_FUNCTION = 400, 80
# Other names for a dict that says nothing of what is in it; summaries, which are for users, aside.
_BARE = re.compile(r"(dict|Columns)\b")


class Source(NamedTuple):
    """A file: its parts below the root of the checkout, its text, its tree."""

    parts: tuple[str, ...]
    text: str
    tree: ast.Module

    @property
    def lines(self) -> int:
        return self.text.count("\n")

    @property
    def in_layers(self) -> bool:
        return self.parts[0] == "jaxgear" and self.parts[1] in LAYERS

    @property
    def in_scene(self) -> bool:
        return self.parts[:2] == ("jaxgear", "scene")

    def functions(self) -> Iterator[ast.FunctionDef]:
        return (node for node in ast.walk(self.tree) if isinstance(node, ast.FunctionDef))


def sources(root: Path, *folders: str) -> list[Source]:
    """Every Python file and stub below the folders."""
    paths = (path for name in folders for path in sorted((root / name).rglob("*.py*")))
    texts = ((path, path.read_text()) for path in paths if path.suffix in (".py", ".pyi"))
    return [Source(path.relative_to(root).parts, text, ast.parse(text)) for path, text in texts]


def lines_of_code(function: ast.FunctionDef) -> int:
    """Lines of a function without its docstring."""
    length = (function.end_lineno or function.lineno) - function.lineno + 1
    first = function.body[0]
    if ast.get_docstring(function) is not None:
        length -= (first.end_lineno or first.lineno) - first.lineno + 1
    return length


def takes_scene(function: ast.FunctionDef) -> bool:
    """Whether an argument is the whole scene."""
    given = function.args
    named = (*given.posonlyargs, *given.args, *given.kwonlyargs)
    # Quoted where the class is imported for types alone.
    kinds = (ast.unparse(each.annotation).strip("'") for each in named if each.annotation)
    return "Scene" in kinds


def reads_scene(node: ast.AST) -> bool:
    """Whether an expression asks a scene by string: `scene[...]`, `.get`, `in`, `f(scene, "x")`."""
    is_scene = lambda value: ast.unparse(value).split(".")[-1] == "scene"
    is_text = lambda value: (
        isinstance(value, ast.JoinedStr)
        or (isinstance(value, ast.Constant) and isinstance(value.value, str))
    )
    match node:
        case ast.Subscript(value=value, ctx=ast.Load()):
            return is_scene(value)
        case ast.Call(func=ast.Attribute(value=value, attr="get")):
            return is_scene(value)
        case ast.Call(args=[value, key, *_]):
            return is_scene(value) and is_text(key)
        case ast.Compare(ops=[ast.In() | ast.NotIn()], comparators=[value]):
            return is_scene(value) or ast.unparse(value).endswith("scene.given")
    return False


def returns_bare_dict(function: ast.FunctionDef) -> bool:
    """Whether a function returns a dict without a name for what is in it."""
    return function.returns is not None and bool(_BARE.match(ast.unparse(function.returns)))


def private_names(source: Source, files: set[tuple[str, ...]]) -> int:
    """Imports of private names of other files, and of private files of other packages."""
    count = 0
    for node in ast.walk(source.tree):
        if not isinstance(node, ast.ImportFrom):
            continue
        own = source.parts[: -node.level] if node.level else ()
        origin = (*own, *(node.module or "").split(".")) if node.module else own
        if not origin or origin[0] not in PACKAGES:
            continue
        if origin[0] != source.parts[0]:
            count += any(name.startswith("_") for name in origin[1:])
        elif source.in_layers:
            names = (each.name for each in node.names if each.name.startswith("_"))
            count += sum((*origin, name) not in files for name in names)
    return count


def counted(root: Path) -> list[tuple[str, str, str, str]]:
    """Rows: what is counted, how many at 0.8, how many at most there may be, how many there are."""
    every = sources(root, *PACKAGES)
    layers, outside = ([x for x in every if test(x)] for test in (_in_layers, _outside_scene))
    modules = {(*x.parts[:-1], x.parts[-1].partition(".")[0]) for x in every}
    files = {name[:end] for name in modules for end in range(1, len(name) + 1)}
    functions = lambda given: (each for source in given for each in source.functions())
    lines = lambda given: sum(source.lines for source in given)
    long_files = sum(source.lines > LONGEST_FILE for source in every)
    long_functions = _count(lambda x: lines_of_code(x) > LONGEST_FUNCTION, functions(every))
    reads = sum(reads_scene(node) for source in outside for node in ast.walk(source.tree))
    return [
        ("lines of what was `_app`", "23,386", "12,000", f"{lines(layers):,}"),
        ("lines of the three packages", "53,372", "42,000", f"{lines(every):,}"),
        (
            "files over 400 lines / functions over 80",
            "46 / 4",
            "0 / 0",
            f"{long_files} / {long_functions}",
        ),
        (
            "functions that take the whole scene",
            "215",
            "50",
            str(_count(takes_scene, functions(every))),
        ),
        ("reads of the scene by string outside `scene`", "482", "0", str(reads)),
        (
            "functions that return a bare dict outside `scene`",
            "139",
            "15",
            str(_count(returns_bare_dict, functions(outside))),
        ),
        (
            "private names across files and packages",
            "153",
            "0",
            str(sum(private_names(x, files) for x in every)),
        ),
        ("lines of tests", "39,134", "28,000", f"{lines(sources(root, 'tests')):,}"),
    ]


def _in_layers(source: Source) -> bool:
    return source.in_layers


def _outside_scene(source: Source) -> bool:
    return not source.in_scene


def _count(test: Callable[[ast.FunctionDef], bool], functions: Iterable[ast.FunctionDef]) -> int:
    return sum(map(test, functions))


def main() -> int:
    """Print the table."""
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]
    print(f"{'':50} {'0.8':>8} {'at most':>8} {'now':>8}")
    for what, before, most, now in counted(root):
        print(f"{what:50} {before:>8} {most:>8} {now:>8}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
