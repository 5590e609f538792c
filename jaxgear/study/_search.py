"""The search that [optimise] asks for: from one start or several, kept in a file against a kill."""

import contextlib
import hashlib
import importlib.metadata
import json
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._checks import InputError
from jaxgear._geometry._lines import MeshGrid
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._types import as_scalar
from jaxgear._units import um
from jaxgear._whole_file import as_json
from jaxgear.scene._build import smooth_law_of
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.study._design import DesignSpace
from jaxgear.study._evaluations import (
    objectives_at,
    penalised_at,
    sloped_by,
    sloped_objective,
    sloped_residuals,
    sloped_responses,
)
from jaxgear.study._objectives import is_dynamic, limits_of, task_of
from jaxgear.study._progress import progress
from jaxgear.study._running import timed
from jaxgear.study._statics import SolverFailure

# Starts, and the points over the whole box of which all but the scene itself are the best. With 64
# points more of the searches end above the best that is known (docs/searches.md). With responses
# at many speeds an evaluation takes a second, not a millisecond.
_STARTS, _CANDIDATES = 5, 128
_FEW_STARTS, _FEW_CANDIDATES = 2, 16
# A better point by this much of the objective found on a map is worth a second search.
_CLEARLY_BETTER = 0.02

TOO_FEW_SPEEDS = (
    "fewer than half of the speeds of [sweep] have a response that has converged and is not close "
    "to a fold. Raise the damping, or sweep other speeds."
)


class Search(NamedTuple):
    """How a scene is searched, within the limits.

    The objective is one number at many points, with what is beyond a limit added to it; the slopes
    are what the method evaluates, with derivatives, at a point with a width of smooth contact [m];
    `number` is the objective among their values. `descend` calls a watcher after each evaluation.
    """

    name: str
    objective: optimise.Batched
    slopes: optimise.ValueAndGradient
    number: Callable[[np.ndarray], float]
    descend: Callable[[np.ndarray, optimise.Watcher], optimise.SearchResult]
    limits: tuple[optimise.Limit, ...] = ()


def search_of(
    space: DesignSpace, grid: MeshGrid, prepared: PreparedMesh | None, file: Path | None = None
) -> Search:
    """The search that a scene asks for; a file keeps its evaluations."""
    asked, law = space.scene.optimise, smooth_law_of(space.scene.mesh)
    task, limits = task_of(space, grid, law, prepared), limits_of(asked)
    many = optimise.Batched(lambda points: timed(objectives_at, task, points, law))
    if limits:
        most, scale = (np.asarray([getattr(each, k) for each in limits]) for k in ("most", "scale"))
        many = optimise.Batched(lambda x: timed(penalised_at, task, x, law, most, scale))
        slopes, number = sloped_by(sloped_responses, task), lambda values: float(values[0])
    elif asked.method == "least_squares":
        slopes, number = sloped_by(sloped_residuals, task), lambda values: float(np.sum(values**2))
    else:
        return by_gradient(space, sloped_by(sloped_objective, task), many, file)
    name, method = method_of(asked.method, limits)
    descend = _descending(space, method, slopes, file)
    return Search(name, many, slopes, number, descend, limits)


def by_gradient(
    space: DesignSpace,
    slopes: optimise.ValueAndGradient,
    objective: optimise.Batched,
    file: Path | None = None,
) -> Search:
    """A search without limits by the scene's method, L-BFGS or Adam, and through its widths.

    The slopes are of the variables and a width of smooth contact [m], the objective is the same at
    many points with the scene's width.
    """
    name, method = method_of("adam" if space.scene.optimise.method == "adam" else "lbfgs")
    return Search(name, objective, slopes, float, _descending(space, method, slopes, file))


def method_of(
    name: str, limits: tuple[optimise.Limit, ...] = ()
) -> tuple[str, Callable[..., optimise.SearchResult]]:
    """Name of a method, and its search: of slopes, a start and a box. SLSQP is that for limits."""
    if not limits:
        return name, getattr(optimise, name)
    return "slsqp", lambda slopes, *more, **settings: optimise.constrained(
        slopes, limits, *more, **settings
    )


def _descending(
    space: DesignSpace,
    method: Callable[..., optimise.SearchResult],
    slopes: optimise.ValueAndGradient,
    file: Path | None,
) -> Callable[[np.ndarray, optimise.Watcher], optimise.SearchResult]:
    """Descend from a start with the scene's width of smooth contact, or through several."""
    asked, width = space.scene.optimise, smooth_law_of(space.scene.mesh).width
    settings: Any = dict(most_evaluations=asked.max_evaluations, file=file)

    def descend(start: np.ndarray, watch: optimise.Watcher) -> optimise.SearchResult:
        if asked.anneal_um:
            widths = [*(um * each for each in asked.anneal_um), float(width)]
            return optimise.annealed(
                slopes, widths, start, space.box, search=method, watch=watch, **settings
            )
        return method(slopes.at(width), start, space.box, watch=watch, **settings)

    return descend


def require_acting(search: Search, space: DesignSpace) -> None:
    """Refuse a search from where nothing is known, or with a variable that changes nothing."""
    own = search.slopes.at(smooth_law_of(space.scene.mesh).width)
    try:
        idle = optimise.inactive(own, space.start, space.box)
    except FloatingPointError as error:
        where = dict(zip(space.keys, space.start.tolist(), strict=True))
        raise SolverFailure(f"{error} The start: {where}.") from error
    if idle:
        names = ", ".join(space.keys[place] for place in idle)
        raise InputError(
            f"optimise.vary names {names}, which changes nothing: the derivatives of the objective "
            "vanish at the start and all over the bounds. Remove it, or give what it needs to act."
        )


class Searched(NamedTuple):
    """The best that was found, and what each search found, that from the scene itself first.

    `left_out` counts starts from which the search met gears that cannot be evaluated. The seconds
    are with compiling.
    """

    found: optimise.SearchResult
    each: tuple[optimise.SearchResult, ...]
    left_out: int
    seconds: float


def searched(search: Search, space: DesignSpace) -> Searched:
    """Search from the scene's own values, and from the best of points all over the bounds."""
    asked, begun = space.scene.optimise, time.perf_counter()
    dynamic = is_dynamic(asked)
    count = asked.starts or (_FEW_STARTS if dynamic else _STARTS)
    with progress(_most(asked) * count, f"searching by {search.name}") as done:
        watch = lambda point, value: done(1)
        try:
            found = [search.descend(space.start, watch)]
        except FloatingPointError as error:
            if not dynamic:
                raise
            raise SolverFailure(f"{error} {TOO_FEW_SPEEDS}") from error
        if count > 1:
            candidates = _FEW_CANDIDATES if dynamic else _CANDIDATES
            for start in _further_starts(search, space, candidates, count - 1):
                # Elsewhere in the bounds gears may be impossible: that start finds nothing.
                with contextlib.suppress(FloatingPointError):
                    found.append(search.descend(start, watch))
    seconds = time.perf_counter() - begun
    return Searched(_best_of(search, *found), tuple(found), count - len(found), seconds)


def _most(asked: OptimiseKeys) -> int:
    """Evaluations of one descent at most."""
    return asked.max_evaluations * (1 + len(asked.anneal_um or ()))


def _further_starts(
    search: Search, space: DesignSpace, candidates: int, count: int
) -> Iterable[np.ndarray]:
    """The best of points all over the bounds, none if none of them can be evaluated."""
    try:
        return optimise.best_starts(
            search.objective, space.box, candidates=candidates, starts=count
        )
    except FloatingPointError:
        return ()


def descent(search: Search, space: DesignSpace, start: np.ndarray) -> optimise.SearchResult:
    """One search from a start."""
    with progress(_most(space.scene.optimise), f"searching by {search.name}") as done:
        return search.descend(start, lambda point, value: done(1))


def _best_of(search: Search, *found: optimise.SearchResult) -> optimise.SearchResult:
    """The best of some searches, one within the limits before all others."""
    best = min(found, key=lambda each: (bool(search.limits) and not each.converged, each.value))
    return optimise.joined(best, *(each for each in found if each is not best))


def unless_beaten(
    found: optimise.SearchResult,
    rival: np.ndarray,
    value: float,
    search: Search,
    space: DesignSpace,
) -> tuple[optimise.SearchResult, bool]:
    """Search once more from a rival's point if its value is clearly better; says whether it was.

    What is beyond limits is added to the rival's value.
    """
    own = found.value
    if search.limits:
        # What is beyond a limit counts, as it does in the rival's value.
        own = float(search.objective(found.point[None])[0])
    if value >= (1.0 - _CLEARLY_BETTER) * own:
        return found, False
    return _best_of(search, descent(search, space, rival), found), True


def record_file(
    space: DesignSpace, memory: Path | None, name: str = "search", version: str | None = None
) -> Path | None:
    """Where the evaluations of a search are kept while it runs: another scene has another file.

    So has another model, whose deviations are from a file that has changed since, and another
    version of the program. Without a folder nothing is kept.
    """
    if memory is None:
        return None
    version = version or importlib.metadata.version("jaxgear")
    text = json.dumps(as_json(dict(space.scene.values)), sort_keys=True)
    content = hashlib.sha256(f"{version} {text}".encode())
    for leaf in jax.tree.leaves(space.base):
        content.update(np.asarray(leaf).tobytes())
    return memory / f"{name}-{content.hexdigest()[:12]}.jsonl"


def forget(file: Path | None) -> None:
    """Remove the record of a search that has ended, and those of its widths."""
    if file is not None:
        for each in file.parent.glob(f"{file.stem}*{file.suffix}"):
            each.unlink()


# Widths, each half the one before, through which the bias of smooth contact is followed.
_HALVINGS = 5


def smoothing_bias_of(search: Search, space: DesignSpace, point: np.ndarray) -> float:
    """How far smooth contact may have moved the objective, from what narrower ones make of it.

    The bias is the sum of what every halving of the width takes away, all counted as of one sign: a
    part that raises the objective and one that lowers it may cancel at one width. Where it grows
    with the width or faster, all halvings beyond the last one take at most as much as that one.
    """
    width, at = smooth_law_of(space.scene.mesh).width, jnp.asarray(point)
    value = lambda w: search.number(np.asarray(search.slopes(at, as_scalar(w))[0]))
    taken = np.abs(np.diff([value(float(width) * 0.5**k) for k in range(_HALVINGS + 1)]))
    return float(np.sum(taken) + taken[-1])


# Of what a search gains, what smoothing may take before it is worth a word.
_WORTH_A_WORD = 0.05


def smoothing_notes(width: float, bias: float, before: float, after: float) -> list[str]:
    """What a user must hear of the width of smooth contact [um] after a search.

    The bias is the smooth less the exact objective where the search ended; before and after are
    exact.
    """
    if abs(bias) <= _WORTH_A_WORD * abs(before - after):
        return []
    return [
        f"With smooth contact, {width:g} um wide, the objective at the optimum is {bias:+.3g} off "
        f"the exact one, and the search gained {before - after:.3g}. A narrower mesh.smoothing_um "
        "brings it closer."
    ]


# A limit is kept to a thousandth.
_ABOUT = 1.0 + 1e-3


def limits_summary(
    limits: tuple[optimise.Limit, ...], exact: np.ndarray, smooth: np.ndarray
) -> list[dict[str, Any]]:
    """Part of the summary: each limit, and the exact and smooth response where a search ended."""
    return [
        {
            "name": limit.name,
            "most": limit.most,
            "found": float(value),
            "found_smooth": float(searched),
            "kept": bool(value <= limit.most * _ABOUT),
        }
        for limit, value, searched in zip(limits, exact, smooth, strict=True)
    ]


def limits_notes(rows: list[dict[str, Any]]) -> list[str]:
    """Where smooth and exact contact disagree on whether a limit is kept; none where both agree."""
    odd = [row for row in rows if row["kept"] != (row["found_smooth"] <= row["most"] * _ABOUT)]
    return [
        f"optimise.limits: {row['name']} is {row['found']:.5g} where the search ended, and "
        f"{row['found_smooth']:.5g} with smooth contact, which is what the search keeps below "
        f"{row['most']:g}. Lower mesh.smoothing_um to bring them together."
        for row in odd
    ]
