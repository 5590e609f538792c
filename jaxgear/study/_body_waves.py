"""Waves in the condensed bodies of a scene: what gauges and probes show over a sweep."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
import xarray as xr

from fem_prep import Held, Progress, hold, recovered, rigid_motions
from jaxgear._checks import require
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._sweep import Direction, SweepPoint
from jaxgear._dynamics._system import PairDynamics
from jaxgear._interface._laws import AbstractContactLaw, ExactContact
from jaxgear._response._waves import (
    DIRECTIONS,
    BodyMotion,
    Circle,
    Spectrum,
    Waves,
    along_directions,
    body_motion,
    circle_of,
    fixed_spectrum,
    joined_circles,
    joined_waves,
    order_sums,
    rotating_spectrum,
    start_angle,
    waves_on_body,
)
from jaxgear._system._body_modes import BodyBasis
from jaxgear._units import deg, mm, um
from jaxgear.scene._body_build import BuiltBody, Steps, full_of
from jaxgear.scene._body_words import in_keys
from jaxgear.scene._build import law_of, pair_of
from jaxgear.scene._scene import Scene
from jaxgear.scene._schema import GEARS
from jaxgear.study._dynamics import Sweep
from jaxgear.study._flank_loads import FlankLoads, flank_loads, loads_over_speeds, loads_summary
from jaxgear.study._results import Entry

Summary = dict[str, Any]

# Waves of more nodal diameters are not told one by one.
_MOST = 12
# Waves of fewer nodal diameters are mostly motions of the gear as a whole.
BENT = 2
# A probe may be so far from where it was asked for, over the radius.
_OFF = 0.05
# Nodes on one circle, over the radius.
_SAME = 1e-4
# Waves below this part of the largest are not written down.
_SMALL = 1e-4
# Motions of the whole grid that are there at one time.
_AT_ONCE = 32


# --- The nodes of a body


class MovingBody:
    """A condensed body that vibrates, and all of its grid.

    **Fields:**

    - `gear`: `pinion` or `wheel`.
    - `built`: the body.
    - `basis`: its motions, as the pair in motion has them.
    - `teeth`: of the gear.
    - `gear_seat`: number of the seat against which waves are told.
    """

    def __init__(
        self,
        gear: str,
        built: BuiltBody,
        basis: BodyBasis,
        teeth: int,
        gear_seat: int = 0,
        tell: Callable[[str], None] = lambda step: None,
    ):
        self.gear, self.built, self.basis, self.teeth = gear, built, basis, teeth
        self.gear_seat = gear_seat
        self._tell = tell

    @property
    def index(self) -> int:
        """0 for the pinion, 1 for the wheel."""
        return GEARS.index(self.gear)

    @property
    def radius(self) -> float:
        """Of the rim [m]."""
        return float(np.median(np.hypot(*self.built.body.rim_nodes.T[:2])))

    @property
    def has_grid(self) -> bool:
        """Whether more is known of it than its rim and its seats."""
        return len(self.built.body.nodes) > 0

    @property
    def nodes(self) -> np.ndarray:
        """Places of all nodes that can be looked at, shape `[node, 3]` [m]."""
        return self.built.body.nodes if self.has_grid else self.built.body.rim_nodes

    @functools.cached_property
    def _rim(self) -> np.ndarray:
        """Which rim node each node is, or -1."""
        # Of each rim node its place in the grid, whatever order either is in.
        places = self.built.body.rim_nodes
        _, where = scipy.spatial.KDTree(self.nodes).query(places)
        found = np.full(len(self.nodes), -1)
        found[where] = np.arange(len(places))
        return found

    @functools.cached_property
    def _held(self) -> Held:
        progress: Progress = Steps(lambda step: self._tell(f"{self.gear}: {step}"))
        with in_keys(self.gear):
            return hold(full_of(self.built.plan, Steps(self._tell)), progress=progress)

    def rows(self, chosen: np.ndarray) -> np.ndarray:
        """Displacements of nodes per seat and mode.

        Those of the rim are coordinates of the condensed body; all others follow by its grid,
        which is then factorised again.

        **Arguments:**

        - `chosen`: numbers of the nodes, shape `[node]`.

        **Returns:**

        Along x, y, z of the body, shape `[node, 3, seat dof and mode]` [-, m, kg^-1/2].
        """
        motions = self.basis.motions
        rim = self._rim[chosen]
        count = 3 * len(self.built.body.rim_nodes)
        result = motions[:count].reshape(-1, 3, motions.shape[1])[rim]
        inside = np.flatnonzero(rim < 0)
        for start in range(0, motions.shape[1], _AT_ONCE) if inside.size else ():
            some = slice(start, start + _AT_ONCE)
            result[inside, :, some] = np.moveaxis(
                self.field(motions[:, some])[:, chosen[inside]], 0, 2
            )
        return result

    def field(self, motions: np.ndarray) -> np.ndarray:
        """Displacements of all nodes in motions of the condensed body, `[column, node, 3]` [m]."""
        if not self.has_grid:
            count = 3 * len(self.nodes)
            return motions[:count].T.reshape(-1, len(self.nodes), 3)
        return recovered(self._held, self.built.body, motions)

    def shape(self, motion: BodyMotion, order: float | int) -> np.ndarray:
        """Operating deflection shape of one order, on the body and against the gear's seat.

        **Arguments:**

        - `motion`: of the body.
        - `order`: of the gear's rotation [-].

        **Returns:**

        Complex amplitude of all nodes along x, y, z of the body, shape `[node, 3]` [m].
        """
        own = motion.of_body.near(order)
        whole = self.basis.motions @ own
        real, imaginary = self.field(np.stack([np.real(whole), np.imag(whole)], axis=1))
        return real + 1j * imaginary - self.with_seat(self.nodes) @ own

    def with_seat(self, places: np.ndarray) -> np.ndarray:
        """Displacements of places that move as one with the gear's seat, as of `rows`."""
        seat = 6 * self.gear_seat
        rigid = rigid_motions(places - self.built.body.seat_points[self.gear_seat])
        result = np.zeros((len(places), 3, self.basis.motions.shape[1]))
        result[:, :, seat : seat + 6] = rigid.reshape(-1, 3, 6)
        return result

    def circle(self, chosen: np.ndarray, *, against_seat: bool = False) -> Circle:
        """The circle of some nodes; their motion may be told against the gear's seat."""
        rows = self.rows(chosen)
        if against_seat:
            rows = rows - self.with_seat(self.nodes[chosen])
        return circle_of(_angle(self.nodes[chosen]), rows)

    def rim_circles(self) -> list[Circle]:
        """Circles of the rim: at both ends and in the middle, of those with the most nodes.

        Against the gear's seat: what the gear does as a whole is no wave in it.
        """
        heights = np.round(self.built.body.rim_nodes[:, 2] / (_SAME * self.radius))
        each, count = np.unique(heights, return_counts=True)
        full = each[count == count.max()]
        rim = np.flatnonzero(self._rim >= 0)
        own = np.round(self.nodes[rim, 2] / (_SAME * self.radius))
        places = sorted({0, len(full) // 2, len(full) - 1})
        return [self.circle(rim[own == full[place]], against_seat=True) for place in places]


def _angle(places: np.ndarray) -> np.ndarray:
    return np.arctan2(places[:, 1], places[:, 0])


# --- Probes


@dataclasses.dataclass(frozen=True)
class Probe:
    """A gauge on a body, or a probe beside it that sees it pass.

    **Fields:**

    - `name`: in results.
    - `gear`: `pinion` or `wheel`.
    - `direction`: that is read: 0 radial, 1 tangential, 2 axial.
    - `rows`: of a gauge, per seat and mode, shape `[seat dof and mode]`, or None
        [-, m, kg^-1/2].
    - `circle`: that a fixed probe looks at, or None.
    - `angle`: of a fixed probe about Z, from S [rad].
    - `place`: radius, angle and height of the node or the circle [m, rad, m].
    """

    name: str
    gear: str
    direction: int
    rows: np.ndarray | None
    circle: Circle | None
    angle: float
    place: tuple[float, float, float]

    @property
    def turns(self) -> bool:
        """Whether it turns with the body."""
        return self.circle is None

    def spectrum(self, motion: BodyMotion) -> Spectrum:
        """What it shows, by orders of the gear's rotation, shape `[order]` [m]."""
        if self.circle is None:
            assert self.rows is not None
            return rotating_spectrum(motion, self.rows)
        found = fixed_spectrum(motion, self.circle, self.angle)
        return Spectrum(found.order, found.amplitude[:, self.direction])


def _asked(scene: Scene, body: MovingBody) -> list[Probe]:
    """The probes that a scene has on a gear."""
    found = []
    for row in scene.rows("probes"):
        require(
            scene[f"{row}.gear"] in scene.condensed,
            "{row}.gear: the body of the {gear} is not condensed, so there are no waves in it.",
            row=row,
            gear=scene[f"{row}.gear"],
        )
        if scene[f"{row}.gear"] == body.gear:
            found.append(_probe(scene, row, body))
    return found


def _probe(scene: Scene, row: str, body: MovingBody) -> Probe:
    direction = DIRECTIONS.index(scene[f"{row}.direction"])
    turns = scene[f"{row}.frame"] == "rotating"
    name = scene.get(f"{row}.name")
    if (node := scene.get(f"{row}.node")) is not None:
        return _condensed_probe(row, body, node, direction, turns, name or node)
    given = scene.get(f"{row}.radius_mm")
    radius = body.radius if given is None else given * mm
    place = radius, scene[f"{row}.angle_deg"] * deg, scene[f"{row}.height_mm"] * mm
    if not name:
        name = f"{body.gear} r {radius / mm:.4g} mm {DIRECTIONS[direction]}"
        name += " rotating" if turns else " fixed"
    return probe_at(body, place, direction, turns=turns, name=name, key=row)


def _condensed_probe(
    row: str, body: MovingBody, node: str, direction: int, turns: bool, name: str
) -> Probe:
    known = body.built.body.probes
    require(
        node in known,
        "{row}.node: no node {node!r} was condensed with the body of the {gear}, which has "
        "{known}. Give the place of the probe instead: radius_mm, angle_deg, height_mm.",
        row=row,
        node=node,
        gear=body.gear,
        known=", ".join(map(repr, known)) or "none",
    )
    require(
        turns,
        '{row}.frame: a condensed node turns with the body, got "fixed". Give the place of the '
        "probe instead, so that it can see what passes.",
        row=row,
    )
    number = known.index(node)
    place = body.built.body.probe_points[number]
    rows = body.built.body.probe_rows[number] @ body.basis.motions
    rows = along_directions(_angle(place[None]), rows[None])[0, direction]
    where = float(np.hypot(*place[:2])), float(_angle(place[None])[0]), float(place[2])
    return Probe(name, body.gear, direction, rows, None, 0.0, where)


def probe_at(
    body: MovingBody,
    place: tuple[float, float, float],
    direction: int,
    *,
    turns: bool,
    name: str,
    key: str = "probe",
) -> Probe:
    """A probe at the node, or the circle of nodes, that is nearest to a place.

    **Arguments:**

    - `body`: that is looked at.
    - `place`: radius, angle and height; the angle of one that turns is from the body's x, of one
        that stands still from S [m, rad, m].
    - `direction`: 0 radial, 1 tangential, 2 axial.
    - `turns`: whether it turns with the body.
    - `name`: in results.
    - `key`: for messages.

    **Returns:**

    The probe.

    **Raises:**

    - `ValueError` if no node is near, or the nodes there are no circle.
    """
    radius, angle, height = place
    nodes = body.nodes
    off = np.hypot(np.hypot(nodes[:, 0], nodes[:, 1]) - radius, nodes[:, 2] - height)
    around = np.abs(np.mod(_angle(nodes) - angle + np.pi, 2.0 * np.pi) - np.pi) if turns else 0.0
    apart = np.hypot(off, radius * around)
    nearest = int(np.argmin(apart))
    found = nodes[nearest]
    where = float(np.hypot(found[0], found[1])), float(_angle(found[None])[0]), float(found[2])
    only = "" if body.has_grid else " Of a body without a grid only the rim is known."
    require(
        float(apart[nearest]) <= _OFF * body.radius,
        "{key}: no node of the {gear}'s body is near radius {radius:.4g} mm, height {height:.4g} "
        "mm{angle}: the nearest is at radius {r:.4g} mm, height {h:.4g} mm, {a:.4g} degrees.{only}",
        key=key,
        gear=body.gear,
        radius=radius / mm,
        height=height / mm,
        angle=f", {angle / deg:.4g} degrees" if turns else "",
        r=where[0] / mm,
        h=where[2] / mm,
        a=where[1] / deg,
        only=only,
    )
    if turns:
        rows = along_directions(np.array([where[1]]), body.rows(np.array([nearest])))
        return Probe(name, body.gear, direction, rows[0, direction], None, 0.0, where)
    same = np.hypot(np.hypot(nodes[:, 0], nodes[:, 1]) - where[0], nodes[:, 2] - where[2])
    chosen = np.flatnonzero(same <= _SAME * body.radius)
    try:
        circle = body.circle(chosen)
    except ValueError as error:
        raise type(error)(f"{key}: a fixed probe sees a circle of nodes pass. {error}") from None
    return Probe(name, body.gear, direction, None, circle, angle, (where[0], angle, where[2]))


def _usual(body: MovingBody) -> list[Probe]:
    """Where a scene asks for nothing: at the end of the rim, a quarter of a turn from the mesh."""
    end = float(body.built.body.rim_nodes[:, 2].min())
    found = []
    for turns, direction in ((True, 2), (True, 0), (False, 2), (False, 0)):
        name = f"rim {DIRECTIONS[direction]} {'rotating' if turns else 'fixed'}"
        place = (body.radius, 0.0 if turns else 0.5 * np.pi, end)
        found.append(probe_at(body, place, direction, turns=turns, name=name))
    return found


# --- Over a sweep


@dataclasses.dataclass(frozen=True)
class Looked:
    """What is looked at on one body.

    **Fields:**

    - `body`: that moves.
    - `rim`: circles of it, against the gear's seat.
    - `probes`: of the scene.
    - `angle`: of the body's x from S where the cycle begins, or None: not known yet [rad].
    """

    body: MovingBody
    rim: Circle
    probes: tuple[Probe, ...]
    angle: float | None = None

    @property
    def most(self) -> int:
        """Largest number of nodal diameters told."""
        return int(self.rim.number.max())

    @property
    def low(self) -> float:
        """Orders above this one are those of the mesh; below, the body turns under its load [-]."""
        return 0.5 * self.body.teeth

    def motion(self, pair: PairDynamics, orbit: Orbit) -> BodyMotion:
        """The body's motion in a response."""
        return body_motion(pair, orbit, self.body.index, angle=self.angle)

    def waves(self, motion: BodyMotion) -> Waves:
        """Waves that travel around the rim."""
        return joined_waves(waves_on_body(motion, self.rim))


@dataclasses.dataclass
class WaveWatch:
    """Looks at each response of a sweep, and keeps the motion at the highest peak.

    **Fields:**

    - `pair`: that is swept.
    - `looked`: what is looked at, by gear.
    - `orders`: mesh orders that are considered.
    - `best`: of each direction, whether it settled, dynamic ratio, speed and motions by gear.
    - `law`: of contact.
    - `loads`: on the flanks, of each direction, at its lowest and highest speed and at `best`.
    """

    pair: PairDynamics
    looked: dict[str, Looked]
    orders: int
    best: dict[Direction, tuple[bool, float, float, dict[str, BodyMotion]]] = dataclasses.field(
        default_factory=dict
    )
    law: AbstractContactLaw = dataclasses.field(default_factory=ExactContact)
    loads: dict[Direction, dict[str, FlankLoads]] = dataclasses.field(default_factory=dict)

    def flanks(self, direction: Direction) -> list[FlankLoads]:
        """Loads on the flanks that are shown of a direction, by rising speed, each once."""
        own = {each.speed: each for each in self.loads.get(direction, {}).values()}
        return [own[speed] for speed in sorted(own)]

    def __call__(
        self, direction: Direction, point: SweepPoint, ratio: float
    ) -> dict[str, np.ndarray]:
        """RMS of waves and of probes, their names begin with the gear's, and flank loads, in SI."""
        motions = {
            gear: _within(each.motion(self.pair, point.orbit), self.orders)
            for gear, each in self.looked.items()
        }
        kept = self.best.get(direction)
        speed = float(point.orbit.speed)
        loads = flank_loads(self.pair, point.orbit, self.law)
        shown = self.loads.setdefault(direction, {})
        if kept is None or (point.settled, ratio) > kept[:2]:
            self.best[direction] = point.settled, ratio, speed, motions
            shown["peak"] = loads
        if speed <= shown.get("lowest", loads).speed:
            shown["lowest"] = loads
        if speed >= shown.get("highest", loads).speed:
            shown["highest"] = loads
        numbers = loads.numbers()
        for gear, each in self.looked.items():
            motion = motions[gear]
            numbers[f"{gear}_wave_rms"] = each.waves(motion).by_diameter(each.most, each.low)
            numbers[f"{gear}_probe_rms"] = np.array(
                [order_sums(p.spectrum(motion), [each.low, np.inf])[0] for p in each.probes]
            )
        return numbers


def _within(motion: BodyMotion, orders: int) -> BodyMotion:
    """A motion without what is beyond so many mesh orders."""
    count = min(len(motion.amplitudes), orders * motion.periods + 1)
    return dataclasses.replace(motion, amplitudes=motion.amplitudes[:count])


def moving_bodies(
    scene: Scene, tell: Callable[[str], None] = lambda step: None
) -> dict[str, MovingBody]:
    """The condensed bodies of a scene that vibrate.

    **Arguments:**

    - `scene`: with its bodies, made to move.
    - `tell`: told what begins.

    **Returns:**

    By gear.
    """
    found = {}
    for gear in GEARS:
        if gear not in scene.bodies:
            continue
        mesh_body, teeth = scene.bodies[gear], scene[f"{gear}.teeth"]
        sectors = mesh_body.built.body.facts.get("sectors", 1)
        basis, _ = mesh_body.basis.under_teeth(teeth, sectors)
        seat = mesh_body.flexible.gear_seat
        found[gear] = MovingBody(gear, mesh_body.built, basis, teeth, seat, tell)
    return found


def wave_watch(
    scene: Scene, pair: PairDynamics, tell: Callable[[str], None] = lambda step: None
) -> WaveWatch:
    """Get ready to look at the waves of a scene's bodies while it is swept.

    **Arguments:**

    - `scene`: with its bodies, made to move.
    - `pair`: that is swept.
    - `tell`: told what begins.

    **Returns:**

    What `sweep_of` shows each response to.

    **Raises:**

    - `ValueError` if a probe is where there is no node.
    """
    looked = {}
    angle_of = functools.partial(start_angle, pair_of(scene))
    for gear, body in moving_bodies(scene, tell).items():
        circles = body.rim_circles()
        most = min(_MOST, *(int(circle.number.max()) for circle in circles))
        probes = _asked(scene, body) or _usual(body)
        rim = joined_circles(circles, most)
        looked[gear] = Looked(body, rim, tuple(probes), angle_of(body.index))
    return WaveWatch(pair, looked, max(1, scene["sweep.orders"]), law=law_of(scene))


# --- Dataset and summary


def waves_dataset(watch: WaveWatch, sweep: Sweep) -> xr.Dataset:
    """Collect what was seen over a sweep, and all orders at its highest peak.

    **Arguments:**

    - `watch`: that looked.
    - `sweep`: what was found.

    **Returns:**

    A dataset over direction of the sweep and speed, in the units of files; waves are signed:
    forward positive, backward negative, as seen from the body.
    """
    _, _, speed, motions = watch.best[sweep.main]
    entries: dict[str, Entry] = {
        "speed": Entry(("speed",), sweep.speeds, "rad/s", "speed of the pinion"),
        "component": Entry(("component",), list(DIRECTIONS), "1", "direction on the body"),
        "direction": Entry(("direction",), list(sweep.responses), "1", "of the sweep"),
    }
    for gear, each in watch.looked.items():
        entries |= _over_speeds(gear, each, sweep) | _at_peak(gear, each, motions[gear])
    if watch.loads:
        entries |= loads_over_speeds([[r.numbers for r in own] for own in sweep.responses.values()])
    return xr.Dataset(
        {name: entry.variable() for name, entry in entries.items()},
        attrs={
            "peak_speed_rad_s": speed,
            "peak_direction": sweep.main,
            **{f"teeth_{gear}": each.body.teeth for gear, each in watch.looked.items()},
        },
    )


def _over_speeds(gear: str, each: Looked, sweep: Sweep) -> dict[str, Entry]:
    rows = lambda name: (
        np.asarray([[r.numbers[name] for r in own] for own in sweep.responses.values()]) / um
    )
    place, number = ("direction", "speed"), np.arange(-each.most, each.most + 1)
    above = "orders above half the number of teeth"
    return {
        f"{gear}_diameters": Entry(
            (f"{gear}_diameters",), number, "1", "nodal diameters; forward positive"
        ),
        f"{gear}_wave_rms_um": Entry(
            (*place, f"{gear}_diameters", "component"),
            rows(f"{gear}_wave_rms"),
            "um",
            f"RMS of waves around the rim of the {gear}, {above}",
        ),
        f"{gear}_probe": Entry(
            (f"{gear}_probe",), [probe.name for probe in each.probes], "1", "probe"
        ),
        f"{gear}_probe_turns": Entry(
            (f"{gear}_probe",),
            [probe.turns for probe in each.probes],
            "1",
            "whether the probe turns with the body",
        ),
        f"{gear}_probe_rms_um": Entry(
            (*place, f"{gear}_probe"), rows(f"{gear}_probe_rms"), "um", f"RMS of a probe, {above}"
        ),
    }


def _at_peak(gear: str, each: Looked, motion: BodyMotion) -> dict[str, Entry]:
    spectra = [probe.spectrum(motion) for probe in each.probes]
    order = np.unique(np.concatenate([spectrum.order for spectrum in spectra]))
    shown = np.zeros((len(spectra), len(order)))
    for row, spectrum in zip(shown, spectra, strict=True):
        row[np.searchsorted(order, spectrum.order)] = spectrum.size
    waves = each.waves(motion)
    large = waves.size.max(axis=1) > _SMALL * waves.size[waves.order > each.low].max()
    travel = np.where(waves.diameters[large] == 0, 0.0, waves.travel[large])
    dims = (f"{gear}_wave",)
    return {
        f"{gear}_order": Entry((f"{gear}_order",), order, "1", f"order of the {gear}'s rotation"),
        f"{gear}_probe_amplitude_um": Entry(
            (f"{gear}_probe", f"{gear}_order"),
            shown / um,
            "um",
            "amplitude that a probe shows at the highest peak; order 0: the mean",
        ),
        f"{gear}_wave_order": Entry(
            dims, waves.order[large], "1", f"order of a wave, by the {gear}'s rotation"
        ),
        f"{gear}_wave_diameters": Entry(
            dims, waves.diameters[large], "1", "its nodal diameters; forward positive"
        ),
        f"{gear}_wave_travel_rad_s": Entry(
            dims, travel, "rad/s", "speed around the body; forward positive; 0: none"
        ),
        f"{gear}_wave_amplitude_um": Entry(
            (*dims, "component"),
            waves.size[large] / um,
            "um",
            "its amplitude at the highest peak, RMS over the width of the rim",
        ),
    }


@dataclasses.dataclass(frozen=True)
class MainWave:
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

    @property
    def words(self) -> str:
        """In words."""
        return wave_words(self.diameters)

    @property
    def component(self) -> int:
        """The direction in which it moves most."""
        return int(np.argmax(self.amplitude))


def wave_words(diameters: int) -> str:
    """A signed number of nodal diameters in words."""
    if diameters == 0:
        return "no nodal diameter"
    plural = "s" if abs(diameters) > 1 else ""
    sense = "forward" if diameters > 0 else "backward"
    return f"{abs(diameters)} nodal diameter{plural}, {sense}"


def main_wave(each: Looked, motion: BodyMotion) -> MainWave:
    """The strongest wave of two and more nodal diameters, above half the order of the teeth.

    Fewer are mostly the gear as a whole, on its shaft; they count if the rim shows no others.

    **Arguments:**

    - `each`: what is looked at.
    - `motion`: of its body.

    **Returns:**

    The wave.
    """
    waves = each.waves(motion)
    square = np.where(waves.order > each.low, np.sum(waves.size**2, axis=1), -1.0)
    bent = np.where(np.abs(waves.diameters) >= BENT, square, -1.0)
    best = int(np.argmax(bent if bent.max() > 0.0 else square))
    order, number = float(waves.order[best]), int(waves.diameters[best])
    travel = float(waves.travel[best]) if number else 0.0
    return MainWave(order, number, waves.strongest(order)[1], waves.size[best], travel)


def waves_summary(watch: WaveWatch, dataset: xr.Dataset) -> list[Summary]:
    """The `sweep.waves` part of the summary.

    **Arguments:**

    - `watch`: that looked.
    - `dataset`: from `waves_dataset`.

    **Returns:**

    One table for each condensed body.
    """
    way = dataset.attrs["peak_direction"]
    _, _, speed, motions = watch.best[way]
    found = []
    for gear, each in watch.looked.items():
        main, own = main_wave(each, motions[gear]), abs(motions[gear].speed)
        order = dataset[f"{gear}_order"].values
        probes = []
        for probe in each.probes:
            row = dataset[f"{gear}_probe_amplitude_um"].sel({f"{gear}_probe": probe.name}).values
            high = order > each.low
            strongest = float(order[high][np.argmax(row[high])])
            tooth = np.abs(order - each.body.teeth) < 1e-6
            probes.append(
                {
                    "name": probe.name,
                    "frame": "rotating" if probe.turns else "fixed",
                    "radius_mm": probe.place[0] / mm,
                    "angle_deg": probe.place[1] / deg,
                    "height_mm": probe.place[2] / mm,
                    "strongest_order": strongest,
                    "amplitude_um": float(row[high].max()),
                    "amplitude_at_teeth_um": float(row[tooth].sum()),
                }
            )
        found.append(
            {
                "gear": gear,
                "pinion_speed_rad_s": speed,
                "speed_rad_s": own,
                "order": main.order,
                "frequency_Hz": main.order * own / (2.0 * np.pi),
                "nodal_diameters": main.diameters,
                "wave": main.words,
                "share": main.share,
                "travel_rad_s": main.travel,
                "amplitude_um": dict(
                    zip(DIRECTIONS, (float(x) for x in main.amplitude / um), strict=True)
                ),
                "probes": probes,
                "largest": _largest(dataset, gear),
                "flank": loads_summary(dataset) if "max_line_load_N_mm" in dataset else None,
            }
        )
    return found


def _largest(dataset: xr.Dataset, gear: str) -> list[Summary]:
    """Where each wave is largest over all speeds."""
    total = np.sqrt(np.sum(dataset[f"{gear}_wave_rms_um"].values ** 2, axis=-1))
    found = []
    for wave, number in enumerate(dataset[f"{gear}_diameters"].values):
        own = total[:, :, wave]
        way, place = np.unravel_index(int(np.argmax(own)), own.shape)
        found.append(
            {
                "nodal_diameters": int(number),
                "pinion_speed_rad_s": float(dataset["speed"].values[place]),
                "direction": str(dataset["direction"].values[way]),
                "rms_um": float(own[way, place]),
            }
        )
    return found
