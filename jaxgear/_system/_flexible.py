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
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxgear._checks import require
from jaxgear._geometry._lines import MeshGrid
from jaxgear._geometry._pair import GearPair
from jaxgear._system._body_heat import BodyHeat
from jaxgear._system._body_modes import BodyModes
from jaxgear._system._gear_body import AbstractGearBody, SectionMotion, carried
from jaxgear._system._mount import AbstractMount, MountedNodes, MountMatrices
from jaxgear._types import Scalar
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
    - `load_seats`: number of the seat that takes each load of its shaft.
    - `heat`: what temperatures do to it, or `None`: it was made without.
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
    load_seats: tuple[int, ...] = eqx.field(static=True, default=())
    heat: BodyHeat | None = None

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
        named |= {f"load {i}": seat for i, seat in enumerate(self.load_seats)}
        gear, bearings = (self.gear_seat,), range(len(mount.bearings))
        return MountedNodes(
            places=tuple(named.items()),
            count=len(self.seats),
            gear=gear,
            loaded=tuple(range(len(self.seats))),
            torque=gear,
            bearings=tuple(named[f"bearing {i}"] for i in bearings),
            offsets=self._load_offsets(mount),
        )

    def _load_offsets(self, mount: AbstractMount) -> tuple[Scalar, ...]:
        """How far each load of a shaft is above the seat that takes it [m]."""
        taken = zip(mount.load_heights, self.load_seats, strict=True)
        return tuple(at - self.seat_heights[seat] for at, seat in taken)

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
    taken = {body.seats[seat] for seat in (body.gear_seat, *body.load_seats)}
    spare = set(body.seats) - {*wanted, *taken}
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
        len(body.load_seats) == len(mount.loads),
        "The {name}'s condensed body contains its shaft, and must know the seat of each of its "
        "loads: there are {loads} loads, and seats for {own}. Put it in mesh with `load_seats`.",
        name=name,
        loads=len(mount.loads),
        own=len(body.load_seats),
    )
    for number, away in enumerate(body.nodes(mount).offsets):
        require(
            jnp.abs(away) <= mount.diameter_at_gear,
            "Load {number} of the {name}'s shaft must be no further from a seat of its condensed "
            "body than the shaft is thick, {limit:.4g} mm, got {away:.4g} mm. Give the body a seat "
            "there: of matrices one named load[{number}], of a grid of your own a node set in "
            "`load_sets`.",
            number=number,
            name=name,
            limit=mount.diameter_at_gear / mm,
            away=jnp.abs(away) / mm,
        )
