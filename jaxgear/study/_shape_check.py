"""How far off a sweep is for the shapes on which its condensed bodies vibrate.

Excited shapes are combinations of several times as many natural modes. At a few speeds all of these
show what the bodies do under the forces of a response, or twice as many natural modes where shapes
are natural modes. What the response lacks of it brings cells closer and loads the seats; so the
response is found again (theory 11.9). The difference is an estimate of what the shapes leave out,
in the loads that the response really has.
"""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxgear._contact._root_influence import Influences
from jaxgear._dynamics._harmonic import Balance, HarmonicBalance, harmonic_balance_problem
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._system import PairDynamics
from jaxgear._dynamics._table import ready_to_bear
from jaxgear._dynamics._types import Terms
from jaxgear._response._left_out import LeftOut, left_out, mixed, still_apart
from jaxgear._response._measured import measured
from jaxgear._response._whole_motion import WholeBody
from jaxgear._types import Scalar
from jaxgear.scene._build import law_of
from jaxgear.scene._scene import Scene
from jaxgear.study._body_waves import WaveWatch
from jaxgear.study._built import BuiltScene
from jaxgear.study._dynamics import Dynamics, settings_of, size_of
from jaxgear.study._fidelity._level import FLOOR
from jaxgear.study._ranks import Doubtful
from jaxgear.study._result import Summary
from jaxgear.study._sweeping import Sweep, alike

# At most so many speeds, one for so many of the sweep; how far off a response may be unsaid [-].
_MOST, _EACH, _TOLERANCE = 4, 8, 0.01

# A response is found again until its numbers change by less than this, or what is left out of it
# is what it was given but for so much of what was left out first, or so often [-].
_SMALL, _CLOSED, _ROUNDS = 0.001, 0.3, 6


class ShapeCheck(NamedTuple):
    """Responses at a few speeds, and how far off they are from those with more modes.

    **Fields:**

    - `speeds`: of the pinion [rad/s].
    - `modes`, `shapes`: natural modes of all bodies with many, and shapes of those with few.
    - `force`, `te_rms`: estimates of the relative errors of the largest mesh force and of the RMS
        of transmission error at each; NaN where a response was not found again [-].
    """

    speeds: np.ndarray
    modes: int
    shapes: int
    force: np.ndarray
    te_rms: np.ndarray

    @property
    def summary(self) -> Summary:
        """What a summary tells of it."""
        known = lambda values: [float(x) if np.isfinite(x) else None for x in values]
        return {
            "pinion_speed_rad_s": self.speeds,
            "natural_modes": self.modes,
            "shapes": self.shapes,
            "error_dynamic_ratio": known(self.force),
            "error_te_rms": known(self.te_rms),
        }

    @property
    def notes(self) -> list[str]:
        """A warning, where the shapes are too few."""
        found = []
        words = ("largest mesh force", self.force), ("RMS of transmission error", self.te_rms)
        for what, errors in words:
            if np.any(np.abs(errors) > _TOLERANCE):
                worst = int(np.nanargmax(np.abs(errors)))
                found.append(
                    Doubtful(
                        f"With {self.modes} natural modes of condensed bodies in place of the "
                        f"{self.shapes} shapes the {what} at {self.speeds[worst]:.5g} rad/s is "
                        f"about {100.0 * abs(errors[worst]):.2g} % "
                        f"{'larger' if errors[worst] < 0.0 else 'smaller'}: raise "
                        "model.coordinates, or let teeth meet softer by tip relief."
                    )
                )
        return found


def shape_check(
    built: BuiltScene, dynamics: Dynamics, watch: WaveWatch, found: Sweep
) -> ShapeCheck | None:
    """Estimate how far off responses of a sweep are, by all modes of which shapes are made.

    **Arguments:**

    - `built`: the scene with its bodies.
    - `dynamics`: its pair in motion.
    - `watch`: what looks at these bodies.
    - `found`: the sweep.

    **Returns:**

    The errors; or `None` where no shapes are left out, where the sweep does not go by harmonic
    balance, or where nothing has settled.
    """
    scene, pair = built.scene, dynamics.pair
    method = settings_of(law_of(scene.mesh), scene.sweep, size_of(pair)).method
    chosen = _some(found)
    if not (chosen.size and isinstance(method, HarmonicBalance)):
        return None
    wholes = judging_bodies(scene, watch)
    if wholes is None:
        return None
    ready = ready_to_bear(pair.system.table)
    moving = eqx.tree_at(lambda each: each.system.table, pair, ready)
    least = least_error(pair)
    balance, influences = (
        harmonic_balance_problem(method, moving.system),
        dynamics.statics.influences,
    )
    again = Again(method, moving, balance, wholes, scene.sweep.orders, least, influences)
    own = [found.responses[found.main][place].numbers for place in chosen]
    ratios = [float(one.dynamic_ratio) for one in own]
    better = [again.better(*each) for each in zip(found.speeds[chosen], ratios, strict=True)]
    ratio, te_rms = np.array(better).T
    off = np.array([float(one.te_rms) for one in own]) - te_rms
    return ShapeCheck(
        speeds=found.speeds[chosen],
        modes=sum(len(whole.modes.waves) for whole in wholes.values()),
        shapes=sum(len(place.waves) for place in pair.bodies),
        force=np.array(ratios) / ratio - 1.0,
        te_rms=off / np.maximum(te_rms, least),
    )


def least_error(pair: PairDynamics) -> float:
    """RMS of transmission error of which nobody needs a part [m]."""
    return FLOOR * float(np.mean(np.asarray(pair.cycle.approach)))


def judging_bodies(scene: Scene, watch: WaveWatch) -> dict[int, WholeBody] | None:
    """Bodies on more natural modes than they have motions, by index; `None`: there are no more."""
    wholes, more = {}, False
    for gear, looked in watch.looked.items():
        whole, richer = looked.whole, scene.bodies[gear].more_modes
        if richer is not None:
            more, (flexible, into) = True, richer
            # Where shapes are combinations of them, the waves told are of these modes already.
            if flexible is not whole.flexible:
                whole = dataclasses.replace(whole, flexible=flexible, into=into)
        wholes[looked.body.index] = whole
    return wholes if more else None


class Again(NamedTuple):
    """Finds responses of a sweep again, by its own programs, with what shapes leave out.

    **Fields:**

    - `method`: of the sweep.
    - `pair`: in motion, made `ready_to_bear`.
    - `balance`: of its responses.
    - `wholes`: its bodies on many modes, by index.
    - `orders`: of the mesh that the sweep measures.
    - `least`: RMS of transmission error of which nobody needs a part [m].
    - `influences`: of loads on the roots, where the sweep measures their stresses.
    """

    method: HarmonicBalance
    pair: PairDynamics
    balance: Balance
    wholes: Mapping[int, WholeBody]
    orders: int
    least: float
    influences: Influences | None = None

    def better(self, speed: float, ratio: float) -> tuple[float, float]:
        """Dynamic ratio and RMS of transmission error [m] with what shapes leave out.

        NaN where a response of that speed [rad/s] and dynamic ratio is not found again.
        """
        at, lost = jnp.asarray(float(speed)), (np.nan, np.nan)
        orbit, terms = self._found(self.pair, at, None, None)
        pair, numbers = self.pair, self.read(self.pair, orbit)
        if not orbit.settled or not alike(ratio, numbers[0]):
            return lost
        least = np.array([0.0, self.least])
        given: list[LeftOut] = []
        found: list[LeftOut] = []
        for _ in range(_ROUNDS):
            left = left_out(self.wholes, pair, orbit, self.method.law, self.method.harmonics)
            given += [] if given else [LeftOut(0.0 * left.closer, 0.0 * left.load)]
            found.append(left)
            if still_apart(given[-1], found) < _CLOSED:
                break
            given.append(mixed(given, found))
            pair = self._with(given[-1])
            orbit, terms = self._found(pair, at, given[-1], terms)
            if not orbit.settled:
                return lost
            before, numbers = numbers, self.read(pair, orbit)
            change = np.abs(np.subtract(numbers, before)) / np.maximum(numbers, least)
            if change.max() < _SMALL:
                break
        return numbers

    def _with(self, left: LeftOut) -> PairDynamics:
        """The pair with cells closer by so much."""
        table = self.pair.system.table
        table = dataclasses.replace(table, gap=table.gap - left.closer[None], ready=None)
        return eqx.tree_at(lambda x: x.system.table, self.pair, ready_to_bear(table))

    def _found(
        self, pair: PairDynamics, speed: Scalar, left: LeftOut | None, near: Terms | None
    ) -> tuple[Orbit, Terms]:
        """A response under loads of what is left out, from harmonics close by or from rest."""
        balance = self.balance.with_cells(pair.system.table)
        if left is not None:
            balance = dataclasses.replace(balance, beside=jnp.asarray(left.load))
        return self.method.solve(balance, speed, balance.rest if near is None else near)

    def read(self, pair: PairDynamics, orbit: Orbit) -> tuple[float, float]:
        """Dynamic ratio, and RMS of transmission error [m]."""
        numbers = measured(pair, orbit, self.method.law, self.orders, self.influences)
        return float(numbers.dynamic_ratio), float(numbers.te_rms)


def _some(found: Sweep) -> np.ndarray:
    """Places of a few speeds where one response has settled: that of the highest, and others."""
    ways = list(found.responses.values())
    alone = [
        place
        for place, first in enumerate(ways[0])
        if all(way[place].settled and not way[place].differs(first) for way in ways)
    ]
    if not alone:
        return np.zeros(0, dtype=int)
    count = min(_MOST, -(-len(found.speeds) // _EACH))
    highest = max(alone, key=lambda place: ways[0][place].dynamic_ratio)
    # Where a cold start must find the same response, none of the others may be a guess.
    spread = np.linspace(0, len(alone) - 1, count + 1)[1:].round().astype(int)
    others = [alone[i] for i in spread if alone[i] != highest]
    return np.sort([highest, *others[: count - 1]])
