"""The balances of a contact problem, linearised where its cells have some tangent stiffness."""

import equinox as eqx
import jax.numpy as jnp

from jaxgear._contact._coupling import (
    Sharing,
    shared,
    shared_where_needed,
    sharing_with_body,
)
from jaxgear._solve._contact_problem import ContactProblem
from jaxgear._solve._coordinates import (
    at_cells,
    on_coordinates,
    on_coordinates_all,
    small_solver,
)
from jaxgear._types import CellArms, Cells, Coordinates, Flag, Loads, Scalar

# Driven approach, and the loads. Where a body couples cells these are the forces of all cells; else
# the few resultants g = W^T f say as much, and a batch of problems stays small.
Unknown = tuple[Scalar, Loads]


class Linearised(eqx.Module):
    """What solves the balances, linearised where the cells have some tangent stiffness.

    **Fields:**

    - `sharing`: how the cells share with the bodies, or `None` where nothing couples them or no
        more forces are to come.
    - `structure`: forces on the cells per motion of the mesh coordinates [N/m, N].
    """

    sharing: Sharing | None
    structure: CellArms


def linearised(problem: ContactProblem, tangent: Cells) -> Linearised:
    """Prepare to solve, see `solve_linear`: the part that knows neither gaps nor forces.

    **Arguments:**

    - `problem`: cells and structure.
    - `tangent`: stiffness of the cells, zero where one is open [N/m].

    **Returns:**

    What `shared_forces` and `solve_linear` need.
    """
    structure = tangent[:, None] * problem.arms
    if problem.coupling is None:
        return Linearised(None, structure)
    sharing = sharing_with_body(problem.coupling, tangent)
    return Linearised(sharing, shared(problem.coupling, sharing, structure))


def linearised_once(
    problem: ContactProblem, tangent: Cells, right: Loads, needed: Flag
) -> tuple[Linearised, Loads]:
    """The same for one right-hand side, in which the bodies share at once.

    **Arguments:**

    - `problem`: cells and structure.
    - `tangent`: stiffness of the cells, zero where one is open [N/m].
    - `right`: forces on the cells, or loads [N].
    - `needed`: whether the answer is of use; else nothing is factorised.

    **Returns:**

    What `solve_linear` needs, and its right-hand side.
    """
    structure, coupling = tangent[:, None] * problem.arms, problem.coupling
    if coupling is None:
        return Linearised(None, structure), right
    columns = shared_where_needed(coupling, tangent, problem.arms, right, needed)
    return Linearised(None, columns[:, :-1]), columns[:, -1]


def shared_forces(problem: ContactProblem, linear: Linearised, forces: Loads) -> Loads:
    """Let the bodies share in forces on the cells.

    **Arguments:**

    - `problem`: cells and structure.
    - `linear`: from `linearised`.
    - `forces`: on the cells, or loads where nothing couples them [N].

    **Returns:**

    The right-hand side of `solve_linear` [N].
    """
    if problem.coupling is None or linear.sharing is None:
        return forces
    return shared(problem.coupling, linear.sharing, forces[:, None])[:, 0]


def solve_linear(
    problem: ContactProblem, linear: Linearised, right: tuple[Scalar, Loads]
) -> Unknown:
    """Solve the linearised balances for the step in drive and forces.

    They read e^T W^T df = r_0 and df + K (C + W H W^T) df - K W e dt = r. Slices are solved
    first, which makes of r what `right` has, then the few mesh coordinates that tie them, then the
    drive.

    **Arguments:**

    - `problem`: cells and structure.
    - `linear`: from `linearised` or `linearised_once`.
    - `right`: of the balance of the drive, and of the cells once bodies have shared in it [N].

    **Returns:**

    The step [m, N].
    """
    arms, direction, free = problem.arms, problem.direction, right[1]
    coupled = problem.coupling is not None
    load = on_coordinates(arms, free) if coupled else free
    stiffness = on_coordinates_all(arms, linear.structure)
    # With dg = W^T df: (I + S H) dg = W^T r' + S e dt.
    yielding = small_solver(jnp.eye(direction.size) + stiffness @ problem.flexibility)
    driven = yielding(jnp.sum(stiffness * direction[None, :], axis=1))
    answer = yielding(load)
    step = (right[0] - jnp.sum(direction * answer)) / jnp.sum(direction * driven)
    load = answer + driven * step
    if not coupled:
        return step, load
    return step, free + at_cells(
        linear.structure, direction * step - structure_yield(problem, load)
    )


def structure_yield(problem: ContactProblem, load: Coordinates) -> Coordinates:
    """How the structure gives way under loads on its mesh coordinates, $H g$ [m]."""
    return jnp.sum(problem.flexibility * load[None, :], axis=1)
