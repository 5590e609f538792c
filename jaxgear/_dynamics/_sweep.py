"""Speed sweeps: from speed to speed along a branch, as a machine would, or cold at each.

A sweep follows a stable response by harmonic balance, judges it by its residual and its Floquet
multipliers, and where it ends, at a fold or a doubling of the period, does what the machine does:
it steps on in time from the last motion until a response of one or two cycles is found. A speed at
which none is found keeps its last cycles, and says so.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import get_args

import jax.numpy as jnp
import numpy as np

from jaxgear._checks import require
from jaxgear._dynamics._floquet import leading_multipliers, monodromy, slow_modes
from jaxgear._dynamics._found_responses import SAME, FoundResponses
from jaxgear._dynamics._harmonic import (
    Balance,
    HarmonicBalance,
    fourier_coefficients,
    harmonic_balance_problem,
)
from jaxgear._dynamics._harmonic_problem import is_long
from jaxgear._dynamics._march import TimeHistory, TimeStepping, march_on, quasi_static_start
from jaxgear._dynamics._orbit import Orbit
from jaxgear._dynamics._shooting import Shooting
from jaxgear._dynamics._steady_state import orbit_of
from jaxgear._dynamics._steppers import Exponential
from jaxgear._dynamics._sweep_types import Direction, SweepPoint, SweepSettings
from jaxgear._dynamics._system import DynamicSystem, modal_basis
from jaxgear._dynamics._table import ready_to_bear
from jaxgear._dynamics._types import Start, StepPlaces, Terms
from jaxgear._dynamics._windows import monodromy_of
from jaxgear._types import Scalar

# Where no periodic response is found after a march, the march goes on for so many times as long. An
# unstable response is left from a state that differs by so much, relative to the static one.
_PATIENCE, _DISTURBANCE = 5, 0.1

# A response counts as that in which a march ends if it is nowhere further from the last cycles of
# the march than by this part of their swing.
_APART = 0.3

# From one speed to the next a vibration may change so far, in its swing or, where that is more, in
# the static deflection: no jump is as small. Where it would change further, or is lost, the way
# there is halved, at most so often; and where that does not help either, it is asked whether the
# machine would go there. Steps along one branch move by less than 0.25 on the coarsest grids of
# speeds that were tried, a false one by 0.7. Over a long cycle a part takes ten seconds and more.
_STEP, _SLIGHT, _HALVINGS, _HALVINGS_OF_LONG = 0.3, 0.01, 5, 2

# It also counts if a march of several times the length has come closer to it by this factor.
_APPROACH = 0.8


def sweep(
    system: DynamicSystem,
    speeds: Sequence[float] | np.ndarray,
    direction: Direction = "up",
    settings: SweepSettings = SweepSettings(),
    *,
    done: Callable[[int], None] = lambda count: None,
) -> tuple[SweepPoint, ...]:
    """Find the response at each speed, each from that before it.

    Not for tracing: what is done at a speed depends on what was found. For derivatives, take the
    points' `multiple` and harmonics to `HarmonicBalance.solve`.

    **Arguments:**

    - `system`: what moves.
    - `speeds`: of the pinion, positive [rad/s].
    - `direction`: "up" or "down", in that order of speeds, or "cold": each speed from the
        quasi-static state.
    - `settings`: how.
    - `done`: told how many more speeds are finished.

    **Returns:**

    A point for each speed, in the order of `speeds`.

    **Raises:**

    - `ValueError` if there is no speed, or one that is not positive.
    """
    require(
        direction in get_args(Direction),
        "`direction` must be one of {known}, got {got!r}. For both directions, sweep twice.",
        known=", ".join(get_args(Direction)),
        got=direction,
    )
    values = np.asarray(speeds, dtype=float)
    require(values.size > 0, "A sweep needs at least one speed.")
    require(
        bool(np.all(values > 0.0)),
        "All speeds of a sweep must be positive, got {got:.6g} rad/s.",
        got=float(values.min()),
    )
    order = np.argsort(values)
    order = order[::-1] if direction == "down" else order
    finder = Finder(system, settings)
    points: dict[int, SweepPoint] = {}
    last = None
    for index in order:
        point = finder.next(jnp.asarray(values[index]), last)
        points[int(index)] = point
        last = None if direction == "cold" else point
        done(1)
    return tuple(points[index] for index in range(values.size))


class Finder:
    """Looks for the response at one speed after the other, for those who keep less than `sweep`.

    It holds the programs of one system, each compiled when it is first needed, and what it has
    found.
    """

    def __init__(self, system: DynamicSystem, settings: SweepSettings):
        system = dataclasses.replace(system, table=ready_to_bear(system.table))
        self.system, self.settings = system, settings
        self.modes = modal_basis(system)
        self.slow = slow_modes(self.modes)
        self.rest = quasi_static_start(system)
        method = settings.method
        self.harmonic = method if isinstance(method, HarmonicBalance) else HarmonicBalance()
        # Whatever is looked for obeys the law of the sweep.
        self.shooting = dataclasses.replace(settings.shooting, law=method.law)
        self.balances: dict[int, Balance] = {}
        self.found = FoundResponses()
        # Whether the way to the last speed was too far for one step.
        self.far = False

    def next(self, speed: Scalar, last: SweepPoint | None) -> SweepPoint:
        """Find the response at a speed that follows `last`.

        **Arguments:**

        - `speed`: of the pinion [rad/s].
        - `last`: the response at the speed before, or `None`: start from the quasi-static state.

        **Returns:**

        The response, settled and stable, or what time stepping leaves.
        """
        method = self.settings.method
        start = self.rest if last is None else last.orbit.start
        if isinstance(method, TimeStepping):
            return self._alone(orbit_of(_over_cycles(method, 2), self.system, speed, start))
        if isinstance(method, Shooting):
            twice = last is not None and last.multiple == 2
            found = self._shot(method, speed, start, (2, 1) if twice else (1, 2))
            return found or self._searched(method, speed, start)
        if last is None:
            self.far = False
            found = self._judged(self._balanced(speed, 1, self._balance(1).rest))
            return found if found.stable else self._left(found, speed, start)
        # One step that would be too long again is not tried.
        step = self._halved if self.far and last.settled else self._followed
        long = is_long(self._balance(1).rest.size)
        found = step(speed, last, _HALVINGS_OF_LONG if long else _HALVINGS)
        self.far = not self._near(found, last.orbit.place)
        return found

    def beside(self, speed: Scalar, terms: Terms) -> SweepPoint | None:
        """The stable response close to one over a cycle that is guessed, if there is one.

        **Arguments:**

        - `speed`: of the pinion [rad/s].
        - `terms`: harmonics of the mesh coordinates, as of `fourier_coefficients` [m, rad].
        """
        found = self._balanced(speed, 1, terms)
        if not self.is_beside(found, terms):
            return None
        found = self._judged(found)
        return found if found.stable else None

    def is_beside(self, point: SweepPoint, terms: Terms) -> bool:
        """Whether a response is close to one over a cycle with these harmonics."""
        return self._near(point, self._balance(1).middle @ terms.T)

    def _followed(self, speed: Scalar, last: SweepPoint, halvings: int) -> SweepPoint:
        """The response at a speed that follows one close by, in smaller steps where it is lost."""
        if not last.settled:
            # What does not repeat is not left for a response that does, unless it ends there.
            return self._searched(self.shooting, speed, last.orbit.start)
        found = self._beside_last(speed, last)
        near = self._near(found, last.orbit.place)
        if halvings > 0 and not near:
            return self._halved(speed, last, halvings)
        found = self._judged(found)
        if near and found.stable:
            return found
        return self._left(found, speed, last.orbit.start)

    def _near(self, found: SweepPoint, last: StepPlaces) -> bool:
        """Whether a response has settled within one step of mesh coordinates.

        About their means: bodies that grow with speed move these, within one branch.
        """
        return found.settled and self._in_a_step(*_last(found, last))

    def _in_a_step(self, new: np.ndarray, old: np.ndarray) -> bool:
        """Whether approaches are within one step of each other, about their means."""
        new, old = new - new.mean(), old - old.mean()
        step = max(_STEP * np.ptp(old), _SLIGHT * self.deflection)
        return bool(np.abs(new - old).max() <= step)

    def _beside_last(self, speed: Scalar, last: SweepPoint) -> SweepPoint:
        """What harmonic balance finds from the last response, if not found before beside it."""
        before, multiple = np.asarray(last.orbit.place)[:, 0], last.multiple
        for each in self.found.at(speed, multiple):
            if self._in_a_step(each.approach, before):
                return each.point or self._balanced(speed, multiple, each.terms)
        return self._balanced(speed, multiple, self._harmonics(multiple, last.orbit.place))

    def _halved(self, speed: Scalar, last: SweepPoint, halvings: int) -> SweepPoint:
        """The same in two steps."""
        middle = self._followed(0.5 * (speed + last.orbit.speed), last, halvings - 1)
        return self._followed(speed, middle, halvings - 1)

    def _left(self, found: SweepPoint, speed: Scalar, start: Start) -> SweepPoint:
        """Where the machine goes from a response that is not stable, or far from the last one."""
        # Newton's method may leave a branch that goes on: whether it ends, a march tells.
        if found.settled and not found.stable:
            start = self._disturbed(found)
        found = self._searched(self.shooting, speed, start)
        if not found.settled:
            return found
        # Of two methods that agree, the one that all other speeds have.
        terms = self._harmonics(found.multiple, found.orbit.place)
        polished = self._judged(self._balanced(speed, found.multiple, terms))
        return polished if _apart(polished, found.orbit) < _APART else found

    def _balanced(self, speed: Scalar, multiple: int, first: Terms) -> SweepPoint:
        """What harmonic balance finds from harmonics of the mesh coordinates."""
        method, balance = _over_cycles(self.harmonic, multiple), self._balance(multiple)
        orbit, terms = method.solve(balance, speed, first)
        found = self._alone(orbit)
        if found.settled and found.multiple == multiple:
            self.found.keep(found, terms)
        return found

    def _harmonics(self, multiple: int, near: StepPlaces) -> Terms:
        """Harmonics of the mesh coordinates of a response close by."""
        return fourier_coefficients(self._balance(multiple), near)

    def _balance(self, multiple: int) -> Balance:
        """What the balances of responses over so many cycles share, prepared once."""
        if multiple not in self.balances:
            method = _over_cycles(self.harmonic, multiple)
            self.balances[multiple] = harmonic_balance_problem(method, self.system)
        return self.balances[multiple]

    @property
    def deflection(self) -> float:
        """Static deflection of the mesh [m]."""
        return float(np.asarray(self._balance(1).scales)[0])

    def _searched(self, method: Shooting, speed: Scalar, start: Start) -> SweepPoint:
        """The response that a march from a motion ends in: soon, or after a longer while."""
        history = self._on(speed, start, self.settings.cycles)
        found = self._near_to(method, speed, history)
        apart = _apart(found, history)
        if apart > _APART:
            history = self._on(speed, _state(history), _PATIENCE * self.settings.cycles)
            found, before = self._near_to(method, speed, history), apart
            apart = _apart(found, history)
            # A slow approach to a response is one.
            apart = 0.0 if apart < min(_APPROACH * before, 1.0) and before < np.inf else apart
        return self._unsettled(history) if found is None or apart > _APART else found

    def _near_to(self, method: Shooting, speed: Scalar, history: TimeHistory) -> SweepPoint | None:
        """A stable response close to where a march has come, or a stable one that it points to.

        One that harmonic balance finds close by is found without shooting, whose corrections ask
        all modes.
        """
        if isinstance(self.settings.method, HarmonicBalance):
            last = history.place[-len(self.system.table.kinds) :]
            found = self._judged(self._balanced(speed, 1, self._harmonics(1, last)))
            if _apart(found, history) <= _APART:
                return found
        return self._shot(method, speed, _state(history))

    def _on(self, speed: Scalar, start: Start, cycles: int) -> TimeHistory:
        """March on by at least so many cycles. One program serves for all marches."""
        kept = self.settings.kept
        times = jnp.asarray(-(-cycles // kept))
        law, rule = self.settings.method.law, Exponential()
        return march_on(self.system, speed, start, self.modes, law, times, keep=kept, stepper=rule)

    def _shot(
        self, method: Shooting, speed: Scalar, start: Start, multiples: tuple[int, ...] = (1, 2)
    ) -> SweepPoint | None:
        """A stable response over one cycle or two by shooting, from a motion close by."""
        for multiple in multiples:
            orbit = orbit_of(_over_cycles(method, multiple), self.system, speed, start)
            found = self._judged(self._alone(orbit))
            if found.stable:
                return found
        return None

    def _judged(self, point: SweepPoint) -> SweepPoint:
        """The response with its multipliers, if it has settled."""
        if not point.settled:
            return point
        known = self.found.same(point)
        if known is not None and known.multipliers is not None:
            return dataclasses.replace(point, multipliers=known.multipliers)
        law, slow = self.settings.method.law, self.slow
        matrix, _ = monodromy_of(self.system, law, slow, point.orbit.speed, point.orbit.place)
        multipliers = leading_multipliers(matrix, slow.basis)
        if known is not None:
            known.multipliers = multipliers
        return dataclasses.replace(point, multipliers=multipliers)

    def _disturbed(self, point: SweepPoint) -> Start:
        """A start beside an unstable response, where it is left fastest."""
        law = self.settings.method.law
        matrix = np.asarray(monodromy(self.system, self.modes, point.orbit, law=law))
        weights = np.asarray(self.modes.swing).reshape(-1)
        values, vectors = np.linalg.eig(matrix * weights[:, None] / weights[None, :])
        away = np.real(vectors[:, np.argmax(np.abs(values))])
        onto = np.asarray(self.modes.shape.T @ self.system.mass)
        state = (np.asarray(point.orbit.start) @ onto.T).reshape(-1) * weights
        state = state + _DISTURBANCE * np.linalg.norm(state) / np.linalg.norm(away) * away
        return jnp.asarray((state / weights).reshape(2, -1)) @ self.modes.shape.T

    def _alone(self, orbit: Orbit) -> SweepPoint:
        """The response over as many cycles as it needs."""
        steps = len(self.system.table.kinds)
        multiple = orbit.place.shape[0] // steps
        none = np.zeros(0, dtype=complex)
        approach = np.asarray(orbit.place)[:, 0]
        first, second = approach[:steps], approach[-steps:]
        apart = np.abs(first - second).max()
        if multiple == 2 and bool(orbit.settled) and apart <= SAME * np.ptp(first):
            halved = {name: getattr(orbit, name)[:steps] for name in ("place", "load", "motion")}
            return SweepPoint(dataclasses.replace(orbit, **halved), 1, none)
        return SweepPoint(orbit, multiple, none)

    def _unsettled(self, history: TimeHistory) -> SweepPoint:
        """What a march leaves where no periodic response is found."""
        orbit = Orbit(
            speed=history.speed,
            place=history.place,
            load=history.load,
            motion=history.middle,
            start=_state(history),
            residual=history.drift[-1],
            settled=jnp.asarray(False),
            steps=jnp.asarray(float(self.settings.cycles)),
        )
        return SweepPoint(orbit, self.settings.kept, np.zeros(0, dtype=complex))


def _apart(point: SweepPoint | None, other: Orbit | TimeHistory) -> float:
    """How far a stable response lies from the last cycles of a motion, over its swing [-]."""
    return np.inf if point is None or not point.stable else _moved(point, other)


def _moved(point: SweepPoint, other: Orbit | TimeHistory) -> float:
    """How far a response lies from the last cycles of a motion, over its swing [-]."""
    own, last = _last(point, other.place)
    return float(np.abs(own - last).max() / np.ptp(last))


def _last(point: SweepPoint, other: StepPlaces) -> tuple[np.ndarray, np.ndarray]:
    """Approach of a response, and of a motion in its last cycles, equally long [m]."""
    own = point.orbit.place
    steps = max(own.shape[0], min(other.shape[0], 2 * own.shape[0]))
    last = lambda place: np.resize(np.asarray(place)[-steps:, 0], steps)
    return last(own), last(other)


def _over_cycles(method, multiple: int):
    """The same method for responses over so many cycles."""
    return dataclasses.replace(method, multiple=multiple)


def _state(history: TimeHistory) -> Start:
    """Motion and velocity where a march ended [m, rad, m/s, rad/s]."""
    return jnp.stack([history.motion[-1], history.velocity[-1]])
