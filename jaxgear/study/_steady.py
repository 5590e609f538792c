"""Derivatives of steady responses: of what is built of keys, then of the response of that."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

import jaxgear as jg
from jaxgear._dynamics._harmonic import Balance
from jaxgear._dynamics._types import Terms
from jaxgear._types import Flag, Reals, Scalar
from jaxgear._units import um
from jaxgear.scene._build import model_of
from jaxgear.scene._tables import DampingKeys, SweepKeys
from jaxgear.study._derivatives import Keys
from jaxgear.study._dynamics import dynamics_of

SPEED = "sweep.pinion_speed_rad_s"
TOO_MANY = "too many unknowns"

# Of a steady response: the force is the root of the sum of squares over bearings and directions
# of the amplitudes at the mesh frequency, for a pair on shafts.
_NAMES = ("te_rms_dynamic_um", "smooth_dynamic_ratio")
_OF_BEARINGS = ("bearing_force_order_1_N",)

# Width of the smooth maximum of the mesh force over the static one, as the optimiser's [-].
_RATIO_WIDTH = 0.02
# Below this condition a response is at a fold, or so close that it has no useful derivative.
_LEAST_CONDITION = 1e-2
_SETTLED = 1e-12


@dataclasses.dataclass(frozen=True)
class SteadyPoint:
    """The steady response that is differentiated, or why none is.

    **Fields:**

    - `contact`: name of the contact law.
    - `speed_rad_s`: of the pinion.
    - `residual`: imbalance of the harmonics, in static deflections.
    - `condition`: 1 for a linear system, 0 at a fold.
    - `verdict`: `ok`, `not converged`, `near a fold`, or `too many unknowns` (a cycle of many mesh
      periods is too long for harmonic balance).
    """

    contact: str
    speed_rad_s: float
    residual: float | None
    condition: float | None
    verdict: str


def damping_keys(damping: DampingKeys) -> tuple[str, ...]:
    """Keys of the damping that a scene has: in motion they count among its real keys."""
    named = ("mesh", "structure") if damping.kind == "modal" else ("a_R_1_s", "b_R_s")
    return tuple(f"damping.{key}" for key in named)


def builder(
    keys: Keys, grid: jg.MeshGrid
) -> Callable[[Reals], tuple[jg.PairModel, jg.PairDynamics]]:
    """What builds a model and its dynamics of keys, on phases that are time steps."""

    def build(values: Reals) -> tuple[jg.PairModel, jg.PairDynamics]:
        changed = keys.moved(values)
        model = model_of(changed)
        return model, dynamics_of(model, grid, changed)

    return build


def numbers_of(
    build: Callable[[Reals], tuple[jg.PairModel, jg.PairDynamics]],
) -> Callable[[Reals], tuple[Reals, jg.PairDynamics]]:
    """What finds, of keys and the speed, the numbers that steady responses are found from.

    The speed is the last of both; beside them the pair.
    """

    def numbers(values: Reals) -> tuple[Reals, jg.PairDynamics]:
        dynamics = build(values[:-1])[1]
        own = ravel_pytree(eqx.filter(_moving(dynamics), eqx.is_inexact_array))[0]
        return jnp.append(own, values[-1]), dynamics

    return numbers


def responder(method: jg.HarmonicBalance) -> Callable:
    """What finds the steady response of numbers, of `numbers_of`, and of the pair they are from.

    Beside the response it returns what `steady_point` judges it by.
    """

    def respond(numbers: Reals, dynamics: jg.PairDynamics) -> tuple[Reals, tuple]:
        moved = moved_pair(dynamics, numbers[:-1])
        found, orbit, terms, _ = steady(method, moved, numbers[-1])
        still = jax.lax.stop_gradient((terms, numbers[-1]))
        apart = jg.distance_to_fold(jg.harmonic_balance_problem(method, dynamics.system), *still)
        return found, (orbit.residual, orbit.settled, apart)

    return respond


def moved_pair(dynamics: jg.PairDynamics, numbers: Reals) -> jg.PairDynamics:
    """A pair with other numbers, of `numbers_of`, that steady responses are found from."""
    real, other = eqx.partition(_moving(dynamics), eqx.is_inexact_array)
    own = ravel_pytree(real)[1](numbers)
    return eqx.tree_at(_moving, dynamics, eqx.combine(own, other))


def _moving(dynamics: jg.PairDynamics) -> tuple:
    """The parts of a pair that steady responses are found from."""
    return dynamics.system, dynamics.cycle.system.structure


def method_of(
    asked: SweepKeys, dynamics: jg.PairDynamics, law: jg.AbstractContactLaw
) -> jg.HarmonicBalance:
    """Harmonic balance of a scene; exact contact averaged over time steps, as when optimising."""
    averaged = isinstance(law, jg.ExactContact) and dynamics.system.cell_damping is None
    return jg.HarmonicBalance(
        law=law, harmonics=asked.harmonics, averaged=averaged, tolerance=_SETTLED
    )


def steady(
    method: jg.HarmonicBalance, dynamics: jg.PairDynamics, speed: Scalar
) -> tuple[Reals, jg.Orbit, Terms, Balance]:
    """A steady response at a speed of the pinion [rad/s].

    Its numbers, in the units of `steady_names`; its states; its Fourier coefficients, and the
    balance that they are in.
    """
    balance, system = jg.harmonic_balance_problem(method, dynamics.system), dynamics.system
    orbit, terms = method.solve(balance, speed)
    found = [
        jg.orbit_rms(system, jg.dynamic_transmission_error(system, orbit)) / um,
        jg.smooth_dynamic_ratio(system, orbit, jnp.asarray(_RATIO_WIDTH), method.law),
    ]
    if _has_bearings(dynamics):
        order = jg.order_amplitudes(system, jg.bearing_loads(dynamics, orbit), 1)[0]
        found.append(jnp.sqrt(jnp.sum(order[:, :3] ** 2)))
    return jnp.stack(found), orbit, terms, balance


def steady_names(dynamics: jg.PairDynamics) -> tuple[str, ...]:
    """The numbers of a steady response, with their units."""
    return _NAMES + (_OF_BEARINGS if _has_bearings(dynamics) else ())


def _has_bearings(dynamics: jg.PairDynamics) -> bool:
    return bool(dynamics.cycle.system.structure.map.bearings)


def steady_point(contact: str, speed: float, seen: tuple[Scalar, Flag, Scalar]) -> SteadyPoint:
    """Judge whether a response has useful derivatives."""
    residual, settled, apart = (float(x) for x in seen)
    verdict = "ok" if apart >= _LEAST_CONDITION else "near a fold"
    finite = lambda x: x if np.isfinite(x) else None
    return SteadyPoint(
        contact, speed, finite(residual), finite(apart), verdict if settled else "not converged"
    )
