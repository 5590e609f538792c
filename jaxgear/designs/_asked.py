"""A study file: read, and checked against the scene that it is about."""

import dataclasses
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from jaxgear.designs._keys import BY_PATH, KEYS, TABLES, StudyKeys
from jaxgear.designs._slopes import reason_against
from jaxgear.scene._gear_tables import BodyKeys
from jaxgear.scene._key import REQUIRED, Presence, show
from jaxgear.scene._mistakes import Mistake, SceneError, in_order
from jaxgear.scene._paths import join
from jaxgear.scene._positions import read_toml
from jaxgear.scene._scene import READY, Scene, read_scene
from jaxgear.scene._schema import KEYS as SCENE_KEYS
from jaxgear.scene._schema import key_at, nearest, split_entry
from jaxgear.scene._table import table_of
from jaxgear.scene._tables import DampingKeys


@dataclasses.dataclass(frozen=True)
class Study:
    """A valid study: what it asks for, and the scene that it is about.

    **Fields:**

    - `path`: the file it was read from.
    - `scene`: whose designs these are.
    - `values`: every value of the file by path, with defaults.
    - `asked`: the same, as tables.
    - `lines`: where each key stands: `file:line`.
    """

    path: Path
    scene: Scene
    values: Mapping[str, Any]
    asked: StudyKeys
    lines: Mapping[str, str]

    @property
    def name(self) -> str:
        """What its folder of results is called."""
        return self.asked.name or self.path.stem

    @property
    def chunk(self) -> int:
        """Designs in one file of results."""
        return self.asked.work.chunk or (256 if self.asked.command == "run" else 1)

    def where(self, key: str) -> str:
        """Where a key stands, for a message about it."""
        return self.lines.get(key, str(self.path))


def read_study(path: str | os.PathLike[str]) -> Study:
    """Read a study file, and the scene that it names.

    **Arguments:**

    - `path`: the TOML file.

    **Raises:**

    - `SceneError` with every mistake found, in the study or else in its scene.
    """
    path = Path(path)
    if not path.exists():
        words = "there is no such file. `jaxgear init accessory-tolerances` writes an example study"
        raise SceneError([Mistake(str(path), "", words)])
    document, places = read_toml(path)
    values: dict[str, Any] = {}
    lines: dict[str, str] = {}
    mistakes: list[Mistake] = []
    given = {"", *_tables(document)}
    for key, written, value in _leaves(document, "", ""):
        lines[key] = places.get(written, str(path))
        given.add(key)
        try:
            values[key] = _read(key, value)
        except ValueError as error:
            mistakes.append(Mistake(lines[key], key, str(error)))
    for key, rule in KEYS.items():
        if rule.default is REQUIRED and key not in given:
            mistakes.append(Mistake(str(path), key, f"is missing: {rule.doc}"))
        elif not isinstance(rule.default, Presence):
            values.setdefault(key, rule.default)
    if mistakes:
        raise SceneError(sorted(mistakes, key=in_order))
    asked = table_of(StudyKeys, values, given)
    scene = read_scene(_scene_path(path, asked.scene, lines["scene"]), asked.set)
    study = Study(path, scene, MappingProxyType(values), asked, MappingProxyType(lines))
    if found := [Mistake(study.where(key), key, words) for key, words in _together(study)]:
        raise SceneError(sorted(found, key=in_order))
    return study


def _tables(document: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Paths of all tables."""
    for name, value in document.items():
        if isinstance(value, dict):
            path = f"{prefix}{name}"
            yield path
            yield from _tables(value, f"{path}.")


def _leaves(table: Mapping[str, Any], prefix: str, written: str) -> Iterator[tuple[str, str, Any]]:
    """Keys with their values, and as the file spells them: names of scene keys may be quoted."""
    for name, value in table.items():
        path, spelled = f"{prefix}{name}", join(written, name)
        if isinstance(value, dict) and (path in TABLES or path.startswith(_BELOW)):
            yield from _leaves(value, f"{path}.", spelled)
        else:
            yield path, spelled, value


_BELOW = tuple(f"{table}." for table in BY_PATH)


def _read(path: str, value: Any) -> Any:
    """A value in its type; `ValueError` says what is wrong with it, or with its key."""
    if path in KEYS:
        return KEYS[path].read(value)
    table = next((each for each in BY_PATH if path.startswith(f"{each}.")), "")
    if not table:
        near = nearest(path, KEYS)
        raise ValueError(
            f"unknown key, got {show(value)}" + (f"; did you mean {near}?" if near else "")
        )
    name = path.removeprefix(f"{table}.")
    rule = key_at(name)
    if rule is None:
        near = nearest(name, SCENE_KEYS)
        raise ValueError("no scene has such a key" + (f"; did you mean {near}?" if near else ""))
    return _amounts(table.rpartition(".")[2], name, value)


def _amounts(table: str, name: str, value: Any) -> Any:
    """Bounds, values or scatter of a key of the scene."""
    rule, number = key_at(name), (int, float)
    assert rule is not None
    is_number = lambda x: isinstance(x, number) and not isinstance(x, bool) and math.isfinite(x)
    if table in ("scatter", "even"):
        if not is_number(value) or value <= 0.0:
            raise ValueError(f"got {show(value)}, must be a number > 0")
        return float(value)
    if table == "values":
        if not isinstance(value, list) or not value:
            raise ValueError(f"got {show(value)}, must be a list of values")
        return [read_value(name, each) for each in value]
    if not (isinstance(value, list) and len(value) == 2 and all(map(is_number, value))):
        raise ValueError(f"got {show(value)}, must be two finite numbers: lowest and highest value")
    low, high = (read_value(name, each) for each in value)
    if low >= high:
        raise ValueError(
            f"got {show(value)}, whose first must be less than the second: write "
            f"[{value[1]:g}, {value[0]:g}]"
            if low > high
            else f"got {show(value)}, which are equal: a key that stays belongs into the scene"
        )
    return [low, high]


def read_value(name: str, value: Any) -> Any:
    """A value of a key of a scene, or of an entry of a list, in its type.

    **Arguments:**

    - `name`: path of the key.
    - `value`: from a file.

    **Raises:**

    - `ValueError` that says what it must be.
    """
    rule = key_at(name)
    assert rule is not None
    if rule.kind == "floats" and not isinstance(value, list):
        return rule.read([value])[0]
    return rule.read(value)


def _scene_path(path: Path, named: str, where: str) -> Path:
    """The file of a scene: beside the study, or a ready one."""
    own, ready = path.parent / named, READY / f"{named}.toml"
    if own.exists():
        return own
    if ready.is_file():
        return ready
    near = nearest(named, sorted(each.stem for each in READY.glob("*.toml")))
    words = f"got {show(named)}, which is no file beside the study and no example scene"
    words += f"; did you mean {near}?" if near else ""
    raise SceneError([Mistake(where, "scene", words)])


# What each kind of table of designs takes; the first of them is what it is about.
_TAKES = {
    "sobol": ("between", "values", "scatter", "even"),
    "lhs": ("between", "values", "scatter", "even"),
    "random": ("between", "values", "scatter", "even"),
    "grid": ("between", "values"),
    "one-at-a-time": ("between", "values", "scatter", "even"),
}


class Varied(NamedTuple):
    """A key of the scene that a study varies, and the table of the study that says how."""

    key: str
    table: str

    @property
    def path(self) -> str:
        """Where it stands in the study."""
        return f"{self.table}.{self.key}"


def varied_of(values: Mapping[str, Any]) -> list[Varied]:
    """The keys of the scene that a study varies, in the order of the file."""
    return [
        Varied(path.removeprefix(f"{table}."), table)
        for path in values
        for table in BY_PATH
        if path.startswith(f"{table}.")
    ]


def _together(study: Study) -> Iterator[tuple[str, str]]:
    """What is wrong with keys that are right by themselves."""
    asked, design = study.asked, study.asked.design
    named = varied_of(study.values)
    if design.csv is not None:
        for path in (
            *(each.path for each in named),
            *(f"design.{each}" for each in design.written("kind", "points")),
        ):
            yield path, "goes without design.csv, which names all designs. Remove one"
    elif not named:
        yield "design", "nothing varies. Write [design.between] with keys and bounds, or csv"
    seen: dict[str, str] = {}
    for each in named:
        if each.key in seen:
            yield each.path, f"stands in [{seen[each.key]}] too. Keep one"
        seen[each.key] = each.table
        if each.table.rpartition(".")[2] not in _TAKES[design.kind]:
            yield each.path, f'goes without design.kind = "{design.kind}". Give bounds or values'
        yield from ((each.path, words) for words in _at_scene(study.scene, *each))
    count = design.points
    if design.csv is None and count is None and design.kind in ("sobol", "lhs", "random"):
        yield "design.points", "is missing: the number of designs"
    if design.kind in ("grid", "one-at-a-time") and count is not None and count < 2:
        yield "design.points", f"got {count}, must be 2 or more values of each key"
    if asked.work.engine == "dask" and asked.work.scheduler is None:
        yield "work.scheduler", "is missing: the address of a Dask scheduler, tcp://node:8786"
    if asked.keep.gradients and asked.command == "optimise":
        words = 'an optimum has none here. Write command = "run", or gradients = false'
        yield "keep.gradients", f"got true, but {words}"
    elif asked.keep.gradients and asked.command != "run":
        scene = study.scene
        in_pairs = _in_pairs(scene.damping, [scene.gear(gear).body for gear in scene.condensed])
        given = scene.sweep, asked.command, asked.keep.numbers
        if words := reason_against(*given, in_pairs=in_pairs):
            yield "keep.gradients", f"got true, but {words}"
    for name in asked.keep.minimise:
        if name not in asked.keep.numbers:
            yield "keep.minimise", f"{name} must be one of keep.numbers"
    if not asked.keep.numbers:
        yield "keep.numbers", "must name a number at least, such as static.te_rms_um"


def _in_pairs(damping: DampingKeys, bodies: Iterable[BodyKeys]) -> bool:
    """Whether modes of condensed bodies, as often the same around, are damped by unequal ratios."""
    alike = [body for body in bodies if body.grid is None and body.superelement is None]
    return bool(alike) and damping.kind == "modal" and damping.mesh != damping.structure


def _at_scene(scene: Scene, name: str, table: str) -> Iterator[str]:
    """What keeps a key of this very scene from being varied."""
    rule = key_at(name)
    assert rule is not None
    whole, index = split_entry(name)
    try:
        value = scene.value(name)
    except KeyError:
        value = None
    if value is None and (index is not None or "[" in name):
        rows = scene.value(whole, []) if index is not None else []
        yield f"the scene has no such entry: {whole} has {len(rows or ())}, counted from 0"
    elif table in ("design.scatter", "design.even") and value is None:
        yield "has no value in the scene to scatter about. Give it one"
    elif table != "design.values" and rule.kind not in ("float", "floats", "int"):
        yield "is no number: list what it may be in [design.values]"
