r"""Mesh cells: pieces of contact lines, with the stiffness and the gap of each.

All directions are normal to the flank. A cell's gap is the material removed there by both
gears, counted from the nominal involutes: one reference for the whole cycle, so it adds no
inertia later and no maximum whose ties would split a gradient at zero relief.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from jaxgear._checks import require
from jaxgear._compiled import compiled
from jaxgear._contact._compliance import AbstractCompliance
from jaxgear._contact._face_cells import face_cells
from jaxgear._contact._path_interpolant import path_interpolant
from jaxgear._contact._shared_body import SharedBody, where_helical
from jaxgear._flank._deviations import Flanks
from jaxgear._geometry._lines import ContactLines, MeshGrid, contact_lines, repeated_lines
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._tip_contact import tip_contact_rolls, tip_separation
from jaxgear._types import (
    CellArmGrid,
    CellGrid,
    CouplingGrid,
    DenseCouplingGrid,
    LineGrid,
    LinePhases,
    Scalar,
    as_scalar,
)


class Misalignment(eqx.Module):
    """How far the wheel's axis is out of parallel, over the common face width.

    As gear standards do, each transverse slice of the wheel is shifted in its own plane; the axial
    motion that a tilt gives a helical tooth is left out.

    **Fields:**

    - `inclination`: shift towards +S (away from the pinion) of the wheel at the right end of the
        face relative to the left one, in the plane of the axes [m].
    - `deviation`: the same towards +T, square to that plane [m].
    """

    inclination: Scalar = eqx.field(converter=as_scalar, default=0.0)
    deviation: Scalar = eqx.field(converter=as_scalar, default=0.0)


class MeshCells(eqx.Module):
    r"""The cells of one cycle: what does not depend on flank corrections.

    **Fields:**

    - `lines`: where the cells are.
    - `line_stiffness`: $k'$ per length of contact line of what each tooth pair gives by itself, at
        each slice [N/m2].
    - `stiffness`: of each cell, its active fraction included [N/m].
    - `coupling`: of the lines in each slice through the bodies they share, of all cells where a
        body is condensed, or `None` [m/N].
    - `arm`: $\lambda$, place of each cell along its contact line, from the foot of the pitch
        point at mid-face [m].
    - `seat_arms`: approach of each cell per motion of the seats of condensed bodies, or `None`
        [-, m].
    - `growth`: approach of each cell by rotation and heat of condensed bodies, or `None` [m].
    - `spread`: what each tooth pair gives by itself under an even load, but couples its slices and
        is in `coupling`; or `None`: nothing [m2/N].
    """

    lines: ContactLines
    line_stiffness: LineGrid
    stiffness: CellGrid
    coupling: CouplingGrid | DenseCouplingGrid | None
    arm: CellGrid
    seat_arms: CellArmGrid | None = None
    growth: CellGrid | None = None
    spread: LineGrid | None = None


@compiled
def nominal_line_load(pair: GearPair, torque: Scalar) -> Scalar:
    r"""Mean load per length of one contact line, $F_n\cos\beta_b/b$ [N/m].

    **Arguments:**

    - `pair`: the gears.
    - `torque`: on the pinion [N m].

    **Returns:**

    The line load at which secant stiffnesses are taken [N/m].
    """
    return torque / pair.base_radius[0] / pair.face_width


@compiled
def mesh_cells(
    pair: GearPair, grid: MeshGrid, compliance: AbstractCompliance, line_load: Scalar
) -> MeshCells:
    r"""Divide the contact lines of one cycle into cells (theory 3.9, theory 4.5).

    **Arguments:**

    - `pair`: the gears.
    - `grid`: phases, lines and slices.
    - `compliance`: of one tooth pair.
    - `line_load`: at which the secant is taken [N/m].

    **Returns:**

    Position and stiffness of each cell, $k = k'\,\Delta l$ times its active fraction.
    """
    lines = contact_lines(pair, dataclasses.replace(grid, periods=1))
    cells = cells_on_lines(pair, lines, compliance, line_load)
    return cells if grid.periods == 1 else _repeated(cells, grid)


def cells_on_lines(
    pair: GearPair, lines: ContactLines, compliance: AbstractCompliance, line_load: Scalar
) -> MeshCells:
    """Divide contact lines that have been placed already.

    **Arguments:**

    - `pair`: the gears.
    - `lines`: over one mesh period.
    - `compliance`: of one tooth pair.
    - `line_load`: at which the secant is taken [N/m].

    **Returns:**

    As `mesh_cells`.
    """
    face = face_cells(pair, lines, compliance, line_load)
    if face is None:
        along_path = path_interpolant(pair, lines.roll)
        line_stiffness = along_path(1.0 / compliance.local(pair, along_path.nodes, line_load))
        coupling, spread = compliance.between_cells(pair, lines, line_load), None
        if coupling is None:
            bodies = compliance.bodies(pair, lines.roll.shape[1] - 1)
            coupling = _coupling(pair, lines, bodies)
    else:
        line_stiffness, coupling, spread = 1.0 / face.local, face.coupling, face.spread
    stiffness = line_stiffness * lines.fraction * lines.length
    helix = pair.base_helix_angle
    across = lines.face_position[None, None, :] * jnp.cos(helix)
    arm = across + (lines.roll - pair.pitch_point) * jnp.sin(helix)
    flat = lines.phase.size, lines.roll.shape[1] * lines.roll.shape[2]
    return MeshCells(
        lines=lines,
        line_stiffness=line_stiffness,
        stiffness=stiffness.reshape(flat),
        coupling=coupling,
        arm=arm.reshape(flat),
        spread=spread,
    )


def _coupling(
    pair: GearPair, lines: ContactLines, bodies: tuple[SharedBody, ...]
) -> CouplingGrid | None:
    r"""Compliance $C$ between the lines of each slice.

    A slice that is in contact over a fraction of its length carries its load there. Of two lines,
    the shorter contact is taken to lie within the longer one, so that loads act on motions over
    the longer: $C_{ij} = c_{ij}/(\Delta l\,\max(\varphi_i, \varphi_j))$, symmetric and never
    negative.
    """
    if not bodies:
        return None
    on_path = jnp.clip(lines.roll, pair.path_start, pair.path_end)
    in_mesh = lines.fraction > 0.0
    share = jnp.where(in_mesh, lines.fraction, 1.0)
    plane, axial = ([body for body in bodies if body.axial == along] for along in (False, True))
    total = _by_roots(plane, on_path)
    if axial:
        none = lambda _, roll: jnp.zeros((*roll.shape[:2], *roll.shape[1:]))
        total += where_helical(pair, _by_roots, none, axial, on_path)
    longer = jnp.maximum(share[:, :, None, :], share[:, None, :, :])
    both = in_mesh[:, :, None, :] & in_mesh[:, None, :, :]
    return jnp.where(both, total / (longer * lines.length), 0.0)


def _repeated(cells: MeshCells, grid: MeshGrid) -> MeshCells:
    """The cells of one mesh period, as often as the cycle has periods."""
    again = lambda x: jnp.concatenate([x] * grid.periods)
    return MeshCells(
        lines=repeated_lines(cells.lines, grid.periods),
        line_stiffness=again(cells.line_stiffness),
        stiffness=again(cells.stiffness),
        coupling=None if cells.coupling is None else again(cells.coupling),
        arm=again(cells.arm),
        spread=None if cells.spread is None else again(cells.spread),
    )


def at_line_loads(
    cells: MeshCells, force: CellGrid, nominal: Scalar, log_slope: Scalar
) -> MeshCells:
    r"""Cells whose contact compliance is taken at the line loads they carry.

    Weber's contact term falls with the logarithm of the line load, $c(F') = c(F'_0) -
    \frac{1}{\pi E^*}\ln(F'/F'_0)$. Cells below a hundredth of the nominal line load are taken
    there: open ones have no contact to be soft.

    **Arguments:**

    - `cells`: with the secant at the nominal line load.
    - `force`: of each cell [N].
    - `nominal`: line load of that secant [N/m].
    - `log_slope`: fall of the compliance per natural logarithm of the line load [m2/N].

    **Returns:**

    The same cells with other stiffnesses.
    """
    lines = cells.lines
    in_mesh = lines.fraction > 0.0
    carried = jnp.where(in_mesh, lines.fraction, 1.0) * lines.length * nominal
    ratio = jnp.maximum(force.reshape(lines.roll.shape) / carried, _LEAST_LOAD)
    nominal_give = 1.0 / cells.line_stiffness
    give = nominal_give - log_slope * jnp.log(ratio)
    line_stiffness = 1.0 / jnp.maximum(give, _LEAST_GIVE * nominal_give)
    stiffness = line_stiffness * lines.fraction * lines.length
    return dataclasses.replace(
        cells, line_stiffness=line_stiffness, stiffness=stiffness.reshape(force.shape)
    )


# Of the nominal line load; and of a cell's own compliance at it, where loads are so much larger
# that the contact is as wide as the tooth.
_LEAST_LOAD, _LEAST_GIVE = 0.01, 0.1


@compiled
def mesh_gap(
    pair: GearPair, lines: ContactLines, flanks: Flanks, misalignment: Misalignment
) -> CellGrid:
    """Gap of each cell when the nominal flanks would just touch everywhere.

    **Arguments:**

    - `pair`: the gears.
    - `lines`: where the cells are.
    - `flanks`: deviations of both gears.
    - `misalignment`: of the two axes.

    **Returns:**

    Gap along the normal, positive where material is missing [m].
    """
    pinion, wheel = flank_coordinates(pair, lines)
    added = flanks.pinion(*pinion) + flanks.wheel(*wheel)
    added += _from_tooth_to_tooth(pair, lines, flanks)[:, :, None]
    angle = pair.working_pressure_angle
    apart = misalignment.inclination * jnp.sin(angle) + misalignment.deviation * jnp.cos(angle)
    apart *= jnp.cos(pair.base_helix_angle) / pair.face_width
    gap = apart * lines.face_position[None, None, :] - added
    if lines.beyond > 0.0:
        gap += tip_separation(pair, lines.roll)
    return gap.reshape(lines.phase.size, -1)


def _from_tooth_to_tooth(pair: GearPair, lines: ContactLines, flanks: Flanks) -> LinePhases:
    """What pitch errors and eccentricities add along the normal, on each line [m]."""
    tilt = jnp.cos(pair.base_helix_angle)
    added = jnp.zeros_like(lines.tooth, dtype=float)
    for gear, indexing, sense in (
        (pair.pinion, flanks.pinion_indexing, 1.0),
        (pair.wheel, flanks.wheel_indexing, -1.0),
    ):
        if indexing is not None:
            count = indexing.pitch_error.size
            require(
                count in (1, gear.teeth),
                "`Indexing.pitch_error` must have one value, or one for each of the {teeth} teeth, "
                "got {count}.",
                teeth=gear.teeth,
                count=count,
            )
            # A positive sense turns with the pinion, and pushes along the line of action.
            turn = indexing.eccentricity_angle + 2.0 * jnp.pi * lines.phase / gear.teeth
            push = jnp.sin(pair.working_pressure_angle + sense * turn)
            added += indexing.pitch_error[lines.tooth % count]
            added += (sense * indexing.eccentricity * tilt * push)[:, None]
    return added


def at_window_ends(pair: GearPair, lines: ContactLines) -> CellGrid:
    """Which cells are the outermost at which contact of tip corners is looked for.

    **Arguments:**

    - `pair`: the gears.
    - `lines`: where the cells are.

    **Returns:**

    1 where the next phase would take a cell out of the window beyond either end of the path, else
    0 [-].
    """
    pitch = pair.transverse_base_pitch
    window = (lines.beyond - jnp.max(lines.weight) * lines.periods) * pitch
    outside = (lines.roll < pair.path_start - window) | (lines.roll > pair.path_end + window)
    return jnp.where(outside, 1.0, 0.0).reshape(lines.phase.size, -1)


def flank_coordinates(
    pair: GearPair, lines: ContactLines
) -> tuple[tuple[LineGrid, LineGrid], tuple[LineGrid, LineGrid]]:
    """Where each cell lies on the two flanks, in the coordinates of flank deviations.

    **Arguments:**

    - `pair`: the gears.
    - `lines`: where the cells are.

    **Returns:**

    `profile` and `face` on the pinion, then on the wheel [-].
    """
    place = (lines.roll - pair.path_start) / pair.path_of_contact
    wheel_place = 1.0 - place
    if lines.beyond > 0.0:
        # Beyond the path a tip's corner touches, and the flank that it meets not where the line of
        # action goes on. Counted from the tips, so that a corner is at 1 to the last digit.
        rolls = tip_contact_rolls(pair, lines.roll)
        place, wheel_place = (
            1.0 - (pair.tip_roll[body] - rolls[body]) / pair.path_of_contact for body in (0, 1)
        )
    z = jnp.broadcast_to(lines.face_position[None, None, :], place.shape)
    pinion = place, z / (0.5 * pair.pinion.face_width)
    return pinion, (wheel_place, z / (0.5 * pair.wheel.face_width))


def _by_roots(bodies: list[SharedBody], roll: LineGrid) -> CouplingGrid:
    """What bodies give between the lines of each slice, whole slices in contact [m2/N]."""
    apart, total = range(roll.shape[1]), jnp.zeros(())
    for body in bodies:
        influence = jnp.stack([jnp.stack([body.at_roots(j - i) for j in apart]) for i in apart])
        loads = jnp.moveaxis(body.resultants(roll), -1, 0)
        # Written out: a batch of tiny matrix products costs many times its arithmetic.
        size = range(influence.shape[-1])
        for a in size:
            moved = sum(influence[None, :, :, a, b, None] * loads[b][:, None, :, :] for b in size)
            total = total + loads[a][:, :, None, :] * moved
    return total
