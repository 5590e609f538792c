"""Two numbers at once: how little there can be of one for so much of the other."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from optimise._record import Box, Residuals, SearchResult, ValueAndGradient, with_jacobian
from optimise._search import KEPT, Limit, constrained, excess_of, lbfgs


class ParetoFront(eqx.Module):
    """Designs that trade one number against another.

    **Fields:**

    - `point`: designs, from the least of the first number to the least of the second, in the units
        of the variables; shape `[point, variable]` [-].
    - `value`: both numbers of each, re-checked, in their own units; NaN where a search failed [-].
    - `allowed`: how much of the second number each was allowed; infinite for the first [-].
    - `kept`: whether the design keeps what it was allowed and all other limits [-].
    - `settled`: whether its search stopped by itself [-].
    - `reason`: why it stopped.
    - `evaluations`: of both numbers with their gradients, in all [-].
    """

    point: np.ndarray
    value: np.ndarray
    allowed: np.ndarray
    kept: np.ndarray
    settled: np.ndarray
    reason: tuple[str, ...]
    evaluations: int

    @property
    def dominated(self) -> np.ndarray:
        """Whether another design that keeps its limits is as good in both numbers, to a millionth,
        and better in one; so counts what keeps none, or could not be evaluated.
        """
        beaten = ~self.kept | np.isnan(self.value).any(axis=1)
        for i, own in enumerate(self.value):
            for other in self.value[self.kept]:
                over = (own - other) / (np.maximum(np.abs(own), np.abs(other)) + _NONE)
                beaten[i] |= bool(np.all(over >= -_SAME) and np.any(over > _SAME))
        return beaten

    @property
    def front(self) -> np.ndarray:
        """Numbers of the designs that count, in the order of the first; shape `[point, 2]` [-]."""
        left = self.value[~self.dominated]
        return left[np.argsort(left[:, 0])]


def pareto_front(
    responses: Residuals | ValueAndGradient,
    start: np.ndarray,
    box: Box,
    *,
    points: int = 7,
    limits: Sequence[Limit] = (),
    exact: Callable[[np.ndarray], np.ndarray] | None = None,
    most_evaluations: int = 50,
    tolerance: float = 1e-6,
    done: Callable[[int], None] = lambda count: None,
) -> ParetoFront:
    """Make one number least for several amounts of another: the method of epsilon constraints.

    First each number is made least by itself. Between what the second number is at these two ends,
    amounts are spread evenly, and for each the first number is made least while the second stays
    below; each search begins where the one before has ended. Unlike weighted sums, that finds
    fronts that are hollow too. Searches are local: a front is as good as its searches.

    **Arguments:**

    - `responses`: the two numbers, and that of each limit; traceable by JAX.
    - `start`: first point; moved into the box. At it neither number may be negative: they are
        scaled by it, but for one that is zero there.
    - `box`: bounds.
    - `points`: designs to look for, with both ends.
    - `limits`: that all designs keep, beside the two numbers.
    - `exact`: both numbers of a design for the re-check; `None`: those of `responses`.
    - `most_evaluations`: of each search.
    - `tolerance`: of each search on relative progress [-].
    - `done`: told how many more designs are finished, for a progress bar.

    **Returns:**

    The designs. One that cannot be found, or not within its limits, says so and does not count.

    **Raises:**

    - `ValueError` if fewer than two points are asked for, or a number is negative at the start.
    - `FloatingPointError` if a number cannot be evaluated at the start.
    """
    if points < 2:
        raise ValueError(f"A front has two ends: `points` must be at least 2, got {points}.")
    slopes = with_jacobian(responses)
    numbers = lambda point: np.asarray(slopes(jnp.asarray(point, dtype=float))[0])[:2]
    sizes = _sizes(numbers(box.from_unit(box.to_unit(np.asarray(start, float)))))

    def scaled(*order: int) -> ValueAndGradient:
        """Numbers in an order, the first over what it is at the start; then the limited ones."""
        rows = np.asarray([*order, *range(2, 2 + len(limits))])
        units = jnp.ones(len(rows)).at[0].set(sizes[order[0]])

        def both(point: Array) -> tuple[Array, Array]:
            value, slope = slopes(point)
            return value[rows] / units, slope[rows] / units[:, None]

        return ValueAndGradient(both)

    searches = _Searches(box, limits, most_evaluations, tolerance, done)
    first = searches.alone(scaled(0), np.asarray(start, float))
    second = searches.alone(scaled(1), np.asarray(start, float))
    most, least = (float(numbers(found.point)[1]) for found in (first, second))
    between, allowed = [], []
    if most - least > _SAME * abs(least) + _NONE:
        near = first.point
        for one in np.linspace(most, least, points)[1:-1].tolist():
            limit = Limit("the second number", one, most - least)
            between.append(searches.within(scaled(0, 1), limit, near))
            allowed.append(one)
            near = between[-1].point
    every = [first, *between, second]
    return ParetoFront(
        point=np.stack([found.point for found in every]),
        value=np.stack([_checked(exact or numbers, found.point) for found in every]),
        allowed=np.asarray([np.inf, *allowed, least]),
        kept=np.asarray([found.kept for found in every]),
        settled=np.asarray([found.settled for found in every]),
        reason=tuple(found.reason for found in every),
        evaluations=searches.evaluations,
    )


# Numbers that differ by less, over their size, are the same; and those that are less, nothing.
_SAME, _NONE = 1e-6, 1e-12


class _Ended(NamedTuple):
    """Where one search ended; as of `ParetoFront`."""

    point: np.ndarray
    kept: bool
    settled: bool
    reason: str


class _Searches:
    """Searches with the same settings, which count their evaluations."""

    def __init__(
        self,
        box: Box,
        limits: Sequence[Limit],
        most_evaluations: int,
        tolerance: float,
        done: Callable[[int], None],
    ):
        self._box, self._limits, self._done = box, list(limits), done
        self._most, self._tolerance = most_evaluations, tolerance
        self.evaluations = 0

    def alone(self, responses: ValueAndGradient, start: np.ndarray) -> _Ended:
        """Make a number least."""
        if self._limits:
            return self._search(responses, self._limits, start)

        def one(point: Array) -> tuple[Array, Array]:
            value, slope = responses(point)
            return value[0], slope[0]

        search = lambda: lbfgs(
            ValueAndGradient(one),
            start,
            self._box,
            most_evaluations=self._most,
            tolerance=self._tolerance,
        )
        return self._told(search, lambda point: True, start)

    def within(self, responses: ValueAndGradient, limit: Limit, start: np.ndarray) -> _Ended:
        """Make the first number least while the second stays below a limit."""
        return self._search(responses, [limit, *self._limits], start)

    def _search(
        self, responses: ValueAndGradient, limits: Sequence[Limit], start: np.ndarray
    ) -> _Ended:
        search = lambda: constrained(
            responses,
            limits,
            start,
            self._box,
            most_evaluations=self._most,
            tolerance=self._tolerance,
        )

        def keeps(point: np.ndarray) -> bool:
            values = np.asarray(responses(jnp.asarray(point))[0])[1:]
            return not np.any(excess_of(values, limits) > KEPT)

        return self._told(search, keeps, start)

    def _told(
        self,
        search: Callable[[], SearchResult],
        keeps: Callable[[np.ndarray], bool],
        start: np.ndarray,
    ) -> _Ended:
        try:
            found = search()
        except FloatingPointError as error:
            self._done(1)
            inside = self._box.from_unit(self._box.to_unit(start))
            return _Ended(inside, False, False, str(error))
        self._done(1)
        self.evaluations += found.gradient_evaluations
        return _Ended(found.point, keeps(found.point), found.converged, found.reason)


def _sizes(values: np.ndarray) -> np.ndarray:
    """What both numbers are at the start, as their units; one for a number that is nothing."""
    if not np.all(np.isfinite(values)):
        raise FloatingPointError(
            f"The two numbers of a front are {values.tolist()} at the start. Begin with a "
            "design that can be evaluated."
        )
    if np.any(values < -_NONE):
        raise ValueError(
            f"No number of a front may be negative at the start, got {values.tolist()}: it is the "
            "unit in which its changes are measured."
        )
    return np.where(values > _NONE, values, 1.0)


def _checked(exact: Callable, point: np.ndarray) -> np.ndarray:
    """Both numbers of a design, or NaN."""
    value = np.asarray(exact(point), dtype=float)
    return value if np.all(np.isfinite(value)) else np.full(2, np.nan)
