"""Waves of turning wheels at critical speeds, and all that is asked of one wheel."""

import functools
import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np

from jaxgear import ExactContact, Orbit
from jaxgear._dynamics._campbell import (
    CriticalSpeed,
    critical_crossings,
    modes_alone,
    turning_modes,
)
from jaxgear._response._body_motion import BodyMotion, start_angle
from jaxgear._response._dynamic import forces_in_motion
from jaxgear._response._spectrum import Spectrum
from jaxgear._response._waves import Circle, joined_circles, joined_waves, waves_on_body
from jaxgear._response._whole_motion import WholeBody, whole_modes
from jaxgear.study._moving_body import MovingBody, moving_bodies, whole_body
from jaxgear.study._probes import Probe, probe_at

from .motion import (
    FAST,
    Curve,
    Moving,
    at_speeds,
    fine,
    line_loads,
    moving,
    sweep,
    vertex,
    without_growth,
)
from .statics import POWER_WEBS, web

# Of the strain energy of a mode: with less in the mesh it is not excited.
LEAST = 1e-4


# --- Waves at critical speeds


class Wave(NamedTuple):
    """What a wheel does where a harmonic of the mesh meets a wave of it.

    `diameters` with sign, forward positive; `predicted` and `found` speeds of the pinion [rad/s],
    NaN without a peak; `frequency` on the body [Hz]; `mesh` share of the mesh in the strain energy;
    `gauge` amplitude at Z less `diameters` over that at Z, of a node of the rim; `share` of the
    wave in its order, all around; `probe` strongest order of a probe that stands still, over Z.
    """

    diameters: int
    predicted: float
    found: float
    frequency: float
    mesh: float
    gauge: float
    share: float
    sense: int
    probe: float
    size: float


def crossings(each: Moving, highest: float = 3000.0, count: int = 80) -> list[CriticalSpeed]:
    """Where the first harmonic of the mesh meets waves of the wheel of two diameters or more."""
    speeds = np.linspace(0.0, 1.05 * highest, 32)
    turning = turning_modes(each.dynamics, each.modes, speeds, each.sectors).first(count)
    return [
        row
        for row in critical_crossings(turning, (1,))
        if row.gear == 1 and row.diameters >= 2 and 150.0 < row.speed < highest
    ]


def chosen(found: list[CriticalSpeed]) -> list[CriticalSpeed]:
    """Of two, three and four diameters, both ways, the lowest crossing that the mesh feels."""
    rows = []
    for n in (2, 3, 4):
        for way in (-1, 1):
            own = [row for row in found if row.diameters == n and row.direction == way]
            rows += [row for row in own if row.mesh > LEAST][:1]
    return rows


class Rim(NamedTuple):
    """What is looked at on a wheel's rim: circles, gauges and probes at its ends."""

    body: MovingBody
    whole: WholeBody
    circle: Circle
    gauges: list
    probes: list
    angle: float


def rim_of(each: Moving) -> Rim:
    """The rim of a scene's wheel."""
    whole = moving_bodies(each.scene.bodies, each.scene.gears)["wheel"]
    circles = whole.rim_circles()
    most = min(int(circle.number.max()) for circle in circles)
    heights = whole.built.body.rim_nodes[:, 2]
    seen = lambda turns: [
        probe_at(whole, (whole.radius, 0.0, float(z)), way, turns=turns, name="")
        for z in (heights.min(), heights.max())
        for way in (0, 2)
    ]
    circle = joined_circles(circles, min(most, 12))
    modes = whole_body(each.scene, whole)
    return Rim(whole, modes, circle, seen(True), seen(False), start_angle(each.model.pair, 1))


def motion_of(each: Moving, rim: Rim, orbit: Orbit) -> BodyMotion:
    """What seats and natural modes of the wheel do in a response, by five mesh orders."""
    force = forces_in_motion(each.dynamics, orbit, ExactContact())
    return whole_modes(rim.whole, each.dynamics, orbit, 1, force, 5, angle=rim.angle).motion


def by_modes(body: MovingBody, probe: Probe, motion: BodyMotion) -> Spectrum:
    """What a probe shows of a motion of seats and natural modes."""
    return probe.spectrum(motion, probe.looking_at(probe.coordinates @ body.motions))


def at_crossing(
    each: Moving,
    rim: Rim,
    row: CriticalSpeed,
    responses: Callable[[np.ndarray], Orbit],
    count: int = 13,
) -> Wave:
    """Scan the speeds about a crossing."""
    lobes, teeth = row.direction * row.diameters, each.model.pair.wheel.teeth
    speeds = row.speed * np.linspace(0.94, 1.06, count)
    orbits = responses(speeds)
    motions = []
    for i in range(len(speeds)):
        orbit = jax.tree.map(lambda x, i=i: x[i], orbits)
        motions.append(motion_of(each, rim, orbit))
    sizes = []
    for motion in motions:
        waves = joined_waves(waves_on_body(motion, rim.circle))
        at = np.flatnonzero((waves.order == teeth - lobes) & (waves.diameters == lobes))
        sizes.append(float(np.linalg.norm(waves.size[at])))
    sizes = np.where(np.asarray(orbits.settled), sizes, 0.0)
    # Its own peak: the other wave of the pair, which the mesh mixes with it, may be larger nearby.
    tops = 1 + np.flatnonzero((sizes[1:-1] > sizes[:-2]) & (sizes[1:-1] > sizes[2:]))
    middle = len(speeds) // 2
    inside = tops.size > 0
    top = int(tops[np.argmin(np.abs(tops - middle))]) if inside else middle
    motion = motions[top]
    spectra = [by_modes(rim.body, gauge, motion) for gauge in rim.gauges]
    best = max(spectra, key=lambda x: float(np.abs(x.near(teeth - lobes))))
    by_order = float(np.abs(best.near(teeth - lobes)) / np.abs(best.near(teeth)))
    strongest, share = joined_waves(waves_on_body(motion, rim.circle)).strongest(teeth - lobes)
    fixed = [by_modes(rim.body, probe, motion) for probe in rim.probes]
    still = max(fixed, key=lambda x: float(np.abs(x.near(teeth))))
    return Wave(
        diameters=lobes,
        predicted=row.speed,
        found=vertex(speeds, sizes, top) if inside else math.nan,
        frequency=row.body,
        mesh=row.mesh,
        gauge=by_order,
        share=share,
        sense=int(np.sign(strongest)),
        probe=still.strongest(0.5 * teeth, 1.5 * teeth) / teeth,
        size=float(sizes[top]),
    )


# --- What is asked of each wheel


class Record(NamedTuple):
    """What one wheel shows.

    `curve` its sweep; `spinning` and `still` ratios at `FAST` with and without centrifugal load,
    `lines` and `still_lines` largest line loads over static ones there, for some wheels; `waves` at
    critical speeds; `alone` as of `moved`.
    """

    curve: Curve
    spinning: np.ndarray
    still: np.ndarray
    lines: np.ndarray | None
    still_lines: np.ndarray | None
    waves: list[Wave]
    alone: dict[int, tuple[float, float]]


WHEELS: dict[str, tuple[str, list[str]]] = {
    "accessory, 5 mm": ("accessory-h1", web(web_thickness_mm=5.0)),
    "accessory, 3 mm": ("accessory-h1", []),
    "accessory, 2 mm": ("accessory-h1", web(web_thickness_mm=2.0)),
    "accessory, 3 mm off": ("accessory-h1", web(web_offset_mm=3.0)),
    "accessory, H2": ("accessory-h2", []),
    "power, leaning": ("power-h1", []),
    "power, straight": ("power-h1", web(**POWER_WEBS["straight, centred"])),
}


# Of which the line loads are looked at too.
LOADED = ("accessory, 3 mm", "power, leaning")


@functools.cache
def record(label: str) -> Record:
    """All of a wheel."""
    name, settings = WHEELS[label]
    each = moving(name, *settings)
    still, orbits = sweep(without_growth(each.system), FAST)
    lines = [None, None]
    if label in LOADED:
        both = sweep(each.system, FAST)[1], orbits
        lines = [np.asarray(line_loads(each.dynamics, orbits)) for orbits in both]
    curve = fine(each.system)
    rim = rim_of(each)
    responses = lambda speeds: sweep(each.system, speeds)[1]
    return Record(
        curve=curve,
        spinning=at_speeds(curve, FAST),
        still=still.ratio,
        lines=lines[0],
        still_lines=lines[1],
        waves=[at_crossing(each, rim, row, responses) for row in chosen(crossings(each))],
        alone=moved(each),
    )


def moved(each: Moving, highest: float = 12e3) -> dict[int, tuple[float, float]]:
    """By nodal diameter, how far modes of the wheel alone are moved by the mesh, at most.

    **Returns:**

    Relative shift, of the less moved of each pair of modes, and of the more moved one.
    """
    alone = modes_alone(each.dynamics, each.modes, 1)
    meshed = np.asarray(each.modes.frequency)[alone.in_mesh]
    shift = np.abs(meshed / alone.frequency - 1.0)
    kept = (alone.frequency < highest) & (alone.frequency > 0.0) & (alone.likeness > 0.2)
    found = {}
    for n in range(6):
        own = np.flatnonzero(kept & (alone.diameters == n))
        if not own.size:
            continue
        if n == 0:
            found[n] = (float(shift[own].min()), float(shift[own].max()))
            continue
        pairs = [
            (a, b)
            for a, b in itertools.pairwise(own)
            if abs(alone.frequency[b] / alone.frequency[a] - 1.0) < 1e-3
        ]
        if pairs:
            less = max(min(shift[a], shift[b]) for a, b in pairs)
            found[n] = (float(less), float(max(max(shift[a], shift[b]) for a, b in pairs)))
    return found
