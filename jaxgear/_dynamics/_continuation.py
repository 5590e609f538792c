r"""Branches of responses over speed, round their folds, by continuation in arc length.

Where a sweep jumps, the branch of responses folds back in speed and goes on, unstable. Harmonics
and speed are unknown together: a step along the tangent, then Newton's method in the plane across
it. Along the branch, $ds^2 = \overline{(\mathrm d m/m_0)^2} + (\mathrm d\ln\Omega_1)^2$: the mean
square over time of the mesh coordinates' change in static deflections, and the relative change of
speed, so that a resonance takes as many steps at low speed as at high.

Equations of exact contact at points in time have corners: close to a corner a fold lies within the
error of that discretisation, and has no derivative. Averaged or smooth contact has both.
"""

import concurrent.futures
import itertools
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Literal, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Bool, Complex, Float, PyTree

from jaxgear._checks import InputError, require
from jaxgear._dynamics._floquet import STABLE, monodromy, multipliers
from jaxgear._dynamics._harmonic import (
    Balance,
    HarmonicBalance,
    balance_of,
    imbalance,
    linearised,
)
from jaxgear._dynamics._orbit import Orbit, contact_force
from jaxgear._dynamics._system import DynamicSystem
from jaxgear._dynamics._types import Terms
from jaxgear._types import Reals, Scalar

if TYPE_CHECKING:
    Places = np.ndarray
    PlaceTerms = np.ndarray
    PlaceMultipliers = np.ndarray
    FlagPlaces = np.ndarray
    Harmonics = np.ndarray
else:
    Places = Float[np.ndarray, "point"]
    PlaceTerms = Float[np.ndarray, "point coordinate term"]
    PlaceMultipliers = Complex[np.ndarray, "point"]
    FlagPlaces = Bool[np.ndarray, "point"]
    Harmonics = Float[np.ndarray, "coordinate term"]

# Why a branch ends: at an end of the range of speeds, where it began, at a branch that repeats
# after fewer cycles, where Newton's method fails at the smallest step, or after enough points.
End = Literal["began", "left", "returned", "joined", "lost", "most points", "not found"]


class CurvePoint(eqx.Module):
    """A response of interest on a branch.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `dynamic_ratio`: largest total contact force over the static one [-].
    - `terms`: harmonics of the mesh coordinates [m, rad].
    - `after`: index of the point of the branch that precedes it, -1 if there is none [-].
    """

    speed: float
    dynamic_ratio: float
    terms: Harmonics
    after: int


class Curve(eqx.Module):
    """Responses in their order along a branch, stable or not.

    **Fields:**

    - `speed`: of the pinion [rad/s].
    - `dynamic_ratio`: largest total contact force over the static one [-].
    - `te_rms`: of the dynamic transmission error about its mean [m].
    - `terms`: harmonics of the mesh coordinates [m, rad].
    - `multiplier`: the largest of Floquet, over the whole response; NaN if not asked for [-].
    - `stable`: whether it is smaller than one; false if not asked for.
    - `folds`: where the branch turns back in speed.
    - `doublings`: where a multiplier passes through -1.
    - `tori`: where a pair of complex multipliers passes through the unit circle: beyond, the
        amplitude beats.
    - `ends`: why there is nothing before the first and after the last point.
    - `steps`: Newton's steps in all.
    """

    speed: Places
    dynamic_ratio: Places
    te_rms: Places
    terms: PlaceTerms
    multiplier: PlaceMultipliers
    stable: FlagPlaces
    folds: tuple[CurvePoint, ...]
    doublings: tuple[CurvePoint, ...]
    tori: tuple[CurvePoint, ...]
    ends: tuple[End, End] = eqx.field(static=True)
    steps: int = eqx.field(static=True)


# --- The equations in harmonics and speed


def _sizes(balance: Balance) -> Terms:
    """Of the harmonics: a change by these has a mean square over time of one."""
    rows = jnp.full(balance.middle.shape[1], jnp.sqrt(2.0)).at[0].set(1.0)
    return balance.scales[:, None] * rows[None, :]


def _joined(balance: Balance, terms: Terms, speed: Scalar) -> Reals:
    """Harmonics and speed as one vector without units."""
    return jnp.append((terms / _sizes(balance)).reshape(-1), jnp.log(speed))


def _parted(balance: Balance, unknowns: Reals) -> tuple[Terms, Scalar]:
    """Harmonics and speed."""
    sizes = _sizes(balance)
    return unknowns[:-1].reshape(sizes.shape) * sizes, jnp.exp(unknowns[-1])


def _by_both(balance: Balance, unknowns: Reals) -> tuple[Reals, Reals]:
    """The residual, and its derivative by harmonics and speed: a column more than rows."""
    terms, speed = _parted(balance, unknowns)
    residual, matrix = linearised(balance.at_speed(speed)[0], terms)

    def at(exponent: Scalar) -> Reals:
        problem = balance.at_speed(jnp.exp(exponent))[0]
        return imbalance(problem, terms)

    _, by_speed = jax.jvp(at, (unknowns[-1],), (jnp.ones(()),))
    columns = matrix * _sizes(balance).reshape(1, -1)
    return residual.reshape(-1), jnp.concatenate([columns, by_speed.reshape(-1, 1)], axis=1)


# A step along the branch that takes more of Newton's steps is too long.
_MOST_NEWTON = 10


@jax.jit
def _correct(
    balance: Balance, first: Reals, normal: Reals, value: Scalar, tolerance: Scalar
) -> tuple[Reals, Reals, Scalar, Scalar]:
    """The point of the branch in a plane, its tangent on the side of the plane's normal, the
    imbalance one step before, and the number of steps.
    """

    def body(state):
        unknowns, _, _, steps = state
        residual, matrix = _by_both(balance, unknowns)
        off = normal @ unknowns - value
        right = jnp.stack([jnp.append(residual, off), jnp.zeros_like(normal).at[-1].set(1.0)], 1)
        solved = jnp.linalg.solve(jnp.concatenate([matrix, normal[None, :]]), right)
        tangent = solved[:, 1] / jnp.sqrt(jnp.sum(solved[:, 1] ** 2))
        error = jnp.max(jnp.abs(residual))
        return unknowns - solved[:, 0], tangent, error, steps + 1.0

    def unfinished(state):
        return ~(state[2] <= tolerance) & (state[3] < _MOST_NEWTON)

    start = first, normal, jnp.asarray(jnp.inf), jnp.zeros(())
    return jax.lax.while_loop(unfinished, body, start)


@jax.jit
def _seen(balance: Balance, unknowns: Reals) -> tuple[Scalar, Scalar]:
    """Dynamic ratio and RMS of the transmission error of a point."""
    return _measures(balance, _orbit(balance, unknowns))


@jax.jit
def _seen_whole(balance: Balance, unknowns: Reals) -> tuple[Scalar, Scalar, Reals]:
    """The same, and the monodromy matrix."""
    orbit = _orbit(balance, unknowns)
    matrix = monodromy(balance.system, balance.modes, orbit, law=balance.law)
    return *_measures(balance, orbit), matrix


def _orbit(balance: Balance, unknowns: Reals) -> Orbit:
    terms, speed = _parted(balance, unknowns)
    problem, responses = balance.at_speed(speed)
    none = jnp.zeros(())
    return balance.orbit(problem, responses, terms, none, none, 0.0)


def _measures(balance: Balance, orbit: Orbit) -> tuple[Scalar, Scalar]:
    system = balance.system
    error = orbit.motion @ system.transmission
    share = system.table.lengths / system.table.periods
    error = error - jnp.sum(share * error)
    ratio = jnp.max(contact_force(system, orbit)) / system.force
    return ratio, jnp.sqrt(jnp.sum(share * error**2))


@jax.jit
def _first(method: HarmonicBalance, balance: Balance, speed: Scalar, near: Terms) -> Reals:
    """The response that Newton's method reaches at a given speed."""
    return _joined(balance, method.solve(balance, speed, near)[1], speed)


_prepared = jax.jit(balance_of)


# --- Along a branch


class _Point(NamedTuple):
    """A point of a branch, and what is known of it."""

    unknowns: np.ndarray
    tangent: np.ndarray
    steps: int
    ratio: float = np.nan
    te_rms: float = np.nan
    multiplier: complex = complex(np.nan, np.nan)
    # Sign and logarithm of det(1 + M): it passes through zero as a multiplier passes through -1.
    doubling: tuple[float, float] = (1.0, 0.0)
    # Logarithm of the largest size of a complex multiplier.
    ring: float = -np.inf


def _hides(here: _Point, ahead: _Point) -> bool:
    """Whether speed turns twice between two points, by the cubic through their tangents."""
    first, last = here.tangent[-1], ahead.tangent[-1]
    step = _distance(ahead.unknowns, here.unknowns)
    between = 1.5 * (ahead.unknowns[-1] - here.unknowns[-1]) / step - 0.25 * (first + last)
    rises = (first + last) * (abs(first + last) > _UPRIGHT)
    return bool(first * last > -(_UPRIGHT**2) and between * rises < 0.0)


class _LostError(Exception):
    """Newton's method failed within a step that had been taken."""


class _Guide:
    """Takes steps along the branches of one balance."""

    def __init__(self, method: HarmonicBalance, balance: Balance, *, stability: bool):
        self.balance = balance
        self.tolerance = method.tolerance
        self.multiple = method.multiple
        self.stability = stability
        self.steps = 0

    def correct(self, first: np.ndarray, normal: np.ndarray, value: float) -> _Point | None:
        """The point in a plane, or nothing."""
        unknowns, tangent, error, steps = jax.device_get(
            _correct(self.balance, first, normal, value, self.tolerance)
        )
        self.steps += int(steps)
        found = bool(error <= self.tolerance) and bool(np.all(np.isfinite(tangent)))
        return _Point(unknowns, tangent, int(steps)) if found else None

    def see(self, point: _Point) -> _Point:
        """A point with all that is to be known of it."""
        if not self.stability:
            ratio, te_rms = jax.device_get(_seen(self.balance, point.unknowns))
            return point._replace(ratio=float(ratio), te_rms=float(te_rms))
        ratio, te_rms, matrix = _seen_whole(self.balance, point.unknowns)
        found = multipliers(matrix, self.balance.modes)
        sign, size = np.linalg.slogdet(np.eye(found.size) + np.asarray(matrix))
        pairs = found[np.imag(found) != 0.0]
        return point._replace(
            ratio=float(ratio),
            te_rms=float(te_rms),
            multiplier=complex(found[0]),
            doubling=(float(sign), float(size)),
            ring=float(np.log(np.abs(pairs[0]))) if pairs.size else -np.inf,
        )

    def see_all(self, points: list[_Point]) -> list[_Point]:
        """Points with all that is to be known of them, by two threads at a time."""
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            return list(pool.map(self.see, points))

    def between(self, here: _Point, ahead: _Point, share: float) -> _Point:
        """A point between two that are neighbours."""
        guess = here.unknowns + share * (ahead.unknowns - here.unknowns)
        found = self.correct(guess, here.tangent, float(here.tangent @ guess))
        if found is None:
            raise _LostError
        return found

    def zero(
        self, here: _Point, ahead: _Point, of: Callable[[_Point], float], accuracy: float
    ) -> _Point:
        """The point between two where a function that has unlike signs there is zero."""
        ends = {0.0: of(here), 1.0: of(ahead)}
        value = lambda share: ends[share] if share in ends else of(self.between(here, ahead, share))
        step = float(here.tangent @ (ahead.unknowns - here.unknowns))
        share = scipy.optimize.brentq(value, 0.0, 1.0, xtol=accuracy / step, full_output=False)
        return self.between(here, ahead, float(cast(float, share)))

    def fold(self, here: _Point, ahead: _Point) -> _Point:
        """Where the branch turns back between two points."""
        return self.zero(here, ahead, lambda point: point.tangent[-1], _FOLD_ACCURACY)

    def changes(self, points: list[_Point]) -> "tuple[_Events, _Events]":
        """Where, among points that are seen, a period doubles, and where a torus begins."""
        whole = lambda point: point if np.isfinite(point.ratio) else self.see(point)
        doublings: _Events = []
        tori: _Events = []
        for index, (here, ahead) in enumerate(itertools.pairwise(points)):

            def by_sign(point: _Point, scale: float = here.doubling[1]) -> float:
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

    def passage(self, here: _Point, ahead: _Point, of: Callable[[_Point], float]) -> _Point:
        """Where a function of the multipliers passes through zero, or the point before it."""
        try:
            return self.see(self.zero(here, ahead, of, _PASSAGE_ACCURACY))
        except _LostError:
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

    def joint(self, here: _Point, ahead: _Point) -> _Point | None:
        """Where, between two points, the response repeats after fewer cycles, if it does."""
        for cycles in (d for d in range(1, self.multiple) if self.multiple % d == 0):
            part = lambda point, c=cycles: point.unknowns - self.shifted(point.unknowns, c)
            before = part(here)
            size = np.sqrt(before @ before)
            if size < _SAME or before @ part(ahead) > 0.0:
                continue
            # Two branches cross at zero, where neither has a tangent: a little before it.
            of = lambda point: float(part(point) @ before / size - 0.1 * _SAME)  # noqa: B023
            found = self.zero(here, ahead, of, 0.01 * _SAME)
            left = part(found)
            if np.sqrt(left @ left) < _SAME:
                return found
        return None

    def passes(self, here: _Point, ahead: _Point, first: _Point) -> bool:
        """Whether a step comes back to the first point, or to the same response some cycles on."""
        chord = ahead.unknowns - here.unknowns
        for cycles in range(self.multiple):
            goal = self.shifted(first.unknowns, cycles)
            along = (goal - here.unknowns) @ chord / (chord @ chord)
            aside = _distance(goal, here.unknowns + along * chord)
            if 0.0 < along <= 1.0 and aside < 0.5 * np.sqrt(chord @ chord):
                met = self.correct(here.unknowns + along * chord, chord, float(goal @ chord))
                if met is not None and _distance(met.unknowns, goal) < _SAME:
                    return True
        return False


# Along a branch: of folds, and of changes of stability. The multipliers of exact contact jump by
# little as cells close: so far may a pair of them be off the circle where they pass it.
_FOLD_ACCURACY, _PASSAGE_ACCURACY, _ON_CIRCLE = 1e-9, 1e-7, 1e-2
# Distance between responses that are one, and tangents that do not lean to either side.
_SAME, _UPRIGHT = 1e-4, 1e-9
# Steps halve below the first and grow above the second of these cosines of the turn they make, and
# a corrected point is not further aside than this part of its step.
_SHARP, _STRAIGHT, _ASIDE = 0.8, 0.98, 0.5
_FEW_NEWTON, _MANY_NEWTON = 4, 6
_SMALLEST_STEP = 1e-7
# Steps above this are halved if two folds seem to hide in them.
_LOOKED_AT = 3e-3


def _distance(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.sqrt(np.sum((first - second) ** 2)))


def _heading(point: _Point) -> float:
    """Whether speed rises or falls along the branch, 0 if it does neither but for rounding."""
    return float(np.sign(point.tangent[-1])) if abs(point.tangent[-1]) > _UPRIGHT else 0.0


# Points, each with the index of the point before it.
_Events = list[tuple[int, _Point]]


class _Walk(NamedTuple):
    """The points in one direction, what lies between them, and why they end."""

    points: list[_Point]
    folds: _Events
    doublings: _Events
    tori: _Events
    end: End


def _walk(
    guide: _Guide,
    first: _Point,
    span: tuple[float, float],
    steps: tuple[float, float],
    most_points: int,
    done: Callable[[int], None],
) -> _Walk:
    """Follow a branch from a point in the direction of its tangent."""
    step, largest = steps
    points, folds = [first], []
    heading = _heading(first)
    upright = np.zeros_like(first.unknowns)
    upright[-1] = 1.0

    def end(why: End) -> _Walk:
        seen = guide.see_all(points)
        doublings, tori = guide.changes(seen)
        return _Walk(seen, [(i, guide.see(x)) for i, x in folds], doublings, tori, why)

    def ahead_of(here: _Point, step: float) -> tuple[_Point | None, bool]:
        """The next point, and whether it is on the edge of the range."""
        guess = here.unknowns + step * here.tangent
        ahead = guide.correct(guess, here.tangent, float(here.tangent @ guess))
        if ahead is None:
            return None, False
        if here.tangent @ ahead.tangent < _SHARP:
            return None, False
        if _distance(ahead.unknowns, guess) > _ASIDE * step:
            return None, False
        if step > _LOOKED_AT and _hides(here, ahead):
            return None, False
        low, high = span
        inside = low <= ahead.unknowns[-1] <= high
        if inside:
            return ahead, False
        edge = low if ahead.unknowns[-1] < low else high
        way = ahead.unknowns - here.unknowns
        share = (edge - here.unknowns[-1]) / way[-1] if way[-1] else 0.0
        on_edge = guide.correct(here.unknowns + share * way, upright, edge)
        if on_edge is None or _distance(on_edge.unknowns, here.unknowns) > 1.5 * step:
            return None, False
        turned = np.copysign(1.0, on_edge.tangent @ here.tangent)
        return on_edge._replace(tangent=on_edge.tangent * turned), True

    while len(points) < most_points:
        here = points[-1]
        ahead, leaves = ahead_of(here, step)
        joint = fold = None
        try:
            if ahead is not None:
                joint = guide.joint(here, ahead)
                if joint is None and heading * _heading(ahead) < 0.0:
                    fold = guide.fold(here, ahead) if _heading(here) else here
        except _LostError:
            ahead = None
        if ahead is None:
            step *= 0.5
            if step < _SMALLEST_STEP:
                return end("lost")
            continue
        if joint is not None:
            points.append(joint)
            done(1)
            return end("joined")
        heading = _heading(ahead) or heading
        if fold is not None:
            folds.append((len(points) - 1, fold))
        back = len(points) > 2 and guide.passes(here, ahead, first)
        points.append(first if back else ahead)
        done(1)
        if back:
            return end("returned")
        if leaves:
            return end("left")
        turn = here.tangent @ ahead.tangent
        if ahead.steps <= _FEW_NEWTON and turn > _STRAIGHT:
            step = min(1.4 * step, largest)
        elif ahead.steps >= _MANY_NEWTON or turn < 0.5 * (_SHARP + _STRAIGHT):
            step *= 0.6
    return end("most points")


def continuation(
    system: DynamicSystem,
    start: float,
    stop: float,
    *,
    method: HarmonicBalance = HarmonicBalance(),
    near: Terms | None = None,
    at: float | None = None,
    first_step: float = 0.01,
    largest_step: float = 0.1,
    most_points: int = 1000,
    stability: bool = True,
    done: Callable[[int], None] = lambda count: None,
) -> Curve:
    """Follow a branch of responses over a range of speeds, round its folds.

    **Arguments:**

    - `system`: what moves.
    - `start`, `stop`: speeds of the pinion, positive and different. The branch is followed from
        `start` towards `stop` until it leaves this range on either side [rad/s].
    - `method`: with `multiple` of 2, branches of sub-harmonic responses, from `near` one.
    - `near`: harmonics of the mesh coordinates to begin with, as of `terms_of`, or `None`: those
        of the quasi-static states [m, rad].
    - `at`: speed of `near`, if it is between `start` and `stop`: the branch is then followed both
        ways, and put together [rad/s].
    - `first_step`, `largest_step`: along the branch: root mean square change of the mesh
        coordinates in static deflections, together with the relative change of speed [-].
    - `most_points`: in each direction.
    - `stability`: whether to find Floquet's multipliers.
    - `done`: told how many more points are found.

    **Returns:**

    The branch. It has no points where no response is found to begin with. At a fold of exact
    contact at points in time a multiplier is close to +1, not equal: multipliers are those of a
    march with as many steps, which is another discretisation.

    **Raises:**

    - `ValueError` unless speeds and steps are as above.
    """
    require(
        start > 0.0 and stop > 0.0 and start != stop,
        "`continuation` needs two different positive speeds, got {start:.6g} and {stop:.6g} rad/s.",
        start=start,
        stop=stop,
    )
    require(
        _SMALLEST_STEP < first_step <= largest_step,
        "`first_step` must be positive and not above `largest_step`, got {first} and {largest}.",
        first=first_step,
        largest=largest_step,
    )
    at = start if at is None else at
    low, high = sorted((start, stop))
    require(
        low <= at <= high,
        "`at` must lie between `start` and `stop`, got {at:.6g} rad/s.",
        at=at,
    )
    balance = _prepared(method, system)
    guide = _Guide(method, balance, stability=stability)
    near = balance.rest if near is None else near
    begun = np.asarray(_first(method, balance, jnp.asarray(float(at)), near))
    upright = np.zeros_like(begun)
    upright[-1] = 1.0
    first = guide.correct(begun, upright, float(begun[-1])) if np.all(np.isfinite(begun)) else None
    if first is None:
        return _curve(guide, _Walk([], [], [], [], "not found"), "not found")
    done(1)
    way = np.sign(stop - start)
    first = first._replace(tangent=way * first.tangent)
    span, steps = (float(np.log(low)), float(np.log(high))), (first_step, largest_step)
    onwards = _walk(guide, first, span, steps, most_points, done)
    if at == start or onwards.end == "returned":
        return _curve(guide, onwards, "returned" if onwards.end == "returned" else "began")
    behind = first._replace(tangent=-first.tangent)
    backwards = _walk(guide, behind, span, steps, most_points, done)
    return _curve(guide, _together(backwards, onwards), backwards.end)


def _together(backwards: _Walk, onwards: _Walk) -> _Walk:
    """One walk of two in opposite directions from one point."""
    count = len(backwards.points) - 1
    # What follows a point on the way back precedes it on the way forth.
    before = lambda events: [(count - 1 - index, point) for index, point in reversed(events)]
    after = lambda events: [(count + index, point) for index, point in events]
    return _Walk(
        points=[*reversed(backwards.points), *onwards.points[1:]],
        folds=before(backwards.folds) + after(onwards.folds),
        doublings=before(backwards.doublings) + after(onwards.doublings),
        tori=before(backwards.tori) + after(onwards.tori),
        end=onwards.end,
    )


_joined_once = jax.jit(_joined)


def _curve(guide: _Guide, walk: _Walk, begins: End) -> Curve:
    """What a walk has found."""
    points = walk.points
    sizes = np.asarray(_sizes(guide.balance))

    def special(events: _Events) -> tuple[CurvePoint, ...]:
        return tuple(_special(guide, point, index) for index, point in events)

    column = lambda name: np.asarray([getattr(point, name) for point in points])
    unknowns = np.asarray([point.unknowns for point in points]).reshape(-1, sizes.size + 1)
    multiplier = column("multiplier").astype(complex)
    return Curve(
        speed=np.exp(unknowns[:, -1]),
        dynamic_ratio=column("ratio").astype(float),
        te_rms=column("te_rms").astype(float),
        terms=unknowns[:, :-1].reshape(-1, *sizes.shape) * sizes,
        multiplier=multiplier,
        stable=np.abs(multiplier) <= STABLE,
        folds=special(walk.folds),
        doublings=special(walk.doublings),
        tori=special(walk.tori),
        ends=(begins, walk.end),
        steps=guide.steps,
    )


def _special(guide: _Guide, point: _Point, after: int) -> CurvePoint:
    terms, speed = jax.device_get(_parted_once(guide.balance, point.unknowns))
    return CurvePoint(float(speed), point.ratio, terms, after)


_parted_once = jax.jit(_parted)


def doubled(
    system: DynamicSystem, method: HarmonicBalance, doubling: CurvePoint, *, step: float = 0.02
) -> tuple[Terms, float]:
    """A response of twice the period, close to where the period doubles.

    **Arguments:**

    - `system`: what moves.
    - `method`: with `multiple` twice that by which the doubling was found.
    - `doubling`: of a curve.
    - `step`: root mean square of the sub-harmonic part, in static deflections [-].

    **Returns:**

    Its harmonics [m, rad] and its speed [rad/s], for `near` and `at` of `continuation`.

    **Raises:**

    - `ValueError` if `multiple` is odd, or if no such response is found.
    """
    require(
        method.multiple % 2 == 0,
        "A doubled period needs an even `HarmonicBalance.multiple`, got {got}.",
        got=method.multiple,
    )
    balance = _prepared(method, system)
    guide = _Guide(method, balance, stability=False)
    kept, count = doubling.terms.shape[1] // 2, balance.count
    order = np.arange(1, min(kept, count // 2) + 1)
    terms = np.zeros((doubling.terms.shape[0], 2 * count + 1))
    terms[:, 0] = doubling.terms[:, 0]
    terms[:, 2 * order] = doubling.terms[:, order]
    terms[:, count + 2 * order] = doubling.terms[:, kept + order]
    speed = jnp.asarray(doubling.speed)
    centre = np.asarray(_joined_once(balance, jnp.asarray(terms), speed))
    matrix = np.asarray(_by_both_once(balance, centre)[1])[:, :-1]
    shape = np.append(np.linalg.svd(matrix)[2][-1], 0.0)
    shape = shape - guide.shifted(shape, method.multiple // 2)
    shape = shape / np.sqrt(shape @ shape)
    guess = centre + step * shape
    found = guide.correct(guess, shape, float(shape @ guess))
    if found is None:
        raise InputError(
            "No response of twice the period was found near "
            f"{doubling.speed:.6g} rad/s. Try another `step`."
        )
    terms, speed = _parted_once(balance, found.unknowns)
    return terms, float(speed)


_by_both_once = jax.jit(_by_both)


# --- Folds


@jax.jit
def condition(balance: Balance, terms: Terms, speed: Scalar) -> Scalar:
    """How far a response is from a fold, or from where another branch crosses.

    **Arguments:**

    - `balance`: from `balance_of`.
    - `terms`: harmonics of the response [m, rad].
    - `speed`: of the pinion [rad/s].

    **Returns:**

    The smallest singular value of the derivative of the balance by the harmonics, both without
    units: 1 for a linear system, 0 at a fold. Derivatives of the response grow with its inverse
    [-].
    """
    matrix = _by_both(balance, _joined(balance, terms, speed))[1][:, :-1]
    return jnp.linalg.svd(matrix, compute_uv=False)[-1]


def fold_near(
    system: DynamicSystem, method: HarmonicBalance, fold: CurvePoint, *, reach: float = 0.5
) -> CurvePoint | None:
    """Find the fold again after the system has changed a little.

    **Arguments:**

    - `system`: what moves now.
    - `method`: by which the fold was found.
    - `fold`: of the system before.
    - `reach`: how far along the branch to look for it [-].

    **Returns:**

    The fold, or `None` if there is none within reach.
    """
    balance = _prepared(method, system)
    guide = _Guide(method, balance, stability=False)
    speed = jnp.asarray(fold.speed)
    near = np.asarray(_joined_once(balance, jnp.asarray(fold.terms), speed))
    normal = np.linalg.svd(np.asarray(_by_both_once(balance, near)[1]))[2][-1]
    here = guide.correct(near, normal, float(normal @ near))
    if here is None:
        return None
    step = 1e-3
    while step <= reach:
        for way in (1.0, -1.0):
            begun = here._replace(tangent=way * here.tangent)
            guess = begun.unknowns + step * begun.tangent
            ahead = guide.correct(guess, begun.tangent, float(begun.tangent @ guess))
            if ahead is None or begun.tangent[-1] * ahead.tangent[-1] > 0.0:
                continue
            try:
                return _special(guide, guide.see(guide.fold(begun, ahead)), -1)
            except _LostError:
                continue
        step *= 2.0
    return None


# Smallest singular value at which a point counts as a fold, and its largest imbalance.
_SINGULAR, _BALANCED = 1e-4, 1e-6


def fold_gradient(
    build: Callable[[PyTree], DynamicSystem],
    parameters: PyTree,
    method: HarmonicBalance,
    fold: CurvePoint,
) -> PyTree:
    r"""Derivatives of the speed at which a branch folds.

    With $l$ the left null vector of the balance's derivative by the harmonics,
    $\mathrm d\Omega/\mathrm d\theta = -(l\cdot r_\theta)/(l\cdot r_\Omega)$: no second derivatives
    are needed.

    **Arguments:**

    - `build`: makes the system of parameters. It is compiled anew when it is another function.
    - `parameters`: at which the fold was found.
    - `method`: by which it was found, with averaged or smooth contact. Exact contact at points in
        time changes its slope from one time step to the next: its folds are corners, and have no
        derivative, or one with an error in the order of a step.
    - `fold`: of the system of these parameters, as of `continuation` or `fold_near`.

    **Returns:**

    Derivatives of the speed by each parameter, like `parameters` [rad/s per unit of each].

    **Raises:**

    - `ValueError` if the point is not a fold of that system, or is one at a corner.
    """

    balance = _prepared(method, _built(build, parameters))
    terms, speed = jnp.asarray(fold.terms), jnp.asarray(fold.speed)
    residual, matrix = _by_both_once(balance, _joined_once(balance, terms, speed))
    left, sizes, _ = np.linalg.svd(np.asarray(matrix)[:, :-1])
    error = np.max(np.abs(residual))
    require(
        bool(error <= _BALANCED),
        "The point at {speed:.6g} rad/s is no response of the system of these parameters: its "
        "imbalance is {error:.3g}. Find the fold again with `fold_near`.",
        speed=fold.speed,
        error=error,
    )
    require(
        bool(sizes[-1] <= _SINGULAR),
        "The point at {speed:.6g} rad/s is no smooth fold: the smallest singular value is "
        "{smallest:.3g}. Exact contact at points in time folds at corners; use `averaged=True` or "
        "`SmoothContact`.",
        speed=fold.speed,
        smallest=sizes[-1],
    )
    left = left[:, -1]
    by_speed = float(left @ np.asarray(matrix)[:, -1]) / fold.speed
    slopes = _weighted_slopes(build, parameters, method, left, terms, speed)
    return jax.tree.map(lambda slope: -slope / by_speed, slopes)


_built = jax.jit(lambda build, parameters: build(parameters), static_argnums=0)


@partial(jax.jit, static_argnums=0)
def _weighted_slopes(
    build: Callable[[PyTree], DynamicSystem],
    parameters: PyTree,
    method: HarmonicBalance,
    weights: Reals,
    terms: Terms,
    speed: Scalar,
) -> PyTree:
    """Derivatives by the parameters of a weighted sum of the residual."""

    def total(parameters: PyTree) -> Scalar:
        problem = balance_of(method, build(parameters)).at_speed(speed)[0]
        return weights @ imbalance(problem, terms).reshape(-1)

    return jax.grad(total)(parameters)
