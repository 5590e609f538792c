"""Quasi-static mesh cycles: the contact state at every phase, at vanishing speed."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxgear._checks import require_float64
from jaxgear._compiled import compiled, known_to_fail
from jaxgear._contact._cells import (
    MeshCells,
    at_line_loads,
    at_window_ends,
    mesh_cells,
    mesh_gap,
    nominal_line_load,
)
from jaxgear._geometry._lines import MeshGrid
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._solve._contact import ContactState, SolverSettings, contact_state, settled
from jaxgear._solve._contact_problem import ContactProblem, among_cells, between_cells
from jaxgear._solve._coordinates import on_coordinates
from jaxgear._system._flexible import condensed
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import PairSystem, on_condensed_bodies
from jaxgear._system._structure import check_torque
from jaxgear._types import (
    CellArms,
    CellGrid,
    Cells,
    CoordinateGrid,
    Counts,
    Coupling,
    Flags,
    Phases,
    Scalar,
)


class MeshCycle(eqx.Module):
    r"""The settled states of one cycle of mesh periods.

    **Fields:**

    - `system`: bodies, supports and torque.
    - `cells`: that were in mesh.
    - `approach`: driven normal approach, $(r_{b1}\theta_1 + r_{b2}\theta_2)\cos\beta_b$ [m].
    - `load`: resultants of the cell forces on the mesh coordinates [N, N m].
    - `overlap`: of each cell, negative where it is open [m].
    - `force`: of each cell along the normal [N].
    - `converged`: whether each phase was solved, with every contact line in the grid.
    - `steps`: solver steps at each phase [-].
    """

    system: PairSystem
    cells: MeshCells
    approach: Phases
    load: CoordinateGrid
    overlap: CellGrid
    force: CellGrid
    converged: Flags
    steps: Counts


@compiled
def quasi_static(
    system: PairSystem,
    cells: MeshCells,
    gap: CellGrid,
    *,
    law: AbstractContactLaw,
    settings: SolverSettings,
    near: MeshCycle | None = None,
) -> MeshCycle:
    """Solve the contact of given cells at every phase of a cycle.

    **Arguments:**

    - `system`: bodies, supports and torque.
    - `cells`: from `mesh_cells`.
    - `gap`: of each cell, from `mesh_gap` [m].
    - `law`: exact or smooth contact.
    - `settings`: when to stop.
    - `near`: states of cells that are little different, from which those that are all coupled
        begin; it changes the time taken.

    **Returns:**

    The cycle; look at its `converged`.

    **Raises:**

    - `ValueError` in single precision.
    """
    require_float64()

    def at_phase(
        stiffness: Cells,
        gap: Cells,
        arms: CellArms,
        coupling: Coupling | None,
        begin: tuple[Scalar, Cells] | None,
        kept: Array | None,
    ) -> ContactState:
        problem = ContactProblem(
            stiffness=stiffness,
            gap=gap,
            arms=arms,
            flexibility=system.mesh_flexibility,
            direction=system.direction,
            force=system.force,
            coupling=coupling,
        )
        if coupling is None or coupling.ndim > 2:
            return contact_state(problem, law, settings)
        return _where_kept(problem, law, settings, begin, kept)

    arms = system.arms(cells)
    # Written out, as in the solver: the offset brings the flanks closer before any load.
    gap -= sum(arms[..., i] * offset for i, offset in enumerate(system.mesh_offset))
    if cells.growth is not None:
        gap -= cells.growth
    begin = None if near is None else (near.approach, near.force)
    state = jax.vmap(at_phase)(cells.stiffness, gap, arms, cells.coupling, begin, cells.lines.kept)
    return MeshCycle(
        system=system,
        cells=cells,
        approach=state.approach,
        load=state.load,
        overlap=state.overlap,
        force=state.force,
        converged=state.converged & cells.lines.complete,
        steps=state.steps,
    )


def _where_kept(
    problem: ContactProblem,
    law: AbstractContactLaw,
    settings: SolverSettings,
    near: tuple[Scalar, Cells] | None,
    kept: Array | None,
) -> ContactState:
    """Solve a problem of coupled cells with those alone that may be in contact.

    Factors are what costs, and most cells of a helical pair are out of mesh.
    """
    if kept is None:
        state = contact_state(between_cells(problem), law, settings, near)
        return dataclasses.replace(state, load=on_coordinates(problem.arms, state.force))
    near = None if near is None else (near[0], near[1][kept])
    state = contact_state(between_cells(among_cells(problem, kept)), law, settings, near)
    force = jnp.zeros_like(problem.gap).at[kept].set(state.force)
    return settled(problem, state, force)


def mesh_cycle(
    model: PairModel,
    grid: MeshGrid,
    *,
    law: AbstractContactLaw = ExactContact(),
    settings: SolverSettings = SolverSettings(),
    throw: bool = True,
    throw_in_jit: bool = False,
) -> MeshCycle:
    """Run a pair quasi-statically through one cycle.

    It is compiled as a whole, once for all real numbers of the model.

    **Arguments:**

    - `model`: gears, flanks, supports and torque.
    - `grid`: phases, lines and slices, from `mesh_grid`.
    - `law`: exact or smooth contact.
    - `settings`: when to stop.
    - `throw`: whether an unsolved phase raises. Inside another program, under `jax.jit` or
        `jax.vmap`, its values are not known, and nothing is raised: look at `converged`.
    - `throw_in_jit`: whether it raises there too, by a call back to the host. JAX keeps no program
        with such a call in its cache.

    **Returns:**

    The cycle.

    **Raises:**

    - `ValueError` in single precision, or if the torque is not positive.
    - `RuntimeError` if a phase was not solved and `throw` is true.
    """
    require_float64()
    cycle = corrected_cycle(prepare_mesh(model, grid), model, law=law, settings=settings)
    if throw and known_to_fail(cycle.converged):
        raise RuntimeError(_unsolved(np.asarray(cycle.converged)))
    if throw_in_jit:
        return eqx.error_if(cycle, ~cycle.converged, _UNSOLVED)
    return cycle


class PreparedMesh(eqx.Module):
    """What flank corrections do not change: prepare it once, and search over flanks.

    **Fields:**

    - `system`: bodies, supports and torque.
    - `cells`: place and stiffness of the mesh cells.
    """

    system: PairSystem
    cells: MeshCells


def prepare_mesh(model: PairModel, grid: MeshGrid) -> PreparedMesh:
    """Do the part of a mesh cycle that does not depend on `model.flanks`.

    **Arguments:**

    - `model`: gears, supports and torque; its flanks are not looked at.
    - `grid`: phases, lines and slices, from `mesh_grid`.

    **Returns:**

    System and cells.

    **Raises:**

    - `ValueError` if the torque is not positive, or if a condensed body was made for another grid.
    """
    check_torque(model.pinion_support, model.torque)
    return _prepared(model, grid)


@compiled
def _prepared(model: PairModel, grid: MeshGrid) -> PreparedMesh:
    """See `prepare_mesh`."""
    pair = model.pair
    for _, body in condensed(model.bodies):
        body.check_grid(grid)
    load = nominal_line_load(pair, model.mesh_torque)
    cells = mesh_cells(pair, grid, model.tooth_compliance, load)
    return PreparedMesh(
        system=model.system(),
        cells=on_condensed_bodies(pair, cells, model.bodies, model.speed),
    )


@compiled
def corrected_cycle(
    prepared: PreparedMesh,
    model: PairModel,
    *,
    law: AbstractContactLaw = ExactContact(),
    settings: SolverSettings = SolverSettings(),
) -> MeshCycle:
    """Finish a mesh cycle for the flanks and the misalignment of `model`.

    **Arguments:**

    - `prepared`: from `prepare_mesh` of a model that differs in flanks or misalignment at most.
    - `model`: gives the flanks.
    - `law`: exact or smooth contact.
    - `settings`: when to stop.

    **Returns:**

    The cycle; look at its `converged`.

    **Raises:**

    - `ValueError` in single precision.
    """
    cells = prepared.cells
    gap = mesh_gap(model.pair, cells.lines, model.flanks, model.misalignment)
    cycle = quasi_static(prepared.system, cells, gap, law=law, settings=settings)
    for _ in range(model.compliance.load_updates):
        softening = model.compliance.log_slope(model.pair)
        nominal = nominal_line_load(model.pair, model.mesh_torque)
        loaded = at_line_loads(cells, cycle.force, nominal, softening)
        cycle = quasi_static(prepared.system, loaded, gap, law=law, settings=settings, near=cycle)
    if cells.lines.beyond > 0.0:
        # Teeth that touch where the search for tip contact ends might touch beyond it too.
        reached = jnp.sum(at_window_ends(model.pair, cells.lines) * cycle.force, axis=1) > 0.0
        cycle = dataclasses.replace(cycle, converged=cycle.converged & ~reached)
    return cycle


_UNSOLVED = (
    "The contact was not solved at some phase of the mesh cycle: forces still out of balance "
    "after `SolverSettings.most_steps` steps, or contact lines outside of the grid. Raise "
    "`most_steps`, or make the grid from this pair, with a larger `margin` if it is traced; if "
    "gaps are far larger than deflections, check the units of the flank corrections; with "
    "tip contact, look for it further `beyond` the path."
)


def _unsolved(converged: np.ndarray) -> str:
    """What went wrong, and at how many phases."""
    where = np.flatnonzero(~converged)
    return f"{_UNSOLVED} Not solved: {where.size} of {converged.size} phases, first {where[0]}."
