"""Comparisons that refuse to pass for the wrong reason.

A comparison that cannot fail is a `ValueError`: the test is wrong. One that does fail is an
`AssertionError`: the code under test is wrong.
"""

from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, PyTree
from numpy.typing import ArrayLike

_EPSILON = float(np.finfo(np.float64).eps)

# A rounding error of the function, in units of its last digit. Sums over a few thousand cells
# stay below it.
_ROUNDING = 10 * _EPSILON


def assert_close(actual: PyTree, desired: PyTree, *, rtol: float, atol: float) -> None:
    """Compare two pytrees. Both tolerances are required: a default is a guess.

    Structure, shapes and precisions must agree; a number counts as the array that it makes. All is
    compared in NumPy, which compiles no program for a shape. To compare with zero, give zeros: an
    absolute tolerance above every desired value is refused, as it would let anything of that size
    pass.

    **Arguments:**

    - `actual`, `desired`: pytrees of numbers and arrays.
    - `rtol`: tolerance relative to each desired value [-].
    - `atol`: absolute tolerance, in the unit of the values.

    **Raises:**

    - `AssertionError` if the two differ.
    - `ValueError` if a tolerance is meaningless, or a desired value is not a number.
    """
    actual, desired = _as_arrays(actual), _as_arrays(desired)
    largest = max((_magnitude(x) for x in jax.tree.leaves(desired)), default=0.0)
    if not (0 <= rtol < 1e-1 and 0 <= atol < (largest or np.inf)):
        raise ValueError(f"A tolerance must mean something, got {rtol=}, {atol=}, {largest=}.")
    assert eqx.tree_equal(actual, desired, rtol=rtol, atol=atol, typematch=True), (
        f"\n  actual  {actual}\n  desired {desired}\n  rtol {rtol}, atol {atol}"
    )


def assert_gradient(
    function: Callable[[Any], Array],
    argument: PyTree,
    *,
    rtol: float,
    step: float = 1e-5,
    scale: PyTree | None = None,
) -> None:
    """Compare reverse, forward and central differences along one direction.

    Every real leaf of the argument moves, up or down by a fixed draw, in proportion to its own
    size: a module is 1e-3 m and a pressure angle 0.35 rad, and one common step would suit neither.

    **Arguments:**

    - `function`: takes the argument and returns a real scalar.
    - `argument`: a pytree. Its real arrays are differentiated, everything else is fixed.
    - `rtol`: tolerance relative to the directional derivative [-].
    - `step`: step of the central difference, relative to the size of each leaf [-].
    - `scale`: the argument's pytree with the size of each leaf in its place, in the leaf's own
        unit. By default the largest magnitude in the leaf, which a leaf of zeros does not have.

    **Raises:**

    - `AssertionError` if two of the three derivatives differ.
    - `ValueError` if nothing is differentiated, if a real number is hidden from
        differentiation, if a leaf has no size, or if the direction is flat.
    """
    if not (0 < rtol < 1e-1 and 0 < step < 1e-1):
        raise ValueError(f"A tolerance and a step must mean something, got {rtol=}, {step=}.")
    direction = _direction(argument, argument if scale is None else scale)
    moved, fixed = eqx.partition(argument, eqx.is_inexact_array)

    # Value and both derivatives in one program: it is traced and compiled once. All numbers are its
    # arguments: with constants the compiler would compute.
    @jax.jit
    def evaluated(moved: PyTree, direction: PyTree, distance: Array) -> tuple[Array, Array, Array]:
        at = eqx.apply_updates(moved, _scaled(direction, distance))
        value, push = jax.linearize(lambda x: function(eqx.combine(x, fixed)), at)
        # In a function of its own: of what has no name JAX prints all that was traced.
        pull = jax.linear_transpose(lambda x: push(x), at)
        (gradient,) = pull(jnp.ones_like(value))
        parts = zip(jax.tree.leaves(gradient), jax.tree.leaves(direction), strict=True)
        found = sum((jnp.vdot(slope, part) for slope, part in parts), jnp.zeros(()))
        return value, push(direction), found

    at = lambda by: [float(x) for x in evaluated(moved, direction, jnp.asarray(by))]
    ahead, behind = (at(by)[0] for by in (step, -step))
    central = (ahead - behind) / (2 * step)
    forward, reverse = at(0.0)[1:]

    found = f"\n  reverse {reverse:.12g}\n  forward {forward:.12g}\n  central {central:.12g}"
    assert np.isfinite([reverse, forward, central]).all(), found
    largest = max(abs(reverse), abs(forward), abs(central))
    rounding = _ROUNDING * max(abs(ahead), abs(behind)) / step
    if rtol * largest <= rounding:
        raise ValueError(
            f"The direction is flat: central differences are uncertain by {rounding:.3g}, which is "
            f"not below rtol = {rtol} of the derivative.{found}\nDifferentiate something that "
            "depends on the argument, or raise `rtol` or `step`."
        )
    assert max(reverse, forward, central) - min(reverse, forward, central) <= rtol * largest, (
        f"{found}\n  rtol {rtol}"
    )


def observed_order(
    sizes: ArrayLike, errors: ArrayLike, *, floor: float = 1e-13, bend: float = 0.1
) -> float:
    """Slope of log error over log size.

    **Arguments:**

    - `sizes`: step or grid sizes, at least three different ones.
    - `errors`: the *relative* error at each size [-].
    - `floor`: the error below which rounding rules [-].
    - `bend`: how far a point may lie off the line, as a factor: 0.1 is 10 % of the error [-].

    **Returns:**

    The order [-].

    **Raises:**

    - `AssertionError` if an error is at the rounding floor or off the line.
    - `ValueError` if no line can be drawn through what was given.
    """
    sizes_, errors_ = np.asarray(sizes, dtype=float), np.asarray(errors, dtype=float)
    if sizes_.ndim != 1 or sizes_.shape != errors_.shape or len(set(sizes_)) < 3:
        raise ValueError(f"Give one error for each of three sizes or more, got {sizes}, {errors}.")
    if not ((sizes_ > 0) & np.isfinite(sizes_)).all():
        raise ValueError(f"Sizes must be positive, got {sizes}.")
    assert (np.isfinite(errors_) & (errors_ > floor)).all(), (
        f"errors at the rounding floor of {floor}, or not finite: {errors_}"
    )
    slope, offset = np.polyfit(np.log(sizes_), np.log(errors_), 1)
    off = np.abs(np.log(errors_) - slope * np.log(sizes_) - offset)
    assert (off <= np.log1p(bend)).all(), (
        f"errors {errors_} at sizes {sizes_} lie up to a factor {np.exp(off.max()):.3g} off a line "
        f"of slope {slope:.3g}"
    )
    return float(slope)


def _as_arrays(tree: PyTree) -> PyTree:
    """The tree with every number and array made a NumPy array."""
    numbers = (int, float, complex, np.ndarray, np.generic, jax.Array)
    return jax.tree.map(lambda x: np.asarray(x) if isinstance(x, numbers) else x, tree)


def _magnitude(leaf: object) -> float:
    """Largest magnitude in an array; zero for anything else and for an empty array."""
    if not isinstance(leaf, np.ndarray) or leaf.size == 0:
        return 0.0
    return float(np.max(np.abs(leaf)))


def _direction(argument: PyTree, sizes: PyTree) -> PyTree:
    """One signed size per entry of each real array of the argument, `None` elsewhere."""
    for leaf in jax.tree.leaves(argument):
        if eqx.is_inexact_array_like(leaf) and not eqx.is_inexact_array(leaf):
            raise ValueError(f"A {type(leaf).__name__} gets no gradient; make {leaf!r} an array.")
    moving = eqx.filter(argument, eqx.is_inexact_array)
    leaves, structure = jax.tree.flatten(moving)
    if not any(leaf.size for leaf in leaves):
        raise ValueError("Nothing to differentiate: the argument holds no real array.")
    size_leaves = jax.tree.leaves(eqx.filter(_as_arrays(sizes), _is_real))
    draw = np.random.default_rng(20)
    parts = []
    for leaf, size in zip(leaves, size_leaves, strict=True):
        if leaf.size and not 0 < _magnitude(size) < np.inf:
            raise ValueError("A leaf of zeros has no size of its own; give one by `scale`.")
        signs = draw.choice((-1.0, 1.0), leaf.shape) * draw.uniform(0.5, 1.0, leaf.shape)
        parts.append(jnp.asarray(_magnitude(size) * signs, dtype=leaf.dtype))
    return jax.tree.unflatten(structure, parts)


def _is_real(leaf: object) -> bool:
    return isinstance(leaf, np.ndarray) and bool(np.issubdtype(leaf.dtype, np.inexact))


def _scaled(tree: PyTree, factor: ArrayLike) -> PyTree:
    return jax.tree.map(lambda x: factor * x, tree)


def quick(count: int, variants: Iterable[Any]) -> list[Any]:
    """Variants of a test, of which the first few run always and the others among the slow tests."""
    marked = lambda each: pytest.param(*_tuple(each), marks=pytest.mark.slow)
    return [each if i < count else marked(each) for i, each in enumerate(variants)]


def _tuple(variant: Any) -> tuple[Any, ...]:
    return variant if isinstance(variant, tuple) else (variant,)
