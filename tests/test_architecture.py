"""The rules of the house that a machine can hold: one-way flow, sides, classes, units, globals.

Each rule is a function from sources to faults. It is tried on the packages, where it must find
nothing, and on planted faults, where it must find each.
"""

import ast
import functools
import importlib
import inspect
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import jaxtyping
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("jaxgear", "fem_prep", "optimise")
# Names of classes are unique in each of these, as rules follow classes by name.
FAMILIES = (("jaxgear", "optimise"), ("fem_prep",))

# In the order in which data flows. A stage is a file or a folder, and imports only from above.
STAGES = (
    "_units",
    "_types",
    "_checks",
    "_program_cache",
    "_process",
    "_whole_file",
    "_columns",
    "_lowered_files",
    "_kept_programs",
    "_compiled",
    "_batches",
    "_smooth",
    "_geometry",
    "_flank",
    "_contact",
    "_interface",
    "_system",
    "_solve",
    "_dynamics",
    "_response",
    "scene",
    "study",
    "plot",
    "report",
    "explore",
    "designs",
    "_cli",
)
# What stands on the stages: scenes, studies of them, pictures, the command line.
LAYERS = ("scene", "study", "plot", "report", "explore", "designs", "_cli")

# The same for the files of `fem_prep`, which knows neither JAX nor `jaxgear`.
BODY_STAGES = (
    "_checks",
    "_grid",
    "_brick",
    "_plate",
    "_planar",
    "_section",
    "_section_properties",
    "_extrude",
    "_web",
    "_rim_quality",
    "_quality",
    "_deck",
    "_nastran_deck",
    "_decks",
    "_symmetry",
    "_files",
    "_solvers",
    "_assembly",
    "_patch",
    "_artefact",
    "_body_checks",
    "_equal_sectors",
    "_sector_shapes",
    "_repeated",
    "_archive",
    "_body_file",
    "_give_file",
    "_tooth_shape",
    "_tooth_section",
    "_prism",
    "_half_space",
    "_tooth_compliance",
    "_tooth_fineness",
    "_tooth_file",
    "_cache",
    "_seats",
    "_toothed_rim",
    "_boundary",
    "_modes",
    "_hold",
    "_stress",
    "_heat",
    "_basis",
    "_condense",
    "_fourier",
    "_answers",
    "_static_answers",
    "_grounded",
    "_compared",
    "_verdicts",
    "_health",
    "_companion",
    "_import_checks",
    "_abaqus",
    "_op4",
    "_imports",
    "_exports",
)
SCENE_FILES = ("_scene", "_build", "_with_bodies")

# Files and functions are no longer than a reader can hold.
LONGEST_FILE, LONGEST_FUNCTION = 400, 80
# Folders that are not yet held to these sizes, nor to keeping their private names to themselves.
NOT_YET_HELD = ("tests",)

# The places that set a process up, of the command line and where a user asks for it: only these
# may touch JAX's configuration.
CONFIGURE = (PurePosixPath("jaxgear/_cli/_main.py"), PurePosixPath("jaxgear/_program_cache.py"))

_SI = {"m", "s", "kg", "N", "Pa", "J", "W", "Hz", "rad", "K"}
# At the door to the user a number may still be in the unit of the file.
_DOOR = _SI | {"mm", "um", "deg", "GPa", "MPa", "rpm", "MB"}


class Source(NamedTuple):
    """A parsed file, under its path from the root of the repository."""

    path: PurePosixPath
    tree: ast.Module

    def at(self, node: ast.AST) -> str:
        return f"{self.path}:{getattr(node, 'lineno', 1)}"

    @property
    def lines(self) -> int:
        """Number of lines, to the end of the last statement."""
        return max((node.end_lineno or 1 for node in self.tree.body), default=0)

    @property
    def stage(self) -> str:
        """First name below the package, without the ending."""
        return PurePosixPath(self.path.parts[1]).stem


class Import(NamedTuple):
    """One imported name: `from jaxgear._types import Scalar` is `jaxgear._types.Scalar`."""

    node: ast.stmt
    name: str

    @property
    def parts(self) -> tuple[str, ...]:
        return tuple(self.name.split("."))


class Class(NamedTuple):
    source: Source
    node: ast.ClassDef

    @property
    def bases(self) -> list[str]:
        return [name for name in map(_last_name, self.node.bases) if name]

    @property
    def is_named_abstract(self) -> bool:
        return self.node.name.lstrip("_").startswith("Abstract")


@functools.cache
def read_sources(root: Path, *folders: str) -> tuple[Source, ...]:
    """Parse every Python file and stub below the folders; one that does not exist has none."""
    return tuple(
        Source(PurePosixPath(path.relative_to(root).as_posix()), _parsed(path))
        for folder in folders
        for ending in ("*.py", "*.pyi")
        for path in sorted((root / folder).rglob(ending))
    )


@functools.cache
def _parsed(path: Path) -> ast.Module:
    """A file's tree, for all rules: none of them changes it."""
    return ast.parse(path.read_bytes())


@functools.cache
def _nodes(tree: ast.Module) -> tuple[ast.AST, ...]:
    """All nodes of a file, found once for all rules."""
    return tuple(ast.walk(tree))


def _last_name(node: ast.AST) -> str:
    """`Module` of `eqx.Module`, `AbstractVar` of `eqx.AbstractVar[int]`."""
    match node:
        case ast.Subscript(value=value):
            return _last_name(value)
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name
    return ""


@functools.cache
def _imports(source: Source) -> tuple[Import, ...]:
    return tuple(_found_imports(source))


def _found_imports(source: Source) -> Iterator[Import]:
    for node in _nodes(source.tree):
        if isinstance(node, ast.Import):
            yield from (Import(node, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = [node.module] if node.module else []
            if node.level:
                origin = [*source.path.parts[: -node.level], *origin]
            yield from (Import(node, ".".join([*origin, alias.name])) for alias in node.names)


def _classes(sources: Iterable[Source]) -> dict[str, Class]:
    """Every class by its name, nested ones too."""
    return {
        node.name: Class(source, node)
        for source in sources
        for node in _nodes(source.tree)
        if isinstance(node, ast.ClassDef)
    }


def _lineage(name: str, classes: Mapping[str, Class]) -> Iterator[str]:
    """Names of all bases, nearest first, as far as they can be followed."""
    for base in classes[name].bases if name in classes else ():
        yield base
        yield from _lineage(base, classes)


def _methods(node: ast.ClassDef) -> dict[str, ast.FunctionDef]:
    return {x.name: x for x in node.body if isinstance(x, ast.FunctionDef)}


# --- The rules


def faults_of_flow(sources: Iterable[Source]) -> Iterator[str]:
    """A stage imports only from itself and from stages above; only layers see other packages."""
    for source in sources:
        if source.path.parts[0] != "jaxgear":
            continue
        if source.stage in ("__init__", "__main__"):
            yield from _faults_of_door(source)
            continue
        if source.stage not in STAGES:
            yield f"{source.path}: `{source.stage}` is not in the list of stages"
            continue
        for found in _imports(source):
            package, *names = found.parts
            if package not in PACKAGES:
                continue
            if package != "jaxgear":
                if source.stage not in LAYERS:
                    yield f"{source.at(found.node)}: only layers may import {found.name}"
            elif not names and source.stage in LAYERS:
                continue
            elif not names or names[0] not in STAGES:
                yield f"{source.at(found.node)}: a stage imports from stages, not {found.name}"
            elif STAGES.index(names[0]) > STAGES.index(source.stage):
                yield f"{source.at(found.node)}: {found.name} is downstream of `{source.stage}`"


def faults_of_body_flow(sources: Iterable[Source]) -> Iterator[str]:
    """A file of `fem_prep` imports only from files above; none knows JAX or `jaxgear`."""
    for source in sources:
        if source.path.parts[0] != "fem_prep" or source.stage == "__init__":
            continue
        if source.stage not in BODY_STAGES:
            yield f"{source.path}: `{source.stage}` is not in the list of files of fem_prep"
            continue
        for found in _imports(source):
            package, *names = found.parts
            if package in ("jax", "jaxgear", "equinox", "jaxtyping"):
                yield f"{source.at(found.node)}: fem_prep runs without {found.name}"
            elif package == "fem_prep" and (not names or names[0] not in BODY_STAGES):
                yield f"{source.at(found.node)}: a file imports from files, not {found.name}"
            elif package == "fem_prep":
                if BODY_STAGES.index(names[0]) >= BODY_STAGES.index(source.stage):
                    yield f"{source.at(found.node)}: {found.name} is not above `{source.stage}`"


def _faults_of_door(source: Source) -> Iterator[str]:
    """The stub of `__init__` names all in the order of the flow, `__main__` opens `_cli`.

    Of the layers, `__init__` shows the public ones, and how a scene is read and becomes a model.
    """
    latest = 0
    for found in _imports(source):
        package, *names = found.parts
        if package not in PACKAGES:
            continue
        is_stage = package == "jaxgear" and bool(names) and names[0] in STAGES
        in_layer = bool(names) and names[0] in LAYERS
        is_scene = names[:1] == ["scene"] and names[1:2] and names[1] in SCENE_FILES
        is_open = is_scene or (len(names) == 1 and not names[0].startswith("_"))
        is_door = names[:1] == ["_cli"] if source.stage == "__main__" else not in_layer or is_open
        if not is_stage or not is_door:
            yield f"{source.at(found.node)}: `{source.stage}` may not import {found.name}"
        elif STAGES.index(names[0]) < latest:
            yield f"{source.at(found.node)}: {found.name} stands below a later stage"
        else:
            latest = STAGES.index(names[0])


def faults_of_doors(sources: Iterable[Source]) -> Iterator[str]:
    """Public names stand in the stub: whoever asks for one waits for no other."""
    for source in sources:
        if source.path.parts[1:] == ("__init__.py",):
            for found in _imports(source):
                if found.parts[0] in PACKAGES:
                    yield f"{source.at(found.node)}: name {found.name} in `__init__.pyi`"


def faults_of_sides(sources: Iterable[Source]) -> Iterator[str]:
    """`fem_prep` and `optimise` use public names of `jaxgear`, and do not know each other."""
    for source in sources:
        own = source.path.parts[0]
        if own == "jaxgear":
            continue
        aliases = set()
        for found in _imports(source):
            package, *names = found.parts
            if package in PACKAGES and package not in (own, "jaxgear"):
                yield f"{source.at(found.node)}: {own} may not import {found.name}"
            if package != "jaxgear":
                continue
            if isinstance(found.node, ast.Import):
                aliases |= {x.asname or x.name for x in found.node.names if x.name == "jaxgear"}
            by_name = isinstance(found.node, ast.ImportFrom) and len(names) == 1
            if names and not (by_name and not names[0].startswith("_")):
                yield f"{source.at(found.node)}: {found.name} is not a public name of jaxgear"
        for node in _nodes(source.tree):
            match node:
                case ast.Attribute(value=ast.Name(id=alias), attr=name) if alias in aliases:
                    if name.startswith("_"):
                        yield f"{source.at(node)}: {alias}.{name} is not a public name of jaxgear"


def faults_of_classes(sources: Iterable[Source]) -> Iterator[str]:
    """A class is abstract, and says so in its name and by a member, or nothing descends from it."""
    classes = _classes(sources)
    for name, found in classes.items():
        where = found.source.at(found.node)
        for base in found.bases:
            if base in classes and not classes[base].is_named_abstract:
                yield f"{where}: `{name}` descends from `{base}`, which is not abstract"
        line = [name, *_lineage(name, classes)]
        if any(base in classes and _is_abstract(classes[base].node) for base in line):
            if _is_abstract(found.node) and not found.is_named_abstract:
                yield f"{where}: `{name}` is abstract, so its name must begin with `Abstract`"
        elif found.is_named_abstract:
            yield f"{where}: `{name}` has no abstract member, so it can be built"


def _is_abstract(node: ast.ClassDef) -> bool:
    methods = (
        _last_name(decorator).startswith("abstract")
        for method in _methods(node).values()
        for decorator in method.decorator_list
    )
    fields = (_is_abstract_field(x) for x in node.body)
    return any(methods) or any(fields)


def _is_abstract_field(node: ast.stmt) -> bool:
    return isinstance(node, ast.AnnAssign) and _is_abstract_annotation(node.annotation)


def _is_abstract_annotation(node: ast.expr) -> bool:
    return _last_name(node) in ("AbstractVar", "AbstractClassVar")


def faults_of_fields(sources: Iterable[Source]) -> Iterator[str]:
    """Every field of a module is in the docstring, with a unit where it is a quantity."""
    classes = _classes(sources)
    for name, found in classes.items():
        line = [name, *_lineage(name, classes)]
        if "Module" not in line:
            continue
        documented = _documented_fields(ast.get_docstring(found.node) or "")
        fields = _fields(found.node)
        for field, node in fields.items():
            where = f"{found.source.at(node)}: `{name}.{field}`"
            if field not in documented:
                yield f"{where} is not in the docstring's list of fields"
            elif not _names_unit(documented[field], found.source) and not _is_choice(node, classes):
                yield f"{where} states no unit, such as [m], [-] or [rad]"
        known = {x for base in line if base in classes for x in _fields(classes[base].node)}
        for field in documented.keys() - known:
            yield f"{found.source.at(found.node)}: `{name}` documents `{field}`, which it lacks"


def _fields(node: ast.ClassDef) -> dict[str, ast.AnnAssign]:
    return {
        x.target.id: x
        for x in node.body
        if isinstance(x, ast.AnnAssign)
        and isinstance(x.target, ast.Name)
        and _last_name(x.annotation) != "ClassVar"
    }


def _documented_fields(docstring: str) -> dict[str, str]:
    """Description of each field in the list under `**Fields:**`."""
    _, _, rest = inspect.cleandoc(docstring).partition("**Fields:**")
    listed = re.split(r"^\*\*\w+:\*\*", rest, maxsplit=1, flags=re.MULTILINE)[0]
    described = {}
    for item in re.split(r"^- ", listed, flags=re.MULTILINE)[1:]:
        names, _, description = item.partition(":")
        described |= dict.fromkeys(re.findall(r"`(\w+)`", names), description)
    return described


def _names_unit(description: str, source: Source) -> bool:
    allowed = _DOOR if source.stage in LAYERS else _SI
    for text in re.findall(r"\[([^\[\]]+)\]", description):
        symbols = re.findall(r"[^\W\d_]+", text)
        if text == "-" or (symbols and allowed.issuperset(symbols)):
            return True
    return False


def _is_choice(node: ast.AnnAssign, classes: Mapping[str, Class]) -> bool:
    """Whether a field is no quantity: a choice, a module, or a container of those."""
    if any(
        keyword.arg == "static" and ast.unparse(keyword.value) == "True"
        for call in ast.walk(node)
        if isinstance(call, ast.Call)
        for keyword in call.keywords
    ):
        return True
    return all(_is_choice_type(x, classes) for x in _alternatives(node.annotation))


def _alternatives(annotation: ast.expr) -> Iterator[ast.expr]:
    """The members of `A | B | None`, without the `None`."""
    match annotation:
        case ast.BinOp(left=left, op=ast.BitOr(), right=right):
            yield from _alternatives(left)
            yield from _alternatives(right)
        case ast.Subscript(slice=inner) if _is_abstract_annotation(annotation):
            yield from _alternatives(inner)
        case ast.Constant(value=str() as text):
            yield from _alternatives(ast.parse(text, mode="eval").body)
        case ast.Constant(value=None):
            pass
        case _:
            yield annotation


def _is_choice_type(annotation: ast.expr, classes: Mapping[str, Class]) -> bool:
    name = _last_name(annotation)
    if name in classes or name.startswith("Flag"):
        return True
    return name in ("str", "bool", "Bool", "tuple", "Callable", "Module")


def faults_of_docstrings(sources: Iterable[Source]) -> Iterator[str]:
    """Modules, public classes, functions and methods say what they are."""
    sources = list(sources)
    classes = _classes(sources)
    for source in sources:
        # A package within may be marked by an empty file.
        if source.tree.body and not ast.get_docstring(source.tree):
            yield f"{source.path}: the module has no docstring"
        for node in source.tree.body:
            if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name.startswith("_"):
                continue
            if not ast.get_docstring(node):
                yield f"{source.at(node)}: `{node.name}` has no docstring"
            if not isinstance(node, ast.ClassDef):
                continue
            line = [classes[x].node for x in _lineage(node.name, classes) if x in classes]
            inherited = {method for base in line for method in _methods(base)}
            for name, method in _methods(node).items():
                if name.startswith("_") or name in inherited or ast.get_docstring(method):
                    continue
                yield f"{source.at(method)}: `{node.name}.{name}` has no docstring"


def faults_of_globals(sources: Iterable[Source]) -> Iterator[str]:
    """The library leaves JAX's configuration to whoever runs the process."""
    named = " and ".join(map(str, CONFIGURE))
    for source in sources:
        if source.path in CONFIGURE:
            continue
        for node in _nodes(source.tree):
            match node:
                case ast.Call(func=ast.Attribute(value=owner, attr="update")):
                    touched = _last_name(owner) == "config"
                case ast.Attribute(value=owner, ctx=ast.Store()):
                    touched = _last_name(owner) == "config"
                case _:
                    continue
            if touched:
                yield f"{source.at(node)}: only {named} may change the configuration"


def faults_of_annotations(sources: Iterable[Source]) -> Iterator[str]:
    """The future import turns `eqx.AbstractVar` into a concrete field, silently."""
    for source in sources:
        for found in _imports(source):
            if found.name == "__future__.annotations":
                yield f"{source.at(found.node)}: annotations must be evaluated; remove the import"


def faults_of_sizes(sources: Iterable[Source]) -> Iterator[str]:
    """A file has at most 400 lines, a function 80, docstring and decorators included."""
    for source in _held(sources):
        if source.lines > LONGEST_FILE:
            yield f"{source.path}: {source.lines} lines, at most {LONGEST_FILE} can be: split it"
        for node in _nodes(source.tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                length = (node.end_lineno or node.lineno) - node.lineno + 1
                if length > LONGEST_FUNCTION:
                    yield (
                        f"{source.at(node)}: `{node.name}` has {length} lines, at most "
                        f"{LONGEST_FUNCTION} can be"
                    )


def faults_of_private_names(sources: Iterable[Source]) -> Iterator[str]:
    """What begins with an underscore stays in its file; files and folders may begin so."""
    sources = list(sources)
    files = {source.path.with_suffix("").parts for source in sources}
    folders = {path[:end] for path in files for end in range(1, len(path))}
    for source in _held(sources):
        for found in _imports(source):
            package, *names = found.parts
            private = bool(names) and names[-1].startswith("_") and not names[-1].startswith("__")
            if package in PACKAGES and private and found.parts not in files | folders:
                yield f"{source.at(found.node)}: {found.name} is private to its file"


def _held(sources: Iterable[Source]) -> Iterator[Source]:
    return (x for x in sources if not str(x.path).startswith(NOT_YET_HELD))


# --- The packages keep them

RULES = (
    faults_of_flow,
    faults_of_body_flow,
    faults_of_doors,
    faults_of_sides,
    faults_of_classes,
    faults_of_fields,
    faults_of_docstrings,
    faults_of_globals,
)


@pytest.mark.parametrize("rule", [faults_of_sizes, faults_of_private_names])
def test_all_sources_keep_the_rule(rule):
    faults = list(rule(read_sources(ROOT, *PACKAGES, "tests")))
    assert not faults, "\n" + "\n".join(faults)


@pytest.mark.parametrize("rule", RULES)
def test_packages_keep_the_rule(rule):
    faults = [fault for family in FAMILIES for fault in rule(read_sources(ROOT, *family))]
    assert not faults, "\n" + "\n".join(faults)


def test_no_file_puts_annotations_off():
    everywhere = read_sources(ROOT, *PACKAGES, "tests", "examples", "benchmarks")
    faults = list(faults_of_annotations(everywhere))
    assert not faults, "\n" + "\n".join(faults)


def test_rules_have_something_to_hold():
    sources = read_sources(ROOT, *PACKAGES)
    classes = _classes(sources)
    modules = [name for name in classes if "Module" in _lineage(name, classes)]
    assert {source.path.parts[0] for source in sources} >= {"jaxgear", "fem_prep"}
    assert {"_types", "_geometry"} <= {source.stage for source in sources}
    assert sum(len(_fields(classes[name].node)) for name in modules) > 10


def test_names_of_classes_are_unique():
    for family in FAMILIES:
        sources = read_sources(ROOT, *family)
        count = sum(isinstance(x, ast.ClassDef) for s in sources for x in _nodes(s.tree))
        assert len(_classes(sources)) == count


@pytest.fixture(scope="module")
def modules():
    # The packages themselves are found by the editable install, past the hook: they hold no code.
    return [
        importlib.import_module(".".join(source.path.with_suffix("").parts))
        for source in read_sources(ROOT, "jaxgear", "optimise")
        if source.path.stem not in ("__init__", "__main__") and _names_shapes(source)
    ]


def _names_shapes(source: Source) -> bool:
    """Whether it annotates arrays: with jaxtyping, or with the names in `_types`.

    That file makes the names: what its converters give the classes check.
    """
    return source.stage != "_types" and any(
        "jaxtyping" in each.parts or "_types" in each.parts for each in _imports(source)
    )


def test_every_module_that_names_shapes_carries_their_checks(modules):
    assert len(modules) > 100
    for module in modules:
        loader = type(module.__loader__)
        assert loader.__module__.partition(".")[0] == jaxtyping.__name__, f"{module}: {loader}"


@pytest.mark.parametrize(
    "name", [*PACKAGES, "jaxgear.scene", "jaxgear.study", "jaxgear.plot", "jaxgear.designs"]
)
def test_every_public_name_is_there_when_asked_for(name):
    package = importlib.import_module(name)
    stub_path = name.replace(".", "/") + "/__init__.pyi"
    (stub,) = (x for x in read_sources(ROOT, name.split(".")[0]) if str(x.path) == stub_path)
    listed = [found.parts[-1] for found in _imports(stub)]
    assert len(set(listed)) == len(listed)
    assert sorted(listed) == package.__all__ == dir(package)
    assert all(getattr(package, each) is not None for each in listed)
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = package.no_such_name


@pytest.mark.slow
@pytest.mark.end_to_end
def test_import_makes_no_array():
    # One made before the user's script turns double precision on would be in single precision,
    # and one made in a file first asked for while JAX traces would be of that trace alone.
    names = [
        ".".join(source.path.with_suffix("").parts)
        for source in read_sources(ROOT, "jaxgear", "optimise")
        if source.path.stem not in ("__init__", "__main__")
    ]
    assert _arrays_made_by(f"import jaxgear, optimise, {', '.join(names)}") == 0


def test_bodies_are_prepared_without_jax():
    code = "import sys, fem_prep; print(sum(name in sys.modules for name in ('jax', 'jaxgear')))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "0\n", done.stderr


def _arrays_made_by(code: str) -> int:
    command = [sys.executable, "-c", f"{code}\nimport jax\nprint(len(jax.live_arrays()))"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


# --- The rules can fail


def _planted(files: Mapping[str, str]) -> list[Source]:
    return [
        Source(PurePosixPath(path), ast.parse(textwrap.dedent(text)))
        for path, text in files.items()
    ]


def _faults(rule, path: str, text: str) -> list[str]:
    return list(rule(_planted({path: text})))


def test_sources_are_read_from_disc(tmp_path):
    stage = tmp_path / "jaxgear" / "_geometry"
    stage.mkdir(parents=True)
    (stage / "_pair.py").write_text("from jaxgear._solve import x\n")
    (source,) = read_sources(tmp_path, *PACKAGES)
    assert str(source.path) == "jaxgear/_geometry/_pair.py"
    assert list(faults_of_flow([source])) == [
        "jaxgear/_geometry/_pair.py:1: jaxgear._solve.x is downstream of `_geometry`"
    ]


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("jaxgear/_geometry/_pair.py", "from jaxgear._solve._static import solve"),
        ("jaxgear/_geometry/_pair.py", "from .._solve import solve"),
        ("jaxgear/_geometry/_pair.py", "from .. import _solve"),
        ("jaxgear/_geometry/_pair.py", "from jaxgear import _solve"),
        ("jaxgear/_geometry/_pair.py", "import jaxgear._solve._static as static"),
        ("jaxgear/_geometry/_pair.py", "def f():\n    from .._solve import solve"),
        ("jaxgear/_geometry/_pair.py", "if TYPE_CHECKING:\n    from .._solve import Solution"),
        ("jaxgear/_checks.py", "from ._geometry import GearPair"),
        ("jaxgear/_response/_te.py", "from jaxgear.scene._scene import Scene"),
        ("jaxgear/_geometry/_pair.py", "import jaxgear"),
        ("jaxgear/_geometry/_pair.py", "from jaxgear import GearPair"),
        ("jaxgear/_geometry/_pair.py", "from optimise import minimise"),
        ("jaxgear/_geometry/_pair.py", "import fem_prep"),
        ("jaxgear/_geomtry.py", "x = 1"),
        ("jaxgear/study/_run.py", "from jaxgear.plot._pictures import sweep"),
        ("jaxgear/study/_run.py", "from jaxgear import plot"),
        ("jaxgear/scene/_build.py", "from jaxgear.study import statics"),
        ("jaxgear/plot/_pictures.py", "from jaxgear._cli._folder import Folder"),
        ("jaxgear/__init__.pyi", "from ._cli._main import main"),
        ("jaxgear/__init__.pyi", "from . import _cli as cli"),
        ("jaxgear/__init__.pyi", "from optimise import minimise"),
        (
            "jaxgear/__init__.pyi",
            "from ._solve import solve as solve\nfrom ._geometry import Gear as Gear",
        ),
        ("jaxgear/__main__.py", "from jaxgear._geometry import GearPair"),
    ],
)
def test_upstream_import_is_found(path, text):
    assert len(_faults(faults_of_flow, path, text)) == 1


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("jaxgear/_geometry/_pair.py", "from .._types import Scalar\nfrom ._gear import Gear"),
        ("jaxgear/_geometry/_pair.py", "import jax\nfrom jaxgear._geometry import _gear"),
        ("jaxgear/study/_run.py", "import jaxgear as jg, optimise\nfrom .._solve import solve"),
        ("jaxgear/_cli/_run.py", "from jaxgear import plot\nfrom jaxgear.study._run import run"),
        ("jaxgear/__init__.pyi", "from ._geometry import Gear as Gear\nfrom ._solve import s as s"),
        ("jaxgear/__init__.pyi", "from . import scene as scene\nfrom . import plot as plot"),
        ("jaxgear/__main__.py", "import sys\nfrom jaxgear._cli._main import main"),
    ],
)
def test_downstream_flow_is_allowed(path, text):
    assert not _faults(faults_of_flow, path, text)


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("fem_prep/_grid.py", "from ._condense import condense"),
        ("fem_prep/_grid.py", "from . import _condense"),
        ("fem_prep/_grid.py", "from ._grid import Grid"),
        ("fem_prep/_grid.py", "from fem_prep import Grid"),
        ("fem_prep/_condense.py", "import jax.numpy as jnp"),
        ("fem_prep/_condense.py", "import jaxgear as jg"),
        ("fem_prep/_gird.py", "x = 1"),
    ],
)
def test_upstream_import_is_found_in_bodies(path, text):
    assert len(_faults(faults_of_body_flow, path, text)) == 1


def test_downstream_flow_is_allowed_in_bodies():
    text = "import numpy as np\nfrom ._grid import Grid"
    assert not _faults(faults_of_body_flow, "fem_prep/_condense.py", text)


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("optimise/_loop.py", "from jaxgear._solve import solve"),
        ("optimise/_loop.py", "from jaxgear import _solve"),
        ("optimise/_loop.py", "import jaxgear._solve"),
        ("optimise/_loop.py", "from jaxgear.solve import solve"),
        ("optimise/_loop.py", "import jaxgear as jg\nx = jg._solve.solve"),
        ("optimise/_loop.py", "import fem_prep"),
        ("fem_prep/_grid.py", "from optimise import minimise"),
        ("fem_prep/_grid.py", "from jaxgear._artefact import write"),
    ],
)
def test_private_import_is_found(path, text):
    assert len(_faults(faults_of_sides, path, text)) == 1


@pytest.mark.parametrize("package", PACKAGES)
def test_import_of_all_names_at_once_is_found(package):
    text = "import lazy_loader\nfrom ._grid import Grid as Grid"
    assert len(_faults(faults_of_doors, f"{package}/__init__.py", text)) == 1
    assert not _faults(faults_of_doors, f"{package}/__init__.pyi", text)
    assert not _faults(faults_of_doors, f"{package}/_cli/__init__.py", text)


def test_public_import_is_allowed():
    text = "import jax\nimport jaxgear as jg\nfrom jaxgear import GearPair\nfrom ._loop import run"
    assert not _faults(faults_of_sides, "optimise/_line.py", text + "\nx = jg.GearPair.__name__")


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("class A(eqx.Module): ...\nclass B(A): ...", id="concrete-of-concrete"),
        pytest.param("class A(Exception): ...\nclass B(A): ...", id="exceptions-too"),
        pytest.param("class A(Generic[T]): ...\nclass B(A[int]): ...", id="generic"),
        pytest.param(
            "class Law(eqx.Module):\n    @abc.abstractmethod\n    def f(self): ...", id="unnamed"
        ),
        pytest.param("class Law(eqx.Module):\n    x: eqx.AbstractVar[int]", id="unnamed-field"),
        pytest.param("class AbstractLaw(eqx.Module):\n    def f(self): ...", id="buildable"),
    ],
)
def test_class_neither_abstract_nor_final_is_found(text):
    assert len(_faults(faults_of_classes, "jaxgear/_contact/_law.py", text)) == 1


def test_concrete_class_of_another_package_is_not_descended_from():
    planted = {
        "jaxgear/_contact.py": "class Weber(eqx.Module): ...",
        "optimise/_x.py": "class Mine(jg.Weber): ...",
    }
    assert len(list(faults_of_classes(_planted(planted)))) == 1


def test_abstract_and_final_classes_are_allowed():
    text = """
    class AbstractLaw(eqx.Module):
        @abc.abstractmethod
        def __call__(self): ...
    class _AbstractNarrow(AbstractLaw):
        width: eqx.AbstractVar[Scalar]
    class Sharp(AbstractLaw):
        def __call__(self): ...
    class SceneError(ValueError): ...
    """
    assert not _faults(faults_of_classes, "jaxgear/_contact/_law.py", text)


_CROWN = '''
class Crown(eqx.Module):
    """Crowning.

    **Fields:**

    - `depth`: material removed at either end,
        measured along the normal {unit}.
    - `shape`: of the crown.

    **Raises:**

    - `ValueError` if it is deep [m].
    """

    depth: Scalar = eqx.field(converter=as_scalar)
    shape: str
'''


@pytest.mark.parametrize("unit", ["[m]", "[-]", "[1/s]", "[kg m2/rad]", "[N/m, -]", "[N·s/m^2]"])
def test_documented_unit_is_allowed(unit):
    assert not _faults(faults_of_fields, "jaxgear/_flank.py", _CROWN.format(unit=unit))


@pytest.mark.parametrize("unit", ["", "m", "[0, 1]", "[mm]", "[deg]", "[furlong]", "[um/N]"])
def test_missing_or_foreign_unit_is_found(unit):
    (fault,) = _faults(faults_of_fields, "jaxgear/_flank.py", _CROWN.format(unit=unit))
    assert "`Crown.depth` states no unit" in fault


def test_unit_of_the_file_is_allowed_at_the_door_only():
    assert not _faults(faults_of_fields, "jaxgear/scene/_scene.py", _CROWN.format(unit="[mm]"))


def test_undocumented_field_is_found():
    (fault,) = _faults(
        faults_of_fields, "jaxgear/_flank.py", _CROWN.format(unit="[m]") + "    extent: Scalar\n"
    )
    assert "`Crown.extent` is not in the docstring" in fault


def test_field_that_is_gone_is_found():
    text = _CROWN.format(unit="[m]").replace("    shape: str\n", "")
    (fault,) = _faults(faults_of_fields, "jaxgear/_flank.py", text)
    assert "documents `shape`" in fault


def test_field_of_a_descendant_and_of_a_private_class_is_found():
    text = """
    class AbstractLaw(eqx.Module):
        @abc.abstractmethod
        def f(self): ...
    class _Law(AbstractLaw):
        width: Scalar
    """
    assert len(_faults(faults_of_fields, "jaxgear/_contact.py", text)) == 1


@pytest.mark.parametrize(
    ("declared", "needs"),
    [
        ("parts: tuple[Crown, ...]", False),
        ("crown: Crown", False),
        ("crown: 'Crown | None' = None", False),
        ("flag: bool", False),
        ("parts: eqx.AbstractVar[tuple[Crown, ...]]", False),
        ("bore: eqx.AbstractVar[Scalar]", True),
        ("settled: Flags", False),
        ("teeth: int = eqx.field(static=True)", False),
        ("teeth: int", True),
        ("bore: Scalar | None = None", True),
        ("forces: Float[Array, 'phase']", True),
    ],
)
def test_only_quantities_need_a_unit(declared, needs):
    name = declared.partition(":")[0]
    text = (
        f'class Crown(eqx.Module):\n    """.\n\n    **Fields:**\n\n    - `{name}`: it.\n    """\n'
    )
    assert len(_faults(faults_of_fields, "jaxgear/_flank.py", f"{text}\n    {declared}")) == needs


@pytest.mark.parametrize(
    "text",
    [
        "x = 1",
        '"""."""\ndef f(): ...',
        '"""."""\nclass A: ...',
        '"""."""\nclass A:\n    """."""\n    @property\n    def f(self): ...',
    ],
)
def test_missing_docstring_is_found(text):
    assert len(_faults(faults_of_docstrings, "jaxgear/_flank.py", text)) == 1


def test_private_and_inherited_docstrings_are_not_asked_for():
    text = '''
    """."""
    def _f(): ...
    class _A:
        def f(self): ...
    class AbstractB:
        """."""
        def f(self):
            """."""
    class C(AbstractB):
        """."""
        def __call__(self): ...
        def f(self): ...
    '''
    assert not _faults(faults_of_docstrings, "jaxgear/_flank.py", text)


def test_array_made_at_import_is_found():
    assert _arrays_made_by("import jax.numpy as jnp\nZERO = jnp.zeros(3)") == 1


@pytest.mark.parametrize(
    "text",
    [
        "jax.config.update('jax_enable_x64', True)",
        "from jax import config\nconfig.update('jax_enable_x64', True)",
        "def f():\n    jax.config.jax_enable_x64 = True",
    ],
)
def test_changed_configuration_is_found(text):
    assert len(_faults(faults_of_globals, "jaxgear/_solve.py", text)) == 1
    assert len(_faults(faults_of_globals, "jaxgear/_cli/_program_cache.py", text)) == 1
    assert not any(_faults(faults_of_globals, str(path), text) for path in CONFIGURE)


def test_annotations_put_off_are_found():
    text = "from __future__ import annotations"
    assert len(_faults(faults_of_annotations, "examples/01.py", text)) == 1


def test_long_file_is_found():
    path = "jaxgear/_geometry/_pair.py"
    assert not _faults(faults_of_sizes, path, "x = 1\n" * LONGEST_FILE)
    assert len(_faults(faults_of_sizes, path, "x = 1\n" * (LONGEST_FILE + 1))) == 1


def test_long_function_is_found():
    path, begins = "optimise/_search.py", "class A:\n    def f(self):\n"
    longest = begins + "        x = 1\n" * (LONGEST_FUNCTION - 1)
    assert not _faults(faults_of_sizes, path, longest)
    assert len(_faults(faults_of_sizes, path, longest + "        x = 1\n")) == 1


@pytest.mark.parametrize(
    "text", ["from jaxgear._types import _name", "from ._involute import a, _name as name"]
)
def test_private_name_of_another_file_is_found(text):
    assert len(_faults(faults_of_private_names, "jaxgear/_geometry/_pair.py", text)) == 1


def test_private_files_and_public_names_are_allowed():
    files = {
        "jaxgear/_types.py": "x = 1",
        "jaxgear/_geometry/_pair.py": "from jaxgear import _types",
    }
    files["jaxgear/_flank/_a.py"] = "from jaxgear._geometry import _pair\nfrom ._b import name"
    assert not list(faults_of_private_names(_planted(files)))
