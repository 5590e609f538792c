r"""Condensed bodies of one shape at several of its measures, and every body between them.

Finite elements have no derivative by a measure such as the thickness of a web. But what teeth in
mesh feel of bodies in statics, the tables of `FlexibleBody`, is a smooth function of it: the
polynomial through a few bodies gives the tables in between, and their derivatives. With the
reciprocal of a thickness as coordinate, membranes ($1/t$) and plates ($1/t^3$) are polynomials
themselves. Bodies that were condensed for that purpose only say by how much it is off.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._system._body_heat import BodyHeat
from jaxgear._system._flexible import FlexibleBody
from jaxgear._types import Reals, Scalar

# Of the span of the measures: how far beyond its ends a point may be, so that differences can be
# taken at an end. The polynomial is as good there as between.
_BEYOND = 0.02


class BodyFamily(eqx.Module):
    """Condensed bodies as a function of one measure of their shape, for statics.

    **Fields:**

    - `parameters`: measures of the bodies, rising: numbers in the unit that they were given in [-].
    - `bodies`: their tables, one above the other.
    - `interpolation_error`: of the tables between the bodies, by `table_difference` from those of
        bodies that were condensed there [-].
    - `reciprocal`: whether the coordinate is the reciprocal of the measure.
    """

    parameters: Reals
    bodies: FlexibleBody
    interpolation_error: float = eqx.field(static=True)
    reciprocal: bool = eqx.field(static=True)

    def __call__(self, parameter: Scalar | float) -> FlexibleBody:
        """The body of a measure between those of the family, or beyond by 2 % of their span.

        **Arguments:**

        - `parameter`: the measure, in the unit of `parameters`.

        **Returns:**

        Its tables, without modes; differentiable. What is traced further beyond the family is not
        a number.

        **Raises:**

        - `ValueError` if the measure is further beyond the family: nothing is extrapolated.
        """
        at = jnp.asarray(parameter, dtype=float)
        low, high = self.parameters[0], self.parameters[-1]
        slack = _BEYOND * (high - low)
        inside = (low - slack <= at) & (at <= high + slack)
        require(
            inside,
            "A body family from {low:.6g} to {high:.6g} was asked for {got:.6g}: nothing is "
            "extrapolated. Condense bodies up to there.",
            low=low,
            high=high,
            got=at,
        )
        return _between(self, at, inside)


def family_parameters(
    low: float, high: float, count: int, *, reciprocal: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Measures at which to condense the bodies of a family, and bodies to check it with.

    **Arguments:**

    - `low`, `high`: ends of the family, in any unit.
    - `count`: of its bodies, three or more.
    - `reciprocal`: whether the coordinate is the reciprocal of the measure.

    **Returns:**

    Chebyshev's points from end to end, rising; and the points between that are furthest from them,
    one on either side of the middle, where the polynomial is worst.

    **Raises:**

    - `ValueError` if the ends do not rise, or not from above 0 for their reciprocals, or if there
        are too few bodies.
    """
    require(
        count >= 3 and low < high and (low > 0.0 or not reciprocal),
        "A body family must have three or more bodies and ends that rise, above 0 for reciprocals, "
        "got {count} from {low:.6g} to {high:.6g}.",
        count=count,
        low=low,
        high=high,
    )
    ends = (1.0 / low, 1.0 / high) if reciprocal else (low, high)
    middle, half = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
    points = -np.cos(np.pi * np.arange(count) / (count - 1))
    between = 0.5 * (points[1:] + points[:-1])
    away = np.abs(np.prod(between[:, None] - points, axis=1))
    # Of equal ones by symmetry both, one on either side.
    worst = abs(round(float(between[int(np.argmax(away))]), 12))
    checks = np.unique([-worst, worst])
    found = [middle + half * each for each in (points, checks)]
    nodes, probes = (np.sort(1.0 / each if reciprocal else each) for each in found)
    nodes[0], nodes[-1] = low, high
    return nodes, probes


def body_family(
    parameters: Sequence[float] | np.ndarray,
    bodies: Sequence[FlexibleBody],
    *,
    checks: Sequence[tuple[float, FlexibleBody]],
    reciprocal: bool = False,
    most: float = 0.01,
) -> BodyFamily:
    """Interpolate between condensed bodies of one shape. Call it outside of `jit` (theory 12.4).

    **Arguments:**

    - `parameters`: a measure of each body, rising, in any unit; `family_parameters` chooses well.
    - `bodies`: for the same gear and grid, from `flexible_body`; modes are left behind.
    - `checks`: measures between them, and the bodies that were condensed there.
    - `reciprocal`: whether the coordinate is the reciprocal of the measure, as for a thickness.
    - `most`: largest error that is accepted [-].

    **Returns:**

    The family, which says its error.

    **Raises:**

    - `ValueError` if there are too few bodies, or no checks, if bodies do not belong together, or
        if the family is off by more than accepted.
    """
    at = np.asarray(parameters, dtype=float)
    require(
        at.size == len(bodies) >= 3 and bool(np.all(np.diff(at) > 0.0)) and len(checks) > 0,
        "A body family must have three or more bodies of rising measures, and one or more to check "
        "it with, got {bodies} bodies for {count} measures and {checks} checks.",
        bodies=len(bodies),
        count=at.size,
        checks=len(checks),
    )
    require(
        not reciprocal or float(at[0]) > 0.0,
        "The measures of a body family must be above 0 for their reciprocals, got {got:.6g}.",
        got=at[0],
    )
    still = [eqx.tree_at(lambda b: b.modes, body, None, is_leaf=_is_none) for body in bodies]
    alike = {str(jax.tree.structure(body)) for body in still}
    shapes = {tuple(leaf.shape for leaf in jax.tree.leaves(body)) for body in still}
    require(
        len(alike) == len(shapes) == 1,
        "The bodies of a family must be of one gear with the same seats, slices, lines and "
        "periods. Make all of them with `flexible_body` from the same grid.",
    )
    stacked = _stacked(*still)
    family = BodyFamily(jnp.asarray(at), stacked, 0.0, reciprocal)
    errors = [table_difference(family(place), body) for place, body in checks]
    worst = int(np.argmax(errors))
    require(
        errors[worst] <= most,
        "A body family must be off by {most:.3g} at most, got {got:.3g} at {at:.6g}, between "
        "bodies at {known}. Narrow its ends, or take more bodies; condensed from grids of their "
        "own, bodies also differ by these.",
        most=most,
        got=errors[worst],
        at=checks[worst][0],
        known=", ".join(f"{each:.6g}" for each in at),
    )
    return BodyFamily(family.parameters, stacked, float(errors[worst]), reciprocal)


@compiled
def _between(family: BodyFamily, at: Scalar, inside: Array) -> FlexibleBody:
    """The body at one place, not a number outside of the family."""
    coordinate = lambda parameter: 1.0 / parameter if family.reciprocal else parameter
    shares = _shares(coordinate(family.parameters), coordinate(at))
    shares = jnp.where(inside, shares, jnp.nan)
    return jax.tree.map(lambda each: jnp.tensordot(shares, each, axes=1), family.bodies)


def _is_none(x: object) -> bool:
    return x is None


@compiled
def _stacked(*bodies: FlexibleBody) -> FlexibleBody:
    return jax.tree.map(lambda *each: jnp.stack(each), *bodies)


def _shares(points: Array, at: Array) -> Array:
    """Lagrange's polynomials through points, at one place."""
    count = points.size
    own = jnp.eye(count, dtype=bool)
    above = jnp.where(own, 1.0, at - points[None, :])
    below = jnp.where(own, 1.0, points[:, None] - points[None, :])
    return jnp.prod(above / below, axis=1)


def table_difference(first: FlexibleBody, second: FlexibleBody) -> float:
    """How far two bodies are apart, as teeth and bearings in mesh feel them.

    Compliances and stiffnesses count against the roots of their diagonals; how the feet follow the
    seats against motions of a rigid body; growth against the largest, a rotation by what it moves
    at the rim; loads of rotation on the seats against those that so much growth would take.

    **Arguments:**

    - `first`: a body.
    - `second`: one that it is compared with, of the same gear and grid.

    **Returns:**

    The largest relative difference [-].
    """
    one, other = (jax.tree.map(np.asarray, each) for each in (first, second))
    size = np.sqrt(np.einsum("paaii->pai", other.flexibility))
    scale = size[:, :, None, :, None] * size[:, None, :, None, :]
    turns = np.arange(other.seat_load.size) % 6 >= 3
    radius = float(np.linalg.norm(other.centres, axis=-1).max())
    # Unit motions of feet and seats: a rotation is one that moves the rim as far.
    of_foot = np.where(np.asarray(other.components) >= 3, 1.0 / radius, 1.0)[:, None]
    of_seat = np.where(turns, radius, 1.0)
    # A body of one seat has no stiffness between seats: that of its feet is the measure.
    least = of_seat / size[:, np.asarray(other.components) < 3].max()
    stiff = np.maximum(np.sqrt(np.maximum(np.diagonal(other.seat_stiffness), 0.0)), least)
    growth = float(np.abs(other.growth / of_foot).max())
    load = stiff * stiff[~turns].max() * growth
    parts = [
        np.abs(one.flexibility - other.flexibility) / scale,
        np.abs(one.seat_stiffness - other.seat_stiffness) / np.outer(stiff, stiff),
        np.abs(one.from_seats - other.from_seats) / (of_foot[:, :, None] * of_seat),
        # What does not turn with a load of rotation does not grow.
        np.abs(one.growth - other.growth) / of_foot / (growth or 1.0),
        np.abs(one.seat_load - other.seat_load) / np.where(load > 0.0, load, 1.0),
    ]
    if one.heat is not None and other.heat is not None:
        parts += _heat_difference(one.heat, other.heat, of_foot, stiff * stiff[~turns].max())
    return float(max(part.max() for part in parts))


def _heat_difference(
    one: BodyHeat, other: BodyHeat, of_foot: np.ndarray, stiff: np.ndarray
) -> list[np.ndarray]:
    """Growth by heat against the largest, loads on the seats against those so much would take."""
    growth = float(np.abs(other.feet / of_foot[..., None]).max())
    return [
        np.abs(one.feet - other.feet) / of_foot[..., None] / growth,
        np.abs(one.seats - other.seats) / (stiff[:, None] * growth),
    ]
