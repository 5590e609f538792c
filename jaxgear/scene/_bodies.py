"""From a scene to what its condensed bodies are made from: the only place where keys meet grids.

Everything is in SI and in the body's frame: z along the axis from mid-face, x towards the middle
of tooth 0.
"""

import dataclasses
import math
from pathlib import Path
from typing import Any

from fem_prep import GearBody, Holes, Material, MeshSizing, Segment, Teeth, Web
from jaxgear._units import GPa, deg, mm
from jaxgear.scene._body_checks import METHODS
from jaxgear.scene._body_seats import PlannedSeat, Seats, drawn_seats, named_seats, seat_places
from jaxgear.scene._body_tables import BodyKeys, WebKeys
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._build_pair import pair_of, si
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._teeth import facts_of_teeth


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A body by its measures.

    **Fields:**

    - `body`: the measures [m].
    - `fineness`: of its grid.
    """

    body: GearBody
    fineness: MeshSizing


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
    - `load_seats`: names of those that take the loads of its shaft.
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
    load_seats: tuple[str, ...]
    teeth: Teeth | None
    method: str
    modes: int
    rotating: bool
    compares_seats: bool


def body_plan(scene: Scene, name: str) -> BodyPlan:
    """What the condensed body of a gear is made from, in SI.

    **Raises:**

    - `ValueError` if the gears are impossible, or the body's measures do not fit each other.
    """
    pair, index, gear = pair_of(scene), GEARS.index(name), scene.gear(name)
    wheel, body, folder = (pair.pinion, pair.wheel)[index], gear.body, scene.path.parent
    root, teeth = float(pair.root_radius[index]), facts_of_teeth(pair, index)
    method = body.interface if body.interface in METHODS else "herting"
    # Nothing rigid is where a torque acts, a spline or another gear; but the modes of Craig and
    # Bampton are those of a body that is held there.
    soft = method != "craig-bampton"
    with in_keys(name):
        if body.superelement is not None:
            source = _matrices(body, folder)
            seats = Seats((), "", tuple(f"load[{i}]" for i in range(len(gear.shaft.loaded_at_mm))))
        elif body.grid is not None:
            rim = _or(body.rim_set, body.interface)
            source = OwnGrid(folder / body.grid, rim, _or(body.grid_unit_mm, 1.0) * mm)
            seats = named_seats(gear, soft)
        else:
            source = _drawn(gear, root)
            seats = drawn_seats(gear, source.body, soft)
        material = Material(
            young=float(_or(si(body.young_GPa, GPa), wheel.material.young)),
            poisson=float(wheel.material.poisson),
            density=float(wheel.material.density),
        )
    return BodyPlan(
        name=f"{scene.name}-{name}",
        gear=name,
        source=source,
        root_radius=root,
        face_width=gear.face_width_mm * mm,
        root_thickness=teeth.root_thickness,
        teeth_count=gear.teeth,
        material=material,
        seats=seats.all,
        torque_seat=seats.torque,
        load_seats=seats.loads,
        teeth=Teeth(teeth.mass, teeth.polar_inertia) if body.teeth_mass else None,
        method=method,
        modes=body.modes or 0,
        rotating=bool(body.rotating_terms),
        compares_seats=bool(body.compare_seats),
    )


def _or(value: Any, otherwise: Any) -> Any:
    """What is given, or what is meant where nothing is."""
    return otherwise if value is None else value


# --- Drawn bodies


def _drawn(gear: GearKeys, root: float) -> Drawn:
    """A body by hub, web, rim and shaft, and its fineness."""
    body = GearBody(
        rim_outer=2.0 * root,
        rim_width=gear.face_width_mm * mm,
        bore=_or(gear.bore_mm, 0.0) * mm,
        web=_web(gear.body.web),
        segments=tuple(
            Segment(each.length_mm * mm, each.outer_mm * mm, each.inner_mm * mm)
            for each in gear.shaft.segments
        ),
        gear_at=_or(gear.shaft.gear_at_mm, 0.0) * mm,
    )
    if body.segments:
        body = dataclasses.replace(body, seats=seat_places(gear, body))
    return Drawn(body, _fineness(gear, body))


def _web(web: WebKeys) -> Web | None:
    if web.hub_outer_mm is None:
        return None
    # What is not said of the second ring of holes is as in the first, half a pitch on.
    size, circle = web.hole_diameter_mm, web.hole_circle_mm
    angle = _or(web.hole_angle_deg, 0.0)
    between = angle + 180.0 / (web.holes or math.inf)
    rings: Any = (
        (web.holes, size, circle, angle),
        (
            web.second_holes,
            _or(web.second_hole_diameter_mm, size),
            _or(web.second_hole_circle_mm, circle),
            _or(web.second_hole_angle_deg, between),
        ),
    )
    return Web(
        hub_outer=web.hub_outer_mm * mm,
        thickness=web.web_thickness_mm * mm,
        rim_inner=web.rim_inner_mm * mm,
        offset=_or(web.web_offset_mm, 0.0) * mm,
        angle=_or(web.web_angle_deg, 0.0) * deg,
        hub_width=si(web.hub_width_mm, mm),
        holes=tuple(Holes(n, d * mm, at * mm, turn * deg) for n, d, at, turn in rings if n),
    )


def _fineness(gear: GearKeys, body: GearBody) -> MeshSizing:
    wanted = gear.body.fineness
    given = {
        "rim_axial": wanted.rim_across,
        "rim_radial": wanted.rim_deep,
        "web_radial": wanted.web_along,
        "web_layers": wanted.web_layers,
        "hub_radial": wanted.hub_deep,
        "shaft": si(wanted.shaft_mm, mm),
    }
    sectors = wanted.sectors
    if sectors is None:
        sectors = _next_multiple(gear.teeth * _or(wanted.elements_per_tooth, 1), _repeats(body))
    return MeshSizing(sectors, **{key: each for key, each in given.items() if each is not None})


def _repeats(body: GearBody) -> int:
    """What the number of elements around must be a multiple of, for holes and a solid axis."""
    rings = body.web.holes if body.web else ()
    inner = [segment.inner for segment in body.segments] or [body.bore]
    return math.lcm(*(ring.count for ring in rings)) * (2 if min(inner) == 0.0 else 1)


def even_sectors(body: GearBody, teeth: int) -> int:
    """The fewest elements around that are a whole number for each tooth and fit holes and axis."""
    return _next_multiple(1, math.lcm(teeth, _repeats(body)))


def ribbed_sectors(body: GearBody, teeth: int) -> int:
    """The fewest elements around that are two for each tooth and fit holes and axis."""
    return _next_multiple(2 * teeth, _repeats(body))


def _next_multiple(least: int, of: int) -> int:
    """The smallest multiple not below, and at least eight."""
    return max(-(-least // of), -(-8 // of)) * of


def _matrices(body: BodyKeys, folder: Path) -> Matrices:
    paths = (body.superelement, body.superelement_mass)
    nodes, faces = (
        None if path is None else folder / path
        for path in (body.superelement_nodes, body.superelement_faces)
    )
    assert body.superelement_units is not None
    return Matrices(
        paths=tuple(folder / path for path in paths if path is not None),
        nodes=nodes,
        faces=faces,
        units=body.superelement_units,
        mid_face=_or(body.superelement_mid_face_mm, 0.0) * mm,
        mass=body.mass_kg,
    )
