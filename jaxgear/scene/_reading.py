"""One reading of a scene: every key against the schema, `--set` applied, defaults filled in."""

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from jaxgear.scene import _schema
from jaxgear.scene._assumed import assumed_bores, assumed_fillets, assumed_foundations
from jaxgear.scene._instead import INSTEAD, alternatives, place_of, values_instead
from jaxgear.scene._key import REQUIRED, Key, Presence, show
from jaxgear.scene._mistakes import LISTED, SET, Mistake
from jaxgear.scene._paths import around, filled_in, join, key_steps, put, steps_of
from jaxgear.scene._schema import (
    ALWAYS,
    BY_PATH,
    GEARS,
    KEYS,
    REAL_KEYS,
    TABLES,
    applies,
    general,
    split_entry,
)
from jaxgear.scene._table import table_of
from jaxgear.scene._tables import PlainTables

_COAST = tuple(f"flank.{gear}_coast" for gear in GEARS)


class Reading:
    """The state of one reading: mistakes so far, values found, and where they stand.

    `seen` has all known keys, tables and rows, `tables` the tables and rows alone, `rows` the
    number of rows of each list of tables.
    """

    def __init__(self, path: Path, lines: dict[str, str]):
        self.path = path
        self.lines = lines
        self.mistakes: list[Mistake] = []
        self.values: dict[str, Any] = {}
        self.seen: set[str] = set()
        self.tables: set[str] = set()
        self.rows: dict[str, int] = {}

    def where(self, path: str) -> str:
        """Return the place of a key, or of the innermost table around it, or the file.

        A table that is there only because of a key of `--set` stands where the key does.
        """
        if path not in self.lines:
            inside = (place for key, place in self.lines.items() if key.startswith(f"{path}."))
            if place := next(inside, None):
                return place
        near = (self.lines[above] for above in (path, *around(path)) if above in self.lines)
        return next(near, str(self.path))

    def places(self, values: Mapping[str, Any]) -> dict[str, str]:
        """Return where each given key stands, and each entry that can be varied.

        An inline table of `--set` replaces the whole table, so its defaults are set there too. Of
        rows and lists of tables only those of `--set` are there, before the keys inside.
        """
        tables = sorted(path for path in self.tables if split_entry(path)[1] is not None)
        places = {path: self.where(path) for path in (*self.rows, *tables)}
        found = {path: place for path, place in places.items() if place.startswith(SET)}
        for key, value in values.items():
            place = self.where(key)
            if key in self.seen or place.startswith(SET):
                found[key] = place
                if f"{general(key)}[]" in REAL_KEYS and isinstance(value, list):
                    entries = [f"{key}[{index}]" for index in range(len(value))]
                    found |= {entry: self.where(entry) for entry in entries}
        return found

    def mistake(self, path: str, message: str) -> None:
        """Note a mistake."""
        self.mistakes.append(Mistake(self.where(path), path, message))

    def refused(self, path: str) -> bool:
        """Say whether a mistake of a key, or of one in the table, has been noted."""
        return any(mistake.path.startswith(path) for mistake in self.mistakes)

    def override(self, document: dict[str, Any], argument: str) -> None:
        """Apply one `key=value` of `--set` to the document."""
        where = f"{SET}{argument}"
        name, equals, raw = argument.partition("=")
        try:
            steps = key_steps(name)
        except ValueError:
            steps = []
        if not equals or not steps:
            message = "must be key=value, for example pair.torque_pinion_Nm=120"
            self.mistakes.append(Mistake(where, "", message))
            return
        try:
            parsed = tomllib.loads(f"x = {raw}")
        except ValueError:
            parsed = {}
        path = ""
        for step in steps:
            path = f"{path}[{step}]" if isinstance(step, int) else join(path, step)
        if path.startswith(tuple(f"{table}." for table in BY_PATH)):
            steps = steps_of(document, path)
        value = parsed["x"] if set(parsed) == {"x"} else raw.strip()
        key, value = filled_in(document, path, value)
        try:
            put(document, steps if key == path else steps_of(document, key), value)
        except LookupError as error:
            message = f"cannot be set: {error.args[0]}. Give the whole list"
            self.mistakes.append(Mistake(where, path, message))
            return
        inside = (f"{path}.", f"{path}[")
        lines = self.lines.items()
        self.lines = {k: place for k, place in lines if k != path and not k.startswith(inside)}
        self.lines[path] = where

    def walk(self, table: Mapping[str, Any], prefix: str = "") -> None:
        """Check every key and table below `prefix`."""
        for name, value in table.items():
            path = join(prefix, name)
            known = general(path)
            rows = value if isinstance(value, list) and f"{known}[]" in TABLES else None
            if rows is not None and all(isinstance(row, dict) for row in rows):
                self.seen.add(path)
                self.rows[path] = len(rows)
                for index, row in enumerate(rows):
                    self._enter(row, f"{path}[{index}]")
            elif isinstance(value, dict) and known in TABLES:
                self._enter(value, path)
            elif known in KEYS and "[]" not in path:
                self.seen.add(path)
                self._check(path, value)
            else:
                self._unknown(path, known, value)

    def _enter(self, table: Mapping[str, Any], path: str) -> None:
        self.seen.add(path)
        self.tables.add(path)
        self.walk(table, path)

    def _check(self, path: str, value: object) -> None:
        """Check one known key and keep its value."""
        if path in self.values:
            self.mistake(path, "is given twice, in two spellings. Keep one")
            return
        try:
            self.values[path] = KEYS[general(path)].read(value)
        except ValueError as error:
            self.mistake(path, str(error))

    def _unknown(self, path: str, known: str, value: object) -> None:
        """Report a name that the schema does not have in this place."""
        if len(self.mistakes) >= LISTED:
            self.mistake(path, f"unknown, got {show(value)}")
            return
        if known in TABLES or f"{known}[]" in TABLES:
            what = "a table" if known in TABLES else "a list of tables"
            self.mistake(path, f"got {show(value)}, must be {what} with {_inside(known)}")
            return
        table = next((each for each in BY_PATH if known.startswith(f"{each}.")), "")
        if isinstance(value, dict):
            near = _schema.nearest(known, sorted(TABLES))
            said, meant = "unknown table", f"[{near}]"
        else:
            keys = (
                k for k in KEYS if (k.startswith(table) if table else not k.startswith(BY_PATH))
            )
            near = _schema.nearest(known, keys)
            meant = near and near.replace("[]", "[0]") if table else near
            said = f"unknown key, got {show(value)}"
        hint = f", did you mean {meant}?" if near else f". Known here: {_inside(known)}"
        self.mistake(path, f"{said}{hint}")

    def complete(self) -> dict[str, Any]:
        """Return the values in the order of the schema, defaults filled in; report what misses."""
        values: dict[str, Any] = {}
        places = dict(self._instances())
        # What others stand for is neither missing nor filled in.
        coast = {path.removeprefix("flank.") for path in self.seen if path in _COAST}
        told = self.seen | {target for target in INSTEAD if place_of(target, self.seen) != target}
        for path, key in places.items():
            if path in self.values:
                values[path] = self.values[path]
            elif path.startswith(_COAST) and path.split(".")[1] not in coast:
                # Coast flanks that nobody gives are those of the drive side.
                continue
            elif path not in told and _has_default(key, values):
                values[path] = list(key.default) if isinstance(key.default, list) else key.default
        # Not defaults of the schema, since only the reader knows the file.
        values.setdefault("name", self.path.stem)
        for assume in (assumed_bores, assumed_foundations, assumed_fillets):
            whole = {**values, **values_instead(values)}
            values |= assume(table_of(PlainTables, whole, self.seen), self.seen)
        for path, key in places.items():
            table = path.rpartition(".")[0]
            needed = table in ALWAYS or table in self.tables
            if key.applies_if:
                needed = applies(path, values)
            if key.default is REQUIRED and needed and path not in told:
                words = f"is missing: {key.doc}. It must be {key.allowed}{alternatives(path)}"
                self.mistake(path, words)
        return {path: values[path] for path in places if path in values}

    def _instances(self) -> Iterator[tuple[str, Key]]:
        """Every key by its path, once for each row that is there."""
        given: dict[str, list[str]] = {}
        for path in self.values:
            given.setdefault(general(path), []).append(path)
        for path, key in KEYS.items():
            table, index, rest = path.partition("[]")
            if path.startswith(BY_PATH):
                yield from ((each, key) for each in given.get(path, ()))
            elif index:
                for row in range(self.rows.get(table, 0)):
                    yield f"{table}[{row}]{rest}", key
            else:
                yield path, key


def _has_default(key: Key, values: Mapping[str, Any]) -> bool:
    """Say whether an absent key is filled in, next to the values before it."""
    if isinstance(key.default, Presence):
        return False
    return key.default_if is None or values.get(key.default_if[0]) == key.default_if[1]


def _inside(path: str) -> str:
    """List the names known in a table; for an unknown path, in the innermost table around it."""
    table = path if path in TABLES else f"{path}[]"
    while table and table not in TABLES:
        table = table.rpartition(".")[0]
    start = f"{table}." if table else ""
    names = [name.removeprefix(start) for name in KEYS if name.startswith(start)]
    return ", ".join(dict.fromkeys(name.partition(".")[0].partition("[")[0] for name in names))
