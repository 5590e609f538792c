"""The set against this version: every case at its fidelity levels, with error and time."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

import fem_prep
import jaxgear as jg
from benchmarks.reference.cases import FOLDER, Case
from jaxgear.designs._numbers import number_in
from jaxgear.study import modes, statics

# What each level changes of a scene. `default` is what a user gets.
LEVELS: Mapping[str, tuple[str, ...]] = {
    "coarse": ("mesh.slices=5", "mesh.phases=16"),
    "weber": ("mesh.foundation=weber",),
    "apart": ("mesh.face_coupling=none",),
    "default": (),
    "elements": ("mesh.tooth=elements",),
    "fine": (),
}
# Elements of a disc: around, from bore to rim, across.
_DISCS = {"coarse": (24, 6, 1), "default": (48, 12, 1), "fine": (72, 20, 2)}
_COMMANDS: Mapping[str, Callable] = {"run": statics, "modes": modes}


class Row(NamedTuple):
    """A number that was found; seconds are of the processors, for all numbers of its case.

    `first_s` has programs compiled and bodies condensed or fetched from their caches; `again_s`
    is the same once more.
    """

    case: str
    level: str
    number: str
    value: float
    known: float
    error_percent: float
    within_percent: float
    verdict: str
    first_s: float
    again_s: float


def rows_of(
    cases: Iterable[Case], levels: Iterable[str], tell: Callable[[str], None] = lambda words: None
) -> Iterator[Row]:
    """All numbers of cases at those of some levels that suit them.

    **Arguments:**

    - `cases`: to compute.
    - `levels`: names in `LEVELS`.
    - `tell`: told what begins.
    """
    levels = list(levels)
    for case in cases:
        for level in (each for each in case.levels if each in levels):
            tell(f"{case.case}, {level}")
            start = time.process_time()
            found = _found(case, level)
            middle = time.process_time()
            _found(case, level)
            seconds = (middle - start, time.process_time() - middle)
            for name, known in case.numbers.items():
                value = found(name)
                error, verdict = known.error_percent(value), known.verdict(value)
                within = known.within_percent
                kept = (value, known.value, error, within, verdict)
                yield Row(case.case, level, name, *kept, *seconds)


def _found(case: Case, level: str) -> Callable[[str], float]:
    """What finds a number of a case by its name, once all are computed."""
    if case.command == "disc":
        known = _disc(case.disc, _DISCS[level])
        return lambda name: known[name]
    changes = [*case.set, *LEVELS[level]]
    own = FOLDER / "scenes" / case.scene
    scene = jg.read_scene(own, changes) if own.is_file() else jg.example_scene(case.scene, changes)
    summary: Mapping[str, Any] = _COMMANDS[case.command](scene).summary

    def number(name: str) -> float:
        value = number_in(summary, name)
        if np.isnan(value):
            raise ValueError(f"{case.case}: results have no finite {name}.")
        return value

    return number


def _disc(measures: Mapping[str, float], parts: tuple[int, int, int]) -> dict[str, float]:
    """Least frequencies of a free disc by the nodal diameters of its modes [Hz]."""
    around, radial, across = parts
    sizes = {name.removesuffix("_mm"): 1e-3 * value for name, value in measures.items()}
    body = fem_prep.GearBody(sizes["outer"], sizes["width"], sizes["inner"])
    fineness = fem_prep.MeshSizing(around, rim_axial=across, web_radial=radial)
    material = fem_prep.Material(210e9, 0.3, 7850.0)
    full = fem_prep.full_body("disc", fem_prep.body_grid(body, fineness), material, [])
    square, shapes = fem_prep.free_modes(full, 24)
    motion = shapes.T.reshape(len(square), -1, 3)
    pattern = fem_prep.identify(full.grid.nodes, motion, weights=full.grid_mass.diagonal()[::3])
    found: dict[str, float] = {}
    for kind, n, frequency in zip(
        pattern.kind, pattern.diameter, np.sqrt(square) / (2.0 * np.pi), strict=True
    ):
        found.setdefault(f"disc.{'axial' if kind == 'axial' else 'plane'}_{n}_Hz", float(frequency))
    return found
