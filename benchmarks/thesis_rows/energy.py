"""Modes of the power pair in mesh: their energy, and at which speeds the mesh meets them."""

import math
from typing import Any

import numpy as np

from jaxgear._dynamics._modes import Modes, pair_modes

from .finding import Finding
from .motion import moving

_PINION_TEETH = 35
# Modes of the whole that may have a say in the mesh [Hz].
_HIGHEST = 12e3
# About the thesis's 410 rad/s [rad/s].
_WHEEL = 330.0, 450.0
_PARTS = "wheel", "mesh", "bearings", "pinion"
_ALONE = {gear: f"{gear}.body.compare_seats=false" for gear in ("pinion", "wheel")}
_PAIRS = {
    "rigid": ("power",),
    "H1": ("power-h1", _ALONE["wheel"]),
    "webbed pinion": ("power-webbed-pinion", _ALONE["wheel"], _ALONE["pinion"]),
}


def shares(modes: Modes) -> dict[str, Any]:
    """Of strain energy by part, of each mode."""
    parts = {name: np.asarray(modes.share(name)) for name in modes.names}
    found = {gear: parts[f"{gear} shaft"] for gear in ("pinion", "wheel")}
    found["mesh"] = np.asarray(modes.mesh)
    return found | {"bearings": 1.0 - sum(found.values())}


def mesh_energy() -> Finding:
    """Fig. III-23, Tab. IV-1 to IV-3 and IV-8: critical speeds, and the energy of their modes."""
    found = Finding(
        "Modes of the power pair: critical speeds of the mesh, and where their energy is "
        "(Fig. III-23, Tab. IV-1 to IV-3, IV-8)",
        "410, 840, 900 to 1000, 1780 rad/s; at 410 wheel 83, mesh 11, bearings 5, pinion 0 %, with "
        "a webbed pinion 65, 6, 17; webs lower the tooth critical speeds",
        ["pair", "what", "rad/s", *(f"{part} %" for part in _PARTS)],
    )
    centre, wheel = {}, {}
    for label, asked in _PAIRS.items():
        modes = pair_modes(moving(*asked).dynamics)
        speed = 2.0 * math.pi * np.asarray(modes.frequency) / _PINION_TEETH
        energy = shares(modes)
        low = np.asarray(modes.frequency) < _HIGHEST
        row = lambda what, at, label=label, speed=speed, energy=energy: found.rows.append(
            [label, what, float(speed[at]), *(100.0 * float(energy[x][at]) for x in _PARTS)]
        )
        mesh = np.where(low, energy["mesh"], 0.0)
        centre[label] = float(mesh @ speed / mesh.sum())
        found.rows.append([label, "centre of mesh energy", centre[label], *[None] * len(_PARTS)])
        for at in sorted(np.argsort(mesh)[-5:], key=lambda at: speed[at]):
            row("much in the mesh", at)
        near = np.flatnonzero((speed > _WHEEL[0]) & (speed < _WHEEL[1]))
        if near.size:
            at = int(near[np.argmax(mesh[near])])
            row("about 410 rad/s", at)
            wheel[label] = {part: 100.0 * float(energy[part][at]) for part in _PARTS}
            wheel[label]["rad/s"] = float(speed[at])
    own, other = wheel["H1"], wheel["webbed pinion"]
    strong = [row[2] for row in found.rows if row[:2] == ["H1", "much in the mesh"]]
    speeds = 410.0, 840.0, 950.0, 1780.0
    found.holds = {
        "webs lower the centre of mesh energy below that of rigid gears": max(
            centre["H1"], centre["webbed pinion"]
        )
        < centre["rigid"],
        "a mode with much energy in the mesh within 10 % of each of 410, 840, 950, 1780": all(
            min(abs(x / each - 1.0) for x in [*strong, own["rad/s"]]) < 0.1 for each in speeds
        ),
        "about 410 rad/s most energy is in the wheel, least in the pinion": max(
            _PARTS, key=lambda x: own[x]
        )
        == "wheel"
        and min(_PARTS, key=lambda x: own[x]) == "pinion",
        "... within 5 points of 83, 11, 5, 0 %": all(
            abs(own[part] - x) < 5.0 for part, x in zip(_PARTS, (83.0, 11.0, 5.0, 0.0), strict=True)
        ),
        "a webbed pinion takes energy from mesh and wheel to the bearings": other["mesh"]
        < own["mesh"]
        and other["wheel"] < own["wheel"]
        and other["bearings"] > own["bearings"],
    }
    return found
