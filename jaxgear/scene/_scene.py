"""The scene: typed tables of plain numbers, and beside them the few values that are moved.

Values stay in the units of the file. `scene.pinion.shaft.bearings[0].radial_N_m` reads one; under
flat dotted paths, where `[i]` counts rows and entries from 0, messages and searches name them.
"""

import dataclasses
import os
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from jaxgear._checks import is_traced
from jaxgear.scene._instead import is_idle, replaced_by, values_instead
from jaxgear.scene._mistakes import SET, Mistake, SceneError, in_order
from jaxgear.scene._paths import around, look_up, nested
from jaxgear.scene._positions import read_toml
from jaxgear.scene._reading import Reading
from jaxgear.scene._schema import (
    GEARS,
    REAL_KEYS,
    SHAPES_OF_BODIES,
    applies,
    general,
    of_condensed,
    parents,
    scales_body,
    shapes_body,
    shapes_teeth,
    split_entry,
)
from jaxgear.scene._table import table_of
from jaxgear.scene._tables import AbstractTables, PlainTables
from jaxgear.scene._together import mistakes_together

# How the keys end that name a file.
_OF_FILES = (
    "_csv",
    ".grid",
    *(f".superelement{part}" for part in ("", "_mass", "_nodes", "_faces")),
)
# The scenes that `jaxgear init` writes.
READY = Path(__file__).parent / "scenes"


@dataclasses.dataclass(frozen=True)
class Scene(AbstractTables):
    """A valid scene: its tables as attributes, and as flat paths, in the units of the file.

    The tables have what is moved in them; `plain` has them without.

    **Fields:**

    - `path`: the file it was read from.
    - `fixed`: plain value of every key given or with a default, by path; optional keys that are
        absent stay absent. A list of numbers is one value, a row's keys are values of their own.
    - `moved`: values that JAX traces, in place of these.
    - `given`: the keys, tables and rows that the user wrote, in the file or with `--set`.
    - `lines`: where each given key, and each entry of a list of numbers that can be varied, was
        set: `file:line` or the `--set` argument.
    - `bodies`: condensed bodies in mesh, by gear, where they have been built for this scene.
    """

    path: Path
    fixed: Mapping[str, Any]
    given: frozenset[str]
    lines: Mapping[str, str]
    moved: Mapping[str, Any] = dataclasses.field(default_factory=lambda: MappingProxyType({}))
    bodies: Mapping[str, Any] = dataclasses.field(default_factory=lambda: MappingProxyType({}))

    def __getattr__(self, name: str) -> Any:
        if name in AbstractTables.__annotations__:
            return getattr(self._tables, name)
        raise AttributeError(f"a scene has no {name}")

    @cached_property
    def _tables(self) -> PlainTables:
        return table_of(PlainTables, self.whole, self.given)

    @cached_property
    def plain(self) -> PlainTables:
        """The tables with plain numbers alone: what is moved is as it was before.

        What depends on the order of things, such as that of the stations along a shaft, is decided
        with them: it does not change while derivatives are taken.
        """
        return table_of(PlainTables, {**self.fixed, **values_instead(self.fixed)}, self.given)

    @property
    def shape_count(self) -> int:
        """Shapes by which each condensed body vibrates, 0: all."""
        helix, periods = self.plain.pair.helix_angle_deg, self.mesh.periods
        return self.model.shape_count(helix, periods, len(self.condensed))

    @property
    def at_mesh(self) -> int:
        """Combinations of what condensed bodies move that the mesh tells apart."""
        return self.model.at_mesh(self.plain.pair.helix_angle_deg, self.mesh.periods)

    @property
    def at_mesh_of_reference(self) -> int:
        """Such combinations where many modes judge few: more modes move leaning teeth in more ways.

        And where holes pass by, each tooth in another way.
        """
        short, long = ((24, 40), (40, 150))[bool(self.plain.pair.helix_angle_deg)]
        return max(self.at_mesh, long if self.mesh.periods > 1 else short)

    @cached_property
    def values(self) -> Mapping[str, Any]:
        """Every value by its path, what is moved among them."""
        return MappingProxyType({**self.fixed, **self.moved})

    @cached_property
    def whole(self) -> Mapping[str, Any]:
        """All values, of keys in whose place others are given too."""
        return {**self.values, **values_instead(self.values)}

    def value(self, path: str, default: Any = None) -> Any:
        """The value of a key, or of an entry, whose path is known at run time only.

        **Arguments:**

        - `path`: its path, such as `pinion.shaft.bearings[0].at_mm`.
        - `default`: what is returned where the key is absent.

        **Raises:**

        - `KeyError` if a scene has no such key.
        """
        return look_up(self.whole, path, default)

    @property
    def title(self) -> str:
        """What pictures of the scene are headed by."""
        return f"{self.name}, {self.pair.torque_pinion_Nm:g} N m"

    @property
    def condensed(self) -> tuple[str, ...]:
        """Gears whose body is to be condensed."""
        return tuple(gear for gear in GEARS if self.gear(gear).body.kind == "condensed")

    @property
    def files(self) -> Mapping[str, Path]:
        """The files that the scene names, under their keys."""
        named = {key: value for key, value in self.fixed.items() if key.endswith(_OF_FILES)}
        return {
            key: self.path.parent / value
            for key, value in named.items()
            if isinstance(value, str) and value
        }

    def files_from(self, folder: Path) -> dict[str, str]:
        """What the keys of its files must say in a scene that lies in another folder."""
        return {
            key: str(path) if Path(self.fixed[key]).is_absolute() else os.path.relpath(path, folder)
            for key, path in self.files.items()
        }

    def where(self, key: str) -> str:
        """Return where a key was set, for a message about it."""
        whole = self.lines.get(split_entry(key)[0], f"{self.path} (default)")
        return self.lines.get(key, whole)

    def refuse(self, mistakes: Iterable[tuple[str, str]]) -> None:
        """Refuse the scene if there are mistakes in it: keys, and what is wrong with each.

        **Raises:**

        - `SceneError` with all of them.
        """
        if found := [Mistake(self.where(key), key, words) for key, words in mistakes]:
            raise SceneError(found)

    def overridden(self) -> dict[str, object]:
        """Return what was set on the command line: keys, entries, or whole rows and lists of them.

        A row given as a whole is a dict, a list of tables a list of dicts.
        """
        found: dict[str, object] = {}
        for key, place in self.lines.items():
            if place.startswith(SET) and not any(path in found for path in around(key)):
                inside = {
                    f"x{path.removeprefix(key)}": value
                    for path, value in self.fixed.items()
                    if key in around(path)
                }
                found[key] = nested(inside)["x"] if inside else self.value(key, [])
        return found

    def replace(self, updates: Mapping[str, object]) -> "Scene":
        """Return the scene with other values, unchecked: what JAX traces is moved, the rest fixed.

        A condensed body that would be another one with the new values is left out, unless it
        follows by its scale.

        **Arguments:**

        - `updates`: path to new value, in the units of the file; the path may be that of an
            entry, `flank.pinion.pitch_error_um[3]`, of a list that is long enough.

        **Raises:**

        - `KeyError` if there is no such entry.
        """
        fixed, moved, written = dict(self.fixed), dict(self.moved), set(self.given)
        for path, new in updates.items():
            key, index = split_entry(path)
            value: Any = new
            before: Any = moved.pop(key, fixed.get(key))
            if index is not None:
                if index >= len(before or ()):
                    raise KeyError(path)
                value = [*before[:index], new, *before[index + 1 :]]
            elif isinstance(before, list):
                value = list(value)
            if not _is_moved(value):
                fixed[key] = value
            else:
                moved[key] = value
                if key in fixed:
                    fixed[key] = _as_before(value, fixed[key])
            for other in replaced_by(key) - set(updates):
                fixed.pop(other, None)
                moved.pop(other, None)
            written |= {key, *parents(key)}
        bodies = {
            gear: body
            for gear, body in self.bodies.items()
            if not any(self.remakes(key, gear) and key not in moved for key in updates)
        }
        return dataclasses.replace(
            self,
            fixed=MappingProxyType(fixed),
            moved=MappingProxyType(moved),
            given=frozenset(written),
            bodies=MappingProxyType(bodies),
        )

    def changed(self, changes: Mapping[str, object]) -> "Scene":
        """As `replace`, and without the tables whose new value is `None`.

        **Arguments:**

        - `changes`: path to new value, in the units of the file.
        """
        gone = tuple(key for key, value in changes.items() if value is None)
        left = lambda key: not any(key == table or key.startswith(f"{table}.") for table in gone)
        kept = lambda mapping: MappingProxyType({k: v for k, v in mapping.items() if left(k)})
        scene = dataclasses.replace(
            self,
            fixed=kept(self.fixed),
            given=frozenset(filter(left, self.given)),
            lines=kept(self.lines),
            moved=kept(self.moved),
        )
        return scene.replace({key: value for key, value in changes.items() if value is not None})

    def differing(self, changes: Mapping[str, object]) -> Mapping[str, object]:
        """Of changes those that the scene has not already."""
        has = lambda key, new: new is not None and self.value(key) == new
        return MappingProxyType({key: new for key, new in changes.items() if not has(key, new)})

    def remakes(self, key: str, gear: str) -> bool:
        """Say whether a condensed body would have to be made anew for another value of a key.

        Not if it follows the key by its scale, or by a family of bodies that was made for it. One
        that vibrates is another one on other shapes.
        """
        body = self.bodies.get(gear)
        if key in SHAPES_OF_BODIES:
            return getattr(body, "basis", None) is not None
        followed = getattr(body, "follows", None)
        return shapes_body(key, gear) and not scales_body(key, gear) and key != followed

    def real_keys(self) -> tuple[str, ...]:
        """Return the numbers present that the static model can be differentiated by.

        Each row and each entry counts by itself. Lists of one zero, such as the default pitch
        error, are left out, and so is what a condensed body is made from. A density counts where
        something turns.
        """
        turns = bool(self.condensed) or self.sweep.is_given
        present: dict[str, list[str]] = {}
        for key, value in {**self.values, **self.fixed}.items():
            path = general(key)
            if f"{path}[]" not in REAL_KEYS:
                present.setdefault(path, []).append(key)
            elif _is_moved(value) or value != [0.0]:
                entries = [f"{key}[{index}]" for index in range(len(value))]
                present.setdefault(f"{path}[]", []).extend(entries)
        return tuple(
            key
            for path in REAL_KEYS
            if applies(path, self.values) and (turns or not path.endswith("density_kg_m3"))
            for key in present.get(path, ())
            if not any(self.remakes(key, gear) for gear in self.condensed)
            if self.plain.mesh.tooth == "sliced" or not shapes_teeth(key)
            if all(gear in self.condensed or not of_condensed(key, gear) for gear in GEARS)
            if not is_idle(key, self.values)
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
    document, places = read_toml(path)
    reading = Reading(path, places)
    for override in overrides:
        reading.override(document, override)
    reading.walk(document)
    values = reading.complete()
    for key, message in mistakes_together(reading, values):
        reading.mistake(key, message)
    if reading.mistakes:
        raise SceneError(sorted(reading.mistakes, key=in_order))
    return Scene(
        path=path,
        fixed=MappingProxyType(values),
        given=frozenset(reading.seen),
        lines=MappingProxyType(reading.places(values)),
    )


def example_scene(name: str, overrides: Sequence[str] = ()) -> Scene:
    """Read one of the scenes that come with jaxgear: `accessory` or `power`.

    **Arguments:**

    - `name`: of the scene.
    - `overrides`: `key=value` texts, as of `--set`.

    **Raises:**

    - `SceneError` if there is no such scene, or an override is a mistake.
    """
    return read_scene(READY / f"{name}.toml", overrides)


def _is_moved(value: object) -> bool:
    """Say whether a value is traced by JAX, or is a list with a traced entry."""
    return any(map(is_traced, value if isinstance(value, list) else [value]))


def _as_before(value: Any, before: Any) -> Any:
    """A value with what is traced in it as it was before."""
    if isinstance(value, list) and isinstance(before, list) and len(value) == len(before):
        pairs = zip(value, before, strict=True)
        return [old if is_traced(new) else new for new, old in pairs]
    return before
