"""Searches that use no gradient, to compare with: on the same objective, in the same box."""

import numpy as np
import scipy

from optimise._record import Batched, Box, Objective, SearchResult, batched


def differential_evolution(
    objective: Objective | Batched,
    box: Box,
    *,
    seed: int = 0,
    population: int = 15,
    most_generations: int = 100,
    tolerance: float = 1e-3,
) -> SearchResult:
    """Minimise by SciPy's differential evolution: the baseline that uses no gradient.

    **Arguments:**

    - `objective`: traceable by JAX; a generation is one batched call.
    - `box`: bounds.
    - `seed`: of the random numbers.
    - `population`: members per variable.
    - `most_generations`: after which it stops.
    - `tolerance`: spread of the population's values over their mean, at which it has converged.

    **Returns:**

    The best point and the record of the search.
    """
    evaluated = batched(objective)
    points, values = [], []

    def evaluate(units: np.ndarray) -> np.ndarray:
        generation = box.from_unit(np.atleast_2d(units.T))
        found = evaluated(generation)
        # A design that cannot be evaluated is the worst of all.
        result = np.where(np.isfinite(found), found, np.inf)
        points.append(generation)
        values.append(result)
        return result

    end = scipy.optimize.differential_evolution(
        evaluate,
        [(0.0, 1.0)] * len(box.lower),
        rng=seed,
        popsize=population,
        maxiter=most_generations,
        tol=tolerance,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    return SearchResult(
        point=box.from_unit(end.x),
        value=float(end.fun),
        evaluations=sum(len(v) for v in values),
        gradient_evaluations=0,
        converged=bool(end.success),
        reason=str(end.message),
        path=np.concatenate(points),
        values=np.concatenate(values),
    )


def cma_es(
    objective: Objective | Batched,
    box: Box,
    *,
    start: np.ndarray | None = None,
    seed: int = 1,
    spread: float = 0.25,
    most_evaluations: int = 2000,
    tolerance: float = 1e-3,
) -> SearchResult:
    """Minimise by the CMA evolution strategy of the package `cma`, which is an extra.

    **Arguments:**

    - `objective`: traceable by JAX; a generation is one batched call.
    - `box`: bounds.
    - `start`: first point; by default the middle of the box.
    - `seed`: of the random numbers, from 1.
    - `spread`: standard deviation of the first generation [unit cubes].
    - `most_evaluations`: after which it stops.
    - `tolerance`: on the spread of the values, relative to the first best [-].

    **Returns:**

    The best point and the record of the search.

    **Raises:**

    - `ImportError` with the line to install, without the package.
    """
    try:
        import cma
    except ImportError as missing:
        raise ImportError("`cma_es` needs the package cma: pip install 'jaxgear[cma]'") from missing
    evaluated = batched(objective)
    count = len(box.lower)
    middle = np.full(count, 0.5) if start is None else box.to_unit(np.asarray(start, float))
    options = {
        "bounds": [[0.0] * count, [1.0] * count],
        "seed": seed,
        "maxfevals": most_evaluations,
        "verbose": -9,
    }
    strategy = cma.CMAEvolutionStrategy(middle, spread, options)
    points, values = [], []
    while not strategy.stop():
        units = strategy.ask()
        generation = box.from_unit(np.asarray(units))
        found = evaluated(generation)
        # A design that cannot be evaluated is the worst of all.
        found = np.where(np.isfinite(found), found, np.finfo(float).max)
        strategy.tell(units, found.tolist())
        points.append(generation)
        values.append(found)
        if np.ptp(found) <= tolerance * abs(values[0].min()):
            break
    path, numbers = np.concatenate(points), np.concatenate(values)
    best = int(np.argmin(numbers))
    spent = len(numbers) >= most_evaluations
    return SearchResult(
        point=path[best],
        value=float(numbers[best]),
        evaluations=len(numbers),
        gradient_evaluations=0,
        converged=not spent,
        reason="the evaluations allowed are spent" if spent else "the generation is of one value",
        path=path,
        values=numbers,
    )
