"""Steady responses: what every method finds, and how far it can be trusted."""

import abc
import functools

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxgear._checks import InputError
from jaxgear._compiled import compiled
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._types import Motion, Series, Start, StepPlaces
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._types import Coordinates, Flag, Reals, Scalar


class Orbit(eqx.Module):
    """A response over one or more cycles of the mesh, after which it repeats.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `place`: mesh coordinates in the middle of each time step [m, rad].
    - `load`: elastic load of the mesh on its coordinates there; the first is the total contact
        force of the drive flanks [N, N m].
    - `motion`: of every degree of freedom there [m, rad].
    - `start`: motion and velocity where the cycle begins [m, rad, m/s, rad/s].
    - `residual`: of the method's equations, relative: what is out of balance, or how far the end of
        the cycle lies from its start [-].
    - `settled`: whether the residual is within the method's tolerance.
    - `steps`: iterations or cycles that it took [-].
    """

    speed: Scalar
    place: StepPlaces
    load: StepPlaces
    motion: Motion
    start: Start
    residual: Scalar
    settled: Flag
    steps: Scalar


class AbstractMethod(eqx.Module):
    """A way to a steady response. Integers and flags select a program; reals are arguments.

    **Fields:**

    - `law`: exact or smooth contact [-].
    - `multiple`: cycles after which the response repeats [-].
    """

    law: eqx.AbstractVar[AbstractContactLaw]
    multiple: eqx.AbstractVar[int]

    @abc.abstractmethod
    def orbit(self, system: DynamicSystem, speed: Scalar, start: Start | None) -> Orbit:
        """Find the response at one speed.

        **Arguments:**

        - `system`: what moves.
        - `speed`: of the pinion, positive [rad/s].
        - `start`: motion and velocity at the start of the cycle, or `None`: from the quasi-static
            states [m, rad, m/s, rad/s].

        **Returns:**

        The response, settled or not.
        """


def derivative_if(solved: Flag, tangent: Reals) -> Reals:
    """The derivative of a solution, NaN in both directions where it was not found.

    A choice between it and NaN would hand on zeros in reverse mode. What does not count for a
    result, and has no part in its derivative, still has none.

    **Arguments:**

    - `solved`: whether the solution was found; no constant, or XLA multiplies what is huge at once,
        and of a zero there is NaN.
    - `tangent`: of the solution, if it was, in the solution's unit [-].

    **Returns:**

    The tangent [-].
    """
    huge = jnp.where(solved, 0.0, jnp.finfo(float).max)
    # Zero where the tangent is, infinite elsewhere; apart, so that they meet in both directions.
    up, down = (sign * tangent * huge * huge for sign in (1.0, -1.0))
    return tangent + (up + down)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def without_derivatives(method: str, orbit: Orbit) -> Orbit:
    """The same response, which refuses to be differentiated.

    **Arguments:**

    - `method`: by which it was found, in words.
    - `orbit`: the response.

    **Returns:**

    The response.

    **Raises:**

    - `InputError` if it is differentiated.
    """
    del method
    return orbit


@without_derivatives.defjvp
def _refuse_to_differentiate(method: str, primals: tuple[Orbit], tangents: tuple[Orbit]):
    del primals, tangents
    raise InputError(
        f"Responses by {method} have no derivatives. Differentiate the same response by "
        "`HarmonicBalance`, or give `steady_state` no method: that is its default."
    )


@compiled
def contact_force(system: DynamicSystem, orbit: Orbit) -> Series:
    """Total elastic force of all cells, along the normal.

    **Arguments:**

    - `system`: what moves.
    - `orbit`: its response.

    **Returns:**

    The force at each step, drive and back flanks together [N].
    """
    return total_force(system, orbit.load)


def total_force(system: DynamicSystem, load: StepPlaces) -> Series:
    """Force of all cells along the normal, drive and back flanks together.

    **Arguments:**

    - `system`: what moves.
    - `load`: elastic load of the mesh on its coordinates, at each step [N, N m].

    **Returns:**

    The force at each step [N].
    """
    drive = load[:, 0]
    return drive + load[:, load.shape[1] // 2] if system.back else drive


# A response whose mean mesh force is below this part of the static one has lost the teeth.
_CARRIED = 0.5


def bears_load(system: DynamicSystem, load: StepPlaces) -> Flag:
    """Whether a response carries the load: one that has run away repeats, relative to its size.

    **Arguments:**

    - `system`: what moves.
    - `load`: of the mesh on its coordinates, at each step [N, N m].

    **Returns:**

    Whether the drive flanks' mean force is of the size of the static one.
    """
    lengths = system.table.lengths
    share = jnp.tile(lengths, load.shape[0] // lengths.size)
    return jnp.sum(share * load[:, 0]) >= _CARRIED * system.force * jnp.sum(share)


def mesh_scales(system: DynamicSystem) -> Coordinates:
    """Sizes of the mesh coordinates: static deflection, and the tilt that moves cells as far.

    **Arguments:**

    - `system`: what moves.

    **Returns:**

    One for each coordinate [m, rad].
    """
    width = system.mean.shape[0] // 2 if system.back else system.mean.shape[0]
    # A coordinate that moves no cell, such as the tilt of one slice, has no size of its own.
    stiffness = jnp.diagonal(system.mean)[:width]
    ratio = stiffness[0] / jnp.maximum(stiffness, 1e-9 * jnp.max(stiffness))
    scales = system.force / stiffness[0] * jnp.sqrt(ratio)
    return jnp.concatenate([scales, scales]) if system.back else scales
