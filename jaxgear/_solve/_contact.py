r"""Contact of many cells through a few mesh coordinates, at one position.

Unknown are the driven approach $t$ and the loads $g$ on $p$ mesh coordinates. The coordinates are
$q = e\,t - H g$: driven along $e$, less what the structure of flexibility $H$ gives way.
Cell $c$ overlaps by $\Delta_c = W_c q - \delta_c$ and presses with $f_c = k_c\,\sigma(\Delta_c)$.
The state is

$$W^T f = g, \qquad e^T g = F,$$

the minimum of the convex energy $\tfrac12 g^T H g - F t + \sum_c k_c \int\sigma$ (physics A8.2), so
it is unique. $H$ may be singular (bodies that only turn: $H = 0$) and is never inverted.

Rigid gears have $p = 2$. Cells that are coupled through a dense compliance $C$ are the same
problem with $p$ = number of cells, $W$ the identity and $C$ added to $H$.
"""

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._types import (
    CellArms,
    Cells,
    CoordinateMatrix,
    Coordinates,
    Flag,
    Scalar,
)


class ContactProblem(eqx.Module):
    """Cells and structure at one position of the gears.

    **Fields:**

    - `stiffness`: $k$ of each cell, zero where it is out of contact [N/m].
    - `gap`: of each cell before loading [m].
    - `arms`: $W$, overlap of each cell per mesh coordinate [-, m].
    - `flexibility`: $H$ of the mesh coordinates [m/N, 1/N, 1/(N m)].
    - `direction`: $e$, mesh coordinates per driven approach [-].
    - `force`: $F$, the load that drives the approach [N].
    """

    stiffness: Cells
    gap: Cells
    arms: CellArms
    flexibility: CoordinateMatrix
    direction: Coordinates
    force: Scalar


class ContactState(eqx.Module):
    """Where the bodies come to rest.

    **Fields:**

    - `approach`: the driven approach $t$ [m].
    - `load`: $g$, resultants of the cell forces on the mesh coordinates [N, N m].
    - `overlap`: of each cell, negative where it is open [m].
    - `force`: of each cell along the normal [N].
    - `converged`: whether the forces balance to the tolerance.
    - `steps`: Newton steps and step halvings taken [-].
    """

    approach: Scalar
    load: Coordinates
    overlap: Cells
    force: Cells
    converged: Flag
    steps: Array


class SolverSettings(eqx.Module):
    """When to stop.

    **Fields:**

    - `tolerance`: imbalance of the forces over the driving force at which the state counts as
        found, or what rounding leaves if that is more; one more Newton step is then taken [-].
    - `most_steps`: Newton steps and halvings after which the solver gives up.
    """

    tolerance: float = eqx.field(static=True, default=1e-11)
    most_steps: int = eqx.field(static=True, default=200)


Unknown = tuple[Scalar, Coordinates]


def contact_state(
    problem: ContactProblem, law: AbstractContactLaw, settings: SolverSettings
) -> ContactState:
    """Solve one position by semismooth Newton with a line search on the energy.

    Derivatives, forward and reverse and of any order that the law allows, are those of the
    solution, by the implicit function theorem at it. With exact contact they are exact wherever
    no cell is just closing.

    **Arguments:**

    - `problem`: cells and structure.
    - `law`: exact or smooth contact.
    - `settings`: when to stop.

    **Returns:**

    The state, converged or not.
    """

    def imbalance(unknown: Unknown) -> Unknown:
        return _imbalance(problem, law, unknown)[0]

    def solve(residual, start: Unknown):
        del residual
        return _newton(problem, law, start, settings)

    def solve_tangent(linear, right: Unknown) -> Unknown:
        return _solve_linear(linear, right)

    (approach, load), (error, steps) = jax.lax.custom_root(
        imbalance, _start(problem), solve, solve_tangent, has_aux=True
    )
    overlap = _overlap(problem, (approach, load))
    return ContactState(
        approach=approach,
        load=load,
        overlap=overlap,
        force=problem.stiffness * law.compression(overlap),
        converged=error <= settings.tolerance,
        steps=steps.astype(int),
    )


def _overlap(problem: ContactProblem, unknown: Unknown) -> Cells:
    """Overlap of each cell [m]."""
    approach, load = unknown
    place = problem.direction * approach - problem.flexibility @ load
    return _at_cells(problem.arms, place) - problem.gap


# Up to this many mesh coordinates, sums are written out: a batch of tiny matrix products
# costs many times its arithmetic.
_FEW = 2


def _at_cells(arms: CellArms, place: Coordinates) -> Cells:
    """W q."""
    if place.size > _FEW:
        return arms @ place
    total = arms[:, 0] * place[0]
    for i in range(1, place.size):
        total += arms[:, i] * place[i]
    return total


def _on_coordinates(arms: CellArms, force: Cells) -> Coordinates:
    """W^T f."""
    if arms.shape[1] > _FEW:
        return arms.T @ force
    return jnp.stack([jnp.sum(arms[:, i] * force) for i in range(arms.shape[1])])


def _tangent_stiffness(arms: CellArms, stiffness: Cells) -> CoordinateMatrix:
    """W^T k W."""
    if arms.shape[1] > _FEW:
        return arms.T @ (stiffness[:, None] * arms)
    return jnp.stack([_on_coordinates(arms, stiffness * arms[:, i]) for i in range(arms.shape[1])])


def _imbalance(
    problem: ContactProblem, law: AbstractContactLaw, unknown: Unknown
) -> tuple[Unknown, Cells, Cells]:
    """What is missing from both balances, with the overlaps and the cells' tangent stiffness."""
    overlap = _overlap(problem, unknown)
    compression, slope = jax.jvp(law.compression, (overlap,), (jnp.ones_like(overlap),))
    load = _on_coordinates(problem.arms, problem.stiffness * compression)
    driving = problem.direction @ unknown[1] - problem.force
    return (driving, unknown[1] - load), overlap, problem.stiffness * slope


def _newton_step(problem: ContactProblem, tangent: CoordinateMatrix, missing: Unknown) -> Unknown:
    """Solve the linearised balances: (I + S H) dg - S e dt = -r, e^T dg = -r_0."""
    direction = problem.direction
    count = direction.size
    yielding = jnp.eye(count) + tangent @ problem.flexibility
    driven, answer = _solve_small(yielding, (tangent @ direction, -missing[1]))
    step = (-missing[0] - direction @ answer) / (direction @ driven)
    return step, answer + driven * step


def _solve_small(
    matrix: CoordinateMatrix, right: tuple[Coordinates, Coordinates]
) -> tuple[Coordinates, Coordinates]:
    """Solve a system of order 1, 2 or more for two right-hand sides."""
    if right[0].size > _FEW:
        both = jnp.linalg.solve(matrix, jnp.stack(right, axis=1))
        return both[:, 0], both[:, 1]
    if right[0].size == 1:
        return right[0] / matrix[0, 0], right[1] / matrix[0, 0]
    (a, b), (c, d) = matrix
    determinant = a * d - b * c
    return tuple(jnp.stack([d * r[0] - b * r[1], a * r[1] - c * r[0]]) / determinant for r in right)


def _start(problem: ContactProblem) -> Unknown:
    """The state with every cell closed, pulling ones too: never short of contact."""
    tangent = _tangent_stiffness(problem.arms, problem.stiffness)
    load = _on_coordinates(problem.arms, -problem.stiffness * problem.gap)
    missing = (-problem.force, -load)
    return _newton_step(problem, tangent, missing)


def _energy(
    problem: ContactProblem, law: AbstractContactLaw, unknown: Unknown, overlap: Cells
) -> Scalar:
    """The energy that the state minimises [J]."""
    approach, load = unknown
    contact = jnp.sum(problem.stiffness * law.energy(overlap))
    bodies = 0.5 * load @ (problem.flexibility @ load)
    return contact + bodies - problem.force * approach


# Relative error of an overlap, a few units in the last place of its terms.
_ROUNDING = 10.0 * float(np.finfo(float).eps)


class _NewtonState(eqx.Module):
    """Where the search stands.

    **Fields:**

    - `best`: point of least energy so far [m, N, N m].
    - `energy`: there [J].
    - `trial`: point to examine next [m, N, N m].
    - `error`: imbalance at `best` over the driving force [-].
    - `steps`: taken [-].
    """

    best: Unknown
    energy: Scalar
    trial: Unknown
    error: Scalar
    steps: Scalar


def _newton(
    problem: ContactProblem, law: AbstractContactLaw, start: Unknown, settings: SolverSettings
) -> tuple[Unknown, tuple[Scalar, Scalar]]:
    """Newton steps, each halved until the energy falls, then one last full step.

    Also returns the relative imbalance before that step, and the number of steps: as reals,
    for `custom_root` differentiates what comes with its root.
    """
    everything = _tangent_stiffness(problem.arms, problem.stiffness)
    # Loads of all kinds, as forces: a moment over the radius of gyration of the cells.
    own = jnp.diagonal(everything)
    along = problem.direction @ everything @ problem.direction
    scale = jnp.sqrt(jnp.maximum(own, 1e-6 * jnp.max(own)) / along)

    def examine(trial: Unknown) -> tuple[Scalar, Unknown, Scalar]:
        """Energy at a trial, the Newton point from it, and its relative imbalance."""
        missing, overlap, tangent_cells = _imbalance(problem, law, trial)
        tangent = _tangent_stiffness(problem.arms, tangent_cells)
        # Where the trial has lost all contact, every cell pulls it back.
        lost = jnp.sum(tangent_cells) <= 0.0
        tangent = jnp.where(lost, everything, tangent)
        step = _newton_step(problem, tangent, missing)
        size = jnp.abs(missing[0]) + jnp.sum(jnp.abs(missing[1]) / scale)
        # Bodies far softer than the cells move far: overlaps are then differences of large numbers.
        rounding = _ROUNDING * along * jnp.max(jnp.abs(overlap + problem.gap))
        size = jnp.where(size <= rounding, 0.0, size)
        point = (trial[0] + step[0], trial[1] + step[1])
        return _energy(problem, law, trial, overlap), point, size / problem.force

    def body(state: _NewtonState) -> _NewtonState:
        energy, point, error = examine(state.trial)
        # Near the solution the energies differ by rounding only: a full step is then right.
        slack = 1e-13 * jnp.abs(problem.force * state.trial[0])
        better = (energy <= state.energy + slack) | (error <= settings.tolerance)
        halved = jax.tree.map(lambda a, b: 0.5 * (a + b), state.best, state.trial)
        pick = lambda new, old: jax.tree.map(lambda a, b: jnp.where(better, a, b), new, old)
        return _NewtonState(
            best=pick(state.trial, state.best),
            energy=jnp.where(better, energy, state.energy),
            trial=pick(point, halved),
            error=jnp.where(better, error, state.error),
            steps=state.steps + 1.0,
        )

    def unfinished(state: _NewtonState) -> Flag:
        return (state.error > settings.tolerance) & (state.steps < settings.most_steps)

    infinite = jnp.asarray(jnp.inf)
    first = _NewtonState(start, infinite, start, infinite, jnp.zeros(()))
    last = jax.lax.while_loop(unfinished, body, first)
    # `trial` is one Newton step beyond the point whose imbalance met the tolerance.
    return last.trial, (last.error, last.steps)


def _solve_linear(linear, right: Unknown) -> Unknown:
    """Solve `linear(x) = right` for the few unknowns, by its matrix."""
    flat, unravel = jax.flatten_util.ravel_pytree(right)
    matrix = jax.vmap(lambda x: jax.flatten_util.ravel_pytree(linear(unravel(x)))[0])(
        jnp.eye(flat.size)
    ).T
    return unravel(jnp.linalg.solve(matrix, flat))
