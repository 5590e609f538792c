"""Flank modifications of REXS files, both ways.

An amount is material removed [mm], as in the scene [um]; lengths of reliefs are roll lengths. The
database does not say the sign of slopes: they are taken, and written, as positive where material is
added at the tip (profile) or at the non-datum face (helix). The datum face is the gear's -Z end.
"""

import math
from collections.abc import Iterator, Mapping
from decimal import Decimal
from typing import Any, NamedTuple

from jaxgear._geometry._pair import GearPair
from jaxgear._units import mm
from jaxgear.scene._gear_tables import EndReliefKeys, FlankKeys, RootReliefKeys, TipReliefKeys
from jaxgear.scene._rexs_file import Component, RexsModel, plain_number

# Single amounts: the scene's key, the component, its attributes that all hold the amount.
_AMOUNTS = (
    (
        "crowning_um",
        "helix_crowning",
        ("helix_crowning_amount_datum_face", "helix_crowning_amount_non_datum_face"),
    ),
    (
        "profile_crowning_um",
        "profile_crowning",
        ("profile_crowning_at_tip", "profile_crowning_at_root"),
    ),
    ("helix_slope_um", "helix_slope", ("helix_slope",)),
    ("profile_slope_um", "profile_slope", ("profile_slope",)),
)
# Crownings have a shape too.
_SHAPE = {
    "helix_crowning": "shape_of_helix_crowning",
    "profile_crowning": "shape_of_profile_crowning",
}
# Components of ends of the face: the scene's side, what their attributes end in.
_ENDS = {"left": "datum_face", "right": "non_datum_face"}
_KINDS = (
    *("tip_relief", "root_relief", *(kind for _, kind, _ in _AMOUNTS)),
    *(f"end_relief_{end}" for end in _ENDS.values()),
)


class Path(NamedTuple):
    """What turns lengths on a flank into the scene's fractions.

    **Fields:**

    - `length`: path of contact [mm].
    - `base`: base radius [mm].
    - `tip`: roll length at the tip [mm].
    - `face`: face width [mm].
    """

    length: float
    base: float
    tip: float
    face: float


def paths_of(pair: GearPair) -> tuple[Path, Path]:
    """Lengths on the flanks of a pair, pinion first."""
    of = lambda name, index: float(getattr(pair, name)[index]) / mm
    length = float(pair.path_of_contact) / mm
    faces = [float(gear.face_width) / mm for gear in (pair.pinion, pair.wheel)]
    first, second = (
        Path(length, of("base_radius", index), of("tip_roll", index), faces[index])
        for index in (0, 1)
    )
    return first, second


def modifications(model: RexsModel, flank: str) -> dict[str, Component]:
    """Modifications of a flank that a scene can carry, by kind."""
    return {
        each: found[0]
        for each in _KINDS
        if (found := model.related("reference", "referenced", each, origin=flank))
    }


def flank_keys(found: Mapping[str, Component], path: Path, remarks: list[str]) -> Mapping[str, Any]:
    """Keys of a flank in the scene from its modifications.

    **Arguments:**

    - `found`: modifications by kind.
    - `path`: of the gear.
    - `remarks`: what was assumed is added here.
    """
    keys: dict[str, Any] = {}
    for key, kind, attributes in _AMOUNTS:
        if kind in found:
            keys[key] = _amount(found[kind], attributes, remarks)
            if key.endswith("slope_um"):
                remarks.append(f"{kind}: its sign is taken as positive where material is added.")
    for which in ("tip", "root"):
        if relief := found.get(f"{which}_relief"):
            keys[f"{which}_relief"] = _relief(
                relief,
                f"{which}_relief_depth",
                _length(relief, which, path, remarks),
                path.length,
                remarks,
            )
    ends = {
        side: _relief(
            found[kind],
            f"end_relief_depth_{end}",
            found[kind].decimal(f"end_relief_length_{end}"),
            path.face,
            remarks,
        )
        for side, end in _ENDS.items()
        if (kind := f"end_relief_{end}") in found
    }
    if ends:
        deepest = max(ends, key=lambda side: ends[side]["depth_um"])
        same = len(ends) == 2 and ends["left"] == ends["right"]
        keys["end_relief"] = {"side": "both" if same else deepest, **ends[deepest]}
        if len(ends) == 2 and not same:
            remarks.append(f"The ends are relieved unequally: the deeper, {deepest}, is taken.")
    return keys


def _amount(found: Component, attributes: tuple[str, ...], remarks: list[str]) -> float:
    amounts = [found.number(each, 3) or 0.0 for each in attributes]
    if len(set(amounts)) > 1:
        told = " and ".join(f"{each:g}" for each in amounts)
        remarks.append(f"{found.kind}: {told} um are taken as their mean at both ends.")
    return amounts[0] if len(set(amounts)) == 1 else sum(amounts) / len(amounts)


def _length(relief: Component, which: str, path: Path, remarks: list[str]) -> Decimal | None:
    """Roll length of a relief, from where it begins to the end of the path [mm]."""
    diameter = relief.number(f"{which}_relief_datum_diameter")
    length = relief.decimal(f"{which}_relief_datum_length")
    if length is not None or diameter is None:
        return length
    remarks.append(f"{relief.kind}: it reaches to the end of the path of contact.")
    roll = math.sqrt(max(0.25 * diameter**2 - path.base**2, 0.0))
    start = path.tip - path.length
    return Decimal(path.tip - roll if which == "tip" else roll - start)


def _relief(
    relief: Component, depth: str, length: Decimal | None, whole: float, remarks: list[str]
) -> Mapping[str, Any]:
    """Keys of a relief in the scene."""
    keys: dict[str, Any] = {"depth_um": relief.number(depth, 3) or 0.0}
    if length is None or length <= 0:
        remarks.append(f"{relief.kind}: no length is given, the scene's default is taken.")
    else:
        # As decimals, a fraction comes back to the last digit.
        keys["extent"] = min(float(length / Decimal(whole)), 1.0)
        if length > whole * (1.0 + 1e-9):
            remarks.append(f"{relief.kind}: {length:g} mm are cut to the {whole:.4g} mm there are.")
    shape = relief.attributes.get("shape_of_relief", ("linear", ""))[0] or "linear"
    keys["shape"] = "linear" if shape == "linear" else "parabolic"
    if shape not in ("linear", "parabolic"):
        remarks.append(f"{relief.kind}: its shape, {shape}, is taken as parabolic.")
    return keys


def flank_components(flank: FlankKeys, path: Path) -> Iterator[Component]:
    """Modifications of a flank of a scene as components.

    Amounts of zero are left out, and reliefs of no depth that the scene says nothing of.

    **Arguments:**

    - `flank`: keys of the flank.
    - `path`: of the gear.
    """
    for key, kind, attributes in _AMOUNTS:
        if amount := getattr(flank, key):
            texts = {each: (plain_number(amount, -3), "mm") for each in attributes}
            if kind in _SHAPE:
                texts[_SHAPE[kind]] = ("parabolic", "none")
            yield Component(kind, key, texts)
    for which in ("tip", "root"):
        kind = f"{which}_relief"
        if (relief := getattr(flank, kind)).depth_um or relief.is_given:
            names = (f"{kind}_depth", f"{kind}_datum_length")
            texts = _relief_texts(relief, names, path.length)
            if which == "root":
                start = 2.0 * math.hypot(path.tip - path.length, path.base)
                texts["root_relief_evaluation_reference"] = (plain_number(start), "mm")
            yield Component(kind, kind, texts)
    end = flank.end_relief
    for side, name in _ENDS.items():
        if (end.depth_um or end.is_given) and end.side in (side, "both"):
            names = (f"end_relief_depth_{name}", f"end_relief_length_{name}")
            yield Component(
                f"end_relief_{name}", "end_relief", _relief_texts(end, names, path.face)
            )


def _relief_texts(
    relief: TipReliefKeys | RootReliefKeys | EndReliefKeys, names: tuple[str, str], whole: float
) -> dict[str, tuple[str, str]]:
    depth, length = names
    return {
        depth: (plain_number(relief.depth_um, -3), "mm"),
        length: (str(Decimal(repr(relief.extent)) * Decimal(whole)), "mm"),
        "shape_of_relief": (relief.shape, "none"),
    }
