"""The search that [optimise] asks for: from one start or several, kept in a file against a kill."""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import optimise
from jaxgear._app._design import (
    DesignSpace,
    limits_of,
    objective_function,
    residuals_function,
    responses_function,
)
from jaxgear._app._results import as_json
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._solve._cycle import PreparedMesh
from jaxgear._types import Reals, Scalar

# Points over the whole box of which the best are starts.
_CANDIDATES = 64
# What a tenth of a limit too much counts, against objectives of order one.
_PENALTY = 1e2


class Search(NamedTuple):
    """How a scene is searched.

    **Fields:**

    - `name`: of the method.
    - `objective`: one number to make small for searches that know no limits: what is beyond a limit
        is added to it.
    - `descend`: from a start, told what to call after each evaluation; within the limits.
    - `limits`: that are kept.
    """

    name: str
    objective: Callable[[Reals], Scalar]
    descend: Callable[[np.ndarray, optimise.Watcher], optimise.SearchResult]
    limits: tuple[optimise.Limit, ...]


def search_of(
    space: DesignSpace,
    grid: MeshGrid,
    law: AbstractContactLaw,
    prepared: PreparedMesh | None,
    file: Path,
) -> Search:
    """The search that a scene asks for.

    **Arguments:**

    - `space`: variables of the scene.
    - `grid`: of the quasi-static cycles.
    - `law`: contact law.
    - `prepared`: the meshes, where the variables leave them as they are.
    - `file`: keeps the evaluations.

    **Returns:**

    The search.
    """
    scene, limits = space.scene, limits_of(space.scene)
    settings: Any = dict(most_evaluations=scene["optimise.max_evaluations"], file=file)
    objective = objective_function(space, grid, law, prepared)
    if limits:
        responses = responses_function(space, grid, law, prepared)
        return Search(
            "slsqp",
            _penalised(responses, limits),
            lambda start, watch: optimise.constrained(
                responses, limits, start, space.box, watch=watch, **settings
            ),
            limits,
        )
    if scene["optimise.method"] != "least_squares":
        return by_gradient(space, objective, file)
    residuals = residuals_function(space, grid, law, prepared)
    return Search(
        "least_squares",
        objective,
        lambda start, watch: optimise.least_squares(
            residuals, start, space.box, watch=watch, **settings
        ),
        (),
    )


def by_gradient(
    space: DesignSpace, objective: Callable[[Reals], Scalar], file: Path | None = None
) -> Search:
    """A search without limits by the scene's method, L-BFGS or Adam.

    **Arguments:**

    - `space`: variables of the scene.
    - `objective`: to make small.
    - `file`: keeps the evaluations.

    **Returns:**

    The search.
    """
    name = "adam" if space.scene["optimise.method"] == "adam" else "lbfgs"
    method = {"lbfgs": optimise.lbfgs, "adam": optimise.adam}[name]
    most = space.scene["optimise.max_evaluations"]
    descend = lambda start, watch: method(
        objective, start, space.box, most_evaluations=most, watch=watch, file=file
    )
    return Search(name, objective, descend, ())


def _penalised(
    responses: Callable[[Reals], Reals], limits: Sequence[optimise.Limit]
) -> Callable[[Reals], Scalar]:
    most, scale = (jnp.asarray([getattr(each, k) for each in limits]) for k in ("most", "scale"))

    def value(variables: Reals) -> Scalar:
        found = responses(variables)
        over = jnp.maximum((found[1:] - most) / scale, 0.0)
        return found[0] + _PENALTY * jnp.sum(over**2)

    return value


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
    best = min(found, key=lambda each: (bool(search.limits) and not each.converged, each.value))
    return joined(best, *(each for each in found if each is not best))


def joined(best: optimise.SearchResult, *others: optimise.SearchResult) -> optimise.SearchResult:
    """A result with the counts and the record of others before it."""
    every = (*others, best)
    return dataclasses.replace(
        best,
        evaluations=sum(each.evaluations for each in every),
        gradient_evaluations=sum(each.gradient_evaluations for each in every),
        path=np.concatenate([each.path for each in every]),
        values=np.concatenate([each.values for each in every]),
    )


def record_file(space: DesignSpace, folder: Path, version: str, name: str = "search") -> Path:
    """Where the evaluations of a search are kept while it runs: another scene has another file.

    So has another model, whose deviations are from a file that has changed since.
    """
    told = json.dumps(as_json(dict(space.scene.values)), sort_keys=True)
    content = hashlib.sha256(f"{version} {told}".encode())
    for leaf in jax.tree.leaves(space.base):
        content.update(np.asarray(leaf).tobytes())
    return folder / f"{name}-{content.hexdigest()[:12]}.jsonl"


def limits_summary(
    search: Search, responses: Callable[[np.ndarray], np.ndarray], point: np.ndarray
) -> list[dict[str, object]]:
    """Part of the summary: each limit, and the response with exact contact where a search ended.

    **Arguments:**

    - `search`: with its limits.
    - `responses`: with exact contact; the objective first.
    - `point`: where the search ended.

    **Returns:**

    One row for each limit.
    """
    if not search.limits:
        return []
    found = np.asarray(responses(point))[1:]
    return [
        {
            "name": limit.name,
            "most": limit.most,
            "found": float(value),
            "kept": bool(value <= limit.most * (1.0 + 1e-3)),
        }
        for limit, value in zip(search.limits, found, strict=True)
    ]
