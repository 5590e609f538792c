"""Mistakes in a body's measures, told in the keys of the scene."""

import contextlib
from collections.abc import Generator

from fem_prep import BodyError
from jaxgear._checks import InputError

_KEYS = {
    "GearBody.rim_outer": "teeth (root circle)",
    "GearBody.rim_width": "face_width_mm",
    "GearBody.bore": "bore_mm",
    "GearBody.gear_at": "shaft.gear_at_mm",
    "GearBody.segments": "shaft.segments",
    "GearBody.seats": "shaft.bearings",
    "GearBody": "body",
    "SeatPlace.at": "shaft.bearings.at_mm",
    "SeatPlace.width": "body.seat_width_mm",
    "SeatPlace": "shaft.bearings",
    "Segment.length": "shaft.segments.length_mm",
    "Segment.inner": "shaft.segments.inner_mm",
    "Segment.outer": "shaft.segments.outer_mm",
    "Web": "body.web",
    "Web.hub_outer": "body.web.hub_outer_mm",
    "Web.rim_inner": "body.web.rim_inner_mm",
    "Web.thickness": "body.web.web_thickness_mm",
    "Web.angle": "body.web.web_angle_deg",
    "Web.holes": "body.web.holes",
    "Holes.count": "body.web.holes",
    "Holes.diameter": "body.web.hole_diameter_mm",
    "Holes.circle": "body.web.hole_circle_mm",
    "MeshSizing.sectors": "body.fineness.sectors",
    "MeshSizing.rim_axial": "body.fineness.rim_across",
    "MeshSizing.rim_radial": "body.fineness.rim_deep",
    "MeshSizing.web_radial": "body.fineness.web_along",
    "MeshSizing.web_layers": "body.fineness.web_layers",
    "MeshSizing.hub_radial": "body.fineness.hub_deep",
    "MeshSizing.shaft": "body.fineness.shaft_mm",
    "length_unit": "body.grid_unit_mm",
    "mid_face": "body.superelement_mid_face_mm",
}
# What to do, where keys count in other units than arguments.
_REMEDIES = {
    "length_unit": "1 for one in millimetres, 1000 for one in metres, 25.4 for one in inches.",
}


@contextlib.contextmanager
def in_keys(gear: str) -> Generator[None]:
    """Say what is wrong with a body as what is wrong with the scene.

    **Raises:**

    - `InputError` in place of a `BodyError`.
    """
    try:
        yield
    except BodyError as error:
        names = {name: f"{gear}.{key}" for name, key in _KEYS.items()}
        known = [_REMEDIES[name] for name in error.fields if name in _REMEDIES and error.remedy]
        words = error.worded(names, known[0] if known else None)
        raise InputError(f"{gear}.body: {words}") from error
