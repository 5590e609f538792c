r"""Linear equations solved by products alone: GMRES (Saad and Schultz 1986).

In JAX's own each new direction is made orthogonal to room for all directions, twice: of a response
that needs a dozen of 200 that is nearly all the work. Here it is made so to the directions there
are, once, a block of them after the other. Modified Gram-Schmidt loses orthogonality no sooner
than the residual is met (Paige, Rozložník and Strakoš 2006), with blocks too (Jalby and Philippe
1991).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxgear._dynamics._types import Count
from jaxgear._types import Flag, Reals, Scalar


class _Directions(eqx.Module):
    """Orthonormal directions, and least squares on them.

    **Fields:**

    - `count`: of directions that the solution may take [-].
    - `all`: directions, in rows; of those not found yet zeros [-].
    - `products`: of the directions along them, turned to a triangle; in rows [-].
    - `turn`: what turns them [-].
    - `left`: the residual along the turned directions, last what is left of it; in the unit of
        the right-hand side, of imbalance [-].
    """

    count: Count
    all: Reals
    products: Reals
    turn: Reals
    left: Reals

    @property
    def error(self) -> Scalar:
        """Norm of the residual."""
        return jnp.abs(self.left[self.count])


# Directions that are looked at at once.
_BLOCK = 16


def gmres(
    product: Callable[[Reals], Reals],
    right: Reals,
    left: Scalar | float,
    *,
    blocks: int,
    anew: int,
) -> tuple[Reals, Reals]:
    """Solve linear equations whose matrix is known by its products.

    The iteration has no derivative of its own: see `jax.lax.custom_linear_solve`.

    **Arguments:**

    - `product`: of the matrix and a vector.
    - `right`: the right-hand side, a vector.
    - `left`: norm of the residual at which it is solved, over that of the right-hand side [-].
    - `blocks`: of 16 directions that are kept.
    - `anew`: how often it begins, each time from what is found.

    **Returns:**

    The solution and its residual: the right-hand side less the product.
    """
    least, most = left * jnp.linalg.norm(right), blocks * _BLOCK

    def unfinished(state: tuple[Count, Reals, Reals]) -> Flag:
        times, _, residual = state
        return (times < anew) & (jnp.linalg.norm(residual) > least)

    def again(state: tuple[Count, Reals, Reals]) -> tuple[Count, Reals, Reals]:
        times, found, residual = state
        found = found + _change(product, residual, least, most)
        return times + 1, found, right - product(found)

    # What is no number has no solution either: zero would hide it.
    start = jnp.asarray(0), 0.0 * right, right
    return jax.lax.while_loop(unfinished, again, start)[1:]


def _change(product: Callable[[Reals], Reals], residual: Reals, least: Scalar, most: int) -> Reals:
    """Change of the solution that leaves so little of a residual, or the best there is."""
    size = jnp.linalg.norm(residual)
    first = _Directions(
        count=jnp.asarray(0),
        all=jnp.zeros((most, residual.size)).at[0].set(residual / size),
        products=jnp.zeros((most, most)),
        turn=jnp.eye(most),
        left=jnp.zeros(most).at[0].set(size),
    )
    on = lambda known: (known.error > least) & (known.count < most - 1)
    known = jax.lax.while_loop(on, lambda known: _with_another(product, known), first)
    used = jnp.arange(most) < known.count
    triangle = jnp.where(used[:, None] & used[None, :], known.products.T, jnp.eye(most))
    share = jax.scipy.linalg.solve_triangular(triangle, jnp.where(used, known.left, 0.0))
    return share @ known.all


def _with_another(product: Callable[[Reals], Reals], known: _Directions) -> _Directions:
    """The directions and one more: the product of the last, less what they have of it."""
    count = known.count
    new, along = _apart(known, product(known.all[count]))
    size = jnp.linalg.norm(new)
    # A rotation of the last two leaves nothing below the triangle.
    turned = known.turn @ along
    radius = jnp.hypot(turned[count], size)
    cosine, sine = turned[count] / radius, size / radius
    last, rest = known.turn[count], known.left[count]
    unit = known.turn[count + 1]
    return _Directions(
        count=count + 1,
        # Nothing new: the solution is among the directions there are.
        all=known.all.at[count + 1].set(jnp.where(size > 0.0, new / size, 0.0)),
        products=known.products.at[count].set(turned.at[count].set(radius)),
        turn=known.turn.at[count]
        .set(cosine * last + sine * unit)
        .at[count + 1]
        .set(cosine * unit - sine * last),
        left=known.left.at[count].set(cosine * rest).at[count + 1].set(-sine * rest),
    )


def _apart(known: _Directions, new: Reals) -> tuple[Reals, Reals]:
    """What a vector has beside the directions, and its parts along them."""

    def beside(place: Count, state: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        new, along = state
        start = place * _BLOCK
        block = jax.lax.dynamic_slice_in_dim(known.all, start, _BLOCK)
        parts = block @ new
        return new - parts @ block, jax.lax.dynamic_update_slice_in_dim(along, parts, start, 0)

    blocks = known.count // _BLOCK + 1
    return jax.lax.fori_loop(0, blocks, beside, (new, jnp.zeros(known.left.size)))
