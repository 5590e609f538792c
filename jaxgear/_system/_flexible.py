r"""Gear bodies that are condensed finite elements, as teeth in mesh see them.

Statics of a body whose loads act on the feet of slices of teeth and on its seats is exact in two
parts: what the feet give with all seats held, $A$, and how the feet follow the seats, $G$. A cell
on a slice feels the motion of its foot by six numbers $b$, the normal and its moment about the foot
(thesis eq. 2.10 to 2.20), so that bodies add $b^T A b$ to the compliance between cells, and the
seats' motions to the mesh coordinates with arms $b^T G$.

Everything is kept in the frame of each slice's own foot, along the radius, the tangent and the axis
in the middle of the tooth: there a body that repeats from tooth to tooth has one table for all
phases, and another body one for each of the mesh periods after which it repeats.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._geometry._lines import ContactLines, MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._system._body_modes import BodyModes
from jaxgear._system._gear_body import AbstractGearBody, SectionMotion, carried
from jaxgear._system._mount import AbstractMount, MountedNodes, MountMatrices
from jaxgear._types import CellArmGrid, CellGrid, DenseCouplingGrid, Reals, Scalar
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


# How far a seat may be from its bearing, of the shaft's length.
_SEAT_OFF = 1e-3


class FlexibleBody(AbstractGearBody):
    r"""A condensed gear body in mesh (theory 7.6).

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

    @property
    def piece(self) -> None:
        return None

    @property
    def seat_count(self) -> int:
        return len(self.seats)

    def nodes(self, mount: AbstractMount) -> MountedNodes:
        # A body on springs has one node, whatever its name.
        if not mount.bearings:
            return mount.nodes
        named = {seat.replace("[", " ").rstrip("]"): i for i, seat in enumerate(self.seats)}
        named |= {"gear": self.gear_seat, "torque": self.gear_seat}
        gear, bearings = (self.gear_seat,), range(len(mount.bearings))
        return MountedNodes(
            places=tuple(named.items()),
            count=len(self.seats),
            gear=gear,
            loaded=tuple(range(len(self.seats))),
            torque=gear,
            bearings=tuple(named[f"bearing {i}"] for i in bearings),
        )

    def matrices(self, name: str, mount: AbstractMount) -> MountMatrices:
        none = jnp.zeros_like(self.seat_stiffness)
        held = none.at[:6, :6].set(jnp.diag(mount.springs))
        return MountMatrices(self.seat_stiffness + held, none, none)

    def section_motion(self, mount: AbstractMount, z: Scalar) -> SectionMotion:
        return jnp.zeros((6, self.seat_load.size))

    def middle_motion(self, mount: AbstractMount) -> SectionMotion:
        moved, first = carried(-self.seat_heights[self.gear_seat]), 6 * self.gear_seat
        return jnp.zeros((6, self.seat_load.size)).at[:, first : first + 6].set(moved)

    def check(self, name: str, mount: AbstractMount, pair: GearPair, index: int) -> None:
        _check_seats(name, mount, self)

    def check_grid(self, grid: MeshGrid) -> None:
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


def condensed(
    bodies: Iterable[AbstractGearBody | None],
) -> tuple[tuple[int, FlexibleBody], ...]:
    """Those of the bodies of a pair that are condensed, each with its number.

    **Arguments:**

    - `bodies`: of pinion and wheel.
    """
    return tuple((i, body) for i, body in enumerate(bodies) if isinstance(body, FlexibleBody))


def _check_seats(name: str, mount: AbstractMount, body: FlexibleBody) -> None:
    """Refuse a condensed body that its mount cannot hold."""
    seats = ", ".join(body.seats)
    if not mount.bearings:
        require(
            len(body.seats) == 1,
            "The {name}'s condensed body has the seats {seats}: give the bearings of its shaft. "
            "Springs at the centre hold a body of one seat only.",
            name=name,
            seats=seats,
        )
        return
    wanted = [f"bearing[{i}]" for i in range(len(mount.bearings))]
    require(
        set(wanted) <= set(body.seats),
        "The {name}'s condensed body must have a seat for each bearing, {wanted}, got {seats}.",
        name=name,
        wanted=", ".join(wanted),
        seats=seats,
    )
    spare = set(body.seats) - {*wanted, body.seats[body.gear_seat]}
    require(
        not spare,
        "The {name}'s condensed body has seats that nothing holds: {spare}. Give their bearings.",
        name=name,
        spare=", ".join(sorted(spare)),
    )
    for seat, at in zip(wanted, mount.bearing_heights, strict=True):
        height = body.seat_heights[body.seats.index(seat)]
        require(
            jnp.abs(height - at) <= _SEAT_OFF * mount.length,
            "The {name}'s condensed body must have its seat {seat} where that bearing is, {at:.6g} "
            "mm from mid-face, got {height:.6g} mm.",
            name=name,
            seat=seat,
            at=at / mm,
            height=height / mm,
        )
    require(
        not mount.loads,
        "The {name}'s condensed body contains its shaft, which has no node where the loads of the "
        "shaft act. Leave the loads out, or make the body rigid or a beam.",
        name=name,
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
