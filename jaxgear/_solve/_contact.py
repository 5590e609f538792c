r"""Contact of many cells through a few mesh coordinates, at one position.

Unknown are the driven approach $t$ and the cell forces $f$, or their resultants. The mesh
coordinates are
$q = e\,t - H W^T f$: driven along $e$, less what the structure of flexibility $H$ gives way. Cell
$c$ overlaps by $\Delta = W q - C f - \delta$, where $C$ couples the lines of a slice through the
bodies under the teeth, and presses with $f_c = k_c\,\sigma(\Delta_c)$. With $e^T W^T f = F$ the
state is the minimum of the convex energy
$\tfrac12 f^T(C + W H W^T) f - F t + \sum_c k_c \int\sigma$, so it is unique. $H$ and
$C$ may be singular (bodies that only turn: $H = 0$) and are never inverted.

Rigid gears have two mesh coordinates. Cells that are all coupled are the same problem with as many
coordinates as cells, $W$ the identity and their compliance in $H$.
"""

import dataclasses

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._compiled import compiled
from jaxgear._contact._coupling import body_yield
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._solve._contact_problem import ContactProblem
from jaxgear._solve._coordinates import at_cells, on_coordinates
from jaxgear._solve._linearised import (
    Unknown,
    linearised,
    linearised_once,
    shared_forces,
    solve_linear,
    structure_yield,
)
from jaxgear._types import (
    Cells,
    Coordinates,
    Flag,
    Scalar,
)


class ContactState(eqx.Module):
    """Where the bodies come to rest.

    **Fields:**

    - `approach`: the driven approach $t$ [m].
    - `load`: $W^T f$, resultants of the cell forces on the mesh coordinates [N, N m].
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
    """When to stop (theory 5.3).

    **Fields:**

    - `tolerance`: imbalance of the forces over the driving force at which the state counts as
        found, or what rounding leaves if that is more; where more than that is left, one more
        Newton step is taken [-].
    - `most_steps`: Newton steps and halvings after which the solver gives up.
    """

    tolerance: float = eqx.field(static=True, default=1e-11)
    most_steps: int = eqx.field(static=True, default=200)


@compiled
def contact_state(
    problem: ContactProblem,
    law: AbstractContactLaw,
    settings: SolverSettings,
    near: tuple[Scalar, Cells] | None = None,
) -> ContactState:
    """Solve one position by semismooth Newton with a line search on the energy.

    Derivatives, forward and reverse and of any order that the law allows, are those of the
    solution, by the implicit function theorem at it. With exact contact they are exact wherever
    no cell is just closing (theory 5.2, theory 12.1).

    **Arguments:**

    - `problem`: cells and structure.
    - `law`: exact or smooth contact.
    - `settings`: when to stop.
    - `near`: approach and forces of the cells [m, N] in a state close by, where cells are coupled;
        by default those are closed to begin with that would be if each gave by itself.

    **Returns:**

    The state, converged or not.
    """

    def imbalance(unknown: Unknown) -> Unknown:
        return _imbalance(problem, law, unknown)[0]

    def solve(residual, start: Unknown):
        del residual
        return _newton(problem, law, start, settings, near=near is not None)

    def solve_tangent(linear, right: Unknown) -> Unknown:
        if problem.coupling is None:
            return _solve_probed(linear, right)
        # Driving alone shows the cells' tangent stiffness at the solution.
        driven = linear((jnp.ones(()), jnp.zeros_like(problem.gap)))[1]
        moved = at_cells(problem.arms, problem.direction)
        # In the right-hand side all is linear, and is kept so for transposing.
        linear = linearised(problem, -driven / moved)
        free = shared_forces(problem, linear, right[1])
        return solve_linear(problem, linear, (right[0], free))

    nothing = problem.gap if problem.coupling is not None else problem.direction
    start = (jnp.zeros(()), jnp.zeros_like(nothing)) if near is None else near
    start = jax.lax.stop_gradient(start)
    found, (error, steps) = jax.lax.custom_root(
        imbalance, start, solve, solve_tangent, has_aux=True
    )
    overlap = _overlap(problem, found)
    coupled = problem.coupling is not None
    return ContactState(
        approach=found[0],
        load=_resultants(problem, found),
        overlap=overlap,
        force=found[1] if coupled else problem.stiffness * law.compression(overlap),
        converged=error <= settings.tolerance,
        steps=steps.astype(int),
    )


def settled(problem: ContactProblem, state: ContactState, force: Cells) -> ContactState:
    """The state of all cells, found from that of those that bear.

    **Arguments:**

    - `problem`: of all cells, which are coupled.
    - `state`: of those that may be in contact.
    - `force`: its forces, of all cells [N].

    **Returns:**

    The state, with overlaps of all cells and loads on the mesh coordinates.
    """
    overlap = _overlap(problem, (state.approach, force))
    load = on_coordinates(problem.arms, force)
    return dataclasses.replace(state, load=load, overlap=overlap, force=force)


def _resultants(problem: ContactProblem, unknown: Unknown) -> Coordinates:
    """Loads on the mesh coordinates, g = W^T f [N, N m]."""
    if problem.coupling is None:
        return unknown[1]
    return on_coordinates(problem.arms, unknown[1])


def _place(problem: ContactProblem, unknown: Unknown) -> Cells:
    """Where structure and drive have brought each cell [m]."""
    load = _resultants(problem, unknown)
    return at_cells(problem.arms, problem.direction * unknown[0] - structure_yield(problem, load))


def _overlap(problem: ContactProblem, unknown: Unknown) -> Cells:
    """Overlap of each cell [m]."""
    overlap = _place(problem, unknown) - problem.gap
    if problem.coupling is None:
        return overlap
    return overlap - body_yield(problem.coupling, unknown[1])


def _imbalance(
    problem: ContactProblem, law: AbstractContactLaw, unknown: Unknown
) -> tuple[Unknown, Cells, Cells]:
    """What is missing from both balances, with the overlaps and the cells' tangent stiffness."""
    overlap = _overlap(problem, unknown)
    compression, slope = jax.jvp(law.compression, (overlap,), (jnp.ones_like(overlap),))
    force = problem.stiffness * compression
    if problem.coupling is None:
        force = on_coordinates(problem.arms, force)
    driving = jnp.sum(problem.direction * _resultants(problem, unknown)) - problem.force
    return (driving, unknown[1] - force), overlap, problem.stiffness * slope


def _solve_probed(linear, right: Unknown) -> Unknown:
    """Solve `linear(x) = right` for a few unknowns, by its matrix."""
    flat, unravel = jax.flatten_util.ravel_pytree(right)
    matrix = jax.vmap(lambda x: jax.flatten_util.ravel_pytree(linear(unravel(x)))[0])(
        jnp.eye(flat.size)
    ).T
    return unravel(jnp.linalg.solve(matrix, flat))


def _energy(
    problem: ContactProblem, law: AbstractContactLaw, unknown: Unknown, overlap: Cells
) -> Scalar:
    """The energy that the state minimises [J]."""
    approach, load = unknown[0], _resultants(problem, unknown)
    bodies = jnp.sum(load * structure_yield(problem, load))
    if problem.coupling is not None:
        bodies += jnp.sum(unknown[1] * body_yield(problem.coupling, unknown[1]))
    contact = jnp.sum(problem.stiffness * law.energy(overlap))
    return contact + 0.5 * bodies - problem.force * approach


# Relative error of an overlap, a few units in the last place of its terms.
_ROUNDING = 10.0 * float(np.finfo(float).eps)


# Rounds in which cells that would pull are opened, enough for steep flanks.
_ROUNDS = 4


def _closed_alone(problem: ContactProblem) -> Cells:
    """Cells that close if each gives as under an even load, whatever the others carry: 1, else 0.

    Found without a factor, they are a close guess where cells are coupled.
    """
    assert problem.coupling is not None
    even = jnp.where(problem.stiffness > 0.0, 1.0, 0.0)
    yielding = structure_yield(problem, on_coordinates(problem.arms, even))
    given = body_yield(problem.coupling, even) + at_cells(problem.arms, yielding)
    stiffness = problem.stiffness / (1.0 + problem.stiffness * jnp.maximum(given, 0.0))
    moved = at_cells(problem.arms, problem.direction)
    closed = even
    for _ in range(_ROUNDS):
        held = closed * stiffness * moved
        approach = (problem.force + jnp.sum(held * problem.gap)) / jnp.sum(held * moved)
        closed = jnp.where(moved * approach > problem.gap, even, 0.0)
    return closed


def _all_closed(problem: ContactProblem) -> Unknown:
    """Approach and forces with every cell closed, pulling ones too."""
    linear = linearised(problem, problem.stiffness)
    pull = problem.stiffness * problem.gap
    if problem.coupling is None:
        pull = on_coordinates(problem.arms, pull)
    step = solve_linear(problem, linear, (-problem.force, shared_forces(problem, linear, pull)))
    return jax.tree.map(jnp.negative, step)


class _NewtonState(eqx.Module):
    """Where the search stands.

    **Fields:**

    - `best`: point of least energy so far [m, N].
    - `energy`: there [J].
    - `missing`: what is missing from both balances there [N].
    - `tangent`: stiffness of the cells there [N/m].
    - `error`: imbalance there over the driving force, zero where that is no more than rounding [-].
    - `share`: of the next Newton step that is to be taken [-].
    - `steps`: taken until the state was found [-].
    - `polished`: whether one more was taken since.
    """

    best: Unknown
    energy: Scalar
    missing: Unknown
    tangent: Cells
    error: Scalar
    share: Scalar
    steps: Scalar
    polished: Flag


def _newton(
    problem: ContactProblem,
    law: AbstractContactLaw,
    start: Unknown,
    settings: SolverSettings,
    *,
    near: bool,
) -> tuple[Unknown, tuple[Scalar, Scalar]]:
    """Newton steps, each halved until the energy falls; a last full step where more than rounding
    is left.

    Where all cells are coupled, factors are what costs: from a start that is not near, zero, the
    first step holds a guess of the closed cells, pulling ones too. Where they are not, it closes
    every cell, and is never short of contact. Also returns the relative imbalance before the last
    step, and the number of steps: as reals, for `custom_root` differentiates what comes with its
    root.
    """
    total = jnp.sum(problem.stiffness)
    # Loads of all kinds, as forces: a moment over the radius of gyration of the cells.
    scale = jnp.ones(())
    if problem.coupling is None:
        own = jnp.sum(problem.stiffness[:, None] * problem.arms**2, axis=0)
        along = jnp.sum(problem.stiffness * at_cells(problem.arms, problem.direction) ** 2)
        scale = jnp.sqrt(jnp.maximum(own, 1e-6 * jnp.max(own)) / along)

    def examine(trial: Unknown) -> tuple[Scalar, Unknown, Cells, Scalar]:
        """Energy at a trial, what is missing there, the cells' tangent and the imbalance."""
        missing, overlap, tangent = _imbalance(problem, law, trial)
        # Where the trial has lost all contact, every cell pulls it back.
        tangent = jnp.where(jnp.sum(tangent) <= 0.0, problem.stiffness, tangent)
        size = jnp.abs(missing[0]) + jnp.sum(jnp.abs(missing[1]) / scale)
        # Bodies far softer than the cells move far: overlaps are then differences of large numbers.
        reach = jnp.abs(overlap + problem.gap)
        if problem.coupling is not None:
            reach = jnp.maximum(reach, jnp.abs(_place(problem, trial)))
        size = jnp.where(size <= _ROUNDING * total * jnp.max(reach), 0.0, size)
        return _energy(problem, law, trial, overlap), missing, tangent, size / problem.force

    def body(state: _NewtonState) -> _NewtonState:
        # In a batch the others go on until the last has found its state.
        linear, free = linearised_once(problem, state.tangent, state.missing[1], unfinished(state))
        step = solve_linear(problem, linear, (state.missing[0], free))
        trial = jax.tree.map(lambda x, dx: x - state.share * dx, state.best, step)
        energy, missing, tangent, error = examine(trial)
        # Near the solution the energies differ by rounding only: a full step is then right.
        slack = 1e-13 * jnp.abs(problem.force * trial[0])
        better = (energy <= state.energy + slack) | (error <= settings.tolerance)
        found = (trial, energy, missing, tangent, error, jnp.ones(()))
        last = (state.best, state.energy, state.missing, state.tangent, state.error)
        picked = jax.tree.map(
            lambda new, old: jnp.where(better, new, old), found, (*last, 0.5 * state.share)
        )
        going = searching(state)
        polished = dataclasses.replace(state, best=trial, polished=jnp.asarray(True))
        moved = _NewtonState(*picked, steps=state.steps + 1.0, polished=jnp.asarray(False))
        return jax.tree.map(lambda new, old: jnp.where(going, new, old), moved, polished)

    def searching(state: _NewtonState) -> Flag:
        going = (state.error > settings.tolerance) & (state.steps < settings.most_steps)
        return going | (state.steps < 1.0)

    def unfinished(state: _NewtonState) -> Flag:
        return searching(state) | ((state.error > 0.0) & ~state.polished)

    zero, one, no = jnp.zeros(()), jnp.ones(()), jnp.asarray(False)
    unknown = jnp.inf * one
    if near:
        energy, missing, tangent, _ = examine(start)
        first = _NewtonState(start, energy, missing, tangent, unknown, one, zero, no)
    elif problem.coupling is not None and problem.coupling.ndim == 2:
        closed = problem.stiffness * _closed_alone(problem)
        missing = -problem.force, closed * problem.gap
        first = _NewtonState(start, unknown, missing, closed, unknown, one, zero, no)
    else:
        closed = _all_closed(problem)
        first = _NewtonState(closed, *examine(closed), one, one, no)
    last = jax.lax.while_loop(unfinished, body, first)
    return last.best, (last.error, last.steps)
