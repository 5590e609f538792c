"""What turning flexible wheels do in a mesh, beside what Guilbert (2017) found.

    python benchmarks/wheel_trends.py [--only NAME ...] [--out DIR] [--list]

One table for each finding, over a few web geometries: the drawings of the thesis are not in its
text, so that these are trends and not its numbers. Under each table stands which of its statements
hold. Responses are by harmonic balance, those of wheels with holes by marching. Bodies come from
the cache after the first time. Writes `wheel_trends.json`.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

# First: it holds the threads before NumPy is imported.
from hybrid_trends import (
    POWER_WEBS,
    THESIS,
    Finding,
    rigid_body,
    tell,
    web,
    with_rigid_shaft,
)

# isort: split
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxgear as jg
from jaxgear._dynamics._campbell import (
    CriticalSpeed,
    critical_crossings,
    modes_alone,
    turning_modes,
)
from jaxgear._dynamics._harmonic import HarmonicBalance
from jaxgear._dynamics._march import Marching
from jaxgear._dynamics._modes import Modes, modes
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._steady_state import steady_states
from jaxgear._dynamics._steppers import Exponential
from jaxgear._dynamics._system import DynamicSystem, PairDynamics
from jaxgear._response._body_motion import body_motion, start_angle
from jaxgear._response._dynamic import dynamic_response
from jaxgear._response._waves import Circle, joined_circles, joined_waves, waves_on_body
from jaxgear._system._gear_body import RigidBody
from jaxgear._system._model import PairModel
from jaxgear._system._shaft import Shaft, node_heights
from jaxgear.scene._build import model_of
from jaxgear.scene._mesh_bodies import with_bodies
from jaxgear.scene._scene import Scene, ready_scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._dynamics import dynamic_grid_of, dynamics_of
from jaxgear.study._moving_body import MovingBody
from jaxgear.study._probes import probe_at

# Slices, time steps and modes that tell trends.
COARSE = ("mesh.slices=10", "sweep.steps=64", "sweep.pinion_speed_rad_s=[1000.0]")
MODES, HARMONICS = "model.coordinates=60", 14
# What a body that hardly deforms can do without.
QUICK = ("interface=guyan", "modes=0", "compare_seats=false")
# Of the pinion; below the first of them higher harmonics of the mesh meet the modes of the teeth
# [rad/s].
SLOW = 700.0
SPEEDS = np.arange(200.0, 3001.0, 50.0)
# Of the strain energy of a mode: with less in the mesh it is not excited.
LEAST = 1e-4
FAST = np.arange(1500.0, 3001.0, 100.0)


# --- Pairs in motion


class Moving(NamedTuple):
    """A ready scene with changes, in motion."""

    scene: Scene
    model: PairModel
    dynamics: PairDynamics
    modes: Modes

    @property
    def system(self) -> DynamicSystem:
        """What moves."""
        return self.dynamics.system

    @property
    def ratio(self) -> float:
        """Speed of the wheel over the pinion's [-]."""
        pair = self.model.pair
        return pair.pinion.teeth / pair.wheel.teeth

    @property
    def sectors(self) -> tuple[int, int]:
        """Equal sectors of both bodies; 0: rigid."""
        bodies = self.scene.bodies
        each = [
            int(bodies[gear].built.body.facts["sectors"]) if gear in bodies else 0 for gear in GEARS
        ]
        return each[0], each[1]


# One at a time: a body's matrices take up to 300 MB.
@functools.lru_cache(maxsize=1)
def moving(name: str, *settings: str) -> Moving:
    """A ready scene with changes, set in motion."""
    condensed = bool(ready_scene(name).condensed)
    scene = ready_scene(name, [THESIS, *COARSE, *([MODES] if condensed else []), *settings])
    if condensed:
        scene = with_bodies(scene, moving=True)
    return set_going(scene, model_of(scene))


_modes = jax.jit(modes)


def set_going(scene: Scene, model: PairModel) -> Moving:
    """A model of a scene, set in motion."""
    grid = dynamic_grid_of(scene, model)

    dynamics = eqx.filter_jit(lambda model: dynamics_of(scene, model, grid))(model)
    system = dynamics.system
    whole = _modes(system.mass, system.whole_stiffness, system.mesh_stiffness, system.free)
    assert bool(jnp.all(dynamics.cycle.converged)), "the contact was not solved at some phase"
    return Moving(scene, model, dynamics, whole)


def without_growth(system: DynamicSystem) -> DynamicSystem:
    """The same without centrifugal load."""
    table, terms = system.table, system.turning
    assert table.growth is not None
    assert terms is not None
    table = dataclasses.replace(table, growth=0.0 * table.growth)
    terms = dataclasses.replace(terms, load=0.0 * terms.load)
    return dataclasses.replace(system, table=table, turning=terms)


_responses = eqx.filter_jit(steady_states)


@eqx.filter_jit
def _line_loads(dynamics: PairDynamics, orbits: Orbit):
    """Largest line load over the largest at vanishing speed."""
    one = lambda orbit: dynamic_response(dynamics, orbit, 1, jg.ExactContact()).line_load_ratio
    return jax.lax.map(one, orbits)


class Curve(NamedTuple):
    """Dynamic ratio over speed, NaN where no response was found."""

    speed: np.ndarray
    ratio: np.ndarray

    @property
    def main(self) -> float:
        """Speed of the highest peak above `SLOW` [rad/s]."""
        return vertex(self.speed, np.where(self.speed > SLOW, np.nan_to_num(self.ratio), 0.0))


def sweep(system: DynamicSystem, speeds: np.ndarray = SPEEDS) -> tuple[Curve, Orbit]:
    """Responses of harmonic balance, each from the quasi-static state."""
    orbits = _responses(system, jnp.asarray(speeds), HarmonicBalance(harmonics=HARMONICS))
    ratio = np.asarray(orbits.load)[:, :, 0].max(axis=1) / float(system.force)
    return Curve(speeds, np.where(np.asarray(orbits.settled), ratio, np.nan)), orbits


def fine(system: DynamicSystem) -> Curve:
    """The sweep, with more speeds about its highest peak."""
    curve, _ = sweep(system)
    more = np.arange(curve.main - 45.0, curve.main + 46.0, 10.0)
    other, _ = sweep(system, more)
    order = np.argsort(speeds := np.concatenate([curve.speed, more]))
    return Curve(speeds[order], np.concatenate([curve.ratio, other.ratio])[order])


def vertex(speeds: np.ndarray, values: np.ndarray, at: int | None = None) -> float:
    """Where a parabola through a value, by default the largest, and its neighbours has its top."""
    at = int(np.argmax(values)) if at is None else at
    if at in (0, len(values) - 1):
        return float(speeds[at])
    a, b, _ = np.polyfit(speeds[at - 1 : at + 2] - speeds[at], values[at - 1 : at + 2], 2)
    return float(speeds[at] - 0.5 * b / a)


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

    circle: Circle
    gauges: list
    probes: list
    angle: float


def rim_of(each: Moving) -> Rim:
    """The rim of a scene's wheel."""
    gear, body = "wheel", each.scene.bodies["wheel"]
    assert body.basis is not None
    whole = MovingBody(gear, body.built, body.basis, each.model.pair.wheel.teeth)
    circles = whole.rim_circles()
    most = min(int(circle.number.max()) for circle in circles)
    heights = whole.built.body.rim_nodes[:, 2]
    seen = lambda turns: [
        probe_at(whole, (whole.radius, 0.0, float(z)), way, turns=turns, name="")
        for z in (heights.min(), heights.max())
        for way in (0, 2)
    ]
    circle = joined_circles(circles, min(most, 12))
    return Rim(circle, seen(True), seen(False), start_angle(each.model.pair, 1))


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
        motions.append(body_motion(each.dynamics, orbit, 1, 5, angle=rim.angle))
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
    spectra = [gauge.spectrum(motion) for gauge in rim.gauges]
    best = max(spectra, key=lambda x: float(np.abs(x.near(teeth - lobes))))
    by_order = float(np.abs(best.near(teeth - lobes)) / np.abs(best.near(teeth)))
    strongest, share = joined_waves(waves_on_body(motion, rim.circle)).strongest(teeth - lobes)
    fixed = [probe.spectrum(motion) for probe in rim.probes]
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
        lines = [np.asarray(_line_loads(each.dynamics, orbits)) for orbits in both]
    curve = fine(each.system)
    rim = rim_of(each)
    responses = lambda speeds: sweep(each.system, speeds)[1]
    return Record(
        curve=curve,
        spinning=_at(curve, FAST),
        still=still.ratio,
        lines=lines[0],
        still_lines=lines[1],
        waves=[at_crossing(each, rim, row, responses) for row in chosen(crossings(each))],
        alone=moved(each),
    )


@functools.cache
def rigid(name: str) -> Curve:
    """The rigid pair as it is, with foundations."""
    return fine(moving(name).system)


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


# --- Findings


def critical_speeds() -> Finding:
    """Fig. III-12 and III-23: flexible bodies and the main critical speed."""
    found = Finding(
        "Speed of the highest peak above 700 rad/s (Fig. III-12, III-23)",
        "the rigid model leads to higher tooth critical speeds; main peaks are moved to lower "
        "speeds by flexible webs",
        ["wheel", "peak rad/s", "ratio there", "over the rigid pair's", "over rigidified"],
    )
    pace: dict[str, float] = {}
    curves = {name: rigid(name) for name in ("accessory", "power")}
    curves |= {f"{name}, H1 rigidified": stiffened(f"{name} H1")[0] for name in curves}
    for label, curve in (curves | {label: record(label).curve for label in WHEELS}).items():
        pace[label] = curve.main
        name, fast = label.partition(",")[0], curve.speed > SLOW
        peak = float(np.nanmax(curve.ratio[fast]))
        bases = (name, f"{name}, H1 rigidified")
        over = [curve.main / pace[base] if base in pace else None for base in bases]
        found.rows.append([label, curve.main, peak, *over])
    beside = {"rigid pair, a solid disc": "", "rigidified wheel, as heavy": ", H1 rigidified"}
    webs = [pace[x] for t in (5, 3, 2) if (x := f"accessory, {t} mm") in pace]
    found.holds = {
        **{
            f"{name}: every flexible wheel peaks at a lower speed than the {what}": all(
                pace[label] < pace[name + base] for label in WHEELS if label.startswith(name)
            )
            for name in ("accessory", "power")
            for what, base in beside.items()
        },
        "H2 lies lower than H1": pace["accessory, H2"] < pace["accessory, 3 mm"],
    }
    if len(webs) > 1:
        found.holds["the thinner the web, the lower"] = bool(np.all(np.diff(webs) < 0.0))
    return found


def growth() -> Finding:
    """Fig. III-24: the dynamic ratio at high speed, with and without centrifugal load."""
    found = Finding(
        "Mesh force and line load, over the largest static ones, with centrifugal load and without "
        "(Fig. III-24)",
        "at high speeds the tooth dynamic loading increases continuously with centrifugal effects, "
        "and not without",
        [
            "wheel",
            "of",
            "with: to 2000 rad/s",
            "from 2500",
            "without: to 2000",
            "from 2500",
            "more at 1500",
            "at 3000",
        ],
    )
    rises: dict[str, tuple[float, float]] = {}
    for label in WHEELS:
        own = record(label)
        pairs = {"force": (own.spinning, own.still), "line load": (own.lines, own.still_lines)}
        for what, (spinning, still) in pairs.items():
            if spinning is None or still is None:
                continue
            means = [
                float(np.nanmean(values[part]))
                for values in (spinning, still)
                for part in (FAST <= 2000.0, FAST >= 2500.0)
            ]
            more = spinning - still
            rises[f"{label}: {what}"] = means[1] - means[0], means[3] - means[2]
            found.rows.append([label, what, *means, float(more[0]), float(more[-1])])
    for name in ("power", "accessory"):
        for what in ("force", "line load"):
            own = [x for key, x in rises.items() if key.startswith(name) and key.endswith(what)]
            found.holds[f"{name}: the {what} rises from up to 2000 to over 2500 rad/s"] = all(
                with_it > 0.02 for with_it, _ in own
            )
            found.holds[f"{name}: the {what} rises by less than half of it without"] = all(
                with_it > 0.02 and without < 0.5 * with_it for with_it, without in own
            )
    return found


# A peak lies at a critical speed if it is no further off, over it.
_NEAR = 0.015


def waves() -> Finding:
    """Fig. III-44 to III-49 and IV-19: waves at critical speeds."""
    found = Finding(
        "Waves of the wheel where the mesh meets them (Fig. III-44 to III-49, IV-19)",
        "a node of the rim answers at Z - n or Z + n and not at Z; what stands still in space sees "
        "Z; forward waves at Z - n",
        [
            "wheel",
            "wave",
            "on body Hz",
            "predicted rad/s",
            "peak rad/s",
            "off %",
            "side/Z",
            "of its wave",
            "probe at/Z",
            "RMS um",
            "in mesh",
        ],
    )
    every: list[Wave] = []
    for label in WHEELS:
        for row in record(label).waves:
            every.append(row)
            off = 100.0 * (row.found / row.predicted - 1.0)
            right = row.share if row.sense == np.sign(row.diameters) else -row.share
            speeds = [row.predicted, row.found, off]
            seen = [row.gauge, right, row.probe, 1e6 * row.size, row.mesh]
            found.rows.append([label, f"{row.diameters:+d}", row.frequency, *speeds, *seen])
    peaks = [row for row in every if math.isfinite(row.found)]
    found.holds = {
        "all waves of two to four diameters have a peak within 6 % of the prediction": len(peaks)
        == len(every),
        "all peaks lie within 1.5 % of the predicted speeds": all(
            abs(row.found / row.predicted - 1.0) < _NEAR for row in peaks
        ),
        "a node answers at Z - n or Z + n at least ten times as much as at Z": all(
            row.gauge > 10.0 for row in every
        ),
        "... more than at Z": all(row.gauge > 1.0 for row in every),
        "a probe that stands still answers most at Z": all(
            abs(row.probe - 1.0) < 1e-9 for row in every
        ),
        "most of that order is the wave that runs the right way": all(
            row.sense == np.sign(row.diameters) and row.share > 0.5 for row in every
        ),
    }
    return found


def run_up() -> Finding:
    """The pair of two nodal diameters in a run-up."""
    found = Finding(
        "Critical speeds of the two waves of a pair (Tab. III-12, IV-2)",
        "the backward resonance comes first in a run-up",
        ["wheel", "n", "backward rad/s", "forward rad/s", "backward peak", "forward peak"],
    )
    first: dict[int, list[bool]] = {}
    for label in WHEELS:
        by = {row.diameters: row for row in record(label).waves}
        for n in (2, 3, 4):
            if n not in by or -n not in by:
                continue
            back, forward = by[-n], by[n]
            found.rows.append(
                [label, n, back.predicted, forward.predicted, back.found, forward.found]
            )
            first.setdefault(n, []).append(back.found < forward.found)
    found.holds = {f"n = {n}: backward first": all(ok) for n, ok in first.items()}
    return found


def in_mesh() -> Finding:
    """Fig. III-19: the wheel alone and in mesh."""
    found = Finding(
        "How far the mesh moves modes of the wheel up to 12 kHz, % (Fig. III-19)",
        "modes with zero or one nodal diameter deviate more than those with more diameters, which "
        "correspond well",
        ["wheel", "of a pair", *(f"n = {n}" for n in range(6))],
    )
    one, other = {}, {}
    for label in WHEELS:
        alone = record(label).alone
        for which, rows in ((0, one), (1, other)):
            rows[label] = {n: 100.0 * shift[which] for n, shift in alone.items()}
            name = ("less moved", "more moved")[which]
            found.rows.append([label, name, *(rows[label].get(n) for n in range(6))])
    found.holds = {
        "n >= 2: one of each pair is moved by less than 0.5 %": all(
            shift < 0.5 for row in one.values() for n, shift in row.items() if n >= 2
        ),
        "n >= 2: the other one too": all(
            shift < 0.5 for row in other.values() for n, shift in row.items() if n >= 2
        ),
        "n >= 3: the other one by less than 5 %": all(
            shift < 5.0 for row in other.values() for n, shift in row.items() if n >= 3
        ),
        "from two on, the more diameters the less": all(
            row[n] > row[n + 1]
            for row in other.values()
            for n in range(2, 5)
            if n in row and n + 1 in row
        ),
        "n = 0 or 1 moves more than all others": all(
            max(row.get(0, 0.0), row.get(1, 0.0)) > max(shift for n, shift in row.items() if n >= 2)
            for row in other.values()
        ),
    }
    return found


# --- Bodies made rigid


def carried(scene: Scene, model: PairModel, dynamics: PairDynamics, index: int) -> np.ndarray:
    """Mass of a gear with its shaft in rigid motions about its mid-face, shape `[6, 6]`."""
    gear = GEARS[index]
    mapped = dynamics.cycle.system.structure.map
    first = (0, mapped.sizes[0])[index]
    if gear in scene.bodies:
        heights = scene.bodies[gear].built.body.seat_points[:, 2]
        place = next(body for body in dynamics.bodies if body.index == index)
        numbers = np.asarray(place.seats).reshape(-1, 6)
    else:
        shaft = (model.pinion_support, model.wheel_support)[index]
        assert isinstance(shaft, Shaft)
        heights = np.asarray(node_heights(shaft)) - float(shaft.gear_at)
        numbers = first + np.arange(mapped.sizes[index]).reshape(-1, 6)
    motions = np.zeros((len(dynamics.dofs), 6))
    for height, own in zip(heights, numbers, strict=True):
        rigid_motion = np.eye(6)
        rigid_motion[0, 4], rigid_motion[1, 3] = height, -height
        motions[[dynamics.dofs.index(int(dof)) for dof in own]] = rigid_motion
    return motions.T @ np.asarray(dynamics.system.mass) @ motions


def as_rigid(name: str, masses: dict[str, np.ndarray]) -> DynamicSystem:
    """The pair of a ready scene on stiff shafts, some gears without foundation and as heavy as
    bodies whose masses are given."""
    scene = ready_scene(name, [THESIS, *COARSE, *(f"{gear}.foundation=none" for gear in masses)])
    model = with_rigid_shaft(model_of(scene), *masses)
    grid = dynamic_grid_of(scene, model)
    make = eqx.filter_jit(lambda model: dynamics_of(scene, model, grid))
    where = lambda model: [getattr(model, f"{gear}_body") for gear in masses]
    diagonals = {gear: np.diagonal(mass) for gear, mass in masses.items()}
    none = dict.fromkeys(masses, np.zeros(6))
    for _ in range(2):
        # The second time without what the shaft has already.
        bodies = [RigidBody(*(diagonals[gear] - none[gear])[[0, 5, 3]].tolist()) for gear in masses]
        model = eqx.tree_at(where, model, bodies, is_leaf=lambda x: x is None)
        dynamics = make(model)
        own = {gear: carried(scene, model, dynamics, GEARS.index(gear)) for gear in masses}
        none = {gear: none[gear] + np.diagonal(own[gear]) - diagonals[gear] for gear in masses}
    for gear, mass in masses.items():
        size = np.sqrt(np.diagonal(mass))
        assert np.abs((own[gear] - mass) / size / size[:, None])[:, [0, 1, 2, 5]].max() < 0.02, gear
    return dynamics.system


RIGID = {
    "accessory H1": ("accessory", "h1", ("wheel",)),
    "accessory H2": ("accessory", "h2", ("pinion", "wheel")),
    "power H1": ("power", "h1", ("wheel",)),
}


@functools.cache
def stiffened(label: str) -> tuple[Curve, dict[str, np.ndarray]]:
    """The sweep of a rigidified hybrid, and the masses of its rigidified gears."""
    name, kind, gears = RIGID[label]
    stiff = [rigid_body(gear) for gear in gears]
    quick = [f"{gear}.body.{each}" for gear in gears for each in QUICK]
    each = moving(f"{name}-{kind}", *stiff, *quick)
    return sweep(each.system)[0], {
        gear: carried(each.scene, each.model, each.dynamics, GEARS.index(gear)) for gear in gears
    }


def rigidified() -> Finding:
    """Fig. III-10 and III-15: bodies and shafts 2000 times as stiff, against rigid ones."""
    found = Finding(
        "Sweeps of rigidified hybrids and of the rigid pair (Fig. III-10, III-15)",
        "all in good agreement, slight differences; a peak of the initial model near 1150 rad/s "
        "and some at low to medium speed belong to its shafts, which are beams",
        ["pair", "beside", "largest diff.", "at rad/s", "mean diff.", "peak rad/s", "its peak"],
    )
    off, plain = {}, {}
    for label, (name, _, _) in RIGID.items():
        own, masses = stiffened(label)
        others = {
            "as heavy, stiff shaft": sweep(as_rigid(name, masses))[0],
            "rigid pair as it is": Curve(SPEEDS, _at(rigid(name), SPEEDS)),
        }
        for what, curve in others.items():
            apart = np.abs(own.ratio - curve.ratio)
            at = int(np.nanargmax(apart))
            found.rows.append([label, what, float(apart[at]), float(SPEEDS[at])])
            found.rows[-1] += [float(np.nanmean(apart)), own.main, curve.main]
            into = off if what.startswith("as heavy") else plain
            into[label] = float(apart[at])
    found.holds = {
        **{
            f"{label}: within 0.02 of the rigid pair as heavy, without foundation, on as stiff a "
            "shaft": most < 0.02
            for label, most in off.items()
        },
        **{
            f"{label}: within 0.2 of the rigid pair as it is": most < 0.2
            for label, most in plain.items()
        },
    }
    return found


def _at(curve: Curve, speeds: np.ndarray) -> np.ndarray:
    """Ratios of a curve at speeds that are among its own."""
    return curve.ratio[np.searchsorted(curve.speed, speeds)]


def basis() -> Finding:
    """Fig. III-13: number of modes."""
    found = Finding(
        "Modes of the accessory wheel of 3 mm (Fig. III-13)",
        "most of the response curve is obtained with 10 of 100 modes",
        ["modes", "peak rad/s", "ratio there", "largest diff.", "at rad/s", "mean diff."],
    )
    curves = {
        count: sweep(moving("accessory-h1", f"model.coordinates={count}").system)[0]
        for count in (100, 50, 10)
    }
    best, most, mean = curves[100], {}, {}
    for count, curve in curves.items():
        apart = np.abs(curve.ratio / best.ratio - 1.0)
        at = int(np.nanargmax(apart))
        most[count], mean[count] = float(apart[at]), float(np.nanmean(apart))
        peak = float(np.nanmax(curve.ratio[curve.speed > SLOW]))
        found.rows.append([str(count), curve.main, peak, most[count], SPEEDS[at], mean[count]])
    found.holds = {
        "50 modes: the dynamic ratio within 3 % at every speed": most[50] < 0.03,
        "10 modes: within 3 % in the mean over speed": mean[10] < 0.03,
        "10 modes: within 10 % at every speed": most[10] < 0.1,
        "10 modes: the highest peak within 2 % of its speed": abs(curves[10].main / best.main - 1.0)
        < 0.02,
    }
    return found


# --- Holes

HOLED = ("sweep.steps=16", "mesh.slices=8", *(f"wheel.body.{each}" for each in QUICK))
_marched = eqx.filter_jit(steady_states)


def holes() -> Finding:
    """Fig. IV-30, IV-31 and Tab. IV-6: six holes under 68 teeth, case B."""
    found = Finding(
        "Six holes under 68 teeth: a response over 68 mesh periods (Fig. IV-31, Tab. IV-6)",
        "critical speed of the pair of two diameters 380 instead of 410 rad/s; a peak at 6/68 and "
        "sidebands of that distance about the mesh frequency; none without holes",
        ["wheel", "what", "at", "value", "predicted"],
    )
    each = moving("power-holes", *HOLED)
    method = lambda cycles: Marching(stepper=Exponential(), cycles=cycles)
    responses = lambda speeds: _marched(each.system, jnp.asarray(speeds), method(20))
    rim = rim_of(each)
    whole = {int(np.sign(row.diameters)): row for row in record("power, leaning").waves[:2]}
    back = next(row for row in crossings(each, 500.0, 20) if row.diameters == 2)
    # The forward wave is mixed with other motions, so that no crossing has its name: it is looked
    # for where it would be if it went down like the other.
    ahead = back.speed * whole[1].predicted / whole[-1].predicted
    pierced = {
        way: at_crossing(each, rim, back._replace(direction=way, speed=speed), responses, 9)
        for way, speed in ((-1, back.speed), (1, ahead))
    }
    for label, rows in (("without", whole), ("six holes", pierced)):
        for way, row in rows.items():
            found.rows.append([label, "peak of the wave, rad/s", f"{2 * way:+d}", row.found])
            found.rows[-1].append(row.predicted)
    slow = 1100.0
    # The faster, the less of a slow vibration dies away in a cycle.
    settled = _marched(each.system, jnp.asarray([slow]), method(90))
    orbit = jax.tree.map(lambda x: x[0], settled)
    force = np.asarray(orbit.load)[:, 0] / float(each.system.force)
    table = each.system.table
    middles, lengths = np.asarray(table.middles), np.asarray(table.lengths)
    size = {}
    for k in range(1, 2 * table.periods):
        turned = np.exp(-2j * np.pi * k * middles / table.periods)
        size[k] = 2.0 * abs(complex(np.sum(lengths * force * turned))) / table.periods
    step = 6 * table.periods // 68
    mesh = table.periods
    named = {
        "6/68": step,
        "1 - 6/68": mesh - step,
        "1": mesh,
        "1 + 6/68": mesh + step,
        "12/68": 2 * step,
        "1 - 12/68": mesh - 2 * step,
        "1 + 12/68": mesh + 2 * step,
    }
    for what, k in named.items():
        found.rows.append(["six holes", f"mesh force at {slow:g} rad/s, %", what, 100 * size[k]])
        found.rows[-1].append(None)
    # Farther off are sidebands of other harmonics.
    rest = [k for k in range(-16, 17) if k % step]
    others = [max(size[k] for k in rest if k > 0), max(size[mesh + k] for k in rest)]
    for what, value in zip(("below 0.25", "0.75 to 1.25"), others, strict=True):
        found.rows.append(["six holes", "largest of all others, %", what, 100.0 * value, None])
    found.rows.append(["six holes", "residual of the march", "-", float(orbit.residual), None])
    found.holds = {
        "the response repeats after 68 mesh periods": mesh == 68,
        "it settled": bool(orbit.settled),
        "the backward critical speed of two diameters is lower with holes": pierced[-1].found
        < whole[-1].found,
        "the forward one too": pierced[1].found < whole[1].found,
        "a peak at 6/68 of the mesh": size[step] > 3.0 * others[0],
        "sidebands at 1 - 6/68 and 1 + 6/68": min(size[mesh - step], size[mesh + step])
        > 3.0 * others[1],
    }
    return found


FINDINGS: dict[str, Callable[[], Finding]] = {
    "rigidified": rigidified,
    "critical-speeds": critical_speeds,
    "basis": basis,
    "growth": growth,
    "waves": waves,
    "run-up": run_up,
    "in-mesh": in_mesh,
    "holes": holes,
}


if __name__ == "__main__":
    tell(FINDINGS, "What turning flexible wheels do in a mesh.", "wheel_trends")
