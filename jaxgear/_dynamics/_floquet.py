r"""Floquet's multipliers: how a disturbance of a periodic response grows in one period.

In every step the mesh ties the modes together through its few coordinates only, so that the
derivative of a cycle by its start, the monodromy matrix, is a product of steps that each cost a few
columns. Its eigenvalues are Floquet's multipliers: beyond 1 in size the response is there, but no
machine stays on it. One leaves through +1 at a fold, through -1 where the period doubles.
"""

import contextlib
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
import scipy
from jaxtyping import Array, Float

from jaxgear._compiled import lasting
from jaxgear._dynamics._cell_forces import mean_tangent, mesh_load
from jaxgear._dynamics._march_step import March, Rule, march_of
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._steppers import AbstractStepper, Exponential
from jaxgear._dynamics._system import DynamicSystem, ModalBasis
from jaxgear._dynamics._table import END, MIDDLE, START, mesh_at
from jaxgear._dynamics._types import StepMatrices, StepPlaces
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._types import CoordinateMatrix, Reals, Scalar

# A multiplier counts as beyond 1 from here: rounding and truncated harmonics shift it by less.
STABLE = 1.0 + 1e-6

# Derivatives of the state of all modes by its start, both parts; each flattened.
Monodromy = Float[Array, "state state"]


@lasting
def monodromy(
    system: DynamicSystem,
    modes: ModalBasis,
    orbit: Orbit,
    *,
    stepper: AbstractStepper = Exponential(),
    law: AbstractContactLaw = ExactContact(),
    follows: CoordinateMatrix | None = None,
) -> Monodromy:
    """Derivative of the state at the end of a response by that at its start (theory 10.1).

    A cell that closes within a step counts for the part of the step in which it is closed: what is
    found converges with the square of the step, where the derivative of the steps themselves
    has the error of a whole step wherever contact changes.

    **Arguments:**

    - `system`: what moves.
    - `modes`: its natural modes.
    - `orbit`: of this system, by any method, over one or more cycles.
    - `stepper`: `Midpoint` or, exact in the linear part, `Exponential`.
    - `law`: contact law whose tangent stiffness counts.
    - `follows`: what modes that are left out give, from `slow_modes` [m/N, 1/N, 1/(N m)].

    **Returns:**

    A square matrix on displacements of all modes, then velocities, of unit modal mass.
    """
    return monodromy_along(
        system, modes, orbit.speed, orbit.place, stepper=stepper, law=law, follows=follows
    )


def monodromy_along(
    system: DynamicSystem,
    modes: ModalBasis,
    speed: Scalar,
    places: StepPlaces,
    *,
    stepper: AbstractStepper = Exponential(),
    law: AbstractContactLaw = ExactContact(),
    follows: CoordinateMatrix | None = None,
) -> Monodromy:
    """As `monodromy`, of a response whose mesh coordinates in mid-steps are known [m, rad]."""
    multiple = places.shape[0] // len(system.table.kinds)
    system = system.over(multiple)
    march = march_of(stepper, law, system, modes, speed)
    if not isinstance(law, ExactContact):
        return product_of_steps(march, tangents_of(march, places), follows)
    around = jnp.concatenate([places[-1:], places, places[:1]])
    ends = 0.5 * (around[:-1] + around[1:])
    start, middle, end = (mesh_at(system.table, part).at(speed) for part in (START, MIDDLE, END))
    mean = jax.vmap(mean_tangent)(start, middle, end, ends[:-1], ends[1:])
    return product_of_steps(march, mean, follows)


# Modes that swing in the multipliers of a sweep. Of the wheels of the accessory and the power pair
# 120 give the largest multiplier of twelve speeds to 1e-8, and 60 to 2e-8.
_SLOW = 80


class SlowModes(eqx.Module):
    """The modes by which disturbances die away last, and what all others give.

    **Fields:**

    - `basis`: of the slowest modes.
    - `follows`: mesh coordinates that the others give per excess load, at once; `None`: there are
        no others [m/N, 1/N, 1/(N m)].
    """

    basis: ModalBasis
    follows: CoordinateMatrix | None


def slow_modes(modes: ModalBasis, count: int = _SLOW) -> SlowModes:
    """The slowest modes of a system. The faster ones follow an excess load as springs do.

    **Arguments:**

    - `modes`: of a system.
    - `count`: modes to keep.

    **Returns:**

    They, and the compliance of the others.
    """
    if modes.square.size <= count:
        return SlowModes(modes, None)
    order = jnp.argsort(modes.square)
    slow, fast = (
        jax.tree.map(lambda x, i=i: x[i], _by_mode(modes)) for i in (order[:count], order[count:])
    )
    return SlowModes(_by_mode(slow), fast.mesh.T @ (fast.mesh / fast.square[:, None]))


def _by_mode(modes: ModalBasis) -> ModalBasis:
    """The same with the modes on the first axis of all arrays, or back."""
    return eqx.tree_at(lambda m: m.shape, modes, modes.shape.T)


def floquet_multipliers(monodromies: Array | np.ndarray, modes: ModalBasis) -> np.ndarray:
    """Floquet's multipliers, the eigenvalues of monodromy matrices, largest first (theory 10.1).

    This is not for tracing: no platform but the CPU finds eigenvalues of such matrices.

    **Arguments:**

    - `monodromies`: one, or many on leading axes.
    - `modes`: of the system: scaled by its frequencies, eigenvalues lose fewer digits.

    **Returns:**

    The multipliers on the last axis [-].
    """
    return _largest_first(np.linalg.eigvals(_scaled(monodromies, modes)))


# From this size on a few eigenvalues are found by Arnoldi's method: so many, in a subspace of so
# many vectors. Of the 470 of the accessory wheel on 200 shapes all take ten times as long.
_LARGE, _LEADING, _SUBSPACE = 200, 8, 60


def leading_multipliers(monodromy: Array | np.ndarray, modes: ModalBasis) -> np.ndarray:
    """The largest of Floquet's multipliers; of small systems all.

    **Arguments:**

    - `monodromy`: one matrix.
    - `modes`: of the system.

    **Returns:**

    The multipliers, largest first [-].
    """
    scaled = _scaled(monodromy, modes)
    if len(scaled) < _LARGE or not np.all(np.isfinite(scaled)):
        return _largest_first(np.linalg.eigvals(scaled))
    # Of many that hardly differ in size Arnoldi's method may not find all that it should.
    with contextlib.suppress(scipy.sparse.linalg.ArpackError):
        start = np.random.default_rng(0).standard_normal(len(scaled))
        found: Any = scipy.sparse.linalg.eigs(
            scaled, k=_LEADING, ncv=_SUBSPACE, v0=start, return_eigenvectors=False
        )
        return _largest_first(found)
    return _largest_first(np.linalg.eigvals(scaled))


def _scaled(monodromies: Array | np.ndarray, modes: ModalBasis) -> np.ndarray:
    """Matrices by the frequencies, so that displacements and velocities are of one size."""
    speed = np.sqrt(np.asarray(modes.square))
    weights = np.concatenate([speed, np.ones_like(speed)])
    return np.asarray(monodromies) * weights[:, None] / weights[None, :]


def _largest_first(found: np.ndarray) -> np.ndarray:
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
    gains = jax.vmap(lambda *x: _gains(march.system, *x))(tangents, *own)
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


def _gains(
    system: DynamicSystem,
    tangent: CoordinateMatrix,
    own: CoordinateMatrix,
    brakes: CoordinateMatrix,
) -> Reals:
    """Excess load of a step per change of the nodes' mesh coordinates, and of their rates."""
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
