"""Condensed finite elements put in mesh: the tables of a body, made once."""

import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from jaxgear._checks import require
from jaxgear._geometry._lines import MeshGrid, face_positions
from jaxgear._geometry._pair import GearPair
from jaxgear._geometry._profile import tooth_section
from jaxgear._interface._roots import (
    ROOT_POINTS,
    Axial,
    RimSurface,
    RootPatches,
    interface_map,
)
from jaxgear._system._body_heat import BodyHeat, no_strain
from jaxgear._system._body_in_mesh import BodyInMesh
from jaxgear._system._body_modes import BodyBasis
from jaxgear._system._condensed import Condensed
from jaxgear._system._flexible import FlexibleBody
from jaxgear._system._held_body import HeldBody, held_body
from jaxgear._system._rim_checks import check_elements, check_rim
from jaxgear._types import as_reals

RootMotion = Literal["rigid", "screw"]


# --- Making the tables, once


def root_components(pair: GearPair, motion: RootMotion) -> tuple[int, ...]:
    """Components of a foot's motion that its teeth follow: along and about radius, tangent, axis.

    **Arguments:**

    - `pair`: spur teeth load no others than those along radius and tangent and about the axis.
    - `motion`: of slices of helical teeth, "rigid": all six; "screw": no rotation but that about
        the axis (thesis eq. 2.11), so that a body which tilts does not tilt its teeth.

    **Returns:**

    Numbers of the components.
    """
    if float(pair.helix_angle) == 0.0:
        return 0, 1, 5
    return (0, 1, 2, 5) if motion == "screw" else (0, 1, 2, 3, 4, 5)


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
    load_seats: Sequence[str] = (),
    points: int = ROOT_POINTS,
    axial: Axial = "mortar",
    motion: RootMotion = "rigid",
    local: Callable[[np.ndarray], np.ndarray] | None = None,
    give: Callable[[RootPatches], np.ndarray] | None = None,
    ribs: np.ndarray | None = None,
    basis: BodyBasis | None = None,
    heat: np.ndarray | None = None,
) -> FlexibleBody:
    """Put a condensed body in mesh. Call it outside of `jit`, on concrete gears (theory 7.6).

    **Arguments:**

    - `body`: the condensed body.
    - `pair`: the gears.
    - `index`: 0 if it is the pinion's, 1 if it is the wheel's.
    - `grid`: slices, lines and periods of the cycle.
    - `gear_seat`: where torque and rotation are taken; by default `torque`, or the only one.
    - `load_seats`: where the loads of its shaft act, which may be a little beside.
    - `points`, `axial`: of roots, 2 is the thesis's; along the axis, "mortar" or "collocation".
    - `motion`: of a slice on its root, see `root_components`.
    - `local`: what the feet of teeth, by their numbers, give beyond what the rim's elements show,
        `[tooth, 6 slice, 6 slice]` in the frames of the feet [m/N, 1/N, 1/(N m)].
    - `give`: of feet with the seats held, `[6 foot, 6 foot]`, if not what its matrices say.
    - `ribs`: what feet on the lines give more for the ribs, `[line, 6 slice, line, 6 slice]`.
    - `basis`: on which the body vibrates; statics need none.
    - `heat`: load on its coordinates per free strain of hub and rim, `[2, dof]`, if it may warm.

    **Returns:**

    The body's tables.

    **Raises:**

    - `ValueError` if the body is not this gear's or has no faces on the rim, if slices are off it,
        if seats are not named as they must be, or if the stiffness between them is uneven.
    """
    teeth = (pair.pinion, pair.wheel)[index].teeth
    repeats = repeats_under(body, teeth, basis)
    found = body_in_mesh(
        body,
        pair,
        index,
        grid,
        repeats,
        gear_seat=gear_seat,
        load_seats=load_seats,
        points=points,
        axial=axial,
        motion=motion,
        local=local,
        give=give,
        ribs=ribs,
        heat=heat,
    )
    if basis is None:
        return found.still
    return found.moving(basis.under_teeth(teeth, _sectors(body))[0])


def body_in_mesh(
    body: Condensed,
    pair: GearPair,
    index: int,
    grid: MeshGrid,
    repeats: int,
    *,
    gear_seat: str | None = None,
    load_seats: Sequence[str] = (),
    points: int = ROOT_POINTS,
    axial: Axial = "mortar",
    motion: RootMotion = "rigid",
    local: Callable[[np.ndarray], np.ndarray] | None = None,
    give: Callable[[RootPatches], np.ndarray] | None = None,
    ribs: np.ndarray | None = None,
    heat: np.ndarray | None = None,
) -> BodyInMesh:
    """Put a condensed body in mesh, whatever motions it may vibrate on.

    **Arguments:**

    - `repeats`: mesh periods after which it repeats, of `repeats_under`.
    - the others: as of `flexible_body`.

    **Returns:**

    The body in mesh.

    **Raises:**

    - `ValueError` as `flexible_body`.
    """
    check_rim(body, pair, index)
    check_elements(body, pair, index, grid)
    gear = (pair.pinion, pair.wheel)[index]
    each, lines = _different_teeth(index, grid, gear.teeth, repeats)
    patches = root_patches(pair, index, grid, each, points=points, axial=axial)
    found, components = interface_map(_surface(body), patches), root_components(pair, motion)
    held = held_body(
        body, found, patches, components, heat, None if give is None else give(patches)
    )
    count, slices, size, cells = len(each), grid.slices, len(components), grid.cells
    pairs = _between_cells(held, lines, each, repeats, local, components, ribs)
    # Rows of all feet, as the components of the cells have them.
    rows = np.arange(count * slices * size).reshape(count, slices, size)[lines]
    places = np.moveaxis(rows, 3, 1).reshape(-1, size, cells)
    centres = found.centres.reshape(count, slices, 3)[lines].reshape(-1, cells, 3)
    still = FlexibleBody(
        flexibility=as_reals(0.5 * (pairs + pairs.transpose(0, 2, 1, 4, 3))),
        from_seats=as_reals(held.from_seats[places]),
        growth=as_reals(held.growth[places]),
        heat=None if heat is None else _heat_on(held, places),
        centres=as_reals(centres),
        seat_stiffness=as_reals(held.seat_stiffness),
        seat_load=as_reals(held.seat_load),
        seat_heights=as_reals(body.seat_points[:, 2]),
        seats=tuple(body.seats),
        gear_seat=_gear_seat(body, gear_seat),
        load_seats=tuple(_seat(body, name, "a load of the shaft") for name in load_seats),
        components=components,
        first_line=grid.first_line,
        slices=slices,
        repeats=repeats,
    )
    return BodyInMesh(body, still, held.feet, places, heat)


def _different_teeth(
    index: int, grid: MeshGrid, count: int, repeats: int
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the teeth under which a body differs, and which of these are on the lines."""
    teeth = teeth_on_lines(index, grid, min(repeats, grid.periods))
    each, where = np.unique(teeth % count if repeats > 1 else teeth, return_inverse=True)
    return each, where.reshape(teeth.shape)


def _surface(body: Condensed) -> RimSurface:
    return RimSurface(body.rim_nodes, body.rim_faces)


def repeats_under(body: Condensed, teeth: int, basis: BodyBasis | None) -> int:
    """After how many mesh periods a body is itself again.

    **Arguments:**

    - `body`: the condensed body.
    - `teeth`: of its gear.
    - `basis`: motions on which it vibrates, or `None`: it is for statics.

    **Returns:**

    The number of mesh periods.
    """
    sectors = _sectors(body)
    return teeth // math.gcd(teeth, sectors) if basis is None else basis.repeats(teeth, sectors)


def _sectors(body: Condensed) -> int:
    sectors = body.facts.get("sectors", 1)
    assert isinstance(sectors, int)
    return sectors


def _heat_on(held: HeldBody, places: np.ndarray) -> BodyHeat:
    return BodyHeat(as_reals(held.warm[places]), as_reals(held.seat_heat), no_strain())


def _between_cells(
    held: HeldBody,
    lines: np.ndarray,
    teeth: np.ndarray,
    repeats: int,
    local: Callable[[np.ndarray], np.ndarray] | None,
    components: tuple[int, ...],
    ribs: np.ndarray | None,
) -> np.ndarray:
    """What cells give by each other's loads, `[period, component, component, cell, cell]`."""
    size, count = len(components), lines.shape[1]
    slices = held.feet.shape[0] // (len(teeth) * size)
    own = None
    if local is not None:
        # Teeth that the body repeats under have the same.
        found = local(teeth if repeats > 1 else teeth[:1])
        found = found if repeats > 1 else np.broadcast_to(found, (len(teeth), *found.shape[1:]))
        own = np.stack([_of_one_tooth(each, slices, components) for each in found])
    on_all = 0.0
    if ribs is not None:
        apart = ribs.reshape(count, slices, 6, count, slices, 6)
        on_all = apart[:, :, list(components)][..., list(components)]
    cells, line = count * slices, np.arange(count)
    pairs = np.empty((len(lines), size, size, cells, cells))
    # One mesh period at a time: teeth that are never in mesh together need nothing of each other.
    for period, on_lines in enumerate(lines):
        rows = (slices * size * on_lines[:, None] + np.arange(slices * size)).ravel()
        between = held.flexibility(rows).reshape(count, slices, size, count, slices, size) + on_all
        if own is not None:
            between[line, :, :, line] += own[on_lines]
        pairs[period] = between.transpose(2, 5, 0, 1, 3, 4).reshape(pairs.shape[1:])
    return pairs


def _of_one_tooth(local: np.ndarray, slices: int, components: tuple[int, ...]) -> np.ndarray:
    """What the feet of one tooth give, as `[slice, component, slice, component]`."""
    chosen = local.reshape(slices, 6, slices, 6)[:, list(components)]
    return chosen[:, :, :, list(components)]


def _gear_seat(body: Condensed, name: str | None) -> int:
    if name is None:
        name = "torque" if "torque" in body.seats else body.seats[0] if len(body.seats) == 1 else ""
    return _seat(body, name, "the torque")


def _seat(body: Condensed, name: str, what: str) -> int:
    """Number of a seat by its name."""
    require(
        name in body.seats,
        "The seat where {what} acts must be one of the body's, {seats}, got {name!r}.",
        what=what,
        seats=", ".join(body.seats),
        name=name,
    )
    return body.seats.index(name)
