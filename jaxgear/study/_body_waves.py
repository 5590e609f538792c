"""Looking at condensed bodies while a scene is swept: their waves, probes and flanks."""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._sweep_types import Direction, SweepPoint, Ways
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._types import StepCells
from jaxgear._interface._laws import AbstractContactLaw
from jaxgear._response._body_motion import start_angle
from jaxgear._response._dynamic import forces_in_motion
from jaxgear._response._flank_loads import FlankLoads, LargestLoad, flank_loads
from jaxgear._response._gauges import GaugeInfluences, gauge_influences, rest_readings
from jaxgear._response._spectrum import Spectrum, joined_spectra, spectrum_of_steps
from jaxgear._response._wave_words import BENT
from jaxgear._response._waves import (
    BodyMotion,
    Circle,
    Waves,
    joined_circles,
    joined_waves,
    order_sums,
    waves_on_body,
)
from jaxgear._response._whole_motion import WholeBody, WholeModes, whole_modes
from jaxgear._system._held_body import held_answers
from jaxgear.scene._build_pair import pair_of
from jaxgear.study._built import BuiltScene
from jaxgear.study._gauges import Gauge, gauges_of
from jaxgear.study._moving_body import MovingBody, moving_bodies, whole_body
from jaxgear.study._probes import Probe, probes_of

# Waves of more nodal diameters are not told one by one.
_MOST = 12


class MainWave(NamedTuple):
    """The strongest order of a rim at one speed, and the wave that is most of it.

    **Fields:**

    - `order`: of the gear's rotation [-].
    - `diameters`: of the wave, signed: forward positive.
    - `share`: of the wave in the mean square of that order [-].
    - `amplitude`: along radius, tangent and axis [m].
    - `travel`: speed around the body, forward positive; zero: none [rad/s].
    """

    order: float
    diameters: int
    share: float
    amplitude: np.ndarray
    travel: float


@dataclasses.dataclass(frozen=True)
class Looked:
    """What is looked at on one body.

    **Fields:**

    - `body`: that moves.
    - `rim`: circles of it, against the gear's seat.
    - `probes`: of the scene.
    - `gauges`: of the scene, by seats and modes.
    - `angle`: of the body's x from S where the cycle begins [rad].
    - `whole`: the body on natural modes.
    - `read`: what loads on the teeth do to the body, by rows of its coordinates and its answers.
    """

    body: MovingBody
    rim: Circle
    probes: tuple[Probe, ...]
    gauges: tuple[Gauge, ...]
    angle: float
    whole: WholeBody
    read: Callable[[np.ndarray, np.ndarray], GaugeInfluences]

    @property
    def most(self) -> int:
        """Largest number of nodal diameters told."""
        return int(self.rim.number.max())

    @property
    def low(self) -> float:
        """Orders above this one are those of the mesh; below, the body turns under its load [-]."""
        return 0.5 * self.body.teeth

    def moved(
        self, pair: PairDynamics, orbit: Orbit, law: AbstractContactLaw, orders: int
    ) -> "Moved":
        """What the body does in a response, without what is beyond so many mesh orders."""
        force, index = forces_in_motion(pair, orbit, law), self.body.index
        found = whole_modes(self.whole, pair, orbit, index, force, orders, angle=self.angle)
        return Moved(force, found)

    @functools.cached_property
    def _read(self) -> list["_Read"]:
        """What its probes read, those that turn with the body apart from those that do not."""
        rows, found = np.concatenate([probe.coordinates for probe in self.probes]), []
        answers = held_answers(self.body.built.body, rows)
        shown = rows @ self.body.motions
        of = np.repeat(np.arange(len(self.probes)), [len(x.coordinates) for x in self.probes])
        for turns in (True, False):
            chosen = [n for n, probe in enumerate(self.probes) if probe.turns == turns]
            if chosen:
                circles = [self.probes[n].looking_at(shown[of == n]) for n in chosen]
                own = np.isin(of, chosen)
                ends = np.flatnonzero(np.diff(of[own])) + 1
                found.append(_Read(chosen, circles, ends, self.read(rows[own], answers[own])))
        return found

    def probe_spectra(
        self, pair: PairDynamics, orbit: Orbit, moved: "Moved", orders: int
    ) -> tuple[Spectrum, ...]:
        """What its probes show of a response, without what is beyond so many mesh orders [m].

        What the forces of the cells give at rest, and what the body does beyond it. Rotation and
        heat stand still on the body: its shapes show them.
        """
        motion, force = moved.modes.beyond, moved.force
        lengths, teeth, found = pair.system.table.period_lengths, self.body.teeth, {}
        for read in self._read:
            # What stands still sees the same in every cycle, what turns in every revolution.
            turns = self.probes[read.probes[0]].turns
            periods = math.lcm(motion.periods, teeth if turns else 1)
            readings, turn = rest_readings(read.influences, pair, orbit, force, periods)
            parts = np.split(np.asarray(readings), read.ends, axis=1)
            for number, own, circle in zip(read.probes, parts, read.circles, strict=True):
                probe = self.probes[number]
                still = spectrum_of_steps(probe.shown(own, np.asarray(turn)), lengths, teeth)
                whole = joined_spectra(probe.spectrum(motion, circle), still)
                kept = whole.order <= (orders + 0.5) * teeth
                found[number] = Spectrum(whole.order[kept], whole.amplitude[kept])
        return tuple(found[number] for number in range(len(found)))

    def waves(self, motion: BodyMotion) -> Waves:
        """Waves that travel around the rim."""
        return joined_waves(waves_on_body(motion, self.rim))

    def main_wave(self, motion: BodyMotion) -> MainWave:
        """The strongest wave of two and more nodal diameters, above half the order of the teeth.

        Fewer are mostly the gear as a whole, on its shaft; they count if the rim shows no others.
        """
        waves = self.waves(motion)
        square = np.where(waves.order > self.low, np.sum(waves.size**2, axis=1), -1.0)
        bent = np.where(np.abs(waves.diameters) >= BENT, square, -1.0)
        best = int(np.argmax(bent if bent.max() > 0.0 else square))
        order, number = float(waves.order[best]), int(waves.diameters[best])
        travel = float(waves.travel[best]) if number else 0.0
        return MainWave(order, number, waves.strongest(order)[1], waves.size[best], travel)


class Moved(NamedTuple):
    """What a body does in a response.

    **Fields:**

    - `force`: of all cells at each step [N].
    - `modes`: what its natural modes do under them.
    """

    force: StepCells
    modes: WholeModes


class _Read(NamedTuple):
    """What probes of one kind read.

    **Fields:**

    - `probes`: their numbers.
    - `circles`: that they look at, by coordinates of `WholeModes.motion`.
    - `ends`: of all nodes, where those of the next probe begin.
    - `influences`: of loads on the teeth, on all nodes.
    """

    probes: list[int]
    circles: list[Circle]
    ends: np.ndarray
    influences: GaugeInfluences


class Seen(NamedTuple):
    """What was seen of one response: RMS [m].

    **Fields:**

    - `flank`: the largest loads on it.
    - `waves`: by nodal diameter of each gear, shape `[wave, direction]` [m].
    - `probes`: of each gear, shape `[probe]` [m].
    """

    flank: LargestLoad
    waves: dict[str, np.ndarray]
    probes: dict[str, np.ndarray]


class Peak(NamedTuple):
    """The highest response of a direction.

    **Fields:**

    - `rank`: whether it settled, and its dynamic ratio [-].
    - `speed`: of the pinion [rad/s].
    - `motions`: of each gear's body.
    - `probes`: what those of each gear show.
    """

    rank: tuple[bool, float]
    speed: float
    motions: dict[str, BodyMotion]
    probes: dict[str, tuple[Spectrum, ...]]


@dataclasses.dataclass
class WaveWatch:
    """Looks at each response of a sweep, and keeps the motion at the highest peak.

    **Fields:**

    - `pair`: that is swept.
    - `looked`: what is looked at, by gear.
    - `orders`: mesh orders that are considered.
    - `law`: of contact.
    - `seen`: of each direction, by speed of the pinion [rad/s].
    - `peak`: of each direction.
    - `loads`: on the flanks, of each direction, at its lowest and highest speed and at the peak.
    """

    pair: PairDynamics
    looked: dict[str, Looked]
    orders: int
    law: AbstractContactLaw
    seen: dict[Direction, dict[float, Seen]] = dataclasses.field(default_factory=dict)
    peak: dict[Direction, Peak] = dataclasses.field(default_factory=dict)
    loads: dict[Direction, dict[str, FlankLoads]] = dataclasses.field(default_factory=dict)

    def flanks(self, direction: Direction) -> list[FlankLoads]:
        """Loads on the flanks that are shown of a direction, by rising speed, each once."""
        own = {each.speed: each for each in self.loads.get(direction, {}).values()}
        return [own[speed] for speed in sorted(own)]

    def __call__(self, ways: Ways, point: SweepPoint, ratio: float) -> None:
        """Look at a response, whose dynamic ratio is known [-]."""
        moved = {
            gear: each.moved(self.pair, point.orbit, self.law, self.orders)
            for gear, each in self.looked.items()
        }
        motions = {gear: each.modes.motion for gear, each in moved.items()}
        probes = {
            gear: each.probe_spectra(self.pair, point.orbit, moved[gear], self.orders)
            for gear, each in self.looked.items()
        }
        speed, rank = float(point.orbit.speed), (point.settled, ratio)
        loads = flank_loads(self.pair, point.orbit, self.law)
        seen = self.look(loads.largest, motions, probes)
        for way in ways:
            shown = self.loads.setdefault(way, {})
            if way not in self.peak or rank > self.peak[way].rank:
                self.peak[way] = Peak(rank, speed, motions, probes)
                shown["peak"] = loads
            if speed <= shown.get("lowest", loads).speed:
                shown["lowest"] = loads
            if speed >= shown.get("highest", loads).speed:
                shown["highest"] = loads
            self.seen.setdefault(way, {})[speed] = seen

    def look(
        self,
        flank: LargestLoad,
        motions: dict[str, BodyMotion],
        spectra: dict[str, tuple[Spectrum, ...]],
    ) -> Seen:
        """What the bodies and their probes show; only what the mesh drives, by its orders."""
        waves, probes = {}, {}
        for gear, each in self.looked.items():
            waves[gear] = each.waves(motions[gear]).by_diameter(each.most, each.low)
            high = [each.low, np.inf]
            probes[gear] = np.array([order_sums(shown, high)[0] for shown in spectra[gear]])
        return Seen(flank, waves, probes)


def wave_watch(built: BuiltScene, pair: PairDynamics) -> WaveWatch:
    """What `sweep_of` shows each response to: the waves of a scene's bodies, made to move.

    **Raises:**

    - `ValueError` if a probe is where there is no node.
    """
    scene, gears, looked = built.scene, pair_of(built.scene), {}
    for gear, body in moving_bodies(scene.bodies, scene.gears).items():
        circles = body.rim_circles()
        most = min(_MOST, *(int(circle.number.max()) for circle in circles))
        rim, angle = joined_circles(circles, most), start_angle(gears, body.index)
        probes = probes_of(scene.probes, scene.condensed, body)
        heated, warm = scene.bodies[gear].heated, scene.gear(gear).body.temperature
        gauges = gauges_of(scene.gauges, scene.condensed, gear, body.built, heated)
        gauges = tuple(each.on(body, warm, grows=scene.sweep.centrifugal) for each in gauges)
        looked[gear] = Looked(
            body=body,
            rim=rim,
            probes=probes,
            gauges=gauges,
            angle=angle,
            whole=whole_body(scene, body),
            read=functools.partial(_read, built, body),
        )
    return WaveWatch(pair, looked, max(1, scene.sweep.orders), built.law)


def _read(
    built: BuiltScene, body: MovingBody, rows: np.ndarray, answers: np.ndarray
) -> GaugeInfluences:
    """What loads on the teeth do to a body at rest, by rows of its coordinates and its answers."""
    mesh, flexible = built.scene.mesh, built.scene.bodies[body.gear].flexible
    return gauge_influences(
        body.built.body,
        rows,
        np.zeros(len(rows)),
        built.model.pair,
        body.index,
        built.grid_in_motion,
        components=flexible.components,
        points=mesh.root_points,
        axial=mesh.connection,
        answers=answers,
    )
