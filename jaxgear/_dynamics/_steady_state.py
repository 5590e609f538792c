"""Steady states at given speeds, each from its own start."""

import jax.numpy as jnp
import numpy as np

from jaxgear._batches import over_batch
from jaxgear._checks import require
from jaxgear._compiled import compiled, in_numpy, lasting
from jaxgear._dynamics._harmonic import HarmonicBalance, harmonic_balance_problem
from jaxgear._dynamics._orbit import AbstractMethod, Orbit
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._types import Speeds, Start
from jaxgear._types import Scalar


def steady_state(
    system: DynamicSystem,
    speed: Scalar,
    method: AbstractMethod | None = None,
    start: Start | None = None,
) -> Orbit:
    """Find the steady response at one speed (theory 12.1).

    It is compiled as a whole, once for all speeds and real numbers of the system. It can be traced,
    and batched over speeds by `jax.vmap`; `steady_states` is faster at that on a CPU. With
    `HarmonicBalance` it is differentiable in everything the system is made of, and in the speed.

    **Arguments:**

    - `system`: what moves.
    - `speed`: of the pinion, positive [rad/s].
    - `method`: how; by default harmonic balance with exact contact averaged over each step, whose
        derivatives are those of continuous time also where contact is lost. It is not for mesh
        damping that acts in contact only: that is not averaged.
    - `start`: motion and velocity to start from, for methods that step in time; `None`: the
        quasi-static state [m, rad, m/s, rad/s].

    **Returns:**

    The response, settled or not. Whether it is stable `monodromy` tells.

    **Raises:**

    - `ValueError` unless the speed is positive.
    """
    speed = jnp.asarray(speed, dtype=float)
    given = in_numpy(speed)
    require(
        (given > 0.0).all(),
        "The speed must be positive, got {got:.6g} rad/s: at rest, the quasi-static cycle is the "
        "response.",
        got=given,
    )
    return orbit_of(method or _differentiable(system), system, speed, start)


def steady_states(
    system: DynamicSystem, speeds: Speeds, method: AbstractMethod | None = None
) -> Orbit:
    """Find the steady response at each speed from the quasi-static state: a cold sweep.

    Where several responses exist, which one is found is an accident of the start. It can be traced.

    **Arguments:**

    - `system`: what moves.
    - `speeds`: of the pinion, positive [rad/s].
    - `method`: how; by default as of `steady_state`.

    **Returns:**

    The responses, `speed` leading.

    **Raises:**

    - `ValueError` unless all speeds are positive.
    """
    speeds = jnp.asarray(speeds, dtype=float)
    require(speeds.size > 0, "A sweep needs at least one speed.")
    given = in_numpy(speeds)
    require(
        ((given > 0.0) & (given < np.inf)).all(),
        "All speeds must be positive and finite, got {least:.6g} to {largest:.6g} rad/s.",
        least=given.min(),
        largest=given.max(),
    )
    return _orbits(method or _differentiable(system), system, speeds)


def _differentiable(system: DynamicSystem) -> HarmonicBalance:
    """Harmonic balance whose derivatives are true where contact is lost, if the system has one.

    A cell that opens or closes does so within a step: by the force in mid-step alone, derivatives
    are 3 to 6 % off at 128 steps, averaged over the step 0.1 to 0.4 % at 64.
    """
    return HarmonicBalance(averaged=system.cell_damping is None)


@compiled
def _orbits(method: AbstractMethod, system: DynamicSystem, speeds: Speeds) -> Orbit:
    """See `steady_states`."""
    if not isinstance(method, HarmonicBalance):
        return over_batch(
            lambda speed: method.orbit(system, speed, None),
            speeds,
            on_cpu=_ABREAST,
            elsewhere=4 * _ELSEWHERE,
        )
    balance = harmonic_balance_problem(method, system)
    solved = lambda speed: method.solve(balance, speed)[0]
    return over_batch(solved, speeds, elsewhere=_ELSEWHERE)


# Speeds that step in time side by side on a CPU: more fall out of its cache.
_ABREAST = 32
# Speeds side by side on a GPU. Of those that step in time more: each holds less, and a step of one
# takes it as long as a step of hundreds.
_ELSEWHERE = 256


@lasting
def orbit_of(
    method: AbstractMethod, system: DynamicSystem, speed: Scalar, start: Start | None
) -> Orbit:
    """The periodic orbit that a method finds at a speed [rad/s]."""
    return method.orbit(system, speed, start)
