"""A chunk of designs, computed: a dataset with a row for each, and a reason where there is none."""

import dataclasses
import functools
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from jaxgear import study as studies
from jaxgear._checks import require
from jaxgear.designs._asked import Study
from jaxgear.designs._numbers import ARRAYS, PLACES, arrays_in, number_in, require_known
from jaxgear.designs._slopes import SeenResponses, Slopes, seen_of
from jaxgear.designs._table import DesignTable, unfit
from jaxgear.designs._together import (
    Found,
    Shape,
    called,
    goes_together,
    is_light,
    programs_of,
    shape_at,
    shape_of,
)
from jaxgear.scene._key import show
from jaxgear.scene._mistakes import SceneError
from jaxgear.scene._scene import Scene, read_scene
from jaxgear.scene._schema import key_at
from jaxgear.study._built import BuiltScene, built_scene
from jaxgear.study._results import unit_of_name
from jaxgear.study._statics import SolverFailure, require_bearable, require_solved
from jaxgear.study._steady import damping_keys

# What is wrong with one design is no reason to stop. Errors of bodies and of input are among them.
_OF_ONE = (ValueError, SceneError, SolverFailure, FloatingPointError)

Row = Mapping[str, Any]


@dataclasses.dataclass
class Rows:
    """What is known of the designs of a chunk so far.

    **Fields:**

    - `values`: by the keys that vary.
    - `moved`: of these by which there are derivatives.
    - `reasons`: why a design has no results; empty where it has.
    - `numbers`: that are kept, in the units of their names, shape `[design, number]`.
    - `slopes`: derivatives of the numbers, shape `[design, number, key]`.
    - `arrays`: that are kept, by name and place of the design.
    """

    values: list[dict[str, Any]]
    moved: tuple[str, ...]
    reasons: list[str]
    numbers: np.ndarray
    slopes: np.ndarray
    arrays: dict[str, dict[int, xr.Variable]]

    @property
    def good(self) -> list[int]:
        """Places of designs that nothing is known against."""
        return [place for place, reason in enumerate(self.reasons) if not reason]


def moved_keys(study: Study, keys: Sequence[str]) -> tuple[str, ...]:
    """Of the keys that vary those that one program moves; by them there are derivatives."""
    moves = study.asked.keep.gradients and study.asked.command in ("modes", "sweep")
    if not goes_together(study, keys) and not moves:
        return ()
    # Some keys are real once they are given.
    absent = [key for key in keys if study.scene.value(key) is None]
    scene = study.scene.replace({key: 1.0 for key in absent})
    real = {*scene.real_keys(), *(damping_keys(scene.damping) if moves else ())}
    return tuple(key for key in keys if key in real)


class Evaluator:
    """Computes chunks of one study; what they have in common is prepared once in a process."""

    def __init__(self, study: Study, table: DesignTable):
        """Keep what is computed, and of which designs."""
        self._study, self._table = study, table
        self._real = moved_keys(study, table.keys)
        self._programs: dict[tuple[Any, Shape], list[Callable]] = {}
        self._slopes = Slopes(study.asked.keep.numbers, self._real)
        self._is_first = True
        # With a switch, a word or a number of teeth results may have other numbers.
        rules = map(key_at, table.keys)
        self._brings_numbers = any(x is None or not x.kind.startswith("float") for x in rules)
        # Designs come in the order of their bodies, which are large.
        self._scene = functools.lru_cache(maxsize=1)(self._built)

    def __call__(self, designs: Sequence[int]) -> Rows:
        """The results of designs that are alike but for moved keys."""
        values = [self._table.at(design) for design in designs]
        numbers = len(self._study.asked.keep.numbers)
        rows = Rows(
            values,
            self._real,
            [unfit(each, self._study.scene.pair.torque_pinion_Nm) for each in values],
            np.full((len(values), numbers), np.nan),
            np.full((len(values), numbers, len(self._real)), np.nan),
            {},
        )
        if not goes_together(self._study, self._table.keys):
            self._solve_apart(rows)
        elif rows.good:
            self._solve_together(rows)
        return rows

    def _solve_together(self, rows: Rows) -> None:
        """Mesh cycles of designs, those of one shape in one call."""
        real, first = self._real, rows.values[rows.good[0]]
        others = tuple((key, value) for key, value in first.items() if key not in real)
        try:
            built = self._scene(others)
            base = built.grid
        except _OF_ONE as error:
            rows.reasons = [reason or reason_of(error) for reason in rows.reasons]
            return
        own = shape_of(built.model, base, base)
        shapes: dict[Shape, list[int]] = {}
        for place in rows.good:
            try:
                shape = own if self._light else self._shape(built, rows.values[place])
            except _OF_ONE as error:
                rows.reasons[place] = reason_of(error)
            else:
                shapes.setdefault(shape, []).append(place)
        for shape, places in shapes.items():
            if (others, shape) not in self._programs:
                at = {} if self._light else rows.values[places[0]]
                moved = {key: at[key] for key in real if key in at}
                template = BuiltScene(built.scene.replace(moved))
                programs = programs_of(self._study, template, real, shape.grid)
                self._programs[others, shape] = programs
            values = [[float(rows.values[place][key]) for key in real] for place in places]
            size, matrix = self._study.chunk, np.asarray(values, dtype=float)
            found = called(self._programs[others, shape], matrix, size)
            for index, place in enumerate(places):
                self._take(found, index, rows, place)

    def _take(self, found: Found, index: int, rows: Rows, place: int) -> None:
        """Put what was solved of a design in its row, or why it was not."""
        scene, keep, values = self._study.scene, self._study.asked.keep, rows.values[place]
        *numbers, deflection = found.numbers[index].tolist()
        slopes = None if found.slopes is None else found.slopes[index].T
        module, torque = (
            float(values.get(key, scene.value(key)))
            for key in ("pair.module_mm", "pair.torque_pinion_Nm")
        )
        try:
            require_solved(found.converged[index])
            require_bearable(float(deflection), module, abs(torque))
            _require_finite(keep.numbers, numbers, slopes)
        except _OF_ONE as error:
            rows.reasons[place] = reason_of(error)
            return
        rows.numbers[place] = numbers
        if slopes is not None:
            rows.slopes[place] = slopes
        kept = (*keep.arrays, *PLACES) if found.arrays else ()
        for name, array in zip(kept, found.arrays, strict=True):
            dims, words = ARRAYS[name]
            told = {"units": unit_of_name(name)[0], "long_name": words}
            rows.arrays.setdefault(name, {})[place] = xr.Variable(dims, array[index], told)

    def _solve_apart(self, rows: Rows) -> None:
        """Whole studies of designs, one by one."""
        keep, command = self._study.asked.keep, self._study.asked.command
        solve = getattr(studies, "statics" if command == "run" else command)
        sloped = keep.gradients and bool(self._real)
        for place in rows.good:
            try:
                scene = self._read(rows.values[place])
                looks = sloped and command == "sweep"
                seen = seen_of(scene.sweep, keep.numbers) if looks else None
                result = solve(scene) if seen is None else studies.sweep(scene, seen)
            except _OF_ONE as error:
                rows.reasons[place] = reason_of(error)
                continue
            if self._is_first and not self._brings_numbers:
                require_known(result.summary, result.datasets, keep, self._study.where)
            self._is_first = False
            # What this design has none of is an empty place.
            numbers = [number_in(result.summary, name) for name in keep.numbers]
            rows.numbers[place] = numbers
            arrays: dict[Hashable, xr.Variable] = {}
            for name in keep.arrays:
                arrays |= arrays_in(result.datasets, name).variables
            if sloped:
                built = BuiltScene(result.scene)
                rows.slopes[place] = self._slopes_of(built, rows.values[place], seen, numbers)
            for name, array in arrays.items():
                rows.arrays.setdefault(str(name), {})[place] = array

    def _slopes_of(
        self, design: BuiltScene, values: Row, seen: SeenResponses | None, numbers: Sequence[float]
    ) -> np.ndarray:
        """Derivatives of a design that moves, by the keys that one program moves."""
        others = tuple((key, value) for key, value in values.items() if key not in self._real)
        if seen is None:
            return self._slopes.of_modes(design, others)
        return self._slopes.of_sweep(design, others, seen, numbers)

    def _shape(self, base: BuiltScene, values: Row) -> Shape:
        """The shape of a design whose gears or shafts are others."""
        self._read(values)
        moved = base.scene.replace({key: values[key] for key in self._real})
        return shape_at(BuiltScene(moved), base.grid)

    @functools.cached_property
    def _light(self) -> bool:
        """Whether designs differ in flanks, torque and stiffnesses alone, all of which can be."""
        scene = self._study.scene
        if not all(is_light(key, scene.mesh, scene.pinion.shaft) for key in self._real):
            return False
        for column, key in enumerate(self._table.keys):
            if key in self._real:
                every = [float(row[column]) for row in self._table.rows]
                try:
                    self._read({key: np.nanmin(every).item()})
                    self._read({key: np.nanmax(every).item()})
                except SceneError:
                    # Each is looked at by itself.
                    return False
        return True

    def _read(self, values: Row) -> Scene:
        """The scene of a design, checked as one that is read from a file."""
        changes = [f"{key}={show(value)}" for key, value in values.items()]
        return read_scene(self._study.scene.path, [*self._study.asked.set, *changes])

    def _built(self, others: tuple[tuple[str, Any], ...]) -> BuiltScene:
        """The scene of designs that differ in moved keys only, with its condensed bodies."""
        return built_scene(self._read(dict(others)) if others else self._study.scene)


def _require_finite(names: Sequence[str], numbers: Sequence[float], slopes: Any) -> None:
    for name, number in zip(names, numbers, strict=True):
        require(bool(np.isfinite(number)), "{name} is not a finite number.", name=name)
    if slopes is not None:
        for name, row in zip(names, slopes, strict=True):
            finite = bool(np.isfinite(row).all())
            require(finite, "{name} has a derivative that is no finite number.", name=name)


def reason_of(error: Exception) -> str:
    """Why a design has no results, in one line."""
    if isinstance(error, SceneError):
        return "; ".join(f"{each.path}: {each.message}" for each in error.mistakes)
    return " ".join(str(error).split())
