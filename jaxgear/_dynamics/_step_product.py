"""The derivative of a cycle by its start, as a product of those of its steps."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jaxtyping import Array, Float

from jaxgear._dynamics._cell_forces import mean_tangent, mesh_load
from jaxgear._dynamics._march_step import March, Rule
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._table import END, MIDDLE, START, mesh_at
from jaxgear._dynamics._types import StepMatrices, StepPlaces
from jaxgear._interface._laws import ExactContact
from jaxgear._types import CoordinateMatrix, Reals

# Derivatives of the state of all modes by its start, both parts; each flattened.
Monodromy = Float[Array, "state state"]


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


def mean_tangents(march: March, places: StepPlaces) -> StepMatrices:
    """Mean tangent stiffness of the mesh over each step, as of `mean_tangent` if it is exact.

    **Arguments:**

    - `march`: along a response.
    - `places`: its mesh coordinates in mid-steps [m, rad].

    **Returns:**

    The stiffness on the mesh coordinates [N/m, N, N m].
    """
    if not isinstance(march.law, ExactContact):
        return tangents_of(march, places)
    around = jnp.concatenate([places[-1:], places, places[:1]])
    ends = 0.5 * (around[:-1] + around[1:])
    meshes = [mesh_at(march.system.table, part).at(march.speed) for part in (START, MIDDLE, END)]
    return jax.vmap(mean_tangent)(*meshes, ends[:-1], ends[1:])


def product_of_steps(
    march: March, tangents: StepMatrices, follows: CoordinateMatrix | None = None
) -> Monodromy:
    """Product of the derivatives of all steps.

    **Arguments:**

    - `march`: by a rule whose load is in mid-step.
    - `tangents`: stiffness of the mesh in each step [N/m, N, N m].
    - `follows`: mesh coordinates given up at once per excess load [m/N, 1/N, 1/(N m)].

    **Returns:**

    As `monodromy`.
    """
    given = 0.0 if follows is None else follows
    kinds = march.system.table.kinds
    period = next(n for n in range(1, len(kinds) + 1) if kinds == kinds[:n] * (len(kinds) // n))
    ends = [n for n in range(1, period + 1) if n == period or kinds[n] != kinds[n - 1]]
    steps = [_step_of(march, rule) for rule in march.rules]
    own = [
        jnp.stack(each)[np.asarray(kinds)]
        for each in zip(*((r.own + given, r.brakes) for r in march.rules), strict=True)
    ]
    gains = jax.vmap(lambda *x: gains_of(march.system, *x))(tangents, *own)
    gains = gains.reshape(-1, period, *gains.shape[1:])
    runs = []
    for first, last in zip([0, *ends[:-1]], ends, strict=True):
        runs += _blocks(steps[kinds[first]], gains[:, first:last])

    def over_period(state: Reals, gains):
        for (joined, _), gain in zip(runs, gains, strict=True):
            state, _ = jax.lax.scan(lambda x, g, j=joined: (_over(j, g, x), None), state, gain)
        return state, None

    start = jnp.eye(2 * march.modes.square.size)
    return jax.lax.scan(over_period, start, [gains for _, gains in runs])[0]


class _Step(NamedTuple):
    """One step, without the mesh load beyond that of the mean stiffness, and what that load does.

    **Fields:**

    - `free`: state at the end per state at the start, displacements of all modes, then velocities
        [-, s, 1/s].
    - `look`: what the load answers to per state at the start: the nodes' mesh coordinates and, with
        damping cells, their rates [-, 1/s].
    - `push`: state at the end, lost per excess load [s2 kg^-1/2, s kg^-1/2].
    """

    free: Reals
    look: Reals
    push: Reals


def _step_of(march: March, rule: Rule) -> _Step:
    """A step by a rule, as matrices."""
    mesh = march.modes.mesh
    size, width = mesh.shape
    unit = jnp.eye(2 * size).reshape(2, size, 2 * size)
    rate, near = (jnp.sum(part[:, :, None] * unit, axis=0) for part in (rule.rate, rule.near))
    free = jnp.sum(rule.state[:, :, :, None] * unit[None], axis=1)
    if rule.whirl is not None:
        turned = rule.whirl @ rate
        if rule.stiffens is not None:
            turned = turned + rule.stiffens @ near
        near = near - rule.near_load[:, None] * turned
        rate = rate - rule.rate_load[:, None] * turned
        free = free - rule.load[:, :, None] * turned[None]
    seen = [near] if march.system.cell_damping is None else [near, rate]
    return _Step(
        free=free.reshape(2 * size, 2 * size),
        look=jnp.concatenate([mesh.T @ each for each in seen]),
        push=(rule.load[:, :, None] * rule.pushes[None]).reshape(2 * size, width),
    )


# At least so many steps are joined into one equation: more make better use of the machine, until
# the triangle that they form costs more than the products of whole matrices that it saves.
_JOINED = 20


class _Joined(NamedTuple):
    """What a number of equal steps do together.

    **Fields:**

    - `free`: state after all of them per state before, without excess loads [-, s, 1/s].
    - `look`: what the load of each answers to per state before all, as of `_Step` [-, 1/s].
    - `echo`: the same per excess load of a step so many steps before [m/N, 1/N, 1/(N m)].
    - `push`: state after all, lost per excess load of each [s2 kg^-1/2, s kg^-1/2].
    """

    free: Reals
    look: Reals
    echo: Reals
    push: Reals


def _blocks(step: _Step, gains: Reals) -> list[tuple[_Joined, Reals]]:
    """Equal steps in blocks of one size and of one more, each with its gains."""
    length = gains.shape[1]
    count = -(-length // max(_JOINED, step.free.shape[0] // step.push.shape[1]))
    short, longer = divmod(length, count)
    most = short + (longer > 0)
    _, look = jax.lax.scan(lambda x, _: (x @ step.free, x), step.look, length=most)
    _, push = jax.lax.scan(lambda x, _: (step.free @ x, x), step.push, length=most)
    echo = look @ step.push
    free = jnp.linalg.matrix_power(step.free, short)
    first, rest = jnp.split(gains, [longer * (short + 1)], axis=1)
    return [
        (
            _Joined(power, look[:size], echo[:size], push[:size]),
            part.reshape(len(part), -1, size, *part.shape[2:]),
        )
        for size, power, part in ((short + 1, step.free @ free, first), (short, free, rest))
        if part.size
    ]


def gains_of(
    system: DynamicSystem,
    tangent: CoordinateMatrix,
    own: CoordinateMatrix,
    brakes: CoordinateMatrix,
) -> Reals:
    """Excess load per change of the nodes' mesh coordinates and, with damping cells, their rates.

    **Arguments:**

    - `system`: what moves.
    - `tangent`: stiffness of the mesh [N/m, N, N m].
    - `own`: mesh coordinates given up at once per excess load [m/N, 1/N, 1/(N m)].
    - `brakes`: their rates [m/(N s), 1/(N s), 1/(N m s)].

    **Returns:**

    Rows of the load, beyond the mean stiffness; columns of coordinates, then of rates.
    """
    mean, damping = system.mean, system.cell_damping
    unit = jnp.eye(mean.shape[0])
    # g = T (n - B g) and, with damping, + eta T n'; n and n' are those under the load.
    whole = tangent
    if system.bow is not None:
        whole = jnp.linalg.solve(unit + tangent @ system.bow, tangent)
    excess = whole - mean
    if damping is None:
        return jnp.linalg.solve(unit + excess @ own, excess)
    closed = unit + excess @ own + damping * whole @ brakes
    return jnp.linalg.solve(closed, jnp.concatenate([excess, damping * whole], axis=1))


def _over(joined: _Joined, gains: Reals, state: Reals) -> Reals:
    r"""Columns of states at the end of joined steps.

    Their excess loads obey one equation, $e_k = g_k(l_kx - \sum_{j<k}r_{k-1-j}e_j)$: a triangle of
    few unknowns, with whole matrices to multiply on both sides.
    """
    steps, width, seen = gains.shape
    unknowns, number = steps * width, np.arange(steps)
    echo = jnp.swapaxes(joined.echo, 0, 1).reshape(seen, -1)
    answers = (gains.reshape(unknowns, seen) @ echo).reshape(steps, width, steps, width)
    since = number[:, None] - number[None, :] - 1
    tie = jnp.where(
        (since >= 0)[:, :, None, None], answers[number[:, None], :, np.maximum(since, 0)], 0.0
    )
    matrix = jnp.eye(unknowns) + jnp.swapaxes(tie, 1, 2).reshape(unknowns, unknowns)
    right = (gains @ joined.look).reshape(unknowns, -1) @ state
    excess = jax.scipy.linalg.solve_triangular(matrix, right, lower=True, unit_diagonal=True)
    push = jnp.moveaxis(joined.push[::-1], 0, 1).reshape(-1, unknowns)
    return joined.free @ state - push @ excess
