"""Several searches in a row: from many starts, and with a width that falls."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from optimise._record import (
    Batched,
    Box,
    Objective,
    SearchResult,
    ValueAndGradient,
    batched,
    with_gradient,
)
from optimise._search import lbfgs

Search = Callable[..., SearchResult]


def multi_start(
    objective: Objective | Batched,
    box: Box,
    *,
    search: Search = lbfgs,
    candidates: int = 64,
    starts: int = 3,
    seed: int = 0,
    **settings: Any,
) -> tuple[SearchResult, ...]:
    """Search from the best of many points that fill the box evenly.

    **Arguments:**

    - `search`: from one start, such as `lbfgs`.
    - `settings`: of the search.
    - the others: as of `best_starts`.

    **Returns:**

    The results, the best first.

    **Raises:**

    - `FloatingPointError` if no candidate can be evaluated, or a search meets one that cannot.
    """
    chosen = best_starts(objective, box, candidates=candidates, starts=starts, seed=seed)
    found = [search(objective, start, box, **settings) for start in chosen]
    return tuple(sorted(found, key=lambda result: result.value))


def best_starts(
    objective: Objective | Batched,
    box: Box,
    *,
    candidates: int = 64,
    starts: int = 3,
    seed: int = 0,
) -> np.ndarray:
    """The best of many points that fill the box evenly.

    **Arguments:**

    - `objective`: traceable by JAX.
    - `box`: bounds.
    - `candidates`: points of Halton's sequence, all evaluated in one call.
    - `starts`: how many to take: the best, and the next best that are apart.
    - `seed`: of the sequence's shift.

    **Returns:**

    They, the best first, shape `[start, variable]`.

    **Raises:**

    - `FloatingPointError` if no candidate can be evaluated.
    """
    unit = halton(len(box.lower), candidates, seed)
    points = box.from_unit(unit)
    values = batched(objective)(points)
    if not np.isfinite(values).any():
        raise FloatingPointError(
            f"The objective is not finite at any of {candidates} points all over the box. "
            "Narrow the bounds: some design within them is impossible."
        )
    # Half the distance that as many points on a lattice have.
    apart = 0.5 * candidates ** (-1.0 / len(box.lower))
    chosen: list[int] = []
    for place in np.argsort(np.where(np.isfinite(values), values, np.inf)):
        near = [np.max(abs(unit[place] - unit[other])) < apart for other in chosen]
        if np.isfinite(values[place]) and len(chosen) < starts and not any(near):
            chosen.append(int(place))
    return points[chosen]


def halton(dimension: int, count: int, seed: int) -> np.ndarray:
    """Points that fill a unit cube evenly, any number of them: Halton's sequence (Halton 1960).

    Each coordinate has the digits of the point's number behind the point, mirrored, to a prime base
    of its own; all are shifted at random, round the cube. SciPy's statistics, where Sobol's
    sequence is, take longer to import than a search takes.

    **Arguments:**

    - `dimension`: of the cube.
    - `count`: of points.
    - `seed`: of the shift.

    **Returns:**

    Shape `[count, dimension]` [-].
    """
    bases: list[int] = []
    number = 2
    while len(bases) < dimension:
        if all(number % base for base in bases):
            bases.append(number)
        number += 1
    points = np.random.default_rng(seed).random((1, dimension)).repeat(count, axis=0)
    for own, base in zip(points.T, bases, strict=True):
        digits, place = np.arange(count), 1.0
        while digits.any():
            place /= base
            own += place * (digits % base)
            digits //= base
    return points % 1.0


def sobol(dimension: int, count: int, seed: int) -> np.ndarray:
    """Points that fill a unit cube evenly: Sobol's sequence, scrambled (Owen 1998).

    **Arguments:**

    - `dimension`: of the cube.
    - `count`: of points, a power of two.
    - `seed`: of the scrambling.

    **Returns:**

    Shape `[count, dimension]` [-].

    **Raises:**

    - `ValueError` if the number of points is no power of two.
    """
    power = count.bit_length() - 1
    if count != 2**power:
        raise ValueError(
            f"Sobol's sequence fills a cube evenly with a power of two of points, got {count}. "
            f"Take {2**power} or {2 ** (power + 1)}."
        )
    return scipy.stats.qmc.Sobol(dimension, rng=seed).random_base2(power)


def annealed(
    objective: Callable[[Float[Array, " variable"], Float[Array, ""]], Float[Array, ""]]
    | ValueAndGradient,
    widths: Sequence[float],
    start: np.ndarray,
    box: Box,
    *,
    search: Search = lbfgs,
    file: Path | None = None,
    **settings: Any,
) -> SearchResult:
    """Search with a smoothing width that falls, from each optimum on to the next.

    Wide smoothing has few wrinkles to be caught in, narrow smoothing little bias. Compiled once.

    **Arguments:**

    - `objective`: of a point and a width, traceable by JAX; with its gradient or without.
    - `widths`: one after the other, in the unit that the objective takes.
    - `start`: first point; moved into the box.
    - `box`: bounds.
    - `search`: that uses the gradient, `lbfgs` or `adam`.
    - `file`: as of the search; each width has its own, its number before the suffix.
    - `settings`: of the search.

    **Returns:**

    The search with the last width; its counts and its record are those of all.

    **Raises:**

    - `FloatingPointError` if the objective or its gradient is not finite.
    - `ValueError` without a width.
    """
    if not len(widths):
        raise ValueError("`annealed` needs one width at least, got none.")
    sloped = with_gradient(objective)
    found: list[SearchResult] = []
    for number, width in enumerate(widths):
        at_width = sloped.at(jnp.asarray(float(width)))
        own = None if file is None else file.with_suffix(f".{number}{file.suffix}")
        found.append(search(at_width, start, box, file=own, **settings))
        start = found[-1].point
    return joined(found[-1], *found[:-1])


def joined(best: SearchResult, *others: SearchResult) -> SearchResult:
    """A result with the counts and the record of others before it.

    **Arguments:**

    - `best`: whose point and reason count.
    - `others`: searches before.

    **Returns:**

    The result.
    """
    every = (*others, best)
    return dataclasses.replace(
        best,
        evaluations=sum(each.evaluations for each in every),
        gradient_evaluations=sum(each.gradient_evaluations for each in every),
        path=np.concatenate([each.path for each in every]),
        values=np.concatenate([each.values for each in every]),
    )


def inactive(
    function: ValueAndGradient, start: np.ndarray, box: Box, *, places: int = 4, seed: int = 0
) -> tuple[int, ...]:
    """Variables that change nothing: whose derivatives vanish wherever they are looked at.

    Where all act at the start, nothing else is evaluated.

    **Arguments:**

    - `function`: values and derivatives.
    - `start`: first point.
    - `box`: bounds.
    - `places`: how many other points to look at, each variable once in each of as many parts of its
        span.
    - `seed`: of these points.

    **Returns:**

    Their places among the variables; empty if all of them act.

    **Raises:**

    - `FloatingPointError` if a value or a derivative is not finite at the start.
    """
    span = box.upper - box.lower

    def changes(point: np.ndarray) -> tuple[np.ndarray, float]:
        value, slope = (np.asarray(each) for each in function(jnp.asarray(point)))
        by_variable = np.max(abs(slope.reshape(-1, span.size)), axis=0) * span
        return by_variable, float(np.max(abs(value), initial=0.0))

    idle = np.ones(span.size, bool)

    def points() -> Iterator[np.ndarray]:
        yield np.asarray(start, float)
        # A Latin hypercube: Sobol's sequence would cost the import of SciPy's statistics.
        draw = np.random.default_rng(seed)
        layers = draw.permuted(np.tile(np.arange(places), (span.size, 1)), axis=1).T
        yield from box.from_unit((layers + draw.random(layers.shape)) / places)

    for number, point in enumerate(points()):
        change, size = changes(point)
        if number == 0 and not (np.isfinite(change).all() and np.isfinite(size)):
            raise FloatingPointError(
                f"The objective or its gradient is not finite where the search starts, at "
                f"{point.tolist()}: value {size:g}, slopes over the bounds {change.tolist()}."
            )
        idle &= change <= _NOTHING * max(size, float(np.nanmax(change)))
        if not idle.any():
            return ()
    return tuple(int(place) for place in np.flatnonzero(idle))


# A change over the whole box by less than this share of the value is rounding.
_NOTHING = 1e-12
