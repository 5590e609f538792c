"""Scenes whose coast flanks carry: what can't be, and results of the mirror image turned back.

Such a pair is computed as its mirror image in the plane of the axes, whose drive flanks are the
pair's coast flanks. T, and what turns about S or Z, has the other sign there (theory 1.16).
"""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from jaxgear.scene._gear_tables import FlanksKeys, GearKeys, PairKeys
from jaxgear.scene._schema import GEARS
from jaxgear.scene._study_tables import OptimiseKeys
from jaxgear.study._result import Result, Summary

# Vectors over S, T, Z: those along which something moves or pulls, and those about which it turns.
_POLAR = ("displacement_um", "body_force_N", "bearing_displacement_um", "bearing_load_N")
_POLAR += ("load_force_N",)
_AXIAL = ("rotation_urad", "body_moment_Nm", "load_moment_Nm")
_SIGNS = {"polar": {"T": -1.0}, "axial": {"S": -1.0, "Z": -1.0}}
# What has one component only, that changes its sign.
_TURNED = ("deflection_T_um", "bearing_load_T_N", "T_mm", "along_T", "helix_angle_deg")
_TURNED += ("torque_Nm", "torque_pinion_Nm")
# Arrows that stand for a sense of rotation.
_TURNS = ("rotation", "torque")


def on_coast(pair: PairKeys, *, why: str) -> Iterator[tuple[str, str]]:
    """A negative torque, if it is, as the mistake of a scene whose drive flanks must carry."""
    if pair.sense < 0:
        yield (
            "pair.torque_pinion_Nm",
            f"got {pair.torque_pinion_Nm:g}: {why}. Give a torque > 0",
        )


def no_mirror_image(
    pair: PairKeys,
    gears: Mapping[str, GearKeys],
    flank: FlanksKeys,
    asked: OptimiseKeys,
    *,
    periods: int,
    what: str,
) -> Iterator[tuple[str, str]]:
    """Keys for which a pair whose coast flanks carry has no mirror image, and why.

    The cycle has so many mesh `periods`; `what` is the study.
    """
    torque = f"pair.torque_pinion_Nm is {pair.torque_pinion_Nm:g}"
    condensed = [gear for gear, keys in gears.items() if keys.body.kind == "condensed"]
    for gear in condensed if what != "condense" else ():
        yield (
            f"{gear}.body.kind",
            f'got "condensed", but {torque}: its grid, seats and probes have no mirror image. '
            'Write "rigid" or "beam", or give a torque > 0',
        )
    for gear in GEARS:
        drive, coast = f"flank.{gear}", f"flank.{gear}_coast"
        if flank.coast(gear).is_given:
            if what == "relief_map":
                yield coast, f"is what carries ({torque}), but the map varies [{drive}]. Keep one"
            vary = asked.vary if asked.is_given else ()
            if idle := [key for key in vary if key.startswith(f"{drive}.")]:
                yield (
                    "optimise.vary",
                    f"names {' and '.join(idle)}, but [{coast}] is what carries ({torque}). Vary "
                    f"{coast}.{idle[0].removeprefix(drive + '.')}, say",
                )
            continue
        of_teeth = ["pitch_error_um", "eccentricity_um"]
        of_teeth += ["accuracy_grade"] if periods > 1 else []
        for key in flank.gear(gear).written(*of_teeth):
            yield (
                f"{drive}.{key}",
                f"is of the drive flanks, and {torque}. Give what the coast flanks have, tooth by "
                f"tooth as they come into mesh, in [{coast}]",
            )


def as_coast(result: Result) -> Result:
    """The result of a mirrored pair as that of the pair itself."""
    datasets = {name: _dataset(each) for name, each in result.datasets.items()}
    summary = dict(result.summary)
    if "static" in summary:
        mounts = ("bearings", "supports")
        rows = {name: [_row(each) for each in summary["static"].get(name, ())] for name in mounts}
        summary["static"] = {**summary["static"], **{k: v for k, v in rows.items() if v}}
    if "notes" in summary:
        summary["notes"] = [*summary["notes"], *_notes(result.scene.flank)]
    return dataclasses.replace(result, datasets=datasets, summary=summary)


def _notes(flank: FlanksKeys) -> Iterator[str]:
    yield (
        "pair.torque_pinion_Nm is negative: the pinion drives backwards, and coast flanks carry. "
        "Braked while it goes on forwards, the quasi-static cycle is the same one, passed through "
        "the other way round."
    )
    same = [gear for gear in GEARS if not flank.coast(gear).is_given]
    if same:
        names = " and ".join(f"[flank.{gear}_coast]" for gear in same)
        yield f"Without {names} coast flanks have the modifications of the drive flanks."


def _dataset(dataset: xr.Dataset) -> xr.Dataset:
    turned = {
        str(name): _turned(str(name), each, dataset) for name, each in dataset.variables.items()
    }
    coordinates = {name: each for name, each in turned.items() if name in dataset.coords}
    others = {name: each for name, each in turned.items() if name not in coordinates}
    found = dataset.assign(others).assign_coords(coordinates)
    if "torque_pinion_Nm" in found.attrs:
        found.attrs = {**found.attrs, "torque_pinion_Nm": -found.attrs["torque_pinion_Nm"]}
    return found


def _turned(name: str, values: xr.Variable, dataset: xr.Dataset) -> xr.Variable:
    """A variable with the signs that it has of the pair itself."""
    if values.dims == ("arrow",) and name != "arrow":
        return _times(values, _arrow_signs(name, dataset["arrow"].values))
    if "axis" in values.dims and name in (*_POLAR, *_AXIAL):
        signs = _SIGNS["polar" if name in _POLAR else "axial"]
        each = [signs.get(axis, 1.0) for axis in dataset["axis"].values]
        return _times(values, xr.Variable(("axis",), each))
    if name in _TURNED:
        return _times(values, xr.Variable((), -1.0))
    return values


def _arrow_signs(name: str, arrows: np.ndarray) -> xr.Variable:
    """Signs of a place or a direction along an axis; those of rotations are the other ones.

    Tooth traces are shown on the side of +T, which is that of -T in the mirror image: there a
    trace leans the other way along S.
    """
    directed, axis = name.startswith("along_"), name[-1] if name.startswith("along_") else name[0]
    polar, axial = (_SIGNS[kind].get(axis, 1.0) for kind in ("polar", "axial"))
    traces = -1.0 if directed and axis == "S" else 1.0
    each = [
        traces
        if arrow.startswith("tooth trace")
        else axial
        if directed and arrow.startswith(_TURNS)
        else polar
        for arrow in arrows
    ]
    return xr.Variable(("arrow",), each)


def _times(values: xr.Variable, sign: xr.Variable) -> xr.Variable:
    found = (values * sign).transpose(*values.dims)
    found.attrs = dict(values.attrs)
    # Minus zero is written as such.
    found.values = found.values + 0.0
    return found


def _row(row: Mapping[str, Any]) -> Summary:
    """Means of a bearing or a support."""
    axial = _SIGNS["axial"]
    kinds: dict[str, dict[str, float]] = dict.fromkeys(
        ("displacement_um", "load_N"), _SIGNS["polar"]
    )
    kinds |= dict.fromkeys(("tilt_urad", "moment_Nm"), axial)
    return {
        name: {axis: signs.get(axis, 1.0) * each + 0.0 for axis, each in value.items()}
        if (signs := kinds.get(name)) is not None
        else value
        for name, value in row.items()
    }
