r"""The mesh as a function of time: what its cells are at every step of a cycle, and how they push.

A cycle is divided into the steps that the phases of a quasi-static cycle stand for. They are
aligned with the entry and the exit of tooth pairs, so that stiffness jumps between steps and never
within one; it is constant over each, while gaps and arms are known where a step starts, in its
middle, and where it ends: both limits of whatever jumps.
"""

import dataclasses
import functools
import operator
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxgear._compiled import compiled
from jaxgear._contact._cells import MeshCells, Misalignment, mesh_gap
from jaxgear._contact._coupling import body_yield, share_with_body
from jaxgear._dynamics._types import (
    Edges,
    PlaceArms,
    PlaceCells,
    StepCells,
    StepCoupling,
)
from jaxgear._flank._deviations import Flanks
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._system._pair_system import PairSystem
from jaxgear._types import (
    CellArms,
    CellColumns,
    Cells,
    CoordinateMatrix,
    Coordinates,
    Coupling,
    Reals,
    Scalar,
)

_Where = Bool[Array, "..."]


class MeshTable(eqx.Module):
    """The cells of a mesh over one cycle.

    **Fields:**

    - `edges`: ends of the time steps, in mesh periods from the start of the cycle [-].
    - `stiffness`: of each cell, its mean over the step [N/m].
    - `gap`: of each cell before loading, at the start, middle and end of each step [m].
    - `arms`: $W$, overlap of each cell per mesh coordinate, at the same places [-, m].
    - `coupling`: $C$ between the lines of each slice through the bodies or, on condensed bodies,
        between all cells, or `None` [m/N].
    - `periods`: mesh periods in the cycle.
    - `kinds`: a number for each step; steps of one number are equally long.
    - `growth`: approach of each cell by rotation, per square of the pinion's speed, at the same
        places as the gap, or `None` [m s2].
    """

    edges: Edges
    stiffness: StepCells
    gap: PlaceCells
    arms: PlaceArms
    coupling: StepCoupling | None
    periods: int = eqx.field(static=True)
    kinds: tuple[int, ...] = eqx.field(static=True)
    growth: PlaceCells | None = None

    @property
    def lengths(self) -> Reals:
        """Length of each step in mesh periods [-]."""
        return jnp.diff(self.edges)

    @property
    def middles(self) -> Reals:
        """Middle of each step in mesh periods from the start of the cycle [-]."""
        return 0.5 * (self.edges[:-1] + self.edges[1:])


class Mesh(eqx.Module):
    """The cells at one instant, or at each of many on a leading axis.

    **Fields:**

    - `stiffness`: of each cell [N/m].
    - `gap`: of each cell [m].
    - `arms`: $W$ [-, m].
    - `coupling`: between the lines of each slice, or all cells, or `None` [m/N].
    - `growth`: approach of each cell by rotation, per square of the speed, or `None` [m s2].
    """

    stiffness: Reals
    gap: Reals
    arms: Reals
    coupling: Reals | None
    growth: Reals | None = None

    def at(self, speed: Scalar) -> "Mesh":
        """The same cells as rotation brings them closer, at a speed of the pinion [rad/s]."""
        if self.growth is None:
            return self
        return dataclasses.replace(self, gap=self.gap - speed**2 * self.growth, growth=None)


START, MIDDLE, END = PLACES = 0.0, 0.5, 1.0


@compiled
def mesh_table(
    system: PairSystem,
    cells: MeshCells,
    grid: MeshGrid,
    flanks: Flanks,
    misalignment: Misalignment,
) -> MeshTable:
    """Tabulate the cells of a pair over one cycle.

    **Arguments:**

    - `system`: gears on their mounts.
    - `cells`: in mesh, on the phases of `grid`.
    - `grid`: phases, lines and slices.
    - `flanks`: deviations of both gears.
    - `misalignment`: of the two axes.

    **Returns:**

    The table.
    """
    moved = at_places(system.pair, cells)
    gaps = [mesh_gap(system.pair, at.lines, flanks, misalignment) for at in moved]
    return tabulated(grid, cells, jnp.stack(gaps), jnp.stack([system.arms(at) for at in moved]))


def tabulated(
    grid: MeshGrid,
    cells: MeshCells,
    gap: PlaceCells,
    arms: PlaceArms,
    growth: PlaceCells | None = None,
) -> MeshTable:
    """A table of what is known of its cells.

    **Arguments:**

    - `grid`: phases, lines and slices.
    - `cells`: in mesh, on the phases of `grid`, with their coupling.
    - `gap`: of each cell at the start, middle and end of each step [m].
    - `arms`: of each cell there [-, m].
    - `growth`: of each cell there, or `None` [m s2].

    **Returns:**

    The table.
    """
    lengths = cells.lines.weight * cells.lines.periods
    kinds = [0] * grid.entry_phases + [1] * (grid.phases - grid.entry_phases)
    return MeshTable(
        edges=jnp.concatenate([jnp.zeros(1), jnp.cumsum(lengths)]),
        stiffness=cells.stiffness,
        gap=gap,
        arms=arms,
        coupling=cells.coupling,
        periods=grid.periods,
        kinds=tuple(kinds * grid.periods),
        growth=growth,
    )


def at_places(pair: GearPair, cells: MeshCells) -> tuple[MeshCells, MeshCells, MeshCells]:
    """The cells at the start, in the middle and at the end of each step.

    **Arguments:**

    - `pair`: the gears.
    - `cells`: in the middle of each step.

    **Returns:**

    Cells; what they take from condensed bodies is that of the middle.
    """
    lengths = cells.lines.weight * cells.lines.periods
    start, middle, end = (_moved(pair, cells, lengths * (part - 0.5)) for part in PLACES)
    return start, middle, end


def _moved(pair: GearPair, cells: MeshCells, by: Reals) -> MeshCells:
    """The same cells a little earlier or later, in mesh periods."""
    path = by[:, None, None] * pair.transverse_base_pitch
    shift = jnp.broadcast_to(path, cells.lines.roll.shape).reshape(cells.arm.shape)
    lines = dataclasses.replace(
        cells.lines, phase=cells.lines.phase + by, roll=cells.lines.roll + path
    )
    arm = cells.arm + shift * jnp.sin(pair.base_helix_angle)
    return dataclasses.replace(cells, lines=lines, arm=arm)


def mesh_at(table: MeshTable, part: float) -> Mesh:
    """The cells of all steps, a fraction of its length into each step.

    **Arguments:**

    - `table`: of a cycle.
    - `part`: 0 at the start of a step, 1 at its end [-].

    **Returns:**

    The cells, `step` leading. Between the three places of the table a parabola is laid.
    """
    shares = place_shares(part)
    # A zero is left out, so that places cost nothing.
    used = [i for i, share in enumerate(shares) if share != 0.0]
    between = lambda x: functools.reduce(operator.add, [shares[i] * x[i] for i in used])
    growth = None if table.growth is None else between(table.growth)
    return Mesh(table.stiffness, between(table.gap), between(table.arms), table.coupling, growth)


_Part = TypeVar("_Part", float, Scalar)


def place_shares(part: _Part) -> tuple[_Part, _Part, _Part]:
    """Lagrange's polynomials on the three places of a step.

    **Arguments:**

    - `part`: 0 at the start of a step, 1 at its end [-].

    **Returns:**

    Shares of its start, middle and end; they sum to 1 [-].
    """
    return (1.0 - part) * (1.0 - 2.0 * part), 4.0 * part * (1.0 - part), part * (2.0 * part - 1.0)


def mesh_within(table: MeshTable, part: float) -> Mesh:
    """As `mesh_at`, with the stiffness of that instant instead of its mean over the step.

    Its slope is that between neighbours, and never across a jump: between steps of one length.

    **Arguments:**

    - `table`: of a cycle.
    - `part`: 0 at the start of a step, 1 at its end [-].

    **Returns:**

    The cells, `step` leading.
    """
    kinds = np.asarray(table.kinds)
    steps = np.arange(kinds.size)
    before, after = np.maximum(steps - 1, 0), np.minimum(steps + 1, kinds.size - 1)
    before = np.where(kinds[before] == kinds, before, steps)
    after = np.where(kinds[after] == kinds, after, steps)
    apart = jnp.asarray(np.maximum(after - before, 1), dtype=float)[:, None]
    slope = (table.stiffness[after] - table.stiffness[before]) / apart
    stiffness = table.stiffness + (part - MIDDLE) * slope
    stiffness = jnp.where(table.stiffness > 0.0, jnp.maximum(stiffness, 0.0), 0.0)
    return dataclasses.replace(mesh_at(table, part), stiffness=stiffness)


def repeated(table: MeshTable, times: int) -> MeshTable:
    """The table of a cycle that is gone through several times.

    **Arguments:**

    - `table`: of one cycle.
    - `times`: how often, for responses that take so many cycles to repeat.

    **Returns:**

    The longer table.
    """
    if times == 1:
        return table
    again = lambda x, axis: jnp.concatenate([x] * times, axis=axis)
    start = np.repeat(np.arange(times), len(table.kinds)) * table.periods
    ends = again(table.edges[1:], 0) + jnp.asarray(start, dtype=float)
    return MeshTable(
        edges=jnp.concatenate([table.edges[:1], ends]),
        stiffness=again(table.stiffness, 0),
        gap=again(table.gap, 1),
        arms=again(table.arms, 1),
        coupling=None if table.coupling is None else again(table.coupling, 0),
        periods=table.periods * times,
        kinds=table.kinds * times,
        growth=None if table.growth is None else again(table.growth, 1),
    )


def cell_forces(mesh: Mesh, place: Coordinates, law: AbstractContactLaw) -> tuple[Cells, Cells]:
    r"""Force of each cell at given mesh coordinates, $f = k\,\sigma(W m - \delta - C f)$.

    **Arguments:**

    - `mesh`: cells at one instant.
    - `place`: mesh coordinates $m$ [m, rad].
    - `law`: exact or smooth contact.

    **Returns:**

    Forces [N] and overlaps, what the bodies yield subtracted [m].
    """
    free = mesh.arms @ place - mesh.gap
    return _shared_forces(mesh.stiffness, mesh.coupling, free, law)


def _shared_forces(
    stiffness: Cells, coupling: Coupling | None, free: Cells, law: AbstractContactLaw
) -> tuple[Cells, Cells]:
    """Forces and overlaps of cells whose overlaps on rigid bodies would be `free`."""
    if coupling is None:
        return stiffness * law.compression(free), free
    if coupling.ndim == 2:
        force = forces_between_all(law, stiffness, coupling, free)
        return force, free - body_yield(coupling, force)
    share = lambda tangent, force: share_with_body(coupling, tangent, force[:, None])[:, 0]
    force = share(stiffness, stiffness * free)
    # A slice has few lines: from all of them closed, Newton's steps open one or more each.
    for _ in range(coupling.shape[0] + 2):
        overlap = free - body_yield(coupling, force)
        compression, slope = _pressed(law, overlap)
        missing = stiffness * compression - force
        force = force + share(stiffness * slope, missing)
    return force, free - body_yield(coupling, force)


# Newton's steps between all cells, and the forces still missing then, over those there are.
_MOST_STEPS, _MISSING = 30, 1e-13


@jax.custom_jvp
def forces_between_all(
    law: AbstractContactLaw, stiffness: Cells, coupling: Coupling, free: Cells
) -> Cells:
    r"""Forces of cells that are all coupled, $f = k\,\sigma(\Delta_0 - C f)$.

    Newton's method from all of them closed; derivatives are those of the solution.

    **Arguments:**

    - `law`: exact or smooth contact.
    - `stiffness`: of each cell [N/m].
    - `coupling`: $C$ between all cells [m/N].
    - `free`: $\Delta_0$, overlap of each on rigid bodies [m].

    **Returns:**

    Forces [N].
    """

    def missing_at(force: Cells) -> tuple[Cells, Cells]:
        compression, slope = _pressed(law, free - body_yield(coupling, force))
        return stiffness * compression - force, stiffness * slope

    def body(state):
        force, missing, tangent, _, steps = state
        force = force + share_with_body(coupling, tangent, missing[:, None])[:, 0]
        missing, tangent = missing_at(force)
        done = jnp.max(jnp.abs(missing)) <= _MISSING * jnp.max(stiffness * jnp.abs(free))
        return force, missing, tangent, done, steps + 1

    def unfinished(state):
        return ~state[3] & (state[4] < _MOST_STEPS)

    none = jnp.zeros_like(free)
    first = none, stiffness * free, stiffness, jnp.asarray(False), 0
    return jax.lax.while_loop(unfinished, body, first)[0]


@forces_between_all.defjvp
def _forces_tangent(primals, tangents):
    law, stiffness, coupling, free = primals
    force = forces_between_all(law, stiffness, coupling, free)

    def pressed(law, stiffness, coupling, free):
        return stiffness * law.compression(free - body_yield(coupling, force))

    _, change = jax.jvp(pressed, primals, tangents)
    _, slope = _pressed(law, free - body_yield(coupling, force))
    return force, share_with_body(coupling, stiffness * slope, change[:, None])[:, 0]


def _pressed(law: AbstractContactLaw, overlap: Cells) -> tuple[Cells, Cells]:
    """Compression of each cell [m] and its slope by the overlap [-]."""
    return jax.jvp(law.compression, (overlap,), (jnp.ones_like(overlap),))


def mesh_load(
    mesh: Mesh, place: Coordinates, law: AbstractContactLaw
) -> tuple[Coordinates, CoordinateMatrix]:
    """Load of the mesh on its coordinates, and its tangent stiffness.

    **Arguments:**

    - `mesh`: cells at one instant.
    - `place`: mesh coordinates [m, rad].
    - `law`: exact or smooth contact.

    **Returns:**

    Resultants of the cell forces [N, N m], and their derivative by `place` [N/m, N, N m].
    """
    force, overlap = cell_forces(mesh, place, law)
    _, slope = _pressed(law, overlap)
    pushed = tangent_columns(mesh.stiffness * slope, mesh.coupling, mesh.arms)
    return mesh.arms.T @ force, mesh.arms.T @ pushed


def tangent_columns(stiffness: Cells, coupling: Coupling | None, arms: CellArms) -> CellColumns:
    """Forces of the cells per mesh coordinate."""
    columns = stiffness[:, None] * arms
    return columns if coupling is None else share_with_body(coupling, stiffness, columns)


def mean_load(
    start: Mesh, middle: Mesh, end: Mesh, first: Coordinates, last: Coordinates
) -> tuple[Coordinates, CoordinateMatrix, CoordinateMatrix]:
    r"""Load of the mesh in the mean over a step, with exact contact.

    Overlaps are taken to change evenly over the step, so that a cell's mean compression is
    $[\Phi(\Delta_1) - \Phi(\Delta_0)]/(\Delta_1 - \Delta_0)$ with $\Phi$ the integral of the
    positive part: it knows when within the step the cell closed. As a time step at constant
    stiffness this is Gonzalez's discrete gradient, which conserves energy.

    **Arguments:**

    - `start`, `middle`, `end`: the cells at these places of the step.
    - `first`: mesh coordinates at its start [m, rad].
    - `last`: mesh coordinates at its end [m, rad].

    **Returns:**

    Resultants of the mean cell forces [N, N m]; their derivatives by `first` and by `last`.
    """
    law = ExactContact()
    _, begun = cell_forces(start, first, law)
    _, ended = cell_forces(end, last, law)
    compression = mean_ramp(begun, ended)
    by_begun, by_ended = _ramp_slopes(begun, ended, compression)
    load = middle.arms.T @ (middle.stiffness * compression)
    tangents = [
        middle.arms.T @ ((middle.stiffness * slope)[:, None] * _overlap_slopes(mesh, at, law))
        for mesh, at, slope in ((start, begun, by_begun), (end, ended, by_ended))
    ]
    return load, tangents[0], tangents[1]


def mean_tangent(
    start: Mesh, middle: Mesh, end: Mesh, first: Coordinates, last: Coordinates
) -> CoordinateMatrix:
    """Mean tangent stiffness of exact contact over a step: each cell while it is closed.

    **Arguments:**

    - `start`, `middle`, `end`: the cells at these places of the step.
    - `first`: mesh coordinates at its start [m, rad].
    - `last`: mesh coordinates at its end [m, rad].

    **Returns:**

    The mean stiffness on the mesh coordinates [N/m, N, N m].
    """
    law = ExactContact()
    _, begun = cell_forces(start, first, law)
    _, ended = cell_forces(end, last, law)
    change = ended - begun
    moves = jnp.abs(change) > 0.0
    closing = (law.compression(ended) - law.compression(begun)) / jnp.where(moves, change, 1.0)
    closed = jnp.where(moves, closing, jnp.where(begun > 0.0, 1.0, 0.0))
    columns = tangent_columns(middle.stiffness * closed, middle.coupling, middle.arms)
    return middle.arms.T @ columns


def _overlap_slopes(mesh: Mesh, overlap: Cells, law: AbstractContactLaw) -> CellColumns:
    """Overlap of each cell per mesh coordinate, what the bodies yield subtracted."""
    if mesh.coupling is None:
        return mesh.arms
    _, slope = _pressed(law, overlap)
    pushed = tangent_columns(mesh.stiffness * slope, mesh.coupling, mesh.arms)
    columns = [body_yield(mesh.coupling, pushed[:, i]) for i in range(pushed.shape[1])]
    return mesh.arms - jnp.stack(columns, axis=1)


def mean_ramp(first: Reals, last: Reals) -> Reals:
    """Mean of the positive part of what changes evenly from `first` to `last`, in their unit.

    Written without the difference of like numbers, so that its slopes are right to rounding.

    **Arguments:**

    - `first`, `last`: any real arrays of one shape.

    **Returns:**

    An array like them.
    """
    closed, crossing, span = _closed_and_crossing(first, last)
    squares = jnp.maximum(first, 0.0) ** 2 + jnp.maximum(last, 0.0) ** 2
    part = jnp.where(crossing, 0.5 * squares / span, 0.0)
    return jnp.where(closed, 0.5 * (first + last), part)


def _ramp_slopes(first: Reals, last: Reals, mean: Reals) -> tuple[Reals, Reals]:
    """Derivatives of `mean_ramp` by `first` and by `last`, where it is `mean`."""
    closed, crossing, span = _closed_and_crossing(first, last)

    def by(end: Reals) -> Reals:
        part = (jnp.maximum(end, 0.0) - jnp.sign(end) * mean) / span
        return jnp.where(closed, 0.5, jnp.where(crossing, part, 0.0))

    return by(first), by(last)


def _closed_and_crossing(first: Reals, last: Reals) -> tuple[_Where, _Where, Reals]:
    """Where both ends are closed, where one or both are open, and the sum of their sizes there."""
    closed = (first >= 0.0) & (last >= 0.0)
    span = jnp.abs(first) + jnp.abs(last)
    crossing = ~closed & (span > 0.0)
    return closed, crossing, jnp.where(crossing, span, 1.0)
