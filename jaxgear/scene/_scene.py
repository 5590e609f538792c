"""The scene file: read with all its mistakes at once, changed, and written back.

Values stay in the units of the file, under flat dotted paths; `[i]` counts the rows of a list of
tables, and at the end of a path the entries of a list of numbers, from 0.
"""

import dataclasses
import itertools
import json
import math
import os
import re
import tomllib
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import tree_sitter
import tree_sitter_toml

from jaxgear._checks import is_traced
from jaxgear._whole_file import write_text
from jaxgear.scene import _schema
from jaxgear.scene._assumed import assumed_bores, assumed_fillets, assumed_foundations
from jaxgear.scene._body_checks import body_mistakes
from jaxgear.scene._instead import (
    INSTEAD,
    alternatives,
    instead_mistakes,
    is_idle,
    place_of,
    replaced_by,
    value_instead,
    values_instead,
)
from jaxgear.scene._scatter_checks import robust_mistakes, scattered_key
from jaxgear.scene._schema import (
    ALWAYS,
    BY_PATH,
    GEARS,
    KEYS,
    REAL_KEYS,
    TABLES,
    general,
    of_condensed,
    scales_body,
    shapes_body,
    show,
    split_entry,
    unit_of,
)
from jaxgear.scene._slips import slips

_BARE = re.compile(r"[A-Za-z0-9_-]+")
# Quoted text, or an index outside of it.
_INDEX = re.compile(r"""("(?:[^"\\]|\\.)*"|'[^']*')|\[\s*(\d+)\s*\]""")
# The names and indices of a path.
_STEPS = re.compile(r"\[(\d+)\]|([^.\[\]]+)")
_BOUNDS, _TIES = "optimise.bounds", "optimise.ties"
_TORQUE = "pair.torque_pinion_Nm"
# Mistakes that a message lists; names that are looked for among the known ones take their time.
_LISTED = 100
# No scene is as long as this [byte]; devices have no end.
_LONGEST = 10_000_000
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
        listed = list(map(str, self.mistakes[:_LISTED]))
        more = [f"... and {count - _LISTED} more"] if count > _LISTED else []
        super().__init__("\n".join([*listed, *more, total]))


@dataclasses.dataclass(frozen=True)
class Scene:
    """A valid scene, flat: dotted path to value, in the units of the file.

    **Fields:**

    - `path`: the file it was read from.
    - `values`: every key given or with a default; optional keys that are absent stay absent. A
        list of numbers is one value, a row's keys are values of their own.
    - `given`: the keys, tables and rows that the user wrote, in the file or with `--set`.
    - `lines`: where each given key, and each entry of a list of numbers that can be varied, was
        set: `file:line` or the `--set` argument.
    - `known`: the last value that was not traced of each key that now has a traced one.
    - `bodies`: condensed bodies in mesh, by gear, where they have been built for this scene.
    """

    path: Path
    values: Mapping[str, Any]
    given: frozenset[str]
    lines: Mapping[str, str]
    known: Mapping[str, Any] = dataclasses.field(default_factory=lambda: MappingProxyType({}))
    bodies: Mapping[str, Any] = dataclasses.field(default_factory=lambda: MappingProxyType({}))

    def __getitem__(self, key: str) -> Any:
        try:
            return _look_up(self.values, key)
        except KeyError:
            return value_instead(key, self.__getitem__)

    def get(self, key: str, default: object = None) -> Any:
        """Return the value of a key, or `default` where it is absent."""
        try:
            return self[key]
        except KeyError:
            return default

    @property
    def whole(self) -> Mapping[str, Any]:
        """All values, of keys in whose place others are given too."""
        return {**self.values, **values_instead(self.values)}

    @property
    def condensed(self) -> tuple[str, ...]:
        """Gears whose body is to be condensed."""
        return tuple(gear for gear in GEARS if self.get(f"{gear}.body.kind") == "condensed")

    def has_table(self, prefix: str) -> bool:
        """Say whether the user wrote the table, even an empty one."""
        return prefix in self.given

    def rows(self, table: str) -> tuple[str, ...]:
        """Return the path of each row of a list of tables: `pinion.shaft.bearings[0]`, ..."""
        found: list[str] = []
        while (row := f"{table}[{len(found)}]") in self.given:
            found.append(row)
        return tuple(found)

    def where(self, key: str) -> str:
        """Return where a key was set, for a message about it."""
        whole = self.lines.get(split_entry(key)[0], f"{self.path} (default)")
        return self.lines.get(key, whole)

    def overridden(self) -> dict[str, object]:
        """Return what was set on the command line: keys, entries, or whole rows and lists of them.

        A row given as a whole is a dict, a list of tables a list of dicts.
        """
        found: dict[str, object] = {}
        for key, place in self.lines.items():
            if place.startswith(_SET) and not any(path in found for path in _around(key)):
                found[key] = self._whole(key)
        return found

    def replace(self, updates: Mapping[str, object]) -> "Scene":
        """Return the scene with other values, unchecked: they may be traced by JAX.

        A condensed body that would be another one with the new values is left out, unless it
        follows by its scale.

        **Arguments:**

        - `updates`: path to new value, in the units of the file; the path may be that of an
            entry, `flank.pinion.pitch_error_um[3]`, of a list that is long enough.

        **Raises:**

        - `KeyError` if there is no such entry.
        """
        values, known, written = dict(self.values), dict(self.known), set(self.given)
        for path, new in updates.items():
            key, index = split_entry(path)
            value: Any = new
            if index is None:
                value = list(value) if isinstance(values.get(key), list) else value
            else:
                _look_up(values, path)
                value = [*values[key][:index], new, *values[key][index + 1 :]]
            if _is_traced(value):
                last = _untraced(value, known.get(key, values.get(key)))
                if last is not None:
                    known[key] = last
            else:
                known.pop(key, None)
            values[key] = value
            for other in replaced_by(key) - set(updates):
                values.pop(other, None)
                known.pop(other, None)
            written |= {key, *_schema.parents(key)}
        return dataclasses.replace(
            self,
            values=MappingProxyType(values),
            given=frozenset(written),
            known=MappingProxyType(known),
            bodies=MappingProxyType(
                {
                    gear: body
                    for gear, body in self.bodies.items()
                    if not any(self.remakes(key, gear) and key not in known for key in updates)
                }
            ),
        )

    def concrete(self, key: str) -> Any:
        """Return the last value of a key, or of an entry, that was not traced by JAX.

        What depends on the order of things, such as that of the stations along a shaft, is
        decided with it: it does not change while derivatives are taken.

        **Raises:**

        - `KeyError` if the key is absent, or never had a value that was not traced.
        """
        try:
            value = _look_up(ChainMap(cast(dict, self.known), cast(dict, self.values)), key)
        except KeyError:
            value = value_instead(key, self.concrete)
        if _is_traced(value):
            raise KeyError(f"{key} never had a value that was not traced")
        return value

    def remakes(self, key: str, gear: str) -> bool:
        """Say whether a condensed body would have to be made anew for another value of a key.

        Not if it follows the key by its scale, or by a family of bodies that was made for it.
        """
        followed = getattr(self.bodies.get(gear), "follows", None)
        return shapes_body(key, gear) and not scales_body(key, gear) and key != followed

    def real_keys(self) -> tuple[str, ...]:
        """Return the numbers present that the static model can be differentiated by.

        Each row and each entry counts by itself. Lists of one zero, such as the default pitch
        error, are left out, and so is what a condensed body is made from. A density counts where
        something turns.
        """
        turns = bool(self.condensed) or self.has_table("sweep")
        present: dict[str, list[str]] = {}
        for key, value in {**self.values, **self.known}.items():
            path = general(key)
            if f"{path}[]" not in REAL_KEYS:
                present.setdefault(path, []).append(key)
            elif _is_traced(value) or value != [0.0]:
                entries = [f"{key}[{index}]" for index in range(len(value))]
                present.setdefault(f"{path}[]", []).extend(entries)
        return tuple(
            key
            for path in REAL_KEYS
            if _applies(path, self.values) and (turns or not path.endswith("density_kg_m3"))
            for key in present.get(path, ())
            if not any(self.remakes(key, gear) for gear in self.condensed)
            if all(gear in self.condensed or not of_condensed(key, gear) for gear in GEARS)
            if not is_idle(key, self.values)
        )

    def _whole(self, path: str) -> object:
        """Return the value of a key or an entry, or a row or a list of tables with all in it."""
        inside = {
            f"x{key.removeprefix(path)}": value
            for key, value in self.values.items()
            if path in _around(key)
        }
        return _nested(inside)["x"] if inside else self.get(path, [])


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
    return Scene(
        path=path,
        values=MappingProxyType(values),
        given=frozenset(reading.seen),
        lines=MappingProxyType(reading.places(values)),
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

    wanted = {
        key: _plain(key, value)
        for key, value in scene.values.items()
        if (top := key.partition(".")[0]) not in _schema.ON_REQUEST or top in scene.given
    }
    write_text(tomlkit.dumps(_nested(wanted)), Path(path))


def rewrite_scene(
    source: str | os.PathLike[str],
    updates: Mapping[str, object],
    destination: str | os.PathLike[str],
) -> None:
    """Write the user's own file with some keys changed or added, comments and order kept.

    **Arguments:**

    - `source`, `updates`: as of `rewritten`.
    - `destination`: the file to write; may be `source`.

    **Raises:**

    - `ValueError` as of `rewritten`.
    """
    write_text(rewritten(source, updates), Path(destination))


def rewritten(source: str | os.PathLike[str], updates: Mapping[str, object]) -> str:
    """Return the user's own file with some keys changed or added, comments and order kept.

    **Arguments:**

    - `source`: the scene file to start from.
    - `updates`: dotted path to new value, in the units of the file: that of a key, of an entry
        of a list of numbers, of a row (a dict) or of a whole list of tables (a list of dicts).

    **Returns:**

    The text of the new file.

    **Raises:**

    - `ValueError` if the file is laid out so that it cannot be changed and keep its comments, or
        has no such row or entry.
    """
    import tomlkit.exceptions

    text = _read_text(Path(source))
    plain: dict[str, object] = {}
    wanted = tomllib.loads(text)
    for key, value in updates.items():
        path, whole = _filled_in(wanted, key, _plain(key, value))
        try:
            _put(wanted, _steps(wanted, path), whole)
        except LookupError as error:
            raise ValueError(f"{source} has no {key} to change: {error.args[0]}.") from None
        plain[path] = whole
    # tomlkit loses its way among dotted keys and tables spread over a file, so its text is read
    # back; where one style of new table fails the other may not.
    for headers in (True, False):
        try:
            edited = _edited(text, plain, headers)
            good = tomllib.loads(edited) == wanted
        except (ValueError, LookupError, TypeError, tomlkit.exceptions.TOMLKitError):
            continue
        if good:
            return edited
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
        steps = _steps(document, key)
        inner: Any = document
        for depth, (step, after) in enumerate(itertools.pairwise(steps)):
            is_new = isinstance(step, str) and not isinstance(after, int)
            if is_new and not isinstance(inner.get(step), dict):
                header = headers and (depth == 0 or steps[:depth] == ["flank"])
                inner[step] = tomlkit.table() if header else tomlkit.inline_table()
            inner = inner[step]
        inner[steps[-1]] = _item(value, inner.get(steps[-1]) if isinstance(inner, dict) else None)
    return tomlkit.dumps(document)


def _item(value: object, old: object) -> object:
    """Return what tomlkit is given for a value that takes the place of `old`.

    Tables inside of lists are inline, unless the list is written with headers already.
    """
    import tomlkit
    import tomlkit.items

    if isinstance(value, dict):
        table = tomlkit.inline_table()
        table.update(value)
        return table
    if isinstance(value, list) and any(isinstance(row, dict) for row in value):
        if isinstance(old, tomlkit.items.AoT):
            return value
        rows = tomlkit.array()
        rows.extend(_item(row, None) for row in value)
        return rows.multiline(True)
    return value


class _Reading:
    """The state of one reading: mistakes so far, values found, and where they stand.

    `seen` has all known keys, tables and rows, `tables` the tables and rows alone, `rows` the
    number of rows of each list of tables.
    """

    def __init__(self, path: Path, lines: dict[str, str]):
        self.path = path
        self.lines = lines
        self.mistakes: list[Mistake] = []
        self.values: dict[str, object] = {}
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
        around = (self.lines[above] for above in (path, *_around(path)) if above in self.lines)
        return next(around, str(self.path))

    def places(self, values: Mapping[str, object]) -> dict[str, str]:
        """Return where each given key stands, and each entry that can be varied.

        An inline table of `--set` replaces the whole table, so its defaults are set there too. Of
        rows and lists of tables only those of `--set` are there, before the keys inside.
        """
        tables = (path for path in self.tables if split_entry(path)[1] is not None)
        found = {
            path: place
            for path in (*self.rows, *sorted(tables))
            if (place := self.where(path)).startswith(_SET)
        }
        for key, value in values.items():
            place = self.where(key)
            if key in self.seen or place.startswith(_SET):
                found[key] = place
                if f"{general(key)}[]" in REAL_KEYS and isinstance(value, list):
                    entries = [f"{key}[{index}]" for index in range(len(value))]
                    found |= {entry: self.where(entry) for entry in entries}
        return found

    def mistake(self, path: str, message: str) -> None:
        self.mistakes.append(Mistake(self.where(path), path, message))

    def override(self, document: dict[str, object], argument: str) -> None:
        """Apply one `key=value` of `--set` to the document."""
        where = f"{_SET}{argument}"
        name, equals, raw = argument.partition("=")
        try:
            steps = _key_steps(name)
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
            path = f"{path}[{step}]" if isinstance(step, int) else _join(path, step)
        if path.startswith(tuple(f"{table}." for table in BY_PATH)):
            steps = _steps(document, path)
        key, value = _filled_in(
            document, path, parsed["x"] if set(parsed) == {"x"} else raw.strip()
        )
        try:
            _put(document, steps if key == path else _steps(document, key), value)
        except LookupError as error:
            message = f"cannot be set: {error.args[0]}. Give the whole list"
            self.mistakes.append(Mistake(where, path, message))
            return
        self.lines = {
            key: place
            for key, place in self.lines.items()
            if key != path and not key.startswith((f"{path}.", f"{path}["))
        }
        self.lines[path] = where

    def walk(self, table: Mapping[str, object], prefix: str) -> None:
        """Check every key and table below `prefix`."""
        for name, value in table.items():
            path = _join(prefix, name)
            known = general(path)
            rows = value if isinstance(value, list) and f"{known}[]" in TABLES else None
            if rows is not None and all(isinstance(row, dict) for row in rows):
                self.seen.add(path)
                self.rows[path] = len(rows)
                for index, row in enumerate(rows):
                    self.seen.add(f"{path}[{index}]")
                    self.tables.add(f"{path}[{index}]")
                    self.walk(row, f"{path}[{index}]")
            elif isinstance(value, dict) and known in TABLES:
                self.seen.add(path)
                self.tables.add(path)
                self.walk(value, path)
            elif known in KEYS and "[]" not in path:
                self.seen.add(path)
                self.check(path, value)
            else:
                self.unknown(path, known, value)

    def check(self, path: str, value: object) -> None:
        """Check one known key and keep its value."""
        key = KEYS[general(path)]
        if path in self.values:
            self.mistake(path, "is given twice, in two spellings. Keep one")
            return
        try:
            self.values[path] = key.read(value)
        except ValueError as error:
            self.mistake(path, str(error))

    def unknown(self, path: str, known: str, value: object) -> None:
        """Report a name that the schema does not have in this place."""
        if len(self.mistakes) >= _LISTED:
            self.mistake(path, f"unknown, got {show(value)}")
        elif known in TABLES or f"{known}[]" in TABLES:
            what = "a table" if known in TABLES else "a list of tables"
            self.mistake(path, f"got {show(value)}, must be {what} with {_inside(known)}")
        elif isinstance(value, dict):
            near = _schema.nearest(known, sorted(TABLES))
            hint = f", did you mean [{near}]?" if near else f". Known here: {_inside(known)}"
            self.mistake(path, f"unknown table{hint}")
        else:
            near = _schema.nearest(known, (key for key in KEYS if not key.startswith(BY_PATH)))
            for table in BY_PATH:
                if known.startswith(f"{table}."):
                    near = _schema.nearest(known, (key for key in KEYS if key.startswith(table)))
                    near = near and near.replace("[]", "[0]")
            hint = f", did you mean {near}?" if near else f". Known here: {_inside(known)}"
            self.mistake(path, f"unknown key, got {show(value)}{hint}")

    def complete(self) -> dict[str, object]:
        """Return the values in the order of the schema, defaults filled in; report what misses."""
        values: dict[str, object] = {}
        places = self._instances()
        # What others stand for is neither missing nor filled in.
        told = self.seen | {target for target in INSTEAD if place_of(target, self.seen) != target}
        for path, key in places.items():
            if path in self.values:
                values[path] = self.values[path]
            elif path not in told and _has_default(key, values):
                values[path] = list(key.default) if isinstance(key.default, list) else key.default
        # Not defaults of the schema, since only the reader knows the file.
        values.setdefault("name", self.path.stem)
        for assume in (assumed_bores, assumed_foundations, assumed_fillets):
            values |= assume({**values, **values_instead(values)}, self.seen)
        for path, key in places.items():
            table = path.rpartition(".")[0]
            needed = table in ALWAYS or table in self.tables
            if key.applies_if:
                needed = _applies(path, values)
            if key.default is _schema.REQUIRED and needed and path not in told:
                words = f"is missing: {key.doc}. It must be {key.allowed}{alternatives(path)}"
                self.mistake(path, words)
        return {path: values[path] for path in places if path in values}

    def _instances(self) -> dict[str, _schema.Key]:
        """Return every key by its path, once for each row that is there."""
        given: dict[str, list[str]] = {}
        for path in self.values:
            given.setdefault(general(path), []).append(path)
        found: dict[str, _schema.Key] = {}
        for path, key in KEYS.items():
            table, index, rest = path.partition("[]")
            if path.startswith(BY_PATH):
                found |= dict.fromkeys(given.get(path, ()), key)
            elif index:
                found |= {f"{row}{rest}": key for row in self._rows(table)}
            else:
                found[path] = key
        return found

    def check_together(self, values: Mapping[str, object]) -> None:
        """Check what involves more than one key, among the values that are right by themselves."""
        for path in values:
            low, high = values[path], values.get(path.removesuffix("from") + "to")
            if path.endswith(".from") and isinstance(low, float) and isinstance(high, float):
                if low >= high:
                    self.mistake(path, f"got {show(low)}, must be less than `to`, {show(high)}")
        for path, message in instead_mistakes(values, self.seen, self.where):
            self.mistake(path, message)
        values = {**values, **values_instead(values)}
        for gear in GEARS:
            self._check_springs(f"{gear}.support", values)
            self._check_foundation(gear, values)
            self._check_pitch(gear, values)
            self._check_shaft(gear, values)
            for path, message in body_mistakes(gear, values, self.seen):
                self.mistake(path, message)
        weights = [values[path] for path in values if path.startswith("optimise.minimise.")]
        if "optimise.minimise" not in values and not any(weights):
            if not self._has_mistake("optimise.minimise"):
                self.mistake("optimise.minimise", "must have at least one weight > 0")
        self._check_vary(values)
        if "robust" in self.seen:
            faulty = self._has_mistake("robust")
            for path, message in robust_mistakes(values, self.seen, faulty=faulty):
                self.mistake(path, message)
            for path in values:
                key = scattered_key(path)
                if key in ("pair.power_kW", "pair.speed_rpm"):
                    self.mistake(path, f"gears feel its torque: let {_TORQUE} scatter")
                # Objectives are asked at torques, wherever these come from.
                elif key and key != _TORQUE and (missing := self._missing(key, values)):
                    self.mistake(path, missing)
        for slip in slips(values):
            path = place_of(slip.path, self.seen)
            if slip.impossible and not self._has_mistake(path):
                self.mistake(path, slip.message)

    def _has_mistake(self, path: str) -> bool:
        return any(mistake.path.startswith(path) for mistake in self.mistakes)

    def _check_springs(self, table: str, values: Mapping[str, object]) -> None:
        """Check that a stiffness is given in one way: for all directions, or for each."""
        for both, one in (("radial_N_m", "radial_{}_N_m"), ("tilt_Nm_rad", "tilt_{}_Nm_rad")):
            split = [name for name in map(one.format, "ST") if f"{table}.{name}" in values]
            if f"{table}.{both}" in values and split:
                self.mistake(f"{table}.{both}", f"excludes {' and '.join(split)}. Keep one way")

    def _check_foundation(self, gear: str, values: Mapping[str, object]) -> None:
        """Check that a foundation that was asked for has the bore that it needs."""
        own, bore = f"{gear}.foundation", f"{gear}.bore_mm"
        path = own if own in self.seen else "mesh.foundation"
        bored = values.get(bore) if bore in values else bore in self.seen
        if path in self.seen and values.get(path) in ("ring", "sainsot") and not bored:
            self.mistake(
                path,
                f"got {show(values[path])}, which needs the bore where the body is clamped: give "
                f"{bore} a value > 0, or write {own} = {show('weber')}",
            )

    def _check_pitch(self, gear: str, values: Mapping[str, object]) -> None:
        """Check that a pitch error has one value, or one for each tooth."""
        path, teeth = f"flank.{gear}.pitch_error_um", values.get(f"{gear}.teeth")
        errors = values.get(path)
        if isinstance(errors, list) and teeth is not None and len(errors) not in (1, teeth):
            self.mistake(
                path,
                f"got {len(errors)} values, must be 1 or {teeth}, one for each of {gear}.teeth",
            )

    def _check_shaft(self, gear: str, values: Mapping[str, object]) -> None:
        """Check that a shaft is whole, that what is on it is on it, and that a beam has one."""
        table = f"{gear}.shaft"
        if table not in self.tables:
            if values.get(f"{gear}.body.kind") == "beam" and not self._has_mistake(table):
                self.mistake(
                    f"{gear}.body.kind",
                    f"got {show('beam')}, but there is no [{table}] whose beam the body could be. "
                    f"Add it, or write {show('rigid')}",
                )
            return
        if f"{gear}.support" in self.tables:
            self.mistake(
                f"{gear}.support", f"excludes {table}, whose bearings hold the gear. Keep one"
            )
        for path in (f"{table}.segments", f"{table}.bearings"):
            if not self.rows.get(path) and not self._has_mistake(path):
                self.mistake(path, "is missing: a shaft needs at least one row of it")
        for bearing in self._rows(f"{table}.bearings"):
            self._check_springs(bearing, values)
        self._check_stations(table, values)

    def _rows(self, table: str) -> list[str]:
        """Return the path of each row of a list of tables."""
        return [f"{table}[{row}]" for row in range(self.rows.get(table, 0))]

    def _check_stations(self, table: str, values: Mapping[str, object]) -> None:
        """Check that the segments of a shaft have walls, and that nothing is beyond its end."""
        segments = self._rows(f"{table}.segments")
        for segment in segments:
            inner, outer = values.get(f"{segment}.inner_mm"), values.get(f"{segment}.outer_mm")
            if isinstance(inner, float) and isinstance(outer, float) and inner >= outer:
                self.mistake(
                    f"{segment}.inner_mm",
                    f"got {show(inner)}, must be less than outer_mm, {show(outer)}",
                )
        lengths = [values.get(f"{segment}.length_mm") for segment in segments]
        known = [length for length in lengths if isinstance(length, float)]
        if not known or known != lengths:
            return
        end = math.fsum(known)
        rows = (*self._rows(f"{table}.bearings"), *self._rows(f"{table}.loads"))
        for path in (f"{table}.gear_at_mm", f"{table}.torque_at_mm", *(f"{r}.at_mm" for r in rows)):
            at = values.get(path)
            # The sum may be rounded below the end that the user wrote.
            if isinstance(at, float) and at > end * (1.0 + 1e-9):
                self.mistake(
                    path,
                    f"got {show(at)}, which is beyond the end of the shaft: the length_mm of "
                    f"{table}.segments add up to {end:g}",
                )

    def _check_vary(self, values: Mapping[str, object]) -> None:
        """Check the keys to vary and their bounds."""
        vary = values.get("optimise.vary", [])
        assert isinstance(vary, list)
        for index, path in enumerate(vary):
            at = f"optimise.vary[{index}]"
            if "[]" in path or general(path) not in REAL_KEYS:
                near = _schema.nearest(general(path), REAL_KEYS)
                hint = f", did you mean {show(near.replace('[]', '[0]'))}?" if near else ""
                self.mistake(
                    at,
                    f"got {show(path)}, must be the path of a real-valued key that the mesh "
                    f"depends on, such as {show('flank.pinion.tip_relief.depth_um')}{hint}",
                )
            elif path in vary[:index]:
                self.mistake(at, f"{show(path)} is named twice. Keep one")
            elif missing := self._missing(path, values):
                self.mistake(at, f"{show(path)} {missing}")
        for path, limits in values.items():
            key = path.removeprefix(f"{_BOUNDS}.")
            if key == path or not isinstance(limits, list):
                continue
            if limits[0] >= limits[1]:
                self.mistake(path, f"got {show(limits)}, must be [low, high], low below high")
            elif key in vary and not self._missing(key, values):
                start = _find(values, key)
                if isinstance(start, float) and not limits[0] <= start <= limits[1]:
                    self.mistake(
                        path,
                        f"got {show(limits)}, must contain the starting value {show(start)} "
                        f"of {key}",
                    )
            elif "[" in key and (missing := self._missing(key, values)):
                self.mistake(path, missing)
        for path, owner in values.items():
            key = path.removeprefix(f"{_TIES}.")
            if key == path:
                continue
            if owner not in vary:
                self.mistake(path, f"got {show(owner)}, must be one of optimise.vary")
            elif key in vary:
                self.mistake(path, "is in optimise.vary itself. Keep one")
            elif missing := self._missing(key, values):
                self.mistake(path, missing)
            elif unit_of(key) != unit_of(str(owner)):
                self.mistake(
                    path,
                    f"got {show(owner)} in {unit_of(str(owner)) or 'no unit'}, must be a number in "
                    f"{unit_of(key) or 'no unit'}",
                )

    def _missing(self, path: str, values: Mapping[str, object]) -> str:
        """Say what is not there of a key, row or entry that is named; empty where all is."""
        for place in (path, *_around(path)):
            above, index = split_entry(place)
            if index is None or self._has_mistake(above):
                continue
            entries = values.get(above)
            count = self.rows.get(above, len(entries) if isinstance(entries, list) else 0)
            if index >= count:
                return f"names number {index} of {above}, which has {count}, counted from 0"
        key, _ = split_entry(path)
        if (other := place_of(key, self.seen)) != key:
            return f"is given by {other} ({self.where(other)}). Name that one"
        return (
            "" if key in values or key in self.seen else "has no value to start from. Give it one"
        )


def _reading_order(mistake: Mistake) -> tuple[int, int]:
    """Sort mistakes by line; those of the file as a whole first, those of `--set` last."""
    if mistake.where.startswith(_SET):
        return 2, 0
    line = mistake.where.rpartition(":")[2]
    return (1, int(line)) if line.isdecimal() else (0, 0)


def _has_default(key: _schema.Key, values: Mapping[str, object]) -> bool:
    """Say whether an absent key is filled in, next to the values before it."""
    if isinstance(key.default, _schema.Presence):
        return False
    return key.default_if is None or values.get(key.default_if[0]) == key.default_if[1]


def _applies(path: str, values: Mapping[str, object]) -> bool:
    condition = KEYS[general(path).removesuffix("[]")].applies_if
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
        with path.open("rb") as file:
            content = file.read(_LONGEST + 1)
        if len(content) <= _LONGEST:
            return content.decode("utf-8-sig")
        message = f"the file is longer than {_LONGEST:,} bytes: it is no scene"
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


def _plain(key: str, value: object) -> object:
    """Return a value as plain Python: numbers may arrive as JAX or NumPy scalars."""
    whole, index = split_entry(key)
    # Rows and lists of tables come from a scene that was read, so they are plain.
    kind = KEYS[general(whole)].kind if general(whole) in KEYS else "text"
    if kind == "float" or (kind == "floats" and index is not None):
        return float(value)  # pyright: ignore[reportArgumentType]
    if kind == "int":
        return int(value)  # pyright: ignore[reportArgumentType]
    if kind == "floats":
        return [float(entry) for entry in value]  # pyright: ignore[reportGeneralTypeIssues]
    return value


def _put(document: dict[str, object], steps: Sequence[str | int], value: object) -> None:
    """Set a value in nested tables, which are made where they are missing, and in lists.

    **Raises:**

    - `LookupError` if a list is missing or too short.
    """
    inner: Any = document
    for step, after in itertools.pairwise(steps):
        held = inner.get(step) if isinstance(step, str) else inner[step]
        if isinstance(after, int):
            if not isinstance(held, list):
                raise LookupError(f"there is no list {step}")
            if after >= len(held):
                raise LookupError(f"{step} has {len(held)} entries, counted from 0")
        elif not isinstance(held, dict):
            held = inner[step] = {}
        inner = held
    inner[steps[-1]] = value


def _nested(values: Mapping[str, object]) -> dict[str, Any]:
    """Return values under flat paths as nested tables and lists of tables."""
    root: dict[str, Any] = {}
    for path, value in values.items():
        inner: Any = root
        steps = _steps({}, path)
        for step, after in itertools.pairwise(steps):
            if isinstance(step, str):
                inner = inner.setdefault(step, [] if isinstance(after, int) else {})
            else:
                inner += [{} for _ in range(step + 1 - len(inner))]
                inner = inner[step]
        inner[steps[-1]] = value
    return root


def _steps(document: Mapping[str, Any], path: str) -> list[str | int]:
    """Split a path into names and indices.

    Below the tables of `BY_PATH` the path of the other key is split as the document
    spells it: one quoted name, which it is made where it is new, or nested tables.
    """
    for table in BY_PATH:
        if path.startswith(f"{table}."):
            names = table.split(".")
            inner: object = document
            for name in names:
                inner = inner.get(name) if isinstance(inner, Mapping) else None
            other = path.removeprefix(f"{table}.")
            return [*names, *(_spelled(inner, other) or [other])]
    return [int(index) if index else name for index, name in _STEPS.findall(path)]


def _spelled(table: object, path: str) -> list[str | int]:
    """Split a path as the table spells it; empty where not even its beginning is in there."""
    if not isinstance(table, Mapping):
        return []
    parts = path.split(".")
    for end in range(len(parts), 0, -1):
        name, rest = ".".join(parts[:end]), parts[end:]
        row, index = split_entry(name)
        if name in table:
            return [name, *(_spelled(table[name], ".".join(rest)) or rest)]
        if index is not None and isinstance(table.get(row), list):
            return [row, index, *rest]
    return []


def _filled_in(document: Mapping[str, Any], path: str, value: object) -> tuple[str, object]:
    """Return the path and the value; for an entry of a list left to its default the whole list."""
    whole, index = split_entry(path)
    default = KEYS[general(whole)].default if general(whole) in KEYS else None
    if index is None or not isinstance(default, list) or index >= len(default):
        return path, value
    inner: Any = document
    for step in _steps(document, whole):
        try:
            inner = inner[step]
        except (LookupError, TypeError):
            return whole, [*default[:index], value, *default[index + 1 :]]
    return path, value


def _look_up(values: Mapping[str, Any], path: str) -> Any:
    """Return the value of a key or of an entry of a list; `KeyError` where there is none."""
    if path in values:
        return values[path]
    key, index = split_entry(path)
    entries = values.get(key)
    if index is None or not isinstance(entries, list) or index >= len(entries):
        raise KeyError(path)
    return entries[index]


def _find(values: Mapping[str, Any], path: str) -> Any:
    """Return the value of a key or of an entry, or `None` where there is none."""
    try:
        return _look_up(values, path)
    except KeyError:
        return None


def _around(path: str) -> Iterator[str]:
    """Yield what is around a path, innermost first: of `a.b[0].c` that is `a.b[0]`, `a.b`, `a`."""
    while path := path[: max(path.rfind("."), path.rfind("["), 0)]:
        yield path


def _is_traced(value: object) -> bool:
    """Say whether a value is traced by JAX, or is a list with a traced entry."""
    return any(map(is_traced, value if isinstance(value, list) else [value]))


def _untraced(value: object, before: object) -> object:
    """Return a value with what is traced in it as it was before; `None` if that is not known."""
    if isinstance(value, list) and isinstance(before, list):
        if len(value) == len(before):
            pairs = zip(value, before, strict=True)
            before = [old if _is_traced(new) else new for new, old in pairs]
    return None if _is_traced(before) else before


def _join(prefix: str, name: str) -> str:
    """Append a name to a dotted path, in quotes where TOML would need them.

    Below the tables of `BY_PATH` the names are paths themselves, quoted or not.
    """
    by_path = f"{prefix}.".startswith(tuple(f"{table}." for table in BY_PATH))
    if not by_path and not _BARE.fullmatch(name):
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


def _key_steps(text: str) -> list[str | int]:
    """Split a TOML key that may have indices, `a."b.c"[0].d`; `ValueError` if it is not one."""
    steps: list[str | int] = []
    start = 0
    indices = [found for found in _INDEX.finditer(text) if found[2]]
    for found in (*indices, None):
        names = text[start : found.start() if found else None].strip()
        if steps and names:
            if not names.startswith("."):
                raise ValueError(f"{names} follows an index without a point")
            names = names[1:]
        if names or not steps:
            steps += _key_names(names)
        if found:
            steps.append(int(found[2]))
            start = found.end()
    return steps


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
    # A comment behind the value is in the pair.
    key, value = (child for child in node.named_children if child.type != "comment")
    names = _key_names(_text_of(key))
    for name in names[:-1]:
        prefix = _join(prefix, name)
        lines.setdefault(prefix, line)
    path = _join(prefix, names[-1])
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
