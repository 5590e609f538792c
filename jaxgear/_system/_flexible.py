r"""Gear bodies that are condensed finite elements, as teeth in mesh see them.

Statics of a body whose loads act on the feet of slices of teeth and on its seats is exact in two
parts: what the feet give with all seats held, $A$, and how the feet follow the seats, $G$. A cell
on a slice feels the motion of its foot by six numbers $b$, the normal and its moment about the foot
(physics C 9 to 20), so that bodies add $b^T A b$ to the compliance between cells, and the seats'
motions to the mesh coordinates with arms $b^T G$.

Everything is kept in the frame of each slice's own foot, along the radius, the tangent and the axis
in the middle of the tooth: there a body that repeats from tooth to tooth has one table for all
phases, and another body one for each of the mesh periods after which it repeats.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._geometry._lines import ContactLines, MeshGrid, face_positions
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._profile import tooth_section
from jaxgear._interface._roots import ROOT_POINTS, Axial, Feet, RimSurface, RootPatches, feet
from jaxgear._system._body_modes import BodyBasis, BodyModes
from jaxgear._system._condensed import Condensed
from jaxgear._types import CellArmGrid, CellGrid, DenseCouplingGrid, Reals
from jaxgear._units import mm

if TYPE_CHECKING:
    FootMatrix = Array
    FootSeats = Array
    FootColumn = Array
    FootPlaces = Array
    SeatMatrix = Array
    SeatLoad = Array
else:
    FootMatrix = Float[Array, "period component component cell cell"]
    FootSeats = Float[Array, "period component cell seat_dof"]
    FootColumn = Float[Array, "period component cell"]
    FootPlaces = Float[Array, "period cell 3"]
    SeatMatrix = Float[Array, "seat_dof seat_dof"]
    SeatLoad = Float[Array, "seat_dof"]

# Components of a foot's motion that spur teeth load: along radius and tangent, and about the axis.
_IN_PLANE, _ALL = (0, 1, 5), (0, 1, 2, 3, 4, 5)
# How far the stiffness between seats may depend on the direction, of its largest entry.
_UNEVEN = 1e-3
# Longest element of a rim [pitches], widest [faces], and slices that even one element can follow.
_LONGEST, _WIDEST, _FEW_SLICES = 1.5, 0.5 + 1e-6, 3
# How far rim and root circle may be apart, of the radius.
_RIM_OFF = 5e-3


class FlexibleBody(eqx.Module):
    r"""A condensed gear body in mesh.

    Its numbers hold for the gear, the slices and the contact lines that it was made for: they are
    no functions of the pair's geometry, and have no derivatives by it.

    **Fields:**

    - `flexibility`: $A$, motion of the feet per load on them with the seats held, by components of
        both [m/N, 1/N, 1/(N m)].
    - `from_seats`: $G$, motion of the feet per motion of the seats, both in the frame of each foot
        [-, m, 1/m].
    - `growth`: motion of the feet by rotation, per square of the speed, the seats held [m s2].
    - `centres`: place of each foot in its frame [m].
    - `seat_stiffness`: between the seats, no load on the feet [N/m, N, N m].
    - `seat_load`: on the seats by rotation, per square of the speed [N s2].
    - `seat_heights`: places of the seats along the axis, from mid-face [m].
    - `seats`: names of the seats.
    - `gear_seat`: number of the seat whose rotation is the gear's, where the torque acts.
    - `components`: of a foot's motion, that its teeth load.
    - `first_line`, `slices`: of the grid that it was made for.
    - `repeats`: mesh periods after which the body repeats under its teeth.
    - `modes`: on which it vibrates, or `None`: it is for statics.
    """

    flexibility: FootMatrix
    from_seats: FootSeats
    growth: FootColumn
    centres: FootPlaces
    seat_stiffness: SeatMatrix
    seat_load: SeatLoad
    seat_heights: Float[Array, " seat"]
    seats: tuple[str, ...] = eqx.field(static=True)
    gear_seat: int = eqx.field(static=True)
    components: tuple[int, ...] = eqx.field(static=True)
    first_line: int = eqx.field(static=True)
    slices: int = eqx.field(static=True)
    repeats: int = eqx.field(static=True)
    modes: BodyModes | None = None

    @property
    def lines(self) -> int:
        """Number of contact lines in the tables."""
        return self.growth.shape[2] // self.slices

    @property
    def periods(self) -> int:
        """Mesh periods in the tables: as many as the cycle has, or until the body repeats."""
        return self.growth.shape[0]

    def check(self, grid: MeshGrid) -> None:
        """Refuse a grid that the tables are not for.

        **Arguments:**

        - `grid`: of the cycle.

        **Raises:**

        - `InputError` if slices or contact lines differ, or if the cycle has more mesh periods and
            the body is another one in them.
        """
        require(
            self.periods >= min(self.repeats, grid.periods),
            "A condensed body that repeats after {repeats} mesh periods was put in mesh for "
            "{own} of them, and is used for {periods}. Make it with `flexible_body` from the grid "
            "of the cycle.",
            repeats=self.repeats,
            own=self.periods,
            periods=grid.periods,
        )
        require(
            (self.slices, self.lines, self.first_line)
            == (grid.slices, grid.lines, grid.first_line),
            "A condensed body's tables hold for one number of slices and contact lines: made for "
            "{own} slices and {own_lines} lines, used with {slices} and {lines}. Make it with "
            "`flexible_body` from the grid of the cycle.",
            own=self.slices,
            own_lines=self.lines,
            slices=grid.slices,
            lines=grid.lines,
        )


class FootTables(eqx.Module):
    """What a body adds to the cells of a cycle.

    **Fields:**

    - `compliance`: between cells, with the seats held [m/N].
    - `arms`: approach of each cell per motion of the seats, along and about S, T, Z [-, m].
    - `growth`: approach of each cell by rotation, per square of the speed [m s2].
    """

    compliance: DenseCouplingGrid
    arms: CellArmGrid
    growth: CellGrid


# --- Making the tables, once


def root_patches(
    pair: GearPair, index: int, grid: MeshGrid, teeth: np.ndarray, *, points: int, axial: Axial
) -> RootPatches:
    """Where the slices of some teeth stand on their rim, in the body's frame.

    **Arguments:**

    - `pair`: the gears.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `grid`: gives the slices.
    - `teeth`: numbers of the teeth, counted along the angle, of any shape.
    - `points`: across a root.
    - `axial`: how a slice follows the rim along the axis.

    **Returns:**

    The patches; the last axis of their angles counts slices.
    """
    gear = (pair.pinion, pair.wheel)[index]
    heights = np.asarray(face_positions(pair, grid))
    # Slices of a helical tooth follow the helix; the wheel has the other hand.
    twist = (1.0, -1.0)[index] * math.tan(float(pair.base_helix_angle))
    twist /= float(pair.base_radius[index])
    section = tooth_section(pair, gear)
    # The virtual gear's thickness is normal to the helix.
    thickness = 2.0 * float(section.root_half_angle * section.root_radius)
    half = 0.5 * float(pair.face_width)
    return RootPatches(
        angles=(2.0 * math.pi / gear.teeth) * np.asarray(teeth)[..., None] + twist * heights,
        edges=np.linspace(-half, half, grid.slices + 1),
        width=thickness / math.cos(float(pair.helix_angle)),
        points=points,
        axial=axial,
    )


def teeth_on_lines(index: int, grid: MeshGrid, periods: int) -> np.ndarray:
    """Teeth on the contact lines of each mesh period, counted along the angle.

    **Arguments:**

    - `index`: 0 for the pinion, 1 for the wheel.
    - `grid`: gives the lines.
    - `periods`: mesh periods.

    **Returns:**

    Shape `[period, line]`. A tooth further along the path is ahead on the pinion, behind on the
    wheel; tooth 0 enters at phase 0.
    """
    line = np.arange(grid.lines) + grid.first_line
    ahead = line - np.arange(periods)[:, None]
    return ahead if index == 0 else -ahead


def flexible_body(
    body: Condensed,
    pair: GearPair,
    index: int,
    grid: MeshGrid,
    *,
    gear_seat: str | None = None,
    points: int = ROOT_POINTS,
    axial: Axial = "mortar",
    local: Callable[[int], np.ndarray] | None = None,
    basis: BodyBasis | None = None,
) -> FlexibleBody:
    """Put a condensed body in mesh. Call it outside of `jit`, on concrete gears.

    **Arguments:**

    - `body`: the condensed body.
    - `pair`: the gears.
    - `index`: 0 if it is the pinion's, 1 if it is the wheel's.
    - `grid`: slices, lines and periods of the cycle.
    - `gear_seat`: seat at which the torque acts and the gear's rotation is measured; by default
        `torque`, or the only one.
    - `points`: across the root of a tooth; 2 is the thesis's connection.
    - `axial`: how a slice follows the rim along the axis, "mortar" or "collocation".
    - `local`: what the feet of a tooth give beyond what the elements of the rim can show, by the
        tooth's number: `[6 slice, 6 slice]` in the frames of the feet [m/N, 1/N, 1/(N m)].
    - `basis`: on which the body vibrates, from `body_basis`; statics need none.

    **Returns:**

    The body's tables.

    **Raises:**

    - `ValueError` if the body is not this gear's, if slices are off its rim, if it has no faces on
        the rim, if its seats are not named as they must be, or if its stiffness between seats
        depends on the direction.
    """
    _check_rim(body, pair, index)
    _check_elements(body, pair, index, grid)
    gear = (pair.pinion, pair.wheel)[index]
    sectors = body.facts.get("sectors", 1)
    assert isinstance(sectors, int)
    repeats = gear.teeth // math.gcd(gear.teeth, sectors)
    if basis is not None:
        basis, repeats = basis.under_teeth(gear.teeth, sectors)
    periods = min(repeats, grid.periods)
    teeth = teeth_on_lines(index, grid, periods)
    each, where = np.unique(teeth % gear.teeth if repeats > 1 else teeth, return_inverse=True)
    patches = root_patches(pair, index, grid, each, points=points, axial=axial)
    found = feet(RimSurface(body.rim_nodes, body.rim_faces), patches)
    helical = float(pair.helix_angle) != 0.0
    components = _ALL if helical else _IN_PLANE
    held = _held(body, found, patches.angles.ravel(), components)
    count, slices, size = len(each), grid.slices, len(components)

    whole = held.flexibility.reshape(count, slices, size, count, slices, size)
    if local is not None:
        # Teeth that the body repeats under have the same.
        own = {int(tooth): local(int(tooth)) for tooth in (each if repeats > 1 else each[:1])}
        for place, tooth in enumerate(each):
            more = own[int(tooth if repeats > 1 else each[0])]
            whole[place, :, :, place] += _of_one_tooth(more, slices, components)
    lines = where.reshape(teeth.shape)
    cells = grid.lines * slices

    pairs = whole[lines[:, :, None], :, :, lines[:, None, :]]
    # Period, line, line, slice, component, slice, component.
    pairs = pairs.transpose(0, 4, 6, 1, 3, 2, 5).reshape(periods, size, size, cells, cells)

    def on_cells(rows: np.ndarray) -> np.ndarray:
        """Rows of all feet as `[period, component, cell, ...]`."""
        chosen = rows.reshape(count, slices, size, *rows.shape[1:])[lines]
        return np.moveaxis(chosen, 3, 1).reshape(periods, size, cells, *rows.shape[1:])

    centres = found.centres.reshape(count, slices, 3)[lines].reshape(periods, cells, 3)
    modes = None
    if basis is not None:
        rows = held.feet @ basis.shapes[: held.feet.shape[1]]
        modes = BodyModes(
            square=jnp.asarray(basis.square),
            rows=jnp.asarray(on_cells(rows)),
            load=jnp.asarray(basis.shapes.T @ body.centrifugal_load),
            **basis.matrices(body),
            waves=tuple(int(wave) for wave in basis.waves),
            diameters=tuple(int(number) for number in basis.diameters),
        )
    return FlexibleBody(
        flexibility=jnp.asarray(0.5 * (pairs + pairs.transpose(0, 2, 1, 4, 3))),
        from_seats=jnp.asarray(on_cells(held.from_seats)),
        growth=jnp.asarray(on_cells(held.growth)),
        centres=jnp.asarray(centres),
        seat_stiffness=jnp.asarray(held.seat_stiffness),
        seat_load=jnp.asarray(held.seat_load),
        seat_heights=jnp.asarray(body.seat_points[:, 2]),
        seats=tuple(body.seats),
        gear_seat=_gear_seat(body, gear_seat),
        components=components,
        first_line=grid.first_line,
        slices=slices,
        repeats=repeats,
        modes=modes,
    )


def _of_one_tooth(local: np.ndarray, slices: int, components: tuple[int, ...]) -> np.ndarray:
    """What the feet of one tooth give, as `[slice, component, slice, component]`."""
    chosen = local.reshape(slices, 6, slices, 6)[:, list(components)]
    return chosen[:, :, :, list(components)]


@dataclass(frozen=True)
class _HeldBody:
    """A body with its seats held, and what the seats feel of it.

    **Fields:**

    - `feet`: their components by the translations of the rim nodes, `[row, 3 rim]`.
    - `flexibility`: of the feet's components, `[row, row]`.
    - `from_seats`: `[row, 6 seat]`, both in the frame of each foot.
    - `growth`: of the feet by rotation `[row]`.
    - `seat_stiffness`, `seat_load`: of the seats, the same in every direction.
    """

    feet: np.ndarray
    flexibility: np.ndarray
    from_seats: np.ndarray
    growth: np.ndarray
    seat_stiffness: np.ndarray
    seat_load: np.ndarray


def _held(
    body: Condensed, found: Feet, angles: np.ndarray, components: tuple[int, ...]
) -> _HeldBody:
    """Hold the seats of a body, and move them and load its feet one by one."""
    rim, count = 3 * len(body.rim_nodes), len(body.seats)
    seat = np.arange(rim, rim + 6 * count)
    inner = np.setdiff1d(np.arange(len(body.stiffness)), seat)
    joined = body.stiffness[np.ix_(inner, seat)]
    kept = (6 * np.arange(len(angles))[:, None] + np.array(components)).ravel()
    rows = found.rows[kept].toarray()
    # Unit motions of the seats, loads on the feet, rotation: all in one solution.
    right = np.zeros((len(inner), joined.shape[1] + len(rows) + 1), order="F")
    right[:, : joined.shape[1]] = joined
    right[:rim, joined.shape[1] : -1] = rows.T
    right[:, -1] = body.centrifugal_load[inner]
    inside = body.stiffness[np.ix_(inner, inner)]
    factor = scipy.linalg.cho_factor(inside, lower=True, overwrite_a=True, check_finite=False)
    solved = scipy.linalg.cho_solve(factor, right, overwrite_b=True, check_finite=False)
    given = rows @ solved[:rim]
    by_seats = solved[:, : joined.shape[1]]
    stiffness = body.stiffness[np.ix_(seat, seat)]
    return _HeldBody(
        feet=rows,
        flexibility=given[:, joined.shape[1] : -1],
        from_seats=-_turned(given[:, : joined.shape[1]], angles),
        growth=given[:, -1],
        seat_stiffness=_same_all_round(stiffness - joined.T @ by_seats, stiffness, body),
        seat_load=_along_axis(body.centrifugal_load[seat] - joined.T @ solved[:, -1]),
    )


def _turned(rows: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Rows of each foot per motion of the seats in the body's frame: now in the foot's."""
    apart = rows.reshape(len(angles), len(rows) // len(angles), -1, 3)
    cosine, sine = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    x, y, z = np.moveaxis(apart, 3, 0)
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=3).reshape(rows.shape)


def _same_all_round(matrix: np.ndarray, before: np.ndarray, body: Condensed) -> np.ndarray:
    """The stiffness between seats, the mean over all directions, and free in rigid motions."""
    turned = []
    for quarter in range(4):
        cosine, sine = (
            round(math.cos(quarter * math.pi / 2)),
            round(math.sin(quarter * math.pi / 2)),
        )
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        whole = np.kron(np.eye(len(matrix) // 3), turn)
        turned.append(whole @ matrix @ whole.T)
    mean = np.mean(turned, axis=0)
    # Translations and rotations are of different units: a diagonal of one makes them alike.
    scale = 1.0 / np.sqrt(np.diagonal(before))
    uneven = float(np.abs(scale[:, None] * (matrix - mean) * scale).max())
    require(
        uneven <= _UNEVEN,
        "The stiffness of a condensed body between its seats must be the same in every direction "
        "across the axis, as of three or more equal sectors; that of {name!r} differs by {got:.3g} "
        "of its own. Such a body would shake its bearings once a turn.",
        name=body.name,
        got=uneven,
    )
    rigid = np.zeros((len(matrix), 6))
    for number, point in enumerate(body.seat_points):
        x, y, z = point
        rows = slice(6 * number, 6 * number + 6)
        rigid[rows] = np.eye(6)
        rigid[6 * number : 6 * number + 3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    onto = np.linalg.qr(rigid / scale[:, None])[0]
    free = np.eye(len(matrix)) - onto @ onto.T
    scaled = free @ (scale[:, None] * mean * scale) @ free
    result = scaled / scale[:, None] / scale
    return 0.5 * (result + result.T)


def _along_axis(load: np.ndarray) -> np.ndarray:
    """What of a load on seats stands still while the body turns: along and about the axis."""
    kept = np.zeros_like(load)
    kept[2::3] = load[2::3]
    return kept


def _gear_seat(body: Condensed, name: str | None) -> int:
    if name is None:
        name = "torque" if "torque" in body.seats else body.seats[0] if len(body.seats) == 1 else ""
    require(
        name in body.seats,
        "The seat where the torque acts must be one of the body's, {seats}, got {name!r}.",
        seats=", ".join(body.seats),
        name=name,
    )
    return body.seats.index(name)


def _check_rim(body: Condensed, pair: GearPair, index: int) -> None:
    """Refuse a body that cannot carry these teeth."""
    name = ("pinion", "wheel")[index]
    require(
        len(body.rim_faces) > 0,
        "The condensed body of the {name} must know the elements of its rim: give the faces with "
        "the matrices, or condense it from a grid.",
        name=name,
    )
    radius = float(np.median(np.hypot(body.rim_nodes[:, 0], body.rim_nodes[:, 1])))
    root = float(pair.root_radius[index])
    units = "" if 0.01 < radius / root < 100.0 else " Its file is in other units than metres."
    require(
        abs(radius - root) <= _RIM_OFF * root,
        "The rim of the {name}'s condensed body must have the radius of the root circle of its "
        "teeth, {root:.6g} mm, got {got:.6g} mm. It is the body of another gear.{units}",
        name=name,
        root=root / mm,
        got=radius / mm,
        units=units,
    )
    width = float(np.ptp(body.rim_nodes[:, 2]))
    face = float(pair.face_width)
    require(
        width >= (1.0 - 1e-6) * face,
        "The {name}'s condensed body must be at least as wide as the face in contact, {face:.6g} "
        "mm, got {got:.6g} mm.",
        name=name,
        face=face / mm,
        got=width / mm,
    )


def require_short_elements(name: str, around: float) -> None:
    """Refuse elements of a rim that cover too many teeth.

    **Arguments:**

    - `name`: of the gear.
    - `around`: pitches that one element covers [-].

    **Raises:**

    - `InputError` if they are too many.
    """
    require(
        around <= _LONGEST,
        "The elements of the rim of the {name}'s condensed body are too coarse for its teeth: one "
        "covers {around:.3g} pitches, at most {most:.3g} can be. Use more elements around, one for "
        "each tooth or more.",
        name=name,
        around=around,
        most=_LONGEST,
    )


def _check_elements(body: Condensed, pair: GearPair, index: int, grid: MeshGrid) -> None:
    """Refuse a rim whose elements cannot follow the loads of teeth."""
    name, gear = ("pinion", "wheel")[index], (pair.pinion, pair.wheel)[index]
    corners = body.rim_nodes[body.rim_faces[:, :4]]
    angle = np.arctan2(corners[..., 1], corners[..., 0])
    turned = (angle - angle[:, :1] + np.pi) % (2.0 * np.pi)
    require_short_elements(name, float(np.ptp(turned, axis=1).max()) * gear.teeth / (2.0 * np.pi))
    across, face = float(np.ptp(corners[..., 2], axis=1).max()), float(pair.face_width)
    require(
        across <= _WIDEST * face or grid.slices <= _FEW_SLICES,
        "The elements of the rim of the {name}'s condensed body are too coarse for {slices} "
        "slices: one covers {across:.6g} mm of a face of {face:.6g} mm, at most half of it can be. "
        "Use more elements across the rim, or {few} slices.",
        name=name,
        slices=grid.slices,
        across=across / mm,
        face=face / mm,
        few=_FEW_SLICES,
    )


# --- Using them, at every phase


def foot_tables(pair: GearPair, index: int, body: FlexibleBody, lines: ContactLines) -> FootTables:
    """What a condensed body adds to the cells of a cycle.

    **Arguments:**

    - `pair`: the gears.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `body`: of that gear.
    - `lines`: where the cells are.

    **Returns:**

    Compliance, arms and growth.
    """
    # One mesh period at a time: each has the table of the teeth that are in mesh.
    period = lambda x: x.reshape(lines.periods, -1, *x.shape[1:])
    roll = period(lines.roll)

    def of_period(given: tuple[Array, Array]):
        number, roll = given
        table = jax.tree.map(
            lambda x: x[number % body.periods],
            (body.flexibility, body.from_seats, body.growth, body.centres),
        )
        return _on_cells(pair, index, body, table, roll, lines.face_position)

    found = jax.lax.map(of_period, (jnp.arange(lines.periods), roll))
    compliance, arms, growth = (x.reshape(-1, *x.shape[2:]) for x in found)
    return FootTables(compliance, arms, growth)


def mode_arms(pair: GearPair, index: int, body: FlexibleBody, lines: ContactLines) -> CellArmGrid:
    """Approach of each cell per motion of the modes, in coordinates that stand still in space.

    **Arguments:**

    - `pair`: the gears.
    - `index`: 0 for the pinion, 1 for the wheel.
    - `body`: of that gear, with modes.
    - `lines`: where the cells are.

    **Returns:**

    Arms of all cells at each phase [kg^-1/2].
    """
    modes = body.modes
    assert modes is not None
    teeth = (pair.pinion, pair.wheel)[index].teeth
    # Of the first cell: its tooth in each period, and how far the helix has it turned.
    first = np.arange(body.periods)
    tooth = (1.0, -1.0)[index] * (body.first_line - first)
    twist = (1.0, -1.0)[index] * jnp.tan(pair.base_helix_angle) / pair.base_radius[index]
    on_body = 2.0 * jnp.pi / teeth * jnp.asarray(tooth) + twist * lines.face_position.ravel()[0]
    roll = lines.roll.reshape(lines.periods, -1, *lines.roll.shape[1:])
    waves = np.asarray(modes.waves)
    partner = np.arange(waves.size) + np.where(waves < 0, -1, 0)
    partner[np.flatnonzero(waves < 0) - 1] += 1
    # Modes without a partner stand still on the body.
    number = jnp.asarray(np.where(partner == np.arange(waves.size), 0, waves), dtype=float)

    def of_period(given: tuple[Array, Array]) -> Array:
        period, roll = given
        own = period % body.periods
        weights, angle = foot_weights(pair, index, body.centres[own], roll, lines.face_position)
        rows = modes.rows[own]
        arms = sum(
            (weights[c][:, :, None] * rows[i][None] for i, c in enumerate(body.components)),
            jnp.zeros(()),
        )
        turned = (angle[:, 0] - on_body[own])[:, None, None] * number[None, None, :]
        # The first of a pair has a positive number, the second the same negative.
        return jnp.cos(turned) * arms - jnp.sin(turned) * arms[:, :, partner]

    found = jax.lax.map(of_period, (jnp.arange(lines.periods), roll))
    return found.reshape(-1, *found.shape[2:])


def _on_cells(
    pair: GearPair,
    index: int,
    body: FlexibleBody,
    table: tuple[Array, Array, Array, Array],
    roll: Reals,
    face_position: Reals,
) -> tuple[Array, Array, Array]:
    """Compliance, arms and growth of the cells of one mesh period."""
    flexibility, from_seats, growth, centres = table
    weights, angle = foot_weights(pair, index, centres, roll, face_position)
    weights = [weights[component] for component in body.components]
    size = range(len(weights))
    # Written out over the few components: a batch of tiny products costs many times its arithmetic.
    none = jnp.zeros(())

    def given(a: int) -> Array:
        """Motion of all feet along one component, by the forces of all cells."""
        return sum((flexibility[a, b][None] * weights[b][:, None, :] for b in size), none)

    compliance = sum((weights[a][:, :, None] * given(a) for a in size), none)
    rows = sum((weights[a][:, :, None] * from_seats[a][None] for a in size), none)
    grown = sum((weights[a] * growth[a][None] for a in size), none)
    return compliance, _in_fixed_frame(rows, angle), grown


def foot_weights(
    pair: GearPair, index: int, centres: Array, roll: Reals, face_position: Reals
) -> tuple[list[Array], Array]:
    r"""Approach of each cell per motion of its foot, and the angle of its tooth's middle.

    In the frame of the foot the normal is $(\cos\beta_b\sin\kappa, \cos\beta_b\cos\kappa,
    \mp\sin\beta_b)$, with $\kappa = \rho/r_b - \psi_b$ the load's angle against the perpendicular
    to the tooth's middle, $\rho$ the gear's own roll length and $\psi_b$ half its tooth's angle at
    the base circle; the point of contact is $r_b(\cos\kappa, -\sin\kappa) + \rho(\sin\kappa,
    \cos\kappa)$ from the axis.
    """
    sign = (1.0, -1.0)[index]
    phases = roll.shape[0]
    base = pair.base_radius[index]
    own = (roll if index == 0 else pair.tangent_length - roll).reshape(phases, -1)
    load = own / base - pair.half_thickness_at_base[index]
    sine, cosine = jnp.sin(load), jnp.cos(load)
    helix = pair.base_helix_angle
    flat = jnp.cos(helix)
    normal = flat * sine, flat * cosine, jnp.full_like(own, -sign) * jnp.sin(helix)
    heights = jnp.broadcast_to(face_position, roll.shape).reshape(phases, -1)
    point = base * cosine + own * sine, own * cosine - base * sine, heights
    arm = [point[axis] - centres[None, :, axis] for axis in range(3)]
    moment = [
        arm[(axis + 1) % 3] * normal[(axis + 2) % 3] - arm[(axis + 2) % 3] * normal[(axis + 1) % 3]
        for axis in range(3)
    ]
    angle = load - pair.working_pressure_angle + (0.0 if index == 0 else jnp.pi)
    return [*normal, *moment], angle


def _in_fixed_frame(rows: Array, angle: Array) -> Array:
    """Rows per motion of the seats in the frame of each foot, per motion along S, T, Z."""
    apart = rows.reshape(*rows.shape[:2], -1, 3)
    cosine, sine = jnp.cos(angle)[:, :, None], jnp.sin(angle)[:, :, None]
    r, t, z = apart[..., 0], apart[..., 1], apart[..., 2]
    return jnp.stack([cosine * r - sine * t, sine * r + cosine * t, z], axis=-1).reshape(rows.shape)
