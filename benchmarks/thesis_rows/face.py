"""Load across the face and bearings, by webs, helix and rotation."""

import math

import numpy as np

from .finding import Finding
from .statics import (
    POWER_WEBS,
    deg,
    helical,
    mm,
    only_pair,
    rigid_body,
    solved,
    web,
)


def junction(measures: dict[str, float]) -> float:
    """Middle of a web where it meets the rim, from mid-face [mm]."""
    lean = math.tan(measures.get("web_angle_deg", 0.0) * deg)
    reach = 0.25 * (measures["rim_inner_mm"] - measures["hub_outer_mm"])
    return measures.get("web_offset_mm", 0.0) + lean * reach


_POWER_WEB = {"hub_outer_mm": 64.0, "rim_inner_mm": 152.0}
_ACCESSORY_WEB = {"hub_outer_mm": 50.0, "rim_inner_mm": 118.0}


def web_junction() -> Finding:
    """Fig. III-17: where the line load is largest."""
    found = Finding(
        "Where the line load is largest across the face (Fig. III-17)",
        "the position of the maximum load is just above the web-rim connection",
        [
            "pair, hand and web",
            "junction mm",
            "rigid at mm",
            "flexible at mm",
            "off a line at mm",
            "rigid N/mm",
            "flexible N/mm",
        ],
    )
    cases: list[tuple[str, str, list[str], dict[str, float]]] = [
        (f"power, {hand}, {label}", "power", settings, _POWER_WEB | measures)
        for hand, settings in (("right", []), ("left", ["pair.helix_angle_deg=-12"]))
        for label, measures in POWER_WEBS.items()
    ]
    cases += [
        (f"accessory, {at:g} mm off", "accessory", [], _ACCESSORY_WEB | {"web_offset_mm": at})
        for at in (0.0, 3.0)
    ]
    highest: dict[str, list[bool]] = {"power": [], "accessory": []}
    bulges: dict[str, list[bool]] = {"power": [], "accessory": []}
    raised = []
    for label, name, settings, measures in cases:
        rigid = solved(name, *settings)
        flexible = solved(f"{name}-h1", *settings, *web(**measures))
        at, near = junction(measures), 0.15 * float(rigid.model.pair.face_width) / mm
        # Thrust and shafts tilt the teeth: a straight line across the face is theirs.
        line = np.polyval(np.polyfit(flexible.heights, flexible.crest, 1), flexible.heights)
        bulge = float(flexible.heights[int(np.argmax(flexible.crest - line))])
        largest = float(rigid.crest.max()), float(flexible.crest.max())
        found.rows.append([label, at, rigid.highest, flexible.highest, bulge, *largest])
        highest[name].append(abs(flexible.highest - at) < near)
        bulges[name].append(abs(bulge - at) < near)
        raised.append(largest[1] > largest[0])
    found.holds = {
        "power: the maximum lies within 0.15 faces of the junction": all(highest["power"]),
        "power: off a straight line the load is largest there": all(bulges["power"]),
        "accessory: the maximum lies there": all(highest["accessory"]),
        "the maximum is higher than with rigid bodies": all(raised),
    }
    return found


def bearing_loads() -> Finding:
    """Tab. III-6 to III-8: bearings of the power pair."""
    found = Finding(
        "Bearing loads of the power pair (Tab. III-7 and III-8)",
        "wheel, H1, S and T: rigid 798 4243, 1611 1931, 1095 656; flexible 756 4210, 1832 2173, "
        "915 446: the bearing close to the web takes more, the end of the shaft less",
        ["model", *(f"B{i} {axis}" for i in (1, 2, 3) for axis in "ST"), "pinion B1", "B2"],
    )
    cases = {
        "rigid bodies": ("power",),
        "H1 rigidified": ("power-h1", rigid_body("wheel")),
        **{
            f"H1, {label}": ("power-h1", *web(**measures)) for label, measures in POWER_WEBS.items()
        },
        "H2 rigidified": ("power-h2", rigid_body("pinion"), rigid_body("wheel")),
        "H2": ("power-h2",),
        "webbed pinion": ("power-webbed-pinion",),
    }
    all_of = {label: solved(*case) for label, case in cases.items()}
    size = {}
    for label, each in all_of.items():
        size[label] = np.linalg.norm(each.bearings, axis=1)
        pinion = size[label][:2]
        found.rows.append([label, *map(float, each.bearings[2:].ravel()), *map(float, pinion)])
    stiff, flexible = size["H1 rigidified"][2:], size["H1, leaning left"][2:]
    sums = [each.bearings[2:].sum(axis=0) for each in all_of.values()]
    whole = sums[0]
    found.holds = {
        "the loads of all models add up to the same": bool(
            np.abs(np.asarray(sums) - whole).max() < 1e-3 * np.linalg.norm(whole)
        ),
        "H2 rigidified: both bearings of the pinion within 5 % of the rigid pair's": bool(
            np.all(np.abs(size["H2 rigidified"][:2] / size["rigid bodies"][:2] - 1.0) < 0.05)
        ),
        "web leaning left: B2 takes more than with a rigid body": flexible[1] > stiff[1],
        "web leaning left: B3, at the end, takes less": flexible[2] < stiff[2],
        "B2 takes more with the web on its side than on the other": flexible[1]
        > size["H1, leaning right"][3],
        "... with straight webs too": size["H1, straight, left"][3]
        > size["H1, straight, right"][3],
    }
    return found


def helix() -> Finding:
    """Fig. IV-1: the load across the face of helical gears on a straight web."""
    found = Finding(
        "Load across the face with growing helix, straight centred web (Fig. IV-1)",
        "the contact is misaligned by the axial thrust, more as the helix grows; one edge is "
        "overloaded and the other unloaded",
        ["base helix deg", "model", "left edge", "right edge", "largest/mean", "centre"],
    )
    overload: dict[str, list[float]] = {"rigid": [], "flexible": []}
    for angle in (0.0, 10.0, 20.0):
        settings = helical(angle)
        pairs = {
            "rigid": solved("accessory", *only_pair(settings)),
            "flexible": solved("accessory-h1", *settings),
        }
        for label, each in pairs.items():
            factor = each.numbers["face_load_factor"]
            found.rows.append([angle, label, *each.edges, factor, each.centre])
            overload[label].append(each.centre)
    moved = np.abs(np.asarray(overload["flexible"]) - np.asarray(overload["rigid"]))
    last = found.rows[-1]
    found.holds = {
        "the web moves the centre of the load more, the larger the helix": bool(
            np.all(np.diff(moved) > 0.0)
        ),
        "at 20 deg one edge carries over 1.3 of the mean, the other under 0.7": max(last[2:4]) > 1.3
        and min(last[2:4]) < 0.7,
        "... and neither does with a rigid wheel": max(found.rows[-2][2:4]) < 1.3,
    }
    return found


def rotation() -> Finding:
    """Fig. III-25, III-26 and IV-34: load by rotation, and what re-centres it."""
    found = Finding(
        "Load across the face with rotation (Fig. III-25, III-26, IV-32, IV-34)",
        "at 3000 rad/s the side away from the web is overloaded; 10 um of linear relief over 0.4 "
        "of the face on that side centre the load again",
        ["web", "speed rad/s", "relief", "left edge", "right edge", "centre", "largest N/mm"],
    )
    ends = {
        "right": "flank.pinion.end_relief.side=right",
        "left": "flank.pinion.end_relief.side=left",
    }
    cases: list[tuple[str, float, str]] = []
    for label in ("leaning left", "leaning right", "straight, centred"):
        cases += [(label, speed, "none") for speed in (0.0, 1100.0, 3000.0)]
    for label in ("leaning left", "leaning right"):
        cases += [(label, 3000.0, "end 5"), (label, 3000.0, "end 10"), (label, 3000.0, "crown 10")]
    all_of = {}
    for label, speed, relief in cases:
        far = "left" if label == "leaning right" else "right"
        settings = [*web(**POWER_WEBS[label]), f"mesh.pinion_speed_rad_s={speed:g}"]
        kind, _, depth = relief.partition(" ")
        if kind == "end":
            settings += [ends[far], f"flank.pinion.end_relief.depth_um={depth}"]
            settings += ["flank.pinion.end_relief.extent=0.4"]
        elif kind == "crown":
            settings.append(f"flank.pinion.crowning_um={depth}")
        each = all_of[label, speed, relief] = solved("power-h1", *settings)
        told = f"{relief} um, {far}" if kind == "end" else relief
        largest = float(each.crest.max())
        found.rows.append([label, speed, told, *each.edges, each.centre, largest])
    still, fast = (all_of["leaning left", speed, "none"] for speed in (0.0, 3000.0))
    mirrored = [all_of["leaning right", speed, "none"].centre for speed in (0.0, 3000.0)]
    level = [all_of["straight, centred", speed, "none"].centre for speed in (0.0, 3000.0)]
    eased = [all_of["leaning left", 3000.0, relief] for relief in ("end 5", "end 10", "crown 10")]
    found.holds = {
        "web leaning left: rotation moves the load to the right, away from the web": fast.centre
        > still.centre + 0.02,
        "web leaning right: to the left": mirrored[1] < mirrored[0] - 0.02,
        "straight centred web: hardly (less than a fifth of that)": abs(level[1] - level[0])
        < 0.2 * (fast.centre - still.centre),
        "the overload grows with the speed": all_of["leaning left", 1100.0, "none"].centre
        < fast.centre,
        "5 or 10 um of end relief bring the centre nearer to mid-face": min(
            abs(x.centre) for x in eased[:2]
        )
        < 0.5 * abs(fast.centre),
        "crowning takes the load off the edges": max(eased[2].edges) < max(fast.edges),
    }
    return found
