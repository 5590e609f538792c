"""What to make small in motion: numbers of steady responses, taken over a range of speeds."""

import abc
import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

import jaxgear as jg
from optimise._objectives import AbstractObjective, as_scalar


class AbstractResponse(eqx.Module):
    """A differentiable number of one steady response."""

    @abc.abstractmethod
    def __call__(
        self, dynamics: jg.PairDynamics, orbit: jg.Orbit, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Judge a response.

        **Arguments:**

        - `dynamics`: the pair.
        - `orbit`: its response at one speed.
        - `law`: with which it was found.

        **Returns:**

        The number, not negative, in the unit that the class states.
        """


class DynamicRatio(AbstractResponse):
    """Largest total contact force over the static one, smoothed.

    **Fields:**

    - `width`: of the smooth maximum, in static mesh forces [-].
    """

    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=0.02)

    def __call__(
        self, dynamics: jg.PairDynamics, orbit: jg.Orbit, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the ratio [-]."""
        return jg.smooth_dynamic_ratio(dynamics.system, orbit, self.width, law)


class DynamicErrorVariance(AbstractResponse):
    """Square of the RMS of the dynamic transmission error, in um2."""

    def __call__(
        self, dynamics: jg.PairDynamics, orbit: jg.Orbit, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the variance [um2]."""
        del law
        error = jg.dynamic_transmission_error(dynamics.system, orbit)
        return jg.orbit_variance(dynamics.system, error) / jg.um**2


class BearingForce(AbstractResponse):
    """What shakes the housing: RMS of the bearings' forces about their means, in N.

    The squares of all bearings, along S, T and Z, are summed: no bearing's share can hide.

    **Fields:**

    - `width`: value where nothing shakes, where the RMS itself has a cone [N].
    """

    width: Float[Array, ""] = eqx.field(converter=as_scalar, default=1.0)

    def __call__(
        self, dynamics: jg.PairDynamics, orbit: jg.Orbit, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the rounded RMS [N]."""
        del law
        force = jg.bearing_loads(dynamics, orbit)[:, :, :3]
        swing = force - jg.orbit_mean(dynamics.system, force)[None]
        square = jnp.sum(swing**2, axis=(1, 2))
        return jnp.sqrt(jg.orbit_mean(dynamics.system, square) + self.width**2)


class SpeedResults(eqx.Module):
    """A number at each speed, and which of them count.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `number`: of the response, in its own unit [-].
    - `settled`: whether Newton's method found the response.
    - `sensitivity`: of the response to the logarithm of the speed: its largest change, in static
        deflections [-].
    - `kept`: whether the speed counts: the response has settled, and is not close to a fold.
    """

    speed: Float[Array, " speed"]
    number: Float[Array, " speed"]
    settled: Bool[Array, " speed"]
    sensitivity: Float[Array, " speed"]
    kept: Bool[Array, " speed"]

    @property
    def left_out(self) -> Float[Array, " left"]:
        """Speeds that do not count; not for tracing [rad/s]."""
        return self.speed[~self.kept]


class OverSpeeds(AbstractObjective):
    r"""A number of the steady responses over several speeds, by harmonic balance.

    The response at each speed is the one that Newton's method reaches from the quasi-static states,
    each speed by itself. Where several exist, that is one of them, and it may be one that a
    machine leaves: a sweep in both directions shows it.

    At a fold a response ends, and its derivatives grow without bound. Speeds whose response has not
    settled, or is as sensitive to speed as near a fold, are left out; `judged` says which. What
    remains is combined by its power mean, $(\overline{r^p})^{1/p}$: the mean with $p = 1$, the
    worst with $p = \infty$. If fewer than `least_share` remain, the objective is NaN.

    **Fields:**

    - `response`: the number.
    - `speeds`: of the pinion [rad/s].
    - `grid`: time steps in a mesh period (`phases`) and slices.
    - `damping`: of the pair.
    - `method`: settings of harmonic balance; the contact law is that of the cycle. Exact contact is
        averaged over each time step if the method says so.
    - `most_sensitive`: sensitivity from which a response counts as close to a fold [-].
    - `least_share`: of the speeds that must count [-].
    - `power`: $p$, at least 1; may be infinite [-].
    - `gyroscopic`: whether gears and shafts that tilt while they spin feel it.
    - `active_mesh_damping`: whether the mesh damps only while it is in contact.
    """

    response: AbstractResponse
    speeds: Float[Array, " speed"]
    grid: jg.MeshGrid
    damping: jg.ModalDamping | jg.RayleighDamping = eqx.field(default_factory=jg.ModalDamping)
    method: jg.HarmonicBalance = eqx.field(
        default_factory=lambda: jg.HarmonicBalance(averaged=True)
    )
    most_sensitive: Float[Array, ""] = eqx.field(converter=as_scalar, default=100.0)
    least_share: Float[Array, ""] = eqx.field(converter=as_scalar, default=0.5)
    power: float = eqx.field(static=True, default=1.0)
    gyroscopic: bool = eqx.field(static=True, default=False)
    active_mesh_damping: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        if not self.power >= 1.0:
            raise ValueError(f"`OverSpeeds.power` must be at least 1, got {self.power:g}.")

    def __call__(
        self, model: jg.PairModel, cycle: jg.MeshCycle, law: jg.AbstractContactLaw
    ) -> Float[Array, ""]:
        """Return the power mean over the speeds, in the unit of the response."""
        del cycle
        found = self.judged(model, law)
        count = jnp.sum(found.kept, dtype=float)
        # What is left out must not reach the sum, not even as a NaN.
        number = jnp.where(found.kept, found.number, 1.0)
        if self.power == jnp.inf:
            value = jnp.max(jnp.where(found.kept, number, -jnp.inf))
        else:
            weights = found.kept.astype(float)
            sizes = jax.scipy.special.logsumexp(self.power * jnp.log(number), b=weights)
            value = jnp.exp((sizes - jnp.log(count)) / self.power)
        return jnp.where(count >= self.least_share * found.speed.size, value, jnp.nan)

    def judged(self, model: jg.PairModel, law: jg.AbstractContactLaw) -> SpeedResults:
        """Judge the response at each speed; traceable by JAX.

        **Arguments:**

        - `model`: gears, flanks, mounts and torque.
        - `law`: exact or smooth contact.

        **Returns:**

        The numbers, and which of them count.
        """
        dynamics = jg.pair_dynamics(
            model,
            self.grid,
            self.damping,
            gyroscopic=self.gyroscopic,
            active_mesh_damping=self.active_mesh_damping,
        )
        method = in_contact(self.method, law)
        balance = jg.harmonic_balance_problem(method, dynamics.system)
        # One step from harmonics that have settled leaves them, and has their derivatives.
        still = dataclasses.replace(method, most_steps=1)
        # A test, not part of the value: nothing is differentiated through it.
        fixed = jax.lax.stop_gradient(balance)

        def at_speed(speed: Array) -> tuple[Array, Array, Array]:
            orbit, terms = method.solve(balance, speed)
            near = jax.lax.stop_gradient(terms)
            stretched = lambda x: still.solve(fixed, speed * jnp.exp(x), near)[1]
            _, change = jax.jvp(stretched, (jnp.zeros(()),), (jnp.ones(()),))
            moved = fixed.middle @ change.T / fixed.scales[None, :]
            number = self.response(dynamics, orbit, method.law)
            return number, orbit.settled, jnp.max(jnp.abs(moved))

        number, settled, sensitivity = jg.over_batch(at_speed, self.speeds)
        kept = settled & jnp.isfinite(number) & (sensitivity <= self.most_sensitive)
        return SpeedResults(self.speeds, number, settled, sensitivity, kept)


def in_contact(method: jg.HarmonicBalance, law: jg.AbstractContactLaw) -> jg.HarmonicBalance:
    """The same harmonic balance with another contact law.

    **Arguments:**

    - `method`: settings.
    - `law`: exact or smooth contact; smooth contact needs no average.

    **Returns:**

    The method.
    """
    averaged = method.averaged and isinstance(law, jg.ExactContact)
    return dataclasses.replace(method, law=law, averaged=averaged)


def require_regular(
    system: jg.DynamicSystem,
    orbit: jg.Orbit,
    method: jg.HarmonicBalance,
    *,
    least: float = 1e-2,
) -> float:
    """Refuse to differentiate a response at a fold, where it has no derivative.

    Not for tracing.

    **Arguments:**

    - `system`: what moves.
    - `orbit`: its response.
    - `method`: by which it is differentiated.
    - `least`: condition that is demanded: derivatives are up to its inverse times as large as
        those of a linear system, and as much more sensitive [-].

    **Returns:**

    The condition [-].

    **Raises:**

    - `ValueError` if the response has not settled, or is this close to a fold.
    """
    speed = float(orbit.speed)
    balance = jg.harmonic_balance_problem(method, system)
    near = (balance.analysis @ orbit.place).T
    found, terms = eqx.filter_jit(method.solve)(balance, orbit.speed, near)
    if not bool(found.settled):
        raise ValueError(
            f"At {speed:.6g} rad/s harmonic balance finds no response: imbalance "
            f"{float(found.residual):.3g}. What has not converged has no derivative."
        )
    condition = float(jg.distance_to_fold(balance, terms, orbit.speed))
    if not condition >= least:
        raise ValueError(
            f"The response at {speed:.6g} rad/s is at a fold, or close to one: condition "
            f"{condition:.3g}, where {least:g} is demanded. There it jumps, and has no derivative; "
            "differentiate the speed of the fold instead, or choose another speed."
        )
    return condition
