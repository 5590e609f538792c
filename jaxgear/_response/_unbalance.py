r"""Unbalance: forces that turn with a shaft, and what they do about a mesh of mean stiffness.

A mass $m$ at a distance $e$ from the axis presses with $me\Omega^2$, turning with its shaft
(Childs 1993, sec. 3.2). Its response is linear and synchronous; what the changing mesh stiffness
makes of it at the mesh's orders $\pm 1$ is left out.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._dynamics._system import PairDynamics
from jaxgear._system._gear_body import BODIES, carried
from jaxgear._system._structure import bearing_motion
from jaxgear._types import Scalar, as_scalar


class Unbalance(eqx.Module):
    """A mass beside the axis of a shaft.

    **Fields:**

    - `moment`: mass times its distance from the axis [kg m].
    - `angle`: of its place at phase 0, from S about the shaft's own sense of rotation [rad].
    - `height`: above its node, along Z [m].
    - `node`: of the structure, "pinion gear", "wheel bearing 0", "wheel load 0" and so on; a load
        of zero makes a node anywhere on a shaft.
    """

    moment: Scalar = eqx.field(converter=as_scalar)
    angle: Scalar = eqx.field(converter=as_scalar, default=0.0)
    height: Scalar = eqx.field(converter=as_scalar, default=0.0)
    node: str = eqx.field(static=True, default="pinion gear")


class UnbalanceResponse(eqx.Module):
    r"""Complex amplitudes $a$ of a synchronous response, the real part of $a\,e^{i\Omega t}$.

    **Fields:**

    - `frequency`: $\Omega$, the speed of the shaft [rad/s].
    - `motion`: of each degree of freedom of `dynamics.system` [m, rad].
    - `transmission_error`: [m].
    - `mesh_force`: along the normal [N].
    - `bearing_load`: of the shafts on their bearings, along S, T, Z and about S, T [N, N m].
    """

    frequency: Scalar
    motion: Complex[Array, " dof"]
    transmission_error: Complex[Array, ""]
    mesh_force: Complex[Array, ""]
    bearing_load: Complex[Array, "bearing 5"]


def unbalance_response(
    dynamics: PairDynamics, unbalance: Unbalance, speed: Scalar | float
) -> UnbalanceResponse:
    r"""Synchronous response to an unbalance, $(\bar K + i\Omega C - \Omega^2M)\,a = f$.

    The mesh has its mean stiffness, and stays closed: compare `mesh_force` with the static one.
    Gyroscopic and turning terms are those of `dynamics`. Responses to several add up.

    **Arguments:**

    - `dynamics`: the pair in motion.
    - `unbalance`: on one of its shafts.
    - `speed`: of the pinion [rad/s].

    **Returns:**

    The response, at the frequency of the shaft with the unbalance.

    **Raises:**

    - `ValueError` if the structure has no such node.
    """
    places = dynamics.cycle.system.structure.map.dofs
    require(
        unbalance.node in places,
        "`Unbalance.node` must be a node of the structure, {nodes}, got {got!r}.",
        nodes=", ".join(places),
        got=unbalance.node,
    )
    return _response(dynamics, unbalance, as_scalar(speed))


@compiled
def _response(dynamics: PairDynamics, unbalance: Unbalance, speed: Scalar) -> UnbalanceResponse:
    """See `unbalance_response`."""
    system, pair = dynamics.system, dynamics.cycle.system.pair
    structure = dynamics.cycle.system.structure
    index = BODIES.index(unbalance.node.split()[0])
    frequency = speed * pair.teeth[0] / pair.teeth[index]
    # About +Z the pinion turns from S to T, the wheel the other way round.
    sense, angle = (1.0, -1.0)[index], unbalance.angle
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    size = max(dynamics.dofs) + 1
    dofs, own = np.asarray(dynamics.dofs), structure.map.dofs[unbalance.node] + np.arange(6)

    def on_dofs(s: Scalar, t: Scalar) -> Array:
        push = unbalance.moment * frequency**2 * jnp.zeros(6).at[0].set(s).at[1].set(t)
        return jnp.zeros(size).at[own].set(carried(unbalance.height).T @ push)[dofs]

    load = jax.lax.complex(on_dofs(cosine, sense * sine), on_dofs(sine, -sense * cosine))
    still = system.stiffness_at(speed) - frequency**2 * system.mass
    motion = jnp.linalg.solve(jax.lax.complex(still, frequency * system.rates_at(speed)), load)

    def of_part(motion: Array) -> tuple[Array, Array, Array]:
        # Directions that are held are not among those that move.
        whole = jnp.zeros(size).at[dofs].set(motion)[: structure.map.size]
        mesh = system.mean @ (system.vectors.T @ motion)
        return system.transmission @ motion, mesh[0], bearing_motion(structure, whole).load

    parts = zip(of_part(motion.real), of_part(motion.imag), strict=True)
    error, force, bearings = (jax.lax.complex(real, imaginary) for real, imaginary in parts)
    return UnbalanceResponse(frequency, motion, error, force, bearings)
