"""The power pair with a webbed pinion in motion: over speed, and with crowning at 3000 rad/s."""

import functools

import numpy as np
from scipy.signal import find_peaks

from jaxgear.scene._build import model_of

from .finding import Finding
from .leads import SPEED, WEBS
from .motion import SPEEDS, Curve, moving, set_going, sweep
from .statics import web

_ALONE = [f"{gear}.body.compare_seats=false" for gear in ("pinion", "wheel")]
# Of the pinion [um].
_DEPTHS = 0.0, 5.0, 10.0, 15.0, 20.0
# A peak rises by so much over the valleys beside it; two are the same so close together.
_RISE, _SAME = 0.01, 0.05
_HIGH = 2000.0


def _sweep(name: str, *settings: str, speeds: np.ndarray = SPEEDS) -> Curve:
    gears = _ALONE if name in ("power-h2", "power-webbed-pinion") else _ALONE[1:]
    return sweep(moving(name, *gears, *settings).system, speeds)[0]


def _peaks(curve: Curve) -> list[float]:
    """Speeds of its peaks, the highest first [rad/s]."""
    ratio = np.nan_to_num(curve.ratio, nan=1.0)
    tops, _ = find_peaks(ratio, prominence=_RISE)
    return [float(curve.speed[i]) for i in sorted(tops, key=lambda i: -ratio[i])]


def solid_and_webbed() -> Finding:
    """Fig. IV-38: the dynamic ratio over speed with a solid and a webbed pinion."""
    found = Finding(
        "Dynamic ratio with a solid and with a webbed pinion (Fig. IV-38)",
        "most major peaks are conserved with a slight shift; at high speed the ratio is higher "
        "with the webbed pinion",
        ["pinion", "highest peaks rad/s", "their ratios", "mean above 2000 rad/s"],
    )
    curves = {
        "rigid": _sweep("power-h1"),
        "solid": _sweep("power-h2"),
        "webbed": _sweep("power-webbed-pinion"),
    }
    high, peaks = {}, {}
    for label, curve in curves.items():
        peaks[label] = _peaks(curve)[:5]
        high[label] = float(np.nanmean(curve.ratio[curve.speed > _HIGH]))
        ratios = [float(curve.ratio[np.searchsorted(curve.speed, x)]) for x in peaks[label]]
        told = ", ".join(f"{x:.0f}" for x in peaks[label]), ", ".join(f"{x:.3f}" for x in ratios)
        found.rows.append([label, *told, high[label]])
    again = [
        x for x in peaks["rigid"] if min(abs(y / x - 1.0) for y in _peaks(curves["webbed"])) < _SAME
    ]
    found.rows.append(["rigid's found again", ", ".join(f"{x:.0f}" for x in again), "-", None])
    found.holds = {
        "three of the five highest peaks of the rigid pinion are there again within 5 %": len(again)
        >= 3,
        "above 2000 rad/s the ratio is higher with the webbed than with the rigid pinion": high[
            "webbed"
        ]
        > high["rigid"],
    }
    return found


@functools.cache
def _crowned(label: str) -> np.ndarray:
    """Dynamic ratios at 3000 rad/s by depth of crowning."""
    plain = moving("power-webbed-pinion", *_ALONE, *web(web_thickness_mm=WEBS[label])).scene

    def ratio(depth: float) -> float:
        scene = plain.replace({"flank.pinion.crowning_um": depth})
        system = set_going(scene, model_of(scene)).system
        return float(sweep(system, np.asarray([SPEED]))[0].ratio[0])

    return np.asarray([ratio(depth) for depth in _DEPTHS])


def crowned() -> Finding:
    """Fig. IV-48: the dynamic ratio at 3000 rad/s over the crowning of the pinion, web O."""
    found = Finding(
        "Dynamic ratio at 3000 rad/s with crowning of the webbed pinion, web O (Fig. IV-48)",
        "the larger the crowning, the higher the oscillation of the mesh force",
        ["web", *(f"{depth:g} um" for depth in _DEPTHS)],
    )
    ratio = _crowned("O")
    found.rows.append(["O", *map(float, ratio)])
    found.holds = {
        "from 10 um on the oscillation grows with the crowning": bool(
            np.all(np.diff(ratio[2:]) > 0.0)
        ),
        "at any depth": bool(np.all(np.diff(ratio) > 0.0)),
        "20 um has more than none": bool(ratio[-1] > ratio[0]),
    }
    return found


def rim_modes_kept() -> Finding:
    """Fig. III-13: modes kept beside all nodes of the rim of the accessory wheel."""
    found = Finding(
        "Modes kept beside all nodes of the rim, accessory wheel of 3 mm (Fig. III-13)",
        "most of the response curve is obtained with 10 of 100 modes",
        ["modes", "mean apart", "median", "largest", "within 5 %, % of speeds", "peak rad/s"],
    )
    curves = {
        count: _sweep("accessory-h1", f"wheel.body.modes={count}", speeds=SPEEDS)
        for count in (100, 50, 10)
    }
    best, mean, close = curves[100], {}, {}
    for count, curve in curves.items():
        apart = np.abs(curve.ratio / best.ratio - 1.0)
        mean[count], close[count] = float(np.nanmean(apart)), float(np.nanmean(apart < 0.05))
        median, most = float(np.nanmedian(apart)), float(np.nanmax(apart))
        found.rows.append([str(count), mean[count], median, most, 100.0 * close[count], curve.main])
    found.holds = {
        "50 modes: within 3 % in the mean over speed": mean[50] < 0.03,
        "10 modes: within 5 % in the mean over speed": mean[10] < 0.05,
        "10 modes: the highest peak within 2 % of its speed": abs(curves[10].main / best.main - 1.0)
        < 0.02,
    }
    return found
