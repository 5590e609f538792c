r"""Unbalance: forces that turn with a shaft, and what they do about a mesh of mean stiffness.

A mass $m$ at a distance $e$ from the axis presses with $me\Omega^2$, turning with its shaft
(Childs 1993, sec. 3.2). Its response is linear and synchronous; what the changing mesh stiffness
makes of it at the mesh's orders $\pm 1$ is left out.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

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
    dynamics: PairDynamics, unbalance: Unbalance | Sequence[Unbalance], speed: Scalar | float
) -> UnbalanceResponse:
    """Synchronous response to unbalance (theory 8.15).

    The mesh has its mean stiffness, and stays closed: compare `mesh_force` with the static one.
    Gyroscopic and turning terms are those of `dynamics`.

    **Arguments:**

    - `dynamics`: the pair in motion.
    - `unbalance`: on one of its shafts, or several on the same one.
    - `speed`: of the pinion [rad/s].

    **Returns:**

    The response to all of them, at the frequency of their shaft.

    **Raises:**

    - `ValueError` if the structure has no such node, or if they are not on one shaft.
    """
    return _response(dynamics, _on_one_shaft(dynamics, unbalance), as_scalar(speed))


def unbalance_critical_speeds(
    dynamics: PairDynamics,
    unbalance: Unbalance | Sequence[Unbalance],
    *,
    highest: float | None = None,
) -> Float[np.ndarray, " mode"]:
    r"""Speeds of the pinion at which a shaft's unbalance meets a mode that it excites.

    Without damping, exact with gyroscopic and turning terms (theory 8.15). They have no
    derivatives.

    **Arguments:**

    - `dynamics`: the pair in motion.
    - `unbalance`: on one of its shafts, or several on the same one.
    - `highest`: of the speeds that are looked for [rad/s]; by default that at which the tip of the
        pinion's teeth runs at 1000 m/s. The hoop stress of a ring, $\rho v^2$, is 8 GPa then in
        steel: no gear turns so fast, and beyond are the modes of single elements of shafts alone.

    **Returns:**

    Rising speeds [rad/s] of the modes that move with the unbalance, by the square of
    $\varphi^Hf$ at unit modal mass, at least a twentieth as much as the one that gives most under
    it at rest.

    **Raises:**

    - `ValueError` as `unbalance_response`.
    """
    given, system = _on_one_shaft(dynamics, unbalance), dynamics.system
    ratio = float(_order(dynamics, given))
    inertia = ratio**2 * np.asarray(system.mass, dtype=complex)
    if system.gyroscopic is not None:
        inertia -= 1j * ratio * np.asarray(system.gyroscopic)
    if system.turning is not None:
        inertia -= np.asarray(system.turning.softening)
    root = np.linalg.cholesky(np.asarray(system.whole_stiffness))
    held = np.linalg.solve(root, np.linalg.solve(root, inertia).conj().T)
    square, modes = np.linalg.eigh(0.5 * (held + held.conj().T))
    load = np.asarray(_load(dynamics, given)) @ [1.0, 1j]
    pushed = modes.conj().T @ np.linalg.solve(root, load)
    # A disc that spins faster than it tilts has no forward critical speed: its square is negative.
    real = square > 1e-12 * square[-1]
    give = np.abs(pushed[real]) ** 2
    square, share = square[real], give / square[real]
    # Shaft elements have modes far above all others that move more: those hide none.
    moved = (share > 0.0) & (share >= _LEAST_SHARE * share[np.argmax(give)])
    found = np.sort(1.0 / np.sqrt(square[moved]))
    if highest is None:
        highest = _TIP_SPEED / float(dynamics.cycle.system.pair.tip_radius[0])
    found = found[found <= highest]
    return found[np.diff(found, prepend=0.0) > 1e-6 * found]


# Modes that move less with an unbalance do not show beside those that do.
_LEAST_SHARE = 0.05
# Faster than any gear turns [m/s].
_TIP_SPEED = 1000.0


def _on_one_shaft(
    dynamics: PairDynamics, unbalance: Unbalance | Sequence[Unbalance]
) -> tuple[Unbalance, ...]:
    """Unbalances as a tuple, refused where they have no node or turn at two speeds."""
    given = (unbalance,) if isinstance(unbalance, Unbalance) else tuple(unbalance)
    places = dynamics.cycle.system.structure.map.dofs
    for each in given:
        require(
            each.node in places,
            "`Unbalance.node` must be a node of the structure, {nodes}, got {got!r}.",
            nodes=", ".join(places),
            got=each.node,
        )
    shafts = {each.node.split()[0] for each in given}
    require(
        len(shafts) == 1,
        "Unbalances must be on one shaft, got {got}: those of pinion and wheel turn at speeds of "
        "their own. Ask for each shaft by itself.",
        got=" and ".join(sorted(shafts)) or "none",
    )
    return given


def _order(dynamics: PairDynamics, unbalances: tuple[Unbalance, ...]) -> Scalar:
    """Speed of their shaft over that of the pinion [-]."""
    teeth = dynamics.cycle.system.pair.teeth
    return teeth[0] / teeth[_body(unbalances)]


def _body(unbalances: tuple[Unbalance, ...]) -> int:
    return BODIES.index(unbalances[0].node.split()[0])


def _load(dynamics: PairDynamics, unbalances: tuple[Unbalance, ...]) -> Float[Array, "dof 2"]:
    """Amplitude of their load on what moves, real and imaginary part [kg m, kg m2].

    Per square of their speed.
    """
    structure = dynamics.cycle.system.structure
    # About +Z the pinion turns from S to T, the wheel the other way round.
    sense = (1.0, -1.0)[_body(unbalances)]
    load = jnp.zeros((max(dynamics.dofs) + 1, 2))
    for each in unbalances:
        along, across = each.moment * jnp.cos(each.angle), each.moment * jnp.sin(each.angle)
        push = jnp.stack([jnp.stack([along, across]), sense * jnp.stack([across, -along])])
        push = jnp.zeros((6, 2)).at[:2].set(push)
        own = structure.map.dofs[each.node] + np.arange(6)
        load = load.at[own].add(carried(each.height).T @ push)
    return load[np.asarray(dynamics.dofs)]


@compiled
def _response(
    dynamics: PairDynamics, unbalances: tuple[Unbalance, ...], speed: Scalar
) -> UnbalanceResponse:
    """See `unbalance_response`."""
    system, structure = dynamics.system, dynamics.cycle.system.structure
    frequency = speed * _order(dynamics, unbalances)
    # Of closed cells, which press with it.
    damped = jnp.zeros(()) if system.cell_damping is None else system.cell_damping
    rates = system.rates_at(speed) + damped * system.mesh_stiffness
    still = system.stiffness_at(speed) - frequency**2 * system.mass
    load = frequency**2 * _load(dynamics, unbalances)
    motion = jnp.linalg.solve(
        jax.lax.complex(still, frequency * rates), jax.lax.complex(load[:, 0], load[:, 1])
    )
    size, dofs = max(dynamics.dofs) + 1, np.asarray(dynamics.dofs)

    def of_part(motion: Array) -> tuple[Array, Array, Array]:
        # Directions that are held are not among those that move.
        whole = jnp.zeros(size).at[dofs].set(motion)[: structure.map.size]
        mesh = system.mean @ (system.vectors.T @ motion)
        return system.transmission @ motion, mesh[0], bearing_motion(structure, whole).load

    parts = zip(of_part(motion.real), of_part(motion.imag), strict=True)
    error, force, bearings = (jax.lax.complex(real, imaginary) for real, imaginary in parts)
    force = force * jax.lax.complex(jnp.ones(()), frequency * damped)
    return UnbalanceResponse(frequency, motion, error, force, bearings)
