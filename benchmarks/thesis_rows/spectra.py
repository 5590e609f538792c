"""The power wheel over the speed: orders of the mesh force, and of nodes of its rim."""

import functools
import math
from typing import NamedTuple

import jax
import numpy as np

from jaxgear._dynamics._modes import pair_modes
from jaxgear._dynamics._orbit import Orbit
from jaxgear._response._body_motion import BodyMotion, Spectrum
from jaxgear._response._dynamic import order_amplitudes
from jaxgear.study._moving_body import moving_bodies
from jaxgear.study._probes import probe_at

from .energy import shares
from .finding import Finding
from .motion import Moving, moving, sweep
from .travelling import Rim, by_modes, crossings, motion_of, rim_of

um = 1e-6
SPEEDS = np.arange(300.0, 3001.0, 20.0)
# Orders of a node beside that of the teeth, as diameters with sign; the order is Z - n.
DIAMETERS = range(-10, 11)
_REST = 1100.0
# Of the pinion's mode (thesis: 840 rad/s), and of what the mesh must have of it.
_PINION, _FELT = (600.0, 1000.0), 0.02


class Spectra(NamedTuple):
    """What the power pair shows at `SPEEDS`.

    `each` pair; `orbits`; `ratio` dynamic [-]; `node` amplitude of a node of the rim by speed and
    `DIAMETERS`, radial [um]; `force` of the mesh's first four harmonics over the static force [-];
    `probe` RMS of a probe that stands still about its mean [um]; `rim` of the wheel.
    """

    each: Moving
    orbits: Orbit
    ratio: np.ndarray
    node: np.ndarray
    force: np.ndarray
    probe: np.ndarray
    rim: Rim

    def near(self, speed: float) -> int:
        """Number of the speed next to one."""
        return int(np.argmin(np.abs(SPEEDS - speed)))

    def motion(self, at: int) -> BodyMotion:
        """Motion of the wheel at one of the speeds."""
        orbit = jax.tree.map(lambda x: x[at], self.orbits)
        return motion_of(self.each, self.rim, orbit)

    def leading(self, at: int) -> list[int]:
        """Diameters of the node's orders, the largest first."""
        return [DIAMETERS[i] for i in np.argsort(-self.node[at])]


@functools.cache
def spectra() -> Spectra:
    """The sweep of `power-h1`."""
    each = moving("power-h1", "wheel.body.compare_seats=false")
    rim, teeth = rim_of(each), each.model.pair.wheel.teeth
    curve, orbits = sweep(each.system, SPEEDS)
    load = orbits.load[:, :, 0] / each.system.force
    force = np.asarray(jax.vmap(lambda own: order_amplitudes(each.system, own, 4))(load))
    found = Spectra(each, orbits, curve.ratio, np.empty(0), force, np.empty(0), rim)
    node, probe = [], []
    for at in range(len(SPEEDS)):
        motion = found.motion(at)
        # The first: radial, at the lower end of the rim, as the thesis's node.
        seen = by_modes(rim.body, rim.gauges[0], motion)
        fixed = by_modes(rim.body, rim.probes[0], motion)
        node.append([float(np.abs(seen.near(teeth - n))) / um for n in DIAMETERS])
        probe.append(math.sqrt(float(fixed.mean_square)) / um)
    return found._replace(node=np.asarray(node), probe=np.asarray(probe))


def _pinion_mode(found: Spectra) -> float:
    """Speed at which the mesh meets the pinion's mode [rad/s]."""
    modes = pair_modes(found.each.dynamics)
    teeth = found.each.model.pair.pinion.teeth
    speed = 2.0 * math.pi * np.asarray(modes.frequency) / teeth
    part = shares(modes)
    fit = (speed > _PINION[0]) & (speed < _PINION[1]) & (part["mesh"] > _FELT)
    return float(speed[np.argmax(np.where(fit, part["pinion"], -1.0))])


def orders() -> Finding:
    """Fig. IV-17 and IV-20: mesh force and a node's orders at three speeds."""
    found = Finding(
        "Mesh force and a node of the rim at a resonance of the wheel, of the pinion, and at none "
        "(Fig. IV-17, IV-20)",
        "the force is largest at the mesh's frequency and twice it, far lower at the speed without "
        "a resonance; the node shows orders 66 and 70 at the wheel's mode, 67 and 69 at the "
        "pinion's, nearly nothing off resonance",
        ["speed", "rad/s", *(f"force at {k}, %" for k in (1, 2, 3, 4)), "orders", "largest um"],
    )
    seen = spectra()
    wheel = seen.near(float(SPEEDS[np.argmax(seen.node.max(axis=1))]))
    at = {"wheel's": wheel, "pinion's": seen.near(_pinion_mode(seen)), "none": seen.near(_REST)}
    for label, i in at.items():
        first = ", ".join(f"{68 - n}" for n in seen.leading(i)[:3])
        force = [100.0 * float(x) for x in seen.force[i]]
        found.rows.append([label, float(SPEEDS[i]), *force, first, float(seen.node[i].max())])
    force = {label: seen.force[i] for label, i in at.items()}
    node = {label: seen.node[i].max() for label, i in at.items()}
    found.holds = {
        "the force is largest at the mesh's frequency or twice it": all(
            int(np.argmax(force[label])) < 2 for label in ("wheel's", "pinion's")
        ),
        "without a resonance it is less than half of that": 2.0 * force["none"].max()
        < min(force["wheel's"].max(), force["pinion's"].max()),
        "orders 66 and 70 are the largest at the wheel's mode": set(seen.leading(wheel)[:2])
        == {-2, 2},
        "orders 67 and 69 are the largest at the pinion's mode": set(
            seen.leading(at["pinion's"])[:2]
        )
        == {-1, 1},
        "the node moves less than a fifth of it at the pinion's mode": 5.0 * node["pinion's"]
        < node["wheel's"],
        "... and off resonance": 5.0 * node["none"] < node["wheel's"],
    }
    return found


def three_nodes() -> Finding:
    """Fig. IV-21 to IV-23: three nodes of the rim, a third of a turn apart."""
    found = Finding(
        "Three nodes of the rim at the wheel's resonance, orders 60 to 76 (Fig. IV-21 to IV-23)",
        "the three are out of phase, also without the low orders of the wheel's rotation",
        ["node", "order", "amplitude um", "phase behind the first, degrees", "likeness to it"],
    )
    seen = spectra()
    at = int(np.argmax(seen.node.max(axis=1)))
    each, teeth = seen.each, 68
    body = moving_bodies(each.scene.bodies, each.scene.gears)["wheel"]
    height = float(body.built.body.rim_nodes[:, 2].min())
    motion, strongest = seen.motion(at), teeth - seen.leading(at)[0]
    first: Spectrum | None = None
    apart, like, sizes = [], [], []
    turn = np.linspace(0.0, 2.0 * np.pi, 4096, endpoint=False)
    for third in range(3):
        place = body.radius, third * 2.0 * math.pi / 3.0, height
        whole = by_modes(body, probe_at(body, place, 0, turns=True, name=""), motion)
        band = np.abs(whole.order - teeth) <= 8.0
        own = Spectrum(whole.order, np.where(band, whole.amplitude, 0.0))
        first = own if first is None else first
        phase = np.angle(complex(own.near(strongest)) / complex(first.near(strongest)))
        alike = float(np.corrcoef(own.at(turn), first.at(turn))[0, 1])
        size = float(np.abs(own.near(strongest))) / um
        found.rows.append([str(third + 1), float(strongest), size, math.degrees(phase), alike])
        apart.append(math.degrees(phase) % 360.0)
        like.append(alike)
        sizes.append(size)
    # A wave of n diameters passes a node n thirds of a turn later: 240 or 120 degrees for two.
    # There is a node every 2.6 degrees.
    found.holds = {
        "the band that is left shows the same amplitude at all three": max(sizes)
        < 1.01 * min(sizes),
        "their phases are a third of a turn apart": all(
            min(abs(a - x) for x in (120.0, 240.0)) < 3.0 for a in apart[1:]
        )
        and abs(apart[1] - apart[2]) > 100.0,
        "so their signals are not alike": max(like[1:]) < 0.5,
    }
    return found


def webs_at_speed() -> Finding:
    """Fig. IV-24, IV-25 and III-46 to III-50: waves of a node at and between resonances."""
    found = Finding(
        "Orders of a node of the rim at and between critical speeds (Fig. IV-24, III-46 to III-50)",
        "one wave of three diameters at one speed, of two and four at another; between two close "
        "resonances both show; off resonance the next one; the sum of all orders peaks where a "
        "probe that stands still does",
        ["what", "rad/s", "first", "um", "second", "um", "third", "um"],
    )
    seen = spectra()
    amplitude = lambda at, n: float(seen.node[at, DIAMETERS.index(n)])

    def tell(what: str, at: int) -> list[int]:
        first = seen.leading(at)[:3]
        shown = [x for n in first for x in (f"{n:+d}", amplitude(at, n))]
        found.rows.append([what, float(SPEEDS[at]), *shown])
        return first

    fast = SPEEDS > 1300.0
    moved = seen.node.max(axis=1)
    loud = fast & (moved > np.median(moved[fast]))
    alone = int(np.argmax(np.where(fast, seen.node[:, DIAMETERS.index(3)], 0.0)))
    three = tell("+3 alone", alone)
    # Where the lesser of the two is most over the largest of all others.
    pair = [max(amplitude(at, n) for n in (-2, 2)) for at in range(len(SPEEDS))]
    four = [max(amplitude(at, n) for n in (-4, 4)) for at in range(len(SPEEDS))]
    both = np.where(loud, np.minimum(pair, four), 0.0) / moved
    mixed = int(np.argmax(both))
    tell("2 and 4 at once", mixed)
    waves = {
        row.diameters * row.direction: row.speed
        for row in crossings(seen.each)
        if row.speed > 2200.0
    }
    close = seen.near(0.5 * (waves[-2] + waves[2])) if {-2, 2} <= set(waves) else mixed
    between = tell("between -2 and +2", close)
    resting = tell("off resonance", seen.near(_REST))
    total = np.sqrt(0.5 * np.sum(seen.node**2, axis=1))
    sum_peaks, probe_peaks = _peaks(total), _peaks(seen.probe)
    met = [x for x in probe_peaks if min(abs(x - y) for y in sum_peaks) <= 40.0]
    found.rows.append(["peaks of a probe", float(len(probe_peaks)), *[None] * 6])
    found.rows.append(["... of the sum of orders too", float(len(met)), *[None] * 6])
    found.holds = {
        "+3 stands alone: all others are less than half": three[0] == 3
        and amplitude(alone, three[1]) < 0.5 * amplitude(alone, 3),
        "2 and 4 diameters both show at one speed, the lesser over half of all": float(both[mixed])
        > 0.5,
        "between two close resonances both waves are the largest": set(between[:2]) == {-2, 2},
        "off resonance several waves show": amplitude(seen.near(_REST), resting[2])
        > 0.25 * amplitude(seen.near(_REST), resting[0]),
        "three of four peaks of a probe that stands still are peaks of the sum of the orders": len(
            met
        )
        >= 0.75 * len(probe_peaks),
    }
    return found


def _peaks(values: np.ndarray) -> list[float]:
    """Speeds of local maxima that rise by a fifth over the lower of the valleys beside them."""
    tops = 1 + np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] > values[2:]))
    edges = [0, *tops, len(values) - 1]
    kept = []
    for left, top, right in zip(edges, tops, edges[2:], strict=False):
        valley = max(values[left : top + 1].min(), values[top : right + 1].min())
        if values[top] > 1.2 * valley:
            kept.append(float(SPEEDS[top]))
    return kept
