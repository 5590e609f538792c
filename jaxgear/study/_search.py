"""The search that [optimise] asks for: from one start or several, kept in a file against a kill."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._checks import InputError
from jaxgear._cli._folder import Folder
from jaxgear._geometry._lines import MeshGrid
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._types import as_scalar
from jaxgear._units import um
from jaxgear._whole_file import as_json
from jaxgear.scene._build import smooth_law_of
from jaxgear.study._design import (
    DesignSpace,
    limits_of,
    task_of,
)
from jaxgear.study._evaluations import (
    objectives_at,
    penalised_at,
    sloped_objective,
    sloped_residuals,
    sloped_responses,
)
from jaxgear.study._running import timed
from jaxgear.study._statics import SolverFailure

# Points over the whole box of which the best are starts.
_CANDIDATES = 64


class Search(NamedTuple):
    """How a scene is searched.

    **Fields:**

    - `name`: of the method.
    - `objective`: one number to make small at many points, for searches that know no limits: what
        is beyond a limit is added to it.
    - `slopes`: what the method evaluates, with derivatives, at a point with a width of smooth
        contact [m].
    - `number`: the objective among its values.
    - `descend`: from a start, told what to call after each evaluation; within the limits.
    - `limits`: that are kept.
    """

    name: str
    objective: optimise.Batched
    slopes: optimise.Sloped
    number: Callable[[np.ndarray], float]
    descend: Callable[[np.ndarray, optimise.Watcher], optimise.SearchResult]
    limits: tuple[optimise.Limit, ...]


def search_of(
    space: DesignSpace,
    grid: MeshGrid,
    prepared: PreparedMesh | None,
    file: Path | None = None,
) -> Search:
    """The search that a scene asks for.

    **Arguments:**

    - `space`: variables of the scene.
    - `grid`: of the quasi-static cycles.
    - `prepared`: the meshes, where the variables leave them as they are.
    - `file`: keeps the evaluations.

    **Returns:**

    The search.
    """
    scene, limits = space.scene, limits_of(space.scene)
    law = smooth_law_of(scene)
    task = task_of(space, grid, law, prepared)
    sloped = lambda evaluate: optimise.Sloped(lambda x, width: timed(evaluate, task, x, width))
    many = optimise.Batched(lambda points: timed(objectives_at, task, points, law))
    if not limits and scene["optimise.method"] != "least_squares":
        return by_gradient(space, sloped(sloped_objective), many, file)
    settings: Any = dict(most_evaluations=scene["optimise.max_evaluations"], file=file)
    if limits:
        slopes = sloped(sloped_responses)
        own = slopes.at(law.width)
        most, scale = (np.asarray([getattr(each, k) for each in limits]) for k in ("most", "scale"))
        return Search(
            "slsqp",
            optimise.Batched(lambda points: timed(penalised_at, task, points, law, most, scale)),
            slopes,
            lambda values: float(values[0]),
            lambda start, watch: optimise.constrained(
                own, limits, start, space.box, watch=watch, **settings
            ),
            limits,
        )
    slopes = sloped(sloped_residuals)
    own = slopes.at(law.width)
    return Search(
        "least_squares",
        many,
        slopes,
        lambda values: float(np.sum(values**2)),
        lambda start, watch: optimise.least_squares(own, start, space.box, watch=watch, **settings),
        (),
    )


def by_gradient(
    space: DesignSpace,
    slopes: optimise.Sloped,
    objective: optimise.Batched,
    file: Path | None = None,
) -> Search:
    """A search without limits by the scene's method, L-BFGS or Adam, and through its widths.

    **Arguments:**

    - `space`: variables of the scene.
    - `slopes`: what is made small, with its gradient, of the variables and a width of smooth
        contact [m].
    - `objective`: the same at many points, with the scene's width.
    - `file`: keeps the evaluations.

    **Returns:**

    The search.
    """
    scene = space.scene
    name = "adam" if scene["optimise.method"] == "adam" else "lbfgs"
    method = {"lbfgs": optimise.lbfgs, "adam": optimise.adam}[name]
    settings: Any = dict(most_evaluations=scene["optimise.max_evaluations"], file=file)
    width = smooth_law_of(scene).width
    widths = [um * each for each in scene.get("optimise.anneal_um", ())]

    def descend(start: np.ndarray, watch: optimise.Watcher) -> optimise.SearchResult:
        if widths:
            every = [*widths, float(width)]
            return optimise.annealed(
                slopes, every, start, space.box, search=method, watch=watch, **settings
            )
        return method(slopes.at(width), start, space.box, watch=watch, **settings)

    return Search(name, objective, slopes, float, descend, ())


def require_acting(search: Search, space: DesignSpace) -> None:
    """Refuse a search from where nothing is known, or with a variable that changes nothing.

    **Arguments:**

    - `search`: of the scene.
    - `space`: its variables.

    **Raises:**

    - `InputError` with the keys that do not act.
    - `SolverFailure` if the objective or its gradient is not finite at the start.
    """
    own = search.slopes.at(smooth_law_of(space.scene).width)
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


# Widths, each half the one before, through which the bias of smooth contact is followed.
_HALVINGS = 5


def smoothing_bias_of(search: Search, space: DesignSpace, point: np.ndarray) -> float:
    """How far smooth contact may have moved the objective, from what narrower ones make of it.

    The bias is the sum of what every halving of the width takes away, all counted as of one sign:
    a part that raises the objective and one that lowers it may cancel at one width. Where it grows
    with the width or faster, all halvings beyond the last one take at most as much as that one.

    **Arguments:**

    - `search`: of the scene.
    - `space`: its variables.
    - `point`: where the search ended.

    **Returns:**

    The bound, in the unit of the objective.
    """
    width, at = smooth_law_of(space.scene).width, jnp.asarray(point)
    value = lambda w: search.number(np.asarray(search.slopes(at, as_scalar(w))[0]))
    values = [value(float(width) * 0.5**k) for k in range(_HALVINGS + 1)]
    taken = np.abs(np.diff(values))
    return float(np.sum(taken) + taken[-1])


# Of what a search gains, what smoothing may take before it is worth a word.
_WORTH_A_WORD = 0.05


def smoothing_notes(width: float, bias: float, before: float, after: float) -> list[str]:
    """What a user must hear of the width of smooth contact after a search.

    **Arguments:**

    - `width`: of smooth contact [um].
    - `bias`: smooth less exact objective where the search ended, in its unit.
    - `before`: exact objective where it began.
    - `after`: exact objective where it ended.

    **Returns:**

    A sentence, or none.
    """
    if abs(bias) <= _WORTH_A_WORD * abs(before - after):
        return []
    return [
        f"With smooth contact, {width:g} um wide, the objective at the optimum is {bias:+.3g} off "
        f"the exact one, and the search gained {before - after:.3g}. A narrower mesh.smoothing_um "
        "brings it closer."
    ]


def best_of_starts(
    search: Search, space: DesignSpace, watch: optimise.Watcher
) -> optimise.SearchResult:
    """Search from the scene's own values, and from as many other starts as it asks for.

    **Arguments:**

    - `search`: of the scene.
    - `space`: its variables.
    - `watch`: called after each evaluation.

    **Returns:**

    The best, with the counts and the record of all.
    """
    found = [search.descend(space.start, watch)]
    if (more := space.scene["optimise.starts"] - 1) > 0:
        descend = lambda objective, start, box: search.descend(start, watch)
        found += optimise.multi_start(
            search.objective, space.box, search=descend, candidates=_CANDIDATES, starts=more
        )
    return best_of(search, *found)


def best_of(search: Search, *found: optimise.SearchResult) -> optimise.SearchResult:
    """The best of some searches, one within the limits before all others.

    **Arguments:**

    - `search`: of the scene.
    - `found`: what it found from different starts.

    **Returns:**

    The best, with the counts and the record of all.
    """
    best = min(found, key=lambda each: (bool(search.limits) and not each.converged, each.value))
    return optimise.joined(best, *(each for each in found if each is not best))


def record_file(space: DesignSpace, folder: Folder, version: str, name: str = "search") -> Path:
    """Where the evaluations of a search are kept while it runs: another scene has another file.

    So has another model, whose deviations are from a file that has changed since.
    """
    told = json.dumps(as_json(dict(space.scene.values)), sort_keys=True)
    content = hashlib.sha256(f"{version} {told}".encode())
    for leaf in jax.tree.leaves(space.base):
        content.update(np.asarray(leaf).tobytes())
    return folder.kept(f"{name}-{content.hexdigest()[:12]}.jsonl")


# A limit is kept to a thousandth.
_ABOUT = 1.0 + 1e-3


def limits_summary(
    search: Search,
    responses: Callable[[np.ndarray], np.ndarray],
    smoothly: Callable[[np.ndarray], np.ndarray],
    point: np.ndarray,
) -> list[dict[str, Any]]:
    """Part of the summary: each limit, and the response with exact contact where a search ended.

    **Arguments:**

    - `search`: with its limits.
    - `responses`: with exact contact; the objective first.
    - `smoothly`: the same with the smooth contact of the search.
    - `point`: where the search ended.

    **Returns:**

    One row for each limit.
    """
    if not search.limits:
        return []
    found, smooth = np.asarray(responses(point))[1:], np.asarray(smoothly(point))[1:]
    return [
        {
            "name": limit.name,
            "most": limit.most,
            "found": float(value),
            "found_smooth": float(searched),
            "kept": bool(value <= limit.most * _ABOUT),
        }
        for limit, value, searched in zip(search.limits, found, smooth, strict=True)
    ]


def limits_notes(rows: list[dict[str, Any]]) -> list[str]:
    """Where smooth and exact contact disagree on whether a limit is kept.

    **Arguments:**

    - `rows`: of `limits_summary`.

    **Returns:**

    Sentences; none where both agree.
    """
    odd = [row for row in rows if row["kept"] != (row["found_smooth"] <= row["most"] * _ABOUT)]
    return [
        f"optimise.limits: {row['name']} is {row['found']:.5g} where the search ended, and "
        f"{row['found_smooth']:.5g} with smooth contact, which is what the search keeps below "
        f"{row['most']:g}. Lower mesh.smoothing_um to bring them together."
        for row in odd
    ]
