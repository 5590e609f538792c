"""What to make small. Numbers of order one: micrometres and megapascals, not SI."""

import abc
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

import jaxgear as jg


def as_scalar(value: object) -> Array:
    """A real array of a number that a field was given.

    **Arguments:**

    - `value`: the number, or an array of numbers.
    """
    return jnp.asarray(value, dtype=float)


class AbstractObjective(eqx.Module):
    """A differentiable number of one settled mesh cycle."""

    @abc.abstractmethod
    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Judge a cycle.

        **Arguments:**

        - `model`: that was solved.
        - `cycle`: its settled states.
        - `law`: with which they were found.

        **Returns:**

        The number to make small, in the unit that the class states.
        """


class TransmissionErrorVariance(AbstractObjective):
    """Square of the RMS of the transmission error, in um2: smooth where the RMS has a cone.

    It is a sum of squares, those of its `residuals`.
    """

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the variance [um2]."""
        del law
        error = jg.transmission_error(model.pair, cycle)
        return jg.cycle_variance(cycle, error) / jg.um**2

    def residuals(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, " phase"]:
        """Deviations from the mean, weighted by the time that each phase stands for [um]."""
        del law
        error = jg.transmission_error(model.pair, cycle)
        weight = jnp.sqrt(cycle.cells.lines.weight)
        return weight * (error - jg.cycle_mean(cycle, error)) / jg.um


class TransmissionErrorRms(AbstractObjective):
    """RMS of the transmission error, in um, with the cone at zero rounded: for weighted sums.

    **Fields:**

    - `width`: value at a constant transmission error, where the RMS itself is zero [m].
    """

    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=0.01 * jg.um)

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the rounded RMS [um]."""
        del law
        error = jg.transmission_error(model.pair, cycle)
        return jnp.sqrt(jg.cycle_variance(cycle, error) + self.width**2) / jg.um


class TransmissionErrorHarmonics(AbstractObjective):
    r"""Chosen mesh harmonics of the transmission error: $\frac12\sum_k A_k^2$, in um2.

    It is their part of the variance: that of all harmonics is the whole.

    **Fields:**

    - `orders`: the harmonics of the mesh frequency, from 1.
    """

    orders: tuple[int, ...] = eqx.field(static=True)

    def __check_init__(self):
        if not self.orders or min(self.orders) < 1:
            raise ValueError(f"`orders` must be harmonics from 1, got {self.orders}.")

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return their part of the variance [um2]."""
        del law
        lines = cycle.cells.lines
        error = jg.transmission_error(model.pair, cycle)
        weighted = lines.weight * (error - jg.cycle_mean(cycle, error)) / jg.um
        angle = 2.0 * jnp.pi * jnp.asarray(self.orders, float)[:, None] * lines.phase[None, :]
        # Cosine and sine parts of each, half an amplitude long: smooth where one vanishes.
        halves = jnp.stack([jnp.cos(angle), jnp.sin(angle)]) @ weighted
        return 2.0 * jnp.sum(halves**2)


class TransmissionErrorRange(AbstractObjective):
    """Peak to peak of the transmission error, in um, smoothed.

    **Fields:**

    - `width`: of the smooth maximum and minimum [m].
    """

    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=0.02 * jg.um)

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the range [um]."""
        del law
        error = jg.transmission_error(model.pair, cycle)
        return jg.smooth_peak_to_peak(error, self.width) / jg.um


class LargestPressure(AbstractObjective):
    """Largest Hertzian pressure on the flanks, in MPa, smoothed.

    **Fields:**

    - `width`: of the smooth maximum [Pa].
    """

    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=5.0 * jg.MPa)

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the pressure [MPa]."""
        pressure = jg.hertz_pressure(model.pair, cycle, law)
        return jg.smooth_maximum(pressure, self.width) / jg.MPa


class FaceLoadFactor(AbstractObjective):
    r"""Face load factor $K_{H\beta}$: largest over mean load per face width, smoothed.

    The load of each slice is its mean over the cycle, so a maximum at one phase counts little.

    **Fields:**

    - `width`: of the smooth maximum over the slices, relative to the mean load [-].
    """

    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=0.01)

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the factor [-]."""
        del model, law
        return jg.smooth_face_load_factor(cycle, self.width)


class WeightedSum(AbstractObjective):
    """Several objectives at once, each in its own unit.

    **Fields:**

    - `parts`: the objectives.
    - `weights`: of each, over the unit of the part [-].
    """

    parts: tuple[AbstractObjective, ...]
    weights: Float[Array, " part"] = eqx.field(converter=as_scalar)

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the weighted sum [-]."""
        values = [part(model, cycle, law) for part in self.parts]
        return jnp.sum(self.weights * jnp.stack(values))


def prepare_torques(
    model: jg.PairModel, torques: Float[Array, " torque"], grid: jg.MeshGrid
) -> jg.PreparedMesh:
    """Prepare the mesh for several torques at once.

    **Arguments:**

    - `model`: whose own torque and flanks are not looked at.
    - `torques`: on the pinion [N m].
    - `grid`: phases, lines and slices.

    **Returns:**

    The prepared meshes, stacked.
    """
    return jax.vmap(lambda torque: jg.prepare_mesh(_loaded(model, torque), grid))(torques)


def _loaded(model: jg.PairModel, torque: Array) -> jg.PairModel:
    return eqx.tree_at(lambda m: m.torque, model, torque)


def over_torques(
    model_of: Callable[[Array], jg.PairModel],
    objective: AbstractObjective,
    torques: Float[Array, " torque"],
    *,
    grid: jg.MeshGrid,
    law: jg.AbstractContactLaw,
    worst: bool = False,
    prepared: jg.PreparedMesh | None = None,
    batched: bool = True,
) -> Callable[[Float[Array, " variable"]], Float[Array, ""]]:
    """The objective of a design as a function of its variables.

    **Arguments:**

    - `model_of`: builds the model from the variables, traceable by JAX.
    - `objective`: of one cycle.
    - `torques`: on the pinion, over which the objective is taken [N m].
    - `grid`: phases, lines and slices.
    - `law`: contact law of the cycles.
    - `worst`: whether the largest counts instead of the mean.
    - `prepared`: from `prepare_torques`, where the variables change nothing but flanks and
        misalignment; every evaluation is then several times cheaper.
    - `batched`: whether all torques are solved at once: faster, but for objectives whose own solver
        takes more steps at one torque than at another, as harmonic balance does.

    **Returns:**

    A function that `jax.grad` and `jax.vmap` accept, in the unit of the objective; NaN where a
    cycle was not solved. With `worst` its slope jumps where two torques are equally bad.
    """

    at_torques = _at_torques(model_of, objective, torques, grid, law, prepared, batched)

    def value(variables: Float[Array, " variable"]) -> Float[Array, ""]:
        values = at_torques(variables)
        return jnp.max(values) if worst else jnp.mean(values)

    return value


def residuals_over_torques(
    model_of: Callable[[Array], jg.PairModel],
    torques: Float[Array, " torque"],
    *,
    grid: jg.MeshGrid,
    law: jg.AbstractContactLaw,
    prepared: jg.PreparedMesh | None = None,
) -> Callable[[Float[Array, " variable"]], Float[Array, " residual"]]:
    """Residuals whose squares sum to the mean variance of the transmission error over torques.

    **Arguments:**

    - `model_of`, `torques`, `grid`, `law`, `prepared`: as of `over_torques`.

    **Returns:**

    A function for `least_squares`, in um; NaN where a cycle was not solved.
    """
    residuals = TransmissionErrorVariance().residuals
    at_torques = _at_torques(model_of, residuals, torques, grid, law, prepared, batched=True)
    return lambda variables: at_torques(variables).ravel() / jnp.sqrt(float(torques.size))


def responses_over_torques(
    model_of: Callable[[Array], jg.PairModel],
    objective: AbstractObjective,
    limited: Sequence[AbstractObjective],
    torques: Float[Array, " torque"],
    *,
    grid: jg.MeshGrid,
    law: jg.AbstractContactLaw,
    worst: bool = False,
    prepared: jg.PreparedMesh | None = None,
    batched: bool = True,
) -> Callable[[Float[Array, " variable"]], Float[Array, " response"]]:
    """An objective, and responses that have limits, of the same cycles.

    **Arguments:**

    - `limited`: the responses; of each the largest over the torques counts.
    - others: as of `over_torques`.

    **Returns:**

    A function for `constrained`: the objective first.
    """

    def judge(model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw) -> Array:
        return jnp.stack([each(model, cycle, law) for each in (objective, *limited)])

    at_torques = _at_torques(model_of, judge, torques, grid, law, prepared, batched)

    def value(variables: Float[Array, " variable"]) -> Float[Array, " response"]:
        values = at_torques(variables)
        first = jnp.max(values[:, 0]) if worst else jnp.mean(values[:, 0])
        return jnp.concatenate([first[None], jnp.max(values[:, 1:], axis=0)])

    return value


def _at_torques(
    model_of: Callable[[Array], jg.PairModel],
    judge: Callable[[jg.PairModel, jg.MeshCycle, jg.AbstractContactLaw], Array],
    torques: Array,
    grid: jg.MeshGrid,
    law: jg.AbstractContactLaw,
    prepared: jg.PreparedMesh | None,
    batched: bool,
) -> Callable[[Array], Array]:
    """What is judged of the cycle at each torque, NaN where it was not solved."""

    def values(variables: Array) -> Array:
        model = model_of(variables)

        def at_torque(mesh: jg.PreparedMesh, torque: Array) -> Array:
            own = _loaded(model, torque)
            cycle = jg.corrected_cycle(mesh, own, law=law)
            return jnp.where(jnp.all(cycle.converged), judge(own, cycle, law), jnp.nan)

        meshes = prepare_torques(model, torques, grid) if prepared is None else prepared
        if batched:
            return jax.vmap(at_torque)(meshes, torques)
        return jax.lax.map(lambda both: at_torque(*both), (meshes, torques))

    return values
