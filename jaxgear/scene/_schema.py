"""All keys of the scene file by their paths, and what paths say.

`[i]` counts the rows of a list of tables, and at the end of a path the entries of a list of
numbers, from 0; in the paths of the schema `[]` stands for any.
"""

import difflib
import functools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, get_args

from jaxgear.scene._key import OPTIONAL, Key
from jaxgear.scene._study_tables import DynamicResponse, StaticResponse
from jaxgear.scene._table import keys_of
from jaxgear.scene._tables import PlainTables

GEARS = ("pinion", "wheel")
# Tables that every scene has, and tables that ask for work, which are written out only if given.
ALWAYS = ("", "pair", *GEARS)
ON_REQUEST = (
    "model",
    "damping",
    "sweep",
    "modes",
    "map",
    "optimise",
    "robust",
    "sizing",
    "compare",
)
# Tables whose keys are paths of other keys, quoted or as nested tables.
BY_PATH = (
    "optimise.bounds",
    "optimise.ties",
    "sizing.amounts",
    "robust.scatter",
    "robust.even",
)

# What `compare` compares: of the quasi-static cycle, and in motion.
STATIC_RESPONSES: tuple[str, ...] = get_args(StaticResponse)
DYNAMIC_RESPONSES: tuple[str, ...] = get_args(DynamicResponse)


_PLAIN = tuple(keys_of(PlainTables))
_REAL = {
    f"{key.path}[]" if key.kind == "floats" else key.path: key
    for key in _PLAIN
    if key.differentiable
}

# Paths of the schema: `[]` for any row, and at the end for any entry of a list.
REAL_KEYS: tuple[str, ...] = tuple(_REAL)


def _about_others() -> Iterator[Key]:
    """Keys of the tables of `BY_PATH`: bounds and ties of a search, amounts to try, scatter."""
    numbers: dict[str, Any] = {
        "kind": "floats",
        "default": OPTIONAL,
        "applies_if": None,
        "instead_of": "",
        "differentiable": False,
    }
    for path, key in _REAL.items():
        doc = f"lowest and highest value of {path}"
        yield replace(key, path=f"optimise.bounds.{path}", doc=doc, length=2, **numbers)
    for path in _REAL:
        yield Key(f"optimise.ties.{path}", "text", f"the variable that {path} is equal to")
    for path, key in _REAL.items():
        if path.startswith("flank.") and key.kind == "float":
            yield replace(
                key, path=f"sizing.amounts.{path}", doc=f"values of {path} to try", **numbers
            )
    remedy = "Leave the key out where nothing scatters"
    for table, doc in (
        ("scatter", "standard deviation"),
        ("even", "half width of the even scatter"),
    ):
        for path in _REAL:
            yield Key(
                f"robust.{table}.{path}", "float", f"{doc} of {path}", above=0.0, remedy=remedy
            )


KEYS: Mapping[str, Key] = {key.path: key for key in (*_PLAIN, *_about_others())}


# An index as it is written in a path: one spelling for each number.
_COUNT = r"(?:0|[1-9][0-9]*)"


def general(path: str) -> str:
    """Return the path in the schema: `[]` for every index."""
    return re.sub(rf"\[{_COUNT}\]", "[]", path)


def applies(path: str, values: Mapping[str, Any]) -> bool:
    """Say whether a key counts beside the values of others."""
    condition = KEYS[general(path).removesuffix("[]")].applies_if
    return condition is None or values.get(condition[0]) == condition[1]


# What of a scene condensed bodies are made from or for: these tables, and these keys. The mass of
# the teeth is on the rim, so that all their measures count. Under coupled slices they are its ribs.
_SHAPING_TABLES = ("material", "{gear}.material", "{gear}.body", "{gear}.web")
_SHAPING_KEYS = """
    pair.module_mm pair.pressure_angle_deg pair.helix_angle_deg
    pinion.face_width_mm wheel.face_width_mm
    mesh.slices mesh.periods mesh.tip_contact mesh.tooth mesh.face_coupling mesh.stiffness
    mesh.connection mesh.root_points mesh.root_motion mesh.root_correction
    {gear}.teeth {gear}.profile_shift {gear}.span_mm {gear}.span_teeth
    {gear}.over_balls_mm {gear}.ball_mm
    {gear}.addendum_coeff {gear}.tip_shortening_coeff {gear}.tip_diameter_mm
    {gear}.dedendum_coeff {gear}.root_diameter_mm {gear}.fillet_radius_coeff
    {gear}.bore_mm {gear}.shaft.gear_at_mm {gear}.shaft.torque_at_mm
"""


# Which shapes a condensed body that moves is made to vibrate on.
SHAPES_OF_BODIES = ("model.coordinates", "model.shapes")


def shapes_body(key: str, gear: str) -> bool:
    """Say whether a condensed body would be another one if a key of the scene were."""
    whole = _SHAPING_KEYS.format(gear=gear).split()
    tables = tuple(f"{each.format(gear=gear)}." for each in _SHAPING_TABLES)
    along = key.startswith(f"{gear}.shaft.segments") or (
        key.startswith(tuple(f"{gear}.shaft.{rows}" for rows in ("bearings", "loads", "unbalance")))
        and key.endswith(".at_mm")
    )
    return key in whole or (key.startswith(tables) and not warms_body(key, gear)) or along


_TOOTH_KEYS = (
    "teeth",
    "module_mm",
    "pressure_angle_deg",
    "helix_angle_deg",
    "profile_shift",
    "addendum_coeff",
    "tip_shortening_coeff",
    "dedendum_coeff",
    "fillet_radius_coeff",
    "face_width_mm",
    "bore_mm",
    "poisson",
)


def shapes_teeth(key: str) -> bool:
    """Say whether teeth of finite elements would be others if a key of the scene were.

    **Arguments:**

    - `key`: path of the key.
    """
    table, _, name = key.rpartition(".")
    own = ("pair", "material", *GEARS, *(f"{gear}.material" for gear in GEARS))
    return table in own and name in _TOOTH_KEYS


def warms_body(key: str, gear: str) -> bool:
    """Say whether a condensed body of a gear follows a key of the scene by its temperatures."""
    return key in {
        f"{gear}.body.temperature.{name}" for name in ("hub_K", "rim_K", "expansion_1_K")
    }


def scales_body(key: str, gear: str) -> bool:
    """Say whether a condensed body follows a key of the scene by its scale, and is not remade."""
    table, _, name = key.rpartition(".")
    if name == "young_GPa" and table == f"{gear}.body":
        return True
    return table in ("material", f"{gear}.material") and name in ("young_GPa", "density_kg_m3")


def is_unbalance(key: str) -> bool:
    """Say whether a key is of an unbalance, which acts in `jaxgear sweep` alone."""
    return ".shaft.unbalance[" in key


def of_condensed(key: str, gear: str) -> bool:
    """Say whether a key of a gear's body acts only on one that is condensed."""
    tables = f"{gear}.body.web.", f"{gear}.body.temperature."
    return key == f"{gear}.body.young_GPa" or key.startswith(tables)


def split_entry(path: str) -> tuple[str, int | None]:
    """Split off the index at the end of the path of a row or an entry; `None` where is none.

    In `[optimise.bounds]` an index belongs to the name of the key.
    """
    found = re.fullmatch(rf"(.+)\[({_COUNT})\]", path)
    if not found or path.startswith(BY_PATH):
        return path, None
    return found[1], int(found[2])


def unit_of(path: str) -> str:
    """Return the unit of a number, or of an entry of a list; empty for a plain or unknown one."""
    key = key_at(path)
    return key.unit if key else ""


def key_at(path: str) -> Key | None:
    """Return the key of a path, which may be of an entry of a list; `None` of an unknown one."""
    known = general(path)
    return KEYS.get(known) or KEYS.get(known.removesuffix("[]"))


def parents(path: str) -> list[str]:
    """Return the tables above a key, outermost first: `a.b.c` has `a` and `a.b`."""
    parts = path.split(".")
    return [".".join(parts[:end]) for end in range(1, len(parts))]


TABLES: frozenset[str] = frozenset(table for path in KEYS for table in parents(path))


# Names less alike than this are not meant; paths, as a whole.
_ALIKE, _ALIKE_AS_A_WHOLE = 0.6, 0.85


def _ratio(first: str, second: str, least: float) -> float:
    """Likeness of two texts, 0 to 1; 0 where bounds that are quick to find are below the least."""
    if 2.0 * min(len(first), len(second)) < least * (len(first) + len(second)):
        return 0.0
    matched = difflib.SequenceMatcher(None, first, second)
    return matched.ratio() if matched.quick_ratio() >= least else 0.0


# Many tables have a key of the same name.
@functools.lru_cache(maxsize=1024)
def _likeness(tail: str, known: str) -> float:
    """Likeness of two names, 0 to 1; `tork` is compared with `torque` and `torque_pinion_Nm`."""
    words = known.split("_")
    heads = ["_".join(words[:end]) for end in range(1, len(words) + 1)]
    return max(_ratio(tail, head, _ALIKE) for head in heads)


def nearest(path: str, known: Iterable[str]) -> str | None:
    """Return the known path that `path` was most likely meant to be, or `None`.

    A name like it in the same table comes first, then one like it in another table, then a path
    like it as a whole.
    """
    table, _, tail = path.rpartition(".")
    best: tuple[float, float, str] | None = None
    for candidate in known:
        home, _, name = candidate.rpartition(".")
        alike = _likeness(tail, name)
        whole = _ratio(path, candidate, 0.0 if alike >= _ALIKE else _ALIKE_AS_A_WHOLE)
        if home == table and alike >= _ALIKE:
            # Slips of the pen come after the first letter.
            score = 2.0 + alike + 0.1 * (tail[:1] == name[:1])
        elif alike >= 0.8:
            score = 1.0 + alike
        elif whole >= _ALIKE_AS_A_WHOLE:
            score = whole
        else:
            continue
        best = max(best, (score, whole, candidate)) if best else (score, whole, candidate)
    return best[2] if best else None
