"""What the keys of a condensed body must be together, in the units of the file."""

import math
from collections.abc import Iterator, Mapping, Set

from jaxgear.scene._schema import one_of, show

# How the inside of a body is kept. Any other `interface` names the rim's set of a user's grid.
METHODS = ("herting", "craig-bampton", "guyan")

_OF_GRID = ("rim_set", "seats", "torque_set", "grid_unit_mm")

Values = Mapping[str, object]
Said = Iterator[tuple[str, str]]


def body_mistakes(gear: str, values: Values, given: Set[str]) -> Said:
    """What is wrong with a condensed body, each of whose keys is right by itself.

    **Arguments:**

    - `gear`: `pinion` or `wheel`.
    - `values`: of the scene, without those that are wrong.
    - `given`: keys and tables that the user wrote.

    **Returns:**

    Path and message of each mistake; none for bodies that are not condensed.
    """
    body = f"{gear}.body"
    if values.get(f"{body}.kind") != "condensed":
        return
    sources = [key for key in ("web", "grid", "superelement") if f"{body}.{key}" in given]
    for other in sources[1:]:
        yield (
            f"{body}.{other}",
            f"excludes {body}.{sources[0]}: a body is drawn, or a grid of your own, or matrices "
            "condensed elsewhere. Keep one",
        )
    coupling = f"{body}.seat_coupling"
    if (values.get(f"{body}.interface"), values.get(coupling)) == ("craig-bampton", "averaging"):
        yield (
            coupling,
            f"got {show('averaging')}, but the modes of craig-bampton are those of a body held at "
            f"its seats, which such seats do not do. Write {show('rigid')}, or {body}.interface = "
            f"{show('herting')}",
        )
    yield from _grid(gear, values, given)
    yield from _matrices(body, given)
    per_tooth, around = (f"{body}.fineness.{key}" for key in ("elements_per_tooth", "sectors"))
    if per_tooth in given and around in given:
        yield around, f"excludes {per_tooth}: both say how many elements go around. Keep one"
    if "grid" not in sources and "superelement" not in sources:
        yield from _drawn(gear, values, given)


def _grid(gear: str, values: Values, given: Set[str]) -> Said:
    """Sets of a user's grid, which must be named where there is one, and only there."""
    body = f"{gear}.body"
    interface, rim = values.get(f"{body}.interface"), f"{body}.rim_set"
    named = isinstance(interface, str) and interface not in METHODS
    if named and (f"{body}.grid" not in given or rim in given):
        yield (
            f"{body}.interface",
            f"got {show(interface)}, must be {one_of(METHODS)}, or the rim's node set of a "
            "body.grid where rim_set does not name it",
        )
    if f"{body}.grid" not in given:
        for key in _OF_GRID:
            if f"{body}.{key}" in given:
                yield (
                    f"{body}.{key}",
                    f"is about a grid of your own, and there is none. Add {body}.grid, or remove "
                    "it",
                )
        return
    if not named and rim not in given:
        yield (
            f"{body}.grid",
            f"needs {rim}, the name of its node set on the cylinder under the teeth",
        )
    bearings = _count(f"{gear}.shaft.bearings", given)
    wanted = bearings or 1
    what = f"one for each of {gear}.shaft.bearings" if bearings else "that of the bore"
    seats = values.get(f"{body}.seats")
    if f"{body}.seats" not in given:
        yield f"{body}.grid", f"needs {body}.seats, the names of its node sets: {what}"
    elif isinstance(seats, list) and len(seats) != wanted:
        yield f"{body}.seats", f"got {len(seats)} names, must be {wanted}, {what}"


def _matrices(body: str, given: Set[str]) -> Said:
    """Matrices need to have units, and what goes with them needs matrices."""
    whole = f"{body}.superelement"
    if whole in given and f"{whole}_units" not in given:
        yield whole, f"needs {whole}_units, such as {show('mm-t-s')} for N, mm and MPa"
    for end in ("mass", "nodes", "faces", "units", "mid_face_mm"):
        if f"{whole}_{end}" in given and whole not in given:
            yield f"{whole}_{end}", f"goes with {whole}, and there is none. Add it, or remove this"


def _drawn(gear: str, values: Values, given: Set[str]) -> Said:
    """Diameters in their order, and holes within the web."""
    web = f"{gear}.body.web"
    if web not in given:
        return
    root = root_diameter(gear, values)
    hub, rim = _number(values, f"{web}.hub_outer_mm"), _number(values, f"{web}.rim_inner_mm")
    inside = None if f"{gear}.shaft" in given else _number(values, f"{gear}.bore_mm")
    for key, least, most, name in (
        ("hub_outer_mm", inside, hub, "greater than bore_mm, {:g}"),
        ("rim_inner_mm", hub, rim, "greater than hub_outer_mm, {:g}"),
        ("rim_inner_mm", rim, root, "less than the root circle, {:.6g}"),
    ):
        if least is not None and most is not None and least >= most:
            path, limit = f"{web}.{key}", most if name.startswith("less") else least
            said = name.format(limit)
            yield path, f"got {show(values[path])}, must be {said}; both are diameters"
    thick = _number(values, f"{web}.web_thickness_mm")
    face = _number(values, f"{gear}.face_width_mm")
    if thick is not None and face is not None and thick > face:
        yield (
            f"{web}.web_thickness_mm",
            f"got {thick:g}, must not exceed {gear}.face_width_mm, {face:g}. Leave web out for a "
            "solid body",
        )
    for ring in ("", "second_"):
        yield from _holes(web, ring, values, given, hub, rim)


def _holes(
    web: str, ring: str, values: Values, given: Set[str], hub: float | None, rim: float | None
) -> Said:
    """One ring of holes: complete, between hub and rim, and apart."""
    keys = {key: f"{web}.{ring}{key}" for key in ("holes", "hole_diameter_mm", "hole_circle_mm")}
    count = values.get(keys["holes"])
    if not count:
        if keys["holes"] not in given and any(path in given for path in keys.values()):
            yield keys["holes"], "is missing: number of holes. It must be an integer >= 1"
        return
    sizes = [keys["hole_diameter_mm"], keys["hole_circle_mm"]]
    if ring:
        # What is not said of the second ring is as in the first.
        sizes = [path if path in given else path.replace("second_", "") for path in sizes]
    for path in sizes:
        if path not in given:
            yield path, f"is missing, and {show(count)} holes need it. It is a diameter, > 0 mm"
    diameter, circle = (_number(values, path) for path in sizes)
    if diameter is None or circle is None or not isinstance(count, int):
        return
    if ring and not any(path in given for path in list(keys.values())[1:]):
        rim = hub = None  # The first ring has said it.
    if count > 1 and circle * math.sin(math.pi / count) <= diameter:
        yield (
            keys["holes"],
            f"got {count}, but so many holes of {diameter:g} mm on a circle of {circle:g} mm run "
            "into each other. Make them fewer or smaller",
        )
    for limit, what, crossed in (
        (hub, "hub_outer_mm", hub is not None and circle - diameter <= hub),
        (rim, "rim_inner_mm", rim is not None and circle + diameter >= rim),
    ):
        if crossed:
            yield (
                sizes[1],
                f"got {circle:g}, but holes that reach from {circle - diameter:g} to "
                f"{circle + diameter:g} mm cut {what}, {limit:g}: they must lie in the web",
            )


def root_diameter(gear: str, values: Values) -> float | None:
    """Diameter of the root circle [mm], if all that it takes is right.

    **Arguments:**

    - `gear`: `pinion` or `wheel`.
    - `values`: of the scene, without those that are wrong.
    """
    names = ("pair.module_mm", "pair.helix_angle_deg", f"{gear}.dedendum_coeff")
    numbers = [_number(values, path) for path in (*names, f"{gear}.profile_shift")]
    teeth = values.get(f"{gear}.teeth")
    if None in numbers or not isinstance(teeth, int):
        return None
    module, helix, dedendum, shift = (float(each or 0.0) for each in numbers)
    return module * (teeth / math.cos(math.radians(helix)) - 2.0 * (dedendum - shift))


def _number(values: Values, path: str) -> float | None:
    value = values.get(path)
    return value if isinstance(value, float) else None


def _count(table: str, given: Set[str]) -> int:
    """Number of rows of a list of tables."""
    count = 0
    while f"{table}[{count}]" in given:
        count += 1
    return count
