"""The industrial pair, 28 and 127 teeth: face loads, bearings and waves about 8820 rpm."""

import math

import numpy as np

from .finding import Finding
from .motion import Moving, moving, sweep
from .statics import solved
from .travelling import at_crossing, crossings, rim_of

_RATIO = 127.0 / 28.0
# Of the pinion where the wheel has its 8820 rpm [rad/s].
_SPEED = 8820.0 * math.pi / 30.0 * _RATIO
# The same body without what the next stage does to it.
_NO_WRENCH = "wheel.shaft.loads=[{at_mm=105.0}]"
# The thesis's web has holes, of a number and size that are guesses: those of the scene's comments.
# With them the mesh repeats after a revolution.
_HOLES = (
    "wheel.body.web.holes=12",
    "wheel.body.web.hole_diameter_mm=20",
    "wheel.body.web.hole_circle_mm=115",
    "wheel.body.fineness={sectors=96, rim_across=2}",
    "mesh.periods=127",
)
# Tab. III-12: speed of the wheel where a wave resonates [rpm].
_MEASURED = {8: 8650.0, -9: 8930.0, -10: 10190.0, 9: 10273.0}


def face() -> Finding:
    """Fig. III-32, III-33 and Tab. III-10: ends of the face and bearings, by growth and wrench."""
    found = Finding(
        "Load across the face and wheel's bearings of the industrial pair (Fig. III-32, III-33)",
        "with the centrifugal load of 8820 rpm one side is overloaded, the other almost free; "
        "bearings as by full finite elements with the wrench of the next stage",
        ["case", "left over mean", "right over mean", "B1 S, N", "B1 T", "B2 S", "B2 T"],
    )
    turning = f"mesh.pinion_speed_rad_s={_SPEED:.6g}"
    cases = {
        "at rest": (),
        "8820 rpm": (turning,),
        "at rest, no wrench": (_NO_WRENCH,),
        "at rest, holes": _HOLES,
        "8820 rpm, holes": (*_HOLES, turning),
    }
    edges, bearings = {}, {}
    for label, settings in cases.items():
        each = solved("industrial", *settings)
        edges[label] = each.edges
        # The pinion has three, the wheel's third takes thrust alone.
        bearings[label] = each.bearings[3:5]
        found.rows.append([label, *each.edges, *map(float, each.bearings[3:5].ravel())])
    size = {label: np.linalg.norm(each, axis=1) for label, each in bearings.items()}
    low, high = min(edges["8820 rpm, holes"]), max(edges["8820 rpm, holes"])
    found.holds = {
        "with holes and growth an end carries over 1.5 times the mean": high > 1.5,
        "... and more than any at rest": high > max(edges["at rest, holes"]),
        "the other end carries less than a quarter": low < 0.25,
        "... which it does not without holes": min(edges["8820 rpm"]) > 0.25,
        "the wrench changes the largest bearing load by more than half": abs(
            size["at rest"].max() / size["at rest, no wrench"].max() - 1.0
        )
        > 0.5,
        "rotation changes no bearing by more than 2 % of the largest": float(
            np.abs(bearings["8820 rpm"] - bearings["at rest"]).max() / size["at rest"].max()
        )
        < 0.02,
    }
    return found


def _in_motion() -> Moving:
    # Waves of ten diameters lie among the lowest 160 modes.
    modes = "model.shapes=natural", "model.coordinates=160"
    return moving("industrial", *modes, "wheel.body.compare_seats=false")


def waves() -> Finding:
    """Fig. III-40, III-44 to III-49 and Tab. III-12: waves of eight to ten diameters."""
    found = Finding(
        "Waves of the industrial wheel where the mesh meets them (Tab. III-12)",
        "+8 at 8650, -9 at 8930, -10 at 10190, +9 at 10273 rpm; on the wheel a node answers at "
        "Z - n or Z + n and not at Z",
        [
            "wave",
            "measured rpm",
            "predicted",
            "peak",
            "off %",
            "on body Hz",
            "side/Z",
            "of its wave",
            "probe at/Z",
            "um",
        ],
    )
    each = _in_motion()
    rim = rim_of(each)
    known = crossings(each, 5400.0, 300)
    rpm = 30.0 / math.pi / _RATIO
    responses = lambda speeds: sweep(each.system, speeds)[1]
    seen = {}
    for lobes, measured in _MEASURED.items():
        own = [
            row
            for row in known
            if row.diameters * row.direction == lobes
            and abs(row.speed * rpm / measured - 1.0) < 0.1
        ]
        # Of the first family: that on which the mesh bears most.
        best = max(own, key=lambda row: row.mesh)
        wave = seen[lobes] = at_crossing(each, rim, best, responses)
        right = wave.share if wave.sense == np.sign(lobes) else -wave.share
        off = 100.0 * (wave.found * rpm / measured - 1.0)
        found.rows.append(
            [
                f"{lobes:+d}",
                measured,
                wave.predicted * rpm,
                wave.found * rpm,
                off,
                wave.frequency,
                wave.gauge,
                right,
                wave.probe,
                1e6 * wave.size,
            ]
        )
    speeds = [seen[lobes].found for lobes in _MEASURED]
    found.holds = {
        "peaks of +8, -9, -10 and +9 lie within 3 % of the measured speeds": all(
            abs(row[4]) < 3.0 for row in found.rows
        ),
        "they come in the measured order": bool(np.all(np.diff(speeds) > 0.0)),
        "a node answers at Z - n or Z + n at least ten times as much as at Z": all(
            wave.gauge > 10.0 for wave in seen.values()
        ),
        "most of that order is the wave that runs the right way": all(
            wave.sense == np.sign(lobes) and wave.share > 0.5 for lobes, wave in seen.items()
        ),
    }
    return found
