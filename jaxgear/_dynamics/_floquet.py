r"""Floquet's multipliers: how a disturbance of a periodic response grows in one period.

In every step the mesh ties the modes together through its few coordinates only, so that the
derivative of a cycle by its start, the monodromy matrix, is a product of steps that each cost a few
columns. Its eigenvalues are Floquet's multipliers: beyond 1 in size the response is there, but no
machine stays on it. One leaves through +1 at a fold, through -1 where the period doubles.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array, Float

from jaxgear._dynamics._march import March, Rule, march_of
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._steppers import AbstractStepper, Exponential
from jaxgear._dynamics._system import DynamicSystem, ModalBasis
from jaxgear._dynamics._table import (
    END,
    MIDDLE,
    START,
    mean_tangent,
    mesh_at,
    mesh_load,
)
from jaxgear._dynamics._types import StepMatrices, StepPlaces
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import CoordinateMatrix, Reals

# A multiplier counts as beyond 1 from here: rounding and truncated harmonics shift it by less.
STABLE = 1.0 + 1e-6

# Derivatives of the state of all modes by its start, both parts; each flattened.
Monodromy = Float[Array, "state state"]


def monodromy(
    system: DynamicSystem,
    modes: ModalBasis,
    orbit: Orbit,
    *,
    stepper: AbstractStepper = Exponential(),
    law: AbstractContactLaw = ExactContact(),
) -> Monodromy:
    """Derivative of the state at the end of a response by that at its start.

    A cell that closes within a step counts for the part of the step in which it is closed: what is
    found converges with the square of the step, where the derivative of the steps themselves
    has the error of a whole step wherever contact changes.

    **Arguments:**

    - `system`: what moves.
    - `modes`: its natural modes.
    - `orbit`: of this system, by any method, over one or more cycles.
    - `stepper`: `Midpoint` or, exact in the linear part, `Exponential`.
    - `law`: contact law whose tangent stiffness counts.

    **Returns:**

    A square matrix on displacements of all modes, then velocities, of unit modal mass.
    """
    multiple = orbit.place.shape[0] // len(system.table.kinds)
    system = system.over(multiple)
    march = march_of(stepper, law, system, modes, orbit.speed)
    if not isinstance(law, ExactContact):
        return product_of_steps(march, tangents_of(march, orbit.place))
    places = jnp.concatenate([orbit.place[-1:], orbit.place, orbit.place[:1]])
    ends = 0.5 * (places[:-1] + places[1:])
    start, middle, end = (
        mesh_at(system.table, part).at(orbit.speed) for part in (START, MIDDLE, END)
    )
    mean = jax.vmap(mean_tangent)(start, middle, end, ends[:-1], ends[1:])
    return product_of_steps(march, mean)


def multipliers(monodromies: Array, modes: ModalBasis) -> np.ndarray:
    """Floquet's multipliers, the eigenvalues of monodromy matrices, largest first.

    This is not for tracing: no platform but the CPU finds eigenvalues of such matrices.

    **Arguments:**

    - `monodromies`: one, or many on leading axes.
    - `modes`: of the system: scaled by its frequencies, eigenvalues lose fewer digits.

    **Returns:**

    The multipliers on the last axis [-].
    """
    weights = np.asarray(modes.swing).reshape(-1)
    scaled = np.asarray(monodromies) * weights[:, None] / weights[None, :]
    found = np.linalg.eigvals(scaled)
    order = np.argsort(-np.abs(found), axis=-1)
    return np.take_along_axis(found, order, axis=-1)


def tangents_of(march: March, places: StepPlaces) -> StepMatrices:
    """Tangent stiffness of the mesh in the middle of each step.

    **Arguments:**

    - `march`: by a rule whose load is in mid-step.
    - `places`: mesh coordinates there [m, rad].

    **Returns:**

    The stiffness on the mesh coordinates [N/m, N, N m].
    """
    meshes = march.meshes[0]
    return jax.vmap(lambda mesh, place: mesh_load(mesh, place, march.law)[1])(meshes, places)


def product_of_steps(march: March, tangents: StepMatrices) -> Monodromy:
    """Product of the derivatives of all steps.

    **Arguments:**

    - `march`: by a rule whose load is in mid-step.
    - `tangents`: stiffness of the mesh in each step [N/m, N, N m].

    **Returns:**

    As `monodromy`.
    """
    tied = march.system.gyroscopic is not None
    return _step_by_step(march, tangents) if tied else _in_blocks(march, tangents)


def _step_by_step(march: March, tangents: StepMatrices) -> Monodromy:
    """Product of the derivatives of all steps, of modes that gyroscopic forces tie together."""
    mesh, damped = march.modes.mesh, march.system.cell_damping is not None
    size = mesh.shape[0]
    gains = [jax.vmap(lambda t, r=rule: _gains(march, r, t))(tangents) for rule in march.rules]

    def step(columns: Reals, x):
        kind, gain = x
        rule, own = march.rules[0], gain[0]
        for number, other in enumerate(march.rules[1:], 1):
            pick = lambda a, b, k=number: jnp.where(kind == k, b, a)
            rule, own = jax.tree.map(pick, (rule, own), (other, gain[number]))
        rate, near = (
            jnp.sum(part[:, :, None] * columns, axis=0) for part in (rule.rate, rule.near)
        )
        assert rule.whirl is not None
        turned = rule.whirl @ rate
        if rule.stiffens is not None:
            turned = turned + rule.stiffens @ near
        near = near - rule.near_load[:, None] * turned
        seen = mesh.T @ near
        if damped:
            rate = rate - rule.rate_load[:, None] * turned
            seen = jnp.concatenate([seen, mesh.T @ rate])
        pushed = -rule.pushes @ (own @ seen) - turned
        ended = jnp.sum(rule.state[:, :, :, None] * columns[None], axis=1)
        return ended + rule.load[:, :, None] * pushed[None], None

    start = jnp.eye(2 * size).reshape(2, size, 2 * size)
    kinds = jnp.asarray(march.system.table.kinds)
    ended, _ = jax.lax.scan(step, start, (kinds, gains))
    return ended.reshape(2 * size, 2 * size)


# So many steps are joined into one equation: more make better use of the machine, until the
# triangle that they form costs more than it saves.
_JOINED = 20


class _Joined(eqx.Module):
    """What a number of equal steps do together, of each of them or after each number of them.

    **Fields:**

    - `free`: state after so many steps per state, without excess loads; part by part, of each mode
        [-, s, 1/s].
    - `look`: what the load of a step answers to per state at the start of all: the nodes' mesh
        coordinates and, with damping cells, their rates [-, 1/s].
    - `echo`: the same per excess load of a step so many steps before [m/N, 1/N, 1/(N m)].
    - `push`: state at the end per excess load, of the last step first [s2 kg^-1/2, s kg^-1/2].
    """

    free: Reals
    look: Reals
    echo: Reals
    push: Reals


def _in_blocks(march: March, tangents: StepMatrices) -> Monodromy:
    r"""Product of the derivatives of all steps, of modes that only the mesh ties together.

    Excess loads of joined steps obey one equation, $e_k = g_k(l_kx - \sum_{j<k}r_{k-j}e_j)$: a
    triangle of few unknowns, with whole matrices to multiply on both sides.
    """
    kinds = march.system.table.kinds
    period = next(n for n in range(1, len(kinds) + 1) if kinds == kinds[:n] * (len(kinds) // n))
    ends = [n for n in range(1, period + 1) if n == period or kinds[n] != kinds[n - 1]]
    runs = list(zip([0, *ends[:-1]], ends, strict=True))
    each = []
    for first, last in runs:
        rule = march.rules[kinds[first]]
        together = -(-(last - first) // -(-(last - first) // _JOINED))
        gains = jax.vmap(lambda t, r=rule: _gains(march, r, t))(
            tangents.reshape(-1, period, *tangents.shape[1:])[:, first:last].reshape(
                -1, *tangents.shape[1:]
            )
        )
        each.append(
            (_joined(march, rule, together), gains.reshape(-1, last - first, *gains.shape[1:]))
        )

    def over_period(state: Reals, gains):
        for (joined, _), gain in zip(each, gains, strict=True):
            together = joined.look.shape[0]
            whole = gain.shape[0] // together
            blocks = gain[: whole * together].reshape(whole, together, *gain.shape[1:])
            state, _ = jax.lax.scan(lambda x, g, j=joined: (_over(j, g, x), None), state, blocks)
            if gain.shape[0] > whole * together:
                state = _over(joined, gain[whole * together :], state)
        return state, None

    start = jnp.eye(2 * march.modes.square.size)
    return jax.lax.scan(over_period, start, [gains for _, gains in each])[0]


def _gains(march: March, rule: Rule, tangent: CoordinateMatrix) -> Reals:
    """Excess load of a step per change of the nodes' mesh coordinates, and of their rates."""
    mean, damping = march.system.mean, march.system.cell_damping
    unit = jnp.eye(mean.shape[0])
    # g = T (n - B g) and, with damping, + eta T n'; n and n' are those under the load.
    whole = tangent
    if march.system.bow is not None:
        whole = jnp.linalg.solve(unit + tangent @ march.system.bow, tangent)
    excess = whole - mean
    if damping is None:
        return jnp.linalg.solve(unit + excess @ rule.own, excess)
    closed = unit + excess @ rule.own + damping * whole @ rule.brakes
    return jnp.linalg.solve(closed, jnp.concatenate([excess, damping * whole], axis=1))


def _joined(march: March, rule: Rule, steps: int) -> _Joined:
    """Join equal steps."""
    mesh = march.modes.mesh
    modes, width = mesh.shape
    times = lambda a, b: jnp.sum(a[..., :, :, None, :] * b[..., None, :, :, :], axis=-3)
    free, power = jnp.broadcast_to(jnp.eye(2)[None, :, :, None], (1, 2, 2, modes)), rule.state
    while free.shape[0] <= steps:
        free = jnp.concatenate([free, times(free, jnp.broadcast_to(power, free.shape))])
        power = times(power, power)
    free = free[: steps + 1]
    damped = march.system.cell_damping is not None
    seen = jnp.stack([rule.near, rule.rate] if damped else [rule.near])
    look = jnp.sum(seen[None, :, :, None, :] * free[:steps, None], axis=2)
    push = jnp.sum(free[:steps] * rule.load[None, None], axis=2)
    echo = jnp.sum(seen[None] * push[:, None], axis=2)
    pairs = (mesh[:, :, None] * mesh[:, None, :]).reshape(modes, width * width)
    return _Joined(
        free=free,
        look=(look[:, :, None] * mesh.T[None, None, :, None, :]).reshape(steps, -1, 2 * modes),
        echo=(echo @ pairs).reshape(steps, -1, width),
        push=(push[::-1, None] * mesh.T[None, :, None, :]).reshape(steps, width, 2 * modes),
    )


def _over(joined: _Joined, gains: Reals, state: Reals) -> Reals:
    """Columns of states at the end of joined steps, of the first so many that have gains."""
    steps, width = gains.shape[:2]
    size = state.shape[0]
    before = np.arange(steps)[:, None] - np.arange(steps)[None, :] - 1
    echo = jnp.where((before >= 0)[:, :, None, None], joined.echo[np.maximum(before, 0)], 0.0)
    tie = jnp.sum(gains[:, None, :, :, None] * echo[:, :, None], axis=3)
    unknowns = steps * width
    matrix = jnp.eye(unknowns) + jnp.moveaxis(tie, 2, 1).reshape(unknowns, unknowns)
    look = jnp.sum(gains[:, :, :, None] * joined.look[:steps, None], axis=2)
    seen = look.reshape(unknowns, size) @ state
    excess = jax.scipy.linalg.solve_triangular(matrix, seen, lower=True, unit_diagonal=True)
    parts = state.reshape(2, -1, size)
    free = jnp.sum(joined.free[steps][:, :, :, None] * parts[None], axis=1)
    return free.reshape(size, size) - joined.push[-steps:].reshape(unknowns, size).T @ excess
