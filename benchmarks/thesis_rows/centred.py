"""Displacements of bearings, load across the face and pressure, by body and web: spur gears."""

import numpy as np

from .finding import Finding
from .statics import Solved, rigid_body, solved, web

# Of the accessory pair's bearings [N/m].
_BEARING = 1.04e9
_MODELS = {"initial": "accessory", "H1": "accessory-h1", "H2": "accessory-h2"}


def support() -> Finding:
    """Tab. III-2, III-3 and Fig. III-4: bearings and largest load, rigid and flexible bodies."""
    found = Finding(
        "Bearings' displacements and the largest line load of the accessory pair (Tab. III-2, "
        "III-3, Fig. III-4)",
        "pinion B1 -0.35 -0.70, B2 -0.77 -1.55 um along S and T, wheel B1 0.55 1.11, B2 0.57 1.15; "
        "H1 and H2 within 5 %; with flexible bodies the largest load differs little",
        ["model", *(f"{g} {b} {a}" for g in ("p", "w") for b in (1, 2) for a in "ST"), "N/mm"],
    )
    moved, load = {}, {}
    for label, name in _MODELS.items():
        each = solved(name)
        moved[label] = each.bearings[:4].ravel() / _BEARING * 1e6
        load[label] = float(each.crest.max())
        found.rows.append([label, *map(float, moved[label]), load[label]])
    size = np.abs(moved["initial"]).max()
    found.holds = {
        f"{label}: every displacement within {share} % of the largest of the initial model": bool(
            np.abs(moved[label] - moved["initial"]).max() < 0.01 * share * size
        )
        for label, share in (("H1", 5), ("H2", 5))
    } | {
        f"{label}: the largest line load within 15 % of the rigid pair's": abs(
            load[label] / load["initial"] - 1.0
        )
        < 0.15
        for label in ("H1", "H2")
    }
    return found


_WEBS = {"rigid": [rigid_body("wheel")], "centred": [], "inclined": web(web_angle_deg=10.0)}
# Of the pinion; Li's gear turns as fast [rad/s].
_SPEEDS = 0.0, 4000.0


def inclined() -> Finding:
    """Fig. I-31 and I-32: pressure by the web's inclination, at rest and turning."""
    found = Finding(
        "Load across the face by the inclination of the wheel's web, spur gears (Fig. I-31, I-32)",
        "a straight centred web centres the load, an inclined one overloads an edge; rotation "
        "changes it by the web's flexibility",
        ["web", "rad/s", "centre", "left edge", "right edge", "largest N/mm"],
    )
    each: dict[tuple[str, float], Solved] = {}
    for label, settings in _WEBS.items():
        for speed in _SPEEDS:
            own = solved("accessory-h1", *settings, f"mesh.pinion_speed_rad_s={speed:g}")
            each[label, speed] = own
            found.rows.append([label, speed, own.centre, *own.edges, float(own.crest.max())])
    near = "a centred web leaves the load's centre within 2 % of half the face of a rigid wheel's"
    still = {label: each[label, 0.0].centre for label in _WEBS}
    turned = {label: abs(each[label, _SPEEDS[1]].centre - still[label]) for label in _WEBS}
    found.holds = {
        near: abs(still["centred"] - still["rigid"]) < 0.02,
        "an inclined web moves it by more than 5 %": abs(still["inclined"] - still["rigid"]) > 0.05,
        "... and an edge then carries over a tenth more than the mean": max(
            each["inclined", 0.0].edges
        )
        > 1.1,
        "rotation moves the load of the inclined web most": turned["inclined"]
        > max(turned["centred"], turned["rigid"]),
    }
    return found
