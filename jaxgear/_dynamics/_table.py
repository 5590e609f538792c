r"""The mesh as a function of time: what its cells are at every step of a cycle, and how they push.

A cycle is divided into the steps that the phases of a quasi-static cycle stand for. They are
aligned with the entry and the exit of tooth pairs, so that stiffness jumps between steps and never
within one; it is constant over each, while gaps and arms are known where a step starts, in its
middle, and where it ends: both limits of whatever jumps.
"""

import dataclasses
import functools
import operator
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._compiled import compiled, lasting_rare
from jaxgear._contact._cells import MeshCells, Misalignment, mesh_gap
from jaxgear._dynamics._mesh import Mesh
from jaxgear._dynamics._types import (
    Edges,
    KeptCells,
    PlaceArms,
    PlaceCells,
    StepCells,
    StepCoupling,
)
from jaxgear._flank._deviations import Flanks
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._system._pair_system import PairSystem
from jaxgear._types import Reals, Scalar


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
    - `kept`: of each step, numbers of the cells that may be in contact; the others are left out of
        a `Mesh`. With `None` all are in it [-].
    - `ready`: the cells with their `bearing`, from `ready_to_bear`; or `None`.
    """

    edges: Edges
    stiffness: StepCells
    gap: PlaceCells
    arms: PlaceArms
    coupling: StepCoupling | None
    periods: int = eqx.field(static=True)
    kinds: tuple[int, ...] = eqx.field(static=True)
    growth: PlaceCells | None = None
    kept: KeptCells | None = None
    ready: "ReadyMeshes | None" = None

    @property
    def lengths(self) -> Reals:
        """Length of each step in mesh periods [-]."""
        return jnp.diff(self.edges)

    @property
    def period_lengths(self) -> np.ndarray:
        """Lengths of the steps of a mesh period, which all have, of a concrete table [-]."""
        return np.asarray(self.lengths)[: len(self.kinds) // self.periods]

    @property
    def middles(self) -> Reals:
        """Middle of each step in mesh periods from the start of the cycle [-]."""
        return 0.5 * (self.edges[:-1] + self.edges[1:])

    @property
    def middle_arms(self) -> Reals:
        """Arms of all cells in the middle of each step [-, m]."""
        return self.arms[PLACES.index(MIDDLE)]

    def on_all_cells(self, values: Reals) -> Reals:
        """Values of the cells of a `Mesh` at each step, in their places among all; others are 0."""
        if self.kept is None:
            return values
        place = lambda kept, own: jnp.zeros(self.stiffness.shape[1]).at[kept].set(own)
        return jax.vmap(place)(self.kept, values)


class ReadyMeshes(NamedTuple):
    """Cells that are `ready` at the start, in the middle and at the end of each step.

    **Fields:**

    - `mean`: with the stiffness of the middle all over the step, as of `mesh_at`.
    - `own`: with the stiffness of the instant, as of `mesh_within`.
    """

    mean: tuple[Mesh, Mesh, Mesh]
    own: tuple[Mesh, Mesh, Mesh]


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
        kept=kept_cells(cells),
    )


def kept_cells(cells: MeshCells) -> KeptCells | None:
    """Numbers of the cells that may be in contact, or `None`: all.

    Where slices feel only what is in them, they stay in their order, and all of them.
    """
    coupling = cells.coupling
    return None if coupling is None or coupling.ndim > 3 else cells.lines.kept


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

    The cells that may be in contact, `step` leading. Between the three places of the table a
    parabola is laid.
    """
    if part in PLACES and table.ready is not None:
        return table.ready.mean[PLACES.index(part)]
    shares = place_shares(part)
    # A zero is left out, so that places cost nothing.
    used = [i for i, share in enumerate(shares) if share != 0.0]
    between = lambda x: functools.reduce(operator.add, [shares[i] * x[i] for i in used])
    growth = None if table.growth is None else between(table.growth)
    gap, arms = between(table.gap), between(table.arms)
    mesh = Mesh(table.stiffness, gap, arms, table.coupling, growth)
    return mesh if table.kept is None else jax.vmap(Mesh.among)(mesh, table.kept)


# Numbers in a matrix between all cells of all steps, of which `ready_to_bear` keeps three more:
# over the long cycle of a wheel with holes they would be gigabytes.
_MOST_READY = 20_000_000


def ready_to_bear(table: MeshTable) -> MeshTable:
    """A table that knows the forces of its cells where all of them bear, if all are coupled.

    Whoever looks for many responses of one pair saves most of the factors that its contact takes.

    **Arguments:**

    - `table`: of a cycle.

    **Returns:**

    The table, the same for all laws of contact and at all speeds.
    """
    if table.ready is not None or table.coupling is None or table.coupling.ndim > 3:
        return table
    cells = table.stiffness.shape[1] if table.kept is None else table.kept.shape[1]
    if len(table.kinds) * cells**2 > _MOST_READY:
        return table
    middle, *others = _readied(table)
    assert middle.bearing is not None
    # One array for what is the same at all places.
    inverse, coupling = middle.bearing.inverse, middle.coupling
    begin, end, first, last = (dataclasses.replace(x, coupling=coupling) for x in others)
    begin, end = (eqx.tree_at(_inverse, each, inverse) for each in (begin, end))
    ready = ReadyMeshes(mean=(begin, middle, end), own=(first, middle, last))
    return dataclasses.replace(table, ready=ready)


_inverse = lambda mesh: mesh.bearing.inverse


@lasting_rare
def _readied(table: MeshTable) -> list[Mesh]:
    """The middle; both ends with its stiffness; both with their own. Without what is in it too."""
    ready = jax.vmap(lambda mesh: mesh.ready())
    mean, own = ([ready(read(table, x)) for x in (START, END)] for read in (mesh_at, mesh_within))
    others = [*(eqx.tree_at(_inverse, x, jnp.zeros(0)) for x in mean), *own]
    alone = [dataclasses.replace(x, coupling=None) for x in others]
    return [ready(mesh_at(table, MIDDLE)), *alone]


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
    if part in PLACES and table.ready is not None:
        return table.ready.own[PLACES.index(part)]
    kinds = np.asarray(table.kinds)
    steps = np.arange(kinds.size)
    before, after = np.maximum(steps - 1, 0), np.minimum(steps + 1, kinds.size - 1)
    before = np.where(kinds[before] == kinds, before, steps)
    after = np.where(kinds[after] == kinds, after, steps)
    apart = jnp.asarray(np.maximum(after - before, 1), dtype=float)[:, None]
    slope = (table.stiffness[after] - table.stiffness[before]) / apart
    stiffness = table.stiffness + (part - MIDDLE) * slope
    stiffness = jnp.where(table.stiffness > 0.0, jnp.maximum(stiffness, 0.0), 0.0)
    return mesh_at(dataclasses.replace(table, stiffness=stiffness, ready=None), part)


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
        kept=None if table.kept is None else again(table.kept, 0),
        ready=jax.tree.map(lambda x: again(x, 0), table.ready),
    )
