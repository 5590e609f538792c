"""What the keys of a scene must be together, each of which is right by itself."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from jaxgear.scene._body_checks import body_mistakes
from jaxgear.scene._body_tables import SupportKeys
from jaxgear.scene._gear_tables import BearingKeys, GearKeys, ShaftKeys
from jaxgear.scene._instead import instead_mistakes, place_of, values_instead
from jaxgear.scene._key import show
from jaxgear.scene._paths import around, look_up
from jaxgear.scene._reading import Reading
from jaxgear.scene._scatter_checks import robust_mistakes, scattered_key
from jaxgear.scene._schema import GEARS, REAL_KEYS, general, nearest, split_entry, unit_of
from jaxgear.scene._sizes import root_diameter
from jaxgear.scene._slips import slips
from jaxgear.scene._table import table_of
from jaxgear.scene._tables import PlainTables

_BOUNDS, _TIES = "optimise.bounds.", "optimise.ties."
_TORQUE = "pair.torque_pinion_Nm"

Values = Mapping[str, Any]
Said = Iterator[tuple[str, str]]


def mistakes_together(reading: Reading, values: Values) -> Said:
    """Check what involves more than one key, among the values that are right by themselves."""
    for path, low in values.items():
        high = values.get(path.removesuffix("from") + "to")
        if path.endswith(".from") and high is not None and low >= high:
            yield path, f"got {show(low)}, must be less than `to`, {show(high)}"
    yield from instead_mistakes(values, reading.seen, reading.where)
    values = {**values, **values_instead(values)}
    tables = table_of(PlainTables, values, reading.seen)
    for name in GEARS:
        gear = tables.gear(name)
        yield from _springs(f"{name}.support", gear.support)
        yield from _foundation(reading, name, values)
        for side in (name, f"{name}_coast"):
            errors = getattr(tables.flank, side).pitch_error_um
            if errors and gear.teeth is not None and len(errors) not in (1, gear.teeth):
                words = f"must be 1 or {gear.teeth}, one for each of {name}.teeth"
                yield f"flank.{side}.pitch_error_um", f"got {len(errors)} values, {words}"
        yield from _shaft(reading, name, gear)
        yield from body_mistakes(name, gear, root_diameter(tables, name), reading.seen)
    weights = [values[path] for path in values if path.startswith("optimise.minimise.")]
    if "optimise.minimise" not in values and not any(weights):
        if not reading.refused("optimise.minimise"):
            yield "optimise.minimise", "must have at least one weight > 0"
    yield from _search(reading, tables.optimise.vary or [], values)
    if "robust" in reading.seen:
        yield from robust_mistakes(tables, values, reading.seen, faulty=reading.refused("robust"))
        for path in values:
            key = scattered_key(path)
            if key in ("pair.power_kW", "pair.speed_rpm"):
                yield path, f"gears feel its torque: let {_TORQUE} scatter"
            # Objectives are asked at torques, wherever these come from.
            elif key and key != _TORQUE and (missing := _missing(reading, key, values)):
                yield path, missing
    for slip in slips(tables, values):
        path = place_of(slip.path, reading.seen)
        if slip.impossible and not reading.refused(path):
            yield path, slip.message


def _springs(table: str, springs: SupportKeys | BearingKeys) -> Said:
    """Check that a stiffness is given in one way: for all directions, or for each."""
    for both, one in (("radial_N_m", "radial_{}_N_m"), ("tilt_Nm_rad", "tilt_{}_Nm_rad")):
        names = [name for name in map(one.format, "ST") if getattr(springs, name, None) is not None]
        if getattr(springs, both) is not None and names:
            yield f"{table}.{both}", f"excludes {' and '.join(names)}. Keep one way"


def _foundation(reading: Reading, gear: str, values: Values) -> Said:
    """Check that a foundation that was asked for has the bore that it needs."""
    own, bore = f"{gear}.foundation", f"{gear}.bore_mm"
    path = own if own in reading.seen else "mesh.foundation"
    bored = values.get(bore) if bore in values else bore in reading.seen
    if path in reading.seen and values.get(path) in ("ring", "sainsot") and not bored:
        yield (
            path,
            f"got {show(values[path])}, which needs the bore where the body is clamped: give "
            f"{bore} a value > 0, or write {own} = {show('weber')}",
        )


def _shaft(reading: Reading, name: str, gear: GearKeys) -> Said:
    """Check that a shaft is whole, that what is on it is on it, and that a beam has one."""
    table, shaft = f"{name}.shaft", gear.shaft
    if table not in reading.tables:
        if gear.body.kind == "beam" and not reading.refused(table):
            yield (
                f"{name}.body.kind",
                f"got {show('beam')}, but there is no [{table}] whose beam the body could be. "
                f"Add it, or write {show('rigid')}",
            )
        return
    if f"{name}.support" in reading.tables:
        yield f"{name}.support", f"excludes {table}, whose bearings hold the gear. Keep one"
    for path, rows in (
        (f"{table}.segments", shaft.segments),
        (f"{table}.bearings", shaft.bearings),
    ):
        if not rows and not reading.refused(path):
            yield path, "is missing: a shaft needs at least one row of it"
    for row, bearing in enumerate(shaft.bearings):
        yield from _springs(f"{table}.bearings[{row}]", bearing)
    for row, segment in enumerate(shaft.segments):
        inner, outer = segment.inner_mm, segment.outer_mm
        if inner is not None and outer is not None and inner >= outer:
            words = f"got {show(inner)}, must be less than outer_mm, {show(outer)}"
            yield f"{table}.segments[{row}].inner_mm", words
    yield from _beyond(table, shaft)
    if gear.body.kind == "beam":
        yield from _within_face(name, shaft, gear.face_width_mm)


def _within_face(name: str, shaft: ShaftKeys, face: float | None) -> Said:
    """Check that no unbalance lies within the face of a beam body, which has no node there."""
    for row, at in enumerate(each.at_mm for each in shaft.unbalance):
        if face is None or shaft.gear_at_mm is None or at is None:
            continue
        if abs(at - shaft.gear_at_mm) < 0.5 * face - 1e-6:
            yield (
                f"{name}.shaft.unbalance[{row}].at_mm",
                f"got {show(at)}, which is within the face of a body that is a beam, where there "
                f"is no node. Give its parts at both ends of the face, or write {name}.body.kind "
                f"= {show('rigid')}",
            )


def _beyond(table: str, shaft: ShaftKeys) -> Said:
    """Check that nothing lies beyond the end of a shaft."""
    lengths = [segment.length_mm for segment in shaft.segments]
    if not lengths or None in lengths:
        return
    end = math.fsum(lengths)
    places = {
        f"{table}.gear_at_mm": shaft.gear_at_mm,
        f"{table}.torque_at_mm": shaft.torque_at_mm,
        **{f"{table}.bearings[{i}].at_mm": each.at_mm for i, each in enumerate(shaft.bearings)},
        **{f"{table}.loads[{i}].at_mm": each.at_mm for i, each in enumerate(shaft.loads)},
        **{f"{table}.unbalance[{i}].at_mm": each.at_mm for i, each in enumerate(shaft.unbalance)},
    }
    for path, at in places.items():
        # The sum may be rounded below the end that the user wrote.
        if at is not None and at > end * (1.0 + 1e-9):
            yield (
                path,
                f"got {show(at)}, which is beyond the end of the shaft: the length_mm of "
                f"{table}.segments add up to {end:g}",
            )


def _search(reading: Reading, vary: list[str], values: Values) -> Said:
    """Check the keys to vary, their bounds, and what follows them."""
    for index, path in enumerate(vary):
        at = f"optimise.vary[{index}]"
        if "[]" in path or general(path) not in REAL_KEYS:
            near = nearest(general(path), REAL_KEYS)
            hint = f", did you mean {show(near.replace('[]', '[0]'))}?" if near else ""
            yield (
                at,
                f"got {show(path)}, must be the path of a real-valued key that the mesh "
                f"depends on, such as {show('flank.pinion.tip_relief.depth_um')}{hint}",
            )
        elif path in vary[:index]:
            yield at, f"{show(path)} is named twice. Keep one"
        elif missing := _missing(reading, path, values):
            yield at, f"{show(path)} {missing}"
    for path in values:
        if path.startswith(_BOUNDS):
            yield from _bounds(reading, path, vary, values)
    for path, owner in values.items():
        key = path.removeprefix(_TIES)
        if key == path:
            continue
        if owner not in vary:
            yield path, f"got {show(owner)}, must be one of optimise.vary"
        elif key in vary:
            yield path, "is in optimise.vary itself. Keep one"
        elif missing := _missing(reading, key, values):
            yield path, missing
        elif unit_of(key) != unit_of(owner):
            theirs, own = (unit_of(each) or "no unit" for each in (owner, key))
            yield path, f"got {show(owner)} in {theirs}, must be a number in {own}"


def _bounds(reading: Reading, path: str, vary: list[str], values: Values) -> Said:
    """Check the bounds of one key: in order, and around where it starts."""
    limits, key = values[path], path.removeprefix(_BOUNDS)
    missing = _missing(reading, key, values)
    if limits[0] >= limits[1]:
        yield path, f"got {show(limits)}, must be [low, high], low below high"
    elif key in vary and not missing:
        start = look_up(values, key, None)
        if isinstance(start, float) and not limits[0] <= start <= limits[1]:
            words = f"must contain the starting value {show(start)} of {key}"
            yield path, f"got {show(limits)}, {words}"
    elif "[" in key and missing:
        yield path, missing


def _missing(reading: Reading, path: str, values: Values) -> str:
    """Say what is not there of a key, row or entry that is named; empty where all is."""
    for place in (path, *around(path)):
        above, index = split_entry(place)
        if index is None or reading.refused(above):
            continue
        entries = values.get(above)
        count = reading.rows.get(above, len(entries) if isinstance(entries, list) else 0)
        if index >= count:
            return f"names number {index} of {above}, which has {count}, counted from 0"
    key, _ = split_entry(path)
    if (other := place_of(key, reading.seen)) != key:
        return f"is given by {other} ({reading.where(other)}). Name that one"
    there = key in values or key in reading.seen
    return "" if there else "has no value to start from. Give it one"
