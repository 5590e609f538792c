"""The scene file: read with all its mistakes at once, changed, and written back.

Values stay in the units of the file, under flat dotted paths.
"""

import dataclasses
import json
import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import tree_sitter
import tree_sitter_toml

from jaxgear._app import _schema
from jaxgear._app._schema import ALWAYS, KEYS, REAL_KEYS, REFUSED_TABLES, TABLES, show

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_BOUNDS = "optimise.bounds"
_SET = "--set "


# The scenes that `jaxgear init` writes.
READY = Path(__file__).parent / "scenes"


@dataclasses.dataclass(frozen=True)
class Mistake:
    """One thing wrong with a scene.

    **Fields:**

    - `where`: `file:line`, the file alone, or the `--set` argument.
    - `path`: dotted path of the key or table; empty where the whole file is meant.
    - `message`: what was given, what is allowed, what to do.
    """

    where: str
    path: str
    message: str

    def __str__(self) -> str:
        return ": ".join(part for part in (self.where, self.path, self.message) if part)


class SceneError(Exception):
    """Everything that is wrong with a scene; `str()` is the block to show the user."""

    def __init__(self, mistakes: Sequence[Mistake]):
        self.mistakes = tuple(mistakes)
        count = len(self.mistakes)
        total = f"{count} mistake{'s' if count > 1 else ''}; nothing was computed."
        super().__init__("\n".join([*map(str, self.mistakes), total]))


@dataclasses.dataclass(frozen=True)
class Scene:
    """A valid scene, flat: dotted path to value, in the units of the file.

    **Fields:**

    - `path`: the file it was read from.
    - `values`: every key given or with a default; optional keys that are absent stay absent.
    - `given`: the keys and tables that the user wrote, in the file or with `--set`.
    - `lines`: where each given key was set: `file:line` or the `--set` argument.
    """

    path: Path
    values: Mapping[str, Any]
    given: frozenset[str]
    lines: Mapping[str, str]

    def __getitem__(self, key: str) -> Any:
        return self.values[key]

    def get(self, key: str, default: object = None) -> Any:
        """Return the value of a key, or `default` where it is absent."""
        return self.values.get(key, default)

    def has_table(self, prefix: str) -> bool:
        """Say whether the user wrote the table, even an empty one."""
        return prefix in self.given

    def where(self, key: str) -> str:
        """Return where a key was set, for a message about it."""
        return self.lines.get(key, f"{self.path} (default)")

    def overridden(self) -> dict[str, object]:
        """Return the keys that were set on the command line, with their values."""
        return {
            key: value
            for key, value in self.values.items()
            if self.lines.get(key, "").startswith(_SET)
        }

    def replace(self, updates: Mapping[str, object]) -> "Scene":
        """Return the scene with other values, unchecked: they may be traced by JAX."""
        written = {*updates, *(table for key in updates for table in _schema.parents(key))}
        return dataclasses.replace(
            self,
            values=MappingProxyType({**self.values, **updates}),
            given=self.given | written,
        )

    def real_keys(self) -> tuple[str, ...]:
        """Return the numbers present that the static model can be differentiated by."""
        return tuple(
            path for path in REAL_KEYS if path in self.values and _applies(path, self.values)
        )


def read_scene(path: str | os.PathLike[str], overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file, check it, and fill in the defaults.

    **Arguments:**

    - `path`: the TOML file.
    - `overrides`: `key=value` texts of `--set`; a later one wins.

    **Raises:**

    - `SceneError` with every mistake found.
    """
    path = Path(path)
    text = _read_text(path)
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        line = re.search(r"at line (\d+)", str(error))
        where = f"{path}:{line[1]}" if line else str(path)
        raise SceneError([Mistake(where, "", f"this is not valid TOML: {error}")]) from None
    lines = {key: f"{path}:{line}" for key, line in _positions(text).items()}
    reading = _Reading(path, lines)
    for override in overrides:
        reading.override(document, override)
    reading.walk(document, "")
    values = reading.complete()
    reading.check_together(values)
    if reading.mistakes:
        raise SceneError(sorted(reading.mistakes, key=_reading_order))
    places = {key: reading.where(key) for key in values}
    return Scene(
        path=path,
        values=MappingProxyType(values),
        given=frozenset(reading.seen),
        # An inline table of `--set` replaces the whole table, so its defaults are set there too.
        lines=MappingProxyType(
            {
                key: place
                for key, place in places.items()
                if key in reading.seen or place.startswith(_SET)
            }
        ),
    )


def ready_scene(name: str, overrides: Sequence[str] = ()) -> Scene:
    """Read one of the scenes that come with jaxgear: `accessory` or `power`.

    **Arguments:**

    - `name`: of the scene.
    - `overrides`: `key=value` texts, as of `--set`.

    **Raises:**

    - `SceneError` if there is no such scene, or an override is a mistake.
    """
    return read_scene(READY / f"{name}.toml", overrides)


def write_scene(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write the whole scene, defaults included; it reads back to the same values.

    Tables that ask for work, such as `[optimise]`, are written only if the user gave them.
    """
    import tomlkit

    document: dict[str, object] = {}
    for key, value in scene.values.items():
        top = key.partition(".")[0]
        if top not in _schema.ON_REQUEST or top in scene.given:
            _put(document, _names(document, key), _plain(key, value))
    _write_atomically(Path(path), tomlkit.dumps(document))


def rewrite_scene(
    source: str | os.PathLike[str],
    updates: Mapping[str, object],
    destination: str | os.PathLike[str],
) -> None:
    """Write the user's own file with some keys changed or added, comments and order kept.

    **Arguments:**

    - `source`: the scene file to start from.
    - `updates`: dotted path to new value, in the units of the file.
    - `destination`: the file to write; may be `source`.

    **Raises:**

    - `ValueError` if the file is laid out so that it cannot be changed and keep its comments.
    """
    import tomlkit.exceptions

    text = _read_text(Path(source))
    plain = {key: _plain(key, value) for key, value in updates.items()}
    wanted = tomllib.loads(text)
    for key, value in plain.items():
        _put(wanted, _names(wanted, key), value)
    # tomlkit loses its way among dotted keys and tables spread over a file, so its text is read
    # back; where one style of new table fails the other may not.
    for headers in (True, False):
        try:
            edited = _edited(text, plain, headers)
            good = tomllib.loads(edited) == wanted
        except (ValueError, tomlkit.exceptions.TOMLKitError):
            continue
        if good:
            _write_atomically(Path(destination), edited)
            return
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
        names = _names(document, key)
        table: dict = document
        for depth, name in enumerate(names[:-1]):
            if not isinstance(table.get(name), dict):
                header = headers and (depth == 0 or names[:depth] == ["flank"])
                table[name] = tomlkit.table() if header else tomlkit.inline_table()
            table = table[name]
        table[names[-1]] = value
    return tomlkit.dumps(document)


class _Reading:
    """The state of one reading: mistakes so far, values found, and where they stand."""

    def __init__(self, path: Path, lines: dict[str, str]):
        self.path = path
        self.lines = lines
        self.mistakes: list[Mistake] = []
        self.values: dict[str, object] = {}
        self.seen: set[str] = set()
        self.tables: set[str] = set()

    def where(self, path: str) -> str:
        """Return the place of a key, or of the innermost table around it, or the file.

        A table that is there only because of a key of `--set` stands where the key does.
        """
        if path not in self.lines:
            inside = (place for key, place in self.lines.items() if key.startswith(f"{path}."))
            if place := next(inside, None):
                return place
        while path:
            if path in self.lines:
                return self.lines[path]
            path = path[: max(path.rfind("."), path.rfind("["), 0)]
        return str(self.path)

    def mistake(self, path: str, message: str) -> None:
        self.mistakes.append(Mistake(self.where(path), path, message))

    def override(self, document: dict[str, object], argument: str) -> None:
        """Apply one `key=value` of `--set` to the document."""
        where = f"{_SET}{argument}"
        name, equals, raw = argument.partition("=")
        try:
            names = _key_names(name)
        except ValueError:
            names = []
        if not equals or not names:
            message = "must be key=value, for example pair.torque_pinion_Nm=120"
            self.mistakes.append(Mistake(where, "", message))
            return
        try:
            parsed = tomllib.loads(f"x = {raw}")
        except ValueError:
            parsed = {}
        path = ""
        for part in names:
            path = _join(path, part)
        self.lines = {
            key: place
            for key, place in self.lines.items()
            if key != path and not key.startswith((f"{path}.", f"{path}["))
        }
        self.lines[path] = where
        if path.startswith(_BOUNDS + "."):
            names = _names(document, path)
        _put(document, names, parsed["x"] if set(parsed) == {"x"} else raw.strip())

    def walk(self, table: Mapping[str, object], prefix: str, refused: bool = False) -> None:
        """Check every key and table below `prefix`; `refused` once a table above was refused."""
        for name, value in table.items():
            path = _join(prefix, name)
            known = re.sub(r"\[\d+\]", "[]", path)
            rows = value if isinstance(value, list) and f"{known}[]" in TABLES else None
            if rows is not None and all(isinstance(row, dict) for row in rows):
                for index, row in enumerate(rows):
                    self.walk(row, f"{path}[{index}]", refused)
            elif isinstance(value, dict) and known in TABLES:
                self.seen.add(path)
                self.tables.add(path)
                refuse = known in REFUSED_TABLES and not refused
                if refuse:
                    self.mistake(path, f"{_schema.NOT_MODELLED}. Remove it")
                self.walk(value, path, refused or refuse)
            elif known in KEYS:
                self.seen.add(path)
                if not refused:
                    self.check(path, value)
            else:
                self.unknown(path, known, value)

    def check(self, path: str, value: object) -> None:
        """Check one known key and keep its value."""
        key = KEYS[path]
        if path in self.values:
            self.mistake(path, "is given twice, in two spellings. Keep one")
            return
        try:
            # What is not modelled at all is said before any quarrel about its value.
            refusal = key.refusal(value) if key.modelled == () else None
            read = value if refusal else key.read(value)
            refusal = refusal or key.refusal(read)
        except ValueError as error:
            self.mistake(path, str(error))
            return
        if refusal:
            self.mistake(path, refusal)
        else:
            self.values[path] = read

    def unknown(self, path: str, known: str, value: object) -> None:
        """Report a name that the schema does not have in this place."""
        if known in TABLES or f"{known}[]" in TABLES:
            what = "a table" if known in TABLES else "a list of tables"
            self.mistake(path, f"got {show(value)}, must be {what} with {_inside(known)}")
        elif isinstance(value, dict):
            near = _schema.nearest(known, sorted(TABLES))
            hint = f", did you mean [{near}]?" if near else f". Known here: {_inside(known)}"
            self.mistake(path, f"unknown table{hint}")
        else:
            near = _schema.nearest(known, (key for key in KEYS if not key.startswith(_BOUNDS)))
            if known.startswith(_BOUNDS + "."):
                near = _schema.nearest(known, (key for key in KEYS if key.startswith(_BOUNDS)))
            hint = f", did you mean {near}?" if near else f". Known here: {_inside(known)}"
            self.mistake(path, f"unknown key, got {show(value)}{hint}")

    def complete(self) -> dict[str, object]:
        """Return the values in the order of the schema, defaults filled in; report what misses."""
        values: dict[str, object] = {}
        for path, key in KEYS.items():
            if path in self.values:
                values[path] = self.values[path]
            elif path not in self.seen and not isinstance(key.default, _schema.Presence):
                values[path] = list(key.default) if isinstance(key.default, list) else key.default
        # Not a default of the schema, since only the reader knows the file.
        values.setdefault("name", self.path.stem)
        for path, key in KEYS.items():
            needed = key.table in ALWAYS or key.table in self.tables
            if key.applies_if:
                needed = _applies(path, values)
            if key.default is _schema.REQUIRED and needed and path not in self.seen:
                self.mistake(path, f"is missing: {key.doc}. It must be {key.allowed}")
        return {path: values[path] for path in KEYS if path in values}

    def check_together(self, values: Mapping[str, object]) -> None:
        """Check what involves more than one key, among the values that are right by themselves."""
        for path in values:
            low, high = values[path], values.get(path.removesuffix("from") + "to")
            if path.endswith(".from") and isinstance(low, float) and isinstance(high, float):
                if low >= high:
                    self.mistake(path, f"got {show(low)}, must be less than `to`, {show(high)}")
        for gear in _schema.GEARS:
            table = f"{gear}.support"
            split = [key for key in ("radial_S_N_m", "radial_T_N_m") if f"{table}.{key}" in values]
            if f"{table}.radial_N_m" in values and split:
                self.mistake(f"{table}.radial_N_m", f"excludes {' and '.join(split)}. Keep one way")
        weights = [values[path] for path in values if path.startswith("optimise.minimise.")]
        if "optimise.minimise" not in values and not any(weights):
            if not any(mistake.path.startswith("optimise.minimise") for mistake in self.mistakes):
                self.mistake("optimise.minimise", "must have at least one weight > 0")
        self._check_vary(values)

    def _check_vary(self, values: Mapping[str, object]) -> None:
        """Check the keys to vary and their bounds."""
        vary = values.get("optimise.vary", [])
        assert isinstance(vary, list)
        for index, path in enumerate(vary):
            at = f"optimise.vary[{index}]"
            if path not in REAL_KEYS:
                near = _schema.nearest(path, REAL_KEYS)
                hint = f", did you mean {show(near)}?" if near else ""
                self.mistake(
                    at,
                    f"got {show(path)}, must be the path of a real-valued key that the mesh "
                    f"depends on, such as {show('flank.pinion.tip_relief.depth_um')}{hint}",
                )
            elif path in vary[:index]:
                self.mistake(at, f"{show(path)} is named twice. Keep one")
            elif path not in values and path not in self.seen:
                self.mistake(at, f"{show(path)} has no value to start from. Give it one")
        for path in REAL_KEYS:
            limits, start = values.get(f"{_BOUNDS}.{path}"), values.get(path)
            if not isinstance(limits, list):
                continue
            if limits[0] >= limits[1]:
                self.mistake(f"{_BOUNDS}.{path}", f"got {show(limits)}, must be [low, high]")
            elif path in vary and isinstance(start, float):
                if not limits[0] <= start <= limits[1]:
                    self.mistake(
                        f"{_BOUNDS}.{path}",
                        f"got {show(limits)}, must contain the starting value {show(start)} "
                        f"of {path}",
                    )


def _reading_order(mistake: Mistake) -> tuple[int, int]:
    """Sort mistakes by line; those of the file as a whole first, those of `--set` last."""
    if mistake.where.startswith(_SET):
        return 2, 0
    line = mistake.where.rpartition(":")[2]
    return (1, int(line)) if line.isdecimal() else (0, 0)


def _applies(path: str, values: Mapping[str, object]) -> bool:
    condition = KEYS[path].applies_if
    return condition is None or values.get(condition[0]) == condition[1]


def _inside(path: str) -> str:
    """List the names known in a table; for an unknown path, in the innermost table around it."""
    table = path if path in TABLES else f"{path}[]"
    while table and table not in TABLES:
        table = table.rpartition(".")[0]
    start = f"{table}." if table else ""
    names = [name.removeprefix(start) for name in (*KEYS, *TABLES) if name.startswith(start)]
    return ", ".join(dict.fromkeys(name.partition(".")[0].partition("[")[0] for name in names))


def _read_text(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        message = "there is no such file. `jaxgear init accessory` writes a ready scene"
    except IsADirectoryError:
        message = "this is a folder, a scene file (TOML) was expected"
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        message = "the file is not UTF-8 text. Save it with the encoding UTF-8"
        raise SceneError([Mistake(f"{path}:{line}", "", message)]) from None
    except OSError as error:
        message = f"the file could not be read: {error.strerror}"
    raise SceneError([Mistake(str(path), "", message)])


def _write_atomically(path: Path, text: str) -> None:
    """Write a file so that nobody ever sees half of it."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    try:
        draft.write_bytes(text.encode())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def _plain(key: str, value: object) -> object:
    """Return a value as plain Python: numbers may arrive as JAX or NumPy scalars."""
    if KEYS[key].kind == "float":
        return float(value)  # pyright: ignore[reportArgumentType]
    if KEYS[key].kind == "int":
        return int(value)  # pyright: ignore[reportArgumentType]
    if KEYS[key].kind == "floats":
        return [float(entry) for entry in value]  # pyright: ignore[reportGeneralTypeIssues]
    return value


def _put(document: dict[str, object], names: Sequence[str], value: object) -> None:
    """Set a value in nested tables, which are made where they are missing."""
    for name in names[:-1]:
        inner = document.get(name)
        if not isinstance(inner, dict):
            inner = document[name] = {}
        document = inner
    document[names[-1]] = value


def _names(document: Mapping[str, object], path: str) -> list[str]:
    """Split a dotted path; below `optimise.bounds` as the document spells it, quoted or nested."""
    if not path.startswith(_BOUNDS + "."):
        return path.split(".")
    limited = path.removeprefix(_BOUNDS + ".")
    bounds: object = document
    for name in _BOUNDS.split("."):
        bounds = bounds.get(name) if isinstance(bounds, Mapping) else None
    nested = isinstance(bounds, Mapping) and limited.partition(".")[0] in bounds
    return [*_BOUNDS.split("."), *(limited.split(".") if nested else [limited])]


def _join(prefix: str, name: str) -> str:
    """Append a name to a dotted path, in quotes where TOML would need them.

    Below `optimise.bounds` the names are paths themselves, quoted by the user or not.
    """
    if not f"{prefix}.".startswith(_BOUNDS + ".") and not _BARE.fullmatch(name):
        name = json.dumps(name, ensure_ascii=False)
    return f"{prefix}.{name}" if prefix else name


def _key_names(text: str) -> list[str]:
    """Split a TOML key, `a."b.c".d`, into its names; `ValueError` if it is not one key."""
    node: object = tomllib.loads(f"{text} = 0")
    names: list[str] = []
    while isinstance(node, dict):
        ((name, node),) = node.items()
        names.append(name)
    return names


def _positions(text: str) -> dict[str, int]:
    """Return the line, from 1, of every key, table and list entry in a valid TOML text."""
    parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_toml.language()))
    lines: dict[str, int] = {}
    rows: dict[str, int] = {}
    for node in parser.parse(text.encode()).root_node.children:
        if node.type == "pair":
            _place_pair(node, "", lines)
        elif node.type in ("table", "table_array_element"):
            line = node.start_point.row + 1
            names = _key_names(_text_of(node.named_children[0]))
            prefix = ""
            for name in names[:-1]:
                prefix = _join(prefix, name)
                lines.setdefault(prefix, line)
                if prefix in rows:
                    prefix = f"{prefix}[{rows[prefix]}]"
            prefix = _join(prefix, names[-1])
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
    names = _key_names(_text_of(node.named_children[0]))
    for name in names[:-1]:
        prefix = _join(prefix, name)
        lines.setdefault(prefix, line)
    path = _join(prefix, names[-1])
    lines[path] = line
    _place_value(node.named_children[-1], path, lines)


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
