r"""Contact of the back flanks, which take over once the drive flanks have parted by the backlash.

Turned by $\pi$ about the line of centres the back flanks are drive flanks that run backwards, so
their cells, arms and mesh coordinates are those of the pair itself, for motions turned with them.
They stand beside the drive flanks' with coordinates of their own.
"""

import dataclasses

import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._contact._cells import (
    Misalignment,
    cells_on_lines,
    mesh_gap,
    nominal_line_load,
)
from jaxgear._contact._coupling import between_all_cells
from jaxgear._dynamics._table import MeshTable, kept_cells, repeated
from jaxgear._dynamics._types import KeptCells, PlaceArms, StepCoupling
from jaxgear._flank._deviations import Flanks
from jaxgear._geometry._backlash import back_lines, normal_backlash
from jaxgear._geometry._lines import MeshGrid
from jaxgear._system._model import PairModel
from jaxgear._system._pair_system import PairSystem
from jaxgear._types import DofCoordinates, Flag, Reals


def back_flank_table(
    system: PairSystem, model: PairModel, grid: MeshGrid, table: MeshTable
) -> tuple[MeshTable, Flag]:
    """Tabulate the cells of the back flanks, in their own coordinates.

    Their gap is the normal backlash and what a misalignment adds to it: back flanks are taken to be
    nominal involutes, without deviations, pitch errors or eccentricities. Their teeth are as
    stiff as those of the drive flanks at the nominal line load, whatever load they carry.

    **Arguments:**

    - `system`: gears on their mounts.
    - `model`: gears, teeth, misalignment and torque.
    - `grid`: phases, lines and slices.
    - `table`: of the drive flanks on this grid, for its steps.

    **Returns:**

    The table of the back flanks alone, and whether the grid holds all of their lines: where
    steps are too long it does not.
    """
    pair = model.pair
    steps = len(table.kinds) // table.periods
    edges = table.edges[: steps + 1]
    # Nominal flanks repeat after one mesh period.
    at_places = back_lines(pair, dataclasses.replace(grid, periods=1), edges)
    middle = at_places[1]
    line_load = nominal_line_load(pair, model.mesh_torque)
    cells = [cells_on_lines(pair, lines, model.compliance, line_load) for lines in at_places]
    turned = turned_misalignment(model.misalignment)
    gaps = [mesh_gap(pair, lines, Flanks(), turned) for lines in at_places]
    one = MeshTable(
        edges=edges,
        stiffness=cells[1].stiffness,
        gap=normal_backlash(pair) + jnp.stack(gaps),
        arms=jnp.stack([system.arms(at) for at in cells]),
        coupling=cells[1].coupling,
        periods=1,
        kinds=table.kinds[:steps],
        kept=kept_cells(cells[1]),
    )
    return dataclasses.replace(repeated(one, table.periods), edges=table.edges), middle.complete


def turned_misalignment(misalignment: Misalignment) -> Misalignment:
    """The same misalignment in the coordinates of the back flanks.

    The shift towards S keeps its sign and left and right are exchanged, so the inclination changes
    sign; the deviation changes it twice.

    **Arguments:**

    - `misalignment`: of the two axes.

    **Returns:**

    That of the two axes, turned by half a revolution about the line of centres.
    """
    return Misalignment(-misalignment.inclination, misalignment.deviation)


def back_vectors(vectors: DofCoordinates, nodes: tuple[int, int]) -> DofCoordinates:
    r"""Mesh coordinates of the back flanks per motion of the gears' nodes.

    $V_b = D V$, with $D$ the half revolution about the line of centres, diag(1, -1, -1) on
    translations and on rotations; it exchanges the two nodes of a gear that is a beam.

    **Arguments:**

    - `vectors`: $V$ of the drive flanks, as in `PairSystem` [-, m].
    - `nodes`: number of nodes of the pinion and of the wheel, 2 for a beam body, else 1.

    **Returns:**

    $V_b$, with the rows of $V$ [-, m].

    **Raises:**

    - `InputError` unless the vectors have six rows for each node.
    """
    require(
        vectors.shape[0] == 6 * sum(nodes) and set(nodes) <= {1, 2},
        "The {count} nodes of the gears need {need} rows of mesh vectors, got {got}. Pass the "
        "vectors of the gears' nodes and 1 or 2 nodes for each gear.",
        count=sum(nodes),
        need=6 * sum(nodes),
        got=vectors.shape[0],
    )
    turn = jnp.asarray([1.0, -1.0, -1.0] * 2)[None, :, None]
    pinion, wheel = jnp.split(vectors, [6 * nodes[0]])
    turned = [
        (gear.reshape(count, 6, -1) * turn)[::-1].reshape(6 * count, -1)
        for gear, count in zip((pinion, wheel), nodes, strict=True)
    ]
    return jnp.concatenate(turned)


def with_back_flanks(table: MeshTable, back: MeshTable) -> MeshTable:
    """Put the cells of the back flanks beside those of the drive flanks.

    The bodies couple lines of the same side alone. A gear is loaded on one flank at a time, but for
    the instants at which teeth without backlash change sides.

    **Arguments:**

    - `table`: of the drive flanks.
    - `back`: of the back flanks, on the same steps.

    **Returns:**

    The cells of both, on mesh coordinates of both; those of the drive flanks come first.

    **Raises:**

    - `InputError` unless both have the same steps.
    """
    require(
        (table.kinds, table.periods) == (back.kinds, back.periods),
        "Drive and back flanks must have the same steps, got {drive} and {back} steps in {periods} "
        "and {back_periods} mesh periods. Tabulate the back flanks for this table.",
        drive=len(table.kinds),
        back=len(back.kinds),
        periods=table.periods,
        back_periods=back.periods,
    )
    beside = lambda drive, other: jnp.concatenate([drive, other], axis=-1)
    return dataclasses.replace(
        table,
        stiffness=beside(table.stiffness, back.stiffness),
        gap=beside(table.gap, back.gap),
        arms=_side_by_side(table.arms, back.arms),
        coupling=_joined_coupling(table, back),
        kept=_joined_kept(table, back),
    )


def _joined_kept(table: MeshTable, back: MeshTable) -> KeptCells | None:
    """Cells of both flanks that may be in contact, or `None`: all of them."""
    if table.kept is None and back.kept is None:
        return None
    all_of = lambda x: jnp.broadcast_to(jnp.arange(x.stiffness.shape[1]), x.stiffness.shape)
    drive, other = (all_of(x) if x.kept is None else x.kept for x in (table, back))
    return jnp.concatenate([drive, other + table.stiffness.shape[1]], axis=1)


def _side_by_side(drive: Reals, back: Reals) -> PlaceArms:
    """Arms of both, zero on the coordinates of the other flank."""
    own, other = drive.shape[-1], back.shape[-1]
    pad = lambda x, before, after: jnp.pad(x, [(0, 0)] * 3 + [(before, after)])
    return jnp.concatenate([pad(drive, 0, other), pad(back, own, 0)], axis=2)


def _joined_coupling(table: MeshTable, back: MeshTable) -> StepCoupling | None:
    """Coupling within the lines of either flank, none between the two.

    Where only one of them couples, the slices are its; the lines of the other stand alone.
    """
    given = [x.coupling for x in (table, back) if x.coupling is not None]
    if not given:
        return None
    if any(coupling.ndim == 3 for coupling in given):
        drive, other = (_between_all(part) for part in (table, back))
        beside = lambda x, before, after: jnp.pad(x, [(0, 0), *[(before, after)] * 2])
        return beside(drive, 0, other.shape[1]) + beside(other, drive.shape[1], 0)
    slices = {coupling.shape[-1] for coupling in given}
    require(
        len(slices) == 1,
        "Drive and back flanks must have the same slices, got {got}. Use one grid for both.",
        got=sorted(slices),
    )
    drive, other = (_coupling_or_zero(part, max(slices)) for part in (table, back))
    lines = drive.shape[1], other.shape[1]
    pad = lambda x, before, after: jnp.pad(x, [(0, 0), *[(before, after)] * 2, (0, 0)])
    return pad(drive, 0, lines[1]) + pad(other, lines[0], 0)


def _between_all(table: MeshTable) -> StepCoupling:
    """Coupling of all cells of one flank, whatever couples them."""
    steps, cells = table.stiffness.shape
    if table.coupling is None:
        return jnp.zeros((steps, cells, cells))
    return table.coupling if table.coupling.ndim == 3 else between_all_cells(table.coupling)


def _coupling_or_zero(table: MeshTable, slices: int) -> StepCoupling:
    if table.coupling is not None:
        return table.coupling
    steps, cells = table.stiffness.shape
    return jnp.zeros((steps, cells // slices, cells // slices, slices))
