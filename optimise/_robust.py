r"""Designs for gears as they are made: objectives over scattered deviations, by quasi-Monte Carlo.

The scatter is drawn once, from Sobol's sequence; what is minimised is then a deterministic,
differentiable number of the same sample.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

import jaxgear as jg
from optimise._objectives import as_scalar
from optimise._strategies import sobol

Scattered = Callable[[Float[Array, " variable"], Float[Array, " quantity"]], Float[Array, ""]]


class Quantity(NamedTuple):
    """Something that scatters.

    **Fields:**

    - `name`: for pictures and messages.
    - `mean`: in its own unit [-].
    - `deviation`: standard deviation, in its own unit [-].
    - `even`: whether it is as likely anywhere within $\\sqrt3$ standard deviations, and nowhere
        else; or normal.
    """

    name: str
    mean: float
    deviation: float
    even: bool = False


def sample(quantities: Sequence[Quantity], count: int, seed: int = 0) -> np.ndarray:
    """Draw samples of several quantities, independent of each other.

    **Arguments:**

    - `quantities`: that scatter.
    - `count`: of samples, a power of two.
    - `seed`: of the scrambling: another one gives fresh samples.

    **Returns:**

    Shape `[sample, quantity]`, in the units of the quantities.

    **Raises:**

    - `ValueError` if the number of samples is no power of two.
    """
    unit = sobol(len(quantities), count, seed)
    columns = []
    for place, each in zip(unit.T, quantities, strict=True):
        normal = scipy.special.ndtri(np.clip(place, 1e-12, 1.0 - 1e-12))
        even = np.sqrt(3.0) * (2.0 * place - 1.0)
        columns.append(each.mean + each.deviation * (even if each.even else normal))
    return np.stack(columns, axis=1)


class AbstractMeasure(eqx.Module):
    """One number for a sample of values."""

    @abc.abstractmethod
    def __call__(self, values: Float[Array, " sample"]) -> Float[Array, ""]:
        """Judge a sample.

        **Arguments:**

        - `values`: one for each member.

        **Returns:**

        The number, in the unit of the values.
        """


class Mean(AbstractMeasure):
    """The mean of a sample."""

    def __call__(self, values: Float[Array, " sample"]) -> Float[Array, ""]:
        """Return the mean [unit of the values]."""
        return jnp.mean(values)


class Quantile(AbstractMeasure):
    r"""The value that a share of a sample stays below, smoothed (theory 12.5).

    It solves $\frac1n\sum_i\sigma((q - v_i)/w) = p$ with the logistic $\sigma$, the distribution of
    the sample widened by $w$; so it is differentiable, and has more than one member's slope.

    **Fields:**

    - `share`: $p$, between 0 and 1 [-].
    - `width`: $w$, in the unit of the values [-].
    """

    share: Float[Array, ""] = eqx.field(converter=as_scalar)
    width: Float[Array, ""] = eqx.field(converter=as_scalar)

    def __call__(self, values: Float[Array, " sample"]) -> Float[Array, ""]:
        """Return the quantile [unit of the values]."""
        below = lambda q, v: jnp.mean(jax.nn.sigmoid((q - v) / self.width)) - self.share
        # Outside of these ends every member is on one side of the share.
        tail = self.width * jnp.abs(jax.scipy.special.logit(self.share))
        still = jax.lax.stop_gradient(values)

        def halved(_, ends):
            low, high = ends
            middle = 0.5 * (low + high)
            under = below(middle, still) < 0.0
            return jnp.where(under, middle, low), jnp.where(under, high, middle)

        ends = jax.lax.fori_loop(
            0, _HALVINGS, halved, (jnp.min(still) - tail, jnp.max(still) + tail)
        )
        # A step of Newton's at the solution leaves it, and has the derivatives of the equation.
        q = jax.lax.stop_gradient(0.5 * (ends[0] + ends[1]))
        slope = jax.lax.stop_gradient(jax.grad(below)(q, still))
        return q - below(q, values) / slope


# Each halves the interval: more than the digits of a number.
_HALVINGS = 60


def over_samples(
    objective: Scattered,
    samples: np.ndarray,
    measure: AbstractMeasure,
    *,
    batch: int = 1,
) -> Callable[[Float[Array, " variable"]], Float[Array, ""]]:
    """A measure of an objective over a sample, as a function of the variables alone.

    **Arguments:**

    - `objective`: of the variables and of one member of the sample; traceable by JAX.
    - `samples`: from `sample`, `[sample, quantity]`.
    - `measure`: of the values, such as `Quantile`.
    - `batch`: members that are computed at once; on a CPU one after the other is often as fast, and
        takes less memory.

    **Returns:**

    A function that `jax.grad` accepts, in the unit of the objective.
    """
    drawn = jnp.asarray(samples, dtype=float)

    def value(variables: Float[Array, " variable"]) -> Float[Array, ""]:
        one = lambda sample: objective(variables, sample)
        if batch == 1:
            return measure(jax.lax.map(one, drawn))
        return measure(jax.lax.map(one, drawn, batch_size=batch))

    return value


Prepare = Callable[[Float[Array, " quantity"]], Any]
Judge = Callable[
    [Float[Array, " variable"], Float[Array, " quantity"], Any], Float[Array, " response"]
]


class Population(eqx.Module):
    """Gears that differ from each other, and what was prepared for each of them.

    A search changes none of this: what its variables leave alone is computed once, and kept once
    where it is the same for all.

    **Fields:**

    - `deviations`: of each member, in the units of the quantities [-].
    - `shared`: leaves of the prepared data that all members have in common, in their units [-].
    - `own`: the other leaves, stacked; the first axis is the member [-].
    """

    deviations: Float[Array, "member quantity"]
    shared: Any
    own: Any


def population(prepare: Prepare, samples: np.ndarray) -> Population:
    """Prepare the members of a sample, one after the other.

    **Arguments:**

    - `prepare`: from the deviations of one member to any arrays, such as its prepared mesh;
        traceable by JAX.
    - `samples`: from `sample`, `[sample, quantity]`.

    **Returns:**

    The members.
    """
    drawn = np.asarray(samples, dtype=float)
    compiled = jax.jit(prepare)
    first, structure = jax.tree.flatten(compiled(jnp.asarray(drawn[0])))
    common = [np.asarray(leaf) for leaf in first]
    others: dict[int, dict[int, np.ndarray]] = {}
    for member in range(1, len(drawn)):
        for place, leaf in enumerate(jax.tree.leaves(compiled(jnp.asarray(drawn[member])))):
            if not np.array_equal(leaf, common[place]):
                others.setdefault(place, {})[member] = np.asarray(leaf)
    stacks = {
        place: np.stack([given.get(member, common[place]) for member in range(len(drawn))])
        for place, given in others.items()
    }
    tree = lambda leaves: jax.tree.unflatten(structure, leaves)
    count = range(len(common))
    return Population(
        deviations=jnp.asarray(drawn),
        shared=tree([None if i in stacks else jnp.asarray(common[i]) for i in count]),
        own=tree([jnp.asarray(stacks[i]) if i in stacks else None for i in count]),
    )


def responses_of(
    judge: Judge, variables: Float[Array, " variable"], members: Population
) -> Float[Array, "member response"]:
    """What a design is like in each gear of a population; traceable by JAX.

    **Arguments:**

    - `judge`: of the variables, the deviations and the prepared data of one member.
    - `variables`: the design.
    - `members`: the gears.

    **Returns:**

    The responses, in their own units.
    """
    one = lambda drawn, own: judge(variables, drawn, eqx.combine(members.shared, own))
    return jg.over_batch(lambda both: one(*both), (members.deviations, members.own))


def population_statistics(
    judge: Judge, measures: Sequence[AbstractMeasure]
) -> Callable[
    [Float[Array, " variable"], Population],
    tuple[Float[Array, " response"], Float[Array, "response variable"]],
]:
    """Measures of responses over a population, with their slopes.

    Each member is differentiated by itself, so that the memory does not grow with their number.

    **Arguments:**

    - `judge`: of the variables, the deviations and the prepared data of one member.
    - `measures`: one for each response.

    **Returns:**

    A function of the design and the population, for `jax.jit`: values, and their slopes.
    """

    def both(variables: Array, members: Population) -> tuple[Array, Array]:
        def one(drawn: Array, own: Any) -> tuple[Array, Array]:
            prepared = eqx.combine(members.shared, own)
            return _sloped(lambda x: judge(x, drawn, prepared), variables, len(measures))

        each = (members.deviations, members.own)
        values, slopes = jg.over_batch(lambda member: one(*member), each)
        found = [
            jax.value_and_grad(measure)(values[:, place]) for place, measure in enumerate(measures)
        ]
        weights = jnp.stack([weight for _, weight in found], axis=1)
        return jnp.stack([value for value, _ in found]), jnp.einsum("nr,nrv->rv", weights, slopes)

    return both


def _sloped(
    function: Callable[[Array], Array], variables: Array, count: int
) -> tuple[Array, Array]:
    """Responses and their slopes: backward if there is one, forward if there are several."""
    if count == 1:
        value, slope = jax.value_and_grad(lambda x: function(x)[0])(variables)
        return value[None], slope[None]
    slopes, values = jax.jacfwd(lambda x: (function(x),) * 2, has_aux=True)(variables)
    return values, slopes


class Influence(eqx.Module):
    """What each scattered quantity changes by itself: the bars of a tornado chart.

    **Fields:**

    - `names`: of the quantities, the most influential first.
    - `nominal`: objective with all of them at their means, in its own unit [-].
    - `low`, `high`: objective with one of them a number of standard deviations down and up, in its
        own unit [-].
    """

    names: tuple[str, ...] = eqx.field(static=True)
    nominal: float
    low: np.ndarray
    high: np.ndarray


def influences(
    objective: Scattered,
    variables: np.ndarray,
    quantities: Sequence[Quantity],
    *,
    deviations: float = 2.0,
) -> Influence:
    """Move each scattered quantity alone, down and up.

    **Arguments:**

    - `objective`: of the variables and of one member of a sample; traceable by JAX.
    - `variables`: the design.
    - `quantities`: that scatter.
    - `deviations`: how far to move each, in standard deviations; one that is even moves within its
        bounds [-].

    **Returns:**

    The values, sorted by how much they span.
    """
    samples = one_at_a_time_sample(quantities, deviations=deviations)
    at = jnp.asarray(variables, dtype=float)
    run = jax.jit(lambda x, s: jax.lax.map(lambda sample: objective(x, sample), s))
    return ranked(quantities, np.asarray(run(at, jnp.asarray(samples))))


def one_at_a_time_sample(quantities: Sequence[Quantity], *, deviations: float = 2.0) -> np.ndarray:
    """The sample of `influences`: all at their means, then each alone down, then each alone up.

    **Arguments:**

    - `quantities`: that scatter.
    - `deviations`: as of `influences` [-].

    **Returns:**

    Shape `[1 + 2 quantities, quantity]`, in the units of the quantities.
    """
    means = np.asarray([each.mean for each in quantities], dtype=float)
    reach = [min(deviations, np.sqrt(3.0)) if each.even else deviations for each in quantities]
    moved = np.diag([r * each.deviation for r, each in zip(reach, quantities, strict=True)])
    return np.concatenate([means[None], means - moved, means + moved])


def ranked(quantities: Sequence[Quantity], values: np.ndarray) -> Influence:
    """Sort the values at the sample of `one_at_a_time_sample` by how much each quantity spans.

    **Arguments:**

    - `quantities`: that scatter.
    - `values`: of the objective, one for each member [-].

    **Returns:**

    The influences.
    """
    low, high = np.split(values[1:], 2)
    span = np.ptp(np.stack([low, np.full_like(low, values[0]), high]), axis=0)
    order = np.argsort(-span)
    return Influence(
        names=tuple(quantities[i].name for i in order),
        nominal=float(values[0]),
        low=low[order],
        high=high[order],
    )
