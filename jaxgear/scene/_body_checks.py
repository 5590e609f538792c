"""What the keys of a condensed body must be together, in the units of the file."""

import math
from collections.abc import Iterator, Set

from jaxgear.scene._body_tables import BodyKeys, WebKeys
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._key import one_of, show

# How the inside of a body is kept. Any other `interface` names the rim's set of a user's grid.
METHODS = ("herting", "craig-bampton", "guyan")

_OF_GRID = ("rim_set", "seats", "torque_set", "load_sets", "grid_unit_mm")
_OF_MATRICES = ("mass", "nodes", "faces", "units", "mid_face_mm")
_HOLES = ("holes", "hole_diameter_mm", "hole_circle_mm")

Said = Iterator[tuple[str, str]]


def body_mistakes(name: str, gear: GearKeys, root: float | None, given: Set[str]) -> Said:
    """What is wrong with a condensed body, each of whose keys is right by itself."""
    body, at = gear.body, f"{name}.body"
    if body.kind != "condensed":
        return
    sources = [key for key in ("web", "grid", "superelement") if f"{at}.{key}" in given]
    for other in sources[1:]:
        yield (
            f"{at}.{other}",
            f"excludes {at}.{sources[0]}: a body is drawn, or a grid of your own, or matrices "
            "condensed elsewhere. Keep one",
        )
    if (body.interface, body.seat_coupling) == ("craig-bampton", "averaging"):
        yield (
            f"{at}.seat_coupling",
            f"got {show('averaging')}, but the modes of craig-bampton are those of a body held at "
            f"its seats, which such seats do not do. Write {show('rigid')}, or {at}.interface = "
            f"{show('herting')}",
        )
    yield from _grid(name, body, len(gear.shaft.bearings), given)
    matrices = f"{at}.superelement"
    if matrices in given and f"{matrices}_units" not in given:
        yield matrices, f"needs {matrices}_units, such as {show('mm-t-s')} for N, mm and MPa"
    if {matrices, f"{at}.temperature"} <= given:
        yield (
            f"{at}.temperature",
            f"excludes {matrices}: heat flows in a grid, and matrices have none. Draw the body, or "
            "give its grid",
        )
    for key in (f"{matrices}_{end}" for end in _OF_MATRICES):
        if key in given and matrices not in given:
            yield key, f"goes with {matrices}, and there is none. Add it, or remove this"
    per_tooth, around = (f"{at}.fineness.{key}" for key in ("elements_per_tooth", "sectors"))
    if {per_tooth, around} <= given:
        yield around, f"excludes {per_tooth}: both say how many elements go around. Keep one"
    if f"{at}.web" in given and not {"grid", "superelement"} & set(sources):
        yield from _drawn(name, gear, root, given)


def _grid(name: str, body: BodyKeys, bearings: int, given: Set[str]) -> Said:
    """Sets of a user's grid, which must be named where there is one, and only there."""
    at = f"{name}.body"
    grid, rim, seats = (f"{at}.{key}" for key in ("grid", "rim_set", "seats"))
    named = body.interface is not None and body.interface not in METHODS
    if named and (grid not in given or rim in given):
        yield (
            f"{at}.interface",
            f"got {show(body.interface)}, must be {one_of(METHODS)}, or the rim's node set of a "
            "body.grid where rim_set does not name it",
        )
    if grid not in given:
        for key in (f"{at}.{key}" for key in _OF_GRID):
            if key in given:
                yield (
                    key,
                    f"is about a grid of your own, and there is none. Add {grid}, or remove it",
                )
        return
    if not named and rim not in given:
        yield grid, f"needs {rim}, the name of its node set on the cylinder under the teeth"
    wanted = bearings or 1
    what = f"one for each of {name}.shaft.bearings" if bearings else "that of the bore"
    if seats not in given:
        yield grid, f"needs {seats}, the names of its node sets: {what}"
    elif body.seats is not None and len(body.seats) != wanted:
        yield seats, f"got {len(body.seats)} names, must be {wanted}, {what}"


def _drawn(name: str, gear: GearKeys, root: float | None, given: Set[str]) -> Said:
    """Diameters in their order, and holes within the web."""
    web, at, face = gear.body.web, f"{name}.body.web", gear.face_width_mm
    hub, rim, thick = web.hub_outer_mm, web.rim_inner_mm, web.web_thickness_mm
    bore = None if f"{name}.shaft" in given else gear.bore_mm
    for key, low, high, limit in (
        ("hub_outer_mm", bore, hub, "greater than bore_mm, {low:g}"),
        ("rim_inner_mm", hub, rim, "greater than hub_outer_mm, {low:g}"),
        ("rim_inner_mm", rim, root, "less than the root circle, {high:.6g}"),
    ):
        if low is not None and high is not None and low >= high:
            value, limit = getattr(web, key), limit.format(low=low, high=high)
            yield f"{at}.{key}", f"got {show(value)}, must be {limit}; both are diameters"
    if thick is not None and face is not None and thick > face:
        yield (
            f"{at}.web_thickness_mm",
            f"got {thick:g}, must not exceed {name}.face_width_mm, {face:g}. Leave web out for a "
            "solid body",
        )
    for ring in ("", "second_"):
        yield from _holes(at, ring, web, given)


def _holes(at: str, ring: str, web: WebKeys, given: Set[str]) -> Said:
    """One ring of holes: complete, between hub and rim, and apart."""
    keys = [f"{ring}{key}" for key in _HOLES]
    said = [key for key in keys if f"{at}.{key}" in given]
    count = getattr(web, keys[0])
    if not count:
        if said and keys[0] not in said:
            yield (
                f"{at}.{keys[0]}",
                "is missing: number of holes. It must be an integer >= 1",
            )
        return
    # What is not said of the second ring is as in the first.
    sizes = [key if not ring or key in said else key.removeprefix(ring) for key in keys[1:]]
    for key in sizes:
        if f"{at}.{key}" not in given:
            missing = f"is missing, and {show(count)} holes need it. It is a diameter, > 0 mm"
            yield f"{at}.{key}", missing
    diameter, circle = (getattr(web, key) for key in sizes)
    if diameter is None or circle is None:
        return
    if count > 1 and circle * math.sin(math.pi / count) <= diameter:
        yield (
            f"{at}.{keys[0]}",
            f"got {count}, but so many holes of {diameter:g} mm on a circle of {circle:g} mm run "
            "into each other. Make them fewer or smaller",
        )
    if ring and not set(keys[1:]) & set(said):
        return  # The first ring has said it.
    hub, rim = web.hub_outer_mm, web.rim_inner_mm
    for limit, what, crossed in (
        (hub, "hub_outer_mm", hub is not None and circle - diameter <= hub),
        (rim, "rim_inner_mm", rim is not None and circle + diameter >= rim),
    ):
        if crossed:
            yield (
                f"{at}.{sizes[1]}",
                f"got {circle:g}, but holes that reach from {circle - diameter:g} to "
                f"{circle + diameter:g} mm cut {what}, {limit:g}: they must lie in the web",
            )
