"""What a search evaluates, once each and kept: in memory, and in a file that outlives a kill."""

import json
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import jaxgear as jg

Objective = Callable[[Float[Array, " variable"]], Float[Array, ""]]
Residuals = Callable[[Float[Array, " variable"]], Float[Array, " residual"]]
# Called with the point and the value after each evaluation of the gradient.
Watcher = Callable[[np.ndarray, float], None]


class ValueAndGradient:
    """A function that returns its values and their derivatives, in one compiled call.

    Searches take one in place of a function: what was looked at before is not compiled again.
    """

    def __init__(self, both: Callable[..., tuple[Array, Array]]):
        """Mark a function as one that is compiled, and returns derivatives.

        **Arguments:**

        - `both`: of a point, and of what else it takes; values, and derivatives with an axis more,
            of the variables.
        """
        self._both = both

    def __call__(self, point: Array, *others: Array) -> tuple[Array, Array]:
        """Values and derivatives at a point."""
        return self._both(point, *others)

    def at(self, *others: Array) -> "ValueAndGradient":
        """The function of a point alone, all else given."""
        return ValueAndGradient(lambda point: self._both(point, *others))


def with_gradient(objective: Callable[..., Array] | ValueAndGradient) -> ValueAndGradient:
    """An objective with its gradient, in reverse.

    **Arguments:**

    - `objective`: of a point, and of what else it takes, traceable by JAX; one that has its
        gradient already stays as it is.

    **Returns:**

    The function of the same.
    """
    if isinstance(objective, ValueAndGradient):
        return objective
    return ValueAndGradient(jax.jit(jax.value_and_grad(objective)))


def with_jacobian(function: Callable[..., Array] | ValueAndGradient) -> ValueAndGradient:
    """Several values and the derivatives of each, `[value, variable]`, forward in one pass.

    **Arguments:**

    - `function`: of a point, and of what else it takes, traceable by JAX; one that has its
        derivatives already stays as it is.

    **Returns:**

    The function of the same.
    """
    if isinstance(function, ValueAndGradient):
        return function
    return ValueAndGradient(jax.jit(value_and_jacobian(function)))


def value_and_jacobian(function: Callable[..., Array]) -> Callable[..., tuple[Array, Array]]:
    """Several values and the derivatives of each by the first argument, forward in one pass.

    **Arguments:**

    - `function`: traceable by JAX.

    **Returns:**

    A function of the same arguments: values, and derivatives `[value, variable]`.
    """
    both = jax.jacfwd(lambda *x: (function(*x),) * 2, has_aux=True)
    return lambda *x: both(*x)[::-1]


class Box(eqx.Module):
    """Bounds of the variables; they are also their scales.

    **Fields:**

    - `lower`: smallest value of each variable, in its own unit [-].
    - `upper`: largest value of each variable, in its own unit [-].

    **Raises:**

    - `ValueError` if a lower bound is not below its upper bound.
    """

    lower: np.ndarray = eqx.field(converter=np.asarray)
    upper: np.ndarray = eqx.field(converter=np.asarray)

    def __check_init__(self):
        if not np.all(self.lower < self.upper):
            raise ValueError(
                f"Every lower bound must be below its upper bound, got {self.lower.tolist()} and "
                f"{self.upper.tolist()}."
            )

    def to_unit(self, point: np.ndarray) -> np.ndarray:
        """Place a point in the unit cube, moved inside the box if it was not [-]."""
        return np.clip((point - self.lower) / (self.upper - self.lower), 0.0, 1.0)

    def from_unit(self, unit: np.ndarray) -> np.ndarray:
        """Undo `to_unit`, in the units of the variables."""
        return self.lower + unit * (self.upper - self.lower)


class SearchResult(eqx.Module):
    """Where a search ended, and how.

    **Fields:**

    - `point`: best point found, in the units of the variables [-].
    - `value`: objective there, in its own unit [-].
    - `evaluations`: of the objective, with or without gradient [-].
    - `gradient_evaluations`: of the objective with its gradient [-].
    - `converged`: whether the search stopped by itself.
    - `reason`: why it stopped.
    - `path`: every point evaluated, for gradient searches in order [-].
    - `values`: objective at each of them [-].
    """

    point: np.ndarray
    value: float
    evaluations: int
    gradient_evaluations: int
    converged: bool
    reason: str
    path: np.ndarray
    values: np.ndarray


class Batched:
    """An objective at many points, compiled: searches by populations take one for an objective."""

    def __init__(self, many: Callable[[np.ndarray], Array]):
        """Mark a function as one that takes many points.

        **Arguments:**

        - `many`: of points, shape `[point, variable]`.
        """
        self._many = many

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Values at points, shape `[point, variable]`."""
        return np.asarray(self._many(points))


def batched(objective: Objective | Batched) -> Callable[[np.ndarray], np.ndarray]:
    """An objective at many points in one compiled call: `jaxgear.over_batch`.

    **Arguments:**

    - `objective`: traceable by JAX; one of many points already stays as it is.

    **Returns:**

    A function of points, shape `[point, variable]`.
    """
    if isinstance(objective, Batched):
        return objective
    compiled = jax.jit(lambda points: jg.over_batch(objective, points))
    return lambda points: np.asarray(compiled(jnp.asarray(points)))


class Record:
    """Evaluates values and derivatives in the unit cube, no point twice, and keeps all of them.

    A search that is begun again with the file of one that was stopped goes the same way, and pays
    only for what is new.
    """

    def __init__(
        self, function: Callable, box: Box, watch: Watcher | None = None, file: Path | None = None
    ):
        """Begin a record, or go on with that of a file.

        **Arguments:**

        - `function`: of a point; some values first, then the derivatives of each of them.
        - `box`: bounds.
        - `watch`: told each point and the first value there, after its evaluation.
        - `file`: lines of JSON, to go on with if there are any.

        **Raises:**

        - `ValueError` if the file is of another box.
        """
        self._function, self._box, self._watch = function, box, watch
        self._known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
        self._file = file
        self.points: list[np.ndarray] = []
        self.values: list[np.ndarray] = []
        if file is not None:
            self._open(file)

    def __call__(self, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values at a place of the unit cube, and their slopes along its edges.

        **Arguments:**

        - `unit`: the place [-].

        **Returns:**

        Values, and derivatives with an axis more, of the variables.

        **Raises:**

        - `FloatingPointError` if one of them is not finite.
        """
        point = self._box.from_unit(np.asarray(unit))
        key = point.tobytes()
        if self.points and key == self.points[-1].tobytes():
            return self._scaled(*self._known[key])
        if key not in self._known:
            found = self._function(jnp.asarray(point))
            value, slope = (np.asarray(part, dtype=float) for part in found)
            if not (np.all(np.isfinite(value)) and np.all(np.isfinite(slope))):
                first = float(np.ravel(value)[0])
                raise FloatingPointError(
                    f"The objective or its gradient is not finite at {point.tolist()}: value "
                    f"{first}. Narrow the bounds: some design within them is impossible."
                )
            self._known[key] = value, slope
            self._write({"point": point.tolist(), "value": value.tolist(), "slope": slope.tolist()})
        value, slope = self._known[key]
        self.points.append(point)
        self.values.append(value)
        if self._watch is not None:
            self._watch(point, float(np.ravel(value)[0]))
        return self._scaled(value, slope)

    def result(
        self, *, converged: bool, reason: str, numbers: np.ndarray | None = None
    ) -> SearchResult:
        """The best of what was evaluated.

        **Arguments:**

        - `converged`: whether the search stopped by itself.
        - `reason`: why it stopped.
        - `numbers`: what was to be made small at each evaluation, if that is not the value.
        """
        numbers = np.asarray(self.values) if numbers is None else numbers
        best = int(np.argmin(numbers))
        return SearchResult(
            point=self.points[best],
            value=float(numbers[best]),
            evaluations=len(self.points),
            gradient_evaluations=len(self.points),
            converged=converged,
            reason=reason,
            path=np.stack(self.points),
            values=numbers,
        )

    def _scaled(self, value: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return value, slope * (self._box.upper - self._box.lower)

    def _open(self, file: Path) -> None:
        box = {"lower": self._box.lower.tolist(), "upper": self._box.upper.tolist()}
        lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
        kept = [line for line in lines if _is_whole(line)]
        if kept and json.loads(kept[0]) != box:
            raise ValueError(
                f"{file} is the record of a search in another box: {kept[0]}, not "
                f"{json.dumps(box)}. Give another file, or remove it."
            )
        for line in kept[1:]:
            entry = json.loads(line)
            point, value, slope = (np.asarray(entry[k], float) for k in ("point", "value", "slope"))
            self._known[point.tobytes()] = value, slope
        # A line that was cut off goes.
        whole = "".join(line + "\n" for line in kept or [json.dumps(box)])
        file.write_text(whole, encoding="utf-8")

    def _write(self, entry: dict[str, object]) -> None:
        if self._file is not None:
            with self._file.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(entry) + "\n")


def _is_whole(line: str) -> bool:
    """Whether a line was not cut off when the search was killed."""
    try:
        return isinstance(json.loads(line), dict)
    except json.JSONDecodeError:
        return False
