"""Points on a curve of orbits: found by Newton's method, asked for folds and bifurcations."""

import concurrent.futures
import itertools
from collections.abc import Callable
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from jaxgear._dynamics._branch import (
    CorrectedPoint,
    PointResponse,
    correction,
    correction_at_speed,
    seen_of,
)
from jaxgear._dynamics._floquet import STABLE, leading_multipliers, slow_modes
from jaxgear._dynamics._harmonic import Balance, HarmonicBalance
from jaxgear._dynamics._windows import MeshVariation, monodromy_of, windows_of


class Place(NamedTuple):
    """A point of a branch, and what is known of it."""

    unknowns: np.ndarray
    tangent: np.ndarray
    steps: int
    seen: PointResponse | None = None
    ratio: float = np.nan
    te_rms: float = np.nan
    multiplier: complex = complex(np.nan, np.nan)
    # Sign and logarithm of det(1 + M): it passes through zero as a multiplier passes through -1.
    doubling: tuple[float, float] = (1.0, 0.0)
    # Logarithm of the largest size of a complex multiplier.
    ring: float = -np.inf
    # Speeds near which it may be unstable.
    windows: tuple[float, ...] = ()

    @property
    def is_stable(self) -> bool:
        """Whether its multipliers say so."""
        return abs(self.multiplier) <= STABLE


def hides_event(here: Place, ahead: Place) -> bool:
    """Whether speed turns twice between two points, by the cubic through their tangents."""
    first, last = here.tangent[-1], ahead.tangent[-1]
    step = distance_between(ahead.unknowns, here.unknowns)
    between = 1.5 * (ahead.unknowns[-1] - here.unknowns[-1]) / step - 0.25 * (first + last)
    rises = (first + last) * (abs(first + last) > _UPRIGHT)
    return bool(first * last > -(_UPRIGHT**2) and between * rises < 0.0)


class LostError(Exception):
    """Newton's method failed within a step that had been taken."""


class Guide:
    """Takes steps along the branches of one balance."""

    def __init__(self, method: HarmonicBalance, balance: Balance, *, stability: bool):
        self.method, self.balance = method, balance
        self.tolerance = method.tolerance
        self.multiple = method.multiple
        self.stability = stability
        self.slow = slow_modes(balance.modes)
        self.steps = 0

    def correct(self, first: np.ndarray, normal: np.ndarray, value: float) -> Place | None:
        """The point in a plane, or nothing."""
        return self._place(
            jax.device_get(
                correction(self.balance, *map(jnp.asarray, (first, normal, value, self.tolerance)))
            )
        )

    def correct_at_speed(self, first: np.ndarray, way: float) -> Place | None:
        """The point at the speed of a guess, its tangent up or down in speed; or nothing."""
        found, seen = jax.device_get(
            correction_at_speed(self.method, self.balance, jnp.asarray(first))
        )
        point = self._place(found)
        if point is None:
            return None
        return point._replace(tangent=np.copysign(1.0, way) * point.tangent, seen=seen)

    def _place(self, found: CorrectedPoint) -> Place | None:
        self.steps += int(found.steps)
        settled = bool(found.error <= self.tolerance) and bool(np.all(np.isfinite(found.tangent)))
        unknowns, tangent = np.asarray(found.unknowns), np.asarray(found.tangent)
        return Place(unknowns, tangent, int(found.steps)) if settled else None

    def see(self, point: Place) -> Place:
        """A point with all that is to be known of it."""
        point, matrix, _ = self._looked_at(point)
        return self._judged(point, matrix)

    def _looked_at(self, point: Place) -> tuple[Place, np.ndarray | None, MeshVariation | None]:
        """A point whose response is known, and of what its stability is found if asked for."""
        unknowns = jnp.asarray(point.unknowns)
        seen = point.seen or jax.device_get(seen_of(self.balance, unknowns))
        point = point._replace(seen=None, ratio=float(seen.ratio), te_rms=float(seen.te_rms))
        if not self.stability:
            return point, None, None
        system, law = self.balance.system, self.balance.law
        speed, place = jnp.asarray(np.exp(point.unknowns[-1])), jnp.asarray(seen.place)
        found = monodromy_of(system, law, self.slow, speed, place)
        return point, *jax.device_get(found)

    def _judged(self, point: Place, matrix: np.ndarray | None) -> Place:
        """A point with its stability, by its monodromy matrix."""
        if matrix is None:
            return point
        found = leading_multipliers(matrix, self.slow.basis)
        sign, size = np.linalg.slogdet(np.eye(len(matrix)) + matrix)
        pairs = found[np.imag(found) != 0.0]
        return point._replace(
            multiplier=complex(found[0]),
            doubling=(float(sign), float(size)),
            ring=float(np.log(np.abs(pairs[0]))) if pairs.size else -np.inf,
        )

    def _judged_around(
        self, point: Place, matrix: np.ndarray | None, variation: MeshVariation | None
    ) -> Place:
        """A point with its stability, and where near it this may be another."""
        windows = () if variation is None else tuple(np.log(windows_of(variation)))
        return self._judged(point, matrix)._replace(windows=windows)

    def see_all(self, points: list[Place]) -> list[Place]:
        """Points with all that is to be known of them; eigenvalues beside the next matrix.

        JAX's programs run one after the other: two of them at a time, with matrices of some hundred
        rows, have waited for each other for ever on two cores.
        """
        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            judged = [pool.submit(self._judged_around, *self._looked_at(point)) for point in points]
            return [each.result() for each in judged]

    def with_windows(self, points: list[Place], folds: "Events") -> "tuple[list[Place], Events]":
        """Points that are seen, with more of them in windows that lie between two; and folds."""
        for _ in range(_ROUNDS):
            more = [self.see_all(self._in_windows(*pair)) for pair in itertools.pairwise(points)]
            if not any(more):
                break
            places = np.cumsum([0, *(1 + len(each) for each in more)])
            folds = [(int(places[index]), fold) for index, fold in folds]
            joined = [[point, *each] for point, each in zip(points, [*more, []], strict=True)]
            points = list(itertools.chain.from_iterable(joined))
        return points, folds

    def _in_windows(self, here: Place, ahead: Place) -> list[Place]:
        """Points where, between two, the response may be unstable."""
        chord = ahead.unknowns - here.unknowns
        way, length = heading_of(here), chord[-1]
        turns = way * heading_of(ahead) <= 0.0 or way * length <= 0.0
        if turns or not (here.is_stable or ahead.is_stable):
            return []
        # Of both ends the nearer one knows best, a little beyond the middle as well.
        share_of = lambda window: (window - here.unknowns[-1]) / length
        near = [share for share in map(share_of, here.windows) if 0.0 < share < _BEYOND]
        far = [share for share in map(share_of, ahead.windows) if 1.0 - _BEYOND < share < 1.0]
        found: list[Place] = []
        last = 0.0
        for share in sorted(near + far):
            if min(share - last, 1.0 - share) * abs(length) > _APART:
                guess = here.unknowns + share * chord
                point = self.correct_at_speed(guess, way)
                if point and distance_between(point.unknowns, guess) < 0.5 * length_of(chord):
                    found.append(point)
                    last = share
        return found

    def measure_at(self, point: Place) -> np.ndarray:
        """Weights of a change of each unknown in the length of a step there, as (9.4)."""
        rows = point.unknowns[:-1].reshape(self.balance.scales.size, -1)
        vibration = np.sqrt(np.sum(rows[:, 1:] ** 2))
        weights = np.ones_like(rows)
        weights[:, 1:] = 1.0 / np.clip(_VIBRATION * vibration, _LEAST, 1.0)
        return np.append(weights.reshape(-1), 1.0)

    def between(self, here: Place, ahead: Place, share: float) -> Place:
        """A point between two that are neighbours."""
        guess = here.unknowns + share * (ahead.unknowns - here.unknowns)
        found = self.correct(guess, here.tangent, float(here.tangent @ guess))
        if found is None:
            raise LostError
        return found

    def zero(
        self, here: Place, ahead: Place, of: Callable[[Place], float], accuracy: float
    ) -> Place:
        """The point between two where a function that has unlike signs there is zero."""
        ends = {0.0: of(here), 1.0: of(ahead)}
        value = lambda share: ends[share] if share in ends else of(self.between(here, ahead, share))
        step = float(here.tangent @ (ahead.unknowns - here.unknowns))
        share = scipy.optimize.brentq(value, 0.0, 1.0, xtol=accuracy / step, full_output=False)
        return self.between(here, ahead, float(cast(float, share)))

    def fold(self, here: Place, ahead: Place) -> Place:
        """Where the branch turns back between two points."""
        return self.zero(here, ahead, lambda point: point.tangent[-1], _FOLD_ACCURACY)

    def changes(self, points: list[Place]) -> "tuple[Events, Events]":
        """Where, among points that are seen, a period doubles, and where a torus begins."""
        whole = lambda point: point if np.isfinite(point.multiplier) else self.see(point)
        doublings: Events = []
        tori: Events = []
        for index, (here, ahead) in enumerate(itertools.pairwise(points)):

            def by_sign(point: Place, scale: float = here.doubling[1]) -> float:
                sign, size = whole(point).doubling
                return sign * np.exp(size - scale)

            if here.doubling[0] * ahead.doubling[0] < 0.0:
                doublings.append((index, self.passage(here, ahead, by_sign)))
            # Complex multipliers that meet and become real leave this without passing the circle.
            if here.ring * ahead.ring < 0.0 and np.isfinite(here.ring * ahead.ring):
                found = self.passage(here, ahead, lambda point: whole(point).ring)
                if abs(found.ring) < _ON_CIRCLE:
                    tori.append((index, found))
        return doublings, tori

    def passage(self, here: Place, ahead: Place, of: Callable[[Place], float]) -> Place:
        """Where a function of the multipliers passes through zero, or the point before it."""
        try:
            return self.see(self.zero(here, ahead, of, _PASSAGE_ACCURACY))
        except LostError:
            return here

    def shifted(self, unknowns: np.ndarray, cycles: int) -> np.ndarray:
        """The same response, some cycles later."""
        width = self.balance.scales.size
        terms = unknowns[:-1].reshape(width, -1)
        count = terms.shape[1] // 2
        order = np.arange(1, count + 1)
        # Harmonics are counted in the response's own frequency.
        angle = 2.0 * np.pi * order * cycles / self.multiple
        cosines, sines = terms[:, 1 : count + 1], terms[:, count + 1 :]
        turned = [
            terms[:, :1],
            cosines * np.cos(angle) + sines * np.sin(angle),
            sines * np.cos(angle) - cosines * np.sin(angle),
        ]
        return np.append(np.concatenate(turned, axis=1).reshape(-1), unknowns[-1])

    def joint(self, here: Place, ahead: Place) -> Place | None:
        """Where, between two points, the response repeats after fewer cycles, if it does."""
        for cycles in (d for d in range(1, self.multiple) if self.multiple % d == 0):
            part = lambda point, c=cycles: point.unknowns - self.shifted(point.unknowns, c)
            before = part(here)
            size = length_of(before)
            if size < _SAME or before @ part(ahead) > 0.0:
                continue
            # Two branches cross at zero, where neither has a tangent: a little before it.
            of = lambda point: float(part(point) @ before / size - 0.1 * _SAME)  # noqa: B023
            found = self.zero(here, ahead, of, 0.01 * _SAME)
            left = part(found)
            if length_of(left) < _SAME:
                return found
        return None

    def passes(self, here: Place, ahead: Place, first: Place) -> bool:
        """Whether a step comes back to the first point, or to the same response some cycles on."""
        chord = ahead.unknowns - here.unknowns
        for cycles in range(self.multiple):
            goal = self.shifted(first.unknowns, cycles)
            along = (goal - here.unknowns) @ chord / (chord @ chord)
            aside = distance_between(goal, here.unknowns + along * chord)
            if 0.0 < along <= 1.0 and aside < 0.5 * length_of(chord):
                met = self.correct(here.unknowns + along * chord, chord, float(goal @ chord))
                if met is not None and distance_between(met.unknowns, goal) < _SAME:
                    return True
        return False


# Along a branch: of folds, and of changes of stability. The multipliers of exact contact jump by
# little as cells close: so far may a pair of them be off the circle where they pass it.
_FOLD_ACCURACY, _PASSAGE_ACCURACY, _ON_CIRCLE = 1e-9, 1e-7, 1e-2

# A change of the vibration is measured by so many times its size, unless static deflections are
# less; by no less than so many of these.
_VIBRATION, _LEAST = 2.0, 1e-4

# Windows are looked into twice: the second time from the points of the first. Relative speeds
# between points within them, and how far the nearer of two ends may be from one.
_ROUNDS, _APART, _BEYOND = 2, 2e-4, 0.55

# Distance between responses that are one, and tangents that do not lean to either side.
_SAME, _UPRIGHT = 1e-4, 1e-9


def length_of(vector: np.ndarray) -> float:
    """Length of a vector [-]."""
    return float(np.sqrt(vector @ vector))


def distance_between(first: np.ndarray, second: np.ndarray) -> float:
    """Distance of two points of a curve, in its scaled unknowns [-]."""
    return length_of(first - second)


def heading_of(point: Place) -> float:
    """Whether speed rises or falls along the branch, 0 if it does neither but for rounding."""
    return float(np.sign(point.tangent[-1])) if abs(point.tangent[-1]) > _UPRIGHT else 0.0


# Points, each with the index of the point before it.
Events = list[tuple[int, Place]]
