"""Numbers as drawings and drives have them, in place of those that the models read.

The schema says which key stands for which (`Key.instead_of`); here are the formulas. They hold for
plain numbers and for those that JAX traces, so that a derivative goes through them. Units are those
of the file.
"""

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Set
from typing import Any

from jaxgear._geometry._drawn import (
    addendum_of_tip,
    dedendum_of_root,
    profile_shift_of_balls,
    profile_shift_of_span,
)
from jaxgear.scene._key import show
from jaxgear.scene._schema import GEARS, KEYS, parents

# Reads a number of the scene by its key, or a default; `KeyError` where there is neither.
Read = Callable[..., Any]
Formula = Callable[[Read], Any]

_DEG, _RPM = math.pi / 180.0, math.pi / 30.0

# Keys that may be given in place of each.
_STANDING = [key for key in KEYS.values() if key.instead_of]
INSTEAD: Mapping[str, tuple[str, ...]] = {
    target: tuple(key.path for key in _STANDING if key.instead_of == target)
    for target in dict.fromkeys(key.instead_of for key in _STANDING)
}
# What some of them cannot do without.
_WITH = {"pair.power_kW": "pair.speed_rpm"} | {
    f"{gear}.{key}": f"{gear}.{other}"
    for gear in GEARS
    for key, other in (("span_mm", "span_teeth"), ("over_balls_mm", "ball_mm"))
}


def _reader(values: Mapping[str, Any]) -> Read:
    """Read keys of a mapping, others that stand for them too."""

    def read(path: str, *default: Any) -> Any:
        if path in values:
            return values[path]
        for other in INSTEAD.get(path, ()):
            if other in values:
                return _FORMULAS[other](read)
        if not default:
            raise KeyError(path)
        return default[0]

    return read


def values_instead(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of the keys in whose place others are given, as far as these are right."""
    found, read = {}, _reader(values)
    for target in INSTEAD:
        with contextlib.suppress(KeyError, ValueError):
            if target not in values:
                found[target] = read(target)
    return found


def replaced_by(path: str) -> frozenset[str]:
    """Return the keys that no longer count once a key has a value of its own."""
    return _RIVALS.get(path, frozenset())


def _rivals() -> Iterator[tuple[str, frozenset[str]]]:
    """Of keys that say the same: each, and the others, with what is in them as tables."""
    all_of = {path for target, paths in INSTEAD.items() for path in (target, *paths)}
    for target, paths in INSTEAD.items():
        for path in (target, *paths):
            others = {target, *paths} - {path}
            yield path, frozenset(key for key in all_of if {key, *parents(key)} & others)


_RIVALS: Mapping[str, frozenset[str]] = dict(_rivals())


def alternatives(target: str) -> str:
    """Say what may be written in place of a key that is missing; empty where nothing may."""
    paths = INSTEAD.get(target, ())
    ways = [f"{each} and {_WITH[each]}" if each in _WITH else each for each in paths]
    return f". Or write {', or '.join(ways)}" if ways else ""


def place_of(path: str, given: Set[str]) -> str:
    """Return the key that was written in place of another one, or that other one."""
    return next((each for each in INSTEAD.get(path, ()) if each in given), path)


def instead_mistakes(
    values: Mapping[str, Any], given: Set[str], where: Callable[[str], str]
) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with keys that stand for others: two for one, or half of one."""
    for target, paths in INSTEAD.items():
        said = [path for path in (target, *paths) if path in given]
        if any(parent in INSTEAD for parent in parents(target)):
            # Told of the table.
            continue
        for second in said[1:]:
            yield second, _twice(said[0], where)
        for path in paths:
            if path in given and (other := _WITH.get(path, path)) not in given:
                yield path, f"needs {other}: {KEYS[other].doc}. Add it"
            elif said == [path]:
                yield from _impossible(target, path, values)
    for gear in GEARS:
        tip, shortening = f"{gear}.tip_diameter_mm", f"{gear}.tip_shortening_coeff"
        if {tip, shortening} <= given and values.get(shortening) != 0.0:
            yield shortening, _twice(tip, where)


def is_idle(path: str, values: Mapping[str, Any]) -> bool:
    """Say whether a key has no effect beside what else is given."""
    if path == "pair.speed_rpm":
        return "pair.power_kW" not in values
    table, _, name = path.rpartition(".")
    return name == "tip_shortening_coeff" and f"{table}.tip_diameter_mm" in values


def _twice(first: str, where: Callable[[str], str]) -> str:
    return f"repeats or contradicts {first} ({where(first)}): either gives the other. Keep one"


def _impossible(target: str, path: str, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Refuse what makes another key impossible, and a span that counts too many teeth or few."""
    read = _reader(values)
    try:
        value = read(target)
    except KeyError:
        # Something else is missing, or wrong by itself.
        return
    except ValueError:
        yield path, f"got {show(values[path])}: balls so low would lie within the base circle"
        return
    try:
        KEYS[target].read(float(f"{value:.6g}") if isinstance(value, float) else value)
    except ValueError as error:
        yield path, f"got {show(values[path])}, which makes {target} impossible: {error}"
        return
    if path.endswith(".span_mm"):
        counted = read(path.replace("_mm", "_teeth"))
        # One tooth more is one base pitch.
        more = round(2.0 * value * math.tan(read("pair.pressure_angle_deg") * _DEG) / math.pi)
        if more:
            yield (
                path.replace("_mm", "_teeth"),
                f"got {counted}, over which a span of {values[path]:g} mm would be that of a "
                f"profile shift of {value:.3g}. Did the drawing count {counted + more}?",
            )


def _of_gear(gear: str) -> dict[str, Formula]:
    """Formulas of one gear; lengths are all in millimetres."""

    def teeth(read: Read) -> dict[str, Any]:
        return {
            "teeth": read(f"{gear}.teeth"),
            "module": read("pair.module_mm"),
            "helix_angle": read("pair.helix_angle_deg") * _DEG,
        }

    def height(read: Read) -> dict[str, Any]:
        return teeth(read) | {"profile_shift": read(f"{gear}.profile_shift")}

    def thickness(read: Read) -> dict[str, Any]:
        return teeth(read) | {
            "pressure_angle": read("pair.pressure_angle_deg") * _DEG,
            "thickness_allowance": 1e-3 * read(f"{gear}.thickness_allowance_um", 0.0),
        }

    tip, root, span, over = (
        f"{gear}.{key}_mm" for key in ("tip_diameter", "root_diameter", "span", "over_balls")
    )
    return {
        tip: lambda read: addendum_of_tip(read(tip), **height(read)),
        root: lambda read: dedendum_of_root(read(root), **height(read)),
        span: lambda read: profile_shift_of_span(
            read(span), read(f"{gear}.span_teeth"), **thickness(read)
        ),
        over: lambda read: profile_shift_of_balls(
            read(over), read(f"{gear}.ball_mm"), **thickness(read)
        ),
    }


def _in_rad_s(speed: Any) -> Any:
    return [each * _RPM for each in speed] if isinstance(speed, list) else speed * _RPM


_RPMS = "sweep.pinion_speed_rpm"
_FORMULAS: Mapping[str, Formula] = {
    "pair.power_kW": lambda read: 1e3 * read("pair.power_kW") / (read("pair.speed_rpm") * _RPM),
    _RPMS: lambda read: _in_rad_s(read(_RPMS)),
    f"{_RPMS}.from": lambda read: _in_rad_s(read(f"{_RPMS}.from")),
    f"{_RPMS}.to": lambda read: _in_rad_s(read(f"{_RPMS}.to")),
    f"{_RPMS}.points": lambda read: read(f"{_RPMS}.points"),
    **_of_gear("pinion"),
    **_of_gear("wheel"),
}
