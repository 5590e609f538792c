"""The engine of comparison: all levels are solved, timed and measured, and one is chosen."""

import abc
import gc
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from jaxgear._kept_programs import USUALLY, Options
from jaxgear.scene._scene import Scene
from jaxgear.study._fidelity._choice import MARGIN, Choice, choose, combined, words_of
from jaxgear.study._fidelity._level import RESPONSES, Answers, Level, Reference, own_of
from jaxgear.study._progress import progress, say
from jaxgear.study._result import Summary
from jaxgear.study._running import stopwatch, timed

# Seconds of runs that suffice to time a program, and the most runs.
_ENOUGH, _RUNS = 0.5, 400


class Run(NamedTuple):
    """A level at some points, as a program.

    **Fields:**

    - `program`: from the arguments to `Answers`.
    - `arguments`: of the program.
    - `times`: by which the time of a run is taken [-].
    - `at`: which points of the reference are solved.
    - `options`: of the compiler.
    """

    program: Callable[..., Answers]
    arguments: tuple[Any, ...]
    times: float = 1.0
    at: Any = slice(None)
    options: Options = USUALLY


class AbstractProblem(abc.ABC):
    """What is compared of a scene: what a point, an answer and a reference are.

    **Fields:**

    - `scene`: whose levels are compared.
    - `levels`: the hierarchy, with names of their own; that of the scene itself changes nothing.
    - `names`: responses by which levels are measured.
    - `extras`: further ones that a level must keep at held-out points.
    - `shares`: of the tolerance, that each part of a combination may use up [-].
    - `judged`: what the errors are, and in words of a picture.
    """

    scene: Scene
    levels: Sequence[Level]
    names: tuple[str, ...]
    extras: tuple[str, ...] = ()
    shares: tuple[float, ...] = (MARGIN,)
    judged: tuple[str, str]

    @abc.abstractmethod
    def reference(self, level: Level) -> Reference:
        """What a level is compared with, found once; `SolverFailure` if it was not solved."""

    @abc.abstractmethod
    def run(self, level: Level) -> Run:
        """A level at the points by which it is chosen."""

    @abc.abstractmethod
    def line(self, level: Level, answers: Answers, at: Any) -> Summary:
        """Size and errors of a level, for its line of the summary."""

    def held_out(self, level: Level) -> Mapping[str, float | None]:
        """The largest errors at points by which none is chosen, where a line does not have them."""
        return {}

    def remark(self, lines: Sequence[Summary], responses: Sequence[str]) -> str:
        """What the summary says in words besides of the lines of levels."""
        return ""

    @abc.abstractmethod
    def about(self) -> Summary:
        """What levels were compared with, as the summary says it."""


class Comparison(NamedTuple):
    """What came of a comparison.

    **Fields:**

    - `levels`: the hierarchy and what was put together of it, by name.
    - `choice`: the level that suffices.
    - `summary`: lines of the levels, the choice in words, the reference.
    - `dataset`: lines of the levels.
    """

    levels: Mapping[str, Level]
    choice: Choice
    summary: Summary
    dataset: xr.Dataset

    @property
    def chosen(self) -> Level | None:
        """The level that suffices."""
        return None if self.choice.line is None else self.levels[self.choice.line["name"]]


def counted(wanted: Sequence[str] | None, names: Sequence[str]) -> tuple[str, ...]:
    """Of responses those that are wanted; all, where none of them is."""
    return tuple(name for name in names if name in (wanted or names)) or tuple(names)


def compared(problem: AbstractProblem, what: str) -> Comparison:
    """Solve, time and measure all levels of a problem, and choose one.

    In words of progress, `what` is compared.

    **Raises:**

    - `SolverFailure` if the reference was not solved.
    """
    tolerance = float(problem.scene.compare.tolerance)
    responses, own = counted(problem.scene.compare.responses, problem.names), own_of(problem.levels)
    levels = {level.name: level for level in problem.levels}
    lines: dict[str, Summary] = {}

    def tried(line: Summary) -> Mapping[str, float | None]:
        if "held_out" not in line:
            line["held_out"] = problem.held_out(levels[line["name"]])
        return line["held_out"]

    with progress(len(levels) + len(problem.shares) + 1, what) as done:
        problem.reference(own)
        done(1)
        for level in problem.levels:
            lines[level.name] = _line(problem, level)
            done(1)
        for share in problem.shares:
            whole = combined(problem.levels, lines, own, share * tolerance, responses)
            if whole is not None and whole.name not in levels:
                levels[whole.name], lines[whole.name] = whole, _line(problem, whole)
            done(1)
        rows = list(lines.values())
        choice = choose(rows, tolerance, responses, tried, problem.extras)
        each = {name: choose(rows, tolerance, (name,), tried).name for name in responses}
    words = words_of(choice, lines[own.name], tolerance, responses, problem.judged[0])
    found = {
        "rungs": rows,
        "recommended": choice.name,
        "recommended_for": each,
        "words": words + problem.remark(rows, responses),
        "tolerance": tolerance,
        "responses": list(responses),
        "reference": problem.about(),
    }
    return Comparison(levels, choice, found, _dataset(problem, found))


def _line(problem: AbstractProblem, level: Level) -> Summary:
    """A level's line of the summary; the shortest of its runs counts."""
    say(level.name)
    run = problem.run(level)
    taken: list[float] = []
    # Other work on the machine makes most runs longer, hardly all.
    with stopwatch() as watch:
        while sum(taken) < _ENOUGH and len(taken) < _RUNS:
            before = watch.run_s
            answers = timed(run.program, *run.arguments, options=run.options)
            taken.append(watch.run_s - before)
    found = problem.line(level, answers, run.at)
    gc.collect()
    size = {key: found.pop(key) for key in ("beyond", "dofs", "phases", "slices", "speeds")
            if key in found}  # fmt: skip
    times = {"time_s": run.times * min(taken), "compile_s": watch.compile_s}
    return {"name": level.name, "family": level.family} | size | times | found


# What a line has besides its errors: units, and words.
_COLUMNS = {
    "name": ("1", "fidelity level"),
    "family": ("1", "what it differs in"),
    "beyond": ("1", "whether it is another physical model than the one asked for"),
    "dofs": ("1", "degrees of freedom"),
    "phases": ("1", "time steps in a mesh period"),
    "slices": ("1", "slices across the face"),
    "speeds": ("1", "number of speeds that were solved"),
    "time_s": ("s", "time, without compilation"),
    "compile_s": ("s", "time of compilation, less where the program was kept"),
    "same_branch_share": ("1", "share of the speeds on the branch of the reference"),
    "settled_share": ("1", "share of the speeds at which the method converged"),
    "modes": ("1", "modes of condensed bodies"),
    "mesh_coordinates": ("1", "coordinates in which the mesh tells modes apart"),
}


def _dataset(problem: AbstractProblem, found: Summary) -> xr.Dataset:
    """The lines of a comparison over its levels."""
    rows = found["rungs"]
    variables = {
        name: ("level", [row[name] for row in rows], {"units": units, "long_name": words})
        for name, (units, words) in _COLUMNS.items()
        if name in rows[0]
    }
    middle = "median error" if "error_95" in rows[0] else "largest error"
    errors = {
        "error": f"{middle} of the {{}}, relative",
        "error_95": "95 % error of the {}, relative",
        "held_out": "largest error of the {} at points not used to choose, relative",
    }
    for kind, words in errors.items():
        for name in dict.fromkeys(name for row in rows for name in row.get(kind, ())):
            of = RESPONSES[name].words
            about = {
                "units": "1",
                "long_name": words.format(of),
                "of": of,
                "recommended": found["recommended_for"].get(name) or "",
            }
            values = (row.get(kind, {}).get(name) for row in rows)
            numbers = [np.nan if x is None else x for x in values]
            variables[f"{kind}_{name}"] = ("level", numbers, about)
    attributes = {
        "recommended": found["recommended"] or "",
        "tolerance": found["tolerance"],
        "margin": MARGIN,
        "responses": " ".join(problem.names),
        "words": problem.judged[1],
    }
    return xr.Dataset(variables, attrs=attributes)
