"""What the mesh presses with at the end of a step whose motion depends on it."""

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxgear._dynamics._cell_forces import forces_between_all, mean_load, mesh_load
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._orbit import derivative_if
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._solve._coordinates import small_solver
from jaxgear._types import CoordinateMatrix, Coordinates, Scalar


class Pressing(eqx.Module):
    """The contact problem of one step: the mesh load $g$ at $m = c - Hg$.

    **Fields:**

    - `law`: exact or smooth contact.
    - `meshes`: the cells at the instant of the load or, averaged over the step, at its start,
        middle and end.
    - `begun`: mesh coordinates where the step starts, if contact is averaged [m, rad].
    - `place`: $c$, mesh coordinates without mesh load [m, rad].
    - `yields`: $H$ [m/N, 1/N, 1/(N m)].
    - `rate`: rates without mesh load [m/s, rad/s].
    - `brakes`: rates given up per mesh load [m/(N s), 1/(N s), 1/(N m s)].
    - `cell_damping`: of the system, or `None` [s].
    - `scale`: of the loads, the static mesh force [N].
    """

    law: AbstractContactLaw
    meshes: tuple[Mesh, ...]
    begun: Coordinates | None
    place: Coordinates
    yields: CoordinateMatrix
    rate: Coordinates
    brakes: CoordinateMatrix
    cell_damping: Scalar | None
    scale: Scalar


def _pushed(problem: Pressing, load: Coordinates) -> tuple[Coordinates, CoordinateMatrix]:
    """Load that the mesh would give back, and minus its derivative by `load`."""
    place = problem.place - matrix_vector(problem.yields, load)
    if problem.begun is not None:
        begin, middle, end = problem.meshes
        ended = 2.0 * place - problem.begun
        found, _, tangent = mean_load(begin, middle, end, problem.begun, ended)
        return found, 2.0 * matrix_product(tangent, problem.yields)
    mesh, loss = problem.meshes[0], problem.cell_damping
    if loss is None:
        found, tangent = mesh_load(mesh, place, problem.law)
        return found, matrix_product(tangent, problem.yields)

    def total(load: Coordinates) -> Coordinates:
        elastic, tangent = mesh_load(
            mesh, problem.place - matrix_vector(problem.yields, load), problem.law
        )
        rate = problem.rate - matrix_vector(problem.brakes, load)
        return elastic + loss * matrix_vector(tangent, rate)

    return total(load), -jax.jacfwd(total)(load)


def matrix_vector(matrix: CoordinateMatrix, place: Coordinates) -> Coordinates:
    """A product written out: with few coordinates cheaper than a call."""
    return jnp.sum(matrix * place[None, :], axis=1)


def matrix_product(first: CoordinateMatrix, second: CoordinateMatrix) -> CoordinateMatrix:
    """Product of two small matrices, written out too."""
    return jnp.sum(first[:, :, None] * second[None, :, :], axis=1)


# Imbalance of a mesh load over the static force, steps to reach it, and the steps that are taken
# whole even if the imbalance rises.
CONTACT_TOLERANCE, _MOST_STEPS, _FREE_STEPS = 1e-11, 40, 6


@jax.custom_jvp
def pressed(problem: Pressing, first: Coordinates) -> tuple[Coordinates, Scalar]:
    """Solve the contact of one step, from a load close by.

    Derivatives are those of the solution, by the implicit function theorem; if it was not found,
    NaN.

    **Arguments:**

    - `problem`: the contact of the step.
    - `first`: a load to begin with [N, N m].

    **Returns:**

    The mesh load [N, N m], and what it is out of balance, over the static force [-].
    """
    coupling = problem.meshes[0].coupling
    held = problem.begun is None and problem.cell_damping is None
    if held and coupling is not None and coupling.ndim == 2:
        return _pressed_at_once(problem)
    weights = 1.0 / _load_scales(problem)

    def body(state):
        best, error, trial, steps = state
        found, slope = _pushed(problem, trial)
        missing = found - trial
        now = jnp.max(jnp.abs(missing) * weights)
        step = small_solver(jnp.eye(trial.size) + slope)(missing)
        better = (now < error) | (steps < _FREE_STEPS)
        point = jnp.where(better, trial + step, 0.5 * (best + trial))
        best = jnp.where(better, trial, best)
        return best, jnp.where(better, now, error), point, steps + 1

    def unfinished(state):
        return ~(state[1] <= CONTACT_TOLERANCE) & (state[3] < _MOST_STEPS)

    last = jax.lax.while_loop(unfinished, body, (first, jnp.asarray(jnp.inf), first, 0))
    return last[2], last[1]


def _pressed_at_once(problem: Pressing) -> tuple[Coordinates, Scalar]:
    """As `pressed`: where all cells are coupled, what the nodes give way is coupling as well."""
    mesh, law = problem.meshes[0], problem.law
    assert mesh.coupling is not None
    coupling = mesh.coupling + mesh.arms @ problem.yields @ mesh.arms.T
    free = mesh.arms @ problem.place - mesh.gap
    # Gyroscopic forces tie the modes together, not alike in both directions.
    force = forces_between_all(law, mesh.stiffness, coupling, free, False)
    missing = mesh.stiffness * law.compression(free - coupling @ force) - force
    load, error = mesh.arms.T @ force, jnp.abs(mesh.arms.T @ missing) / _load_scales(problem)
    return load, jnp.max(error)


@pressed.defjvp
def _pressed_tangent(primals, tangents):
    problem, first = primals
    load, error = pressed(problem, first)
    _, slope = _pushed(problem, load)
    _, change = jax.jvp(lambda p: _pushed(p, load)[0], (problem,), (tangents[0],))
    moved = small_solver(jnp.eye(load.size) + slope)(change)
    moved = derivative_if(error <= CONTACT_TOLERANCE, moved)
    return (load, error), (moved, jnp.zeros_like(error))


def load_at_nodes(
    system: DynamicSystem,
    law: AbstractContactLaw,
    mesh: Mesh,
    nodes: Coordinates,
    near: Coordinates,
) -> tuple[Coordinates, Coordinates, Scalar]:
    """Elastic load of the mesh where the nodes are known: behind them bodies may still bow.

    **Arguments:**

    - `system`: what moves.
    - `law`: exact or smooth contact.
    - `mesh`: cells at one instant.
    - `nodes`: mesh coordinates of the nodes [m, rad].
    - `near`: a load to begin with [N, N m].

    **Returns:**

    The load [N, N m], the mesh coordinates of the cells [m, rad], and what the load is out of
    balance, over the static force [-].
    """
    if system.bow is None:
        return mesh_load(mesh, nodes, law)[0], nodes, jnp.zeros(())
    problem = Pressing(
        law=law,
        meshes=(mesh,),
        begun=None,
        place=nodes,
        yields=system.bow,
        rate=jnp.zeros_like(nodes),
        brakes=jnp.zeros_like(system.bow),
        cell_damping=None,
        scale=system.force,
    )
    load, error = pressed(problem, near)
    return load, nodes - matrix_vector(system.bow, load), error


def _load_scales(problem: Pressing) -> Coordinates:
    """Sizes of the mesh loads: the static force, and its moment at the cells' arms [N, N m]."""
    arms = problem.meshes[0].arms
    return problem.scale * jnp.maximum(jnp.max(jnp.abs(arms), axis=0), 1e-9)
