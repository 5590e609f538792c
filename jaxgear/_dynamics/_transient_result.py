"""What a transient was: its motion at any time, and how far it was reached."""

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array, Bool, Float, Int, PyTree

from jaxgear._checks import InputError
from jaxgear._dynamics._orbit import derivative_if
from jaxgear._dynamics._transient_motion import MovingPair
from jaxgear._dynamics._types import Vector
from jaxgear._types import Flag, Scalar

if TYPE_CHECKING:
    Times = Array
    TimeCoordinates = Array
    TimeDofs = Array
    AxisState = Array
    Count = Array
else:
    Times = Float[Array, "time"]
    TimeCoordinates = Float[Array, "time coordinate"]
    TimeDofs = Float[Array, "time dof"]
    AxisState = Float[Array, "2 axis"]
    Count = Int[Array, ""]

# --- The result


class Transient(eqx.Module):
    r"""A motion in time.

    **Fields:**

    - `times`: at which it was asked for [s].
    - `phase`: mesh periods gone through since the start [-].
    - `speed`: of the pinion [rad/s].
    - `place`: mesh coordinates $m$ [m, rad].
    - `load`: of the mesh on them; the first is the total force of the drive flanks [N, N m].
    - `motion`: $q$ [m, rad].
    - `velocity`: $\dot q$; only of modes that move with inertia [m/s, rad/s].
    - `transmission_error`: on the base circles [m].
    - `complete`: whether the end was reached; if not, values after `reached` are NaN.
    - `reached`: the last time that was [s].
    - `steps`: accepted steps of the integrator [-].
    - `rejected`: steps that were too long [-].
    - `dense`: what `at` evaluates, or `None`.
    """

    times: Times
    phase: Times
    speed: Times
    place: TimeCoordinates
    load: TimeCoordinates
    motion: TimeDofs
    velocity: TimeDofs
    transmission_error: Times
    complete: Flag
    reached: Scalar
    steps: Count
    rejected: Count
    dense: "DenseMotion | None"

    def at(self, times: Times) -> "Transient":
        """The same motion at other times.

        **Arguments:**

        - `times`: within those of the transient [s].

        **Returns:**

        The motion there.

        **Raises:**

        - `ValueError` unless the transient was made with `dense=True`.
        """
        if self.dense is None:
            raise InputError(
                "`Transient.at` needs every step of the integrator: ask for `dense=True`, or give "
                "`transient` the times themselves."
            )
        return _at_times(self, self.dense, jnp.asarray(times, dtype=float))


class DenseMotion(eqx.Module):
    """A motion between the times that were asked for.

    **Fields:**

    - `motion`: its equations.
    - `path`: scaled state over time since the start [-].
    - `begin`: the start [s].
    - `transmission`: transmission error per motion [-, m].
    """

    motion: MovingPair
    path: diffrax.DenseInterpolation
    begin: Scalar
    transmission: Vector


@eqx.filter_jit
def _at_times(given: Transient, dense: DenseMotion, times: Times) -> Transient:
    since = times - dense.begin
    states = jax.vmap(dense.path.evaluate)(since)
    known = (times >= dense.begin) & (times <= given.reached)
    states = reached_only(states, known, dense)
    return dataclasses.replace(
        given,
        times=times,
        **observed_at(dense.motion, dense.transmission, since, states)._asdict(),
    )


def reached_only(
    states: Float[Array, "time 2 axis"], known: Bool[Array, " time"], given: PyTree
) -> Float[Array, "time 2 axis"]:
    """States at the times that were reached, NaN at others, and so are their derivatives.

    **Arguments:**

    - `states`: scaled, at each time [-].
    - `known`: whether a time was reached.
    - `given`: whatever they depend on: an integrator does not look at what it has not reached.

    **Returns:**

    The states [-].
    """
    numbers = jax.tree.leaves(eqx.filter(given, eqx.is_inexact_array))
    everything = jnp.full(known.shape, sum(jnp.sum(x) for x in numbers))
    lost = jnp.nan + jax.vmap(derivative_if)(known, everything)
    return jnp.where(known[:, None, None], states, lost[:, None, None])


class Observed(NamedTuple):
    """What a transient holds at each time: some fields of `Transient`."""

    phase: Array
    speed: Array
    place: Array
    load: Array
    motion: Array
    velocity: Array
    transmission_error: Array


def observed_at(
    motion: MovingPair, transmission: Vector, since: Times, states: Float[Array, "time 2 axis"]
) -> Observed:
    """What a transient holds at each time."""

    def at(time: Scalar, state: AxisState) -> Observed:
        place, load = motion.place_and_load(time, state)
        moved = motion.motion(time, state, place, load)
        return Observed(
            phase=motion.phase(time),
            speed=motion.speed.at(time).value(time),
            place=place,
            load=load,
            motion=moved,
            velocity=motion.axes.shape @ (state[1] * motion.length * motion.rate),
            transmission_error=transmission @ moved,
        )

    return jax.vmap(at)(since, states)
