"""Cells and structure at one position of the gears, and the same problem in fewer unknowns."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxgear._types import (
    CellArms,
    Cells,
    CoordinateMatrix,
    Coordinates,
    Coupling,
    Scalar,
)


class ContactProblem(eqx.Module):
    """Cells and structure at one position of the gears.

    **Fields:**

    - `stiffness`: $k$ of each cell, zero where it is out of contact [N/m].
    - `gap`: of each cell before loading [m].
    - `arms`: $W$, overlap of each cell per mesh coordinate [-, m].
    - `flexibility`: $H$ of the mesh coordinates [m/N, 1/N, 1/(N m)].
    - `direction`: $e$, mesh coordinates per driven approach; it moves every cell [-].
    - `force`: $F$, the load that drives the approach [N].
    - `coupling`: $C$ between the lines of each slice, or `None` [m/N].
    """

    stiffness: Cells
    gap: Cells
    arms: CellArms
    flexibility: CoordinateMatrix
    direction: Coordinates
    force: Scalar
    coupling: Coupling | None = None


def between_cells(problem: ContactProblem) -> ContactProblem:
    """The same problem with all that gives between its cells, and the drive alone beside them.

    Where all cells are coupled anyway, this spares the solver the mesh coordinates.

    **Arguments:**

    - `problem`: with a coupling of all cells.

    **Returns:**

    The problem, of one mesh coordinate that does not give.
    """
    assert problem.coupling is not None
    arms = problem.arms
    return ContactProblem(
        stiffness=problem.stiffness,
        gap=problem.gap,
        arms=(arms @ problem.direction)[:, None],
        flexibility=jnp.zeros((1, 1)),
        direction=jnp.ones(1),
        force=problem.force,
        coupling=problem.coupling + arms @ (problem.flexibility @ arms.T),
    )


def among_cells(problem: ContactProblem, kept: Array) -> ContactProblem:
    """The same problem of some of its cells, where all are coupled.

    **Arguments:**

    - `problem`: with a coupling of all cells.
    - `kept`: their numbers; the others must be out of contact, of no stiffness.

    **Returns:**

    The smaller problem.
    """
    assert problem.coupling is not None
    return dataclasses.replace(
        problem,
        stiffness=problem.stiffness[kept],
        gap=problem.gap[kept],
        arms=problem.arms[kept],
        coupling=problem.coupling[kept[:, None], kept[None, :]],
    )
