"""From a scene to what its condensed bodies are made from: the only place where keys meet grids.

Everything is in SI and in the body's frame: z along the axis from mid-face, x towards the middle
of tooth 0.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np

from fem_prep import Fineness, GearBody, Holes, Material, SeatPlace, Segment, Teeth, Web
from jaxgear._units import GPa, deg, mm
from jaxgear.scene._body_checks import METHODS
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._build import pair_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._teeth import facts_of_teeth

# Of the diameter there: how much of a shaft a bearing holds, if nobody says.
_SEAT_WIDTH = 1.0 / 3.0
# Of the distance between two bearings: what their seats may fill.
_NO_WIDER = 0.8


@dataclasses.dataclass(frozen=True)
class PlannedSeat:
    """Where a body will be held or driven.

    **Fields:**

    - `name`: `bearing[0]` and so on, `torque`, or `gear` for a body without a shaft.
    - `label`: of the set of nodes: of a drawn body as its grid names it, else as the user does.
    - `at`: z of the seat's own node, on the axis [m].
    - `averaging`: whether the node moves as the mean of the set, which stiffens nothing.
    """

    name: str
    label: str
    at: float
    averaging: bool


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A body by its measures.

    **Fields:**

    - `body`: the measures [m].
    - `fineness`: of its grid.
    """

    body: GearBody
    fineness: Fineness


@dataclasses.dataclass(frozen=True)
class OwnGrid:
    """A grid of the user's own.

    **Fields:**

    - `path`: of the file.
    - `rim`: name of its set of rim nodes.
    - `length_unit`: the file's [m].
    """

    path: Path
    rim: str
    length_unit: float


@dataclasses.dataclass(frozen=True)
class Matrices:
    """Matrices condensed elsewhere.

    **Fields:**

    - `paths`: of the matrices: one file, or stiffness and mass.
    - `nodes`: of the table of nodes, or None.
    - `faces`: of the rim's elements, or None.
    - `units`: name of their system.
    - `mid_face`: z of the middle of the toothed face [m].
    - `mass`: what the body should weigh, or None [kg].
    """

    paths: tuple[Path, ...]
    nodes: Path | None
    faces: Path | None
    units: str
    mid_face: float
    mass: float | None


@dataclasses.dataclass(frozen=True)
class BodyPlan:
    """All that a condensed body is made from.

    **Fields:**

    - `name`: of the scene and the gear; the body is the same under any name.
    - `gear`: `pinion` or `wheel`.
    - `source`: what gives its grid or its matrices.
    - `root_radius`: of the teeth [m].
    - `face_width`: of the teeth [m].
    - `root_thickness`: of a tooth at its root, along the rim [m].
    - `teeth_count`: number of teeth.
    - `material`: of the body.
    - `seats`: where it is held and driven.
    - `torque_seat`: name of the seat where the torque enters or leaves.
    - `teeth`: mass laid on the rim, or None.
    - `method`: how the inside is kept.
    - `modes`: number of modes of the inside.
    - `rotating`: whether the terms of rotation are condensed.
    - `compares_seats`: whether rigid and averaging seats are compared.
    """

    name: str
    gear: str
    source: Drawn | OwnGrid | Matrices
    root_radius: float
    face_width: float
    root_thickness: float
    teeth_count: int
    material: Material
    seats: tuple[PlannedSeat, ...]
    torque_seat: str
    teeth: Teeth | None
    method: str
    modes: int
    rotating: bool
    compares_seats: bool


def body_plan(scene: Scene, gear: str) -> BodyPlan:
    """What the condensed body of a gear is made from.

    **Arguments:**

    - `scene`: checked against the schema.
    - `gear`: `pinion` or `wheel`; its body is condensed.

    **Returns:**

    The plan, in SI.

    **Raises:**

    - `ValueError` if the gears are impossible, or the body's measures do not fit each other.
    """
    pair, index, body = pair_of(scene), GEARS.index(gear), f"{gear}.body"
    wheel = (pair.pinion, pair.wheel)[index]
    root, teeth = float(pair.root_radius[index]), facts_of_teeth(pair, index)
    interface = scene[f"{body}.interface"]
    method = interface if interface in METHODS else "herting"
    # Nothing rigid is where a torque acts, a spline or another gear; but the modes of Craig and
    # Bampton are those of a body that is held there.
    soft = method != "craig-bampton"
    young, own = scene.get(f"{body}.young_GPa"), wheel.material
    with in_keys(gear):
        if scene.get(f"{body}.superelement") is not None:
            source, seats, torque = _matrices(scene, gear), (), ""
        elif scene.get(f"{body}.grid") is not None:
            source = _own_grid(scene, gear, interface)
            seats, torque = _named_seats(scene, gear, soft)
        else:
            source = _drawn(scene, gear, root)
            seats, torque = _drawn_seats(scene, gear, source.body, soft)
        material = Material(
            young=float(own.young) if young is None else young * GPa,
            poisson=float(own.poisson),
            density=float(own.density),
        )
    return BodyPlan(
        name=f"{scene.name}-{gear}",
        gear=gear,
        source=source,
        root_radius=root,
        face_width=scene.gear(gear).face_width_mm * mm,
        root_thickness=teeth.root_thickness,
        teeth_count=scene.gear(gear).teeth,
        material=material,
        seats=seats,
        torque_seat=torque,
        teeth=Teeth(teeth.mass, teeth.polar_inertia) if scene[f"{body}.teeth_mass"] else None,
        method=method,
        modes=scene[f"{body}.modes"],
        rotating=scene[f"{body}.rotating_terms"],
        compares_seats=scene[f"{body}.compare_seats"],
    )


# --- Drawn bodies


def _drawn(scene: Scene, gear: str, root: float) -> Drawn:
    """A body by hub, web, rim and shaft, and its fineness."""
    table, bore = f"{gear}.shaft", scene.gear(gear).bore_mm
    body = GearBody(
        rim_outer=2.0 * root,
        rim_width=scene.gear(gear).face_width_mm * mm,
        bore=0.0 if bore is None else bore * mm,
        web=_web(scene, f"{gear}.body.web"),
        segments=tuple(
            Segment(*(scene[f"{row}.{key}_mm"] * mm for key in ("length", "outer", "inner")))
            for row in scene.rows(f"{table}.segments")
        ),
        gear_at=scene.get(f"{table}.gear_at_mm", 0.0) * mm,
    )
    if body.segments:
        body = dataclasses.replace(body, seats=_places(scene, gear, body))
    return Drawn(body, _fineness(scene, gear, body))


def _web(scene: Scene, table: str) -> Web | None:
    if scene.get(f"{table}.hub_outer_mm") is None:
        return None
    width = scene.get(f"{table}.hub_width_mm")
    return Web(
        hub_outer=scene[f"{table}.hub_outer_mm"] * mm,
        thickness=scene[f"{table}.web_thickness_mm"] * mm,
        rim_inner=scene[f"{table}.rim_inner_mm"] * mm,
        offset=scene.get(f"{table}.web_offset_mm", 0.0) * mm,
        angle=scene.get(f"{table}.web_angle_deg", 0.0) * deg,
        hub_width=None if width is None else width * mm,
        holes=tuple(
            _ring(scene, table, prefix)
            for prefix in ("", "second_")
            if scene.get(f"{table}.{prefix}holes")
        ),
    )


def _ring(scene: Scene, table: str, prefix: str) -> Holes:
    """A ring of holes; what is not said of the second is as in the first, half a pitch on."""
    size = lambda key: scene.get(f"{table}.{prefix}{key}", scene.get(f"{table}.{key}")) * mm
    angle = scene.get(f"{table}.hole_angle_deg", 0.0)
    if prefix:
        between = angle + 180.0 / scene.get(f"{table}.holes", math.inf)
        angle = scene.get(f"{table}.{prefix}hole_angle_deg", between)
    count = scene[f"{table}.{prefix}holes"]
    return Holes(count, size("hole_diameter_mm"), size("hole_circle_mm"), angle * deg)


def _fineness(scene: Scene, gear: str, body: GearBody) -> Fineness:
    table = f"{gear}.body.fineness"
    longest = scene.get(f"{table}.shaft_mm")
    given = {
        "rim_axial": scene.get(f"{table}.rim_across"),
        "rim_radial": scene.get(f"{table}.rim_deep"),
        "web_radial": scene.get(f"{table}.web_along"),
        "web_layers": scene.get(f"{table}.web_layers"),
        "hub_radial": scene.get(f"{table}.hub_deep"),
        "shaft": None if longest is None else longest * mm,
    }
    sectors = scene.get(f"{table}.sectors")
    if sectors is None:
        wanted = scene.gear(gear).teeth * scene.get(f"{table}.elements_per_tooth", 1)
        sectors = _next_multiple(wanted, _repeats(body))
    return Fineness(sectors, **{key: each for key, each in given.items() if each is not None})


def _repeats(body: GearBody) -> int:
    """What the number of elements around must be a multiple of, for holes and a solid axis."""
    rings = body.web.holes if body.web else ()
    inner = [segment.inner for segment in body.segments] or [body.bore]
    return math.lcm(*(ring.count for ring in rings)) * (2 if min(inner) == 0.0 else 1)


def even_sectors(body: GearBody, teeth: int) -> int:
    """The fewest elements around that are a whole number for each tooth and fit holes and axis.

    **Arguments:**

    - `body`: as drawn.
    - `teeth`: number of teeth.

    **Returns:**

    Their number.
    """
    return _next_multiple(1, math.lcm(teeth, _repeats(body)))


def _next_multiple(least: int, of: int) -> int:
    """The smallest multiple not below, and at least eight."""
    return max(-(-least // of), -(-8 // of)) * of


# --- Seats


def _places(scene: Scene, gear: str, body: GearBody) -> tuple[SeatPlace, ...]:
    """Where bearings hold the shaft and, if it is a place of its own, where the torque acts."""
    table = f"{gear}.shaft"
    given = scene.gear(gear).body.seat_width_mm
    at = [scene[f"{row}.at_mm"] * mm for row in scene.rows(f"{table}.bearings")]
    torque = scene.get(f"{table}.torque_at_mm")
    bearings = [
        SeatPlace(f"bearing[{i}]", place, _width(body, at, place) if given is None else given * mm)
        for i, place in enumerate(at)
    ]
    if torque is None or abs(torque * mm - body.gear_at) <= 0.5 * body.hub_width:
        return tuple(bearings)
    gap = min(abs(torque * mm - seat.at) - 0.5 * seat.width for seat in bearings)
    if gap <= 1e-3 * body.rim_outer:
        return tuple(bearings)
    width = min(_width(body, [], torque * mm), 2.0 * _NO_WIDER * gap)
    return (*bearings, SeatPlace("torque", torque * mm, width))


def _width(body: GearBody, others: list[float], at: float) -> float:
    """Length of the seat of a bearing: by the shaft's diameter, or as its neighbours allow."""
    ends = np.cumsum([segment.length for segment in body.segments])
    here = min(int(np.searchsorted(ends, at)), len(body.segments) - 1)
    width = _SEAT_WIDTH * body.segments[here].outer
    apart = [abs(other - at) for other in others if other != at]
    return min([width, *(_NO_WIDER * each for each in apart)])


def _drawn_seats(
    scene: Scene, gear: str, body: GearBody, soft: bool
) -> tuple[tuple[PlannedSeat, ...], str]:
    """Seats of a drawn body, and which of them the torque acts on."""
    averaging = scene.gear(gear).body.seat_coupling == "averaging"
    if not body.segments:
        if body.bore:
            return (PlannedSeat("gear", "bore", 0.0, averaging),), "gear"
        # Of a body without a bore the innermost elements, whose size is no measure of anything.
        return (PlannedSeat("gear", "gear", 0.0, averaging or soft),), "gear"
    seats = [
        PlannedSeat(
            place.name,
            place.name,
            place.at - body.gear_at,
            soft if place.name == "torque" else averaging,
        )
        for place in body.seats
    ]
    torque = scene.gear(gear).shaft.torque_at_mm
    if seats[-1].name == "torque":
        return tuple(seats), "torque"
    at = 0.0 if torque is None else torque * mm - body.gear_at
    if abs(at) <= 0.5 * body.hub_width:
        return (*seats, PlannedSeat("torque", "gear", at, soft)), "torque"
    return tuple(seats), min(seats, key=lambda seat: abs(seat.at - at)).name


def _named_seats(scene: Scene, gear: str, soft: bool) -> tuple[tuple[PlannedSeat, ...], str]:
    """Seats of a grid of the user's own, by the names of its sets."""
    body, table = f"{gear}.body", f"{gear}.shaft"
    averaging = scene[f"{body}.seat_coupling"] == "averaging"
    sets, rows = scene[f"{body}.seats"], scene.rows(f"{table}.bearings")
    if not rows:
        return (PlannedSeat("gear", sets[0], 0.0, averaging),), "gear"
    origin = scene[f"{table}.gear_at_mm"]
    seats = [
        PlannedSeat(f"bearing[{i}]", label, (scene[f"{row}.at_mm"] - origin) * mm, averaging)
        for i, (row, label) in enumerate(zip(rows, sets, strict=True))
    ]
    at = (scene.get(f"{table}.torque_at_mm", origin) - origin) * mm
    if label := scene.get(f"{body}.torque_set"):
        return (*seats, PlannedSeat("torque", label, at, soft)), "torque"
    return tuple(seats), min(seats, key=lambda seat: abs(seat.at - at)).name


# --- Files


def _file(scene: Scene, key: str) -> Path | None:
    """A file of the scene, relative to the scene's own folder."""
    name = scene.get(key)
    return None if name is None else scene.path.parent / name


def _own_grid(scene: Scene, gear: str, interface: str) -> OwnGrid:
    body = f"{gear}.body"
    path = _file(scene, f"{body}.grid")
    assert path is not None
    rim = scene.get(f"{body}.rim_set", interface)
    return OwnGrid(path, rim, scene.get(f"{body}.grid_unit_mm", 1.0) * mm)


def _matrices(scene: Scene, gear: str) -> Matrices:
    whole = f"{gear}.body.superelement"
    paths = (_file(scene, whole), _file(scene, f"{whole}_mass"))
    return Matrices(
        paths=tuple(path for path in paths if path is not None),
        nodes=_file(scene, f"{whole}_nodes"),
        faces=_file(scene, f"{whole}_faces"),
        units=scene[f"{whole}_units"],
        mid_face=scene.get(f"{whole}_mid_face_mm", 0.0) * mm,
        mass=scene.gear(gear).body.mass_kg,
    )
