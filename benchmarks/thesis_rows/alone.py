"""Bodies of the power pair alone, beside the whole pair: families of modes, and what a shaft and
the mesh do to them."""

import functools
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxgear._dynamics._campbell import TurningModes, turning_modes
from jaxgear.scene._scene import READY, Scene, example_scene, read_scene

from .finding import Finding
from .free import health
from .motion import moving

# Nodal diameters looked at, and the modes: the highest of the first harmonic at 3000 rad/s [Hz].
_DIAMETERS = range(6)
_HIGHEST = 3000.0 * 35.0 / (2.0 * np.pi)
# A mode in mesh belongs to a wave with more than this of its kinetic energy in it.
_ITS_OWN = 0.5


@functools.cache
def _meshed(name: str, gears: tuple[str, ...]) -> TurningModes:
    """Modes of a stage at rest, by their leading wave."""
    each = moving(name, *(f"{gear}.body.compare_seats=false" for gear in gears))
    return turning_modes(each.dynamics, each.modes, np.zeros(1), each.sectors)


def _in_stage(turning: TurningModes, gear: int, n: int) -> np.ndarray:
    """Frequencies of a stage's modes of one gear and so many diameters [Hz]."""
    own = (turning.gear[0] == gear) & (turning.diameters[0] == n) & (turning.share[0] > _ITS_OWN)
    return np.asarray(turning.frequency[0][own])


def _own(found: Mapping[str, Any], n: int) -> np.ndarray:
    """Frequencies of a free body's modes of so many diameters, each pair once [Hz]."""
    hertz = np.asarray(found["free_frequency_Hz"], dtype=float)
    of = np.sort(hertz[(np.asarray(found["nodal_diameter"]) == n) & (hertz > 1.0)])
    of = of[of < _HIGHEST]
    return of[np.r_[True, np.diff(of) > 1e-3 * of[1:]]] if of.size else of


def _without_shaft(name: str) -> Scene:
    """A ready scene whose wheel has no shaft."""
    before, _, after = (READY / f"{name}.toml").read_text("utf-8").partition("[wheel.shaft]")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"{name}-bare.toml")
        path.write_text(before + after[after.index("\n[flank.pinion]") :], "utf-8")
        return read_scene(path)


def _between(found: Mapping[str, Any], low: float, high: float) -> int:
    """Number of a free body's modes between two frequencies [Hz]."""
    hertz = np.asarray(found["free_frequency_Hz"])
    return int(np.sum((hertz > low) & (hertz < high)))


def _nearest(alone: float, meshed: np.ndarray) -> float:
    """By how much the nearest mode of the stage lies off [-]; NaN if it has none of the kind."""
    return float(np.min(np.abs(meshed / alone - 1.0))) if meshed.size else float("nan")


def _beside(
    title: str, thesis: str, found: Mapping[str, Any], turning: TurningModes, gear: int
) -> Finding:
    """Modes of a body alone and the nearest of its stage, by nodal diameter."""
    table = Finding(title, thesis, ["n", "alone Hz", "nearest in the stage, off by %", "in stage"])
    for n in _DIAMETERS:
        meshed = _in_stage(turning, gear, n)
        for alone in _own(found, n):
            off = 100.0 * _nearest(alone, meshed)
            table.rows.append([n, float(alone), off, float(meshed.size)])
    return table


def wheel_without_shaft() -> Finding:
    """Fig. III-19: the power wheel alone, without its shaft, beside the stage."""
    found = health(_without_shaft("power-h1"), "wheel")
    table = _beside(
        "The power wheel without its shaft beside the stage, below 16.7 kHz (Fig. III-19)",
        "modes of n diameters of the wheel alone and of the stage correspond well; those of none "
        "and one deviate more; the stage has more modes",
        found,
        _meshed("power-h1", ("wheel",)),
        1,
    )
    off = {n: [row[2] for row in table.rows if row[0] == n] for n in _DIAMETERS}
    few = float(np.nanmean([x for n in (0, 1) for x in off[n]]))
    many = float(np.nanmean([x for n in (2, 3, 4, 5) for x in off[n]]))
    stage = int(np.sum(_meshed("power-h1", ("wheel",)).frequency[0] < _HIGHEST))
    alone = _between(found, 1.0, _HIGHEST)
    table.rows.append(["0, 1", None, few, None])
    table.rows.append(["2 to 5", None, many, None])
    table.rows.append(["all", float(alone), None, float(stage)])
    table.holds = {
        "modes of two diameters and more lie within 5 % of one of the stage, in the mean": many
        < 5.0,
        "those of none and one deviate at least twice as much": few > 2.0 * many,
        "the stage has more modes": stage > alone,
    }
    return table


def pinion_alone() -> Finding:
    """Fig. IV-37: the webbed pinion alone beside the stage."""
    found = health(example_scene("power-webbed-pinion"), "pinion")
    turning = _meshed("power-webbed-pinion", ("pinion", "wheel"))
    table = _beside(
        "The webbed pinion alone, with its shaft, beside the stage (Fig. IV-37)",
        "both sets agree well; the stage has more modes at low frequencies; few of the pinion's "
        "are below the first harmonic at the highest speed",
        found,
        turning,
        0,
    )
    off = [row[2] for row in table.rows if row[0] >= 2]
    alone = _between(found, 1.0, 5000.0)
    stage = int(np.sum(turning.frequency[0] < 5000.0))
    table.rows.append(["all below 5 kHz", float(alone), None, float(stage)])
    below = _between(found, 1.0, _HIGHEST)
    meshed = int(np.sum(turning.frequency[0] < _HIGHEST))
    table.rows.append(["all below 16.7 kHz", float(below), None, float(meshed)])
    table.holds = {
        "modes of two diameters and more lie within 5 % of one of the stage": bool(off)
        and max(off) < 5.0,
        "the stage has more modes below 5 kHz": stage > alone,
    }
    return table


def families() -> Finding:
    """Fig. III-20: modes of the power wheel by nodal diameters and circles."""
    found = health(example_scene("power-h1"), "wheel")
    table = Finding(
        "Families of the power wheel's modes by nodal circles, axial (Fig. III-20)",
        "as those of a disc: in a family the frequency rises with the diameters, and the more "
        "circles, the higher",
        ["circles", *(f"{n}ND Hz" for n in range(2, 8)), "rises"],
    )
    hertz = np.asarray(found["free_frequency_Hz"])
    diameter, circle = (np.asarray(found[key]) for key in ("nodal_diameter", "nodal_circle"))
    kind = np.asarray(found["kind"])
    rows: dict[int, list[float]] = {}
    for each in sorted(set(circle.tolist())):
        chosen = (circle == each) & (kind == "axial") & (hertz > 1.0)
        lowest = [float(hertz[chosen & (diameter == n)].min(initial=np.inf)) for n in range(2, 8)]
        seen = [x for x in lowest if np.isfinite(x)]
        if len(seen) < 2:
            continue
        rows[each] = lowest
        rising = bool(np.all(np.diff(seen) > 0.0))
        told = [x if np.isfinite(x) else None for x in lowest]
        table.rows.append([float(each), *told, "yes" if rising else "no"])
    pairs = list(zip(list(rows.values())[:-1], list(rows.values())[1:], strict=True))
    table.holds = {
        "in every family the frequency rises with the diameters": all(
            row[-1] == "yes" for row in table.rows
        ),
        "with more circles it is higher at the same diameters": bool(pairs)
        and all(
            a < b for low, high in pairs for a, b in zip(low, high, strict=True) if np.isfinite(b)
        ),
    }
    return table
