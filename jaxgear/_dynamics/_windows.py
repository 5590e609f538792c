r"""Speeds near which the varying mesh stiffness may make a response unstable.

Teeth stiffen the mesh as they enter and leave. About a response the mesh is a linear spring that
varies in time, and its $k$-th harmonic excites two vibrations at once where the sum of their
frequencies is $k$ times that of the response. Such a window of speeds may be narrower than a step
along a branch: multipliers before and after it say nothing of it, but its place and its strength
are known in advance.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._compiled import lasting
from jaxgear._dynamics._floquet import SlowModes, march_along
from jaxgear._dynamics._march_step import March
from jaxgear._dynamics._step_product import (
    Monodromy,
    gains_of,
    mean_tangents,
    product_of_steps,
)
from jaxgear._dynamics._steppers import Exponential
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._types import StepMatrices, StepPlaces
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._types import Reals, Scalar

# Harmonics of the mesh period that may excite.
_HARMONICS = 8

# Of what it takes to make a response unstable, by the first order, so much counts: the window at
# 665 rad/s of the ready accessory pair with damping of 1 % is unstable at 0.66.
_STRONG = 0.5

# Vibrations that no other ties to the mesh by this part of their damping take no part.
_WEAK = 0.1

# Least ratio of damping that is told from none, and of the width of a window to its speed: without
# damping there are some of any width.
_LEAST_DAMPED, _LEAST_WIDE = 1e-9, 2e-4


class MeshVariation(NamedTuple):
    """How the structure and the mesh answer to a small disturbance of a response.

    **Fields:**

    - `rates`: of the slow modes, damping and gyroscopic forces, without the mesh [1/s].
    - `squares`: their stiffness with the mean mesh stiffness of statics [1/s2].
    - `mesh`: their mesh coordinates [kg^-1/2].
    - `excess`: harmonics of the mesh load beyond this stiffness, per mesh coordinates and, with
        damping cells, their rates [N/m, N, N m, N s/m, N s, N m s].
    - `unit`: speed of the pinion per frequency of the response [-].
    """

    rates: Reals
    squares: Reals
    mesh: Reals
    excess: Reals
    unit: Reals


@lasting
def monodromy_of(
    system: DynamicSystem,
    law: AbstractContactLaw,
    slow: SlowModes,
    speed: Scalar,
    place: StepPlaces,
) -> tuple[Monodromy, MeshVariation]:
    """The monodromy matrix of the slow modes about a response, and what it is made of.

    One program for a sweep and for the branch through it.

    **Arguments:**

    - `system`: what moves.
    - `law`: contact law whose tangent stiffness counts.
    - `slow`: its slowest modes.
    - `speed`: of the pinion [rad/s].
    - `place`: mesh coordinates of the response in mid-steps [m, rad].

    **Returns:**

    As `monodromy`, and how structure and mesh answer to a small disturbance.
    """
    march = march_along(Exponential(), law, system, slow.basis, speed, place)
    tangents = mean_tangents(march, place)
    matrix = product_of_steps(march, tangents, slow.follows)
    return matrix, variation_of(march, tangents, slow)


def variation_of(march: March, tangents: StepMatrices, slow: SlowModes) -> MeshVariation:
    """The answer to small disturbances of a response.

    **Arguments:**

    - `march`: along it.
    - `tangents`: stiffness of the mesh in each step [N/m, N, N m].
    - `slow`: the modes of the march, and what those that it leaves out give.

    **Returns:**

    That answer.
    """
    system, modes, ties = march.system, march.modes, march.ties
    none = jnp.zeros_like(system.mean)
    given = none if slow.follows is None else slow.follows
    gains = jax.vmap(lambda tangent: gains_of(system, tangent, given, none))(tangents)
    table = system.table
    order = jnp.arange(_HARMONICS * table.periods + 1.0)
    turn = 2.0 * jnp.pi / table.periods * order[:, None] * table.middles[None, :]
    share = table.lengths / table.periods
    mean = lambda wave: jnp.einsum("s,ks,sab->kab", share, wave, gains)
    return MeshVariation(
        rates=jnp.diag(modes.damping) + (0.0 if ties.whirl is None else ties.whirl),
        squares=jnp.diag(modes.square) + (0.0 if ties.stiffens is None else ties.stiffens),
        mesh=modes.mesh,
        excess=jax.lax.complex(mean(jnp.cos(turn)), -mean(jnp.sin(turn))),
        unit=jnp.asarray(table.periods / system.teeth),
    )


def windows_of(variation: MeshVariation) -> np.ndarray:
    r"""Speeds at which the mesh excites two vibrations at once, perhaps beyond their damping.

    A disturbance obeys $\dot y = (A_0 + \sum_k A_ke^{ik\omega t})y$. With $l_a$, $r_a$ and
    $\lambda_a = -\delta_a + i\omega_a$ the eigenvectors and eigenvalues of $A_0$, two vibrations
    grow near $k\omega = \omega_a + \omega_b$ if
    $\mathrm{Re}(l_aA_k\bar r_b\,\overline{l_bA_k\bar r_a}) > \delta_a\delta_b$ (theory 10.3).

    **Arguments:**

    - `variation`: about a response.

    **Returns:**

    Speeds of the pinion, rising, where this is so or nearly so [rad/s].
    """
    squares, rates, onto, ties = _excitable(variation)
    size, number = onto.shape[0], ties.shape[2] // onto.shape[1]
    if not size:
        return np.zeros(0)
    still = np.block([[np.zeros((size, size)), np.eye(size)], [-squares, -rates]])
    values, right = np.linalg.eig(still)
    swings = (values.imag > 0.0) & (values.real < 0.0)
    decay, frequency = -values.real[swings], values.imag[swings]
    pushes = np.linalg.pinv(right)[swings, size:] @ onto
    seen = np.concatenate(
        [onto.T @ part for part in right[:, swings].reshape(2, size, -1)[:number]]
    )
    both = pushes @ ties @ seen.conj()
    growth = (both * np.swapaxes(both, 1, 2).conj()).real
    order = np.arange(1.0, len(ties) + 1.0)[:, None, None]
    sums = frequency[:, None] + frequency[None, :]
    # Without damping the frequencies may be off their sum by twice the root of this.
    least = np.maximum(_STRONG * np.outer(decay, decay), (0.25 * _LEAST_WIDE * sums) ** 2)
    return np.unique((float(variation.unit) * sums / order)[growth > least])


def _excitable(variation: MeshVariation) -> tuple[np.ndarray, ...]:
    """The vibrations about a response that may take part in a window, by their own strength.

    **Returns:**

    Their stiffness [1/s2] and rates [1/s], their mesh coordinates [kg^-1/2], and the harmonics of
    the mesh load that excite.
    """
    rates, squares, mesh, excess, _ = map(np.asarray, variation)
    number = excess.shape[2] // mesh.shape[1]
    mean = [mesh @ part.real @ mesh.T for part in np.split(excess[0], number, axis=1)]
    squares, rates = squares + mean[0], rates + sum(mean[1:])
    own, shapes = np.linalg.eigh(0.5 * (squares + squares.T))
    own, shapes = own[own > 0.0], shapes[:, own > 0.0]
    frequency, decay = np.sqrt(own), 0.5 * np.sum(shapes * (rates @ shapes), axis=0)
    decay = np.maximum(decay, _LEAST_DAMPED * frequency)
    onto = shapes.T @ mesh
    sides = [onto.T, 1j * onto.T * frequency][:number]
    size = np.abs(onto @ excess[1:] @ np.concatenate(sides)).max(axis=0)
    tied = size * size.T / (4.0 * np.outer(frequency * decay, frequency * decay))
    shapes = shapes[:, np.any(tied > _WEAK, axis=0)]
    return (
        shapes.T @ squares @ shapes,
        shapes.T @ rates @ shapes,
        shapes.T @ mesh,
        excess[1:],
    )
