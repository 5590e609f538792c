"""The documentation: its links lead somewhere, its formulas are numbered, its examples work."""

import importlib.util
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest

import jaxgear
from jaxgear._cli._parser import parser
from jaxgear.scene._schema import KEYS

_ROOT = Path(__file__).parents[1]
_DOCS = _ROOT / "docs"
_PAGES = sorted(
    [
        *(path for path in _DOCS.rglob("*.md") if "_made" not in path.parts),
        *_ROOT.glob("*.md"),
    ]
)
_CHAPTERS = re.findall(
    r"^([a-z_]+)$", (_DOCS / "theory" / "index.md").read_text("utf-8"), re.MULTILINE
)[:-1]
_FORMULA = re.compile(r"^\(theory-([\d.]+)\)=\n\$\$\n(.*?)\n\$\$\n", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_NAME = re.compile(r"\{py:[a-z]+\}`([\w.]+)`")


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", _text(path), re.MULTILINE | re.DOTALL)


def _anchors(path: Path) -> set[str]:
    """What a link may lead to on a page: its headings, as they are spelt in links, and labels."""
    headings = re.findall(r"^#+ (.*)$", _text(path), re.MULTILINE)
    spelt = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
    return spelt | set(re.findall(r"^\(([\w.-]+)\)=$", _text(path), re.MULTILINE))


def _made_pages():
    spec = importlib.util.spec_from_file_location("made_pages", _DOCS / "made_pages.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """The pages that are made from the code."""
    folder = tmp_path_factory.mktemp("docs") / "_made"
    _made_pages().write_all(folder)
    return folder


@pytest.mark.parametrize("page", _PAGES, ids=lambda path: str(path.relative_to(_ROOT)))
def test_links_lead_somewhere(page, made):
    everywhere = {anchor for path in (_DOCS / "theory").glob("*.md") for anchor in _anchors(path)}
    prose = re.sub(r"^```.*?^```|`[^`\n]*`", "", _text(page), flags=re.MULTILINE | re.DOTALL)
    for link in _LINK.findall(prose):
        if link.startswith(("http://", "https://")):
            continue
        place, _, anchor = link.partition("#")
        target = (page.parent / place).resolve() if place else page
        if "_made" in target.parts:
            target = made / target.relative_to(_DOCS / "_made")
        assert target.exists(), f"{page.name}: {link}"
        if anchor:
            assert anchor in (_anchors(target) if place else everywhere), f"{page.name}: {link}"


@pytest.mark.parametrize("chapter", _CHAPTERS)
def test_formulas_are_numbered_and_sourced(chapter):
    """One after the other, each with its anchor, where it is from, and closed brackets."""
    text, number = _text(_DOCS / "theory" / f"{chapter}.md"), _CHAPTERS.index(chapter) + 1
    found = _FORMULA.findall(text)
    assert text.count("\n$$\n") == 2 * len(found)
    assert [label for label, _ in found] == [f"{number}.{i + 1}" for i in range(len(found))]
    for label, formula in found:
        assert formula.endswith(rf"\tag{{{label}}}")
        opened, closed = (re.findall(rf"\\{x}\{{(\w+)\}}", formula) for x in ("begin", "end"))
        assert sorted(opened) == sorted(closed), label
        plain = re.sub(r"\\[{}]", "", formula)
        assert plain.count("{") == plain.count("}"), label
        assert formula.count(r"\left") - formula.count(r"\left\l") >= formula.count(r"\right)")
    after = re.split(r"^\(theory-[\d.]+\)=$", text, flags=re.MULTILINE)[1:]
    for (label, _), words in zip(found, after, strict=True):
        assert re.search(r"Source:|[Dd]erived\s+here|by\s+definition", words), label


def _named() -> Iterator[tuple[str, str]]:
    for page in _PAGES:
        for name in _NAME.findall(_text(page)):
            yield page.name, name


def test_names_on_the_pages_are_public(made):
    known = "".join(_text(path) for path in (made / "api").glob("*.md"))
    for page, name in _named():
        assert re.search(rf"\}} {re.escape(name)}[(\n]", known), f"{page}: {name}"


def test_what_docstrings_cite_is_there():
    labels = {
        label
        for path in (_DOCS / "theory").glob("*.md")
        for label, _ in _FORMULA.findall(_text(path))
    }
    cited = 0
    for package in ("jaxgear", "fem_prep", "optimise"):
        for path in (_ROOT / package).rglob("*.py"):
            for label in re.findall(r"\btheory (\d+\.\d+)", _text(path)):
                cited += 1
                assert label in labels, f"{path}: theory {label}"
    assert cited > 20


def test_every_public_name_has_its_place(made):
    for name in vars(jaxgear)["__all__"]:
        thing = getattr(jaxgear, name)
        if name in ("scene", "study", "plot", "report", "explore", "designs"):
            continue
        module = str(getattr(thing, "__module__", ""))
        page = "jaxgear.scene" if module.startswith("jaxgear.scene") else None
        pages = [made / "api" / f"{page}.md"] if page else (made / "api").glob("*.md")
        whole = f"jaxgear.scene.{name}" if page else f"jaxgear.{name}"
        assert any(re.search(rf"\}} {whole}[(\n]", _text(path)) for path in pages), name


def _keys(table: object, path: str = "") -> Iterator[str]:
    if isinstance(table, dict):
        for key, value in table.items():
            yield from _keys(value, f"{path}.{key}".strip("."))
    elif isinstance(table, list) and table and isinstance(table[0], dict):
        yield from _keys(table[0], f"{path}[]")
    else:
        yield path


def test_keys_in_examples_are_keys():
    count = 0
    for page in _PAGES:
        for block in _blocks(page, "toml"):
            table = tomllib.loads(block)
            # A study of many designs names its scene.
            for key in () if "scene" in table else _keys(table):
                count += 1
                assert key in KEYS, f"{page.name}: {key}"
    assert count > 20


def test_commands_in_examples_are_commands():
    count = 0
    for page in _PAGES:
        for line in "\n".join(_blocks(page, "sh")).splitlines():
            found = re.match(r"(?:\.venv/bin/)?jaxgear +([^#]*)", line)
            if found is not None:
                parser().parse_args(shlex.split(found[1]))
                count += 1
    assert count > 10


def test_commands_in_the_text_are_commands():
    """Between words a command has places for names, so only command and options are looked up."""
    known = _options()
    count = 0
    for page in _PAGES:
        prose = re.sub(r"^```.*?^```", "", _text(page), flags=re.MULTILINE | re.DOTALL)
        for line in re.findall(r"`(?:\.venv/bin/)?jaxgear ([^`]+)`", prose):
            name, *more = line.split()
            if name.startswith("-") or name == "COMMAND":
                continue
            count += 1
            assert name in known, f"{page.name}: jaxgear {line}"
            given = {each.partition("=")[0] for each in more if each.startswith("--")}
            assert given <= known[name], f"{page.name}: jaxgear {line}"
    assert count > 40


def _options() -> dict[str, set[str]]:
    """The options of each command."""
    commands = next(x.choices for x in parser()._actions if isinstance(x.choices, dict))
    return {name: set(one._option_string_actions) for name, one in commands.items()}


def test_other_programs_and_targets_are_there():
    """`make` and its targets, benchmarks, pictures' scripts: what a page tells to run."""
    targets = set(re.findall(r"^([a-z-]+)(?=[ :a-z-]*:)", _text(_ROOT / "Makefile"), re.MULTILINE))
    targets |= {"golden-record"}
    count = 0
    for page in _PAGES:
        for target in re.findall(r"(?:`|^)make ([a-z-]+)", _text(page), re.MULTILINE):
            assert target in targets, f"{page.name}: make {target}"
            count += 1
        for script in re.findall(r"\b((?:benchmarks|tests|docs)/[\w/]+\.py)", _text(page)):
            assert (_ROOT / script).exists(), f"{page.name}: {script}"
            count += 1
        for module in re.findall(r"python -m (benchmarks[\w.]*)", _text(page)):
            path = _ROOT / module.replace(".", "/")
            assert path.with_suffix(".py").exists() or path.is_dir(), f"{page.name}: {module}"
            count += 1
    assert count > 20


def test_the_citation_is_of_this_version():
    """What is both in `pyproject.toml` and in `CITATION.cff` is the same."""
    project = tomllib.loads(_text(_ROOT / "pyproject.toml"))["project"]
    citation = _text(_ROOT / "CITATION.cff")
    assert f"\nversion: {project['version']}\n" in citation
    assert f"\nlicense: {project['license']}\n" in citation
    names = "".join(f'  - name: "{each["name"]}"\n' for each in project["authors"])
    assert f"\nauthors:\n{names}version" in citation


# What is written for a folder in which commands have run is walked in it, in another test.
_WALKED = {"README.md", "SKILL.md", "studies.md"}
_WITH_CODE = [page for page in _PAGES if page.name not in _WALKED and _blocks(page, "python")]


@pytest.mark.slow
@pytest.mark.parametrize("page", _WITH_CODE, ids=lambda path: path.stem)
def test_code_on_the_pages_runs(page, capsys):
    """And prints first what its comments promise."""
    code = "\n".join(_blocks(page, "python"))
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        exec(compile(code, str(page), "exec"), {})
    promised = [float(number) for number in re.findall(r"# (\d+\.\d+) um", code)]
    printed = capsys.readouterr().out.splitlines()[: len(promised)]
    assert [round(float(line), 4) for line in printed] == promised


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_read_without_a_network(tmp_path):
    pytest.importorskip("sphinx")
    command = [sys.executable, "-m", "sphinx", "-W", "-n", "-q", "-b", "html"]
    built = subprocess.run(
        [*command, str(_DOCS), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "_static" / "mathjax" / "tex-chtml.js").exists()
    for page in tmp_path.rglob("*.html"):
        loaded = re.findall(
            r"<(?:script|img|link|iframe)[^>]*?(?:src|href)=\"(https?:[^\"]*)", _text(page)
        )
        assert loaded == [], page
